"""Hole tables: known layouts, tables with usual titles, or any other by a mapping."""

import math
import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError, ReadError
from ..readers.cells import ABSENT, Cells, Wanted, cells_of, is_number, read_bytes, wanted_by
from ..readers.provenance import ReadLog
from ..readers.tables import (
    HEAD_LINES,
    NO_RULES,
    Rules,
    Table,
    head_of,
    load_mapping,
    rules_of,
    table_of,
)
from ..units import split_key
from .blast import Blast

FEWEST_TITLES = 3
LARGEST_FILE = 50_000_000
TIE = ":::"
OPTIONS = {"axes": ("east_north", "north_east"), "angle_from": ("vertical", "horizontal")}
YES = "yes", "true", "1", "ja", "oui", "si", "sim"
NOT_MEASURED = "09/05/1975"  # time stamp of Kirra for masses that nobody measured
_PLACES = Wanted(
    {n: q._replace(needed=n in ("x", "y", "z")) for n, q in wanted_by("holes").quantities.items()}
)  # what a mapping or a known layout must have


@dataclass(frozen=True)
class TableLayout:
    """Layout of a hole table: columns by quantity with unit, and conventions.

    Columns are header names, or numbers from 0 where the file has no header. ``needs`` are the
    keys without which a file is not of this kind; ``angle_from`` is empty where not known.
    """

    name: str
    columns: Mapping[str, Any]
    needs: Sequence[str] = ()
    axes: str = "east_north"
    angle_from: str = ""


_LAYOUTS = tomllib.loads(
    resources.files("pyblast.blasts").joinpath("layouts.toml").read_text(encoding="utf-8")
)
WITH_HEADER = tuple(TableLayout(**layout) for layout in _LAYOUTS["with_header"])
_IN_A_ROW = ("id", "x_m", "y_m", "z_m", "x_toe_m", "y_toe_m", "z_toe_m")


def plain_header(header: str) -> str:
    """Write a header in lower case with single underscores: "Hole ID" is "hole_id"."""
    return re.sub(r"[^a-z0-9]+", "_", header.strip().lower()).strip("_")


def recognise(first_row: Sequence[str]) -> tuple[TableLayout | None, bool]:
    """Find the layout of a table from its first row.

    Parameters
    ----------
    first_row : sequence of str

    Returns
    -------
    layout : TableLayout or None
        Columns as numbers from 0; only those that the table has. None if nothing fits.
    has_header : bool
    """
    headers = [plain_header(name) for name in first_row]
    for layout in WITH_HEADER:
        columns = {k: headers.index(name) for k, name in layout.columns.items() if name in headers}
        if all(key in columns for key in layout.needs):
            return replace(layout, columns=columns), True
    columns: dict[str, int] | None = _LAYOUTS["without_header"].get(str(len(first_row)))
    if columns is None:
        return None, False
    columns = columns | {key: columns["id"] + k for k, key in enumerate(_IN_A_ROW)}
    columns = {key: n for key, n in columns.items() if n < len(first_row)}
    if not is_number(first_row[columns["x_m"]]):
        return None, False
    return TableLayout(f"Kirra table of {len(first_row)} columns", columns), False


def read_blast(
    path: str | Path,
    mapping: str | Path | dict | None = None,
    sheet: str | None = None,
    log: ReadLog | None = None,
) -> Blast:
    """Read a hole table, CSV or Excel; the layout is detected from the columns.

    Parameters
    ----------
    path : str or Path
    mapping : str, Path or dict, optional
        For any other table: a TOML file or its content. ``[columns]`` gives a quantity its title,
        or its number from 1; the unit is in the key (``charge_kg = "Mass"``, ``x_m``,
        ``delay_ms``, ``relative_delay_ms`` with ``from_hole``, ``inclination_deg``...). What it
        does not name is recognised by its title. ``[table]`` may hold ``delimiter``, ``decimal``,
        ``header`` (false), ``skip_lines``, ``axes`` ("east_north" or "north_east") and
        ``angle_from`` ("vertical", "horizontal").
    sheet : str, optional
        Sheet of an Excel workbook; may be left out where only one has cells.
    log : ReadLog, optional
        Takes what was read.

    Returns
    -------
    Blast
        With absolute times in s; remarks of the reader in ``notes``.

    Raises
    ------
    ReadError, InputError
        If the file or the mapping is invalid; names file, line and column. If two columns may be
        one quantity and no title says which.

    Examples
    --------
    >>> blast = read_blast("holes.csv")  # doctest: +SKIP
    >>> blast.checks()  # doctest: +SKIP
    """
    path = Path(path)
    cells = cells_of(path.name, read_bytes(path, LARGEST_FILE), sheet)
    layout, table = _table(cells, mapping, log)
    try:
        return _assemble(layout, table)
    except (InputError, ReadError) as error:
        raise ReadError(f"{path.name}: {error}") from None


