"""Joints of a project file: keys with units become a law and its properties in SI."""

import pytest
from pydantic import ValidationError

from pyblast.config.ground import JointConfig
from pyblast.errors import InputError
from pyblast.ground.tables import make_joint

SPRINGS = {"kn_gpa_per_m": 1.0, "ks_gpa_per_m": 0.5}


def joint(law, **keys):
    return make_joint("joints.J", "J", JointConfig(law=law, **SPRINGS, **keys))


def test_a_closing_joint_is_read_with_its_largest_closure_and_cap():
    found = joint("closure", closure_mm=0.5, kn_max_gpa_per_m=40.0, irrecoverable=0.2)

    assert found.properties["closure"] == pytest.approx(5e-4)
    assert found.properties["kn_max"] == pytest.approx(4e10)
    assert found.properties["irrecoverable"] == 0.2


def test_a_softening_joint_is_read_with_its_weakening():
    found = joint("softening", friction_angle_deg=30.0, friction_dynamic_angle_deg=20.0,
                  weakening_slip_mm=2.0)  # fmt: skip

    assert found.properties["weakening_slip"] == pytest.approx(2e-3)
    assert found.properties["friction_dynamic"] == pytest.approx(0.36397, rel=1e-4)


def test_a_fill_is_read_with_its_viscosity_and_its_mass():
    found = joint("kelvin", eta_n_mpa_s_per_m=2.0, eta_s_mpa_s_per_m=1.0,
                  fill_density_kg_per_m3=1900.0, fill_thickness_mm=300.0)  # fmt: skip

    assert found.properties["eta_n"] == pytest.approx(2e6)
    assert found.fill_mass == pytest.approx(570.0)


def test_water_in_a_joint_adds_to_its_normal_stiffness():
    assert joint("elastic", water_aperture_mm=1.0).properties["kn"] == pytest.approx(1e9 + 2.2e12)


def test_half_a_heavy_fill_is_refused():
    with pytest.raises(ValidationError, match="fill_thickness_mm go together"):
        joint("elastic", fill_density_kg_per_m3=1900.0)


def test_a_length_in_the_unit_of_a_pressure_is_refused_with_the_right_key():
    with pytest.raises(InputError, match=r"closure_kpa: unknown key; did you mean 'closure_mm'"):
        joint("closure", closure_kpa=0.5)
