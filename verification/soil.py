"""Thin soil on rock through project files: cost over the rock alone, error against a closed form.

    python -m verification.soil [GROUND ...] [--page] [--again] [--minutes N]

A horizontal couple stands under the soil; two receivers stand on it, one nearer. Each ground is
run as `pyblast run` meshes it and compared with plane waves of a layered half space, integrated
over wavenumbers, which shares no line with the program. On a slope the half space is tilted with
it; a bench and a trench have no closed form and are compared with a mesh that carries half as much
again. The cost is nodes times steps over those of the same ground of rock. Soil that S waves cross
in more than a period is priced alone. Writes the rows that ``verification/soil.json`` lacks and the
table of docs/quality/verification.md; ``--page``
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
FINER = 1.5  # frequency of the mesh that stands for a closed form
RISE = 0.2  # of the slope, to the east
SLOPE, BENCH, TRENCH = "on a slope of 1 in 5", "on a bench of 10 m", "in a trench of 20 m"
CREST, SIDE = 80.0, [38.0, 58.0]  # m, to the east of the source
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
        Horizontal places of the nearer and the farther receiver beside the source, along a slope.
    where : str
        On what other than level rock.
    """

    height: float
    contrast: float
    quality: float
    below: float = 18.0
    away: tuple[tuple[float, float], ...] = ((48.0, -4.0), (120.0, 50.0))
    where: str = ""

    def __str__(self) -> str:
        """Return its name."""
        far = "" if self.away == Ground.away else ", receivers at {:.0f} and {:.0f} m".format(
            *np.hypot(*np.transpose(self.away))
        )  # fmt: skip
        far += f", {self.where}" if self.where else ""
        return f"{self.height:g} m, contrast {self.contrast:g}, Q {self.quality:g}{far}"

    @property
    def periods(self) -> float:
        """Periods of the highest frequency in which S waves cross the soil."""
        return FREQUENCY * self.height * self.contrast / ROCK["cs_m_per_s"]

    @property
    def axes(self) -> np.ndarray:
        """Directions (3, 3) along the ground, level across it and out of it."""
        tilt = np.arctan(RISE) if self.where == SLOPE else 0.0
        along, out = [np.cos(tilt), 0.0, np.sin(tilt)], [-np.sin(tilt), 0.0, np.cos(tilt)]
        return np.array([along, [0.0, 1.0, 0.0], out])

    @property
    def depth(self) -> float:
        """Thickness in m at right angles to the ground."""
        return self.height * self.axes[2, 2]


GROUNDS = {
    str(ground): ground
    for ground in (
        *(Ground(*each) for each in (
            (0.1, 10, 20), (0.5, 10, 10), (0.5, 10, 60), (1.0, 10, 20), (1.0, 3, 20), (2.0, 10, 20),
            (2.0, 10, 60), (2.0, 3, 20), (4.0, 10, 20), (4.0, 3, 20), (10.0, 3, 20), (10.0, 10, 20),
        )),
        Ground(2.0, 10, 10, away=((80.0, 20.0), (128.0, 55.0))),
        Ground(2.0, 10, 15, below=6.0, away=((280.0, 15.0), (446.0, 55.0))),
        *(Ground(height, 10, 20, where=where) for height, where in (
            (1.0, SLOPE), (2.0, SLOPE), (0.5, BENCH), (0.5, TRENCH),
        )),
    )
}  # fmt: skip


def soil_of(contrast, quality):
    """Return the table of a soil."""
    cs = 2500.0 / contrast
    return {**ROCK, "density_kg_per_m3": 1900.0, "cp_m_per_s": 2.0 * cs, "cs_m_per_s": cs,
            "qp": float(quality), "qs": float(quality)}  # fmt: skip


