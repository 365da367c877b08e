"""What each law of joints that is more than a spring does, against its own formula."""

import math

import numpy as np
import pytest

from verification.cases.rough_joints import led
from verification.contact import DT, FRICTION, KN, KS, Contact

PRESSED = [0.0, 0.0, -2e5]
VM = 1e-3


def closing(initial=(0.0, 0.0, 0.0), **changed):
    return Contact("closure", initial, **{"irrecoverable": 0.0, "cohesion": 1e9, **changed})


@pytest.mark.parametrize("share", [0.1, 0.5, 0.8])
def test_closure_follows_the_hyperbola(share):
    traction = closing().move(0.0, 0.0, -share * VM)

    assert traction[2] == pytest.approx(-KN * share * VM / (1.0 - share), rel=1e-12)


def test_the_tangent_at_an_insitu_pressure_is_that_of_bandis():
    pressure, small = 5e5, 1e-10

    change = closing([0.0, 0.0, -pressure]).move(0.0, 0.0, -small)[2] + pressure

    assert -change / small == pytest.approx(KN * (1.0 + pressure / (KN * VM)) ** 2, rel=1e-5)


def test_beyond_the_cap_closure_is_linear():
    contact = closing(kn_max=25.0 * KN)
    elbow = VM * (1.0 - 0.2)

    one, two = (contact.move(0.0, 0.0, -(elbow + more))[2] for more in (1e-5, 3e-5))

    assert (one - two) / 2e-5 == pytest.approx(25.0 * KN, rel=1e-9)


def test_a_closing_joint_opens_when_its_closure_is_used_up():
    contact = closing(PRESSED)
    rest = VM * 2e5 / (KN * VM + 2e5)

    assert contact.move(0.0, 0.0, 0.99 * rest)[2] < 0.0
    assert not contact.move(0.0, 0.0, 1.01 * rest).any()


def test_without_a_strength_the_shear_spring_outlives_a_gap():
    contact = closing(cohesion=math.inf)

    assert contact.move(1e-6, 0.0, 1e-3) == pytest.approx([KS * 1e-6, 0.0, 0.0])


@pytest.mark.parametrize("law", ["closure", "barton_bandis"])
def test_without_irrecoverable_closure_a_normal_cycle_loses_nothing(law):
    contact = Contact(law, PRESSED, irrecoverable=0.0)
    for place in 5e-4 * np.sin(np.linspace(0.0, 2.0 * np.pi, 20001)):
        contact.move(0.0, 0.0, place)

    assert contact.dissipated == pytest.approx(0.0, abs=1e-3)


def test_first_loading_leaves_closure_behind():
    contact = closing(irrecoverable=0.3)
    for place in np.linspace(0.0, -0.6e-3, 601):
        contact.move(0.0, 0.0, place)

    assert contact.move(0.0, 0.0, -0.3 * 0.6e-3 - 1e-9)[2] < 0.0
    assert not contact.move(0.0, 0.0, -0.3 * 0.6e-3 + 1e-9).any()
    assert contact.dissipated > 0.0


def test_unloading_begins_where_loading_ended():
    contact = closing(irrecoverable=0.3)
    loaded = contact.move(0.0, 0.0, -0.6e-3)[2]

    assert contact.move(0.0, 0.0, -0.6e-3 + 1e-12)[2] == pytest.approx(loaded, rel=1e-6)


@pytest.mark.parametrize("pressure", [1e5, 1e6, 1e7])
def test_rough_walls_have_bartons_strength(pressure):
    contact = Contact("barton_bandis", [0.0, 0.0, -pressure], jrc=10.0, jcs=5e7)

    traction = contact.move(5.0 * pressure / KS, 0.0, 0.0)

    pressed = -traction[2]  # dilation of the same step included
    angle = math.atan(FRICTION) + math.radians(max(0.0, 10.0 * math.log10(5e7 / pressed)))
    assert pressed > pressure
    assert traction[0] == pytest.approx(pressed * math.tan(min(angle, math.radians(70.0))))


