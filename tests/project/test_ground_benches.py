"""Benches of a project file: lines, burden, receivers on berms, and joints that a mesh bends."""

from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from pyblast.config.ground import BenchConfig, FractureConfig, MeshConfig
from pyblast.errors import InputError
from pyblast.ground import surface
from pyblast.ground.surface import benches_of, survey_of
from pyblast.project import checks
from pyblast.project.checks_ground import ground_notes
from pyblast.project.project import load_project

EXAMPLE = Path(__file__).parents[2] / "examples" / "bench" / "project.toml"


def test_the_example_has_planes_burdens_and_receivers_on_the_ground():
    project = load_project(EXAMPLE)

    found = checks.check(project)

    (burden,) = (note for note in found.notes if note.startswith("Burden"))
    assert "nearest bench face at its height: 4.27 to 6.53 m" in burden
    assert "D39" not in {finding.code for finding in found.findings}
    rows = {(row.name, row.quantity): row.built for row in found.ground_as_built}
    assert rows["F1", "mean lean of its facets, degrees"] < 1e-3
    assert project.receivers[0].position[2] == pytest.approx(40.0)
    assert project.mesh.points[:, 2].max() == pytest.approx(40.0)


def test_bench_lines_are_read_from_files_as_from_the_project(tmp_path):
    text = "x_m,y_m,z_m\n30,0,5\n31,20,5\n"
    (tmp_path / "crest.csv").write_text(text)
    files = MeshConfig(size_m=[60, 20, 9], edge_m=5, layers=[{"material": "a"}],
                       benches=[{"crest_file": "crest.csv", "height_m": 4}])  # fmt: skip

    (bench,) = benches_of(files, tmp_path)

    assert bench.crest.tolist() == [[30, 0, 5], [31, 20, 5]]
    assert bench.toe.tolist() == [[30, 0, 1], [31, 20, 1]]
    assert files.files == [None, None, "crest.csv", None]
    table = MeshConfig(size_m=[60, 20, 9], edge_m=5, layers=[{"material": "a"}],
                       surface_file="crest.csv")  # fmt: skip
    assert survey_of(table, tmp_path).values.tolist() == bench.crest.tolist()


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"height_m": 4}, "crest"),
        ({"crest_m": [[0, 0, 0], [0, 9, 0]]}, "toe"),
        ({"crest_file": "a.csv", "toe_file": "b.csv", "face_dip_deg": 60}, "goes with height_m"),
    ],
)
def test_half_a_bench_is_refused(keys, message):
    with pytest.raises(ValidationError, match=message):
        BenchConfig(**keys)


def test_benches_and_a_surface_at_once_are_refused():
    with pytest.raises(ValidationError, match="without surface_file"):
        MeshConfig(size_m=[60, 20, 9], edge_m=5, layers=[{"material": "a"}], surface_file="a.csv",
                   benches=[{"crest_file": "crest.csv", "height_m": 4}])  # fmt: skip


FRACTURES = EXAMPLE.parents[1] / "fractures" / "project.toml"


@pytest.mark.long
def test_fractures_of_a_project_are_cut_counted_and_end_at_the_fault():
    project = load_project(FRACTURES)

    notes = ground_notes(project)

    assert any(note.startswith("Fractures bedding") and "seed 1" in note for note in notes)
    assert project.config.mesh.files == [None, None, "discs.csv", None]
    assert {joint.surface: joint.properties["kn"] for joint in project.joints} == pytest.approx(
        {"F1": 3e9, "mapped": 8e9, "bedding": 8e9}
    )
    fault = surface.make_fractures(project.config.mesh, EXAMPLE.parents[1] / "fractures")
    west = [f for f in fault if f.name == "mapped" and f.point[0] < 30.0]
    normal = np.array([np.sin(np.radians(65.0)) * np.sin(np.radians(80.0)),
                       np.sin(np.radians(65.0)) * np.cos(np.radians(80.0)),
                       np.cos(np.radians(65.0))])  # fmt: skip
    for part in west:
        assert (part.polygon @ normal).max() <= normal @ [36.0, 20.0, 30.0] + 1e-9


LAWS = {"name": "a", "dip_deg": 9, "dip_direction_deg": 9, "fisher_kappa": 9, "p32": 0.1}


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"name": "a"}, "give one of file"),
        ({"name": "a", "file": "a.csv", "p32": 0.1}, "give one of file"),
        ({"name": "a", "file": "a.csv", "radius_m": 2.0}, "radius_m does not go with file"),
        (LAWS, "radius_m is missing"),
        (LAWS | {"radius_law": "power", "radius_exponent": 2}, "radius_range_m is missing"),
        (LAWS | {"radius_m": 2, "radius_exponent": 2}, "radius_exponent does not go with"),
    ],
)
def test_half_a_set_of_fractures_is_refused(keys, message):
    with pytest.raises(ValidationError, match=message):
        FractureConfig(**keys)


def test_fractures_that_end_at_an_unknown_fault_are_refused(tmp_path):
    mesh = MeshConfig(size_m=[60, 20, 9], edge_m=5, layers=[{"material": "a"}],
                      fractures=[LAWS | {"radius_m": 2, "ends_at": ["F9"]}])  # fmt: skip

    with pytest.raises(InputError, match="ends_at: 'F9' must be a fault"):
        surface.make_fractures(mesh, tmp_path)


def places_over(width, scattered):
    """Return places over a width in m of a box of 100 m, in a grid of 10 m or scattered."""
    x, y = np.meshgrid(np.arange(0.0, width + 1.0, 10.0), np.arange(0.0, 101.0, 10.0))
    plan = np.column_stack([x.ravel(), y.ravel()])
    if scattered:
        inner = (plan[:, 0] > 0.0) & (plan[:, 0] < width)
        plan[inner] += np.random.default_rng(1).uniform(-2.0, 2.0, (inner.sum(), 2))
    return np.column_stack([plan, np.zeros(len(plan))])


@pytest.mark.parametrize("scattered", [False, True])
def test_a_survey_that_ends_inside_of_the_box_is_refused(scattered):
    box = np.array([[0.0, 100.0], [0.0, 100.0], [-50.0, 0.0]])

    surface.refuse_uncovered(places_over(100.0, scattered), box)
    with pytest.raises(InputError, match="must cover the box"):
        surface.refuse_uncovered(places_over(70.0, scattered), box)
