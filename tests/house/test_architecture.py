"""The house: imports point one way, one room per tool, no file too long, nothing unsafe."""

import ast
import re
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

from verification.house import loaded
from verification.source_tree import Source

ROOT = Path(__file__).parents[2]
SOURCE = Source(ROOT)
MODULES = SOURCE.paths
TREES = SOURCE.trees
imported = SOURCE.imported
EACH = pytest.mark.parametrize("name", [name for name in TREES if name])
FORTRAN = sorted((ROOT / "fortran").glob("*.f90"))
MOST_LOADED_BY_SIMULATE = 45  # modules
MOST_IN_A_PACKAGE = 15  # to become 12
MOST_LINES = 800  # an alarm: is there a second idea in the file?
MOST_LINES_OF_A_SECOND_IDEA = (
    200  # definitions that the rest of a module does not use, or is used by
)
MOST_LINES_OF_A_FUNCTION = 60
# From the ground up: a package imports only itself and what stands before it.
PACKAGES = [
    "errors", "units", "laws", "readers", "core", "files", "signals", "mesh", "recordings", "model",
    "blasts", "solver", "runs", "planning", "config", "sources", "inference", "survey", "ground",
    "simulation", "project", "back_analysis", "diagnosis", "line_records", "report", "workflows",
    "cli", "__main__",
]  # fmt: skip
ONE_ROOM = {
    "_core": {"core"},
    "_core_batch": {"core"},
    "_core_single": {"core"},
    "gmsh": {"mesh.gmsh"},
    "ezdxf": {"readers.drawings"},
    "tifffile": {"readers.geometry"},
    "openpyxl": {"readers.cells", "workflows"},  # read, written
}
# Rooms that may use a tool.
OWN_ROOMS = {
    "csv": {"readers.cells", "workflows"},  # read, written
    "importlib.import_module": {"diagnosis.library"},
    "numpy.loadtxt": set(),
}
# Standard deviations of priors that are to become keys of [priors].
PRIORS_IN_CODE = {"SCALE_SIGMA", "SPEED_SIGMA", "STIFFNESS_SIGMA"}
# Modules whose public functions take a project without its type.
UNTYPED_PROJECT = {
    "back_analysis.findings", "back_analysis.identifiability", "back_analysis.survey_design",
    "back_analysis.trials", "diagnosis.library.geometry",
    "diagnosis.library.ground", "diagnosis.library.paths", "diagnosis.library.sources",
    "project.checks", "project.checks_ground", "project.places",
    "project.result", "report.diagnosis_figures",
}  # fmt: skip
# Functions that modules share by intent: of hexahedra and tetrahedra.
ONE_INTERFACE = {"edge_lengths", "locate", "shape_slopes", "shape_values", "volumes"}
# Other public names that more than one module defines. The list only shrinks.
TWO_HOMES = {
    "Band", "Column", "Fit", "Fitter", "Window", "table_of",
}  # fmt: skip
ORDER = [
    "kinds",
    "model_types",
    "joint_coulomb",
    "joint_closure",
    "joint_fill",
    "joint_laws",
    "elasticity",
    "principal_stresses",
    "smoothing",
    "mohr_coulomb",
    "hoek_brown",
    "ubiquitous_joints",
    "zone_laws",
    "tet4",
    "tet4_batch",
    "tet4_general",
    "tet4_plastic",
    "processor",
    "tet15_kernels",
    "tet15",
    "hex_kernels",
    "hex_forces",
    "absorbing_layer",
    "edge_springs",
    "internal_forces",
    "contacts",
    "boundaries",
    "implicit_zones",
    "time_stepping",
    "energy_balance",
    "solver",
    "border",
    "hdf5_arrays",
    "model_arrays",
    "model_file",
    "model_checks",
    "pyblast_run",
]


@cache
def tools(name):
    """Return what a module imports from elsewhere, with names: csv, numpy.loadtxt."""
    found, aliases = set(), {"np": "numpy"}
    for node in ast.walk(TREES[name]):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and not node.level:
            found |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            found.add(f"{aliases.get(node.value.id, node.value.id)}.{node.attr}")
    return found


def assigned(name):
    """Return the names that a module assigns at its top level."""
    nodes = (n for n in TREES[name].body if isinstance(n, (ast.Assign, ast.AnnAssign)))
    names = (n for node in nodes for n in ast.walk(node) if isinstance(n, ast.Name))
    return {n.id for n in names if isinstance(n.ctx, ast.Store)}


