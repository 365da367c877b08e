"""The numbers of docs/quickstart.md are those of its commands."""

from pathlib import Path

from docs.quickstart_pictures import RECEIVER, sentence
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
    assert sentence(compared) in page
    assert f"{plausible_at(project, places[RECEIVER])} mm/s at the house" in page
    assert f"the run gives {front:.1f} times what the law gives" in page
