"""Doubling of nodes along internal surfaces, on plain arrays."""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from . import tetrahedra

# Facets that meet at larger angles keep their own contacts, because one normal can't serve both.
_COSINE_MERGED = np.cos(np.radians(20.0))


def components(first, second, n):
    """Return number and labels of the connected parts of a graph given by its edges."""
    graph = coo_array((np.ones(len(first), dtype=np.int32), (first, second)), shape=(n, n))
    return connected_components(graph.tocsr(), directed=False)


def double_nodes(zones, n_nodes, facets, first, second):
    """Give every connected part of the corners at a joint node a node of its own.

    Parameters
    ----------
    zones : (n_zones, 4) int32
    n_nodes : int
    facets : (n, 3) int32, triangles of all joints
    first, second : (n_welded,) int64, shared faces ``4 zone + local`` that are not joints

    Returns
    -------
    zones : (n_zones, 4) int32, new
    origin : (n_new_nodes,) int64, old node of each new one
    """
    on_joint = np.zeros(n_nodes, dtype=bool)
    on_joint[facets] = True
    corner_node = zones.ravel()
    corners = np.flatnonzero(on_joint[corner_node])
    number = np.full(len(corner_node), -1)
    number[corners] = np.arange(len(corners))
    one, other = (_sorted_corners(zones, faces) for faces in (first, second))
    touching = on_joint[corner_node[one]]
    _, label = components(number[one[touching]], number[other[touching]], len(corners))
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
    return doubled.reshape(-1, 4), np.concatenate([np.arange(n_nodes), node[leader][~keeps]])


def _sorted_corners(zones, faces):
    """Return the corners ``4 zone + local`` of faces (n, 3), in the order of their nodes."""
    corners = 4 * (faces // 4)[:, None] + tetrahedra.FACES[faces % 4]
    return np.take_along_axis(corners, np.argsort(zones.ravel()[corners], axis=1), axis=1)


def orient(points, zones, joint, first, second):
    """Name the faces of the minus and of the plus side, the same way all over each joint."""
    outward = tetrahedra.zone_faces(zones)[first]
    vectors = tetrahedra.triangle_vectors(points, outward)
    upward = np.einsum("ij,ij->i", vectors, _main_normals(vectors, joint)[joint])
    n = len(joint)
    edges = outward[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2).astype(np.int64)
    low, high = edges.min(axis=1), edges.max(axis=1)
    owner = np.repeat(np.arange(n), 3)
    order = np.lexsort((owner, high, low, joint[owner]))
    key = np.column_stack([joint[owner], low, high])[order]
    starts = np.flatnonzero(np.r_[True, (np.diff(key, axis=0) != 0).any(axis=1)][: 3 * n])
    starts = starts[np.diff(starts, append=3 * n) == 2]
    one, other = order[starts], order[starts + 1]
    alike = edges[one, 0] != edges[other, 0]
    # Facets with both signs as vertices: a part of this graph is one consistent orientation.
    turned = np.where(alike, 0, n)
    heads = np.concatenate([owner[one], owner[one] + n])
    tails = np.concatenate([owner[other] + turned, owner[other] + n - turned])
    count, label = components(heads, tails, 2 * n)
    score = np.bincount(label, weights=np.concatenate([upward, -upward]), minlength=count)
    lead = score[label[:n]] - score[label[n:]]
    closed = np.abs(lead) < 1e-9 * np.abs(upward).sum()
    straight = np.where(closed, label[:n] <= label[n:], lead > 0.0)
    return np.where(straight, first, second), np.where(straight, second, first)


def _main_normals(vectors, joint):
    """Return the main direction (n_joints, 3) of each joint's area vectors, upward."""
    count = joint.max(initial=-1) + 1
    tensor = np.zeros((count, 3, 3))
    lengths = np.linalg.norm(vectors, axis=1)
    np.add.at(tensor, joint, vectors[:, :, None] * vectors[:, None, :] / lengths[:, None, None])
    main = np.linalg.eigh(tensor)[1][:, :, 2].round(9)
    leading = np.where(main[:, 2] != 0.0, main[:, 2], np.where(main[:, 1], main[:, 1], main[:, 0]))
    return main * np.sign(leading)[:, None]


def pair_nodes(points, zones, doubled, joint, minus, plus):
    """Pair the nodes of facing facets; each facet gives a third of its area to each pair.

    Parameters
    ----------
    points : (n_nodes, 3) float64, m
    zones, doubled : (n_zones, 4) int32, before and after the nodes were doubled
    joint : (n,) int64, joint of each facet
    minus, plus : (n,) int64, its faces ``4 zone + local``

    Returns
    -------
    joint, minus, plus : (n_contacts,) int64, nodes of the two sides
    normal : (n_contacts, 3) float64, unit, from minus to plus
    area : (n_contacts,) float64, m2
    """
    minus_node = doubled.ravel()[_sorted_corners(zones, minus)].ravel()
    plus_node = doubled.ravel()[_sorted_corners(zones, plus)].ravel()
    vectors = tetrahedra.triangle_vectors(points, tetrahedra.zone_faces(zones)[minus])
    keys = np.column_stack([joint.repeat(3), minus_node, plus_node])
    apart = minus_node != plus_node
    keys, area, normal = merge_pairs(keys[apart], vectors.repeat(3, axis=0)[apart] / 3.0)
    return keys[:, 0], keys[:, 1], keys[:, 2], normal, area


def merge_pairs(keys, vectors):
    """Add area vectors (n, 3) of equal keys (n, k) unless their directions differ too much."""
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
