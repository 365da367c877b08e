"""How charges and slip change the sum of holes, beside cases 27, 31 and 33."""

import numpy as np
import pytest

from pyblast.mesh.builder import structured_box
from pyblast.mesh.mesh import Mesh
from pyblast.model.boundary import Viscous
from pyblast.model.joint import Joint
from pyblast.model.material import Damping
from pyblast.model.model import Model, Receiver
from pyblast.model.source import Hole, TimeFunction
from pyblast.solver.run import simulate
from verification.columns import ROCK, ricker

SIDES = ("west", "east", "south", "north", "bottom")
WEAK = {"kn": 2e9, "ks": 1e9, "cohesion": 0.0, "friction": 0.4, "tension": 0.0}
STRONG = {"kn": 2e9, "ks": 1e9}
TIMES = np.arange(0.0, 0.1, 5e-4)
A, B = np.array([11.0, 17.0, 14.0]), np.array([33.0, 8.0, 21.0])


def crooked(planes, seed=2):
    """Return a box with nodes moved at random, but not out of its faces and joint planes."""
    mesh = structured_box((8, 6, 6), (40.0, 30.0, 30.0), planes=planes)
    points = mesh.points.copy()
    moves = np.random.default_rng(seed).uniform(-1.0, 1.0, size=points.shape)
    moves[(points == 0.0) | (points == points.max(axis=0)) | (points == 20.0)] = 0.0
    return Mesh(points + moves, mesh.zones, mesh.zone_group, mesh.groups, mesh.surfaces)


def jointed(sources, law="elastic", **parts):
    properties = STRONG if law == "elastic" else WEAK
    model = Model(
        crooked({"J": ("x", 20.0)}).split(["J"]),
        {"rock": ROCK},
        joints=[Joint("J", law, properties)],
        boundaries=list(map(Viscous, SIDES)),
        damping=Damping(0.01, 30.0),
        sources=sources,
        receivers=[Receiver("A", A), Receiver("B", B)],
        **parts,
    )
    return simulate(model, 0.15).seismograms


def holes():
    rate = TimeFunction(1e9 * ricker(TIMES, 30.0), 5e-4)
    return [Hole(A, 20.0, 0.0, rate), Hole(np.array([8.0, 9.0, 10.0]), 35.0, 0.0173, rate, 0.8)]


def test_charge_counts_with_its_exponent():
    rate = TimeFunction(1e9 * ricker(TIMES, 30.0), 5e-4)
    light = jointed([Hole(A, 10.0, 0.0, rate, 0.7)])["B"]
    heavy = jointed([Hole(A, 40.0, 0.0, rate, 0.7)])["B"]

    assert heavy.velocity == pytest.approx(4.0**0.7 * light.velocity, abs=1e-10 * heavy.pvs)


def test_slip_breaks_superposition():
    one, two = holes()

    both, first, second = (
        jointed(sources, law="coulomb") for sources in ([one, two], [one], [two])
    )

    gap = both["B"].velocity - first["B"].velocity - second["B"].velocity
    assert np.abs(gap).max() > 1e-3 * both["B"].pvs
