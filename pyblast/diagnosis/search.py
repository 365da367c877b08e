"""Search of the library: screening or scores, fits of the best, sets while evidence grows."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np

from ..errors import contained
from .effects import Effect, Scene, starting_effects
from .fitting import Fit, Fitter, fit, fit_calibrated, fit_partly
from .hypotheses import LIBRARY
from .scores import SiteScores, error_of, members_of
from .thresholds import (
    DECISIVE,
    LEAD,
    LEAST_OF_BEST,
    LEAST_SHARE,
    MATERIAL,
    MOST_EFFECTS,
    MOST_EXPLAINED,
    NOT_LINEAR,
    REMAINS,
)

SCALE_SIGMA = 0.5  # prior standard deviation of the scale of a change simulated at one value
REWEIGHTINGS = 6  # rounds of iteratively reweighted least squares
SIDE_BY_SIDE = 8  # effects that are run together
REFINED = 4  # effects on the site that are fitted by runs, in the first pass
REFINED_LATER = 2
SCORES = "scores of every effect"  # a part of a diagnosis that may fail
REFITTED = 2  # classes that are fitted by runs, of those that score, in each pass
UNEXPLAINED = 6  # poor candidates that are fitted by runs, while no fit has enough evidence
SURELY = 3  # poor candidates that are fitted by runs, while little is explained
BEAM = 2  # width of the beam search: sets of effects that are extended, if nearly as good
AROUND = (-0.6, -0.3, 0.0, 0.3, 0.6)  # prior standard deviations of each parameter


@dataclass(frozen=True, eq=False)
class ScreeningResult:
    """Screening result: an effect on the site as judged by one or two runs.

    Parameters
    ----------
    effect : Effect
    share : float
        Share of the excess energy of its blasts that it explains.
    change : (n_blasts, n_receivers, 3, n_samples) float64, m/s
        Change of the motion of the reference site; zero in blasts that were not run.
    blasts : tuple of int
        Indices of the blasts that were run.
    scale : float
        Factor on the change that explains most.
    """

    effect: Effect
    share: float
    change: np.ndarray
    blasts: tuple[int, ...]
    scale: float = 1.0


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
    screening : list of ScreeningResult
        Best first.
    chosen : Fit or None
        The best set of effects; None if nothing was searched for.
    finished, compared : bool
        Whether the budget sufficed for the whole search, and for each effect on its own.
    failed : dict of (str, str) to str
        Hypotheses and targets that could not be simulated at any starting value, with the reason.
    scores : SiteScores or None
        Of every hypothesis, where the misfit lies within the usual error.
    """

    scene: Scene
    limit: int
    progress: Callable
    without_effects: Fit
    fits: list[Fit] = field(default_factory=list)
    screening: list[ScreeningResult] = field(default_factory=list)
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
        if self.scores is None:
            return False
        most = max(self.scores.threshold, NOT_LINEAR * self.delta_ln_evidence(fit))
        return self.left_over(fit) > most

    def ranked(self) -> list[Fit]:
        """Return all fits, best evidence first."""
        return sorted(self.fits, key=self.delta_ln_evidence, reverse=True)

    def leaders(self, n_labels=1) -> list[Fit]:
        """Return the fits of a number of labels that the records cannot distinguish from the best.

        At most `BEAM`, each of other labels.
        """
        ranked = [fit for fit in self.ranked() if len(fit.labels) == n_labels]
        near = [fit for fit in ranked if self._lead(ranked[0], fit) < self.lead]
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
    def lead(self) -> float:
        """Least lead in Δ ln evidence of an effect that the records distinguish from others."""
        return DECISIVE if self.scores is None else LEAD

    def runs_left(self) -> bool:
        """Tell whether the budget allows more runs."""
        self.finished = self.finished and self.scene.forward.runs < self.limit
        return self.scene.forward.runs < self.limit

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

    Where the misfit exceeds the usual error, effects are screened; where it does not, every
    hypothesis is scored under an error that is learned.

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
    if not testable:
        return state
    if not material(chosen.chi_square) and scene.case.share is None:
        return _scored(state, seed)
    _fit_without_runs(state, chosen)
    state.screening = screen(state)
    _fit_by_runs(state, state.screening, chosen, REFINED)
    _refit_around_leaders(state)
    state.compared = state.finished
    for n_labels in range(1, MOST_EFFECTS + 1):
        least = state.delta_ln_evidence(chosen) + DECISIVE
        leaders = [f for f in state.leaders(n_labels) if state.delta_ln_evidence(f) >= least]
        if not leaders:
            break
        state.chosen = chosen = leaders[0]
        if not material(chosen.chi_square) or n_labels == MOST_EFFECTS:
            break
        for base in leaders:
            _fit_without_runs(state, base)
            _fit_by_runs(state, screen_again(state, base), base, REFINED_LATER)
    return state


