"""Searches on twins: best misfit and error of the parameters after 20 to 200 runs.

    OMP_NUM_THREADS=1 python -m benchmarks.searches [--twins 20] [--store FOLDER] [--page]

Writes benchmarks/searches.json, docs/figures/searches.png and docs/quality/searches.md; with
``--page`` the
latter two from the figures that are there.
"""

import argparse
import json
import math
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from pyblast.back_analysis.search import METHODS
from pyblast.core import BATCH_SIZE

from .search_page import write_page
from .search_twin import NOISE, RANGES, paper, problem, quick_model, twins, waveform

FIGURES = Path(__file__).with_suffix(".json")
BUDGETS = (20, 50, 100, 200)
MISFITS = {"paper": paper, "waveform": waveform}
CONFIRMED = 4  # truths at which the reduced model is compared with full runs
SEED = 0


def study(count, store):
    """Return all figures: of the twin, and of every method for both misfits."""
    quick = quick_model(store)
    cases = twins(quick, count)
    ranges = quick.family.ranges
    confirmed = [quick.confirm(ranges.at(case.truth)) for case in cases[:CONFIRMED]]
    found = {
        "twins": count, "budgets": BUDGETS, "noise": NOISE, "trained": len(quick.trained),
        "size": quick.projection.size,
        "zones": len(quick.family.base.mesh.zones), "steps": quick.family.n_steps,
        "unknowns": list(RANGES),
        "confirmed": [max(one.error.values()) for one in confirmed],
        "held out": quick.calibration.error.tolist(), "misfits": {},
    }  # fmt: skip
    for name, measure in MISFITS.items():
        found["misfits"][name] = _compared(quick, cases, measure)
    return found


def _compared(quick, cases, measure):
    """Return what all methods reach with one misfit."""
    rows = {name: {"misfit": [], "error": [], "rounds": []} for name in METHODS}
    at_truth, uphill, spread = [], {"paper": [], "paper_eq15": []}, []
    for number, case in enumerate(cases):
        made = problem(quick, case, measure)
        at_truth.append(float(made.evaluate(made.points(case.truth[None]))[0]))
        for name, search in METHODS.items():
            asked = []
            trace = search(_noting(made, asked), BUDGETS[-1], SEED + number)
            misfit, error = _best(made, case, trace)
            rows[name]["misfit"].append(misfit)
            rows[name]["error"].append(error)
            rows[name]["rounds"].append([_rounds(asked, budget) for budget in BUDGETS])
            if name in uphill:
                uphill[name].append(_uphill(trace))
            if name == "random":
                spread.append(np.percentile(trace.misfits, [5, 50, 95]).tolist())
        print(number, {name: np.round(row["misfit"][-1], 2) for name, row in rows.items()})
    return {
        "methods": {name: _summary(row, rows["random"]) for name, row in rows.items()},
        "at truth": float(np.median(at_truth)),
        "random misfits": np.median(spread, axis=0).tolist(),
        "uphill": {name: np.sum(each, axis=0).tolist() for name, each in uphill.items()},
    }  # fmt: skip


def _noting(made, asked):
    """Return a problem that notes how many points it is asked for at a time."""

    def noting(ask):
        return lambda points: asked.append(len(points)) or ask(points)

    return replace(made, evaluate=noting(made.evaluate), vectors=noting(made.vectors))


def _rounds(asked, budget):
    """Return after how many batches of up to eight models a number of runs was done."""
    rounds, done = 0, 0
    for count in asked:
        here = min(count, budget - done)
        rounds, done = rounds + math.ceil(here / BATCH_SIZE), done + here
    return rounds


def _best(made, case, trace):
    """Return the best misfit and its parameters' mean error, % of the ranges, after each budget."""
    best = [int(np.argmin(trace.misfits[:budget])) for budget in BUDGETS]
    error = np.abs(made.unit(trace.points[best]) - case.truth).mean(axis=1)
    return trace.misfits[best].tolist(), (100.0 * error).tolist()


def _uphill(trace):
    """Return how many of the paper's 20 runs led up, and how many of these were accepted."""
    current, moves = trace.misfits[0], []
    for misfit, accepted in zip(trace.misfits[1:20], trace.accepted[1:20], strict=True):
        if misfit > current:
            moves.append(bool(accepted))
        current = misfit if accepted else current
    return [len(moves), sum(moves)]


def _summary(row, bar):
    """Return quartiles over twins after each budget, and how many twins beat random search."""
    found = {"rounds": np.median(row["rounds"], axis=0).tolist()}
    for key in ("misfit", "error"):
        values = np.array(row[key])
        found[key] = np.percentile(values, [25, 50, 75], axis=0).tolist()
        found[f"{key} better"] = np.mean(values < np.array(bar[key]), axis=0).tolist()
    return found


def main():
    """Measure and write, or write the page only."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--twins", type=int, default=20)
    parser.add_argument("--store", help="folder where runs of the reduced model are kept")
    parser.add_argument("--page", action="store_true", help="figure and page only")
    given = parser.parse_args()
    if not given.page:
        with tempfile.TemporaryDirectory() as folder:
            found = study(given.twins, given.store or folder)
        FIGURES.write_text(json.dumps(found, indent=1) + "\n")
    write_page(json.loads(FIGURES.read_text()))


if __name__ == "__main__":
    main()
