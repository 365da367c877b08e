"""Cross-validation: prediction of receivers and blasts that were held out of a fit."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..errors import contained
from .effects import Scene
from .fitting import Fit, hessian_of, unwhitened
from .hypotheses import blast_and_hole
from .thresholds import (
    CONSTRAINED,
    DECISIVE,
    FEW_SUBSETS,
    GAINING_SUBSETS,
    LEAST_LOSS,
    STANDARD_ERRORS,
)


@dataclass(frozen=True)
class Subset:
    """Held-out subset: the records of one receiver or of one blast.

    Parameters
    ----------
    name : str
        Of the receiver or blast.
    delta_ln_likelihood : float
        Gain in predictive ln likelihood by the effect.
    variance_reduction_before, variance_reduction_after : float
        Share of its whitened energy that is predicted without and with the effect.
    """

    name: str
    delta_ln_likelihood: float
    variance_reduction_before: float
    variance_reduction_after: float


@dataclass(frozen=True)
class CrossValidation:
    """Result of a cross-validation.

    Parameters
    ----------
    subsets : tuple of Subset
        Each was held out in turn.
    """

    subsets: tuple[Subset, ...]

    @property
    def delta_ln_likelihood(self) -> float:
        """Gain in predictive ln likelihood, the sum over the subsets."""
        return float(sum(self._gains))

    @property
    def standard_error(self) -> float:
        """Standard error of the sum; infinite with fewer than two subsets."""
        if len(self.subsets) < 2:
            return np.inf
        return float(np.std(self._gains, ddof=1) * np.sqrt(len(self.subsets)))

    @property
    def improves(self) -> bool:
        """Whether the effect improves the prediction of held-out records."""
        gains = self._gains
        if len(gains) <= FEW_SUBSETS:
            gaining = all(gain > 0.0 for gain in gains)
            return len(gains) > 1 and self.delta_ln_likelihood > DECISIVE and gaining
        share = np.mean([gain > -LEAST_LOSS for gain in gains])
        significant = self.delta_ln_likelihood > STANDARD_ERRORS * self.standard_error
        return bool(significant and share >= GAINING_SUBSETS)

    @property
    def supports(self) -> bool:
        """Whether nothing contradicts the effect: it improves, or no record could be held out."""
        return self.improves or not self.subsets

    @property
    def _gains(self):
        """The gain of each subset."""
        return [subset.delta_ln_likelihood for subset in self.subsets]


def cross_validate(scene: Scene, before: Fit, after: Fit) -> CrossValidation:
    """Hold out receivers, blasts or both in turn, by the axes of the effects.

    Parameters
    ----------
    scene : Scene
    before, after : Fit
        Without and with the effects that are tested.

    Returns
    -------
    CrossValidation

    Notes
    -----
    Effects of a blast are tested on receivers, those of a receiver on blasts, those of the ground
    on both. Not held out are: the target of an effect; a subset without records, or whose
    motion the effect hardly changes; a subset without which the others do not constrain the
    effect, by its parameters or by the misfit, such as the one blast in which a joint slips; a
    subset whose refit fails. Each refit is one linear step from the fit to all records; theory.md
    (14.5).
    """
    added = [effect for effect in after.effects if effect.label not in before.labels]
    targets = {blast_and_hole(effect.target)[0] for effect in added}
    owners = [effect for effect in after.effects for values in effect.values for _ in values]
    own = [[owner is effect for owner in owners] for effect in added]
    change = _expected_gain(scene, before, after)
    subsets = []
    for name, records in _possible_subsets(scene.case, added):
        out = np.zeros(change.shape, dtype=bool)
        out[records] = True
        if name in targets or np.sum(change[records]) < LEAST_LOSS:
            continue
        with contained({}, f"{name} held out"):
            step, hessian = step_without(scene, after, out)
            first = _prediction(scene, before, step_without(scene, before, out)[0], out)
            second = _prediction(scene, after, step, out)
            detected = 0.5 * (first.misfit_of_others - second.misfit_of_others) > DECISIVE
            variance = np.diag(np.linalg.inv(hessian))[len(after.values) :]
            if detected or _is_constrained(variance, own):
                gain = 0.5 * (first.misfit - second.misfit)
                subsets.append(
                    Subset(name, gain, first.variance_reduction, second.variance_reduction)
                )
    return CrossValidation(tuple(subsets))


def _possible_subsets(case, added):
    """Return name and index of the receivers and blasts that effects may have to predict."""
    axes, subsets = {effect.hypothesis.axis for effect in added}, []
    if axes - {"blasts"}:
        subsets += [(name, (slice(None), r)) for r, name in enumerate(case.receivers)]
    if axes - {"receivers"} and len(case.blasts) > 1:
        subsets += [(name, (b, slice(None))) for b, name in enumerate(case.blasts)]
    return subsets


def _expected_gain(scene, before, after):
    """Return the ln likelihood (n_blasts, n_receivers) of the change between two fits."""
    likelihood = scene.baseline.likelihood
    other = likelihood.whiten(np.where(scene.case.valid, after.motion - before.motion, 0.0))
    gain = 0.5 * likelihood.weights(before.chi_square) * np.sum(other**2, axis=-1)
    return np.where(likelihood.n_data > 0, gain, 0.0)


def step_without(scene: Scene, fit: Fit, out) -> tuple[np.ndarray, np.ndarray]:
    """Return the linear step from a fit to the one without some records; theory.md (14.5).

    Parameters
    ----------
    scene : Scene
    fit : Fit
        Fit to all records.
    out : (n_blasts, n_receivers) bool
        Records that are held out.

    Returns
    -------
    step : (n,) float64
        Of the standardised parameters.
    hessian : (n, n) float64
        Without these records.
    """
    likelihood = scene.baseline.likelihood
    weights = np.where(out, 0.0, likelihood.weights(fit.chi_square))
    residual = likelihood.residual(fit.motion)
    gradient = np.einsum("ibrm,brm,br->i", fit.jacobian, residual, weights, optimize=True) - fit.x
    hessian = hessian_of(fit.jacobian, weights)
    return np.linalg.solve(hessian, gradient), hessian


def _is_constrained(variance, own):
    """Tell whether a parameter of each effect is constrained, by its posterior variance."""
    return all(np.min(variance[mask], initial=1.0) < CONSTRAINED for mask in own if any(mask))


class _Prediction(NamedTuple):
    """Misfit and variance reduction of held-out records, and misfit of the others."""

    misfit: float
    variance_reduction: float
    misfit_of_others: float


def _prediction(scene, fit, step, out):
    """Return how well held-out records are predicted by a fit after a step."""
    likelihood, case = scene.baseline.likelihood, scene.case
    residual = likelihood.residual(fit.motion) - np.tensordot(step, fit.jacobian, 1)
    misfits = likelihood.misfit_each(likelihood.chi_square(residual))
    recorded = likelihood.whiten(np.where(case.valid, case.motion, 0.0))
    reduction = 1.0 - float(np.sum(residual[out] ** 2) / np.sum(recorded[out] ** 2))
    return _Prediction(float(np.sum(misfits[out])), reduction, float(np.sum(misfits[~out])))


def held_out_prediction(scene: Scene, fit: Fit, out) -> np.ndarray:
    """Return the motion of a fit from which some records are held out.

    Parameters
    ----------
    scene : Scene
    fit : Fit
        Fit to all records; it is moved by one linear step, as in `cross_validate`.
    out : (n_blasts, n_receivers) bool
        Records that are held out.

    Returns
    -------
    (n_blasts, n_receivers, 3, n_samples) float64, m/s
        Within the band of the records.
    """
    likelihood = scene.baseline.likelihood
    band = likelihood.records.band
    step, _ = step_without(scene, fit, out)
    change = unwhitened(likelihood, np.tensordot(step, fit.jacobian, 1))
    return band.restore(band.project(fit.motion) + change)
