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

SHORTER = 0.4  # factor on a step that does not decrease the objective
LESS, MORE = 0.2, 10.0  # factors on the damping after a good step, and after one that failed
GOOD = 0.5  # share of the predicted decrease above which the damping falls


def _squares(residual):
    """Return the sum of squares: the misfit of independent residuals of unit variance."""
    return float(np.sum(residual**2))


@dataclass(frozen=True, eq=False)
class LeastSquares:
    """Least-squares problem: misfit of residuals, Gaussian prior, bounds.

    The objective is ``misfit(r) + sum precision (x - mean)^2`` with ``r = residual(simulate(x))``.

    Parameters
    ----------
    simulate : callable
        ``(n,) -> array``, or None where the simulation fails.
    jacobian : callable, optional
        ``(n,), array -> (n, ...)``: derivatives of the residual, or of the simulation if
        ``whiten`` is given. None if only the first Jacobian is available.
    residual : callable, optional
        Residual of a simulation; the simulation itself by default.
    whiten : callable, optional
        Linear map from changes of the simulation to changes of the residual.
    misfit : callable, optional
        Of a residual; the sum of squares by default.
    weights : callable, optional
        ``(..., m) -> (...)`` of a residual: weights of its squares with which these have the
        gradient of the misfit; one by default.
    mean, precision : (n,) float64, optional
        Of the prior; none by default.
    low, high : (n,) float64, optional
        Bounds.
    free : (n,) bool, optional
        Which parameters may change; all by default.
    """

    simulate: Callable
    jacobian: Callable | None = None
    residual: Callable = lambda simulated: simulated
    whiten: Callable | None = None
    misfit: Callable = _squares
    weights: Callable = lambda residual: np.ones(residual.shape[:-1])
    mean: np.ndarray | float = 0.0
    precision: np.ndarray | float = 0.0
    low: np.ndarray | float = -np.inf
    high: np.ndarray | float = np.inf
    free: np.ndarray | None = None

    def objective(self, x, simulated) -> float:
        """Return misfit and prior, infinite where there is no finite simulation."""
        if simulated is None or not np.all(np.isfinite(simulated)):
            return np.inf
        prior = np.sum(self.precision * (x - self.mean) ** 2)
        return float(self.misfit(self.residual(simulated)) + prior)

    def change(self, before, after):
        """Return the change between two simulations of what the Jacobian differentiates."""
        if self.whiten is None:
            before, after = self.residual(before), self.residual(after)
        return after - before

    def normal_equations(self, x, simulated, jacobian) -> tuple[np.ndarray, np.ndarray]:
        """Return half the gradient (n,) and half the Gauss-Newton Hessian (n, n)."""
        residual = self.residual(simulated)
        rows = jacobian if self.whiten is None else self.whiten(jacobian)
        return normal_equations(
            rows, residual, self.weights(residual), self.precision,
            self.precision * (x - self.mean),
        )  # fmt: skip


def normal_equations(
    rows: np.ndarray,
    residual: np.ndarray,
    weights: np.ndarray,
    precision: np.ndarray | float = 1.0,
    slope: np.ndarray | float = 0.0,
) -> tuple[np.ndarray, np.ndarray]:
    """Return half the gradient and half the Gauss-Newton Hessian of weighted least squares.

    Parameters
    ----------
    rows : (n, ..., m) float64
        Jacobian of the residual.
    residual : (..., m) float64
    weights : (...) float64
    precision, slope : (n,) float64 or float
        Of the prior: its inverse variances, and half of its gradient.

    Returns
    -------
    gradient : (n,) float64
    hessian : (n, n) float64
    """
    shape = len(rows), residual.size
    scaled = (rows * weights[..., None]).reshape(shape)
    gradient = scaled @ residual.ravel() + slope
    hessian = scaled @ rows.reshape(shape).T
    hessian = 0.5 * (hessian + hessian.T)
    hessian[np.diag_indices(len(rows))] += precision
    return gradient, hessian


@dataclass(eq=False)
class Minimum:
    """State of a minimisation.

    Parameters
    ----------
    x : (n,) float64
    simulated : array
    objective : float
    jacobian : (n, ...) float64
        The last one; ``fresh`` if it is evaluated at ``x`` and not updated.
    hessian : (n, n) float64
        Half the Gauss-Newton Hessian of the last step, the prior included.
    decrease : float
        Of the objective, predicted for the last step.
    """

    x: np.ndarray
    simulated: np.ndarray
    objective: float
    jacobian: Any = None
    hessian: np.ndarray | None = None
    decrease: float = np.inf
    fresh: bool = False


