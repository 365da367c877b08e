"""What raw samples say about the recorder: its printed values, clipping and dead channels."""

import numpy as np

from ..motion.seismogram import Seismogram
from ..motion.spectra import zero_crossing_frequency
from .raw_record import Printed

TOLERANCE = 0.01
FREQUENCY_TOLERANCE = 0.03
PLATEAU = 3
FULL_SCALE_MARGIN = 5e-4
PLATEAU_MARGIN = 1e-6


def check_printed(
    printed: dict[str, Printed], seismogram: Seismogram
) -> tuple[tuple[str, float, float, bool], ...]:
    """Compare every value that the device printed with the same value from the raw samples.

    Returns
    -------
    tuple of (name, printed value, recomputed value, within)
        SI. Within 1 % (frequency 3 %) and one step of the last printed digit; times of peaks
        within one step and one sample. ``>100 Hz`` is within where the samples give at least
        that.

    Notes
    -----
    The mean is not removed; the vector sum is taken at one instant; acceleration is a forward
    difference; frequency comes from the zero crossings on both sides of the peak.
    """
    found = device_values(seismogram) if printed else {}
    return tuple(
        (name, value.value, found[name], _within(name, value, found[name], seismogram.dt))
        for name, value in printed.items()
        if np.isfinite(found.get(name, np.nan))
    )


def device_values(seismogram: Seismogram) -> dict[str, float]:
    """Compute what a blast seismograph prints, by the rules of such devices (SI)."""
    frequency = zero_crossing_frequency(seismogram).hz
    values = {}
    for n in np.flatnonzero(seismogram.present):
        name, samples = seismogram.components[n], seismogram.velocity[:, n]
        peak = int(np.argmax(np.abs(samples)))
        change = float(np.max(np.abs(np.diff(samples))))
        values[f"{name} PPV"] = float(seismogram.ppv[n])
        values[f"{name} time of peak"] = float(seismogram.times[peak])
        values[f"{name} zero-crossing frequency"] = float(frequency[n])
        values[f"{name} peak acceleration"] = change / seismogram.dt
    if np.all(seismogram.present):
        longest = int(np.argmax(np.sum(seismogram.velocity**2, axis=1)))
        values["vector sum"] = seismogram.pvs
        values["time of vector sum"] = float(seismogram.times[longest])
    return values


def clipped_samples(samples: np.ndarray, full_scale: float | None) -> np.ndarray:
    """Mark the samples at full scale, or on a plateau where the full scale is unknown.

    Parameters
    ----------
    samples : (n_samples,) float64
    full_scale : float or None, same unit

    Returns
    -------
    (n_samples,) bool
    """
    size = np.abs(samples)
    if full_scale is not None:
        return size >= full_scale * (1.0 - FULL_SCALE_MARGIN)
    level = plateau_level(samples)
    return np.zeros(len(samples), bool) if level is None else at_level(size, level)


def at_level(size: np.ndarray, level: float) -> np.ndarray:
    """Mark sizes equal to a converter's level."""
    return np.abs(size - level) <= level * PLATEAU_MARGIN


def plateau_level(samples: np.ndarray) -> float | None:
    """Find the level at which a converter of unknown full scale has clipped.

    Three or more equal consecutive samples at the extreme count, unless they are what rounding
    makes of a smooth peak: the flank, continued over half of the plateau, must overshoot the
    level by more than 8 steps of the finest difference in the record (a parabola: 7 at most),
    and the level be at least 32 of them.
    """
    values = np.unique(samples)
    if len(values) < 3:
        return None
    step = np.min(np.diff(values))
    size = np.abs(samples)
    for extreme in (samples == values[-1], samples == values[0]):
        edges = np.flatnonzero(np.diff(np.concatenate([[0], extreme.astype(np.int8), [0]])))
        for first, last in zip(edges[::2], edges[1::2], strict=True):
            level = float(size[first])
            if last - first < PLATEAU or level < np.max(size) * (1.0 - PLATEAU_MARGIN):
                continue
            over = max(
                _overshoot(samples[:first][::-1], samples[first], last - first),
                _overshoot(samples[last:], samples[first], last - first),
            )
            if over > 8.0 * step and level >= 32.0 * step:
                return level
    return None


def _overshoot(flank, level, length):
    """Continue a flank, nearest sample first, to the middle of a plateau of that length."""
    reach = length // 2
    if len(flank) <= reach:
        return 0.0
    near, far = abs(flank[0] - level), abs(flank[reach] - level)
    return (far - near) / reach * 0.5 * (length + 1) - near


def is_dead(samples: np.ndarray) -> bool:
    """Tell whether a channel never moves."""
    return bool(np.all(samples == samples[0]))


def _within(name, printed: Printed, found, dt):
    """Judge one value by the tolerance of its kind."""
    if "time of" in name:
        return bool(abs(found - printed.value) <= printed.step + dt)
    share = FREQUENCY_TOLERANCE if "frequency" in name else TOLERANCE
    slack = share * abs(printed.value) + printed.step
    if printed.bound == ">":
        return bool(found >= printed.value - slack)
    if printed.bound == "<":
        return bool(found <= printed.value + slack)
    return bool(abs(found - printed.value) <= slack)
