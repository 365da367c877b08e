"""docs/reference/project_file.md names every key of a project file, with its unit and default."""

import re
import tomllib
from pathlib import Path
from types import UnionType
from typing import get_args, get_origin

import pytest

from pyblast.config.config import Config
from pyblast.config.ground import JointConfig
from pyblast.config.section import Section
from pyblast.core import JOINT_LAWS
from pyblast.units import split_key

DOCS = Path(__file__).parents[2] / "docs"
PAGE = (DOCS / "reference" / "project_file.md").read_text(encoding="utf-8")
TOP = "Top of the file"


def section_in(annotation):
    """Return the section class of a key and how its table is written, or nothing."""
    if isinstance(annotation, type) and issubclass(annotation, Section):
        return annotation, "[{}]"
    if get_origin(annotation) is UnionType:
        return section_in(get_args(annotation)[0])
    if get_origin(annotation) is list:
        found, _ = section_in(get_args(annotation)[0])
        return found, "[[{}]]"
    if get_origin(annotation) is dict:
        found, _ = section_in(get_args(annotation)[1])
        return found, "[{}.NAME]"
    return None, ""


def tables(section=Config, name="", head=TOP):
    """Return the section class of every table of a project file by its heading."""
    found = {head: section}
    for key, field in section.model_fields.items():
        inner, form = section_in(field.annotation)
        if inner is not None:
            path = f"{name}.{key}" if name else key
            written = form.format(path)
            found |= tables(inner, written.strip("[]"), written)
    return found


def described():
    """Return the rows (key, unit, default) of the page by heading."""
    found = {}
    for part in re.split(r"^##+ ", PAGE, flags=re.MULTILINE)[1:]:
        head, text = part.split("\n", 1)
        rows = re.findall(r"^\| `(\w+)` \| ?(.*?) ?\| (.+?) \| ", text, re.MULTILINE)
        for name in re.findall(r"`(.+?)`", head) or [head]:
            found[name] = {key: (unit.strip(), default) for key, unit, default in rows}
    return found


TABLES, DESCRIBED = tables(), described()
EACH = pytest.mark.parametrize("name", list(TABLES))


def plain_fields(section):
    return {k: f for k, f in section.model_fields.items() if section_in(f.annotation)[0] is None}


def test_every_table_has_its_heading_and_no_other_has():
    assert set(DESCRIBED) == set(TABLES)


@EACH
def test_every_key_is_described_and_no_other_is(name):
    rows = set(DESCRIBED[name])
    if TABLES[name] is JointConfig:
        keys = {prop.key for law in JOINT_LAWS.values() for prop in law.properties.values()}
        missing, rows = sorted(keys - rows), rows - keys
        assert not missing, f"add rows of {', '.join(missing)} to [joints.NAME] of the page"

    assert rows == set(plain_fields(TABLES[name]))


@EACH
def test_units_are_those_of_the_key_names(name):
    signs = {"/": "_per_", "³": "3", "²": "2", "°": "deg"}
    for key, (unit, _) in DESCRIBED[name].items():
        text = unit.lower()
        text = text.replace(" ", "_")
        for sign, word in signs.items():
            text = text.replace(sign, word)
        assert text == split_key(key)[1].replace("angle_deg", "deg"), key


@EACH
def test_defaults_are_those_of_the_program(name):
    for key, field in plain_fields(TABLES[name]).items():
        told = DESCRIBED[name][key][1]
        if field.is_required():
            assert told == "required", key
        elif field.default is None:
            assert told == "–", key
        else:
            assert tomllib.loads(f"value = {told.strip('`')}")["value"] == field.default, key


def test_both_examples_are_linked():
    for path in re.findall(r"\((\.\./\.\./examples/[^)]+)\)", PAGE):
        assert (DOCS / "reference" / path).is_file()


def test_the_table_of_laws_names_what_each_needs_and_may_have():
    part = PAGE.split("## `[joints.NAME]`", 1)[1].split("\n## ", 1)[0]
    rows = [
        [cell.strip() for cell in row.split("|")] for row in re.findall(r"^\|(.*)\|$", part, re.M)
    ]
    rows = [row for row in rows if row[1].startswith("kn, ks")]
    named = {law: row[1:] for row in rows for law in row[0].split(", ")}

    assert set(named) == set(JOINT_LAWS), "the table of laws of [joints.NAME] and rows of Fortran"
    for law, (needs, _, *use) in named.items():
        assert len(list(filter(None, use))) == 3, f"{law}: use, validity and what measured it"
        properties = JOINT_LAWS[law].properties.items()
        wanted = {name for name, one in properties if one.default is None}
        assert set(needs.split(", ")) == wanted, law
