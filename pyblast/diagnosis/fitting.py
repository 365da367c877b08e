"""Fits of effects together with the calibrated parameters, and their evidence."""

from dataclasses import dataclass, replace

import numpy as np
from scipy import linalg

from .effects import Effect, Scene

DIFFERENCE = 0.1  # of a knob's sigma, for derivatives
ROUNDS = 4
WORTH = 2.0  # drop of the misfit, one nat, that is not worth another round
FARTHEST = 1.5  # sigmas that a knob may go in one round


class Fitter:
    """Coordinates of a set of effects: sigmas of the unknowns, then those of the knobs.

    Parameters
    ----------
    scene : Scene
    effects : sequence of Effect
        At their starting values.
    home : (n_unknowns,) float64
        Values of the unknowns at which runs are made; from there the slopes of the baseline lead.
    blasts : sequence of int, optional
        Indices of those that are looked at; all by default.
    shift : (n_blasts, n_receivers, 3, n_samples) float64, m/s, optional
        What a finer mesh adds to all that is sent.
    """

    def __init__(self, scene: Scene, effects, home, blasts=None, shift=0.0):
        self.scene, self.effects, self.home = scene, tuple(effects), np.asarray(home)
        self.shift = shift
        self.blasts = tuple(range(len(scene.case.blasts)) if blasts is None else blasts)
        self.likelihood, self.sigma = scene.baseline.likelihood, scene.baseline.sigma
        self.knobs = [
            (number, place, index, knob)
            for number, effect in enumerate(self.effects)
            for place, knob in enumerate(effect.hypothesis.parameters)
            for index in range(len(effect.values[place]))
        ]
        low, high = (
            [knob.standardised(edge) if np.isfinite(edge) else edge for knob, edge in pairs]
            for pairs in (
                [(knob, knob.low) for *_, knob in self.knobs],
                [(knob, knob.high) for *_, knob in self.knobs],
            )
        )
        free = np.full(len(self.sigma), np.inf)
        self.bounds = np.concatenate([-free, low]), np.concatenate([free, high])

    def knobs_of(self, numbers):
        """Tell which coordinates (n,) are knobs of effects of these numbers, from 0."""
        return np.array([False] * len(self.sigma) + [e in numbers for e, *_ in self.knobs])

    def start(self):
        """Return the coordinates of home and of the effects as they were given."""
        at = [knob.standardised(self.effects[e].values[p][i]) for e, p, i, knob in self.knobs]
        return np.concatenate([self.home / self.sigma, at])

    def state(self, place):
        """Return the values of the unknowns and the effects at coordinates."""
        n = len(self.sigma)
        changed = [[list(some) for some in effect.values] for effect in self.effects]
        for (e, p, i, knob), coordinate in zip(self.knobs, place[n:], strict=True):
            changed[e][p][i] = float(knob.value(coordinate))
        effects = tuple(
            Effect(effect.name, effect.target, tuple(map(tuple, values)))
            for effect, values in zip(self.effects, changed, strict=True)
        )
        return self.sigma * place[:n], effects

    def motions(self, places):
        """Return the motion at coordinates; runs are made only for effects on the site.

        Unknowns of the site move it along the slopes of the baseline. Blasts that are not looked
        at stay as they are recorded.
        """
        states = [self.state(place) for place in places]
        sent = self.scene.sent([(self.home, effects) for _, effects in states], self.blasts)
        found = []
        for (values, effects), one in zip(states, sent, strict=True):
            if one is None:
                found.append(None)
                continue
            slopes = self.scene.baseline.slopes
            one = one + self.shift + np.tensordot(values - self.home, slopes, 1)
            found.append(self.scene.received(one, effects))
        return found

    def left(self, motion):
        """Return the whitened residual (n_blasts, n_receivers, m)."""
        return self.likelihood.left(motion)

    def squares(self, place, motion):
        """Return the misfit with the squares of the coordinates."""
        return float(self.likelihood.misfit(self.left(motion), self.blasts) + place @ place)

    def columns(self, place, motion, free):
        """Return the derivatives of the whitened motion, (n_coordinates, n_blasts, ..., m).

        Parameters
        ----------
        place : (n_coordinates,) float64
        motion : (n_blasts, n_receivers, 3, n_samples) float64, m/s
        free : (n_coordinates,) bool
            Which may move; the others have no derivatives. Where a step can't be, the one the
            other way tells the derivative; where neither can, there is none.
        """
        steps = DIFFERENCE * np.eye(len(place))
        steps[place + DIFFERENCE > self.bounds[1]] *= -1.0
        base, asked = self.left(motion), np.flatnonzero(free)
        columns = np.zeros((len(place), *base.shape))
        for _ in ("there", "back"):
            moved = self.motions(place + steps[asked])
            for at, one in zip(asked, moved, strict=True):
                if one is not None:
                    columns[at] = (base - self.left(one)) / steps[at, at]
            steps *= -1.0
            back = place + steps.sum(axis=1)
            held = (back < self.bounds[0]) | (back > self.bounds[1])
            refused = [at for at, one in zip(asked, moved, strict=True) if one is None]
            asked = [at for at in refused if not held[at]]
        columns[:, [b for b in range(len(base)) if b not in self.blasts]] = 0.0
        return columns

    def step(self, place, columns, motion, free):
        """Return the best move within reach, what it promises, and the curvature."""
        left = self.left(motion)
        weights = self.likelihood.weights(self.likelihood.size(left))
        curvature = curvature_of(columns, weights)
        pull = np.einsum("ibrm,brm,br->i", columns, left, weights, optimize=True) - place
        move = np.zeros(len(place))
        move[free] = linalg.solve(curvature[np.ix_(free, free)], pull[free], assume_a="pos")
        n = len(self.sigma)
        longest = np.max(np.abs(move[n:]), initial=0.0)
        move *= min(1.0, FARTHEST / max(longest, 1e-12))
        move = np.clip(place + move, *self.bounds) - place
        return move, float(2.0 * pull @ move - move @ curvature @ move), curvature

    def descended(self, place, motion, free=None, known=None):
        """Go down by damped Gauss-Newton steps; return place, motion, columns and curvature.

        ``known`` columns are used in place of new ones, in every step.
        """
        free = np.ones(len(place), dtype=bool) if free is None else free
        squares = self.squares(place, motion)
        for _ in range(ROUNDS):
            columns = self.columns(place, motion, free) if known is None else known
            move, promised, curvature = self.step(place, columns, motion, free)
            if promised < WORTH:
                break
            for _ in range(3):
                trial = self.motions([place + move])[0]
                found = np.inf if trial is None else self.squares(place + move, trial)
                if found < squares:
                    break
                move = 0.4 * move
            else:
                break
            gained, squares = squares - found, found
            place, motion = place + move, trial
            if gained < WORTH:
                break
        return place, motion, columns, curvature


def curvature_of(columns, weights):
    """Return the curvature of the misfit with that of the priors, (n, n)."""
    found = np.einsum("ibrm,jbrm,br->ij", columns, columns, weights, optimize=True)
    return found + np.eye(len(columns))


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
