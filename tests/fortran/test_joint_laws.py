"""Laws of nature that every joint law keeps: case L12 in the small."""

import copy

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pyblast.core import JOINT_LAWS
from pyblast.model.joint import Joint
from verification.contact import (
    KN,
    KS,
    NORMAL,
    TENSION,
    WEAKER,
    Contact,
    cycles,
    given_back,
    properties,
)

ALL_LAWS = pytest.mark.parametrize("law", list(JOINT_LAWS))
OPENING = [name for name, law in JOINT_LAWS.items() if law.opens]
LINEAR_AT_FIRST = pytest.mark.parametrize(
    "law", [name for name, law in JOINT_LAWS.items() if law.elastic or law.sticks]
)
PRESSURES = (3e4, 1e6, 5e6)  # below and above the typical one of `properties`


@ALL_LAWS
def test_a_row_has_its_case(law):
    """A row without its case would run as a law that is not its own, were it not for the NaN."""
    traction = Contact(law).move(1e-6, 0.0, -1e-6)

    assert np.isfinite(traction).all(), f"give {law!r} its case in joint_traction of joint_laws.f90"


@ALL_LAWS
def test_a_row_says_whether_its_law_is_linear(law):
    initial = np.array([2e4, 1e4, -1e5])
    one, two, both = (Contact(law, initial) for _ in range(3))
    size = worst = 0.0
    for first, second in zip(cycles(0, 300), cycles(1, 300), strict=True):
        parts = one.move(first) - initial, two.move(second) - initial
        together = both.move(first + second) - initial
        worst = max(worst, np.abs(sum(parts) - together).max())
        size = max(size, np.abs(together).max())

    assert (worst < 1e-10 * size) == JOINT_LAWS[law].linear, "its KIND: linear, or not?"


@ALL_LAWS
def test_a_row_says_whether_the_stiffness_follows_the_pressure(law):
    joint = Joint("J", law, properties(law))
    under = {joint.tangents(pressure) for pressure in PRESSURES}

    assert (len(under) > 1) == JOINT_LAWS[law].stiffens, "its KIND, or its case in joint_tangents?"


@ALL_LAWS
@pytest.mark.parametrize("pressure", PRESSURES)
def test_tangents_are_those_of_the_law_as_it_closes_and_shears(law, pressure):
    joint, small = Joint("J", law, properties(law)), 1e-9
    if JOINT_LAWS[law].flows or joint.bound()[1] > 0.0:
        return  # its traction follows the rate, too
    rest = (0.0, 0.0, -pressure)
    closing = Contact(law, rest).move(0.0, 0.0, -small)[2] + pressure
    shearing = Contact(law, rest).move(small, 0.0, 0.0)[0]

    found = -closing / small, shearing / small
    told = "give the law its case in joint_tangents of joint_laws.f90"
    assert found == pytest.approx(joint.tangents(pressure), rel=1e-3), told


@ALL_LAWS
def test_no_law_is_stiffer_than_the_bound_that_sets_the_time_step(law):
    (stiffest, viscosity), small = Joint("J", law, properties(law)).bound(), 1e-9
    if viscosity > 0.0:
        return  # its traction follows the rate, too
    for pressure in np.geomspace(1e2, 1e10, 33):
        contact = Contact(law, (0.0, 0.0, -pressure))
        change = np.abs(contact.move(0.0, 0.0, -small)[2] + pressure)

        told = "give the law its case in joint_bound of joint_laws.f90"
        assert change <= stiffest * small + 1e-14 * pressure, told


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
@pytest.mark.parametrize("pressure", [0.0, 1e5, 3e6])
@pytest.mark.parametrize("seed", range(6))
def test_a_law_never_gives_energy_back_over_a_cycle(law, pressure, seed):
    initial = (0.2 * pressure, 0.0, -pressure)

    assert given_back(law, initial, cycles(seed, 1500), **WEAKER) < 1e-12


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


@pytest.mark.parametrize("law", OPENING)
@pytest.mark.parametrize("seed", range(4))
def test_an_open_joint_carries_nothing(law, seed):
    contact = Contact(law)
    shear = np.random.default_rng(seed).normal(scale=1e-3, size=2)

    assert not contact.move(*shear, 1.01 * TENSION / KN).any()
    assert contact.stored == 0.0
    assert contact.says("gap") == pytest.approx(1.01 * TENSION / KN)


@ALL_LAWS
def test_a_contact_goes_on_from_what_it_keeps_with_the_same_bits(law):
    one, path = Contact(law, **WEAKER), cycles(3, 300)
    for jump in path[:150]:
        one.move(jump)
    two = copy.deepcopy(one)

    for jump in path[150:]:
        assert one.move(jump).tobytes() == two.move(jump).tobytes()
