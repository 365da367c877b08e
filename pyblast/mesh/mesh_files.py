"""Mesh files of gmsh, versions 1 to 4.1, and MED: nodes, cells and all of their groups."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..errors import ReadError

TRIANGLE, QUADRANGLE, TETRAHEDRON, HEXAHEDRON = 2, 3, 4, 5  # numbers of gmsh
DIMENSION = {
    15: (0, "point"), 1: (1, "line"), TRIANGLE: (2, "surface"), QUADRANGLE: (2, "surface"),
    TETRAHEDRON: (3, "group"), HEXAHEDRON: (3, "group"),
}  # fmt: skip
_WIDTHS = {
    15: 1, 1: 2, 2: 3, 4: 4, 3: 4, 5: 8, 6: 6, 7: 5, 8: 3, 9: 6, 10: 9, 11: 10, 12: 27, 13: 18,
    14: 14, 16: 8, 17: 20, 18: 15, 19: 13, 20: 9, 21: 10, 22: 12, 23: 15, 24: 15, 25: 21, 26: 4,
    27: 5, 28: 6, 29: 20, 30: 35, 31: 56, 92: 64, 93: 125,
}  # fmt: skip


class CellFile(NamedTuple):
    """Content of a mesh file: points (n, 3) in m, blocks of cells in the same groups.

    A block is gmsh's number of the type, nodes (n, k) from 0, and the names of its groups.
    ``unused`` holds by dimension the names without cells, and the number of all names.
    """

    points: np.ndarray
    blocks: list[tuple[int, np.ndarray, tuple[str, ...]]]
    unused: dict[int, tuple[list[str], int]]


def read_gmsh(path: Path) -> CellFile:
    """Read a mesh file of gmsh, text or binary.

    Raises
    ------
    ReadError
        If the file is broken or of a version that gmsh has never written.

    Notes
    -----
    Gmsh reference manual, chapter on file formats: MSH 4.1 and the legacy formats 4.0, 2 and 1.
    """
    try:
        sections = _sections(path.read_bytes())
        names, version = {}, 1.0
        if "NOD" in sections:
            tags, points, blocks = _version_1(sections)
        else:
            version, binary, order = _format(path, sections)
            names = _names(sections.get("PhysicalNames", b""))
            cells = _Cursor(sections.get("Elements", b"0 0 0 0"), binary, order)
            if version < 3.0:
                (tags, points), blocks = _nodes_2(path, sections, binary, order), _cells_2(cells)
            else:
                groups = _entities(sections, binary, order, version)
                tags, points = _nodes_4(_Cursor(sections["Nodes"], binary, order), version)
                blocks = _cells_4(cells, groups, version)
        return _named_blocks(path, tags, points, blocks, names)
    except (KeyError, ValueError, IndexError, OverflowError, MemoryError) as error:
        reason = f"section {error} is missing" if isinstance(error, KeyError) else str(error)
        raise ReadError(f"{path}: broken or no gmsh mesh ({reason[:120]})") from None


def _named_blocks(path, tags, points, blocks, names):
    """Return the content with nodes by row and groups by name."""
    order = np.argsort(tags, kind="stable")
    result, used = [], set()
    for kind, nodes, groups in blocks:
        at = np.minimum(np.searchsorted(tags, nodes, sorter=order), len(order) - 1)
        if nodes.size and not np.array_equal(tags[order[at]], nodes):
            raise ReadError(f"{path}: a cell names a node that is not there")
        dimension, prefix = DIMENSION.get(kind, (3, "group"))
        used |= {(dimension, tag) for tag in groups}
        called = tuple(names.get((dimension, tag), f"{prefix}_{tag}") for tag in groups)
        result.append((kind, order[at] if nodes.size else nodes, called))
    unused = {
        dimension: (
            [name for key, name in names.items() if key[0] == dimension and key not in used],
            sum(key[0] == dimension for key in names),
        )
        for dimension in (2, 3)
    }
    return CellFile(points, result, unused)


class _Cursor:
    """Numbers of a section, one after the other: words of text, or bytes."""

    def __init__(self, content: bytes, binary: bool, order: str) -> None:
        self.binary, self.order, self.at, self.content = binary, order, 0, content
        self.words = None if binary else np.array(content.split(), dtype=np.float64)

    def take(self, kind: str, count: int) -> np.ndarray:
        """Return the next numbers (count,) of a kind: i, size or d."""
        if count < 0:
            raise ValueError("a negative count")
        if self.words is not None:
            values = self.words[self.at : self.at + count]
            self.at += count
        else:
            dtype = np.dtype(self.order + {"i": "i4", "size": "u8", "d": "f8"}[kind])
            size = dtype.itemsize * count
            values = np.frombuffer(self.content[self.at : self.at + size], dtype)
            self.at += size
        if len(values) != count:
            raise ValueError("a section ends early")
        return values.astype(np.float64 if kind == "d" else np.int64)

    def whole(self, kind: str) -> int:
        """Return the next whole number."""
        return int(self.take(kind, 1)[0])


def _sections(content):
    """Return the bytes of each section by its name, without its lines of head and end."""
    sections, at = {}, 0
    while (begin := content.find(b"$", at)) >= 0:
        line = content.find(b"\n", begin)
        name = content[begin + 1 : line].strip().decode("latin-1")
        ends = [b"\n$End" + name.encode("latin-1"), b"$END" + name.encode("latin-1")]
        stops = [stop for end in ends if (stop := content.find(end, line)) >= 0]
        if line < 0 or not stops:
            raise ValueError(f"section {name[:40]!r} has no end")
        sections[name] = content[line + 1 : min(stops)]
        at = content.find(b"\n", min(stops) + 1)
        if at < 0:
            break
    return sections


def _format(path, sections):
    """Return version, whether binary, and byte order."""
    words = sections["MeshFormat"].split(maxsplit=3)
    version, binary = float(words[0]), words[1] == b"1"
    if not (2.0 <= version < 3.0 or version in (4.0, 4.1)):
        raise ReadError(f"{path}: gmsh format {words[0].decode('latin-1')[:10]} is not known; "
                        "write 4.1 or 2.2")  # fmt: skip
    if binary and version == 4.0:
        raise ReadError(f"{path}: is binary gmsh 4.0; write 4.1, or text")
    order = "<"
    if binary:
        mark = sections["MeshFormat"].split(b"\n", 1)[1][:4]
        order = "<" if mark == b"\x01\0\0\0" else ">"
    return version, binary, order


def _names(section):
    """Return the names of physical groups by dimension and tag."""
    names = {}
    for line in section.decode("utf-8", "replace").splitlines()[1:]:
        if line.strip():
            dimension, tag, name = line.split(maxsplit=2)
            names[int(dimension), int(tag)] = name.strip().strip('"')
    return names


def _version_1(sections):
    """Read version 1, which is text: number, type, group, entity, count, nodes."""
    tags, points = _lines_of_nodes(sections["NOD"])
    words = np.array(sections["ELM"].split()[1:], dtype=np.int64)
    grouped: dict = {}
    at = 0
    while at < len(words):
        kind, group, count = words[at + 1], words[at + 2], words[at + 4]
        grouped.setdefault((int(kind), int(group)), []).append(words[at + 5 : at + 5 + count])
        at += 5 + count
    return tags, points, _blocks(grouped)


def _lines_of_nodes(section):
    """Return tags and points of lines of text that may end in parameters."""
    rows = [line.split()[:4] for line in section.splitlines()[1:]]
    rows = np.array(rows, dtype=np.float64).reshape(-1, 4)
    return rows[:, 0].astype(np.int64), rows[:, 1:]


def _blocks(grouped):
    """Return blocks of cells that were gathered by type and group."""
    return [
        (kind, np.array(cells, dtype=np.int64).reshape(len(cells), -1), (tag,) if tag else ())
        for (kind, tag), cells in grouped.items()
    ]


def _nodes_2(path, sections, binary, order):
    """Return tags and points of version 2."""
    if "ParametricNodes" in sections:
        if binary:
            raise ReadError(f"{path}: is binary gmsh 2 with parameters; write 4.1, or text")
        return _lines_of_nodes(sections["ParametricNodes"])
    if not binary:
        read = _Cursor(sections["Nodes"], binary, order)
        rows = read.take("d", 4 * read.whole("i")).reshape(-1, 4)
        return rows[:, 0].astype(np.int64), rows[:, 1:]
    count, body = sections["Nodes"].split(b"\n", 1)
    rows = np.frombuffer(
        body, np.dtype([("tag", f"{order}i4"), ("x", f"{order}f8", 3)]), int(count)
    )
    return rows["tag"].astype(np.int64), rows["x"].astype(np.float64)


def _cells_2(cells):
    """Return the blocks of version 2: cells of several groups stand several times."""
    if cells.binary:
        cells.content = cells.content.split(b"\n", 1)[1]
        return _binary_cells_2(cells)
    grouped: dict = {}
    words, at = cells.take("i", len(cells.words)), 1
    for _ in range(int(words[0])):
        kind, n_tags = int(words[at + 1]), int(words[at + 2])
        first, width = at + 3 + n_tags, _width(kind)
        group = int(words[at + 3]) if n_tags else 0
        grouped.setdefault((kind, group), []).append(words[first : first + width])
        at = first + width
    return _blocks(grouped)


def _binary_cells_2(cells):
    """Return the blocks of the binary version 2: headers of type, count and tags."""
    blocks: dict = {}
    while len(cells.content) - cells.at >= 12:
        kind, count, n_tags = (int(value) for value in cells.take("i", 3))
        rows = cells.take("i", count * (1 + n_tags + _width(kind))).reshape(count, -1)
        groups = rows[:, 1] if n_tags else np.zeros(count, int)
        for group in np.unique(groups):
            chosen = rows[groups == group][:, 1 + n_tags :]
            blocks.setdefault((kind, int(group)), []).extend(chosen)
    return _blocks(blocks)


def _width(kind):
    """Return the number of nodes of a type of cells."""
    if kind not in _WIDTHS:
        raise ValueError(f"cells of type {kind}")
    return _WIDTHS[kind]


def _entities(sections, binary, order, version):
    """Return the physical groups of each entity by dimension and tag."""
    groups: dict[tuple[int, int], tuple[int, ...]] = {}
    for name in ("Entities", "PartitionedEntities"):
        if name not in sections:
            continue
        read = _Cursor(sections[name], binary, order)
        split = name.startswith("P")
        if split:
            read.whole("size" if version > 4.0 else "i")  # number of partitions
            ghosts = read.whole("size")
            read.take("i", 2 * ghosts)
        counts = read.take("size", 4)
        for dimension, count in enumerate(counts):
            for _ in range(int(count)):
                tag = read.whole("i")
                if split:
                    read.take("i", 2)
                    read.take("i", read.whole("size" if version > 4.0 else "i"))
                read.take("d", 3 if dimension == 0 and version > 4.0 else 6)
                own = read.take("i", read.whole("size"))
                groups[dimension, tag] = tuple(int(abs(each)) for each in own)
                if dimension:
                    read.take("i", read.whole("size"))
    return groups


def _nodes_4(nodes, version):
    """Return tags and points of version 4, which stand in blocks of an entity."""
    latest = version > 4.0
    n_blocks = nodes.whole("size")
    nodes.take("size", 3 if latest else 1)
    tags, points = [np.empty(0, np.int64)], [np.empty((0, 3))]
    for _ in range(n_blocks):
        dimension = int(nodes.take("i", 2)[0 if latest else 1])
        parametric, count = nodes.whole("i"), nodes.whole("size")
        width = 3 + (dimension if parametric else 0)
        if latest:
            tags.append(nodes.take("size", count))
            points.append(nodes.take("d", width * count).reshape(count, width)[:, :3])
        else:
            rows = nodes.take("d", (1 + width) * count).reshape(count, 1 + width)
            tags.append(rows[:, 0].astype(np.int64))
            points.append(rows[:, 1:4])
    return np.concatenate(tags), np.concatenate(points)


def _cells_4(cells, groups, version):
    """Return the blocks of version 4, of an entity each, which has the groups."""
    latest, blocks = version > 4.0, []
    n_blocks = cells.whole("size")
    cells.take("size", 3 if latest else 1)
    for _ in range(n_blocks):
        first, second, kind = (int(value) for value in cells.take("i", 3))
        entity = (first, second) if latest else (second, first)
        count, width = cells.whole("size"), 1 + _width(kind)
        rows = cells.take("size", width * count).reshape(count, width)
        blocks.append((kind, rows[:, 1:], groups.get(entity, ())))
    return blocks


_MED_TYPES = {
    "PO1": 15, "SE2": 1, "TR3": TRIANGLE, "QU4": QUADRANGLE, "TE4": TETRAHEDRON, "HE8": HEXAHEDRON,
    "PE6": 6, "PY5": 7,
}  # fmt: skip


def read_med(path: Path) -> CellFile:
    """Read a mesh file in MED, with or without groups.

    Raises
    ------
    ReadError
        If the file is broken, or holds no mesh or several.

    Notes
    -----
    MED 3 and 4 file format of Salome: coordinates and nodes of cells stand component by component.
    """
    import h5py

    try:
        with h5py.File(path, "r") as file:
            (name,) = file["ENS_MAA"]
            mesh = file["ENS_MAA"][name]
            _refuse_med_axes(path, mesh.attrs)
            while "NOE" not in mesh:
                (step,) = mesh
                mesh = mesh[step]
            n_points = int(mesh["NOE/COO"].attrs["NBR"])
            points = np.asarray(mesh["NOE/COO"][()], dtype=float).reshape(-1, n_points).T
            families = _med_families(file, name)
            blocks = []
            for kind, cells in mesh["MAI"].items():
                count = int(cells["NOD"].attrs["NBR"])
                rows = np.asarray(cells["NOD"][()], dtype=np.int64).reshape(-1, count).T - 1
                if rows.size and (rows.min() < 0 or rows.max() >= n_points):
                    raise ReadError(f"{path}: a cell names a node that is not there")
                family = cells["FAM"][()] if "FAM" in cells else np.zeros(count, int)
                shape = _MED_TYPES.get(kind, kind)
                prefix = DIMENSION.get(shape, (3, "group"))[1]
                for number in np.unique(family):
                    own = (f"{prefix}_{abs(number)}",) if number else ()
                    names = families.get(int(number), own)
                    blocks.append((shape, rows[family == number], names))
            return CellFile(points, blocks, {})
    except ReadError:
        raise
    except Exception as error:  # broken files can raise any exception in h5py
        reason = " ".join(str(error).split())[:120] or type(error).__name__
        raise ReadError(f"{path}: broken or no med mesh ({reason})") from None


def _refuse_med_axes(path, attributes):
    """Raise ReadError for a MED mesh of a grid, or whose axes are not x, y, z in metres."""
    texts = (np.asarray(attributes.get(word, "")).astype(str) for word in ("NOM", "UNI"))
    axes, units = (str(text).split() for text in texts)
    other = any(attributes.get(word, 0) for word in ("REP", "TYP"))  # Cartesian, unstructured: 0
    if other or [axis[:1].lower() for axis in axes] not in ([], [*"xyz"]) or {*units} - {"m", "M"}:
        said = " ".join([*axes, *units])
        raise ReadError(f"{path}: has axes or a grid that are not read ({said}); write an "
                        "unstructured mesh of x, y, z in metres")  # fmt: skip


def _med_families(file, name):
    """Return the names of the groups of each family of cells."""
    families: dict[int, tuple[str, ...]] = {}
    for family in file.get(f"FAS/{name}/ELEME", {}).values():
        number = int(family.attrs["NUM"])
        names = family["GRO/NOM"][()] if "GRO" in family else []
        families[number] = tuple(
            np.asarray(row).astype(np.uint8).tobytes().split(b"\0")[0].decode("utf-8").strip()
            for row in names
        )
    return families
