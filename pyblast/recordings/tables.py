"""Text exports of blast seismographs and plain CSV tables of motion."""

import difflib
import re
import tomllib
from collections.abc import Callable, Mapping
from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..errors import InputError, ReadError
from ..units import FACTORS, split_key, to_si
from .raw import (
    Printed,
    RawRecord,
    common_velocity_factor,
    decode_lines,
    number,
    overpressure,
    quantity,
    read_bytes,
    read_columns,
    sampling_step,
    split_line,
    uniform_step,
    unit_factor,
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


class TextFormat(NamedTuple):
    """Text format: a test of the first lines, and its reader."""

    recognises: Callable[[list[str]], bool]
    read: Callable[[Path, list[str]], RawRecord]


def read_instantel_ascii(path: Path, lines: list[str]) -> RawRecord:
    """Read the ASCII export of an Instantel Micromate or Minimate (quoted ``Key : Value``)."""
    titles = next((n for n, line in enumerate(lines) if _is_channel_row(line)), len(lines) - 1)
    header = {}
    for line in lines[:titles]:
        key, separator, value = line.strip().strip('"').partition(" :")
        if separator:
            header.setdefault(" ".join(key.split()).rstrip(":"), value.strip())
    names = _channels(path, titles + 1, lines[titles].split(), _MICROPHONES)
    rows = [(n + 1, lines[n].split()) for n in range(titles + 1, len(lines))]
    return _instantel(path, header, names, rows)


def read_instantel_csv(path: Path, lines: list[str]) -> RawRecord:
    """Read the CSV export of Instantel THOR (``"Key","Value"`` rows, then a row of channels)."""
    delimiter = _delimiter(lines[0])
    header, titles, cells = {}, 0, []
    for titles, line in enumerate(lines):
        cells = split_line(path, titles + 1, line, delimiter)
        if sum(cell.lower() in COMPONENT_NAMES for cell in cells) >= 2:
            break
        if cells and cells[0]:
            value = (cells[1:] or [""])[0]
            header[cells[0]] = "; ".join(filter(None, [header.get(cells[0]), value]))
    names = _channels(path, titles + 1, cells, _MICROPHONES)
    rows = [
        (n + 1, split_line(path, n + 1, lines[n], delimiter)) for n in range(titles + 1, len(lines))
    ]
    return _instantel(path, header, names, rows)


def read_texcel(path: Path, lines: list[str]) -> RawRecord:
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
    columns = read_columns(path, list(enumerate(table[2:], 3)), {"Sample Time": 0, **names})
    times = columns.pop("Sample Time")
    rate = header.get("Frequency [Hz]")
    rate = number(rate, f"{path}, 'Frequency [Hz]'") if rate else None
    return RawRecord(
        {name: factor * values for name, values in columns.items()},
        uniform_step(path, times, list(range(3, len(table) + 1)), rate),
        start=float(times[0]), label=path.stem, instrument="Texcel",
        serial=header.get("Monitor", ""), header=header,
    )  # fmt: skip


def read_vibracord(path: Path, lines: list[str]) -> RawRecord:
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
    rows = [(n + 1, split_line(path, n + 1, lines[n])) for n in range(titles + 1, len(lines))]
    columns = read_columns(path, rows, {"Time": 0, **wanted}, len(cells))
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
        lambda lines: any(re.match(r'\s*"?(Event Type|Serial Number) :', x) for x in lines[:10]),
        read_instantel_ascii,
    ),
    "INSTANTEL_CSV": TextFormat(
        lambda lines: any(re.match(r'"?(EventType|SampleRate)"?[,;\t]', x) for x in lines[:20]),
        read_instantel_csv,
    ),
    "TEXCEL": TextFormat(
        lambda lines: lines[0].replace('"', "").startswith("Sample Time,"), read_texcel
    ),
    "VIBRACORD": TextFormat(
        lambda lines: any(re.match(r'"?Time"?,"?Channel 1', x) for x in lines[:60]), read_vibracord
    ),
}


def _is_channel_row(line):
    """Return whether a line is the row of channels and not a header line."""
    return bool(line.strip()) and " :" not in line and not line.lstrip().startswith('"')


