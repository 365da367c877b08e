"""Report of a diagnosis: what is missing, where, on what evidence, and what remains."""

from collections.abc import Iterator, Sequence
from functools import partial
from math import radians

import numpy as np

from ..diagnosis.decision import (
    RESOLUTION,
    RESOLUTION_CLAIM,
    RESOLUTION_DECIDED_BY,
    intervals,
    more_remains,
)
from ..diagnosis.fitting import Fit
from ..diagnosis.hypotheses import LIBRARY
from ..diagnosis.search import SCORES, material, means
from ..diagnosis.summary import (
    acts,
    diagnosis_lines,
    holes_in_words,
    not_asked,
    not_computed,
    place_in_words,
    residual_shown,
)
from ..diagnosis.thresholds import (
    DECISIVE,
    ENERGY_SHARE,
    FAR_FROM_PRIOR,
    FAR_OFF,
    MATERIAL,
    MESH_SHARE,
    OPEN_SET,
)
from ..errors import contained
from ..files import plain, write_text
from ..ground.tables import quality_of
from ..units import FACTORS, plain_number
from .diagnosis_figures import (
    BEFORE,
    Diagnosed,
    Figure,
    drawn_planes,
    fits_shown,
    held_out_figures,
    holes_figure,
    maps_figure,
    ranking_figure,
    rock_map,
    time_frequency_figure,
)
from .pages import page
from .view import scene, with_diagnosis

COMPONENTS = ("east", "north", "up")
MEANINGS = {
    "NULL": "nothing is missing that these records could show",
    "NAMED": "one effect is missing, and it passed every test",
    "CLASS": "an effect is missing; these records cannot distinguish between a few",
    "COMPOSITE": "several effects are missing together, and each is needed",
    "PARTIAL": "an effect explains much, but not all of it is explained or tested",
    "UNKNOWN": "no effect that could be asked explains these records, or none could be asked",
    "MISTAKE": "records or hole tables hold a mistake; the ground has not been judged",
}
USUAL = {
    "s": (("ms", FACTORS["ms"]), ("s", FACTORS["s"])),
    "m": (("mm", FACTORS["mm"]), ("m", FACTORS["m"])),
    "Pa": (("kPa", FACTORS["kpa"]), ("MPa", FACTORS["mpa"])),
    "Pa/m": (("MPa/m", FACTORS["mpa_per_m"]), ("GPa/m", FACTORS["gpa_per_m"])),
    "rad": (("°", radians(1.0)),),
}
AIR = 340.0  # m/s, speed of sound
COUNTS = {2: "Two", 3: "Three"}


def write_diagnosis_report(path, diagnosis: Diagnosed, summary: dict):
    """Write the page of a diagnosis.

    Parameters
    ----------
    path : path
    diagnosis : Diagnosis
    summary : dict
        As in ``diagnosis.json``.
    """
    write_text(path, render_diagnosis(diagnosis, summary))


def render_diagnosis(diagnosis: Diagnosed, summary: dict) -> str:
    """Return the page as text; every name that users give is escaped.

    A figure or a sentence that fails is left out and named at the end; if the page itself fails,
    it holds the lines of the terminal.
    """
    summary, failures = plain(summary), {}
    parts = _parts(diagnosis, summary, failures)
    lists = {"s": summary | {"assumed": [], "files_sha256": {}}, "far": FAR_FROM_PRIOR}
    with contained(failures, "page"):
        return page("diagnosis.html").render(
            meanings=MEANINGS,
            place=place_in_words,
            points=_points(summary),
            failures=not_computed(failures),
            **lists,
            **parts,
        )
    with contained(failures, "lines"):
        parts["lines"] = diagnosis_lines(summary)
    lines = parts.get("lines", [f"outcome: {summary['outcome']}"])
    return page("diagnosis_lines.html").render(
        lines=lines, failures=not_computed(failures), **lists
    )


