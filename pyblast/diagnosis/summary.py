"""Summary of a diagnosis: the content of ``diagnosis.json``, and where residuals come from."""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from ..blasts.hole_effects import HARDLY
from ..errors import contained
from ..inference.location import located
from ..inference.moveout import growth, moveout, polarised_shares
from ..inference.records import COMPONENTS
from ..inference.variation import Varied
from .calibration import Baseline, like_taught
from .case import Case, case_of
from .cross_validation import CrossValidation
from .decision import (
    FINER_MESH,
    RESOLUTION,
    RESOLUTION_DECIDED_BY,
    Decision,
    covariance_of_rows,
    intervals,
)
from .effects import PredictionScene, Scene, with_motion_effects
from .fitting import Fit
from .forward import quarter_wave, simulation_of
from .hypotheses import LIBRARY, blast_and_hole, untestable_labels
from .mistakes import Mistake
from .scores import detection_limits
from .search import Search, means, worst
from .thresholds import DECISIVE, MATERIAL, RESOLVED
from .trusted_shots import explained

UNSURE = "CLASS", "PARTIAL", "UNKNOWN", "MISTAKE"  # outcomes on which a prediction should not rely
WINDOW = 0.8  # share of the energy of a residual that lies in its windows
ON_JOINT = 1.0  # prior standard deviation of the logarithms of stiffness
PROPERTIES = ("cp", "cs", "density")
ELSEWHERE = ("candidate", "side", "source_function")  # of lists, bodies and hammers
IMPOSSIBLE = "it is impossible at this site, or changes no record"
LOCATION = "location of the residual"  # a part of a diagnosis that may fail
SILENT = 0.5  # of what the charge of a hole should radiate; below it a misfire is suspected


def summarise_diagnosis(
    search: Search,
    decision: Decision,
    mistakes: Sequence[Mistake] = (),
) -> dict:
    """Return the content of ``diagnosis.json``; its keys are described in reference/results.md.

    Parameters
    ----------
    search : Search
    decision : Decision
    mistakes : sequence of Mistake
    """
    scene, without = search.scene, search.without_effects
    baseline, case, fit = scene.baseline, scene.case, decision.fit
    mesh_energy = np.sum(baseline.correction**2) / np.sum(case.motion**2)
    change = decision.mesh_change
    limits, before, remainder = [], None, None
    with contained(scene.failures, "detection limits"):
        if search.scores is not None and decision.outcome in ("NULL", "NAMED", "COMPOSITE"):
            limits = detection_limits(search.scores, fit.labels)
    with contained(scene.failures, "look of the residual"):
        before = remainder = residual_of(
            baseline, without.motion - without.unplanned, without.chi_square
        )
        if fit is not without:
            remainder = residual_of(baseline, fit.motion - fit.unplanned, fit.chi_square)
    if search.scores is not None and decision.outcome not in ("NULL", "MISTAKE"):
        with contained(scene.failures, LOCATION):
            for look, each in ((before, without), (remainder, fit))[: 1 + (fit is not without)]:
                look["points"], look["cells"] = points_of(search, each)
    return {
        "outcome": decision.outcome,
        "mistakes": [mistake.row() for mistake in mistakes],
        "effects": _effects(decision, case),
        "suspected_misfires": suspected_misfires(decision, scene),
        "holes_vary": holes_vary(scene.varied and scene.varied.level),
        "class": list(decision.rivals) if len(decision.rivals) > 1 else [],
        "not_testable": _not_testable(search),
        "detection_limits": limits,
        "located": before,
        "remainder": remainder,
        "evidence": _evidence(search, decision),
        "held_out": _held_out(decision.cross_validation),
        "mesh_error": {
            "energy_share": None if FINER_MESH in scene.failures else round(float(mesh_energy), 4),
            "chi_square_of_answer": None if change is None else round(change, 2),
        },
        "data_quality": _data_quality(case),
        "implausible_peaks": [],  # of a project file
        "fails": list(decision.fails),
        "next_measurement": _next_measurement(search, decision, remainder),
        "calibration": _calibration(baseline, fit),
        "model": _model(baseline, fit),
        "not_computed": not_computed(scene.failures),
    }  # fmt: skip


