"""Cases 22 and 23: a soft layer under vertical waves, and a layer over a half space (LOH)."""

from dataclasses import replace

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.signal import hilbert

from pyblast.mesh.builder import structured_box
from pyblast.mesh.grid import Layer, graded_axis
from pyblast.model.boundary import Fixed, StressInput, Viscous
from pyblast.model.material import ConstantQ, Damping, Material
from pyblast.model.model import Model, Receiver, SpongeLayer
from pyblast.model.source import PointForce, TimeFunction
from pyblast.signals.seismogram import Seismogram
from pyblast.solver.run import simulate
from verification.solutions.full_space import Bell
from verification.solutions.layered_column import layer_gain
from verification.solutions.layered_half_space import Bed, strike_slip_motion
from verification.suite import Curve, Reading, case

EAST_NORTH_UP = ("east", "north", "up")
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
    record = simulate(model, 3.0).seismograms["ground"]

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


@case(
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
    note="Damped: 5 % at the first peak, proportional to mass; the second frequency meets 1 % "
    "from 12 edges on",
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


# LOH: a layer of 1 km over a half space, a vertical strike-slip source 2 km deep.
TOP, DEPTH = 1000.0, 2000.0
BED = Material.from_speeds(2600.0, 4000.0, 2000.0)
BASE = Material.from_speeds(2700.0, 6000.0, 3464.0)
BAND = (0.08, 8.0)  # Hz where the quality factors hold
FADING = (
    replace(BED, law=ConstantQ(110.0, 40.0, BAND, reference=2.5)),
    replace(BASE, law=ConstantQ(140.0, 69.3, BAND, reference=2.5)),
)
MOMENT_RATE = Bell(0.8)  # times 1e18 N m/s
PLACES = {"near": (1000.0, 2000.0), "far": (3000.0, 4000.0)}
BOX = ((0.0, 3500.0), (0.0, 4500.0), (-2500.0, 0.0))
AROUND = 10000.0  # m of growing zones beyond the box, whose damping takes up what leaves it
DURATION = 5.5  # s


def loh_record(n_edges, bed, base):
    """Run a quarter of the ground; return the seismograms by place.

    Beside the planes of symmetry through the source only one half of each couple's force acts.
    """
    edge = TOP / n_edges
    outside = ((0.0, AROUND), (0.0, AROUND), (AROUND, 0.0))
    anchors = ((), (), (-TOP, -DEPTH))
    grid = [graded_axis(b, a, edge, *o) for b, a, o in zip(BOX, anchors, outside, strict=True)]
    layers = [Layer("bed", TOP), Layer("base")]
    mesh = structured_box(*grid, layers=layers, pattern="alternating")
    values, dt = MOMENT_RATE.samples()
    force = TimeFunction(1e18 * values, dt).integral()
    force = TimeFunction(force.values / (4.0 * edge), dt, held=True)
    couples = [
        PointForce((0.0, edge, -DEPTH), (1.0, 0.0, 0.0), force),
        PointForce((edge, 0.0, -DEPTH), (0.0, 1.0, 0.0), force),
    ]
    planes = [Fixed("west", ("north", "vertical")), Fixed("south", ("east", "vertical"))]
    model = Model(
        mesh,
        {"bed": bed, "base": base},
        boundaries=[*planes, *map(Viscous, ("east", "north", "bottom"))],
        sponge=SpongeLayer(BOX, AROUND),
        sources=couples,
        receivers=[Receiver(name, (*place, 0.0)) for name, place in PLACES.items()],
    )
    return simulate(model, DURATION).seismograms


def envelope_and_phase(wanted, found):
    """Return misfits of envelope and of phase over pi, each weighed by the wanted envelope.

    Kristekova, Kristek, Moczo & Day (2006), in time only and over all components.
    """
    ideal, actual = hilbert(wanted, axis=0), hilbert(found, axis=0)
    size = np.linalg.norm(ideal)
    turn = np.angle(actual * ideal.conj()) / np.pi
    return (
        np.linalg.norm(np.abs(actual) - np.abs(ideal)) / size,
        np.linalg.norm(np.abs(ideal) * turn) / size,
    )


@case(
    "23",
    "Layer over a half space: LOH.1 and LOH.3",
    source="integration over wavenumbers: Bouchon (1981), Chin, Hedstrom & Thigpen (1984)",
    gate="C",
    tolerance={
        f"{what}, {problem} {place}": 0.05
        for what in ("envelope", "phase")
        for problem in ("LOH.1", "LOH.3")
        for place in PLACES
    },
    meshes=(4.0, 6.0, 9.0),
    unit="edges over the layer (2.5 as many per S wavelength in the layer at 0.8 Hz)",
    order=1.8,
    note="Source filtered to a dominant frequency of 0.8 Hz; Qp 110 and 140 instead of 120 and "
    "155.9, at which bulk Q is infinite; misfits of Kristekova et al. (2006) in time",
)
def layer_over_half_space(n_edges):
    """Compare the ground motion of a strike-slip source, elastic and of constant quality."""
    readings, curves = [], []
    for problem, materials in (("LOH.1", (BED, BASE)), ("LOH.3", FADING)):
        records = loh_record(n_edges, *materials)
        beds = [Bed.of(h, m) for h, m in zip((TOP, np.inf), materials, strict=True)]
        for name, place in PLACES.items():
            times, found = records[name].times, records[name].velocity
            wanted = 1e18 * strike_slip_motion(beds, DEPTH, place, times, MOMENT_RATE, 4.0)
            envelope, phase = envelope_and_phase(wanted, found)
            readings.append(Reading(f"envelope, {problem} {name}", 0.0, envelope, envelope))
            readings.append(Reading(f"phase, {problem} {name}", 0.0, phase, phase))
            for axis, component in enumerate(EAST_NORTH_UP):
                label = f"{problem} {name}, {component}"
                pair = wanted[:, axis], found[:, axis]
                curves.append(Curve(label, times, *pair, "time [s]", "velocity [m/s]"))
    return readings, curves
