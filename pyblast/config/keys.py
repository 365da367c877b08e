"""Keys of project files: unit, range and usual values of each, from the types of the tables."""

import math
from collections.abc import Iterator
from functools import cache
from typing import Annotated, Literal, NamedTuple, get_args, get_origin

import numpy as np
from pydantic import AfterValidator, BaseModel, Field

from ..blasts.published_laws import BY_NAME
from ..core import JOINT_LAWS
from ..errors import Finding
from ..signals.comparison import load_limits
from ..units import FACTORS, STEEPEST, plain_number, split_key, to_si

# Smallest positive value and largest magnitude of a number, by the unit in which a key ends.
RANGES = {
    "m": (1e-6, 1e6),
    "mm": (1e-6, 1e6),
    "s": (1e-9, 1e5),
    "ms": (1e-6, 1e6),
    "hz": (1e-6, 1e8),
    "m_per_s": (1e-6, 2e4),  # waves in diamond have 18000
    "mm_per_s": (1e-12, 1e7),
    "m_per_s2": (1e-6, 1e4),  # centrifuges
    "kg": (1e-9, 1e8),
    "kg_per_m3": (1e-3, 25000.0),  # osmium has 22590
    "pa": (1e-6, 2e12),
    "kpa": (1e-9, 2e9),
    "mpa": (1e-12, 2e6),  # diamond has 1.2e6
    "pa_per_m": (1e-3, 1e18),
    "mpa_per_m": (1e-9, 1e12),
    "gpa_per_m": (1e-12, 1e9),
    "pa_s_per_m": (1e-3, 1e15),
    "mpa_s_per_m": (1e-9, 1e9),
    "percent": (1e-9, 1000.0),
    "deg": (1e-9, 360.0),
    "angle_deg": (1e-9, 360.0),
    "": (1e-12, 1e18),
}


class Usual(NamedTuple):
    """Smallest and largest usual value of a key, in its unit: beyond is likely another unit."""

    low: float
    high: float


Positive = Annotated[float, Field(gt=0.0)]
NotNegative = Annotated[float, Field(ge=0.0)]
Fraction = Annotated[float, Field(ge=0.0, le=1.0)]
Quality = Annotated[float, Field(ge=2.0, le=1e6)]
Density = Annotated[Positive, Usual(300.0, 9000.0)]
Modulus = Annotated[Positive, Usual(0.1, 5e5)]
STIFFNESSES = {"kn": Usual(1e5, 1e14), "ks": Usual(1e4, 1e14)}  # Pa/m, of joints
SPEEDS = Usual(50.0, 12000.0)  # m/s, of waves
Speed = Annotated[Positive, SPEEDS]
Charge = Annotated[Positive, Usual(1e-6, 1e5)]  # of a hole, kg
Radius = Annotated[Positive, Usual(0.02, 20.0)]  # of a hole
Peak = Annotated[Positive, Usual(5e-3, 1e3)]  # time to the peak of a pulse, ms
Exponent = Annotated[float, Field(ge=0.0, le=10.0)]  # of distance
ChargeExponent = Annotated[float, Field(ge=0.0, le=2.0)]
Factor = Annotated[float, Field(gt=0.0, le=1e6)]
Share = Annotated[float, Field(ge=0.0, lt=1.0)]
Count = Annotated[int, Field(ge=1, le=1_000_000)]
Seed = Annotated[int, Field(ge=0)]
Dip = Annotated[float, Field(ge=0.0, le=90.0)]
Bearing = Annotated[float, Field(ge=-360.0, le=360.0)]
Inclination = Annotated[float, Field(ge=0.0, le=180.0)]
FrictionAngle = Annotated[float, Field(ge=0.0, le=STEEPEST)]
Coordinate = Annotated[float, Field(ge=-1e8, le=1e8)]  # m; national grids have up to 5e7
Point = Annotated[list[Coordinate], Field(min_length=3, max_length=3)]
Place = Annotated[list[Coordinate], Field(min_length=2, max_length=3)]
Size = Annotated[list[Positive], Field(min_length=3, max_length=3)]
Span = Annotated[list[float], Field(min_length=2, max_length=2)]
Sides = Annotated[list[Coordinate], Field(min_length=2, max_length=2)]
Box = Annotated[
    list[Sides], Field(min_length=3, max_length=3), AfterValidator(lambda box: _ascending(box))
]
Band = Annotated[
    list[Positive], Field(min_length=2, max_length=2), AfterValidator(lambda band: _rising(band))
]
Infill = Annotated[list[Positive], Field(min_length=1, max_length=2)]
Name = Annotated[str, Field(min_length=1, max_length=80)]
Curve = Annotated[str, AfterValidator(lambda key: _known(key))]
Law = Annotated[str, AfterValidator(lambda name: _published(name))]


