"""Ground of spectral hexahedra: a grid turned to the strike, sheared along a dip, draped.

It takes layers, horizontal and upright planes in two directions, and one family of parallel dipping
planes. Coordinates of the grid are those of the ground turned about the vertical: the first axis
points down the dip.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.interpolate import LinearNDInterpolator, NearestNDInterpolator

from ..errors import InputError
from . import hexahedra
from .faces import sides
from .grid import Fault, JointSet, Layer, layer_limits
from .hexahedra import AbsorbingLayer
from .mesh import Mesh
from .quality import refuse_beyond_memory

SIDES = ("west", "east", "south", "north", "bottom", "top")
LAYER_CELLS = 2  # of the absorbing layer
SHRINKING = 2.0  # shears of the whole height: least distance of the last dipping plane to a side
WIDE = 1.15  # largest cell at the wide end of a blended interval, over the wanted edge
MARGIN = 0.3  # of a cell, between sources or receivers and the absorbing layer
PARALLEL = 1e-6  # sine of the angle between planes or directions that count as parallel
ROUND = 1e-9  # of the size: coordinates that count as equal
DRAPING = 40  # iterations for nodes that lie on inclined lines under a surveyed surface
BYTES_PER_NODE = 500.0


class NotMapped(InputError):
    """The ground can't be a mapped grid of hexahedra; the message says what stands in the way."""


@dataclass(frozen=True, eq=False)
class _Plane:
    """Plane of the grid: its axis, its place there at the top, and the open part of it."""

    name: str
    axis: int
    position: float
    low: np.ndarray  # limits (3,) in coordinates of the grid
    high: np.ndarray
    layers: tuple[str, ...] | None


def build_hexahedra(
    box: np.ndarray,
    layers: Sequence[Layer],
    joint_sets: Sequence[JointSet] = (),
    faults: Sequence[Fault] = (),
    *,
    sizes: Sequence[float],
    order: int,
    open_sides: Sequence[str] = (),
    within: np.ndarray | None = None,
    surface: np.ndarray | None = None,
) -> Mesh:
    """Build the mesh of a box of layers cut by planes, of spectral hexahedra, not split.

    Parameters
    ----------
    box : (3, 2) float64, m
    layers : sequence of Layer, from the top down
    joint_sets : sequence of JointSet
    faults : sequence of Fault
    sizes : sequence of float, m
        Largest edge of the hexahedra of each layer.
    order : int
        Of the polynomials, 2 to 8.
    open_sides : sequence of str
        Sides where the ground goes on: an absorbing layer of two hexahedra stands outside of them.
    within : (n, 3) float64, m
        Sources and receivers. If the grid is turned and all four sides are open, it covers these
        instead of the whole box.
    surface : (n, 3) float64, m
        Surveyed top surface; the grid is stretched between the bottom and this surface.

    Raises
    ------
    NotMapped
        If the planes do not fit into one grid.
    InputError
        If a layer is impossible or the mesh larger than the memory.

    Examples
    --------
    >>> mesh = build_hexahedra(
    ...     np.array([[0.0, 40.0], [0.0, 40.0], [-20.0, 0.0]]), [Layer("rock")],
    ...     faults=[Fault("F", 1.0, 0.5, (20.0, 20.0, 0.0))], sizes=[20.0], order=4,
    ...     open_sides=["west", "east", "south", "north", "bottom"],
    ... )  # fmt: skip
    >>> mesh.groups, len(mesh.split(["F"]).contacts.names)
    (('rock',), 1)
    """
    box = np.asarray(box, dtype=float)
    limits = layer_limits(layers, box[2, 1], box[2, 0])
    frame, dip = _frame(joint_sets, faults)
    _refuse_parts(joint_sets, faults)
    lateral = SIDES[:4]
    turned = np.abs(frame[0, :2] @ frame[0, :2][::-1]) > PARALLEL
    if turned and not set(lateral) <= set(open_sides):
        raise NotMapped("the strike of its planes is oblique to sides where the model ends")
    slope = 0.0 if dip is None else 1.0 / np.tan(dip)
    inner = _inner(box, frame, within if turned else None, min(sizes))
    planes = _planes(joint_sets, faults, box, inner, frame, dip)
    ends = [end for end, side in _looking(frame).items() if side in open_sides]
    grid = _Grid(inner, slope, planes, limits, np.asarray(sizes, dtype=float), ends)
    count = np.prod([len(axis) - 1 for axis in grid.axes]) * order**3
    refuse_beyond_memory(f"mesh: a grid of {count} nodes of hexahedra", count * BYTES_PER_NODE)
    return grid.mesh(order, layers, limits, planes, frame, surface)


