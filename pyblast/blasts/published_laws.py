"""Published laws: scaled distance and its plausible range, explosives."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..units import plain_number
from .peaks import PeaksOfLaw
from .site_law import scaled_distance, scaled_distance_ppv

DEVIATIONS = 1.6448536269514722  # of a normal distribution from its median to 95 %
DECADE = (10.0**-0.5, 10.0**0.5)
IMPERIAL = 0.0254 * (0.3048 / 0.45359237**0.5) ** 1.6  # k of in/s and ft/lb^0.5, exponent 1.6
FARTHEST = 450.0  # m/kg^0.5, end of the chart of Oriard's law


@dataclass(frozen=True)
class PublishedLaw:
    """Published law ``PPV = k (R / W^charge_exponent)^-beta`` with its 5-95 % range.

    Parameters
    ----------
    name : str
    rock : str
        Ground and confinement that it is given for.
    source : str
    k : float
        Peak velocity in m/s of 1 kg at 1 m.
    beta, charge_exponent : float
    factors : tuple of 2 float
        Ends of the 5-95 % range over the law. A decade, as the two laws that state their range
        have it, where the source states none.
    states_factors : bool
        Whether the source states it.
    """

    name: str
    rock: str
    source: str
    k: float
    beta: float
    charge_exponent: float = 0.5
    factors: tuple[float, float] = DECADE
    states_factors: bool = False

    def ppv(self, distance: float, charge: float) -> float:
        """Return the peak velocity in m/s at a distance in m from a charge in kg.

        Examples
        --------
        >>> round(1e3 * LAWS[1].ppv(distance=120.0, charge=60.0), 1)
        14.2
        """
        return float(scaled_distance_ppv(distance, charge, self.k, self.beta, self.charge_exponent))

    def peak(self, distance: float, charge: float) -> PeaksOfLaw:
        """Return the distribution of the peak at a distance in m from a charge in kg."""
        below, above = (abs(math.log10(factor)) / DEVIATIONS for factor in self.factors)
        exponent = self.beta * self.charge_exponent
        return PeaksOfLaw(self.ppv(distance, charge), below, above, math.inf, charge, exponent)


LAWS = (
    PublishedLaw(
        "Oriard 1972", "holes in rock of many sites",
        "Oriard 1972; Caltrans, Transportation and Construction Vibration Guidance Manual (2013), "
        "eq. 13: 24 to 242 in/s hold most conventional blasts",
        IMPERIAL * (24.0 * 242.0) ** 0.5, 1.6,
        factors=((24.0 / 242.0) ** 0.5, (242.0 / 24.0) ** 0.5), states_factors=True,
    ),
    PublishedLaw(
        "AS 2187.2-2006", "average rock, free face",
        "AS 2187.2-2006, appendix J: 1140 mm/s, in practice 0.4 to 4 times of it",
        1.140, 1.6, factors=(0.4, 4.0), states_factors=True,
    ),
    PublishedLaw(
        "AS 2187.2-1993", "hard or highly structured rock, free face",
        "AS 2187.2-1993, appendix J: 500 mm/s", 0.500, 1.6,
    ),
    PublishedLaw(
        "Luedeling-Hinzen 1986 sedimentary", "sedimentary rock, quarries in Germany",
        "Lüdeling and Hinzen 1986, Nobel Hefte 52; DIN 4150-1:2001", 0.969, 1.5, 0.6 / 1.5,
    ),
    PublishedLaw(
        "Luedeling-Hinzen 1986 crystalline", "igneous and metamorphic rock, quarries in Germany",
        "Lüdeling and Hinzen 1986, Nobel Hefte 52; DIN 4150-1:2001", 0.206, 1.3, 0.8 / 1.3,
    ),
    PublishedLaw(
        "Holmberg-Persson 1979", "hard rock in Sweden, near the hole",
        "Holmberg and Persson 1979, Design of tunnel perimeter blasthole patterns to prevent rock "
        "damage, Tunnelling '79", 0.700, 1.5, 0.7 / 1.5,
    ),
)  # fmt: skip


BY_NAME = {law.name: law for law in LAWS}
HARD_ROCK = BY_NAME["AS 2187.2-1993"]


@dataclass(frozen=True)
class PlausibleRange:
    """Range of peak velocity that published laws find plausible for a charge and a distance.

    Parameters
    ----------
    low, high : float, m/s
        Smallest 5 % and largest 95 % value of the laws.
    distance : float, m
    charge : float, kg
        Within 8 ms.
    laws : tuple of str
        Their names.
    """

    low: float
    high: float
    distance: float
    charge: float
    laws: tuple[str, ...]

    def excess(self, ppv: float) -> float:
        """Return ppv over the nearer end of the range: below 1 too low, above 1 too high, else 1.

        Parameters
        ----------
        ppv : float, m/s
        """
        return ppv / min(max(ppv, self.low), self.high)

    def describe(self, ppv: float) -> str:
        """Return peak, range, charge and distance as part of a sentence, in mm/s; ppv in m/s."""
        excess = self.excess(ppv)
        words = "within"
        if excess < 1.0:
            words = f"{_times(1.0 / excess)} below" if excess > 0.0 else "no motion, below"
        elif excess > 1.0:
            words = f"{_times(excess)} above"
        return (
            f"{plain_number(1e3 * ppv)} mm/s, {words} the {self} mm/s of published laws for "
            f"{plain_number(self.charge)} kg in 8 ms at {plain_number(self.distance)} m"
        )

    def __str__(self) -> str:
        """Write the ends in mm/s."""
        return f"{plain_number(1e3 * self.low, 2)} to {plain_number(1e3 * self.high, 2)}"


def _times(factor: float) -> str:
    """Write a factor above 1."""
    return f"{plain_number(factor, 2)} times"


def plausible_ppv(
    distance: float, charge: float, laws: Sequence[PublishedLaw] = LAWS
) -> PlausibleRange | None:
    """Return the range of peak velocity that published laws find plausible.

    Parameters
    ----------
    distance : float, m
    charge : float, kg
        Largest within 8 ms.
    laws : sequence of PublishedLaw
        Where one is chosen, that one alone.

    Returns
    -------
    PlausibleRange or None
        From the smallest 5 % to the largest 95 % value of the laws. None beyond a scaled distance
        of 450 m/kg^0.5, the end of the chart of Oriard's law; nearer than its beginning at 0.5 the
        laws are carried on.

    Raises
    ------
    InputError
        If distance or charge is not positive.

    Notes
    -----
    Peak component of velocity, single blasts on the ground: theory.md (13.8).

    Examples
    --------
    >>> print(plausible_ppv(distance=120.0, charge=60.0), "mm/s")
    2 to 57 mm/s
    """
    scaled = float(scaled_distance(distance, charge))
    if scaled > FARTHEST:
        return None
    ends = np.array([law.peak(distance, charge).band(0.9) for law in laws])
    low, high = float(ends[:, 0].min()), float(ends[:, 1].max())
    names = tuple(law.name for law in laws)
    return PlausibleRange(low, high, float(distance), float(charge), names)


@dataclass(frozen=True)
class Explosive:
    """Explosive with its ideal detonation.

    Parameters
    ----------
    name, source : str
    density : float, kg/m3
    velocity : float, m/s
        Of detonation.
    heat : float, J/kg
        Of explosion.
    """

    name: str
    source: str
    density: float
    velocity: float
    heat: float


HANDBOOK = "Dobratz and Crawford 1985, LLNL Explosives Handbook, UCRL-52997; not checked against it"
IDEAL = f"{HANDBOOK}; heat of 94/6 ANFO, 3.7 to 3.9 MJ/kg in handbooks, not checked"
EXPLOSIVES = {
    explosive.name: explosive
    for explosive in (
        Explosive("ANFO", IDEAL, 931.0, 4160.0, 3.8e6),
        Explosive("TNT", HANDBOOK, 1630.0, 6930.0, 7.0e9 / 1630.0),
        Explosive("PETN", HANDBOOK, 1770.0, 8300.0, 10.1e9 / 1770.0),
    )
}
