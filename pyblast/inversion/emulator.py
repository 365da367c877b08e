"""A quick guess of whitened residuals near the best point, learnt from runs, and its doubt."""

from dataclasses import dataclass

import numpy as np
from scipy import linalg

from .gaussian_process import GaussianProcess, learn, settings

LEFT_OUT = 0.1  # rms of a residual, in standard deviations of all data, that no component holds
REACH = 4.0  # standard deviations of the points learnt from that make one length
LENGTH, NOISE = 0.5, 1e-6  # to begin with
FAR = 10.0  # excess of the sum of squares for each unknown beyond which a point counts less


@dataclass(frozen=True, eq=False)
class Emulator:
    """What residuals are at any place: a parabola in each of few components, and a process on it.

    Parameters
    ----------
    centre, scale : (n,) float64
        Of the places learnt from, in the unit cube.
    components : (q, k) float64
        Orthonormal directions that residuals move along.
    parabola : (t, q) float64
        Coefficients of 1, places and their products.
    process : GaussianProcess
        Of what the parabolas leave, all components together.
    """

    centre: np.ndarray
    scale: np.ndarray
    components: np.ndarray
    parabola: np.ndarray
    process: GaussianProcess

    def log_likelihood(self, unit) -> np.ndarray:
        """Return the logarithm of the likelihood (m,) at places (m, n), but for a constant.

        Notes
        -----
        theory.md (12.10): its own doubt adds to the unit variance of each component.
        """
        near = (np.asarray(unit) - self.centre) / self.scale
        mean, rows = self.process.at(near)
        left = np.maximum(1.0 - np.sum(rows**2, axis=0), 0.0)
        variance = 1.0 + left[:, None] * self.process.variance
        scores = _terms(near) @ self.parabola + mean
        return -0.5 * np.sum(scores**2 / variance + np.log(variance), axis=1)


def emulate(places, residuals, start=None) -> Emulator:
    """Learn residuals (m, k) at places (m, n) of the unit cube.

    Parameters
    ----------
    places : (m, n) float64
    residuals : (m, k) float64
        Whitened, of unit variance each where the theory is right.
    start : Emulator, optional
        An earlier one, whose lengths are a beginning.

    Notes
    -----
    theory.md (12.9).
    """
    m, n = places.shape
    centre = places.mean(axis=0)
    scale = REACH * np.maximum(places.std(axis=0), 1e-6)
    near = (places - centre) / scale
    _, size, turned = linalg.svd(residuals, full_matrices=False)
    beyond = np.sqrt(np.cumsum(size[::-1] ** 2)[::-1] / m)
    components = turned[: max(1, int(np.count_nonzero(beyond > LEFT_OUT)))]
    scores, squares = residuals @ components.T, np.sum(residuals**2, axis=1)
    weight = 1.0 / np.sqrt(1.0 + (squares - squares.min()) / (FAR * n))
    terms = _terms(near)
    parabola = linalg.lstsq(terms * weight[:, None], scores * weight[:, None])[0]
    logs = np.log([LENGTH] * n + [NOISE]) if start is None else settings(start.process)
    process = learn(near, scores - terms @ parabola, logs)
    return Emulator(centre, scale, components, parabola, process)


def n_terms(n):
    """Return the number of coefficients of a parabola of n unknowns."""
    return (n + 1) * (n + 2) // 2


def _terms(near):
    """Return 1, the coordinates and their products at places (m, n), (m, t)."""
    rows, columns = np.triu_indices(near.shape[1])
    return np.hstack([np.ones((len(near), 1)), near, near[:, rows] * near[:, columns]])
