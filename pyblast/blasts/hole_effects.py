"""Hole effects: factor on each hole's motion at each receiver, from the hole table."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np

from .blast import Blast

RELIEF = 8e-3  # s/m of burden, in which the rock in front of a hole gets out of the way
REACH = 7.0  # m from a hole, to which it damages the rock
BROKEN = 4e-3, 8e-3  # s before a hole fires: rock is damaged, ground on the way is broken
ALONG = 80.0, 0.5  # m of a path that may lie in broken ground, and the step along it
LATE = 0.2  # s
ALIKE = 0.7  # correlation of covariates, above which their effects are hardly separable
HARDLY = "hardly varies"  # said of a covariate that can't explain anything here
KERNELS = "scale", "delay", "loss", "duration"


@dataclass(frozen=True, eq=False)
class Pattern:
    """Pattern of a blast: its holes as the covariates of hole effects see them.

    Parameters
    ----------
    blast : Blast
    receivers : (n_receivers, 3) float64, m
    reference : float, kg
        Charge at which the law of the charge is right.
    """

    blast: Blast
    receivers: np.ndarray
    reference: float = 1.0

    @cached_property
    def places(self) -> np.ndarray:
        """Middles of the charges in plan, (n_holes, 2) m."""
        return self.blast.centres[:, :2]

    @cached_property
    def away(self) -> np.ndarray:
        """Direction from the face into the rock, (2,): that in which firing times grow."""
        centred = self.places - self.places.mean(axis=0)
        slope = np.linalg.lstsq(centred, self.blast.times - self.blast.times.mean(), rcond=None)[0]
        if np.isfinite(self.blast.row).all() and np.ptp(self.blast.row) > 0.0:
            rows = self.blast.row - self.blast.row.mean()
            slope = np.linalg.lstsq(centred, rows, rcond=None)[0]
        if np.isfinite(self.blast.face):
            slope = -np.array([np.sin(self.blast.face), np.cos(self.blast.face)])
        return slope / max(float(np.linalg.norm(slope)), 1e-12)

    @cached_property
    def burden(self) -> float:
        """Burden in m: of the table, else the usual share of the distance between neighbours."""
        if np.isfinite(self.blast.burden).any():
            return float(np.nanmedian(self.blast.burden))
        apart = np.linalg.norm(self.places[:, None] - self.places, axis=-1)
        apart[apart < 0.5] = np.inf  # decks of one hole
        nearest = apart.min(axis=1, initial=np.inf)
        known = np.isfinite(nearest)
        return 0.8 * float(np.median(nearest[known])) if known.any() else 1.0

    @cached_property
    def rows(self) -> np.ndarray:
        """Number of the row of each hole, from the face on, (n_holes,)."""
        if np.isfinite(self.blast.row).all():
            return self.blast.row
        deep = self.places @ self.away
        order = np.argsort(deep, kind="stable")
        jumps = np.diff(deep[order]) > 0.4 * self.burden
        rows = np.empty(len(deep))
        rows[order] = np.concatenate([[0.0], np.cumsum(jumps)])
        return rows

    @cached_property
    def stemming(self) -> np.ndarray:
        """Stemming of each hole in m: of the table, else what the charge leaves of the hole."""
        if np.isfinite(self.blast.stemming).any():
            return self.blast.stemming
        top = np.linalg.norm(self.blast.columns[:, 0] - self.blast.collar, axis=1)
        known = np.isfinite(self.blast.charge_length) | ~np.isnan(self.blast.deck).any(axis=1)
        return np.where(known & (top > 0.0), top, np.nan)


def log_charge(p: Pattern) -> np.ndarray:
    """Return ln(W/W0), (n_holes, 1); W0 is alike in all blasts."""
    loaded = np.where(p.blast.charge > 0.0, p.blast.charge, p.reference)
    return np.log(loaded / p.reference)[:, None]


def confinement(p: Pattern) -> np.ndarray:
    """Return how far the rock in front of each hole still stands, 0 to 1, (n_holes, 1)."""
    deep, along = p.places @ p.away, p.places @ np.array([p.away[1], -p.away[0]])
    ahead = deep[:, None] - deep
    front = (ahead > 0.5 * p.burden) & (ahead < 1.5 * p.burden)
    front &= np.abs(along[:, None] - along) < 1.3 * p.burden
    first = np.min(np.where(front, p.blast.times, np.inf), axis=1, initial=np.inf)
    late = np.where(np.isfinite(first), p.blast.times - first, 0.0 if p.blast.choked else np.inf)
    return np.exp(-np.maximum(late, 0.0) / (RELIEF * p.burden))[:, None]


def damage(p: Pattern) -> np.ndarray:
    """Return the damage of the rock around each hole by earlier ones, (n_holes, 1)."""
    apart = np.linalg.norm(p.places[:, None] - p.places, axis=-1)
    earlier = p.blast.times[:, None] - p.blast.times > BROKEN[0]
    share = np.exp(-((apart / REACH) ** 2)) * (earlier & (apart > 0.5))
    return 0.5 * share.sum(axis=1)[:, None]


@lru_cache(maxsize=32)  # seconds for hundreds of holes
def broken_ground(p: Pattern) -> np.ndarray:
    """Return the m of ground that earlier holes broke on each way, (n_holes, n_receivers)."""
    out = np.zeros((len(p.places), len(p.receivers)))
    along = np.arange(ALONG[1], *ALONG)
    for h, at in enumerate(p.places):
        fired = p.places[p.blast.times[h] - p.blast.times > BROKEN[1]]
        step = p.receivers[:, :2] - at
        length = np.linalg.norm(step, axis=1)
        fired = fired[np.linalg.norm(fired - at, axis=1) < ALONG[0] + p.burden]
        if not len(fired):
            continue
        ray = step / np.maximum(length, 1e-9)[:, None]
        points = at + ray[:, None] * along[:, None]
        near = np.linalg.norm(points[:, :, None] - fired, axis=-1).min(axis=-1)
        inside = (near < 0.5 * p.burden) & (along < length[:, None])
        out[h] = ALONG[1] * np.sum(inside, axis=1)
    out.setflags(write=False)
    return out


def row_number(p: Pattern) -> np.ndarray:
    """Return the number of the row of each hole less its mean, (n_holes, 1)."""
    return (p.rows - p.rows.mean())[:, None]


def lateness(p: Pattern) -> np.ndarray:
    """Return the planned time of each hole in 0.2 s less its mean, (n_holes, 1)."""
    return ((p.blast.times - p.blast.times.mean()) / LATE)[:, None]


def log_stemming(p: Pattern) -> np.ndarray:
    """Return ln of the stemming over its median, zero where unknown, (n_holes, 1)."""
    known = np.isfinite(p.stemming) & (p.stemming > 0.0)
    if not known.any():
        return np.zeros((len(known), 1))
    middle = np.median(p.stemming[known])
    return np.log(np.where(known, p.stemming, middle) / middle)[:, None]


def later_deck(p: Pattern) -> np.ndarray:
    """Return 1 for decks that fire after another one of their hole, less its mean, (n_holes, 1)."""
    apart = np.linalg.norm(p.blast.collar[:, None] - p.blast.collar, axis=-1)
    earlier = (apart < 0.5) & (p.blast.times < p.blast.times[:, None])
    later = earlier.any(axis=1).astype(float)
    return (later - later.mean())[:, None]


def since_first(p: Pattern) -> np.ndarray:
    """Return the planned time of each hole after the first one, s, (n_holes, 1)."""
    return (p.blast.times - p.blast.times.min())[:, None]


class HoleChange(NamedTuple):
    """Change of what each hole sends to each receiver; all broadcast to (n_holes, n_receivers).

    Parameters
    ----------
    scale : float64 array
        Factor on the amplitude.
    delay : float64 array, s
    loss : float64 array, s
        t*: travel time over Q.
    duration : float64 array
        Logarithm of the factor on the duration of the pulse.
    """

    scale: np.ndarray | float = 1.0
    delay: np.ndarray | float = 0.0
    loss: np.ndarray | float = 0.0
    duration: np.ndarray | float = 0.0

    def factor(self, omega: np.ndarray, middle: float, pulse: np.ndarray | float = 0.0):
        """Return the factor on spectra, (n_holes, n_receivers or 1, n_omega) complex128.

        Parameters
        ----------
        omega : (n_omega,) float64, rad/s
        middle : float, rad/s
            At which a loss changes no phase.
        pulse : (n_omega,) complex128, optional
            Derivative of the logarithm of the spectrum of the pulse by that of frequency.
        """
        slow = np.log(np.maximum(omega, 1e-3 * middle) / middle)
        kernels = (
            (self.delay, -1j * omega),
            (self.loss, -0.5 * omega * (1.0 - 2j / np.pi * slow)),
            (self.duration, pulse),
        )
        log = sum(np.multiply.outer(_two(x), k) for x, k in kernels if np.any(x))
        return _two(self.scale)[..., None] * np.exp(log)

    def over(self, other: "HoleChange") -> "HoleChange":
        """Return the change that makes this one of another one, whose scales aren't zero."""
        rest = (_two(x) - _two(y) for x, y in zip(self[1:], other[1:], strict=True))
        return HoleChange(_two(self.scale) / _two(other.scale), *rest)


