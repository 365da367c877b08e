"""Tables: columns by title or mapping, in SI, and what of a table is no row."""

import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import date
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..errors import InputError, ReadError
from ..units import FACTORS, split_key, to_si
from .cells import (
    ABSENT,
    DELIMITERS,
    LONGEST_LINE,
    Cell,
    Cells,
    NumberFormat,
    cells_of,
    decode_lines,
    is_number,
    number,
    number_format,
    numbers_of,
    read_bytes,
)
from .provenance import FileRead, ReadLog
from .titles import (
    PART,
    PLAIN,
    SAYS,
    TOTALS,
    Wanted,
    is_pressure,
    plain_word,
    title_unit,
    unit_name,
)

HEAD_LINES = 60  # of a file, among which the row of titles is looked for
SAME = 5e-3  # relative difference of two columns that hold the same quantity in other digits
_CLOCK = re.compile(r"(?:(\d{4}-\d\d-\d\d)[T ])?(\d{1,2}):(\d\d):(\d\d(?:[.,]\d*)?)Z?")


@dataclass
class Table:
    """Table that was read, by quantity: numbers (n_rows,) in SI, NaN where absent, or texts.

    ``units`` are as written, ``lines`` the numbers of the rows, ``notes`` choices and losses in
    sentences, ``digits`` the steps of the last printed digits in SI, ``instant`` the first time of
    day, ``unread`` the titles of other columns by their number from 0.
    """

    where: str
    values: dict[str, Any]
    units: dict[str, str]
    lines: list[int]
    notes: list[str]
    entry: FileRead
    digits: dict[str, float] = field(default_factory=dict)
    instant: str = ""
    unread: dict[int, str] = field(default_factory=dict)


OPTIONS = {"delimiter": DELIMITERS, "decimal": (".", ","), "header": (True, False),
           "skip_lines": (int,)}  # fmt: skip


class Rules(NamedTuple):
    """Rules of a mapping: column and unit by quantity, options, whether others are recognised."""

    columns: Mapping[str, tuple[int | str, str]] = {}
    options: Mapping[str, Any] = {}
    rest: bool = True


NO_RULES = Rules()


def load_mapping(path: Path | str) -> dict:
    """Read a mapping file; raise InputError if it is no TOML."""
    text = "\n".join(decode_lines(path, read_bytes(Path(path), LONGEST_LINE)))
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"mapping {path}: expected TOML ({error})") from None


def rules_of(mapping: Mapping | None, wanted: Wanted, further: Mapping = {}) -> Rules:
    """Check a mapping: quantities with units in [columns], options in [table] and ``further``."""
    if mapping is None:
        return Rules()
    columns, options = mapping.get("columns", {}), mapping.get("table", {})
    known = {**OPTIONS, **further}
    if not (isinstance(columns, dict) and isinstance(options, dict) and (columns or options)):
        raise ReadError("mapping: needs a table [columns] or [table]")
    if unexpected := (set(mapping) - {"columns", "table"}) | (set(options) - set(known)):
        raise ReadError(f"mapping: unknown {min(unexpected)}; [table] takes {', '.join(known)}")
    rules = {}
    for key, column in columns.items():
        stem, unit = (key, "") if key in wanted.quantities else split_key(key)
        units = wanted.quantities[stem].units if stem in wanted.quantities else ()
        if stem not in wanted.quantities or (units and units != ("*",) and unit not in units):
            listed = ", ".join(f"{n} ({'/'.join(q.units)})" for n, q in wanted.quantities.items())
            raise ReadError(
                f"mapping: columns.{key} is no quantity with its unit; known are {listed}"[:400]
            )
        rules[stem] = (_column_of(key, column), unit)
    for name, value in options.items():
        if value not in known[name] and type(value) is not known[name][0]:
            raise ReadError(f"mapping: table.{name} can't be {value!r}")
    return Rules(rules, options)


def _column_of(key, column):
    """Check the column of a mapping: a title, or a number from 1."""
    if isinstance(column, bool) or not isinstance(column, (int, str)) or column == 0:
        raise ReadError(
            f"mapping: columns.{key} must be a title or a number from 1, got {column!r}"
        )
    return column


