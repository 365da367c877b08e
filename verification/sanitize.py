"""Run kernels in builds that check themselves: bounds, then address and undefined, then threads.

    python -m verification.sanitize [bounds] [address] [threads]

The first build ends where an index, a pointer or an argument is wrong; the second where memory is
read or written that is not its own, or arithmetic is undefined; both run the tests of the kernels.
The third checks indices in code that is not optimized, on 1, 2 and 5 threads: it runs rows of
`verification.bits`, whose models are large enough for threads to share a step, through both doors,
and each has to have the bits of one thread. What fails stays in ``build/sanitize-NAME``.
"""

import shutil
import subprocess
import sys
from pathlib import Path

from . import bits
from .rows import read_rows
from .scratch import ROOT, Copy

TESTS = (
    *(
        f"tests/fortran/{path.name}"
        for path in sorted((ROOT / "tests" / "fortran").glob("test_*.py"))
    ),
    "tests/solver/test_hexahedral_runs.py",
    "tests/solver/test_run_batches.py",
    "tests/solver/test_run_quadratic.py",
    "tests/verification/test_every_law.py",
)
LONGEST = 3600.0  # s that a file of tests may take: checked builds are ten times slower
CHECKS = "-Dfortran_args=-fcheck=all,no-array-temps"
BUILDS = {
    "bounds": ("-Doptimization=1", "-Ddebug=true", CHECKS),
    "address": (
        "-Doptimization=1", "-Ddebug=true", "-Db_sanitize=address,undefined", "-Db_lundef=false",
    ),
    "threads": ("-Doptimization=0", "-Ddebug=true", CHECKS),
}  # fmt: skip
MOST_STEPS = 120  # of a row that the slow build runs


def environment(name):
    """Return what the tests of a build need to find in their environment."""
    if name != "address":
        return {}
    found = [
        subprocess.run(["gfortran", f"-print-file-name={library}"], capture_output=True, text=True,
                       check=True).stdout.strip()
        for library in ("libasan.so", "libubsan.so")
    ]  # fmt: skip
    return {
        "LD_PRELOAD": " ".join(found),
        "ASAN_OPTIONS": "detect_leaks=0:halt_on_error=1:allocator_may_return_null=1",
        "UBSAN_OPTIONS": "print_stacktrace=1:halt_on_error=1",
    }


def on_threads(copy):
    """Run rows of bits in a copy; return those that end, or differ between numbers of threads."""
    failed = []
    stored = read_rows(bits.OUT)
    out = copy.source / bits.OUT.relative_to(ROOT)
    for name in bits.ROWS:
        if name not in stored or stored[name]["steps"] > MOST_STEPS:
            continue
        done = copy.python(["-m", "verification.bits", name, "--again"], LONGEST)
        row = read_rows(out)[name]
        same = done.returncode == 0 and not any(row["differs"].values())
        print(f"sanitize: threads: {name}: {'nothing' if same else 'FAILED'}", flush=True)
        if not same:
            failed.append(name)
            said = done.stdout + done.stderr
            (copy.folder / f"{len(failed)}.log").write_text(said, encoding="utf-8")
    return failed


def main(names):
    """Build and test; return 1 if anything is found."""
    found = False
    for name in names or BUILDS:
        if name not in BUILDS:
            raise SystemExit(f"sanitize: no build {name}; there are {', '.join(BUILDS)}")
        print(f"sanitize: {name}: builds and tests", flush=True)
        copy = Copy(f"sanitize-{name}", *BUILDS[name])
        if not copy.build():
            raise SystemExit(f"sanitize: the copy in {copy.folder} can't be built")
        if name == "threads":
            found = bool(on_threads(copy)) or found
            continue
        for tests in TESTS:
            failed = copy.failures([tests], longest=LONGEST, **environment(name))
            found = found or bool(failed)
            print(f"sanitize: {name}: {tests}: {', '.join(failed) or 'nothing'}", flush=True)
            if failed:
                shutil.copy(copy.folder / "tests.log", copy.folder / f"{Path(tests).stem}.log")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
