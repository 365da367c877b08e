"""Evaluations of a back-analysis: projects with trial values simulated and compared, logged."""

import json
import logging
import math
import os
import time
from collections.abc import Callable
from concurrent.futures import Executor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..core import LANES
from ..errors import InputError, ReadError, SolverError
from ..inference.likelihood import SIGNED, misfit_to
from ..inference.parameter import Parameter, Problem
from ..project.project import Project
from ..project.result import plain
from ..runs.parallel import input_hash
from ..signals.seismogram import Seismogram
from ..signals.spectra import dominant_frequency
from .parameters import simulate
from .waveforms import Waveforms


@dataclass(frozen=True, eq=False)
class Target:
    """What a search shall meet: blasts, the unknowns of their ground, records, misfit.

    Parameters
    ----------
    projects : tuple of Project
        One for each blast, with its records.
    parameters : tuple of Parameter
    receivers : tuple of str
        Whose records count; all that have one if empty.
    misfit : str
        Of `MISFITS`.
    steps : tuple
        For each project the time step that all its models march in, None where each has its own.
    waveforms : Waveforms, optional
        The records as misfit ``waveform`` takes them.
    """

    projects: tuple[Project, ...]
    parameters: tuple[Parameter, ...]
    receivers: tuple[str, ...]
    misfit: str
    steps: tuple
    waveforms: Waveforms | None = None

    @property
    def batch(self) -> int:
        """Points that are evaluated in one go."""
        return LANES if all(self.steps) else 1

    def recorded(self, project) -> dict[str, Seismogram]:
        """Return the records of a project that count."""
        names = self.receivers or project.recorded
        return {name: record for name, record in project.recorded.items() if name in names}


def evaluate(target: Target, points) -> list[dict]:
    """Return what is worth keeping of the evaluation of points (m, n).

    Returns
    -------
    list of dict
        ``misfit``, infinite where a model could not be run and ``error`` says why; its
        ``residuals``, none where it failed or where the misfit has none, of waveforms before they
        are whitened; ``simulated``
        with ``ppv`` in m/s and ``frequency`` in Hz by blast and receiver; ``wall_seconds``.
    """
    began = time.perf_counter()
    try:
        found = [
            simulate(project, target.parameters, points, step)
            for project, step in zip(target.projects, target.steps, strict=True)
        ]
    except SolverError as error:
        if len(points) > 1:  # one of them, and the others are fine
            return [row for point in points for row in evaluate(target, point[None])]
        failed = _row((math.inf, np.zeros(0)), {}, time.perf_counter() - began)
        return [failed | {"error": str(error)}]
    seconds = (time.perf_counter() - began) / len(points)
    return [
        _row(misfit_of(target, motions), _numbers(target, motions), seconds)
        for motions in zip(*found, strict=True)
    ]


def misfit_of(target: Target, motions) -> tuple[float, np.ndarray]:
    """Return the mean misfit over blasts and receivers of simulated motions, one dict a blast.

    And the residuals of all of them, (n,), none where the misfit has none; of waveforms as they
    are before they are whitened.
    """
    if target.waveforms is not None:
        residuals = target.waveforms.residuals(motions)
        return target.waveforms.whitened(residuals)[0], residuals
    misfits, residuals = zip(
        *(
            misfit_to(target.misfit, record, simulated[name], band_of(project))
            for project, simulated in zip(target.projects, motions, strict=True)
            for name, record in target.recorded(project).items()
        ),
        strict=True,
    )
    return float(np.mean(misfits)), np.concatenate(residuals)


def band_of(project):
    """Return the band in Hz in which records are compared, or None for all."""
    band = project.config.run.compare_band_hz
    return None if band is None else tuple(band)


def _numbers(target, motions):
    """Return peaks and dominant frequencies by blast and receiver."""
    return {
        project.path.name: {
            name: {
                "ppv": simulated[name].ppv.tolist(),
                "frequency": dominant_frequency(simulated[name]).hz.tolist(),
            }
            for name in target.recorded(project)
        }
        for project, simulated in zip(target.projects, motions, strict=True)
    }