def _scored(search, seed):
    """Score every hypothesis, and fit the best classes while they score above the threshold."""
    scene, chosen, scores = search.scene, search.without_effects, None
    with contained(scene.failures, SCORES):
        members = members_of(scene, search.progress, search.runs_left)
        own = SiteScores(scene, error_of(scene), tuple(members), seed)
        search.progress("draws without an effect", 0, 1)
        scores = own if np.isfinite(own.threshold) else None  # a failure costs the scores alone
    if scores is None:
        return search
    search.scores = scores
    simulated = {effect.where for member in scores.members for effect in member.trial.effects}
    for places in scene.failures:
        if not isinstance(places, str):
            _enter_failures(search, [where for where in places if where not in simulated])
    leaders = [chosen]
    for n_labels in range(1, MOST_EFFECTS + 1):
        for base in leaders:
            _refit(search, base)
        least = search.delta_ln_evidence(chosen) + search.scores.threshold
        leaders = [f for f in search.leaders(n_labels) if search.delta_ln_evidence(f) >= least]
        if not leaders:
            break
        search.chosen = chosen = leaders[0]
    return search


def _refit(search, base):
    """Fit the classes that score most beside a fit, if the first is above the threshold."""
    classes = search.classes(base)
    if max(classes.values(), default=-np.inf) < search.scores.threshold:
        return
    by_runs = 0
    for done, (label, score) in enumerate(classes.items()):
        if by_runs == REFITTED or score < DECISIVE or not search.runs_left():
            break
        search.progress(f"fit {label}", done, len(classes))
        runs_before = search.scene.forward.runs
        _fit_without_runs(search, base, label)
        _fit_member(search, base, label)
        by_runs += search.scene.forward.runs > runs_before


def _fit_member(search, base, label):
    """Fit the member of a label on the site that scores most beside a fit, by runs."""
    member = search.scores.best_on_site(base, label)
    if member is None:
        return
    effect = _scored_further(search, base, search.scores.start(member, base))
    x_ref = base.values if base.effects else np.zeros(len(base.values))
    fitted = _fitted(search.scene, (*base.effects, effect), x_ref, member.blasts)
    if fitted is not None:
        search.add(fitted)


def _scored_further(search, base, effect):
    """Return an effect at the best of its value and its hypothesis' further starts."""
    names = [parameter.name for parameter in effect.hypothesis.parameters]
    tried = [effect]
    for name, starts in effect.hypothesis.further:
        at, own = names.index(name), effect.values
        tried += [replace(effect, values=(*own[:at], (v,), *own[at + 1 :])) for v in starts]
    return effect if len(tried) == 1 else search.scores.best_of(tried, base) or effect


def material(chi_square) -> bool:
    """Tell whether chi-squares (n_blasts, n_receivers) exceed what the model error explains."""
    return worst(chi_square) >= MATERIAL


def worst(chi_square) -> float:
    """Return the largest mean chi-square of a receiver or of a blast, (n_blasts, n_receivers)."""
    return float(max(means(chi_square, 0).max(), means(chi_square, 1).max()))


def means(chi_square, axis) -> np.ndarray:
    """Return mean chi-squares (n_blasts, n_receivers) along an axis, over existing records."""
    return np.sum(chi_square, axis=axis) / np.maximum(np.count_nonzero(chi_square, axis=axis), 1)


