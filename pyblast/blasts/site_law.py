"""Site laws: peak velocity against scaled distance, fitted to the peaks of many blasts."""

import math
import warnings
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike

from ..errors import InputError, PyblastWarning, ReadError
from ..readers.cells import wanted_by
from ..readers.provenance import ReadLog
from ..readers.tables import load_mapping, read_table
from .peaks import LEVEL, PeaksOfLaw

FEWEST, NARROWEST, BEYOND = 6, 2.0, 1.5
WANTED_RECORDS, WANTED_R2, CURVED = 30, 0.5, 0.01
OUTLYING = 0.05  # probability of a record so far from the law of the others
MOST_STEPS, SETTLED = 500, 1e-7  # of the fit to peaks below a level, relative
SURE = 0.95  # required confidence that the peak decreases with distance


@dataclass(frozen=True, eq=False)
class SiteLaw:
    """Site law ``PPV = k SD^-beta`` with ``SD = R / W^charge_exponent``, and its statistics.

    Parameters
    ----------
    k : float, m/s
        Peak velocity at a scaled distance of 1.
    beta : float
    charge_exponent : float
    s : float
        Standard deviation of log10 PPV around the line, with n - 2 degrees of freedom.
    n : int
    r2 : float
    middle, breadth : float
        Mean of log10 SD, and the sum of squares around it.
    reach : (2,) float64, m/kg^charge_exponent
        Smallest and largest scaled distance of the records.
    notes : tuple of str
        Findings about the fit.
    """

    k: float
    beta: float
    charge_exponent: float
    s: float
    n: int
    r2: float
    middle: float
    breadth: float
    reach: np.ndarray
    notes: tuple[str, ...] = ()

    @property
    def n_free(self) -> int:
        """Degrees of freedom of the scatter: records less the values that were fitted."""
        return self.n - (2 if math.isfinite(self.breadth) else 1)

    @property
    def k95(self) -> float:
        """Factor of the parallel line k 10^(1.645 s), m/s, that many programs print.

        Without the uncertainty of k, beta and s, which ``peak(...).level(0.95)`` includes.
        """
        return float(self.k * 10.0 ** (scipy.special.ndtri(0.95) * self.s))

    def beta_interval(self, share: float = 0.90) -> tuple[float, float]:
        """Return the ends of the interval that holds beta with this probability."""
        away = scipy.special.stdtrit(self.n_free, 0.5 + 0.5 * share)
        half = away * self.s / math.sqrt(self.breadth)
        return float(self.beta - half), float(self.beta + half)

    def peak(self, distance: ArrayLike, charge: ArrayLike) -> "PeaksOfSite":
        """Return the distribution of the peak of new blasts; theory.md (13.4).

        Parameters
        ----------
        distance : float or array, m
        charge : float or array, kg
            Largest charge within 8 ms.

        Raises
        ------
        InputError
            If a scaled distance lies more than 1.5 times outside those of the records.
        """
        scaled = scaled_distance(distance, charge, self.charge_exponent)
        low, high = self.reach[0] / BEYOND, self.reach[1] * BEYOND
        if np.any(scaled < low * (1.0 - 1e-12)) or np.any(scaled > high * (1.0 + 1e-12)):
            raise InputError(
                f"site law: known from scaled distances of {self.reach[0]:.3g} to "
                f"{self.reach[1]:.3g}, good to {low:.3g} and {high:.3g}; got "
                f"{np.min(scaled):.3g} to {np.max(scaled):.3g}"
            )
        away = np.log10(scaled) - self.middle
        spread = self.s * np.sqrt(1.0 + 1.0 / self.n + away**2 / self.breadth)
        return PeaksOfSite(
            self.k * scaled**-self.beta, spread, spread, self.n_free, charge,
            self.beta * self.charge_exponent, law=self, distance=distance,
        )  # fmt: skip

    def largest_charge(self, distance: float, ppv: float, share: float = LEVEL) -> float:
        """Return the charge in 8 ms whose peak stays below ``ppv`` in this share of new blasts.

        Parameters
        ----------
        distance : float, m
        ppv : float, m/s
        share : float

        Returns
        -------
        float, kg

        Raises
        ------
        InputError
            If it would lie where the law is not known.
        """
        scaled = np.geomspace(self.reach[0] / BEYOND, self.reach[1] * BEYOND, 2000)
        level = self.peak(scaled, 1.0).level(share)
        above = np.flatnonzero(level > ppv)
        if len(above) == 0 or above[-1] == len(scaled) - 1:
            raise InputError(
                f"site law: {1e3 * ppv:.3g} mm/s is not between {1e3 * level[-1]:.3g} and "
                f"{1e3 * level[0]:.3g} mm/s, which the records cover; record nearer or farther away"
            )
        pair = slice(above[-1], above[-1] + 2)
        at = np.exp(np.interp(-math.log(ppv), -np.log(level[pair]), np.log(scaled[pair])))
        return float((distance / at) ** (1.0 / self.charge_exponent))