def _model(baseline, fit):
    """Return the site of an answer, by which a further blast is predicted."""
    return {
        "values": fit.values.tolist(), "error_share": fit.posterior.level,
        "effects": [
            {"name": e.name, "target": e.target, "values": [list(v) for v in e.values]}
            for e in fit.effects
        ],
        "baseline_values": baseline.values.tolist(),
        "rows_covariance": covariance_of_rows(fit).tolist(),
    }  # fmt: skip


def holes_vary(varied: Varied | None) -> dict | None:
    """Return the learned variation from hole to hole in per cent, with its sentence."""
    if varied is None:
        return None
    shares = {name: round(100.0 * getattr(varied, name), 1) for name in ("value", "low", "high")}
    return shares | {"unit": "%", "words": varied.words}


def not_computed(failures: Mapping) -> list[dict]:
    """Return the parts of a diagnosis that failed, with the reason."""
    return [{"part": k, "reason": v} for k, v in failures.items() if isinstance(k, str)]


def not_asked(summary: Mapping) -> dict[str, str]:
    """Return the labels of which nothing was asked although the site may have them, by reason.

    Those that are impossible at the site, belong to sites of another kind or change all holes
    alike are left out.
    """
    rows = summary["not_testable"]
    return {
        row["label"]: row["reason"] for row in rows
        if not row["targets"] and row["reason"] != IMPOSSIBLE and row["label"] not in ELSEWHERE
        and HARDLY not in row["reason"]
    }  # fmt: skip


def known_so_far(search: Search) -> dict:
    """Return what an unfinished search knows: fits, scores, what could not be tested."""
    return {
        "largest_chi_square": round(worst(search.without_effects.chi_square), 2),
        "calibration": _calibration(search.scene.baseline, search.without_effects),
        "fitted": _ranking(search),
        "scores": _one_digit(search.classes()),
        "not_testable": _not_testable(search),
        "runs": search.scene.simulation.runs,
    }  # fmt: skip


def _calibration(baseline, fit):
    """Return the calibrated parameters of a fit as a table."""
    return [
        {"parameter": parameter.name, "factor": float(np.exp(value)),
         "prior_deviation": float(deviation)}
        for parameter, value, deviation in zip(
            baseline.parameters, fit.values, fit.values / baseline.sigma, strict=True
        )
    ]  # fmt: skip


def _data_quality(case):
    """Return what of the records is not used, and how what is used was filtered."""
    return {
        "unused_records": case.unused,
        "receivers_without_records": [
            receiver.name
            for receiver in case.project.receivers
            if receiver.name not in (*case.receivers, *case.unused)
        ],
        "band_hz": [case.band.low, case.band.high],
        "band_limited": case.carried,
        "clipped": _clipped(case),
        "low_pass_hz": {name: case.project.survey.shot(name).low_pass for name in case.blasts},
        "excluded_share": round(float(np.mean(~case.valid)), 4),
    }


def _clipped(case):
    """Return the blasts in which a channel is clipped, by receiver."""
    clipped = {}
    recordings = case.project.survey.recordings
    for blast in case.blasts:
        for name, record in recordings[blast].items():
            if np.any(record.clipped):
                clipped.setdefault(name, []).append(blast)
    return clipped


