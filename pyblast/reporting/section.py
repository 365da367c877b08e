"""Vertical sections and outer faces of a mesh, as polygons to draw."""

import numpy as np

from ..meshing import tetrahedra

_TRIANGLE_EDGES = np.array([[0, 1], [1, 2], [2, 0]])
NUDGE = 1.2345e-5


def section_of_zones(points, zones, place):
    """Cut zones with the plane ``y = place``.

    Parameters
    ----------
    points : (n_nodes, 3) float64, m
    zones : (n_zones, 4) int32
    place : float, m

    Returns
    -------
    polygons : list of (3 or 4, 2) float64, m
        East and up, in turn around the polygon.
    zone : (n_polygons,) int64
    """
    height = _heights(points, place)
    below = height[zones] < 0.0
    cut = np.flatnonzero(below.any(axis=1) & ~below.all(axis=1))
    corners, crossed = _crossings(points, height, zones[cut], tetrahedra.EDGES)
    polygons = []
    for row in range(len(cut)):
        corner = corners[row][crossed[row]]
        around = corner - corner.mean(axis=0)
        polygons.append(corner[np.argsort(np.arctan2(around[:, 1], around[:, 0]))])
    return polygons, cut


def section_of_surface(points, triangles, place):
    """Cut triangles with the plane ``y = place``; return segments (n, 2, 2) m, east and up."""
    height = _heights(points, place)
    below = height[triangles] < 0.0
    cut = np.flatnonzero(below.any(axis=1) & ~below.all(axis=1))
    corners, crossed = _crossings(points, height, triangles[cut], _TRIANGLE_EDGES)
    return corners[crossed].reshape(-1, 2, 2)


def _heights(points, place):
    """Return the distance of nodes from the plane, which is moved a little off grid planes."""
    return points[:, 1] - place - NUDGE * max(float(np.ptp(points[:, 1])), 1.0)


def _crossings(points, height, cells, edges):
    """Return where the edges of cells cross the plane, (n, n_edges, 2), and which do."""
    first, second = cells[:, edges[:, 0]], cells[:, edges[:, 1]]
    crossed = (height[first] < 0.0) != (height[second] < 0.0)
    span = np.where(crossed, height[first] - height[second], 1.0)
    share = (height[first] / span)[..., None]
    places = points[first] + share * (points[second] - points[first])
    return places[..., [0, 2]], crossed


def outer_triangles(zones, n_nodes, surfaces):
    """Return triangles of named surfaces and the zone behind each.

    Parameters
    ----------
    zones : (n_zones, 4) int32
    n_nodes : int
    surfaces : sequence of (n, 3) int32

    Returns
    -------
    triangles : (n, 3) int32
    zone : (n,) int64
    """
    triangles = np.concatenate([np.empty((0, 3), np.int32), *surfaces])
    faces = tetrahedra.zone_faces(zones)
    keys = tetrahedra.face_keys(faces, n_nodes)
    order = np.argsort(keys)
    wanted = tetrahedra.face_keys(triangles, n_nodes)
    at = np.minimum(np.searchsorted(keys, wanted, sorter=order), len(keys) - 1)
    return triangles, order[at] // 4