class Source(NamedTuple):
    """Column that a quantity is read from: index from 0, title, unit, and why."""

    index: int
    title: str
    unit: str
    why: str = ""
    rank: int = PLAIN

    @property
    def name(self) -> str:
        """Number from 1 and title, for messages."""
        return f"column {self.index + 1} {self.title!r}".removesuffix(" ''")


class Head(NamedTuple):
    """Rows of a table, its titles, the units below them, and where the data begin."""

    rows: list[tuple[int, list[str]]]
    line: int
    titles: list[str]
    units: list[str]
    first: int
    delimiter: str


def find_titles(
    cells: Cells, wanted: Wanted, rules: Rules = NO_RULES, least: int = 2
) -> Head | None:
    """Return the head of a table, None where no row holds ``least`` titles.

    It is the row among the first with the most titles of different quantities, by the delimiter
    that gives most; titles over merged cells in the row above count in front of those below.
    """
    best, chosen = 0, None
    for delimiter in _delimiters(cells, rules):
        rows = _rows(cells, delimiter, rules, HEAD_LINES + rules.options.get("skip_lines", 0))
        for k, (_, row) in enumerate(rows[: 1 if rules.options.get("header") else HEAD_LINES]):
            if delimiter == " " and any(mark in cell for cell in row for mark in ";|,"):
                continue
            for titles in (row, _joined(rows[k - 1][1] if k else [], row)):
                score = _score(titles, wanted, rules)
                if score > best and (score >= least or len(titles) == 2):
                    best, chosen = score, (delimiter, k, titles)
    if rules.options.get("header") is False:
        return None
    if chosen is None and rules.columns:  # a mapping says what its titles don't
        heads = [(d, _rows(cells, d, rules, HEAD_LINES)) for d in _delimiters(cells, rules)]
        heads = [(d, 0, rows[0][1]) for d, rows in heads if rows]
        chosen = max(heads, key=lambda head: len(head[2]), default=None)
    if chosen is None:
        return None
    delimiter, k, titles = chosen
    rows = _rows(cells, delimiter, rules)
    below = [cell.strip("[]() ") for cell in rows[k + 1][1]] if k + 1 < len(rows) else []
    units = below if any(below) and all(_is_unit(c, wanted) for c in below) else []
    return Head(rows, rows[k][0], titles, units, k + 1 + bool(units), delimiter)


def _delimiters(cells, rules):
    """Return the delimiters to try."""
    if cells.rows is not None:
        return ("",)
    return (rules.options["delimiter"],) if "delimiter" in rules.options else DELIMITERS


def _rows(cells, delimiter, rules, last=None):
    """Return the rows of a table below those that a mapping skips."""
    skip = rules.options.get("skip_lines", 0)
    return [row for row in cells.split(delimiter, last) if row[0] > skip]


def _joined(above, row):
    """Return titles with those over several cells of the row above in front."""
    if len([t for t in above if t]) < 2:
        return row
    above = [*above, *[""] * (len(row) - len(above))]
    spread = [next((t for t in above[n::-1] if t), "") for n in range(len(row))]
    joined = [f"{s} {t}" if t and s != t else t for s, t in zip(spread, row, strict=True)]
    return [t or above[n] for n, t in enumerate(joined)]


def _score(titles, wanted, rules):
    """Return how many quantities titles name, 0 where one of them is a number."""
    if len(titles) < 2 or any(map(is_number, titles)):
        return 0
    named = {plain_word(c) for c, _ in rules.columns.values() if isinstance(c, str)}
    mapped = named & {plain_word(title) for title in titles}
    return len({wanted.title(t).quantity for t in titles} - {""}) + 10 * len(mapped)


def _is_unit(cell, wanted):
    """Tell whether a cell below a title is a unit, or says that there is none."""
    if wanted.title(cell).quantity:
        return False
    return cell in ("", "-") or bool(unit_name(cell)) or is_pressure(cell)


