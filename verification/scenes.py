"""Scenes with exact motion, each turned: the error of a run, the error that it says, and findings.

    python -m verification.scenes [NAME ...] [--page] [--again] [--minutes N]

Thirty scenes through project files: explosions, forces, couples and a column's moment in unbounded
rock, with and without Q, beside a joint, below a free surface, in and on layers. The solutions
share no code with the package. Each scene is turned about z by 0, 30 and 90 degrees and mirrored:
source, plane and receivers, in the same box. A row holds, by receiver, the error of the whole
record over the motion, the error that `Project.accuracy` expects, and whether one above three
times the accuracy asked for is said (finding D46). Writes the rows that
``verification/scenes.json`` lacks and the table of docs/quality/verification.md; ``--page`` writes
the table alone.
"""

import sys
import tempfile
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import numpy as np

from pyblast.model.material import ConstantQ, Material
from pyblast.project.project import Project
from pyblast.simulation.accuracy import FOUND

from .rows import study
from .solutions import lamb, lossy_full_space
from .solutions.buried_explosion import surface_motion
from .solutions.full_space import Bell, moment, point_force
from .solutions.layered_half_space import Bed, strike_slip_motion

OUT = Path(__file__).with_suffix(".json")
PAGE = Path(__file__).resolve().parents[1] / "docs" / "quality" / "verification.md"
BEGIN, END = "<!-- scenes: from verification/scenes.json -->", "<!-- end of scenes -->"
BELL, TOP = Bell(12.0), 60.0  # Hz; where the bell has nothing more to give
SPEEDS = {"rock": (2600.0, 4000.0, 2300.0), "soil": (2100.0, 2000.0, 1000.0)}
TURNS = {"0": 0.0, "30": np.radians(30.0), "90": np.radians(90.0), "mirrored": 0.0}
RAYS = np.array([[0.8, 0.6, 0.0], [0.48, -0.64, 0.6], [-0.6, 0.48, -0.64]])
EXPLOSION, COLUMN = np.eye(3), np.diag([1.0, 1.0, 0.5])
COUPLE = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
FORCE = np.array([0.0, 0.6, 0.8])
UP = np.array([0.0, 0.0, 1.0])
STIFF = (1.5e9, 0.8e9)  # Pa/m, normal and shear
BAND = (1.0, 100.0)  # Hz, of constant Q
FREQUENCY = 40.0


@dataclass(frozen=True, eq=False)
class Scene:
    """A scene; lengths in m from its source, z up.

    Parameters
    ----------
    source : (3,) or (3, 3) float
        Direction of a force, or a moment tensor.
    away : (n, 3) float
        Receivers.
    below : float or None
        Depth of the source below a free surface; None in unbounded rock.
    quality : tuple of 2 float
        Qp and Qs, of each ground that states none itself.
    tilt : float or None, degrees
        Dip of a joint 40 m from the source; None without one. Couples are tilted with it.
    soil : float
        Thickness of a layer of soil.
    mesh : dict
        Keys of the mesh.
    grounds : dict of str to tuple of 3 or 5 float
        Density, speeds of P and S waves, and Qp and Qs, by name.
    scale : float
        Of margins and times, one over that of frequencies.
    band : tuple of 2 float, Hz
        Of constant Q.
    """

    source: np.ndarray
    away: np.ndarray
    below: float | None = None
    quality: tuple = ()
    tilt: float | None = None
    soil: float = 0.0
    mesh: dict = field(default_factory=lambda: {"frequency_hz": FREQUENCY})
    grounds: dict = field(default_factory=lambda: SPEEDS)
    scale: float = 1.0
    band: tuple = BAND

    @property
    def bell(self):
        """The history of the source."""
        return Bell(BELL.dominant / self.scale)

    def material(self, name):
        """Return a ground of the scene; one of constant Q has the law of its mechanisms."""
        quality = self.quality_of(name)
        law = {"law": ConstantQ(*quality, self.band)} if quality else {}
        return Material.from_speeds(*self.grounds[name][:3], **law)

    def quality_of(self, name):
        """Return Qp and Qs of a ground, or nothing."""
        return self.grounds[name][3:] or self.quality


def at(*distances):
    """Return receivers at distances in m along some rays."""
    return np.array([r * RAYS[n % 3] for n, r in enumerate(distances)])


def on(depth, *distances):
    """Return receivers on the surface above a source, at distances in m along it."""
    return np.array([[*(r * RAYS[0, :2]), depth] for r in distances])


