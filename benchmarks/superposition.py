"""Runs that are not made: stored responses, scattered blasts, kept runs, early ends, two meshes.

`zones` is the size of the box, 232 x 168 x 80 m of rock with one joint and 20 holes.
"""

import statistics
import tempfile
import time
from dataclasses import replace

import numpy as np

from benchmarks.control_variate import controlled_mean
from benchmarks.quiet_end import run_until_quiet
from pyblast.mesh.builder import structured_box
from pyblast.model.boundary import Viscous
from pyblast.model.joint import Joint
from pyblast.model.material import Damping, Material
from pyblast.model.model import Model, Receiver
from pyblast.model.source import Hole, TimeFunction
from pyblast.runs.blast_ensemble import blast_spectra
from pyblast.runs.greens import GreensFunctions, greens_functions
from pyblast.runs.parallel import cached_run, input_hash, run_all, workers
from pyblast.solver.run import simulate
from verification.columns import ricker

TITLE = "Stored responses and kept runs"
SIZE = (232.0, 168.0, 80.0)
SIDES = ("west", "east", "south", "north", "bottom")
ROCK = Material.from_speeds(2700.0, 2950.0, 1550.0)
RATE = TimeFunction(1e9 * ricker(np.arange(0.0, 0.15, 5e-4), 20.0), 5e-4)
DURATION = 0.8
REPEATS = 5


