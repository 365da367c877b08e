"""Mesh generation of jointed rock: layers, joint sets and faults in a box, meshed by gmsh."""

import logging
import warnings
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import LinearNDInterpolator, NearestNDInterpolator

from ..errors import InputError, PyblastWarning
from .block_cutter import SIDES, CutReport, rock_cells
from .blocks import area_vector
from .gmsh import MeshingError, growth_distance, mesh_cells
from .grid import Fault, JointSet, Layer, layer_limits, structured_box
from .mesh import Mesh
from .quality import MESHING_BYTES, ZONES_PER_CUBE, refuse_beyond_memory

__all__ = ["Fault", "JointSet", "Layer", "build_mesh", "build_mesh_report", "structured_box"]
_TOLERANCE_SHARE = 0.15
# Mean edge inside a volume over that of gmsh's size; edges on joints have that size (measured).
_INTERIOR_SHARE = 0.77
# Factors on the tolerance, tried in turn if gmsh takes facets for overlapping.
_RETRIES = (1.0, 0.5, 1.5, 0.25, 0.0)
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
        ``seed``, ``optimize``.

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
    surface : (n, 3) float64, m
        Surveyed top surface. The mesh with its layers and joints is stretched between the bottom
        and this surface.
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
    _refuse_too_many(box, limits, edges)
    sets = _placed_sets(joint_sets, faults, layers, box)
    margin = _margin(padding, edges)
    tolerances = _TOLERANCE_SHARE * edges if tolerance is None else np.full(len(edges), tolerance)
    regions, outside = _regions(box, limits, edges * _size_factors(sets, edges), padding)

    def fill(factor):
        cells, report = rock_cells(box, limits, factor * tolerances, sets, faults, margin)
        _weld_shares(cells, sets, seed)
        return cells, report, *mesh_cells(cells, regions, outside, optimize)

    cells, report, points, zones, cell, surfaces, slivers = _with_retries(fill)
    if surface is not None:
        points = _draped(points, np.asarray(surface, float), box[2, 0] - margin, box[2, 1])
    names = list(dict.fromkeys(layer.name for layer in layers))
    number = np.array([names.index(layer.name) for layer in layers])
    count, thinnest = zip(*((s.count, s.thinnest) for s in slivers), strict=True)
    report = replace(report, slivers=count, thinnest=thinnest)
    _announce(report, len(zones))
    zone_group = number[np.array(cells.kinds)[cell] % len(layers)]
    return Mesh(points, zones, zone_group, tuple(names), surfaces), report


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


def _refuse_too_many(box, limits, edges):
    """Raise InputError if the zones would not fit into memory."""
    area = np.prod(box[:2, 1] - box[:2, 0])
    count = ZONES_PER_CUBE * float(np.sum(area * -np.diff(limits) / edges**3))
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
    names = [part.name for part in (*joint_sets, *faults)]
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


def _draped(points, surface, low, high):
    """Stretch points between the bottom ``low`` and a surveyed surface at the height ``high``."""
    if surface.ndim != 2 or surface.shape[1] != 3 or len(surface) < 3:
        raise InputError(f"surface: needs three places (x, y, z) or more, got {surface.shape}")
    if not surface[:, 2].min() > low:
        raise InputError(
            f"surface: must lie above the bottom at {low:g} m, got {surface[:, 2].min():g} m"
        )
    top = LinearNDInterpolator(surface[:, :2], surface[:, 2])(points[:, :2])
    nearest = NearestNDInterpolator(surface[:, :2], surface[:, 2])(points[:, :2])
    top = np.where(np.isnan(top), nearest, top)
    share = (points[:, 2] - low) / (high - low)
    return np.column_stack([points[:, :2], low + share * (top - low)])


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