def _parts(diagnosis, summary, failures):
    """Return what the page shows by name; what fails is empty and entered into the failures."""
    fit = diagnosis.decision.fit
    sentences = {
        "lead": lambda: lead(diagnosis, summary),
        "mistakes": lambda: acts(summary),
        "ranking": lambda: ranking_rows(diagnosis),
        "scored": lambda: score_rows(summary),
        "asked": lambda: list(not_asked(summary)),
        "detection_limits": lambda: detection_limit_rows(summary),
        "required": lambda: required_evidence(summary),
        "share": lambda: share(summary),
        "rivals": lambda: class_rows(diagnosis, summary),
        "parameters": lambda: parameter_rows(fit),
        "calibration": lambda: calibration_rows(summary),
        "assumptions": lambda: assumptions(diagnosis, summary),
        "scene": lambda: scene_of(diagnosis, summary),
    }
    figures = {
        "maps": (
            lambda: _map_figures(diagnosis, summary),
            lambda: _rock_maps(diagnosis, summary),
            lambda: _time_frequency(diagnosis, summary),
        ),
        "rank_figure": (lambda: _rank_figures(diagnosis, summary),),
        "holes": (lambda: _hole_figures(fit),),
        "held_out_figures": (lambda: held_out_figures(diagnosis),),
    }
    parts = {}
    for name, sentence in sentences.items():
        parts[name] = ""
        with contained(failures, name.replace("_", " ")):
            parts[name] = sentence()
    for name, groups in figures.items():
        parts[name] = []
        for group in groups:
            with contained(failures, f"figures of {name.replace('_', ' ')}"):
                for title, caption, draw in group():
                    with contained(failures, title):
                        image = draw()
                        parts[name].append({"title": title, "caption": caption, "image": image})
    return parts


def lead(diagnosis: Diagnosed, summary: dict) -> str:
    """Return the result in a few sentences, which begin the page; suspected misfires first."""
    silent = summary["suspected_misfires"]
    first = f"Suspected misfires: {holes_in_words(silent)}. " if silent else ""
    vary = summary["holes_vary"]
    last = f" {vary['words'][0].upper()}{vary['words'][1:]}." if vary else ""
    return first + _answer(diagnosis, summary) + last


def _answer(diagnosis, summary):
    """Return what was found in a few sentences."""
    outcome, decision = summary["outcome"], diagnosis.decision
    without = diagnosis.search.without_effects
    if outcome == "MISTAKE":
        plain_acts = [row["act"] for row in summary["mistakes"]]
        return f"A mistake in the records comes first: {'; '.join(plain_acts)}."
    if outcome == "NULL":
        which = "every effect of the library was scored"
        if not_asked(summary):
            which = f"every effect but {joined_by_and(list(not_asked(summary)))} was scored"
        if not summary["finished"]:
            return (
                "None of the effects that the budget sufficed for is above what the error "
                "explains; more minutes may still show another. What would have been detected is "
                "listed below."
            )
        return (
            f"Nothing is missing that these records could show: {which}, and none is above what "
            "the error explains. What would have been detected is listed below."
        )
    if outcome == "UNKNOWN":
        if not (summary["evidence"]["scores"] or material(without.chi_square)):
            return (
                "These records cannot tell whether something is missing: the calibrated site "
                f"explains them within noise and model error, but {_why_not(summary)}."
            )
        said = f"Something is missing{_near(summary['located'])}, and {_why_not(summary)}."
        return f"{_not_asked(summary)}{said}{_alike(summary['located'])}"
    sentences = [f"{claim} ({label})." for label, claim in claims(decision.fit)]
    basis = f"This explains {share(summary)} of the misfit that exceeds noise and model error, "
    if not material(without.chi_square):
        basis = "The misfit is small, but more than the learned error of this site explains, "
    if summary["held_out"]["subsets"]:
        basis += "and it predicts held-out records."
    else:
        basis += "but no record can be held out to test it."
    if outcome == "CLASS":
        others = [label for label in summary["class"] if label not in decision.fit.labels]
        sentences.append(f"These records cannot distinguish this from {_joined(others, 'or')}.")
    if outcome == "COMPOSITE":
        sentences.insert(0, f"{COUNTS[len(sentences)]} effects act together.")
    whole = [row for row in summary["not_testable"] if not row["targets"]]
    untestable = {row["label"]: row["reason"] for row in whole}
    untested = [label for label in decision.fit.labels if label in untestable]
    if outcome in ("CLASS", "PARTIAL") and untested:
        reason = untestable[untested[0]]
        basis += f" But these records cannot test {joined_by_and(untested)}: {reason}."
    elif outcome == "PARTIAL" and _more_remains(diagnosis):
        basis += f" But something else is missing{_near(summary['remainder'])}."
    elif outcome == "PARTIAL" and not summary["finished"]:
        basis += " But the budget ended before all other effects were tried."
    return " ".join([*sentences, basis])


