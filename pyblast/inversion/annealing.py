"""Simulated annealing with the settings of the paper."""

import math
from dataclasses import dataclass

import numpy as np

from .searching import Problem, Trace

SAMPLES = 5  # random points that tell the largest and smallest misfit of eq. (15)


@dataclass(frozen=True)
class Schedule:
    """How temperature and step length fall; theory.md (11.3), (11.4).

    Parameters
    ----------
    temperature : float
        T0, in the unit of the misfit.
    cooling : float
        aT: the temperature of move k is ``temperature * cooling**k``.
    step : float
        Dr0, as a share of each range.
    shortening : float
        ar: the step of move k is ``step * shortening**(k - 1)``.
    """

    temperature: float = 1000.0
    cooling: float = 0.9
    step: float = 0.2
    shortening: float = 0.85

    def temperature_of(self, move):
        """Return the temperature of a move, counted from 1."""
        return self.temperature * self.cooling**move

    def step_of(self, move):
        """Return the longest step of a move, counted from 1, as a share of each range."""
        return self.step * self.shortening ** (move - 1)


PAPER = Schedule()


def accepts(rise, temperature, draw):
    """Tell whether the Metropolis rule takes a point.

    Parameters
    ----------
    rise : float
        Misfit of the new point less that of the current one.
    temperature : float
    draw : float
        Even in 0 to 1.

    Notes
    -----
    A fall is taken; a rise where ``draw < exp(-rise / temperature)``; theory.md (11.2). So is
    any step between two points that could not be evaluated.
    """
    return not rise > 0.0 or draw < math.exp(-rise / temperature)


def paper(problem: Problem, budget: int, seed: int) -> Trace:
    """Anneal as the paper says: T0 = 1000, aT = 0.9, Dr0 = 20 % of each range, ar = 0.85."""
    return anneal(problem, budget, np.random.default_rng(seed), PAPER)


def paper_eq15(problem: Problem, budget: int, seed: int) -> Trace:
    """Anneal as the paper says, but from T0 = Fmax - Fmin of its equation (15).

    Both are those of five random points, or of half the budget where that is less; these count.
    """
    rng = np.random.default_rng(seed)
    count = min(SAMPLES, budget // 2)
    if count < 2:
        return anneal(problem, budget, rng, PAPER)
    points = problem.points(rng.random((count, problem.n_parameters)))
    misfits = problem.evaluate(points)
    finite = misfits[np.isfinite(misfits)]
    spread = float(np.ptp(finite)) if len(finite) else 0.0
    first = Trace(points, misfits, np.zeros(count, dtype=bool))
    schedule = Schedule(spread or PAPER.temperature)
    then = anneal(problem, budget - count, rng, schedule)
    return Trace(
        *(np.concatenate([getattr(t, name) for t in (first, then)])
          for name in ("points", "misfits", "accepted"))
    )  # fmt: skip


def anneal(problem: Problem, budget: int, rng: np.random.Generator, schedule: Schedule) -> Trace:
    """Walk from the centre of the ranges, one move at each temperature.

    Parameters
    ----------
    problem : Problem
    budget : int
        The centre and ``budget - 1`` moves.
    rng : numpy Generator
    schedule : Schedule

    Notes
    -----
    A move is even in plus and minus the step of each parameter, all at once, clipped at the
    bounds (assumed: the paper does not say).
    """
    here = np.full(problem.n_parameters, 0.5)
    points = [problem.points(here)]
    misfits = [float(problem.evaluate(points[0][None])[0])]
    accepted, current = [True], misfits[0]
    for move in range(1, budget):
        step = schedule.step_of(move) * rng.uniform(-1.0, 1.0, problem.n_parameters)
        there = np.clip(here + step, 0.0, 1.0)
        points.append(problem.points(there))
        misfits.append(float(problem.evaluate(points[-1][None])[0]))
        accepted.append(accepts(misfits[-1] - current, schedule.temperature_of(move), rng.random()))
        if accepted[-1]:
            here, current = there, misfits[-1]
    return Trace(np.array(points), np.array(misfits), np.array(accepted))
