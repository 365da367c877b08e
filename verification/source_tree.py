"""The source of pyblast as a tree of modules: what each defines, imports and names."""

import ast
from functools import cached_property
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
ORDER_HOME = "tests/house/test_architecture.py"


class Source:
    """Source of the package of a checkout, parsed: nothing of it is imported or run.

    Parameters
    ----------
    root : path
        Checkout; its package lies in the folder ``pyblast``.
    """

    def __init__(self, root: Path = ROOT):
        self.root = Path(root)
        self.package = self.root / "pyblast"
        self.paths = sorted(self.package.rglob("*.py"))
        self.texts = {self.dotted(path): path.read_text(encoding="utf-8") for path in self.paths}
        self.trees = {name: ast.parse(text) for name, text in self.texts.items()}

    def dotted(self, path: Path) -> str:
        """Return the name of a module within the package, such as ``solver.run``."""
        parts = path.relative_to(self.package).with_suffix("").parts
        return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)

    def imported(self, name: str) -> tuple[set[str], set[str]]:
        """Return the modules of the package and the foreign packages that a module imports.

        Imports within functions are among them.
        """
        return self._imports[name]

    @cached_property
    def _imports(self):
        """Own modules and foreign packages of each module."""
        return {name: self._imports_of(name) for name in self.trees}

    def _imports_of(self, name):
        """Return own modules and foreign packages of one module."""
        own, foreign = set(), set()
        package = name.split(".")[:-1]
        for node in ast.walk(self.trees[name]):
            if isinstance(node, ast.ImportFrom) and node.level:
                base = package[: len(package) - node.level + 1]
                base += [node.module] if node.module else []
                named = {".".join([*base, alias.name]) for alias in node.names}
                own |= (named & set(self.trees)) or {".".join(base)}
                foreign |= {alias.name for alias in node.names if alias.name.startswith("_core")}
            elif isinstance(node, ast.ImportFrom):
                foreign.add((node.module or "").split(".")[0])
            elif isinstance(node, ast.Import):
                foreign |= {alias.name.split(".")[0] for alias in node.names}
        return own, foreign

    @cached_property
    def meanings(self) -> dict[str, dict[str, set[str]]]:
        """What the names of each module may stand for, ``module.name``: own and imported.

        What comes from the front door has the module behind it; functions may import different
        things by one name.
        """
        door = self._meanings_in("", {})
        return {name: self._meanings_in(name, door) for name in self.trees}

    def _meanings_in(self, name, door):
        """Return what the names of one module may stand for."""
        package = name.split(".")[:-1]
        known: dict[str, set[str]] = {}
        for node in ast.walk(self.trees[name]):
            if isinstance(node, ast.ImportFrom) and node.level:
                base = package[: len(package) - node.level + 1]
                base += [node.module] if node.module else []
                for alias in node.names:
                    meant = ".".join([*base, alias.name])
                    known.setdefault(alias.asname or alias.name, set()).update(
                        door.get(meant, {meant})
                    )
        for node in self.trees[name].body:
            if isinstance(node, DEFINITIONS):
                known.setdefault(node.name, set()).add(f"{name}.{node.name}")
        return known

    @cached_property
    def homes(self) -> dict[str, list[str]]:
        """Modules that define each public function or class at their top level, by its name."""
        found: dict[str, list[str]] = {}
        for module, tree in self.trees.items():
            for name in {n.name for n in tree.body if isinstance(n, DEFINITIONS)}:
                if module and not name.startswith("_"):
                    found.setdefault(name, []).append(module)
        return found

    @property
    def two_homes(self) -> dict[str, list[str]]:
        """Public names that more than one module defines, with these modules."""
        return {name: homes for name, homes in sorted(self.homes.items()) if len(homes) > 1}

    def sideways(self, above: str, below: str) -> set[str]:
        """Return ``module: name`` of all that a package takes from another one."""
        found = set()
        for module, tree in self.trees.items():
            if module.split(".")[0] != above:
                continue
            depth = module.count(".") + (self.package / module.replace(".", "/")).is_dir()
            for node in ast.walk(tree):
                if not isinstance(node, ast.ImportFrom) or node.level != depth + 1:
                    continue
                names = [alias.name for alias in node.names]
                parts = (node.module or "").split(".")
                if parts[0] == below:
                    found |= {f"{module}: {name}" for name in names}
                elif not node.module and below in names:
                    found.add(f"{module}: {below}")
        return found

    @property
    def order(self) -> list[str]:
        """Packages from the ground up, as the house test of this checkout lists them."""
        tree = ast.parse((self.root / ORDER_HOME).read_text(encoding="utf-8"))
        (order,) = (
            node.value
            for node in tree.body
            if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "PACKAGES"
        )
        return ast.literal_eval(order)


DEFINITIONS = ast.FunctionDef, ast.ClassDef


def functions_of(tree: ast.Module) -> list[tuple[str, ast.FunctionDef]]:
    """Return the functions of a module and its methods, with the name of the class before."""
    found = []
    for node in tree.body:
        if isinstance(node, ast.FunctionDef):
            found.append((node.name, node))
        elif isinstance(node, ast.ClassDef):
            own = (n for n in node.body if isinstance(n, ast.FunctionDef))
            found += [(f"{node.name}.{n.name}", n) for n in own]
    return found


def names_in(nodes: list[ast.AST]) -> set[str]:
    """Return what pieces of code name: variables, and attributes with a point before them."""
    found = set()
    for node in (inner for each in nodes for inner in ast.walk(each)):
        if isinstance(node, ast.Name):
            found.add(node.id)
        elif isinstance(node, ast.Attribute):
            found.add(f".{node.attr}")
    return found