def _not_asked(summary):
    """Return the sentence on what was not asked, by reason; empty where all was."""
    by_reason = {}
    for label, reason in not_asked(summary).items():
        by_reason.setdefault(reason, []).append(label)
    rows = [f"{joined_by_and(labels)} ({reason})" for reason, labels in by_reason.items()]
    return f"Not asked: {'; '.join(rows)}. " if rows else ""


def _alike(located):
    """Return what a residual shows by itself: how it runs, where it points, how it grows."""
    if located is None:
        return ""
    parts, run = [], located["moveout"]
    if run is not None:
        low, high = (f"{run[key]:.0f}" for key in ("low", "high"))
        from_ = "from the blast" if run["azimuth_deg"] is None else (
            f"towards {run['azimuth_deg']:.0f}°"
        )  # fmt: skip
        air = ", as a wave in air does" if run["low"] <= AIR <= run["high"] else ""
        parts.append(f"it runs {from_} over the receivers at {low} to {high} m/s{air}")
    direction, share = max(located["polarisation"].items(), key=lambda pair: pair[1])
    parts.append(f"{100 * share:.0f} % of its energy is {direction}")
    if located["growth"] is not None:
        parts.append(f"its share grows with the charge to the power {located['growth']:.2g}")
    return f" By itself: {'; '.join(parts)}."


def _more_remains(diagnosis):
    """Tell whether something else is missing beside the answer."""
    decision = diagnosis.decision
    if diagnosis.search.scored_beside(decision.fit):
        return True
    return more_remains(decision.fit.chi_square, decision.explained_share)


def share(summary: dict) -> str:
    """Return the explained share of the excess misfit; all where only model error remains."""
    return f"{100.0 * min(summary['evidence']['explained_share'], 1.0):.0f} %"


def _why_not(summary):
    """Return why no effect of the library was accepted."""
    evidence, tested = summary["evidence"], summary["held_out"]
    best = " + ".join(evidence["best_labels"])
    if not evidence["ranking"] and evidence["scores"]:
        far = [
            r["parameter"] for r in summary["calibration"] if abs(r["prior_deviation"]) > FAR_OFF
        ]
        if far:
            return (
                f"the calibration takes it up: {joined_by_and(far)} lies more than {FAR_OFF:g} "
                "prior deviations off, and no effect of the library scores"
            )
        return "what scores in the library could not be fitted"
    if any(row["part"] == SCORES for row in summary["not_computed"]):
        return "the scores of its effects could not be computed"
    if not evidence["ranking"]:
        return "these records can test no effect of the library, so none was tried"
    if tested is None and not summary["finished"]:
        return "the budget ended before all effects of the library were tried"
    if tested is None:
        return "nothing in the library explains it"
    if evidence["open_set"] is not None and evidence["open_set"] < OPEN_SET:
        return (
            f"the cause is outside of the library: its best candidate, {best}, has "
            f"{evidence['open_set']:.2g} of the evidence of sources anywhere in the ground"
        )
    reason = "does not predict held-out records"
    if tested["improves"] and summary["fails"]:
        return f"the cause is outside of the library: {summary['fails'][-1]}"
    if tested["improves"]:
        reason = "leaves too much unexplained"
    elif not tested["subsets"]:
        reason = "cannot be tested, because no record can be held out"
        less = [each for each in summary["fails"] if each.startswith("blast ")]
        reason += f", and a large blast contradicts it ({less[0]})" if less else ""
    return f"nothing in the library is shown to explain it: the best candidate, {best}, {reason}"


def claims(fit: Fit) -> list[tuple[str, str]]:
    """Return label and claim of each kind of effect of a fit, with the targets in the claim."""
    kinds = {}
    for effect in fit.effects:
        kinds.setdefault(effect.label, (effect.hypothesis, []))[1].append(_target(effect))
    return [(label, _claim(kind, targets)) for label, (kind, targets) in kinds.items()]


def _target(effect):
    """Return the target of an effect; of a plane, as fitted."""
    described = effect.hypothesis.described
    return effect.target if described is None else described(effect.target, **effect.parameters)


