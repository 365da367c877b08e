"""Polyhedral cells with shared faces, edges and vertices; facets and convexity."""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
import scipy
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components


@dataclass
class CellComplex:
    """Complex of polyhedral cells with shared faces and vertices, changed in place by cuts.

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

    points: list[np.ndarray] = field(default_factory=list)
    loops: list[list[int]] = field(default_factory=list)
    tags: list[str] = field(default_factory=list)
    owners: list[set[int]] = field(default_factory=list)
    faces: list[set[int]] = field(default_factory=list)
    kinds: list[int] = field(default_factory=list)
    ring: dict[tuple[int, int], set[int]] = field(default_factory=lambda: defaultdict(set))


def box_cells(low: np.ndarray, high: np.ndarray, names: Sequence[str]) -> CellComplex:
    """Return one cell, a box, with its sides named in the order -x, +x, -y, +y, -z, +z."""
    cells = CellComplex(faces=[set()], kinds=[0])
    for z in (0, 1):
        for y in (0, 1):
            for x in (0, 1):
                cells.points.append(np.where([x, y, z], high, low).astype(float))
    sides = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]]
    for loop, name in zip(sides, names, strict=True):
        add_face(cells, loop, name, {0})
    return cells


def copied(cells: CellComplex, chosen: Iterable[int]) -> CellComplex:
    """Return a copy whose chosen cells may be cut; what no cut of them changes is shared."""
    points, loops, tags = cells.points[:], cells.loops[:], cells.tags[:]
    owners, faces, kinds = cells.owners[:], cells.faces[:], cells.kinds[:]
    copy = CellComplex(points, loops, tags, owners, faces, kinds, cells.ring.copy())
    own = {edge for c in chosen for f in cells.faces[c] for edge in edges(cells.loops[f])}
    around = {f for edge in own for f in cells.ring[edge]}
    for face in around:
        copy.loops[face] = cells.loops[face][:]
        copy.owners[face] = cells.owners[face].copy()
    for cell in {c for f in around for c in cells.owners[f]}:
        copy.faces[cell] = cells.faces[cell].copy()
    for edge in own:
        copy.ring[edge] = cells.ring[edge].copy()
    return copy


def edges(loop: list[int]) -> Iterator[tuple[int, int]]:
    """Yield the edges of a loop, each with its smaller vertex first."""
    for a, b in zip(loop, loop[1:] + loop[:1], strict=True):
        yield (a, b) if a < b else (b, a)


def add_face(cells: CellComplex, loop: list[int], tag: str, owners: Iterable[int]) -> int:
    """Append a face and update cells and edges; return its number."""
    face = len(cells.loops)
    cells.loops.append(list(loop))
    cells.tags.append(tag)
    cells.owners.append(set(owners))
    for cell in owners:
        cells.faces[cell].add(face)
    for edge in edges(loop):
        cells.ring[edge].add(face)
    return face


def split_edge(cells: CellComplex, a: int, b: int, share: float) -> set[int]:
    """Insert a vertex on the edge from a to b; return the faces around it."""
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


def split_face(
    cells: CellComplex, face: int, side: dict[int, int], height: dict[int, float]
) -> int:
    """Split a face between its two vertices on the plane; return the new face."""
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


def split_cell(cells: CellComplex, cell: int, side: dict[int, int], tag: str) -> int | None:
    """Split a cell; return the new face, None if the cut is not a closed loop."""
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
    """Return the single closed loop of vertices of edges, None if there is not exactly one."""
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


def cell_vertices(cells: CellComplex, cell: int) -> np.ndarray:
    """Return the positions (n, 3) of the vertices of a cell."""
    return np.array([cells.points[v] for v in sorted(vertices_of(cells, cell))])


def vertices_of(cells: CellComplex, cell: int) -> set[int]:
    """Return the set of vertices of a cell."""
    return {v for f in cells.faces[cell] for v in cells.loops[f]}


_FLAT = 1e-6
_THINNEST = 1e-4


def facets(cells: CellComplex, face: int) -> list[list[int]]:
    """Return a face as flat polygons: itself if it is flat, triangles if it is bent.

    Parameters
    ----------
    cells : CellComplex
    face : int

    Returns
    -------
    list of list of int, vertices in turn
    """
    loop = cells.loops[face]
    places = np.array([cells.points[v] for v in loop])
    arms = places[1:] - places[0]
    normal = _cross(arms[:-1], arms[1:]).sum(axis=0)
    if np.abs(arms @ normal).max() <= _FLAT * np.sqrt(normal @ normal):
        return [loop]
    return [[loop[k] for k in triangle] for triangle in _triangles(places)]


def _triangles(places):
    """Return the triangulation of a polygon with the largest smallest altitude."""
    n = len(places)
    vectors = places[None] - places[:, None]
    sides = np.sqrt((vectors**2).sum(axis=2))
    normals = _cross(vectors[:, :, None], vectors[:, None])
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


def crooked_cells(cells: CellComplex, candidates: Iterable[int]) -> list[int]:
    """Return the cells that are not star-shaped: no point sees the whole surface from inside.

    Parameters
    ----------
    cells : CellComplex
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


