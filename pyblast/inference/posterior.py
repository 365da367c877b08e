"""Posterior distribution of parameters by Markov-chain Monte Carlo on an emulator."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import linalg, stats
from scipy.special import logsumexp

from ..errors import InputError, SolverError
from .global_search import GaussianProcess, fit_gaussian_process, hyperparameters, sobol_points
from .parameter import Problem

ENSEMBLES = 2
WALKERS = 8  # for each parameter
TIMES = 50.0  # least length of a chain in autocorrelation times
R_HAT = 1.01
STEPS, LONGEST = 1000, 16000


@dataclass(frozen=True, eq=False)
class Chains:
    """Markov chains of independent ensembles of walkers.

    Parameters
    ----------
    x : (ensembles, steps, walkers, n) float64
        Points in the unit cube, the second half of each chain.
    autocorrelation : (n,) float64
        Autocorrelation time in steps, of the slower ensemble.
    r_hat : (n,) float64
        Split R-hat, between halves of all ensembles.
    accepted : float
        Share of accepted moves.
    """

    x: np.ndarray
    autocorrelation: np.ndarray
    r_hat: np.ndarray
    accepted: float

    @property
    def draws(self) -> np.ndarray:
        """All points, (m, n)."""
        return self.x.reshape(-1, self.x.shape[-1])

    @property
    def independent(self) -> float:
        """Effective sample size, of the slowest parameter."""
        return len(self.draws) / float(np.max(self.autocorrelation))

    @property
    def failure(self) -> str:
        """Return why the chains have not converged; empty where they have."""
        steps, slowest = self.x.shape[1], float(np.max(self.autocorrelation))
        if not steps >= TIMES * slowest:
            return f"{steps} steps are {steps / slowest:.0f} autocorrelation times, not {TIMES:.0f}"
        worst = float(np.max(self.r_hat))
        return "" if worst <= R_HAT else f"split R-hat is {worst:.3f}, above {R_HAT:g}"


def walk(log_density: Callable, start, seed, longest=LONGEST) -> Chains:
    """Sample a density by ensemble Markov chains until they converge or reach a length.

    Parameters
    ----------
    log_density : callable
        ``(m, n) -> (m,)`` of points in the unit cube; never called outside of it.
    start : (ensembles, walkers, n) float64
        Inside the unit cube.
    seed : int
    longest : int
        Steps.

    Raises
    ------
    InputError
        If emcee is not installed.

    Notes
    -----
    theory.md (12.12). Moves: differential evolution, one in five with a snooker update.
    """
    emcee = emcee_library()

    def bounded(x):
        density = np.full(len(x), -np.inf)
        within = np.all((x >= 0.0) & (x <= 1.0), axis=1)
        if np.any(within):
            density[within] = log_density(x[within])
        return density

    moves = [(emcee.moves.DEMove(), 0.8), (emcee.moves.DESnookerMove(), 0.2)]
    samplers = [
        emcee.EnsembleSampler(*first.shape, bounded, moves=moves, vectorize=True) for first in start
    ]
    states = [
        emcee.State(first, random_state=np.random.MT19937([seed, k]).state)
        for k, first in enumerate(start)
    ]
    steps, done = min(STEPS, longest), 0
    while True:
        states = [
            sampler.run_mcmc(state, steps - done, skip_initial_state_check=True)
            for sampler, state in zip(samplers, states, strict=True)
        ]
        done, chains = steps, _chains(emcee, samplers)
        if not chains.failure or done >= longest:
            return chains
        steps = min(2 * done, longest)


def emcee_library():
    """Return emcee.

    Raises
    ------
    InputError
        If it is not installed.
    """
    try:
        import emcee
    except ImportError:
        raise InputError(
            "back_analysis.posterior: needs emcee; install emcee, or leave it out"
        ) from None
    return emcee


def _chains(emcee, samplers):
    """Return the second halves of chains, with their convergence statistics."""
    x = np.array([sampler.get_chain() for sampler in samplers])
    x = x[:, x.shape[1] // 2 :]
    slow = [emcee.autocorr.integrated_time(chain, quiet=True, tol=0) for chain in x]
    accepted = float(np.mean([sampler.acceptance_fraction for sampler in samplers]))
    return Chains(x, np.max(slow, axis=0), r_hat(x), accepted)


def r_hat(x) -> np.ndarray:
    """Return the split R-hat (n,) of chains (ensembles, steps, walkers, n).

    Notes
    -----
    theory.md (12.12); each half of an ensemble, all its walkers, is one sequence.
    """
    ensembles, steps, walkers, n = x.shape
    half = steps // 2
    parts = x[:, : 2 * half].reshape(2 * ensembles, half * walkers, n)
    within = parts.var(axis=1, ddof=1).mean(axis=0)
    between = parts.mean(axis=1).var(axis=0, ddof=1)
    return np.sqrt(1.0 - 1.0 / (half * walkers) + between / within)


TRUNCATION = 0.1  # rms of a residual outside of the components, in standard deviations
REACH = 4.0  # standard deviations of the training points in one unit of length
LENGTH, NOISE = 0.5, 1e-6  # initial hyperparameters
FAR = 10.0  # excess of the sum of squares for each parameter that reduces the weight of a point


@dataclass(frozen=True, eq=False)
class Emulator:
    """Emulator of residuals: quadratic regression and a Gaussian process in principal components.

    Parameters
    ----------
    centre, scale : (n,) float64
        Of the training points, in the unit cube.
    components : (q, k) float64
        Principal components of the residuals, orthonormal.
    parabola : (t, q) float64
        Coefficients of 1, coordinates and their products.
    process : GaussianProcess
        Of the residuals of the regression, all components together.
    """

    centre: np.ndarray
    scale: np.ndarray
    components: np.ndarray
    parabola: np.ndarray
    process: GaussianProcess

    def log_likelihood(self, unit) -> np.ndarray:
        """Return the log likelihood (m,) at points (m, n), up to a constant.

        Notes
        -----
        theory.md (12.10): the variance of the emulator adds to the unit variance of each component.
        """
        near = (np.asarray(unit) - self.centre) / self.scale
        mean, rows = self.process.at(near)
        share = np.maximum(1.0 - np.sum(rows**2, axis=0), 0.0)
        variance = 1.0 + share[:, None] * self.process.variance
        scores = _terms(near) @ self.parabola + mean
        return -0.5 * np.sum(scores**2 / variance + np.log(variance), axis=1)


def emulate(x, residuals, start=None) -> Emulator:
    """Fit an emulator to residuals (m, k) at points (m, n) of the unit cube.

    Parameters
    ----------
    x : (m, n) float64
    residuals : (m, k) float64
        Whitened, of unit variance each if the covariance is right.
    start : Emulator, optional
        An earlier one, with initial hyperparameters.

    Notes
    -----
    theory.md (12.9).
    """
    m, n = x.shape
    centre = x.mean(axis=0)
    scale = REACH * np.maximum(x.std(axis=0), 1e-6)
    near = (x - centre) / scale
    _, size, turned = linalg.svd(residuals, full_matrices=False)
    beyond = np.sqrt(np.cumsum(size[::-1] ** 2)[::-1] / m)
    components = turned[: max(1, int(np.count_nonzero(beyond > TRUNCATION)))]
    scores, squares = residuals @ components.T, np.sum(residuals**2, axis=1)
    weight = 1.0 / np.sqrt(1.0 + (squares - squares.min()) / (FAR * n))
    terms = _terms(near)
    parabola = linalg.lstsq(terms * weight[:, None], scores * weight[:, None])[0]
    logs = np.log([LENGTH] * n + [NOISE]) if start is None else hyperparameters(start.process)
    process = fit_gaussian_process(near, scores - terms @ parabola, logs)
    return Emulator(centre, scale, components, parabola, process)


def n_terms(n):
    """Return the number of coefficients of a quadratic polynomial of n variables."""
    return (n + 1) * (n + 2) // 2


def _terms(near):
    """Return 1, the coordinates and their products at points (m, n), (m, t)."""
    rows, columns = np.triu_indices(near.shape[1])
    return np.hstack([np.ones((len(near), 1)), near, near[:, rows] * near[:, columns]])


BATCH = 8  # runs in one batch
STEP = 0.02  # of the ranges, for differences at the best point
PRIOR = 12.0  # precision of a uniform prior over the unit interval
WIDE = 1.5  # width of the first runs over that of a Gaussian posterior
PER_TERM = 2.5  # first runs for each coefficient of the quadratic polynomial
ROUNDS, FRESH = 6, 24  # training rounds at most, and new runs in each
GOOD = 0.9  # effective share of a round that ends the training
CHECKS = 40
TRAINING_STEPS = 400  # of the chains in a training round
ENOUGH = 0.5  # least effective share of the checks
REACHED = 0.1  # least effective share of the draws after the correction
SAMPLES = 2000
LEVEL = 0.9


@dataclass(frozen=True, eq=False)
class Posterior:
    """Posterior of the parameters: samples, chains and checks of the emulator.

    Parameters
    ----------
    samples : (m, n) float64
        In the units of the parameters, of equal weight, corrected by the checks.
    x : (m, n) float64
        The same in the unit cube of the ranges.
    chains : Chains
    log_weights : (checks,) float64
        Log importance weights, true over emulated likelihood, at new draws of the chains: of mean
        zero, minus infinity where a run failed.
    effective : float
        Effective sample size of the checks; theory.md (12.11).
    corrected : float
        The same after the correction.
    runs : int
        Evaluations: training and checks.
    seed : int
    mesh_error_missing : str
        Why the intervals do not include the mesh error; empty where they do.
    """

    samples: np.ndarray
    x: np.ndarray
    chains: Chains
    log_weights: np.ndarray
    effective: float
    corrected: float
    runs: int
    seed: int
    mesh_error_missing: str = ""

    @property
    def failure(self) -> str:
        """Return why there are no intervals; empty where there are."""
        if self.chains.failure:
            return self.chains.failure
        share = self.corrected / len(self.log_weights)
        if share >= ENOUGH:
            return ""
        return (
            "the emulator is not good enough: the effective size of "
            f"{len(self.log_weights)} checks is {self.corrected:.1f}, and must be at least "
            f"{ENOUGH:.0%} of them"
        )

    @property
    def intervals(self) -> np.ndarray:
        """90 % intervals of the parameters, (n, 2).

        Raises
        ------
        SolverError
            If the chains have not converged, or the emulator fails its checks.
        """
        if self.failure:
            raise SolverError(f"posterior: no intervals, {self.failure}")
        ends = [0.5 * (1.0 - LEVEL), 0.5 * (1.0 + LEVEL)]
        return np.quantile(self.samples, ends, axis=0).T

    @property
    def correlation(self) -> np.ndarray:
        """Correlation of the parameters on their scales, (n, n)."""
        return np.atleast_2d(np.corrcoef(self.x.T))


def posterior(problem: Problem, best, seed: int, checking: Problem | None = None) -> Posterior:
    """Sample the posterior of a problem around the best point of a search.

    Parameters
    ----------
    problem : Problem
        With ``vectors`` of whitened residuals, model error included; uniform priors over its
        ranges, on a logarithmic scale where ``log`` is set.
    best : (n,) float64
        Starting point.
    seed : int
        Of all random choices.
    checking : Problem, optional
        Of full runs, where ``problem`` itself is an approximation.

    Returns
    -------
    Posterior

    Raises
    ------
    InputError
        If the problem has no residuals, or emcee is not installed.
    SolverError
        If too few points could be run.

    Notes
    -----
    theory.md (12.9) to (12.12). One mode: that of the best point.
    """
    if problem.vectors is None:
        raise InputError("posterior: needs a misfit of whitened residuals; take 'waveform'")
    rng, training = np.random.default_rng([seed, 3]), _Runs(problem)
    _first_runs(training, problem.unit(best), rng)
    emulator = None
    for _ in range(ROUNDS):
        emulator = emulate(training.x, training.residuals, emulator)
        start, seed_ = _start(training, rng), int(rng.integers(2**31))
        fresh = _draws(walk(emulator.log_likelihood, start, seed_, TRAINING_STEPS), FRESH, rng)
        weights = _log_weights(emulator, fresh, training.add(fresh))
        if _effective(weights) >= GOOD * len(weights):
            break
    emulator = emulate(training.x, training.residuals, emulator)
    chains = walk(emulator.log_likelihood, _start(training, rng), int(rng.integers(2**31)))
    checks = _Runs(problem if checking is None else checking)
    fresh = _draws(chains, CHECKS, rng)
    weights = _log_weights(emulator, fresh, checks.add(fresh))
    x, corrected = _corrected(chains, fresh, weights, rng)
    runs = training.count + checks.count
    weights = weights - np.mean(weights[np.isfinite(weights)])
    return Posterior(
        problem.points(x), x, chains, weights, _effective(weights), corrected, runs, seed
    )


class _Runs:
    """Evaluated points with their residuals."""

    def __init__(self, problem):
        self.problem, self.count = problem, 0
        self.x = np.zeros((0, problem.n_parameters))
        self.residuals = None

    def add(self, x):
        """Evaluate points; return their log likelihood, minus infinity where a run failed."""
        _, residuals = self.problem.vectors(self.problem.points(x))
        fine = np.all(np.isfinite(residuals), axis=1)
        if not np.any(fine):
            raise SolverError("posterior: none of a batch of points could be run")
        self.count += len(x)
        self.x = np.vstack([self.x, x[fine]])
        new = residuals[fine]
        self.residuals = new if self.residuals is None else np.vstack([self.residuals, new])
        log_likelihood = np.full(len(x), -np.inf)
        log_likelihood[fine] = -0.5 * np.sum(new**2, axis=1)
        return log_likelihood


def _first_runs(runs, best, rng):
    """Evaluate the best point, differences there, and points of a wider Gaussian posterior."""
    n = len(best)
    steps = np.where(best > 0.5, -STEP, STEP)
    runs.add(np.vstack([best, best + np.diag(steps)]))
    if len(runs.x) < n + 1:
        raise SolverError("posterior: the best point or one beside it could not be run")
    slopes = (runs.residuals[1:] - runs.residuals[0]) / steps[:, None]
    root = linalg.cholesky(np.linalg.inv(slopes @ slopes.T + PRIOR * np.eye(n)), lower=True)
    count = BATCH * -(-int(PER_TERM * n_terms(n)) // BATCH)
    even = np.clip(sobol_points(n, count, rng), 1e-6, 1.0 - 1e-6)
    runs.add(np.clip(best + WIDE * stats.norm.ppf(even) @ root.T, 0.0, 1.0))


def _start(runs, rng):
    """Return walkers at perturbed points of runs, drawn by their likelihood."""
    n = runs.x.shape[1]
    squares = np.sum(runs.residuals**2, axis=1)
    weight = np.exp(-0.5 * (squares - squares.min()) / max(1.0, 2.0 * n))
    rows = rng.choice(len(weight), (ENSEMBLES, WALKERS * n), p=weight / weight.sum())
    width = 0.1 * np.sqrt(np.average(
        (runs.x - runs.x[squares.argmin()]) ** 2, axis=0, weights=weight
    ))  # fmt: skip
    moved = runs.x[rows] + (width + 1e-6) * rng.standard_normal((*rows.shape, n))
    return np.where(moved < 0.0, -moved, np.where(moved > 1.0, 2.0 - moved, moved)).clip(0.0, 1.0)


def _draws(chains, count, rng):
    """Return random draws (count, n) of chains."""
    return chains.draws[rng.choice(len(chains.draws), count, replace=False)]


def _log_weights(emulator: Emulator, x, log_likelihood):
    """Return log importance weights, true over emulated likelihood, up to a constant."""
    return log_likelihood - emulator.log_likelihood(x)


def _effective(log_weights) -> float:
    """Return the effective sample size of weights, theory.md (12.11)."""
    return float(np.exp(2.0 * logsumexp(log_weights) - logsumexp(2.0 * log_weights)))


def _corrected(chains, checks, weights, rng):
    """Resample the chains by weights regressed on the checks; return the effective size too.

    The regression of the log weights is linear in the coordinates. The effective size is a
    leave-one-out estimate. No correction where it would leave too few effective draws.
    """
    fine = np.isfinite(weights)
    draws = chains.draws
    centre, root = draws.mean(axis=0), linalg.cholesky(np.atleast_2d(np.cov(draws.T)), lower=True)

    def terms(x):
        near = linalg.solve_triangular(root, (x - centre).T, lower=True).T
        return np.hstack([np.ones((len(x), 1)), near])

    rows = terms(checks[fine])
    ridge = np.diag([0.0, *np.ones(draws.shape[1])])
    inverse = np.linalg.inv(rows.T @ rows + ridge)
    slopes = inverse @ rows.T @ weights[fine]
    leverage = np.einsum("ij,jk,ik->i", rows, inverse, rows)
    held_out = (weights[fine] - rows @ slopes) / (1.0 - leverage)
    plain, better = _effective(weights[fine]), _effective(held_out)
    logs = terms(draws) @ slopes
    if not better > plain or _effective(logs) < REACHED * len(draws):
        better, logs = plain, np.zeros(len(draws))
    probability = np.exp(logs - logsumexp(logs))
    chosen = rng.choice(len(draws), min(SAMPLES, len(draws)), p=probability)
    return draws[chosen], better
