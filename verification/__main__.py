"""Run the verification suite and store its results.

    python -m verification [CASE ...] [--quick] [--page]

Without names every case is run. ``verification/results.json`` keeps the results of the other
cases, each with its date and the digest of the program that it measured, and judges them anew; the
table and the figures in docs are written from it. ``--page`` measures none.
"""

import importlib
import json
import pkgutil
import sys
import time
from pathlib import Path

from benchmarks.timing import stamp
from pyblast.errors import PyblastError
from pyblast.files import write_text

from . import cases, page
from .asked import NOT_MEASURED
from .problems import PROBLEMS
from .rows import program, read_rows
from .suite import CASES, judge, meshes_asked, verdict

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
        "note": problem.note,
        **stamp(), "program": program(),
    }  # fmt: skip
    try:
        outcomes = [problem.measure(mesh) for mesh in record["meshes"]] or [problem.measure()]
        beside = {} if quick else {n: problem.measure(n)[0] for n in meshes_asked(problem)}
    except (PyblastError, ArithmeticError, LookupError, ValueError) as error:
        return {**record, "pass": False, "failure": f"{type(error).__name__}: {error}"}, []
    rows = judge(problem, [readings for readings, _ in outcomes], beside)
    seconds = round(time.perf_counter() - began, 1)
    result = {**record, "seconds": seconds, "quantities": rows}
    return concluded(problem, result), outcomes[-1][1]


def concluded(problem, result):
    """Return a result with whether it passes and is as asked; what is not measured is not."""
    rows, missing = result["quantities"], list(NOT_MEASURED.get(problem.number, ()))
    passed = all(row["pass"] for row in rows)
    as_asked = not missing and all(row["as_asked"] is not False for row in rows)
    return {**result, "pass": passed, "as_asked": as_asked, "not_measured": missing}


def judged_anew(problem, result):
    """Return a stored result by the rules of today."""
    if "failure" in result:
        return result
    rows = [verdict(problem, row) for row in result["quantities"]]
    about = {"title": problem.title, "source": problem.source, "note": problem.note}
    return concluded(problem, {**result, **about, "quantities": rows})


def store(results):
    """Judge all results anew and keep them, by number; write the table of the page."""
    ordered = sorted(results, key=page.by_number)
    results = {name: judged_anew(CASES[name], results[name]) for name in ordered}
    write_text(RESULTS, json.dumps(results, indent=1) + "\n")
    page.write_table(results, PROBLEMS)


def main(arguments):
    """Run the cases given; return 1 if one fails."""
    register_all()
    quick, only_page = "--quick" in arguments, "--page" in arguments
    names = [a for a in arguments if not a.startswith("--")]
    names = names or ([] if only_page else sorted(CASES, key=page.by_number))
    unknown = [name for name in names if name not in CASES]
    if unknown:
        known = ", ".join(sorted(CASES, key=page.by_number))
        sys.exit(f"verify: no case {', '.join(unknown)}; there are {known}")
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
            store(read_rows(RESULTS) | {name: result})
            page.draw(name, result, curves)
    if only_page:
        store(read_rows(RESULTS))
    print(f"verify: failed {', '.join(failed)}" if failed else "verify: all passed")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
