"""Findings about a back-analysis, before and after it."""

import math

import numpy as np
from scipy import stats

from ..errors import Finding
from ..inference.covariance import PRIORS
from ..inference.global_search import PAPER, paper, paper_eq15, random_search
from ..inference.parameter import Problem
from ..inference.records import band_functions
from ..signals.comparison import in_common
from .parameters import blasts_of, chosen_records
from .trials import band_of
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


RARE = 0.01  # chance of a larger level, as far as is known before the records
FROM_THE_MIDDLE = ("levenberg", "paper")  # methods that begin there
AGAINST = 0.7  # correlation of a component with the simulation turned upside down


def fit_doubts(found) -> list[Finding]:
    """Return the findings about the values of a `BackAnalysis`.

    A search that has not left its start, values at a bound, errors of the theory that are too large
    to be small, and components that run against the simulation.
    """
    return [*_unmoved(found), *_at_bounds(found), *_large_errors(found), *_turned(found)]


def _unmoved(found):
    """D34: a search that ended before it had left its start."""
    trace = found.trace
    beside = len(found.target.parameters) if found.method == "levenberg" else 0  # derivatives
    if found.method in FROM_THE_MIDDLE and trace.best <= beside:
        yield Finding(
            "D34",
            "The search has not left its start",
            f"The best of {len(trace.misfits)} runs is number {trace.best + 1}, the start or a "
            "step beside it, so values and intervals are those of the middle of the ranges. Give "
            "more back_analysis.runs; if that does not help, records and model disagree.",
        )


def _at_bounds(found):
    """D31: values that end where their range does."""
    ends = {one: found.at_bound(one) for one in found.target.parameters}
    told = [
        f"{one.name} at the {end} one, {getattr(one, end):g}"
        for one, end in ends.items()
        if end and one.name not in found.insensitive
    ]
    if told:
        yield Finding(
            "D31",
            "A value lies at a bound",
            f"{'; '.join(told)}. The range ends it and not the records: widen the range.",
        )


def _large_errors(found):
    """D32: errors of the theory that the residual makes larger than such errors are."""
    if found.target.waveforms is None:
        return
    ratios = {name: level / PRIORS[name].level for name, level in found.plan.levels.items()}
    large = {name: ratio for name, ratio in ratios.items() if ratio > _most(PRIORS[name].weight)}
    if large:
        told = ", ".join(f"{name} {ratio:.1f}" for name, ratio in large.items())
        yield Finding(
            "D32",
            "What is left is too large for small errors of the theory",
            f"Times the usual size: {told}. Errors so large let nearly anything fit: a misfit near "
            "1 says little, and values make up for what is wrong. Look for a component that is "
            "turned or scaled, a clock, a place; `pyblast diagnose` tells them apart.",
            numbers=large,
        )


def _most(weight):
    """Return the ratio of a level to what was known of it that is `RARE`."""
    return float(np.sqrt(weight / stats.chi2.ppf(RARE, weight)))


def _turned(found):
    """D33: components that run against the simulation."""
    numbers = {}
    for project in found.target.projects:
        one = found.confirmed[project.path.name]
        for receiver, record in one.recorded.items():
            together = _correlation(record, one.simulated[receiver], band_of(project))
            for component, value in zip(record.components, together, strict=True):
                if value < -AGAINST:
                    numbers[f"{project.path.name}, {receiver}, {component}"] = float(value)
    if numbers:
        told = "; ".join(f"{name} {value:.2f}" for name, value in numbers.items())
        yield Finding(
            "D33",
            "A component runs against the simulation",
            f"Correlation at equal times: {told}. If the sensor was wired the other way round, "
            "turn the component; else leave its receiver out (back_analysis.receivers).",
            numbers=numbers,
        )


def _correlation(record, simulated, band):
    """Return the correlation of each component at equal times, (3,); NaN where one is silent."""
    data, model = (one.velocity for one in in_common(record, simulated, band))
    size = np.sqrt(np.sum(data**2, axis=0) * np.sum(model**2, axis=0))
    return np.sum(data * model, axis=0) / np.where(size > 0.0, size, np.nan)
