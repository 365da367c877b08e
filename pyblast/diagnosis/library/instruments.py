"""Effects on an instrument: response, orientation, clock; theory.md (7.6) to (7.8)."""

import numpy as np
from scipy import fft
from scipy.interpolate import make_interp_spline

from ..hypotheses import (
    hypothesis,
    receivers,
    receivers_of_several_components,
    receivers_with_axes,
)
from ..trusted_shots import time_shifted

SWAP = "two sensors that change places, or a calibration pulse"
TAP = "a tap from a known side, or shots from three directions"


@hypothesis(
    "clock_error",
    family="instrument",
    on="motion",
    target="receiver",
    axis="blasts",
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
        targets={"east": receivers_with_axes, "north": receivers_with_axes,
                 "up": receivers_of_several_components, "all": receivers}[_form],
        decided_by=TAP,
    )(_flipped)  # fmt: skip


FEWEST = 6  # receivers on a line
STRAIGHT = 1e-3  # of its length, that receivers may stand beside it
PER_WAVE = 2.5  # receivers to the shortest S wave, at least


def receivers_on_a_line(case):
    """List the receivers, if all stand on one straight line, dense enough to interpolate."""
    positions = {r.name: np.array(r.position) for r in case.project.receivers}
    places = np.array([positions[name] for name in case.receivers])
    if len(places) < FEWEST:
        return ()
    along, beside = _along(places)
    slowest = min(material.cs for material in case.project.materials.values())
    gaps: np.ndarray = np.diff(np.sort(along))
    dense = gaps.min() > 0.0 and np.median(gaps) < slowest / (PER_WAVE * case.band.high)
    return case.receivers if dense and beside < STRAIGHT * np.ptp(along) else ()


def _along(places):
    """Return the places along a line through all, and how far one stands beside it."""
    centred = places - places.mean(axis=0)
    axis = np.linalg.svd(centred)[2][0]
    along = centred @ (axis * np.sign(axis[np.argmax(np.abs(axis))]))
    return along, np.max(np.linalg.norm(centred - np.multiply.outer(centred @ axis, axis), axis=1))


@hypothesis(
    "wrong_coordinates",
    form="along the line",
    family="receiver",
    on="motion",
    target="receiver",
    targets=receivers_on_a_line,
    axis="blasts",
    decided_by="a survey of the receiver",
)  # fmt: skip
def moved_along_line(scene, motion, target, along):
    """This receiver stood elsewhere on its line; motion there follows from its neighbours."""
    case = scene.case
    positions = {r.name: np.array(r.position) for r in case.project.receivers}
    places, _ = _along(np.array([positions[name] for name in case.receivers]))
    gain = np.ones(len(places)) if case.gain is None else case.gain
    at, order = case.receivers.index(target), np.argsort(places)
    spline = make_interp_spline(places[order], np.eye(len(places))[order], 3)
    stood = np.clip(places[at] + along, places.min(), places.max())
    weights = (spline(stood) - spline(places[at])) / gain * gain[at]
    alike = motion
    if case.clock is not None:
        alike = time_shifted(motion, (case.clock[at] - case.clock)[:, None], case.dt)
    return _with(motion, at, motion[:, at] + np.einsum("r,brct->bct", weights, alike))


AND = " and "


NEAR = 4  # other receivers with which one may have been swapped


def pairs_of_near_receivers(case):
    """List pairs of receivers that recorded a blast together, as "A and B".

    Each with those nearest to it, `NEAR` of them.
    """
    positions = {r.name: np.array(r.position) for r in case.project.receivers}
    places = np.array([positions[name] for name in case.receivers])
    recorded = case.valid.any(axis=(2, 3)).astype(int)
    distance = np.linalg.norm(places[:, None] - places, axis=-1)
    distance[(recorded.T @ recorded == 0) | np.eye(len(places), dtype=bool)] = np.inf
    nearest = np.argsort(distance, axis=1, kind="stable")[:, :NEAR]
    pairs = {
        (min(a, b), max(a, b))
        for a, others in enumerate(nearest.tolist())
        for b in others
        if np.isfinite(distance[a, b])
    }
    return tuple(f"{case.receivers[a]}{AND}{case.receivers[b]}" for a, b in sorted(pairs))


@hypothesis(
    "swapped_channels",
    family="instrument",
    on="motion",
    target="pair",
    targets=pairs_of_near_receivers,
    axis="blasts",
    single=True,
    decided_by="a tap beside each of the two receivers",
)
def swapped_channels(scene, motion, target, share):
    """Two receivers have changed places: each record has the name of the other."""
    a, b = (scene.case.receivers.index(name) for name in target.split(AND))
    between = share * (motion[:, b] - motion[:, a])
    return _with(_with(motion, a, motion[:, a] + between), b, motion[:, b] - between)


@hypothesis(
    "weak_coupling",
    family="instrument",
    on="motion",
    target="receiver",
    axis="blasts",
    decided_by="the same receiver after it was fastened or buried anew",
)  # fmt: skip
def weak_coupling(scene, motion, target, resonance, damping):
    """This receiver was loosely coupled to the ground: it resonates, and loses what is above."""

    def coupled(spectrum, frequency):
        s = 1j * frequency / resonance
        return spectrum * (1.0 + 2.0 * damping * s) / (1.0 + 2.0 * damping * s + s**2)

    return _filtered(scene, motion, target, coupled)


@hypothesis(
    "clipped_channel",
    family="instrument",
    on="motion",
    target="receiver",
    axis="blasts",
    decided_by="the raw samples of this channel, or a lower gain",
)
def clipped_channel(scene, motion, target, level):
    """This channel was clipped, at a share of the largest motion that it should have recorded."""
    at = scene.case.receivers.index(target)
    most = level * np.max(np.abs(motion[:, at]))
    return _with(motion, at, np.clip(motion[:, at], -most, most))


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
