"""A diagnosis as a table that people and programs read: diagnosis.json."""

import numpy as np

from .fitting import GROWS
from .hypotheses import LIBRARY, untestable_labels
from .locating import located
from .mesh_control import RESOLUTION, SETTLED_BY
from .search import MATERIAL, worst
from .targets import blast_and_hole
from .verdict import intervals
from .visible import visible

NOT_ASKED = {"topography": "the description of the site has no surface to compare with a plane"}
UNSURE = "CLASS", "PARTIAL", "UNKNOWN"  # outcomes that a forecast should not rest on
VISIBLE = 4.0  # length of an effect in units of its errors, below which it can't be seen


def summarise(scene, found, shuffled, verdict) -> dict:
    """Return what ``diagnosis.json`` says.

    Parameters
    ----------
    scene : Scene
    found : Search
    shuffled : Chance or None
    verdict : Verdict

    Returns
    -------
    dict
    """
    baseline, none = scene.baseline, found.none
    remainder = located(baseline, verdict.fit.motion, verdict.fit.size)
    return {
        "outcome": verdict.outcome,
        "effects": _effects(verdict),
        "class": list(verdict.rivals) if len(verdict.rivals) > 1 else [],
        "not_testable": _not_testable(scene, found),
        "smallest_visible": visible(
            scene, verdict.fit, max(GROWS, 0.0 if shuffled is None else shuffled.needed(()))
        ),
        "located": located(baseline, none.motion, none.size),
        "remainder": remainder,
        "evidence": _evidence(scene, found, shuffled, verdict),
        "held_out": _held_out(verdict.held_out),
        "numerics": {
            "finer_mesh_changes": round(
                float(np.sum(baseline.correction**2) / np.sum(scene.case.motion**2)), 4
            ),
            "finer_mesh_changes_answer": None if verdict.mesh is None else round(verdict.mesh, 2),
        },
        "hygiene": {
            "dead": list(scene.case.dead),
            "unrecorded": [
                one.name for one in scene.case.site.receivers
                if one.name not in scene.case.receivers
            ],
            "left_out_share": round(float(np.mean(~scene.case.valid)), 4),
        },
        "next_measurement": _next(verdict, found, remainder),
        "calibration": [
            {"value": one.label, "factor": float(np.exp(v)), "pull": float(pull)}
            for one, v, pull in zip(
                baseline.unknowns, verdict.fit.values, verdict.fit.values / baseline.sigma,
                strict=True,
            )
        ],
        "model": {
            "values": verdict.fit.values.tolist(),
            "effects": [
                {"name": e.name, "target": e.target, "values": [list(v) for v in e.values]}
                for e in verdict.fit.effects
            ],
            "baseline_values": baseline.values.tolist(),
        },
    }  # fmt: skip


def _evidence(scene, found, shuffled, verdict):
    """Return what the best effects are worth, what chance finds, and all that was fitted."""
    ranked = found.ranked()
    best = verdict.judged or next(iter(ranked), None)
    effects = () if best is None else best.effects
    twice = scene.baseline.likelihood.doubled(found.none.size)
    return {
        "unit": "nats over the calibrated site",
        "best": None if best is None else round(found.worth(best), 1),
        "best_labels": [] if best is None else list(best.labels),
        "threshold": None if shuffled is None else round(shuffled.needed(effects), 1),
        "threshold_interval": None if shuffled is None else shuffled.interval(effects),
        "explained_share": round(verdict.share, 3),
        "at_twice_the_errors": round(worst(twice), 2),
        "ranking": [
            {"labels": list(one.labels), "targets": [e.target for e in one.effects],
             "worth": round(found.worth(one), 1), "misfit": round(one.misfit, 1)}
            for one in ranked
        ],
        "probability": verdict.probability,
    }  # fmt: skip


def _effects(verdict):
    """Return one entry for each label that is in the best model."""
    entries = {}
    for effect, table in zip(verdict.fit.effects, intervals(verdict.fit), strict=True):
        entry = entries.setdefault(
            effect.label,
            {
                "label": effect.label,
                "claim": effect.hypothesis.claim,
                "named": verdict.outcome in ("NAMED", "COMPOSITE"),
                "probability": verdict.probability.get(effect.label),
                "target": [],
                "parameters": {},
            },
        )
        target, hole = blast_and_hole(effect.target)
        place = target if target not in entry["target"] else effect.name
        entry["target"].append(target)
        entry["parameters"][place] = table | ({"hole": hole} if hole else {})
    for entry in entries.values():
        if len(entry["target"]) == 1:
            entry["parameters"] = entry["parameters"][entry["target"][0]]
            entry["target"] = entry["target"][0]
    return list(entries.values())


