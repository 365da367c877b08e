"""Closed forms in a full space, against one another, and a hole spread over many zones."""

import numpy as np
import pytest

from pyblast.mesh.builder import SIDES, structured_box
from pyblast.model.boundary import Viscous
from pyblast.model.material import Material
from pyblast.model.model import Model, Receiver
from pyblast.model.source import Hole, TimeFunction
from pyblast.solver.run import simulate
from verification.solutions.full_space import Bell, explosion, force_spectrum, point_force
from verification.solutions.spherical_cavity import cavity_motion

ROCK = Material.from_speeds(2500.0, 4000.0, 2309.4)
OFFSET = np.array([300.0, 200.0, -100.0])
PULSE = Bell(20.0)
TIMES = np.linspace(0.0, 0.4, 801)


def test_three_dipoles_of_forces_are_an_explosion():
    step, dipoles = 0.2, 0.0
    for axis in np.eye(3):
        near, far = OFFSET - step * axis, OFFSET + step * axis
        dipoles -= point_force(TIMES, far, axis, PULSE, ROCK, slope=0) / (2.0 * step)
        dipoles += point_force(TIMES, near, axis, PULSE, ROCK, slope=0) / (2.0 * step)

    # A moment whose rate is the bell moves with the velocity that the bell itself displaces by.
    wanted = explosion(TIMES, OFFSET, PULSE, ROCK)
    assert dipoles == pytest.approx(wanted, abs=2e-4 * np.abs(wanted).max())


def test_the_spectrum_of_a_force_is_that_of_its_motion_in_time():
    omega = 2.0 * np.pi * np.array([5.0, 15.0, 25.0])
    direction = np.array([0.6, 0.0, 0.8])
    waves = np.exp(1j * np.outer(omega, TIMES)) * TIMES[1]
    motion = waves @ point_force(TIMES, OFFSET, direction, PULSE, ROCK, slope=0)

    wanted = force_spectrum(omega, OFFSET, ROCK) @ direction * (waves @ PULSE(TIMES))[:, None]

    assert motion == pytest.approx(wanted, abs=1e-5 * np.abs(wanted).max())


def test_the_wall_of_the_cavity_carries_the_pressure():
    times, step = np.linspace(0.0, 5e-3, 200), 1e-4
    pulse = Bell(800.0)
    out, wall, inward = (
        cavity_motion(times, 1.0 + far, 1.0, pulse, ROCK)[0] for far in (2 * step, step, 0.0)
    )

    slope = (4.0 * wall - out - 3.0 * inward) / (2.0 * step)
    stress = (ROCK.first_lame + 2.0 * ROCK.shear) * slope + 2.0 * ROCK.first_lame * inward
    assert stress == pytest.approx(-pulse(times), abs=3e-3)


def test_a_hole_spread_over_many_zones_radiates_as_a_point():
    length = ROCK.cp / PULSE.dominant
    edge, far = length / 10.0, 1.5 * length
    mesh = structured_box((33, 26, 26), np.array([3.3, 2.6, 2.6]) * length, pattern="alternating")
    values, dt = PULSE.samples()
    place = np.array([0.8, 1.3, 1.3]) * length
    receiver = Receiver("far", place + np.array([far, 0.0, 0.0]))
    hole = Hole(place, 25.0, 0.0, TimeFunction(2e8 * values, dt), exponent=0.5, spread=1.5 * edge)
    model = Model(
        mesh,
        {"rock": ROCK},
        boundaries=list(map(Viscous, SIDES)),
        sources=[hole],
        receivers=[receiver],
    )
    record = simulate(model, PULSE.peak + 2.5 / PULSE.dominant).seismograms["far"]

    wanted = 1e9 * explosion(record.times, (far, 0.0, 0.0), PULSE, ROCK)
    waves = np.exp(-2j * np.pi * np.outer([8.0, 12.0, 16.0], record.times))
    ratio = np.abs(waves @ record.velocity[:, 0]) / np.abs(waves @ wanted[:, 0])
    assert ratio == pytest.approx(np.ones(3), abs=0.08)
    assert np.abs(record.velocity[:, 1:]).max() < 0.1 * np.abs(record.velocity[:, 0]).max()
