"""Findings about a back-analysis, before and after it."""

import math

import numpy as np

from ..errors import Finding
from ..inference.global_search import PAPER, paper, paper_eq15, random_search
from ..inference.parameter import Problem
from ..inference.records import band_functions
from ..project.checks_ground import near_source
from ..project.places import source_names
from ..signals.comparison import in_common
from ..solver.injection import near_receivers
from .fit import ENOUGH, HALF, LACK
from .parameters import chosen_records, fitted_blasts, table_of
from .waveforms import window_of

DATA_PER_PARAMETER = 20  # coefficients of waveforms, below which there is a finding
NUMBERS = 6  # PPV and dominant frequency of three components
REPEATS = 300
RISES = (10.0, 50.0)  # % of misfit
METHODS = {"temperature of 1000": paper, "equation 15": paper_eq15, "random": random_search}
STRAINED = 3.0  # prior deviations of a held property that are said
HARDLY = 1.5  # times the model error that good ground explains: above it, but at its edge
FROM_THE_MIDDLE = ("levenberg", "paper")  # methods that start there
REVERSED = -0.7  # correlation with the simulation that indicates reversed polarity


def findings_of_table(project) -> list[Finding]:
    """Return the findings before a back-analysis: its data and its method.

    None where the project has no table ``[back_analysis]``.
    """
    table = project.config.back_analysis
    if table is None:
        return []
    n_parameters, (blasts, carried) = len(table.parameters), fitted_blasts(project)
    findings = []
    if table.misfit == "paper":
        findings = [few_peaks(blasts, n_parameters)]
    elif table.misfit == "waveform":
        findings = few_coefficients(blasts, n_parameters)
    findings += late_records(blasts)
    findings += [] if carried is None else [carried]
    findings += near_source_findings(blasts)
    if table.method in ("paper", "paper_eq15"):
        findings += [hot_annealing(table.runs), annealing_against_random(n_parameters, table.runs)]
    return findings


def near_source_findings(blasts) -> list[Finding]:
    """Return D38 of the first blast that has receivers near a source, which do not count."""
    for blast in blasts:
        names = source_names(blast.model.sources, blast.blast)
        finding = near_source(near_receivers(blast.model), names)
        if finding is not None:
            return [finding]
    return []


def _chosen(blast, blasts):
    """Return the records of one of the blasts that their back-analysis uses."""
    return chosen_records(blast, table_of(blasts[0])[0].receivers)


def few_peaks(blasts, n_parameters) -> Finding:
    """D10: the number of data of misfit ``paper``."""
    records = sum(len(_chosen(blast, blasts)) for blast in blasts)
    return Finding(
        "D10",
        "Few data for the number of parameters",
        f"{NUMBERS * records} numbers (PPV and dominant frequency of three components; records: "
        f"{records}, blasts: {len(blasts)}) for {n_parameters} parameters; the misfit does not use "
        "the rest of the records. Joint strengths are not identifiable while no contact slips; the "
        "result states the peak velocity at which the first one would.",
        numbers={"numbers": float(NUMBERS * records), "parameters": float(n_parameters)},
    )


def few_coefficients(blasts, n_parameters) -> list[Finding]:
    """D10: the number of independent coefficients of the waveforms within the band, if small."""
    window = window_of(blasts)
    band = band_functions(window.n_samples, window.dt, window.band)
    records = [record for blast in blasts for record in _chosen(blast, blasts).values()]
    components = int(sum(record.present.sum() for record in records))
    numbers = components * band.n_functions
    if numbers >= DATA_PER_PARAMETER * n_parameters:
        return []
    low, high = window.band
    finding = Finding(
        "D10",
        "Few data for the number of parameters",
        f"The band of {low:g} to {high:g} Hz holds {band.n_functions} independent coefficients of "
        f"each recorded component, {numbers} in all (components: {components}, blasts: "
        f"{len(blasts)}), for {n_parameters} parameters and the model error. Widen "
        "run.compare_band_hz if mesh and records allow it, record longer, or add receivers or "
        "blasts. Joint strengths are not identifiable while no contact slips.",
        numbers={"numbers": float(numbers), "parameters": float(n_parameters)},
    )
    return [finding]


