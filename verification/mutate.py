"""Put plausible defects into a copy of the source, one at a time, and see which tests notice.

    python -m verification.mutate [WORDS ...] [--again]

The defects are those of ``mutants.toml`` whose name or file holds one of the words; all of them
without words. ``mutants.json`` keeps what caught each; those it has are left out unless asked for
again, and survivors are always tried again. The copy and its build are in ``build/mutants``.
"""

import json
import sys
import tomllib

from . import page
from .scratch import ROOT, Copy

TABLE = ROOT / "verification" / "mutants.toml"
RESULTS = ROOT / "verification" / "mutants.json"
ENOUGH = 3  # tests that notice a defect


def table():
    """Return the defects, and the tests of each file."""
    held = tomllib.loads(TABLE.read_text(encoding="utf-8"))
    return held["mutant"], held["tests"]


def caught_by(copy, mutant, tests):
    """Return what notices a defect; the copy is as before afterwards."""
    path = copy.source / mutant["file"]
    text = path.read_text(encoding="utf-8")
    if text.count(mutant["original"]) != 1:
        raise SystemExit(
            f"mutate: '{mutant['name']}': its text must occur once in {mutant['file']}"
        )
    compiled = mutant["file"].startswith("fortran/")
    try:
        path.write_text(text.replace(mutant["original"], mutant["mutated"]), encoding="utf-8")
        if compiled and not copy.build():
            return ["compiler"]
        return copy.failures(tests[mutant["file"]], ENOUGH)
    finally:
        path.write_text(text, encoding="utf-8")


def in_order(mutants, results):
    """Return what caught each defect of the table that was tried."""
    return [
        {"name": m["name"], "file": m["file"], "caught_by": results[m["name"], m["file"]]}
        for m in mutants
        if (m["name"], m["file"]) in results
    ]


def main(arguments):
    """Try the defects named; return 1 if one survives."""
    words = [a for a in arguments if a != "--again"]
    mutants, tests = table()
    chosen = [m for m in mutants
              if not words or any(w in m["name"] or w in m["file"] for w in words)]  # fmt: skip
    known = json.loads(RESULTS.read_text()) if RESULTS.is_file() else []
    results = {(r["name"], r["file"]): r["caught_by"] for r in known}
    if "--again" not in arguments:
        chosen = [m for m in chosen if not results.get((m["name"], m["file"]))]
    copy = Copy("mutants", "-Dnative=true", "-Doptimization=1")
    print(f"mutate: {len(chosen)} defects; builds the copy", flush=True)
    if not copy.build():
        raise SystemExit(f"mutate: the copy in {copy.folder} can't be built")
    for each in sorted({tuple(tests[m["file"]]) for m in chosen}):
        if broken := copy.failures(each, ENOUGH):
            raise SystemExit(f"mutate: fails without a defect: {', '.join(broken)}")
    for number, mutant in enumerate(sorted(chosen, key=lambda m: m["file"]), 1):
        key = mutant["name"], mutant["file"]
        results[key] = caught_by(copy, mutant, tests)
        print(f"{number:>3} {'caught' if results[key] else 'SURVIVES'}: {key[0]} ({key[1]})",
              flush=True)  # fmt: skip
        held = in_order(mutants, results)
        RESULTS.write_text(json.dumps(held, indent=1) + "\n", encoding="utf-8")
    copy.build()
    held = in_order(mutants, results)
    page.write_defects(held, len(mutants))
    survivors = [one for one in held if not one["caught_by"]]
    print(f"mutate: {len(held)} of {len(mutants)} tried, {len(survivors)} survive")
    for one in survivors:
        print(f"  {one['name']} ({one['file']})")
    return 1 if survivors else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
