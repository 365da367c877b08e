"""Surveyed geometry: grids, triangles and polylines of GIS, CAD and survey programs, in m.

Headers say the unit and the missing cells. What a header says is compared with the box of the
model where there is one: units of drawings are set by templates more often than by surveyors.
"""

import io
import re
import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError, ReadError
from ..units import FACTORS
from .cells import listed, read_bytes, unit_name, wanted_by
from .kinds import expect
from .provenance import ReadLog
from .tables import Table, read_table

LENGTHS = {unit: FACTORS[unit] for unit in ("m", "km", "cm", "mm", "ft", "in", "us_ft")}
LOWEST, HIGHEST = -1000.0, 10000.0  # of any ground, in m or ft
WIDEST = 5e4  # m
# Words of a file that change places or heights: each is obeyed or refused.
WORDS = {
    "GeoTIFF": "scale offset unittype nodata Orientation PhotometricInterpretation pages "
    "RasterType ModelType LinearUnits VerticalUnits VerticalSystem scale_z origin_z .aux.xml",
    "ESRI ASCII grid": "NODATA_value xllcorner dx UNIT VERTCS Direction units zunits xshift "
    ".aux.xml",
    "Surfer grid": "blank limits", "STL": "units",
    "LandXML": "linearUnit elevationUnit rotationAngle i",
    "DXF": "$INSUNITS INSERT layer invisible",
}  # fmt: skip
_LARGEST_FILE = 500_000_000  # bytes
_MOST_CELLS = 25_000_000
_MARGIN = 3.0  # of a grid around the box, in sizes of the box


@dataclass(frozen=True, eq=False)
class SurveyedSurface:
    """Surveyed surface: positions or triangles, and the places where its file has no data.

    Parameters
    ----------
    values : (n, 3) or (n, 3, 3) float64, m
        Positions of a grid or a set of points, or corners of triangles.
    missing : (k, 2) float64, m
        Centres in plan of the cells of a grid without data.
    cell : tuple of 2 float, m, or None
        Width east and north of the cells of a grid; None: no grid.
    """

    values: np.ndarray
    missing: np.ndarray
    cell: tuple[float, float] | None = None


@dataclass(frozen=True, eq=False)
class _Content:
    """Content of a file in its own unit, and what its header says of that: a fact or a hint."""

    values: np.ndarray
    unit: str | None = None
    hint: bool = False
    missing: np.ndarray | None = None
    cell: tuple[float, float] | None = None
    degrees: bool = False
    heights_unknown: bool = False


def read_surface(
    path: str | Path,
    *,
    box: ArrayLike | None = None,
    unit: str | None = None,
    layers: Sequence[str] = (),
    log: ReadLog | None = None,
) -> SurveyedSurface:
    """Read a surveyed surface by the content of its file.

    Parameters
    ----------
    path : str or Path
        ESRI or Surfer ASCII grid, GeoTIFF, DXF (3DFACE, polyface, polygon and MESH entities, blocks
        where they are inserted; POINT entities where there are no faces), LandXML, STL, or a table
        of x, y, z.
    box : (3, 2) float, m, optional
        Ground that the surface belongs to; the unit of the file is compared with it.
    unit : str, optional
        One of `LENGTHS`, in the place of what the header says; titles of a table go before it.
    layers : sequence of str
        Layers of a drawing, or surfaces of LandXML; all by default, if they do not lie over each
        other.
    log : ReadLog, optional
        Gets what was chosen, converted or left out.

    Returns
    -------
    SurveyedSurface

    Raises
    ------
    ReadError
        If the file can't be read or holds no surface; if a height is none of any ground.
    InputError
        If the unit can't be decided, the surface does not fit the box, or a layer is absent.
    """
    path, log = Path(path), log or ReadLog()
    content = read_bytes(path, _LARGEST_FILE)
    kind = expect(path.name, content, "surface").name
    box = None if box is None else np.asarray(box, dtype=float)
    if layers and kind not in ("DXF", "LandXML"):
        raise InputError(f"{path.name}: has no layers; leave out the names of layers")
    if kind not in _READERS:
        table = read_positions(path, "surface", box=box, unit=unit, log=log, fits=_fits)
        return SurveyedSurface(_places(table), np.empty((0, 2)))
    entry = log.file(path, kind)
    raw = _READERS[kind](entry, content, tuple(layers))
    if raw.cell is not None:
        raw = _beside(path, raw)
    symbol, why = _unit(path.name, raw, box, unit, _fits)
    factor = LENGTHS[symbol]
    values = factor * raw.values
    missing = np.empty((0, 2)) if raw.missing is None else factor * raw.missing
    cell = None if raw.cell is None else (factor * raw.cell[0], factor * raw.cell[1])
    width = np.ptp(values.reshape(-1, 3)[:, :2], axis=0).max()
    if width > WIDEST and cell is None:
        raise InputError(f"{path.name}: is {width:.6g} m wide, as one in mm is; say its unit")
    if cell is not None and box is not None:
        n_read = len(values)
        values, missing = _near(values, box), _near(missing, box)
        if len(values) < n_read:
            entry.cut(f"{n_read - len(values)} cells", f"more than {_MARGIN:g} boxes away")
    what = "triangles" if values.ndim == 3 else "positions"
    entry.column(what, "coordinates", symbol, factor, rows=len(values), why=why)
    return SurveyedSurface(values, missing, cell)


