"""One module a command: files in, a numbered folder out.

Here is the rule for folders that all commands share: results lie in folders 001, 002, … of one
folder; a finished result is never changed. The same command goes on with an unfinished result of
the same input, unless ``fresh`` is set.
"""

import csv
import io
import math
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from ..errors import InputError, PyblastError, ReadError
from ..files import write_bytes, write_text

LARGEST_FOLDER = 9999
LONGEST_NAME = 31  # characters of the name of a sheet, by Excel
MOST_ROWS = 200_000  # of a table that is written as a sheet; longer ones are left to their CSV
Progress = Callable[[str, int, int], None]
Say = Callable[[str], None]


class Interrupted(KeyboardInterrupt):
    """A computation was stopped; the message says what is kept."""


def silent(*_: object) -> None:
    """Show nothing: the progress or notice of a call that asked for none."""


def new_folder(out: str | Path) -> Path:
    """Make the next numbered folder; two processes at once get two folders.

    Raises
    ------
    ReadError
        If the place can't be written.
    InputError
        If there are too many results already.
    """
    for number in range(1, LARGEST_FOLDER):
        folder = Path(out) / f"{number:03d}"
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            continue
        except OSError as error:
            raise ReadError(f"{folder}: can't be made ({error.strerror or error})") from None
        return folder
    raise InputError(f"{out}: holds {LARGEST_FOLDER} results already; give another folder")


def numbered_folders(out: str | Path) -> list[Path]:
    """Return the numbered folders of a folder, the latest first."""
    folders = [path for path in Path(out).glob("[0-9][0-9][0-9]*") if path.name.isdigit()]
    return sorted(folders, key=lambda path: int(path.name), reverse=True)


@contextmanager
def result_folder(
    out: str | Path,
    unfinished: Callable[[Path], bool],
    *,
    fresh: bool = False,
    say: Say | None = None,
) -> Iterator[tuple[Path, bool]]:
    """Open the folder of one result: an unfinished one of the same input, else a new one.

    Parameters
    ----------
    out : path
        Folder of the numbered folders.
    unfinished : callable
        Whether a numbered folder holds an unfinished result of the same input.
    fresh : bool
        Always make a new folder.
    say : callable, optional
        Gets the sentence that a result goes on.

    Yields
    ------
    folder : Path
        Locked against other processes; one that is still empty after an error is removed.
    goes_on : bool

    Raises
    ------
    InputError, ReadError
        As `new_folder`.
    """
    folder, lock = None, None
    for candidate in [] if fresh else numbered_folders(out):
        if unfinished(candidate):
            lock = _lock(candidate)
            if lock is not None:
                folder = candidate
                (say or silent)(f"goes on with the unfinished result in {folder}; "
                                "--fresh would start anew")  # fmt: skip
                break
    goes_on = folder is not None
    if folder is None:
        folder = new_folder(out)
        lock = _lock(folder)
    try:
        yield folder, goes_on
    except PyblastError:
        with suppress(OSError):
            folder.rmdir()  # refuses unless it is empty
        raise
    finally:
        if lock is not None and lock >= 0:
            os.close(lock)


def _lock(folder: Path) -> int | None:
    """Lock a folder for this process; None where another process holds it, -1 without locks."""
    try:
        import fcntl
    except ImportError:
        return -1
    handle = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(handle)
        return None
    except OSError:  # a file system without locks
        os.close(handle)
        return -1
    return handle


def csv_table(heads: Sequence[str], rows: Iterable[Sequence]) -> str:
    """Return a table as CSV: six digits, an empty cell where a value is missing.

    Examples
    --------
    >>> print(csv_table(["name", "ppv_mm_per_s"], [["house, north", 1.25], ["barn", None]]))
    name,ppv_mm_per_s
    "house, north",1.25
    barn,
    <BLANKLINE>
    """
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(heads)
    writer.writerows([_cell(value) for value in row] for row in rows)
    return buffer.getvalue()


def _cell(value) -> str:
    """Write one value of a table."""
    if value is None or isinstance(value, str):
        return value or ""
    number = float(value)
    return f"{number:.6g}" if math.isfinite(number) else ""


def write_tables(folder: Path, tables: Mapping[str, str]) -> None:
    """Write each table as ``NAME.csv``, and all of them into the workbook ``tables.xlsx``."""
    for name, text in tables.items():
        write_text(folder / f"{name}.csv", text)
    write_bytes(folder / "tables.xlsx", workbook_of(tables))


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