def ideas(tree):
    """Return the lines of each group of definitions of a module that use one another, most first.

    A definition is a function, a class or an assignment at the top level. Two belong together
    where one names the other, also as text in an annotation.
    """
    owner = {}
    for node in tree.body:
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            owner[node.name] = node
        elif isinstance(node, (ast.Assign, ast.AnnAssign)):
            names = (n for n in ast.walk(node) if isinstance(n, ast.Name))
            owner |= {n.id: node for n in names if isinstance(n.ctx, ast.Store)}
    groups = {id(node): {id(node)} for node in owner.values()}
    for node in owner.values():
        for inner in ast.walk(node):
            used = getattr(inner, "id", None) or getattr(inner, "value", None)
            other = owner.get(used.strip('"')) if isinstance(used, str) else None
            if other is not None and groups[id(other)] is not groups[id(node)]:
                groups[id(node)] |= groups[id(other)]
                for member in groups[id(other)]:
                    groups[member] = groups[id(node)]
    lines = {id(node): node.end_lineno - node.lineno + 1 for node in owner.values()}
    each = {id(group): group for group in groups.values()}.values()
    return sorted((sum(lines[member] for member in group) for group in each), reverse=True)


def test_imports_run_in_no_circle():
    graph = {name: (imported(name)[0] & set(TREES)) - {""} for name in TREES}  # "": the front door

    assert list(TopologicalSorter(graph).static_order())


@EACH
def test_a_package_imports_only_what_stands_before_it(name):
    package = name.split(".")[0]

    assert package in PACKAGES, "give the package its place in PACKAGES, from the ground up"
    below = PACKAGES[: PACKAGES.index(package) + 1]
    upwards = {module for module in imported(name)[0] if module.split(".")[0] not in below} - {""}
    assert not upwards, "what both need belongs into the lower package, or is passed by the caller"


@EACH
def test_no_module_of_the_package_imports_from_its_front_door(name):
    own, foreign = imported(name)

    assert "" not in own or name == "core"  # the compiled cores lie beside the front door
    assert "pyblast" not in foreign


@EACH
def test_no_module_reaches_upwards_by_the_name_of_a_module_in_a_text(name):
    below = PACKAGES[: PACKAGES.index(name.split(".")[0]) + 1]
    texts = {n.value for n in ast.walk(TREES[name]) if isinstance(n, ast.Constant)}
    named = {text for text in texts if isinstance(text, str) and text.startswith("pyblast.")}

    assert {t.split(".")[1] for t in named if t.removeprefix("pyblast.") in TREES} <= {*below}


def test_only_the_report_draws():
    importers = {name for name in TREES if "matplotlib" in imported(name)[1]}

    assert {name.split(".")[0] for name in importers} == {"report"}


def test_simulating_loads_few_modules():
    """What this loads beyond the limit is imported at the top of a module that needs it late."""
    assert loaded(SOURCE, "simulate") <= MOST_LOADED_BY_SIMULATE


def test_a_public_name_has_one_home():
    """A new function or class that has the name of another needs the name of its own idea."""
    two = set(SOURCE.two_homes) - ONE_INTERFACE

    assert sorted(two - TWO_HOMES) == [], "give the new one a name that no other module defines"
    assert sorted(TWO_HOMES - two) == [], "has one home now: take it off the list TWO_HOMES"


def test_diagnosis_takes_nothing_from_back_analysis():
    """What both need lies below both: in inference, sources or the project."""
    assert sorted(SOURCE.sideways("diagnosis", "back_analysis")) == [], "move it below both"


def test_a_package_has_at_most_as_many_modules_as_one_can_know():
    packages = [path.parent for path in MODULES if path.stem != "__init__"]

    full = {each.name for each in packages if packages.count(each) > MOST_IN_A_PACKAGE}
    assert not full, "which of its modules are one idea, or belong to another package?"


@pytest.mark.parametrize("tool", ONE_ROOM)
def test_a_tool_is_imported_in_one_room_only(tool):
    importers = {name for name in TREES if tool in set.union(*imported(name))}

    assert importers == ONE_ROOM[tool]


