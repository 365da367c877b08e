"""Covariance of residuals: errors of the theory beside noise, and how large they are."""

import numpy as np
import pytest
from residual_case import BAND, DT, N, coloured, dense, residual_case, seismograms, whole
from scipy import linalg

from pyblast.errors import InputError
from pyblast.inference.covariance import whitener
from pyblast.inference.nuisances import nuisances, scattering
from pyblast.inference.records import band_functions, noise_of


@pytest.fixture
def case():
    return residual_case()


def test_the_quick_solve_equals_the_written_out_covariance(case):
    white = whole(case, delay=2e-3, scatter=0.2)
    covariance, size = dense(white)
    residual = 0.1 * case[2] + coloured(np.random.default_rng(7), case[2].shape)
    held = case[1].project(residual).reshape(size)

    assert white.chi_square(residual) == pytest.approx(
        held @ np.linalg.solve(covariance, held), rel=1e-8
    )


def test_whitened_residual_has_the_length_of_chi_square(case):
    white = whole(case)
    residual = np.array([0.1 * case[2], np.roll(case[2], 4, -1)])

    assert np.sum(white.apply(residual) ** 2, axis=(1, 2, 3, 4)) == pytest.approx(
        white.chi_square(residual), rel=1e-10
    )


def test_likelihood_does_not_depend_on_the_order_of_blasts(case):
    noise, band, motion = case
    residual = 0.1 * np.roll(motion, 2, -1)
    both = [
        whitener(noise, band, 2, nuisances=nuisances(m, band), scattering=scattering(m, band))
        for m in (motion, motion[::-1])
    ]

    assert both[1].chi_square(residual[::-1]) == pytest.approx(
        both[0].chi_square(residual), rel=1e-12
    )


def test_likelihood_does_not_depend_on_the_choice_of_functions_of_the_band(case):
    noise, band, motion = case
    turn = linalg.qr(np.random.default_rng(9).normal(size=[band.n_functions] * 2))[0]
    turned = type(band)(band.dt, band.low, band.high, band.basis @ turn)
    both = [
        whitener(noise, b, 2, nuisances=nuisances(motion, b), scattering=scattering(motion, b))
        for b in (band, turned)
    ]

    assert both[1].chi_square(0.1 * motion) == pytest.approx(
        both[0].chi_square(0.1 * motion), rel=1e-10
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
        whitener(noise, band, 2, nuisances=nuisances(m, band), levels=levels).chi_square(0.1 * m)
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


def test_scattered_motion_is_as_strong_as_the_motion_around_it(case):
    _, band, motion = case

    blocks = scattering(motion, band)

    strength = np.trace(blocks, axis1=-2, axis2=-1)
    assert strength == pytest.approx(np.sum(motion**2, axis=-1), rel=0.06)


def test_a_level_that_is_missing_is_refused(case):
    noise, band, motion = case

    with pytest.raises(InputError, match=r"whitener\.levels: need those of .*, got .*wind"):
        whitener(noise, band, 2, nuisances=nuisances(motion, band), levels={"wind": 1.0})
