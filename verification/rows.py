"""Rows of a study: computed one by one, stored as they come, continued where a study stopped."""

import fcntl
import hashlib
import json
import signal
import sys
import time
from collections.abc import Callable, Iterable
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

from benchmarks.timing import stamp
from pyblast.errors import PyblastError
from pyblast.files import write_text

from .markdown import between

ROOT = Path(__file__).resolve().parents[1]
Rows = dict[str, dict[str, Any]]


def each_row(
    path: Path,
    names: Iterable[str],
    job: Callable[[str], dict[str, Any]],
    minutes: float | None = None,
    again: bool = False,
) -> Rows:
    """Compute the missing rows of a study; return all that the file holds.

    Each row is stored as soon as it is computed, with the machine, its load, the date and the
    digest of the program. A study that was stopped, by a signal too, goes on with the next call;
    several processes may share a file if each computes names of its own.

    Parameters
    ----------
    path : Path
        JSON file, an object of rows by name; absent at first.
    names : iterable of str
        Of the rows to compute, in this order. Those that the file holds are left out.
    job : callable
        Takes a name, returns its row.
    minutes : float, optional
        After which no further row is begun.
    again : bool
        Compute the rows that the file holds, too.

    Raises
    ------
    SystemExit
        After the last row, if a job raised a PyblastError, with the names; by SIGTERM, with 143.
    """
    ends = float("inf") if minutes is None else time.monotonic() + 60.0 * minutes
    failed = []
    with ended_by_sigterm():
        for name in names:
            if not again and name in read_rows(path):
                continue
            if time.monotonic() > ends:
                print(f"{path.stem}: {minutes:g} min are over; the same command goes on from here")
                break
            try:
                row = {**job(name), **stamp(), "program": program()}
            except PyblastError as error:
                failed.append(name)
                print(f"{path.stem}: no row for {name}: {error}", file=sys.stderr, flush=True)
                continue
            _store(path, name, row)
            print(f"{name}: {json.dumps(row)}", flush=True)
    if failed:
        sys.exit(f"{path.stem}: no row for {', '.join(failed)}, see above")
    rows = read_rows(path)
    older = [name for name, row in rows.items() if row.get("program") != program()]
    if older:
        print(f"{path.stem}: {len(older)} of {len(rows)} rows are of another state of the program")
    return rows


def read_rows(path: Path) -> Rows:
    """Return the rows that a file holds, none where there is no file."""
    return json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}


def options(arguments: list[str]) -> tuple[list[str], dict[str, Any]]:
    """Take ``--again`` and ``--minutes N`` from arguments; return the others and these by name."""
    others, found = [], {}
    waiting = iter(arguments)
    for argument in waiting:
        if argument == "--again":
            found["again"] = True
        elif argument == "--minutes":
            found["minutes"] = float(next(waiting, "nan"))
        else:
            others.append(argument)
    if not found.get("minutes", 1.0) > 0.0:
        sys.exit("--minutes: needs a positive number")
    return others, found


def draws(
    arguments: list[str], seed: int, count: int, minutes: float
) -> tuple[int, int, dict[str, Any]]:
    """Take ``[COUNT] [--seed N] [--again] [--minutes N]`` of a study that draws what it computes.

    Parameters
    ----------
    arguments : list of str
    seed, count, minutes : where the arguments give none

    Returns
    -------
    seed, count : int
    limits : dict
        For `each_row`.
    """
    others, limits = options(arguments)
    numbers = [int(word) for word in others if word != "--seed"]
    if "--seed" in others:
        seed = numbers.pop(others.index("--seed"))
    return seed, numbers[0] if numbers else count, {"minutes": minutes} | limits


def study(
    arguments: list[str],
    names: Iterable[str],
    measured: Callable[[str], dict[str, Any]],
    table: Callable[[Rows], list[str]],
    out: Path,
    page: Path,
    marks: tuple[str, str],
) -> None:
    """Measure the rows of a study, ``[NAME ...] [--page] [--again] [--minutes N]``, and its table.

    Parameters
    ----------
    arguments : list of str
        Names of rows, all by default; ``--page``: only the table, of the rows that are there.
    names : iterable of str
    measured, table : callable
        The row of a name, and the lines of all rows.
    out, page : Path
        Of the rows, and of the page that holds the table.
    marks : tuple of 2 str
        Lines of the page before and after the table.
    """
    chosen, limits = options(arguments)
    chosen, known = [word for word in chosen if word != "--page"], list(names)
    for name in chosen:
        if name not in known:
            sys.exit(f"{out.stem}: no row {name!r}; there are {'; '.join(known)}")
    only_page = "--page" in arguments
    rows = read_rows(out) if only_page else each_row(out, chosen or known, measured, **limits)
    write_text(page, between(page.read_text(encoding="utf-8"), marks, table(rows)))


@cache
def program() -> str:
    """Return a digest of the source of the program: Python, its tables and Fortran."""
    digest = hashlib.sha256()
    package = (file for kind in ("*.py", "*.toml") for file in (ROOT / "pyblast").rglob(kind))
    files = [*package, *(ROOT / "fortran").iterdir()]
    for file in sorted(file for file in files if file.is_file()):
        digest.update(str(file.relative_to(ROOT)).encode())
        digest.update(file.read_bytes())
    return digest.hexdigest()[:12]


def _store(path, name, row):
    """Add a row to the file, which other processes may have changed meanwhile."""
    with Path(__file__).open() as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        rows = read_rows(path) | {name: row}
        write_text(path, json.dumps(dict(sorted(rows.items())), indent=1) + "\n")


@contextmanager
def ended_by_sigterm():
    """Let SIGTERM raise SystemExit, so that pools and temporary folders are cleared away."""
    before = signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
