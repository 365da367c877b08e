"""Linear posterior: closed form of least squares, levels that are learned, what is held."""

import numpy as np
import pytest
from residual_case import residual_case
from scipy import linalg

from pyblast.inference.covariance import record_blocks
from pyblast.inference.nuisances import (
    Firings,
    Nuisances,
    hole_columns,
    random_slopes,
    shift_columns,
)
from pyblast.inference.posterior import NORMAL_95, Levels, linear
from pyblast.inference.records import Records

LEVELS = Levels((1e-3,), (1e-5,), (1e-5,), (1.0,))


def records_of(case, motion):
    noise, band, _ = case
    valid = np.ones(motion.shape, dtype=bool)
    return Records(("a", "b"), ("R1", "R2", "R3"), band.dt, motion, valid, band, noise)


def slopes_of(motion, band):
    """Three properties: late, loud, and another mix of the two."""
    late, loud = band.project(np.gradient(motion, band.dt, axis=-1)) * 1e-3, band.project(motion)
    return np.stack([late, loud, 0.5 * loud + np.roll(late, 1, axis=1)])


@pytest.fixture(scope="module")
def problem():
    case = residual_case()
    _, band, motion = case
    blocks = record_blocks(records_of(case, motion), motion)
    nuisances = shift_columns(
        motion, np.zeros((2, *motion.shape)), band,
        {"trigger": 1e-4, "clock": 1e-4, "receiver": 0.3},
    )  # fmt: skip
    return blocks, slopes_of(motion, band), nuisances


def dense(blocks):
    """Covariance of the errors of all records at `LEVELS`, written out."""
    n, size = blocks.scatter.shape[-1], blocks.noise.shape[-1]
    total = blocks.noise.copy()
    for c in range(3):
        each = slice(c * n, (c + 1) * n)
        total[..., each, each] += (
            1e-3 * blocks.scatter[:, :, c] + 1e-5 * (blocks.path + blocks.coda)[:, :, c]
        )
    return linalg.block_diag(*total.reshape(-1, size, size))


def test_mean_and_covariance_are_those_of_the_normal_equations(problem):
    blocks, slopes, nuisances = problem
    prior = np.array([0.3, 0.1, 0.2])
    residual = np.tensordot([0.2, -0.05, 0.1], slopes, 1)

    answer = linear(blocks, residual, slopes, prior, nuisances, LEVELS)

    columns = np.concatenate([slopes, nuisances.columns]).reshape(3 + len(nuisances.columns), -1)
    precise = linalg.inv(dense(blocks))
    own = np.diag(np.concatenate([prior**-2.0, np.ones(len(nuisances.columns))]))
    covariance = linalg.inv(columns @ precise @ columns.T + own)
    mean = covariance @ columns @ precise @ residual.ravel()
    assert answer.mean == pytest.approx(mean[:3], rel=1e-6)
    assert answer.covariance == pytest.approx(covariance[:3, :3], rel=1e-6)


def test_a_property_that_is_known_does_not_move(problem):
    blocks, slopes, nuisances = problem

    answer = linear(
        blocks, slopes[0] + slopes[1], slopes, np.array([0.3, 0.0, 0.2]), nuisances, LEVELS
    )

    assert answer.mean[1] == answer.covariance[1, 1] == answer.pulls[1] == 0.0


def test_knowing_a_held_property_takes_away_its_share_of_the_variance(problem):
    blocks, slopes, nuisances = problem
    prior = np.array([0.3, 0.1, 0.2])
    held, known = (
        linear(blocks, slopes[0], slopes, np.array([0.3, 0.1, third]), nuisances, LEVELS)
        for third in (prior[2], 0.0)
    )

    shares = held.shares_of_variance([0, 1], [2])[:, 0]

    left = np.diag(known.covariance)[:2] / np.diag(held.covariance)[:2]
    assert shares == pytest.approx(1.0 - left, rel=1e-6)


def test_a_held_property_that_is_wrong_and_taken_as_known_moves_values_by_the_shift(problem):
    blocks, slopes, nuisances = problem
    prior = np.array([0.3, 0.1, 0.2])
    held = linear(blocks, 0.0 * slopes[0], slopes, prior, nuisances, LEVELS)

    shift = held.shifts_if_held([0, 1], [2])[:, 0]

    # The truth lies one deviation off; the records show it, and the model takes it for known.
    wrong = linear(blocks, -0.2 * slopes[2], slopes, np.array([0.3, 0.1, 0.0]), nuisances, LEVELS)
    assert wrong.mean[:2] == pytest.approx(shift, rel=1e-6)


def test_intervals_hold_what_was_drawn_from_the_priors_nine_times_in_ten(problem):
    blocks, slopes, nuisances = problem
    rng, prior = np.random.default_rng(4), np.array([0.3, 0.1, 0.2])
    root = linalg.cholesky(dense(blocks), lower=True)
    inside = []
    for _ in range(100):
        truth = prior * rng.standard_normal(3)
        errors = root @ rng.standard_normal(len(root))
        moved = np.tensordot(rng.standard_normal(len(nuisances.columns)), nuisances.columns, 1)
        residual = np.tensordot(truth, slopes, 1) + moved + errors.reshape(moved.shape)
        answer = linear(blocks, residual, slopes, prior, nuisances, LEVELS)
        inside.append(np.abs(answer.mean - truth) < NORMAL_95 * answer.deviation)

    assert 0.84 < np.mean(inside) < 0.96  # 300 intervals


def test_learned_levels_tell_a_wrong_model_from_a_right_one(problem):
    blocks, slopes, nuisances = problem
    rng, prior = np.random.default_rng(2), np.array([0.3, 0.1, 0.2])
    root = linalg.cholesky(dense(blocks), lower=True)
    noise = (root @ rng.standard_normal(len(root))).reshape(slopes[0].shape)
    other = 0.5 * np.roll(slopes[1], 7, axis=-1)  # in no column

    right, wrong = (
        linear(blocks, part, slopes, prior, nuisances) for part in (noise, noise + other)
    )

    assert right.level < 0.005
    assert wrong.level > 0.03
    assert np.median(wrong.remaining) > 10.0 * np.median(right.remaining)


def test_columns_of_holes_add_up_to_the_delay_of_the_blast():
    _, band, motion = residual_case()
    fired = Firings(np.array([0.0, 0.024, 0.048]), np.array([1.0, 1.2, 0.9]), np.zeros((3, 3)))

    holes, _ = hole_columns(motion, [fired, None], band, 1e-3)

    late = band.project(-np.gradient(motion, band.dt, axis=-1))[0] * 1e-3
    both = holes.columns.sum(axis=0)[0]
    assert len(holes.columns) == 3
    assert np.sum((both - late) ** 2) < 0.05 * np.sum(late**2)  # the water level


def test_attenuation_takes_high_frequencies_and_is_counted_from_the_firing():
    _, band, motion = residual_case()

    _, lost = hole_columns(motion, [None, None], band, 1e-3)

    held = band.project(motion)
    assert np.all(np.sum(lost * held, axis=(1, 2, 3)) < 0.0)


def test_random_slopes_are_one_for_each_receiver_and_three_over_frequency():
    _, band, motion = residual_case()

    parts = random_slopes(motion[None], [0.1], band)

    assert parts.groups == ("ground",) * 6
    assert parts.columns[:3].sum(axis=0) == pytest.approx(0.1 * band.project(motion))
    assert isinstance(parts, Nuisances)
