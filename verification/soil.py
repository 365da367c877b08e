"""Thin soil on rock through project files: cost over the rock alone, error against a closed form.

    python -m verification.soil [GROUND ...] [--page] [--again] [--minutes N]

A horizontal couple stands under the soil; two receivers stand on it, one nearer. Each ground is
run as `pyblast run` meshes it and compared with plane waves of a layered half space, integrated
over wavenumbers, which shares no line with the program. The cost is nodes times steps over those of
the same box of rock. Soil that S waves cross in more than a period is priced alone. Writes the rows
that ``verification/soil.json`` lacks and the table of docs/quality/verification.md; ``--page``
writes the table alone.
"""

import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pyblast.project.checks_ground import summarise_model
from pyblast.project.project import Project

from .rows import study
from .solutions.full_space import Bell
from .solutions.layered_half_space import Bed, strike_slip_motion

OUT = Path(__file__).with_suffix(".json")
PAGE = Path(__file__).resolve().parents[1] / "docs" / "quality" / "verification.md"
BEGIN, END = "<!-- soil: from verification/soil.json -->", "<!-- end of soil -->"
SIDES = ["west", "east", "south", "north", "bottom"]
BELL, TOP, FREQUENCY = Bell(20.0), 80.0, 60.0  # Hz; where the bell ends; of the mesh
ROCK = {"density_kg_per_m3": 2600.0, "cp_m_per_s": 4300.0, "cs_m_per_s": 2500.0, "qp": 100.0,
        "qs": 50.0, "quality_band_hz": [3.0, 100.0]}  # fmt: skip


@dataclass(frozen=True)
class Ground:
    """Soil on rock with a source and two receivers.

    Parameters
    ----------
    height : float, m
    contrast : float
        S speed of the rock over that of the soil.
    quality : float
    below : float, m
        Of the source under the soil.
    away : tuple of 2 (float, float), m
        Horizontal places of the nearer and the farther receiver beside the source.
    """

    height: float
    contrast: float
    quality: float
    below: float = 18.0
    away: tuple[tuple[float, float], ...] = ((48.0, -4.0), (120.0, 50.0))

    def __str__(self) -> str:
        """Return its name."""
        far = "" if self.away == Ground.away else ", receivers at {:.0f} and {:.0f} m".format(
            *np.hypot(*np.transpose(self.away))
        )  # fmt: skip
        return f"{self.height:g} m, contrast {self.contrast:g}, Q {self.quality:g}{far}"

    @property
    def periods(self) -> float:
        """Periods of the highest frequency in which S waves cross the soil."""
        return FREQUENCY * self.height * self.contrast / ROCK["cs_m_per_s"]


GROUNDS = {
    str(ground): ground
    for ground in (
        *(Ground(*each) for each in (
            (0.1, 10, 20), (0.5, 10, 10), (0.5, 10, 60), (1.0, 10, 20), (1.0, 3, 20), (2.0, 10, 20),
            (2.0, 10, 60), (2.0, 3, 20), (4.0, 10, 20), (4.0, 3, 20), (10.0, 3, 20), (10.0, 10, 20),
        )),
        Ground(2.0, 10, 10, away=((80.0, 20.0), (128.0, 55.0))),
        Ground(2.0, 10, 15, below=6.0, away=((280.0, 15.0), (446.0, 55.0))),
    )
}  # fmt: skip


def soil_of(contrast, quality):
    """Return the table of a soil."""
    cs = 2500.0 / contrast
    return {**ROCK, "density_kg_per_m3": 1900.0, "cp_m_per_s": 2.0 * cs, "cs_m_per_s": cs,
            "qp": float(quality), "qs": float(quality)}  # fmt: skip


def project(folder, ground, bare=False):
    """Return the project of a ground, or of the rock alone."""
    times = np.arange(0.0, 2.0 * BELL.peak, 5e-4)
    lines = "".join(f"{t:.4f},{1e9 * v:.9g}\n" for t, v in zip(times, BELL(times), strict=True))
    (Path(folder) / "rate.csv").write_text("time_s,moment_rate_Nm_per_s\n" + lines)
    layers, materials = [{"material": "rock"}], {"rock": ROCK}
    if not bare:
        layers = [{"material": "soil", "thickness_m": ground.height}, *layers]
        materials = {"rock": ROCK, "soil": soil_of(ground.contrast, ground.quality)}
    far = 30.0 * np.ceil(np.hypot(*ground.away[1]) / 30.0)
    tables = {
        "title": "Soil on rock",
        "mesh": {"origin_m": [-60.0, -60.0, -90.0], "size_m": [far + 120.0, 120.0, 90.0],
                 "frequency_hz": FREQUENCY, "layers": layers},
        "materials": materials,
        "boundaries": {"viscous": SIDES, "free": ["top"]},
        "moment_tensors": [{"position_m": [0.0, 0.0, -ground.height - ground.below],
                            "file": "rate.csv", "tensor": [0.0, 0.0, 0.0, 0.0, 0.0, 1.0]}],
        "receivers": [{"name": name, "position_m": [*at, 0.0]}
                      for name, at in zip(("near", "far"), ground.away, strict=True)],
        "run": {"duration_s": 0.35},
    }  # fmt: skip
    return Project.from_dict(tables, folder)


def measured(name):
    """Return the row of a ground."""
    ground = GROUNDS[name]
    with tempfile.TemporaryDirectory() as folder:
        bare, own = (project(folder, ground, each) for each in (True, False))
        if ground.periods > 1.0:
            cost = own.cost.nodes * own.cost.steps / (bare.cost.nodes * bare.cost.steps)
            return {"periods": ground.periods, "cost": round(cost, 1),
                    "minutes": round(own.cost.seconds / 60.0, 1)}  # fmt: skip
        bare, built, run = summarise_model(bare), summarise_model(own), own.simulate()
        beds = [Bed.of(ground.height, own.materials["soil"]),
                Bed.of(np.inf, own.materials["rock"])]  # fmt: skip
    row = {
        "periods": round(ground.periods, 3),
        "elements": built.elements.split(",")[0], "nodes": built.nodes, "steps": built.steps,
        "line_implicit": built.implicit,
        "cost": round(built.nodes * built.steps / (bare.nodes * bare.steps), 2),
        "wall_s": round(run.wall_seconds, 1),
    }  # fmt: skip
    for receiver in own.receivers:
        record = run.seismograms[receiver.name]
        wanted = 1e9 * strike_slip_motion(
            beds, ground.height + ground.below, receiver.position[:2], record.times, BELL, TOP
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
        errors = [f"priced alone: {row.get('minutes', 0.0):.2g} min of one processor", "–"]
        if "near" in row:
            errors = [
                ", ".join(f"{100 * row[where][what]:.2g}" for where in ("near", "far"))
                for what in ("waveform", "peak")
            ]
        lines.append(f"| {name} | {row['periods']} | {row['cost']} | {' | '.join(errors)} |")
    return lines


def main(arguments):
    """Measure rows and write them and the table."""
    study(arguments, GROUNDS, measured, table, OUT, PAGE, (BEGIN, END))


if __name__ == "__main__":
    main(sys.argv[1:])
