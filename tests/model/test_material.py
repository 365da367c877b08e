"""Materials and damping: one material from any two moduli, and refusals."""

import math

import pytest

from pyblast.errors import InputError
from pyblast.model.material import Damping, Material


@pytest.mark.parametrize("poisson", [0.05, 0.25, 0.33, 0.45])
def test_young_and_poisson_come_back(poisson):
    material = Material.from_young_poisson(2660.0, 18.0e9, poisson)

    assert material.young == pytest.approx(18.0e9, rel=1e-12)
    assert material.poisson == pytest.approx(poisson, rel=1e-12)


def test_speeds_come_back():
    material = Material.from_speeds(2660.0, 3078.0, 1645.0)

    assert (material.cp, material.cs) == pytest.approx((3078.0, 1645.0), rel=1e-12)


def test_all_three_ways_give_the_same_material():
    one = Material(2500.0, 20e9, 12e9)
    two = Material.from_speeds(2500.0, one.cp, one.cs)
    three = Material.from_young_poisson(2500.0, one.young, one.poisson)

    for other in (two, three):
        assert (other.bulk, other.shear) == pytest.approx((20e9, 12e9), rel=1e-12)


def test_a_poisson_solid_has_equal_lame_moduli():
    material = Material.from_young_poisson(2500.0, 1e10, 0.25)

    assert material.first_lame == pytest.approx(material.shear, rel=1e-12)
    assert material.cp / material.cs == pytest.approx(math.sqrt(3.0), rel=1e-12)


@pytest.mark.parametrize("name", ["density", "bulk", "shear"])
@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
def test_a_modulus_that_is_not_positive_is_refused(name, value):
    values = {"density": 2500.0, "bulk": 2e10, "shear": 1e10, name: value}

    with pytest.raises(InputError, match=rf"material\.{name}: must be positive"):
        Material(**values)


@pytest.mark.parametrize("name", ["cohesion", "friction", "tension"])
@pytest.mark.parametrize("value", [-1.0, math.nan])
def test_a_negative_strength_is_refused(name, value):
    with pytest.raises(InputError, match=rf"material\.{name}: must not be negative"):
        Material(2500.0, 2e10, 1e10, **{name: value})


@pytest.mark.parametrize("poisson", [-1.0, 0.5, 0.7, math.nan])
def test_an_impossible_poisson_ratio_is_refused(poisson):
    with pytest.raises(InputError, match=r"material\.poisson: must lie between -1 and 0\.5"):
        Material.from_young_poisson(2500.0, 1e10, poisson)


@pytest.mark.parametrize(("cp", "cs"), [(1000.0, 900.0), (1000.0, 0.0), (math.nan, 500.0)])
def test_impossible_speeds_are_refused(cp, cs):
    with pytest.raises(InputError, match=r"material: cp must exceed 1\.155 cs"):
        Material.from_speeds(2500.0, cp, cs)


def test_damping_is_the_named_ratio_at_its_frequency_and_more_elsewhere():
    damping = Damping(0.0112, 4.0)

    assert damping.ratio_at(4.0) == pytest.approx(0.0112, rel=1e-12)
    assert damping.ratio_at(8.0) == pytest.approx(1.25 * 0.0112, rel=1e-12)
    assert damping.ratio_at(20.0) == pytest.approx(2.6 * 0.0112, rel=1e-12)


@pytest.mark.parametrize(("mass", "stiffness"), [(True, False), (False, True)])
def test_one_part_alone_gives_half_the_ratio_at_the_central_frequency(mass, stiffness):
    damping = Damping(0.02, 4.0, mass=mass, stiffness=stiffness)

    assert damping.ratio_at(4.0) == pytest.approx(0.01, rel=1e-12)
    assert damping.ratio_at(8.0) == pytest.approx(0.005 if mass else 0.02, rel=1e-12)


@pytest.mark.parametrize("ratio", [-0.01, 1.0, math.nan])
def test_an_impossible_damping_ratio_is_refused(ratio):
    with pytest.raises(InputError, match=r"damping\.ratio: must lie between 0 and 1"):
        Damping(ratio, 4.0)


@pytest.mark.parametrize("frequency", [0.0, -4.0, math.inf, math.nan])
def test_an_impossible_damping_frequency_is_refused(frequency):
    with pytest.raises(InputError, match=r"damping\.frequency: must be positive"):
        Damping(0.01, frequency)
