"""Text exports of blast seismographs, and tables of motion."""

import difflib
import re
from collections.abc import Callable, Mapping
from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..errors import InputError, ReadError
from ..readers.cells import (
    Cells,
    Wanted,
    is_number,
    number,
    read_columns,
    split_line,
    title_unit,
    unit_name,
    wanted_by,
)
from ..readers.provenance import ReadLog
from ..readers.tables import (
    NO_RULES,
    Rules,
    Table,
    column_of,
    head_of,
    load_mapping,
    rules_of,
    table_of,
)
from ..signals.seismogram import ZeroPhase
from ..units import split_key, to_si
from .raw import (
    Printed,
    RawRecord,
    common_velocity_factor,
    integrated_to_velocity,
    overpressure,
    quantity,
    sampling_step,
    uniform_step,
    velocity_factor,
)

COMPONENT_NAMES = {
    "tran": "transverse", "t": "transverse", "transverse": "transverse",
    "transversal": "transverse", "vert": "vertical", "v": "vertical", "vertical": "vertical",
    "z": "vertical", "long": "longitudinal", "l": "longitudinal", "radial": "longitudinal",
    "longitudinal": "longitudinal", "e": "east", "east": "east", "n": "north", "north": "north",
}  # fmt: skip
_MICROPHONES = ("micl", "mic", "mic1", "microphone")
_PRINTED = {
    "ppv": "PPV",
    "zcfreq": "zero-crossing frequency",
    "timeofpeak": "time of peak",
    "peakacceleration": "peak acceleration",
}
_DATES = (
    "%H:%M:%S %B %d, %Y", "%H:%M:%S %Y-%m-%d", "%H:%M:%S %d/%m/%Y", "%H:%M:%S %b %d, %Y",
)  # fmt: skip


LOW_PASSED = {
    float: "# sources low-passed (Bessel of order 4; without delay); -3 dB at Hz: ",
    ZeroPhase: "# sources low-passed (Butterworth of order 4; zero phase); -6 dB at Hz: ",
}


class TextFormat(NamedTuple):
    """Text format: a test of the first lines, and its reader."""

    recognises: Callable[[list[str]], bool]
    read: Callable[[Path, list[str], ReadLog], RawRecord]


_KEY = re.compile(r'[\s"]*([^":;,\t]+?)[\s"]*[:;,\t][\s":]*(.*?)[\s";,]*')  # of a header, and value


