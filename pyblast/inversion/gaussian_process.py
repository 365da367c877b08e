"""A Gaussian process: a smooth guess of what lies between points, and how sure it is."""

from dataclasses import dataclass

import numpy as np
from scipy import linalg, optimize

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
