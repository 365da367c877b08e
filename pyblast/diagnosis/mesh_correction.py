"""What a finer mesh changes, carried from the believed site to one that damps waves."""

import numpy as np
from scipy import fft, ndimage

SMOOTH = 0.1  # of the width of the band, over which the transfer of energy is averaged


def carried(correction, before, after, dt, band):
    """Return a correction as it is after what damps the motion that it belongs to; (14.6).

    Parameters
    ----------
    correction : (n_receivers, 3, n_samples) float64, m/s
        Of the motion ``before``.
    before, after : (n_receivers, 3, n_samples) float64, m/s
        On one mesh, without and with damping.
    dt : float, s
    band : tuple of 2 float, Hz

    Returns
    -------
    (n_receivers, 3, n_samples) float64, m/s

    Notes
    -----
    A mesh errs by phases that grow along the way, so that its error fades as the motion does. The
    transfer from one motion to the other is that of least squares over neighbouring frequencies
    and the three components of a receiver, and never more than one.
    """
    n = correction.shape[-1]
    size = fft.next_fast_len(2 * n, real=True)
    first, last, own = (fft.rfft(one, size) for one in (before, after, correction))
    width = SMOOTH * (band[1] - band[0]) * size * dt
    across = _smooth(np.sum(last * np.conj(first), axis=1), width)
    power = _smooth(np.sum(np.abs(first) ** 2, axis=1), width)
    transfer = np.divide(across, power, out=np.zeros_like(across), where=power > 0.0)
    transfer /= np.maximum(np.abs(transfer), 1.0)
    return fft.irfft(own * transfer[:, None], size)[..., :n]


def _smooth(spectrum, width):
    """Return a spectrum (n_receivers, n) averaged over so many frequencies."""
    return ndimage.gaussian_filter1d(spectrum, width, axis=-1)