def _instantel(path, header, names, rows):
    """Return the raw record of either Instantel layout."""
    keys = {key.replace(" ", "").lower(): key for key in header}
    unit = header.get(keys.get("units"), "").split(" and")[0].split(";")[0].strip() or "mm/s"
    factor = velocity_factor(unit, f"{path}, '{keys.get('units', 'Units')}'")
    rate = _required(path, header, keys.get("samplerate", "Sample Rate"), "sps").value
    dt = sampling_step(rate, f"{path}, '{keys['samplerate']}'")
    columns = read_columns(path, rows, names)
    pressure = columns.pop("microphone", None)
    channels = {name: factor * values for name, values in columns.items()}
    loud, notes = _instantel_pressure(path, header.get(keys.get("units"), ""), pressure)

    def field(*spellings, unit="s"):
        key = next((keys[s] for s in spellings if s in keys), None)
        if key is None or ":" in header[key]:
            return None
        return quantity(header[key], f"{path}, '{key}'", unit)

    printed = _printed(field, unit)
    before = field("pre-triggerlength", "pretriggerlength", "pretrigger")
    length = field("recordtime")
    expected = (length.value + abs(before.value if before else 0.0)) * rate if length else len(rows)
    if abs(len(rows) - expected) > 0.01 * expected + 1.0:
        raise ReadError(
            f"{path}: '{keys['recordtime']}' promises {expected:.0f} samples, found {len(rows)}"
        )
    start = -abs(before.value) if before else _start_from_peak(channels, dt, printed)
    full_scale = field("georange", unit=unit)
    version = header.get(keys.get("version"), "")
    return RawRecord(
        channels, dt, start,
        header.get(keys.get("location", keys.get("titlestring1")), "") or path.stem,
        f"Instantel {version}".strip(), header.get(keys.get("serialnumber"), ""),
        full_scale.value if full_scale else None,
        _time_stamp(header.get(keys.get("eventtime"), ""), header.get(keys.get("eventdate"), "")),
        header, printed, microphone=loud, notes=notes,
    )  # fmt: skip


def _instantel_pressure(path, units, samples):
    """Return the samples of the microphone in Pa, and a note where its unit is not given."""
    unit = next(iter(re.split(r" and |;", units)[1:]), "").strip()
    if samples is None or not unit:
        note = "the unit of the microphone is missing in 'Units'; its channel is left out"
        return None, () if samples is None else (note,)
    return overpressure(samples, unit, f"{path}, 'Units'"), ()


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


def _delimiter(line):
    """Return the delimiter of the first line of an export: comma, semicolon or tab."""
    outside = re.sub(r'"[^"]*"', "", line)
    return max(",;\t", key=outside.count)


def _time_stamp(time, date):
    """Return time and date of the header in ISO form; empty if they can't be parsed."""
    for layout in _DATES:
        try:
            return datetime.strptime(f"{time} {date}", layout).isoformat()
        except ValueError:
            continue
    return ""


_MAPPING = {
    "delimiter": str, "decimal": str, "header_rows": int, "unit": str, "columns": dict,
    "time_column": (int, str), "time_unit": str, "sampling_rate": float, "pretrigger": float,
    "full_scale": float, "instrument": str, "serial": str, "label": str,
}  # fmt: skip
_KNOWN_KEYS = (
    *(key for key, kind in _MAPPING.items() if kind is not float),
    "sampling_rate_hz", "pretrigger_s", "full_scale_mm_per_s",
)  # fmt: skip
_DELIMITERS = (",", ";", "\t", " ", "|")
_MAX_MAPPING_BYTES = 100_000


def recognises_generic(lines: list[str]) -> bool:
    """Return whether the first line after comments starts with ``time_`` and a unit."""
    first = next((line for line in lines if not line.startswith("#")), "")
    return re.match(r'\s*"?time_(s|ms)"?\s*[,;\t]', first) is not None


def read_generic(path: Path, lines: list[str]) -> RawRecord:
    """Read ``time_s,east_m_per_s,...``: any subset of components, any velocity unit."""
    first = next(n for n, line in enumerate(lines) if not line.startswith("#"))
    delimiter = max(",;\t", key=lines[first].count)
    titles = split_line(path, first + 1, lines[first], delimiter)
    where = f"{path}, line {first + 1}"
    columns, factors = {}, {}
    for column, title in enumerate(titles):
        stem, suffix = split_key(title.strip())
        name = "time" if stem == "time" else COMPONENT_NAMES.get(stem.lower(), "")
        if not name or name in columns:
            raise InputError(
                f"{where}: column '{title[:40]}' must be time or one component, "
                "once, such as east_mm_per_s"
            )
        columns[name] = column
        factors[name] = FACTORS[suffix] if name == "time" else velocity_factor(suffix, where)
    rows = [
        (n + 1, split_line(path, n + 1, lines[n], delimiter)) for n in range(first + 1, len(lines))
    ]
    values = read_columns(path, rows, columns, len(titles))
    times = factors["time"] * values.pop("time")
    dt = uniform_step(path, times, [line for line, _ in rows])
    channels = {name: factors[name] * column for name, column in values.items()}
    if not channels:
        raise InputError(f"{where}: expected at least one component such as vertical_m_per_s")
    return RawRecord(channels, dt, float(times[0]), path.stem, "CSV")


