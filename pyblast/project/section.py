"""Strictness and ranges shared by all tables of a project file; plain tables with units."""

from contextlib import contextmanager
from typing import Annotated

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from ..errors import InputError, ReadError
from ..model.source import TimeFunction
from ..signals.limits import load_limits
from ..units import to_si

Positive = Annotated[float, Field(gt=0.0)]
NotNegative = Annotated[float, Field(ge=0.0)]
Fraction = Annotated[float, Field(ge=0.0, le=1.0)]
Quality = Annotated[float, Field(ge=2.0)]
Count = Annotated[int, Field(ge=1)]
Dip = Annotated[float, Field(ge=0.0, le=90.0)]
Bearing = Annotated[float, Field(ge=-360.0, le=360.0)]
Inclination = Annotated[float, Field(ge=0.0, le=180.0)]
FrictionAngle = Annotated[float, Field(ge=0.0, lt=89.0)]
Point = Annotated[list[float], Field(min_length=3, max_length=3)]
Place = Annotated[list[float], Field(min_length=2, max_length=3)]
Size = Annotated[list[Positive], Field(min_length=3, max_length=3)]
Span = Annotated[list[float], Field(min_length=2, max_length=2)]
Box = Annotated[list[Span], Field(min_length=3, max_length=3)]
Band = Annotated[
    list[Positive], Field(min_length=2, max_length=2), AfterValidator(lambda band: _rising(band))
]
Infill = Annotated[list[Positive], Field(min_length=1, max_length=2)]
Name = Annotated[str, Field(min_length=1, max_length=80)]
Curve = Annotated[str, AfterValidator(lambda key: _known(key))]


class Section(BaseModel):
    """One table of a project file: strict types, no unknown keys."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True, allow_inf_nan=False)

    def _one_of(self, *choices):
        """Raise an error unless exactly one group of keys is given, and given whole."""
        begun = [c for c in choices if any(getattr(self, key) is not None for key in c)]
        if len(begun) != 1:
            raise ValueError(f"give one of {'; '.join(' and '.join(c) for c in choices)}")
        missing = [key for key in begun[0] if getattr(self, key) is None]
        if missing:
            raise ValueError(f"{missing[0]} is missing beside {begun[0][0]}")


@contextmanager
def named_error(where):
    """Put a place of the project file before the message of an error in it or in its files."""
    try:
        yield
    except (InputError, ReadError) as error:
        raise type(error)(f"{where}: {error}") from None


def _known(key):
    """Refuse a limit curve that does not come with pyblast."""
    if key not in load_limits():
        raise ValueError(f"must be one of {', '.join(load_limits())}, got {key!r}")
    return key


def _rising(band):
    """Refuse a band that does not rise."""
    if not band[0] < band[1]:
        raise ValueError(f"must rise from the lowest to the highest frequency, got {band}")
    return band


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


class RecordingConfig(Section):
    """A recorded seismogram: a file and what it does not say itself."""

    file: str
    format: str | None = None
    record: Count = 1
    mapping: str | None = None
    bearing_deg: Bearing | None = None
    full_scale_mm_per_s: Positive | None = None
    unit: str | None = None
    start_s: float | None = None
