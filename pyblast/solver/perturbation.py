"""Perturbations of linear models to first order: what may change, and the operators for it."""

from dataclasses import dataclass, replace

import numpy as np
from scipy import signal, sparse

from ..core import JOINT_LAWS
from ..errors import InputError
from ..mesh.tetrahedra import shape_gradients
from ..model.boundary import FreeField, StressInput, Viscous
from ..model.plane_wave import PlaneWave
from ..model.source import Column
from .assembly import initial_state
from .loads import surface_impedance

NORMAL = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
SHEAR = np.array([2.0, 2.0, 2.0, 1.0, 1.0, 1.0])  # of xx yy zz and the engineering shears
# Row of the strain, component of the motion, axis of the gradient; theory.md (2.1).
STRAIN = (
    (0, 0, 0), (1, 1, 1), (2, 2, 2), (3, 1, 2), (3, 2, 1), (4, 2, 0), (4, 0, 2), (5, 0, 1),
    (5, 1, 0),
)  # fmt: skip


def flat(motion):
    """Return motion (n, n_nodes, 3) as columns (3 n_nodes, n)."""
    return motion.reshape(len(motion), -1).T


def local(nodes, table):
    """Return where the entries of a table of nodes stand in ascending ``nodes``."""
    return np.searchsorted(nodes, table)


def jump_matrix(contacts, nodes):
    """Return the matrix (3 n_contacts, 3 n_nodes) from motion to jumps: plus less minus side."""
    n = len(contacts.area)
    rows = np.arange(3 * n)
    sides = [
        (3 * local(nodes, side)[:, None] + np.arange(3)).ravel()
        for side in (contacts.plus, contacts.minus)
    ]
    values = np.concatenate([np.ones(3 * n), -np.ones(3 * n)])
    places = np.concatenate([rows, rows]), np.concatenate(sides)
    return sparse.csr_array((values, places), shape=(3 * n, 3 * len(nodes)))


def strain_matrix(mesh, zones, nodes):
    """Return the matrix (6 n_zones, 3 n_nodes) from motion to strains; theory.md (2.1)."""
    inner = shape_gradients(mesh.points, mesh.zones[zones])
    gradient = np.concatenate([-inner.sum(axis=1, keepdims=True), inner], axis=1)
    corner = 3 * local(nodes, mesh.zones[zones])
    first = 6 * np.arange(len(zones))[:, None]
    rows, columns, values = [], [], []
    for row, component, axis in STRAIN:
        rows.append(np.broadcast_to(first + row, corner.shape).ravel())
        columns.append((corner + component).ravel())
        values.append(gradient[:, :, axis].ravel())
    places = np.concatenate(rows), np.concatenate(columns)
    shape = (6 * len(zones), 3 * len(nodes))
    return sparse.csr_array((np.concatenate(values), places), shape=shape)


class Answer:
    """What the stress of a group makes of motion in time, apart for the P and the S modulus.

    Linear, the same at all times, and zero before the first step, so that it can act on the
    motion of a run or, in reversed time, on that of its adjoint: theory.md (8.5).

    Parameters
    ----------
    constants : dict
        Of a prepared model.
    zones : (n,) int
        Of one group.
    """

    def __init__(self, constants, zones):
        """Read stiffness damping, and what relaxes."""
        domain = np.searchsorted(constants["domain_zone_start"], zones[0], side="right") - 1
        number = constants["domain_set"][domain]
        self._lag = constants["set_beta"][number] / constants["dt"]
        self._last, self._memory = None, None
        x = 0.5 * constants["dt"] * constants["memory_rate"]
        rows = zip(x, *constants["set_branch"][number].T, strict=True)
        self._branches = [row for row in rows if any(row[1:])]

    def __call__(self, motion):
        """Return what belongs to P and to S modulus, for the next motion (n, ...) in time."""
        if self._last is None:
            self._last = np.zeros_like(motion[:1])
            self._memory = [np.zeros_like(motion[:1]) for _ in self._branches]
        earlier = np.concatenate([self._last, motion[:-1]])
        self._last = motion[-1:].copy()
        p = motion + self._lag * (motion - earlier)
        s = p.copy() if self._branches else p
        for number, (x, of_s, of_p) in enumerate(self._branches):
            gain = x / (1.0 + x)
            faded, self._memory[number] = signal.lfilter(
                [gain, gain], [1.0, -(1.0 - x) / (1.0 + x)], motion, axis=0,
                zi=self._memory[number],
            )  # fmt: skip
            p = p + of_p * (motion - faded)
            s = s + of_s * (motion - faded)
        return p, s


LINEAR_JOINTS = ("elastic", "kelvin")
STICKING_JOINTS = ("coulomb", "softening")  # linear as long as no contact slips or opens
LINEAR_ZONES = ("elastic",)
SLIP, FAILED, STATUS = slice(0, 3), 3, 4  # columns of the state of joints that slip
STEP = 1e-3  # of speeds; impedances are linear in them


@dataclass(frozen=True, eq=False)
class Change:
    """A change of stiffness, contact by contact, zone by zone, face by face.

    Parameters
    ----------
    kn, ks : (n_contacts,) float64, Pa/m
    p_modulus, s_modulus : (n_zones,) float64, Pa
        Moduli of P and S waves after everything has relaxed.
    impedance : list of (n_face_nodes, 3, 3) float64, N s/m
        At the nodes of each of `faces`.
    """

    kn: np.ndarray
    ks: np.ndarray
    p_modulus: np.ndarray
    s_modulus: np.ndarray
    impedance: list


