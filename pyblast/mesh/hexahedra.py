"""Spectral hexahedra: nodes, shape functions, geometry, location, and their absorbing layer.

The reference zone is the cube of coordinates -1 to 1. Corner ``c`` lies at the upper end of axis
``k`` where bit ``k`` of ``c`` is set; node ``i + n (j + n k)`` of order ``n - 1`` at the i-th, j-th
and k-th Gauss-Lobatto-Legendre point of the three axes. Equations: theory.md (2.44) to (2.47).
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.polynomial import Legendre
from numpy.typing import ArrayLike

from ..errors import InputError

ORDERS = range(2, 9)
N_FACES = 6
# Corners of the faces, outward, at the lower and the upper end of the three axes.
FACES = np.array(
    [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]]
)
_NEWTON_STEPS = 50
_OUTSIDE = 0.1  # of the distance of nodes, by which a place may lie outside
_NEAREST = 8  # zones that are tried for a place in none
_TOGETHER = 64  # places at once, for the memory they need


@cache
def lobatto(order: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the Gauss-Lobatto-Legendre points (order + 1,) and weights of -1 to 1."""
    legendre = Legendre.basis(order)
    inner = np.sort(np.real(legendre.deriv().roots()))
    points = np.concatenate([[-1.0], 0.5 * (inner - inner[::-1]), [1.0]])
    weights = 2.0 / (order * (order + 1) * legendre(points) ** 2)
    return points, weights


@cache
def slopes_on_line(order: int) -> np.ndarray:
    """Return the derivatives (node, function) of the Lagrange functions at their points."""
    points, _ = lobatto(order)
    value = Legendre.basis(order)(points)
    apart = points[:, None] - points[None, :] + np.eye(order + 1)
    slope = value[:, None] / value[None, :] / apart
    np.fill_diagonal(slope, 0.0)
    slope[0, 0], slope[-1, -1] = -0.25 * order * (order + 1), 0.25 * order * (order + 1)
    return slope


def line_values(order: int, places: np.ndarray) -> np.ndarray:
    """Return the Lagrange functions (..., order + 1) at reference coordinates (...)."""
    points, _ = lobatto(order)
    own = np.eye(order + 1, dtype=bool)
    apart = np.asarray(places, dtype=float)[..., None, None] - points
    factors = apart / np.where(own, 1.0, points[:, None] - points)
    return np.prod(np.where(own, 1.0, factors), axis=-1)


def line_slopes(order: int, places: np.ndarray) -> np.ndarray:
    """Return the derivatives (..., order + 1) of the Lagrange functions at coordinates (...)."""
    return line_values(order, places) @ slopes_on_line(order)


def shape_values(order: int, places: np.ndarray) -> np.ndarray:
    """Return the shape functions (n, (order + 1)^3) at reference coordinates (n, 3)."""
    x, y, z = np.moveaxis(line_values(order, places), 1, 0)
    return np.einsum("ni,nj,nk->nkji", x, y, z).reshape(len(x), -1)


def shape_slopes(order: int, places: np.ndarray) -> np.ndarray:
    """Return the derivatives (n, (order + 1)^3, 3) of shape functions by reference coordinates."""
    values = np.moveaxis(line_values(order, places), 1, 0)
    slopes = np.moveaxis(line_slopes(order, places), 1, 0)
    parts = []
    for axis in range(3):
        x, y, z = (slopes[k] if k == axis else values[k] for k in range(3))
        parts.append(np.einsum("ni,nj,nk->nkji", x, y, z).reshape(len(x), -1))
    return np.stack(parts, axis=-1)


def face_shapes(order: int, at: np.ndarray) -> np.ndarray:
    """Return the shape functions ((order + 1)^2,) of a face at reference coordinates (2,)."""
    x, y = line_values(order, at)
    return np.outer(y, x).ravel()


def face_slopes(order: int, at: np.ndarray) -> np.ndarray:
    """Return the derivatives ((order + 1)^2, 2) of `face_shapes` by the reference coordinates."""
    (x, y), (dx, dy) = line_values(order, at), line_slopes(order, at)
    return np.stack([np.outer(y, dx).ravel(), np.outer(dy, x).ravel()], axis=1)


@cache
def reference_nodes(order: int) -> np.ndarray:
    """Return the reference coordinates ((order + 1)^3, 3) of the nodes."""
    points, _ = lobatto(order)
    z, y, x = np.meshgrid(points, points, points, indexing="ij")
    return np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1)


@cache
def face_nodes(order: int) -> np.ndarray:
    """Return the nodes (6, order + 1, order + 1) of the faces, from their first corner on.

    The first axis runs from the first corner towards the second, the last towards the fourth.
    """
    n = order + 1
    number = np.arange(n**3).reshape(n, n, n).transpose(2, 1, 0)  # by i, j, k
    faces = []
    for corners in FACES:
        start, right, _, up = (np.array([c >> k & 1 for k in range(3)]) for c in corners)
        line = np.arange(n)
        index = start * order + (
            (right - start) * line[:, None, None] + (up - start) * line[None, :, None]
        )
        faces.append(number[index[..., 0], index[..., 1], index[..., 2]])
    return np.array(faces)