def test_slip_wears_roughness_down():
    contact = Contact("barton_bandis", [0.0, 0.0, -1e6], kn_max=KN * 1.0001)
    strengths = [abs(contact.move(x, 0.0, 0.5 * x / 10)[0]) for x in np.linspace(0.0, 0.3, 3001)]

    assert strengths[-1] < 0.9 * max(strengths)


def test_a_slipping_rough_joint_dilates():
    contact = Contact("barton_bandis", [0.0, 0.0, -1e6])
    for x in np.linspace(0.0, 5e-3, 501):
        traction = contact.move(x, 0.0, 0.0)

    assert contact.says("dilated") > 0.0
    assert traction[2] < -1e6


@pytest.mark.parametrize("pressure", [0.1, 10.0, 1e3])
def test_walls_that_hardly_touch_dilate_no_more_than_at_their_steepest(pressure):
    contact = Contact("barton_bandis", [0.0, 0.0, -pressure], jrc=20.0, jcs=1.5e8)
    for x in np.linspace(0.0, 20.0 * pressure / KS, 2001):
        contact.move(x, 0.0, contact.says("dilated"))  # held at its pressure

    steepest = math.tan(0.5 * (math.radians(70.0) - math.atan(FRICTION)))
    assert contact.says("length") > 0.0
    assert contact.says("dilated") == pytest.approx(steepest * contact.says("length"), rel=1e-6)


@pytest.mark.parametrize("n_steps", [20, 200])
def test_walls_that_dilate_in_long_steps_give_no_energy_back(n_steps):
    contact = Contact("barton_bandis", [0.0, 0.0, -1e6], closure=5e-5, kn_max=100.0 * KN, jcs=1e8)
    stored = contact.stored
    for x in 2e-3 * np.sin(np.linspace(0.0, 2.0 * np.pi, n_steps + 1)):
        contact.move(x, 0.0, 0.0)
        friction = abs(contact.traction[0] / contact.traction[2])
        assert friction <= math.tan(math.atan(FRICTION) + math.radians(8.0 * 2.0))

    assert contact.dissipated > 0.1 * (contact.stored - stored) > 0.0


def test_a_gap_before_the_blast_lies_beyond_what_closure_left_behind():
    contact = Contact("closure", [0.0, 0.0, KN * 2e-5], irrecoverable=0.3, cohesion=1e9)
    contact.state[:] = 0.0
    contact.state[contact.names.index("peak")] = 4e-4  # of the static stage

    contact.move(0.0, 0.0, 0.0)

    assert contact.says("gap") == pytest.approx(2e-5, rel=1e-12)
    assert not contact.move(0.0, 0.0, -1.99e-5).any()
    assert contact.move(0.0, 0.0, -2.01e-5)[2] < 0.0


def test_dilation_raises_pressure_up_to_its_limit():
    contact = Contact(initial=PRESSED, dilation=0.1, dilation_slip=1e-3, cohesion=0.0,
                      cohesion_residual=0.0)  # fmt: skip
    for x in np.linspace(0.0, 2e-2, 4001):
        traction = contact.move(x, 0.0, 0.0)

    assert contact.says("dilated") == pytest.approx(0.1 * 1e-3, rel=1e-9)
    assert traction[2] == pytest.approx(-2e5 - KN * 1e-4, rel=1e-9)


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0, 3.0])
def test_strength_falls_in_proportion_to_slip(share):
    contact = Contact("softening", [0.0, 0.0, -1e6], cohesion=0.0, weakening_slip=1e-2)
    for x in np.linspace(0.0, 1e6 * FRICTION / KS + share * 1e-2, 20001):
        traction = contact.move(x, 0.0, 0.0)

    slip = contact.says("length")
    wanted = 1e6 * (FRICTION - (FRICTION - 0.4) * min(1.0, slip / 1e-2))
    assert traction[0] == pytest.approx(wanted, rel=2e-4)


