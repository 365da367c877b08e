"""Runs of linear models that keep the motion which gradients need."""

import math
from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..motion.seismogram import Seismogram
from .histories import Watch, stretches
from .loads import components
from .model import Model
from .perturbations import face_nodes, faces, refuse_nonlinear, refuse_slip
from .preparation import Prepared, prepare

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
