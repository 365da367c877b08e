"""Mesh generation of jointed rock: layers, joint sets and faults in a box, meshed by gmsh."""

import logging
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike

from ..errors import InputError, PyblastWarning
from .block_cutter import SIDES, CutReport, CuttingPlane, cut_cells, rock_cells
from .blocks import area_vector, carved, cell_vertices
from .blocks import edges as loop_edges
from .gmsh import MeshingError, growth_distance, mesh_cells
from .grid import Fault, JointSet, Layer, graded_axis, layer_limits, structured_box
from .mesh import Mesh
from .quality import MESHING_BYTES, ZONES_PER_CUBE, refuse_beyond_memory

__all__ = ["Fault", "JointSet", "Layer", "build_mesh", "build_mesh_report", "structured_box"]
TOLERANCE_SHARE = 0.15
# Mean edge inside a volume over that of gmsh's size; edges on joints have that size (measured).
_INTERIOR_SHARE = 0.77
_REFINED_SHARE = 0.68  # the same in a box amid longer edges
# Factors on the tolerance, tried in turn if gmsh takes facets for overlapping.
_RETRIES = (1.0, 0.5, 1.5, 0.25, 0.0)
_SEAM = "seam of the terrain"
_SEAM_SHARE = 0.5  # of the tolerance of the terrain, for the lines between its facets
_TERRAIN_SHARE = 0.05  # tolerance of the terrain over the smallest edge
_HALVINGS = 4  # of edges over which a surface is sampled, where it is curved
_ROUGH = 0.5  # of the distance of a first sampling: a survey is rough where halvings leave more
_HEADROOM = 2.0  # room above the terrain, over the smallest edge
_EXACT = 1e-6  # m
_INNER_SHARES = np.array([(i, j, 8 - i - j) for i in range(9) for j in range(9 - i)]) / 8
_LOG = logging.getLogger(__name__)


def build_mesh(
    box: ArrayLike,
    layers: Sequence[Layer],
    joint_sets: Sequence[JointSet] = (),
    faults: Sequence[Fault] = (),
    **options: Any,
) -> Mesh:
    """Generate the mesh of a box of layers cut by joints and faults.

    Parameters
    ----------
    box : (3, 2) float, m
        Lower and upper limits of x, y and z.
    layers : sequence of Layer
        From the top down.
    joint_sets : sequence of JointSet
    faults : sequence of Fault
        They are cut before the joint sets.
    **options : Any
        Keywords of `build_mesh_report`: ``edge``, ``surface``, ``padding``, ``tolerance``,
        ``seed``, ``optimize``, ``refinements``, ``relief``.

    Returns
    -------
    Mesh
        Not split.

    Raises
    ------
    InputError
        If a value is out of range, a region unknown, the mesh larger than the memory, or gmsh
        missing or unable.

    Examples
    --------
    >>> mesh = build_mesh([(0, 40), (0, 40), (0, 20)], [Layer("rock", edge=10.0)])
    >>> mesh.groups, sorted(mesh.surfaces)
    (('rock',), ['bottom', 'east', 'north', 'south', 'top', 'west'])
    """
    return build_mesh_report(box, layers, joint_sets, faults, **options)[0]


