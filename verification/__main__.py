"""Run the verification suite and store its results.

    python -m verification [CASE ...] [--quick]

Without names every case is run. ``verification/results.json`` keeps the results of the other
cases; the table and the figures in docs are written from it.
"""

import importlib
import json
import pkgutil
import sys
import time
from pathlib import Path

from pyblast.errors import PyblastError
from pyblast.files import write_text

from . import cases, page
from .asked import NOT_MEASURED
from .problems import PROBLEMS
from .suite import CASES, judge, meshes_asked

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "verification" / "results.json"


def register_all():
    """Import all modules of cases, which register them in `CASES`."""
    for module in pkgutil.iter_modules(cases.__path__):
        importlib.import_module(f"{cases.__name__}.{module.name}")


def run_case(problem, quick=False):
    """Run one case; return its result and the curves of its last mesh.

    A case that can't be measured fails; its result gives the reason.
    """
    began = time.perf_counter()
    record = {
        "title": problem.title,
        "source": problem.source,
        "gate": problem.gate,
        "unit": problem.unit,
        "meshes": list(problem.meshes[:1] if quick else problem.meshes),
        "least_order": problem.order,
        "note": problem.note,
    }
    try:
        outcomes = [problem.measure(mesh) for mesh in record["meshes"]] or [problem.measure()]
        beside = {} if quick else {n: problem.measure(n)[0] for n in meshes_asked(problem)}
    except (PyblastError, ArithmeticError, LookupError, ValueError) as error:
        return {**record, "pass": False, "failure": f"{type(error).__name__}: {error}"}, []
    rows = judge(problem, [readings for readings, _ in outcomes], beside)
    seconds = round(time.perf_counter() - began, 1)
    passed = all(row["pass"] for row in rows)
    missing = list(NOT_MEASURED.get(problem.number, ()))
    as_asked = not missing and all(row["as_asked"] is not False for row in rows)
    result = {**record, "pass": passed, "as_asked": as_asked, "seconds": seconds}
    return {**result, "not_measured": missing, "quantities": rows}, outcomes[-1][1]


def main(arguments):
    """Run the cases given; return 1 if one fails."""
    register_all()
    quick = "--quick" in arguments
    names = [a for a in arguments if a != "--quick"] or sorted(CASES, key=page.by_number)
    unknown = [name for name in names if name not in CASES]
    if unknown:
        known = ", ".join(sorted(CASES, key=page.by_number))
        sys.exit(f"verify: no case {', '.join(unknown)}; there are {known}")
    results = json.loads(RESULTS.read_text()) if RESULTS.is_file() else {}
    failed = []
    for name in names:
        if quick and not CASES[name].quick:
            continue
        print(f"{name:>4} {CASES[name].title} ...", end=" ", flush=True)
        result, curves = run_case(CASES[name], quick)
        missed = "" if quick or result.get("as_asked", True) else "(but not on the mesh asked for) "
        print("pass" if result["pass"] else "FAIL", f"{missed}{result.get('seconds', 0.0):.0f} s")
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
