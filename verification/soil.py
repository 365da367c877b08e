"""Thin soil on rock through project files: cost over the rock alone, error against a closed form.

    python -m verification.soil [GROUND ...] [--page] [--again] [--minutes N]

A horizontal couple stands 18 m under the soil; receivers on it stand near (60 m) and far (150 m).
Each ground is run as `pyblast run` meshes it and compared with plane waves of a layered half space,
integrated over wavenumbers, which shares no line with the program. The cost is nodes times steps
over those of the same box of rock. Writes the rows that ``verification/soil.json`` lacks and the
table of docs/quality/verification.md; ``--page`` writes the table alone.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

from pyblast.files import write_text
from pyblast.project.checks_ground import summarise_model
from pyblast.project.project import Project

from .rows import each_row, options, read_rows
from .solutions.full_space import Bell
from .solutions.layered_half_space import Bed, strike_slip_motion

OUT = Path(__file__).with_suffix(".json")
PAGE = Path(__file__).resolve().parents[1] / "docs" / "quality" / "verification.md"
BEGIN, END = "<!-- soil: from verification/soil.json -->", "<!-- end of soil -->"
SIDES = ["west", "east", "south", "north", "bottom"]
BELL, TOP, FREQUENCY = Bell(20.0), 80.0, 60.0  # Hz; where the bell ends; of the mesh
BELOW, AWAY = 18.0, {"near": 60.0, "far": 150.0}  # m
ROCK = {"density_kg_per_m3": 2600.0, "cp_m_per_s": 4300.0, "cs_m_per_s": 2500.0, "qp": 100.0,
        "qs": 50.0, "quality_band_hz": [3.0, 100.0]}  # fmt: skip
# Thickness in m, S speed of the rock over that of the soil, Q.
GROUNDS = {
    f"{height:g} m, contrast {contrast:g}, Q {quality:g}": (height, contrast, quality)
    for height, contrast, quality in (
        (0.1, 10, 20), (0.5, 10, 10), (0.5, 10, 60), (1.0, 10, 20), (1.0, 3, 20), (2.0, 10, 20),
        (2.0, 10, 60), (2.0, 3, 20), (4.0, 10, 20), (4.0, 3, 20), (10.0, 3, 20), (10.0, 10, 20),
    )
}  # fmt: skip


def soil_of(contrast, quality):
    """Return the table of a soil."""
    cs = 2500.0 / contrast
    return {**ROCK, "density_kg_per_m3": 1900.0, "cp_m_per_s": 2.0 * cs, "cs_m_per_s": cs,
            "qp": float(quality), "qs": float(quality)}  # fmt: skip


def project(folder, height, soil):
    """Return the project of a ground; rock alone where the soil is None."""
    times = np.arange(0.0, 2.0 * BELL.peak, 5e-4)
    lines = "".join(f"{t:.4f},{1e9 * v:.9g}\n" for t, v in zip(times, BELL(times), strict=True))
    (Path(folder) / "rate.csv").write_text("time_s,moment_rate_Nm_per_s\n" + lines)
    layers = [{"material": "rock"}]
    if soil is not None:
        layers = [{"material": "soil", "thickness_m": height}, *layers]
    materials = {"rock": ROCK} if soil is None else {"rock": ROCK, "soil": soil}
    far = max(AWAY.values())
    tables = {
        "title": "Soil on rock",
        "mesh": {"origin_m": [-60.0, -60.0, -90.0], "size_m": [far + 120.0, 120.0, 90.0],
                 "frequency_hz": FREQUENCY, "layers": layers},
        "materials": materials,
        "boundaries": {"viscous": SIDES, "free": ["top"]},
        "moment_tensors": [{"position_m": [0.0, 0.0, -height - BELOW], "file": "rate.csv",
                            "tensor": [0.0, 0.0, 0.0, 0.0, 0.0, 1.0]}],
        "receivers": [{"name": name, "position_m": [0.8 * at, 0.6 * at - 40.0, 0.0]}
                      for name, at in AWAY.items()],
        "run": {"duration_s": 0.35},
    }  # fmt: skip
    return Project.from_dict(tables, folder)


def measured(name):
    """Return the row of a ground."""
    height, contrast, quality = GROUNDS[name]
    with tempfile.TemporaryDirectory() as folder:
        bare = summarise_model(project(folder, height, None))
        own = project(folder, height, soil_of(contrast, quality))
        built, run = summarise_model(own), own.simulate()
        beds = [Bed.of(height, own.materials["soil"]), Bed.of(np.inf, own.materials["rock"])]
    row = {
        "periods": round(FREQUENCY * height / own.materials["soil"].cs, 3),
        "elements": built.elements.split(",")[0], "nodes": built.nodes, "steps": built.steps,
        "line_implicit": built.implicit,
        "cost": round(built.nodes * built.steps / (bare.nodes * bare.steps), 2),
        "wall_s": round(run.wall_seconds, 1),
    }  # fmt: skip
    for receiver in own.receivers:
        record = run.seismograms[receiver.name]
        wanted = 1e9 * strike_slip_motion(
            beds, height + BELOW, receiver.position[:2], record.times, BELL, TOP
        )
        peaks = [np.linalg.norm(each, axis=1).max() for each in (record.velocity, wanted)]
        row[receiver.name] = {
            "waveform": round(float(np.linalg.norm(record.velocity - wanted)
                                    / np.linalg.norm(wanted)), 4),
            "peak": round(float(peaks[0] / peaks[1] - 1.0), 4),
        }  # fmt: skip
    return row


def table(rows):
    """Return the lines of the table, errors in per cent."""
    lines = [
        "| ground | f H/cs | nodes × steps over the rock | waveform near, far | peak near, far |",
        "|---|---|---|---|---|",
    ]
    for name in (each for each in GROUNDS if each in rows):
        row = rows[name]
        errors = (
            ", ".join(f"{100 * row[where][what]:.2g}" for where in AWAY)
            for what in ("waveform", "peak")
        )
        lines.append(f"| {name} | {row['periods']} | {row['cost']} | {' | '.join(errors)} |")
    return lines


def main(arguments):
    """Measure rows and write them and the table."""
    arguments, limits = options(arguments)
    names = [a for a in arguments if a != "--page"]
    for name in names:
        if name not in GROUNDS:
            sys.exit(f"soil: no row {name!r}; there are {'; '.join(GROUNDS)}")
    only_page = "--page" in arguments
    rows = read_rows(OUT) if only_page else each_row(OUT, names or GROUNDS, measured, **limits)
    before, rest = PAGE.read_text(encoding="utf-8").split(BEGIN)
    page = f"{before}{BEGIN}\n\n" + "\n".join(table(rows)) + f"\n\n{END}" + rest.split(END)[1]
    write_text(PAGE, page)


if __name__ == "__main__":
    main(sys.argv[1:])