def _table(cells: Cells, mapping, log) -> tuple[TableLayout, Table]:
    """Return the table of holes, and the layout that it has."""
    layout, wanted, rules = TableLayout("table with usual titles", {}), wanted_by("holes"), NO_RULES
    if mapping is not None:
        tables = mapping if isinstance(mapping, dict) else load_mapping(mapping)
        wanted, rules = _PLACES, rules_of(tables, _PLACES, OPTIONS)
        conventions = {key: rules.options[key] for key in OPTIONS if key in rules.options}
        layout = TableLayout("mapped table", {}, **conventions)
    for delimiter in ",;\t" if mapping is None else "":
        rows = cells.split(delimiter, count=HEAD_LINES)
        known, has_header = recognise(rows[0][1]) if rows else (None, False)
        if known is not None:
            columns = {split_key(k)[0]: (n + 1, split_key(k)[1]) for k, n in known.columns.items()}
            rules = Rules(columns, {"delimiter": delimiter, "header": has_header}, rest=False)
            layout, wanted = known, _PLACES
            break
    head = head_of(cells, wanted, rules, least=FEWEST_TITLES)
    if head is None:
        _, row = next(iter(cells.split(",")), (1, ["(the table is empty)"]))
        listed = ", ".join(row[:12])
        raise ReadError(f"{cells.where}: the columns {listed} are no known hole table; give a "
                        "mapping")  # fmt: skip
    return layout, table_of(cells, head, wanted, rules, log, layout.name)


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


def _assemble(layout, table):
    """Build the blast from columns in SI."""
    columns, notes = table.values, list(table.notes)
    if table.unread and not layout.needs:
        notes.append(f"Columns that are not read: {', '.join(table.unread.values())[:200]}.")
    n = len(table.lines)
    missing = np.full(n, math.nan)
    for name in ("x", "y", "z"):
        if np.isnan(columns[name]).any():
            line = table.lines[int(np.argmax(np.isnan(columns[name])))]
            raise ReadError(f"line {line}: {name} is missing, expected a number")
    ids = columns.get("id", [str(k + 1) for k in range(n)])
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
        charge=_charges(columns, missing),
        **_fired(columns, _times(columns, ids, notes), notes),
        diameter=np.where(diameter == 0.0, math.nan, diameter),
        hole_ids=tuple(ids),
        deck=np.column_stack([columns.get(k, missing) for k in ("deck_top", "deck_base")]),
        stated_length=columns.get("length", missing),
        stated_inclination=columns.get("inclination", missing),
        **_pattern(columns, missing, notes),
        notes=(f"Read as {layout.name}.", *notes),
    )


def _fired(columns, planned, notes):
    """Return the firing times: those that detonators measured where there are any."""
    measured = columns.get("fired")
    if measured is None or np.isnan(measured).all():
        return {"times": planned}
    known = ~np.isnan(measured)
    first = int(np.flatnonzero(known)[np.argmin(planned[known])])
    measured = measured - measured[first] + planned[first]  # on the clock of the plan
    late = 1e3 * np.std((measured - planned)[known])
    notes.append(
        f"Firing times are the measured ones of {known.sum()} of {len(known)} holes, "
        f"{late:.2g} ms (standard deviation) off the planned ones."
    )
    times = np.where(known, measured, planned)
    return {"times": times - min(float(times.min()), 0.0), "planned": planned}


def _pattern(columns, missing, notes):
    """Return what the table says of the pattern: burden, stemming, rows, side of the face."""
    given = {name: columns[name] for name in ("burden", "stemming") if name in columns}
    given = {name: np.where(x > 0.0, x, math.nan) for name, x in given.items()}
    if "row" in columns:
        names = columns["row"]
        numbers = sorted({float(row) for row in names if is_number(row)})
        if len(numbers) > 1:
            at = {row: float(numbers.index(float(row))) for row in names if is_number(row)}
            given["row"] = np.array([at.get(row, math.nan) for row in names])
    if "face" in columns and np.isfinite(columns["face"]).any():
        given["face"] = float(np.nanmedian(columns["face"]))
    given["choked"] = any(str(word).lower() in YES for word in columns.get("choked", ()))
    derived = [name for name in ("burden", "stemming", "row", "face") if name not in given]
    if derived and len(missing) > 1:
        notes.append(
            f"Not in the table: {', '.join(derived)}; hole effects take them from the places of "
            "the holes, their charges and times."
        )
    return given


def _charges(columns, missing):
    """Return the charges in kg; a 0 that nobody measured is missing, not a misfire."""
    charge = columns.get("charge", missing)
    stamps = columns.get("measured_at", [""] * len(charge))
    never = np.array([stamp.startswith(NOT_MEASURED) for stamp in stamps])
    never |= columns.get("measured_length", missing) == 0.0
    return np.where(never & (charge == 0.0), math.nan, charge)


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
