"""Gauss-Newton with Levenberg's damping on residuals: few runs where misfits have one valley."""

from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from scipy.optimize import lsq_linear

from ..errors import InputError
from .global_search import spread
from .problem import Evaluations, Problem, Spent, Trace

DIFFERENCE = 0.01  # of each range, for derivatives
DAMPING = 1e-3  # of the largest curvature, at first
WORTH = 1e-6  # foreseen drop, in shares of the sum of squares, below which a valley is done
SMALLEST = 1e-5  # step in shares of the ranges


@dataclass
class _Valley:
    """Where the search is: place, residuals there, their derivatives, and Levenberg's damping.

    ``fresh`` says that the derivatives were worked out here, not carried along.
    """

    place: np.ndarray
    residuals: np.ndarray
    derivatives: np.ndarray
    damping: float
    fresh: bool = True

    @property
    def squares(self):
        """Sum of squares of the residuals."""
        return float(self.residuals @ self.residuals)


def levenberg_search(problem: Problem, budget: int, seed: int, start=None) -> Trace:
    """Search by damped Gauss-Newton steps; start again elsewhere when a valley is done.

    Parameters
    ----------
    problem : Problem
        With residuals (``vectors``); derivatives are its ``tangents``, or else differences whose
        n points are evaluated at once.
    budget : int
    seed : int
    start : (n,) float64, optional
        First place in the unit cube, instead of its middle.

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
    theory.md (12.1), (12.2). Further starts follow a Sobol sequence.
    """
    if problem.vectors is None:
        raise InputError("method 'levenberg': needs a misfit that has residuals; take surrogate")
    kept, n = Evaluations(problem, budget), problem.n_parameters
    kept.steps = set()
    first = np.full(n, 0.5) if start is None else np.asarray(start, dtype=np.float64)
    starts = [first, *spread(n, budget, seed)]
    with suppress(Spent):
        for start in starts:
            _descend(kept, start)
    return kept.trace()


def _descend(kept, start):
    """Go down from a start until no step is worth a run."""
    residuals = kept.vectors(start[None])[1][0]
    kept.steps.add(len(kept.misfits) - 1)
    if not np.all(np.isfinite(residuals)):
        return
    derivatives = _derivatives(kept, start, residuals)
    valley = _Valley(start, residuals, derivatives, DAMPING)
    while True:
        step, worth = _step(valley)
        if worth < WORTH * valley.squares or np.max(np.abs(step)) < SMALLEST:
            if valley.fresh:
                return
            _refresh(kept, valley)
            continue
        found = kept.vectors((valley.place + step)[None])[1][0]
        _judge(kept, valley, step, found, worth)


def _step(valley):
    """Return the best step within the unit cube and the drop of squares that it promises."""
    j = valley.derivatives
    curvature = np.sum(j**2, axis=0)
    weight = np.sqrt(valley.damping * np.max(curvature))
    rows = np.vstack([j, weight * np.eye(len(valley.place))])
    wanted = np.concatenate([-valley.residuals, np.zeros(len(valley.place))])
    low, high = -valley.place, 1.0 - valley.place
    free = lsq_linear(rows, wanted, (low - 1e-12, high + 1e-12), method="bvls").x
    step = np.clip(free, low, high)
    left = valley.residuals + j @ step
    return step, valley.squares - float(left @ left)


def _judge(kept, valley, step, found, worth):
    """Take a step that went down, learn from every step, and set the damping by its gain."""
    squares = float(found @ found)
    gain = (valley.squares - squares) / worth
    if np.all(np.isfinite(found)):
        missed = found - valley.residuals - valley.derivatives @ step
        valley.derivatives = valley.derivatives + np.outer(missed, step) / (step @ step)
    if gain > 0.0:
        kept.steps.add(len(kept.misfits) - 1)
        valley.place, valley.residuals = valley.place + step, found
        valley.fresh = False
        if gain > 0.5:
            valley.damping /= 5.0
    elif valley.fresh:
        valley.damping *= 10.0
    else:
        _refresh(kept, valley)


def _refresh(kept, valley):
    """Work out the derivatives anew where the search is."""
    valley.derivatives = _derivatives(kept, valley.place, valley.residuals)
    valley.fresh = True


def _derivatives(kept, place, residuals):
    """Return the derivatives (k, n) of residuals at a place: tangents, or differences inwards."""
    if kept.problem.tangents is not None:
        return kept.tangents(place)
    sides = np.where(place > 0.5, -DIFFERENCE, DIFFERENCE)
    found = kept.vectors(place + np.diag(sides))[1]
    moved = (found - residuals).T / sides
    return np.where(np.isfinite(moved), moved, 0.0)
