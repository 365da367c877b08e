"""Data quality: dead and clipped channels, polarity, timing, geometry."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError
from ..recordings.raw import at_level, is_dead, plateau_level
from .shots import (
    NEEDED,
    SIGNIFICANCE,
    Decision,
    Shot,
    correlation,
    phase_randomised,
    shifted,
)


def dead_and_clipped(data: ArrayLike) -> tuple[Decision, Decision]:
    """Detect dead channels and clipped samples, which must be masked before any analysis.

    Parameters
    ----------
    data : (n_channels, n_samples) float

    Returns
    -------
    tuple of two Decision
        "saturation" (``target`` holds pairs of channel and sample) and "dead_channel" (channels).

    Notes
    -----
    A full scale found in one channel holds for all: they share a converter.
    """
    data = np.asarray(data, dtype=float)
    dead = tuple(int(c) for c in np.flatnonzero([is_dead(samples) for samples in data]))
    levels = [level for level in map(plateau_level, data) if level is not None]
    marks = np.zeros(data.shape, bool)
    for level in levels:
        marks |= at_level(np.abs(data), level)
    samples = tuple((int(c), int(n)) for c, n in np.argwhere(marks))
    level = {"full_scale": (max(levels), min(levels), max(levels))} if levels else {}
    return (
        Decision(
            "NAMED" if samples else "NULL", "saturation",
            f"{len(samples)} samples stand at full scale" if samples else "no plateau at the ends",
            samples, level,
        ),
        Decision(
            "NAMED" if dead else "NULL", "dead_channel",
            f"{len(dead)} channels never move" if dead else "all channels move", dead,
        ),
    )  # fmt: skip


def masked(data: ArrayLike) -> np.ndarray:
    """Return data with dead channels and clipped samples as NaN."""
    clipped, dead = dead_and_clipped(data)
    data = np.array(data, dtype=float)
    for channel, sample in clipped.target:
        data[channel, sample] = np.nan
    data[list(dead.target)] = np.nan
    return data


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
    shots: Sequence[Shot], band: tuple[float, float], *, reach: float = 0.04, seed: int = 0
) -> list[Decision]:
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


def between_neighbours(shot: Shot, reach: float) -> Misfits:
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
        return Decision(
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
        return Decision(
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
    return Decision(
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
    left = [
        [np.sum((shot.motion[n] - p) ** 2) / np.sum(shot.motion[n] ** 2)
         for p, n, _ in _predicted(shot, reach)]
        for shot in shots
    ]  # fmt: skip
    return float(1.0 - np.median(np.mean(left, axis=0)))


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
