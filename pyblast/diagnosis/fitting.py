"""Effects fitted together with what is calibrated, and what the data think of them."""

from dataclasses import dataclass, replace

import numpy as np
from scipy import linalg

from .fitter import Fitter
from .scene import Effect, Scene

GROWS = 6.0  # nats that an effect must bring, or another place of the same effect
OPEN = 8.0  # drop of the misfit that old columns promise and do not bring, above which they are old


@dataclass(frozen=True, eq=False)
class Fit:
    """A site with effects, fitted to the records.

    Parameters
    ----------
    effects : tuple of Effect
    values : (n_unknowns,) float64
        Logarithms of factors on what was believed of the site.
    covariance : (n, n) float64
        Of these values in their sigmas, then of all knobs in theirs.
    columns : (n, n_blasts, n_receivers, m) float64
        Derivatives of the whitened motion by them.
    place : (n,) float64
        Where they are, in sigmas from the centres of their priors.
    motion : (n_blasts, n_receivers, 3, n_samples) float64, m/s
    size : (n_blasts, n_receivers) float64
        Mean square of each whitened residual: 1 where noise and errors of theory explain it.
    misfit : float
        -2 ln L.
    log_evidence : float
        Up to a constant of the records: Laplace's approximation, theory.md (14.3).
    twins : tuple of Fit
        Others of the same effects, elsewhere, that the records can't tell from this one.
    """

    effects: tuple[Effect, ...]
    values: np.ndarray
    covariance: np.ndarray
    columns: np.ndarray
    place: np.ndarray
    motion: np.ndarray
    size: np.ndarray
    misfit: float
    log_evidence: float
    twins: tuple["Fit", ...] = ()

    @property
    def where(self):
        """What its effects are and where, in no order: the same for fits of the same effects."""
        return frozenset(effect.where for effect in self.effects)

    @property
    def knobs(self):
        """Derivatives by the knobs of the effects, the last of the columns."""
        return self.columns[len(self.values) :]

    @property
    def labels(self):
        """The labels of the effects, each once, in order."""
        return tuple(dict.fromkeys(effect.label for effect in self.effects))


def settle(scene: Scene, effects, home, blasts=None, knobs=0):
    """Let the unknowns of the site adapt to effects, or the knobs of the last ``knobs`` effects.

    Returns
    -------
    squares : float
        Misfit of the blasts with what the priors take; infinite where an effect can't be.
    motion : (n_blasts, n_receivers, 3, n_samples) float64, m/s, or None
    effects : tuple of Effect
    """
    fitter = Fitter(scene, effects, home, blasts)
    place = fitter.start()
    motion = fitter.motions([place])[0]
    if motion is None:
        return np.inf, None, effects
    n = len(effects)
    free = fitter.knobs_of(range(n - knobs, n)) if knobs else ~fitter.knobs_of(range(n))
    place, motion, *_ = fitter.descended(place, motion, free)
    return fitter.squares(place, motion), motion, fitter.state(place)[1]


def fit(scene: Scene, effects, home=None, first=None, held: Fit | None = None) -> Fit | None:
    """Fit effects and unknowns together; theory.md (14.1) to (14.3).

    Parameters
    ----------
    scene : Scene
    effects : sequence of Effect
        At the values to start from.
    home : (n_unknowns,) float64, optional
        Values of the unknowns to start from; those of the baseline by default.
    first : sequence of int, optional
        Indices of blasts that are fitted alone before all are, which saves runs.
    held : Fit, optional
        Of the first of these effects. Those on the site wait for the others to settle, and move
        along its columns then, which saves runs, too. If the blasts that are fitted alone gain so
        little over it that all together would not pay, none else is fitted.

    Returns
    -------
    Fit or None
        None where an effect can't be at this site, or would not pay.
    """
    home = scene.baseline.values if home is None else home
    every = range(len(scene.case.blasts))
    early = () if first is None else tuple(first)
    fitted = () if held is None else held.effects
    waiting = [e for e, effect in enumerate(fitted) if effect.hypothesis.on == "site"]
    place = columns = None
    for blasts in (early, every) if 0 < len(early) < len(every) else (every,):
        fitter = Fitter(scene, effects, home, blasts)
        place = fitter.start() if place is None else place
        motion = fitter.motions([place])[0]
        if motion is None:
            return None
        waits = fitter.knobs_of(waiting)
        if columns is not None:  # they lack the blasts that were not fitted first
            others = Fitter(scene, effects, home, [b for b in every if b not in early])
            columns = columns + others.columns(place, motion, ~waits)
        known = columns
        place, motion, columns, curvature = fitter.descended(place, motion, ~waits, known)
        if known is not None and fitter.step(place, columns, motion, ~waits)[1] > OPEN:
            place, motion, columns, curvature = fitter.descended(place, motion, ~waits)
        if held is not None and not _promising(fitter, held, place, motion):
            return None
    if not effects or any(effect.hypothesis.on == "site" for effect in effects):
        if held is not None:
            columns[waits] = held.columns[waits[: len(held.columns)]]
        fitter.home = fitter.state(place)[0]
        motion = fitter.motions([place])[0]
        place, motion, columns, curvature = fitter.descended(place, motion, known=columns)
    return _fit_at(fitter, place, motion, columns, curvature)


def _promising(fitter, held, place, motion):
    """Tell whether an effect would pay if all blasts gained as those that were fitted first."""
    share = len(fitter.blasts) / len(held.size)
    if share == 1.0:
        return True
    known = fitter.likelihood.misfit_of(held.size, fitter.blasts) + held.place @ held.place
    return known - fitter.squares(place, motion) > 2.0 * GROWS * share


def corrected(scene: Scene, fit: Fit, shift) -> Fit:
    """Return a fit moved along its columns, after a finer mesh has run its site.

    Parameters
    ----------
    scene : Scene
    fit : Fit
    shift : (n_blasts, n_receivers, 3, n_samples) float64, m/s
        What that mesh adds to what the site of the fit sends.
    """
    fitter = Fitter(scene, fit.effects, fit.values, shift=shift)
    motion = fitter.motions([fit.place])[0]
    moved = _fit_at(fitter, *fitter.descended(fit.place, motion, known=fit.columns))
    return replace(moved, twins=fit.twins)


def _fit_at(fitter, place, motion, columns, curvature):
    """Return what a descent ended at."""
    values, effects = fitter.state(place)
    left = fitter.left(motion)
    misfit = float(fitter.likelihood.misfit(left))
    log_evidence = -0.5 * (misfit + place @ place + np.linalg.slogdet(curvature)[1])
    size, covariance = fitter.likelihood.size(left), linalg.inv(curvature)
    return Fit(
        effects, values, covariance, columns, place, motion, size, misfit, float(log_evidence)
    )
