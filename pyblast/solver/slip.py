"""Slip and opening of joints in a run, and how far each is from them."""

import math
from dataclasses import dataclass

import numpy as np

from ..core import JOINT_LAWS
from ..laws import of_laws
from ..model.joint import FAILED, GAP, SLIP
from .preparation import peak_interval, prepare
from .run import simulate

HISTORY = ("slip", "opening", "yielded_area", "safety")  # of a surface over time
SLIPS = ("slip_x", "slip_y", "slip_z", "failed")
STRENGTH = ("cohesion", "friction", "tension")
AT_YIELD = 1e-6  # remaining share of the strength that counts as none
ROUNDING = 1e-9


@dataclass(frozen=True)
class JointSlip:
    """Slip of one joint surface in a blast, and how far it is from slipping.

    Parameters
    ----------
    contacts : int
    before : int
        Contacts that slipped or opened before the blast.
    failed : int
        Contacts that slipped or opened in the blast.
    factor : float
        Factor on the blast at which the first of the others would slip or open; infinite if none
        can. theory.md (11.5).
    weakest_factor : float
        The same with the lowest strength of the ranges.
    """

    contacts: int
    before: int
    failed: int
    factor: float
    weakest_factor: float


@dataclass(frozen=True, eq=False)
class Slip:
    """Slip of all joints in a blast.

    Parameters
    ----------
    strength : dict of str to JointSlip
        By joint surface.
    ppv : dict of str to (3,) float64, m/s
        By receiver.
    """

    strength: dict[str, JointSlip]
    ppv: dict[str, np.ndarray]


