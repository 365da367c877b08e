"""Error model: closed forms of Gaussians, levels that are learned, scores, what is held."""

from dataclasses import replace

import numpy as np
import pytest
from residual_case import residual_case
from scipy import linalg, special, stats
from scipy.integrate import quad

from pyblast.back_analysis.fit import ALL_LEVELS
from pyblast.diagnosis.error import LEVELS
from pyblast.inference.covariance import record_blocks
from pyblast.inference.error_model import (
    NORMAL_95,
    Change,
    ErrorModel,
    Level,
    Levels,
)
from pyblast.inference.nuisances import Nuisances, law_columns, shift_columns, transfer_columns
from pyblast.inference.records import Noise, Records

AT = Level(1e-3, 1e-5)
SHARED = Level(1e-3, transfer=4e-3)  # with a transfer error that blasts share
FINE = Levels(tuple(10.0 ** np.arange(-5.0, 5.0)), transfer=(2e-3, 0.05), nuisance=(1.0, 2.0))
PRIORS = {"trigger": 1e-4, "clock": 1e-4, "receiver": 0.3}


def only(at):
    """Return the grid of one level."""
    return Levels(*((value,) for value in at))


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
    return motion, record_blocks(records, motion), nuisances, band


def slopes_of(motion, band):
    """Three properties: late, loud, and another mix of the two."""
    late, loud = band.project(np.gradient(motion, band.dt, axis=-1)) * 1e-3, band.project(motion)
    return np.stack([late, loud, 0.5 * loud + np.roll(late, 1, axis=1)])


def changes_of(motion, band):
    """Return two changes: a stretch that grows with time, and the same in the second blast only."""
    late = np.arange(motion.shape[-1]) * np.gradient(motion, axis=-1)
    stretched = 0.02 * band.project(late)
    second = stretched * np.array([0.0, 1.0])[:, None, None, None]
    return Change(stretched[None], True), Change(np.stack([stretched, second]))


def of_records(blocks, at=AT):
    """Return the covariance of the errors of all records at a level, written out."""
    n, size = blocks.scatter.shape[-1], blocks.noise.shape[-1]
    errors = at.scatter * blocks.scatter + at.coda * blocks.coda
    total = blocks.noise.copy()
    for c in range(3):
        each = slice(c * n, (c + 1) * n)
        total[..., each, each] += errors[:, :, c]
    return linalg.block_diag(*total.reshape(-1, size, size))


def of_all(error, at=SHARED):
    """Return the covariance of all data, nuisances included."""
    scale = [np.sqrt(at.transfer) if g == "transfer" else 1.0 for g in error.nuisances.groups]
    columns = error.nuisances.columns.reshape(len(scale), -1) * np.array(scale)[:, None]
    return of_records(error.blocks, at) + columns.T @ columns


@pytest.fixture(scope="module")
def problem():
    """Error at one level, derivatives by three properties."""
    motion, blocks, nuisances, band = problem_in()
    return ErrorModel(blocks, nuisances, only(AT)), slopes_of(motion, band)


@pytest.fixture(scope="module")
def shared():
    """Error at one level with a transfer error that blasts share, motion, band."""
    motion, blocks, nuisances, band = problem_in()
    nuisances = nuisances + transfer_columns(motion, band)
    return ErrorModel(blocks, nuisances, only(SHARED)), motion, band


def test_mean_and_covariance_are_those_of_the_normal_equations(problem):
    error, slopes = problem
    prior = np.array([0.3, 0.1, 0.2])
    residual = np.tensordot([0.2, -0.05, 0.1], slopes, 1)

    answer = error.posterior(residual, slopes, prior)

    columns = np.concatenate([slopes, error.nuisances.columns]).reshape(
        3 + len(error.nuisances.columns), -1
    )
    precise = linalg.inv(of_records(error.blocks))
    own = np.diag(np.concatenate([prior**-2.0, np.ones(len(error.nuisances.columns))]))
    covariance = linalg.inv(columns @ precise @ columns.T + own)
    mean = covariance @ columns @ precise @ residual.ravel()
    assert answer.mean == pytest.approx(mean[:3], rel=1e-6)
    assert answer.covariance == pytest.approx(covariance[:3, :3], rel=1e-6)