def zone_nodes_places(points: np.ndarray, zones: np.ndarray, order: int) -> np.ndarray:
    """Return the positions (n_zones, (order + 1)^3, 3) of nodes between the corners of zones, m."""
    return shape_values(1, reference_nodes(order)) @ points[zones]


def jacobians(places: np.ndarray, order: int) -> np.ndarray:
    """Return dx/d(reference) (n_zones, (order + 1)^3, 3, 3) at the nodes; last axis: reference."""
    n, slope = order + 1, slopes_on_line(order)
    grid = places.reshape(-1, n, n, n, 3)
    parts = [
        np.einsum("iq,zkjqc->zkjic", slope, grid),
        np.einsum("jq,zkqic->zkjic", slope, grid),
        np.einsum("kq,zqjic->zkjic", slope, grid),
    ]
    return np.stack(parts, axis=-1).reshape(len(grid), n**3, 3, 3)


@cache
def node_weights(order: int) -> np.ndarray:
    """Return the quadrature weights ((order + 1)^3,) of the nodes; their sum is 8."""
    _, w = lobatto(order)
    return np.einsum("k,j,i->kji", w, w, w).ravel()


def corner_neighbours(zones: np.ndarray) -> np.ndarray:
    """Return each corner of hexahedra (n, 8) with its three neighbours, right-handed, (8 n, 4)."""
    table = np.array([[c, c ^ 1, c ^ 2, c ^ 4] for c in range(8)])
    odd = np.array([c.bit_count() % 2 == 1 for c in range(8)])
    table[odd] = table[odd][:, [0, 2, 1, 3]]
    return zones[:, table].reshape(-1, 4)


