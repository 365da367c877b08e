"""Every piece of docs/guide/how_to.md is read, built or run."""

import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
from small_project import INSIDE, TEXT

from pyblast.blasts.hole_tables import read_blast
from pyblast.config.config import Config
from pyblast.config.section import merged
from pyblast.project.project import make_project
from pyblast.recordings.recording import read_recording

PAGE = (Path(__file__).parents[2] / "docs" / "guide" / "how_to.md").read_text(encoding="utf-8")
TITLES = re.findall(r"^## (.+)$", PAGE, re.MULTILINE)
FROM_OUTSIDE = ("signature", "input")
RECORD = "time_s,longitudinal_mm_per_s,transverse_mm_per_s,vertical_mm_per_s\n" + "".join(
    f"{0.002 * n},{20.0 * np.sin(0.3 * n) * np.exp(-0.1 * n):.6f},0.1,0\n" for n in range(80)
)


def blocks(title, language):
    part = PAGE[PAGE.index(f"## {title}\n") :].split("\n## ", 1)[0]
    return re.findall(rf"^```{language}\n(.*?)^```", part, re.MULTILINE | re.DOTALL)


def built(folder, text):
    """Build the model of the small project with some tables replaced."""
    base, piece = tomllib.loads(TEXT), tomllib.loads(text)
    base.pop("assumed")
    for name in ("joints", "signature", "blast", "boundaries"):
        if name in piece:
            base[name] = {}
    if "quality_band_hz" in text or "air_blast" in piece or "holes_inside" in piece:
        base.pop("damping")
    if "holes_inside" in piece:
        base["blast"] = {}
    if "air_blast" in piece or "holes_inside" in piece:
        for name in FROM_OUTSIDE:
            base.pop(name)
    if "free_field" in text:
        base["mesh"].pop("faults")
        base.pop("joints")
    if "receivers" in piece:
        base.pop("receivers")
    if "soil" in piece.get("materials", {}):
        base["materials"].pop("soil")
    return make_project(Config.model_validate(merged(base, piece)), folder / "project.toml")


@pytest.mark.parametrize("title", [title for title in TITLES if blocks(title, "toml")])
def test_a_piece_of_a_project_file_builds_a_model(title, tmp_path):
    for name in ("hole.csv", "house.csv"):
        (tmp_path / name).write_text(RECORD)
    for table in blocks(title, ""):
        (tmp_path / "holes.csv").write_text(table)

    project = built(tmp_path, blocks(title, "toml")[0])

    assert project.model.mesh is not None
    if "misfire" in title:
        assert [source.charge for source in project.sources] == [50.0, 50.0]  # the second is silent
    if "record" in title:
        assert list(project.recorded) == ["house"]


FILES = (Path(__file__).parents[2] / "docs" / "guide" / "recordings.md").read_text(encoding="utf-8")
FILES = re.findall(r"^```\n(.*?)^```", FILES, re.MULTILINE | re.DOTALL)


def test_the_tables_and_mappings_of_the_page_on_files_are_read(tmp_path):
    record, record_mapping, holes, hole_mapping = (tmp_path / f"{n}" for n in range(4))
    for path, text in zip((record, record_mapping, holes, hole_mapping), FILES, strict=True):
        path.write_text(text)
    odd = tmp_path / "odd.csv"
    odd.write_text("a\nb\nc\nt;L;T;V\n" + "".join(f"0,00{n};{n},5;2;{n}\n" for n in range(5)))
    plan = tmp_path / "plan.csv"
    plan.write_text("x\ny\nHole;Easting;Northing;RL;Mass;Time\nA;1,5;2;3;50;25\n")

    assert read_recording(record, bearing=0.0)[0].seismogram.dt == pytest.approx(0.001)
    found = read_recording(odd, bearing=0.0, mapping=record_mapping)[0].seismogram
    assert found.velocity.max() == pytest.approx(4.5e-3)
    assert read_blast(holes).charge[0] == 50.0
    assert read_blast(plan, hole_mapping).times[0] == pytest.approx(0.025)


def test_the_python_runs_as_it_stands(tmp_path, monkeypatch):
    (tmp_path / "project.toml").write_text(INSIDE)
    monkeypatch.chdir(tmp_path)
    names = {}

    for title in TITLES:
        for block in blocks(title, "python"):
            exec(block, names)

    assert names["peaks"][0][0] < names["peaks"][-1][0]  # a softer fault lets less pass
    assert names["house"].ppv.max() > 0.0
