"""Fit of records: Gauss-Newton steps to the most probable coordinates, Broyden's rule between."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ..errors import SolverError
from .error_model import Posterior
from .parameter import Spent

ENOUGH = 0.2  # posterior deviations: a step below ends the fit
NEAR = 3.0  # posterior deviations: a step below, after a long way, asks for new derivatives
LONG = 0.14  # of the longest step, above which Broyden's rule updates the derivatives
BEYOND = 1.0 + 1e-6  # longest steps: one that was cut to the longest goes no longer way
STEPS = 10
HALVINGS = 2


@dataclass(frozen=True, eq=False)
class Coordinates:
    """Coordinates of a fit, their normal priors and ranges.

    Parameters
    ----------
    mean, deviation : (n,) float64
        Of the priors.
    low, high : (n,) float64
        Ranges.
    longest : (n,) float64
        Steps.
    moves : (n,) bool
        Which a step changes; the others follow from their derivatives alone.
    sought : (n,) bool
        Those whose steps tell whether the fit has ended.
    blur : (n,) float64
        Deviations beside those of the posterior, within which steps mean nothing.
    """

    mean: np.ndarray
    deviation: np.ndarray
    low: np.ndarray
    high: np.ndarray
    longest: np.ndarray
    moves: np.ndarray
    sought: np.ndarray
    blur: np.ndarray


@dataclass(eq=False)
class FitState:
    """State of a fit.

    Parameters
    ----------
    x : (n,) float64
        Coordinates.
    motion : (n_blasts, n_receivers, 3, n_samples) float64, m/s
        Simulated there.
    slopes : (n, n_blasts, n_receivers, 3, n_samples) float64, m/s
        Derivatives of the motion.
    """

    x: np.ndarray
    motion: np.ndarray
    slopes: np.ndarray

    def copy(self) -> "FitState":
        """Return a copy, from which another fit may begin."""
        return FitState(self.x.copy(), self.motion.copy(), self.slopes.copy())


class FitProblem(Protocol):
    """Problem of a fit: how motion follows from coordinates, and what records tell of them."""

    coordinates: Coordinates
    renews: bool  # whether derivatives cost no run, and are taken anew after each step

    def simulated(self, x: np.ndarray) -> np.ndarray | None:
        """Return the motion at coordinates (n,); None where these are impossible.

        Raises
        ------
        Spent, SolverError
            No more runs are allowed, or one fails: the fit ends with what is known.
        """
        ...

    def derive(self, state: FitState) -> None:
        """Take the derivatives at a state anew."""
        ...

    def posterior(self, state: FitState) -> Posterior:
        """Return the posterior of coordinates less prior means, linear around a state.

        The first n columns are those of the coordinates.
        """
        ...

    def worsened(self, before: FitState, after: FitState) -> bool:
        """Tell whether a state explains the records less than the one before."""
        ...

    def reached(self, state: FitState, posterior: Posterior) -> None:
        """Note a state that a step has reached."""
        ...

    def ended(self, reason: str) -> None:
        """Note why no further step could be taken."""
        ...


def step_of(problem: FitProblem, state: FitState, posterior: Posterior) -> tuple[np.ndarray, float]:
    """Return the step to the posterior mean, (n,), and its size in posterior deviations.

    It stays within the ranges, and no coordinate goes further than its longest step.
    """
    at, n = problem.coordinates, len(state.x)
    wanted = np.clip(at.mean + posterior.mean[:n], at.low, at.high)
    move = np.where(at.moves, wanted - state.x, 0.0)
    deviation = np.hypot(posterior.deviation[:n], at.blur)
    size = np.max(np.abs(move[at.sought]) / deviation[at.sought], initial=0.0)
    return move / max(1.0, float(np.max(np.abs(move) / at.longest, initial=0.0))), float(size)


def minimise(problem: FitProblem, state: FitState, steps: int | None = None) -> Posterior:
    """Take steps from a state until they are small, and return the posterior at the last.

    Parameters
    ----------
    problem : FitProblem
    state : FitState
        Moved to where the fit ends.
    steps : int, optional
        At most; `STEPS` by default.

    Notes
    -----
    theory.md (12.1), (12.2), (12.5). A step that explains less is shortened; derivatives are taken
    anew where one fails, and near the end of a long way.
    """
    away, fresh = np.zeros_like(state.x), True
    posterior = problem.posterior(state)
    for _ in range(STEPS if steps is None else steps):
        move, size = step_of(problem, state, posterior)
        if size < ENOUGH:
            break
        try:
            if size < NEAR and np.any(np.abs(away) > BEYOND * problem.coordinates.longest):
                problem.derive(state)
                away[:], fresh = 0.0, True
            else:
                moved = _advanced(problem, state, move)
                if moved is None and fresh:
                    problem.ended("no shorter step explains more")
                    break
                away, fresh = (away, True) if moved is None else (away + moved, problem.renews)
                if fresh:
                    problem.derive(state)
        except Spent:
            break
        except SolverError as error:
            problem.ended(str(error))
            break
        posterior = problem.posterior(state)
        problem.reached(state, posterior)
    return posterior


def _advanced(problem, state, move):
    """Run at a step, shortened where less is explained; return the one taken, None if none is."""
    longest = problem.coordinates.longest
    for _ in range(1 + HALVINGS):
        x = state.x + move
        motion = problem.simulated(x)
        if motion is not None:
            missed = motion - state.motion - np.tensordot(move, state.slopes, 1)
            share = move / longest
            if share @ share > LONG**2:  # short ones would only spoil the derivatives
                update = np.multiply.outer(share / longest / (share @ share), missed)
                state.slopes = state.slopes + update
            if not problem.worsened(state, FitState(x, motion, state.slopes)):
                state.x, state.motion = x, motion
                return move
        move = 0.5 * move
    return None
