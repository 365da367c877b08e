"""Recorder response: operators that turn simulated ground motion into a recording.

Each operator takes and returns a seismogram of velocity. The transfer functions are theory.md (7.6)
and (7.7), in numpy's sign convention.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.signal import butter, sosfilt, sosfiltfilt
from scipy.spatial.transform import Rotation

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


def geophone(corner: float, damping: float = 0.7) -> Operator:
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
        sections = butter(order, corner, fs=1.0 / seismogram.dt, output="sos")
        run = sosfiltfilt if zero_phase else sosfilt
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
    turn = Rotation.from_rotvec(axis) * Rotation.from_euler("z", -about_vertical)
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
