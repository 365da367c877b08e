"""Peaks of many blasts from a CSV table: distance, charge in 8 ms, peak velocity."""

import csv
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..errors import ReadError
from ..units import FACTORS, split_key

LARGEST_FILE = 50_000_000
WANTED = ("distance", "charge", "ppv")


class SiteRecords(NamedTuple):
    """Distances (n,) m, charges in 8 ms (n,) kg, and peak velocities (n,) m/s."""

    distance: np.ndarray
    charge: np.ndarray
    ppv: np.ndarray


def read_site_records(path) -> SiteRecords:
    """Read columns such as ``distance_m, charge_kg, ppv_mm_per_s``; others are left alone.

    Parameters
    ----------
    path : str or Path
        CSV with a header; the unit is in the name of the column.

    Returns
    -------
    SiteRecords

    Raises
    ------
    ReadError
        If a column is missing, twice there or without a unit, or a value is no number.
    """
    path = Path(path)
    if not path.is_file():
        raise ReadError(f"{path}: no such file")
    if path.stat().st_size > LARGEST_FILE:
        raise ReadError(f"{path.name}: larger than {LARGEST_FILE // 10**6} MB, no table of peaks")
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
        rows = [(n, row) for n, row in enumerate(csv.reader(lines), 1) if any(map(str.strip, row))]
    except (UnicodeDecodeError, csv.Error) as error:
        raise ReadError(f"{path.name}: no CSV in UTF-8, {error}") from None
    if len(rows) < 2:
        raise ReadError(f"{path.name}: needs a header and records below it")
    columns = [_column(path, [name.strip() for name in rows[0][1]], stem) for stem in WANTED]
    values = [[_number(path, line, row, *column) for column in columns] for line, row in rows[1:]]
    return SiteRecords(*np.array(values).T)


def _column(path, names, stem):
    """Return name, place and factor of the column of a quantity."""
    found = [name for name in names if split_key(name)[0] == stem and split_key(name)[1] in FACTORS]
    if len(found) != 1:
        raise ReadError(
            f"{path.name}: needs one column {stem} with its unit, such as distance_m, charge_kg, "
            f"ppv_mm_per_s; got {', '.join(names[:12])}"
        )
    return found[0], names.index(found[0]), FACTORS[split_key(found[0])[1]]


def _number(path, line, row, name, place, factor):
    """Return one value in SI."""
    text = row[place].strip() if place < len(row) else ""
    try:
        return factor * float(text)
    except ValueError:
        raise ReadError(f"{path.name}: line {line}: {name} is no number: {text[:40]!r}") from None
