"""Put plausible defects into a copy of the source, one at a time, and see which tests notice.

    python -m verification.mutate [WORDS ...] [--again]

The defects are those of ``mutants.toml`` whose name or file holds one of the words; all of them
without words. ``mutants.json`` keeps what caught each; those it has are left out unless asked for
again, and survivors are always tried again. The copy and its build are in ``build/mutants``.
"""

import json
import os
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
TABLE = ROOT / "verification" / "mutants.toml"
RESULTS = ROOT / "verification" / "mutants.json"
SCRATCH = ROOT / "build" / "mutants"
CASE = "tests/verification/test_suite.py::test_the_first_mesh_of_a_case_is_as_good_as_it_was"
LONGEST = 600  # s that the tests of one defect may take
ENOUGH = 3  # tests that notice a defect
MESON = ("-Dnative=true", "-Doptimization=1", "-Dstandalone=auto")
# In a process of its own: the copy, not the installed package, and what failed as one line of JSON.
RUN_TESTS = """
import json, sys
sys.meta_path[:] = [m for m in sys.meta_path if "editable" not in type(m).__module__]
sys.path.insert(0, ".")
import pytest, pyblast
assert "mutants" in pyblast.__file__, pyblast.__file__
failed = []
class Failures:
    def pytest_runtest_logreport(self, report):
        if report.failed:
            failed.append(report.nodeid)
    def pytest_collectreport(self, report):
        if report.failed:
            failed.append(report.nodeid)
pytest.main(sys.argv[1:], plugins=[Failures()])
print("\\n" + json.dumps(failed))
"""


def table():
    """Return the defects, and the tests of each file."""
    held = tomllib.loads(TABLE.read_text(encoding="utf-8"))
    return held["mutant"], held["tests"]


def copied():
    """Copy what git knows into the scratch folder; return the folder."""
    folder = SCRATCH / "source"
    listed = ["git", "ls-files", "--cached", "--others", "--exclude-standard"]
    names = subprocess.run(listed, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    for name in names.splitlines():
        if (ROOT / name).is_file():
            put(folder / name, (ROOT / name).read_bytes())
    return folder


def put(path, raw):
    """Write a file unless it holds these bytes, so that no more is built than changed."""
    if not path.is_file() or path.read_bytes() != raw:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(raw)


def built(folder):
    """Build the copy and put its cores into the package; return whether that worked."""
    made = SCRATCH / "objects"
    tools = {**os.environ, "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}
    if not (made / "build.ninja").is_file():
        setup = ["meson", "setup", str(made), str(folder), *MESON]
        subprocess.run(setup, check=True, env=tools, stdout=subprocess.DEVNULL)
    done = subprocess.run(["ninja", "-C", str(made)], env=tools, capture_output=True, check=False)
    if done.returncode:
        return False
    for core in (made / "fortran").glob("_core*.so"):
        shutil.copy2(core, folder / "pyblast" / core.name)
    program = made / "fortran" / "pyblast-run"
    if program.is_file():
        (folder / "pyblast" / "bin").mkdir(exist_ok=True)
        shutil.copy2(program, folder / "pyblast" / "bin" / program.name)
    return True


def failures(folder, tests, most=ENOUGH):
    """Return the tests of the copy that fail, or what ended them."""
    named = [f"{CASE}[{t.removeprefix('suite:')}]" if t.startswith("suite:") else t for t in tests]
    options = ["-q", "-n0", "--tb=no", f"--maxfail={most}", "-p", "no:cacheprovider"]
    command = [sys.executable, "-c", RUN_TESTS, *options, *named]
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "PYTHONDONTWRITEBYTECODE": "1"}
    try:
        done = subprocess.run(
            command, cwd=folder, env=environment, capture_output=True, text=True, check=False,
            timeout=LONGEST,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return ["time limit"]
    if done.returncode:
        return [f"end of the process, {done.returncode}"]
    return json.loads(done.stdout.strip().splitlines()[-1])


def caught_by(folder, mutant, tests):
    """Return what notices a defect; the copy is as before afterwards."""
    path = folder / mutant["file"]
    text = path.read_text(encoding="utf-8")
    if text.count(mutant["original"]) != 1:
        raise SystemExit(
            f"mutate: '{mutant['name']}': its text must occur once in {mutant['file']}"
        )
    compiled = mutant["file"].startswith("fortran/")
    try:
        path.write_text(text.replace(mutant["original"], mutant["mutated"]), encoding="utf-8")
        if compiled and not built(folder):
            return ["compiler"]
        return failures(folder, tests[mutant["file"]])
    finally:
        path.write_text(text, encoding="utf-8")


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
    folder = copied()
    print(f"mutate: {len(chosen)} defects; builds the copy", flush=True)
    if not built(folder):
        raise SystemExit(f"mutate: the copy in {folder} can't be built")
    for file in sorted({m["file"] for m in chosen}):
        if broken := failures(folder, tests[file]):
            raise SystemExit(f"mutate: fails without a defect: {', '.join(broken)}")
    for number, mutant in enumerate(sorted(chosen, key=lambda m: m["file"]), 1):
        key = mutant["name"], mutant["file"]
        results[key] = caught_by(folder, mutant, tests)
        print(f"{number:>3} {'caught' if results[key] else 'SURVIVES'}: {key[0]} ({key[1]})",
              flush=True)  # fmt: skip
        held = [{"name": m["name"], "file": m["file"], "caught_by": results[m["name"], m["file"]]}
                for m in mutants if (m["name"], m["file"]) in results]  # fmt: skip
        RESULTS.write_text(json.dumps(held, indent=1) + "\n", encoding="utf-8")
    built(folder)
    survivors = [key for key in ((m["name"], m["file"]) for m in mutants) if results.get(key) == []]
    print(f"mutate: {len(results)} of {len(mutants)} tried, {len(survivors)} survive")
    for name, file in survivors:
        print(f"  {name} ({file})")
    return 1 if survivors else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
