"""A case folder that can't be as it is described is refused with the part that is to blame."""

import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from case_folder import write_folder
from small_site import CUT, recorded, small_site

from benchmarks.blind.flat_models import flat_mesh
from pyblast.diagnosis.case import case_of
from pyblast.errors import InputError, PyblastError
from pyblast.project.case_folder import read_case_folder
from pyblast.project.flat_box import flat_box
from pyblast.recordings.seismic import mseed_bytes
from pyblast.workflows.diagnose import check_further, diagnose_folder

SOIL = 'layers = [{{ name = "{}", thickness_m = {}, density = 2000, vp = 800, vs = 400 }},'
JOINT = """[[joints]]
id = "J1"
axis = "y"
position = 70
law = "linear"
kn = 1e9
ks = 1e9
"""
RIMS = "whole_box = false\nextent = [{}, {}]\ndepth = [{}, {}]"


@cache
def hidden():
    """Return the small site with records."""
    return recorded(small_site()).project


ZEROS = {"S1": "2024-05-01T12:00:00", "B1": "2024-05-01T13:00:00"}


def changed(folder, *pairs, name="site.toml"):
    """Write the case folder, change a text file of it, and return the folder."""
    write_folder(folder, hidden(), ZEROS)
    text = (folder / name).read_text()
    for old, new in pairs:
        assert old in text
        text = text.replace(old, new)
    (folder / name).write_text(text)
    return folder


def inner(folder, name):
    """Move a file of a case folder into a folder in it; return its path."""
    (folder / "inner").mkdir()
    return (folder / name).rename(folder / "inner" / name)


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("noise_window_s = [-0.2, 0]", "noise_window_s = [0, 0.2]", "must begin and end before"),
        ("noise_window_s = [-0.2, 0]", "noise_window_s = [-0.3, -0.2]", "no record of R0 covers"),
        ("band_hz = [4, 25]", "band_hz = [25, 4]", r"band_hz: must be lowest, highest, got 25, 4"),
        (
            "band_hz = [4, 25]",
            "band_hz = [4, 110]",
            "band_hz: .* are complete up to 100 Hz; narrow it",
        ),
        ("x = [0, 120]", "x = [120, 0]", "box: each axis must go from low to high"),
        ("vp = 2800, vs = 1600", "vp = 28, vs = 21", "layers.rock: speeds must lie in 30"),
        ("vp = 2800, vs = 1600", "vp = 2.8, vs = 1.6", "which looks like km/s"),
        ("position = 60", "position = 260", "joints.J1.position: must lie within the box"),
        ("x = 110, y = 30", "x = 810, y = 30", "receivers.R3.position_m: lies outside"),
        ('id = "R2"', 'id = "House"', "station 'R2' of its records is no receiver"),
        (
            "layers = [",
            SOIL.format("rock", 8),
            "layers: 'rock' appears twice; give each a diff",
        ),
        ("layers = [", SOIL.format("soil", 108), "layers.soil: ends 108 m below"),
        ("layers = [", SOIL.format("soil", -8), "soil.thickness_m: must be pos"),
        ('"rock", density', '"rock", thickness_m = 60, density', "the last layer has no end"),
        ("whole_box = true", RIMS.format(20, 60, 70, 80), "J1.depth: must go from low to high and"),
        ("whole_box = true", RIMS.format(70, 20, 0, 80), "joints.J1.extent: .* 0 to 90 m, got 70"),
        (
            "[[joints]]",
            f"{JOINT}[[joints]]",
            "joints: 'J1' appears twice; give each",
        ),
        ('id = "J1"', 'id = "top"', "joints.top: is a side of the box; take another name"),
        ('id = "B1"', 'id = "S1"', "blasts: 'S1' appears twice"),
        ("charge_exponent = 0.9", 'charge_exponent = "x"', "charge_exponent: must be a number"),
        ("2024-05-01T13:00:00", "2024-05-01T15:00:00", "record of R0 ends -7200 s after"),
    ],
)
def test_what_can_not_be_is_said_with_its_place(tmp_path, old, new, told):
    with pytest.raises(PyblastError, match=told):
        case_of(read_case_folder(changed(tmp_path, (old, new))))


def test_a_source_that_begins_before_its_hole_fires_is_refused(tmp_path):
    site = hidden()
    rate = site.inside.moment_rate
    for start in (-0.002, -0.05):  # its first sample is zero
        inside = replace(site.inside, moment_rate=replace(rate, start=start))
        write_folder(tmp_path, replace(site, given={**site.given, "inside": inside}), ZEROS)
        if start == -0.002:
            read_case_folder(tmp_path)
    with pytest.raises(InputError, match=r"source: its moment rate begins at -0\.048 s"):
        read_case_folder(tmp_path)


def test_a_key_that_no_case_folder_has_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"joints\[1\].stiffness: unknown key"):
        read_case_folder(changed(tmp_path, ("whole_box", "stiffness = 1\nwhole_box")))


