"""Scenes with exact motion: each run says its error, however turned; all: ./dev scenes."""

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
    scenes.exact.cache_clear()

    for away, own in zip(scenes.SCENES[scene].away, motion, strict=True):
        free = scenes.moment(times, away, scenes.COUPLE, scenes.BELL, scenes.rock())
        assert own == pytest.approx(free, abs=0.01 * np.abs(free).max())


def test_no_stored_scene_is_silent_beyond_three_times_its_accuracy():
    silent = {name for name, row in ROWS.items() if row["silent"]}

    assert len(ROWS) > 60
    assert silent <= scenes.KNOWN
