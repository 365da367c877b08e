"""Findings after a back-analysis: bounds, reversed polarity, improbable model error."""

import json
from pathlib import Path

import numpy as np
import pytest
from inversion_project import PARAMETERS, noisy

from pyblast import back_analyse, load_project
from pyblast.back_analysis.findings import findings_of_fit
from pyblast.back_analysis.search import make_target
from pyblast.workflows.back_analysis import RESULT


def codes(result):
    return {finding.code: finding for finding in findings_of_fit(result)}


@pytest.fixture(scope="module")
def reversed_record(tmp_path_factory):
    """Back-analyse a record whose vertical component has reversed polarity."""
    path = noisy(tmp_path_factory.mktemp("reversed"))
    table = np.loadtxt(path.with_name("wall.csv"), delimiter=",", skiprows=1)
    head, *_, low_pass = path.with_name("wall.csv").read_text().splitlines()
    table[:, 3] *= -1.0
    texts = {"header": head, "footer": low_pass, "comments": ""}
    np.savetxt(path.with_name("wall.csv"), table, "%.17g", ",", **texts)
    return back_analyse(path)


@pytest.mark.long
def test_a_fit_to_good_records_has_no_finding(tmp_path):
    result, _ = back_analyse(noisy(tmp_path))

    assert codes(result) == {}


@pytest.mark.long
def test_reversed_polarity_is_a_finding(reversed_record):
    result, folder = reversed_record
    findings = codes(result)

    assert list(findings["D33"].numbers) == ["project.toml, R1, vertical"]
    assert findings["D33"].numbers["project.toml, R1, vertical"] < -0.7
    assert "D33" in {one["code"] for one in json.loads((folder / RESULT).read_text())["findings"]}
    assert (
        "A component has the opposite sign of the simulation"
        in (folder / "report.html").read_text()
    )


def test_a_model_that_lacks_something_is_said_and_no_value_is_called_well_constrained(
    reversed_record,
):
    result, folder = reversed_record
    lack = codes(result)["D44"]
    page = (folder / "report.html").read_text()

    assert result.fit.posterior.level > 0.01
    assert "pyblast diagnose project.toml" in lack.text
    assert ("hardly more" in lack.text) == (result.fit.posterior.level < 0.015)
    assert "The model lacks something" in page
    assert not any(result.constraint(n) == "well" for n in range(len(PARAMETERS)))
    assert ">well<" not in page


@pytest.mark.long
def test_a_value_at_a_bound_is_a_finding(tmp_path):
    path = noisy(tmp_path)
    ks = PARAMETERS[1]
    path.write_text(path.read_text().replace(f"low = {ks.low}\nhigh = {ks.high}",
                                             "low = 0.05\nhigh = 0.1"))  # fmt: skip

    findings = codes(back_analyse(path)[0])

    assert ks.name in findings["D31"].text
    assert "at the low bound, 0.05" in findings["D31"].text
    assert "only where such a value is possible" in findings["D31"].text


@pytest.mark.long
def test_a_record_without_one_component_is_searched(tmp_path):
    path = noisy(tmp_path)
    rows = [line.split(",") for line in path.with_name("wall.csv").read_text().splitlines()]
    path.with_name("wall.csv").write_text("\n".join(",".join(row[:3]) for row in rows) + "\n")

    result, _ = back_analyse(path)

    (record,) = result.confirmed["project.toml"].recorded.values()
    assert list(record.present) == [True, True, False]
    assert max(list(result.fit.ratios().values())[:2]) < 0.5
    assert codes(result) == {}


def test_the_example_has_its_records():
    examples = Path(__file__).parents[2] / "examples"

    target = make_target(load_project(examples / "fault_from_records" / "project.toml"))

    assert target.records.receivers == ("front", "back", "house")
    assert len(target.parameters) == 3
