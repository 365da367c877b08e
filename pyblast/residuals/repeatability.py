"""Whether residuals repeat: between blasts at a receiver, between receivers in a blast."""

from typing import NamedTuple

import numpy as np
from scipy import fft

from ..errors import InputError

WATER = 0.1


class Repeatability(NamedTuple):
    """How alike residuals are, and how seldom chance makes them so.

    Parameters
    ----------
    between_blasts : (n_receivers,) float64
        Mean correlation of the residuals of different blasts at a receiver: site and path.
    between_receivers : (n_blasts,) float64
        Of different receivers in a blast: source.
    blasts_chance, receivers_chance : the same shapes
        Share of time slides that correlate as well or better.
    """

    between_blasts: np.ndarray
    between_receivers: np.ndarray
    blasts_chance: np.ndarray
    receivers_chance: np.ndarray


def repeatability(white, *, n_slides=200, seed=0) -> Repeatability:
    """Correlate whitened residuals between blasts and between receivers.

    Parameters
    ----------
    white : (n_blasts, n_receivers, 3, n_samples) float
        In time, such as `Band.restore` gives; zero where there is no record. For receivers shifted
        so that what left the source together stands together, see `aligned`.
    n_slides : int
        Random turns of each channel in time against the others.
    seed : int

    Notes
    -----
    Mean over pairs of ``sum a b / sqrt(sum a^2 sum b^2)`` over the three components together;
    theory.md (7.25). The smallest chance that can be found is one over ``n_slides + 1``.
    """
    white = np.asarray(white, dtype=float)
    if white.ndim != 4 or white.shape[2] != 3 or min(white.shape[:2]) < 2:
        raise InputError(
            "repeatability: needs residuals (n_blasts, n_receivers, 3, n_samples) of at least 2 "
            f"blasts and 2 receivers, got {white.shape}"
        )
    rng = np.random.default_rng(seed)
    found = _likeness(white)
    above = [np.ones_like(each) for each in found]
    index = np.arange(white.shape[-1])
    for _ in range(n_slides):
        slide = rng.integers(white.shape[-1], size=white.shape[:2])
        places = (index + slide[:, :, None, None]) % white.shape[-1]
        drawn = _likeness(np.take_along_axis(white, np.broadcast_to(places, white.shape), -1))
        for count, chance, truth in zip(above, drawn, found, strict=True):
            count += chance >= truth
    return Repeatability(*found, *(count / (n_slides + 1.0) for count in above))


def _likeness(white):
    """Return the mean correlation over pairs of blasts and over pairs of receivers."""
    flat = white.reshape(*white.shape[:2], -1)
    length = np.linalg.norm(flat, axis=-1, keepdims=True)
    unit = np.divide(flat, length, out=np.zeros_like(flat), where=length > 0.0)
    there = (length[..., 0] > 0.0).astype(float)
    return _pairs(unit, there), _pairs(unit.swapaxes(0, 1), there.T)


def _pairs(unit, there):
    """Return the mean product over pairs along the first axis; NaN where there is no pair."""
    n = np.sum(there, axis=0)
    total = np.sum(np.sum(unit, axis=0) ** 2, axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(n > 1.0, (total - n) / (n * (n - 1.0)), np.nan)


def without_firing(motion, dt, times, scales):
    """Divide the firing of each blast out of motion, so that blasts of other delays compare.

    Parameters
    ----------
    motion : (n_blasts, ..., n_samples) float
    dt : float, s
    times, scales : sequences of (n_holes,) float
        Firing times in s and amplitudes of the holes of each blast.

    Returns
    -------
    (n_blasts, ..., n_samples) float64

    Notes
    -----
    ``x A* / max(|A|^2, w)`` with ``A = sum a_h e^(-2 pi i f t_h)`` and w a tenth of the largest
    ``|A|^2``: lines between which the comb is silent stay silent; theory.md (7.26).
    """
    motion = np.asarray(motion, dtype=float)
    n = motion.shape[-1]
    longest = max(float(np.max(each)) for each in times)
    n_padded = fft.next_fast_len(2 * n + int(longest / dt) + 1, real=True)
    frequency = fft.rfftfreq(n_padded, dt)
    parted = np.empty_like(motion)
    for b, (time, scale) in enumerate(zip(times, scales, strict=True)):
        comb = np.exp(-2j * np.pi * np.outer(frequency, time)) @ np.asarray(scale, dtype=float)
        power = np.abs(comb) ** 2
        filtered = fft.rfft(motion[b], n_padded, axis=-1) * comb.conj()
        filtered /= np.maximum(power, WATER * power.max())
        parted[b] = fft.irfft(filtered, n_padded, axis=-1)[..., :n]
    return parted


def aligned(motion, dt, delays):
    """Return motion earlier by a delay for each path, to whole samples.

    Parameters
    ----------
    motion : (n_blasts, n_receivers, 3, n_samples) float
    dt : float, s
    delays : (n_blasts, n_receivers) float, s

    Returns
    -------
    The same shape; zero where nothing was recorded.
    """
    motion = np.asarray(motion, dtype=float)
    n = motion.shape[-1]
    index = np.arange(n) + np.rint(np.asarray(delays) / dt).astype(int)[:, :, None, None]
    inside = np.broadcast_to((index >= 0) & (index < n), motion.shape)
    places = np.broadcast_to(np.clip(index, 0, n - 1), motion.shape)
    return np.where(inside, np.take_along_axis(motion, places, -1), 0.0)