def _sources(where, head, wanted, rules, data):
    """Return the source of each quantity, and why other columns are not read."""
    sources, offered, open_ = {}, {}, []
    for name, (column, unit) in rules.columns.items():
        index = _index(where, name, column, head.titles)
        title = head.titles[index] if index < len(head.titles) else ""
        if not unit and title:
            unit = title_unit(title) or (head.units[index] if index < len(head.units) else "")
        sources[name] = Source(index, title, unit, "by the mapping")
    used = {source.index for source in sources.values()}
    for index, text in enumerate(head.titles):
        below = head.units[index] if index < len(head.units) else ""
        title = wanted.title(text)
        if below and not title.unit:
            title = wanted.title(f"{text} ({below})")
        if index in used or not (rules.rest and title.quantity) or title.quantity in sources:
            continue
        source = Source(index, text, title.unit or below, rank=title.rank)
        offered.setdefault(title.quantity, []).append(source)
    unread = {n: "its title is none of those looked for" for n, t in enumerate(head.titles) if t}
    for name, columns in offered.items():
        quantity = wanted.quantities[name]
        texts = {c.index: [row[c.index] for _, row in data if c.index < len(row)] for c in columns}
        if quantity.units:
            words = [c for c in columns if _holds_words(texts[c.index], quantity)]
            if len(words) < len(columns) or not quantity.needed:
                columns = [c for c in columns if c not in words]
            unread |= {c.index: "it holds words" for c in words}
            right = [c for c in columns if _unit(c, quantity)]
            columns = right or columns
        if columns:
            chosen = _chosen(name, quantity, columns, texts, head.delimiter)
            if isinstance(chosen, str):
                open_.append(chosen)
                continue
            sources[name] = chosen
            for c in columns:
                unread[c.index] = f"{chosen.name} is {name}"
    if open_:
        raise ReadError(f"{where}: {'; '.join(open_[:3])}")
    for source in sources.values():
        unread.pop(source.index, None)
    return sources, unread


def _index(where, name, column, titles):
    """Return the index from 0 of a column that a mapping gives by title or by number from 1."""
    if isinstance(column, str):
        plain = [plain_word(title) for title in titles]
        if plain_word(column) in plain and plain.count(plain_word(column)) == 1:
            return plain.index(plain_word(column))
        exact = [n for n, title in enumerate(titles) if title.strip() == column.strip()]
        if len(exact) != 1:
            raise ReadError(
                f"{where}: mapping asks for column {column!r} ({name}); the table has "
                f"{', '.join(titles)[:120] or 'no titles'}"
            )
        return exact[0]
    if not 1 <= column <= 1000 or (titles and column > len(titles)):
        raise ReadError(f"{where}: mapping asks for column {column} ({name}); not there")
    return column - 1


def _holds_words(texts, quantity):
    """Tell whether a column holds words and no number."""
    filled = [t for t in texts if t.lower() not in ABSENT and not isinstance(t, Cell)]
    clock = quantity.clock and any(map(_CLOCK.fullmatch, filled))
    numbers = any(isinstance(t, Cell) for t in texts) or any(re.search(r"\d", t) for t in filled)
    return bool(filled) and not numbers and not clock


def _unit(source, quantity):
    """Return the unit of a column, or the one that is taken where it has none; "" if wrong."""
    if quantity.units == ("*",):
        return source.unit or "*"
    unit = unit_name(source.unit) if source.unit else quantity.default
    return unit if unit in quantity.units else ""


def _chosen(name, quantity, columns, texts, delimiter):
    """Return the column of a quantity: the only one, or that whose title says so; else a reason."""
    best = max(c.rank for c in columns)
    first = [c for c in columns if c.rank == best]
    others = [c for c in columns if c is not first[0]]
    if len(columns) == 1 and best != PART:
        return first[0]
    if len(first) == 1 and best == SAYS:
        return first[0]._replace(why=f"its title says so, not that of {_listed(others)}")
    if quantity.units and len(columns) > 1 and _alike(columns, quantity, texts, delimiter):
        return first[0]._replace(why=f"{_listed(others)} holds the same")
    key = f"{name}_{_unit(first[0], quantity) or quantity.units[0]}" if quantity.units else name
    said = ("is only a part of", "may both be")[len(columns) > 1]
    return (
        f"{_listed(columns)} {said} the {name}: say which by a mapping, [columns] {key} = "
        f"{first[0].title!r}"
    )