def diagnosis_lines(summary: Mapping) -> list[str]:
    """Return the outcome of ``diagnosis.json`` and its basis in a few lines of text."""
    lines = [f"outcome: {summary['outcome']}"]
    if summary["outcome"] == "UNKNOWN":
        lines += [f"  not asked: {label}: {why}" for label, why in not_asked(summary).items()]
    lines += [f"  {act}" for act in acts(summary)]
    located = summary[residual_shown(summary)]
    if located is not None:
        lines += [f"  most like a change at {place_in_words(each)}" for each in located["points"]]
    for effect in summary["effects"]:
        targets = effect["target"] if isinstance(effect["target"], list) else [effect["target"]]
        where = f" at {', '.join(targets)}" if any(targets) else ""
        lines.append(f"  {effect['label']}{where}: {effect['claim']}")
    if summary["holes_vary"]:
        lines.append(f"  {summary['holes_vary']['words']}")
    if summary["suspected_misfires"]:
        lines.append(f"  suspected misfires: {holes_in_words(summary['suspected_misfires'])}")
    if summary["class"]:
        lines.append(f"  these records cannot distinguish {', '.join(summary['class'])}")
    evidence, tested = summary["evidence"], summary["held_out"]
    if evidence["best_labels"] and not summary["effects"]:
        lines.append(f"  best candidate, not accepted: {', '.join(evidence['best_labels'])}")
    if evidence["delta_ln_evidence"] is not None:
        lines.append(
            f"  Δ ln evidence {evidence['delta_ln_evidence']}; threshold "
            f"{evidence['null_threshold']}"
        )
    if tested is not None and tested["subsets"]:
        error = "" if tested["standard_error"] is None else f" ± {tested['standard_error']}"
        lines.append(f"  held-out records: Δ ln likelihood {tested['delta_ln_likelihood']}{error}")
    elif tested is not None:
        lines.append("  no record could be held out to test it")
    lines += [f"  it fails: {sentence}" for sentence in summary["fails"]]
    if not summary["finished"]:
        lines.append("  the budget ended before all effects were tried")
    return [*lines, f"  next: {summary['next_measurement']}"]


def residual_shown(summary: Mapping) -> str:
    """Return the key of the residual whose place matters: without effects, or beside the answer."""
    return "located" if summary["outcome"] in ("UNKNOWN", "CLASS") else "remainder"


def acts(summary: Mapping) -> list[str]:
    """Return the act that mends each mistake, with what it does to the fit."""
    return [
        f"{row['act']}{' (done)' * summary['corrected']}: correlation with the reference "
        f"{row['correlation_before']:.2f} before, {row['correlation_after']:.2f} after"
        for row in summary["mistakes"]
    ]


def _evidence(search, decision):
    """Return the evidence of the best effects, the thresholds and all fits, as a table."""
    ranked, scores = search.ranked(), search.scores
    best = decision.best or next(iter(ranked), None)
    return {
        "definition": "delta_ln_evidence: log Bayes factor over the calibrated model",
        "delta_ln_evidence": None if best is None else round(search.delta_ln_evidence(best), 1),
        "best_labels": [] if best is None else list(best.labels),
        "null_threshold": None if scores is None else round(scores.threshold, 1),
        "thresholds": {} if scores is None else _one_digit(scores.thresholds),
        "scores": _one_digit(search.classes()),
        "error_levels": {}
        if scores is None
        else {
            "scatter": scores.at.scatter,
            "transfer": scores.at.transfer,
            "nuisances": scores.at.nuisance,
        },
        "explained_share": round(decision.explained_share, 3),
        "open_set": None if decision.open_set is None else round(decision.open_set, 2),
        "ranking": _ranking(search),
        "contradicted": [
            {"label": label, "score": round(float(score), 1), "gained": round(float(gained), 1)}
            for label, (score, gained) in search.contradicted.items()
        ],
        "probability": decision.probability,
    }


def _one_digit(table):
    """Return log Bayes factors with one digit."""
    return {key: round(value, 1) for key, value in table.items()}


def _ranking(search):
    """Return all fits of a search as a table, best first."""
    return [
        {"labels": list(fit.labels), "targets": [e.target for e in fit.effects],
         "delta_ln_evidence": round(search.delta_ln_evidence(fit), 1),
         "largest_chi_square": round(worst(fit.chi_square), 2)}
        for fit in search.ranked()
    ]  # fmt: skip


