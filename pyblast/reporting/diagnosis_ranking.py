"""Which effects were tried, how they rank, and which these records can't tell apart, in words."""

from ..diagnosis.fitting import GROWS
from ..diagnosis.mesh_control import CLAIM, RESOLUTION, SETTLED_BY
from .diagnosis_words import listed


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
    return max(summary["evidence"]["threshold"] or 0.0, GROWS)


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