class JointObserver:
    """Slip, opening, yielded area and safety of joints while a run goes on.

    Parameters
    ----------
    model : Model
    prepared : Prepared
        Of the model.
    highest : float, Hz
        Highest frequency of the motion, whose period has at least 20 samples.
    weakest : sequence of Joint, optional
        The same joints with other strengths, for `JointSlip.weakest_factor`.
    box : (3, 2) float, m, optional
        Contacts outside count neither in areas nor in factors of safety: those of absorbing sides.
    followed : sequence of (n,) int
        Nodes whose mean velocity is recorded: what blocks stand on.

    Notes
    -----
    The factor of safety of a surface is ``sum A (c + p tan phi) / |sum A tau|``, by the strength
    that is left and the tractions of the run, of limit equilibrium; theory.md (17.1).
    """

    def __init__(self, model, prepared, highest, weakest=None, box=None, followed=()):
        self.joints, self.constants, self.begun = (
            model.numbered_joints, prepared.constants, prepared.state,
        )  # fmt: skip
        self.every = peak_interval(self.constants["dt"], highest, prepared)
        self.positions = np.empty((0, 3))
        if model.nodes.contacts is not None:
            self.positions = model.nodes.points[model.nodes.contacts.minus]
        self.area = self.constants["contact_area"].copy()
        if box is not None and len(self.positions):
            inside = (self.positions >= box[:, 0]) & (self.positions <= box[:, 1])
            self.area *= inside.all(axis=1)
        self.number = self.constants["contact_joint"]
        self.law = self.constants["joint_law"][self.number]
        laws = list(JOINT_LAWS.values())
        self.slides = np.array([law.state[:4] == SLIPS for law in laws])[self.law]
        self.opens = of_laws(JOINT_LAWS, self.law, "opens")
        other = {joint.surface: joint for joint in weakest or ()}
        variants = [self.joints] + ([[other[j.surface] for j in self.joints]] if weakest else [])
        self.strengths = [_strengths(variant, self.constants) for variant in variants]
        self.followed = followed
        self.n_steps = prepared.n_steps
        n, samples = len(self.number), prepared.n_steps // self.every + 1
        self.records = {
            "margin": np.full((len(variants), n), np.inf), "largest_slip": np.zeros(n),
            "slip_step": np.zeros(n), "largest_opening": np.zeros(n),
            "history": np.zeros((samples, max(1, len(self.joints)), len(HISTORY))),
            "followed": np.zeros((samples, max(1, len(followed)), 3)),
        }  # fmt: skip

    def sample(self, step, state, velocity) -> None:
        """Take the state of the joints at a step, and velocities (n_nodes, 3) of nodes."""
        slip, opening = self._take_extremes(step, state)
        normal, records = self.constants["contact_normal"], self.records
        at = step // self.every
        for number in range(len(self.joints)):
            here = (self.number == number) & (self.area > 0.0)
            failed = here & self.yielded(state["contact_state"])
            records["history"][at, number] = (
                slip[here].max(initial=0.0), opening[here].max(initial=0.0),
                self.area[failed].sum(), self._safety(here, state, normal),
            )  # fmt: skip
        for k, nodes in enumerate(self.followed):
            records["followed"][at, k] = velocity[nodes].mean(axis=0)

    def take_end(self, state) -> None:
        """Count the state at the end of the run, which may lie between samples, in extremes."""
        self._take_extremes(self.n_steps, state)

    def _take_extremes(self, step, state):
        """Count a state in least margins, largest slip and opening; return both of it, (n,) m."""
        initial, normal = (self.constants[f"contact_{n}"] for n in ("initial", "normal"))
        traction, records = state["contact_traction"], self.records
        for least, strength in zip(records["margin"], self.strengths, strict=True):
            sticks = np.flatnonzero(np.isfinite(strength[[0, 2]]).any(axis=0))
            factors = slip_factors(
                initial[sticks], traction[sticks] - initial[sticks], normal[sticks],
                *strength[:, sticks],
            )  # fmt: skip
            least[sticks] = np.minimum(least[sticks], factors)
        slip, opening = self.moved(state["contact_state"])
        later = slip > records["largest_slip"]
        records["slip_step"][later] = step
        np.maximum(slip, records["largest_slip"], out=records["largest_slip"])
        np.maximum(opening, records["largest_opening"], out=records["largest_opening"])
        return slip, opening

    def moved(self, contact_state):
        """Return slip since the start and opening of every contact, (n,) m."""
        slip = contact_state[:, SLIP] - self.begun["contact_state"][:, SLIP]
        slip = np.where(self.slides, np.linalg.norm(slip, axis=1), 0.0)
        return slip, np.where(self.opens, contact_state[:, GAP], 0.0)

    def yielded(self, contact_state) -> np.ndarray:
        """Tell which contacts slipped or opened since the start of the blast, (n,) bool."""
        begun = self.begun["contact_state"]
        failed = contact_state[:, FAILED] > begun[:, FAILED]
        return self.slides & (failed | (contact_state[:, SLIP] != begun[:, SLIP]).any(axis=1))

    def _safety(self, here, state, normal):
        """Return the factor of safety of chosen contacts against sliding as a whole."""
        cohesion, friction = self._present(state["contact_state"])
        traction, area = state["contact_traction"][here], self.area[here]
        along = np.einsum("ci,ci->c", traction, normal[here])
        pressed = np.where(along <= 0.0, cohesion[here] - along * friction[here], 0.0)
        shear = area @ (traction - along[:, None] * normal[here])
        shear_force, strength = float(np.linalg.norm(shear)), float(area @ pressed)
        free = shear_force == 0.0 or shear_force <= ROUNDING * strength
        return math.inf if free else strength / shear_force

    def _present(self, contact_state):
        """Return cohesion and friction that are left of every contact; NaN where a law has none."""
        failed = contact_state[:, FAILED] > 0.0
        strength = np.full((2, len(self.number)), np.nan)
        for number, joint in enumerate(self.joints):
            here, own = self.number == number, joint.properties
            if joint.law == "softening":
                worn = np.minimum(1.0, contact_state[here, 6] / own["weakening_slip"])
                strength[0, here] = own["cohesion"] * (1.0 - worn)
                drop = own["friction"] - own["friction_dynamic"]
                strength[1, here] = own["friction"] - worn * drop
            elif "cohesion" in own:
                for row, name in enumerate(("cohesion", "friction")):
                    residual = own.get(f"{name}_residual", own[name])
                    strength[row, here] = np.where(failed[here], residual, own[name])
        return strength

    def by_surface(self, ended) -> dict[str, JointSlip]:
        """Return the `JointSlip` of each surface that sticks below its strength.

        Parameters
        ----------
        ended : dict of str to numpy array
            State at the end of the run.
        """
        self.take_end(ended)
        had, strengths = self.begun["contact_state"][:, FAILED] > 0.0, {}
        has = self.yielded(ended["contact_state"])
        for number, joint in enumerate(self.joints):
            here = self.number == number
            if JOINT_LAWS[joint.law].sticks:
                whole = here & ~had
                # Where nothing moves no factor is finite; contacts that failed before are left out.
                margins = self.records["margin"]
                first = [float(np.min(margins[k][whole], initial=np.inf)) for k in (0, -1)]
                counts = (int(np.count_nonzero(mask)) for mask in (here, here & had, here & has))
                strengths[joint.surface] = JointSlip(*counts, *first)
        return strengths


