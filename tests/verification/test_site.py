"""The study of hidden changes: its sites, its scores, and what its rows say."""

import numpy as np
import pytest

from pyblast.line_records.changes import StepChange
from verification.rows import read_rows
from verification.site import HIDDEN, OUT, PAGE, RATE, paged, scored, site, summary


def step(blast, *kinds, station=None):
    return StepChange(blast, (blast - 1, blast + 1), kinds, station, np.zeros(6), np.ones(6), 9.0)


def test_scores_count_dates_kinds_and_false_alarms():
    hidden = {"turned": 40, "halved": 100, "delays": 200}
    steps = [step(41, "gain"), step(44, "orientation", station=1), step(103, "charge"),
             step(300, "timing")]  # fmt: skip

    row = scored(hidden, steps)

    assert row["found"]["turned"] == {
        "off": 4, "kinds": ["orientation"], "right": True, "inside": False
    }  # fmt: skip
    assert row["found"]["halved"]["right"] is False
    assert row["found"]["delays"] is None
    assert [blast for blast, _, _ in row["false"]] == [41, 300]
    table = summary({"0": row | {"inside": 9, "forecasts": 10}})
    assert table["changes"] == 3
    assert table["missed"] == 1
    assert table["date_within_two"] == 0
    assert table["kind_right_or_class"] == pytest.approx(1 / 3)
    assert table["coverage"] == 0.9


def test_a_site_hides_what_it_says():
    made = site(3)
    hidden, peak = made["hidden"], np.abs(made["motion"]).max(axis=2)

    assert hidden.keys() == HIDDEN.keys()
    assert min(np.diff(sorted(hidden.values()))) >= 4
    step = np.linalg.norm(np.diff(made["at"], axis=0), axis=1)
    assert np.argmax(step) + 1 == hidden["bench"]
    assert peak.max() < 0.5
    assert len(peak) / RATE > 1.0
    assert 0.6 < made["recorded"].mean() < 0.95


def test_rows_keep_what_the_documents_say():
    table = summary(read_rows(OUT))

    assert table["changes"] >= 60
    assert table["date_within_two"] >= 0.8
    assert table["kind_right_or_class"] >= 0.8
    assert table["false_alarms_a_year"] <= 1.0
    assert 0.85 <= table["coverage"] <= 0.95
    times = read_rows(OUT)["timing"]
    assert times["first_s"] <= 10.0
    assert max(times["again_s"], times["one more_s"]) <= 2.0
    page = PAGE.read_text(encoding="utf-8")
    assert paged(page, read_rows(OUT)) == page
