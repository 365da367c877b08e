"""Location of a residual: where in the ground secondary sources explain it, and how well."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import linalg
from scipy.special import logsumexp

from .error_model import Change, ErrorModel

FREE = (0.01, 0.03, 0.1)  # the same, of each cell, where all cells are free; one for all
TOGETHER = 64  # bodies that are scored at once, for the memory they need
DIRECTIONS = 300  # of unrestricted changes, at most
LEAST = 1e-6  # of the energy of the largest direction, below which another one is left out
KNOWN = 2.6  # edges of a cell, nearer than which no place is known: 1.5 diagonals
HELD = 0.9  # probability of the volume that is given


@dataclass(frozen=True, eq=False)
class Places:
    """Places: cells of rock or patches of joints, with the change of motion by their properties.

    Parameters
    ----------
    centres : (n, 3) float64, m
    sizes : (n,) float64, m3 or m2
    shapes : (n, n_kinds, n_blasts, n_receivers, 3, n_functions) float32, m/s
        In the band: change by one unit of the logarithm of each property.
    names : tuple of n str
        Joint of each patch; empty for rock.
    """

    centres: np.ndarray
    sizes: np.ndarray
    shapes: np.ndarray
    names: tuple[str, ...] = ()

    def around(self, places: np.ndarray, reach: float) -> np.ndarray:
        """Return the changes of motion by bodies at places (n, 3) in m, (n, n_kinds, ...).

        Their changes of properties fall as a Gaussian of a reach in m.
        """
        apart = np.linalg.norm(places[:, None] - self.centres, axis=2)
        weight = np.exp(-0.5 * (apart / reach) ** 2).astype(np.float32)
        return np.tensordot(weight, self.shapes, 1)

    def spread(self, reach: float) -> "Places":
        """Return bodies of a reach in m around the centres."""
        return replace(self, shapes=self.around(self.centres, reach))


@dataclass(frozen=True, eq=False)
class Located:
    """Location of a residual.

    Parameters
    ----------
    places : Places
    log_bayes : (n,) float64
        Of a change at each place over none; it pays for its degrees of freedom.
    strength : (n, n_kinds) float64
        Most probable logarithms of the properties at each place.
    blasts : int
        Number of blasts, which count as one: theory.md (14.8).
    """

    places: Places
    log_bayes: np.ndarray
    strength: np.ndarray
    blasts: int

    @property
    def best(self) -> int:
        """The most probable place."""
        return int(np.argmax(self.log_bayes))

    @property
    def score(self) -> float:
        """Log Bayes factor of a change anywhere, at a place drawn by its size."""
        share = self.places.sizes / self.places.sizes.sum()
        return float(logsumexp(self.log_bayes, b=share))

    @cached_property
    def probability(self) -> np.ndarray:
        """Probability of each place, (n,), if the change is at one of them."""
        weight = np.log(self.places.sizes) + self.log_bayes / self.blasts
        return np.exp(weight - logsumexp(weight))

    @cached_property
    def held(self) -> np.ndarray:
        """The fewest places, by probability, that together hold `HELD`, best first."""
        order = np.argsort(-self.probability / self.places.sizes, kind="stable")
        return order[: int(np.searchsorted(np.cumsum(self.probability[order]), HELD)) + 1]

    @property
    def volume(self) -> float:
        """Size of these places, m3 or m2."""
        return float(self.places.sizes[self.held].sum())

    def within(self, least: float) -> float:
        """Return the distance from the best place in m that holds `HELD`.

        Not less than a distance in m, nor than 1.5 diagonals of a cube of the size of the place:
        one diagonal held six of nine bodies of ``verification/located.json``.
        """
        apart = np.linalg.norm(self.places.centres - self.places.centres[self.best], axis=1)
        order = np.argsort(apart, kind="stable")
        last = np.searchsorted(np.cumsum(self.probability[order]), HELD)
        far = apart[order[min(int(last), len(order) - 1)]]
        cube = self.places.sizes[self.best] ** (1.0 / (2 if self.places.names else 3))
        return float(max(far, least, KNOWN * cube))


def located(error: ErrorModel, places: Places, residual: np.ndarray, prior: float) -> Located:
    """Locate a residual by the change of properties at each place alone.

    Parameters
    ----------
    error : ErrorModel
    places : Places
    residual : (n_blasts, n_receivers, 3, n_functions) float64, m/s
        In the band.
    prior : float
        Standard deviation of the logarithms of the properties.

    Notes
    -----
    Theory.md (14.14).
    """
    bayes, strength = [], []
    for first in range(0, len(places.shapes), TOGETHER):
        part = prior * places.shapes[first : first + TOGETHER].astype(float)
        scores = error.scores(residual[None], [Change(shapes) for shapes in part])
        bayes.append(scores.log_bayes[:, 0])
        strength += [prior * own[:, 0] for own in scores.strength]
    kinds = places.shapes.shape[1]
    return Located(
        places, np.concatenate([np.zeros(0), *bayes]), np.reshape(strength, (-1, kinds)),
        residual.shape[0],
    )  # fmt: skip


def unrestricted(
    error: ErrorModel, everywhere: Sequence[tuple[Places, float]], residual: np.ndarray
) -> float:
    """Return the log Bayes factor of changes at all places at once over none.

    Parameters
    ----------
    error : ErrorModel
    everywhere : sequence of (Places, float)
        Places, and the standard deviation of their properties over that of the first.
    residual : (n_blasts, n_receivers, 3, n_functions) float64, m/s
        In the band.

    Notes
    -----
    Theory.md (14.15). One variance is common to all cells, and averaged over `FREE`.
    """
    changes = directions_of(everywhere, residual)
    scores = error.scores(residual[None], [Change(sigma * changes) for sigma in FREE])
    return float(logsumexp(scores.log_bayes[:, 0]) - np.log(len(FREE)))


def directions_of(everywhere: Sequence[tuple[Places, float]], residual: np.ndarray) -> np.ndarray:
    """Return few changes (n, ...) of the same covariance as those of all places; as `unrestricted`.

    The largest, each channel in units of its own residual.
    """
    rows = np.concatenate([
        scale * places.shapes.reshape(-1, *residual.shape) for places, scale in everywhere
    ])  # fmt: skip
    unit = np.sqrt(np.sum(residual**2, axis=-1, keepdims=True))
    unit = np.where(unit > 0.0, unit, np.inf)
    flat = (rows / unit).reshape(len(rows), -1)
    if len(flat) < flat.shape[1]:
        square, turn = linalg.eigh(flat @ flat.T)
        along = turn.T @ flat
    else:
        square, turn = linalg.eigh(flat.T @ flat)
        along = turn.T * np.sqrt(np.maximum(square, 0.0))[:, None]
    chosen = np.flatnonzero(square > LEAST * square[-1])[-DIRECTIONS:]
    scale = np.where(np.isfinite(unit), unit, 0.0)
    return along[chosen].reshape(-1, *residual.shape) * scale
