"""docs/quality/practice.md names a test for each row, and what is lost by mistakes is named."""

import ast
import re
from pathlib import Path

import numpy as np
import pytest
import recorder_files as files
from small_project import written

from pyblast.errors import Finding, InputError, ReadError
from pyblast.project.level import predicted_peak
from pyblast.project.project import load_project
from pyblast.project.result import Result
from pyblast.recordings.recording import read_recording
from pyblast.units import plain_number
from pyblast.workflows.run import write_curves

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "quality" / "practice.md").read_text(encoding="utf-8")
ROWS = [line for line in PAGE.splitlines() if line.startswith("|")]
TESTS = sorted(set(re.findall(r"`(tests/[\w/]+\.py)::(test_\w+)`", PAGE)))


@pytest.mark.parametrize(("file", "name"), TESTS)
def test_every_test_that_the_page_names_exists(file, name):
    tree = ast.parse((ROOT / file).read_text(encoding="utf-8"))

    assert name in {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}


def test_a_row_has_a_test_or_says_that_it_lacks():
    for row in ROWS:
        cells = [cell.strip() for cell in row.strip("|").split("|")]
        if cells[0] in ("expected", "event", "project", "---"):
            continue
        assert ("lacking" in cells) != ("::test_" in cells[-1]), row


GUIDE = (ROOT / "docs" / "guide" / "project_file.md").read_text(encoding="utf-8")
REFUSED = re.findall(r"^\| `((\w+) = [^`]+)` \| (.+) \|$", GUIDE, re.MULTILINE)


@pytest.mark.parametrize(("written_so", "key", "sentence"), REFUSED)
def test_the_guide_says_how_a_wrong_value_of_its_file_is_refused(
    tmp_path, written_so, key, sentence
):
    file = re.findall(r"## The smallest one\n\n```toml\n(.*?)```", GUIDE, re.DOTALL)[0]
    line = {"kn_gpa_m": "kn_gpa_per_m"}.get(key, key)
    (tmp_path / "p.toml").write_text(
        re.sub(rf"^{line} = .*$", written_so, file, count=1, flags=re.MULTILINE)
    )

    with pytest.raises(InputError) as refusal:
        load_project(tmp_path / "p.toml")

    assert str(refusal.value).endswith(sentence)


def test_every_curve_of_a_run_is_a_table_that_is_read_again(tmp_path):
    time = 1e-3 * np.arange(300)
    motion = np.outer(1e-3 * np.sin(60.0 * time) * np.exp(-9.0 * time), [1.0, 2.0, 3.0])
    head = {"dt": 1e-3, "start": 0.0, "components": ["east", "north", "vertical"]}
    heads = {"input": {}, "simulated": {"house 1/2": head}, "recorded": {}}
    write_curves(tmp_path / "curves", Result({"simulated": {"house 1/2": motion}}, {
        "seismograms": heads}))  # fmt: skip

    names = sorted(path.name for path in (tmp_path / "curves").iterdir())
    assert names == [
        "simulated_house_1_2.csv",
        "simulated_house_1_2_response.csv",
        "simulated_house_1_2_spectrum.csv",
    ]
    again = read_recording(tmp_path / "curves" / names[0])[0].seismogram
    np.testing.assert_allclose(again.velocity, motion, atol=1e-11)
    spectrum = np.loadtxt(tmp_path / "curves" / names[2], delimiter=",", skiprows=1)
    response = np.loadtxt(tmp_path / "curves" / names[1], delimiter=",", skiprows=1)
    assert response.shape[1] == 10
    assert spectrum.shape[1] == 4
    assert np.all(np.diff(spectrum[:, 0]) > 0.0)


def test_a_fault_outside_the_box_is_refused_by_its_name(tmp_path):
    path = written(tmp_path, ("through_m = [30, 0, 0]", "through_m = [300, 0, 0]"))

    with pytest.raises(InputError, match=r"faults\.F1: its plane passes the box"):
        _ = load_project(path).model


@pytest.mark.parametrize(("titles", "message"), [
    (None, "expected a row of channels such as Tran, Vert, Long"),
    (" Vert \t Vert \t Long ", "columns 1 and 2 are both vertical; remove one"),
])  # fmt: skip
def test_an_export_without_channels_or_with_one_twice_says_so(tmp_path, titles, message):
    lines = files.instantel_ascii().split("\n")
    row = lines.index(" Tran \t Vert \t Long ")
    path = tmp_path / "record.txt"
    path.write_text(
        "\n".join(lines[:row] + ([] if titles is None else [titles]) + lines[row + 1 :])
    )

    with pytest.raises(ReadError, match=message):
        read_recording(path)


@pytest.mark.parametrize("value", [1e7, 12345678.0, -3e6])
def test_large_numbers_are_written_out_in_refusals(value):
    assert float(plain_number(value)) == pytest.approx(value, rel=0.01)
    for text in (
        plain_number(value),
        str(InputError(f"k: must be below 1, got {value:g}")),
        str(ReadError(f"f.csv: got {value:g} m/s")),
        Finding("D1", "title", f"{value:g} zones").text,
    ):
        assert "e+" not in text
    assert str(InputError(f"got {value:g}")) == f"got {float(f'{value:g}'):.0f}"


def test_the_smallest_project_without_a_mesh_size_gives_the_peak_of_its_law(tmp_path):
    page = (ROOT / "docs" / "guide" / "project_file.md").read_text(encoding="utf-8")
    text = re.findall(r"```toml\n(.*?)```", page, re.DOTALL)[0]
    path = tmp_path / "project.toml"
    path.write_text(re.sub(r"^edge_m = .*\n", "", text, count=1, flags=re.MULTILINE))
    project = load_project(path)

    (house,) = project.simulate().seismograms.values()

    (row,) = project.receivers
    assert project.accuracy.band.complete
    assert 0.5 < house.ppv.max() / predicted_peak(project, row.position) < 2.0
