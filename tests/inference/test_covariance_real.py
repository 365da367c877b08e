"""Noise of real records: what was learnt from some windows whitens others."""

from itertools import pairwise

import numpy as np
import pytest
from residual_case import whitened
from scipy import fft

from pyblast.inference.records import band_functions, noise_of
from pyblast.recordings.recording import read_gather

HITS, BAND, DT, N = range(6, 21), (3.0, 30.0), 1e-3, 250


@pytest.fixture(scope="module")
def windows(recordings):
    """First 0.25 s of 15 hits of a hammer, 24 geophones taken three by three."""
    gathers = [read_gather(recordings / "wghs" / f"{hit}.dat").data[:, :N] for hit in HITS]
    motion = np.reshape(gathers, (len(HITS), 8, 3, N))
    return motion - motion.mean(axis=-1, keepdims=True)


def held_out(windows):
    """Whiten each window by the noise of the three after it; motion and functions of the band."""
    band = band_functions(N, DT, BAND)
    white = []
    for hit in range(len(windows)):
        noise = noise_of(np.roll(windows, -hit, axis=0)[1:4], DT, BAND)
        white.append(whitened(noise, band, windows[hit : hit + 1])[0])
    return np.array(white), band


def test_real_noise_that_was_not_learnt_from_has_unit_variance(windows):
    white, _ = held_out(windows)

    # 4320 numbers; levels wander from hit to hit, so the mean is known to about 0.1
    assert np.mean(white**2) == pytest.approx(1.0, abs=0.25)


def test_real_noise_is_flat_over_the_band_after_whitening(windows):
    white, band = held_out(windows)
    plain = windows @ band.basis

    def quarters(held):
        power = np.mean(np.abs(fft.rfft(held @ band.basis.T, 4 * N)) ** 2, axis=(0, 1, 2))
        flat = np.sum(np.abs(fft.rfft(band.basis, 4 * N, axis=0)) ** 2, axis=1)
        edges = np.linspace(3, 30, 5).astype(int)
        level = [power[a:b].sum() / flat[a:b].sum() for a, b in pairwise(edges)]
        return max(level) / min(level)

    assert quarters(white) < 2.0
    assert quarters(plain) > 5.0
