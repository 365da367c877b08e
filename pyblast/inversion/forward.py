"""From values of the unknowns to seismograms and their misfit, eight models side by side."""

import math
import time
from dataclasses import dataclass

import numpy as np

from ..errors import SolverError
from ..motion.seismogram import Seismogram
from ..motion.spectra import dominant_frequency
from ..projects.project import Project
from ..solving.assembly import time_step
from ..solving.batches import run_many
from ..solving.kernels import LANES
from ..units import split_key
from .misfits import misfit_to
from .parameters import Parameter, with_values
from .waveforms import Waveforms

# Larger values of these never allow a longer time step, and no other key matters to it.
HELD = {"kn", "ks", "cohesion", "friction", "tension", "ratio"}
WORTH_HOLDING = 0.5  # share of the longest step in the ranges


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


def held_step(project: Project, parameters):
    """Return the time step, with its limit, that all models of the ranges can march in.

    With it the answer to a point does not depend on those that march beside it. None where models
    differ in more than stiffness, strength and damping, or where the shortest step would be half
    of the longest or less: lagged damping.
    """
    stems = {split_key(parameter.path.split(".")[-1])[0] for parameter in parameters}
    if not (stems <= HELD and all(parameter.is_cheap for parameter in parameters)):
        return None
    project.model  # noqa: B018  variants stand on the mesh of a model that is there
    ends = np.array([[one.low, one.high] for one in parameters])
    shortest = time_step(with_values(project, parameters, ends[:, 1]).model)
    longest = time_step(with_values(project, parameters, ends[:, 0]).model)
    return shortest if shortest[0] > WORTH_HOLDING * longest[0] else None


def simulate(project: Project, parameters, points, step=None) -> list[dict[str, Seismogram]]:
    """Return the seismograms of a project at points (m, n) by receiver, 0 s at the first firing.

    Raises
    ------
    SolverError
        If a model can't be run.
    """
    varied = [with_values(project, parameters, point) for point in points]
    if step is not None:
        runs = run_many([one.model for one in varied], project.duration, step=step)
    else:
        runs = [run_many([one.model], one.duration)[0] for one in varied]
    return [
        {name: s.shifted(-one.lead) for name, s in run.seismograms.items()}
        for one, run in zip(varied, runs, strict=True)
    ]


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
        return target.waveforms.worth(residuals)[0], residuals
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
