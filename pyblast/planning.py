"""Planning of a blast: distribution of its peaks, and delays that keep them low."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from .blasts.peaks import DrawnPeaks
from .errors import InputError
from .mesh.quality import refuse_beyond_memory
from .runs.blast_ensemble import BlastSpectra

FARTHEST = 4.0  # standard deviations, to which larger deviations (6 in 10^5) are clipped


@dataclass(frozen=True)
class FiringScatter:
    """Scatter of firing times and charges around their plan, and its uncertainty.

    Parameters
    ----------
    delay : float, s
        Standard deviation of each time: below 0.1 ms for electronic detonators.
    delay_share : float
        The same as a share of the planned time: 0.01 to 0.03 for pyrotechnic ones.
    charge : float
        Standard deviation of the logarithm of the strength of each hole.
    blast : float
        The same of a common factor of all holes of a blast.
    doubt : float
        Standard deviation of the logarithm of the first three, drawn for each blast: 0 if they
        were measured, 0.5 if only their order of magnitude is known.
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
            The same seed gives the same deviations for any plan.
        scales : float or (n_holes,) float

        Returns
        -------
        times, scales : (n_blasts, n_holes) float64
        """
        generator, times = np.random.default_rng(seed), np.asarray(times, dtype=float)
        size = n_blasts, 2 * len(times) + 3
        refuse_beyond_memory(
            f"{n_blasts} draws of {len(times)} holes", 4.0 * 8.0 * math.prod(size), "fewer draws"
        )
        deviations = generator.standard_normal(size)
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


def peak_bands(
    spectra: BlastSpectra,
    times: ArrayLike,
    scatter: FiringScatter,
    *,
    scales: ArrayLike = 1.0,
    n_blasts: int = N_BLASTS,
    seed: int = 0,
    quantity: str = "ppv",
) -> DrawnPeaks:
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
    DrawnPeaks

    Raises
    ------
    InputError
        If the quantity is unknown, or times lie outside those of the spectra.
    """
    peaks = drawn_peaks(spectra, times, scatter, scales, n_blasts, seed, quantity)
    return DrawnPeaks(
        tuple(receiver.name for receiver in spectra.receivers), np.sort(peaks, axis=0)
    )


def drawn_peaks(
    spectra: BlastSpectra,
    times: ArrayLike,
    scatter: FiringScatter,
    scales: ArrayLike,
    n_blasts: int,
    seed: int,
    quantity: str = "ppv",
) -> np.ndarray:
    """Return peaks (n_blasts, n_receivers) in m/s in the order of the draws."""
    if quantity not in QUANTITIES:
        raise InputError(f'quantity: must be "ppv" or "pvs", got {quantity!r}')
    peaks = spectra.peaks(*scatter.drawn(times, n_blasts, seed, scales))
    return peaks.pvs if quantity == "pvs" else peaks.ppv.max(axis=-1)


SEARCHED, BEST, FRESH, RESAMPLED = 200, 6, 4000, 400


