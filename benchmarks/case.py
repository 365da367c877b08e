"""A blast site of the size of a recorded case, on meshes that carry its 30 Hz, in batches."""

import numpy as np

from pyblast.mesh.builder import structured_box
from pyblast.mesh.grid import graded_axis
from pyblast.model.boundary import Viscous
from pyblast.model.joint import Joint
from pyblast.model.material import Material
from pyblast.model.model import Model, Receiver, SpongeLayer
from pyblast.model.source import Hole, TimeFunction
from pyblast.solver.assembly import time_step
from pyblast.solver.preparation import prepare

from .blind.flat_models import Discretization
from .marching import LEDGER_EVERY, QUIET, March, rounds_of_ledger
from .timing import interleaved, median, on

TITLE = "Case"
BOX = ((0.0, 228.0), (0.0, 160.0), (-80.0, 0.0))
JOINT, ROCK = 93.0, Material.from_speeds(2728.0, 3072.0, 1641.0)
HIGHEST, DURATION = 30.0, 0.95
KINDS = {"constant strain": False, "quadratic": True}
ZONE_STEPS = 6_000_000
RIM = 110.0, 1.15  # m, growth of cells: as for runs that a finer mesh corrects
# Mean edge of the zones of a cell over that of the cell: of five zones, and of twelve.
MEAN_EDGE = {False: 2.0 / 3.0 * (1.0 + 2.0**0.5) / 2.0 + 2.0**0.5 / 3.0,
             True: (2.0 + 2.0**0.5 + 3.0 * 3.0**0.5 / 2.0) / 6.0}  # fmt: skip


def measure(effort):
    """Return sizes and seconds a blast, alone and in a batch of eight, by kind of zone."""
    highest = 10.0 if effort == "quick" else HIGHEST
    return {name: of_kind(site(quadratic, highest)) for name, quadratic in KINDS.items()}


def of_kind(model):
    """Return what one kind of zone needs: steps timed, then taken times their number."""
    step = time_step(model)
    dt, n_zones = step[0], len(model.mesh.zones)
    n_steps = int(np.ceil(DURATION / dt))
    some = rounds_of_ledger(n_zones, ZONE_STEPS / (10 if model.quadratic else 1))
    still = prepare(model, some * dt, step=step)
    one, eight = March(still, some), March(still, LEDGER_EVERY, lanes=True)
    took = interleaved({"one": on(2, one), "eight": on(2, eight)})
    return {
        "zones": n_zones, "nodes": len(model.nodes.points), "dt_ms": 1e3 * dt, "steps": n_steps,
        "seconds_a_blast_alone": n_steps * median(took["one"]) / one.n_steps,
        "seconds_a_blast_in_batch": n_steps * median(took["eight"]) / eight.n_steps / 8.0,
    }  # fmt: skip


def site(quadratic, highest):
    """Return the model of a blast whose box carries a frequency in Hz; the sponge is coarser."""
    edges = 3.0 if quadratic else 10.0
    edge = ROCK.cs / (edges * highest) / MEAN_EDGE[quadratic]
    return blast(Discretization(edge, *RIM, quadratic))


def blast(cut):
    """Return the model with twelve holes, ten receivers, a joint and a sponge."""
    axes = [
        graded_axis(BOX[0], [JOINT], cut.edge, cut.padding, cut.padding, cut.growth),
        graded_axis(BOX[1], [], cut.edge, cut.padding, cut.padding, cut.growth),
        graded_axis(BOX[2], [], cut.edge, cut.padding, 0.0, cut.growth),
    ]
    mesh = structured_box(*axes, planes={"J1": ("x", JOINT)}, pattern=cut.pattern).split(["J1"])
    times = np.arange(0.0, 0.12, 1e-3)
    turn = (np.pi * 15.0 * (times - 0.06)) ** 2
    rate = TimeFunction(1e9 * (1.0 - 2.0 * turn) * np.exp(-turn), 1e-3)
    holes = [
        Hole(np.array([40.0 + 5.0 * (k % 4), 60.0 + 6.0 * (k // 4), -12.0]), 30.0, 0.017 * k, rate,
             0.84, cut.spread)
        for k in range(12)
    ]  # fmt: skip
    return Model(
        mesh, {"rock": ROCK}, joints=[Joint("J1", "elastic", {"kn": 5.85e8, "ks": 2.66e8})],
        boundaries=[Viscous(side) for side in QUIET], sources=holes,
        sponge=SpongeLayer(BOX, cut.padding),
        receivers=[Receiver(f"R{k}", (110.0 + 10.0 * k, 40.0 + 9.0 * k, -0.1)) for k in range(10)],
        quadratic=cut.quadratic,
    )  # fmt: skip


def lines(found):
    """Return the table of this part."""
    told = [
        f"Rock of {BOX[0][1]:g} × {BOX[1][1]:g} × {-BOX[2][0]:g} m with a joint and an absorbing "
        "layer of "
        f"{RIM[0]:g} m, twelve holes, {DURATION:g} s, on the coarsest mesh whose box carries "
        f"{HIGHEST:g} Hz. Two threads; one step is timed, and multiplied by the number of steps.",
        "",
        "| zones | number | nodes | steps | s a blast alone | in a batch of 8 |",
        "|---|---|---|---|---|---|",
    ]
    for name, one in found.items():
        told.append(
            f"| {name} | {one['zones']} | {one['nodes']} | {one['steps']} "
            f"| {one['seconds_a_blast_alone']:.1f} | {one['seconds_a_blast_in_batch']:.1f} |"
        )
    return told
