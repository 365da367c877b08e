"""A family of linear models that share mesh, sources, receivers and time step."""

import math
from dataclasses import dataclass, replace

import numpy as np

from ..errors import InputError
from ..solving.assembly import dynamic_arrays, geometry_arrays, initial_state
from ..solving.boundaries import VelocityInput
from ..solving.kernels import JOINT_LAWS
from ..solving.model import Model
from ..solving.preparation import Prepared, prepare
from ..solving.provenance import fingerprint
from .ranges import Ranges

STICKING = ("coulomb", "softening")  # linear as long as no contact slips or opens
STUCK, STIFF = [JOINT_LAWS[name].number for name in STICKING], JOINT_LAWS["elastic"].number


@dataclass(frozen=True, eq=False)
class Family:
    """Models that differ in joint stiffness and damping, marched in equal steps.

    Step and masses are those of the stiffest and most damped of them, which all can bear.

    Parameters
    ----------
    base : Model
    ranges : Ranges
    dt : float, s
    mass : (n_nodes,) float64, kg
        With what was added for the sake of the step.
    n_steps : int
    highest : float, Hz
        Highest frequency of the motion.
    """

    base: Model
    ranges: Ranges
    dt: float
    mass: np.ndarray
    n_steps: int
    highest: float

    @property
    def duration(self):
        """Duration of a run, s."""
        return self.n_steps * self.dt

    @property
    def every(self):
        """Steps between samples of the motion to learn from, 8 to the shortest period."""
        return max(1, math.floor(1.0 / (8.0 * self.highest * self.dt)))

    def model(self, values) -> Model:
        """Return the model of some values."""
        return self.ranges.model(self.base, values)

    def prepared(self, values) -> Prepared:
        """Return a model of the family, ready to march with the step and masses of all.

        Without strength and in-situ stress, which do not change the motion until they are
        overcome.
        """
        model = self.model(values)
        geometry, limit = geometry_arrays(model)
        drag = geometry["node_alpha"] * geometry["node_mass"]
        law = np.where(np.isin(geometry["joint_law"], STUCK), STIFF, geometry["joint_law"])
        geometry |= {
            "dt": self.dt,
            "node_mass": self.mass,
            "node_alpha": drag / self.mass,
            "joint_law": law.astype(np.int32),
            "contact_initial": np.zeros_like(geometry["contact_initial"]),
        }
        constants = {**geometry, **dynamic_arrays(model, geometry, self.n_steps)}
        state = initial_state(constants)
        return Prepared(constants, state, self.n_steps, limit, {}, fingerprint(constants, state))

    def stressed(self, values) -> Prepared:
        """Return a model of the family with its strength and in-situ stress, ready to march."""
        free, own = self.prepared(values), prepare(self.model(values), self.duration)
        kept = ("joint_law", "contact_initial", "node_load", "row_initial")
        constants = {**free.constants, **{name: own.constants[name] for name in kept}}
        mark = fingerprint(constants, own.state)
        return replace(own, constants=constants, n_steps=self.n_steps, fingerprint=mark)


def family(model: Model, ranges: Ranges, duration: float, highest: float) -> Family:
    """Make a family of models.

    Parameters
    ----------
    model : Model
    ranges : Ranges
    duration : float, s
    highest : float, Hz

    Raises
    ------
    InputError
        If a model is not linear, its ranges do not suit it, or nothing is driven or recorded.
    """
    refuse_nonlinear(model)
    ranges.suits(model)
    if not model.receivers:
        raise InputError("reduced: the model has no receivers, so nothing could be answered")
    for name, value in (("duration", duration), ("highest", highest)):
        if not 0.0 < value < math.inf:
            raise InputError(f"reduced.{name}: must be positive, got {value:g}")
    stiffest, _ = geometry_arrays(ranges.model(model, ranges.corner(1)))
    dt, mass = stiffest["dt"], stiffest["node_mass"]
    return Family(model, ranges, dt, mass, max(2, math.ceil(duration / dt)), highest)


def refuse_nonlinear(model):
    """Refuse models whose motion is not proportional to what drives them.

    Raises
    ------
    InputError
        With the part that is to blame.
    """
    for joint in model.joints:
        if joint.law not in ("elastic", *STICKING):
            raise InputError(
                f"joints.{joint.surface}.law: a reduced model needs a stiffness that does not "
                f"change, got '{joint.law}'; take one of elastic, {', '.join(STICKING)}"
            )
    for group in model.mesh.groups:
        law = model.law(group).name
        if law != "elastic":
            raise InputError(
                f"materials.{group}: a reduced model needs isotropic ground, elastic or fading, "
                f"got '{law}'; take another law there"
            )
    for one in model.boundaries:
        if isinstance(one, VelocityInput):
            raise InputError(
                f"boundaries.{one.surface}: a reduced model cannot prescribe velocity; use "
                "StressInput, which drives the face by its impedance"
            )
    if model.local_damping:
        raise InputError(
            "local_damping: a reduced model needs damping in proportion to motion, got "
            f"{model.local_damping:g}; set it to zero"
        )
