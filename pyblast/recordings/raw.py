"""Raw records: units, sampling, clipping, dead channels, offsets, printed peak values."""

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import scipy

from ..errors import InputError, ReadError
from ..readers.cells import NumberFormat, number, plain_word, unit_factor, unit_name
from ..readers.tables import regular_step
from ..signals.seismogram import Seismogram
from ..signals.spectra import zero_crossing_frequency

MAX_FILE_BYTES = 2_000_000_000
SLOWEST_RATE, FASTEST_RATE = 10.0, 1e8
_QUANTITY = re.compile(r"([<>]?)\s*([-+]?[\d.,]*\d(?:[eE][-+]?\d+)?)\s*(.*)")


class Printed(NamedTuple):
    """Value printed by the instrument: SI value, step of its last digit, and "<", ">" or ""."""

    value: float
    step: float
    bound: str = ""


@dataclass(frozen=True)
class RawRecord:
    """Raw record: samples and header as read, before checks and rotation.

    Parameters
    ----------
    channels : dict of str to (n_samples,) float64, m/s (counts where ``unit`` says so)
        Keys are component names: longitudinal, transverse, vertical, east, north.
    dt : float, s
    start : float, s
        Time of the first sample, from the trigger or from the given time zero.
    full_scale : float or None, same unit as the samples
    time : str
        ISO time stamp of the file.
    printed : dict of str to Printed
        Values computed by the instrument, for the self-check.
    unit : str
        "m_per_s", or "counts" while the instrument response is still in the samples.
    microphone : (n_samples,) float64, Pa, or None
        Air overpressure.
    notes : tuple of str
        Remarks of the reader.
    low_passed : float or None, Hz
        Of a run, as in a `Seismogram`.
    """

    channels: dict[str, np.ndarray]
    dt: float
    start: float = 0.0
    label: str = ""
    instrument: str = ""
    serial: str = ""
    full_scale: float | None = None
    time: str = ""
    header: dict[str, Any] = field(default_factory=dict)
    printed: dict[str, Printed] = field(default_factory=dict)
    unit: str = "m_per_s"
    microphone: np.ndarray | None = None
    notes: tuple[str, ...] = ()
    low_passed: float | None = None


def velocity_factor(symbol: str, where: str) -> float:
    """Return the factor to m/s; raise ReadError unless the unit is one of velocity."""
    if not unit_name(symbol).endswith("_per_s") and not symbol.strip().lower().endswith("/s"):
        raise ReadError(f"{where}: expected a unit of velocity such as mm/s, got '{symbol[:40]}'")
    return unit_factor(symbol, where)


def quantity(text: str, where: str, unit: str = "") -> Printed | None:
    """Parse a quantity such as ``12.5 mm/s`` or ``>100 Hz`` into SI; None if not measured."""
    if text.strip().lower() in ("", "n/a", "na", "-", "--", "---", "oorange", "off", "none"):
        return None
    match = _QUANTITY.fullmatch(text.strip())
    if match is None:
        raise ReadError(f"{where}: expected a number with a unit, got '{text.strip()[:40]}'")
    bound, digits, words = match.groups()
    decimal = "," if "," in digits else "."
    first = words.split()[:1]  # "sec at 1024 sps" is a time
    symbol = first[0] if first and not unit_name(words) and unit_name(first[0]) else words or unit
    factor = unit_factor(symbol, where) if symbol else 1.0
    mantissa = re.split("[eE]", digits)[0]
    decimals = len(mantissa.partition(decimal)[2])
    value = number(digits, where, NumberFormat(decimal))
    return Printed(value * factor, 10.0**-decimals * factor, bound)


def sampling_step(rate: float, where: str) -> float:
    """Return the sampling interval of a plausible sampling rate."""
    if not SLOWEST_RATE <= rate <= FASTEST_RATE:
        raise ReadError(
            f"{where}: sampling rate must lie between {SLOWEST_RATE:g} and "
            f"{FASTEST_RATE:g} Hz, got {rate:g}"
        )
    return 1.0 / rate


