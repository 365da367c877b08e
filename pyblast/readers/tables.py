"""Tables: columns by title or mapping, in SI, and what of a table is no row."""

import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..errors import InputError, ReadError
from ..units import FACTORS, split_key, to_si
from .cells import (
    ABSENT,
    DELIMITERS,
    LONGEST_LINE,
    PART,
    PLAIN,
    SAYS,
    TOTALS,
    Cell,
    Cells,
    NumberFormat,
    Wanted,
    cells_of,
    decode_lines,
    is_number,
    is_pressure,
    number,
    number_format,
    numbers_of,
    plain_word,
    read_bytes,
    title_unit,
    unit_name,
)
from .provenance import FileRead, ReadLog

HEAD_LINES = 60  # of a file, among which the row of titles is looked for
SAME = 5e-3  # relative difference of two columns that hold the same quantity in other digits
OPTIONS = {"delimiter": DELIMITERS, "decimal": (".", ","), "header": (True, False),
           "skip_lines": (int,)}  # fmt: skip
_CLOCK = re.compile(r"(\d{4}-\d\d-\d\d[T ])?(\d{1,2}:\d\d:\d\d)(?:[.,](\d*))?Z?")
_WITH_UNIT = re.compile(r"([-+]?[\d.,'’\s]*\d(?:[eE][-+]?\d+)?)\s*([^\d\s.,].*)")


@dataclass
class Table:
    """Table that was read, by quantity: numbers (n_rows,) in SI, NaN where absent, or texts.

    ``units`` are as written, ``lines`` the numbers of the rows, ``notes`` choices and losses in
    sentences, ``digits`` the steps of the last printed digits in SI, ``instant`` the first time of
    day, ``unread`` the titles of other columns by their number from 0.
    """

    where: str
    entry: FileRead
    lines: list[int]
    notes: list[str]
    values: dict[str, Any] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)
    digits: dict[str, float] = field(default_factory=dict)
    unread: dict[int, str] = field(default_factory=dict)
    instant: str = ""


class Rules(NamedTuple):
    """Rules of a mapping: column and unit by quantity, options, whether others are recognised."""

    columns: Mapping[str, tuple[int | str, str]] = {}
    options: Mapping[str, Any] = {}
    rest: bool = True


NO_RULES = Rules()


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


def load_mapping(path: Path | str) -> dict:
    """Read a mapping file; raise InputError if it is no TOML."""
    text = "\n".join(decode_lines(path, read_bytes(Path(path), LONGEST_LINE), "mapping"))
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"mapping {path}: expected TOML ({error})") from None


def rules_of(mapping: Mapping | None, wanted: Wanted, further: Mapping = {}) -> Rules:
    """Check a mapping: quantities with units in [columns], options in [table] and ``further``."""
    if mapping is None:
        return NO_RULES
    columns, options = mapping.get("columns", {}), mapping.get("table", {})
    known, rules = {**OPTIONS, **further}, {}
    if not (isinstance(columns, dict) and isinstance(options, dict) and (columns or options)):
        raise ReadError("mapping: needs a table [columns] or [table]")
    if unexpected := (set(mapping) - {"columns", "table"}) | (set(options) - set(known)):
        raise ReadError(f"mapping: unknown {min(unexpected)}; [table] takes {', '.join(known)}")
    for key, column in columns.items():
        stem, unit = (key, "") if key in wanted.quantities else split_key(key)
        units = wanted.quantities[stem].units if stem in wanted.quantities else None
        if units is None or (units and units != ("*",) and unit not in units):
            listed = ", ".join(f"{n} ({'/'.join(q.units)})" for n, q in wanted.quantities.items())
            what = f"mapping: columns.{key} is no quantity with its unit; known are {listed}"
            raise ReadError(what[:400])
        rules[stem] = column_of(f"mapping: columns.{key}", column), unit
    for name, value in options.items():
        if value not in known[name] and type(value) is not known[name][0]:
            raise ReadError(f"mapping: table.{name} can't be {value!r}")
    return Rules(rules, options)


