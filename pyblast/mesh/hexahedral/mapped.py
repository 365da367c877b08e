"""Mapped grids: transfinite interpolation between planes.

Planes ``x = a + b y + c z`` that don't meet in the box are surfaces of one family of the grid,
whatever their dips and strikes; between two neighbours the grid is linear, and the sides stand.
Planes across the second axis and horizontal ones are surfaces of the other two families. Above a
level reference the nodes move along the lines of the grid up to a surveyed surface, so that planes
stay plane. Faces of straight benches are planes of the grid, too, and zones in front of them are
left out. A grid without slopes is a plain grid. Source: Gordon & Hall (1973).
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise, permutations, product
from typing import Protocol

import numpy as np
from scipy.interpolate import LinearNDInterpolator, NearestNDInterpolator

from .. import hexahedra
from ..faces import face_keys
from ..grid import SIDES, Geometry
from ..hexahedra import AbsorbingLayer
from ..mesh import Mesh
from ..quality import explicit_work, refuse_beyond_memory
from .benches import Benches, face_normal
from .planes import PARALLEL, NotMapped, planes_of

LAYER_CELLS = {2: 6, 3: 3}  # of the absorbing layer by order; of higher orders two
LEAST_GAP = 0.15  # of an edge, at the narrow end between two planes, or a plane and a side
NARROWING = 0.5  # narrow end over wide end from which the gap does not matter
BELOW_SURFACE = 0.25  # of an edge, from the reference to the lowest ground
STEEP = 0.3  # least component of the normal of a plane along the first axis
UNEVEN = 0.04  # of an edge: extent across a line of a bench that counts as straight
SAME = 0.008  # of an edge: ends nearer than this to another plane lie on it
ROUND = 1e-9  # of the size: coordinates that count as equal
HEIGHTS = 25  # tried on each line, for surfaces that it meets more than once
BISECTIONS = 50
BYTES_PER_NODE = 500.0


class Surface:
    """Heights of a surveyed surface above a box, beyond the survey those of the nearest point."""

    def __init__(self, geometry: Geometry) -> None:
        """Triangulate the survey."""
        survey = np.asarray(geometry.surface, dtype=float)
        if survey.ndim == 3:
            raise NotMapped("the ground surface is given as triangles, which cut its blocks")
        self.inside = LinearNDInterpolator(survey[:, :2], survey[:, 2])
        self.outside = NearestNDInterpolator(survey[:, :2], survey[:, 2])
        self.box, self.top = geometry.box[:2], float(geometry.box[2, 1])
        self.depths = [*geometry.depths[::-1], 0.0]
        on = ((survey[:, :2] >= self.box[:, 0]) & (survey[:, :2] <= self.box[:, 1])).all(axis=1)
        edges = np.linspace(self.box[:, 0], self.box[:, 1], 41)
        x, y = np.meshgrid(*edges.T)
        grid = self.height(np.column_stack([x.ravel(), y.ravel()]))
        heights = np.concatenate([survey[on, 2], grid])
        self.lowest, self.highest = float(heights.min()), float(heights.max())

    def height(self, horizontal: np.ndarray) -> np.ndarray:
        """Return the height (...) in m at positions (..., 2); outside of the box, at its edge."""
        at = np.clip(horizontal, *self.box.T)
        value = self.inside(at)
        beyond = np.isnan(value)
        if beyond.any():
            value[beyond] = self.outside(at[beyond])
        return value

    def refuse_above(self, reference: float, edge: float) -> None:
        """Raise NotMapped where what ends at a reference height comes out of the ground."""
        cover = self.depths[0]
        if reference > self.lowest - cover - BELOW_SURFACE * edge or reference >= self.top - cover:
            less = f", with {cover:.4g} m of layers that follow it" if cover else ""
            raise NotMapped(
                f"a plane, an end or a layer reaches {reference:.4g} m, and the ground surface "
                f"goes down to {self.lowest:.4g} m{less}"
            )

    def stretched(
        self, z: np.ndarray, level: float, reached: Callable[[float], np.ndarray]
    ) -> np.ndarray:
        """Return heights (...) in m that are moved to the surface, with the layers that follow it.

        Parameters
        ----------
        z : (...) float64, m
            Where the top of the box is the surface.
        level : float, m
            Below which nothing moves.
        reached : callable
            ``(depth) -> (...) float64``: heights in m of what lies so deep under the surface.
        """
        moved, foot, low = z, level, level
        for depth in self.depths:
            height, upper = reached(depth), self.top - depth
            moved = np.where(z > low, foot + (z - low) * ((height - foot) / (upper - low)), moved)
            foot, low = height, upper
        return moved


def side_names(frame: np.ndarray) -> list[list[str]]:
    """Return the sides at the lower and upper ends of axes (3, 3): those that face most alike."""
    alike = np.round(np.abs(frame), 9)
    axes = max(permutations(range(3)), key=lambda order: alike[range(3), order].sum())
    names = []
    for row, axis in zip(frame, axes, strict=True):
        pair = list(SIDES[2 * axis : 2 * axis + 2])
        names.append(pair if row[axis] > 0.0 else pair[::-1])
    return names


def extent_along(frame: np.ndarray, box: np.ndarray) -> np.ndarray:
    """Return the limits (3, 2) in m of a box along the axes (3, 3) of a frame."""
    corners = np.array(np.meshgrid(*box)).reshape(3, -1).T @ frame.T
    return np.column_stack([corners.min(axis=0), corners.max(axis=0)])


def layer_cells(order: int) -> int:
    """Return how many zones of an order an absorbing layer is wide; docs/quality/absorbing.md."""
    return LAYER_CELLS.get(order, 2)


def layer_beside(
    opened: np.ndarray, limits: np.ndarray, width: np.ndarray, frame: np.ndarray
) -> AbsorbingLayer | None:
    """Return the absorbing layer beside open ends (3, 2) of limits (3, 2) in m, None without."""
    if not opened.any():
        return None
    inner = np.where(opened, limits, [-np.inf, np.inf])
    inside, wide, axes = (tuple(map(tuple, part)) for part in (inner, width, frame))
    return AbsorbingLayer(inside, wide, axes)


def between_zones(
    surfaces: dict[str, np.ndarray], zones: np.ndarray, n: int
) -> dict[str, np.ndarray]:
    """Return surfaces of hexahedra with ``n`` nodes whose joints lie between two zones.

    A face of two joints has the first. What follows a side of the mesh, to which a joint comes
    near, is left out.
    """
    joints = [name for name in surfaces if name not in SIDES]
    faces = np.concatenate([np.zeros((0, 4), dtype=np.int64), *(surfaces[n] for n in joints)])
    owner = np.repeat(np.arange(len(joints)), [len(surfaces[name]) for name in joints])
    keys, count = np.unique(
        face_keys(zones[:, hexahedra.FACES].reshape(-1, 4), n), return_counts=True
    )
    own, first = np.unique(face_keys(faces, n), return_index=True)
    first = np.sort(first[count[np.searchsorted(keys, own)] == 2])
    distinct = {name: faces[first[owner[first] == k]] for k, name in enumerate(joints)}
    return {**{side: surfaces[side] for side in SIDES}, **distinct}


def distinct_values(
    values: Sequence[float], ends: Sequence[float], tolerance: float
) -> list[float]:
    """Return sorted values between two ends; those near an end or an earlier one are left out."""
    distinct = [float(end) for end in ends]
    for value in values:
        inside = ends[0] <= value <= ends[1]
        if inside and min(abs(value - other) for other in distinct) > tolerance:
            distinct.append(float(value))
    return sorted(distinct)


@dataclass(frozen=True, eq=False)
class Fine:
    """Part of a ground that needs smaller elements than the waves do.

    Parameters
    ----------
    box : (3, 2) float64, m
    edge : float, m
        Of the elements in it; outside of it each is at most ``growth`` times its neighbour.
    growth : float
    """

    box: np.ndarray
    edge: float
    growth: float = 2.0

    def edge_at(self, axis_limits: Sequence[float], along: np.ndarray) -> np.ndarray:
        """Return the edge (n,) in m at places (n,) along an axis on which it has limits (2,)."""
        low, high = axis_limits
        away = np.maximum(np.maximum(low - along, along - high), 0.0)
        rate = self.growth - 1.0
        outside = (self.edge + rate * away) * np.log(self.growth) / rate
        return np.where(away > 0.0, np.maximum(outside, self.edge), self.edge)


def divided(first: float, second: float, edge: float, fine: Sequence = ()) -> np.ndarray:
    """Return coordinates from ``first`` up to, but without, ``second``.

    Parameters
    ----------
    first, second : float, m
    edge : float, m
    fine : sequence of (Fine, (float, float))
        With its limits in m along this axis.
    """
    along = np.linspace(first, second, 512)
    edges = np.full(len(along), edge)
    for part, limits in fine:
        edges = np.minimum(edges, part.edge_at(limits, along))
    if not (edges < edge).any():
        n = max(1, int(np.ceil((second - first) / edge - 0.05)))
        return np.linspace(first, second, n + 1)[:-1]
    count = np.concatenate(
        [[0.0], np.cumsum(0.5 * np.diff(along) * (1 / edges[1:] + 1 / edges[:-1]))]
    )
    n = max(1, int(np.ceil(count[-1] - 0.05)))
    inner = np.interp(count[-1] * np.arange(1, n) / n, count, along)
    return np.concatenate([[first], inner])


Sizes = Sequence[float] | Sequence[tuple[float, float]]


def edge_pairs(sizes: Sizes) -> np.ndarray:
    """Return width and height (n, 2) in m of the hexahedra of each layer, alike where one is given.

    Examples
    --------
    >>> edge_pairs([20.0]).tolist(), edge_pairs([(40.0, 5.0)]).tolist()
    ([[20.0, 20.0]], [[40.0, 5.0]])
    """
    values = np.asarray(sizes, dtype=float)
    return values if values.ndim == 2 else np.column_stack([values, values])


def least_edge(sizes: Sizes, thicknesses: np.ndarray) -> float:
    """Return the edge in m of zones as wide as high; a layer of one zone's height sets no other."""
    wide, high = edge_pairs(sizes).T
    return float(np.where(thicknesses <= high, wide, np.minimum(wide, high)).min())


