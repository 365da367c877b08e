"""Motion of a buried explosion: limits in closed form, the free surface, the level of a moment."""

import numpy as np
import pytest

from pyblast.blasts.signature import ground_peak, moment_for_peak
from pyblast.model.full_space import force_motion, moment_motion
from pyblast.model.half_space import explosion, radiations, reflected_waves
from pyblast.model.material import Material
from pyblast.model.source import TimeFunction
from verification.solutions.full_space import Bell
from verification.solutions.full_space import explosion as unbounded

ROCK = Material.from_speeds(2600.0, 4000.0, 2300.0)
BELL = Bell(12.0)
VALUES, DT = BELL.samples()
RATE = TimeFunction(1e9 * VALUES, DT)
TIMES = np.arange(0.0, 0.3, 1e-3)


def test_slow_motion_is_that_of_a_point_of_dilatation():
    slow = Bell(0.25)
    values, dt = slow.samples()
    times = np.linspace(0.5, 2.0, 4) * slow.peak

    motion = explosion(TimeFunction(values, dt), 8.0, [0.5, 10.0, 25.0], [0.0], times, ROCK)[:, 0]

    # Mogi (1958): 4 (1 - nu) times the full space, along the ray.
    nu = 0.5 - 0.5 / (ROCK.cp**2 / ROCK.cs**2 - 1.0)
    for radius, velocity in zip((0.5, 10.0, 25.0), motion, strict=True):
        cube = np.hypot(radius, 8.0) ** 3
        static = (1.0 - nu) * slow(times) / (np.pi * ROCK.density * ROCK.cp**2 * cube)
        wanted = np.outer(static, [radius, 8.0])
        assert velocity == pytest.approx(wanted, abs=0.02 * np.abs(wanted).max())


def test_the_surface_doubles_an_upright_wave_and_leaves_it_free():
    motion = explosion(RATE, 600.0, [0.0], [0.0, 1.0], TIMES, ROCK)[0]

    wanted = 2e9 * unbounded(TIMES, (0.0, 0.0, 600.0), BELL, ROCK)[:, 2]
    assert motion[0, :, 1] == pytest.approx(wanted, abs=0.05 * np.abs(wanted).max())
    alone = explosion(RATE, None, [0.0], [-600.0], TIMES, ROCK)[0, 0]
    assert alone[:, 1] == pytest.approx(0.5 * wanted, abs=2e-3 * np.abs(wanted).max())


def test_no_traction_acts_on_the_surface():
    step = 0.05
    at = explosion(RATE, 20.0, [30.0 - step, 30.0, 30.0 + step], [0.0, step, 2 * step], TIMES, ROCK)
    across = (at[2, 0] - at[0, 0]) / (2.0 * step)
    upward = -(4.0 * at[1, 1] - at[1, 2] - 3.0 * at[1, 0]) / (2.0 * step)
    shear = ROCK.shear * (across[:, 1] + upward[:, 0])
    volume = across[:, 0] + at[1, 0, :, 0] / 30.0 + upward[:, 1]
    normal = ROCK.first_lame * volume + 2.0 * ROCK.shear * upward[:, 1]

    inside = 2.0 * ROCK.shear * np.abs(across).max()
    assert np.abs(shear).max() < 0.01 * inside
    assert np.abs(normal).max() < 0.01 * inside


@pytest.mark.parametrize(("distance", "depth"), [(10.0, 8.0), (50.0, 8.0), (30.0, None)])
def test_a_moment_is_set_to_a_peak_at_its_slant_distance(distance, depth):
    rate = moment_for_peak(RATE, 0.05, distance, depth, ROCK)

    away = distance if depth is None else np.sqrt(distance**2 - depth**2)
    motion = explosion(rate, depth, [away], [0.0], np.arange(0.0, 0.25, 2e-4), ROCK)
    assert np.abs(motion).max() == pytest.approx(0.05, rel=0.01)


def test_near_a_shallow_hole_the_ground_moves_more_than_twice_unbounded_rock():
    alone = ground_peak(RATE, 20.0, None, ROCK)

    assert 2.6 < ground_peak(RATE, 20.0, 8.0, ROCK) / alone < 3.4
    assert ground_peak(RATE, 5.0, 8.0, ROCK) == ground_peak(RATE, 8.0, 8.0, ROCK)


