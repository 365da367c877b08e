"""Import of meshes from other programs: gmsh, and known formats through meshio."""

import contextlib
import io
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..errors import InputError, ReadError
from ..readers.cells import read_bytes
from ..readers.kinds import expect
from ..readers.provenance import ReadLog
from ..units import check_length
from . import tetrahedra
from .faces import face_keys, face_vectors, zone_faces
from .mesh import Mesh
from .mesh_files import (
    DIMENSION,
    HEXAHEDRON,
    QUADRANGLE,
    TETRAHEDRON,
    TRIANGLE,
    read_gmsh,
    read_med,
)
from .quality import validate

_LARGEST_FILE = 4_000_000_000  # bytes
_TAGS = ("gmsh:physical", "cell_tags", "medit:ref", "group", "tag", "material", "region")
_CORNERS = [0, 1, 3, 2, 4, 5, 7, 6]  # of hexahedra in the order of gmsh and VTK


def read_mesh(
    path: str | Path,
    groups: dict[str, str] | None = None,
    joints: Sequence[str] | None = None,
    log: ReadLog | None = None,
    order: int = 4,
) -> Mesh:
    """Read a mesh of tetrahedra or hexahedra with tagged volumes and surfaces.

    Parameters
    ----------
    path : str or Path
        Gmsh of any version, text or binary (.msh), .vtu, Abaqus .inp, .med or .xdmf.
    groups : dict of str to str
        Names (or numbers) of tagged volumes in the file to names of groups; other volumes keep
        their name, numbers become ``group_<number>``.
    joints : sequence of str
        Surfaces that will be split; they must be internal.
    log : ReadLog, optional
        Takes what was read.
    order : int
        Of the polynomials of hexahedra, which have straight edges.

    Returns
    -------
    Mesh
        Not split; numbers of surfaces become ``surface_<number>``.

    Raises
    ------
    ReadError
        If the file is missing, of another format, or broken.
    InputError
        If the mesh is wider than 50 km, as one in millimetres is; has degenerate, folded or
        duplicate zones, or zones in two groups; is disconnected, non-manifold or untagged; or a
        name is unknown.

    Notes
    -----
    Zones may be written in either order of their nodes; those of negative volume are turned. A
    facet may be in several groups.

    Examples
    --------
    >>> mesh = read_mesh("pit.msh", groups={"1": "rock"}, joints=["F1"])  # doctest: +SKIP
    """
    path = Path(path)
    content = read_bytes(path, _LARGEST_FILE)
    name = expect(path, content, "mesh").name
    entry = (ReadLog() if log is None else log).file(path, name)
    if name in _READERS:
        points, cells = _grouped(path, name, entry)
    else:
        raw = _read(path, name, _checked(path, name, content))
        points, cells = np.asarray(raw.points, dtype=float), _tagged(path, raw)
    zones, facets = _zones_and_facets(path, cells)
    if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
        raise ReadError(f"{path}: points must be finite and have three coordinates")
    try:
        mesh = _assemble(points, zones, facets, groups or {}, order, entry)
        validate(mesh)
        _refuse_overlapping(mesh)
        check_length("mesh", float(np.ptp(mesh.points, axis=0).max()))
        _refuse_outer(mesh, joints or ())
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    for number, group in enumerate(mesh.groups):
        entry.column("zones", f"volume {group}", "m", rows=(mesh.zone_group == number).sum())
    for surface, facets in mesh.surfaces.items():
        entry.column("facets", f"surface {surface}", "m", rows=len(facets))
    return mesh


_FLAT = "write nodes and elements into one file, without parts and assemblies"
# Words of a mesh file that move its nodes or cells, or read them elsewhere: refused.
WORDS = {
    "abaqus": (
        "INCLUDE", "SYSTEM", "NGEN", "NFILL", "NCOPY", "NMAP", "ELGEN", "ELCOPY", "IMPORT",
        "PARAMETER", "MODEL CHANGE", "INSTANCE", "PART", "INPUT", "NODE, SYSTEM",
    ),
    "vtu": ("<!DOCTYPE", "<!ENTITY", "</Piece>"),  # the last one twice
    "xdmf": ("<!DOCTYPE", "<!ENTITY", "xi:include", "BaseOffset", 'ItemType="Function"'),
}  # fmt: skip


