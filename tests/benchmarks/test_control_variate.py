"""A controlled mean is right, knows its error, and needs fewer fine runs."""

import numpy as np
import pytest

from benchmarks.control_variate import controlled_mean
from pyblast.errors import InputError


def draws(n, m, noise, generator):
    """Fine and coarse answers to the same inputs, biased, and coarse ones to others."""
    x, others = generator.normal(size=n), generator.normal(size=m)
    fine = 5.0 + 2.0 * x + noise * generator.normal(size=n)
    return fine, 1.0 + 1.5 * x, 1.0 + 1.5 * others


def test_it_finds_the_mean_within_its_stated_error():
    generator = np.random.default_rng(5)
    found = [controlled_mean(*draws(20, 400, 0.3, generator)) for _ in range(2000)]
    off = np.array([(one.mean - 5.0) / one.error for one in found])

    assert np.mean([one.mean for one in found]) == pytest.approx(5.0, abs=0.01)
    assert np.std(off) == pytest.approx(1.0, abs=0.12)


def test_its_gain_is_that_of_theory():
    found = controlled_mean(*draws(200_000, 4_000_000, 0.3, np.random.default_rng(6)))

    # rho^2 = 4/4.09; 1/(1 - rho^2 m/(n + m))
    assert found.gain == pytest.approx(1.0 / (1.0 - 4.0 / 4.09 * 20.0 / 21.0), rel=0.02)


def test_what_does_not_go_together_costs_nothing():
    generator = np.random.default_rng(7)
    fine, coarse, many = (generator.normal(size=(n, 2)) for n in (1000, 1000, 5000))
    coarse[:, 1] = many[:, 1] = 3.0

    found = controlled_mean(fine, coarse, many)

    assert found.gain == pytest.approx([1.0, 1.0], abs=0.02)
    assert found.mean[1] == pytest.approx(fine[:, 1].mean())


def test_too_few_or_unpaired_runs_are_refused():
    with pytest.raises(InputError, match="needs 5 pairs and 2 more, got 4 and 9"):
        controlled_mean(np.zeros(4), np.zeros(4), np.zeros(9))
    with pytest.raises(InputError, match="fine and coarse must pair"):
        controlled_mean(np.zeros(6), np.zeros(7), np.zeros(9))
