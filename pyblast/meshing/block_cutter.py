"""Cutting of convex cells by planes so that no part thinner than a tolerance is left over."""

from dataclasses import dataclass

import numpy as np

from .block_cells import (
    Cells,
    cell_vertices,
    copied,
    edges,
    split_cell,
    split_edge,
    split_face,
    vertices_of,
)
from .block_shapes import crooked_cells

_EXACT = 1e-6


@dataclass(frozen=True)
class Plane:
    """The plane ``normal . x = offset`` and the surface that its facets belong to.

    Parameters
    ----------
    normal : (3,) float64, unit
    offset : float, m
    tag : str, empty for no surface
    """

    normal: np.ndarray
    offset: float
    tag: str = ""

    def heights(self, points):
        """Return the signed distances (n,) of points (n, 3) in m."""
        return np.asarray(points) @ self.normal - self.offset


@dataclass(frozen=True)
class Cut:
    """What one plane did.

    Parameters
    ----------
    faces : list of int, faces on the plane
    bent : (n,) float64, how far it was bent to pass through vertices nearby, m
    refused : int, cells that it could not cut
    """

    faces: list[int]
    bent: np.ndarray
    refused: int


def cut_cells(cells, chosen, plane, tolerance) -> tuple[Cells, Cut]:
    """Cut chosen cells along a plane.

    A vertex nearer to the plane than the tolerance counts as lying on it, so the cut bends to
    pass through it and no part of a cell thinner than the tolerance is left over. Where that
    would turn a cell inside out, fewer vertices count; where a cut fails all the same, the cell
    stays whole.

    Parameters
    ----------
    cells : Cells, not changed
    chosen : iterable of int
    plane : Plane
    tolerance : callable of points (n, 3) to (n,) float64, m

    Returns
    -------
    cells : Cells
    cut : Cut
    """
    chosen, whole = sorted(chosen), set()
    vertices = {v for c in chosen for v in vertices_of(cells, c)}
    height, limit = _heights(cells, vertices, plane, tolerance)
    while True:
        trial = copied(cells)
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
    """Tell whether the plane bends to pass through a vertex."""
    return vertex in height and _EXACT < abs(height[vertex]) <= limit[vertex]


def split_faces(cells, faces, plane, tolerance) -> list[int]:
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
    """Return on which side of the plane each vertex counts: -1, 0 or 1."""
    return {v: (h > limit[v]) - (h < -limit[v]) for v, h in height.items()}


def _try_cut(cells, chosen, whole, plane, height, limit):
    """Cut in place; return the cut and the old cells that it would turn inside out."""
    side = _sides(height, limit)
    crossed = [c for c in chosen if c not in whole and _crossed(cells, c, side)]
    faces = sorted({f for c in crossed for f in cells.faces[c]})
    _flatten_zigzags(cells, faces, side, height)
    parts, touched = _split_faces(cells, faces, side, height)
    parent, made, failed = {}, [], set()
    for cell in crossed:
        if _crossed(cells, cell, side):
            new = split_cell(cells, cell, side, plane.tag)
            if new is None:
                failed.add(cell)
            else:
                made.append(new)
                parent[len(cells.faces) - 1] = cell
    changed = {c for f in touched.union(parts, made) for c in cells.owners[f]}
    failed |= {parent.get(c, c) for c in crooked_cells(cells, changed)}
    lying = _tag_lying_faces(cells, [*chosen, *parent], side, plane)
    bent = [abs(height[v]) for v in sorted({v for f in made + lying for v in cells.loops[f]})]
    bent = np.array([distance for distance in bent if distance > _EXACT])
    return Cut(made + lying, bent, len(whole)), failed


def _crossed(cells, cell, side):
    """Tell whether a cell has vertices on both sides."""
    found = {side[v] for v in vertices_of(cells, cell)}
    return 1 in found and -1 in found


def _changes(loop, side):
    """Count how often the side changes around a loop, vertices on the plane left out."""
    signs = [side[v] for v in loop if side[v]]
    return sum(a != b for a, b in zip(signs, signs[1:] + signs[:1], strict=True))


def _flatten_zigzags(cells, faces, side, height):
    """Move vertices onto the plane until it crosses each face once; bent faces may need it."""
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
    """Tag the faces that lie on the plane between cells of different sides."""
    candidates = sorted({f for c in chosen for f in cells.faces[c]})
    found = []
    for face in candidates:
        if len(cells.owners[face]) < 2 or any(side[v] for v in cells.loops[face]):
            continue
        middles = [cell_vertices(cells, c).mean(axis=0) for c in cells.owners[face]]
        if np.prod(plane.heights(middles)) < 0.0 and not cells.tags[face]:
            cells.tags[face] = plane.tag
            found.append(face)
    return found
