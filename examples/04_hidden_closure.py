"""A project whose joint stiffens as it closes, which its file omits: something to diagnose.

    python examples/04_hidden_closure.py hidden
    pyblast diagnose hidden/S1.toml --out found

Writes project files of a single shot and of two blasts, with what six receivers would have
recorded if joint J1 stiffened as it closes. Speeds and stiffnesses also differ from those in the
files, and there is noise: only the records show the difference.
"""

import sys
from pathlib import Path

import numpy as np

from pyblast.diagnosis.effects import Effect, changed_site
from pyblast.mesh.builder import structured_box
from pyblast.mesh.grid import Layer, graded_axis
from pyblast.model.boundary import SpongeLayer, Viscous
from pyblast.model.model import Model, Receiver
from pyblast.model.source import Hole
from pyblast.project.project import Project, load_project, with_further
from pyblast.solver.run import simulate

PLACES = ((20, 70, 0), (80, 20, 0), (100, 60, 0), (110, 30, -20), (95, 85, 0), (35, 10, 0))
BOX = ((0.0, 120.0), (0.0, 90.0), (-60.0, 0.0))  # m, as in the files
JOINT = 60.0
EXPONENT, LOWEST = 0.9, 2.0  # of the charge; Hz, below the band of the files
EDGE, PADDING = 20.0, 400.0  # m, edge of quadratic zones; width of the ground beyond the box
SIDES = ("west", "east", "south", "north", "bottom")
GROWTH = 1.2  # of zones beyond the box
DT, SAMPLES, BEFORE = 0.004, 125, 62
CLOSED = 0.6  # initial closure of the joint, as a share of its largest
ERRORS = (0.02, -0.015, 0.15, -0.1)  # logarithms of factors on cp, cs, kn, ks
NOISE = 0.004  # of the peak of the single shot


BLASTS = {"S1": (1, 10.0), "B1": (3, 40.0), "B2": (5, 120.0)}  # holes and kg in each
GROUND = """title = "hidden closure"
[mesh]
size_m = [120, 90, 60]
origin_m = [0, 0, -60]
edge_m = 8
padding_m = 80
padding_edge_m = 20
layers = [{ material = "rock" }]
[[mesh.faults]]
name = "J1"
dip_deg = 90
dip_direction_deg = 90
through_m = [60, 45, 0]
[materials.rock]
density_kg_per_m3 = 2600
cp_m_per_s = 2800
cs_m_per_s = 1600
[joints.J1]
law = "elastic"
kn_gpa_per_m = 0.8
ks_gpa_per_m = 0.4
insitu_pressure_kpa = 30
[boundaries]
viscous = ["west", "east", "south", "north", "bottom"]
free = ["top"]
[holes_inside]
moment_rate_file = "source.csv"
[run]
duration_s = 0.496
compare_band_hz = [4, 25]
"""
BLAST = """[blast]
file = "{0}_holes.csv"
charge_exponent = 0.9
"""
RECEIVER = """[[receivers]]
name = "{1}"
position_m = {2}
recorded = {{ file = "{0}_{1}.csv" }}
"""


def write_projects(folder: Path) -> Path:
    """Write the project files and what they name, except the records; return the first."""
    folder.mkdir(parents=True, exist_ok=True)
    times = np.arange(0.0, 0.1, 0.002)
    pulse = np.column_stack([times, np.sin(np.pi * times / 0.1) ** 2 * 6e10])
    write_table(folder / "source.csv", "time_s,moment_rate_per_kg_Nm_per_s", pulse)
    for name, (count, charge) in BLASTS.items():
        n = np.arange(count)
        row = [n + 1, 25.0 + 4.0 * n, 30.0 + 6.0 * n, np.full(count, -10.0),
               np.full(count, charge), 0.025 * n]  # fmt: skip
        write_table(folder / f"{name}_holes.csv", "id,x,y,z,charge_kg,delay_s", np.transpose(row))
        text = GROUND + BLAST.format(name)
        text += "".join(RECEIVER.format(name, f"R{k}", list(p)) for k, p in enumerate(PLACES, 1))
        (folder / f"{name}.toml").write_text(text, encoding="utf-8")
    first, *further = (folder / f"{name}.toml" for name in BLASTS)
    names = ", ".join(f'"{path.name}"' for path in further)
    with first.open("a", encoding="utf-8") as file:
        file.write(f"[diagnosis]\nblasts = [{names}]\n")
    return first


def model_of(project: Project, blast: str) -> Model:
    """Return one blast in quadratic zones that a diagnosis does not use."""
    anchors = ((*BOX[0], JOINT), BOX[1], BOX[2])
    axes = [
        graded_axis(limits, stops, EDGE, PADDING, after, GROWTH)
        for limits, stops, after in zip(BOX, anchors, (PADDING, PADDING, 0.0), strict=True)
    ]
    layers = [Layer("rock", None)]
    planes = {"J1": ("x", JOINT)}
    mesh = structured_box(*axes, layers=layers, planes=planes, pattern="centred").split(["J1"])
    own = project.of(blast)
    holes, rate = own.blast, own.inside.moment_rate
    sources = tuple(
        Hole(centre, charge, time, rate, EXPONENT, 0.5 * EDGE)
        for centre, charge, time in zip(holes.centres, holes.charge, holes.times, strict=True)
    )
    return Model(
        mesh, project.materials, joints=project.joints,
        boundaries=tuple(Viscous(side) for side in SIDES),
        sponge=SpongeLayer(BOX, PADDING, LOWEST), sources=sources, receivers=own.receivers,
        quadratic=True,
    )  # fmt: skip


def write_records(folder: Path, project: Project, seed: int):
    """Simulate what the receivers of a project record of its blasts, and write it with noise."""
    rng, motions = np.random.default_rng(seed), {}
    for name in project.blasts:
        done = simulate(model_of(project, name), SAMPLES * DT)
        motions[name] = {
            receiver: one.sampled(0.0, DT, SAMPLES).velocity
            for receiver, one in done.seismograms.items()
        }
    level = NOISE * max(np.abs(v).max() for v in motions["S1"].values())
    times = DT * np.arange(-BEFORE, SAMPLES)
    for name, by_receiver in motions.items():
        for receiver, velocity in by_receiver.items():
            noise = level * np.cumsum(rng.normal(size=(BEFORE + SAMPLES, 3)), axis=0)
            noise -= np.linspace(noise[0], noise[-1], len(noise))
            noise[BEFORE:] += velocity
            head = "time_s,east_m_per_s,north_m_per_s,vertical_m_per_s"
            path = folder / f"{name}_{receiver}.csv"
            write_table(path, head, np.column_stack([times, noise]))


def write_table(path, head, rows):
    """Write rows of numbers under a head."""
    lines = [",".join(f"{value:.9g}" for value in row) for row in rows]
    path.write_text("\n".join([head, *lines]) + "\n", encoding="utf-8")


def main(folder):
    """Write projects and records."""
    first = write_projects(Path(folder))
    reference = with_further(load_project(first))
    places = ((f"R{k}", tuple(map(float, place))) for k, place in enumerate(PLACES, 1))
    reference = reference.changed(receivers=tuple(Receiver(*place) for place in places))
    effect = Effect("joint_nonlinear_closure", "J1", ((CLOSED,),))
    write_records(Path(folder), changed_site(reference, np.array(ERRORS), [effect]), seed=1)
    print(f"written: {folder}; now: pyblast diagnose {first} --out found")


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("name the folder to write to: python examples/04_hidden_closure.py hidden")
    main(sys.argv[1])
