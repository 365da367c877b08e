"""Rayleigh damping of standing waves, and the step it allows. Case 24."""

from dataclasses import replace

import numpy as np
from scipy.optimize import curve_fit

from pyblast.errors import SolverError
from pyblast.mesh.builder import structured_box
from pyblast.model.boundary import Fixed
from pyblast.model.material import Damping
from pyblast.model.model import Model
from pyblast.solver.preparation import prepare
from pyblast.solver.run import simulate
from verification.cases.plane_waves import forces
from verification.columns import AXIS, ROCK, SPEED, column_model, started
from verification.solutions.attenuation import rayleigh_ratio
from verification.suite import Curve, Reading, case

EDGE, N_EDGES, CENTRAL = 5.0, 24, 25.0
PARTS = {"both parts": (True, True), "mass": (True, False), "stiffness": (False, True)}


def decay(wave, halves, damping):
    """Return frequency in Hz, damping ratio and record of a standing wave of half wavelengths."""
    mesh = structured_box((N_EDGES, 1, 1), (N_EDGES * EDGE, 0.5 * EDGE, 0.5 * EDGE))
    place = EDGE * round(0.5 * N_EDGES / halves)
    ends = [Fixed("west"), Fixed("east")]
    model = column_model(mesh, wave, ends, receivers_at=[place], damping=damping)
    velocity = np.zeros_like(model.mesh.points)
    wavenumber = halves * np.pi / (N_EDGES * EDGE)
    velocity[:, AXIS[wave]] = np.sin(wavenumber * model.mesh.points[:, 0])
    omega = wavenumber * SPEED[wave]
    record = started(model, 8.0 * np.pi / omega, 0.0 * velocity, velocity).seismograms[f"{place:g}"]
    times, motion = record.times, record.velocity[:, AXIS[wave]]

    def free(time, amplitude, rate, turn, phase):
        return amplitude * np.exp(-rate * time) * np.cos(turn * time + phase)

    guess = (1.0, 0.03 * omega, omega, 0.0)
    values, _ = curve_fit(free, times, motion, guess)
    natural = np.hypot(values[1], values[2])
    return natural / (2.0 * np.pi), values[1] / natural, times, motion


@case(
    "24",
    "Rayleigh damping of standing waves",
    source="paper, eq. (5): ratio (alpha/w + beta w)/2; free decay e^(-ratio w t)",
    gate="R",
    tolerance={
        **{f"ratio, {name}, {wave}": 0.01 for name in PARTS for wave in AXIS},
        "growth at 0.98 of the limit": 0.5,
        "growth at 1.02 of the limit": 0.5,
    },
    quick=True,
    note="The limit is that for the largest frequency of a small box, found from its forces: "
    "(2/w)(sqrt(1 + x2) - x), x = beta w/2. Growth is 0 or 1.",
)
def rayleigh():
    """Fit the decay of standing waves at three frequencies; take the worst."""
    readings, curves = [], []
    for wave in AXIS:
        for name, (mass, stiffness) in PARTS.items():
            damping = Damping(0.03, CENTRAL, mass=mass, stiffness=stiffness)
            found = [decay(wave, halves, damping) for halves in (1, 2, 4)]
            frequency = np.array([f for f, *_ in found])
            ratio = np.array([r for _, r, *_ in found])
            wanted = rayleigh_ratio(frequency, 0.03, CENTRAL, mass, stiffness)
            worst = int(np.abs(ratio / wanted - 1.0).argmax())
            quantity = f"ratio, {name}, {wave}"
            readings.append(Reading.relative(quantity, wanted[worst], ratio[worst]))
            if wave == "P":
                curves.append(Curve(name, frequency, wanted, ratio, "frequency [Hz]", "ratio"))
    readings += [
        Reading.absolute("growth at 0.98 of the limit", 0.0, grows(0.98)),
        Reading.absolute("growth at 1.02 of the limit", 1.0, grows(1.02)),
    ]
    return readings, curves


def grows(factor):
    """Tell (1 or 0) whether a damped box left alone grows at a share of its exact limit."""
    mesh = structured_box((2, 2, 2), (10.0, 10.0, 10.0))
    damping = Damping(0.02, 25.0, mass=False)
    model = Model(mesh, {"rock": ROCK}, damping=damping)
    prepared = prepare(model, 1.0)
    largest = np.sqrt(largest_square(prepared.constants))
    x = 0.5 * 0.02 / (2.0 * np.pi * 25.0) * largest
    dt = factor * 2.0 / largest * (np.sqrt(1.0 + x**2) - x)
    n_steps = 4000
    constants = {**prepared.constants, "dt": dt, "history": np.zeros((n_steps, 1))}
    velocity = np.random.default_rng(1).normal(size=mesh.points.shape)
    state = {**prepared.state, "velocity": velocity}
    prepared = replace(prepared, constants=constants, state=state, n_steps=n_steps)
    try:
        simulate(model, n_steps * dt, prepared=prepared)
    except SolverError:
        return 1.0
    return 0.0


def largest_square(constants):
    """Return the largest squared frequency of a small model from its forces."""
    mass = np.repeat(constants["node_mass"], 3)
    columns = []
    for unit in np.eye(len(mass)):
        columns.append(-forces(constants, unit.reshape(-1, 3)).ravel())
    matrix = np.array(columns) / np.sqrt(np.outer(mass, mass))
    return float(np.linalg.eigvalsh(matrix)[-1])
