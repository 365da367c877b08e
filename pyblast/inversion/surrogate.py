"""Search by a Gaussian process that guesses the misfit and says where to look next."""

from contextlib import suppress

import numpy as np
from scipy.stats import norm

from .evaluations import Evaluations, Spent
from .gaussian_process import correlation, learn, settings
from .sampling import spread
from .searching import Problem, Trace

BATCH = 8  # runs that march side by side
SPREAD = 512  # candidates all over the ranges
NEAR = 64  # candidates around the best place, for each of some distances
DISTANCES = (0.1, 0.03, 0.01, 0.003, 0.001)
LENGTH, NOISE = 0.5, 1e-4  # to begin with


def surrogate_search(problem: Problem, budget: int, seed: int) -> Trace:
    """Search where a Gaussian process of the logarithm of the misfit expects improvement.

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
    theory.md (12.3) to (12.6). Batches of eight: each place is chosen as if those before it had
    been found to be as good as the best (Ginsbourger et al. 2010).
    """
    kept, rng = Evaluations(problem, budget), np.random.default_rng(seed)
    n = problem.n_parameters
    places = spread(n, BATCH, rng)
    start = np.log(np.append(np.full(n, LENGTH), NOISE))
    with suppress(Spent):
        kept.at(places)
        while True:
            values = _levelled(np.array(kept.misfits))
            process = learn(places, values, start)
            start = settings(process)
            chosen = _batch(process, values, _candidates(places[np.argmin(values)], rng))
            places = np.vstack([places, chosen])
            kept.at(chosen)
    return kept.trace()


def _levelled(misfits):
    """Return logarithms of misfits over their median; infinite ones become the worst."""
    finite = misfits[np.isfinite(misfits)]
    if not len(finite) or np.median(finite) <= 0.0:
        return np.zeros(len(misfits))
    shares = np.minimum(misfits, finite.max()) / np.median(finite)
    return np.log(np.maximum(shares, 1e-12))


def _candidates(best, rng):
    """Return places to choose from: all over the unit cube, and ever nearer to the best one."""
    n = len(best)
    steps = np.repeat(DISTANCES, NEAR)[:, None] * rng.standard_normal((NEAR * len(DISTANCES), n))
    return np.vstack([spread(n, SPREAD, rng), np.clip(best + steps, 0.0, 1.0)])


def _batch(process, values, candidates):
    """Choose places one after the other, each knowing of those before."""
    lie, chosen = values.min(), []
    mean, rows = process.at(candidates)
    for _ in range(BATCH):
        left = np.maximum(1.0 - np.sum(rows**2, axis=0), 1e-12)
        worth = _improvement(lie, mean, np.sqrt(process.variance * left))
        k = int(np.argmax(worth))
        chosen.append(candidates[k])
        shared = correlation(candidates[k : k + 1], candidates, process.lengths)[0]
        row = (shared - rows[:, k] @ rows) / np.sqrt(left[k] + process.noise)
        mean = mean + row * (lie - mean[k]) / np.sqrt(left[k] + process.noise)
        rows = np.vstack([rows, row])
    return np.array(chosen)


def _improvement(best, mean, deviation):
    """Return the improvement on the best that is expected, theory.md (12.6)."""
    z = (best - mean) / deviation
    return deviation * (z * norm.cdf(z) + norm.pdf(z))
