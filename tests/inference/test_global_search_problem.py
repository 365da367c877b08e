"""The border between searches and evaluations: bounds and scales."""

import numpy as np
import pytest

from pyblast.errors import InputError
from pyblast.inference.parameter import Problem, Trace


def problem(low=(1.0, 0.01), high=(3.0, 1.0), log=(False, True)):
    return Problem(low, high, log, lambda points: np.sum(points, axis=1))


def test_the_middle_of_a_logarithmic_range_is_its_geometric_mean():
    assert problem().points([0.5, 0.5]) == pytest.approx([2.0, 0.1], rel=1e-14)


def test_corners_of_the_unit_cube_are_the_bounds_to_the_bit():
    assert problem().points([[0.0, 0.0], [1.0, 1.0]]).tolist() == [[1.0, 0.01], [3.0, 1.0]]


def test_places_outside_the_unit_cube_are_clipped_at_the_bounds():
    assert problem().points([-0.5, 1.5]).tolist() == [1.0, 1.0]


def test_unit_and_points_undo_one_another():
    unit = np.random.default_rng(3).random((20, 2))

    assert problem().unit(problem().points(unit)) == pytest.approx(unit, abs=1e-14)


def test_bounds_in_the_wrong_order_are_refused():
    with pytest.raises(InputError, match="must be below high"):
        problem(low=(3.0, 0.01))


def test_a_logarithmic_range_must_be_positive():
    with pytest.raises(InputError, match="must be positive where log is set"):
        problem(low=(1.0, 0.0))


def test_the_best_of_a_trace_is_its_first_lowest_misfit():
    trace = Trace(np.zeros((4, 1)), np.array([3.0, 1.0, 2.0, 1.0]), np.ones(4, bool))

    assert trace.best == 1