def test_a_property_that_is_known_does_not_move(problem):
    error, slopes = problem

    answer = error.posterior(slopes[0] + slopes[1], slopes, np.array([0.3, 0.0, 0.2]))

    assert answer.mean[1] == answer.covariance[1, 1] == answer.pulls[1] == 0.0


def test_knowing_a_held_property_takes_away_its_share_of_the_variance(problem):
    error, slopes = problem
    prior = np.array([0.3, 0.1, 0.2])
    held, known = (
        error.posterior(slopes[0], slopes, np.array([0.3, 0.1, third])) for third in (prior[2], 0.0)
    )

    shares = held.shares_of_variance([0, 1], [2])[:, 0]

    left = np.diag(known.covariance)[:2] / np.diag(held.covariance)[:2]
    assert shares == pytest.approx(1.0 - left, rel=1e-6)


def test_a_held_property_that_is_wrong_and_taken_as_known_moves_values_by_the_shift(problem):
    error, slopes = problem
    prior = np.array([0.3, 0.1, 0.2])
    held = error.posterior(0.0 * slopes[0], slopes, prior)

    shift = held.shifts_if_held([0, 1], [2])[:, 0]

    # The truth lies one deviation off; the records show it, and the model takes it for known.
    wrong = error.posterior(-0.2 * slopes[2], slopes, np.array([0.3, 0.1, 0.0]))
    assert wrong.mean[:2] == pytest.approx(shift, rel=1e-6)


def test_intervals_hold_what_was_drawn_from_the_priors_nine_times_in_ten(problem):
    error, slopes = problem
    rng, prior = np.random.default_rng(4), np.array([0.3, 0.1, 0.2])
    inside = []
    for drawn in error.draws(rng, 100, AT):
        truth = prior * rng.standard_normal(3)
        residual = np.tensordot(truth, slopes, 1) + drawn
        answer = error.posterior(residual, slopes, prior)
        inside.append(np.abs(answer.mean - truth) < NORMAL_95 * answer.deviation)

    assert 0.84 < np.mean(inside) < 0.96  # 300 intervals


def test_learned_levels_tell_a_wrong_model_from_a_right_one(problem):
    error, slopes = problem
    rng, prior = np.random.default_rng(2), np.array([0.3, 0.1, 0.2])
    noise = error.blocks.draws(rng, 1, *AT[:2]).reshape(slopes[0].shape)
    other = 0.5 * np.roll(slopes[1], 7, axis=-1)  # in no column

    learned = ErrorModel(error.blocks, error.nuisances, ALL_LEVELS)
    right, wrong = (learned.posterior(part, slopes, prior) for part in (noise, noise + other))

    assert right.level < 0.005
    assert wrong.level > 0.03
    assert np.median(wrong.remaining) > 10.0 * np.median(right.remaining)


def test_log_bayes_factor_is_that_of_two_gaussians_written_out(shared):
    error, motion, band = shared
    _, pair = changes_of(motion, band)
    residual = 0.7 * pair.shapes[0] - 0.2 * pair.shapes[1]
    residual = residual + 0.01 * band.project(np.roll(motion, 5, axis=-1))

    scores = error.scores(residual[None], [pair])

    without, shapes = of_all(error), pair.shapes.reshape(2, -1)
    density = [
        stats.multivariate_normal.logpdf(residual.ravel(), cov=covariance)
        for covariance in (without, without + shapes.T @ shapes)
    ]
    assert scores.log_bayes[0, 0] == pytest.approx(density[1] - density[0], rel=1e-6)


def test_a_strength_that_must_be_positive_has_twice_its_prior_there(shared):
    error, motion, band = shared
    change, _ = changes_of(motion, band)
    small = Change(0.05 * change.shapes, True)
    residual = -1.2 * small.shapes

    scores = error.scores(residual, [small])

    length = scores.length[0][0, 0]
    ratio = quad(
        lambda c: np.exp(-1.2 * c * length - 0.5 * c**2 * (1.0 + length)), 0.0, 10.0
    )[0]  # fmt: skip
    assert scores.log_bayes[0, 0] == pytest.approx(np.log(2.0 * ratio / np.sqrt(2.0 * np.pi)))
    assert scores.log_bayes[0, 0] < 0.0