class Builder(Protocol):
    """Builder of meshes of spectral hexahedra."""

    def __call__(
        self,
        geometry: Geometry,
        sizes: Sizes,
        order: int,
        lines: Sequence[Fine] | None = None,
    ) -> Mesh:
        """Build a mesh, not split, with an absorbing layer beside open sides.

        Parameters
        ----------
        geometry : Geometry
        sizes : sequence of float or of (float, float), m
            Largest edge of the hexahedra of each layer, or width along it and height across it.
        order : int
            Of the polynomials.
        lines : sequence of Fine, optional
            Parts with smaller elements.

        Raises
        ------
        NotMapped
            If no mesh of this kind serves the planes, or its order is not of this kind.
        InputError
            If a plane does not cut the model, or the mesh is larger than the memory.
        """
        ...


def build_mapped(
    geometry: Geometry, sizes: Sizes, order: int, lines: Sequence[Fine] | None = None
) -> Mesh:
    """Build the mapped grid of least work that serves, as a `Builder`.

    Examples
    --------
    >>> from ..grid import Fault, Layer
    >>> box = np.array([[0.0, 40.0], [0.0, 40.0], [-20.0, 0.0]])
    >>> fault = Fault("F", 1.0, 0.5, (20.0, 20.0, 0.0))
    >>> ground = Geometry(box, (Layer("rock"),), faults=(fault,), standing=frozenset(["top"]))
    >>> mesh = build_mapped(ground, [20.0], 4)
    >>> mesh.groups, len(mesh.split(["F"]).contacts.names)
    (('rock',), 1)
    """
    reasons, meshes, edges = [], [], edge_pairs(sizes)
    planes, top = planes_of(geometry), _top(geometry, edges)
    for frame in _frames(geometry, planes):
        try:
            meshes.append(_Grid(geometry, planes, edges, order, frame, top, lines).mesh())
        except NotMapped as reason:
            reasons.append(str(reason))
    if not meshes:
        raise NotMapped(reasons[0])
    return meshes[0] if len(meshes) == 1 else min(meshes, key=explicit_work)


