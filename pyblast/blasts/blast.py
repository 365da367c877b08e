"""Blasts: positions, charges and firing times of holes, with plausibility checks."""

import math
from collections import Counter
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError

ANFO_DENSITY = 850.0
SAME_PLACE = 0.01
SAME_INSTANT = 1e-6
FAR_AWAY = 1000.0
ANGLE_TOLERANCE = math.radians(2.0)
LENGTH_TOLERANCE = 0.1


def hole_sentences(blast: "Blast") -> list[str]:
    """Return sentences on times, charges, names, positions, angles and lengths of holes.

    Parameters
    ----------
    blast : Blast

    Returns
    -------
    list of str
        Times and charge per 8 ms window; others only where they apply.
    """
    return [
        _timing(blast),
        _charging(blast),
        *_misfires(blast),
        *_not_filled_in(blast),
        *_duplicates(blast),
        *_far_holes(blast),
        *_angles(blast),
        *_lengths(blast),
        *_tight_charges(blast),
    ]


def _timing(blast):
    """Return a sentence on the first and last firing time."""
    first, last = 1e3 * blast.times.min(), 1e3 * blast.times.max()
    instants = len(np.unique(np.round(blast.times / SAME_INSTANT)))
    count = f"{len(blast.times)} charge{'s fire' if len(blast.times) > 1 else ' fires'}"
    if instants == 1:
        return f"{count} at one instant, {first:g} ms."
    return f"{count} at {instants} instants, the first at {first:g} ms, the last at {last:g} ms."


def _charging(blast):
    """Return a sentence on the charge per 8 ms window, or on missing charges."""
    missing = np.isnan(blast.charge)
    if np.any(missing):
        return (
            f"The charge is missing for {blast.named(missing)}; "
            "the charge per 8 ms window is not known."
        )
    times, charges = blast.window_charges()
    largest = int(np.argmax(charges))
    return (
        f"The largest charge in any 8 ms window is {charges[largest]:.6g} kg, from "
        f"{1e3 * times[largest]:g} ms on, of {np.sum(blast.charge):.6g} kg in all."
    )


def _misfires(blast):
    """Name the holes without any charge."""
    if np.any(blast.charge == 0.0):
        yield f"The charge is 0 for {blast.named(blast.charge == 0.0)}: no motion comes from there."


def _not_filled_in(blast):
    """Name what looks as if nobody had filled it in: no charges, no delays, odd toes."""
    if len(blast.charge) > 1 and np.all(blast.charge == 0.0):
        yield "All charges are 0: the table was not filled in, or every hole is a misfire."
    if len(blast.times) > 1 and not np.any(blast.times):
        yield "All holes fire at 0 ms: the table holds no delays, or nobody filled them in."
    rise = blast.toe[:, 2] - blast.collar[:, 2]
    if np.any(rise > 0.0):
        yield f"The toe lies above the collar: {blast.named(rise > 0.0)}."
    short = (blast.length == 0.0) & np.any(blast.length > 0.0)
    if np.any(short):
        yield f"Collar and toe are the same place, so the hole has no length: {blast.named(short)}."


def _duplicates(blast):
    """Find names, places and instants that occur twice."""
    ids = Counter(zip(blast.hole_ids, map(tuple, np.nan_to_num(blast.deck)), strict=True))
    twice = list(dict.fromkeys(name for (name, _), count in ids.items() if count > 1))
    if twice:
        yield f"Hole names that occur more than once: {', '.join(twice[:5])} ({len(twice)} in all)."
    cells = np.round((blast.centres - blast.centres[0]) / SAME_PLACE).astype(np.int64)
    n_shared = len(cells) - len(np.unique(cells, axis=0))
    if n_shared:
        yield f"{n_shared} charges lie within 1 cm of another charge of the table."
    ((instant, count),) = Counter(np.round(blast.times / SAME_INSTANT)).most_common(1)
    if count > 1:
        yield f"Up to {count} charges share one instant (at {1e3 * instant * SAME_INSTANT:g} ms)."


def _far_holes(blast):
    """Find holes more than 1 km from the centroid, taken by the median so that none moves it."""
    away = np.linalg.norm(blast.centres - np.median(blast.centres, axis=0), axis=1)
    if np.any(away > FAR_AWAY):
        yield f"More than 1 km from the centroid of the blast: {blast.named(away > FAR_AWAY)}."