def read_lines(
    path: str | Path,
    layer: str | None = None,
    *,
    box: ArrayLike | None = None,
    unit: str | None = None,
    log: ReadLog | None = None,
) -> list[np.ndarray]:
    """Read the polylines (n, 3) in m of one layer of a drawing, from the highest down, or a table.

    Parameters
    ----------
    path : str or Path
    layer : str, optional
        May be left out where only one layer holds lines; a table, of one line, has none.
    box, unit, log
        As for `read_surface`.

    Raises
    ------
    ReadError, InputError
        If the drawing or its layer holds no lines with heights, or its unit can't be decided.

    Notes
    -----
    Pieces that end at one position are joined; arcs and splines are cut into chords.
    """
    path, content = Path(path), read_bytes(Path(path), _LARGEST_FILE)
    box = None if box is None else np.asarray(box, dtype=float)
    if expect(path.name, content, "lines").name != "DXF":
        if layer is not None:
            raise InputError(f"{path.name}: has no layers; leave out {layer!r}")
        return [_places(read_positions(path, "surface", box=box, unit=unit, log=log))]
    from .drawings import chained, polylines

    entry = (log or ReadLog()).file(path, "DXF")
    parts, symbol_said, name = polylines(entry, content, layer)
    raw = _Content(np.concatenate(parts), symbol_said, hint=True)
    symbol, why = _unit(path.name, raw, box, unit, _reaches)
    chains = chained([LENGTHS[symbol] * part for part in parts])
    entry.column("lines", f"layer {name!r}", symbol, LENGTHS[symbol], rows=len(chains), why=why)
    return sorted(chains, key=lambda line: -line[:, 2].mean())


def read_faces(
    path: str | Path,
    *,
    box: ArrayLike | None = None,
    unit: str | None = None,
    log: ReadLog | None = None,
) -> list[np.ndarray]:
    """Return the corners (n, 3) in m of each face of a DXF drawing, such as fractures.

    Parameters
    ----------
    path : str or Path
    box, unit, log
        As for `read_surface`.

    Raises
    ------
    ReadError, InputError
        If the file can't be read or holds none, or its unit can't be decided.
    """
    from .drawings import faces as faces_of

    path = Path(path)
    entry = (log or ReadLog()).file(path, "DXF")
    faces, said = faces_of(entry, read_bytes(path, _LARGEST_FILE))
    raw = _Content(np.concatenate(faces), said, hint=True)
    box = None if box is None else np.asarray(box, dtype=float)
    symbol, why = _unit(path.name, raw, box, unit, _reaches)
    entry.column("faces", "coordinates", symbol, LENGTHS[symbol], rows=len(faces), why=why)
    return [LENGTHS[symbol] * corners for corners in faces]


