"""Meshing by gmsh: tetrahedra in cells, quadrilaterals in a section; smoothing of thin zones."""

import threading
from collections.abc import Callable, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ..core import smooth
from ..errors import InputError
from . import tetrahedra
from .blocks import CellComplex, facets

# Smallest altitude over longest edge: below THIN a zone is smoothed, below SLIVER a sliver.
THIN = 0.35
SLIVER = 0.1
_PARALLEL = 1e-9
_FLAT = 1e-6  # smallest altitude over longest edge of a zone with a volume


def thinness(points: np.ndarray, zones: np.ndarray) -> np.ndarray:
    """Return smallest altitude over longest edge, (n_zones,): 0.82 for a regular tetrahedron."""
    return tetrahedra.altitudes(points, zones) / tetrahedra.edge_lengths(points, zones).max(axis=1)


def tangent_projectors(points: np.ndarray, patches: Sequence[np.ndarray]) -> np.ndarray:
    """Return projectors (n_nodes, 3, 3) on motions that keep nodes on their patches and borders.

    Parameters
    ----------
    points : (n_nodes, 3) float64, m
    patches : sequence of (n, 3) int64
        Triangles of one plane each, with straight borders.
    """
    triangles = np.concatenate(patches)
    patch = np.repeat(np.arange(len(patches)), [len(part) for part in patches])
    normal = np.zeros((len(patches), 3))
    np.add.at(normal, patch, tetrahedra.triangle_vectors(points, triangles))
    normal /= np.maximum(np.linalg.norm(normal, axis=1), np.finfo(float).tiny)[:, None]
    constrained = np.zeros((len(points), 3, 3))
    across = normal[:, :, None] * normal[:, None]
    np.add.at(constrained, triangles, across[patch][:, None])
    border = _borders(triangles, patch)
    along = points[border[:, 1]] - points[border[:, 0]]
    along /= np.linalg.norm(along, axis=1)[:, None]
    beside = np.eye(3) - along[:, :, None] * along[:, None]
    np.add.at(constrained, border, beside[:, None])
    values, vectors = np.linalg.eigh(constrained)
    free = (values < _PARALLEL)[:, None, :] * vectors
    return np.einsum("nik,njk->nij", free, vectors)


def _borders(triangles, patch):
    """Return the border edges (n, 2) of patches, which belong to one triangle only."""
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]], axis=2).reshape(-1, 2)
    keys = np.column_stack([np.repeat(patch, 3), edges])
    unique, count = np.unique(keys, axis=0, return_counts=True)
    return unique[count == 1, 1:]