def together(changes: Sequence[HoleChange]) -> HoleChange:
    """Return several changes of the same holes as one."""
    scale, rest = 1.0, np.zeros(3).tolist()
    for change in changes:
        scale = scale * _two(change.scale)
        rest = [x + _two(y) for x, y in zip(rest, change[1:], strict=True)]
    return HoleChange(scale, *rest)


def _two(x):
    """Return a value of each hole, or of each hole and receiver, as an array of two axes."""
    x = np.asarray(x, dtype=float)
    return x.reshape(-1, 1) if x.ndim < 2 else x


class HoleEffect(NamedTuple):
    """Hole effect: a row of the table, θ times a covariate times a kernel in ln H.

    Parameters
    ----------
    label, form, claim : str
    kernel : str
        Of `KERNELS`.
    covariate : callable
        ``(pattern) -> (n_holes, n_receivers or 1) float64``.
    least : float
        Standard deviation of the covariate over holes and receivers, below which it hardly varies.
    unit : str
        Of the covariate.
    meaning : str
        What hardly varies then.
    remedy : str
        What would let it vary.
    decided_by : str
        The measurement that would tell it from others.
    """

    label: str
    form: str
    claim: str
    kernel: str
    covariate: Callable[[Pattern], np.ndarray]
    least: float
    unit: str
    meaning: str
    remedy: str
    decided_by: str

    @property
    def name(self) -> str:
        """Its key: the label, with its form after a slash."""
        return f"{self.label}/{self.form}" if self.form else self.label

    def change(self, pattern: Pattern, strength: float) -> HoleChange:
        """Return what a strength θ changes of a blast."""
        amount = strength * self.covariate(pattern)
        return HoleChange(**{self.kernel: np.exp(amount) if self.kernel == "scale" else amount})

    def hardly_varies(self, patterns: Sequence[Pattern]) -> str:
        """Return the sentence that its covariate hardly varies over blasts; empty if it does."""
        each = [self.covariate(p) for p in patterns]
        spread = float(np.std(np.concatenate([np.ravel(c) for c in each]))) if each else 0.0
        if spread >= self.least:
            return ""
        return (
            f"{self.meaning} {HARDLY} (standard deviation {spread:.2g}{self.unit}; "
            f"{self.least:g}{self.unit} are needed): {self.remedy}"
        )


