"""Cross-validation: effects fitted without some records, and the prediction of these."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from .effects import Scene
from .fitting import Fit, hessian_of
from .hypotheses import blast_and_hole

FALLS = 0.5  # nats that a fold may lose without counting against; of which less, it says nothing
MOSTLY = 0.75  # of the folds must gain
ERRORS = 2.0  # standard errors that the sum must lie above zero
FEW = 3  # folds, of which a standard error says nothing: each must gain
LEAST = 6.0  # nats that few folds must gain together, or in which an effect is seen
TOLD = 0.5  # of the prior variance of a knob, above which nothing is told of it


@dataclass(frozen=True)
class Fold:
    """One receiver or blast that was left out.

    Parameters
    ----------
    name : str
    gain : float
        Nats by which the effect foretells it better.
    before, after : float
        Share of its energy, in units of its errors, that is foretold without and with it.
    """

    name: str
    gain: float
    before: float
    after: float


@dataclass(frozen=True)
class HeldOut:
    """All records that were left out in turn.

    Parameters
    ----------
    folds : tuple of Fold
    """

    folds: tuple[Fold, ...]

    @property
    def gain(self):
        """Sum over the folds, nats."""
        return float(sum(fold.gain for fold in self.folds))

    @property
    def error(self):
        """Standard error of the sum; infinite with fewer than two folds."""
        if len(self.folds) < 2:
            return np.inf
        return float(np.std([f.gain for f in self.folds], ddof=1) * np.sqrt(len(self.folds)))

    @property
    def improves(self):
        """Tell whether the effect foretells what it was not fitted to."""
        fair = [fold.gain > -FALLS for fold in self.folds]
        if len(fair) <= FEW:
            return len(fair) > 1 and self.gain > LEAST and all(f.gain > 0.0 for f in self.folds)
        return bool(self.gain > ERRORS * self.error and np.mean(fair) >= MOSTLY)

    @property
    def bears(self):
        """Tell whether nothing speaks against it: it improves, or no record could be left out."""
        return self.improves or not self.folds


def held_out(scene: Scene, before: Fit, after: Fit) -> HeldOut:
    """Leave out receivers, blasts or both, by the axes of the effects.

    Parameters
    ----------
    scene : Scene
    before, after : Fit
        Without and with the effects.

    Notes
    -----
    Effects of a blast must foretell other receivers, those of a receiver other blasts, those of
    the ground both; effects that are there before have no say in it. A blast or a receiver with
    an effect of its own is not left out, nor one of which they foretell nothing else (it may have
    no records), nor one without which an effect is not seen, in knobs or in the misfit: a joint
    that slips in one blast alone. Each fit is made anew without what is left out, by one linear
    step from where it was; theory.md (14.5).
    """
    added = [effect for effect in after.effects if effect.label not in before.labels]
    axes = {e.hypothesis.axis for e in added}
    targets = {blast_and_hole(e.target)[0] for e in added}
    shape, case = after.chi_square.shape, scene.case
    places = []
    if axes - {"blasts"}:
        places += [(name, (slice(None), r)) for r, name in enumerate(case.receivers)]
    if axes - {"receivers"} and shape[0] > 1:
        places += [(name, (b, slice(None))) for b, name in enumerate(case.blasts)]
    owners = [effect for effect in after.effects for some in effect.values for _ in some]
    knobs = [[owner is one for owner in owners] for one in added]
    said = _said(scene, before, after)
    folds = []
    for name, place in places:
        out = np.zeros(shape, dtype=bool)
        out[place] = True
        if name in targets or np.sum(said[place]) < FALLS:
            continue
        move, curvature = step_without(scene, after, out)
        first = _foretold(scene, before, step_without(scene, before, out)[0], out)
        later = _foretold(scene, after, move, out)
        seen = 0.5 * (first.others - later.others) > LEAST
        if not (seen or _told(np.diag(np.linalg.inv(curvature))[len(after.values) :], knobs)):
            continue
        folds.append(Fold(name, 0.5 * (first.misfit - later.misfit), first.share, later.share))
    return HeldOut(tuple(folds))


def _said(scene, before, after):
    """Return how much else effects say of each record, nats (n_blasts, n_receivers)."""
    likelihood = scene.baseline.likelihood
    other = likelihood.whiten(np.where(scene.case.valid, after.motion - before.motion, 0.0))
    nats = 0.5 * likelihood.weights(before.chi_square) * np.sum(other**2, axis=-1)
    return np.where(likelihood.n_data > 0, nats, 0.0)


def step_without(scene: Scene, fit: Fit, out) -> tuple[np.ndarray, np.ndarray]:
    """Return the linear step of a fit if some records have no part in it; theory.md (14.5).

    Parameters
    ----------
    scene : Scene
    fit : Fit
        To all records.
    out : (n_blasts, n_receivers) bool
        Records that are left out.

    Returns
    -------
    move : (n,) float64
        In the coordinates of the fit.
    curvature : (n, n) float64
    """
    likelihood, columns = scene.baseline.likelihood, fit.jacobian
    weights = np.where(out, 0.0, likelihood.weights(fit.chi_square))
    left = likelihood.residual(fit.motion)
    pull = np.einsum("ibrm,brm,br->i", columns, left, weights, optimize=True) - fit.x
    curvature = hessian_of(columns, weights)
    return np.linalg.solve(curvature, pull), curvature


def _told(spread, knobs):
    """Tell whether variances of all knobs say something of each effect, which has some of them."""
    return all(np.min(spread[own], initial=1.0) < TOLD for own in knobs if any(own))


class _Foretold(NamedTuple):
    """The misfit of what is left out, the share of it that is foretold, the misfit of the rest."""

    misfit: float
    share: float
    others: float


def _foretold(scene, fit, move, out):
    """Return how well records are met when some had no part in it."""
    likelihood, case = scene.baseline.likelihood, scene.case
    left = likelihood.residual(fit.motion) - np.tensordot(move, fit.jacobian, 1)
    each = likelihood.misfit_each(likelihood.chi_square(left))
    recorded = likelihood.whiten(np.where(case.valid, case.motion, 0.0))
    share = 1.0 - float(np.sum(left[out] ** 2) / np.sum(recorded[out] ** 2))
    return _Foretold(float(np.sum(each[out])), share, float(np.sum(each[~out])))


ROUNDING = 1e-8  # of the largest singular value: what a whitener has lost for good


def foretold(scene: Scene, fit: Fit, out) -> np.ndarray:
    """Return what a fit sends when some records have no part in it.

    Parameters
    ----------
    scene : Scene
    fit : Fit
        To all records.
    out : (n_blasts, n_receivers) bool
        Records that are left out.

    Returns
    -------
    (n_blasts, n_receivers, 3, n_samples) float64, m/s
        Within the band of the records. The fit is moved by one linear step, as for
        the folds: theory.md (14.5).
    """
    likelihood = scene.baseline.likelihood
    band = likelihood.records.band
    move, _ = step_without(scene, fit, out)
    change = np.tensordot(move, fit.jacobian, 1)
    coloured = np.linalg.pinv(likelihood.covariance.roots, rcond=ROUNDING, hermitian=True)
    change = np.einsum("brij,brj->bri", coloured, change).reshape(*out.shape, 3, -1)
    return band.restore(band.project(fit.motion) + change)