def _angles(blast):
    """Find out whether stated angles count from the vertical, the horizontal or neither."""
    length = np.where(blast.length > 0.0, blast.length, np.nan)
    vertical = np.arccos(np.clip((blast.collar - blast.toe)[:, 2] / length, -1.0, 1.0))
    known = ~np.isnan(blast.stated_inclination) & ~np.isnan(vertical)
    from_vertical = np.abs(blast.stated_inclination - vertical) < ANGLE_TOLERANCE
    complement = math.pi / 2.0 - blast.stated_inclination
    from_horizontal = np.abs(complement - vertical) < ANGLE_TOLERANCE
    if np.any(from_horizontal & from_vertical):
        yield (
            "Angles near 45 degrees do not tell whether they count from the vertical: "
            f"{blast.named(from_horizontal & from_vertical)}."
        )
    if np.any(from_horizontal & ~from_vertical):
        yield (
            "The stated angle counts from the horizontal, by collar and toe: "
            f"{blast.named(from_horizontal & ~from_vertical)}."
        )
    neither = known & ~from_vertical & ~from_horizontal
    if np.any(neither):
        yield (
            "The stated angle differs from collar and toe by more than 2 degrees, whether from "
            f"the vertical or the horizontal: {blast.named(neither)}."
        )


def _lengths(blast):
    """Find stated lengths that differ from the distance between collar and toe."""
    gap = np.where(blast.length > 0.0, np.abs(blast.stated_length - blast.length), 0.0)
    off = gap > LENGTH_TOLERANCE
    if np.any(off):
        worst = int(np.nanargmax(gap))
        yield (
            f"The stated length differs from collar to toe by more than {LENGTH_TOLERANCE:g} m: "
            f"{blast.named(off)}; worst {blast.hole_ids[worst]}, "
            f"{blast.stated_length[worst]:.4g} m against {blast.length[worst]:.4g} m."
        )


def _tight_charges(blast):
    """Find charges that are longer than their deck or hole."""
    deck = blast.deck[:, 1] - blast.deck[:, 0]
    space = np.where(np.isnan(deck), blast.length, deck)
    filled = np.where(space > 0.0, blast.charge_length / np.where(space > 0.0, space, 1.0), 0.0)
    if np.any(filled > 1.0):
        worst, density = int(np.nanargmax(filled)), blast.explosive_density
        kind = f"at {density:g} kg/m3"
        if density == ANFO_DENSITY:
            kind = f"as ANFO ({density:g} kg/m3 assumed)"
        yield (
            f"The charge does not fit {kind}: {blast.named(filled > 1.0)}; "
            f"worst {blast.hole_ids[worst]}, {blast.charge[worst]:g} kg need "
            f"{blast.charge_length[worst]:.3g} m of {space[worst]:.3g} m "
            f"(a full hole would hold {filled[worst] * density:.4g} kg/m3)."
        )


CHARGE_WINDOW = 0.008
_INSTANT = 1e-9
FARTHEST, DEEPEST = 1e8, 1e4
NARROWEST, WIDEST = 0.01, 10.0
HEAVIEST, LATEST = 1e6, 1e3


