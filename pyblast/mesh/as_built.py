"""As-built survey of a mesh: sides, planes, layers and positions, from its nodes and facets.

A row compares what was asked for with what stands in the mesh, inside the box and so without the
absorbing layer. It shares nothing with the builders.
"""

from collections.abc import Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from itertools import pairwise
from types import MappingProxyType

import numpy as np
import scipy
from numpy.typing import ArrayLike

from . import hexahedra
from .faces import pair_faces, zone_faces, zone_of_face
from .grid import SIDES, Geometry, layer_limits
from .mesh import (
    Mesh,
    graph_components,
    locate_in_zones,
    surface_faces,
    zone_edge_lengths,
    zone_volumes,
)

OF_AREA = 0.01  # tolerance of areas, relative
OF_WAVE = 0.02  # of lengths, over the shortest wavelength
DEGREES = 0.5  # of angles
OF_EDGE = 0.1  # of positions, over the distance of nodes there
EXACT = 1e-6  # m
OF_ROUGHNESS = 5.0  # over the tolerance of lengths: a tenth of the wavelength
RASTER = 400  # heights of a surface along each side of the box
SAMPLES = 200  # of a plane under a surface, along strike and dip
OF_SCATTERED = 0.1  # of the area of many fractures, or of joints with intact parts
DISC_SIDES = 12  # of the polygon that stands for a disc
WAYS = ("west", "east"), ("south", "north"), ("below", "above")


@dataclass(frozen=True)
class Row:
    """Row of an as-built survey: one quantity, as asked for and as built.

    Parameters
    ----------
    name : str
        Side, joint, layer boundary, receiver or source.
    quantity : str
        With its unit.
    asked : float or None
        None where nothing was asked for.
    built : float or str
    tolerance : float or None
        None: not judged.
    """

    name: str
    quantity: str
    asked: float | None
    built: float | str
    tolerance: float | None = None

    @property
    def good(self) -> bool:
        """Whether the ground is as asked for."""
        if self.tolerance is None or self.asked is None or isinstance(self.built, str):
            return True
        return bool(abs(self.built - self.asked) <= self.tolerance + EXACT)

    def __str__(self) -> str:
        """Return both figures in words."""
        asked = "" if self.asked is None else f"asked {self.asked:.6g}, "
        built = self.built if isinstance(self.built, str) else f"{self.built:.6g}"
        within = "" if self.tolerance is None else f" (tolerance {self.tolerance:.3g})"
        return f"{self.name}, {self.quantity}: {asked}built {built}{within}"


def as_built(
    mesh: Mesh,
    asked: Geometry | None,
    wavelength: float = np.inf,
    positions: Mapping[str, Sequence[float]] = MappingProxyType({}),
) -> tuple[Row, ...]:
    """Survey the ground of a mesh.

    Parameters
    ----------
    mesh : Mesh
        Not split.
    asked : Geometry or None
        What it was asked for; None for a mesh that was read, whose joints are described.
    wavelength : float, m
        The shortest of S waves of interest, for the tolerance of lengths.
    positions : dict of str to (2 or 3,) float, m
        Of sources and receivers. The ground under those that stand on it is judged, and whether
        those below it lie in the mesh; without a height they stand on the ground.

    Returns
    -------
    tuple of Row
    """
    if asked is None:
        return tuple(_inner_surfaces(mesh))
    return tuple(_ground(mesh, asked, OF_WAVE * wavelength, positions))


def positions_as_built(
    mesh: Mesh, asked: Geometry | None, positions: Mapping[str, ArrayLike]
) -> tuple[Row, ...]:
    """Survey where sources and receivers stand in a mesh.

    Parameters
    ----------
    mesh : Mesh
        Split.
    asked : Geometry or None
        With the layers below the positions.
    positions : dict of str to (3,) float64, m

    Returns
    -------
    tuple of Row
    """
    if not positions:
        return ()
    at = np.array([*positions.values()], dtype=float)
    moved, zones = _moved(mesh, at)
    names = () if mesh.contacts is None else mesh.contacts.names
    joints = {joint: _facets(mesh, joint)[0] for joint in names}
    levels, top = [], np.zeros((0, 3, 3))
    if asked is not None and len(asked.layers) > 1:
        top = _facets(mesh, "top")[0]
        levels = [
            (lower, height, depth, _of_faces(mesh, _boundaries(mesh, upper, lower))[0])
            for upper, lower, height, depth in _levels(asked)
        ]
    rows, edges = [], zone_edge_lengths(mesh).mean(axis=1)
    for name, position, away, zone in zip(positions, at, moved, zones, strict=True):
        apart = float(edges[zone]) / mesh.order
        rows.append(Row(name, "moved, m", 0.0, float(away), OF_EDGE * apart))
        rows.append(Row(name, "ground", None, mesh.groups[mesh.zone_group[zone]]))
        rows += _depths(name, position, levels, top)
        middle = mesh.points[mesh.zones[zone]].mean(axis=0)
        for joint, triangles in joints.items():
            side = _side_of(triangles, position, middle)
            rows += [Row(name, f"side of {joint}, on which it lies", None, side)] if side else []
    return tuple(rows)


