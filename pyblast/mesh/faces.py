"""Faces of tetrahedra (triangles) and hexahedra (quadrilaterals): keys, pairs, search, areas.

A face is numbered ``n_faces zone + local``, with 4 faces of a tetrahedron and 6 of a hexahedron.
"""

import numpy as np

from ..errors import InputError
from . import hexahedra, tetrahedra

_LARGEST_CUBE = 2_000_000  # nodes of which three fit into 63 bits
_LARGEST_FOURTH_POWER = 55_108  # the same for four
_STEP, _FACTOR = np.uint64(0x9E3779B97F4A7C15), np.uint64(0xBF58476D1CE4E5B9)  # SplitMix64


def face_table(zones: np.ndarray) -> np.ndarray:
    """Return the corners (n_faces, 3 or 4) of the outward faces of a zone."""
    return tetrahedra.FACES if zones.shape[1] == 4 else hexahedra.FACES


def face_keys(faces: np.ndarray, n_nodes: int) -> np.ndarray:
    """Return keys (n,) int64 of faces (n, 3 or 4), independent of the order of their nodes.

    All nodes count: two hexahedra may share three corners and no face. In meshes of more than
    55,108 nodes the keys of quadrilaterals are mixed bits, of which a million faces have two
    equal ones with a probability of 1e-7.
    """
    nodes = np.sort(np.asarray(faces, dtype=np.int64), axis=1)
    if n_nodes > _LARGEST_CUBE:
        raise InputError(f"mesh: at most {_LARGEST_CUBE} nodes can be indexed, got {n_nodes}")
    if nodes.shape[1] == 4 and n_nodes > _LARGEST_FOURTH_POWER:
        return _mixed(nodes)
    key = np.zeros(len(nodes), dtype=np.int64)
    for column in nodes.T:
        key = key * n_nodes + column
    return key


def _mixed(nodes):
    """Return a key of 63 bits of each row of sorted nodes: Steele, Lea & Flood (2014)."""
    key = np.zeros(len(nodes), dtype=np.uint64)
    for column in nodes.T.astype(np.uint64):
        key = (key ^ (column + _STEP)) * _FACTOR
        key ^= key >> np.uint64(29)
    return (key >> np.uint64(1)).astype(np.int64)


def zone_faces(zones: np.ndarray) -> np.ndarray:
    """Return the outward faces of every zone, (n_faces n_zones, 3 or 4)."""
    table = face_table(zones)
    return zones[:, table].reshape(-1, table.shape[1])


def zone_of_face(zones: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return zone and local number of faces (n,)."""
    return np.divmod(faces, len(face_table(zones)))


def pair_faces(
    zones: np.ndarray, n_nodes: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Pair the faces that two zones share.

    Returns
    -------
    first, second : (n_shared,) int64, faces of the two sides, first < second
    single : (n_single,) int64, faces of one zone only
    excess : (n_excess,) int64, third and further faces with the same nodes
    """
    keys = face_keys(zone_faces(zones), n_nodes)
    order = np.argsort(keys, kind="stable")
    starts = np.flatnonzero(np.diff(keys[order], prepend=-1))
    counts = np.diff(starts, append=len(order))
    shared = starts[counts >= 2]
    excess = np.ones(len(order), dtype=bool)
    excess[starts] = excess[shared + 1] = False
    return order[shared], order[shared + 1], order[starts[counts == 1]], order[excess]


def faces_of_skin(zones: np.ndarray, body: np.ndarray, own: np.ndarray) -> np.ndarray:
    """Return the outer faces (n,) of some of the tetrahedra that a mesh is shown as.

    Where neighbours that are cut into tetrahedra share a face and cut it by different diagonals,
    its halves have no partner, but the quadrilaterals of both bodies have the same corners.

    Parameters
    ----------
    zones : (n_zones, 4) int
        Nodes; those of one place have one number.
    body : (n_zones,) int
        Zone of the model that each is a part of.
    own : (n_own,) int
        The tetrahedra whose outer faces are asked.
    """
    single = np.sort(pair_faces(zones[own], int(zones.max(initial=0)) + 1)[2])
    face = 4 * own[single // 4] + single % 4
    corners, of = np.sort(zone_faces(zones)[face], axis=1), body[face // 4]
    edge = np.concatenate([corners[:, [0, 1]], corners[:, [0, 2]], corners[:, [1, 2]]])
    half = np.tile(np.arange(len(face)), 3)
    order = np.lexsort((of[half], edge[:, 1], edge[:, 0]))
    edge, half = edge[order], half[order]
    same = np.all(edge[1:] == edge[:-1], axis=1) & (of[half[1:]] == of[half[:-1]])
    first, second, shared = half[:-1][same], half[1:][same], edge[1:][same]
    tips = [corners[each].sum(axis=1) - shared.sum(axis=1) for each in (first, second)]
    four = np.sort(np.column_stack([shared, *tips]), axis=1)
    number = np.unique(four, axis=0, return_inverse=True)[1].reshape(-1)
    low, high = np.full(len(number), len(zones)), np.full(len(number), -1)
    np.minimum.at(low, number, of[first])
    np.maximum.at(high, number, of[first])
    inner = (low < high)[number]  # of two bodies
    return np.delete(face, np.concatenate([first[inner], second[inner]]))


def find_faces(
    zones: np.ndarray, n_nodes: int, wanted: np.ndarray, faces: np.ndarray
) -> np.ndarray:
    """Return the position (n,) in ``faces`` of each of the ``wanted`` (n, 3 or 4), -1 if none."""
    on = np.zeros(n_nodes, dtype=bool)
    on[wanted] = True
    table = face_table(zones)
    zone, local = zone_of_face(zones, faces)
    corners = zones[zone[:, None], table[local]]
    near = np.flatnonzero(on[corners].all(axis=1))
    if not len(near):
        return np.full(len(wanted), -1)
    keys = face_keys(corners[near], n_nodes)
    sought = face_keys(wanted, n_nodes)
    order = np.argsort(keys, kind="stable")
    at = order[np.minimum(np.searchsorted(keys, sought, sorter=order), len(near) - 1)]
    return np.where(keys[at] == sought, near[at], -1)


def face_vectors(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return the area vectors (n, 3) in m2 of triangles or quadrilaterals (n, 3 or 4)."""
    if faces.shape[1] == 4:
        return hexahedra.quadrilateral_vectors(points, faces)
    return tetrahedra.triangle_vectors(points, faces)
