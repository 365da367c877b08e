"""What a recorder makes of motion: operators on simulated seismograms, never on records.

Each operator is applied to velocity and gives what the recorder would have written. Transfer
functions are theory.md (7.6) and (7.7), in the convention of numpy.
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
PADS = 4


def recorded(seismogram: Seismogram, chain: Sequence[Operator]) -> Seismogram:
    """Return a seismogram as a chain of operators, the first nearest the ground, would record it.

    Examples
    --------
    >>> heard = recorded(motion, [geophone(4.5, 0.7), gain(1.02), clipping(0.254)])
    """
    for operator in chain:
        seismogram = operator(seismogram)
    return seismogram


def geophone(corner: float, damping: float = 0.7) -> Operator:
    """Return the operator of a geophone: a high-pass of second order for velocity; theory.md (7.6).

    Parameters
    ----------
    corner : float, Hz
    damping : float
        Share of critical damping.
    """
    _positive("geophone.corner", corner, "Hz")
    _positive("geophone.damping", damping, "")

    def response(frequency):
        ratio = frequency / corner
        return -(ratio**2) / (1.0 - ratio**2 + 2j * damping * ratio)

    return _filter(response)


def coupling(resonance: float, damping: float = 0.1) -> Operator:
    """Return the operator of a sensor that rocks on soft ground at a resonance in Hz; (7.7)."""
    _positive("coupling.resonance", resonance, "Hz")
    _positive("coupling.damping", damping, "")

    def response(frequency):
        ratio = frequency / resonance
        return (1.0 + 2j * damping * ratio) / (1.0 - ratio**2 + 2j * damping * ratio)

    return _filter(response)


def anti_alias(corner: float, order: int = 4, *, zero_phase: bool = False) -> Operator:
    """Return a Butterworth low-pass with a corner in Hz, causal as in a recorder, or zero-phase."""
    _positive("anti_alias.corner", corner, "Hz")

    def operate(seismogram):
        if corner >= 0.5 / seismogram.dt:
            return seismogram
        sections = butter(order, corner, fs=1.0 / seismogram.dt, output="sos")
        run = sosfiltfilt if zero_phase else sosfilt
        return replace(seismogram, velocity=run(sections, seismogram.velocity, axis=0))

    return operate


def gain(factors: ArrayLike) -> Operator:
    """Return the operator of a gain: a factor, or one for each component; -1 is polarity."""
    return lambda s: replace(s, velocity=s.velocity * np.asarray(factors, dtype=float))


def orientation(about_vertical: float, tilt: float = 0.0, towards: float = 0.0) -> Operator:
    """Return the operator of a sensor that stands askew; energy is kept.

    Parameters
    ----------
    about_vertical : float, rad
        By which it is turned clockwise, seen from above.
    tilt, towards : float, rad
        By how much it leans, and towards which bearing.
    """
    axis = tilt * np.array([np.cos(towards), -np.sin(towards), 0.0])
    turn = Rotation.from_rotvec(axis) * Rotation.from_euler("z", -about_vertical)
    matrix = turn.as_matrix()
    return lambda s: replace(s, velocity=s.velocity @ matrix)


def clock(shift: float = 0.0, drift: float = 0.0) -> Operator:
    """Return the operator of a clock: it writes motion ``shift + drift * time`` s too late."""

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
    """Return the operator of a recorder whose range ends at a velocity in m/s."""
    _positive("clipping.full_scale", full_scale, "m/s")
    return lambda s: replace(s, velocity=np.clip(s.velocity, -full_scale, full_scale))


def step(
    time: float, size: float, corner: float, damping: float = 0.7, component: int = 2
) -> Operator:
    """Return the operator that adds what a geophone writes of a step of acceleration.

    Parameters
    ----------
    time : float, s
        When the ground tilts or is knocked.
    size : float, m/s2
    corner, damping : float
        Of the geophone, Hz and share of critical, below one: theory.md (7.8).
    component : int
    """
    _positive("step.corner", corner, "Hz")
    if not 0.0 < damping < 1.0:
        raise InputError(f"recorder.step.damping: must lie between 0 and 1, got {damping:g}")

    def operate(seismogram):
        after = np.maximum(seismogram.times - time, 0.0)
        own = 2.0 * np.pi * corner
        turn = own * np.sqrt(1.0 - damping**2)
        velocity = seismogram.velocity.copy()
        fade = np.exp(-damping * own * after)
        velocity[:, component] += size * fade * np.sin(turn * after) / turn
        return replace(seismogram, velocity=velocity)

    return operate


def _filter(response):
    """Return an operator from a transfer function of frequency in Hz, conjugate convention."""

    def operate(seismogram):
        length = PADS * len(seismogram.velocity)
        frequency = np.fft.rfftfreq(length, seismogram.dt)
        spectrum = np.fft.rfft(seismogram.velocity, length, axis=0) * response(frequency)[:, None]
        filtered = np.fft.irfft(spectrum, length, axis=0)[: len(seismogram.velocity)]
        return replace(seismogram, velocity=filtered)

    return operate


def _positive(where, value, unit):
    """Refuse what is not positive."""
    if not 0.0 < value < np.inf:
        raise InputError(f"recorder.{where}: must be positive, got {value:g} {unit}".rstrip())
