"""Blasts that scatter, delays between samples, recorders. Cases 34, 35 and L21."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np

from pyblast.blasts.blast import Firing
from pyblast.blasts.signature import superpose
from pyblast.diagnosis.library import instruments
from pyblast.mesh.builder import structured_box
from pyblast.model.model import Model, Receiver
from pyblast.planning import FiringScatter
from pyblast.signals.seismogram import Seismogram
from pyblast.solver.preparation import prepare
from pyblast.solver.run import simulate
from verification.columns import ROCK, ricker
from verification.suite import Curve, Reading, case

SEED, DRAWS = 20, 4000


@case(
    "34",
    "Spectrum under firing scatter",
    source="E|F|2 = |sum m g e^(-iwt)|2 + sum (E a2 - m2 g2), g = e^(-w2 s2/2), m = E a",
    gate="C",
    tolerance={"largest difference in standard errors": 3.0, "mean difference": 0.02},
    quick=True,
    note="4000 blasts of 12 holes drawn by the program around a plan, with a scatter of times by "
    "1.5 ms and 1 % of the delay and of strengths by 20 %; 60 frequencies to 120 Hz.",
)
def firing_scatter():
    """Let the program draw blasts and compare their mean spectrum with its expectation."""
    times, amplitudes = 0.025 * np.arange(12), np.linspace(0.8, 1.2, 12)
    frequency = np.linspace(2.0, 120.0, 60)
    omega = 2.0 * np.pi * frequency
    scatter = FiringScatter(delay=1.5e-3, delay_share=0.01, charge=0.2)
    power = []
    for fired, strong in zip(*scatter.drawn(times, DRAWS, SEED, amplitudes), strict=True):
        power.append(np.abs(np.exp(-1j * np.outer(omega, fired)) @ strong) ** 2)
    power = np.array(power)
    sigma = np.sqrt(1.5e-3**2 + (0.01 * times) ** 2)
    fade = np.exp(-0.5 * np.outer(omega, sigma) ** 2)
    mean, square = amplitudes * np.exp(0.5 * 0.2**2), amplitudes**2 * np.exp(2.0 * 0.2**2)
    sharp = np.abs(np.sum(mean * fade * np.exp(-1j * np.outer(omega, times)), axis=1)) ** 2
    wanted = sharp + np.sum(square - (mean * fade) ** 2, axis=1)
    found, error = power.mean(axis=0), power.std(axis=0) / np.sqrt(DRAWS)
    sigmas = (found - wanted) / error
    # the largest of 60 is below 3.6 with 98 %; the case asks 3 of all but the largest
    most = float(np.sort(np.abs(sigmas))[-2])
    share = float(np.mean(found / wanted - 1.0))
    readings = [
        Reading("largest difference in standard errors", 0.0, most, most),
        Reading("mean difference", 0.0, share, share),
    ]
    return readings, [Curve("12 holes", frequency, wanted, found, "frequency [Hz]", "|F|2")]


@case(
    "L21",
    "Delays between samples",
    source="a Ricker pulse at its shifted time; a cubic history, which four samples give exactly",
    gate="C",
    tolerance={"superposed pulses": 1e-6, "load between two steps": 1e-9},
    quick=True,
    note="Three holes at 0, 12.34 and 30.57 samples; the load acts on a free block, 3.4 steps "
    "late.",
)
def fractional_delays():
    """Fire holes between samples, and push a free block between steps."""
    dt, delays, scales = 1e-3, np.array([0.0, 12.34, 30.57]), np.array([1.0, 0.7, -0.4])
    times = dt * np.arange(400)
    signature = Seismogram(np.outer(ricker(times - 0.1, 20.0), [1.0, 0.3, 0.2]), dt)
    total = superpose(signature, Firing(dt * delays, scales))
    wanted = sum(
        a * ricker(total.times - total.times[0] - 0.1 - d, 20.0)
        for a, d in zip(scales, dt * delays, strict=True)
    )
    gap = float(np.abs(total.velocity[:, 0] - wanted).max())
    velocity, history = pushed_late(3.4)
    steps = np.arange(8, len(velocity))
    exact = np.polyval(history, steps + 1 - 3.4)
    late = float(np.abs(np.diff(velocity)[7:] / exact - 1.0).max())
    readings = [Reading("superposed pulses", 0.0, gap, gap),
                Reading("load between two steps", 0.0, late, late)]  # fmt: skip
    return readings, [Curve("three holes", total.times, wanted, total.velocity[:, 0], "time [s]",
                            "velocity [m/s]")]  # fmt: skip


def pushed_late(delay):
    """Return velocity over the time step of a free block pushed late, and the cubic that does it.

    The push is an acceleration; ``delay`` is in steps, and the cubic is in steps, too.
    """
    cubic = np.array([1e-3, -0.05, 0.7, 2.0])
    model = Model(
        structured_box((2, 2, 2), (2.0, 2.0, 2.0)), {"rock": ROCK},
        receivers=[Receiver("R", (1.0, 1.0, 1.0))],
    )  # fmt: skip
    prepared = prepare(model, 0.01)
    dt, n_steps = prepared.constants["dt"], prepared.n_steps
    mass = prepared.constants["node_mass"]
    loads = {
        "load_node": np.arange(len(mass), dtype=np.int32),
        "load_vector": mass[:, None] * [1.0, 0.0, 0.0],
        "load_history": np.zeros(len(mass), dtype=np.int32),
        "load_delay": np.full(len(mass), delay),
        "load_member": np.full(len(mass), -1, dtype=np.int32),
        "history": np.polyval(cubic, np.arange(1, n_steps + 1))[:, None],
    }
    prepared = replace(prepared, constants={**prepared.constants, **loads})
    record = simulate(model, n_steps * dt, prepared=prepared).seismograms["R"]
    return record.velocity[:, 0] / dt, cubic


@case(
    "35",
    "Sensor, clock, rotation",
    source="transfer functions of theory.md section 7.1",
    gate="C",
    tolerance={"geophone": 1e-10, "coupling": 1e-10, "clock": 1e-10, "rotation": 1e-10,
               "gain and polarity": 1e-10},
    quick=True,
    note="The instrument effects that a diagnosis tries. Spectra over those of the motion, where "
        "the motion exceeds a thousandth of its peak; the pulse ends well inside the "
    "record.",
)  # fmt: skip
def operators():
    """Compare spectra of pulses under effects of the instrument with their transfer functions."""
    dt, length = 1e-3, 8192
    pulse = np.outer([1.0, 0.4, -0.7], ricker(dt * np.arange(length) - 1.0, 12.0))[None, None]
    scene = SimpleNamespace(case=SimpleNamespace(receivers=("R",), dt=dt))
    n = 4 * length
    frequency = np.fft.rfftfreq(n, dt)
    before = np.fft.rfft(pulse[0, 0, 0], n)
    present = np.abs(before) > 1e-3 * np.abs(before).max()
    s = 2j * np.pi * frequency
    w0, w1 = 2.0 * np.pi * 4.5, 2.0 * np.pi * 40.0
    cases = {
        "geophone": (instruments.geophone, (4.5, 0.6, 1.0), s**2 / (s**2 + 1.2 * w0 * s + w0**2)),
        "coupling": (instruments.weak_coupling, (40.0, 0.2),
                     (1 + 0.4 * s / w1) / (1 + 0.4 * s / w1 + (s / w1) ** 2)),
        "clock": (instruments.clock_error, (0.01234,), np.exp(-s * 0.01234)),
        "gain and polarity": (instruments.gain_error, (-1.7,), -1.7 + 0.0 * s),
    }  # fmt: skip
    readings, curves = [], []
    for name, (effect, values, wanted) in cases.items():
        found = np.fft.rfft(effect(scene, pulse, "R", *values)[0, 0, 0], n) / before
        gap = float(np.abs(found - wanted)[present].max())
        readings.append(Reading(name, 0.0, gap, gap))
        axes = frequency[present], np.abs(wanted[present]), np.abs(found[present])
        curves.append(Curve(name, *axes, "frequency [Hz]", "gain"))
    still = np.eye(3)[None, None]  # at each sample the motion along another axis
    matrix = instruments.turned_sensor(scene, still, "R", 0.7)[0, 0]
    gap = float(np.abs(matrix - sensor_axes(0.7)).max())
    return [*readings, Reading("rotation", 0.0, gap, gap)], curves[:2]


def sensor_axes(turn):
    """Return the axes of a sensor as rows: its horizontals turned clockwise."""
    east, north, up = np.eye(3)
    cos, sin = np.cos(turn), np.sin(turn)
    return np.array([cos * east - sin * north, sin * east + cos * north, up])