def read_instantel(path: Path, lines: list[str], log: ReadLog) -> RawRecord:
    """Read an export of Instantel: ``Key : Value`` or ``"Key","Value"``, then channels."""
    entry = log.file(path, "Instantel export")
    titles = next((n for n, line in enumerate(lines) if _is_channel_row(line)), len(lines) - 1)
    delimiter = next((mark for mark in ";," if mark in lines[titles]), " ")
    header: dict[str, str] = {}
    for match in filter(None, map(_KEY.fullmatch, lines[:titles])):
        key = " ".join(match[1].split())
        header[key] = "; ".join(filter(None, [header.get(key), match[2]]))
    keys = {re.sub(r"[\s_.-]", "", key).lower(): key for key in header}
    names = _channels(path, titles + 1, _title_cells(lines[titles]), _MICROPHONES)
    rows, below = _samples(path, lines, titles, delimiter, entry)
    said = [
        *filter(None, re.split(r"(?i)\s+and\b\s*|\s*[;,&]\s*", header.get(keys.get("units"), "")))
    ]

    def field(*spellings, unit="s"):
        key = next((keys[s] for s in spellings if s in keys), None)
        try:
            return None if key is None else quantity(header[key], f"{path}, '{key}'", unit)
        except ReadError:
            entry.remark(f"'{key}' is not read: {header[key][:40]!r}")
            return None

    unit, loud = (*(said or below or _printed_unit(header)), "", "")[:2]
    factor = velocity_factor(unit, f"{path}, '{keys.get('units', 'Units')}'")
    length = re.search(r"(?i)[\d.]+ *(sps|k?hz)", header.get(keys.get("recordtime"), ""))
    if length is not None:  # "2.0 sec at 1024 sps"
        header.setdefault("Sample Rate", length[0])
    rate = _required(path, header, keys.get("samplerate", "Sample Rate"), "sps").value
    dt = sampling_step(rate, f"{path}, 'Sample Rate'")
    columns = read_columns(path, rows, names, delimiter=delimiter)
    pressure = columns.pop("microphone", None)
    _log_columns(entry, {name: names[name] for name in columns}, unit, factor, len(rows))
    channels = {name: factor * values for name, values in columns.items()}
    loud, notes = _instantel_pressure(loud, pressure)
    for note in notes:
        entry.dropped("column of the microphone", note)
    printed = _printed(field, unit)
    before = header.get(keys.get("pretriggerlength", keys.get("pretrigger")), "")
    before = quantity(before, f"{path}, 'Pre-trigger Length'", "s") or Printed(0.0, 0.0)
    before = abs(before.value)
    length = field("recordtime")
    promised = [] if length is None else [length.value * rate, (length.value + before) * rate]
    if promised and not any(abs(len(rows) - count) <= 0.01 * count + 1.0 for count in promised):
        raise ReadError(
            f"{path}: '{keys['recordtime']}' promises {promised[-1]:.0f} samples, found {len(rows)}"
        )
    full_scale = field("georange", unit=unit)
    return RawRecord(
        channels, dt, -before if before else _start_from_peak(channels, dt, printed),
        header.get(keys.get("location", keys.get("titlestring1")), "") or path.stem,
        f"Instantel {header.get(keys.get('version'), '')}".strip(),
        header.get(keys.get("serialnumber"), ""), full_scale.value if full_scale else None,
        _time_stamp(header.get(keys.get("eventtime"), ""), header.get(keys.get("eventdate"), "")),
        header, printed, microphone=loud, notes=notes,
    )  # fmt: skip


def read_texcel(path: Path, lines: list[str], log: ReadLog) -> RawRecord:
    """Read a Texcel CSV: names, units, samples, and metadata beside the first rows."""
    table = [split_line(path, n, line) for n, line in enumerate(lines, 1)]
    titles = table[0][:8]
    names = _channels(path, 1, titles)
    header = {}
    for cells in table[:40]:
        for key, value in zip(cells[8:12:2], cells[9:12:2], strict=False):
            if key:
                header[key.rstrip(":")] = value
    if len(table) < 2 or len(table[1]) <= max(names.values()):
        raise ReadError(f"{path}, line 2: expected one unit for each of the channels")
    symbols = [table[1][column].strip("[]") for column in names.values()]
    factor = common_velocity_factor(symbols, f"{path}, line 2")
    entry = log.file(path, "Texcel export")
    rows, _ = _samples(path, lines, 1, ",", entry)
    columns = read_columns(path, rows, {"Sample Time": 0, **names})
    _log_columns(entry, names, symbols[0], factor, len(rows))
    times = columns.pop("Sample Time")
    rate = header.get("Frequency [Hz]")
    rate = number(rate, f"{path}, 'Frequency [Hz]'") if rate else None
    return RawRecord(
        {name: factor * values for name, values in columns.items()},
        uniform_step(path, times, [line for line, _ in rows], rate),
        start=float(times[0]), label=path.stem, instrument="Texcel",
        serial=header.get("Monitor", ""), header=header,
    )  # fmt: skip


