"""Report of a diagnosis: what is missing, where, on what evidence, what remains."""

import numpy as np

from ..diagnosis import summary as diagnosis_words
from ..diagnosis.cross_validation import foretold
from ..diagnosis.decision import CLAIM, RESOLUTION, SETTLED_BY
from ..diagnosis.search import means
from ..diagnosis.summary import listed
from ..diagnosis.thresholds import DECISIVE, FAR_FROM_PRIOR, MATERIAL
from ..project.result import plain, write_text
from . import diagnosis_figures
from .diagnosis_figures import maps_figure
from .run import page


def ranking_rows(made) -> list[dict]:
    """List the effects that were fitted, best first, with what they claim.

    Probabilities are those of single effects: there are none where several act together.
    """
    found, verdict = made.search, made.verdict
    several = len(verdict.fit.labels) > 1
    rows = []
    for one in found.ranked():
        rows.append(
            {
                "name": _name(one, found.fits),
                "worth": found.worth(one),
                "probability": verdict.probability.get(one.labels[0])
                if len(one.labels) == 1 and not several
                else None,
                "claim": " ".join(dict.fromkeys(e.hypothesis.claim for e in one.effects)),
                "chosen": bool(verdict.fit.effects) and one.where == verdict.fit.where,
            }
        )
    return rows


def _name(fit, others):
    """Name a fit by its labels and places, by forms too where another has the same."""

    def said(one):
        places = list(dict.fromkeys(effect.target for effect in one.effects if effect.target))
        return " + ".join(one.labels) + (f" at {listed(places)}" if places else "")

    forms = " + ".join(dict.fromkeys(e.hypothesis.form for e in fit.effects if e.hypothesis.form))
    alike = sum(said(one) == said(fit) for one in others) > 1 and forms
    return f"{said(fit)} ({forms})" if alike else said(fit)


def screened_rows(made) -> list[str]:
    """List effects that a run or two judged too small a part of the misfit to be fitted."""
    found = made.search
    fitted = {label for one in found.fits for label in one.labels}
    best = {}
    for guess in found.guesses:  # best first
        if guess.effect.label not in fitted:
            best.setdefault(guess.effect.label, guess)
    return [
        f"{label} ({100.0 * max(one.share, 0.0):.0f} % at {one.effect.target or 'the whole site'})"
        for label, one in best.items()
    ]


def needed(summary) -> float:
    """Return the evidence that an effect must exceed, nats."""
    return max(summary["evidence"]["threshold"] or 0.0, DECISIVE)


def class_rows(made, summary) -> list[dict]:
    """List the effects that these records can't tell apart, with what would settle it."""
    known = {
        e.label: (e.hypothesis.claim, e.hypothesis.settled_by)
        for one in made.search.fits for e in one.effects
    } | {RESOLUTION: (CLAIM, SETTLED_BY)}  # fmt: skip
    return [
        {"label": label, "claim": known[label][0], "settled_by": known[label][1]}
        for label in summary["class"]
    ]


BEFORE, AFTER = "calibrated", "with the effect"
COLUMNS = 3  # records side by side
COMPONENTS = ("east", "north", "up")


def write_diagnosis_report(path, made, summary):
    """Write the page of a diagnosis.

    Parameters
    ----------
    path : path
    made : Diagnosis
        With ``scene``, ``search`` and ``verdict``.
    summary : dict
        As in ``diagnosis.json``.
    """
    write_text(path, render_diagnosis(made, summary))


def render_diagnosis(made, summary) -> str:
    """Return the page as text; every name that users give is escaped."""
    summary, words, fit = plain(summary), diagnosis_words, made.verdict.fit
    return page("diagnosis.html").render(
        s=summary | {"assumed": [], "files_sha256": {}},
        lead=words.lead(made, summary),
        meanings=words.MEANINGS,
        maps=_drawn(_map_figures(made, summary)),
        ranking=ranking_rows(made),
        screened=screened_rows(made),
        visible=words.visible_rows(summary),
        rank_figure=_drawn(_rank_figures(made, summary)),
        needed=needed(summary),
        share=words.share(summary),
        rivals=class_rows(made, summary),
        parameters=words.parameter_rows(fit),
        holes=_drawn(_hole_figures(fit)),
        proof=_drawn(_proof_figures(made)),
        calibration=words.calibration_rows(summary),
        pulled=FAR_FROM_PRIOR,
        assumptions=words.assumptions(made.scene, summary),
    )


def _drawn(rows):
    """Return figures as the page wants them."""
    return [dict(zip(("title", "caption", "image"), row, strict=True)) for row in rows]


def _has_effect(made):
    """Tell whether the verdict has a model with effects."""
    return bool(made.verdict.fit.effects)


def _fits(made):
    """Return the fits to show by title: without effects, and with them where there are some."""
    fits = {BEFORE: made.search.none}
    return fits | {AFTER: made.verdict.fit} if _has_effect(made) else fits


