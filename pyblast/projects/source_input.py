"""What shakes a project beside a motion on a face: histories of all sources, in SI."""

from dataclasses import dataclass

import numpy as np

from ..blasting.blast import Firing
from ..blasting.signatures import SmoothPulse, cavity_moment
from ..blasting.superposition import superpose
from ..errors import InputError
from ..motion.seismogram import Seismogram
from ..solving.sources import TimeFunction
from ..units import to_si
from .column_files import read_time_function
from .config_section import named_error

MOMENT_RATE_HEADS = ("time_s,moment_rate_per_kg_Nm_per_s",)
FORCE_HEADS = ("time_s,force_n", "time_s,force_kn")
TENSOR_HEADS = ("time_s,moment_rate_Nm_per_s",)
PRESSURE_HEADS = ("time_s,pressure_pa", "time_s,pressure_kpa", "time_s,pressure_mpa")
SAMPLES_PER_DURATION = 100
DURATIONS = 8
SAMPLES_PER_PEAK_TIME = 200
PEAK_TIMES = 10


def make_moment_rate(config, exponent, materials, folder) -> TimeFunction:
    """Turn a `HolesInsideConfig` into the moment rate of 1 kg, N m/s.

    Parameters
    ----------
    config : HolesInsideConfig
    exponent : float
        Of the charge; takes the moment of the charged hole back to 1 kg.
    materials : dict of str to Material
    folder : Path

    Notes
    -----
    ``M = pi a^3 p(t) cp^2/cs^2``, right for waves much longer than the cavity: theory.md (5.2).
    """
    if config.moment_rate_file is not None:
        return read_time_function(folder / config.moment_rate_file, MOMENT_RATE_HEADS)
    hole = config.charged_hole
    if hole.material not in materials:
        raise InputError(
            f"charged_hole.material: must be one of {', '.join(materials)}, got {hole.material!r}"
        )
    rock, peak = materials[hole.material], to_si("peak_time_ms", hole.peak_time_ms)[1]
    dt = peak / SAMPLES_PER_PEAK_TIME
    pulse = SmoothPulse(to_si("pressure_mpa", hole.pressure_mpa)[1], peak)
    pressure = pulse(dt * np.arange(PEAK_TIMES * SAMPLES_PER_PEAK_TIME + 1))
    moment = cavity_moment(hole.radius_m, pressure, rock.cp, rock.cs)
    return TimeFunction(np.gradient(moment, dt) / hole.charge_kg**exponent, dt)


def make_air_pulse(config, folder) -> TimeFunction:
    """Turn an `AirBlastConfig` into the overpressure in Pa at the reference distance.

    Notes
    -----
    ``p = P (1 - t/T) exp(-t/T)`` without a file, Friedlander (1946): theory.md (5.12).
    """
    if config.file is not None:
        return read_time_function(folder / config.file, PRESSURE_HEADS)
    duration = to_si("duration_ms", config.duration_ms)[1]
    share = np.arange(DURATIONS * SAMPLES_PER_DURATION + 1) / SAMPLES_PER_DURATION
    peak = to_si("pressure_kpa", config.pressure_kpa)[1]
    return TimeFunction(peak * (1.0 - share) * np.exp(-share), duration / SAMPLES_PER_DURATION)


@dataclass(frozen=True, eq=False)
class Inside:
    """What shakes a project beside a motion on a face; zero time is the first firing.

    Parameters
    ----------
    firing : Firing
        Scales of holes inside refer to 1 kg.
    moment_rate : TimeFunction or None
        Of 1 kg, N m/s; None without holes inside.
    forces : tuple of TimeFunction
        N, one for each point force.
    tensors : tuple of TimeFunction
        N m/s, one for each moment tensor.
    pressures : tuple of TimeFunction
        Pa, one for each pressure on a surface.
    air_pulse : TimeFunction or None
        Pa, at the reference distance after its arrival there.
    """

    firing: Firing
    moment_rate: TimeFunction | None
    forces: tuple[TimeFunction, ...]
    tensors: tuple[TimeFunction, ...]
    pressures: tuple[TimeFunction, ...]
    air_pulse: TimeFunction | None

    @property
    def named(self) -> dict[str, TimeFunction]:
        """Every history by a name."""
        several = {"force": self.forces, "tensor": self.tensors, "pressure": self.pressures}
        single = {"moment_rate": self.moment_rate, "air_blast": self.air_pulse}
        return {
            **{f"{name}_{n + 1}": one for name in several for n, one in enumerate(several[name])},
            **{name: one for name, one in single.items() if one is not None},
        }

    @property
    def start(self) -> float:
        """Time of whatever begins first [s], at most 0."""
        starts = [0.0, *(one.start for one in (*self.forces, *self.tensors, *self.pressures))]
        first = float(self.firing.times.min())
        for history in (self.moment_rate, self.air_pulse):
            if history is not None:
                starts += [first, first + history.start]
        return min(starts)

    @property
    def motions(self) -> tuple[Seismogram, ...]:
        """Shapes of the far motion, to see its frequencies: of all holes, of each other source."""
        fired = []
        if self.moment_rate is not None:
            fired.append(radiated(self.moment_rate))
        if self.air_pulse is not None:
            fired.append(shape(self.air_pulse, self.air_pulse.values))
        return (
            *(superpose(one, self.firing) for one in fired),
            *(radiated(one) for one in (*self.forces, *self.tensors)),
            *(shape(one, one.values) for one in self.pressures),
        )


def read_inside(config, firing, materials, folder) -> Inside:
    """Read the histories of all sources of the `Config` of a project."""
    rate = air = None
    if config.holes_inside is not None:
        exponent = config.blast.charge_exponent
        with named_error("holes_inside"):
            rate = make_moment_rate(config.holes_inside, exponent, materials, folder)
    if config.air_blast is not None:
        air = make_air_pulse(config.air_blast, folder)
    several = (
        tuple(read_time_function(folder / part.file, heads) for part in parts)
        for parts, heads in (
            (config.point_forces, FORCE_HEADS),
            (config.moment_tensors, TENSOR_HEADS),
            (config.pressures, PRESSURE_HEADS),
        )
    )
    return Inside(firing, rate, *several, air)


def radiated(function) -> Seismogram:
    """Return the shape of the far motion of a source: the slope of its moment rate or force."""
    return shape(function, np.gradient(function.values, function.dt))


def shape(function, values) -> Seismogram:
    """Return values (n,) at the times of a function as a motion of one column without a scale."""
    missing = np.full_like(values, np.nan)
    return Seismogram(np.column_stack([values, missing, missing]), function.dt, function.start)
