"""Sources of a project in its mesh: holes, forces, moments, pressures, air blasts."""

from dataclasses import replace

import numpy as np

from ..errors import InputError
from ..meshing.mesh import edge_lengths, locate
from ..solving.charges import Column, MomentTensor
from ..solving.pressures import AirBlast, Pressure
from ..solving.sources import Hole, PointForce, TimeFunction
from .config_section import named_error
from .places import on_ground, refuse_outside


def hole_places(blast):
    """Return the centres of the charges by the names of their holes."""
    names = (f"blast: hole {name}" for name in blast.hole_ids)
    return dict(zip(names, blast.centres, strict=True))


def place_sources(inside, config, blast, mesh, lead) -> tuple:
    """Put all sources into the mesh; their time 0 is ``lead`` s before the first firing.

    Raises
    ------
    InputError
        If one lies outside of the mesh, a hole has no charge or a surface is none; it is named.
    """
    sources = []
    if inside.moment_rate is not None:
        if not blast.charge.any():
            raise InputError("blast: no hole has a charge; give one a charge_kg above 0")
        refuse_outside(mesh, hole_places(blast))
        place = _place_columns if config.holes_inside.detonation_m_per_s else _place_holes
        sources += place(inside, config, blast, mesh, lead)
    sources += _place_forces(inside, config, mesh, lead)
    sources += _place_tensors(inside, config, mesh, lead)
    for number, (part, history) in enumerate(zip(config.pressures, inside.pressures, strict=True)):
        _check_surface(f"pressures[{number + 1}]", part.surface, mesh)
        run = (part.start_m, part.speed_m_per_s) if part.start_m is not None else ()
        sources.append(Pressure(part.surface, _later(history, lead), *run))
    if inside.air_pulse is not None:
        sources += _place_air(inside, config.air_blast, blast, mesh, lead)
    return tuple(sources)


def _later(history, lead):
    """Return a history whose time 0 is a lead in s after the start of the run."""
    return replace(history, start=history.start + lead)


def _place_holes(inside, config, blast, mesh, lead):
    """Return the holes of a blast as points, without those that misfire (charge 0)."""
    spread, exponent = config.holes_inside.spread_m, config.blast.charge_exponent
    if spread is None:
        zone, _ = locate(mesh, blast.centres)
        spread = float(edge_lengths(mesh)[zone].mean())
    charges = zip(hole_places(blast).items(), blast.charge, inside.firing.times + lead, strict=True)
    for (name, place), charge, time in charges:
        if charge == 0.0:
            continue
        with named_error(name):
            yield Hole(place, charge, time, inside.moment_rate, exponent, spread)


def _place_columns(inside, config, blast, mesh, lead):
    """Return the holes that have a charge as columns that detonate from one end."""
    part, exponent = config.holes_inside, config.blast.charge_exponent
    names, ends = list(hole_places(blast)), blast.columns
    for end in (0, 1):
        refuse_outside(mesh, dict(zip(names, ends[:, end], strict=True)))
    primed, other = (0, 1) if part.primed_at == "collar" else (1, 0)
    for name, way, charge, time in zip(
        names, ends, blast.charge, inside.firing.times + lead, strict=True
    ):
        if charge == 0.0:
            continue
        with named_error(name):
            yield Column(
                way[primed], way[other], charge, time, inside.moment_rate, exponent,
                part.detonation_m_per_s,
            )  # fmt: skip


def _place_forces(inside, config, mesh, lead):
    """Return the point forces."""
    for number, (part, history) in enumerate(zip(config.point_forces, inside.forces, strict=True)):
        with named_error(f"point_forces[{number + 1}]"):
            place = np.array(on_ground(mesh, part.position_m))
        refuse_outside(mesh, {f"point_forces[{number + 1}]": place})
        along = np.array(part.direction) / np.linalg.norm(part.direction)
        yield PointForce(place, along, _later(history, lead))


def _place_tensors(inside, config, mesh, lead):
    """Return the moment tensors."""
    parts = zip(config.moment_tensors, inside.tensors, strict=True)
    for number, (part, history) in enumerate(parts):
        refuse_outside(mesh, {f"moment_tensors[{number + 1}]": np.array(part.position_m)})
        xx, yy, zz, yz, zx, xy = part.tensor
        tensor = np.array([[xx, xy, zx], [xy, yy, yz], [zx, yz, zz]])
        yield MomentTensor(np.array(part.position_m), tensor, lead, history, part.spread_m)


def _place_air(inside, part, blast, mesh, lead):
    """Return the air blast of every hole, from its collar."""
    _check_surface("air_blast", part.surface, mesh)
    pulse, scales = inside.air_pulse, blast.firing().scales
    if part.reference_charge_kg is not None:
        with named_error("air_blast"):
            scales = blast.firing(part.reference_charge_kg, part.charge_exponent).scales
    for collar, time, scale in zip(blast.collar, inside.firing.times + lead, scales, strict=True):
        if scale == 0.0:
            continue
        history = TimeFunction(scale * pulse.values, pulse.dt, pulse.start)
        yield AirBlast(
            part.surface, collar, history, part.reference_m, part.speed_m_per_s, part.exponent, time
        )


def _check_surface(where, surface, mesh):
    """Refuse a surface that is none, or a joint."""
    joints = () if mesh.contacts is None else mesh.contacts.names
    outer = [name for name in mesh.surfaces if name not in joints]
    if surface not in outer:
        raise InputError(f"{where}.surface: must be one of {', '.join(outer)}, got {surface!r}")
