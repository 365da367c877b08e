"""A building, a lining and crushed rock: limits in closed form."""

import numpy as np
import pytest
from small_project import INSIDE

from examples.structures import (
    borehole_pressure,
    crushed_radius,
    main,
    shear_building,
    tunnel_strain,
)
from pyblast.blasts.published_laws import EXPLOSIVES
from pyblast.errors import InputError
from pyblast.signals.response_spectra import oscillator
from pyblast.signals.seismogram import Seismogram

DT = 1e-3
TIMES = DT * np.arange(4000)


def wave(frequency):
    motion = np.exp(-(((TIMES - 2.0) / 0.5) ** 2)) * np.sin(2.0 * np.pi * frequency * (TIMES - 2.0))
    return Seismogram(np.stack([motion, 0.5 * motion, -motion], axis=1), DT)


def test_a_building_of_one_storey_is_an_oscillator():
    motion, hz = wave(10.0), 6.0
    stiffness = 5e3 * (2.0 * np.pi * hz) ** 2

    moved = shear_building(motion, [5e3], [stiffness], 0.05)

    slope = np.diff(motion.velocity[:, 0]) / DT
    np.testing.assert_allclose(moved[:, 0, 0], oscillator(slope, DT, hz, 0.05)[0], atol=1e-15)


def test_a_building_under_steady_acceleration_leans_as_its_weight_says():
    ramp = Seismogram(np.stack([TIMES] * 3, axis=1), DT)  # 1 m/s2
    mass, stiffness = np.array([4e4, 3e4, 2e4]), np.array([9e7, 7e7, 5e7])

    moved = shear_building(ramp, mass, stiffness, 0.9)

    shear = np.cumsum(mass[::-1])[::-1]  # carried by each storey
    np.testing.assert_allclose(moved[-1, :, 0], -np.cumsum(shear / stiffness), rtol=1e-6)


def test_masses_and_stiffnesses_go_in_pairs():
    with pytest.raises(InputError, match="a positive mass and stiffness for each floor"):
        shear_building(wave(10.0), [1e3, 1e3], [1e6])


GROUND = {"cp": 3000.0, "cs": 1500.0, "density": 2400.0, "radius": 3.0}


def test_a_lining_without_stiffness_ovals_as_an_open_circle_after_kirsch():
    poisson = 1.0 / 3.0

    soft = tunnel_strain(0.05, 5.0, **GROUND, thickness=1e-3, lining_young=1e6)

    assert soft.ovaling == pytest.approx(2.0 * (1.0 - poisson) * 0.05 / 1500.0, rel=1e-6)
    assert soft.shear == pytest.approx(0.05 / 1500.0)
    assert soft.bending == pytest.approx(3.0 * 5.0 / 1500.0**2)


def test_the_lining_bends_as_its_ovaling_says():
    strain = tunnel_strain(
        0.05, 5.0, **GROUND, thickness=0.02, lining_young=30e9, lining_poisson=0.0
    )

    # u = r dD/D cos 2a bends the ring by 3 u / r^2.
    bent = 3.0 * strain.ovaling / 3.0 * 0.01
    assert strain.hoop == pytest.approx(bent, rel=0.03)
    with pytest.raises(InputError, match=r"tunnel_strain.thickness: must be positive, got 0"):
        tunnel_strain(0.05, 5.0, **GROUND, thickness=0.0, lining_young=30e9)


def test_a_charge_half_as_thick_as_its_hole_presses_a_fifth():
    full = borehole_pressure(1000.0, 4000.0, 0.1, 0.1)

    assert full == pytest.approx(2e9)
    assert borehole_pressure(1000.0, 4000.0, 0.05, 0.1) / full == pytest.approx(0.5**2.4)


def test_ideal_detonations_of_the_table_press_half_of_their_chapman_jouguet_pressure():
    given = {"ANFO": 5.15e9, "TNT": 21.0e9, "PETN": 33.5e9}  # of the same JWL fits

    for name, pressure in given.items():
        explosive = EXPLOSIVES[name]
        assert 2.0 * borehole_pressure(
            explosive.density, explosive.velocity, 0.1, 0.1
        ) == pytest.approx(pressure, rel=0.25)


def test_the_crushed_zone_is_never_thinner_than_the_hole_and_grows_with_pressure():
    rock = {"strength": 100e6, "young": 60e9, "poisson": 0.25}

    assert crushed_radius(0.05, 1e6, **rock) == 0.05
    single, double = (crushed_radius(0.05, pressure, **rock) for pressure in (2e9, 4e9))
    assert double / single == pytest.approx(2.0 ** (3.0 * 0.219))


@pytest.mark.parametrize(
    ("call", "told"),
    [(lambda: borehole_pressure(1000.0, 4000.0, 0.2, 0.1), "thicker than its hole"),
     (lambda: borehole_pressure(0.0, 4000.0, 0.1, 0.1), "must be positive, got 0"),
     (lambda: crushed_radius(0.05, 1e9, 0.0, 60e9, 0.25), "must be positive, got 0"),
     (lambda: crushed_radius(0.05, 1e9, 1e8, 60e9, 0.5), "below 0.5, got 0.5")],
    ids=["thick", "density", "strength", "poisson"],
)  # fmt: skip
def test_what_no_hole_has_is_refused(call, told):
    with pytest.raises(InputError, match=told):
        call()


def test_the_script_prints_what_a_project_does_to_them(tmp_path, capsys):
    path = tmp_path / "project.toml"
    path.write_text(INSIDE)

    main(path, "house")

    assert "Drift of the lower storey" in capsys.readouterr().out
