"""Meshes of quadratic zones: nodes on edges, on faces and in zones beside those at corners."""

import numpy as np

from . import tetrahedra
from .contents import kept
from .elements import AREA_SHARE, FACE_NODES, NODES
from .mesh import Contacts, Mesh, surface_faces
from .splitting import components, merge_pairs


@kept
def enrich(mesh: Mesh):
    """Put nodes on edges and faces and into zones, on both sides of joints.

    Corners of two zones at an edge share a node where the zones are connected around that edge
    through faces that are not joints, so a joint ends at its own rim even where its mesh has but
    one facet between two edges of the rim.

    Parameters
    ----------
    mesh : Mesh
        Split or without joints.

    Returns
    -------
    points : (n_nodes, 3) float64, m
        Corners first, in their order.
    zone_nodes : (n_zones, 15) int32
        In the order of ``elements.NODES``.
    surfaces : dict of str to (n, 7) int32
        Nodes of the faces of outer surfaces, and of the minus side of joints.
    contacts : Contacts or None
    """
    first, second, joint, names = _shared_faces(mesh)
    welded = joint < 0
    edge = _edge_nodes(mesh.zones, first[welded], second[welded])
    face = components(first[welded], second[welded], 4 * len(mesh.zones))[1].reshape(-1, 4)
    n_corners, n_edges, n_faces = len(mesh.points), edge.max() + 1, face.max() + 1
    within = np.arange(len(mesh.zones))[:, None]
    numbers = [edge, n_edges + face, n_edges + n_faces + within]
    zone_nodes = np.hstack([mesh.zones] + [n_corners + part for part in numbers]).astype(np.int32)
    points = np.empty((zone_nodes.max() + 1, 3))
    for node in range(15):
        points[zone_nodes[:, node]] = _middles(mesh, NODES[node])
    points[:n_corners] = mesh.points
    faces = zone_nodes[:, FACE_NODES].reshape(-1, 7)
    surfaces = {name: faces[surface_faces(mesh, name)] for name in mesh.surfaces}
    contacts = None
    if mesh.contacts is not None:
        split = ~welded
        contacts = _contacts(mesh, faces, names, joint[split], first[split], second[split])
    return points, zone_nodes, surfaces, contacts


def _middles(mesh, weights):
    """Return the places (n_zones, 3) of one node of each zone, the same from all its zones."""
    ends = np.sort(mesh.zones[:, weights > 0.0], axis=1)
    return mesh.points[ends].mean(axis=1)


def _shared_faces(mesh):
    """Return faces that two zones share, joints or not, and the joint of each, -1 where welded."""
    n_nodes, contacts = len(mesh.points), mesh.contacts
    if contacts is None:
        first, second, _, _ = mesh.paired_faces
        return first, second, np.full(len(first), -1), ()
    label = components(contacts.minus, contacts.plus, n_nodes)[1]
    first, second, _, _ = tetrahedra.pair_faces(label[mesh.zones], n_nodes)
    keys = tetrahedra.face_keys(tetrahedra.zone_faces(mesh.zones), n_nodes)
    joint = np.full(len(first), -1)
    for number, name in enumerate(contacts.names):
        minus = tetrahedra.face_keys(mesh.surfaces[name], n_nodes)
        turned = np.isin(keys[second], minus) & (keys[second] != keys[first])
        first, second = np.where(turned, second, first), np.where(turned, first, second)
        joint[np.isin(keys[first], minus)] = number
    return first, second, joint, contacts.names


def _edge_nodes(zones, first, second):
    """Give the edges (n_zones, 6) of zones one number where welded faces join them."""
    local = np.zeros((4, 4), dtype=np.int64)
    local[tuple(tetrahedra.EDGES.T)] = local[tuple(tetrahedra.EDGES.T[::-1])] = np.arange(6)
    links = []
    for faces in (first, second):
        corners = tetrahedra.FACES[faces % 4]
        nodes = np.take_along_axis(zones[faces // 4], corners, axis=1)
        corners = np.take_along_axis(corners, np.argsort(nodes, axis=1), axis=1)
        edges = local[corners, np.roll(corners, -1, axis=1)]
        links.append((6 * (faces // 4)[:, None] + edges).ravel())
    return components(*links, 6 * len(zones))[1].reshape(-1, 6)


def _contacts(mesh, faces, names, joint, minus, plus):
    """Pair the seven nodes of facing facets; each gives its share of the area to each pair."""
    label = components(mesh.contacts.minus, mesh.contacts.plus, len(mesh.points))[1]
    vectors = tetrahedra.triangle_vectors(mesh.points, tetrahedra.zone_faces(mesh.zones)[minus])
    sides = []
    for side in (faces[minus], faces[plus]):
        order = np.argsort(label[side[:, :3]], axis=1)
        corners = np.take_along_axis(side[:, :3], order, axis=1)
        between = (order + np.where((np.roll(order, -1, axis=1) - order) % 3 == 1, 0, -1)) % 3
        middles = np.take_along_axis(side[:, 3:6], between, axis=1)
        sides.append(np.hstack([corners, middles, side[:, 6:]]).ravel())
    keys = np.column_stack([joint.repeat(7), *sides])
    apart = keys[:, 1] != keys[:, 2]
    shares = (vectors[:, None, :] * AREA_SHARE[:, None]).reshape(-1, 3)
    keys, area, normal = merge_pairs(keys[apart], shares[apart])
    owner, one, other = keys.astype(np.int32).T
    return Contacts(owner, names, one, other, normal, area)
