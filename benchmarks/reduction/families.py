"""Families of linear models: parameter ranges, common mesh, sources and time step."""

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import qmc

from pyblast.core import JOINT_LAWS
from pyblast.errors import InputError
from pyblast.model.boundary import VelocityInput
from pyblast.model.joint import STICKING_JOINTS
from pyblast.model.model import Model
from pyblast.solver.assembly import geometry_arrays, initial_state, time_step
from pyblast.solver.preparation import Prepared, prepare

JOINT_KEYS = ("kn", "ks")
DAMPING_KEY = "ratio"


@dataclass(frozen=True)
class Ranges:
    """Parameter ranges of joint stiffness and damping.

    Parameters
    ----------
    limits : dict of str to (low, high)
        ``kn`` and ``ks`` in Pa/m of all joints, or of one as ``kn.NAME``; ``ratio`` of the damping
        of all groups, or of one as ``ratio.GROUP``.

    Raises
    ------
    InputError
        If a key is unknown or given twice, or a range is empty.
    """

    limits: dict[str, tuple[float, float]]

    def __post_init__(self):
        """Check the keys and limits."""
        if not self.limits:
            raise InputError("ranges: give at least one of kn, ks, ratio")
        for key, (low, high) in self.limits.items():
            quantity, _, place = key.partition(".")
            if quantity not in (*JOINT_KEYS, DAMPING_KEY):
                raise InputError(f"ranges.{key}: must be kn, ks or ratio, or one with .NAME")
            if place and quantity in self.limits:
                raise InputError(f"ranges.{key}: '{quantity}' varies everywhere already; drop one")
            if not 0.0 < low < high < math.inf:
                raise InputError(
                    f"ranges.{key}: must be two ascending positive numbers, got {low:g}, {high:g}"
                )

    def check_model(self, model):
        """Raise InputError where the model lacks a joint or damping of the ranges."""
        surfaces = [joint.surface for joint in model.joints]
        for key in self.limits:
            quantity, _, place = key.partition(".")
            if quantity in JOINT_KEYS and (place or surfaces[:1]) not in (surfaces[:1], *surfaces):
                known = ", ".join(surfaces) or "none"
                raise InputError(f"ranges.{key}: no such joint; there are {known}")
            if quantity in JOINT_KEYS and not surfaces:
                raise InputError(f"ranges.{key}: the model has no joints; leave it out")
            if quantity == DAMPING_KEY and model.damping is None:
                raise InputError(f"ranges.{key}: the model has no damping; give it one to vary")
            by_group = isinstance(model.damping, dict)
            if (
                quantity == DAMPING_KEY
                and place
                and place not in (model.damping if by_group else ())
            ):
                known = ", ".join(model.damping) if by_group else "one for all groups"
                raise InputError(f"ranges.{key}: no damping of that group; there is {known}")

    def model(self, model, values):
        """Return a model with these values of stiffness and damping."""
        for key, value in values.items():
            quantity, _, place = key.partition(".")
            if quantity == DAMPING_KEY:
                model = replace(model, damping=_damped(model.damping, place, value))
                continue
            for joint in model.joints:
                if place in ("", joint.surface):
                    model = model.with_joint(joint.surface, **{quantity: value})
        return model

    def check(self, values):
        """Raise InputError for values of other parameters or outside the ranges.

        Raises
        ------
        InputError
        """
        if set(values) != set(self.limits):
            raise InputError(
                f"reduced: needs values of {', '.join(self.limits)}, got "
                f"{', '.join(values) or 'none'}"
            )
        for key, (low, high) in self.limits.items():
            if not low * (1.0 - 1e-12) <= values[key] <= high * (1.0 + 1e-12):
                raise InputError(
                    f"reduced.{key}: trained from {low:g} to {high:g}, got {values[key]:g}; stay "
                    "inside or train a wider range"
                )

    def corner(self, end):
        """Return the values at the lower (0) or upper (1) ends of all ranges."""
        return {key: limit[end] for key, limit in self.limits.items()}

    def middle(self):
        """Return the geometric centre of all ranges."""
        return self.at([0.5] * len(self.limits))

    def at(self, fractions):
        """Return the values at fractions (n,) of the ranges, linear in the logarithm."""
        pairs = zip(self.limits.items(), fractions, strict=True)
        return {
            key: float(low * (high / low) ** fraction) for (key, (low, high)), fraction in pairs
        }

    def training(self, count, seed):
        """Return training values: a Sobol sequence, denser towards the edges (arcsine).

        The first points of a longer sequence are those of a shorter one.
        """
        sobol = qmc.Sobol(len(self.limits), rng=np.random.default_rng(seed))
        unit = sobol.random(2 ** math.ceil(math.log2(max(2, count))))[:count]
        return [self.at(0.5 - 0.5 * np.cos(np.pi * row)) for row in unit]

    def validation(self, count, seed):
        """Return validation values: random, log-uniform, independent of the training values."""
        rng = np.random.default_rng([seed, 1])
        return [self.at(row) for row in rng.random((count, len(self.limits)))]


