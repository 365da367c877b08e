"""Gaussian-process regression, and the search of a misfit by it."""

from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from scipy import linalg, optimize
from scipy.stats import norm

from .global_search import Evaluations, Problem, Spent, Trace, spread

LENGTHS = (0.05, 10.0)  # of the unit cube
NOISE = (1e-8, 1e-1)  # of the variance
ROOT = np.sqrt(5.0)


@dataclass(frozen=True, eq=False)
class GaussianProcess:
    """What was learnt from values at places, theory.md (12.3).

    Parameters
    ----------
    places : (m, n) float64
    lengths : (n,) float64
        Over which values are alike.
    mean, variance : float64, or (k,) where k quantities were learnt together
        Of all values.
    noise : float
        In shares of the variance.
    root : (m, m) float64
        Lower Cholesky factor of the correlations, noise included.
    weights : (m,) or (m, k) float64
        Inverse of the correlations times the values less their mean.
    """

    places: np.ndarray
    lengths: np.ndarray
    mean: np.ndarray
    variance: np.ndarray
    noise: float
    root: np.ndarray
    weights: np.ndarray

    def at(self, places) -> tuple[np.ndarray, np.ndarray]:
        """Return mean (l,) or (l, k), and what is left of the correlation, rows (m, l) to subtract.

        The variance at a place is ``variance (1 - sum rows^2)``.
        """
        shared = correlation(self.places, places, self.lengths)
        rows = linalg.solve_triangular(self.root, shared, lower=True)
        return self.mean + shared.T @ self.weights, rows


def correlation(some, others, lengths) -> np.ndarray:
    """Return Matern's correlation of order 5/2 between places (m, n) and (k, n), (m, k)."""
    distance = np.sqrt(_squares(some, others, lengths).sum(axis=-1))
    return _matern(distance)


def learn(places, values, start) -> GaussianProcess:
    """Learn lengths, noise, mean and variance from values at places: the likeliest ones.

    Parameters
    ----------
    places : (m, n) float64
        In the unit cube.
    values : (m,) or (m, k) float64
        Of one quantity, or of several that share lengths and noise.
    start : (n + 1,) float64
        Logarithms of lengths and noise to begin with, such as the `settings` of an earlier one.

    Returns
    -------
    GaussianProcess

    Notes
    -----
    theory.md (12.4); Rasmussen & Williams (2006), chapter 5.
    """
    limits = [np.log(LENGTHS)] * places.shape[1] + [np.log(NOISE)]
    found = optimize.minimize(
        _unlikelihood, start, (places, values), jac=True, method="L-BFGS-B", bounds=limits,
        options={"maxiter": 60},
    )  # fmt: skip
    lengths, noise = np.exp(found.x[:-1]), float(np.exp(found.x[-1]))
    correlated = correlation(places, places, lengths) + noise * np.eye(len(places))
    root, mean, variance, weights = _fitted(correlated, values)
    return GaussianProcess(places, lengths, mean, variance, noise, root, weights)


def settings(process) -> np.ndarray:
    """Return the logarithms of lengths and noise, from which `learn` can begin."""
    return np.log(np.append(process.lengths, process.noise))


def _unlikelihood(logs, places, values):
    """Return the negative log likelihood, mean and variance at their best, and its gradient."""
    lengths, noise, m = np.exp(logs[:-1]), np.exp(logs[-1]), len(values)
    squares = _squares(places, places, lengths)
    distance = np.sqrt(squares.sum(axis=-1))
    root, _, variance, weights = _fitted(_matern(distance) + noise * np.eye(m), values)
    inverse = linalg.cho_solve((root, True), np.eye(m))
    several = np.size(variance)
    weights = weights.reshape(m, several)
    change = 0.5 * (several * inverse - (weights / variance) @ weights.T)
    slope = 5.0 / 3.0 * (1.0 + ROOT * distance) * np.exp(-ROOT * distance)
    gradient = np.append(
        np.tensordot(change * slope, squares, ([0, 1], [0, 1])), noise * np.trace(change)
    )
    size = 0.5 * m * np.sum(np.log(variance)) + several * np.sum(np.log(np.diag(root)))
    return size, gradient


def _fitted(correlated, values):
    """Return Cholesky factor, likeliest mean and variance, and weights."""
    root = linalg.cholesky(correlated, lower=True)
    ones = linalg.cho_solve((root, True), np.ones(len(values)))
    mean = ones @ values / ones.sum()
    weights = linalg.cho_solve((root, True), values - mean)
    variance = np.maximum(np.sum((values - mean) * weights, axis=0) / len(values), 1e-300)
    return root, mean, variance, weights


def _squares(some, others, lengths):
    """Return the squared distances along each axis over its length, (m, k, n)."""
    return ((some[:, None, :] - others[None, :, :]) / lengths) ** 2


def _matern(distance):
    """Return the correlation at some distances."""
    return (1.0 + ROOT * distance + 5.0 / 3.0 * distance**2) * np.exp(-ROOT * distance)


BATCH = 8  # runs that march side by side
SPREAD = 512  # candidates all over the ranges
NEAR = 64  # candidates around the best place, for each of some distances
DISTANCES = (0.1, 0.03, 0.01, 0.003, 0.001)
LENGTH_START, NOISE_START = 0.5, 1e-4  # to begin with


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
    start = np.log(np.append(np.full(n, LENGTH_START), NOISE_START))
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
