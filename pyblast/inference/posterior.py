"""Posterior distribution of parameters by Markov-chain Monte Carlo on an emulator."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import linalg, stats
from scipy.special import logsumexp

from ..errors import InputError, SolverError
from .global_search import GaussianProcess, learn, settings, spread
from .parameter import Problem

ENSEMBLES = 2
WALKERS = 8  # for each unknown
TIMES = 50.0  # autocorrelation times that a walk must last
R_HAT = 1.01
STEPS, LONGEST = 1000, 16000


@dataclass(frozen=True, eq=False)
class Chains:
    """What independent ensembles of walkers have drawn.

    Parameters
    ----------
    places : (ensembles, steps, walkers, n) float64
        The second half of each walk.
    autocorrelation : (n,) float64
        Steps after which a walk has forgotten where it was, the slower ensemble.
    r_hat : (n,) float64
        Split, between halves of all ensembles.
    accepted : float
        Share of the moves.
    """

    places: np.ndarray
    autocorrelation: np.ndarray
    r_hat: np.ndarray
    accepted: float

    @property
    def draws(self) -> np.ndarray:
        """All places, (m, n)."""
        return self.places.reshape(-1, self.places.shape[-1])

    @property
    def independent(self) -> float:
        """How many independent draws they are worth, the slowest unknown."""
        return len(self.draws) / float(np.max(self.autocorrelation))

    @property
    def doubt(self) -> str:
        """Say why the walks have not converged; nothing where they have."""
        steps, slowest = self.places.shape[1], float(np.max(self.autocorrelation))
        if not steps >= TIMES * slowest:
            return f"{steps} steps are {steps / slowest:.0f} autocorrelation times, not {TIMES:.0f}"
        worst = float(np.max(self.r_hat))
        return "" if worst <= R_HAT else f"split R-hat is {worst:.3f}, above {R_HAT:g}"


def walk(log_density: Callable, start, seed, longest=LONGEST) -> Chains:
    """Walk until ensembles agree, or as long as is allowed.

    Parameters
    ----------
    log_density : callable
        ``(m, n) -> (m,)`` of places in the unit cube; places outside are never asked for.
    start : (ensembles, walkers, n) float64
        Inside.
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

    def inside(places):
        found = np.full(len(places), -np.inf)
        within = np.all((places >= 0.0) & (places <= 1.0), axis=1)
        if np.any(within):
            found[within] = log_density(places[within])
        return found

    moves = [(emcee.moves.DEMove(), 0.8), (emcee.moves.DESnookerMove(), 0.2)]
    samplers = [
        emcee.EnsembleSampler(*one.shape, inside, moves=moves, vectorize=True) for one in start
    ]
    states = [
        emcee.State(one, random_state=np.random.MT19937([seed, k]).state)
        for k, one in enumerate(start)
    ]
    steps, done = min(STEPS, longest), 0
    while True:
        states = [
            sampler.run_mcmc(state, steps - done, skip_initial_state_check=True)
            for sampler, state in zip(samplers, states, strict=True)
        ]
        done, found = steps, _judged(emcee, samplers)
        if not found.doubt or done >= longest:
            return found
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
            "back_analysis.posterior: needs emcee; install pyblast[posterior] or leave it out"
        ) from None
    return emcee