def read_vibracord(path: Path, lines: list[str], log: ReadLog) -> RawRecord:
    """Read a Vibracord CSV: ``"Key","Value"`` rows, then time, channels and vector sum."""
    header, titles, cells = {}, 0, []
    for titles, line in enumerate(lines):
        cells = split_line(path, titles + 1, line)
        if len(cells) > 2 and cells[0] == "Time":
            break
        if len(cells) > 1:
            header[cells[0]] = cells[1]
    units = {}
    for column, title in enumerate(cells):
        match = re.fullmatch(r"(Channel [123]|Vector sum 1) \((.+)\)", title)
        if match:
            units[match[1]] = column, match[2]
    where = f"{path}, line {titles + 1}"
    order = {"Channel 1": "vertical", "Channel 2": "longitudinal", "Channel 3": "transverse"}
    wanted = {order.get(key, str(key)): column for key, (column, _) in units.items()}
    if "vertical" not in wanted:
        raise ReadError(f"{where}: expected columns such as 'Channel 1 (mm/s)', found none")
    factor = common_velocity_factor([symbol for _, symbol in units.values()], where)
    entry = log.file(path, "Vibracord export")
    rows, _ = _samples(path, lines, titles, ",", entry)
    columns = read_columns(path, rows, {"Time": 0, **wanted}, len(cells))
    _log_columns(entry, wanted, units["Channel 1"][1], factor, len(rows))
    times, sums = columns.pop("Time"), columns.pop("Vector sum 1", None)
    rate = _required(path, header, "Sampling rate", "sps").value
    before = quantity(header.get("Pretrigger", ""), f"{path}, 'Pretrigger'", "s")
    start = -abs(before.value) if before and times[0] >= 0.0 else float(times[0])
    printed = {} if sums is None else {"vector sum": Printed(factor * sums.max(), factor * 1e-3)}
    return RawRecord(
        {name: factor * values for name, values in columns.items()},
        uniform_step(path, times, [line for line, _ in rows], rate), start, path.stem,
        "Vibracord", header.get("Serial number", ""), None, header.get("Date & Time", ""),
        header, printed,
    )  # fmt: skip


TEXT_FORMATS = {
    "INSTANTEL_ASCII": TextFormat(
        lambda lines: any(
            re.match(r'[\s"]*(event type|serial number)\s*:', x, re.I) for x in lines[:10]
        ),
        read_instantel,
    ),
    "INSTANTEL_CSV": TextFormat(
        lambda lines: any(re.match(r'"?(Event ?Type|Sample ?Rate)"?[,;\t]', x) for x in lines[:20]),
        read_instantel,
    ),
    "TEXCEL": TextFormat(
        lambda lines: lines[0].replace('"', "").startswith("Sample Time,"), read_texcel
    ),
    "VIBRACORD": TextFormat(
        lambda lines: any(re.match(r'"?Time"?,"?Channel 1', x) for x in lines[:60]), read_vibracord
    ),
}


def _title_cells(line):
    """Return the titles of a line in lower case, without quotes and units."""
    cells = re.split(r"[\t;,]", line)
    return [
        re.sub(r"[\[(].*", "", cell).strip(' "').lower()
        for cell in (cells if len(cells) > 1 else line.split())
    ]


def _is_channel_row(line):
    """Return whether a line is the row of channels and not a header line."""
    names = [name in COMPONENT_NAMES or name in _MICROPHONES for name in _title_cells(line)]
    return ":" not in line and bool(names) and (sum(names) >= 2 or all(names))


def _samples(path, lines, titles, delimiter, entry):
    """Return the numbered rows of samples below the titles, and the units between, if any.

    Rows of words above and below the samples are none.
    """
    blank = f"{delimiter} \t"
    rows = [
        (n, split_line(path, n, line, delimiter))
        for n, line in enumerate(lines[titles + 1 :], titles + 2)
        if line.strip(blank)
    ]
    if any('"' in line for line in lines[titles + 1 :]):
        rows = [(n, [cell.strip('"') for cell in cells]) for n, cells in rows]
    units = []
    while rows and not any(map(is_number, rows[0][1])):
        units += filter(unit_name, (cell.strip("[]()") for cell in rows.pop(0)[1]))
    while rows and (
        re.match(r"[^\W\d]{4}", rows[-1][1][0]) or not any(map(is_number, rows[-1][1]))
    ):
        n, cells = rows.pop()
        entry.dropped(f"line {n} ({' '.join(cells)[:40]!r})", "it holds no samples")
    return rows, units


