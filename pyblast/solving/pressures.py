"""Pressure on surfaces: in a hole or a cavity, and of the air over free ground."""

from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from .sources import TimeFunction


@dataclass(frozen=True, eq=False)
class Pressure:
    """A pressure on a surface of the mesh, such as the wall of a hole; theory.md (5.10).

    Parameters
    ----------
    surface : str
    history : TimeFunction
        Pa, positive into the ground.
    start : (3,) float, m, optional
        Where it begins, if it runs.
    speed : float, m/s
        At which it runs from there; infinite: everywhere at once.

    Raises
    ------
    InputError
        If the speed is not positive.
    """

    surface: str
    history: TimeFunction
    start: np.ndarray | None = None
    speed: float = np.inf

    def __post_init__(self):
        """Refuse a speed that is none."""
        if not self.speed > 0.0:
            raise InputError(f"pressure.speed: must be positive, got {self.speed:g} m/s")

    def at(self, places):
        """Return shares (n,) of the history and delays (n,) in s at places (n, 3)."""
        if self.start is None or np.isinf(self.speed):
            return np.ones(len(places)), np.zeros(len(places))
        return np.ones(len(places)), np.linalg.norm(places - self.start, axis=1) / self.speed


@dataclass(frozen=True, eq=False)
class AirBlast:
    """A pressure that runs through the air over a free surface; theory.md (5.11).

    Parameters
    ----------
    surface : str
    position : (3,) float, m
        Where it comes from, such as the collar of a hole.
    history : TimeFunction
        Overpressure in Pa at the reference distance, from its arrival there on.
    reference : float, m
        Nearer than this the pressure does not grow.
    speed : float, m/s
    exponent : float
        Decay with distance.
    time : float, s
        When it leaves the place.

    Raises
    ------
    InputError
        If distance or speed is not positive, or the exponent negative.
    """

    surface: str
    position: np.ndarray
    history: TimeFunction
    reference: float = 1.0
    speed: float = 340.0
    exponent: float = 1.0
    time: float = 0.0

    def __post_init__(self):
        """Refuse what is no blast of air."""
        for name, unit in (("reference", "m"), ("speed", "m/s")):
            value = getattr(self, name)
            if not 0.0 < value < np.inf:
                raise InputError(f"air_blast.{name}: must be positive, got {value:g} {unit}")
        for name in ("exponent", "time"):
            if not getattr(self, name) >= 0.0:
                value = getattr(self, name)
                raise InputError(f"air_blast.{name}: must not be negative, got {value:g}")

    def at(self, places):
        """Return shares (n,) of the history and delays (n,) in s at places (n, 3)."""
        distance = np.linalg.norm(places - np.asarray(self.position, dtype=float), axis=1)
        share = (np.maximum(distance, self.reference) / self.reference) ** -self.exponent
        return share, self.time + distance / self.speed
