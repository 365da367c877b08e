"""Loads, dashpots and prescribed motion at single nodes."""

import numpy as np
import pytest

from pyblast import core

BORDER = core._core.pyblast_border
MASS, DT = 3.0, 0.01
IMPEDANCE_P, IMPEDANCE_S = 40.0, 15.0


def impedance(normal, area=2.0):
    outer = np.outer(normal, normal)
    return area * (IMPEDANCE_P * outer + IMPEDANCE_S * (np.eye(3) - outer))


def dashpot(velocity, matrix, force=(0.0, 0.0, 0.0), alpha=0.0):
    """Return the force that a dashpot adds to a node, and the energy it takes in the step."""
    inverse = np.linalg.inv(MASS * (1.0 + 0.5 * alpha * DT) * np.eye(3) + 0.5 * DT * matrix)
    total = np.array(force, dtype=float)
    before, after = BORDER.viscous_forces(
        dt=DT,
        node_mass=[[MASS]],
        node_alpha=[[alpha]],
        dashpot_node=[1],
        dashpot_impedance=matrix[None].T,
        dashpot_inverse=inverse[None, None].T,
        velocity=np.array(velocity, dtype=float)[None, :, None].T,
        force=total[None, :, None].T,
    )
    return total - force, before[0] + after[0]


def moved(velocity, force, alpha=0.0):
    half = 0.5 * DT * alpha
    drive = (1.0 - half) * np.asarray(velocity) + DT * np.asarray(force) / MASS
    return drive / (1.0 + half)


def reaction(velocity, direction, wanted=None, force=(0.0, 0.0, 0.0), alpha=0.0):
    """Return the reaction of a prescribed direction on a node, and the energy it puts in."""
    total = np.array(force, dtype=float)
    before, after = BORDER.reaction_forces(
        dt=DT,
        node_mass=[[MASS]],
        node_alpha=[[alpha]],
        fixed_node=[1],
        fixed_direction=np.array([direction], dtype=float).T,
        fixed_history=[[0 if wanted is None else 1]],
        amplitude=[0.0 if wanted is None else wanted],
        velocity=np.array(velocity, dtype=float)[None, :, None].T,
        force=total[None, :, None].T,
    )
    return total - force, before[0] + after[0]


@pytest.mark.parametrize("alpha", [0.0, 5.0])
def test_a_dashpot_resists_with_the_impedance_of_each_wave(alpha):
    old, pull = np.array([0.2, 0.0, 0.5]), np.array([1.0, 2.0, -3.0])
    matrix = impedance([0.0, 0.0, 1.0])

    force, _ = dashpot(old, matrix, pull, alpha)

    mean = 0.5 * (old + moved(old, pull + force, alpha))
    wanted = [-2.0 * IMPEDANCE_S * mean[0], -2.0 * IMPEDANCE_S * mean[1]]
    assert force == pytest.approx([*wanted, -2.0 * IMPEDANCE_P * mean[2]], rel=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_a_dashpot_only_takes_energy_out(seed):
    rng = np.random.default_rng(seed)
    normal = rng.normal(size=3)
    old, pull = rng.normal(size=(2, 3))

    _, taken = dashpot(old, impedance(normal / np.linalg.norm(normal)), 100.0 * pull)

    assert taken >= 0.0


@pytest.mark.parametrize("seed", range(5))
def test_what_a_dashpot_takes_is_what_the_node_loses(seed):
    normal, old = np.random.default_rng(seed).normal(size=(2, 3))

    force, taken = dashpot(old, impedance(normal / np.linalg.norm(normal)))

    new = moved(old, force)
    assert taken == pytest.approx(0.5 * MASS * (old @ old - new @ new), rel=1e-12)


def test_a_dashpot_far_beyond_the_mass_stops_a_node_without_instability():
    matrix = impedance([1.0, 0.0, 0.0], area=1e9)
    velocity = np.array([1.0, -2.0, 3.0])
    for _ in range(50):
        force, _ = dashpot(velocity, matrix)
        velocity = moved(velocity, force)
        assert np.linalg.norm(velocity) <= np.linalg.norm([1.0, -2.0, 3.0])


@pytest.mark.parametrize("alpha", [0.0, 20.0])
def test_a_fixed_direction_comes_to_rest_and_the_others_stay_free(alpha):
    old, pull = [1.0, 2.0, 3.0], [5.0, 6.0, 7.0]

    force, _ = reaction(old, [0.0, 1.0, 0.0], force=pull, alpha=alpha)

    assert force[[0, 2]] == pytest.approx(0.0)
    assert moved(old, pull + force, alpha)[1] == pytest.approx(0.0, abs=1e-14)


@pytest.mark.parametrize("alpha", [0.0, 20.0])
def test_a_prescribed_velocity_is_reached_along_a_slanted_direction(alpha):
    old, pull, direction = [1.0, 2.0, 3.0], [5.0, 6.0, 7.0], np.array([0.6, 0.0, 0.8])

    force, _ = reaction(old, direction, wanted=-0.7, force=pull, alpha=alpha)

    assert moved(old, pull + force, alpha) @ direction == pytest.approx(-0.7, rel=1e-13)


def test_a_prescribed_velocity_puts_in_what_the_node_gains():
    old, direction = np.array([1.0, 0.0, 0.0]), [1.0, 0.0, 0.0]

    _, put_in = reaction(old, direction, wanted=4.0)

    assert put_in == pytest.approx(0.5 * MASS * (16.0 - 1.0), rel=1e-12)


def test_loads_follow_their_histories_and_tell_their_power():
    velocity = np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]])
    vectors = np.array([[1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 3.0]])
    force = np.ones((2, 3))

    power = BORDER.load_forces(
        step=1,
        load_node=[1, 2, 2],
        load_vector=vectors.T,
        load_history=[1, 1, 2],
        load_delay=[0.0, 0.0, 0.0],
        load_member=[0, 1, 0],
        history=[[10.0], [100.0]],
        velocity=velocity[..., None].T,
        force=force[..., None].T,
    )

    assert force == pytest.approx(np.array([[11.0, 1.0, 1.0], [1.0, 21.0, 301.0]]))
    assert power[0] == pytest.approx(10.0 * 1.0 + 20.0 * 5.0 + 300.0 * 6.0)


@pytest.mark.parametrize("delay", [0.0, 0.25, 1.0, 3.5, 6.75])
def test_a_delayed_load_follows_a_cubic_history_exactly(delay):
    steps = np.arange(40.0)
    history = 2.0 - 0.3 * steps + 0.02 * steps**2 - 1e-3 * steps**3
    force = np.zeros((1, 3, 1), order="F")

    BORDER.load_forces(
        step=21,
        load_node=[1],
        load_vector=np.ones((3, 1)),
        load_history=[1],
        load_delay=[delay],
        load_member=[0],
        history=history[None],
        velocity=np.zeros((1, 3, 1), order="F"),
        force=force,
    )

    x = 20.0 - delay
    assert force[0, 0, 0] == pytest.approx(2.0 - 0.3 * x + 0.02 * x**2 - 1e-3 * x**3, rel=1e-12)


@pytest.mark.parametrize("delay", [5.0, 7.5])
def test_nothing_arrives_before_its_delay(delay):
    force = np.zeros((1, 3, 1), order="F")

    BORDER.load_forces(
        step=4,
        load_node=[1],
        load_vector=np.ones((3, 1)),
        load_history=[1],
        load_delay=[delay],
        load_member=[0],
        history=np.ones((1, 40)),
        velocity=np.zeros((1, 3, 1), order="F"),
        force=force,
    )

    assert force[0, 0, 0] == 0.0