def _claim(hypothesis, targets):
    """Return a claim with its target in it, or before it if there are several."""
    claim, kind = hypothesis.claim.rstrip("."), hypothesis.target
    if not any(targets):
        return claim
    if len(targets) == 1 and f"this {kind}" in claim.lower():
        claim = claim.replace(f"This {kind}", f"{kind.capitalize()} {targets[0]}")
        return claim.replace(f"this {kind}", f"{kind} {targets[0]}")
    return f"{where(kind, targets)}: {claim}"


def where(kind: str, targets: list[str]) -> str:
    """Return the targets of an effect with their kind."""
    if not any(targets):
        return "whole site"
    return f"{kind}{'s' if len(targets) > 1 else ''} {joined_by_and(targets)}"


def _near(located):
    """Return where residuals are: a point if resolved, receivers, frequencies, times."""
    if located is None:
        return ""
    names = list(located["receivers"])
    (f0, f1), (t0, t1) = located["frequency_hz"], located["time_s"]
    points = "".join(f" near {place_in_words(point)}" for point in located["points"])
    seen = f", seen at {joined_by_and(names)}" if names else ", seen"
    return f"{points}{seen} at {f0:.3g} to {f1:.3g} Hz, {t0:.2g} to {t1:.2g} s after the first hole"


def joined_by_and(words: Sequence[str]) -> str:
    """Join words by commas and "and"."""
    return _joined(words, "and")


def _joined(words, last):
    """Join words by commas and a last word."""
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} {last} {words[-1]}"


def ranking_rows(diagnosis: Diagnosed) -> list[dict]:
    """Return the effects that were fitted, best first, with their claims.

    Probabilities are those of single effects; there are none if several act together.
    """
    search, decision = diagnosis.search, diagnosis.decision
    several = len(decision.fit.labels) > 1
    return [
        {
            "name": _name(fit, search.fits),
            "delta_ln_evidence": search.delta_ln_evidence(fit),
            "probability": decision.probability.get(fit.labels[0])
            if len(fit.labels) == 1 and not several
            else None,
            "claim": " ".join(dict.fromkeys(e.hypothesis.claim for e in fit.effects)),
            "chosen": bool(decision.fit.effects) and fit.where == decision.fit.where,
        }
        for fit in search.ranked()
    ]


def _name(fit, others):
    """Return the name of a fit: labels and targets, with forms if they distinguish it."""

    def name(each):
        targets = list(dict.fromkeys(effect.target for effect in each.effects if effect.target))
        return " + ".join(each.labels) + (f" at {joined_by_and(targets)}" if targets else "")

    forms = " + ".join(dict.fromkeys(e.hypothesis.form for e in fit.effects if e.hypothesis.form))
    alike = sum(name(other) == name(fit) for other in others) > 1 and forms
    return f"{name(fit)} ({forms})" if alike else name(fit)


def score_rows(summary: dict) -> list[str]:
    """Return the score of each label that was not fitted, best first."""
    fitted = {label for row in summary["evidence"]["ranking"] for label in row["labels"]}
    scores = summary["evidence"]["scores"].items()
    return [f"{label} ({round(value):d})" for label, value in scores if label not in fitted]


def required_evidence(summary: dict) -> float:
    """Return the Δ ln evidence that an effect must exceed."""
    return max(summary["evidence"]["null_threshold"] or 0.0, DECISIVE)


def class_rows(diagnosis: Diagnosed, summary: dict) -> list[dict]:
    """Return the effects that the records cannot distinguish, with what would decide."""
    known = {
        e.label: (e.hypothesis.claim, e.hypothesis.decided_by)
        for fit in diagnosis.search.fits for e in fit.effects
    } | {RESOLUTION: (RESOLUTION_CLAIM, RESOLUTION_DECIDED_BY)}  # fmt: skip
    return [
        {"label": label, "claim": known[label][0], "decided_by": known[label][1]}
        for label in summary["class"]
    ]


def parameter_rows(fit: Fit) -> list[dict]:
    """Return the single parameters of the effects of a fit, with 90 % intervals."""
    return [
        {"label": effect.label, "where": where(effect.hypothesis.target, [effect.target]),
         "parameter": parameter.name.replace("_", " "), **usual(values)}
        for effect, parameter, values in _values(fit)
        if not parameter.per_hole
    ]  # fmt: skip