def build_mesh_report(
    box: ArrayLike,
    layers: Sequence[Layer],
    joint_sets: Sequence[JointSet] = (),
    faults: Sequence[Fault] = (),
    *,
    edge: float | None = None,
    surface: ArrayLike | None = None,
    padding: tuple[float, float] | None = None,
    tolerance: float | None = None,
    seed: int = 0,
    optimize: bool = True,
    refinements: Sequence[tuple[ArrayLike, float]] = (),
    relief: float = np.inf,
) -> tuple[Mesh, CutReport]:
    """Generate a mesh as `build_mesh`; also return the report of the cutting.

    Parameters
    ----------
    box : (3, 2) float64, m
    layers : list of Layer, from the top down
    joint_sets : list of JointSet
    faults : list of Fault
        They are cut before the joint sets.
    edge : float, m
        Mean edge of the zones in layers without one. Smaller blocks get smaller zones.
    surface : (n, 3) or (n, 3, 3) float64, m
        Surveyed top surface, or its triangles (n, 3, 3), which may leave upright steps. It cuts
        the blocks: layers and joints stay planes.
    padding : (distance, edge), m
        Ground beyond sides and bottom with edges growing to this one; layers and unbounded faults
        continue into it, joint sets do not.
    tolerance : float, m
        Largest displacement of a joint to a corner of other joints, which avoids slivers; default
        0.15 of the edge, at most 0.1 of the spacing.
    seed : int
        Of the random choice of intact facets of joints with a persistence below 1.
    optimize : bool
        Improve thin zones; joints and layers are not moved.
    refinements : sequence of ((3, 2) float, float), m
        Boxes with a mean edge of their own, where it is shorter; beyond them edges grow by 0.3 m
        a metre.
    relief : float, m
        Largest distance of the ground from a surveyed surface. It is sampled at every edge, and
        down to a sixteenth of one where it is curved.

    Returns
    -------
    mesh : Mesh
        Not split; joint surfaces by name next to west, east, south, north, bottom, top.
    report : CutReport

    Raises
    ------
    InputError
        If a value is out of range, a region unknown, the mesh larger than the memory, or gmsh
        missing or unable.
    """
    box = _checked_box(box)
    limits = layer_limits(layers, box[2, 1], box[2, 0])
    edges = _layer_edges(layers, edge)
    finer = [(_checked_box(part), float(short)) for part, short in refinements]
    _refuse_too_many(box, limits, edges, finer)
    sets = _placed_sets(joint_sets, faults, layers, box)
    margin = _margin(padding, edges)
    tolerances = TOLERANCE_SHARE * edges if tolerance is None else np.full(len(edges), tolerance)
    regions, outside = _regions(box, limits, edges * _size_factors(sets, edges), padding)
    for part, short in finer:
        size = _REFINED_SHARE * short
        regions.append((part, size, growth_distance(size, outside)))

    smallest = float(np.min(edges))
    terrain = None if surface is None else _terrain(surface, box, margin, smallest, relief)
    top = None
    if terrain is not None:
        top = max(box[2, 1], terrain[..., 2].max()) + _HEADROOM * smallest

    def fill(factor):
        cells, report = rock_cells(box, limits, factor * tolerances, sets, faults, margin, top)
        if terrain is not None:
            near = factor * _TERRAIN_SHARE * smallest
            cells, moved, refused = _terrain_cells(cells, terrain, near)
            report = replace(report, terrain=moved, refused=report.refused + refused)
        _weld_shares(cells, sets, seed)
        try:
            meshed = mesh_cells(cells, regions, outside, optimize)
        except MeshingError as error:
            raise MeshingError(f"{error}; {_narrowest(cells)}") from None
        return cells, report, *meshed

    cells, report, points, zones, cell, surfaces, slivers = _with_retries(fill)
    names = list(dict.fromkeys(layer.name for layer in layers))
    number = np.array([names.index(layer.name) for layer in layers])
    count, thinnest = zip(*((s.count, s.thinnest) for s in slivers), strict=True)
    report = replace(report, slivers=count, thinnest=thinnest)
    _announce(report, len(zones))
    zone_group = number[np.array(cells.kinds)[cell] % len(layers)]
    return Mesh(points, zones, zone_group, tuple(names), surfaces), report


def _narrowest(cells):
    """Return in words where the shortest line between blocks lies, and on which surfaces."""
    lines = {line for loop in cells.loops for line in loop_edges(loop)}
    ends = {line: np.subtract(*(cells.points[v] for v in line)) for line in lines}
    line = min(sorted(lines), key=lambda each: float(np.linalg.norm(ends[each])))
    near = (tag for tag, loop in zip(cells.tags, cells.loops, strict=True) if {*line} & {*loop})
    x, y, z = np.mean([cells.points[v] for v in line], axis=0)
    return (
        f"the shortest line between blocks, {np.linalg.norm(ends[line]):.2g} m near "
        f"({x:.4g}, {y:.4g}, {z:.4g}) m, is where {', '.join(sorted({*near} - {''}))} meet"
    )


def _with_retries(fill):
    """Return ``fill(factor)`` for the first factor on the tolerance that gmsh can mesh."""
    for factor in _RETRIES[:-1]:
        try:
            return fill(factor)
        except MeshingError as error:
            _LOG.info("%s; cutting again, %g of the tolerance failed", error, factor)
    return fill(_RETRIES[-1])


def _checked_box(box):
    """Return the box (3, 2); raise InputError if it is invalid."""
    box = np.asarray(box, dtype=float)
    if box.shape != (3, 2) or not (box[:, 1] > box[:, 0]).all():
        raise InputError(f"box: needs (low, high) for x, y and z, low < high, got {box.tolist()}")
    return box


def _layer_edges(layers, edge):
    """Return the mean edge (n_layers,) of the layers, m."""
    edges = [edge if layer.edge is None else layer.edge for layer in layers]
    for layer, value in zip(layers, edges, strict=True):
        if value is None or not value > 0.0:
            raise InputError(f"layer {layer.name!r}.edge: must be positive, got {value}")
    return np.array(edges, dtype=float)


