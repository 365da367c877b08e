"""Distribution of a peak, by law, site law, records or run: levels, shares, charges."""

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import ArrayLike

from ..errors import InputError

LEVELS = 101  # of the error of a level
LEVEL = 0.95  # share of further blasts of which a decision is taken


class PeakDistribution(ABC):
    """Distribution of the peaks of further blasts; see `PeaksOfLaw` and `DrawnPeaks`."""

    charge: ArrayLike  # kg within 8 ms, NaN where it is not known
    exponent: float  # power of the charge with which the peak grows

    @abstractmethod
    def level(self, share: float) -> np.ndarray:
        """Return the peak in m/s that this share of further blasts stays below."""

    @abstractmethod
    def share_below(self, limit: ArrayLike) -> np.ndarray:
        """Return the share of further blasts whose peak stays below a limit in m/s."""

    def charge_below(self, limit: float, share: float = LEVEL) -> np.ndarray:
        """Return the charge in kg in 8 ms with which this share stays below a limit in m/s.

        NaN where charge or exponent is not known.
        """
        return self.charge * (limit / self.level(share)) ** (1.0 / self.exponent)

    def band(self, share: float) -> np.ndarray:
        """Return the ends of the central interval of this share of blasts, (2, ...) m/s."""
        check_share(share)
        return np.stack([self.level(0.5 - 0.5 * share), self.level(0.5 + 0.5 * share)])


@dataclass(frozen=True, eq=False)
class PeaksOfLaw(PeakDistribution):
    """Distribution of peaks whose log10 is scattered around a median by Student's t.

    Parameters
    ----------
    median : float or array, m/s
        Half of the blasts stay below it.
    below, above : float or array
        Standard deviation of log10 on either side of the median.
    n_free : float
        Degrees of freedom of Student's t; infinite where the scatter itself is known.
    charge, exponent
        As `PeakDistribution`.

    Notes
    -----
    theory.md (13.4).

    Examples
    --------
    >>> peak = PeaksOfLaw(0.010, 0.2, 0.2, charge=40.0, exponent=0.8)
    >>> round(1e3 * float(peak.level(0.95)), 1), round(float(peak.share_below(0.020)), 3)
    (21.3, 0.934)
    >>> round(float(peak.charge_below(0.005)), 1)
    6.5
    """

    median: ArrayLike
    below: ArrayLike
    above: ArrayLike
    n_free: float = math.inf
    charge: ArrayLike = math.nan
    exponent: float = math.nan

    def level(self, share: float) -> np.ndarray:
        """Return the peak in m/s that this share of further blasts stays below."""
        check_share(share)
        away = scipy.special.stdtrit(self.n_free, share)
        return self.median * 10.0 ** (away * np.asarray(self.below if away < 0.0 else self.above))

    def share_below(self, limit: ArrayLike) -> np.ndarray:
        """Return the share of further blasts whose peak stays below a limit in m/s."""
        away = np.log10(np.asarray(limit, dtype=float) / self.median)
        side = np.where(away < 0.0, self.below, self.above)
        return scipy.special.stdtr(self.n_free, away / side)


@dataclass(frozen=True, eq=False)
class DrawnPeaks(PeakDistribution):
    """Distribution of the peaks of many simulated blasts of one plan.

    Parameters
    ----------
    receivers : tuple of str
    peaks : (n_blasts, n_receivers) float64, m/s
        Sorted at each receiver.
    charge, exponent
        As `PeakDistribution`.
    """

    receivers: tuple[str, ...]
    peaks: np.ndarray
    charge: ArrayLike = math.nan
    exponent: float = math.nan

    def level(self, share: float) -> np.ndarray:
        """Return the quantile of the peaks at each receiver, (n_receivers,) m/s."""
        check_share(share)
        return np.quantile(self.peaks, share, axis=0)

    def share_below(self, limit: ArrayLike) -> np.ndarray:
        """Return the share of blasts within the limit at each receiver, (n_receivers,)."""
        return np.mean(self.peaks <= limit, axis=0)

    def under(self, errors: Sequence[PeaksOfLaw | None]) -> "DrawnPeaks":
        """Return the peaks of many blasts under the error of their level at each receiver.

        Parameters
        ----------
        errors : sequence of PeaksOfLaw or None
            Of a level over that of the simulation, median 1; None where it is known.

        Examples
        --------
        >>> drawn = DrawnPeaks(("house",), np.full((1, 1), 2e-3))
        >>> error = PeaksOfLaw(1.0, 0.3, 0.3)
        >>> round(float(drawn.under([error]).level(0.95)[0] / error.level(0.95)), 3)
        0.002
        """
        shares = (np.arange(LEVELS) + 0.5) / LEVELS
        factors = [
            np.ones(LEVELS) if error is None else np.array([error.level(s) for s in shares])
            for error in errors
        ]
        columns = [np.outer(peaks, factor).ravel()
                   for peaks, factor in zip(self.peaks.T, factors, strict=True)]  # fmt: skip
        return replace(self, peaks=np.sort(np.column_stack(columns), axis=0))

    def coverage(self, peaks: np.ndarray, share: float) -> float:
        """Return the share of other peaks (n_others, n_receivers) within the band."""
        low, high = self.band(share)
        return float(np.mean((peaks >= low) & (peaks <= high)))


def check_share(share: float) -> None:
    """Check that a share lies between 0 and 1."""
    if not 0.0 < share < 1.0:
        raise InputError(f"peaks: share must lie between 0 and 1, got {share:g}")