@dataclass(frozen=True, eq=False)
class PeaksOfSite(PeaksOfLaw):
    """Distribution of peaks by a site law, whose spread grows away from its records.

    Parameters
    ----------
    law : SiteLaw
    distance : float or array, m
        The others as `PeaksOfLaw`.
    """

    law: SiteLaw = field(kw_only=True)
    distance: ArrayLike = field(kw_only=True)

    def charge_below(self, limit: float, share: float = LEVEL) -> np.ndarray:
        """Return the charge in kg in 8 ms with which this share stays below a limit in m/s."""
        at_one_metre = self.law.largest_charge(1.0, limit, share)
        return at_one_metre * np.asarray(self.distance) ** (1.0 / self.law.charge_exponent)


def scaled_distance(
    distance: ArrayLike, charge: ArrayLike, charge_exponent: float = 0.5
) -> np.ndarray:
    """Return ``distance / charge^charge_exponent``, m and kg; refuse what is not positive."""
    distance, charge = np.asarray(distance, dtype=float), np.asarray(charge, dtype=float)
    for name, values in (("distance", distance), ("charge", charge)):
        wrong = ~((values > 0.0) & np.isfinite(values))
        if np.any(wrong):
            first = np.flatnonzero(wrong)[0]
            raise InputError(
                f"scaled distance: {name} must be positive, got {values.flat[first]:g}"
                + (f" in record {first + 1}" if values.size > 1 else "")
            )
    return distance / charge**charge_exponent


def scaled_distance_ppv(
    distance: ArrayLike, charge: ArrayLike, k: float, beta: float, charge_exponent: float = 0.5
) -> np.ndarray:
    """Return the PPV [m/s] of ``k (distance / charge^charge_exponent)^-beta``, m and kg."""
    return k * scaled_distance(distance, charge, charge_exponent) ** -beta


def fit_site_law(
    distance: ArrayLike,
    charge: ArrayLike,
    ppv: ArrayLike,
    charge_exponent: float = 0.5,
    below: ArrayLike = False,
) -> SiteLaw:
    """Fit a site law to the peaks of recorded blasts.

    Parameters
    ----------
    distance : (n,) float, m
    charge : (n,) float, kg
        Largest charge within 8 ms.
    ppv : (n,) float, m/s
    charge_exponent : float
        1/2 for long charges, 1/3 for points and for air blast.
    below : (n,) bool
        Where the peak is only known to lie below ``ppv``: the trigger level of an instrument that
        did not trigger.

    Returns
    -------
    SiteLaw
        Its ``n`` counts measured peaks.

    Raises
    ------
    InputError
        If a value is not positive; if there are fewer than 6 measured peaks; if their scaled
        distances, any one record left out, span less than a factor of 2; or if the peaks do not
        fall with scaled distance significantly (95 %).

    Notes
    -----
    Least squares in log10, theory.md (13.3); the likelihood of Tobin (1958) where peaks lie below a
    level, maximised by expectation and maximisation.

    Examples
    --------
    >>> distance = np.array([50.0, 80.0, 120.0, 200.0, 300.0, 450.0])
    >>> ppv = 0.5 * (distance / 5.0) ** -1.6 * [1.1, 0.9, 1.0, 1.0, 0.9, 1.1]
    >>> law = fit_site_law(distance, np.full(6, 25.0), ppv)
    >>> round(law.beta, 2)
    1.6
    """
    if not 0.0 < charge_exponent <= 1.0:
        raise InputError(f"site law: charge_exponent must be above 0, up to 1; {charge_exponent:g}")
    scaled = np.atleast_1d(scaled_distance(distance, charge, charge_exponent))
    ppv = np.atleast_1d(np.asarray(ppv, dtype=float))
    if scaled.ndim != 1 or ppv.shape != scaled.shape:
        raise InputError(
            f"site law: need one distance, charge and ppv for each record, got {scaled.shape} "
            f"scaled distances and {ppv.shape} peaks"
        )
    wrong = np.flatnonzero(~((ppv > 0.0) & np.isfinite(ppv)))
    if len(wrong):
        raise InputError(
            f"site law: ppv must be positive, got {ppv[wrong[0]]:g} in record {wrong[0] + 1}; "
            "leave out what did not trigger"
        )
    below = np.broadcast_to(np.asarray(below, dtype=bool), scaled.shape)
    _refuse_poor_places(np.sort(scaled[~below]))
    x, y, hidden = np.log10(scaled), np.log10(ppv), 0.0
    if below.any():
        y, hidden = _expected_below(x, y, below)
    middle = x.mean()
    breadth = float(np.sum((x - middle) ** 2))
    slope = float(np.sum((x - middle) * y) / breadth)
    residual = y - y.mean() - slope * (x - middle)
    s = math.sqrt((np.sum(residual**2) + hidden) / (len(x) - 2))
    _refuse_no_fall(slope, s / math.sqrt(breadth), len(x), _outlier(x, y))
    r2 = float(1.0 - np.sum(residual**2) / np.sum((y - y.mean()) ** 2))
    return SiteLaw(
        float(10.0 ** (y.mean() - slope * middle)), -slope, charge_exponent, s,
        int((~below).sum()), r2,
        float(middle), breadth, np.array([scaled.min(), scaled.max()]), _notes(x, y, r2),
    )  # fmt: skip


