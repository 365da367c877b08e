"""Sources: holes, charge columns, point forces, moment tensors, pressure on surfaces."""

import math
from dataclasses import dataclass

import numpy as np
import scipy

from ..errors import InputError
from ..units import check_angle
from .material import Material

ISOTROPIC = 1e-9  # largest deviation from the mean of an isotropic tensor


@dataclass(frozen=True, eq=False)
class TimeFunction:
    """Function of time, given by samples; zero before the first.

    Parameters
    ----------
    values : (n_samples,) float64
    dt : float, s
    start : float, s
    held : bool
        Whether the last value holds after the end; otherwise zero.

    Raises
    ------
    InputError
        If there are no samples, one is not finite, or the sampling is not positive.

    Examples
    --------
    >>> import numpy as np
    >>> ramp = TimeFunction(np.array([0.0, 1.0, 2.0]), dt=0.1)
    >>> ramp(np.array([0.05, 0.15, 0.3])).round(6).tolist()
    [0.5, 1.5, 0.0]
    """

    values: np.ndarray
    dt: float
    start: float = 0.0
    held: bool = False

    def __post_init__(self) -> None:
        """Check samples and sampling."""
        values = np.asarray(self.values, dtype=float)
        if values.ndim != 1 or not len(values) or not np.isfinite(values).all():
            raise InputError("time function: values must be one row of finite numbers")
        if not (np.isfinite(self.dt) and self.dt > 0.0):
            raise InputError(f"time function: dt must be positive, got {self.dt:g} s")
        object.__setattr__(self, "values", values)

    @property
    def centre(self) -> float:
        """Time in s of the centroid of its absolute values; the start where all are zero."""
        size = np.abs(self.values)
        total = max(float(size.sum()), np.finfo(float).tiny)
        return self.start + self.dt * float(size @ np.arange(len(size))) / total

    def __call__(self, times: np.ndarray) -> np.ndarray:
        """Return the values at ``times`` (n,) by a cubic spline through the samples."""
        samples = self.start + self.dt * np.arange(len(self.values))
        spline = scipy.interpolate.make_interp_spline(
            samples, self.values, k=min(3, len(samples) - 1)
        )
        inside = (times >= samples[0]) & ((times <= samples[-1]) | self.held)
        return np.where(inside, spline(np.clip(times, samples[0], samples[-1])), 0.0)

    def integral(self) -> "TimeFunction":
        """Return the integral from the start by the trapezoidal rule; held at its end."""
        steps = 0.5 * self.dt * (self.values[1:] + self.values[:-1])
        return TimeFunction(np.append(0.0, np.cumsum(steps)), self.dt, self.start, held=True)


@dataclass(frozen=True, eq=False)
class Hole:
    """Charged hole: isotropic moment source M(t) = M1(t) W^e; theory.md (5.2).

    Parameters
    ----------
    position : (3,) float, m
    charge : float, kg
    time : float, s
        Firing time.
    moment_rate : TimeFunction
        For 1 kg, N m/s.
    exponent : float
        Exponent of the charge.
    spread : float or None, m
        Radius of the sphere over which the moment is distributed; None: as the mesh needs, see
        `solver.moment_density`. In both cases at most the distance to the end of the ground.

    Raises
    ------
    InputError
        If the charge is not positive or the time negative.
    """

    position: np.ndarray
    charge: float
    time: float
    moment_rate: TimeFunction
    exponent: float = 1.0
    spread: float | None = None

    def __post_init__(self) -> None:
        """Check charge and time."""
        if not self.charge > 0.0:
            raise InputError(f"hole.charge: must be positive, got {self.charge:g} kg")
        if not self.time >= 0.0:
            raise InputError(f"hole.time: must not be negative, got {self.time:g} s")
        _check_radius("hole", self.spread)


@dataclass(frozen=True, eq=False)
class PointForce:
    """Point force, such as a hammer blow; theory.md (5.3).

    Parameters
    ----------
    position : (3,) float, m
    direction : (3,) float
        Its length multiplies the history.
    history : TimeFunction
        Force, N.
    """

    position: np.ndarray
    direction: np.ndarray
    history: TimeFunction


