"""Trials of a back-analysis: simulations with trial values, their misfits, and their log."""

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

from ..core import BATCH_SIZE
from ..errors import InputError, LostProcessError, ReadError, SolverError
from ..files import plain
from ..inference.misfits import SIGNED, misfit_to
from ..inference.parameter import Parameter, Problem, problem_of, set_all
from ..inference.records import Records
from ..project.project import Project
from ..runs.parallel import input_hash, lost_process
from ..signals.seismogram import Seismogram
from ..signals.spectra import dominant_frequency
from ..simulation.simulation import in_batches
from .parameters import chosen_records
from .waveforms import remaining, sampled_motion


@dataclass(frozen=True, eq=False)
class Target:
    """Target of a search: blasts with their records, parameters of the ground, misfit.

    Parameters
    ----------
    projects : tuple of Project
        One for each blast, with its records.
    parameters : tuple of Parameter
    receivers : tuple of str
        Whose records are used; all that have one if empty.
    misfit : str
        Of `MISFITS`.
    steps : tuple
        For each project the common time step of all its models, None where each has its own.
    unused : dict of str to str
        Why other records, or channels of them, are not used.
    records : Records, optional
        The data of misfit ``waveform``.
    """

    projects: tuple[Project, ...]
    parameters: tuple[Parameter, ...]
    receivers: tuple[str, ...]
    misfit: str
    steps: tuple
    unused: dict[str, str]
    records: Records | None = None

    @property
    def batch(self) -> int:
        """Number of points in one batch of runs."""
        return BATCH_SIZE if all(self.steps) else 1

    def recorded(self, project) -> dict[str, Seismogram]:
        """Return the records of a project that are used."""
        return chosen_records(project, self.receivers)


def evaluate(target: Target, points) -> list[dict]:
    """Simulate points (m, n) and return their misfits, as rows of the log.

    Returns
    -------
    list of dict
        ``misfit``, infinite where a run failed, with the reason in ``error``; its ``residuals``,
        none where a run failed or the misfit has none;
        ``simulated`` with ``ppv`` in m/s and ``frequency`` in Hz by blast and receiver;
        ``wall_seconds``.
    """
    began = time.perf_counter()
    try:
        simulated = [
            in_batches([set_all(project, target.parameters, each) for each in points], step)
            for project, step in zip(target.projects, target.steps, strict=True)
        ]
    except SolverError as error:
        if len(points) > 1:  # run each alone: only one of them fails
            return [row for point in points for row in evaluate(target, point[None])]
        failed = _row((math.inf, np.zeros(0)), {}, time.perf_counter() - began)
        return [failed | {"error": str(error)}]
    seconds = (time.perf_counter() - began) / len(points)
    return [
        _row(misfit_of(target, motions), _numbers(target, motions), seconds)
        for motions in zip(*simulated, strict=True)
    ]


