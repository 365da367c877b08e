"""The house in numbers: how large it is, what stands twice in it, and what it does how often.

    python -m verification.house                    counts of the source, below 20 s
    python -m verification.house --dynamic          with one run and one diagnosis, some minutes
    python -m verification.house --step NAME        stores the counts in house.json, too
    python -m verification.house --tree PATH        of another checkout, by its own interpreter

Each list that it prints says what was counted; house.json keeps the counts alone.
"""

import argparse
import ast
import json
import re
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

from .source_tree import ROOT, Source, functions_of, names_in

STORED = Path(__file__).with_name("house.json")
WALKS = Path(__file__).with_name("house_walks.py")
DOORS = "simulate", "run", "diagnose"
# What each number is to become, of the plan for five nouns and one error.
GOALS = {
    "modules": 142, "lines": 56_600, "modules loaded by simulate": 45, "uses of given": 0,
    "changes of a project": 3, "gatherers of records": 1, "lists of what is linear": 1,
    "public names with two homes": 5, "back_analysis in diagnosis": 0,
    "lines that no command reaches": 100, "run: most reads of a file": 1,
    "diagnose: most reads of a file": 1,
}  # fmt: skip
GIVEN = re.compile(r"\bgiven\[|\.given\b|\bgiven=")
LAW = re.compile(r'^ *"([\w-]+):', re.MULTILINE)
READERS = "read", "load", "loaded", "make", "from"
STATES = "Project", "State"
RECORDS = "records", "comparable", "recordings"
GATHERS = {"gather", "Records"}
ABOVE = "report", "workflows", "cli"
# Decorators beside which a function is still called by its name.
NO_CALLERS = {
    "property", "cached_property", "classmethod", "staticmethod", "setter", "cache", "lru_cache",
    "contextmanager", "overload", "dataclass",
}  # fmt: skip


def sizes(source: Source) -> dict:
    """Count modules and lines of the package."""
    modules = [path for path in source.paths if path.stem != "__init__"]
    return {"modules": len(modules), "lines": sum(t.count("\n") for t in source.texts.values())}


def uses_of_given(source: Source) -> list[str]:
    """List the uses of parts of a project by name, ``module: times``."""
    times = {name: len(GIVEN.findall(text)) for name, text in source.texts.items()}
    return [f"{name}: {n}" for name, n in times.items() if n]


def changes_of_projects(source: Source) -> list[str]:
    """List the functions that return a changed project: annotated so, and no readers of files."""
    found = []
    for module, tree in source.trees.items():
        for node in ast.walk(tree):
            if not isinstance(node, ast.FunctionDef) or node.returns is None:
                continue
            reads = node.name.lstrip("_").split("_")[0] in READERS
            returned = ast.unparse(node.returns).replace('"', "").replace("'", "")
            if not reads and {part.strip() for part in returned.split("|")} & {*STATES}:
                found.append(f"{module}.{node.name}")
    return found


def gatherers(source: Source) -> list[str]:
    """List the functions that turn records of a project into arrays for a fit.

    A public function or method below reports and commands which, itself or by functions of its
    module, reads the attribute ``records``, ``comparable`` or ``recordings`` of something and
    calls `gather` or `Records`, or gives a project other records to gather by ``changed``. Of
    those that call one another within a module only the first counts.
    """
    found, called = [], {}
    for module, tree in source.trees.items():
        if module.split(".")[0] in ABOVE:
            continue
        own = dict(functions_of(tree))
        by_name = {name.split(".")[-1]: node for name, node in own.items()}
        for name, node in own.items():
            within = _with_called(node, by_name)
            nodes = [n for each in within for n in ast.walk(each)]
            if not name.split(".")[-1].startswith("_") and _gathers(nodes):
                key = f"{module}.{name}"
                found.append(key)
                called[key] = {f"{module}.{other.name}" for other in within}
    return [key for key in found if not any(key in called[o] for o in found if o != key)]


def _gathers(nodes):
    """Return whether nodes of code read records and make arrays or other records of them."""
    calls = [n for n in nodes if isinstance(n, ast.Call)]
    methods = [call.func for call in calls]
    reads = any(
        isinstance(n, ast.Attribute) and n.attr in RECORDS and n not in methods for n in nodes
    )
    names = [getattr(f, "id", getattr(f, "attr", "")) for f in methods]
    edits = any(
        name == "changed" and any(word.arg == "records" for word in call.keywords)
        for name, call in zip(names, calls, strict=True)
    )
    return reads and (edits or not GATHERS.isdisjoint(names))


def _with_called(node, own):
    """Return a function and the functions of its module that it names, itself or by another."""
    nodes, waiting = [], [node]
    while waiting:
        nodes.append(waiting.pop())
        named = {name.removeprefix(".") for name in names_in([nodes[-1]])} & own.keys()
        waiting += [own[name] for name in named if own[name] not in [*nodes, *waiting]]
    return nodes


