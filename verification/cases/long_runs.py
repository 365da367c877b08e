"""A closed box over 100 000 steps: a standing wave in it, and its energy. Case L27."""

import numpy as np

from pyblast.mesh.builder import structured_box
from pyblast.model.boundary import Roller
from pyblast.model.joint import Joint
from pyblast.model.model import Model, Receiver
from pyblast.solver.preparation import prepare
from verification.cases.plane_waves import standing
from verification.columns import ROCK, SPEED, started
from verification.suite import Curve, Reading, case

STEPS = 100_000
EDGE, ZONES = 10.0, (3, 2, 2)  # m
SIDES = ("west", "east", "south", "north", "bottom", "top")
AT, LAST = 10.0, 500  # m from the west, and steps of the curve


def box(**parts):
    """Return the model of a box of hexahedra of order 5."""
    planes = {joint.surface: ("x", EDGE) for joint in parts.get("joints", ())}
    lines = [EDGE * np.arange(n + 1.0) for n in ZONES]
    mesh = structured_box(*lines, order=5, planes=planes)
    return Model(mesh.split(list(planes)), {"rock": ROCK}, **parts)


def mode():
    """Return the run of a P wave that stands between rollers, times, found and wanted.

    Of leapfrog, ``sin(w dt/2) = k cp dt/2``; what the zones miss of k is below what is judged.
    """
    model = box(
        boundaries=[Roller(side) for side in SIDES], receivers=[Receiver("A", (AT, 7.0, 3.0))]
    )
    dt = prepare(model, 1.0).constants["dt"]
    wavenumber = np.pi / (EDGE * ZONES[0])
    omega = 2.0 / dt * np.arcsin(0.5 * wavenumber * SPEED["P"] * dt)
    velocity = np.zeros_like(model.nodes.points)
    velocity[:, 0] = np.sin(wavenumber * model.nodes.points[:, 0])
    run = started(model, STEPS * dt, 0.0 * velocity, velocity)
    record = run.seismograms["A"]
    steps = dt * np.arange(len(record.velocity) + 1)
    wanted = np.diff(np.sin(omega * steps)) / np.sin(omega * dt) * np.sin(wavenumber * AT)
    return run, record.times, record.velocity[:, 0], wanted


def shaken():
    """Return the run of a free box with an elastic joint that starts from noise."""
    model = box(joints=[Joint("J", "elastic", {"kn": 2e9, "ks": 1e9})])
    dt = prepare(model, 1.0).constants["dt"]
    velocity = np.random.default_rng(3).normal(size=model.nodes.points.shape)
    return started(model, STEPS * dt, 0.0 * velocity, velocity)


def turned(found, wanted):
    """Return the amplitude over that of what is wanted, and the phase [rad] that found is late.

    Of the last of two tones of one frequency; the slope makes the second of each.
    """
    last = wanted[-LAST:]
    basis = np.column_stack([last, np.gradient(wanted)[-LAST:]])[1:-1]
    rate = np.linalg.norm(basis[:, 1]) / np.linalg.norm(basis[:, 0])
    along, across = np.linalg.lstsq(basis, found[-LAST:][1:-1])[0]
    return float(np.hypot(along, rate * across)), float(-np.arctan2(rate * across, along))


@case(
    "L27",
    "A closed box over 100 000 steps",
    source="sin(w dt/2) = k cp dt/2 of leapfrog; energy of a body that nothing damps is kept",
    gate="R",
    tolerance={"standing wave, tetrahedra": 1e-9, "amplitude, hexahedra": 1e-6,
               "phase, hexahedra": 1e-6, "energy of the standing wave": 1e-12,
               "energy of noise beside a joint": 1e-11},
    quick=True,
    note="Tetrahedra against the formula of the discrete column, largest difference over its "
    "amplitude; 12 hexahedra of order 5 against the continuum: amplitude and "
    "phase in rad over the last 500 steps, after a thousand periods.",
)  # fmt: skip
def long_runs():
    """Let a wave stand in a box, and noise in one with an elastic joint."""
    column, formula, _ = standing("P", 10.0, STEPS)
    gap = float(np.abs(column.velocity[:, 0] - formula).max())
    run, times, found, wanted = mode()
    size, late = turned(found, wanted)
    energies = {"energy of the standing wave": run, "energy of noise beside a joint": shaken()}
    readings = [
        Reading("standing wave, tetrahedra", 0.0, gap, gap),
        Reading.relative("amplitude, hexahedra", 1.0, size),
        Reading.absolute("phase, hexahedra", 0.0, late),
        *(
            Reading(name, 0.0, one.balance_error, one.balance_error)
            for name, one in energies.items()
        ),
    ]
    return readings, [Curve("last steps", times[-LAST:], wanted[-LAST:], found[-LAST:], "time [s]",
                            "velocity [m/s]")]  # fmt: skip
