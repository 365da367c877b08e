"""The numbers of docs/quickstart.md are those of its commands."""

import re
from pathlib import Path

import pytest

from docs.quickstart_pictures import RECEIVER
from pyblast import simulate
from pyblast.project.level import plausible_at, predicted_peak
from pyblast.project.project import load_project
from pyblast.project.result import comparison_table
from pyblast.workflows.run import compare_all

ROOT = Path(__file__).parents[2]


def test_the_quick_start_says_what_its_run_gives():
    project = load_project(ROOT / "examples" / "fault_from_records" / "project.toml")
    motion = simulate(project).seismograms

    compared = comparison_table(compare_all(project, motion)[RECEIVER])

    page = " ".join((ROOT / "docs" / "quickstart.md").read_text(encoding="utf-8").split())
    places = {receiver.name: receiver.position for receiver in project.receivers}
    front = motion["front"].ppv.max() / predicted_peak(project, places["front"])
    (off,) = re.findall(r"off by ([+-]\d+), ([+-]\d+) and ([+-]\d+) %", page)
    (times,) = re.findall(r"the run gives ([\d.]+) times what the law gives", page)
    # A mesh of the same error may move a peak by some percent.
    assert [float(value) for value in off] == pytest.approx(
        [100.0 * value for value in compared["ppv_deviation"]], abs=15.0
    )
    assert float(times) == pytest.approx(front, abs=0.2)
    assert f"{plausible_at(project, places[RECEIVER])} mm/s at the house" in page