def _map_figures(made, summary):
    """Draw where records are missed: in plan and section, and in time and frequency."""
    case, fits = made.scene.case, _fits(made)
    sizes = {title: means(fit.chi_square, 0) for title, fit in fits.items()}
    outcome = summary["outcome"]
    place = {"UNKNOWN": "located", "PARTIAL": "remainder"}.get(outcome)
    points = [] if place is None else summary[place]["points"]
    found = {effect.target for effect in made.verdict.fit.effects} - {""}
    deep = " How deep it lies is not told." if points else ""
    yield (
        "In plan and section",
        "Each receiver by its misfit, the mean square over all blasts: 1 is what noise and small "
        f"errors of the theory leave; from {MATERIAL:g} on (red rings) something is missing."
        f"{deep}",
        maps_figure(case.project, case.receivers, sizes, MATERIAL, found=found, points=points),
    )
    yield _time_frequency(made, summary)


def _time_frequency(made, summary):
    """Draw the worst record over time and frequency."""
    case, fits = made.scene.case, _fits(made)
    chi_square = made.search.none.chi_square
    b, r = np.unravel_index(np.argmax(chi_square), chi_square.shape)
    band = case.band
    recorded = case.in_band(case.motion)
    missed = {title: recorded - case.in_band(fit.motion) for title, fit in fits.items()}
    k = int(np.argmax(np.sum(missed[BEFORE][b, r] ** 2, axis=-1)))
    located = summary["located"]
    return (
        "In time and frequency",
        f"The worst record, {case.blasts[b]} at {case.receivers[r]}, component {COMPONENTS[k]}: "
        "what was recorded, and what the simulation misses of it. The frame holds the middle 80 % "
        "of the misfit of all records, in time and in frequency.",
        diagnosis_figures.time_frequency_figure(
            recorded[b, r, k],
            {f"missed, {title}": part[b, r, k] for title, part in missed.items()},
            case.dt,
            (max(band.low, 1.0 / case.duration), band.high),
            (located["time_s"], located["frequency_hz"]),
        ),
    )


def _rank_figures(made, summary):
    """Draw the evidence of all effects that were fitted."""
    rows = ranking_rows(made)
    if not rows:
        return
    evidence = summary["evidence"]
    yield (
        "Evidence",
        "How much better the records are explained with an effect than without, its freedom paid "
        "for. 2.3 nats make it ten times as likely. What chance finds: the largest evidence in "
        "residuals that were shuffled among receivers, exceeded by 5 % of the trials; the band is "
        "its 90 % interval. Orange: what the outcome rests on.",
        diagnosis_figures.ranking_figure(
            [(row["name"], row["worth"]) for row in rows],
            needed(summary),
            evidence["threshold_interval"],
            {n for n, row in enumerate(rows) if row["chosen"]},
        ),
    )


def _hole_figures(fit):
    """Draw the values of single holes."""
    for row in diagnosis_words.hole_rows(fit):
        unit = f"  {row['unit']}" if row["unit"] else ""
        yield (
            f"{row['label']}: {row['knob']} of {row['where']}",
            "Each hole with its 90 % interval.",
            diagnosis_figures.holes_figure(row["values"], row["believed"], f"{row['knob']}{unit}"),
        )


def _proof_figures(made):
    """Draw records that were left out of the fits; without effects, the worst of all records."""
    case, none = made.scene.case, made.search.none
    if not _has_effect(made):
        r = int(np.argmax(means(none.chi_square, 0)))
        yield (
            f"Receiver {case.receivers[r]}",
            "The receiver that is explained worst: recorded and calibrated, in the band that is "
            "compared.",
            _compared(made, _blasts_at(case, r), {BEFORE: case.in_band(none.motion)}),
        )
        return
    folds = {fold.name for fold in made.verdict.held_out.folds} if made.verdict.held_out else set()
    for name, places, out in _left_out(made, folds):
        motions = {title: foretold(made.scene, fit, out) for title, fit in _fits(made).items()}
        yield (
            f"{name[0].upper()}{name[1:]} left out",
            f"Recorded, and foretold by fits in which {name} had no part: the calibrated site, and "
            "the site with what was found. In the band that is compared.",
            _compared(made, places, motions),
        )


def _left_out(made, folds):
    """Yield the folds to show: (name, records to draw, mask of what is left out)."""
    case, size = made.scene.case, made.search.none.chi_square
    blasts = [b for b, name in enumerate(case.blasts) if name in folds]
    receivers = [r for r, name in enumerate(case.receivers) if name in folds]
    if blasts:
        b, out = blasts[-1], np.zeros(size.shape, dtype=bool)
        out[b] = True
        worst = np.argsort(-size[b])[:COLUMNS]
        yield f"blast {case.blasts[b]}", [(b, int(r)) for r in sorted(worst)], out
    if receivers:
        r = max(receivers, key=lambda r: size[:, r].mean())
        out = np.zeros(size.shape, dtype=bool)
        out[:, r] = True
        yield f"receiver {case.receivers[r]}", _blasts_at(case, r), out


def _blasts_at(case, r):
    """Return the largest blasts at one receiver."""
    return [(b, r) for b in range(len(case.blasts))][-COLUMNS:]


def _compared(made, places, motions):
    """Draw recorded motion and others at some records."""
    case = made.scene.case
    parts = {"recorded": case.in_band(case.motion), **motions}
    columns = [
        (f"{case.blasts[b]} at {case.receivers[r]}", {k: v[b, r] for k, v in parts.items()})
        for b, r in places
    ]
    return diagnosis_figures.compared_figure(columns, case.dt)
