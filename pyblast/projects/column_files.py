"""Plain tables of numbers whose first line names columns and units."""

import numpy as np

from ..errors import ReadError
from ..solving.sources import TimeFunction
from ..units import to_si

MAX_BYTES = 100_000_000
LEAST_SAMPLES = 4


def read_columns(path, heads):
    """Read a table of numbers in columns that commas separate.

    Parameters
    ----------
    path : path
    heads : tuple of str
        First lines that are permitted, such as ``("time_s,force_n", "time_s,force_kn")``.

    Returns
    -------
    (n, n_columns) float64, SI

    Raises
    ------
    ReadError
        If the file can't be read, begins otherwise, or a line holds something else than numbers.
    """
    try:
        if path.stat().st_size > MAX_BYTES:
            raise ReadError(f"{path}: a table has at most 100 MB, this one is larger")
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except UnicodeDecodeError:
        raise ReadError(f"{path}: must be UTF-8 text; save it as CSV") from None
    except OSError as error:
        if isinstance(error, ReadError):
            raise
        raise ReadError(f"{path}: can't be read ({error.strerror or error})") from None
    head = lines[0].replace(" ", "") if lines else ""
    if head not in heads:
        raise ReadError(f"{path}, line 1: must be {' or '.join(heads)}")
    names = head.split(",")
    rows = [
        _numbers(path, number, line, len(names))
        for number, line in enumerate(lines[1:], start=2)
        if line.strip()
    ]
    factors = np.array([to_si(name, 1.0)[1] for name in names])
    return np.array(rows).reshape(-1, len(names)) * factors


def _numbers(path, number, line, count):
    """Return the numbers of one line."""
    try:
        values = [float(word) for word in line.split(",")]
    except ValueError:
        values = []
    if len(values) != count or not np.isfinite(values).all():
        words = {2: "two", 3: "three"}[count]
        raise ReadError(f"{path}, line {number}: must be {words} numbers, got {line[:40]!r}")
    return values


def read_time_function(path, heads) -> TimeFunction:
    """Read a function of time: a table of evenly spaced times and values.

    Raises
    ------
    ReadError
        If the table can't be read, is shorter than four lines or not evenly spaced.
    """
    table = read_columns(path, heads)
    if len(table) < LEAST_SAMPLES:
        raise ReadError(
            f"{path}: needs at least {LEAST_SAMPLES} lines of numbers, got {len(table)}"
        )
    times, values = table.T
    steps = np.diff(times)
    dt = (times[-1] - times[0]) / len(steps)
    uneven = np.flatnonzero(np.abs(steps - dt) > 1e-3 * abs(dt))
    if not dt > 0.0 or len(uneven):
        where = 2 + int(uneven[0]) if len(uneven) else 1
        raise ReadError(
            f"{path}: times must grow by equal steps, but between the numbers {where - 1} and "
            f"{where} they change by {steps[where - 2]:g} s"
        )
    return TimeFunction(values, float(dt), float(times[0]))
