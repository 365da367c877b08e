"""Reduced models of a rock box with three faults: error, size and time against full runs."""

import statistics
import tempfile
import time

import numpy as np

from benchmarks.reduction.projection import project, solve
from benchmarks.reduction.reduced import TOLERANCE, difference, reduced
from benchmarks.reduction.training import samples
from pyblast import core
from pyblast.mesh.builder import structured_box
from pyblast.mesh.mesh import Mesh
from pyblast.model.boundary import StressInput, Viscous
from pyblast.model.joint import Joint
from pyblast.model.material import Damping, Material
from pyblast.model.model import Model, Receiver
from pyblast.signals.seismogram import Seismogram
from pyblast.solver.preparation import LEDGER_EVERY
from pyblast.solver.run import run_many, simulate

from .timing import interleaved, median, on

TITLE = "Evaluations of a back-analysis"
EVALUATIONS = (20, 200, 2000)
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
    return shaken(mesh, ROCKS, (1.5e8, 3e7), PLACES, np.arange(0.0, 1.0, 1e-3), PULSES)


def shaken(mesh, materials, stiffness, places, times, pulses):
    """Return rock with elastic joints that pulses of 8 Hz shake through its west face.

    Parameters
    ----------
    mesh : Mesh
    materials : dict of str to Material
    stiffness : (kn, ks), Pa/m
    places : sequence of (3,) float, m
        Of the receivers.
    times : (n,) float64, s
    pulses : sequence of (amplitude, delay in s)
    """
    push = np.zeros_like(times)
    for amplitude, delay in pulses:
        phase = (np.pi * (FREQUENCY * (times - delay) - 1.5)) ** 2
        push += np.where(times < delay, 0.0, amplitude * (1.0 - 2.0 * phase) * np.exp(-phase))
    shaking = Seismogram(0.05 * push[:, None] * [0.8, 0.5, 0.3], times[1])
    quiet = map(Viscous, ("west", "east", "south", "north", "bottom"))
    springs = dict(zip(("kn", "ks"), stiffness, strict=True))
    return Model(
        mesh, materials,
        joints=[Joint(name, "elastic", springs) for name in mesh.contacts.names],
        boundaries=[*quiet, StressInput("west", shaking)],
        damping=Damping(0.02, 4.0, corner=60.0),
        receivers=[Receiver(f"R{k}", place) for k, place in enumerate(places)],
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
    views = core.to_fortran(prepared.constants)
    state = {name: value.copy() for name, value in prepared.state.items()}
    began = time.process_time()
    core.advance(views, state, 0, family.n_steps, LEDGER_EVERY)
    return time.process_time() - began


def evaluation_seconds(learnt):
    """Return the median of what predictions take, s of the processor."""
    took = []
    for values in learnt.family.ranges.unseen(7, SEED + 2):
        began = time.process_time()
        learnt.predict(values)
        took.append(time.process_time() - began)
    return statistics.median(took)


def study(cells, each, counts):
    """Return the figures of one mesh and one set of parameters."""
    model = rock_box(cells)
    with tempfile.TemporaryDirectory() as store:
        began = time.perf_counter()
        learnt = reduced(
            model, ranges(each), DURATION, highest=HIGHEST, runs=max(counts), seed=SEED, store=store
        )
        training = time.perf_counter() - began
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
    estimates = [learnt.predict(one.values).error for one in unseen]
    truths = [errors(learnt.projection, one)[0] for one in unseen]
    evaluation, full = evaluation_seconds(learnt), full_seconds(family)
    return {
        "zones": len(model.mesh.zones), "unknowns": 3 * len(model.mesh.points),
        "contacts": len(model.mesh.contacts.area), "parameters": len(family.ranges.limits),
        "steps": family.n_steps, "frequencies": len(learnt.projection.line.z), "runs": rows,
        "estimated": estimates, "true": truths, "evaluation seconds": evaluation,
        "full run seconds": full, "full run over evaluation": full / evaluation,
        "training": {"runs": max(counts), "held out": 4, "seconds": training},
        **many_evaluations(training, learnt),
    }  # fmt: skip


def many_evaluations(training, learnt):
    """Return wall seconds of one evaluation, three ways, and of many of them; totals composed."""
    tried = [learnt.family.model(v) for v in learnt.family.ranges.unseen(8, SEED + 3)]
    took = interleaved({
        "single runs": on(2, lambda: simulate(tried[0], DURATION)),
        "batches of 8": on(2, lambda: run_many(tried, DURATION)),
        "reduced": on(2, lambda: learnt.predict(learnt.trained[0])),
    }, 3)  # fmt: skip
    one = {name: median(times) for name, times in took.items()}
    one["batches of 8"] /= 8.0
    begin = {"single runs": 0.0, "batches of 8": 0.0, "reduced": training}
    totals = {str(n): {way: begin[way] + n * one[way] for way in one} for n in EVALUATIONS}
    return {"seconds an evaluation": one, "seconds for evaluations": totals}


def measure(effort):
    """Return the figures of each study, by mesh and parameters."""
    studies = [(10, False, [4, 8, 12])]
    if effort == "quick":
        studies = [(3, False, [4, 8])]
    elif effort == "long":
        studies += [(15, False, [8, 12]), (10, True, [16, 32])]
    found = [study(*one) for one in studies]
    return {f"{one['zones']} zones, {one['parameters']} parameters": one for one in found}


def lines(found):
    """Return the tables of this part."""
    told = [
        f"Box of {SIZE[0]:g} × {SIZE[1]:g} × {SIZE[2]:g} m of two rocks with three faults, "
        "waves up to "
        f"{HIGHEST:g} Hz, {DURATION:g} s; kn, ks and damping vary tenfold. Errors are those of "
        "the worst "
        f"receiver against full runs of {UNSEEN} sets outside the training set.",
        "",
        "| study | runs | modes | mean error % | worst % | full run over evaluation |",
        "|---|---|---|---|---|---|",
    ]
    for name, one in found.items():
        for row in one["runs"]:
            told.append(
                f"| {name} | {row['runs']} | {row['size']} | {100 * row['mean error']:.2f} "
                f"| {100 * row['worst error']:.2f} | {one['full run over evaluation']:.0f} |"
            )
    told += [
        "",
        "Wall seconds on two threads. One evaluation is measured, training too (the training runs "
        "and those that calibrate it); totals are composed.",
        "",
        "| study | way | one | " + " | ".join(f"{n}" for n in EVALUATIONS) + " |",
        "|---|---|---|" + "---|" * len(EVALUATIONS),
    ]
    for name, one in found.items():
        for way, seconds in one.get("seconds an evaluation", {}).items():
            totals = [f"{one['seconds for evaluations'][str(n)][way]:.0f}" for n in EVALUATIONS]
            told.append(f"| {name} | {way} | {seconds:.2f} | {' | '.join(totals)} |")
    return told


def draw(found, axes):
    """Draw error against runs learnt from, and total time against evaluations."""
    for name, one in found.items():
        axes[0].semilogy(
            [r["runs"] for r in one["runs"]],
            [100 * r["worst error"] for r in one["runs"]], "o-", label=name,
        )  # fmt: skip
    axes[0].set(xlabel="runs learnt from", ylabel="worst waveform error %")
    axes[0].legend(fontsize=6)
    totals = next((one["seconds for evaluations"] for one in found.values()
                   if "seconds for evaluations" in one), {})  # fmt: skip
    for way in next(iter(totals.values()), ()):
        axes[1].loglog([int(n) for n in totals], [t[way] for t in totals.values()], "o-", label=way)
    axes[1].set(xlabel="evaluations", ylabel="s")
    if totals:
        axes[1].legend(fontsize=7)