def _listed(columns):
    """Name columns in a sentence."""
    return " and ".join(column.name for column in columns)


def _alike(columns, quantity, texts, delimiter):
    """Tell whether columns hold the same numbers, each in its unit."""
    values = []
    try:
        form = number_format("", [texts[c.index] for c in columns], delimiter)
        for c in columns:
            factor = FACTORS.get(_unit(c, quantity), 1.0)
            values.append([factor * number(t, "", form) for t in texts[c.index] if t])
    except ReadError:
        return False
    same = len({len(column) for column in values}) == 1
    return same and all(np.allclose(column, values[0], rtol=SAME) for column in values[1:])


def read_table(
    path: str | Path,
    wanted: Wanted,
    mapping: Mapping | Rules | None = None,
    log: ReadLog | None = None,
    *,
    sheet: str | None = None,
    untitled: Sequence[str] = (),
    kind: str = "table with titles",
) -> Table:
    """Read a table of text or of a workbook.

    Parameters
    ----------
    path : path
    wanted : Wanted
        Quantities that the caller looks for.
    mapping : mapping or Rules, optional
        ``{"columns": {"charge_kg": "Mass"}, "table": {"decimal": ","}}``: columns by title or
        number from 1, with the unit in the key; what it does not name is recognised by its title.
    log : ReadLog, optional
        Takes what was read.
    sheet : str, optional
        Of a workbook.
    untitled : sequence of str
        Quantities of a table without titles, in the order of its columns, if such are permitted.
    kind : str
        Name of the layout for the log.

    Returns
    -------
    Table
        In SI.

    Raises
    ------
    ReadError, InputError
        Naming line, column and remedy; where two columns may be one quantity and no title says
        which, where the format of the numbers is open, or where a needed column or unit is missing.
    """
    path = Path(path)
    cells = cells_of(path.name, read_bytes(path), sheet)
    rules = mapping if isinstance(mapping, Rules) else rules_of(mapping, wanted)
    head = find_titles(cells, wanted, rules) or headless(cells, rules, untitled)
    if head is None:
        rows = cells.split(",", 1)
        shown = ", ".join(rows[0][1])[:80] if rows else "nothing"
        examples = ", ".join(
            f"{name} ({q.units[0].replace('_per_', '/')})"
            for name, q in wanted.quantities.items()
            if q.needed and q.units
        )
        raise ReadError(
            f"{path.name}, line {rows[0][0] if rows else 1}: needs titles such as {examples}; got "
            f"{shown}; or give a mapping"
        )
    return table_of(cells, head, wanted, rules, log, untitled=untitled, kind=kind)


def headless(cells: Cells, rules: Rules, untitled: Sequence[str] = ()) -> Head | None:
    """Return the head of a table without titles, None where its rows are not such numbers."""
    last = max([len(untitled), *(c for c, _ in rules.columns.values() if isinstance(c, int))])
    for delimiter in _delimiters(cells, rules):
        rows = _rows(cells, delimiter, rules, HEAD_LINES)
        if untitled and not rules.columns:
            fits = all(len(r) == last and all(map(is_number, r)) for _, r in rows)
        else:
            fits = rules.options.get("header") is False and all(len(r) >= last for _, r in rows)
        if rows and fits:
            return Head(_rows(cells, delimiter, rules), rows[0][0], [], [], 0, delimiter)
    return None


