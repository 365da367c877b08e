"""What a node of the absorbing layer costs beside one of the ground of the same model."""

from dataclasses import replace
from time import process_time

import numpy as np

from pyblast.mesh.grid import structured_box
from pyblast.mesh.hexahedra import AbsorbingLayer
from pyblast.solver.assembly import time_step
from pyblast.solver.hexahedra import without_layer
from pyblast.solver.preparation import prepare

from . import timing
from .marching import Steps, rock_model, rounds_of_ledger
from .timing import interleaved, median, on

TITLE = "Absorbing layer"
ORDER, EDGE, BESIDE = 4, 20.0, 2  # m; zones of the layer on each side
ACROSS = {"quick": 6, "usual": 10, "long": 20}  # zones of the ground along x and y
NODE_STEPS = 2e6  # of a march
KINDS = {"double": False, "single": True}


def measure(effort):
    """Return ns of a node and step in the layer and in the ground, by precision."""
    return {name: of_model(open_model(ACROSS[effort], single)) for name, single in KINDS.items()}


def open_model(across, single):
    """Return ground open to all sides but the top, half as deep as wide."""
    sides = EDGE * np.arange(-BESIDE, across + BESIDE + 1)
    levels = EDGE * np.arange(-(across // 2) - BESIDE, 1)
    inner = ((0.0, across * EDGE), (0.0, across * EDGE), (-(across // 2) * EDGE, np.inf))
    layer = AbsorbingLayer(inner, ((BESIDE * EDGE, BESIDE * EDGE),) * 3)
    mesh = replace(structured_box(sides, sides, levels, order=ORDER), layer=layer)
    return replace(rock_model(mesh), single=single, receivers=())


def of_model(model):
    """Return the times of a model with its layer and with plain ground in its place, in turn."""
    n_nodes = len(model.nodes.points)
    n_steps = rounds_of_ledger(n_nodes, NODE_STEPS)
    step = time_step(model)
    whole = prepare(model, (timing.ROUNDS + 1) * n_steps * step[0], step=step)  # all rounds fit
    plain = replace(whole, constants={**whole.constants, **without_layer(whole.constants)})
    share = float((model.mesh.layer.depths(model.nodes.points) > 0.0).any(axis=1).mean())
    marches = {"whole": Steps(whole, n_steps), "plain": Steps(plain, n_steps)}
    took = interleaved({n: on(1, march) for n, march in marches.items()}, clock=process_time)
    ground = took["plain"] / (n_steps * n_nodes) * 1e9
    layer = (took["whole"] / (n_steps * n_nodes) * 1e9 - (1.0 - share) * ground) / share
    return {
        "nodes": n_nodes, "share": share, "ground_ns": median(ground), "layer_ns": median(layer),
        "node_ratio": median(layer / ground),
    }  # fmt: skip


def lines(found):
    """Return the table of this part."""
    told = [
        f"Bricks of order {ORDER}, the layer {BESIDE} of them thick on each side but the top; one "
        "thread, processor seconds. The time of a ground node is that of the same model without "
        "its layer, run in turn.",
        "",
        "| numbers | nodes | of the layer | ns a node of the ground | ns a node of the layer "
        "| ratio |",
        "|---|---|---|---|---|---|",
    ]
    for name, one in found.items():
        times = f"{one['ground_ns']:.1f} | {one['layer_ns']:.1f} | {one['node_ratio']:.2f}"
        told.append(f"| {name} | {one['nodes']} | {100 * one['share']:.0f} % | {times} |")
    return told
