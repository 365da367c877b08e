"""The integration over wavenumbers against the full space, and against reciprocity."""

import numpy as np
import pytest

from pyblast.model.material import Material
from verification.solutions.full_space import force_spectrum
from verification.solutions.layered_half_space import Bed, cut, plane_waves, response, strike_slip

SOFT = Material.from_speeds(2600.0, 4000.0, 2000.0)
HARD = Material.from_speeds(2700.0, 6000.0, 3464.0)
OMEGA = 2.0 * np.pi * 1.1 + 0.6j


def test_equal_layers_without_a_ground_are_a_full_space():
    beds = [Bed.of(1000.0, HARD), Bed.of(np.inf, HARD)]
    x, y, depth = 1800.0, 1300.0, 500.0
    k = np.arange(0.0, 0.012, 2e-5)

    radial, transverse, down = strike_slip(beds, 2000.0, (x, y), depth, OMEGA, k, free=False)

    def green(dx, dy):
        return force_spectrum(np.array([OMEGA]), (x - dx, y - dy, depth - 2000.0), HARD)[0]

    step = 1.0
    wanted = (green(0.0, step)[:, 0] - green(0.0, -step)[:, 0]) / (2.0 * step)
    wanted = wanted + (green(step, 0.0)[:, 1] - green(-step, 0.0)[:, 1]) / (2.0 * step)
    along = np.array([x, y]) / np.hypot(x, y)
    found = np.array([*(radial * along + transverse * np.array([-along[1], along[0]])), down])
    assert found == pytest.approx(wanted, abs=1e-4 * np.abs(wanted).max())


def test_source_and_receiver_change_places():
    beds = cut([Bed.of(1000.0, SOFT), Bed.of(np.inf, HARD)], (400.0, 2000.0))
    k = np.linspace(1e-5, 5e-3, 40)

    there = response(beds, plane_waves, OMEGA, k, 3, 1)
    back = response(beds, plane_waves, OMEGA, k, 1, 3)

    sign = np.array([[1.0, -1.0], [-1.0, 1.0]])
    assert there == pytest.approx(sign * back.swapaxes(1, 2), rel=1e-7)
