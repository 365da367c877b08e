"""The quick part of the suite, and how cases are judged."""

import json
from pathlib import Path

import numpy as np
import pytest

from verification import __main__ as main
from verification.__main__ import register_all, run_case
from verification.page import by_number
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