def uniform_step(
    path: Path, times: np.ndarray, lines: list[int], rate: float | None = None, digit: float = 0.0
) -> float:
    """Return the sampling interval of a time column, checked for gaps and the stated rate.

    Times printed in steps of ``digit`` s may lie within half of it off a regular grid.
    """
    growth = (times[-1] - times[0]) / (len(times) - 1)
    if growth <= 0.0:
        raise ReadError(f"{path}, line {lines[-1]}: time must grow, got {times[-1]:g} s")
    growth, odd = regular_step(times, max(digit, 2e-3 if rate else 0.0))
    if odd is not None:
        steps = np.diff(times)
        raise ReadError(
            f"{path}, line {lines[odd]}: time must grow by equal steps of "
            f"{float(np.median(steps)):.6g} s, here it grows by {steps[odd - 1]:.6g} s; where the "
            "column is rounded, give sampling_rate_hz by a mapping"
        )
    dt = sampling_step(1.0 / growth, f"{path}, time column")
    if rate is None:
        return dt
    if abs(growth * rate - 1.0) > 0.01 + 1e-3 * rate / len(times):
        raise ReadError(
            f"{path}: sampling rate is stated as {rate:g} Hz, the time column says {1.0 / growth:g}"
        )
    return sampling_step(rate, f"{path}, sampling rate")


def common_velocity_factor(symbols: list[str], where: str) -> float:
    """Return the factor to m/s of columns that share one unit."""
    if len({symbol.lower() for symbol in symbols}) > 1:
        raise InputError(f"{where}: components must share one unit, got {', '.join(symbols)}")
    return velocity_factor(symbols[0], where)


def integrated_to_velocity(acceleration: np.ndarray, dt: float) -> tuple[np.ndarray, str]:
    """Return the velocity (n_samples,) in m/s of an acceleration less its mean, and a note of it.

    Parameters
    ----------
    acceleration : (n_samples,) float64, m/s2
    dt : float, s
    """
    level = acceleration.mean()
    velocity = scipy.integrate.cumulative_simpson(acceleration - level, dx=dt, initial=0.0)
    return velocity, f"integrated from acceleration less its mean of {level:.3g} m/s2"


TOLERANCE = 0.01
FREQUENCY_TOLERANCE = 0.03
PLATEAU = 3
FULL_SCALE_MARGIN = 5e-4
PLATEAU_MARGIN = 1e-6
ONE_SIDED = 0.5  # of the largest sample, below which a flat side is rest