def area_vector(cells: CellComplex, facet: list[int]) -> np.ndarray:
    """Return the area vector (3,) of a flat polygon, m2."""
    places = np.array([cells.points[v] for v in facet])
    arms = places[1:] - places[0]
    return 0.5 * _cross(arms[:-1], arms[1:]).sum(axis=0)


def _cross(first, second):
    """Return cross products (..., 3); five times faster than numpy's for a few vectors."""
    ahead, behind = [1, 2, 0], [2, 0, 1]
    return first[..., ahead] * second[..., behind] - first[..., behind] * second[..., ahead]


def _is_hidden(cells, cell, flat, areas):
    """Return whether a facet of a cell is not visible from its centre."""
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
    """Return whether no point sees all facets of a cell from inside (linear programme)."""
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
    deepest = scipy.optimize.linprog(
        [0.0, 0.0, 0.0, -1.0], rows, sign * np.array(offsets), bounds=[(None, None)] * 4
    )
    return deepest.status != 0 or -deepest.fun < _THINNEST


def _turns(cells, cell):
    """Return the orientation, 1 or -1, of each face of a cell, None if inconsistent."""
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


_COPLANAR = 1e-7  # m, distance within which faces lie in one plane


def carved(cells: CellComplex, removed: set[int], exposed: str, seam: str) -> CellComplex:
    """Return cells without some of them, and without the seams between parts of one cell.

    Parameters
    ----------
    cells : CellComplex, not changed
    removed : set of int, cells to leave out
    exposed : str, tag of the faces that come to lie open
    seam : str
        Tag of auxiliary faces: parts of cells that meet at one become one cell again.

    Returns
    -------
    Cells
        Renumbered; faces in one plane between the same cells are joined.
    """
    retained = [c for c in range(len(cells.faces)) if c not in removed]
    joined = [
        face
        for face, owners in enumerate(cells.owners)
        if cells.tags[face] == seam
        and len(owners - removed) == 2
        and len({cells.kinds[c] for c in owners}) == 1
    ]
    whole = _labels(retained, [tuple(cells.owners[face]) for face in joined])
    kinds = {whole[c]: cells.kinds[c] for c in retained}
    new = CellComplex(points=cells.points[:], faces=[set() for _ in kinds])
    new.kinds = [kinds[c] for c in range(len(kinds))]
    dissolved = set(joined)
    for face, owners in enumerate(cells.owners):
        remaining = owners - removed
        if remaining and face not in dissolved:
            tag = "" if cells.tags[face] == seam else cells.tags[face]
            tag = exposed if len(remaining) < len(owners) else tag
            add_face(new, cells.loops[face], tag, {whole[c] for c in remaining})
    return _tidied(new)


