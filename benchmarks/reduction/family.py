"""A family of linear models that share mesh, sources, receivers and time step."""

import math
from dataclasses import dataclass, replace

import numpy as np

from pyblast.core import JOINT_LAWS
from pyblast.errors import InputError
from pyblast.model.boundary import VelocityInput
from pyblast.model.model import Model
from pyblast.solver.assembly import geometry_arrays, initial_state, time_step
from pyblast.solver.perturbation import STICKING_JOINTS, refuse_nonlinear
from pyblast.solver.preparation import Prepared, prepare

from .ranges import Ranges

STUCK, STIFF = [JOINT_LAWS[name].number for name in STICKING_JOINTS], JOINT_LAWS["elastic"].number


@dataclass(frozen=True, eq=False)
class Family:
    """Models that differ in joint stiffness and damping, marched in equal steps.

    Step and masses are those of the stiffest and most damped of them, which all can bear.

    Parameters
    ----------
    base : Model
    ranges : Ranges
    step : tuple of float and CriticalStep
        Time step in s, and the limit that tells the added mass.
    mass : (n_nodes,) float64, kg
        With what was added for the sake of the step.
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
        """Duration that makes a run march ``n_steps``, s."""
        return (self.n_steps - 0.5) * self.dt

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
        found = prepare(replace(self.model(values), insitu=None), self.duration, step=self.step)
        law = found.constants["joint_law"]
        constants = {
            **found.constants,
            "joint_law": np.where(np.isin(law, STUCK), STIFF, law).astype(np.int32),
            "contact_initial": np.zeros_like(found.constants["contact_initial"]),
        }
        return replace(found, constants=constants, state=initial_state(constants))

    def stressed(self, values) -> Prepared:
        """Return a model of the family with its strength and in-situ stress, ready to march."""
        return prepare(self.model(values), self.duration, step=self.step)


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
    _refuse(model)
    ranges.suits(model)
    if not model.receivers:
        raise InputError("reduced: the model has no receivers, so nothing could be answered")
    for name, value in (("duration", duration), ("highest", highest)):
        if not 0.0 < value < math.inf:
            raise InputError(f"reduced.{name}: must be positive, got {value:g}")
    stiffest = ranges.model(model, ranges.corner(1))
    step = time_step(stiffest)
    mass = geometry_arrays(stiffest, step)[0]["node_mass"]
    return Family(model, ranges, step, mass, max(2, math.ceil(duration / step[0])), highest)


def _refuse(model):
    """Refuse models whose motion is not proportional to what drives them, or is prescribed."""
    refuse_nonlinear(model, "a reduced model needs", ("elastic", *STICKING_JOINTS))
    for one in model.boundaries:
        if isinstance(one, VelocityInput):
            raise InputError(
                f"boundaries.{one.surface}: a reduced model cannot prescribe velocity; use "
                "StressInput, which drives the face by its impedance"
            )
