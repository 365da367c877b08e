"""Spectra of motion: smoothing, dominant frequency, duration, low-pass, time-frequency misfit."""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy import fft, signal
from scipy.sparse import csr_array

from ..errors import InputError
from .seismogram import Seismogram

BANDWIDTH = 40.0
N_SMOOTHED = 500
PADDING = 16
N_LINES = 400
LOW_PASS = 20.0
MINUS_3_DB = (math.sqrt(2.0) - 1.0) ** 0.125


@dataclass(frozen=True, eq=False)
class Spectrum:
    """Amplitude against frequency, and how it was made.

    ``frequency`` (n,) Hz, ``amplitude`` (n, 3) m/s/Hz, ``definition`` a phrase for captions.
    """

    frequency: np.ndarray
    amplitude: np.ndarray
    definition: str


@dataclass(frozen=True, eq=False)
class Frequency:
    """One frequency per component, ``hz`` (3,) and the definition it follows."""

    hz: np.ndarray
    definition: str


@dataclass(frozen=True, eq=False)
class LowPassed:
    """A low-passed seismogram and what the filter took.

    ``removed_energy`` (3,) is a fraction of the energy, ``ppv_change`` (3,) a fraction of the
    PPV (negative when lower), ``corner`` and ``corner_3db`` the -6 dB and -3 dB points [Hz].
    """

    seismogram: Seismogram
    removed_energy: np.ndarray
    ppv_change: np.ndarray
    corner: float
    corner_3db: float


def amplitude_spectrum(seismogram: Seismogram, n_padded=None) -> Spectrum:
    """Return ``dt |FFT|`` of each component, the mean not removed.

    Parameters
    ----------
    seismogram : Seismogram
    n_padded : int, optional
        Length with zeros appended; the record's own length by default.

    Returns
    -------
    Spectrum
        One-sided, from 0 Hz to Nyquist; in m/s/Hz.
    """
    n = len(seismogram.velocity) if n_padded is None else n_padded
    if n < len(seismogram.velocity):
        raise InputError(
            f"amplitude_spectrum.n_padded: must be at least {len(seismogram.velocity)}, got {n}"
        )
    amplitude = seismogram.dt * np.abs(fft.rfft(seismogram.velocity, n, axis=0))
    return Spectrum(fft.rfftfreq(n, seismogram.dt), amplitude, "amplitude spectrum")


def smoothed_spectrum(seismogram: Seismogram, bandwidth=BANDWIDTH) -> Spectrum:
    """Smooth the amplitude spectrum with Konno-Ohmachi windows.

    Parameters
    ----------
    seismogram : Seismogram
    bandwidth : float
        Konno and Ohmachi's b; larger is less smooth.

    Returns
    -------
    Spectrum
        At 500 centres, equally spaced in log f from one cycle per record to Nyquist.

    Notes
    -----
    The mean is removed and the record padded with zeros to 16 times its length before the
    transform: with fewer frequencies the narrow windows at a few cycles per record make stairs.
    Windows that hold many frequencies take every second, third ... eighth. Each window sums to
    one, so a flat spectrum stays flat. Konno and Ohmachi (1998).
    """
    if not bandwidth > 0.0:
        raise InputError(f"smoothed_spectrum.bandwidth: must be positive, got {bandwidth:g}")
    centred = _without_mean(seismogram)
    n_padded = fft.next_fast_len(PADDING * len(centred.velocity), real=True)
    raw = amplitude_spectrum(centred, n_padded)
    centres, windows = _smoothing(n_padded, centred.dt, centred.duration, bandwidth)
    amplitude = windows @ raw.amplitude
    definition = f"Konno-Ohmachi smoothed spectrum, b = {bandwidth:g}"
    return Spectrum(centres, amplitude, f"{definition}, zero-padded {PADDING} times")


