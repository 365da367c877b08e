"""Means over many fine runs from a few of them and many coarse ones."""

from typing import NamedTuple

import numpy as np

from pyblast.errors import InputError

FEWEST = 5


class Mean(NamedTuple):
    """A mean and how sure it is.

    Parameters
    ----------
    mean, error : (...) float64
        In the unit of the quantity; the error is one standard deviation of the mean.
    gain : (...) float64
        How many fine runs alone would be needed for this error, over those made.
    """

    mean: np.ndarray
    error: np.ndarray
    gain: np.ndarray


def controlled_mean(fine, coarse, many) -> Mean:
    """Return the mean of a quantity of fine runs, held by the same quantity of coarse ones.

    Parameters
    ----------
    fine : (n, ...) float
        Of fine runs with random inputs.
    coarse : (n, ...) float
        Of coarse runs with the same inputs, one by one.
    many : (m, ...) float
        Of coarse runs with other inputs of the same kind.

    Raises
    ------
    InputError
        If there are fewer than 5 pairs, or lengths differ.

    Notes
    -----
    ``E f ~ mean(f - a c) + a mean_many(c)`` with the a of least variance; theory.md (9.5), (9.6).
    What the coarse mesh gets wrong does not enter, however wrong: only how well both go together.
    """
    fine, coarse, many = (np.asarray(each, dtype=float) for each in (fine, coarse, many))
    n, m = len(fine), len(many)
    if fine.shape != coarse.shape or many.shape[1:] != fine.shape[1:]:
        raise InputError(
            f"controlled_mean: fine and coarse must pair, and many be like them, got {fine.shape}, "
            f"{coarse.shape} and {many.shape}"
        )
    if n < FEWEST or m < 2:
        raise InputError(f"controlled_mean: needs {FEWEST} pairs and 2 more, got {n} and {m}")
    f, c = fine - fine.mean(axis=0), coarse - coarse.mean(axis=0)
    spread = np.sum(c * c, axis=0)
    slope = np.sum(f * c, axis=0) / np.where(spread > 0.0, spread, 1.0)
    a = slope * m / (n + m)
    mean = fine.mean(axis=0) - a * (coarse.mean(axis=0) - many.mean(axis=0))
    left = np.sum((f - a * c) ** 2, axis=0) / (n - 2)
    variance = left / n + a**2 * many.var(axis=0, ddof=1) / m
    alone = fine.var(axis=0, ddof=1) / n
    gain = np.divide(alone, variance, out=np.ones_like(alone), where=variance > 0.0)
    return Mean(mean, np.sqrt(variance), gain)
