"""Tables made by hand: Excel workbooks, and usual column titles in several languages."""

import csv
import io
import re
import zipfile
from collections.abc import Sequence
from datetime import date, datetime, time
from pathlib import Path
from typing import NamedTuple

from ..errors import InputError, ReadError
from ..units import FACTORS
from .raw import (
    RawRecord,
    is_pressure,
    overpressure,
    plain_word,
    read_columns,
    refuse_other_files,
    refuse_sheet,
    split_line,
    uniform_step,
    unit_factor,
    velocity_factor,
)

MAGIC = b"PK\x03\x04"
LARGEST_UNPACKED = 500_000_000  # bytes of all parts of a workbook


def is_workbook(content: bytes) -> bool:
    """Tell whether the content of a file is an Excel workbook (.xlsx, .xlsm)."""
    if not content.startswith(MAGIC):
        return False
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            return "xl/workbook.xml" in archive.namelist()
    except (zipfile.BadZipFile, OSError):
        return False


def sheet_lines(path: Path, content: bytes, sheet: str | None = None) -> list[str]:
    """Read one sheet of a workbook as lines of CSV, line n for row n.

    Parameters
    ----------
    path : Path
        For messages.
    content : bytes
    sheet : str, optional
        Name of the sheet; may be left out where only one has cells.

    Returns
    -------
    list of str
        Comma-separated; numbers as they are stored, with a decimal point; dates in ISO form.

    Raises
    ------
    InputError
        If no sheet has this name, or none is named and several have cells; lists the sheets.
    ReadError
        If the workbook is damaged, protected by a password, or unpacks to more than 500 MB.
    """
    _check_size(path, content)
    import openpyxl
    from openpyxl.utils.exceptions import InvalidFileException

    try:
        book = openpyxl.load_workbook(io.BytesIO(content), read_only=True, data_only=True)
        try:
            tables = {table.title: table for table in book.worksheets}
            if sheet is not None and sheet not in tables:
                raise InputError(
                    f"{path}: has no sheet {sheet!r}; its sheets are {', '.join(tables)}"
                )
            wanted = tables.values() if sheet is None else [tables[sheet]]
            lines = {table.title: _lines(table) for table in wanted}
        finally:
            book.close()
    except (KeyError, ValueError, OSError, InvalidFileException, SyntaxError) as error:
        if isinstance(error, InputError):
            raise
        raise ReadError(f"{path}: is a damaged Excel workbook ({error})"[:300]) from None
    filled = {name: rows for name, rows in lines.items() if rows}
    if not filled:
        what = "workbook" if sheet is None else f"sheet {sheet!r}"
        raise ReadError(f"{path}: the {what} is empty, expected a table")
    if len(filled) > 1:
        raise InputError(
            f"{path}: has several sheets ({', '.join(filled)}); name one by sheet = "
            f"{next(iter(filled))!r}"
        )
    return next(iter(filled.values()))


