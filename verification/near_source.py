"""Motion near a source, wherever it lies in its element, against closed forms.

    python -m verification.near_source [NAME ...] [--page] [--again] [--minutes N]

A box of elements of about 66 m (40 Hz, rock of 2300 m/s) is moved so that the source lies in the
middle of an element, on a face, an edge or a corner; receivers stand in three directions in a full
space, on the surface in three azimuths above a source 8 m deep. Bell of 12 Hz. The error is that
of the three components over the whole record. Rows of an order have the source over a sphere;
"injected" ones stand in a box of five elements, where the program injects, "widened" ones in
three, where it goes on beyond the sides to do so; in "graded" ones it shortens edges; "far" ones
stand up to three elements away, over a sphere of order 5. A quarry of 18 holes stands for the
whole of it. Writes the rows that ``verification/near_source.json`` lacks and the tables of
docs/quality/verification.md; ``--page`` writes the tables alone.
"""

import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from pyblast.model.source import Column, TimeFunction
from pyblast.project.project import Project
from pyblast.solver.preparation import prepare
from pyblast.solver.run import simulate

from .rows import study
from .solutions.buried_explosion import surface_motion
from .solutions.full_space import Bell, moment, point_force

OUT = Path(__file__).with_suffix(".json")
PAGE = Path(__file__).resolve().parents[1] / "docs" / "quality" / "verification.md"
BEGIN, END = "<!-- near: from verification/near_source.json -->", "<!-- end of near -->"
BELL = Bell(12.0)
SIZE, EDGES = 198.0, 3  # of the box in m, and elements along it
WIDE = 2  # more elements along it, in the middle of which is room for an injection
QUARRY_HOLES = [(5.0 * i, 4.0 * j, -8.0) for i in range(6) for j in range(3)]
QUARRY_DELAY = 0.009
QUARRY = {"between": (12.5, 6), "5": (30, 8), "10": (35, 8), "20": (45, 4), "30": (55, 4),
          "55": (75, 30), "100": (125, 4), "200": (225, 20), "275": (300, -20)}  # fmt: skip
PLACES = {"middle": (0.5, 0.5, 0.5), "face": (0.0, 0.5, 0.5), "edge": (0.0, 0.0, 0.5),
          "corner": (0.0, 0.0, 0.0)}  # fmt: skip
ON_SURFACE = {"middle": (0.5, 0.5), "face": (0.0, 0.5), "edge": (0.0, 0.0)}
AWAY = (5, 10, 20, 30, 40, 50, 65, 80, 95)  # m
FAR = (80, 95, 100, 115, 130, 150, 175, 200)  # m, of "far" rows, in a box of seven elements
RAYS = np.array([[1.0, 0.0, 0.0], [0.5**0.5, 0.5**0.5, 0.0], [3**-0.5, 3**-0.5, 3**-0.5]])
AZIMUTHS = np.radians([0.0, 45.0, 80.0])
DEPTH, LENGTH, DETONATION = 8.0, 10.0, 4500.0
COUPLE = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])


def tables(source, low, receivers, surface, **mesh):
    """Return the tables of a project file of a source at the origin."""
    sides = ["west", "east", "south", "north", "bottom", *([] if surface else ["top"])]
    parts = {
        "title": "Near a source",
        "mesh": {
            "origin_m": low, "layers": [{"material": "rock"}], **mesh,
        },
        "materials": {"rock": {"density_kg_per_m3": 2600, "cp_m_per_s": 4000, "cs_m_per_s": 2300}},
        "boundaries": {"viscous": sides},
        "receivers": [{"name": f"{n}", "position_m": list(p)} for n, p in enumerate(receivers)],
        "run": {"duration_s": 0.22},
    }  # fmt: skip
    if source == "force":
        parts["point_forces"] = [
            {"position_m": [0.0, 0.0, 0.0], "direction": [0.0, 0.0, 1.0], "file": "force.csv"}
        ]
    else:
        tensor = [0, 0, 0, 0, 0, 1] if source == "couple" else [1, 1, 1, 0, 0, 0]
        parts["moment_tensors"] = [
            {"position_m": [0.0, 0.0, 0.0], "tensor": tensor, "file": "rate.csv"}
        ]
    return parts


