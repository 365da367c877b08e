"""Meshes of flat boxes, and the project files of a case folder of an independent program."""

import re
from dataclasses import replace

import numpy as np
import pytest
from small_site import CUT, small_site

import examples.case_folder as case_folder
from benchmarks.blind.flat_models import flat_box, flat_mesh
from pyblast.diagnosis.case import case_of
from pyblast.errors import InputError
from pyblast.project.project import load_project
from pyblast.recordings.seismic import mseed_bytes


@pytest.mark.parametrize("seed", range(8))
def test_a_joint_of_any_size_has_faces_within_its_rims(seed):
    rng = np.random.default_rng(seed)
    extent, depth = ((low, low + size) for low, size in rng.uniform(1.0, 8.0, (2, 2)))
    ground = flat_box(small_site())
    (listed,) = ground.planes
    mark = replace(listed, name="mark", axis="y", position=rng.uniform(1.0, 20.0), jointed=False)
    mesh = flat_mesh(
        replace(
            ground,
            planes=(replace(listed, extent=extent, depth=depth), mark),
            layers=(("soil", rng.uniform(1.0, 20.0)), ("rock", None)),
        ),
        CUT,
    )
    _, along, up = mesh.points[mesh.surfaces["J1"]].mean(axis=1).T

    assert len(along)
    assert np.all((along > extent[0]) & (along < extent[1]))
    assert np.all((-up > depth[0]) & (-up < depth[1]))


def case_of_the_page(folder, *changes):
    """Write the case folder that the docstring of the script shows."""
    assert case_folder.__doc__
    text = "\n".join(re.findall(r"^    (?!python|pyblast)(.*)", case_folder.__doc__, re.MULTILINE))
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    folder.mkdir()
    (folder / "site.toml").write_text(text, encoding="utf-8")
    (folder / "S1_holes.csv").write_text("id,x,y,z,charge_kg,delay_s\n1,30,40,-10,20,0\n")
    rate = ["0,0", "0.01,1e9", "0.02,1e9", "0.03,0"]
    (folder / "source.csv").write_text("\n".join(["time_s,moment_rate_per_kg_Nm_per_s", *rate]))
    motion = np.random.default_rng(1).normal(size=(1, 3, 300)) * np.hanning(300)
    channels = [[f"PB.R01..HH{letter}" for letter in "ENZ"]]
    content = mseed_bytes(motion, channels, 0.004, "2024-05-01T09:59:59.6Z")
    (folder / "S1.mseed").write_bytes(content)
    return folder, motion


def test_the_case_folder_of_the_script_becomes_a_project_that_is_diagnosed(tmp_path):
    folder, motion = case_of_the_page(tmp_path / "case")
    project = load_project(case_folder.write_projects(folder, tmp_path / "out"))
    case = case_of(project)

    assert case.receivers == ("R01",)
    assert case.project.joints[0].insitu_pressure == 2e5
    assert case.project.joints[0].properties == {"kn": 2.4e9, "ks": 9e8}
    assert [(layer.thickness_m) for layer in project.config.mesh.layers] == [8, None]
    assert project.config.mesh.faults[0].through_m == [81.0, 85.0, 0.0]
    assert project.records["R01"].seismogram.start == pytest.approx(-0.4)
    np.testing.assert_allclose(project.records["R01"].seismogram.velocity.T, motion[0], atol=1e-6)
    assert project.blast.charge.tolist() == [20.0]


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("band_hz", "band", "band_hz: missing"),
        ('axis = "x"', 'axis = "z"', "joints.J1: must be across x or y and linear, got 'z'"),
    ],
)
def test_a_case_folder_that_is_none_is_refused(tmp_path, old, new, told):
    folder, _ = case_of_the_page(tmp_path / "case", (old, new))

    with pytest.raises(InputError, match=told):
        case_folder.write_projects(folder, tmp_path / "out")