def read_positions(
    path: Path, door: str, *, box: ArrayLike | None = None, unit: str | None = None,
    log: ReadLog | None = None, fits: Callable | None = None,
) -> Table:  # fmt: skip
    """Read a table with positions x, y, z in m, as the titles say; without a unit there, in one.

    Parameters
    ----------
    path : Path
    door : str
        Of `wanted_by`.
    box, unit, log
        As for `read_surface`; the positions must reach into the box.

    Raises
    ------
    ReadError, InputError
        If a position is missing, titles say another unit, or the table does not fit the box.
    """
    untitled = ("x", "y", "z") if door == "surface" else ()
    kind = "table of positions"
    table = read_table(path, wanted_by(door), None, log, untitled=untitled, kind=kind)
    lengths = [name for name in (*"xyz", "radius") if name in table.values]
    said = {table.units[name] for name in lengths} - {""}
    if unit is not None and {unit_name(text) for text in said} - {unit}:
        raise InputError(
            f"{path.name}: its titles say {' and '.join(sorted(said))}, the project {unit}; leave "
            "out one of them (surface_unit, file_unit)"
        )
    if (lost := np.isnan([table.values[name] for name in lengths]).any(axis=0)).any():
        line = table.lines[int(lost.argmax())]
        raise ReadError(f"{path.name}, line {line}: must be numbers, one is missing")
    raw = _Content(_places(table))
    symbol, why = _unit(path.name, raw, box, None if said else unit, fits or _reaches)
    if symbol != "m":
        table.entry.remark(f"lengths are in {symbol}, factor {LENGTHS[symbol]:g}: {why}")
    for name in lengths:
        table.values[name] = LENGTHS[symbol] * table.values[name]
    return table


def _places(table):
    """Return the positions (n, 3) of a table."""
    return np.column_stack([table.values[axis] for axis in "xyz"])


def _extent(values):
    """Write the extent in plan of positions."""
    corners = values.reshape(-1, 3)
    (west, south, _), (east, north, _) = np.min(corners, axis=0), np.max(corners, axis=0)
    return f"x {west:.7g} to {east:.7g}, y {south:.7g} to {north:.7g}"


def _looks_like_degrees(raw, box):
    """Tell whether plan coordinates are degrees, beside a box of metres that they do not cover."""
    if box is None or raw.unit not in (None, "m"):
        return False
    corners = raw.values.reshape(-1, 3)
    low, high = corners[:, :2].min(axis=0), corners[:, :2].max(axis=0)
    on_earth = (np.abs([low, high]) <= [180.0, 90.0]).all()
    return bool(on_earth and (high - low).max() < 5.0 and not _covers(corners, box))


def _covers(corners, box):
    """Tell whether the extent of positions covers half of a box in plan or more."""
    low, high = corners[:, :2].min(axis=0), corners[:, :2].max(axis=0)
    shared = np.minimum(high, box[:2, 1]) - np.maximum(low, box[:2, 0])
    area = np.prod(np.ptp(box[:2], axis=1))
    return bool((shared > 0.0).all() and np.prod(shared) >= 0.499 * area)


def _above(corners, box):
    """Return how far positions lie above or below a box in m, of those over it if there are."""
    size = np.ptp(box, axis=1).max()
    over = (np.abs(corners[:, :2] - box[:2].mean(axis=1)) < size).all(axis=1)
    heights = corners[over, 2] if over.any() else corners[:, 2]
    return max(box[2, 0] - heights.min(), heights.max() - box[2, 1], 0.0)


def _fits(corners, box):
    """Tell whether a surface is that of a box: over it, and not farther away than its height."""
    return _covers(corners, box) and _above(corners, box) <= np.ptp(box[2])


def _reaches(corners, box):
    """Tell whether lines or faces reach into a box and are no mere dot in it."""
    low, high = corners.min(axis=0), corners.max(axis=0)
    meets = (low <= box[:, 1]).all() and (high >= box[:, 0]).all()
    return bool(meets and np.linalg.norm(high - low) >= 0.2 * np.ptp(box[:2], axis=1).min())


def _meets(corners, box):
    """Tell whether lines or faces meet a box in plan, and no farther away than its height."""
    low, high = corners[:, :2].min(axis=0), corners[:, :2].max(axis=0)
    meets = (low <= box[:2, 1]).all() and (high >= box[:2, 0]).all()
    return bool(meets and _above(corners, box) <= np.ptp(box[2]))


def file_unit(
    name: str, corners: np.ndarray, box: ArrayLike | None = None, given: str | None = None
) -> tuple[str, str]:
    """Return the unit of the corners (n, 3) of fractures, given or m, and why.

    Raises InputError if they do not meet the box in it.
    """
    return _unit(name, _Content(corners), box, given, _reaches)