def site(cells, n_holes=20, n_receivers=10, kn=2e9):
    """Return the box with a number of cells along its length."""
    shape = (cells, round(cells * 0.72), round(cells * 0.345))
    mesh = structured_box(shape, SIZE, planes={"J": ("x", 116.0)}).split(["J"])
    holes = [
        Hole(
            np.array([40.0 + 5.0 * (k % 5), 60.0 + 6.0 * (k // 5), 55.0]),
            50.0,
            0.012 * k,
            RATE,
            0.7,
        )
        for k in range(n_holes)
    ]
    receivers = [
        Receiver(f"{k}", (125.0 + 8.0 * k, 50.0 + 7.0 * k, 79.0)) for k in range(n_receivers)
    ]
    return Model(
        mesh, {"rock": ROCK}, joints=[Joint("J", "elastic", {"kn": kn, "ks": 0.5 * kn})],
        boundaries=[*map(Viscous, SIDES)], damping=Damping(0.02, 20.0), sources=holes,
        receivers=receivers,
    )  # fmt: skip


def timed(work, repeats=REPEATS):
    """Return the median time of some calls in s, and the last result."""
    took = []
    for _ in range(repeats):
        began = time.perf_counter()
        result = work()
        took.append(time.perf_counter() - began)
    return statistics.median(took), result


def responses(model):
    """Measure both sides of stored responses against a run of all holes."""
    direct, made = timed(lambda: simulate(model, DURATION))
    top = max(record.pvs for record in made.seismograms.values())
    found = {"zones": len(model.mesh.zones), "steps": made.prepared.n_steps, "run_s": direct}
    for side, some in (
        ("source", model),
        ("receiver", replace(model, receivers=model.receivers[:2])),
    ):
        took, bank = timed(
            lambda some=some, side=side: greens_functions(some, DURATION, side=side), 1
        )
        blast, records = timed(lambda some=some, bank=bank: bank.blast(some.sources))
        gaps = [np.abs(r.velocity - made.seismograms[n].velocity).max() for n, r in records.items()]
        found[side] = {
            "runs": bank.runs,
            "one_run_over_direct": took / bank.runs / direct,
            "blast_over_direct": blast / direct,
            "difference": float(max(gaps) / top),
            "unfinished": bank.unfinished,
        }
    return found


def scattered(n_blasts=10_000, n_holes=50, n_receivers=10):
    """Measure the peaks of many blasts against superposing them one by one."""
    generator, dt = np.random.default_rng(0), 7e-4
    holes = [Hole(np.array([5.0 * k, 0.0, 0.0]), 50.0, 0.0, RATE) for k in range(n_holes)]
    fading = np.exp(-dt * np.arange(1450) / 0.2)
    parts = tuple((k, 0.0) for k in range(n_holes))
    bank = GreensFunctions(
        tuple(holes), parts, tuple(Receiver(f"{k}", (0.0, 0.0, 0.0)) for k in range(n_receivers)),
        generator.normal(size=(n_holes, n_receivers, 3, 1450)) * fading, dt, 0.0, "source", 0, "",
    )  # fmt: skip
    times = generator.uniform(0.0, 0.5, size=(n_blasts, n_holes))
    ready, spectra = timed(lambda: blast_spectra(bank, holes, latest=0.5))
    took, _ = timed(lambda: spectra.peaks(times), 3)
    fired = [replace(hole, time=t) for hole, t in zip(holes, times[0], strict=True)]
    single, _ = timed(lambda: bank.blast(fired, 1.5))
    return {
        "blasts": n_blasts, "holes": n_holes, "receivers": n_receivers,
        "frequencies": len(spectra.spectra), "prepare_s": ready, "peaks_s": took,
        "one_by_one_over_together": single * n_blasts / took,
    }  # fmt: skip


def kept(model):
    """Measure the cache and the pool against plain runs."""
    models = [replace(model, step_factor=0.8 - 0.001 * k) for k in range(8)]
    with tempfile.TemporaryDirectory() as folder:
        alone, _ = timed(lambda: run_all(models, DURATION), 1)
        with workers(2) as pool:
            run_all(models[:2], 0.01, executor=pool)  # processes start
            pooled, _ = timed(lambda: run_all(models, DURATION, folder=folder, executor=pool), 1)
        hashing, _ = timed(lambda: input_hash(model, DURATION))
        reading, again = timed(lambda: cached_run(models[0], DURATION, folder))
    assert again.from_cache
    one = alone / len(models)
    return {
        "hash_over_run": hashing / one, "read_over_run": reading / one,
        "two_workers_over_one": alone / pooled,
    }  # fmt: skip


def ended(model):
    """Measure how much of a run is spared when its receivers are quiet."""
    short = replace(model, sources=[replace(model.sources[0], time=0.0)])
    found = run_until_quiet(short, 2.0, share=0.02)
    return {"longest_s": 2.0, "share": 0.02, "ended_s": found.duration, "quiet": found.quiet}


def two_meshes(fine=24, coarse=12, pairs=8, more=60):
    """Measure the control variate: PPV behind joints of random stiffness, on two meshes."""
    stiffness = 10.0 ** np.random.default_rng(1).uniform(8.5, 9.5, size=pairs + more)

    def peak(cells, kn):
        model = site(cells, 1, 1, kn)
        return simulate(model, 0.35).seismograms["0"].pvs

    cost = [timed(lambda cells=cells: peak(cells, 1e9), 1)[0] for cells in (fine, coarse)]
    answers = [[peak(fine, kn) for kn in stiffness[:pairs]], [peak(coarse, kn) for kn in stiffness]]
    found = controlled_mean(answers[0], answers[1][:pairs], answers[1][pairs:])
    spent = (pairs * cost[0] + (pairs + more) * cost[1]) / (pairs * cost[0])
    return {
        "edges_fine_over_coarse": coarse / fine, "pairs": pairs, "more": more,
        "error_over_mean": float(found.error / found.mean),
        "gain_in_fine_runs": float(found.gain), "cost_over_that_of_the_fine_runs": spent,
    }  # fmt: skip


def measure(effort):
    """Return what each of them spares."""
    model = site(8 if effort == "quick" else 24)
    return {
        "stored_responses": responses(model),
        "scattered_blasts": scattered(100 if effort == "quick" else 10_000),
        "kept_runs": kept(model),
        "early_end": ended(model),
        "two_meshes": two_meshes(*((8, 4) if effort == "quick" else (24, 12))),
    }


def lines(found):
    """Return what was found, one line each."""
    told = [f"`{found['stored_responses']['zones']}` zones, one joint, 20 holes.", ""]
    for name, one in found.items():
        for key, value in one.items():
            if isinstance(value, dict):
                value = ", ".join(f"{k} {v:.3g}" for k, v in value.items())
            else:
                value = f"{value:.4g}"
            told.append(f"- {name.replace('_', ' ')}: {key.replace('_', ' ')} {value}")
    return told
