"""Cells of text and workbooks: what a number, a unit or a title in ten languages says."""

import csv
import io
import math
import re
import tomllib
import unicodedata
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import date, datetime, time
from functools import cache
from importlib import resources
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..errors import InputError, ReadError
from ..units import FACTORS
from .kinds import expect

LARGEST_TABLE = 100_000_000  # bytes
LARGEST_UNPACKED = 500_000_000  # bytes of all parts of a workbook
LARGEST_EDITED = 40_000_000  # bytes of a workbook whose merged and hidden cells are looked for
LONGEST_LINE = 100_000  # characters
DELIMITERS = (";", "\t", "|", ",", " ")
ABSENT = {"", "na", "n/a", "#n/a", "nan", "null", "none", "-", "--", "---", "n.a."}


def read_bytes(path: Path, max_bytes: int = LARGEST_TABLE) -> bytes:
    """Read a regular file that is not larger than ``max_bytes``."""
    try:
        if not path.is_file():
            what = "a folder" if path.is_dir() else "a pipe or device" if path.exists() else "none"
            raise ReadError(f"{path}: expected a file, found {what}")
        size = path.stat().st_size
        if size > max_bytes:
            raise ReadError(f"{path}: holds {size} bytes, the cap (max_bytes) is {max_bytes}")
        if size == 0:
            raise ReadError(f"{path}: is empty")
        return path.read_bytes()
    except ReadError:
        raise
    except (OSError, ValueError) as error:
        raise ReadError(f"{path}: can't be read ({getattr(error, 'strerror', error)})") from None


def decode_lines(where: Path | str, content: bytes, door: str = "table") -> list[str]:
    """Decode text in UTF-8, UTF-16 with its mark, or Latin-1; refuse what a door does not read."""
    expect(where, content, door)
    try:
        marked = content.startswith((b"\xff\xfe", b"\xfe\xff"))
        text = content.decode("utf-16" if marked else "utf-8-sig")
    except UnicodeDecodeError:
        text = content.decode("latin-1")
    if "\0" in text:
        line = text[: text.index("\0")].count("\n") + 1
        raise ReadError(f"{where}, line {line}: expected text, found a NUL byte; it is damaged")
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    long = next((n for n, line in enumerate(lines, 1) if len(line) > LONGEST_LINE), None)
    if long is not None:
        length = len(lines[long - 1])
        raise ReadError(
            f"{where}, line {long}: has {length} characters, expected at most {LONGEST_LINE}"
        )
    while lines and not lines[-1].strip():
        lines.pop()
    return lines


def split_line(where: Path | str, line_number: int, line: str, delimiter: str = ",") -> list[str]:
    """Split one line of delimited text into stripped cells."""
    if delimiter == " ":
        return line.split()
    if '"' not in line:
        return [cell.strip() for cell in line.split(delimiter)]
    try:
        cells = next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [])
    except csv.Error as error:
        raise ReadError(f"{where}, line {line_number}: expected delimited text ({error})") from None
    return [cell.strip() for cell in cells]


class Cell(str):
    """Cell of a workbook: "stored" number, "formula" without value, or copy of a "merged" cell."""

    __slots__ = ("kind",)
    kind: str

    def __new__(cls, text: str, kind: str) -> "Cell":
        """Return a cell of a kind."""
        cell = super().__new__(cls, text)
        cell.kind = kind
        return cell


@dataclass(frozen=True)
class Cells:
    """Cells of a file: lines of text, or rows of a workbook with their numbers."""

    where: str
    lines: list[str]
    rows: list[tuple[int, list[str]]] | None = None
    remarks: tuple[str, ...] = ()

    def split(self, mark: str, skip: int = 0, count: int | None = None) -> list:
        """Return rows and their numbers below ``skip`` lines, at most ``count`` lines of them.

        Text is split by a mark; blank rows and comments are left out.
        """
        last = None if count is None else skip + count
        if self.rows is not None:
            return [row for row in self.rows[:last] if row[0] > skip]
        rows = [
            (n, split_line(self.where, n, line, mark))
            for n, line in enumerate(self.lines[skip:last], skip + 1)
            if line.strip(f"{mark} ") and not re.match(r"#|sep=.?$", line)
        ]
        return [(n, cells) for n, cells in rows if any(cells)]


