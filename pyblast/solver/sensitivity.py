"""Sensitivity of linear models: gradients by the adjoint, tangents by Born's approximation."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..errors import InputError
from ..mesh.mesh import volumes
from ..model.boundary import FreeField, StressInput
from ..model.model import Model
from ..model.plane_wave import PlaneWave
from ..model.source import Column
from ..signals.seismogram import Seismogram
from .linear_runs import (
    NORMAL,
    SHEAR,
    RecordedRun,
    StressResponse,
    Track,
    at_rest,
    by_number,
    face_nodes,
    faces,
    flat,
    jump_matrix,
    refuse_nonlinear,
    refuse_slip,
    seismograms,
    strain_matrix,
    stress_drive,
    stretches,
)
from .loads import point_loads, surface_impedance
from .preparation import prepare

STEP = 1e-3  # relative, of wave speeds; impedances are linear in them


@dataclass(frozen=True, eq=False)
class Change:
    """Change of stiffness of contacts, zones and boundary impedances.

    Parameters
    ----------
    kn, ks : (n_contacts,) float64, Pa/m
    p_modulus, s_modulus : (n_zones,) float64, Pa
        Relaxed moduli of P and S waves.
    impedance : list of (n_face_nodes, 3, 3) float64, N s/m
        At the nodes of each of `faces`.
    """

    kn: np.ndarray
    ks: np.ndarray
    p_modulus: np.ndarray
    s_modulus: np.ndarray
    impedance: list[np.ndarray]


def difference(model: Model, changed: Model) -> Change:
    """Return the `Change` from one model to another with the same mesh, masses and loads.

    The differences of moduli and stiffness are finite, not linearised.

    Raises
    ------
    InputError
        If other properties than the stiffness of joints and the moduli of materials differ, or a
        source depends on the changed moduli.
    """
    _refuse_others(model, changed)
    stiffness = [_stiffness(each) for each in (model, changed)]
    moduli = [each.zone_moduli() for each in (model, changed)]
    lame, shear = (moduli[1][k] - moduli[0][k] for k in range(2))
    if lame.any() or shear.any():
        _refuse_dependent_sources(model)
    walls = [[_impedance(state, face) for face in faces(state)] for state in (model, changed)]
    impedance = [after - before for before, after in zip(*walls, strict=True)]
    kn, ks = (stiffness[1] - stiffness[0]).T
    return Change(kn, ks, lame + 2.0 * shear, shear, impedance)


def _stiffness(model):
    """Return kn and ks of every contact, (n_contacts, 2) Pa/m."""
    if model.mesh.contacts is None:
        return np.zeros((0, 2))
    table = [[joint.properties[name] for name in ("kn", "ks")] for joint in by_number(model)]
    return np.array(table)[model.mesh.contacts.joint]


def _impedance(model, boundary):
    """Return the impedance (n_nodes, 3, 3) at the nodes of a face, ascending."""
    known = surface_impedance(model, boundary.surface)
    return np.array([known[int(node)] for node in face_nodes(model, boundary)])


def _refuse_others(model, changed):
    """Raise InputError if a changed model differs in more than stiffness."""
    unlike = [
        name
        for name in ("mesh", "boundaries", "damping", "sources", "sponge", "ground")
        if getattr(model, name) is not getattr(changed, name)
        and getattr(model, name) != getattr(changed, name)
    ]
    unlike += [
        f"materials.{g}"
        for g in model.mesh.groups
        if (model.materials[g].density, model.materials[g].law)
        != (changed.materials[g].density, changed.materials[g].law)
    ]
    unlike += [
        f"joints.{joint.surface}"
        for joint, other in zip(by_number(model), by_number(changed), strict=True)
        if _beside_stiffness(joint) != _beside_stiffness(other)
    ]
    if unlike:
        raise InputError(
            f"{unlike[0]}: a gradient knows changes of kn, ks and of moduli only; "
            "leave the rest of the changed model as it is"
        )


def _refuse_dependent_sources(model):
    """Raise InputError if sources depend on the changed moduli."""
    for load in (*model.sources, *model.boundaries):
        if isinstance(load, (Column, PlaneWave, FreeField)):
            raise InputError(
                f"sources: a {type(load).__name__} follows the moduli of the ground, which "
                "gradients do not know; change joints only, or use other sources"
            )


def _beside_stiffness(joint):
    """Return the properties of a joint other than its stiffness."""
    rest = {n: value for n, value in joint.properties.items() if n not in ("kn", "ks")}
    return joint.law, rest, joint.fill_mass


def with_speeds(model: Model, group: str, cp: float = 1.0, cs: float = 1.0) -> Model:
    """Return the model with factors on the wave speeds of a group."""
    old = model.materials[group]
    p, shear = old.density * (cp * old.cp) ** 2, old.shear * cs**2
    new = replace(old, bulk=p - 4.0 / 3.0 * shear, shear=shear)
    return replace(model, materials={**model.materials, group: new})


def tangents(
    model: Model, changed: Sequence[Model], duration: float
) -> tuple[dict[str, Seismogram], list[dict[str, Seismogram]]]:
    """Return the seismograms of a linear model and their first-order changes (Born).

    Parameters
    ----------
    model : Model
    changed : list of Model
        Models with other stiffness of joints and moduli of materials.
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
    The perturbed motion of each change is a second run, loaded by the change of stiffness times the
    motion of the first: theory.md (8.2).
    """
    refuse_nonlinear(model)
    prepared = prepare(model, duration)
    forces = [_BornForce(model, prepared.constants, difference(model, other)) for other in changed]
    none = [np.zeros(0, dtype=int)]
    nodes = np.unique(np.concatenate(none + [force.nodes for force in forces]))
    state = {name: value.copy() for name, value in prepared.state.items()}
    reference = RecordedRun(prepared.constants, state, nodes)
    perturbed = [RecordedRun(*at_rest(prepared.constants), none[0]) for _ in forces]
    motion = [[] for _ in range(1 + len(forces))]
    for first, count in stretches(prepared.n_steps, 9 * len(nodes) + 12 * len(model.mesh.zones)):
        stretch = reference.advance(first, count)
        motion[0].append(stretch.receivers)
        for force, run, records in zip(forces, perturbed, motion[1:], strict=True):
            loads = point_loads(force.nodes, force.force(stretch, nodes))
            records.append(run.advance_with_loads(first, loads).receivers)
    refuse_slip(model, prepared, state)
    dt = prepared.constants["dt"]
    first, *rest = [seismograms(model, np.concatenate(each), dt) for each in motion]
    return first, rest


class _BornForce:
    """Nodal forces of a change of stiffness, for the motion of a run."""

    def __init__(self, model: Model, constants, change: Change):
        """Select the nodes of the change and compute its matrices."""
        self._model, self._change, self._dt = model, change, constants["dt"]
        mesh, contacts = model.mesh, model.mesh.contacts
        pieces = [np.zeros(0, dtype=int)]
        self._joints = change.kn.any() or change.ks.any()
        if contacts is not None and self._joints:
            pieces += [contacts.minus, contacts.plus]
        differs = (change.p_modulus != 0.0) | (change.s_modulus != 0.0)
        pieces.append(mesh.zones[differs].ravel())
        walls = zip(faces(model), change.impedance, strict=True)
        self._faces = [(wall, face_nodes(model, wall), each) for wall, each in walls if each.any()]
        self.nodes = np.unique(
            np.concatenate(pieces + [edge_nodes for _, edge_nodes, _ in self._faces])
        )
        self._jump = None
        if contacts is not None and self._joints:
            self._jump = jump_matrix(contacts, self.nodes)
        self._groups = []
        for number in np.unique(mesh.zone_group[differs]):
            zones = np.flatnonzero(differs & (mesh.zone_group == number))
            matrix = strain_matrix(mesh, zones, self.nodes)
            volume = volumes(mesh)[zones]
            self._groups.append((zones, volume, matrix, StressResponse(constants, zones)))

    def force(self, stretch, nodes):
        """Return the forces (n, n_nodes, 3) in N for a stretch of the run."""
        here = np.searchsorted(nodes, self.nodes)
        moved = stretch.displacement[:, here]
        total = np.zeros_like(flat(moved))
        if self._jump is not None:
            total -= self._jump.T @ self._traction(self._jump @ flat(moved))
        for zones, volume, matrix, answer in self._groups:
            p, s = (matrix @ flat(motion) for motion in answer(moved))
            total -= matrix.T @ self._stress(zones, volume, p, s)
        force = total.T.reshape(moved.shape)
        times = self._dt * (stretch.first + np.arange(len(moved)))
        for face, edge_nodes, impedance in self._faces:
            index = np.searchsorted(self.nodes, edge_nodes)
            drive = -0.5 * (stretch.before + stretch.after)[:, here[index]]
            if isinstance(face, StressInput):
                drive = stress_drive(self._model, face, times)
            force[:, index] += np.einsum("nij,tnj->tni", impedance,
                                         np.broadcast_to(drive, force[:, index].shape))  # fmt: skip
        return force

    def _traction(self, jump):
        """Return area times the traction of the change for jumps (3 n_contacts, n)."""
        contacts, change = self._model.mesh.contacts, self._change
        assert contacts is not None
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


@dataclass(frozen=True, eq=False)
class Gradient:
    """Gradient: derivatives of a misfit by stiffness, moduli and impedances.

    Parameters
    ----------
    model : Model
    kn, ks : (n_contacts,) float64, per Pa/m
        By contact; divided by the area of the contact, a map of the sensitivity.
    p_modulus, s_modulus : (n_zones,) float64, per Pa
        By the P and S moduli of each zone; NaN if only joints were tracked.
    impedance : list of (n_face_nodes, 3, 3) float64, per N s/m
    """

    model: Model
    kn: np.ndarray
    ks: np.ndarray
    p_modulus: np.ndarray
    s_modulus: np.ndarray
    impedance: list[np.ndarray]

    def along(self, changed: Model) -> float:
        """Return the first-order change of the misfit from the model to a changed one.

        Raises
        ------
        InputError
            If more than the stiffness of joints and the moduli of materials differs.
        """
        change = difference(self.model, changed)
        total = np.sum(self.kn * change.kn) + np.sum(self.ks * change.ks)
        if change.p_modulus.any() or change.s_modulus.any():
            if np.isnan(self.p_modulus).any():
                raise InputError("gradient: this run kept joints only; track it with its ground")
            total += np.sum(self.p_modulus * change.p_modulus)
            total += np.sum(self.s_modulus * change.s_modulus)
            walls = zip(self.impedance, change.impedance, strict=True)
            total += sum(np.sum(wall * other) for wall, other in walls)
        return float(total)

    def joint(self, surface: str) -> dict[str, float]:
        """Return the derivatives with respect to kn and ks of a joint, per Pa/m."""
        names = [joint.surface for joint in by_number(self.model)]
        contacts = self.model.mesh.contacts
        if contacts is None or surface not in names:
            raise InputError(f"gradient: no joint '{surface}'; there are {', '.join(names)}")
        here = contacts.joint == names.index(surface)
        return {"kn": float(self.kn[here].sum()), "ks": float(self.ks[here].sum())}

    def ground(self, group: str) -> dict[str, float]:
        """Return the derivatives with respect to cp and cs of a group, per m/s.

        The impedances of viscous boundaries and stress input change with the speeds, the absorbing
        layer does not.
        """
        if group not in self.model.mesh.groups:
            known = ", ".join(self.model.mesh.groups)
            raise InputError(f"gradient: no group '{group}'; there are {known}")
        derivatives = {}
        for name in ("cp", "cs"):
            more, less = (
                self.along(with_speeds(self.model, group, **{name: 1.0 + sign * STEP}))
                for sign in (1.0, -1.0)
            )
            speed = getattr(self.model.materials[group], name)
            derivatives[name] = (more - less) / (2.0 * STEP * speed)
        return derivatives


def gradient(run: Track, derivative: dict[str, np.ndarray]) -> Gradient:
    """Return the gradient of a misfit by one adjoint run.

    Parameters
    ----------
    run : Track
    derivative : dict of str to (n_steps, 3) float64
        By receiver: derivative of the misfit by each sample of the seismogram, in its components.
        Other receivers have no weight.

    Raises
    ------
    InputError
        If a receiver is unknown, or the samples are not those of the run.
    """
    model, prepared = run.model, run.prepared
    force = _adjoint_force(run, derivative)
    constants, state = at_rest(prepared.constants)
    nodes = prepared.constants["receiver_node"]
    weight = prepared.constants["receiver_weight"]
    spread = weight[:, :, None] * force[:, :, None, :]
    constants |= point_loads(nodes.ravel(), spread.reshape(len(force), -1, 3))
    adjoint = RecordedRun(constants, state, run.nodes)
    products = _Products(run)
    values = 6 * len(model.mesh.zones if run.ground else run.nodes)
    for first, count in stretches(prepared.n_steps, values):
        products.add(first, adjoint.advance(first, count).after)
    return products.gradient()


def _adjoint_force(run, derivative):
    """Return the adjoint sources in reversed time, east, north, up: theory.md (8.3)."""
    names = [receiver.name for receiver in run.model.receivers]
    force = np.zeros((run.prepared.n_steps, len(names), 3))
    for name, samples in derivative.items():
        if name not in names:
            raise InputError(f"derivative.{name}: no such receiver; there are {', '.join(names)}")
        samples = np.asarray(samples, dtype=float)
        if samples.shape != force[:, 0].shape or not np.isfinite(samples).all():
            raise InputError(
                f"derivative.{name}: must be finite for each of {len(force)} steps and three "
                f"components, got shape {samples.shape}"
            )
        azimuth = run.model.receivers[names.index(name)].azimuth
        if azimuth is not None:
            samples = Seismogram(samples, 1.0).rotated(azimuth).velocity  # its own transpose
        force[:, names.index(name)] = samples[::-1]
    return force


class _Products:
    """Time integrals of adjoint motion times motion; theory.md (8.4) to (8.6)."""

    def __init__(self, run):
        """Compute the matrices of jumps and strains."""
        self._run, model = run, run.model
        mesh, constants = model.mesh, run.prepared.constants
        self._every = int(run.steps[1] - run.steps[0]) if len(run.steps) > 1 else 1
        self._p, self._s = np.full((2, len(mesh.zones)), 0.0 if run.ground else np.nan)
        self._groups = []
        if run.ground:
            for number in range(len(mesh.groups)):
                zones = np.flatnonzero(mesh.zone_group == number)
                near = np.unique(mesh.zones[zones])
                matrix = strain_matrix(mesh, zones, near)
                self._groups.append((zones, near, matrix, StressResponse(constants, zones)))
        contacts = mesh.contacts
        self._jump = jump_matrix(contacts, run.nodes) if contacts is not None else None
        n = 0 if contacts is None else len(contacts.area)
        self._kn, self._ks = np.zeros(n), np.zeros(n)
        self._faces = faces(model) if run.ground else []
        self._edge_nodes = [face_nodes(model, face) for face in self._faces]
        self._walls = [np.zeros((len(edge_nodes), 3, 3)) for edge_nodes in self._edge_nodes]

    def add(self, first, adjoint):
        """Add the products of adjoint motion (n, n_nodes, 3) that begins at one of its steps."""
        run, last = self._run, self._run.prepared.n_steps - 1
        step = last - first - np.arange(len(adjoint))  # of the run, at each sample of the adjoint
        at = np.flatnonzero(step % self._every == 0)
        sample = step[at] // self._every
        displacement = run.displacement[sample].astype(float)
        if self._jump is not None:
            self._add_jumps(flat(adjoint[at]), flat(displacement))
        for zones, near, matrix, answer in self._groups:
            p, s = (flat(motion[at]) for motion in answer(adjoint[:, near]))
            self._add_strains(zones, matrix @ p, matrix @ s, matrix @ flat(displacement[:, near]))
        for number, face in enumerate(self._faces):
            drive = -run.velocity[number][sample].astype(float)
            if isinstance(face, StressInput):
                drive = stress_drive(run.model, face, step[at] * run.prepared.constants["dt"])
            self._walls[number] += np.einsum(
                "tni,tnj->nij", adjoint[at][:, self._edge_nodes[number]],
                np.broadcast_to(drive, (len(at), len(self._edge_nodes[number]), 3)),
            )  # fmt: skip

    def _add_jumps(self, adjoint, motion):
        """Add products of jumps, normal and tangential."""
        contacts = self._run.model.mesh.contacts
        shape = (len(contacts.area), 3, -1)
        a, b = ((self._jump @ each).reshape(shape) for each in (adjoint, motion))
        openings = [np.einsum("cit,ci->ct", each, contacts.normal) for each in (a, b)]
        along = np.einsum("ct,ct->c", *openings)
        self._kn -= contacts.area * along
        self._ks -= contacts.area * (np.einsum("cit,cit->c", a, b) - along)

    def _add_strains(self, zones, p, s, motion):
        """Add products of volumetric and deviatoric strains."""
        volume = volumes(self._run.model.mesh)[zones]
        p, s, motion = (each.reshape(len(zones), 6, -1) for each in (p, s, motion))
        dilation = motion[:, :3].sum(axis=1)
        self._p[zones] -= volume * np.sum(p[:, :3].sum(axis=1) * dilation, axis=1)
        whole = np.einsum("zit,i,zit->z", s, SHEAR, motion, optimize=True)
        spent = 2.0 * np.sum(s[:, :3].sum(axis=1) * dilation, axis=1)
        self._s[zones] -= volume * (whole - spent)

    def gradient(self):
        """Return the sums as a `Gradient`."""
        return Gradient(
            model=self._run.model,
            kn=self._every * self._kn,
            ks=self._every * self._ks,
            p_modulus=self._every * self._p,
            s_modulus=self._every * self._s,
            impedance=[self._every * wall for wall in self._walls],
        )