def measured(name):
    """Return the worst error at each distance of a row such as "explosion, order 5, corner"."""
    source, elements, place = name.split(", ")
    if source == "quarry":
        return quarry(elements)
    mesh, wide, distances = {"frequency_hz": 40, "near_source_work": 1.0}, 0, AWAY
    if elements == "quadratic":
        mesh = {"kind": "tetrahedra", "quadratic": True, "edge_m": 19.2}
    elif elements == "injected":
        wide = WIDE
    elif elements == "far":
        mesh["order"], wide, distances = 5, 2 * WIDE, FAR
    elif elements in ("widened", "graded"):
        mesh["near_source_work"] = 30.0
    else:
        mesh["order"] = int(elements.split()[1])
    surface = source == "buried explosion"
    share = np.array((*ON_SURFACE[place], 0.0) if surface else PLACES[place])
    low = -SIZE / EDGES * (share + 1.0 + 0.5 * wide)
    mesh["size_m"] = [SIZE * (1.0 + wide / EDGES)] * 3
    turned = np.column_stack([np.cos(AZIMUTHS), np.sin(AZIMUTHS), 0.0 * AZIMUTHS])
    rays, middle = (turned, [0.0, 0.0, DEPTH]) if surface else (RAYS, [0.0, 0.0, 0.0])
    if surface:
        low[2] = DEPTH - mesh["size_m"][2]
    receivers = [np.array(middle) + r * ray for r in distances for ray in rays]
    parts = tables(source, low.tolist(), receivers, surface, **mesh)
    if elements == "graded" and surface:  # sources of a given radius are not injected
        parts["moment_tensors"][0]["spread_m"] = DEPTH
    project = written(parts)
    model = project.model
    if elements.startswith("order") or elements == "far":
        model = replace(model, injected=False)
    if source == "column":
        values, dt = BELL.samples()
        ends = np.array([[0.0, 0.0, -0.5 * LENGTH], [0.0, 0.0, 0.5 * LENGTH]])
        rate = TimeFunction(1e9 * values, dt)
        column = Column(*ends, 1.0, 0.0, rate, detonation_speed=DETONATION)
        model = replace(model, sources=[column])
    records = simulate(model, project.duration).seismograms
    wanted = closed_form(source, records["0"].times, rays, receivers, model.materials["rock"])
    errors = [
        np.linalg.norm(records[f"{n}"].velocity - motion) / np.linalg.norm(motion)
        for n, motion in enumerate(wanted)
    ]
    worst = np.max(np.reshape(errors, (len(distances), -1)), axis=1)
    return {"errors": {f"{r}": round(float(e), 4) for r, e in zip(distances, worst, strict=True)}}


def quarry(way):
    """Return the errors of 18 holes, the seconds of processor of their run, nodes and steps."""
    low, size = [-80.0, -86.0, -96.0], [410.0, 180.0, 96.0]
    receivers = [(*at, 0.0) for at in QUARRY.values()]
    parts = tables("buried explosion", low, receivers, True, size_m=size, frequency_hz=40)
    parts["mesh"]["near_source_work"] = 30.0 if way == "graded" else 1.0
    parts["run"]["duration_s"] = 0.5
    parts["moment_tensors"] = [
        {"position_m": list(hole), "tensor": [1, 1, 1, 0, 0, 0], "file": f"rate{n}.csv"}
        for n, hole in enumerate(QUARRY_HOLES)
    ]
    if way == "graded":  # sources of a given radius are not injected
        for part in parts["moment_tensors"]:
            part["spread_m"] = DEPTH
    project = written(parts, len(QUARRY_HOLES))
    model = replace(project.model, injected=way == "injected")
    began = time.process_time()
    prepared = prepare(model, project.duration)
    began, before = time.process_time(), time.process_time() - began
    records = simulate(model, project.duration, prepared=prepared).seismograms
    seconds = time.process_time() - began
    wanted, times = np.zeros((len(receivers), len(records["0"].times), 3)), records["0"].times
    for number, hole in enumerate(QUARRY_HOLES):
        offset = np.array(receivers)[:, :2] - hole[:2]
        away = np.hypot(*offset.T)
        late = times - number * QUARRY_DELAY
        motion = 1e9 * surface_motion(BELL, 75.0, DEPTH, away, np.maximum(late, 0.0),
                                      model.materials["rock"])  # fmt: skip
        motion[:, late < 0.0] = 0.0
        wanted[..., :2] += motion[..., :1] * (offset / away[:, None])[:, None]
        wanted[..., 2] += motion[..., 1]
    errors = [
        np.linalg.norm(records[f"{n}"].velocity - motion) / np.linalg.norm(motion)
        for n, motion in enumerate(wanted)
    ]
    return {
        "errors": {key: round(float(e), 4) for key, e in zip(QUARRY, errors, strict=True)},
        "nodes": len(model.nodes.points), "steps": prepared.n_steps,
        "prepare_s": round(before, 1), "run_s": round(seconds, 1),
    }  # fmt: skip


