"""Functions of a band, and noise that its covariance makes white."""

import numpy as np
import pytest
from residual_case import BAND, DT, N, coloured, residual_case, seismograms, whitened
from scipy import fft, linalg

from pyblast.errors import InputError
from pyblast.inference.covariance import noise_blocks
from pyblast.inference.records import band_functions, noise_of


@pytest.fixture
def case():
    return residual_case()


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

    whole, less = (np.diagonal(noise_blocks(noise, each, 2), axis1=2, axis2=3) > 0.0
                   for each in (band, gapped))  # fmt: skip
    lost = np.count_nonzero(whole, axis=-1) - np.count_nonzero(less, axis=-1)
    assert lost.tolist() == [[0, band.n_functions, 0], [0, 0, 0]]


def test_a_valid_sample_that_is_not_finite_is_refused(case):
    motion = seismograms()
    motion[1, 2, 0, 5] = np.nan

    with pytest.raises(InputError, match="blast 1, receiver 2, component 0"):
        case[1].project(motion)


def test_noise_that_was_not_learnt_from_becomes_white():
    rng = np.random.default_rng(2)
    noise = noise_of(coloured(rng, (3, 60, 3, 125)), DT, BAND)

    residual = whitened(noise, band_functions(N, DT, BAND), coloured(rng, (1, 60, 3, N)))

    # three windows raise a level known to a third of its size: 0.75 of the variance in truth,
    # 1 in the mean of what is whitened; 2 % of floor
    assert np.mean(residual**2) == pytest.approx(1.0, abs=0.1)


def test_whitened_noise_has_no_autocorrelation_and_a_flat_spectrum():
    rng = np.random.default_rng(3)
    noise = noise_of(coloured(rng, (40, 10, 3, 125)), DT, BAND)
    band = band_functions(N, DT, BAND)
    residual = whitened(noise, band, coloured(rng, (20, 10, 3, N)))

    power = np.mean(np.abs(fft.rfft(band.restore(residual), 4 * N)) ** 2, axis=(0, 1, 2))
    flat = np.sum(np.abs(fft.rfft(band.basis, 4 * N, axis=0)) ** 2, axis=1)
    thirds = [slice(*edges) for edges in zip((8, 29, 50), (29, 50, 71), strict=True)]
    level = [power[part].sum() / flat[part].sum() for part in thirds]
    assert level == pytest.approx([1.0, 1.0, 1.0], abs=0.1)


def test_chi_square_of_noise_follows_its_distribution_when_noise_is_well_known():
    rng = np.random.default_rng(4)
    noise = noise_of(coloured(rng, (200, 2, 3, 250)), DT, BAND)
    band = band_functions(N, DT, BAND)

    white = whitened(noise, band, coloured(rng, (300, 1, 2, 3, N)))

    found, n_data = np.sum(white**2, axis=(1, 2, 3, 4)), 2 * 3 * band.n_functions
    assert np.mean(found) == pytest.approx(n_data, rel=0.05)
    assert np.var(found) == pytest.approx(2.0 * n_data, rel=0.3)


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

    residual = whitened(noise, band_functions(125, DT, BAND), motion[100:])

    found = np.corrcoef(residual[:, 0].transpose(1, 0, 2).reshape(3, -1))
    assert noise.correlation[0, 0, 1] == pytest.approx(0.8, abs=0.03)
    assert found == pytest.approx(np.eye(3), abs=0.08)


def test_a_channel_that_never_moves_before_the_blasts_is_refused():
    windows = np.ones((2, 2, 3, 125))

    with pytest.raises(InputError, match="receiver 0, component 0 has only zeros"):
        noise_of(windows, DT, BAND)