def read_mapped(path: Path, lines: list[str], mapping: str | Path) -> RawRecord:
    """Read a table by a mapping file: delimiter, decimal mark, columns, unit, sampling."""
    rules = _load_mapping(Path(mapping))
    delimiter, skipped = rules.get("delimiter", ","), rules.get("header_rows", 1)
    rows = [
        (n + 1, split_line(path, n + 1, lines[n], delimiter)) for n in range(skipped, len(lines))
    ]
    if rules.get("decimal", ".") == ".":
        _refuse_commas(path, rows)
    titles = (
        split_line(path, skipped, lines[skipped - 1], delimiter)
        if 0 < skipped <= len(lines)
        else []
    )
    where = f"{mapping}"
    wanted = {
        COMPONENT_NAMES[key]: _column_index(where, key, column, titles)
        for key, column in rules["columns"].items()
    }
    if "time_column" in rules:
        wanted["time"] = _column_index(where, "time_column", rules["time_column"], titles)
    values = read_columns(path, rows, wanted)
    rate, start = rules.get("sampling_rate"), -abs(rules.get("pretrigger", 0.0))
    if "time" in wanted:
        times = unit_factor(rules.get("time_unit", "s"), f"{where}, time_unit") * values.pop("time")
        dt = uniform_step(path, times, [line for line, _ in rows], rate)
        start = start if "pretrigger" in rules else float(times[0])
    else:
        dt = sampling_step(rules["sampling_rate"], f"{where}, sampling_rate_hz")
    factor = velocity_factor(rules["unit"], f"{where}, unit")
    return RawRecord(
        {name: factor * column for name, column in values.items()}, dt, start,
        rules.get("label", path.stem), rules.get("instrument", "mapped CSV"),
        rules.get("serial", ""), rules.get("full_scale"), header={"mapping": str(mapping)},
    )  # fmt: skip


def _load_mapping(path):
    """Read a mapping file; unknown keys are refused, quantities become SI."""
    text = "\n".join(decode_lines(path, read_bytes(path, _MAX_MAPPING_BYTES)))
    try:
        table = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise InputError(f"{path}: expected TOML ({error})") from None
    rules = {}
    for key, value in table.items():
        stem = split_key(key)[0] if key not in _MAPPING else key
        if stem not in _MAPPING or (key == stem and _MAPPING[stem] is float):
            near = difflib.get_close_matches(key, _KNOWN_KEYS)
            hint = f", did you mean {near[0]}" if near else ""
            raise InputError(f"{path}: unknown key '{key}'{hint}")
        kind = (int, float) if _MAPPING[stem] is float else _MAPPING[stem]
        if not isinstance(value, kind) or isinstance(value, bool):
            raise InputError(f"{path}: {key} has the wrong type, got {value!r}"[:200])
        rules[stem] = to_si(key, value)[1] if _MAPPING[stem] is float else value
    _check_mapping(path, rules)
    return rules


def _check_mapping(path, rules):
    """Raise InputError for an incomplete or inconsistent mapping."""
    missing = [key for key in ("columns", "unit") if not rules.get(key)]
    if missing:
        raise InputError(f"{path}: expected '{missing[0]}', found none")
    if "time_column" not in rules and "sampling_rate" not in rules:
        raise InputError(f"{path}: expected 'sampling_rate_hz' or 'time_column', found neither")
    if rules.get("delimiter", ",") not in _DELIMITERS:
        raise InputError(
            f"{path}: delimiter must be one of {_DELIMITERS}, got {rules['delimiter']!r}"
        )
    if rules.get("decimal", ".") not in (".", ","):
        raise InputError(f"{path}: decimal must be '.' or ',', got {rules['decimal']!r}")
    if rules.get("header_rows", 1) < 0:
        raise InputError(f"{path}: header_rows must not be negative, got {rules['header_rows']}")
    for key in rules["columns"]:
        if key not in COMPONENT_NAMES:
            raise InputError(f"{path}: columns.{key} must be a component such as transverse")


def _column_index(where, key, column, titles):
    """Return the index from 0 of a column given by title or by number from 1."""
    if isinstance(column, str):
        if column not in titles:
            raise InputError(
                f"{where}: {key} names column '{column}', the table has {', '.join(titles)[:120]}"
            )
        return titles.index(column)
    if isinstance(column, bool) or not isinstance(column, int) or not 1 <= column <= 1000:
        raise InputError(f"{where}: {key} must be a title or a column from 1, got {column!r}")
    return column - 1


def _refuse_commas(path, rows):
    """Raise InputError for decimal commas if the mapping says decimal points."""
    for line, cells in rows:
        if any("," in cell for cell in cells):
            raise InputError(
                f"{path}, line {line}: found a decimal comma, the mapping says decimal = '.'"
            )


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
