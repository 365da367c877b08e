"""The exact answers that benchmarks measure errors against."""

import numpy as np
import pytest

from benchmarks.box_solution import Ricker, past_joints, roller_box
from pyblast.model.material import Material
from verification.solutions import full_space

ROCK = Material.from_speeds(2700.0, 1871.0, 1000.0)
SIZE, SOURCE, FORCE = (400.0, 500.0, 600.0), np.array([190.0, 240.0, 310.0]), np.array([1.0, 2, -3])
PULSE = Ricker(25.0, 0.06)


def test_the_integrals_of_a_ricker_pulse_have_it_as_derivative():
    times = np.linspace(0.0, 0.12, 2001)

    for order in (1, 0, -1):
        slope = np.gradient(PULSE(times, order - 1), times)
        assert slope[5:-5] == pytest.approx(
            PULSE(times, order)[5:-5], abs=3e-4 * 78.5 ** max(order, 0)
        )


def test_before_the_first_echo_a_roller_box_is_a_full_space():
    times, receiver = np.linspace(0.0, 0.2, 81), np.array([230.0, 220.0, 350.0])

    inside = roller_box(times, SIZE, ROCK, SOURCE, FORCE, PULSE, [receiver])[:, 0]

    size = np.linalg.norm(FORCE)
    alone = full_space.point_force(times, receiver - SOURCE, FORCE / size, PULSE, ROCK) * size
    assert np.abs(inside - alone).max() < 1e-4 * np.abs(alone).max()


def test_no_point_of_a_roller_face_moves_through_it():
    times = np.linspace(0.0, 0.6, 61)

    face = roller_box(times, SIZE, ROCK, SOURCE, FORCE, PULSE, [np.array([0.0, 210.0, 300.0])])

    assert np.abs(face[:, 0, 0]).max() < 1e-12 * np.abs(face).max()


def test_joints_part_a_pulse_without_loss():
    times = np.arange(-0.2, 1.8, 5e-4)
    joints, speed, impedance = np.array([300.0, 320.0, 340.0]), 1871.0, 2700.0 * 1871.0
    pulse = Ricker(15.0, 0.0)

    motion = past_joints(times, np.array([-700.0, 900.0]), 0.0, joints, speed, impedance,
                         impedance * 2.0 * np.pi * 15.0, pulse)  # fmt: skip

    # Far before the joints the pulse itself has passed long ago: what is there came back.
    back, passed = np.sum(motion[times > 0.2] ** 2, axis=0)
    assert back > 0.1 * passed
    assert back + passed == pytest.approx(np.sum(pulse(times) ** 2), rel=1e-3)
