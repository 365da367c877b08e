"""Boundary conditions as kernel arrays: impedances of faces, dashpots, prescribed directions."""

import numpy as np

from ..meshing.mesh import surface_zones
from ..motion.seismogram import GEOGRAPHIC
from .anisotropy import impedance
from .boundaries import Fixed, Roller, VelocityInput, Viscous
from .loads import add_velocity_input


def surface_impedance(model, surface):
    """Sum area (rho cp n n + rho cs (I - n n)) over the faces around each node of a surface.

    Zones of anisotropic ground, or with an anisotropic medium behind them, have that of (2.23).

    Returns
    -------
    dict of int to (3, 3) float64, N s/m
        Source: Lysmer & Kuhlemeyer (1969); theory.md (4.1), (2.23).
    """
    nodes, area, normal = model.nodes.surface_areas(surface)
    behind = surface_zones(model.mesh, surface)
    zone = np.repeat(behind, len(nodes) // len(behind))
    density = model.zone_values("density")[zone]
    z_p, z_s = (area * density * model.zone_values(speed)[zone] for speed in ("cp", "cs"))
    outer = normal[:, :, None] * normal[:, None, :]
    each = (z_p - z_s)[:, None, None] * outer + z_s[:, None, None] * np.eye(3)
    faster = np.broadcast_to(model.speed_factor, len(model.mesh.zones))[zone]
    media = {}
    for boundary in model.boundaries:
        if isinstance(boundary, Viscous) and boundary.surface == surface:
            media = boundary.media
    for number, group in enumerate(model.mesh.groups):
        medium = media.get(group, model.materials[group])
        if medium.law.name == "anisotropic":
            here = model.mesh.zone_group[zone] == number
            factor = area[here] * faster[here]
            wave = impedance(density[here], medium.law.stiffness, normal[here])
            each[here] = factor[:, None, None] * wave
    unique, place = np.unique(nodes, return_inverse=True)
    summed = np.zeros((len(unique), 3, 3))
    np.add.at(summed, place, each)
    return {int(node): matrix for node, matrix in zip(unique, summed, strict=True)}


def dynamic_conditions(model, geometry, loads):
    """Return dashpots and prescribed motion of the dynamic stage as kernel arrays."""
    fixed = {}
    for boundary in model.boundaries:
        if isinstance(boundary, VelocityInput):
            _move_all(model, boundary, fixed, add_velocity_input(loads, boundary, geometry["dt"]))
    for boundary in model.boundaries:
        if isinstance(boundary, Fixed):
            _fix_axes(model, boundary, fixed)
        elif isinstance(boundary, Roller) and boundary.dynamic:
            _fix_normal(model, boundary, fixed)
    quiet = {}
    for boundary in model.boundaries:
        if isinstance(boundary, Viscous):
            for node, matrix in surface_impedance(model, boundary.surface).items():
                quiet[node] = quiet.get(node, 0.0) + matrix
    return {**_dashpot_arrays(quiet, fixed, geometry), **_fixed_arrays(fixed)}


def static_conditions(model, geometry):
    """Return rollers and fixed surfaces of the static stage; viscous surfaces stand on rollers."""
    fixed = {}
    for boundary in model.boundaries:
        if isinstance(boundary, Fixed):
            _fix_axes(model, boundary, fixed)
        elif isinstance(boundary, (Roller, Viscous)):
            _fix_normal(model, boundary, fixed)
    return {**_dashpot_arrays({}, fixed, geometry), **_fixed_arrays(fixed)}


def _move_all(model, boundary, fixed, histories):
    """Prescribe all three axes at the nodes of a surface; where two meet they move alike."""
    for node in np.unique(model.nodes.surfaces[boundary.surface]):
        if int(node) not in fixed:
            fixed[int(node)] = list(zip(np.eye(3), histories, strict=True))


def _fix_axes(model, boundary, fixed):
    """Hold the named components at the nodes of a surface."""
    axes = [np.eye(3)[GEOGRAPHIC.index(name)] for name in boundary.components]
    for node in np.unique(model.nodes.surfaces[boundary.surface]):
        for axis in axes:
            _hold(fixed, int(node), axis)


def _fix_normal(model, boundary, fixed):
    """Hold the normal of a surface at its nodes."""
    nodes, area, normal = model.nodes.surface_areas(boundary.surface)
    unique, place = np.unique(nodes, return_inverse=True)
    mean = np.zeros((len(unique), 3))
    np.add.at(mean, place, area[:, None] * normal)
    for node, direction in zip(unique, mean / np.linalg.norm(mean, axis=1)[:, None], strict=True):
        _hold(fixed, int(node), direction)


def _hold(fixed, node, direction):
    """Hold a node along a direction, orthogonal to what is prescribed there already."""
    known = fixed.setdefault(node, [])
    for other, _ in known:
        direction = direction - (direction @ other) * other
    if np.linalg.norm(direction) > 1e-6:
        known.append((direction / np.linalg.norm(direction), -1))


def _dashpot_arrays(quiet, fixed, geometry):
    """Dashpots act only along directions that are free to move."""
    nodes = np.array(sorted(quiet), dtype=np.int32)
    stack = np.zeros((len(nodes), 3, 3))
    for row, node in enumerate(nodes):
        free = np.eye(3)
        for direction, _ in fixed.get(int(node), ()):
            free = free - np.outer(direction, direction)
        stack[row] = free @ quiet[int(node)] @ free
    half = 0.5 * geometry["dt"]
    inertia = geometry["node_mass"][nodes] * (1.0 + half * geometry["node_alpha"][nodes])
    return {
        "dashpot_node": nodes,
        "dashpot_impedance": stack,
        "dashpot_inverse": np.linalg.inv(inertia[:, None, None] * np.eye(3) + half * stack),
    }


def _fixed_arrays(fixed):
    """Flatten the prescribed directions of all nodes; one of no length where there is none."""
    rows = [(n, d, h) for n in sorted(fixed) for d, h in fixed[n]] or [(0, np.zeros(3), -1)]
    return {
        "fixed_node": np.array([n for n, _, _ in rows], dtype=np.int32),
        "fixed_direction": np.array([d for _, d, _ in rows]).reshape(-1, 3),
        "fixed_history": np.array([h for _, _, h in rows], dtype=np.int32),
    }
