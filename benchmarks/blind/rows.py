"""One case scored: what was true beside what was said."""

import json
from pathlib import Path

import numpy as np

from pyblast.diagnosis.search import MATERIAL
from pyblast.projects.result import write_text

from .plan import FAMILY, NULLS
from .right_model import motion_of, reductions, right
from .sealing import opened

LABELS = (*FAMILY, "none", "unknown")
# That physics of the library is missing; a crash is no better.
CLAIMS = ("NAMED", "COMPOSITE", "CLASS", "CRASH")
NAMES = ("NAMED", "COMPOSITE")
NEAR = 20.0  # m, within which a plane is found: a third of a wave of the middle of the band
LEAST_ROOM = 0.02  # of energy between the baseline and the right model, below which gain is none
# Which unseen records a family can foretell: those of other blasts, of other receivers, of both.
UNSEEN = {"source": ("receivers",), "instrument": ("blasts",)}


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
        told = {**(said.get("foretold") or {}), "right": known["foretold"]}
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
        ``length`` of the effects and shares of unseen energy that were foretold ``before``,
        ``after`` and by the ``right`` model; each a dict by "blasts" and "receivers".

    Returns
    -------
    dict
    """
    measured = measured or {}
    true = [one["label"] for one in truth["effects"] if one["label"] in FAMILY]
    said = [one["label"] for one in answer.get("effects", [])]
    outcome, kin = answer["outcome"], answer.get("class") or []
    named = said if outcome in NAMES else []
    evidence = answer.get("evidence") or {}
    first = (evidence.get("ranking") or [{"labels": []}])[0]["labels"]
    probability = evidence.get("probability") or {}
    return {
        "case": truth["case"], "block": truth["block"], "level": truth["level"],
        "true": [one["label"] for one in truth["effects"]], "outcome": outcome, "said": said,
        "named": named, "length": measured.get("length"), "share": truth["share"],
        "alarm": outcome in CLAIMS,
        "beyond": (evidence.get("at_twice_the_errors") or 0.0) >= MATERIAL,
        "right_name": bool(named) and set(named) <= set(true),
        "some": any(label in true for label in named),
        "all": bool(true) and set(true) <= set(named) and set(named) <= set(true),
        "held": any(label in true for label in (*named, *kin)),
        "ranked": any(label in true for label in first),
        "family": _family(true, named or kin),
        "located": _located(truth, answer) if named else None,
        "covered": _covered(truth, answer) if named else [],
        "metres": _metres(truth, answer) if named else None,
        "gain": _gain(true, measured), "brier": _brier(truth, true, probability),
        "confidence": max(probability.values(), default=None),
        "sure_right": _sure_right(truth, true, probability),
        "worst": (answer.get("located") or {}).get("largest"),
        "lead": _lead(evidence), "leader_right": bool(first) and set(first) <= set(true),
        "runs": answer.get("runs"), "cpu_s": answer.get("cpu_s"),
        "code": answer.get("code"),
        "null": truth["block"] in NULLS,
    }  # fmt: skip


def _family(true, labels):
    """Tell whether all labels that were given are of families of true effects."""
    families = {FAMILY[label] for label in true}
    return bool(labels) and {FAMILY.get(label) for label in labels} <= families


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
            for name in set(table) & set(true["parameters"]):
                pairs = zip(np.atleast_1d(table[name]), np.atleast_1d(true["parameters"][name]),
                            strict=True)  # fmt: skip
                found += [bool(said["low"] <= value <= said["high"]) for said, value in pairs]
    return found


def _gain(true, measured):
    """Return the gain on unseen records over that of the right model."""
    if not true or measured.get("right") is None or measured.get("after") is None:
        return None
    kinds = [UNSEEN.get(FAMILY[label], ("blasts", "receivers")) for label in true]
    each = sorted({kind for some in kinds for kind in some})
    before, after, right = (
        np.mean([measured[key][kind] for kind in each]) for key in ("before", "after", "right")
    )
    room = right - before
    return float((after - before) / room) if room > LEAST_ROOM else None


def _wanted(truth, true):
    """Return the word that should be certain."""
    if true:
        return true[0]
    return "unknown" if truth["effects"] else "none"


def _brier(truth, true, probability):
    """Return the squared distance of the probabilities from what is true, of single effects."""
    if not probability or len(true) > 1:
        return None
    wanted = _wanted(truth, true)
    return float(sum((probability.get(one, 0.0) - (one == wanted)) ** 2 for one in LABELS))


def _sure_right(truth, true, probability):
    """Tell whether the most probable label is true."""
    if not probability or len(true) > 1:
        return None
    return max(probability, key=probability.get) == _wanted(truth, true)


def _lead(evidence):
    """Return by how much the best effect exceeds what chance finds, nats."""
    if evidence.get("best") is None or evidence.get("threshold") is None:
        return None
    return float(evidence["best"] - evidence["threshold"])