def _frame(sets, faults):
    """Return the axes (3, 3) of the grid and the dip in rad of its dipping planes, or None."""
    normals = [part.normal for part in sets] + [fault.unit_normal for fault in faults]
    names = [part.name for part in (*sets, *faults)]
    dipping = [
        (name, n) for name, n in zip(names, normals, strict=True)
        if np.hypot(*n[:2]) > PARALLEL and abs(n[2]) > PARALLEL
    ]  # fmt: skip
    steep = [(name, n) for name, n in zip(names, normals, strict=True) if abs(n[2]) <= PARALLEL]
    first = np.array([1.0, 0.0])
    if dipping or steep:
        first = (dipping or steep)[0][1][:2]
        first = first / np.hypot(*first)
        if not dipping and abs(first[0] * first[1]) <= PARALLEL:
            first = np.array([1.0, 0.0])
    for name, normal in dipping[1:]:
        if np.linalg.norm(np.cross(normal, dipping[0][1])) > PARALLEL:
            raise NotMapped(f"{dipping[0][0]!r} and {name!r} dip in different ways")
    for name, normal in steep:
        along, across = abs(first @ normal[:2]), abs(first[0] * normal[1] - first[1] * normal[0])
        if min(along, across) > PARALLEL:
            raise NotMapped(f"the upright {name!r} is oblique to the other planes")
        if dipping and across <= PARALLEL:
            raise NotMapped(f"the upright {name!r} has the strike of dipping planes")
    x, y = first
    frame = np.array([[x, y, 0.0], [-y, x, 0.0], [0.0, 0.0, 1.0]])
    if not dipping:
        return frame, None
    normal = dipping[0][1] * np.sign(dipping[0][1][2])
    return frame, float(np.arctan2(np.hypot(*normal[:2]), normal[2]))


