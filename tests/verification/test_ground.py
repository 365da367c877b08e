"""Random legitimate grounds are built as asked and turn with their file; all: `./dev ground`."""

from dataclasses import replace

import numpy as np
import pytest

from verification import ground
from verification.ground import SEED, TURNS, project_of, tables_of, turned, wrong_ground
from verification.rows import read_rows

FAST = (0, 1, 5, 6, 10, 11, 13, 17, 19, 22)  # of the seed, without tetrahedra
OPEN = 6  # whose sides are all open
LONG = [n for n in range(40) if n not in FAST]


@pytest.mark.parametrize(
    "number", [*FAST, *(pytest.param(n, marks=pytest.mark.long) for n in LONG)]
)
def test_a_random_ground_is_built_as_its_file_asks(number):
    row = ground.geometry_row(SEED, number)

    assert "refused" not in row
    assert row.get("wrong", []) == []


@pytest.mark.parametrize("how", TURNS[:-1])
def test_a_ground_that_is_turned_has_the_same_records_turned(how):
    row = ground.turned_row(SEED, 1, how)

    assert row["elements"][0].startswith("hexahedra")
    assert row["energy_of_difference"] < 1e-12


@pytest.mark.long
def test_a_ground_that_is_turned_out_of_its_grid_has_the_same_records_within_its_errors():
    row = ground.turned_row(SEED, OPEN, TURNS[-1])

    assert row["elements"][1].startswith("hexahedra")
    assert row["within"]


def test_hexahedra_and_tetrahedra_agree_within_their_stated_errors():
    row = ground.pair_row(SEED, 0)

    assert row["receivers"] > 2
    assert row["within"]
    assert row["finer_difference"] < 0.01


def test_four_quarters_are_no_turn():
    tables = tables_of(SEED, 6)
    other = tables
    for _ in range(4):
        other, _ = turned(other, "quarter")

    assert other["boundaries"] == tables["boundaries"]
    for part, same in zip(other["mesh"]["faults"], tables["mesh"]["faults"], strict=True):
        assert part["through_m"] == pytest.approx(same["through_m"])
        assert part["dip_direction_deg"] == pytest.approx(same["dip_direction_deg"])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda x: x * [1.05, 1.0, 1.0], "from its plane"),
        (lambda x: x - [0.0, 0.0, 6.0], "the top is 6.00 m off"),
        (lambda x: x + [0.0, 0.0, 0.1] * x[:, :1], "the top is"),
    ],
)
def test_a_ground_that_was_moved_is_judged_wrong(tmp_path, change, words):
    tables = tables_of(SEED, 1)
    mesh = project_of(tables, tmp_path).meshed.mesh
    moved = replace(mesh, points=change(mesh.points), places=None)

    wrong = wrong_ground(tables, moved, np.random.default_rng(0))

    assert any(words in text for text in wrong)


def test_a_plane_that_is_missing_is_judged_wrong(tmp_path):
    tables = tables_of(SEED, 1)
    mesh = project_of(tables, tmp_path).meshed.mesh
    name = tables["mesh"]["faults"][0]["name"]
    half = {**mesh.surfaces, name: mesh.surfaces[name][::2]}

    wrong = wrong_ground(tables, replace(mesh, surfaces=half), np.random.default_rng(0))

    assert any(text.startswith(f"{name} lacks") for text in wrong)


def test_the_page_shows_the_summary_of_the_rows():
    rows = read_rows(ground.OUT)
    own = {name: row for name, row in rows.items() if name != "summary"}

    found = ground.summary(SEED, own)
    page = ground.paged(ground.PAGE.read_text(), found)

    assert found["projects"] >= 300
    assert found["wrong"] == 0
    assert f"| projects of seed 2026 | {found['projects']} |" in page
    assert ground.paged(page, found) == page