def column_of(where: str, column: Any) -> int | str:
    """Check the column of a mapping: a title, or a number from 1."""
    if isinstance(column, bool) or not isinstance(column, (int, str)) or column == 0:
        raise ReadError(f"{where} must be a title or a column from 1, got {column!r}")
    return column


# The head of a table


def head_of(
    cells: Cells, wanted: Wanted, rules: Rules = NO_RULES, untitled: Sequence[str] = (), least=2
) -> Head | None:
    """Return the head of a table, None where it has neither titles nor ``untitled`` columns.

    The row of titles is the one among the first with the most titles of different quantities (at
    least ``least``), by the delimiter that gives most; titles over merged cells in the row above
    count in front of those below.
    """
    options, best, chosen = rules.options, 0, None
    marks = (options["delimiter"],) if "delimiter" in options else DELIMITERS
    begun = {
        mark: cells.split(mark, options.get("skip_lines", 0), HEAD_LINES)
        for mark in (marks if cells.rows is None else ("",))
    }
    for mark, rows in begun.items() if options.get("header") is not False else ():
        for k, (_, row) in enumerate(rows[: 1 if options.get("header") else None]):
            if mark == " " and any(sign in cell for cell in row for sign in ";|,"):
                continue
            for titles in (row, _joined(rows[k - 1][1] if k else [], row)):
                score = _score(titles, wanted, rules)
                if score > best and (score >= least or len(titles) == 2):
                    best, chosen = score, (mark, k, titles)
    if chosen is None and rules.columns and options.get("header") is not False:
        heads = [(mark, 0, rows[0][1]) for mark, rows in begun.items() if rows]
        chosen = max(heads, key=lambda head: len(head[2]), default=None)
    if chosen is None:
        return _headless(cells, begun, rules, untitled)
    mark, k, titles = chosen
    rows = cells.split(mark, options.get("skip_lines", 0))
    below = [cell.strip("[]() ") for cell in rows[k + 1][1]] if k + 1 < len(rows) else []
    units = below if any(below) and all(_is_unit(c, wanted) for c in below) else []
    return Head(rows, rows[k][0], titles, units, k + 1 + bool(units), mark)


def _headless(cells, begun, rules, untitled):
    """Return the head of a table without titles, None where its rows are not such numbers."""
    last = max([len(untitled), *(c for c, _ in rules.columns.values() if isinstance(c, int))])
    for mark, rows in begun.items():
        fits = rules.options.get("header") is False and all(len(r) >= last for _, r in rows)
        if untitled and not rules.columns:
            fits = all(len(r) == last and all(map(is_number, r)) for _, r in rows)
        if rows and fits:
            all_rows = cells.split(mark, rules.options.get("skip_lines", 0))
            return Head(all_rows, rows[0][0], [], [], 0, mark)
    return None


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
    known = cell in ("", "-") or bool(unit_name(cell)) or is_pressure(cell)
    return known and not wanted.title(cell).quantity


# The source of each quantity


def _sources(where, head, wanted, rules, data):
    """Return the source of each quantity, and why other columns are not read."""
    sources, offered, questions = {}, {}, []
    units = [*head.units, *[""] * (len(head.titles) - len(head.units))]
    for name, (column, unit) in rules.columns.items():
        index = _index(where, name, column, head.titles)
        title = head.titles[index] if index < len(head.titles) else ""
        unit = unit or (title and (title_unit(title) or units[index]))
        sources[name] = Source(index, title, unit, "by the mapping")
    used = {source.index for source in sources.values()}
    for index, text in enumerate(head.titles if rules.rest else ()):
        title = wanted.title(text)
        if units[index] and not title.unit:
            title = wanted.title(f"{text} ({units[index]})")
        if index not in used and title.quantity and title.quantity not in sources:
            source = Source(index, text, title.unit or units[index], rank=title.rank)
            offered.setdefault(title.quantity, []).append(source)
    unread = {n: "its title is none of those looked for" for n, t in enumerate(head.titles) if t}
    for name, columns in offered.items():
        quantity = wanted.quantities[name]
        texts = {c.index: [row[c.index] for _, row in data if c.index < len(row)] for c in columns}
        if quantity.units:
            words = [c for c in columns if _holds_words(texts[c.index])]
            if len(words) < len(columns) or not quantity.needed:
                columns = [c for c in columns if c not in words]
            unread |= {c.index: "it holds words" for c in words}
            columns = [c for c in columns if _unit(c, quantity)] or columns
        chosen = _chosen(name, quantity, columns, texts, head.delimiter) if columns else None
        if isinstance(chosen, str):
            questions.append(chosen)
        elif chosen:
            sources[name] = chosen
            unread |= {c.index: f"{chosen.name} is {name}" for c in columns}
    if questions:
        raise ReadError(f"{where}: {'; '.join(questions[:3])}")
    read = {source.index for source in sources.values()}
    return sources, {n: why for n, why in unread.items() if n not in read}


