"""Case 9: a line explosion beside a plane without friction, in a slab one zone thick."""

import numpy as np

from pyblast.mesh.builder import structured_box
from pyblast.model.boundary import Fixed, Viscous
from pyblast.model.joint import Joint
from pyblast.model.material import Material
from pyblast.model.model import Model, Receiver
from pyblast.model.source import Hole, TimeFunction
from pyblast.solver.run import simulate
from verification.solutions.full_space import Bell
from verification.solutions.slipping_plane import slip
from verification.suite import Curve, Reading, case

ROCK = Material.from_speeds(2500.0, 2000.0 * np.sqrt(3.0), 2000.0)
FREQUENCY, DURATION = 20.0, 0.26
WAVELENGTH = ROCK.cs / FREQUENCY
HEIGHT = 0.5 * WAVELENGTH  # of the source over the plane
PLACES = (0.5, 1.0, 2.0)  # wavelengths along the plane
MOMENT = 1e8  # N m/m
STIFFNESS = 20.0  # of the joint, in shear moduli over the edge
WEST, EAST, AWAY = 4.5, 6.5, 4.5  # wavelengths of ground


def explosion_beside(n):
    """Return the seismograms beside the plane on a mesh of ``n`` edges per S wavelength."""
    edge = WAVELENGTH / n
    x = edge * np.arange(-round(WEST * n), round(EAST * n) + 1)
    z = edge * np.arange(-round(AWAY * n), round(AWAY * n) + 1)
    mesh = structured_box(
        x, np.array([0.0, edge]), z, planes={"plane": ("z", 0.0)}, pattern="alternating"
    )
    stiffness = STIFFNESS * ROCK.shear / edge
    law = {"kn": stiffness, "ks": stiffness, "cohesion": 0.0, "friction": 0.0, "tension": 0.0}
    values, dt = Bell(FREQUENCY).samples()
    rate = TimeFunction(MOMENT * np.gradient(values, dt), dt)
    sides = {"near": 1e-6 * edge, "far": -1e-6 * edge}
    model = Model(
        mesh.split(["plane"]),
        {"rock": ROCK},
        joints=[Joint("plane", "coulomb", law, insitu_pressure=1e8)],
        boundaries=[
            *(Fixed(side, ("north",)) for side in ("south", "north")),
            *map(Viscous, ("west", "east", "bottom", "top")),
        ],
        sources=[Hole(np.array([0.0, 0.5 * edge, HEIGHT]), edge, 0.0, rate)],
        receivers=[
            Receiver(f"{side} {r:g}", (r * WAVELENGTH, 0.5 * edge, away))
            for side, away in sides.items()
            for r in PLACES
        ],
    )
    return simulate(model, DURATION).seismograms


@case(
    "9",
    "Line explosion beside a frictionless plane",
    source="Cagniard's method, set-up of Day (1985)",
    gate="E",
    tolerance={f"slip, {r:g} wavelengths": 0.055 for r in PLACES},
    meshes=(10.0, 15.0, 22.5),
    unit="edges per S wavelength",
    order=0.9,
    quick=True,
    note="L2 norm of the difference over that of the slip. Two wavelengths along the plane need "
    "22.5 edges (the mesh slows waves along the plane), one needs 15, half a wavelength 10. "
    "Coulomb law without friction or cohesion under 100 MPa: no shear is carried and ks has "
    "no effect; kn of 20 shear moduli over the edge transmits normal motion, 2 to 80 change "
    "the error by a twelfth. The source sphere, of one edge, is cut off at both sides, half "
    "an edge away",
)
def slipping_plane(n):
    """Compare the slip of the plane along it."""
    records = explosion_beside(n)
    readings, curves = [], []
    for r in PLACES:
        near, far = (records[f"{side} {r:g}"] for side in ("near", "far"))
        found = np.cumsum(near.velocity[:, 0] - far.velocity[:, 0]) * near.dt
        times = near.times + 0.5 * near.dt
        pulse = Bell(FREQUENCY)
        wanted = MOMENT * slip(times, r * WAVELENGTH, HEIGHT, pulse, ROCK)
        name = f"slip, {r:g} wavelengths"
        readings.append(Reading.norm(name, wanted, found))
        curves.append(Curve(name, times, wanted, found, "time [s]", "slip [m]"))
    return readings, curves