def _held_out(proof):
    """Return the folds as a table."""
    if proof is None:
        return None
    return {
        "gain": round(proof.gain, 1),
        "error": round(proof.error, 1) if np.isfinite(proof.error) else None,
        "improves": proof.improves,
        "variance_reduction_before": _mean([f.before for f in proof.folds]),
        "variance_reduction_after": _mean([f.after for f in proof.folds]),
        "folds": [vars(fold) for fold in proof.folds],
    }


def _mean(shares):
    """Return the mean of shares, None where there are none."""
    return float(np.mean(shares)) if shares else None


def _not_testable(scene, found):
    """Return labels that these records could not show, with the reason.

    First what they can't test whatever they hold, which was known before the search.
    """
    likelihood, reach = scene.baseline.likelihood, {}
    told = NOT_ASKED | untestable_labels(scene.case)
    for guess in found.guesses:
        size = likelihood.size(likelihood.white(guess.change))
        length = float(np.sqrt(np.sum(likelihood.freedom * size)))
        reach[guess.effect.label] = max(reach.get(guess.effect.label, 0.0), length)
    for label in dict.fromkeys(one.label for one in LIBRARY.values()):
        forms = [one for one in LIBRARY.values() if one.label == label]
        if label in told:
            continue
        if found.fits and all(one.on == "site" for one in forms) and label not in reach:
            ended = "the budget of runs ended before it"
            told[label] = "it can't be at this site" if found.finished else ended
        elif reach.get(label, np.inf) < VISIBLE:
            told[label] = (
                f"at its usual strength it changes these records by {reach[label]:.1f} times "
                f"their errors; {VISIBLE:g} are needed: larger charges or nearer receivers"
            )
    return [{"label": label, "reason": reason} for label, reason in told.items()]


def _next(verdict, found, remainder):
    """Return what to measure next; remains tell where, if no effect is worth a test of its own."""
    if verdict.outcome == "NULL":
        return "nothing; larger charges or nearer receivers would show smaller effects"
    if verdict.outcome in ("NAMED", "COMPOSITE"):
        return "a further blast, to test the prediction of this model"
    paying = [one.labels[-1] for one in found.ranked()[:3] if found.worth(one) > GROWS]
    labels = verdict.rivals or paying
    advice = [h.settled_by for h in LIBRARY.values() if h.label in labels and h.settled_by]
    advice += [SETTLED_BY] if RESOLUTION in labels else []
    return "; ".join(dict.fromkeys(advice)) or _around(remainder)


def _around(remainder):
    """Return where receivers would tell more of what remains."""
    seen = remainder["receivers"]
    near = [f"east {one['x']:.0f} m, north {one['y']:.0f} m" for one in remainder["points"]]
    near += [max(seen, key=seen.get)] if seen else []
    there = " and ".join(near) or "what is located"
    return f"more receivers around {there}, and a shot from another side"


def beyond_doubled(summary) -> bool:
    """Tell whether errors of the theory twice as large would leave something to explain, too."""
    return summary["evidence"]["at_twice_the_errors"] >= MATERIAL


def told_lines(summary) -> list[str]:
    """Return the outcome of ``diagnosis.json`` and what it rests on, in a few lines."""
    lines = [f"outcome: {summary['outcome']}"]
    for effect in summary["effects"]:
        places = effect["target"] if isinstance(effect["target"], list) else [effect["target"]]
        where = f" at {', '.join(places)}" if any(places) else ""
        lines.append(f"  {effect['label']}{where}: {effect['claim']}")
    if summary["class"]:
        lines.append(f"  these records can't tell between {', '.join(summary['class'])}")
    evidence, proof = summary["evidence"], summary["held_out"]
    if evidence["best_labels"] and not summary["effects"]:
        lines.append(f"  the best try, not taken: {', '.join(evidence['best_labels'])}")
    if evidence["best"] is not None:
        lines.append(f"  evidence {evidence['best']} nats; chance finds {evidence['threshold']}")
    if proof is not None and proof["folds"]:
        error = "" if proof["error"] is None else f" ± {proof['error']}"
        lines.append(f"  records left out: {proof['gain']}{error} nats better")
    elif proof is not None:
        lines.append("  no record could be left out to test it")
    if not summary["finished"]:
        lines.append("  the budget of runs ended before all effects were tried")
    if summary["effects"] and not beyond_doubled(summary):
        lines.append("  errors of speeds, places and ground twice as large would explain it, too")
    return [*lines, f"  next: {summary['next_measurement']}"]
