"""Spectra of motion: smoothing, dominant frequency, duration, filters, time-frequency misfit."""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy

from ..errors import InputError
from .seismogram import Seismogram, fast_length

BANDWIDTH = 40.0  # b of Konno and Ohmachi
N_SMOOTHED = 500  # centre frequencies
PADDING = 16  # length of the transform over that of the record
N_LINES = 400  # frequencies in a smoothing window beyond which some are skipped
LOW_PASS = 20.0  # Hz


@dataclass(frozen=True, eq=False)
class Spectrum:
    """Amplitude spectrum, with its definition.

    Parameters
    ----------
    frequency : (n,) float64, Hz
    amplitude : (n, 3) float64, m/s/Hz
    definition : str
        For captions.
    """

    frequency: np.ndarray
    amplitude: np.ndarray
    definition: str


@dataclass(frozen=True, eq=False)
class Frequency:
    """Frequency of each component, ``hz`` (3,), with its definition."""

    hz: np.ndarray
    definition: str


@dataclass(frozen=True, eq=False)
class LowPassed:
    """Low-passed seismogram, with the removed energy and the change of the peak.

    Parameters
    ----------
    seismogram : Seismogram
    removed_energy : (3,) float64
        Fraction of the energy of each component.
    ppv_change : (3,) float64
        Relative change of PPV, negative when lower.
    corner : float, Hz
        -3 dB point of the filter.
    """

    seismogram: Seismogram
    removed_energy: np.ndarray
    ppv_change: np.ndarray
    corner: float


def amplitude_spectrum(seismogram: Seismogram, n_padded: int | None = None) -> Spectrum:
    """Return the amplitude spectrum ``dt |FFT|`` of each component; the mean is not removed.

    Parameters
    ----------
    seismogram : Seismogram
    n_padded : int, optional
        Length including appended zeros; that of the record by default.

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
    amplitude = seismogram.dt * np.abs(np.asarray(scipy.fft.rfft(seismogram.velocity, n, axis=0)))
    return Spectrum(scipy.fft.rfftfreq(n, seismogram.dt), amplitude, "amplitude spectrum")


def smoothed_spectrum(seismogram: Seismogram, bandwidth: float = BANDWIDTH) -> Spectrum:
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
    transform: otherwise the narrow windows at a few cycles per record contain too few frequencies.
    Wide windows use every second, third ... eighth frequency. Each window sums to one, so a flat
    spectrum stays flat. Konno and Ohmachi (1998).
    """
    if not bandwidth > 0.0:
        raise InputError(f"smoothed_spectrum.bandwidth: must be positive, got {bandwidth:g}")
    centred = _without_mean(seismogram)
    n_padded = fast_length(PADDING * len(centred.velocity))
    raw = amplitude_spectrum(centred, n_padded)
    centres, windows = _smoothing(n_padded, centred.dt, centred.duration, bandwidth)
    amplitude = windows @ raw.amplitude
    definition = f"Konno-Ohmachi smoothed spectrum, b = {bandwidth:g}"
    return Spectrum(centres, amplitude, f"{definition}, zero-padded {PADDING} times")


