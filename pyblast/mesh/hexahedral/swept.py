"""Swept meshes: a quadrilateral section along one direction.

Serves every ground of which all planes either contain the direction of the sweep, and are traces in
the section, or stand at right angles to it. That direction is the vertical (upright planes of any
strikes, layers) or a horizontal strike (planes of any dips, crossing or not). The section is meshed
in four-sided elements that conform to all traces, then smoothed for the time step.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise, permutations, product

import numpy as np
from scipy.optimize import minimize

from .. import hexahedra
from ..gmsh import MeshingError, quadrilateral_areas, section_mesh
from ..grid import SIDES, Geometry
from ..mesh import Mesh
from ..quality import refuse_beyond_memory
from .mapped import (
    BYTES_PER_NODE,
    SAME,
    Fine,
    Sizes,
    Surface,
    between_zones,
    distinct_values,
    divided,
    edge_pairs,
    extent_along,
    layer_beside,
    layer_cells,
    least_edge,
    side_names,
)
from .planes import PARALLEL, NotMapped, Plane, planes_of

APART = 0.25  # of the thinnest layer or the spacing: largest distance of vertices that become one
TRIALS = 11  # positions of a side that may move, up to an edge outward
CROWDED = 0.5  # of an edge: shorter lines in the section count
POWERS = (2, 4, 8)  # of the norm that smoothing makes smallest
ITERATIONS = 60
UPRIGHT = 3.0  # weight of the third axis of a zone among its axes
TINY = 1e-6  # of the size of the section: distance of nodes that lie on a line


@dataclass(frozen=True, eq=False)
class _Trace:
    """Line in the section, with the plane that it is part of and its range on the sweep.

    Lines without a plane are boundaries of layers, and continue traces that end in the section.
    """

    ends: np.ndarray  # (2, 2)
    plane: Plane | None = None
    along: tuple[float, float] | None = None


def build_swept(
    geometry: Geometry, sizes: Sizes, order: int, lines: Sequence[Fine] | None = None
) -> Mesh:
    """Build a swept mesh, as a `mapped.Builder`."""
    planes, reasons = planes_of(geometry), []
    if geometry.fills:
        raise NotMapped("a fill is no part of a section that is swept")
    for frame in _frames(geometry, planes):
        if not _suits(planes, frame):
            continue
        try:
            edges = edge_pairs(sizes)
            return _Sweep(geometry, planes, edges, order, frame, lines).mesh()
        except (MeshingError, NotMapped) as reason:
            reasons.append(str(reason))
    lacks = "no direction lies in all of its planes or stands across them"
    raise NotMapped(reasons[0] if reasons else lacks)


def _frames(geometry, planes):
    """Return frames (3, 3) to try: two axes of the section, then the direction of the sweep.

    A ground that is turned by a quarter or mirrored has the section of the original.
    """
    x, y, z = np.eye(3)
    centre, size = geometry.box.mean(axis=1), np.ptp(geometry.box[:2], axis=1)
    leaning = [plane for plane in planes if PARALLEL < plane.normal[2] < 1.0 - PARALLEL]
    arrows = [plane.normal for plane in leaning]
    arrows += [((plane.point - centre) @ plane.normal) * plane.normal for plane in planes]
    arrows += [plane.point - centre for plane in planes if plane.extent is not None]
    arrows += [
        sign * axis
        for number, axis in ((0, x), (1, y))
        for side, sign in zip(SIDES[2 * number : 2 * number + 2], (-1.0, 1.0), strict=True)
        if side in geometry.open_sides
    ]

    def along(axis, other=None):
        """Return an axis in the sense of the first arrow that has one, or of a first product."""
        parts = [arrow @ axis for arrow in arrows]
        if other is not None:
            parts += [(plane.normal @ axis) * (plane.normal @ other) for plane in planes]
        return axis * next((np.sign(part) for part in parts if abs(part) > TINY), 1.0)

    frames = []
    if not leaning:
        wide = size[0] - size[1]
        if abs(wide) < TINY and planes:
            wide = abs(planes[0].normal[0]) - abs(planes[0].normal[1])
        first = along(x if wide >= 0.0 else y)
        second = along(y if wide >= 0.0 else x, first)
        frames.append(np.array([first, second, np.cross(first, second)]))
    sections = [x, y]
    if not set(SIDES[:4]) & geometry.standing:
        sections += [plane.normal * [1.0, 1.0, 0.0] for plane in leaning]
    for each in sections:
        first = along(each / np.linalg.norm(each))
        frames.append(np.array([first, z, np.cross(first, z)]))
    return frames


def _suits(planes, frame):
    """Tell whether each plane, and the extent of it, contains the sweep or stands across it."""
    sweep = frame[2]
    for plane in planes:
        along = abs(plane.normal @ sweep)
        if min(along, np.linalg.norm(np.cross(plane.normal, sweep))) > PARALLEL:
            return False
        askew = min(abs(plane.strike @ sweep), abs(plane.down @ sweep)) > PARALLEL
        if plane.extent is not None and along < PARALLEL and askew:
            return False
    return True


def arrangement(
    limits: np.ndarray, segments: np.ndarray, tolerance: float
) -> tuple[np.ndarray, list[list[int]]]:
    """Cut straight segments in a rectangle at each other; merge vertices that nearly coincide.

    Parameters
    ----------
    limits : (2, 2) float64, m
        Of the rectangle; no segment reaches beyond.
    segments : (n, 2, 2) float64, m
    tolerance : float, m
        Vertices nearer to each other become one, in the order corner of the rectangle, end on its
        boundary, crossing, end inside; vertices nearer to a segment lie on it.

    Returns
    -------
    vertices : (m, 2) float64, m
        The four corners of the rectangle first.
    chains : list of list of int
        Vertices of each segment, in order.
    """
    corners = np.array([[limits[0, i], limits[1, j]] for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))])
    ends = segments.reshape(-1, 2)
    crossings, owners = _crossings(segments)
    points = np.concatenate([corners, ends, crossings])
    near = np.abs(ends[:, :, None] - limits[None]).min(axis=(1, 2)) < 1e-9 * np.ptp(limits)
    rank = np.concatenate([np.zeros(4), np.where(near, 1, 3), np.full(len(crossings), 2)])
    target, heads = np.arange(len(points)), np.zeros(len(points), dtype=bool)
    for k in np.argsort(rank, kind="stable"):
        away = np.where(heads, np.hypot(*(points - points[k]).T), np.inf)
        close = np.flatnonzero(away < tolerance)
        if len(close):
            target[k] = close[np.lexsort((away[close], rank[close]))[0]]
        else:
            heads[k] = True
    for axis, end in product((0, 1), (0, 1)):
        beside = heads & (rank >= 2) & (np.abs(points[:, axis] - limits[axis, end]) < tolerance)
        points[beside, axis] = limits[axis, end]
    used = np.flatnonzero(heads)
    number = np.cumsum(heads) - 1
    chains = []
    for k, (first, second) in enumerate(segments):
        length = np.hypot(*(second - first))
        along = (points - first) @ (second - first) / length
        away = np.abs(_cross(points - first, (second - first) / length))
        own = {4 + 2 * k, 5 + 2 * k, *(4 + len(ends) + np.flatnonzero((owners == k).any(axis=1)))}
        on = {int(target[m]) for m in own}
        on |= {*used[((away < tolerance) & (along > 0.0) & (along < length))[used]].tolist()}
        chains.append([int(number[m]) for m in sorted(on, key=lambda m, a=along: a[m])])
    return points[used], chains


def _cross(a, b):
    """Return the cross product (...) of plane vectors (..., 2)."""
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def _crossings(segments):
    """Return the points (n, 2) where two segments meet, and the two segments (n, 2) of each."""
    first, second = np.triu_indices(len(segments), 1)
    start, step = segments[:, 0], segments[:, 1] - segments[:, 0]
    length = np.hypot(*step.T)
    sine = _cross(step[first], step[second])
    apart = start[second] - start[first]
    with np.errstate(divide="ignore", invalid="ignore"):
        s, t = _cross(apart, step[second]) / sine, _cross(apart, step[first]) / sine
    meet = np.abs(sine) > 1e-12 * length[first] * length[second]
    meet &= (s >= -1e-9) & (s <= 1.0 + 1e-9) & (t >= -1e-9) & (t <= 1.0 + 1e-9)
    at = start[first] + np.where(meet, s, 0.0)[:, None] * step[first]
    return at[meet], np.column_stack([first, second])[meet]


def _crowding(limits, segments, tolerance, edge):
    """Return the sum of (edge / length)^4 - 1 over the shorter lines of an arrangement."""
    vertices, chains = arrangement(limits, segments, tolerance)
    pairs = [pair for chain in chains for pair in pairwise(chain)]
    ends = np.array(pairs, dtype=int).reshape(-1, 2)
    lengths = [np.hypot(*(vertices[ends[:, 0]] - vertices[ends[:, 1]]).T)]
    used = vertices[np.unique([0, 1, 2, 3, *ends.ravel()])]
    for axis, end in product((0, 1), (0, 1)):
        on = np.abs(used[:, axis] - limits[axis, end]) < 1e-9 * np.ptp(limits)
        lengths.append(np.diff(np.sort(used[on, 1 - axis])))
    return float(np.sum((edge / np.minimum(np.concatenate(lengths), edge)) ** 4 - 1.0))


def _work(points, quads):
    """Return the number of quadrilaterals over about the least stretch of their corners, in 1/m."""
    a, b = (points[np.roll(quads, k, axis=1)] - points[quads] for k in (-1, 1))
    area = _cross(a, b)
    if not area.min() > 0.0:
        return np.inf
    return len(quads) * float(np.sqrt(((a**2 + b**2).sum(axis=-1) / area**2).max()))


def smoothed_quadrilaterals(
    points: np.ndarray,
    corners: np.ndarray,
    free: np.ndarray,
    edge: float,
    powers: Sequence[float] = POWERS,
    iterations: int = ITERATIONS,
) -> np.ndarray:
    """Return smoothed points (n, d) in m of quadrilaterals or hexahedra, for a longer time step.

    Parameters
    ----------
    points : (n, d) float64, m
    corners : (m, d + 1) int64
        A corner of an element and its neighbours there, right-handed.
    free : (n, d, d) float64
        Projections onto the directions in which nodes may move, of `sliding`.
    edge : float, m
    powers : sequence of float
        Of the norms that become smallest, one after the other.
    iterations : int
        At most, for each.

    Notes
    -----
    The p-norm of ``|J^-1|^2`` over all corners becomes smallest, where the columns of J are the
    edges of a corner: about one over the square of the least stretch of the mapping, which sets
    the step of an explicit scheme. Its slope is ``-2 J^-T J^-1 J^-T``.
    """
    n, d = points.shape
    base, ends = corners[:, 0], corners[:, 1:]
    moved = np.concatenate([ends.T.ravel(), base])

    def value(flat, power):
        at = points + np.einsum("nij,nj->ni", free, flat.reshape(n, d))
        volume, inverse = _inverse((at[ends] - at[base][:, None]).transpose(0, 2, 1) / edge)
        if volume.min() <= 0.0:
            return 1e300, np.zeros_like(flat)
        each = (inverse**2).sum(axis=(1, 2))
        scaled = (each / each.max()) ** power
        norm = each.max() * scaled.sum() ** (1.0 / power)
        weight = -2.0 * norm * scaled / scaled.sum() / each / edge
        turned = inverse.transpose(0, 2, 1)
        slopes = weight[:, None, None] * (turned @ inverse @ turned)
        parts = np.concatenate([*np.moveaxis(slopes, 2, 0), -slopes.sum(axis=2)])
        slope = np.stack([np.bincount(moved, part, minlength=n) for part in parts.T], axis=1)
        return norm, np.einsum("nij,nj->ni", free, slope).ravel()

    shift = np.zeros(points.size)
    if not free.any() or value(shift, powers[0])[0] >= 1e300:
        return points
    for power in powers:
        result = minimize(
            value, shift, args=(power,), jac=True, method="L-BFGS-B",
            options={"maxiter": iterations},
        )  # fmt: skip
        shift = result.x if result.fun < 1e299 else shift
    return points + np.einsum("nij,nj->ni", free, shift.reshape(n, d))


def _inverse(matrices):
    """Return determinants (n,) and inverses (n, d, d) of matrices."""
    if matrices.shape[1] == 3:
        volume = np.linalg.det(matrices)
        return volume, np.linalg.inv(matrices) if volume.all() else matrices
    (a, b), (c, d) = np.moveaxis(matrices, 0, -1)
    area = a * d - b * c
    with np.errstate(divide="ignore", invalid="ignore"):
        return area, np.moveaxis(np.array([[d, -b], [-c, a]]) / area, -1, 0)


def sliding(n: int, nodes: np.ndarray, normals: np.ndarray, fixed=()) -> np.ndarray:
    """Return the projections (n, d, d) onto the directions in which nodes may move.

    Parameters
    ----------
    n : int
    nodes : (m, k) int64
        Of lines or faces on which they stay.
    normals : (m, d) float64, unit
    fixed : sequence of int
        Nodes that stay.
    """
    d = normals.shape[1]
    across = np.zeros((n, d, d))
    for column in nodes.T:
        np.add.at(across, column, normals[:, :, None] * normals[:, None, :])
    across[list(fixed)] = np.eye(d)
    values, vectors = np.linalg.eigh(across)
    return np.einsum("nik,nk,njk->nij", vectors, (values < 1e-6).astype(float), vectors)


def upright(points: np.ndarray, zones: np.ndarray, frame: np.ndarray) -> np.ndarray:
    """Return zones (n, 8) whose axes follow those of a frame (3, 3) best, the third one first.

    An absorbing layer needs the axis of a zone that looks outward to have the number of that axis
    of its frame; the ground surface is the upper end of the third axis.
    """
    bits = np.arange(8)[:, None] >> np.arange(3) & 1
    axes = np.einsum("zck,ca->zak", points[zones], 2.0 * bits - 1.0)
    axes /= np.linalg.norm(axes, axis=2)[:, :, None]
    cosines = axes @ frame.T  # of the axis of a zone (second) with that of the frame (third)
    tables, scores = [], []
    for order, signs in product(permutations(range(3)), product((1, -1), repeat=3)):
        turn = np.zeros((3, 3), dtype=int)
        turn[range(3), order] = signs
        if round(np.linalg.det(turn)) == 1:
            tables.append(((2 * bits - 1) @ turn > 0) @ [1, 2, 4])
            each = zip(order, signs, (1.0, 1.0, UPRIGHT), strict=True)
            scores.append(sum(w * s * cosines[:, k, a] for a, (k, s, w) in enumerate(each)))
    best = np.argmax(np.round(scores, 9), axis=0)
    return np.take_along_axis(zones, np.array(tables)[best], axis=1)


class _Sweep:
    """Section and sweep of a geometry; positions along the axes of its frame."""

    def __init__(self, geometry, planes, sizes, order, frame, lines):
        """Set limits, tolerance and reference height; ease the sides that may move."""
        self.order, self.wide = order, layer_cells(order)
        self.geometry, self.planes, self.frame = geometry, planes, frame
        self.vertical = abs(frame[2, 2]) > 0.5
        thick, self.heights = np.diff(-geometry.limits), sizes[:, 1]
        self.edge = float(sizes[:, 0].min()) if self.vertical else least_edge(sizes, thick)
        self.upward = frame[2, 2]  # of a vertical sweep, else 0
        self.range = extent_along(frame, geometry.box)
        self.names = side_names(frame)
        self.open = np.array([[s in geometry.open_sides for s in pair] for pair in self.names])
        self.sets = {part.name for part in geometry.joint_sets}  # end at the absorbing layer
        self.fine = [(part, extent_along(frame, part.box)) for part in lines or ()]
        thin = [np.diff(-geometry.limits).min(), *(part.spacing for part in geometry.joint_sets)]
        self.tolerance = min(SAME * self.edge, APART * min(thin))
        self.surface = None if geometry.surface is None else Surface(geometry)
        self.level = None if self.surface is None else self._reference(self.surface)
        self._ease()

    def _reference(self, surface):
        """Return the height below which the ground is level: no plane or layer ends above it."""
        heights = [self.geometry.limits[-1], *self.geometry.levels]
        for plane in self.planes:
            if abs(plane.normal[2]) > 1.0 - PARALLEL:
                heights.append(plane.point[2])
            elif plane.extent is not None:
                heights.append(plane.corners(0.0)[:, 2].max())
            elif abs(plane.normal[2]) > PARALLEL:
                raise NotMapped(f"{plane.name!r} dips and comes out of the ground surface")
        level = float(max(heights))
        surface.refuse_above(level, min(self.edge, surface.highest - level))
        return level

    def _ease(self):
        """Move open sides of the section outward, up to an edge, where traces cut off corners."""
        start = self.range[:2].copy()

        def crowding(limits):
            local, segments, _ = _local(limits, self._traces(limits))
            return _crowding(local, segments, self.tolerance, CROWDED * self.edge)

        least = crowding(start)
        for axis, end in [*product((0, 1), (0, 1))] * 2:
            if not self.open[axis, end] or least <= 0.0:
                continue
            for share in np.linspace(0.0, 1.0, TRIALS):
                trial = self.range[:2].copy()
                trial[axis, end] = start[axis, end] + (2 * end - 1) * share * self.edge
                now = crowding(trial)
                if now < 0.8 * least - 1.0:
                    least, self.range[axis, end] = now, trial[axis, end]

    def _traces(self, limits):
        """Return the traces of all planes, layers and ends in the section."""
        traces = []
        for plane in self.planes:
            across = self.frame[:2] @ plane.normal
            if np.hypot(*across) > PARALLEL:
                traces += self._trace(plane, across, limits)
            elif plane.extent is not None:
                corners = plane.corners(0.0) @ self.frame[:2].T
                sides = zip(corners, np.roll(corners, -1, axis=0), strict=True)
                traces += [
                    _Trace(e)
                    for e in (_clipped(u, v - u, 0, 1, limits) for u, v in sides)
                    if e is not None
                ]
        if not self.vertical:
            heights = [*self.geometry.limits[1:-1], *([] if self.level is None else [self.level])]
            (a0, a1), (b0, b1) = limits
            traces += [_Trace(np.array([[a0, z], [a1, z]])) for z in heights if b0 + TINY < z < b1]
        return traces + _continued(traces, limits)

    def _trace(self, plane, across, limits):
        """Return the trace of a plane along the sweep, an empty list outside of the limits."""
        step = np.array([-across[1], across[0]]) / np.hypot(*across)
        at, reach, along = self.frame[:2] @ plane.point, np.inf, None
        if plane.extent is not None:
            k = 0 if abs(plane.strike @ self.frame[2]) > 0.5 else 1  # extent along the sweep
            middle = plane.point @ self.frame[2]
            along = (middle - 0.5 * plane.extent[k], middle + 0.5 * plane.extent[k])
            reach = 0.5 * plane.extent[1 - k]
        if np.isfinite(plane.heights).any():
            if self.vertical:
                low, high = sorted(self.upward * np.array(plane.heights))
                along = (low, high) if along is None else (max(low, along[0]), min(high, along[1]))
            else:
                limits = limits.copy()
                limits[1] = max(limits[1, 0], plane.heights[0]), min(limits[1, 1], plane.heights[1])
                if limits[1, 0] >= limits[1, 1]:
                    return []
        ends = _clipped(at, step, -reach, reach, limits)
        return [] if ends is None else [_Trace(ends, plane, along)]

    def mesh(self) -> Mesh:
        """Return the mesh."""
        order, traces = self.order, self._traces(self.range[:2])
        points, quads, edges = self._section(traces)
        core = len(quads)
        points, quads, edges = self._with_layer(points, quads, traces, edges)
        line = self._levels(traces)
        count = len(quads) * (len(line) - 1) * order**3
        refuse_beyond_memory(f"mesh: a grid of {count} nodes of hexahedra", count * BYTES_PER_NODE)
        n, m = len(points), len(line) - 1
        base = quads[:, [0, 1, 3, 2]]
        zones = np.concatenate(
            [np.concatenate([base + k * n, base + (k + 1) * n], axis=1) for k in range(m)]
        )
        positions = np.concatenate([np.column_stack([points, np.full(n, c)]) for c in line])
        middle = 0.5 * (line[1:] + line[:-1])
        centres = points[quads].mean(axis=1)
        heights = np.tile(centres[:, 1], m)
        if self.vertical:
            heights = np.repeat(self.upward * middle, len(quads))
        names = list(dict.fromkeys(layer.name for layer in self.geometry.layers))
        number = np.array([names.index(layer.name) for layer in self.geometry.layers])
        surfaces = self._sides(points, quads, m)
        surfaces |= self._joints(traces, edges, line, quads, centres, core, n)
        surfaces = between_zones(surfaces, zones, len(positions))
        for plane in self.planes:
            if not len(surfaces.get(plane.name, ())):
                raise NotMapped(f"{plane.name!r} has no facet in the sweep")
        return self._finished(
            positions, zones, number[self._layer_of(heights)], names, surfaces, order
        )

    def _section(self, traces):
        """Return points, quadrilaterals, and the edges (k, 2) on each trace of the section."""
        limits, segments, order = _local(self.range[:2], traces)
        vertices, chains = arrangement(limits, segments, self.tolerance)
        pairs = {(min(p), max(p)) for chain in chains for p in pairwise(chain)}
        beside = np.abs(vertices[:, :, None] - limits[None]) < 1e-12
        lines = [p for p in sorted(pairs) if not (beside[p[0]] & beside[p[1]]).any()]
        meshes, reasons = [], []
        for blossom in (True, False):
            try:
                mesh = section_mesh(
                    limits, vertices, np.array(lines, dtype=int).reshape(-1, 2), self.edge,
                    self._edge_at if self.fine else None, blossom,
                )  # fmt: skip
                meshes.append(self._smoothed(*mesh, limits, vertices, chains))
            except MeshingError as reason:
                reasons.append(reason)
        if not meshes:
            raise reasons[0]
        points, quads, sorted_edges = min(meshes, key=lambda mesh: _work(*mesh[:2]))
        on_traces = [sorted_edges[k] for k in np.argsort(order)]
        points += self.range[:2, 0]
        for axis in (0, 1):
            points[points[:, axis] == points[:, axis].max(), axis] = self.range[axis, 1]
        return points, quads, on_traces

    def _smoothed(self, points, quads, limits, vertices, chains):
        """Return smoothed points, quadrilaterals, and the edges (k, 2) on each chain."""
        sides = np.concatenate([quads[:, [k, (k + 1) % 4]] for k in range(4)])
        every = np.unique(np.sort(sides, axis=1), axis=0)
        tolerance = TINY * np.ptp(self.range)
        on_traces = []
        for chain in chains:
            on = np.zeros(len(every), dtype=bool)
            for i, j in pairwise(chain):
                near = _on_line(points, vertices[i], vertices[j], tolerance)
                on |= near[every].all(axis=1)
            on_traces.append(every[on])
        fixed = [
            every[(np.abs(points[every, axis] - limits[axis, end]) < tolerance).all(axis=1)]
            for axis, end in product((0, 1), (0, 1))
        ]
        nearest = np.abs(points[:, None] - vertices[None]).sum(axis=2).min(axis=1)
        fixed = np.unique(np.concatenate([*fixed, *on_traces]), axis=0)
        lines = points[fixed[:, 1]] - points[fixed[:, 0]]
        normals = np.column_stack([-lines[:, 1], lines[:, 0]]) / np.hypot(*lines.T)[:, None]
        free = sliding(len(points), fixed, normals, np.flatnonzero(nearest < tolerance))
        corners = [quads[:, [k, (k + 1) % 4, k - 1]] for k in range(4)]
        points = smoothed_quadrilaterals(points, np.concatenate(corners), free, self.edge)
        for axis, end in product((0, 1), (0, 1)):
            on = np.abs(points[:, axis] - limits[axis, end]) < 100.0 * tolerance
            points[on, axis] = limits[axis, end]
        return points, quads, on_traces

    def _edge_at(self, x, y):
        """Return the wanted edge in m at a place in the section."""
        edges = [self.edge]
        for part, limits in self.fine:
            at = self.range[:2, 0] + (x, y)
            away = np.maximum(np.maximum(limits[:2, 0] - at, at - limits[:2, 1]), 0.0)
            edges.append(float(part.edge_at((0.0, 0.0), np.array([away.max()]))[0]))
        return min(edges)

    def _with_layer(self, points, quads, traces, edges):
        """Add the cells of the absorbing layer outside of open sides; draw traces into them."""
        limits = self.range[:2]
        fresh, numbers = [*map(tuple, points)], {}

        def node(n, i, j):
            if not i and not j:
                return n
            if (n, i, j) not in numbers:
                numbers[n, i, j] = len(fresh)
                fresh.append((points[n, 0] + i * self.edge, points[n, 1] + j * self.edge))
            return numbers[n, i, j]

        def beyond(n, axis, k):
            return node(n, k, 0) if axis == 0 else node(n, 0, k)

        on = {
            (axis, end): np.abs(points[:, axis] - limits[axis, end]) < TINY * np.ptp(limits)
            for axis, end in product((0, 1), (0, 1))
        }
        sides = np.concatenate([quads[:, [k, (k + 1) % 4]] for k in range(4)])
        corners = np.array([*on.values()]).sum(axis=0)
        more, drawn = [], [[] for _ in traces]
        for (axis, end), mask in on.items():
            if not self.open[axis, end]:
                continue
            pairs = [(k * (2 * end - 1), (k + 1) * (2 * end - 1)) for k in range(self.wide)]
            for u, v in sides[mask[sides].all(axis=1)]:
                more += [
                    [beyond(u, axis, k), beyond(v, axis, k), beyond(v, axis, m), beyond(u, axis, m)]
                    for k, m in pairs
                ]
            for number, (trace, own) in enumerate(zip(traces, edges, strict=True)):
                if trace.plane is None or trace.plane.name in self.sets:
                    continue
                out = own[mask[own].any(axis=1) & ~mask[own].all(axis=1)]
                for u in np.unique(out[mask[out] & (corners[out] == 1)]):
                    drawn[number] += [(beyond(u, axis, k), beyond(u, axis, m)) for k, m in pairs]
        for first, second in product((0, 1), (0, 1)):
            if self.open[0, first] and self.open[1, second]:
                n = int(np.flatnonzero(on[0, first] & on[1, second])[0])
                i, j = 2 * first - 1, 2 * second - 1
                for p, q in product(range(self.wide), range(self.wide)):
                    ring = ((p, q), (p + 1, q), (p + 1, q + 1), (p, q + 1))
                    more.append([node(n, i * a, j * b) for a, b in ring])
        points = np.array(fresh)
        quads = np.concatenate([quads, np.array(more, dtype=int).reshape(-1, 4)])
        turned = quadrilateral_areas(points, quads) < 0.0
        quads[turned] = quads[turned][:, ::-1]
        edges = [
            np.concatenate([own, np.array(add, dtype=int).reshape(-1, 2)])
            for own, add in zip(edges, drawn, strict=True)
        ]
        return points, quads, edges

    def _levels(self, traces):
        """Return the coordinates of the levels of the sweep, with those of the layer."""
        low, high = self.range[2]
        sweep = self.frame[2]
        levels = [p.point @ sweep for p in self.planes if abs(p.normal @ sweep) > 0.5]
        if self.vertical:
            heights = [*self.geometry.limits[1:-1], *([] if self.level is None else [self.level])]
            levels += [float(self.upward * height) for height in heights]
        ends = [end for trace in traces if trace.along is not None for end in trace.along]
        anchors = distinct_values(sorted(levels), (low, high), TINY)
        near = distinct_values([*anchors[1:-1], *ends], (low, high), self.tolerance)
        anchors = distinct_values(sorted([*anchors[1:-1], *near[1:-1]]), (low, high), TINY)
        fine = [(part, tuple(limits[2])) for part, limits in self.fine]
        parts = []
        for first, second in pairwise(anchors):
            edge = self.edge
            if self.vertical:
                edge = self.heights[int(self._layer_of(0.5 * self.upward * (first + second)))]
            parts.append(divided(first, second, edge, fine))
        line = np.concatenate([*parts, [high]])
        self.cells = [line[1] - line[0], line[-1] - line[-2]] if self.vertical else [self.edge] * 2
        steps = np.arange(1, self.wide + 1)
        below = line[0] - self.cells[0] * steps[::-1] if self.open[2, 0] else []
        above = line[-1] + self.cells[1] * steps if self.open[2, 1] else []
        return np.concatenate([below, line, above])

    def _layer_of(self, height):
        """Return the index of the layer at heights in m."""
        return np.searchsorted(-self.geometry.limits[1:-1], -np.asarray(height))

    def _sides(self, points, quads, m):
        """Return the faces of the sides, by name."""
        n = len(points)
        sides = np.concatenate([quads[:, [k, (k + 1) % 4]] for k in range(4)])
        _, at, count = np.unique(
            np.sort(sides, axis=1), axis=0, return_index=True, return_counts=True
        )
        outer, surfaces = sides[at[count == 1]], {}
        for axis, end in product((0, 1), (0, 1)):
            limit = (points[:, axis].min(), points[:, axis].max())[end]
            own = outer[
                (np.abs(points[outer, axis] - limit) < TINY * np.ptp(self.range)).all(axis=1)
            ]
            surfaces[self.names[axis][end]] = _drawn(own, n, range(m))
        surfaces[self.names[2][0]] = quads[:, ::-1]
        surfaces[self.names[2][1]] = quads + m * n
        return surfaces

    def _joints(self, traces, edges, line, quads, centres, core, n):
        """Return the faces of the planes, by name."""
        middle, sweep = 0.5 * (line[1:] + line[:-1]), self.frame[2]
        inside = (middle > self.range[2, 0]) & (middle < self.range[2, 1])
        parts = []
        for plane in self.planes:
            own = plane.name in self.sets
            for trace, pairs in zip(traces, edges, strict=True):
                if trace.plane is plane:
                    low, high = trace.along or (-np.inf, np.inf)
                    at = (middle > low) & (middle < high) & (inside | (not own))
                    parts.append((plane.name, _drawn(pairs, n, np.flatnonzero(at))))
            if abs(plane.normal @ sweep) > 0.5:
                on = np.arange(len(quads)) < (core if own or plane.extent else len(quads))
                if plane.extent is not None:
                    at = (
                        centres @ self.frame[:2] - (plane.point @ self.frame[:2].T) @ self.frame[:2]
                    )
                    on &= np.abs(at @ plane.strike) < 0.5 * plane.extent[0]
                    on &= np.abs(at @ plane.down) < 0.5 * plane.extent[1]
                height = np.full(len(quads), plane.point[2]) if self.vertical else centres[:, 1]
                on &= (height > plane.heights[0] - self.vertical * TINY) & (
                    height < plane.heights[1]
                )
                level = np.flatnonzero(np.abs(line - plane.point @ sweep) < self.tolerance)
                parts += [(plane.name, quads[on] + k * n) for k in level[:1]]
        surfaces = {}
        for name, faces in parts:
            surfaces[name] = np.concatenate([surfaces.get(name, faces[:0]), faces])
        return surfaces

    def _finished(self, positions, zones, group, names, surfaces, order):
        """Return the mesh in the ground, stretched to its surface."""
        axes = [0, 1, 2] if self.vertical else [0, 2, 1]  # the vertical is the last
        frame, limits, opened = self.frame[axes], self.range[axes], self.open[axes]
        width = np.full((3, 2), self.wide * self.edge)
        width[2] = self.wide * np.array(self.cells)
        width = width[axes]
        turned = 2 if self.upward < 0.0 else 1
        if self.upward <= 0.0:  # up, and of the right hand where the sweep is level
            frame = frame * np.where(np.arange(3) == turned, -1.0, 1.0)[:, None]
            limits[turned] = -limits[turned, ::-1]
            width[turned], opened[turned] = width[turned, ::-1], opened[turned, ::-1]
        layer = layer_beside(opened, limits, width, frame)
        points, places = positions @ self.frame, None
        zones = upright(points, zones, frame)
        if self.surface is not None:
            places = hexahedra.zone_nodes_places(points, zones, order)
            points, places = (self._stretched(part, self.surface) for part in (points, places))
        return Mesh(
            points, zones, group, tuple(names), surfaces, order=order, places=places, layer=layer
        )

    def _stretched(self, positions, surface):
        """Return positions (..., 3) above the reference height stretched to the surface."""
        along = positions @ self.frame.T
        level = np.abs(self.frame[:, 2]) < 0.5
        along[..., level] = np.clip(along[..., level], *self.range[level].T)
        ground = surface.height((along @ self.frame)[..., :2])
        moved, z = positions.copy(), positions[..., 2]
        moved[..., 2] = surface.stretched(z, self.level, lambda depth: ground - depth)
        return moved


def _local(limits, traces):
    """Return limits (2, 2) and traces (n, 2, 2) from a corner of the section on, and their order.

    Grounds that only differ in where they stand, or how their planes are listed, have the same
    ones, bit by bit.
    """
    segments = np.array([trace.ends for trace in traces]).reshape(-1, 2, 2) - limits[:, 0]
    segments = np.round(segments, 9)
    turned = (segments[:, 1] < segments[:, 0]) @ [2, 1] > (segments[:, 1] > segments[:, 0]) @ [2, 1]
    segments[turned] = segments[turned][:, ::-1]
    order = np.lexsort(segments.reshape(-1, 4).T[::-1])
    return np.round(limits - limits[:, :1], 9), segments[order], order


def _on_line(points, start, end, tolerance):
    """Tell which points (n, 2) lie on a straight line between two ends."""
    length = np.hypot(*(end - start))
    step = (end - start) / length
    along, away = (points - start) @ step, np.abs(_cross(points - start, step))
    return (away < tolerance) & (along > -tolerance) & (along < length + tolerance)


def _drawn(pairs, n, levels):
    """Return the faces (k, 4) of edges (m, 2) of a section with n nodes, between levels."""
    faces = [np.column_stack([pairs + k * n, pairs[:, ::-1] + (k + 1) * n]) for k in levels]
    return np.concatenate([np.zeros((0, 4), dtype=int), *faces])


def _clipped(start, step, low, high, limits):
    """Return the ends (2, 2) of start + t step, low <= t <= high, in a rectangle, or None."""
    for axis in (0, 1):
        if abs(step[axis]) > 1e-12 * np.hypot(*step):
            ends = np.sort((limits[axis] - start[axis]) / step[axis])
            low, high = max(low, ends[0]), min(high, ends[1])
        elif not limits[axis, 0] - 1e-9 <= start[axis] <= limits[axis, 1] + 1e-9:
            return None
    if not (high - low) * np.hypot(*step) > 1e-6:
        return None
    ends = np.array([start + low * step, start + high * step])
    return np.clip(ends, *limits.T)


def _continued(traces, limits):
    """Return lines from the ends of limited planes to the next trace or side of the section."""
    a, b = limits
    corners = np.array([[a[0], b[0]], [a[1], b[0]], [a[1], b[1]], [a[0], b[1]]])
    sides = np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)
    more = []
    for number, trace in enumerate(traces):
        if trace.plane is None or trace.plane.extent is None:
            continue
        others = [other.ends for k, other in enumerate(traces) if k != number]
        lines = np.concatenate([np.array(others).reshape(-1, 2, 2), sides])
        for tip, tail in (trace.ends, trace.ends[::-1]):
            step = (tip - tail) / np.hypot(*(tip - tail))
            across = lines[:, 1] - lines[:, 0]
            sine = _cross(step, across)
            meet = np.abs(sine) > 1e-9 * np.hypot(*across.T)
            with np.errstate(divide="ignore", invalid="ignore"):
                along = _cross(lines[:, 0] - tip, across) / sine
                share = _cross(lines[:, 0] - tip, step) / sine
            meet &= (along > -1e-9) & (share >= -1e-9) & (share <= 1.0 + 1e-9)
            nearest = along[meet].min(initial=np.inf)
            if 1e-6 < nearest < np.inf:
                more.append(_Trace(np.array([tip, tip + nearest * step])))
    return more
