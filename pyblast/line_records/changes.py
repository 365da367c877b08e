"""Changes of a site: control charts of residuals, steps with date, interval and kind."""

from dataclasses import dataclass, field

import numpy as np

from .monitoring import FEATURES

FEWEST = 4  # records of a station, or blasts, on either side of a change
SURE = 4.0  # log of the evidence above that of no change
LEAD = 3.0  # log of the evidence by which a kind must lead another to be named alone
MOST = 40  # changes
REACH = 60  # blasts on either side of a change by which it is judged
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


@dataclass(frozen=True)
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
    """

    blast: int
    interval: tuple[int, int]
    kinds: tuple[str, ...]
    station: int | None
    step: np.ndarray
    error: np.ndarray
    evidence: float


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
        self.sums = [self._information(pattern) for _, _, pattern in self.patterns]

    def _information(self, pattern):
        """Return where a step is possible, and the inverse information before, after and in all."""
        on = self.present[..., None, None] * pattern
        whole = on.sum(axis=1)
        each = np.einsum("bsfi,fg,bsgj->bij", on, self.weights, on, optimize=True)
        each -= np.einsum("bfi,bfg,bgj->bij", whole, self.common, whole, optimize=True)
        touched = (np.abs(pattern).sum(axis=(1, 2)) > 0) & self.present.any(axis=0)
        seen = [part[:, touched] >= FEWEST for part in _sides(self.present.astype(int))]
        used = np.flatnonzero((seen[0] & seen[1]).any(axis=1))
        if not len(used):
            return None
        before, after = (part[used] for part in _sides(each))
        tiny = 1e-9 * np.eye(pattern.shape[-1]) * max(np.trace(each.sum(axis=0)), 1.0)
        return (used, np.linalg.inv(before + tiny), np.linalg.inv(after + tiny),
                np.linalg.inv(before + after + tiny))  # fmt: skip

    def scores(self, residual):
        """Return the residuals (n_blasts, n_stations, n_features) times the inverse covariance."""
        known = np.where(self.present[..., None], residual, 0.0)
        shared = np.einsum("bfg,bg->bf", self.common, known.sum(axis=1))
        return np.where(self.present[..., None], known @ self.weights - shared[:, None], 0.0)

    def best(self, residual):
        """Return the evidence of the best step of each kind: (evidence, kind, ratio, steps)."""
        score, rows = self.scores(residual), []
        n_tried = len(residual) * len(self.patterns)
        for (name, station, pattern), sums in zip(self.patterns, self.sums, strict=True):
            if sums is None:
                continue
            used, first, second, whole = sums
            each = np.einsum("bsf,sfi->bi", score, pattern)
            before, after = (part[used] for part in _sides(each))
            total = before + after
            ratio = 0.5 * (_square(before, first) + _square(after, second) - _square(total, whole))
            k = int(np.argmax(ratio))
            paid = 0.5 * pattern.shape[-1] * np.log(min(2 * REACH, len(residual)))
            evidence = ratio[k] - paid - np.log(n_tried)
            step = second[k] @ after[k] - first[k] @ before[k]
            error = np.sqrt(np.diag(first[k] + second[k]))
            step = np.where(error < UNSEEN, step, 0.0)
            rows.append((evidence, name, station, pattern, used, ratio, step, error))
        return sorted(rows, key=lambda row: -row[0])


def _sides(values):
    """Return the sums over the blasts before each one, and from it on, within the reach."""
    total = np.concatenate([np.zeros_like(values[:1]), np.cumsum(values, axis=0)])
    at = np.arange(len(values))
    before = total[at] - total[np.maximum(at - REACH, 0)]
    return before, total[np.minimum(at + REACH, len(values))] - total[at]


def _square(vectors, matrices):
    """Return the quadratic form of each vector, (n,)."""
    return np.einsum("bi,bij,bj->b", vectors, matrices, vectors)


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
    """Find steps in the residuals of records, one after another, and their kinds.

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
    of parameters and of places tried is paid for as in the Bayesian information criterion.
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
    return sorted(result, key=lambda change: change.blast)


def _next(scan, residual):
    """Return the change of most evidence, None where none has enough."""
    rows = scan.best(residual)
    if not rows or rows[0][0] < SURE:
        return None
    evidence, _, station, pattern, used, ratio, step, error = rows[0]
    share = np.exp(ratio - ratio.max())
    order = np.argsort(-share)
    inside = order[: int(np.searchsorted(np.cumsum(share[order]) / share.sum(), SHARE)) + 1]
    blast = int(used[np.argmax(ratio)])
    ends = int(used[inside.min()]), int(used[inside.max()])
    kinds = [
        row[1] for row in rows
        if evidence - row[0] < LEAD
        and ends[0] - 1 <= row[4][np.argmax(row[5])] <= ends[1] + 1
    ]  # fmt: skip
    size, spread = pattern @ step, np.abs(pattern) @ error
    if station is not None:
        size, spread = size[station], spread[station]
    elif rows[0][1] != "ground":
        size, spread = size[0], spread[0]
    if "coupling" in kinds:
        kinds.append("ground")  # on the way to one station
    return StepChange(
        blast, ends, tuple(dict.fromkeys(kinds)), station, size, spread, float(evidence)
    )


def _shape(change, shape):
    """Return what a change adds to the residuals."""
    added = np.zeros(shape)
    after = added[change.blast :]
    if change.station is None:
        after += change.step
    else:
        after[:, change.station] += change.step
    return added