def _checked(path, name, content):
    """Return the text of a file without words that would change places, nodes in one block."""
    text = content.decode("utf-8", "replace")
    if name == "abaqus":
        return _abaqus(path, text)
    for word in WORDS.get(name, ()):
        if text.count(word) > (word == "</Piece>"):
            what = "document types and entities are" if word[1] == "!" else f"{word} is"
            raise ReadError(f"{path}: {what} not accepted; write the mesh without")
    if name == "xdmf" and re.search(r">[^<]*[/\\][^<:]*:/", text):
        raise ReadError(f"{path}: its data must lie beside it, not in another folder")
    return path


def _abaqus(path, text):
    """Return an Abaqus input file, its nodes in one block, for meshio reads the last one alone."""
    nodes, others, seen, word = [], [], [], ""
    for line in text.splitlines():
        if line.lstrip().startswith("*") and not line.lstrip().startswith("**"):
            word, *given = (part.strip().upper() for part in line.lstrip(" *\t").split(","))
            line = re.sub(r"(?i)\btype\s*=\s*\w+", lambda kind: kind[0].upper(), line)
            seen.append(word)
            moved = word in WORDS["abaqus"] and (
                word not in ("PART", "INSTANCE") or seen.count(word) > 1
            )
            system = word == "NODE" and re.search(r"SYSTEM *= *[CS]", line, re.IGNORECASE)
            if moved or system or any(part.startswith("INPUT") for part in given):
                raise ReadError(f"{path}: *{line.strip(' *')[:60]} is not followed; {_FLAT}")
        elif word == "INSTANCE" and re.search(r"[1-9]", line):
            raise ReadError(f"{path}: *INSTANCE moves its part by {line.strip()[:60]}; {_FLAT}")
        (nodes if word == "NODE" else others).append(line)
    nodes = ["*NODE", *(line for line in nodes if not line.lstrip().startswith("*"))]
    return io.StringIO("\n".join([*nodes, *others]))


def _read(path, name, source):
    """Read through meshio, which prints and exits if a file is broken."""
    import meshio

    said = io.StringIO()
    try:
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
            mesh = meshio.read(source, file_format=name)
    # Broken files can raise any exception in meshio.
    except (Exception, SystemExit) as error:
        reason = type(error).__name__ if not str(error) else str(error).splitlines()[0][:120]
        raise ReadError(f"{path}: broken or no {name} mesh ({reason})") from None
    if "cannot handle" in said.getvalue():
        raise ReadError(
            f"{path}: holds cells of a kind that is not read; write the mesh in first order"
        )
    return mesh


_READERS = {"gmsh": read_gmsh, "MED": read_med}


_SHAPES = {  # names of cells, also in meshio, by gmsh's number
    15: ("points", "vertex"), 1: ("lines", "line"), TRIANGLE: ("triangles", "triangle"),
    QUADRANGLE: ("quadrangles", "quad"), TETRAHEDRON: ("tetrahedra", "tetra"),
    HEXAHEDRON: ("hexahedra", "hexahedron"), 6: ("prisms", "wedge"), 7: ("pyramids", "pyramid"),
}  # fmt: skip


def _grouped(path, name, entry):
    """Return points, and cells with their names by kind, of a file with groups of cells."""
    file = _READERS[name](path)
    parts: dict = {}
    for kind, rows, names in file.blocks:
        if kind in (TETRAHEDRON, HEXAHEDRON) and len(set(names)) > 1:
            raise InputError(f"{path}: {len(rows)} zones are in the groups {' and '.join(names)}; "
                             "give every volume one group")  # fmt: skip
        for called in names or [""]:
            parts.setdefault(kind, []).append((rows, np.full(len(rows), called, dtype=object)))
    for names, count in file.unused.values():
        if names and len(names) == count:
            raise ReadError(
                f"{path}: names {', '.join(names[:6])} but tags no cell with any of them; write "
                "the mesh without Mesh.SaveAll, or leave the names out"
            )
        for called in names:
            entry.dropped(f"name {called!r}", "the file names it, but tags no cell with it")
    return file.points, {kind: _stacked(blocks) for kind, blocks in parts.items()}


