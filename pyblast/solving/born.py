"""First-order changes of seismograms (Born): the tangent of a run of a linear model."""

import numpy as np

from ..meshing.mesh import volumes
from ..motion.seismogram import Seismogram
from .boundaries import StressInput
from .histories import Watch, point_loads, stretches
from .model import Model
from .operators import NORMAL, SHEAR, Answer, flat, jump_matrix, strain_matrix
from .perturbations import (
    Change,
    at_rest,
    difference,
    face_nodes,
    faces,
    refuse_nonlinear,
    refuse_slip,
)
from .preparation import prepare
from .tracks import seismograms, stress_drive


def tangents(
    model: Model, changed: list[Model], duration: float
) -> tuple[dict[str, Seismogram], list[dict[str, Seismogram]]]:
    """Return the seismograms of a linear model and how they change, at first order.

    Parameters
    ----------
    model : Model
    changed : list of Model
        Differing from the model in the stiffness of joints and the moduli of materials only.
    duration : float, s

    Returns
    -------
    seismograms : dict of str to Seismogram
    changes : list of dict of str to Seismogram
        For the step from the model to each of ``changed``; proportional to it.

    Raises
    ------
    InputError
        If a law is not linear, a contact slips or opens, or more than stiffness changes.

    Notes
    -----
    The run and one more for each change march side by side: what a change of stiffness does to
    the motion of the run drives the other. theory.md (8.2).
    """
    refuse_nonlinear(model)
    prepared = prepare(model, duration)
    pushes = [_Push(model, prepared.constants, difference(model, one)) for one in changed]
    none = [np.zeros(0, dtype=int)]
    nodes = np.unique(np.concatenate(none + [push.nodes for push in pushes]))
    state = {name: value.copy() for name, value in prepared.state.items()}
    watch = Watch(prepared.constants, state, nodes)
    followers = [Watch(*at_rest(prepared.constants), none[0]) for _ in pushes]
    motion = [[] for _ in range(1 + len(pushes))]
    for first, count in stretches(prepared.n_steps, 9 * len(nodes) + 12 * len(model.mesh.zones)):
        stretch = watch.go(first, count)
        motion[0].append(stretch.receivers)
        for push, follower, found in zip(pushes, followers, motion[1:], strict=True):
            force = push.force(stretch, nodes)
            found.append(follower.pushed(first, point_loads(push.nodes, force)).receivers)
    refuse_slip(model, prepared, state)
    dt = prepared.constants["dt"]
    first, *rest = [seismograms(model, np.concatenate(each), dt) for each in motion]
    return first, rest


class _Push:
    """What a change of stiffness makes of the motion of a run: nodal forces."""

    def __init__(self, model: Model, constants, change: Change):
        """Choose the nodes that the change concerns and make its matrices."""
        self._model, self._change, self._dt = model, change, constants["dt"]
        mesh, contacts = model.mesh, model.mesh.contacts
        pieces = [np.zeros(0, dtype=int)]
        self._joints = change.kn.any() or change.ks.any()
        if self._joints:
            pieces += [contacts.minus, contacts.plus]
        differs = (change.p_modulus != 0.0) | (change.s_modulus != 0.0)
        pieces.append(mesh.zones[differs].ravel())
        walls = zip(faces(model), change.impedance, strict=True)
        self._faces = [(one, face_nodes(model, one), each) for one, each in walls if each.any()]
        self.nodes = np.unique(np.concatenate(pieces + [rim for _, rim, _ in self._faces]))
        self._jump = jump_matrix(contacts, self.nodes) if self._joints else None
        self._groups = []
        for number in np.unique(mesh.zone_group[differs]):
            zones = np.flatnonzero(differs & (mesh.zone_group == number))
            matrix = strain_matrix(mesh, zones, self.nodes)
            volume = volumes(mesh)[zones]
            self._groups.append((zones, volume, matrix, Answer(constants, zones)))

    def force(self, stretch, nodes):
        """Return the force (n, n_nodes, 3) in N that a stretch of the run puts on the nodes."""
        here = np.searchsorted(nodes, self.nodes)
        moved = stretch.displacement[:, here]
        total = np.zeros_like(flat(moved))
        if self._joints:
            total -= self._jump.T @ self._traction(self._jump @ flat(moved))
        for zones, volume, matrix, answer in self._groups:
            p, s = (matrix @ flat(motion) for motion in answer(moved))
            total -= matrix.T @ self._stress(zones, volume, p, s)
        force = total.T.reshape(moved.shape)
        times = self._dt * (stretch.first + np.arange(len(moved)))
        for face, rim, impedance in self._faces:
            place = np.searchsorted(self.nodes, rim)
            drive = -0.5 * (stretch.before + stretch.after)[:, here[place]]
            if isinstance(face, StressInput):
                drive = stress_drive(self._model, face, times)
            force[:, place] += np.einsum("nij,tnj->tni", impedance,
                                         np.broadcast_to(drive, force[:, place].shape))  # fmt: skip
        return force

    def _traction(self, jump):
        """Return area times the traction of the change for jumps (3 n_contacts, n)."""
        contacts, change = self._model.mesh.contacts, self._change
        jump = jump.reshape(len(contacts.area), 3, -1)
        normal = contacts.normal[..., None]
        opening = np.sum(jump * normal, axis=1, keepdims=True) * normal
        ks, more = (x[:, None, None] for x in (change.ks, change.kn - change.ks))
        traction = contacts.area[:, None, None] * (ks * jump + more * opening)
        return traction.reshape(3 * len(contacts.area), -1)

    def _stress(self, zones, volume, p, s):
        """Return volume times the stress of the change for strains (6 n_zones, n)."""
        p, s = (each.reshape(len(zones), 6, -1) for each in (p, s))
        of_p, of_s = ((volume * x[zones])[:, None] for x in (self._change.p_modulus,
                                                             self._change.s_modulus))  # fmt: skip
        mean = of_p * p[:, :3].sum(axis=1) - 2.0 * of_s * s[:, :3].sum(axis=1)
        stress = mean[:, None] * NORMAL[:, None] + of_s[..., None] * SHEAR[:, None] * s
        return stress.reshape(6 * len(zones), -1)
