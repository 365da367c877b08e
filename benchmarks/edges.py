"""Steps of linear ground by springs along edges against zones one by one, alone and in batches.

    python -m benchmarks.edges

Whole steps of `advance` on one thread, taken in turn, medians; only ratios mean anything. Then the
edges alone, with springs in double and in single precision.
"""

import time
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from pyblast.meshing.mesh_builder import Layer, build_mesh, structured_box
from pyblast.solving import kernels
from pyblast.solving.batches import stacked
from pyblast.solving.edges import EDGE_ARRAYS, without_edges
from pyblast.solving.ground_fields import Heterogeneity
from pyblast.solving.materials import Damping
from pyblast.solving.model import Model
from pyblast.solving.preparation import LEDGER_EVERY, prepare

from .blocky import ROCK, blocky_mesh, blocky_model
from .compiled import ROOT, called, compiled

TURNS = 9
ZONE_STEPS = 4_000_000  # of one turn, in each lane


def cases():
    """Return models by name; every kind of ground that decides what edges are worth."""
    grid = structured_box((32, 32, 32), (160.0, 160.0, 160.0))
    large = structured_box((55, 55, 55), (275.0, 275.0, 275.0))
    cut = build_mesh([(0.0, 150.0)] * 3, [Layer("rock")], edge=5.0)
    free = Model(cut, {"rock": ROCK})
    damped = Damping(0.02, 8.0, corner=120.0)
    return {
        "grid": Model(grid, {"rock": ROCK}),
        "grid, large": Model(large, {"rock": ROCK}),
        "gmsh": free,
        "gmsh, damped": replace(free, damping=damped),
        "gmsh, uneven ground": replace(free, ground=[Heterogeneity(0.1, 30.0, 1)]),
        "blocky": blocky_model(blocky_mesh()[0]),
    }


def march(constants, state, lanes):
    """Return a function that marches some steps and gives the seconds of one."""
    views = (kernels.side_by_side if lanes > 1 else kernels.to_fortran)(constants)
    advance = kernels.advance_all if lanes > 1 else kernels.advance
    state = {name: value.copy() for name, value in state.items()}
    rng = np.random.default_rng(0)
    state["displacement"] += 1e-9 * rng.normal(size=state["displacement"].shape)

    def go(n_steps):
        began = time.process_time()
        advance(views, state, 0, n_steps, LEDGER_EVERY)
        return (time.process_time() - began) / n_steps

    return go


def measure(model):
    """Return shares of skew edges, and zone-steps in millions a second by way of marching."""
    prepared = prepare(model, 1e-3)
    n_zones = len(model.mesh.zones)
    n_steps = LEDGER_EVERY * max(1, round(ZONE_STEPS / n_zones / LEDGER_EVERY))
    long = {**prepared.constants, "history": np.zeros((n_steps, 1))}
    ways = {}
    for name, one in (("zones", without_edges(long)), ("edges", long)):
        ways[name, 1] = march(one, prepared.state, 1)
        both = stacked([one] * kernels.LANES, [prepared.state] * kernels.LANES)
        ways[name, kernels.LANES] = march(*both, kernels.LANES)
    seconds = {way: [] for way in ways}
    for _ in range(TURNS):
        for (name, lanes), go in ways.items():
            seconds[name, lanes].append(go(n_steps) / lanes)
    rates = {way: n_zones / np.median(each) / 1e6 for way, each in seconds.items()}
    skew = len(long["skew_spring"]) / len(long["edge_spring"])
    own = sum(long[name].nbytes for name in EDGE_ARRAYS) / n_zones
    return n_zones, skew, own, rates


def bare(lanes, single):
    """Compile the edges for some lanes, with springs in single precision or in double."""
    with TemporaryDirectory() as folder:
        paths = []
        for name in ("fortran/lanes.f90.in", "fortran/edges.f90", "benchmarks/edge_loops.f90"):
            text = (ROOT / name).read_text().replace("@lanes@", str(lanes))
            if single:
                text = text.replace(
                    "real(dp), intent(in) :: edge_spring", "real, intent(in) :: edge_spring"
                )
            paths.append(Path(folder) / Path(name).name.removesuffix(".in"))
            paths[-1].write_text(text)
        return compiled("fortran/kinds.f90", *paths).loops


def precision(model):
    """Return seconds in double over seconds in single precision, alone and by lanes."""
    constants = kernels.numbered(prepare(model, 1e-3).constants)
    names = ("domain_slot_start", "slot_node", "edge_start", "edge_slot", "edge_spring",
             "skew_start", "skew_slot", "skew_spring")  # fmt: skip
    tables = [constants[name] for name in names]
    n_nodes, n_slots = len(constants["node_mass"]), len(constants["slot_node"])
    counts = (n_nodes, len(constants["domain_set"]), n_slots, len(tables[3]), len(tables[6]))
    found = []
    for lanes in (1, kernels.LANES):
        fields = [np.random.default_rng(0).normal(size=(n, 3, lanes)) for n in (n_nodes, n_slots)]
        ways = []
        for single in (False, True):
            own = [t.astype("f4") if single and t is tables[4] else t for t in tables]
            ways.append((bare(lanes, single), own, []))
        times = max(1, round(ZONE_STEPS / len(model.mesh.zones)))
        for _ in range(TURNS):
            for routine, own, seconds in ways:
                began = time.process_time()
                called(routine, (times, *counts), (), [*own, *fields])
                seconds.append(time.process_time() - began)
        found.append(np.median(ways[0][2]) / np.median(ways[1][2]))
    return found


def main():
    """Print both tables."""
    lanes = kernels.LANES
    print("ground | zones | skew | bytes a zone | zones alone | edges alone | ratio | "
          f"zones by {lanes} | edges by {lanes} | ratio | batch over alone")  # fmt: skip
    for name, model in cases().items():
        n_zones, skew, own, rate = measure(model)
        alone = rate["edges", 1] / rate["zones", 1]
        by = rate["edges", lanes] / rate["zones", lanes]
        print(f"{name} | {n_zones} | {skew:.2f} | {own:.0f} | {rate['zones', 1]:.0f} | "
              f"{rate['edges', 1]:.0f} | {alone:.2f} | {rate['zones', lanes]:.0f} | "
              f"{rate['edges', lanes]:.0f} | {by:.2f} | "
              f"{rate['edges', lanes] / rate['edges', 1]:.2f}", flush=True)  # fmt: skip
    print(f"ground | double over single precision alone | by {lanes}")
    for name, model in cases().items():
        alone, by = precision(model)
        print(f"{name} | {alone:.2f} | {by:.2f}", flush=True)


if __name__ == "__main__":
    main()