def _refuse_too_many(box, limits, edges, finer):
    """Raise InputError if the zones would not fit into memory."""
    area = np.prod(box[:2, 1] - box[:2, 0])
    cubes = float(np.sum(area * -np.diff(limits) / edges**3))
    for part, short in finer:
        within = np.clip(part, box[:, :1], box[:, 1:])
        cubes += float(np.prod(np.diff(within)) / short**3)
    count = ZONES_PER_CUBE * cubes
    refuse_beyond_memory(f"build_mesh: a mesh of about {count:.2g} zones", count * MESHING_BYTES)


def _margin(padding, edges):
    """Return the width of the padding, m."""
    if padding is None:
        return 0.0
    margin, edge = padding
    if not margin > 0.0 or not edge >= max(edges):
        raise InputError(
            f"padding: needs a positive distance and an edge of {max(edges):g} m or more, "
            f"got {margin:g} and {edge:g} m"
        )
    return float(margin)


def _placed_sets(joint_sets, faults, layers, box):
    """Return each joint set with its layers; raise InputError for duplicate or unknown names."""
    fractures = {fault.name for fault in faults if fault.polygon is not None}
    names = [part.name for part in (*joint_sets, *faults) if part.name not in fractures]
    names += fractures
    for name in names:
        if names.count(name) > 1 or name in SIDES or not name:
            raise InputError(f"joint {name!r}: needs a name of its own that is no side of the box")
    known = [layer.name for layer in layers]
    placed = []
    for joints in joint_sets:
        regions = known if joints.regions is None else joints.regions
        for region in regions:
            if region not in known:
                raise InputError(
                    f"{joints.name}.regions: must be among {', '.join(known)}, got {region!r}"
                )
        origin = box.mean(axis=1) if joints.origin is None else joints.origin
        layers_cut = {n for n, name in enumerate(known) if name in regions}
        placed.append((replace(joints, origin=tuple(origin)), layers_cut))
    return placed


def _weld_shares(cells, sets, seed):
    """Make a random fraction of the facets of joint sets with persistence below 1 intact."""
    for number, (joints, _) in enumerate(sets):
        faces = np.array([f for f, tag in enumerate(cells.tags) if tag == joints.name])
        if joints.persistence < 1.0 and len(faces):
            shuffled = np.random.default_rng([seed, number]).permutation(faces)
            area = np.cumsum([np.linalg.norm(area_vector(cells, cells.loops[f])) for f in shuffled])
            for face in shuffled[area > joints.persistence * area[-1]]:
                cells.tags[face] = ""


def _size_factors(sets, edges):
    """Return gmsh's size over the required mean edge, (n_layers,)."""
    spacing = np.full(len(edges), np.inf)
    for joints, layers in sets:
        for layer in layers:
            spacing[layer] = min(spacing[layer], joints.spacing)
    return _INTERIOR_SHARE + (1.0 - _INTERIOR_SHARE) * np.minimum(1.0, 3.0 * edges / spacing)


def _regions(box, limits, sizes, padding):
    """Return limits, edge and growth distance of each layer for gmsh's size field."""
    margin, far = (0.0, max(sizes)) if padding is None else padding
    regions = []
    for top, bottom, size in zip(limits[:-1], limits[1:], sizes, strict=True):
        distance = max(margin, growth_distance(size, far))
        regions.append(([box[0], box[1], (bottom, top)], size, distance))
    return regions, max(far, *sizes)


def _terrain(surface, box, margin, edge, relief):
    """Return a surveyed surface as triangles (n, 3, 3) over box and padding in plan."""
    surface = np.asarray(surface, dtype=float)
    if surface.ndim == 3 and surface.shape[1:] == (3, 3):
        run = surface[:, 1:, :2] - surface[:, :1, :2]
        triangles = surface[np.abs(np.linalg.det(run)) > _EXACT]  # upright ones follow from steps
        _refuse_uncovered(triangles, box, margin)
    elif surface.ndim == 2 and surface.shape[1] == 3 and len(surface) >= 3:
        triangles = _sampled(surface, box, margin, edge, relief)
    else:
        raise InputError(
            "surface: needs three places (x, y, z) or more, or triangles (n, 3, 3), "
            f"got {surface.shape}"
        )
    if not triangles[..., 2].min() > box[2, 0]:
        raise InputError(
            f"surface: must lie above the bottom at {box[2, 0]:g} m, "
            f"got {triangles[..., 2].min():g} m"
        )
    return triangles


