"""Motion near a source, wherever it lies in its element, against closed forms.

    python -m verification.near_source [NAME ...] [--page] [--again] [--minutes N]

A box of elements of about 66 m (40 Hz, rock of 2300 m/s) is moved so that the source lies in the
middle of an element, on a face, an edge or a corner; receivers stand in three directions in a full
space, on the surface in three azimuths above a source 8 m deep. Bell of 12 Hz. The error is that
of the three components over the whole record. Writes the rows that
``verification/near_source.json`` lacks and the table of docs/quality/verification.md; ``--page``
writes the table alone.
"""

import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from pyblast.model.source import Column, TimeFunction
from pyblast.project.project import Project
from pyblast.project.result import write_text
from pyblast.solver.run import simulate

from .rows import each_row, options, read_rows
from .solutions.buried_explosion import surface_motion
from .solutions.full_space import Bell, moment, point_force

OUT = Path(__file__).with_suffix(".json")
PAGE = Path(__file__).resolve().parents[1] / "docs" / "quality" / "verification.md"
BEGIN, END = "<!-- near: from verification/near_source.json -->", "<!-- end of near -->"
BELL = Bell(12.0)
SIZE, EDGES = 198.0, 3  # of the box in m, and elements along it
PLACES = {"middle": (0.5, 0.5, 0.5), "face": (0.0, 0.5, 0.5), "edge": (0.0, 0.0, 0.5),
          "corner": (0.0, 0.0, 0.0)}  # fmt: skip
ON_SURFACE = {"middle": (0.5, 0.5), "face": (0.0, 0.5), "edge": (0.0, 0.0)}
AWAY = (5, 10, 20, 30, 40, 50, 65, 80, 95)  # m
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
            "size_m": [SIZE, SIZE, SIZE], "origin_m": low,
            "layers": [{"material": "rock"}], **mesh,
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
    if elements == "quadratic":
        mesh = {"kind": "tetrahedra", "quadratic": True, "edge_m": 19.2}
    else:
        mesh = {"frequency_hz": 40, "order": int(elements.split()[1])}
    surface = source == "buried explosion"
    share = np.array((*ON_SURFACE[place], 0.0) if surface else PLACES[place])
    low = -SIZE / EDGES * (share + np.array([1.0, 1.0, 1.0]))
    turned = np.column_stack([np.cos(AZIMUTHS), np.sin(AZIMUTHS), 0.0 * AZIMUTHS])
    rays, middle = (turned, [0.0, 0.0, DEPTH]) if surface else (RAYS, [0.0, 0.0, 0.0])
    if surface:
        low[2] = DEPTH - SIZE
    receivers = [np.array(middle) + r * ray for r in AWAY for ray in rays]
    project = written(tables(source, low.tolist(), receivers, surface, **mesh))
    model = project.model
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
    worst = np.max(np.reshape(errors, (len(AWAY), -1)), axis=1)
    return {"errors": {f"{r}": round(float(e), 4) for r, e in zip(AWAY, worst, strict=True)}}


def written(parts):
    """Return the project of tables, with its histories in a folder."""
    folder = Path(tempfile.mkdtemp())
    values, dt = BELL.samples()
    for file, title in (("rate.csv", "moment_rate_Nm_per_s"), ("force.csv", "force_n")):
        rows = [f"{n * dt:.9g},{1e9 * value:.9g}" for n, value in enumerate(values)]
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
]


def table(rows):
    """Return the lines of the table."""
    lines = [
        "| source, elements, place | " + " | ".join(f"{r} m" for r in AWAY) + " |",
        "|---|" + "---|" * len(AWAY),
    ]
    for name in NAMES:
        if name in rows:
            cells = [f"{100 * rows[name]['errors'][f'{r}']:.2g}" for r in AWAY]
            lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return lines


def paged(page, rows):
    """Return the page with the table of some rows."""
    before, rest = page.split(BEGIN)
    return f"{before}{BEGIN}\n\n" + "\n".join(table(rows)) + f"\n\n{END}" + rest.split(END)[1]


def main(arguments):
    """Measure rows and write them and the table."""
    arguments, limits = options(arguments)
    names = [a for a in arguments if a != "--page"]
    for name in names:
        if name not in NAMES:
            sys.exit(f"near_source: no row {name!r}; there are {'; '.join(NAMES)}")
    only_page = "--page" in arguments
    rows = read_rows(OUT) if only_page else each_row(OUT, names or NAMES, measured, **limits)
    write_text(PAGE, paged(PAGE.read_text(), rows))


if __name__ == "__main__":
    main(sys.argv[1:])
