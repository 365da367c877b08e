"""The house counts what it says: names with two homes, code that no command reaches, climbs."""

import pytest

from verification.house import (
    changes_of_projects,
    gatherers,
    lists_of_linear,
    store,
    unreached,
    uses_of_given,
)
from verification.house_walks import climbs_of
from verification.source_tree import Source

REST = """
def early():
    return Box()

def late(box):
    return box.used

def never():
    return 1

class Box:
    def __repr__(self):
        return ""

    def used(self):
        return 2

    def idle(self):
        return 3

@enter
def row():
    return Row()

class Row:
    pass
"""
TWIN = """
LINEAR_LAWS = ("bouncy", "stiff")
LINEAR_EDGE = 0.6

def never():
    return 2

class _Box:
    pass

def varied(project, key) -> "Project":
    return project(given={key: project.given[key]})

def load_it(path) -> Project:
    pass

def fit(project):
    return _rows(project)

def _rows(project):
    return gather(project.records)

def asked(survey):
    return gather(survey.records(4.0))
"""
COMMANDS = """
def go():
    from .. import late
    from ..room import rest

    late(rest.early())
"""
FILES = {
    "pyblast/__init__.py": "from .room.rest import late",
    "pyblast/cli/commands.py": COMMANDS,
    "pyblast/room/rest.py": REST,
    "pyblast/room/twin.py": TWIN,
    "fortran/joint_laws.f90": 'rows = [ &\n    "bouncy: kn | linear |"]',
}


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    root = tmp_path_factory.mktemp("tree")
    for name, text in FILES.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(text, encoding="utf-8")
    return Source(root)


def test_a_public_name_with_two_homes_is_found_and_a_private_one_is_not(source):
    assert source.two_homes == {"never": ["room.rest", "room.twin"]}


def test_no_command_reaches_what_only_the_front_door_or_nobody_names(source):
    left = unreached(source)

    assert {"room.rest.never": 2, "room.rest.Box.idle": 2}.items() <= left.items()
    reached = {"early", "late", "Box", "Box.__repr__", "Box.used", "row", "Row"}
    assert not left.keys() & {f"room.rest.{name}" for name in reached}


def test_uses_of_parts_by_name_and_changes_of_projects_are_counted(source):
    assert uses_of_given(source) == ["room.twin: 2"]
    assert changes_of_projects(source) == ["room.twin.varied"]


def test_a_gatherer_reads_records_and_makes_arrays_but_asks_no_survey_for_them(source):
    assert gatherers(source) == ["room.twin.fit"]


def test_a_list_of_linear_laws_holds_names_of_laws(source):
    assert lists_of_linear(source) == ["room.twin.LINEAR_LAWS"]


def test_a_walk_climbs_where_a_caller_takes_its_next_step():
    down = [("a", ""), ("b", "a"), ("c", "b")]

    assert climbs_of(down) == (3, 3, 0)
    assert climbs_of([*down, ("c", "c"), ("b", "a"), ("b", "b")]) == (4, 3, 1)


def test_a_row_keeps_the_counts_that_are_not_measured_again(tmp_path):
    path = tmp_path / "house.json"
    store("one", {"commit": "a", "counts": {"lines": 2, "reads": 9}}, path)

    rows = store("one", {"commit": "b", "counts": {"lines": 1}}, path)

    assert rows == {"one": {"commit": "b", "counts": {"lines": 1, "reads": 9}}}
