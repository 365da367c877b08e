"""Search problems and global searches: annealing, differential evolution, random sampling."""

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.optimize import differential_evolution
from scipy.stats import qmc

from ..errors import InputError


@dataclass(frozen=True, eq=False)
class Problem:
    """A misfit over a box, without a word about what the numbers mean.

    Parameters
    ----------
    low, high : (n,) float64
        Bounds, in the units of the parameters.
    log : (n,) bool
        Whether a parameter is searched on a logarithmic scale.
    evaluate : callable
        ``(m, n) -> (m,)`` misfits of points within the bounds, in their order. The m evaluations
        run side by side, so ask for many at once where a method allows it. Infinite where a point
        can't be evaluated. The same point always has the same misfit.
    vectors : callable, optional
        ``(m, n) -> (m,), (m, k)``: misfits as before and residuals, whose sum of squares falls as
        the misfit does. Costs what misfits cost.
    tangents : callable, optional
        ``(n,) -> (k, n)``: derivatives of the residuals at a point by its n parameters. Costs n
        evaluations.
    """

    low: np.ndarray
    high: np.ndarray
    log: np.ndarray
    evaluate: Callable[[np.ndarray], np.ndarray]
    vectors: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]] | None = None
    tangents: Callable[[np.ndarray], np.ndarray] | None = None

    def __post_init__(self):
        for name, kind in (("low", np.float64), ("high", np.float64), ("log", bool)):
            object.__setattr__(self, name, np.array(getattr(self, name), kind, ndmin=1))
        if not self.low.shape == self.high.shape == self.log.shape:
            raise InputError("problem: low, high and log must have one value for each parameter")
        if not np.all(self.low < self.high):
            raise InputError(f"problem.low: must be below high, got {self.low} and {self.high}")
        if np.any(self.log & (self.low <= 0.0)):
            raise InputError(f"problem.low: must be positive where log is set, got {self.low}")

    @property
    def n_parameters(self) -> int:
        """Number of parameters."""
        return len(self.low)

    def points(self, unit) -> np.ndarray:
        """Return the points (..., n) of places in the unit cube (..., n)."""
        unit = np.asarray(unit, dtype=np.float64)
        low, high = self._scaled(self.low), self._scaled(self.high)
        values = low + np.clip(unit, 0.0, 1.0) * (high - low)
        values = np.where(self.log, np.exp(np.where(self.log, values, 0.0)), values)
        values = np.where(unit <= 0.0, self.low, np.where(unit >= 1.0, self.high, values))
        return np.clip(values, self.low, self.high)

    def unit(self, points) -> np.ndarray:
        """Return the places in the unit cube (..., n) of points (..., n)."""
        low, high = self._scaled(self.low), self._scaled(self.high)
        return (self._scaled(np.asarray(points, dtype=np.float64)) - low) / (high - low)

    def _scaled(self, values):
        """Return values, logarithms of those that are searched so."""
        return np.where(self.log, np.log(np.where(self.log, values, 1.0)), values)


@dataclass(frozen=True, eq=False)
class Trace:
    """Everything that a search asked for, in its order.

    Parameters
    ----------
    points : (m, n) float64
    misfits : (m,) float64
    accepted : (m,) bool
        Whether the search went on from this point; for methods without such a step, whether it
        was the best until then.
    """

    points: np.ndarray
    misfits: np.ndarray
    accepted: np.ndarray

    @property
    def best(self) -> int:
        """Row of the lowest misfit, the first of several."""
        return int(np.argmin(self.misfits))


class Search(Protocol):
    """A method: a function of a problem, a number of evaluations and a seed."""

    def __call__(self, problem: Problem, budget: int, seed: int) -> Trace:
        """Evaluate at most ``budget`` points; the same seed gives the same trace."""
        ...


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


