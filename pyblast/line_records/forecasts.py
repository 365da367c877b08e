"""Forecast of peaks before each blast by those before it, coverage, and statistical limits."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import date

import numpy as np
import scipy

from ..blasts.peaks import PeaksOfLaw
from ..blasts.published_laws import HARD_ROCK
from ..errors import InputError

WINDOW, FEWEST = 20, 5  # latest records of a station that a forecast stands on; least of them
PRIOR = np.array([-HARD_ROCK.beta, 0.5 * HARD_ROCK.beta])  # slopes on log10 of distance, charge
WEIGHT = 0.2  # squared ratio of the scatter of log10 peaks to the deviation of these slopes
BAND = 0.90


@dataclass(frozen=True, eq=False)
class Forecasts:
    """Forecasts of log10 of a value at each station before each blast.

    Parameters
    ----------
    mean, spread : (n_blasts, n_stations) float64
        Location and scale of Student's t; NaN where fewer than 5 records came before.
    n_free : (n_blasts, n_stations) float64
    exponent : (n_blasts,) float64
        Slope of log10 of the value on log10 of the charge.
    """

    mean: np.ndarray
    spread: np.ndarray
    n_free: np.ndarray
    exponent: np.ndarray

    def peak(self, blast: int, station: int, charge: float = math.nan) -> PeaksOfLaw:
        """Return the distribution of the value of a blast, in its unit."""
        spread = float(self.spread[blast, station])
        return PeaksOfLaw(
            10.0 ** float(self.mean[blast, station]), spread, spread,
            float(self.n_free[blast, station]), charge, float(self.exponent[blast]),
        )  # fmt: skip

    def half(self, share: float = BAND) -> np.ndarray:
        """Return half the width of the central bands, log10."""
        return scipy.special.stdtrit(self.n_free, 0.5 + 0.5 * share) * self.spread

    def inside(self, values: np.ndarray, share: float = BAND) -> np.ndarray:
        """Return whether log10 of the values lies in the central band, NaN where unknown."""
        away = np.abs(values - self.mean)
        return np.where(np.isfinite(away), away <= self.half(share), np.nan)


def forecasts(
    values: np.ndarray,
    scaled: np.ndarray,
    below: np.ndarray | None = None,
    prior: Sequence[float] | np.ndarray = PRIOR,
) -> Forecasts:
    """Forecast a value at each station before each blast, by the blasts before it alone.

    Parameters
    ----------
    values : (n_blasts, n_stations) float64
        log10, by time; NaN where a record is missing.
    scaled : (n_blasts, n_stations, 2) float64
        log10 of distance and of charge.
    below : (n_blasts, n_stations) float64, optional
        log10 of the trigger level where a station did not trigger; NaN elsewhere.
    prior : (2,) float
        Slopes on ``scaled`` before any record.

    Returns
    -------
    Forecasts

    Notes
    -----
    The slopes are those of differences between successive records of a station, about the prior;
    the level and its scatter those of the latest 20 records of a station, with Student's t. A
    blast below the trigger counts with the mean of the tail of its own forecast.
    """
    n_blasts, n_stations = values.shape
    mean, spread, n_free = (np.full(values.shape, np.nan) for _ in range(3))
    exponent, prior = np.empty(n_blasts), np.asarray(prior, dtype=float)
    matrix, vector = WEIGHT * np.eye(2), WEIGHT * prior
    past: list[list[tuple[float, np.ndarray]]] = [[] for _ in range(n_stations)]
    usable = np.isfinite(scaled).all(axis=-1)
    for b in range(n_blasts):
        inverse = np.linalg.inv(matrix)
        slope = inverse @ vector
        exponent[b] = slope[1]
        for s in np.flatnonzero(usable[b]):
            at = scaled[b, s]
            if len(past[s]) >= FEWEST:
                y, x = (np.array(part) for part in zip(*past[s][-WINDOW:], strict=True))
                level, away = y - x @ slope, at - x.mean(axis=0)
                scatter = level.std(ddof=1)
                mean[b, s] = level.mean() + at @ slope
                spread[b, s] = scatter * math.sqrt(1.0 + 1.0 / len(y) + away @ inverse @ away)
                n_free[b, s] = len(y) - 1
            value = values[b, s]
            if math.isnan(value) and below is not None and spread[b, s] > 0.0:
                z = (below[b, s] - mean[b, s]) / spread[b, s]
                tail = math.exp(scipy.special.log_ndtr(z))
                value = mean[b, s] - spread[b, s] * math.exp(-0.5 * z * z) / math.sqrt(
                    2.0 * math.pi
                ) / max(tail, 1e-300)
            if math.isnan(value):
                continue
            if past[s]:
                step, moved = value - past[s][-1][0], at - past[s][-1][1]
                matrix, vector = matrix + np.outer(moved, moved), vector + moved * step
            past[s].append((value, at))
    return Forecasts(mean, spread, n_free, exponent)


def trend(times: np.ndarray, values: np.ndarray, share: float = BAND) -> tuple[float, float]:
    """Return the slope of values over time, and half the width of its interval.

    NaN with fewer than 5 values or at one time.

    Examples
    --------
    >>> [round(end, 3) for end in trend(np.arange(6.0), np.array([0, 1, 2, 3, 4, 5.5]))]
    [1.071, 0.088]
    """
    away = times - times.mean()
    breadth = float(away @ away)
    if len(times) < FEWEST or breadth == 0.0:
        return math.nan, math.nan
    slope = float(away @ values) / breadth
    rest = values - values.mean() - slope * away
    error = math.sqrt(float(rest @ rest) / (len(times) - 2) / breadth)
    return slope, float(scipy.special.stdtrit(len(times) - 2, 0.5 + 0.5 * share)) * error


def share_interval(count: int, total: int, share: float = BAND) -> tuple[float, float]:
    """Return the interval of a share of which ``count`` of ``total`` were seen.

    Clopper and Pearson (1934).

    Examples
    --------
    >>> [round(end, 3) for end in share_interval(19, 20)]
    [0.784, 0.997]
    """
    tail = 0.5 - 0.5 * share
    low = scipy.special.betaincinv(count, total - count + 1, tail) if count else 0.0
    high = scipy.special.betaincinv(count + 1, total - count, 1.0 - tail) if count < total else 1.0
    return float(low), float(high)


@dataclass(frozen=True)
class StatisticalLimit:
    """Limit that a share of all blasts of a period stays below, and none exceeds a higher one.

    Parameters
    ----------
    level : float, m/s
    share : float
    ceiling : float, m/s
        Infinite where there is none.
    since, until : str
        Days in ISO form; the last one belongs to the period.
    """

    level: float
    share: float = 0.95
    ceiling: float = math.inf
    since: str = "0001-01-01"
    until: str = "9999-12-31"

    def __post_init__(self):
        """Check the fields once."""
        if not 0.0 < self.level <= self.ceiling:
            raise InputError(
                "statistical limit: level must be positive and not above the ceiling, got "
                f"{1e3 * self.level:g} and {1e3 * self.ceiling:g} mm/s"
            )
        if not 0.0 < self.share < 1.0:
            raise InputError(f"statistical limit: share must lie between 0 and 1, {self.share:g}")
        for day in (self.since, self.until):
            try:
                date.fromisoformat(day)
            except ValueError:
                raise InputError(
                    f"statistical limit: expected a day such as 2026-03-14, got {day[:40]!r}"
                ) from None
        if self.since > self.until:
            raise InputError(f"statistical limit: {self.since} is after {self.until}")

    def judged(self, days: Sequence[str], peaks: np.ndarray, bounds: np.ndarray) -> dict:
        """Return how the blasts of one station keep the limit so far.

        Parameters
        ----------
        days : sequence of str
            Of the blasts, by time.
        peaks, bounds : (n_blasts,) float64, m/s
            Peaks; levels that peaks stayed below where the station did not trigger. NaN elsewhere.

        Returns
        -------
        dict
            ``blasts`` that count: recorded, or below a trigger level that is not above the limit;
            ``unknown``: no record, and no such level; ``over`` the level and ``over_ceiling``;
            ``share`` below the level so far, its ``interval`` (90 %, as of blasts to come), and
            ``may_exceed``: how many more may, at the pace of blasts so far, until the end.
        """
        period = np.array([self.since <= day <= self.until for day in days], dtype=bool)
        triggerless = period & (bounds <= self.level)
        total = int((period & np.isfinite(peaks)).sum() + triggerless.sum())
        over = int((period & (peaks > self.level)).sum())
        result = {
            "blasts": total, "unknown": int(period.sum()) - total, "over": over,
            "over_ceiling": int((period & (peaks > self.ceiling)).sum()),
            "below_trigger": int(triggerless.sum()),
        }  # fmt: skip
        if total:
            in_all = total * max(self._pace([day for day in days if day[:10] >= self.since]), 1.0)
            result |= {
                "share": 1.0 - over / total, "interval": share_interval(total - over, total),
                "expected_blasts": in_all,
                "may_exceed": math.floor((1.0 - self.share) * in_all + 1e-9) - over,
            }  # fmt: skip
        return result

    def _pace(self, days):
        """Return how many times the part of the period that has passed fits into it."""
        if self.until.startswith("9999") or not days:
            return 1.0
        first = days[0] if self.since.startswith("0001") else self.since
        start, now, end = (
            np.datetime64(d[:10]) for d in (first, min(days[-1], self.until), self.until)
        )
        return float((end - start).astype(int) + 1) / float((now - start).astype(int) + 1)
