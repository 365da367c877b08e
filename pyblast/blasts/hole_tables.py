"""Hole tables: reading of known layouts, or of any CSV by a mapping of its columns."""

import csv
import io
import math
import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..errors import InputError, ReadError
from ..recordings.hand_tables import HEAD_LINES, decode_table, delimiter_of, hole_columns
from ..units import split_key, to_si
from .blast import Blast

NAMES = ("id", "blast", "from_hole")
LENGTHS, TIMES = ("m", "mm", "ft"), ("s", "ms")
UNITS = {
    **dict.fromkeys(("x", "y", "z", "x_toe", "y_toe", "z_toe", "diameter", "length"), LENGTHS),
    **dict.fromkeys(("deck_top", "deck_base"), LENGTHS),
    **dict.fromkeys(("delay", "relative_delay"), TIMES),
    **dict.fromkeys(("inclination", "bearing"), ("deg",)),
    **dict.fromkeys(NAMES, ("",)),
    "charge": ("kg", "lb"),
}


@dataclass(frozen=True)
class Layout:
    """Layout of a hole table: columns by quantity with unit, and conventions.

    Columns are header names, or numbers from 0 where the file has no header. ``needs`` are the
    keys without which a file is not of this kind; ``angle_from`` is empty where not known.
    """

    name: str
    columns: Mapping[str, int | str]
    needs: tuple[str, ...] = ()
    axes: str = "east_north"
    angle_from: str = ""


_PLACE = {"x_m": "x_m", "y_m": "y_m", "z_m": "z_m"}
_TOE = {"x_toe_m": "x_toe_m", "y_toe_m": "y_toe_m", "z_toe_m": "z_toe_m"}
_DECK = {"deck_top_m": "deck_top_m", "deck_base_m": "deck_base_m", "diameter_mm": "diameter_mm"}
_LOGIC = {
    "blast": "blast", "id": "hole_id", "diameter_mm": "diameter", "length_m": "length",
    "inclination_deg": "angle", "bearing_deg": "bearing", "delay_ms": "time",
}  # fmt: skip
_KIRRA_PLACES = {
    "x_m": "startxlocation", "y_m": "startylocation", "z_m": "startzlocation",
    "x_toe_m": "endxlocation", "y_toe_m": "endylocation", "z_toe_m": "endzlocation",
}  # fmt: skip
WITH_HEADER = (
    Layout(
        "pyblast hole table",
        {"id": "id", **_PLACE, **_TOE, "charge_kg": "charge_kg", "delay_ms": "delay_ms", **_DECK},
        ("id", *_PLACE, *_TOE, "charge_kg", "delay_ms"),
    ),
    Layout(
        "table of charge centres",
        {
            "id": "id",
            "x_m": "x",
            "y_m": "y",
            "z_m": "z",
            "charge_kg": "charge_kg",
            "delay_s": "delay_s",
        },
        ("id", "x_m", "y_m", "z_m", "charge_kg", "delay_s"),
    ),
    Layout(
        "BlastLogic export",
        {
            **_LOGIC,
            "x_m": "startx",
            "y_m": "starty",
            "z_m": "startz",
            "x_toe_m": "endx",
            "y_toe_m": "endy",
            "z_toe_m": "endz",
            "charge_kg": "measured_mass",
        },
        ("id", "x_m", "y_m", "z_m", "delay_ms"),
        angle_from="vertical",
    ),
    Layout(
        "BlastLogic plan",
        {
            **_LOGIC,
            "x_m": "x",
            "y_m": "y",
            "z_m": "z",
            "x_toe_m": "toex",
            "y_toe_m": "toey",
            "z_toe_m": "toez",
            "charge_kg": "planned_explosive_mass_kg",
        },
        ("blast", "id", "x_m", "y_m", "z_m", "delay_ms"),
        angle_from="vertical",
    ),
    Layout(
        "Kirra export",
        {
            "blast": "entityname",
            "id": "holeid",
            **_KIRRA_PLACES,
            "diameter_mm": "holediameter",
            "length_m": "holelengthcalculated",
            "inclination_deg": "holeangle",
            "bearing_deg": "holebearing",
            "from_hole": "fromholeid",
            "relative_delay_ms": "timingdelaymilliseconds",
            "charge_kg": "measuredmass",
        },
        ("blast", "id", *_KIRRA_PLACES, "from_hole", "relative_delay_ms"),
        angle_from="vertical",
    ),
)