def suspected_misfires(decision: Decision, scene: Scene) -> list[dict]:
    """Return the holes that may hold unfired explosive, by the best effects, accepted or not.

    Parameters
    ----------
    decision : Decision
    scene : Scene

    Returns
    -------
    list of dict
        ``blast``, ``hole``, ``radiated``: share of what its charge should radiate, that by its
        variation included, below `SILENT`, with ``low`` and ``high``, its 90 % interval.
    """
    fit = decision.best if decision.best is not None and not decision.fit.effects else decision.fit
    rows = []
    for effect, table in zip(fit.effects, intervals(fit), strict=True):
        if effect.label != "misfire_or_charge_error":
            continue
        blast, hole = blast_and_hole(effect.target)
        (scales,) = table.values()
        if not hole and not isinstance(scales, list):  # the whole blast by one factor
            continue
        ids = scene.case.project.blasts[blast].hole_ids
        share = dict(zip(ids, scene.radiated(blast, fit.filters or None), strict=True))
        if hole:
            ids, scales = (hole,), [scales]
        for name, scale in zip(ids, scales, strict=True):
            value, low, high = (scale[key] * share[name] for key in ("value", "low", "high"))
            if value < SILENT:
                rows.append(
                    {"blast": blast, "hole": name, "radiated": value, "low": low, "high": high}
                )
    return rows


def holes_in_words(rows: Sequence[Mapping]) -> str:
    """Return suspected misfires by blast and hole, with share and interval."""
    blasts: dict[str, list[str]] = {}
    for row in rows:
        share = f"{row['hole']} ({row['radiated']:.2f}, {row['low']:.2f} to {row['high']:.2f})"
        blasts.setdefault(row["blast"], []).append(share)
    return "; ".join(
        f"hole{'s' * (len(holes) > 1)} {', '.join(holes)} of blast {blast}"
        for blast, holes in blasts.items()
    )


def _effects(decision, case):
    """Return one entry for each label of the best model."""
    entries = {}
    for effect, table in zip(decision.fit.effects, intervals(decision.fit), strict=True):
        entry = entries.setdefault(
            effect.label,
            {
                "label": effect.label,
                "claim": effect.hypothesis.claim,
                "named": decision.outcome in ("NAMED", "COMPOSITE"),
                "probability": decision.probability.get(effect.label),
                "target": [],
                "parameters": {},
            },
        )
        target, hole = blast_and_hole(effect.target)
        for rows in (rows for rows in table.values() if isinstance(rows, list)):
            for row, own in zip(rows, case.project.blasts[target].hole_ids, strict=True):
                row["hole"] = own
        key = target if target not in entry["target"] else effect.name
        entry["target"].append(target)
        entry["parameters"][key] = table | ({"hole": hole} if hole else {})
    for entry in entries.values():
        if len(entry["target"]) == 1:
            entry["parameters"] = entry["parameters"][entry["target"][0]]
            entry["target"] = entry["target"][0]
    return list(entries.values())


def _held_out(tested: CrossValidation | None):
    """Return the cross-validation as a table."""
    if tested is None:
        return None
    error, subsets = tested.standard_error, tested.subsets
    return {
        "delta_ln_likelihood": round(tested.delta_ln_likelihood, 1),
        "standard_error": round(error, 1) if np.isfinite(error) else None,
        "improves": tested.improves,
        "variance_reduction_before": _mean([s.variance_reduction_before for s in subsets]),
        "variance_reduction_after": _mean([s.variance_reduction_after for s in subsets]),
        "subsets": [vars(subset) for subset in subsets],
        "not_held_out": dict(tested.not_held_out),
    }


def _mean(shares):
    """Return the mean of shares, None without any."""
    return float(np.mean(shares)) if shares else None


def _not_testable(search):
    """Return the labels that the records cannot test, with the reason.

    First those that they cannot test whatever they contain, which is known before the search. Of
    other labels, ``targets`` could not be simulated; there are none where the whole label is meant.
    """
    case = search.scene.case
    reasons = untestable_labels(case)
    rows = [{"label": label, "targets": [], "reason": why} for label, why in reasons.items()]
    for label in dict.fromkeys(hypothesis.label for hypothesis in LIBRARY.values()):
        forms = [form for form in LIBRARY.values() if form.label == label]
        if label in reasons:
            continue
        failed = {}
        for form in forms:
            for target in form.targets(case):
                if (form.name, target) in search.failed:
                    reason = search.failed[form.name, target]
                    failed.setdefault(reason, []).append(target or "whole site")
        number = sum(len(form.targets(case)) for form in forms)
        whole = sum(map(len, failed.values())) == number
        rows += [
            {"label": label, "targets": [] if whole else targets, "reason": reason}
            for reason, targets in failed.items()
        ]
        reason = "" if whole else _not_scored(search, label)
        if reason:
            rows.append({"label": label, "targets": [], "reason": reason})
    return rows


