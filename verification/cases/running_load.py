"""Check L2: a pressure that runs through the air over a half space, in a slab one zone thick."""

from dataclasses import dataclass

import numpy as np

from pyblast.mesh.builder import structured_box
from pyblast.model.boundary import Fixed, Roller, Viscous
from pyblast.model.material import Material
from pyblast.model.model import Model, Receiver
from pyblast.model.source import AirBlast, TimeFunction
from pyblast.solver.run import simulate
from verification.columns import ricker, spectrum
from verification.solutions.running_load import coupling, load_that_sets_out
from verification.suite import Curve, Reading, case

FREQUENCY, AIR = 20.0, 340.0
BAND = FREQUENCY * np.array([0.6, 0.8, 1.0, 1.2, 1.4])
PRESSURE = 100.0  # Pa
FINE = 2.0  # shortest wavelengths under the surface; below, cells are twice as high
WINDOW = 1.6  # periods before and after the crest that are compared


@dataclass(frozen=True)
class Ground:
    """A half space, and where the load is watched.

    Parameters
    ----------
    material : Material
    shortest : float, m
        Of the waves that it answers with; edges are counted on it.
    place : float, m
        Of the receiver from where the load sets out, so far that what starts there has passed; an
        even number of shortest wavelengths, so that it is on a plane of nodes on every mesh.
    length, depth : float, m
    """

    material: Material
    shortest: float
    place: float
    length: float
    depth: float


SOIL = Material.from_speeds(2000.0, 600.0, 170.0)
FIRM = Material.from_speeds(2000.0, 1100.0, 600.0)
GROUNDS = {
    "below cs": Ground(FIRM, AIR / FREQUENCY, 136.0, 238.0, 136.0),
    "above cs": Ground(SOIL, SOIL.cs / FREQUENCY, 85.0, 136.0, 68.0),
}


def watched(ground, n):
    """Return the record (seismogram) under the load on ``n`` edges per shortest wavelength."""
    edge = ground.shortest / n
    x = edge * np.arange(round(ground.length / edge) + 1)
    shallow = round(FINE * n)
    deep = round((ground.depth - shallow * edge) / (2.0 * edge))
    z = -edge * np.append(shallow + 2.0 * np.arange(deep, 0, -1), np.arange(shallow, -1, -1))
    mesh = structured_box(x, np.array([0.0, edge]), z, pattern="alternating")
    times = np.arange(0.0, 3.0 / FREQUENCY, 0.01 / FREQUENCY)
    history = TimeFunction(load(times), times[1])
    model = Model(
        mesh,
        {"rock": ground.material},
        boundaries=[
            *(Fixed(side, ("north",)) for side in ("south", "north")),
            Roller("west"),
            *map(Viscous, ("east", "bottom")),
        ],
        sources=[AirBlast("top", (0.0, 0.5 * edge, 0.0), history, speed=AIR, exponent=0.0)],
        receivers=[Receiver("under", (ground.place, 0.5 * edge, -1e-6 * edge))],
    )
    return simulate(model, ground.place / AIR + (1.5 + WINDOW) / FREQUENCY).seismograms["under"]


def load(times):
    """Return the pressure (n,) in Pa at times since it sets out or arrives."""
    return PRESSURE * ricker(times, FREQUENCY)


@case(
    "L2",
    "Air blast over a half space, slower and faster than S waves",
    source="wave number k = w/c_a: v/p = i w nu_a kb2/(mu R), and discrete wave numbers",
    gate="C",
    tolerance={f"{what}, {name}": 0.05 for name in GROUNDS for what in ("v/p", "motion")},
    meshes=(10.0, 15.0, 22.5),
    unit="edges per shortest wavelength",
    order=1.8,
    ordered=tuple(f"motion, {name}" for name in GROUNDS),
    quick=True,
    note="v/p: at the load, the worst of five frequencies from 0.6 to 1.4 of the dominant, "
    "against the steady state; waves from where the load began are still 1 % of it. Motion: "
    "L2 norm of the difference over that of the motion, including the beginning, by discrete "
    "wavenumbers. Under a load slower than S waves the response is a small difference: v/p "
    "needs 22.5 edges there at its highest frequency (16 to its own length), 10 where the "
    "load is faster. The hat functions of the nodes (5.13) take (k h)^2/12 from the load, 6 "
    "% at that frequency on 10 edges",
)
def air_blast(n):
    """Compare the velocity into the ground under the load with the steady state and in full."""
    readings, curves = [], []
    for name, ground in GROUNDS.items():
        record = watched(ground, n)
        times, found = record.times, -record.velocity[:, 2]
        even = np.linspace(0.0, times[-1], 500)
        motion = load_that_sets_out(load, even, ground.place, AIR, ground.material)
        wanted = TimeFunction(motion, even[1])(times)
        late = times - ground.place / AIR
        near = np.abs(late - 1.5 / FREQUENCY) < WINDOW / FREQUENCY
        below = [spectrum(times[near], values[near], BAND) for values in (found, load(late))]
        measured, expected = np.abs(below[0] / below[1]), abs(coupling(AIR, ground.material))
        worst = np.argmax(np.abs(measured / expected - 1.0))
        readings += [
            Reading.relative(f"v/p, {name}", expected, measured[worst]),
            Reading.norm(f"motion, {name}", wanted, found),
        ]
        curves.append(Curve(name, times, wanted, found, "time [s]", "velocity down [m/s]"))
    return readings, curves
