"""How sure a back-analysis is: the posterior of its unknowns, walked on an emulator and checked."""

from dataclasses import dataclass

import numpy as np
from scipy import linalg, stats
from scipy.special import logsumexp

from ..errors import InputError, SolverError
from .chains import ENSEMBLES, WALKERS, Chains, walk
from .emulator import Emulator, emulate, n_terms
from .sampling import spread
from .searching import Problem

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
