"""Motion in unbounded rock: an independent quadrature, the explosion, a couple of forces."""

import numpy as np
import pytest

from pyblast.model.full_space import force_motion, moment_motion
from pyblast.model.half_space import direct_wave
from pyblast.model.material import Material
from pyblast.model.source import TimeFunction
from verification.solutions import full_space

ROCK = Material.from_speeds(2600.0, 4000.0, 2300.0)
BELL = full_space.Bell(12.0)
VALUES, DT = BELL.samples()
RATE = TimeFunction(VALUES, DT)
TIMES = np.linspace(0.0, 0.4, 201)
OFFSETS = np.array([[3.0, -2.0, 4.0], [0.0, 0.5, 0.0], [60.0, 20.0, -90.0]])
TENSOR = np.array([[1.0, 0.3, 0.0], [0.3, -0.4, 0.7], [0.0, 0.7, 0.2]])


def test_a_tensor_moves_the_rock_as_a_quadrature_over_delays_says():
    motion = moment_motion(RATE, TENSOR, OFFSETS, TIMES, ROCK)

    for offset, own in zip(OFFSETS, motion, strict=True):
        wanted = full_space.moment(TIMES, offset, TENSOR, BELL, ROCK)
        assert np.abs(own - wanted).max() < 2e-4 * np.abs(wanted).max()


def test_a_force_moves_the_rock_as_a_quadrature_over_delays_says():
    direction = np.array([0.3, -0.2, 0.9])
    motion = force_motion(RATE, direction, OFFSETS, TIMES, ROCK)

    for offset, own in zip(OFFSETS, motion, strict=True):
        wanted = full_space.point_force(TIMES, offset, direction, BELL, ROCK)
        assert np.abs(own - wanted).max() < 2e-4 * np.abs(wanted).max()


def test_an_isotropic_tensor_is_an_explosion():
    motion = moment_motion(RATE, 2.0 * np.eye(3), OFFSETS, TIMES, ROCK)

    away = np.hypot(OFFSETS[:, 0], OFFSETS[:, 1])
    wanted = 2.0 * direct_wave(RATE, away, -OFFSETS[:, 2], TIMES, ROCK)
    assert motion[..., 2] == pytest.approx(wanted[..., 1], abs=2e-4 * np.abs(wanted).max())


def test_two_couples_of_opposite_torque_are_a_tensor_off_its_diagonal():
    force, half = RATE.integral(), 5e-4
    x, z = np.eye(3)[[0, 2]]

    def couple(direction, arm):
        ends = (
            sign * force_motion(force, direction, OFFSETS - sign * half * arm, TIMES, ROCK)
            for sign in (1.0, -1.0)
        )
        return sum(ends) / (2.0 * half)

    wanted = moment_motion(RATE, np.outer(x, z) + np.outer(z, x), OFFSETS, TIMES, ROCK)
    assert np.abs(couple(x, z) + couple(z, x) - wanted).max() < 1e-3 * np.abs(wanted).max()
