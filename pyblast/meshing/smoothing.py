"""Repair of thin zones: nodes slide within the faces and along the lines that they lie on."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array

from . import tetrahedra

# Zones whose smallest altitude is below this share of their longest edge.
THIN = 0.35
SLIVER = 0.1
_SWEEPS = 8
_SETTLED = 0.05  # share of the nodes that still moved in the last sweep
_STEPS = (0.3, 0.1, 0.03)  # tried in turn, over the smallest altitude of a node
_GAIN = 1e-3
_PARALLEL = 1e-9
_FLAT = 1e-12


@dataclass(frozen=True, eq=False)
class _Colour:
    """Nodes that share no zone, and the zones around them.

    Parameters
    ----------
    nodes : (n,) int64
    zone, local, owner : (m,) int64
        A zone, which of its corners the node is, and the row of the node in ``nodes``.
    """

    nodes: np.ndarray
    zone: np.ndarray
    local: np.ndarray
    owner: np.ndarray


def thinness(points, zones):
    """Return the smallest altitude over the longest edge, (n_zones,): 0.82 if regular."""
    return tetrahedra.altitudes(points, zones) / tetrahedra.edge_lengths(points, zones).max(axis=1)


def free_ways(points, patches):
    """Return the projectors (n_nodes, 3, 3) on the ways that keep nodes on patches and borders.

    Parameters
    ----------
    points : (n_nodes, 3) float64, m
    patches : sequence of (n, 3) int64
        Triangles of one plane each, with straight borders.
    """
    triangles = np.concatenate(patches)
    patch = np.repeat(np.arange(len(patches)), [len(part) for part in patches])
    normal = np.zeros((len(patches), 3))
    np.add.at(normal, patch, tetrahedra.triangle_vectors(points, triangles))
    normal /= np.maximum(np.linalg.norm(normal, axis=1), np.finfo(float).tiny)[:, None]
    held = np.zeros((len(points), 3, 3))
    across = normal[:, :, None] * normal[:, None]
    np.add.at(held, triangles, across[patch][:, None])
    border = _borders(triangles, patch)
    along = points[border[:, 1]] - points[border[:, 0]]
    along /= np.linalg.norm(along, axis=1)[:, None]
    beside = np.eye(3) - along[:, :, None] * along[:, None]
    np.add.at(held, border, beside[:, None])
    values, vectors = np.linalg.eigh(held)
    free = (values < _PARALLEL)[:, None, :] * vectors
    return np.einsum("nik,njk->nij", free, vectors)


def _borders(triangles, patch):
    """Return the edges (n, 2) of triangles that no other triangle of their patch has."""
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]], axis=2).reshape(-1, 2)
    keys = np.column_stack([np.repeat(patch, 3), edges])
    found, count = np.unique(keys, axis=0, return_counts=True)
    return found[count == 1, 1:]


def smoothed(points, zones, patches):
    """Return points (n_nodes, 3) at which thin zones are thicker; no patch is bent or moved.

    Parameters
    ----------
    points : (n_nodes, 3) float64, m
    zones : (n_zones, 4) int64, of positive volume
    patches : sequence of (n, 3) int64
        Triangles of each flat piece of a joint, a layer or a side.

    Notes
    -----
    Nodes of thin zones take turns in going down ``sum of V0 (sum |g|^2)^2`` of the zones around
    them, V0 the volume at the start and g the gradients of the shape functions, |g| = 1/altitude:
    about the mass that a step far longer than that of these zones needs, theory.md (2.13).
    """
    points = points.copy()
    ways = free_ways(points, patches)
    thin = thinness(points, zones) < THIN
    movable = np.trace(ways, axis1=1, axis2=2) > 0.5
    nodes = np.unique(zones[thin])
    nodes = nodes[movable[nodes]]
    weight = tetrahedra.volumes(points, zones)
    colours = _colours(zones, nodes, len(points))
    for _ in range(_SWEEPS):
        moved = sum(_slide(points, zones, ways, weight, colour) for colour in colours)
        if moved <= _SETTLED * len(nodes):
            break
    return points


def _colours(zones, nodes, n_nodes):
    """Part nodes into sets within which no two share a zone; return them as `_Colour`."""
    chosen = np.zeros(n_nodes, dtype=bool)
    chosen[nodes] = True
    near = zones[chosen[zones].any(axis=1)]
    pairs = np.repeat(near, 4, axis=1).ravel(), np.tile(near, (1, 4)).ravel()
    table = coo_array((np.ones(len(pairs[0]), dtype=np.int8), pairs), (n_nodes, n_nodes)).tocsr()
    number = np.full(n_nodes, -1)
    for node in nodes:
        taken = set(number[table.indices[table.indptr[node] : table.indptr[node + 1]]].tolist())
        number[node] = next(k for k in range(len(taken) + 1) if k not in taken)
    corners = np.flatnonzero(number[zones.ravel()] >= 0)
    corner_node = zones.ravel()[corners]
    colours = []
    for k in range(number.max() + 1):
        mine = number[corner_node] == k
        found, owner = np.unique(corner_node[mine], return_inverse=True)
        colours.append(_Colour(found, corners[mine] // 4, corners[mine] % 4, owner))
    return colours


def _slide(points, zones, ways, weight, colour):
    """Move the nodes of a colour in place where that helps the zones around; count them."""
    count, rows = len(colour.nodes), np.arange(len(colour.zone))
    corners, weight = points[zones[colour.zone]], weight[colour.zone]
    sharpness, gradients = _sharpness(corners)
    own = gradients[rows, colour.local]
    turned = np.einsum("zai,za->zi", gradients, np.einsum("zai,zi->za", gradients, own))
    downhill = np.zeros((count, 3))
    pull = np.where(np.isfinite(sharpness), weight * sharpness, weight)
    np.add.at(downhill, colour.owner, pull[:, None] * turned)
    downhill = np.einsum("nij,nj->ni", ways[colour.nodes], downhill)
    reach = np.full(count, np.inf)
    np.minimum.at(reach, colour.owner, 1.0 / np.linalg.norm(own, axis=1))
    length = np.maximum(np.linalg.norm(downhill, axis=1), np.finfo(float).tiny)
    downhill *= (1.0 / length)[:, None]
    downhill *= reach[:, None]
    before = np.bincount(colour.owner, weight * sharpness**2)
    waiting = np.ones(count, dtype=bool)
    for share in _STEPS:
        tried = corners.copy()
        tried[rows, colour.local] += share * downhill[colour.owner]
        after = np.bincount(colour.owner, weight * _sharpness(tried)[0] ** 2)
        better = waiting & (after < (1.0 - _GAIN) * before)
        points[colour.nodes[better]] += share * downhill[better]
        waiting &= ~better
    return count - np.count_nonzero(waiting)


def _sharpness(corners):
    """Return the sum of squared gradients (n,), infinite if inverted, and gradients (n, 4, 3)."""
    a, b, c = np.moveaxis(corners[:, 1:] - corners[:, :1], 1, 0)
    gradients = np.stack([np.zeros_like(a), np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=1)
    volume = np.einsum("zi,zi->z", a, gradients[:, 1])
    size = np.linalg.norm(corners[:, 1:] - corners[:, :1], axis=2).prod(axis=1)
    sound = volume > _FLAT * size
    gradients /= np.where(sound, volume, size)[:, None, None]
    gradients[:, 0] = -gradients[:, 1:].sum(axis=1)
    return np.where(sound, np.einsum("zai,zai->z", gradients, gradients), np.inf), gradients
