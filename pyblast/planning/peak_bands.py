"""Peaks of a planned blast as bands, by thousands of blasts that differ as holes do."""

from dataclasses import dataclass

import numpy as np
from scipy import stats

from ..ensembles.scatter import BlastSpectra
from ..errors import InputError
from .firing_scatter import FiringScatter

N_BLASTS = 10_000
QUANTITIES = ("ppv", "pvs")


@dataclass(frozen=True, eq=False)
class PeakBands:
    """Peaks of many blasts of one plan.

    Parameters
    ----------
    receivers : tuple of str
    peaks : (n_blasts, n_receivers) float64, m/s
        Rising at each receiver.
    """

    receivers: tuple[str, ...]
    peaks: np.ndarray

    def level(self, share: float) -> np.ndarray:
        """Return what this share of blasts stays below at each receiver, (n_receivers,) m/s."""
        _check_share(share)
        return np.quantile(self.peaks, share, axis=0)

    def band(self, share: float) -> np.ndarray:
        """Return what holds this share of blasts, as many above as below, (2, n_receivers) m/s."""
        _check_share(share)
        return np.quantile(self.peaks, [0.5 - 0.5 * share, 0.5 + 0.5 * share], axis=0)

    def level_interval(self, share: float, sure: float = 0.9) -> np.ndarray:
        """Return where the level lies for all that so few blasts tell, (2, n_receivers) m/s."""
        _check_share(share)
        n = len(self.peaks)
        ranks = stats.binom.ppf([0.5 - 0.5 * sure, 0.5 + 0.5 * sure], n, share).astype(int)
        return self.peaks[np.clip(ranks - [1, 0], 0, n - 1)]  # the first counts from one

    def coverage(self, peaks, share: float) -> float:
        """Return how many of some other peaks (n_others, n_receivers) lie in the band."""
        low, high = self.band(share)
        return float(np.mean((peaks >= low) & (peaks <= high)))


def peak_bands(
    spectra: BlastSpectra,
    times,
    scatter: FiringScatter,
    *,
    scales=1.0,
    n_blasts: int = N_BLASTS,
    seed: int = 0,
    quantity: str = "ppv",
) -> PeakBands:
    """Fire a plan many times on paper.

    Parameters
    ----------
    spectra : BlastSpectra
        Of `blast_spectra` or `signature_spectra`; its times must reach as far as
        ``scatter.reach(times)``.
    times : (n_holes,) float, s
    scatter : FiringScatter
    scales : float or (n_holes,) float
    n_blasts, seed : int
    quantity : str
        "ppv", the largest component, or "pvs", the vector at one instant.

    Returns
    -------
    PeakBands

    Raises
    ------
    InputError
        If the quantity is unknown, or times lie outside those of the spectra.
    """
    peaks = drawn_peaks(spectra, times, scatter, scales, n_blasts, seed, quantity)
    return PeakBands(tuple(one.name for one in spectra.receivers), np.sort(peaks, axis=0))


def drawn_peaks(spectra, times, scatter, scales, n_blasts, seed, quantity="ppv"):
    """Return peaks (n_blasts, n_receivers) in m/s in the order of their drawing."""
    if quantity not in QUANTITIES:
        raise InputError(f'quantity: must be "ppv" or "pvs", got {quantity!r}')
    peaks = spectra.peaks(*scatter.drawn(times, n_blasts, seed, scales))
    return peaks.pvs if quantity == "pvs" else peaks.ppv.max(axis=-1)


def _check_share(share):
    """Refuse a share that is none."""
    if not 0.0 < share < 1.0:
        raise InputError(f"peak bands: share must lie between 0 and 1, got {share:g}")
