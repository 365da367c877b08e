"""Back-analysis of a project: search by a named method, uncertainty, result."""

import math
from dataclasses import dataclass, replace

import numpy as np

from ..errors import InputError
from ..inference.gauss_newton import levenberg_search
from ..inference.global_search import (
    adaptive_annealing,
    evolution_search,
    paper,
    paper_eq15,
    random_search,
    sobol_search,
    surrogate_search,
)
from ..inference.likelihood import MISFITS, SIGNED
from ..inference.parameter import Parameter, Search, Trace
from ..inference.posterior import Posterior, emcee_library, posterior
from ..project.inputs import input_band
from ..project.project import Project
from ..signals.comparison import Comparison, compare
from ..signals.seismogram import Seismogram
from .identifiability import UNIFORM, Slip, Strength, reason_without_slip, run_with_slip, weakest
from .parameters import (
    all_blasts,
    blasts_of,
    candidate_blasts,
    check_parameters,
    chosen_records,
    common_time_step,
    fitted_blasts,
    parameters_of,
    table_of,
    with_values,
)
from .survey_design import SurveyDesign, ranges_of, survey_design_at
from .trials import Target, Trials, misfit_of, waveforms_of
from .waveforms import make_waveforms, mesh_errors_of

NEAREST = 3  # runs for each parameter in the regression for the derivatives of the motion


def update_covariance(trials: Trials, point):
    """Update the covariance: the model error takes the waveform of the simulation at a point.

    Parameters
    ----------
    trials : Trials
        Of waveforms; the misfits of all runs change.
    point : (n,) float64
        One that was run.

    Notes
    -----
    theory.md (7.13) to (7.19). The levels are inferred from the residual there by a restricted
    likelihood, since the parameters were fitted to the same records. The mesh error is included
    where a coarser mesh is possible; `Waveforms.mesh_error_missing` states why not.
    """
    target = trials.target
    waves, values = waveforms_of(target), np.asarray(point, dtype=np.float64).tolist()
    row = next(row for row in trials.log.rows if row["values"] == values)
    recorded = waves.records.in_band(waves.records.motion)
    simulated = recorded - waves.motion_of(row["residuals"])
    projects = [with_values(project, target.parameters, values) for project in target.projects]
    errors, missing = mesh_errors_of(projects, simulated, waves.records.receivers, waves.window)
    updated = waves.with_model_error(
        row["residuals"], errors, _changes_nearby(trials, values), missing
    )
    trials.target = replace(target, waveforms=updated)


def _changes_nearby(trials, values):
    """Return changes (n, n_data) by a standard deviation of each range, regressed on near runs."""
    unit = trials.problem().unit
    rows = [row for row in trials.log.rows[: trials.count] if len(row["residuals"])]
    away = np.array([unit(np.array(row["values"])) for row in rows]) - unit(np.array(values))
    near = np.argsort(np.sum(away**2, axis=1), kind="stable")[: NEAREST * len(values) + 1]
    residuals = np.array([rows[n]["residuals"] for n in near])
    return -UNIFORM * np.linalg.lstsq(away[near], residuals - residuals[0], rcond=None)[0]


SECOND_STAGE = 3  # one over the share of runs after the update of the covariance

METHODS: dict[str, Search] = {
    "paper": paper,
    "paper_eq15": paper_eq15,
    "random": random_search,
    "sobol": sobol_search,
    "adaptive": adaptive_annealing,
    "evolution": evolution_search,
    "surrogate": surrogate_search,
    "levenberg": levenberg_search,
}


def search(trials: Trials, method: str, runs: int, seed: int) -> Trace:
    """Search by a method; for waveforms in two stages.

    After two thirds of the runs the model error is estimated at the best point. With it all
    misfits are evaluated again, Gauss-Newton continues from the best point, and the model error at
    its result gives the final misfits of the whole trace.

    Parameters
    ----------
    trials : Trials
    method : str
        Of `METHODS`.
    runs, seed : int
    """
    problem = trials.problem()
    last = 0 if trials.target.waveforms is None else runs // SECOND_STAGE
    first = METHODS[method](problem, runs - last, seed)
    if not last or not np.isfinite(first.misfits[first.best]):
        return first
    update_covariance(trials, first.points[first.best])
    best = int(np.argmin(trials.misfits()))
    start = problem.unit(first.points[best])
    second = levenberg_search(trials.problem(), last, seed, start)
    points = np.concatenate([first.points, second.points])
    update_covariance(trials, points[int(np.argmin(trials.misfits()))])
    return Trace(
        points,
        trials.misfits(),
        np.concatenate([first.accepted, second.accepted]),
    )


ROUNDS, RUNS = 2, 24  # searches before sampling, each from the last best point


