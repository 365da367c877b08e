"""Variation from hole to hole: closed forms of its linear model, the level that is learned."""

from dataclasses import replace

import numpy as np
import pytest
from residual_case import DT, TIMES, residual_case
from scipy import fft

from pyblast.diagnosis.error import LEVELS
from pyblast.inference.covariance import record_blocks
from pyblast.inference.error_model import Change, ErrorModel, Level, Levels
from pyblast.inference.nuisances import HOLES, Nuisances, moving_columns
from pyblast.inference.records import Records
from pyblast.inference.variation import (
    LOST,
    VARIED,
    Charges,
    Filters,
    Scatter,
    Variation,
    filtered_motion,
    learned_variation,
    log_filters,
    no_filters,
    peaks_of_drawn_blasts,
    variation,
    with_variation,
)

NOISE, BAND, _ = residual_case()
N_HOLES, N_RECEIVERS = 10, 3


def charges():
    """Return ten charges in a row, 20 ms apart, whose waves receivers see from three sides."""
    places = np.array([[12.0 * h, 0.0, -8.0] for h in range(N_HOLES)])
    receivers = np.array([[20.0, 90.0, 0.0], [150.0, 60.0, 0.0], [60.0, -120.0, 0.0]])
    motion = np.empty((N_HOLES, N_RECEIVERS, 3, len(TIMES)))
    for h, r, c in np.ndindex(motion.shape[:3]):
        away = np.linalg.norm(receivers[r] - places[h])
        late = TIMES - away / (2300.0, 1500.0, 1900.0)[c] - 0.04
        pulse = np.exp(-0.5 * (late / 0.018) ** 2) * np.cos(2 * np.pi * (9.0 + 3.0 * c) * late)
        motion[h, r, c] = 0.04 * pulse / away
    return Charges(motion, 0.02 * np.arange(N_HOLES), places)


def sent(filters=None):
    """Return the motion of the blast with filters of its charges, (1, n_receivers, 3, n)."""
    own, n = charges(), len(TIMES)
    size = fft.next_fast_len(3 * n, real=True)
    turns = np.exp(-2j * np.pi * np.multiply.outer(own.times, fft.rfftfreq(size, DT)))
    factor = np.ones((N_HOLES, N_RECEIVERS, turns.shape[-1]), complex)
    if filters is not None:
        factor = np.exp((filters.own[:, None] + filters.paths) @ log_filters(BAND, n, size))
    spectrum = fft.rfft(own.motion, size) * (turns[:, None] * factor)[:, :, None]
    return fft.irfft(spectrum.sum(axis=0), size)[None, ..., :n]


def drawn(level, rng):
    """Return random filters of a level; paths of neighbouring charges differ."""
    shapes = (N_HOLES, 5), (N_HOLES, N_RECEIVERS, 5)
    return Filters(*(level * rng.standard_normal(shape) for shape in shapes))


def error(levels=LEVELS) -> ErrorModel:
    """Return an error of noise and scattering around the planned motion, without columns."""
    motion = sent()
    valid = np.ones(motion.shape, dtype=bool)
    records = Records(("a",), ("R1", "R2", "R3"), DT, motion, valid, BAND, NOISE)
    return ErrorModel(record_blocks(records, motion), no_columns(), levels)


def no_columns() -> Nuisances:
    """Return no nuisances."""
    return moving_columns({}, (1, N_RECEIVERS, 3, BAND.n_functions))


def linear(known=None) -> Variation:
    """Return the variation around filters."""
    return variation(
        {0: charges()}, BAND, (1, N_RECEIVERS, 3, BAND.n_functions),
        no_filters({0: charges()}) if known is None else {0: known},
    )  # fmt: skip


def learned(level, seed):
    """Return what is learned from records of a drawn level."""
    rng = np.random.default_rng(seed)
    around = error()
    moved = BAND.project(sent(drawn(level, rng)) - sent())
    noise = around.draws(rng, 1, around.most_probable(0.0 * moved)[0]._replace(scatter=5e-3))[0]
    return learned_variation(lambda _: around, {0: charges()}, BAND, moved + noise, VARIED)


@pytest.mark.parametrize("level", [0.1, 0.2, 0.3])
def test_the_level_of_drawn_holes_is_found_within_a_third(level):
    found = [learned(level, seed).level for seed in range(4)]

    assert abs(np.mean([each.value for each in found]) - level) < level / 3.0
    assert sum(each.low < level < each.high for each in found) >= 3


def test_holes_that_do_not_vary_are_said_to_vary_by_less_than_some_per_cent():
    own = learned(0.0, 1)
    varied, levels, energy = own.level, own.levels, own.level.value**2 * own.around.energy

    assert varied.high < 0.1
    assert varied.words.startswith("holes vary by less than")
    assert levels == VARIED[:2]
    assert np.all(energy < 0.01 * np.sum(BAND.project(sent()) ** 2, axis=(-2, -1)))


def test_small_filters_change_motion_as_their_columns_and_large_ones_as_columns_and_offset():
    rng = np.random.default_rng(2)
    around, step = drawn(0.3, rng), drawn(1e-4, rng)
    both = Filters(around.own + step.own, around.paths + step.paths)

    for known, filters in ((no_filters({0: charges()})[0], step), (around, both)):
        own = linear(known)
        of_charges = (
            own.to_own[0]
            @ filters.own.ravel()
            @ own.columns.columns.reshape(len(own.to_own[0]), -1)
        )
        root = np.linalg.cholesky(own_coherence())
        free = np.linalg.solve(root, filters.paths.reshape(N_HOLES, -1)).reshape(
            filters.paths.shape
        )
        free = np.moveaxis(free, 1, 0).reshape(N_RECEIVERS, -1)
        of_paths = np.einsum("rk,rkf->rf", free, own.to_paths[0])
        said = (
            BAND.project(filtered_motion({0: charges()}, BAND, 1, {0: known}).change)
            + own.offset
            + (of_charges + of_paths.ravel()).reshape(own.offset.shape)
        )
        exact = BAND.project(sent(filters) - sent())

        assert np.linalg.norm(said - exact) < np.sqrt(2.0 * LOST) * np.linalg.norm(exact)


