"""Moveout of a residual over receivers, its polarisation, and how it grows with charge."""

import numpy as np
from scipy import signal

SPEEDS = np.geomspace(200.0, 8000.0, 60)  # m/s
AZIMUTHS = np.arange(0.0, 360.0, 10.0)  # degrees
FEWEST = 4  # receivers that show a moveout
AS_GOOD = 0.97  # of the largest coherence
PLANE = 0.05  # that a plane wave must gain over one from the blast, for it may come from anywhere


def moveout(residual: np.ndarray, dt: float, places: np.ndarray, origin: np.ndarray) -> dict | None:
    """Return the speed and the azimuth at which a residual runs over receivers.

    Parameters
    ----------
    residual : (n, 3, n_samples) float64
        In one unit; each receiver counts alike.
    dt : float, s
    places : (n, 3) float64, m
    origin : (3,) float64, m
        Middle of the blast.

    Returns
    -------
    dict or None
        ``speed_m_per_s`` with ``low`` and ``high``, ``azimuth_deg`` towards which a plane wave
        runs, None for one from the blast, and ``coherence``, 0 to 1. None with fewer than `FEWEST`
        receivers, or where receivers in another order are as coherent.

    Notes
    -----
    Envelopes are stacked along the arrivals of waves of a speed that start at any time.
    """
    loud = np.flatnonzero(residual.any(axis=(1, 2)))
    if len(loud) < FEWEST:
        return None
    envelope = np.linalg.norm(signal.hilbert(residual[loud]), axis=1)
    envelope /= envelope.max(axis=1, keepdims=True)
    at = places[loud]
    turn = np.radians(AZIMUTHS)
    along = np.stack([np.sin(turn), np.cos(turn)], axis=1) @ (at - origin)[:, :2].T
    paths = np.concatenate([np.linalg.norm(at - origin, axis=1)[None], along])
    late = paths[:, None] / SPEEDS[:, None]
    late -= late.min(axis=-1, keepdims=True)
    lag = np.rint(late / dt).astype(int)
    coherence = _stacked(envelope, lag)
    wave = int(np.argmax(coherence.max(axis=1) - PLANE * (np.arange(len(paths)) > 0)))
    orders = [np.roll(np.arange(len(at)), k) for k in range(1, len(at))]
    if coherence[wave].max() <= max(_stacked(envelope[o], lag[wave]).max() for o in orders):
        return None
    best = int(np.argmax(coherence[wave]))
    near = SPEEDS[coherence[wave] >= AS_GOOD * coherence[wave, best]]
    return {
        "speed_m_per_s": round(float(SPEEDS[best]), -1), "low": round(float(near.min()), -1),
        "high": round(float(near.max()), -1),
        "azimuth_deg": None if wave == 0 else float(AZIMUTHS[wave - 1]),
        "coherence": round(float(coherence[wave, best]), 2),
    }  # fmt: skip


def _stacked(envelope, lag):
    """Return the largest mean over time of envelopes (n, n_samples), ahead by lags (..., n)."""
    n_samples = envelope.shape[1]
    most = int(lag.max())
    padded = np.pad(envelope, ((0, 0), (0, most)))
    times = np.arange(n_samples)
    total = np.zeros((*lag.shape[:-1], n_samples))
    for r, trace in enumerate(padded):
        total += trace[lag[..., r, None] + times]
    return total.max(axis=-1) / len(envelope)


def polarised_shares(residual: np.ndarray, bearings: np.ndarray) -> dict:
    """Return the shares of the energy of a residual away from the blast, across it and up.

    Parameters
    ----------
    residual : (n, 3, n_samples) float64
        East, north, up.
    bearings : (n,) float64, rad
        From the blast to each receiver, clockwise from north.
    """
    sine, cosine = np.sin(bearings)[:, None], np.cos(bearings)[:, None]
    east, north, up = residual.swapaxes(0, 1)
    parts = {
        "radial": sine * east + cosine * north, "transverse": cosine * east - sine * north,
        "vertical": up,
    }  # fmt: skip
    energy = {name: float(np.sum(part**2)) for name, part in parts.items()}
    whole = sum(energy.values()) or 1.0
    return {name: round(value / whole, 2) for name, value in energy.items()}


def growth(share: np.ndarray, charge: np.ndarray) -> float | None:
    """Return the exponent at which the share of a residual in records grows with the charge.

    Parameters
    ----------
    share : (n_blasts,) float64
        Amplitude of the residual over that of the records.
    charge : (n_blasts,) float64, kg

    Returns
    -------
    float or None
        Zero for what is linear; None with charges of one size.
    """
    known = (share > 0.0) & (charge > 0.0)
    if not known.any() or charge[known].max() < 2.0 * charge[known].min():
        return None
    slope = np.polyfit(np.log(charge[known]), np.log(share[known]), 1)[0]
    return round(float(slope), 2)