def test_the_written_folder_itself_is_read(tmp_path):
    assert case_of(read_case_folder(changed(tmp_path))).receivers == ("R0", "R1", "R2", "R3")


def test_the_case_folder_of_the_page_on_files_is_read(tmp_path):
    page = Path(__file__).parents[2] / "docs" / "guide" / "recordings.md"
    page = page.read_text(encoding="utf-8")
    (text,) = re.findall(r"^```toml\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    changed(tmp_path)
    (tmp_path / "site.toml").write_text(text, encoding="utf-8")
    (tmp_path / "S1_holes.csv").write_text("id,x,y,z,charge_kg,delay_s\n1,30,40,-10,20,0\n")
    motion = np.random.default_rng(1).normal(size=(1, 3, 300))
    channels = [[f"PB.R01..HH{letter}" for letter in "ENZ"]]
    (tmp_path / "S1.mseed").write_bytes(
        mseed_bytes(motion, channels, 0.004, "2024-05-01T09:59:59.6Z")
    )
    case = case_of(read_case_folder(tmp_path))

    assert case.receivers == ("R01",)
    assert case.project.joints[0].insitu_pressure == 2e5
    assert [thickness for _, thickness in flat_box(case.project).layers] == [8, None]


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


@pytest.mark.parametrize(
    ("cells", "told"),
    [
        ("30,30,-10,nan,0", "hole 1: its charge is missing"),
        ("30,30,-10,0,0", "no hole has a charge"),
        ("300,30,-10,5,0", "hole 1: lies outside of the box"),
        ("30,30,-10,5,9", "hole 1: fires at 9 s, but the prediction ends"),
    ],
)
def test_holes_that_foretell_nothing_are_refused(tmp_path, cells, told):
    changed(tmp_path)
    holes = tmp_path / "further.csv"
    holes.write_text(f"id,x,y,z,charge_kg,delay_s\n1,{cells}\n")

    with pytest.raises(InputError, match=told):
        check_further(tmp_path, holes)


def test_a_forecast_never_takes_the_place_of_a_record_or_of_another(tmp_path):
    changed(tmp_path)
    holes, out = tmp_path / "B1_holes.csv", tmp_path.parent / "out.mseed"

    check_further(tmp_path, holes, [out])
    for outputs in ([tmp_path / "B1.mseed"], [out, out], [out, tmp_path / ".." / out.name]):
        with pytest.raises(InputError, match="is read or written by the diagnosis"):
            check_further(tmp_path, holes, outputs)
    with pytest.raises(InputError, match="must be a file in an existing folder"):
        check_further(tmp_path, holes, [tmp_path / "no" / "out.mseed"])


def test_a_forecast_may_lie_beside_a_diagnosis_and_never_takes_its_place(tmp_path):
    case, out = changed(tmp_path), tmp_path / "out"
    holes = case / "B1_holes.csv"

    check_further(case, holes, [out / "pred.mseed"], out)
    assert not out.exists()
    for name in ("diagnosis.json", "report.html"):
        with pytest.raises(InputError, match="is read or written by the diagnosis"):
            check_further(case, holes, [out / name], out)
    with pytest.raises(InputError, match="must be a file in an existing folder, or in --out"):
        check_further(case, holes, [out / "inner" / "pred.mseed"], out)


def test_a_forecast_never_takes_the_place_of_a_record_in_another_folder(tmp_path):
    records = inner(changed(tmp_path, ('"B1.mseed"', '"inner/B1.mseed"')), "B1.mseed")

    with pytest.raises(InputError, match="is read or written by the diagnosis"):
        check_further(tmp_path, tmp_path / "B1_holes.csv", [records])


def test_a_change_of_a_file_in_another_folder_is_another_case(tmp_path, monkeypatch):
    holes = inner(changed(tmp_path, ('"B1_holes.csv"', '"inner/B1_holes.csv"')), "B1_holes.csv")
    hashes = []
    monkeypatch.setattr(
        "pyblast.workflows.diagnose._finished",
        lambda _, provenance, *__: hashes.append(provenance) or {},
    )
    for charge in (",60,", ",30,"):
        holes.write_text(holes.read_text().replace(",60,", charge))
        diagnose_folder(tmp_path, tmp_path / "out")

    assert hashes[0]["input_sha256"] != hashes[1]["input_sha256"]


def test_one_record_that_ends_early_does_not_cut_the_others():
    site = hidden()
    known = {one.name: one.records for one in (site, *site.further)}
    one = known["B1"]["R1"]
    seismogram = replace(one.seismogram, velocity=one.seismogram.velocity[:70])
    short = replace(one, seismogram=seismogram, clipped=np.zeros((70, 3), dtype=bool))
    records = {**known, "B1": {**known["B1"], "R1": short}}

    with pytest.raises(InputError, match=r"B1: the record of R1 ends 0\.0\d+ s after"):
        case_of(site.changed(records=records))
