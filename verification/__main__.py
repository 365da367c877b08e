"""Run the rungs of the ladder and keep what they gave.

    python -m verification [RUNG ...] [--quick]

Without names every rung is run. ``verification/results.json`` keeps the results of rungs that are
not run now; the table and the figures in docs follow from it.
"""

import importlib
import json
import pkgutil
import sys
import time
from pathlib import Path

from pyblast.errors import PyblastError
from pyblast.project.result import write_text

from . import page, rungs
from .ladder import RUNGS, judged
from .problems import PROBLEMS

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "verification" / "results.json"


def register_all():
    """Import all rungs, so that they are in `RUNGS`."""
    for module in pkgutil.iter_modules(rungs.__path__):
        importlib.import_module(f"{rungs.__name__}.{module.name}")


def climb(one, quick=False):
    """Run one rung; return its result and the curves of its last mesh.

    A rung that can't be measured is a failed one: its result says why.
    """
    began = time.perf_counter()
    about = {
        "title": one.title, "source": one.source, "gate": one.gate, "unit": one.unit,
        "meshes": list(one.meshes[:1] if quick else one.meshes), "least_order": one.order,
        "note": one.note,
    }  # fmt: skip
    try:
        found = [one.measure(mesh) for mesh in about["meshes"]] or [one.measure()]
    except (PyblastError, ArithmeticError, LookupError, ValueError) as error:
        return {**about, "pass": False, "failure": f"{type(error).__name__}: {error}"}, []
    rows = judged(one, [readings for readings, _ in found])
    seconds = round(time.perf_counter() - began, 1)
    passed = all(row["pass"] for row in rows)
    return {**about, "pass": passed, "seconds": seconds, "quantities": rows}, found[-1][1]


def main(arguments):
    """Run what is asked for; return 1 where a rung failed."""
    register_all()
    quick = "--quick" in arguments
    names = [a for a in arguments if a != "--quick"] or sorted(RUNGS, key=page.by_number)
    unknown = [name for name in names if name not in RUNGS]
    if unknown:
        known = ", ".join(sorted(RUNGS, key=page.by_number))
        sys.exit(f"verify: no rung {', '.join(unknown)}; there are {known}")
    results = json.loads(RESULTS.read_text()) if RESULTS.is_file() else {}
    failed = []
    for name in names:
        if quick and not RUNGS[name].quick:
            continue
        print(f"{name:>4} {RUNGS[name].title} ...", end=" ", flush=True)
        result, curves = climb(RUNGS[name], quick)
        print("pass" if result["pass"] else "FAIL", f"{result.get('seconds', 0.0):.0f} s")
        failed += [] if result["pass"] else [name]
        if not quick:
            results[name] = result
            ordered = {number: results[number] for number in sorted(results, key=page.by_number)}
            write_text(RESULTS, json.dumps(ordered, indent=1) + "\n")
            page.draw(name, result, curves)
    if not quick:
        page.write_table(results, PROBLEMS)
    print(f"verify: failed {', '.join(failed)}" if failed else "verify: all passed")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