def _damped(damping, group, ratio):
    """Return the damping with a new ratio, of all groups or of one."""
    if not isinstance(damping, dict):
        return replace(damping, ratio=ratio)
    return {
        name: replace(part, ratio=ratio) if group in ("", name) else part
        for name, part in damping.items()
    }


STUCK, STIFF = [JOINT_LAWS[name].number for name in STICKING_JOINTS], JOINT_LAWS["elastic"].number


@dataclass(frozen=True, eq=False)
class Family:
    """Family of models that differ in joint stiffness and damping, with one time step.

    Time step and nodal masses are those of the stiffest and most damped model, which are stable
    for all.

    Parameters
    ----------
    base : Model
    ranges : Ranges
    step : tuple of float and CriticalStep
        Time step in s, and the limit behind it.
    mass : (n_nodes,) float64, kg
    n_steps : int
    highest : float, Hz
        Highest frequency of the motion.
    """

    base: Model
    ranges: Ranges
    step: tuple
    mass: np.ndarray
    n_steps: int
    highest: float

    @property
    def dt(self):
        """Time step, s."""
        return self.step[0]

    @property
    def duration(self):
        """Duration of a run of ``n_steps``, s."""
        return (self.n_steps - 0.5) * self.dt

    @property
    def every(self):
        """Steps between snapshots, 8 to the shortest period."""
        return max(1, math.floor(1.0 / (8.0 * self.highest * self.dt)))

    def model(self, values) -> Model:
        """Return the model with these values."""
        return self.ranges.model(self.base, values)

    def prepared(self, values) -> Prepared:
        """Return a prepared model of the family, with the common step and masses.

        Without strength and in-situ stress, which do not change the motion of a linear run.
        """
        prepared = prepare(replace(self.model(values), insitu=None), self.duration, step=self.step)
        law = prepared.constants["joint_law"]
        constants = {
            **prepared.constants,
            "joint_law": np.where(np.isin(law, STUCK), STIFF, law).astype(np.int32),
            "contact_initial": np.zeros_like(prepared.constants["contact_initial"]),
        }
        return replace(prepared, constants=constants, state=initial_state(constants))

    def stressed(self, values) -> Prepared:
        """Return a prepared model of the family with its strength and in-situ stress."""
        return prepare(self.model(values), self.duration, step=self.step)


def family(model: Model, ranges: Ranges, duration: float, highest: float) -> Family:
    """Return a family of models.

    Parameters
    ----------
    model : Model
    ranges : Ranges
    duration : float, s
    highest : float, Hz

    Raises
    ------
    InputError
        If a model is not linear, lacks a parameter of the ranges, or has no receivers.
    """
    _refuse(model)
    ranges.check_model(model)
    if not model.receivers:
        raise InputError("reduced: the model has no receivers; add one")
    for name, value in (("duration", duration), ("highest", highest)):
        if not 0.0 < value < math.inf:
            raise InputError(f"reduced.{name}: must be positive, got {value:g}")
    stiffest = ranges.model(model, ranges.corner(1))
    step = time_step(stiffest)
    mass = geometry_arrays(stiffest, step)[0]["node_mass"]
    return Family(model, ranges, step, mass, max(2, math.ceil(duration / step[0])), highest)


def _refuse(model):
    """Raise InputError for nonlinear models and for prescribed velocities."""
    if model.quadratic:
        raise InputError(
            "model.quadratic: a reduced model needs zones of constant strain; leave quadratic out "
            "and take shorter edges"
        )
    joints = ("elastic", *STICKING_JOINTS)
    for joint in model.joints:
        if joint.law not in joints:
            raise InputError(
                f"joints.{joint.surface}.law: a reduced model needs a stiffness that does not "
                f"change, got '{joint.law}'; take one of {', '.join(joints)}"
            )
    for group in model.mesh.groups:
        if model.law(group).name != "elastic":
            raise InputError(
                f"materials.{group}: a reduced model needs isotropic ground, elastic or "
                f"attenuating, got '{model.law(group).name}'; take another law there"
            )
    if model.local_damping:
        raise InputError(
            "local_damping: a reduced model needs damping in proportion to motion, got "
            f"{model.local_damping:g}; set it to zero"
        )
    for boundary in model.boundaries:
        if isinstance(boundary, VelocityInput):
            raise InputError(
                f"boundaries.{boundary.surface}: a reduced model cannot prescribe velocity; use "
                "StressInput, which drives the face by its impedance"
            )
