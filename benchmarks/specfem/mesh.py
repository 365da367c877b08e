"""Hexahedral meshes of a ground as the database that SPECFEM3D reads: lines, stretched columns."""

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.io import FortranFile

from .ground import VOID, Ground

CORNERS = ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1))
SIDES = (  # faces of a hexahedron by corners: west, east, south, north, bottom, top
    (0, 3, 7, 4), (1, 2, 6, 5), (0, 1, 5, 4), (3, 2, 6, 7), (0, 1, 2, 3), (4, 5, 6, 7),
)  # fmt: skip
PER_WAVE, PER_SLOW = 0.5, 0.8  # of the shortest S wave in rock, in slower layers: edges
PADDING, DEPTH = 50.0, 110.0  # m, beyond the site and below the flat ground, to the layer
ABSORBING, WIDE = 2, 80.0  # elements across the matched layer, m across one
REGIONS = {  # numbers of the parts of the matched layer by the axes along which they act
    (1, 0, 0): 1, (0, 1, 0): 2, (0, 0, 1): 3, (1, 1, 0): 4, (1, 0, 1): 5, (0, 1, 1): 6,
    (1, 1, 1): 7,
}  # fmt: skip
GROWTH = 2.0  # of edges beyond the site
LEAST = 3.0  # m, between lines
NO_Q = 9999.0
WORD = 512  # characters of a word of a table for materials from a file
P_OVER_S = 1.5  # ratio of the quality factors of P and S waves
NEAREST = 0.1727  # first of the distances between the nodes of an element, of its edge
COURANT = 0.42  # 0.49 is the limit of five nodes along an edge
EDGES = (  # of a hexahedron by its corners, along its three directions
    ((0, 1), (3, 2), (4, 5), (7, 6)), ((0, 3), (1, 2), (4, 7), (5, 6)),
    ((0, 4), (1, 5), (2, 6), (3, 7)),
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Mesh:
    """A mesh of hexahedra.

    Parameters
    ----------
    lines : tuple of 3 float64 arrays, m
        Along x, y and height over the flat ground, before columns are stretched.
    nodes : (n_nodes, 3) float64, m
    elements : (n_elements, 8) int64
    layers : (n_elements,) int64
        Number of the layer of an element, after the layers those of the bodies.
    regions : (n_elements,) int64
        Numbers of `REGIONS`, 0 inside of the matched layer.
    sides : tuple of 6 (elements, nodes (n, 4))
        West, east, south, north, bottom, top.
    """

    lines: tuple
    nodes: np.ndarray
    elements: np.ndarray
    layers: np.ndarray
    regions: np.ndarray
    sides: tuple

    def height(self, x, y):
        """Return the height of the top of the mesh at a place: bilinear between its lines."""
        columns, rows, levels = (len(line) for line in self.lines)
        top = self.nodes[:, 2].reshape(columns, rows, levels)[..., -1]
        at = []
        for line, value in zip(self.lines[:2], (x, y), strict=True):
            k = int(np.clip(np.searchsorted(line, value) - 1, 0, len(line) - 2))
            at.append((k, (value - line[k]) / (line[k + 1] - line[k])))
        (i, u), (j, v) = at
        near = top[i : i + 2, j : j + 2]
        return float(np.array([1 - u, u]) @ near @ np.array([1 - v, v]))


def lines_of(limits, site, breaks, edge):
    """Return lines (n,) in m: no further apart than ``edge``, ``GROWTH`` times beyond the site.

    Parameters
    ----------
    limits, site : tuple of 2 float, m
        Of the mesh and of the site within it.
    breaks : sequence of float, m
        Where a line must be, or within `LEAST` where another is as near.
    edge : float, m
    """
    fixed = list(dict.fromkeys([*limits, *site]))
    for place in breaks:
        inside = limits[0] < place < limits[1]
        if inside and min(abs(place - other) for other in fixed) >= LEAST:
            fixed.append(float(place))
    fixed.sort()
    found = [fixed[:1]]
    for low, high in pairwise(fixed):
        longest = edge if site[0] <= low and high <= site[1] else GROWTH * edge
        count = max(1, int(np.ceil((high - low) / longest - 1e-6)))
        found.append(np.linspace(low, high, count + 1)[1:])
    return np.concatenate(found)


def mesh_of(ground: Ground, size, frequency: float, finer: float = 1.0, breaks=((), ())) -> Mesh:
    """Mesh a ground.

    Parameters
    ----------
    ground : Ground
    size : tuple of 2 float, m
        Of the site, from (0, 0) on.
    frequency : float, Hz
        Highest that it carries.
    finer : float
        Factor by which edges are shorter.
    breaks : tuple of 2 sequences of float, m
        Further lines along x and y, as at the foot of a slope.
    """
    rock = ground.layers[-1][1].cs
    slow = [body.factor * rock for body in ground.bodies if body.factor != VOID]
    slow += [layer.cs for _, layer in ground.layers[:-1]]
    deepest = PER_WAVE * rock / frequency / finer
    edge = min([deepest, *(PER_SLOW * cs / frequency / finer for cs in slow)])
    lines = [
        lines_of((-PADDING, size[axis] + PADDING), (0.0, size[axis]),
                 [*breaks[axis], *(b for body in ground.bodies for b in body.limits[axis])], edge)
        for axis in (0, 1)
    ]  # fmt: skip
    heights = [*ground.tops(), *(z for body in ground.bodies for z in body.limits[2])]
    upper = lines_of((-DEPTH, 0.0), (-DEPTH, 0.0), heights, deepest)
    lines.append(_split(upper, ground, edge))
    outer = WIDE * np.arange(1, ABSORBING + 1)
    lines = [np.concatenate([line[0] - outer[::-1], line, line[-1] + outer]) for line in lines]
    lines[2] = lines[2][:-ABSORBING]
    return _assembled(ground, tuple(lines))


def _split(levels, ground, edge):
    """Return levels of which those in slow layers are no further apart than ``edge``."""
    found = [levels[:1]]
    for low, high in pairwise(levels):
        slow = ground.layer_of(0.5 * (low + high)) < len(ground.layers) - 1
        count = int(np.ceil((high - low) / edge - 1e-6)) if slow else 1
        found.append(np.linspace(low, high, count + 1)[1:])
    return np.concatenate(found)


def _assembled(ground, lines):
    """Return the mesh between lines, without its cavities."""
    shape = tuple(len(line) for line in lines)
    x, y, z = (each.ravel() for each in np.meshgrid(*lines, indexing="ij"))
    stretched = z + ground.surface(x, y) * np.maximum(z + DEPTH, 0.0) / DEPTH
    nodes = np.column_stack([x, y, stretched])
    cells = np.stack(np.meshgrid(*(np.arange(n - 1) for n in shape), indexing="ij"), -1)
    cells = cells.reshape(-1, 3)
    corners = [np.ravel_multi_index((cells + corner).T, shape) for corner in CORNERS]
    elements = np.column_stack(corners)
    middles = np.column_stack([x, y, z])[elements].mean(axis=1)
    layers = ground.layer_of(middles[:, 2])
    there = np.ones(len(cells), bool)
    for number, body in enumerate(ground.bodies, len(ground.layers)):
        inside = body.holds(middles)
        layers[inside] = number
        there &= ~inside if body.factor == VOID else True
    cells, elements, layers = cells[there], elements[there], layers[there]
    last = np.array(shape) - 1 - ABSORBING
    outside = (cells < ABSORBING) | (cells >= last)
    outside[:, 2] = cells[:, 2] < ABSORBING
    regions = np.array([REGIONS.get(tuple(axes), 0) for axes in outside.astype(int).tolist()])
    sides = []
    for side, face in enumerate(SIDES):
        axis, end = divmod(side, 2)
        at = np.flatnonzero(cells[:, axis] == (shape[axis] - 2 if end else 0))
        sides.append((at, elements[at][:, face]))
    return Mesh(lines, nodes, elements, layers, regions, tuple(sides))


def time_step(mesh: Mesh, ground: Ground) -> float:
    """Return a stable time step in s.

    `COURANT` times the first distance between nodes over the P speed, of a cube with as large a
    sum of inverse squares of edges: flat elements allow longer ones than their least edge.
    """
    places = mesh.nodes[mesh.elements]
    squares = 0.0
    for pairs in EDGES:
        lengths = [np.linalg.norm(places[:, a] - places[:, b], axis=1) for a, b in pairs]
        squares = squares + np.min(lengths, axis=0) ** -2
    fastest = np.array([rock.cp for rock in rocks_of(ground)])[mesh.layers]
    reserve = 1.0 if ground.field is None else 1.0 + 4.0 * ground.field.deviation
    return float(COURANT * NEAREST * np.min(np.sqrt(3.0 / squares) / fastest) / reserve)


def rocks_of(ground: Ground):
    """Return the materials of layers and, after them, of bodies, made of the last layer."""
    rock = ground.layers[-1][1]
    return [each for _, each in ground.layers] + [
        rock.scaled(cp=body.factor or 1.0, cs=body.factor or 1.0) for body in ground.bodies
    ]


def write_database(folder: Path, mesh: Mesh, ground: Ground):
    """Write a mesh where SPECFEM3D looks for it, and models of materials that vary."""
    used = np.unique(mesh.elements)
    number = np.zeros(len(mesh.nodes), np.int32)
    number[used] = np.arange(1, len(used) + 1)
    varies = ground.field is not None
    with FortranFile(folder / "DATABASES_MPI" / "proc000000_Database", "w") as file:
        file.write_record(np.int32(len(used)))
        for n, place in enumerate(mesh.nodes[used], 1):
            file.write_record(np.int32(n), place)
        rocks = rocks_of(ground)
        count = np.array([0, len(rocks)] if varies else [len(rocks), 0], np.int32)
        file.write_record(count)
        for n, rock in enumerate(rocks, 1):
            file.write_record(*_material(folder, n, rock, ground, mesh))
        file.write_record(np.int32(len(mesh.elements)))
        sign = -1 if varies else 1
        for n, (corners, layer) in enumerate(zip(mesh.elements, mesh.layers, strict=True), 1):
            head = [n, sign * (layer + 1), 2 if varies else 0]
            file.write_record(np.array([*head, *number[corners]], np.int32))
        for n, (at, _) in enumerate(mesh.sides, 1):
            file.write_record(np.array([n, len(at)], np.int32))
        for at, faces in mesh.sides:
            for element, face in zip(at, faces, strict=True):
                file.write_record(np.array([element + 1, *number[face]], np.int32))
        absorbing = np.flatnonzero(mesh.regions)
        file.write_record(np.int32(len(absorbing)))
        file.write_record(np.int32(len(absorbing)))
        for element in absorbing:
            file.write_record(np.array([element + 1, mesh.regions[element]], np.int32))
        for region in mesh.regions:
            file.write_record(np.int32(region > 0))
        file.write_record(np.array([0, 0], np.int32))  # interfaces with other processes


def _material(folder, n, rock, ground, mesh):
    """Return the record of a material; where it varies, write its file first."""
    if ground.field is None:
        q = (NO_Q, NO_Q) if ground.q is None else (_bulk(rock, ground.q), ground.q)
        values = np.zeros(17)
        values[:7] = rock.density, rock.cp, rock.cs, *q, 0.0, 2.0
        return (values,)
    name = f"layer{n}.xyz"
    _write_model(folder / "DATA" / "tomo_files" / name, rock, ground.field, mesh)
    words = (str(-n), "tomography", "elastic", name, "0", "2")
    return (np.frombuffer("".join(word.ljust(WORD) for word in words).encode(), np.uint8),)


def _bulk(rock, q):
    """Return the bulk quality factor at which P waves have `P_OVER_S` of that of S waves."""
    share = 4.0 / 3.0 * (rock.cs / rock.cp) ** 2
    return (1.0 - share) / (1.0 / P_OVER_S - share) * q


def _write_model(path, rock, field, mesh):
    """Write speeds and density on a grid, x fastest."""
    path.parent.mkdir(parents=True, exist_ok=True)
    low, high = mesh.nodes.min(axis=0), mesh.nodes.max(axis=0)
    step = min(12.0, field.length / 4.0)
    counts = np.ceil((high - low) / step).astype(int) + 1
    axes = [begin + step * np.arange(count) for begin, count in zip(low, counts, strict=True)]
    z, y, x = (each.ravel() for each in np.meshgrid(*axes[::-1], indexing="ij"))
    factor = field.factor(np.column_stack([x, y, z]))
    table = np.column_stack(
        [x, y, z, factor * rock.cp, factor * rock.cs, np.full(len(x), rock.density)]
    )
    ends = [axis[-1] for axis in axes]
    bounds = [edge for column in table[:, 3:].T for edge in (column.min(), column.max())]
    head = [[*low, *ends], [step] * 3, counts.tolist(), bounds]
    lines = [" ".join(f"{v:.9g}" for v in row) for row in head]
    with path.open("w") as file:
        file.write("\n".join(lines) + "\n")
        np.savetxt(file, table, fmt="%.3f")