def site_law_of_exponent(
    distance: ArrayLike,
    charge: ArrayLike,
    ppv: ArrayLike,
    beta: float,
    charge_exponent: float = 0.5,
) -> SiteLaw:
    """Return the site law of a given exponent, where distances are too few to fit one.

    Parameters
    ----------
    distance, charge, ppv, charge_exponent
        As `fit_site_law`.
    beta : float
        Of a published law, such as `pyblast.blasts.published_laws.HARD_ROCK`.

    Raises
    ------
    InputError
        If there are fewer than 6 records, or a value is not positive.
    """
    x = np.log10(scaled_distance(distance, charge, charge_exponent))
    y = np.log10(np.asarray(ppv, dtype=float))
    if len(x) < FEWEST:
        raise InputError(f"site law: {len(x)} records; at least {FEWEST} are needed")
    level = y + beta * x
    s = float(np.std(level, ddof=1))
    r2 = 1.0 - float(np.var(level) / max(np.var(y), 1e-300))
    return SiteLaw(
        float(10.0 ** level.mean()), beta, charge_exponent, s, len(x), r2, float(x.mean()),
        math.inf, 10.0 ** np.array([x.min(), x.max()]),
    )  # fmt: skip


def _expected_below(x, y, below):
    """Return the values of a line with those below a level expected, and their summed variance."""
    level, y = y[below], y.copy()
    spread, hidden = max(float(np.std(y[~below])), 1e-6), 0.0
    for _ in range(MOST_STEPS):
        slope, start = np.polyfit(x, y, 1)
        residual = y - start - slope * x
        before, spread = spread, math.sqrt((np.sum(residual**2) + hidden) / (len(x) - 2))
        mean = start + slope * x[below]
        z = (level - mean) / max(spread, 1e-9)
        tail = np.exp(-(z**2) / 2.0 - 0.5 * np.log(2.0 * np.pi) - scipy.special.log_ndtr(z))
        y[below] = mean - spread * tail
        hidden = float(np.sum(spread**2 * np.maximum(1.0 - z * tail - tail**2, 0.0)))
        if abs(spread - before) < SETTLED * spread:
            break
    return y, hidden


def _refuse_poor_places(scaled):
    """Raise InputError for too few records or too small a range of (sorted) scaled distances."""
    if len(scaled) < FEWEST:
        raise InputError(f"site law: {len(scaled)} records; at least {FEWEST} are needed")
    span = min(scaled[-1] / scaled[1], scaled[-2] / scaled[0])
    if span < NARROWEST:
        raise InputError(
            f"site law: without one record the scaled distances span a factor of {span:.3g}, at "
            f"least {NARROWEST:g} is needed; record nearer and farther away"
        )