@dataclass(frozen=True, eq=False)
class BestDelays:
    """Best delays of a search.

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
    """Reduction of peaks by one plan against another, on blasts that the search did not use.

    Parameters
    ----------
    share : float
        Quantile of the severities.
    before, after : float
        Severity of either plan: the largest peak over its limit at any house.
    reduction : float
        1 - after/before.
    interval : (2,) float64
        90 % interval of the reduction for this number of blasts (bootstrap).
    """

    share: float
    before: float
    after: float
    reduction: float
    interval: np.ndarray


def rows_pattern(n_rows: int, holes_per_row: int) -> np.ndarray:
    """Return the number of delays (between holes, between rows) before each hole, row by row."""
    if n_rows < 1 or holes_per_row < 1:
        raise InputError(f"rows: need at least 1 x 1, got {n_rows} x {holes_per_row}")
    row, hole = np.divmod(np.arange(n_rows * holes_per_row), holes_per_row)
    return np.column_stack([hole, row]).astype(float)


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
    """Search the delays of least severity at some houses.

    Parameters
    ----------
    spectra : BlastSpectra
        At the houses; `banded` first where a band of frequencies counts.
    pattern : (n_holes, n_delays) float
        Number of each delay before a hole: times are ``pattern @ delays``, see
        `rows_pattern`.
    low, high : (n_delays,) float, s
        Bounds of each delay, which is a whole number of steps above ``low``.
    scatter : FiringScatter
    step : float, s
        Smallest difference of the detonators.
    points : int
        Of the first grid along each delay; refined around its best points by halves.
    limits : float or (n_receivers,) float, m/s
        Peaks count as shares of these.
    share : float
        Quantile of the severity that is minimised.
    scales : float or (n_holes,) float
    allowed : callable, optional
        Whether times (n_holes,) are allowed, for instance by the charge in 8 ms.
    n_blasts, seed : int
        Draws for each point; the same deviations for all.

    Returns
    -------
    BestDelays
        Its severity is biased low as the least of many; `gain_of_plan` estimates it on new draws.

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
    severities: dict[tuple[int, ...], float] = {}

    def evaluate(candidates):
        """Evaluate the severity of new and allowed points of the grid."""
        for point in candidates:
            times = pattern @ (low + step * np.array(point))
            if point in severities or (allowed is not None and not allowed(times)):
                continue
            severities[point] = severity(
                spectra, times, scatter, limits, share, scales=scales, n_blasts=n_blasts, seed=seed
            )

    axes = [np.unique(np.round(np.linspace(0, end, points)).astype(int)) for end in most]
    evaluate(
        map(tuple, np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, len(low)).tolist())
    )
    if not severities:
        raise InputError("best_delays.allowed: refuses every plan of the first grid")
    apart = np.maximum(most // max(points - 1, 1), 1)
    while True:
        apart = np.maximum(apart // 2, 1)
        best = sorted(severities, key=severities.__getitem__)[:BEST]
        steps = np.stack(np.meshgrid(*[[-1, 0, 1]] * len(low)), -1).reshape(-1, len(low)) * apart
        around = (np.clip(np.array(point) + move, 0, most) for point in best for move in steps)
        before = len(severities)
        evaluate(tuple(point.tolist()) for point in around)
        if (apart == 1).all() and len(severities) == before:
            break
    delays = low + step * np.array(min(severities, key=severities.__getitem__))
    tried = [[*(low + step * np.array(point)), value] for point, value in severities.items()]
    return BestDelays(delays, pattern @ delays, np.array(tried))


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
    """Return the quantile of the largest peak over its limit, over simulated blasts."""
    return float(
        np.quantile(_worst(spectra, times, scatter, limits, scales, n_blasts, seed), share)
    )


def gain_of_plan(
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
    """Compare two plans by blasts that the search did not use.

    Parameters
    ----------
    spectra, scatter, limits, share, scales
        As for `best_delays`; another scatter shows the cost of a wrong one.
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
    """Return the 90 % interval of the reduction of resampled blasts."""
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
    """Check the arguments of a search; return arrays."""
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
    """Best delays with the distribution of peaks before and after.

    Parameters
    ----------
    limits : (n_houses,) float64, m/s
    before, after : DrawnPeaks
        Of the present and of the best times, by blasts that the search did not use.
    best : BestDelays
    gain : Gain
        Of the largest peak over its limit.
    alike : DrawnPeaks
        Of the best times, if all holes radiated as their charge says.
    """

    limits: np.ndarray
    before: DrawnPeaks
    after: DrawnPeaks
    best: BestDelays
    gain: Gain
    alike: DrawnPeaks


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
        Times of the present plan.
    n_blasts, seed : int
        Of the bands; the search uses other draws.

    Raises
    ------
    InputError
        As `best_delays` and `gain_of_plan`.

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
    gained = gain_of_plan(
        spectra, planned, best.times, scatter, limits=limits, share=share, **fresh
    )
    alike = peak_bands(spectra, best.times, replace(scatter, charge=0.0), **fresh)
    return DelayPlan(np.asarray(limits, dtype=float), before, after, best, gained, alike)
