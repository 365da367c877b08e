"""Scenes with exact motion: each run says its error, however turned; all: ./dev scenes."""

import re
from dataclasses import replace

import numpy as np
import pytest

from pyblast.project.checks import check
from verification import scenes
from verification.rows import read_rows

ROWS = read_rows(scenes.OUT)


@pytest.mark.long
@pytest.mark.parametrize("name", ["force on the surface, no frequency, 0", "couple, near, mirrored",
                                  "couple beside a joint that dips 60°, 30"])  # fmt: skip
def test_a_scene_is_right_however_it_is_turned(name):
    row = scenes.measured(name)

    assert row["error"] < 0.015
    assert row["silent"] == 0


def test_wider_padding_sends_less_back_and_no_run_states_less_than_it_does(tmp_path):
    """Tetrahedra with 30, 90 and 150 m (0.16, 0.47 and 0.78 S waves) around an explosion."""
    name, mesh = "explosion, 20 m deep", {"kind": "tetrahedra", "quadratic": True}
    errors, stated = [], []
    for width in (30.0, 90.0, 150.0):
        padded = {"frequency_hz": 20.0, "padding_m": width, "padding_edge_m": 50.0}
        project = scenes.project(name, "0", tmp_path, **mesh, **padded)
        far = [scenes.compared(project, name, "0")[0][each] for each in ("2", "3")]
        errors.append([each["error"] for each in far])
        stated.append([each["expected"] for each in far])

    assert (np.diff(errors, axis=0) < 0.0).all()
    assert (np.array(errors) <= stated).all()
    assert (np.array(stated) < 3.0 * np.array(errors)).all()


def test_the_padding_that_d46_names_sends_back_what_is_accepted(tmp_path):
    mesh = {"kind": "tetrahedra", "quadratic": True, "frequency_hz": 20.0, "accuracy": 0.05}
    narrow = scenes.project(
        "explosion, 20 m deep", "0", tmp_path, **mesh, padding_m=30.0, padding_edge_m=60.0
    )
    (found,) = [each for each in check(narrow).findings if each.code == "D46"]

    width = float(re.search(r"mesh\.padding_m = (\d+)", found.text)[1])
    wide = scenes.project(
        "explosion, 20 m deep", "0", tmp_path, **mesh, padding_m=width, padding_edge_m=60.0
    )

    sent = [max(row.parts["sides"] for row in each.accuracy.rows) for each in (narrow, wide)]
    assert sent[1] < 1.05 * scenes.FOUND * 0.05 < sent[0]


def test_the_joint_of_the_solution_is_none_where_it_is_stiff(monkeypatch):
    monkeypatch.setattr(scenes, "STIFF", (1e14, 1e14))
    scenes.exact.cache_clear()
    scene = "couple beside a level joint"
    times = 1e-3 * np.arange(150)

    motion = scenes.exact(scene, 150, 1e-3)
    rock = scenes.SCENES[scene].material("rock")
    scenes.exact.cache_clear()

    for away, own in zip(scenes.SCENES[scene].away, motion, strict=True):
        free = scenes.moment(times, away, scenes.COUPLE, scenes.BELL, rock)
        assert own == pytest.approx(free, abs=0.01 * np.abs(free).max())


def test_no_stored_scene_is_silent_beyond_three_times_its_accuracy():
    silent = {name for name, row in ROWS.items() if row["silent"]}

    assert len(ROWS) > 60
    assert silent <= scenes.KNOWN


@pytest.mark.parametrize("name", ["couple below soil, Qs 20", "force on the surface"])
def test_a_larger_scene_moves_as_much_less_as_its_lengths_squared(name, monkeypatch):
    one, scale = scenes.SCENES[name], 20.0
    larger = replace(
        one, away=scale * one.away, below=scale * one.below, soil=scale * one.soil, scale=scale,
        band=tuple(edge / scale for edge in one.band),
    )  # fmt: skip
    monkeypatch.setitem(scenes.ALL, "larger", larger)
    scenes.exact.cache_clear()

    motion, own = scenes.exact(name, 150, 2e-3), scenes.exact("larger", 150, 2e-3 * scale)

    for small, large in zip(motion, own, strict=True):
        assert scale**2 * large == pytest.approx(small, abs=1e-6 * np.abs(small).max())


def test_the_quality_of_loh_3_takes_from_loh_1_more_the_farther_it_is():
    lossless, lossy = (scenes.exact(name, 300, 0.03) for name in ("LOH.1", "LOH.3"))

    near, far = (np.abs(b).max() / np.abs(a).max() for a, b in zip(lossless, lossy, strict=True))

    assert 0.5 < far < near < 1.0
