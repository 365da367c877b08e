"""Reading of project files: TOML to a checked `Config`, every mistake told in one sentence."""

import difflib
import tomllib
from pathlib import Path

from pydantic import ValidationError

from ..errors import InputError, ReadError
from .config import Config
from .key_paths import value_at

MAX_BYTES = 1_000_000
VARIANT = "full"


def read_config(path, full=False) -> Config:
    """Read and check a project file.

    Parameters
    ----------
    path : path
    full : bool
        Whether the table ``[full]`` of the file overrides the rest.

    Returns
    -------
    Config

    Raises
    ------
    ReadError
        If the file can't be read.
    InputError
        If it is no TOML or breaks a rule; one sentence with file, key, rule and value.
    """
    path = Path(path)
    return check_config(_parse(path), path.name, full)


def check_config(table, name="project.toml", full=False) -> Config:
    """Turn the tables of a project file, as nested dicts, into a `Config`."""
    table = dict(table)
    variant = table.pop(VARIANT, None)
    if full and variant is None:
        raise InputError(f"{name}: {VARIANT}: missing; the file has no table [{VARIANT}]")
    if full:
        table = _merged(table, variant)
    try:
        config = Config.model_validate(table)
    except (ValidationError, RecursionError) as error:
        raise InputError(f"{name}: {_sentence(error)}") from None
    for key in config.assumed:
        if value_at(config, key) is None:
            raise InputError(f"{name}: assumed: {key!r} must name a key of this file")
    return config


def _parse(path):
    """Return the tables of a TOML file."""
    try:
        size = path.stat().st_size
        if size > MAX_BYTES:
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
    except (RecursionError, ValueError):
        raise InputError(f"{path.name}: nested too deeply to be a project file") from None


def _merged(table, variant):
    """Return a table with the values of a variant in place of its own, table by table."""
    merged = dict(table)
    for key, value in variant.items():
        if isinstance(value, dict) and isinstance(merged.get(key), dict):
            value = _merged(merged[key], value)
        merged[key] = value
    return merged


def _sentence(error):
    """Tell the first mistake that pydantic found."""
    if isinstance(error, RecursionError):
        return "nested too deeply to be a project file"
    found = error.errors(include_url=False)
    first = min(found, key=lambda item: item["type"] != "extra_forbidden")
    more = f" ({len(found) - 1} more)" if len(found) > 1 else ""
    where = f"{_path(first['loc'])}: " if first["loc"] else ""
    return f"{where}{_rule(first)}{more}"


def _path(location):
    """Write a location as ``mesh.faults[1].dip_deg``, counted from 1."""
    text = ""
    for part in location:
        text += f"[{part + 1}]" if isinstance(part, int) else f".{part}" if text else str(part)
    return text


def _rule(mistake):
    """Say which rule is broken, the value, and what to do."""
    kind, context, value = mistake["type"], mistake.get("ctx", {}), mistake["input"]
    got = f"got {_shown(value)}"
    if kind == "missing":
        return "missing; add it"
    if kind == "extra_forbidden":
        return f"unknown key; {_nearest(mistake['loc'])}"
    if kind in ("greater_than", "greater_than_equal"):
        bound = context.get("gt", context.get("ge"))
        words = {("greater_than", 0): "be positive", ("greater_than_equal", 0): "not be negative"}
        way = "exceed" if kind == "greater_than" else "be at least"
        return f"must {words.get((kind, bound), f'{way} {bound:g}')}, {got}"
    if kind in ("less_than", "less_than_equal"):
        limit = context.get("lt", context.get("le"))
        return f"must be {'below' if kind == 'less_than' else 'at most'} {limit:g}, {got}"
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
    """Show a value in at most 40 characters."""
    text = repr(value) if not isinstance(value, dict) else "a table"
    return text if len(text) <= 40 else f"{text[:37]}..."


def _nearest(location):
    """Propose the known key that is spelled most like the unknown one."""
    known = sorted(_fields_at(location[:-1]))
    near = difflib.get_close_matches(str(location[-1]), known, n=1, cutoff=0.5)
    return f"did you mean {near[0]!r}?" if near else f"known are {', '.join(known)}"


def _fields_at(location):
    """Return the keys that are known at a place of the file."""
    found = Config
    for part in location:
        fields = getattr(found, "model_fields", None)
        if fields is not None and part in fields:
            found = _section_in(fields[part].annotation)
    return set(getattr(found, "model_fields", {}))


def _section_in(annotation):
    """Return the section class inside an annotation such as ``dict[str, X]`` or ``X | None``."""
    if hasattr(annotation, "model_fields"):
        return annotation
    for part in getattr(annotation, "__args__", ()):
        section = _section_in(part)
        if section is not None:
            return section
    return None
