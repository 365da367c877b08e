"""Joints: properties in the order of the law, residual strengths, refusals."""

import itertools
import math

import pytest

from pyblast.core import JOINT_LAWS
from pyblast.errors import InputError
from pyblast.model.joint import INFILL, Joint, infill_stiffness, saturated
from verification.contact import properties

STRONG = {"kn": 1e9, "ks": 5e8, "cohesion": 1e5, "friction": 0.6, "tension": 2e4}


def test_properties_stand_in_the_order_of_the_law():
    joint = Joint("J", "coulomb", dict(reversed(STRONG.items())))

    assert list(joint.properties) == list(JOINT_LAWS["coulomb"].properties)


def test_residual_strength_equals_the_peak_but_a_broken_joint_carries_no_tension():
    joint = Joint("J", "coulomb", {**STRONG, "friction_residual": 0.4})

    assert joint.properties["friction_residual"] == 0.4
    assert joint.properties["cohesion_residual"] == 1e5
    assert joint.properties["tension_residual"] == 0.0


def test_an_elastic_joint_needs_two_stiffnesses_only():
    assert Joint("J", "elastic", {"kn": 1e9, "ks": 5e8}).properties == {"kn": 1e9, "ks": 5e8}


def test_an_unknown_law_is_refused_with_those_that_are_known():
    with pytest.raises(InputError, match=r"J\.law: must be one of elastic, coulomb, .*, got mohr"):
        Joint("J", "mohr", STRONG)


def test_an_unknown_property_is_refused():
    with pytest.raises(InputError, match=r"joints\.J\.jrc: unknown to 'coulomb'; it has kn"):
        Joint("J", "coulomb", {**STRONG, "jrc": 0.1})


@pytest.mark.parametrize("name", STRONG)
def test_a_missing_property_is_refused(name):
    given = {key: value for key, value in STRONG.items() if key != name}

    with pytest.raises(InputError, match=rf"joints\.J\.{name}: missing; the law 'coulomb'"):
        Joint("J", "coulomb", given)


@pytest.mark.parametrize(
    ("name", "value", "rule"),
    [
        ("kn", 0.0, "must be positive, got 0 Pa/m"),
        ("ks", -1.0, "must be positive, got -1 Pa/m"),
        ("kn", math.inf, "must be finite, got inf Pa/m"),
        ("friction", -0.1, "must not be negative, got -0.1"),
        ("tension", math.nan, "must not be negative, got nan Pa"),
        ("dilation_slip", -1.0, "must not be negative, got -1 m"),
    ],
)
def test_an_impossible_property_is_refused(name, value, rule):
    with pytest.raises(InputError, match=rf"joints\.J\.{name}: {rule}$"):
        Joint("J", "coulomb", {**STRONG, name: value})


@pytest.mark.parametrize("law", JOINT_LAWS)
def test_no_stiffness_of_any_law_may_be_zero_or_negative(law):
    given = properties(law)
    stiffnesses = [n for n, one in JOINT_LAWS[law].properties.items() if one.unit == "Pa/m"]

    for name, value in itertools.product(stiffnesses, (0.0, -1e9)):
        with pytest.raises(InputError, match=rf"J\.{name}: must .*, got {value:.0f} Pa/m$"):
            Joint("J", law, {**given, name: value})


def test_what_is_infinite_must_be_allowed_to_be():
    joint = Joint("J", "coulomb", {**STRONG, "dilation": 0.1, "dilation_slip": math.inf})

    assert joint.properties["dilation_slip"] == math.inf


@pytest.mark.parametrize("pressure", [-1.0, math.nan, math.inf])
def test_an_impossible_pressure_before_the_blast_is_refused(pressure):
    with pytest.raises(InputError, match=r"joints\.J\.insitu_pressure: must not be negative"):
        Joint("J", "coulomb", STRONG, insitu_pressure=pressure)


def test_dilation_needs_the_slip_at_which_it_ends():
    with pytest.raises(InputError, match=r"J\.dilation_slip: missing beside dilation"):
        Joint("J", "coulomb", {**STRONG, "dilation": 0.1})


