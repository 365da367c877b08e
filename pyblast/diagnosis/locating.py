"""Where a simulation and its records differ: receivers, components, times, frequencies, ground."""

import numpy as np
from scipy import signal

from .calibration import Baseline
from .case import COMPONENTS
from .search import MATERIAL, means, worst

SHARE = 0.8  # of the energy of a residual lies in its windows
GRID = 25  # points along the longer side of the plan
HALF_POWER = 0.5**0.5


def located(baseline: Baseline, motion, size) -> dict:
    """Say where records and a motion differ.

    Parameters
    ----------
    baseline : Baseline
    motion : (n_blasts, n_receivers, 3, n_samples) float64, m/s
    size : (n_blasts, n_receivers) float64
        Mean squares of the whitened residuals.

    Returns
    -------
    dict
        ``largest`` mean size of a receiver or blast, ``receivers`` where it is material,
        ``blasts``, ``components`` by share, ``time_s``, ``frequency_hz``, ``points`` with their
        resolution.
    """
    case = baseline.case
    band = case.band
    held = band.project(np.where(case.valid, case.motion - motion, 0.0))
    weighed = band.restore(held / np.sqrt(np.sum(held**2, axis=(2, 3), keepdims=True) + 1e-300))
    weighed *= np.sqrt(size)[..., None, None]
    by_receiver, by_blast = means(size, 0), means(size, 1)
    energy = np.sum(weighed**2, axis=(0, 1))
    spectrum = np.sum(np.abs(np.fft.rfft(weighed)) ** 2, axis=(0, 1, 2))
    frequency = np.fft.rfftfreq(case.n_samples, case.dt)
    times = np.arange(case.n_samples) * case.dt
    shares = energy.sum(axis=-1) / max(energy.sum(), 1e-300)
    return {
        "largest": round(worst(size), 2),
        "receivers": {
            name: round(float(v), 2) for name, v in zip(case.receivers, by_receiver, strict=True)
            if v >= MATERIAL
        },
        "blasts": {
            name: round(float(v), 2) for name, v in zip(case.blasts, by_blast, strict=True)
        },
        "components": dict(zip(COMPONENTS, np.round(shares, 3).tolist(), strict=True)),
        "time_s": _window(times, energy.sum(axis=0)),
        "frequency_hz": _window(frequency, spectrum),
        "points": scattering_points(baseline, weighed),
    }  # fmt: skip


def _window(axis, energy):
    """Return the window that holds most of an energy, its ends losing the same."""
    share = np.cumsum(energy) / max(np.sum(energy), 1e-300)
    ends = np.searchsorted(share, [0.5 - SHARE / 2, 0.5 + SHARE / 2])
    return [round(float(axis[min(end, len(axis) - 1)]), 4) for end in ends]


def scattering_points(baseline: Baseline, residual) -> list[dict]:
    """Find where in plan one scatterer would send a residual from: a diffraction stack.

    Parameters
    ----------
    baseline : Baseline
    residual : (n_blasts, n_receivers, 3, n_samples) float64

    Returns
    -------
    list of dict
        The best point: ``x``, ``y`` in m, ``coherence`` (0 to 1), ``resolution_m``: the width
        of the stack at -3 dB. None where receivers in a wrong order do as well.

    Notes
    -----
    Envelopes are stacked at the time of an S wave from the first hole to the point and on to each
    receiver, with the speed of the uppermost layer, in the blast of the fewest holes.
    """
    case, site = baseline.case, baseline.site
    counts = [len(site.blasts[name].times) for name in case.blasts]
    b = int(np.argmin(counts))
    envelope = np.sqrt(np.sum(np.abs(signal.hilbert(residual[b])) ** 2, axis=1))
    envelope /= np.maximum(envelope.max(axis=1, keepdims=True), 1e-300)
    speed = site.layers[0][2].cs
    source = site.blasts[case.blasts[b]].centres.mean(axis=0)
    places = {r.name: np.array(r.position) for r in site.receivers}
    at = np.array([places[name] for name in case.receivers])
    (x0, x1), (y0, y1) = site.box[:2]
    spacing = max(x1 - x0, y1 - y0) / GRID
    x, y = np.arange(x0, x1 + spacing, spacing), np.arange(y0, y1 + spacing, spacing)
    points = np.stack([*np.meshgrid(x, y, indexing="ij"), np.zeros((len(x), len(y)))], axis=-1)
    delay = _pulse_peak(site.moment_rate)
    ways = np.linalg.norm(points - source, axis=-1)[..., None]
    ways = ways + np.linalg.norm(points[:, :, None] - at, axis=-1)
    sample = np.clip(np.rint((ways / speed + delay) / case.dt).astype(int), 0, case.n_samples - 1)
    here = np.arange(len(at))
    stacks = [envelope[np.roll(here, k), sample].mean(axis=-1) for k in here]
    stack = stacks[0]
    if stack.max() <= max((one.max() for one in stacks[1:]), default=np.inf):
        return []
    best = np.unravel_index(np.argmax(stack), stack.shape)
    width = spacing * np.sqrt(np.count_nonzero(stack >= HALF_POWER * stack[best]))
    return [
        {
            "x": round(float(x[best[0]]), 1),
            "y": round(float(y[best[1]]), 1),
            "coherence": round(float(stack[best]), 3),
            "resolution_m": round(float(width), 1),
        }
    ]


def _pulse_peak(pulse):
    """Return when a pulse is largest, s."""
    return pulse.start + pulse.dt * float(np.argmax(np.abs(pulse.values)))