def _top(geometry, edges):
    """Return the surface or the benches of a geometry, None where its top is level."""
    if geometry.benches:
        return Benches(geometry, UNEVEN * float(edges[:, 0].min()))
    return None if geometry.surface is None else Surface(geometry)


def grid_lines(geometry: Geometry, sizes: Sizes, order: int) -> list[np.ndarray]:
    """Return the coordinates in m along the axes of the first mapped grid that serves, no mesh.

    Those of the absorbing layer are among them. Of ground without a surveyed surface.

    Raises
    ------
    NotMapped
        If no grid serves.
    """
    edges, reasons = edge_pairs(sizes), []
    planes, top = planes_of(geometry), _top(geometry, edges)
    for frame in _frames(geometry, planes):
        try:
            return _Grid(geometry, planes, edges, order, frame, top, None).axes
        except NotMapped as reason:
            reasons.append(reason)
    raise reasons[0]


def in_a_grid(geometry: Geometry, sizes: Sizes) -> bool:
    """Tell whether a grid between planes may serve the surface of a geometry."""
    if geometry.benches:
        try:
            return _top(geometry, edge_pairs(sizes)) is not None
        except NotMapped:
            return False
    return np.ndim(geometry.surface) < 3


def is_plain(geometry: Geometry) -> bool:
    """Tell whether all planes of a geometry lie along the axes, and so its grid has no slopes."""
    parts = [fault.unit_normal for fault in geometry.faults]
    parts += [face_normal(*lines) for lines in geometry.benches]
    normals = np.array(parts + [part.normal for part in geometry.joint_sets]).reshape(-1, 3)
    return bool((np.sort(np.abs(normals), axis=1)[:, 1] < PARALLEL).all())


