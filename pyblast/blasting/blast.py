"""The blast: where the holes are, what they hold, when they fire, and what is doubtful about it."""

import math
from dataclasses import dataclass, field

import numpy as np

from ..errors import InputError
from .blast_checks import ANFO_DENSITY, hole_sentences

CHARGE_WINDOW = 0.008
_INSTANT = 1e-9
FARTHEST, DEEPEST = 1e8, 1e4
NARROWEST, WIDEST = 0.01, 10.0
HEAVIEST, LATEST = 1e6, 1e3


@dataclass(frozen=True, eq=False)
class Firing:
    """Hold when the holes fire and how strong each is beside the signature hole.

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
    """

    times: np.ndarray
    scales: np.ndarray

    def __post_init__(self):
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
    def rows(cls, n_rows, holes_per_row, delay):
        """Fire row after row, ``delay`` s apart; the holes of a row together, all scales 1."""
        if n_rows < 1 or holes_per_row < 1:
            raise InputError(f"firing.rows: need at least 1 x 1, got {n_rows} x {holes_per_row}")
        return cls(np.repeat(delay * np.arange(n_rows), holes_per_row), 1.0)

    def comb_spectrum(self, frequency):
        """Return ``|sum a_i exp(-2 pi i f t_i)| / sum a_i`` at each frequency [Hz]; 1 at 0 Hz."""
        total = np.sum(self.scales)
        if total == 0.0:
            raise InputError("firing.scales: their sum is 0, the comb spectrum has no level")
        turns = np.outer(np.atleast_1d(frequency), self.times)
        return np.abs(np.exp(-2j * np.pi * turns) @ self.scales) / abs(total)

    def scattered(self, sigma, generator):
        """Add normal scatter of standard deviation ``sigma`` s, drawn from ``generator``."""
        if sigma < 0.0:
            raise InputError(f"firing.scattered: sigma must not be negative, got {sigma:g} s")
        return Firing(self.times + generator.normal(0.0, sigma, len(self.times)), self.scales)


@dataclass(frozen=True, eq=False)
class Blast:
    """Hold the holes of a blast; one entry per charge, so a hole with two decks has two.

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
        What the table says beside collar and toe, for the checks; NaN where it says nothing.
    notes : tuple of str
        What the reader of the table noticed; repeated by ``checks``.
    explosive_density : float, kg/m3
        In the hole; that of ANFO is assumed unless given.

    Raises
    ------
    InputError
        If a shape or value breaks these rules; names the hole.
    """

    name: str
    collar: np.ndarray
    toe: np.ndarray
    charge: np.ndarray
    times: np.ndarray
    diameter: np.ndarray = math.nan
    hole_ids: tuple[str, ...] = ()
    deck: np.ndarray = math.nan
    stated_length: np.ndarray = math.nan
    stated_inclination: np.ndarray = math.nan
    notes: tuple[str, ...] = field(default=())
    explosive_density: float = ANFO_DENSITY

    def __post_init__(self):
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
        top, base = self.deck.T
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
    def length(self):
        """Distance from collar to toe, (n_holes,) m."""
        return np.linalg.norm(self.toe - self.collar, axis=1)

    @property
    def centres(self):
        """Middle of each charge, (n_holes, 3) m."""
        middle = self._charged_share().mean(axis=1)
        return self.collar + middle[:, None] * (self.toe - self.collar)

    @property
    def columns(self):
        """Upper and lower end of each charge, (n_holes, 2, 3) m.

        Those of its deck where given; else of the column that the charge fills above the toe; of
        the whole hole where the diameter is unknown.
        """
        way = (self.toe - self.collar)[:, None, :]
        return self.collar[:, None, :] + self._charged_share()[:, :, None] * way

    def _charged_share(self):
        """Return where each charge begins and ends, (n_holes, 2), shares of the hole."""
        length = np.maximum(self.length, 1e-12)
        filled = np.clip(np.nan_to_num(self.charge_length / length, nan=1.0), 0.0, 1.0)
        above_toe = np.column_stack([1.0 - filled, np.ones_like(filled)])
        no_deck = np.isnan(self.deck).any(axis=1, keepdims=True)
        return np.where(no_deck, above_toe, self.deck / length[:, None])

    @property
    def charge_length(self):
        """Length that each charge fills at the density of its explosive, (n_holes,) m."""
        return self.charge / (self.explosive_density * math.pi / 4.0 * self.diameter**2)

    def firing(self, reference_charge=None, exponent=1.0):
        """Turn the blast into times and scales.

        Parameters
        ----------
        reference_charge : float, kg, optional
            Charge of the signature hole. Without it all scales are 1, as the paper has it. A hole
            of charge 0, a misfire, has the scale 0.
        exponent : float
            ``a_i = (charge_i / reference_charge) ** exponent``.

        Returns
        -------
        Firing

        Raises
        ------
        InputError
            If scales are wanted and a charge is missing, or the reference is not positive.
        """
        if reference_charge is None:
            return Firing(self.times, np.where(self.charge == 0.0, 0.0, 1.0))
        if not reference_charge > 0.0:
            raise InputError(f"reference_charge: must be positive, got {reference_charge:g} kg")
        self._refuse_missing_charge()
        scales = (self.charge / reference_charge) ** exponent
        return Firing(self.times, np.where(self.charge == 0.0, 0.0, scales))

    def charge_per_window(self, window=CHARGE_WINDOW):
        """Return the largest charge [kg] that fires in any window [t, t + window) s."""
        return float(np.max(self.window_charges(window)[1]))

    def window_charges(self, window=CHARGE_WINDOW):
        """Return the firing times in order and the charge in the half-open window from each."""
        if not window > 0.0:
            raise InputError(f"charge_per_window: window must be positive, got {window:g} s")
        self._refuse_missing_charge()
        order = np.argsort(self.times, kind="stable")
        times = self.times[order]
        fired = np.concatenate([[0.0], np.cumsum(self.charge[order])])
        first = np.searchsorted(times, times - _INSTANT)
        return times, fired[np.searchsorted(times, times + window - _INSTANT)] - fired[first]

    def _refuse_missing_charge(self):
        """Raise InputError that names the holes without a charge."""
        missing = np.isnan(self.charge)
        if np.any(missing):
            raise InputError(
                f"blast.charge: missing for {self.named(missing)}; give charge_kg in the table"
            )

    def named(self, chosen):
        """Name up to five of the holes where ``chosen`` (n_holes,) is true."""
        ids = [self.hole_ids[n] for n in np.flatnonzero(chosen)]
        noun = "hole" if len(ids) == 1 else f"{len(ids)} holes:"
        return f"{noun} {', '.join(ids[:5])}{', ...' if len(ids) > 5 else ''}"

    def checks(self):
        """Say in plain sentences what a blaster wants to know before trusting the table.

        Returns
        -------
        list of str
            The reader's notes, the times, the charge per 8 ms window, then what is doubtful.
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
