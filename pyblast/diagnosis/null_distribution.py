"""Null distribution of the evidence, from permuted residuals."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from .effects import Effect, Scene, starting_effects
from .fitting import Fit, Fitter
from .hypotheses import LIBRARY
from .search import ScreeningResult
from .thresholds import DECISIVE, NULL_LEVEL, SURROGATES

SPREAD = 1.645  # standard deviations of 90 % of a normal distribution, both sides


@dataclass(frozen=True, eq=False)
class NullDistribution:
    """Null distribution: the largest log Bayes factor (Δ ln evidence) in each of many surrogates.

    First index: of an effect at one target, of an effect at all targets where it pays.

    Parameters
    ----------
    permuted : (2, n_surrogates) float64
        Of any effect of the library, in residuals permuted between receivers; sorted.
    path_errors : dict of str to (2, n_surrogates) float64
        Of each label, in simulated model errors of all paths; sorted.
    """

    permuted: np.ndarray
    path_errors: dict[str, np.ndarray]

    def threshold(self, effects: Sequence[Effect]) -> float:
        """Return the quantile `NULL_LEVEL` for some effects, Δ ln evidence; never negative."""
        return max(map(_quantile, self._distributions(effects)))

    def threshold_interval(self, effects: Sequence[Effect]) -> tuple[float, float]:
        """Return the 90 % interval of that quantile, from order statistics."""
        values = max(self._distributions(effects), key=_quantile)
        n = len(values)
        spread = SPREAD * np.sqrt(n * NULL_LEVEL * (1.0 - NULL_LEVEL))
        first, last = (int(np.clip(n * NULL_LEVEL + d, 0, n - 1)) for d in (-spread, spread))
        return float(values[first]), float(values[last])

    def _distributions(self, effects):
        """Return the distributions that apply to effects."""
        labels = {effect.label for effect in effects}
        several = int(len(effects) > len(labels))
        own = [self.path_errors[label] for label in labels if label in self.path_errors]
        return [np.maximum(values[several], 0.0) for values in (self.permuted, *own)]


def _quantile(values):
    """Return the quantile of a null distribution that an effect must exceed."""
    return float(np.quantile(values, NULL_LEVEL))


def null_distribution(
    scene: Scene,
    without_effects: Fit,
    screening: Sequence[ScreeningResult],
    fits: Sequence[Fit],
    seed: int,
) -> NullDistribution:
    """Estimate the null distribution by a permutation test and by simulated path errors.

    Parameters
    ----------
    scene : Scene
    without_effects : Fit
        Its residuals are permuted.
    screening : sequence of ScreeningResult
        Effects on the site, with their simulated changes.
    fits : sequence of Fit
        Of effects that were fitted, the derivatives by their parameters are used.
    seed : int

    Returns
    -------
    NullDistribution

    Notes
    -----
    A surrogate gives each receiver the residuals of another one, the same in all blasts, with a
    random sign: the size, duration, spectrum and repeatability of the residuals stay, and the
    geometry that any effect has is lost. Path errors keep geometry: all paths are slightly
    delayed, amplified or rotated, alike in all blasts. Effects act linearly; those without runs
    are tried at single targets and at all targets where they pay, as in the search; theory.md
    (14.4). With one receiver there is no permutation, and the threshold is infinite.
    """
    rng = np.random.default_rng(seed)
    likelihood = scene.baseline.likelihood
    residual = filled_residual(likelihood.residual(without_effects.motion), likelihood.n_data)
    n_receivers = residual.shape[1]
    if n_receivers == 1:
        return NullDistribution(np.full((2, SURROGATES), np.inf), {})
    orders = np.stack([_derangement(rng, n_receivers) for _ in range(SURROGATES)])
    signs = rng.choice([-1.0, 1.0], size=orders.shape)
    errors = _path_errors(scene, without_effects)
    sizes = rng.standard_normal((SURROGATES, n_receivers))
    permuted, by_label = np.full((2, SURROGATES), -np.inf), {}
    for label, changes, n_targets in _jacobians(scene, without_effects, screening, fits):
        linear = _LinearFits(likelihood, without_effects.jacobian, changes)
        penalty = np.log(n_targets)
        evidence = linear.best(*linear.permuted(residual, orders, signs), penalty)
        permuted = np.maximum(permuted, evidence)
        for kind, error in enumerate(errors):
            evidence = linear.best(*linear.scaled(error, sizes), penalty)
            start = np.full((len(errors), 2, SURROGATES), -np.inf)
            known = by_label.setdefault(label, start)
            known[kind] = np.maximum(known[kind], evidence)
    largest = {label: _largest_kind(kinds) for label, kinds in by_label.items()}
    return NullDistribution(np.sort(permuted), largest)


def filled_residual(residual, n_data) -> np.ndarray:
    """Fill missing records by residuals of the same receiver in another blast.

    Parameters
    ----------
    residual : (n_blasts, n_receivers, m) float64
        Whitened.
    n_data : (n_blasts, n_receivers) int
        0 where there is no record.

    Returns
    -------
    (n_blasts, n_receivers, m) float64
        Zeros in their place would lower the null distribution, since residuals are permuted to
        receivers with records.
    """
    known = n_data > 0
    blast = np.where(known, np.arange(len(n_data))[:, None], np.argmax(known, axis=0))
    return np.take_along_axis(residual, blast[..., None], axis=0)


def _path_errors(scene, fit):
    """Return whitened errors (3, n_blasts, n_receivers, m) by delays, gains and rotations.

    Each leaves at each receiver, over its blasts, the chi-square of the median receiver in its
    best blast, less that of noise, which does not repeat.
    """
    likelihood, motion = scene.baseline.likelihood, fit.motion
    rotated = np.zeros_like(motion)
    rotated[:, :, 0], rotated[:, :, 1] = motion[:, :, 1], -motion[:, :, 0]
    white = likelihood.whiten(np.stack([np.gradient(motion, axis=-1), motion, rotated]))
    exists = likelihood.n_data > 0
    repeating = np.maximum(fit.chi_square - likelihood.noise_share, 0.0)
    best = np.min(repeating, axis=0, where=exists, initial=np.inf)
    chi_square = np.sum([likelihood.chi_square(error) * exists for error in white], axis=1)
    chi_square = chi_square / np.maximum(exists.sum(axis=0), 1)
    level = np.median(best[exists.any(axis=0)])
    zeros = np.zeros_like(chi_square)
    scale = np.sqrt(np.divide(level, chi_square, out=zeros, where=chi_square > 0.0))
    return white * scale[:, None, :, None]


def _largest_kind(kinds):
    """Return the sorted evidence (2, n) of the kinds of error (n_kinds, 2, n) that give most."""
    most = np.argmax(np.quantile(kinds, NULL_LEVEL, axis=-1), axis=0)
    return np.sort(kinds[most, np.arange(len(most))])


def _derangement(rng, n):
    """Return a random permutation of n without fixed points."""
    while True:
        order = rng.permutation(n)
        if not np.any(order == np.arange(n)):
            return order


def _jacobians(
    scene: Scene, without_effects: Fit, screening: Sequence[ScreeningResult], fits: Sequence[Fit]
) -> Iterator[tuple[str, list[np.ndarray], int]]:
    """Yield label, whitened derivatives by target that may act together, number of targets."""
    likelihood, case = scene.baseline.likelihood, scene.case
    fitted = {fit.where: fit for fit in fits if len(fit.effects) == 1}
    for result in screening:
        fit = fitted.get(frozenset([result.effect.where]))
        change = likelihood.whiten(result.change)[None]
        if fit is not None and len(fit.effect_jacobian):
            change = fit.effect_jacobian
        yield result.effect.label, [change], len(result.effect.hypothesis.targets(case))
    screened = {frozenset([result.effect.where]) for result in screening}
    for where, fit in fitted.items():  # forms that were not screened
        hypothesis = fit.effects[0].hypothesis
        if hypothesis.on == "site" and where not in screened and len(fit.effect_jacobian):
            yield hypothesis.label, [fit.effect_jacobian], len(hypothesis.targets(case))
    for hypothesis in LIBRARY.values():
        if hypothesis.on == "site":
            continue
        changes = []
        for target in hypothesis.targets(case):
            effect = starting_effects(hypothesis, target, scene)[0]
            fitter = Fitter(scene, (effect,), without_effects.values)
            x = fitter.start()
            free = np.arange(len(x)) >= len(fitter.sigma)
            motion = fitter.motions([x])[0]
            if motion is not None:
                changes.append(fitter.jacobian(x, motion, free)[free])
        if changes:
            yield hypothesis.label, changes, len(changes)


class _LinearFits:
    """Linear fits of an effect to surrogates.

    Parameters
    ----------
    likelihood : Likelihood
    calibrated : (n, n_blasts, n_receivers, m) float64
        Derivatives by the calibrated parameters, which are always fitted.
    changes : sequence of (n_parameters, n_blasts, n_receivers, m) float64
        Derivatives by the parameters of the effect at each of its targets.
    """

    def __init__(self, likelihood, calibrated, changes):
        self.jacobian = np.concatenate([calibrated, *changes])
        self.likelihood, self.n_data = likelihood, np.maximum(likelihood.n_data, 1)
        self.products = np.einsum("ibrm,jbrm->brij", self.jacobian, self.jacobian, optimize=True)
        ends = np.cumsum([len(calibrated), *map(len, changes)])
        self.calibrated = np.arange(len(calibrated))
        self.targets = [np.arange(*pair) for pair in pairwise(ends)]

    def permuted(self, residual, orders, signs):
        """Return chi-squares of permuted residuals, and their products with the Jacobian.

        Parameters
        ----------
        residual : (n_blasts, n_receivers, m) float64
        orders, signs : (n_surrogates, n_receivers) int, float64

        Returns
        -------
        chi_square : (n_surrogates, n_blasts, n_receivers) float64
        gradients : (n_surrogates, n_blasts, n_receivers, n) float64
        """
        used = np.diagonal(self.likelihood.covariance.roots, axis1=2, axis2=3) > 0.0
        energy = np.einsum("brm,bsm->brs", used, residual**2, optimize=True)
        gradients = np.einsum("ibrm,bsm->brsi", self.jacobian, residual, optimize=True)
        receivers = np.arange(residual.shape[1])
        chi_square = np.moveaxis(energy[:, receivers, orders], 0, 1) / self.n_data
        gradients = np.moveaxis(gradients[:, receivers, orders], 0, 1)
        return chi_square, gradients * signs[:, None, :, None]

    def scaled(self, error, sizes):
        """Return the same for one error of all paths with random sizes.

        Parameters
        ----------
        error : (n_blasts, n_receivers, m) float64
        sizes : (n_surrogates, n_receivers) float64
        """
        chi_square = np.sum(error**2, axis=-1) / self.n_data
        gradients = np.einsum("ibrm,brm->bri", self.jacobian, error, optimize=True)
        return chi_square * sizes[:, None] ** 2, gradients * sizes[:, None, :, None]

    def best(self, chi_square, gradients, penalty):
        """Return the Δ ln evidence (2, n_surrogates) of one target, and of all that pay.

        Each target costs ``penalty``. Surrogates are given by `permuted` or `scaled`.
        """
        surrogates = chi_square, gradients, self.likelihood.weights(chi_square)
        without, misfit = self._fitted(surrogates, [])
        single = [self._fitted(surrogates, [target]) for target in self.targets]
        best = np.max([evidence for evidence, _ in single], axis=0) - penalty
        several = best.copy()
        paying = np.array([misfit - after > 2.0 * DECISIVE for _, after in single])
        for n in np.flatnonzero(paying.sum(axis=0) > 1):
            targets = [t for t, pays in zip(self.targets, paying[:, n], strict=True) if pays]
            together, _ = self._fitted([part[n : n + 1] for part in surrogates], targets)
            several[n] = max(several[n], together[0] - len(targets) * penalty)
        return np.stack([best - without, several - without])

    def _fitted(self, surrogates, targets):
        """Return ln evidence and misfit with that of the priors, of the effect at targets."""
        used = np.concatenate([self.calibrated, *targets])
        chi_square, gradients, weights = surrogates
        gradients, products = gradients[..., used], self.products[..., used[:, None], used]
        hessian = np.einsum("nbr,brij->nij", weights, products, optimize=True) + np.eye(len(used))
        gradient = np.einsum("nbr,nbri->ni", weights, gradients, optimize=True)
        step = np.linalg.solve(hessian, gradient[..., None])[..., 0]
        drop = 2.0 * np.einsum("nbri,ni->nbr", gradients, step, optimize=True)
        drop -= np.einsum("brij,ni,nj->nbr", products, step, step, optimize=True)
        after = np.maximum(chi_square - drop / self.n_data, 0.0)
        misfit = self.likelihood.misfit_of(after) + np.sum(step**2, axis=-1)
        return -0.5 * (misfit + np.linalg.slogdet(hessian)[1]), misfit