def smoothed(points: np.ndarray, zones: np.ndarray, patches: Sequence[np.ndarray]) -> np.ndarray:
    """Return smoothed points (n_nodes, 3); patches are neither bent nor moved.

    Parameters
    ----------
    points : (n_nodes, 3) float64, m
    zones : (n_zones, 4) int64, of positive volume
    patches : sequence of (n, 3) int64
        Triangles of each flat piece of a joint, a layer or a side.

    Notes
    -----
    The nodes of thin zones slide downhill, one after the other, until few of them move: module
    ``pyblast_smoothing``.
    """
    points = points.copy()
    projectors = tangent_projectors(points, patches)
    movable = np.trace(projectors, axis1=1, axis2=2) > 0.5
    nodes = np.unique(zones[thinness(points, zones) < THIN])
    nodes = nodes[movable[nodes]]
    if len(nodes):
        corner = np.argsort(zones.ravel(), kind="stable")
        ends = np.searchsorted(zones.ravel()[corner], [nodes, nodes + 1])
        own = np.concatenate([corner[low:high] // 4 for low, high in ends.T])
        tables = {
            "zone_node": zones, "weight": tetrahedra.volumes(points, zones), "movable_node": nodes,
            "projector": projectors[nodes], "own_zone": own,
            "zone_start": np.append(0, np.cumsum(ends[1] - ends[0])),
        }  # fmt: skip
        smooth(tables, points)
    return points


def split_flat(
    points: np.ndarray, zones: np.ndarray, triangles: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Split zones without volume that lie in a face of a block, at their edge inside the block.

    Parameters
    ----------
    points : (n_nodes, 3) float64, m
    zones : (n_zones, 4) int64
    triangles : (n, 3) int64
        On the faces of all blocks.

    Returns
    -------
    points : (n_nodes + n, 3) float64, m
    zones : (n_zones + n_parts, 4) int64
    parent : (n_zones + n_parts,) int64
        Zone of which each is a part, in ascending order.

    Notes
    -----
    Two faces of such a zone belong to the face of the block, so no node that stays in that face
    gives it a volume. A node in the middle of the edge of its other two faces, moved inward,
    gives one to both its parts; the zones around that edge are split alike.
    """
    parent = np.arange(len(zones))
    flat = zones[thinness(points, zones) <= _FLAT]
    on_face = set(map(frozenset, triangles.tolist())) if len(flat) else set()
    for zone in flat:
        edge = [node for node in zone if frozenset(zone.tolist()) - {node} in on_face]
        if len(edge) != 2:
            continue
        ring = np.isin(zones, edge).sum(axis=1) == 2
        parts = [np.where(zones[ring] == end, len(points), zones[ring]) for end in edge]
        points = np.vstack([points, _inward(points, zones[ring], np.concatenate(parts), edge)])
        zones = np.concatenate([zones[~ring], *parts])
        parent = np.concatenate([parent[~ring], parent[ring], parent[ring]])
        order = np.argsort(parent, kind="stable")
        zones, parent = zones[order], parent[order]
    turned = tetrahedra.volumes(points, zones) < 0.0
    zones[turned] = zones[turned][:, [0, 2, 1, 3]]
    return points, zones, parent


def _inward(points, ring, parts, edge):
    """Return the position in m, between an edge and its ring, that leaves the thickest parts."""
    middle = points[edge].mean(axis=0)
    centre = points[np.setdiff1d(ring, edge)].mean(axis=0)
    solid = np.tile(thinness(points, ring) > _FLAT, 2)
    trials = middle + np.outer(_INWARD, centre - middle)
    least = []
    for trial in trials:
        moved = np.vstack([points, trial])
        upright = tetrahedra.volumes(moved, parts[solid]).min() > 0.0
        least.append(thinness(moved, parts).min() if upright else 0.0)
    return trials[int(np.argmax(least))]


_FRONTAL_QUADS, _QUADRILATERAL = 8, 3  # algorithm and kind of element of gmsh
_HALVED = 1.5  # size of triangles whose parts have at most a wanted edge
_DELAUNAY, _HXT = 1, 10  # algorithms of gmsh; HXT is several times as fast
_THINNEST = _FLAT  # of a mesh by HXT, which leaves flat zones at times, not all repaired
_MANY = 50_000  # triangles on the faces of blocks from which on HXT is tried first
_GROWTH = 0.3
# Degrees between facets that gmsh takes for overlapping; its default of 0.1 refuses thin wedges.
_NARROWEST = 0.001
_REPAIRS = 2
_INWARD = np.geomspace(0.02, 0.64, 11)  # of the way to the middle of the zones around


_NAME = "pyblast, gmsh"  # of our model of gmsh, and of the thread that works on it


class MeshingError(InputError):
    """Error of gmsh, raised where a block is too thin to be meshed."""


@dataclass(frozen=True)
class Slivers:
    """Zones whose smallest altitude is below a tenth of their longest edge.

    Parameters
    ----------
    count : int
    thinnest : float
        Smallest altitude over longest edge among all zones.
    """

    count: int
    thinnest: float


@contextmanager
def _gmsh():
    """Provide gmsh without output, with a new model, one thread and a fixed seed."""
    try:
        import gmsh
    except (ImportError, OSError) as error:
        raise InputError(
            f"build_mesh: gmsh can't be loaded ({str(error).splitlines()[0]}); install gmsh and "
            "the Debian packages libglu1-mesa libgl1 libxcursor1 libxft2 libxinerama1"
        ) from None
    for done in _running:
        done.wait()
    _running.clear()
    if gmsh.isInitialized() and _NAME in gmsh.model.list():  # which Ctrl-C has left behind
        gmsh.finalize()
    ours = not gmsh.isInitialized()
    if ours:
        gmsh.initialize(argv=[], readConfigFiles=False, interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.option.setNumber("General.NumThreads", 1)
    gmsh.option.setNumber("Mesh.RandomSeed", 1)
    gmsh.model.add(_NAME)
    try:
        yield gmsh
    finally:
        if not _running:
            gmsh.model.remove()
            if ours:
                gmsh.finalize()


_running: list[threading.Event] = []  # calls of gmsh that go on, also after Ctrl-C


def _call(function, *values):
    """Call gmsh in a thread of its own, for which Ctrl-C does not wait.

    HXT sets the number of OpenMP threads of the thread that calls it, and leaves it at one. An
    event is waited for, since a thread whose `join` is interrupted counts as ended in Python 3.11.
    """
    failed, done = [], threading.Event()

    def work():
        try:
            function(*values)
        except Exception as error:
            failed.append(error)
        finally:
            done.set()

    _running.append(done)
    threading.Thread(target=work, name=_NAME, daemon=True).start()
    done.wait()
    _running.remove(done)
    if failed:
        raise failed[0]


def mesh_cells(
    cells: CellComplex, boxes: Sequence[tuple], edge: float, optimize: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray, dict[str, np.ndarray], tuple[Slivers, Slivers]]:
    """Mesh cells with tetrahedra that conform on all faces.

    Parameters
    ----------
    cells : CellComplex
    boxes : sequence of ((3, 2) float64, float, float)
        Limits of a region, its edge, and the distance over which the edge grows to ``edge``, m.
    edge : float, m
        Edge outside all boxes.
    optimize : bool
        Improve thin zones by swapping faces and by smoothing within the faces of cells.

    Returns
    -------
    points : (n_nodes, 3) float64, m
    zones : (n_zones, 4) int64
    zone_cell : (n_zones,) int64
    surfaces : dict of str to (n, 3) int64
    slivers : tuple of 2 Slivers, before and after repair

    Raises
    ------
    InputError
        If gmsh is missing.
    MeshingError
        If gmsh fails.
    """
    with _gmsh() as gmsh:
        patches = _add_geometry(gmsh, cells)
        _set_sizes(gmsh, boxes, edge)
        repairs = _REPAIRS if optimize else 0
        if _mesh_faces(gmsh) >= _MANY:
            with suppress(MeshingError):
                mesh = _fill(gmsh, _HXT, cells, patches, repairs)
                if mesh[-1][1].thinnest > _THINNEST:
                    return mesh
            gmsh.model.mesh.clear()
            _mesh_faces(gmsh)
        return _fill(gmsh, _DELAUNAY, cells, patches, repairs)


def _mesh_faces(gmsh):
    """Mesh lines and faces; return the number of triangles."""
    with _explained():
        _call(gmsh.model.mesh.generate, 2)
    return sum(len(tags) for tags in gmsh.model.mesh.getElements(2)[1])


def _fill(gmsh, algorithm, cells, patches, repairs):
    """Fill the blocks by an algorithm of gmsh, repair thin zones, and return what was made."""
    gmsh.option.setNumber("Mesh.Algorithm3D", algorithm)
    with _explained():
        _call(gmsh.model.mesh.generate, 3)
    before = _count_slivers(*_read(gmsh, len(cells.faces))[1:3])
    for _ in range(repairs):
        with _explained():
            _call(gmsh.model.mesh.optimize, "")
        _smooth(gmsh, len(cells.faces), patches)
    points, zones, cell, surfaces = _collect(gmsh, cells, patches)
    return points, zones, cell, surfaces, (before, _count_slivers(points, zones))


@contextmanager
def _explained():
    """Turn errors of gmsh into `MeshingError` with advice."""
    try:
        yield
    except Exception as error:
        reason = str(error).splitlines()[0] if str(error) else "no reason given"
        raise MeshingError(
            f"build_mesh: gmsh could not fill the blocks ({reason}); change the edge, or move "
            "a joint that nearly touches another"
        ) from None


def _add_geometry(gmsh, cells):
    """Add the cells to gmsh's built-in kernel; return the gmsh surfaces of each face."""
    kernel = gmsh.model.geo
    used = sorted({v for loop in cells.loops for v in loop})
    for v in used:
        kernel.addPoint(*cells.points[v], tag=v + 1)
    lines, patches = {}, []
    for face in range(len(cells.loops)):
        patch = []
        for loop in facets(cells, face):
            curve = []
            for a, b in zip(loop, loop[1:] + loop[:1], strict=True):
                key = (min(a, b), max(a, b))
                if key not in lines:
                    lines[key] = kernel.addLine(key[0] + 1, key[1] + 1)
                curve.append(lines[key] if a < b else -lines[key])
            patch.append(kernel.addPlaneSurface([kernel.addCurveLoop(curve)]))
        patches.append(patch)
    for cell, faces in enumerate(cells.faces):
        skin = kernel.addSurfaceLoop([patch for f in sorted(faces) for patch in patches[f]])
        kernel.addVolume([skin], cell + 1)
    kernel.synchronize()
    return patches


def _set_sizes(gmsh, boxes, edge):
    """Set the edge lengths as a field of boxes."""
    for option, value in (
        ("MeshSizeFromPoints", 0),
        ("MeshSizeExtendFromBoundary", 1),
        ("MeshSizeMax", max(edge, *(inside for _, inside, _ in boxes))),
        ("Optimize", 0),
        ("Algorithm3D", _DELAUNAY),
        ("AngleToleranceFacetOverlap", _NARROWEST),
    ):
        gmsh.option.setNumber(f"Mesh.{option}", value)
    fields = gmsh.model.mesh.field
    numbers = []
    for limits, inside, distance in boxes:
        number = fields.add("Box")
        values = dict(
            zip(("XMin", "XMax", "YMin", "YMax", "ZMin", "ZMax"), np.ravel(limits), strict=True)
        )
        values |= {"VIn": inside, "VOut": edge, "Thickness": distance}
        for key, value in values.items():
            fields.setNumber(number, key, value)
        numbers.append(number)
    smallest = fields.add("Min")
    fields.setNumbers(smallest, "FieldsList", numbers)
    fields.setAsBackgroundMesh(smallest)


def growth_distance(inside: float, outside: float) -> float:
    """Return the distance over which edges may grow from one length to another, m."""
    return max(abs(outside - inside) / _GROWTH, 1e-3)


def _smooth(gmsh, n_cells, patches):
    """Smooth the nodes of thin zones in gmsh's mesh."""
    used, points, zones, _ = _read(gmsh, n_cells)
    triangles = [np.searchsorted(used, _elements(gmsh, 2, p, 3)) for face in patches for p in face]
    moved = smoothed(points, zones, triangles)
    for row in np.flatnonzero((moved != points).any(axis=1)):
        gmsh.model.mesh.setNode(int(used[row]), moved[row], [])


def _count_slivers(points, zones):
    """Count thin zones."""
    thin = thinness(points, zones)
    return Slivers(int(np.count_nonzero(thin < SLIVER)), float(thin.min()))


def _read(gmsh, n_cells):
    """Return gmsh's node numbers, points, zones of positive volume, and zones of each cell."""
    tags, places, _ = gmsh.model.mesh.getNodes()
    parts = [_elements(gmsh, 3, cell + 1, 4) for cell in range(n_cells)]
    zones = np.concatenate(parts)
    used = np.unique(zones)
    row = np.zeros(int(tags.max()) + 1, dtype=np.int64)
    row[tags.astype(np.int64)] = np.arange(len(tags))
    points = places.reshape(-1, 3)[row[used]]
    zones = np.searchsorted(used, zones)
    turned = tetrahedra.volumes(points, zones) < 0.0
    zones[turned] = zones[turned][:, [0, 2, 1, 3]]
    return used, points, zones, [len(part) for part in parts]


def _collect(gmsh, cells, patches):
    """Return points, zones, their cells and surfaces, with nodes numbered from 0."""
    used, points, zones, counts = _read(gmsh, len(cells.faces))
    triangles = [
        np.searchsorted(used, np.concatenate([_elements(gmsh, 2, number, 3) for number in patch]))
        for patch in patches
    ]
    surfaces = {}
    for tag, patch in zip(cells.tags, triangles, strict=True):
        if tag:
            surfaces.setdefault(tag, []).append(patch)
    surfaces = {name: np.concatenate(parts) for name, parts in surfaces.items()}
    points, zones, parent = split_flat(points, zones, np.concatenate(triangles))
    return points, zones, np.repeat(np.arange(len(counts)), counts)[parent], surfaces


def _elements(gmsh, dimension, tag, width):
    """Return the gmsh nodes (n, width) of the elements of one entity."""
    nodes = gmsh.model.mesh.getElements(dimension, tag)[2]
    return np.asarray(nodes[0] if nodes else [], dtype=np.int64).reshape(-1, width)


def section_mesh(
    limits: np.ndarray,
    vertices: np.ndarray,
    lines: np.ndarray,
    edge: float,
    edge_at: Callable[[float, float], float] | None = None,
    blossom: bool = True,
) -> tuple[np.ndarray, np.ndarray]:
    """Mesh a rectangle with quadrilaterals that conform to lines in it.

    Parameters
    ----------
    limits : (2, 2) float64, m
        Of the two axes.
    vertices : (n, 2) float64, m
    lines : (m, 2) int64
        Between vertices; they cross at vertices only, and end on each other or on the rectangle.
    edge : float, m
    edge_at : callable, optional
        Edge in m at a place (x, y), where it differs.
    blossom : bool
        Pair triangles by minimum-cost matching (Remacle et al. 2012), else one by one.

    Returns
    -------
    points : (n_nodes, 2) float64, m
    quadrilaterals : (n, 4) int64, counterclockwise

    Raises
    ------
    MeshingError
        If gmsh fails, or its quadrilaterals don't fill the rectangle.
    """
    (a0, a1), (b0, b1) = limits
    with _gmsh() as gmsh:
        kernel = gmsh.model.occ
        face = kernel.addRectangle(a0, b0, 0.0, a1 - a0, b1 - b0)
        number = {int(v): kernel.addPoint(*vertices[v], 0.0) for v in np.unique(lines)}
        cuts = [(1, kernel.addLine(number[int(i)], number[int(j)])) for i, j in lines]
        try:
            if cuts:
                _call(kernel.fragment, [(2, face)], cuts)
            kernel.synchronize()
            mapped = edge_at is None and _map_faces(gmsh, edge)
            options = {
                "MeshSizeMin": 0,
                "MeshSizeFromPoints": 0,
                "RecombineAll": 1,
                "Smoothing": 10,
            }
            options |= {"Algorithm": _FRONTAL_QUADS, "MeshSizeMax": edge if mapped else 2 * edge}
            options |= {"RecombinationAlgorithm": 3 if mapped else int(blossom)}
            options |= {"SubdivisionAlgorithm": 0 if mapped else 1}  # all into quadrilaterals
            for option, value in options.items():
                gmsh.option.setNumber(f"Mesh.{option}", value)
            if edge_at is not None:
                gmsh.model.mesh.setSizeCallback(
                    lambda _dim, _tag, x, y, _z, size: min(size, _HALVED * edge_at(x, y))
                )
            _call(gmsh.model.mesh.generate, 2)
        except Exception as error:
            raise MeshingError(f"gmsh could not mesh the section ({error})") from None
        return _quadrilaterals(gmsh, (a1 - a0) * (b1 - b0))


def _map_faces(gmsh, edge):
    """Map faces with four corners, opposite sides in equal steps; tell whether all are such."""
    mesh = gmsh.model.mesh
    curves = {}
    for _, curve in gmsh.model.getEntities(1):
        x0, y0, _, x1, y1, _ = gmsh.model.getBoundingBox(1, curve)
        curves[curve] = float(np.hypot(x1 - x0, y1 - y0))
    faces, pairs = [], []
    every = [face for _, face in gmsh.model.getEntities(2)]
    for face in every:
        loop = [abs(c) for _, c in gmsh.model.getBoundary([(2, face)], combined=False)]
        if len(loop) == len(set(loop)) == 4 and not mesh.getEmbedded(2, face):
            faces.append(face)
            pairs += [(loop[0], loop[2]), (loop[1], loop[3])]
    numbers = {curve: k for k, curve in enumerate(curves)}
    ends = np.array([[numbers[c] for c in pair] for pair in pairs], dtype=int).reshape(-1, 2)
    graph = coo_array((np.ones(len(ends)), ends.T), shape=(len(curves), len(curves)))
    label = connected_components(graph, directed=False)[1]
    steps = np.ceil(np.array(list(curves.values())) / edge - 0.05)
    most = np.ones(label.max() + 1)
    np.maximum.at(most, label, steps)
    whole = len(faces) == len(every)
    for curve, part in zip(curves, label, strict=True):
        n = most[part] if whole else max(1.0, np.ceil(most[part] / 2.0))
        mesh.setTransfiniteCurve(curve, int(n) + 1)
    for face in faces:
        mesh.setTransfiniteSurface(face)
        mesh.setRecombine(2, face)
    return whole


def _quadrilaterals(gmsh, area):
    """Return points (n, 2) and quadrilaterals (m, 4) of a section of a given area in m2."""
    tags, places, _ = gmsh.model.mesh.getNodes()
    kinds, _, nodes = gmsh.model.mesh.getElements(2)
    if list(kinds) != [_QUADRILATERAL]:
        raise MeshingError("gmsh could not mesh the section by quadrilaterals alone")
    used, quads = np.unique(np.asarray(nodes[0], dtype=np.int64), return_inverse=True)
    row = np.zeros(int(tags.max()) + 1, dtype=np.int64)
    row[tags.astype(np.int64)] = np.arange(len(tags))
    points, quads = places.reshape(-1, 3)[row[used], :2], quads.reshape(-1, 4)
    areas = quadrilateral_areas(points, quads)
    quads[areas < 0.0] = quads[areas < 0.0][:, ::-1]
    if abs(np.abs(areas).sum() - area) > 1e-6 * area:
        raise MeshingError("the quadrilaterals of the section overlap or leave gaps")
    return points, quads


def quadrilateral_areas(points: np.ndarray, quads: np.ndarray) -> np.ndarray:
    """Return the areas (n,) in m2 of plane quadrilaterals (n, 4), positive counterclockwise."""
    first = points[quads[:, 2]] - points[quads[:, 0]]
    second = points[quads[:, 3]] - points[quads[:, 1]]
    return 0.5 * (first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])
