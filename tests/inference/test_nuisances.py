"""Nuisance columns: firing times, attenuation, ground that receivers see otherwise."""

import numpy as np
import pytest
from residual_case import residual_case

from pyblast.inference.nuisances import Firings, Nuisances, hole_columns, random_slopes


def test_columns_of_holes_add_up_to_the_delay_of_the_blast():
    _, band, motion = residual_case()
    fired = Firings(np.array([0.0, 0.024, 0.048]), np.array([1.0, 1.2, 0.9]), np.zeros((3, 3)))

    holes, _ = hole_columns(motion, [fired, None], band, 1e-3)

    late = band.project(-np.gradient(motion, band.dt, axis=-1))[0] * 1e-3
    both = holes.columns.sum(axis=0)[0]
    assert len(holes.columns) == 3
    assert np.sum((both - late) ** 2) < 0.05 * np.sum(late**2)  # the water level


def test_attenuation_takes_high_frequencies_and_is_counted_from_the_firing():
    _, band, motion = residual_case()

    _, lost = hole_columns(motion, [None, None], band, 1e-3)

    held = band.project(motion)
    assert np.all(np.sum(lost * held, axis=(1, 2, 3)) < 0.0)


def test_random_slopes_are_one_for_each_receiver_and_three_over_frequency():
    _, band, motion = residual_case()

    parts = random_slopes(motion[None], [0.1], band)

    assert parts.groups == ("ground",) * 6
    assert parts.columns[:3].sum(axis=0) == pytest.approx(0.1 * band.project(motion))
    assert isinstance(parts, Nuisances)
