"""Moment tensors, columns, pressures and air blasts: what they put on the nodes, and where."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pyblast.errors import InputError
from pyblast.mesh.builder import structured_box
from pyblast.model.model import Model, Receiver
from pyblast.model.source import AirBlast, Column, Hole, MomentTensor, Pressure, TimeFunction
from pyblast.solver.loads import model_loads
from pyblast.solver.run import simulate
from verification.columns import ROCK, ricker

TIMES = np.arange(0.0, 0.06, 5e-4)
RATE = TimeFunction(1e9 * ricker(TIMES, 50.0), 5e-4)
UP = np.array([0.0, 0.0, 1.0])
PLACE = np.array([21.0, 19.0, 17.0])
DT = 1e-3


def box():
    return structured_box((8, 8, 8), (40.0, 40.0, 40.0))


def arrays(*sources):
    model = Model(box(), {"rock": ROCK}, sources=sources)
    return model.mesh, model_loads(model, None).arrays(DT * np.arange(200))


def motion(source):
    model = Model(box(), {"rock": ROCK}, sources=[source], receivers=[Receiver("R", (30, 12, 28))])
    return simulate(model, 0.05).seismograms["R"].velocity


def test_an_isotropic_tensor_is_a_hole():
    hole = motion(Hole(PLACE, 16.0, 0.004, RATE, 0.5))
    tensor = motion(MomentTensor(PLACE, 4.0 * np.eye(3), 0.004, RATE))

    assert tensor == pytest.approx(hole, abs=1e-12 * np.abs(hole).max())


@pytest.mark.parametrize("seed", range(3))
def test_a_tensor_pushes_with_no_force_and_no_couple(seed):
    half = np.random.default_rng(seed).normal(size=(3, 3))
    mesh, load = arrays(MomentTensor(PLACE, half + half.T, 0.0, RATE))
    places, vectors = mesh.points[load["load_node"]], load["load_vector"]
    scale = np.abs(vectors).max()

    assert np.abs(vectors.sum(axis=0)).max() < 1e-12 * scale
    assert np.abs(np.cross(places - PLACE, vectors).sum(axis=0)).max() < 1e-10 * scale
    assert places.T @ vectors == pytest.approx(half + half.T, abs=1e-9)


def test_a_tensor_that_is_not_symmetric_is_refused():
    with pytest.raises(InputError, match="moment tensor: must be symmetric"):
        MomentTensor(PLACE, np.triu(np.ones((3, 3))), 0.0, RATE)


def test_the_tensor_of_a_column_turns_with_its_axis():
    turn = Rotation.random(rng=np.random.default_rng(5))
    upright = Column(PLACE, PLACE + 8.0 * UP, 1.0, 0.0, RATE)
    leaning = Column(PLACE, PLACE + turn.apply(8.0 * UP), 1.0, 0.0, RATE)

    wanted = turn.as_matrix() @ upright.tensor(ROCK) @ turn.as_matrix().T
    assert leaning.tensor(ROCK) == pytest.approx(wanted, abs=1e-12)
    assert np.trace(upright.tensor(ROCK)) == pytest.approx(3.0)
    across, along = upright.tensor(ROCK)[0, 0], upright.tensor(ROCK)[2, 2]
    assert across / along == pytest.approx(ROCK.cp**2 / (ROCK.cp**2 - 2.0 * ROCK.cs**2))


def test_a_column_is_primed_at_one_end():
    column = Column(PLACE, PLACE + 9.0 * UP, 9.0, 0.0, RATE, detonation_speed=3000.0)

    places, delays = column.points(3)

    assert places[:, 2] - PLACE[2] == pytest.approx([1.5, 4.5, 7.5])
    assert delays == pytest.approx([0.5e-3, 1.5e-3, 2.5e-3])


def test_a_column_is_the_sum_of_its_points():
    column = Column(PLACE - 4.0 * UP, PLACE + 4.0 * UP, 9.0, 0.002, RATE, 0.5, 4000.0, 2)
    found = motion(column)

    places, delays = column.points(2)
    parts = [
        motion(MomentTensor(place, 1.5 * column.tensor(ROCK), 0.002 + delay, RATE))
        for place, delay in zip(places, delays, strict=True)
    ]
    assert found == pytest.approx(sum(parts), abs=2e-4 * np.abs(found).max())  # cubic delay


def test_a_pressure_is_its_force_on_the_surface():
    _, load = arrays(Pressure("top", TimeFunction(np.ones(50), 0.01)))

    assert load["load_vector"].sum(axis=0) == pytest.approx([0.0, 0.0, -1600.0])
    assert not load["load_delay"].any()


def test_a_running_pressure_arrives_later_farther_away():
    start = np.array([-40.0, 20.0, 40.0])
    mesh, load = arrays(Pressure("top", TimeFunction(np.ones(50), 0.01), start, 2000.0))

    share = np.linalg.norm(load["load_vector"], axis=1)
    nodes, place = np.unique(load["load_node"], return_inverse=True)
    mean = np.bincount(place, share * load["load_delay"]) / np.bincount(place, share)
    distance = np.linalg.norm(mesh.points[nodes] - start, axis=1)
    within = (mesh.points[nodes, :2] % 40.0).all(axis=1)
    # A node stands for the middle of its faces, which is beside it at the sponge only; the hat of a
    # node is 0.4 % farther where fronts are curved.
    assert mean[within] * DT == pytest.approx(distance[within] / 2000.0, rel=0.004)


def test_a_passing_pressure_comes_at_a_node_as_its_mean_over_the_hat_of_the_node():
    start, speed, edge = np.array([-1e6, 20.0, 40.0]), 340.0, 5.0
    mesh, load = arrays(Pressure("top", TimeFunction(np.ones(50), 0.01), start, speed))
    middle = np.flatnonzero(np.abs(mesh.points - [20.0, 20.0, 40.0]).max(axis=1) < 1e-9)[0]

    mine = load["load_node"] == middle
    share = load["load_vector"][mine, 2] / load["load_vector"][mine, 2].sum()
    delay = DT * load["load_delay"][mine]
    mean = share @ delay

    def passed(wavenumber):
        return share @ np.cos(wavenumber * speed * (delay - mean))

    # The hat of a row of squares passes sinc^2(kh/2) of a wave; three times follow it to kh = 3.
    for phase in (0.5, 1.0, 2.0, 3.0):
        exact = np.sinc(0.5 * phase / np.pi) ** 2
        assert passed(phase / edge) == pytest.approx(exact, abs=0.06)
    assert passed(1.0 / edge) == pytest.approx(np.sinc(0.5 / np.pi) ** 2, abs=0.02)


def test_an_air_blast_decays_and_lags_with_distance():
    place = np.array([-100.0, 20.0, 40.0])
    blast = AirBlast("top", place, TimeFunction(np.ones(50), 0.01), 10.0, 340.0, 1.2, 0.05)
    mesh, load = arrays(blast)

    distance = np.linalg.norm(mesh.points[load["load_node"]] - place, axis=1)
    area = np.linalg.norm(load["load_vector"], axis=1) * (distance / 10.0) ** 1.2
    assert area.sum() == pytest.approx(1600.0, rel=0.002)
    # Three times for each node, at most two thirds of an edge beside its own.
    assert load["load_delay"] * DT == pytest.approx(0.05 + distance / 340.0, rel=0.04)
    assert (load["load_vector"][:, 2] < 0.0).all()


def test_near_its_reference_an_air_blast_grows_no_more():
    share, _ = AirBlast("top", np.zeros(3), RATE, reference=5.0).at(np.eye(3))

    assert share == pytest.approx(np.ones(3))


@pytest.mark.parametrize(("key", "value"), [("speed", 0.0), ("reference", -1), ("exponent", -1)])
def test_an_air_blast_that_is_none_is_refused(key, value):
    with pytest.raises(InputError, match=f"air_blast.{key}: must"):
        AirBlast("top", np.zeros(3), RATE, **{key: value})