class Range(NamedTuple):
    """Range of the numbers of a key in its unit, whether its ends belong to it, and usual values.

    ``unit`` is the suffix of the key, see `pyblast.units.FACTORS`.
    """

    unit: str
    low: float
    high: float
    with_low: bool = True
    with_high: bool = True
    usual: Usual | None = None

    def check(self, value: float) -> None:
        """Raise ValueError for a number beyond the range."""
        if not (self.low <= value if self.with_low else self.low < value):
            raise ValueError(f"must be at least {plain_number(self.low, 6)}, got {value:g}")
        if not (value <= self.high if self.with_high else value < self.high):
            raise ValueError(f"must be at most {plain_number(self.high, 6)}, got {value:g}")


@cache
def range_of_key(section: type[BaseModel], key: str) -> Range | None:
    """Return the range of a key from its type and its unit; None where it holds no numbers."""
    field = section.model_fields[key]
    marks = [*_marks(field.annotation), *field.metadata]
    if not _is_numeric(field.annotation):
        return None
    unit = split_key(key)[1]
    smallest, largest = RANGES[unit]
    bounds = {
        name: getattr(mark, name)
        for mark in marks
        for name in ("gt", "ge", "lt", "le")
        if getattr(mark, name, None) is not None
    }
    low = bounds.get("ge", bounds.get("gt", -largest))
    high = bounds.get("le", bounds.get("lt", largest))
    usual = [mark for mark in marks if isinstance(mark, Usual)]
    positive = bounds.get("gt") == 0.0
    return Range(unit, smallest if positive else low, high, positive or "gt" not in bounds,
                 "lt" not in bounds, usual[-1] if usual else None)  # fmt: skip


def _marks(annotation):
    """Yield what an annotation says of its numbers, at every depth, the innermost first."""
    for part in get_args(annotation):
        yield from _marks(part)
        yield from getattr(part, "metadata", [part] if isinstance(part, Usual) else ())


def _is_numeric(annotation):
    """Tell whether an annotation holds numbers."""
    parts = get_args(annotation)
    return annotation in (int, float) or (
        get_origin(annotation) is not Literal and any(map(_is_numeric, parts))
    )


def numbers_in(value) -> Iterator[float]:
    """Yield the numbers of a value: itself, or those of a list at every depth."""
    if isinstance(value, list):
        for part in value:
            yield from numbers_in(part)
    elif type(value) in (int, float):
        yield value


def section_in(annotation):
    """Return the section class inside an annotation such as ``dict[str, X]`` or ``X | None``."""
    if hasattr(annotation, "model_fields"):
        return annotation
    for part in getattr(annotation, "__args__", ()):
        section = section_in(part)
        if section is not None:
            return section
    return None


def _known(key):
    """Refuse a limit curve that does not come with pyblast."""
    if key not in load_limits():
        raise ValueError(f"must be one of {', '.join(load_limits())}, got {key!r}")
    return key


def _published(name):
    """Refuse a law that is not among those of pyblast."""
    if name not in BY_NAME:
        raise ValueError(f"must be one of {', '.join(BY_NAME)}, got {name!r}")
    return name


def _rising(band):
    """Refuse a band that does not rise."""
    if not band[0] < band[1]:
        raise ValueError(f"must rise from the lowest to the highest frequency, got {band}")
    return band


def _ascending(box):
    """Refuse a box that ends before it begins."""
    for axis, (low, high) in zip("xyz", box, strict=True):
        if not low < high:
            raise ValueError(
                f"needs low below high on each axis, got {low:g} and {high:g} for {axis}"
            )
    return box


def keys(section: type[BaseModel], path: str = "") -> dict[str, Range]:
    """Return the range of each key of a table and of those within it that holds numbers.

    Parameters
    ----------
    section : class of a table, such as ``Config``
    path : str
        Dotted path of the table; names of materials, joints and entries of lists are left out.

    Examples
    --------
    >>> from pyblast.config.config import Config
    >>> result = keys(Config)["materials.density_kg_per_m3"]
    >>> result.unit, result.high, result.usual
    ('kg_per_m3', 25000.0, Usual(low=300.0, high=9000.0))
    """
    result = {}
    for name, field in section.model_fields.items():
        inner, at = section_in(field.annotation), f"{path}.{name}" if path else name
        if inner is not None:
            result |= keys(inner, at)
        elif (known := range_of_key(section, name)) is not None:
            result[at] = known
    if section.model_config.get("extra") == "allow":
        for key in [p.key for law in JOINT_LAWS.values() for p in law.properties.values()]:
            result[f"{path}.{key}"] = range_of_property(key)
    return result