def cells_of(
    where: Path | str, content: bytes, sheet: str | None = None, door: str = "table"
) -> Cells:
    """Return the cells of text, or of a sheet of a workbook (the only one with cells if not named).

    Raises InputError if a sheet must be named or is none, ReadError if the file is neither.
    """
    if expect(where, content, door).name != "an Excel workbook":
        if sheet is not None:
            raise InputError(f"{where}: is no Excel workbook; leave out sheet = {sheet!r}")
        return Cells(str(where), decode_lines(where, content, door))
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            size = sum(part.file_size for part in archive.infolist())
    except (zipfile.BadZipFile, OSError) as error:
        raise ReadError(f"{where}: is a damaged Excel workbook ({error}); save it again") from None
    if size > LARGEST_UNPACKED:
        most = LARGEST_UNPACKED // 10**6
        raise ReadError(f"{where}: unpacks to {size // 10**6} MB, at most {most} MB are read")
    import openpyxl
    from openpyxl.utils.exceptions import InvalidFileException

    edited, source = size <= LARGEST_EDITED, io.BytesIO(content)
    try:
        book = openpyxl.load_workbook(source, read_only=not edited, data_only=True)
        formulas = openpyxl.load_workbook(source) if edited else None
        tables = {table.title: table for table in book.worksheets}
        if sheet is not None and sheet not in tables:
            raise InputError(f"{where}: has no sheet {sheet!r}; its sheets are {', '.join(tables)}")
        names = [*tables] if sheet is None else [sheet]
        read = {n: _sheet(tables[n], None if formulas is None else formulas[n]) for n in names}
        book.close()
    except (KeyError, ValueError, OSError, TypeError, InvalidFileException, SyntaxError) as error:
        if isinstance(error, InputError):
            raise
        raise ReadError(f"{where}: is a damaged Excel workbook ({error})"[:300]) from None
    filled = {name: part for name, part in read.items() if part[0]}
    if not filled:
        what = "workbook" if sheet is None else f"sheet {sheet!r}"
        raise ReadError(f"{where}: the {what} is empty, expected a table")
    if len(filled) > 1:
        raise InputError(
            f"{where}: has several sheets ({', '.join(filled)}); name one by sheet = "
            f"{next(iter(filled))!r}"
        )
    ((name, (rows, remarks)),) = filled.items()
    return Cells(str(where), _as_text(rows), rows, (f"sheet {name!r}", *remarks))


def _sheet(table, formulas):
    """Return the rows of a sheet that have cells, and remarks on merged and hidden ones."""
    rows, remarks = {}, []
    for n, row in enumerate(table.iter_rows(values_only=True), 1):
        rows[n] = [_cell_text(value) for value in row]
    if formulas is not None:
        cells = [c for row in formulas.iter_rows() for c in row if c.data_type == "f"]
        empty = [c for c in cells if not rows[c.row][c.column - 1]]
        for cell in empty if len(empty) == len(cells) else ():  # no program has computed any
            rows[cell.row][cell.column - 1] = Cell(cell.coordinate, "formula")
        for span in table.merged_cells.ranges:
            _fill_merged(rows, span)
        hidden = [
            n for n, size in table.row_dimensions.items() if size.hidden and any(rows.get(n, ()))
        ]
        if hidden:
            remarks.append(f"{len(hidden)} hidden rows are read, too, the first is row {hidden[0]}")
    for cells in rows.values():
        while cells and not cells[-1]:
            cells.pop()
    return [(n, cells) for n, cells in rows.items() if cells], remarks


def _fill_merged(rows, span):
    """Copy the value of merged cells into all of them."""
    first, top, last, bottom = span.bounds
    value = rows[top][first - 1]
    for n in range(top, bottom + 1):
        for column in range(first - 1, last):
            if (n, column) != (top, first - 1) and value and n in rows and column < len(rows[n]):
                rows[n][column] = Cell(value, "merged")
    if value and bottom > top:
        rows[top][first - 1] = Cell(value, "merged")


def _cell_text(value) -> str:
    """Write the value of a cell on one line; numbers are marked as stored."""
    if value is None:
        return ""
    if isinstance(value, (datetime, date, time)):
        return value.isoformat()
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        whole = isinstance(value, float) and value.is_integer() and abs(value) < 1e15
        return Cell(str(int(value)) if whole else repr(value), "stored")
    return " ".join(str(value).split())


def _as_text(rows):
    """Return rows of a workbook as lines of CSV, line n for row n."""
    lines = [""] * (rows[-1][0] if rows else 0)
    for n, cells in rows:
        buffer = io.StringIO()
        csv.writer(buffer, lineterminator="").writerow(cells)
        lines[n - 1] = buffer.getvalue()
    return lines


