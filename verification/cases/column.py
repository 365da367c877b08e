"""Check L4: what a detonating column sends into its far field, by the forces on its mesh."""

import numpy as np

from pyblast.mesh.builder import structured_box
from pyblast.model.material import Material
from pyblast.model.model import Model
from pyblast.model.source import Column, TimeFunction
from pyblast.solver.loads import model_loads
from pyblast.solver.moment_density import response
from verification.solutions.column import far_field, radiation
from verification.suite import Curve, Reading, case

ROCK = Material.from_speeds(2500.0, 4000.0, 2309.4)
LENGTH, DETONATION = 12.0, 4500.0  # m, m/s
FREQUENCY = ROCK.cs / LENGTH  # an S wave as long as the column
ANGLES = np.radians(np.arange(0.0, 181.0, 5.0))
AZIMUTHS = np.radians(np.array([10.0, 100.0, 250.0]))
WAY = np.array([2.0, 1.0, 2.0]) / 3.0  # of detonation


def around(azimuth):
    """Return the rays (n, 3) at `ANGLES` from the way, at one azimuth, and the turn across them."""
    first = np.cross(WAY, [0.0, 0.0, 1.0])
    first /= np.linalg.norm(first)
    side = np.cos(azimuth) * first + np.sin(azimuth) * np.cross(WAY, first)
    cosine, sine = np.cos(ANGLES)[:, None], np.sin(ANGLES)[:, None]
    return cosine * WAY + sine * side, cosine * side - sine * WAY


def sent(n):
    """Return P and SV (n_azimuths, n_angles) of a column on ``n`` edges per S wavelength."""
    edge = LENGTH / n
    shape = np.ceil((LENGTH * np.abs(WAY) + 6.0 * edge) / edge).astype(int)
    primed = 0.5 * (shape * edge - LENGTH * WAY) + edge * np.array([0.31, 0.17, 0.43])
    column = Column(
        primed, primed + LENGTH * WAY, 1.0, 0.0, TimeFunction(np.array([0.0, 1.0]), 1.0),
        detonation_speed=DETONATION,
    )  # fmt: skip
    mesh = structured_box(shape, shape * edge, pattern="alternating")
    model = Model(mesh, {"rock": ROCK}, sources=[column])
    dt, omega = 1e-4, 2.0 * np.pi * FREQUENCY
    collected = model_loads(model, None)
    loads = collected.arrays(dt * np.arange(2.0))
    late = np.exp(1j * omega * dt * loads["load_delay"])
    divided = 1.0 / response(omega * np.array(collected.widths))[loads["load_history"]]
    forces = loads["load_vector"] * (late * divided)[:, None]
    places = model.mesh.points[loads["load_node"]] - primed
    waves = [far_field(places, forces, *around(a), omega, ROCK) for a in AZIMUTHS]
    return np.moveaxis(waves, 1, 0)


@case(
    "L4",
    "Far field of a detonating column, P and SV",
    source="Heelan (1953); P 1 - 2 (cs/cp)^2 cos^2 a, SV sin 2a, times sin(x)/x",
    gate="C",
    tolerance={"P": 0.02, "SV": 0.02},
    meshes=(10.0, 15.0, 22.5),
    unit="edges per S wavelength",
    order=1.8,
    quick=True,
    note="Far field, in an unbounded ground, of the forces that the column exerts on its mesh, "
    "at the frequency whose S wavelength equals the length of the column; L2 norm over 37 angles "
    "and 3 "
    "azimuths. What remains is the spread of each point over about an edge: P meets 2 % on 10 "
    "edges, SV from 17.5 on. Propagation through the mesh is case 17",
)
def column_radiation(n):
    """Compare the far field of the forces with the closed form, by angle from the detonation."""
    wanted = radiation(ANGLES, 2.0 * np.pi * FREQUENCY, LENGTH, DETONATION, ROCK)
    readings, curves = [], []
    for name, expected, measured in zip(("P", "SV"), wanted, sent(n), strict=True):
        every = np.broadcast_to(expected, measured.shape).ravel()
        readings.append(Reading.norm(name, every, measured.ravel()))
        curves.append(Curve(name, np.degrees(ANGLES), np.abs(expected), np.abs(measured[0]),
                            "angle from the way of detonation [deg]", "radiation [1]"))  # fmt: skip
    return readings, curves