def lists_of_linear(source: Source) -> list[str]:
    """List what states apart from the laws which of them are linear.

    Assignments at the top level whose name has the word LINEAR or STICKING and whose value holds
    names of laws, and functions that say in their name that joints or laws are elastic or linear
    and hold such names.
    """
    laws = set()
    for path in (source.root / "fortran").glob("*_laws.f90"):
        laws |= set(LAW.findall(path.read_text(encoding="utf-8")))
    found = []
    for module, tree in source.trees.items():
        for node in tree.body:
            texts = {n.value for n in ast.walk(node) if isinstance(n, ast.Constant)}
            if isinstance(node, (ast.Assign, ast.AnnAssign)):
                names = [n.id for n in ast.walk(node) if isinstance(n, ast.Name)]
                words = set(names[0].lower().split("_")) if names else set()
                if words & {"linear", "sticking"} and texts & laws:
                    found.append(f"{module}.{names[0]}")
            elif isinstance(node, ast.FunctionDef):
                words = set(node.name.lower().split("_"))
                if words & {"elastic", "linear"} and words & {"joints", "laws"} and texts & laws:
                    found.append(f"{module}.{node.name}")
    return found


def unreached(source: Source) -> dict[str, int]:
    """Return the lines of functions, classes and methods that no command reaches, by name.

    Reached are the command line, statements at the top level of modules, functions that a decorator
    enters somewhere, and what reached code names: a function or class by its name or its import, a
    method by its bare name, of whatever class, special methods with their class.
    """
    graph = _Names(source)
    reached, waiting = set(), list(graph.entries)
    while waiting:
        key = waiting.pop()
        if key in graph.uses and key not in reached:
            reached.add(key)
            waiting += graph.uses[key]
    return {key: count for key, count in graph.lines.items() if key not in reached}


class _Names:
    """Graph of names: what each definition of a package uses, and the entries to them."""

    def __init__(self, source):
        self.source = source
        self.uses, self.lines, self.entries = {}, {}, []
        self.methods = {}
        for tree in source.trees.values():
            for name, _ in functions_of(tree):
                self.methods.setdefault(name.split(".")[-1], [])
        for module, tree in source.trees.items():
            for name, _ in functions_of(tree):
                if "." in name:
                    self.methods[name.split(".")[-1]].append(f"{module}.{name}")
        for module, tree in source.trees.items():
            for node in tree.body if module else ():  # the front door names everything
                self._add(module, node)

    def _add(self, module, node):
        """Add a statement of a module."""
        always = module.split(".")[0] in ("cli", "__main__")
        if isinstance(node, ast.FunctionDef):
            self._enter(module, node.name, [node], _length(node), always or _is_entered(node))
        elif isinstance(node, ast.ClassDef):
            inner = [n for n in node.body if isinstance(n, ast.FunctionDef)]
            own = [n for n in node.body if n not in inner]
            own += [*node.bases, *node.decorator_list, *node.keywords]
            length = _length(node) - sum(map(_length, inner))
            key = self._enter(module, node.name, own, length, always)
            for method in inner:
                entered = always or _is_entered(method)
                name = f"{node.name}.{method.name}"
                method_key = self._enter(module, name, [method], _length(method), entered)
                if _is_special(method):
                    self.uses[key].append(method_key)
        elif not isinstance(node, (ast.Import, ast.ImportFrom)):
            self._enter(module, f"line {node.lineno}", [node], 0, True)

    def _enter(self, module, name, nodes, length, entered):
        """Enter a definition; return its key."""
        key = f"{module}.{name}"
        known = self.source.meanings[module]
        homes = [home for each in known.values() for home in each]
        self.uses[key], self.lines[key] = [], length
        for used in names_in(nodes):
            bare = used.removeprefix(".")
            if used == bare:
                self.uses[key] += known.get(bare, ())
            else:
                self.uses[key] += self.methods.get(bare, [])
                self.uses[key] += [f"{home}.{bare}" for home in homes]
        if entered:
            self.entries.append(key)
        return key


def _is_special(node):
    """Return whether Python calls a method by itself."""
    return node.name.startswith("__") and node.name.endswith("__")


def _is_entered(node):
    """Return whether a decorator enters a function in a table, from which it is called."""
    called = (d.func if isinstance(d, ast.Call) else d for d in node.decorator_list)
    return any(ast.unparse(each).split(".")[-1] not in NO_CALLERS for each in called)


def _length(node):
    """Return the lines of a definition with its decorators."""
    first = min([node.lineno, *(d.lineno for d in node.decorator_list)])
    return node.end_lineno - first + 1


def loaded(source: Source, door: str) -> int:
    """Return how many modules of the package a public name loads in a fresh process.

    The package itself and its compiled core are among them.
    """
    code = (
        f"import sys, pyblast; pyblast.{door}; "
        "print(sum(name.split('.')[0] == 'pyblast' for name in sys.modules))"
    )
    return int(_by_own_interpreter(source.root, ["-c", code]).splitlines()[-1])


