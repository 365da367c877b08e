"""Look for what a site lacks: screen every effect, fit the best, add effects while they pay."""

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import product

import numpy as np

from .fitting import Fit, Fitter, fit, settle
from .hypotheses import LIBRARY
from .scene import Effect, Scene

MATERIAL = 3.0  # mean size of residuals, in errors of the theory, below which nothing is claimed
GROWS = 6.0  # nats that another place of the same effect must bring
REFINED = 4  # effects on the site that are fitted by runs, in the first pass
REFINED_LATER = 2
SURELY = 1  # the best guess is fitted however poor it is, if nothing else explains anything
SCALED = 0.5  # standard deviation of the scale of a change that was run at one value of its knobs
ADAPTING = 6  # rounds of reweighting
MOST = 3  # effects at once
TOGETHER = 8  # effects whose runs are made side by side
LEAST_OF_BEST = 0.4  # of the share of the best guess
LEAST_SHARE = 0.1  # of what is left that an effect must explain to be fitted by runs


@dataclass(frozen=True, eq=False)
class Guess:
    """An effect on the site as a few runs judge it.

    Parameters
    ----------
    effect : Effect
    share : float
        Of all energy in excess at the calibrated site, what is gone in its blasts.
    change : (n_blasts, n_receivers, 3, n_samples) float64, m/s
        Of the motion of the believed site; zero in blasts that were not run.
    blasts : tuple of int
    """

    effect: Effect
    share: float
    change: np.ndarray
    blasts: tuple[int, ...]


@dataclass(eq=False)
class Search:
    """What was found by a search.

    Parameters
    ----------
    scene : Scene
    limit : int
        Runs after which nothing further is begun.
    tell : callable
        Called with (stage, done, total).
    none : Fit
        Nothing but the site's own values.
    fits : list of Fit
        One for each label, or set of labels, that was fitted; best evidence first.
    guesses : list of Guess
    chosen : Fit
        The best set of effects.
    finished, compared : bool
        Whether the budget was enough for all that was planned, and for each effect alone.
    """

    scene: Scene
    limit: int
    tell: Callable
    none: Fit = None
    fits: list = field(default_factory=list)
    guesses: list = field(default_factory=list)
    chosen: Fit = None
    finished: bool = True
    compared: bool = True

    def worth(self, found):
        """Return the evidence of a fit in nats over that of nothing, its places paid; (14.3)."""
        paid = sum(np.log(len(e.hypothesis.targets(self.scene.case))) for e in found.effects)
        return found.log_evidence - self.none.log_evidence - paid

    def best(self, n_labels=1):
        """Return the best fit of so many labels, or None."""
        some = [one for one in self.fits if len(one.labels) == n_labels]
        return max(some, key=self.worth, default=None)

    def runs_left(self):
        """Tell whether the budget allows more runs."""
        self.finished = self.finished and self.scene.forward.runs < self.limit
        return self.scene.forward.runs < self.limit


def search(scene: Scene, limit: int, tell=lambda *_: None) -> Search:
    """Search the library for effects that explain what a calibrated site does not.

    Parameters
    ----------
    scene : Scene
    limit : int
        Runs after which nothing further is begun.
    tell : callable, optional
        Called with (stage, done, total).

    Returns
    -------
    Search
        Nothing was tried where nothing is missing, or where the records could test no effect.
    """
    found = Search(scene, limit, tell)
    found.none = found.chosen = fit(scene, ())
    testable = any(not one.untestable(scene.case) for one in LIBRARY.values())
    if not (testable and material(found.none.size)):
        return found
    found.fits += _quick(found, ())
    found.guesses = _screened(found)
    found.fits += _refined(found, found.guesses, (), REFINED)
    found.compared = found.finished
    while len(found.chosen.labels) < MOST:
        better = found.best(len(found.chosen.labels) + 1)
        if better is None or found.worth(better) - found.worth(found.chosen) < GROWS:
            break
        found.chosen = better
        if not material(better.size) or len(better.labels) == MOST:
            break
        found.fits += _quick(found, better.effects)
        left = _rescreened(found, better)
        found.fits += _refined(found, left, better.effects, REFINED_LATER)
    return found


def material(size) -> bool:
    """Tell whether mean squares (n_blasts, n_receivers) are more than errors of the theory."""
    return bool(max(means(size, 0).max(), means(size, 1).max()) >= MATERIAL)


def means(size, axis):
    """Return mean sizes (n_blasts, n_receivers) along an axis, of the records that there are."""
    return np.sum(size, axis=axis) / np.maximum(np.count_nonzero(size, axis=axis), 1)


def started(hypothesis, target, scene):
    """Return an effect at each of its starting values."""
    blasts = scene.case.site.blasts
    count = len(blasts[target].times) if target in blasts else 1
    return [
        Effect(
            hypothesis.name,
            target,
            tuple(
                (value,) * (count if knob.per_hole else 1)
                for knob, value in zip(hypothesis.knobs, values, strict=True)
            ),
        )
        for values in product(*[knob.starts for knob in hypothesis.knobs])
    ]