class NumberFormat(NamedTuple):
    """Format of the numbers of a table: decimal mark, and the mark between thousands or ""."""

    decimal: str = "."
    thousands: str = ""


_DIGITS = re.compile(r"[-+]?(?:\d[\d.,]*|[.,]\d+)(?:[eE][-+]?\d+)?")
_GROUPS = re.compile(r"(?<=\d)[\s'’](?=\d{3}(?!\d))")


def _plain(text):
    """Write a number without blanks and apostrophes between thousands, and with a plain minus."""
    return _GROUPS.sub("", text.strip().replace("−", "-"))


def number_format(
    where: str, columns: Sequence[Sequence[str]], delimiter: str = ","
) -> NumberFormat:
    """Return the format of numbers that all columns of cells have in common; texts are passed over.

    Decimal commas without any other proof need another delimiter than the comma. Raises ReadError
    if decimal commas and points are mixed, or both readings are possible: three digits follow
    every comma, or every point of a column that has whole numbers, too.
    """
    clear: dict[tuple[str, bool], str] = {}  # (mark, whether it is decimal): example
    open_: dict[str, str] = {}
    commas, points = (any(m in "\n".join(texts) for texts in columns) for m in ",.")
    for texts in columns:
        whole, own = False, {}
        for cell in texts:
            if isinstance(cell, Cell) and cell.kind == "stored":
                continue
            text = _plain(cell).lstrip("+-").lower().partition("e")[0]
            if not ("," in text or "." in text) or not _DIGITS.fullmatch(text):
                whole |= text.isdigit()
                continue
            last = max(",.", key=text.rfind)
            other = "." if last == "," else ","
            head, _, tail = text.rpartition(last)
            if other in text:
                clear = {(last, True): cell, (other, False): cell} | clear
            elif last in head:
                clear.setdefault((last, False), cell)
            elif len(tail) != 3 or len(head) > 3 or head.startswith("0") or not head:
                clear.setdefault((last, True), cell)
                if not (commas and points):
                    return NumberFormat(last)
            else:
                own.setdefault(last, cell)
        if "." in own and not whole:
            own.pop(".") if not commas else None
        open_ = own | open_
    return _agreed(where, clear, open_, delimiter)


def _agreed(where, clear, open_, delimiter):
    """Return the format that all cells permit."""
    for mark, other in ((",", "."), (".", ",")):
        both = clear.get((mark, True)), clear.get((mark, False)) or clear.get((other, True))
        if all(both):
            raise ReadError(
                f"{where}: mixes decimal points and decimal commas, {both[0]!r} and {both[1]!r}; "
                "write all numbers alike"
            )
    if (",", True) in clear or (".", False) in clear:
        return NumberFormat(",", "." if (".", False) in clear or "." in open_ else "")
    if (".", True) in clear or (",", False) in clear:
        return NumberFormat(".", "," if (",", False) in clear or "," in open_ else "")
    if len(open_) == 2 or (open_ and delimiter not in (",", " ")):
        mark, example = next(iter(open_.items()))
        name = {",": "comma", ".": "point"}[mark]
        raise ReadError(
            f"{where}: {example!r} may have a decimal {name} or a {name} between thousands; give "
            'decimal = "," or decimal = "." in a mapping, or write the numbers without it'
        )
    return NumberFormat(".", "," if "," in open_ else "")


def number(text: str, where: str, form: NumberFormat = NumberFormat()) -> float:  # noqa: B008
    """Parse a finite number."""
    plain = _plain(text)
    if form.thousands and re.search(rf"\d\{form.thousands}\d", plain):
        head, mark, tail = plain.partition(form.decimal)
        first, *groups = head.split(form.thousands)
        plain = head.replace(form.thousands, "") + mark + tail
        if any(len(group) != 3 for group in groups) or len(first.lstrip("+-")) > 3:
            plain = "?"
    try:
        value = float(plain.replace(form.decimal, ".") if "_" not in plain else "?")
    except ValueError:
        raise ReadError(f"{where}: expected a number, got '{text.strip()[:40]}'") from None
    if not math.isfinite(value):
        raise ReadError(f"{where}: expected a finite number, got '{text.strip()[:40]}'")
    return value


def is_number(cell: str) -> bool:
    """Tell whether a cell reads as a number."""
    return bool(cell) and bool(_DIGITS.fullmatch(_plain(cell)))


