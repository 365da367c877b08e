"""Tracks: runs of linear models that keep the motion which their derivatives need."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from .. import core
from ..errors import InputError, SolverError
from ..model.model import Model
from ..signals.seismogram import Seismogram
from .loads import components
from .perturbation import face_nodes, faces, refuse_nonlinear, refuse_slip
from .preparation import LEDGER_EVERY, Prepared, prepare

STRETCH_VALUES = 2**23  # numbers that one stretch may hold: 64 MB


class Stretch(NamedTuple):
    """Motion over some steps.

    Parameters
    ----------
    first : int
        Step of the first sample, from 0; step k begins at time k dt.
    receivers : (n, n_receivers, 3) float64, m/s
        Of the model, at mid-steps.
    displacement : (n, n_nodes, 3) float64, m
        Of the chosen nodes, at the beginning of each step.
    before, after : (n, n_nodes, 3) float64, m/s
        Velocity half a step before and after.
    """

    first: int
    receivers: np.ndarray
    displacement: np.ndarray
    before: np.ndarray
    after: np.ndarray


class Watch:
    """A march that tells how chosen nodes move; its state changes in place.

    Parameters
    ----------
    constants, state : dict
        As in `Prepared`; the state is not copied.
    nodes : (n_nodes,) int
    """

    def __init__(self, constants, state, nodes):
        """Put a receiver at every chosen node, behind those of the model."""
        self._nodes, self._state, self._dt = np.asarray(nodes), state, constants["dt"]
        self._n_receivers = len(constants["receiver_node"])
        self._constants = core.to_fortran({**constants, **listening(constants, self._nodes)})

    def go(self, first, n_steps):
        """March from a step on; return the `Stretch`.

        Raises
        ------
        SolverError
            If the motion grows without cause.
        """
        start = self._state["displacement"][self._nodes]
        last = self._state["velocity"][self._nodes]
        return self._stretch(first, start, last, self._advance(self._constants, first, n_steps))

    def pushed(self, first, loads):
        """March under the loads of one stretch only, whose histories begin with its first step."""
        start = self._state["displacement"][self._nodes]
        last = self._state["velocity"][self._nodes]
        self._state["sums"][:] = 0.0  # the ledger of a stretch; its end is another's beginning
        constants = {**self._constants, **core.to_fortran(loads)}
        motion = self._advance(constants, 0, len(loads["history"]))
        return self._stretch(first, start, last, motion)

    def _advance(self, constants, first, n_steps):
        """March and return the motion (n_steps, n, 3) of receivers and nodes."""
        motion, _, failed = core.advance(constants, self._state, first, n_steps, LEDGER_EVERY)
        if failed is not None:
            raise SolverError(f"march: the motion grew without limit at step {first + len(motion)}")
        return motion

    def _stretch(self, first, start, last, motion):
        """Add up velocities to displacements."""
        after = motion[:, self._n_receivers : self._n_receivers + len(self._nodes)]
        before = np.concatenate([last[None], after[:-1]])
        displacement = start + self._dt * (np.cumsum(after, axis=0) - after)
        receivers = motion[:, : self._n_receivers]
        return Stretch(first, receivers, displacement, before, after)


def listening(constants, nodes):
    """Return the receivers of a model, and behind them one at every chosen node."""
    corners = constants["receiver_node"].shape[1]  # or all nodes of a quadratic zone
    node, weight = np.repeat(np.asarray(nodes)[:, None], corners, axis=1), np.eye(corners)[:1]
    weight = weight.repeat(len(node), axis=0)
    return {
        "receiver_node": np.concatenate([constants["receiver_node"], node]).astype(np.int32),
        "receiver_weight": np.concatenate([constants["receiver_weight"], weight]),
    }


def stretches(n_steps, values):
    """Cut steps that hold some numbers each into (first, count) of bounded memory."""
    count = int(min(n_steps, max(1, STRETCH_VALUES // max(1, values))))
    return [(first, min(count, n_steps - first)) for first in range(0, n_steps, count)]


def point_loads(node, history):
    """Return the load arrays of force histories (n_total, n, 3) in N at nodes (n,)."""
    n_total, n = history.shape[:2]
    return {
        "load_node": np.repeat(node, 3).astype(np.int32),
        "load_vector": np.tile(np.eye(3), (n, 1)),
        "load_history": np.arange(3 * n, dtype=np.int32),
        "load_delay": np.zeros(3 * n),
        "load_lane": np.full(3 * n, -1, dtype=np.int32),
        "history": np.ascontiguousarray(history.reshape(n_total, 3 * n)),
    }


SAMPLES_PER_PERIOD = 8


@dataclass(frozen=True, eq=False)
class Track:
    """A run and the motion that its gradients need.

    Parameters
    ----------
    model : Model
    prepared : Prepared
    seismograms : dict of str to Seismogram
        By receiver, at every step.
    steps : (n_samples,) int
        At which motion was kept.
    ground : bool
        Whether it was kept at all nodes, or at contacts only.
    nodes : (n_nodes,) int
        Where it was kept, ascending.
    displacement : (n_samples, n_nodes, 3) float32, m
    velocity : list of (n_samples, n_face_nodes, 3) float32, m/s
        Mean of both half-steps at the nodes of each face whose impedance follows the ground.
    """

    model: Model
    prepared: Prepared
    seismograms: dict[str, Seismogram]
    steps: np.ndarray
    ground: bool
    nodes: np.ndarray
    displacement: np.ndarray
    velocity: list


def track(model: Model, duration: float, *, ground: bool = True, highest=None) -> Track:
    """March a linear model and keep what gradients need.

    Parameters
    ----------
    model : Model
    duration : float, s
    ground : bool
        Whether moduli and speeds are wanted too; joints alone need much less memory.
    highest : float, optional, Hz
        Highest frequency of the motion: 8 samples to its period are kept, and the derivative of
        the misfit must hold nothing above it. None keeps every step.

    Raises
    ------
    InputError
        If a law is not linear, or a contact slips or opens.
    """
    refuse_nonlinear(model)
    prepared = prepare(model, duration)
    state = {name: value.copy() for name, value in prepared.state.items()}
    nodes = _tracked_nodes(model, ground)
    n, dt = prepared.n_steps, prepared.constants["dt"]
    every = 1 if highest is None else max(1, math.floor(1.0 / (SAMPLES_PER_PERIOD * highest * dt)))
    rims = [face_nodes(model, one) for one in (faces(model) if ground else ())]
    places = [np.searchsorted(nodes, rim) for rim in rims]
    kept, means, motion = [], [[] for _ in rims], []
    watch = Watch(prepared.constants, state, nodes)
    for first, count in stretches(n, 3 * len(nodes)):
        stretch = watch.go(first, count)
        at = slice(-first % every, None, every)
        kept.append(stretch.displacement[at].astype(np.float32))
        for mean, place in zip(means, places, strict=True):
            both = stretch.before[at, place] + stretch.after[at, place]
            mean.append((0.5 * both).astype(np.float32))
        motion.append(stretch.receivers)
    refuse_slip(model, prepared, state)
    return Track(
        model, prepared, seismograms(model, np.concatenate(motion), dt), np.arange(0, n, every),
        ground, nodes, np.concatenate(kept), [np.concatenate(mean) for mean in means],
    )  # fmt: skip


def _tracked_nodes(model, ground):
    """Return the nodes of all zones, or of contacts alone, ascending."""
    if ground:
        return np.arange(len(model.mesh.points))
    contacts = model.mesh.contacts
    if contacts is None:
        raise InputError("track: the model has no joints; set ground to see its zones")
    return np.unique([contacts.minus, contacts.plus])


def seismograms(model, motion, dt):
    """Return motion (n_steps, n_receivers, 3) as seismograms in the receivers' directions."""
    records = {}
    for number, receiver in enumerate(model.receivers):
        record = Seismogram(motion[:, number], dt, 0.5 * dt, receiver.name)
        turned = record if receiver.azimuth is None else record.rotated(receiver.azimuth)
        records[receiver.name] = turned
    return records


def stress_drive(model, face, times):
    """Return the velocity (n, 1, 3) that a stress input turns into forces by its impedance."""
    motion = np.stack([each(times) for each in components(face)], axis=-1)
    return (2.0 if model.doubles(face) else 1.0) * motion[:, None, :]
