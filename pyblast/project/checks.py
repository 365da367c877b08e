"""Checks before a run: the census of a project and every defect that its numbers show."""

from dataclasses import dataclass

import numpy as np

from ..errors import Finding
from ..mesh import quality
from ..mesh.faces import face_vectors
from ..mesh.mesh import edge_lengths, surface_areas, surface_zones
from ..model.boundary import Roller, Viscous
from ..solver.initial_stress import joint_pressures
from ..solver.loads import surface_impedance
from . import checks_ground, checks_loads
from .census import (
    Census,
    central_frequency,
    highest_frequency,
    input_band,
    receiver_groups,
    take_census,
)
from .ground import joint_of_surface, set_normal, set_stiffness
from .inputs import shape


@dataclass(frozen=True)
class Check:
    """What a project is about to do and what is doubtful about it.

    Parameters
    ----------
    census : Census
    findings : tuple of Finding
    notes : tuple of str
        What the hole table says about itself.
    """

    census: Census
    findings: tuple[Finding, ...]
    notes: tuple[str, ...]

    @property
    def failed(self) -> bool:
        """Whether a finding makes the result untrustworthy."""
        return any(finding.failed for finding in self.findings)


def check(project, measure=True) -> Check:
    """Take the census of a project and look for defects before a run.

    Parameters
    ----------
    project : Project
    measure : bool
        Whether to march a few steps for an estimate of the time.

    Returns
    -------
    Check
    """
    notes = () if project.blast is None else tuple(project.blast.checks())
    if project.recorded:
        notes += (f"Records to compare with: {', '.join(project.recorded)}.",)
    census = take_census(project, measure)
    found = [
        *_mesh_defects(project, census),
        *_load_defects(project),
        *_joint_defects(project, census),
        *_record_defects(project, census),
        *_quiet_defects(project),
    ]
    findings = sorted(
        (finding for finding in found if finding is not None), key=lambda f: int(f.code[1:])
    )
    return Check(census, tuple(findings), notes)


def _mesh_defects(project, census):
    """D1, D2, D5, D12, D26, D30: zones, size, boundaries, layers, units, memory."""
    yield checks_ground.beyond_memory(census.memory, quality.available())
    yield checks_ground.unlikely_values(project.materials, project.joints)
    band, centre = input_band(project), central_frequency(project)
    stands = receiver_groups(project)
    for group in census.groups:
        yield checks_ground.coarse_zones(
            group.name, project.materials[group.name], group.mean_edge, group.volume, band,
            [name for name, under in stands.items() if under == group.name],
            project.model.edges_per_wavelength,
        )  # fmt: skip
    points = project.mesh.points
    rocks = _stiff(project, census)
    yield checks_ground.short_model(float(np.ptp(points[:, 0])), rocks, centre)
    boundaries = project.model.boundaries
    viscous = {b.surface for b in boundaries if isinstance(b, Viscous)}
    both = [b.surface for b in boundaries if isinstance(b, Roller) and b.surface in viscous]
    yield checks_ground.fixed_and_viscous(both)
    layers = project.config.mesh.layers
    if len(layers) > 1 and layers[0].thickness_m is not None:
        top, below = (project.materials[layer.material] for layer in layers[:2])
        yield checks_ground.soil_resonance(
            layers[0].material, top, layers[0].thickness_m, below, centre, band
        )


def _stiff(project, census):
    """Return the materials that waves cross fast: at least half the fastest P wave speed."""
    present = {group.name: project.materials[group.name] for group in census.groups}
    fastest = max(material.cp for material in present.values())
    return {name: m for name, m in present.items() if m.cp >= 0.5 * fastest}


def face_materials(project):
    """Return the materials on the input face, dict of str to Material."""
    mesh = project.model.mesh
    numbers = np.unique(mesh.zone_group[surface_zones(mesh, project.config.input.face)])
    return {mesh.groups[n]: project.materials[mesh.groups[n]] for n in numbers}


def _face_areas(project):
    """Return area in m2 and material of each part of the input face."""
    mesh, face = project.model.mesh, project.config.input.face
    group = mesh.zone_group[surface_zones(mesh, face)]
    area = np.linalg.norm(face_vectors(mesh.points, mesh.surfaces[face]), axis=1)
    return [
        (float(area[group == n].sum()), project.materials[mesh.groups[n]]) for n in np.unique(group)
    ]


def source_material(project):
    """Return name and material that the signature comes through."""
    cavity = project.config.signature.cavity
    if cavity is not None:
        return cavity.material, project.materials[cavity.material]
    present = face_materials(project)
    return max(present.items(), key=lambda item: item[1].density * item[1].cp)


def _load_defects(project):
    """D3, D4, D6, D7, D17, D20 to D22, D25: firing, filter, face, strength, charge, rim, air."""
    blast, band = project.config.blast, input_band(project)
    if blast is not None:
        yield checks_loads.firing_comb(project.firing, central_frequency(project), band)
    if blast is not None and blast.charge_kg is not None:
        yield checks_loads.charge_fits(
            blast.charge_kg, 1e-3 * blast.diameter_mm, blast.depth_m, blast.explosive_kg_per_m3
        )
    if project.input is not None:
        yield from _face_defects(project, band)
    if project.inside.moment_rate is not None:
        yield checks_loads.nothing_damps(project.rim)
    air, pulse = project.config.air_blast, project.inside.air_pulse
    if air is not None:
        mesh = project.mesh
        edge = edge_lengths(mesh)[surface_zones(mesh, air.surface)].mean()
        top = highest_frequency(shape(pulse, pulse.values))
        yield checks_loads.short_air_waves(
            air.surface, float(edge), air.speed_m_per_s, top, project.model.edges_per_wavelength
        )


