"""What a search has asked for: counted, kept, and never more than its budget."""

import numpy as np

from ..errors import InputError
from .searching import Problem, Trace


class Spent(Exception):
    """The budget is used up."""


class Evaluations:
    """Evaluations of one search, asked for by places in the unit cube.

    Parameters
    ----------
    problem : Problem
    budget : int
        Evaluations allowed.

    Attributes
    ----------
    left : int
        Evaluations that are still allowed.
    misfits : list of float
        In the order of the trace.
    steps : set of int or None
        Rows that the search went on from; None for a method without such steps.

    Raises
    ------
    InputError
        If nothing may be evaluated.
    """

    def __init__(self, problem: Problem, budget: int):
        if budget < 1:
            raise InputError(f"search.budget: must be at least 1 evaluation, got {budget}")
        self.problem, self.left = problem, budget
        self.points, self.misfits, self.steps = [], [], None

    def at(self, unit) -> np.ndarray:
        """Return the misfits (m,) of places (m, n) in the unit cube.

        Raises
        ------
        Spent
            After as many of the first places as the budget allows.
        """
        return self._asked(unit, lambda points: (self.problem.evaluate(points),))[0]

    def vectors(self, unit) -> tuple[np.ndarray, np.ndarray]:
        """Return misfits (m,) and residuals (m, k) of places (m, n); raises as `at`."""
        return self._asked(unit, self.problem.vectors)

    def tangents(self, place) -> np.ndarray:
        """Return the derivatives (k, n) of residuals along the axes of the unit cube.

        They count as n evaluations, which have no row in the trace.

        Raises
        ------
        Spent
            If fewer than n are left.
        """
        if self.left < len(place):
            raise Spent
        self.left -= len(place)
        problem, point = self.problem, self.problem.points(place)
        ratio = np.log(np.where(problem.log, problem.high, 1.0)) - np.log(
            np.where(problem.log, problem.low, 1.0)
        )
        stretch = np.where(problem.log, point * ratio, problem.high - problem.low)
        return problem.tangents(point) * stretch

    def trace(self) -> Trace:
        """Return everything that was asked for."""
        misfits = np.array(self.misfits)
        if self.steps is None:
            before = np.minimum.accumulate(np.concatenate([[np.inf], misfits[:-1]]))
            accepted = misfits < before
        else:
            accepted = np.isin(np.arange(len(misfits)), list(self.steps))
        return Trace(np.array(self.points), misfits, accepted)

    def _asked(self, unit, ask):
        """Ask for as many of some places as are allowed, and keep them."""
        points = self.problem.points(unit)
        allowed = points[: self.left]
        if len(allowed):
            answer = ask(allowed)
            self.left -= len(allowed)
            self.points.extend(allowed)
            self.misfits.extend(answer[0].tolist())
        if len(allowed) < len(points):
            raise Spent
        return answer