def _not_scored(search, label):
    """Return why a label that can be simulated has no score; empty if it has one, or none has."""
    if search.scores is None:
        return ""
    scored = {member.label for member in search.scores.members}
    if label in scored.union(*(fit.labels for fit in search.fits)):
        return ""
    ended = "the budget ended before it was tried"
    return IMPOSSIBLE if search.finished else ended


def _next_measurement(search, decision, remainder):
    """Return what to do next: what is safe first, then what to measure.

    Where no effect needs a measurement, the remainder decides.
    """
    silent = suspected_misfires(decision, search.scene)
    if silent and decision.outcome != "MISTAKE":
        return (
            f"keep people and machines off {holes_in_words(silent)}, which may hold unfired "
            f"explosive, until they are inspected; then {_measurement(search, decision, remainder)}"
        )
    return _measurement(search, decision, remainder)


def _measurement(search, decision, remainder):
    """Return the measurement that decides what is open."""
    if decision.outcome == "MISTAKE":
        return "correct the records, or diagnose with --correct, then the ground is judged"
    if decision.outcome == "NULL":
        return "nothing; larger charges or nearer receivers would show smaller effects"
    if decision.outcome in ("NAMED", "COMPOSITE"):
        return "a further blast, to test the prediction of this model"
    ranked = search.ranked()[:3]
    paying = [fit.labels[-1] for fit in ranked if search.delta_ln_evidence(fit) > DECISIVE]
    labels = decision.rivals or paying
    advice = [] if search.finished else ["give more --minutes: the budget ended before the search"]
    advice += [h.decided_by for h in LIBRARY.values() if h.label in labels and h.decided_by]
    advice += [RESOLUTION_DECIDED_BY] if RESOLUTION in labels else []
    if decision.outcome == "UNKNOWN":
        asked = not_asked({"not_testable": _not_testable(search)})
        advice += [h.decided_by for h in LIBRARY.values() if h.label in asked and h.decided_by]
        advice.append(_more_receivers(remainder))
    return "; ".join(dict.fromkeys(advice)) or _more_receivers(remainder)


def _more_receivers(remainder):
    """Return the advice to place receivers where something remains unexplained."""
    if remainder is None:
        return "more receivers, and a shot from another side"
    receivers = remainder["receivers"]
    near = [place_in_words(point) for point in remainder["points"]]
    near += [max(receivers, key=receivers.get)] if receivers else []
    where = " and ".join(near) or "the located residual"
    return f"more receivers around {where}, and a shot from another side"


def place_in_words(point: Mapping) -> str:
    """Return the place of a located residual in words: how far it is known, how the ground is."""
    on = f" on joint {point['joint']}" if point["joint"] else ""
    nature = f", {point['nature']} ground" if point["nature"] else ""
    uncertain = "; uncertain: inside the blasted pattern" if point["in_pattern"] else ""
    return (
        f"east {point['x']:.0f} m, north {point['y']:.0f} m, height {point['z']:.0f} m{on} "
        f"(within {point['within_m']:.0f} m{nature}{uncertain})"
    )


