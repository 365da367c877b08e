"""Global searches: annealing and random sampling."""

import math
from dataclasses import dataclass

import numpy as np
from scipy.stats import qmc

from .parameter import Evaluations, Problem, Trace

SAMPLES = 5  # random points for the largest and smallest misfit of eq. (15)


@dataclass(frozen=True)
class Schedule:
    """Annealing schedule: decrease of temperature and step length; theory.md (11.3), (11.4).

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
    """Tell whether the Metropolis rule accepts a point.

    Parameters
    ----------
    rise : float
        Misfit of the new point less that of the current one.
    temperature : float
    draw : float
        Uniform in 0 to 1.

    Notes
    -----
    A decrease is accepted, a rise if ``draw < exp(-rise / temperature)``; theory.md (11.2). A
    step between two failed points is accepted, too.
    """
    return not rise > 0.0 or draw < math.exp(-rise / temperature)


def paper(problem: Problem, budget: int, seed: int) -> Trace:
    """Anneal with the schedule of the paper: T0 = 1000, aT = 0.9, Dr0 = 20 %, ar = 0.85."""
    return anneal(problem, budget, np.random.default_rng(seed), PAPER)


def paper_eq15(problem: Problem, budget: int, seed: int) -> Trace:
    """Anneal with the schedule of the paper, but T0 = Fmax - Fmin of its equation (15).

    Both from five random points, or half the budget if that is less; these count as evaluations.
    """
    rng = np.random.default_rng(seed)
    count = min(SAMPLES, budget // 2)
    if count < 2:
        return anneal(problem, budget, rng, PAPER)
    points = problem.points(rng.random((count, problem.n_parameters)))
    misfits = problem.evaluate(points)
    finite = misfits[np.isfinite(misfits)]
    rise = float(np.ptp(finite)) if len(finite) else 0.0
    first = Trace(points, misfits, np.zeros(count, dtype=bool))
    schedule = Schedule(rise or PAPER.temperature)
    then = anneal(problem, budget - count, rng, schedule)
    return Trace(
        *(np.concatenate([getattr(t, name) for t in (first, then)])
          for name in ("points", "misfits", "accepted"))
    )  # fmt: skip


def anneal(problem: Problem, budget: int, rng: np.random.Generator, schedule: Schedule) -> Trace:
    """Anneal from the centre of the ranges, with one move at each temperature.

    Parameters
    ----------
    problem : Problem
    budget : int
        The centre and ``budget - 1`` moves.
    rng : numpy Generator
    schedule : Schedule

    Notes
    -----
    A move is uniform within plus and minus the step of each parameter, all at once, clipped at the
    bounds (assumed: the paper does not state it).
    """
    x = np.full(problem.n_parameters, 0.5)
    points = [problem.points(x)]
    misfits = [float(problem.evaluate(points[0][None])[0])]
    accepted, current = [True], misfits[0]
    for move in range(1, budget):
        step = schedule.step_of(move) * rng.uniform(-1.0, 1.0, problem.n_parameters)
        trial = np.clip(x + step, 0.0, 1.0)
        points.append(problem.points(trial))
        misfits.append(float(problem.evaluate(points[-1][None])[0]))
        accepted.append(accepts(misfits[-1] - current, schedule.temperature_of(move), rng.random()))
        if accepted[-1]:
            x, current = trial, misfits[-1]
    return Trace(np.array(points), np.array(misfits), np.array(accepted))


def random_search(problem: Problem, budget: int, seed: int) -> Trace:
    """Evaluate random points, uniform over the ranges.

    Parameters
    ----------
    problem : Problem
    budget : int
    seed : int

    Returns
    -------
    Trace
        That of a smaller budget is its beginning.
    """
    evaluations = Evaluations(problem, budget)
    evaluations.at(np.random.default_rng(seed).random((budget, problem.n_parameters)))
    return evaluations.trace()


def sobol_points(n_parameters, count, seed) -> np.ndarray:
    """Return points (count, n_parameters) of a scrambled Sobol sequence.

    The first points of a longer sequence are those of a shorter one, unlike in Latin hypercubes.
    """
    sobol = qmc.Sobol(n_parameters, rng=np.random.default_rng(seed))
    return sobol.random(2 ** math.ceil(math.log2(max(2, count))))[:count]
