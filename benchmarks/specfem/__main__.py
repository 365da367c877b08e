"""Make the cases that SPECFEM3D records into build/specfem; those that are there stay.

    python -m benchmarks.specfem [--seed N] [case ...]

``PYBLAST_SPECFEM`` is the folder in which SPECFEM3D Cartesian was built. A case that was stopped
goes on with its next run; another seed than that of the proof has a folder of its own.
"""

import argparse
import resource
import shutil
import sys

from pyblast.errors import PyblastError
from verification.rows import ended_by_sigterm

from .case_files import write_case
from .kept import kept
from .plan import SEED, plan, store_of
from .records import recorded
from .worlds import drawn


def main():
    """Make what is asked for and not there."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("cases", nargs="*", metavar="case")
    parser.add_argument("--seed", type=int, default=SEED)
    given = parser.parse_args()
    draws = {draw.name: draw for draw in plan(given.seed)}
    unknown = set(given.cases) - set(draws)
    if unknown:
        parser.error(f"no case is called {' or '.join(sorted(unknown))}; {min(draws)} to "
                     f"{max(draws)} are")  # fmt: skip
    store = store_of(given.seed)
    with ended_by_sigterm():
        try:
            for name in given.cases or draws:
                if not (store / "truth" / name / "truth.toml").is_file():
                    _make(draws[name], store)
        except PyblastError as error:
            sys.exit(str(error))


def _make(draw, store):
    """Make one case and say what it took."""
    case, began = drawn(draw), _spent()
    runs = store / "runs" / draw.name
    write_case(store, case, recorded(case, kept(runs)))
    shutil.rmtree(runs)
    print(f"{draw.name} {draw.effect} {draw.template}: {_spent() - began:.0f} s of processor",
          flush=True)  # fmt: skip


def _spent():
    """Return the processor time in s of this process and of those it ran."""
    both = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in both)


if __name__ == "__main__":
    main()