def late_records(blasts) -> list[Finding]:
    """D35: records that begin more than a sample after the first firing."""
    late = {
        f"{blast.path.name}, {name}": record.start
        for blast in blasts
        for name, record in _chosen(blast, blasts).items()
        if record.start > record.dt
    }
    if not late:
        return []
    listed = "; ".join(f"{name} by {start:.3g} s" for name, start in late.items())
    finding = Finding(
        "D35",
        "A record begins after the first firing",
        f"{listed}. Earlier motion is not compared, and the peak may be missing. If only the clock "
        "differs, set start_s of the record; else leave it out of back_analysis.receivers.",
        numbers=late,
    )
    return [finding]


def hot_annealing(runs) -> Finding:
    """D14: an annealing temperature that accepts nearly every move."""
    first, last = (PAPER.temperature_of(move) for move in (1, max(1, runs - 1)))
    accepted = {rise: [math.exp(-rise / t) for t in (first, last)] for rise in RISES}
    listed = ", ".join(
        f"a rise of {rise:.0f} % with probability {a:.2f} at the start and {b:.2f} at the end"
        for rise, (a, b) in accepted.items()
    )
    return Finding(
        "D14",
        "The annealing temperature accepts nearly every move",
        f"T0 = {PAPER.temperature:g}, and misfits stay below about 100 %: the search accepts "
        f"{listed}. Equation (15) of the paper, T0 = Fmax - Fmin, contradicts this value; "
        "method = 'paper_eq15' uses it.",
        numbers={
            f"accept_{rise:.0f}_{end}": probability
            for rise, both in accepted.items()
            for end, probability in zip(("first", "last"), both, strict=True)
        },
    )


def annealing_against_random(n_parameters, runs, repeats=REPEATS) -> Finding:
    """D15: annealing compared with random search on a test function with a random minimum.

    The misfit of the test function is the mean distance to its minimum in per cent of the ranges.
    """
    mean = {name: 0.0 for name in METHODS}
    for repeat in range(repeats):
        minimum = np.random.default_rng([repeat, 1]).random(n_parameters)
        problem = Problem(
            np.zeros(n_parameters), np.ones(n_parameters), np.zeros(n_parameters, dtype=bool),
            lambda points, at=minimum: 100.0 * np.mean(np.abs(points - at), axis=1),
        )  # fmt: skip
        for name, method in METHODS.items():
            mean[name] += float(np.min(method(problem, runs, repeat).misfits)) / repeats
    listed = ", ".join(f"{name} {value:.1f} %" for name, value in mean.items())
    worse = mean["temperature of 1000"] > mean["random"]
    return Finding(
        "D15",
        f"Annealing is {'worse' if worse else 'better'} than random search of the same length",
        f"Test function of {n_parameters} parameters with its minimum at random: the mean best "
        f"misfit of {runs} runs in {repeats} repeats is {listed}. Compare method = 'random'.",
        numbers={name.replace(" ", "_"): value for name, value in mean.items()},
    )


def findings_of_fit(result) -> list[Finding]:
    """Return the findings after a back-analysis: start, bounds, model error, polarity.

    Parameters
    ----------
    result : BackAnalysis
    """
    return [
        *_unmoved(result), *_at_bounds(result), *_not_converged(result), *_lacking(result),
        *_reversed(result),
    ]  # fmt: skip


def _unmoved(result):
    """D34: a search that ended before it left its start."""
    trace = result.trace
    differences = len(result.target.parameters) if result.method == "levenberg" else 0
    ended = result.fit is None and len(trace.misfits)
    if ended and result.method in FROM_THE_MIDDLE and trace.best <= differences:
        yield Finding(
            "D34",
            "The search has not left its start",
            f"The best of {len(trace.misfits)} runs is number {trace.best + 1}, the start or a "
            "finite-difference step beside it, so values and intervals are those of the middle of "
            "the ranges. Increase back_analysis.runs; if that does not help, records and model "
            "disagree.",
        )


def _at_bounds(result):
    """D31: values at a bound of their range."""
    ends = {parameter: result.at_bound(parameter) for parameter in result.target.parameters}
    listed = [
        f"{parameter.name} at the {end} bound, {getattr(parameter, end):g}"
        for parameter, end in ends.items()
        if end and parameter.name not in result.unidentifiable
    ]
    if not listed:
        return
    fit = result.fit
    if fit is not None and (fit.lacking or not fit.converged):
        why = (
            "D44 says that the model lacks something, and a value then runs away to stand for it: "
            "find what is lacking before another range"
            if fit.lacking
            else "the search has not ended (D43), so this says little yet"
        )
    else:
        why = (
            "Either the range is too narrow, or the value stands for something that the model "
            "lacks: widen the range only where such a value is possible in this ground"
        )
    yield Finding("D31", "A value lies at a bound", f"{'; '.join(listed)}. {why}.")


