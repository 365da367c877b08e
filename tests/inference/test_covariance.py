"""Covariance of residuals: errors of the theory beside noise, and how large they are."""

import math

import numpy as np
import pytest
from residual_case import BAND, DT, N, coloured, dense, residual_case, seismograms, whole
from scipy import linalg, stats

from pyblast.errors import InputError
from pyblast.inference.covariance import PRIORS, _evidence, infer_levels, whitener
from pyblast.inference.error_model import mesh_error, nuisances, scattering
from pyblast.inference.records import band_functions, noise_of


@pytest.fixture
def case():
    return residual_case()


def test_the_quick_solve_equals_the_written_out_covariance(case):
    white = whole(case, delay=2e-3, scatter=0.2)
    covariance, size = dense(white)
    residual = 0.1 * case[2] + coloured(np.random.default_rng(7), case[2].shape)
    held = case[1].project(residual).reshape(size)

    sign, logarithm = np.linalg.slogdet(covariance)
    assert white.chi_square(residual) == pytest.approx(
        held @ np.linalg.solve(covariance, held), rel=1e-8
    )
    assert white.log_determinant == pytest.approx(logarithm, rel=1e-10)
    assert sign == 1.0


def test_whitened_residual_has_the_length_of_chi_square(case):
    white = whole(case)
    residual = np.array([0.1 * case[2], np.roll(case[2], 4, -1)])

    assert np.sum(white.apply(residual) ** 2, axis=(1, 2, 3, 4)) == pytest.approx(
        white.chi_square(residual), rel=1e-10
    )


def test_log_likelihood_is_that_of_the_dense_gaussian(case):
    white = whole(case)
    covariance, size = dense(white)
    residual = coloured(np.random.default_rng(8), case[2].shape)

    wanted = stats.multivariate_normal(np.zeros(size), covariance).logpdf(
        case[1].project(residual).reshape(size)
    )
    assert white.log_likelihood(residual) == pytest.approx(wanted, rel=1e-10)


def test_likelihood_does_not_depend_on_the_order_of_blasts(case):
    noise, band, motion = case
    residual = 0.1 * np.roll(motion, 2, -1)
    both = [
        whitener(noise, band, 2, nuisances=nuisances(m, band), scattering=scattering(m, band))
        for m in (motion, motion[::-1])
    ]

    assert both[1].log_likelihood(residual[::-1]) == pytest.approx(
        both[0].log_likelihood(residual), rel=1e-12
    )


def test_likelihood_does_not_depend_on_the_choice_of_functions_of_the_band(case):
    noise, band, motion = case
    turn = linalg.qr(np.random.default_rng(9).normal(size=[band.n_functions] * 2))[0]
    turned = type(band)(band.dt, band.low, band.high, band.basis @ turn)
    both = [
        whitener(noise, b, 2, nuisances=nuisances(motion, b), scattering=scattering(motion, b))
        for b in (band, turned)
    ]

    assert both[1].log_likelihood(0.1 * motion) == pytest.approx(
        both[0].log_likelihood(0.1 * motion), rel=1e-10
    )


