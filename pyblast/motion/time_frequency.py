"""Two motions against each other over time and frequency, and how late one is."""

import math

import numpy as np
from obspy.signal import tf_misfit
from scipy import signal

N_WAVELETS = 40
WAVELET = 6.0
TF_CYCLES = 3.0
TF_TOP = 0.4


def wavelet_transform(motion, dt, band=None):
    """Return the Morlet transform of motion (n_samples,), (40, n_samples) complex.

    Over the band, or from three cycles per record to 0.8 of Nyquist; obspy's transform, w0 = 6.
    """
    low, high = band or (TF_CYCLES / (dt * len(motion)), TF_TOP / dt)
    return tf_misfit.cwt(motion, dt, WAVELET, low, high, N_WAVELETS)


def envelope_and_phase(wanted, found):
    """Return single-valued envelope and phase misfit of transforms, the first as reference.

    Kristekova et al. (2009), table 1; theory.md (7.5). The phase is that of a product, not of
    obspy's quotient, which is undefined where the transform vanishes.
    """
    level = np.sum(np.abs(wanted) ** 2)
    envelope = np.sum((np.abs(found) - np.abs(wanted)) ** 2)
    phase = np.sum((np.abs(wanted) * np.angle(found * wanted.conj()) / np.pi) ** 2)
    return math.sqrt(envelope / level), math.sqrt(phase / level)


def lag(data, model, dt):
    """Return when the correlation of two motions (n_samples, n_components) is largest.

    Returns
    -------
    lag : float, s
        Common to all components, by a parabola; positive where the model is late.
    correlation : float
        There. Both are NaN where one of the motions is silent.
    """
    level = math.sqrt(np.sum(data**2) * np.sum(model**2))
    if not level > 0.0:
        return math.nan, math.nan
    pairs = zip(data.T, model.T, strict=True)
    correlation = sum(signal.correlate(m, d, mode="full", method="fft") for d, m in pairs) / level
    top = int(np.argmax(correlation))
    move = 0.0
    if 0 < top < len(correlation) - 1:
        left, middle, right = correlation[top - 1 : top + 2]
        bend = left - 2.0 * middle + right
        move = 0.5 * (left - right) / bend if bend < 0.0 else 0.0
    return (top + move - (len(data) - 1)) * dt, float(correlation[top])
