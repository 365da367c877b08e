"""Which model of noise foretells the noise of windows that it has not seen.

    OMP_NUM_THREADS=1 python -m benchmarks.noise_models [FOLDER]

Writes benchmarks/noise_models.json. FOLDER holds the real recordings, see examples/real/README.md
(default: $PYBLAST_RECORDINGS, else ../shared/recordings). Hits of a hammer, `wghs`: six places,
five hits each, 24 geophones. Each model learns from the first 0.25 s of one or two hits and is
judged on the second 0.25 s of another hit at the same place. The other public recordings have no
window before the event that holds a period of their band.
"""

import json
import os
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from pyblast.inference import records as noises
from pyblast.inference.covariance import whitener
from pyblast.inference.records import band_functions
from pyblast.recordings.recording import read_gather

PAGE = Path(__file__).with_suffix(".json")
PLACES = (range(6, 11), range(11, 16), range(16, 21), range(26, 31), range(31, 36), range(36, 41))
BANDS = ((3.0, 30.0), (10.0, 80.0))
DT, N = 1e-3, 250


def levinson(order):
    """Return the product's way with another order."""

    def learn(windows, band):
        kept, noises.ORDER = noises.ORDER, order
        try:
            return noises.noise_of(windows, DT, band)
        finally:
            noises.ORDER = kept

    return learn


def white(windows, band):
    """Return noise without colour, of the variance of the windows."""
    noise = levinson(1)(windows, band)
    variance = np.mean(np.var(windows, axis=-1), axis=0) * DT / noise.step
    return replace(
        noise, coefficients=0.0 * noise.coefficients, variance=variance * noise.inflation,
        correlation=np.tile(np.eye(3), (len(variance), 1, 1)),
    )  # fmt: skip


def burg(order):
    """Return autoregressions by Burg's recursion on windows averaged over each step."""

    def learn(windows, band):
        noise = levinson(order)(windows, band)
        every = max(1, round(noise.step / DT))
        n = windows.shape[-1] // every
        thin = windows[..., : n * every].reshape(*windows.shape[:3], n, every).mean(axis=-1)
        coefficients, variance = np.zeros_like(noise.coefficients), np.empty_like(noise.variance)
        for channel in np.ndindex(variance.shape):
            found = _burg(thin[(slice(None), *channel)], order)
            coefficients[channel], variance[channel] = found
        return replace(
            noise, step=every * DT, coefficients=coefficients, variance=variance * noise.inflation,
            correlation=np.tile(np.eye(3), (len(variance), 1, 1)),
        )  # fmt: skip

    return learn


def _burg(windows, order):
    """Return coefficients and variance of windows (n_windows, n)."""
    windows = windows - windows.mean(axis=-1, keepdims=True)
    forward, backward, found = windows, windows, np.zeros(0)
    variance = np.mean(windows**2)
    for _ in range(order):
        ahead, behind = forward[:, 1:], backward[:, :-1]
        turn = 2.0 * np.sum(ahead * behind) / np.sum(ahead**2 + behind**2)
        found = np.append(found - turn * found[::-1], turn)
        forward, backward = ahead - turn * behind, behind - turn * ahead
        variance *= 1.0 - turn**2
    return found, variance


MODELS = {
    "white": white, "Levinson 2": levinson(2), "Levinson 4": levinson(4),
    "Levinson 8": levinson(8), "Levinson 12": levinson(12), "Burg 4": burg(4), "Burg 8": burg(8),
}  # fmt: skip


def judge(learn, windows, band, taught):
    """Return log likelihood for each channel and mean square of what is whitened."""
    functions = band_functions(N, DT, band)
    likelihood, square = [], []
    for place in windows:
        for hit in range(len(place)):
            before = np.roll(place, -hit - 1, axis=0)[:taught, ..., :N]
            noise = learn(before, band)
            alone = replace(noise, correlation=np.tile(np.eye(3), (8, 1, 1)))
            judged = whitener(alone, functions, 1)
            after = place[hit : hit + 1, ..., N:]
            likelihood.append(judged.log_likelihood(after) / 24.0)
            square.append(judged.chi_square(after) / judged.n_data)
    return float(np.mean(likelihood)), float(np.mean(square)), float(np.median(square))


def main():
    """Judge each model and write the page."""
    beside = Path(__file__).parents[2] / "shared" / "recordings"
    named = sys.argv[1] if len(sys.argv) > 1 else os.environ.get("PYBLAST_RECORDINGS", beside)
    folder = Path(named) / "wghs"
    windows = [
        [read_gather(folder / f"{hit}.dat").data[:, : 2 * N].reshape(8, 3, -1) for hit in place]
        for place in PLACES
    ]
    windows = np.array(windows)
    windows -= windows.mean(axis=-1, keepdims=True)
    rows = []
    for band in BANDS:
        for taught in (1, 2):
            for name, learn in MODELS.items():
                likelihood, mean, median = judge(learn, windows, band, taught)
                rows.append(
                    {
                        "band_hz": band, "windows": taught, "model": name,
                        "log_likelihood": round(likelihood, 2),
                        "mean_square": round(mean, 2), "median_square": round(median, 2),
                    }
                )  # fmt: skip
                print(rows[-1])
    PAGE.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
