"""The quantities of a hole table and the kinds of tables that are known by their columns."""

import re
from dataclasses import dataclass, replace

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
    """A kind of hole table: the column of each quantity, its unit in the key, and the conventions.

    Columns are header names, or numbers from 0 where the file has no header. ``needs`` are the
    keys without which a file is not of this kind; ``angle_from`` is empty where not known.
    """

    name: str
    columns: dict
    needs: tuple = ()
    axes: str = "east_north"
    angle_from: str = ""


_PLACE = {"x_m": "x_m", "y_m": "y_m", "z_m": "z_m"}
_TOE = {"x_toe_m": "x_toe_m", "y_toe_m": "y_toe_m", "z_toe_m": "z_toe_m"}
_DECK = {"deck_top_m": "deck_top_m", "deck_base_m": "deck_base_m", "diameter_mm": "diameter_mm"}
_LOGIC = {
    "blast": "blast",
    "id": "hole_id",
    "diameter_mm": "diameter",
    "length_m": "length",
    "inclination_deg": "angle",
    "bearing_deg": "bearing",
    "delay_ms": "time",
}
_KIRRA_PLACES = {
    "x_m": "startxlocation",
    "y_m": "startylocation",
    "z_m": "startzlocation",
    "x_toe_m": "endxlocation",
    "y_toe_m": "endylocation",
    "z_toe_m": "endzlocation",
}
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
    "blast": 0,
    "diameter_mm": 15,
    "from_hole": 17,
    "relative_delay_ms": 18,
    "charge_kg": 26,
}
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


def plain(header):
    """Write a header in lower case with single underscores: "Hole ID" is "hole_id"."""
    return re.sub(r"[^a-z0-9]+", "_", header.strip().lower()).strip("_")


def recognise(first_row):
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
        found = {k: headers.index(name) for k, name in layout.columns.items() if name in headers}
        if all(key in found for key in layout.needs):
            return replace(layout, columns=found), True
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
