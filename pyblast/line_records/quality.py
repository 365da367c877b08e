"""Quality of channels: dead, clipped, odd by sign, clock or place; response of sensors."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy import fft, signal

from ..errors import InputError
from ..recordings.raw import at_level, is_dead, plateau_level
from .shots import (
    SURE,
    Shot,
    Verdict,
    correlation,
    phase_randomised,
    share_as_large,
    shifted,
)


def unusable(data: ArrayLike) -> tuple[Verdict, Verdict]:
    """Find what must be masked before anything is diagnosed.

    Parameters
    ----------
    data : (n_channels, n_samples) float

    Returns
    -------
    tuple of two Verdict
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
        Verdict(
            "NAMED" if samples else "NULL", "saturation",
            f"{len(samples)} samples stand at full scale" if samples else "no plateau at the ends",
            samples, level,
        ),
        Verdict(
            "NAMED" if dead else "NULL", "dead_channel",
            f"{len(dead)} channels never move" if dead else "all channels move", dead,
        ),
    )  # fmt: skip


def masked(data: ArrayLike) -> np.ndarray:
    """Return data with what is unusable as NaN."""
    clipped, dead = unusable(data)
    data = np.array(data, dtype=float)
    for channel, sample in clipped.target:
        data[channel, sample] = np.nan
    data[list(dead.target)] = np.nan
    return data


N_DRAWS, MOST = 4000, 3
FINER, LIKELY = 8, 0.01  # lags to a sample; correlations that differ by less are alike
LABELS = ("polarity", "clock_error", "wrong_coordinates")


@dataclass(frozen=True, eq=False)
class Misfits:
    """How each inner receiver lies between its neighbours, (n_shots, n_inner).

    Parameters
    ----------
    sign : correlation where it is largest, negative where the neighbours' negative fits better
    lag : s, by which it is late
    slowness : s/m, of the motion from left to right across it
    channels : (n_inner,) int
    finest : float, s
        Between two lags that are tried.
    """

    sign: np.ndarray
    lag: np.ndarray
    slowness: np.ndarray
    channels: np.ndarray
    finest: float


def odd_channels(
    shots: Sequence[Shot], band: tuple[float, float], *, reach: float = 0.04, seed: int = 0
) -> list[Verdict]:
    """Find receivers of wrong polarity, clock or coordinate, the oddest first.

    Parameters
    ----------
    shots : list of Shot
        At least 4, of the same receivers; from both ends, or clock and place are one class.
    band : tuple of 2 float, Hz
        Of a wave that neighbours share; its shortest wave longer than twice their spacing.
    reach : float, s
        Largest shift that is looked for.
    seed : int

    Returns
    -------
    list of Verdict
        One for each odd receiver; a single NULL where none is. Positive "shift" [s] is late,
        positive "move" [m] says that it stands farther along the line than its coordinate.
        ``held_out`` is the share of energy explained by the neighbours in every other shot.

    Notes
    -----
    Lag of shot s: ``shift + move * slowness_s``, medians over shots; an odd receiver exceeds what
    the largest of as many draws of the others' spread exceeds in 5 %; theory.md (15.1).
    """
    if len(shots) < 4 or any(len(s.channels) != len(shots[0].channels) for s in shots):
        raise InputError("odd_channels: needs at least 4 shots at the same receivers")
    shots, found = [shot.banded(band) for shot in shots], []
    while len(found) < MOST:
        verdict = _oddest(shots, band, reach, seed)
        if verdict.outcome == "NULL":
            break
        found.append(verdict)
        if verdict.outcome == "UNKNOWN":
            break
        shots = [_corrected(shot, verdict) for shot in shots]
    return found or [verdict]


def _corrected(shot, verdict):
    """Correct a receiver by a decision."""
    n = int(np.flatnonzero(shot.channels == verdict.target[0])[0])
    motion, places = shot.motion.copy(), shot.places.copy()
    ((name, (value, _, _)),) = verdict.parameters.items()
    if name == "factor":
        motion[n] *= value
    elif name == "shift":
        motion[n] = shifted(motion[n], -value, shot.dt)
    else:
        places[n] += value
    return replace(shot, motion=motion, places=places)