def random_search(problem: Problem, budget: int, seed: int) -> Trace:
    """Evaluate random places, even over the ranges.

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
    kept = Evaluations(problem, budget)
    kept.at(np.random.default_rng(seed).random((budget, problem.n_parameters)))
    return kept.trace()


def sobol_search(problem: Problem, budget: int, seed: int) -> Trace:
    """Evaluate a scrambled Sobol sequence; parameters and result as `random_search`."""
    kept = Evaluations(problem, budget)
    kept.at(spread(problem.n_parameters, budget, seed))
    return kept.trace()


def spread(n_parameters, count, seed) -> np.ndarray:
    """Return evenly spread places (count, n_parameters): a scrambled Sobol sequence.

    The first places of a longer sequence are those of a shorter one, which Latin hypercubes do
    not give.
    """
    sobol = qmc.Sobol(n_parameters, rng=np.random.default_rng(seed))
    return sobol.random(2 ** math.ceil(math.log2(max(2, count))))[:count]


FIRST = 8  # evenly spread places, one batch; the best of them is the start
STEP = 0.2  # of each range, at first
SHARE = 0.2  # of steps that are accepted while the step is kept
GROWTH = 1.5  # of the step by one that is accepted
HEAT = 0.5  # temperature over the usual drop of the misfit, at first
COOLING = 0.9  # of the temperature by each evaluation
SMALLEST = 1e-3  # step at which a chain ends


def adaptive_annealing(problem: Problem, budget: int, seed: int) -> Trace:
    """Search by Metropolis steps whose size keeps one in five accepted.

    Parameters
    ----------
    problem : Problem
    budget : int
    seed : int

    Returns
    -------
    Trace
        That of a smaller budget is its beginning.

    Notes
    -----
    The temperature starts at half the median distance of the first misfits to their least, so
    that it suits misfits of any size; a step grows or shrinks by what is accepted (Rechenberg's
    rule). A chain ends when its step is small; the next starts at a random place.
    """
    kept, rng = Evaluations(problem, budget), np.random.default_rng(seed)
    kept.steps = set()
    with suppress(Spent):
        places = spread(problem.n_parameters, FIRST, rng)
        misfits = kept.at(places)
        finite = misfits[np.isfinite(misfits)]
        heat = HEAT * float(np.median(finite) - finite.min()) if len(finite) else 0.0
        start = int(np.argmin(misfits))
        kept.steps.add(start)
        _chain(kept, rng, places[start], misfits[start], heat)
        while True:
            place = rng.random(problem.n_parameters)
            misfit = kept.at(place[None])[0]
            kept.steps.add(len(kept.misfits) - 1)
            _chain(kept, rng, place, misfit, heat)
    return kept.trace()


def _chain(kept, rng, place, misfit, temperature):
    """March one chain until its step is small."""
    step = STEP
    while step > SMALLEST:
        trial = _mirrored(place + step * rng.standard_normal(len(place)))
        found = kept.at(trial[None])[0]
        rise = found - misfit
        if rise <= 0.0 or (temperature > 0.0 and rng.random() < math.exp(-rise / temperature)):
            kept.steps.add(len(kept.misfits) - 1)
            place, misfit = trial, found
            step = min(STEP, step * GROWTH)
        else:
            step *= GROWTH ** (-SHARE / (1.0 - SHARE))
        temperature *= COOLING


def _mirrored(place):
    """Return a place mirrored at the faces of the unit cube."""
    return 1.0 - np.abs(1.0 - np.mod(place, 2.0))


POPULATION = 16  # two batches of eight
GENERATIONS = 10**6  # more than any budget


def evolution_search(problem: Problem, budget: int, seed: int) -> Trace:
    """Search by scipy's differential evolution, from a Sobol sequence, without polishing.

    Parameters
    ----------
    problem : Problem
    budget : int
    seed : int

    Returns
    -------
    Trace
        That of a smaller budget is its beginning.

    Notes
    -----
    Storn & Price (1997); each generation is evaluated at once (updating deferred).
    """
    kept, n = Evaluations(problem, budget), problem.n_parameters
    with suppress(Spent):
        while True:
            rng = np.random.default_rng([seed, budget - kept.left])
            differential_evolution(
                lambda unit: kept.at(unit.T), [(0.0, 1.0)] * n, init=spread(n, POPULATION, rng),
                rng=rng, maxiter=GENERATIONS, tol=0.0, polish=False, updating="deferred",
                vectorized=True,
            )  # fmt: skip
    return kept.trace()