def table_of(
    cells: Cells,
    head: Head,
    wanted: Wanted,
    rules: Rules,
    log: ReadLog | None = None,
    *,
    untitled: Sequence[str] = (),
    kind: str = "table with titles",
) -> Table:
    """Return the table below a row of titles, see `read_table`."""
    where, entry = cells.where, (log or ReadLog()).file(cells.where, kind)
    data = head.rows[head.first :]
    if head.titles:
        width = max(len(row) for _, row in data) if data else 0
        _refuse_shifted(where, head, data, width)
        sources, unread = _sources(where, head, wanted, rules, data)
    elif untitled and not rules.columns:
        named = {name: (k + 1, "") for k, name in enumerate(untitled)}
        sources, unread = _sources(where, head, wanted, Rules(named), data)
        entry.remark(f"no titles: the columns are taken as {', '.join(untitled)}")
    else:
        sources, unread = _sources(where, head, wanted, rules, data)
    _refuse_missing(where, head, wanted, sources)
    units = _units_of(where, wanted, sources, data)
    notes = [remark for remark in cells.remarks if not remark.startswith("sheet")]
    data, dropped = _without_totals(wanted, sources, data, head)
    table = Table(
        where, {}, {n: sources[n].unit for n in sources}, [n for n, _ in data], notes, entry
    )
    if not data:
        raise ReadError(f"{where}: a header but no rows of numbers below it")
    table.unread = {n: head.titles[n] for n in unread}
    _fill(table, wanted, sources, units, data, rules, head.delimiter)
    for remark in cells.remarks:
        entry.remark(remark)
    for name, source in sources.items():
        factor = 1.0 if units[name] in ("", "*", "deg") else FACTORS.get(units[name], 1.0)
        why = source.why or ("unit taken, the title has none" if not source.unit and units[name]
                             else "")  # fmt: skip
        entry.column(name, source.name, units[name].strip("*"), factor, rows=len(data), why=why)
        if source.why and source.why != "by the mapping":
            notes.append(f"The {name} is read from {source.name}: {source.why}.")
    for index, why in sorted(unread.items()):
        entry.dropped(f"column {index + 1} {head.titles[index]!r}", why)
    for part, why in dropped:
        entry.dropped(part, why)
        notes.append(f"Left out: {part}, {why}.")
    return table


ROUNDED = 50  # times from which on a step can be fitted to rounded ones
ROUGH = 0.05  # share of the step by which rounded times are off


def regular_step(times: np.ndarray, digit: float = 0.0, share: float = 0.5):
    """Return the step of regular times, and the index of one off their grid, None if none is.

    Times lie on the grid within ``share`` of the step, or half of the last printed digit.
    """
    count = np.arange(len(times))
    step = (times[-1] - times[0]) / count[-1]
    offset = np.max(np.abs(times - times[0] - step * count))
    if step > 0.0 and offset > ROUGH * step and len(times) >= ROUNDED:
        fitted, first = np.polyfit(count, times, 1)
        if np.ptp(times - first - fitted * count) <= 1.1 * digit:
            return float(fitted), None
    if step > 0.0 and offset <= share * step + min(digit, 0.1 * step):
        return float(step), None
    steps = np.diff(times)
    return float(step), int(np.argmax(np.abs(steps - np.median(steps)))) + 1


def _refuse_shifted(where, head, data, width):
    """Refuse rows of text with more cells than titles: a comma stands inside of a number."""
    for line, row in data if width > len(head.titles) else ():
        extra = [cell for cell in row[len(head.titles) :] if cell]
        if extra and head.delimiter and (head.delimiter == "," or any(map(is_number, extra))):
            raise ReadError(
                f"{where}, line {line}: has {len(row)} cells under {len(head.titles)} titles; "
                "if a comma stands inside a number, put the number into quotes or separate the "
                "columns by semicolons"
            )


def _refuse_missing(where, head, wanted, sources):
    """Refuse a table without a needed column."""
    missing = [name for name, q in wanted.quantities.items() if q.needed and name not in sources]
    if missing:
        units = {n: wanted.quantities[n].units for n in missing}
        examples = ", ".join(
            f"{n} ({u[0].replace('_per_', '/')})" if u else n for n, u in units.items()
        )
        raise ReadError(
            f"{where} line {head.line}: missing columns: {examples}; add them, or give a mapping"
        )