def _not_converged(result):
    """D43: a fit whose last step was not small, or that explains less than half of the energy."""
    fit = result.fit
    if fit is None or (fit.converged and fit.remaining < HALF):
        return
    numbers = {"last_step": fit.last_step, "remaining": fit.remaining, "runs": float(fit.runs)}
    steps = (
        f"the next step would be {fit.last_step:.2g} standard deviations of a value, and it counts "
        f"as ended below {ENOUGH:g}"
        if not fit.converged
        else f"{100.0 * fit.remaining:.0f} % of the energy of the records is not explained"
    )
    yield Finding(
        "D43",
        "The search has not converged",
        f"After {fit.runs} runs and {fit.starts} starts {steps}. Do not use values and intervals. "
        "A larger back_analysis.runs goes on from here; where that does not help, start nearer: "
        "correct the speeds in the project file from first arrivals, or leave out receivers whose "
        "motion is late by more than half a period.",
        numbers=numbers,
    )


def _lacking(result):
    """D44: learned model error beyond what good ground and mesh explain."""
    fit = result.fit
    if fit is None or not fit.lacking:
        return
    names, pulls = fit.names, fit.posterior.pulls
    held = [n for n in range(len(names)) if n not in fit.sought]
    worst = max(held, key=lambda n: abs(pulls[n]))
    share = 100.0 * float(np.median(fit.posterior.remaining))
    strained = (
        f" {names[worst]} would have to lie {abs(pulls[worst]):.1f} prior deviations from the "
        "project file."
        if abs(pulls[worst]) > STRAINED
        else ""
    )
    if fit.posterior.level < HARDLY * LACK:
        strained += (
            " That is hardly more: firing times that scatter more than [priors] says are enough."
        )
    file = result.target.projects[0].path.name
    yield Finding(
        "D44",
        "The model lacks something that the records show",
        f"The error that is learned from the residual takes {100.0 * fit.posterior.level:.2g} % of "
        f"the energy of the records; where ground and sources are as in the model it is below "
        f"{100.0 * LACK:g} %. Above the noise before the blast {share:.2g} % remain at the median "
        f"receiver.{strained} Values then stand for what is lacking, and their intervals need not "
        f"hold the truth: none is called well constrained. `pyblast diagnose {file}` asks what is "
        "lacking: a closure, slip, another joint, a layer, attenuation, firing times or charges "
        "other than planned, a mistake at a receiver. Priors that are too narrow look alike: see "
        "[priors], as of firing times.",
        numbers={"level": fit.posterior.level, "pull": float(pulls[worst])},
    )


def _reversed(result):
    """D33: components that correlate negatively with the simulation."""
    numbers = {}
    for project in result.target.projects:
        confirmed = result.confirmed.get(project.path.name)
        if confirmed is None:
            continue
        for receiver, record in confirmed.recorded.items():
            values = _correlation(record, confirmed.simulated[receiver], project.compared_band)
            for component, value in zip(record.components, values, strict=True):
                if value < REVERSED:
                    numbers[f"{project.path.name}, {receiver}, {component}"] = float(value)
    if numbers:
        listed = "; ".join(f"{name} {value:.2f}" for name, value in numbers.items())
        yield Finding(
            "D33",
            "A component has the opposite sign of the simulation",
            f"Correlation at equal times: {listed}. If the polarity of the sensor is reversed, "
            "change the sign of the component; else leave its receiver out "
            "(back_analysis.receivers).",
            numbers=numbers,
        )


def _correlation(record, simulated, band):
    """Return the correlation of each component at equal times, (3,); NaN for a zero component."""
    data, model = (motion.velocity for motion in in_common(record, simulated, band))
    size = np.sqrt(np.sum(data**2, axis=0) * np.sum(model**2, axis=0))
    return np.sum(data * model, axis=0) / np.where(size > 0.0, size, np.nan)