@dataclass(frozen=True, eq=False)
class Firing:
    """Firing: times of the holes, and scales relative to the signature hole.

    Parameters
    ----------
    times : (n_holes,) float64, s
        May be negative where scatter moves a hole before the nominal start.
    scales : (n_holes,) float64
        Factor on the signature of each hole, ``a_i`` of the paper's eq. (10).

    Raises
    ------
    InputError
        If the lengths differ, no hole is given or a value is not finite.

    Examples
    --------
    >>> Firing.rows(2, 3, delay=0.025).times.tolist()
    [0.0, 0.0, 0.0, 0.025, 0.025, 0.025]
    """

    times: np.ndarray
    scales: np.ndarray

    def __post_init__(self) -> None:
        """Check the fields once and make them read-only."""
        times = np.array(self.times, dtype=np.float64, ndmin=1)
        scales = np.array(np.broadcast_to(self.scales, times.shape), dtype=np.float64)
        if times.ndim != 1 or len(times) == 0:
            raise InputError(f"firing.times: need one time per hole, got shape {times.shape}")
        for name, values in (("times", times), ("scales", scales)):
            if not np.all(np.isfinite(values)):
                hole = int(np.flatnonzero(~np.isfinite(values))[0])
                raise InputError(f"firing.{name}: must be finite, got {values[hole]:g} at {hole}")
            values.setflags(write=False)
            object.__setattr__(self, name, values)

    @classmethod
    def rows(cls, n_rows: int, holes_per_row: int, delay: float) -> "Firing":
        """Return the firing of rows ``delay`` s apart, holes of a row together, all scales 1."""
        if n_rows < 1 or holes_per_row < 1:
            raise InputError(f"firing.rows: need at least 1 x 1, got {n_rows} x {holes_per_row}")
        times = np.repeat(delay * np.arange(n_rows), holes_per_row)
        return cls(times, np.ones(len(times)))

    def comb_spectrum(self, frequency: ArrayLike) -> np.ndarray:
        """Return ``|sum a_i exp(-2 pi i f t_i)| / sum a_i`` at each frequency [Hz]; 1 at 0 Hz."""
        total = np.sum(self.scales)
        if total == 0.0:
            raise InputError("firing.scales: their sum is 0, the comb spectrum has no level")
        turns = np.outer(np.atleast_1d(frequency), self.times)
        return np.abs(np.exp(-2j * np.pi * turns) @ self.scales) / abs(total)

    def scattered(self, sigma: float, generator: np.random.Generator) -> "Firing":
        """Add normal scatter of standard deviation ``sigma`` s, drawn from ``generator``."""
        if sigma < 0.0:
            raise InputError(f"firing.scattered: sigma must not be negative, got {sigma:g} s")
        return Firing(self.times + generator.normal(0.0, sigma, len(self.times)), self.scales)


