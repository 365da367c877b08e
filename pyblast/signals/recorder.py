"""Responses to ground motion: of recorders and oscillators.

Operators of a recorder take and return a seismogram of velocity. Their transfer functions are
theory.md (7.6) and (7.7), in numpy's sign convention.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import ArrayLike

from ..errors import InputError
from .seismogram import Seismogram

Operator = Callable[[Seismogram], Seismogram]
PADDING = 4  # length of the transform over that of the record


def recorded(seismogram: Seismogram, chain: Sequence[Operator]) -> Seismogram:
    """Apply a chain of operators to a seismogram, from the ground to the file.

    Examples
    --------
    >>> import numpy as np
    >>> motion = Seismogram(np.ones((50, 3)), 1e-3)
    >>> recorded(motion, [gain(1.02), clipping(0.254)]).ppv.tolist()
    [0.254, 0.254, 0.254]
    """
    for operator in chain:
        seismogram = operator(seismogram)
    return seismogram


def geophone_response(corner: float, damping: float = 0.7) -> Operator:
    """Return the response of a geophone: second-order high-pass of velocity; theory.md (7.6).

    Parameters
    ----------
    corner : float, Hz
    damping : float
        Fraction of critical damping.
    """
    _positive("geophone.corner", corner, "Hz")
    _positive("geophone.damping", damping, "")

    def response(frequency):
        ratio = frequency / corner
        return -(ratio**2) / (1.0 - ratio**2 + 2j * damping * ratio)

    return _filter(response)


def coupling(resonance: float, damping: float = 0.1) -> Operator:
    """Return the coupling resonance (Hz) of a sensor on soft ground; theory.md (7.7)."""
    _positive("coupling.resonance", resonance, "Hz")
    _positive("coupling.damping", damping, "")

    def response(frequency):
        ratio = frequency / resonance
        return (1.0 + 2j * damping * ratio) / (1.0 - ratio**2 + 2j * damping * ratio)

    return _filter(response)


def anti_alias(corner: float, order: int = 4, *, zero_phase: bool = False) -> Operator:
    """Return an anti-alias filter: Butterworth low-pass (corner in Hz), causal or zero-phase."""
    _positive("anti_alias.corner", corner, "Hz")

    def operate(seismogram):
        if corner >= 0.5 / seismogram.dt:
            return seismogram
        sections = scipy.signal.butter(order, corner, fs=1.0 / seismogram.dt, output="sos")
        run = scipy.signal.sosfiltfilt if zero_phase else scipy.signal.sosfilt
        return replace(seismogram, velocity=run(sections, seismogram.velocity, axis=0))

    return operate


def gain(factors: ArrayLike) -> Operator:
    """Return a gain: one factor, or one per component; -1 reverses the polarity."""
    return lambda s: replace(s, velocity=s.velocity * np.asarray(factors, dtype=float))


def orientation(about_vertical: float, tilt: float = 0.0, towards: float = 0.0) -> Operator:
    """Return the rotation of a misoriented sensor, which preserves energy.

    Parameters
    ----------
    about_vertical : float, rad
        Clockwise, seen from above.
    tilt, towards : float, rad
        Angle by which the top of the sensor leans, and its bearing, clockwise from north.
    """
    axis = tilt * np.array([-np.cos(towards), np.sin(towards), 0.0])
    rotation = scipy.spatial.transform.Rotation
    turn = rotation.from_rotvec(axis) * rotation.from_euler("z", -about_vertical)
    matrix = turn.as_matrix()
    return lambda s: replace(s, velocity=s.velocity @ matrix)


def clock(shift: float = 0.0, drift: float = 0.0) -> Operator:
    """Return a clock error: motion is recorded ``shift + drift * time`` s late."""

    def operate(seismogram):
        times = (seismogram.times - shift) / (1.0 + drift)
        if drift == 0.0:
            return _filter(lambda f: np.exp(-2j * np.pi * f * shift))(seismogram)
        fine = np.stack([
            np.interp(times, seismogram.times, column, left=0.0, right=0.0)
            for column in seismogram.velocity.T
        ], axis=1)  # fmt: skip
        return replace(seismogram, velocity=fine)

    return operate


def clipping(full_scale: float) -> Operator:
    """Return clipping at the full scale of the recorder, m/s."""
    _positive("clipping.full_scale", full_scale, "m/s")
    return lambda s: replace(s, velocity=np.clip(s.velocity, -full_scale, full_scale))


def step(
    time: float, size: float, corner: float, damping: float = 0.7, component: int = 2
) -> Operator:
    """Return the added response of a geophone to a step of acceleration.

    Parameters
    ----------
    time : float, s
        Time of the step.
    size : float, m/s2
    corner, damping : float
        Of the geophone, Hz and fraction of critical, below one: theory.md (7.8).
    component : int
    """
    _positive("step.corner", corner, "Hz")
    if not 0.0 < damping < 1.0:
        raise InputError(f"recorder.step.damping: must lie between 0 and 1, got {damping:g}")

    def operate(seismogram):
        after = np.maximum(seismogram.times - time, 0.0)
        natural = 2.0 * np.pi * corner
        turn = natural * np.sqrt(1.0 - damping**2)
        velocity = seismogram.velocity.copy()
        decay = np.exp(-damping * natural * after)
        velocity[:, component] += size * decay * np.sin(turn * after) / turn
        return replace(seismogram, velocity=velocity)

    return operate


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
    times = seismogram.times
    peaks = np.full((2, len(hz), 3), np.nan)
    for n, f in enumerate(hz):
        fine = max(1, int(np.ceil(PEAK_SAMPLES * f * seismogram.dt)))
        after = np.ceil(fine * 0.5 / (f * seismogram.dt)).astype(int)  # half a period at rest
        dt = seismogram.dt / fine
        steps = fine * (len(times) - 1)
        grid = times[0] + dt * np.arange(steps + 1)
        for part in np.flatnonzero(seismogram.present):
            velocity = np.interp(grid, times, seismogram.velocity[:, part])
            slope = np.diff(velocity) / dt
            slope = np.concatenate([slope, np.zeros(after)])
            moved, speed = oscillator(slope, dt, f, damping)
            natural = 2.0 * np.pi * f
            absolute = 2.0 * damping * natural * speed + natural**2 * moved
            peaks[:, n, part] = np.abs(moved).max(), np.abs(absolute).max()
    return ResponseSpectra(hz, damping, *peaks)


def oscillator(
    acceleration: np.ndarray, dt: float, frequency: float, damping: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return how a damped oscillator moves over ground whose acceleration is constant by steps.

    Parameters
    ----------
    acceleration : (n,) float64, m/s2
        Of the ground in each step.
    dt, frequency, damping : float, s, Hz, fraction of critical below one

    Returns
    -------
    displacement, velocity : (n + 1,) float64, m and m/s
        Over the ground, from rest; exact at the ends of the steps: theory.md (16.1).
    """
    natural = 2.0 * np.pi * frequency
    turn, drag = natural * np.sqrt(1.0 - damping**2), damping * natural
    pole = np.exp(complex(-drag, turn) * dt)
    # z = u' - conj(s) u with the pole s obeys z' = s z - a.
    gain = (pole - 1.0) / complex(-drag, turn)
    z = np.concatenate([[0.0], scipy.signal.lfilter([1.0], [1.0, -pole], -gain * acceleration)])
    moved = np.imag(z) / turn
    return moved, np.real(z) - drag * moved


def _filter(response):
    """Return the operator of a transfer function of frequency in Hz."""

    def operate(seismogram):
        length = PADDING * len(seismogram.velocity)
        frequency = np.fft.rfftfreq(length, seismogram.dt)
        spectrum = np.fft.rfft(seismogram.velocity, length, axis=0) * response(frequency)[:, None]
        filtered = np.fft.irfft(spectrum, length, axis=0)[: len(seismogram.velocity)]
        return replace(seismogram, velocity=filtered)

    return operate


def _positive(where, value, unit):
    """Raise InputError for a value that is not positive."""
    if not 0.0 < value < np.inf:
        raise InputError(f"recorder.{where}: must be positive, got {value:g} {unit}".rstrip())
