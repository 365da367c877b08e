"""Waves at a bench that is cut out of the blocks. Case L22."""

import numpy as np

from pyblast.mesh.builder import Fault, Layer, build_mesh
from pyblast.mesh.faces import face_vectors
from pyblast.model.boundary import Fixed
from pyblast.model.material import Material
from pyblast.model.model import Model, Receiver
from pyblast.model.terrain import Bench, bench_triangles
from verification.columns import started
from verification.solutions.wedge import bench_motion
from verification.suite import Curve, Reading, case

ROCK = Material.from_speeds(2500.0, 3400.0, 2000.0)
HEIGHT, BEHIND, BEFORE, DEPTH = 100.0, 150.0, 150.0, 230.0
START, WIDTH = -120.0, 40.0
DIP = np.radians(60.0)


@case(
    "L22",
    "Upright bench under vertical SH waves",
    source="Sommerfeld's wedge: 4/3 of the incident wave at the toe, twice the toe's wave at the "
    "crest (Sanchez-Sesma 1985)",
    gate="C",
    tolerance={
        "motion of the toe": 0.03,
        "motion of the crest": 0.03,
        "amplification at the crest": 0.02,
        "volume": 1e-6,
        "worst facet of a fault of 60 degrees": 0.5,
    },
    meshes=(8.0, 12.0, 18.0),
    unit="edges per height of the bench",
    order=1.5,
    ordered=("motion of the crest",),
    note="A Gaussian pulse of displacement, 40 m long at 1/e, rises to a face of 100 m. Motion: "
    "L2 norm of the difference of velocities, until the reflection from the top; "
    "amplification: largest velocity over that of the incident wave. The facets of the fault are "
    "those of a second mesh, in degrees.",
)
def upright_bench(n):
    """Send a pulse up to a bench in a slab and compare toe and crest with the wedge."""
    edge = HEIGHT / n
    box = [(-BEHIND, BEFORE), (0.0, edge), (-DEPTH, HEIGHT)]
    crest = np.array([[0.0, 0.0, HEIGHT], [0.0, edge, HEIGHT]])
    surface = bench_triangles([Bench(crest, crest * [1.0, 1.0, 0.0])], box)
    mesh = build_mesh(box, [Layer("rock")], edge=edge, surface=surface)
    held = [Fixed(side, ("east", "vertical")) for side in ("south", "north")]
    receivers = [
        Receiver("toe", (0.0, 0.5 * edge, 0.0)),
        Receiver("crest", (0.0, 0.5 * edge, HEIGHT)),
    ]
    model = Model(mesh, {"rock": ROCK}, boundaries=held, receivers=receivers)
    speed, z = ROCK.cs, model.mesh.points[:, 2]

    def pulse(phase):
        """Return displacement and velocity of the pulse at a distance from its middle."""
        shape = np.exp(-((phase / WIDTH) ** 2))
        return shape, 2.0 * speed * phase / WIDTH**2 * shape

    duration = (HEIGHT - START + HEIGHT) / speed
    still = np.zeros((len(z), 3))
    displacement, velocity = still.copy(), still.copy()
    displacement[:, 1] = pulse(z - START)[0]
    velocity[:, 1] = pulse(z - START)[1]
    run = started(model, duration, displacement, velocity)
    curves, readings = [], []
    for row, name in enumerate(("toe", "crest")):
        motion = run.seismograms[name]
        incident = pulse(-START - speed * motion.times)[1]
        expected = bench_motion(motion.times, incident, HEIGHT, speed)[row]
        window = motion.times < ((row + 1) * HEIGHT - START) / speed
        measured = motion.velocity[:, 1]
        readings.append(Reading.norm(f"motion of the {name}", expected[window], measured[window]))
        scale = np.abs(incident).max()
        curves.append(
            Curve(name, 1e3 * motion.times[window], expected[window] / scale,
                  measured[window] / scale, "time, ms", "velocity over incident peak")
        )  # fmt: skip
        if name == "crest":
            readings.append(
                Reading.relative("amplification at the crest",
                                 np.abs(expected[window]).max() / scale,
                                 np.abs(measured[window]).max() / scale)
            )  # fmt: skip
    volume = edge * (DEPTH * (BEHIND + BEFORE) + HEIGHT * BEHIND)
    readings.append(Reading.relative("volume", volume, mesh_volume(mesh)))
    return [*readings, _plane_of_fault(n)], curves


def mesh_volume(mesh):
    """Return the volume of a mesh of tetrahedra, m3."""
    corners = mesh.points[mesh.zones]
    return np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1])).sum() / 6.0


def _plane_of_fault(n):
    """Return by how many degrees a fault leans that leaves the ground through two faces."""
    box = [(-60.0, 60.0), (0.0, 40.0), (-40.0, 30.0)]
    crests = [np.array([[x, 0.0, z], [x, 40.0, z]]) for x, z in ((-10.0, 30.0), (15.0, 15.0))]
    benches = [Bench(crest, crest - [-3.0, 0.0, 15.0]) for crest in crests]
    fault = Fault("F", DIP, np.radians(70.0), (0.0, 20.0, 8.0))
    mesh = build_mesh(
        box, [Layer("rock")], [], [fault], edge=80.0 / n, surface=bench_triangles(benches, box)
    )
    areas, normal = face_vectors(mesh.points, mesh.surfaces["F"]), fault.unit_normal
    across = np.linalg.norm(np.cross(areas, normal), axis=1)
    worst = float(np.degrees(np.arctan2(across, np.abs(areas @ normal)).max()))
    return Reading.absolute("worst facet of a fault of 60 degrees", 0.0, worst)