def gauss_newton(
    problem: LeastSquares,
    x,
    simulated,
    *,
    converged: Callable,
    rounds: int | None = None,
    jacobian=None,
    broyden: bool = False,
    damping: float = 0.0,
    backtracks: int = 0,
    longest: float | np.ndarray = np.inf,
    least_gain: float = 0.0,
    accepted: Callable = lambda: None,
) -> Minimum:
    """Minimise by damped Gauss-Newton steps (Levenberg-Marquardt).

    Parameters
    ----------
    problem : LeastSquares
    x : (n,) float64
        Where to start.
    simulated : array
        The simulation there.
    converged : callable
        ``(step, decrease, now)``: whether a step (n,) with this predicted decrease of the
        objective ends the minimisation; ``now`` is a `Minimum`.
    rounds : int, optional
        Steps at most.
    jacobian : (n, ...) float64, optional
        At the start; evaluated if not given.
    broyden : bool
        Whether each simulation updates the Jacobian by Broyden's rule. It is evaluated again only
        when a step with the updated one fails or converges.
    damping : float
        Levenberg's, in shares of the largest diagonal element of the Hessian; adapted by the gain
        of each step. Zero for none.
    backtracks : int
        How often a step that does not decrease the objective is shortened; without damping.
    longest : (n,) float64 or float
        A step is scaled so that no parameter moves further.
    least_gain : float
        A smaller decrease of the objective ends the minimisation.
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
    now = Minimum(np.asarray(x), simulated, problem.objective(x, simulated), jacobian)
    now.fresh = jacobian is not None
    if not len(now.x):
        if jacobian is None and problem.jacobian is not None:
            jacobian = problem.jacobian(now.x, simulated)
        now.jacobian = jacobian
        now.hessian = np.zeros((0, 0))
        return now
    for _ in count() if rounds is None else range(rounds):
        if now.jacobian is None or not (now.fresh or broyden or problem.jacobian is None):
            _refresh(problem, now)
        step, now.decrease = _step(problem, now, damping, longest)
        if converged(step, now.decrease, now):
            if now.fresh or problem.jacobian is None:
                break
            _refresh(problem, now)
            continue
        before, gain = now.objective, -np.inf
        for shortening in SHORTER ** np.arange(1 + backtracks):
            moved = shortening * step
            trial = problem.simulate(now.x + moved)
            gain = before - problem.objective(now.x + moved, trial)
            if broyden and now.jacobian is not None and np.isfinite(gain):
                missed = problem.change(now.simulated, trial) - np.tensordot(moved, now.jacobian, 1)
                now.jacobian = now.jacobian + np.multiply.outer(moved / (moved @ moved), missed)
            if gain > 0.0:
                break
        if gain > 0.0:
            now.x, now.simulated = now.x + moved, trial
            now.objective, now.fresh = before - gain, False
            damping *= LESS if gain > GOOD * now.decrease else 1.0
            accepted()
            if gain < least_gain:
                break
        elif not damping:
            break
        elif now.fresh or problem.jacobian is None:
            damping *= MORE
        else:
            _refresh(problem, now)
    return now


def _refresh(problem, now):
    """Evaluate the Jacobian at the present parameters."""
    now.jacobian = problem.jacobian(now.x, now.simulated)
    now.fresh = True


def _step(problem, now, damping, longest):
    """Return the best step within the bounds, and the decrease of the objective it predicts."""
    gradient, now.hessian = problem.normal_equations(now.x, now.simulated, now.jacobian)
    free = np.ones(len(now.x), dtype=bool) if problem.free is None else problem.free
    hessian = now.hessian[np.ix_(free, free)]
    damped = hessian + damping * np.max(np.diag(hessian), initial=0.0) * np.eye(len(hessian))
    low, high = ((np.broadcast_to(b, now.x.shape) - now.x)[free] for b in
                 (problem.low, problem.high))  # fmt: skip
    step = np.zeros(len(now.x))
    step[free] = _bounded_minimum(damped, gradient[free], low, high)
    step *= min(1.0, np.min(longest / np.maximum(np.abs(step), 1e-12)))
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