def lossy(q, **mesh):
    """Return the keys of a scene with Qs q and twice as much for P waves."""
    return {"quality": (2.0 * q, q), "mesh": {"frequency_hz": FREQUENCY, **mesh}}


BESIDE = np.array([[60.0, 30.0, 75.0], [80.0, -50.0, 90.0], [70.0, 40.0, -30.0]])
NEAR, FAR, LONG = at(5, 10, 20, 30), at(60, 110, 160), np.array([[980.0, 0.0, 0.0], [490.0, 8, 0]])
SCENES = {
    "explosion": Scene(EXPLOSION, FAR),
    "explosion, near": Scene(EXPLOSION, NEAR),
    "force": Scene(FORCE, FAR),
    "force, near": Scene(FORCE, NEAR),
    "couple": Scene(COUPLE, FAR),
    "couple, near": Scene(COUPLE, NEAR),
    "column": Scene(COLUMN, FAR),
    "column, near": Scene(COLUMN, NEAR),
    "force, mesh for 20 Hz": Scene(FORCE, FAR, mesh={"frequency_hz": 20.0}),
    "explosion, mesh for 20 Hz": Scene(EXPLOSION, FAR, mesh={"frequency_hz": 20.0}),
    "force, no frequency": Scene(FORCE, FAR, mesh={}),
    "force, 5 % asked": Scene(FORCE, FAR, mesh={"frequency_hz": FREQUENCY, "accuracy": 0.05}),
    "force, tetrahedra": Scene(
        FORCE, FAR, mesh={"frequency_hz": 30.0, "kind": "tetrahedra", "quadratic": True}
    ),
    "explosion, Qs 20": Scene(EXPLOSION, FAR, **lossy(20.0)),
    "force, Qs 50": Scene(FORCE, FAR, **lossy(50.0)),
    "force, Qs 20, ten wavelengths": Scene(UP, LONG, **lossy(20.0)),
    "explosion, 8 m deep": Scene(EXPLOSION, on(8, 10, 30, 90, 150), 8.0),
    "explosion, 20 m deep": Scene(EXPLOSION, on(20, 10, 30, 90, 150), 20.0),
    "explosion, 3 m deep": Scene(EXPLOSION, on(3, 10, 30, 90, 150), 3.0),
    "couple, 20 m deep": Scene(COUPLE, on(20, 30, 90, 150), 20.0),
    "couple, 60 m deep": Scene(COUPLE, on(60, 30, 90, 150), 60.0),
    "force on the surface": Scene(UP, on(0, 50, 100, 160), 0.0),
    "force on the surface, no frequency": Scene(UP, on(0, 50, 100, 160), 0.0, mesh={}),
    "couple below soil": Scene(COUPLE, on(60, 30, 90, 150), 60.0, soil=30.0),
    "couple on the boundary of soil": Scene(COUPLE, on(30, 60, 100, 150), 30.0, soil=30.0),
    "couple below soil, Qs 20": Scene(COUPLE, on(60, 30, 90, 150), 60.0, soil=30.0, **lossy(20.0)),
    "couple beside a level joint": Scene(COUPLE, BESIDE, tilt=0.0),
    "couple beside a joint that dips 90°": Scene(COUPLE, BESIDE, tilt=90.0),
    "couple beside a joint that dips 60°": Scene(COUPLE, BESIDE, tilt=60.0),
    "couple beside a joint that dips 30°": Scene(COUPLE, BESIDE, tilt=30.0),
}  # fmt: skip
LAYER, HALF_SPACE = (2600.0, 4000.0, 2000.0), (2700.0, 6000.0, 3464.0)
LOSSY = {"soil": (*LAYER, 120.0, 40.0), "rock": (*HALF_SPACE, 155.9, 69.3)}
LOH = {
    "away": np.array([[3e3, 4e3, 2e3], [6e3, 8e3, 2e3]]), "below": 2e3, "soil": 1e3, "scale": 20.0,
    "mesh": {"frequency_hz": 2.0},
}  # fmt: skip
STANDARD = {
    "force on the surface, over 1 km": Scene(UP, on(0, 500, 1000), 0.0),
    "LOH.1": Scene(COUPLE, grounds={"soil": LAYER, "rock": HALF_SPACE}, **LOH),
    "LOH.3": Scene(COUPLE, grounds=LOSSY, band=(0.25, 25.0), **LOH),
}  # not turned: of `verification.doors`
ALL = SCENES | STANDARD
NAMES = [f"{scene}, {turn}" for scene in SCENES for turn in TURNS]
KNOWN: set[str] = set()  # scenes with an error that no run says yet
JOINT = 40.0  # m above the source, before it is tilted


