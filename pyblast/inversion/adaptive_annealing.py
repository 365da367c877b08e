"""Annealing that sets its own temperature and steps, and starts again where it is stuck."""

import math
from contextlib import suppress

import numpy as np

from .evaluations import Evaluations, Spent
from .sampling import spread
from .searching import Problem, Trace

FIRST = 8  # evenly spread places, one batch; the best of them is the start
STEP = 0.2  # of each range, at first
SHARE = 0.2  # of steps that are accepted while the step is kept
GROWTH = 1.5  # of the step by one that is accepted
HEAT = 0.5  # temperature over the usual drop of the misfit, at first
COOLING = 0.9  # of the temperature by each evaluation
SMALLEST = 1e-3  # step at which a chain ends


def adaptive_annealing(problem: Problem, budget: int, seed: int) -> Trace:
    """Search by Metropolis steps whose size keeps one in five accepted.

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
    The temperature starts at half the median distance of the first misfits to their least, so
    that it suits misfits of any size; a step grows or shrinks by what is accepted (Rechenberg's
    rule). A chain ends when its step is small; the next starts at a random place.
    """
    kept, rng = Evaluations(problem, budget), np.random.default_rng(seed)
    kept.steps = set()
    with suppress(Spent):
        places = spread(problem.n_parameters, FIRST, rng)
        misfits = kept.at(places)
        finite = misfits[np.isfinite(misfits)]
        heat = HEAT * float(np.median(finite) - finite.min()) if len(finite) else 0.0
        start = int(np.argmin(misfits))
        kept.steps.add(start)
        _chain(kept, rng, places[start], misfits[start], heat)
        while True:
            place = rng.random(problem.n_parameters)
            misfit = kept.at(place[None])[0]
            kept.steps.add(len(kept.misfits) - 1)
            _chain(kept, rng, place, misfit, heat)
    return kept.trace()


def _chain(kept, rng, place, misfit, temperature):
    """March one chain until its step is small."""
    step = STEP
    while step > SMALLEST:
        trial = _mirrored(place + step * rng.standard_normal(len(place)))
        found = kept.at(trial[None])[0]
        rise = found - misfit
        if rise <= 0.0 or (temperature > 0.0 and rng.random() < math.exp(-rise / temperature)):
            kept.steps.add(len(kept.misfits) - 1)
            place, misfit = trial, found
            step = min(STEP, step * GROWTH)
        else:
            step *= GROWTH ** (-SHARE / (1.0 - SHARE))
        temperature *= COOLING


def _mirrored(place):
    """Return a place mirrored at the faces of the unit cube."""
    return 1.0 - np.abs(1.0 - np.mod(place, 2.0))
