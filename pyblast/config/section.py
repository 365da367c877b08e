"""Sections of a project file: strict types, dotted paths, errors in one sentence, CSV columns."""

import difflib
import re
import tomllib
from datetime import date, time
from typing import Any

import numpy as np
from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    ValidationError,
    field_validator,
    model_validator,
)

from ..errors import InputError, ReadError
from ..model.source import TimeFunction
from ..readers.cells import Wanted, wanted_by
from ..readers.provenance import ReadLog
from ..readers.tables import Rules, read_table, regular_step
from ..units import plain_number
from .keys import Bearing, Count, Name, Positive, numbers_in, range_of_key, section_in

# Control characters, ends of lines, and marks that turn the direction of writing.
UNPRINTABLE = re.compile(r"[\x00-\x1f\x7f-\x9f\u2028-\u202e\u2066-\u2069]")


def _holds(value):
    """Tell whether a value holds others: a list, or a table with names."""
    return isinstance(value, (list, dict))


class Section(BaseModel):
    """One table of a project file: strict types, no unknown keys."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True, allow_inf_nan=False)

    @field_validator("*")
    @classmethod
    def _printable(cls, value):
        """Refuse control characters, which break paths, files and terminals."""
        for text in [value] if isinstance(value, str) else value if _holds(value) else ():
            if isinstance(text, str) and UNPRINTABLE.search(text):
                raise ValueError(f"must not hold control characters, got {_shown(text)}")
        return value

    @field_validator("*")
    @classmethod
    def _within(cls, value, info):
        """Refuse numbers beyond the range of their key."""
        known = range_of_key(cls, info.field_name)
        for number in numbers_in(value) if known else ():
            known.check(number)
        return value

    def _one_of(self, *choices):
        """Raise an error unless exactly one group of keys is given, and given whole."""
        begun = [c for c in choices if any(getattr(self, key) is not None for key in c)]
        if len(begun) != 1:
            raise ValueError(f"give one of {'; '.join(' and '.join(c) for c in choices)}")
        missing = [key for key in begun[0] if getattr(self, key) is None]
        if missing:
            raise ValueError(f"{missing[0]} is missing beside {begun[0][0]}")


LEAST_SAMPLES = 4
SHORTEST_STEP = 1e-9  # s


def read_time_function(
    path, name: str, log: ReadLog | None = None, rules: Rules | None = None
) -> TimeFunction:
    """Read a function of time: a table of evenly spaced times and values.

    Parameters
    ----------
    path : path
    name : str
        Quantity: "force", "moment_rate", "moment_rate_per_kg" or "pressure".
    log : ReadLog, optional
        Takes what was read.
    rules : Rules, optional
        Of a table whose titles are not looked at.

    Raises
    ------
    ReadError
        If the table can't be read, is shorter than four lines or not evenly spaced.
    """
    curves = wanted_by("curves").quantities
    wanted = Wanted({"time": curves["time"], name: curves[name]})
    table = read_table(path, wanted, rules, log, kind=f"{name.replace('_', ' ')} over time")
    times, values = table.values["time"], table.values[name]
    missing = np.isnan(times) | np.isnan(values)
    if missing.any():
        line = table.lines[int(np.argmax(missing))]
        raise ReadError(f"{path}, line {line}: must be two numbers, one is missing")
    if len(times) < LEAST_SAMPLES:
        raise ReadError(
            f"{path}: needs at least {LEAST_SAMPLES} lines of numbers, got {len(times)}"
        )
    dt, odd = regular_step(times, table.digits["time"], share=1e-3)
    if odd is not None or not dt > SHORTEST_STEP:
        k = odd or 1
        raise ReadError(
            f"{path}, line {table.lines[k]}: times must grow by equal steps, but here they change "
            f"by {times[k] - times[k - 1]:g} s"
        )
    if not values.any():
        raise ReadError(f"{path}: is zero throughout, so nothing enters; give its values")
    return TimeFunction(values, dt, float(times[0]))


class RecordingConfig(Section):
    """Recorded seismogram: a file, and what its header lacks."""

    file: str
    format: str | None = None
    record: Count = 1
    mapping: str | None = None
    sheet: str | None = None
    bearing_deg: Bearing | None = None
    full_scale_mm_per_s: Positive | None = None
    accept_clipped: bool = False
    unit: str | None = None
    sensitivity: Positive | None = None
    response_file: str | None = None
    start_s: float | None = None
    low_passed_hz: Positive | None = None
    serial_number: str | None = None
    calibration_date: str | None = None
    location: str | None = None
    operator: str | None = None

    @model_validator(mode="after")
    def _of_counts(self):
        """Refuse two responses, and one beside a unit of motion."""
        if self.sensitivity is not None and self.response_file is not None:
            raise ValueError("sensitivity and response_file exclude one another; keep one")
        if self.is_counts and self.unit not in (None, "counts"):
            raise ValueError(
                "sensitivity and response_file take samples as they are in the file, so "
                f"unit must be 'counts', got {self.unit!r}"
            )
        return self

    @property
    def is_counts(self) -> bool:
        """Whether the samples are those of an instrument whose response is given."""
        return self.sensitivity is not None or self.response_file is not None


def value_at(config, path):
    """Return the value at a dotted path of a `Config`, None if there is none.

    Entries of a list go by their name or material: ``mesh.layers.soil.thickness_m``.
    """
    here = config
    for part in path.split("."):
        if isinstance(here, list):
            here = next((entry for entry in here if part in _names(entry)), None)
        elif isinstance(here, dict):
            here = here.get(part)
        else:
            here = getattr(here, part, None) if isinstance(here, BaseModel) else None
        if here is None:
            return None
    return here


def _names(entry):
    """Return the names that an entry of a list goes by."""
    return getattr(entry, "name", ""), getattr(entry, "material", "")


def number_paths(config):
    """List the dotted paths of all numbers of a `Config` that define the run."""
    return [
        path
        for path, value in _leaves(config, "")
        if type(value) in (int, float) and not path.startswith("back_analysis.")
    ]


def _leaves(here, path):
    """Yield paths and values under a section, a dict or a list of named entries."""
    if isinstance(here, BaseModel):
        fields = {name: getattr(here, name) for name in type(here).model_fields}
        pairs = (fields | (here.model_extra or {})).items()
    elif isinstance(here, dict):
        pairs = here.items()
    elif isinstance(here, list):
        pairs = [(next(filter(None, _names(entry)), ""), entry) for entry in here]
    else:
        yield path, here
        return
    for name, value in pairs:
        if name:
            yield from _leaves(value, f"{path}.{name}" if path else name)


def changed_tables(config, changes):
    """Return the tables of a `Config` as nested dicts, with other values at some paths.

    Parameters
    ----------
    config : Config
    changes : dict of str to float
        By path, in the units of the keys.

    Raises
    ------
    InputError
        If a path names no number of the file.
    """
    tables = config.model_dump(exclude_unset=True)
    for path, value in changes.items():
        check_path(config, path)
        *sections, key = path.split(".")
        here, entry = config, tables
        for part in sections:
            if isinstance(here, list):
                part = next(n for n, item in enumerate(here) if part in _names(item))
                here, entry = here[part], entry[part]
            else:
                here = here.get(part) if isinstance(here, dict) else getattr(here, part)
                entry = entry.setdefault(part, {})
        entry[key] = value
    return tables


def check_path(config, path):
    """Refuse a path that names no number of a `Config`.

    Raises
    ------
    InputError
        With the path that was probably meant.
    """
    known = number_paths(config)
    if path in known:
        return
    near = difflib.get_close_matches(path, known, n=1, cutoff=0.5)
    hint = f"did you mean {near[0]!r}?" if near else f"such as {known[0]!r}"
    raise InputError(f"{path!r} must name one number of the project file; {hint}")


MAX_PROJECT_BYTES = 1_000_000


def read_toml(path):
    """Return the tables of a TOML file."""
    if path.is_dir():
        raise ReadError(f"{path}: is a folder; name a project file in it")
    try:
        size = path.stat().st_size
        if size > MAX_PROJECT_BYTES:
            raise ReadError(f"{path.name}: a project file has at most 1 MB, this one {size} bytes")
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise ReadError(f"{path.name}: must be UTF-8 text; save it as UTF-8") from None
    except OSError as error:
        if isinstance(error, ReadError):
            raise
        raise ReadError(f"{path}: can't be read ({error.strerror or error})") from None
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path.name}: not valid TOML: {_lowered(str(error))}") from None
    except RecursionError:
        raise InputError(f"{path.name}: nested too deeply to be a project file") from None
    except ValueError:  # of int(): Python reads no more than 4300 digits
        long = re.search(r"[0-9][0-9_]{4299}", text)
        line = text.count("\n", 0, long.start() if long else 0) + 1
        raise InputError(f"{path.name}: line {line} holds a number of too many digits") from None


class CandidateConfig(Section):
    """A suspect of the user: what of the ground is otherwise, as a part of a project file."""

    name: Name
    mesh: dict[str, Any] = Field({})
    materials: dict[Name, dict[str, Any]] = Field({})
    joints: dict[Name, dict[str, Any]] = Field({})
    ground: dict[str, Any] = Field({})
    boundaries: dict[str, Any] = Field({})

    @property
    def tables(self) -> dict[str, dict]:
        """The tables that it changes."""
        return self.model_dump(exclude={"name"}, exclude_defaults=True)

    @model_validator(mode="after")
    def _something(self):
        """Ask for a change."""
        if not self.tables:
            raise ValueError("changes nothing; give mesh, materials, joints, ground or boundaries")
        if "file" in self.mesh:
            raise ValueError("mesh.file: the ground is described by layers; leave it out")
        return self


def with_candidate(config, candidate: CandidateConfig):
    """Return a `Config` with the tables of a candidate of its diagnosis in place of its own.

    Faults and joint sets go by their names: one of a new name is added. Other lists are replaced.

    Raises
    ------
    InputError
        If this breaks a rule; one sentence with candidate, key, rule and value.
    """
    own = config.model_dump(exclude_unset=True, exclude={"diagnosis"})
    try:
        return type(config).model_validate(merged(own, candidate.tables, by_name=True))
    except (ValidationError, RecursionError) as error:
        rule = sentence_of(error, type(config))
        raise InputError(f"diagnosis.candidates.{candidate.name}: {rule}") from None


def merged(table: dict, other: dict, by_name: bool = False) -> dict:
    """Return a table with the values of another in place of its own, table by table.

    Parameters
    ----------
    table, other : dict
        Tables of a project file, nested.
    by_name : bool
        Whether lists of tables with names are merged by these; other lists are replaced.

    Examples
    --------
    >>> faults = {"faults": [{"name": "F1", "dip_deg": 60}]}
    >>> merged(faults, {"faults": [{"name": "F1", "dip_deg": 70}, {"name": "F2"}]}, by_name=True)
    {'faults': [{'name': 'F1', 'dip_deg': 70}, {'name': 'F2'}]}
    """
    result = dict(table)
    for key, value in other.items():
        own = result.get(key)
        if isinstance(value, dict) and isinstance(own, dict):
            value = merged(own, value, by_name)
        elif by_name and isinstance(own, list) and _have_names(value) and _have_names(own):
            known = {part["name"]: part for part in own}
            changed = {v["name"]: merged(known.get(v["name"], {}), v, by_name) for v in value}
            value = [*(known | changed).values()]
        result[key] = value
    return result


def _have_names(value):
    """Tell whether a value is a list of tables with names."""
    listed = isinstance(value, list) and bool(value)
    return listed and all(isinstance(part, dict) and "name" in part for part in value)


def sentence_of(error, root) -> str:
    """Return the first validation error of pydantic in one sentence, missing keys all at once."""
    if isinstance(error, RecursionError):
        return "nested too deeply to be a project file"
    mistakes = error.errors(include_url=False)
    first = min(mistakes, key=lambda item: item["type"] != "extra_forbidden")
    missing = [_path(item["loc"]) for item in mistakes if item["type"] == "missing"]
    if first["type"] == "missing" and len(missing) > 1:
        others = len(mistakes) - len(missing)
        more = f" ({others} more)" if others else ""
        return f"{', '.join(missing)}: missing; add them{more}"
    more = f" ({len(mistakes) - 1} more)" if len(mistakes) > 1 else ""
    at, rule = first["loc"], _rule(first, root)
    if at[-1:] == ("[key]",):
        at, rule = at[:-2], f"a name {rule}"
    where = f"{_path(at)}: " if at else ""
    return f"{where}{rule}{more}"


def _path(location):
    """Write a location as ``mesh.faults[1].dip_deg``, counted from 1."""
    text = ""
    for part in location:
        if isinstance(part, str):
            part = UNPRINTABLE.sub(lambda match: ascii(match[0])[1:-1], part)
        text += f"[{part + 1}]" if isinstance(part, int) else f".{part}" if text else part
    return text


def _rule(mistake, root):
    """Return the broken rule, the value and the remedy."""
    kind, context, value = mistake["type"], mistake.get("ctx", {}), mistake["input"]
    got = f"got {_shown(value)}"
    if kind == "missing":
        return "missing; add it"
    if kind == "extra_forbidden":
        return f"unknown key; {_nearest(mistake['loc'], root)}"
    if kind in ("greater_than", "greater_than_equal"):
        bound = context.get("gt", context.get("ge"))
        words = {("greater_than", 0): "be positive", ("greater_than_equal", 0): "not be negative"}
        verb = "exceed" if kind == "greater_than" else "be at least"
        return f"must {words.get((kind, bound), f'{verb} {plain_number(bound, 6)}')}, {got}"
    if kind in ("less_than", "less_than_equal"):
        limit = context.get("lt", context.get("le"))
        verb = "be below" if kind == "less_than" else "be at most"
        return f"must {verb} {plain_number(limit, 6)}, {got}"
    if kind == "value_error":
        return str(context["error"])
    if kind in ("too_short", "too_long"):
        limit = context.get("min_length", context.get("max_length"))
        return f"must have {'at least' if kind == 'too_short' else 'at most'} {limit} values, {got}"
    if kind == "literal_error":
        return f"must be {context['expected']}, {got}"
    return f"{_lowered(_PLAIN.get(kind, mistake['msg']))}, {got}"


_PLAIN = {
    "float_type": "must be a number",
    "int_type": "must be a whole number",
    "int_from_float": "must be a whole number",
    "string_type": "must be text in quotes",
    "bool_type": "must be true or false",
    "list_type": "must be a list in brackets",
    "dict_type": "must be a table",
    "model_type": "must be a table",
    "model_attributes_type": "must be a table",
    "finite_number": "must be finite",
    "string_pattern_mismatch": "must be 1 to 60 characters without '/'",
    "string_too_short": "must not be empty",
    "string_too_long": "must be shorter",
}


def _lowered(text):
    """Begin with a small letter."""
    return text[:1].lower() + text[1:]


def _shown(value):
    """Show a value as the file has it, in at most 40 characters."""
    if isinstance(value, dict):
        text = "a table"
    elif isinstance(value, bool):
        text = str(value).lower()
    elif isinstance(value, (date, time)):
        text = value.isoformat().replace("+00:00", "Z")
    elif isinstance(value, list):
        text = f"[{', '.join(map(_shown, value[:20]))}]"
    else:
        text = repr(value)
    return text if len(text) <= 40 else f"{text[:37]}..."


def _nearest(location, root):
    """Propose the known key of the most similar spelling."""
    known = sorted(_fields_at(location[:-1], root))
    near = difflib.get_close_matches(str(location[-1]), known, n=1, cutoff=0.5)
    return f"did you mean {near[0]!r}?" if near else f"known are {', '.join(known)}"


def _fields_at(location, root):
    """Return the keys that are known at a place of the file."""
    section = root
    for part in location:
        fields = getattr(section, "model_fields", None)
        if fields is not None and part in fields:
            section = section_in(fields[part].annotation)
    return set(getattr(section, "model_fields", {}))
