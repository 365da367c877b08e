"""Every search: counted, repeatable, within bounds, and better than chance where it learns."""

from dataclasses import replace

import numpy as np
import pytest

from pyblast.errors import InputError
from pyblast.inference.gauss_newton import levenberg_search
from pyblast.inference.global_search import random_search
from pyblast.inference.parameter import Evaluations, Problem, Spent

ALL = [random_search, levenberg_search]
EACH = pytest.mark.parametrize("search", ALL)
LOWEST = np.array([0.2, 0.4, 0.6, 0.7])
STEEPNESS = np.array([1.0, 1.7, 2.3, 3.0])
RANGES = np.array([[1e7, 1e9], [0.005, 0.05], [-3.0, 5.0], [1e6, 1e8]])
LOG = np.array([True, True, False, True])


def problem(residuals, n, low=0.0, high=1.0, log=False):
    """Return a problem whose misfit is the sum of squares of some residuals."""

    def vectors(points):
        found = residuals(points)
        return np.sum(found**2, axis=1), found

    bounds = (np.broadcast_to(value, n) for value in (low, high, log))
    return Problem(*bounds, lambda points: vectors(points)[0], vectors)


def bowl(asked=None):
    def residuals(points):
        if asked is not None:
            asked.append(points)
        return STEEPNESS * (points - LOWEST)

    return problem(residuals, 4)


def stretched_bowl(factor=1.0):
    """Return the bowl over ranges with units, logarithmic or not, its misfit times a factor."""
    low, high = RANGES.T
    unit = Problem(low, high, LOG, None).unit

    return problem(
        lambda points: np.sqrt(factor) * STEEPNESS * (unit(points) - LOWEST), 4, low, high, LOG
    )


def valley():
    return problem(
        lambda p: np.stack([10.0 * (p[:, 1] - p[:, 0] ** 2), 1.0 - p[:, 0]], axis=1), 2, -2.0, 2.0
    )


def found(search, made, budget, seeds=range(5)):
    """Return the median over seeds of the best misfit."""
    return np.median([search(made(), budget, seed).misfits.min() for seed in seeds])


@EACH
@pytest.mark.parametrize("budget", [1, 7, 20, 61])
def test_a_search_asks_for_its_budget_exactly(search, budget):
    asked = []

    trace = search(bowl(asked), budget, 3)

    assert sum(map(len, asked)) == len(trace.misfits) == budget


@EACH
def test_a_trace_holds_what_was_asked_for_in_its_order(search):
    asked = []

    trace = search(bowl(asked), 40, 5)

    assert np.array_equal(trace.points, np.concatenate(asked))
    assert np.array_equal(trace.misfits, bowl().evaluate(trace.points))


@EACH
def test_the_same_seed_gives_the_same_bits(search):
    one, other = (search(bowl(), 60, 11) for _ in range(2))

    assert np.array_equal(one.points, other.points)
    assert np.array_equal(one.accepted, other.accepted)


@pytest.mark.parametrize("search", [s for s in ALL if s is not levenberg_search])
def test_another_seed_gives_another_trace(search):
    assert not np.array_equal(search(bowl(), 30, 1).points, search(bowl(), 30, 2).points)


@EACH
def test_a_smaller_budget_gives_the_beginning_of_the_trace(search):
    assert np.array_equal(search(bowl(), 37, 4).points, search(bowl(), 60, 4).points[:37])


@EACH
def test_no_search_leaves_bounds_that_the_misfit_pulls_beyond(search):
    pulled = problem(lambda points: STEEPNESS * (points - [-0.5, 1.5, 0.5, 3.0]), 4)

    points = search(pulled, 80, 2).points

    assert points.min() >= 0.0
    assert points.max() <= 1.0


@EACH
def test_units_and_logarithms_of_ranges_change_nothing(search):
    plain, scaled = search(bowl(), 60, 6), search(stretched_bowl(), 60, 6)

    unit = stretched_bowl().unit(scaled.points)
    assert unit[:30] == pytest.approx(plain.points[:30], abs=1e-6)


@EACH
def test_the_unit_of_the_misfit_changes_nothing(search):
    plain, scaled = (search(stretched_bowl(factor), 80, 6) for factor in (1.0, 2.0**20))

    assert np.array_equal(plain.points, scaled.points)


@pytest.mark.parametrize("search", [levenberg_search])
def test_every_search_that_learns_beats_random_search_on_a_bowl(search):
    assert found(search, bowl, 100) < 0.5 * found(random_search, bowl, 100)


def test_a_search_reaches_the_bottom_of_a_bowl():
    assert found(levenberg_search, bowl, 150) < 1e-15  # random: 0.11


def test_a_search_follows_a_bent_valley():
    assert found(levenberg_search, valley, 200) < 1e-8  # random: 0.2


@pytest.mark.parametrize("search", [levenberg_search])
def test_a_search_with_steps_says_which_points_it_went_on_from(search):
    trace = search(bowl(), 60, 0)

    assert trace.accepted[trace.best]
    assert 0.05 < trace.accepted.mean() < 0.9


@EACH
def test_points_that_cannot_be_evaluated_do_not_stop_a_search(search):
    def residuals(points):
        outside = points[:, :1] > 0.55
        return np.where(outside, np.inf, STEEPNESS * (points - LOWEST))

    trace = search(problem(residuals, 4), 80, 1)

    assert len(trace.misfits) == 80
    assert np.isfinite(trace.misfits.min())


@EACH
def test_a_search_without_any_evaluation_is_refused(search):
    with pytest.raises(InputError, match="at least 1"):
        search(bowl(), 0, 0)


def test_gauss_newton_needs_residuals():
    with pytest.raises(InputError, match="a misfit that has residuals"):
        levenberg_search(replace(bowl(), vectors=None), 20, 0)


def test_what_the_budget_still_allows_is_evaluated_before_a_search_ends():
    kept = Evaluations(bowl(), 5)

    with pytest.raises(Spent):
        kept.at(np.full((8, 4), 0.5))
    assert len(kept.trace().misfits) == 5