def _index(where, name, column, titles):
    """Return the index from 0 of a column that a mapping gives by title or by number from 1."""
    if isinstance(column, int):
        if not 1 <= column <= (len(titles) or 1000):
            raise ReadError(f"{where}: mapping asks for column {column} ({name}); not there")
        return column - 1
    for written in (str.strip, plain_word):
        same = [n for n, title in enumerate(titles) if written(title) == written(column)]
        if len(same) == 1:
            return same[0]
    listed = ", ".join(titles)[:120] or "no titles"
    raise ReadError(f"{where}: mapping asks for column {column!r} ({name}); the table has {listed}")


def _holds_words(texts):
    """Tell whether a column holds words and no number."""
    filled = [text for text in texts if text.lower() not in ABSENT]
    return bool(filled) and not any(isinstance(t, Cell) or re.search(r"\d", t) for t in filled)


def _unit(source, quantity):
    """Return the unit of a column, or the one that is taken where it has none; "" if wrong."""
    if quantity.units == ("*",):
        return source.unit or "*"
    unit = unit_name(source.unit) if source.unit else quantity.default
    return unit if unit in quantity.units else ""


def _chosen(name, quantity, columns, texts, delimiter):
    """Return the column of a quantity: the only one, or that whose title says so; else why not."""
    best = max(c.rank for c in columns)
    first = [c for c in columns if c.rank == best]
    others = " and ".join(c.name for c in columns if c is not first[0])
    if len(columns) == 1 and best != PART:
        return first[0]
    if len(first) == 1 and best == SAYS:
        return first[0]._replace(why=f"its title says so, not that of {others}")
    if quantity.units and len(columns) > 1 and _alike(columns, quantity, texts, delimiter):
        return first[0]._replace(why=f"{others} holds the same")
    key = f"{name}_{_unit(first[0], quantity) or quantity.units[0]}" if quantity.units else name
    said = ("is only a part of", "may both be")[len(columns) > 1]
    listed = " and ".join(c.name for c in columns)
    how = f"say which by a mapping, [columns] {key} = {first[0].title!r}"
    return f"{listed} {said} the {name}: {how}"


def _alike(columns, quantity, texts, delimiter):
    """Tell whether columns hold the same numbers, each in its unit."""
    try:
        form = number_format("", [texts[c.index] for c in columns], delimiter)
        units = [FACTORS.get(_unit(c, quantity), 1.0) for c in columns]
        first, *others = (
            [unit * number(text, "", form) for text in texts[c.index] if text]
            for c, unit in zip(columns, units, strict=True)
        )
    except ReadError:
        return False
    return all(len(o) == len(first) and np.allclose(o, first, rtol=SAME) for o in others)


