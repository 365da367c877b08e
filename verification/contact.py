"""One contact of a joint, led through jumps by hand: what the tests of joint laws share."""

import numpy as np

from pyblast import core
from pyblast.core import JOINT_LAWS, N_JOINT_PROPERTIES, N_JOINT_STATE

KN, KS = 2.0e9, 0.8e9
DT = 1e-4
COHESION, FRICTION, TENSION = 3.0e5, 0.6, 2.0e5
STRENGTH = {"cohesion": COHESION, "friction": FRICTION, "tension": TENSION}
WEAKER = {"cohesion_residual": 1.0e5, "friction_residual": 0.4, "tension_residual": 0.0}
OTHERS = {
    "dilation": 0.0, "dilation_slip": 0.0, "friction_dynamic": 0.4, "weakening_slip": 1e-3,
    "closure": 1e-3, "kn_max": 50.0 * KN, "irrecoverable": 0.2, "jrc": 8.0, "jcs": 4e7,
    "peak_slip": 2e-3, "pressure": 1e5, "exponent": 0.5, "eta_n": 4e5, "eta_s": 2e5,
    "friction_initial": 0.9, "roughness": 2e-3,
}  # fmt: skip
SAME = {f"{name}_residual": value for name, value in STRENGTH.items()}
NORMAL = np.array([0.0, 0.0, 1.0])


def properties(law, **changed):
    """Return properties that suit a law, those of `Joint`, some changed."""
    values = {"kn": KN, "ks": KS, **STRENGTH, **SAME, **OTHERS, **changed}
    return {name: values[name] for name in JOINT_LAWS[law].properties}


class Contact:
    """One contact led through jumps; it keeps its state and adds up what it dissipates."""

    def __init__(self, law="coulomb", initial=(0.0, 0.0, 0.0), normal=NORMAL, **changed):
        self.number = JOINT_LAWS[law].number + 1
        given = properties(law, **changed)
        self.property = core.property_row(JOINT_LAWS[law], given, N_JOINT_PROPERTIES)
        self.initial, self.normal = np.asarray(initial, dtype=float), np.asarray(normal)
        self.state = np.zeros(N_JOINT_STATE)
        self.names = JOINT_LAWS[law].state
        self.jump, self.dissipated = np.zeros(3), 0.0
        self.traction, self.stored = self._law(self.jump)

    def _law(self, jump):
        return core._core.pyblast_joint_laws.joint_traction(
            self.number,
            self.property,
            DT,
            self.initial,
            self.normal,
            jump,
            jump - self.jump,
            self.state,
        )

    def move(self, *jump):
        """Move to a jump (3,) in m; return the traction (3,) in Pa."""
        jump = np.asarray(jump if len(jump) == 3 else jump[0], dtype=float)
        traction, stored = self._law(jump)
        work = 0.5 * (self.traction + traction) @ (jump - self.jump)
        self.dissipated += work - (stored - self.stored)
        self.jump, self.traction, self.stored = jump, traction, stored
        return traction

    def says(self, name):
        """Return one number of the state."""
        return self.state[self.names.index(name)]


def cycles(seed, n_steps=4000, size=6e-4):
    """Return a random closed path (n_steps, 3) of jumps that begins and ends at zero."""
    rng = np.random.default_rng(seed)
    phase = 2.0 * np.pi * np.linspace(0.0, 1.0, n_steps)
    waves = np.sin(np.outer(phase, np.arange(1, 6)))
    return size * waves @ rng.normal(size=(5, 3))