@pytest.mark.parametrize("tool", OWN_ROOMS)
def test_no_other_room_takes_up_a_tool_that_has_its_own(tool):
    users = {name for name in TREES if name and tool in tools(name)}

    assert users <= OWN_ROOMS[tool]


def test_prior_deviations_are_no_new_constants():
    ends = {n for name in TREES for n in assigned(name) if n.endswith("_SIGMA")}

    assert ends <= PRIORS_IN_CODE, "make it a key of [priors] in config/, see PriorsConfig"


@EACH
def test_a_public_function_states_the_type_of_its_project(name):
    untyped = [
        node.name
        for node in ast.walk(TREES[name])
        if isinstance(node, ast.FunctionDef) and not node.name.startswith("_")
        for argument in (*node.args.args, *node.args.kwonlyargs)
        if argument.arg == "project" and argument.annotation is None
    ]

    assert not untyped or name in UNTYPED_PROJECT, "annotate it as project: Project"


@EACH
def test_a_module_holds_one_idea(name):
    assert "_and_" not in name
    second = [*ideas(TREES[name]), 0, 0][1]
    assert second <= MOST_LINES_OF_A_SECOND_IDEA, "two groups that do not use one another: split it"


@pytest.mark.parametrize(
    ("code", "lines"),
    [
        ("def f():\n    return g()\n\n\ndef g():\n    return 1\n\n\nx: 'f' = 2\n", [5]),
        ("a = 1\n\n\ndef f():\n    return a\n\n\nclass B:\n    c = 1\n    d = 2\n", [3, 3]),
    ],
)
def test_definitions_that_name_one_another_are_one_idea(code, lines):
    assert ideas(ast.parse(code)) == lines


@pytest.mark.parametrize("path", [*MODULES, *FORTRAN], ids=lambda path: path.name)
def test_no_file_is_so_long_that_it_may_hold_a_second_idea(path):
    lines = len(path.read_text(encoding="utf-8").splitlines())
    assert lines <= MOST_LINES, "is there a second idea in it? then give that one its own module"


@pytest.mark.parametrize("path", [p for p in FORTRAN if p.stem != "border"], ids=lambda p: p.name)
def test_flat_argument_lists_end_at_the_border(path):
    statements = re.sub(r"&\s*\n\s*", "", path.read_text())
    for name, dummies in re.findall(r"(?:subroutine|function) (\w+)\(([^)]*)\)", statements):
        assert dummies.count(",") < 15, name


@EACH
def test_no_function_is_longer_than_sixty_lines_beside_its_docstring(name):
    for node in ast.walk(TREES[name]):
        if isinstance(node, ast.FunctionDef):
            documented = ast.get_docstring(node) is not None
            first = node.body[1] if documented and len(node.body) > 1 else node.body[0]
            assert node.end_lineno - first.lineno < MOST_LINES_OF_A_FUNCTION, f"{name}.{node.name}"


@EACH
def test_no_module_is_a_drawer_for_odds_and_ends(name):
    drawers = {"utils", "util", "common", "base", "helpers", "misc", "tools"}
    assert name.split(".")[-1] not in drawers


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
    assert not imported(name)[1] & {"pickle", "marshal", "shelve", "yaml", "dill"}


@EACH
def test_no_except_is_bare(name):
    handlers = [n for n in ast.walk(TREES[name]) if isinstance(n, ast.ExceptHandler)]

    assert all(handler.type is not None for handler in handlers)


@pytest.mark.parametrize("path", FORTRAN, ids=lambda path: path.stem)
def test_fortran_uses_only_modules_from_above(path):
    lines = [line.strip() for line in path.read_text().splitlines()]
    used = {line.split()[1].rstrip(",") for line in lines if line.startswith("use pyblast_")}

    above = {f"pyblast_{name}" for name in ["batch", *ORDER[: ORDER.index(path.stem)]]}
    assert used <= above


PROGRAM = {"hdf5_arrays", "model_file", "model_checks", "pyblast_run"}
KERNELS = [path for path in FORTRAN if path.stem not in PROGRAM]


@pytest.mark.parametrize("path", KERNELS, ids=lambda path: path.stem)
def test_kernels_print_stop_and_keep_nothing(path):
    forbidden = re.compile(r"^(print\b|(write|open|read) *\(|(error )?stop\b|save\b)|, *save\b")
    for line in path.read_text().lower().splitlines():
        assert not forbidden.search(line.split("!")[0].strip())
