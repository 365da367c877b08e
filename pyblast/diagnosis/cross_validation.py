"""Cross-validation: prediction of receivers and blasts that were held out of a fit."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from ..errors import contained
from ..inference.error_model import ErrorModel, Posterior
from .effects import Scene
from .fitting import Fit
from .hypotheses import blast_and_hole
from .thresholds import (
    CONSTRAINED,
    DECISIVE,
    FEW_SUBSETS,
    GAIN_LEFT,
    LEAST_LOSS,
    STANDARD_ERRORS,
)

HARDLY = "the effect hardly changes its motion"
UNCONSTRAINED = "without it the others do not constrain the effect"


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
        Share of its energy that is predicted without and with the effect.
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
    not_held_out : dict of str to str
        The others, with the reason.
    """

    subsets: tuple[Subset, ...]
    not_held_out: Mapping[str, str] = field(default_factory=dict)

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
        gained = float(np.sum(np.maximum(gains, 0.0)))  # by the subsets that lose nothing
        significant = self.delta_ln_likelihood > STANDARD_ERRORS * self.standard_error
        return bool(significant and self.delta_ln_likelihood >= GAIN_LEFT * gained)

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
    effect, by its parameters or by the evidence, such as the one blast in which a joint slips; a
    subset whose refit fails. The predictive likelihood of a subset is the evidence of all records
    over that of the others, linear around the fit to all records; theory.md (14.5).
    """
    added = [effect for effect in after.effects if effect.label not in before.labels]
    targets = {blast_and_hole(effect.target)[0] for effect in added}
    owners = [effect for effect in after.effects for values in effect.values for _ in values]
    own = [[owner is effect for owner in owners] for effect in added]
    whole = [_Linear.of(scene, fit) for fit in (before, after)]
    change = np.sum(scene.seen(after.motion - before.motion) ** 2, axis=(-2, -1))
    expected = 0.5 * change / np.maximum(scene.baseline.usual, np.finfo(float).tiny)
    subsets, others = [], {}
    for name, records in _possible_subsets(scene.case, added):
        out = np.zeros(change.shape, dtype=bool)
        out[records] = scene.baseline.usual[records] > 0.0
        if name in targets or np.sum(expected[out]) < LEAST_LOSS:
            others[name] = "the effect acts on it alone" if name in targets else HARDLY
            continue
        with contained(others, name):
            first, second = (linear.without(out) for linear in whole)
            detected = second.of_others - first.of_others > DECISIVE
            variance = np.diag(second.posterior.covariance)[len(after.values) :]
            if not (detected or _is_constrained(variance, own)):
                others[name] = UNCONSTRAINED
            else:
                gain = second.log_likelihood - first.log_likelihood
                reduction = (each.variance_reduction for each in (first, second))
                subsets.append(Subset(name, float(gain), *reduction))
    return CrossValidation(tuple(subsets), others)


def _possible_subsets(case, added):
    """Return name and index of the receivers and blasts that effects may have to predict."""
    axes, subsets = {effect.hypothesis.axis for effect in added}, []
    if axes - {"blasts"}:
        subsets += [(name, (slice(None), r)) for r, name in enumerate(case.receivers)]
    if axes - {"receivers"} and len(case.blasts) > 1:
        subsets += [(name, (b, slice(None))) for b, name in enumerate(case.blasts)]
    return subsets


def _is_constrained(variance, own):
    """Tell whether a parameter of each effect is constrained, by its posterior variance."""
    return all(np.min(variance[mask], initial=1.0) < CONSTRAINED for mask in own if any(mask))


class _Prediction(NamedTuple):
    """Prediction of records that are held out.

    ``posterior`` is that of the parameters by the other records, whose log evidence is
    ``of_others``; ``motion`` is predicted, in the band.
    """

    posterior: Posterior
    of_others: float
    log_likelihood: float
    variance_reduction: float
    motion: np.ndarray


class _Linear(NamedTuple):
    """A fit, linear around its state: slopes and residual at the prior, in the band."""

    scene: Scene
    fit: Fit
    error: ErrorModel
    slopes: np.ndarray
    residual: np.ndarray
    log_evidence: float

    @classmethod
    def of(cls, scene, fit):
        """Return what is linear around a fit."""
        slopes = scene.seen(fit.state.slopes)
        residual = scene.case.band.project(scene.case.residual(fit.motion))
        error = scene.error_beside(fit.effects, fit.values, fit.motion, fit.filters)
        residual = residual + np.tensordot(fit.state.x, slopes, 1)
        evidence = error.posterior(residual, slopes, np.ones(len(slopes))).log_evidence
        return cls(scene, fit, error, slopes, residual, evidence)

    def without(self, out):
        """Return the prediction of records that are held out, (n_blasts, n_receivers) bool."""
        prior = np.ones(len(self.slopes))
        posterior = self.error.without(out).posterior(self.residual, self.slopes, prior)
        gained = self.log_evidence - posterior.log_evidence
        rest = self.residual - np.tensordot(posterior.mean, self.slopes, 1)
        recorded = self.scene.case.band.project(self.scene.case.residual(0.0))
        energy = np.sum(recorded[out] ** 2)
        reduction = 1.0 - float(np.sum(rest[out] ** 2) / energy) if energy > 0.0 else 0.0
        others, motion = posterior.log_evidence, recorded - rest
        return _Prediction(posterior, others, gained, reduction, motion)


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
    return scene.case.band.restore(_Linear.of(scene, fit).without(np.asarray(out, bool)).motion)