def _unit(name, raw, box, given, fits):
    """Return the unit of a file, given, said by its header or decided by the box, and why."""
    corners, said = raw.values.reshape(-1, 3), raw.unit or "m"
    key = "surface_unit" if fits is _fits else "file_unit"
    if raw.degrees or (given is None and _looks_like_degrees(raw, box)):
        raise InputError(
            f"{name}: its coordinates are degrees of longitude and latitude "
            f"({_extent(raw.values)}); project it to metres, to the coordinates of the model"
        )
    if given is None and raw.heights_unknown:
        raise InputError(
            f"{name}: its coordinates are in {said}, the unit of its heights is not said; convert "
            f"them to {said} and give {key} = {said!r}"
        )
    choice = f"; say which unit holds, {said!r} or 'm' ({key})"
    if box is None:
        if given is None and raw.hint and said != "m":
            raise InputError(
                f"{name}: its header says {said}, which drawing programs set by templates{choice}"
            )
        return given or said, _why(given, said)
    candidates = [given] if given else [said] if said == "m" else [said, "m"]
    fitting = [symbol for symbol in candidates if fits(LENGTHS[symbol] * corners, box)]
    if len(fitting) == 2 and raw.hint:
        raise InputError(
            f"{name}: its header says {said}, and it fits the box of the mesh in {said} and in m"
            f"{choice}"
        )
    if fitting:
        if fitting[0] == candidates[0]:
            return fitting[0], _why(given, said, ", and as it fits the box")
        return fitting[0], f"its header says {said}, it fits the box of the mesh in m alone"
    scaled = LENGTHS[candidates[0]] * corners
    beside = not _covers(scaled, box) if fits is _fits else _meets(scaled, box)
    if len(candidates) == 1 and beside:  # a surface beside the box: said where the ground is cut
        return candidates[0], _why(given, said)
    others = [u for u in LENGTHS if fits(LENGTHS[u] * corners, box)]
    remedy = f"; it would fit in {others[0]}: {key} = {others[0]!r}" if others else ""
    x, y, z = corners[np.abs(corners[:, 2] - box[2].mean()).argmax()]
    raise InputError(
        f"{name}: does not fit the box of the mesh in {' or '.join(candidates)}: it spans "
        f"{_extent(raw.values)}, and its height is {z:.7g} at ({x:.7g}, {y:.7g}){remedy}"
    )


def _why(given, said, more=""):
    """Say why a unit was taken."""
    return "as the project says" if given else "" if said == "m" else f"as its header says{more}"


def _near(positions, box):
    """Return the positions of a grid around a box."""
    reach = _MARGIN * np.ptp(box, axis=1).max()
    inside = (np.abs(positions[:, :2] - box[:2].mean(axis=1)) <= reach).all(axis=1)
    return positions[inside] if inside.any() else positions


# --- grids


def _cells(entry, heights, plan, missing, cell):
    """Return the content of cells with their centres in plan, without those that are missing."""
    name = entry.file
    blank = missing_cells(heights.ravel(), missing)
    if blank.all():
        raise ReadError(f"{name}: every cell is marked as missing; export the surface again")
    row, column = np.divmod(np.arange(heights.size), heights.shape[1])
    values = np.column_stack([plan, heights.ravel()])[~blank]
    wild = ~((values[:, 2] >= LOWEST) & (values[:, 2] <= HIGHEST))
    if wild.any():
        first = np.flatnonzero(wild)[0]
        at = np.flatnonzero(~blank)[first]
        raise ReadError(
            f"{name}, row {row[at] + 1}, column {column[at] + 1}: {values[first, 2]:g} is no "
            f"height of any ground ({np.count_nonzero(wild)} such cells); if it marks missing "
            "cells, write it as NODATA_value"
        )
    if blank.any():
        entry.dropped(f"{np.count_nonzero(blank)} of {blank.size} cells", "no data")
    return _Content(values, missing=plan[blank], cell=cell)


def missing_cells(heights: np.ndarray, marker: float | None) -> np.ndarray:
    """Return which cells (n,) of a grid are missing: not finite, or the marker in single precision.

    Examples
    --------
    >>> missing_cells(np.array([-3.40282347e38, 12.0, np.nan]), -3.4028234663852886e38).tolist()
    [True, False, True]
    """
    blank = ~np.isfinite(heights)
    if marker is not None and np.isfinite(marker):
        blank |= np.abs(heights - marker) <= 1.2e-7 * abs(marker)
    return blank


_BLANKS = {"*", "null", "nodata", "-nan", "-nan(ind)", "nan(ind)", "1.#qnan", "-1.#ind", "1.#inf"}
_HEAD_KEYS = {
    "ncols", "nrows", "xllcorner", "yllcorner", "xllcenter", "yllcenter", "cellsize", "dx", "dy",
    "nodata_value", "nodata", "byteorder",
}  # fmt: skip


