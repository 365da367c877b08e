"""Search of effects: screening of all, fits of the best, sets while evidence grows."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np

from .effects import Effect, Scene
from .fitting import Fit, Fitter, fit, fit_partly
from .hypotheses import LIBRARY
from .thresholds import DECISIVE, LEAST_OF_BEST, LEAST_SHARE, MATERIAL, MOST_EFFECTS, MOST_EXPLAINED

SCALED = 0.5  # standard deviation of the scale of a change that was run at one value of its knobs
ADAPTING = 6  # rounds of reweighting
TOGETHER = 8  # effects whose runs are made side by side


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


def started(hypothesis, target, scene):
    """Return an effect at each of its starting values."""
    blasts = scene.case.project.blasts
    count = len(blasts[target].times) if target in blasts else 1
    read = () if hypothesis.begins is None else (hypothesis.begins(scene),)
    return [
        Effect(
            hypothesis.name,
            target,
            tuple(
                (value,) * (count if knob.per_hole else 1)
                for knob, value in zip(hypothesis.parameters, values, strict=True)
            ),
        )
        for values in (*product(*[knob.starts for knob in hypothesis.parameters]), *read)
    ]


def screened(found) -> list[Guess]:
    """Judge effects on the site by runs at their starting values, best first.

    Parameters
    ----------
    found : Search
        With its fit of nothing.
    """
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
    """Return the blasts in which an effect is screened: its own, or where most is open.

    What grows with charge is screened in the first blast, too: in one alone it looks like a change
    of the site's own values.
    """
    case, likelihood = found.scene.case, found.scene.baseline.likelihood
    if target in case.blasts:
        return (case.blasts.index(target),)
    each = [likelihood.excess(found.none.chi_square, (b,)) for b in range(len(case.blasts))]
    most = int(np.argmax(each))
    return (most,) if hypothesis.linear else tuple(sorted({0, most or len(case.blasts) - 1}))


def _guess(found, effect, home, blasts):
    """Judge one effect on the site by a run of some blasts, and by its change made less or more."""
    scene, likelihood = found.scene, found.scene.baseline.likelihood
    sent = scene.sent([(home, (effect,))], blasts)[0]
    if sent is None:
        return None
    change = np.zeros_like(sent)
    change[list(blasts)] = (sent - scene.baseline.reference)[list(blasts)]
    size = _adapted(scene, change, blasts)
    share = likelihood.explained_share(found.none.chi_square, size, blasts)
    return Guess(effect, share, change, blasts)


def _adapted(scene, change, blasts):
    """Return sizes of residuals when the site's values and the scale of a change fit best."""
    baseline, likelihood = scene.baseline, scene.baseline.likelihood
    slopes = baseline.slopes * baseline.sigma[:, None, None, None, None]
    columns = likelihood.whiten(np.concatenate([slopes, change[None]]))
    columns[:, [b for b in range(columns.shape[1]) if b not in blasts]] = 0.0
    centre = np.append(np.zeros(len(slopes)), 1.0)
    precision = np.append(np.ones(len(slopes)), SCALED**-2.0)
    start, place = likelihood.residual(baseline.reference), centre
    for _ in range(ADAPTING):
        size = likelihood.chi_square(start - np.tensordot(place, columns, 1))
        weights = likelihood.weights(size)
        curvature = np.einsum("ibrm,jbrm,br->ij", columns, columns, weights, optimize=True)
        pull = np.einsum("ibrm,brm,br->i", columns, start, weights, optimize=True)
        place = np.linalg.solve(curvature + np.diag(precision), pull + precision * centre)
    return likelihood.chi_square(start - np.tensordot(place, columns, 1))


def rescreened(found, base) -> list[Guess]:
    """Judge effects on the site again, on top of those of a fit, by adding their changes."""
    likelihood, kept = found.scene.baseline.likelihood, []
    for guess in found.guesses:
        if guess.effect.label in base.labels:
            continue
        shares = [
            likelihood.explained_share(
                base.chi_square,
                likelihood.chi_square(likelihood.residual(base.motion + part * guess.change)),
                guess.blasts,
            )
            for part in (0.5, 1.0)
        ]
        kept.append(Guess(guess.effect, max(shares), guess.change, guess.blasts))
    return sorted(kept, key=lambda one: -one.share)


REFINED = 4  # effects on the site that are fitted by runs, in the first pass
REFINED_LATER = 2
UNEXPLAINED = 6  # effects that are fitted by runs, however poor, while none fitted pays
SURELY = 3  # guesses that are fitted however poor they are, while less than this is explained:
BEAM = 2  # sets of effects that go on together, of those that records can't tell apart
AROUND = (-0.6, -0.3, 0.0, 0.3, 0.6)  # sigmas of each knob


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
        One for each label, or set of labels, that was fitted.
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

    def ranked(self):
        """Return all fits, best evidence first."""
        return sorted(self.fits, key=self.worth, reverse=True)

    def leaders(self, n_labels=1):
        """Return the best fits of so many labels, those that can't be told from the first."""
        some = [one for one in self.ranked() if len(one.labels) == n_labels]
        near = [one for one in some if self.worth(some[0]) - self.worth(one) < DECISIVE]
        labels = [set(one.labels) for one in near]
        return [one for k, one in enumerate(near) if labels[k] not in labels[:k]][:BEAM]

    def keep(self, one):
        """Keep a fit, or the better one of two of the same effects, and its twin if near it."""
        same = [one, *(fit for fit in self.fits if fit.where == one.where)]
        best = max(same, key=self.worth)
        near = [fit for fit in same if self.worth(best) - self.worth(fit) < DECISIVE]
        alone = len(one.effects) == 1  # others may have the same effects in another order
        twins = tuple(fit for fit in near if alone and fit is not best)
        self.fits = [fit for fit in self.fits if fit.where != one.where]
        self.fits.append(replace(best, alternatives=twins))

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
    if not (testable and material(found.none.chi_square)):
        return found
    _quick(found, found.none)
    found.guesses = screened(found)
    _refine(found, found.guesses, found.none, REFINED)
    _around(found)
    found.compared = found.finished
    for n_labels in range(1, MOST_EFFECTS + 1):
        least = found.worth(found.chosen) + DECISIVE
        leaders = [one for one in found.leaders(n_labels) if found.worth(one) >= least]
        if not leaders:
            break
        found.chosen = leaders[0]
        if not material(found.chosen.chi_square) or n_labels == MOST_EFFECTS:
            break
        for base in leaders:
            _quick(found, base)
            _refine(found, rescreened(found, base), base, REFINED_LATER)
    return found


