"""Mesh files of gmsh: nodes, cells and all their physical groups, versions 1 to 4.1."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ..errors import ReadError

NODES_OF_TYPE = {15: 1, 1: 2, 2: 3, 4: 4}  # point, line, triangle, tetrahedron
_MORE_NODES = {
    3: 4, 5: 8, 6: 6, 7: 5, 8: 3, 9: 6, 10: 9, 11: 10, 12: 27, 13: 18, 14: 14, 16: 8, 17: 20,
    18: 15, 19: 13, 20: 9, 21: 10, 22: 12, 23: 15, 24: 15, 25: 21, 26: 4, 27: 5, 28: 6, 29: 20,
    30: 35, 31: 56, 92: 64, 93: 125,
}  # fmt: skip
_WIDTHS = {**NODES_OF_TYPE, **_MORE_NODES}


@dataclass
class MshFile:
    """Content of a gmsh file.

    Parameters
    ----------
    tags, points : (n,) int, (n, 3) float64
        Numbers and positions of the nodes.
    blocks : list of (type, nodes (n, k) int, tags of physical groups)
        Cells that are in the same groups; nodes by their numbers.
    names : dict of (dimension, tag) to str
        Of physical groups.
    """

    tags: np.ndarray = field(default_factory=lambda: np.empty(0, int))
    points: np.ndarray = field(default_factory=lambda: np.empty((0, 3)))
    blocks: list[tuple[int, np.ndarray, tuple[int, ...]]] = field(default_factory=list)
    names: dict[tuple[int, int], str] = field(default_factory=dict)


def read_msh(path: Path) -> MshFile:
    """Read a mesh file of gmsh, text or binary.

    Raises
    ------
    ReadError
        If the file is broken or of a version that gmsh has never written.

    Notes
    -----
    Gmsh reference manual, chapter on file formats: MSH 4.1 and the legacy formats 4.0, 2 and 1.
    """
    content = path.read_bytes()
    try:
        sections = _sections(content)
        if "NOD" in sections:
            return _version_1(sections)
        version, binary, order = _format(path, content, sections)
        mesh = MshFile(names=_names(sections.get("PhysicalNames", b"")))
        read = _Cursor(sections["Nodes"], binary, order)
        cells = _Cursor(sections["Elements"], binary, order)
        if version < 3.0:
            _version_2(mesh, read, cells)
        else:
            groups = _entities(sections, binary, order, version)
            _version_4(mesh, read, cells, groups, version)
    except (KeyError, ValueError, IndexError, OverflowError, MemoryError) as error:
        reason = f"section {error} is missing" if isinstance(error, KeyError) else str(error)
        raise ReadError(f"{path}: broken or no gmsh mesh ({reason[:120]})") from None
    return mesh


class _Cursor:
    """Numbers of a section, one after the other: words of text, or bytes."""

    def __init__(self, content: bytes, binary: bool, order: str) -> None:
        self.binary, self.order, self.at = binary, order, 0
        self.content = content if binary else np.array(content.split(), dtype=np.float64)

    def take(self, kind: str, count: int) -> np.ndarray:
        """Return the next numbers (count,) of a kind: i, size or d."""
        if count < 0:
            raise ValueError("a negative count")
        if not self.binary:
            values = self.content[self.at : self.at + count]
            self.at += count
        else:
            dtype = np.dtype({"i": "i4", "size": "u8", "d": "f8"}[kind]).newbyteorder(self.order)
            size = dtype.itemsize * count
            values = np.frombuffer(self.content[self.at : self.at + size], dtype)
            self.at += size
        if len(values) != count:
            raise ValueError("a section ends early")
        return values.astype(np.float64 if kind == "d" else np.int64)

    def one(self, kind: str) -> int:
        """Return the next whole number."""
        return int(self.take(kind, 1)[0])


def _sections(content):
    """Return the bytes of each section by its name, without its lines of head and end."""
    sections, at = {}, 0
    while (begin := content.find(b"$", at)) >= 0:
        line = content.find(b"\n", begin)
        name = content[begin + 1 : line].strip().decode("latin-1")
        ends = [b"\n$End" + name.encode("latin-1"), b"$END" + name.encode("latin-1")]
        found = [place for end in ends if (place := content.find(end, line)) >= 0]
        if line < 0 or not found:
            raise ValueError(f"section {name[:40]!r} has no end")
        sections[name] = content[line + 1 : min(found)]
        at = content.find(b"\n", min(found) + 1)
        if at < 0:
            break
    return sections


def _format(path, content, sections):
    """Return version, whether binary, and byte order."""
    words = sections["MeshFormat"].split(maxsplit=3)
    version, binary = float(words[0]), words[1] == b"1"
    if not (2.0 <= version < 3.0 or version in (4.0, 4.1)):
        raise ReadError(f"{path}: gmsh format {words[0].decode('latin-1')[:10]} is not known; "
                        "write 4.1 or 2.2")  # fmt: skip
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
    nodes = np.array(sections["NOD"].split()[1:], dtype=np.float64).reshape(-1, 4)
    mesh = MshFile(nodes[:, 0].astype(np.int64), nodes[:, 1:])
    words = np.array(sections["ELM"].split()[1:], dtype=np.int64)
    grouped: dict = {}
    while len(words):
        kind, group, count = words[[1, 2, 4]]
        grouped.setdefault((int(kind), int(group)), []).append(words[5 : 5 + count])
        words = words[5 + count :]
    mesh.blocks = _blocks(grouped)
    return mesh


def _blocks(grouped):
    """Return blocks of cells that were gathered by type and group."""
    return [
        (kind, np.array(cells, dtype=np.int64).reshape(len(cells), -1), (tag,) if tag else ())
        for (kind, tag), cells in grouped.items()
    ]


def _version_2(mesh, nodes, cells):
    """Read version 2: cells carry a group each, those of several groups stand several times."""
    if nodes.binary:
        count = int(nodes.content.split(b"\n", 1)[0])
        body = nodes.content.split(b"\n", 1)[1][: 28 * count]
        dtype = np.dtype([("tag", "i4"), ("x", "f8", 3)]).newbyteorder(nodes.order)
        rows = np.frombuffer(body, dtype, count)
        mesh.tags, mesh.points = rows["tag"].astype(np.int64), rows["x"].astype(np.float64)
        cells.content = cells.content.split(b"\n", 1)[1]
        mesh.blocks = _binary_cells_2(cells)
        return
    rows = nodes.take("d", 4 * nodes.one("i")).reshape(-1, 4)
    mesh.tags, mesh.points = rows[:, 0].astype(np.int64), rows[:, 1:]
    grouped: dict = {}
    words, at = cells.content.astype(np.int64), 1
    for _ in range(int(words[0])):
        kind, n_tags = int(words[at + 1]), int(words[at + 2])
        width = _width(kind)
        group = int(words[at + 3]) if n_tags else 0
        first = at + 3 + n_tags
        grouped.setdefault((kind, group), []).append(words[first : first + width])
        at = first + width
    mesh.blocks = _blocks(grouped)


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
            read.one("size" if version > 4.0 else "i")  # number of partitions
            ghosts = read.one("size")
            read.take("i", 2 * ghosts)
        counts = read.take("size", 4)
        for dimension, count in enumerate(counts):
            for _ in range(int(count)):
                tag = read.one("i")
                if split:
                    read.take("i", 2)
                    read.take("i", read.one("size" if version > 4.0 else "i"))
                read.take("d", 3 if dimension == 0 and version > 4.0 else 6)
                own = read.take("i", read.one("size"))
                groups[dimension, tag] = tuple(int(abs(each)) for each in own)
                if dimension:
                    read.take("i", read.one("size"))
    return groups


def _version_4(mesh, nodes, cells, groups, version):
    """Read version 4: cells stand in blocks of an entity, which has the groups."""
    latest = version > 4.0
    n_blocks = nodes.one("size")
    nodes.take("size", 3 if latest else 1)
    tags, points = [], []
    for _ in range(n_blocks):
        dimension = int(nodes.take("i", 2)[0 if latest else 1])
        parametric, count = nodes.one("i"), nodes.one("size")
        width = 3 + (dimension if parametric else 0)
        if latest:
            tags.append(nodes.take("size", count))
            points.append(nodes.take("d", width * count).reshape(count, width)[:, :3])
        elif nodes.binary:
            for _ in range(count):
                tags.append(nodes.take("i", 1))
                points.append(nodes.take("d", width)[None, :3])
        else:
            rows = nodes.take("d", (1 + width) * count).reshape(count, -1)
            tags.append(rows[:, 0].astype(np.int64))
            points.append(rows[:, 1:4])
    mesh.tags = np.concatenate([np.empty(0, int), *tags])
    mesh.points = np.concatenate([np.empty((0, 3)), *points])
    n_blocks = cells.one("size")
    cells.take("size", 3 if latest else 1)
    kind_of_number = "size" if latest else "i"
    for _ in range(n_blocks):
        first, second, kind = (int(value) for value in cells.take("i", 3))
        entity = (first, second) if latest else (second, first)
        count, width = cells.one("size"), 1 + _width(kind)
        rows = cells.take(kind_of_number, width * count).reshape(count, width)
        mesh.blocks.append((kind, rows[:, 1:], groups.get(entity, ())))
