"""Sources: holes, charge columns, point forces, moment tensors, pressure on surfaces."""

import math
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import make_interp_spline

from ..errors import InputError
from ..units import check_angle
from .material import Material


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

    def __post_init__(self) -> None:
        """Refuse samples that are no function of time."""
        values = np.asarray(self.values, dtype=float)
        if values.ndim != 1 or not len(values) or not np.isfinite(values).all():
            raise InputError("time function: values must be one row of finite numbers")
        if not (np.isfinite(self.dt) and self.dt > 0.0):
            raise InputError(f"time function: dt must be positive, got {self.dt:g} s")
        object.__setattr__(self, "values", values)

    def __call__(self, times: np.ndarray) -> np.ndarray:
        """Read the function at ``times`` (n,) by a cubic spline through its samples."""
        samples = self.start + self.dt * np.arange(len(self.values))
        spline = make_interp_spline(samples, self.values, k=min(3, len(samples) - 1))
        inside = (times >= samples[0]) & ((times <= samples[-1]) | self.held)
        return np.where(inside, spline(np.clip(times, samples[0], samples[-1])), 0.0)

    def integral(self) -> "TimeFunction":
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

    def __post_init__(self) -> None:
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

    def __post_init__(self) -> None:
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

    def __post_init__(self) -> None:
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

    def tensor(self, material: Material) -> np.ndarray:
        """Return the moment tensor (3, 3) in a material, the mean of its diagonal being one."""
        axis = np.subtract(self.end, self.primed)
        axis = axis / np.linalg.norm(axis)
        across, along = material.first_lame + 2.0 * material.shear, material.first_lame
        mean = (2.0 * across + along) / 3.0
        return (across * np.eye(3) + (along - across) * np.outer(axis, axis)) / mean

    def points(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Return places (n, 3) of the points and their delays (n,) in s."""
        share = (np.arange(count) + 0.5) / count
        way = np.subtract(self.end, self.primed)
        delays = share * np.linalg.norm(way) / self.detonation_speed
        return np.asarray(self.primed) + share[:, None] * way, delays


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

    def __post_init__(self) -> None:
        """Refuse a speed that is none."""
        if not self.speed > 0.0:
            raise InputError(f"pressure.speed: must be positive, got {self.speed:g} m/s")

    def at(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
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

    def __post_init__(self) -> None:
        """Refuse what is no blast of air."""
        for name, unit in (("reference", "m"), ("speed", "m/s")):
            value = getattr(self, name)
            if not 0.0 < value < np.inf:
                raise InputError(f"air_blast.{name}: must be positive, got {value:g} {unit}")
        for name in ("exponent", "time"):
            if not getattr(self, name) >= 0.0:
                value = getattr(self, name)
                raise InputError(f"air_blast.{name}: must not be negative, got {value:g}")

    def at(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return shares (n,) of the history and delays (n,) in s at places (n, 3)."""
        distance = np.linalg.norm(places - np.asarray(self.position, dtype=float), axis=1)
        share = (np.maximum(distance, self.reference) / self.reference) ** -self.exponent
        return share, self.time + distance / self.speed


@dataclass(frozen=True, eq=False)
class PlaneWave:
    """A plane wave from outside, seen by viscous faces as the motion that is there undisturbed.

    Parameters
    ----------
    wave : str
        "P", "SV" or "SH". Across a level ground SV shakes in the vertical plane of its path, along
        its azimuth where it runs straight up; SH shakes to the right of that plane.
    history : TimeFunction
        Particle velocity along the polarisation, m/s, at the node of the mesh that it meets first.
    azimuth : float, rad
        Where it runs to, clockwise from north.
    inclination : float, rad
        Between its path and the vertical: 0 straight up.
    surfaces : sequence of str
        Viscous surfaces that see it; none named: all.
    free_surface : str or None
        A plane surface, level or not, that sends P and S waves back; the viscous surfaces see them
        too. None: it is not there; nor is it where the surface is viscous itself.

    Raises
    ------
    InputError
        If the wave is unknown, begins before the run, or an angle is none.

    Notes
    -----
    theory.md (4.8) to (4.11).
    """

    wave: str
    history: TimeFunction
    azimuth: float = 0.0
    inclination: float = 0.0
    surfaces: tuple[str, ...] = ()
    free_surface: str | None = "top"

    def __post_init__(self) -> None:
        """Refuse what is no wave."""
        object.__setattr__(self, "surfaces", tuple(self.surfaces))
        if self.wave not in ("P", "SV", "SH"):
            raise InputError(f"plane_wave.wave: must be P, SV or SH, got {self.wave!r}")
        if self.history.start < 0.0:
            raise InputError(
                f"plane_wave.history: must begin at 0 or later, when it meets the model, got "
                f"{self.history.start:g} s; shift it"
            )
        if not math.isfinite(self.azimuth):
            raise InputError(f"plane_wave.azimuth: must be finite, got {self.azimuth:g} rad")
        check_angle("plane_wave.azimuth", self.azimuth)
        if not 0.0 <= self.inclination <= math.pi:
            raise InputError(
                f"plane_wave.inclination: must lie in 0 to pi rad, got {self.inclination:g}"
            )

    @property
    def direction(self) -> np.ndarray:
        """Unit vector (3,) along the path."""
        return polarisation("P", self.azimuth, self.inclination)

    @property
    def polarisation(self) -> np.ndarray:
        """Unit vector (3,) along which positive velocity points."""
        return polarisation(self.wave, self.azimuth, self.inclination)


def polarisation(wave: str, azimuth: float, inclination: float) -> np.ndarray:
    """Return the unit vector (3,) of a wave's positive velocity; arguments as in `PlaneWave`."""
    across = math.sin(inclination)
    path = [across * math.sin(azimuth), across * math.cos(azimuth), math.cos(inclination)]
    right = [math.cos(azimuth), -math.sin(azimuth), 0.0]
    return np.array({"P": path, "SH": right, "SV": np.cross(path, right)}[wave])


Source = Hole | PointForce | MomentTensor | Column | Pressure | AirBlast | PlaneWave
