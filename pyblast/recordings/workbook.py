"""Excel workbooks: a sheet read as lines of CSV, and tables written as sheets."""

import csv
import io
import math
import zipfile
from collections.abc import Mapping
from datetime import date, datetime, time
from pathlib import Path
from typing import Any

from ..errors import InputError, ReadError

MAGIC = b"PK\x03\x04"
LARGEST_UNPACKED = 500_000_000  # bytes of all parts of a workbook
LONGEST_NAME = 31  # characters of the name of a sheet, by Excel
MOST_ROWS = 200_000  # of a table that is written as a sheet; longer ones are left to their CSV


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


def workbook_of(tables: Mapping[str, str]) -> bytes:
    """Return an Excel workbook with one sheet for each table of CSV.

    Parameters
    ----------
    tables : mapping of str to str
        Name of the sheet (cut to 31 characters) to comma-separated text whose first row holds the
        heads. Cells that read as finite numbers become numbers; no cell becomes a formula.

    Returns
    -------
    bytes
        Tables of more than 200 000 rows are left out.
    """
    import openpyxl
    from openpyxl.cell import WriteOnlyCell
    from openpyxl.styles import Font

    book = openpyxl.Workbook(write_only=True)
    used: set[str] = set()
    for name, text in tables.items():
        rows = list(csv.reader(io.StringIO(text, newline="")))
        if len(rows) > MOST_ROWS:
            continue
        sheet = book.create_sheet(_sheet_name(name, used))
        sheet.freeze_panes = "A2"
        for n, row in enumerate(rows):
            cells = [WriteOnlyCell(sheet) for _ in row]
            for cell, value in zip(cells, map(_value, row), strict=True):
                cell.value = value
                if isinstance(value, str):
                    cell.data_type = "s"
                if n == 0:
                    cell.font = Font(bold=True)
            sheet.append(cells)
    if not used:
        book.create_sheet("empty")
    buffer = io.BytesIO()
    book.save(buffer)
    return buffer.getvalue()


def _sheet_name(name, used):
    """Return a name that Excel allows and no other sheet has."""
    clean = "".join("_" if c in "[]:*?/\\'" else c for c in name)[:LONGEST_NAME] or "table"
    unique, n = clean, 1
    while unique.lower() in used:
        n += 1
        unique = f"{clean[: LONGEST_NAME - 4]} {n}"
    used.add(unique.lower())
    return unique


def _value(text) -> Any:
    """Return a number where a cell reads as one, its text otherwise."""
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if text == "" or "_" in text or not math.isfinite(number):
        return "".join(c for c in text if c >= " ") or None
    return number
