"""Null distribution of the evidence, from permuted residuals, and detection limits."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from .effects import Effect, Scene
from .fitting import DIFFERENCE, Fit, Fitter, hessian_of
from .hypotheses import LIBRARY
from .search import Guess, material, started
from .thresholds import DECISIVE, LINEAR, NULL_LEVEL, SURROGATES

SPREAD = 1.645  # standard deviations of 90 % of a normal distribution, both sides


@dataclass(frozen=True, eq=False)
class Chance:
    """The largest evidence in each of many surrogates, in nats over that of nothing.

    First of an effect at one place, then of one at however many places where it pays.

    Parameters
    ----------
    shuffled : (2, n_surrogates) float64
        Over the library, in residuals that changed receivers; sorted.
    harmless : dict of str to (2, n_surrogates) float64
        For each label on its own, in small errors of every path; sorted.
    """

    shuffled: np.ndarray
    harmless: dict

    def needed(self, effects) -> float:
        """Return what 95 % of surrogates stay below, nats, for some effects; never negative."""
        return max(float(np.quantile(some, NULL_LEVEL)) for some in self._of(effects))

    def interval(self, effects) -> tuple[float, float]:
        """Return where that lies by its order statistics, with 90 % probability."""
        some = max(self._of(effects), key=lambda one: float(np.quantile(one, NULL_LEVEL)))
        n = len(some)
        spread = SPREAD * np.sqrt(n * NULL_LEVEL * (1.0 - NULL_LEVEL))
        first, last = (int(np.clip(n * NULL_LEVEL + d, 0, n - 1)) for d in (-spread, spread))
        return float(some[first]), float(some[last])

    def _of(self, effects):
        """Return the distributions that count for effects."""
        labels = {effect.label for effect in effects}
        several = int(len(effects) > len(labels))
        own = [self.harmless[label] for label in labels if label in self.harmless]
        return [np.maximum(some[several], 0.0) for some in (self.shuffled, *own)]


def chance(scene: Scene, none: Fit, guesses: list[Guess], fits: list[Fit], seed: int) -> Chance:
    """Search shuffled residuals, and harmless errors, for the effects of the library.

    Parameters
    ----------
    scene : Scene
    none : Fit
        Without effects; what it leaves is shuffled.
    guesses : list of Guess
        Effects on the site, whose changes were run.
    fits : list of Fit
        Those of these effects that were fitted are taken by their knobs, in all blasts.
    seed : int

    Notes
    -----
    A surrogate gives each receiver the residuals of another one, never its own, in all blasts,
    with a random sign: as large, as long, as coloured and as repeatable as those that were found,
    but without the geometry that any effect has. Harmless errors have that of some: all paths are
    a little late, or strong, or turned, alike in all blasts. Effects act by their linear changes,
    those that need no runs also at all places together where they pay, as in the search;
    theory.md (14.4). With one receiver there is no other: then nothing is beyond chance.
    """
    rng = np.random.default_rng(seed)
    likelihood = scene.baseline.likelihood
    left = lent(likelihood.residual(none.motion), likelihood.n_data)
    n_receivers = left.shape[1]
    if n_receivers == 1:
        return Chance(np.full((2, SURROGATES), np.inf), {})
    orders = np.stack([_elsewhere(rng, n_receivers) for _ in range(SURROGATES)])
    signs = rng.choice([-1.0, 1.0], size=orders.shape)
    errors = _harmless(scene, none)
    drawn = rng.standard_normal((SURROGATES, n_receivers))
    most, harmless = np.full((2, SURROGATES), -np.inf), {}
    for label, changes, places in _changes(scene, none, guesses, fits):
        fits, paid = _Fits(likelihood, none.jacobian, changes), np.log(places)
        most = np.maximum(most, fits.best(*fits.shuffled(left, orders, signs), paid))
        for kind, error in enumerate(errors):
            found = fits.best(*fits.errors(error, drawn), paid)
            known = harmless.setdefault(label, np.full((len(errors), 2, SURROGATES), -np.inf))
            known[kind] = np.maximum(known[kind], found)
    return Chance(np.sort(most), {name: _largest(some) for name, some in harmless.items()})


def lent(left, kept):
    """Return residuals (n_blasts, n_receivers, m) with those of another blast where none is kept.

    They go to receivers that recorded: nothing in their place would be less than chance leaves.
    """
    known = kept > 0
    other = np.where(known, np.arange(len(kept))[:, None], np.argmax(known, axis=0))
    return np.take_along_axis(left, other[..., None], axis=0)


def _harmless(scene, none):
    """Return whitened errors (3, n_blasts, n_receivers, m): late, strong, turned.

    Each leaves at each receiver, over its blasts, what is left at the median one in its best blast
    but for noise, which does not come back.
    """
    likelihood, motion = scene.baseline.likelihood, none.motion
    turned = np.zeros_like(motion)
    turned[:, :, 0], turned[:, :, 1] = motion[:, :, 1], -motion[:, :, 0]
    white = likelihood.whiten(np.stack([np.gradient(motion, axis=-1), motion, turned]))
    there = likelihood.n_data > 0
    again = np.maximum(none.chi_square - likelihood.noise_share, 0.0)
    best = np.min(again, axis=0, where=there, initial=np.inf)
    sizes = np.sum([likelihood.chi_square(one) * there for one in white], axis=1)
    sizes = sizes / np.maximum(there.sum(axis=0), 1)
    level = np.median(best[there.any(axis=0)])
    scale = np.sqrt(np.divide(level, sizes, out=np.zeros_like(sizes), where=sizes > 0.0))
    return white * scale[:, None, :, None]


def _largest(kinds):
    """Return the sorted evidence (2, n) of the kinds (n_kinds, 2, n) of error that give most."""
    most = np.argmax(np.quantile(kinds, NULL_LEVEL, axis=-1), axis=0)
    return np.sort(kinds[most, np.arange(len(most))])


def _elsewhere(rng, n):
    """Return an order of n things in which none stays where it is."""
    while True:
        order = rng.permutation(n)
        if not np.any(order == np.arange(n)):
            return order


def _changes(scene, none, guesses, fits):
    """Yield label, whitened columns by places that may go together, how many places it has."""
    likelihood, case = scene.baseline.likelihood, scene.case
    fitted = {one.where: one for one in fits if len(one.effects) == 1}
    for guess in guesses:
        one = fitted.get(frozenset([guess.effect.where]))
        changes = likelihood.whiten(guess.change)[None] if one is None else one.effect_jacobian
        yield guess.effect.label, [changes], len(guess.effect.hypothesis.targets(case))
    guessed = {frozenset([guess.effect.where]) for guess in guesses}
    for where, one in fitted.items():  # forms that no screening had
        hypothesis = one.effects[0].hypothesis
        if hypothesis.on == "site" and where not in guessed:
            yield hypothesis.label, [one.effect_jacobian], len(hypothesis.targets(case))
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
            changes.append(fitter.jacobian(place, motion, free)[free])
        if changes:
            yield hypothesis.label, changes, len(changes)


class _Fits:
    """Linear fits of an effect to surrogates.

    Parameters
    ----------
    likelihood : Likelihood
    own : (n, n_blasts, n_receivers, m) float64
        Columns of the values of the site, which always adapt.
    changes : sequence of (n_knobs, n_blasts, n_receivers, m) float64
        Columns of the effect at each of its places.
    """

    def __init__(self, likelihood, own, changes):
        self.columns = np.concatenate([own, *changes])
        self.likelihood, self.kept = likelihood, np.maximum(likelihood.n_data, 1)
        self.products = np.einsum("ibrm,jbrm->brij", self.columns, self.columns, optimize=True)
        ends = np.cumsum([len(own), *map(len, changes)])
        self.own = np.arange(len(own))
        self.places = [np.arange(*pair) for pair in pairwise(ends)]

    def shuffled(self, left, orders, signs):
        """Return sizes and products with the columns of residuals that change receivers.

        Parameters
        ----------
        left : (n_blasts, n_receivers, m) float64
        orders, signs : (n_surrogates, n_receivers) int, float64

        Returns
        -------
        size : (n_surrogates, n_blasts, n_receivers) float64
        pulls : (n_surrogates, n_blasts, n_receivers, n_columns) float64
        """
        there = np.diagonal(self.likelihood.covariance.roots, axis1=2, axis2=3) > 0.0
        energy = np.einsum("brm,bsm->brs", there, left**2, optimize=True)
        pulls = np.einsum("ibrm,bsm->brsi", self.columns, left, optimize=True)
        here = np.arange(left.shape[1])
        size = np.moveaxis(energy[:, here, orders], 0, 1) / self.kept
        return size, np.moveaxis(pulls[:, here, orders], 0, 1) * signs[:, None, :, None]

    def errors(self, error, parts):
        """Return the same of one error (n_blasts, n_receivers, m) of every path, in all blasts.

        Parts (n_surrogates, n_receivers) of it.
        """
        size = np.sum(error**2, axis=-1) / self.kept
        pulls = np.einsum("ibrm,brm->bri", self.columns, error, optimize=True)
        return size * parts[:, None] ** 2, pulls * parts[:, None, :, None]

    def best(self, size, pulls, paid):
        """Return the evidence (2, n_surrogates) over nothing, of one place and of however many.

        Each place costs ``paid``. Surrogates are given by `shuffled` or `errors`.
        """
        surrogates = size, pulls, self.likelihood.weights(size)
        nothing, squares = self._fitted(surrogates, [])
        alone = [self._fitted(surrogates, [place]) for place in self.places]
        one = np.max([evidence for evidence, _ in alone], axis=0) - paid
        most = one.copy()
        paying = np.array([squares - left > 2.0 * DECISIVE for _, left in alone])
        for n in np.flatnonzero(paying.sum(axis=0) > 1):
            some = [place for place, pays in zip(self.places, paying[:, n], strict=True) if pays]
            together, _ = self._fitted([part[n : n + 1] for part in surrogates], some)
            most[n] = max(most[n], together[0] - len(some) * paid)
        return np.stack([one - nothing, most - nothing])

    def _fitted(self, surrogates, places):
        """Return evidence and misfit with what the priors take, of the effect at some places."""
        used = np.concatenate([self.own, *places])
        size, pulls, weights = surrogates
        pulls, products = pulls[..., used], self.products[..., used[:, None], used]
        curvature = np.einsum("nbr,brij->nij", weights, products, optimize=True) + np.eye(len(used))
        pull = np.einsum("nbr,nbri->ni", weights, pulls, optimize=True)
        move = np.linalg.solve(curvature, pull[..., None])[..., 0]
        drop = 2.0 * np.einsum("nbri,ni->nbr", pulls, move, optimize=True)
        drop -= np.einsum("brij,ni,nj->nbr", products, move, move, optimize=True)
        left = np.maximum(size - drop / self.kept, 0.0)
        squares = self.likelihood.misfit_of(left) + np.sum(move**2, axis=-1)
        return -0.5 * (squares + np.linalg.slogdet(curvature)[1]), squares


HALVINGS = 40


def visible(scene: Scene, fit: Fit, least: float = DECISIVE) -> list[dict]:
    """List the smallest effects that would not have passed unseen beside a fit.

    Parameters
    ----------
    scene : Scene
    fit : Fit
        That explains all; nothing is said beside one that does not.
    least : float
        Nats that an effect must bring.

    Returns
    -------
    list of dict
        Of each knob that tells its ``nothing``: ``label``, ``form``, ``knob``, ``unit``,
        ``nothing``, and the ``amount`` from there on that would have been seen at every target but
        the ``unseen`` ones. Knobs that no target would have shown are left out.

    Notes
    -----
    Theory.md (14.7). An amount at which the change is no longer like its derivative is left out.
    """
    found = []
    if material(fit.chi_square):
        return found
    for one in LIBRARY.values():
        if one.label in fit.labels or one.untestable(scene.case):
            continue
        for place, knob in enumerate(one.parameters):
            if knob.null is None:
                continue
            targets = one.targets(scene.case)
            amounts = {t: _amount(scene, fit, one, t, place, least) for t in targets}
            seen = [amount for amount in amounts.values() if np.isfinite(amount)]
            if seen:
                found.append({
                    "label": one.label, "form": one.form, "target": one.target, "knob": knob.name,
                    "unit": knob.unit, "per_hole": knob.per_hole, "nothing": knob.null,
                    "amount": max(seen),
                    "unseen": [t for t, amount in amounts.items() if not np.isfinite(amount)],
                })  # fmt: skip
    return found


def _amount(scene, fit, one, target, place, least):
    """Return the smallest visible change of one knob at a target, of its worst hole if of each.

    Holes without a charge send nothing, whatever their knobs, and don't count.
    """
    knob, case, likelihood = one.parameters[place], scene.case, scene.baseline.likelihood
    charges = case.project.blasts[target].charge if knob.per_hole else np.ones(1)
    live = np.flatnonzero(charges > 0.0)
    unit = knob.sigma * (knob.null or knob.mean or 1.0) if knob.log else knob.sigma
    step = DIFFERENCE * unit
    cost = np.log(len(one.targets(case)) * len(live)) + least
    farthest = max(abs(e - knob.null) for e in (knob.low, knob.high) if np.isfinite(e))
    left = likelihood.residual(fit.motion)

    def change(hole, amount):
        values = [(other.mean,) for other in one.parameters]
        changed = np.full(len(charges), knob.null)
        changed[hole] += amount
        values[place] = tuple(changed.tolist())
        effect = Effect(one.name, target, tuple(values))
        return left - likelihood.residual(scene.received(fit.motion, (effect,)))

    amounts = []
    for hole in live:
        slope = change(hole, step) / step
        amount = _smallest(likelihood, fit, slope, unit, cost, farthest)
        if np.isfinite(amount):
            grown = np.sum(change(hole, amount) ** 2) / np.sum((amount * slope) ** 2)
            amount = amount if 1.0 / LINEAR < grown < LINEAR else np.inf
        amounts.append(amount)
    return max(amounts)


def _smallest(likelihood, fit, change, unit, cost, farthest):
    """Return the smallest amount of a whitened change that shows; infinite beyond the farthest."""
    weights = likelihood.weights(fit.chi_square)
    pull = np.einsum("ibrm,brm,br->i", fit.jacobian, change, weights, optimize=True)
    taken = np.linalg.solve(hessian_of(fit.jacobian, weights), pull)
    change = change - np.tensordot(taken, fit.jacobian, 1)
    size = likelihood.chi_square(change)
    cost += 0.5 * np.log1p(unit**2 * np.sum(weights * likelihood.n_data * size))
    before = likelihood.misfit_of(fit.chi_square)

    def seen(amount):
        after = fit.chi_square + amount**2 * size
        return material(after) and 0.5 * (likelihood.misfit_of(after) - before) >= cost

    if not seen(farthest):
        return np.inf
    low, high = 0.0, farthest
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if seen(middle) else (middle, high)
    return float(high)
