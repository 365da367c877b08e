"""How large the errors of the theory are: levels inferred from the residual itself."""

import math
from typing import NamedTuple

import numpy as np
from scipy import linalg, optimize

from ..errors import InputError
from .whitening import LEVELS, SCATTER, Whitener

NORMAL_95 = 1.6448536269514722
FARTHEST = 12.0
STEP = 1e-3


class Prior(NamedTuple):
    """What is known of a level before the residual is looked at.

    Parameters
    ----------
    level : float
        Standard deviation, in the unit of its group.
    weight : float
        How many observed errors that knowledge is worth. The square of the level has the
        inverse-gamma density of shape ``weight / 2`` and scale ``weight level^2 / 2``.
    """

    level: float
    weight: float


WEIGHT = 4.0
PRIORS = {group: Prior(level, WEIGHT) for group, level in LEVELS.items()}


class Levels(NamedTuple):
    """Inferred levels.

    Parameters
    ----------
    whitener : Whitener
        With the most probable levels.
    intervals : dict of str to (low, high)
        Of 90 %, from the curvature in the logarithm of each level.
    converged : bool
    """

    whitener: Whitener
    intervals: dict[str, tuple[float, float]]
    converged: bool


def infer_levels(whitener: Whitener, residual, priors=None, fitted=()) -> Levels:
    """Find the levels of nuisances and scattering that make a residual most probable.

    Parameters
    ----------
    whitener : Whitener
        Its levels do not matter, only its groups.
    residual : (n_blasts, n_receivers, 3, n_samples) float, m/s
    priors : dict of str to Prior, optional
        Instead of those of ``PRIORS``: 1 ms, 5 % and 0.05 rad, 10 % scattered, each worth four
        observations.
    fitted : (n, n_blasts, n_receivers, 3, n_samples) float, m/s, optional
        What each unknown that was fitted to these records moves, by one standard deviation of what
        was known of it: so much of the errors it may have taken on itself.

    Raises
    ------
    InputError
        If a group has no prior, or one that is not positive.

    Notes
    -----
    Largest marginal likelihood times inverse-gamma priors, in the logarithm of the levels, by its
    derivatives. Where they vanish, the scores of each group have the sum of squares that their
    covariance foresees, but for the prior; theory.md (7.18), (7.19). Fitted unknowns count as
    nuisances of level one, which makes the likelihood a restricted one.
    """
    priors = {**PRIORS, **(priors or {})}
    names = list(whitener.levels)
    for name in names:
        if name not in priors or not min(priors[name]) > 0.0:
            raise InputError(f"infer_levels.priors.{name}: needs a positive level and weight")
    if not names:
        return Levels(whitener, {}, True)
    members = np.array([names.index(group) for group in whitener.groups], dtype=int)
    turned = whitener.turned(residual)
    taken = np.array([whitener.turned(one) for one in fitted]).reshape(-1, len(turned))
    weight, prior = np.array([(priors[n].weight, priors[n].level ** 2) for n in names]).T

    def cost(log_variance):
        value, slope = _evidence(whitener, turned, taken, members, names, log_variance)
        pull = prior / np.exp(log_variance)
        value -= 0.5 * np.sum(weight * (log_variance + pull))
        return -value, -(slope - 0.5 * weight * (1.0 - pull))

    start = np.log(prior)
    bounds = [(each - FARTHEST, each + FARTHEST) for each in start]
    best = optimize.minimize(cost, start, jac=True, method="L-BFGS-B", bounds=bounds)
    curvature = np.empty((len(names), len(names)))
    for n, step in enumerate(STEP * np.eye(len(names))):
        curvature[n] = (cost(best.x + step)[1] - cost(best.x - step)[1]) / (2.0 * STEP)
    value, vector = linalg.eigh(0.5 * (curvature + curvature.T))
    spread = np.sqrt(np.diag((vector / np.maximum(value, 1e-3)) @ vector.T))
    found = dict(zip(names, map(float, np.exp(0.5 * best.x)), strict=True))
    reach = map(float, np.exp(0.5 * NORMAL_95 * spread))
    intervals = {
        n: (level / r, level * r) for (n, level), r in zip(found.items(), reach, strict=True)
    }
    return Levels(whitener.with_levels(**found), intervals, bool(best.success))


def _evidence(whitener, turned, taken, members, names, log_variance):
    """Return the log likelihood, but for a constant, and its slopes by log variances."""
    variance = np.exp(log_variance)
    scatter = variance[names.index(SCATTER)] if SCATTER in names else 0.0
    scattered = scatter * whitener.spread.ravel()
    deviation = np.sqrt(1.0 + scattered)
    plain = turned / deviation
    columns = np.vstack([whitener.columns * np.sqrt(variance[members])[:, None], taken])
    columns = columns / deviation
    factor = linalg.cholesky(np.eye(len(columns)) + columns @ columns.T, lower=True)
    half = linalg.solve_triangular(factor, columns, lower=True)
    along = half @ plain
    inverse = linalg.solve_triangular(factor, np.eye(len(columns)), lower=True)
    scores = inverse.T @ along
    value = -0.5 * (plain @ plain - along @ along) - np.sum(np.log(np.diag(factor)))
    value -= np.sum(np.log(deviation))
    excess = scores**2 - 1.0 + np.sum(inverse**2, axis=0)
    slope = 0.5 * np.bincount(members, excess[: len(members)], minlength=len(names))
    if SCATTER in names:
        left = (plain - scores @ columns) ** 2 - 1.0 + np.sum(half**2, axis=0)
        slope[names.index(SCATTER)] = 0.5 * np.sum(scattered / deviation**2 * left)
    if not math.isfinite(value):
        raise InputError("infer_levels: the residual is not finite")
    return float(value), slope