def _by_own_interpreter(root, arguments):
    """Return what the interpreter of a checkout prints; that of this checkout is this one."""
    python = Path(sys.executable) if root == ROOT else root / ".venv" / "bin" / "python"
    if not python.exists():
        sys.exit(f"house: {python}: missing; ./dev test --collect-only in {root} sets it up")
    done = subprocess.run(
        [python, "-P", *map(str, arguments)], cwd=root, capture_output=True, text=True, check=False
    )
    if done.returncode:
        sys.exit(f"house: {python} ended with {done.returncode}:\n{done.stderr[-3000:]}")
    sys.stderr.writelines(line for line in done.stderr.splitlines(True) if "house:" in line[:6])
    return done.stdout


def counted(source: Source) -> tuple[dict, dict[str, list[str]]]:
    """Return the counts of the source by name, and what was counted."""
    lists = {
        "uses of given": uses_of_given(source),
        "changes of a project": changes_of_projects(source),
        "gatherers of records": gatherers(source),
        "lists of what is linear": lists_of_linear(source),
        "public names with two homes": [
            f"{name} ({', '.join(homes)})" for name, homes in source.two_homes.items()
        ],
        "back_analysis in diagnosis": sorted(source.sideways("diagnosis", "back_analysis")),
    }
    left = unreached(source)
    with ThreadPoolExecutor() as threads:
        each = list(threads.map(partial(loaded, source), DOORS))
    counts = {
        **sizes(source),
        **{f"modules loaded by {door}": n for door, n in zip(DOORS, each, strict=True)},
        **{name: len(found) for name, found in lists.items()},
        "uses of given": sum(int(each.split(": ")[1]) for each in lists["uses of given"]),
        "lines that no command reaches": sum(left.values()),
    }
    lists["lines that no command reaches"] = [
        f"{key} {n}" for key, n in sorted(left.items(), key=lambda item: -item[1])
    ]
    return counts, lists


def profiled(source: Source) -> dict:
    """Return the counts of one run and one diagnosis of the quick start's case, and the walks."""
    case = source.root / "build" / "house" / "hidden"
    if not (case / "S1.toml").is_file():
        _by_own_interpreter(source.root, [source.root / "examples/04_hidden_closure.py", case])
    found: dict = {}
    for job in ("walks", "run", "diagnose"):
        order = ",".join(source.order)
        printed = _by_own_interpreter(source.root, [WALKS, job, case, order])
        found |= json.loads(printed.splitlines()[-1])
    return found


def table(rows: dict[str, dict]) -> str:
    """Return rows as a table: one line for each measure, one column for each row."""
    measures = list(dict.fromkeys(name for row in rows.values() for name in row["counts"]))
    heads = ["", *rows, "goal"]
    lines = [
        [name, *(_cell(row["counts"].get(name)) for row in rows.values()), _cell(GOALS.get(name))]
        for name in measures
    ]
    widths = [max(len(line[k]) for line in [heads, *lines]) for k in range(len(heads))]
    return "\n".join(
        "  ".join(
            text.ljust(width) if k == 0 else text.rjust(width)
            for k, (text, width) in enumerate(zip(line, widths, strict=True))
        ).rstrip()
        for line in [heads, *lines]
    )


def _cell(value):
    """Return a value as the text of a cell."""
    return "" if value is None else f"{value:,}" if isinstance(value, int) else str(value)


def store(step: str, row: dict, path: Path = STORED) -> dict[str, dict]:
    """Enter the row of a step in the file; return all rows.

    Counts that this row does not have, such as those of a run, stay as they are.
    """
    rows = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
    before = rows.get(step, {}).get("counts", {})
    rows[step] = row | {"counts": before | row["counts"]}
    path.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    return rows


def commit_of(root: Path) -> str:
    """Return the commit of a checkout, with a plus where its package differs from it."""
    git = ["git", "-C", str(root)]
    head = subprocess.run(
        [*git, "rev-parse", "--short=10", "HEAD"], capture_output=True, text=True, check=True
    )
    changed = subprocess.run(
        [*git, "status", "--porcelain", "pyblast", "fortran"],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    return head.stdout.strip() + "+" * bool(changed.stdout.strip())


def main(arguments: list[str]) -> None:
    """Count, print and store what the options ask for."""
    assert __doc__
    parser = argparse.ArgumentParser("house", description=__doc__.splitlines()[0])
    parser.add_argument("--tree", type=Path, default=ROOT, help="another checkout")
    parser.add_argument("--dynamic", action="store_true", help="a run and a diagnosis, too")
    parser.add_argument("--step", help="name of the row to store in verification/house.json")
    asked = parser.parse_args(arguments)
    source = Source(asked.tree.resolve())
    counts, lists = counted(source)
    if asked.dynamic:
        counts |= profiled(source)
    day = time.strftime("%Y-%m-%d")
    row = {"commit": commit_of(source.root), "date": day, "counts": counts}
    for name, found in lists.items():
        print(f"{name}:", *found, sep="\n  ", end="\n\n")
    rows = json.loads(STORED.read_text(encoding="utf-8")) if STORED.is_file() else {}
    rows = store(asked.step, row) if asked.step else rows | {"now": row}
    print(table(rows))


if __name__ == "__main__":
    main(sys.argv[1:])
