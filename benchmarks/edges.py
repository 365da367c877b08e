"""Steps of linear ground by springs along edges and by zones: what the ground makes of it.

Then the edges alone, with springs in double and in single precision.
"""

from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from pyblast import core
from pyblast.mesh.builder import Layer, build_mesh
from pyblast.model.ground_fields import Heterogeneity
from pyblast.model.material import Damping
from pyblast.model.model import Model
from pyblast.solver.edge_springs import EDGE_ARRAYS

from .blocky import ROCK, blocky_mesh, blocky_model
from .compiled import FILLED, ROOT, called, compiled
from .marching import March, by_zones, cube, prepared, rounds_of_ledger
from .timing import interleaved, median, on, ratio

TITLE = "Edges"
ZONE_STEPS = 4_000_000  # of one timing, in each lane
TABLES = ("domain_slot_start", "slot_node", "edge_start", "edge_slot", "edge_spring",
          "skew_start", "skew_slot", "skew_spring")  # fmt: skip


def measure(effort):
    """Return sizes, rates and ratios by kind of ground."""
    return {name: of_ground(model) for name, model in cases(effort == "quick").items()}


def cases(quick):
    """Return models by name; every kind of ground that decides what edges are worth."""
    side = 60.0 if quick else 150.0
    cut = build_mesh([(0.0, side)] * 3, [Layer("rock")], edge=5.0)
    free = Model(cut, {"rock": ROCK})
    found = {
        "grid": Model(cube(12 if quick else 32), {"rock": ROCK}),
        "unstructured": free,
        "unstructured, damped": replace(free, damping=Damping(0.02, 8.0, corner=120.0)),
        "unstructured, random speeds": replace(free, ground=[Heterogeneity(0.1, 30.0, 1)]),
    }
    return found if quick else found | {"blocky": blocky_model(blocky_mesh()[0])}


def of_ground(model):
    """Return what one kind of ground gives, alone and in batches."""
    n_zones, lanes = len(model.mesh.zones), core.BATCH_SIZE
    n_steps = rounds_of_ledger(n_zones, ZONE_STEPS)
    edges = prepared(model, n_steps)
    took = interleaved({
        f"{name}_{count}": on(1, March(one, n_steps, lanes=count > 1))
        for name, one in (("zones", by_zones(edges)), ("edges", edges))
        for count in (1, lanes)
    })  # fmt: skip
    own = edges.constants
    return {
        "zones": n_zones,
        "skew": len(own["skew_spring"]) / len(own["edge_spring"]),
        "bytes_a_zone": sum(own[name].nbytes for name in EDGE_ARRAYS) / n_zones,
        "million_zone_steps_per_s": {
            name: int(name.split("_")[1]) * n_zones * n_steps / median(times) / 1e6
            for name, times in took.items()
        },
        "edges_over_zones": [ratio(took[f"zones_{n}"], took[f"edges_{n}"]) for n in (1, lanes)],
        "double_over_single": [precision(own, n) for n in (1, lanes)],
    }


def precision(constants, lanes):
    """Return seconds of the edges alone, springs in double over springs in single precision."""
    constants = core.numbered(constants)
    tables = {name: constants[name] for name in TABLES}
    n_nodes, n_slots = len(constants["node_mass"]), len(constants["slot_node"])
    sizes = (len(tables[name]) for name in ("edge_slot", "skew_slot"))
    counts = (n_nodes, len(constants["domain_set"]), n_slots, *sizes)
    fields = [np.random.default_rng(0).normal(size=(n, 3, lanes)) for n in (n_nodes, n_slots)]
    times = max(1, round(ZONE_STEPS / constants["zone_slot"].shape[1]))

    def work(routine, kind):
        own = {**tables, "edge_spring": tables["edge_spring"].astype(kind)}
        return on(1, lambda: called(routine, (times, *counts), (), [*own.values(), *fields]))

    took = interleaved({kind: work(bare(lanes, kind == "f4"), kind) for kind in ("f8", "f4")})
    return ratio(took["f8"], took["f4"])


def bare(lanes, single):
    """Compile the edges for some lanes, with springs in single precision or in double."""
    with TemporaryDirectory() as folder:
        paths = []
        for name in (
            "fortran/batch.f90.in",
            "fortran/edge_springs.f90",
            "benchmarks/edge_loops.f90",
        ):
            text = (ROOT / name).read_text().replace("@n_batch@", str(lanes))
            text = text.replace("@kernel_width@", FILLED["kernel_width"])
            if single:
                text = text.replace(
                    "real(dp), intent(in) :: edge_spring", "real, intent(in) :: edge_spring"
                )
            paths.append(Path(folder) / Path(name).name.removesuffix(".in"))
            paths[-1].write_text(text)
        return compiled("fortran/kinds.f90.in", *paths).loops


def lines(found):
    """Return the table of this part."""
    told = [
        "Full steps on one thread, in million zones per second, alone and in batches of 8. Where "
        "its neighbours differ, an edge also has a skew part; if more than 70 % have one, ground "
        "runs by zones unless in a batch. *Single* is the gain from springs in single precision "
        "(edges alone, without the rest of a step); pyblast keeps them in double.",
        "",
        "| ground | zones | skew edges | B a zone | alone: zones, edges | by 8: zones, edges "
        "| edges over zones, alone and by 8 | single |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for name, one in found.items():
        rate = one["million_zone_steps_per_s"]
        pairs = [", ".join(f"{rate[f'{way}_{n}']:.0f}" for way in ("zones", "edges"))
                 for n in (1, core.BATCH_SIZE)]  # fmt: skip
        pairs += [", ".join(f"{gain:.2f}" for gain in one[way])
                  for way in ("edges_over_zones", "double_over_single")]  # fmt: skip
        told.append(
            f"| {name} | {one['zones']} | {one['skew']:.0%} | {one['bytes_a_zone']:.0f} "
            f"| {' | '.join(pairs)} |"
        )
    return told