def range_of_property(key: str) -> Range:
    """Return the range of a property of a joint law by its key, from its unit."""
    stem, unit = split_key(key)
    _, largest = RANGES.get(unit, RANGES[""])
    usual = None
    if stem in STIFFNESSES:
        usual = Usual(*(end / FACTORS[unit] for end in STIFFNESSES[stem]))
    return Range(unit, -largest, largest, usual=usual)


def numbers_given(section: BaseModel, path: str = "") -> Iterator[tuple[str, Range, float]]:
    """Yield path, range and value of each number of a table and of those within it."""
    extra = {key: (range_of_property(key), v) for key, v in (section.model_extra or {}).items()}
    own = {key: (range_of_key(type(section), key), getattr(section, key))
           for key in type(section).model_fields}  # fmt: skip
    for key, (known, value) in (own | extra).items():
        at = f"{path}.{key}" if path else key
        if known is not None:
            yield from ((at, known, number) for number in numbers_in(value))
        elif isinstance(value, BaseModel):
            yield from numbers_given(value, at)
        elif isinstance(value, (dict, list)):
            named = value.items() if isinstance(value, dict) else enumerate(value, start=1)
            for name, part in named:
                if isinstance(part, BaseModel):
                    yield from numbers_given(part, f"{at}.{getattr(part, 'name', name)}")


ORDINARY = 100.0  # m, ground of runs that last as long as is usual, and wider
LOOSEST, STIFFEST, WET = 1.45, 15.0, (1300.0, 2100.0)  # cp/cs of ground; cp of wet soil, m/s
SHORTEST_DELAY, SHORTEST_BLAST, LONGEST_DELAY = 0.5e-3, 10e-3, 5.0  # s


def unusual(config: BaseModel, materials=None, times=()) -> Finding | None:
    """D26: values that no ground, hole or detonator has; None where all are usual.

    Parameters
    ----------
    config : Config
    materials : dict of str to Material, optional
        The materials of the project, by the speeds that follow from their keys.
    times : (n_holes,) float64, s
        When the holes of [blast] fire.
    """
    words, numbers = [], {}
    size = config.mesh.size_m
    share = 1.0 if size is None else min(1.0, max(size) / ORDINARY)  # waves cross it sooner
    for path, known, value in numbers_given(config):
        if known.usual is None:
            continue
        low, high = (share * end if path == "run.duration_s" else end for end in known.usual)
        if not low <= value <= high:
            words.append(
                f"{path} is {plain_number(value)}, usual are {plain_number(low)} to "
                f"{plain_number(high)}"
            )
            numbers[path] = to_si(path, value)[1]
    for name, rock in (materials or {}).items():
        key = f"materials.{name}.cp_m_per_s"
        if not SPEEDS.low <= rock.cp <= SPEEDS.high and key not in numbers:
            words.append(
                f"materials.{name} cp is {rock.cp:.3g} m/s, usual are {SPEEDS.low:g} to "
                f"{SPEEDS.high:g}"
            )
            numbers[f"materials.{name} cp"] = rock.cp
        ratio = rock.cp / rock.cs if rock.cs > 0.0 else math.inf
        if ratio < LOOSEST or (ratio > STIFFEST and not WET[0] <= rock.cp <= WET[1]):
            words.append(
                f"materials.{name} cp/cs is {ratio:.3g}, usual are {LOOSEST:g} to {STIFFEST:g}"
            )
            numbers[f"materials.{name} cp/cs"] = ratio
    gap = _unusual_delay(times)
    if gap is not None:
        unit = "seconds" if gap < SHORTEST_DELAY else "microseconds"
        words.append(f"blast delays are {plain_number(1e3 * gap)} ms and more, as if in {unit}")
        numbers["blast delay"] = gap
    if not words:
        return None
    text = f"{'; '.join(words)}; units are in the keys."
    return Finding(
        "D26", "A value looks like one in another unit", text, failed=True, numbers=numbers
    )


def _unusual_delay(times) -> float | None:
    """Return the shortest delay in s if no detonators are so quick, or so slow; else None."""
    gaps = np.diff(np.unique(np.round(np.asarray(times, dtype=float), 9)))
    if not len(gaps):
        return None
    shortest = float(gaps.min())
    quick = shortest < SHORTEST_DELAY and float(gaps.sum()) < SHORTEST_BLAST
    return shortest if quick or shortest > LONGEST_DELAY else None
