"""Scores of every hypothesis: its change of motion, the error beside it, detection limits."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import groupby
from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp

from ..errors import contained
from ..inference.error_model import Change, ErrorModel, Level, Scores
from ..inference.nuisances import UNCORRECTED
from .case import Case
from .effects import Effect, Scene, starting_effects
from .error import with_calibrated
from .fitting import Fit
from .hypotheses import LIBRARY, Hypothesis, blast_and_hole
from .thresholds import DRAWN_LEVEL, DRAWS, FARTHEST, LEAST_SCORE, NUMERICAL

STEP = 0.05  # prior standard deviations, of effects that start without a change
TOGETHER = 8  # changes that are run together
LIMITED = 12  # places of an effect, of many, at which its detection limit is measured


class Trial(NamedTuple):
    """Trial: effects at a target whose changes are scored together.

    Parameters
    ----------
    effects : tuple of Effect
        Each has a strength of its own.
    share : float
        Of a prior standard deviation, by which each effect departs from none; then strengths may
        have any sign. Zero for a single effect of positive strength, one at the given values.
    """

    effects: tuple[Effect, ...]
    share: float = 0.0


def trials(hypothesis: Hypothesis, target: str, scene: Scene) -> list[Trial]:
    """Return the trials of a hypothesis at a target, at all of its starting values.

    Parameters that may depart from no effect to either side are tried together, one effect each.
    """
    starts = starting_effects(hypothesis, target, scene)
    moving = [n for n, _ in enumerate(hypothesis.parameters) if _two_sided(hypothesis, n)]
    if not moving:
        return [Trial((effect,)) for effect in starts]
    rest = _at_rest(starts[0])
    share = 1.0 if hypothesis.odd else STEP
    together = tuple(
        _moved(rest, order, hole, share)
        for order in moving
        for hole, _ in enumerate(rest.values[order])
    )
    others = [] if hypothesis.odd else [effect for effect in starts if effect != rest]
    return [Trial(together, share), *(Trial((effect,)) for effect in others)]


def _two_sided(hypothesis, order):
    """Tell whether a parameter may depart from no effect to either side."""
    parameter = hypothesis.parameters[order]
    if hypothesis.odd:
        return parameter.mean == 0.0 and len(parameter.starts) > 1
    return parameter.null in parameter.starts


def _at_rest(effect):
    """Return an effect whose parameters are without effect, where they have such a value."""
    pairs = zip(effect.hypothesis.parameters, effect.values, strict=True)
    return replace(effect, values=tuple(
        (float(parameter.null),) * len(values) if _has_rest(parameter) else values
        for parameter, values in pairs
    ))  # fmt: skip


def _has_rest(parameter):
    """Tell whether a finite value of a parameter is without effect."""
    return parameter.null is not None and np.isfinite(parameter.null)


def _moved(effect, order, hole, share):
    """Return an effect with one value moved by a share of its prior standard deviation."""
    parameter = effect.hypothesis.parameters[order]
    own = list(effect.values[order])
    if effect.hypothesis.odd:
        own[hole] = max(parameter.starts)
    else:
        own[hole] = float(parameter.value(parameter.standardised(own[hole]) + share))
    return replace(effect, values=(*effect.values[:order], tuple(own), *effect.values[order + 1 :]))


@dataclass(frozen=True, eq=False)
class Member:
    """Member of the library at one target, with its change of motion.

    Parameters
    ----------
    trial : Trial
    change : Change
    blasts : tuple of int
        Indices of the blasts by whose records it is scored.
    """

    trial: Trial
    change: Change
    blasts: tuple[int, ...]

    @property
    def hypothesis(self) -> Hypothesis:
        """Its entry of the library."""
        return self.trial.effects[0].hypothesis

    @property
    def label(self) -> str:
        """Its name in results."""
        return self.hypothesis.label

    @property
    def target(self) -> str:
        """Where it acts."""
        return self.trial.effects[0].target

    def at(self, strength) -> Effect:
        """Return the effect at strengths (n_effects,) in units of its changes.

        Of a single trial of positive strength it is the one that was simulated.
        """
        first = self.trial.effects[0]
        if not self.trial.share:
            return first
        parameters = self.hypothesis.parameters
        changed = [list(values) for values in _at_rest(first).values]
        for effect, amount in zip(self.trial.effects, strength, strict=True):
            for n, parameter in enumerate(parameters):
                for hole, value in enumerate(effect.values[n]):
                    if _has_rest(parameter):
                        away = (value - float(parameter.null or 0.0)) / self.trial.share
                        changed[n][hole] += float(amount) * away
        values = tuple(
            tuple(float(np.clip(v, parameter.low, parameter.high)) for v in own)
            for parameter, own in zip(parameters, changed, strict=True)
        )
        return replace(first, values=values)


def main_blasts(case: Case) -> tuple[int, ...]:
    """Return the blasts of the smallest and of the largest charge."""
    return tuple(dict.fromkeys((0, len(case.blasts) - 1)))


def _blasts_of(target, case):
    """Return the blasts that a member changes and is run in, and those by which it is scored."""
    names = {target, blast_and_hole(target)[0]}
    own = next((n for n, name in enumerate(case.blasts) if name in names), None)
    main = main_blasts(case)
    if own is None:
        return main, main
    return (own,), main if own in main else tuple(sorted({main[0], own}))


def members_of(
    scene: Scene,
    progress: Callable = lambda *_: None,
    runs_left: Callable[[], bool] = lambda: True,
) -> list[Member]:
    """Simulate the changes of all hypotheses of the library that apply to a site.

    Parameters
    ----------
    scene : Scene
    progress : callable, optional
        Called with (stage, done, total).
    runs_left : callable, optional
        Tells whether more runs are allowed.

    Returns
    -------
    list of Member
        Without those that are impossible here or change no record; the failures of the scene have
        the reasons of those that could not be simulated.
    """
    case, tried, stored = scene.case, [], []
    for hypothesis in LIBRARY.values():
        if hypothesis.stored is not None:
            stored += _by_stored_fields(scene, hypothesis)
            continue
        for target in hypothesis.targets(case):
            run, scored = _blasts_of(target, case)
            tried += [(t, run, scored) for t in trials(hypothesis, target, scene)]
    on_site = [row for row in tried if row[0].effects[0].hypothesis.on == "site"]
    by_runs = _cheapest_first(scene, on_site)
    done = [
        (trial, scored, _change_without_runs(scene, trial))
        for trial, _, scored in tried if trial.effects[0].hypothesis.on != "site"
    ]  # fmt: skip
    at = 0
    for run, group in groupby(by_runs, key=lambda row: row[1]):
        rows = list(group)
        for start in range(0, len(rows), TOGETHER):
            progress("changes by every hypothesis", at, len(by_runs))
            if not runs_left():
                break
            part = rows[start : start + TOGETHER]
            changes = _changes_by_runs(scene, [row[0] for row in part], run)
            done += [(t, s, c) for (t, _, s), c in zip(part, changes, strict=True)]
            at += len(part)
    return [
        Member(trial, Change(shapes / (trial.share or 1.0), trial.share == 0.0), scored)
        for trial, scored, shapes in done + stored if shapes is not None and np.any(shapes)
    ]  # fmt: skip


def _by_stored_fields(scene, hypothesis):
    """Return trials of a hypothesis at its targets, the blasts that score them, and changes."""
    case, name = scene.case, hypothesis.name
    targets, failed, rows = hypothesis.targets(case), {}, []
    with contained(failed, name):
        values, changes = hypothesis.stored(scene) if targets else ((), ())
        at = [Effect(name, target, tuple((v,) for v in values)) for target in targets]
        rows = [
            (Trial((effect,), 1.0), main_blasts(case), change[None])
            for effect, change in zip(at, changes, strict=True)
        ]
    for reason in failed.values():
        scene.failures |= {frozenset([(name, target)]): reason for target in targets}
    return rows


def _cheapest_first(scene, rows):
    """Return rows of trials by blasts, in the order of what they decide for their price.

    The first value and target of a hypothesis decides most, each further one less.
    """
    turns: Counter[str] = Counter()
    keyed, values = [], 0.0 * scene.baseline.values
    for number, row in enumerate(rows):
        effect = row[0].effects[0]
        turns[effect.name] += 1
        price = np.inf
        with contained({}, effect.where):
            price = scene.price(values, (effect,))
        keyed.append((row[1], turns[effect.name] * price, number))
    return [rows[number] for *_, number in sorted(keyed)]


def _change_without_runs(scene, trial):
    """Return the changes by effects on holes or motion, in the band; None if one fails."""
    motion, changes = scene.baseline.motion + scene.filtered().change, []
    for effect in trial.effects:
        with scene.contained((effect,)):
            changes.append(scene.seen(scene.received(motion, (effect,)) - motion))
    return np.array(changes) if len(changes) == len(trial.effects) else None


def _changes_by_runs(scene, tried, blasts):
    """Return the changes of motion by effects on the site, in the band; None if one fails."""
    x_ref = np.zeros(len(scene.baseline.values))
    states = [(x_ref, (effect,)) for trial in tried for effect in trial.effects]
    motions = iter(scene.simulate(states, blasts))
    changes, at = [], list(blasts)
    for trial in tried:
        own = [next(motions) for _ in trial.effects]
        if any(motion is None for motion in own):
            changes.append(None)
            continue
        change = scene.seen(np.array(own) - scene.baseline.reference)
        change[:, [b for b in range(change.shape[1]) if b not in at]] = 0.0
        changes.append(change)
    return changes


def of_speeds(scene: Scene, members: Sequence[Member]) -> list[np.ndarray]:
    """Return the changes by members of wave speeds within the prior of these.

    They are a part of the error: the slopes of the calibration are those of longer steps.
    """
    percent, columns = scene.case.project.config.priors.speed_percent, []
    for member in members:
        if member.label == "rock_speed":
            sigma = [p.sigma for p in member.hypothesis.parameters]
            within = 0.01 * percent / np.array(sigma)[:, None, None, None, None]
            columns += [*(within * member.change.shapes)]
    return columns


@dataclass(frozen=True, eq=False)
class SiteScores:
    """Scores of all members of the library at a site.

    Parameters
    ----------
    scene : Scene
    members : tuple of Member
    seed : int
        Of the draws.
    fit : Fit, optional
        Beside whose effects they are scored; none by default.
    """

    scene: Scene
    members: tuple[Member, ...]
    seed: int
    fit: Fit | None = None
    _beside: dict[int, "SiteScores"] = field(default_factory=dict, repr=False)
    _of_blasts: dict[tuple, ErrorModel] = field(default_factory=dict, repr=False)
    _scored: dict[int, tuple[Fit, np.ndarray]] = field(default_factory=dict, init=False, repr=False)

    @cached_property
    def error(self) -> ErrorModel:
        """Error of the prediction, what is calibrated included."""
        fit, baseline = self.fit, self.scene.baseline
        known = self.scene.error
        if fit is not None:
            known = self.scene.error_beside(fit.effects, fit.values, fit.motion, fit.filters)
        held = self.scene.case.band.project(baseline.slopes)
        return with_calibrated(known, baseline.sigma[:, None, None, None, None] * held)

    def at_fit(self, fit: Fit) -> "SiteScores":
        """Return the scores beside a fit, whose effects on the site follow idealised laws.

        The change of motion by them has an error of `IDEALISED` of its energy; theory.md (14.13).
        """
        known_filters = fit.filters is self.scene.filters or not fit.filters
        if known_filters and all(e.hypothesis.family == "instrument" for e in fit.effects):
            return self
        known = self._beside.get(id(fit))
        if known is None or known.fit is not fit:
            self._beside.clear()  # one is large
            known = self._beside[id(fit)] = replace(self, fit=fit, _beside={}, _of_blasts={})
        return known

    def of(
        self, changes: Sequence[Change], blasts: Sequence[int], residuals, every: bool = False
    ) -> Scores:
        """Return the scores of changes by the records of some blasts, of residuals of all."""
        return self._error_of(tuple(blasts)).scores(residuals, changes, every)

    def _error_of(self, blasts):
        """Return the error of the records of some blasts; those of a set are kept."""
        if blasts not in self._of_blasts:
            others = [b for b in range(len(self.scene.case.blasts)) if b not in blasts]
            out = np.zeros(self.scene.case.motion.shape[:2], dtype=bool)
            out[others] = True
            self._of_blasts[blasts] = self.error.without(out) if others else self.error
        return self._of_blasts[blasts]

    @cached_property
    def numbers(self) -> dict[tuple[int, ...], list[int]]:
        """Numbers of the members that are scored by each set of blasts."""
        numbers: dict[tuple[int, ...], list[int]] = {main_blasts(self.scene.case): []}
        for n, member in enumerate(self.members):
            numbers.setdefault(member.blasts, []).append(n)
        return numbers

    def of_members(self, residuals, every: bool = False) -> dict[tuple[int, ...], Scores]:
        """Return the scores of the members of each set of blasts, in the order of `numbers`."""
        return {
            blasts: self.of([self.members[n].change for n in own], blasts, residuals, every)
            for blasts, own in self.numbers.items()
        }

    def log_bayes(self, residuals) -> np.ndarray:
        """Return the log Bayes factor of each member, (n_members, n_data)."""
        return self._collected(self.of_members(residuals))

    def _collected(self, by_blasts):
        """Return the log Bayes factors (n_members, n_data) of scores by set of blasts."""
        n_data = len(by_blasts[main_blasts(self.scene.case)].log_evidence)
        values = np.zeros((len(self.members), n_data))
        for blasts, scores in by_blasts.items():
            values[self.numbers[blasts]] = scores.log_bayes
        return values

    def by_class(self, log_bayes) -> dict[str, np.ndarray]:
        """Return the log Bayes factor of each label, averaged over its members."""
        labels = np.array([member.label for member in self.members])
        return {
            label: logsumexp(log_bayes[labels == label], axis=0) - np.log(np.sum(labels == label))
            for label in dict.fromkeys(labels.tolist())
        }

    def residual(self, motion, values) -> np.ndarray:
        """Return the records less a prediction at the prior, in the band.

        Parameters
        ----------
        motion : (n_blasts, n_receivers, 3, n_samples) float64, m/s
            Simulated at the calibrated values.
        values : (n_calibrated,) float64
            Taken back to the prior along the slopes of the baseline.
        """
        band = self.scene.case.band
        held = band.project(self.scene.baseline.slopes)
        return band.project(self.scene.case.residual(motion)) + np.tensordot(values, held, 1)

    @cached_property
    def prior(self) -> np.ndarray:
        """Records less the prediction of the calibrated site, at the prior."""
        baseline = self.scene.baseline
        return self.residual(baseline.motion + self.scene.filtered().change, baseline.values)

    def _members_beside(self, fit):
        """Return the log Bayes factor (n_members, 1) of each member beside a fit, kept."""
        known = self._scored.get(id(fit))
        if known is None or known[0] is not fit:
            scored = self.at_fit(fit).log_bayes(self.residual(fit.motion, fit.values)[None])
            known = self._scored[id(fit)] = fit, scored
        return known[1]

    def beside(self, fit: Fit) -> dict[str, float]:
        """Return the score of each label beside a fit, best first."""
        by_class = self.by_class(self._members_beside(fit))
        scored = {label: float(value[0]) for label, value in by_class.items()}
        return dict(sorted(scored.items(), key=lambda pair: -pair[1]))

    def best_on_site(self, fit: Fit, label: str) -> Member | None:
        """Return the member of a label on the site that scores most beside a fit, None if none."""
        pairs = [
            (value, member)
            for (value,), member in zip(self._members_beside(fit), self.members, strict=True)
            if member.label == label and member.hypothesis.on == "site"
        ]
        return max(pairs, key=lambda pair: pair[0], default=(None, None))[1]

    def other_forms(self, effect: Effect, fit: Fit) -> list[tuple[Effect, float]]:
        """Return where to fit the other forms of an effect on the site, best first, with scores."""
        forms = [
            hypothesis for hypothesis in dict.fromkeys(each.hypothesis for each in self.members)
            if hypothesis.label == effect.label and hypothesis.on == "site"
            and hypothesis is not effect.hypothesis
        ]  # fmt: skip
        pairs = [pair for form in forms for pair in self.starts(form, fit).values()]
        return sorted(pairs, key=lambda pair: -pair[1])

    def starts(self, hypothesis: Hypothesis, fit: Fit) -> dict[str, tuple[Effect, float]]:
        """Return where to fit a hypothesis at each target, the best of its starts, and its score.

        Beside a fit.
        """
        best: dict[str, tuple[Effect, float]] = {}
        pairs = zip(self._members_beside(fit), self.members, strict=True)
        own = [(float(score), each) for (score,), each in pairs if each.hypothesis is hypothesis]
        for score, member in sorted(own, key=lambda pair: -pair[0]):
            if member.target not in best:
                best[member.target] = self.start(member, fit), score
        return best

    def start(self, member: Member, fit: Fit) -> Effect:
        """Return the effect of a member at its most probable strengths beside a fit."""
        residual = self.residual(fit.motion, fit.values)[None]
        scores = self.at_fit(fit).of([member.change], member.blasts, residual)
        return member.at(scores.strength[0][:, 0])

    def best_of(self, effects: Sequence[Effect], fit: Fit) -> tuple[Effect, float] | None:
        """Return which of several effects on the site scores most beside a fit, and its score.

        None if none is possible.
        """
        blasts = main_blasts(self.scene.case)
        changes = _changes_by_runs(self.scene, [Trial((effect,)) for effect in effects], blasts)
        pairs = [
            (effect, Change(shapes))
            for effect, shapes in zip(effects, changes, strict=True) if shapes is not None
        ]  # fmt: skip
        if not pairs:
            return None
        residual = self.residual(fit.motion, fit.values)[None]
        scores = self.at_fit(fit).of([change for _, change in pairs], blasts, residual)
        best = int(np.argmax(scores.log_bayes[:, 0]))
        return pairs[best][0], float(scores.log_bayes[best, 0])

    @cached_property
    def at(self) -> Level:
        """Most probable level of the error of the calibrated site."""
        return self.of((), main_blasts(self.scene.case), self.prior[None]).at

    @cached_property
    def drawn(self) -> dict[tuple[int, ...], Scores]:
        """Scores of the members of each set of blasts, of draws without an effect at `at`."""
        drawn = self.error.draws(np.random.default_rng(self.seed), DRAWS, self.at)
        return self.of_members(drawn, every=True)

    @cached_property
    def thresholds(self) -> dict[str, float]:
        """Least log Bayes factor of a class, by what asks for it."""
        mesh = UNCORRECTED * self.scene.case.band.project(self.scene.baseline.correction)
        of_mesh = self.log_bayes(self.error.offset + np.stack([mesh, -mesh]))
        drawn, numerical = (
            np.max([*self.by_class(values).values()], axis=0, initial=-np.finfo(float).max)
            for values in (self._collected(self.drawn), of_mesh)
        )
        return {
            "least": LEAST_SCORE,
            "draws": float(np.quantile(drawn, DRAWN_LEVEL)),
            "numerical": float(numerical.max()) + NUMERICAL,
        }

    @property
    def threshold(self) -> float:
        """Log Bayes factor from which a class is more than the error explains."""
        return max(self.thresholds.values())


def detection_limits(scores: SiteScores, labels: Sequence[str] = ()) -> list[dict]:
    """Return the detection limits of all hypotheses at a site, but those of some labels.

    Parameters
    ----------
    scores : SiteScores
    labels : sequence of str
        Of effects that are named.

    Returns
    -------
    list of dict
        For each parameter that departs from none: ``label``, ``form``, ``target`` (its kind),
        ``parameter``, ``unit``, ``per_hole``, ``null_value`` (None where it is infinite),
        ``value``, from which the effect scores above the threshold in nine of ten cases, the
        farthest of all targets, ``beside``, the values of the other parameters there,
        ``not_detected_at``, targets where it does not at `FARTHEST` times what was simulated.

    Notes
    -----
    Theory.md (14.12), by `SiteScores.drawn`: a change is taken as linear in the departure, up to
    what was simulated where the effect grows with charge.
    """
    number = {}
    for member in scores.members:
        number[member.label] = number.get(member.label, 0) + 1
    limits: dict[tuple, dict[str, _Limit]] = {}
    two_sided, asked = set(), _limited(scores)
    for member, strengths in sorted(_drawn(scores), key=lambda pair: -pair[0].trial.share):
        if member.label in labels or member.hypothesis.untestable(scores.scene.case):
            continue
        if member.hypothesis.stored is not None and member.target not in asked:
            continue
        least = scores.threshold + np.log(number[member.label])
        for k, effect in enumerate(member.trial.effects):
            strength = strengths(least, k)
            for name, limit in _limits_of(member, k, strength):
                own = limits.setdefault((effect.name, name), {})
                known = own.get(member.target)
                if member.trial.share:
                    two_sided.add((effect.name, name))
                elif (effect.name, name) in two_sided:
                    continue  # a small step is linear, a large one need not be
                own[member.target] = limit if known is None else min(known, limit, key=_size)
    return [_limit_row(name, parameter, own) for (name, parameter), own in limits.items()]


def _limited(scores):
    """Return the targets by stored fields at which limits are measured, `LIMITED` of all."""
    own = [each.target for each in scores.members if each.hypothesis.stored is not None]
    return set(own[:: max(len(own) // LIMITED, 1)])


def _drawn(scores):
    """Return each member with the function that gives its detected strength among the draws."""
    return [
        (scores.members[n], partial(own.detected_strength, order))
        for blasts, own in scores.drawn.items()
        for order, n in enumerate(scores.numbers[blasts])
    ]


class _Limit(NamedTuple):
    """Detection limit at a target: size of the departure, value, other values."""

    size: float
    value: float
    beside: tuple[tuple[str, float], ...]


def _size(limit):
    """Return the size of the departure of a limit, infinite where nothing was detected."""
    return limit.size


def _limits_of(member, number, strength):
    """Return name and limit of the parameter by which a member departs from no effect."""
    hypothesis, share = member.hypothesis, member.trial.share
    most = FARTHEST if hypothesis.linear else 1.0
    parameters, values = hypothesis.parameters, _departing(member, number)
    departs = [
        n for n, (parameter, value) in enumerate(zip(parameters, values, strict=True))
        if parameter.null is not None and value != parameter.null
    ]  # fmt: skip
    if not departs:
        return []
    amount = strength / (share or 1.0)
    if not hypothesis.linear and np.isinf(parameters[departs[0]].null):
        amount = max(amount, 1.0)  # a strength: nothing is known of what is stronger
    reached = [
        _scaled(parameter, value, amount) if n in departs else value
        for n, (parameter, value) in enumerate(zip(parameters, values, strict=True))
    ]
    first = departs[0]
    own, value = parameters[first], reached[first]
    beyond = strength > 1.0 and np.isfinite(own.null) and not own.low <= value <= own.high
    if strength > (max(1.0, most * share) if share else most) or beyond:
        return [(own.name, _Limit(np.inf, np.nan, ()))]
    if np.isfinite(own.null):  # what is weaker than the range is not asked
        value = float(np.clip(value, own.low, own.high))
    beside = tuple(
        (parameters[n].name, other) for n, other in enumerate(reached)
        if n != first and other not in (parameters[n].null, 0.0)
    )  # fmt: skip
    size = abs(value - own.null) if np.isfinite(own.null) else 1.0 / value
    return [(own.name, _Limit(size, value, beside))]


def _departing(member, number):
    """Return a value of each parameter of one effect of a member, of the hole that it changes."""
    effect = member.trial.effects[number]
    pairs = zip(member.hypothesis.parameters, effect.values, strict=True)
    return [next((v for v in own if v != parameter.null), own[0]) for parameter, own in pairs]


def _scaled(parameter, value, amount):
    """Return the value of a parameter at a share of its departure from no effect."""
    if np.isinf(parameter.null):
        return value / amount
    return parameter.null + amount * (value - parameter.null)


def _limit_row(name, parameter, by_target):
    """Return the row of a parameter from its limits by target, that of the worst one."""
    hypothesis = LIBRARY[name]
    own = next(each for each in hypothesis.parameters if each.name == parameter)
    seen = {target: limit for target, limit in by_target.items() if np.isfinite(limit.size)}
    worst = max(seen.values(), key=_size, default=None)
    return {
        "label": hypothesis.label, "form": hypothesis.form, "target": hypothesis.target,
        "parameter": parameter, "unit": own.unit, "per_hole": own.per_hole,
        "null_value": None if own.null is None or np.isinf(own.null) else own.null,
        "value": None if worst is None else worst.value,
        "beside": {} if worst is None else dict(worst.beside),
        "not_detected_at": [target for target in by_target if target not in seen],
    }  # fmt: skip