def _kirra_columns(first, **others):
    """Columns of a Kirra table without header: id and places in a row, the others by number."""
    places = zip(("id", *_KIRRA_PLACES), range(first, first + 7), strict=True)
    return {**dict(places), **others}


_KIRRA_LONG = {
    "blast": 0, "diameter_mm": 15, "from_hole": 17, "relative_delay_ms": 18, "charge_kg": 26,
}  # fmt: skip
WITHOUT_HEADER = {
    4: {"id": 0, "x_m": 1, "y_m": 2, "z_m": 3},
    7: _kirra_columns(0),
    9: _kirra_columns(0, diameter_mm=7),
    12: _kirra_columns(0, diameter_mm=7, from_hole=9, relative_delay_ms=10),
    14: _kirra_columns(2, blast=0, diameter_mm=9, from_hole=11, relative_delay_ms=12),
    30: _kirra_columns(2, **_KIRRA_LONG),
    32: _kirra_columns(2, **_KIRRA_LONG),
    35: _kirra_columns(2, **_KIRRA_LONG),
}


def plain(header: str) -> str:
    """Write a header in lower case with single underscores: "Hole ID" is "hole_id"."""
    return re.sub(r"[^a-z0-9]+", "_", header.strip().lower()).strip("_")


def recognise(first_row: Sequence[str]) -> tuple[Layout | None, bool]:
    """Find the layout of a table from its first row.

    Parameters
    ----------
    first_row : sequence of str

    Returns
    -------
    layout : Layout or None
        Columns as numbers from 0; only those that the table has. None if nothing fits.
    has_header : bool
    """
    headers = [plain(name) for name in first_row]
    for layout in WITH_HEADER:
        columns = {k: headers.index(name) for k, name in layout.columns.items() if name in headers}
        if all(key in columns for key in layout.needs):
            return replace(layout, columns=columns), True
    columns = WITHOUT_HEADER.get(len(first_row))
    if columns is None or not _is_number(first_row[columns["x_m"]]):
        return None, False
    return Layout(f"Kirra table of {len(first_row)} columns", columns), False


def _is_number(text):
    """Whether a field reads as a number."""
    try:
        float(text)
    except ValueError:
        return False
    return True


LARGEST_FILE = 50_000_000
ABSENT = {"", "na", "n/a", "nan", "null", "none", "-"}
TIE = ":::"
OPTIONS = {
    "delimiter": (",", ";", "\t", "|"),
    "decimal": (".", ","),
    "header": (True, False),
    "skip_lines": (int,),
    "axes": ("east_north", "north_east"),
    "angle_from": ("vertical", "horizontal"),
}