def _stacked(blocks):
    """Return cells (n, k) and names (n,) of blocks of them."""
    return np.concatenate([rows for rows, _ in blocks]), np.concatenate([n for _, n in blocks])


def _tagged(path, raw):
    """Return cells with their names by kind of a mesh of meshio, empty names if untagged."""
    kinds, parts = {short: kind for kind, (_, short) in _SHAPES.items()}, {}
    for number, block in enumerate(raw.cells):
        kind, rows = kinds.get(block.type, block.type), np.asarray(block.data)
        names = np.full(len(rows), "", dtype=object)
        if DIMENSION.get(kind, (0, ""))[0] > 1 and rows.size:
            rows = rows.astype(np.int64).reshape(len(rows), -1)
            if rows.min() < 0 or rows.max() >= len(raw.points):
                raise ReadError(f"{path}: the {_SHAPES[kind][0]} name node {rows.max() + 1} of "
                                f"{len(raw.points)}")  # fmt: skip
            names = _cell_names(path, raw, number, kind, len(rows))
        if rows.size:
            parts.setdefault(kind, []).append((rows, names))
    return {kind: _stacked(blocks) for kind, blocks in parts.items()}


def _zones_and_facets(path, cells):
    """Return zones of one kind and their facets, each with names; refuse all other kinds."""
    present = [kind for kind, (rows, _) in cells.items() if len(rows)]
    shown = [_SHAPES.get(kind, (f"cells of type {kind}", ""))[0] for kind in present]
    volumes = [kind for kind in (TETRAHEDRON, HEXAHEDRON) if kind in present]
    if len(volumes) != 1 or not {*present} <= {*DIMENSION}:
        what = "with one kind of zones"
        if not {*present} <= {*_SHAPES}:
            what = "in first order"
        elif not volumes and {TRIANGLE, QUADRANGLE} & {*present} and not {6, 7} & {*present}:
            what = "with a volume, this one is two-dimensional"
        raise ReadError(
            f"{path}: holds {', '.join(shown) or 'no cells'}; read are tetrahedra with 4 nodes and "
            f"triangles with 3, or hexahedra with 8 and quadrangles with 4: write the mesh {what}"
        )
    facet, width = (TRIANGLE, 3) if volumes[0] == TETRAHEDRON else (QUADRANGLE, 4)
    none = np.empty((0, width), dtype=np.int64), np.empty(0, dtype=object)
    return cells[volumes[0]], cells.get(facet, none)


def _cell_names(path, raw, number, kind, count):
    """Return the name (count,) of each cell of a block, from its tags or from sets of cells."""
    names = np.full(count, "", dtype=object)
    dimension, prefix = DIMENSION[kind]
    key = next((key for key in _TAGS if key in raw.cell_data), None)
    if key is not None:
        tags = np.asarray(raw.cell_data[key][number])
        if tags.shape != (count,) or not np.array_equal(tags, np.round(tags)):
            raise ReadError(
                f"{path}: {key} must hold one whole number for each of the {_SHAPES[kind][0]}"
            )
        for tag in np.unique(tags[tags != 0]):
            names[tags == tag] = _tag_name(raw, int(tag), dimension, prefix)
        return names
    for name, parts in raw.cell_sets.items():
        members = np.asarray(parts[number] if parts[number] is not None else [], dtype=np.int64)
        if len(members) and members.max() >= count:
            raise ReadError(
                f"{path}: the set {name!r} names more {_SHAPES[kind][0]} than there are"
            )
        members = members[names[members] == ""]
        names[members] = name
    return names


def _tag_name(raw, tag, dimension, prefix):
    """Return the name that the file gives to a tag, else its prefix and number."""
    for name, value in raw.field_data.items():
        if len(value) == 2 and tuple(value) == (tag, dimension):
            return name
    return f"{prefix}_{abs(tag)}"


