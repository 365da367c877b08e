"""The methods of back-analysis by the names that a project file gives them."""

import numpy as np

from .adaptive_annealing import adaptive_annealing
from .annealing import paper, paper_eq15
from .evolution import evolution_search
from .levenberg import levenberg_search
from .sampling import random_search, sobol_search
from .searching import Search, Trace
from .shaping import shape_beside
from .surrogate import surrogate_search
from .trials import Trials

LAST = 3  # of so many runs one is kept for the covariance that the others taught

METHODS: dict[str, Search] = {
    "paper": paper,
    "paper_eq15": paper_eq15,
    "random": random_search,
    "sobol": sobol_search,
    "adaptive": adaptive_annealing,
    "evolution": evolution_search,
    "surrogate": surrogate_search,
    "levenberg": levenberg_search,
}


def search(trials: Trials, method: str, runs: int, seed: int) -> Trace:
    """Search by a method; waveforms in two turns.

    Of waveforms the best of the first two thirds tells how the errors of the theory look and how
    large they are. By these all that was run is judged anew, least squares goes on from the best,
    and what it finds shapes the errors by which the whole trace is judged at last.

    Parameters
    ----------
    trials : Trials
    method : str
        Of `METHODS`.
    runs, seed : int
    """
    problem = trials.problem()
    last = 0 if trials.target.waveforms is None else runs // LAST
    first = METHODS[method](problem, runs - last, seed)
    if not last or not np.isfinite(first.misfits[first.best]):
        return first
    shape_beside(trials, first.points[first.best])
    best = int(np.argmin(trials.misfits()))
    start = problem.unit(first.points[best])
    second = levenberg_search(trials.problem(), last, seed, start)
    points = np.concatenate([first.points, second.points])
    shape_beside(trials, points[int(np.argmin(trials.misfits()))])
    return Trace(
        points,
        trials.misfits(),
        np.concatenate([first.accepted, second.accepted]),
    )
