"""Reduced models of a rock box with three faults: error, size and time against full runs.

Run ``OMP_NUM_THREADS=1 python -m benchmarks.reduced_basis [--cells 10] [--each] [--store FOLDER]``;
figures go to ``benchmarks/reduced_basis.json``, one entry for each mesh and set of parameters.
"""

import argparse
import json
import statistics
import tempfile
import time
from pathlib import Path

import numpy as np

from pyblast.meshing.mesh import Mesh
from pyblast.meshing.mesh_builder import structured_box
from pyblast.motion.seismogram import Seismogram
from pyblast.reduction.projection import project, solve
from pyblast.reduction.reduced import TOLERANCE, difference, reduced
from pyblast.reduction.training import samples
from pyblast.solving import kernels
from pyblast.solving.boundaries import StressInput, Viscous
from pyblast.solving.joints import Joint
from pyblast.solving.materials import Damping, Material
from pyblast.solving.model import Model, Receiver
from pyblast.solving.preparation import LEDGER_EVERY

SIZE = (300.0, 200.0, 120.0)  # m
FAULTS = {"F1": ("x", 100.0), "F2": ("x", 200.0), "F3": ("y", 100.0)}
DIPS = (0.0, 0.4, -0.3, 0.0)  # tangents to the vertical at x = 0, 100, 200, 300 m
ROCKS = {
    "magnetite": Material.from_speeds(4000.0, 3370.0, 1800.0),
    "schist": Material.from_speeds(2700.0, 3000.0, 1650.0),
}
PLACES = ((250.0, 130.0, 119.0), (150.0, 60.0, 119.0), (270.0, 40.0, 60.0))
PULSES = ((1.0, 0.0), (0.7, 0.11), (-0.5, 0.25), (0.8, 0.42))  # amplitude, delay in s
KN, KS, RATIO = (5e7, 5e8), (1e7, 1e8), (0.005, 0.05)
DURATION, FREQUENCY, HIGHEST = 2.0, 8.0, 25.0
UNSEEN = 8
SEED = 0


def rock_box(cells):
    """Return the box with a number of cells to 100 m, two dipping faults and one that crosses."""
    shape = (3 * cells, 2 * cells, round(1.2 * cells))
    mesh = structured_box(shape, SIZE, planes=FAULTS)
    points = mesh.points.copy()
    dip = np.interp(points[:, 0], [0.0, 100.0, 200.0, 300.0], DIPS)
    points[:, 0] += dip * (points[:, 2] - 0.5 * SIZE[2])
    group = (points[mesh.zones].mean(axis=1)[:, 2] > 0.5 * SIZE[2]).astype(int)
    mesh = Mesh(points, mesh.zones, group, tuple(ROCKS), mesh.surfaces).split(list(FAULTS))
    times = np.arange(0.0, 1.0, 1e-3)
    push = np.zeros_like(times)
    for amplitude, delay in PULSES:
        phase = (np.pi * (FREQUENCY * (times - delay) - 1.5)) ** 2
        push += np.where(times < delay, 0.0, amplitude * (1.0 - 2.0 * phase) * np.exp(-phase))
    shaking = Seismogram(0.05 * push[:, None] * [0.8, 0.5, 0.3], times[1])
    quiet = map(Viscous, ("west", "east", "south", "north", "bottom"))
    return Model(
        mesh, ROCKS,
        joints=[Joint(name, "elastic", {"kn": 1.5e8, "ks": 3e7}) for name in FAULTS],
        boundaries=[*quiet, StressInput("west", shaking)],
        damping=Damping(0.02, 4.0, corner=60.0),
        receivers=[Receiver(f"R{k}", place) for k, place in enumerate(PLACES)],
    )  # fmt: skip


def ranges(each):
    """Return the ranges of 3 parameters, or of 7 where each fault varies alone."""
    if not each:
        return {"kn": KN, "ks": KS, "ratio": RATIO}
    faults = {f"{key}.{name}": limit for name in FAULTS for key, limit in (("kn", KN), ("ks", KS))}
    return {**faults, "ratio": RATIO}


