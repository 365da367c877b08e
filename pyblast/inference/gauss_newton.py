"""Damped Gauss-Newton minimisation with bounds, a prior and Broyden updates."""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from itertools import count
from typing import Any

import numpy as np
from scipy import linalg
from scipy.optimize import lsq_linear

from ..errors import InputError
from .global_search import sobol_points
from .parameter import Evaluations, Problem, Spent, Trace

LESS, MORE = 0.2, 10.0  # factors on the damping after a good step, and after one that failed
GOOD = 0.5  # share of the predicted decrease above which the damping falls


@dataclass(frozen=True, eq=False)
class LeastSquares:
    """Least-squares problem: residuals of unit variance, Gaussian prior, bounds.

    The objective is ``sum r^2 + sum precision (x - mean)^2`` with ``r = residual(x)``.

    Parameters
    ----------
    residual : callable
        ``(n,) -> array``, or None where the simulation fails.
    jacobian : callable
        ``(n,), array -> (n, ...)``: derivatives of the residual.
    mean, precision : (n,) float64, optional
        Of the prior; none by default.
    low, high : (n,) float64, optional
        Bounds.
    """

    residual: Callable
    jacobian: Callable
    mean: np.ndarray | float = 0.0
    precision: np.ndarray | float = 0.0
    low: np.ndarray | float = -np.inf
    high: np.ndarray | float = np.inf

    def objective(self, x, residual) -> float:
        """Return the sum of squares and prior, infinite where there is no finite residual."""
        if residual is None or not np.all(np.isfinite(residual)):
            return np.inf
        return float(np.sum(residual**2) + np.sum(self.precision * (x - self.mean) ** 2))

    def normal_equations(self, x, residual, jacobian) -> tuple[np.ndarray, np.ndarray]:
        """Return half the gradient (n,) and half the Gauss-Newton Hessian (n, n)."""
        rows = jacobian.reshape(len(x), residual.size)
        gradient = rows @ residual.ravel() + self.precision * (x - self.mean)
        hessian = rows @ rows.T
        hessian = 0.5 * (hessian + hessian.T)
        hessian[np.diag_indices(len(rows))] += self.precision
        return gradient, hessian


@dataclass(eq=False)
class Minimum:
    """State of a minimisation.

    Parameters
    ----------
    x : (n,) float64
    residual : array
    objective : float
    jacobian : (n, ...) float64
        The last one; ``fresh`` if it is evaluated at ``x`` and not updated.
    hessian : (n, n) float64
        Half the Gauss-Newton Hessian of the last step, the prior included.
    decrease : float
        Of the objective, predicted for the last step.
    """

    x: np.ndarray
    residual: np.ndarray
    objective: float
    jacobian: Any = None
    hessian: np.ndarray | None = None
    decrease: float = np.inf
    fresh: bool = False


def gauss_newton(
    problem: LeastSquares,
    x,
    residual,
    *,
    converged: Callable,
    rounds: int | None = None,
    jacobian=None,
    broyden: bool = False,
    damping: float = 0.0,
    accepted: Callable = lambda: None,
) -> Minimum:
    """Minimise by damped Gauss-Newton steps (Levenberg-Marquardt).

    Parameters
    ----------
    problem : LeastSquares
    x : (n,) float64
        Where to start.
    residual : array
        There.
    converged : callable
        ``(step, decrease, now)``: whether a step (n,) with this predicted decrease of the
        objective ends the minimisation; ``now`` is a `Minimum`.
    rounds : int, optional
        Steps at most.
    jacobian : (n, ...) float64, optional
        At the start; evaluated if not given.
    broyden : bool
        Whether each residual updates the Jacobian by Broyden's rule. It is evaluated again only
        when a step with the updated one fails or converges.
    damping : float
        Levenberg's, in shares of the largest diagonal element of the Hessian; adapted by the gain
        of each step. Zero for none.
    accepted : callable
        Called after each accepted step.

    Returns
    -------
    Minimum
        With the Jacobian and the Hessian of the last step.

    Notes
    -----
    Levenberg (1944), Broyden (1965); theory.md (12.1), (12.2).
    """
    now = Minimum(np.asarray(x), residual, problem.objective(x, residual), jacobian)
    now.fresh = jacobian is not None
    for _ in count() if rounds is None else range(rounds):
        if now.jacobian is None or not (now.fresh or broyden):
            _refresh(problem, now)
        step, now.decrease = _step(problem, now, damping)
        if converged(step, now.decrease, now):
            if now.fresh:
                break
            _refresh(problem, now)
            continue
        trial = problem.residual(now.x + step)
        gain = now.objective - problem.objective(now.x + step, trial)
        if broyden and np.isfinite(gain):
            missed = trial - now.residual - np.tensordot(step, now.jacobian, 1)
            now.jacobian = now.jacobian + np.multiply.outer(step / (step @ step), missed)
        if gain > 0.0:
            now.x, now.residual = now.x + step, trial
            now.objective, now.fresh = now.objective - gain, False
            damping *= LESS if gain > GOOD * now.decrease else 1.0
            accepted()
        elif not damping:
            break
        elif now.fresh:
            damping *= MORE
        else:
            _refresh(problem, now)
    return now