def _words(name, content):
    """Return the lines of a text grid as words, with decimal points."""
    text = content.decode("utf-8-sig", errors="replace")
    if "\0" in text[:2000]:
        raise ReadError(f"{name}: is no text; export the grid as ASCII")
    if "," in text:
        spaced = re.search(r",\s", text) is not None
        if not spaced and re.search(r"\d\.\d", text):
            raise ReadError(f"{name}: mixes decimal points and commas; write points only")
        text = text.replace(",", " " if spaced else ".")
    return [line.split() for line in text.splitlines() if line.strip()]


def _number_of(name, word, what):
    """Return a number of a text grid; NaN for a mark of missing cells."""
    if word.lower() in _BLANKS:
        return np.nan
    try:
        return float(word)
    except ValueError:
        raise ReadError(f"{name}, {what}: expected a number, got {word[:40]!r}") from None


def _body(name, lines, rows, columns, head):
    """Return heights (rows, columns) of the words of a text grid after its header."""
    words = [word for line in lines for word in line]
    if len(words) != rows * columns:
        raise ReadError(
            f"{name}: header promises {rows} rows of {columns} heights, found {len(words)} numbers "
            f"after {head} lines of header"
        )
    try:
        heights = np.array(words, dtype=float)
    except ValueError:
        heights = np.array(
            [
                _number_of(name, word, f"row {n // columns + 1}, column {n % columns + 1}")
                for n, word in enumerate(words)
            ]
        )
    return heights.reshape(rows, columns)


def _ascii_grid(entry, content, _):
    """Read an ESRI ASCII grid, with square or oblong cells."""
    name, head = entry.file, {}
    lines = _words(name, content)
    while lines and lines[0][0].lower().rstrip(":") in _HEAD_KEYS and len(lines[0]) == 2:
        key, value = lines.pop(0)
        head[key.lower().rstrip(":")] = value
    n_head = len(head)
    head = {key: _number_of(name, value, key) for key, value in head.items() if key != "byteorder"}
    corner = "corner" if "xllcorner" in head else "center"
    needed = {"ncols", "nrows", f"xll{corner}", f"yll{corner}"}
    sizes = {"cellsize"} if "cellsize" in head else {"dx", "dy"}
    lacking = sorted((needed | sizes) - set(head))
    if lacking:
        raise ReadError(
            f"{name}: the header of an ESRI ASCII grid lacks {', '.join(lacking)}; it needs ncols, "
            "nrows, xllcorner, yllcorner, cellsize (or dx and dy)"
        )
    columns, rows = _counts(name, head["ncols"], head["nrows"])
    square = head.get("cellsize", 0.0)
    dx, dy = head.get("dx", square), head.get("dy", square)
    if not (dx > 0.0 and dy > 0.0 and np.isfinite([dx, dy]).all()):
        raise ReadError(f"{name}: cells must have a positive size, got {dx:g} by {dy:g}")
    heights = _body(name, lines, rows, columns, n_head)
    shift = 0.5 if corner == "corner" else 0.0
    x = head[f"xll{corner}"] + dx * (np.arange(columns) + shift)
    y = head[f"yll{corner}"] + dy * (np.arange(rows)[::-1] + shift)
    marker = head.get("nodata_value", head.get("nodata", -9999.0))
    plan = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    return _cells(entry, heights, plan, marker, (dx, dy))


def _surfer_grid(entry, content, _):
    """Read an ASCII grid of Surfer: rows from the southernmost up, blanks of 1.70141e38."""
    name = entry.file
    lines = _words(name, content)
    numbers = [_number_of(name, word, "header") for line in lines[1:5] for word in line]
    if len(numbers) != 8:
        raise ReadError(f"{name}: DSAA needs counts and limits of x, y and z in lines 2 to 5")
    columns, rows = _counts(name, *numbers[:2])
    west, east, south, north = numbers[2:6]
    heights = _body(name, lines[5:], rows, columns, 5)
    x, y = np.linspace(west, east, columns), np.linspace(south, north, rows)
    plan = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    cell = (np.ptp(x) / max(columns - 1, 1), np.ptp(y) / max(rows - 1, 1))
    return _cells(entry, np.where(heights >= 1.70141e38, np.nan, heights), plan, None, cell)


