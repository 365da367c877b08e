"""Geology (layers, joint sets, faults) and structured grids of tetrahedra."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise, permutations, takewhile
from math import prod
from typing import Any

import numpy as np

from ..errors import InputError
from ..units import check_angle
from . import tetrahedra
from .faces import face_vectors, zone_faces
from .mesh import Mesh
from .quality import GRID_BYTES, refuse_beyond_memory


def upward_normal(dip: float, dip_direction: float) -> np.ndarray:
    """Return the upward unit normal (3,) of a plane.

    Parameters
    ----------
    dip : float, rad, 0 to pi/2
    dip_direction : float, rad, clockwise from north (y)

    Notes
    -----
    ``n = (sin d sin a, sin d cos a, cos d)``.
    """
    steep = np.sin(dip)
    normal = [steep * np.sin(dip_direction), steep * np.cos(dip_direction), np.cos(dip)]
    # Rounding would tilt vertical planes by 1e-16 and cost exact grid coordinates.
    normal = np.where(np.abs(normal) < 1e-15, 0.0, normal)
    return normal / np.linalg.norm(normal)


def _check_orientation(name, dip, dip_direction):
    """Raise InputError where a dip or dip direction is not an angle in radians."""
    if dip is None or not 0.0 <= dip <= np.pi / 2.0 + 1e-12:
        raise InputError(f"{name}.dip: must lie between 0 and pi/2 rad, got {dip}")
    check_angle(f"{name}.dip_direction", dip_direction or 0.0)


_SIDES = {"west": (0, 0), "east": (0, -1), "south": (1, 0), "north": (1, -1)} | {
    "bottom": (2, 0),
    "top": (2, -1),
}
SIDES = tuple(_SIDES)  # lower and upper end of each axis


@dataclass(frozen=True)
class Layer:
    """Layer of ground; layers are listed from the top down.

    Parameters
    ----------
    name : str
    thickness : float or None, m
        None: down to the bottom.
    edge : float or None, m
        Mean edge of its zones; None: that of the whole mesh.
    follows_surface : bool
        Whether it is as thick everywhere under a surveyed surface; else its foot is level.
    """

    name: str
    thickness: float | None = None
    edge: float | None = None
    follows_surface: bool = False

    def __post_init__(self) -> None:
        """Check thickness and edge."""
        for what in ("thickness", "edge"):
            value = getattr(self, what)
            if value is not None and not value > 0.0:
                raise InputError(f"layer {self.name!r}.{what}: must be positive, got {value:g} m")


@dataclass(frozen=True, eq=False)
class Fill:
    """Fill: a box of other ground in the place of layers.

    Parameters
    ----------
    name : str
    box : (3, 2) float64, m
        What of it lies above the ground is nothing.
    """

    name: str
    box: np.ndarray


@dataclass(frozen=True, eq=False)
class JointSet:
    """Joint set: parallel joints at equal spacing.

    Parameters
    ----------
    name : str
    dip, dip_direction : float, rad
    spacing : float, m, normal to the joints
    origin : (3,) float64, m
        A point on one of the joints; None: the centre of the box.
    regions : sequence of str or None
        Names of the layers it cuts; None: all.
    persistence : float
        Fraction of the joint area that is open; the rest is intact rock.
    """

    name: str
    dip: float
    dip_direction: float
    spacing: float
    origin: tuple[float, float, float] | None = None
    regions: tuple[str, ...] | None = None
    persistence: float = 1.0

    def __post_init__(self) -> None:
        """Check the values."""
        _check_orientation(self.name, self.dip, self.dip_direction)
        if not self.spacing > 0.0:
            raise InputError(f"{self.name}.spacing: must be positive, got {self.spacing:g} m")
        if not 0.0 < self.persistence <= 1.0:
            raise InputError(
                f"{self.name}.persistence: must lie between 0 and 1, got {self.persistence:g}"
            )

    @property
    def normal(self) -> np.ndarray:
        """Return the upward unit normal (3,)."""
        return upward_normal(self.dip, self.dip_direction)


@dataclass(frozen=True, eq=False)
class Fault:
    """Fault: a single plane, unbounded or of limited extent.

    Parameters
    ----------
    name : str
    dip, dip_direction : float, rad
        Both, or ``normal`` instead.
    point : (3,) float64, m
        A point on it, the centre of its extent.
    normal : (3,) float64
    extent : tuple of 2 float or None, m
        Full length along strike and down dip; None: unbounded.
    radius : float or None, m
        Radius of a circular fault, meshed as a polygon of the same area; instead of ``extent``.
    polygon : (n, 3) float64 or None, m
        Corners of a convex fracture; several may share a name, and so one joint surface.
    """

    name: str
    dip: float | None = None
    dip_direction: float | None = None
    point: tuple[float, float, float] = (0.0, 0.0, 0.0)
    normal: tuple[float, float, float] | None = None
    extent: tuple[float, float] | None = None
    radius: float | None = None
    polygon: np.ndarray | None = None

    def __post_init__(self) -> None:
        """Check the values."""
        if self.normal is None:
            _check_orientation(self.name, self.dip, self.dip_direction)
        elif not np.linalg.norm(self.normal) > 0.0:
            raise InputError(f"{self.name}.normal: must not be zero")
        if self.normal is None and self.dip_direction is None:
            raise InputError(f"{self.name}.dip_direction: missing; give it with dip, or a normal")
        if self.extent is not None and self.radius is not None:
            raise InputError(f"{self.name}: give extent or radius, not both")
        sizes = (*(self.extent or ()), *(() if self.radius is None else (self.radius,)))
        if any(not size > 0.0 for size in sizes):
            raise InputError(f"{self.name}: extent and radius must be positive, got {sizes} m")

    @property
    def unit_normal(self) -> np.ndarray:
        """Return the upward unit normal (3,)."""
        if self.normal is None:
            return upward_normal(self.dip or 0.0, self.dip_direction or 0.0)
        return np.asarray(self.normal, dtype=float) / np.linalg.norm(self.normal)


def layer_limits(layers: Sequence[Layer], top: float, bottom: float) -> np.ndarray:
    """Return the heights (n_layers + 1,) between the layers, from the top down, in m."""
    limits = [top]
    for number, layer in enumerate(layers):
        last = number == len(layers) - 1
        if layer.thickness is None and not last:
            raise InputError(f"layer {layer.name!r}: only the last layer may take the rest")
        limits.append(bottom if last else limits[-1] - (layer.thickness or 0.0))
    thickness = layers[-1].thickness if len(layers) else None
    if thickness is not None:
        rest = limits[-2] - bottom
        if abs(rest - thickness) > 1e-6 * (top - bottom):
            raise InputError(
                f"layer {layers[-1].name!r}.thickness: must reach the bottom, {rest:g} m are left, "
                f"got {thickness:g} m; leave it out to take the rest"
            )
    if min(-np.diff(limits)) <= 0.0:
        raise InputError(
            f"layers: must be thinner than the model together, {top - bottom:g} m, "
            f"but {top - limits[-2]:g} m lie above the last one"
        )
    return np.array(limits)


@dataclass(frozen=True, eq=False)
class Geometry:
    """Geometry that a mesh is asked for: box, layers, planes, surface, sides that stand.

    Parameters
    ----------
    box : (3, 2) float64, m
    layers : tuple of Layer, from the top down
    joint_sets : tuple of JointSet
    faults : tuple of Fault
    surface : (n, 3) or (n, 3, 3) float64 or None, m
        Surveyed top surface, positions or triangles; None: the top of the box.
    standing : frozenset of str
        Sides that may not move: free, fixed and input faces. A mesh may reach beyond the others,
        where the ground goes on in an absorbing layer.
    benches : tuple of ((n, 3) float64, (m, 3) float64), m
        Crest and toe of the benches whose triangles the surface is, from the highest down, each
        walked so that the lower ground lies on the right.
    fills : tuple of Fill
        Of one name and place each.
    """

    box: np.ndarray
    layers: tuple[Layer, ...]
    joint_sets: tuple[JointSet, ...] = ()
    faults: tuple[Fault, ...] = ()
    surface: np.ndarray | None = None
    standing: frozenset[str] = frozenset(SIDES)
    benches: tuple[tuple[np.ndarray, np.ndarray], ...] = ()
    fills: tuple[Fill, ...] = ()

    def __post_init__(self) -> None:
        """Check the layers and the names of the sides."""
        layer_limits(self.layers, *self.box[2, ::-1])
        following = [layer.follows_surface for layer in self.layers]
        if any(following[len(self.depths) :]):
            name = self.layers[following.index(True, len(self.depths))].name
            raise InputError(
                f"layer {name!r}.follows_surface: must stand in all layers above it, too, and not "
                "in the last one"
            )
        for part in self.joint_sets:
            cut = [layer.name in (part.regions or [layer.name]) for layer in self.layers]
            if not all(cut) and any(cut[: len(self.depths)]):
                raise InputError(
                    f"{part.name}.regions: must leave out the layers that follow the surface, or "
                    "name all layers"
                )
        for fill in self.fills:
            if (fill.box[:, 0] >= self.box[:, 1]).any() or (fill.box[:, 1] <= self.box[:, 0]).any():
                raise InputError(f"fill {fill.name!r}.box: lies outside of the model")
        for first, second in combinations(self.fills, 2):
            lowest = np.maximum(first.box[:, 0], second.box[:, 0])
            overlap = (lowest < np.minimum(first.box[:, 1], second.box[:, 1])).all()
            if first.name == second.name or overlap:
                raise InputError(
                    f"fills {first.name!r} and {second.name!r}: must have materials and places of "
                    "their own"
                )
        if not self.standing <= set(SIDES):
            raise InputError(f"standing: must be of {', '.join(SIDES)}, got {self.standing}")

    @property
    def limits(self) -> np.ndarray:
        """Heights (n_layers + 1,) in m between the layers, from the top down."""
        return layer_limits(self.layers, *self.box[2, ::-1])

    @property
    def depths(self) -> np.ndarray:
        """Depths (n,) in m under the surface of the feet of layers that follow it, downward."""
        following = takewhile(lambda layer: layer.follows_surface, self.layers[:-1])
        return np.cumsum([layer.thickness or 0.0 for layer in following])

    @property
    def levels(self) -> np.ndarray:
        """Heights (n,) in m between layers that do not follow the surface, from the top down."""
        return self.limits[1 + len(self.depths) : -1]

    @property
    def open_sides(self) -> tuple[str, ...]:
        """Sides where the ground goes on."""
        return tuple(side for side in SIDES if side not in self.standing)


_AXES = {"x": 0, "y": 1, "z": 2}
GROWTH = 1.08  # of cells outside the region of interest
_PER_BOX = {"kuhn": 6, "alternating": 5, "centred": 12}


def structured_box(
    *grid: Any,
    group: str = "rock",
    layers: Sequence[Layer] | None = None,
    planes: dict[str, tuple[str, Any]] | None = None,
    pattern: str = "kuhn",
    order: int = 1,
) -> Mesh:
    """Generate a structured mesh: a grid of boxes, cut into tetrahedra or spectral hexahedra.

    Parameters
    ----------
    *grid : (shape, size) or (xs, ys, zs)
        Numbers of boxes along x, y, z and the lengths (3,) in m, from the origin; or the grid
        coordinates in m, ascending.
    group : str
        Name of the only group if no layers are given.
    layers : sequence of Layer
        From the top down; their boundaries must be grid planes.
    planes : dict of str to (axis, place or places)
        Joint surfaces on grid planes, such as ``{"J1": ("x", 93.0)}``.
    pattern : {"kuhn", "alternating", "centred"}
        Six tetrahedra around one diagonal of every box; five, mirrored from box to box; or twelve
        around a node at the centre, shared with neighbouring boxes and the closest to regular.
    order : int
        2 to 8: the boxes are spectral hexahedra of this order; 1: tetrahedra.

    Returns
    -------
    Mesh
        Not split; outer surfaces west, east, south, north, bottom, top.

    Raises
    ------
    InputError
        If coordinates do not ascend, a plane or layer boundary is not on the grid, or the grid does
        not fit into memory.

    Examples
    --------
    >>> mesh = structured_box((2, 1, 1), (20.0, 10.0, 10.0), planes={"J": ("x", 10.0)})
    >>> len(mesh.zones), mesh.split(["J"]).contacts.area.sum().round(6).item()
    (12, 100.0)
    """
    axes = _grid_axes(grid)
    if pattern not in _PER_BOX:
        raise InputError(f"pattern: must be 'kuhn', 'alternating' or 'centred', got {pattern!r}")
    count = prod(len(axis) - 1 for axis in axes) * (_PER_BOX[pattern] if order == 1 else 1)
    refuse_beyond_memory(f"structured_box: a grid of {count} zones", count * GRID_BYTES)
    layers = layers or [Layer(group)]
    limits = layer_limits(layers, axes[2][-1], axes[2][0])
    for layer, limit in zip(layers, limits[1:], strict=True):
        _on_grid(axes[2], limit, layer.name)
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    points = np.swapaxes(points, 0, 2).reshape(-1, 3)
    if order > 1:
        zones = _boxes([len(axis) for axis in axes])
    elif pattern == "centred":
        cuts = [*(planes or {}).values(), ("z", limits)]
        points, zones = _centred_zones(axes, points, cuts)
    else:
        zones = _grid_zones([len(axis) for axis in axes], pattern)
    faces = zone_faces(zones)
    surfaces = {
        name: _plane_faces(points, faces, axis, axes[axis][end], end == 0)
        for name, (axis, end) in _SIDES.items()
    }
    for name, (letter, places) in (planes or {}).items():
        axis = _AXES[letter]
        parts = [
            _plane_faces(points, faces, axis, _on_grid(axes[axis], position, name), False)
            for position in np.atleast_1d(places)
        ]
        surfaces[name] = np.concatenate(parts)
    height = points[zones].mean(axis=1)[:, 2]
    zone_group = np.searchsorted(-limits[1:-1], -height)
    names = tuple(layer.name for layer in layers)
    return Mesh(points, zones, zone_group, names, surfaces, order=order)


def _grid_axes(grid):
    """Return the three coordinate arrays of a grid given by shape and size or by coordinates."""
    if len(grid) == 2:
        shape, size = grid
        if min(shape) < 1 or not min(size) > 0.0:
            raise InputError(
                f"structured_box: shape and size must be positive, got {shape}, {size}"
            )
        return [np.linspace(0.0, length, n + 1) for n, length in zip(shape, size, strict=True)]
    if len(grid) != 3:
        raise InputError(f"structured_box: give shape and size or xs, ys, zs, got {len(grid)}")
    axes = [np.asarray(axis, dtype=float) for axis in grid]
    for letter, axis in zip("xyz", axes, strict=True):
        if len(axis) < 2 or not (np.diff(axis) > 0.0).all():
            raise InputError(f"structured_box.{letter}s: must ascend and hold two values or more")
    return axes


def _on_grid(axis, position, name):
    """Return the grid coordinate at a position; raise InputError if there is none."""
    nearest = axis[np.argmin(np.abs(axis - position))]
    if abs(nearest - position) > 1e-9 * (axis[-1] - axis[0]):
        raise InputError(
            f"structured_box: {name!r} at {position:g} m must be on the grid; the nearest is "
            f"{nearest:g} m"
        )
    return nearest


def _plane_faces(points, faces, axis, position, low):
    """Return the faces on a grid plane of the zones below it, or above if ``low``."""
    on_plane = points[:, axis] == position
    flat = on_plane[faces].all(axis=1)
    normals = face_vectors(points, faces[flat])[:, axis]
    return faces[flat][(normals < 0.0) if low else (normals > 0.0)]


def _grid_zones(counts, pattern):
    """Return the tetrahedra of a grid with ``counts`` nodes along each axis."""
    corners = _boxes(counts)
    cells = _cells(counts)
    if pattern == "kuhn":
        return corners[:, kuhn_zones()].reshape(-1, 4)
    even = np.array([[1, 2, 4, 7], [0, 1, 2, 4], [3, 2, 1, 7], [5, 4, 7, 1], [6, 7, 4, 2]])
    odd = (even ^ 1)[:, [0, 2, 1, 3]]
    mirrored = cells.sum(axis=1) % 2 == 1
    zones = np.where(mirrored[:, None, None], corners[:, odd], corners[:, even])
    return zones.reshape(-1, 4)


def _cells(counts):
    """Return the indices (n, 3) along the axes of the boxes of a grid."""
    cells = np.stack(np.meshgrid(*(np.arange(n - 1) for n in counts), indexing="ij"), axis=-1)
    return np.swapaxes(cells, 0, 2).reshape(-1, 3)


def _boxes(counts):
    """Return the corners (n, 8) of the boxes of a grid, in the order of `hexahedra`."""
    nx, ny, _ = counts
    cells = _cells(counts)
    first = cells[:, 0] + nx * (cells[:, 1] + ny * cells[:, 2])
    steps = np.array([x + nx * (y + ny * z) for z in (0, 1) for y in (0, 1) for x in (0, 1)])
    return first[:, None] + steps


def kuhn_zones():
    """Return the six tetrahedra (6, 4) around the diagonal 0-7 of a box; corner bits are z y x."""
    zones = []
    for a, b, _ in permutations(range(3)):
        odd = (b - a) % 3 == 2
        middle = (1 << a, (1 << a) | (1 << b))
        zones.append([0, *(middle[::-1] if odd else middle), 7])
    return np.array(zones)


def _centred_zones(axes, points, cuts):
    """Return points including the centres of boxes, and zones between centres and faces.

    Four zones lie around each face between two boxes; faces on the boundary, on joints or between
    layers, given by (axis letter, places), have two zones on each side instead.
    """
    counts = np.array([len(axis) for axis in axes])
    number = np.arange(counts.prod()).reshape(counts[::-1]).transpose(2, 1, 0)
    centre = len(points) + np.arange((counts - 1).prod()).reshape(counts - 1)
    middles = [0.5 * (axis[1:] + axis[:-1]) for axis in axes]
    centres = np.stack(np.meshgrid(*middles, indexing="ij"), axis=-1).reshape(-1, 3)
    zones = []
    for axis in range(3):
        corner = np.moveaxis(number, axis, 0)
        box = np.moveaxis(centre, axis, 0)
        face = [corner[:, :-1, :-1], corner[:, 1:, :-1], corner[:, 1:, 1:], corner[:, :-1, 1:]]
        odd = np.indices(box.shape[1:]).sum(axis=0) % 2 == 1
        turned = [np.where(odd, face[k], face[(k + 1) % 4]) for k in range(4)]
        cut = np.isin(np.arange(counts[axis]), [0, counts[axis] - 1])
        for letter, places in cuts:
            if _AXES[letter] == axis:
                cut |= np.abs(axes[axis][:, None] - np.atleast_1d(places)).min(axis=1) < 1e-9
        inside = np.flatnonzero(~cut)
        for k in range(4):
            sides = (face[k][inside], face[(k + 1) % 4][inside])
            zones.append(np.stack([box[inside - 1], box[inside], *sides], axis=-1))
        for at, ahead in ((np.flatnonzero(cut)[1:], 1), (np.flatnonzero(cut)[:-1], 0)):
            for others in ((1, 2), (2, 3)):
                sides = [turned[0][at], *(turned[k][at] for k in others)]
                zones.append(np.stack([box[at - ahead], *sides], axis=-1))
    points = np.concatenate([points, centres])
    zones = np.concatenate([part.reshape(-1, 4) for part in zones])
    turned = tetrahedra.volumes(points, zones) < 0.0
    zones[turned] = zones[turned][:, [0, 2, 1, 3]]
    return points, zones


def graded_axis(
    limits: Sequence[float],
    anchors: Iterable[float],
    edge: float,
    before: float,
    after: float,
    growth: float = GROWTH,
) -> np.ndarray:
    """Return graded coordinates: equal cells between limits and anchors, growing cells outside.

    Parameters
    ----------
    limits : (2,) float, m
    anchors : sequence of float, m
        Required coordinates; those outside the limits are ignored.
    edge : float, m
        Largest cell between two anchors.
    before, after : float, m
        Length of the grid outside the limits.
    growth : float
        Ratio of successive cells outside.
    """
    inside = sorted({float(a) for a in anchors if limits[0] < a < limits[1]})
    stops = [float(limits[0]), *inside, float(limits[1])]
    pieces = [
        np.linspace(low, high, max(1, int(np.ceil((high - low) / edge - 1e-9))) + 1)[:-1]
        for low, high in pairwise(stops)
    ]

    def outside(distance):
        steps, size = [], edge
        while distance > 0.0 and sum(steps) < distance:
            size *= growth
            steps.append(size)
        return np.cumsum(steps)

    low, high = stops[0] - outside(before)[::-1], stops[-1] + outside(after)
    return np.concatenate([low, *pieces, [stops[-1]], high])
