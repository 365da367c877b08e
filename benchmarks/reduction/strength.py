"""Whether contacts of a family come to slip or to open, told from its small system."""

import math
from dataclasses import dataclass, replace

import numpy as np

from pyblast.errors import InputError
from pyblast.solver.perturbation import FAILED, STATUS, STICKING_JOINTS

from .galerkin import joint_jumps

WATCHED = 256  # contacts, over all joints
PER_PERIOD = 10  # samples of tractions to the shortest period
PART = 512  # contacts whose tractions are formed at once
AT_REST = 1e-9  # of the largest shear traction: what is taken for none


@dataclass(frozen=True, eq=False)
class Watched:
    """Contacts of one joint that come nearest to their strength.

    Parameters
    ----------
    surface : str
    strength : tuple of 3 float
        Cohesion in Pa, friction as a tangent, tension in Pa.
    jump : (n, 3, size) float64
        Of the directions of the basis.
    normal : (n, 3) float64
    initial : (n, 3) float64, Pa
        Traction before the blast, in the middle of the ranges.
    """

    surface: str
    strength: tuple[float, float, float]
    jump: np.ndarray
    normal: np.ndarray
    initial: np.ndarray


def watched(projection, solutions):
    """Return the contacts to watch: those that came nearest to their strength in known runs.

    Parameters
    ----------
    projection : Projection
    solutions : list of (values, Solution)

    Returns
    -------
    list of Watched
        Of the joints that can slip.

    Raises
    ------
    InputError
        If a contact slips or opens before the blast.
    """
    model, contacts = projection.family.base, projection.family.base.mesh.contacts
    joints = {one.surface: one for one in model.joints if one.law in STICKING_JOINTS}
    if not joints:
        return []
    stressed = projection.family.stressed(projection.family.ranges.middle())
    found, uses = [], []
    for number, name in enumerate(contacts.names):
        if name in joints:
            here = contacts.joint == number
            _refuse_failed(name, stressed.state["contact_state"][here])
            values = [joints[name].properties[k] for k in ("cohesion", "friction", "tension")]
            jump, normal, _ = joint_jumps(contacts, number, projection.directions)
            initial = stressed.constants["contact_initial"][here]
            found.append(Watched(name, tuple(values), jump, normal, initial))
            uses.append(np.max([use(projection, found[-1], *one) for one in solutions], axis=0))
    least = np.sort(np.concatenate(uses))[-WATCHED:][0]
    kept = [one >= least for one in uses]
    return [_chosen(one, here) for one, here in zip(found, kept, strict=True) if here.any()]


def _chosen(one, here):
    """Return some of the contacts of a joint."""
    return replace(one, jump=one.jump[here], normal=one.normal[here], initial=one.initial[here])


def _refuse_failed(name, state):
    """Refuse a joint with contacts that fail in the static stage."""
    count = np.count_nonzero((state[:, FAILED] > 0.0) | (state[:, STATUS] > 0.0))
    if count:
        raise InputError(
            f"joints.{name}: {count} of {len(state)} contacts slip or open before the blast, where "
            "a reduced model does not hold; take the law 'elastic' or a stronger joint"
        )


def use(projection, one, values, solution):
    """Return the largest share of its strength that each contact uses, (n,); 1 where it fails."""
    family, on = projection.family, projection.line
    joints = family.ranges.model(family.base, values).joints
    kn, ks = next(
        (j.properties["kn"], j.properties["ks"]) for j in joints if j.surface == one.surface
    )
    count = math.ceil(PER_PERIOD * family.highest * on.n_period * on.dt)
    motion = on.back(solution.motion, min(on.n_period, count))
    shares = []
    for first in range(0, len(one.normal), PART):
        part = slice(first, first + PART)
        jump, normal = one.jump[part], one.normal[part]
        moved = (jump.reshape(-1, jump.shape[2]) @ motion.T).reshape(len(jump), 3, -1)
        opening = np.einsum("cit,ci->ct", moved, normal)
        along = opening[:, None] * normal[:, :, None]
        pull = kn * opening + np.sum(one.initial[part] * normal, axis=1)[:, None]
        resting = one.initial[part] - np.sum(one.initial[part] * normal, axis=1)[:, None] * normal
        shear = np.linalg.norm(resting[:, :, None] + ks * (moved - along), axis=1)
        shares.append(_share(pull, shear, one.strength))
    return np.concatenate(shares)


def _share(pull, shear, strength):
    """Return the largest share of strength in time of tractions (n, n_times); theory.md (3.2)."""
    cohesion, friction, tension = strength
    limit = cohesion + np.maximum(0.0, -pull) * friction
    idle = shear <= AT_REST * max(shear.max(), np.finfo(float).tiny)
    with np.errstate(divide="ignore"):
        share = np.where(idle, 0.0, shear / limit)
    return np.where(pull > tension, np.inf, share).max(axis=1)


def refuse_slip(projection, contacts, values, solution):
    """Return the largest share of strength used, and refuse values at which it is all used.

    Raises
    ------
    InputError
        With the joint and the count.
    """
    largest = 0.0
    for one in contacts:
        share = use(projection, one, values, solution)
        if (share >= 1.0).any():
            raise InputError(
                f"joints.{one.surface}: {np.count_nonzero(share >= 1.0)} of {len(share)} watched "
                "contacts slip or open at these values, where a reduced model does not hold; make "
                "a full run"
            )
        largest = max(largest, float(share.max()))
    return largest
