"""What size costs: time and memory a zone, threads, number of joints."""

import ctypes
import gc
import os
import time
from pathlib import Path

from pyblast.solver.edge_springs import run_bytes

from .marching import March, cube, prepared, rock_model, rounds_of_ledger
from .timing import Probes, interleaved, median, on, ratio

TITLE = "Scale"
CELLS = {"10 thousand": 12, "100 thousand": 26, "1 million": 55, "4 million": 88}
EVERY = (16, 8, 5, 3, 2)  # cells between joints
JOINTED_CELLS = 32
ZONE_STEPS = 8_000_000


def measure(effort):
    """Return cost by number of zones and by number of joints."""
    quick = effort == "quick"
    return {"by_zones": dict(by_zones(quick)), "by_joints": by_joints(18 if quick else None)}


def lines(found):
    """Return the tables of this part."""
    first = next(iter(found["by_zones"].values()))
    older = " The smallest row was measured before that rule." if first["two_threads"] < 0.8 else ""
    told = [
        "Full undamped step, on one thread and on two. Memory is the growth of the process after "
        "free memory was released, next to the estimate by which the program refuses a model. "
        "The estimate is larger where zones are springs: numbering their edges before the run "
        "temporarily takes about 430 B a zone. Tests compare the estimate with the arrays of "
        "models of each kind: it is never below them and at most 20 % above. Waiting threads "
        "sleep, so that parallel runs do not",
        "disturb each other. Waking them costs about 0.3 ms a step, so models of fewer than 12000",
        "nodes (about 60 thousand zones, counting all models of a batch) run on one thread "
        "whatever",
        "number is set." + older,
        "",
        "| zones | ns a zone and step | 2 threads | mesh µs a zone | preparation µs a zone "
        "| B a zone | estimate |",
        "|---|---|---|---|---|---|---|",
    ]
    for one in found["by_zones"].values():
        rate = ", ".join(f"{ns:.1f}" for ns in one["ns_a_zone_and_step"])
        told.append(
            f"| {one['zones']} | {rate} | {one['two_threads']:.2f} | {one['mesh_us_a_zone']:.1f} "
            f"| {one['prepare_us_a_zone']:.1f} | {one['bytes_a_zone']:.0f} "
            f"| {one['bytes_a_zone_foreseen']:.0f} |"
        )
    told += ["", "| joints | contacts a zone | step over that without |", "|---|---|---|"]
    for name, one in found["by_joints"].items():
        told.append(f"| {name} | {one['contacts_a_zone']:.2f} | {one['over_intact']:.2f} |")
    return told


def draw(found, axes):
    """Draw cost against size and against joints."""
    rows = list(found["by_zones"].values())
    for k in (0, 1):
        cost = [one["ns_a_zone_and_step"][k] for one in rows]
        axes[0].semilogx([one["zones"] for one in rows], cost, "o-", label=f"threads: {k + 1}")
    axes[0].set(xlabel="zones", ylabel="ns a zone and step", ylim=(0.0, None))
    axes[0].legend(fontsize=7)
    rows = list(found["by_joints"].values())
    axes[1].plot([r["contacts_a_zone"] for r in rows], [r["over_intact"] for r in rows], "o-")
    axes[1].set(xlabel="contacts a zone", ylabel="step over that without joints")


def by_zones(quick):
    """Yield name and cost of each size."""
    for name, cells in CELLS.items():
        if quick and cells > 26:
            return
        before, began = resident(), time.perf_counter()
        model = rock_model(cube(cells))
        meshed = time.perf_counter() - began
        n_zones = len(model.mesh.zones)
        n_steps = rounds_of_ledger(n_zones, ZONE_STEPS)
        began = time.perf_counter()
        march = March(prepared(model, n_steps), n_steps)
        assembled = time.perf_counter() - began
        probes = Probes() if cells == max(CELLS.values()) else None
        works = {f"{count}": on(count, march) for count in (1, 2)}
        works |= probes.works() if probes else {}
        took = interleaved(works)
        yield name, {
            "zones": n_zones, "nodes": len(model.mesh.points),
            "ns_a_zone_and_step": [1e9 * median(took[k]) / n_zones / n_steps for k in "12"],
            "two_threads": ratio(took["1"], took["2"]),
            "mesh_us_a_zone": 1e6 * meshed / n_zones,
            "prepare_us_a_zone": 1e6 * assembled / n_zones,
            "bytes_a_zone": (resident() - before) / n_zones,
            "bytes_a_zone_foreseen": run_bytes(model) / n_zones,
        } | ({"probes": probes.found(took)} if probes else {})  # fmt: skip
        del march, model, works, probes


def by_joints(cells):
    """Return the time of a step with joints over that without, by contacts a zone."""
    cells = cells or JOINTED_CELLS
    meshes = {"none": cube(cells)} | {f"{n} cells apart": cube(cells, n) for n in EVERY}
    n_steps = rounds_of_ledger(len(meshes["none"].zones), ZONE_STEPS / 2)
    marches = {
        name: March(prepared(rock_model(mesh), n_steps), n_steps) for name, mesh in meshes.items()
    }
    took = interleaved({name: on(1, march) for name, march in marches.items()})
    return {
        name: {
            "contacts_a_zone": 0.0 if mesh.contacts is None
            else len(mesh.contacts.area) / len(mesh.zones),
            "over_intact": ratio(took[name], took["none"]),
        }
        for name, mesh in meshes.items()
    }  # fmt: skip


def resident():
    """Return the memory that the process holds, bytes, once what is free was given back."""
    gc.collect()
    ctypes.CDLL("libc.so.6").malloc_trim(0)
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")