def read_blast(
    path: str | Path, mapping: str | Path | dict | None = None, sheet: str | None = None
) -> Blast:
    """Read a hole table, CSV or Excel; the layout is detected from the columns.

    Parameters
    ----------
    path : str or Path
    mapping : str, Path or dict, optional
        For any other CSV: a TOML file or its content. ``[columns]`` gives each quantity its
        header name, or its number from 1; the unit is in the key (``charge_kg = "Mass"``,
        ``x_m``, ``delay_ms``, ``relative_delay_ms`` with ``from_hole``, ``inclination_deg``...).
        ``[table]`` may hold ``delimiter``, ``decimal``, ``header`` (false), ``skip_lines``,
        ``axes`` ("east_north" or "north_east") and ``angle_from`` ("vertical", "horizontal").
    sheet : str, optional
        Sheet of an Excel workbook; may be left out where only one has cells.

    Returns
    -------
    Blast
        With absolute times in s; remarks of the reader in ``notes``.

    Raises
    ------
    ReadError
        If the file or the mapping is invalid; names file, line and column.

    Examples
    --------
    >>> blast = read_blast("holes.csv")  # doctest: +SKIP
    >>> blast.checks()  # doctest: +SKIP
    """
    path = Path(path)
    asked, options = (None, {}) if mapping is None else _read_mapping(mapping)
    rows = _read_rows(path, options, sheet)
    names = rows[0][1]
    if asked is None:
        layout, has_header = recognise(names)
        if layout is None:
            layout, rows, has_header = _by_hand(path, rows)
    else:
        has_header = options.get("header", True)
        layout = _locate(path, asked, names, has_header)
    if layout is None:
        listed = ", ".join(names[:12])
        raise ReadError(
            f"{path.name}: the columns {listed} are no known hole table; give a mapping"
        )
    rows = rows[1:] if has_header else rows
    if not rows:
        raise ReadError(f"{path.name}: a header but no holes")
    columns = _read_columns(path, layout, rows, options.get("decimal") or _decimal_mark(rows))
    try:
        return _assemble(layout, columns)
    except (InputError, ReadError) as error:
        raise ReadError(f"{path.name}: {error}") from None


def absolute_times(names: Sequence[str], origins: Sequence[str], delays: np.ndarray) -> np.ndarray:
    """Add up delays along the ties between holes.

    Parameters
    ----------
    names, origins : sequence of str
        Each hole and the hole it is tied from; a hole tied from itself or from "" starts.
    delays : (n_holes,) float64, s

    Returns
    -------
    (n_holes,) float64, s

    Raises
    ------
    ReadError
        If a tie leads to an unknown hole or the ties run in a circle.
    """
    index = {name: n for n, name in enumerate(names)}
    times = np.full(len(names), np.nan)
    for start in range(len(names)):
        chain, n = [], start
        while n is not None and math.isnan(times[n]):
            if n in chain:
                circle = [str(names[k]) for k in chain[chain.index(n) :]]
                raise ReadError(f"hole ties run in a circle: {' <- '.join(circle[:6])}")
            chain.append(n)
            origin = origins[n]
            if origin not in index and origin != "":
                raise ReadError(f"hole {names[n]} is tied from {origin}, which is not in the table")
            n = None if origin in ("", names[n]) else index[origin]
        for k in reversed(chain):
            times[k] = delays[k] + (0.0 if n is None else times[n])
            n = k
    return times


def _by_hand(path, rows):
    """Find a row of usual titles among the first; return layout, rows from there, and success."""
    for n, (line, titles) in enumerate(rows[:HEAD_LINES]):
        columns = hole_columns(f"{path.name} line {line}", titles)
        if columns:
            return Layout("table with usual titles", columns), rows[n:], True
    return None, rows, False


def _decimal_mark(rows):
    """Return the decimal mark of the numbers: a comma where no number has a point."""
    cells = [cell for _, fields in rows for cell in fields]
    comma = any(re.fullmatch(r"[-+]?\d+,\d+", cell) for cell in cells)
    return "," if comma and not any(re.fullmatch(r"[-+]?\d*\.\d+", cell) for cell in cells) else "."


def _read_rows(path, options, sheet):
    """Rows of a table with their line numbers; blank lines and # comments are left out."""
    try:
        if path.stat().st_size > LARGEST_FILE:
            raise ReadError(f"{path.name}: larger than {LARGEST_FILE // 10**6} MB, no hole table")
        text = decode_table(path, sheet)
    except ReadError:
        raise
    except OSError as error:
        raise ReadError(f"{path}: can't be read: {error.strerror}") from None
    first = next((x for x in text.splitlines() if x.strip() and not x.startswith("#")), "")
    delimiter = options.get("delimiter") or delimiter_of(first)
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=delimiter)
    rows = []
    try:
        for fields in reader:
            fields = [item.strip() for item in fields]
            wanted = reader.line_num > options.get("skip_lines", 0)
            if wanted and any(fields) and not fields[0].startswith("#"):
                rows.append((reader.line_num, fields))
    except csv.Error as error:
        raise ReadError(f"{path.name} line {reader.line_num}: {error}") from None
    if not rows:
        raise ReadError(f"{path.name}: empty, expected a hole table")
    return rows


