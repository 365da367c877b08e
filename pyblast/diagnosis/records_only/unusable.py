"""Channels and samples that no physics explains: dead ones, and those at a converter's end."""

import numpy as np

from ...records.device_values import at_level, is_dead, plateau_level
from .verdict import Verdict


def unusable(data) -> tuple[Verdict, Verdict]:
    """Find what must be masked before anything is diagnosed.

    Parameters
    ----------
    data : (n_channels, n_samples) float

    Returns
    -------
    tuple of two Verdict
        "saturation" (``target`` holds pairs of channel and sample) and "dead_channel" (channels).

    Notes
    -----
    A full scale found in one channel holds for all: they share a converter.
    """
    data = np.asarray(data, dtype=float)
    dead = tuple(int(c) for c in np.flatnonzero([is_dead(samples) for samples in data]))
    levels = [level for level in map(plateau_level, data) if level is not None]
    marks = np.zeros(data.shape, bool)
    for level in levels:
        marks |= at_level(np.abs(data), level)
    samples = tuple((int(c), int(n)) for c, n in np.argwhere(marks))
    level = {"full_scale": (max(levels), min(levels), max(levels))} if levels else {}
    return (
        Verdict(
            "NAMED" if samples else "NULL", "saturation",
            f"{len(samples)} samples stand at full scale" if samples else "no plateau at the ends",
            samples, level,
        ),
        Verdict(
            "NAMED" if dead else "NULL", "dead_channel",
            f"{len(dead)} channels never move" if dead else "all channels move", dead,
        ),
    )  # fmt: skip


def masked(data):
    """Return data with what is unusable as NaN."""
    clipped, dead = unusable(data)
    data = np.array(data, dtype=float)
    for channel, sample in clipped.target:
        data[channel, sample] = np.nan
    data[list(dead.target)] = np.nan
    return data