def screen(search: Search) -> list[ScreeningResult]:
    """Screen effects on the site by runs at their starting values, best first.

    Of two values of an odd effect that mirror each other, the second is run, in place of the
    first, only if the change by the first explains most with the other sign.

    Parameters
    ----------
    search : Search
        With its fit without effects.
    """
    candidates = [
        (effect, _screened_blasts(search, hypothesis, target))
        for hypothesis in LIBRARY.values() if hypothesis.on == "site"
        for target in hypothesis.targets(search.scene.case)
        for effect in starting_effects(hypothesis, target, search.scene)
    ]  # fmt: skip
    number: dict[Effect | None, int] = {effect: n for n, (effect, _) in enumerate(candidates)}
    later = [number.get(_mirror(effect), n) < n for n, (effect, _) in enumerate(candidates)]
    results = _screened(search, [c for c, late in zip(candidates, later, strict=True) if not late])
    mirrors = [
        (effect, blasts)
        for (effect, blasts), late in zip(candidates, later, strict=True)
        if late and _mirror(effect) in results and _is_turned(results[_mirror(effect)])
    ]  # fmt: skip
    for effect, result in _screened(search, mirrors).items():
        results[effect] = result
        if result is not None:
            del results[_mirror(effect)]
    best: dict[tuple[str, str], ScreeningResult] = {}
    for effect, result in results.items():
        key = effect.label, effect.target
        if result is not None and (key not in best or best[key].share < result.share):
            best[key] = result
    simulated = {effect.where for effect, result in results.items() if result is not None}
    _enter_failures(search, [e.where for e in results if e.where not in simulated])
    return sorted(best.values(), key=lambda result: -result.share)


def _screened(search, candidates):
    """Return the screening results of pairs of effect and blasts, while the budget lasts."""
    scene, x_ref, results = search.scene, np.zeros(len(search.without_effects.values)), {}
    for done, (effect, blasts) in enumerate(candidates):
        search.progress("effects on the site", done, len(candidates))
        if not search.runs_left():
            break
        if done % SIDE_BY_SIDE == 0:
            together = candidates[done : done + SIDE_BY_SIDE]
            for group in {own for _, own in together}:
                states = [(x_ref, (other,)) for other, own in together if own == group]
                scene.simulate(states, group)
        results[effect] = _screening_result(search, effect, x_ref, blasts)
    return results


def _mirror(effect):
    """Return an odd effect at values of the other sign, None of other effects."""
    if not effect.hypothesis.odd:
        return None
    pairs = zip(effect.hypothesis.parameters, effect.values, strict=True)
    turned = (tuple(-v for v in values) if p.mean == 0.0 else values for p, values in pairs)
    return replace(effect, values=tuple(turned))


def _is_turned(result):
    """Tell whether the change of a screening result explains most with the other sign."""
    return result is None or result.scale < 0.0


def _enter_failures(search, places):
    """Enter hypotheses and targets that were simulated at no starting value because of an error."""
    for where in places:
        reason = search.scene.failures.get(frozenset([where]))
        if reason is not None:
            search.failed[where] = reason


def _screened_blasts(search, hypothesis, target):
    """Return the blasts in which an effect is screened: its own, or the one explained worst.

    What grows with charge is screened in the first blast, too: in one alone it looks like a change
    of the calibrated parameters.
    """
    case, likelihood = search.scene.case, search.scene.baseline.likelihood
    if target in case.blasts:
        return (case.blasts.index(target),)
    chi_square = search.without_effects.chi_square
    excess = [likelihood.excess(chi_square, (b,)) for b in range(len(case.blasts))]
    largest = int(np.argmax(excess))
    return (largest,) if hypothesis.linear else tuple(sorted({0, largest or len(excess) - 1}))


def _screening_result(search, effect, x_ref, blasts):
    """Return how much one effect explains after runs of some blasts, at its best scale.

    None where it is impossible or fails.
    """
    scene, likelihood = search.scene, search.scene.baseline.likelihood
    simulated = scene.simulate([(x_ref, (effect,))], blasts)[0]
    if simulated is None:
        return None
    with scene.contained((effect,)):
        change = np.zeros_like(simulated)
        change[list(blasts)] = (simulated - scene.baseline.reference)[list(blasts)]
        chi_square, scale = _chi_square_at_best_scale(scene, change, blasts)
        share = likelihood.explained_share(search.without_effects.chi_square, chi_square, blasts)
        return ScreeningResult(effect, share, change, blasts, scale)
    return None


