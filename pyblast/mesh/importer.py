"""Import of tetrahedral meshes from other programs: gmsh, and known formats through meshio."""

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
from .mesh_files import DIMENSION, TETRAHEDRON, TRIANGLE, read_gmsh, read_med
from .quality import validate

_LARGEST_FILE = 4_000_000_000  # bytes
_TAGS = ("gmsh:physical", "cell_tags", "medit:ref", "group", "tag", "material", "region")
_IGNORED = ("vertex", "line")


def read_mesh(
    path: str | Path,
    groups: dict[str, str] | None = None,
    joints: Sequence[str] | None = None,
    log: ReadLog | None = None,
) -> Mesh:
    """Read a tetrahedral mesh with tagged volumes and surfaces.

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
    _refuse_other_files(path, name, content)
    entry = (ReadLog() if log is None else log).file(path, name)
    if name in _READERS:
        points, (zones, group_names), (triangles, surface_names) = _grouped(path, name, entry)
    else:
        raw = _read(path, name)
        points = np.asarray(raw.points, dtype=float)
        triangles, surface_names = _tagged_cells(path, raw, "triangle", 3)
        zones, group_names = _tagged_cells(path, raw, "tetra", 4)
    if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
        raise ReadError(f"{path}: points must be finite and have three coordinates")
    if not len(zones):
        raise ReadError(f"{path}: holds no tetrahedra with 4 nodes")
    try:
        mesh = _assemble(points, zones, group_names, triangles, surface_names, groups or {}, entry)
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


def _refuse_other_files(path, name, text):
    """Raise ReadError for files that refer to other files or define entities."""
    if name == "abaqus" and re.search(rb"(?im)^\s*\*\s*include", text):
        raise ReadError(f"{path}: *INCLUDE is not followed; put the mesh into one file")
    if name in ("vtu", "xdmf") and (b"<!DOCTYPE" in text or b"<!ENTITY" in text):
        raise ReadError(f"{path}: document types and entities are not accepted; remove them")
    if name == "xdmf" and re.search(rb">[^<]*[/\\][^<:]*:/", text):
        raise ReadError(f"{path}: its data must lie beside it, not in another folder")


def _read(path, name):
    """Read through meshio, which prints and exits if a file is broken."""
    import meshio

    try:
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            return meshio.read(path, file_format=name)
    # Broken files can raise any exception in meshio.
    except (Exception, SystemExit) as error:
        reason = type(error).__name__ if not str(error) else str(error).splitlines()[0][:120]
        raise ReadError(f"{path}: broken or no {name} mesh ({reason})") from None


_READERS = {"gmsh": read_gmsh, "MED": read_med}


def _grouped(path, name, entry):
    """Return points, and zones and triangles with their names, of a file with groups of cells."""
    file = _READERS[name](path)
    parts: dict[int, list] = {TRIANGLE: [], TETRAHEDRON: []}
    for kind, rows, names in file.blocks:
        if kind not in DIMENSION:
            raise ReadError(
                f"{path}: holds {name} cells of type {kind}; only tetrahedra with 4 nodes and "
                "triangles with 3 are read, so write the mesh in first order"
            )
        if kind == TETRAHEDRON and len(set(names)) > 1:
            raise InputError(f"{path}: {len(rows)} zones are in the groups {' and '.join(names)}; "
                             "give every volume one group")  # fmt: skip
        if kind in parts:
            parts[kind] += [(rows, called) for called in names or [""]]
    for names, count in file.unused.values():
        if names and len(names) == count:
            raise ReadError(
                f"{path}: names {', '.join(names[:6])} but tags no cell with any of them; write "
                "the mesh without Mesh.SaveAll, or leave the names out"
            )
        for called in names:
            entry.dropped(f"name {called!r}", "the file names it, but tags no cell with it")
    return file.points, _named(parts[TETRAHEDRON], 4), _named(parts[TRIANGLE], 3)


def _named(parts, width):
    """Return cells (n, width) and their names (n,)."""
    cells = np.concatenate([np.empty((0, width), dtype=np.int64), *(rows for rows, _ in parts)])
    names = [np.full(len(rows), name, dtype=object) for rows, name in parts]
    return cells, np.concatenate([np.empty(0, dtype=object), *names])


def _tagged_cells(path, raw, kind, width):
    """Return cells (n, width) of one kind and their names (n,), empty if untagged."""
    for block in raw.cells:
        if block.type not in ("triangle", "tetra", *_IGNORED):
            raise ReadError(
                f"{path}: holds {block.type!r} cells; only tetrahedra with 4 nodes and triangles "
                "with 3 are read, so write the mesh in first order"
            )
    cells, names = [np.empty((0, width), dtype=np.int64)], [np.empty(0, dtype=object)]
    for number, block in enumerate(raw.cells):
        if block.type == kind:
            data = np.asarray(block.data, dtype=np.int64).reshape(-1, width)
            if len(data) and (data.min() < 0 or data.max() >= len(raw.points)):
                raise ReadError(
                    f"{path}: a {kind} names node {data.max() + 1} of {len(raw.points)}"
                )
            cells.append(data)
            names.append(_cell_names(path, raw, number, kind, len(data)))
    return np.concatenate(cells), np.concatenate(names)


def _cell_names(path, raw, number, kind, count):
    """Return the name (count,) of each cell of a block, from its tags or from sets of cells."""
    names = np.full(count, "", dtype=object)
    prefix = "surface" if kind == "triangle" else "group"
    key = next((key for key in _TAGS if key in raw.cell_data), None)
    if key is not None:
        tags = np.asarray(raw.cell_data[key][number])
        if tags.shape != (count,) or not np.array_equal(tags, np.round(tags)):
            raise ReadError(f"{path}: {key} must hold one whole number for each {kind}")
        for tag in np.unique(tags[tags != 0]):
            names[tags == tag] = _tag_name(raw, int(tag), 2 if kind == "triangle" else 3, prefix)
        return names
    for name, parts in raw.cell_sets.items():
        members = np.asarray(parts[number] if parts[number] is not None else [], dtype=np.int64)
        if len(members) and members.max() >= count:
            raise ReadError(f"{path}: the set {name!r} names more {kind} cells than there are")
        members = members[names[members] == ""]
        names[members] = name
    return names


def _tag_name(raw, tag, dimension, prefix):
    """Return the name that the file gives to a tag, else its prefix and number."""
    for name, value in raw.field_data.items():
        if len(value) == 2 and tuple(value) == (tag, dimension):
            return name
    return f"{prefix}_{abs(tag)}"


def _assemble(points, zones, group_names, triangles, surface_names, groups, entry):
    """Return the mesh of tagged cells, without unused nodes."""
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
    chosen = (surface_names != "") & (row[triangles] >= 0).all(axis=1)
    surfaces = {
        name: row[triangles[chosen & (surface_names == name)]]
        for name in np.unique(surface_names[chosen]).tolist()
    }
    zones = row[zones]
    points = points[used]
    turned = tetrahedra.volumes(points, zones) < 0.0
    if turned.any() and not turned.all():
        entry.remark(f"{np.count_nonzero(turned)} of {len(zones)} zones were turned right-handed")
    zones[turned] = zones[turned][:, [0, 2, 1, 3]]
    _refuse_two_groups(zones, zone_group, names)
    return Mesh(points, zones, np.array(zone_group), tuple(names), surfaces)


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
