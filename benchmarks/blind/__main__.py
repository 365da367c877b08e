"""Draw, run and score the blind benchmark.

    OMP_NUM_THREADS=1 python -m benchmarks.blind [draw|run|score|page] [--cases N] [--first N]
        [--workers N]

Without a job all are done in turn. ``draw`` writes the cases and seals their truths, ``run``
diagnoses them and freezes the answers, ``score`` opens both and writes benchmarks/blind.json, and
``page`` docs/quality/blind_benchmark.md. What is there is not made again: a killed job goes on with
what is missing.
A benchmark may be put together from portions, each sealed, answered and scored on its own.
Needs the real recordings of examples/real/README.md for their noise.
"""

import argparse
import json
import os
import sys
from concurrent.futures import as_completed
from functools import partial
from pathlib import Path

from pyblast.errors import InputError
from pyblast.files import write_text
from pyblast.runs.parallel import Processes

from . import scores as scoring
from .drawing import draw
from .page import write_page
from .plan import DEVELOPMENT_SEED, TEST_SEED, plan
from .rows import scored
from .running import answer
from .sealing import publish, published

RESULT = Path(__file__).resolve().parents[1] / "blind.json"
JOBS = ("draw", "run", "score", "page")
CASES = 160


def main():
    """Do what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("job", nargs="?", choices=JOBS, help="all in turn if not given")
    parser.add_argument("--cases", type=int, default=CASES, help="up to this one [%(default)s]")
    parser.add_argument("--first", type=int, default=0, help="of a portion [%(default)s]")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--seed", type=int, default=TEST_SEED,
                        help=f"{TEST_SEED} is the test, {DEVELOPMENT_SEED} for trials")  # fmt: skip
    parser.add_argument("--store", type=Path, help="default: build/blind-SEED")
    given = parser.parse_args()
    store = given.store or Path("build") / f"blind-{given.seed}"
    try:
        for job in (given.job,) if given.job else JOBS:
            globals()[f"_{job}"](given, store)
    except InputError as error:
        sys.exit(str(error))


def _draw(given, store):
    """Draw all cases and publish their seals."""
    cases = plan(given.cases, given.seed)[given.first :]
    seals = {}
    for case, sealed in _side_by_side(partial(draw, store=store), cases, given.workers):
        seals[case.name] = sealed
        print(f"{case.name} sealed", flush=True)
    root = publish(store, seals, {"cases": len(cases), "seed": given.seed})
    print(f"seals of {len(seals)} cases: {root}")


def _run(given, store):
    """Answer all cases that are sealed."""
    seals = published(store)["seals"]
    job = partial(answer, store=store, seals=seals)
    for _, said in _side_by_side(job, seals, given.workers):
        print(said, flush=True)


def _score(given, store):
    """Open truths and answers and write the scores."""
    table = published(store)
    job = partial(scored, store=store, seals=table["seals"])
    rows = [row for _, row in _side_by_side(job, table["seals"], given.workers)]
    seed, own = table["plan"]["seed"], {row["case"] for row in rows}
    path = _result(seed == TEST_SEED, store)
    known = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    if known.get("seed") != seed:
        known = {"rows": [], "seals": {}, "roots": []}
    rows += [row for row in known["rows"] if row["case"] not in own]
    rows.sort(key=lambda row: row["case"])
    found = {
        "seed": seed, "test": seed == TEST_SEED,
        "roots": list(dict.fromkeys([*known["roots"], table["root"]])),
        "visible": scoring.VISIBLE, "clear": scoring.CLEAR, "scores": scoring.scores(rows),
        "programs": scoring.by_program(rows), "rows": rows,
        "seals": known["seals"] | table["seals"],
    }  # fmt: skip
    write_text(path, json.dumps(found, indent=1) + "\n")


def _page(given, store):
    """Write the page."""
    path = _result(given.seed == TEST_SEED, store)
    if not path.exists():
        raise InputError(f"blind: {path} is not there; score the answers first")
    write_page(json.loads(path.read_text(encoding="utf-8")))


def _result(test, store):
    """Return where scores go: those of trials stay in their store."""
    return RESULT if test else store / "blind.json"


def _side_by_side(job, items, workers):
    """Yield each item with what the job makes of it."""
    if workers < 2:
        for item in items:
            yield item, job(item)
        return
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    with Processes(workers) as pool:
        waiting = {pool.submit(job, item): item for item in items}
        try:
            for done in as_completed(waiting):
                yield waiting[done], done.result()
        finally:  # after a failure what has not begun shall not begin
            pool.shutdown(cancel_futures=True)


if __name__ == "__main__":
    main()
