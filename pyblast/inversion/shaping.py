"""The covariance of waveforms beside a point that was run: shaped as its simulation."""

from dataclasses import replace

import numpy as np

from ..residuals.theory_errors import whitener_beside
from .mesh_errors import mesh_errors_of
from .parameters import with_values
from .trials import Trials


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
    theory.md (7.13) to (7.19), levels inferred from the residual there, the error of the mesh
    where another one can be made; else `Waveforms.mesh_doubt` says why not.
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
    white = whitener_beside(recorded, simulated, waves.noise, band, errors)
    shaped = replace(waves, whitener=white, mesh_doubt=doubt)
    trials.target = replace(target, waveforms=shaped)
