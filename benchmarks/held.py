"""Bytes that a run holds for each node, and the share of its steps that one thread does alone."""

import numpy as np

from pyblast.solver.assembly import time_step
from pyblast.solver.preparation import prepare

from . import layer, timing
from .marching import Steps, rounds_of_ledger
from .timing import interleaved, median, on

TITLE = "Memory and threads of a run"
LARGEST = 8  # arrays that the table names


def measure(effort):
    """Return bytes a node by array and the serial share of an open model in double precision."""
    model = layer.open_model(layer.ACROSS[effort], single=False)
    n_nodes = len(model.nodes.points)
    n_steps = rounds_of_ledger(n_nodes, layer.NODE_STEPS)
    step = time_step(model)
    still = prepare(model, (2 * timing.ROUNDS + 2) * n_steps * step[0], step=step)
    march = Steps(still, n_steps)
    took = interleaved({str(count): on(count, march) for count in timing.THREADS})
    bytes_of = {
        name: np.asarray(values).nbytes / n_nodes
        for part in (still.constants, still.state)
        for name, values in part.items()
    }
    largest = sorted(bytes_of, key=bytes_of.get, reverse=True)[:LARGEST]
    return {
        "nodes": n_nodes, "bytes_a_node": sum(bytes_of.values()),
        "largest": {name: bytes_of[name] for name in largest},
        "serial_share": median(np.clip(2.0 * took["2"] / took["1"] - 1.0, 0.0, 1.0)),
    }  # fmt: skip


def lines(found):
    """Return the table of this part."""
    told = [
        f"{found['nodes']} nodes of bricks of order {layer.ORDER} with absorbing layer, double "
        f"precision: {found['bytes_a_node']:.0f} bytes per node in the arrays of a run. From the "
        "wall times on one thread and on two, measured in turn, one thread does "
        f"{100 * found['serial_share']:.0f} % of a step alone, which includes the effect of other "
        "work on the machine. The largest arrays:",
        "", "| array | bytes a node |", "|---|---|",
    ]  # fmt: skip
    return told + [f"| `{name}` | {size:.0f} |" for name, size in found["largest"].items()]
