"""A drawn case: diagnosed, asked for records that no fit has used, and only then compared."""

import time
from pathlib import Path

import numpy as np

from benchmarks.blind.case_files import read_asked
from benchmarks.blind.drawing import drawn, write_drawn
from benchmarks.blind.plan import FAMILY, Draw
from pyblast.diagnosis.effects import effects_of
from pyblast.diagnosis.hypotheses import blast_and_hole
from pyblast.files import write_summary
from pyblast.workflows.diagnose import diagnose

from .predictions import predictions, project_in
from .right_model import motion_of, reductions, right

NEAR = 20.0  # m, within which a plane is meant: a third of an S wave of the top of the band
CREEPING = "joint_creeping_fill"
TURN = 2.0 * np.pi  # rad, after which a parameter of that name is the same
NAMES = ("NAMED", "COMPOSITE", "MISTAKE")
BLAST_CLOCK = "time zero"  # a mistake that has no label of its own; the library has its effect


def answered(draw: Draw, store: Path) -> dict:
    """Draw the records of a case, diagnose them, and set the answer beside the truth.

    Parameters
    ----------
    draw : Draw
    store : path
        Keeps records and runs, so that a case that was stopped goes on, and the whole answer.

    Returns
    -------
    dict
        A row of the proof, see `row_of`.
    """
    case, name, runs = drawn(draw), draw.name, store / "runs" / draw.name
    write_drawn(case, store)
    began = time.process_time()
    made = diagnose(project_in(store, name), runs)
    spent = time.process_time() - began
    summary, asked = made.summary, read_asked(store / "asked" / name)
    (store / "answers").mkdir(exist_ok=True)
    write_summary(store / "answers" / f"{name}.json", summary)
    model = summary["model"]
    told = {"before": (model["baseline_values"], ()), "after": (model["values"], effects_of(model))}
    other = second_best(made.search.ranked(), made.decision.fit.labels)
    if other is not None:
        told["second"] = other.values, other.effects
    foretold = {
        key: predictions(made.scene.case, asked, values, effects, runs)
        for key, (values, effects) in told.items()
    }
    known = right(store, name, case.truth) if case.truth["effects"] else {}
    foretold["right"] = known.get("predicted")
    motion = motion_of(store, name)
    explained = {key: reductions(motion, each) for key, each in foretold.items() if each}
    share = float((store / "truth" / name / "share").read_text())
    row = row_of(case.truth, summary, explained)
    row["processor_s"] = round(spent + summary["kept_s"], 1)
    return row | {"energy": share, "length": known.get("length")}


def second_best(ranked, labels):
    """Return the fit of most evidence whose labels are others, as many; None where there is none.

    Parameters
    ----------
    ranked : sequence of Fit
        Best first.
    labels : sequence of str
        Of the answer; of one effect where it has none.
    """
    count = max(len(labels), 1)
    others = (fit for fit in ranked if len(fit.labels) == count and set(fit.labels) != set(labels))
    first = next(others, None)
    return first if labels else next(others, None)


def row_of(truth: dict, answer: dict, explained: dict) -> dict:
    """Set an answer beside the truth.

    Parameters
    ----------
    truth : dict
        As of `benchmarks.blind.drawing.drawn`.
    answer : dict
        As in ``diagnosis.json``.
    explained : dict
        Shares of the energy of records that no fit has used, ``before`` and ``after`` the
        diagnosis, by the ``second`` best effect and by the ``right`` model; each a dict by
        "blasts" and "receivers".

    Returns
    -------
    dict
        ``block``, ``truth``: labels; ``outcome``, ``named``: labels, ``class``; ``placed``: of each
        right name whether it stands where the effect is, and nowhere else; ``metres`` that a plane
        is off, ``covered``: of each parameter with a truth whether its 90 % interval holds
        it, ``held_out``: shares by model, means over the records in which the effects are.
    """
    labels = [part["label"] for part in truth["effects"]]
    named = names_of(answer)
    kinds = sorted({kind for part in truth["effects"] for kind in _unseen(part)})
    return {
        "block": truth["block"], "truth": labels, "outcome": answer["outcome"], "named": named,
        "class": answer["class"], "placed": _placed(truth, answer),
        "metres": _metres(truth, answer) if named else None,
        "covered": _covered(truth, answer) if named else [],
        "held_out": {
            key: round(float(np.mean([share[kind] for kind in kinds or share])), 5)
            for key, share in explained.items()
        },
    }  # fmt: skip