def _log_columns(entry, columns, unit, factor, rows):
    """Add the columns of an export to its entry of the log."""
    for name, column in columns.items():
        entry.column(name, f"column {column + 1}", unit, factor, rows=rows)


def _printed_unit(header):
    """Return the unit of the printed peaks of motion, as a list."""
    peaks = [value for key, value in header.items() if key.upper().endswith("PPV")]
    return [" ".join(value.split()[1:]) for value in peaks[:1]]


def _instantel_pressure(unit, samples):
    """Return the samples of the microphone in Pa, and a note where its unit is not known."""
    if samples is None:
        return None, ()
    if not unit:
        return None, ("the unit of the microphone is missing in 'Units'; its channel is left out",)
    try:
        return overpressure(samples, unit, "'Units'"), ()
    except ReadError as error:
        return None, (f"the channel of the microphone is left out: {error}",)


def _printed(field, unit):
    """Return the values printed by the instrument, by the names of the self-check."""
    units = {"ppv": unit, "zcfreq": "Hz", "timeofpeak": "s", "peakacceleration": "g"}
    printed = {
        f"{COMPONENT_NAMES[short]} {name}": field(short + key, unit=units[key])
        for short in ("tran", "vert", "long") for key, name in _PRINTED.items()
    }  # fmt: skip
    printed["vector sum"] = field("peakvectorsum", unit=unit)
    printed["time of vector sum"] = field("peakvectorsumtime")
    return {name: value for name, value in printed.items() if value is not None}


def _start_from_peak(channels, dt, printed):
    """Return the start time from the times of the peaks, if there is no pre-trigger."""
    for name in sorted(channels, key=lambda name: -np.max(np.abs(channels[name]))):
        peak = printed.get(f"{name} time of peak")
        if peak:
            return round(peak.value / dt) * dt - dt * int(np.argmax(np.abs(channels[name])))
    return 0.0


def refuse_histogram(path: Path, lines: list[str]) -> None:
    """Refuse the histogram export of a seismograph, which holds no waveform."""
    for number_, line in enumerate(lines[:60], 1):
        if re.search(r"event\s*type\W.*histogram", line, re.IGNORECASE):
            raise ReadError(
                f"{path}, line {number_}: is a histogram (peaks of intervals), no waveform; "
                "export the full waveform of the event"
            )


def _channels(path, line, titles, microphones=()):
    """Return the columns of the components, by the names that instruments use."""
    names = {}
    for column, title in enumerate(titles):
        plain = title.strip('"').lower()
        name = "microphone" if plain in microphones else COMPONENT_NAMES.get(plain)
        if name in names:
            raise ReadError(
                f"{path}, line {line}: columns {names[name] + 1} and {column + 1} are both "
                f"{name}; remove one of them, or describe the table by a mapping"
            )
        if name:
            names[name] = column
    if not set(names) - {"microphone"}:
        raise ReadError(
            f"{path}, line {line}: expected a row of channels such as Tran, Vert, "
            f"Long, got '{' '.join(titles)[:40]}'"
        )
    return names


def _required(path, header, key, unit):
    """Return a required quantity of the header."""
    value = quantity(header.get(key, ""), f"{path}, '{key}'", unit)
    if value is None:
        raise ReadError(f"{path}: expected '{key}' in the header, found none")
    return value


def _time_stamp(time, date):
    """Return time and date of the header in ISO form; empty if they can't be parsed."""
    for layout in _DATES:
        try:
            return datetime.strptime(f"{time} {date}", layout).isoformat()
        except ValueError:
            continue
    return ""


