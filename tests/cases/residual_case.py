"""Noise, a band and motion that tests of residuals share."""

from functools import cache

import numpy as np
from scipy import fft

from pyblast.inference.covariance import RecordBlocks, applied, noise_blocks
from pyblast.inference.records import band_functions, noise_of

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


@cache
def residual_case():
    """Return noise, the functions of the band, and motion of two blasts at three receivers."""
    rng = np.random.default_rng(1)
    noise = noise_of(coloured(rng, (6, 3, 3, 125)), DT, BAND)
    return noise, band_functions(N, DT, BAND), seismograms()


def whitened(noise, band, residual):
    """Return a residual (..., n_blasts, n_receivers, 3, n_samples) in the band, white by noise."""
    held, blocks = band.project(residual), noise_blocks(noise, band, residual.shape[-4])
    none, spread = np.zeros(blocks.shape[:2]), np.zeros((3, band.n_functions, band.n_functions))
    spread = np.broadcast_to(spread, (*none.shape, *spread.shape))
    roots, _ = RecordBlocks(blocks, spread, spread, none, none).roots(0.0, 0.0)
    return applied(roots, held.reshape(*held.shape[:-2], -1)).reshape(held.shape)
