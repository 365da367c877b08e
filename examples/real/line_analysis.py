"""What a line of geophones shows: scale and shift of hits, noise, phase speeds, misfit."""

import numpy as np
from real_line import seismograms
from scipy import fft, signal

from pyblast import compare

N_PADDED, WATER = 2048, 1e-2
NOISE, FINER = (-0.5, -0.02), 16


def with_hammer(recorded, response, nearest):
    """Turn the response to the pulse into that to the hammer, by the nearest geophones."""
    d, g = (fft.rfft(x, N_PADDED) for x in (recorded, response))
    weights = 1.0 / np.sum(recorded[:nearest] ** 2, axis=1)[:, None]
    power = np.sum(weights * np.abs(g[:nearest]) ** 2, axis=0)
    hammer = np.sum(weights * g[:nearest].conj() * d[:nearest], axis=0)
    hammer /= power + WATER * np.max(power)
    return fft.irfft(g * hammer, N_PADDED)[:, : recorded.shape[1]]


def misfit_map(recorded, simulated, dt, bins):
    """Residual over recorded energy by receiver and frequency, (n_receivers, n_bins)."""
    frequency = fft.rfftfreq(N_PADDED, dt)
    place = np.digitize(frequency, bins) - 1
    d, s = (fft.rfft(x, N_PADDED) for x in (recorded, simulated))
    return np.transpose([np.sum(np.abs(d - s)[:, place == b] ** 2, axis=1)
                         / np.sum(np.abs(d)[:, place == b] ** 2, axis=1)
                         for b in range(len(bins) - 1)])  # fmt: skip


def phase_speeds(motion, offsets, dt, frequency):
    """Speed at which the phases of all receivers stack best [m/s]."""
    speeds = np.arange(120.0, 320.0)
    found = fft.rfft(motion, N_PADDED)[:, np.round(frequency * N_PADDED * dt).astype(int)]
    delay = 2j * np.pi * frequency * offsets[:, None] / speeds[:, None, None]
    return speeds[np.argmax(np.abs(np.sum(found / np.abs(found) * np.exp(delay), 1)), axis=0)]


def first_breaks(hits):
    """First time above six times the noise, hits stacked and high-passed, near to far [s]."""
    stack = np.mean([g.data for g in hits], axis=0)[np.argsort(hits[0].offsets)]
    causal = signal.butter(2, 20.0, "highpass", fs=1.0 / hits[0].dt, output="sos")
    stack = signal.sosfilt(causal, stack)
    times = hits[0].times
    noise = np.std(stack[:, (times > -0.4) & (times < -0.02)], axis=1)
    loud = (np.abs(stack) > 6.0 * noise[:, None]) & (times > 0.005)
    return times[np.argmax(loud, axis=1)]


def scale_and_shift(signature, hit, channels, band):
    """Find scale and shift of a hit against the signature, in the band.

    The scale is the ratio of root mean squares: a regression would be too low, because the
    signature also contains noise. Channels are weighted by the inverse of their amplitude.
    """
    s, h = (np.array([r[c].bandpassed(*band).velocity[:, 2] for c in channels])
            for r in (signature, hit))  # fmt: skip
    n = 2 * s.shape[1]
    weights = 1.0 / np.linalg.norm(s, axis=1)
    cross = weights @ (fft.rfft(h, n) * fft.rfft(s, n).conj())
    lags = FINER * fft.irfft(cross, FINER * n)
    lag = int(np.argmax(lags))
    centred = lag if lag < FINER * n // 2 else lag - FINER * n
    scale = np.sqrt((weights @ np.sum(h**2, axis=1)) / (weights @ np.sum(s**2, axis=1)))
    return scale, centred / FINER * signature[0].dt


def noise_misfit(signatures, hits, truth, band):
    """Misfit that the noise before the trigger would cause by itself, by channel."""
    share = 1.0 / (NOISE[1] - NOISE[0])
    noise = [seismograms(g, NOISE) for g in (*signatures, *hits)]
    energy = [sum(share * np.nansum(n[c].bandpassed(*band).velocity ** 2) for n in noise)
              for c in truth]  # fmt: skip
    signal = [np.nansum(t.bandpassed(*band).velocity ** 2) for t, _ in truth.values()]
    return np.array(energy) / signal


def spread(values):
    """Median, and the 5 and 95 percent of everything."""
    return [float(v) for v in np.percentile(values, [50, 5, 95])]


def repeatability(records, band):
    """Scale and shift of every hit against the first of its place, and one hit against another."""
    table = {}
    for place, hits in records.items():
        fits = [scale_and_shift(hits[0], h, range(24), band) for h in hits]
        misfit = [compare(hits[a][c], hits[b][c], band, time_frequency=False).waveform_misfit[2]
                  for a, b in ((0, 1), (2, 3)) for c in range(0, 24, 3)]  # fmt: skip
        table[f"{place:g} m"] = {
            "scale": [float(a) for a, _ in fits],
            "shift_ms": [1e3 * float(t) for _, t in fits],
            "misfit_of_a_pair": spread(misfit),
        }
    return table
