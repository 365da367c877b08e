"""What becomes of ground motion before it is written down: sensors, air, machines, noise, clocks.

A change is ``(motion, site, blast, times) -> motion`` (n_receivers, 3, n) in m/s.
"""

import numpy as np
from scipy import fft, signal

from .sites import BAND, DT

CALM = 0.7  # exponent by which noise falls with frequency
AIR_DECAY = 1.1  # of the peak with distance


def swinging(at, corner, damping):
    """Return the change by a geophone's swing that a receiver leaves in: corner in Hz."""
    w = 2.0 * np.tan(np.pi * corner * DT) / DT
    taps = signal.bilinear([1.0, 0.0, 0.0], [1.0, 2.0 * damping * w, w**2], 1.0 / DT)

    def change(motion, site, blast, times):
        del site, blast, times
        swung = motion.copy()
        swung[at] = signal.lfilter(*taps, motion[at])
        return swung

    return change


def airborne(speed, length, strength):
    """Return the change by a pulse in the air from each hole, ``strength`` of the median peak."""

    def change(motion, site, blast, times):
        holes, peak = site.blasts[blast], np.median(np.abs(motion).max(axis=(1, 2)))
        pressed, most = np.zeros_like(motion), 0.0
        loud = holes.charges ** (AIR_DECAY / 3.0) * holes.scales
        for place, weight, fired in zip(holes.places, loud, holes.times, strict=True):
            way = site.receivers[:, :2] - place[:2]
            far = np.linalg.norm(way, axis=1)[:, None]
            late = (times - fired - far / speed) / length
            rise = np.sin(np.pi * np.clip(late, 0.0, 1.0)) ** 2
            pulse = weight * (1.0 - 2.0 * np.clip(late, 0.0, 1.0)) * rise * far**-AIR_DECAY
            east, north = (way / far).T[..., None]
            pressed += np.stack([0.3 * east * pulse, 0.3 * north * pulse, -pulse], axis=1)
            most = max(most, float(np.median(np.abs(pulse).max(axis=1))))
        buried = ~np.isnan(site.receivers[:, 2])
        pressed[buried] *= 0.1
        return motion + strength * peak / most * pressed

    return change


def humming(loud, place, frequency, strength, phase):
    """Return the change by a machine at a place in m that runs during one blast."""

    def change(motion, site, blast, times):
        if blast != loud:
            return motion
        far = np.linalg.norm(site.receivers[:, :2] - np.array(place), axis=1)[:, None]
        peak = np.median(np.abs(motion).max(axis=(1, 2)))
        wave = np.sin(2.0 * np.pi * frequency * (times - far / 900.0) + phase)
        size = strength * peak * np.sqrt(50.0 / np.maximum(far, 10.0)) * (times > 0.05)
        return motion + np.array([0.5, 0.4, 1.0])[:, None] * (size * wave)[:, None]

    return change


def coloured(rng, shape, level):
    """Return noise (*shape, n) that is stronger at low frequency.

    Parameters
    ----------
    rng : numpy Generator
    shape : tuple of int
        Receivers, components, samples.
    level : float, m/s
        Its root mean square within the band; receivers differ by 30 %.
    """
    frequency = fft.rfftfreq(shape[-1], DT)
    fall = np.maximum(frequency, 1.0) ** -CALM * (frequency > 0.0)
    white = fft.rfft(rng.normal(size=shape))
    noise = fft.irfft(white * fall, shape[-1])
    size = np.sqrt(np.mean(in_band(noise) ** 2, axis=-1, keepdims=True))
    uneven = np.exp(rng.normal(0.0, 0.3, (shape[0], 1, 1)))
    return level * uneven * noise / size


def in_band(motion):
    """Return motion between the limits of the band, without delay."""
    sections = signal.butter(3, BAND, "band", fs=1.0 / DT, output="sos")
    return signal.sosfiltfilt(sections, motion)


def shares(changed, motion):
    """Return by receiver the energy of what changed over that of the motion, in the band."""
    difference, whole = in_band(changed - motion), in_band(changed)
    return np.sum(difference**2, axis=(1, 2)) / np.sum(whole**2, axis=(1, 2))
