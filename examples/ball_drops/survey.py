"""Survey: block, drops, sensors and records of the ball drops, and what is asked of the block."""

import csv
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from pyblast.config.section import read_time_function
from pyblast.diagnosis.hypotheses import LIBRARY
from pyblast.diagnosis.library.sides import kind_of_side, sides_of, with_joint
from pyblast.model.material import Material
from pyblast.model.model import Receiver
from pyblast.project.project import Project, load_project
from pyblast.project.reciprocity import responses
from pyblast.recordings.recording import read_recording

HERE = Path(__file__).parent
LSB = 10.0 / 2**15  # V, step of the digitizer
DT = 5e-7  # s
DURATION = 2.8e-4  # s
BEFORE = 6e-5  # s of record before the impact
STEP = 3e-3  # m, by which drops are moved for derivatives
STIFFNESSES = 0.05, 0.15, 0.4, 1.0, 2.5, 6.0, 15.0
CRACK = 0.5  # of the depth of the rock, of a level crack that nobody lists


@dataclass(frozen=True, eq=False)
class Survey:
    """Survey of the drops.

    Parameters
    ----------
    drops, sensors : tuple of str
        Of each record.
    positions : (n, 3) float64, m
        Of the sensor of each record.
    normals : (n,) float64
        Of its face, along y.
    shots : (n, 3) float64, m
        Of its drop.
    impacts : (n,) float64, s
        In its record.
    samples : (n, n_samples) float64, V
        From `BEFORE` before the impact, at intervals of `DT`.
    """

    drops: tuple[str, ...]
    sensors: tuple[str, ...]
    positions: np.ndarray
    normals: np.ndarray
    shots: np.ndarray
    samples: np.ndarray

    @property
    def distances(self) -> np.ndarray:
        """Distance of drop and sensor of each record, m."""
        return np.linalg.norm(self.positions - self.shots, axis=1)


def rows(name: str) -> list[dict[str, str]]:
    """Return the rows of a table beside this file."""
    with (HERE / name).open(newline="") as file:
        return list(csv.DictReader(file))


def read_survey() -> Survey:
    """Read drops, sensors and records."""
    sensors, parts = {row["sensor"]: row for row in rows("sensors.csv")}, []
    wanted = DT * np.arange(int((BEFORE + DURATION) / DT))
    for drop in rows("drops.csv"):
        shot = float(drop["x_m"]), float(drop["y_m"]), 0.0
        path = HERE / "records" / f"drop_{drop['drop']}.mseed"
        for recording in read_recording(path, unit="counts"):
            seismogram = recording.seismogram
            name = seismogram.label.split()[0].rpartition(".")[2]
            row = sensors[name]
            (column,) = np.flatnonzero(np.isfinite(seismogram.velocity).any(axis=0))
            volts = LSB * seismogram.velocity[:, column]
            times = seismogram.dt * np.arange(len(volts))
            volts -= volts[times < 6e-5].mean()
            at = float(drop["impact_time_s"]) - BEFORE + wanted
            place = float(row["x_m"]), float(row["y_m"]), -float(row["z_m"])
            parts.append((drop["drop"], name, place, float(row["normal_y"]), shot,
                          decimated(volts, seismogram.dt, at)))  # fmt: skip
    drops, names, *arrays = zip(*parts, strict=True)
    return Survey(drops, names, *map(np.array, arrays))


def decimated(samples: np.ndarray, dt: float, times: np.ndarray) -> np.ndarray:
    """Return samples at other times, without what is faster than a quarter of their rate."""
    spectrum = np.fft.rfft(samples, 4 * len(samples))
    frequency = np.fft.rfftfreq(4 * len(samples), dt)
    spectrum *= np.exp(-((frequency * 3.0 * DT) ** 8))
    smooth = np.fft.irfft(spectrum)[: len(samples)]
    return np.interp(times, dt * np.arange(len(samples)), smooth)


FORCE = read_time_function(HERE / "source_force.csv", "force")


def with_speeds(project: Project, s_over_p: float) -> Project:
    """Return the project with another S speed of the rock, at the same P speed."""
    rock = project.materials["rock"]
    other = Material.from_speeds(rock.density, rock.cp, s_over_p * rock.cs)
    return project.changed(materials={**project.materials, "rock": other})


def members(reference: Project) -> dict[str, tuple[str, Project]]:
    """Return what may surround the block: class and project by name; the reference comes first."""
    known = {"reference": ("reference", reference)}
    for side in sides_of(reference):
        if side in ("south", "north"):
            continue  # sensors stand on both walls, so they are asked below
        for kind in ("free", "roller", "fixed", "viscous"):
            if not (side == "bottom" and kind_of_side(reference, side) == kind):
                project = LIBRARY[f"side/{kind}"].apply(reference, side)
                known[f"{side}: {kind}"] = f"{side}: {kind}", project
        if side.startswith("under"):
            for value in STIFFNESSES:
                project = with_joint(reference, side, value, 2.0)
                known[f"{side}: joint {value:g}"] = f"{side}: joint", project
    walls = LIBRARY["side/viscous"].apply(reference, "south")
    walls = LIBRARY["side/viscous"].apply(walls, "north")
    known["south and north: viscous"] = "south and north: viscous", walls
    known["crack"] = "crack", with_crack(reference, CRACK)
    return known


def with_crack(project: Project, share: float) -> Project:
    """Return the project with a level crack at a share of the depth of the rock."""
    layers = project.config.mesh.layers
    depth = layers[0].thickness_m
    halves = [layers[0].model_copy(update={"thickness_m": part * depth})
              for part in (share, 1.0 - share)]  # fmt: skip
    upper = halves[0].model_copy(update={"material": "upper rock"})
    mesh = project.config.mesh.model_copy(update={"layers": [upper, halves[1], *layers[1:]]})
    materials = {**project.materials, "upper rock": project.materials["rock"]}
    parted = project.changed(mesh=mesh, materials=materials)
    return with_joint(parted, "under upper rock", 1.0, 2.0)


def motions(survey: Survey, project: Project, folder, executor=None, place=None):
    """Return the responses at the drops, and at drops moved along x and y, by as few runs.

    Sensors may stand at other positions than those of the table.
    """
    n = len(survey.drops)
    receivers = [
        Receiver(name, tuple(position), normal=(0.0, normal, 0.0))
        for name, position, normal in zip(
            survey.sensors, survey.positions if place is None else place, survey.normals,
            strict=True)
    ]  # fmt: skip
    moved = [survey.shots + STEP * np.eye(3)[axis] for axis in (0, 1)]
    inside = np.concatenate([survey.shots, *moved])
    every = responses(
        project, receivers * 3, inside, (0.0, 0.0, -1.0), duration=DURATION, dt=DT,
        folder=folder, executor=executor,
    )  # fmt: skip
    return [replace(every, velocity=every.velocity[k * n : (k + 1) * n]) for k in range(3)]


def reference_project() -> Project:
    """Return the block as the published simulation describes it."""
    return load_project(HERE / "block.toml")
