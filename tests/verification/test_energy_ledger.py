"""The energy ledger: every joule put in is found again, beside case 26."""

from dataclasses import replace

import numpy as np
import pytest

from pyblast.mesh.builder import structured_box
from pyblast.model.boundary import Fixed, Roller, VelocityInput, Viscous
from pyblast.model.joint import Joint
from pyblast.model.material import Damping, MohrCoulomb
from pyblast.model.model import InSitu, Model
from pyblast.model.source import Hole, PointForce, TimeFunction
from pyblast.signals.seismogram import Seismogram
from pyblast.solver.run import simulate
from verification.columns import ROCK, ricker

CLOSED = [Fixed("bottom"), Roller("south")]
DT = 5e-4
TIMES = np.arange(0.0, 0.1, DT)
HISTORY = TimeFunction(1e7 * ricker(TIMES, 40.0), DT)
FORCE = PointForce(np.array([21.0, 13.0, 7.0]), np.array([0.3, -0.5, 0.8]), HISTORY)
HOLE = Hole(np.array([11.0, 9.0, 12.0]), 50.0, 0.01, TimeFunction(1e9 * ricker(TIMES, 40.0), DT))


def box(planes=None):
    mesh = structured_box((8, 6, 6), (40.0, 30.0, 30.0), planes=planes)
    return mesh.split(list(planes)) if planes else mesh


def model(planes=None, **parts):
    return Model(box(planes), {"rock": ROCK}, **parts)


def shaking():
    times = np.arange(0.0, 0.1, 1e-3)
    motion = 0.05 * ricker(times, 30.0)[:, None] * [0.8, 0.5, -0.3]
    return Seismogram(motion, 1e-3)


@pytest.mark.parametrize("source", [FORCE, HOLE])
@pytest.mark.parametrize("boundaries", [(), CLOSED])
def test_an_elastic_body_keeps_all_that_is_put_in(source, boundaries):
    result = simulate(model(boundaries=boundaries, sources=[source]), 0.2)

    assert result.energy["input"][-1] > 0.0
    assert result.balance_error < 1e-10


def test_stressed_ground_that_yields_keeps_or_loses_all_that_is_put_in():
    law = MohrCoulomb(0.1, cohesion_residual=1e4)
    rock = replace(ROCK, cohesion=1e5, friction=0.6, tension=5e4, law=law)
    sides = [Roller(side) for side in ("west", "east", "south", "north", "bottom")]
    ground = Model(box(), {"rock": rock}, boundaries=sides, sources=[HOLE], insitu=InSitu())

    result = simulate(ground, 0.2)

    assert result.energy["zone_dissipated"][-1] > 0.01 * result.energy["input"].max()
    assert np.abs(result.energy["insitu"]).max() > 0.01 * result.energy["input"].max()
    assert result.balance_error < 1e-9


def test_elastic_joints_keep_all_that_is_put_in():
    joint = Joint("J", "elastic", {"kn": 2e9, "ks": 1e9}, insitu_pressure=2e4)

    result = simulate(
        model({"J": ("x", 20.0)}, joints=[joint], boundaries=CLOSED, sources=[FORCE]), 0.2
    )

    assert result.energy["joint_stored"].max() > 0.01 * result.energy["input"].max()
    assert np.abs(result.energy["joint_dissipated"]).max() < 1e-9 * result.energy["input"].max()
    assert result.balance_error < 1e-10


def test_a_prescribed_velocity_puts_in_what_is_found():
    result = simulate(model(boundaries=[VelocityInput("west", shaking()), Viscous("east")]), 0.2)

    assert result.energy["input"][-1] > 0.0
    assert result.balance_error < 1e-10


def test_stiffness_damping_takes_what_is_missing():
    damping = Damping(0.05, 30.0)

    result = simulate(model(damping=damping, sources=[FORCE]), 0.2)

    assert result.energy["damping"][-1] > 0.5 * result.energy["input"][-1]
    assert result.balance_error < 1e-10