def errors(small, known):
    """Return waveform and peak errors of the worst receiver of a run, and the residual.

    Peaks are those of each component, over the largest of the receiver.
    """
    found = solve(small, known.values)
    motion = small.line.back(found.velocity).reshape(known.motion.shape)
    pairs = list(zip(*(np.swapaxes(one, 0, 1) for one in (known.motion, motion)), strict=True))
    peaks = [[np.abs(one).max(axis=0) for one in pair] for pair in pairs]
    off = max(np.abs(b - a).max() / a.max() for a, b in peaks)
    return max(difference(*pair) for pair in pairs), off, found.residual


def full_seconds(family):
    """Return what the march of a full run takes on one thread, s of the processor."""
    prepared = family.prepared(family.ranges.middle())
    views = kernels.to_fortran(prepared.constants)
    state = {name: value.copy() for name, value in prepared.state.items()}
    began = time.process_time()
    kernels.advance(views, state, 0, family.n_steps, LEDGER_EVERY)
    return time.process_time() - began


def evaluation_seconds(learnt):
    """Return the median of what predictions take, s of the processor."""
    took = []
    for values in learnt.family.ranges.unseen(7, SEED + 2):
        began = time.process_time()
        learnt.predict(values)
        took.append(time.process_time() - began)
    return statistics.median(took)


def study(cells, each, counts, store):
    """Return the figures of one mesh and one set of parameters."""
    model = rock_box(cells)
    learnt = reduced(
        model, ranges(each), DURATION, highest=HIGHEST, runs=max(counts), seed=SEED, store=store
    )
    family = learnt.family
    unseen = samples(family, family.ranges.unseen(UNSEEN, SEED + 1), store)
    runs = samples(family, learnt.trained, store)
    rows = []
    for count in counts:
        small = project(family, [one.modes for one in runs[:count]], TOLERANCE, SEED)
        wave, peak, residual = np.array([errors(small, one) for one in unseen]).T
        rows.append({
            "runs": count, "size": small.size, "mean error": wave.mean(), "worst error": wave.max(),
            "worst peak": peak.max(),
            "error over residual, largest over least": (wave / residual).max()
            / (wave / residual).min(),
        })  # fmt: skip
        print(rows[-1], flush=True)
    estimates = [learnt.predict(one.values).error for one in unseen]
    truths = [errors(learnt.projection, one)[0] for one in unseen]
    evaluation, full = evaluation_seconds(learnt), full_seconds(family)
    return {
        "zones": len(model.mesh.zones), "unknowns": 3 * len(model.mesh.points),
        "contacts": len(model.mesh.contacts.area), "parameters": len(family.ranges.limits),
        "steps": family.n_steps, "frequencies": len(learnt.projection.line.z), "runs": rows,
        "estimated": estimates, "true": truths, "evaluation seconds": evaluation,
        "full run seconds": full, "full run over evaluation": full / evaluation,
    }  # fmt: skip


def main():
    """Write the figures of one study beside those of others."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, default=10, help="cells to 100 m")
    parser.add_argument("--each", action="store_true", help="every fault varies alone")
    parser.add_argument("--runs", type=int, nargs="+", help="numbers of runs to learn from")
    parser.add_argument("--store", help="folder where runs are kept")
    given = parser.parse_args()
    counts = given.runs or ([16, 32] if given.each else [4, 8, 12, 16])
    with tempfile.TemporaryDirectory() as folder:
        found = study(given.cells, given.each, counts, given.store or folder)
    path = Path(__file__).with_suffix(".json")
    known = json.loads(path.read_text()) if path.exists() else {}
    known[f"{found['zones']} zones, {found['parameters']} parameters"] = found
    path.write_text(json.dumps(known, indent=1, sort_keys=True, default=float) + "\n")
    print(json.dumps(found, indent=1, default=float))


if __name__ == "__main__":
    main()
