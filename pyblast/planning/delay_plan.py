"""A plan of delays for some houses: the best within limits, beside the one that is there."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..ensembles.scatter import BlastSpectra
from .best_delays import BestDelays, Gain, best_delays, gain
from .firing_scatter import FiringScatter
from .peak_bands import PeakBands, peak_bands


@dataclass(frozen=True, eq=False)
class DelayPlan:
    """Delays that shake houses least, and what they are worth.

    Parameters
    ----------
    limits : (n_houses,) float64, m/s
    before, after : PeakBands
        Of the times that are there, and of the best ones; of blasts that no search has seen.
    best : BestDelays
    gain : Gain
        Of the largest peak over its limit.
    """

    limits: np.ndarray
    before: PeakBands
    after: PeakBands
    best: BestDelays
    gain: Gain

    def kept(self, bands: PeakBands) -> np.ndarray:
        """Return the share of blasts that keep the limit at each house, (n_houses,)."""
        return np.mean(bands.peaks <= self.limits, axis=0)


def plan_delays(
    spectra: BlastSpectra,
    pattern,
    low,
    high,
    scatter: FiringScatter,
    *,
    planned,
    limits,
    step: float,
    share: float,
    scales=1.0,
    allowed: Callable | None = None,
    n_blasts: int,
    seed: int,
) -> DelayPlan:
    """Search delays, then fire the plan that is there and the best one on fresh draws.

    Parameters
    ----------
    spectra, pattern, low, high, scatter, step, limits, share, scales, allowed
        As for `best_delays`.
    planned : (n_holes,) float, s
        Times of the plan that is there.
    n_blasts, seed : int
        Of the bands; the search draws others.

    Raises
    ------
    InputError
        As `best_delays` and `gain`.

    Notes
    -----
    theory.md (13.6), (13.7).
    """
    best = best_delays(
        spectra, pattern, low, high, scatter, step=step, limits=limits, share=share,
        scales=scales, allowed=allowed, seed=seed,
    )  # fmt: skip
    fresh = {"scales": scales, "n_blasts": n_blasts, "seed": seed + 1}
    before, after = (
        peak_bands(spectra, times, scatter, **fresh) for times in (planned, best.times)
    )
    worth = gain(spectra, planned, best.times, scatter, limits=limits, share=share, **fresh)
    return DelayPlan(np.asarray(limits, dtype=float), before, after, best, worth)
