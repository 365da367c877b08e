"""The house: imports point one way, one room per tool, no file too long, nothing unsafe."""

import ast
import re
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "pyblast"
MODULES = sorted(PACKAGE.glob("*.py"))
FORTRAN = sorted((ROOT / "fortran").glob("*.f90"))
TREES = {path.stem: ast.parse(path.read_text()) for path in MODULES}
# What marches knows nothing of files, records, projects and reports.
CORE = {
    "assembly",
    "boundaries",
    "conditions",
    "errors",
    "insitu",
    "joints",
    "kernels",
    "loads",
    "materials",
    "mesh",
    "model",
    "ordering",
    "preparation",
    "seismogram",
    "solver",
    "sources",
    "splitting",
    "stability",
    "tetrahedra",
    "model_file",
    "provenance",
}
ONE_ROOM = {"_core": {"kernels"}, "gmsh": {"gmsh_mesher"}, "matplotlib": {"figures"}}
ORDER = [
    "kinds",
    "joint_laws",
    "zones",
    "contacts",
    "boundaries",
    "motion",
    "ledger",
    "solver",
    "model_file",
    "pyblast_run",
]
EACH = pytest.mark.parametrize("name", list(TREES))


def imported(tree):
    """Return the modules of the package and the foreign packages that a module imports."""
    own, foreign = set(), set()
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.level:
            names = [node.module] if node.module else [alias.name for alias in node.names]
            own |= {name.split(".")[0] for name in names}
        elif isinstance(node, ast.ImportFrom):
            foreign.add(node.module.split(".")[0])
        elif isinstance(node, ast.Import):
            foreign |= {alias.name.split(".")[0] for alias in node.names}
    return own, foreign


def test_imports_run_in_no_circle():
    graph = {name: imported(tree)[0] & set(TREES) for name, tree in TREES.items()}

    assert list(TopologicalSorter(graph).static_order())


@pytest.mark.parametrize("name", sorted(CORE))
def test_what_marches_imports_only_what_marches(name):
    assert imported(TREES[name])[0] <= CORE | {"_core"}


@pytest.mark.parametrize("tool", ONE_ROOM)
def test_a_tool_is_imported_in_one_room_only(tool):
    importers = {name for name, tree in TREES.items() if tool in set.union(*imported(tree))}

    assert importers == ONE_ROOM[tool]


def test_nothing_imports_the_command_line():
    assert not [name for name, tree in TREES.items() if "__main__" in imported(tree)[0]]


@pytest.mark.parametrize("path", [*MODULES, *FORTRAN], ids=lambda path: path.name)
def test_no_file_is_longer_than_three_hundred_lines(path):
    assert len(path.read_text().splitlines()) <= 300


@EACH
def test_no_function_is_longer_than_sixty_lines_beside_its_docstring(name):
    for node in ast.walk(TREES[name]):
        if isinstance(node, ast.FunctionDef):
            documented = ast.get_docstring(node) is not None
            first = node.body[1] if documented and len(node.body) > 1 else node.body[0]
            assert node.end_lineno - first.lineno < 60, f"{name}.{node.name}"


@EACH
def test_no_module_is_a_drawer_for_odds_and_ends(name):
    assert name not in {"utils", "util", "common", "base", "helpers", "misc", "tools"}


@EACH
def test_a_module_says_in_its_docstring_what_it_owns(name):
    assert ast.get_docstring(TREES[name])


@EACH
def test_nothing_unsafe_is_called(name):
    for node in ast.walk(TREES[name]):
        if isinstance(node, ast.Call):
            called = ast.unparse(node.func)
            assert called not in {"eval", "exec", "compile", "__import__", "os.system"}
            assert not called.startswith(("pickle.", "marshal.", "shelve.", "yaml.load"))
            shell = [k.value for k in node.keywords if k.arg == "shell"]
            assert not any(getattr(value, "value", True) for value in shell)
            unsafe = [k.value for k in node.keywords if k.arg == "allow_pickle"]
            assert not any(getattr(value, "value", True) for value in unsafe)


@EACH
def test_nothing_that_loads_code_is_imported(name):
    assert not imported(TREES[name])[1] & {"pickle", "marshal", "shelve", "yaml", "dill"}


@EACH
def test_no_except_is_bare(name):
    handlers = [n for n in ast.walk(TREES[name]) if isinstance(n, ast.ExceptHandler)]

    assert all(handler.type is not None for handler in handlers)


@pytest.mark.parametrize("path", FORTRAN, ids=lambda path: path.stem)
def test_fortran_uses_only_modules_from_above(path):
    lines = [line.strip() for line in path.read_text().splitlines()]
    used = {line.split()[1].rstrip(",") for line in lines if line.startswith("use pyblast_")}

    above = {f"pyblast_{name}" for name in ORDER[: ORDER.index(path.stem)]}
    assert used <= above


KERNELS = [path for path in FORTRAN if path.stem not in {"model_file", "pyblast_run"}]


@pytest.mark.parametrize("path", KERNELS, ids=lambda path: path.stem)
def test_kernels_print_stop_and_keep_nothing(path):
    forbidden = re.compile(r"^(print\b|(write|open|read) *\(|(error )?stop\b|save\b)|, *save\b")
    for line in path.read_text().lower().splitlines():
        assert not forbidden.search(line.split("!")[0].strip())
