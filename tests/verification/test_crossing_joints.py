"""Joints that cross: stiff ones are as intact rock, open ones let the blocks part."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from pyblast.mesh.builder import structured_box
from pyblast.model.boundary import Fixed, Viscous
from pyblast.model.joint import Joint
from pyblast.model.model import Model, Receiver
from pyblast.model.source import PointForce, TimeFunction
from pyblast.solver.run import simulate
from verification.columns import ROCK, ricker

TIMES = np.arange(0.0, 0.1, 5e-4)
PULSE = TimeFunction(1e6 * ricker(TIMES, 40.0), 5e-4)
CROSS = {"J1": ("x", 15.0), "J2": ("y", 15.0), "J3": ("z", 15.0)}
FORCE = PointForce(np.array([7.0, 8.0, 9.0]), np.array([1.0, 0.7, -0.4]), PULSE)


def cube(n_planes):
    names = list(CROSS)[:n_planes]
    mesh = structured_box((6, 6, 6), (30.0, 30.0, 30.0), planes={n: CROSS[n] for n in names})
    return mesh.split(names) if names else mesh


def motion(n_planes, stiffness):
    law = {"kn": stiffness, "ks": 0.5 * stiffness}
    model = Model(
        cube(n_planes),
        {"rock": ROCK},
        joints=[Joint(name, "elastic", law) for name in list(CROSS)[:n_planes]],
        boundaries=[Viscous("bottom"), Viscous("west")],
        sources=[FORCE],
        receivers=[Receiver("far", (22.0, 21.0, 23.0))],
    )
    record = simulate(model, 0.12).seismograms["far"]
    return CubicSpline(record.times, record.velocity)(np.arange(0.002, 0.118, 5e-4))


@pytest.mark.parametrize("n_planes", [2, 3])
def test_stiff_crossing_joints_are_as_intact_rock(n_planes):
    intact = motion(0, 1.0)
    misfits = [
        np.linalg.norm(motion(n_planes, k) - intact) / np.linalg.norm(intact)
        for k in (1e11, 1e12, 1e13)
    ]

    assert misfits[1] < 0.3 * misfits[0]
    assert misfits[2] < 0.02


def test_the_block_between_crossing_joints_flies_off_alone():
    mesh = cube(3)
    slippery = {"kn": 1e9, "ks": 1e9, "cohesion": 0.0, "friction": 0.0, "tension": 0.0}
    push = TimeFunction(np.ones(5), 0.1)
    model = Model(
        mesh,
        {"rock": ROCK},
        joints=[Joint(name, "coulomb", slippery) for name in CROSS],
        boundaries=[Fixed("west"), Fixed("south"), Fixed("bottom")],
        sources=[PointForce(np.array([22.0, 22.0, 22.0]), np.full(3, 1e7), push)],
        receivers=[Receiver("block", (22.5, 22.5, 22.5))],
    )

    result = simulate(model, 0.1)

    blocks = mesh.blocks()
    assert len(np.unique(blocks)) == 8
    corner = (model.mesh.points[model.mesh.zones].mean(axis=1) > 15.0).all(axis=1)
    moved = result.state["displacement"]
    nodes = np.unique(model.mesh.zones[corner])
    others = np.setdiff1d(np.arange(len(moved)), nodes)
    mass = ROCK.density * 15.0**3
    free = 0.5 * 1e7 / mass * 0.1**2
    assert moved[nodes].mean(axis=0) == pytest.approx(np.full(3, free), rel=0.02)  # its own ringing
    assert np.abs(moved[others]).max() < 1e-3 * free


def test_the_node_where_three_joints_cross_is_eight():
    mesh = cube(3)

    assert np.count_nonzero((mesh.points == 15.0).all(axis=1)) == 8


def test_contact_area_at_a_crossing_is_that_of_the_planes():
    contacts = cube(3).contacts

    assert np.bincount(contacts.joint, contacts.area) == pytest.approx(np.full(3, 900.0))