def test_dilation_above_friction_would_create_energy_and_is_refused():
    with pytest.raises(InputError, match=r"J\.dilation: must not exceed friction_residual of 0.6"):
        Joint("J", "coulomb", {**STRONG, "dilation": 0.7, "dilation_slip": 1e-2})


def test_a_joint_cannot_weaken_to_more_than_it_had():
    weak = {"kn": 1e9, "ks": 1e9, "friction": 0.6, "weakening_slip": 1e-3, "friction_dynamic": 0.7}

    with pytest.raises(InputError, match=r"J\.friction_dynamic: must not exceed friction of 0.6"):
        Joint("J", "softening", weak)


def test_a_joint_that_yields_begins_with_the_friction_that_it_keeps_or_more():
    given = {"kn": 1e9, "ks": 1e9, "friction": 0.6, "roughness": 1e-3}

    assert Joint("J", "yielding", given).properties["friction_initial"] == 0.6
    with pytest.raises(InputError, match=r"J\.friction_initial: must not be below friction of 0.6"):
        Joint("J", "yielding", {**given, "friction_initial": 0.5})


def test_a_closing_joint_keeps_a_share_of_its_closure_at_most():
    given = {"kn": 1e9, "ks": 1e9, "closure": 1e-3}

    assert Joint("J", "closure", given).properties["kn_max"] == 100e9
    with pytest.raises(InputError, match=r"J\.irrecoverable: must not exceed 0.9, got 0.95"):
        Joint("J", "closure", {**given, "irrecoverable": 0.95})


def test_water_stiffens_a_joint_against_closing_only():
    joint = saturated(Joint("J", "coulomb", STRONG), 5e-4)

    assert joint.properties["kn"] == pytest.approx(1e9 + 2.2e9 / 5e-4)
    assert joint.properties["ks"] == STRONG["ks"]


def test_a_fluid_in_a_joint_that_stiffens_by_itself_is_refused():
    closing = Joint("J", "closure", {"kn": 1e9, "ks": 1e9, "closure": 1e-3})

    with pytest.raises(InputError, match=r"J\.law: 'closure' has no stiffness of its own"):
        saturated(closing, 5e-4)


def test_a_closing_joint_is_as_stiff_as_the_pressure_makes_it():
    joint = Joint("J", "closure", {"kn": 1e9, "ks": 5e8, "closure": 1e-3})

    assert joint.tangents(0.0) == (1e9, 5e8)
    assert joint.tangents(1e6) == pytest.approx((4e9, 5e8))
    assert joint.tangents(1e9) == pytest.approx((100e9, 5e8))


def test_a_joint_stiffens_with_a_power_of_the_pressure():
    properties = {"kn": 1e9, "ks": 5e8, "pressure": 1e5, "exponent": 0.5}
    joint = Joint("J", "stress_dependent", properties)

    assert joint.tangents(4e5) == pytest.approx((2e9, 1e9))
    assert joint.tangents(1e9) == pytest.approx((10e9, 5e9))
    assert joint.tangents(-1e5) == pytest.approx((1e7, 5e6))


def test_an_impossible_shear_before_the_blast_is_refused():
    with pytest.raises(InputError, match=r"joints\.J\.insitu_shear: must be three finite numbers"):
        Joint("J", "coulomb", STRONG, insitu_shear=(1.0, math.nan, 0.0))


@pytest.mark.parametrize(("thickness", "kn", "ks"), INFILL)
def test_infill_has_the_stiffness_of_its_row(thickness, kn, ks):
    assert infill_stiffness(*thickness) == (kn, ks)


def test_infill_between_rows_has_the_range_of_both_and_thicker_may_be_softer():
    assert infill_stiffness(0.03, 0.03) == ((0.1e9, 2.0e9), (0.01e9, 0.6e9))
    assert infill_stiffness(0.1, 0.5) == ((0.0, 0.5e9), (0.0, 0.1e9))
    assert infill_stiffness(0.0005, 0.015) == ((0.5e9, math.inf), (0.1e9, math.inf))


def test_infill_that_ends_before_it_begins_is_refused():
    with pytest.raises(InputError, match="0 <= thinnest <= thickest"):
        infill_stiffness(0.2, 0.1)