def over_holes(
    rows: Sequence[HoleEffect],
    pattern: Pattern,
    frequency: np.ndarray,
    strengths: Sequence[float],
    pulse: np.ndarray | float = 0.0,
) -> np.ndarray:
    """Return the factor on what each hole sends to each receiver, all rows together.

    Parameters
    ----------
    rows : sequence of n HoleEffect
    pattern : Pattern
    frequency : (n_frequencies,) float64, Hz
    strengths : sequence of n float
    pulse
        As of `HoleChange.factor`.

    Returns
    -------
    (n_holes, n_receivers or 1, n_frequencies) complex128
        exp(Σ θ c g); theory.md (12.10).

    Examples
    --------
    >>> blast = Blast("B", [[0, 0, 0], [5, 0, 0]], [[0, 0, -9], [5, 0, -9]], [40, 80], [0, 0.02])
    >>> row = next(row for row in ROWS if row.name == "charge_exponent")
    >>> pattern = Pattern(blast, np.array([[60.0, 0.0, 0.0]]), reference=40.0)
    >>> np.abs(over_holes([row], pattern, np.array([10.0]), [1.0])).ravel().round(6).tolist()
    [1.0, 2.0]
    """
    omega = 2.0 * np.pi * np.asarray(frequency, dtype=float)
    middle = float(np.sqrt(omega[omega > 0.0].min() * omega.max()))
    changes = [row.change(pattern, x) for row, x in zip(rows, strengths, strict=True)]
    return together(changes).factor(omega, middle, pulse)


