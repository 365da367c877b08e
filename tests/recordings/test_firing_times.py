"""Firing times and scales from records: known ones come back, and intervals hold the truth."""

import numpy as np
import pytest
from firing_times import firing_times
from scipy import fft

from pyblast import InputError

DT, N_HOLES, N_RECEIVERS, N = 1e-3, 4, 6, 256
NOMINAL = 0.03 * np.arange(N_HOLES)
DELAYS = np.array([0.004, -0.0031, 0.0057, -0.0012])
SCALES = np.array([0.8, 1.3, 1.0, 0.9])


def wavelets(generator, n_receivers=N_RECEIVERS):
    """Random motion of 15 to 60 Hz that begins and ends at rest."""
    hz = fft.rfftfreq(N, DT)
    phases = np.exp(2j * np.pi * generator.uniform(size=(N_HOLES, n_receivers, len(hz))))
    motion = fft.irfft(phases * np.exp(-(((hz - 35.0) / 15.0) ** 2)), N)
    return motion * np.sin(np.pi * np.arange(N) / N) ** 2


def blast(greens, times, scales, n=420):
    size = 2 * (n + N)
    turns = np.exp(-2j * np.pi * np.outer(times, fft.rfftfreq(size, DT))) * scales[:, None]
    return fft.irfft(np.einsum("hrf,hf->rf", fft.rfft(greens, size), turns), size)[:, :n]


@pytest.fixture(scope="module")
def greens():
    return wavelets(np.random.default_rng(1))


@pytest.fixture(scope="module")
def record(greens):
    return blast(greens, NOMINAL + DELAYS, SCALES)


def test_times_and_scales_of_a_clean_record_come_back(greens, record):
    found = firing_times(greens, record, DT, NOMINAL, sigma=0.003)

    assert found.times == pytest.approx(NOMINAL + DELAYS, abs=1e-8)
    assert found.scales == pytest.approx(SCALES, abs=1e-6)
    assert found.misfit_after < 1e-10 < 0.3 < found.misfit_before


def test_a_hole_more_than_half_a_period_off_is_found(greens):
    late = NOMINAL + np.array([0.0, 0.02, 0.0, 0.0])  # 0.7 of a period at 35 Hz
    record = blast(greens, late, np.ones(N_HOLES))

    found = firing_times(greens, record, DT, NOMINAL, sigma=0.008)

    assert found.times == pytest.approx(late, abs=1e-7)


def test_a_misfire_is_a_scale_of_nothing(greens):
    record = blast(greens, NOMINAL + DELAYS, np.array([1.0, 1.0, 0.0, 1.0]))

    found = firing_times(greens, record, DT, NOMINAL, sigma=0.003, scale_sigma=1.0)

    assert found.scales == pytest.approx([1.0, 1.0, 0.0, 1.0], abs=1e-6)


def test_scales_at_known_times_are_those_of_least_squares(greens):
    noise = 0.02 * np.random.default_rng(2).normal(size=(N_RECEIVERS, 420))
    record = blast(greens, NOMINAL, SCALES) + noise
    rows = np.stack([blast(greens * (np.arange(N_HOLES) == h)[:, None, None], NOMINAL,
                           np.ones(N_HOLES)) for h in range(N_HOLES)])  # fmt: skip
    wanted = np.linalg.lstsq(rows.reshape(N_HOLES, -1).T, record.ravel(), rcond=None)[0]

    found = firing_times(greens, record, DT, NOMINAL, sigma=1e-9, scale_sigma=1e4)

    assert found.scales == pytest.approx(wanted, abs=1e-6)


def test_without_a_word_from_the_record_the_prior_remains(greens):
    noise = 1e3 * np.random.default_rng(2).normal(size=(N_RECEIVERS, 420))

    found = firing_times(greens, noise, DT, NOMINAL, sigma=0.003, scale_sigma=0.2)

    assert np.abs(found.times - NOMINAL).max() < 1e-4
    assert np.sqrt(np.diag(found.covariance)[:N_HOLES]) == pytest.approx(0.003, rel=0.02)


def test_the_operator_counts_up_to_a_factor_only(greens, record):
    noisy = record + 0.02 * np.random.default_rng(3).normal(size=record.shape)

    found = [firing_times(greens, noisy, DT, NOMINAL, sigma=0.003, whiten=lambda m, k=k: k * m)
             for k in (1.0, 1e6)]  # fmt: skip

    assert found[1].times == pytest.approx(found[0].times, abs=1e-9)
    assert found[1].covariance == pytest.approx(found[0].covariance, rel=1e-4, abs=1e-12)


def test_three_components_are_as_good_as_three_receivers(greens, record):
    together = firing_times(greens.reshape(N_HOLES, 2, 3, N), record.reshape(2, 3, -1), DT,
                            NOMINAL, sigma=0.003)  # fmt: skip

    assert together.times == pytest.approx(NOMINAL + DELAYS, abs=1e-8)


@pytest.mark.parametrize("colour", ["white", "red"])
def test_intervals_hold_the_truth_as_often_as_they_say(greens, colour):
    generator, inside = np.random.default_rng(7), []
    shape = np.ones(211) if colour == "white" else 1.0 / (1.0 + (np.arange(211) / 12.0) ** 2)
    for _ in range(25):
        delays = generator.normal(0.0, 0.003, N_HOLES)
        scales = generator.normal(1.0, 0.2, N_HOLES)
        noise = fft.irfft(shape * fft.rfft(generator.normal(size=(N_RECEIVERS, 420))), 420)
        record = blast(greens, NOMINAL + delays, scales)
        record += 0.3 * record.std() / noise.std() * noise
        found = firing_times(greens, record, DT, NOMINAL, sigma=0.003, scale_sigma=0.2)
        low, high = found.intervals(0.9).T
        inside.append((low < NOMINAL + delays) & (NOMINAL + delays < high))

    assert np.mean(inside) == pytest.approx(0.90, abs=0.09)  # 3 standard errors of 100


def test_what_can_not_be_fitted_is_refused(greens, record):
    with pytest.raises(InputError, match=r"greens: need \(4, receivers.* got \(3, 6, 256\)"):
        firing_times(greens[:3], record, DT, NOMINAL, sigma=0.003)
    with pytest.raises(InputError, match=r"recorded: must be finite"):
        firing_times(greens, np.full_like(record, np.nan), DT, NOMINAL, sigma=0.003)
    with pytest.raises(InputError, match=r"nominal: motion must reach into the record of 0\.42 s"):
        firing_times(greens, record, DT, NOMINAL + 0.4, sigma=0.003)
    with pytest.raises(InputError, match=r"\.sigma: must be positive, got 0"):
        firing_times(greens, record, DT, NOMINAL, sigma=0.0)
    with pytest.raises(InputError, match=r"hole 0 moves no receiver"):
        firing_times(0.0 * greens, record, DT, NOMINAL, sigma=0.003)
    with pytest.raises(InputError, match=r"share must lie between 0 and 1, got 90"):
        firing_times(greens, record, DT, NOMINAL, sigma=0.003).intervals(90)
