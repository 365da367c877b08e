"""Sensor response: whether one of two sensors that recorded the same motion is not flat."""

import numpy as np
from numpy.typing import ArrayLike
from scipy import fft, signal

from ..errors import InputError
from .shots import SURE, Verdict, phase_randomised, share_as_large

N_DRAWS, N_BANDS, TAPERS, WIDTH = 999, 24, 7, 4.0


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
    before, after = misfits(curves)
    rng = np.random.default_rng(seed)
    pairs = (misfits(curves, phase_randomised(curves, rng)) for _ in range(N_DRAWS))
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


def misfits(curves: np.ndarray, trained: np.ndarray | None = None) -> tuple[float, float]:
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
