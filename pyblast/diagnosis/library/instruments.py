"""Effects on the instrument of a receiver: response, orientation, clock."""

import numpy as np
from scipy import fft

from ...inference.parameter import Parameter
from ..hypotheses import hypothesis, receivers_with_axes

SWAP = "two sensors that change places, or a calibration pulse"
TAP = "a tap from a known side, or shots from three directions"


@hypothesis(
    "clock_error",
    family="instrument",
    on="motion",
    target="receiver",
    axis="blasts",
    parameters=[
        Parameter(
            "shift",
            mean=0.0,
            sigma=10e-3,
            unit="s",
            starts=(0.0, 8e-3, -8e-3),
            low=-0.2,
            high=0.2,
            null=0.0,
        )
    ],
    decided_by="noise recorded together with a receiver of known clock",
)
def clock_error(scene, motion, target, shift):
    """The clock of this receiver was wrong: all it recorded came late or early by the same time."""

    def late(spectrum, frequency):
        return spectrum * np.exp(-2j * np.pi * frequency * shift)

    return _filtered(scene, motion, target, late)


@hypothesis(
    "instrument_response",
    form="geophone",
    family="instrument",
    on="motion",
    target="receiver",
    axis="blasts",
    parameters=[
        Parameter(
            "corner",
            mean=4.5,
            sigma=0.5,
            unit="Hz",
            log=True,
            starts=(2.0, 4.5, 8.0),
            low=0.5,
            high=20.0,
        ),
        Parameter("damping", mean=0.6, sigma=0.3, log=True, starts=(0.6,), low=0.1, high=2.0),
        Parameter("gain", mean=1.0, sigma=0.2, log=True, starts=(1.0,), low=0.2, high=5.0),
    ],
    decided_by=SWAP,
)
def geophone(scene, motion, target, corner, damping, gain):
    """The record of this receiver still has the response of a geophone in it."""

    def sensed(spectrum, frequency):
        s = 1j * frequency / corner
        return spectrum * gain * s**2 / (1.0 + 2.0 * damping * s + s**2)

    return _filtered(scene, motion, target, sensed)


@hypothesis(
    "instrument_response",
    form="gain",
    family="instrument",
    on="motion",
    target="receiver",
    axis="blasts",
    parameters=[
        Parameter(
            "gain", mean=1.0, sigma=0.7, log=True, starts=(0.5, 2.0), low=0.02, high=50.0, null=1.0
        )
    ],
    decided_by=SWAP,
)
def gain_error(scene, motion, target, gain):
    """The gain of this receiver is wrong by the same factor on all components."""
    at = scene.case.receivers.index(target)
    return _with(motion, at, gain * motion[:, at])


@hypothesis(
    "sensor_orientation_or_polarity",
    form="turned",
    family="instrument",
    on="motion",
    target="receiver",
    targets=receivers_with_axes,
    axis="blasts",
    parameters=[
        Parameter(
            "turn",
            mean=0.0,
            sigma=1.0,
            unit="rad",
            starts=(0.3, -0.3, 1.57, -1.57, 3.1),
            low=-3.3,
            high=3.3,
            null=0.0,
        ),
    ],
    decided_by=TAP,
)
def turned_sensor(scene, motion, target, turn):
    """The horizontals of this receiver are turned, clockwise if positive, from their axes."""
    at = scene.case.receivers.index(target)
    east, north, up = np.moveaxis(motion[:, at], 1, 0)
    turned = np.cos(turn) * east - np.sin(turn) * north, np.sin(turn) * east + np.cos(turn) * north
    return _with(motion, at, np.stack([*turned, up], axis=1))


for _components, _form in ((0, "east"), (1, "north"), (2, "up"), (slice(None), "all")):
    _parts = "All components" if _form == "all" else f"The {_form} component"

    def _flipped(scene, motion, target, factor, components=_components):
        at = scene.case.receivers.index(target)
        changed = motion[:, at].copy()
        changed[:, components] *= factor
        return _with(motion, at, changed)

    _flipped.__doc__ = f"{_parts} of this receiver had the wrong sign."
    hypothesis(
        "sensor_orientation_or_polarity", form=_form, family="instrument", on="motion",
        target="receiver", axis="blasts",
        targets=receivers_with_axes if _form in ("east", "north") else None,
        parameters=[Parameter("factor", mean=-1.0, sigma=0.3, starts=(-1.0,), low=-3.0, high=0.0)],
        decided_by=TAP,
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
