"""Global searches: annealing, differential evolution, random sampling, Gaussian process."""

import math
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from scipy import linalg, optimize
from scipy.optimize import differential_evolution
from scipy.stats import norm, qmc

from .parameter import Evaluations, Problem, Spent, Trace

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


LENGTHS = (0.05, 10.0)  # of the unit cube
NOISE = (1e-8, 1e-1)  # of the variance
ROOT = np.sqrt(5.0)


@dataclass(frozen=True, eq=False)
class GaussianProcess:
    """What was learnt from values at places, theory.md (12.3).

    Parameters
    ----------
    places : (m, n) float64
    lengths : (n,) float64
        Over which values are alike.
    mean, variance : float64, or (k,) where k quantities were learnt together
        Of all values.
    noise : float
        In shares of the variance.
    root : (m, m) float64
        Lower Cholesky factor of the correlations, noise included.
    weights : (m,) or (m, k) float64
        Inverse of the correlations times the values less their mean.
    """

    places: np.ndarray
    lengths: np.ndarray
    mean: np.ndarray
    variance: np.ndarray
    noise: float
    root: np.ndarray
    weights: np.ndarray

    def at(self, places) -> tuple[np.ndarray, np.ndarray]:
        """Return mean (l,) or (l, k), and what is left of the correlation, rows (m, l) to subtract.

        The variance at a place is ``variance (1 - sum rows^2)``.
        """
        shared = correlation(self.places, places, self.lengths)
        rows = linalg.solve_triangular(self.root, shared, lower=True)
        return self.mean + shared.T @ self.weights, rows


def correlation(some, others, lengths) -> np.ndarray:
    """Return Matern's correlation of order 5/2 between places (m, n) and (k, n), (m, k)."""
    distance = np.sqrt(_squares(some, others, lengths).sum(axis=-1))
    return _matern(distance)


def learn(places, values, start) -> GaussianProcess:
    """Learn lengths, noise, mean and variance from values at places: the likeliest ones.

    Parameters
    ----------
    places : (m, n) float64
        In the unit cube.
    values : (m,) or (m, k) float64
        Of one quantity, or of several that share lengths and noise.
    start : (n + 1,) float64
        Logarithms of lengths and noise to begin with, such as the `settings` of an earlier one.

    Returns
    -------
    GaussianProcess

    Notes
    -----
    theory.md (12.4); Rasmussen & Williams (2006), chapter 5.
    """
    limits = [np.log(LENGTHS)] * places.shape[1] + [np.log(NOISE)]
    found = optimize.minimize(
        _unlikelihood, start, (places, values), jac=True, method="L-BFGS-B", bounds=limits,
        options={"maxiter": 60},
    )  # fmt: skip
    lengths, noise = np.exp(found.x[:-1]), float(np.exp(found.x[-1]))
    correlated = correlation(places, places, lengths) + noise * np.eye(len(places))
    root, mean, variance, weights = _fitted(correlated, values)
    return GaussianProcess(places, lengths, mean, variance, noise, root, weights)


def settings(process) -> np.ndarray:
    """Return the logarithms of lengths and noise, from which `learn` can begin."""
    return np.log(np.append(process.lengths, process.noise))


def _unlikelihood(logs, places, values):
    """Return the negative log likelihood, mean and variance at their best, and its gradient."""
    lengths, noise, m = np.exp(logs[:-1]), np.exp(logs[-1]), len(values)
    squares = _squares(places, places, lengths)
    distance = np.sqrt(squares.sum(axis=-1))
    root, _, variance, weights = _fitted(_matern(distance) + noise * np.eye(m), values)
    inverse = linalg.cho_solve((root, True), np.eye(m))
    several = np.size(variance)
    weights = weights.reshape(m, several)
    change = 0.5 * (several * inverse - (weights / variance) @ weights.T)
    slope = 5.0 / 3.0 * (1.0 + ROOT * distance) * np.exp(-ROOT * distance)
    gradient = np.append(
        np.tensordot(change * slope, squares, ([0, 1], [0, 1])), noise * np.trace(change)
    )
    size = 0.5 * m * np.sum(np.log(variance)) + several * np.sum(np.log(np.diag(root)))
    return size, gradient