def _sampled(places, box, margin, edge, relief):
    """Sample a surface at the corners of a grid of an edge, as triangles (n, 3, 3).

    Lines are added where it is farther from its triangles than the relief, unless it is too rough.
    """
    inside = scipy.interpolate.LinearNDInterpolator(places[:, :2], places[:, 2])
    nearest = scipy.interpolate.NearestNDInterpolator(places[:, :2], places[:, 2])

    def height_at(plan):
        height = inside(plan)
        return np.where(np.isnan(height), nearest(plan), height)

    axes = [graded_axis(limits, [], edge, margin, margin) for limits in box[:2]]
    first, far = np.zeros((0, 3, 3)), np.inf
    for halving in range(_HALVINGS + 1):
        plan = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        corners = np.concatenate([plan, height_at(plan)[..., None]], axis=2)
        a, b, c, d = corners[:-1, :-1], corners[1:, :-1], corners[1:, 1:], corners[:-1, 1:]
        cells = np.stack([np.stack(half, axis=2) for half in ((a, b, c), (a, c, d))], axis=2)
        points = _INNER_SHARES @ cells
        away = np.abs(points[..., 2] - height_at(points[..., :2])).max(axis=(2, 3))
        triangles = cells.reshape(-1, 3, 3)
        if halving == 0:
            first, far = triangles, away.max()
        if away.max() <= relief or halving == _HALVINGS:
            break
        for axis in (0, 1):
            wide = np.flatnonzero((away > relief).any(axis=1 - axis))
            middle = 0.5 * (axes[axis][wide] + axes[axis][wide + 1])
            axes[axis] = np.sort(np.concatenate([axes[axis], middle]))
    return triangles if away.max() <= max(relief, _ROUGH * far) else first


def _refuse_uncovered(triangles, box, margin):
    """Raise InputError if triangles leave a part of box and padding uncovered in plan."""
    if not len(triangles) or not np.isfinite(triangles).all():
        raise InputError("surface: needs finite triangles that are not all upright")
    x, y = (np.linspace(low - margin, high + margin, 21) for low, high in box[:2])
    places = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    depth = _depths(triangles, places).max(axis=0)
    if depth.min() < -_EXACT:
        x, y = places[depth.argmin()]
        raise InputError(
            f"surface: must cover the box and its padding of {margin:g} m in plan, got nothing at "
            f"({x:g}, {y:g}) m; extend the survey or shrink the box"
        )


def _announce(report, n_zones):
    """Log the report; warn of blocks that a joint could not cut."""
    _LOG.info(
        "%d zones in %d blocks; joints moved at %d corners by %.2g m at most; slivers reduced from "
        "%d to %d, smallest altitude over edge improved from %.2g to %.2g",
        n_zones,
        report.cells,
        report.bent,
        report.largest,
        *report.slivers,
        *report.thinnest,
    )
    if report.refused:
        warnings.warn(
            f"build_mesh: {report.refused} blocks could not be cut by a joint and hold it "
            "together; move the joint a little",
            PyblastWarning,
            stacklevel=3,
        )


@dataclass(frozen=True, eq=False)
class _Seams:
    """Straight seams of a terrain in one vertical plane.

    Parameters
    ----------
    plane : CuttingPlane
    along : (n, 2) float64, m, ends of each seam along the plane
    heights : (n, 2) float64, m, lowest and highest ground beside each
    """

    plane: CuttingPlane
    along: np.ndarray
    heights: np.ndarray

    def crosses(self, points: np.ndarray) -> bool:
        """Return whether a seam passes through the plan of a cell at its height."""
        height = self.plane.heights(points)
        low, high = points[height < -_EXACT], points[height > _EXACT]
        if not len(low) or not len(high):
            return False
        share = self.plane.heights(low)[:, None]
        share = share / (share - self.plane.heights(high)[None])
        run = np.array([self.plane.normal[1], -self.plane.normal[0], 0.0])
        start = (low @ run)[:, None]
        along = start + share * ((high @ run)[None] - start)
        shared = np.minimum(self.along[:, 1], along.max()) - np.maximum(
            self.along[:, 0], along.min()
        )
        near = (points[:, 2].max() > self.heights[:, 0]) & (points[:, 2].min() < self.heights[:, 1])
        return bool((near & (shared > _EXACT)).any())