def _units_of(where, wanted, sources, data):
    """Return the unit of each source: of its title, of its cells, or the usual one."""
    units, taken = {}, []
    for name, source in sources.items():
        quantity = wanted.quantities[name]
        unit = _unit(source, quantity) if quantity.units else ""
        if quantity.units and not unit and not source.unit:
            unit = _unit_of_cells(data, source.index, quantity)
        clock = quantity.clock and any(_CLOCK.fullmatch(r[source.index]) for _, r in data[:1]
                                       if source.index < len(r))  # fmt: skip
        if quantity.units and not unit and not clock:
            listed = [unit.replace("_per_", "/") for unit in quantity.units]
            raise ReadError(
                f"{where}: {source.name} needs its unit, {' or '.join(listed[:3])}, such as "
                f"'{name.capitalize()} ({listed[0]})'"
            )
        if unit and unit != "*" and not source.unit:
            taken.append(name)
        units[name] = unit or ("s" if clock else "")
    odd = [n for n in sources if units[n] in ("ft", "lb")]
    lengths = [n for n in taken if units[n] == "m"]
    if odd and lengths:
        raise ReadError(
            f"{where}: {sources[odd[0]].name} is in {units[odd[0]]}, and the unit of "
            f"{', '.join(sources[n].title or n for n in lengths)} is not given; write it into the "
            f"title, such as '{sources[lengths[0]].title or lengths[0]} (ft)' or '... (m)'"
        )
    return units


_WITH_UNIT = re.compile(r"([-+]?[\d.,'’\s]*\d(?:[eE][-+]?\d+)?)\s*([^\d\s.,].*)")


def _unit_of_cells(data, index, quantity):
    """Return the unit that all cells of a column carry, and take it off them; "" if none."""
    cells = [(row, _WITH_UNIT.fullmatch(row[index])) for _, row in data
             if index < len(row) and row[index].lower() not in ABSENT]  # fmt: skip
    units = {unit_name(match[2]) if match else "" for _, match in cells}
    if len(units) != 1 or not units <= {*quantity.units}:
        return ""
    for row, match in cells:
        row[index] = match[1] if match else row[index]
    return units.pop()


def _without_totals(wanted, sources, data, head):
    """Leave out repeated titles, rows without numbers, totals and bounds; return what and why."""
    numeric = {n: s.index for n, s in sources.items() if wanted.quantities[n].units}
    keys = [numeric[n] for n in numeric if wanted.quantities[n].key]
    bounded = [numeric[n] for n in numeric if wanted.quantities[n].bounded]
    rows, dropped = [], []
    for line, row in data:
        cells = {k: row[k] if k < len(row) else "" for k in numeric.values()}
        numbers = [k for k, c in cells.items() if re.search(r"\d", c) or isinstance(c, Cell)]
        words = {plain_word(t) for cell in row for t in [*cell.split(), cell]}
        if not numbers or row == head.titles:
            text = " ".join(filter(None, row))[:40]
            dropped.append((f"row {line} ({text!r})", "it holds no numbers"))
            continue
        lacks = keys and not any(is_number(cells[k]) or _CLOCK.fullmatch(cells[k]) for k in keys)
        if lacks and (words & TOTALS or _sums(rows, cells, numbers)):
            dropped.append((f"row {line}", f"a total ({_shown(cells, numbers)})"))
            continue
        if any(cells[k].startswith(("<", ">")) for k in bounded):
            dropped.append((f"row {line}", f"only a bound is given ({_shown(cells, bounded)})"))
            continue
        rows.append((line, row))
    return rows, dropped


def _shown(cells, columns):
    """Return the cells of columns for a sentence."""
    return ", ".join(cells[k] for k in columns if cells[k])


def _sums(rows, cells, numbers):
    """Tell whether all numbers of a row are the sums of those above."""
    try:
        form = number_format("", [[r[k] for _, r in rows if k < len(r)] for k in numbers], ",")
        sums = [
            sum(number(r[k], "", form) for _, r in rows if k < len(r) and r[k]) for k in numbers
        ]
        last = [number(cells[k], "", form) for k in numbers]
    except ReadError:
        return False
    return len(rows) > 1 and bool(numbers) and bool(np.allclose(last, sums, rtol=1e-3))


