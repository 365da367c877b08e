"""What may be wrong with a receiver: its response, its orientation, its clock."""

import numpy as np
from scipy import fft

from ..hypotheses import Knob, hypothesis


@hypothesis(
    "clock_error", family="instrument", on="motion", target="receiver", axis="blasts",
    knobs=[Knob("shift", 0.0, 10e-3, "s", starts=(0.0, 8e-3, -8e-3), low=-0.2, high=0.2)],
)  # fmt: skip
def clock_error(scene, motion, target, shift):
    """The clock of this receiver was wrong: all it recorded came late or early by the same time."""

    def late(spectrum, frequency):
        return spectrum * np.exp(-2j * np.pi * frequency * shift)

    return _filtered(scene, motion, target, late)


@hypothesis(
    "instrument_response", family="instrument", on="motion", target="receiver", axis="blasts",
    knobs=[
        Knob("corner", 4.5, 0.5, "Hz", log=True, starts=(2.0, 4.5, 8.0), low=0.5, high=20.0),
        Knob("damping", 0.6, 0.3, log=True, starts=(0.6,), low=0.1, high=2.0),
        Knob("gain", 1.0, 0.2, log=True, starts=(1.0,), low=0.2, high=5.0),
    ],
)  # fmt: skip
def instrument_response(scene, motion, target, corner, damping, gain):
    """The record of this receiver still has the response of a geophone in it."""

    def sensed(spectrum, frequency):
        s = 1j * frequency / corner
        return spectrum * gain * s**2 / (1.0 + 2.0 * damping * s + s**2)

    return _filtered(scene, motion, target, sensed)


@hypothesis(
    "sensor_orientation", family="instrument", on="motion", target="receiver", axis="blasts",
    knobs=[
        Knob("turn", 0.0, 1.0, "rad", starts=(0.3, -0.3, 1.57, -1.57, 3.1), low=-3.3, high=3.3)
    ],
)  # fmt: skip
def sensor_orientation(scene, motion, target, turn):
    """The horizontal components of this receiver did not point where the file says."""
    at = scene.case.receivers.index(target)
    east, north, up = np.moveaxis(motion[:, at], 1, 0)
    turned = np.cos(turn) * east - np.sin(turn) * north, np.sin(turn) * east + np.cos(turn) * north
    return _with(motion, at, np.stack([*turned, up], axis=1))


for _number, _component in enumerate(("east", "north", "up")):

    def _flipped(scene, motion, target, factor, number=_number):
        """One component of this receiver has the wrong sign or gain."""
        at = scene.case.receivers.index(target)
        changed = motion[:, at].copy()
        changed[:, number] *= factor
        return _with(motion, at, changed)

    hypothesis(
        f"polarity_{_component}", family="instrument", on="motion", target="receiver",
        axis="blasts", knobs=[Knob("factor", 1.0, 1.0, starts=(-1.0,), low=-3.0, high=3.0)],
    )(_flipped)  # fmt: skip


def _filtered(scene, motion, target, change):
    """Change the spectrum of one receiver."""
    at, n = scene.case.receivers.index(target), motion.shape[-1]
    size = fft.next_fast_len(2 * n, real=True)
    frequency = fft.rfftfreq(size, scene.case.dt)
    changed = fft.irfft(change(fft.rfft(motion[:, at], size), frequency), size)[..., :n]
    return _with(motion, at, changed)


def _with(motion, at, changed):
    """Return motion with that of one receiver changed."""
    motion = motion.copy()
    motion[:, at] = changed
    return motion