def _ground(mesh, asked, short, positions) -> Iterator[Row]:
    """Yield the rows of sides, planes, layer boundaries and positions."""
    ground = None if asked.surface is None else _Surface(asked)
    top = asked.box[2, 1] if ground is None else max(asked.box[2, 1], ground.highest) + 1.0
    box = np.vstack([asked.box[:2], [asked.box[2, 0], top]])
    for side in SIDES:
        yield from _side(mesh, asked, side, short)
    if ground is not None:
        yield from _top(mesh, box, ground, short)
    yield from _points_above(asked, ground)
    for planes in _asked_planes(asked, box, ground):
        yield from _planes(mesh, planes, box, short)
    yield from _layers(mesh, asked, box, ground, short)
    yield from _fills(mesh, asked, ground)
    yield from _stations(mesh, asked, ground, short, positions)


# What the mesh holds.


def _facets(mesh, name):
    """Return the faces of a surface as triangles (n, 3, 3) and all their nodes (k, 3), m."""
    if name not in mesh.surfaces or not len(mesh.surfaces[name]):
        return np.zeros((0, 3, 3)), np.zeros((0, 3))
    return _of_faces(mesh, surface_faces(mesh, name))


def _of_faces(mesh, faces):
    """Return numbered faces as triangles (n, 3, 3) and their nodes (k, 3), m."""
    if not mesh.hexahedral:
        corners = mesh.points[zone_faces(mesh.zones)[faces]]
        return corners, corners.reshape(-1, 3)
    zone, local = zone_of_face(mesh.zones, faces)
    order, places = 1, mesh.points[mesh.zones]
    if mesh.places is not None:
        order, places = mesh.order, mesh.places
    grid = places[zone[:, None, None], hexahedra.face_nodes(order)[local]]
    a, b, c, d = grid[:, :-1, :-1], grid[:, 1:, :-1], grid[:, 1:, 1:], grid[:, :-1, 1:]
    halves = [np.stack(part, axis=-2).reshape(-1, 3, 3) for part in ((a, b, c), (a, c, d))]
    return np.concatenate(halves), grid.reshape(-1, 3)


def _cut(triangles, normal, offset):
    """Return the parts (n, 3, 3) of triangles where ``normal x <= offset``."""
    height = triangles @ normal - offset
    inside = height <= 0.0
    count, parts = inside.sum(axis=1), [triangles[inside.all(axis=1)]]
    for single in (True, False):  # one corner inside, or one outside
        partly = count == (1 if single else 2)
        odd = (inside if single else ~inside)[partly].argmax(axis=1)
        order = (odd[:, None] + np.arange(3)) % 3
        a, b, c = np.take_along_axis(triangles[partly], order[..., None], axis=1).swapaxes(0, 1)
        h = np.take_along_axis(height[partly], order, axis=1)
        p = a + (h[:, 0] / (h[:, 0] - h[:, 1]))[:, None] * (b - a)
        q = a + (h[:, 0] / (h[:, 0] - h[:, 2]))[:, None] * (c - a)
        pieces = [(a, p, q)] if single else [(p, b, c), (p, c, q)]
        parts += [np.stack(piece, axis=1) for piece in pieces]
    return np.concatenate(parts)


def _in_box(triangles, box):
    """Return the parts of triangles within limits (3, 2)."""
    for axis in range(3):
        for end, sign in enumerate((-1.0, 1.0)):
            if np.isfinite(box[axis, end]):
                triangles = _cut(triangles, sign * np.eye(3)[axis], sign * box[axis, end])
    return triangles


def _vectors(triangles):
    """Return the area vectors (n, 3) of triangles in m2."""
    return 0.5 * np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])


def _area_of(triangles):
    """Return area in m2 and centre (3,) of triangles."""
    area = np.linalg.norm(_vectors(triangles), axis=1)
    total = float(area.sum())
    return total, area @ triangles.mean(axis=1) / total if total else np.zeros(3)


# What is asked for.


