"""Rungs 22 and 23: a soft layer under vertical waves, and a layer over a half space (LOH)."""

import numpy as np
from scipy.optimize import minimize_scalar

from pyblast.meshing.geology import Layer
from pyblast.meshing.mesh_builder import structured_box
from pyblast.motion.seismogram import Seismogram
from pyblast.solving.boundaries import Fixed, StressInput, Viscous
from pyblast.solving.materials import Damping, Material
from pyblast.solving.model import Model, Receiver
from pyblast.solving.solver import run
from verification.ladder import Curve, Reading, rung
from verification.solutions.layered_column import layer_gain

SOIL = Material.from_speeds(1900.0, 600.0, 300.0)
ROCK = Material.from_speeds(2400.0, 2200.0, 1200.0)
THICKNESS = 20.0  # m
FIRST = SOIL.cs / (4.0 * THICKNESS)  # Hz
DAMPED = Damping(0.05, FIRST, stiffness=False)


def ricker(frequency):
    """Return an eastward velocity pulse of 1 m/s with its peak at 1.5 periods."""
    times = np.arange(0.0, 3.0 / frequency, 0.01 / frequency)
    phase = (np.pi * (frequency * times - 1.5)) ** 2
    velocity = np.zeros((len(times), 3))
    velocity[:, 0] = (1.0 - 2.0 * phase) * np.exp(-phase)
    return Seismogram(velocity, times[1])


def shaken_layer(n_edges, damping):
    """Send a pulse up through rock and layer; return the gain at the ground as a function of Hz."""
    edge = THICKNESS / n_edges
    heights = edge * np.arange(2 * round(n_edges) + 1)
    across = np.array([0.0, 0.5 * edge])
    layers = [Layer("soil", THICKNESS), Layer("rock")]
    mesh = structured_box(across, across, heights, layers=layers)
    pulse = ricker(2.0 * FIRST)
    guides = [Fixed(s, ("north", "vertical")) for s in ("west", "east", "south", "north")]
    model = Model(
        mesh,
        {"soil": SOIL, "rock": ROCK},
        boundaries=[*guides, Viscous("bottom"), StressInput("bottom", pulse)],
        damping={"soil": damping, "rock": Damping(0.0, FIRST)},
        receivers=[Receiver("ground", (0.0, 0.0, heights[-1]))],
    )
    record = run(model, 3.0).seismograms["ground"]

    def gain(frequency):
        given, found = (
            np.exp(-2j * np.pi * np.outer(frequency, s.times)) @ s.velocity[:, 0] * s.dt
            for s in (pulse, record)
        )
        return np.abs(found / given) / 2.0

    return gain


def summit(gain, near):
    """Return frequency and height of the peak of a gain near a frequency."""
    best = minimize_scalar(
        lambda f: -gain(np.array([f]))[0],
        bounds=(0.85 * near, 1.15 * near),
        method="bounded",
        options={"xatol": 1e-6 * near},
    )
    return best.x, -best.fun


@rung(
    "22",
    "Layered column under vertical shear waves",
    source="closed form 1/(cos kH - i a sin kH), Kramer (1996)",
    gate="E",
    tolerance={
        f"{what} {number}, {name}": 0.01 if what == "frequency" else 0.05
        for what in ("frequency", "peak")
        for number in (1, 2)
        for name in ("undamped", "damped")
    },
    meshes=(8.0, 12.0, 18.0),
    unit="edges over the layer (4/3 as many per wavelength at the second peak)",
    order=1.8,
    quick=True,
    note="damped: 5 % at the first peak, by mass; the second frequency meets 1 % from 12 edges on",
)
def layered_column(n_edges):
    """Find the first two peaks of the gain of a soft layer."""
    readings, curves = [], []
    band = FIRST * np.linspace(0.3, 3.6, 200)
    for name, damping in (("undamped", Damping(0.0, FIRST)), ("damped", DAMPED)):
        gain = shaken_layer(n_edges, damping)

        def wanted(frequency, alpha=damping.alpha):
            return np.abs(layer_gain(frequency, THICKNESS, SOIL, ROCK, alpha))

        for number in (1, 2):
            near = (2 * number - 1) * FIRST
            (f, height), (f_found, found) = summit(wanted, near), summit(gain, near)
            readings.append(Reading.relative(f"frequency {number}, {name}", f, f_found))
            readings.append(Reading.relative(f"peak {number}, {name}", height, found))
        curves.append(Curve(name, band, wanted(band), gain(band), "frequency [Hz]", "gain"))
    return readings, curves