def _check_size(path, content):
    """Refuse a workbook that unpacks to more than memory should hold."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        size = sum(part.file_size for part in archive.infolist())
    if size > LARGEST_UNPACKED:
        most = LARGEST_UNPACKED // 10**6
        raise ReadError(f"{path}: unpacks to {size // 10**6} MB, at most {most} MB are read")


def _lines(table):
    """Return the rows of a sheet as lines of CSV, without empty rows at the end."""
    lines = []
    for row in table.iter_rows(values_only=True):
        cells = [_text(value) for value in row]
        while cells and not cells[-1]:
            cells.pop()
        buffer = io.StringIO()
        csv.writer(buffer, lineterminator="").writerow(cells)
        lines.append(buffer.getvalue() if cells else "")
    while lines and not lines[-1]:
        lines.pop()
    return lines


def _text(value) -> str:
    """Write the value of a cell on one line."""
    if value is None:
        return ""
    if isinstance(value, (datetime, date, time)):
        return value.isoformat()
    if isinstance(value, float) and value.is_integer() and abs(value) < 1e15:
        return str(int(value))
    return " ".join(str(value).split())


def decode_table(path: Path, sheet: str | None = None) -> str:
    """Read a table in UTF-8 or a sheet of a workbook; refuse other files with the remedy."""
    content = path.read_bytes()
    if is_workbook(content):
        return "\n".join(sheet_lines(Path(path.name), content, sheet))
    refuse_sheet(path.name, sheet)
    refuse_other_files(path.name, content)
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ReadError(
            f"{path.name}: is not UTF-8 text (first at byte {error.start}); save it as CSV in UTF-8"
        ) from None
    if "\0" in text:
        raise ReadError(f"{path.name}: holds zero bytes, so it is no text; save the table as CSV")
    return text


# English, German, French, Spanish, Portuguese, Italian, Dutch, Polish, Turkish and Russian titles,
# in lower case, without accents and signs
WORDS = {
    "time": "time t zeit temps tiempo tempo tijd czas zaman время",
    "longitudinal": (
        "longitudinal long lon l radial rad r longitudinale longitudinaal podluzna boyuna "
        "radiale ppvl vl продольная"
    ),
    "transverse": (
        "transverse transversal tran trans t2 tangential transversale trasversale transversaal "
        "poprzeczna enine tangentiale tangencial ppvt vt поперечная"
    ),
    "vertical": "vertical vert v vertikal verticale verticaal pionowa dusey z ppvv vv вертикальная",
    "east": "east e ost est este leste oost wschod dogu восток vx",
    "north": "north n nord norte noord polnoc kuzey север vy",
    "microphone": (
        "micl mic mikrofon microphone microfono microfone overpressure air airblast "
        "airoverpressure airpressure aop luftdruck luftschall surpression sobrepresion "
        "sobrepressao sovrapressione overdruk микрофон"
    ),
    "vector sum": "vectorsum pvs vs resultant resultante vektorsumme sum summe resultierende",
    "number": "no nr number sample index n2 i num probe",
}  # fmt: skip
HOLE_WORDS = {
    "id": (
        "id hole holeid holeno holenumber holename name bohrloch loch lochnr bohrlochnr trou "
        "numerodutrou barreno taladro furo foro boorgat otwor delik скважина"
    ),
    "x": "x east easting collarx startx rechtswert est este leste oost x1 ostwert",
    "y": "y north northing collary starty hochwert nord norte noord y1 nordwert",
    "z": (
        "z elevation collarz startz level rl height hohe altitude cota quota elev hoogte z1 "
        "elevacion elevazione kote"
    ),
    "x_toe": "xtoe toex x2 endx bottomx toeeast toeeasting xpied xpie",
    "y_toe": "ytoe toey y2 endy bottomy toenorth toenorthing ypied ypie",
    "z_toe": "ztoe toez z2 endz bottomz toeelevation toerl zpied zpie",
    "charge": (
        "charge chargeweight chargemass explosive explosives explosivemass mass weight ladung "
        "lademenge sprengstoff sprengstoffmenge ladungsmenge chargeunitaire carga cargaexplosiva "
        "carica lading ladunek sarj заряд"
    ),
    "delay": (
        "delay time firingtime detonationtime initiationtime delaytime zundzeit zeit verzogerung "
        "zundzeitpunkt retard temps retardo tiempo ritardo tempo vertraging opoznienie gecikme "
        "замедление"
    ),
    "diameter": (
        "diameter dia holediameter durchmesser bohrlochdurchmesser diametre diametro srednica cap "
        "диаметр"
    ),
    "length": (
        "length depth holelength holedepth lange tiefe bohrlochlange longueur profondeur longitud "
        "profundidad comprimento profundidade lunghezza profondita lengte diepte dlugosc boy длина"
    ),
    "inclination": "angle inclination dip neigung neigungswinkel inclinaison inclinacion",
    "bearing": "bearing azimuth azimut azimutal richtung direction rumbo direccion",
}  # fmt: skip
HOLE_UNITS = {
    "x": ("m", "ft"), "y": ("m", "ft"), "z": ("m", "ft"),
    "x_toe": ("m", "ft"), "y_toe": ("m", "ft"), "z_toe": ("m", "ft"),
    "charge": ("kg", "lb"), "delay": ("ms", "s"), "diameter": ("mm", "m"), "length": ("m", "ft"),
    "inclination": ("deg",), "bearing": ("deg",), "id": ("",),
}  # fmt: skip
HOLE_NEEDS = ("x", "y", "z", "charge", "delay")
METRES = ("x", "y", "z", "x_toe", "y_toe", "z_toe", "length")  # may stand without their unit
_SPELLINGS = {"kgs": "kg", "lbs": "lb", "sec": "s", "msec": "ms", "metre": "m", "°": "deg"}
MOTION = ("longitudinal", "transverse", "vertical", "east", "north")
HEAD_LINES = 60  # of a file, among which the row of titles is looked for
_BRACKETS = re.compile(r"(.*?)[\s_,:/]*[\[(]\s*(.+?)\s*[\])]*\s*")


class Title(NamedTuple):
    """Title of a column: its quantity, empty where unknown, and the unit beside it."""

    quantity: str
    unit: str


def _index(words):
    """Return the quantity of each word."""
    return {word: quantity for quantity, line in words.items() for word in line.split()}


_MOTION_WORDS, _HOLE_WORDS = _index(WORDS), _index(HOLE_WORDS)


def read_title(text: str, words: dict[str, str] | None = None) -> Title:
    """Split the title of a column into quantity and unit.

    Parameters
    ----------
    text : str
        Such as "Long (mm/s)", "Zeit [ms]", "east_m_per_s" or "Vert".
    words : dict of str to str, optional
        Quantity of each plain word; those of motion by default.

    Examples
    --------
    >>> read_title("Längs. Long (mm/s)")
    Title(quantity='longitudinal', unit='mm/s')
    >>> read_title("Zeit [ms]")
    Title(quantity='time', unit='ms')
    """
    words = _MOTION_WORDS if words is None else words
    text = text.strip().strip('"').strip()
    match = _BRACKETS.fullmatch(text)
    stem, unit = (match[1], match[2]) if match else (text, "")
    if not match:
        for suffix in sorted(FACTORS, key=len, reverse=True):
            if stem.lower().endswith("_" + suffix):
                stem, unit = stem[: -len(suffix) - 1], suffix
                break
        else:
            head, _, tail = stem.rpartition(" ")
            if head and _is_unit(tail):
                stem, unit = head, tail
    return Title(_quantity(stem, words), unit)


def _quantity(stem, words):
    """Return the quantity of a title without unit: of all its words, or of the only known one."""
    whole = words.get(plain_word(stem))
    if whole:
        return whole
    known = {
        words[word]
        for word in map(plain_word, re.split(r"[\s_.,:;/-]+", stem))
        if len(word) > 1 and word in words
    }
    return known.pop() if len(known) == 1 else ""


def _is_unit(text):
    """Tell whether a text is a unit of time, velocity, pressure or level."""
    try:
        unit_factor(text, "")
    except ReadError:
        return is_pressure(text)
    return True


def hole_title(text: str) -> Title:
    """Split the title of a column of a hole table into quantity and unit."""
    return read_title(text, _HOLE_WORDS)


def hole_columns(where: str, titles: Sequence[str]) -> dict[str, int]:
    """Return the columns of a hole table with usual titles, by key with unit.

    Parameters
    ----------
    where : str
        For messages.
    titles : sequence of str
        Such as "Hole", "Easting (m)", "Charge [kg]", "Zündzeit (ms)".

    Returns
    -------
    dict of str to int
        Such as ``{"id": 0, "x_m": 1, "charge_kg": 4}``; empty where fewer than three titles are
        known.

    Raises
    ------
    ReadError
        If a needed column or the unit of charge, delay or diameter is missing.
    """
    known: dict[str, int] = {}
    units = {}
    for n, title in enumerate(map(hole_title, titles)):
        if title.quantity and title.quantity not in known:
            known[title.quantity], units[title.quantity] = n, title.unit.strip().lower()
    if len(known) < 3 or not {"x", "y"} & set(known):
        return {}
    if missing := [name for name in HOLE_NEEDS if name not in known]:
        examples = ", ".join(f"{name} ({HOLE_UNITS[name][0]})" for name in missing)
        raise ReadError(f"{where}: missing columns: {examples}; add them, or give a mapping")
    columns = {}
    for name, n in known.items():
        unit = _SPELLINGS.get(units[name], units[name]) or ("m" if name in METRES else "")
        if name in ("inclination", "bearing"):
            unit = "deg"
        if name == "id":
            columns[name] = n
        elif unit in HOLE_UNITS[name]:
            columns[f"{name}_{unit}"] = n
        else:
            raise ReadError(
                f"{where}: column '{titles[n]}' needs its unit, {' or '.join(HOLE_UNITS[name])}, "
                f"such as '{name.capitalize()} ({HOLE_UNITS[name][0]})'"
            )
    return columns


def delimiter_of(line: str) -> str:
    """Return the delimiter of a row of titles: comma, semicolon or tab, outside of quotes."""
    outside = re.sub(r'"[^"]*"', "", line)
    return max(",;\t", key=outside.count)


def title_row(lines: Sequence[str]) -> int | None:
    """Return the index of the row of titles of a table of motion, None where there is none.

    It is the first row with two cells or more of which one is time or a component, and all known
    cells are different.
    """
    for n, line in enumerate(lines[:HEAD_LINES]):
        cells = line.split(delimiter_of(line))
        quantities = [quantity for quantity, _ in map(read_title, cells) if quantity]
        enough = len(quantities) >= 2 or (len(cells) == 2 and bool(quantities))
        motion = {*quantities} & {"time", *MOTION}
        if len(cells) >= 2 and enough and motion and not _numbers(cells):
            return n
    return None


def recognises_hand_table(lines: Sequence[str]) -> bool:
    """Return whether the first lines hold titles of time or motion in a known language."""
    return title_row(lines) is not None


def _numbers(cells):
    """Tell whether any cell reads as a number."""
    return any(re.fullmatch(r"\s*[-+]?\d[\d.,eE+-]*\s*", cell) for cell in cells)


def read_hand_table(path: Path, lines: list[str]) -> RawRecord:
    """Read a table of motion with titles such as ``Time (s);Long (mm/s);Tran (mm/s)``.

    Raises
    ------
    ReadError, InputError
        If the column of time, a component or a unit is missing, each by its name; if a component
        appears twice.
    """
    first = title_row(lines)
    assert first is not None  # as recognised
    delimiter = delimiter_of(lines[first])
    titles = [read_title(cell) for cell in split_line(path, first + 1, lines[first], delimiter)]
    titles, below = _units_below(path, first + 1, lines, delimiter, titles)
    where = f"{path}, line {first + 1}"
    columns = _columns(where, titles)
    rows = [
        (n + 1, split_line(path, n + 1, lines[n], delimiter))
        for n in range(below, len(lines))
        if lines[n].strip(delimiter + " ")
    ]
    values = read_columns(path, rows, columns)
    times = unit_factor(titles[columns["time"]].unit, where) * values.pop("time")
    pressure = values.pop("microphone", None)
    if pressure is not None:
        pressure = overpressure(pressure, titles[columns["microphone"]].unit, where)
    channels = {
        name: velocity_factor(titles[columns[name]].unit, f"{where}, column '{name}'") * column
        for name, column in values.items()
    }
    dt = uniform_step(path, times, [line for line, _ in rows])
    return RawRecord(
        channels, dt, float(times[0]), path.stem, "CSV", microphone=pressure,
        notes=_lacking(channels),
    )  # fmt: skip


def _units_below(path, first, lines, delimiter, titles):
    """Take units from the row below the titles where it holds units; return where samples begin."""
    if first >= len(lines):
        return titles, first
    cells = [cell.strip("[]() ") for cell in split_line(path, first + 1, lines[first], delimiter)]
    if not any(cells) or _numbers(cells) or len(cells) < len(titles):
        return titles, first
    return [
        title._replace(unit=title.unit or cell)
        for title, cell in zip(titles, cells, strict=False)
    ], first + 1  # fmt: skip


def _columns(where, titles):
    """Return the columns of time, components and microphone; refuse what is missing or doubled."""
    columns: dict[str, int] = {}
    for n, (quantity, _) in enumerate(titles):
        if quantity in columns:
            raise InputError(
                f"{where}: columns {columns[quantity] + 1} and {n + 1} are both {quantity}; "
                "remove one of them, or describe the table by a mapping"
            )
        if quantity in ("time", *MOTION, "microphone"):
            columns[quantity] = n
    if "time" not in columns:
        raise ReadError(
            f"{where}: the column of time is missing, such as 'Time (s)'; add it, or give the "
            "sampling rate by a mapping"
        )
    if not set(columns) & set(MOTION):
        raise ReadError(
            f"{where}: a column of motion is missing, such as 'Vert (mm/s)'; found only "
            f"{', '.join(columns)}"
        )
    lost = [name for name, n in columns.items() if not titles[n].unit]
    if lost:
        example = "'Time (s)'" if lost[0] == "time" else f"'{lost[0].capitalize()} (mm/s)'"
        raise ReadError(
            f"{where}: the unit of {', '.join(lost)} is missing; write it into the title: {example}"
        )
    return columns


def _lacking(channels):
    """Return a note on components that the table lacks."""
    axes = ("east", "north", "vertical")
    if {"longitudinal", "transverse"} & set(channels):
        axes = ("longitudinal", "transverse", "vertical")
    lacking = [name for name in axes if name not in channels]
    if not lacking:
        return ()
    words = "columns for" if len(lacking) > 1 else "a column for"
    return (f"{words} {' and '.join(lacking)} missing; taken as not recorded",)