def _outlier(x, y):
    """Return which record the law of the others does not allow (95 %), a sentence; else ""."""
    n, away = len(x), x - x.mean()
    residual = y - y.mean() - np.sum(away * y) / np.sum(away**2) * away
    free = 1.0 - 1.0 / n - away**2 / np.sum(away**2)  # share of each error that is left
    others = (np.sum(residual**2) - residual**2 / free) / (n - 3)
    size = np.abs(residual) / np.sqrt(np.maximum(others, np.finfo(float).tiny) * free)
    worst = int(np.argmax(size))
    if 2.0 * n * scipy.special.stdtr(n - 3, -size[worst]) >= OUTLYING:
        return ""
    factor = residual[worst] / free[worst]
    return (
        f"record {worst + 1} lies {10.0 ** abs(factor):.2g} times "
        f"{'above' if factor > 0.0 else 'below'} the law of the others; look at its unit, charge, "
        "distance and instrument, and leave it out if one of them is wrong"
    )


def _refuse_no_fall(slope, error, n, outlier):
    """Raise InputError unless the peaks decrease significantly with distance."""
    if slope + scipy.special.stdtrit(n - 2, SURE) * error >= 0.0:
        raise InputError(
            f"site law: log PPV changes by {slope:.2f} +- {error:.2f} for each factor of ten of "
            "scaled distance, so it may not fall at all; a wider range of distances and charges "
            "helps, more of the same records do not" + (f"; {outlier}" if outlier else "")
        )


def _notes(x, y, r2):
    """Return findings about the fit, one sentence each."""
    notes = []
    if len(x) < WANTED_RECORDS:
        notes.append(f"{len(x)} records; {WANTED_RECORDS} or more make a law to rely on")
    if outlier := _outlier(x, y):
        notes.append(outlier)
    if r2 < WANTED_R2:
        notes.append(f"the law explains {100 * r2:.0f} % of the scatter, less than half")
    columns = np.vander(x - x.mean(), 3)
    bent, residual = np.linalg.lstsq(columns, y, rcond=None)[:2]
    if len(residual) and residual[0] > 0.0:
        error = math.sqrt(residual[0] / (len(x) - 3) * np.linalg.inv(columns.T @ columns)[0, 0])
        if 2.0 * scipy.special.stdtr(len(x) - 3, -abs(bent[0]) / error) < CURVED:
            notes.append("the records bend away from a straight line; fit near and far apart")
    return tuple(notes)


class SiteRecords(NamedTuple):
    """Distances (n,) m, charges in 8 ms (n,) kg, and peak velocities (n,) m/s."""

    distance: np.ndarray
    charge: np.ndarray
    ppv: np.ndarray


def read_site_records(
    path: str | Path,
    mapping: dict | str | Path | None = None,
    sheet: str | None = None,
    log: ReadLog | None = None,
) -> SiteRecords:
    """Read a table of peaks, such as ``distance_m, charge_kg, ppv_mm_per_s``; text or workbook.

    Parameters
    ----------
    path : str or Path
    mapping : dict or path of a TOML file, optional
        Columns whose titles don't say what they are, see `pyblast.readers.tables.read_table`.
    sheet : str, optional
        Of a workbook.
    log : ReadLog, optional
        Takes what was read.

    Returns
    -------
    SiteRecords
        Without totals and peaks of which only a bound is given, such as "<0.5"; warns of them.

    Raises
    ------
    ReadError, InputError
        If a column is missing or without a unit, two columns may be one quantity, or a value is
        no number.
    """
    mapping = load_mapping(mapping) if isinstance(mapping, (str, Path)) else mapping
    table = read_table(path, wanted_by("peaks"), mapping, log, sheet=sheet, kind="table of peaks")
    for name in SiteRecords._fields:
        if np.isnan(table.values[name]).any():
            line = table.lines[int(np.argmax(np.isnan(table.values[name])))]
            raise ReadError(f"{table.where}: line {line}: {name} is missing, expected a number")
    for note in table.notes:
        warnings.warn(f"{table.where}: {note}", PyblastWarning, stacklevel=2)
    return SiteRecords(*(table.values[name] for name in SiteRecords._fields))