def _refresh(problem, now):
    """Evaluate the Jacobian at the present parameters."""
    now.jacobian = problem.jacobian(now.x, now.residual)
    now.fresh = True


def _step(problem, now, damping):
    """Return the best step within the bounds, and the decrease of the objective it predicts."""
    gradient, now.hessian = problem.normal_equations(now.x, now.residual, now.jacobian)
    diagonal = np.max(np.diag(now.hessian), initial=0.0)
    damped = now.hessian + damping * diagonal * np.eye(len(now.x))
    low, high = (np.broadcast_to(b, now.x.shape) - now.x for b in (problem.low, problem.high))
    step = _bounded_minimum(damped, gradient, low, high)
    return step, float(-2.0 * gradient @ step - step @ now.hessian @ step)


def _bounded_minimum(hessian, gradient, low, high):
    """Return the step within bounds that minimises ``step H step + 2 g step``."""
    value, vector = linalg.eigh(hessian)
    value = np.maximum(value, np.finfo(float).eps * np.max(value, initial=1e-300))
    wanted = -(vector.T @ gradient) / np.sqrt(value)
    step = vector @ (wanted / np.sqrt(value))
    if np.any(step < low) or np.any(step > high):
        rows = np.sqrt(value)[:, None] * vector.T
        step = lsq_linear(rows, wanted, (low - 1e-12, high + 1e-12), method="bvls").x
    return np.clip(step, low, high)


DIFFERENCE = 0.01  # of each range, for derivatives
DAMPING = 1e-3  # of the largest diagonal element of the Hessian, at first
LEAST_DECREASE = 1e-6  # predicted, as a share of the sum of squares: smaller is convergence
LEAST_STEP = 1e-5  # in shares of the ranges


def levenberg_search(problem: Problem, budget: int, seed: int) -> Trace:
    """Gauss-Newton search with Broyden updates, from several starts.

    Parameters
    ----------
    problem : Problem
        With residuals (``vectors``); derivatives are differences, whose n points are evaluated at
        once.
    budget : int
    seed : int

    Returns
    -------
    Trace
        That of a smaller budget is its beginning.

    Raises
    ------
    InputError
        If the problem has no residuals.

    Notes
    -----
    theory.md (12.1), (12.2). After convergence it starts again at points of a Sobol sequence.
    """
    if problem.vectors is None:
        raise InputError("method 'levenberg': needs a misfit that has residuals; take random")
    evaluations, n = Evaluations(problem, budget), problem.n_parameters
    steps = evaluations.steps = set[int]()

    def simulate(x):
        return evaluations.vectors(x[None])[1][0]

    def accepted():
        steps.add(len(evaluations.misfits) - 1)

    squares = LeastSquares(simulate, lambda x, r: _jacobian(evaluations, x, r), low=0.0, high=1.0)
    with suppress(Spent):
        for x in [np.full(n, 0.5), *sobol_points(n, budget, seed)]:
            residual = simulate(x)
            accepted()
            if np.all(np.isfinite(residual)):
                gauss_newton(
                    squares, x, residual, converged=_is_minimum, broyden=True, damping=DAMPING,
                    accepted=accepted,
                )  # fmt: skip
    return evaluations.trace()


def _is_minimum(step, decrease, now):
    """Tell whether a step is too small for another run."""
    return decrease < LEAST_DECREASE * now.objective or np.max(np.abs(step)) < LEAST_STEP


def _jacobian(evaluations, x, residual):
    """Return the Jacobian (n, k) of the residuals by inward differences."""
    sides = np.where(x > 0.5, -DIFFERENCE, DIFFERENCE)
    slopes = (evaluations.vectors(x + np.diag(sides))[1] - residual) / sides[:, None]
    return np.where(np.isfinite(slopes), slopes, 0.0)
