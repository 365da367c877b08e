"""Stress before the blast: overburden, horizontal ratio, uniform part, its share in joints."""

import numpy as np
from scipy.spatial import cKDTree

from ..mesh import tetrahedra

BINS = 200
TENSOR = np.array([[0, 5, 4], [5, 1, 3], [4, 3, 2]])


def overburden_stress(model, places=None):
    """Return the stress (n_zones, 6) in Pa of the weight above; xx yy zz yz zx xy.

    Parameters
    ----------
    model : Model
    places : (n, 3) float64, m, optional
        Where; the centres of the zones unless given.

    Notes
    -----
    The weight above a place is that of the mean ground at each level, from there up to the
    surface "top" above it; what this leaves out of balance, the static stage removes.
    """
    mesh = model.mesh
    centres = mesh.points[mesh.zones].mean(axis=1)
    places = centres if places is None else places
    volume = tetrahedra.volumes(mesh.points, mesh.zones)
    low, high = mesh.points[:, 2].min(), mesh.points[:, 2].max()
    levels = np.linspace(low, high, BINS + 1)
    weight = np.histogram(centres[:, 2], levels, weights=volume * model.zone_values("density"))[0]
    space = np.histogram(centres[:, 2], levels, weights=volume)[0]
    filled = space > 0.0
    density = np.interp(np.arange(BINS), np.flatnonzero(filled), (weight[filled] / space[filled]))
    column = np.append(0.0, np.cumsum(density * np.diff(levels)))
    top = np.full(len(places), high)
    if "top" in mesh.surfaces:
        surface = mesh.points[np.unique(mesh.surfaces["top"])]
        top = surface[cKDTree(surface[:, :2]).query(places[:, :2])[1], 2]
    above = np.interp(top, levels, column) - np.interp(places[:, 2], levels, column)
    vertical = -model.insitu.gravity * np.maximum(above, 0.0)
    stress = np.zeros((len(places), 6))
    stress[:, :2] = model.insitu.horizontal_ratio * vertical[:, None]
    stress[:, 2] = vertical
    return stress


def insitu_stress(model, places=None):
    """Return the stress (n_zones, 6) in Pa before anything moves: overburden and uniform part.

    At the centres of the zones, or at places (n, 3) in m.
    """
    return overburden_stress(model, places) + np.asarray(model.insitu.stress, dtype=float)


def corner_forces(model):
    """Return the forces (n_zones, n, 3) in N of the stress on the nodes of their zones; (2.3).

    The stress is that at the centre of a zone; in zones of 15 nodes, which can balance it,
    linear between their corners.
    """
    nodes, mesh = model.nodes, model.mesh
    volume = tetrahedra.volumes(mesh.points, mesh.zones)
    every = np.arange(len(volume))
    if model.quadratic:
        at = insitu_stress(model, mesh.points)[mesh.zones]
        pairs = zip(np.moveaxis(at, 1, 0), nodes.corner_slopes(every), strict=True)
    else:
        pairs = [(insitu_stress(model), nodes.mean_slopes(every))]
    force = sum(np.einsum("zij,zkj->zki", s[:, TENSOR], slopes) for s, slopes in pairs)
    return -volume[:, None, None] * force


def joint_tractions(model):
    """Return the traction (n_contacts, 3) in Pa of the stress before the blast at each contact.

    Of the mean stress around it; where zones have 15 nodes, of the stress at its place.
    """
    nodes, contacts = model.nodes, model.nodes.contacts
    if model.quadratic:
        at = insitu_stress(model, nodes.points[contacts.minus])
        return np.einsum("cij,cj->ci", at[:, TENSOR], contacts.normal)
    stress = insitu_stress(model)
    volume = tetrahedra.volumes(nodes.mesh.points, nodes.mesh.zones)
    mean = np.stack([nodes.sums(volume * stress[:, k]) for k in range(6)], axis=1)
    both = mean[contacts.minus] + mean[contacts.plus]
    space = nodes.sums(volume)
    both /= (space[contacts.minus] + space[contacts.plus])[:, None]
    return np.einsum("cij,cj->ci", both[:, TENSOR], contacts.normal)


def joint_pressures(model):
    """Return the mean normal pressure in Pa on each joint before the blast, by its surface."""
    pressures = {joint.surface: joint.insitu_pressure for joint in model.joints}
    contacts = model.nodes.contacts
    if model.insitu is None or contacts is None:
        return pressures
    traction = joint_tractions(model)
    normal = -np.einsum("ci,ci->c", traction, contacts.normal)
    area = np.bincount(contacts.joint, contacts.area, len(contacts.names))
    mean = np.bincount(contacts.joint, contacts.area * normal, len(contacts.names)) / area
    return dict(zip(contacts.names, map(float, mean), strict=True))


def static_loads(model, geometry):
    """Return nodal loads, joint tractions and the size of the forces that must balance.

    Returns
    -------
    node_load : (n_nodes, 3) float64, N
    contact_initial : (n_contacts, 3) float64, Pa
    scale : float, N
        Sum of the corner forces of the in-situ stress.
    """
    nodes = model.nodes
    corner = corner_forces(model)
    load = np.zeros_like(nodes.points)
    np.add.at(load, nodes.zone_nodes, corner)
    mass = model.zone_values("density") * tetrahedra.volumes(model.mesh.points, model.mesh.zones)
    load[:, 2] -= model.insitu.gravity * nodes.sums(mass)
    traction = geometry["contact_initial"]
    if nodes.contacts is not None:
        traction = joint_tractions(model)
        force = nodes.contacts.area[:, None] * traction
        np.add.at(load, nodes.contacts.minus, force)
        np.add.at(load, nodes.contacts.plus, -force)
    return load, traction, float(np.linalg.norm(corner, axis=2).sum())
