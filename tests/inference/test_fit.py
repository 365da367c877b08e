"""Steps of a fit on linear motion: Broyden's rule, steps that are shortened, bounds."""

from types import SimpleNamespace

import numpy as np
import pytest

from pyblast.inference.fit import Coordinates, FitState, minimise

RNG = np.random.default_rng(5)
TRUE = RNG.normal(size=(3, 1, 2, 3, 4))  # slopes of the motion
LONGEST = np.array([0.5, 2.0, 1.0])


class Linear:
    """Linear motion, of which a fit wants coordinates."""

    renews = False

    def __init__(self, wanted, worse=0, high=10.0):
        ones = np.ones(3)
        self.coordinates = Coordinates(
            0.0 * ones, ones, -10.0 * ones, high * ones, LONGEST, ones > 0, ones > 0, 0.0 * ones
        )
        self.wanted, self.worse, self.said = np.array(wanted), worse, []

    def simulated(self, x):
        return np.tensordot(x, TRUE, 1)

    def derive(self, state):
        state.slopes = TRUE.copy()

    def posterior(self, _):
        return SimpleNamespace(mean=self.wanted, deviation=0.01 * np.ones(3))

    def worsened(self, *_):
        self.worse -= 1
        return self.worse >= 0

    def reached(self, *_):
        pass

    def ended(self, reason):
        self.said.append(reason)


def ended(problem, steps=1):
    """Return the state after some steps with wrong slopes."""
    state = FitState(np.zeros(3), np.zeros(TRUE.shape[1:]), 1.3 * TRUE + 0.2)
    minimise(problem, state, steps)
    return state


def test_after_a_step_derivatives_give_the_change_of_motion_along_it():
    state = ended(Linear([0.4, -1.5, 0.7]))

    np.testing.assert_allclose(state.x, [0.4, -1.5, 0.7])
    np.testing.assert_allclose(np.tensordot(state.x, state.slopes, 1), state.motion, atol=1e-12)


def test_derivatives_stay_across_a_step_in_units_of_the_longest_ones():
    state = ended(Linear([0.4, -1.5, 0.7]))

    share = state.x / LONGEST
    across = np.cross(share, [1.0, 0.0, 0.0]) * LONGEST
    before = np.tensordot(across, 1.3 * TRUE + 0.2, 1)
    np.testing.assert_allclose(np.tensordot(across, state.slopes, 1), before, atol=1e-12)


@pytest.mark.parametrize(("worse", "share"), [(0, 1.0), (1, 0.5), (2, 0.25), (3, 0.0)])
def test_a_step_that_explains_less_is_halved_twice_at_most(worse, share):
    problem = Linear([0.4, -1.5, 0.7], worse)

    state = ended(problem)

    np.testing.assert_allclose(state.x, share * np.array([0.4, -1.5, 0.7]))
    assert bool(problem.said) == (share == 0.0)


def test_no_coordinate_goes_beyond_its_longest_step_or_its_range():
    far, held = ended(Linear([1.0, 0.0, 0.5])), ended(Linear([0.4, 5.0, 0.2], high=0.3))

    np.testing.assert_allclose(far.x, [0.5, 0.0, 0.25])
    np.testing.assert_allclose(held.x, [0.3, 0.3, 0.2])
