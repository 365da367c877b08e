"""Units: the suffix of a key says the unit, the value comes out in SI."""

import math
import re

import numpy as np
import pytest

from pyblast.errors import InputError
from pyblast.mesh.grid import JointSet
from pyblast.model.joint import Joint
from pyblast.model.material import Material, MohrCoulomb
from pyblast.model.model import Receiver
from pyblast.model.source import PlaneWave, TimeFunction
from pyblast.signals.seismogram import Seismogram
from pyblast.units import FACTORS, split_key, to_si

PULSE = TimeFunction(np.ones(3), 0.1)


@pytest.mark.parametrize(
    ("key", "value", "stem", "wanted"),
    [
        ("kn_gpa_per_m", 0.114, "kn", 0.114e9),
        ("ks_mpa_per_m", 25.0, "ks", 25e6),
        ("velocity_mm_per_s", 254.0, "velocity", 0.254),
        ("velocity_in_per_s", 2.0, "velocity", 0.0508),
        ("density_kg_per_m3", 2660.0, "density", 2660.0),
        ("cohesion_kpa", 376.0, "cohesion", 376e3),
        ("delay_ms", 40.0, "delay", 0.04),
        ("viscosity_mpa_s_per_m", 2.0, "viscosity", 2e6),
        ("depth_ft", 10.0, "depth", 3.048),
        ("charge_lb", 1.0, "charge", 0.45359237),
        ("damping_percent", 1.12, "damping", 0.0112),
        ("acceleration_g", 1.0, "acceleration", 9.80665),
        ("frequency_hz", 4.0, "frequency", 4.0),
        ("azimuth_deg", 90.0, "azimuth", math.pi / 2.0),
        ("friction_angle_deg", 45.0, "friction", 1.0),
    ],
)
def test_a_value_comes_out_in_si(key, value, stem, wanted):
    found = to_si(key, value)

    assert found[0] == stem
    assert found[1] == pytest.approx(wanted, rel=1e-12)


@pytest.mark.parametrize("suffix", FACTORS)
def test_every_suffix_is_found_whole(suffix):
    assert split_key(f"thing_{suffix}") == ("thing", suffix)


def test_a_key_without_unit_stays_as_it_is():
    assert to_si("ratio", 0.3) == ("ratio", 0.3)


def test_a_list_is_turned_item_by_item():
    assert to_si("delays_ms", [0, 40.0]) == ("delays", [0.0, 0.04])


@pytest.mark.parametrize("angle", [-1.0, 89.0, 90.0, math.nan])
def test_a_friction_angle_out_of_range_is_refused(angle):
    with pytest.raises(InputError, match="friction_angle_deg: must lie between 0 and 84 degrees"):
        to_si("friction_angle_deg", angle)


@pytest.mark.parametrize(
    ("make", "where", "unit"),
    [
        (lambda: Material(2.7, 3e10, 2e10), "material.density", "t/m3"),
        (lambda: Material(2700.0, 45.0, 2e10), "material.bulk", "GPa"),
        (lambda: Material(2700.0, 3e10, 20_000.0), "material.shear", "MPa"),
        (lambda: Material(2700.0, 3e10, 2e10, friction=35.0), "material.friction", "degrees"),
        (lambda: MohrCoulomb(friction_residual=30.0), "material.friction_residual", "degrees"),
        (lambda: Material.from_young_poisson(2700.0, 60.0, 0.25), "material.young", "GPa"),
        (lambda: Material.from_speeds(2700.0, 5.5, 3.2), "material.cs", "km/s"),
        (lambda: Joint("J", "elastic", {"kn": 1.3, "ks": 1e9}), "joints.J.kn", "GPa/m"),
        (lambda: Receiver("A", (0.0, 0.0, 0.0), 45.0), "receiver 'A'.azimuth", "degrees"),
        (lambda: PlaneWave("P", PULSE, 270.0), "plane_wave.azimuth", "degrees"),
        (lambda: JointSet("K", 0.5, 120.0, 3.0), "K.dip_direction", "degrees"),
        (lambda: Seismogram(np.zeros((2, 3)), 0.1).rotated(30.0), "azimuth", "degrees"),
    ],
)
def test_a_value_in_another_unit_is_refused_with_the_unit_that_it_looks_like(make, where, unit):
    with pytest.raises(InputError, match=re.escape(where)) as refusal:
        make()

    assert f"looks like {unit}" in str(refusal.value)