class _Surface:
    """Height of a surveyed surface over the box of a geometry."""

    def __init__(self, asked):
        """Sample it on a raster."""
        self.low, self.size = asked.box[:2, 0], np.ptp(asked.box[:2], axis=1)
        x, y = (low + size * np.linspace(0.0, 1.0, RASTER) for low, size in
                zip(self.low, self.size, strict=True))  # fmt: skip
        self.plan = plan = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)
        surface = np.asarray(asked.surface, dtype=float)
        self.stepped, self.triangles = surface.ndim == 3, surface
        if self.stepped:
            self.raster = _raster_of_triangles(surface, x, y)
        else:
            self.raster = scipy.interpolate.LinearNDInterpolator(surface[:, :2], surface[:, 2])(
                plan
            )
        empty = np.isnan(self.raster)
        if empty.any():
            points = surface.reshape(-1, 3)
            nearest = scipy.interpolate.NearestNDInterpolator(points[:, :2], points[:, 2])
            self.raster[empty] = nearest(plan[empty])
        self.lowest, self.highest = float(self.raster.min()), float(self.raster.max())

    def lowered(self, depth):
        """Return the surface at a depth in m under it."""
        other = copy(self)
        other.raster, other.lowest = self.raster - depth, self.lowest - depth
        return other

    def under(self, plan):
        """Return the height in m at a horizontal position (2,), of a crest."""
        return _highest(self.triangles, plan) if self.stepped else float(self(plan[None])[0])

    def __call__(self, plan):
        """Return the heights (...) in m at horizontal positions (..., 2)."""
        at = (np.asarray(plan) - self.low) / self.size * (RASTER - 1)
        order = 0 if self.stepped else 1
        return scipy.ndimage.map_coordinates(
            self.raster, np.moveaxis(at, -1, 0), order=order, mode="nearest"
        )


