"""Doubts about found values: a bound, a turned component, errors too large to be small."""

import json
from pathlib import Path

import numpy as np
import pytest
from inversion_project import PARAMETERS, noisy

from pyblast import back_analyse, load_project
from pyblast.back_analysis.findings import fit_doubts
from pyblast.back_analysis.search import make_target
from pyblast.workflows.back_analysis import RESULT


def codes(found):
    return {one.code: one for one in fit_doubts(found)}


@pytest.fixture(scope="module")
def turned(tmp_path_factory):
    """Search with a record whose first component was wired the other way round."""
    path = noisy(tmp_path_factory.mktemp("turned"))
    table = np.loadtxt(path.with_name("wall.csv"), delimiter=",", skiprows=1)
    head = path.with_name("wall.csv").read_text().splitlines()[0]
    table[:, 1] *= -1.0
    np.savetxt(path.with_name("wall.csv"), table, "%.17g", ",", header=head, comments="")
    return back_analyse(path)


def test_a_fit_to_good_records_is_not_doubted(tmp_path):
    found, _ = back_analyse(noisy(tmp_path))

    assert codes(found) == {}


def test_a_turned_component_is_told(turned):
    found, folder = turned
    told = codes(found)

    assert list(told["D33"].numbers) == ["project.toml, R1, longitudinal"]
    assert told["D33"].numbers["project.toml, R1, longitudinal"] < -0.7
    assert "D33" in {one["code"] for one in json.loads((folder / RESULT).read_text())["findings"]}
    assert "A component runs against the simulation" in (folder / "report.html").read_text()


def test_errors_that_let_it_fit_are_told_with_their_size(turned):
    told = codes(turned[0])

    assert max(told["D32"].numbers.values()) > 3.7  # of a hundred levels one is larger


def test_a_value_at_a_bound_is_told(tmp_path):
    path = noisy(tmp_path)
    ks = PARAMETERS[1]
    path.write_text(path.read_text().replace(f"low = {ks.low}\nhigh = {ks.high}",
                                             "low = 0.05\nhigh = 0.1"))  # fmt: skip

    told = codes(back_analyse(path)[0])

    assert ks.name in told["D31"].text
    assert "at the low one, 0.05" in told["D31"].text


def test_a_record_without_one_component_is_searched(tmp_path):
    path = noisy(tmp_path)
    rows = [line.split(",") for line in path.with_name("wall.csv").read_text().splitlines()]
    path.with_name("wall.csv").write_text("\n".join(",".join(row[:3]) for row in rows) + "\n")

    found, _ = back_analyse(path)

    (record,) = found.confirmed["project.toml"].recorded.values()
    assert list(record.present) == [True, True, False]
    assert np.all(found.plan.knowledge.shares[:2] < 0.5)  # noise that is one of two was not a noise
    assert codes(found) == {}


def test_the_example_has_its_records():
    examples = Path(__file__).parents[2] / "examples"

    target = make_target(load_project(examples / "fault_from_records" / "project.toml"))

    assert target.waveforms.records.receivers == ("front", "back", "house")
    assert len(target.parameters) == 3