def read_columns(
    where: Path | str, rows: list[tuple[int, list[str]]], columns: dict[str, int],
    width: int | None = None, delimiter: str = ",",
) -> dict[str, np.ndarray]:  # fmt: skip
    """Parse numbered rows of cells into columns (n_rows,) of finite numbers, by name.

    Every row must have ``width`` cells, or enough for all columns (numbers from 0). Raises
    ReadError naming line and column.
    """
    if len(rows) < 2:
        raise ReadError(f"{where}: expected at least two rows of samples, found {len(rows)}")
    needed = max(columns.values()) + 1
    for line, cells in rows:
        if len(cells) < needed or (width is not None and len(cells) != width):
            raise ReadError(
                f"{where}, line {line}: expected {width or needed} columns, found {len(cells)}"
            )
    texts = {name: [cells[column] for _, cells in rows] for name, column in columns.items()}
    form = number_format(str(where), [*texts.values()], delimiter)

    def where_of(name):
        return lambda k: f"{where}, line {rows[k][0]}, column '{name}'"

    return {name: numbers_of(column, form, where_of(name)) for name, column in texts.items()}


def numbers_of(texts, form, where_of):
    """Return finite numbers of a column; ``where_of`` names the row of a message."""
    if not form.thousands and "_" not in "\n".join(texts):
        try:
            point = form.decimal == "."
            plain = texts if point else [text.replace(form.decimal, ".") for text in texts]
            values = np.array(list(map(float, plain)))
        except ValueError:
            values = np.array([np.nan])
        if np.isfinite(values).all():
            return values
    return np.array([number(text, where_of(k), form) for k, text in enumerate(texts)])


_DATA = tomllib.loads(
    resources.files("pyblast.readers").joinpath("titles.toml").read_text(encoding="utf-8")
)
_UNITS = {word: name for name, words in _DATA["units"].items() for word in words.split()}
_IN_BRACKETS = {"t", "min"}  # units only there, other words elsewhere
HARMLESS = frozenset(_DATA["harmless"].split())
TOTALS = frozenset(_DATA["totals"].split())


class Quantity(NamedTuple):
    """Quantity that is wanted of a table: titles, units, and which of two titles says it.

    ``units`` are suffixes of keys, the first for examples; none for text, "*" for any.
    ``default`` is taken where the title has none. Words ``says`` in a title say that it is this
    quantity ("actual"), ``version`` another one ("design"), ``part`` a part of it ("booster").
    A table must have what is ``needed``, every row what is a ``key`` unless it is a total. What
    ``adds`` can't be repeated over merged cells, a ``clock`` may hold times of day, rows with a
    bound such as "<0.5" are left out where ``bounded``.
    """

    words: str
    units: tuple[str, ...] = ()
    default: str = ""
    needed: bool = False
    key: bool = False
    says: str = ""
    version: str = ""
    part: str = ""
    adds: bool = False
    clock: bool = False
    bounded: bool = False


SAYS, PLAIN, VERSION, PART = 3, 2, 1, 0


class Title(NamedTuple):
    """Title of a column: its quantity, empty where unknown, the unit as written, and its rank."""

    quantity: str
    unit: str = ""
    rank: int = PLAIN


class Wanted:
    """Quantities that are wanted of a table, by name, with an index of their titles."""

    def __init__(self, quantities: Mapping[str, Quantity]) -> None:
        self.quantities = dict(quantities)
        self.words: dict[str, list[str]] = {}
        for name, q in quantities.items():
            for word in q.words.split():
                self.words.setdefault(plain_word(word), []).append(name)
        self.ranks = {
            (name, plain_word(word)): rank
            for name, q in quantities.items()
            for rank, words in ((SAYS, q.says), (VERSION, q.version), (PART, q.part))
            for word in words.split()
        }

    def title(self, text: str) -> Title:
        """Split the title of a column into quantity, unit and rank.

        Examples
        --------
        >>> wanted_by("holes").title("Actual charge (kg)")
        Title(quantity='charge', unit='kg', rank=3)
        >>> wanted_by("holes").title("Bench height (m)").quantity
        ''
        """
        titles = []
        for stem, unit in title_splits(" ".join(text.strip().strip('"').split())):
            for name, rank in self._named(stem, unit):
                titles.append(Title(name, unit, rank))
                if unit_name(unit) in self.quantities[name].units:
                    return titles[-1]
        titles.sort(key=lambda t: bool(t.unit) and self.quantities[t.quantity].units != ("*",))
        return titles[0] if titles else Title("")

    def _named(self, stem, unit):
        """Return the quantities of a title without its unit, and how well the title says them."""
        whole = plain_word(stem)
        if whole in self.words:
            return [(name, self.ranks.get((name, whole), PLAIN)) for name in self.words[whole]]
        words = re.split(r"[\W_]+", re.sub(r"(?<=[^\W\d_A-Z])(?=[A-Z])", " ", stem))
        words = [w for w in map(plain_word, words) if w and w not in HARMLESS]
        matches = [
            (name, rank)
            for name in self.quantities
            if (rank := self._rank(name, words, unit)) is not None
        ]
        return matches if len(matches) == 1 else []

    def _rank(self, name, words, unit):
        """Return how well words say a quantity, None where one of them says something else."""
        ranks = [self.ranks[name, w] for w in words if (name, w) in self.ranks]
        rest = [w for w in words if (name, w) not in self.ranks]
        joined = "".join(rest or words)
        known = [name in self.words.get(w, ()) for w in rest or words]
        if rest and not (name in self.words.get(joined, ()) or all(known)):
            return None
        if not rest and not any(known) and name not in self.words.get(joined, ()) and not (
            ranks and unit_name(unit) in self.quantities[name].units
        ):  # fmt: skip
            return None
        ranks += [self.ranks[name, joined]] if (name, joined) in self.ranks else []
        return PART if PART in ranks else max(ranks, default=PLAIN)