def refuse_nonlinear(model, needs="gradients need", joints=LINEAR_JOINTS + STICKING_JOINTS):
    """Refuse models whose motion is not proportional to what drives them.

    Parameters
    ----------
    model : Model
    needs : str
        Who asks, as the sentences begin.
    joints : tuple of str
        Laws of joints that are allowed.

    Raises
    ------
    InputError
        With the part that is to blame.
    """
    if model.quadratic:
        raise InputError(
            f"model.quadratic: {needs} zones of constant strain; leave quadratic out and "
            "take shorter edges"
        )
    for joint in model.joints:
        if joint.law not in joints:
            raise InputError(
                f"joints.{joint.surface}.law: {needs} a stiffness that does not change, "
                f"got '{joint.law}'; take one of {', '.join(joints)}"
            )
    for group in model.mesh.groups:
        law = model.law(group).name
        if law not in LINEAR_ZONES:
            raise InputError(
                f"materials.{group}: {needs} isotropic ground, elastic or fading, got "
                f"'{law}'; take another law there"
            )
    if model.local_damping:
        raise InputError(
            f"local_damping: {needs} damping in proportion to motion, got "
            f"{model.local_damping:g}; set it to zero"
        )


def refuse_slip(model, prepared, state):
    """Refuse a run at whose end contacts have slipped or opened.

    Raises
    ------
    InputError
        With the joint and the count.
    """
    law = prepared.constants["joint_law"]
    begun, ended = prepared.state["contact_state"], state["contact_state"]
    moved = (ended[:, SLIP] != 0.0).any(axis=1) | (ended[:, STATUS] > 0.0)
    moved |= ended[:, FAILED] > begun[:, FAILED]
    for number, joint in enumerate(by_number(model)):
        here = prepared.constants["contact_joint"] == number
        if law[number] in [JOINT_LAWS[name].number for name in STICKING_JOINTS]:
            count = np.count_nonzero(moved & here)
            if count:
                raise InputError(
                    f"joints.{joint.surface}: {count} of {np.count_nonzero(here)} contacts slip "
                    "or open in this run, which is not linear then; take the law 'elastic' or "
                    "a weaker load"
                )


def by_number(model):
    """Return the joints in the order of the contacts' numbers."""
    table = {joint.surface: joint for joint in model.joints}
    names = model.mesh.contacts.names if model.mesh.contacts is not None else ()
    return [table[name] for name in names]


def at_rest(constants):
    """Return constants and state of the same linear model with nothing that drives it."""
    number = {name: law.number for name, law in JOINT_LAWS.items()}
    sticking = np.isin(constants["joint_law"], [number[name] for name in STICKING_JOINTS])
    quiet = {
        **constants,
        "joint_law": np.where(sticking, number["elastic"], constants["joint_law"]).astype("i4"),
        **{n: np.zeros_like(constants[n]) for n in ("contact_initial", "node_load", "row_initial")},
        "fixed_history": np.full_like(constants["fixed_history"], -1),
    }
    return quiet, initial_state(quiet)


def faces(model):
    """Return the boundaries whose forces follow the speeds of the ground behind them."""
    return [one for one in model.boundaries if isinstance(one, (Viscous, StressInput))]


def face_nodes(model, boundary):
    """Return the nodes (n,) of a face, ascending."""
    return np.unique(model.mesh.surfaces[boundary.surface])


def difference(model, changed):
    """Return the `Change` from one model to another with the same mesh, masses and loads.

    Moduli and stiffness are taken as they are, so a change of moduli is exact to all orders.

    Raises
    ------
    InputError
        If anything else than the stiffness of joints and the moduli of materials differs, or
        moduli where a source follows them.
    """
    _refuse_others(model, changed)
    stiffness = [_stiffness(one) for one in (model, changed)]
    moduli = [one.zone_moduli() for one in (model, changed)]
    lame, shear = (moduli[1][k] - moduli[0][k] for k in range(2))
    if lame.any() or shear.any():
        _refuse_led(model)
    walls = [[_impedance(one, face) for face in faces(one)] for one in (model, changed)]
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
    """Refuse a changed model that differs in more than stiffness."""
    unlike = [
        name
        for name in ("mesh", "boundaries", "damping", "sources", "rim", "ground")
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
        f"joints.{one.surface}"
        for one, other in zip(by_number(model), by_number(changed), strict=True)
        if _beside_stiffness(one) != _beside_stiffness(other)
    ]
    if unlike:
        raise InputError(
            f"{unlike[0]}: a gradient knows changes of kn, ks and of moduli only; "
            "leave the rest of the changed model as it is"
        )


def _refuse_led(model):
    """Refuse a change of the ground where loads follow it in ways that are not known here."""
    for load in (*model.sources, *model.boundaries):
        if isinstance(load, (Column, PlaneWave, FreeField)):
            raise InputError(
                f"sources: a {type(load).__name__} follows the moduli of the ground, which "
                "gradients do not know; change joints only, or use other sources"
            )


def _beside_stiffness(joint):
    """Return what a change must leave of a joint."""
    rest = {n: value for n, value in joint.properties.items() if n not in ("kn", "ks")}
    return joint.law, rest, joint.fill_mass


def with_speeds(model, group, cp=1.0, cs=1.0):
    """Return the model with the speeds of a group multiplied; density stays."""
    old = model.materials[group]
    p, shear = old.density * (cp * old.cp) ** 2, old.shear * cs**2
    new = replace(old, bulk=p - 4.0 / 3.0 * shear, shear=shear)
    return replace(model, materials={**model.materials, group: new})
