"""Closed forms of explosions and running loads, against other ways to the same numbers."""

import numpy as np
import pytest

from pyblast.solving.materials import Material
from verification.solutions.full_space import Bell
from verification.solutions.half_space import surface_motion
from verification.solutions.slipping_plane import slip

ROCK = Material.from_speeds(2500.0, 3464.1, 2000.0)
TIMES = np.arange(0.0, 0.3, 1e-3)


@pytest.mark.parametrize("distance", [50.0, 200.0])
def test_a_plane_without_friction_slips_as_a_free_surface_moves(distance):
    pulse = Bell(20.0)

    def spectrum(omega):
        return np.exp(1j * np.outer(omega, TIMES)) @ pulse(TIMES) * TIMES[1]

    by_wave_numbers = surface_motion(spectrum, TIMES, distance, ROCK, 50.0)[:, 0]
    rate = slip(TIMES, distance, 50.0, pulse, ROCK, slope=1)

    assert rate == pytest.approx(by_wave_numbers, abs=1e-6 * np.abs(rate).max())