def _read_mapping(mapping):
    """Turn a mapping into a layout and the options of the table."""
    if not isinstance(mapping, dict):
        try:
            mapping = tomllib.loads(Path(mapping).read_text(encoding="utf-8"))
        except (OSError, ValueError, RecursionError) as error:
            raise ReadError(f"mapping {Path(mapping).name}: can't be read: {error}") from None
    columns, options = mapping.get("columns"), mapping.get("table", {})
    if not (isinstance(columns, dict) and isinstance(options, dict)):
        raise ReadError("mapping: needs a table [columns] and may have a table [table]")
    if unexpected := (set(mapping) - {"columns", "table"}) | (set(options) - set(OPTIONS)):
        raise ReadError(f"mapping: unknown {min(unexpected)}; [table] takes {', '.join(OPTIONS)}")
    for key in columns:
        stem, unit = split_key(key)
        if unit not in UNITS.get(stem, ()):
            known = ", ".join(f"{name} ({'/'.join(units)})" for name, units in UNITS.items())
            raise ReadError(
                f"mapping: columns.{key} is no quantity with its unit; known are {known}"
            )
    for name, value in options.items():
        if value not in OPTIONS[name] and type(value) is not OPTIONS[name][0]:
            raise ReadError(f"mapping: table.{name} can't be {value!r}")
    stems = {split_key(key)[0] for key in columns}
    if lost := {"x", "y", "z"} - stems:
        raise ReadError(f"mapping: columns.{min(lost)}_m is missing")
    return Layout(
        "mapped table",
        columns,
        axes=options.get("axes", "east_north"),
        angle_from=options.get("angle_from", ""),
    ), options


def _locate(path, layout, first_row, has_header):
    """Turn the header names of a mapping into numbers from 0."""
    headers = [plain(name) for name in first_row]
    columns = {}
    for key, name in layout.columns.items():
        if isinstance(name, str) and has_header and plain(name) in headers:
            columns[key] = headers.index(plain(name))
        elif type(name) is int and 1 <= name <= len(first_row):
            columns[key] = name - 1
        else:
            raise ReadError(f"{path.name}: mapping asks for column {name!r} ({key}); not there")
    return replace(layout, columns=columns)


def _read_columns(path, layout, rows, decimal):
    """Read every column: text for names, SI numbers (NaN where absent) for the rest."""
    columns = {}
    for key, index in layout.columns.items():
        stem = split_key(key)[0]
        is_name, values = stem in NAMES, []
        for line, fields in rows:
            where = f"{path.name} line {line}, column {index + 1} ({key})"
            if index >= len(fields):
                raise ReadError(f"{where}: the line has only {len(fields)} columns")
            text = fields[index]
            values.append(text if is_name else to_si(key, _number(text, decimal, where)))
        columns[stem] = values if is_name else np.array([value for _, value in values])
        if stem in {"x", "y", "z"} and np.any(np.isnan(columns[stem])):
            line = rows[int(np.argmax(np.isnan(columns[stem])))][0]
            raise ReadError(f"{path.name} line {line}: {key} is missing, expected a number")
    return columns


def _number(text, decimal, where):
    """Read a number; absent values are NaN."""
    if text.lower() in ABSENT:
        return math.nan
    try:
        value = float(text if decimal == "." else text.replace(decimal, "."))
    except ValueError:
        value = math.inf
    if math.isinf(value) or "_" in text:
        raise ReadError(f"{where}: expected a number, got {text[:40]!r}")
    return value


