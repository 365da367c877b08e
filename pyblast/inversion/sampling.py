"""Searches that learn nothing: random places, the bar for all others, and evenly spread ones."""

import math

import numpy as np
from scipy.stats import qmc

from .evaluations import Evaluations
from .searching import Problem, Trace


def random_search(problem: Problem, budget: int, seed: int) -> Trace:
    """Evaluate random places, even over the ranges.

    Parameters
    ----------
    problem : Problem
    budget : int
    seed : int

    Returns
    -------
    Trace
        That of a smaller budget is its beginning.
    """
    kept = Evaluations(problem, budget)
    kept.at(np.random.default_rng(seed).random((budget, problem.n_parameters)))
    return kept.trace()


def sobol_search(problem: Problem, budget: int, seed: int) -> Trace:
    """Evaluate a scrambled Sobol sequence; parameters and result as `random_search`."""
    kept = Evaluations(problem, budget)
    kept.at(spread(problem.n_parameters, budget, seed))
    return kept.trace()


def spread(n_parameters, count, seed) -> np.ndarray:
    """Return evenly spread places (count, n_parameters): a scrambled Sobol sequence.

    The first places of a longer sequence are those of a shorter one, which Latin hypercubes do
    not give.
    """
    sobol = qmc.Sobol(n_parameters, rng=np.random.default_rng(seed))
    return sobol.random(2 ** math.ceil(math.log2(max(2, count))))[:count]