def _row(measured, simulated, seconds):
    """Return one row of a log."""
    misfit, residuals = measured
    return {
        "misfit": misfit,
        "residuals": residuals.tolist(),
        "simulated": simulated,
        "wall_seconds": round(seconds, 3),
    }


KIND = "pyblast trials"
log = logging.getLogger(__name__)


class TrialLog:
    """A file of JSON lines: what is searched, then one line for each evaluation.

    Parameters
    ----------
    path : path
    identity : dict
        What the trials belong to; ``hash`` must agree when they are resumed.
    resume : bool
        Whether to read what is there. What a kill left of a line is cut off.

    Attributes
    ----------
    rows : list of dict
        ``number`` from 1, ``values``, ``misfit``, ``residuals``, ``simulated``, ``wall_seconds``.
    """

    def __init__(self, path, identity, resume=False):
        self.path, self.rows = Path(path), []
        if resume:
            self._read(identity)
        else:
            self._write("w", [{"kind": KIND, **identity}])

    def add(self, rows):
        """Append rows and see them on the disk."""
        self._write("a", rows)
        self.rows += rows

    def _write(self, mode, rows):
        text = "".join(json.dumps(plain(row), allow_nan=False) + "\n" for row in rows)
        try:
            with self.path.open(mode, encoding="utf-8") as file:
                file.write(text)
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            raise ReadError(f"{self.path}: can't be written ({error.strerror})") from None

    def _read(self, identity):
        """Read the rows of an earlier search of the same kind."""
        try:
            data = self.path.read_bytes()
        except OSError as error:
            raise ReadError(f"{self.path}: can't be read ({error.strerror})") from None
        whole = data[: data.rfind(b"\n") + 1]
        try:
            head, *rows = [json.loads(line) for line in whole.splitlines()]
            found = head["hash"], head["kind"]
            rows = [{**row, "misfit": _number(row["misfit"])} for row in rows]
            numbers = [row["number"] for row in rows]
        except (ValueError, KeyError, TypeError):
            raise ReadError(f"{self.path}: is no log of trials; give another folder") from None
        if numbers != list(range(1, len(rows) + 1)):
            raise ReadError(f"{self.path}: its trials are not numbered from 1; lines are missing")
        if found != (identity["hash"], KIND):
            raise InputError(
                f"{self.path}: belongs to another project, record, parameter or method; "
                "start anew with --fresh"
            )
        if len(whole) < len(data):
            with self.path.open("r+b") as file:
                file.truncate(len(whole))
        self.rows = rows


