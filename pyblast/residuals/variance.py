"""Whether a difference belongs to the blast, to the receiver or to the path between them."""

from dataclasses import dataclass

import numpy as np
from scipy import linalg, optimize, stats

from ..errors import InputError

TERMS = ("blast", "receiver", "path", "rest")
SMALLEST = 1e-8
COVERAGE = 0.9


@dataclass(frozen=True, eq=False)
class Variances:
    """What part of a quantity each term explains.

    Parameters
    ----------
    deviation : dict of str to float
        Standard deviation of ``blast``, ``receiver`` (with component), ``path`` and ``rest``.
    intervals : dict of str to (low, high)
        Of 90 %.
    slopes : (1 + n_covariates,) float64
        Mean first, then the change for one unit of each covariate.
    slope_errors : the same shape
        One standard deviation.
    blast : (n_blasts,) float64
    receiver : (n_receivers, 3) float64
    path : (n_blasts, n_receivers) float64
        Likely size of each effect.
    """

    deviation: dict[str, float]
    intervals: dict[str, tuple[float, float]]
    slopes: np.ndarray
    slope_errors: np.ndarray
    blast: np.ndarray
    receiver: np.ndarray
    path: np.ndarray


def analyse_variance(values, covariates=()) -> Variances:
    """Divide a quantity between blast, receiver with component, path and the rest.

    Parameters
    ----------
    values : (n_blasts, n_receivers, 3) float
        Such as the logarithm of an amplitude ratio or a delay; NaN where there is none.
    covariates : sequence of arrays that broadcast to the same shape
        Such as the logarithm of charge, or distance.

    Raises
    ------
    InputError
        If there are fewer than two blasts or receivers, or too few values for the covariates.

    Notes
    -----
    ``y_brc = mean + slopes + B_b + R_rc + P_br + rest`` with random terms, by the likelihood of
    what the mean and slopes leave (REML); theory.md (7.24). Intervals are those of chi square with
    ``2 s^4 / var s^2`` degrees of freedom (Satterthwaite), the variance from the information:
    about one less than blasts for a blast term that stands out, wide with three of them.
    """
    values = np.asarray(values, dtype=float)
    if values.ndim != 3 or values.shape[2] != 3 or min(values.shape[:2]) < 2:
        raise InputError(
            "analyse_variance: needs values (n_blasts, n_receivers, 3) of at least 2 blasts and 2 "
            f"receivers, got {values.shape}"
        )
    known = np.isfinite(values)
    y = values[known]
    columns = [np.ones(values.shape), *covariates]
    x = np.column_stack([np.broadcast_to(column, values.shape)[known] for column in columns])
    if len(y) < x.shape[1] + len(TERMS) or np.linalg.matrix_rank(x) < x.shape[1]:
        raise InputError(
            f"analyse_variance: {len(y)} values cannot tell {x.shape[1] - 1} covariates and 4 terms"
        )
    places = np.argwhere(known)
    level = float(np.var(y - x @ np.linalg.lstsq(x, y, rcond=None)[0])) or 1.0
    shared = _shared(places)

    def cost(logarithms):
        return _remaining(y, x, shared, level * np.exp(logarithms))

    best = optimize.minimize(
        cost, np.log(np.full(4, 0.25)), jac=True, method="L-BFGS-B",
        bounds=[(np.log(SMALLEST), np.log(100.0))] * 4,
    )  # fmt: skip
    variance = level * np.exp(best.x)
    return _answer(y, x, shared, variance, places, values.shape)


def _shared(places):
    """Return which values share each term, (4, n, n)."""
    b, r, c = places.T
    same = [each[:, None] == each for each in (b, r, c)]
    return np.array(
        [same[0], same[1] & same[2], same[0] & same[1], np.eye(len(places), dtype=bool)],
        dtype=float,
    )


def _projection(x, shared, variance):
    """Return the projection that leaves out mean and slopes, and two log determinants."""
    factor = linalg.cho_factor(np.tensordot(variance, shared, 1), lower=True)
    weighed = linalg.cho_solve(factor, x)
    information = x.T @ weighed
    projection = linalg.cho_solve(factor, np.eye(len(x)))
    projection -= weighed @ np.linalg.solve(information, weighed.T)
    logarithms = 2.0 * np.sum(np.log(np.diag(factor[0]))) + np.linalg.slogdet(information)[1]
    return projection, logarithms


def _remaining(y, x, shared, variance):
    """Return minus the log likelihood of what the mean leaves, and its slopes."""
    projection, logarithms = _projection(x, shared, variance)
    left = projection @ y
    slope = np.einsum("tij,ij->t", shared, projection) - np.einsum("i,tij,j->t", left, shared, left)
    return 0.5 * (logarithms + y @ left), 0.5 * slope * variance


def _answer(y, x, shared, variance, places, shape):
    """Put deviations, intervals, slopes and effects together."""
    projection, _ = _projection(x, shared, variance)
    seen = np.array([projection @ each for each in shared])
    information = 0.5 * np.einsum("aij,bji->ab", seen, seen)
    spread = np.diag(np.linalg.pinv(information))
    intervals = {}
    for name, value, wide in zip(TERMS, variance, spread, strict=True):
        freedom = max(2.0 * value**2 / wide, 1e-3)
        ends = stats.chi2.ppf([0.5 + 0.5 * COVERAGE, 0.5 - 0.5 * COVERAGE], freedom)
        with np.errstate(divide="ignore"):
            low, high = np.sqrt(value * freedom / ends)
        intervals[name] = float(low), float(high)
    covariance = np.tensordot(variance, shared, 1)
    weighed = np.linalg.solve(covariance, x)
    slope_covariance = np.linalg.inv(x.T @ weighed)
    left = projection @ y
    b, r, c = places.T
    effects = [np.zeros(each) for each in (shape[:1], shape[1:], shape[:2])]
    for effect, place, size in zip(effects, ((b,), (r, c), (b, r)), variance, strict=False):
        np.add.at(effect, place, size * left)
    return Variances(
        dict(zip(TERMS, map(float, np.sqrt(variance)), strict=True)), intervals,
        slope_covariance @ (weighed.T @ y), np.sqrt(np.diag(slope_covariance)), *effects,
    )  # fmt: skip
