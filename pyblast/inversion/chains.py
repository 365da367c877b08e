"""Random walks through a probability: emcee's ensembles, and whether they have gone far enough."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..errors import InputError

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
