"""The page docs/quality/performance.md: goals, then each part with its tables and figures."""

from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt

from verification.markdown import reflow

from .goals import GOALS

DOCS = Path(__file__).resolve().parents[1] / "docs"
PAGE, FIGURES = DOCS / "quality" / "performance.md", DOCS / "figures" / "bench"
HEAD = """# Performance

Written by `python -m benchmarks` from `benchmarks/results.json`; `./dev bench` sets up first. Each
number is given with the machine, its load and the date of measurement. Ratios come from one run:
the programs compared are timed in turn, in five rounds or more, and the table gives the median of
the ratios of the rounds. A memory stream (triad) and multiply-add in registers are timed in the
same rounds. Two virtual processors may share a core: a second thread is not judged where
multiply-add gains less than 1.9.
"""
MEASURED_BEFORE = """## Measured before

On Intel(R) Xeon(R) Processor, 2026-11-21, load 1.1 to 1.3, 2 threads, with the parts *evaluations*
and *superposition* that the benchmarks then had (commit ab242922):

- a reduced basis of 12 runs and 199 modes for three parameters of a box of 43,200 zones differs by
  0.99 % from a full run for the worst of 8 unseen sets; an evaluation takes 63 ms, 1/37 of a full
  run (goal 1/50); 2000 evaluations take 188 s with training, single runs 4541 s, batches of 8 2468
  s;
- stored responses of 20 holes and 19,584 zones: a blast takes 1/52 of its run with 20 runs at the
  holes and 1/88 with 6 runs at the receivers, and gives the same motion to 5e-14;
- 10,000 blasts of 50 holes with random firing times take 2.3 s at 10 receivers, 206 times less than
  one by one;
- finding a stored run costs 0.1 % of the run and reading it 1 %; two workers do 2.0 times as much
  as one;
- a run that ends once the motion has died out ended at 0.5 of 2 s;
- 8 fine runs, the same 8 run coarsely and 60 more coarse runs give a mean as good as 40 fine runs
  do, in 2.4 times the time of the 8 fine ones.
"""
SEVERAL = """## Several machines

Ensembles run on several machines: `run_all(models, duration, folder=..., executor=...)` takes any
executor of `concurrent.futures`, including `dask.distributed.Client(...).get_executor()`. Runs are
stored in a folder that all workers share, and missing runs are computed when the call is repeated.
Dask is optional; in tests one of two workers is killed, and the results are those of one machine,
bit for bit.

`pyblast backanalyse`, `delays` and `diagnose` take `--dask ADDRESS` for that; a run of one blast
has nothing to distribute, and `superpose` runs no model. On a cluster with a queue, dask-jobqueue
submits the workers. This script, run on a node that may submit jobs, prints the address and keeps a
scheduler and four jobs of eight workers alive until Ctrl-C; set its parameters to those of your
queue:

```python
from threading import Event
from dask_jobqueue import SLURMCluster

if __name__ == "__main__":
    cluster = SLURMCluster(queue="normal", cores=8, processes=8, memory="32GB", walltime="08:00:00")
    cluster.scale(jobs=4)
    print(cluster.scheduler_address, flush=True)
    Event().wait()
```

All workers need the same version of pyblast and the same path to the results folder; give them one
process per core, as above. A job that ends, at its walltime or before, loses its current run, which
another worker repeats.

Running one model on several machines is not implemented. The model would be partitioned along
existing lines: domains of 1024 zones follow one another along a curve, so equal stretches of it are
compact parts, and a part keeps the slots of its domains, the contacts whose minus side it holds and
the dashpots of its nodes. Nodes with slots in several parts are held by each of them. After
computing the forces of zones and contacts, a part sends the slot and contact forces of each such
node one by one, not their sum, and every holder adds all of them in the order of `node_part`: the
same bits as on one machine, whatever the number of parts. A part of n zones sends about 2 n^(2/3)
nodes at 24 bytes per slot, 0.5 MB for a million zones, against 15 ms for its step: 1 Gbit/s
suffices if border domains are computed first and the rest during the transfer. Energies are summed
over domains and blocks in order, once in twenty steps. Patches of yielding zones never cross
domains; free-field columns are run by every part that needs them; the static stage uses the same
sums to decide when to end.
"""


def write(parts, results):
    """Write the page and the figures of the parts that were measured."""
    told = [HEAD, machines(results), "", "## Goals", ""]
    told += ["| goal | measured | | on |", "|---|---|---|---|"]
    told += [f"| {sentence} | {' | '.join(judged(*rest, results))} |" for sentence, *rest in GOALS]
    told += ["", "*No* is followed by the cause, where it was measured.", duration(results)]
    told.append("")
    for name, part in parts.items():
        told += [f"## {part.TITLE}", ""]
        if name not in results:
            option = " --peers" if name == "peers" else f" {name}"
            told += [f"Not measured yet: `python -m benchmarks{option}`.", ""]
            continue
        one = results[name]
        told += [*part.lines(one["found"]), ""]
        if hasattr(part, "draw"):
            draw(name, part, one["found"])
            told += [f"![{part.TITLE}](../figures/bench/{name}.png)", ""]
        told += [told_of(name, one), ""]
    PAGE.write_text(reflow("\n".join([*told, MEASURED_BEFORE, SEVERAL])), encoding="utf-8")


def duration(results):
    """Return how long the bench took, and which part most of it."""
    took = {name: one["seconds"] / 60.0 for name, one in results.items()
            if "seconds" in one and "found" in one and name != "peers"}  # fmt: skip
    longest = max(took, key=took.get, default=None)
    if longest is None:
        return "Nothing was timed."
    return (
        f"The benchmarks without peers took {sum(took.values()):.0f} minutes, *{longest}* "
        f"{took[longest]:.0f} of them."
    )


def machines(results):
    """Return on which machines and days the parts were measured."""
    days = {}
    for one in results.values():
        days.setdefault(one["machine"]["processor"], []).append(one["date"])
    each = [f"{name} ({min(dates)} to {max(dates)})" for name, dates in sorted(days.items())]
    words = f"Measured on {', '.join(each)}."
    return words if len(each) == 1 else f"{words} Do not compare numbers across machines."


def told_of(name, one):
    """Return on what, when, when busy, and how long a part was measured."""
    words = f"{where(one)}, {one['machine']['threads']} threads; `python -m benchmarks {name}`"
    return f"{words}, {one['seconds']:.0f} s." if "seconds" in one else f"{words}."


def where(one):
    """Return machine, date and load of a result."""
    return f"{one['machine']['processor']}, {one['date']}, load {one['load']:.1f}"


def judged(need, judge, results):
    """Return what was measured for a goal, whether that is enough, and on what.

    Parameters
    ----------
    need : str
        Part of the results, such as ``kernels``, or a key of a part, such as ``site.error``.
    judge : callable
        Takes what was found by part; with a key, the results themselves.
    results : dict
        By part.
    """
    part, _, key = need.partition(".")
    if (key or "found") not in results.get(part, {}):
        return "not measured", "–", "–"
    found = {name: one["found"] for name, one in results.items() if "found" in one}
    measured, reached, why = judge(results if key else found)
    outcome = "yes" if reached else f"**no**: {why}" if why else "**no**"
    one = results[part]
    return measured, outcome, where(one.get(f"{key}_on", one))


def draw(name, part, found):
    """Draw the two axes of a part."""
    figure, axes = plt.subplots(1, 2, figsize=(8.0, 3.0), layout="constrained")
    part.draw(found, axes)
    FIGURES.mkdir(parents=True, exist_ok=True)
    figure.savefig(FIGURES / f"{name}.png", dpi=80)
    plt.close(figure)