@cache
def exact(name, count, dt):
    """Return the velocity (n_receivers, count, 3) of a scene that is neither tilted nor turned."""
    scene, times = ALL[name], dt * np.arange(count)
    bell, top = scene.bell, TOP / scene.scale
    solid, rock = scene.material("rock"), Material.from_speeds(*scene.grounds["rock"][:3])
    if scene.below is None and scene.tilt is None:
        if scene.quality:
            quality = (*scene.quality, float(np.sqrt(scene.band[0] * scene.band[1])))
            return [lossy_full_space.motion(times, each, scene.source, bell, rock, quality)
                    for each in scene.away]  # fmt: skip
        closed = moment if np.ndim(scene.source) == 2 else point_force
        return [closed(times, each, scene.source, bell, rock) for each in scene.away]
    flat = np.hypot(scene.away[:, 0], scene.away[:, 1])
    if scene.below is not None and scene.source is not COUPLE:
        if scene.below == 0.0:
            motion = lamb.surface_motion(times, flat, bell, rock, top)
        else:
            motion = surface_motion(bell, 75.0, scene.below, flat, times, rock)
        rays = scene.away[:, :2] / flat[:, None]
        return [np.column_stack([each[:, :1] * ray, each[:, 1]])
                for each, ray in zip(motion, rays, strict=True)]  # fmt: skip
    if scene.tilt is None:
        beds = [Bed.of(np.inf, solid)]
        if scene.soil:
            beds = [Bed.of(scene.soil, scene.material("soil")), *beds]
        return [strike_slip_motion(beds, scene.below, each[:2], times, bell, top)
                for each in scene.away]  # fmt: skip
    depth, beds = 300.0, [Bed.of(600.0, solid), Bed.of(np.inf, solid)]
    return [
        strike_slip_motion(beds, depth, each[:2], times, bell, top, depth - each[2], False,
                           (depth - JOINT, *STIFF))
        for each in scene.away
    ]  # fmt: skip


def turning(scene, turn):
    """Return the matrix (3, 3) that turns a scene: its tilt about y, then about z or mirrored."""
    dip = np.radians(scene.tilt or 0.0)
    tilt = np.array([[np.cos(dip), 0, np.sin(dip)], [0, 1, 0], [-np.sin(dip), 0, np.cos(dip)]])
    angle = TURNS[turn]
    about = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0],
                      [0, 0, 1]])  # fmt: skip
    if turn == "mirrored":
        about = np.diag([1.0, -1.0, 1.0])
    return about @ tilt


def keys_of(scene, name):
    """Return the table of a ground of a scene."""
    keys = "density_kg_per_m3", "cp_m_per_s", "cs_m_per_s", "qp", "qs"
    values = (*scene.grounds[name][:3], *(quality := scene.quality_of(name)))
    band = {"quality_band_hz": [*scene.band]} if quality else {}
    return dict(zip(keys, values, strict=False)) | band


def tables(scene, matrix):
    """Return the tables of the project file of a turned scene, around its source."""
    away = scene.away @ matrix.T
    margin = 60.0 * scene.scale
    low = np.minimum(away.min(axis=0), 0.0) - margin
    high = np.maximum(away.max(axis=0), 0.0) + margin
    layers = [{"material": "rock"}]
    sides = ["west", "east", "south", "north", "bottom", "top"]
    if scene.below is not None:
        high[2], sides = scene.below, sides[:-1]
        low[2] = min(low[2], -margin, scene.below - 160.0 * scene.scale)
    if scene.soil:
        layers = [{"material": "soil", "thickness_m": scene.soil}, *layers]
    longest = float(np.linalg.norm(scene.away, axis=1).max())
    parts = {
        "title": "Scene",
        "mesh": {"origin_m": low.tolist(), "size_m": (high - low).tolist(), "layers": layers,
                 **scene.mesh},
        "materials": {
            part["material"]: keys_of(scene, part["material"])
            for part in layers
        },
        "boundaries": {"viscous": sides, **({} if scene.below is None else {"free": ["top"]})},
        "receivers": [{"name": f"{n}", "position_m": p} for n, p in enumerate(away.tolist())],
        "run": {"duration_s": round(
            scene.scale * (0.2 + 0.1 * (scene.soil > 0.0))
            + 1.2 * longest / scene.grounds["rock"][2], 3)},
    }  # fmt: skip
    if scene.source.ndim == 1:
        parts["point_forces"] = [{"position_m": [0.0] * 3, "file": "rate.csv",
                                  "direction": (matrix @ scene.source).tolist()}]  # fmt: skip
    else:
        m = matrix @ scene.source @ matrix.T
        six = [m[0, 0], m[1, 1], m[2, 2], m[1, 2], m[2, 0], m[0, 1]]
        parts["moment_tensors"] = [{"position_m": [0.0] * 3, "tensor": [float(v) for v in six],
                                    "file": "rate.csv"}]  # fmt: skip
    if scene.tilt is not None:
        normal = matrix @ UP
        normal = normal if normal[2] >= 0.0 else -normal
        bearing = float(np.degrees(np.arctan2(normal[0], normal[1]))) % 360.0
        parts["mesh"]["faults"] = [{
            "name": "joint", "dip_deg": float(scene.tilt), "dip_direction_deg": bearing,
            "through_m": (JOINT * matrix @ UP).tolist(),
        }]  # fmt: skip
        parts["joints"] = {"joint": {"law": "elastic", "kn_gpa_per_m": STIFF[0] / 1e9,
                                     "ks_gpa_per_m": STIFF[1] / 1e9}}  # fmt: skip
    return parts