def _counts(name, columns, rows):
    """Return the counts of columns and rows of a grid."""
    sizes = np.array([columns, rows])
    if not (np.isfinite(sizes).all() and (sizes >= 1).all() and (sizes == np.rint(sizes)).all()):
        raise ReadError(f"{name}: counts must be whole and positive, got {columns:g} by {rows:g}")
    if columns * rows > _MOST_CELLS:
        raise ReadError(
            f"{name}: has {columns * rows:.0f} cells, at most {_MOST_CELLS}; thin it out"
        )
    return int(columns), int(rows)


# Words of a GeoTIFF that change places or heights are obeyed, but for other values of these tags.
_TAGS_READ = {"Orientation": (1,), "PhotometricInterpretation": (0, 1)}
_HEIGHTS = {
    5702: "us_ft",
    6360: "us_ft",
    8052: "us_ft",
    8050: "ft",
    8228: "ft",
    5703: "m",
}  # of EPSG
_DEPTHS = (5715, 6357, 6358, 8051, 8053)  # of EPSG, positive down
_EPSG_LENGTHS = {9001: "m", 9002: "ft", 9003: "us_ft", 9036: "km"}


def _geotiff(entry, content, _):
    """Read the first page of a GeoTIFF; its keys say unit, kind of coordinates and corner."""
    import tifffile

    name = entry.file
    try:
        with tifffile.TiffFile(io.BytesIO(content)) as file:
            page: Any = file.pages[0]
            _counts(name, page.imagewidth, page.imagelength)
            keys = dict(page.geotiff_tags)
            marker, metadata = (
                str(page.tags.valueof(code, "")).strip(" \0\n") for code in (42113, 42112)
            )
            _refuse_tags(name, file.pages, keys)
            heights = np.asarray(page.asarray(), dtype=float)
    except ReadError:
        raise
    except Exception as error:  # broken files can raise any exception there
        reason = " ".join(str(error).split())[:120] or type(error).__name__
        raise ReadError(
            f"{name}: no GeoTIFF that can be read ({reason}); write it uncompressed or with DEFLATE"
        ) from None
    if heights.ndim != 2:
        raise ReadError(f"{name}: has {heights.ndim} axes {heights.shape}, a height is one band")
    matrix = _geotiff_matrix(name, keys)
    row, column = np.divmod(np.arange(heights.size), heights.shape[1])
    half = 0.0 if int(keys.get("GTRasterTypeGeoKey", 1)) == 2 else 0.5
    at = np.column_stack([column + half, row + half, np.zeros(heights.size), np.ones(heights.size)])
    plan = (at @ matrix.T)[:, :2]
    value = _number_of(name, marker, "GDAL_NODATA") if marker else None
    cell = tuple(float(np.linalg.norm(matrix[:2, k])) for k in (0, 1))
    said = _said_of_heights(name, metadata)
    blank = missing_cells(heights.ravel(), value).reshape(heights.shape)
    heights = np.where(blank, np.nan, said.get("offset", 0.0) + said.get("scale", 1.0) * heights)
    raw = _cells(entry, heights, plan, None, cell)
    unit, vertical = (
        _EPSG_LENGTHS.get(int(keys.get(f"{key}UnitsGeoKey", 0) or 0))
        for key in ("ProjLinear", "Vertical")
    )
    code = int(keys.get("VerticalGeoKey", keys.get("VerticalCSTypeGeoKey", 0)) or 0)
    vertical = vertical or said.get("unittype") or _HEIGHTS.get(code)
    if vertical is not None:
        raw.values[:, 2] *= LENGTHS[vertical] / LENGTHS[unit or "m"]
    return replace(
        raw, unit=unit, degrees=int(keys.get("GTModelTypeGeoKey", 0) or 0) == 2,
        heights_unknown=unit not in (None, "m") and vertical is None,
    )  # fmt: skip


def _refuse_tags(name, pages, keys):
    """Raise ReadError for a GeoTIFF whose tags or keys change places and are not read."""
    tags = pages[0].tags
    odd = [f"{tag} = {tags[tag].value}" for tag, read in _TAGS_READ.items()
           if tag in tags and tags[tag].value not in read]  # fmt: skip
    bands = sum(not (page.is_reduced or page.is_mask) for page in pages)
    odd += [f"{bands} pages"] if bands > 1 else []
    odd += ["geocentric coordinates"] if int(keys.get("GTModelTypeGeoKey", 0) or 0) == 3 else []
    depth = int(keys.get("VerticalGeoKey", keys.get("VerticalCSTypeGeoKey", 0)) or 0) in _DEPTHS
    odd += ["depths for heights"] if depth else []
    scale, tie = keys.get("ModelPixelScale") or (), keys.get("ModelTiepoint") or ()
    if len(scale) > 2 and len(tie) > 5 and (scale[2] not in (0.0, 1.0) or tie[2] or tie[5]):
        odd.append(f"a scale of {scale[2]:g} and an origin of {tie[5]:g} for heights")
    if odd:
        raise ReadError(f"{name}: holds {', '.join(odd)}, not read; write one band of heights in "
                        "rows from the north")  # fmt: skip