def _assemble(layout, columns):
    """Build the blast from columns in SI."""
    n = len(columns["x"])
    missing = np.full(n, math.nan)
    ids = columns.get("id", [str(k + 1) for k in range(n)])
    notes = []
    collar = np.column_stack([columns[name] for name in ("x", "y", "z")])
    toe = _toes(layout, columns, collar, notes)
    if layout.axes == "north_east":
        collar, toe = collar[:, [1, 0, 2]], toe[:, [1, 0, 2]]
    diameter = columns.get("diameter", missing)
    blasts = list(dict.fromkeys(map(str, columns.get("blast", []))))
    return Blast(
        name=", ".join(blasts[:3]) or layout.name,
        collar=collar,
        toe=toe,
        charge=columns.get("charge", missing),
        times=_times(columns, ids, notes),
        diameter=np.where(diameter == 0.0, math.nan, diameter),
        hole_ids=tuple(ids),
        deck=np.column_stack([columns.get(k, missing) for k in ("deck_top", "deck_base")]),
        stated_length=columns.get("length", missing),
        stated_inclination=columns.get("inclination", missing),
        notes=(f"Read as {layout.name}.", *notes),
    )


def _toes(layout, columns, collar, notes):
    """Toes as given, or from length, angle and bearing; the collar where nothing is known."""
    toes = [name for name in ("x_toe", "y_toe", "z_toe") if name in columns]
    if 0 < len(toes) < 3:
        raise ReadError(f"a toe needs x, y and z, only {', '.join(toes)} found")
    if toes:
        toe = np.column_stack([columns[name] for name in toes])
        if np.any(np.isnan(toe)):
            notes.append("Where a toe is missing, the charge is taken at the collar.")
        return np.where(np.isnan(toe).any(axis=1, keepdims=True), collar, toe)
    if "length" not in columns:
        notes.append("No toes and no lengths: the charges are taken at the given places.")
        return collar
    angle = columns.get("inclination")
    if angle is None:
        notes.append("No toes and no angles: the holes are taken as vertical.")
        angle = np.zeros(len(collar))
    elif layout.angle_from == "":
        raise ReadError(
            "angles without toes: it is not said whether they count from the vertical; set "
            'table.angle_from to "vertical" or "horizontal" in the mapping'
        )
    elif layout.angle_from == "horizontal":
        angle = math.pi / 2.0 - angle
    bearing = columns.get("bearing", np.zeros(len(collar)))
    east, north = np.sin(angle) * np.sin(bearing), np.sin(angle) * np.cos(bearing)
    across = (north, east) if layout.axes == "north_east" else (east, north)
    return collar + columns["length"][:, None] * np.column_stack([*across, -np.cos(angle)])


def _times(columns, ids, notes):
    """Absolute firing times, from absolute or from tied delays."""
    tied = "relative_delay" in columns
    delays = columns.get("relative_delay" if tied else "delay")
    if delays is None or np.all(np.isnan(delays)):
        notes.append("The table holds no firing times: all holes are taken at 0 ms.")
        return np.zeros(len(ids))
    if np.any(np.isnan(delays)):
        lost = [ids[n] for n in np.flatnonzero(np.isnan(delays))]
        raise ReadError(f"no firing time for {len(lost)} holes: {', '.join(lost[:5])}")
    if not tied:
        return delays
    origins = columns.get("from_hole", [""] * len(ids))
    origins = ["" if origin.lower() in ABSENT else origin for origin in origins]
    if "blast" not in columns:
        return absolute_times(ids, [origin.rpartition(TIE)[2] for origin in origins], delays)
    names = [f"{blast}{TIE}{name}" for blast, name in zip(columns["blast"], ids, strict=True)]
    full = [
        origin if TIE in origin or not origin else f"{blast}{TIE}{origin}"
        for blast, origin in zip(columns["blast"], origins, strict=True)
    ]
    return absolute_times(names, full, delays)
