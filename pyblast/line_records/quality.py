"""Data quality: polarity, timing and geometry of channels, response of sensors."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy import fft, optimize, signal

from ..errors import InputError
from .shots import (
    NEEDED,
    SIGNIFICANCE,
    EffectDecision,
    ShotGather,
    correlation,
    permutation_p,
    phase_randomised,
    shifted,
)

N_DRAWS, MOST = 4000, 3
FINER, RESOLVED = 8, 0.01  # lags per sample; smallest difference of two correlations
N_NOISE_DRAWS = 99
LABELS = ("polarity", "clock_error", "wrong_coordinates")
NO_SIGNAL = "no_signal"


@dataclass(frozen=True, eq=False)
class Misfits:
    """Misfits of each inner receiver to its neighbours, (n_shots, n_inner).

    Parameters
    ----------
    sign : correlation of largest magnitude; negative where the inverted waveform fits better
    lag : s, positive where the receiver is late
    slowness : s/m, of the wave in the direction of the line
    channels : (n_inner,) int
    finest : float, s
        Step of the trial lags.
    """

    sign: np.ndarray
    lag: np.ndarray
    slowness: np.ndarray
    channels: np.ndarray
    finest: float


def odd_channels(
    shots: Sequence[ShotGather], band: tuple[float, float], *, reach: float = 0.04, seed: int = 0
) -> list[EffectDecision]:
    """Find receivers with reversed polarity, timing or geometry errors, or without signal.

    Parameters
    ----------
    shots : list of Shot
        At least 4 with the same receivers. Shots from one end only can't separate timing from
        geometry errors.
    band : tuple of 2 float, Hz
        Band in which neighbours record the same wave: wavelengths above twice their spacing.
    reach : float, s
        Largest time shift tried.
    seed : int

    Returns
    -------
    list of Decision
        One per anomalous receiver, the most significant first; a single NULL if there is none. A
        positive "shift" [s] is late; a positive "move" [m] is a true position farther along the
        line than the coordinate. ``held_out``: share of energy that the neighbours predict in
        held-out shots, as recorded and corrected; a name needs more than half of the way from the
        first to the share of the median receiver. "no_signal" is an anomalous receiver that
        correlates with its neighbours no better than phase-randomised noise. Gain, response and
        coupling are not tried.

    Notes
    -----
    Lag of shot s: ``shift + move * slowness_s``, medians over shots. The largest robust z-score is
    compared with the maximum of as many normal draws at the 5 % level; theory.md (15.1).
    """
    if len(shots) < 4 or any(list(s.channels) != list(shots[0].channels) for s in shots):
        raise InputError(
            "odd_channels: needs at least 4 shots at the same receivers; leave out of all shots "
            "what clips in one (Shot.only)"
        )
    shots, decisions = [shot.banded(band) for shot in shots], []
    while len(decisions) < MOST:
        decision = _most_anomalous(shots, band, reach, seed)
        if decision.outcome == "NULL":
            break
        decisions.append(decision)
        if decision.outcome == "UNKNOWN":
            break
        shots = [_corrected(shot, decision) for shot in shots]
    return decisions or [decision]


def _corrected(shot, decision):
    """Return a shot with one receiver corrected, or left out if it carries no signal."""
    n = int(np.flatnonzero(shot.channels == decision.target[0])[0])
    if decision.label == NO_SIGNAL:
        return shot.only(np.arange(len(shot.channels)) != n)
    motion, places = shot.motion.copy(), shot.places.copy()
    ((name, (value, _, _)),) = decision.parameters.items()
    if name == "factor":
        motion[n] *= value
    elif name == "shift":
        motion[n] = shifted(motion[n], -value, shot.dt)
    else:
        places[n] += value
    return replace(shot, motion=motion, places=places)


def between_neighbours(shot: ShotGather, reach: float) -> Misfits:
    """Correlate each inner receiver with the mean of its neighbours after moveout correction."""
    sign, lag, slowness = [], [], []
    for predicted, n, slow in _predicted(shot, reach):
        lags, like = correlation(predicted, shot.motion[n], reach, shot.dt, FINER)
        best = int(np.argmax(np.abs(like)))
        sign.append(like[best])
        lag.append(lags[best])
        slowness.append(slow)
    signs, lags_, slow_ = (np.array(x)[None] for x in (sign, lag, slowness))
    return Misfits(signs, lags_, slow_, shot.channels[1:-1], shot.dt / FINER)


def _predicted(shot, reach):
    """Yield the waveform that the neighbours predict at each inner receiver, index and slowness."""
    for n in range(1, len(shot.places) - 1):
        before, after = shot.motion[n - 1], shot.motion[n + 1]
        gap = shot.places[n + 1] - shot.places[n - 1]
        lags, like = correlation(before, after, reach, shot.dt, FINER)
        moveout = lags[int(np.argmax(like))]
        share = (shot.places[n] - shot.places[n - 1]) / gap
        both = shifted(np.stack([before, after]), np.array([share, share - 1.0]) * moveout, shot.dt)
        yield both.mean(axis=0), n, moveout / gap


def _most_anomalous(shots, band, reach, seed):
    """Test the most anomalous receiver on half of the shots, and validate it on the others."""
    each = [between_neighbours(shot, reach) for shot in shots]
    fitted, held = _halves(shots)
    misfits = _stacked([each[n] for n in fitted])
    scores, values = _scores(misfits)
    threshold, p_value_of = _null_maximum(scores.shape[1], N_DRAWS, seed)
    kind, where = np.unravel_index(np.argmax(scores), scores.shape)
    if scores[0].max() > threshold:  # reversed polarity biases the lags of the neighbours
        kind, where = 0, int(np.argmax(scores[0]))
    p_value = p_value_of(scores[kind, where])
    if scores[kind, where] <= threshold:
        return EffectDecision(
            "NULL", " | ".join(LABELS),
            f"the most anomalous receiver deviates by {scores[kind, where]:.1f} robust standard "
            f"deviations; the 5 % level of the null distribution is {threshold:.1f}",
            band=band, p_value=p_value,
        )  # fmt: skip
    # a receiver without signal biases the lags of its neighbours, too
    near = range(max(0, where - 1), min(where + 2, scores.shape[1]))
    weakest = min(near, key=lambda n: np.median(np.abs(misfits.sign[:, n])))
    size, noise = _coherence([shots[n] for n in held], weakest + 1, reach, seed)
    if size <= noise:
        return EffectDecision(
            "NAMED", NO_SIGNAL,
            f"its correlation with the neighbours is {size:.2f}, and {100 * SIGNIFICANCE:.0f} % of "
            f"noises with its spectrum exceed {noise:.2f}",
            (int(misfits.channels[weakest]),), band=band, p_value=p_value,
        )  # fmt: skip
    value = float(values[kind][where])
    before, after = _explained([shots[n] for n in held], where, kind, value, reach)
    usual = _usually_explained([shots[n] for n in held], reach)
    half_width = _half_width(misfits, kind, where, values[kind])
    label, outcome = LABELS[kind], "NAMED"
    position = shots[0].places[where + 1]
    if kind and len({shots[n].source < position for n in fitted}) == 1:
        label, outcome = " | ".join(LABELS[1:]), "CLASS"
    small = after - before <= NEEDED * max(usual - before, 0.0) or after <= before
    if small:
        outcome = "UNKNOWN"
    return EffectDecision(
        outcome, label,
        f"deviates by {scores[kind, where]:.1f} robust standard deviations of the others; the "
        f"{100 * SIGNIFICANCE:.0f} % level of the null distribution is {threshold:.1f}"
        + f"; too small a gain for a name: others have {usual:.2f}" * small,
        (int(misfits.channels[where]),),
        {("factor", "shift", "move")[kind]: (value, value - half_width, value + half_width)},
        band=band, p_value=p_value, held_out=(before, after),
    )  # fmt: skip


def _coherence(shots, n, reach, seed):
    """Return the correlation of a receiver with its neighbours, and the 5 % level of noise."""
    rng, motions, drawn = np.random.default_rng(seed), [], []
    for shot in shots:
        three = shot.only(slice(n - 1, n + 2))
        motions.append((next(_predicted(three, reach))[0], shot.motion[n], shot.dt))
    for k in range(1 + N_NOISE_DRAWS):
        largest = [
            np.abs(correlation(
                predicted, phase_randomised(own, rng) if k else own, reach, dt, 1
            )[1]).max()
            for predicted, own, dt in motions
        ]  # fmt: skip
        drawn.append(np.median(largest))
    return drawn[0], float(np.quantile(drawn[1:], 1.0 - SIGNIFICANCE))


def _halves(shots):
    """Split shots into two halves with both ends of the line in each."""
    order = np.lexsort((np.arange(len(shots)), [shot.source for shot in shots]))
    return order[::2], order[1::2]


def _stacked(parts):
    """Return the misfits of several shots as one."""
    sign, lag, slowness = (
        np.concatenate([getattr(p, name) for p in parts]) for name in ("sign", "lag", "slowness")
    )
    return Misfits(sign, lag, slowness, parts[0].channels, parts[0].finest)


def _scores(misfits):
    """Return robust z-scores of each receiver for sign, shift and move, and their values."""
    sign = np.median(misfits.sign, axis=0)
    mean_slow = np.median(np.abs(misfits.slowness))
    shift, move = _shift_and_move(misfits)
    fits = np.stack([
        np.abs(misfits.lag - shift).mean(axis=0),
        np.abs(misfits.lag - move * misfits.slowness).mean(axis=0),
    ])  # fmt: skip
    out = [np.maximum(-_robust_z(sign, RESOLVED), 0.0) * (sign < 0.0)]
    for n, value in enumerate((shift, move * mean_slow)):
        better = fits[n] <= fits[1 - n]
        out.append(np.abs(_robust_z(value, misfits.finest)) * better)
    factor = np.where(sign < 0.0, -1.0, 1.0)
    return np.array(out), (factor, shift, move)


def _shift_and_move(misfits):
    """Return the time shift, and the displacement, that each alone explains the lags."""
    shift = np.median(misfits.lag, axis=0)
    slow = np.where(np.abs(misfits.slowness) > 0.0, misfits.slowness, np.nan)
    move = np.nan_to_num(np.nanmedian(misfits.lag / slow, axis=0))
    return shift, move


def _robust_z(values, finest):
    """Return robust z-scores: distance from the median over the scaled MAD, at least a step."""
    away = values - np.median(values)
    return away / max(1.4826 * np.median(np.abs(away)), finest)


def _null_maximum(n, n_draws, seed):
    """Return the 5 % level of the largest z-score of n normal draws, and its p-value function."""
    drawn = np.random.default_rng(seed).normal(size=(n_draws, len(LABELS), n))
    away = np.abs(drawn - np.median(drawn, axis=2, keepdims=True))
    most = (away / (1.4826 * np.median(away, axis=2, keepdims=True))).max(axis=(1, 2))
    return float(np.quantile(most, 1.0 - SIGNIFICANCE)), lambda x: float(
        (1 + np.count_nonzero(most >= x)) / (1 + n_draws)
    )


def _half_width(misfits, kind, where, values):
    """Return the half width of the 90 % interval: scatter over shots and over receivers."""
    if kind == 0:
        return 0.0
    each = misfits.lag[:, where]
    if kind == 2:
        slow = misfits.slowness[:, where]
        each = each[slow != 0.0] / slow[slow != 0.0]
    own = 1.2533 * np.median(np.abs(each - values[where])) / np.sqrt(len(each))
    others = np.median(np.abs(values - np.median(values)))
    return float(1.645 * 1.4826 * np.hypot(own, others))


def _usually_explained(shots, reach):
    """Return the share of energy that the neighbours predict of the median receiver."""
    residual = [
        [np.sum((shot.motion[n] - p) ** 2) / np.sum(shot.motion[n] ** 2)
         for p, n, _ in _predicted(shot, reach)]
        for shot in shots
    ]  # fmt: skip
    return float(1.0 - np.median(np.mean(residual, axis=0)))


def _explained(shots, where, kind, value, reach):
    """Return the share of energy that the neighbours predict, as recorded and corrected."""
    residual, total = np.zeros(2), 0.0
    for shot in shots:
        n = where + 1
        places = shot.places.copy()
        own = shot.motion[n].copy()
        if kind == 0:
            own = value * own
        elif kind == 1:
            own = shifted(own, -value, shot.dt)
        else:
            places[n] += value
        for k, (motion, at) in enumerate(((shot.motion[n], shot.places), (own, places))):
            three = replace(shot.only(slice(n - 1, n + 2)), places=at[n - 1 : n + 2])
            predicted = next(_predicted(three, reach))[0]
            residual[k] += np.sum((motion - predicted) ** 2) / np.sum(motion**2)
        total += 1.0
    return tuple(float(x) for x in 1.0 - residual / total)


N_CURVES, N_BANDS, TAPERS, WIDTH = 999, 24, 7, 4.0
KINDS = {"a geophone": 2, "an accelerometer": 0}  # power of the frequency below the corner
CORNER_RATIO = 2.0  # largest ratio of the ends of the interval of a corner
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
) -> EffectDecision:
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
    return EffectDecision(
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
    fitted = {}
    for kind, power in KINDS.items():
        fits = [
            _fitted_corner(np.atleast_2d(row), frequency, power) for row in (*response, response)
        ]
        residual = [
            np.var(other - _log_response(fit.x, frequency, power))
            for fit, other in zip(fits[:2], response[::-1], strict=True)
        ]
        fitted[kind] = float(np.mean(residual)), fits[2]
    kind = min(fitted, key=lambda name: fitted[name][0])
    residual, fit = fitted[kind]
    if residual > (1.0 - NEEDED) * np.mean(np.var(response, axis=1)):
        return None
    n_free = max(fit.fun.size - 4, 1)
    sigma = np.sqrt(np.diag(np.linalg.pinv(fit.jac.T @ fit.jac)) * 2.0 * fit.cost / n_free)
    ends = [np.clip(fit.x + side * 1.645 * sigma, *_bounds(frequency)) for side in (0.0, -1.0, 1.0)]
    best, low, high = np.exp(ends)
    if high[0] > CORNER_RATIO * low[0]:
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