def hole_rows(fit: Fit) -> list[dict]:
    """Return the parameters of each hole of a blast, with 90 % intervals and their prior mean."""
    rows = []
    for effect, parameter, values in _values(fit):
        if not parameter.per_hole:
            continue
        largest = max(abs(value[key]) for value in values for key in ("low", "high"))
        unit, factor = _unit(parameter.unit, largest)
        rows.append(
            {"label": effect.label, "where": where(effect.hypothesis.target, [effect.target]),
             "parameter": parameter.name.replace("_", " "), "unit": unit,
             "prior": parameter.mean / factor,
             "values": [{k: v[k] / factor for k in ("value", "low", "high")} for v in values]}
        )  # fmt: skip
    return rows


def _values(fit):
    """Yield (effect, parameter, values with intervals) of all effects of a fit."""
    for effect, table in zip(fit.effects, intervals(fit), strict=True):
        for parameter in effect.hypothesis.parameters:
            yield effect, parameter, table[parameter.name]


def usual(value: dict) -> dict:
    """Return a value with its interval in the usual unit for its size."""
    unit, factor = _unit(value["unit"], max(abs(value["low"]), abs(value["high"])))
    return {"unit": unit} | {key: value[key] / factor for key in ("value", "low", "high")}


def _unit(unit, largest):
    """Return the usual unit of an SI unit for numbers up to a size, and its factor."""
    known = USUAL.get(unit, ((unit, 1.0),))
    return next((pair for pair in reversed(known) if largest >= 0.1 * pair[1]), known[0])


def detection_limit_rows(summary: dict) -> list[str]:
    """Return the detection limits of each effect as sentences.

    Forms of an effect that would not have been detected are named beside one that would.
    """
    limits, rows, stated = summary["detection_limits"], [], set()
    seen = {limit["label"] for limit in limits if limit["value"] is not None}
    for limit in limits:
        label, known = limit["label"], limit["value"] is not None
        if not known and label in seen:
            continue
        sentence = _limit_sentence(limit)
        missed = [
            f"as {each['form']}" if each["form"] != limit["form"] else f"by {each['parameter']}"
            for each in limits if each["label"] == label and each["value"] is None
        ]  # fmt: skip
        if known and missed and label not in stated:
            ways = _joined(list(dict.fromkeys(missed)), "or")
            sentence = f"{sentence[:-1]}, {ways} at no strength that was simulated."
        stated.add(label)
        rows.append(sentence)
    return rows


def _limit_sentence(limit):
    """Return a detection limit as a sentence."""
    form = f" ({limit['form']})" if limit["form"] else ""
    where = "" if limit["target"] == "site" else f" at any {limit['target']}"
    of = f"{limit['label']}{form}{' of any single hole' if limit['per_hole'] else where}"
    if limit["value"] is None:
        return f"{of}: would not have been detected at any strength that was simulated."
    null, value = limit["null_value"], limit["value"]
    unit, factor = _unit(limit["unit"], abs(value))
    size = f"{value / factor:.2g} {unit}".rstrip()
    if null == 0.0:
        size = f"{abs(value) / factor:.2g} {unit}".rstrip() + " or more"
    else:
        size += " or less" if null is None or value < null else " or more"
    own = next(h for h in LIBRARY.values() if (h.label, h.form) == (limit["label"], limit["form"]))
    units = {parameter.name: parameter.unit for parameter in own.parameters}
    beside = [_with_unit(name, amount, units[name]) for name, amount in limit["beside"].items()]
    given = f" (with {', '.join(beside)})" if beside else ""
    missed = limit["not_detected_at"]
    but = f", but not at {joined_by_and(missed)}" if missed else ""
    return f"{of}: {limit['parameter']} of {size}{given} would have been detected{but}."


def _with_unit(name, amount, unit):
    """Return a parameter with its value in the usual unit."""
    unit, factor = _unit(unit, abs(amount))
    return f"{name} {amount / factor:.2g} {unit}".rstrip()


def calibration_rows(summary: dict) -> list[dict]:
    """Return the factors of the calibration; ``far`` if one is far from its prior."""
    return [
        row | {"far": abs(row["prior_deviation"]) > FAR_FROM_PRIOR}
        for row in summary["calibration"]
    ]


