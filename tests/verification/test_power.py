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
    class Scores:
        threshold = 10.0

    labels, values = ["slip", "closure"], np.array([[40.0, 40.0, 8.0], [10.0, 38.0, 1.0]])
    three = [*labels, "layer"], np.vstack([values, np.zeros(3)])

    assert power._named(Scores(), labels, values) == ["slip", "", None]
    without = power._named(Scores(), *power._without(*three, "slip"))
    assert without == ["closure", "closure", None]


def test_a_veto_takes_wrong_names_of_what_sources_anywhere_explain_better():
    known = ["slip", "closure"], np.array([[60.0, 60.0], [20.0, 20.0]])
    places = np.array([90.0, 190.0]), np.array([25.0, 50.0])
    true, named, others = np.array([58.0, 58.0]), ["slip", "slip"], ["closure", "closure"]

    left = power._after_vetoes(places, known, true, named, others, "slip")

    assert left["right_asked"] == 2
    assert left["cost_of_open_set"] == left["cost_of_body"] == 0.0
    assert left["wrong_without_after_vetoes"] == 0.5
    assert left["these_names"] == {"closure": 1}