@lru_cache(maxsize=8)
def _smoothing(n_padded, dt, duration, bandwidth):
    """Return centres (500,) in Hz and the windows around them, sparse (500, n_frequencies)."""
    from obspy.signal.konnoohmachismoothing import konno_ohmachi_smoothing_window  # slow to load

    frequency = fft.rfftfreq(n_padded, dt)
    centres = np.geomspace(1.0 / duration, frequency[-1], N_SMOOTHED)
    reach = 10.0 ** (3.0 * math.pi / bandwidth)
    first = np.searchsorted(frequency, centres / reach)
    last = np.maximum(np.searchsorted(frequency, centres * reach), first + 1)
    strides = np.clip((last - first) // N_LINES, 1, PADDING // 2)
    near = [np.arange(*ends) for ends in zip(first, last, strides, strict=True)]
    weight = [
        konno_ohmachi_smoothing_window(frequency[some], centre, bandwidth, normalize=True)
        for some, centre in zip(near, centres, strict=True)
    ]
    ends = np.cumsum([0, *map(len, near)])
    shape = (N_SMOOTHED, len(frequency))
    return centres, csr_array((np.concatenate(weight), np.concatenate(near), ends), shape)


def multitaper_spectrum(seismogram: Seismogram, time_bandwidth=4.0) -> Spectrum:
    """Average the spectra of the record under orthogonal (Slepian) tapers.

    Parameters
    ----------
    seismogram : Seismogram
    time_bandwidth : float
        Half-bandwidth times record length; 2 NW - 1 tapers, seven by default.

    Returns
    -------
    Spectrum
        At the FFT's frequencies, at the level of ``amplitude_spectrum`` for motion that fills
        the record; the mean is removed first. Thomson (1982), equal weights.
    """
    centred = _without_mean(seismogram)
    n = len(centred.velocity)
    n_tapers = int(2.0 * time_bandwidth) - 1
    if n_tapers < 1 or time_bandwidth >= n / 2.0:
        raise InputError(
            f"multitaper_spectrum.time_bandwidth: must lie between 1 and {n / 2:g}, "
            f"got {time_bandwidth:g}"
        )
    tapers = signal.windows.dpss(n, time_bandwidth, n_tapers)
    tapered = tapers[:, :, None] * centred.velocity
    power = np.mean(np.abs(fft.rfft(tapered, axis=1)) ** 2, axis=0)
    return Spectrum(
        fft.rfftfreq(n, centred.dt),
        centred.dt * np.sqrt(n * power),
        f"multitaper spectrum, NW = {time_bandwidth:g}, {n_tapers} tapers",
    )


def dominant_frequency(seismogram: Seismogram, method="smoothed", band=None) -> Frequency:
    """Find the peak of the spectrum of each component.

    Parameters
    ----------
    seismogram : Seismogram
    method : str
        "smoothed" (Konno-Ohmachi, b = 40, of the record padded with zeros to 16 times its
        length), "multitaper" or "raw".
    band : tuple of 2 float, Hz, optional
        Where to look; from one cycle per record to Nyquist by default.

    Returns
    -------
    Frequency
        Refined by a parabola through three points; NaN for a missing or silent component.

    Raises
    ------
    InputError
        If the method is unknown or the band holds no frequency of the spectrum.
    """
    makers = {
        "smoothed": smoothed_spectrum,
        "multitaper": multitaper_spectrum,
        "raw": lambda record: amplitude_spectrum(_without_mean(record)),
    }
    if method not in makers:
        raise InputError(f"dominant_frequency.method: one of {', '.join(makers)}, got {method!r}")
    spectrum = makers[method](seismogram)
    low, high = band or (1.0 / seismogram.duration, math.inf)
    inside = np.flatnonzero((spectrum.frequency >= low) & (spectrum.frequency <= high))
    inside = inside[spectrum.frequency[inside] > 0.0]
    if len(inside) == 0:
        raise InputError(
            f"dominant_frequency.band: no frequency of the spectrum lies in {low:g} to {high:g} Hz"
        )
    hz = [_peak(spectrum.frequency, column, inside) for column in spectrum.amplitude.T]
    return Frequency(np.array(hz), f"peak of the {spectrum.definition}")


def zero_crossing_frequency(seismogram: Seismogram) -> Frequency:
    """Return ``1 / (2 T)`` with T between the zero crossings on both sides of the peak.

    The raw samples are taken, crossings interpolated; what blast seismographs print. NaN where
    the motion does not cross zero on both sides.
    """
    hz = [_crossing(column, seismogram.dt) for column in seismogram.velocity.T]
    return Frequency(np.array(hz), "zero crossing at the peak")


def significant_duration(seismogram: Seismogram, low=0.05, high=0.95):
    """Return the time from ``low`` to ``high`` of the energy of each component, (3,) s.

    NaN for a missing or silent component; the mean is not removed. Trifunac and Brady (1975).
    """
    if not 0.0 <= low < high <= 1.0:
        raise InputError(f"significant_duration: need 0 <= low < high <= 1, got {low:g}, {high:g}")
    duration = np.full(3, np.nan)
    for n in np.flatnonzero(seismogram.present):
        energy = np.concatenate([[0.0], np.cumsum(seismogram.velocity[:, n] ** 2)])
        if energy[-1] > 0.0:
            edges = np.arange(len(energy)) * seismogram.dt
            start, stop = np.interp([low, high], energy / energy[-1], edges)
            duration[n] = stop - start
    return duration


def lowpass(seismogram: Seismogram, corner=LOW_PASS) -> LowPassed:
    """Low-pass without phase shift and say how much energy and PPV went.

    Parameters
    ----------
    seismogram : Seismogram
    corner : float, Hz
        Butterworth of order 4 forward and backward: -6 dB here, -3 dB at 0.896 of it.

    Returns
    -------
    LowPassed
        The removed energy is ``sum (v - v_low)^2 / sum v^2``.
    """
    passed = seismogram.lowpassed(corner)
    with np.errstate(invalid="ignore", divide="ignore"):
        removed = np.sum((seismogram.velocity - passed.velocity) ** 2, axis=0)
        removed = removed / np.sum(seismogram.velocity**2, axis=0)
        change = passed.ppv / seismogram.ppv - 1.0
    return LowPassed(passed, removed, change, corner, MINUS_3_DB * corner)


def _without_mean(seismogram):
    """Take the mean off each component."""
    velocity = seismogram.velocity - np.mean(seismogram.velocity, axis=0)
    return Seismogram(velocity, seismogram.dt, seismogram.start)


def _peak(frequency, amplitude, inside):
    """Frequency of the largest amplitude, refined where a neighbour exists on both sides."""
    if not np.max(amplitude[inside]) > 0.0:
        return math.nan
    top = inside[np.argmax(amplitude[inside])]
    if not 0 < top < len(amplitude) - 1:
        return float(frequency[top])
    left, middle, right = amplitude[top - 1 : top + 2]
    bend = left - 2.0 * middle + right
    move = 0.5 * (left - right) / bend if bend < 0.0 else 0.0
    step = frequency[top + 1] if move > 0.0 else frequency[top - 1]
    return float(frequency[top] + abs(np.clip(move, -0.5, 0.5)) * (step - frequency[top]))


def _crossing(column, dt):
    """Zero-crossing frequency of one component."""
    top = int(np.argmax(np.abs(column)))
    side = column * np.sign(column[top])
    before, after = np.flatnonzero(side[:top] <= 0.0), np.flatnonzero(side[top:] <= 0.0)
    if len(before) == 0 or len(after) == 0 or not side[top] > 0.0:
        return math.nan
    left, right = before[-1], top + after[0]
    start = left + side[left] / (side[left] - side[left + 1])
    stop = right - side[right] / (side[right] - side[right - 1])
    return 1.0 / (2.0 * dt * (stop - start))


N_WAVELETS = 40
WAVELET = 6.0
TF_CYCLES = 3.0
TF_TOP = 0.4


def wavelet_transform(motion, dt, band=None):
    """Return the Morlet transform of motion (n_samples,), (40, n_samples) complex.

    Over the band, or from three cycles per record to 0.8 of Nyquist; obspy's transform, w0 = 6.
    """
    from obspy.signal import tf_misfit  # slow to load

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
