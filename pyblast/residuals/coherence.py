"""Which part of a record a linear filter of the simulation explains, by frequency."""

from dataclasses import dataclass

import numpy as np
from scipy import fft, signal

from ..errors import InputError

SIGNIFICANCE = 0.05
WATER = 1e-6
SURELY = 0.999
STEPS = 8


@dataclass(frozen=True, eq=False)
class Transfer:
    """The filter from simulated to recorded motion and how far it explains the record.

    Parameters
    ----------
    frequency : (n,) float64, Hz
    transfer : (..., n) complex128
        Recorded over simulated.
    coherence : (..., n) float64
        Share of the recorded power that the filter explains, 0 to 1.
    chance : float
        Coherence that unrelated motions exceed in 5 % of cases.
    ceiling : (..., n) float64
        Coherence that noise leaves to a record that is explained wholly.
    """

    frequency: np.ndarray
    transfer: np.ndarray
    coherence: np.ndarray
    chance: float
    ceiling: np.ndarray


def transfer(recorded, simulated, dt, band, *, time_bandwidth=4.0, noise_density=None) -> Transfer:
    """Estimate the filter from simulated to recorded motion by Slepian tapers.

    Parameters
    ----------
    recorded, simulated : (..., n_samples) float, m/s
    dt : float, s
    band : tuple of 2 float, Hz
    time_bandwidth : float
        Half-bandwidth times window; twice it less one is the number K of tapers.
    noise_density : function of frequency (n,) to (..., n), (m/s)2/Hz, optional
        Two-sided, of the record, such as `Noise.density`; no noise if not given.

    Raises
    ------
    InputError
        If shapes differ, the tapers are less than two, or wider than the band.

    Notes
    -----
    ``T = sum_k D_k S_k* / (sum_k |S_k|^2 + w)``, Thomson (1982), with w a millionth of the
    largest power; ``chance = 1 - 0.05^(1/(K - 1))``; theory.md (7.21), (7.22).
    """
    recorded, simulated = (np.asarray(each, dtype=float) for each in (recorded, simulated))
    n_tapers, n = int(2.0 * time_bandwidth) - 1, recorded.shape[-1]
    if recorded.shape != simulated.shape:
        raise InputError(f"transfer: shapes differ, {recorded.shape} and {simulated.shape}")
    widest = 0.5 * (band[1] - band[0]) * n * dt
    if n_tapers < 2 or time_bandwidth > widest:
        raise InputError(
            f"transfer.time_bandwidth: must lie between 1.5 and {widest:g} (half the band times "
            f"the window), got {time_bandwidth:g}"
        )
    n_padded = fft.next_fast_len(2 * n, real=True)
    frequency = fft.rfftfreq(n_padded, dt)
    inside = (frequency >= band[0]) & (frequency <= band[1])
    cross, power_d, power_s = 0.0, 0.0, 0.0
    for taper in signal.windows.dpss(n, time_bandwidth, n_tapers):
        data, model = (
            fft.rfft(each * taper, n_padded, axis=-1)[..., inside] for each in (recorded, simulated)
        )
        cross = cross + data * model.conj()
        power_d = power_d + np.abs(data) ** 2
        power_s = power_s + np.abs(model) ** 2
    water = WATER * np.max(power_s, axis=-1, keepdims=True)
    product = power_d * power_s
    coherence = np.divide(np.abs(cross) ** 2, product, np.zeros_like(product), where=product > 0.0)
    ceiling = np.ones_like(coherence)
    if noise_density is not None:
        noise = n_tapers * np.asarray(noise_density(frequency[inside])) / dt
        heard = power_d > 0.0
        ceiling = np.clip(1.0 - np.divide(noise, power_d, np.ones_like(power_d), where=heard), 0, 1)
    filtered = np.divide(cross, power_s + water, np.zeros_like(cross), where=power_s + water > 0.0)
    chance = 1.0 - SIGNIFICANCE ** (1.0 / (n_tapers - 1))
    return Transfer(frequency[inside], filtered, coherence, chance, ceiling)


def delay_and_fading(found: Transfer):
    """Return how much later and more faded the record is than the simulation.

    Parameters
    ----------
    found : Transfer

    Returns
    -------
    delay : (...) float64, s
        Positive where the record is late, ``-(1/2 pi) d phase/df``.
    fading : (...) float64, s
        ``-(1/pi) d ln|T|/df``, the difference of the travel time over Q.

    Notes
    -----
    Straight lines, each frequency weighted by ``c/(1 - c)`` of its coherence c, those below the
    chance level not at all; NaN where fewer than three are above. The delay that makes the phases
    most alike is taken out before the line, so that none is a cycle off; theory.md (7.23). Align
    motions first whose delay is not well below half the window over the time-bandwidth product,
    0.12 s of 1 s: their coherence is lost.
    """
    weight = np.minimum(found.coherence, SURELY)
    weight = np.where(found.coherence > found.chance, weight / (1.0 - weight), 0.0)
    weight = np.where(np.count_nonzero(weight, axis=-1, keepdims=True) < 3, np.nan, weight)
    size = np.abs(found.transfer)
    size = np.where(size > 0.0, size, 1.0)
    reach = 0.5 / (found.frequency[1] - found.frequency[0])
    n = int(np.ceil(STEPS * reach * found.frequency[-1]))
    delays = np.linspace(-reach, reach, 2 * n + 1)
    turns = np.exp(2j * np.pi * np.outer(found.frequency, delays))
    stacked = np.real(np.nan_to_num(weight) * found.transfer / size @ turns)
    coarse = delays[np.argmax(stacked, axis=-1)]
    turned = found.transfer * np.exp(2j * np.pi * coarse[..., None] * found.frequency)
    delay = coarse - _slope(found.frequency, np.angle(turned), weight) / (2.0 * np.pi)
    return delay, -_slope(found.frequency, np.log(size), weight) / np.pi


def _slope(x, y, weight):
    """Return the slope of the weighted straight line through y over x."""
    total = np.sum(weight, axis=-1, keepdims=True)
    away = x - np.sum(weight * x, axis=-1, keepdims=True) / total
    return np.sum(weight * away * y, axis=-1) / np.sum(weight * away**2, axis=-1)