def assumptions(diagnosis: Diagnosed, summary: dict) -> list[str]:
    """Return the assumptions of a diagnosis, one sentence each."""
    scene = diagnosis.search.scene
    case, quality = scene.case, quality_of(scene.case.project.materials)
    labels = sorted({hypothesis.label for hypothesis in LIBRARY.values()})
    lost, priors = 1.0 - float(np.mean(case.valid)), case.project.config.priors
    finer = "; a finer mesh of the reference site corrects them" if np.any(
        scene.baseline.correction
    ) else ""  # fmt: skip
    sentences = [
        f"Only {case.band.low:g} to {case.band.high:g} Hz of the first {case.duration:.3g} s after "
        f"the first hole are compared. {case.carried}".rstrip(),
        f"Prior standard deviations are those of [priors]: {priors.speed_percent:g} % for wave "
        f"speeds, {priors.stiffness_percent:g} % for stiffness of joints (both fitted again with "
        f"every effect), {priors.receiver_m:g} m for receivers, {priors.clock_ms:g} ms for clocks, "
        f"{priors.firing_ms:g} ms for firing times, {priors.amplitude_percent:g} % for amplitudes.",
        "Every effect is scored and fitted under one error, whose level is learned from the "
        "records; receivers repeat a part of it in all blasts. Noise is estimated from the windows "
        "before the blasts.",
        f"Usual errors are noise, {100 * ENERGY_SHARE:g} % of the energy of each record, for "
        "coordinates, clocks and small heterogeneity, and "
        f"{100 * MESH_SHARE:g} % of the energy that a finer mesh changes. Where nothing scores, "
        "the outcome is NULL only if the "
        f"energy that remains of every receiver and every blast is below {MATERIAL:g} times the "
        f"usual one, and no calibrated value lies beyond {FAR_OFF:g} prior deviations.",
        "Holes of one charge do not radiate alike: each charge, and its path to each receiver, has "
        "a smooth filter of its own. How much these vary is learned before any effect is asked "
        "for, and counts as usual.",
        f"The ground is made of {case.project.meshed.reason}{finer}.",
        "Attenuation of the reference site: "
        + ("none." if quality is None else f"Qp {quality[0]:g}, Qs {quality[1]:g}."),
        f"The library holds {len(labels)} effects: {', '.join(labels)}. Anything else can only be "
        "reported as UNKNOWN.",
    ]
    if lost > 0.0:
        sentences.append(f"{100 * lost:.2g} % of the samples are clipped or missing and not used.")
    if case.unused:
        listed = "; ".join(f"{name}: {reason}" for name, reason in case.unused.items())
        sentences.append(f"Records that are not used: {listed}.")
    if summary["data_quality"]["receivers_without_records"]:
        names = joined_by_and(summary["data_quality"]["receivers_without_records"])
        sentences.append(f"Receivers without records are not used: {names}.")
    sentences += summary["implausible_peaks"]
    if not summary["finished"]:
        sentences.append("The budget ended before the search was complete.")
    return sentences


def _map_figures(diagnosis, summary) -> Iterator[Figure]:
    """Draw the misfit of receivers in plan and section."""
    case, fits = diagnosis.search.scene.case, fits_shown(diagnosis)
    misfits = {title: means(fit.chi_square, 0) for title, fit in fits.items()}
    points, targets = _points(summary), _targets(diagnosis)
    diagnosed = _diagnosed(diagnosis)
    depth = ""
    if case.project.config.mesh.faults:
        depth += " Of a joint, the line is its trace on the ground, the face what lies below."
    yield (
        "In plan and section",
        "Receivers by their misfit, the mean square over all blasts: 1 is that of noise and model "
        f"error; from {MATERIAL:g} on (red rings) something is missing.{depth}",
        lambda: maps_figure(
            case.project, case.receivers, misfits, MATERIAL,
            targets=targets, points=points, diagnosed=diagnosed,
        ),
    )  # fmt: skip


def _rock_maps(diagnosis, summary) -> Iterator[Figure]:
    """Draw where in the rock a change would explain what remains."""
    look = summary[residual_shown(summary)]
    if look is None or look["cells"] is None:
        return
    where = "No place is given: none explains enough, or too much of the ground would do."
    if look["points"]:
        where = f"Most like a change at {joined_by_and(list(map(place_in_words, look['points'])))}."
    beside = " beside the answer" if residual_shown(summary) == "remainder" else ""
    yield (
        "Where in the rock",
        f"How well a soft or stiff body at each place explains the records{beside}: Δ ln evidence, "
        f"which pays for its freedom. {where} Linear: a void shows too deep.",
        lambda: rock_map(look["cells"], diagnosis.search.scene.case.project, look["points"]),
    )


