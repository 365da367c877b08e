"""What shakes a project from inside: holes as isotropic sources and point forces, in SI."""

from dataclasses import dataclass, replace

import numpy as np

from ..blasting.blast import Firing
from ..blasting.signatures import SmoothPulse, cavity_moment
from ..blasting.superposition import superpose
from ..errors import InputError
from ..meshing.mesh import edge_lengths, locate
from ..motion.seismogram import Seismogram
from ..solving.sources import Hole, PointForce, TimeFunction
from ..units import to_si
from .column_files import read_time_function
from .config_section import named_error
from .places import on_ground, refuse_outside

MOMENT_RATE_HEADS = ("time_s,moment_rate_per_kg_Nm_per_s",)
FORCE_HEADS = ("time_s,force_n", "time_s,force_kn")
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


@dataclass(frozen=True, eq=False)
class Inside:
    """What shakes a project from inside; zero time is the first firing.

    Parameters
    ----------
    firing : Firing
        Scales refer to 1 kg.
    moment_rate : TimeFunction or None
        Of 1 kg, N m/s; None without holes inside.
    forces : tuple of TimeFunction
        N, one for each point force.
    """

    firing: Firing
    moment_rate: TimeFunction | None
    forces: tuple[TimeFunction, ...]

    @property
    def start(self) -> float:
        """Time of whatever begins first [s], at most 0."""
        starts = [0.0, *(force.start for force in self.forces)]
        if self.moment_rate is not None:
            first = float(self.firing.times.min())
            starts += [first, first + self.moment_rate.start]
        return min(starts)

    @property
    def motions(self) -> tuple[Seismogram, ...]:
        """Shapes of the far motion, to see its frequencies: of all holes, of each force."""
        holes = () if self.moment_rate is None else (radiated(self.moment_rate),)
        return (
            *(superpose(hole, self.firing) for hole in holes),
            *(radiated(force) for force in self.forces),
        )


def read_inside(config, firing, materials, folder) -> Inside:
    """Read what the `Config` of a project puts inside the model."""
    rate = None
    if config.holes_inside is not None:
        exponent = config.blast.charge_exponent
        with named_error("holes_inside"):
            rate = make_moment_rate(config.holes_inside, exponent, materials, folder)
    forces = (read_time_function(folder / part.file, FORCE_HEADS) for part in config.point_forces)
    return Inside(firing, rate, tuple(forces))


def hole_places(blast):
    """Return the centres of the charges by the names of their holes."""
    names = (f"blast: hole {name}" for name in blast.hole_ids)
    return dict(zip(names, blast.centres, strict=True))


def place_sources(inside, config, blast, mesh, lead) -> tuple[Hole | PointForce, ...]:
    """Put holes and point forces into the mesh; their time 0 is ``lead`` s before the firing.

    Raises
    ------
    InputError
        If one lies outside of the mesh or a hole has no charge; it is named.
    """
    sources = []
    if inside.moment_rate is not None:
        refuse_outside(mesh, hole_places(blast))
        spread, exponent = config.holes_inside.spread_m, config.blast.charge_exponent
        if spread is None:
            zone, _ = locate(mesh, blast.centres)
            spread = float(edge_lengths(mesh)[zone].mean())
        times = inside.firing.times + lead
        charges = zip(hole_places(blast).items(), blast.charge, times, strict=True)
        for (name, place), charge, time in charges:
            with named_error(name):
                sources.append(Hole(place, charge, time, inside.moment_rate, exponent, spread))
    for number, (part, history) in enumerate(zip(config.point_forces, inside.forces, strict=True)):
        with named_error(f"point_forces[{number + 1}]"):
            place = np.array(on_ground(mesh, part.position_m))
        refuse_outside(mesh, {f"point_forces[{number + 1}]": place})
        along = np.array(part.direction) / np.linalg.norm(part.direction)
        sources.append(PointForce(place, along, replace(history, start=history.start + lead)))
    return tuple(sources)


def radiated(function) -> Seismogram:
    """Return the shape of the far motion of a source: the slope of its moment rate or force.

    Only its frequencies mean something; the one column that is there has no scale.
    """
    slope = np.gradient(function.values, function.dt)
    missing = np.full_like(slope, np.nan)
    return Seismogram(np.column_stack([slope, missing, missing]), function.dt, function.start)