def _assemble(points, zones, facets, groups, order, entry):
    """Return the mesh of tagged cells, without unused nodes."""
    (zones, group_names), (facets, surface_names) = zones, facets
    named = np.unique(group_names[group_names != ""]).tolist()
    renamed = _renamed(named, groups)
    untagged = np.flatnonzero(group_names == "")
    if len(untagged) and named:
        x, y, z = points[zones[untagged[0]]].mean(axis=0)
        raise InputError(
            f"{len(untagged)} zones have no tag, the first at ({x:g}, {y:g}, {z:g}); give every "
            "volume a group"
        )
    names = sorted(set(renamed.values())) or ["rock"]
    zone_group = [names.index(renamed[name]) if named else 0 for name in group_names]
    used = np.unique(zones)
    row = np.full(len(points), -1)
    row[used] = np.arange(len(used))
    chosen = (surface_names != "") & (row[facets] >= 0).all(axis=1)
    surfaces = {
        name: row[facets[chosen & (surface_names == name)]]
        for name in np.unique(surface_names[chosen]).tolist()
    }
    zones = row[zones]
    points = points[used]
    hexahedral = zones.shape[1] == 8
    corner, mirrored = ([0, 1, 2, 4], [1, 0, 3, 2, 5, 4, 7, 6]) if hexahedral else (
        [0, 1, 2, 3], [0, 2, 1, 3])  # fmt: skip
    zones = zones[:, _CORNERS] if hexahedral else zones
    turned = tetrahedra.volumes(points, zones[:, corner]) < 0.0
    if turned.any() and not turned.all():
        entry.remark(f"{np.count_nonzero(turned)} of {len(zones)} zones were turned right-handed")
    zones[turned] = zones[turned][:, mirrored]
    _refuse_two_groups(zones, zone_group, names)
    order, zone_group = order if hexahedral else 1, np.array(zone_group)
    return Mesh(points, zones, zone_group, tuple(names), surfaces, order=order)


def _refuse_two_groups(zones, zone_group, names):
    """Raise InputError for a zone that stands in the file once for each of two groups."""
    order = np.lexsort(np.sort(zones, axis=1).T)
    ordered = np.sort(zones, axis=1)[order]
    same = (ordered[1:] == ordered[:-1]).all(axis=1)
    group = np.asarray(zone_group)[order]
    both = np.flatnonzero(same & (group[1:] != group[:-1]))
    if len(both):
        pair = sorted(names[group[both[0] + k]] for k in (0, 1))
        raise InputError(
            f"{len(both)} zones are in the groups {' and '.join(pair)}; give every volume one group"
        )


def _refuse_overlapping(mesh):
    """Raise InputError where two zones lie on the same side of the face that they share."""
    first, second, _, _ = mesh.paired_faces
    faces = zone_faces(mesh.zones)
    plus, minus = (face_vectors(mesh.points, faces[side]) for side in (first, second))
    folded = np.einsum("ni,ni->n", plus, minus) > 0.0
    if folded.any():
        x, y, z = mesh.points[faces[first[np.argmax(folded)]]].mean(axis=0)
        raise InputError(
            f"{np.count_nonzero(folded)} pairs of zones lie on the same side of a face that they "
            f"share, the first at ({x:g}, {y:g}, {z:g}); the mesh is folded there, repair it"
        )


def _renamed(named, groups):
    """Return the group of each tagged volume; a number may stand for ``group_<number>``."""
    renamed = {name: name for name in named}
    for key, group in groups.items():
        name = key if key in renamed else f"group_{key}"
        if name not in renamed:
            raise InputError(f"no volume is tagged {key!r}; there are {', '.join(named) or 'none'}")
        renamed[name] = group
    return renamed


def _refuse_outer(mesh, joints):
    """Raise InputError for joints that are not internal surfaces."""
    first = mesh.paired_faces[0]
    internal = face_keys(zone_faces(mesh.zones)[first], len(mesh.points))
    for name in joints:
        if name not in mesh.surfaces:
            names = ", ".join(mesh.surfaces) or "none"
            raise InputError(f"no surface is tagged {name!r}; there are {names}")
        keys = face_keys(mesh.surfaces[name], len(mesh.points))
        outer = np.count_nonzero(~np.isin(keys, internal))
        if outer:
            raise InputError(
                f"{outer} of {len(keys)} facets of the joint {name!r} are not faces between two "
                "zones; only internal surfaces can be joints"
            )
