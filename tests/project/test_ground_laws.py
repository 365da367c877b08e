"""Laws of zones in a project file: ground that yields, layered and jointed ground, its stress."""

import numpy as np
import pytest
from pydantic import ValidationError

from pyblast.config.ground import BoundariesConfig, InSituConfig, MaterialConfig, MeshConfig
from pyblast.ground.tables import jointed_media, make_boundaries, make_insitu, make_material
from pyblast.model.anisotropy import HoekBrown, jointed, transverse
from pyblast.model.joint import Joint
from pyblast.model.material import Material

ROCK = {"density_kg_per_m3": 2700.0, "cp_m_per_s": 4000.0, "cs_m_per_s": 2300.0}
STRONG = {"cohesion_kpa": 500.0, "friction_angle_deg": 30.0, "tension_kpa": 100.0}
PLANES = {"dip_deg": 30.0, "dip_direction_deg": 90.0}
UPRIGHT = {"dip_deg": 90.0, "dip_direction_deg": 0.0}
SETS = {**PLANES, "spacing_m": 4.0, "kn_gpa_per_m": 2.0, "ks_gpa_per_m": 1.0}
SCHIST = {
    **PLANES, "young_mpa": 60e3, "young_normal_mpa": 30e3, "poisson": 0.2, "poisson_normal": 0.15,
    "shear_normal_mpa": 12e3,
}  # fmt: skip
NORMAL = (0.5, 0.0, np.sqrt(0.75))


def material(**keys):
    return make_material(MaterialConfig(**ROCK, **keys))


def test_an_empty_table_lets_ground_yield_at_its_strength():
    found = material(**STRONG, yielding={})

    row = found.law.properties(found)
    assert found.law.name == "mohr-coulomb"
    assert row["cohesion"] == row["cohesion_residual"] == pytest.approx(5e5)
    assert row["friction"] == pytest.approx(np.tan(np.radians(30.0)))
    assert row["dilation"] == 0.0


def test_residuals_and_strains_are_turned_into_si():
    soft = {
        "dilation_angle_deg": 10.0, "cohesion_residual_kpa": 50.0, "tension_residual_kpa": 0.0,
        "friction_residual_angle_deg": 25.0, "dilation_residual_angle_deg": 0.0,
        "shear_strain_percent": 2.0, "tensile_strain_percent": 0.1,
    }  # fmt: skip
    found = material(**STRONG, yielding=soft)

    row = found.law.properties(found)
    assert row["dilation"] == pytest.approx(np.tan(np.radians(10.0)))
    assert row["friction_residual"] == pytest.approx(np.tan(np.radians(25.0)))
    wanted = pytest.approx([5e4, 0.0, 0.02, 0.001])
    names = ("cohesion_residual", "tension_residual", "shear_strain", "tensile_strain")
    assert [row[name] for name in names] == wanted


def test_joints_make_the_rock_a_softer_medium():
    found = material(joints=[SETS])

    wanted = jointed(Material.from_speeds(2700.0, 4000.0, 2300.0), NORMAL, 4.0, 2e9, 1e9)
    assert found.law.stiffness == pytest.approx(wanted.law.stiffness, rel=1e-9, abs=1.0)


MASS = {"sigci_mpa": 30.0, "mi": 12.0, "gsi": 55.0, "disturbance": 0.3}


def test_a_rock_mass_is_read_with_its_indices():
    found = material(hoek_brown={**MASS, "dilation_angle_deg": 10.0, "tension_kpa": 20.0}).law

    wanted = HoekBrown.of_rock_mass(
        30e6, 12.0, 55.0, 0.3, dilation=np.tan(np.radians(10.0)), tension=2e4
    )
    assert found.name == "hoek-brown"
    for name in ("sigci", "m", "s", "a", "dilation", "tension"):
        assert getattr(found, name) == pytest.approx(getattr(wanted, name))


