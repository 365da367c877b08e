"""The quick part of the suite, and how cases are judged."""

import json
from pathlib import Path

import numpy as np
import pytest

from verification import __main__ as main
from verification import asked
from verification.__main__ import register_all, run_case
from verification.mutate import table
from verification.page import FAILS, _asked_row, by_number
from verification.scratch import ROOT
from verification.suite import CASES, Case, Reading, judge, observed_order

register_all()
RESULTS = json.loads(Path(main.RESULTS).read_text())
QUICK = sorted((n for n, one in CASES.items() if one.quick), key=by_number)


@pytest.mark.parametrize("name", QUICK)
def test_the_first_mesh_of_a_case_is_as_good_as_it_was(name):
    result, _ = run_case(CASES[name], quick=True)

    assert "failure" not in result, result.get("failure")
    known = {row["quantity"]: row["error"][0] for row in RESULTS[name]["quantities"]}
    for row in result["quantities"]:
        before = abs(known[row["quantity"]])
        assert abs(row["error"][0]) <= max(row["tolerance"], 1.02 * before), row


def pretend(errors, order=1.8, tolerance=0.1):
    meshes = (10.0, 20.0, 40.0)[: len(errors)]
    one = Case("0", "pretended", "none", "R", {"error": tolerance}, None, meshes, order=order)
    return judge(one, [[Reading("error", 0.0, e, e)] for e in errors])[0]


def test_the_observed_order_of_a_power_is_its_exponent():
    meshes = np.array([10.0, 20.0, 40.0])

    assert observed_order(meshes, 3.0 * meshes**-1.7) == pytest.approx(1.7)


def test_a_case_within_its_tolerance_and_of_good_order_passes():
    assert pretend([0.16, 0.04, 0.01])["pass"]
    assert pretend([0.16, 0.04, 0.01])["met_on"] == 20.0


def test_a_case_that_converges_too_slowly_fails():
    assert not pretend([0.09, 0.045, 0.0225])["pass"]


def test_a_case_out_of_its_tolerance_fails():
    assert not pretend([1.6, 0.4, 0.11])["pass"]


def test_errors_far_below_the_tolerance_need_no_order():
    assert pretend([0.005, 0.006, 0.007])["pass"]


def test_a_case_that_cannot_be_measured_is_a_failed_one():
    def broken(_):
        raise ValueError("no mesh")

    one = Case("0", "broken", "none", "R", {"error": 1.0}, broken, (10.0,))

    assert run_case(one)[0]["failure"] == "ValueError: no mesh"


ROWS = [(name, row) for name, one in RESULTS.items() for row in one.get("quantities", ())]


def test_every_stored_quantity_says_what_was_asked_and_why_it_is_judged_otherwise():
    assert set(RESULTS) == set(CASES)
    for name, row in ROWS:
        wanted = asked.asked_of(name, row["quantity"])
        assert (wanted is None) == (row["asked"] is None), (name, row)
        if wanted is None:
            assert row["as_asked"] is None
            continue
        assert (row["asked"]["tolerance"], row["asked"]["mesh"]) == wanted[:2], (name, row)
        same = wanted.mesh in (None, row["judged"]["mesh"])
        same &= wanted.tolerance == row["judged"]["tolerance"]
        assert row["reason"] or (same and row["as_asked"]), (name, row)


def test_every_quantity_asked_for_is_one_that_a_case_measures():
    for name, patterns in asked.ASKED.items():
        used = {asked.asked_of(name, quantity) for quantity in CASES[name].tolerance}
        assert set(patterns.values()) <= used, name


def test_a_quantity_that_misses_on_the_mesh_asked_for_fails_whatever_finer_meshes_show(monkeypatch):
    monkeypatch.setitem(asked.ASKED, "0", {"error": asked.Asked(0.1, 10.0, "for a reason")})

    row = pretend([0.16, 0.04, 0.01])

    assert row["pass"]
    assert not row["as_asked"]
    assert row["asked"] == {"tolerance": 0.1, "mesh": 10.0, "error": 0.16, "met_on": 20.0}
    assert row["judged"] == {"tolerance": 0.1, "mesh": 40.0}
    assert row["reason"] == "for a reason"
    assert f"| 20 | {FAILS} |" in _asked_row("0", row)


def test_the_mesh_asked_for_is_measured_where_the_study_leaves_it_out(monkeypatch):
    monkeypatch.setitem(asked.ASKED, "0", {"error": asked.Asked(0.1, 5.0)})
    one = Case("0", "pretended", "none", "R", {"error": 0.1},
               lambda n: ([Reading.absolute("error", 0.0, n**-2.0)], []), (10.0, 20.0))  # fmt: skip

    (row,) = run_case(one)[0]["quantities"]

    assert row["asked"]["error"] == pytest.approx(0.04)
    assert row["error"] == [1e-2, 2.5e-3]


def test_the_text_of_every_defect_occurs_once():
    mutants, tests = table()

    assert len({(m["name"], m["file"]) for m in mutants}) == len(mutants) >= 40
    for mutant in mutants:
        text = (ROOT / mutant["file"]).read_text(encoding="utf-8")
        assert text.count(mutant["original"]) == 1, mutant["name"]
        assert mutant["file"] in tests
    for named in tests.values():
        assert all(t[6:] in QUICK if t.startswith("suite:") else (ROOT / t).exists() for t in named)
