"""Linear runs: checks of linearity, operators on their motion, and motion kept for derivatives."""

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy import signal, sparse

from .. import core
from ..core import JOINT_LAWS
from ..errors import InputError, SolverError
from ..mesh.mesh import Contacts, Mesh
from ..mesh.tetrahedra import shape_gradients
from ..model.boundary import Boundary, StressInput, Viscous
from ..model.joint import Joint
from ..model.model import Model
from ..signals.seismogram import Seismogram
from .assembly import initial_state
from .loads import components
from .preparation import LEDGER_EVERY, Prepared, prepare

NORMAL = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
SHEAR = np.array([2.0, 2.0, 2.0, 1.0, 1.0, 1.0])  # of xx yy zz and the engineering shears
# Row of the strain, component of the motion, axis of the gradient; theory.md (2.1).
STRAIN = (
    (0, 0, 0), (1, 1, 1), (2, 2, 2), (3, 1, 2), (3, 2, 1), (4, 2, 0), (4, 0, 2), (5, 0, 1),
    (5, 1, 0),
)  # fmt: skip


def flat(motion: np.ndarray) -> np.ndarray:
    """Return motion (n, n_nodes, 3) as columns (3 n_nodes, n)."""
    return motion.reshape(len(motion), -1).T


def local(nodes: np.ndarray, table: np.ndarray) -> np.ndarray:
    """Return where the entries of a table of nodes stand in ascending ``nodes``."""
    return np.searchsorted(nodes, table)


def jump_matrix(contacts: Contacts, nodes: np.ndarray) -> sparse.csr_array:
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


def strain_matrix(mesh: Mesh, zones: np.ndarray, nodes: np.ndarray) -> sparse.csr_array:
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

    def __init__(self, constants: dict[str, Any], zones: np.ndarray) -> None:
        """Read stiffness damping, and what relaxes."""
        domain = np.searchsorted(constants["domain_zone_start"], zones[0], side="right") - 1
        number = constants["domain_set"][domain]
        self._lag = constants["set_beta"][number] / constants["dt"]
        self._last, self._memory = None, None
        x = 0.5 * constants["dt"] * constants["memory_rate"]
        rows = zip(x, *constants["set_branch"][number].T, strict=True)
        self._branches = [row for row in rows if any(row[1:])]

    def __call__(self, motion: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
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


def refuse_nonlinear(
    model: Model,
    needs: str = "gradients need",
    joints: tuple[str, ...] = LINEAR_JOINTS + STICKING_JOINTS,
) -> None:
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


def refuse_slip(model: Model, prepared: Prepared, state: dict[str, Any]) -> None:
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


def by_number(model: Model) -> list[Joint]:
    """Return the joints in the order of the contacts' numbers."""
    table = {joint.surface: joint for joint in model.joints}
    names = model.mesh.contacts.names if model.mesh.contacts is not None else ()
    return [table[name] for name in names]


def at_rest(constants: dict[str, Any]) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
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


def faces(model: Model) -> list[Viscous | StressInput]:
    """Return the boundaries whose forces follow the speeds of the ground behind them."""
    return [one for one in model.boundaries if isinstance(one, (Viscous, StressInput))]


def face_nodes(model: Model, boundary: Boundary) -> np.ndarray:
    """Return the nodes (n,) of a face, ascending."""
    return np.unique(model.mesh.surfaces[boundary.surface])


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

    def __init__(self, constants: dict[str, Any], state: dict[str, Any], nodes: np.ndarray) -> None:
        """Put a receiver at every chosen node, behind those of the model."""
        self._nodes, self._state, self._dt = np.asarray(nodes), state, constants["dt"]
        self._n_receivers = len(constants["receiver_node"])
        self._constants = core.to_fortran({**constants, **listening(constants, self._nodes)})

    def go(self, first: int, n_steps: int) -> Stretch:
        """March from a step on; return the `Stretch`.

        Raises
        ------
        SolverError
            If the motion grows without cause.
        """
        start = self._state["displacement"][self._nodes]
        last = self._state["velocity"][self._nodes]
        return self._stretch(first, start, last, self._advance(self._constants, first, n_steps))

    def pushed(self, first: int, loads: dict[str, np.ndarray]) -> Stretch:
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


def listening(constants: dict[str, Any], nodes: ArrayLike) -> dict[str, np.ndarray]:
    """Return the receivers of a model, and behind them one at every chosen node."""
    corners = constants["receiver_node"].shape[1]  # or all nodes of a quadratic zone
    node, weight = np.repeat(np.asarray(nodes)[:, None], corners, axis=1), np.eye(corners)[:1]
    weight = weight.repeat(len(node), axis=0)
    return {
        "receiver_node": np.concatenate([constants["receiver_node"], node]).astype(np.int32),
        "receiver_weight": np.concatenate([constants["receiver_weight"], weight]),
    }


def stretches(n_steps: int, values: int) -> list[tuple[int, int]]:
    """Cut steps that hold some numbers each into (first, count) of bounded memory."""
    count = int(min(n_steps, max(1, STRETCH_VALUES // max(1, values))))
    return [(first, min(count, n_steps - first)) for first in range(0, n_steps, count)]


def point_loads(node: np.ndarray, history: np.ndarray) -> dict[str, np.ndarray]:
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
    velocity: list[np.ndarray]


def track(
    model: Model, duration: float, *, ground: bool = True, highest: float | None = None
) -> Track:
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


def seismograms(model: Model, motion: np.ndarray, dt: float) -> dict[str, Seismogram]:
    """Return motion (n_steps, n_receivers, 3) as seismograms in the receivers' directions."""
    records = {}
    for number, receiver in enumerate(model.receivers):
        record = Seismogram(motion[:, number], dt, 0.5 * dt, receiver.name)
        turned = record if receiver.azimuth is None else record.rotated(receiver.azimuth)
        records[receiver.name] = turned
    return records


def stress_drive(model: Model, face: StressInput, times: np.ndarray) -> np.ndarray:
    """Return the velocity (n, 1, 3) that a stress input turns into forces by its impedance."""
    motion = np.stack([each(times) for each in components(face)], axis=-1)
    return (2.0 if model.doubles(face) else 1.0) * motion[:, None, :]