def _labels(items, pairs):
    """Label the groups of items that pairs connect; return the number of each item."""
    row_of = {item: row for row, item in enumerate(items)}
    rows = [[row_of[a], row_of[b]] for a, b in pairs]
    ends = np.array(rows, dtype=int).reshape(-1, 2).T
    table = coo_array((np.ones(len(rows)), (ends[0], ends[1])), (len(items), len(items)))
    numbers = connected_components(table, directed=False)[1]
    return dict(zip(items, numbers.tolist(), strict=True))


def _tidied(cells):
    """Join the coplanar faces between the same cells and drop vertices amid straight edges."""
    normals = [_unit_normal(cells, loop) for loop in cells.loops]
    pairs = []
    for faces in cells.ring.values():
        if len(faces) == 2:
            first, second = sorted(faces)
            same = cells.owners[first] == cells.owners[second]
            same = same and cells.tags[first] == cells.tags[second]
            if same and _in_one_plane(cells, first, second, normals):
                pairs.append((first, second))
    groups: dict[int, list[int]] = defaultdict(list)
    for face, number in _labels(list(range(len(cells.loops))), pairs).items():
        groups[number].append(face)
    loops = []
    for group in groups.values():
        outline = None if len(group) == 1 else _outline(cells, group, normals[group[0]])
        if outline is None:
            loops += [(cells.loops[face], face) for face in group]
        else:
            loops.append((outline, group[0]))
    straight = _amid_straight_edges(cells.points, [loop for loop, _ in loops])
    new = CellComplex(points=cells.points, faces=[set() for _ in cells.faces], kinds=cells.kinds)
    for loop, face in loops:
        bent = [v for v in loop if v not in straight]
        add_face(new, bent, cells.tags[face], cells.owners[face])
    return new


def _unit_normal(cells, loop):
    """Return the unit normal (3,) of a face."""
    area = area_vector(cells, loop)
    return area / max(np.sqrt(area @ area), _FLAT**2)


def _in_one_plane(cells, first, second, normals):
    """Return whether two faces are flat and lie in one plane."""
    places = np.array([cells.points[v] for v in cells.loops[first] + cells.loops[second]])
    heights = (places - places[0]) @ normals[first]
    return np.abs(heights).max() <= _COPLANAR


def _outline(cells, group, normal):
    """Return the single outline of faces in one plane, None if there is none."""
    ways = set()
    for face in group:
        loop = cells.loops[face]
        loop = loop if area_vector(cells, loop) @ normal > 0.0 else loop[::-1]
        ways.update(zip(loop, loop[1:] + loop[:1], strict=True))
    inner = {
        (a, b) for a, b in ways if (b, a) in ways and len(cells.ring[min(a, b), max(a, b)]) == 2
    }
    ways -= inner
    ahead = dict(ways)
    if len(ahead) != len(ways) or not ways:
        return None
    loop = [min(ahead)]
    while ahead.get(loop[-1]) not in (None, loop[0]) and len(loop) < len(ahead):
        loop.append(ahead[loop[-1]])
    return loop if len(loop) == len(ahead) and ahead.get(loop[-1]) == loop[0] else None


def _amid_straight_edges(points, loops):
    """Return the vertices that only part a straight edge."""
    beside: dict[int, set[int]] = defaultdict(set)
    for a, b in {e for loop in loops for e in edges(loop)}:
        beside[a].add(b)
        beside[b].add(a)
    straight = set()
    for vertex in sorted(beside):
        if len(beside[vertex]) != 2:
            continue
        a, b = beside[vertex]
        along, first = points[b] - points[a], points[vertex] - points[a]
        across = _cross(along, first)
        if across @ across <= _COPLANAR**2 * (along @ along):
            straight.add(vertex)
            beside[a] = beside[a] - {vertex} | {b}
            beside[b] = beside[b] - {vertex} | {a}
    return straight
