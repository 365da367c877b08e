"""Shapes of cells: flat facets of bent faces, and cells turned inside out."""

from functools import cache

import numpy as np

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
    sides = np.linalg.norm(places[:, None] - places[None], axis=2)

    def altitude(i, j, k):
        normal = _crossed(places[j] - places[i], places[k] - places[i])
        return np.sqrt(normal @ normal) / max(sides[i, j], sides[j, k], sides[i, k])

    @cache
    def best(i, k):
        if k - i < 2:
            return np.inf, ()
        choices = []
        for j in range(i + 1, k):
            (one, left), (other, right) = best(i, j), best(j, k)
            choices.append((min(one, other, altitude(i, j, k)), (*left, *right, (i, j, k))))
        return max(choices)

    return best(0, len(places) - 1)[1]


def crooked_cells(cells, candidates):
    """Return the cells whose surface is not seen, all of it and from inside, from their middle.

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
    return [c for c in candidates if _is_crooked(cells, c, flat, areas)]


def area_vector(cells, facet):
    """Return the area vector (3,) of a flat polygon, m2."""
    places = np.array([cells.points[v] for v in facet])
    arms = places[1:] - places[0]
    return 0.5 * _crossed(arms[:-1], arms[1:]).sum(axis=0)


def _crossed(one, other):
    """Return cross products (..., 3); numpy's own takes five times as long on a few vectors."""
    ahead, behind = [1, 2, 0], [2, 0, 1]
    return one[..., ahead] * other[..., behind] - one[..., behind] * other[..., ahead]


def _is_crooked(cells, cell, flat, areas):
    """Tell whether some facet of a cell is not seen from inside."""
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