MOTION = ("longitudinal", "transverse", "vertical", "east", "north")
_MAPPING = {
    "delimiter": str, "decimal": str, "header_rows": int, "unit": str, "columns": dict,
    "time_column": (int, str), "time_unit": str, "sampling_rate": float, "pretrigger": float,
    "full_scale": float, "instrument": str, "serial": str, "label": str,
}  # fmt: skip
_KNOWN_KEYS = (
    *(key for key, kind in _MAPPING.items() if kind is not float),
    "sampling_rate_hz", "pretrigger_s", "full_scale_mm_per_s",
)  # fmt: skip


def recognises_motion(lines: list[str]) -> bool:
    """Return whether the first lines hold titles of time or motion in a known language."""
    head = head_of(Cells("", lines), wanted_by("motion"))
    titles = () if head is None else head.titles
    return bool({wanted_by("motion").title(title).quantity for title in titles} & {"time", *MOTION})


def read_motion(
    path: Path, cells: Cells, mapping: str | Path | None = None, log: ReadLog | None = None,
    unit: str | None = None,
) -> RawRecord:  # fmt: skip
    """Read a table of motion, such as ``Time (s);Long (mm/s);Tran (mm/s)``.

    Parameters
    ----------
    path : Path
    cells : Cells
    mapping : str or Path, optional
        TOML file: columns and units that titles don't say, delimiter, decimal mark, sampling.
    log : ReadLog, optional
        Takes what was read.
    unit : str, optional
        Of columns of motion whose titles and header say none.

    Raises
    ------
    ReadError, InputError
        If ``unit`` is given and titles say theirs; if the column of time, a component or a unit is
        missing, each by its name; if a component appears twice, or a column of velocity has a title
        that is none of a component.
    """
    wanted = wanted_by("motion")
    rules, own = (NO_RULES, {}) if mapping is None else _load_mapping(Path(mapping), wanted)
    head = head_of(cells, wanted, rules)
    if head is None:
        raise ReadError(f"{path}: expected titles such as 'Time (s)', 'Vert (mm/s)', found none")
    said = _stated(cells.lines[: head.line - 1])
    stated = _with_unit(head, wanted, said.get("unit", ""))
    head = _with_unit(stated, wanted, unit or "")
    if unit is not None and (head.units == stated.units or rules.columns):
        raise InputError(f"{path}: the table says its units; leave out unit = {unit!r}")
    accelerating = mapping is None and _accelerates(head, wanted)
    if accelerating:
        wanted = Wanted(wanted.quantities | {
            name: wanted.quantities[name]._replace(units=ACCELERATIONS) for name in MOTION
        })  # fmt: skip
    table = table_of(cells, head, wanted, rules, log, "table of motion")
    if "time" not in table.values:
        own = _stated_sampling(path, said) | own
    _check_motion(path, table, head, own)
    values = table.values
    channels = {name: values[name] for name in MOTION if name in values}
    rate, start, notes = (
        own.get("sampling_rate"),
        -abs(own.get("pretrigger", 0.0)),
        list(table.notes),
    )
    if "time" in values:
        digit = table.digits["time"]
        dt = uniform_step(path, values["time"], table.lines, rate, digit)
        start = start if "pretrigger" in own else float(values["time"][0])
        if digit > 0.5 * dt:
            notes.append(
                f"times are rounded to {digit:g} s; taken as {1.0 / dt:.6g} samples a second"
            )
    else:
        dt = sampling_step(own["sampling_rate"], f"{mapping or path}, sampling_rate_hz")
    for name in channels if accelerating else ():
        channels[name], note = integrated_to_velocity(channels[name], dt)
        notes.append(f"{name} was {note}")
    pressure = values.get("microphone")
    if pressure is not None:
        pressure = overpressure(pressure, table.units["microphone"], str(path))
    return RawRecord(
        channels, dt, start, own.get("label", path.stem),
        own.get("instrument", "mapped CSV" if mapping else "CSV"), own.get("serial", ""),
        own.get("full_scale"), time=table.instant, microphone=pressure,
        header={"mapping": str(mapping)} if mapping else {},
        notes=(*notes, *_axes_notes(table, channels)), low_passed=_low_passed(cells.lines),
    )  # fmt: skip