def _chi_square_at_best_scale(scene, change, blasts):
    """Return chi-squares where calibrated parameters and the scale of a change fit best, and it."""
    baseline, likelihood = scene.baseline, scene.baseline.likelihood
    slopes = baseline.slopes * baseline.sigma[:, None, None, None, None]
    jacobian = likelihood.whiten(np.concatenate([slopes, change[None]]))
    jacobian[:, [b for b in range(jacobian.shape[1]) if b not in blasts]] = 0.0
    mean = np.append(np.zeros(len(slopes)), 1.0)
    precision = np.append(np.ones(len(slopes)), SCALE_SIGMA**-2.0)
    residual, x = likelihood.residual(baseline.reference), mean
    for _ in range(REWEIGHTINGS):
        chi_square = likelihood.chi_square(residual - np.tensordot(x, jacobian, 1))
        weights = likelihood.weights(chi_square)
        hessian = np.einsum("ibrm,jbrm,br->ij", jacobian, jacobian, weights, optimize=True)
        gradient = np.einsum("ibrm,brm,br->i", jacobian, residual, weights, optimize=True)
        x = np.linalg.solve(hessian + np.diag(precision), gradient + precision * mean)
    return likelihood.chi_square(residual - np.tensordot(x, jacobian, 1)), float(x[-1])


def screen_again(search: Search, base: Fit) -> list[ScreeningResult]:
    """Screen effects on the site on top of a fit, by adding their changes to its motion."""
    likelihood, results = search.scene.baseline.likelihood, []
    for result in search.screening:
        if result.effect.label in base.labels:
            continue
        shares = [
            likelihood.explained_share(
                base.chi_square,
                likelihood.chi_square(likelihood.residual(base.motion + scale * result.change)),
                result.blasts,
            )
            for scale in (0.5, 1.0)
        ]
        results.append(replace(result, share=max(shares)))
    return sorted(results, key=lambda result: -result.share)


def _fit_without_runs(search, base, label=None):
    """Fit effects that need no runs, of one label or all, on a fit, at all targets that pay."""
    scene, before = search.scene, base.effects
    candidates = [h for h in LIBRARY.values() if h.on != "site" and h.label not in base.labels]
    candidates = [h for h in candidates if label in (None, h.label)]
    start = Fitter(scene, before, base.values)
    objective = start.objective(start.start(), start.motions([start.start()])[0])
    for done, hypothesis in enumerate(candidates):
        search.progress("effects that need no runs", done, len(candidates))
        best = {}
        for target in hypothesis.targets(scene.case):
            trials = [
                _fitted_partly(scene, (*before, effect), base.values, n_last=1)
                for effect in starting_effects(hypothesis, target, scene)
            ]
            reached, _, effects = min(trials, key=lambda trial: trial[0])
            best[target] = objective - reached, effects[-1]
        if not before:
            failed = [target for target, (gain, _) in best.items() if gain == -np.inf]
            _enter_failures(search, [(hypothesis.name, target) for target in failed])
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


def _fitted_partly(scene, effects, *values, **options):
    """Return the result of `fit_partly`; that of an impossible effect where it fails."""
    with scene.contained(effects):
        return fit_partly(scene, effects, *values, **options)
    return np.inf, None, effects


def _fitted(scene, effects, *values, **options):
    """Return the result of `fit`; None where it fails."""
    with scene.contained(effects):
        return fit(scene, effects, *values, **options)
    return None


