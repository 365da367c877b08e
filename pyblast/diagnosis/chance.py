"""How much evidence chance alone would find: the whole library on residuals that were shuffled."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from .fitting import Fit, Fitter
from .hypotheses import LIBRARY
from .scene import Scene
from .search import GROWS, Guess, started

SURROGATES = 200
LEVEL = 0.95
SPREAD = 1.645  # standard deviations of 90 % of a normal distribution, both sides


@dataclass(frozen=True, eq=False)
class Chance:
    """The largest evidence over the library in each of many surrogates.

    Parameters
    ----------
    worth : (n_surrogates,) float64
        In nats over that of nothing, sorted.
    """

    worth: np.ndarray

    @property
    def threshold(self):
        """What 95 % of the surrogates stay below, nats; never negative."""
        return max(float(np.quantile(self.worth, LEVEL)), 0.0)

    @property
    def interval(self):
        """Where the threshold lies by its order statistics, with 90 % probability."""
        n = len(self.worth)
        spread = SPREAD * np.sqrt(n * LEVEL * (1.0 - LEVEL))
        first, last = (int(np.clip(n * LEVEL + d, 0, n - 1)) for d in (-spread, spread))
        return max(float(self.worth[first]), 0.0), max(float(self.worth[last]), 0.0)


def chance(scene: Scene, none: Fit, guesses: list[Guess], seed: int) -> Chance:
    """Search shuffled residuals for the effects of the library.

    Parameters
    ----------
    scene : Scene
    none : Fit
        Without effects; what it leaves is shuffled.
    guesses : list of Guess
        Effects on the site, whose changes were run.
    seed : int

    Notes
    -----
    A surrogate gives each receiver the residuals of another one, never its own, in all blasts,
    with a random sign: as large, as long, as coloured and as repeatable as those that were found,
    but without the geometry that any effect has. Effects act by their linear changes, those that
    need no runs also at all places together where they pay, as in the search; theory.md (14.4).
    With one receiver there is no other: then nothing is beyond chance.
    """
    rng = np.random.default_rng(seed)
    likelihood = scene.baseline.likelihood
    left = likelihood.left(none.motion)
    n_receivers = left.shape[1]
    if n_receivers == 1:
        return Chance(np.full(SURROGATES, np.inf))
    orders = np.stack([_elsewhere(rng, n_receivers) for _ in range(SURROGATES)])
    signs = rng.choice([-1.0, 1.0], size=orders.shape)
    most = np.full(SURROGATES, -np.inf)
    for changes, places in _changes(scene, none, guesses):
        shuffled = _Shuffled(likelihood, none.columns, changes, left)
        found = [shuffled.best(*one, np.log(places)) for one in zip(orders, signs, strict=True)]
        most = np.maximum(most, found)
    return Chance(np.sort(most))


def _elsewhere(rng, n):
    """Return an order of n things in which none stays where it is."""
    while True:
        order = rng.permutation(n)
        if not np.any(order == np.arange(n)):
            return order


def _changes(scene, none, guesses):
    """Yield whitened columns of each effect by places that may go together, and how many it has."""
    likelihood, case = scene.baseline.likelihood, scene.case
    for guess in guesses:
        yield [likelihood.white(guess.change)[None]], len(guess.effect.hypothesis.targets(case))
    for hypothesis in LIBRARY.values():
        if hypothesis.on == "site":
            continue
        changes = []
        for target in hypothesis.targets(case):
            effect = started(hypothesis, target, scene)[0]
            fitter = Fitter(scene, (effect,), none.values)
            place = fitter.start()
            free = np.arange(len(place)) >= len(fitter.sigma)
            motion = fitter.motions([place])[0]
            changes.append(fitter.columns(place, motion, free)[free])
        if changes:
            yield changes, len(changes)


class _Shuffled:
    """Linear fits of an effect to residuals that change receivers.

    Parameters
    ----------
    likelihood : Likelihood
    own : (n, n_blasts, n_receivers, m) float64
        Columns of the values of the site, which always adapt.
    changes : sequence of (n_knobs, n_blasts, n_receivers, m) float64
        Columns of the effect at each of its places.
    left : (n_blasts, n_receivers, m) float64
    """

    def __init__(self, likelihood, own, changes, left):
        columns = np.concatenate([own, *changes])
        self.likelihood = likelihood
        self.products = np.einsum("ibrm,jbrm->brij", columns, columns, optimize=True)
        self.pulls = np.einsum("ibrm,bsm->brsi", columns, left, optimize=True)
        there = np.diagonal(likelihood.roots, axis1=2, axis2=3) > 0.0
        self.energy = np.einsum("brm,bsm->brs", there, left**2, optimize=True)
        ends = np.cumsum([len(own), *map(len, changes)])
        self.own = np.arange(len(own))
        self.places = [np.arange(*pair) for pair in pairwise(ends)]

    def best(self, order, sign, paid):
        """Return the evidence over nothing of one surrogate, when each place costs so much."""
        nothing, squares = self._one(order, sign, [])
        alone = [self._one(order, sign, [place]) for place in self.places]
        most = max(evidence for evidence, _ in alone) - paid
        paying = [
            place for place, (_, left) in zip(self.places, alone, strict=True)
            if squares - left > 2.0 * GROWS
        ]  # fmt: skip
        if len(paying) > 1:
            most = max(most, self._one(order, sign, paying)[0] - len(paying) * paid)
        return most - nothing

    def _one(self, order, sign, places):
        """Return evidence and misfit with what the priors take, of the effect at some places."""
        likelihood, here = self.likelihood, np.arange(len(order))
        used = np.concatenate([self.own, *places])
        kept = np.maximum(likelihood.kept, 1)
        size = self.energy[:, here, order] / kept
        weights = likelihood.weights(size)
        pulls = self.pulls[:, here, order][..., used] * sign[:, None]
        products = self.products[..., used[:, None], used]
        curvature = np.einsum("br,brij->ij", weights, products) + np.eye(len(used))
        move = np.linalg.solve(curvature, np.einsum("br,bri->i", weights, pulls))
        drop = 2.0 * pulls @ move - products @ move @ move
        squares = likelihood.misfit_of(np.maximum(size - drop / kept, 0.0)) + move @ move
        return -0.5 * (squares + np.linalg.slogdet(curvature)[1]), squares