def _quick(found, base):
    """Fit each effect that needs no runs on top of others, at all places where it pays."""
    fits, scene = [], found.scene
    there = {effect.label for effect in base}
    labels = [h for h in LIBRARY.values() if h.on != "site" and h.label not in there]
    home = found.chosen.values
    start = Fitter(scene, base, home)
    squares = start.squares(start.start(), start.motions([start.start()])[0])
    for done, hypothesis in enumerate(labels):
        found.tell("effects that need no runs", done, len(labels))
        best = {}
        for target in hypothesis.targets(scene.case):
            trials = [
                settle(scene, (*base, one), home, knobs=1)
                for one in started(hypothesis, target, scene)
            ]
            gained, _, effects = min(trials, key=lambda one: one[0])
            best[target] = squares - gained, effects[-1]
        paying = [one for gained, one in best.values() if gained > 2.0 * GROWS]
        most = max(best.values(), key=lambda one: one[0], default=None)
        if hypothesis.single:
            paying = [most[1]] if paying else []
        if most is None or most[0] <= 0.0 or (base and not paying):
            continue
        one = fit(scene, (*base, *(paying or [most[1]])), home)
        if one is not None:
            fits.append(one)
    return fits


def _screened(found):
    """Judge effects on the site by runs at their starting values."""
    scene, home = found.scene, np.zeros(len(found.none.values))
    tried = [
        (effect, _seen_in(found, hypothesis, target))
        for hypothesis in LIBRARY.values() if hypothesis.on == "site"
        for target in hypothesis.targets(scene.case)
        for effect in started(hypothesis, target, scene)
    ]  # fmt: skip
    best = {}
    for done, (effect, blasts) in enumerate(tried):
        found.tell("effects on the site", done, len(tried))
        if not found.runs_left():
            break
        if done % TOGETHER == 0:  # side by side
            for some in {b for _, b in tried}:
                these = [(home, (e,)) for e, b in tried[done : done + TOGETHER] if b == some]
                scene.sent(these, some)
        guess = _guess(found, effect, home, blasts)
        key = effect.label, effect.target
        if guess is not None and (key not in best or best[key].share < guess.share):
            best[key] = guess
    return sorted(best.values(), key=lambda one: -one.share)


def _seen_in(found, hypothesis, target):
    """Return the blasts in which an effect is screened: its own, or where most is open."""
    case, likelihood = found.scene.case, found.scene.baseline.likelihood
    if target in case.blasts:
        return (case.blasts.index(target),)
    each = [likelihood.excess(found.none.size, (b,)) for b in range(len(case.blasts))]
    most = int(np.argmax(each))
    return (most,) if hypothesis.linear else tuple(sorted({0, most, len(case.blasts) - 1}))


def _guess(found, effect, home, blasts):
    """Judge one effect on the site by a run of some blasts, and by its change made less or more."""
    scene, likelihood = found.scene, found.scene.baseline.likelihood
    sent = scene.sent([(home, (effect,))], blasts)[0]
    if sent is None:
        return None
    change = np.zeros_like(sent)
    change[list(blasts)] = (sent - scene.baseline.believed)[list(blasts)]
    size = _adapted(scene, change, blasts)
    return Guess(effect, likelihood.share(found.none.size, size, blasts), change, blasts)


def _adapted(scene, change, blasts):
    """Return sizes of residuals when the site's values and the scale of a change fit best."""
    baseline, likelihood = scene.baseline, scene.baseline.likelihood
    slopes = baseline.slopes * baseline.sigma[:, None, None, None, None]
    columns = likelihood.white(np.concatenate([slopes, change[None]]))
    columns[:, [b for b in range(columns.shape[1]) if b not in blasts]] = 0.0
    centre = np.append(np.zeros(len(slopes)), 1.0)
    precision = np.append(np.ones(len(slopes)), SCALED**-2.0)
    start, place = likelihood.left(baseline.believed), centre
    for _ in range(ADAPTING):
        size = likelihood.size(start - np.tensordot(place, columns, 1))
        weights = likelihood.weights(size)
        curvature = np.einsum("ibrm,jbrm,br->ij", columns, columns, weights, optimize=True)
        pull = np.einsum("ibrm,brm,br->i", columns, start, weights, optimize=True)
        place = np.linalg.solve(curvature + np.diag(precision), pull + precision * centre)
    return likelihood.size(start - np.tensordot(place, columns, 1))


def _rescreened(found, base):
    """Judge effects on the site again, on top of others, by adding their changes."""
    likelihood, kept = found.scene.baseline.likelihood, []
    for guess in found.guesses:
        if guess.effect.label in base.labels:
            continue
        shares = [
            likelihood.share(
                base.size,
                likelihood.size(likelihood.left(base.motion + part * guess.change)),
                guess.blasts,
            )
            for part in (0.5, 1.0)
        ]
        kept.append(Guess(guess.effect, max(shares), guess.change, guess.blasts))
    return sorted(kept, key=lambda one: -one.share)


def _refined(found, guesses, base, most):
    """Fit the best guesses by runs, one place of each label."""
    fits, seen = [], {effect.label for effect in base}
    known = 0.0 if base else _explained(found)
    best = max([known, *(guess.share for guess in guesses)])
    least, surely = max(LEAST_SHARE, LEAST_OF_BEST * best), 0 if known or base else SURELY
    for guess in guesses:
        poor = guess.share < least and len(fits) >= surely
        if len(fits) == most or poor or not found.runs_left():
            break
        if guess.effect.label in seen:
            continue
        seen.add(guess.effect.label)
        found.tell(f"fit {guess.effect.label}", len(fits), most)
        home = np.zeros(len(found.none.values)) if not base else found.chosen.values
        one = fit(found.scene, (*base, guess.effect), home, guess.blasts)
        if one is not None:
            fits.append(one)
    return fits


def _explained(found):
    """Return the share of the energy in excess that the best fit explains, if it is worth much."""
    best, likelihood = found.best(), found.scene.baseline.likelihood
    worthy = best is not None and found.worth(best) > GROWS
    return likelihood.share(found.none.size, best.size) if worthy else 0.0