def own_coherence():
    """Return the covariance of the filters of the paths of the charges."""
    places = charges().places
    apart = np.linalg.norm(places[:, None] - places, axis=-1)
    return np.exp(-apart / 15.0) + 1e-6 * np.eye(N_HOLES)


def test_filters_of_unit_factors_have_a_log_amplitude_of_one():
    n = len(TIMES)
    frequency = np.geomspace(BAND.low, BAND.high, 400)
    kernels = log_filters(BAND, n, 64 * n)
    grid = fft.rfftfreq(64 * n, DT)
    inside = np.array([np.interp(frequency, grid, kernel.real) for kernel in kernels])

    assert 2.0 * np.mean(np.sum(inside**2, axis=0)) == pytest.approx(1.0, rel=0.03)


def test_what_is_most_probable_solves_the_normal_equations():
    own, at = linear(), Levels(scatter=(2e-2,), holes=(0.2,))
    bare = error(at)
    whole = replace(bare, blocks=replace(bare.blocks, paths=own.paths), nuisances=own.columns)
    residual = BAND.project(sent(drawn(0.2, np.random.default_rng(3))) - sent())
    level, factors, left = whole.most_probable(residual)

    columns = 0.2 * own.columns.columns.reshape(len(factors), -1)
    size = own.paths.shape[-1]
    covariance = np.zeros((N_RECEIVERS * size, N_RECEIVERS * size))
    for r in range(N_RECEIVERS):
        each = slice(r * size, (r + 1) * size)
        covariance[each, each] = whole.blocks._total(2e-2, 0.0)[0, r] + 0.04 * own.paths[0, r]
    inner = columns @ np.linalg.solve(covariance, columns.T) + np.eye(len(columns))
    known = np.linalg.solve(inner, columns @ np.linalg.solve(covariance, residual.ravel()))
    rest = np.linalg.solve(covariance, residual.ravel() - known @ columns)

    assert level.holes == 0.2
    assert set(whole.nuisances.groups) == {HOLES}
    np.testing.assert_allclose(factors, 0.2 * known, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(left.ravel(), rest, rtol=1e-6, atol=1e-6 * np.abs(rest).max())


def test_scales_of_varied_holes_are_named_without_the_level_alone():
    rng, around = np.random.default_rng(5), error()
    moved = BAND.project(sent(drawn(0.2, rng)) - sent())
    scaled = [0.3 * BAND.project(sent(scale(h)) - sent()) for h in range(N_HOLES)]
    own = learned_variation(lambda _: around, {0: charges()}, BAND, moved, VARIED)
    whole = with_variation(around, own.around, own.levels)
    rest = moved - BAND.project(own.filtered.change)

    without = around.scores(moved[None], [Change(np.array(scaled))]).log_bayes[0, 0]
    (beside,) = whole.scores(rest[None], [Change(np.array(scaled))]).log_bayes[0]

    assert without > 10.0
    assert beside < 0.0


def scale(hole):
    """Return filters by which one charge sends e times as much."""
    own = np.zeros((N_HOLES, 5))
    own[hole, 0] = np.sqrt(2.5)
    return Filters(own, np.zeros((N_HOLES, N_RECEIVERS, 5)))


def test_drawn_errors_have_the_energy_of_the_holes_that_vary():
    own, still = linear(), 1e-9
    whole = with_variation(error(Levels((still,))), own, (0.2,))
    level = Level(still, holes=0.2)

    draws = whole.draws(np.random.default_rng(1), 400, level)

    energy = np.mean(np.sum(draws**2, axis=(-2, -1)), axis=0)
    noise = np.trace(whole.blocks.noise, axis1=-2, axis2=-1)
    np.testing.assert_allclose(energy, 0.04 * own.energy + noise, rtol=0.2)


def test_what_is_open_sends_the_mean_of_a_lognormal():
    kernels = log_filters(BAND, len(TIMES), 4 * len(TIMES))[:3]  # in phase
    none, variance = np.zeros((1, 5)), np.array([0.3, 0.2, 0.1, 0.0, 0.0])
    whole = np.concatenate([kernels, 0.0 * kernels[:2]])

    (said,) = np.exp(Filters(none, none[:, None], variance).log_factor(0, whole).real)

    drawn = np.random.default_rng(1).standard_normal((20000, 3)) * np.sqrt(variance[:3])
    np.testing.assert_allclose(said, np.exp(drawn @ kernels.real).mean(axis=0), rtol=0.02)


def test_receivers_share_half_of_what_a_hole_varies():
    whole = charges()
    one = Charges(whole.motion[:1], whole.times[:1], whole.places[:1])

    peaks = peaks_of_drawn_blasts(one, BAND, Scatter(0.2, 0.0), 400)[..., 0]

    shared = np.corrcoef(np.log(peaks.T))[np.triu_indices(N_RECEIVERS, 1)]
    np.testing.assert_allclose(shared, 0.5, atol=0.15)
