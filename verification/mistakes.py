"""Mistakes in the field and at the desk, put into sites of an independent program and looked for.

    python -m verification.mistakes [--minutes N] [--again] [site ...]

Each site of ``PYBLAST_SITES``, as it is and with each mistake in turn at a receiver or a blast that
a seed draws. The acts that are named are set beside those that would mend the records, in
``verification/mistakes.json``.
"""

import os
import re
import sys
import tempfile
import time
from dataclasses import replace
from functools import partial
from pathlib import Path
from zlib import crc32

import numpy as np

from pyblast.diagnosis.case import case_of
from pyblast.diagnosis.forward import simulation_of
from pyblast.diagnosis.mistakes import changed_records, mistakes_of, with_velocity
from pyblast.project.project import load_project, with_further

from .rows import each_row, options

ROOT = Path(__file__).resolve().parents[1]
ROWS = ROOT / "verification" / "mistakes.json"
SITES = ("case-01", "case-04", "case-13", "case-06", "case-07", "case-08")
SEED = 3


def rewritten(change, record):
    """Return a record with another velocity, a function of its own."""
    velocity = record.seismogram.velocity.copy()
    return with_velocity(record, change(velocity, record.seismogram.dt))


def turned(degrees, v, dt):
    """Turn horizontals clockwise."""
    del dt
    a = np.radians(degrees)
    rotation = np.array([[np.cos(a), np.sin(a)], [-np.sin(a), np.cos(a)]])
    return np.column_stack([v[:, :2] @ rotation, v[:, 2]])


def integrated(v, dt):
    """Return displacement."""
    return np.cumsum(v - v.mean(axis=0), axis=0) * dt


# Mistakes at a receiver: kind that should be named, part of the act, velocity as it is written.
AT_A_RECEIVER = {
    "horizontals exchanged": (
        "components", "exchange east and north", lambda v, _: v[:, [1, 0, 2]],
    ),
    "north and vertical exchanged": (
        "components", "exchange north and", lambda v, _: v[:, [0, 2, 1]],
    ),
    "vertical reversed": ("components", "reverse", lambda v, _: v * [1, 1, -1]),
    "east reversed": ("components", "reverse east", lambda v, _: v * [-1, 1, 1]),
    "all reversed": ("components", "reverse", lambda v, _: -v),
    "turned by 35": ("turned", (35.0, "°", 8.0), partial(turned, 35.0)),
    "turned by -60": ("turned", (-60.0, "°", 8.0), partial(turned, -60.0)),
    "in mm/s": ("unit", "divide", lambda v, _: 1e3 * v),
    "in inches": ("unit", "multiply", lambda v, _: v / 25.4),
    "ten times": ("unit", "divide", lambda v, _: 10.0 * v),
    "acceleration": ("integrated", "integrate", lambda v, dt: np.gradient(v, dt, axis=0)),
    "displacement": ("differentiated", "differentiate", integrated),
}  # fmt: skip
OF_A_BLAST = ("time zero 30 ms late", "delays in the opposite order", "holes 9 m off", "copy")
KINDS = (*AT_A_RECEIVER, "receivers exchanged", *OF_A_BLAST, "none")


def spoiled(project, kind, rng):
    """Return a project with a mistake, and what should be named: kind, target, part of the act."""
    every = project.shots
    receivers = set(case_of(project).receivers)
    names = sorted(set.intersection(receivers, *map(set, project.survey.recordings.values())))
    receiver, other = map(str, rng.choice(names, 2, replace=False))
    most = max(every, key=lambda each: len(each.blast.times))
    blast = str(rng.choice([each.name for each in every]))
    if kind in AT_A_RECEIVER:
        what, act, change = AT_A_RECEIVER[kind]
        return changed_records(project, partial(rewritten, change), receiver), (
            what,
            receiver,
            act,
        )
    if kind == "receivers exchanged":
        tables = project.survey.recordings
        for t in tables.values():
            t[receiver], t[other] = t[other], t[receiver]
        return _with(project, tables), ("receivers", {receiver, other}, "exchange")
    if kind == "time zero 30 ms late":
        late = changed_records(project, lambda one: replace(
            one, seismogram=one.seismogram.shifted(0.03)), blast=blast)  # fmt: skip
        return late, ("time zero", blast, (30.0, " ms late", 3.0))
    blasts = project.blasts
    if kind == "delays in the opposite order":
        own = blasts[most.name]
        wrong = replace(own, times=own.times.min() + own.times.max() - own.times)
        return project.changed(blasts=blasts | {most.name: wrong}), (
            "delays",
            most.name,
            "opposite",
        )
    if kind == "holes 9 m off":
        by = 9.0 * np.array([*rng.permutation([0.6, 0.8]), 0.0])
        own = blasts[blast]
        wrong = replace(own, collar=own.collar + by, toe=own.toe + by)
        return project.changed(blasts=blasts | {blast: wrong}), ("place", blast, "")
    if kind == "copy":
        tables = project.survey.recordings
        source, copied = every[0].name, every[1].name
        return _with(project, tables | {copied: tables[source]}), (
            "copy", copied, "give the records",
        )  # fmt: skip
    return project, None


def _with(project, tables):
    """Return a project with other recordings."""
    return replace(project, survey=replace(project.survey, recorded=tables))


def row(site, kind, project, folder):
    """Look for mistakes in a site with one."""
    rng = np.random.default_rng([SEED, crc32(f"{site} {kind}".encode())])
    wrong, asked = spoiled(project, kind, rng)
    began = time.process_time()
    simulations = []

    def simulate(case):
        simulations.append(simulation_of(case, folder))
        return simulations[-1]

    found, _ = mistakes_of(wrong, simulate)
    new = sum(each.runs - each.cached for each in simulations)
    rows = [one.row() for one in found]
    right = not found if asked is None else bool(found) and is_right(rows[0], asked)
    told = None if asked is None else [sorted(a) if isinstance(a, set) else a for a in asked]
    return {
        "site": site, "mistake": kind, "asked": told, "found": rows, "right": right,
        "alone": len(found) == (asked is not None), "new_runs": new,
        "processor_s": round(time.process_time() - began, 1),
    }  # fmt: skip


def is_right(found, asked):
    """Tell whether the first act that is named mends the mistake that was made."""
    kind, target, act = asked
    targets = set(found["target"].split(" and "))
    same = targets == (target if isinstance(target, set) else {target})
    if isinstance(act, str):
        return found["kind"] == kind and same and act in found["act"]
    size, unit, tolerance = act
    said = re.search(rf"(-?[0-9.]+){unit}", found["act"])
    near = said is not None and abs(float(said[1]) - size) < tolerance
    return found["kind"] == kind and same and near


def main(arguments):
    """Compute the missing rows."""
    sites, chosen = options(arguments)
    cases = Path(os.environ["PYBLAST_SITES"])
    projects = {}
    with tempfile.TemporaryDirectory() as folder:

        def job(name):
            site, kind = name.split(" ", 1)
            if site not in projects:
                project = with_further(load_project(cases / site / "B2.toml"))
                case_of(project)
                projects[site] = project
            return row(site, kind, projects[site], folder)

        names = [f"{site} {kind}" for site in sites or SITES for kind in KINDS]
        rows = each_row(ROWS, names, job, **chosen)
    right = sum(one["right"] for one in rows.values())
    print(f"mistakes: {right} of {len(rows)} right")


if __name__ == "__main__":
    main(sys.argv[1:])
