"""What is doubtful about a back-analysis before it is run, in numbers: D10, D14, D15, D35."""

import math

import numpy as np

from ..projects.findings import Finding
from ..residuals.band import band_functions
from .annealing import PAPER, paper, paper_eq15
from .blasts import blasts_of, chosen_records
from .sampling import random_search
from .searching import Problem
from .waveforms import window_of

MANY = 20  # numbers of waveforms for each unknown
NUMBERS = 6  # PPV and dominant frequency of three components
REPEATS = 300
RISES = (10.0, 50.0)  # % of misfit
METHODS = {"temperature of 1000": paper, "equation 15": paper_eq15, "random": random_search}


def doubts(project) -> list[Finding]:
    """Return the findings about the back-analysis of a project; none where it asks for none.

    Data against unknowns, and annealing's own.
    """
    table = project.config.back_analysis
    if table is None:
        return []
    unknowns = len(table.parameters)
    found = []
    if table.misfit == "paper":
        found = [few_numbers(blasts_of(project), unknowns)]
    elif table.misfit == "waveform":
        found = few_waves(blasts_of(project), unknowns)
    found += late_records(blasts_of(project))
    if table.method in ("paper", "paper_eq15"):
        found += [cold_never(table.runs), worse_than_random(unknowns, table.runs)]
    return found


def few_numbers(blasts, unknowns) -> Finding:
    """D10: how many numbers the misfit has for how many unknowns."""
    records = sum(len(chosen_records(blast, blasts[0])) for blast in blasts)
    return Finding(
        "D10",
        "Few numbers for many unknowns",
        f"{NUMBERS * records} numbers (PPV and dominant frequency of three components; records: "
        f"{records}, blasts: {len(blasts)}) for {unknowns} unknowns; the misfit does not use the "
        "rest of the records. Strengths of joints are not identifiable while no "
        "contact slips; the result says the peak velocity at which the first one would.",
        numbers={"numbers": float(NUMBERS * records), "unknowns": float(unknowns)},
    )


def few_waves(blasts, unknowns) -> list[Finding]:
    """D10 of waveforms: how many independent numbers the band leaves of them; none if many."""
    window = window_of(blasts)
    band = band_functions(window.n_samples, window.dt, window.band)
    records = [one for blast in blasts for one in chosen_records(blast, blasts[0]).values()]
    components = int(sum(record.present.sum() for record in records))
    numbers = components * band.n_functions
    if numbers >= MANY * unknowns:
        return []
    low, high = window.band
    told = Finding(
        "D10",
        "Few numbers for many unknowns",
        f"{low:g} to {high:g} Hz leave {band.n_functions} independent numbers of each recorded "
        f"component, {numbers} in all (components: {components}, blasts: {len(blasts)}), for "
        f"{unknowns} unknowns and the errors of the theory beside them; widen run.compare_band_hz "
        "if mesh and records carry more, record longer, or add receivers or blasts. Strengths of "
        "joints are not identifiable while no contact slips.",
        numbers={"numbers": float(numbers), "unknowns": float(unknowns)},
    )
    return [told]


def late_records(blasts) -> list[Finding]:
    """D35: records that begin after the first firing."""
    late = {
        f"{blast.path.name}, {name}": record.start
        for blast in blasts
        for name, record in chosen_records(blast, blasts[0]).items()
        if record.start > 0.0
    }
    if not late:
        return []
    told = "; ".join(f"{name} by {start:.3g} s" for name, start in late.items())
    finding = Finding(
        "D35",
        "A record begins after the first firing",
        f"{told}. What came before is not compared, and its peak may have been missed. If only its "
        "clock is another one, set its start_s; else leave it out of back_analysis.receivers.",
        numbers=late,
    )
    return [finding]


def cold_never(runs) -> Finding:
    """D14: a temperature that never bites, and two values for it."""
    first, last = (PAPER.temperature_of(move) for move in (1, max(1, runs - 1)))
    chances = {rise: [math.exp(-rise / t) for t in (first, last)] for rise in RISES}
    told = ", ".join(
        f"one that is worse by {rise:.0f} % with {a:.2f} at first and {b:.2f} at the end"
        for rise, (a, b) in chances.items()
    )
    return Finding(
        "D14",
        "The temperature of annealing never bites",
        f"From T0 = {PAPER.temperature:g} with misfits below about 100 %, a point is accepted "
        f"nearly always: {told}. Equation (15) of the paper, T0 = Fmax - Fmin, contradicts this "
        "value; method = 'paper_eq15' takes it.",
        numbers={
            f"accept_{rise:.0f}_{end}": chance
            for rise, both in chances.items()
            for end, chance in zip(("first", "last"), both, strict=True)
        },
    )


def worse_than_random(unknowns, runs, repeats=REPEATS) -> Finding:
    """D15: annealing against random search on a bowl with its bottom anywhere.

    The misfit of the bowl is the mean distance to its bottom in per cent of the ranges.
    """
    mean = {name: 0.0 for name in METHODS}
    for repeat in range(repeats):
        bottom = np.random.default_rng([repeat, 1]).random(unknowns)
        bowl = Problem(
            np.zeros(unknowns), np.ones(unknowns), np.zeros(unknowns, dtype=bool),
            lambda points, at=bottom: 100.0 * np.mean(np.abs(points - at), axis=1),
        )  # fmt: skip
        for name, method in METHODS.items():
            mean[name] += float(np.min(method(bowl, runs, repeat).misfits)) / repeats
    listed = ", ".join(f"{name} {value:.1f} %" for name, value in mean.items())
    worse = mean["temperature of 1000"] > mean["random"]
    return Finding(
        "D15",
        f"Annealing is {'worse' if worse else 'better'} than random search of the same length",
        f"On a bowl of {unknowns} unknowns with its bottom anywhere, the mean best of {runs} runs "
        f"in {repeats} repeats is: {listed}. Compare method = 'random'.",
        numbers={name.replace(" ", "_"): value for name, value in mean.items()},
    )
