"""Absorbing layer of hexahedra: energy that it sends back, and growth over 100,000 steps.

    python -m verification.absorbing [back | growth] [GROUND ...] [--page] [--again] [--minutes N]

Energy sent back: a point force stands one hexahedron beside the long side of a box with a free top;
receivers stand beside the same side, at incidences up to 80 degrees, and on the top. The same
ground goes on for ten more hexahedra in the reference run, and the layer stands there. Shares of
the energy of the reference are given by band and at the worst receiver.

Growth: a small box starts from random velocities of the nodes inside the layer, without momentum,
and runs 100,000 steps without a source. The rate is the slope of ln(energy) in its last half:
nothing may feed it, so that a rate above zero, where more than rounding is left, is that of the
layer. Grounds are named by the S speed of a soil of one hexahedron on rock. Writes the rows that
``verification/absorbing.json`` lacks and the tables of docs/quality/verification.md; ``--page``
writes the tables alone.
"""

import re
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from pyblast.errors import SolverError
from pyblast.files import write_text
from pyblast.mesh.builder import structured_box
from pyblast.mesh.grid import Layer
from pyblast.mesh.hexahedra import AbsorbingLayer
from pyblast.model.boundary import Viscous
from pyblast.model.joint import Joint
from pyblast.model.material import ConstantQ, Material
from pyblast.model.model import Model, Receiver
from pyblast.model.source import PointForce, TimeFunction
from pyblast.solver.preparation import prepare
from pyblast.solver.run import simulate

from .markdown import between
from .rows import each_row, options, read_rows

OUT = Path(__file__).with_suffix(".json")
PAGE = Path(__file__).resolve().parents[1] / "docs" / "quality" / "verification.md"
BEGIN, END = "<!-- layer: from verification/absorbing.json -->", "<!-- end of layer -->"
SIDES = "west", "east", "south", "north", "bottom"
LAYER, BEYOND = 2, 10  # hexahedra: of the layer, and of ground beyond the box in the reference
ORDER, EDGE, SHAPE = 4, 40.0, (14, 3, 2)
ANGLES = 0, 30, 45, 60, 70, 80  # degrees, of a ray that the long side reflects
BANDS = (3.0, 12.0), (12.0, 30.0)  # Hz
DURATION, STEP = 0.45, 1e-3  # s
STEPS, SMALL = 100_000, (2, 2, 2)
ROUNDING = 1e-12  # of the energy at the start


def rock(density=2600.0, cp=3000.0, cs=1700.0, **parts):
    """Return a material by density in kg/m3 and speeds in m/s."""
    return Material.from_speeds(density, cp, cs, **parts)


def over(upper, **parts):
    """Return a ground with another material in its upper hexahedron."""
    return {"materials": {"rock": rock(), "soil": upper}, **parts}


LOSS = ConstantQ(40.0, 20.0, (2.0, 60.0))
GROUNDS = {
    "one rock": {},
    "constant Q": {"materials": {"rock": rock(law=LOSS)}},
    "soft over stiff": over(rock(2200.0, 2000.0, 1000.0)),
    "stiff over soft": {"materials": {"rock": rock(2200.0, 2000.0, 1000.0), "soil": rock()}},
    "joint across the side": {"joint": Joint("J", "elastic", {"kn": 2e9, "ks": 5e8})},
}
SOILS = {
    f"soil of {cs:g} m/s, {water}{', Q 20' if loss else ''}": (cs, cp, loss)
    for cs in (170.0, 340.0)
    for water, cp in (("dry", 2.0 * cs), ("wet", 1500.0))
    for loss in (False, True)
    if cs < 200.0 or not loss
}