class Trials:
    """The evaluations of one search in their order.

    Parameters
    ----------
    target : Target
    trial_log : TrialLog
    budget : int
        Evaluations to come, for the progress.
    executor : concurrent.futures.Executor, optional
        None evaluates here, one batch after the other.
    progress : callable, optional
        Called with ("trials", done, total).
    """

    def __init__(self, target: Target, trial_log: TrialLog, budget: int, *,
                 executor: Executor | None = None, progress: Callable | None = None):  # fmt: skip
        self.target, self.log, self.budget = target, trial_log, budget
        self.executor, self.progress = executor, progress or (lambda *_: None)
        self.count = 0

    def problem(self) -> Problem:
        """Return the problem that a search is given."""
        parts = [(one.low, one.high, one.log) for one in self.target.parameters]
        vectors = self.vectors if self.target.misfit in SIGNED else None
        return Problem(*zip(*parts, strict=True), self, vectors)

    def __call__(self, points) -> np.ndarray:
        """Return the misfits (m,) of points (m, n): from the log where they are, else from runs."""
        return np.array([self._measured(row)[0] for row in self._rows(points)])

    def vectors(self, points) -> tuple[np.ndarray, np.ndarray]:
        """Return misfits (m,) and residuals (m, k), infinite where a model could not be run."""
        rows = self._rows(points)
        failed = np.full(max(1, *(len(row["residuals"]) for row in self.log.rows)), math.inf)
        found = [self._measured(row) for row in rows]
        residuals = np.array([one if len(one) else failed for _, one in found])
        return np.array([misfit for misfit, _ in found]), residuals

    def misfits(self) -> np.ndarray:
        """Return the misfits of all that was asked for, by the errors of the theory known now."""
        return np.array([self._measured(row)[0] for row in self.log.rows[: self.count]])

    def _measured(self, row):
        """Return misfit and residuals of a row; waveforms by the errors known now."""
        waves = self.target.waveforms
        if waves is None or not len(row["residuals"]):
            return row["misfit"], row["residuals"]
        return waves.whitened(np.array(row["residuals"]))

    def _rows(self, points):
        """Return the rows of points (m, n), made and logged where they are not in the log."""
        points = np.atleast_2d(np.asarray(points, dtype=np.float64))
        side = self.target.batch
        jobs = [points[first : first + side] for first in range(0, len(points), side)]
        begins = self.count + side * np.arange(len(jobs))
        ready = [
            self._known(begin, job) or self._repeated(job)
            for begin, job in zip(begins, jobs, strict=True)
        ]
        if self.executor is not None:
            ready = [
                self.executor.submit(evaluate, self.target, job) if rows is None else rows
                for rows, job in zip(ready, jobs, strict=True)
            ]
        answers = []
        for begin, job, found in zip(begins, jobs, ready, strict=True):
            rows = self._numbered(begin, job, self._finished(found, job))
            self.log.add(rows[max(0, len(self.log.rows) - begin) :])
            self.count += len(job)
            self.progress("trials", self.count, max(self.budget, self.count))
            answers += rows
        return answers

    def _finished(self, found, job):
        """Return the rows of a job: known, of a future, or made here."""
        if found is None:
            return evaluate(self.target, job)
        if isinstance(found, list):
            return found
        try:
            return found.result()
        except BrokenProcessPool:
            raise SolverError(
                f"a worker was killed; {len(self.log.rows)} evaluations are kept in "
                f"{self.log.path}; the same command goes on from there"
            ) from None

    def _known(self, begin, job):
        """Return the rows of a job if all are in the log.

        A batch that a kill cut in two is made again as a whole, so its bits are the same.
        """
        rows = self.log.rows[begin : begin + len(job)]
        for row, point in zip(rows, job, strict=False):
            if row["values"] != point.tolist():
                raise InputError(
                    f"{self.log.path}: trial {row['number']} is not what this search asks for; it "
                    "had another number of runs or version; start anew with --fresh"
                )
        return rows if len(rows) == len(job) else None

    def _repeated(self, job):
        """Return the rows of a job whose points were all run before; they are not run again."""
        before = {tuple(row["values"]): row for row in self.log.rows}
        rows = [before.get(tuple(point)) for point in job.tolist()]
        if None in rows:
            return None
        kept = ("misfit", "residuals", "simulated", "error")
        again = [{name: row[name] for name in kept if name in row} for row in rows]
        return [row | {"wall_seconds": 0.0} for row in again]

    @staticmethod
    def _numbered(begin, job, rows):
        """Return rows with their numbers and values."""
        return [
            {"number": int(begin) + k, "values": point.tolist(), **row}
            for k, (point, row) in enumerate(zip(job, rows, strict=True), start=1)
        ]


def identity(target: Target, method: str, seed: int) -> dict:
    """Return what trials belong to: hash of project, records, parameters, method and seed.

    The number of runs is left out, so a search can be resumed for more.
    """
    blasts = []
    for project in target.projects:
        config = project.config.model_dump(exclude={"back_analysis", "delays"})
        files = {k: v for k, v in project.input_files.items() if k != project.path.name}
        blasts.append([json.dumps(config, sort_keys=True), files])
    parts = [[one.name, one.low, one.high, one.log] for one in target.parameters]
    about = {"method": method, "seed": seed, "misfit": target.misfit, "parameters": parts}
    if target.waveforms is not None:
        about["noise"] = target.waveforms.records.noise.variance.tolist()
    return {**about, "hash": input_hash("trials", blasts, list(target.receivers), about)}


def _number(misfit):
    """Return a misfit read from JSON."""
    return math.inf if misfit is None else float(misfit)
