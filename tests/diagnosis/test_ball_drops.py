"""The example of real records: what its command reads, and what its trials say."""

import json
import sys
from pathlib import Path

import numpy as np

EXAMPLE = Path(__file__).parents[2] / "examples" / "ball_drops"
sys.path.insert(0, str(EXAMPLE))

from judge import compared  # noqa: E402
from survey import members, read_survey, reference_project  # noqa: E402
from trials import drawn  # noqa: E402


def test_all_records_are_read_in_volts_and_begin_after_the_impact():
    survey = read_survey()
    records = compared(survey)

    assert len(survey.drops) == 106
    assert len(set(survey.drops)) == 18
    assert len(set(survey.sensors)) == 32
    assert 1.0 < np.abs(survey.samples).max() < 10.0
    quiet = records.window((-3e-5, -1e-5))
    loud = records.window((0.0, 5e-5))
    energy = [np.sum(w * records.samples**2, axis=1) for w in (quiet, loud)]
    assert np.median(energy[0] / np.maximum(energy[1], 1e-300)) < 1e-2


def test_the_reference_is_the_block_as_published_and_every_other_member_differs():
    known = members(reference_project())
    tables = {
        name: (p.config.mesh.model_dump_json(), p.config.boundaries.model_dump_json(),
               tuple(tuple(j.properties.items()) for j in p.joints))
        for name, (_, p) in known.items()
    }  # fmt: skip

    assert next(iter(known)) == "reference"
    assert len(set(tables.values())) == len(known)


def test_trials_are_those_that_were_drawn():
    rows = {row["trial"]: row for row in json.loads((EXAMPLE / "trials.json").read_text())["rows"]}
    by_number = {row["trial"]: row for row in drawn()}

    assert all(row["seed"] == by_number[number]["seed"] for number, row in rows.items())
    assert all(row["concealed"] == (row["kind"] != "null") for row in rows.values())


def test_no_file_of_the_example_names_the_published_answer():
    assert not [path for path in EXAMPLE.rglob("*") if path.name == "truth"]
    for path in EXAMPLE.glob("*.py"):
        assert "truth/" not in path.read_text()