@pytest.mark.parametrize("pressure", [1e4, 1e5, 4e5])
def test_stiffness_is_a_power_of_the_pressure_before(pressure):
    contact = Contact("stress_dependent", [0.0, 0.0, -pressure], cohesion=1e9)

    change = contact.move(1e-6, 0.0, -1e-6) - contact.initial

    stiffer = (pressure / 1e5) ** 0.5
    assert change == pytest.approx([stiffer * KS * 1e-6, 0.0, -stiffer * KN * 1e-6], rel=1e-9)


def test_a_kelvin_fill_at_a_steady_rate_adds_what_its_dashpots_take():
    contact = Contact("kelvin")
    contact.move(1e-6, 0.0, -2e-6)

    traction = contact.move(2e-6, 0.0, -4e-6)

    wanted = [KS * 2e-6 + 2e5 * 1e-6 / 1e-4, 0.0, -KN * 4e-6 - 4e5 * 2e-6 / 1e-4]
    assert traction == pytest.approx(wanted, rel=1e-12)


def test_a_kelvin_fill_feels_the_rate_of_the_moment_not_of_half_a_step_ago():
    contact, omega = Contact("kelvin"), 300.0
    times = 1e-4 * np.arange(400)
    place = 1e-5 * np.sin(omega * times)

    found = np.array([contact.move(0.0, 0.0, x)[2] for x in place])

    wanted = KN * place + 4e5 * 1e-5 * omega * np.cos(omega * times)
    assert np.abs(found - wanted)[2:].max() < 1e-3 * np.abs(wanted).max()


@pytest.mark.parametrize(("share", "stable"), [(0.97, True), (1.03, False)])
def test_a_kelvin_fill_is_stable_up_to_its_bound(share, stable):
    contact, viscosity = Contact("kelvin"), 2.0 * 4e5  # twice its own, as the bound has it
    mass = (KN * DT**2 + 2.0 * viscosity * DT) / 4.0 / share
    place, velocity = 0.0, 1e-9
    for _ in range(2000):
        place += DT * velocity
        velocity -= DT / mass * contact.move(0.0, 0.0, place)[2]

    assert (abs(velocity) < 1e-8) == stable


def test_a_maxwell_fill_relaxes_at_its_own_rate():
    contact = Contact("maxwell")
    contact.move(0.0, 0.0, -1e-6)
    for _ in range(10):
        traction = contact.move(0.0, 0.0, -1e-6)

    x = 0.5e-4 * KN / 4e5
    wanted = KN * 1e-6 / (1.0 + x) * ((1.0 - x) / (1.0 + x)) ** 10
    assert -traction[2] == pytest.approx(wanted, rel=1e-9)
    assert wanted == pytest.approx(KN * 1e-6 / (1.0 + x) * math.exp(-20.0 * x), rel=0.15)


def test_a_yielding_joint_approaches_a_strength_that_wears_to_its_friction():
    contact = Contact("yielding", [0.0, 0.0, -1e6])
    for x in np.linspace(0.0, 5e-2, 20001):
        traction = contact.move(x, 0.0, 0.0)

    assert traction[0] == pytest.approx(FRICTION * 1e6, rel=0.01)
    assert max(0.0, contact.says("worn")) == pytest.approx(
        math.atan(0.9) - math.atan(FRICTION), rel=0.05
    )


@pytest.mark.parametrize("turns", [(1e-3, -1e-3, 2e-3, -2e-3), (2e-3, 1.95e-3, 4e-3, 3.9e-3, 5e-3)])
def test_a_yielding_joint_follows_its_equations_from_turn_to_turn(turns):
    _, wanted, found = led(400, turns)

    assert found == pytest.approx(wanted, abs=1e-3 * wanted.max())


def test_a_yielding_joint_is_stiff_again_right_after_a_reversal():
    contact = Contact("yielding", [0.0, 0.0, -1e6])
    for x in np.linspace(0.0, 2e-3, 2001):
        traction = contact.move(x, 0.0, 0.0)

    back = contact.move(2e-3 - 1e-7, 0.0, 0.0)

    assert traction[0] - back[0] == pytest.approx(KS * 1e-7, rel=1e-3)