def between_neighbours(shot: Shot, reach: float) -> Misfits:
    """Compare each inner receiver of a shot with the mean of its neighbours after moveout."""
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
    """Yield the prediction by the neighbours of each inner receiver, its number and slowness."""
    for n in range(1, len(shot.places) - 1):
        left, right = shot.motion[n - 1], shot.motion[n + 1]
        gap = shot.places[n + 1] - shot.places[n - 1]
        lags, like = correlation(left, right, reach, shot.dt, FINER)
        moveout = lags[int(np.argmax(like))]
        share = (shot.places[n] - shot.places[n - 1]) / gap
        both = shifted(np.stack([left, right]), np.array([share, share - 1.0]) * moveout, shot.dt)
        yield both.mean(axis=0), n, moveout / gap


def _oddest(shots, band, reach, seed):
    """Judge the oddest receiver by half of the shots, and test it on the other half."""
    each = [between_neighbours(shot, reach) for shot in shots]
    fitted, held = _halves(shots)
    misfits = _stacked([each[n] for n in fitted])
    scores, values = _scores(misfits)
    threshold, chance = _largest_of(scores.shape[1], N_DRAWS, seed)
    kind, where = np.unravel_index(np.argmax(scores), scores.shape)
    if scores[0].max() > threshold:  # a wrong sign spoils the lags of its neighbours
        kind, where = 0, int(np.argmax(scores[0]))
    share = chance(scores[kind, where])
    if scores[kind, where] <= threshold:
        return Verdict(
            "NULL", " | ".join(LABELS),
            f"the oddest receiver deviates by {scores[kind, where]:.1f} robust standard "
            f"deviations, and 5 % of null draws exceed {threshold:.1f}", band=band, chance=share,
        )  # fmt: skip
    value = float(values[kind][where])
    before, after = _explained([shots[n] for n in held], where, kind, value, reach)
    spread = _spread_of(misfits, kind, where, values[kind])
    label, outcome = LABELS[kind], "NAMED"
    place = shots[0].places[where + 1]
    if kind and len({shots[n].source < place for n in fitted}) == 1:
        label, outcome = " | ".join(LABELS[1:]), "CLASS"
    if after <= before:
        outcome = "UNKNOWN"
    return Verdict(
        outcome, label,
        f"deviates by {scores[kind, where]:.1f} robust standard deviations of the others, and "
        f"{100 * SURE:.0f} % of null draws exceed {threshold:.1f}",
        (int(misfits.channels[where]),),
        {("factor", "shift", "move")[kind]: (value, value - spread, value + spread)},
        band=band, chance=share, held_out=(before, after),
    )  # fmt: skip


def _halves(shots):
    """Split shots in two, each side of the line in both."""
    order = np.lexsort((np.arange(len(shots)), [shot.source for shot in shots]))
    return order[::2], order[1::2]


def _stacked(parts):
    """Put shots on top of each other."""
    sign, lag, slowness = (
        np.concatenate([getattr(p, name) for p in parts]) for name in ("sign", "lag", "slowness")
    )
    return Misfits(sign, lag, slowness, parts[0].channels, parts[0].finest)


def _scores(misfits):
    """Return how far each receiver stands out by sign, shift and move, and their values."""
    sign = np.median(misfits.sign, axis=0)
    mean_slow = np.median(np.abs(misfits.slowness))
    shift, move = _shift_and_move(misfits)
    fits = np.stack([
        np.abs(misfits.lag - shift).mean(axis=0),
        np.abs(misfits.lag - move * misfits.slowness).mean(axis=0),
    ])  # fmt: skip
    out = [np.maximum(-_standing_out(sign, LIKELY), 0.0) * (sign < 0.0)]
    for n, value in enumerate((shift, move * mean_slow)):
        better = fits[n] <= fits[1 - n]
        out.append(np.abs(_standing_out(value, misfits.finest)) * better)
    factor = np.where(sign < 0.0, -1.0, 1.0)
    return np.array(out), (factor, shift, move)


def _shift_and_move(misfits):
    """Return the lag common to shots, and the move that explains the lags alone."""
    shift = np.median(misfits.lag, axis=0)
    slow = np.where(np.abs(misfits.slowness) > 0.0, misfits.slowness, np.nan)
    move = np.nan_to_num(np.nanmedian(misfits.lag / slow, axis=0))
    return shift, move


def _standing_out(values, finest):
    """Return distances from the median in robust standard deviations, at least the finest step."""
    away = values - np.median(values)
    return away / max(1.4826 * np.median(np.abs(away)), finest)


