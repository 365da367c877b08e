"""Changes of a site: control charts of residuals, steps and drifts with date, interval, kind."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from .monitoring import FEATURES

FEWEST = 4  # records of a station, or blasts, on either side of a change
SURE = 4.0  # log of the evidence above that of no change
LEAD = 3.0  # log of the evidence by which a kind must lead another to be named alone
MOST = 40  # changes
REACH = 60  # blasts on either side of a change by which it is judged
LENGTHS = 0, 50, 150  # blasts over which a change grows: a step, drifts
DRIFT = 3.0  # log of the evidence by which a drift must lead a step
PASSES = 4  # over all changes, in which further ones are added
CLIPPED = 4.0  # robust standard deviations from its neighbours to which a record counts
NORMAL_MAD = 1.4826  # standard deviation of a normal law over its median absolute deviation
SHARE = 0.90  # of the intervals
UNSEEN = 1e2  # standard deviation of a step of which the records say nothing
HORIZONTAL, VERTICAL, ALONG, ACROSS, FREQUENCY, DURATION = range(len(FEATURES))
# Feature patterns of the kinds, one row a parameter; True: the same at all stations, False: at one.
KINDS = {
    "gain": ("sensor", ((HORIZONTAL, VERTICAL),)),
    "vertical channel": ("sensor", ((VERTICAL,),)),
    "horizontal channel": ("sensor", ((HORIZONTAL,), (ALONG,), (ACROSS,))),
    "orientation": ("sensor", ((ALONG,), (ACROSS,))),
    "coupling": ("station", ((HORIZONTAL,), (VERTICAL,), (FREQUENCY,))),
    "charge": ("practice", ((HORIZONTAL, VERTICAL),)),
    "timing": ("practice", ((HORIZONTAL, VERTICAL), (FREQUENCY,), (DURATION,))),
    "ground": ("ground", ((HORIZONTAL, VERTICAL), (FREQUENCY,))),
}
WORDS = {
    "gain": "the gain of the sensor",
    "vertical channel": "the gain of the vertical channel",
    "horizontal channel": "the gain of a horizontal channel",
    "orientation": "the orientation of the sensor",
    "coupling": "the coupling of the sensor",
    "charge": "the strength of the blasts (explosive, confinement)",
    "timing": "the timing of the blasts (delays)",
    "ground": "the ground between blasts and stations (new bench, loosened rock)",
}


@dataclass(frozen=True, eq=False)
class StepChange:
    """Change of records from one blast on.

    Parameters
    ----------
    blast : int
        First blast after it, by number in the log.
    interval : tuple of 2 int
        First and last blast that may be the first after it (90 %).
    kinds : tuple of str
        Kinds that these records can't tell apart, the best first; see `WORDS`.
    station : int or None
        None where it concerns all.
    step, error : (n_features,) float, or (n_stations, n_features) for "ground"
        Step of each of `FEATURES`, and its standard deviation; 0 where the kind has none.
    evidence : float
        Log of the evidence above that of no change.
    length : int
        Blasts over which it grew; 0 of a step.
    """

    blast: int
    interval: tuple[int, int]
    kinds: tuple[str, ...]
    station: int | None
    step: np.ndarray
    error: np.ndarray
    evidence: float
    length: int = 0


def residuals(features: np.ndarray, scaled: np.ndarray, azimuth: np.ndarray) -> np.ndarray:
    """Return the features without the effects of distance, charge and direction.

    Parameters
    ----------
    features : (n_blasts, n_stations, n_features) float64
        See `FEATURES`; NaN where a record is missing.
    scaled : (n_blasts, n_stations, 2) float64
        log10 of distance and of charge.
    azimuth : (n_blasts, n_stations) float64, rad
        Of the blast at the station, from the first axis of the sensor's horizontal plane.

    Returns
    -------
    (n_blasts, n_stations, n_features) float64
        About the median of each station. Slopes are those of differences between successive
        records of a station, which a change touches once; the polarization is taken relative to
        the direction of the blast where it then varies less, as at a sensor that stays as it is. A
        record far off its neighbours counts 4 robust standard deviations.
    """
    known = np.isfinite(features).all(axis=-1) & np.isfinite(scaled).all(axis=-1)
    values = np.where(known[..., None], features, np.nan)
    turned = (values[..., ALONG] + 1j * values[..., ACROSS]) * np.exp(-2j * azimuth)
    polar = np.stack([turned.real, turned.imag], axis=-1)
    as_read = values[..., [ALONG, ACROSS]]
    if np.nansum(_about_mean(polar) ** 2) < np.nansum(_about_mean(as_read) ** 2):
        values[..., [ALONG, ACROSS]] = polar
    covariates, change = _steps(np.where(known[..., None], scaled, np.nan)), _steps(values)
    levels = [HORIZONTAL, VERTICAL, FREQUENCY, DURATION]
    if len(change) > FEWEST:
        slope = np.linalg.lstsq(covariates, _clipped(change[:, levels]), rcond=1e-3)[0]
        values[..., levels] -= scaled @ slope
    for s in range(values.shape[1]):
        own = values[known[:, s], s]
        if len(own):
            values[known[:, s], s] = _without_outliers(own) - np.median(own, axis=0)
    return values


def _about_mean(values):
    """Return values about the mean of each station."""
    count = np.maximum(np.isfinite(values).sum(axis=0), 1)
    return values - np.nansum(values, axis=0) / count


def _steps(values):
    """Return the differences of successive records of each station, (n, n_features)."""
    own = [part[np.isfinite(part).all(axis=-1)] for part in np.swapaxes(values, 0, 1)]
    return np.concatenate([np.diff(part, axis=0) for part in own])


def _clipped(values):
    """Return values (n, k) within 4 robust standard deviations of 0."""
    most = CLIPPED * NORMAL_MAD * np.median(np.abs(values), axis=0)
    return np.clip(values, -most, most)


def _without_outliers(series):
    """Return a series (n, k) within 4 robust standard deviations of the median of 5 neighbours."""
    padded = np.pad(series, ((2, 2), (0, 0)), mode="edge")
    smooth = np.median([padded[k : k + len(series)] for k in range(5)], axis=0)
    return smooth + _clipped(series - smooth)


@dataclass(eq=False)
class _Scan:
    """Likelihood of steps in residuals: covariance of blasts and records, kinds, sums."""

    residual: np.ndarray
    present: np.ndarray = field(init=False)
    weights: np.ndarray = field(init=False)
    common: np.ndarray = field(init=False)
    patterns: list[tuple[str, int | None, np.ndarray]] = field(init=False)
    sums: list = field(init=False)

    def __post_init__(self):
        """Estimate the covariances, and sum the information of each kind over the blasts."""
        self.present = np.isfinite(self.residual).all(axis=-1)
        records, blasts = _covariances(self.residual, self.present)
        self.weights = np.linalg.inv(records)
        count = self.present.sum(axis=1)
        self.common = np.stack([
            self.weights @ blasts @ np.linalg.inv(records + m * blasts)
            for m in range(self.present.shape[1] + 1)
        ])[count]  # fmt: skip
        self.patterns = _patterns(self.present.shape[1])
        self.sums = [
            (row, length, sums) for row in self.patterns for length in LENGTHS
            if not (length and row[1] is None)  # drifts of one station alone
            and (sums := self._information(row[2], length)) is not None
        ]  # fmt: skip

    def _information(self, pattern, length):
        """Return where a change is possible, what a level before takes of it, inverse of the rest.

        The level before and the size of the change are fitted together, over the reach.
        """
        on = self.present[..., None, None] * pattern
        whole = on.sum(axis=1)
        each = np.einsum("bsfi,fg,bsgj->bij", on, self.weights, on, optimize=True)
        each -= np.einsum("bfi,bfg,bgj->bij", whole, self.common, whole, optimize=True)
        touched = (np.abs(pattern).sum(axis=(1, 2)) > 0) & self.present.any(axis=0)
        count = self.present[:, touched].astype(int)
        whole, after, _ = _moments(count, 0)
        used = np.flatnonzero(((whole - after >= FEWEST) & (after >= FEWEST)).any(axis=1))
        if not len(used):
            return None
        whole, first, second = (part[used] for part in _moments(each, length))
        tiny = 1e-9 * np.eye(pattern.shape[-1]) * max(np.trace(each.sum(axis=0)), 1.0)
        level = first @ np.linalg.inv(whole + tiny)
        return used, level, np.linalg.inv(second - level @ first + tiny)

    def scores(self, residual):
        """Return the residuals (n_blasts, n_stations, n_features) times the inverse covariance."""
        known = np.where(self.present[..., None], residual, 0.0)
        shared = np.einsum("bfg,bg->bf", self.common, known.sum(axis=1))
        return np.where(self.present[..., None], known @ self.weights - shared[:, None], 0.0)

    def misfit(self, residual):
        """Return the negative log likelihood of residuals."""
        known = np.where(self.present[..., None], residual, 0.0)
        return 0.5 * float((known * self.scores(residual)).sum())

    def price(self, change):
        """Log of the evidence that the parameters, kinds and dates of a change cost."""
        kinds = [name for name, _, _ in self.patterns]
        return self._price(self.patterns[kinds.index(change.kinds[0])][2])

    def _price(self, pattern):
        count = len(self.present)
        paid = 0.5 * pattern.shape[-1] * np.log(min(2 * REACH, count))
        return paid + np.log(count * len(self.patterns))

    def best(self, residual, lengths):
        """Return the best change of each kind that grows over one of these lengths, by evidence."""
        score, rows = self.scores(residual), []
        for (name, station, pattern), length, (used, level, inverse) in self.sums:
            if length not in lengths:
                continue
            each = np.einsum("bsf,sfi->bi", score, pattern)
            whole, grown, _ = (part[used] for part in _moments(each, length))
            rest = grown - np.einsum("bij,bj->bi", level, whole)
            ratio = 0.5 * np.einsum("bi,bij,bj->b", rest, inverse, rest)
            k = int(np.argmax(ratio))
            evidence = ratio[k] - self._price(pattern)
            error = np.sqrt(np.diag(inverse[k]))
            step = np.where(error < UNSEEN, inverse[k] @ rest[k], 0.0)
            rows.append(
                _Candidate(evidence, name, station, pattern, length, used, ratio, step, error)
            )
        return sorted(rows, key=lambda row: -row.evidence)


class _Candidate(NamedTuple):
    """Change of a kind at its best date; ratio: log likelihood of each possible date."""

    evidence: float
    kind: str
    station: int | None
    pattern: np.ndarray
    length: int
    used: np.ndarray
    ratio: np.ndarray
    step: np.ndarray
    error: np.ndarray

    @property
    def blast(self):
        """First blast of the change."""
        return int(self.used[np.argmax(self.ratio)])


def _moments(values, length):
    """Return sums around each blast of values, of them times the growth of a change, its square.

    The change begins at that blast, grows over ``length`` blasts and stays; sums go from the reach
    before its begin to the reach after its end.
    """
    at, count = np.arange(len(values)), len(values)
    shape = (-1, *(1,) * (values.ndim - 1))
    position, ends = at.reshape(shape), np.minimum(at + length, count)

    def between(part, first, last):
        total = np.concatenate([np.zeros_like(part[:1]), np.cumsum(part, axis=0)])
        return total[last] - total[first]

    zeroth, first, second = (between(values * position**k, at, ends) for k in range(3))
    scale = 1.0 / max(length, 1)
    last = np.minimum(ends + REACH, count)
    after = between(values, ends, last)
    return (
        between(values, np.maximum(at - REACH, 0), last),
        scale * (first - position * zeroth) + after,
        scale**2 * (second - 2 * position * first + position**2 * zeroth) + after,
    )


def _covariances(residual, present):
    """Return the covariances (n_features, n_features) of records and of what blasts share."""
    pairs = present[1:] & present[:-1]
    change = np.where(pairs[..., None], np.diff(residual, axis=0), np.nan)
    flat = change.reshape(-1, change.shape[-1])
    most = CLIPPED * NORMAL_MAD * np.nanmedian(np.abs(flat), axis=0)
    change = np.nan_to_num(np.clip(change, -most, most))
    own = np.einsum("bsf,bsg->fg", change, change) / (2.0 * pairs.sum())
    whole, count = change.sum(axis=1), pairs.sum(axis=1)
    crossed = np.einsum("bf,bg->fg", whole, whole) - np.einsum("bsf,bsg->fg", change, change)
    shared = crossed / max(2.0 * (count * (count - 1)).sum(), 1.0)
    shared = _positive(0.5 * (shared + shared.T), 0.0)
    return _positive(own - shared, 0.05 * np.trace(own) / len(own)), shared


def _positive(matrix, least):
    """Return the nearest symmetric matrix whose eigenvalues are at least so large."""
    values, vectors = np.linalg.eigh(matrix)
    return (vectors * np.maximum(values, least)) @ vectors.T


def _patterns(n_stations):
    """Return kind, station and pattern (n_stations, n_features, n_parameters) of each step."""
    rows = []
    for name, (side, groups) in KINDS.items():
        steps = np.zeros((len(FEATURES), len(groups)))
        for k, group in enumerate(groups):
            steps[list(group), k] = 1.0
        if side == "practice":
            rows.append((name, None, np.tile(steps, (n_stations, 1, 1))))
        elif side == "ground":
            width = len(groups)
            each = np.zeros((n_stations, len(FEATURES), n_stations * width))
            for s in range(n_stations):
                each[s, :, width * s : width * (s + 1)] = steps
            rows.append((name, None, each))
        else:
            for s in range(n_stations):
                each = np.zeros((n_stations, *steps.shape))
                each[s] = steps
                rows.append((name, s, each))
    return rows


def changes(residual: np.ndarray) -> list[StepChange]:
    """Find steps in the residuals of records, one after another, their kinds, and drifts.

    Parameters
    ----------
    residual : (n_blasts, n_stations, n_features) float64
        Of `residuals`, by time; NaN where a record is missing.

    Returns
    -------
    list of StepChange
        By time. None where fewer than 8 records of a station are there.

    Notes
    -----
    Generalised likelihood ratio of a step of each kind at each blast, with one covariance of single
    records and one that all records of a blast share, both by successive differences; the number
    of parameters and of places tried is paid for as in the Bayesian information criterion. Up to
    three steps of one station in turn, alike in kind and direction, become one drift where that
    fits all records better by 3 in the log of the likelihood.
    """
    if np.isfinite(residual).all(axis=-1).sum(axis=0).max(initial=0) < 2 * FEWEST:
        return []
    scan, rest = _Scan(residual), residual.copy()
    result: list[StepChange] = []
    for _ in range(PASSES):
        while len(result) < MOST and (change := _next(scan, rest)) is not None:
            result.append(change)
            rest = rest - _shape(change, residual.shape)
        for k in range(len(result) - 1, -1, -1):
            rest = rest + _shape(result[k], residual.shape)
            again = _next(scan, rest)
            if again is None:
                del result[k]
            else:
                result[k] = again
                rest = rest - _shape(again, residual.shape)
    result = _with_drifts(scan, rest, result)
    return sorted(result, key=lambda change: change.blast)


def _with_drifts(scan, rest, steps):
    """Return the changes with those steps replaced that a drift explains better.

    A drift leaves one step, or several of its kind in turn. Both are judged by all records.
    """
    result = sorted(steps, key=lambda change: change.blast)
    for count in (3, 2, 1):
        for first in list(result):
            group = [change for change in result if _alike(first, change)][:count]
            if len(group) < count or first not in result:
                continue
            without = rest + sum(_shape(change, rest.shape) for change in group)
            drift = _next(scan, without, LENGTHS[1:])
            if drift is None or not _alike(first, drift, before=max(LENGTHS)):
                continue
            residual = without - _shape(drift, rest.shape)
            gain = scan.misfit(rest) - scan.misfit(residual)
            if gain + (count - 1) * scan.price(first) > DRIFT:
                result = [change for change in result if change not in group]
                result.append(drift)
                rest = residual
    return result


def _alike(first, other, before=0):
    """Return whether a change is of the kind, station and direction of an earlier one."""
    return (
        first.station == other.station and first.kinds[0] == other.kinds[0]
        and -before <= other.blast - first.blast <= max(LENGTHS)
        and float((first.step * other.step).sum()) > 0.0
    )  # fmt: skip


def _next(scan, residual, lengths=LENGTHS[:1]):
    """Return the change of most evidence, None where none has enough."""
    rows = scan.best(residual, lengths)
    if not rows or rows[0].evidence < SURE:
        return None
    best = rows[0]
    share = np.exp(best.ratio - best.ratio.max())
    order = np.argsort(-share)
    inside = order[: int(np.searchsorted(np.cumsum(share[order]) / share.sum(), SHARE)) + 1]
    ends = int(best.used[inside.min()]), int(best.used[inside.max()])
    kinds = [
        row.kind for row in rows
        if best.evidence - row.evidence < LEAD and row.length == best.length
        and ends[0] - 1 <= row.blast <= ends[1] + 1
    ]  # fmt: skip
    size, spread = best.pattern @ best.step, np.abs(best.pattern) @ best.error
    if best.station is not None:
        size, spread = size[best.station], spread[best.station]
    elif best.kind != "ground":
        size, spread = size[0], spread[0]
    if "coupling" in kinds:
        kinds.append("ground")  # on the way to one station
    return StepChange(
        best.blast, ends, tuple(dict.fromkeys(kinds)), best.station, size, spread,
        float(best.evidence), best.length,
    )  # fmt: skip


def _shape(change, shape):
    """Return what a change adds to the residuals."""
    since = np.arange(shape[0]) - change.blast
    grown = np.clip(since / max(change.length, 1), 0.0, 1.0) if change.length else since >= 0
    added, grown = np.zeros(shape), grown.astype(float)[:, None]
    if change.station is None:
        added += grown[..., None] * change.step
    else:
        added[:, change.station] += grown * change.step
    return added