def _fit_by_runs(search, screening: Sequence[ScreeningResult], base, most):
    """Fit the best screened effects by runs on top of a fit, one target of each label."""
    labels, done = set(base.labels), 0
    largest = max((result.share for result in screening), default=0.0)
    x_ref = base.values if base.effects else np.zeros(len(base.values))
    for result in screening:
        explained, surely = (0.0, 0) if base.effects else _explained(search)
        poor = result.share < max(LEAST_SHARE, LEAST_OF_BEST * max(explained, largest))
        if done >= (surely if poor else max(most, surely)) or not search.runs_left():
            break
        if result.effect.label in labels:
            continue
        labels.add(result.effect.label)
        result = _from_further_starts(search, result)
        search.progress(f"fit {result.effect.label}", done, max(most, surely))
        runs_before = search.scene.forward.runs
        effects, best = (*base.effects, result.effect), next(iter(search.leaders()), None)
        rival = None if base.effects or best is None or not _explains(search, best) else best
        fitted = _fitted(search.scene, effects, x_ref, result.blasts, base, rival)
        if fitted is not None:
            search.add(fitted)
        done += search.scene.forward.runs > runs_before


def _from_further_starts(search, result):
    """Return the best screening result of an effect and of its hypothesis' further starts."""
    effect, x_ref = result.effect, np.zeros(len(search.without_effects.values))
    names = [parameter.name for parameter in effect.hypothesis.parameters]
    tried = [result]
    for name, starts in effect.hypothesis.further:
        at, own = names.index(name), tried[0].effect.values
        others = [replace(effect, values=(*own[:at], (start,), *own[at + 1 :])) for start in starts]
        search.scene.simulate([(x_ref, (other,)) for other in others], result.blasts)
        results = [_screening_result(search, other, x_ref, result.blasts) for other in others]
        tried = [*tried, *filter(None, results)]
        tried.sort(key=lambda each: -each.share)
    return tried[0]


def _refit_around_leaders(search):
    """Fit leaders that grow with charge again, from the best values around them, in all forms.

    Their misfit has a narrow valley, and a minimisation may end on its side. One that leads by more
    than decides, and leaves nothing that counts, is not fitted again.
    """
    scene, x_ref = search.scene, np.zeros(len(search.without_effects.values))
    leaders = search.leaders()
    if len(leaders) == 1 and _explains(search, leaders[0]):
        return
    for leader in leaders:
        first = leader.effects[0]
        forms = [h for h in LIBRARY.values() if h.label == first.label and not h.linear]
        if not forms or not search.runs_left():
            continue
        grids = [
            [parameter.value(parameter.standardised(value) + step) for step in AROUND]
            for parameter, (value,) in zip(first.hypothesis.parameters, first.values, strict=True)
        ]
        points = [
            tuple((value,) for value in values)
            for values in product(*grids)
            if all(p.low <= v <= p.high for p, v in zip(forms[0].parameters, values, strict=True))
        ]  # fmt: skip
        candidates = [Effect(form.name, first.target, point) for form in forms for point in points]
        search.progress(f"around {first.label}", 0, 1)
        blasts = next(r.blasts for r in search.screening if r.effect.where == first.where)
        scene.simulate([(x_ref, (effect,)) for effect in candidates], blasts)
        best = min(candidates, key=lambda e: _fitted_partly(scene, (e,), x_ref, blasts)[0])
        fitted = _fitted(scene, (best,), x_ref, blasts, search.without_effects)
        if fitted is not None:
            search.add(fitted)


def _explains(search, best):
    """Tell whether a fit has enough evidence, and leaves nothing else that counts.

    Of an effect that the records cannot test, all rivals that explain much are listed.
    """
    likelihood = search.scene.baseline.likelihood
    if any(effect.hypothesis.untestable(search.scene.case) for effect in best.effects):
        return False
    share = likelihood.explained_share(search.without_effects.chi_square, best.chi_square)
    remains = worst(best.chi_square) >= REMAINS and share < MOST_EXPLAINED
    return search.delta_ln_evidence(best) > DECISIVE and not remains


def _explained(search):
    """Return the share of the excess energy that the best fit explains, if its evidence suffices.

    Second, how many poor candidates must be fitted because so little is explained.
    """
    best, likelihood = next(iter(search.leaders()), None), search.scene.baseline.likelihood
    if best is None or search.delta_ln_evidence(best) <= DECISIVE:
        return 0.0, UNEXPLAINED
    share = likelihood.explained_share(search.without_effects.chi_square, best.chi_square)
    return share, SURELY if share < MOST_EXPLAINED else 0
