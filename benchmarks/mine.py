"""The mine of the paper on its mesh of 5 m: two seconds of motion; and a mesh for 20 Hz."""

import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from pyblast.mesh.quality import ZONES_PER_CUBE
from pyblast.mesh.tetrahedra import volumes
from pyblast.model.material import Damping
from pyblast.project.project import load_project
from pyblast.solver.assembly import time_step
from pyblast.solver.edge_springs import HELD_QUADRATIC, NUMBERED
from pyblast.solver.preparation import prepare

from .marching import Steps
from .timing import interleaved, median, on, ratio

TITLE = "Mine"
PROJECT = Path(__file__).resolve().parents[1] / "examples" / "gol_e_gohar" / "project.toml"
MOTION, CORNER = 2.0, 15.0  # s of motion; corner over central frequency, as the project file has it
STEPS = 40  # of one timing, five of them on one thread and on two
HIGHEST, LONGEST = 20.0, 8.0  # Hz; m, an edge that joints 11 m apart still leave room for
NODES_A_ZONE, QUADRATIC_NODES_A_ZONE = 0.18, 4.5
# A zone of 15 nodes in steps of one of 4, and what its mesh needs: see the part on accuracy.
QUADRATIC_COST, QUADRATIC_EDGES, LINEAR_EDGES = 10.0, 3.0, 10.0


def measure(effort):
    """Return sizes, steps, seconds a step and hence seconds for the motion, by damping."""
    began, full = time.perf_counter(), effort != "quick"
    project = load_project(PROJECT, full)
    given = project.model
    lagged = replace(given, damping=Damping(given.damping.ratio, given.damping.frequency))
    meshed = time.perf_counter() - began
    damping = Damping(lagged.damping.ratio, lagged.damping.frequency,
                      corner=CORNER * lagged.damping.frequency)  # fmt: skip
    low_passed = replace(lagged, damping=damping)
    mesh = lagged.mesh
    found = {
        "zones": len(mesh.zones), "nodes": len(mesh.points), "contacts": len(mesh.contacts.area),
        "edge_m": lagged.mean_edges(), "carries_hz": lagged.highest_frequency(),
        "meshing_s": meshed, "motion_s": MOTION,
        "damping": {"low-passed": of_damping(low_passed), "lagged": of_damping(lagged)},
        "static": static(low_passed),
    }  # fmt: skip
    for one in found["damping"].values():
        marched = [one["steps"] * seconds for seconds in one["seconds_a_step"]]
        one["seconds_for_the_motion"] = marched
    return {"at 5 m" if full else "of the example": found, "for 20 Hz": for_20_hz(lagged, found)}


def of_damping(model):
    """Return time step, number of steps and the seconds of one, on one thread and on two."""
    dt, limit = time_step(model)
    free = replace(model, insitu=None)
    march = Steps(prepare(free, 12 * STEPS * dt, step=(dt, limit)), STEPS)
    took = interleaved({"1": on(1, march), "2": on(2, march)})
    return {
        "dt_ms": 1e3 * dt, "limited_by": limit.limited_by,
        "implicit": int(limit.implicit.zones.sum()),
        "undamped_dt_ms": 1e3 * limit.undamped * model.step_factor,
        "steps": int(np.ceil(MOTION / dt)),
        "seconds_a_step": [median(took[k]) / STEPS for k in "12"],
        "two_threads": ratio(took["1"], took["2"]),
    }  # fmt: skip


def static(model):
    """Return steps and seconds of the static stage on two threads."""
    step, spent = time_step(model), {}

    def progress(stage, *_):
        spent.setdefault(stage, time.perf_counter())

    on(2, lambda: None)()
    prepared = prepare(model, 10 * step[0], progress, step)
    return {"steps": prepared.static["steps"], "seconds": time.perf_counter() - spent["static"]}


def for_20_hz(model, found):
    """Return by kind of zone what a mesh that carries 20 Hz in every layer would need.

    Composed, not run: zones by volume over the cube of the edge, the time step and the cost of a
    zone as measured on the mesh of 5 m. Joints keep edges from growing beyond `LONGEST`.
    """
    mesh = model.mesh
    volume = np.bincount(mesh.zone_group, volumes(mesh.points, mesh.zones))
    per_zone = found["damping"]["low-passed"]["seconds_a_step"][1] / found["zones"]
    steps = found["damping"]["low-passed"]["steps"]
    rows = {}
    for kind, edges, cost, nodes, needs in (
        ("constant strain", LINEAR_EDGES, 1.0, NODES_A_ZONE, NUMBERED),
        ("quadratic", QUADRATIC_EDGES, QUADRATIC_COST, QUADRATIC_NODES_A_ZONE, HELD_QUADRATIC),
    ):
        own = [min(LONGEST, model.materials[g].cs / (edges * HIGHEST)) for g in mesh.groups]
        zones = ZONES_PER_CUBE * volume / np.array(own) ** 3
        total = float(zones.sum())
        rows[kind] = {
            "edge_m": dict(zip(mesh.groups, own, strict=True)),
            "zones": dict(zip(mesh.groups, zones.tolist(), strict=True)),
            "memory_gb": total * float(needs @ (1.0, nodes, 0.0)) / 1e9,
            "seconds_for_the_motion": total * per_zone * cost * steps,
        }
    return rows


def lines(found):
    """Return the tables of this part."""
    mine = found.get("at 5 m") or found["of the example"]
    static_s = mine["static"]["seconds"]
    told = [
        f"{mine['zones']} zones, {mine['contacts']} contacts; meshing {mine['meshing_s']:.0f} "
        "s, static "
        f"stage {mine['static']['steps']} steps or {static_s:.0f} s. The time of a step is the "
        "median "
        f"of five runs of {STEPS} steps; {MOTION:g} s of motion take the number of steps times "
        "that, meshing and static stage left out.",
        "",
        "| damping | step ms | steps | s a step, 1 and 2 threads | s for the motion | 2 threads |",
        "|---|---|---|---|---|---|",
    ]
    for name, one in mine["damping"].items():
        each = ", ".join(f"{seconds:.4f}" for seconds in one["seconds_a_step"])
        whole = ", ".join(f"{seconds:.0f}" for seconds in one["seconds_for_the_motion"])
        told.append(
            f"| {name} | {one['dt_ms']:.4f} | {one['steps']} | {each} | {whole} "
            f"| {one['two_threads']:.2f} |"
        )
    carried = ", ".join(f"{name} {hz:.1f}" for name, hz in mine["carries_hz"].items())
    told += [
        "",
        f"That mesh carries (Hz): {carried}. One that carries {HIGHEST:g} Hz in every layer "
        "would need, calculated from the same step and cost per zone, not run:",
        "",
        "| zones | million, by layer | memory GB | s for the motion, 2 threads |",
        "|---|---|---|---|",
    ]
    for kind, one in found["for 20 Hz"].items():
        zones = ", ".join(f"{name} {n / 1e6:.2f}" for name, n in one["zones"].items())
        told.append(
            f"| {kind} | {zones} | {one['memory_gb']:.0f} | {one['seconds_for_the_motion']:.0f} |"
        )
    return told
