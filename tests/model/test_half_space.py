"""Motion of a buried explosion: limits in closed form, the free surface, the level of a moment."""

import numpy as np
import pytest

from pyblast.blasts.signature import ground_peak, moment_for_peak
from pyblast.model.half_space import explosion
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