ACCELERATIONS = ("g", "m_per_s2", "cm_per_s2", "mm_per_s2")


def _stated(lines):
    """Return what lines above the titles of a table say of it: quantity and text, with its unit."""
    said = {}
    for line in lines:
        key, *rest = re.split(r"[:=;,\t]", re.sub(r'["#%]', "", line), maxsplit=1)
        text = re.sub(r"[;\t]", " ", "".join(rest)).strip(" ,")
        title = wanted_by("stated").title(key)
        if title.quantity and text:
            said.setdefault(title.quantity, f"{text} {title.unit}".strip())
    return said


def _with_unit(head, wanted, stated):
    """Return a head whose columns of motion without a unit have the one stated above them."""
    unit = re.split(r"(?i)\s+and\b|[;,&]", stated)[0].strip()
    below = [*head.units, *[""] * (len(head.titles) - len(head.units))]
    known = (wanted.title(title) for title in head.titles)
    units = [own or (unit if title.quantity in MOTION and not title.unit else "")
             for own, title in zip(below, known, strict=True)]  # fmt: skip
    return head._replace(units=units if unit_name(unit) else below)


def _accelerates(head, wanted):
    """Tell whether the columns of motion are accelerations, none a velocity."""
    titles = [(wanted.title(t), unit) for t, unit in zip(head.titles, head.units, strict=True)]
    units = {unit_name(t.unit or unit) for t, unit in titles if t.quantity in MOTION}
    return bool(units & {*ACCELERATIONS}) and not any(u.endswith("_per_s") for u in units)


def _stated_sampling(path, said):
    """Return sampling rate and pre-trigger in SI that are stated above the titles."""
    units = {"sampling_rate": "hz", "interval": "s", "pretrigger": "s"}
    texts = {name: quantity(said[name], f"{path}, {name}", unit)
             for name, unit in units.items() if name in said}  # fmt: skip
    own = {name: value.value for name, value in texts.items() if value is not None}
    if interval := own.pop("interval", 0.0):
        own.setdefault("sampling_rate", 1.0 / interval)
    return own


def _low_passed(lines):
    """Return the corner in Hz that a curve of a run names at its end, None without one."""
    last = next((line.strip() for line in reversed(lines) if line.strip()), "")
    for kind, words in LOW_PASSED.items():
        if named := re.fullmatch(rf"{re.escape(words)}([0-9.e+-]+)", last):
            return kind(named[1])
    return None


def _check_motion(path, table: Table, head, own):
    """Refuse a table without time or motion, with gaps, or with velocities that nothing names."""
    if "time" not in table.values and "sampling_rate" not in own:
        raise ReadError(
            f"{path}, line {head.line}: the column of time is missing, such as 'Time (s)'; add it, "
            "or give sampling_rate_hz by a mapping"
        )
    if not set(table.values) & set(MOTION):
        raise ReadError(
            f"{path}, line {head.line}: a column of motion is missing, such as 'Vert (mm/s)'; "
            f"found only {', '.join(table.values)}"
        )
    if len(table.lines) < 2:
        raise ReadError(f"{path}: expected at least two rows of samples, found {len(table.lines)}")
    below = dict(enumerate(head.units))
    others = [
        text
        for n, text in table.unread.items()
        if (title_unit(text) or unit_name(below.get(n, ""))).endswith("_per_s")
    ]
    if others:
        raise ReadError(
            f"{path}, line {head.line}: {', '.join(others)[:120]} are velocities, too, and their "
            "titles name no component; name the columns of one sensor by a mapping"
        )
    for name in ("time", *MOTION):
        lost = np.flatnonzero(np.isnan(table.values.get(name, np.zeros(1))))
        if len(lost):
            raise ReadError(f"{path}, line {table.lines[lost[0]]}, column '{name}': is missing")


