"""How sure a project's unknowns are: errors of the theory beside the best point, then draws."""

from dataclasses import replace

from ..errors import InputError
from .chains import emcee_library
from .levenberg import levenberg_search
from .posterior import Posterior, posterior
from .shaping import shape_beside
from .trials import Trials

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
    with it, twice. Where the error of the mesh could not be foreseen, the result says so.
    """
    for _ in range(TURNS):
        shape_beside(trials, best)
        problem = trials.problem()
        trace = levenberg_search(problem, RUNS, seed, problem.unit(best))
        best = trace.points[trace.best]
    drawn = posterior(trials.problem(), best, seed)
    return replace(drawn, mesh_doubt=trials.target.waveforms.mesh_doubt)
