"""Drawings: faces, points and polylines of DXF files, with blocks where they are inserted."""

import io
import re
from collections import Counter
from collections.abc import Sequence

import numpy as np

from ..errors import InputError, ReadError
from .cells import listed
from .provenance import FileRead

_SAME = 0.01  # between the ends of two pieces of a line, and two heights
_SAGITTA = 0.05  # of chords of arcs
_SAMPLE = 100  # faces of a layer that are compared with the others


_INSUNITS = {1: "in", 2: "ft", 4: "mm", 5: "cm", 6: "m", 7: "km", 21: "us_ft"}
_FACED = ("3DFACE", "MESH", "POLYLINE")
_LINES = ("LINE", "LWPOLYLINE", "POLYLINE", "SPLINE", "ARC")


def _drawing(name, content):
    """Return a DXF drawing, its entities with blocks where they are inserted, and hidden layers."""
    from ezdxf import recover
    from ezdxf.disassemble import recursive_decompose
    from ezdxf.lldxf.const import DXFError

    try:
        drawing, audit = recover.read(io.BytesIO(content))
        for error in (*audit.errors, *audit.fixes):
            mended = re.search(r'recovered invalid .* value "(.*)" near line (\d+)', error.message)
            if mended and not re.fullmatch(r"\s*[-+]?[.\d]+([eE][-+]?\d+)?\s*", mended[1]):
                what = f"expected a number, got {mended[1][:40]!r}"
                raise ReadError(f"{name}, near line {mended[2]}: {what}")
        space = list(drawing.modelspace())
        _refuse_references(name, drawing, space)
        seen = [entity for entity in space if not entity.dxf.get("invisible", 0)]
        entities = [e for e in recursive_decompose(seen) if not e.dxf.get("invisible", 0)]
    except ReadError:
        raise
    except (DXFError, ValueError, KeyError, IndexError, TypeError, AttributeError) as error:
        reason = " ".join(str(error).split())[:120] or type(error).__name__
        raise ReadError(f"{name}: no DXF file that can be read ({reason}); save it as R12 or later "
                        "again") from None  # fmt: skip
    hidden = {
        layer.dxf.name.lower() for layer in drawing.layers if layer.is_off() or layer.is_frozen()
    }
    return drawing, entities, hidden


def _visible(entry, entities, hidden):
    """Return entities that are not on hidden layers; log the others."""
    passed = [entity for entity in entities if entity.dxf.layer.lower() in hidden]
    if passed:
        names = sorted({entity.dxf.layer for entity in passed})
        entry.dropped(f"{len(passed)} entities", f"on hidden layers ({listed(names)})")
    return [entity for entity in entities if entity.dxf.layer.lower() not in hidden]


def _refuse_references(name, drawing, space):
    """Raise ReadError for blocks that lie in other files or are not defined."""
    for entity in space:
        if entity.dxftype() != "INSERT":
            continue
        block = drawing.blocks.get(entity.dxf.name)
        if block is None or block.block is None or block.block.is_xref:
            raise ReadError(
                f"{name}: inserts {entity.dxf.name!r}, which lies in another drawing; bind it"
            )


def _drawing_unit(drawing):
    """Return the unit of $INSUNITS; None where it says nothing."""
    code = drawing.header.get("$INSUNITS", 0)
    return _INSUNITS.get(int(code)) if str(code).strip().lstrip("-").isdigit() else None


def _kinds(entities):
    """Say what a drawing holds, by kinds."""
    kinds = Counter(entity.dxftype() for entity in entities)
    counts = ", ".join(f"{count} {kind}" for kind, count in kinds.most_common(5))
    return f"it holds {counts or 'nothing'}; export faces (3DFACE or a mesh)"


def _is_line(entity):
    """Tell whether an entity is a line, not a mesh that is written as a polyline."""
    kind = entity.dxftype()
    return kind in _LINES and not (
        kind == "POLYLINE" and (entity.is_poly_face_mesh or entity.is_polygon_mesh)
    )


def _faces(entity):
    """Return the corners (n, 3) of the faces of an entity, empty for other kinds."""
    kind = entity.dxftype()
    if kind == "3DFACE":
        corners = np.array([tuple(point) for point in entity.wcs_vertices()])
        return [corners[np.append(True, (np.diff(corners, axis=0) != 0.0).any(axis=1))]]
    if kind == "MESH":
        points = np.array([tuple(vertex) for vertex in entity.vertices], dtype=float)
        return [points[list(face)] for face in entity.faces]
    if kind == "POLYLINE" and not _is_line(entity):
        from ezdxf.render.mesh import MeshBuilder

        mesh = MeshBuilder.from_polyface(entity)
        return [np.array([tuple(p) for p in face]) for face in mesh.faces_as_vertices()]
    return []


