"""Shots along a line of receivers: band, shift, correlation, stack; decision on one effect."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy import fft, signal

from ..errors import InputError
from ..recordings.gather import Gather

EDGE = 0.05


@dataclass(frozen=True, eq=False)
class Shot:
    """Motion of one shot at usable receivers of a line, ordered by place.

    Parameters
    ----------
    motion : (n_receivers, n_samples) float64
    places : (n_receivers,) float64, m
        Along the line, growing.
    source : float, m
    offsets : (n_receivers,) float64, m
        Distance from the source; differs from the places where the line is crooked.
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

    def banded(self, band: tuple[float, float]) -> "Shot":
        """Keep a band without phase shift, ends brought to rest."""
        if not 0.0 < band[0] < band[1] < 0.5 / self.dt:
            raise InputError(
                f"shot.band: must grow and stay below {0.5 / self.dt:g} Hz, got {band}"
            )
        motion = signal.detrend(self.motion, axis=1)
        motion = motion * signal.windows.tukey(motion.shape[1], EDGE)
        sos = signal.butter(4, band, "bandpass", fs=1.0 / self.dt, output="sos")
        return replace(self, motion=signal.sosfiltfilt(sos, motion, axis=1))

    def only(self, receivers: slice | np.ndarray) -> "Shot":
        """Keep some receivers, by their order."""
        parts = (x[receivers] for x in (self.motion, self.places, self.offsets, self.channels))
        motion, places, offsets, channels = parts
        return replace(self, motion=motion, places=places, offsets=offsets, channels=channels)


def shot_of(
    gather: Gather,
    places: ArrayLike | None = None,
    source: float | None = None,
    offsets: ArrayLike | None = None,
) -> Shot:
    """Return the channels of a gather that move and never clip, ordered along the line.

    Parameters
    ----------
    gather : Gather
    places : (n_channels,) float, m, optional
        Along the line, where the headers do not tell, or the x of the headers.
    source : float, m, optional
    offsets : (n_channels,) float, m, optional
    """
    places = np.asarray(gather.receiver_positions[:, 0] if places is None else places, float)
    source = float(gather.source_position[0]) if source is None else source
    offsets = np.asarray(np.abs(places - source) if offsets is None else offsets, float)
    usable = np.flatnonzero(~gather.dead & ~gather.clipped.any(axis=1))
    order = usable[np.argsort(places[usable], kind="stable")]
    if not np.isfinite(places[order]).all() or not np.isfinite(offsets[order]).all():
        raise InputError(f"{gather.label}: the places of its receivers are not known, pass places")
    return Shot(
        gather.data[order], places[order], source, offsets[order], gather.dt, gather.start, order
    )


def shifted(motion: np.ndarray, seconds: ArrayLike, dt: float) -> np.ndarray:
    """Delay rows (..., n) by seconds (...,), band-limited; what leaves comes not back."""
    n = np.shape(motion)[-1]
    size = fft.next_fast_len(2 * n, real=True)
    turns = np.exp(-2j * np.pi * fft.rfftfreq(size, dt) * np.asarray(seconds)[..., None])
    return fft.irfft(fft.rfft(motion, size) * turns, size)[..., :n]


def correlation(
    first: np.ndarray, second: np.ndarray, reach: float, dt: float, finer: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return lags (n,) s within reach and the correlation of second, late by them, with first."""
    n = len(first)
    size = fft.next_fast_len(2 * n, real=True)
    cross = fft.rfft(second, size) * fft.rfft(first, size).conj()
    fine = finer * fft.irfft(cross, finer * size)
    most = int(reach / dt * finer)
    index = np.arange(-most, most + 1)
    scale = np.linalg.norm(first) * np.linalg.norm(second)
    return index * dt / finer, fine[index] / max(scale, np.finfo(float).tiny)


OUTCOMES = ("NAMED", "CLASS", "UNKNOWN", "NULL")
SURE = 0.05


@dataclass(frozen=True)
class Verdict:
    """Decision on one effect: what was found, where, and how certain it is.

    Parameters
    ----------
    outcome : str
        Of `OUTCOMES`: "UNKNOWN" is something that is no chance and fits no label, "CLASS" fits
        several that these records can't separate.
    label : str
        Of the effect that was looked for; several, joined by " | ", in a class.
    reason : str
        One sentence.
    target : tuple
        Channels, from 0, or names.
    parameters : dict of str to (value, low, high), SI
        With 90 % intervals.
    window : tuple of 2 float, s, or None
        After the moveout in the parameters.
    band : tuple of 2 float, Hz, or None
    chance : float
        Share of surrogates that show the effect as clearly.
    held_out : tuple of 2 float, or None
        Share of energy (or other score, see the maker) explained without and with the effect, on
        records that it was not fitted to.
    """

    outcome: str
    label: str
    reason: str
    target: tuple = ()
    parameters: dict = field(default_factory=dict)
    window: tuple[float, float] | None = None
    band: tuple[float, float] | None = None
    chance: float = 1.0
    held_out: tuple[float, float] | None = None


def phase_randomised(samples: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return samples (..., n) of the same spectrum whose phases are drawn, each row its own."""
    spectrum = fft.rfft(samples, axis=-1)
    turns = rng.uniform(0.0, 2.0 * np.pi, spectrum.shape)
    turns[..., 0] = 0.0
    return fft.irfft(np.abs(spectrum) * np.exp(1j * turns), samples.shape[-1], axis=-1)


def share_as_large(found: float, drawn: Sequence[float]) -> float:
    """Return the share of draws, with the finding itself as one, that are as large."""
    return float((1 + np.count_nonzero(np.asarray(drawn) >= found)) / (1 + len(drawn)))


def interval(
    values: Sequence[float] | np.ndarray, share: float = 0.9
) -> tuple[float, float, float]:
    """Return median and the ends that hold this share of values."""
    low, middle, high = np.quantile(values, [0.5 - 0.5 * share, 0.5, 0.5 + 0.5 * share])
    return float(middle), float(low), float(high)


def jackknifed(estimates: ArrayLike) -> tuple[float, float, float]:
    """Return mean and 90 % interval of a value estimated without each part in turn."""
    estimates = np.asarray(estimates, dtype=float)
    n = len(estimates)
    sigma = np.sqrt((n - 1) / n * np.sum((estimates - estimates.mean()) ** 2))
    middle = float(estimates.mean())
    return middle, float(middle - 1.645 * sigma), float(middle + 1.645 * sigma)
