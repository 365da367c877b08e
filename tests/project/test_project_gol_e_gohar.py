"""The example of the paper: its numbers, without running it."""

import math
from pathlib import Path

import numpy as np
import pytest

from pyblast.project.ground import mean_edge
from pyblast.project.project import load_project

EXAMPLE = Path(__file__).parents[2] / "examples" / "gol_e_gohar" / "project.toml"


@pytest.fixture(scope="module")
def project():
    return load_project(EXAMPLE)


def test_table_1_gives_young_and_poisson(project):
    young = {name: m.young / 1e6 for name, m in project.materials.items()}

    assert young == pytest.approx({"soil": 150, "schist": 18720, "magnetite": 38485}, rel=1e-3)
    assert [m.poisson for m in project.materials.values()] == pytest.approx(3 * [0.3], abs=1e-3)


def test_table_2_and_6_give_the_stiffnesses(project):
    found = {
        j.surface: (j.properties["kn"] / 1e9, j.properties["ks"] / 1e9) for j in project.joints
    }

    assert found["Jn_schist"] == pytest.approx((1.3, 0.635))
    assert found["Jt_magnetite"] == pytest.approx((1.5, 0.734))
    assert found["F1"] == found["F2"] == pytest.approx((0.114, 0.025))


def test_sixty_holes_fire_in_four_rows(project):
    firing = project.input.firing

    assert len(firing.times) == 60
    assert sorted(set(firing.times)) == pytest.approx([0.0, 0.04, 0.08, 0.12])
    assert project.blast.charge_per_window() == pytest.approx(6750.0)


def test_the_signature_is_measured_at_39_metres_and_called_assumed(project):
    cavity = project.config.signature.cavity

    assert math.dist(cavity.hole_m, cavity.receiver_m) == pytest.approx(39.0, abs=0.01)
    assert project.is_assumed("signature.cavity.radius_m")
    assert project.signature.pvs < 0.254


def test_the_load_carries_no_more_energy_than_explosives_send_into_waves(project):
    velocity, rock = project.input.motion, project.materials["magnetite"]
    speeds = [rock.cp, rock.cs, rock.cs]
    flux = rock.density * np.sum(speeds * velocity.velocity**2) * velocity.dt
    face = 200.0 * 150.0

    assert project.input.low_passed.corner == 20.0
    assert flux * face < 0.2 * 27000.0 * 3.8e6


def test_the_receiver_is_300_metres_from_the_blast(project):
    x, y = project.config.receivers[0].position_m

    assert x == pytest.approx(261.0)
    assert math.hypot(x + 39.0, y - 150.0) == pytest.approx(300.0)


def test_the_full_run_has_the_mesh_of_the_paper():
    full = load_project(EXAMPLE, full=True)

    mesh = full.config.mesh
    edges = [mean_edge(mesh, layer, full.materials[layer.material]) for layer in mesh.layers]

    assert mesh.size_m == [300, 300, 150]
    assert edges == [5.0, 5.0, 5.0]
