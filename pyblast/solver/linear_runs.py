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
    """Return the positions of the entries of a table of nodes in ascending ``nodes``."""
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


class StressResponse:
    """Stress response of a group to motion in time, separately for the P and the S modulus.

    Linear, time-invariant and causal, so it applies to the motion of a run and, in reversed time,
    to that of its adjoint: theory.md (8.5).

    Parameters
    ----------
    constants : dict
        Of a prepared model.
    zones : (n,) int
        Of one group.
    """

    def __init__(self, constants: dict[str, Any], zones: np.ndarray) -> None:
        """Read stiffness damping and relaxation mechanisms."""
        domain = np.searchsorted(constants["domain_zone_start"], zones[0], side="right") - 1
        number = constants["domain_set"][domain]
        self._lag = constants["set_beta"][number] / constants["dt"]
        self._last: np.ndarray | None = None
        self._memory: list[np.ndarray] = []
        x = 0.5 * constants["dt"] * constants["memory_rate"]
        rows = zip(x, *constants["set_branch"][number].T, strict=True)
        self._branches = [row for row in rows if any(row[1:])]

    def __call__(self, motion: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the response with P and with S modulus to the next motion (n, ...) in time."""
        if self._last is None:
            self._last = np.zeros_like(motion[:1])
            self._memory = [np.zeros_like(motion[:1]) for _ in self._branches]
        earlier = np.concatenate([self._last, motion[:-1]])
        self._last = motion[-1:].copy()
        p = motion + self._lag * (motion - earlier)
        s = p.copy() if self._branches else p
        for number, (x, of_s, of_p) in enumerate(self._branches):
            gain = x / (1.0 + x)
            relaxed, self._memory[number] = signal.lfilter(
                [gain, gain], [1.0, -(1.0 - x) / (1.0 + x)], motion, axis=0,
                zi=self._memory[number],
            )  # fmt: skip
            p = p + of_p * (motion - relaxed)
            s = s + of_s * (motion - relaxed)
        return p, s


LINEAR_JOINTS = ("elastic", "kelvin")
STICKING_JOINTS = ("coulomb", "softening")  # linear while no contact slips or opens
MODAL_LAWS = ("elastic",)
SLIP, FAILED, STATUS = slice(0, 3), 3, 4  # columns of the state of joints that slip


def refuse_nonlinear(
    model: Model,
    needs: str = "gradients need",
    joints: tuple[str, ...] = LINEAR_JOINTS + STICKING_JOINTS,
) -> None:
    """Raise InputError for models whose motion is not linear in the sources.

    Parameters
    ----------
    model : Model
    needs : str
        Beginning of the messages.
    joints : tuple of str
        Allowed joint laws.

    Raises
    ------
    InputError
        Naming the nonlinear part.
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
        if law not in MODAL_LAWS:
            raise InputError(
                f"materials.{group}: {needs} isotropic ground, elastic or attenuating, got "
                f"'{law}'; take another law there"
            )
    if model.local_damping:
        raise InputError(
            f"local_damping: {needs} damping in proportion to motion, got "
            f"{model.local_damping:g}; set it to zero"
        )


def refuse_slip(model: Model, prepared: Prepared, state: dict[str, Any]) -> None:
    """Raise InputError if contacts have slipped or opened at the end of a run.

    Raises
    ------
    InputError
        Naming the joint and the number of contacts.
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
    """Return constants and state of a linear model at rest, without loads and initial stress."""
    number = {name: law.number for name, law in JOINT_LAWS.items()}
    sticking = np.isin(constants["joint_law"], [number[name] for name in STICKING_JOINTS])
    unloaded = {
        **constants,
        "joint_law": np.where(sticking, number["elastic"], constants["joint_law"]).astype("i4"),
        **{n: np.zeros_like(constants[n]) for n in ("contact_initial", "node_load", "row_initial")},
        "fixed_history": np.full_like(constants["fixed_history"], -1),
    }
    return unloaded, initial_state(unloaded)


def faces(model: Model) -> list[Viscous | StressInput]:
    """Return the boundaries whose impedance depends on the wave speeds of the ground."""
    return [b for b in model.boundaries if isinstance(b, (Viscous, StressInput))]


def face_nodes(model: Model, boundary: Boundary) -> np.ndarray:
    """Return the nodes (n,) of a face, ascending."""
    return np.unique(model.mesh.surfaces[boundary.surface])


STRETCH_VALUES = 2**23  # numbers in one stretch: 64 MB


class Stretch(NamedTuple):
    """Stretch of a run: motion over consecutive steps.

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


class RecordedRun:
    """Run that records the motion of chosen nodes; its state changes in place.

    Parameters
    ----------
    constants, state : dict
        As in `Prepared`; the state is not copied.
    nodes : (n_nodes,) int
    """

    def __init__(self, constants: dict[str, Any], state: dict[str, Any], nodes: np.ndarray) -> None:
        """Add a receiver at every chosen node after those of the model."""
        self._nodes, self._state, self._dt = np.asarray(nodes), state, constants["dt"]
        self._n_receivers = len(constants["receiver_node"])
        self._constants = core.to_fortran({**constants, **node_receivers(constants, self._nodes)})

    def advance(self, first: int, n_steps: int) -> Stretch:
        """Advance from a step; return the `Stretch`.

        Raises
        ------
        SolverError
            If the run is unstable.
        """
        start = self._state["displacement"][self._nodes]
        last = self._state["velocity"][self._nodes]
        return self._stretch(first, start, last, self._advance(self._constants, first, n_steps))

    def advance_with_loads(self, first: int, loads: dict[str, np.ndarray]) -> Stretch:
        """Advance under the loads of one stretch, whose histories begin at its first step."""
        start = self._state["displacement"][self._nodes]
        last = self._state["velocity"][self._nodes]
        self._state["sums"][:] = 0.0  # the energy balance restarts with each stretch
        constants = {**self._constants, **core.to_fortran(loads)}
        motion = self._advance(constants, 0, len(loads["history"]))
        return self._stretch(first, start, last, motion)

    def _advance(self, constants, first, n_steps):
        """Return the motion (n_steps, n, 3) of receivers and nodes."""
        motion, _, failed = core.advance(constants, self._state, first, n_steps, LEDGER_EVERY)
        if failed is not None:
            raise SolverError(f"run: unstable at step {first + len(motion)}")
        return motion

    def _stretch(self, first, start, last, motion):
        """Integrate velocities to displacements."""
        after = motion[:, self._n_receivers : self._n_receivers + len(self._nodes)]
        before = np.concatenate([last[None], after[:-1]])
        displacement = start + self._dt * (np.cumsum(after, axis=0) - after)
        receivers = motion[:, : self._n_receivers]
        return Stretch(first, receivers, displacement, before, after)


def node_receivers(constants: dict[str, Any], nodes: ArrayLike) -> dict[str, np.ndarray]:
    """Return the receivers of a model, followed by one at every chosen node."""
    corners = constants["receiver_node"].shape[1]  # or all nodes of a quadratic zone
    node, weight = np.repeat(np.asarray(nodes)[:, None], corners, axis=1), np.eye(corners)[:1]
    weight = weight.repeat(len(node), axis=0)
    return {
        "receiver_node": np.concatenate([constants["receiver_node"], node]).astype(np.int32),
        "receiver_weight": np.concatenate([constants["receiver_weight"], weight]),
    }


def stretches(n_steps: int, values: int) -> list[tuple[int, int]]:
    """Return (first, count) of stretches of bounded memory, for a number of values per step."""
    count = int(min(n_steps, max(1, STRETCH_VALUES // max(1, values))))
    return [(first, min(count, n_steps - first)) for first in range(0, n_steps, count)]


SAMPLES_PER_PERIOD = 8


@dataclass(frozen=True, eq=False)
class Track:
    """Track: a run with the motion stored for its gradients.

    Parameters
    ----------
    model : Model
    prepared : Prepared
    seismograms : dict of str to Seismogram
        By receiver, at every step.
    steps : (n_samples,) int
        At which motion is stored.
    ground : bool
        Whether it is stored at all nodes or at contacts only.
    nodes : (n_nodes,) int
        Nodes with stored motion, ascending.
    displacement : (n_samples, n_nodes, 3) float32, m
    velocity : list of (n_samples, n_face_nodes, 3) float32, m/s
        Mean of both half-steps at the nodes of each of `faces`.
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
    """Run a linear model and store the motion needed for gradients.

    Parameters
    ----------
    model : Model
    duration : float, s
    ground : bool
        Whether gradients of moduli are needed; joints alone need much less memory.
    highest : float, optional, Hz
        Highest frequency of the motion and of the derivative of the misfit: 8 samples per period
        are stored. None: every step.

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
    face_node_sets = [face_nodes(model, face) for face in (faces(model) if ground else ())]
    places = [np.searchsorted(nodes, face_node_set) for face_node_set in face_node_sets]
    stored, means, motion = [], [[] for _ in face_node_sets], []
    run = RecordedRun(prepared.constants, state, nodes)
    for first, count in stretches(n, 3 * len(nodes)):
        stretch = run.advance(first, count)
        at = slice(-first % every, None, every)
        stored.append(stretch.displacement[at].astype(np.float32))
        for mean, index in zip(means, places, strict=True):
            both = stretch.before[at, index] + stretch.after[at, index]
            mean.append((0.5 * both).astype(np.float32))
        motion.append(stretch.receivers)
    refuse_slip(model, prepared, state)
    return Track(
        model, prepared, seismograms(model, np.concatenate(motion), dt), np.arange(0, n, every),
        ground, nodes, np.concatenate(stored), [np.concatenate(mean) for mean in means],
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
    """Return the velocity (n, 1, 3) of a stress input, times its factor."""
    motion = np.stack([each(times) for each in components(face)], axis=-1)
    return (2.0 if model.doubles(face) else 1.0) * motion[:, None, :]