def written(parts, delayed=0):
    """Return the project of tables, with its histories in a folder."""
    folder = Path(tempfile.mkdtemp())
    values, dt = BELL.samples()
    files = [("rate.csv", "moment_rate_Nm_per_s", 0.0), ("force.csv", "force_n", 0.0)]
    files += [(f"rate{n}.csv", "moment_rate_Nm_per_s", n * QUARRY_DELAY) for n in range(delayed)]
    for file, title, late in files:
        rows = [f"{late + n * dt:.9g},{1e9 * value:.9g}" for n, value in enumerate(values)]
        (folder / file).write_text("\n".join([f"time_s,{title}", *rows]) + "\n")
    return Project.from_dict(parts, folder)


def closed_form(source, times, rays, receivers, rock):
    """Return the velocity (n, 3) at each receiver."""
    if source == "force":
        up = np.array([0.0, 0.0, 1.0])
        return [1e9 * point_force(times, at, up, BELL, rock) for at in receivers]
    if source == "buried explosion":
        motion = 1e9 * surface_motion(BELL, 75.0, DEPTH, AWAY, times, rock)
        return [
            np.column_stack([each[:, :1] * ray[:2], each[:, 1]]) for each in motion for ray in rays
        ]
    if source == "column":
        points = (np.arange(20) + 0.5) / 20 * LENGTH
        tensor = Column(np.zeros(3), np.array([0.0, 0.0, 1.0]), 1.0, 0.0, TimeFunction([0, 0], 1))
        return [
            5e7 * sum(
                moment(times - z / DETONATION, at - np.array([0.0, 0.0, z - 0.5 * LENGTH]),
                       tensor.tensor(rock), BELL, rock)
                for z in points
            )
            for at in receivers
        ]  # fmt: skip
    tensor = COUPLE if source == "couple" else np.eye(3)
    return [1e9 * moment(times, at, tensor, BELL, rock) for at in receivers]


NAMES = [
    *(f"explosion, order {order}, {place}" for order in (5, 3, 4, 6) for place in PLACES),
    "explosion, quadratic, middle",
    *(f"{s}, order 5, {place}" for s in ("couple", "force", "column") for place in PLACES),
    *(f"buried explosion, order 5, {place}" for place in ON_SURFACE),
    *(f"explosion, injected, {place}" for place in PLACES),
    *(f"buried explosion, injected, {place}" for place in ON_SURFACE),
    "explosion, widened, corner",
    "buried explosion, widened, edge",
    "couple, graded, corner",
    "force, graded, corner",
    "buried explosion, graded, edge",
    *(f"{s}, far, corner" for s in ("explosion", "couple", "force", "column")),
    *(f"quarry, {way}, 18 holes" for way in ("spheres", "injected", "graded")),
]


def table(rows):
    """Return the lines of the table."""
    lines = []
    for distances in (AWAY, FAR):
        lines += [
            "| source, elements, place | " + " | ".join(f"{r} m" for r in distances) + " |",
            "|---|" + "---|" * len(distances),
        ]
        for name in NAMES:
            far = ", far, " in name
            if name in rows and not name.startswith("quarry") and far == (distances is FAR):
                cells = [f"{100 * rows[name]['errors'][f'{r}']:.2g}" for r in distances]
                lines.append(f"| {name} | " + " | ".join(cells) + " |")
        lines.append("")
    head = "| quarry | nodes × steps | s to prepare, to run | "
    lines += [head + " | ".join(QUARRY) + " m |", "|---|---|---|" + "---|" * len(QUARRY)]
    for name in NAMES:
        if name in rows and name.startswith("quarry"):
            row = rows[name]
            cells = [f"{row['nodes']} × {row['steps']}", f"{row['prepare_s']}, {row['run_s']}"]
            cells += [f"{100 * row['errors'][at]:.2g}" for at in QUARRY]
            lines.append(f"| {name.split(', ')[1]} | " + " | ".join(cells) + " |")
    return lines


def main(arguments):
    """Measure rows and write them and the table."""
    study(arguments, NAMES, measured, table, OUT, PAGE, (BEGIN, END))


if __name__ == "__main__":
    main(sys.argv[1:])