def _face_defects(project, band):
    """D4, D6, D7, D17, D21, D27: filter, face, strength, energy, holes inside."""
    config, firing, motion = project.config, project.firing, project.input
    yield checks_loads.comb_return(firing, central_frequency(project), motion.low_passed)
    name, material = source_material(project)
    yield checks_loads.layered_face(config.input.face, face_materials(project))
    yield checks_loads.yielding_rock(project.signature.pvs, firing, name, material)
    distance, reach = face_distance(project)
    if distance is not None:
        yield checks_loads.plane_load(distance, reach, material, band)
    if project.blast is not None:
        points = project.mesh.points
        ends = points.min(axis=0), points.max(axis=0)
        yield checks_loads.holes_within(project.blast.centres, config.input.face, *ends)
    if project.blast is not None and np.isfinite(project.blast.charge).all():
        charge = float(project.blast.charge.sum())
        yield checks_loads.load_energy(
            motion.motion, _face_areas(project), charge, _across(project)
        )


def _across(project):
    """Return the axis along the normal of the input face."""
    mesh = project.mesh
    corners = mesh.points[np.unique(mesh.surfaces[project.config.input.face])]
    return int(np.argmin(np.ptp(corners, axis=0)))


def face_distance(project):
    """Return how far the source is from the input face, and from its foot to the far edge, m.

    The distance is the one of the file, else that from the middle of the first row; None where
    neither is known.
    """
    mesh = project.mesh
    corners = mesh.points[np.unique(mesh.surfaces[project.config.input.face])]
    across = _across(project)
    along = int(np.argmax(np.ptp(corners, axis=0) * [1.0, 1.0, 0.0]))
    distance, middle = project.config.input.distance_m, float(corners[:, along].mean())
    if project.blast is not None:
        first = project.blast.centres[project.blast.times == project.blast.times.min()].mean(axis=0)
        middle = float(first[along])
        if distance is None:
            distance = float(abs(first[across] - corners[:, across].mean()))
    if not distance:
        return None, 0.0
    reach = max(abs(corners[:, along].max() - middle), abs(middle - corners[:, along].min()))
    return distance, float(reach)


def _quiet_defects(project):
    """D23, D24: sides that drain a plane wave, quiet faces of jointed rock."""
    if project.input is None:
        return
    model, face = project.model, project.config.input.face
    direction = -_mean_normal(model.mesh, face)
    blind = {*project.config.boundaries.viscous} - {face}
    if project.config.input.enters_as == "plane_wave":
        blind = set()
    sides = [n for n in sorted(blind) if abs(_mean_normal(model.mesh, n) @ direction) < 0.7]
    entry = sum(surface_impedance(model, face).values())
    drag = sum((sum(surface_impedance(model, n).values()) for n in sides), np.zeros((3, 3)))
    way = model.mesh.points @ direction
    for receiver in project.receivers:
        share = (direction @ receiver.position - way.min()) / np.ptp(way)
        left = checks_ground.drained(entry, drag, share)
        yield checks_ground.draining_sides(sides, left, receiver.name, direction[2] > 0.7)
    if project.config.boundaries.jointed_faces:
        return
    stiffness = set_stiffness(project.config.mesh, project.joints, joint_pressures(model))
    for group, material in face_materials(project).items():
        sets = [
            (set_normal(part), *stiffness[part.name], part.spacing_m)
            for part in project.config.mesh.joint_sets if group in (part.regions or [group])
        ]  # fmt: skip
        if sets:
            yield checks_ground.jointed_face(group, material, sets, direction)


def _mean_normal(mesh, surface):
    """Return the mean outward normal (3,) of a surface."""
    _, area, normal = surface_areas(mesh, surface)
    return area @ normal / np.linalg.norm(area @ normal)


def _joint_defects(project, census):
    """D8, D11, D18: faults and joint sets."""
    centre, band = central_frequency(project), input_band(project)
    by_surface = {joint.surface: joint for joint in project.joints}
    pressures = joint_pressures(project.model)
    stiffness = {name: one.tangents(pressures[name]) for name, one in by_surface.items()}
    stiffness |= set_stiffness(project.config.mesh, project.joints, pressures)
    rocks, entries, alike = _stiff(project, census), joint_of_surface(project.config.mesh), {}
    for name in project.faults:
        alike.setdefault(entries[name], []).append(name)
    for entry, faults in alike.items():
        names, joint = ", ".join(faults), by_surface[faults[0]]
        for group, material in rocks.items():
            yield checks_ground.fault_low_pass(
                names, stiffness[faults[0]], group, material, centre, band
            )
        infill = project.config.joints[entry].infill_mm
        if infill is not None:
            thickness = [1e-3 * value for value in infill]
            yield checks_ground.infill_as_layer(names, joint, thickness)
    for part in project.config.mesh.joint_sets:
        for group in part.regions or rocks:
            yield checks_ground.jointed_speeds(
                part.name, stiffness[part.name], part.spacing_m, group,
                project.materials[group], centre,
            )  # fmt: skip


def _record_defects(project, census):
    """D13, D16: late arrivals and damping."""
    if project.blast is not None:
        source = project.blast.centres.mean(axis=0)
        for receiver in project.receivers:
            distance = float(np.linalg.norm(source - receiver.position))
            yield checks_loads.air_blast(
                receiver.name, distance, float(project.blast.times.max()),
                project.config.run.duration_s,
            )  # fmt: skip
    damping = project.model.damping
    by_group = damping if isinstance(damping, dict) else {"": damping}
    for name, part in by_group.items():
        yield checks_ground.rayleigh_price(part, census.undamped_dt, name)
