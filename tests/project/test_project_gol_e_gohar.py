"""The example of the paper: its numbers, without running it."""

import math
import tomllib
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import numpy as np
import pytest

from pyblast.blasts.published_laws import plausible_ppv
from pyblast.ground.tables import mean_edge
from pyblast.project.level import energy_finding, plausible_at, predicted_peak, source_energy
from pyblast.project.project import Project, load_project
from pyblast.signals.spectra import highest_frequency, lowpass

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


def test_the_signature_has_what_is_published_of_it_and_is_called_assumed(project):
    signature = project.signature
    late = signature.times > 0.88

    assert project.is_assumed("signature.recorded")
    assert project.config.input.distance_m == 39.0
    assert signature.pvs < 0.254  # instruments nearer than 39 m clip there
    assert np.abs(signature.velocity[late]).max() < 1e-3 * signature.pvs  # 0.88 s of a hole
    assert highest_frequency(signature) < 20.0
    laws = plausible_ppv(39.0, 450.0)
    assert laws.low < signature.ppv.max() < laws.high


def test_the_record_of_the_example_is_that_of_its_program(project):
    spec = spec_from_file_location("signature", EXAMPLE.with_name("signature.py"))
    program = module_from_spec(spec)
    spec.loader.exec_module(program)

    made = program.signature()

    turned = made.rotated(math.radians(270.0)).velocity
    mean = turned.mean(axis=0)
    assert project.signature.velocity == pytest.approx(turned - mean, abs=1e-7)


def test_the_load_carries_no_more_energy_than_explosives_send_into_waves():
    """On a coarse mesh of the same face, without joint sets."""
    tables = tomllib.loads(EXAMPLE.read_text(encoding="utf-8"))
    for key in ("joint_sets", "refinements"):
        tables["mesh"][key] = []
    for material in tables["materials"].values():
        material.pop("yielding")
    tables["joints"] = {"fault": tables["joints"]["fault"]}
    del tables["assumed"], tables["full"]
    coarse = Project.from_dict(tables, EXAMPLE.parent)

    energy = source_energy(coarse)

    assert 0.01 < energy.share < 0.1
    assert energy_finding(energy) is None


def test_the_paper_s_filter_would_change_nearly_nothing(project):
    filtered = lowpass(project.input.superposed, 60.0)

    assert np.abs(filtered.ppv_change).max() < 0.02
    assert np.nanmax(project.input.low_passed.removed_energy) < 0.05


def test_the_level_at_the_receiver_is_that_of_laws(project):
    position = np.array([*project.config.receivers[0].position_m, 150.0])

    plausible, predicted = plausible_at(project, position), predicted_peak(project, position)

    assert plausible.low < predicted < plausible.high


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