def project(folder, ground, bare=False, frequency=FREQUENCY):
    """Return the project of a ground, or of the rock alone, whose mesh carries a frequency."""
    times = np.arange(0.0, 2.0 * BELL.peak, 5e-4)
    lines = "".join(f"{t:.4f},{1e9 * v:.9g}\n" for t, v in zip(times, BELL(times), strict=True))
    (Path(folder) / "rate.csv").write_text("time_s,moment_rate_Nm_per_s\n" + lines)
    materials = {"rock": ROCK, "soil": soil_of(ground.contrast, ground.quality)}
    far = 30.0 * np.ceil(np.hypot(*ground.away[1]) / 30.0)
    (along, across, out), depth = ground.axes, ground.depth + ground.below
    places = [a * along + b * across for a, b in ground.away]
    tables = {
        "title": "Soil on rock",
        "mesh": {"origin_m": [-60.0, -60.0, -90.0], "size_m": [far + 120.0, 120.0, 90.0],
                 "frequency_hz": frequency, **ground_of(folder, ground, bare, far)},
        "materials": materials if not bare else {"rock": ROCK},
        "boundaries": {"viscous": SIDES, "free": ["top"]},
        "moment_tensors": [{"position_m": (-depth * out).tolist(), "file": "rate.csv",
                            "tensor": [0.0, 0.0, 0.0, along[2], 0.0, along[0]]}],
        "receivers": [{"name": name, "position_m": at[:2 if ground.where == BENCH else 3].tolist()}
                      for name, at in zip(("near", "far"), places, strict=True)],
        "run": {"duration_s": 0.35},
    }  # fmt: skip
    return Project.from_dict(tables, folder)


def ground_of(folder, ground, bare, far):
    """Return the keys of what lies on the rock, and of its surface."""
    soil, keys = {"material": "soil", "thickness_m": ground.height}, {}
    if ground.where == SLOPE:
        x, y = (each.ravel() for each in np.meshgrid(*(np.linspace(-60.0, far + 60.0, 37),) * 2))
        rows = np.column_stack([x, y, RISE * x])
        np.savetxt(Path(folder) / "top.csv", rows, delimiter=",", header="x_m,y_m,z_m", comments="")
        soil["follows_surface"], keys = True, {"surface_file": "top.csv"}
    if ground.where == BENCH:
        crest = [[CREST, -60.0, 0.0], [CREST, 60.0, 0.0]]
        keys = {"benches": [{"crest_m": crest, "height_m": 10.0, "face_dip_deg": 75.0}]}
    if ground.where == TRENCH and not bare:
        box = [SIDE, [-60.0, 60.0], [-ground.height, 0.0]]
        keys = {"fills": [{"material": "soil", "box_m": box}]}
    over = [] if bare or ground.where == TRENCH else [soil]
    return {**keys, "layers": [*over, {"material": "rock"}]}


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
        wanted = motions(folder, ground, own, run)
    row = {
        "periods": round(ground.periods, 3),
        "elements": built.elements.split(",")[0], "nodes": built.nodes, "steps": built.steps,
        "line_implicit": built.implicit,
        "cost": round(built.nodes * built.steps / (bare.nodes * bare.steps), 2),
        "wall_s": round(run.wall_seconds, 1),
    }  # fmt: skip
    for name, motion in wanted.items():
        velocity = run.seismograms[name].velocity
        peaks = [np.linalg.norm(each, axis=1).max() for each in (velocity, motion)]
        row[name] = {
            "waveform": round(float(np.linalg.norm(velocity - motion)
                                    / np.linalg.norm(motion)), 4),
            "peak": round(float(peaks[0] / peaks[1] - 1.0), 4),
        }  # fmt: skip
    return row


def motions(folder, ground, own, run):
    """Return the motions (n, 3) in m/s at the times of a run, exact or of a finer mesh."""
    records = {receiver.name: run.seismograms[receiver.name] for receiver in own.receivers}
    if ground.where in (BENCH, TRENCH):
        finer = project(folder, ground, frequency=FINER * FREQUENCY).simulate().seismograms
        return {
            name: np.column_stack([np.interp(record.times, finer[name].times, part)
                                   for part in finer[name].velocity.T])
            for name, record in records.items()
        }  # fmt: skip
    beds = [Bed.of(ground.depth, own.materials["soil"]), Bed.of(np.inf, own.materials["rock"])]
    depth = ground.depth + ground.below
    return {
        name: 1e9 * strike_slip_motion(beds, depth, away, record.times, BELL, TOP) @ ground.axes
        for (name, record), away in zip(records.items(), ground.away, strict=True)
    }


def table(rows):
    """Return the lines of the table, errors in per cent."""
    lines = [
        "| ground | f H/cs | nodes × steps over the rock | waveform near, far | peak near, far |",
        "|---|---|---|---|---|",
    ]
    for name in (each for each in GROUNDS if each in rows):
        row = rows[name]
        errors = [f"cost estimated only: {row.get('minutes', 0.0):.2g} min of one processor", "–"]
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