def _largest_of(n, n_draws, seed):
    """Return what the largest of n normal draws stands out by in 5 %, and the chance of more."""
    drawn = np.random.default_rng(seed).normal(size=(n_draws, len(LABELS), n))
    away = np.abs(drawn - np.median(drawn, axis=2, keepdims=True))
    most = (away / (1.4826 * np.median(away, axis=2, keepdims=True))).max(axis=(1, 2))
    return float(np.quantile(most, 1.0 - SURE)), lambda x: float(
        (1 + np.count_nonzero(most >= x)) / (1 + n_draws)
    )


def _spread_of(misfits, kind, where, values):
    """Return the half width of the 90 % interval: over shots, and as others stray; of a sign 0."""
    if kind == 0:
        return 0.0
    each = misfits.lag[:, where]
    if kind == 2:
        slow = misfits.slowness[:, where]
        each = each[slow != 0.0] / slow[slow != 0.0]
    own = 1.2533 * np.median(np.abs(each - values[where])) / np.sqrt(len(each))
    others = np.median(np.abs(values - np.median(values)))
    return float(1.645 * 1.4826 * np.hypot(own, others))


def _explained(shots, where, kind, value, reach):
    """Return the share of energy neighbours explain of a receiver, as it is and put right."""
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


def sensor_response(
    first: ArrayLike,
    second: ArrayLike,
    dt: float,
    band: tuple[float, float],
    *,
    names: tuple[str, str],
    reference: str | None = None,
    seed: int = 0,
) -> Verdict:
    """Learn the ratio of two sensors' spectra at one place and predict the other place.

    Parameters
    ----------
    first, second : (2, n_samples) float
        Records by each sensor at two places, of the same source.
    dt : float, s
    band : tuple of 2 float, Hz
    names : tuple of 2 str
    reference : str, optional
        Sensor that is known to be flat. Without it the two can't be told apart.
    seed : int

    Returns
    -------
    Verdict
        "instrument_response" of the other sensor, or a class of both; "span" is the ratio between
        its largest and least reply in the band. ``held_out`` is the root mean square of the log
        ratio at a place, after one gain and after the curve of the other place.

    Notes
    -----
    Source and path are in both records of a place and fall out of the ratio, so neither Q nor
    site can be blamed. Surrogates: the training curve with drawn phases, theory.md (15.3).
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
    chance = share_as_large(before - after, drawn)
    reply = curves.mean(axis=0)
    if reference == names[0]:
        reply = -reply
    named = after < before and chance <= SURE
    target = tuple(name for name in names if name != reference)
    outcome = ("NAMED" if reference else "CLASS") if named else "NULL"
    why = f"natural log of the ratio of {names[0]} to {names[1]}: {before:.2f} left after one "
    why += f"gain, {after:.2f} after the curve of the other place"
    if outcome == "CLASS":
        why += "; which of the two is not flat needs a reference"
    return Verdict(
        outcome, "instrument_response", why, target if named else (),
        _span(curves, edges, reply) if named else {}, band=band, chance=chance,
        held_out=(before, after),
    )  # fmt: skip


def log_misfits(curves: np.ndarray, trained: np.ndarray | None = None) -> tuple[float, float]:
    """Return the log misfit of each place after a gain, and after a curve, of the other."""
    trained = curves if trained is None else trained
    flat = curves - curves[::-1].mean(axis=1, keepdims=True)
    bent = curves - trained[::-1]
    return float(np.sqrt(np.mean(flat**2))), float(np.sqrt(np.mean(bent**2)))


def _levels(records, dt, edges):
    """Return amplitudes in bands (2, N_BANDS), by Slepian tapers."""
    n = records.shape[1]
    frequency = fft.rfftfreq(n, dt)
    tapers = signal.windows.dpss(n, WIDTH, TAPERS)
    power = np.mean(np.abs(fft.rfft(records[:, None] * tapers)) ** 2, axis=1)
    place = np.digitize(frequency, edges) - 1
    if len(np.unique(place[(place >= 0) & (place < N_BANDS)])) < N_BANDS:
        raise InputError(f"sensor_response.band: {n} samples are too few for {N_BANDS} bands")
    return np.sqrt(np.stack([power[:, place == k].mean(axis=1) for k in range(N_BANDS)], axis=1))


def _span(curves, edges, reply):
    """Return the ratio of largest to least reply, by the places, and the loudest frequency."""
    spans = np.exp(np.ptp(curves, axis=1))
    loudest = int(np.argmax(reply))
    return {
        "span": (float(np.exp(np.ptp(reply))), float(spans.min()), float(spans.max())),
        "loudest": (float(np.sqrt(edges[loudest] * edges[loudest + 1])),
                    float(edges[loudest]), float(edges[loudest + 1])),
    }  # fmt: skip
