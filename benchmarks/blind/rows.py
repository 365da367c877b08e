"""One case scored: what was true beside what was said."""

import json
from pathlib import Path

import numpy as np

from pyblast.diagnosis.thresholds import DECISIVE
from pyblast.files import write_text

from .plan import FAMILY, NULLS
from .right_model import motion_of, reductions, right
from .sealing import opened

LABELS = (*FAMILY, "none", "unknown")
# That physics of the library is missing; a crash is no better.
CLAIMS = ("NAMED", "COMPOSITE", "CLASS", "CRASH", "MISTAKE")
NAMES = ("NAMED", "COMPOSITE", "MISTAKE")
NEAR = 20.0  # m, within which a plane is found: a third of an S wave of the top of the band
CREEPING = "joint_creeping_fill"
VISIBLE = 4.0  # d' below which an effect can't be seen
LEAST_ROOM = 0.02  # of energy between the baseline and the right model, below which gain is none
TURN = 2.0 * np.pi  # rad, after which a parameter of that name is the same


def scored(name: str, store: Path, seals: dict) -> dict:
    """Open one case and score it; fit the right model if there is one."""
    truth, said = opened(store, name, seals)
    measured = {}
    if truth["effects"]:
        kept = store / "right" / f"{name}.json"
        if not kept.exists():
            kept.parent.mkdir(parents=True, exist_ok=True)
            write_text(kept, json.dumps(right(store, name, truth)) + "\n")
        known, motion = json.loads(kept.read_text()), motion_of(store, name, truth)
        told = {**(said.get("predicted") or {}), "right": known["predicted"]}
        measured = {key: reductions(motion, one) for key, one in told.items() if one}
        measured["length"] = known["length"]
    return row_of(truth, said, measured)


def row_of(truth: dict, answer: dict, measured: dict | None = None) -> dict:
    """Score one case.

    Parameters
    ----------
    truth, answer : dict
        As sealed and as frozen.
    measured : dict, optional
        ``length`` of the effects and shares of unseen energy that were predicted ``before``,
        ``after`` and by the ``right`` model; each a dict by "blasts" and "receivers".

    Returns
    -------
    dict
    """
    measured = measured or {}
    true = [one["label"] for one in truth["effects"] if one["label"] in FAMILY]
    said = [o["label"] for key in ("mistakes", "effects") for o in answer.get(key, [])]
    outcome = answer["outcome"]
    kin = (answer.get("class") or []) if outcome == "CLASS" else []
    named = said if outcome in NAMES else []
    evidence = answer.get("evidence") or {}
    judged = evidence.get("best_labels") or []
    single = [one["labels"] for one in evidence.get("ranking") or [] if len(one["labels"]) == 1]
    probability = evidence.get("probability") or {}
    length = measured.get("length")
    wanted = _wanted(truth, true, length)
    return {
        "case": truth["case"], "block": truth["block"], "level": truth["level"],
        "true": [one["label"] for one in truth["effects"]], "outcome": outcome, "said": said,
        "named": named, "length": length, "share": truth["share"],
        "alarm": outcome in CLAIMS,
        "right_name": bool(named) and set(named) <= set(true),
        "some": any(label in true for label in named),
        "all": bool(true) and set(true) <= set(named) and set(named) <= set(true),
        "held": any(label in true for label in (*named, *kin)),
        "ranked": bool(single) and single[0][0] in true,
        "family": _family(true, named or kin),
        "located": _located(truth, answer) if named else None,
        "covered": _covered(truth, answer) if named else [],
        "metres": _metres(truth, answer) if named else None,
        "gain": _gain(truth, true, measured), "brier": _brier(wanted, probability),
        "confidence": max(probability.values(), default=None),
        "sure_right": _sure_right(wanted, probability),
        "worst": (answer.get("located") or {}).get("largest_chi_square"),
        "lead": _lead(evidence), "leader_right": bool(judged) and set(judged) <= set(true),
        "runs": answer.get("runs"), "cpu_s": answer.get("cpu_s"),
        "code": answer.get("code"),
        "null": truth["block"] in NULLS,
    }  # fmt: skip


def _family(true, labels):
    """Tell whether all labels that were given are of families of true effects."""
    families = {FAMILY[label] for label in true}
    known = {FAMILY[label] for label in labels if label in FAMILY}
    return bool(known) and known <= families


def _located(truth, answer):
    """Tell whether each effect that was rightly named is at its place; None where it has none."""
    known, found = {one["label"]: one["target"] for one in truth["effects"]}, []
    for one in answer["effects"]:
        wanted = known.get(one["label"], "")
        if not wanted:
            continue
        targets = one["target"] if isinstance(one["target"], list) else [one["target"]]
        if "=" in wanted:
            near = [_off(wanted, target, one) for target in targets]
            found.append(min(near) <= NEAR)
        else:
            found.append(targets == [wanted])
    return all(found) if found else None


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


def _gain(truth, true, measured):
    """Return the gain on unseen records over that of the right model."""
    if not true or measured.get("right") is None or measured.get("after") is None:
        return None
    each = sorted({kind for one in truth["effects"] for kind in _unseen(one)})
    before, after, right = (
        np.mean([measured[key][kind] for kind in each]) for key in ("before", "after", "right")
    )
    room = right - before
    return float((after - before) / room) if room > LEAST_ROOM else None


def _unseen(one):
    """Return which unseen records an effect can be told from: those of blasts, of receivers.

    What belongs to a blast is in no other blast, what belongs to a receiver at no other receiver.
    """
    if FAMILY[one["label"]] == "source" or one["target"].startswith("B"):
        return ("receivers",)
    return ("blasts",) if one["target"].startswith("R") else ("blasts", "receivers")


def _wanted(truth, true, length):
    """Return the word that should be certain; None where more than one would do.

    That is so of several effects, of hard nulls, whose errors are larger than supposed, and of
    records that can test nothing. What is too short to be seen is nothing.
    """
    if len(true) > 1 or truth["block"] in ("hard null", "poor"):
        return None
    if true:
        return "none" if length is not None and length < VISIBLE else true[0]
    return "unknown" if truth["effects"] else "none"


def _brier(wanted, probability):
    """Return half the squared distance of the probabilities from what is true."""
    if not probability or wanted is None:
        return None
    return 0.5 * float(sum((probability.get(one, 0.0) - (one == wanted)) ** 2 for one in LABELS))


def _sure_right(wanted, probability):
    """Tell whether the most probable word is true."""
    if not probability or wanted is None:
        return None
    return max(probability, key=probability.get) == wanted


def _lead(evidence):
    """Return by how much what was judged exceeds what it must, difference of ln evidence."""
    if evidence.get("delta_ln_evidence") is None or evidence.get("null_threshold") is None:
        return None
    return float(evidence["delta_ln_evidence"] - max(evidence["null_threshold"], DECISIVE))
