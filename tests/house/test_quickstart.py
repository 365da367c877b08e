"""The numbers of docs/quickstart.md are those of its commands."""

import json
import re

import pytest

from docs.check import QUICKSTART, ROOT, differs
from docs.quickstart_values import RECEIVER, TRUTH, sentence, table
from pyblast import back_analyse
from pyblast.project.level import plausible_at, predicted_peak
from pyblast.project.project import load_project
from pyblast.project.result import comparison_table
from pyblast.workflows.back_analysis import RESULT
from pyblast.workflows.run import compare_all


@pytest.mark.long
def test_the_quick_start_says_what_its_run_gives():
    project = load_project(ROOT / "examples" / "fault_from_records" / "project.toml")
    motion = project.simulate().seismograms

    compared = comparison_table(compare_all(project, motion)[RECEIVER])

    page = " ".join(QUICKSTART.read_text(encoding="utf-8").split())
    places = {receiver.name: receiver.position for receiver in project.receivers}
    front = motion["front"].ppv.max() / predicted_peak(project, places["front"])
    off = re.findall(r"([+-]\d+) % \((?:long|trans|vert)", page)
    (times,) = re.findall(r"the run gives ([\d.]+) times what the law gives", page)
    assert not differs(
        re.sub(r"[+-]\d+ %", "x", sentence({"comparisons": {RECEIVER: compared}})),
        re.sub(r"[+-]\d+ %", "x", re.findall(r"The simulated PPV differs by [^.]*\.", page)[0]),
    )
    # A mesh of the same error may move a peak by some percent.
    assert [float(value) for value in off] == pytest.approx(
        [100.0 * value for value in compared["ppv_deviation"]], abs=15.0
    )
    assert float(times) == pytest.approx(front, abs=0.2)
    assert f"{plausible_at(project, places[RECEIVER])} mm/s at the house" in page


def numbers(line):
    """Return the numbers of a row of the table of the search, without those of its key."""
    return [float(number) for number in re.findall(r"[\d.]+", line.split("`")[2])]


@pytest.mark.long
def test_the_quick_start_says_what_its_search_finds(tmp_path):
    page = QUICKSTART.read_text(encoding="utf-8")

    _, folder = back_analyse(ROOT / "examples" / "fault_from_records" / "project.toml", tmp_path)

    rows = table(json.loads((folder / RESULT).read_text(encoding="utf-8"))).splitlines()[4:]
    for row, path in zip(rows, TRUTH, strict=True):
        (shown,) = (line for line in page.splitlines() if line.startswith(f"| `{path}`"))
        # A mesh of the same error may move a value by some percent.
        assert numbers(row) == pytest.approx(numbers(shown), rel=0.15)
        assert row.split("|")[-2] == shown.split("|")[-2]
