"""Slip and opening of joints in a run, and how far each is from them."""

import math
from dataclasses import dataclass

import numpy as np

from .. import core
from ..core import JOINT_LAWS
from ..errors import SolverError
from ..laws import of_laws
from ..model.joint import FAILED, SLIP
from .preparation import LEDGER_EVERY, prepare
from .run import collect, failure

PER_PERIOD = 20  # checks of the tractions in the shortest period
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
        As `run`.
    """
    prepared = prepare(model, duration, progress)
    joints = model.numbered_joints
    other = {joint.surface: joint for joint in weakest or joints}
    variants = [joints, [other[joint.surface] for joint in joints]]
    strengths = [_strengths(variant, prepared.constants) for variant in variants]
    initial, normal = (prepared.constants[f"contact_{n}"] for n in ("initial", "normal"))
    least = np.full((2, len(initial)), np.inf)

    def observe(state):
        change = state["contact_traction"] - initial
        for k, strength in enumerate(strengths):
            np.minimum(least[k], slip_factors(initial, change, normal, *strength), out=least[k])

    every = max(1, math.floor(1.0 / (PER_PERIOD * highest * prepared.constants["dt"])))
    run = _run_observed(model, prepared, every, observe, progress)
    return run, _by_surface(joints, run, least)


def _run_observed(model, prepared, every, observe, progress):
    """Run a model and call a function with its state every few steps."""
    views, state = prepared.begun()
    motion, energy, step, total = [], [], 0, prepared.n_steps
    while step < total:
        chunk, ledger, failed = core.advance(
            views, state, step, min(every, total - step), LEDGER_EVERY
        )
        motion.append(chunk)
        energy.append(ledger)
        step += len(chunk)
        if failed is not None:
            raise SolverError(failure(model, prepared, step, failed))
        observe(state)
        if progress is not None:
            progress("dynamic", step, total)
    whole = prepared.whole(np.concatenate(motion))
    return collect(model, prepared, whole, np.concatenate(energy), state, 0.0, {})


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
    pressed = _roots(shear, added, cohesion - rest * friction, friction * blast)
    free = _roots(shear, added, cohesion, 0.0)
    tolerance = ROUNDING * np.abs(rest)
    with np.errstate(invalid="ignore"):
        valid = np.stack([rest + pressed * blast <= tolerance, rest + free * blast >= -tolerance])
    roots = np.where(valid, np.stack([pressed, free]), np.inf)
    slips = np.where(np.isfinite(cohesion), roots.min(axis=(0, 1)), np.inf)
    shear_strength = cohesion - np.minimum(0.0, rest) * friction
    weak = np.linalg.norm(shear, axis=1) >= (1.0 - AT_YIELD) * shear_strength
    return np.where(weak | (rest >= tension), 0.0, np.fmin(slips, opens))


def _roots(shear, added, strength, loss):
    """Return both m > 0 with ``|shear + m added| = |strength - m loss|``, (2, n); else infinite."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        a = np.sum(added**2, axis=1) - loss**2
        b = np.sum(shear * added, axis=1) + loss * strength
        q = np.sum(shear**2, axis=1) - strength**2
        far = -b - np.copysign(np.sqrt(b**2 - a * q), b)
        roots = np.stack([far / a, q / far])
        return np.where(roots > 0.0, roots, np.inf)


def _by_surface(joints, run, least):
    """Return the `JointSlip` of each joint surface."""
    constants, begun, ended = run.prepared.constants, run.prepared.state, run.state
    sticks = of_laws(JOINT_LAWS, constants["joint_law"], "sticks")
    had = begun["contact_state"][:, FAILED] > 0.0
    has = (ended["contact_state"][:, FAILED] > begun["contact_state"][:, FAILED]) | (
        ended["contact_state"][:, SLIP] != begun["contact_state"][:, SLIP]
    ).any(axis=1)
    strengths = {}
    for number, joint in enumerate(joints):
        here = constants["contact_joint"] == number
        if sticks[number]:
            whole = here & ~had
            # Where nothing moves no factor is finite; contacts that failed before are left out.
            first = [float(np.min(row[whole], initial=np.inf)) for row in least]
            counts = (int(np.count_nonzero(chosen)) for chosen in (here, here & had, here & has))
            strengths[joint.surface] = JointSlip(*counts, *first)
    return strengths
