"""What a diagnosis says to people: one sentence first, places, values in usual units, reasons."""

from math import radians

import numpy as np

from ..diagnosis.hypotheses import LIBRARY
from ..diagnosis.likelihood import THEORY, UNSETTLED
from ..diagnosis.search import MATERIAL
from ..diagnosis.unknowns import SPEED_SIGMA, STIFFNESS_SIGMA
from ..diagnosis.verdict import intervals, more_remains
from ..diagnosis.words import beyond_doubled
from ..units import FACTORS

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
PULLED = 2.5  # standard deviations of the prior: further is a hint of missing physics


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
    elif outcome == "PARTIAL" and more_remains(made.verdict.fit.size, made.verdict.share):
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
    offset = effect.knobs.get("offset")
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
             "knob": knob.name.replace("_", " "), "unit": unit, "believed": knob.centre / factor,
             "values": [{k: one[k] / factor for k in ("value", "low", "high")} for one in values]}
        )  # fmt: skip
    return rows


def _values(fit):
    """Yield (effect, knob, values with intervals) of all effects of a fit."""
    for effect, table in zip(fit.effects, intervals(fit), strict=True):
        for knob in effect.hypothesis.knobs:
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
    return [one | {"far": abs(one["pull"]) > PULLED} for one in summary["calibration"]]


def assumptions(scene, summary) -> list[str]:
    """Say what a diagnosis took for granted."""
    case, cut = scene.case, scene.forward.cut
    quality, labels = case.site.quality, sorted({one.label for one in LIBRARY.values()})
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
        f"Places, clocks and small heterogeneity cost {100 * THEORY:g} % of the energy of each "
        f"record, the mesh {100 * UNSETTLED:g} % of what a finer one changes, or a few times that: "
        "these are the small errors of the theory. Noise is that of the windows before the blasts.",
        f"Nothing is called missing while the mean square misfit of every receiver and of every "
        f"blast stays below {MATERIAL:g} times that.",
        f"Runs have zones with edges of {cut.edge:.3g} m, within which motion may bend{finer}.",
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
