"""Covariance of residuals: noise, errors of the theory, and what it makes white."""

import math

import numpy as np
import pytest
from scipy import fft, linalg, stats

from pyblast.errors import InputError
from pyblast.residuals.band import band_functions
from pyblast.residuals.levels import _evidence, infer_levels
from pyblast.residuals.noise import noise_of
from pyblast.residuals.nuisances import mesh_columns, mesh_error, nuisances, phase_shares
from pyblast.residuals.scattering import scattering
from pyblast.residuals.whitening import whitener

DT, BAND, N = 2e-3, (3.0, 30.0), 300
TIMES = DT * np.arange(N)


def coloured(rng, shape, level=1e-5):
    """Noise whose density falls tenfold from 3 to 30 Hz, made in 8 times its length."""
    n = 8 * shape[-1]
    frequency = fft.rfftfreq(n, DT)
    reply = 1.0 / np.hypot(1.0, frequency / 10.0)
    white = rng.normal(size=(*shape[:-1], n))
    return level * fft.irfft(fft.rfft(white) * reply, n)[..., : shape[-1]]


def seismograms(n_blasts=2, n_receivers=3):
    """Pulses of 10 to 16 Hz, different in each channel."""
    motion = np.empty((n_blasts, n_receivers, 3, N))
    for place in np.ndindex(motion.shape[:3]):
        late = TIMES - 0.25 - 0.03 * place[1] - 0.02 * place[2]
        turn = 2.0 * np.pi * (10.0 + 2.0 * place[1] + place[2]) * late
        pulse = np.exp(-0.5 * (late / 0.06) ** 2) * np.cos(turn + place[0])
        motion[place] = 1e-3 * (1.0 + place[0]) * pulse / (1.0 + place[1])
    return motion


@pytest.fixture(scope="module")
def case():
    rng = np.random.default_rng(1)
    noise = noise_of(coloured(rng, (6, 3, 3, 125)), DT, BAND)
    return noise, band_functions(N, DT, BAND), seismograms()


def whole(case, **levels):
    noise, band, motion = case
    parts = nuisances(motion, band) + mesh_columns(0.02 * np.roll(motion, 3, -1)[None], band)
    return whitener(
        noise, band, 2, nuisances=parts, scattering=scattering(motion, band), levels=levels
    )


def dense(white):
    """Covariance of all coefficients, written out."""
    size = white.spread.size
    root = linalg.block_diag(
        *[np.linalg.inv(t) for t in white.turns.reshape(-1, *[white.turns.shape[-1]] * 2)]
    )
    inner = np.diag(white.deviation**2)
    scale = np.array([white.levels[group] for group in white.groups])
    columns = white.columns * scale[:, None]
    return root @ (inner + columns.T @ columns) @ root.T, size


def test_functions_of_a_band_are_orthonormal():
    basis = band_functions(N, DT, BAND).basis

    assert basis.T @ basis == pytest.approx(np.eye(basis.shape[1]), abs=1e-12)


def test_functions_of_a_band_have_nine_tenths_of_their_energy_in_it():
    basis = band_functions(N, DT, BAND).basis
    n_padded = 64 * N
    power = np.abs(fft.rfft(basis, n_padded, axis=0)) ** 2
    frequency = fft.rfftfreq(n_padded, DT)
    inside = (frequency >= BAND[0]) & (frequency <= BAND[1])

    assert np.min(power[inside].sum(axis=0) / power.sum(axis=0)) > 0.9 - 1e-3


def test_a_band_holds_a_pulse_that_lies_within_it():
    motion = seismograms()
    band = band_functions(N, DT, BAND)

    left = motion - band.restore(band.project(motion))

    assert np.sum(left**2) < 0.005 * np.sum(motion**2)


def test_invalid_samples_have_no_part_in_what_the_band_holds():
    motion, valid = seismograms(), np.ones((2, 3, 3, N), bool)
    valid[1, 2, 0, 50:80] = False
    band = band_functions(N, DT, BAND, valid)

    held = band.project(motion)
    motion[1, 2, 0, 50:80] = np.nan

    assert np.array_equal(band.project(motion), held)


