"""Back-analysis of a project: target, result, confirmation by a full run."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..errors import InputError, PyblastError
from ..inference.gauss_newton import levenberg_search
from ..inference.global_search import (
    paper,
    paper_eq15,
    random_search,
)
from ..inference.misfits import MISFITS, SIGNED
from ..inference.parameter import Parameter, SearchMethod, Trace, set_all
from ..project.project import Project
from ..signals.comparison import Comparison, compare
from ..signals.seismogram import Seismogram
from ..solver.slip import JointSlip, Slip, run_with_slip
from .fit import Fit
from .identifiability import reason_without_slip, weakest
from .parameters import (
    all_blasts,
    blasts_of,
    candidate_blasts,
    check_parameters,
    common_time_step,
    fitted_blasts,
    left_out,
    parameters_of,
    table_of,
)
from .survey_design import SurveyDesign, constraint_of, ranges_of, survey_design_at
from .trials import Target, misfit_of
from .waveforms import recorded_waveforms

METHODS: dict[str, SearchMethod] = {
    "paper": paper,
    "paper_eq15": paper_eq15,
    "random": random_search,
    "levenberg": levenberg_search,
}


AT_BOUND = 0.01  # of the range, on its scale


@dataclass(frozen=True, eq=False)
class Confirmed:
    """The full run of the best point, for one blast.

    Parameters
    ----------
    simulated, recorded : dict of str to Seismogram
    comparisons : dict of str to Comparison
        By receiver.
    strength : dict of str to JointSlip
        By joint surface.
    """

    simulated: dict[str, Seismogram]
    recorded: dict[str, Seismogram]
    comparisons: dict[str, Comparison]
    strength: dict[str, JointSlip]

    @property
    def factor(self) -> float:
        """Factor on the blast at which the first contact would slip."""
        return min((strength.factor for strength in self.strength.values()), default=math.inf)


@dataclass(frozen=True, eq=False)
class BackAnalysis:
    """Result of a back-analysis.

    Parameters
    ----------
    target : Target
    method : str
    seed : int
    trace : Trace
    confirmed : dict of str to Confirmed
        By the file name of the blast's project.
    misfit : float
        Of the full runs at the best point, each with its own time step.
    unidentifiable : dict of str to str
        Strengths that are not identifiable because nothing slipped, and why.
    plan : SurveyDesign, optional
        Identifiability around the best point, and gains of further receivers and blasts; not of a
        fit of waveforms.
    fit : Fit, optional
        Of waveforms: intervals, what is held, convergence.
    missing : tuple of str
        Parts that could not be made, and why.
    seconds : float
        Of computing, of the runs of the search.
    """

    target: Target
    method: str
    seed: int
    trace: Trace
    confirmed: dict[str, Confirmed]
    misfit: float
    unidentifiable: dict[str, str]
    plan: SurveyDesign | None
    fit: Fit | None = None
    missing: tuple[str, ...] = ()
    seconds: float = 0.0

    @property
    def runs(self) -> int:
        """Evaluations of the search."""
        return len(self.trace.misfits) if self.fit is None else self.fit.runs

    @property
    def best_point(self) -> np.ndarray:
        """Values of the parameters, (n,): the best run, or the posterior mean of a fit."""
        if self.fit is not None:
            values = self.fit.values()
            return np.array([values[parameter.name] for parameter in self.target.parameters])
        return self.trace.points[self.trace.best]

    @property
    def best(self) -> dict[str, float]:
        """Best values of the parameters, by path, in the units of their keys."""
        row = self.best_point.tolist()
        return {p.name: value for p, value in zip(self.target.parameters, row, strict=True)}

    @property
    def project(self) -> Project:
        """The project with the best values."""
        return set_all(self.target.projects[0], self.target.parameters, self.best_point)

    def within(self, number: int) -> tuple[float, float] | None:
        """Return the 90 % interval of a parameter; None where there is none."""
        parameter = self.target.parameters[number]
        if parameter.name in self.unidentifiable:
            return None
        if self.fit is not None:
            return self.fit.intervals()[parameter.name]
        return None if self.plan is None else tuple(self.plan.within[number].tolist())

    def constraint(self, number: int) -> str:
        """Return how well a parameter is constrained; nothing where that is not known.

        Where the search has not ended, or the model lacks something, no value is called well
        constrained.
        """
        name = self.target.parameters[number].name
        if name in self.unidentifiable:
            return "not identifiable"
        if self.fit is None:
            return "" if self.plan is None else self.plan.constraint(number)
        if self.fit.lacking:
            return "not to be relied on: the model lacks something"
        if not self.fit.converged:
            return "not to be relied on: the search has not ended"
        return constraint_of(self.fit.ratios()[name])

    def at_bound(self, parameter: Parameter) -> str:
        """Return "low" or "high" where the best value lies at a bound, else nothing."""
        parameters = self.target.parameters
        unit = ranges_of(parameters).unit(self.best_point)
        share = unit[parameters.index(parameter)]
        return "low" if share < AT_BOUND else "high" if share > 1.0 - AT_BOUND else ""


def make_target(project: Project) -> Target:
    """Return the target of table ``[back_analysis]`` of a project: records, parameters, misfit.

    Raises
    ------
    InputError
        If it is missing, or a name in it is unknown.
    """
    parameters = parameters_of(project)
    table, where = table_of(project)
    for key, known in (("method", METHODS), ("misfit", MISFITS)):
        if getattr(table, key) not in known:
            raise InputError(
                f"{where}.{key}: must be one of {', '.join(known)}, got {getattr(table, key)!r}"
            )
    if table.method == "levenberg" and table.misfit not in SIGNED:
        raise InputError(
            f"{where}.method: 'levenberg' needs residuals, and misfit '{table.misfit}' has "
            "none; take 'random'"
        )
    for blast in blasts_of(project):
        check_parameters(blast, parameters)
    blasts, _ = fitted_blasts(project)
    steps = tuple(common_time_step(blast, parameters) for blast in blasts)
    if table.misfit == "waveform" and table.method != "levenberg":
        raise InputError(
            f"{where}.method: misfit 'waveform' is fitted by 'levenberg', got {table.method!r}; "
            "leave method out, or give another misfit"
        )
    if table.misfit == "waveform":
        records = recorded_waveforms(blasts)
        unused = records.unused
    else:
        survey = replace(project.survey, shots=tuple(blast.shots[0] for blast in blasts))
        records, unused = None, survey.named(left_out(blasts, table.receivers))
    receivers = tuple(table.receivers)
    return Target(blasts, parameters, receivers, table.misfit, steps, unused, records)


def is_recorded(project: Project) -> bool:
    """Tell whether a project has records for its back-analysis.

    Raises
    ------
    InputError
        If its table is not valid.
    """
    if project.recorded:
        make_target(project)
        return True
    parameters = parameters_of(project)
    for blast in all_blasts(project):
        check_parameters(blast, parameters)
    return False


def confirm(result: BackAnalysis, projects: Sequence[Project], progress=None) -> BackAnalysis:
    """Confirm the best values by a full run with its own time step, with slip.

    Parameters
    ----------
    result : BackAnalysis
        Of a search, not confirmed.
    projects : sequence of Project
        Blasts that are run: those of the target, or these on the mesh of a fit.
    progress : callable, optional

    Raises
    ------
    SolverError
        If no point could be run, or this one can't.
    """
    target, confirmed = result.target, {}
    for project in projects:
        varied = set_all(project, target.parameters, result.best_point)
        weak = weakest(project, target.parameters, result.best_point)
        run, strength = run_with_slip(
            varied.model, varied.duration, varied.shot.highest_frequency, weak, progress
        )
        simulated = varied.simulated(run.seismograms)
        recorded = target.recorded(project)
        comparisons = {
            name: compare(record, simulated[name], project.compared_band)
            for name, record in recorded.items()
        }
        confirmed[project.path.name] = Confirmed(simulated, recorded, comparisons, strength)
    misfit, _ = misfit_of(target, [blast.simulated for blast in confirmed.values()])
    strengths = [blast.strength for blast in confirmed.values()]
    reasons = {
        parameter.name: text
        for parameter in target.parameters
        if (text := reason_without_slip(parameter, target.projects, strengths))
    }
    return replace(result, confirmed=confirmed, misfit=misfit, unidentifiable=reasons)


def with_plan(result: BackAnalysis, progress=None) -> BackAnalysis:
    """Add the survey design around the best values; what fails costs the plan alone."""
    target = result.target
    slip = {
        name: Slip(blast.strength, {n: s.ppv for n, s in blast.simulated.items()})
        for name, blast in result.confirmed.items()
    }
    unit = ranges_of(target.parameters).unit(result.best_point)
    try:
        plan = survey_design_at(
            target.projects, target.parameters, unit,
            records=[target.recorded(project) for project in target.projects],
            candidates=candidate_blasts(target.projects[0]), slip=slip, progress=progress,
        )  # fmt: skip
    except PyblastError as error:
        return replace(result, missing=(*result.missing, f"survey plan and intervals: {error}"))
    return replace(result, plan=plan)