def named_parts(answer: dict) -> list[dict]:
    """Return the mistakes and effects that an answer names, each with a label.

    A mistake that is no effect of the library has its kind as label.
    """
    if answer["outcome"] not in NAMES:
        return []
    mistakes = [one | {"label": _label(one)} for one in answer.get("mistakes", [])]
    effects = [part for part in answer["effects"] if part["label"] and part.get("named", True)]
    return mistakes + effects


def _label(mistake):
    """Return the label of a mistake, or its kind where it is no effect of the library."""
    return "clock_error" if mistake["kind"] == BLAST_CLOCK else mistake["label"] or mistake["kind"]


def names_of(answer: dict) -> list[str]:
    """Return the labels that an answer names, mistakes first."""
    return [part["label"] for part in named_parts(answer)]


def _placed(truth, answer):
    """Return for each right name whether all its places are true ones."""
    placed = []
    for one in named_parts(answer):
        wanted = [true["target"] for true in truth["effects"] if true["label"] == one["label"]]
        targets = [one["target"]] if isinstance(one["target"], str) else one["target"]
        if wanted:
            placed.append(all(
                any(_there(place, target, one) for place in wanted) for target in targets
            ))  # fmt: skip
    return placed


def _there(wanted, target, one):
    """Tell whether a place is the wanted one, a hole of it, or a plane near it; "" is anywhere."""
    same = wanted in ("", blast_and_hole(target)[0])
    return same or _nearest(wanted, [target], one) is not None


def _metres(truth, answer):
    """Return how far the plane of a joint that was rightly named is off, or None."""
    known = {one["label"]: one["target"] for one in truth["effects"] if "=" in one["target"]}
    for one in answer["effects"]:
        if one["label"] in known:
            targets = one["target"] if isinstance(one["target"], list) else [one["target"]]
            far = min(_off(known[one["label"]], target, one) for target in targets)
            return far if np.isfinite(far) else None
    return None


def _off(wanted, target, one):
    """Return how far a plane is off, m."""
    if target[:2] != wanted[:2]:
        return np.inf
    offset = _parameters(one, target).get("offset", {"value": 0.0})["value"]
    return abs(float(target[2:]) + offset - float(wanted[2:]))


def _nearest(wanted, targets, one):
    """Return which target of an effect is meant: the same, or the nearest plane; or None."""
    if "=" not in wanted:
        return wanted if wanted in targets else None
    near = [target for target in targets if "=" in target and _off(wanted, target, one) <= NEAR]
    return min(near, key=lambda target: _off(wanted, target, one), default=None)


def _parameters(one, target):
    """Return the parameters of an effect at one of its places."""
    table = one["parameters"]
    return table if isinstance(one["target"], str) else table[target]


def _covered(truth, answer):
    """Return for each parameter that both sides know whether its 90 % interval holds the truth."""
    found = []
    for true in truth["effects"]:
        for one in answer["effects"]:
            targets = one["target"] if isinstance(one["target"], list) else [one["target"]]
            target = _nearest(true["target"], targets, one)
            if one["label"] != true["label"] or target is None:
                continue
            table = _parameters(one, target)
            for name in (set(table) & set(true["parameters"])) - _loose(true, target, answer):
                pairs = zip(np.atleast_1d(table[name]), np.atleast_1d(true["parameters"][name]),
                            strict=True)  # fmt: skip
                ways = (0.0, TURN, -TURN) if name == "turn" else (0.0,)
                found += [
                    any(said["low"] <= value + way <= said["high"] for way in ways)
                    for said, value in pairs
                ]
    return found


def _loose(true, target, answer):
    """Return the drawn parameters that are not quite what the knobs of these names mean.

    A receiver was a little elsewhere before it was moved; soil is stiffer below its top; a fill
    that creeps relaxes in another sense.
    """
    if true["label"] == "wrong_coordinates" and target.startswith("R"):
        return {"east", "north"}
    forms = {one["name"] for one in answer["model"]["effects"] if one["target"] == target}
    return {"slower"} | ({"relaxation"} if CREEPING in forms else set())


def _unseen(one):
    """Return which unseen records an effect can be told from: those of blasts, of receivers.

    What belongs to a blast is in no other blast, what belongs to a receiver at no other receiver.
    """
    if FAMILY.get(one["label"]) == "source" or one["target"].startswith("B"):
        return ("receivers",)
    return ("blasts",) if one["target"].startswith("R") else ("blasts", "receivers")
