"""Sources inside a model: charged holes as explosions, and point forces."""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import make_interp_spline

from ..errors import InputError


@dataclass(frozen=True, eq=False)
class TimeFunction:
    """Samples of a function of time, zero before the first.

    Parameters
    ----------
    values : (n_samples,) float64
    dt : float, s
    start : float, s
    held : bool
        Whether the last value stays after the end; else the function is zero there.

    Raises
    ------
    InputError
        If there are no samples, one is not finite, or the sampling is not positive.
    """

    values: np.ndarray
    dt: float
    start: float = 0.0
    held: bool = False

    def __post_init__(self):
        """Refuse samples that are no function of time."""
        values = np.asarray(self.values, dtype=float)
        if values.ndim != 1 or not len(values) or not np.isfinite(values).all():
            raise InputError("time function: values must be one row of finite numbers")
        if not (np.isfinite(self.dt) and self.dt > 0.0):
            raise InputError(f"time function: dt must be positive, got {self.dt:g} s")
        object.__setattr__(self, "values", values)

    def __call__(self, times):
        """Read the function at ``times`` (n,) by a cubic spline through its samples."""
        samples = self.start + self.dt * np.arange(len(self.values))
        spline = make_interp_spline(samples, self.values, k=min(3, len(samples) - 1))
        inside = (times >= samples[0]) & ((times <= samples[-1]) | self.held)
        return np.where(inside, spline(np.clip(times, samples[0], samples[-1])), 0.0)

    def integral(self):
        """Return the running integral from the start, by the trapezoidal rule; held at its end."""
        steps = 0.5 * self.dt * (self.values[1:] + self.values[:-1])
        return TimeFunction(np.append(0.0, np.cumsum(steps)), self.dt, self.start, held=True)


@dataclass(frozen=True, eq=False)
class Hole:
    """A charged hole as an isotropic point source, M(t) = M1(t) W^e; theory.md (5.2).

    Parameters
    ----------
    position : (3,) float, m
    charge : float, kg
    time : float, s
        Firing time.
    moment_rate : TimeFunction
        Of 1 kg, N m/s.
    exponent : float
        Of the charge.
    spread : float or None, m
        Radius over which the source is spread so that the mesh does not print through; None
        takes one mean edge of the zone around it, 0 puts it into that zone alone.
    """

    position: np.ndarray
    charge: float
    time: float
    moment_rate: TimeFunction
    exponent: float = 1.0
    spread: float | None = None

    def __post_init__(self):
        """Refuse charges and times that are none."""
        if not self.charge > 0.0:
            raise InputError(f"hole.charge: must be positive, got {self.charge:g} kg")
        if not self.time >= 0.0:
            raise InputError(f"hole.time: must not be negative, got {self.time:g} s")


@dataclass(frozen=True, eq=False)
class PointForce:
    """A force at a point, such as a hammer on the ground; theory.md (5.3).

    Parameters
    ----------
    position : (3,) float, m
    direction : (3,) float
        Its length scales the history.
    history : TimeFunction
        Force, N.
    """

    position: np.ndarray
    direction: np.ndarray
    history: TimeFunction
