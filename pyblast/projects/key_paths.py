"""Dotted paths of keys, such as ``joints.fault.kn_gpa_per_m``: reading and changing values."""

from difflib import get_close_matches

from pydantic import BaseModel

from ..errors import InputError


def value_at(config, path):
    """Return what a dotted path of a `Config` leads to, None where it leads nowhere.

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
    """List the paths of all numbers of a `Config`, given or by default, that say what is run."""
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
        there, entry = config, tables
        for part in sections:
            if isinstance(there, list):
                part = next(n for n, one in enumerate(there) if part in _names(one))
                there, entry = there[part], entry[part]
            else:
                there = there.get(part) if isinstance(there, dict) else getattr(there, part)
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
    near = get_close_matches(path, known, n=1, cutoff=0.5)
    hint = f"did you mean {near[0]!r}?" if near else f"such as {known[0]!r}"
    raise InputError(f"{path!r} must name one number of the project file; {hint}")
