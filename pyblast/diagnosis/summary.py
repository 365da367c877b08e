"""Summary of a diagnosis: numbers for its result file, text for page and terminal."""

from math import radians

import numpy as np

from ..inference.likelihood import ENERGY_SHARE, MESH_SHARE
from ..project.flat_box import quality_of
from ..units import FACTORS
from .decision import RESOLUTION, SETTLED_BY, intervals, more_remains
from .hypotheses import LIBRARY, blast_and_hole, untestable_labels
from .localization import located
from .null_distribution import visible
from .search import worst
from .thresholds import DECISIVE, DETECTABLE, FAR_FROM_PRIOR, MATERIAL, SPEED_SIGMA, STIFFNESS_SIGMA

NOT_ASKED = {"topography": "the description of the site has no surface to compare with a plane"}
UNSURE = "CLASS", "PARTIAL", "UNKNOWN"  # outcomes that a forecast should not rest on


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
    remainder = located(baseline, verdict.fit.motion, verdict.fit.chi_square)
    return {
        "outcome": verdict.outcome,
        "effects": _effects(verdict),
        "class": list(verdict.rivals) if len(verdict.rivals) > 1 else [],
        "not_testable": _not_testable(scene, found),
        "smallest_visible": visible(
            scene, verdict.fit, max(DECISIVE, 0.0 if shuffled is None else shuffled.needed(()))
        ),
        "located": located(baseline, none.motion, none.chi_square),
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
                one.name for one in scene.case.project.receivers
                if one.name not in scene.case.receivers
            ],
            "left_out_share": round(float(np.mean(~scene.case.valid)), 4),
        },
        "next_measurement": _next(verdict, found, remainder),
        "calibration": [
            {"value": one.name, "factor": float(np.exp(v)), "pull": float(pull)}
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
    twice = scene.baseline.likelihood.at_double_error(found.none.chi_square)
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
        size = likelihood.chi_square(likelihood.whiten(guess.change))
        length = float(np.sqrt(np.sum(likelihood.n_effective * size)))
        reach[guess.effect.label] = max(reach.get(guess.effect.label, 0.0), length)
    for label in dict.fromkeys(one.label for one in LIBRARY.values()):
        forms = [one for one in LIBRARY.values() if one.label == label]
        if label in told:
            continue
        if found.fits and all(one.on == "site" for one in forms) and label not in reach:
            ended = "the budget of runs ended before it"
            told[label] = "it can't be at this site" if found.finished else ended
        elif reach.get(label, np.inf) < DETECTABLE:
            told[label] = (
                f"at its usual strength it changes these records by {reach[label]:.1f} times "
                f"their errors; {DETECTABLE:g} are needed: larger charges or nearer receivers"
            )
    return [{"label": label, "reason": reason} for label, reason in told.items()]


def _next(verdict, found, remainder):
    """Return what to measure next; remains tell where, if no effect is worth a test of its own."""
    if verdict.outcome == "NULL":
        return "nothing; larger charges or nearer receivers would show smaller effects"
    if verdict.outcome in ("NAMED", "COMPOSITE"):
        return "a further blast, to test the prediction of this model"
    paying = [one.labels[-1] for one in found.ranked()[:3] if found.worth(one) > DECISIVE]
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


MEANINGS = {
    "NULL": "nothing is missing that these records could show",
    "NAMED": "one effect is missing, and it passed every test",
    "CLASS": "an effect is missing; these records can't tell which of a few",
    "COMPOSITE": "several effects are missing together, and each is needed",
    "PARTIAL": "an effect explains much, but not all of it is explained or tested",
    "UNKNOWN": "something is missing that no effect of the library explains",
}
USUAL = {
    "s": (("ms", FACTORS["ms"]), ("s", FACTORS["s"])),
    "m": (("mm", FACTORS["mm"]), ("m", FACTORS["m"])),
    "Pa": (("kPa", FACTORS["kpa"]), ("MPa", FACTORS["mpa"])),
    "Pa/m": (("MPa/m", FACTORS["mpa_per_m"]), ("GPa/m", FACTORS["gpa_per_m"])),
    "rad": (("°", radians(1.0)),),
}
COUNTS = {2: "Two", 3: "Three"}


def lead(made, summary) -> str:
    """Say in a few sentences what was found.

    Parameters
    ----------
    made : Diagnosis
    summary : dict
        As in ``diagnosis.json``.
    """
    outcome = summary["outcome"]
    if outcome == "NULL":
        return (
            "Nothing is missing that these records could show: the calibrated site explains all "
            "receivers within small errors of the theory."
        )
    if outcome == "UNKNOWN":
        return f"Something is missing{_near(summary['located'])}, and {_why_not(summary)}."
    told = [f"{claim} ({label})." for label, claim in claims(made.verdict.fit)]
    proof = f"This explains {share(summary)} of the misfit that noise and small errors leave open, "
    if summary["held_out"]["folds"]:
        proof += "and it foretells records that it was not fitted to."
    else:
        proof += "but no record can be left out to test it."
    if outcome == "CLASS":
        own = made.verdict.fit.labels
        others = [label for label in summary["class"] if label not in own]
        told.append(f"These records can't tell this from {_or(others)}.")
    if outcome == "COMPOSITE":
        told.insert(0, f"{COUNTS[len(told)]} effects act together.")
    untestable = {one["label"]: one["reason"] for one in summary["not_testable"]}
    unsure = [label for label in made.verdict.fit.labels if label in untestable]
    if outcome in ("CLASS", "PARTIAL") and unsure:
        proof += f" But these records can't test {listed(unsure)}: {untestable[unsure[0]]}."
    elif outcome == "PARTIAL" and more_remains(made.verdict.fit.chi_square, made.verdict.share):
        proof += f" But something else is missing{_near(summary['remainder'])}."
    elif outcome == "PARTIAL" and not summary["finished"]:
        proof += " But the budget of runs ended before all other effects were tried."
    if not beyond_doubled(summary):
        proof += (
            " Were speeds, places and the ground off by twice what is supposed below, that would "
            "explain it, too."
        )
    return " ".join([*told, proof])


def share(summary) -> str:
    """Say which share of the open misfit is explained; all, where only small errors are left."""
    return f"{100.0 * min(summary['evidence']['explained_share'], 1.0):.0f} %"


def _why_not(summary):
    """Say why no effect of the library was taken."""
    proof, best = summary["held_out"], " + ".join(summary["evidence"]["best_labels"])
    if not summary["evidence"]["ranking"]:
        return "these records can test no effect of the library, so none was tried"
    if proof is None and not summary["finished"]:
        return "the budget of runs ended before all effects of the library were tried"
    if proof is None:
        return "nothing in the library explains it"
    fault = "does not foretell records that it was not fitted to"
    if proof["improves"]:
        fault = "leaves too much"
    elif not proof["folds"]:
        fault = "can't be tested, for no record can be left out"
    return f"nothing in the library is shown to explain it: the best try, {best}, {fault}"


def claims(fit) -> list[tuple[str, str]]:
    """List each kind of effect of a fit once: its label, and its claim with its places in it."""
    places = {}
    for effect in fit.effects:
        places.setdefault(effect.label, (effect.hypothesis, []))[1].append(_place(effect))
    return [(label, _claim(kind, targets)) for label, (kind, targets) in places.items()]


def _place(effect):
    """Return the target of an effect; a plane where it was moved to."""
    offset = effect.parameters.get("offset")
    if offset is None:
        return effect.target
    axis, _, at = effect.target.partition("=")
    return f"{axis}={float(at) + offset:.1f}"


def _claim(hypothesis, targets):
    """Return a claim with its places in it, or before it where these are many."""
    claim, kind = hypothesis.claim.rstrip("."), hypothesis.target
    if not any(targets):
        return claim
    if len(targets) == 1 and f"this {kind}" in claim.lower():
        claim = claim.replace(f"This {kind}", f"{kind.capitalize()} {targets[0]}")
        return claim.replace(f"this {kind}", f"{kind} {targets[0]}")
    return f"{where(kind, targets)}: {claim}"


def where(kind, targets) -> str:
    """Say where an effect is: its targets by their kind."""
    if not any(targets):
        return "whole site"
    return f"{kind}{'s' if len(targets) > 1 else ''} {listed(targets)}"


def _near(place):
    """Say where residuals are: a point with its resolution, receivers, frequencies."""
    names = list(place["receivers"])
    (f0, f1), (t0, t1) = place["frequency_hz"], place["time_s"]
    points = "".join(
        f" near east {p['x']:.0f} m, north {p['y']:.0f} m (within {0.5 * p['resolution_m']:.0f} m)"
        for p in place["points"]
    )
    seen = f", seen at {listed(names)}" if names else ", seen"
    return f"{points}{seen} at {f0:.3g} to {f1:.3g} Hz, {t0:.2g} to {t1:.2g} s after the first hole"


def listed(words):
    """Join words to a list."""
    return _joined(words, "and")


def _or(words):
    """Join alternatives to a list."""
    return _joined(words, "or")


def _joined(words, last):
    """Join words by commas and a last word."""
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} {last} {words[-1]}"


