"""Joints that slip and open with linear springs: Coulomb friction, dilation, slip weakening."""

from itertools import pairwise

import numpy as np
import pytest

from verification.contact import COHESION, FRICTION, KN, KS, TENSION, WEAKER, Contact, cycles


@pytest.mark.parametrize("seed", range(6))
def test_every_step_of_slip_or_opening_dissipates(seed):
    contact = Contact(**WEAKER)
    for jump in cycles(seed):
        before, step = contact.dissipated, np.linalg.norm(jump - contact.jump)
        contact.move(jump)
        assert contact.dissipated >= before - KN * step**2  # the trapezoid across a corner
    assert contact.dissipated > 50.0


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


DILATANT = {"dilation": 0.2, "dilation_slip": 2e-3}


def test_slip_under_pressure_opens_the_joint_and_so_raises_the_pressure():
    contact = Contact(**DILATANT)

    for place in np.linspace(0.0, 1.5e-3, 50):
        contact.move(place, 0.0, -1e-4)

    slid = contact.says("length")
    pressure = KN * (1e-4 + 0.2 * slid)
    assert 0.0 < slid < 2e-3
    assert contact.traction[2] == pytest.approx(-pressure)
    assert contact.traction[0] == pytest.approx(COHESION + FRICTION * pressure)


def test_dilation_ends_at_its_slip():
    contact = Contact(**DILATANT)

    traction = contact.move(9e-3, 0.0, -1e-4)

    assert contact.says("dilated") == pytest.approx(0.2 * 2e-3)
    assert traction[0] == pytest.approx(COHESION + FRICTION * KN * 5e-4)
    assert contact.says("length") == pytest.approx(9e-3 - traction[0] / KS)


def test_a_joint_without_pressure_does_not_dilate():
    contact = Contact(**DILATANT)
    contact.move(9e-3, 0.0, 1e-5)

    assert contact.says("length") > 0.0
    assert contact.says("dilated") == 0.0


@pytest.mark.parametrize("seed", range(4))
def test_a_dilatant_joint_gives_no_energy_back(seed):
    contact = Contact(**WEAKER, dilation=0.4, dilation_slip=1e-2)
    for jump in cycles(seed):
        before, step = contact.dissipated, np.linalg.norm(jump - contact.jump)
        contact.move(jump)
        assert contact.dissipated >= before - KN * step**2
    assert contact.says("dilated") > 0.0


WEAK = {"cohesion": 1e5, "friction": 0.6, "friction_dynamic": 0.2, "weakening_slip": 5e-4}
PRESSURE = KN * 1e-4


@pytest.mark.parametrize("share", [0.0, 0.3, 0.99, 1.0, 3.0])
def test_strength_falls_linearly_over_the_weakening_slip(share):
    contact = Contact("softening", **WEAK)
    start, end = 1e5 + 0.6 * PRESSURE, 0.2 * PRESSURE
    strength = start - (start - end) * min(share, 1.0)

    traction = contact.move(share * 5e-4 + strength / KS, 0.0, -1e-4)

    assert traction[0] == pytest.approx(strength, rel=1e-12)
    assert contact.says("length") == pytest.approx(share * 5e-4, abs=1e-18)


def test_many_small_steps_weaken_a_joint_as_much_as_a_large_one():
    few, many = Contact("softening", **WEAK), Contact("softening", **WEAK)
    few.move(6e-4, 0.0, -1e-4)
    for share in np.linspace(0.0, 1.0, 2000):
        many.move(6e-4 * share, 0.0, -1e-4)

    assert few.traction == pytest.approx(many.traction, rel=1e-9)


def test_weakening_takes_its_fracture_energy():
    contact = Contact("softening", **{**WEAK, "friction_dynamic": 0.0})
    contact.move(0.0, 0.0, -1e-4)
    for place in np.linspace(0.0, 2e-3, 20_000):
        contact.move(place, 0.0, -1e-4)

    wanted = 0.5 * (1e5 + 0.6 * PRESSURE) * 5e-4
    assert contact.dissipated == pytest.approx(wanted, rel=1e-4)


def test_slip_back_and_forth_adds_up():
    contact = Contact("softening", **WEAK)
    contact.move(8e-4, 0.0, -1e-4)
    contact.move(-8e-4, 0.0, -1e-4)

    assert contact.says("length") > 1e-3
    assert contact.traction[0] == pytest.approx(-0.2 * PRESSURE)


def test_a_spring_softer_than_the_weakening_falls_to_the_end_at_once():
    contact = Contact("softening", **{**WEAK, "weakening_slip": 1e-5})

    contact.move(1.001 * (1e5 + 0.6 * PRESSURE) / KS, 0.0, -1e-4)

    assert contact.traction[0] == pytest.approx(0.2 * PRESSURE)


def test_opening_takes_cohesion_and_tension_of_a_softening_joint():
    contact = Contact("softening", **WEAK)
    contact.move(0.0, 0.0, 1.1 * TENSION / KN)

    assert contact.move(5e-3, 0.0, -1e-4)[0] == pytest.approx(0.2 * PRESSURE)
    assert not contact.move(5e-3, 0.0, 1e-9).any()