def surface(
    entry: FileRead, content: bytes, layers: Sequence[str]
) -> tuple[np.ndarray, str | None]:
    """Return the triangles (n, 3, 3) of a drawing, its points (n, 3) where it has no faces.

    Also the unit of its header, None where that says nothing. Coordinates are those of the file.

    Raises
    ------
    ReadError
        If the file can't be read or holds no surface.
    InputError
        If a layer is absent, or the faces of two layers lie over each other.
    """
    name = entry.file
    drawing, entities, hidden = _drawing(name, content)
    known = {entity.dxf.layer.lower(): entity.dxf.layer for entity in entities}
    if absent := [layer for layer in layers if layer.lower() not in known]:
        raise InputError(
            f"{name}: nothing lies on the layer {absent[0]!r}; layers are "
            f"{listed(sorted(known.values()))}"
        )
    chosen = {layer.lower() for layer in layers}
    if chosen:
        entities = [entity for entity in entities if entity.dxf.layer.lower() in chosen]
    else:
        entities = _visible(entry, entities, hidden)
    pairs = [(entity.dxf.layer, corners) for entity in entities for corners in _faces(entity)]
    triangles: dict[str, list] = {}
    for layer, corners in pairs:
        for k in range(1, len(corners) - 1):
            triangles.setdefault(layer, []).append(corners[[0, k, k + 1]])
    unit = _drawing_unit(drawing)
    if triangles:
        if not chosen:
            _refuse_overlap(name, {layer: np.array(part) for layer, part in triangles.items()})
        others = Counter(entity.dxftype() for entity in entities) - Counter(
            {kind: len(entities) for kind in _FACED}
        )
        for kind, count in others.items():
            entry.dropped(f"{count} {kind}", "stands beside faces")
        values = np.concatenate([np.array(part) for part in triangles.values()])
        return values, unit
    points = [tuple(entity.dxf.location) for entity in entities if entity.dxftype() == "POINT"]
    if len(points) < 3:
        raise ReadError(f"{name}: holds neither faces nor three points; {_kinds(entities)}")
    return np.array(points, dtype=float), unit


def _refuse_overlap(name, layers):
    """Raise InputError where the triangles of one layer lie over those of another."""
    order = sorted(layers, key=lambda layer: len(layers[layer]))
    for n, layer in enumerate(order):
        middles = layers[layer].mean(axis=1)[:: max(1, len(layers[layer]) // _SAMPLE)]
        for other in order[n + 1 :]:
            gaps = [_height_at(layers[other], middle[:2]) - middle[2] for middle in middles]
            if np.nanmax(np.abs([*gaps, 0.0])) > _SAME:
                raise InputError(
                    f"{name}: faces on the layers {layer!r} and {other!r} lie over each other; "
                    "name those of the ground by surface_layers"
                )


def _height_at(triangles, position):
    """Return the height of triangles at a position in plan, NaN beside them."""
    a, b, c = (triangles[:, k] for k in range(3))
    e, f, g = (b - a)[:, :2], (c - a)[:, :2], position - a[:, :2]
    area = e[:, 0] * f[:, 1] - e[:, 1] * f[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        s = (g[:, 0] * f[:, 1] - g[:, 1] * f[:, 0]) / area
        t = (e[:, 0] * g[:, 1] - e[:, 1] * g[:, 0]) / area
    inside = np.flatnonzero((s > 1e-9) & (t > 1e-9) & (s + t < 1.0 - 1e-9))
    if not len(inside):
        return np.nan
    n = inside[0]
    return a[n, 2] + s[n] * (b - a)[n, 2] + t[n] * (c - a)[n, 2]


def chained(parts: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Join lines (n, 3) whose ends lie at one position, without repeated points."""
    chains = []
    for part in parts:
        keep = np.append(True, (np.abs(np.diff(part[:, :2], axis=0)) > 1e-6).any(axis=1))
        chains.append(part[keep])
    joined = True
    while joined:
        joined = False
        for n, first in enumerate(chains):
            for m in range(n + 1, len(chains)):
                if (line := _end_to_end(first, chains[m])) is not None:
                    chains[n] = line
                    del chains[m]
                    joined = True
                    break
            if joined:
                break
    return [line for line in chains if len(line) > 1]


def _end_to_end(first, second):
    """Return two lines as one where an end of one is an end of the other, else None."""
    for a in (first, first[::-1]):
        for b in (second, second[::-1]):
            if np.abs(a[-1] - b[0]).max() <= _SAME:
                return np.vstack([a, b[1:]])
    return None


def polylines(
    entry: FileRead, content: bytes, layer: str | None
) -> tuple[list[np.ndarray], str | None, str]:
    """Return the lines (n, 3) of one layer of a drawing, its unit, and the layer.

    Raises
    ------
    ReadError
        If the file can't be read, or holds no lines there.
    InputError
        If lines lie on several layers and none is named.
    """
    from ezdxf import path as curves

    name = entry.file
    drawing, entities, hidden = _drawing(name, content)
    lines = [entity for entity in entities if _is_line(entity)]
    lines = _visible(entry, lines, hidden) if layer is None else lines
    names = sorted({entity.dxf.layer for entity in lines})
    if layer is None and len(names) > 1:
        raise InputError(f"{name}: lines lie on the layers {listed(names)}; name one of them")
    if layer is not None:
        lines = [entity for entity in lines if entity.dxf.layer.lower() == layer.lower()]
    if not lines:
        where = f"the layer {layer!r}" if layer else "it"
        raise ReadError(
            f"{name}: {where} holds no lines; layers with lines are {listed(names) or 'none'}"
        )
    parts = [
        np.array([tuple(point) for point in curves.make_path(entity).flattening(_SAGITTA)])
        for entity in lines
    ]
    return parts, _drawing_unit(drawing), layer or names[0]


def faces(entry: FileRead, content: bytes) -> tuple[list[np.ndarray], str | None]:
    """Return the corners (n, 3) of each face of a drawing, and its unit.

    Raises
    ------
    ReadError
        If the file can't be read or holds none.
    """
    drawing, entities, hidden = _drawing(entry.file, content)
    entities = _visible(entry, entities, hidden)
    corners = [each for entity in entities for each in _faces(entity)]
    if not corners:
        raise ReadError(f"{entry.file}: holds no faces; {_kinds(entities)}")
    return corners, _drawing_unit(drawing)