def box(shape, edges, beyond, *, materials=None, joint=None, **parts):
    """Return a box open to all sides but the top, with ``beyond`` hexahedra and the layer."""
    outer = beyond + LAYER
    lines = []
    for count, edge in zip(shape[:2], edges[:2], strict=True):
        lines.append(edge * np.arange(-outer, count + outer + 1))
    below = edges[2][-1] * np.arange(outer, 0, -1)
    depths = np.cumsum(edges[2])
    lines.append(np.concatenate([-depths[-1] - below, -depths[::-1], [0.0]]))
    margin = beyond * np.array([*edges[:2], edges[2][-1]])
    ends = np.array([shape[0] * edges[0], shape[1] * edges[1]])
    inner = (
        (-margin[0], ends[0] + margin[0]),
        (-margin[1], ends[1] + margin[1]),
        (-depths[-1] - margin[2], np.inf),
    )
    widths = tuple((LAYER * edge, LAYER * edge) for edge in (*edges[:2], edges[2][-1]))
    materials = materials or {"rock": rock()}
    layers = [Layer("soil", edges[2][0]), Layer("rock", None)] if "soil" in materials else None
    planes = {"J": ("x", edges[0] * (shape[0] // 2))} if joint else {}
    mesh = structured_box(*lines, order=ORDER, layers=layers, planes=planes)
    mesh = replace(mesh, layer=AbsorbingLayer(inner, widths))
    return Model(
        mesh.split(list(planes)),
        materials,
        joints=() if joint is None else (joint,),
        boundaries=tuple(Viscous(side) for side in SIDES),
        **parts,
    )


def pulse(frequency=12.0, peak=0.11):
    """Return a Ricker pulse."""
    t = np.arange(0.0, 0.4, 1e-4)
    a = (np.pi * frequency * (t - peak)) ** 2
    return TimeFunction((1.0 - 2.0 * a) * np.exp(-a), 1e-4)


def spectra(model):
    """Simulate; return power spectra (n_receivers, 3, n) of the motion, which a window closes."""
    run = simulate(model, DURATION)
    times = np.arange(0.0, DURATION - 2.0 * STEP, STEP)
    return np.array(
        [run.seismograms[r.name].sampled(0.0, STEP, len(times)).velocity.T for r in model.receivers]
    )


def sent_back(name):
    """Return the row of a ground: shares of energy by band, of all receivers and of the worst."""
    began = time.perf_counter()
    source = np.array([1.2 * EDGE, EDGE, -0.45 * EDGE])
    beside = [source[0] + 2.0 * EDGE * np.tan(np.radians(angle)) for angle in ANGLES]
    receivers = [
        Receiver(f"{angle}", (float(x), EDGE, -0.45 * EDGE))
        for angle, x in zip(ANGLES, beside, strict=True)
    ]
    receivers += [Receiver(f"top {k}", (float(x), 1.6 * EDGE, 0.0)) for k, x in enumerate(beside)]
    parts = {
        "sources": (PointForce(source, np.array([1e8, 2e8, -3e8]), pulse()),),
        "receivers": tuple(receivers),
        **GROUNDS[name],
    }
    edges = EDGE, EDGE, [EDGE] * SHAPE[2]
    layered, large = (spectra(box(SHAPE, edges, beyond, **parts)) for beyond in (0, BEYOND))
    hertz = np.fft.rfftfreq(large.shape[-1], STEP)
    change, energy = (np.abs(np.fft.rfft(motion)) ** 2 for motion in (layered - large, large))
    row = {"receivers": len(receivers), "wall_s": 0.0}
    for low, high in BANDS:
        own = (hertz >= low) & (hertz < high)
        back, there = (part[..., own].sum(axis=(1, 2)) for part in (change, energy))
        worst = int(np.argmax(back / there))
        row[f"{low:g} to {high:g} Hz"] = {
            "share": float(back.sum() / there.sum()),
            "worst": float(back[worst] / there[worst]),
            "at": receivers[worst].name,
        }
    return {**row, "wall_s": round(time.perf_counter() - began, 1)}


def growth(name):
    """Return the row of a small ground: rate of growth of energy in 1/s over many steps."""
    if name in GROUNDS:
        model = box(SMALL, (EDGE, EDGE, [EDGE] * SMALL[2]), 0, **GROUNDS[name])
    else:
        cs, cp, loss = SOILS[name]
        soil = rock(1800.0, cp, cs, **({"law": LOSS} if loss else {}))
        model = box(SMALL, (15.0, 15.0, [5.7, 15.0]), 0, **over(soil))
    duration = STEPS * 0.1 / prepare(model, 0.1).n_steps
    prepared = prepare(model, duration)
    noise = np.random.default_rng(5).standard_normal(prepared.state["velocity"].shape)
    outside = model.mesh.layer.depths(model.nodes.points).max(axis=1) > 0.0
    noise[outside] = 0.0
    noise[~outside] -= noise[~outside].mean(axis=0)
    state = {**prepared.state, "velocity": noise}
    began = time.perf_counter()
    try:
        run = simulate(model, duration, prepared=replace(prepared, state=state))
    except SolverError as error:
        return {"duration_s": duration, "rate_per_s": None, "stopped": str(error)}
    energy = run.energy["kinetic"] + run.energy["strain"]
    late = np.linspace(0.0, duration, len(energy)) >= 0.5 * duration
    times = np.linspace(0.0, duration, len(energy))[late]
    rate = float(np.polyfit(times, np.log(energy[late]), 1)[0])
    return {
        "duration_s": duration, "rate_per_s": rate,
        "left": float(energy[-1] / energy[0]), "wall_s": round(time.perf_counter() - began, 1),
    }  # fmt: skip


def table(rows):
    """Return the lines of both tables."""
    bands = [f"{low:g} to {high:g} Hz" for low, high in BANDS]
    back = [
        f"| {ground} | "
        + " | ".join(
            f"{100 * row[band]['share']:.2g}, {100 * row[band]['worst']:.2g} ({row[band]['at']})"
            for band in bands
        )
        + " |"
        for ground, row in _of_job("back", rows)
    ]
    grow = [
        f"| {ground} | {row['duration_s']:.3g} | {_grown(row)} |"
        for ground, row in _of_job("growth", rows)
    ]
    return [
        "| ground | " + " | ".join(f"{band}: all %, worst % (receiver)" for band in bands) + " |",
        "|---|" + "---|" * len(bands),
        *back,
        "",
        "| ground, 100,000 steps from noise | model time s | energy left, growth 1/s |",
        "|---|---|---|",
        *grow,
    ]


def _grown(row):
    """Return the cell of a growth: what is left, and the rate where that is more than rounding."""
    if row["rate_per_s"] is None:
        when = re.search(r"the energy at ([\d.e+-]+) s", row["stopped"])
        return f"**grows: the run stopped{f' at {when[1]} s' if when else ''}**"
    if row["left"] < ROUNDING:
        return f"{row['left']:.1e}"
    cell = f"{row['left']:.1e}, {row['rate_per_s']:+.2g}"
    return f"**{cell}**" if row["rate_per_s"] > 0.0 else cell


def _of_job(job, rows):
    """Return the grounds of a job with their rows, in the order of the study."""
    return [(n, rows[f"{job}, {n}"]) for n in JOBS[job][1] if f"{job}, {n}" in rows]


JOBS = {"back": (sent_back, list(GROUNDS)), "growth": (growth, [*GROUNDS, *SOILS])}


def measured(name):
    """Return the row of a job and a ground, such as "back, one rock"."""
    job, ground = name.split(", ", 1)
    return JOBS[job][0](ground)


def paged(page, rows):
    """Return the page with the tables of some rows."""
    return between(page, (BEGIN, END), table(rows))


def main(arguments):
    """Measure grounds and write their rows and the tables."""
    arguments, limits = options(arguments)
    job, *grounds = [a for a in arguments if a != "--page"] or [None]
    if job is not None and job not in JOBS:
        sys.exit(f"absorbing: no job {job!r}; there are {', '.join(JOBS)}")
    for ground in grounds:
        if ground not in JOBS[job][1]:
            sys.exit(f"absorbing: no ground {ground!r}; there are {', '.join(JOBS[job][1])}")
    names = [f"{j}, {n}" for j in ([job] if job else JOBS) for n in grounds or JOBS[j][1]]
    only_page = "--page" in arguments
    rows = read_rows(OUT) if only_page else each_row(OUT, names, measured, **limits)
    write_text(PAGE, paged(PAGE.read_text(), rows))


if __name__ == "__main__":
    main(sys.argv[1:])