def _units_of(where, wanted, sources, data):
    """Return the unit of each source: of its title, of its cells, or the usual one."""
    units, taken = {}, []
    for name, source in sources.items():
        quantity = wanted.quantities[name]
        unit = _unit(source, quantity) if quantity.units else ""
        if quantity.units and not unit and not source.unit:
            unit = _unit_of_cells(data, source.index, quantity)
            sources[name] = source._replace(unit=unit)
        if (
            not unit
            and quantity.clock
            and any(_CLOCK.fullmatch(r[source.index]) for _, r in data[:1])
        ):
            unit = "s"
        if quantity.units and not unit:
            listed = [unit.replace("_per_", "/") for unit in quantity.units]
            said = (
                f"is in {source.unit!r}, not read here; write" if source.unit else "needs its unit,"
            )
            raise ReadError(f"{where}: {source.name} {said} {' or '.join(listed[:3])}, such as "
                            f"'{name.capitalize()} ({listed[0]})'")  # fmt: skip
        taken += [source.title or name] if unit == "m" and not source.unit else []
        units[name] = unit
    odd = next((n for n in sources if units[n] in ("ft", "us_ft", "lb")), None)
    if odd and taken:
        raise ReadError(
            f"{where}: {sources[odd].name} is in {units[odd]}, and the unit of {', '.join(taken)} "
            f"is not given; write it into the title, such as '{taken[0]} (ft)' or '... (m)'"
        )
    return units


def _unit_of_cells(data, index, quantity):
    """Return the unit that all cells of a column carry, and take it off them; "" if none."""
    rows = [r for _, r in data if index < len(r) and r[index].lower() not in ABSENT]
    matches = [_WITH_UNIT.fullmatch(row[index]) for row in rows]
    units = {unit_name(match[2]) if match else "" for match in matches}
    if len(units) != 1 or not units <= {*quantity.units}:
        return ""
    for row, match in zip(rows, matches, strict=True):
        row[index] = match[1] if match else ""
    return units.pop()


# Rows and values


