"""Mesh of tetrahedra or hexahedra with named surfaces, and its splitting along joints."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ..errors import InputError
from . import hexahedra, tetrahedra
from .faces import (
    face_table,
    face_vectors,
    find_faces,
    pair_faces,
    zone_faces,
    zone_of_face,
)
from .hexahedra import AbsorbingLayer

# Facets that meet at larger angles keep separate contacts with their own normals.
_COSINE_MERGED = np.cos(np.radians(20.0))


def graph_components(first: np.ndarray, second: np.ndarray, n: int) -> tuple[int, np.ndarray]:
    """Return number and labels of the connected components of a graph given by its edges."""
    graph = coo_array((np.ones(len(first), dtype=np.int32), (first, second)), shape=(n, n))
    return connected_components(graph.tocsr(), directed=False)


def double_nodes(
    zones: np.ndarray, n_nodes: int, facets: np.ndarray, first: np.ndarray, second: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Duplicate joint nodes: one node for each connected part of the corners around it.

    Parameters
    ----------
    zones : (n_zones, 4 or 8) int32
    n_nodes : int
    facets : (n, 3 or 4) int32, faces of all joints
    first, second : (n_welded,) int64, shared faces that are not joints

    Returns
    -------
    zones : (n_zones, 4 or 8) int32, new
    origin : (n_new_nodes,) int64, old node of each new one
    """
    on_joint = np.zeros(n_nodes, dtype=bool)
    on_joint[facets] = True
    corner_node = zones.ravel()
    corners = np.flatnonzero(on_joint[corner_node])
    number = np.full(len(corner_node), -1)
    number[corners] = np.arange(len(corners))
    pair = [_sorted_corners(zones, faces) for faces in (first, second)]
    touching = on_joint[corner_node[pair[0]]]
    low, high = (number[side[touching]] for side in pair)
    _, label = graph_components(low, high, len(corners))
    node = corner_node[corners]
    order = np.argsort(node, kind="stable")
    _, where = np.unique(label[order], return_index=True)
    leader = order[where]
    rank = np.lexsort((leader, node[leader]))
    leader = leader[rank]
    keeps = np.diff(node[leader], prepend=-1) != 0
    new_node = np.where(keeps, node[leader], n_nodes - 1 + np.cumsum(~keeps))
    part_node = np.empty(len(rank), dtype=np.int64)
    part_node[rank] = new_node
    doubled = corner_node.copy()
    doubled[corners] = part_node[label]
    return doubled.reshape(zones.shape), np.concatenate([np.arange(n_nodes), node[leader][~keeps]])


def _sorted_corners(zones, faces):
    """Return the corners ``n_corners zone + local`` of faces, in the order of their nodes."""
    zone, local = zone_of_face(zones, faces)
    corners = zones.shape[1] * zone[:, None] + face_table(zones)[local]
    return np.take_along_axis(corners, np.argsort(zones.ravel()[corners], axis=1), axis=1)


