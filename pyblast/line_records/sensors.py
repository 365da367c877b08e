"""Sensor response: two sensors side by side at two places, without a model."""

import numpy as np
from numpy.typing import ArrayLike
from scipy import fft, optimize, signal

from ..errors import InputError
from .shots import NEEDED, SIGNIFICANCE, Decision, permutation_p, phase_randomised

N_CURVES, N_BANDS, TAPERS, WIDTH = 999, 24, 7, 4.0
KINDS = {"a geophone": 2, "an accelerometer": 0}  # power of the frequency below the corner
RESOLVED = 2.0  # largest ratio of the ends of the interval of a corner
N_CORNERS, DAMPINGS = 8, (0.1, 0.7)  # where the fit of a corner starts
MIDDLES = (np.arange(8) + 0.5) / 8  # of a band, at which its power is averaged


def sensor_response(
    first: ArrayLike,
    second: ArrayLike,
    dt: float,
    band: tuple[float, float],
    *,
    names: tuple[str, str],
    reference: str | None = None,
    seed: int = 0,
) -> Decision:
    """Test for a sensor response: spectral ratio of two sensors side by side, at two places.

    Parameters
    ----------
    first, second : (2, n_samples) float
        Records by each sensor at two places, of the same source.
    dt : float, s
    band : tuple of 2 float, Hz
    names : tuple of 2 str
    reference : str, optional
        Sensor with a known flat response; without it the result is a class of both.
    seed : int

    Returns
    -------
    Decision
        "instrument_response" of the other sensor, or a class of both. "departure": rms of the log
        ratio about one gain. Where a sensor of one corner explains more than half of that at the
        place that was not fitted, and its corner is known within a factor of 2, "corner" [Hz] and
        "damping" (of critical) as well, of the response of the first to the second, or of its
        inverse if the first is the reference: above the corner flat as of a geophone, or below it
        as of an accelerometer. ``held_out``: rms of the log ratio at a place, after a constant
        gain and after the curve of the other place; a name needs more than half of the departure
        explained.

    Notes
    -----
    Source, path and site cancel in the ratio of two records at one place. Surrogates: the training
    curve, phase-randomised, theory.md (15.3). A sensor of one corner: theory.md (15.6).
    """
    first, second = np.asarray(first, float), np.asarray(second, float)
    if first.shape != second.shape or first.shape[0] != 2:
        raise InputError(
            f"sensor_response: needs 2 places for each sensor, got {first.shape}, {second.shape}"
        )
    if reference is not None and reference not in names:
        raise InputError(f"sensor_response.reference: must be one of {names}, got {reference!r}")
    edges = np.geomspace(band[0], band[1], N_BANDS + 1)
    curves = np.log(_levels(first, dt, edges) / _levels(second, dt, edges))
    before, after = log_misfits(curves)
    rng = np.random.default_rng(seed)
    pairs = (log_misfits(curves, phase_randomised(curves, rng)) for _ in range(N_CURVES))
    drawn = [flat - bent for flat, bent in pairs]
    p_value = permutation_p(before - after, drawn)
    within = edges[:-1, None] + np.diff(edges)[:, None] * MIDDLES
    response = -curves if reference == names[0] else curves
    significant = after < before and p_value <= SIGNIFICANCE
    named = significant and after**2 < (1.0 - NEEDED) * before**2
    target = tuple(name for name in names if name != reference)
    outcome = ("NAMED" if reference else "CLASS") if named else "UNKNOWN" if significant else "NULL"
    why = f"natural log of the ratio of {names[0]} to {names[1]}: rms {before:.2f} after one "
    why += f"gain, {after:.2f} after the curve of the other place"
    parameters = _size(response)
    law = _one_corner(response, within) if significant else None
    if law is not None:
        kind, fitted = law
        parameters |= fitted
        why += f"; one corner, as of {kind}"
    elif significant:
        why += "; no corner in the band is resolved"
    if outcome == "CLASS":
        why += "; which of the two is not flat needs a reference"
    return Decision(
        outcome, "instrument_response", why, target if significant else (),
        parameters if significant else {}, band=band, p_value=p_value, held_out=(before, after),
    )  # fmt: skip


