"""Search of the library: scores of every hypothesis, fits of the best, sets while these grow."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from ..errors import contained
from ..inference.location import Located, located
from .effects import Scene
from .error import with_calibrated
from .fitting import LONGEST, Fit, fit, fit_calibrated, not_improved
from .forward import quarter_wave
from .hypotheses import LIBRARY
from .scores import SiteScores, members_of, of_speeds
from .thresholds import DECISIVE, LEAD, LEAST_SCORE, MATERIAL, MOST_EFFECTS, NOT_LINEAR, REFIT_GAIN

IN_ROCK = 0.3  # prior standard deviation of the logarithms of speeds and density
SCORES = "scores of every effect"  # a part of a diagnosis that may fail
REFINED = 4  # classes whose further starting values are scored, in each pass
SMALLER = 0.3  # steps of a fit that contradicts the score it began with
REFITTED = 2  # classes that are fitted by runs, of those that score, in each pass
BEAM = 2  # width of the beam search: sets of effects that are extended, if nearly as good


@dataclass(eq=False)
class Search:
    """State and result of a search.

    Parameters
    ----------
    scene : Scene
    progress : callable
        Called with (stage, done, total).
    without_effects : Fit
        Fit of the calibrated parameters alone.
    fits : list of Fit
        One for each label, or set of labels, that was fitted.
    chosen : Fit or None
        The best set of effects; None if nothing was searched for.
    finished, compared : bool
        Whether the budget sufficed for the whole search, and for each effect on its own.
    failed : dict of (str, str) to str
        Hypotheses and targets that could not be simulated at any starting value, with the reason.
    contradicted : dict of str to (float, float)
        Score of labels, and what their fits gained from any start, where that is less by more than
        the standard deviation of such a score, √(2 score).
    scores : SiteScores or None
        Of every hypothesis; None where the records can test none, or scores fail.
    """

    scene: Scene
    progress: Callable
    without_effects: Fit
    fits: list[Fit] = field(default_factory=list)
    chosen: Fit | None = None
    finished: bool = True
    compared: bool = True
    failed: dict[tuple[str, str], str] = field(default_factory=dict)
    contradicted: dict[str, tuple[float, float]] = field(default_factory=dict)
    scores: SiteScores | None = None
    _beside: dict[int, tuple[Fit, dict]] = field(default_factory=dict, repr=False)
    _bodies: dict[int, tuple[Fit, Located]] = field(default_factory=dict, repr=False)

    def delta_ln_evidence(self, fit: Fit) -> float:
        """Return the log Bayes factor of a fit over no effect, less ln(targets); (14.1)."""
        penalty = sum(np.log(len(e.hypothesis.targets(self.scene.case))) for e in fit.effects)
        return fit.log_evidence - self.without_effects.log_evidence - penalty

    def body_beside(self, fit: Fit) -> Located:
        """Return where in the rock one body explains what a fit leaves, found once for each.

        Raises
        ------
        InputError, SolverError
            If secondary sources can't be computed.
        """
        known = self._bodies.get(id(fit))
        if known is None or known[0] is not fit:
            scene, scores = self.scene, self.scores
            assert scores is not None  # who asks has scores
            rock = scene.secondary_places[0]
            bodies = rock.spread(quarter_wave(scene.baseline.project, scene.case))
            residual = scores.residual(fit.motion, fit.values)
            body = located(scores.at_fit(fit).error, bodies, residual, IN_ROCK)
            known = self._bodies[id(fit)] = fit, replace(body, places=rock)  # no further shapes
        return known[1]

    def classes(self, base: Fit | None = None) -> dict[str, float]:
        """Return the score of each label beside those of a fit, best first; computed once."""
        if self.scores is None:
            return {}
        base = base or self.without_effects
        if id(base) not in self._beside:
            self._beside[id(base)] = base, self.scores.beside(base)
        return {k: v for k, v in self._beside[id(base)][1].items() if k not in base.labels}

    def left_over(self, fit: Fit) -> float:
        """Return the largest score of a class beside a fit, zero if none is positive."""
        return max([0.0, *self.classes(fit).values()])

    def scored_beside(self, fit: Fit) -> bool:
        """Tell whether a class scores beside a fit, more than may be non-linear in its effects."""
        most = max(self.required, NOT_LINEAR * self.delta_ln_evidence(fit))
        return self.left_over(fit) > most

    def ranked(self) -> list[Fit]:
        """Return all fits, best evidence first."""
        return sorted(self.fits, key=self.delta_ln_evidence, reverse=True)

    def leaders(self, n_labels=1) -> list[Fit]:
        """Return the fits of a number of labels that the records cannot distinguish from the best.

        At most `BEAM`, each of other labels.
        """
        ranked = [fit for fit in self.ranked() if len(fit.labels) == n_labels]
        near = [fit for fit in ranked if self._lead(ranked[0], fit) < LEAD]
        labels = [set(fit.labels) for fit in near]
        return [fit for k, fit in enumerate(near) if labels[k] not in labels[:k]][:BEAM]

    def add(self, fit: Fit):
        """Add a fit, or keep the better of two of the same effects; the other is a mode if near."""
        same = [fit, *(known for known in self.fits if known.where == fit.where)]
        best = max(same, key=self.delta_ln_evidence)
        near = [known for known in same if self._lead(best, known) < DECISIVE]
        single = len(fit.effects) == 1  # others may have the same effects in another order
        modes = tuple(known for known in near if single and known is not best)
        self.fits = [known for known in self.fits if known.where != fit.where]
        self.fits.append(replace(best, alternatives=modes))

    @property
    def required(self) -> float:
        """Δ ln evidence that an effect must exceed; without scores that of any single one."""
        return LEAST_SCORE if self.scores is None else self.scores.threshold

    def runs_left(self) -> bool:
        """Tell whether the budget allows more runs."""
        more = self.scene.spent < self.scene.budget
        self.finished = self.finished and more
        return more

    def _lead(self, best, other):
        """Return the log Bayes factor between two fits."""
        return self.delta_ln_evidence(best) - self.delta_ln_evidence(other)


def search(
    scene: Scene,
    progress: Callable = lambda *_: None,
    known: Callable[[Search], object] = lambda _: None,
    seed: int = 1,
) -> Search:
    """Search the library for effects that explain what the calibrated site does not.

    Every hypothesis is scored under an error that is learned, and the best classes are fitted by
    runs while they score above the threshold.

    Parameters
    ----------
    scene : Scene
        With the budget after which no further effect is tried.
    progress : callable, optional
        Called with (stage, done, total).
    known : callable, optional
        Called with the state of the search before each step of it.
    seed : int
        Of the draws without an effect, by which scores are judged.

    Returns
    -------
    Search
        Without fits where nothing scores, or where the records can test no effect.
    """
    chosen = fit_calibrated(scene)

    def report(*step):
        known(state)
        progress(*step)

    state = Search(scene, report, chosen, chosen=chosen)
    testable = any(not hypothesis.untestable(scene.case) for hypothesis in LIBRARY.values())
    return _scored(state, seed) if testable else state


def _scored(search, seed):
    """Score every hypothesis, and fit the best classes while they score above the threshold."""
    scene, scores = search.scene, None
    with contained(scene.failures, SCORES):
        members = members_of(scene, search.progress, search.runs_left)
        scene.error = with_calibrated(scene.error, of_speeds(scene, members))
        search.without_effects = search.chosen = fit_calibrated(scene)
        own = SiteScores(scene, tuple(members), seed)
        search.progress("draws without an effect", 0, 1)
        scores = own if np.isfinite(own.threshold) else None  # a failure costs the scores alone
    if scores is None:
        return search
    search.scores = scores
    simulated = {effect.where for member in scores.members for effect in member.trial.effects}
    for places in scene.failures:
        if not isinstance(places, str):
            _enter_failures(search, [where for where in places if where not in simulated])
    return grown(search)


def grown(search: Search) -> Search:
    """Fit sets of effects, each on top of the best of fewer, while these score above the threshold.

    Returns
    -------
    Search
        The same, with its fits and the best set.
    """
    chosen = search.without_effects
    leaders = [chosen]
    for n_labels in range(1, MOST_EFFECTS + 1):
        for base in leaders:
            _refit(search, base)
        search.compared = search.compared and (n_labels > 1 or search.finished)
        least = search.delta_ln_evidence(chosen) + search.required
        leaders = [f for f in search.leaders(n_labels) if search.delta_ln_evidence(f) >= least]
        if not leaders:
            break
        search.chosen = chosen = leaders[0]
    return search


def _refit(search, base):
    """Fit the classes that score most beside a fit, if the first is above the threshold."""
    if not search.scored_beside(base):
        return
    search.progress("further values of the best", 0, 1)
    first = [pair for pair in search.classes(base).items() if pair[1] >= DECISIVE][:REFINED]
    starts = {label: _start(search, base, label, score) for label, score in first}
    ranked, by_runs = sorted(starts.items(), key=lambda pair: -pair[1][1]), 0
    for done, (label, (start, score)) in enumerate(ranked):
        reached = max(map(search.delta_ln_evidence, search.fits), default=-np.inf)
        gained = search.delta_ln_evidence(base) + REFIT_GAIN * score
        if by_runs == REFITTED or gained < reached or not search.runs_left():
            break
        search.progress(f"fit {label}", done, len(ranked))
        _fit_without_runs(search, base, label)
        if start is not None:
            _fit_forms(search, base, start, score)
        by_runs += start is not None


def _start(search, base, label, score):
    """Return an effect of a label on the site from which to fit it, and its score there.

    None in place of the former if the label is on no site.
    """
    member = search.scores.best_on_site(base, label)
    if member is None:
        return None, score
    effect = search.scores.start(member, base)
    names = [parameter.name for parameter in effect.hypothesis.parameters]
    tried = [effect]
    for name, values in effect.hypothesis.further:
        at, own = names.index(name), effect.values
        tried += [replace(effect, values=(*own[:at], (v,), *own[at + 1 :])) for v in values]
    if len(tried) > 1:
        effect, again = search.scores.best_of(tried, base) or (effect, score)
        score = max(score, again)
    return effect, score


def _fit_forms(search, base, effect, score):
    """Fit an effect on the site on a fit, and its other forms while a large blast fits less."""
    tried = {effect.name}
    _fit_by_runs(search, base, effect, score)
    for other, score in search.scores.other_forms(effect, base):
        fits = [fit for fit in search.ranked() if effect.label in fit.labels]
        if not fits or not not_improved(search.scene, search.without_effects, fits[0]):
            break
        if other.name not in tried and search.runs_left():
            _fit_by_runs(search, base, other, score)
            tried.add(other.name)


def _fit_by_runs(search, base, effect, score):
    """Fit an effect on the site on a fit, and anew where this gains much less than it scores.

    From the prior of what is calibrated, where it was scored, from the calibrated values, and from
    the prior by smaller steps.
    """
    prior, held = np.zeros(len(base.values)), base if base.effects else None
    starts = [(prior, LONGEST), (base.values, LONGEST), (prior, SMALLER * LONGEST)]
    if held is not None:  # its derivatives are those at its values
        starts = [(base.values, LONGEST), (base.values, SMALLER * LONGEST)]
    least = search.delta_ln_evidence(base) + score - np.sqrt(2.0 * max(score, 0.0))
    gain = -np.inf
    for reference, longest in starts:
        fitted = _fitted(search.scene, (*base.effects, effect), reference, held, longest)
        if fitted is not None:
            search.add(fitted)
            gain = max(gain, search.delta_ln_evidence(fitted))
        if gain >= least or not search.runs_left():
            break
    if gain < least and np.isfinite(gain):
        search.contradicted[effect.label] = score, gain - search.delta_ln_evidence(base)


def material(chi_square) -> bool:
    """Tell whether chi-squares (n_blasts, n_receivers) exceed what the model error explains."""
    return worst(chi_square) >= MATERIAL


def worst(chi_square) -> float:
    """Return the largest mean chi-square of a receiver or of a blast, (n_blasts, n_receivers)."""
    return float(max(means(chi_square, 0).max(), means(chi_square, 1).max()))


def means(chi_square, axis) -> np.ndarray:
    """Return mean chi-squares (n_blasts, n_receivers) along an axis, over existing records."""
    return np.sum(chi_square, axis=axis) / np.maximum(np.count_nonzero(chi_square, axis=axis), 1)


def _enter_failures(search, places):
    """Enter hypotheses and targets that were simulated at no starting value because of an error."""
    for where in places:
        reason = search.scene.failures.get(frozenset([where]))
        if reason is not None:
            search.failed[where] = reason


def _fit_without_runs(search, base, label):
    """Fit the effects of a label that need no runs, on a fit, at all targets that pay."""
    scene = search.scene
    forms = [h for h in LIBRARY.values() if h.on != "site" and h.label == label]
    for hypothesis in forms:
        best = search.scores.starts(hypothesis, base)
        paying = [effect for effect, score in best.values() if score > DECISIVE]
        most = max(best.values(), key=lambda pair: pair[1], default=None)
        if most is None or most[1] <= 0.0 or (base.effects and not paying):
            continue
        if hypothesis.single:
            paying = [most[0]] if paying else []
        added = paying or [most[0]]
        known = base if base.effects else None
        fitted = _fitted(scene, (*base.effects, *added), base.values, known)
        if fitted is not None:
            search.add(fitted)


def _fitted(scene, effects, *options):
    """Return the result of `fit`; None where it fails."""
    with scene.contained(effects):
        return fit(scene, effects, *options)
    return None