def check_posterior_table(table, where):
    """Check before the first run that a posterior can be sampled.

    Raises
    ------
    InputError
        If the misfit has no covariance, or emcee is not installed.
    """
    if not table.posterior:
        return
    if table.misfit != "waveform":
        raise InputError(
            f"{where}.posterior: needs misfit 'waveform', whose residuals have a covariance, got "
            f"{table.misfit!r}"
        )
    emcee_library()


def draw_posterior(trials: Trials, best, seed: int) -> Posterior:
    """Draw samples from the posterior of the parameters by full runs, all of them logged.

    Parameters
    ----------
    trials : Trials
        Of a finished search by waveforms; its covariance is updated at the best point.
    best : (n,) float64
        A point that was run.
    seed : int

    Returns
    -------
    Posterior

    Raises
    ------
    SolverError
        If too few points could be run, or a worker was lost.

    Notes
    -----
    theory.md (12.9) to (12.12). Twice, the covariance is updated at the best point and the search
    continues with it. If the mesh error is missing, the result states it.
    """
    for _ in range(ROUNDS):
        update_covariance(trials, best)
        problem = trials.problem()
        trace = levenberg_search(problem, RUNS, seed, problem.unit(best))
        best = trace.points[trace.best]
    drawn = posterior(trials.problem(), best, seed)
    return replace(drawn, mesh_error_missing=waveforms_of(trials.target).mesh_error_missing)


AT_BOUND = 0.01  # of the range, on its scale


@dataclass(frozen=True, eq=False)
class Confirmed:
    """The full run of the best point, for one blast.

    Parameters
    ----------
    simulated, recorded : dict of str to Seismogram
    comparisons : dict of str to Comparison
        By receiver.
    strength : dict of str to Strength
        By joint surface.
    """

    simulated: dict[str, Seismogram]
    recorded: dict[str, Seismogram]
    comparisons: dict[str, Comparison]
    strength: dict[str, Strength]

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
    plan : SurveyDesign
        Identifiability around the best point, and gains of further receivers and blasts.
    posterior : Posterior, optional
        Samples, if the table asks for them.
    """

    target: Target
    method: str
    seed: int
    trace: Trace
    confirmed: dict[str, Confirmed]
    misfit: float
    unidentifiable: dict[str, str]
    plan: SurveyDesign
    posterior: Posterior | None = None

    @property
    def best(self) -> dict[str, float]:
        """Values of the parameters at the best point, by path, in the units of their keys."""
        row = self.trace.points[self.trace.best].tolist()
        return {p.name: value for p, value in zip(self.target.parameters, row, strict=True)}

    @property
    def project(self) -> Project:
        """The project with the best values."""
        best = self.trace.points[self.trace.best]
        return with_values(self.target.projects[0], self.target.parameters, best)

    def at_bound(self, parameter: Parameter) -> str:
        """Return "low" or "high" where the best value lies at a bound, else nothing."""
        parameters = self.target.parameters
        unit = ranges_of(parameters).unit(self.trace.points[self.trace.best])
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
            "none; take 'surrogate'"
        )
    for blast in blasts_of(project):
        check_parameters(blast, parameters)
    blasts, _ = fitted_blasts(project)
    steps = tuple(common_time_step(blast, parameters) for blast in blasts)
    waveforms = None
    if table.misfit == "waveform":
        rms = None if table.noise_mm_per_s is None else 1e-3 * table.noise_mm_per_s
        records = [chosen_records(blast, project) for blast in blasts]
        waveforms = make_waveforms(blasts, records, rms)
    return Target(blasts, parameters, tuple(table.receivers), table.misfit, steps, waveforms)


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


def confirm(target: Target, method, seed, trace: Trace, progress=None) -> BackAnalysis:
    """Confirm the best point by a full run with its own time step, with slip and survey design.

    Raises
    ------
    SolverError
        If no point could be run, or this one can't.
    """
    best, confirmed = trace.points[trace.best], {}
    for project in target.projects:
        varied = with_values(project, target.parameters, best)
        weak = weakest(project, target.parameters, best)
        run, strength = run_with_slip(
            varied.model, varied.duration, input_band(varied), weak, progress
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
    plan = _plan_at(target, best, confirmed, progress)
    return BackAnalysis(target, method, seed, trace, confirmed, misfit, reasons, plan)


def _plan_at(target, best, confirmed, progress):
    """Return the survey design around the best point."""
    waves = target.waveforms
    slip = {
        name: Slip(blast.strength, {n: s.ppv for n, s in blast.simulated.items()})
        for name, blast in confirmed.items()
    }
    return survey_design_at(
        target.projects, target.parameters, ranges_of(target.parameters).unit(best),
        records=[target.recorded(project) for project in target.projects],
        candidates=candidate_blasts(target.projects[0]), slip=slip, progress=progress,
        levels=None if waves is None else waves.likelihood.covariance.levels,
    )  # fmt: skip
