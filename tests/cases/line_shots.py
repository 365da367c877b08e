"""Shots along a line of receivers, of one wave and noise, and what may be wrong with one."""

from dataclasses import replace

import numpy as np

from pyblast.line_records.shots import ShotGather, shifted

DT, N, PLACES = 1e-3, 600, 2.0 * np.arange(24)
FREQUENCY = np.fft.rfftfreq(2 * N, DT)


def shot(source, speeds, band, seed, noise=0.05):
    """Make a shot of one wave, ``speeds`` at FREQUENCY, with noise of the same band and less."""
    rng = np.random.default_rng(seed)
    offsets = np.abs(PLACES - source)
    inside = np.exp(-((np.log(np.maximum(FREQUENCY, 1.0) / np.sqrt(band[0] * band[1]))) ** 2))
    turns = np.exp(-2j * np.pi * FREQUENCY * (offsets[:, None] / speeds + 0.05))
    motion = np.fft.irfft(inside * turns)[:, :N]
    motion += noise * motion.std() * rng.normal(size=motion.shape)
    return ShotGather(motion, PLACES, source, offsets, DT, -0.05, np.arange(24))


def ground(n_each=3, **changes):
    """Make shots from both ends, 200 m/s."""
    return [shot(source, 200.0, (10.0, 60.0), n, **changes)
            for n, source in enumerate([-5.0, 51.0] * n_each)]  # fmt: skip


def tampered(shots, *, flip=None, late=0.0, moved=0.0):
    """Tamper with receiver 9."""
    made = []
    for one in shots:
        motion, places = one.motion.copy(), one.places.copy()
        motion[9] = shifted(motion[9], late, DT) * (-1.0 if flip else 1.0)
        places[9] -= moved
        made.append(replace(one, motion=motion, places=places))
    return made
