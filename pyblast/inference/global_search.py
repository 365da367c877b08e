"""Global searches: annealing, random sampling, Gaussian process."""

import math
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from scipy import linalg, optimize
from scipy.stats import norm, qmc

from .parameter import Evaluations, Problem, Spent, Trace

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


LENGTHS = (0.05, 10.0)  # bounds of correlation lengths in the unit cube
NOISE = (1e-8, 1e-1)  # bounds of the noise, in shares of the variance
ROOT = np.sqrt(5.0)


@dataclass(frozen=True, eq=False)
class GaussianProcess:
    """Gaussian process conditioned on values at points, theory.md (12.3).

    Parameters
    ----------
    x : (m, n) float64
        Points in the unit cube.
    lengths : (n,) float64
        Correlation lengths.
    mean, variance : float64, or (k,) for k quantities
        Of all values.
    noise : float
        In shares of the variance.
    root : (m, m) float64
        Lower Cholesky factor of the correlations, noise included.
    weights : (m,) or (m, k) float64
        Inverse of the correlations times the values less their mean.
    """

    x: np.ndarray
    lengths: np.ndarray
    mean: np.ndarray
    variance: np.ndarray
    noise: float
    root: np.ndarray
    weights: np.ndarray

    def at(self, x) -> tuple[np.ndarray, np.ndarray]:
        """Return the mean (l,) or (l, k) at points (l, n), and rows (m, l) of the variance.

        The variance is ``variance (1 - sum rows^2)``.
        """
        shared = correlation(self.x, x, self.lengths)
        rows = linalg.solve_triangular(self.root, shared, lower=True)
        return self.mean + shared.T @ self.weights, rows


def correlation(x, others, lengths) -> np.ndarray:
    """Return Matern's correlation of order 5/2 between points (m, n) and (k, n), (m, k)."""
    distance = np.sqrt(_squares(x, others, lengths).sum(axis=-1))
    return _matern(distance)


def fit_gaussian_process(x, values, start) -> GaussianProcess:
    """Fit a Gaussian process to values at points by maximum likelihood.

    Parameters
    ----------
    x : (m, n) float64
        In the unit cube.
    values : (m,) or (m, k) float64
        Of one quantity, or of several that share lengths and noise.
    start : (n + 1,) float64
        Initial logarithms of lengths and noise, such as `hyperparameters` of an earlier process.

    Returns
    -------
    GaussianProcess

    Notes
    -----
    theory.md (12.4); Rasmussen & Williams (2006), chapter 5.
    """
    limits = [np.log(LENGTHS)] * x.shape[1] + [np.log(NOISE)]
    best = optimize.minimize(
        _negative_log_likelihood, start, (x, values), jac=True, method="L-BFGS-B", bounds=limits,
        options={"maxiter": 60},
    )  # fmt: skip
    lengths, noise = np.exp(best.x[:-1]), float(np.exp(best.x[-1]))
    correlated = correlation(x, x, lengths) + noise * np.eye(len(x))
    root, mean, variance, weights = _fitted(correlated, values)
    return GaussianProcess(x, lengths, mean, variance, noise, root, weights)


def hyperparameters(process) -> np.ndarray:
    """Return the logarithms of lengths and noise of a process, (n + 1,)."""
    return np.log(np.append(process.lengths, process.noise))


def _negative_log_likelihood(logs, x, values):
    """Return the negative log likelihood, maximised over mean and variance, and its gradient."""
    lengths, noise, m = np.exp(logs[:-1]), np.exp(logs[-1]), len(values)
    squares = _squares(x, x, lengths)
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
    """Return Cholesky factor, mean and variance of maximum likelihood, and weights."""
    root = linalg.cholesky(correlated, lower=True)
    row_sums = linalg.cho_solve((root, True), np.ones(len(values)))
    mean = row_sums @ values / row_sums.sum()
    weights = linalg.cho_solve((root, True), values - mean)
    variance = np.maximum(np.sum((values - mean) * weights, axis=0) / len(values), 1e-300)
    return root, mean, variance, weights


def _squares(x, others, lengths):
    """Return the squared distances along each axis over its length, (m, k, n)."""
    return ((x[:, None, :] - others[None, :, :]) / lengths) ** 2


def _matern(distance):
    """Return the correlation at some distances."""
    return (1.0 + ROOT * distance + 5.0 / 3.0 * distance**2) * np.exp(-ROOT * distance)


BATCH = 8  # runs in one batch
SPREAD = 512  # candidates over the whole unit cube
NEAR = 64  # candidates around the best point, for each distance
DISTANCES = (0.1, 0.03, 0.01, 0.003, 0.001)
LENGTH_START, NOISE_START = 0.5, 1e-4  # initial hyperparameters


def surrogate_search(problem: Problem, budget: int, seed: int) -> Trace:
    """Bayesian optimisation: expected improvement of a Gaussian process of the log misfit.

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
    theory.md (12.3) to (12.6). Batches of eight by the constant liar: each point is chosen as if
    those before it had reached the best misfit (Ginsbourger et al. 2010).
    """
    evaluations, rng = Evaluations(problem, budget), np.random.default_rng(seed)
    n = problem.n_parameters
    x = sobol_points(n, BATCH, rng)
    start = np.log(np.append(np.full(n, LENGTH_START), NOISE_START))
    with suppress(Spent):
        evaluations.at(x)
        while True:
            values = _log_misfits(np.array(evaluations.misfits))
            process = fit_gaussian_process(x, values, start)
            start = hyperparameters(process)
            chosen = _batch(process, values, _candidates(x[np.argmin(values)], rng))
            x = np.vstack([x, chosen])
            evaluations.at(chosen)
    return evaluations.trace()


def _log_misfits(misfits):
    """Return logarithms of misfits over their median; infinite ones become the largest."""
    finite = misfits[np.isfinite(misfits)]
    if not len(finite) or np.median(finite) <= 0.0:
        return np.zeros(len(misfits))
    ratios = np.minimum(misfits, finite.max()) / np.median(finite)
    return np.log(np.maximum(ratios, 1e-12))


def _candidates(best, rng):
    """Return candidate points: over the unit cube, and at decreasing distances of the best one."""
    n = len(best)
    steps = np.repeat(DISTANCES, NEAR)[:, None] * rng.standard_normal((NEAR * len(DISTANCES), n))
    return np.vstack([sobol_points(n, SPREAD, rng), np.clip(best + steps, 0.0, 1.0)])


def _batch(process, values, candidates):
    """Return a batch of points, each chosen as if those before had the best misfit."""
    lie, chosen = values.min(), []
    mean, rows = process.at(candidates)
    for _ in range(BATCH):
        share = np.maximum(1.0 - np.sum(rows**2, axis=0), 1e-12)
        improvement = _expected_improvement(lie, mean, np.sqrt(process.variance * share))
        k = int(np.argmax(improvement))
        chosen.append(candidates[k])
        shared = correlation(candidates[k : k + 1], candidates, process.lengths)[0]
        row = (shared - rows[:, k] @ rows) / np.sqrt(share[k] + process.noise)
        mean = mean + row * (lie - mean[k]) / np.sqrt(share[k] + process.noise)
        rows = np.vstack([rows, row])
    return np.array(chosen)


def _expected_improvement(best, mean, deviation):
    """Return the expected improvement on the best value, theory.md (12.6)."""
    z = (best - mean) / deviation
    return deviation * (z * norm.cdf(z) + norm.pdf(z))
