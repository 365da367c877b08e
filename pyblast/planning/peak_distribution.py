"""Distribution of the peaks of a planned blast under firing-time and charge scatter."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats

from ..errors import InputError
from ..runs.blast_ensemble import BlastSpectra

FARTHEST = 4.0  # standard deviations; what lies beyond, 6 in 10^5, is put there


@dataclass(frozen=True)
class FiringScatter:
    """How holes differ from their plan, and how well that is known.

    Parameters
    ----------
    delay : float, s
        Standard deviation of each time: below 0.1 ms for electronic detonators.
    delay_share : float
        The same as a share of the planned time: 0.01 to 0.03 for pyrotechnic ones.
    charge : float
        Standard deviation of the logarithm of the strength of each hole.
    blast : float
        The same of a factor that all holes of a blast share.
    doubt : float
        Standard deviation of the logarithm of the first three, drawn anew for each blast: 0 where
        they were measured, 0.5 where only their order is known.
    """

    delay: float = 0.0
    delay_share: float = 0.0
    charge: float = 0.0
    blast: float = 0.0
    doubt: float = 0.0

    def __post_init__(self):
        """Check the fields once."""
        for name, value in vars(self).items():
            if not 0.0 <= value < math.inf:
                raise InputError(f"firing scatter: {name} must not be negative, got {value:g}")

    def drawn(
        self, times: ArrayLike, n_blasts: int, seed: int, scales: ArrayLike = 1.0
    ) -> tuple[np.ndarray, np.ndarray]:
        """Draw blasts around a plan; theory.md (13.6).

        Parameters
        ----------
        times : (n_holes,) float, s
        n_blasts : int
        seed : int
            The same seed draws the same deviations for any plan.
        scales : float or (n_holes,) float

        Returns
        -------
        times, scales : (n_blasts, n_holes) float64
        """
        generator, times = np.random.default_rng(seed), np.asarray(times, dtype=float)
        deviations = generator.standard_normal((n_blasts, 2 * len(times) + 3))
        deviations = np.clip(deviations, -FARTHEST, FARTHEST)
        late, strong = np.split(deviations[:, 3:], 2, axis=1)
        unsure = np.exp(self.doubt * deviations[:, :2])
        sigma = unsure[:, :1] * np.hypot(self.delay, self.delay_share * times)
        factor = unsure[:, 1:] * self.charge * strong + self.blast * deviations[:, 2:3]
        return times + sigma * late, np.asarray(scales) * np.exp(factor)

    def reach(self, times: ArrayLike) -> tuple[float, float]:
        """Return the earliest and the latest time in s that can be drawn for a plan."""
        times = np.asarray(times, dtype=float)
        most = math.exp(FARTHEST * self.doubt) * FARTHEST
        far = most * np.hypot(self.delay, self.delay_share * times)
        return float(np.min(times - far)), float(np.max(times + far))


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

    def coverage(self, peaks: np.ndarray, share: float) -> float:
        """Return how many of some other peaks (n_others, n_receivers) lie in the band."""
        low, high = self.band(share)
        return float(np.mean((peaks >= low) & (peaks <= high)))


def peak_bands(
    spectra: BlastSpectra,
    times: ArrayLike,
    scatter: FiringScatter,
    *,
    scales: ArrayLike = 1.0,
    n_blasts: int = N_BLASTS,
    seed: int = 0,
    quantity: str = "ppv",
) -> PeakBands:
    """Simulate the peaks of a plan by Monte Carlo draws of times and charges.

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


def drawn_peaks(
    spectra: BlastSpectra,
    times: ArrayLike,
    scatter: FiringScatter,
    scales: ArrayLike,
    n_blasts: int,
    seed: int,
    quantity: str = "ppv",
) -> np.ndarray:
    """Return peaks (n_blasts, n_receivers) in m/s in the order of their drawing."""
    if quantity not in QUANTITIES:
        raise InputError(f'quantity: must be "ppv" or "pvs", got {quantity!r}')
    peaks = spectra.peaks(*scatter.drawn(times, n_blasts, seed, scales))
    return peaks.pvs if quantity == "pvs" else peaks.ppv.max(axis=-1)


def _check_share(share):
    """Refuse a share that is none."""
    if not 0.0 < share < 1.0:
        raise InputError(f"peak bands: share must lie between 0 and 1, got {share:g}")
