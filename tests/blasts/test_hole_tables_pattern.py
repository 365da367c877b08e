"""Hole tables tell the pattern of a blast: measured firing times, burden, stemming, rows, face."""

import numpy as np
import pytest

from pyblast.blasts.hole_effects import Pattern
from pyblast.blasts.hole_tables import read_blast

PLACES = "Hole ID,X,Y,Z,Toe X,Toe Y,Toe Z,Charge (kg),Delay (ms)"
HOLES = [f"{n},{5 * n},0,0,{5 * n},0,-10,80,{17 * n}" for n in range(3)]


def table(tmp_path, titles, *cells):
    """Return the blast of a table with further columns."""
    lines = [f"{PLACES},{titles}", *(f"{a},{b}" for a, b in zip(HOLES, cells, strict=True))]
    path = tmp_path / "holes.csv"
    path.write_text("\n".join(lines), encoding="utf-8")
    return read_blast(path)


@pytest.mark.parametrize("title", ["Measured Time (ms)", "Actual firing time", "fired_ms"])
def test_measured_times_count_from_the_first_planned_one(tmp_path, title):
    blast = table(tmp_path, title, 1203.0, 1221.5, "")

    np.testing.assert_allclose(blast.times, [0.0, 0.0185, 0.034])
    np.testing.assert_allclose(blast.planned, [0.0, 0.017, 0.034])
    assert any("measured ones of 2 of 3 holes" in note for note in blast.notes)


def test_the_pattern_is_read_where_the_table_has_it(tmp_path):
    titles = "Burden (m),Stemming Length (m),Row,Choked,Face bearing"
    cells = "4,3.5,10,yes,180", "4.2,,10,yes,180", "4,3.1,20,yes,180"
    blast = table(tmp_path, titles, *cells)

    np.testing.assert_allclose(blast.burden, [4.0, 4.2, 4.0])
    np.testing.assert_allclose(blast.stemming, [3.5, np.nan, 3.1])
    np.testing.assert_array_equal(blast.row, [0.0, 0.0, 1.0])
    assert blast.choked
    assert blast.face == pytest.approx(np.pi)
    assert not any("Not in the table" in note for note in blast.notes)


def test_what_the_table_lacks_is_derived_and_said(tmp_path):
    blast = table(tmp_path, "Burden (m)", 4.0, 4.0, 4.0)
    pattern = Pattern(blast, np.zeros((1, 3)))

    assert any("Not in the table: stemming, row, face" in note for note in blast.notes)
    assert pattern.burden == 4.0
    assert not blast.choked
    np.testing.assert_allclose(pattern.away, [1.0, 0.0], atol=1e-9)