def _judged(emcee, samplers):
    """Return the second halves of walks, and how far they have gone."""
    places = np.array([sampler.get_chain() for sampler in samplers])
    places = places[:, places.shape[1] // 2 :]
    slow = [emcee.autocorr.integrated_time(one, quiet=True, tol=0) for one in places]
    accepted = float(np.mean([sampler.acceptance_fraction for sampler in samplers]))
    return Chains(places, np.max(slow, axis=0), r_hat(places), accepted)


def r_hat(places) -> np.ndarray:
    """Return the split R-hat (n,) of places (ensembles, steps, walkers, n).

    Notes
    -----
    theory.md (12.12); each half of an ensemble, all its walkers, is one sequence.
    """
    ensembles, steps, walkers, n = places.shape
    half = steps // 2
    parts = places[:, : 2 * half].reshape(2 * ensembles, half * walkers, n)
    within = parts.var(axis=1, ddof=1).mean(axis=0)
    between = parts.mean(axis=1).var(axis=0, ddof=1)
    return np.sqrt(1.0 - 1.0 / (half * walkers) + between / within)


LEFT_OUT = 0.1  # rms of a residual, in standard deviations of all data, that no component holds
REACH = 4.0  # standard deviations of the points learnt from that make one length
LENGTH, NOISE = 0.5, 1e-6  # to begin with
FAR = 10.0  # excess of the sum of squares for each unknown beyond which a point counts less


@dataclass(frozen=True, eq=False)
class Emulator:
    """What residuals are at any place: a parabola in each of few components, and a process on it.

    Parameters
    ----------
    centre, scale : (n,) float64
        Of the places learnt from, in the unit cube.
    components : (q, k) float64
        Orthonormal directions that residuals move along.
    parabola : (t, q) float64
        Coefficients of 1, places and their products.
    process : GaussianProcess
        Of what the parabolas leave, all components together.
    """

    centre: np.ndarray
    scale: np.ndarray
    components: np.ndarray
    parabola: np.ndarray
    process: GaussianProcess

    def log_likelihood(self, unit) -> np.ndarray:
        """Return the logarithm of the likelihood (m,) at places (m, n), but for a constant.

        Notes
        -----
        theory.md (12.10): its own doubt adds to the unit variance of each component.
        """
        near = (np.asarray(unit) - self.centre) / self.scale
        mean, rows = self.process.at(near)
        left = np.maximum(1.0 - np.sum(rows**2, axis=0), 0.0)
        variance = 1.0 + left[:, None] * self.process.variance
        scores = _terms(near) @ self.parabola + mean
        return -0.5 * np.sum(scores**2 / variance + np.log(variance), axis=1)


def emulate(places, residuals, start=None) -> Emulator:
    """Learn residuals (m, k) at places (m, n) of the unit cube.

    Parameters
    ----------
    places : (m, n) float64
    residuals : (m, k) float64
        Whitened, of unit variance each where the theory is right.
    start : Emulator, optional
        An earlier one, whose lengths are a beginning.

    Notes
    -----
    theory.md (12.9).
    """
    m, n = places.shape
    centre = places.mean(axis=0)
    scale = REACH * np.maximum(places.std(axis=0), 1e-6)
    near = (places - centre) / scale
    _, size, turned = linalg.svd(residuals, full_matrices=False)
    beyond = np.sqrt(np.cumsum(size[::-1] ** 2)[::-1] / m)
    components = turned[: max(1, int(np.count_nonzero(beyond > LEFT_OUT)))]
    scores, squares = residuals @ components.T, np.sum(residuals**2, axis=1)
    weight = 1.0 / np.sqrt(1.0 + (squares - squares.min()) / (FAR * n))
    terms = _terms(near)
    parabola = linalg.lstsq(terms * weight[:, None], scores * weight[:, None])[0]
    logs = np.log([LENGTH] * n + [NOISE]) if start is None else settings(start.process)
    process = learn(near, scores - terms @ parabola, logs)
    return Emulator(centre, scale, components, parabola, process)


def n_terms(n):
    """Return the number of coefficients of a parabola of n unknowns."""
    return (n + 1) * (n + 2) // 2


def _terms(near):
    """Return 1, the coordinates and their products at places (m, n), (m, t)."""
    rows, columns = np.triu_indices(near.shape[1])
    return np.hstack([np.ones((len(near), 1)), near, near[:, rows] * near[:, columns]])


BATCH = 8  # runs that march side by side
STEP = 0.02  # of the ranges, for differences at the best point
PRIOR = 12.0  # one over the variance of an even range
WIDE = 1.5  # how much wider than a Gaussian posterior the first runs are spread
PER_TERM = 2.5  # first runs for each coefficient of a parabola
ROUNDS, FRESH = 6, 24  # at most so many times so many runs where the emulator walked
GOOD = 0.9  # share of effective runs in a round after which nothing more is learnt
CHECKS = 40
WALK = 400  # steps while learning
ENOUGH = 0.5  # share of effective runs among the checks
REACHED = 0.1  # share of effective draws that a correction must leave
KEPT = 2000  # samples
LEVEL = 0.9


@dataclass(frozen=True, eq=False)
class Posterior:
    """What records and ranges together leave possible.

    Parameters
    ----------
    samples : (m, n) float64
        In the units of the unknowns, equally likely, corrected by the checks.
    places : (m, n) float64
        The same in the unit cube of the ranges.
    chains : Chains
    log_weights : (checks,) float64
        Logarithm of true over emulated probability at fresh places of the walks, mean zero but
        for those where no model could be run, which are minus infinity.
    effective : float
        Runs that the checks are worth, of as many as there are weights; theory.md (12.11).
    corrected : float
        The same after the correction.
    runs : int
        Evaluations: learnt from, and checks.
    seed : int
    mesh_doubt : str
        Why the error of the mesh is not in the intervals; nothing where it is.
    """

    samples: np.ndarray
    places: np.ndarray
    chains: Chains
    log_weights: np.ndarray
    effective: float
    corrected: float
    runs: int
    seed: int
    mesh_doubt: str = ""

    @property
    def doubt(self) -> str:
        """Say why there are no intervals; nothing where there are."""
        if self.chains.doubt:
            return self.chains.doubt
        share = self.corrected / len(self.log_weights)
        if share >= ENOUGH:
            return ""
        return (
            f"the emulator is not good enough: {len(self.log_weights)} runs that checked it agree "
            f"with it as well as {self.corrected:.1f} that agree wholly; {ENOUGH:.0%} of them must"
        )

    @property
    def intervals(self) -> np.ndarray:
        """Where 90 % of each unknown lies, (n, 2).

        Raises
        ------
        SolverError
            If walks or checks say that they would not be right.
        """
        if self.doubt:
            raise SolverError(f"posterior: no intervals, {self.doubt}")
        ends = [0.5 * (1.0 - LEVEL), 0.5 * (1.0 + LEVEL)]
        return np.quantile(self.samples, ends, axis=0).T

    @property
    def correlation(self) -> np.ndarray:
        """Between the unknowns on their scales, (n, n)."""
        return np.atleast_2d(np.corrcoef(self.places.T))


def posterior(problem: Problem, best, seed: int, checking: Problem | None = None) -> Posterior:
    """Draw from the posterior of a problem around the best point of a search.

    Parameters
    ----------
    problem : Problem
        With ``vectors`` whose residuals are whitened, errors of the theory included; even priors
        over its ranges, on a logarithmic scale where it is searched so.
    best : (n,) float64
        From which to begin.
    seed : int
        Of all random choices.
    checking : Problem, optional
        Of full runs, where ``problem`` itself is quick.

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
    rng, learnt = np.random.default_rng([seed, 3]), _Learnt(problem)
    _spread_runs(learnt, problem.unit(best), rng)
    emulator = None
    for _ in range(ROUNDS):
        emulator = emulate(learnt.places, learnt.residuals, emulator)
        drawn = walk(emulator.log_likelihood, _start(learnt, rng), int(rng.integers(2**31)), WALK)
        fresh = _some(drawn, FRESH, rng)
        weights = _weights(emulator, fresh, learnt.add(fresh))
        if _effective(weights) >= GOOD * len(weights):
            break
    emulator = emulate(learnt.places, learnt.residuals, emulator)
    chains = walk(emulator.log_likelihood, _start(learnt, rng), int(rng.integers(2**31)))
    checked = _Learnt(problem if checking is None else checking)
    fresh = _some(chains, CHECKS, rng)
    weights = _weights(emulator, fresh, checked.add(fresh))
    places, corrected = _corrected(chains, fresh, weights, rng)
    runs = learnt.count + checked.count
    weights = weights - np.mean(weights[np.isfinite(weights)])
    return Posterior(
        problem.points(places), places, chains, weights, _effective(weights), corrected, runs, seed
    )


class _Learnt:
    """Places that were evaluated, with their residuals."""

    def __init__(self, problem):
        self.problem, self.count = problem, 0
        self.places = np.zeros((0, problem.n_parameters))
        self.residuals = None

    def add(self, places):
        """Evaluate places; return the logarithm of their likelihood, minus infinity if failed."""
        _, residuals = self.problem.vectors(self.problem.points(places))
        fine = np.all(np.isfinite(residuals), axis=1)
        if not np.any(fine):
            raise SolverError("posterior: none of a batch of points could be run")
        self.count += len(places)
        self.places = np.vstack([self.places, places[fine]])
        kept = residuals[fine]
        self.residuals = kept if self.residuals is None else np.vstack([self.residuals, kept])
        found = np.full(len(places), -np.inf)
        found[fine] = -0.5 * np.sum(kept**2, axis=1)
        return found


def _spread_runs(learnt, best, rng):
    """Evaluate the best point, differences there, and places as wide as they suggest."""
    n = len(best)
    steps = np.where(best > 0.5, -STEP, STEP)
    learnt.add(np.vstack([best, best + np.diag(steps)]))
    if len(learnt.places) < n + 1:
        raise SolverError("posterior: the best point or one beside it could not be run")
    slopes = (learnt.residuals[1:] - learnt.residuals[0]) / steps[:, None]
    root = linalg.cholesky(np.linalg.inv(slopes @ slopes.T + PRIOR * np.eye(n)), lower=True)
    count = BATCH * -(-int(PER_TERM * n_terms(n)) // BATCH)
    even = np.clip(spread(n, count, rng), 1e-6, 1.0 - 1e-6)
    learnt.add(np.clip(best + WIDE * stats.norm.ppf(even) @ root.T, 0.0, 1.0))


def _start(learnt, rng):
    """Return walkers at places drawn by their likelihood, none twice the same."""
    n = learnt.places.shape[1]
    squares = np.sum(learnt.residuals**2, axis=1)
    chance = np.exp(-0.5 * (squares - squares.min()) / max(1.0, 2.0 * n))
    rows = rng.choice(len(chance), (ENSEMBLES, WALKERS * n), p=chance / chance.sum())
    width = 0.1 * np.sqrt(np.average(
        (learnt.places - learnt.places[squares.argmin()]) ** 2, axis=0, weights=chance
    ))  # fmt: skip
    moved = learnt.places[rows] + (width + 1e-6) * rng.standard_normal((*rows.shape, n))
    return np.where(moved < 0.0, -moved, np.where(moved > 1.0, 2.0 - moved, moved)).clip(0.0, 1.0)


def _some(chains, count, rng):
    """Return places (count, n) of walks, chosen at random."""
    return chains.draws[rng.choice(len(chains.draws), count, replace=False)]


def _weights(emulator: Emulator, places, found):
    """Return the logarithms of true over emulated likelihood, but for a constant."""
    return found - emulator.log_likelihood(places)


def _effective(log_weights) -> float:
    """Return how many places of equal weight are as good, theory.md (12.11)."""
    return float(np.exp(2.0 * logsumexp(log_weights) - logsumexp(2.0 * log_weights)))


def _corrected(chains, places, weights, rng):
    """Draw samples by weights that are linear in place as the checks foresee; effective checks.

    Each check is foreseen by the others, so the number is not flattered. No correction where it
    would rest on few of the draws.
    """
    fine = np.isfinite(weights)
    draws = chains.draws
    centre, root = draws.mean(axis=0), linalg.cholesky(np.atleast_2d(np.cov(draws.T)), lower=True)

    def terms(some):
        near = linalg.solve_triangular(root, (some - centre).T, lower=True).T
        return np.hstack([np.ones((len(some), 1)), near])

    rows = terms(places[fine])
    held = np.diag([0.0, *np.ones(draws.shape[1])])
    inverse = np.linalg.inv(rows.T @ rows + held)
    slopes = inverse @ rows.T @ weights[fine]
    leverage = np.einsum("ij,jk,ik->i", rows, inverse, rows)
    left = (weights[fine] - rows @ slopes) / (1.0 - leverage)
    plain, better = _effective(weights[fine]), _effective(left)
    logs = terms(draws) @ slopes
    if not better > plain or _effective(logs) < REACHED * len(draws):
        better, logs = plain, np.zeros(len(draws))
    chance = np.exp(logs - logsumexp(logs))
    kept = rng.choice(len(draws), min(KEPT, len(draws)), p=chance)
    return draws[kept], better
