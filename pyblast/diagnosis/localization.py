"""Where a simulation and its records differ: receivers, components, times, frequencies, ground."""

import numpy as np
from scipy import signal

from ..inference.records import COMPONENTS
from ..project.flat_box import extent_of
from .calibration import Baseline
from .forward import surface_speed
from .search import means, worst
from .thresholds import MATERIAL

SHARE = 0.8  # of the energy of a residual lies in its windows
GRID = 25  # points along the longer side of the plan
NEARLY = 0.9  # of the largest stack, above which a place is no worse


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
        "points": scattering_points(baseline, band.restore(held), size),
    }  # fmt: skip


def _window(axis, energy):
    """Return the window that holds most of an energy, its ends losing the same."""
    share = np.cumsum(energy) / max(np.sum(energy), 1e-300)
    ends = np.searchsorted(share, [0.5 - SHARE / 2, 0.5 + SHARE / 2])
    return [round(float(axis[min(end, len(axis) - 1)]), 4) for end in ends]


def scattering_points(baseline: Baseline, residual, size) -> list[dict]:
    """Find the place in plan that a residual comes from: a stack over places and times.

    Parameters
    ----------
    baseline : Baseline
    residual : (n_blasts, n_receivers, 3, n_samples) float64, m/s
        In the band that is compared.
    size : (n_blasts, n_receivers) float64
        Mean squares of the whitened residuals.

    Returns
    -------
    list of dict
        The best point: ``x``, ``y`` in m, ``coherence`` (0 to 1), ``resolution_m``: the width
        of the stack where it is within a tenth of its largest. None where receivers in a wrong
        order do as well.

    Notes
    -----
    Of the blast that is explained worst. Envelopes, less what small errors leave, are stacked as
    they would come from a point on top at one time, whichever fits best: with the S speed of the
    uppermost ground, and smaller with distance. The time of origin is left open, so that neither
    source nor path need be known: a scatterer, a hole or a shot of somebody else.
    """
    case, project = baseline.case, baseline.project
    b = int(np.argmax(means(size, 1)))
    excess = np.sqrt(np.maximum(1.0 - 1.0 / np.maximum(size[b], 1.0), 0.0))
    envelope = np.sqrt(np.sum(np.abs(signal.hilbert(residual[b])) ** 2, axis=1)) * excess[:, None]
    if not envelope.any():
        return []
    speed = surface_speed(project)
    places = {r.name: np.array(r.position) for r in project.receivers}
    at = np.array([places[name] for name in case.receivers])
    (x0, x1), (y0, y1) = extent_of(project)[:2]
    spacing = max(x1 - x0, y1 - y0) / GRID
    x, y = np.arange(x0, x1 + spacing, spacing), np.arange(y0, y1 + spacing, spacing)
    points = np.stack([*np.meshgrid(x, y, indexing="ij"), np.zeros((len(x), len(y)))], axis=-1)
    way = np.linalg.norm(points[:, :, None] - at, axis=-1)
    lag = np.rint(way / speed / case.dt).astype(int)
    wave = speed / np.sqrt(case.band.low * case.band.high)
    share = 1.0 / (way + 0.5 * wave)
    share /= np.linalg.norm(share, axis=-1, keepdims=True)
    orders = [np.roll(np.arange(len(at)), k) for k in range(len(at))]
    stacks = [_stacked(envelope[order], lag, share) for order in orders]
    stack = stacks[0] / np.linalg.norm(envelope.max(axis=1))
    if stacks[0].max() <= max((one.max() for one in stacks[1:]), default=np.inf):
        return []
    best = np.unravel_index(np.argmax(stack), stack.shape)
    width = spacing * np.sqrt(np.count_nonzero(stack >= NEARLY * stack[best]))
    return [
        {
            "x": round(float(x[best[0]]), 1),
            "y": round(float(y[best[1]]), 1),
            "coherence": round(float(stack[best]), 3),
            "resolution_m": round(float(width), 1),
        }
    ]


def _stacked(envelope, lag, share):
    """Return the largest sum over time (nx, ny) of envelopes (n_receivers, n_samples).

    Each is taken ``lag`` samples later and by its ``share``, (nx, ny, n_receivers).
    """
    times = np.arange(envelope.shape[1])
    later = np.pad(envelope, ((0, 0), (0, int(lag.max()))))
    sums = np.zeros((*lag.shape[:2], len(times)))
    for r, one in enumerate(later):
        sums += share[:, :, r, None] * one[lag[:, :, r, None] + times]
    return sums.max(axis=-1)
