"""Scenes with exact motion: each run says its error, however turned; all: ./dev scenes."""

from dataclasses import replace

import numpy as np
import pytest

from verification import scenes
from verification.rows import read_rows

ROWS = read_rows(scenes.OUT)


@pytest.mark.parametrize("name", ["force on the surface, no frequency, 0", "couple, near, mirrored",
                                  "couple beside a joint that dips 60°, 30"])  # fmt: skip
def test_a_scene_is_right_however_it_is_turned(name):
    row = scenes.measured(name)

    assert row["error"] < 0.015
    assert row["silent"] == 0


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
