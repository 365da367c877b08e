"""Search of the library: scores of every hypothesis, fits of the best, sets while these grow."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from ..errors import contained
from .effects import Scene, starting_effects
from .fitting import Fit, Fitter, fit, fit_calibrated, fit_partly
from .hypotheses import LIBRARY
from .scores import SiteScores, error_of, members_of
from .thresholds import DECISIVE, LEAD, LEAST_SCORE, MATERIAL, MOST_EFFECTS, NOT_LINEAR, REFIT_GAIN

SCORES = "scores of every effect"  # a part of a diagnosis that may fail
REFINED = 4  # classes whose further starting values are scored, in each pass
REFITTED = 2  # classes that are fitted by runs, of those that score, in each pass
BEAM = 2  # width of the beam search: sets of effects that are extended, if nearly as good


@dataclass(eq=False)
class Search:
    """State and result of a search.

    Parameters
    ----------
    scene : Scene
    limit : int
        Number of runs after which no further effect is tried.
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
    scores : SiteScores or None
        Of every hypothesis; None where the records can test none, or scores fail.
    """

    scene: Scene
    limit: int
    progress: Callable
    without_effects: Fit
    fits: list[Fit] = field(default_factory=list)
    chosen: Fit | None = None
    finished: bool = True
    compared: bool = True
    failed: dict[tuple[str, str], str] = field(default_factory=dict)
    scores: SiteScores | None = None
    _evidence: dict[int, tuple[Fit, float]] = field(default_factory=dict, repr=False)
    _beside: dict[int, tuple[Fit, dict]] = field(default_factory=dict, repr=False)

    def delta_ln_evidence(self, fit: Fit) -> float:
        """Return the log Bayes factor of a fit over no effect, less ln(targets); (14.3)."""
        penalty = sum(np.log(len(e.hypothesis.targets(self.scene.case))) for e in fit.effects)
        return self.log_evidence(fit) - self.log_evidence(self.without_effects) - penalty

    def log_evidence(self, fit: Fit) -> float:
        """Return the log evidence of a fit under the learned error, the fixed one without scores.

        Computed once for a fit.
        """
        if self.scores is None:
            return fit.log_evidence
        if id(fit) not in self._evidence:
            self._evidence[id(fit)] = fit, self.scores.evidence_of(fit)
        return self._evidence[id(fit)][1]

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
        self.finished = self.finished and self.scene.simulation.runs < self.limit
        return self.scene.simulation.runs < self.limit

    def _lead(self, best, other):
        """Return the log Bayes factor between two fits."""
        return self.delta_ln_evidence(best) - self.delta_ln_evidence(other)


def search(
    scene: Scene,
    limit: int,
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
    limit : int
        Number of runs after which no further effect is tried.
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

    state = Search(scene, limit, report, chosen, chosen=chosen)
    testable = any(not hypothesis.untestable(scene.case) for hypothesis in LIBRARY.values())
    return _scored(state, seed) if testable else state


def _scored(search, seed):
    """Score every hypothesis, and fit the best classes while they score above the threshold."""
    scene, scores = search.scene, None
    with contained(scene.failures, SCORES):
        members = members_of(scene, search.progress, search.runs_left)
        own = SiteScores(scene, error_of(scene, members), tuple(members), seed)
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
            _fit_by_runs(search, base, *start)
        by_runs += start is not None


def _start(search, base, label, score):
    """Return where to fit a label on the site, effect and blasts, and its score there.

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
    return (effect, member.blasts), score


def _fit_by_runs(search, base, effect, blasts):
    """Fit an effect on the site on a fit."""
    x_ref = base.values if base.effects else np.zeros(len(base.values))
    rival = next((fit for fit in search.leaders() if not base.effects), None)
    held = base if base.effects else None
    fitted = _fitted(search.scene, (*base.effects, effect), x_ref, blasts, held, rival)
    if fitted is not None:
        search.add(fitted)


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
    scene, before = search.scene, base.effects
    forms = [h for h in LIBRARY.values() if h.on != "site" and h.label == label]
    start = Fitter(scene, before, base.values)
    objective = start.objective(start.start(), start.motions([start.start()])[0])
    for hypothesis in forms:
        best = {}
        for target in hypothesis.targets(scene.case):
            trials = [
                _fitted_last(scene, (*before, effect), base.values)
                for effect in starting_effects(hypothesis, target, scene)
            ]
            reached, fitted = min(trials, key=lambda trial: trial[0])
            best[target] = objective - reached, fitted
        paying = [effect for decrease, effect in best.values() if decrease > 2.0 * DECISIVE]
        most = max(best.values(), key=lambda pair: pair[0], default=None)
        if most is None or most[0] <= 0.0 or (before and not paying):
            continue
        if hypothesis.single:
            paying = [most[1]] if paying else []
        added = paying or [most[1]]
        fitted = _fitted(scene, (*before, *added), base.values, base=base if before else None)
        if fitted is not None:
            search.add(fitted)


def _fitted_last(scene, effects, reference):
    """Return objective and the last effect, alone fitted; infinite where that fails."""
    with scene.contained(effects):
        objective, effects = fit_partly(scene, effects, reference, n_last=1)
        return objective, effects[-1]
    return np.inf, effects[-1]


def _fitted(scene, effects, *values, **options):
    """Return the result of `fit`; None where it fails."""
    with scene.contained(effects):
        return fit(scene, effects, *values, **options)
    return None
