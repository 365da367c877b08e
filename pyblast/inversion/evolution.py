"""Differential evolution: populations whose members are evaluated side by side."""

from contextlib import suppress

import numpy as np
from scipy.optimize import differential_evolution

from .evaluations import Evaluations, Spent
from .sampling import spread
from .searching import Problem, Trace

POPULATION = 16  # two batches of eight
GENERATIONS = 10**6  # more than any budget


def evolution_search(problem: Problem, budget: int, seed: int) -> Trace:
    """Search by scipy's differential evolution, from a Sobol sequence, without polishing.

    Parameters
    ----------
    problem : Problem
    budget : int
    seed : int

    Returns
    -------
    Trace
        That of a smaller budget is its beginning.

    Notes
    -----
    Storn & Price (1997); each generation is evaluated at once (updating deferred).
    """
    kept, n = Evaluations(problem, budget), problem.n_parameters
    with suppress(Spent):
        while True:
            rng = np.random.default_rng([seed, budget - kept.left])
            differential_evolution(
                lambda unit: kept.at(unit.T), [(0.0, 1.0)] * n, init=spread(n, POPULATION, rng),
                rng=rng, maxiter=GENERATIONS, tol=0.0, polish=False, updating="deferred",
                vectorized=True,
            )  # fmt: skip
    return kept.trace()
