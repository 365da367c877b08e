"""Shapes of cells: flat facets of bent faces, and cells turned inside out."""

import numpy as np
from scipy.optimize import linprog

from .block_cells import vertices_of

_FLAT = 1e-6
_THINNEST = 1e-4


def facets(cells, face):
    """Return a face as flat polygons: itself where it is flat, triangles where it is bent.

    Parameters
    ----------
    cells : Cells
    face : int

    Returns
    -------
    list of list of int, vertices in turn
    """
    loop = cells.loops[face]
    places = np.array([cells.points[v] for v in loop])
    arms = places[1:] - places[0]
    normal = _crossed(arms[:-1], arms[1:]).sum(axis=0)
    if np.abs(arms @ normal).max() <= _FLAT * np.sqrt(normal @ normal):
        return [loop]
    return [[loop[k] for k in triangle] for triangle in _triangles(places)]


def _triangles(places):
    """Cut a polygon into triangles so that the smallest altitude among them is largest."""
    n = len(places)
    ways = places[None] - places[:, None]
    sides = np.sqrt((ways**2).sum(axis=2))
    normals = _crossed(ways[:, :, None], ways[:, None])
    longest = np.maximum(np.maximum(sides[:, :, None], sides[:, None]), sides[None])
    altitude = np.sqrt((normals**2).sum(axis=3)) / np.maximum(longest, _FLAT)
    best, middle = np.full((n, n), np.inf), np.zeros((n, n), dtype=int)
    for span in range(2, n):
        for i in range(n - span):
            k = i + span
            between = slice(i + 1, k)
            choices = np.minimum(best[i, between], best[between, k])
            choices = np.minimum(choices, altitude[i, between, k])
            middle[i, k] = i + 1 + np.argmax(choices)
            best[i, k] = choices.max()
    triangles, open_spans = [], [(0, n - 1)]
    while open_spans:
        i, k = open_spans.pop()
        if k - i > 1:
            j = int(middle[i, k])
            triangles.append((i, j, k))
            open_spans += [(i, j), (j, k)]
    return triangles


def crooked_cells(cells, candidates):
    """Return the cells whose surface is not seen, all of it and from inside, from any place.

    Parameters
    ----------
    cells : Cells
    candidates : iterable of int

    Returns
    -------
    list of int
    """
    candidates = sorted(candidates)
    faces = sorted({f for c in candidates for f in cells.faces[c]})
    flat = {face: facets(cells, face) for face in faces}
    areas = {face: [area_vector(cells, facet) for facet in flat[face]] for face in faces}
    suspects = [c for c in candidates if _is_hidden(cells, c, flat, areas)]
    return [c for c in suspects if _is_crooked(cells, c, flat, areas)]


def area_vector(cells, facet):
    """Return the area vector (3,) of a flat polygon, m2."""
    places = np.array([cells.points[v] for v in facet])
    arms = places[1:] - places[0]
    return 0.5 * _crossed(arms[:-1], arms[1:]).sum(axis=0)


def _crossed(one, other):
    """Return cross products (..., 3); numpy's own takes five times as long on a few vectors."""
    ahead, behind = [1, 2, 0], [2, 0, 1]
    return one[..., ahead] * other[..., behind] - one[..., behind] * other[..., ahead]


def _is_hidden(cells, cell, flat, areas):
    """Tell whether some facet of a cell is not seen from its middle."""
    places = [cells.points[v] for v in sorted(vertices_of(cells, cell))]
    middle = sum(places) / len(places)
    directed = set()
    for face in cells.faces[cell]:
        heights = [
            (cells.points[facet[0]] - middle) @ area / np.sqrt(area @ area)
            for facet, area in zip(flat[face], areas[face], strict=True)
        ]
        forward = heights[0] > 0.0
        if min(heights if forward else [-height for height in heights]) < _THINNEST:
            return True
        loop = cells.loops[face] if forward else cells.loops[face][::-1]
        directed.update(zip(loop, loop[1:] + loop[:1], strict=True))
    return any((b, a) not in directed for a, b in directed)


def _is_crooked(cells, cell, flat, areas):
    """Tell whether no place sees all facets of a cell from inside."""
    turns = _turns(cells, cell)
    if turns is None:
        return True
    normals, offsets, volume = [], [], 0.0
    for face, turn in turns.items():
        for facet, area in zip(flat[face], areas[face], strict=True):
            normal = turn * area / max(np.sqrt(area @ area), _FLAT**2)
            normals.append(normal)
            offsets.append(normal @ cells.points[facet[0]])
            volume += turn * (area @ cells.points[facet[0]])
    sign = 1.0 if volume > 0.0 else -1.0
    rows = np.column_stack([sign * np.array(normals), np.ones(len(normals))])
    deepest = linprog(
        [0.0, 0.0, 0.0, -1.0], rows, sign * np.array(offsets), bounds=[(None, None)] * 4
    )
    return deepest.status != 0 or -deepest.fun < _THINNEST


def _turns(cells, cell):
    """Return 1 or -1 for each face of a cell so that all are turned alike, None where none fit."""
    faces = cells.faces[cell]
    start = min(faces)
    turns, waiting = {start: 1}, [start]
    while waiting:
        face = waiting.pop()
        loop = cells.loops[face][:: turns[face]]
        for a, b in zip(loop, loop[1:] + loop[:1], strict=True):
            for other in cells.ring[min(a, b), max(a, b)] & faces - {face}:
                around = cells.loops[other]
                turn = 1 if around[around.index(b) - len(around) + 1] == a else -1
                if other not in turns:
                    turns[other] = turn
                    waiting.append(other)
                elif turns[other] != turn:
                    return None
    return turns