def test_a_channel_without_a_valid_sample_carries_no_data(case):
    noise, band, motion = case
    valid = np.ones(motion.shape, bool)
    valid[0, 1, 2] = False
    gapped = band_functions(N, DT, BAND, valid)

    assert whitener(noise, gapped, 2).n_data == whitener(noise, band, 2).n_data - band.n_functions


def test_a_valid_sample_that_is_not_finite_is_refused(case):
    motion = seismograms()
    motion[1, 2, 0, 5] = np.nan

    with pytest.raises(InputError, match="blast 1, receiver 2, component 0"):
        case[1].project(motion)


def test_noise_that_was_not_learnt_from_becomes_white():
    rng = np.random.default_rng(2)
    noise = noise_of(coloured(rng, (3, 60, 3, 125)), DT, BAND)
    white = whitener(noise, band_functions(N, DT, BAND), 1)

    residual = white.apply(coloured(rng, (1, 60, 3, N)))

    # three windows raise a level known to a third of its size: 0.75 of the variance in truth,
    # 1 in the mean of what is whitened; 2 % of floor
    assert np.mean(residual**2) == pytest.approx(1.0, abs=0.1)


def test_whitened_noise_has_no_autocorrelation_and_a_flat_spectrum():
    rng = np.random.default_rng(3)
    noise = noise_of(coloured(rng, (40, 10, 3, 125)), DT, BAND)
    band = band_functions(N, DT, BAND)
    white = whitener(noise, band, 20)
    residual = white.apply(coloured(rng, (20, 10, 3, N)))

    power = np.mean(np.abs(fft.rfft(band.restore(residual), 4 * N)) ** 2, axis=(0, 1, 2))
    flat = np.sum(np.abs(fft.rfft(band.basis, 4 * N, axis=0)) ** 2, axis=1)
    thirds = [slice(*edges) for edges in zip((8, 29, 50), (29, 50, 71), strict=True)]
    level = [power[part].sum() / flat[part].sum() for part in thirds]
    assert level == pytest.approx([1.0, 1.0, 1.0], abs=0.1)


def test_chi_square_of_noise_follows_its_distribution_when_noise_is_well_known():
    rng = np.random.default_rng(4)
    noise = noise_of(coloured(rng, (200, 2, 3, 250)), DT, BAND)
    white = whitener(noise, band_functions(N, DT, BAND), 1)

    found = white.chi_square(coloured(rng, (300, 1, 2, 3, N)))

    assert np.mean(found) == pytest.approx(white.n_data, rel=0.05)
    assert np.var(found) == pytest.approx(2.0 * white.n_data, rel=0.3)


def test_independent_components_are_taken_as_such():
    rng = np.random.default_rng(5)

    noise = noise_of(coloured(rng, (3, 100, 3, 125)), DT, BAND)

    mixed = np.any(noise.correlation != np.eye(3), axis=(1, 2))
    assert np.mean(mixed) < 0.05


def test_components_that_move_together_are_whitened_together():
    rng = np.random.default_rng(6)
    mixture = linalg.cholesky([[1.0, 0.8, 0.0], [0.8, 1.0, 0.0], [0.0, 0.0, 1.0]], lower=True)
    motion = np.einsum("cd,brdn->brcn", mixture, coloured(rng, (200, 1, 3, 125)))
    noise = noise_of(motion[:100], DT, BAND)

    residual = whitener(noise, band_functions(125, DT, BAND), 100).apply(motion[100:])

    found = np.corrcoef(residual[:, 0].transpose(1, 0, 2).reshape(3, -1))
    assert noise.correlation[0, 0, 1] == pytest.approx(0.8, abs=0.03)
    assert found == pytest.approx(np.eye(3), abs=0.08)


def test_a_channel_that_never_moves_before_the_blasts_is_refused():
    windows = np.ones((2, 2, 3, 125))

    with pytest.raises(InputError, match="receiver 0, component 0 has none that moves"):
        noise_of(windows, DT, BAND)


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
    for name in ("coefficients", "variance", "doubt"):
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


def test_phases_share_all_the_motion_between_them():
    arrivals = np.array([[[0.05, 0.1]], [[0.2, 0.3]], [[0.4, 0.5]]])

    shares = phase_shares(TIMES, arrivals)

    assert np.sum(shares, axis=0) == pytest.approx(np.ones((1, 2, N)))
    assert shares[1, 0, 0, TIMES.searchsorted(0.25)] == 1.0


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
