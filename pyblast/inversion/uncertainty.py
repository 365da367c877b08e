"""How sure a project's unknowns are: errors of the theory beside the best point, then draws."""

from dataclasses import replace

import numpy as np

from ..errors import InputError, PyblastError
from ..projects.variants import vary
from ..residuals.nuisances import mesh_error
from ..residuals.theory_errors import whitener_beside
from .chains import emcee_library
from .forward import simulate
from .levenberg import levenberg_search
from .posterior import Posterior, posterior
from .trials import Trials
from .waveforms import gathered

COARSER = 1.5  # edges of the mesh that tells the error of the model's
TURNS, RUNS = 2, 24  # searches, each from the last best, before draws begin


def refuse_unready(table, where):
    """Refuse a posterior that could not be drawn, before anything is run.

    Raises
    ------
    InputError
        If the misfit has no covariance, or emcee is not installed.
    """
    if not table.posterior:
        return
    if table.misfit != "waveform":
        raise InputError(
            f"{where}.posterior: needs misfit 'waveform', whose residuals have a covariance, got "
            f"{table.misfit!r}"
        )
    emcee_library()


def uncertain(trials: Trials, best, seed: int) -> Posterior:
    """Draw from the posterior of a project's unknowns with full runs, all of them logged.

    Parameters
    ----------
    trials : Trials
        Of a search by waveforms that is done; its covariance becomes that beside the best point.
    best : (n,) float64
        A point that was run.
    seed : int

    Returns
    -------
    Posterior

    Raises
    ------
    SolverError
        If too few points could be run, or a worker was lost.

    Notes
    -----
    theory.md (12.9) to (12.12). The covariance is shaped by the best point, whose search goes on
    with it, twice. The error of the mesh is foreseen where `coarser_edges` can make another one.
    """
    errors = [coarser_edges(trials.target, best)]
    errors = [one for one in errors if one is not None]
    for _ in range(TURNS):
        waves = trials.target.waveforms
        recorded, simulated = _within(trials, best)
        errors_here = [mesh_error(simulated, coarse, COARSER) for coarse in errors]
        white = whitener_beside(recorded, simulated, waves.noise, waves.whitener.band, errors_here)
        trials.target = replace(trials.target, waveforms=replace(waves, whitener=white))
        problem = trials.problem()
        trace = levenberg_search(problem, RUNS, seed, problem.unit(best))
        best = trace.points[trace.best]
    return posterior(trials.problem(), best, seed)


def coarser_edges(target, best):
    """Return the motion at a point on meshes with longer edges, None where they can't be made.

    Returns
    -------
    (n_blasts, n_receivers, 3, n_samples) float64, m/s
    """
    waves, found = target.waveforms, []
    for project in target.projects:
        edge = project.config.mesh.edge_m
        if edge is None:
            return None
        values = {one.path: value for one, value in zip(target.parameters, best, strict=True)}
        try:
            varied = vary(project, {**values, "mesh.edge_m": COARSER * edge})
            found.append(simulate(varied, (), [()])[0])
        except PyblastError:
            return None
    return gathered(found, waves.receivers, waves.window)


def _within(trials, best):
    """Return records and the simulation of a point that was run, both within the band."""
    waves, values = trials.target.waveforms, np.asarray(best).tolist()
    band = waves.whitener.band
    rows = [row for row in trials.log.rows if row["values"] == values]
    left = np.reshape(rows[0]["residuals"], (*waves.recorded.shape[:3], band.n_functions))
    recorded = band.restore(band.project(waves.recorded))
    return recorded, recorded - band.restore(left)
