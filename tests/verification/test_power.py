"""Power of the scores: the energy at which four of five draws are named."""

import numpy as np
import pytest

from verification import power


def test_the_energy_of_a_power_lies_between_the_tried_ones():
    rows = {0.01: 0.0, 0.04: 0.6, 0.16: 1.0, 0.64: 1.0}

    assert power._crossing(rows) == pytest.approx(0.04 * 4.0**0.5, rel=0.01)


@pytest.mark.parametrize(
    ("rows", "crossing"),
    [({0.1: 0.9, 0.4: 1.0}, 0.1), ({0.1: 0.0, 0.4: 0.7}, None), ({0.1: 0.9, 0.4: 0.5}, None)],
)
def test_a_power_that_is_always_or_never_reached_has_no_crossing_between(rows, crossing):
    assert power._crossing(rows) == crossing


def test_a_draw_is_named_above_the_threshold_and_with_a_lead():
    values = {"slip": np.array([40.0, 40.0, 8.0]), "closure": np.array([10.0, 38.0, 1.0])}

    class Scores:
        threshold = 10.0

        def log_bayes(self, residuals):
            return residuals

        def by_class(self, _):
            return values

    assert power._named(Scores(), None) == ["slip", "", None]
    values["layer"] = np.array([0.0, 0.0, 0.0])
    assert power._named(Scores(), None, without="slip") == ["closure", "closure", None]