def test_transverse_ground_needs_no_other_constants():
    found = make_material(MaterialConfig(density_kg_per_m3=2700.0, transverse=SCHIST, **STRONG))

    wanted = transverse(
        2700.0, NORMAL, young=60e9, young_normal=30e9, poisson=0.2, poisson_normal=0.15,
        shear_normal=12e9,
    )  # fmt: skip
    assert found.law.stiffness == pytest.approx(wanted.law.stiffness, rel=1e-9, abs=1.0)
    assert found.cohesion == pytest.approx(5e5)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({**STRONG, "yielding": {}, "joints": [SETS]}, "exclude one another"),
        ({"yielding": {}}, "cohesion_kpa is missing beside yielding"),
        ({"hoek_brown": MASS, "yielding": {}}, "exclude one another"),
        ({"transverse": SCHIST}, "give one of"),
    ],
)
def test_laws_that_do_not_go_together_are_refused(keys, message):
    with pytest.raises(ValidationError, match=message):
        material(**keys)


def test_joint_sets_make_a_medium_of_the_layers_that_they_cut():
    mesh = MeshConfig(
        size_m=[100.0, 100.0, 50.0], edge_m=10.0,
        layers=[{"material": "soil", "thickness_m": 10.0}, {"material": "rock"}],
        joint_sets=[
            {"name": "J1", **PLANES, "spacing_m": 4.0, "regions": ["rock"]},
            {"name": "J2", **UPRIGHT, "spacing_m": 8.0, "persistence": 0.5, "regions": ["rock"]},
        ],
    )  # fmt: skip
    joints = [Joint(name, "elastic", {"kn": 2e9, "ks": 1e9}) for name in ("J1", "J2")]
    rock = Material.from_speeds(2700.0, 4000.0, 2300.0)

    pressures = {"J1": 0.0, "J2": 0.0}
    media = jointed_media(mesh, {"soil": rock, "rock": rock}, joints, pressures)

    wanted = jointed(jointed(rock, NORMAL, 4.0, 2e9, 1e9), (0.0, 1.0, 0.0), 8.0, 4e9, 2e9)
    assert list(media) == ["rock"]
    found = media["rock"].law.stiffness
    assert found == pytest.approx(wanted.law.stiffness, rel=1e-9, abs=1.0)


def test_joints_that_close_make_a_medium_as_stiff_as_their_pressure_has_made_them():
    mesh = MeshConfig(size_m=[100.0, 100.0, 50.0], edge_m=10.0, layers=[{"material": "rock"}],
                      joint_sets=[{"name": "J1", **PLANES, "spacing_m": 4.0}])  # fmt: skip
    closing = Joint("J1", "closure", {"kn": 1e9, "ks": 1e9, "closure": 1e-3})
    rock = Material.from_speeds(2700.0, 4000.0, 2300.0)

    media = jointed_media(mesh, {"rock": rock}, [closing], {"J1": 2e6})

    wanted = jointed(rock, NORMAL, 4.0, 9e9, 1e9)  # (1 + p/(kn Vm))^2 = 9
    found = media["rock"].law.stiffness
    assert found == pytest.approx(wanted.law.stiffness, rel=1e-9, abs=1.0)


@pytest.mark.parametrize("jointed_faces", [False, True])
def test_faces_know_of_joints_where_that_is_asked_for(jointed_faces):
    config = BoundariesConfig(viscous=["west"], jointed_faces=jointed_faces)

    (face,) = make_boundaries(config, None, {"rock": "a medium"})

    assert face.media == ({"rock": "a medium"} if jointed_faces else {})


def test_uniform_stress_stands_beside_the_overburden():
    insitu = make_insitu(InSituConfig(stress_mpa=[-3.0, -2.0, 0.0, 0.0, 0.0, 0.5]))

    assert insitu.stress == pytest.approx((-3e6, -2e6, 0.0, 0.0, 0.0, 5e5))
    assert insitu.gravity == 9.81