def check_printed(
    printed: dict[str, Printed], seismogram: Seismogram
) -> tuple[tuple[str, float, float, bool], ...]:
    """Compare the values printed by the instrument with those of the samples.

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
    computed = device_values(seismogram) if printed else {}
    return tuple(
        (name, value.value, computed[name], _within(name, value, computed[name], seismogram.dt))
        for name, value in printed.items()
        if np.isfinite(computed.get(name, np.nan))
    )


def device_values(seismogram: Seismogram) -> dict[str, float]:
    """Return the values that a blast seismograph prints, by its definitions (SI)."""
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


def clipped_samples(
    channels: np.ndarray, full_scale: float | None = None
) -> tuple[np.ndarray, float | None]:
    """Return which samples are clipped: at full scale, or on a flat top at any level.

    Parameters
    ----------
    channels : (n_channels, n_samples) float64
        Of one converter: a flat top in one of them holds for all.
    full_scale : float or None, same unit

    Returns
    -------
    clipped : (n_channels, n_samples) bool
    full_scale : float or None
        As given, else the highest flat top.
    """
    size = np.abs(channels)
    levels = [level for samples in channels for level in _flat_tops(samples)]
    clipped = np.zeros(size.shape, bool)
    for level in levels:
        clipped |= np.abs(size - level) <= level * PLATEAU_MARGIN
    if full_scale is None:
        return clipped, max(levels, default=None)
    return clipped | (size >= full_scale * (1.0 - FULL_SCALE_MARGIN)), full_scale


def _flat_tops(samples):
    """Return the levels at which the highest and the lowest samples are cut off.

    A flat top is three or more equal consecutive samples at an extreme, unless a smooth peak
    rounded to digits looks the same: the flank, extrapolated over half of the plateau, must exceed
    the level by more than 8 digits (a parabola: at most 7), and the level must be at least 32
    digits. With an offset of the zero the two sides are cut at levels of their own.
    """
    values = np.unique(samples)
    if len(values) < 3:
        return
    step = np.min(np.diff(values))
    for top in (values[-1], values[0]):
        edges = np.flatnonzero(
            np.diff(np.concatenate([[0], (samples == top).astype(np.int8), [0]]))
        )
        for first, last in zip(edges[::2], edges[1::2], strict=True):
            length, level = last - first, abs(float(top))
            if length < PLATEAU or level < max(32.0 * step, ONE_SIDED * np.max(np.abs(values))):
                continue
            flanks = samples[:first][::-1], samples[last:]
            if max(_overshoot(flank, top, length) for flank in flanks) > 8.0 * step:
                yield level
                break


def _overshoot(flank, level, length):
    """Extrapolate a flank, nearest sample first, to the middle of a plateau of a length."""
    reach = length // 2
    if len(flank) <= reach:
        return 0.0
    near, far = abs(flank[0] - level), abs(flank[reach] - level)
    return (far - near) / reach * 0.5 * (length + 1) - near


LONE, FEWEST = 20.0, 50  # ratio to the largest of all other samples; samples of a record


def lone_spike(samples: np.ndarray) -> int | None:
    """Return the first sample of a level that no motion reaches in one step, None if there is none.

    Such a level exceeds all others of a record ``LONE`` times: a mark of missing samples.

    Examples
    --------
    >>> motion = np.sin(np.linspace(0.0, 20.0, 200))
    >>> lone_spike(motion), lone_spike(np.where(np.arange(200) == 7, -999.9, motion))
    (None, 7)
    """
    size = np.abs(samples)
    top = float(np.max(size))
    others = size[size < top * (1.0 - PLATEAU_MARGIN)]
    if len(size) < FEWEST or not len(others) or not 0.0 < np.max(others) < top / LONE:
        return None
    return int(np.argmax(size))


def is_dead(samples: np.ndarray) -> bool:
    """Return whether a channel is dead: all samples equal."""
    return bool(np.all(samples == samples[0]))


def _within(name, printed: Printed, value, dt):
    """Return whether a printed value agrees with that of the samples."""
    if "time of" in name:
        return bool(abs(value - printed.value) <= printed.step + dt)
    share = FREQUENCY_TOLERANCE if "frequency" in name else TOLERANCE
    slack = share * abs(printed.value) + printed.step
    if printed.bound == ">":
        return bool(value >= printed.value - slack)
    if printed.bound == "<":
        return bool(value <= printed.value + slack)
    return bool(abs(value - printed.value) <= slack)


QUIET_SHARE, SHORTEST_QUIET = 0.1, 16  # of a record at either end, and in samples
LEAST_OFFSET, LARGEST_CHANGE = 0.05, 0.3  # of the peak; of the offset, between the two ends


def constant_offset(samples: np.ndarray) -> float:
    """Return the constant offset of a channel, 0 where there is none or it is not sure.

    Parameters
    ----------
    samples : (n_samples,) float64

    Returns
    -------
    float
        Mean of the medians of the first and the last tenth, where these differ by at most 30 % of
        it and it exceeds 5 % of the peak about it.

    Examples
    --------
    >>> pulse = np.zeros(400)
    >>> pulse[100:200] = np.sin(np.linspace(0.0, 20.0, 100))
    >>> constant_offset(pulse), round(constant_offset(pulse + 0.2), 9)
    (0.0, 0.2)
    """
    n = int(QUIET_SHARE * len(samples))
    if n < SHORTEST_QUIET or not np.all(np.isfinite(samples)) or is_dead(samples):
        return 0.0
    first, last = float(np.median(samples[:n])), float(np.median(samples[-n:]))
    level = 0.5 * (first + last)
    if abs(first - last) > LARGEST_CHANGE * abs(level):
        return 0.0
    peak = float(np.max(np.abs(samples - level)))
    return level if abs(level) > LEAST_OFFSET * peak else 0.0


REFERENCE_PRESSURE = 20e-6  # Pa, of decibels in air
_DECIBELS = ("db", "dbl", "dblin", "dblinear", "dbz", "dbspl")
_PRESSURES = {"psi": 6894.757293168, "mbar": 100.0, "mb": 100.0, "hpa": 100.0, "bar": 1e5}


def overpressure(samples: np.ndarray, unit: str, where: str) -> np.ndarray:
    """Return samples of a microphone in Pa.

    Parameters
    ----------
    samples : (n_samples,) float64
    unit : str
        Pa, kPa, hPa, mbar, psi, or dB(L): linear decibels above 20 µPa, whose sign is lost.
    where : str
        For messages.

    Raises
    ------
    ReadError
        If the unit is none of pressure.
    """
    plain = plain_word(unit.split("(")[0])  # (L), linear weighting, changes nothing
    if plain in _DECIBELS:
        return REFERENCE_PRESSURE * 10.0 ** (samples / 20.0)
    factor = _PRESSURES.get(plain) or {"pa": 1.0, "kpa": 1e3}.get(plain)
    if factor is None:
        raise ReadError(
            f"{where}: the microphone must be in Pa, kPa, mbar, psi or dB(L), got '{unit[:40]}'"
        )
    return factor * samples


def decibels(pressure: float) -> float:
    """Return a peak of air overpressure in dB(L), 20 log10 (p / 20 µPa).

    Examples
    --------
    >>> round(decibels(20.0), 1)
    120.0
    """
    return 20.0 * float(np.log10(max(abs(pressure), 1e-12) / REFERENCE_PRESSURE))
