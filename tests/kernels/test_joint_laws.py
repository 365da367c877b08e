"""Laws of nature that every joint law keeps, and the memory of the Coulomb law."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pyblast.solving import kernels
from pyblast.solving.kernels import JOINT_LAWS, N_JOINT_PROPERTIES, N_JOINT_STATE

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
ALL_LAWS = pytest.mark.parametrize("law", list(JOINT_LAWS))
LINEAR_AT_FIRST = pytest.mark.parametrize("law", ["elastic", "coulomb", "softening"])


class Contact:
    """One contact led through jumps; it keeps its state and adds up what it dissipates."""

    def __init__(self, law="coulomb", initial=(0.0, 0.0, 0.0), normal=NORMAL, **changed):
        values = {"kn": KN, "ks": KS, **STRENGTH, **SAME, **OTHERS, **changed}
        self.number = JOINT_LAWS[law].number + 1
        self.property = np.zeros(N_JOINT_PROPERTIES)
        names = JOINT_LAWS[law].properties
        self.property[: len(names)] = [values[name] for name in names]
        self.initial, self.normal = np.asarray(initial, dtype=float), np.asarray(normal)
        self.state = np.zeros(N_JOINT_STATE)
        self.names = JOINT_LAWS[law].state
        self.jump, self.dissipated = np.zeros(3), 0.0
        self.traction, self.stored = self._law(self.jump)

    def _law(self, jump):
        return kernels._core.pyblast_joint_laws.joint_traction(
            self.number, self.property, DT, self.initial, self.normal, jump, jump - self.jump,
            self.state,
        )

    def move(self, *jump):
        jump = np.asarray(jump if len(jump) == 3 else jump[0], dtype=float)
        traction, stored = self._law(jump)
        work = 0.5 * (self.traction + traction) @ (jump - self.jump)
        self.dissipated += work - (stored - self.stored)
        self.jump, self.traction, self.stored = jump, traction, stored
        return traction

    def says(self, name):
        return self.state[self.names.index(name)]


def cycles(seed, n_steps=4000, size=6e-4):
    """Return a random closed path (n_steps, 3) of jumps that begins and ends at zero."""
    rng = np.random.default_rng(seed)
    phase = 2.0 * np.pi * np.linspace(0.0, 1.0, n_steps)
    waves = np.sin(np.outer(phase, np.arange(1, 6)))
    return size * waves @ rng.normal(size=(5, 3))


@LINEAR_AT_FIRST
def test_the_stiffness_is_the_one_given(law):
    traction = Contact(law).move(1e-5, -2e-5, -3e-5)

    assert traction == pytest.approx([KS * 1e-5, -KS * 2e-5, -KN * 3e-5], rel=1e-14)


@ALL_LAWS
def test_the_traction_at_zero_jump_is_the_initial_one(law):
    initial = [1e4, -2e4, -5e5]

    assert Contact(law, initial).traction == pytest.approx(initial, rel=1e-14)


@ALL_LAWS
@pytest.mark.parametrize("seed", range(4))
def test_a_law_does_not_depend_on_the_axes(law, seed):
    turn = Rotation.random(rng=np.random.default_rng(seed))
    initial = np.array([2e4, 1e4, -1e5])
    contact = Contact(law, initial, **WEAKER)
    turned = Contact(law, turn.apply(initial), normal=turn.apply(NORMAL), **WEAKER)

    for jump in cycles(seed, 300):
        traction = contact.move(jump)
        assert turned.move(turn.apply(jump)) == pytest.approx(turn.apply(traction), abs=1e-6)
    assert turned.dissipated == pytest.approx(contact.dissipated, rel=1e-9, abs=1e-9)


@ALL_LAWS
@pytest.mark.parametrize("seed", range(6))
def test_a_law_never_gives_energy_back_over_a_cycle(law, seed):
    contact = Contact(law, **WEAKER)
    for jump in cycles(seed):
        contact.move(jump)

    assert contact.dissipated >= -1e-9


@pytest.mark.parametrize("seed", range(6))
def test_every_step_of_slip_or_opening_dissipates(seed):
    contact = Contact(**WEAKER)
    for jump in cycles(seed):
        before, step = contact.dissipated, np.linalg.norm(jump - contact.jump)
        contact.move(jump)
        assert contact.dissipated >= before - KN * step**2  # the trapezoid across a corner
    assert contact.dissipated > 50.0


def test_the_elastic_law_dissipates_nothing():
    contact = Contact("elastic")
    for jump in cycles(0):
        contact.move(jump)

    assert contact.dissipated == pytest.approx(0.0, abs=1e-9)


@LINEAR_AT_FIRST
def test_stored_energy_is_that_of_the_two_springs(law):
    contact = Contact(law)
    contact.move(2e-5, 1e-5, -4e-5)

    wanted = 0.5 * KS * (2e-5**2 + 1e-5**2) + 0.5 * KN * 4e-5**2
    assert contact.stored == pytest.approx(wanted, rel=1e-12)


@pytest.mark.parametrize("law", [n for n, law in JOINT_LAWS.items() if "tension" in law.properties])
@pytest.mark.parametrize("seed", range(4))
def test_an_open_joint_carries_nothing(law, seed):
    contact = Contact(law)
    shear = np.random.default_rng(seed).normal(scale=1e-3, size=2)

    assert not contact.move(*shear, 1.01 * TENSION / KN).any()
    assert contact.stored == 0.0


def test_a_joint_holds_up_to_its_tension():
    contact = Contact()

    assert contact.move(0.0, 0.0, 0.99 * TENSION / KN)[2] == pytest.approx(0.99 * TENSION)
    assert contact.says("failed") == 0.0


def test_opening_at_the_tension_dissipates_the_energy_of_the_spring():
    contact = Contact(tension_residual=0.0)
    for opening in np.linspace(0.0, 1.2, 2401) * TENSION / KN:
        contact.move(0.0, 0.0, opening)

    assert contact.dissipated == pytest.approx(0.5 * TENSION**2 / KN, rel=2e-3)


def test_a_gap_must_close_before_pressure_returns():
    contact = Contact(tension_residual=0.0)
    contact.move(0.0, 0.0, 5e-4)

    assert not contact.move(0.0, 0.0, 1e-6).any()
    assert contact.move(0.0, 0.0, -1e-4) == pytest.approx([0.0, 0.0, -KN * 1e-4])


def test_an_initial_pressure_must_be_unloaded_before_a_joint_opens():
    contact = Contact(initial=[0.0, 0.0, -1e6], tension=0.0, tension_residual=0.0)

    assert contact.move(0.0, 0.0, 0.9e6 / KN)[2] == pytest.approx(-1e5)
    assert not contact.move(0.0, 0.0, 1.1e6 / KN).any()


def test_shear_while_open_leaves_no_shear_on_closing():
    contact = Contact(tension_residual=0.0)
    contact.move(0.0, 0.0, 5e-4)
    contact.move(2e-3, 0.0, 5e-4)

    traction = contact.move(2e-3, 0.0, -1e-4)

    assert traction == pytest.approx([0.0, 0.0, -KN * 1e-4], abs=1e-6)


def test_after_opening_the_residual_tension_counts():
    contact = Contact(tension_residual=0.5e5)
    contact.move(0.0, 0.0, 1.1 * TENSION / KN)

    assert contact.move(0.0, 0.0, 0.4e5 / KN)[2] == pytest.approx(0.4e5)
    assert not contact.move(0.0, 0.0, 0.6e5 / KN).any()


@pytest.mark.parametrize("pressure", [0.0, 2e5, 1e6])
def test_slip_begins_at_cohesion_plus_friction(pressure):
    strength, closure = COHESION + FRICTION * pressure, -pressure / KN
    contact = Contact()

    assert contact.move(0.999 * strength / KS, 0.0, closure)[0] == pytest.approx(0.999 * strength)
    assert contact.says("status") == 0.0
    assert contact.move(3.0 * strength / KS, 0.0, closure)[0] == pytest.approx(strength)
    assert contact.says("status") == 1.0


def test_slip_follows_the_direction_of_shear():
    contact = Contact()

    traction = contact.move(3e-3, 4e-3, -1e-4)

    strength = COHESION + FRICTION * KN * 1e-4
    assert traction[:2] == pytest.approx([0.6 * strength, 0.8 * strength])


def test_slip_stays_when_the_load_goes():
    contact = Contact()
    contact.move(5e-3, 0.0, -1e-4)

    traction = contact.move(5e-3 - 1e-4, 0.0, -1e-4)

    strength = COHESION + FRICTION * KN * 1e-4
    assert traction[0] == pytest.approx(strength - KS * 1e-4)
    assert contact.says("slip_x") == pytest.approx(5e-3 - strength / KS)


def test_a_full_turn_of_slip_dissipates_force_times_path():
    contact = Contact()
    strength, far = COHESION + FRICTION * KN * 1e-4, 5e-3
    contact.move(0.0, 0.0, -1e-4)
    corners = [0.0, far, -far, far]
    for start, end in pairwise(corners):
        before = contact.dissipated
        for place in np.linspace(start, end, 4001):
            contact.move(place, 0.0, -1e-4)
    turn = contact.dissipated - before

    assert turn == pytest.approx(strength * (2.0 * far - 2.0 * strength / KS), rel=1e-3)


def test_the_first_slip_brings_down_the_strength():
    contact = Contact(**WEAKER)
    contact.move(5e-3, 0.0, -1e-4)

    assert contact.traction[0] == pytest.approx(1.0e5 + 0.4 * KN * 1e-4)
    assert not contact.move(5e-3, 0.0, 1e-9).any()


def test_the_first_opening_brings_down_the_shear_strength():
    contact = Contact(**WEAKER)
    contact.move(0.0, 0.0, 1e-3)

    assert contact.move(5e-3, 0.0, -1e-4)[0] == pytest.approx(1.0e5 + 0.4 * KN * 1e-4)


def test_tension_does_not_add_to_the_shear_strength():
    contact = Contact()

    traction = contact.move(5e-3, 0.0, 0.5 * TENSION / KN)

    assert traction == pytest.approx([COHESION, 0.0, 0.5 * TENSION])


@ALL_LAWS
def test_the_same_path_gives_the_same_bits(law):
    one, two = Contact(law, **WEAKER), Contact(law, **WEAKER)

    for jump in cycles(3, 300):
        assert one.move(jump).tobytes() == two.move(jump).tobytes()
