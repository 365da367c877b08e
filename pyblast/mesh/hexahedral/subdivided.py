"""Hexahedra by midpoint subdivision of tetrahedra.

For grounds that no grid serves. Each tetrahedron has one hexahedron per corner: the corner, the
middles of its edges, the centres of its faces, its own centre. Open sides, of which each triangle
gives three quadrilaterals, are drawn outward into the cells of the absorbing layer.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import scipy

from .. import hexahedra
from ..builder import build_mesh
from ..faces import face_keys, face_vectors
from ..grid import SIDES, Geometry
from ..mesh import Mesh
from ..quality import explicit_work
from .mapped import (
    SAME,
    Fine,
    Sizes,
    Surface,
    between_zones,
    edge_pairs,
    layer_beside,
    layer_cells,
    least_edge,
)
from .planes import NotMapped
from .swept import sliding, smoothed_quadrilaterals, upright

EDGES = np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]])  # of a tetrahedron
OPPOSITE = np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]])  # corners of its faces
ORDERS = (2, 3, 4)
TWICE = 2.0  # edge of tetrahedra over that of their hexahedra
RELIEF = 0.1  # over that, of the facets that are cut to the survey, before nodes are raised to it
RAISES, SPREADS = 5, 60  # Newton steps of nodes of the surface, and of the nodes below
LEAST_VOLUME, RETREATS = 0.3, 12  # of corners, over that before; halvings of the move to keep it
LEAST_RISE = 0.05  # of a node along its planes, to leave a surface
POOR = 0.03  # share of zones that are smoothed with their neighbours
TRIALS = (1.0, 0.93, 0.86, 0.8)  # factors on the edges, until no sliver sets the step
GOOD = 30.0  # work times the wanted edge over the nodes; 4 for cubes of order 3
FAIR = 150.0  # the same where another trial has not lowered the work
WORSE = 2.0  # work of another trial over the least before, after which none is made
POWERS, ITERATIONS = (4, 16), 60  # lengthens the step by half


def build_subdivided(
    geometry: Geometry, sizes: Sizes, order: int, lines: Sequence[Fine] | None = None
) -> Mesh:
    """Build hexahedra of order 2 to 4 from tetrahedra, as a `mapped.Builder`."""
    if order not in ORDERS:
        raise NotMapped(f"tetrahedra are cut into hexahedra of order 2 to 4, not {order}")
    if len(geometry.depths) or geometry.fills:
        raise NotMapped("tetrahedra are not cut along fills and layers that follow the surface")
    meshes, thick = [], np.diff(-geometry.limits)
    edges = [least_edge([size], thick[k : k + 1]) for k, size in enumerate(edge_pairs(sizes))]
    for factor in TRIALS:
        mesh = _cut(geometry, [factor * edge for edge in edges], order, lines)
        work, best = explicit_work(mesh), min((each[0] for each in meshes), default=np.inf)
        meshes.append((work, factor, mesh))
        cubes = len(mesh.zones) * order**3 / factor / min(edges)
        if work < GOOD * cubes or best <= work < FAIR * cubes or work > WORSE * best:
            break
    return min(meshes, key=lambda each: each[0])[2]


def _cut(geometry, sizes, order, lines):
    """Return the mesh of hexahedra with given edges of each layer."""
    edge = TWICE * float(min(sizes))
    layers = [
        replace(layer, edge=TWICE * size)
        for layer, size in zip(geometry.layers, sizes, strict=True)
    ]
    cut = build_mesh(
        geometry.box, layers, geometry.joint_sets, geometry.faults, edge=edge,
        surface=geometry.surface, tolerance=SAME * edge,
        refinements=[(part.box, TWICE * part.edge) for part in lines or ()],
        relief=RELIEF * float(min(sizes)),
    )  # fmt: skip
    points, zones, surfaces = subdivide(cut)
    if geometry.surface is not None and np.ndim(geometry.surface) == 2:
        faces = _between_groups(zones, np.tile(cut.zone_group, 4), len(points))
        points = _raised(points, zones, surfaces, faces, Surface(geometry))
    points = _smoothed(points, zones, np.tile(cut.zone_group, 4), surfaces, edge)
    ends = {part.name for part in geometry.joint_sets}  # at the absorbing layer
    return _with_layer(geometry, cut, points, zones, surfaces, ends, min(sizes), order)


def subdivide(mesh: Mesh) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """Cut each tetrahedron of a mesh into four hexahedra.

    Returns
    -------
    points : (n, 3) float64, m
        Those of the mesh first.
    zones : (4 n_zones, 8) int64
        The first corner of every tetrahedron, then the second.
    surfaces : dict of str to (3 n_triangles, 4) int64
    """
    points, zones, n = mesh.points, mesh.zones.astype(np.int64), len(mesh.points)
    pairs = np.sort(zones[:, EDGES], axis=2)
    edges, edge_of = np.unique(pairs.reshape(-1, 2), axis=0, return_inverse=True)
    triples = zones[:, OPPOSITE].reshape(-1, 3)
    keys, first, face_of = np.unique(face_keys(triples, n), return_index=True, return_inverse=True)
    middle = np.empty((len(zones), 4, 4), dtype=np.int64)
    for (i, j), number in zip(EDGES, n + edge_of.reshape(-1, 6).T, strict=True):
        middle[:, i, j] = middle[:, j, i] = number
    face = n + len(edges) + face_of.reshape(-1, 4)
    centre = n + len(edges) + len(keys) + np.arange(len(zones))
    parts = []
    for v in range(4):
        a, b, c = OPPOSITE[v] if v % 2 == 0 else OPPOSITE[v][[1, 0, 2]]
        corner = (zones[:, v], middle[:, v, a], middle[:, v, b], face[:, c])
        beyond = (middle[:, v, c], face[:, b], face[:, a], centre)
        parts.append(np.stack([*corner, *beyond], axis=1))
    every = [points, points[edges].mean(axis=1), points[triples[first]].mean(axis=1)]
    every.append(points[zones].mean(axis=1))
    surfaces = {}
    line_keys = edges @ [n, 1]
    for name, triangles in mesh.surfaces.items():
        t = triangles.astype(np.int64)
        sides = np.sort(np.stack([t, np.roll(t, -1, axis=1)], axis=2), axis=2) @ [n, 1]
        m = n + np.searchsorted(line_keys, sides)
        f = n + len(edges) + np.searchsorted(keys, face_keys(t, n))
        quads = [np.stack([t[:, k], m[:, k], f, m[:, k - 1]], axis=1) for k in range(3)]
        surfaces[name] = np.concatenate(quads)
    return np.concatenate(every), np.concatenate(parts), surfaces


def _raised(points, zones, surfaces, between, ground):
    """Return points (n, 3), those of the top moved to a surface in the planes that they lie in."""
    n, top = len(points), np.unique(surfaces["top"])
    faces = np.concatenate([between, *(quads for s, quads in surfaces.items() if s != "top")])
    normals = face_vectors(points, faces)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    ends = [_ends(quads, n) for name, quads in surfaces.items() if name not in SIDES]
    outer = np.unique(np.concatenate([surfaces[side] for side in SIDES]))
    fixed = np.setdiff1d(np.concatenate([np.zeros(0, dtype=int), *ends]), outer)
    free, moved = sliding(n, faces, normals, fixed), points.copy()
    slope = np.ones((len(top), 3))
    for _ in range(RAISES):
        at, step = moved[top], 1e-3 * np.eye(2)
        for axis in (0, 1):
            apart = ground.height(at[:, :2] + step[axis]) - ground.height(at[:, :2] - step[axis])
            slope[:, axis] = -apart / 2e-3
        along = np.einsum("nij,nj->ni", free[top], slope)
        rise = np.einsum("ni,ni->n", along, slope)
        away = np.where(rise > LEAST_RISE, ground.height(at[:, :2]) - at[:, 2], 0.0)
        moved[top] += (away / np.maximum(rise, LEAST_RISE))[:, None] * along
    shift, lines = (
        moved - points,
        np.unique(np.sort(zones[:, hexahedra.EDGES].reshape(-1, 2), axis=1), axis=0),
    )
    graph = scipy.sparse.coo_array(
        (np.ones(2 * len(lines)), (lines.ravel(), lines[:, ::-1].ravel())), (n, n)
    ).tocsr()
    count = graph.sum(axis=1)[:, None]
    wanted = shift[top]
    for _ in range(SPREADS):
        shift = np.einsum("nij,nj->ni", free, graph @ shift / count)
        shift[top] = wanted
    corners = hexahedra.corner_neighbours(zones)
    least = LEAST_VOLUME * _volumes(points, corners)
    for _ in range(RETREATS):
        poor = (_volumes(points + shift, corners) < least).reshape(-1, 8).any(axis=1)
        shift[zones[poor]] *= 0.5
    return points + shift


def _volumes(points, corners):
    """Return the volumes (n,) in m3 that three edges of each corner span."""
    return np.linalg.det(points[corners[:, 1:]] - points[corners[:, :1]])


def _ends(quads, n):
    """Return the nodes of edges that only one of some quadrilaterals has."""
    lines = np.sort(np.stack([quads, np.roll(quads, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    keys, count = np.unique(lines @ [n, 1], return_counts=True)
    return np.concatenate([keys[count == 1] // n, keys[count == 1] % n])


def _smoothed(points, zones, group, surfaces, edge):
    """Return points (n, 3) of which the nodes of the poorest zones are moved within all faces."""
    faces = [quads for quads in surfaces.values() if len(quads)]
    between = _between_groups(zones, group, len(points))
    quads = np.concatenate([*faces, between])
    normals = face_vectors(points, quads)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    free = sliding(len(points), quads, normals)
    corners = hexahedra.corner_neighbours(zones)
    columns = (points[corners[:, 1:]] - points[corners[:, :1]]).transpose(0, 2, 1)
    stretch = np.linalg.svd(columns, compute_uv=False)[:, -1].reshape(-1, 8).min(axis=1)
    poor = np.zeros(len(points), dtype=bool)
    poor[zones[np.argsort(stretch)[: int(np.ceil(POOR * len(zones)))]]] = True
    free[~poor] = 0.0
    near = np.repeat(poor[zones].any(axis=1), 8)
    used, local = np.unique(corners[near], return_inverse=True)
    moved = points.copy()
    moved[used] = smoothed_quadrilaterals(
        points[used], local.reshape(-1, 4), free[used], 0.5 * edge, POWERS, ITERATIONS
    )
    return moved


def _between_groups(zones, group, n):
    """Return the faces (k, 4) between zones of different groups."""
    faces = zones[:, hexahedra.FACES].reshape(-1, 4)
    keys = face_keys(faces, n)
    order = np.argsort(keys, kind="stable")
    same = np.flatnonzero(np.diff(keys[order]) == 0)
    first, second = order[same], order[same + 1]
    return faces[first[group[first // 6] != group[second // 6]]]


def _with_layer(geometry, cut, points, zones, surfaces, ends, cell, order):
    """Return the mesh with the cells of the absorbing layer outside of open sides."""
    group, wide = np.tile(cut.zone_group, 4), layer_cells(order)
    opened = np.array([s in geometry.open_sides for s in SIDES]).reshape(3, 2)
    for number, side in enumerate(SIDES):  # later ones draw edges and corners, too
        if side not in geometry.open_sides:
            continue
        axis, sign = number // 2, 2 * (number % 2) - 1
        faces = surfaces[side]
        used, local = np.unique(faces, return_inverse=True)
        local = local.reshape(faces.shape)
        shift = sign * cell * np.eye(3)[axis]
        levels = [
            used,
            *(len(points) + k * len(used) + np.arange(len(used)) for k in range(wide)),
        ]
        fresh = [points[used] + (k + 1) * shift for k in range(wide)]
        owner = _owners(zones, faces, len(points))
        added = [
            np.concatenate([inner[local][:, [0, 1, 3, 2]], outer[local][:, [0, 1, 3, 2]]], axis=1)
            for inner, outer in pairwise(levels)
        ]
        for name, quads in surfaces.items():
            if name != side and name not in ends and len(quads):
                lines = _lines_on(quads, used)
                at = np.searchsorted(used, lines)
                drawn = [
                    np.column_stack([inner[at], outer[at][:, ::-1]])
                    for inner, outer in pairwise(levels)
                ]
                surfaces[name] = np.concatenate([quads, *drawn])
        surfaces[side] = levels[-1][local]
        points = np.concatenate([points, *fresh])
        zones = np.concatenate([zones, *added])
        group = np.concatenate([group, *[group[owner]] * wide])
    zones = _right_handed(points, zones)
    widths = np.full((3, 2), wide * cell)
    return Mesh(
        points, upright(points, zones, np.eye(3)), group, cut.groups,
        between_zones(surfaces, zones, len(points)),
        order=order, layer=layer_beside(opened, geometry.box, widths, np.eye(3)),
    )  # fmt: skip


def _owners(zones, faces, n):
    """Return the zone (k,) behind each outer face (k, 4)."""
    keys = face_keys(zones[:, hexahedra.FACES].reshape(-1, 4), n)
    order = np.argsort(keys, kind="stable")
    return order[np.searchsorted(keys, face_keys(faces, n), sorter=order)] // 6


def _lines_on(quads, nodes):
    """Return the edges (k, 2) of quadrilaterals with both ends among sorted nodes."""
    lines = np.sort(np.stack([quads, np.roll(quads, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    return np.unique(lines[np.isin(lines, nodes).all(axis=1)], axis=0)


def _right_handed(points, zones):
    """Return zones (n, 8) of which those of negative volume are mirrored."""
    columns = points[zones[:, [1, 2, 4]]] - points[zones[:, :1]]
    turned = np.linalg.det(columns) < 0.0
    zones[turned] = zones[turned][:, [1, 0, 3, 2, 5, 4, 7, 6]]
    return zones
