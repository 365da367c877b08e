"""Put plausible defects into a copy of the source, one at a time, and see which tests notice.

    python -m verification.mutate [WORDS ...] [--again] [--minutes N]

The defects are those of ``mutants.toml`` whose name or file holds one of the words; all of them
without words. ``mutants.json`` keeps what caught each; those it has are left out unless asked for
again, and survivors are always tried again. The copy and its build are in ``build/mutants``.
"""

import sys
import tomllib

from . import page
from .rows import each_row, options, read_rows
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


def label(mutant):
    """Return the name of a defect's row."""
    return f"{mutant['name']} ({mutant['file']})"


def tried(copy, mutant, tests):
    """Return the row of a defect."""
    caught = caught_by(copy, mutant, tests)
    print("caught:" if caught else "SURVIVES:", end=" ", flush=True)
    return {"name": mutant["name"], "file": mutant["file"], "caught_by": caught}


def main(arguments):
    """Try the defects named; return 1 if one survives."""
    words, limits = options(arguments)
    mutants, tests = table()
    by_label = {label(m): m for m in sorted(mutants, key=lambda m: m["file"])}
    chosen = [n for n in by_label if not words or any(word in n for word in words)]
    if not limits.pop("again", False):
        known = read_rows(RESULTS)
        chosen = [n for n in chosen if not known.get(n, {}).get("caught_by")]
    copy = Copy("mutants", "-Dnative=true", "-Doptimization=1")
    print(f"mutate: {len(chosen)} defects; builds the copy", flush=True)
    if not copy.build():
        raise SystemExit(f"mutate: the copy in {copy.folder} can't be built")
    for each in sorted({tuple(tests[by_label[n]["file"]]) for n in chosen}):
        if broken := copy.failures(each, ENOUGH):
            raise SystemExit(f"mutate: fails without a defect: {', '.join(broken)}")
    rows = each_row(
        RESULTS, chosen, lambda n: tried(copy, by_label[n], tests), again=True, **limits
    )
    copy.build()
    held = [rows[label(m)] for m in mutants if label(m) in rows]
    page.write_defects(held, len(mutants))
    survivors = [one for one in held if not one["caught_by"]]
    print(f"mutate: {len(held)} of {len(mutants)} tried, {len(survivors)} survive")
    for one in survivors:
        print(f"  {one['name']} ({one['file']})")
    return 1 if survivors else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
