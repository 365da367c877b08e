"""Cells that share faces, edges and vertices, and how they are split."""

from collections import defaultdict
from dataclasses import dataclass, field

import numpy as np


@dataclass
class Cells:
    """Cells that share faces, faces that share vertices; mutable while planes cut it.

    Parameters
    ----------
    points : list of (3,) float64, m
    loops : list of list of int, vertices of each face in turn
    tags : list of str, surface of each face, empty where none
    owners : list of set of int, one or two cells of each face
    faces : list of set of int, faces of each cell
    kinds : list of int, region of each cell
    ring : dict of (int, int) to set of int, faces at each edge
    """

    points: list = field(default_factory=list)
    loops: list = field(default_factory=list)
    tags: list = field(default_factory=list)
    owners: list = field(default_factory=list)
    faces: list = field(default_factory=list)
    kinds: list = field(default_factory=list)
    ring: dict = field(default_factory=lambda: defaultdict(set))


def box_cells(low, high, names) -> Cells:
    """Return one cell, a box, with its sides named in the order -x, +x, -y, +y, -z, +z."""
    cells = Cells(faces=[set()], kinds=[0])
    for z in (0, 1):
        for y in (0, 1):
            for x in (0, 1):
                cells.points.append(np.where([x, y, z], high, low).astype(float))
    sides = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]]
    for loop, name in zip(sides, names, strict=True):
        add_face(cells, loop, name, {0})
    return cells


def copied(cells):
    """Return a copy that shares nothing but the points, which never change."""
    return Cells(
        points=cells.points[:],
        loops=[loop[:] for loop in cells.loops],
        tags=cells.tags[:],
        owners=[owners.copy() for owners in cells.owners],
        faces=[faces.copy() for faces in cells.faces],
        kinds=cells.kinds[:],
        ring=defaultdict(set, {edge: faces.copy() for edge, faces in cells.ring.items()}),
    )


def edges(loop):
    """Yield the edges of a loop, each with its smaller vertex first."""
    for a, b in zip(loop, loop[1:] + loop[:1], strict=True):
        yield (a, b) if a < b else (b, a)


def add_face(cells, loop, tag, owners):
    """Append a face and enter it everywhere."""
    face = len(cells.loops)
    cells.loops.append(list(loop))
    cells.tags.append(tag)
    cells.owners.append(set(owners))
    for cell in owners:
        cells.faces[cell].add(face)
    for edge in edges(loop):
        cells.ring[edge].add(face)
    return face


def split_edge(cells, a, b, share):
    """Put a vertex on the edge from a to b, in every face around it; return those."""
    new = len(cells.points)
    cells.points.append(cells.points[a] + share * (cells.points[b] - cells.points[a]))
    around = cells.ring.pop((a, b))
    for face in around:
        loop = cells.loops[face]
        at = loop.index(a)
        loop.insert(at + 1 if loop[(at + 1) % len(loop)] == b else at, new)
        for edge in ((a, new), (b, new)):
            cells.ring[edge].add(face)
    return around


def split_face(cells, face, side, height):
    """Split one face between the two vertices on the plane that are nearest to it."""
    loop = cells.loops[face]
    n = len(loop)
    start = next(k for k in range(n) if side[loop[k]] == 1 and side[loop[k - 1]] != 1)
    turned = loop[start:] + loop[:start]
    last = max(k for k in range(n) if side[turned[k]] == -1)
    first = next(k for k in range(n) if side[turned[k]] == -1)
    end = max(k for k in range(first) if side[turned[k]] == 1)
    leave = min(range(end + 1, first), key=lambda k: abs(height[turned[k]]))
    enter = min(range(last + 1, n), key=lambda k: abs(height[turned[k]]))
    below = turned[leave : enter + 1]
    above = turned[enter:] + turned[: leave + 1]
    for edge in edges(loop):
        cells.ring[edge].discard(face)
    cells.loops[face] = above
    for edge in edges(above):
        cells.ring[edge].add(face)
    return add_face(cells, below, cells.tags[face], cells.owners[face])


def split_cell(cells, cell, side, tag):
    """Close the cut through a cell; return the new face, None where the cut does not close."""
    above = {f for f in cells.faces[cell] if any(side[v] == 1 for v in cells.loops[f])}
    below = cells.faces[cell] - above
    border = {e for f in above for e in edges(cells.loops[f])}
    border &= {e for f in below for e in edges(cells.loops[f])}
    loop = _single_loop(border)
    if loop is None:
        return None
    new_cell = len(cells.faces)
    cells.faces.append(set(below))
    cells.kinds.append(cells.kinds[cell])
    cells.faces[cell] = above
    for face in below:
        cells.owners[face].discard(cell)
        cells.owners[face].add(new_cell)
    return add_face(cells, loop, tag, {cell, new_cell})


def _single_loop(border):
    """Chain edges to one closed loop of vertices, None where they form no or several loops."""
    around = defaultdict(list)
    for a, b in sorted(border):
        around[a].append(b)
        around[b].append(a)
    if not border or any(len(ends) != 2 for ends in around.values()):
        return None
    loop, previous = [min(around)], None
    while True:
        ahead = next(v for v in around[loop[-1]] if v != previous)
        if ahead == loop[0]:
            return loop if len(loop) == len(around) else None
        previous = loop[-1]
        loop.append(ahead)


def cell_vertices(cells, cell):
    """Return the places (n, 3) of the vertices of a cell."""
    return np.array([cells.points[v] for v in sorted(vertices_of(cells, cell))])


def vertices_of(cells, cell):
    """Return the set of vertices of a cell."""
    return {v for f in cells.faces[cell] for v in cells.loops[f]}
