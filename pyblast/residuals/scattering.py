"""Motion scattered by ground too small to be modelled: random, coloured and timed as the motion."""

import numpy as np
from scipy import fft, ndimage

from .band import Band

SMOOTHING = 2.0


def scattering(simulated, band: Band) -> np.ndarray:
    """Return the covariance of scattered motion as strong as the simulated motion around it.

    Parameters
    ----------
    simulated : (n_blasts, n_receivers, 3, n_samples) float, m/s
    band : Band

    Returns
    -------
    (n_blasts, n_receivers, 3, n_functions, n_functions) float64, (m/s)2
        Between the coefficients of each channel.

    Notes
    -----
    ``D C D`` with D the running rms over a period at the middle of the band (geometric) and C of
    unit diagonal with the smoothed spectrum of the simulation; theory.md (7.16).
    """
    simulated = np.asarray(simulated, dtype=float)
    n = simulated.shape[-1]
    n_padded = fft.next_fast_len(2 * n, real=True)
    frequency = fft.rfftfreq(n_padded, band.dt)
    inside = np.flatnonzero((frequency >= band.low) & (frequency <= band.high))
    middle = np.sqrt(max(band.low, 1.0 / (n * band.dt)) * band.high)
    reach = 0.5 / (middle * band.dt)
    level = np.sqrt(np.maximum(ndimage.gaussian_filter1d(simulated**2, reach, mode="constant"), 0))
    power = np.abs(fft.rfft(simulated, n_padded, axis=-1)[..., inside]) ** 2
    width = SMOOTHING / (n * band.dt) / (frequency[1] - frequency[0])
    power = ndimage.gaussian_filter1d(power, width, mode="nearest")
    total = np.sum(power, axis=-1, keepdims=True)
    power = np.divide(power, total, out=np.zeros_like(power), where=total > 0.0)
    blocks = np.empty((*simulated.shape[:3], band.n_functions, band.n_functions))
    for channel in np.ndindex(simulated.shape[:3]):
        functions = level[channel][:, None] * band.functions(channel)
        waves = fft.rfft(functions, n_padded, axis=0)[inside]
        blocks[channel] = np.real((waves.conj() * power[channel][:, None]).T @ waves)
    return blocks
