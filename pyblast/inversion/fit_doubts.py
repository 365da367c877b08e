"""What is doubtful about values that a back-analysis found, in numbers: D31 to D34."""

import numpy as np
from scipy import stats

from ..motion.comparison import in_common
from ..projects.findings import Finding
from ..residuals.levels import PRIORS
from .forward import band_of

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
        f"{one.path} at the {end} one, {getattr(one, end):g}"
        for one, end in ends.items()
        if end and one.path not in found.insensitive
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