def residual_of(baseline: Baseline, motion, chi_square) -> dict:
    """Describe the difference between records and a motion.

    Parameters
    ----------
    baseline : Baseline
    motion : (n_blasts, n_receivers, 3, n_samples) float64, m/s
    chi_square : (n_blasts, n_receivers) float64
        Mean squares of the whitened residuals.

    Returns
    -------
    dict
        ``largest_chi_square`` of a receiver or blast; ``receivers`` with a mean chi-square of at
        least `MATERIAL`, ``blasts``; ``components`` by share of energy; ``time_s`` and
        ``frequency_hz``, windows of 80 % of the energy; ``points`` and
        ``cells``, as of `points_of`, which are not yet known; ``moveout``, ``polarisation`` and
        ``growth``, of the blast with the largest chi-square and of all blasts.
    """
    case = baseline.case
    band = case.band
    residual = band.project(np.where(case.valid, case.motion - motion, 0.0))
    norm = np.sqrt(np.sum(residual**2, axis=(2, 3), keepdims=True) + 1e-300)
    weighted = band.restore(residual / norm)
    weighted *= np.sqrt(chi_square)[..., None, None]
    by_receiver, by_blast = means(chi_square, 0), means(chi_square, 1)
    energy = np.sum(weighted**2, axis=(0, 1))
    spectrum = np.sum(np.abs(np.fft.rfft(weighted)) ** 2, axis=(0, 1, 2))
    frequency = np.fft.rfftfreq(case.n_samples, case.dt)
    times = np.arange(case.n_samples) * case.dt
    shares = energy.sum(axis=-1) / max(energy.sum(), 1e-300)
    return {
        "largest_chi_square": round(worst(chi_square), 2),
        "receivers": {
            name: round(float(v), 2) for name, v in zip(case.receivers, by_receiver, strict=True)
            if v >= MATERIAL
        },
        "blasts": {
            name: round(float(v), 2) for name, v in zip(case.blasts, by_blast, strict=True)
        },
        "components": dict(zip(COMPONENTS, np.round(shares, 3).tolist(), strict=True)),
        "time_s": _window(times, energy.sum(axis=0)),
        "frequency_hz": _window(frequency, spectrum),
        "points": [],
        "cells": None,
        **_shown(case, band.restore(residual), by_blast),
    }  # fmt: skip


def _shown(case, residual, by_blast):
    """Return what a residual in the band shows by itself: its moveout, polarisation and growth."""
    project, b = case.project, int(np.argmax(by_blast))
    stations = {receiver.name: receiver for receiver in project.receivers}
    own = [stations[name] for name in case.receivers]
    places = np.array([receiver.position for receiver in own], dtype=float)
    blast = project.blasts[case.blasts[b]]
    away = places - blast.centres.mean(axis=0)
    turned = np.array([
        part if receiver.azimuth is None else _geographic(part, receiver.azimuth)
        for part, receiver in zip(residual[b], own, strict=True)
    ])  # fmt: skip
    recorded = case.band.project(case.residual(0.0))
    share = np.sqrt(np.sum(residual**2, axis=(1, 2, 3)) / np.sum(recorded**2, axis=(1, 2, 3)))
    charge = np.array([np.nansum(project.blasts[name].charge) for name in case.blasts])
    return {
        "moveout": moveout(residual[b], case.dt, places, blast.centres.mean(axis=0)),
        "polarisation": polarised_shares(turned, np.arctan2(away[:, 0], away[:, 1])),
        "growth": growth(share, charge),
    }


def _geographic(motion, azimuth):
    """Return motion (3, n) along and across an azimuth in rad, and up, as east, north, up."""
    sine, cosine = np.sin(azimuth), np.cos(azimuth)
    along, across, up = motion
    return np.array([sine * along + cosine * across, cosine * along - sine * across, up])


def _window(axis, energy):
    """Return the central window of an axis with the share `WINDOW` of an energy."""
    share = np.cumsum(energy) / max(np.sum(energy), 1e-300)
    ends = np.searchsorted(share, [0.5 - WINDOW / 2, 0.5 + WINDOW / 2])
    return [_rounded(axis[min(end, len(axis) - 1)], np.ptp(axis)) for end in ends]


def _rounded(value, span, digits=4):
    """Round a value to a share of 10 to the power of minus `digits` of a span."""
    return round(float(value), digits - math.floor(math.log10(span)))


