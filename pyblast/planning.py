"""Planning of a blast: distribution of its peaks, and delays that keep them low."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats

from .errors import InputError
from .runs.blast_ensemble import BlastSpectra

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


SEARCHED, BEST, FRESH, RESAMPLED = 200, 6, 4000, 400


@dataclass(frozen=True, eq=False)
class BestDelays:
    """Outcome of a search.

    Parameters
    ----------
    delays : (n_delays,) float64, s
    times : (n_holes,) float64, s
    tried : (n_tried, n_delays + 1) float64
        Delays in s and the severity of each, in the order of the search.
    """

    delays: np.ndarray
    times: np.ndarray
    tried: np.ndarray


@dataclass(frozen=True, eq=False)
class Gain:
    """What one plan is worth beside another, on blasts that no search has seen.

    Parameters
    ----------
    share : float
        Of blasts that stay below the severities.
    before, after : float
        Severity of either plan: the largest peak over its limit at any house.
    reduction : float
        1 - after/before.
    interval : (2,) float64
        90 % interval of the reduction, for all that so few blasts tell.
    """

    share: float
    before: float
    after: float
    reduction: float
    interval: np.ndarray


def rows_pattern(n_rows: int, holes_per_row: int) -> np.ndarray:
    """Return how many delays (between holes, between rows) come before each hole, row by row."""
    if n_rows < 1 or holes_per_row < 1:
        raise InputError(f"rows: need at least 1 x 1, got {n_rows} x {holes_per_row}")
    row, place = np.divmod(np.arange(n_rows * holes_per_row), holes_per_row)
    return np.column_stack([place, row]).astype(float)


def best_delays(
    spectra: BlastSpectra,
    pattern: ArrayLike,
    low: ArrayLike,
    high: ArrayLike,
    scatter: FiringScatter,
    *,
    step: float = 1e-3,
    points: int = 12,
    limits: ArrayLike = 1.0,
    share: float = 0.9,
    scales: ArrayLike = 1.0,
    allowed: Callable | None = None,
    n_blasts: int = SEARCHED,
    seed: int = 0,
) -> BestDelays:
    """Search delays for the least severity at a number of houses.

    Parameters
    ----------
    spectra : BlastSpectra
        At the houses; `banded` first where a band of frequencies counts.
    pattern : (n_holes, n_delays) float
        How many of each delay come before a hole: times are ``pattern @ delays``, see
        `rows_pattern`.
    low, high : (n_delays,) float, s
        Between which each delay may lie, whole steps from ``low``.
    scatter : FiringScatter
    step : float, s
        Finest difference that detonators can be given.
    points : int
        Of the first grid along each delay; then around its best, in halved distances.
    limits : float or (n_receivers,) float, m/s
        Peaks count as shares of these.
    share : float
        The severity that this share of blasts stays below is made least.
    scales : float or (n_holes,) float
    allowed : callable, optional
        Says of times (n_holes,) whether they may be fired, for instance by the charge in 8 ms.
    n_blasts, seed : int
        Drawn for each try; the same deviations for all.

    Returns
    -------
    BestDelays
        Its severity is the best of many and so too good; `gain` tells what it is worth.

    Raises
    ------
    InputError
        If shapes or bounds do not agree, or nothing is allowed.

    Notes
    -----
    theory.md (13.7).
    """
    pattern, low, high = _checked(spectra, pattern, low, high, step)
    most = np.floor((high - low) / step + 1e-9).astype(int)
    found: dict[tuple[int, ...], float] = {}

    def look(places):
        """Work out the severity of places that are new and allowed."""
        for place in places:
            times = pattern @ (low + step * np.array(place))
            if place in found or (allowed is not None and not allowed(times)):
                continue
            found[place] = severity(
                spectra, times, scatter, limits, share, scales=scales, n_blasts=n_blasts, seed=seed
            )

    axes = [np.unique(np.round(np.linspace(0, end, points)).astype(int)) for end in most]
    look(map(tuple, np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, len(low)).tolist()))
    if not found:
        raise InputError("best_delays.allowed: refuses every plan of the first grid")
    apart = np.maximum(most // max(points - 1, 1), 1)
    while True:
        apart = np.maximum(apart // 2, 1)
        best = sorted(found, key=found.__getitem__)[:BEST]
        steps = np.stack(np.meshgrid(*[[-1, 0, 1]] * len(low)), -1).reshape(-1, len(low)) * apart
        around = (np.clip(np.array(place) + one, 0, most) for place in best for one in steps)
        before = len(found)
        look(tuple(place.tolist()) for place in around)
        if (apart == 1).all() and len(found) == before:
            break
    delays = low + step * np.array(min(found, key=found.__getitem__))
    tried = np.array([[*(low + step * np.array(place)), value] for place, value in found.items()])
    return BestDelays(delays, pattern @ delays, tried)


def severity(
    spectra: BlastSpectra,
    times: ArrayLike,
    scatter: FiringScatter,
    limits: ArrayLike,
    share: float,
    *,
    scales: ArrayLike = 1.0,
    n_blasts: int = FRESH,
    seed: int = 1,
) -> float:
    """Return what the largest peak over its limit stays below in this share of drawn blasts."""
    return float(
        np.quantile(_worst(spectra, times, scatter, limits, scales, n_blasts, seed), share)
    )


def gain(
    spectra: BlastSpectra,
    before: ArrayLike,
    after: ArrayLike,
    scatter: FiringScatter,
    *,
    limits: ArrayLike = 1.0,
    share: float = 0.9,
    scales: ArrayLike = 1.0,
    n_blasts: int = FRESH,
    seed: int = 1,
) -> Gain:
    """Compare two plans by blasts drawn for this purpose.

    Parameters
    ----------
    spectra, scatter, limits, share, scales
        As for `best_delays`; the scatter may be another, to see what a wrong one costs.
    before, after : (n_holes,) float, s
        Times of both plans.
    n_blasts, seed : int
        The seed must differ from that of the search.

    Returns
    -------
    Gain

    Raises
    ------
    InputError
        If times lie outside those of the spectra.
    """
    pair = [_worst(spectra, times, scatter, limits, scales, n_blasts, seed)
            for times in (before, after)]  # fmt: skip
    first, second = (float(np.quantile(each, share)) for each in pair)
    spread = _interval(pair[0], pair[1], share, seed)
    return Gain(share, first, second, 1.0 - second / first, spread)


def _interval(before, after, share, seed):
    """Return 90 % of the reductions of resampled blasts."""
    generator = np.random.default_rng([seed, 1])
    chosen = generator.integers(len(before), size=(RESAMPLED, len(before)))
    drawn = np.quantile(after[chosen], share, axis=1) / np.quantile(before[chosen], share, axis=1)
    return np.quantile(1.0 - drawn, [0.05, 0.95])


def _worst(spectra, times, scatter, limits, scales, n_blasts, seed):
    """Return the largest peak over its limit of each drawn blast, (n_blasts,)."""
    limits = np.asarray(limits, dtype=float)
    if limits.shape not in ((), (len(spectra.receivers),)) or not (limits > 0.0).all():
        raise InputError(
            f"limits: need one positive limit, or one for each of {len(spectra.receivers)} "
            f"receivers, got {limits}"
        )
    peaks = drawn_peaks(spectra, times, scatter, scales, n_blasts, seed)
    return np.max(peaks / limits, axis=1)


def _checked(spectra, pattern, low, high, step):
    """Refuse a search that can not be made; return arrays."""
    pattern = np.asarray(pattern, dtype=float)
    low, high = np.atleast_1d(np.asarray(low, float)), np.atleast_1d(np.asarray(high, float))
    n_holes = spectra.spectra.shape[1]
    if pattern.ndim != 2 or len(pattern) != n_holes or pattern.shape[1:] != low.shape:
        raise InputError(
            f"best_delays.pattern: need ({n_holes}, {len(low)}) for {n_holes} holes and "
            f"{len(low)} delays, got {pattern.shape}"
        )
    if low.shape != high.shape or not (np.isfinite(low) & (low <= high) & (high < np.inf)).all():
        raise InputError(f"best_delays: low must not be above high, got {low} and {high} s")
    if not step > 0.0:
        raise InputError(f"best_delays.step: must be positive, got {step:g} s")
    return pattern, low, high


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
    pattern: ArrayLike,
    low: ArrayLike,
    high: ArrayLike,
    scatter: FiringScatter,
    *,
    planned: ArrayLike,
    limits: ArrayLike,
    step: float,
    share: float,
    scales: ArrayLike = 1.0,
    allowed: Callable | None = None,
    n_blasts: int,
    seed: int,
) -> DelayPlan:
    """Search delays, then compare the present plan and the best one on new draws.

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