def _frames(geometry, planes):
    """Return the axes (3, 3) of grids to try."""
    x, y, z = np.eye(3)
    normals = [plane.normal for plane in planes if np.hypot(*plane.normal[:2]) > PARALLEL]
    normals += [face_normal(*lines) for lines in geometry.benches]
    if is_plain(geometry):
        return [np.eye(3)]
    frames = [np.eye(3), np.array([y, -x, z])]
    if not set(SIDES[:4]) & geometry.standing:
        for normal in normals:
            first = np.array([*normal[:2], 0.0]) / np.hypot(*normal[:2])
            if not any(min(np.abs(first @ f[:2].T)) < PARALLEL for f in frames):
                frames.append(np.array([first, np.cross(z, first), z]))
    if not geometry.standing and geometry.surface is None and len(geometry.layers) == 1:
        for plane in planes:  # whatever turns with a plane: it goes on straight in the layer
            if PARALLEL < np.hypot(*plane.normal[:2]) < 1.0 - PARALLEL:
                across = np.cross(plane.normal, plane.strike)
                frames.append(np.array([plane.strike, across, plane.normal]))
    return frames


def _axis(plane, frame):
    """Return the axis of a grid whose surfaces a plane belongs to, or None."""
    n = frame @ plane.normal
    if np.hypot(n[0], n[1]) < PARALLEL:
        return 2
    if np.hypot(n[0], n[2]) < PARALLEL:
        return 1
    return 0 if abs(n[0]) > STEEP else None