def _raster_of_triangles(surface, x, y):
    """Return the greatest heights of triangles over a raster, NaN where none lies."""
    raster = np.full((len(x), len(y)), np.nan)
    i, j = (np.searchsorted(line, surface[..., k].min(axis=1)) for k, line in enumerate((x, y)))
    ends = (np.searchsorted(line, surface[..., k].max(axis=1)) for k, line in enumerate((x, y)))
    wide, deep = (np.minimum(end + 1, RASTER) - at for at, end in zip((i, j), ends, strict=True))
    a, to_b, to_c = surface[:, 0], surface[:, 1] - surface[:, 0], surface[:, 2] - surface[:, 0]
    area = _cross(to_b, to_c)
    cells = np.where(np.abs(area) < EXACT**2, 0, wide * deep)  # of each triangle
    for part in np.array_split(np.arange(len(surface)), 1 + int(cells.sum()) // raster.size):
        of = np.repeat(part, cells[part])
        number = np.arange(len(of)) - np.repeat(np.cumsum(cells[part]) - cells[part], cells[part])
        at = i[of] + number // deep[of], j[of] + number % deep[of]
        away = np.column_stack([x[at[0]], y[at[1]]]) - a[of, :2]
        u, v = _cross(away, to_c[of]) / area[of], _cross(to_b[of], away) / area[of]
        height = a[of, 2] + u * to_b[of, 2] + v * to_c[of, 2]
        inside = (u >= -1e-9) & (v >= -1e-9) & (u + v <= 1.0 + 1e-9)
        np.fmax.at(raster, (at[0][inside], at[1][inside]), height[inside])
    return raster


@dataclass(frozen=True, eq=False)
class _Plane:
    """Plane that is asked for: its part in the ground, where it is known."""

    name: str
    normal: np.ndarray
    point: np.ndarray
    area: float
    centre: np.ndarray
    spacing: float | None = None
    depth: float = np.inf  # of what it cuts off the box, at most
    ends: np.ndarray | None = None  # (3, 2), of a rectangle in flat ground
    scattered: bool = False  # fractures of many planes, or intact parts in a joint


def _asked_planes(asked, box, ground):
    """Yield the lists of planes that share a name."""
    reach = 2.0 * float(np.linalg.norm(np.ptp(box, axis=1)))
    named: dict[str, list[_Plane]] = {}
    for fault in asked.faults:
        normal, point = fault.unit_normal, np.asarray(fault.point, dtype=float)
        corners = _outline(fault, normal, point, reach)
        part = _in_ground(corners, box, [(-np.inf, np.inf)], ground)
        rectangle = fault.extent is not None and ground is None
        triangles = _in_box(_fan(corners), box)
        ends = None
        if rectangle and len(triangles):
            ends = np.stack([triangles.min(axis=(0, 1)), triangles.max(axis=(0, 1))], axis=1)
        scattered = fault.polygon is not None
        named.setdefault(fault.name, []).append(
            _Plane(fault.name, normal, corners.mean(axis=0), *part, ends=ends, scattered=scattered)
        )
    for joints in asked.joint_sets:
        earlier = [plane for planes in named.values() for plane in planes]
        named[joints.name] = [
            plane
            for plane in _planes_of_set(joints, asked, box, ground, reach)
            if not any(_holds(other, plane) for other in earlier)
        ]
    yield from named.values()


def _holds(other, plane):
    """Return whether an earlier plane has the facets of a plane of a set."""
    apart = abs((plane.point - other.point) @ other.normal)
    parallel = np.linalg.norm(np.cross(plane.normal, other.normal))
    return apart <= EXACT and parallel <= EXACT and other.area > (1.0 - OF_AREA) * plane.area


def _planes_of_set(joints, asked, box, ground, reach):
    """Yield the planes of a joint set that cut the ground."""
    normal = joints.normal
    origin = asked.box.mean(axis=1) if joints.origin is None else np.array(joints.origin, float)
    limits = layer_limits(asked.layers, asked.box[2, 1], asked.box[2, 0])
    limits[0] = np.inf if ground is not None else limits[0]
    names = [layer.name for layer in asked.layers]
    following = len(asked.depths)  # layers that are cut with all others, or not at all
    if following:
        limits, names = np.delete(limits, np.arange(following) + 1), names[following:]
        if joints.regions is not None and asked.layers[0].name not in joints.regions:
            ground = ground.lowered(asked.depths[-1])
    levels = [
        (low, high) for name, (high, low) in zip(names, pairwise(limits), strict=True)
        if joints.regions is None or name in joints.regions
    ]  # fmt: skip
    corners = np.array(np.meshgrid(*box)).reshape(3, -1).T
    heights = (corners - origin) @ normal / joints.spacing
    low, high = np.ceil(heights.min() + EXACT), np.floor(heights.max() - EXACT)
    for number in range(int(low), int(high) + 1):  # without those that only touch the box
        point = origin + number * joints.spacing * normal
        outline = _rectangle(normal, None, point, reach, reach)
        area, centre = _in_ground(outline, box, levels, ground)
        if area > 0.0:
            area *= joints.persistence
            yield _Plane(
                joints.name, normal, point, area, centre, joints.spacing,
                joints.spacing * float(min(number - heights.min(), heights.max() - number)),
                scattered=joints.persistence < 1.0,
            )  # fmt: skip


def _outline(fault, normal, point, reach):
    """Return the corners (n, 3) of a fault."""
    if fault.polygon is not None:
        return np.asarray(fault.polygon, dtype=float)
    if fault.radius is not None:
        turn = 2.0 * np.pi * (np.arange(DISC_SIDES) + 0.5) / DISC_SIDES
        size = fault.radius * np.sqrt(2.0 * np.pi / DISC_SIDES / np.sin(2.0 * np.pi / DISC_SIDES))
        strike, down = _directions(normal, fault.dip_direction)
        return point + size * (np.outer(np.cos(turn), strike) + np.outer(np.sin(turn), down))
    along, down = (reach, reach) if fault.extent is None else 0.5 * np.array(fault.extent)
    return _rectangle(normal, fault.dip_direction, point, along, down)


def _directions(normal, dip_direction):
    """Return the unit vectors along strike and down the dip of a plane."""
    strike = np.cross([0.0, 0.0, 1.0], normal)
    if np.linalg.norm(strike) < 1e-9:
        angle = np.pi / 2 if dip_direction is None else dip_direction
        strike = np.array([-np.cos(angle), np.sin(angle), 0.0])
    strike = strike / np.linalg.norm(strike)
    return strike, np.cross(normal, strike)


def _rectangle(normal, dip_direction, point, along, down):
    """Return the corners (4, 3) of a rectangle of half lengths along strike and dip."""
    strike, dip = _directions(normal, dip_direction)
    signs = ((-1, -1), (1, -1), (1, 1), (-1, 1))
    return np.array([point + a * along * strike + b * down * dip for a, b in signs])


def _fan(corners):
    """Return the triangles (n - 2, 3, 3) of a convex polygon."""
    return np.array([corners[[0, k, k + 1]] for k in range(1, len(corners) - 1)])


def _in_ground(corners, box, levels, ground):
    """Return area and centre of a convex polygon in the box, in levels, and under a surface."""
    parts = []
    for low, high in levels:
        limits = box.copy()
        limits[2] = max(box[2, 0], low), min(box[2, 1], high)
        if limits[2, 0] < limits[2, 1]:
            triangles = _in_box(_fan(corners), limits)
            if ground is None or not len(triangles) or triangles[..., 2].max() <= ground.lowest:
                parts.append(_area_of(triangles))
            else:
                parts.append(_under(triangles, ground))
    area = sum(part[0] for part in parts)
    weighed = np.sum([a * c for a, c in parts], axis=0)
    return area, weighed / area if area else np.zeros(3)


def _under(triangles, ground):
    """Return area and centre of the part of a plane polygon under a surface, by sampling."""
    total = np.zeros(4)
    for a, b, c in triangles:
        u, v = np.meshgrid(*2 * [(np.arange(SAMPLES) + 0.5) / SAMPLES], indexing="ij")
        mirrored = u + v > 1.0
        u, v = np.where(mirrored, 1.0 - u, u), np.where(mirrored, 1.0 - v, v)
        places = a + u[..., None] * (b - a) + v[..., None] * (c - a)
        deep = places[..., 2] <= ground(places[..., :2])
        size = 0.5 * np.linalg.norm(np.cross(b - a, c - a)) / SAMPLES**2
        total += size * np.append(deep.sum(), places[deep].sum(axis=0))
    return float(total[0]), total[1:] / total[0] if total[0] else np.zeros(3)


# What is compared.


def _side(mesh, asked, side, short):
    """Yield where a side stands, or whether it leaves a part of the box out."""
    axis, end = divmod(SIDES.index(side), 2)
    if side == "top" and asked.surface is not None:
        return
    wanted = float(asked.box[axis, end])
    nodes = _facets(mesh, side)[1]
    if not len(nodes):
        yield Row(side, "position of its nodes, m", wanted, np.nan, short)
    elif side in asked.standing:
        worst = nodes[np.abs(nodes[:, axis] - wanted).argmax(), axis]
        yield Row(side, "position of its worst node, m", wanted, float(worst), short)
    else:
        corners = np.array(np.meshgrid(*asked.box, indexing="ij"))
        corners = np.take(corners, end, axis=1 + axis).reshape(3, -1).T
        if asked.surface is not None:
            corners = corners[corners[:, 2] == asked.box[2, 0]]
        yield Row(side, "box beyond the ground, m", 0.0, _missing(mesh, corners), short)


def _missing(mesh, positions):
    """Return how far positions lie outside of a mesh or in its absorbing layer, at most, in m."""
    beyond = float(_moved(mesh, positions)[0].max())
    if mesh.layer is None:
        return beyond
    deep = mesh.layer.depths(positions) * mesh.layer.widths(positions)
    return max(beyond, float(np.nan_to_num(deep).max()))


def _moved(mesh, positions):
    """Return how far positions (n, 3) move into the mesh, in m, and the zone of each."""
    zone, at = locate_in_zones(mesh, positions, np.inf)
    if mesh.hexahedral:
        shapes = hexahedra.shape_values(mesh.order, at)
        nearest = np.einsum("na,nac->nc", shapes, mesh.node_places[zone])
    else:
        nearest = np.einsum("na,nac->nc", at, mesh.points[mesh.zones[zone]])
    return np.linalg.norm(nearest - positions, axis=1), zone


def _top(mesh, box, ground, short):
    """Yield the mean height of the ground in the box, and its distances from the survey."""
    triangles = _in_box(_facets(mesh, "top")[0], box)
    vectors = _vectors(triangles)
    area = vectors[:, 2].sum()
    height = float((vectors[:, 2] * triangles[..., 2].mean(axis=1)).sum() / area) if area else 0.0
    weight = np.ones(RASTER)
    weight[[0, -1]] = 0.5
    wanted = float(weight @ ground.raster @ weight / weight.sum() ** 2)
    yield Row("top", "mean height, m", wanted, height, short)
    if ground.stepped:
        away = _above(triangles, ground)
        share = float((np.abs(away) > short).mean())
        yield Row("top", "share of its plan at another height", 0.0, share, OF_AREA)
    else:
        yield from _along("top", triangles, ground, short)


def _above(triangles, ground):
    """Return how far triangles lie above a surface over its raster, NaN where none lies."""
    x, y = ground.plan[:, 0, 0], ground.plan[0, :, 1]
    return _raster_of_triangles(triangles, x, y) - ground.raster


def _along(name, triangles, ground, short, depth=0.0):
    """Yield how far triangles lie from a depth under a surface, on an average and at most."""
    away, where = _above(triangles, ground) + depth, "its depth" if depth else "its survey"
    mean = float(np.sqrt(np.nanmean(away**2)))
    yield Row(name, f"root mean square distance from {where}, m", 0.0, mean, short)
    yield Row(name, f"largest distance from {where}, m", 0.0, _largest(away))
    if np.isfinite(short):  # roughness that no wave sees is no error of the mesh
        cells = OF_ROUGHNESS * short * (RASTER - 1) / ground.size
        cells = np.clip(cells, 1, RASTER).astype(int)
        smooth = scipy.ndimage.uniform_filter(np.nan_to_num(away), cells)
        words = f"largest mean distance from {where} over a tenth of a wavelength, m"
        yield Row(name, words, 0.0, _largest(smooth), short)


def _largest(away):
    """Return the value (n, m) of the largest size, NaN apart."""
    return float(np.nanmax(np.abs(away)))


def _points_above(asked, ground):
    """Yield how far the points of faults lie above the ground, those that do."""
    for fault in asked.faults:
        plan, height = np.array(fault.point[:2], dtype=float), float(asked.box[2, 1])
        if ground is not None:
            height = ground.under(np.clip(plan, *asked.box[:2].T))
        if fault.polygon is None and fault.point[2] > height + EXACT:
            above = float(fault.point[2]) - height
            yield Row(fault.name, "its point above the ground, m", None, above)


def _stations(mesh, asked, ground, short, positions):
    """Yield the height of the ground under positions on it, and how far others are outside."""
    box, top = asked.box, _facets(mesh, "top")[0]
    edges, inside = zone_edge_lengths(mesh).mean(axis=1) / mesh.order, {}
    for name, position in positions.items():
        plan = np.array(position[:2], dtype=float)
        if (plan < box[:2, 0]).any() or (plan > box[:2, 1]).any():
            continue
        height = float(box[2, 1]) if ground is None else ground.under(plan)
        stands = len(position) == 2 or abs(position[2] - height) <= short < np.inf
        if stands and ground is not None:
            built = _highest(top, plan)
            yield Row(name, "height of the ground there, m", height, built, short)
        if len(position) == 3 and box[2, 0] <= position[2] <= height + EXACT:
            inside[name] = np.array(position, dtype=float)
    if inside:
        moved, zones = _moved(mesh, np.array([*inside.values()]))
        for name, away, zone in zip(inside, moved, zones, strict=True):
            if away > OF_EDGE * edges[zone]:
                yield Row(name, "outside of the ground, m", 0.0, float(away), OF_EDGE * edges[zone])


def _planes(mesh, planes, box, short):
    """Yield the rows of the planes that share a name."""
    if not planes or not sum(plane.area for plane in planes):
        return
    first, name = planes[0], planes[0].name
    asked = sum(plane.area for plane in planes)
    triangles, nodes = _facets(mesh, name)
    triangles = _in_box(triangles, box)
    area, centre = _area_of(triangles)
    if first.scattered:
        yield Row(name, "area, m2", asked, area, OF_SCATTERED * asked)
        return
    yield Row(name, "area, m2", asked, area, OF_AREA * asked)
    if not area:
        return
    middle = sum(plane.area * plane.centre for plane in planes) / asked
    near = max(short, 0.5 * OF_AREA * np.sqrt(asked))
    yield Row(name, "distance of its centre, m", 0.0, float(np.linalg.norm(centre - middle)), near)
    yield from _orientation(name, first.normal, _vectors(triangles))
    inside = ((nodes > box[:, 0] - EXACT) & (nodes < box[:, 1] + EXACT)).all(axis=1)
    offsets = np.array([plane.point @ first.normal for plane in planes])
    away = np.abs((nodes[inside] @ first.normal)[:, None] - offsets).min(axis=1)
    worst = float(away.max(initial=0.0))
    yield Row(name, "distance of its worst node, m", 0.0, worst, short)
    if first.spacing is not None:
        yield from _spacing(planes, offsets, triangles, short)
    if first.ends is not None:
        for axis, letter in enumerate("xyz"):
            for end, (word, take) in enumerate((("from", np.min), ("to", np.max))):
                wanted = float(first.ends[axis, end])
                yield Row(
                    name, f"{word} {letter}, m", wanted, float(take(triangles[..., axis])), short
                )


def _orientation(name, normal, vectors):
    """Yield dip, dip direction and flatness of facets by their area vectors (n, 3)."""
    vectors = vectors * np.where(vectors @ normal < 0.0, -1.0, 1.0)[:, None]
    size = np.linalg.norm(vectors, axis=1)
    dip, towards = _dip(normal)
    mean = vectors.sum(axis=0) / np.linalg.norm(vectors.sum(axis=0))
    steep, direction = _dip(mean * (-1.0 if mean[2] < 0.0 else 1.0))
    yield Row(name, "dip, degrees", dip, steep, DEGREES)
    if np.sin(np.radians(dip)) > np.sin(np.radians(DEGREES)):
        turn = 180.0 if dip > 90.0 - DEGREES else 360.0  # upright planes have two
        direction = towards + (direction - towards + 0.5 * turn) % turn - 0.5 * turn
        within = DEGREES / np.sin(np.radians(dip))
        yield Row(name, "dip direction, degrees", towards, direction, within)
    across = np.linalg.norm(np.cross(vectors, normal), axis=1)
    lean = float(size @ np.degrees(np.arctan2(across, vectors @ normal)) / size.sum())
    yield Row(name, "mean lean of its facets, degrees", 0.0, lean, DEGREES)


def _dip(normal):
    """Return dip and dip direction in degrees of an upward normal."""
    dip = np.degrees(np.arctan2(np.hypot(*normal[:2]), normal[2]))
    return float(dip), float(np.degrees(np.arctan2(*normal[:2])) % 360.0)


def _spacing(planes, offsets, triangles, short):
    """Yield the number of planes of a set, but for those at corners, and their spacing."""
    plane, wanted = planes[0], np.array([plane.depth > short for plane in planes])
    size = np.linalg.norm(_vectors(triangles), axis=1)
    away = triangles.mean(axis=1) @ plane.normal
    owner = np.abs(away[:, None] - offsets).argmin(axis=1)
    area = np.bincount(owner, size, len(offsets))
    built = wanted & (area > 0.0)
    yield Row(plane.name, "planes", float(wanted.sum()), float(built.sum()), 0.5)
    if built.sum() > 1:
        at = np.bincount(owner, size * away, len(offsets))[built] / area[built]
        wider = np.diff(at) - np.diff(offsets[built])
        worst = plane.spacing + float(wider[np.abs(wider).argmax()])
        yield Row(plane.name, "spacing, m", plane.spacing, worst, short)


def _boundaries(mesh, upper, lower):
    """Return the numbers of faces between zones of two groups."""
    if not {upper, lower} <= set(mesh.groups):
        return np.zeros(0, dtype=int)
    zones = mesh.zones
    if mesh.contacts is not None:
        zones = graph_components(mesh.contacts.minus, mesh.contacts.plus, len(mesh.points))[1][
            zones
        ]
    first, second, _, _ = pair_faces(zones, len(mesh.points))
    group = mesh.zone_group[zone_of_face(mesh.zones, np.stack([first, second]))[0]]
    pair = sorted((mesh.groups.index(upper), mesh.groups.index(lower)))
    return first[(np.sort(group, axis=0) == np.array(pair)[:, None]).all(axis=0)]


def _levels(asked):
    """Yield upper layer, lower layer, height and depth of each boundary between unlike layers.

    The depth is that under the surface where it follows it, else zero.
    """
    depths = [*asked.depths, *np.zeros(len(asked.levels))]
    boundaries = zip(pairwise(asked.layers), asked.limits[1:-1], depths, strict=True)
    for (upper, lower), height, depth in boundaries:
        if upper.name != lower.name:
            yield upper.name, lower.name, float(height), float(depth)


def following(asked: Geometry) -> list[str]:
    """Return the names of the rows of boundaries that follow the surface."""
    return [f"{upper} on {lower}" for upper, lower, _, depth in _levels(asked) if depth]


def _layers(mesh, asked, box, ground, short):
    """Yield area and height of the boundaries between layers."""
    levels, everywhere = list(_levels(asked)), [(-np.inf, np.inf)]
    for upper, lower, height, depth in levels:
        triangles, nodes = _of_faces(mesh, _boundaries(mesh, upper, lower))
        if depth:
            triangles = _in_box(triangles, box)
            yield from _along(f"{upper} on {lower}", triangles, ground, short, depth)
            continue
        same = [z for a, b, z, deep in levels if {a, b} == {upper, lower} and not deep]
        inside = ((nodes > box[:, 0] - EXACT) & (nodes < box[:, 1] + EXACT)).all(axis=1)
        own = nodes[inside & _nearest(nodes, height, same), 2]
        cut = [fill.box for fill in asked.fills if fill.box[2, 0] < height < fill.box[2, 1]]
        ends = ((0, 0), (1, 0), (1, 1), (0, 1))
        whole, *less = (
            _in_ground(np.array([[part[0, i], part[1, j], height] for i, j in ends]), box,
                       everywhere, ground)[0]
            for part in (box, *cut)
        )  # fmt: skip
        near = _nearest(triangles.mean(axis=1), height, same)
        built = _area_of(_in_box(triangles[near], box))[0]
        name, plan = f"{upper} on {lower}", float(np.ptp(box[:2], axis=1).prod())
        yield Row(name, "area, m2", whole - sum(less), built, OF_AREA * plan)
        if len(own):
            worst = float(own[np.abs(own - height).argmax()])
            yield Row(name, "height of its worst node, m", height, worst, short)


def _fills(mesh, asked, ground):
    """Yield the volumes of fills in the box."""
    volumes, middle = zone_volumes(mesh), mesh.points[mesh.zones].mean(axis=1)
    inside = ((middle > asked.box[:, 0]) & (middle < [*asked.box[:2, 1], np.inf])).all(axis=1)
    shares = (np.arange(SAMPLES) + 0.5) / SAMPLES
    for fill in asked.fills:
        low, high = np.clip(fill.box[:2], *asked.box[:2].T[:, :, None]).T
        plan = np.stack(np.meshgrid(*(low + np.outer(shares, high - low)).T), axis=-1)
        top = asked.box[2, 1] if ground is None else ground(plan)
        foot = max(fill.box[2, 0], asked.box[2, 0])
        deep = np.clip(np.minimum(top, fill.box[2, 1]) - foot, 0.0, None)
        wanted = float(np.prod(high - low) * deep.mean())
        own = inside & (mesh.zone_group == mesh.groups.index(fill.name))
        yield Row(fill.name, "volume, m3", wanted, float(volumes[own].sum()), OF_AREA * wanted)


def _nearest(positions, height, heights):
    """Return whether positions (n, 3) are nearer to one height than to others, (n,) bool."""
    away = np.abs(positions[:, 2:] - np.array(heights))
    return away.argmin(axis=1) == heights.index(height)


def _depths(name, position, levels, top):
    """Yield the depths of layers below a position."""
    highest = _heights(top, position).max(initial=-np.inf)
    for lower, level, depth, triangles in levels:
        cuts, height = _heights(triangles, position), highest - depth if depth else level
        if height < highest and len(cuts):
            built = highest - cuts[np.abs(cuts - height).argmin()]
            quantity = f"depth of {lower} below the ground, m"
            yield Row(name, quantity, float(highest - height), float(built))


def _side_of(triangles, position, middle):
    """Return on which side of a joint through a position a point lies; empty if none is near."""
    low, high = triangles.min(axis=1) - EXACT, triangles.max(axis=1) + EXACT
    for triangle in triangles[((position >= low) & (position <= high)).all(axis=1)]:
        normal = _vectors(triangle[None])[0]
        normal /= np.linalg.norm(normal)
        if abs((position - triangle[0]) @ normal) <= EXACT and _within(triangle, normal, position):
            along = normal * np.sign((middle - triangle[0]) @ normal)
            axis = int(np.abs(along).argmax())
            return WAYS[axis][int(along[axis] > 0.0)]
    return ""


def _within(triangle, normal, position):
    """Return whether a position in the plane of a triangle lies in it."""
    edges = np.roll(triangle, -1, axis=0) - triangle
    across = np.cross(edges, position - triangle) @ normal
    return bool((across >= -EXACT * np.linalg.norm(edges, axis=1)).all())


def _heights(triangles, position):
    """Return the heights (n,) at which the vertical through a position cuts triangles."""
    low, high = triangles[..., :2].min(axis=1), triangles[..., :2].max(axis=1)
    near = ((position[:2] >= low - EXACT) & (position[:2] <= high + EXACT)).all(axis=1)
    triangles = triangles[near]
    a, b, c = (triangles[..., :2] - position[:2]).swapaxes(0, 1)
    weight = np.stack([_cross(b, c), _cross(c, a), _cross(a, b)], axis=1)
    total = weight.sum(axis=1)
    steep = np.abs(total) <= EXACT**2
    share = weight / np.where(steep, 1.0, total)[:, None]
    inside = ~steep & (share >= -1e-9).all(axis=1)
    return np.einsum("nk,nk->n", share[inside], triangles[inside, :, 2])


def _highest(triangles, position):
    """Return the greatest height in m at which the vertical cuts triangles, NaN if it cuts none.

    Beside a crest, within rounding, that of the crest.
    """
    steps = EXACT * np.array([[0.0, 0.0], [1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    heights = [_heights(triangles, position + step) for step in steps]
    return float(np.concatenate(heights).max(initial=-np.inf)) if any(map(len, heights)) else np.nan


def _cross(a, b):
    """Return the cross products (n,) of plane vectors (n, 2)."""
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


def _inner_surfaces(mesh):
    """Yield size and orientation of the surfaces inside a mesh that was read."""
    _, _, single, _ = mesh.paired_faces
    for name in mesh.surfaces:
        faces = surface_faces(mesh, name)
        if not len(faces) or faces[0] in single:
            continue
        triangles, nodes = _of_faces(mesh, faces)
        area = _area_of(triangles)[0]
        normal = np.linalg.svd(nodes - nodes.mean(axis=0), full_matrices=False)[2][2]
        normal = normal * (-1.0 if normal[2] < 0.0 else 1.0)
        dip, towards = _dip(normal)
        away = float(np.abs((nodes - nodes.mean(axis=0)) @ normal).max())
        yield Row(name, "area, m2", None, area)
        yield Row(name, "dip, degrees", None, dip)
        yield Row(name, "dip direction, degrees", None, towards)
        yield Row(name, "distance of its worst node from the mean plane, m", None, away)
