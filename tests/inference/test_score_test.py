"""Score test: closed form of a Gaussian, units, levels, false alarms, what nuisances take up."""

import numpy as np
import pytest
from residual_case import residual_case
from scipy import linalg, stats
from scipy.integrate import quad

from pyblast.inference.covariance import record_blocks
from pyblast.inference.nuisances import Nuisances, shift_columns, transfer_columns
from pyblast.inference.records import Noise, Records
from pyblast.inference.score_test import (
    AveragedError,
    Change,
    ErrorLevels,
    ScoreTest,
    detected_strength,
    draws,
)

SINGLE = ErrorLevels((1e-3,), (4e-3,), (1.0,))
PRIORS = {"trigger": 1e-4, "clock": 1e-4, "receiver": 0.3}


def problem_in(unit=1.0):
    """Return motion, covariance, nuisances and band, with velocities in another unit."""
    noise, band, motion = residual_case()
    noise = Noise(
        noise.step, noise.coefficients, unit**2 * noise.variance, noise.correlation,
        noise.inflation, noise.resolved,
    )  # fmt: skip
    motion = unit * motion
    valid = np.ones(motion.shape, dtype=bool)
    records = Records(("a", "b"), ("R1", "R2", "R3"), band.dt, motion, valid, band, noise)
    nuisances = shift_columns(motion, np.zeros((2, *motion.shape)), band, PRIORS)
    return motion, record_blocks(records, motion), nuisances + transfer_columns(motion, band), band


def changes_of(motion, band):
    """Return two changes: a stretch that grows with time, and the same in the second blast only."""
    late = np.arange(motion.shape[-1]) * np.gradient(motion, axis=-1)
    stretched = 0.02 * band.project(late)
    second = stretched * np.array([0.0, 1.0])[:, None, None, None]
    return Change(stretched[None], True), Change(np.stack([stretched, second]))


def dense(blocks, nuisances, level=SINGLE):
    """Return the covariance of all data at the only level of a grid, written out."""
    n, size = blocks.scatter.shape[-1], blocks.noise.shape[-1]
    total = blocks.noise.copy()
    for c in range(3):
        each = slice(c * n, (c + 1) * n)
        total[..., each, each] += level.scatter[0] * blocks.scatter[:, :, c]
    scale = [np.sqrt(level.transfer[0]) if g == "transfer" else 1.0 for g in nuisances.groups]
    columns = nuisances.columns.reshape(len(scale), -1) * np.array(scale)[:, None]
    return linalg.block_diag(*total.reshape(-1, size, size)) + columns.T @ columns


@pytest.fixture(scope="module")
def problem():
    return problem_in()


def test_log_bayes_factor_is_that_of_two_gaussians_written_out(problem):
    motion, blocks, nuisances, band = problem
    _, pair = changes_of(motion, band)
    residual = 0.7 * pair.shapes[0] - 0.2 * pair.shapes[1]
    residual = residual + 0.01 * band.project(np.roll(motion, 5, axis=-1))

    scores = ScoreTest(AveragedError(blocks, nuisances, SINGLE), [pair])(residual[None])

    without, shapes = dense(blocks, nuisances), pair.shapes.reshape(2, -1)
    density = [
        stats.multivariate_normal.logpdf(residual.ravel(), cov=covariance)
        for covariance in (without, without + shapes.T @ shapes)
    ]
    assert scores.log_bayes[0, 0] == pytest.approx(density[1] - density[0], rel=1e-6)


def test_a_strength_that_must_be_positive_has_twice_its_prior_there(problem):
    motion, blocks, nuisances, band = problem
    change, _ = changes_of(motion, band)
    small = Change(0.05 * change.shapes, True)
    residual = -1.2 * small.shapes

    scores = ScoreTest(AveragedError(blocks, nuisances, SINGLE), [small])(residual)

    length = scores.length[0][0, 0]
    ratio = quad(
        lambda c: np.exp(-1.2 * c * length - 0.5 * c**2 * (1.0 + length)), 0.0, 10.0
    )[0]  # fmt: skip
    assert scores.log_bayes[0, 0] == pytest.approx(np.log(2.0 * ratio / np.sqrt(2.0 * np.pi)))
    assert scores.log_bayes[0, 0] < 0.0