@lru_cache(maxsize=8)
def _smoothing(n_padded, dt, duration, bandwidth):
    """Return centres (500,) in Hz and the windows around them, sparse (500, n_frequencies)."""
    frequency = scipy.fft.rfftfreq(n_padded, dt)
    centres = np.geomspace(1.0 / duration, frequency[-1], N_SMOOTHED)
    reach = 10.0 ** (3.0 * math.pi / bandwidth)
    first = np.searchsorted(frequency, centres / reach)
    last = np.maximum(np.searchsorted(frequency, centres * reach), first + 1)
    strides = np.clip((last - first) // N_LINES, 1, PADDING // 2)
    near = [np.arange(*ends) for ends in zip(first, last, strides, strict=True)]
    weight = [
        _window(frequency[window], centre, bandwidth)
        for window, centre in zip(near, centres, strict=True)
    ]
    ends = np.cumsum([0, *map(len, near)])
    shape = (N_SMOOTHED, len(frequency))
    return centres, scipy.sparse.csr_array(
        (np.concatenate(weight), np.concatenate(near), ends), shape
    )


def _window(frequency, centre, bandwidth):
    """Return the weights (n,) of frequencies around a centre: (sin x / x)^4, x = b log10 f/c."""
    weight = np.where(frequency == centre, 1.0, 0.0)
    other = (frequency > 0.0) & (frequency != centre)
    x = bandwidth * np.log10(frequency[other] / centre)
    weight[other] = (np.sin(x) / x) ** 4
    return weight / weight.sum()


def multitaper_spectrum(seismogram: Seismogram, time_bandwidth: float = 4.0) -> Spectrum:
    """Return the multitaper spectrum: mean over orthogonal (Slepian) tapers.

    Parameters
    ----------
    seismogram : Seismogram
    time_bandwidth : float
        Half-bandwidth times record length; 2 NW - 1 tapers, seven by default.

    Returns
    -------
    Spectrum
        At the frequencies of the transform, scaled as ``amplitude_spectrum`` for motion that fills
        the record; the mean is removed. Thomson (1982), equal weights.
    """
    centred = _without_mean(seismogram)
    n = len(centred.velocity)
    n_tapers = int(2.0 * time_bandwidth) - 1
    if n_tapers < 1 or time_bandwidth >= n / 2.0:
        raise InputError(
            f"multitaper_spectrum.time_bandwidth: must lie between 1 and {n / 2:g}, "
            f"got {time_bandwidth:g}"
        )
    tapers = np.asarray(scipy.signal.windows.dpss(n, time_bandwidth, n_tapers))
    tapered = tapers[:, :, None] * centred.velocity
    power = np.mean(np.abs(np.asarray(scipy.fft.rfft(tapered, axis=1))) ** 2, axis=0)
    return Spectrum(
        scipy.fft.rfftfreq(n, centred.dt),
        centred.dt * np.sqrt(n * power),
        f"multitaper spectrum, NW = {time_bandwidth:g}, {n_tapers} tapers",
    )


def dominant_frequency(
    seismogram: Seismogram, method: str = "smoothed", band: tuple[float, float] | None = None
) -> Frequency:
    """Return the dominant frequency of each component: the peak of its spectrum.

    Parameters
    ----------
    seismogram : Seismogram
    method : str
        "smoothed" (Konno-Ohmachi, b = 40, of the record padded with zeros to 16 times its
        length), "multitaper" or "raw".
    band : tuple of 2 float, Hz, optional
        Range of the search; from one cycle per record to Nyquist by default.

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
    """Return the zero-crossing frequency ``1 / (2 T)``, T between the crossings beside the peak.

    From the raw samples with interpolated crossings, as blast seismographs print it. NaN where the
    motion does not cross zero on both sides.
    """
    hz = [_crossing(column, seismogram.dt) for column in seismogram.velocity.T]
    return Frequency(np.array(hz), "zero crossing at the peak")


def significant_duration(
    seismogram: Seismogram, low: float = 0.05, high: float = 0.95
) -> np.ndarray:
    """Return the significant duration of each component, (3,) s: from ``low`` to ``high`` energy.

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


def late_energy(seismogram: Seismogram, after: float = 1.0) -> np.ndarray:
    """Return the share of the energy of each component that comes after a time in s, (3,).

    NaN for a missing or silent component, and where the record ends earlier: the waves that
    a site holds back count for comfort and fatigue though not for the peak.
    """
    late, share = seismogram.times > after, np.full(3, np.nan)
    energy = (seismogram.velocity**2).sum(axis=0)
    known = seismogram.present & (energy > 0.0) & late.any()
    share[known] = (seismogram.velocity[late] ** 2).sum(axis=0)[known] / energy[known]
    return share


def lowpass(seismogram: Seismogram, corner: float = LOW_PASS) -> LowPassed:
    """Low-pass what a source does, and measure the removed energy and the change of PPV.

    Parameters
    ----------
    seismogram : Seismogram
        Its end leaves room for the filter.
    corner : float, Hz
        Of what a source does: `Seismogram.lowpassed`.

    Returns
    -------
    LowPassed
        The removed energy is ``1 - sum v_low^2 / sum v^2``.
    """
    passed = seismogram.lowpassed(corner, of_source=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        removed = 1.0 - np.sum(passed.velocity**2, axis=0) / np.sum(seismogram.velocity**2, axis=0)
        change = passed.ppv / seismogram.ppv - 1.0
    return LowPassed(passed, removed, change, corner)


def highest_frequency(motion: Seismogram, share: float = 0.95) -> float:
    """Return the frequency in Hz below which a share of the energy of a motion lies."""
    velocity = np.nan_to_num(motion.velocity)
    n_padded = fast_length(4 * len(velocity))  # for finer steps of frequency
    power = (np.abs(np.fft.rfft(velocity, n_padded, axis=0)) ** 2).sum(axis=1)
    frequency = np.fft.rfftfreq(n_padded, motion.dt)
    return float(frequency[np.searchsorted(np.cumsum(power), share * power.sum())])


def _without_mean(seismogram):
    """Subtract the mean of each component."""
    velocity = seismogram.velocity - np.mean(seismogram.velocity, axis=0)
    return Seismogram(velocity, seismogram.dt, seismogram.start)


def _peak(frequency, amplitude, inside):
    """Return the frequency of the largest amplitude, refined by a parabola through three points."""
    if not np.max(amplitude[inside]) > 0.0:
        return math.nan
    top = inside[np.argmax(amplitude[inside])]
    if not 0 < top < len(amplitude) - 1:
        return float(frequency[top])
    before, middle, after = amplitude[top - 1 : top + 2]
    bend = before - 2.0 * middle + after
    move = 0.5 * (before - after) / bend if bend < 0.0 else 0.0
    step = frequency[top + 1] if move > 0.0 else frequency[top - 1]
    return float(frequency[top] + abs(np.clip(move, -0.5, 0.5)) * (step - frequency[top]))


def _crossing(column, dt):
    """Return the zero-crossing frequency of one component."""
    top = int(np.argmax(np.abs(column)))
    side = column * np.sign(column[top])
    before, after = np.flatnonzero(side[:top] <= 0.0), np.flatnonzero(side[top:] <= 0.0)
    if len(before) == 0 or len(after) == 0 or not side[top] > 0.0:
        return math.nan
    first, last = before[-1], top + after[0]
    start = first + side[first] / (side[first] - side[first + 1])
    stop = last - side[last] / (side[last] - side[last - 1])
    return 1.0 / (2.0 * dt * (stop - start))


N_WAVELETS = 40
WAVELET = 6.0
TF_CYCLES = 3.0
TF_TOP = 0.4


def wavelet_transform(
    motion: np.ndarray, dt: float, band: tuple[float, float] | None = None
) -> np.ndarray:
    """Return the Morlet wavelet transform of motion (n_samples,), (40, n_samples) complex.

    Over the band, or from three cycles per record to 0.8 of Nyquist; obspy's transform, w0 = 6.
    """
    from obspy.signal import tf_misfit  # slow to load

    low, high = band or (TF_CYCLES / (dt * len(motion)), TF_TOP / dt)
    return tf_misfit.cwt(motion, dt, WAVELET, low, high, N_WAVELETS)


def envelope_and_phase(reference: np.ndarray, other: np.ndarray) -> tuple[float, float]:
    """Return the single-valued envelope and phase misfit of two wavelet transforms.

    The first is the reference. Kristekova et al. (2009), table 1; theory.md (7.5). The phase
    difference is that of the product with the conjugate: obspy's quotient is undefined where the
    transform vanishes.
    """
    level = np.sum(np.abs(reference) ** 2)
    envelope = np.sum((np.abs(other) - np.abs(reference)) ** 2)
    phase = np.sum((np.abs(reference) * np.angle(other * reference.conj()) / np.pi) ** 2)
    return math.sqrt(envelope / level), math.sqrt(phase / level)


def lag(data: np.ndarray, model: np.ndarray, dt: float) -> tuple[float, float]:
    """Return the lag of the largest cross-correlation of two motions (n_samples, n_components).

    Returns
    -------
    lag : float, s
        Common to all components, refined by a parabola; positive where the model is late.
    correlation : float
        At that lag. Both are NaN where one of the motions is zero.
    """
    level = math.sqrt(np.sum(data**2) * np.sum(model**2))
    if not level > 0.0:
        return math.nan, math.nan
    pairs = zip(data.T, model.T, strict=True)
    correlations = [scipy.signal.correlate(m, d, mode="full", method="fft") for d, m in pairs]
    correlation = np.asarray(sum(correlations)) / level
    top = int(np.argmax(correlation))
    move = 0.0
    if 0 < top < len(correlation) - 1:
        before, middle, after = correlation[top - 1 : top + 2]
        bend = before - 2.0 * middle + after
        move = 0.5 * (before - after) / bend if bend < 0.0 else 0.0
    return (top + move - (len(data) - 1)) * dt, float(correlation[top])
