"""Decision of a diagnosis: outcome and named effects, controlled on a finer mesh."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from ..project.flat_box import is_anisotropic
from .cross_validation import HeldOut, held_out
from .effects import Scene
from .fitting import Fit, corrected, fit
from .forward import Forward
from .null_distribution import Chance
from .search import Search, material, worst
from .thresholds import DECISIVE, MESH_CHANGE, MOST_EXPLAINED, PARTIAL_SHARE, REMAINS

RESOLUTION = "numerical_resolution"  # a label as those of the library, but for having no knob
CLAIM = "On a finer mesh this answer has no more evidence than chance would find."
SETTLED_BY = "shorter zones (`cuts` of `pyblast.workflows.diagnose`) until the answer stays"


def on_finer_mesh(
    scene: Scene, fine: Forward, fit: Fit, tell: Callable = lambda *_: None
) -> tuple[Fit, float | None]:
    """Run a fitted site on the finer mesh, and correct the fit if that changes it.

    Parameters
    ----------
    scene : Scene
    fine : Forward
        With the finer mesh.
    fit : Fit
        Its effects on the site and values of the site count; all holes fire as planned.
    tell : callable, optional
        Called with (stage, done, total).

    Returns
    -------
    fit : Fit
        The same where the change is less than `MESH_CHANGE`, first in the blast that the effects
        change most, then in all.
    change : float or None
        Beyond what corrects all runs, at the worst receiver or blast: mean square in errors of
        the theory and noise. None where nothing else is sent than from the calibrated site, and
        for anisotropic ground, which has zones of its own.
    """
    project, likelihood = scene.project(fit.values, fit.effects), scene.baseline.likelihood
    if is_anisotropic(project.materials) or all(e.hypothesis.on != "site" for e in fit.effects):
        return fit, None
    (sent,) = scene.sent([(fit.values, fit.effects)])
    each = likelihood.chi_square(likelihood.whiten(sent - scene.baseline.reference)).sum(axis=1)
    most, *others = (int(b) for b in np.argsort(-each, kind="stable"))
    shift = np.zeros_like(sent)
    for done, blasts in enumerate(([most], others)):
        tell("a finer mesh", done, len(shift))
        heard = fine.heard([(project, scene.case.blasts[b]) for b in blasts])
        for b, motion in zip(blasts, heard, strict=True):
            shift[b] = motion - sent[b]
        change = worst(likelihood.chi_square(likelihood.whiten(shift)))
        if change < MESH_CHANGE:
            return fit, change
    return corrected(scene, fit, shift), change


HALF = 1.645  # standard deviations on either side of the middle of a 90 % interval
OUTCOMES = ("NULL", "NAMED", "CLASS", "COMPOSITE", "PARTIAL", "UNKNOWN")


@dataclass(frozen=True, eq=False)
class Verdict:
    """One outcome and what it rests on.

    Parameters
    ----------
    outcome : str
        Of `OUTCOMES`.
    fit : Fit
        The best model: that of the calibrated site for NULL and UNKNOWN.
    rivals : tuple of str
        Labels that these data can't tell from the one that was found, that one first.
    probability : dict of str to float
        By label, "none", or "unknown": errors larger than supposed, of all records, one blast or
        one receiver.
    share : float
        Of the energy in excess that the best set of effects explains.
    held_out : HeldOut or None
    judged : Fit or None
        The best set of effects, named or not, on the finer mesh if that changes it; None where
        none paid.
    mesh : float or None
        What a finer mesh changes of the best model with effects, see `on_finer_mesh`; None where
        it was not run.
    """

    outcome: str
    fit: Fit
    rivals: tuple[str, ...]
    probability: dict
    share: float
    held_out: HeldOut | None
    judged: Fit | None = None
    mesh: float | None = None


def judge(found: Search, threshold: Chance, fine: Forward | None = None) -> Verdict:
    """Judge a search.

    Parameters
    ----------
    found : Search
    threshold : Chance or None
        None where no effect was tried.
    fine : Forward, optional
        With a finer mesh, which runs what was found.

    Returns
    -------
    Verdict

    Notes
    -----
    A name needs more evidence than chance finds, on the finer mesh too, a lead over every other
    label, records foretold that it was not fitted to, and little left over that it can't explain;
    and none is given where the budget ended before the others were tried. What these records
    can't test, see `Hypothesis.untestable`, gets no name: all others that explain much are its
    class. Leads are those on the one mesh that all were fitted on.
    """
    probability, none = _probabilities(found), found.none
    if not material(none.chi_square):
        return Verdict("NULL", none, (), probability, 0.0, None)
    if not found.fits:
        return Verdict("UNKNOWN", none, (), probability, 0.0, None)
    chosen = _pruned(found, threshold)
    least = _least(threshold, chosen, *chosen.labels)
    if not chosen.effects or found.worth(chosen) < least:
        judged = chosen if chosen.effects else None
        return Verdict("UNKNOWN", none, (), probability, 0.0, None, judged)
    case = found.scene.case
    untestable = any(effect.hypothesis.untestable(case) for effect in chosen.effects)
    rivals = _rivals(found, chosen, least if untestable else None)
    mesh = None
    if fine is not None:
        chosen, mesh = on_finer_mesh(found.scene, fine, chosen, found.tell)
    proof = held_out(found.scene, none, chosen)
    share = found.scene.baseline.likelihood.explained_share(none.chi_square, chosen.chi_square)
    if not proof.bears or share < PARTIAL_SHARE:
        return Verdict("UNKNOWN", none, (), probability, share, proof, chosen, mesh)
    more = more_remains(chosen.chi_square, share)
    alone = untestable and len(rivals) == 1
    if found.worth(chosen) < least:
        rivals = tuple(dict.fromkeys((*chosen.labels, *rivals, RESOLUTION)))
    tried = found.compared and (found.finished or len(chosen.labels) == 1)
    if more or alone or not (tried and _proven(found, chosen, proof)):
        return Verdict("PARTIAL", chosen, rivals, probability, share, proof, chosen, mesh)
    outcome = "CLASS" if len(rivals) > 1 else "NAMED" if len(chosen.labels) == 1 else "COMPOSITE"
    return Verdict(outcome, chosen, rivals, probability, share, proof, chosen, mesh)


def more_remains(size, share) -> bool:
    """Tell whether something is missing beside effects that leave sizes and explain a share."""
    return worst(size) >= REMAINS and share < MOST_EXPLAINED


def intervals(fit: Fit) -> list[dict]:
    """Return the knobs of each effect with their 90 % intervals, in their units.

    Errors of a site come back in each of its blasts: all blasts tell as much as one; (14.9).
    Where twins of a fit lie elsewhere, an interval holds theirs, too.
    """
    ends = np.array([_ends(one) for one in (fit, *fit.alternatives)])
    lows, highs = iter(ends[:, 0].min(axis=0)), iter(ends[:, 1].max(axis=0))
    tables = []
    for effect in fit.effects:
        table = {}
        for knob, values in zip(effect.hypothesis.parameters, effect.values, strict=True):
            each = [
                {"value": value, "low": float(next(lows)), "high": float(next(highs)),
                 "unit": knob.unit}
                for value in values
            ]  # fmt: skip
            table[knob.name] = each if knob.per_hole else each[0]
        tables.append(table)
    return tables


def _ends(fit):
    """Return the lower and upper ends (2, n_knobs) of 90 % intervals around one fit."""
    blasts = np.count_nonzero(fit.chi_square.any(axis=1))
    half = HALF * np.sqrt(blasts * np.diag(fit.covariance))
    lower, upper = (place[len(fit.values) :] for place in (fit.x - half, fit.x + half))
    knobs = [
        knob for effect in fit.effects
        for knob, values in zip(effect.hypothesis.parameters, effect.values, strict=True)
        for _ in values
    ]  # fmt: skip
    return [
        [np.clip(k.value(at), k.low, k.high) for k, at in zip(knobs, end, strict=True)]
        for end in (lower, upper)
    ]


def _pruned(found, threshold):
    """Drop effects, one by one, that bring less evidence than chance finds, or foretell nothing."""
    chosen = found.chosen
    while len(chosen.labels) > 1:
        shorter = [(_without(found, chosen, label), label) for label in chosen.labels]
        as_good = [
            one for one, label in shorter
            if one is not None and not (
                found.worth(chosen) - found.worth(one) >= _least(threshold, chosen, label)
                and held_out(found.scene, one, chosen).bears
            )
        ]  # fmt: skip
        if not as_good:
            break
        chosen = max(as_good, key=found.worth)
    return chosen


def _proven(found, chosen, proof):
    """Tell whether records could be left out to test each of a set of effects."""
    if len(chosen.labels) == 1:
        return bool(proof.folds)
    shorter = [_without(found, chosen, label) for label in chosen.labels]
    return all(one is None or held_out(found.scene, one, chosen).folds for one in shorter)


def _least(threshold, chosen, *labels):
    """Return the evidence, nats, that effects of a fit, of some labels, must bring."""
    some = [effect for effect in chosen.effects if effect.label in labels]
    return max(threshold.needed(some), DECISIVE)


def _without(found, chosen, label):
    """Return the fit of a set without one label, from those there are or anew."""
    left = tuple(effect for effect in chosen.effects if effect.label != label)
    wanted = frozenset(effect.where for effect in left)
    known = next((one for one in found.fits if one.where == wanted), None)
    return known or fit(found.scene, left, chosen.values)


def _rivals(found, chosen, least=None):
    """Return the labels that explain as much as the last effect of a set, or ``least`` nats."""
    same = [one for one in found.fits if len(one.labels) == len(chosen.labels)]
    least = found.worth(chosen) - DECISIVE if least is None else least
    near = [one for one in same if found.worth(one) > least]
    own = set(chosen.labels)
    others = [label for one in near for label in one.labels if label not in own]
    return (*chosen.labels, *dict.fromkeys(others)) if others else chosen.labels[:1]


def _probabilities(found):
    """Return the posterior probability of each label, alone or with others, and of none.

    Beside an effect, too, all errors may be larger than supposed. Errors of a site come back in
    each of its blasts, so that all blasts are worth one: theory.md (14.8).
    """
    scene = found.scene
    doubted = scene.baseline.likelihood.log_gain_of_larger_errors
    sets = [(("none",), 0.0), (("unknown",), doubted(found.none.chi_square))]
    sets += [(one.labels, found.worth(one) + doubted(one.chi_square)) for one in found.fits]
    worth = np.array([worth for _, worth in sets]) / len(scene.case.blasts)
    chance = np.exp(worth - logsumexp(worth))
    shares = {}
    for (labels, _), share in zip(sets, chance, strict=True):
        for label in labels:
            shares[label] = shares.get(label, 0.0) + float(share)
    return {label: round(share, 4) for label, share in shares.items()}
