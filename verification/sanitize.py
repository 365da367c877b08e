"""Run the kernel tests with builds that check themselves: bounds, then address and undefined.

    python -m verification.sanitize [bounds] [address]

The first build ends where an index, a pointer or an argument is wrong; the second where memory is
read or written that is not its own, or arithmetic is undefined. What failing tests say stays in
``build/sanitize-NAME``.
"""

import shutil
import subprocess
import sys
from pathlib import Path

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
COMMON = ("-Doptimization=1", "-Ddebug=true")
BUILDS = {
    "bounds": ("-Dfortran_args=-fcheck=all,no-array-temps",),
    "address": ("-Db_sanitize=address,undefined", "-Db_lundef=false"),
}


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


def main(names):
    """Build and test; return 1 if anything is found."""
    found = False
    for name in names or BUILDS:
        if name not in BUILDS:
            raise SystemExit(f"sanitize: no build {name}; there are {', '.join(BUILDS)}")
        print(f"sanitize: {name}: builds and tests", flush=True)
        copy = Copy(f"sanitize-{name}", *COMMON, *BUILDS[name])
        if not copy.build():
            raise SystemExit(f"sanitize: the copy in {copy.folder} can't be built")
        for tests in TESTS:
            failed = copy.failures([tests], longest=LONGEST, **environment(name))
            found = found or bool(failed)
            print(f"sanitize: {name}: {tests}: {', '.join(failed) or 'nothing'}", flush=True)
            if failed:
                shutil.copy(copy.folder / "tests.log", copy.folder / f"{Path(tests).stem}.log")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
