"""One contact of a joint, led through jumps by hand: what the tests of joint laws share."""

from itertools import pairwise

import numpy as np

from pyblast import core
from pyblast.core import JOINT_LAWS, N_JOINT_PROPERTIES, N_JOINT_STATE

KN, KS = 2.0e9, 0.8e9
DT = 1e-4
COHESION, FRICTION, TENSION = 3.0e5, 0.6, 2.0e5
STRENGTH = {"cohesion": COHESION, "friction": FRICTION, "tension": TENSION}
WEAKER = {"cohesion_residual": 1.0e5, "friction_residual": 0.4, "tension_residual": 0.0}
TYPICAL = {"Pa/m": KN, "Pa s/m": 4e5, "Pa": 1e5, "m": 1e-3, "s": 1e-3, "tan": 0.5, "1": 0.5}
OTHERS = {
    "dilation": 0.0, "dilation_slip": 0.0, "friction_dynamic": 0.4, "weakening_slip": 1e-3,
    "closure": 1e-3, "kn_max": 50.0 * KN, "irrecoverable": 0.2, "jrc": 8.0, "jcs": 4e7,
    "peak_slip": 2e-3, "pressure": 1e5, "exponent": 0.5, "eta_n": 4e5, "eta_s": 2e5,
    "friction_initial": 0.9, "roughness": 2e-3,
}  # fmt: skip
SAME = {f"{name}_residual": value for name, value in STRENGTH.items()}
NORMAL = np.array([0.0, 0.0, 1.0])


def properties(law, **changed):
    """Return properties that suit a law, those of `Joint`, some changed.

    A property that stands neither here nor in ``changed`` has its default, unless that is zero or
    infinite, or else a typical value of its unit, in its range.
    """
    known = {"kn": KN, "ks": KS, **STRENGTH, **SAME, **OTHERS, **changed}
    values = {}
    for name, prop in JOINT_LAWS[law].properties.items():
        factor, other = prop.default or (0.0, "")
        default = factor * values[other] if other else factor
        value = default if 0.0 < default < np.inf else TYPICAL[prop.unit]
        for sign, bound in prop.rules:
            bound = values.get(bound, value) if isinstance(bound, str) else bound
            value = max(value, 2.0 * bound) if sign[0] == ">" else min(value, 0.5 * bound)
        values[name] = known.get(name, value)
    return values


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

    def _law(self, jump, since=None, dt=DT):
        step = jump - (self.jump if since is None else since)
        return core._core.pyblast_joint_laws.joint_traction(
            self.number, self.property, dt, self.initial, self.normal, jump, step, self.state
        )

    def move(self, *jump):
        """Move to a jump (3,) in m; return the traction (3,) in Pa."""
        jump = np.asarray(jump if len(jump) == 3 else jump[0], dtype=float)
        traction, stored = self._law(jump)
        work = 0.5 * (self.traction + traction) @ (jump - self.jump)
        self.dissipated += work - (stored - self.stored)
        self.jump, self.traction, self.stored = jump, traction, stored
        return traction

    def glide(self, jump, error):
        """Move to a jump (3,) in m along a line, the work integrated within an error in J/m2."""
        before = self.stored
        work = self._glided(self.jump, np.asarray(jump, dtype=float), DT, error)
        self.dissipated += work - (self.stored - before)

    def _glided(self, start, end, dt, error, depth=50):
        """Return the work along a line by Simpson's rule, halved where the law has a corner."""
        state, traction = self.state.copy(), self.traction
        places = start + np.linspace(0.0, 1.0, 5)[:, None] * (end - start)
        powers = [traction @ (end - start)]
        for since, place in pairwise(places):
            self.traction, self.stored = self._law(place, since, 0.25 * dt)
            powers.append(self.traction @ (end - start))
        self.jump = end
        first, quarter, middle, other, last = powers
        coarse = (first + 4.0 * middle + last) / 6.0
        fine = (first + 4.0 * quarter + 2.0 * middle + 4.0 * other + last) / 12.0
        if depth == 0 or abs(fine - coarse) <= error:
            return fine
        self.state, self.traction = state, traction
        half = self._glided(start, places[2], 0.5 * dt, error, depth - 1)
        return half + self._glided(places[2], end, 0.5 * dt, error, depth - 1)

    def says(self, name):
        """Return one number of the state."""
        return self.state[self.names.index(name)]


def given_back(law, initial, path, **changed):
    """Return the energy that a law gives back along a path (n, 3), over the most that it stored.

    The work is summed as in a run, by trapezoids; where these leave less than nothing dissipated,
    as they may for a law that keeps all, it is integrated along lines between the jumps.
    """
    contact, most = Contact(law, initial, **changed), 0.0
    for jump in path:
        contact.move(jump)
        most = max(most, contact.stored)
    if contact.dissipated < 0.0:
        contact = Contact(law, initial, **changed)
        for jump in path:
            contact.glide(jump, 1e-16 * most)
    return max(0.0, -contact.dissipated / most)


def cycles(seed, n_steps=4000, size=6e-4):
    """Return a random closed path (n_steps, 3) of jumps that begins and ends at zero."""
    rng = np.random.default_rng(seed)
    phase = 2.0 * np.pi * np.linspace(0.0, 1.0, n_steps)
    waves = np.sin(np.outer(phase, np.arange(1, 6)))
    return size * waves @ rng.normal(size=(5, 3))
