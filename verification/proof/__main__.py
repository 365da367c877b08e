"""Answer each registered case once by this version of the program, and write what came out.

    ./dev proof [--jobs 2] [--minutes 25] [--again] [case or pattern ...]
    ./dev proof register | page

``register`` writes docs/quality/registration.md: cases with digests of their truths, rules and
thresholds; it comes before any answer. Answers go to ``verification/proof.json``, one by one; the
first of each version stays for ever, ``--again`` puts a further one beside it. After the minutes
cases are stopped; the same command goes on from there. ``page`` writes docs/quality/diagnosis.md
and the lines of README from the answers. Cases of development, ``trial-000`` to ``trial-039``, are
answered into build/proof alone.
"""

import argparse
import sys
from fnmatch import fnmatch

from benchmarks.blind.plan import PROOF_SEED
from pyblast.errors import PyblastError
from verification.rows import program, read_rows

from . import answers, cases
from .page import write_pages
from .registered import register, registered

JOBS, MINUTES = 2, 25.0


def main():
    """Do what is asked for."""
    parser = argparse.ArgumentParser(prog="./dev proof", description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="register | page | case")
    parser.add_argument("--jobs", type=int, default=JOBS, help="at once [%(default)s]")
    parser.add_argument("--minutes", type=float, default=MINUTES, help="[%(default)s]")
    parser.add_argument("--again", action="store_true", help="a further answer, beside the first")
    given = parser.parse_args()
    if given.jobs < 1 or not given.minutes > 0.0:
        parser.error("--jobs and --minutes must be positive")
    try:
        if given.names == ["register"]:
            register(cases.truths(), bool(read_rows(answers.FILE)), PROOF_SEED)
        elif given.names != ["page"]:
            _answer(given)
        write_pages(read_rows(answers.FILE))
    except PyblastError as error:
        sys.exit(str(error))


def _answer(given):
    """Answer what is asked for and has no answer of this version."""
    trials = [f"trial-{number:03d}" for number in range(cases.TRIAL_CASES)]
    known = registered()["cases"]
    patterns = given.names or ["*"]
    asked = [name for name in known if any(fnmatch(name, each) for each in patterns)]
    asked += [name for name in trials if any(fnmatch(name, each) for each in given.names)]
    if not asked:
        sys.exit(f"proof: no case is called {' or '.join(patterns)}")
    for path, own in (
        (answers.FILE, [name for name in asked if name in known]),
        (answers.TRIALS, [name for name in asked if name not in known]),
    ):
        done = () if given.again else answers.first_answers(read_rows(path), program())
        waiting = [name for name in own if name not in done]
        command = [*answers.COMMAND, *(["--again"] if given.again else []), str(path)]
        path.parent.mkdir(parents=True, exist_ok=True)
        open_ = answers.answer_all(waiting, given.jobs, given.minutes, command)
        if open_:
            print(f"proof: {len(open_)} of {len(own)} cases have no answer yet: {', '.join(open_)}")


if __name__ == "__main__":
    main()