def log_misfits(curves: np.ndarray, trained: np.ndarray | None = None) -> tuple[float, float]:
    """Return the rms log misfit of each place to a gain, and to a curve, of the other place."""
    trained = curves if trained is None else trained
    flat = curves - curves[::-1].mean(axis=1, keepdims=True)
    bent = curves - trained[::-1]
    return float(np.sqrt(np.mean(flat**2))), float(np.sqrt(np.mean(bent**2)))


def _levels(records, dt, edges):
    """Return multitaper amplitudes in bands (2, N_BANDS)."""
    n = records.shape[1]
    frequency = fft.rfftfreq(n, dt)
    tapers = signal.windows.dpss(n, WIDTH, TAPERS)
    power = np.mean(np.abs(fft.rfft(records[:, None] * tapers)) ** 2, axis=1)
    index = np.digitize(frequency, edges) - 1
    if len(np.unique(index[(index >= 0) & (index < N_BANDS)])) < N_BANDS:
        raise InputError(f"sensor_response.band: {n} samples are too few for {N_BANDS} bands")
    return np.sqrt(np.stack([power[:, index == k].mean(axis=1) for k in range(N_BANDS)], axis=1))


def _size(response):
    """Return the rms of log ratios (2, N_BANDS) about one gain, of their mean and of each place."""
    each = np.std(response, axis=1)
    return {"departure": (float(np.std(response.mean(axis=0))), float(each.min()),
                          float(each.max()))}  # fmt: skip


def _one_corner(response, frequency):
    """Return the kind of a sensor of one corner with its parameters; None if none is resolved.

    Each place is fitted alone and has to explain the other; ends are 90 % intervals from the
    scatter about the fit of both.
    """
    found = {}
    for kind, power in KINDS.items():
        fits = [
            _fitted_corner(np.atleast_2d(row), frequency, power) for row in (*response, response)
        ]
        left = [
            np.var(other - _log_response(fit.x, frequency, power))
            for fit, other in zip(fits[:2], response[::-1], strict=True)
        ]
        found[kind] = float(np.mean(left)), fits[2]
    kind = min(found, key=lambda name: found[name][0])
    left, fit = found[kind]
    if left > (1.0 - NEEDED) * np.mean(np.var(response, axis=1)):
        return None
    freedom = max(fit.fun.size - 4, 1)
    sigma = np.sqrt(np.diag(np.linalg.pinv(fit.jac.T @ fit.jac)) * 2.0 * fit.cost / freedom)
    ends = [np.clip(fit.x + side * 1.645 * sigma, *_bounds(frequency)) for side in (0.0, -1.0, 1.0)]
    best, low, high = np.exp(ends)
    if high[0] > RESOLVED * low[0]:
        return None
    return kind, {
        name: (float(best[n]), float(low[n]), float(high[n]))
        for n, name in enumerate(("corner", "damping"))
    }


def _fitted_corner(response, frequency, power):
    """Fit logarithms of corner and damping to log ratios (n, N_BANDS), each with its own gain.

    ``frequency`` (N_BANDS, n): within the bands.
    """

    def residual(x):
        away = response - _log_response(x, frequency, power)
        return (away - away.mean(axis=1, keepdims=True)).ravel()

    bounds, lowest, highest = _bounds(frequency), frequency[0, 0], frequency[-1, -1]
    corners = np.geomspace(lowest, highest, N_CORNERS)
    starts = [(np.log(f), np.log(h)) for f in corners for h in DAMPINGS]
    best = sorted(starts, key=lambda x: float(np.sum(residual(np.array(x)) ** 2)))[:3]
    fits = [optimize.least_squares(residual, x, bounds=bounds, loss="soft_l1") for x in best]
    return min(fits, key=lambda fit: fit.cost)


def _bounds(frequency):
    """Return the least and the largest logarithms of corner and damping."""
    beyond = np.log(3.0)
    low, high = np.log(frequency[[0, -1], [0, -1]])
    return (low - beyond, np.log(0.01)), (high + beyond, np.log(3.0))


def _log_response(x, frequency, power):
    """Return ln |r^power / (1 + 2ihr - r^2)|, r frequency over corner, by band; (15.6)."""
    corner, damping = np.exp(x)
    r = frequency / corner
    size = r ** (2 * power) / ((1.0 - r**2) ** 2 + (2.0 * damping * r) ** 2)
    return 0.5 * np.log(size.mean(axis=1))
