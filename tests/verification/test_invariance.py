"""What must not depend on axes, places or order: physics rungs 27, 31 and 33."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pyblast.meshing.mesh import Mesh
from pyblast.meshing.mesh_builder import structured_box
from pyblast.motion.seismogram import Seismogram
from pyblast.solving.boundaries import StressInput, Viscous
from pyblast.solving.joints import Joint
from pyblast.solving.materials import Damping
from pyblast.solving.model import Model, Receiver
from pyblast.solving.solver import run
from pyblast.solving.sources import Hole, PointForce, TimeFunction
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


def turned(mesh, turn):
    return Mesh(turn.apply(mesh.points), mesh.zones, mesh.zone_group, mesh.groups, mesh.surfaces)


def shaking(turn):
    motion = 0.2 * ricker(TIMES, 30.0)[:, None] * [0.8, 0.5, -0.3]
    return Seismogram(turn.apply(motion), TIMES[1])


def turned_run(turn):
    mesh = turned(crooked({"J": ("x", 20.0)}), turn).split(["J"])
    model = Model(
        mesh,
        {"rock": ROCK},
        joints=[Joint("J", "coulomb", WEAK, insitu_pressure=5e4)],
        boundaries=[*map(Viscous, SIDES), StressInput("west", shaking(turn))],
        damping=Damping(0.02, 30.0),
        sources=[Hole(turn.apply(A), 20.0, 0.005, TimeFunction(1e9 * ricker(TIMES, 30.0), 5e-4))],
        receivers=[Receiver("A", turn.apply(A)), Receiver("B", turn.apply(B))],
    )
    return run(model, 0.15)


@pytest.mark.parametrize("seed", range(2))
def test_a_turned_model_gives_turned_seismograms(seed):
    turn = Rotation.random(rng=np.random.default_rng(seed))

    straight, other = turned_run(Rotation.identity()), turned_run(turn)

    assert straight.state["contact_state"][:, 3].any()
    for name, record in straight.seismograms.items():
        wanted = turn.apply(record.velocity.copy())
        assert other.seismograms[name].velocity == pytest.approx(wanted, abs=1e-9 * record.pvs)


def force(place, direction):
    return PointForce(place, np.asarray(direction), TimeFunction(1e6 * ricker(TIMES, 30.0), 5e-4))


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
    return run(model, 0.15).seismograms


@pytest.mark.parametrize(("i", "j"), [(0, 0), (0, 2), (1, 2)])
def test_source_and_receiver_may_change_places_across_a_joint(i, j):
    there = jointed([force(A, np.eye(3)[i])])["B"].velocity[:, j]
    back = jointed([force(B, np.eye(3)[j])])["A"].velocity[:, i]

    assert np.abs(there).max() > 0.0
    assert there == pytest.approx(back, abs=1e-6 * np.abs(there).max())


def holes():
    rate = TimeFunction(1e9 * ricker(TIMES, 30.0), 5e-4)
    return [Hole(A, 20.0, 0.0, rate), Hole(np.array([8.0, 9.0, 10.0]), 35.0, 0.0173, rate, 0.8)]


def test_two_holes_give_the_sum_of_each_alone():
    one, two = holes()

    both, first, second = jointed([one, two]), jointed([one]), jointed([two])

    for name in both:
        wanted = first[name].velocity + second[name].velocity
        assert both[name].velocity == pytest.approx(wanted, abs=1e-10 * both[name].pvs)


def test_charge_counts_with_its_exponent():
    rate = TimeFunction(1e9 * ricker(TIMES, 30.0), 5e-4)
    light = jointed([Hole(A, 10.0, 0.0, rate, 0.7)])["B"]
    heavy = jointed([Hole(A, 40.0, 0.0, rate, 0.7)])["B"]

    assert heavy.velocity == pytest.approx(4.0**0.7 * light.velocity, abs=1e-10 * heavy.pvs)


def test_a_hole_that_fires_later_gives_the_same_motion_later():
    rate = TimeFunction(1e9 * ricker(TIMES, 30.0), 5e-4)
    early = jointed([Hole(A, 10.0, 0.0, rate)])["B"]
    late = jointed([Hole(A, 10.0, 40 * early.dt, rate)])["B"]

    assert late.velocity[40:] == pytest.approx(early.velocity[:-40], abs=1e-10 * early.pvs)


def test_slip_breaks_superposition():
    one, two = holes()

    both, first, second = (
        jointed(sources, law="coulomb") for sources in ([one, two], [one], [two])
    )

    gap = both["B"].velocity - first["B"].velocity - second["B"].velocity
    assert np.abs(gap).max() > 1e-3 * both["B"].pvs