def points_of(search: Search, fit: Fit) -> tuple[list[dict], dict | None]:
    """Locate in the rock what a fit leaves, by secondary sources beside it.

    Returns
    -------
    list of dict
        The best place: ``x``, ``y``, ``z``, ``within_m`` in m, ``volume_m3``, which hold it with
        90 %, ``score``, ``change``, the logarithms of cp, cs and density there, ``nature``, soft
        or stiff where both moduli agree, else None, ``joint``, the surface on which it lies, or
        None, ``in_pattern``: whether it lies among the holes of a blast, whose own errors look
        alike. Empty where a change anywhere scores below the threshold of the site, or that volume
        exceeds `RESOLVED` of the whole.
    dict or None
        Cells: ``x``, ``y``, ``z`` in m and ``score`` of each; None where nothing scores at all.

    Raises
    ------
    InputError, SolverError
        If secondary sources can't be computed.
    """
    scores, scene = search.scores, search.scene
    rock, joints = scene.secondary_places
    reach = quarter_wave(scene.baseline.project, scene.case)
    body = search.body_beside(fit)
    cells = {
        name: np.round(column, 1).tolist()
        for name, column in zip("xyz", rock.centres.T, strict=True)
    } | {"score": np.round(body.log_bayes, 1).tolist()}
    share = body.volume / rock.sizes.sum()
    if body.score < scores.threshold or share > RESOLVED:
        return [], cells
    position, within, on = rock.centres[body.best], body.within(reach), None
    patch = None
    if len(joints.sizes):
        residual, error = scores.residual(fit.motion, fit.values), scores.at_fit(fit).error
        patch = located(error, joints, residual, ON_JOINT)
    if patch is not None and patch.log_bayes.max() > body.log_bayes.max():
        position, on = joints.centres[patch.best], joints.names[patch.best]
        within = patch.within(reach)
    x, y, z, *further = (_rounded(v, 1e3, 3) for v in (*position, within, body.volume))
    change = dict(zip(PROPERTIES, np.round(body.strength[body.best], 3).tolist(), strict=True))
    return [
        {"x": x, "y": y, "z": z, "within_m": further[0], "volume_m3": further[1],
         "score": round(float(body.log_bayes.max()), 1), "change": change,
         "nature": None if on else _nature(change), "joint": on,
         "in_pattern": _in_pattern(scene.case, position)}
    ], cells  # fmt: skip


def _nature(change):
    """Return whether ground is soft or stiff by the logarithms of its moduli, None if they differ.

    >>> _nature({"cp": -0.1, "cs": -0.2, "density": 0.0})
    'soft'
    """
    moduli = [2.0 * change[speed] + change["density"] for speed in ("cp", "cs")]
    if all(modulus < 0.0 for modulus in moduli):
        return "soft"
    return "stiff" if all(modulus > 0.0 for modulus in moduli) else None


def _in_pattern(case, position):
    """Tell whether a position (3,) in m lies among the holes of a blast, seen from above.

    It is no farther from a hole than holes are from the nearest other one, in the median.
    """
    for name in case.blasts:
        holes = np.unique(case.project.blasts[name].centres[:, :2].round(2), axis=0)  # decks once
        apart = np.linalg.norm(holes[:, None] - holes, axis=-1) + np.diag([np.inf] * len(holes))
        spacing = np.median(apart.min(axis=1))
        if np.isfinite(spacing) and np.linalg.norm(holes - position[:2], axis=1).min() <= spacing:
            return True
    return False


def held_out_blasts(everything: Case, scene: Scene, decision: Decision) -> dict | None:
    """Return what the answer explains of the blasts that were held out, None without any.

    Parameters
    ----------
    everything : Case
        Of all blasts; ``diagnosis.held_out`` of its project names them.
    scene : Scene
    decision : Decision

    Raises
    ------
    SolverError
        If a run fails.
    """
    table = everything.project.config.diagnosis
    if table is None or not table.held_out:
        return None
    case, fit = scene.case, decision.fit
    further = case_of(case.project, table.held_out)
    further = further if case.share is None else like_taught(further, case)
    simulation = simulation_of(further, scene.simulation.folder, scene.simulation.executor)
    apart = [e for e in fit.effects if blast_and_hole(e.target)[0] not in case.blasts]
    shares = []
    for values, effects in ((scene.baseline.values, ()), (fit.values, apart)):
        site = scene.project(values, effects)
        assert site is not None  # it was fitted
        own, motion = PredictionScene(simulation, further, site), simulation.motion(site)
        shares.append(explained(further, with_motion_effects(own, motion, effects)))
    before, after = shares
    return {
        "blasts": list(further.blasts),
        "explained_before": float(np.nanmedian(before)),
        "explained_after": float(np.nanmedian(after)),
        "receivers": {
            name: [float(np.nanmean(part[:, r])) for part in shares]
            for r, name in enumerate(further.receivers)
            if np.isfinite(before[:, r]).any()
        },
    }