def _said_of_heights(name, metadata):
    """Return scale, offset and unit of heights of the metadata of GDAL."""
    try:
        parts = ElementTree.fromstring(metadata or "<a/>")
    except ElementTree.ParseError as error:
        raise ReadError(f"{name}: its GDAL_METADATA are broken XML ({error})") from None
    items = {part.get("role"): (part.text or "").strip() for part in parts}
    said: dict = {w: _number_of(name, items[w], w) for w in ("scale", "offset") if w in items}
    if items.get("unittype"):
        said["unittype"] = unit_name(items["unittype"].replace(" ", "_"))
        if said["unittype"] not in LENGTHS:
            raise ReadError(f"{name}: unknown unit of heights {items['unittype'][:40]!r}")
    return said


def _geotiff_matrix(name, keys):
    """Return the matrix (4, 4) from column and row to coordinates."""
    if "ModelTransformation" in keys:
        return np.asarray(keys["ModelTransformation"], dtype=float).reshape(4, 4)
    scale, tie = keys.get("ModelPixelScale"), keys.get("ModelTiepoint")
    if scale is None or tie is None or len(scale) < 2 or len(tie) < 6:
        raise ReadError(f"{name}: is no GeoTIFF, it says neither position nor size of its cells")
    i, j, _, x, y, _ = tie[:6]
    matrix = np.diag([scale[0], -scale[1], 1.0, 1.0])
    matrix[:2, 3] = x - i * scale[0], y + j * scale[1]
    return matrix


def _beside(path, raw):
    """Return the content of a raster with what the files beside it say: .prj, .aux.xml."""
    files = [
        path.with_name(f"{path.name}.aux.xml"),
        path.with_suffix(".prj"),
        path.with_suffix(".PRJ"),
    ]
    aux, prj, upper = (
        read_bytes(file)[:100_000].decode("latin-1") if file.is_file() else "" for file in files
    )
    text, old = prj or upper, r"(?im)^\s*(?:z?units\s+(?!met)|[xy]shift\s+-?0*\.?0*[1-9]).*"
    odd = re.search(r"<(?:Scale|Offset|UnitType|NoDataValue|GeoTransform)>", aux) or (
        re.search(rf'{old}|"Direction"\s*,\s*-1', text)
    )
    if odd:
        raise ReadError(f"{path.name}: a file beside it says {odd[0].strip()!r}, not read; write "
                        "heights in metres into the raster itself")  # fmt: skip
    plan, *vertical = re.split(r"(?i)\bVERT(?:_?CS|CRS|ICALCRS)\s*\[", text, maxsplit=1)
    projected = re.search(r"(?i)PROJC(S|RS)\s*\[", plan)
    if re.search(r"(?i)GEOG(CS|CRS)\s*\[|Projection\s+GEOGRAPHIC", plan) and not projected:
        return replace(raw, degrees=True)
    if not projected:
        return raw
    unit, *height = (_wkt_unit(path, part) for part in (plan, *vertical))
    if height and height[0] != unit:
        raise ReadError(
            f"{path.stem}.prj: places in {unit}, heights in {height[0]}; write both in m"
        )
    return replace(raw, unit=unit, heights_unknown=unit != "m" and not height)


def _wkt_unit(path, text):
    """Return the unit of lengths that a coordinate system in WKT says last, m for none."""
    units = re.findall(r'(?i)UNIT\s*\[\s*"[^"]*"\s*,\s*([\d.eE+-]+)', text) or ["1"]
    near = [u for u, size in LENGTHS.items() if abs(float(units[-1]) / size - 1.0) < 1e-7]
    if not near:
        raise ReadError(
            f"{path.stem}.prj: unknown unit of {units[-1]} m; project the grid to metres"
        )
    return near[0]


# --- triangles