def misfit_of(target: Target, motions) -> tuple[float, np.ndarray]:
    """Return the mean misfit over blasts and receivers of simulated motions, one dict a blast.

    Also the residuals of all of them, (n,), none where the misfit has none. Of waveforms it is the
    share of the energy of the records that is not explained.
    """
    records = target.records
    if records is not None:
        motion = sampled_motion(motions, records.receivers, records)
        return remaining(records, motion), np.zeros(0)
    misfits, residuals = zip(
        *(
            misfit_to(target.misfit, record, simulated[name], project.compared_band)
            for project, simulated in zip(target.projects, motions, strict=True)
            for name, record in target.recorded(project).items()
        ),
        strict=True,
    )
    return float(np.mean(misfits)), np.concatenate(residuals)


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
    """Log of trials in JSON lines: the identity of the search, then one line for each trial.

    Parameters
    ----------
    path : path
    identity : dict
        Identity of the search; ``hash`` must agree when it is resumed.
    resume : bool
        Whether to read an existing file. An incomplete last line is cut off.

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
        """Append rows and flush them to the disk."""
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
            identity_read = head["hash"], head["kind"]
            rows = [{**row, "misfit": _number(row["misfit"])} for row in rows]
            numbers = [row["number"] for row in rows]
        except (ValueError, KeyError, TypeError):
            raise ReadError(f"{self.path}: is no log of trials; give another folder") from None
        if numbers != list(range(1, len(rows) + 1)):
            raise ReadError(f"{self.path}: its trials are not numbered from 1; lines are missing")
        if identity_read != (identity["hash"], KIND):
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
        Expected evaluations, for the progress.
    executor : concurrent.futures.Executor, optional
        None evaluates in this process, one batch after the other.
    progress : callable, optional
        Called with ("trials", done, total).
    """

    def __init__(self, target: Target, trial_log: TrialLog, budget: int, *,
                 executor: Executor | None = None, progress: Callable | None = None):  # fmt: skip
        self.target, self.log, self.budget = target, trial_log, budget
        self.executor, self.progress = executor, progress or (lambda *_: None)
        self.count = 0

    def problem(self) -> Problem:
        """Return the search problem of the target."""
        vectors = self.vectors if self.target.misfit in SIGNED else None
        return problem_of(self.target.parameters, self, vectors)

    def __call__(self, points) -> np.ndarray:
        """Return the misfits (m,) of points (m, n), from the log or from runs."""
        return np.array([row["misfit"] for row in self._rows(points)])

    def vectors(self, points) -> tuple[np.ndarray, np.ndarray]:
        """Return misfits (m,) and residuals (m, k), infinite where a run failed."""
        rows = self._rows(points)
        failed = np.full(max(1, *(len(row["residuals"]) for row in self.log.rows)), math.inf)
        vectors = [row["residuals"] for row in rows]
        residuals = np.array([vector if len(vector) else failed for vector in vectors])
        return np.array([row["misfit"] for row in rows]), residuals

    def _rows(self, points):
        """Return the rows of points (m, n), evaluated and logged if they are not in the log."""
        points = np.atleast_2d(np.asarray(points, dtype=np.float64))
        side = self.target.batch
        jobs = [points[first : first + side] for first in range(0, len(points), side)]
        begins = self.count + side * np.arange(len(jobs))
        ready = [self._known(begin, job) for begin, job in zip(begins, jobs, strict=True)]
        if self.executor is not None:
            ready = [
                self.executor.submit(evaluate, self.target, job) if rows is None else rows
                for rows, job in zip(ready, jobs, strict=True)
            ]
        answers = []
        for begin, job, state in zip(begins, jobs, ready, strict=True):
            rows = self._numbered(begin, job, self._finished(state, job))
            self.log.add(rows[max(0, len(self.log.rows) - begin) :])
            self.count += len(job)
            self.progress("trials", self.count, max(self.budget, self.count))
            answers += rows
        return answers

    def _finished(self, state, job):
        """Return the rows of a job: known, of a future, or evaluated in this process."""
        if state is None:
            return evaluate(self.target, job)
        if isinstance(state, list):
            return state
        try:
            return state.result()
        except BrokenProcessPool:
            lost = lost_process(self.executor)
            raise LostProcessError(
                f"{lost}; {len(self.log.rows)} evaluations are kept in {self.log.path}"
            ) from None

    def _known(self, begin, job):
        """Return the rows of a job if all are in the log.

        An incomplete batch is evaluated again as a whole, so its bits are the same.
        """
        rows = self.log.rows[begin : begin + len(job)]
        for row, point in zip(rows, job, strict=False):
            if row["values"] != point.tolist():
                raise InputError(
                    f"{self.log.path}: trial {row['number']} is not the next one of this search, "
                    "which had another number of runs or version; start anew with --fresh"
                )
        return rows if len(rows) == len(job) else None

    @staticmethod
    def _numbered(begin, job, rows):
        """Return rows with their numbers and values."""
        return [
            {"number": int(begin) + k, "values": point.tolist(), **row}
            for k, (point, row) in enumerate(zip(job, rows, strict=True), start=1)
        ]


def identity(target: Target, method: str, seed: int) -> dict:
    """Return the identity of a search: hash of project, records, parameters, method and seed.

    The number of runs is left out, so a search can be resumed with more.
    """
    blasts = []
    for project in target.projects:
        config = project.config.model_dump(exclude={"back_analysis", "delays"})
        files = {k: v for k, v in project.input_files.items() if k != project.path.name}
        blasts.append([json.dumps(config, sort_keys=True), files])
    parts = [[row.name, row.low, row.high, row.log] for row in target.parameters]
    about = {"method": method, "seed": seed, "misfit": target.misfit, "parameters": parts}
    if target.records is not None:
        about["noise"] = target.records.noise.variance.tolist()
    return {**about, "hash": input_hash("trials", blasts, list(target.receivers), about)}


def _number(misfit):
    """Return a misfit read from JSON."""
    return math.inf if misfit is None else float(misfit)
