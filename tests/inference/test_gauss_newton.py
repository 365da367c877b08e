"""Steps of least squares with a prior and bounds, against the closed form of linear problems."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from pyblast.inference.gauss_newton import LeastSquares, gauss_newton

RNG = np.random.default_rng(3)
A, D = RNG.normal(size=(12, 3)), RNG.normal(size=12)
MEAN, PRECISION, START = np.array([0.5, -1.0, 2.0]), np.array([0.3, 4.0, 1.0]), np.ones(3)


def problem(**parts):
    return LeastSquares(lambda x: A @ x - D, lambda _, __: A.T.copy(), **parts)


def first_step(one):
    """Return the state after one step, and the decrease that it predicted."""
    start = problem().residual(START)
    return gauss_newton(one, START, start, converged=lambda *_: False, rounds=1)


def test_one_step_reaches_the_minimum_of_a_linear_problem_with_its_prior():
    one = problem(mean=MEAN, precision=PRECISION)

    end = first_step(one)

    wanted = np.linalg.solve(A.T @ A + np.diag(PRECISION), A.T @ D + PRECISION * MEAN)
    assert end.x == pytest.approx(wanted, rel=1e-9)
    before = one.objective(START, one.residual(START))
    assert end.decrease == pytest.approx(before - end.objective, rel=1e-9)


def test_a_step_within_bounds_is_the_best_there():
    low, high = np.array([0.9, 0.2, 0.0]), np.array([1.2, 1.5, 3.0])

    end = first_step(problem(low=low, high=high))

    assert end.x == pytest.approx(lsq_linear(A, D, (low, high)).x, abs=1e-6)


def test_broydens_update_follows_a_linear_problem_along_its_step():
    wrong = A.T + 0.1 * RNG.normal(size=(3, 12))

    end = gauss_newton(
        problem(), START, problem().residual(START), converged=lambda *_: False, rounds=1,
        jacobian=wrong, broyden=True,
    )  # fmt: skip

    step = end.x - START
    assert step @ end.jacobian == pytest.approx(A @ step, rel=1e-9)
