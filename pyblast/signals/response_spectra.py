"""Response spectra: largest responses of oscillators that stand on a motion; theory.md (16.1)."""

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import ArrayLike

from ..errors import InputError
from .seismogram import Seismogram

PEAK_SAMPLES = 20.0  # a period, so that at most 1.2 % of a peak are lost
SPECTRAL_HZ = np.geomspace(1.0, 100.0, 61)


@dataclass(frozen=True, eq=False)
class ResponseSpectra:
    """Response spectra of a motion: largest responses of oscillators that stand on it.

    Parameters
    ----------
    frequency : (n,) float64, Hz
        Undamped natural frequencies.
    damping : float
        Fraction of critical.
    sd : (n, 3) float64, m
        Largest displacement of the mass over the ground; NaN for missing components.
    sa : (n, 3) float64, m/s2
        Largest absolute acceleration of the mass.
    """

    frequency: np.ndarray
    damping: float
    sd: np.ndarray
    sa: np.ndarray

    @property
    def psv(self) -> np.ndarray:
        """Pseudo-velocity ``2 pi f SD``, (n, 3) m/s."""
        return 2.0 * np.pi * self.frequency[:, None] * self.sd


def response_spectra(
    seismogram: Seismogram, frequency: ArrayLike | None = None, damping: float = 0.05
) -> ResponseSpectra:
    """Return the response spectra of a seismogram.

    Parameters
    ----------
    seismogram : Seismogram
        Ground velocity, taken as straight lines between samples.
    frequency : (n,) array_like, Hz, optional
        Default 61 from 1 to 100 Hz, as far as half the sampling rate.
    damping : float
        Fraction of critical, below one.

    Raises
    ------
    InputError
        If a frequency is not positive or damping lies outside of 0 to 1.

    Notes
    -----
    Exact for straight lines: Nigam and Jennings (1969), BSSA 59; theory.md (16.1).

    Examples
    --------
    >>> jump = Seismogram(np.repeat([[0.0], [1.0]], [1, 399], axis=0) * np.ones(3), 1e-3)
    >>> spectra = response_spectra(jump, [10.0], damping=0.0)
    >>> np.round(spectra.psv[0], 2).tolist()
    [1.0, 1.0, 1.0]
    """
    if frequency is None:
        frequency = SPECTRAL_HZ[0.5 / seismogram.dt > SPECTRAL_HZ]
    hz = np.atleast_1d(np.asarray(frequency, dtype=float))
    if not (hz > 0.0).all() or not np.isfinite(hz).all():
        raise InputError("response_spectra.frequency: must be positive")
    if not 0.0 <= damping < 1.0:
        raise InputError(f"response_spectra.damping: must lie from 0 to below 1, got {damping:g}")
    times, present = seismogram.times, np.flatnonzero(seismogram.present)
    peaks = np.full((2, len(hz), 3), np.nan)
    if not len(present):
        return ResponseSpectra(hz, damping, *peaks)
    for n, f in enumerate(hz):
        fine = max(1, int(np.ceil(PEAK_SAMPLES * f * seismogram.dt)))
        after = np.ceil(fine * 0.5 / (f * seismogram.dt)).astype(int)  # half a period at rest
        dt = seismogram.dt / fine
        steps = fine * (len(times) - 1)
        grid = times[0] + dt * np.arange(steps + 1)
        velocity = [np.interp(grid, times, seismogram.velocity[:, part]) for part in present]
        slope = np.diff(velocity, axis=1) / dt
        slope = np.concatenate([slope, np.zeros((len(present), after))], axis=1)
        moved, speed = oscillator(slope, dt, f, damping)
        natural = 2.0 * np.pi * f
        absolute = 2.0 * damping * natural * speed + natural**2 * moved
        peaks[:, n, present] = np.abs(moved).max(axis=1), np.abs(absolute).max(axis=1)
    return ResponseSpectra(hz, damping, *peaks)


def oscillator(
    acceleration: np.ndarray, dt: float, frequency: float, damping: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return how a damped oscillator moves over ground whose acceleration is constant by steps.

    Parameters
    ----------
    acceleration : (..., n) float64, m/s2
        Of the ground in each step.
    dt, frequency, damping : float, s, Hz, fraction of critical below one

    Returns
    -------
    displacement, velocity : (..., n + 1) float64, m and m/s
        Over the ground, from rest; exact at the ends of the steps: theory.md (16.1).
    """
    natural = 2.0 * np.pi * frequency
    turn, drag = natural * np.sqrt(1.0 - damping**2), damping * natural
    pole = np.exp(complex(-drag, turn) * dt)
    # z = u' - conj(s) u with the pole s obeys z' = s z - a.
    gain = (pole - 1.0) / complex(-drag, turn)
    z = scipy.signal.lfilter([1.0], [1.0, -pole], -gain * np.asarray(acceleration))
    z = np.concatenate([np.zeros((*z.shape[:-1], 1)), z], axis=-1)
    moved = np.imag(z) / turn
    return moved, np.real(z) - drag * moved