def read_table(
    path: str | Path, wanted: Wanted, mapping: Mapping | Rules | None = None,
    log: ReadLog | None = None, *, sheet: str | None = None, untitled: Sequence[str] = (),
    kind: str = "table with titles",
) -> Table:  # fmt: skip
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

    Raises
    ------
    ReadError, InputError
        Naming line, column and remedy; where two columns may be one quantity and no title says
        which, where the format of the numbers is open, or where a needed column or unit is missing.
    """
    path = Path(path)
    cells = cells_of(path.name, read_bytes(path), sheet)
    rules = mapping if isinstance(mapping, Rules) else rules_of(mapping, wanted)
    head = head_of(cells, wanted, rules, untitled)
    if head is None:
        line, row = next(iter(cells.split(",")), (1, ["nothing"]))
        examples = _examples({n: q for n, q in wanted.quantities.items() if q.needed})
        raise ReadError(f"{path.name}, line {line}: needs titles such as {examples}; got "
                        f"{', '.join(row)[:80]}; or give a mapping")  # fmt: skip
    if not head.titles and not rules.columns:
        rules = Rules({name: (k + 1, "") for k, name in enumerate(untitled)})
    return table_of(cells, head, wanted, rules, log, kind)


def _examples(quantities):
    """Write titles for quantities, such as "ppv (mm/s)"."""
    units = {name: "".join(q.units[:1]).replace("_per_", "/") for name, q in quantities.items()}
    return ", ".join(f"{name} ({unit})" if unit else name for name, unit in units.items())


def table_of(
    cells: Cells, head: Head, wanted: Wanted, rules: Rules = NO_RULES, log: ReadLog | None = None,
    kind: str = "table with titles",
) -> Table:  # fmt: skip
    """Return the table below its head, see `read_table`."""
    where, entry, data = (
        cells.where,
        (log or ReadLog()).file(cells.where, kind),
        head.rows[head.first :],
    )
    _refuse_shifted(where, head, data)
    sources, unread = _sources(where, head, wanted, rules, data)
    if missing := {n: q for n, q in wanted.quantities.items() if q.needed and n not in sources}:
        raise ReadError(f"{where} line {head.line}: missing columns: {_examples(missing)}; add "
                        "them, or give a mapping")  # fmt: skip
    units = _units_of(where, wanted, sources, data)
    data, dropped = _without_totals(wanted, sources, data, head)
    if not data:
        raise ReadError(f"{where}: a header but no rows of numbers below it")
    notes = [remark for remark in cells.remarks if not remark.startswith("sheet")]
    table = Table(where, entry, [n for n, _ in data], notes)
    table.unread = {n: head.titles[n] for n in unread}
    table.units = {name: source.unit for name, source in sources.items()}
    entry.remarks += cells.remarks if head.titles else (*cells.remarks, "no titles")
    _fill(table, wanted, sources, units, data, rules, head.delimiter)
    for name, source in sources.items():
        why = source.why or ("usual unit taken" if units[name] and not source.unit else "")
        factor = FACTORS.get(units[name], 1.0)
        entry.column(name, source.name, units[name].strip("*"), factor, rows=len(data), why=why)
        if source.why and source.why != "by the mapping":
            notes.append(f"The {name} is read from {source.name}: {source.why}.")
    for index, why in sorted(unread.items()):
        entry.dropped(f"column {index + 1} {head.titles[index]!r}", why)
    for part, why in dropped:
        entry.dropped(part, why)
        notes.append(f"Left out: {part}, {why}.")
    return table


def _refuse_shifted(where, head, data):
    """Refuse rows of text with more cells than titles: a comma stands inside of a number."""
    width = len(head.titles)
    for line, row in data if head.titles and head.delimiter else ():
        extra = [cell for cell in row[width:] if cell]
        if extra and (head.delimiter == "," or any(map(is_number, extra))):
            raise ReadError(
                f"{where}, line {line}: has {len(row)} cells under {width} titles; if a comma "
                "stands inside a number, put the number into quotes or separate the columns by "
                "semicolons"
            )


def _without_totals(wanted, sources, data, head):
    """Leave out repeated titles, rows without numbers, totals and bounds; return what and why."""
    numeric = {n: s.index for n, s in sources.items() if wanted.quantities[n].units}
    keys = [k for n, k in numeric.items() if wanted.quantities[n].key]
    bounded = [k for n, k in numeric.items() if wanted.quantities[n].bounded]
    rows, dropped = [], []
    for line, row in data:
        cells = {k: row[k] if k < len(row) else "" for k in numeric.values()}
        if all(c and c[-1].isdigit() and c[0] not in "<>" for c in cells.values()):
            rows.append((line, row))
            continue
        numbers = [k for k, c in cells.items() if re.search(r"\d", c) or isinstance(c, Cell)]
        shown = ", ".join(cells[k] for k in numbers)
        if not numbers or row == head.titles:
            text = " ".join(filter(None, row))[:40]
            dropped.append((f"row {line} ({text!r})", "it holds no numbers"))
        elif any(cells[k].startswith(("<", ">")) for k in bounded):
            dropped.append((f"row {line}", f"only a bound is given ({shown})"))
        elif (
            keys
            and not any(is_number(cells[k]) or _CLOCK.fullmatch(cells[k]) for k in keys)
            and (_words(row) & TOTALS or _sums(rows, cells, numbers))
        ):
            dropped.append((f"row {line}", f"a total ({shown})"))
        else:
            rows.append((line, row))
    return rows, dropped


def _words(row):
    """Return the words of a row, and its cells as words."""
    return {plain_word(text) for cell in row for text in (*cell.split(), cell)}


def _sums(rows, cells, numbers):
    """Tell whether all numbers of a row are the sums of those above."""
    above = [[row[k] for _, row in rows if k < len(row) and row[k]] for k in numbers]
    try:
        form = number_format("", above)
        sums = [sum(number(text, "", form) for text in texts) for texts in above]
        last = [number(cells[k], "", form) for k in numbers]
    except ReadError:
        return False
    return len(rows) > 1 and bool(np.allclose(last, sums, rtol=1e-3))


def _fill(table, wanted, sources, units, data, rules, delimiter):
    """Put the values of all sources into a table, in SI."""
    texts = {}
    for name, source in sources.items():
        short = next((line for line, row in data if len(row) <= source.index), None)
        if short is not None and delimiter and wanted.quantities[name].units:
            count = len(next(row for line, row in data if line == short))
            raise ReadError(f"{table.where} line {short}, column {source.index + 1} ({name}): the "
                            f"line has only {count} columns")  # fmt: skip
        texts[name] = [row[source.index] if source.index < len(row) else "" for _, row in data]
    numeric = [n for n in sources if wanted.quantities[n].units]
    clocks = [n for n in numeric if wanted.quantities[n].clock and _CLOCK.fullmatch(texts[n][0])]
    if decimal := rules.options.get("decimal"):
        form = NumberFormat(decimal, "," if decimal == "." else ".")
    else:
        form = number_format(table.where, [texts[n] for n in numeric if n not in clocks], delimiter)
    if form.decimal == "," or form.thousands:
        table.entry.remark(f"decimal {form.decimal!r}, thousands {form.thousands!r}")
    for name, source in sources.items():
        if name in clocks:
            _fill_seconds(table, source, texts[name])
        elif name in numeric:
            factor = to_si(f"_{units[name]}", 1.0)[1] if units[name] != "Nm_per_s" else 1.0
            where = f"column {source.index + 1} ({name}_{units[name]})".replace("_*)", ")")
            values = _numbers(table, where, texts[name], form, wanted.quantities[name])
            mantissas = (text.lower().partition("e")[0] for text in texts[name])
            digits = max(len(mantissa.partition(form.decimal)[2]) for mantissa in mantissas)
            table.values[name], table.digits[name] = factor * values, factor * 10.0**-digits
        else:
            table.values[name] = [str(text) for text in texts[name]]


def _numbers(table, where, texts, form, quantity):
    """Return the numbers of a column, NaN where absent."""
    for line, text in zip(table.lines, texts, strict=True):
        kind = text.kind if isinstance(text, Cell) else "stored"
        if kind == "formula":
            raise ReadError(
                f"{table.where}: cell {text}, {where}, is a formula without a stored value; open "
                "and save the workbook in a spreadsheet program"
            )
        if kind == "merged" and quantity.adds and texts.count(text) > 1:
            raise ReadError(f"{table.where} line {line}, {where}: {text} stands in merged cells; "
                            "write the value of each row")  # fmt: skip
    present = np.array([text.lower() not in ABSENT for text in texts])
    lines, values = np.array(table.lines)[present], np.full(len(texts), np.nan)
    given = [text for text, known in zip(texts, present, strict=True) if known]
    values[present] = numbers_of(given, form, lambda k: f"{table.where} line {lines[k]}, {where}")
    return values


def _fill_seconds(table, source, texts):
    """Put times of day as seconds after the first, and the instant of the first, into a table."""
    seconds, digits = [], 0
    for line, text in zip(table.lines, texts, strict=True):
        if (match := _CLOCK.fullmatch(text)) is None:
            raise ReadError(f"{table.where} line {line}, {source.name}: expected a time of day "
                            f"such as {texts[0]}, got {text[:40]!r}")  # fmt: skip
        day, clock, share = (part or "" for part in match.groups())
        whole = datetime.fromisoformat(f"{day.strip('T ') or '2000-01-01'}T{clock.zfill(8)}")
        seconds.append((whole - datetime(2000, 1, 1)).total_seconds() + float(f"0.{share or 0}"))
        digits = max(digits, len(share))
    times = np.array(seconds) - seconds[0]
    if times[-1] < 0.0:  # midnight lies between
        times = np.where(times < -43200.0, times + 86400.0, times)
    table.values["time"], table.digits["time"], table.instant = times, 10.0**-digits, texts[0]


ROUNDED = 50  # times from which on a step can be fitted to rounded ones
ROUGH = 0.05  # share of the step by which rounded times are off


def regular_step(times: np.ndarray, digit: float = 0.0, share: float = 0.5):
    """Return the step of regular times, and the index of one off their grid, None if none is.

    Times lie on the grid within ``share`` of the step, or half of the last printed digit.
    """
    count, steps = np.arange(len(times)), np.diff(times)
    step = float((times[-1] - times[0]) / count[-1])
    offset = np.max(np.abs(times - times[0] - step * count))
    if step > 0.0 and offset > ROUGH * step and len(times) >= ROUNDED:
        fitted, first = np.polyfit(count, times, 1)
        if np.ptp(times - first - fitted * count) <= 1.1 * digit:
            return float(fitted), None
    if step > 0.0 and offset <= share * step + min(digit, 0.1 * step):
        return step, None
    return step, int(np.argmax(np.abs(steps - np.median(steps)))) + 1
