"""The quadratic tetrahedron with 15 nodes whose mass is lumped without loss of order."""

from functools import cache
from math import factorial

import numpy as np

from .tetrahedra import EDGES, FACES

# Products of barycentric coordinates that span the motion of a zone, as exponents (15, 4): the
# coordinates, their products of two on edges and of three on faces, and the product of all four.
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
# Share of a zone's volume (15,) and of a face's area (7,) that a node stands for; theory.md (2.37).
VOLUME_SHARE = 6.0 * np.repeat([17 / 5040, 2 / 315, 9 / 560, 16 / 315], [4, 6, 4, 1])
AREA_SHARE = 2.0 * np.repeat([1 / 40, 1 / 15, 9 / 40], [3, 3, 1])


def _face_nodes():
    """Return the nodes (4, 7) of each face: corners, then the edges 12 23 31 of these, centroid."""
    ends = np.stack([FACES, np.roll(FACES, -1, axis=1)], axis=2)
    keys = np.sort(ends, axis=2) @ [4, 1]
    edges = 4 + np.searchsorted(EDGES @ [4, 1], keys)
    return np.concatenate([FACES, edges, 10 + np.arange(4)[:, None]], axis=1)


FACE_NODES = _face_nodes()


def integral(powers):
    """Return the mean (n,) over a zone of products of barycentric coordinates, powers (n, 4)."""
    one = np.vectorize(factorial)
    return 6.0 * one(powers).prod(axis=-1) / one(powers.sum(axis=-1) + 3)


@cache
def _shape_table():
    """Return the coefficients (15, 15) of the shape functions, a row for each."""
    return np.linalg.inv(_products(NODES)).T


def _products(weights):
    """Return the 15 products (n, 15) at barycentric coordinates (n, 4)."""
    return np.prod(weights[:, None, :] ** POWERS, axis=2)


def shape_values(weights):
    """Return the shape functions (n, 15) at barycentric coordinates (n, 4)."""
    return _products(np.asarray(weights, dtype=float)) @ _shape_table().T


def shape_slopes(weights):
    """Return their derivatives (n, 15, 4) by each barycentric coordinate, as if all were free.

    Only differences between the four have a meaning: multiply by the gradients of the coordinates.
    """
    weights = np.asarray(weights, dtype=float)
    slopes = np.empty((len(weights), len(POWERS), 4))
    for axis in range(4):
        lower = np.maximum(POWERS - np.eye(4, dtype=int)[axis], 0)
        slopes[:, :, axis] = POWERS[:, axis] * np.prod(weights[:, None, :] ** lower, axis=2)
    return np.einsum("ab,nbi->nai", _shape_table(), slopes)


@cache
def mean_slopes():
    """Return the means (1, 15, 4) over a zone of the slopes of the shape functions."""
    return corner_slopes().sum(axis=0)[None]


@cache
def corner_slopes():
    """Return the means (4, 15, 4) over a zone of each coordinate times the slopes."""
    slopes, one = np.zeros((4, len(POWERS), 4)), np.eye(4, dtype=int)
    for corner, axis in np.ndindex(4, 4):
        lower = np.maximum(POWERS - one[axis], 0) + one[corner]
        slopes[corner, :, axis] = POWERS[:, axis] * integral(lower)
    return _shape_table() @ slopes


@cache
def stiffness_table():
    """Return the means (4, 4, 15, 15) over a zone of products of the slopes of two functions.

    Notes
    -----
    Exact. With the gradients g of the coordinates, a scalar Laplacian has the stiffness
    ``V sum_ij g_i.g_j K_ij``.
    """
    table = np.zeros((4, 4, len(POWERS), len(POWERS)))
    for i, j in np.ndindex(4, 4):
        lower = [np.maximum(POWERS - np.eye(4, dtype=int)[axis], 0) for axis in (i, j)]
        mean = integral(lower[0][:, None, :] + lower[1][None, :, :])
        table[i, j] = POWERS[:, None, i] * POWERS[None, :, j] * mean
    shape = _shape_table()
    return np.einsum("ab,ijbc,dc->ijad", shape, table, shape)
