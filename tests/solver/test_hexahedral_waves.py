"""Waves in hexahedra against closed forms: a point force between rollers, a pulse across joints."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from benchmarks.accuracy import FORCE, PULSE, RECEIVERS, ROCK, SIZE, SOURCE, misfit
from benchmarks.box_solution import roller_box
from benchmarks.waves import joint_rows
from pyblast.mesh.builder import structured_box
from pyblast.model.boundary import Roller
from pyblast.model.model import Model, Receiver
from pyblast.model.source import PointForce, TimeFunction
from pyblast.solver.run import simulate

DURATION = 0.45
SIDES = ("west", "east", "south", "north", "bottom", "top")


@pytest.fixture(scope="module")
def exact():
    clock = np.arange(0.0, DURATION + 1e-3, 5e-4)
    motion = roller_box(clock, SIZE, ROCK, SOURCE, FORCE, PULSE, RECEIVERS)
    return CubicSpline(clock, motion)


def error(exact, order, shape, share):
    """Return the error of a box of hexahedra, as `benchmarks.accuracy` counts it."""
    times = np.arange(0.0, DURATION + 0.1, 1e-4)
    model = Model(
        structured_box(shape, SIZE, order=order),
        {"rock": ROCK},
        boundaries=[Roller(side) for side in SIDES],
        sources=[PointForce(tuple(SOURCE), tuple(FORCE), TimeFunction(PULSE(times), 1e-4))],
        receivers=[Receiver(f"R{k}", tuple(place)) for k, place in enumerate(RECEIVERS)],
        step_factor=share,
    )
    run = simulate(model, DURATION)
    motion = np.stack([r.velocity for r in run.seismograms.values()], axis=1)
    within = (np.arange(len(motion)) + 0.5) * run.dt <= DURATION
    return misfit(motion[within], exact((np.arange(len(motion)) + 0.5)[within] * run.dt))


@pytest.mark.parametrize(
    ("order", "shape"), [(4, (8, 9, 4)), (5, (6, 7, 3)), (6, (5, 6, 3)), (8, (4, 4, 2))]
)
def test_a_point_force_between_rollers_moves_as_in_closed_form(exact, order, shape):
    assert error(exact, order, shape, 0.3) < 0.01


def test_the_error_of_the_step_is_of_second_order(exact):
    long, short = (error(exact, 6, (5, 6, 3), share) for share in (0.95, 0.475))

    assert long / short == pytest.approx(4.0, rel=0.25)


def test_a_pulse_crosses_six_joints_as_in_closed_form():
    (row,) = joint_rows(1)

    assert row["error"] < 0.03