@dataclass(frozen=True, eq=False)
class MomentTensor:
    """Moment tensor source; theory.md (5.8).

    Parameters
    ----------
    position : (3,) float, m
    tensor : (3, 3) float
        Symmetric, east north up; multiplies the history.
    time : float, s
    moment_rate : TimeFunction
        N m/s.
    spread : float or None, m
        As in `Hole`.

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
        """Check shape and symmetry."""
        tensor = np.asarray(self.tensor, dtype=float)
        if tensor.shape != (3, 3) or not np.isfinite(tensor).all():
            raise InputError("moment tensor: must be three rows of three finite numbers")
        if not np.allclose(tensor, tensor.T, atol=1e-9 * max(np.abs(tensor).max(), 1e-300)):
            raise InputError("moment tensor: must be symmetric, or it would exert a torque")
        object.__setattr__(self, "tensor", tensor)
        _check_radius("moment tensor", self.spread)


def isotropic_moment(source: Hole | MomentTensor) -> float:
    """Return the factor on the moment rate of an isotropic source, 0 for any other tensor."""
    if isinstance(source, Hole):
        return source.charge**source.exponent
    mean = float(np.trace(source.tensor)) / 3.0
    rest = np.abs(source.tensor - mean * np.eye(3)).max()
    return mean if rest <= ISOTROPIC * abs(mean) else 0.0


def _check_radius(name, spread):
    """Refuse a radius that is no length."""
    if spread is not None and not 0.0 < spread < math.inf:
        raise InputError(
            f"{name}.spread: must be positive, got {spread:g} m; leave it out for the radius that "
            "the mesh needs"
        )


@dataclass(frozen=True, eq=False)
class Column:
    """Charge column that detonates from one end to the other; theory.md (5.9).

    Parameters
    ----------
    primed, end : (3,) float, m
        Initiation point, and the other end.
    charge : float, kg
    time : float, s
        Firing time.
    moment_rate : TimeFunction
        For 1 kg, N m/s: one third of the trace, as for `Hole`.
    exponent : float
        Exponent of the charge.
    detonation_speed : float, m/s
    sources : int or None
        Number of points; None: four to a radius of the sphere that each is distributed over, at
        least four.

    Raises
    ------
    InputError
        If charge, speed or length is not positive.

    Notes
    -----
    Pressure in a long hole: transverse to axial moment is (lambda + 2 mu) : lambda, Heelan (1953).
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
        """Check charge, speed, length and time."""
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
        """Return the moment tensor (3, 3) in a material, normalised to a mean diagonal of one."""
        axis = np.subtract(self.end, self.primed)
        axis = axis / np.linalg.norm(axis)
        across, along = material.first_lame + 2.0 * material.shear, material.first_lame
        mean = (2.0 * across + along) / 3.0
        return (across * np.eye(3) + (along - across) * np.outer(axis, axis)) / mean

    def points(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Return positions (n, 3) of the point sources and their delays (n,) in s."""
        share = (np.arange(count) + 0.5) / count
        axis = np.subtract(self.end, self.primed)
        delays = share * np.linalg.norm(axis) / self.detonation_speed
        return np.asarray(self.primed) + share[:, None] * axis, delays


@dataclass(frozen=True, eq=False)
class Pressure:
    """Pressure on a surface of the mesh, such as the wall of a hole; theory.md (5.10).

    Parameters
    ----------
    surface : str
    history : TimeFunction
        Pa, positive into the ground.
    start : (3,) float, m, optional
        Origin of a travelling pressure.
    speed : float, m/s
        Travel speed; infinite: everywhere at once.

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
        """Check the speed."""
        if not self.speed > 0.0:
            raise InputError(f"pressure.speed: must be positive, got {self.speed:g} m/s")

    def at(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return factors (n,) on the history and delays (n,) in s at places (n, 3)."""
        if self.start is None or np.isinf(self.speed):
            return np.ones(len(places)), np.zeros(len(places))
        return np.ones(len(places)), np.linalg.norm(places - self.start, axis=1) / self.speed


@dataclass(frozen=True, eq=False)
class AirBlast:
    """Air blast: pressure travelling over a free surface; theory.md (5.11).

    Parameters
    ----------
    surface : str
    position : (3,) float, m
        Origin, such as the collar of a hole.
    history : TimeFunction
        Overpressure in Pa at the reference distance, from its arrival.
    reference : float, m
        The pressure is constant within this distance.
    speed : float, m/s
    exponent : float
        Decay with distance.
    time : float, s
        Time of emission.

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
        """Check distance, speed, exponent and time."""
        for name, unit in (("reference", "m"), ("speed", "m/s")):
            value = getattr(self, name)
            if not 0.0 < value < np.inf:
                raise InputError(f"air_blast.{name}: must be positive, got {value:g} {unit}")
        for name in ("exponent", "time"):
            if not getattr(self, name) >= 0.0:
                value = getattr(self, name)
                raise InputError(f"air_blast.{name}: must not be negative, got {value:g}")

    def at(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return factors (n,) on the history and delays (n,) in s at places (n, 3)."""
        distance = np.linalg.norm(places - np.asarray(self.position, dtype=float), axis=1)
        share = (np.maximum(distance, self.reference) / self.reference) ** -self.exponent
        return share, self.time + distance / self.speed


@dataclass(frozen=True, eq=False)
class PlaneWave:
    """Plane wave from outside, which enters through viscous boundaries.

    Parameters
    ----------
    wave : str
        "P", "SV" or "SH". SV is polarised in the vertical plane of propagation, along the azimuth
        for vertical incidence; SH to the right of that plane.
    history : TimeFunction
        Particle velocity along the polarisation, m/s, at the first node that the wave reaches.
    azimuth : float, rad
        Direction of propagation, clockwise from north.
    inclination : float, rad
        Angle of propagation from the vertical; 0 is straight up.
    surfaces : sequence of str
        Viscous boundaries through which it enters; empty: all.
    free_surface : str or None
        Plane surface, horizontal or not, at which P and S are reflected; the reflections act on
        the viscous boundaries too. None, or a viscous surface: no reflections.

    Raises
    ------
    InputError
        If the wave is unknown, begins before the run, or an angle is out of range or in degrees.

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
        """Check type, history and angles."""
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
        """Unit vector (3,) of propagation."""
        return polarisation("P", self.azimuth, self.inclination)

    @property
    def polarisation(self) -> np.ndarray:
        """Unit vector (3,) of positive velocity."""
        return polarisation(self.wave, self.azimuth, self.inclination)


def polarisation(wave: str, azimuth: float, inclination: float) -> np.ndarray:
    """Return the unit vector (3,) of a wave's positive velocity; arguments as in `PlaneWave`."""
    across = math.sin(inclination)
    path = [across * math.sin(azimuth), across * math.cos(azimuth), math.cos(inclination)]
    right = [math.cos(azimuth), -math.sin(azimuth), 0.0]
    return np.array({"P": path, "SH": right, "SV": np.cross(path, right)}[wave])


Source = Hole | PointForce | MomentTensor | Column | Pressure | AirBlast | PlaneWave