def project(name, turn, folder, **mesh):
    """Return the project of a scene and turn, its files in a folder; keys of the mesh replace."""
    scene = ALL[name]
    values, dt = scene.bell.samples()
    title = "force_n" if scene.source.ndim == 1 else "moment_rate_Nm_per_s"
    lines = [title, *(f"{n * dt:.9g},{1e9 * value:.9g}" for n, value in enumerate(values))]
    (Path(folder) / "rate.csv").write_text("time_s," + "\n".join(lines) + "\n")
    parts = tables(scene, turning(scene, turn))
    return Project.from_dict(parts | {"mesh": parts["mesh"] | mesh}, folder)


def compared(project, name, turn):
    """Run the project of a scene; return errors, expected errors and causes by receiver."""
    run, matrix = project.simulate(), turning(ALL[name], turn)
    wanted = exact(name, 4000, round(0.25 * project.duration, 3) / 1000.0)
    rows = {row.name: row for row in project.accuracy.rows}
    times = round(0.25 * project.duration, 3) / 1000.0 * np.arange(4000)
    receivers, asked = {}, project.config.mesh.accuracy
    for number, motion in enumerate(wanted):
        record, row = run.seismograms[f"{number}"], rows[f"{number}"]
        own = 1e9 * np.column_stack([np.interp(record.times, times, each) for each in motion.T])
        own = own @ matrix.T
        error = float(np.linalg.norm(record.velocity - own) / np.linalg.norm(own))
        peaks = [np.linalg.norm(each, axis=1).max() for each in (record.velocity, own)]
        receivers[f"{number}"] = {
            "error": round(error, 4), "expected": round(row.waveform, 4), "cause": row.cause,
            "peak_error": round(float(peaks[0] / peaks[1] - 1.0), 4),
            "expected_peak": round(row.peak, 4),
            "said": bool(row.waveform > FOUND * asked),
        }  # fmt: skip
    return receivers, run


def measured(name):
    """Return the row of a scene and turn: errors, expected errors and causes by receiver."""
    scene, turn = name.rsplit(", ", 1)
    own = project(scene, turn, tempfile.mkdtemp())
    receivers, run = compared(own, scene, turn)
    every, asked = receivers.values(), own.config.mesh.accuracy
    return {
        "receivers": receivers, "asked": asked, "elements": own.meshed.reason.split(",")[0],
        "error": max(each["error"] for each in every),
        "expected": max(each["expected"] for each in every),
        "silent": sum(each["error"] > FOUND * asked and not each["said"] for each in every),
        "wall_s": round(run.wall_seconds, 1),
    }  # fmt: skip


def table(rows):
    """Return the lines of the table: worst errors of each scene over its turns, in per cent."""
    lines = [
        "| scene | error at 0°, 30°, 90°, mirrored | expected | silent beyond 3 × |",
        "|---|---|---|---|",
    ]
    for scene in SCENES:
        own = [rows.get(f"{scene}, {turn}") for turn in TURNS]
        if not any(own):
            continue
        errors = ", ".join("–" if row is None else f"{100 * row['error']:.2g}" for row in own)
        expected = max(row["expected"] for row in own if row)
        silent = sum(row["silent"] for row in own if row)
        lines.append(f"| {scene} | {errors} | {100 * expected:.2g} | {silent or ''} |")
    return lines


def main(arguments):
    """Measure rows and write them and the table."""
    study(arguments, NAMES, measured, table, OUT, PAGE, (BEGIN, END))


if __name__ == "__main__":
    main(sys.argv[1:])
