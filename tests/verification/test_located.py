"""The study of hidden bodies draws the same ones again, and counts what it says."""

import numpy as np

from verification.located import CHANGES, ROWS, drawn, table

ROW = {"energy_percent": 1.0, "rank_percent": 1.5, "away_m": 12.0, "within_m": 20.0, "score": 80.0,
       "cs_percent": -20.0}  # fmt: skip


def test_a_row_is_the_same_body_whenever_it_is_drawn_and_no_other_row_is():
    places = np.array([drawn(name)[1] for name in ROWS])
    np.testing.assert_array_equal(places, [drawn(name)[1] for name in ROWS])
    assert len(np.unique(places, axis=0)) == len(ROWS) == 6 * len(CHANGES)


def test_a_body_that_is_said_too_narrowly_does_not_count():
    rows = {"soft 1": ROW, "stiff 1": ROW | {"away_m": 30.0, "rank_percent": 9.0}}
    assert table(rows)[-1].startswith("1 of 2 in the top 2 % of the volume, 1 within")