def scene_of(diagnosis: Diagnosed, summary: dict) -> dict:
    """Return the view of the project of a diagnosis, with its misfits and its answer.

    Parameters
    ----------
    diagnosis : Diagnosis
    summary : dict
        As in ``diagnosis.json``.

    Returns
    -------
    dict
        As of `scene`.
    """
    case, shown = diagnosis.search.scene.case, scene(diagnosis.search.scene.case.project)
    misfits = {}
    for title, fit in fits_shown(diagnosis).items():
        for name, misfit in zip(case.receivers, means(fit.chi_square, 0), strict=True):
            receiver = shown["receivers"][name]
            receiver["rows"].append((f"misfit {title}", plain_number(misfit)))
            receiver["over"] = bool(receiver.get("over") or misfit >= MATERIAL)
            misfits.setdefault(name, misfit)  # of the site without effects
    planes = drawn_planes(case.project, _diagnosed(diagnosis), _targets(diagnosis))
    elsewhere = {plane.name for plane in planes if not plane.strong}
    named = {
        f"{plane.name}, as diagnosed" if plane.name in elsewhere else plane.name: plane.polygons
        for plane in planes if plane.strong
    }  # fmt: skip
    return with_diagnosis(shown, misfits, named, _points(summary))


def _targets(diagnosis):
    """Return the joints, receivers and blasts with effects."""
    return {effect.target for effect in diagnosis.decision.fit.effects} - {""}


def _points(summary):
    """Return where residuals are located that the answer does not explain."""
    located = summary[residual_shown(summary)]
    return [] if located is None else located["points"]


def _diagnosed(diagnosis):
    """Return the project with the effects on its site of the answer; None without any."""
    fit = diagnosis.decision.fit
    if not any(effect.hypothesis.on == "site" for effect in fit.effects):
        return None
    with contained({}, "diagnosed project"):
        return diagnosis.search.scene.project(fit.values, fit.effects)
    return None


def _time_frequency(diagnosis, summary) -> Iterator[Figure]:
    """Draw the record with the largest misfit over time and frequency."""
    case, fits = diagnosis.search.scene.case, fits_shown(diagnosis)
    chi_square = diagnosis.search.without_effects.chi_square
    b, r = np.unravel_index(np.argmax(chi_square), chi_square.shape)
    band = case.band
    recorded = case.in_band(case.motion)
    residuals = {title: recorded - case.in_band(fit.motion) for title, fit in fits.items()}
    k = int(np.argmax(np.sum(residuals[BEFORE][b, r] ** 2, axis=-1)))
    located = summary["located"]
    yield (
        "In time and frequency",
        f"The record with the largest misfit, {case.blasts[b]} at {case.receivers[r]}, component "
        f"{COMPONENTS[k]}, and its residuals. The frame holds the central 80 % of the misfit of "
        "all records, in time and in frequency.",
        lambda: time_frequency_figure(
            recorded[b, r, k],
            {f"residual, {title}": part[b, r, k] for title, part in residuals.items()},
            case.dt,
            (max(band.low, 1.0 / case.duration), band.high),
            (located["time_s"], located["frequency_hz"]),
        ),
    )


def _rank_figures(diagnosis, summary):
    """Draw the evidence of all effects that were fitted."""
    rows = ranking_rows(diagnosis)
    if not rows:
        return
    yield (
        "Evidence",
        "Δ ln evidence (log Bayes factor) of each effect over the calibrated site; 2.3 make it ten "
        "times as likely. The line is the required value, the threshold of this site. Orange: "
        "effects on which the outcome is based.",
        lambda: ranking_figure(
            [(row["name"], row["delta_ln_evidence"]) for row in rows],
            required_evidence(summary),
            {n for n, row in enumerate(rows) if row["chosen"]},
        ),
    )


def _hole_figures(fit):
    """Draw the parameters of single holes."""
    for row in hole_rows(fit):
        unit = f" [{row['unit']}]" if row["unit"] else ""
        yield (
            f"{row['label']}: {row['parameter']} of {row['where']}",
            "Each hole with its 90 % interval.",
            partial(holes_figure, row["values"], row["prior"], f"{row['parameter']}{unit}"),
        )
