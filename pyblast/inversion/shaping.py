"""The covariance of waveforms beside a point that was run: shaped as its simulation."""

from dataclasses import replace

import numpy as np

from ..residuals.theory_errors import whitener_beside
from .identifiability import UNIFORM
from .mesh_errors import mesh_errors_of
from .parameters import with_values
from .trials import Trials

NEAREST = 3  # runs for each unknown that tell how the motion moves with them


def shape_beside(trials: Trials, point):
    """Judge waveforms from now on by errors shaped as the simulation at a point.

    Parameters
    ----------
    trials : Trials
        Of waveforms; all that was run is judged anew.
    point : (n,) float64
        One that was run.

    Notes
    -----
    theory.md (7.13) to (7.19), levels inferred from the residual there beside what the unknowns
    may have taken on themselves, the error of the mesh where another one can be made; else
    `Waveforms.mesh_doubt` says why not.
    """
    target = trials.target
    waves, values = target.waveforms, np.asarray(point, dtype=np.float64).tolist()
    band = waves.whitener.band
    row = next(row for row in trials.log.rows if row["values"] == values)
    left = np.reshape(row["residuals"], (*waves.recorded.shape[:3], band.n_functions))
    recorded = band.restore(band.project(waves.recorded))
    simulated = recorded - band.restore(left)
    projects = [with_values(project, target.parameters, values) for project in target.projects]
    errors, doubt = mesh_errors_of(projects, simulated, waves.receivers, waves.window)
    fitted = band.restore(_moved(trials, values).reshape(-1, *left.shape))
    white = whitener_beside(recorded, simulated, waves.noise, band, errors, fitted)
    shaped = replace(waves, whitener=white, mesh_doubt=doubt)
    trials.target = replace(target, waveforms=shaped)


def _moved(trials, values):
    """Return what one standard deviation of each range moves, (n, n_data), by the runs nearby."""
    unit = trials.problem().unit
    rows = [row for row in trials.log.rows[: trials.count] if len(row["residuals"])]
    away = np.array([unit(np.array(row["values"])) for row in rows]) - unit(np.array(values))
    near = np.argsort(np.sum(away**2, axis=1), kind="stable")[: NEAREST * len(values) + 1]
    left = np.array([rows[n]["residuals"] for n in near])
    return -UNIFORM * np.linalg.lstsq(away[near], left - left[0], rcond=None)[0]
