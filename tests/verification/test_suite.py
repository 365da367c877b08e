"""The quick part of the suite, and how cases are judged."""

import json
import math
import re
from datetime import date
from itertools import takewhile
from pathlib import Path

import numpy as np
import pytest

from verification import __main__ as main
from verification import asked
from verification.__main__ import judged_anew, register_all, run_case
from verification.mutate import table
from verification.page import FAILS, OLD, PAGE, _asked_row, _measured, by_number
from verification.rows import program
from verification.scratch import ROOT
from verification.suite import CASES, Case, Reading, judge, observed_order, verdict

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


def test_a_quantity_may_have_a_least_order_of_its_own_or_none():
    about = {"meshes": (10.0, 20.0, 40.0), "order": 1.8}
    measured = [[Reading("a", 0.0, e, e), Reading("b", 0.0, e, e)] for e in (0.08, 0.04, 0.02)]
    tolerance = {"a": 0.1, "b": 0.1}
    exempt = Case("0", "pretended", "none", "R", tolerance, None, ordered=("b",), **about)
    own = Case("0", "pretended", "none", "R", tolerance, None, ordered={"a": 0.9, "b": 2}, **about)

    assert [row["pass"] for row in judge(exempt, measured)] == [True, False]
    assert judge(exempt, measured)[0]["unordered"] == "not judged"
    assert [row["pass"] for row in judge(own, measured)] == [True, False]


def test_a_case_that_cannot_be_measured_is_a_failed_one():
    def broken(_):
        raise ValueError("no mesh")

    one = Case("0", "broken", "none", "R", {"error": 1.0}, broken, (10.0,))

    assert run_case(one)[0]["failure"] == "ValueError: no mesh"


ROWS = [(name, row) for name, one in RESULTS.items() for row in one.get("quantities", ())]


def alike(one, other):
    """Tell whether two results agree, orders but for last digits: machines differ in logarithms."""
    if isinstance(one, list):
        return len(one) == len(other) and all(map(alike, one, other))
    if not isinstance(one, dict):
        return one == other
    both = {key: (value, other.get(key)) for key, value in one.items()}
    return one.keys() == other.keys() and all(
        close(*pair) if key == "order" else alike(*pair) for key, pair in both.items()
    )


def close(one, other):
    """Tell whether two orders of convergence agree; None where there is none."""
    return one == other or (
        None not in (one, other) and math.isclose(one, other, rel_tol=1e-9, abs_tol=1e-12)
    )


def test_every_stored_result_is_judged_by_what_stands_in_it():
    assert set(RESULTS) == set(CASES)
    for name, row in ROWS:
        wanted = asked.asked_of(name, row["quantity"])
        assert alike(row, verdict(CASES[name], row)), (name, row)
        assert (wanted is None) == (row["asked"] is None), (name, row)
        if wanted is not None:
            assert (row["asked"]["tolerance"], row["asked"]["mesh"]) == wanted, (name, row)
            assert bool(row["reason"]) != row["as_asked"], (name, row)
    for name, one in RESULTS.items():
        assert alike(one, judged_anew(CASES[name], one))


def cells(*header):
    """Return the rows of the table of the page under a header, as the texts of their cells."""
    lines = iter(PAGE.read_text(encoding="utf-8").split("\n"))
    for line in lines:
        if [cell.strip() for cell in line.strip("|").split("|")][: len(header)] == [*header]:
            next(lines)
            return [
                [cell.strip() for cell in re.split(r"(?<!\\)\|", row)[1:-1]]
                for row in takewhile(lambda row: row.startswith("|"), lines)
            ]
    return []


def test_the_page_ticks_what_the_numbers_printed_beside_it_meet():
    rows = cells("case", "problem", "gate", "of")
    assert len(rows) == len(ROWS)
    for *_, quantity, errors, order, tolerance, mark in rows:
        numbers, bound = [abs(float(one)) for one in errors.split(",")], float(tolerance)
        found, _, least = order.partition(" ≥ ")
        within = numbers[-1] <= bound and (not least or float(found) >= float(least))
        assert mark == ("✓" if within else FAILS), quantity
        if len(numbers) > 1:
            tiny = max(numbers) <= max(0.1 * bound, 1e-12)
            assert tiny == order.endswith("small"), quantity
            assert least or order.endswith(("small", "not judged")), quantity


def test_the_page_marks_what_misses_the_tolerance_asked_for_on_the_mesh_asked_for():
    rows = [row for row in cells("case", "quantity", "asked") if row[3] != "not measured"]
    assert len(rows) == len(ROWS)
    for _, quantity, limit, error, _, _, mark, lacking in rows:
        if limit == "–":
            assert (error, mark, lacking) == ("", "", ""), quantity
            continue
        good = abs(float(error)) <= float(limit.split(" at ")[0])
        assert mark == ("✓" if good else FAILS), quantity
        assert bool(lacking) != good, quantity


def test_a_measurement_of_another_program_or_week_or_unknown_is_marked():
    today, fresh = date(2026, 11, 27), {"date": "2026-11-20", "program": program()}

    assert OLD not in _measured(fresh, today)
    assert OLD in _measured(fresh | {"date": "2026-11-19"}, today)
    assert OLD in _measured(fresh | {"program": "another"}, today)
    assert _measured({}, today) == OLD


def test_every_quantity_asked_for_is_one_that_a_case_measures():
    for name, patterns in asked.ASKED.items():
        used = {asked.asked_of(name, quantity) for quantity in CASES[name].tolerance}
        assert set(patterns.values()) <= used, name


def test_a_quantity_that_misses_on_the_mesh_asked_for_fails_whatever_finer_meshes_show(monkeypatch):
    monkeypatch.setitem(asked.ASKED, "0", {"error": asked.Asked(0.1, 10.0)})

    row = pretend([0.16, 0.04, 0.01])

    assert row["pass"]
    assert not row["as_asked"]
    assert row["asked"] == {"tolerance": 0.1, "mesh": 10.0, "error": 0.16, "met_on": 20.0}
    assert row["judged"] == {"tolerance": 0.1, "mesh": 40.0}
    assert row["reason"] == "order 2: asks for 12.6"
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

    assert len({(m["name"], m["file"]) for m in mutants}) == len(mutants) >= 190
    for mutant in mutants:
        text = (ROOT / mutant["file"]).read_text(encoding="utf-8")
        assert text.count(mutant["original"]) == 1, mutant["name"]
        assert mutant["file"] in tests
    for named in tests.values():
        assert all(t[6:] in QUICK if t.startswith("suite:") else (ROOT / t).exists() for t in named)
