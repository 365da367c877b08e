"""Annealing: the paper's schedule, the Metropolis rule as statistics, bounds and seeds."""

import math

import numpy as np
import pytest

from pyblast.inference.global_search import PAPER, Schedule, accepts, anneal, paper, paper_eq15
from pyblast.inference.parameter import Problem


def bowl(points):
    return 100.0 * np.mean(np.abs(points - 0.3), axis=1)


def problem(evaluate=bowl, n=3):
    return Problem(np.zeros(n), np.ones(n), np.zeros(n, dtype=bool), evaluate)


def test_the_twentieth_temperature_and_step_are_those_of_the_paper():
    assert PAPER.temperature_of(20) == pytest.approx(121.6, abs=0.05)
    assert PAPER.step_of(20) == pytest.approx(0.0091, abs=0.00005)


@pytest.mark.parametrize("ratio", [0.1, 0.5, 1.0, 3.0])
def test_rises_are_accepted_as_often_as_the_rule_of_metropolis_says(ratio):
    draws = np.random.default_rng(1).random(20_000)
    wanted = math.exp(-ratio)

    found = np.mean([accepts(10.0 * ratio, 10.0, draw) for draw in draws])

    spread = math.sqrt(wanted * (1.0 - wanted) / len(draws))
    assert found == pytest.approx(wanted, abs=4.0 * spread)


def test_a_walk_accepts_rises_as_often_as_the_rule_says():
    step = problem(lambda points: np.where(points[:, 0] > 0.5, 7.0, 0.0), n=1)

    trace = anneal(step, 6000, np.random.default_rng(5), Schedule(10.0, 1.0, 1.0, 1.0))

    rows = np.maximum.accumulate(np.where(trace.accepted, np.arange(6000), 0))
    rise = trace.misfits[1:] - trace.misfits[rows[:-1]]
    taken = trace.accepted[1:][rise > 0.0]
    wanted = math.exp(-0.7)
    assert taken.mean() == pytest.approx(
        wanted, abs=4.0 * math.sqrt(wanted * (1.0 - wanted) / len(taken))
    )
    assert trace.accepted[1:][rise <= 0.0].all()


def test_falls_and_steps_between_points_without_misfit_are_always_taken():
    assert accepts(-1e-9, 1.0, 1.0 - 1e-16)
    assert accepts(math.inf - math.inf, 1.0, 0.5)
    assert not accepts(math.inf, 1.0, 0.0)


def test_a_walk_begins_at_the_centre_and_stays_within_steps_and_bounds():
    trace = paper(problem(), 21, 7)

    assert trace.points[0].tolist() == [0.5] * 3
    assert trace.accepted[0]
    assert (trace.points >= 0.0).all()
    assert (trace.points <= 1.0).all()
    rows = np.maximum.accumulate(np.where(trace.accepted, np.arange(21), 0))
    moved = np.abs(trace.points[1:] - trace.points[rows[:-1]]).max(axis=1)
    assert (moved <= PAPER.step_of(np.arange(1, 21)) + 1e-15).all()


@pytest.mark.parametrize("method", [paper, paper_eq15])
def test_the_same_seed_gives_the_same_trace_and_the_budget_is_kept(method):
    first, second, other = (
        method(problem(), 20, 3),
        method(problem(), 20, 3),
        method(problem(), 20, 4),
    )

    assert len(first.misfits) == 20
    assert np.array_equal(first.points, second.points)
    assert not np.array_equal(first.points, other.points)


def test_the_temperature_of_1000_rejects_hardly_any_rise_of_misfits_below_100():
    traces = [paper(problem(), 21, seed) for seed in range(50)]

    assert np.mean([trace.accepted for trace in traces]) > 0.97


def test_the_temperature_of_equation_15_rejects_more():
    settings = {"temperature_of_1000": paper, "equation_15": paper_eq15}
    kept = {
        name: np.mean([method(problem(), 21, seed).accepted[6:] for seed in range(50)])
        for name, method in settings.items()
    }

    assert kept["equation_15"] < kept["temperature_of_1000"] - 0.02