def test_scores_do_not_depend_on_the_unit_of_velocity(problem):
    results = []
    for motion, blocks, nuisances, band in (problem, problem_in(1000.0)):
        test = ScoreTest(AveragedError(blocks, nuisances), changes_of(motion, band))
        results.append(test(0.1 * band.project(np.roll(motion, 3, axis=-1))[None]))

    assert results[1].log_bayes == pytest.approx(results[0].log_bayes, rel=1e-6)


def test_levels_are_averaged_by_their_evidence(problem):
    motion, blocks, nuisances, band = problem
    residual = 0.1 * band.project(np.roll(motion, 4, axis=-1))[None]
    grid = ErrorLevels((1e-3, 2e-2), (4e-3,), (1.0,))

    together = ScoreTest(AveragedError(blocks, nuisances, grid), changes_of(motion, band))(residual)

    each = [
        ScoreTest(
            AveragedError(blocks, nuisances, ErrorLevels((s,), *grid[1:])), changes_of(motion, band)
        )(residual)
        for s in grid.scatter
    ]
    evidence = [one.log_evidence[0] for one in each]
    assert together.log_evidence[0] == pytest.approx(np.logaddexp(*evidence) - np.log(2.0))
    joint = [one.log_evidence[0] + one.log_bayes[0, 0] for one in each]
    assert together.log_bayes[0, 0] == pytest.approx(np.logaddexp(*joint) - np.logaddexp(*evidence))


def test_a_transfer_error_that_blasts_share_hides_no_difference_between_them(problem):
    _, blocks, nuisances, _ = problem
    spectrum = next(
        column for column, group in zip(nuisances.columns, nuisances.groups, strict=True)
        if group == "transfer"
    )  # fmt: skip
    alone = spectrum * np.array([-1.0, 1.0])[:, None, None, None]
    free = Nuisances(
        nuisances.columns[[g != "transfer" for g in nuisances.groups]],
        tuple(g for g in nuisances.groups if g != "transfer"),
    )

    def length(change, columns):
        error = AveragedError(blocks, columns, ErrorLevels((1e-3,), (0.1,), (1.0,)))
        return ScoreTest(error, [Change(change[None])])(0.0 * change[None]).length[0][0, 0]

    assert length(spectrum, nuisances) < 0.1 * length(spectrum, free)
    assert length(alone, nuisances) > 0.5 * length(alone, free)


def test_draws_without_an_effect_exceed_a_log_bayes_factor_as_rarely_as_it_says(problem):
    motion, blocks, nuisances, band = problem
    test = ScoreTest(AveragedError(blocks, nuisances, SINGLE), changes_of(motion, band))
    drawn = draws(np.random.default_rng(3), blocks, nuisances, (1e-3, 4e-3, 1.0), 400)

    scores = test(drawn)

    # Markov: the mean of a Bayes factor without an effect is one.
    assert np.mean(scores.log_bayes > np.log(20.0)) < 0.05
    size = dense(blocks, nuisances).shape[0]
    square = -2.0 * scores.log_evidence
    assert np.ptp(square) > 0.0
    assert np.var(square) == pytest.approx(2.0 * size, rel=0.25)


def test_a_change_is_detected_at_the_strength_that_is_stated_in_nine_of_ten_cases(problem):
    motion, blocks, nuisances, band = problem
    change, _ = changes_of(motion, band)
    change = Change(0.1 * change.shapes, True)
    test = ScoreTest(AveragedError(blocks, nuisances, SINGLE), [change])
    drawn = draws(np.random.default_rng(5), blocks, nuisances, (1e-3, 4e-3, 1.0), 400)
    length = test(drawn).length[0][0, 0]

    strength = detected_strength(length, 10.0)
    scores = test(drawn + strength * change.shapes)

    assert np.mean(scores.log_bayes[0] > 10.0) == pytest.approx(0.9, abs=0.05)


def test_without_changes_the_evidence_is_that_of_the_error(problem):
    motion, blocks, nuisances, band = problem
    residual = 0.1 * band.project(np.roll(motion, 4, axis=-1))[None]
    error = AveragedError(blocks, nuisances, SINGLE)

    scores = ScoreTest(error)(residual)

    beside = ScoreTest(error, changes_of(motion, band))(residual)
    assert scores.log_bayes.shape == (0, 1)
    assert scores.log_evidence == pytest.approx(beside.log_evidence)
