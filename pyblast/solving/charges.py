"""Sources with a moment: a tensor at a point, and the column of a charge that detonates along."""

from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from .sources import TimeFunction


@dataclass(frozen=True, eq=False)
class MomentTensor:
    """A moment tensor at a point; theory.md (5.8).

    Parameters
    ----------
    position : (3,) float, m
    tensor : (3, 3) float
        Symmetric, east north up; its size scales the history.
    time : float, s
    moment_rate : TimeFunction
        N m/s.
    spread : float or None, m
        As of `Hole`.

    Raises
    ------
    InputError
        If the tensor is not symmetric or not finite.
    """

    position: np.ndarray
    tensor: np.ndarray
    time: float
    moment_rate: TimeFunction
    spread: float | None = None

    def __post_init__(self):
        """Refuse what is no tensor."""
        tensor = np.asarray(self.tensor, dtype=float)
        if tensor.shape != (3, 3) or not np.isfinite(tensor).all():
            raise InputError("moment tensor: must be three rows of three finite numbers")
        if not np.allclose(tensor, tensor.T, atol=1e-9 * max(np.abs(tensor).max(), 1e-300)):
            raise InputError("moment tensor: must be symmetric, or it would turn rock")
        object.__setattr__(self, "tensor", tensor)


@dataclass(frozen=True, eq=False)
class Column:
    """A long charge that detonates from one end to the other; theory.md (5.9).

    Parameters
    ----------
    primed, end : (3,) float, m
        Where it is initiated, and its other end.
    charge : float, kg
    time : float, s
        Firing time.
    moment_rate : TimeFunction
        Of 1 kg, N m/s; a third of the trace, so that a column is as strong as a `Hole`.
    exponent : float
        Of the charge.
    detonation_speed : float, m/s
    sources : int or None
        Points that stand for the column; None: one for each mean edge of the zones it crosses.

    Raises
    ------
    InputError
        If charge, speed or length is not positive.

    Notes
    -----
    Pressure in a long hole: moment across over moment along as (lambda + 2 mu) : lambda, Heelan
    (1953).
    """

    primed: np.ndarray
    end: np.ndarray
    charge: float
    time: float
    moment_rate: TimeFunction
    exponent: float = 1.0
    detonation_speed: float = 4500.0
    sources: int | None = None

    def __post_init__(self):
        """Refuse what is no column."""
        length = float(np.linalg.norm(np.subtract(self.end, self.primed)))
        for name, value, unit in (
            ("charge", self.charge, "kg"),
            ("detonation_speed", self.detonation_speed, "m/s"),
            ("length", length, "m"),
            ("sources", 1 if self.sources is None else self.sources, "points"),
        ):
            if not value > 0.0:
                raise InputError(f"column.{name}: must be positive, got {value:g} {unit}")
        if not self.time >= 0.0:
            raise InputError(f"column.time: must not be negative, got {self.time:g} s")

    def tensor(self, material):
        """Return the moment tensor (3, 3) in a material, the mean of its diagonal being one."""
        axis = np.subtract(self.end, self.primed)
        axis = axis / np.linalg.norm(axis)
        across, along = material.first_lame + 2.0 * material.shear, material.first_lame
        mean = (2.0 * across + along) / 3.0
        return (across * np.eye(3) + (along - across) * np.outer(axis, axis)) / mean

    def points(self, count):
        """Return places (n, 3) of the points and their delays (n,) in s."""
        share = (np.arange(count) + 0.5) / count
        way = np.subtract(self.end, self.primed)
        delays = share * np.linalg.norm(way) / self.detonation_speed
        return np.asarray(self.primed) + share[:, None] * way, delays
