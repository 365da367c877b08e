"""The law of Hoek and Brown: its surface, its equivalent at low stress, its margin of yielding."""

from dataclasses import replace

import numpy as np
import pytest

from pyblast import core
from pyblast.errors import InputError
from pyblast.model.anisotropy import HoekBrown
from pyblast.model.material import Material, MohrCoulomb
from verification.cases.plasticity import sampled
from verification.solutions.plasticity import triaxial_strength
from verification.zone import Zone

ROCK = Material.from_speeds(2600.0, 4000.0, 2300.0)
LAW = HoekBrown.of_rock_mass(30e6, 12.0, 55.0, 0.3)


def principal(stress):
    """Return principal stresses, compression positive, ascending."""
    return np.linalg.eigvalsh(-stress[[[0, 5, 4], [5, 1, 3], [4, 3, 2]]])


@pytest.mark.parametrize("law", [LAW, HoekBrown(5e7, 10.0, 1.0), HoekBrown(2e7, 1.0, 0.0, 0.6)])
def test_no_stress_leaves_the_curved_surface_or_the_tension(law):
    rng, yielded = np.random.default_rng(5), 0
    for _ in range(300):
        strain = rng.normal(size=6) * 10 ** rng.uniform(-4.5, -2.0)
        strain[:3] += rng.normal() * 1e-3
        zone = Zone("hoek-brown", np.zeros(6), replace(ROCK, law=law))
        small, _, large = principal(zone.strain(strain))

        near = 1e-8 * 1e10 * np.abs(strain).max()  # the surface is upright at its apex
        tension = law.properties(ROCK)["tension"]
        assert -small <= tension + near
        assert large <= law.strength(max(small, -tension) + near) + near
        yielded += zone.lost[0] > 0.0
    assert yielded > 50


@pytest.mark.parametrize("confining", [0.0, 1e5, 2e6, 2e7])
def test_triaxial_strength_is_that_of_the_formula(confining):
    axial, _ = sampled(replace(ROCK, law=LAW), np.linspace(0.0, -0.03, 61), confining)

    assert -axial[-1] == pytest.approx(LAW.strength(confining), rel=1e-9)


def test_a_falling_surface_ends_at_the_residual_one():
    law = replace(LAW, m_residual=0.5, s_residual=0.0, shear_strain=2e-3)
    axial, _ = sampled(replace(ROCK, law=law), np.linspace(0.0, -0.03, 301), 1e6)

    assert -axial.min() < LAW.strength(1e6)
    assert -axial[-1] == pytest.approx(HoekBrown(30e6, 0.5, 0.0, LAW.a).strength(1e6), rel=1e-9)


def test_the_sides_dilate_by_the_flow_rule():
    law = replace(LAW, dilation=np.tan(0.2))
    strains = np.linspace(0.0, -0.02, 201)
    _, side = sampled(replace(ROCK, law=law), strains, 1e6)

    slope = (1.0 + np.sin(0.2)) / (1.0 - np.sin(0.2))
    assert np.diff(side)[-50:].mean() / np.diff(strains)[0] == pytest.approx(-0.5 * slope, rel=1e-6)


def test_the_equivalent_line_meets_the_surface_at_low_stress_as_mohr_coulomb_ground_does():
    largest = 2e6
    cohesion, friction = LAW.equivalent(largest)
    line = replace(ROCK, cohesion=cohesion, friction=friction, law=MohrCoulomb(0.0))
    pressures, strains = np.linspace(0.0, largest, 9), np.linspace(0.0, -0.03, 31)
    curved = np.array([-sampled(replace(ROCK, law=LAW), strains, p)[0][-1] for p in pressures])
    straight = np.array([-sampled(line, strains, p)[0][-1] for p in pressures])

    assert straight == pytest.approx(
        [triaxial_strength(p, cohesion, friction) for p in pressures], rel=1e-9
    )
    # The areas under both up to the largest pressure are equal: how the line was fitted.
    fine = np.linspace(0.0, largest, 2001)
    root = np.sqrt(1.0 + friction**2) + friction
    area = np.trapezoid(2.0 * cohesion * root + root**2 * fine, fine)
    assert area == pytest.approx(np.trapezoid(LAW.strength(fine), fine), rel=0.03)
    assert np.abs(straight / curved - 1.0)[1:].max() < 0.12


def test_constants_of_a_rock_mass_are_those_of_hoek():
    intact = HoekBrown.of_rock_mass(1e8, 10.0, 100.0)

    assert (intact.m, intact.s, intact.a) == pytest.approx((10.0, 1.0, 0.5), abs=1e-3)
    poor = HoekBrown.of_rock_mass(1e8, 10.0, 30.0, 1.0)
    assert poor.m == pytest.approx(10.0 * np.exp(-5.0))
    assert poor.s == pytest.approx(np.exp(-70.0 / 6.0))
    assert poor.a == pytest.approx(0.5 + (np.exp(-2.0) - np.exp(-20.0 / 3.0)) / 6.0)


def test_within_the_margin_nothing_yields():
    rng = np.random.default_rng(8)
    material = replace(ROCK, law=LAW)
    law = core.ZONE_LAWS["hoek-brown"]
    row = core.property_row(law, LAW.properties(material), core.N_ZONE_PROPERTIES)
    initial = -rng.uniform(0.1e6, 4e6, size=(200, 1)) * [1.0, 1.0, 1.0, 0.0, 0.0, 0.0]
    strain = rng.normal(size=(200, 6)) * 3e-5
    moduli = [np.full(200, value) for value in material.law.moduli(material)]
    margin = core._core.pyblast_zone_laws.zone_yield_margins(
        law.number + 1, row, *moduli, initial, strain
    )
    safe = 0
    for begin, at, reach in zip(initial, strain, margin, strict=True):
        if reach <= 0.0:
            continue
        safe += 1
        for _ in range(20):
            step = rng.normal(size=(3, 3))
            step = 0.5 * (step + step.T)
            step *= reach / np.linalg.norm(step)
            zone = Zone("hoek-brown", begin, material)
            zone.strain(at + step[[0, 1, 2, 1, 2, 0], [0, 1, 2, 2, 0, 1]] * [1, 1, 1, 2, 2, 2])
            assert zone.lost[0] == 0.0
    assert safe > 50


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"sigci": 0.0}, "sigci: must be positive"),
        ({"m": np.inf}, "m: must be finite"),
        ({"s": -1.0}, "s: must not be negative"),
        ({"a": 0.4}, "a: must not be below 0.5"),
        ({"dilation": 3.0}, "dilation: must not exceed the friction"),
        ({"m_residual": 0.0}, "m_residual: must be positive"),
    ],
)
def test_values_out_of_range_are_refused(keys, message):
    with pytest.raises(InputError, match=message):
        HoekBrown(**{"sigci": 1e7, "m": 2.0, "s": 0.01} | keys)


def test_a_rock_mass_beyond_its_indices_is_refused():
    with pytest.raises(InputError, match="gsi from 0 to 100"):
        HoekBrown.of_rock_mass(1e7, 10.0, 120.0)