def _fill(table, wanted, sources, units, data, rules, delimiter):
    """Put the values of all sources into a table, in SI."""
    texts = {}
    for name, source in sources.items():
        short = next((k for k, (_, r) in enumerate(data) if len(r) <= source.index), None)
        if short is not None and delimiter and wanted.quantities[name].units:
            raise ReadError(
                f"{table.where} line {table.lines[short]}, column {source.index + 1} ({name}): the "
                f"line has only {len(data[short][1])} columns"
            )
        texts[name] = [r[source.index] if source.index < len(r) else "" for _, r in data]
    numeric = [n for n in sources if wanted.quantities[n].units]
    clocks = [n for n in numeric if wanted.quantities[n].clock and _CLOCK.fullmatch(texts[n][0])]
    decimal = rules.options.get("decimal")
    if decimal:
        form = NumberFormat(decimal, "," if decimal == "." else ".")
    else:
        form = number_format(table.where, [texts[n] for n in numeric if n not in clocks], delimiter)
    if form.decimal == "," or form.thousands:
        name = {",": "comma", ".": "point"}
        between = f", {name[form.thousands]} between thousands" if form.thousands else ""
        table.entry.remark(f"decimal {name[form.decimal]}{between}")
    for name, source in sources.items():
        if name not in numeric:
            table.values[name] = [str(text) for text in texts[name]]
            continue
        key = f"{name}_{units[name]}".removesuffix("_*")
        if name in clocks:
            table.values[name], table.instant = _seconds(table, source, texts[name])
        else:
            numbers = _numbers(table, source, key, texts[name], form, wanted.quantities[name])
            factor = to_si(f"_{units[name]}", 1.0)[1] if units[name] != "Nm_per_s" else 1.0
            table.values[name] = numbers * factor
            table.digits[name] = factor * _step(texts[name], form.decimal)


def _step(texts, decimal):
    """Return the step of the last printed digit of a column."""
    mantissas = (text.lower().partition("e")[0] for text in texts)
    return 10.0 ** -max(len(mantissa.partition(decimal)[2]) for mantissa in mantissas)


def _numbers(table, source, key, texts, form, quantity):
    """Return the numbers of a column, NaN where absent."""

    def where_of(k):
        return f"{table.where} line {table.lines[k]}, column {source.index + 1} ({key})"

    for k, text in enumerate(texts):
        if isinstance(text, Cell) and text.kind != "stored":
            if text.kind == "formula":
                raise ReadError(
                    f"{table.where}: cell {text} ({key}) is a formula without a stored value; open "
                    "and save the workbook in a spreadsheet program"
                )
            if quantity.adds and sum(t == text and isinstance(t, Cell) for t in texts) > 1:
                raise ReadError(
                    f"{where_of(k)}: {text} stands in merged cells; write the value of each row"
                )
    absent = np.array([text.lower() in ABSENT for text in texts])
    values = np.full(len(texts), np.nan)
    present = np.flatnonzero(~absent)
    rest = [texts[k] for k in present]
    values[present] = numbers_of(rest, form, lambda k: where_of(present[k]))
    return values


def _seconds(table, source, texts):
    """Return times of day as seconds after the first, and the instant of the first."""
    seconds = []
    for k, text in enumerate(texts):
        match = _CLOCK.fullmatch(text)
        if match is None:
            raise ReadError(
                f"{table.where} line {table.lines[k]}, column {source.index + 1}: expected a time "
                f"of day such as {texts[0]}, got {text[:40]!r}"
            )
        hours, minutes, rest = int(match[2]), int(match[3]), float(match[4].replace(",", "."))
        day = 86400.0 * date.fromisoformat(match[1]).toordinal() if match[1] else 0.0
        seconds.append(day + 3600.0 * hours + 60.0 * minutes + rest)
    times = np.array(seconds) - seconds[0]
    if times[-1] < 0.0:  # midnight lies between
        times = np.where(times < -43200.0, times + 86400.0, times)
    decimals = max(
        len(re.split("[.,]", text)[1]) if re.search("[.,]", text) else 0 for text in texts
    )
    table.digits["time"] = 10.0**-decimals
    return times, texts[0]
