"""Real noise: quiet windows of geophones before hammer blows, joined without a seam."""

import os
from functools import cache
from pathlib import Path

import numpy as np
from scipy import signal

from pyblast.errors import InputError
from pyblast.recordings.recording import read_gather

PLACES = ((6, 11), (11, 16), (16, 21), (26, 31), (31, 36), (36, 41))  # files of one place each
DT, QUIET, SEAM = 1e-3, 500, 60  # s, samples before the blow, samples of a cross-fade


def recordings_folder() -> Path:
    """Return where the real recordings are.

    Raises
    ------
    InputError
        If they are not there.
    """
    beside = Path(__file__).parents[3] / "shared" / "recordings"
    folder = Path(os.environ.get("PYBLAST_RECORDINGS", beside)) / "wghs"
    if not folder.is_dir():
        raise InputError(
            f"noise: {folder} is no folder; set PYBLAST_RECORDINGS to the recordings of "
            "examples/real/README.md"
        )
    return folder


@cache
def quiet_windows():
    """Return windows (n_places, n_blows, n_channels, n_samples), each channel of unit size."""
    folder = recordings_folder()
    windows = np.array(
        [[read_gather(folder / f"{n}.dat").data[:, :QUIET] for n in range(*place)]
         for place in PLACES]
    )  # fmt: skip
    windows = windows - windows.mean(axis=-1, keepdims=True)
    return windows / np.sqrt(np.mean(windows**2, axis=(1, 3), keepdims=True))


def real_noise(rng, shape, n, dt, band):
    """Return noise (*shape, n) of unit mean square in a band, every channel a piece of real noise.

    Parameters
    ----------
    rng : numpy Generator
    shape : tuple of int
    n : int
    dt : float, s
    band : tuple of 2 float, Hz
    """
    windows, every = quiet_windows(), round(dt / DT)
    found = np.empty((*shape, n))
    for at in np.ndindex(*shape):
        blows = windows[rng.integers(len(windows)), :, rng.integers(windows.shape[2])]
        whole = joined(rng.permutation(blows) * rng.choice([-1.0, 1.0], (len(blows), 1)))
        thin = signal.decimate(whole, every, ftype="fir")
        start = rng.integers(len(thin) - n + 1)
        inside = signal.sosfiltfilt(signal.butter(3, band, "band", fs=1.0 / dt, output="sos"), thin)
        found[at] = thin[start : start + n] / np.sqrt(np.mean(inside**2))
    return found


def joined(windows):
    """Return windows (n_windows, n) one after the other, cross-faded so that power stays."""
    rise = np.sin(0.5 * np.pi * (np.arange(SEAM) + 0.5) / SEAM)
    whole = windows[0]
    for window in windows[1:]:
        seam = whole[-SEAM:] * rise[::-1] + window[:SEAM] * rise
        whole = np.concatenate([whole[:-SEAM], seam, window[SEAM:]])
    return whole
