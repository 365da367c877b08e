"""How much evidence chance alone would find: the whole library on residuals that were shuffled."""

from dataclasses import dataclass

import numpy as np

from .fitting import Fit, Fitter
from .hypotheses import LIBRARY
from .scene import Scene
from .search import Guess, started

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
    but without the geometry that any effect has. Effects act by their linear changes; theory.md
    (14.4). With one receiver there is no other: then nothing is beyond chance.
    """
    rng = np.random.default_rng(seed)
    likelihood = scene.baseline.likelihood
    left = likelihood.left(none.motion)
    own = none.columns
    n_receivers = left.shape[1]
    if n_receivers == 1:
        return Chance(np.full(SURROGATES, np.inf))
    orders = np.stack([_elsewhere(rng, n_receivers) for _ in range(SURROGATES)])
    signs = rng.choice([-1.0, 1.0], size=orders.shape)
    nothing = _Shuffled(likelihood, own, left).best(orders, signs)
    most = np.full(SURROGATES, -np.inf)
    for columns, places in _changes(scene, none, guesses):
        both = np.concatenate([own, columns])
        found = _Shuffled(likelihood, both, left).best(orders, signs)
        most = np.maximum(most, found - nothing - np.log(places))
    return Chance(np.sort(most))


def _elsewhere(rng, n):
    """Return an order of n things in which none stays where it is."""
    while True:
        order = rng.permutation(n)
        if not np.any(order == np.arange(n)):
            return order


def _changes(scene, none, guesses):
    """Yield whitened columns of each effect at each place, and the number of its places."""
    likelihood, case = scene.baseline.likelihood, scene.case
    for guess in guesses:
        yield likelihood.white(guess.change)[None], len(guess.effect.hypothesis.targets(case))
    for hypothesis in LIBRARY.values():
        if hypothesis.on == "site":
            continue
        targets = hypothesis.targets(case)
        for target in targets:
            effect = started(hypothesis, target, scene)[0]
            fitter = Fitter(scene, (effect,), none.values)
            place = fitter.start()
            free = np.arange(len(place)) >= len(fitter.sigma)
            motion = fitter.motions([place])[0]
            yield fitter.columns(place, motion, free)[free], len(targets)


class _Shuffled:
    """Linear fits of columns to residuals that change receivers.

    Parameters
    ----------
    likelihood : Likelihood
    columns : (n, n_blasts, n_receivers, m) float64
    left : (n_blasts, n_receivers, m) float64
    """

    def __init__(self, likelihood, columns, left):
        self.likelihood, self.size = likelihood, likelihood.size(left)
        self.products = np.einsum("ibrm,jbrm->brij", columns, columns, optimize=True)
        self.pulls = np.einsum("ibrm,bsm->brsi", columns, left, optimize=True)

    def best(self, orders, signs):
        """Return the evidence (n_surrogates,) of the best fit to each surrogate."""
        return np.array([self._one(o, s) for o, s in zip(orders, signs, strict=True)])

    def _one(self, order, sign):
        """Return the evidence of one surrogate."""
        likelihood, size = self.likelihood, self.size[:, order]
        weights = likelihood.weights(size)
        here = np.arange(len(order))
        pulls = self.pulls[:, here, order] * sign[:, None]
        curvature = np.einsum("br,brij->ij", weights, self.products)
        curvature += np.eye(len(curvature))
        move = np.linalg.solve(curvature, np.einsum("br,bri->i", weights, pulls))
        drop = 2.0 * pulls @ move - np.einsum("i,brij,j->br", move, self.products, move)
        after = np.maximum(size - drop / np.maximum(likelihood.kept, 1), 0.0)
        misfit = likelihood.misfit_of(after) + move @ move
        return -0.5 * (misfit + np.linalg.slogdet(curvature)[1])