@pytest.mark.parametrize("size", [0.0, 0.003, 0.03, 0.3, 3.0])
def test_levels_that_are_not_looked_at_have_no_weight(shared, size):
    error, motion, band = shared
    learned = ErrorModel(error.blocks, error.nuisances, FINE)
    changes = changes_of(motion, band)
    drawn = error.draws(np.random.default_rng(3), 3, SHARED)
    residuals = drawn + size * band.project(np.roll(motion, 5, axis=-1))

    some, every = (learned.scores(residuals, changes, whole) for whole in (False, True))
    posterior = learned.posterior(residuals[0], changes[1].shapes, np.ones(2))
    each = [
        ErrorModel(error.blocks, error.nuisances, only(level))
        .posterior(residuals[0], changes[1].shapes, np.ones(2))
        for level in learned._all
    ]  # fmt: skip
    evidences = np.array([one.log_evidence for one in each])
    weight = np.exp(evidences - special.logsumexp(evidences))

    assert len(some.by_level) < len(every.by_level) == len(each)
    np.testing.assert_allclose(some.log_evidence, every.log_evidence, rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(some.log_bayes, every.log_bayes, rtol=0.0, atol=1e-6)
    whole = special.logsumexp(evidences) - np.log(len(each))
    assert posterior.log_evidence == pytest.approx(whole, abs=1e-6)
    known = np.isfinite(posterior.evidences[:, 1])
    np.testing.assert_allclose(posterior.evidences[known, 1], evidences[known], atol=1e-6)
    assert np.all(evidences[~known] < evidences.max() - 50.0)
    mean = weight @ np.array([one.mean for one in each])
    np.testing.assert_allclose(posterior.mean, mean, atol=1e-9)
    spread = np.array([one.mean for one in each]) - mean
    wide = np.tensordot(weight, [one.covariance for one in each], 1)
    wide += np.einsum("l,li,lj->ij", weight, spread, spread)
    np.testing.assert_allclose(posterior.covariance, wide, rtol=1e-6)


def test_evidence_is_the_same_whether_a_property_is_looked_for_or_scored(shared):
    error, motion, band = shared
    learned = ErrorModel(error.blocks, error.nuisances, LEVELS)
    _, pair = changes_of(motion, band)
    residual = 0.7 * pair.shapes[0] + 0.1 * band.project(np.roll(motion, 5, axis=-1))

    posterior = learned.posterior(residual, pair.shapes, np.ones(2))
    scores = learned.scores(residual[None], [pair])

    assert posterior.log_evidence == pytest.approx(
        scores.log_evidence[0] + scores.log_bayes[0, 0], rel=1e-12
    )
    assert posterior.mean == pytest.approx(scores.strength[0][:, 0], rel=1e-9)


def test_scores_do_not_depend_on_the_unit_of_velocity():
    results = []
    for motion, blocks, nuisances, band in (problem_in(), problem_in(1000.0)):
        error = ErrorModel(blocks, nuisances + transfer_columns(motion, band), LEVELS)
        residual = 0.1 * band.project(np.roll(motion, 3, axis=-1))[None]
        results.append(error.scores(residual, changes_of(motion, band)))

    assert results[1].log_bayes == pytest.approx(results[0].log_bayes, rel=1e-6)


def test_levels_are_averaged_by_their_evidence(shared):
    error, motion, band = shared
    residual = 0.1 * band.project(np.roll(motion, 4, axis=-1))[None]
    grid = Levels(scatter=(1e-3, 2e-2), transfer=(4e-3,))

    together, *each = (
        replace(error, levels=levels).scores(residual, changes_of(motion, band))
        for levels in (grid, *(grid._replace(scatter=(s,)) for s in grid.scatter))
    )

    evidence = [one.log_evidence[0] for one in each]
    assert together.log_evidence[0] == pytest.approx(np.logaddexp(*evidence) - np.log(2.0))
    joint = [one.log_evidence[0] + one.log_bayes[0, 0] for one in each]
    assert together.log_bayes[0, 0] == pytest.approx(np.logaddexp(*joint) - np.logaddexp(*evidence))
    assert together.at == each[int(np.argmax(evidence))].at


def test_a_transfer_error_that_blasts_share_hides_no_difference_between_them(shared):
    error, _, _ = shared
    error = replace(error, levels=Levels(scatter=(1e-3,), transfer=(0.1,)))
    own = np.array([group == "transfer" for group in error.nuisances.groups])
    spectrum = error.nuisances.columns[own][0]
    alone = spectrum * np.array([-1.0, 1.0])[:, None, None, None]
    rest = tuple(group for group in error.nuisances.groups if group != "transfer")
    free = replace(error, nuisances=Nuisances(error.nuisances.columns[~own], rest))

    def length(change, error):
        return error.scores(0.0 * change[None], [Change(change[None])]).length[0][0, 0]

    assert length(spectrum, error) < 0.1 * length(spectrum, free)
    assert length(alone, error) > 0.5 * length(alone, free)


def test_draws_without_an_effect_exceed_a_log_bayes_factor_as_rarely_as_it_says(shared):
    error, motion, band = shared

    scores = error.scores(
        error.draws(np.random.default_rng(3), 400, SHARED), changes_of(motion, band)
    )

    # Markov: the mean of a Bayes factor without an effect is one.
    assert np.mean(scores.log_bayes > np.log(20.0)) < 0.05
    size = of_all(error).shape[0]
    square = -2.0 * scores.log_evidence
    assert np.ptp(square) > 0.0
    assert np.var(square) == pytest.approx(2.0 * size, rel=0.25)


@pytest.mark.parametrize("level", [SHARED, Level(2e-2, transfer=1e-2), Level(8e-2, transfer=5e-2)])
@pytest.mark.parametrize("size", [0.1, 1.0])
def test_a_change_is_detected_at_the_strength_that_is_stated_in_nine_of_ten_cases(
    shared, level, size
):
    error, motion, band = shared
    error = replace(error, levels=LEVELS)
    change = Change(size * changes_of(motion, band)[0].shapes, True)
    draws = (error.draws(np.random.default_rng(seed), 400, level) for seed in (5, 6))
    stated, others = draws

    strength = error.scores(stated, [change]).detected_strength(0, 10.0)
    scores = error.scores(others + strength * change.shapes, [change])

    assert np.mean(scores.log_bayes[0] > 10.0) == pytest.approx(0.9, abs=0.05)


def test_what_nuisances_explain_is_never_detected(shared):
    error, _, _ = shared
    column = np.argmax(np.array(error.nuisances.groups) == "transfer")
    change = Change(1e-7 * error.nuisances.columns[[column]], True)
    drawn = error.draws(np.random.default_rng(5), 20, SHARED)

    assert error.scores(drawn, [change]).detected_strength(0, 10.0) == np.inf


def test_without_changes_the_evidence_is_that_of_the_error(shared):
    error, motion, band = shared
    residual = 0.1 * band.project(np.roll(motion, 4, axis=-1))[None]

    scores = error.scores(residual)

    beside = error.scores(residual, changes_of(motion, band))
    assert scores.log_bayes.shape == (0, 1)
    assert scores.log_evidence == pytest.approx(beside.log_evidence)


def test_the_error_of_one_blast_is_that_of_its_records(shared):
    error, motion, band = shared
    residual = 0.1 * band.project(np.roll(motion, 4, axis=-1))
    out = np.zeros(motion.shape[:2], dtype=bool)
    out[0] = True

    evidence = error.without(out).scores(residual[None]).log_evidence[0]

    size = residual[1].size
    own = of_all(error)[-size:, -size:]
    density = stats.multivariate_normal.logpdf(residual[1].ravel(), cov=own)
    assert evidence == pytest.approx(density + 0.5 * size * np.log(2.0 * np.pi), rel=1e-9)


def test_the_error_of_a_law_does_not_average_over_its_records():
    motion, blocks, _, band = problem_in()
    change, share = 0.3 * motion, 0.04
    columns = law_columns(change, band, share)
    slope, prior = band.project(change)[None], np.array([10.0])

    deviations = []
    for noise in (1.0, 1e-8):  # as of one record, and of very many
        quiet = replace(blocks, noise=noise * blocks.noise)
        error = ErrorModel(quiet, columns, only(Level(1e-9)))
        deviations.append(error.posterior(0.0 * slope[0], slope, prior).deviation[0])

    assert np.sum(columns.columns**2) == pytest.approx(share * np.sum(slope**2))
    assert deviations[1] > 0.5 * np.sqrt(share / 8.0)
    assert deviations[1] < deviations[0]
