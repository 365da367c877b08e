"""Shots along a line: usable channels, filter, shift, correlation; decision of a test."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy import fft, signal

from ..errors import InputError
from ..recordings.recording import Gather

EDGE = 0.05


@dataclass(frozen=True, eq=False)
class ShotGather:
    """Shot: its motion at the usable receivers of a line, in the order of their positions.

    Parameters
    ----------
    motion : (n_receivers, n_samples) float64
    places : (n_receivers,) float64, m
        Coordinates along the line, increasing.
    source : float, m
    offsets : (n_receivers,) float64, m
        Distances from the source; on a crooked line they differ from those along it.
    dt, start : float, s
    channels : (n_receivers,) int
        Of the gather.
    """

    motion: np.ndarray
    places: np.ndarray
    source: float
    offsets: np.ndarray
    dt: float
    start: float
    channels: np.ndarray

    @property
    def times(self) -> np.ndarray:
        """Time of each sample, (n_samples,) s."""
        return self.start + self.dt * np.arange(self.motion.shape[1])

    def banded(self, band: tuple[float, float]) -> "ShotGather":
        """Band-pass without phase shift, after detrending and tapering."""
        if not 0.0 < band[0] < band[1] < 0.5 / self.dt:
            raise InputError(
                f"shot.band: must rise and stay below {0.5 / self.dt:g} Hz, got {band}"
            )
        motion = signal.detrend(self.motion, axis=1)
        motion = motion * signal.windows.tukey(motion.shape[1], EDGE)
        sos = signal.butter(4, band, "bandpass", fs=1.0 / self.dt, output="sos")
        return replace(self, motion=signal.sosfiltfilt(sos, motion, axis=1))

    def only(self, receivers: slice | np.ndarray) -> "ShotGather":
        """Select receivers by their order."""
        parts = (x[receivers] for x in (self.motion, self.places, self.offsets, self.channels))
        motion, places, offsets, channels = parts
        return replace(self, motion=motion, places=places, offsets=offsets, channels=channels)


def shot_of(
    gather: Gather,
    places: ArrayLike | None = None,
    source: float | None = None,
    offsets: ArrayLike | None = None,
) -> ShotGather:
    """Turn a gather into a shot: its channels that are neither dead nor clipped, along the line.

    Parameters
    ----------
    gather : Gather
    places : (n_channels,) float, m, optional
        Coordinates along the line; by default the x of the headers.
    source : float, m, optional
    offsets : (n_channels,) float, m, optional
    """
    places = np.asarray(gather.receiver_positions[:, 0] if places is None else places, float)
    source = float(gather.source_position[0]) if source is None else source
    offsets = np.asarray(np.abs(places - source) if offsets is None else offsets, float)
    usable = np.flatnonzero(~gather.dead & ~gather.clipped.any(axis=1))
    order = usable[np.argsort(places[usable], kind="stable")]
    if not np.isfinite(places[order]).all() or not np.isfinite(offsets[order]).all():
        raise InputError(f"{gather.label}: the positions of its receivers are unknown; pass places")
    return ShotGather(
        gather.data[order], places[order], source, offsets[order], gather.dt, gather.start, order
    )


def shifted(motion: np.ndarray, seconds: ArrayLike, dt: float) -> np.ndarray:
    """Delay rows (..., n) by seconds (...,): band-limited shift without wrap-around."""
    n = np.shape(motion)[-1]
    size = fft.next_fast_len(2 * n, real=True)
    turns = np.exp(-2j * np.pi * fft.rfftfreq(size, dt) * np.asarray(seconds)[..., None])
    return fft.irfft(fft.rfft(motion, size) * turns, size)[..., :n]


def correlation(
    first: np.ndarray, second: np.ndarray, reach: float, dt: float, finer: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return lags (n,) s up to reach, and the correlation of the second with the first at them."""
    n = len(first)
    size = fft.next_fast_len(2 * n, real=True)
    cross = fft.rfft(second, size) * fft.rfft(first, size).conj()
    fine = finer * fft.irfft(cross, finer * size)
    most = int(reach / dt * finer)
    index = np.arange(-most, most + 1)
    scale = np.linalg.norm(first) * np.linalg.norm(second)
    return index * dt / finer, fine[index] / max(scale, np.finfo(float).tiny)


OUTCOMES = ("NAMED", "CLASS", "UNKNOWN", "NULL")
SIGNIFICANCE = 0.05
NEEDED = 0.5  # of what an effect could explain of held-out records, for a name


@dataclass(frozen=True)
class EffectDecision:
    """Decision of a test for one effect: outcome, location, size and significance.

    Parameters
    ----------
    outcome : str
        One of `OUTCOMES`. "UNKNOWN": significant, but no label fits. "CLASS": several labels fit
        and these records can't separate them.
    label : str
        The effect that was tested; of a class several, joined by " | ".
    reason : str
        One sentence.
    target : tuple
        Channels, from 0, or names.
    parameters : dict of str to (value, low, high), SI
        With 90 % intervals.
    window : tuple of 2 float, s, or None
        After correction for the moveout in the parameters.
    band : tuple of 2 float, Hz, or None
    p_value : float
        Share of surrogate records without the effect that show it as clearly.
    held_out : tuple of 2 float, or None
        Share of energy (or another score, see the test) explained without and with the effect,
        in held-out records.
    """

    outcome: str
    label: str
    reason: str
    target: tuple = ()
    parameters: dict = field(default_factory=dict)
    window: tuple[float, float] | None = None
    band: tuple[float, float] | None = None
    p_value: float = 1.0
    held_out: tuple[float, float] | None = None


def phase_randomised(samples: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return phase-randomised surrogates (..., n): the same amplitude spectrum, random phases."""
    spectrum = fft.rfft(samples, axis=-1)
    turns = rng.uniform(0.0, 2.0 * np.pi, spectrum.shape)
    turns[..., 0] = 0.0
    return fft.irfft(np.abs(spectrum) * np.exp(1j * turns), samples.shape[-1], axis=-1)


def permutation_p(statistic: float, drawn: Sequence[float]) -> float:
    """Return the p-value of a permutation test: share of draws as large, the observed included."""
    return float((1 + np.count_nonzero(np.asarray(drawn) >= statistic)) / (1 + len(drawn)))


def interval(
    values: Sequence[float] | np.ndarray, share: float = 0.9
) -> tuple[float, float, float]:
    """Return the median and the central interval that holds this share of values."""
    low, middle, high = np.quantile(values, [0.5 - 0.5 * share, 0.5, 0.5 + 0.5 * share])
    return float(middle), float(low), float(high)


def jackknifed(estimates: ArrayLike) -> tuple[float, float, float]:
    """Return mean and 90 % jackknife interval of estimates without each part in turn."""
    estimates = np.asarray(estimates, dtype=float)
    n = len(estimates)
    sigma = np.sqrt((n - 1) / n * np.sum((estimates - estimates.mean()) ** 2))
    middle = float(estimates.mean())
    return middle, float(middle - 1.645 * sigma), float(middle + 1.645 * sigma)