@dataclass(frozen=True, eq=False)
class Blast:
    """Blast: the holes with charges and firing times; a hole with two decks has two entries.

    Parameters
    ----------
    name : str
    collar, toe : (n_holes, 3) float64, m
        East, north, up. Equal where only the place of the charge is known.
    charge : (n_holes,) float64, kg
        NaN where the table does not give it.
    times : (n_holes,) float64, s
        Absolute firing times, not negative.
    diameter : (n_holes,) float64, m
        NaN where unknown.
    hole_ids : tuple of str
        Numbered from 1 where empty.
    deck : (n_holes, 2) float64, m
        Top and base of the charge along the hole from the collar; NaN where unknown.
    stated_length, stated_inclination : (n_holes,) float64, m and rad
        Values of the table in addition to collar and toe, for the checks; NaN if absent.
    notes : tuple of str
        Remarks of the reader of the table; repeated by ``checks``.
    explosive_density : float, kg/m3
        In the hole; default: ANFO.
    planned : (n_holes,) float64, s
        Planned firing times where ``times`` are those that detonators measured; NaN if these are
        the planned ones.
    burden, stemming : (n_holes,) float64, m
        NaN where the table does not give it.
    row : (n_holes,) float64
        Number of the row from the face on; NaN where unknown.
    face : float, rad
        Bearing, clockwise from north, of the free face as seen from the holes; NaN if unknown.
    choked : bool
        Whether muck lies before the face.

    Raises
    ------
    InputError
        If a shape or value is invalid; names the hole.

    Examples
    --------
    >>> collar, toe = [[0, 0, 0], [5, 0, 0]], [[0, 0, -10], [5, 0, -10]]
    >>> blast = Blast("B1", collar, toe, charge=[50, 60], times=[0.0, 0.004])
    >>> blast.charge_per_window()
    110.0
    """

    name: str
    collar: np.ndarray
    toe: np.ndarray
    charge: np.ndarray
    times: np.ndarray
    diameter: np.ndarray | float = math.nan
    hole_ids: tuple[str, ...] = ()
    deck: np.ndarray | float = math.nan
    stated_length: np.ndarray | float = math.nan
    stated_inclination: np.ndarray | float = math.nan
    notes: tuple[str, ...] = field(default=())
    explosive_density: float = ANFO_DENSITY
    planned: np.ndarray | float = math.nan
    burden: np.ndarray | float = math.nan
    stemming: np.ndarray | float = math.nan
    row: np.ndarray | float = math.nan
    face: float = math.nan
    choked: bool = False

    def __post_init__(self) -> None:
        """Check the fields once, spread single values over the holes, make arrays read-only."""
        collar = np.array(self.collar, dtype=np.float64)
        if collar.ndim != 2 or collar.shape[1] != 3 or len(collar) == 0:
            raise InputError(f"blast.collar: need shape (n_holes, 3), got {collar.shape}")
        ids = tuple(map(str, self.hole_ids)) or tuple(str(n + 1) for n in range(len(collar)))
        if len(ids) != len(collar):
            raise InputError(f"blast.hole_ids: {len(ids)} names for {len(collar)} holes")
        object.__setattr__(self, "hole_ids", ids)
        object.__setattr__(self, "notes", tuple(self.notes))
        if not 0.0 < self.explosive_density < math.inf:
            raise InputError(
                f"blast.explosive_density: must be positive, got {self.explosive_density:g} kg/m3"
            )
        n = len(collar)
        shapes = {
            "collar": (n, 3),
            "toe": (n, 3),
            "charge": (n,),
            "times": (n,),
            "diameter": (n,),
            "deck": (n, 2),
            "stated_length": (n,),
            "stated_inclination": (n,),
            "planned": (n,),
            "burden": (n,),
            "stemming": (n,),
            "row": (n,),
        }
        for name, shape in shapes.items():
            object.__setattr__(self, name, _per_hole(name, getattr(self, name), shape))
        for name in ("collar", "toe", "times"):
            self._require(name, np.isfinite(getattr(self, name)), "must be finite")
        for name in ("collar", "toe"):
            self._require(name, np.abs(getattr(self, name)) <= FARTHEST, "must be within 1e8 m")
        self._require("times", self.times >= 0.0, "must not be negative")
        self._require("times", self.times <= LATEST, "must be at most 1000 s, is the unit right?")
        self._require("charge", ~(self.charge < 0.0) & ~np.isinf(self.charge), "must be >= 0 kg")
        self._require("charge", ~(self.charge > HEAVIEST), "must be at most 1e6 kg")
        top, base = np.asarray(self.deck).T
        self._require(
            "deck", ~(top >= base) & ~(top < 0.0) & ~(base > DEEPEST), "top must lie above base"
        )
        narrow, wide = self.diameter < NARROWEST, self.diameter > WIDEST
        self._require("diameter", ~narrow & ~wide, "must be 0.01 to 10 m, is the unit right?")

    def _require(self, name, right, rule):
        """Raise InputError for the first hole where a rule is broken."""
        wrong = np.flatnonzero(~np.reshape(right, (len(self.collar), -1)).all(axis=1))
        if len(wrong):
            value = getattr(self, name)[wrong[0]]
            raise InputError(f"blast.{name}: {rule}, got {value} at hole {self.hole_ids[wrong[0]]}")

    @property
    def length(self) -> np.ndarray:
        """Distance from collar to toe, (n_holes,) m."""
        return np.linalg.norm(self.toe - self.collar, axis=1)

    @property
    def centres(self) -> np.ndarray:
        """Middle of each charge, (n_holes, 3) m."""
        middle = self._charged_share().mean(axis=1)
        return self.collar + middle[:, None] * (self.toe - self.collar)

    @property
    def columns(self) -> np.ndarray:
        """Upper and lower end of each charge, (n_holes, 2, 3) m.

        Those of its deck where given; else of the column that the charge fills above the toe; of
        the whole hole where the diameter is unknown.
        """
        axis = (self.toe - self.collar)[:, None, :]
        return self.collar[:, None, :] + self._charged_share()[:, :, None] * axis

    def _charged_share(self):
        """Return top and base of each charge as fractions of the hole, (n_holes, 2)."""
        length = np.maximum(self.length, 1e-12)
        filled = np.clip(np.nan_to_num(self.charge_length / length, nan=1.0), 0.0, 1.0)
        above_toe = np.column_stack([1.0 - filled, np.ones_like(filled)])
        deck = np.asarray(self.deck)
        no_deck = np.isnan(deck).any(axis=1, keepdims=True)
        return np.where(no_deck, above_toe, deck / length[:, None])

    @property
    def charge_length(self) -> np.ndarray:
        """Length that each charge fills at the density of its explosive, (n_holes,) m."""
        return self.charge / (self.explosive_density * math.pi / 4.0 * self.diameter**2)

    def firing(self, reference_charge: float | None = None, exponent: float = 1.0) -> Firing:
        """Return the firing of the blast: times and scales.

        Parameters
        ----------
        reference_charge : float, kg, optional
            Charge of the signature hole. Default: all scales 1. A misfire (charge 0) has scale 0.
        exponent : float
            ``a_i = (charge_i / reference_charge) ** exponent``.

        Returns
        -------
        Firing

        Raises
        ------
        InputError
            If a charge needed for scales is missing, or the reference is not positive.
        """
        if reference_charge is None:
            return Firing(self.times, np.where(self.charge == 0.0, 0.0, 1.0))
        if not reference_charge > 0.0:
            raise InputError(f"reference_charge: must be positive, got {reference_charge:g} kg")
        self._refuse_missing_charge()
        scales = (self.charge / reference_charge) ** exponent
        return Firing(self.times, np.where(self.charge == 0.0, 0.0, scales))

    def charge_per_window(self, window: float = CHARGE_WINDOW) -> float:
        """Return the largest charge [kg] that fires in any window [t, t + window) s."""
        return float(np.max(self.window_charges(window)[1]))

    def window_charges(self, window: float = CHARGE_WINDOW) -> tuple[np.ndarray, np.ndarray]:
        """Return the firing times in order and the charge in the half-open window from each."""
        if not window > 0.0:
            raise InputError(f"charge_per_window: window must be positive, got {window:g} s")
        self._refuse_missing_charge()
        order = np.argsort(self.times, kind="stable")
        times = self.times[order]
        fired = np.concatenate([[0.0], np.cumsum(self.charge[order])])
        first = np.searchsorted(times, times - _INSTANT)
        return times, fired[np.searchsorted(times, times + window - _INSTANT)] - fired[first]

    def strongest_window(self, position: ArrayLike) -> tuple[float, float] | None:
        """Return distance and charge of the 8 ms window that is nearest by scaled distance.

        Parameters
        ----------
        position : (3,) float, m

        Returns
        -------
        tuple of 2 float, or None
            Mean distance of the charges of the window weighted by charge, m, and their sum, kg.
            None where a charge is unknown or all are 0.
        """
        if np.isnan(self.charge).any() or not self.charge.any():
            return None
        order = np.argsort(self.times, kind="stable")
        charge, times = self.charge[order], self.times[order]
        away = np.linalg.norm(self.centres[order] - np.asarray(position, dtype=float), axis=1)
        first = np.searchsorted(times, times - _INSTANT)
        past = np.searchsorted(times, times + CHARGE_WINDOW - _INSTANT)
        sums = np.concatenate([[[0.0, 0.0]], np.cumsum(np.c_[charge, charge * away], axis=0)])
        total, moment = (sums[past] - sums[first]).T
        total, moment = total[total > 0.0], moment[total > 0.0]
        nearest = int(np.argmin(moment * total**-1.5))
        return float(moment[nearest] / total[nearest]), float(total[nearest])

    def _refuse_missing_charge(self):
        """Raise InputError that names the holes without a charge."""
        missing = np.isnan(self.charge)
        if np.any(missing):
            raise InputError(
                f"blast.charge: missing for {self.named(missing)}; give charge_kg in the table"
            )

    def named(self, chosen: np.ndarray) -> str:
        """Name up to five of the holes where ``chosen`` (n_holes,) is true."""
        ids = [self.hole_ids[n] for n in np.flatnonzero(chosen)]
        noun = "hole" if len(ids) == 1 else f"{len(ids)} holes:"
        return f"{noun} {', '.join(ids[:5])}{', ...' if len(ids) > 5 else ''}"

    def checks(self) -> list[str]:
        """Return plausibility checks of the table, as sentences.

        Returns
        -------
        list of str
            Notes of the reader, times, charge per 8 ms window, implausible entries.
        """
        return [*self.notes, *hole_sentences(self)]


def _per_hole(name, value, shape):
    """Spread a field over the holes, read-only."""
    try:
        array = np.array(np.broadcast_to(np.asarray(value, dtype=np.float64), shape))
    except (ValueError, TypeError):
        raise InputError(f"blast.{name}: need shape {shape}, got {np.shape(value)}") from None
    array.setflags(write=False)
    return array