def _fitted(correlated, values):
    """Return Cholesky factor, likeliest mean and variance, and weights."""
    root = linalg.cholesky(correlated, lower=True)
    ones = linalg.cho_solve((root, True), np.ones(len(values)))
    mean = ones @ values / ones.sum()
    weights = linalg.cho_solve((root, True), values - mean)
    variance = np.maximum(np.sum((values - mean) * weights, axis=0) / len(values), 1e-300)
    return root, mean, variance, weights


def _squares(some, others, lengths):
    """Return the squared distances along each axis over its length, (m, k, n)."""
    return ((some[:, None, :] - others[None, :, :]) / lengths) ** 2


def _matern(distance):
    """Return the correlation at some distances."""
    return (1.0 + ROOT * distance + 5.0 / 3.0 * distance**2) * np.exp(-ROOT * distance)


BATCH = 8  # runs that march side by side
SPREAD = 512  # candidates all over the ranges
NEAR = 64  # candidates around the best place, for each of some distances
DISTANCES = (0.1, 0.03, 0.01, 0.003, 0.001)
LENGTH_START, NOISE_START = 0.5, 1e-4  # to begin with


def surrogate_search(problem: Problem, budget: int, seed: int) -> Trace:
    """Search where a Gaussian process of the logarithm of the misfit expects improvement.

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
    theory.md (12.3) to (12.6). Batches of eight: each place is chosen as if those before it had
    been found to be as good as the best (Ginsbourger et al. 2010).
    """
    kept, rng = Evaluations(problem, budget), np.random.default_rng(seed)
    n = problem.n_parameters
    places = spread(n, BATCH, rng)
    start = np.log(np.append(np.full(n, LENGTH_START), NOISE_START))
    with suppress(Spent):
        kept.at(places)
        while True:
            values = _levelled(np.array(kept.misfits))
            process = learn(places, values, start)
            start = settings(process)
            chosen = _batch(process, values, _candidates(places[np.argmin(values)], rng))
            places = np.vstack([places, chosen])
            kept.at(chosen)
    return kept.trace()


def _levelled(misfits):
    """Return logarithms of misfits over their median; infinite ones become the worst."""
    finite = misfits[np.isfinite(misfits)]
    if not len(finite) or np.median(finite) <= 0.0:
        return np.zeros(len(misfits))
    shares = np.minimum(misfits, finite.max()) / np.median(finite)
    return np.log(np.maximum(shares, 1e-12))


def _candidates(best, rng):
    """Return places to choose from: all over the unit cube, and ever nearer to the best one."""
    n = len(best)
    steps = np.repeat(DISTANCES, NEAR)[:, None] * rng.standard_normal((NEAR * len(DISTANCES), n))
    return np.vstack([spread(n, SPREAD, rng), np.clip(best + steps, 0.0, 1.0)])


def _batch(process, values, candidates):
    """Choose places one after the other, each knowing of those before."""
    lie, chosen = values.min(), []
    mean, rows = process.at(candidates)
    for _ in range(BATCH):
        left = np.maximum(1.0 - np.sum(rows**2, axis=0), 1e-12)
        worth = _improvement(lie, mean, np.sqrt(process.variance * left))
        k = int(np.argmax(worth))
        chosen.append(candidates[k])
        shared = correlation(candidates[k : k + 1], candidates, process.lengths)[0]
        row = (shared - rows[:, k] @ rows) / np.sqrt(left[k] + process.noise)
        mean = mean + row * (lie - mean[k]) / np.sqrt(left[k] + process.noise)
        rows = np.vstack([rows, row])
    return np.array(chosen)


def _improvement(best, mean, deviation):
    """Return the improvement on the best that is expected, theory.md (12.6)."""
    z = (best - mean) / deviation
    return deviation * (z * norm.cdf(z) + norm.pdf(z))
