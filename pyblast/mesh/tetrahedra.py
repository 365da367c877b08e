"""Geometry, topology and shape functions of linear and quadratic tetrahedra."""

from functools import cache
from math import factorial

import numpy as np
import scipy
from numpy.typing import ArrayLike

from ..errors import InputError

# Local nodes of the face opposite to each local node; outward for a positive volume.
FACES = np.array([[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]])
EDGES = np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]])


def volumes(points: np.ndarray, zones: np.ndarray) -> np.ndarray:
    """Return the signed volumes (n_zones,) in m3."""
    a, b, c, d = (points[zones[:, k]] for k in range(4))
    return np.einsum("ij,ij->i", b - a, np.cross(c - a, d - a)) / 6.0


def triangle_vectors(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Return the area vectors (n, 3) in m2: half the cross product of two sides."""
    a, b, c = (points[triangles[:, k]] for k in range(3))
    return 0.5 * np.cross(b - a, c - a)


def edge_lengths(points: np.ndarray, zones: np.ndarray) -> np.ndarray:
    """Return the six edge lengths of every zone, (n_zones, 6) in m."""
    ends = points[zones[:, EDGES]]
    return np.linalg.norm(ends[:, :, 0] - ends[:, :, 1], axis=2)


def altitudes(points: np.ndarray, zones: np.ndarray) -> np.ndarray:
    """Return the smallest altitude of every zone, (n_zones,) in m."""
    vectors = triangle_vectors(points, zones[:, FACES].reshape(-1, 3))
    largest = np.linalg.norm(vectors, axis=1).reshape(-1, 4).max(axis=1)
    return 3.0 * np.abs(volumes(points, zones)) / largest


def mean_ratio(points: np.ndarray, zones: np.ndarray) -> np.ndarray:
    """Return the mean ratio (n_zones,): 1 for a regular tetrahedron, 0 for a flat one.

    Notes
    -----
    ``12 (3 V)^(2/3) / sum of squared edges``: Liu & Joe (1994).
    """
    squares = (edge_lengths(points, zones) ** 2).sum(axis=1)
    return 12.0 * np.cbrt(3.0 * np.maximum(volumes(points, zones), 0.0)) ** 2 / squares


def barycentric(corners: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Return the weights (..., 4) of places (..., 3) in tetrahedra with corners (..., 4, 3)."""
    sides = np.swapaxes(corners[..., 1:, :] - corners[..., :1, :], -1, -2)
    rest = np.linalg.solve(sides, (places - corners[..., 0, :])[..., None])[..., 0]
    return np.concatenate([1.0 - rest.sum(axis=-1, keepdims=True), rest], axis=-1)


def _best_zone(points, zones, candidates, position):
    """Return the candidate with the largest smallest weight, and its weights."""
    weights = barycentric(points[zones[candidates]], position)
    best = np.argmax(weights.min(axis=-1))
    return candidates[best], weights[best]


def locate(
    points: np.ndarray, zones: np.ndarray, places: ArrayLike, tolerance: float | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return the zone that contains each position, and barycentric coordinates.

    Parameters
    ----------
    points : (n_nodes, 3) float64, m
    zones : (n_zones, 4) int32
    places : (n, 3) float64, m
    tolerance : float, m
        Largest distance of a position outside the mesh, which is then moved to the nearest zone.
        Default: a tenth of the mean edge of that zone.

    Returns
    -------
    zone : (n,) int64
    weights : (n, 4) float64, of the nodes of the zone, not negative, sum 1

    Raises
    ------
    InputError
        If a position lies farther outside than the tolerance.
    """
    places = np.atleast_2d(np.asarray(places, dtype=float))
    tree = scipy.spatial.KDTree(points[zones].mean(axis=1), leafsize=16)
    near = tree.query(places, k=min(40, len(zones)))[1].reshape(len(places), -1)
    zone, weights = np.empty(len(places), dtype=np.int64), np.empty((len(places), 4))
    for n, position in enumerate(places):
        zone[n], weights[n] = _best_zone(points, zones, near[n], position)
        if weights[n].min() < -1e-9:
            boxes = _zones_around(points, zones, position)
            candidates = np.union1d(near[n], boxes)
            zone[n], weights[n] = _best_zone(points, zones, candidates, position)
    weights = np.maximum(weights, 0.0)
    weights /= weights.sum(axis=1, keepdims=True)
    _refuse_outside(points, zones[zone], places, weights, tolerance)
    return zone, weights


def _zones_around(points, zones, position):
    """Return the zones (n,) whose bounding box holds the position."""
    inside = np.ones(len(zones), dtype=bool)
    for axis in range(3):
        values = points[:, axis][zones]
        inside &= (values.min(axis=1) <= position[axis]) & (values.max(axis=1) >= position[axis])
    return np.flatnonzero(inside)


def _refuse_outside(points, corners, places, weights, tolerance):
    """Raise InputError for the first position too far from the mesh."""
    nearest = np.einsum("ij,ijk->ik", weights, points[corners])
    distance = np.linalg.norm(nearest - places, axis=1)
    limit = 0.1 * edge_lengths(points, corners).mean(axis=1) if tolerance is None else tolerance
    outside = np.flatnonzero(distance > limit)
    if len(outside):
        x, y, z = places[outside[0]]
        raise InputError(
            f"point ({x:g}, {y:g}, {z:g}): must lie in the mesh, is about "
            f"{distance[outside[0]]:.1g} m outside; move it or enlarge the model"
        )


def shape_gradients(points: np.ndarray, zones: np.ndarray) -> np.ndarray:
    """Return the gradients of shape functions 2 to 4, (n_zones, 3, 3) 1/m, last axis x y z."""
    sides = points[zones[:, 1:]] - points[zones[:, :1]]
    return np.swapaxes(np.linalg.inv(sides), 1, 2)


# Basis of a quadratic zone as exponents (15, 4) of the barycentric coordinates: the coordinates,
# products of two on edges and of three on faces, and the product of all four.
POWERS = np.concatenate(
    [
        np.eye(4, dtype=int),
        np.eye(4, dtype=int)[EDGES].sum(axis=1),
        np.eye(4, dtype=int)[FACES].sum(axis=1),
        np.ones((1, 4), dtype=int),
    ]
)
# Barycentric coordinates (15, 4) of the nodes: corners, middles of edges, centroids.
NODES = POWERS / POWERS.sum(axis=1, keepdims=True)
# Fractions of a zone's volume (15,) and of a face's area (7,) lumped at a node; theory.md (2.37).
VOLUME_SHARE = 6.0 * np.repeat([17 / 5040, 2 / 315, 9 / 560, 16 / 315], [4, 6, 4, 1])
AREA_SHARE = 2.0 * np.repeat([1 / 40, 1 / 15, 9 / 40], [3, 3, 1])


def _face_nodes():
    """Return the nodes (4, 7) of each face: corners, then the edges 12 23 31 of these, centroid."""
    ends = np.stack([FACES, np.roll(FACES, -1, axis=1)], axis=2)
    keys = np.sort(ends, axis=2) @ [4, 1]
    edges = 4 + np.searchsorted(EDGES @ [4, 1], keys)
    return np.concatenate([FACES, edges, 10 + np.arange(4)[:, None]], axis=1)


FACE_NODES = _face_nodes()


def integral(powers: np.ndarray) -> np.ndarray:
    """Return the mean (n,) over a zone of products of barycentric coordinates, powers (n, 4)."""
    factorials = np.vectorize(factorial)
    return 6.0 * factorials(powers).prod(axis=-1) / factorials(powers.sum(axis=-1) + 3)


@cache
def _shape_table():
    """Return the coefficients (15, 15) of the shape functions, a row for each."""
    return np.linalg.inv(_products(NODES)).T


def _products(weights):
    """Return the 15 products (n, 15) at barycentric coordinates (n, 4)."""
    return np.prod(weights[:, None, :] ** POWERS, axis=2)


def shape_values(weights: np.ndarray) -> np.ndarray:
    """Return the shape functions (n, 15) at barycentric coordinates (n, 4)."""
    return _products(np.asarray(weights, dtype=float)) @ _shape_table().T


def shape_slopes(weights: np.ndarray) -> np.ndarray:
    """Return the derivatives (n, 15, 4) of the shape functions by the barycentric coordinates.

    The coordinates are taken as independent; multiply by their gradients.
    """
    weights = np.asarray(weights, dtype=float)
    slopes = np.empty((len(weights), len(POWERS), 4))
    for axis in range(4):
        lower = np.maximum(POWERS - np.eye(4, dtype=int)[axis], 0)
        slopes[:, :, axis] = POWERS[:, axis] * np.prod(weights[:, None, :] ** lower, axis=2)
    return np.einsum("ab,nbi->nai", _shape_table(), slopes)


@cache
def mean_slopes() -> np.ndarray:
    """Return the means (1, 15, 4) over a zone of the slopes of the shape functions."""
    return corner_slopes().sum(axis=0)[None]


@cache
def corner_slopes() -> np.ndarray:
    """Return the means (4, 15, 4) over a zone of each coordinate times the slopes."""
    return product_slopes(np.eye(4, dtype=int))


def product_slopes(powers: np.ndarray) -> np.ndarray:
    """Return the means (n, 15, 4) over a zone of products, powers (n, 4), times the slopes."""
    slopes, unit = np.zeros((len(powers), len(POWERS), 4)), np.eye(4, dtype=int)
    for number, axis in np.ndindex(len(powers), 4):
        lower = np.maximum(POWERS - unit[axis], 0) + powers[number]
        slopes[number, :, axis] = POWERS[:, axis] * integral(lower)
    return _shape_table() @ slopes