def _stl(entry, content, _):
    """Read the triangles of a text or binary STL file."""
    name = entry.file
    count = struct.unpack_from("<I", content, 80)[0] if len(content) >= 84 else -1
    if len(content) == 84 + 50 * count and count:
        records = np.frombuffer(content, dtype=np.uint8, offset=84).reshape(count, 50)
        corners = records[:, 12:48].copy().view("<f4").reshape(count, 3, 3).astype(float)
    else:
        text = content.decode("latin-1")
        rows = re.findall(r"(?i)^\s*vertex\s+(\S+)\s+(\S+)\s+(\S+)\s*$", text, re.MULTILINE)
        try:
            corners = np.array(rows, dtype=float).reshape(-1, 3, 3)
        except ValueError:
            raise ReadError(f"{name}: is a broken STL file; export the surface again") from None
        if not len(corners):
            raise ReadError(f"{name}: holds no triangles; export the surface as STL again")
    if not np.isfinite(corners).all():
        raise ReadError(f"{name}: holds corners that are not finite; export the surface again")
    said = re.search(rb"(?i)units?\s*[=:]\s*([a-z_]+)", content[:200].partition(b"facet")[0])
    unit = said and unit_name(said[1].decode())
    if said and unit not in LENGTHS:
        raise ReadError(f"{name}: unknown unit {said[1].decode()!r} in its header")
    return _Content(corners, unit, hint=True)


_XML_LENGTHS = {"millimeter": "mm", "ussurveyfoot": "us_ft"}


def _landxml(entry, content, layers):
    """Read a surface of LandXML: points as northing, easting, height, and visible faces."""
    name = entry.file
    if b"<!DOCTYPE" in content or b"<!ENTITY" in content:
        raise ReadError(f"{name}: document types and entities are not accepted; remove them")
    try:
        root = ElementTree.fromstring(content)
    except ElementTree.ParseError as error:
        raise ReadError(f"{name}: is broken XML ({error})") from None
    for element in root.iter():
        element.tag = str(element.tag).rpartition("}")[2]
    surfaces = {
        each.get("name", f"surface {n}"): each
        for n, each in enumerate(root.iter("Surface"), 1)
        if each.find("Definition/Faces/F") is not None
    }
    if absent := [layer for layer in layers if layer not in surfaces]:
        raise InputError(
            f"{name}: has no surface {absent[0]!r}, only {listed(list(surfaces)) or 'none'}"
        )
    if any(e.get("rotationAngle", "0") not in ("", "0", "0.0") for e in root.iter()):
        raise ReadError(f"{name}: is turned by rotationAngle; export it in the model's coordinates")
    chosen = list(layers) or list(surfaces)
    if len(chosen) != 1:
        raise (InputError if surfaces else ReadError)(
            f"{name}: holds the surfaces {listed(chosen) or 'none'} with faces; name that of the "
            "ground by surface_layers"
        )
    values = _landxml_triangles(name, surfaces[chosen[0]])
    units = next((each for each in root.iter() if each.tag in ("Metric", "Imperial")), None)
    if units is None:
        return _Content(values)
    words = units.get("linearUnit", ""), units.get("elevationUnit") or units.get("linearUnit", "")
    unit, height = (_XML_LENGTHS.get(word.lower()) or unit_name(word) for word in words)
    if unit not in LENGTHS or height not in LENGTHS:
        raise ReadError(f"{name}: unknown linearUnit or elevationUnit, {' and '.join(words)}")
    values[:, :, 2] *= LENGTHS[height] / LENGTHS[unit]
    return _Content(values, unit)


def _landxml_triangles(name, surface):
    """Return the triangles (n, 3, 3) of a surface of LandXML."""
    try:
        points = {p.get("id"): [float(w) for w in p.text.split()] for p in surface.iter("P")}
        faces = [f.text.split()[:3] for f in surface.iter("F") if f.get("i") != "1"]
        corners = np.array([[points[word] for word in face] for face in faces], dtype=float)
        return corners.reshape(-1, 3, 3)[:, :, [1, 0, 2]]
    except (KeyError, ValueError, AttributeError):
        raise ReadError(
            f"{name}: a face of LandXML names a point that is not there, or a point is no three "
            "numbers"
        ) from None


def _dxf_surface(entry, content, layers):
    """Read the faces of a drawing, or its points where it has no faces."""
    from .drawings import surface

    values, unit = surface(entry, content, layers)
    return _Content(values, unit, hint=True)


_READERS = {
    "ESRI ASCII grid": _ascii_grid, "Surfer grid": _surfer_grid, "GeoTIFF": _geotiff,
    "DXF": _dxf_surface, "LandXML": _landxml, "STL": _stl,
}  # fmt: skip
