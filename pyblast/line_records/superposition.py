"""Superposition of single holes, recorded or by a model, over the hole tables of a log."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..blasts.published_laws import HARD_ROCK
from ..errors import InputError
from ..signals.seismogram import Seismogram
from ..signals.spectra import zero_crossing_frequency
from .forecasts import Forecasts, forecasts
from .monitoring import Joined

SPEED = 2500.0  # m/s by which waves of a farther hole come later: S waves of hard rock
CHARGE_EXPONENT = 0.5 * HARD_ROCK.beta


@dataclass(frozen=True, eq=False)
class HoleMotion:
    """Motion of one hole at a station.

    Parameters
    ----------
    motion : Seismogram
        In m/s.
    charge : float, kg
    distance : float, m
    since : int
        First blast of the log that it may forecast, by number.
    """

    motion: Seismogram
    charge: float
    distance: float
    since: int


def sum_of_holes(site: Joined, holes: Mapping[int, Sequence[HoleMotion]]) -> np.ndarray:
    """Superpose the motion of single holes over each blast that has a hole table.

    Parameters
    ----------
    site : Joined
    holes : mapping of int to sequence of HoleMotion
        By number of station; the latest that was known before a blast counts.

    Returns
    -------
    (n_blasts, n_stations, 2) float64
        log10 of the largest peak of a component in m/s, and of its zero-crossing frequency in Hz;
        NaN without a hole table with all charges, or without a hole at the station.

    Notes
    -----
    A hole counts with its charge and distance over those of the single one, by the exponents of
    `HARD_ROCK`; waves of a farther one come later, at 2500 m/s.
    """
    values = np.full((len(site.blasts), len(site.stations), 2), np.nan)
    for s, known in holes.items():
        at = np.array(site.stations[s].position)
        for b, blast in enumerate(site.blasts):
            before = [hole for hole in known if hole.since <= b]
            if blast.plan is not None and before:
                values[b, s] = _peak(blast.plan, at, max(before, key=lambda hole: hole.since))
    return values


def _peak(plan, at, hole):
    """Return log10 of the peak of a blast at a station and of its frequency."""
    from ..blasts.signature import superpose  # its closed forms load the model

    away = np.linalg.norm(plan.centres - at, axis=1)
    try:
        firing = plan.firing(hole.charge, CHARGE_EXPONENT)
    except InputError:  # charges are missing
        return np.nan, np.nan
    scales = firing.scales * (hole.distance / away) ** HARD_ROCK.beta
    later = (away - away.min()) / SPEED
    motion = superpose(hole.motion, replace(firing, scales=scales), travel_shifts=later)
    peaks = zip(motion.ppv, zero_crossing_frequency(motion).hz, strict=True)
    peak, hz = max((row for row in peaks if row[0] > 0.0), default=(np.nan, np.nan))
    return np.log10(peak), np.log10(hz)


def calibrated(
    values: np.ndarray, predicted: np.ndarray, below: np.ndarray | None = None
) -> Forecasts:
    """Forecast a value by a prediction, its bias and scatter at each station so far.

    Parameters
    ----------
    values, predicted : (n_blasts, n_stations) float64
        log10, by time; NaN where one is missing.
    below : (n_blasts, n_stations) float64, optional
        log10 of the trigger level where a station did not trigger; NaN elsewhere.

    Returns
    -------
    Forecasts
    """
    none = np.where(np.isfinite(predicted), 0.0, np.nan)[..., None] * np.zeros(2)
    below = None if below is None else below - predicted
    ratio = forecasts(values - predicted, none, below, (0.0, 0.0))
    return replace(ratio, mean=ratio.mean + predicted)