def run_with_slip(model, duration, highest, weakest=None, progress=None):
    """Run a model and compare the tractions on its joints with their strength.

    Parameters
    ----------
    model : Model
    duration : float, s
    highest : float, Hz
        Highest frequency of the motion.
    weakest : sequence of Joint, optional
        The same joints with other strengths.
    progress : callable, optional
        Called with (stage, done, total).

    Returns
    -------
    Run
    dict of str to JointSlip
        By joint surface, of those whose law has a strength and sticks below it.

    Raises
    ------
    SolverError
        As `simulate`.
    """
    prepared = prepare(model, duration, progress)
    observer = JointObserver(model, prepared, highest, weakest)
    run = simulate(model, duration, progress=progress, prepared=prepared, observer=observer)
    return run, observer.by_surface(run.state)


def _strengths(joints, constants):
    """Return cohesion, friction and tension of every contact, infinite where none slips."""
    rows = np.tile([np.inf, 0.0, np.inf], (max(1, len(joints)), 1))
    for number, joint in enumerate(joints):
        if JOINT_LAWS[joint.law].sticks:
            rows[number] = [joint.properties[name] for name in STRENGTH]
    return rows[constants["contact_joint"]].T


def slip_factors(initial, change, normal, cohesion, friction, tension):
    """Return the factor on a blast at which each contact slips or opens, (n,).

    Parameters
    ----------
    initial, change : (n, 3) float64, Pa
        Traction before the blast, and its change in the blast.
    normal : (n, 3) float64
    cohesion, tension : (n,) float64, Pa
    friction : (n,) float64
        As a tangent.

    Returns
    -------
    (n,) float64
        Zero where no strength remains before the blast, infinite where no factor suffices.

    Notes
    -----
    theory.md (11.5), its least root above zero.
    """
    rest, blast = (np.einsum("ci,ci->c", traction, normal) for traction in (initial, change))
    shear = initial - rest[:, None] * normal
    added = change - blast[:, None] * normal
    with np.errstate(divide="ignore", invalid="ignore"):
        opens = np.where(blast > 0.0, (tension - rest) / blast, np.inf)
    pairs = (shear, shear), (shear, added), (added, added)
    products = [np.sum(np.multiply(*pair), axis=1) for pair in pairs]
    pressed = _roots(*products, cohesion - rest * friction, friction * blast)
    free = _roots(*products, cohesion, 0.0)
    tolerance = ROUNDING * np.abs(rest)
    with np.errstate(invalid="ignore"):
        valid = np.stack([rest + pressed * blast <= tolerance, rest + free * blast >= -tolerance])
    roots = np.where(valid, np.stack([pressed, free]), np.inf)
    slips = np.where(np.isfinite(cohesion), roots.min(axis=(0, 1)), np.inf)
    shear_strength = cohesion - np.minimum(0.0, rest) * friction
    weak = np.linalg.norm(shear, axis=1) >= (1.0 - AT_YIELD) * shear_strength
    return np.where(weak | (rest >= tension), 0.0, np.fmin(slips, opens))


def _roots(of_shear, of_both, of_added, strength, loss):
    """Return both m > 0 with ``|shear + m added| = |strength - m loss|``, (2, n); else infinite.

    From the products of both vectors with themselves and with each other, (n,) each.
    """
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        a = of_added - loss**2
        b = of_both + loss * strength
        q = of_shear - strength**2
        far = -b - np.copysign(np.sqrt(b**2 - a * q), b)
        roots = np.stack([far / a, q / far])
        return np.where(roots > 0.0, roots, np.inf)