_CHARGES = "holes of 35 to 130 kg, drawn over the pattern"
_ACROSS = "a receiver across the pit, whose waves cross the ground that the blast broke"
ROWS = (
    HoleEffect(
        "charge_exponent", "", "What a hole radiates grows with its charge by another exponent.",
        "scale", log_charge, 0.1, "", "ln of the charge", _CHARGES,
        "charges of four to one, drawn over the holes of a blast",
    ),
    HoleEffect(
        "pulse_length", "", "The pulse of a hole lengthens with its charge.",
        "duration", log_charge, 0.1, "", "ln of the charge", _CHARGES,
        "charges of four to one, drawn over the holes, and a band of two octaves",
    ),
    HoleEffect(
        "confinement", "", "Holes radiate otherwise where the rock in front has not moved yet.",
        "scale", confinement, 0.1, "", "the relief in front of the holes",
        "a blast with other delays between rows, or a choked one",
        "a choked blast, or one with other delays between its rows",
    ),
    HoleEffect(
        "damage_by_earlier_holes", "", "Holes radiate otherwise in rock that earlier ones damaged.",
        "scale", damage, 0.1, "", "the damage by earlier holes",
        "a blast with more than one row", "a blast that is initiated from another end",
    ),
    HoleEffect(
        "screening", "", "Ground that earlier holes broke weakens what crosses it.",
        "scale", broken_ground, 0.5, " m", "broken ground on the way", _ACROSS, _ACROSS,
    ),
    HoleEffect(
        "screening", "loss", "Ground that earlier holes broke takes high frequencies from waves.",
        "loss", broken_ground, 0.5, " m", "broken ground on the way", _ACROSS, _ACROSS,
    ),
    HoleEffect(
        "screening", "delay", "Ground that earlier holes broke delays what crosses it.",
        "delay", broken_ground, 0.5, " m", "broken ground on the way", _ACROSS, _ACROSS,
    ),
    HoleEffect(
        "row_number", "", "Holes of later rows radiate more, or less, row by row.",
        "scale", row_number, 0.4, "", "the row", "a blast of two rows or more",
        "the same charges in all rows, and a blast that is initiated from another end",
    ),
    HoleEffect(
        "late_holes", "", "Holes that fire late radiate more, or less, than early ones.",
        "scale", lateness, 0.1, "", "the time after the first hole, in 0.2 s,",
        "a blast of longer duration", "a blast that is initiated from another end",
    ),
    HoleEffect(
        "stemming", "", "Holes with short stemming radiate more, or less, than those with long.",
        "scale", log_stemming, 0.1, "", "ln of the stemming",
        "stemming in the hole table, of different lengths", "stemming of two lengths in one blast",
    ),
    HoleEffect(
        "second_deck", "", "A later deck of a hole radiates more, or less, than the first.",
        "scale", later_deck, 0.1, "", "the order of decks", "a blast with holes of two decks",
        "a blast in which some holes have one deck",
    ),
)  # fmt: skip


def what_would_tell(patterns: Sequence[Pattern]) -> list[str]:
    """Return which holes or receivers would tell hole effects that these blasts can't tell.

    A sentence for each covariate that hardly varies, and for each pair of one kernel whose
    covariates have a correlation of at least `ALIKE`.
    """
    reasons, varying = {}, []
    for row in ROWS:
        reason = row.hardly_varies(patterns)
        if reason:
            reasons.setdefault(reason, []).append(row.name)
        else:
            each = [np.broadcast_to(row.covariate(p), (len(p.places), len(p.receivers)))
                    for p in patterns]  # fmt: skip
            varying.append((row, np.concatenate([np.ravel(c) for c in each])))
    lines = [f"{', '.join(names)}: {reason}" for reason, names in reasons.items()]
    for n, (row, own) in enumerate(varying):
        for other, beside in varying[n + 1 :]:
            alike = float(np.corrcoef(own, beside)[0, 1])
            if row.kernel == other.kernel and abs(alike) >= ALIKE:
                lines.append(
                    f"{row.name} and {other.name} are hardly separable (correlation "
                    f"{alike:.2f}): {row.decided_by}; or {other.decided_by}"
                )
    return lines