def quadrilateral_vectors(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return the area vectors (n, 3) in m2 of quadrilaterals (n, 4)."""
    a, b, c, d = (points[faces[:, k]] for k in range(4))
    return 0.5 * np.cross(c - a, d - b)


def volumes(points: np.ndarray, zones: np.ndarray) -> np.ndarray:
    """Return the volumes (n_zones,) in m3 of zones with straight edges."""
    jacobian = jacobians(zone_nodes_places(points, zones, 2), 2)
    return np.linalg.det(jacobian) @ node_weights(2)


EDGES = np.array(
    [[0, 1], [2, 3], [4, 5], [6, 7], [0, 2], [1, 3], [4, 6], [5, 7], [0, 4], [1, 5], [2, 6], [3, 7]]
)


def edge_lengths(points: np.ndarray, zones: np.ndarray) -> np.ndarray:
    """Return the twelve edge lengths of every zone, (n_zones, 12) in m."""
    ends = points[zones[:, EDGES]]
    return np.linalg.norm(ends[:, :, 0] - ends[:, :, 1], axis=2)


def zone_limits(places_of_zones: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the lowest and the highest coordinates (n_zones, 3) of the nodes of zones, in m."""
    return places_of_zones.min(axis=1), places_of_zones.max(axis=1)


def locate(
    places_of_zones: np.ndarray,
    order: int,
    places: ArrayLike,
    tolerance: float | None = None,
    limits: tuple[np.ndarray, np.ndarray] | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the zone that contains each place, and its reference coordinates.

    Parameters
    ----------
    places_of_zones : (n_zones, (order + 1)^3, 3) float64, m
        Positions of the nodes of all zones.
    order : int
        Of the geometry.
    places : (n, 3) float64, m
    tolerance : float, m
        Largest distance of a place outside the mesh, which is then moved to the nearest zone.
        Default: a tenth of the mean distance of the nodes of that zone.
    limits : tuple of 2 (n_zones, 3) float64, m
        `zone_limits` of the zones, if known.

    Returns
    -------
    zone : (n,) int64
    coordinates : (n, 3) float64, -1 to 1

    Raises
    ------
    InputError
        If a place lies farther outside than the tolerance.
    """
    places = np.atleast_2d(np.asarray(places, dtype=float))
    low, high = zone_limits(places_of_zones) if limits is None else limits
    zone, coordinates = np.empty(len(places), dtype=np.int64), np.empty((len(places), 3))
    for first in range(0, len(places), _TOGETHER):
        chunk = slice(first, first + _TOGETHER)
        zone[chunk], coordinates[chunk] = _nearest(places_of_zones, order, places[chunk], low, high)
    _refuse_outside(places_of_zones[zone], order, places, coordinates, tolerance)
    return zone, coordinates


def _nearest(places_of_zones, order, places, low, high):
    """Return the zone (n,) that holds each place, or the nearest, and reference coordinates."""
    near = [_near_zones(point, low, high) for point in places]
    owner = np.repeat(np.arange(len(places)), [len(zones) for zones in near])
    tried = np.concatenate(near)
    local, excess = reference_coordinates(places_of_zones[tried], order, places[owner])
    ranked = np.lexsort((excess.round(9), owner))
    best = ranked[np.searchsorted(owner, np.arange(len(places)))]
    return tried[best], np.clip(local[best], -1.0, 1.0)


def _near_zones(point, low, high):
    """Return the zones whose limits, 5 % wider, hold a point; else the `_NEAREST` to it."""
    margin = 0.05 * (high - low)
    inside = ((point >= low - margin) & (point <= high + margin)).all(axis=1)
    if inside.any():
        return np.flatnonzero(inside)
    beside = np.linalg.norm(np.maximum(np.maximum(low - point, point - high), 0.0), axis=1)
    return np.argsort(beside, kind="stable")[:_NEAREST]


def reference_coordinates(nodes, order, points):
    """Return the reference coordinates (n, 3) of places in zones by Newton, and their excess."""
    x = np.zeros((len(nodes), 3))
    for _ in range(_NEWTON_STEPS):
        value = np.einsum("na,nac->nc", shape_values(order, x), nodes)
        slope = np.einsum("nar,nac->ncr", shape_slopes(order, x), nodes)
        step = np.linalg.solve(slope, (points - value)[..., None])[..., 0]
        before, x = x, np.clip(x + step, -1.5, 1.5)
        if np.abs(step).max() < 1e-13 or np.array_equal(x, before):
            break
    return x, np.maximum(np.abs(x).max(axis=1) - 1.0, 0.0)


def _refuse_outside(nodes, order, places, coordinates, tolerance):
    """Raise InputError for the first place too far from the mesh."""
    nearest = np.einsum("na,nac->nc", shape_values(order, coordinates), nodes)
    distance = np.linalg.norm(nearest - places, axis=1)
    diagonal = np.linalg.norm(np.ptp(nodes, axis=1), axis=1)
    limit = _OUTSIDE * diagonal / np.sqrt(3.0) / order if tolerance is None else tolerance
    outside = np.flatnonzero(distance > limit)
    if len(outside):
        x, y, z = places[outside[0]]
        raise InputError(
            f"point ({x:g}, {y:g}, {z:g}): must lie in the mesh, is about "
            f"{distance[outside[0]]:.1g} m outside; move it or enlarge the model"
        )


LOWEST = 3.0  # Hz, that an absorbing layer is made for


@dataclass(frozen=True, eq=False)
class AbsorbingLayer:
    """Absorbing layer: ground around a model of hexahedra that sends back next to nothing.

    A matched layer with complex frequency-shifted stretch in second-order form: below 0.5 % of the
    energy up to 80 degrees from the normal, at all frequencies. Two elements are wide enough, three
    where cp/cs exceeds 4. Behind it the sides are viscous, for motion that never ends.

    Parameters
    ----------
    inner : ((x0, x1), (y0, y1), (z0, z1)), m
        The model without the layer, along the axes of ``frame``; infinite where there is no layer.
    width : ((x0, x1), (y0, y1), (z0, z1)), m
        Of the layer at these sides.
    frame : (3, 3) float64
        Unit vectors of the axes, row by row.
    lowest : float, Hz
        Lowest frequency of interest.

    Raises
    ------
    InputError
        If a limit does not ascend, a width is not positive, or the frame is not orthonormal.

    Notes
    -----
    theory.md (4.14) to (4.18).
    """

    inner: tuple[tuple[float, float], ...]
    width: tuple[tuple[float, float], ...]
    frame: tuple[tuple[float, float, float], ...] = ((1, 0, 0), (0, 1, 0), (0, 0, 1))
    lowest: float = LOWEST

    def __post_init__(self) -> None:
        """Check limits, widths, frame and frequency."""
        inner, width = np.array(self.inner, dtype=float), np.array(self.width, dtype=float)
        frame = np.array(self.frame, dtype=float)
        if inner.shape != (3, 2) or not (inner[:, 0] < inner[:, 1]).all():
            raise InputError(f"layer.inner: must be three ascending pairs, got {self.inner}")
        if width.shape != (3, 2) or not (width > 0.0).all():
            raise InputError(f"layer.width: must be three positive pairs, got {self.width}")
        if frame.shape != (3, 3) or np.abs(frame @ frame.T - np.eye(3)).max() > 1e-9:
            raise InputError(f"layer.frame: must be orthogonal unit vectors, got {self.frame}")
        if not 0.0 < self.lowest < np.inf:
            raise InputError(f"layer.lowest: must be positive, got {self.lowest:g} Hz")

    def depths(self, places: np.ndarray) -> np.ndarray:
        """Return the depth (..., 3) of places (..., 3) in the layer over its width, by axis."""
        inner, width = np.array(self.inner, dtype=float), np.array(self.width, dtype=float)
        along = places @ np.array(self.frame, dtype=float).T
        below, above = (inner[:, 0] - along) / width[:, 0], (along - inner[:, 1]) / width[:, 1]
        return np.clip(np.maximum(below, above), 0.0, 1.0)

    def widths(self, places: np.ndarray) -> np.ndarray:
        """Return the width (..., 3) in m of the layer on the side of places (..., 3), by axis."""
        inner, width = np.array(self.inner, dtype=float), np.array(self.width, dtype=float)
        along = places @ np.array(self.frame, dtype=float).T
        return np.where(along < inner[:, 0], width[:, 0], width[:, 1])