def parameter_rows(fit) -> list[dict]:
    """List the single values of the effects of a fit, with 90 % intervals in usual units."""
    return [
        {"label": effect.label, "where": where(effect.hypothesis.target, [effect.target]),
         "knob": knob.name.replace("_", " "), **usual(values)}
        for effect, knob, values in _values(fit)
        if not knob.per_hole
    ]  # fmt: skip


def hole_rows(fit) -> list[dict]:
    """List the values of each hole of a blast, in usual units, with what was believed."""
    rows = []
    for effect, knob, values in _values(fit):
        if not knob.per_hole:
            continue
        largest = max(abs(one[key]) for one in values for key in ("low", "high"))
        unit, factor = _unit(knob.unit, largest)
        rows.append(
            {"label": effect.label, "where": where(effect.hypothesis.target, [effect.target]),
             "knob": knob.name.replace("_", " "), "unit": unit, "believed": knob.mean / factor,
             "values": [{k: one[k] / factor for k in ("value", "low", "high")} for one in values]}
        )  # fmt: skip
    return rows


def _values(fit):
    """Yield (effect, knob, values with intervals) of all effects of a fit."""
    for effect, table in zip(fit.effects, intervals(fit), strict=True):
        for knob in effect.hypothesis.parameters:
            yield effect, knob, table[knob.name]


