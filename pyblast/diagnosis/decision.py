"""Decision of a diagnosis: outcome and named effects, corrected for the error of the mesh."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats
from scipy.special import logsumexp

from ..errors import contained
from ..ground.tables import is_anisotropic
from ..inference.location import Places, unrestricted
from ..simulation.simulation import Simulation
from .cross_validation import CrossValidation, cross_validate
from .effects import Scene, of_all_holes
from .fitting import Fit, corrected, fit, not_fitted, not_improved
from .search import Search, material, worst
from .thresholds import (
    FAR_OFF,
    LEAD,
    MESH_CHANGE,
    MOST_EXPLAINED,
    OPEN_SET,
    OUTLIER_LEVEL,
    REMAINS,
    USUAL_LEVEL,
)

# A label as those of the library, but without parameters.
RESOLUTION = "numerical_resolution"
RESOLUTION_CLAIM = "On a finer mesh the evidence of this answer is below the threshold, or unknown."
RESOLUTION_DECIDED_BY = (
    "shorter zones (`cuts` of `pyblast.workflows.diagnose`) until the answer stays"
)
SPRINGS = 3.0  # spread of the logarithms of stiffness over that of speeds and density
OPEN_SET_TEST = "open-set test"  # a part of a diagnosis that may fail
FINER_MESH = "runs on a finer mesh"  # a part of a diagnosis that may fail
HALF_WIDTH = 1.645  # standard deviations, half of a 90 % interval
OUTCOMES = ("NULL", "NAMED", "CLASS", "COMPOSITE", "PARTIAL", "UNKNOWN", "MISTAKE")


@dataclass(frozen=True, eq=False)
class Decision:
    """Decision: an outcome and what it is based on.

    Parameters
    ----------
    outcome : str
        Of `OUTCOMES`.
    fit : Fit
        The best model; the calibrated site for NULL and UNKNOWN.
    rivals : tuple of str
        Labels that the records cannot distinguish, that of the best model first.
    probability : dict of str to float
        Posterior probability of each label, of "none", and of "unknown": larger errors than
        those of good ground.
    explained_share : float
        Share of the excess energy that the best set of effects explains.
    cross_validation : CrossValidation or None
    best : Fit or None
        The best set of effects, named or not, corrected for the mesh; None if none has enough
        evidence to be considered.
    mesh_change : float or None
        Chi-square of the change of the best model by a finer mesh, see `on_finer_mesh`; None
        without a finer mesh.
    fails : tuple of str
        Sentences on what the best model does not explain although it should.
    open_set : float or None
        Evidence of the best model over that of unrestricted secondary sources, see
        `open_set_ratio`; None where these are not known or show nothing.
    """

    outcome: str
    fit: Fit
    rivals: tuple[str, ...]
    probability: dict[str, float]
    explained_share: float
    cross_validation: CrossValidation | None
    best: Fit | None = None
    mesh_change: float | None = None
    fails: tuple[str, ...] = ()
    open_set: float | None = None


def decide(search: Search, finer: Simulation | None = None) -> Decision:
    """Decide which effects of a search are named.

    Parameters
    ----------
    search : Search
    finer : Simulation, optional
        That on a finer mesh, by which the answer is corrected.

    Returns
    -------
    Decision

    Notes
    -----
    A name requires evidence above the threshold of the site, on the finer mesh too; beside other
    effects, that a receiver with an effect of its own is an outlier without it; a lead over every
    other label; predicted held-out records; little that remains unexplained; and a budget that
    sufficed for the other effects; and that it explains more of each large blast. A label whose
    score is above the evidence of the answer, but not that of its own fits, is a rival: the fits
    may have gone astray. An effect that these records cannot test
    (`Hypothesis.untestable`) is never named: all effects that explain much form its class. Where no
    record could be held out and a large blast is explained less, nothing supports the effect. Leads
    are measured on the one mesh on which all were fitted.
    """
    without = search.without_effects
    decision = undecided(search)
    probability, nothing = decision.probability, decision.outcome
    if not search.fits:
        return decision
    chosen, required = _pruned(search), search.required
    if not chosen.effects or search.delta_ln_evidence(chosen) < required:
        best = chosen if chosen.effects else None
        return Decision(nothing, without, (), probability, 0.0, None, best)
    case = search.scene.case
    untestable = any(effect.hypothesis.untestable(case) for effect in chosen.effects)
    rivals = _rivals(search, chosen, required if untestable else None)
    rivals = tuple(dict.fromkeys((*rivals, *_contradicted(search, chosen))))
    mesh_change = None
    if finer is not None:
        with contained(search.scene.failures, FINER_MESH):
            chosen, mesh_change = on_finer_mesh(search.scene, finer, chosen, search.progress)
    tested = cross_validate(search.scene, without, chosen)
    share = explained_share(without.chi_square, chosen.chi_square)
    fails = not_improved(search.scene, without, chosen)
    against = contradicted(tested, fails)
    open_set, elsewhere = None, ()
    with contained(search.scene.failures, OPEN_SET_TEST):
        open_set = open_set_ratio(search, chosen)
        elsewhere = body_explains_more(search, chosen)
    fails = (*not_fitted(chosen), *fails, *elsewhere)
    basis = (probability, share, tested, chosen, mesh_change, fails, open_set)
    if against or elsewhere or (open_set is not None and open_set < OPEN_SET):
        return Decision("UNKNOWN", without, (), *basis)
    more = more_remains(chosen.chi_square, share) or search.scored_beside(chosen)
    alone = untestable and len(rivals) == 1
    if search.delta_ln_evidence(chosen) < required or FINER_MESH in search.scene.failures:
        rivals = tuple(dict.fromkeys((*chosen.labels, *rivals, RESOLUTION)))
    tried = search.compared and (search.finished or len(chosen.labels) == 1)
    if more or alone or fails or not (tried and _each_is_tested(search, chosen, tested)):
        return Decision("PARTIAL", chosen, rivals, *basis)
    outcome = "CLASS" if len(rivals) > 1 else "NAMED" if len(chosen.labels) == 1 else "COMPOSITE"
    return Decision(outcome, chosen, rivals, *basis)


def contradicted(tested: CrossValidation, fails: tuple[str, ...]) -> bool:
    """Tell whether records contradict an effect: those held out, else a large blast.

    Parameters
    ----------
    tested : CrossValidation
    fails : tuple of str
        As of `not_improved`.

    Examples
    --------
    >>> contradicted(CrossValidation((), {}), ())
    False
    >>> contradicted(CrossValidation((), {}), ("blast B1: more of its energy remains",))
    True
    """
    return not tested.supports or bool(fails and not tested.subsets)


def open_set_ratio(search: Search, chosen: Fit) -> float | None:
    """Return the evidence of a fit over that of unrestricted secondary sources in its place.

    None where these explain no more than the threshold of the site. A cause outside of the library
    is explained by sources anywhere in the ground, and by no class of it.

    Raises
    ------
    InputError, SolverError
        If secondary sources can't be computed.
    """
    if search.scores is None:
        return None
    without, scores = search.without_effects, search.scores
    residual = scores.residual(without.motion, without.values)
    free = unrestricted(scores.at_fit(without).error, sources_anywhere(search.scene), residual)
    return None if free < search.required else search.delta_ln_evidence(chosen) / free


def sources_anywhere(scene: Scene) -> list[tuple[Places, float]]:
    """Return all cells of rock and patches of joints of a scene, and the spread of their changes.

    Over that of rock; rock comes first.

    Raises
    ------
    InputError, SolverError
        If secondary sources can't be computed.
    """
    rock, joints = scene.secondary_places
    return [(rock, 1.0), *([(joints, SPRINGS)] if len(joints.sizes) else [])]


def body_explains_more(search: Search, chosen: Fit) -> tuple[str, ...]:
    """Return a sentence where a change of the rock at one place has more evidence, by `LEAD`.

    More than a fit; none where the library knows better, as a body was fitted by runs.

    Raises
    ------
    InputError, SolverError
        If secondary sources can't be computed.
    """
    if search.scores is None or any("body" in fitted.labels for fitted in search.fits):
        return ()
    evidence = search.delta_ln_evidence(chosen)
    alone = search.body_beside(search.without_effects)
    if alone.score <= evidence + LEAD:
        return ()
    return (
        f"a change of the rock at one place alone has the Δ ln evidence {alone.score:.0f}, "
        f"{' + '.join(chosen.labels)} {evidence:.0f}",
    )


def undecided(search: Search) -> Decision:
    """Return the decision on a search from which nothing can be concluded about effects.

    Records that could test no effect of the library don't show that none is there.
    """
    without = search.without_effects
    scored = search.scored_beside(without)
    far = np.max(np.abs(without.values / search.scene.baseline.sigma), initial=0.0) > FAR_OFF
    open_ = search.scores is None or scored or far or material(without.chi_square)
    return Decision("UNKNOWN" if open_ else "NULL", without, (), _probabilities(search), 0.0, None)


def beside_held_out(decision: Decision, held_out: dict | None) -> Decision:
    """Return a decision that is PARTIAL where a named model explains held-out blasts less.

    Parameters
    ----------
    decision : Decision
    held_out : dict or None
        ``explained_before`` and ``explained_after`` the effects, by blasts that were held out.
    """
    if held_out is None or decision.outcome not in ("NAMED", "CLASS", "COMPOSITE"):
        return decision
    before, after = held_out["explained_before"], held_out["explained_after"]
    if not after < before:
        return decision
    failure = (
        f"held-out {', '.join(held_out['blasts'])}: {100.0 * after:.1f} % of the energy are "
        f"predicted, {100.0 * before:.1f} % without the effect"
    )
    return replace(decision, outcome="PARTIAL", fails=(*decision.fails, failure))


def explained_share(before, after) -> float:
    """Return the share of all excess above the usual errors that is gone with other chi-squares.

    Records below one do not compensate for others.
    """
    total, rest = (float(np.sum(np.maximum(each - 1.0, 0.0))) for each in (before, after))
    return (total - rest) / total if total > 0.0 else 0.0


def more_remains(chi_square, share) -> bool:
    """Tell whether something else is missing, by chi-squares and the explained share."""
    return worst(chi_square) >= REMAINS and share < MOST_EXPLAINED


def on_finer_mesh(
    scene: Scene, finer: Simulation, fit: Fit, progress: Callable = lambda *_: None
) -> tuple[Fit, float | None]:
    """Correct a fit for the error of the mesh, by runs of its site on a finer one.

    Parameters
    ----------
    scene : Scene
    finer : Simulation
        That on the finer mesh.
    fit : Fit
        Its effects on the site and calibrated values are run; all holes fire as planned.
    progress : callable, optional
        Called with (stage, done, total).

    Returns
    -------
    fit : Fit
        Unchanged if the change is less than `MESH_CHANGE`, first in the blast that the effects
        change most, then in all.
    change : float or None
        Largest mean chi-square of the change at a receiver or blast, beyond what the correction of
        all runs covers. None if no effect is on the site, and for anisotropic ground, which has
        its own kind of zones.

    Raises
    ------
    SolverError
        If a run fails.
    """
    project, over_usual = scene.project(fit.values, fit.effects), scene.baseline.over_usual
    if project is None or not fit.on_site or is_anisotropic(project.materials):
        return fit, None
    (simulated,) = scene.simulate([(fit.values, fit.effects)])
    if simulated is None:
        return fit, None
    change = over_usual(simulated - scene.baseline.reference)
    largest, *others = (int(b) for b in np.argsort(-change.sum(axis=1), kind="stable"))
    shift, size = np.zeros_like(simulated), 0.0
    for done, blasts in enumerate(([largest], others)):
        progress("a finer mesh", done, len(shift))
        if blasts:
            names = [scene.case.blasts[b] for b in blasts]
            motion = scene.carried(fit.values, fit.effects, blasts, finer.motion(project, names))
            shift[blasts] = motion - simulated[blasts]
        size = worst(over_usual(shift))
        if size < MESH_CHANGE:
            return fit, size
    return corrected(scene, fit, shift), size


def intervals(fit: Fit) -> list[dict]:
    """Return the parameters of each effect with their 90 % intervals.

    Model errors repeat in each blast of a site, so that all blasts count as one; (14.9). An
    interval covers the alternative modes of a fit, too.

    Returns
    -------
    list of dict
        One for each effect, by parameter: ``value``, ``low``, ``high`` and ``unit``, a list of
        these for a parameter of each hole.
    """
    ends = np.array([_ends(mode) for mode in (fit, *fit.alternatives)])
    lows, highs = iter(ends[:, 0].min(axis=0)), iter(ends[:, 1].max(axis=0))
    tables = []
    for effect in fit.effects:
        table = {}
        for parameter, values in zip(effect.hypothesis.parameters, effect.values, strict=True):
            rows = [
                {"value": value, "low": float(next(lows)), "high": float(next(highs)),
                 "unit": parameter.unit}
                for value in values
            ]  # fmt: skip
            table[parameter.name] = rows if parameter.per_hole else rows[0]
        tables.append(table)
    return tables


def wide_covariance(fit: Fit) -> np.ndarray:
    """Return the posterior covariance (n, n) of standardised parameters, all blasts as one.

    No variance exceeds that of the prior; (14.9).
    """
    own = fit.posterior.covariance
    variance = np.maximum(np.diag(own), np.finfo(float).tiny)
    blasts = np.count_nonzero(fit.chi_square.any(axis=1))
    factor = np.sqrt(np.minimum(blasts * variance, 1.0) / variance)
    return own * np.outer(factor, factor)


def covariance_of_rows(fit: Fit) -> np.ndarray:
    """Return that of the effects on holes of the whole site, parameters in their order."""
    rows = of_all_holes(fit.effects)
    own = [len(fit.values) * [False]]
    own += [[e in rows] * sum(map(len, e.values)) for e in fit.effects]
    at = np.flatnonzero(np.concatenate(own))
    return wide_covariance(fit)[np.ix_(at, at)]


def _ends(fit):
    """Return the lower and upper ends (2, n_parameters) of 90 % intervals of one mode."""
    half = HALF_WIDTH * np.sqrt(np.diag(wide_covariance(fit)))
    lower, upper = (x[len(fit.values) :] for x in (fit.state.x - half, fit.state.x + half))
    parameters = [
        parameter for effect in fit.effects
        for parameter, values in zip(effect.hypothesis.parameters, effect.values, strict=True)
        for _ in values
    ]  # fmt: skip
    return [
        [np.clip(p.value(x), p.low, p.high) for p, x in zip(parameters, end, strict=True)]
        for end in (lower, upper)
    ]


def _pruned(search):
    """Drop effects, one by one, whose own evidence or held-out prediction does not suffice."""
    chosen = search.chosen or search.without_effects
    while len(chosen.labels) > 1:
        shorter = [(_without(search, chosen, label), label) for label in chosen.labels]
        as_good = [
            base for base, label in shorter
            if base is not None and not (
                search.delta_ln_evidence(chosen) - search.delta_ln_evidence(base)
                >= search.required
                and cross_validate(search.scene, base, chosen).supports
                and _stands_out(search.scene.case.receivers, base, chosen, label)
            )
        ]  # fmt: skip
        if not as_good:
            break
        chosen = max(as_good, key=search.delta_ln_evidence)
    return chosen


def _stands_out(receivers, base, chosen, label):
    """Tell whether receivers with an effect of their own are outliers among all without it.

    Errors of the ground repeat in each blast, so that an effect at any one receiver takes up its
    share of what the other effects leave everywhere. Grubbs' test (Technometrics 11, 1969), as the
    deleted t statistic of the logarithm of chi-square plus one, that of the assumed errors.
    """
    own = [e for e in chosen.effects if e.label == label and e.hypothesis.axis == "blasts"]
    alone = np.isin(receivers, [effect.target for effect in own])
    if not alone.any():
        return True
    size = np.log1p(base.chi_square.mean(axis=0))
    least, others = size[alone].min(), size[~alone]
    if len(others) < 2:
        return False
    error = others.std(ddof=1) * np.sqrt(1.0 + 1.0 / len(others))
    most = stats.t.isf((1.0 - OUTLIER_LEVEL) / len(size), len(others) - 1)
    return bool(least - others.mean() > most * error)


def _each_is_tested(search, chosen, tested):
    """Tell whether records could be held out to test each effect of a set."""
    if len(chosen.labels) == 1:
        return bool(tested.subsets)
    shorter = [_without(search, chosen, label) for label in chosen.labels]
    return all(
        base is None or cross_validate(search.scene, base, chosen).subsets for base in shorter
    )


def _without(search, chosen, label):
    """Return the fit of a set without one label, of the search or new."""
    effects = tuple(effect for effect in chosen.effects if effect.label != label)
    where = frozenset(effect.where for effect in effects)
    known = next((known for known in search.fits if known.where == where), None)
    if known is None:
        with search.scene.contained(effects):
            known = fit(search.scene, effects, chosen.values)
    return known


def _rivals(search, chosen, least=None):
    """Return the labels of fits whose evidence is near that of a set, or above ``least``."""
    if least is None:
        least = search.delta_ln_evidence(chosen) - LEAD
    same = [known for known in search.fits if len(known.labels) == len(chosen.labels)]
    near = [known for known in same if search.delta_ln_evidence(known) > least]
    others = [label for known in near for label in known.labels if label not in chosen.labels]
    return (*chosen.labels, *dict.fromkeys(others)) if others else chosen.labels[:1]


def _contradicted(search, chosen):
    """Return other labels that score as much as a set, whose fits gained much less, or are none."""
    least = search.delta_ln_evidence(chosen) - LEAD
    known = {label for fitted in search.fits for label in fitted.labels}
    rows = {label: score for label, score in search.classes().items() if label not in known}
    rows |= {label: score for label, (score, _) in search.contradicted.items()}
    return [label for label, score in rows.items() if score > least and label not in chosen.labels]


def _probabilities(search):
    """Return the posterior probability of each label, of "none" and of "unknown".

    The latter is a larger error than that of good ground (`USUAL_LEVEL`), without an effect. Model
    errors repeat in each blast of a site, so that all blasts count as one: theory.md (14.8).
    """
    without = search.without_effects
    above = without.posterior.evidences[:, 0] > USUAL_LEVEL
    sets = [
        ((label,), _averaged(without.posterior.evidences[chosen, 1]) - without.log_evidence)
        for label, chosen in (("none", ~above), ("unknown", above))
    ]
    sets += [(fitted.labels, search.delta_ln_evidence(fitted)) for fitted in search.fits]
    evidence = np.array([value for _, value in sets]) / len(search.scene.case.blasts)
    probability = np.exp(evidence - logsumexp(evidence))
    by_label = {}
    for (labels, _), value in zip(sets, probability, strict=True):
        for label in labels:
            by_label[label] = by_label.get(label, 0.0) + float(value)
    return {label: round(value, 4) for label, value in by_label.items()}


def _averaged(log_evidences):
    """Return the logarithm of the mean of evidences."""
    return float(logsumexp(log_evidences) - np.log(len(log_evidences)))