def _looking(frame):
    """Return the side of the ground at which each end of the axes of a grid looks."""
    named = {}
    for number, end in enumerate(SIDES):
        along = frame[number // 2] * (1.0 if number % 2 else -1.0)
        axis = int(np.abs(along).round(6).argmax())
        named[end] = SIDES[2 * axis + int(along[axis] > 0.0)]
    return named


def _refuse_parts(sets, faults):
    """Raise NotMapped for planes of which only scattered or round parts are open."""
    for part in sets:
        if part.persistence < 1.0:
            raise NotMapped(f"{part.name!r} has intact parts (persistence below 1)")
    for fault in faults:
        if fault.radius is not None:
            raise NotMapped(f"{fault.name!r} is circular")


def _inner(box, frame, within, size):
    """Return the limits (3, 2) of the model along the axes of the grid."""
    corners = np.array([[x, y] for x in box[0] for y in box[1]]) @ frame[:2, :2].T
    inner = np.column_stack([corners.min(axis=0), corners.max(axis=0)])
    if within is not None and len(within):
        along = np.asarray(within, dtype=float)[:, :2] @ frame[:2, :2].T
        margin = MARGIN * size
        low, high = along.min(axis=0) - margin, along.max(axis=0) + margin
        inner = np.column_stack([np.maximum(inner[:, 0], low), np.minimum(inner[:, 1], high)])
    return np.vstack([inner, box[2]])


def _planes(sets, faults, box, inner, frame, dip):
    """Return the planes of the grid that cut the model."""
    planes = []
    for fault in faults:
        axis = _axis(fault.unit_normal, frame)
        point = frame @ np.asarray(fault.point, dtype=float)
        low, high = np.full(3, -np.inf), np.full(3, np.inf)
        if fault.extent is not None:
            low, high = _extent(fault, axis, point)
        planes.append(_Plane(fault.name, axis, _at_top(point, axis, dip, inner), low, high, None))
    corners = np.array([[x, y, z] for x in box[0] for y in box[1] for z in box[2]])
    centre = box.mean(axis=1)
    turned = (frame @ corners.T).T
    low, high = turned.min(axis=0) - 1e-6, turned.max(axis=0) + 1e-6
    for part in sets:
        axis, normal = _axis(part.normal, frame), part.normal
        origin = np.asarray(centre if part.origin is None else part.origin, dtype=float)
        reach = (corners - origin) @ normal / part.spacing
        for k in range(int(np.ceil(reach.min() + 1e-6)), int(np.floor(reach.max() - 1e-6)) + 1):
            point = frame @ (origin + k * part.spacing * normal)
            if axis == 2:
                point = frame @ (origin + k * part.spacing * np.array([0.0, 0.0, 1.0]))
            top = _at_top(point, axis, dip, inner)
            planes.append(_Plane(part.name, axis, top, low, high, part.regions))
    return planes


def _axis(normal, frame):
    """Return the axis of the grid that a plane cuts."""
    if np.hypot(*normal[:2]) <= PARALLEL:
        return 2
    across = abs(frame[0] @ normal)
    return 0 if across > abs(frame[1] @ normal) else 1


def _at_top(point, axis, dip, inner):
    """Return the place on its axis where a plane through a point meets the top of the model."""
    if axis != 0 or dip is None:
        return float(point[axis])
    return float(point[0] + (point[2] - inner[2, 1]) / np.tan(dip))


def _extent(fault, axis, point):
    """Return the limits of a fault of limited extent in coordinates of the grid."""
    low, high = np.full(3, -np.inf), np.full(3, np.inf)
    along, down = fault.extent
    if axis == 2:
        raise NotMapped(f"{fault.name!r} is horizontal and of limited extent")
    strike = 1 - axis
    sine = np.hypot(*fault.unit_normal[:2])
    low[strike], high[strike] = point[strike] - 0.5 * along, point[strike] + 0.5 * along
    low[2], high[2] = point[2] - 0.5 * down * sine, point[2] + 0.5 * down * sine
    return low, high


class _Grid:
    """Coordinates of a grid along its three axes, and the map from these to the ground."""

    def __init__(self, inner, slope, planes, limits, sizes, open_sides):
        """Place the planes of the grid and divide the distances between them."""
        self.inner, self.slope = inner.copy(), slope
        height = inner[2, 1] - inner[2, 0]
        self.shift = slope * height
        places = [
            sorted({round(p.position, 9) for p in planes if p.axis == axis}) for axis in range(3)
        ]
        size = float(min(sizes))
        if self.shift and places[0]:
            beside = max(self.shift + size, SHRINKING * self.shift)
            low, high = places[0][0] - size, places[0][-1] + beside
            self.inner[0] = min(self.inner[0, 0], low), max(self.inner[0, 1], high)
        self.sheared = np.array(places[0]) if self.shift else np.zeros(0)
        ends = [
            [v for p in planes for v in (p.low[k], p.high[k]) if np.isfinite(v)] for k in range(3)
        ]
        if any(p.layers for p in planes) or any(len(e) for e in ends):
            ends = [e if any(p.axis != k for p in planes) else [] for k, e in enumerate(ends)]
        self.width = np.ones((3, 2))
        axes = []
        for axis in range(3):
            low, high = self.inner[axis]
            anchors = [low, *places[axis], *(ends[axis] if axis else []), high]
            if axis == 2:
                anchors += list(limits)
            anchors = _distinct([v for v in anchors if low <= v <= high], low, high)
            steps = [
                self._step(axis, first, second, limits, sizes)
                for first, second in pairwise(anchors)
            ]
            parts = [
                np.linspace(first, second, n + 1)[:-1]
                for (first, second), n in zip(pairwise(anchors), steps, strict=True)
            ]
            line = np.concatenate([*parts, [high]])
            axes.append(self._with_layer(axis, line, open_sides, size))
        self.axes = axes
        self.open = np.array(
            [[name in open_sides for name in SIDES[2 * k : 2 * k + 2]] for k in range(3)]
        )

    def _step(self, axis, first, second, limits, sizes):
        """Return the number of cells between two planes."""
        if axis == 2:
            middle = 0.5 * (first + second)
            layer = int(np.searchsorted(-limits[1:-1], -middle))
            return max(1, int(np.ceil((second - first) / sizes[layer] - 0.05)))
        length = second - first
        if axis == 0 and len(self.sheared):  # the blended intervals grow or shrink downwards
            growth = self._share(second) - self._share(first)
            length = max(length, length + growth * self.shift) / WIDE
        return max(1, int(np.ceil(length / min(sizes) - 0.05)))

    def _with_layer(self, axis, line, open_sides, size):
        """Return coordinates with the cells of the absorbing layer outside of open sides."""
        low, high = SIDES[2 * axis : 2 * axis + 2]
        steps = np.arange(1, LAYER_CELLS + 1)
        if low in open_sides:
            cell = line[1] - line[0] if axis == 2 else size
            self.width[axis, 0] = LAYER_CELLS * cell
            line = np.concatenate([line[0] - cell * steps[::-1], line])
        if high in open_sides:
            cell = line[-1] - line[-2] if axis == 2 else size
            self.width[axis, 1] = LAYER_CELLS * cell
            line = np.concatenate([line, line[-1] + cell * steps])
        return line

    def _share(self, along):
        """Return the share of the shear at places on the first axis: 1 between dipping planes."""
        if not len(self.sheared):
            return np.zeros_like(np.asarray(along, dtype=float))
        low, high = self.inner[0]
        return np.interp(along, [low, self.sheared[0], self.sheared[-1], high], [0, 1, 1, 0])

    def places(self, grid, surface):
        """Return the positions (..., 3), still turned, of coordinates (..., 3) of the grid."""
        x, y, z = np.moveaxis(grid, -1, 0)
        share, bottom, top = self._share(x), self.inner[2, 0], self.inner[2, 1]
        height = z.copy()
        for _ in range(DRAPING if surface is not None else 1):
            along = x + share * self.slope * (top - np.maximum(height, bottom))
            if surface is None:
                break
            ground = surface(np.clip(along, *self.inner[0]), np.clip(y, *self.inner[1]))
            stretch = (ground - bottom) / (top - bottom)
            height = np.where(z > bottom, bottom + (z - bottom) * stretch, z)
        return np.stack([along, y, height], axis=-1)

    def mesh(self, order, layers, limits, planes, frame, surface):
        """Return the mesh."""
        counts = [len(axis) for axis in self.axes]
        i, j, k = (part.ravel() for part in np.meshgrid(
            *(np.arange(n - 1) for n in counts), indexing="ij"
        ))  # fmt: skip
        corner = (np.arange(8)[:, None] >> np.arange(3)) & 1
        index = np.stack([i, j, k], axis=1)[:, None, :] + corner
        zones = (index[..., 0] * counts[1] + index[..., 1]) * counts[2] + index[..., 2]
        low = np.stack([axis[n] for axis, n in zip(self.axes, (i, j, k), strict=True)], axis=1)
        high = np.stack([axis[n + 1] for axis, n in zip(self.axes, (i, j, k), strict=True)], axis=1)
        drape = None if surface is None else _drape(surface, frame)
        lattice = np.stack(np.meshgrid(*self.axes, indexing="ij"), axis=-1).reshape(-1, 3)
        points = self.places(lattice, drape) @ frame
        nodes = None
        if drape is not None or len(self.sheared):
            inside = 0.5 * (hexahedra.reference_nodes(order) + 1.0)
            grid = low[:, None] + inside * (high - low)[:, None]
            nodes = self.places(grid, drape) @ frame
        group = np.searchsorted(-limits[1:-1], -0.5 * (low + high)[:, 2])
        names = list(dict.fromkeys(layer.name for layer in layers))
        number = np.array([names.index(layer.name) for layer in layers])
        surfaces = self._surfaces(planes, points, zones, low, high, layers, group)
        layer = None
        if self.open.any():
            inner = np.where(self.open, self.inner, [-np.inf, np.inf])
            limits, widths, axes = (tuple(map(tuple, part)) for part in (inner, self.width, frame))
            layer = AbsorbingLayer(limits, widths, axes)
        return Mesh(
            points, zones, number[group], tuple(names), surfaces,
            order=order, places=nodes, layer=layer,
        )  # fmt: skip

    def _surfaces(self, planes, points, zones, low, high, layers, group):
        """Return the faces of the sides and of the planes; those of planes of the zone below."""
        surfaces: dict[str, np.ndarray] = sides(points, zones)
        group_names = np.array([layer.name for layer in layers])[group]
        free = np.ones((len(zones), 3), dtype=bool)  # upper faces that no earlier plane has
        for plane in planes:
            tolerance = ROUND * np.ptp(self.axes[plane.axis])
            on = np.abs(high[:, plane.axis] - plane.position) <= max(tolerance, 2e-9)
            middle = 0.5 * (low + high)
            for axis in range(3):
                if axis != plane.axis:
                    here = middle[:, axis]
                    on &= (here > plane.low[axis]) & (here < plane.high[axis])
            if plane.layers is not None:
                on &= np.isin(group_names, plane.layers)
            on &= free[:, plane.axis]
            free[on, plane.axis] = False
            faces = zones[on][:, hexahedra.FACES[2 * plane.axis + 1]]
            surfaces[plane.name] = np.concatenate([surfaces.get(plane.name, faces[:0]), faces])
        for name in {plane.name for plane in planes}:
            if not len(surfaces[name]):
                raise NotMapped(f"no line of the grid meets {name!r}")
        return surfaces


def _distinct(values, low, high):
    """Return sorted values without those that differ by rounding."""
    values = np.sort(np.asarray(values, dtype=float))
    apart = np.diff(values, prepend=-np.inf) > ROUND * (high - low)
    return values[apart]


def _drape(surface, frame):
    """Return a function from turned coordinates to the height of a surveyed surface."""
    places = np.asarray(surface, dtype=float)
    turned = places[:, :2] @ frame[:2, :2].T
    inside = LinearNDInterpolator(turned, places[:, 2])
    outside = NearestNDInterpolator(turned, places[:, 2])

    def height(x, y):
        value = inside(x, y)
        return np.where(np.isnan(value), outside(x, y), value)

    return height