def material(size) -> bool:
    """Tell whether mean squares (n_blasts, n_receivers) are more than errors of the theory."""
    return worst(size) >= MATERIAL


def worst(size) -> float:
    """Return the largest mean, of a receiver or of a blast, of sizes (n_blasts, n_receivers)."""
    return float(max(means(size, 0).max(), means(size, 1).max()))


def means(size, axis):
    """Return mean sizes (n_blasts, n_receivers) along an axis, of the records that there are."""
    return np.sum(size, axis=axis) / np.maximum(np.count_nonzero(size, axis=axis), 1)


def _quick(found, base):
    """Fit each effect that needs no runs on top of a fit, at all places where it pays."""
    scene, before = found.scene, base.effects
    labels = [h for h in LIBRARY.values() if h.on != "site" and h.label not in base.labels]
    start = Fitter(scene, before, base.values)
    objective = start.objective(start.start(), start.motions([start.start()])[0])
    for done, hypothesis in enumerate(labels):
        found.tell("effects that need no runs", done, len(labels))
        best = {}
        for target in hypothesis.targets(scene.case):
            trials = [
                fit_partly(scene, (*before, one), base.values, n_last=1)
                for one in started(hypothesis, target, scene)
            ]
            reached, _, effects = min(trials, key=lambda one: one[0])
            best[target] = objective - reached, effects[-1]
        paying = [one for gained, one in best.values() if gained > 2.0 * DECISIVE]
        most = max(best.values(), key=lambda one: one[0], default=None)
        if hypothesis.single:
            paying = [most[1]] if paying else []
        if most is None or most[0] <= 0.0 or (before and not paying):
            continue
        added = paying or [most[1]]
        one = fit(scene, (*before, *added), base.values, base=base if before else None)
        if one is not None:
            found.keep(one)


def _refine(found, guesses, base, most):
    """Fit the best guesses by runs on top of a fit, one place of each label."""
    seen, done = set(base.labels), 0
    largest = max((guess.share for guess in guesses), default=0.0)
    home = base.values if base.effects else np.zeros(len(base.values))
    for guess in guesses:
        known, surely = (0.0, 0) if base.effects else _explained(found)
        poor = guess.share < max(LEAST_SHARE, LEAST_OF_BEST * max(known, largest))
        if done >= (surely if poor else max(most, surely)) or not found.runs_left():
            break
        if guess.effect.label in seen:
            continue
        seen.add(guess.effect.label)
        found.tell(f"fit {guess.effect.label}", done, max(most, surely))
        before = found.scene.forward.runs
        one = fit(found.scene, (*base.effects, guess.effect), home, guess.blasts, base)
        if one is not None:
            found.keep(one)
        done += found.scene.forward.runs > before


def _around(found):
    """Look around what leads in all its forms, and fit it anew from the best place, if not linear.

    What grows with charge has a narrow valley, and a way down to it may end on its side.
    """
    scene, home = found.scene, np.zeros(len(found.none.values))
    for leader in found.leaders():
        first = leader.effects[0]
        forms = [h for h in LIBRARY.values() if h.label == first.label and not h.linear]
        if not forms or not found.runs_left():
            continue
        near = [
            [knob.value(knob.standardised(value) + step) for step in AROUND]
            for knob, (value,) in zip(first.hypothesis.parameters, first.values, strict=True)
        ]
        places = [
            tuple((value,) for value in values)
            for values in product(*near)
            if all(k.low <= v <= k.high for k, v in zip(forms[0].parameters, values, strict=True))
        ]  # fmt: skip
        ways = [Effect(form.name, first.target, place) for form in forms for place in places]
        found.tell(f"around {first.label}", 0, 1)
        blasts = next(g.blasts for g in found.guesses if g.effect.where == first.where)
        scene.sent([(home, (way,)) for way in ways], blasts)
        best = min(ways, key=lambda way: fit_partly(scene, (way,), home, blasts)[0])
        one = fit(scene, (best,), home, blasts, found.none)
        if one is not None:
            found.keep(one)


def _explained(found):
    """Return the share of the energy in excess that the best fit explains, if it is worth much.

    Second, how many guesses must be fitted although they are poor, so little is explained.
    """
    best, likelihood = next(iter(found.leaders()), None), found.scene.baseline.likelihood
    if best is None or found.worth(best) <= DECISIVE:
        return 0.0, UNEXPLAINED
    share = likelihood.explained_share(found.none.chi_square, best.chi_square)
    return share, SURELY if share < MOST_EXPLAINED else 0