def orient(
    points: np.ndarray, zones: np.ndarray, joint: np.ndarray, first: np.ndarray, second: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the faces of the minus and plus sides, consistently oriented over each joint."""
    outward = zone_faces(zones)[first]
    vectors = face_vectors(points, outward)
    upward = np.einsum("ij,ij->i", vectors, _main_normals(vectors, joint)[joint])
    n = len(joint)
    sides = outward.shape[1]
    ends = np.stack([np.arange(sides), np.roll(np.arange(sides), -1)], axis=1)
    edges = outward[:, ends].reshape(-1, 2).astype(np.int64)
    low, high = edges.min(axis=1), edges.max(axis=1)
    owner = np.repeat(np.arange(n), sides)
    order = np.lexsort((owner, high, low, joint[owner]))
    key = np.column_stack([joint[owner], low, high])[order]
    starts = np.flatnonzero(np.r_[True, (np.diff(key, axis=0) != 0).any(axis=1)][: sides * n])
    starts = starts[np.diff(starts, append=sides * n) == 2]
    edge, mate = order[starts], order[starts + 1]
    consistent = edges[edge, 0] != edges[mate, 0]
    # Vertices are facets with both signs: a component of this graph is one orientation.
    turned = np.where(consistent, 0, n)
    heads = np.concatenate([owner[edge], owner[edge] + n])
    tails = np.concatenate([owner[mate] + turned, owner[mate] + n - turned])
    count, label = graph_components(heads, tails, 2 * n)
    score = np.bincount(label, weights=np.concatenate([upward, -upward]), minlength=count)
    lead = score[label[:n]] - score[label[n:]]
    closed = np.abs(lead) < 1e-9 * np.abs(upward).sum()
    straight = np.where(closed, label[:n] <= label[n:], lead > 0.0)
    return np.where(straight, first, second), np.where(straight, second, first)


def _main_normals(vectors, joint):
    """Return the upward principal direction (n_joints, 3) of the area vectors of each joint."""
    count = joint.max(initial=-1) + 1
    tensor = np.zeros((count, 3, 3))
    lengths = np.linalg.norm(vectors, axis=1)
    np.add.at(tensor, joint, vectors[:, :, None] * vectors[:, None, :] / lengths[:, None, None])
    main = np.linalg.eigh(tensor)[1][:, :, 2].round(9)
    leading = np.where(main[:, 2] != 0.0, main[:, 2], np.where(main[:, 1], main[:, 1], main[:, 0]))
    return main * np.sign(leading)[:, None]


def pair_nodes(
    points: np.ndarray,
    zones: np.ndarray,
    doubled: np.ndarray,
    joint: np.ndarray,
    minus: np.ndarray,
    plus: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return contacts: pairs of corners of facing facets, each with its share of the area.

    Parameters
    ----------
    points : (n_nodes, 3) float64, m
    zones, doubled : (n_zones, 4 or 8) int32, before and after the nodes were doubled
    joint : (n,) int64, joint of each facet
    minus, plus : (n,) int64, its faces

    Returns
    -------
    joint, minus, plus : (n_contacts,) int64, nodes of the two sides
    normal : (n_contacts, 3) float64, unit, from minus to plus
    area : (n_contacts,) float64, m2
    """
    minus_node = doubled.ravel()[_sorted_corners(zones, minus)].ravel()
    plus_node = doubled.ravel()[_sorted_corners(zones, plus)].ravel()
    vectors = face_vectors(points, zone_faces(zones)[minus])
    sides = face_table(zones).shape[1]
    keys = np.column_stack([joint.repeat(sides), minus_node, plus_node])
    apart = minus_node != plus_node
    keys, area, normal = merge_pairs(keys[apart], vectors.repeat(sides, axis=0)[apart] / sides)
    return keys[:, 0], keys[:, 1], keys[:, 2], normal, area


def merge_pairs(keys: np.ndarray, vectors: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Add the area vectors (n, 3) of equal keys (n, k), unless their directions differ too much."""
    order = np.lexsort(keys.T[::-1])
    keys, vectors = keys[order], vectors[order]
    length = np.linalg.norm(vectors, axis=1)
    if not len(keys):
        return keys, length, vectors
    fresh = np.r_[True, (np.diff(keys, axis=0) != 0).any(axis=1)]
    group = np.cumsum(fresh) - 1
    total = np.add.reduceat(vectors, np.flatnonzero(fresh), axis=0)
    mean = total / np.linalg.norm(total, axis=1)[:, None]
    straight = np.einsum("ij,ij->i", vectors, mean[group]) >= _COSINE_MERGED * length
    kinked = np.bincount(group, weights=~straight) > 0.0
    fresh |= kinked[group]
    starts = np.flatnonzero(fresh)
    total = np.add.reduceat(vectors, starts, axis=0)
    normal = total / np.linalg.norm(total, axis=1)[:, None]
    return keys[starts], np.add.reduceat(length, starts), normal


@dataclass(frozen=True, eq=False)
class Contacts:
    """Contacts: pairs of facing nodes across joints.

    Parameters
    ----------
    joint : (n_contacts,) int32, index into ``names``
    names : tuple of str
    minus, plus : (n_contacts,) int32, nodes of the two sides
    normal : (n_contacts, 3) float64, unit, from minus to plus
    area : (n_contacts,) float64, m2
    """

    joint: np.ndarray
    names: tuple[str, ...]
    minus: np.ndarray
    plus: np.ndarray
    normal: np.ndarray
    area: np.ndarray


@dataclass(frozen=True, eq=False)
class Mesh:
    """Mesh of tetrahedra or hexahedra: nodes, zones in groups, named surfaces and contacts.

    Parameters
    ----------
    points : (n_nodes, 3) float64, m
    zones : (n_zones, 4 or 8) int32, of positive volume
        Corners of tetrahedra, or of hexahedra in the order of `hexahedra`.
    zone_group : (n_zones,) int32, index into ``groups``
    groups : tuple of str
    surfaces : dict of str to (n, 3 or 4) int32
    contacts : Contacts or None
        None before ``split``.
    order : int
        Of the polynomials of spectral hexahedra, 2 to 8; 1 for tetrahedra.
    places : (n_zones, (order + 1)^3, 3) float64 or None, m
        Nodes of curved hexahedra; None: straight edges.
    layer : AbsorbingLayer or None
        Of hexahedra at the sides where the ground goes on.

    Raises
    ------
    InputError
        If shapes or indices are inconsistent.

    Examples
    --------
    >>> points = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    >>> mesh = Mesh(points, np.array([[0, 1, 2, 3]]), np.array([0]), ("rock",), {})
    >>> zone_volumes(mesh).round(4).tolist()
    [0.1667]
    """

    points: np.ndarray
    zones: np.ndarray
    zone_group: np.ndarray
    groups: tuple[str, ...]
    surfaces: dict[str, np.ndarray]
    contacts: Contacts | None = None
    order: int = 1
    places: np.ndarray | None = None
    layer: AbsorbingLayer | None = None

    def __post_init__(self) -> None:
        """Convert the types; check shapes and indices."""
        if self.order != 1 and self.order not in hexahedra.ORDERS:
            raise InputError(f"mesh.order: must be 2 to 8 for hexahedra, got {self.order}")
        sides = 4 if self.order > 1 else 3
        surfaces = {name: _indices(faces, sides) for name, faces in self.surfaces.items()}
        object.__setattr__(self, "points", np.ascontiguousarray(self.points, dtype=np.float64))
        object.__setattr__(self, "zones", _indices(self.zones, 8 if self.order > 1 else 4))
        object.__setattr__(self, "zone_group", np.asarray(self.zone_group, dtype=np.int32))
        object.__setattr__(self, "groups", tuple(self.groups))
        object.__setattr__(self, "surfaces", surfaces)
        if self.zone_group.shape != (len(self.zones),):
            raise InputError(
                f"mesh.zone_group: must have one entry for each of {len(self.zones)} zones, "
                f"got shape {self.zone_group.shape}"
            )
        _refuse_indices("zone_group", self.zone_group, len(self.groups), "groups")
        _refuse_indices("zones", self.zones, len(self.points), "nodes")
        for name, faces in surfaces.items():
            _refuse_indices(f"surfaces[{name!r}]", faces, len(self.points), "nodes")

    @property
    def hexahedral(self) -> bool:
        """Whether the zones are hexahedra."""
        return self.order > 1

    @cached_property
    def volumes(self) -> np.ndarray:
        """Volume (n_zones,) of each zone in m3."""
        if not self.hexahedral:
            return tetrahedra.volumes(self.points, self.zones)
        jacobian = hexahedra.jacobians(self.node_places, self.order)
        return np.linalg.det(jacobian) @ hexahedra.node_weights(self.order)

    @cached_property
    def node_places(self) -> np.ndarray:
        """Positions (n_zones, (order + 1)^3, 3) in m of the nodes of hexahedra."""
        if self.places is not None:
            return self.places
        return hexahedra.zone_nodes_places(self.points, self.zones, self.order)

    @cached_property
    def zone_limits(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest coordinates (n_zones, 3) in m of the nodes of hexahedra."""
        return hexahedra.zone_limits(self.node_places)

    @cached_property
    def surface_places(self) -> dict[str, np.ndarray]:
        """Results of `surface_faces`, by surface."""
        return {}

    @cached_property
    def paired_faces(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Faces shared by zones, see ``pair_faces``; computed once."""
        return pair_faces(self.zones, len(self.points))

    @cached_property
    def walls(self) -> tuple[np.ndarray, np.ndarray]:
        """Faces where a ground ends, and their corners: outer faces, joints, between groups."""
        first, second, single, _ = self.paired_faces
        group = (self.zone_group[zone_of_face(self.zones, side)[0]] for side in (first, second))
        faces = np.concatenate([single, first[np.not_equal(*group)]])
        return faces, zone_faces(self.zones)[faces]

    def split(self, names: Sequence[str]) -> "Mesh":
        """Return the mesh split along named internal surfaces; see ``split_mesh``."""
        return split_mesh(self, names)

    def blocks(self, among: np.ndarray | None = None) -> np.ndarray:
        """Return the block (n,) of each zone: zones connected without crossing a joint.

        Of all zones, or of zones (n,) connected among themselves.
        """
        among = np.arange(len(self.zones)) if among is None else among
        number = np.full(len(self.zones), -1)
        number[among] = np.arange(len(among))
        first, second, _, _ = self.paired_faces
        pairs = number[zone_of_face(self.zones, np.stack([first, second]))[0]]
        low, high = pairs[:, (pairs >= 0).all(axis=0)]
        return graph_components(low, high, len(among))[1]


def _indices(values, width):
    """Return an index table (n, width) int32; raise InputError for another shape."""
    table = np.asarray(values)
    if table.size == 0:
        table = np.empty((0, width))
    if table.ndim != 2 or table.shape[1] != width:
        raise InputError(f"mesh: index table must have {width} columns, got shape {table.shape}")
    return np.ascontiguousarray(table, dtype=np.int32)


def _refuse_indices(what, indices, count, of):
    """Raise InputError for an index outside 0..count-1."""
    if indices.size and (indices.min() < 0 or indices.max() >= count):
        raise InputError(
            f"mesh.{what}: must lie between 0 and {count - 1} ({count} {of}), "
            f"got {indices.min()} to {indices.max()}"
        )


def split_mesh(mesh: Mesh, names: Sequence[str]) -> Mesh:
    """Split a mesh along named internal surfaces: duplicate nodes and pair them as contacts.

    Two corners of zones at a node stay together if their zones share a face that contains the node
    and is not a joint; each connected part gets its own node. A node where three joints cross
    becomes eight; the tip of a joint that ends in a block stays single.

    Parameters
    ----------
    mesh : Mesh
    names : sequence of str
        Keys of ``mesh.surfaces``.

    Returns
    -------
    Mesh
        First copies keep their number, further ones are appended. ``surfaces[name]`` is the minus
        side of each joint; outer surfaces follow their zones.

    Raises
    ------
    InputError
        If a name is unknown, the mesh is split already, or a facet is not an internal face.
    """
    names = tuple(names)
    if mesh.contacts is not None:
        raise InputError("mesh.split: the mesh is split already; name all joints in one call")
    for name in names:
        if name not in mesh.surfaces:
            raise InputError(
                f"mesh.split: no surface named {name!r}; there are {', '.join(mesh.surfaces)}"
            )
    none = np.empty((0, face_table(mesh.zones).shape[1]), int)
    facets = np.concatenate([none, *(mesh.surfaces[name] for name in names)])
    joint = np.repeat(np.arange(len(names)), [len(mesh.surfaces[name]) for name in names])
    first, second, single, _ = mesh.paired_faces
    at = _facet_places(mesh, facets, joint, names, first)
    welded = np.ones(len(first), dtype=bool)
    welded[at] = False
    zones, origin = double_nodes(
        mesh.zones, len(mesh.points), facets, first[welded], second[welded]
    )
    minus, plus = orient(mesh.points, mesh.zones, joint, first[at], second[at])
    owner, *pairs = pair_nodes(mesh.points, mesh.zones, zones, joint, minus, plus)
    outer = np.concatenate([single, first])
    surfaces = {}
    for name in mesh.surfaces:
        if name in names:
            face = minus[joint == names.index(name)]
            surfaces[name] = zone_faces(zones)[face]
        else:
            surfaces[name] = _moved(mesh, zones, name, outer)
    contacts = Contacts(owner.astype(np.int32), names, *pairs)
    return replace(
        mesh, points=mesh.points[origin], zones=zones, surfaces=surfaces, contacts=contacts
    )


def _facet_places(mesh, facets, joint, names, first):
    """Return the position of each joint facet in the list of shared faces."""
    at = find_faces(mesh.zones, len(mesh.points), facets, first)
    lost = np.flatnonzero(at < 0)
    if len(lost):
        x, y, z = mesh.points[facets[lost[0]]].mean(axis=0)
        raise InputError(
            f"mesh.split: {len(lost)} facets of {names[joint[lost[0]]]!r} are not faces between "
            f"two zones, the first at ({x:g}, {y:g}, {z:g}); the mesh must conform to its joints"
        )
    order = np.argsort(at, kind="stable")
    twice = np.flatnonzero(np.diff(at[order]) == 0)
    if len(twice):
        pair = [names[joint[order[twice[0] + k]]] for k in (0, 1)]
        raise InputError(
            f"mesh.split: a facet of {pair[0]!r} stands in {pair[1]!r} too; name it once"
        )
    return at


def _moved(mesh, zones, name, faces):
    """Return the faces of an outer surface after splitting."""
    corners = mesh.surfaces[name]
    zone, _ = zone_of_face(zones, _surface_faces(mesh, name, faces))
    same = mesh.zones[zone][:, None, :] == corners[:, :, None]
    return np.take_along_axis(zones[zone], same.argmax(axis=2), axis=1)


def _surface_faces(mesh, name, faces):
    """Return the number of each face of a surface."""
    at = find_faces(mesh.zones, len(mesh.points), mesh.surfaces[name], faces)
    if (at < 0).any():
        raise InputError(
            f"mesh.surfaces[{name!r}]: {np.count_nonzero(at < 0)} facets are not faces of "
            "zones; the surface must conform to the mesh"
        )
    return faces[at]


def outer_faces(mesh: Mesh) -> np.ndarray:
    """Return the outward faces (n, 3 or 4) of the boundary of the mesh, without joints."""
    welded = np.arange(len(mesh.points))
    if mesh.contacts is not None:
        welded = graph_components(mesh.contacts.minus, mesh.contacts.plus, len(mesh.points))[1]
    single = pair_faces(welded[mesh.zones], len(mesh.points))[2]
    return zone_faces(mesh.zones)[np.sort(single)]


def surface_faces(mesh: Mesh, name: str) -> np.ndarray:
    """Return the number (n,) of each face of a surface, see ``faces``.

    For joints, that of the minus side.
    """
    if name not in mesh.surfaces:
        raise InputError(f"mesh: no surface named {name!r}; there are {', '.join(mesh.surfaces)}")
    if name not in mesh.surface_places:
        first, _, single, _ = mesh.paired_faces
        faces = np.concatenate([single, first])
        mesh.surface_places[name] = _surface_faces(mesh, name, faces)
    return mesh.surface_places[name]


def inner_facets(mesh: Mesh, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Return which facets (n,) of a surface lie between two zones, and the zones (k, 2) of these.

    Facets of a joint that was split lie between contacts, not between zones.
    """
    first, second, _, _ = mesh.paired_faces
    faces = surface_faces(mesh, name)
    order = np.argsort(first)
    at = np.minimum(np.searchsorted(first[order], faces), max(len(first) - 1, 0))
    inner = first[order][at] == faces if len(first) else np.zeros(len(faces), dtype=bool)
    pairs = np.stack([first[order][at[inner]], second[order][at[inner]]], axis=1)
    return inner, zone_of_face(mesh.zones, pairs)[0]


def surface_zones(mesh: Mesh, name: str) -> np.ndarray:
    """Return the zone (n,) behind each face of a surface; for joints, of the minus side."""
    return zone_of_face(mesh.zones, surface_faces(mesh, name))[0]


def surface_areas(mesh: Mesh, name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the tributary areas of the nodes of a surface.

    Returns
    -------
    nodes : (3 n_triangles,) int32, triangle by triangle
    area : (3 n_triangles,) float64, a third of each triangle, m2
    normal : (3 n_triangles, 3) float64, unit, out of the zone behind
    """
    zone = surface_zones(mesh, name)
    triangles = mesh.surfaces[name]
    vectors = face_vectors(mesh.points, triangles)
    inward = mesh.points[mesh.zones[zone]].mean(axis=1) - mesh.points[triangles[:, 0]]
    vectors *= -np.sign(np.einsum("ij,ij->i", vectors, inward))[:, None]
    length = np.linalg.norm(vectors, axis=1)
    normal = (vectors / length[:, None]).repeat(3, axis=0)
    return triangles.ravel(), (length / 3.0).repeat(3), normal


def zone_volumes(mesh: Mesh) -> np.ndarray:
    """Return the volume (n_zones,) of each zone in m3."""
    return mesh.volumes


def quality(mesh: Mesh) -> np.ndarray:
    """Return the quality (n_zones,): 1 for a regular zone, 0 for a flat one.

    Of tetrahedra the mean ratio, of hexahedra the smallest scaled Jacobian at their nodes.
    """
    if mesh.hexahedral:
        jacobian = hexahedra.jacobians(mesh.node_places, mesh.order)
        lengths = np.linalg.norm(jacobian, axis=2).prod(axis=2)
        return (np.linalg.det(jacobian) / lengths).min(axis=1)
    return tetrahedra.mean_ratio(mesh.points, mesh.zones)


def zone_edge_lengths(mesh: Mesh) -> np.ndarray:
    """Return the edge lengths of each zone, (n_zones, 6 or 12) in m."""
    element = hexahedra if mesh.hexahedral else tetrahedra
    return element.edge_lengths(mesh.points, mesh.zones)


def locate_in_zones(
    mesh: Mesh, points: ArrayLike, tolerance: float | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return the zone (n,) of points (n, 3), and barycentric (n, 4) or reference coordinates."""
    if mesh.hexahedral:
        limits = mesh.zone_limits
        return hexahedra.locate(mesh.node_places, mesh.order, points, tolerance, limits)
    return tetrahedra.locate(mesh.points, mesh.zones, points, tolerance)
