"""Sources split into a place, which a run is for, and a history, which is not."""

from dataclasses import replace

import numpy as np

from ..errors import InputError
from ..solving.boundaries import StressInput, VelocityInput
from ..solving.charges import Column, MomentTensor
from ..solving.loads import ADDERS, Loads
from ..solving.model import Model
from ..solving.perturbations import STICKING_JOINTS
from ..solving.sources import Hole, PointForce, TimeFunction

CHARGES = (Hole, Column)
KINDS = (*CHARGES, MomentTensor, PointForce)
LINEAR_JOINTS = ("elastic", "kelvin", "maxwell", *STICKING_JOINTS)
LINEAR_ZONES = ("elastic", "anisotropic")
NONE = TimeFunction(np.zeros(1), 1.0)


def unit_source(source):
    """Return a source of size one without firing time and history."""
    if isinstance(source, CHARGES):
        return replace(source, charge=1.0, time=0.0, moment_rate=NONE, exponent=1.0)
    if isinstance(source, MomentTensor):
        tensor = source.tensor / size(source)
        return replace(source, tensor=tensor, time=0.0, moment_rate=NONE)
    return replace(source, direction=np.asarray(source.direction) / size(source), history=NONE)


def size(source):
    """Return what multiplies the history: of a charge, the length of a tensor or a direction."""
    if isinstance(source, CHARGES):
        return source.charge**source.exponent
    vector = source.tensor if isinstance(source, MomentTensor) else source.direction
    return float(np.linalg.norm(vector)) or 1.0


def history(source, times):
    """Return the moment (n,) in N m, or the force in N, at times (n,) as a run reads it."""
    if isinstance(source, PointForce):
        return size(source) * source.history(times)
    return size(source) * source.moment_rate.integral()(times - source.time)


def place(source):
    """Return where a source is, (3,) m; of a column its middle."""
    if isinstance(source, Column):
        return 0.5 * np.add(source.primed, source.end)
    return np.asarray(source.position, dtype=float)


def likeness(source):
    """Return what two sources must have in common to share a run at one place."""
    if isinstance(source, Column):
        way = np.round(np.subtract(source.end, source.primed), 9)
        return Column, *way, source.detonation_speed, source.sources
    if isinstance(source, PointForce):
        return PointForce, *np.round(np.asarray(source.direction) / size(source), 9)
    if isinstance(source, MomentTensor):
        return MomentTensor, source.spread, *np.round(source.tensor / size(source), 9).ravel()
    return Hole, source.spread


def loads(model, source, n_steps, dt):
    """Return the load arrays of a source whose history is one from the second step on."""
    found = Loads()
    ADDERS[type(source)](found, model, source)
    step = np.ones((n_steps, 1))
    step[0] = 0.0
    return {**found.arrays(dt * np.arange(n_steps)), "history": step}


def refuse_what_does_not_superpose(model: Model):
    """Refuse models whose motion is not the sum of what each hole does, or not of holes alone.

    Raises
    ------
    InputError
        With the part that is to blame.
    """
    for joint in model.joints:
        if joint.law not in LINEAR_JOINTS:
            raise InputError(
                f"joints.{joint.surface}.law: holes do not superpose across '{joint.law}'; take "
                f"one of {', '.join(LINEAR_JOINTS)}, or run each blast as a whole"
            )
    for group in model.mesh.groups:
        if model.law(group).name not in LINEAR_ZONES:
            raise InputError(
                f"materials.{group}: holes do not superpose in ground of the law "
                f"'{model.law(group).name}'; take elastic ground, or run each blast as a whole"
            )
    if model.local_damping:
        raise InputError(
            "local_damping: holes do not superpose under it; set it to zero, got "
            f"{model.local_damping:g}"
        )
    for boundary in model.boundaries:
        if isinstance(boundary, (StressInput, VelocityInput)):
            raise InputError(
                f"boundaries.{boundary.surface}: stored responses are those of holes alone; take "
                f"the {type(boundary).__name__} out and add its motion afterwards"
            )
    for source in model.sources:
        if type(source) not in KINDS:
            raise InputError(
                f"sources: a {type(source).__name__} is no hole, column, tensor or force at a "
                "place; take it out and add its motion afterwards"
            )
    for part in ("sources", "receivers"):
        if not getattr(model, part):
            raise InputError(f"{part}: none; stored responses lead from sources to receivers")
