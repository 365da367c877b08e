"""Cutting of a box into the cells between layers, joint sets and faults."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from .blocks import (
    CellComplex,
    box_cells,
    cell_vertices,
    copied,
    crooked_cells,
    edges,
    split_cell,
    split_edge,
    split_face,
    vertices_of,
)
from .grid import Fault, JointSet

_EXACT = 1e-6  # m, distance below which a vertex lies on a plane


@dataclass(frozen=True)
class CuttingPlane:
    """Cutting plane ``normal . x = offset``, with the surface of its facets.

    Parameters
    ----------
    normal : (3,) float64, unit
    offset : float, m
    tag : str, empty for no surface
    """

    normal: np.ndarray
    offset: float
    tag: str = ""

    def heights(self, points: np.ndarray) -> np.ndarray:
        """Return the signed distances (n,) of points (n, 3) in m."""
        return np.asarray(points) @ self.normal - self.offset


@dataclass(frozen=True)
class CutFaces:
    """Result of one cutting plane.

    Parameters
    ----------
    faces : list of int, faces on the plane
    bent : (n,) float64, distances by which it was bent to nearby vertices, m
    refused : int, cells that could not be cut
    """

    faces: list[int]
    bent: np.ndarray
    refused: int


def cut_cells(
    cells: CellComplex,
    chosen: Iterable[int],
    plane: CuttingPlane,
    tolerance: Callable[[np.ndarray], np.ndarray],
) -> tuple[CellComplex, CutFaces]:
    """Cut chosen cells along a plane.

    Vertices within the tolerance of the plane count as lying on it: the cut bends to them and
    leaves no part of a cell thinner than the tolerance. Fewer vertices are used where a cell would
    be inverted; a cell that can't be cut at all stays whole.

    Parameters
    ----------
    cells : CellComplex, not changed
    chosen : iterable of int
    plane : CuttingPlane
    tolerance : callable of points (n, 3) to (n,) float64, m

    Returns
    -------
    cells : CellComplex
    cut : CutFaces
    """
    chosen, whole = sorted(chosen), set()
    vertices = {v for c in chosen for v in vertices_of(cells, c)}
    height, limit = _heights(cells, vertices, plane, tolerance)
    while True:
        trial = copied(cells, chosen)
        cut, failed = _try_cut(trial, chosen, whole, plane, dict(height), limit)
        hopeless = set()
        for cell in failed - whole:
            bent = [v for v in vertices_of(cells, cell) if _is_bent(v, height, limit)]
            if bent:
                limit[max(bent, key=lambda v: (abs(height[v]), v))] = _EXACT
            else:
                hopeless.add(cell)
        if not failed - whole:
            return trial, cut
        whole |= hopeless


def _is_bent(vertex, height, limit):
    """Return whether the plane is bent to a vertex."""
    return vertex in height and _EXACT < abs(height[vertex]) <= limit[vertex]


def split_faces(
    cells: CellComplex,
    faces: Iterable[int],
    plane: CuttingPlane,
    tolerance: Callable[[np.ndarray], np.ndarray],
) -> list[int]:
    """Split faces, not cells, along a plane in place; return all parts."""
    vertices = {v for f in faces for v in cells.loops[f]}
    height, limit = _heights(cells, vertices, plane, tolerance)
    side = _sides(height, limit)
    _flatten_zigzags(cells, faces, side, height)
    return sorted(faces) + _split_faces(cells, sorted(faces), side, height)[0]


def _heights(cells, vertices, plane, tolerance):
    """Return height above the plane and tolerance of each vertex, as dicts, m."""
    vertices = sorted(vertices)
    places = np.array([cells.points[v] for v in vertices])
    height = dict(zip(vertices, plane.heights(places).tolist(), strict=True))
    limits = np.maximum(tolerance(places), _EXACT).tolist()
    return height, dict(zip(vertices, limits, strict=True))


def _sides(height, limit):
    """Return the side of the plane of each vertex: -1, 0 or 1."""
    return {v: (h > limit[v]) - (h < -limit[v]) for v, h in height.items()}


def _try_cut(cells, chosen, whole, plane, height, limit):
    """Cut in place; return the cut and the cells that it would invert."""
    side = _sides(height, limit)
    crossed = [c for c in chosen if c not in whole and _crossed(cells, c, side)]
    faces = sorted({f for c in crossed for f in cells.faces[c]})
    _flatten_zigzags(cells, faces, side, height)
    parts, touched = _split_faces(cells, faces, side, height)
    parent, new_faces, failed = {}, [], set()
    for cell in crossed:
        if _crossed(cells, cell, side):
            new = split_cell(cells, cell, side, plane.tag)
            if new is None:
                failed.add(cell)
            else:
                new_faces.append(new)
                parent[len(cells.faces) - 1] = cell
    changed = {c for f in touched.union(parts, new_faces) for c in cells.owners[f]}
    failed |= {parent.get(c, c) for c in crooked_cells(cells, changed)}
    lying = _tag_lying_faces(cells, [*chosen, *parent], side, plane)
    bent = [abs(height[v]) for v in sorted({v for f in new_faces + lying for v in cells.loops[f]})]
    bent = np.array([distance for distance in bent if distance > _EXACT])
    return CutFaces(new_faces + lying, bent, len(whole)), failed


def _crossed(cells, cell, side):
    """Return whether a cell has vertices on both sides."""
    sides = {side[v] for v in vertices_of(cells, cell)}
    return 1 in sides and -1 in sides


def _changes(loop, side):
    """Count the changes of side around a loop, without vertices on the plane."""
    signs = [side[v] for v in loop if side[v]]
    return sum(a != b for a, b in zip(signs, signs[1:] + signs[:1], strict=True))


def _flatten_zigzags(cells, faces, side, height):
    """Assign vertices of bent faces to the plane until it crosses each face once."""
    for face in faces:
        loop = cells.loops[face]
        while _changes(loop, side) > 2:
            lowest = min((v for v in loop if side[v]), key=lambda v: (abs(height[v]), v))
            side[lowest] = 0


def _split_faces(cells, faces, side, height):
    """Split the faces that have vertices on both sides; return new parts and all faces touched."""
    touched = set(faces)
    for a, b in sorted({e for f in faces for e in edges(cells.loops[f])}):
        if side[a] * side[b] < 0:
            touched |= split_edge(cells, a, b, height[a] / (height[a] - height[b]))
            side[len(cells.points) - 1] = 0
            height[len(cells.points) - 1] = 0.0
    split = [f for f in faces if _changes(cells.loops[f], side)]
    return [split_face(cells, f, side, height) for f in split], touched


def _tag_lying_faces(cells, chosen, side, plane):
    """Tag and return the faces on the plane between cells of different sides."""
    candidates = sorted({f for c in chosen for f in cells.faces[c]})
    tagged = []
    for face in candidates:
        if len(cells.owners[face]) < 2 or any(side[v] for v in cells.loops[face]):
            continue
        middles = [cell_vertices(cells, c).mean(axis=0) for c in cells.owners[face]]
        if np.prod(plane.heights(middles)) < 0.0 and not cells.tags[face]:
            cells.tags[face] = plane.tag
            tagged.append(face)
    return tagged


SIDES = ("west", "east", "south", "north", "bottom", "top")
# Fraction of the spacing by which a cut may bend to a vertex.
_SPACING_SHARE = 0.1
_DISC_SIDES = 12
# Joints nearer than this fraction of the spacing to a side of the box are left out.
_INSIDE = 1e-6


@dataclass(frozen=True)
class CutReport:
    """Report of the cutting: displacement of joints and slivers before and after repair.

    Parameters
    ----------
    cells : int
    bent : int, vertices to which a joint was moved
    largest, mean : float, m, displacement
    refused : int, cells that a joint could not cut
    slivers : tuple of 2 int
        Zones whose smallest altitude is below a tenth of their longest edge, before and after.
    thinnest : tuple of 2 float
        Smallest such ratio, before and after.
    terrain : float, m
        Largest displacement of the ground surface to a corner of joints.
    """

    cells: int
    bent: int
    largest: float
    mean: float
    refused: int
    slivers: tuple[int, int] = (0, 0)
    thinnest: tuple[float, float] = (0.0, 0.0)
    terrain: float = 0.0


@dataclass
class _Rock:
    """Cells during the cutting, with tolerances and statistics."""

    cells: CellComplex
    limits: np.ndarray
    tolerances: np.ndarray
    bent: list[np.ndarray]
    refused: int = 0

    def cut(self, chosen, plane, spacing=np.inf):
        """Cut cells along a plane; return the faces on it."""
        self.cells, cut = cut_cells(self.cells, chosen, plane, self.tolerance(spacing))
        self.bent.append(cut.bent)
        self.refused += cut.refused
        return cut.faces

    def layer(self, points):
        """Return the layer (n,) of points (n, 3)."""
        return np.searchsorted(-self.limits[1:-1], -np.asarray(points)[:, 2])

    def tolerance(self, spacing):
        """Return the tolerance as a function of position."""

        def near(points):
            return np.minimum(self.tolerances[self.layer(points)], _SPACING_SHARE * spacing)

        return near


def rock_cells(
    box: np.ndarray,
    limits: ArrayLike,
    tolerances: ArrayLike,
    joint_sets: Sequence[tuple[JointSet, set[int]]],
    faults: Sequence[Fault],
    margin: float = 0.0,
    top: float | None = None,
) -> tuple[CellComplex, CutReport]:
    """Cut a box into the cells between layers, joints and faults.

    Parameters
    ----------
    box : (3, 2) float64, m
    limits : (n_layers + 1,) float64, m, heights between layers from the top down
    tolerances : (n_layers,) float64, m
        Largest displacement of a joint to a nearby corner.
    joint_sets : sequence of (JointSet, set of int), with the layers it cuts
    faults : sequence of Fault
    margin : float, m
        Padding beyond sides and bottom of the box; joint sets end at the box.
    top : float or None, m
        Height up to which the first layer is continued; default: the top of the box.

    Returns
    -------
    cells : CellComplex
        Their kind is the layer, plus the number of layers for cells outside the box.
    report : CutReport
    """
    low, high = box[:, 0] - margin, box[:, 1] + [margin, margin, 0.0]
    high[2] = high[2] if top is None else top
    cells = box_cells(low, high, SIDES)
    tolerances = np.asarray(tolerances)
    rock = _Rock(cells, np.asarray(limits), np.zeros(len(tolerances)), [])
    box = np.column_stack([box[:, 0], [*box[:2, 1], high[2]]])  # with the ground above its top
    _cut_regions(rock, box, margin)
    rock.tolerances = tolerances
    spacings = [joints.spacing for joints, _ in joint_sets]
    for fault in faults:
        _cut_fault(rock, fault, min(spacings, default=np.inf))
    reach = np.vstack([box[:2], [box[2, 0], high[2]]])
    for joints, layers in joint_sets:
        _cut_joint_set(rock, joints, layers, reach)
    bent = np.concatenate([np.empty(0), *rock.bent])
    return rock.cells, CutReport(
        cells=len(rock.cells.faces),
        bent=len(bent),
        largest=float(bent.max(initial=0.0)),
        mean=float(bent.mean()) if len(bent) else 0.0,
        refused=rock.refused,
    )


def _cut_regions(rock, box, margin):
    """Cut at layers and at the limits of the box; assign each cell to a layer."""
    vertical = np.array([0.0, 0.0, 1.0])
    planes = [CuttingPlane(vertical, height) for height in rock.limits[1:-1]]
    if margin > 0.0:
        planes += [
            CuttingPlane(np.eye(3)[axis], box[axis, end]) for axis in (0, 1) for end in (0, 1)
        ]
        planes.append(CuttingPlane(vertical, box[2, 0]))
    for plane in planes:
        rock.cut(range(len(rock.cells.faces)), plane)
    middles = np.array([_middle(rock.cells, c) for c in range(len(rock.cells.faces))])
    outside = ((middles < box[:, 0]) | (middles > box[:, 1])).any(axis=1)
    count = len(rock.tolerances)
    rock.cells.kinds[:] = (rock.layer(middles) + count * outside).tolist()


def _middle(cells, cell):
    """Return the mean (3,) of the vertices of a cell."""
    return np.mean([cells.points[v] for v in vertices_of(cells, cell)], axis=0)


def _cut_joint_set(rock, joints, layers, box):
    """Cut the cells of some layers by all planes of a joint set."""
    normal = joints.normal
    corners = np.array(np.meshgrid(*box)).reshape(3, -1).T
    heights = (corners - joints.origin) @ normal / joints.spacing
    first, last = np.ceil(heights.min() + _INSIDE), np.floor(heights.max() - _INSIDE)
    for number in range(int(first), int(last) + 1):
        chosen = [c for c, kind in enumerate(rock.cells.kinds) if kind in layers]
        offset = np.dot(joints.origin, normal) + number * joints.spacing
        rock.cut(chosen, CuttingPlane(normal, offset, joints.name), joints.spacing)


def _cut_fault(rock, fault, spacing):
    """Cut by a fault, unbounded or within its extent."""
    plane = CuttingPlane(
        fault.unit_normal, float(np.dot(fault.unit_normal, fault.point)), fault.name
    )
    borders = _borders(fault)
    chosen = [c for c in range(len(rock.cells.faces)) if _within(rock.cells, c, borders)]
    faces = rock.cut(chosen, plane, spacing)
    for border in borders:
        trial = copied(rock.cells, {c for f in faces for c in rock.cells.owners[f]})
        parts = split_faces(trial, faces, border, rock.tolerance(spacing))
        if not crooked_cells(trial, {c for f in parts for c in trial.owners[f]}):
            rock.cells, faces = trial, parts
    for face in faces:
        middle = np.mean([rock.cells.points[v] for v in rock.cells.loops[face]], axis=0)
        if any(border.heights(middle) > 0.0 for border in borders):
            rock.cells.tags[face] = ""


def _borders(fault):
    """Return the outward planes around the extent of a fault, none if it is unbounded."""
    if fault.extent is None and fault.radius is None and fault.polygon is None:
        return []
    normal = fault.unit_normal
    if fault.polygon is not None:
        return _polygon_borders(fault.polygon, normal)
    strike = np.cross([0.0, 0.0, 1.0], normal)
    if not strike.any():  # of horizontal planes that of their dip direction
        angle = 0.5 * np.pi if fault.dip_direction is None else fault.dip_direction
        strike = np.array([-np.cos(angle), np.sin(angle), 0.0])
    strike /= np.linalg.norm(strike)
    down = np.cross(normal, strike)
    if fault.extent is not None:
        reach = [(strike, fault.extent[0] / 2.0), (down, fault.extent[1] / 2.0)]
        sides = [(sign * axis, half) for axis, half in reach for sign in (1.0, -1.0)]
    else:
        angles = 2.0 * np.pi * np.arange(_DISC_SIDES) / _DISC_SIDES
        # A polygon with the area of the disc.
        half = fault.radius * np.sqrt(np.pi / _DISC_SIDES / np.tan(np.pi / _DISC_SIDES))
        sides = [(np.cos(a) * strike + np.sin(a) * down, half) for a in angles]
    return [CuttingPlane(axis, float(np.dot(axis, fault.point)) + half) for axis, half in sides]


def _polygon_borders(corners, normal):
    """Return the outward planes through the edges of a convex polygon."""
    middle, planes = corners.mean(axis=0), []
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        across = np.cross(end - start, normal)
        length = np.linalg.norm(across)
        if length > _EXACT:
            across *= np.sign(across @ (start - middle)) / length
            planes.append(CuttingPlane(across, float(across @ start)))
    return planes


def _within(cells, cell, borders):
    """Return whether a part of a cell lies inside all border planes."""
    places = np.array([cells.points[v] for v in vertices_of(cells, cell)])
    return all(border.heights(places).min() < 0.0 for border in borders)
