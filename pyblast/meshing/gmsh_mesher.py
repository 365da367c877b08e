"""Tetrahedra in cells through gmsh; the only importer of gmsh."""

from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from . import tetrahedra
from .block_shapes import facets
from .smoothing import SLIVER, smoothed, thinness

_DELAUNAY = 1
_GROWTH = 0.3
# Degrees between facets that gmsh takes for overlapping; its 0.1 refuses thin wedges.
_NARROWEST = 0.001
_REPAIRS = 2


class MeshingError(InputError):
    """The blocks are too thin somewhere for gmsh to fill them."""


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
    """Give a quiet gmsh with a fresh model, one thread and a fixed seed."""
    try:
        import gmsh
    except (ImportError, OSError) as error:
        raise InputError(
            f"build_mesh: gmsh can't be loaded ({str(error).splitlines()[0]}); install gmsh and "
            "the Debian packages libglu1-mesa libgl1 libxcursor1 libxft2 libxinerama1"
        ) from None
    ours = not gmsh.isInitialized()
    if ours:
        gmsh.initialize(argv=[], readConfigFiles=False, interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.option.setNumber("General.NumThreads", 1)
    gmsh.option.setNumber("Mesh.RandomSeed", 1)
    gmsh.model.add("pyblast")
    try:
        yield gmsh
    finally:
        gmsh.model.remove()
        if ours:
            gmsh.finalize()


def mesh_cells(cells, boxes, edge, optimize):
    """Fill cells with tetrahedra that conform on all faces.

    Parameters
    ----------
    cells : Cells
    boxes : sequence of ((3, 2) float64, float, float)
        Limits of a region, edge in it, and distance over which it grows to ``edge``, m.
    edge : float, m
        Outside all boxes.
    optimize : bool
        Repair thin zones: swap faces, and slide nodes within the faces of their cells.

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
        with _explained():
            gmsh.model.mesh.generate(3)
        before = _count_slivers(*_read(gmsh, len(cells.faces))[1:3])
        for _ in range(_REPAIRS if optimize else 0):
            with _explained():
                gmsh.model.mesh.optimize("")
            _smooth(gmsh, len(cells.faces), patches)
        points, zones, cell, surfaces = _collect(gmsh, cells, patches)
        return points, zones, cell, surfaces, (before, _count_slivers(points, zones))


@contextmanager
def _explained():
    """Say what to do where gmsh fails."""
    try:
        yield
    except Exception as error:
        reason = str(error).splitlines()[0] if str(error) else "no reason given"
        raise MeshingError(
            f"build_mesh: gmsh could not fill the blocks ({reason}); change the edge, or move "
            "a joint that nearly touches another"
        ) from None


def _add_geometry(gmsh, cells):
    """Hand the cells to gmsh's own kernel; return the gmsh surfaces of each face."""
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


def growth_distance(inside, outside):
    """Return the distance over which edges may grow from one length to another, m."""
    return max(abs(outside - inside) / _GROWTH, 1e-3)


def _smooth(gmsh, n_cells, patches):
    """Slide the nodes of thin zones; the patches of the geometry stay what they are."""
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
    """Read zones and surfaces back, nodes numbered from 0 without gaps."""
    used, points, zones, counts = _read(gmsh, len(cells.faces))
    surfaces = {}
    for tag, patch in zip(cells.tags, patches, strict=True):
        if tag:
            triangles = [_elements(gmsh, 2, number, 3) for number in patch]
            surfaces.setdefault(tag, []).extend(triangles)
    surfaces = {
        name: np.searchsorted(used, np.concatenate(found)) for name, found in surfaces.items()
    }
    return points, zones, np.repeat(np.arange(len(counts)), counts), surfaces


def _elements(gmsh, dimension, tag, width):
    """Return the gmsh nodes (n, width) of the elements of one entity."""
    nodes = gmsh.model.mesh.getElements(dimension, tag)[2]
    return np.asarray(nodes[0] if nodes else [], dtype=np.int64).reshape(-1, width)