class _Grid:
    """Coordinates of a mapped grid along its three axes, and the map from these to the ground.

    The first coordinate of a surface of the grid is its place on the first axis at the middle of
    the other two.
    """

    def __init__(self, geometry, planes, sizes, order, frame, top, lines):
        """Sort the planes by axis and divide the distances between them."""
        self.benches = top if isinstance(top, Benches) else None
        self.surface = surface = top if isinstance(top, Surface) else None
        self.geometry, self.frame = geometry, frame
        self.order, self.cells = order, layer_cells(order)
        self.edge, self.heights = float(sizes[:, 0].min()), sizes[:, 1]
        self.range = extent_along(frame, geometry.box)
        if self.benches is not None:
            self.range[2, 1] = self.benches.top
        self.names = side_names(frame)
        self.open = np.array([[s in geometry.open_sides for s in pair] for pair in self.names])
        self.top = self.range[2, 1] if surface is None else max(surface.highest, self.range[2, 1])
        self.parts = [self._part(plane) for plane in planes]
        faces = [] if self.benches is None else self.benches.faces
        self.cuts = self.parts + [self._part(plane) for plane in faces]
        self._family()
        self._reference()
        self.width = np.ones((3, 2))
        self.fills = [self._fill(part) for part in geometry.fills]
        self.axes = [self._axis_line(axis, lines or ()) for axis in range(3)]

    def _fill(self, part):
        """Return the limits (3, 2) of a fill along the axes, infinite beyond the box."""
        if np.sort(np.abs(self.frame), axis=1)[:, 1].max() > PARALLEL:
            raise NotMapped(f"{part.name!r} is oblique to the grid")
        limits = extent_along(self.frame, part.box)
        outside = np.stack([limits[:, 0] <= self.range[:, 0], limits[:, 1] >= self.range[:, 1]], 1)
        return np.where(outside, [-np.inf, np.inf], limits)

    def _part(self, plane):
        """Return plane, axis and the limits (3,), (3,) of its extent along the axes."""
        axis, n = _axis(plane, self.frame), self.frame @ plane.normal
        if axis is None:
            raise NotMapped(f"{plane.name!r} runs along the lines of the grid")
        low, high = np.full(3, -np.inf), np.full(3, np.inf)
        if plane.extent is not None:
            edges = self.frame @ plane.strike, self.frame @ plane.down
            askew = min(np.abs(edges[0][:2])) > PARALLEL
            if askew or (axis == 0 and abs(n[1]) > PARALLEL):
                raise NotMapped(f"{plane.name!r} is limited and oblique to the grid")
            corners = plane.corners(0.0) @ self.frame.T
            low, high = corners.min(axis=0), corners.max(axis=0)
            low[axis], high[axis] = -np.inf, np.inf
        low[2], high[2] = max(low[2], plane.heights[0]), min(high[2], plane.heights[1])
        return plane, axis, low, high

    def _family(self):
        """Place the surfaces x = a + b (y - y0) + c (z - z0) across the first axis, and the sides.

        Ends of planes of the other families are such surfaces, too. Open sides make room.
        """
        self.middle = np.array([self.range[1].mean(), 0.5 * (self.range[2, 0] + self.top)])
        y, z = np.meshgrid(self.range[1], [self.range[2, 0], self.top], indexing="ij")
        self.corners = np.stack([y, z], axis=-1).reshape(-1, 2) - self.middle
        members, ends = [], []
        for plane, axis, low, high in self.cuts:
            if axis == 0:
                n = self.frame @ plane.normal
                slopes = -n[1:] / n[0]
                members.append(_Member(plane.name, self._position_of(plane, axis), slopes))
            else:
                ends += [(plane.name, end) for end in (low[0], high[0])]
        for part in self.geometry.fills:
            ends += [(part.name, end) for end in extent_along(self.frame, part.box)[0]]
        level = [each.x for each in members if not each.slopes.any()]
        for name, end in ends:
            inside = self.range[0, 0] < end < self.range[0, 1]
            if inside and min(np.abs(np.array([*level, *self.range[0]]) - end)) > SAME * self.edge:
                members.append(_Member(name, end, np.zeros(2)))
                level.append(end)
        members.sort(key=lambda each: each.x)
        self._make_room(members)
        west, east = (_Member(self.names[0][k], self.range[0, k], np.zeros(2)) for k in (0, 1))
        self.family = [west]
        for each in (*members, east):
            gap = each.at(self.corners) - self.family[-1].at(self.corners)
            if np.abs(gap).max() <= ROUND * np.ptp(self.range[0]):
                if each is east and len(self.family) > 1:
                    self.family[-1] = east
                continue
            if gap.min() < min(LEAST_GAP * self.edge, NARROWING * gap.max()):
                pair = f"{self.family[-1].name!r} and {each.name!r}"
                narrow = f"come within {gap.min():.3g} m of each other"
                raise NotMapped(f"{pair} {'meet' if gap.min() <= 0.0 else narrow} in the box")
            self.family.append(each)

    def _make_room(self, members):
        """Move open sides outward from the nearest planes, until half an edge lies between."""
        if not members:
            return
        pitch = min([self.edge, *np.diff([each.x for each in members])])
        for end, sign in ((0, 1.0), (1, -1.0)):
            if not self.open[0, end]:
                continue
            for each in members:
                away = sign * (each.at(self.corners) - self.range[0, end])
                clear = 0.5 * (self.edge if each.slopes.any() else pitch)
                wanted = clear if each.slopes.any() else LEAST_GAP * pitch
                on_side = np.abs(away).max() <= ROUND * np.ptp(self.range[0])
                if away.min() < wanted and not on_side:
                    self.range[0, end] -= sign * (clear - away.min())

    def _reference(self):
        """Set the height below which nothing moves, under a surveyed surface."""
        reached = [self.geometry.limits[-1], *self.geometry.levels]
        reached += [plane.point[2] for plane, axis, _, _ in self.parts if axis == 2]
        reached += [part[3][2] for part in self.parts if part[0].extent is not None]
        self.level = max(reached)
        if self.surface is not None:
            height = min(self.edge, self.surface.highest - self.level)
            self.surface.refuse_above(self.level, height)

    def _axis_line(self, axis, lines):
        """Return the coordinates of the surfaces of the grid along an axis, with the layer's."""
        low, high = self.range[axis]
        tolerance = ROUND * (high - low)
        levels = [self._position_of(*part[:2]) for part in self.cuts if part[1] == axis]
        ends = [float(end) for part in self.parts for end in (part[2][axis], part[3][axis])]
        if axis == 2:
            levels += list(self.geometry.limits[1:-1])
            levels += [] if self.surface is None else [self.level]
            levels += [] if self.benches is None else self.benches.heights
            levels += [end for part in self.fills for end in part[2]]
        if axis == 0:
            levels, ends = [each.x for each in self.family[1:-1]], []
        if axis == 1:
            ends += [end for part in self.fills for end in part[1]]
        anchors = distinct_values(sorted(levels), (low, high), tolerance)
        near = distinct_values([*anchors[1:-1], *ends], (low, high), SAME * self.edge)
        anchors = distinct_values(sorted([*anchors[1:-1], *near[1:-1]]), (low, high), tolerance)
        fine = [(part, self._limits_of(part, axis)) for part in lines]
        parts = [divided(u, v, self._edge_between(axis, u, v), fine) for u, v in pairwise(anchors)]
        return self._with_layer(axis, np.concatenate([*parts, [high]]))

    def _edge_between(self, axis, first, second):
        """Return the wanted edge in m of the cells between two surfaces of an axis."""
        if axis == 2:
            at, n = 0.5 * (first + second), len(self.geometry.layers)
            layer = int(np.searchsorted(-self.geometry.limits[1:-1], -at))
            within = [high for part, high in zip(self.fills, self.heights[n:], strict=True)
                      if part[2, 0] < at < part[2, 1]]  # fmt: skip
            return min([self.heights[layer], *within])
        if axis == 0:
            u, v = (next(f for f in self.family if f.x == x) for x in (first, second))
            widest = (v.at(self.corners) - u.at(self.corners)).max()
            if widest > (second - first) * (1.0 + ROUND):
                return self.edge * (second - first) / widest
        return self.edge

    def _limits_of(self, part, axis):
        """Return the limits (2,) in m of a finer part along an axis, in coordinates of the grid."""
        low, high = extent_along(self.frame, part.box)[axis]
        if axis > 0:
            return low, high
        middle = extent_along(self.frame, part.box)[1:].mean(axis=1)
        x = [each.at((middle - self.middle)[None])[0] for each in self.family]
        return tuple(np.interp([low, high], x, [each.x for each in self.family]))

    def _with_layer(self, axis, line):
        """Return coordinates with the cells of the absorbing layer outside of open sides."""
        steps = np.arange(1, self.cells + 1)
        cells = [line[1] - line[0], line[-1] - line[-2]] if axis == 2 else [self.edge] * 2
        if self.open[axis, 0]:
            self.width[axis, 0] = self.cells * cells[0]
            line = np.concatenate([line[0] - cells[0] * steps[::-1], line])
        if self.open[axis, 1]:
            self.width[axis, 1] = self.cells * cells[1]
            line = np.concatenate([line, line[-1] + cells[1] * steps])
        return line

    def _along(self, q, y, z):
        """Return the place on the first axis of coordinates of the grid at (y, z)."""
        if not any(each.slopes.any() for each in self.family):
            return q
        at = np.stack([np.clip(y, *self.range[1]), np.maximum(z, self.range[2, 0])], axis=-1)
        at, x = at - self.middle, np.array(q)
        for u, v in pairwise(self.family):
            t = (q - u.x) / (v.x - u.x)
            shift = (1.0 - t) * (at @ u.slopes) + t * (at @ v.slopes)
            x = np.where((t >= 0.0) & (t <= 1.0), q + shift, x)
        return x

    def positions(self, grid: np.ndarray) -> np.ndarray:
        """Return the positions (..., 3) in the ground of coordinates (..., 3) of the grid, in m."""
        q, y, z = np.moveaxis(grid, -1, 0)
        if self.surface is not None:
            columns, inverse = np.unique(q.ravel() + 1j * y.ravel(), return_inverse=True)

            def reached(depth):
                heights = self._outcrop(np.real(columns), np.imag(columns), depth)
                return heights[inverse].reshape(q.shape)

            z = self.surface.stretched(z, self.level, reached)
        return np.stack([self._along(q, y, z), y, z], axis=-1) @ self.frame

    def _outcrop(self, q, y, depth):
        """Return the height (n,) in m where lines of the grid lie at a depth, by bisection.

        A line that meets it more than once is refused.
        """

        def excess(z):
            x = np.clip(self._along(q, y, z), *self.range[0])
            horizontal = np.stack([x, np.clip(y, *self.range[1])], axis=-1) @ self.frame[:2, :2]
            return z + depth - self.surface.height(horizontal)

        low = np.full(len(q), self.level)
        if not any(each.slopes.any() for each in self.family):
            return low - excess(low)
        high = np.full(len(q), self.surface.highest + self.edge)
        above = [excess(low + t * (high - low)) > 0.0 for t in np.linspace(0.0, 1.0, HEIGHTS)]
        if (np.diff(np.array(above, dtype=int), axis=0) < 0).any():
            raise NotMapped("the ground surface is steeper than a plane that dips under it")
        for _ in range(BISECTIONS):
            middle = 0.5 * (low + high)
            outside = excess(middle) > 0.0
            low, high = np.where(outside, low, middle), np.where(outside, middle, high)
        return 0.5 * (low + high)

    def mesh(self) -> Mesh:
        """Return the mesh."""
        order = self.order
        counts = [len(axis) for axis in self.axes]
        count = math.prod(n - 1 for n in counts) * order**3
        refuse_beyond_memory(f"mesh: a grid of {count} nodes of hexahedra", count * BYTES_PER_NODE)
        i, j, k = (part.ravel() for part in np.meshgrid(
            *(np.arange(n - 1) for n in counts), indexing="ij"
        ))  # fmt: skip
        corner = (np.arange(8)[:, None] >> np.arange(3)) & 1
        index = np.stack([i, j, k], axis=1)[:, None, :] + corner
        zones = (index[..., 0] * counts[1] + index[..., 1]) * counts[2] + index[..., 2]
        low = np.stack([axis[n] for axis, n in zip(self.axes, (i, j, k), strict=True)], axis=1)
        high = np.stack([axis[n + 1] for axis, n in zip(self.axes, (i, j, k), strict=True)], axis=1)
        lattice = np.stack(np.meshgrid(*self.axes, indexing="ij"), axis=-1).reshape(-1, 3)
        exposed = np.zeros((len(zones), 3, 2), dtype=bool)  # faces beside air
        if self.benches is not None:
            solid = ~self._air(0.5 * (low + high))
            exposed = _exposed(solid.reshape([n - 1 for n in counts]))[solid]
            used, zones = np.unique(zones[solid], return_inverse=True)
            zones, lattice, low, high = zones.reshape(-1, 8), lattice[used], low[solid], high[solid]
        nodes = None
        if self.surface is not None:
            inside = 0.5 * (hexahedra.reference_nodes(order) + 1.0)
            nodes = self.positions(low[:, None] + inside * (high - low)[:, None])
        layers, middle = [*self.geometry.layers, *self.geometry.fills], 0.5 * (low + high)
        group = np.searchsorted(-self.geometry.limits[1:-1], -middle[:, 2])
        for count, part in enumerate(self.fills, start=len(self.geometry.layers)):
            group[((middle > part[:, 0]) & (middle < part[:, 1])).all(axis=1)] = count
        names = list(dict.fromkeys(layer.name for layer in layers))
        number = np.array([names.index(layer.name) for layer in layers])
        layer = layer_beside(self.open, self.range, self.width, self.frame)
        return Mesh(
            self.positions(lattice), zones, number[group], tuple(names),
            self._surfaces(zones, low, high, exposed), order=order, places=nodes, layer=layer,
        )  # fmt: skip

    def _air(self, grid):
        """Return which places (n, 3) of the grid lie above the benches, (n,) bool."""
        at = self.positions(grid) @ self.frame.T
        at[:, 1] = np.clip(at[:, 1], *self.range[1])  # beyond, faces go on along the axis
        return self.benches.air(at @ self.frame)

    def _surfaces(self, zones, low, high, exposed):
        """Return the faces of the sides and of the planes; those of planes of the zone below.

        ``exposed`` (n_zones, 3, 2) are faces at lower and upper ends of axes that lie in the air.
        """
        surfaces = {}
        for axis, names in enumerate(self.names):
            for end, name in enumerate(names):
                edge = (low, high)[end][:, axis]
                at = np.flatnonzero(np.isclose(edge, self.axes[axis][-end], rtol=0, atol=1e-9))
                surfaces[name] = zones[at][:, hexahedra.FACES[2 * axis + end]]
        for axis, end in product(range(3), range(2)):
            beside = zones[exposed[:, axis, end]][:, hexahedra.FACES[2 * axis + end]]
            surfaces["top"] = np.concatenate([surfaces["top"], beside])
        free = ~exposed[..., 1]  # upper faces beside ground that no earlier plane has
        middle = 0.5 * (low + high)
        inside = ((middle > self.range[:, 0]) & (middle < self.range[:, 1])).all(axis=1)
        sets = {part.name for part in self.geometry.joint_sets}  # end at the absorbing layer
        for plane, axis, lower, upper in self.parts:
            q = self._position_of(plane, axis)
            on = np.abs(high[:, axis] - q) <= max(ROUND * np.ptp(self.axes[axis]), 2e-9)
            on &= ((middle > lower) & (middle < upper)).all(axis=1) & free[:, axis]
            on &= inside | (plane.name not in sets)
            free[on, axis] = False
            faces = zones[on][:, hexahedra.FACES[2 * axis + 1]]
            surfaces[plane.name] = np.concatenate([surfaces.get(plane.name, faces[:0]), faces])
        for name in {part[0].name for part in self.parts}:
            if not len(surfaces[name]):
                raise NotMapped(f"{name!r} has no facet in the grid")
        return surfaces

    def _position_of(self, plane, axis):
        """Return the coordinate of a plane on its axis."""
        n, q = self.frame @ plane.normal, self.frame @ plane.point
        at = q[axis] if axis else q[0] - (n[1:] / n[0]) @ (self.middle - q[1:])
        return round(float(at), 9)


def _exposed(solid):
    """Return which faces of the cells (nx, ny, nz) of a grid lie beside cells that are not solid.

    (nx ny nz, 3, 2) bool, by axis, lower and upper end.
    """
    exposed = np.zeros((*solid.shape, 3, 2), dtype=bool)
    for axis in range(3):
        lower, upper = (np.moveaxis(exposed[..., axis, end], axis, 0) for end in range(2))
        air = np.moveaxis(~solid, axis, 0)
        lower[1:], upper[:-1] = air[:-1], air[1:]
    return exposed.reshape(-1, 3, 2)


@dataclass(frozen=True, eq=False)
class _Member:
    """Surface x = x0 + b (y - y0) + c (z - z0) of the family across the first axis."""

    name: str
    x: float
    slopes: np.ndarray

    def at(self, away: np.ndarray) -> np.ndarray:
        """Return its places (n,) on the first axis at (y - y0, z - z0), (n, 2)."""
        return self.x + away @ self.slopes