TENSOR = np.array([[1.0, 0.3, -0.5], [0.3, -0.2, 0.7], [-0.5, 0.7, 0.4]])
SOURCE, PLACE = np.array([0.0, 0.0, -20.0]), np.array([30.0, -40.0, -8.0])


def motion_at(place, source=SOURCE, tensor=None, force=(0.0, 0.0, 0.0)):
    """Return the velocity (n, 3) east, north, up; of a force whose derivative is the rate."""
    away = place - source
    if tensor is None:
        motion = force_motion(RATE.integral(), np.array(force), away[None], TIMES, ROCK)[0]
    else:
        motion = moment_motion(RATE, tensor, away[None], TIMES, ROCK)[0]
    distance = np.hypot(*away[:2, None])
    ray = np.array([*away[:2], 0.0]) / distance
    left, turn = np.array([-ray[1], ray[0], 0.0]), np.arctan2(away[1], away[0])
    for part, c, s in radiations(tensor, force):
        angle = part.order * turn
        added = reflected_waves(RATE, -source[2], distance, -place[2:], TIMES, ROCK, part)
        radial, up, *across = added[0, 0].T
        share = c * np.cos(angle) + s * np.sin(angle)
        motion = motion + share * (radial[:, None] * ray + up[:, None] * [0.0, 0.0, 1.0])
        for each in across:
            motion = motion + (s * np.cos(angle) - c * np.sin(angle)) * each[:, None] * left
    return motion


def test_source_and_receiver_of_a_force_change_places():
    for i, j in ((0, 0), (0, 1), (0, 2), (1, 2), (2, 2)):
        there = motion_at(PLACE, SOURCE, force=np.eye(3)[i])[:, j]
        back = motion_at(SOURCE, PLACE, force=np.eye(3)[j])[:, i]
        assert there == pytest.approx(back, abs=1e-9 * np.abs(back).max())


def test_a_moment_tensor_is_a_difference_of_forces():
    step, wanted = 0.05, 0.0
    for axis, along in enumerate(step * np.eye(3)):
        pair = (motion_at(PLACE, SOURCE + side * along, force=TENSOR[:, axis]) for side in (1, -1))
        wanted = wanted + np.subtract(*pair) / (2.0 * step)

    motion = motion_at(PLACE, tensor=TENSOR)

    assert motion == pytest.approx(wanted, abs=2e-3 * np.abs(wanted).max())
    alone = motion_at(PLACE, tensor=np.eye(3))
    radial, up = explosion(RATE, 20.0, [50.0], [8.0], TIMES, ROCK)[0, 0].T
    expected = np.column_stack([0.6 * radial, -0.8 * radial, up])
    assert alone == pytest.approx(expected, abs=1e-3 * np.abs(expected).max())


def test_points_of_a_column_add_up_each_with_its_delay():
    depths, delays = np.array([10.0, 14.0, 18.0]), np.array([0.0, 0.02, 0.04])
    places = np.array([40.0]), np.array([5.0])

    column = reflected_waves(RATE, depths, *places, TIMES, ROCK, delays=delays)

    parts = [
        reflected_waves(RATE, depth, *places, TIMES - late, ROCK)
        for depth, late in zip(depths, delays, strict=True)
    ]
    wanted = np.mean(parts, axis=0)
    assert column == pytest.approx(wanted, abs=1e-3 * np.abs(wanted).max())


@pytest.mark.parametrize("source", [{"tensor": TENSOR}, {"force": (1.0, 0.5, -0.3)}])
def test_no_traction_of_a_tensor_or_force_acts_on_the_surface(source):
    step, at = 0.05, PLACE * [1.0, 1.0, 0.0]
    slope = np.zeros((len(TIMES), 3, 3))
    for axis in (0, 1):
        along = step * np.eye(3)[axis]
        slope[:, axis] = motion_at(at + along, **source) - motion_at(at - along, **source)
    down = (motion_at(at - [0.0, 0.0, k * step], **source) for k in (0, 1, 2))
    slope[:, 2] = [3.0, -4.0, 1.0] @ np.stack([*down]).swapaxes(0, 1)
    slope /= 2.0 * step
    volume = np.trace(slope, axis1=1, axis2=2)[:, None, None] * np.eye(3)
    stress = ROCK.first_lame * volume + ROCK.shear * (slope + slope.swapaxes(1, 2))

    assert np.abs(stress[:, 2]).max() < 0.01 * np.abs(stress).max()
