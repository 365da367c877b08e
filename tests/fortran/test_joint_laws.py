"""Laws of nature that every joint law keeps: case L12 in the small."""

import copy

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pyblast.core import JOINT_LAWS
from verification.contact import KN, KS, NORMAL, TENSION, WEAKER, Contact, cycles

ALL_LAWS = pytest.mark.parametrize("law", list(JOINT_LAWS))
OPENING = [name for name, law in JOINT_LAWS.items() if "gap" in law.state]
LINEAR_AT_FIRST = pytest.mark.parametrize("law", ["elastic", "coulomb", "softening"])


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
    contact = Contact(law, (0.2 * pressure, 0.0, -pressure), **WEAKER)
    for jump in cycles(seed, 1500):
        contact.move(jump)

    assert contact.dissipated >= -1e-9


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
