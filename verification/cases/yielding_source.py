"""Check L7: the corner of what a charge sends out of ground that yields around it, by charge."""

from functools import cache
from itertools import pairwise

import numpy as np

from pyblast.model.boundary import Roller, Viscous
from pyblast.model.material import Material, MohrCoulomb
from pyblast.model.model import Model, Receiver
from pyblast.model.source import Pressure, TimeFunction
from pyblast.solver.run import simulate
from verification.cases.full_space import RAYS
from verification.meshes import ball_octant
from verification.solutions.yielding_cavity import (
    Rise,
    corner_frequency,
    source_spectrum,
    yielding_cavity,
)
from verification.suite import Curve, Reading, case

ROCK = Material.from_speeds(2500.0, 4000.0, 2309.4, cohesion=10e6, law=MohrCoulomb())
PRESSURE = 4.0 * ROCK.cohesion
RADII = (1.0, 1.5, 2.0)  # of the cavities that charges of their cubes make
EVEN, END = 5.0, 28.0  # m: shells are even up to here, and grow until there
GROWTH = 1.06
FAR = 6.0  # m: beyond all ground that yields
RISE, DURATION = 2.0, 24.0  # over the radius and the speed of P waves
FREQUENCIES = np.linspace(2.0, 1000.0, 500)  # Hz, times the radius


def shells(per_radius):
    """Return the radii of all shells of nodes, so that every cavity begins at one."""
    stops = (*RADII, EVEN)
    pieces = [
        np.linspace(low, high, int(np.ceil((high - low) * per_radius - 1e-9)) + 1)[1:]
        for low, high in pairwise(stops)
    ]
    near = np.concatenate([[RADII[0]], *pieces])
    steps = GROWTH ** np.arange(1.0, 200.0) / per_radius
    beyond = EVEN + np.cumsum(steps)
    return np.concatenate([near, beyond[: np.searchsorted(beyond, END) + 1]])


def corner(radius, times, velocity):
    """Return the corner in Hz and the spectrum of a record at `FAR`."""
    spectrum = source_spectrum(times, velocity, FAR, FREQUENCIES / radius, ROCK)
    return corner_frequency(FREQUENCIES / radius, spectrum), spectrum


@cache
def along_the_radius():
    """Return the corner in Hz and the spectrum of the smallest charge, solved along the radius."""
    rise = Rise(RISE * RADII[0] / ROCK.cp)
    times, velocity, _ = yielding_cavity(
        RADII[0], lambda t: PRESSURE * rise(t), FAR, DURATION * RADII[0] / ROCK.cp, ROCK
    )
    return corner(RADII[0], times, velocity)


def exploded(radius, per_radius):
    """Return the corner in Hz and the spectrum of a cavity on the mesh of all cavities."""
    every = shells(per_radius)
    mesh = ball_octant(round(0.5 * np.pi * per_radius), every[every > radius - 1e-9])
    rise = Rise(RISE * radius / ROCK.cp)
    times = np.linspace(0.0, rise.duration, 101)
    history = TimeFunction(PRESSURE * rise(times), times[1], held=True)
    model = Model(
        mesh,
        {"rock": ROCK},
        boundaries=[*map(Roller, ("west", "south", "bottom")), Viscous("outside")],
        sources=[Pressure("cavity", history)],
        receivers=[Receiver(f"{k}", FAR * ray) for k, ray in RAYS],
    )
    records = simulate(model, DURATION * radius / ROCK.cp).seismograms
    radial = np.mean([records[f"{k}"].velocity @ ray for k, ray in RAYS], axis=0)
    return corner(radius, records["0"].times, radial)


@case(
    "L7",
    "Corner of a charge in ground that yields, over eightfold charge",
    source="similarity, W^(-1/3); the smallest solved along the radius, Tresca",
    gate="C",
    tolerance={
        **{f"{what}, charge {r**3:g}": 0.05 for what in ("corner", "moment") for r in RADII},
        "exponent": 0.05,
    },
    meshes=(4.0, 6.0, 9.0),
    unit="edges per radius of the smallest cavity",
    order=0.9,
    ordered=tuple(f"{what}, charge {r**3:g}" for what in ("corner", "moment") for r in RADII),
    quick=True,
    note="Charge as the cube of the cavity radius: all cavities begin at shells of one mesh, the "
    "ground yields out to 2.4 radii under 4 times its cohesion. Corner: where the far-field "
    "spectrum is half of its low-frequency level, which is the moment. Similarity requires "
    "the hole to grow with the charge: in the same hole under twice the pressure the ground "
    "yields 3 times as far, but the "
    "corner falls to 0.18, as the -3/2 power of that radius",
)
def yielding_source(per_radius):
    """Compare corners of three charges on one mesh with those that similarity demands."""
    first, wanted = along_the_radius()
    readings, curves, found = [], [], []
    for radius in RADII:
        frequency, spectrum = exploded(radius, per_radius)
        found.append(frequency)
        charge = radius**3 / RADII[0] ** 3
        readings += [
            Reading.relative(f"corner, charge {charge:g}", first * RADII[0] / radius, frequency),
            Reading.relative(f"moment, charge {charge:g}", wanted[0] * charge, spectrum[0]),
        ]
        curves.append(Curve(f"charge {charge:g}", FREQUENCIES / radius, wanted * charge, spectrum,
                            "frequency [Hz]", "source spectrum [m3]"))  # fmt: skip
    slope = np.polyfit(3.0 * np.log(RADII), np.log(found), 1)[0]
    return [*readings, Reading.relative("exponent", -1.0 / 3.0, slope)], curves