def _axes_notes(table, channels):
    """Return notes on components that the table lacks, and on axes named x, y and z."""
    axes = ("east", "north", "vertical")
    if {"longitudinal", "transverse"} & set(channels):
        axes = ("longitudinal", "transverse", "vertical")
    lacking = [name for name in axes if name not in channels]
    notes = []
    if lacking:
        words = "columns for" if len(lacking) > 1 else "a column for"
        notes.append(f"{words} {' and '.join(lacking)} missing; taken as not recorded")
    titles = [c.source for c in table.entry.columns if c.quantity in ("east", "north")]
    if any(re.search(r"(?i)'v?_?[xy]\b", title) for title in titles):
        notes.append("x, y and z are taken as east, north and up; say otherwise by a mapping")
    return notes


def _load_mapping(path, wanted):
    """Read a mapping file of a record; return its rules, and the other quantities in SI."""
    own = {}
    for key, value in load_mapping(path).items():
        stem = split_key(key)[0] if key not in _MAPPING else key
        if stem not in _MAPPING or (key == stem and _MAPPING[stem] is float):
            near = difflib.get_close_matches(key, _KNOWN_KEYS)
            hint = f", did you mean {near[0]}" if near else ""
            raise InputError(f"{path}: unknown key '{key}'{hint}")
        kind = (int, float) if _MAPPING[stem] is float else _MAPPING[stem]
        if not isinstance(value, kind) or isinstance(value, bool):
            raise InputError(f"{path}: {key} has the wrong type, got {value!r}"[:200])
        own[stem] = to_si(key, value)[1] if _MAPPING[stem] is float else value
    rows = own.get("header_rows", 1)
    if rows < 0:
        raise InputError(f"{path}: header_rows must not be negative, got {rows}")
    columns = {}
    for key, column in own.get("columns", {}).items():
        stem, unit = split_key(key)
        name = COMPONENT_NAMES.get(stem.lower(), stem)
        if name not in (*MOTION, "time", "microphone"):
            raise InputError(f"{path}: columns.{key} must be a component such as transverse")
        columns[name] = column, unit or own.get("time_unit" if name == "time" else "unit", "")
    if "time_column" in own:
        columns["time"] = own["time_column"], own.get("time_unit", "s")
    table = {key: own[key] for key in ("delimiter", "decimal") if key in own}
    if "header_rows" in own:
        table |= {"header": rows > 0, "skip_lines": max(rows - 1, 0)}
    try:
        for name, (column, unit) in columns.items():
            units, known = wanted.quantities[name].units, unit_name(unit)
            if unit and units != ("*",) and known not in units:
                raise ReadError(f"{unit!r} is no unit of {name} that is known")
            columns[name] = column_of(name, column), known if units != ("*",) else unit
        return Rules(columns, rules_of({"table": table}, wanted).options if table else {}), own
    except ReadError as error:
        raise InputError(f"{path}: {error}") from None


HEADERS = {  # names of these in the headers of recorders
    "calibration_date": ("calibration", "calibrated", "date of calibration", "calibration date"),
    "location": ("location", "location:", "titlestring1", "monitor location"),
    "operator": ("operator", "user name", "user name:"),
}


def instrument_table(recording: Any, given: Mapping[str, str | None]) -> dict:
    """Return serial number, calibration, location, operator and time of a record.

    Parameters
    ----------
    recording : Recording
    given : mapping of str to str or None
        Keys such as "serial_number", which go before the header; None where neither has a value.
    """
    header = {
        str(key).strip().lower(): str(value).strip() for key, value in recording.header.items()
    }
    table = {"instrument": recording.instrument or None, "time": recording.time or None}
    table["serial_number"] = given.get("serial_number") or recording.serial or None
    table |= {"overpressure": recording.peak_overpressure, "db": recording.peak_overpressure_db}
    for key, names in HEADERS.items():
        written = next((header[name] for name in names if header.get(name, "?") != "?"), None)
        table[key] = given.get(key) or written or None
    return table
