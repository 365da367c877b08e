"""Covariance of residuals: what is whitened, and errors of a survey that is designed."""

import numpy as np
import pytest
from residual_case import BAND, DT, N, coloured, residual_case, seismograms
from scipy import linalg

from pyblast.inference.covariance import RecordBlocks, noise_blocks, record_blocks
from pyblast.inference.error_model import Change, ErrorModel, Levels
from pyblast.inference.nuisances import (
    DESIGN_LEVELS,
    SCATTER,
    Nuisances,
    design_nuisances,
    scattering,
)
from pyblast.inference.records import Records, band_functions, noise_of


@pytest.fixture
def case():
    return residual_case()


def error_of(case, columns=None, scatter=0.1):
    """Return the error of noise, scattered motion and columns, those of a design by default."""
    noise, band, motion = case
    if columns is None:
        columns = design_nuisances(motion, band, (0.02 * np.roll(motion, 3, -1),), DESIGN_LEVELS)
    spread, none = scattering(motion, band), np.zeros(motion.shape[:2])
    blocks = RecordBlocks(noise_blocks(noise, band, len(motion)), spread, 0.0 * spread, none, none)
    return ErrorModel(blocks, columns, Levels(scatter=(scatter**2,)))


def chi_square(case, residual, **how):
    """Return the square of a residual in units of its error."""
    held = case[1].project(residual)[None]
    return error_of(case, **how).scores(0.0 * held, [Change(held)]).length[0][0, 0]


def none_of(case):
    """Return no columns."""
    return Nuisances(np.zeros((0, *case[1].project(case[2]).shape)), ())


def test_a_residual_has_the_length_that_the_covariance_gives_it(case):
    noise, band, motion = case
    spread = 0.01 * scattering(motion, band)
    residual = 0.1 * motion + coloured(np.random.default_rng(7), motion.shape)

    total = noise_blocks(noise, band, 2)
    for place in np.ndindex(total.shape[:2]):
        total[place] += linalg.block_diag(*spread[place])
    held = band.project(residual).reshape(*total.shape[:2], -1)
    each = np.sum(held * np.linalg.solve(total, held[..., None])[..., 0], axis=-1)
    assert np.sum(each) == pytest.approx(chi_square(case, residual, columns=none_of(case)))


def test_likelihood_does_not_depend_on_the_order_of_blasts(case):
    noise, band, motion = case
    residual = 0.1 * np.roll(motion, 2, -1)

    turned = chi_square((noise, band, motion[::-1]), residual[::-1])

    assert turned == pytest.approx(chi_square(case, residual), rel=1e-10)


def test_likelihood_does_not_depend_on_the_choice_of_functions_of_the_band(case):
    noise, band, motion = case
    turn = linalg.qr(np.random.default_rng(9).normal(size=[band.n_functions] * 2))[0]
    turned = type(band)(band.dt, band.low, band.high, band.basis @ turn)

    both = [chi_square((noise, each, motion), 0.1 * motion) for each in (band, turned)]

    assert both[1] == pytest.approx(both[0], rel=1e-10)


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
    levels = {**DESIGN_LEVELS, "gain": 0.0}

    both = [
        chi_square((noise, band, m), 0.1 * m, columns=design_nuisances(m, band, (), levels),
                   scatter=0.0) for m in (motion, turned)
    ]  # fmt: skip

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
    _, band, motion = case
    level = {"delay": 2e-3}.get(group, 0.1)
    levels = dict.fromkeys(DESIGN_LEVELS, 0.0) | {group: level}
    parts = design_nuisances(motion, band, (), levels)
    residual = change(motion)

    plain = chi_square(case, residual, columns=none_of(case), scatter=0.0)
    absorbed = chi_square(case, residual, columns=parts, scatter=0.0)

    assert set(parts.groups) == {group}
    # one for each column that is one level long
    assert absorbed < 1.05 * len(parts.groups)
    assert plain > 1e3


def test_scattered_motion_is_as_strong_as_the_motion_around_it(case):
    _, band, motion = case

    blocks = scattering(motion, band)

    strength = np.trace(blocks, axis1=-2, axis2=-1)
    assert strength == pytest.approx(np.sum(motion**2, axis=-1), rel=0.06)


def test_a_survey_has_a_level_for_each_of_its_errors(case):
    _, band, motion = case

    parts = design_nuisances(motion, band, (motion,), DESIGN_LEVELS)

    assert {*parts.groups, SCATTER} == set(DESIGN_LEVELS)


def records_of(case, motion):
    """Return the records of this motion with the noise of a case."""
    noise, band, _ = case
    valid = np.ones(motion.shape, dtype=bool)
    return Records(("a", "b"), ("R1", "R2", "R3"), DT, motion, valid, band, noise)


def test_the_power_of_a_coda_falls_by_e_in_a_fifth_of_a_second(case):
    _, band, motion = case
    late = DT * np.arange(N) - 0.1
    pulse = np.exp(-0.5 * (late / 0.02) ** 2) * np.cos(2.0 * np.pi * 15.0 * late)

    coda = record_blocks(records_of(case, motion), pulse + 0.0 * motion).coda[0, 0, 0]

    power = np.einsum("tf,fg,tg->t", band.basis, coda, band.basis)
    first, last = (power[(late > t) & (late < t + 0.1)].mean() for t in (0.15, 0.35))
    assert first / last == pytest.approx(np.e, rel=0.15)


def test_records_of_noise_have_nothing_above_it(case):
    _, band, motion = case
    blocks = record_blocks(records_of(case, motion), motion)
    held = band.project(motion)
    left = 0.3 * held * np.sqrt(
        blocks.noise_energy / np.sum(held**2, axis=(-2, -1))
    )[..., None, None]  # fmt: skip

    assert not blocks.above_noise(left).any()
    assert blocks.above_noise(held) == pytest.approx(1.0, abs=0.01)
