"""The example of holes inside the model, coarser, against laws of nature."""

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pyblast.config.config import check_config
from pyblast.model.source import PointForce, TimeFunction
from pyblast.project.project import load_project, make_project
from pyblast.solver.run import simulate
from pyblast.workflows import run

EXAMPLE = Path(__file__).parents[2] / "examples" / "holes_inside" / "project.toml"
PULSE = TimeFunction(1e6 * np.sin(np.pi * np.arange(0.0, 0.0501, 0.001) / 0.05) ** 2, 0.001)


def coarse(charge=60.0, exponent=1.0, kind="tetrahedra"):
    table = tomllib.loads(EXAMPLE.read_text(encoding="utf-8"))
    table["mesh"] |= {"edge_m": 12, "padding_edge_m": 20, "kind": kind}
    # Holes so thin that either charge fills them: more charge does not move its centre.
    table["blast"] |= {"charge_kg": charge, "charge_exponent": exponent, "diameter_mm": 60}
    table["run"] |= {"duration_s": 0.1, "snapshots_s": []}
    return make_project(check_config(table), EXAMPLE)


@pytest.fixture(scope="module")
def project():
    return coarse()


def motion(model):
    return simulate(model, 0.1).seismograms


def test_twice_the_charge_doubles_the_motion(project):
    single, double = motion(project.model), motion(coarse(charge=120.0).model)

    for name, record in single.items():
        assert record.pvs > 0.0
        difference = double[name].velocity - 2.0 * record.velocity
        assert np.abs(difference).max() < 1e-9 * double[name].pvs


def test_source_and_receiver_may_change_places_across_the_fault(project):
    first, second = (np.array(r.position) for r in project.receivers[:2])
    there = PointForce(first, np.array([0.0, 0.0, 1.0]), PULSE)
    back = PointForce(second, np.array([0.6, 0.8, 0.0]), PULSE)
    receivers = [replace(r, azimuth=None) for r in project.receivers[:2]]
    plain = replace(project.model, receivers=receivers)

    here = motion(replace(plain, sources=[there]))["back"].velocity @ back.direction
    away = motion(replace(plain, sources=[back]))["front"].velocity @ there.direction

    assert np.abs(here - away).max() < 1e-9 * np.abs(here).max()


def test_the_padding_is_the_rim(project):
    layer = project.absorbing_layer

    assert layer.box == ((0.0, 90.0), (0.0, 40.0), (0.0, 30.0))
    assert layer.width == 40.0


@pytest.mark.long
def test_hexahedra_have_a_matched_layer_instead_of_a_rim(tmp_path):
    project = coarse(kind="auto")

    assert project.absorbing_layer is None
    assert project.mesh.layer is not None
    assert "an absorbing layer" in project.meshed.reason
    outcome = run.run(project, tmp_path)
    assert project.meshed.reason in (outcome.folder / "report.html").read_text(encoding="utf-8")


def test_the_example_holds_the_band_of_its_source():
    from pyblast.project.checks import check

    assert not check(load_project(EXAMPLE)).failed


def test_the_report_shows_the_sources(project, tmp_path):
    outcome = run.run(project, tmp_path)

    page = (outcome.folder / "report.html").read_text(encoding="utf-8")
    assert "6 holes inside the model, M = M(1 kg) W^1" in page
    assert "40 m wide" in page
    assert "Single hole" not in page
    summary = outcome.result.summary["sources"]
    assert [hole["time"] for hole in summary["holes"]] == pytest.approx(3 * [0.0] + 3 * [0.017])