@cache
def wanted_by(door: str) -> Wanted:
    """Return the quantities that a door wants, by a table of ``titles.toml``."""
    quantities = {}
    for name, entry in _DATA[door].items():
        if like := entry.pop("like", ""):
            words = _DATA[door][like]["words"].split()
            beside = _DATA["toe"].split()
            entry["words"] = " ".join(f"{w}{t} {t}{w}" for w in words for t in beside)
        entry["units"] = tuple(entry.get("units", ()))
        quantities[name] = Quantity(**entry)
    return Wanted(quantities)


def plain_word(text: str) -> str:
    """Write a title in lower case without accents, blanks and signs: "Höhe [m]" is "hohem"."""
    spread = unicodedata.normalize("NFKD", text.replace("ı", "i").replace("ł", "l").casefold())
    return "".join(c for c in spread if c.isalnum())


def unit_name(text: str) -> str:
    """Return a unit as the suffix of a key, such as "mm_per_s" for "mm/sec"; "" if unknown."""
    plain = text.strip()
    if plain in FACTORS or plain == "Nm_per_s":
        return plain
    plain = plain.lower().replace("µ", "u").replace("μ", "u").replace("²", "2").replace("³", "3")
    plain = re.sub(r"^(\w+)[ .*·]?s\^?[-−]1$", r"\1/s", plain)
    parts = [_UNITS.get(part, part) for part in re.split(r"\s*/\s*|_per_| per ", plain)]
    name = "_per_".join(parts)
    return name if name in FACTORS or name == "deg" else ""


def unit_factor(symbol: str, where: str) -> float:
    """Return the SI factor of a printed unit such as ``mm/s`` or of a suffix like ``mm_per_s``."""
    name = unit_name(symbol)
    if name not in FACTORS:
        raise ReadError(f"{where}: unknown unit '{symbol[:40]}', expected one such as mm/s or in/s")
    return FACTORS[name]


def title_splits(text: str) -> Iterator[tuple[str, str]]:
    """Yield the ways to split a title into stem and unit."""
    for match in reversed([*re.finditer(r"[\[(]\s*([^\[(\])]*?(?:\([^)]*\))?)\s*[\])]", text)]):
        yield f"{text[: match.start()]} {text[match.end() :]}".strip(" _,:/"), match[1]
    for unit in ("Nm_per_s", "deg", *sorted(FACTORS, key=len, reverse=True)):
        if text.endswith(f"_{unit}") or text.lower().endswith(f"_{unit}"):
            yield text[: -len(unit) - 1], unit
    head, _, tail = text.rpartition(" ")
    if head and (unit_name(tail) or is_pressure(tail)) and tail.lower() not in _IN_BRACKETS:
        yield head.rstrip(" ,:/-"), tail
    yield text, ""


def title_unit(text: str) -> str:
    """Return the unit in the title of a column, whatever its quantity; "" if it has none."""
    return next((unit_name(unit) for _, unit in title_splits(text) if unit_name(unit)), "")


def listed(names: Sequence[str]) -> str:
    """List at most eight names."""
    more = f" and {len(names) - 8} more" if len(names) > 8 else ""
    return ", ".join(names[:8]) + more


def is_pressure(text: str) -> bool:
    """Tell whether a text is a unit of air overpressure, decibels included."""
    return bool(re.match(r"(?i)(k?pa|h?pa|m?bar|mb|psi|db)\b", text.strip()))
