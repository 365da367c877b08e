"""Waves in hexahedra against closed forms: a point force between rollers, a pulse across joints."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from benchmarks.accuracy import FORCE, PULSE, RECEIVERS, ROCK, SIZE, SOURCE, misfit
from benchmarks.box_solution import roller_box
from benchmarks.waves import joint_rows
from pyblast.mesh.builder import structured_box
from pyblast.mesh.grid import Geometry, Layer
from pyblast.mesh.hexahedral.mapped import build_mapped
from pyblast.model.boundary import Roller, Viscous
from pyblast.model.material import Material
from pyblast.model.model import Model, Receiver
from pyblast.model.source import MomentTensor, PointForce, TimeFunction
from pyblast.solver.run import simulate
from verification.solutions.full_space import Bell, explosion

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


@pytest.mark.long
@pytest.mark.parametrize(("order", "edge"), [(2, 15.0), (3, 35.0), (4, 65.0)])
def test_the_absorbing_layer_of_any_order_sends_back_little(order, edge):
    box = np.array([[-80.0, 80.0]] * 3)
    mesh = build_mapped(Geometry(box, (Layer("rock"),), standing=frozenset()), [edge], order)
    rock, bell = Material.from_speeds(2600.0, 4000.0, 2300.0), Bell(12.0)
    values, dt = bell.samples()
    at, source = np.array([60.0, -55.0, -50.0]), np.array([0.0, 0.0, 50.0])
    model = Model(
        mesh,
        {"rock": rock},
        boundaries=[Viscous(side) for side in SIDES],
        sources=[MomentTensor(source, np.eye(3), 0.0, TimeFunction(1e9 * values, dt))],
        receivers=[Receiver("R", tuple(at))],
    )

    record = simulate(model, 0.35).seismograms["R"]

    wanted = 1e9 * explosion(record.times, at - source, bell, rock)
    assert np.linalg.norm(record.velocity - wanted) < 0.02 * np.linalg.norm(wanted)


def test_a_pulse_crosses_six_joints_as_in_closed_form():
    (row,) = joint_rows(1)

    assert row["error"] < 0.03