def usual(value) -> dict:
    """Return a value with its interval in the unit that people use for such a size."""
    unit, factor = _unit(value["unit"], max(abs(value["low"]), abs(value["high"])))
    return {"unit": unit} | {key: value[key] / factor for key in ("value", "low", "high")}


def _unit(unit, largest):
    """Return the usual unit of an SI unit for numbers up to a size, and its factor."""
    known = USUAL.get(unit, ((unit, 1.0),))
    return next((one for one in reversed(known) if largest >= 0.1 * one[1]), known[0])


def visible_rows(summary) -> list[str]:
    """Say of each effect how small it could have been and would still have been seen."""
    told = []
    for one in summary["smallest_visible"]:
        unit, factor = _unit(one["unit"], one["amount"])
        size = f"{one['amount'] / factor:.2g} {unit}".rstrip()
        if one["nothing"] != 0.0:
            size = f"{100.0 * one['amount'] / one['nothing']:.0f} %"
        place = {"site": ""}.get(one["target"], f" of any {one['target']}")
        each = " of any single hole" if one["per_hole"] else ""
        but = f", but not at {listed(one['unseen'])}" if one["unseen"] else ""
        told.append(
            f"{one['label']}: {one['knob']}{each or place} off by {size} or more would have been "
            f"seen{but}."
        )
    return told


def calibration_rows(summary) -> list[dict]:
    """List the factors of the calibration; ``far`` where the records drew one off its prior."""
    return [one | {"far": abs(one["pull"]) > FAR_FROM_PRIOR} for one in summary["calibration"]]


def assumptions(scene, summary) -> list[str]:
    """Say what a diagnosis took for granted."""
    case, cut = scene.case, scene.forward.cut
    quality, labels = quality_of(case.project), sorted({one.label for one in LIBRARY.values()})
    lost = 1.0 - float(np.mean(case.valid))
    finer = "; a finer mesh of the believed site corrects them" if np.any(
        scene.baseline.correction
    ) else ""  # fmt: skip
    told = [
        f"Only {case.band.low:g} to {case.band.high:g} Hz of the first {case.duration:.3g} s after "
        "the first hole are compared.",
        f"Wave speeds of layers may be off by {100 * SPEED_SIGMA:g} %, stiffness of joints by "
        f"{100 * STIFFNESS_SIGMA:g} % (one standard deviation); they are fitted anew with every "
        "effect.",
        f"Places, clocks and small heterogeneity cost {100 * ENERGY_SHARE:g} % of the energy of "
        f"each record, the mesh {100 * MESH_SHARE:g} % of what a finer one changes, or a few times "
        "that: "
        "these are the small errors of the theory. Noise is that of the windows before the blasts.",
        f"Nothing is called missing while the mean square misfit of every receiver and of every "
        f"blast stays below {MATERIAL:g} times that.",
        "Runs have the mesh of the project, and no finer one corrects them."
        if cut is None
        else f"Zones have edges of {cut.edge:.3g} m, within which motion may bend{finer}.",
        "Attenuation of the believed site: "
        + ("none." if quality is None else f"Qp {quality[0]:g}, Qs {quality[1]:g}."),
        f"The library holds {len(labels)} effects: {', '.join(labels)}. What is not among them can "
        "only be found as UNKNOWN.",
    ]
    if lost > 0.0:
        told.append(f"{100 * lost:.2g} % of the samples are clipped or missing and have no part.")
    if case.dead:
        told.append(f"Channels that never move have no part: {', '.join(case.dead)}.")
    if summary["hygiene"]["unrecorded"]:
        names = listed(summary["hygiene"]["unrecorded"])
        told.append(f"Receivers without records have no part: {names}.")
    if not summary["finished"]:
        told.append("The budget of runs ended before the search was complete.")
    return told