def _terrain_cells(cells, terrain, tolerance):
    """Cut away the ground above a terrain.

    Returns
    -------
    cells : CellComplex
    moved : float, m, largest displacement of the terrain to a corner of joints
    refused : int, cells that it could not cut
    """
    bent, refused = [0.0], 0
    shape = {c: cell_vertices(cells, c) for c in range(len(cells.faces))}

    def cut(cells, chosen, plane, share):
        nonlocal refused
        cells, result = cut_cells(
            cells, chosen, plane, lambda points: np.full(len(points), share * tolerance)
        )
        bent.append(result.bent.max(initial=0.0))
        refused += result.refused
        for cell in [*chosen, *range(len(shape), len(cells.faces))]:
            shape[cell] = cell_vertices(cells, cell)
        return cells

    for seams in _seams(terrain):
        chosen = [c for c, points in shape.items() if seams.crosses(points)]
        if chosen:
            cells = cut(cells, chosen, seams.plane, _SEAM_SHARE)
    for plane, chosen in _facet_planes(terrain, shape):
        cells = cut(cells, chosen, plane, 1.0)
    middles = np.array([points.mean(axis=0) for points in shape.values()])
    normal, offset = _triangle_planes(terrain[_triangle_of(terrain, middles)])
    air = np.einsum("ni,ni->n", normal, middles) > offset
    cells = carved(cells, set(np.flatnonzero(air).tolist()), "top", _SEAM)
    return cells, float(max(bent)), refused


def _triangle_planes(triangles):
    """Return upward unit normals (n, 3) and offsets (n,) in m of triangles."""
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normal *= np.where(normal[:, 2:] < 0.0, -1.0, 1.0)
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    return normal, np.einsum("ni,ni->n", normal, triangles[:, 0])


def _triangle_of(terrain, places):
    """Return the triangle (n,) in whose plan each place lies, or to which it is nearest."""
    return _depths(terrain, places).argmax(axis=0)


def _depths(terrain, places):
    """Return how deep places (n, 2 or 3) lie in the plan of triangles, (m, n), m."""
    plan = terrain[..., :2]
    turn = np.sign(np.linalg.det(plan[:, 1:] - plan[:, :1]))
    inside = np.full((len(terrain), len(places)), np.inf)
    for corner in range(3):
        start = plan[:, corner]
        run = plan[:, (corner + 1) % 3] - start
        run /= np.linalg.norm(run, axis=1)[:, None]
        away = places[None, :, :2] - start[:, None]
        depth = run[:, :1] * away[..., 1] - run[:, 1:] * away[..., 0]
        inside = np.minimum(inside, turn[:, None] * depth)
    return inside


def _facet_planes(terrain, shape):
    """Return each plane of a terrain with the cells that lie across it."""
    normal, offset = _triangle_planes(terrain)
    keys = np.round(np.column_stack([normal, offset]) / _EXACT).astype(np.int64)
    number = np.unique(keys, axis=0, return_inverse=True)[1].ravel()
    middles = np.array([points.mean(axis=0) for points in shape.values()])
    of_cell = number[_triangle_of(terrain, middles)]
    planes = []
    for plane in range(number.max() + 1):
        row = np.flatnonzero(number == plane)[0]
        level = CuttingPlane(normal[row], float(offset[row]), _SEAM)
        cells = np.flatnonzero(of_cell == plane).tolist()
        across = [c for c in cells if np.ptp(np.sign(level.heights(shape[c]))) == 2.0]
        if across:
            planes.append((level, across))
    return planes


def _seams(terrain):
    """Return the `_Seams` at which the slope or the height of a terrain changes."""
    normal, offset = _triangle_planes(terrain)
    beside: dict[tuple, list[int]] = {}
    for triangle, corners in enumerate(np.round(terrain[..., :2] / _EXACT).astype(np.int64)):
        names = [tuple(corner) for corner in corners.tolist()]
        for a in range(3):
            beside.setdefault(tuple(sorted((names[a], names[(a + 1) % 3]))), []).append(triangle)
    planes: dict[tuple, list] = {}
    for ends, triangles in beside.items():
        heights = terrain[triangles].reshape(-1, 3) @ normal[triangles].T - offset[triangles]
        if len(triangles) == 2 and np.abs(heights).max() <= _EXACT:
            continue
        start, end = np.array(ends, dtype=float) * _EXACT
        run = (end - start) / np.linalg.norm(end - start)
        run = -run if tuple(np.round(run, 9)) < (0.0, 0.0) else run
        across = np.array([-run[1], run[0], 0.0])
        level = float(across[:2] @ start)
        key = (*np.round(across[:2], 9).tolist(), round(level / _EXACT))
        along = sorted((start @ run, end @ run))
        ground = terrain[triangles][..., 2]
        planes.setdefault(key, []).append((across, level, along, (ground.min(), ground.max())))
    return [
        _Seams(
            CuttingPlane(parts[0][0], parts[0][1], _SEAM),
            np.array([part[2] for part in parts]),
            np.array([part[3] for part in parts]),
        )
        for parts in planes.values()
    ]
