"""Recordings in plain tables: the generic CSV, and any table that a mapping file describes."""

import difflib
import re
import tomllib
from pathlib import Path

from ..errors import InputError
from ..units import FACTORS, split_key, to_si
from .raw_record import (
    RawRecord,
    decode_lines,
    read_bytes,
    read_columns,
    sampling_step,
    split_line,
    uniform_step,
    unit_factor,
    velocity_factor,
)
from .seismograph_formats import COMPONENT_NAMES

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
    """Tell whether the first line that is no comment starts with ``time_`` and a unit."""
    first = next((line for line in lines if not line.startswith("#")), "")
    return re.match(r'\s*"?time_(s|ms)"?\s*[,;\t]', first) is not None


def read_generic(path: Path, lines: list[str]) -> RawRecord:
    """Read ``time_s,east_m_per_s,...``: any subset of components, any velocity unit."""
    first = next(n for n, line in enumerate(lines) if not line.startswith("#"))
    delimiter = max(",;\t", key=lines[first].count)
    titles = split_line(path, first + 1, lines[first], delimiter)
    place = f"{path}, line {first + 1}"
    columns, factors = {}, {}
    for column, title in enumerate(titles):
        stem, suffix = split_key(title.strip())
        name = "time" if stem == "time" else COMPONENT_NAMES.get(stem.lower())
        if name is None or name in columns:
            raise InputError(
                f"{place}: column '{title[:40]}' must be time or one component, "
                "once, such as east_mm_per_s"
            )
        columns[name] = column
        factors[name] = FACTORS[suffix] if name == "time" else velocity_factor(suffix, place)
    rows = [
        (n + 1, split_line(path, n + 1, lines[n], delimiter)) for n in range(first + 1, len(lines))
    ]
    values = read_columns(path, rows, columns, len(titles))
    times = factors["time"] * values.pop("time")
    dt = uniform_step(path, times, [line for line, _ in rows])
    channels = {name: factors[name] * column for name, column in values.items()}
    if not channels:
        raise InputError(f"{place}: expected at least one component such as vertical_m_per_s")
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
    place = f"{mapping}"
    wanted = {
        COMPONENT_NAMES[key]: _column_index(place, key, column, titles)
        for key, column in rules["columns"].items()
    }
    if "time_column" in rules:
        wanted["time"] = _column_index(place, "time_column", rules["time_column"], titles)
    values = read_columns(path, rows, wanted)
    rate, start = rules.get("sampling_rate"), -abs(rules.get("pretrigger", 0.0))
    if "time" in wanted:
        times = unit_factor(rules.get("time_unit", "s"), f"{place}, time_unit") * values.pop("time")
        dt = uniform_step(path, times, [line for line, _ in rows], rate)
        start = start if "pretrigger" in rules else float(times[0])
    else:
        dt = sampling_step(rate, f"{place}, sampling_rate_hz")
    factor = velocity_factor(rules["unit"], f"{place}, unit")
    return RawRecord(
        {name: factor * column for name, column in values.items()}, dt, start,
        rules.get("label", path.stem), rules.get("instrument", "mapped CSV"),
        rules.get("serial", ""), rules.get("full_scale"), header={"mapping": str(mapping)},
    )  # fmt: skip


def _load_mapping(path):
    """Read the mapping strictly; keys with a unit suffix become SI."""
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
    """Refuse a mapping that leaves something open."""
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


def _column_index(place, key, column, titles):
    """Turn a column given by title or by number from 1 into an index from 0."""
    if isinstance(column, str):
        if column not in titles:
            raise InputError(
                f"{place}: {key} names column '{column}', the table has {', '.join(titles)[:120]}"
            )
        return titles.index(column)
    if isinstance(column, bool) or not isinstance(column, int) or not 1 <= column <= 1000:
        raise InputError(f"{place}: {key} must be a title or a column from 1, got {column!r}")
    return column - 1


def _refuse_commas(path, rows):
    """Refuse decimal commas where the mapping promises decimal points."""
    for line, cells in rows:
        if any("," in cell for cell in cells):
            raise InputError(
                f"{path}, line {line}: found a decimal comma, the mapping says decimal = '.'"
            )