def test_likelihood_does_not_depend_on_the_direction_of_horizontal_components_of_equal_noise():
    rng = np.random.default_rng(10)
    motion = seismograms()
    noise = noise_of(coloured(rng, (3, 3, 3, 125)), DT, BAND)
    for name in ("coefficients", "variance", "inflation"):
        getattr(noise, name)[:, 1] = getattr(noise, name)[:, 0]
    noise = type(noise)(**{**vars(noise), "correlation": np.tile(np.eye(3), (3, 1, 1))})
    band = band_functions(N, DT, BAND)
    turn = np.array([[0.6, 0.8, 0.0], [-0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])
    turned = np.einsum("cd,brdn->brcn", turn, motion)
    levels = {"gain": 0.0}
    both = [
        whitener(noise, band, 2, nuisances=nuisances(m, band), levels=levels).log_likelihood(
            0.1 * m
        )
        for m in (motion, turned)
    ]

    assert both[1] == pytest.approx(both[0], rel=1e-10)


@pytest.mark.parametrize(
    ("group", "change"),
    [
        ("delay", lambda s: np.gradient(s, DT, axis=-1) * -2e-3),
        ("receiver", lambda s: 0.1 * s),
        ("rotation", lambda s: 0.1 * np.stack([s[:, :, 1], -s[:, :, 0], 0 * s[:, :, 2]], 2)),
    ],
)
def test_a_small_error_of_its_kind_is_absorbed_by_its_column(case, group, change):
    noise, band, motion = case
    every = nuisances(motion, band)
    kept = np.array(every.groups) == group
    parts = type(every)(every.columns[kept], (group,) * np.count_nonzero(kept))
    residual = change(motion)

    plain = whitener(noise, band, 2).chi_square(residual)
    level = {"delay": 2e-3}.get(group, 0.1)
    left = whitener(noise, band, 2, nuisances=parts, levels={group: level}).chi_square(residual)

    # one for each column that is one level long
    assert left < 1.05 * np.count_nonzero(kept)
    assert plain > 1e3


def test_a_gain_of_one_channel_is_told_by_the_score_of_that_channel(case):
    noise, band, motion = case
    every = nuisances(motion, band)
    kept = np.array(every.groups) == "gain"
    parts = type(every)(every.columns[kept], ("gain",) * np.count_nonzero(kept))
    residual = np.zeros_like(motion)
    residual[1, 2, 1] = 0.1 * motion[1, 2, 1]

    scores = whitener(noise, band, 2, nuisances=parts, levels={"gain": 0.05}).scores(residual)

    assert scores[(1 * 3 + 2) * 3 + 1] == pytest.approx(2.0, rel=0.01)
    assert np.sum(np.abs(scores) > 1e-6) == 1


def test_scores_of_nuisances_that_were_drawn_have_the_covariance_foreseen(case):
    white = whole(case)
    rng = np.random.default_rng(11)
    inner = white.columns * np.array([white.levels[g] for g in white.groups])[:, None]
    drawn = rng.normal(size=(2000, len(inner))) @ inner
    drawn += rng.normal(size=drawn.shape) * white.deviation
    along = drawn / white.deviation @ (inner / white.deviation).T
    overlap = (inner / white.deviation) @ (inner / white.deviation).T
    scores = np.linalg.solve(np.eye(len(inner)) + overlap, along.T).T

    foreseen = np.eye(len(inner)) - np.linalg.inv(np.eye(len(inner)) + overlap)
    assert np.mean(scores**2, axis=0) == pytest.approx(np.diag(foreseen), abs=0.15)


def test_error_of_a_mesh_is_exact_for_errors_that_fall_with_the_square_of_the_edge():
    truth, error = np.array([1.0, 2.0]), np.array([0.3, -0.1])

    coarser = mesh_error(truth + error, truth + 1.5**2 * error, 1.5)
    finer = mesh_error(truth + error, truth + error / 1.5**2, 1.0 / 1.5)

    assert coarser == pytest.approx(error)
    assert finer == pytest.approx(error)


def test_scattered_motion_is_as_strong_as_the_motion_around_it(case):
    _, band, motion = case

    blocks = scattering(motion, band)

    strength = np.trace(blocks, axis1=-2, axis2=-1)
    assert strength == pytest.approx(np.sum(motion**2, axis=-1), rel=0.06)


def test_slopes_of_the_evidence_are_those_of_its_differences(case):
    white = whole(case)
    names = list(white.levels)
    members = np.array([names.index(group) for group in white.groups])
    turned = white.turned(0.1 * np.roll(case[2], 2, -1))
    place = np.log([white.levels[name] ** 2 for name in names])

    taken = white.turned(np.stack([np.roll(case[2], n, -1) for n in (3, 9)]))

    found = _evidence(white, turned, taken, members, names, place)[1]

    steps = 1e-5 * np.eye(len(names))
    ends = [
        [_evidence(white, turned, taken, members, names, place + s)[0] for s in (d, -d)]
        for d in steps
    ]
    assert found == pytest.approx(np.subtract(*np.transpose(ends)) / 2e-5, rel=1e-4, abs=1e-4)


def test_inferred_levels_are_the_most_probable_ones(case):
    white, residual = whole(case), 0.1 * np.roll(case[2], 2, -1)
    found = infer_levels(white, residual).whitener

    def density(levels):
        prior = sum(
            -0.5 * weight * (2.0 * math.log(levels[name]) + (level / levels[name]) ** 2)
            for name, (level, weight) in PRIORS.items()
            if name in levels
        )
        return found.with_levels(**levels).log_likelihood(residual) + prior

    for name, level in found.levels.items():
        more, less = (density({**found.levels, name: level * k}) for k in (1.03, 1.0 / 1.03))
        assert max(more, less) < density(found.levels), name


def test_what_fitted_unknowns_take_on_themselves_does_not_change_levels(case):
    white, motion = whole(case), case[2]
    residual, taken = 0.1 * np.roll(motion, 2, -1), np.gradient(motion, axis=-1)
    free = 1e3 * taken[None]

    alone, less = (infer_levels(white, one).whitener.levels for one in (residual, residual - taken))
    beside, after = (
        infer_levels(white, one, fitted=free).whitener.levels
        for one in (residual, residual - taken)
    )

    assert after == pytest.approx(beside, rel=1e-3)  # the prior of a thousand lets it move freely
    assert less != pytest.approx(alone, rel=0.1)


def test_intervals_of_inferred_levels_hold_the_truth_nine_times_in_ten(case):
    noise, band, motion = case
    every = nuisances(motion, band)
    kept = np.isin(every.groups, ["delay", "gain"])
    parts = type(every)(
        every.columns[kept], tuple(g for g in every.groups if g in ("delay", "gain"))
    )
    rng = np.random.default_rng(12)
    hits = []
    for _ in range(60):
        truth = {
            name: level * math.sqrt(4.0 / rng.chisquare(4.0))
            for name, level in (("delay", 1e-3), ("gain", 0.05), ("scatter", 0.1))
        }
        white = whitener(
            noise, band, 2, nuisances=parts, scattering=scattering(motion, band), levels=truth
        )
        size = np.array([truth[group] for group in parts.groups])
        turned = (rng.normal(size=len(size)) * size) @ white.columns
        turned += rng.normal(size=turned.shape) * white.deviation
        back = np.linalg.inv(white.turns) @ turned.reshape(*white.spread.shape, 1)
        residual = band.restore(back.reshape(2, 3, 3, -1))
        found = infer_levels(white, residual)
        hits += [low <= truth[n] <= high for n, (low, high) in found.intervals.items()]

    # 180 intervals: 90 % within 85 to 95 with a chance of 0.97
    assert 0.85 <= np.mean(hits) <= 0.95


def test_a_level_that_is_missing_is_refused(case):
    noise, band, motion = case

    with pytest.raises(InputError, match=r"whitener\.levels: need those of .*, got .*wind"):
        whitener(noise, band, 2, nuisances=nuisances(motion, band), levels={"wind": 1.0})
