"""Back-analysis of a project: search by a named method, uncertainty, result."""

import math
from dataclasses import dataclass, replace

import numpy as np

from ..errors import InputError
from ..inference.gauss_newton import levenberg_search
from ..inference.gaussian_process import surrogate_search
from ..inference.global_search import (
    Search,
    Trace,
    adaptive_annealing,
    evolution_search,
    paper,
    paper_eq15,
    random_search,
    sobol_search,
)
from ..inference.misfits import MISFITS, SIGNED
from ..inference.parameter import Parameter
from ..inference.posterior import Posterior, emcee_library, posterior
from ..project.inputs import input_band
from ..project.project import Project
from ..signals.comparison import Comparison, compare
from ..signals.seismogram import Seismogram
from .identifiability import UNIFORM
from .mesh_error import mesh_errors_of
from .parameters import (
    blasts_of,
    candidates_of,
    check_parameters,
    chosen_records,
    foreseen_blasts,
    parameters_of,
    with_values,
)
from .slip import Strength, insensitive, watched_run, weakest
from .survey_design import Plan, Slip, make_plan, problem_of
from .trials import Target, Trials, band_of, held_step, misfit_of
from .waveforms import make_waveforms

NEAREST = 3  # runs for each parameter from which the derivatives of the motion are estimated


def update_covariance(trials: Trials, point):
    """Take the model error beside the simulation at a point from now on.

    Parameters
    ----------
    trials : Trials
        Of waveforms; all that was run gets its misfit anew.
    point : (n,) float64
        One that was run.

    Notes
    -----
    theory.md (7.13) to (7.19), levels inferred from the residual there beside what the parameters
    may have taken on themselves, the mesh error where another mesh can be made; else
    `Waveforms.mesh_doubt` says why not.
    """
    target = trials.target
    waves, values = target.waveforms, np.asarray(point, dtype=np.float64).tolist()
    row = next(row for row in trials.log.rows if row["values"] == values)
    recorded = waves.records.in_band(waves.records.motion)
    simulated = recorded - waves.motion_of(row["residuals"])
    projects = [with_values(project, target.parameters, values) for project in target.projects]
    errors, doubt = mesh_errors_of(projects, simulated, waves.records.receivers, waves.window)
    updated = waves.with_model_error(row["residuals"], errors, _moved(trials, values), doubt)
    trials.target = replace(target, waveforms=updated)


def _moved(trials, values):
    """Return what one standard deviation of each range moves, (n, n_data), by the runs nearby."""
    unit = trials.problem().unit
    rows = [row for row in trials.log.rows[: trials.count] if len(row["residuals"])]
    away = np.array([unit(np.array(row["values"])) for row in rows]) - unit(np.array(values))
    near = np.argsort(np.sum(away**2, axis=1), kind="stable")[: NEAREST * len(values) + 1]
    residuals = np.array([rows[n]["residuals"] for n in near])
    return -UNIFORM * np.linalg.lstsq(away[near], residuals - residuals[0], rcond=None)[0]


LAST = 3  # of so many runs one is kept for the covariance that the others taught
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
    """Search by a method; waveforms in two turns.

    Of waveforms the best of the first two thirds tells how the errors of the theory look and how
    large they are. By these all that was run is judged anew, least squares goes on from the best,
    and what it finds shapes the errors by which the whole trace is judged at last.

    Parameters
    ----------
    trials : Trials
    method : str
        Of `METHODS`.
    runs, seed : int
    """
    problem = trials.problem()
    last = 0 if trials.target.waveforms is None else runs // LAST
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


TURNS, RUNS = 2, 24  # searches, each from the last best, before draws begin


def refuse_unready(table, where):
    """Refuse a posterior that could not be drawn, before anything is run.

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


def uncertain(trials: Trials, best, seed: int) -> Posterior:
    """Draw from the posterior of a project's unknowns with full runs, all of them logged.

    Parameters
    ----------
    trials : Trials
        Of a search by waveforms that is done; its covariance becomes that beside the best point.
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
    theory.md (12.9) to (12.12). The covariance is shaped by the best point, whose search goes on
    with it, twice. Where the error of the mesh could not be foreseen, the result says so.
    """
    for _ in range(TURNS):
        update_covariance(trials, best)
        problem = trials.problem()
        trace = levenberg_search(problem, RUNS, seed, problem.unit(best))
        best = trace.points[trace.best]
    drawn = posterior(trials.problem(), best, seed)
    return replace(drawn, mesh_doubt=trials.target.waveforms.mesh_doubt)


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
        """How many times stronger the blast would have to be for a first contact to slip."""
        return min((one.factor for one in self.strength.values()), default=math.inf)


@dataclass(frozen=True, eq=False)
class BackAnalysis:
    """What a back-analysis found.

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
    insensitive : dict of str to str
        Parameters that the records can't tell because nothing slipped, and why.
    plan : Plan
        What the records can tell around the best point, and what more would.
    posterior : Posterior, optional
        Draws from what records and ranges leave, where they were asked for.
    """

    target: Target
    method: str
    seed: int
    trace: Trace
    confirmed: dict[str, Confirmed]
    misfit: float
    insensitive: dict[str, str]
    plan: Plan
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
        unit = problem_of(parameters).unit(self.trace.points[self.trace.best])
        share = unit[parameters.index(parameter)]
        return "low" if share < AT_BOUND else "high" if share > 1.0 - AT_BOUND else ""


def make_target(project: Project) -> Target:
    """Return what table ``[back_analysis]`` of a project asks for.

    Raises
    ------
    InputError
        If it is missing, or names what is not there.
    """
    parameters = parameters_of(project)
    table, where = project.config.back_analysis, f"{project.path.name}: back_analysis"
    for key, known in (("method", METHODS), ("misfit", MISFITS)):
        if getattr(table, key) not in known:
            raise InputError(
                f"{where}.{key}: must be one of {', '.join(known)}, got {getattr(table, key)!r}"
            )
    if table.method == "levenberg" and table.misfit not in SIGNED:
        raise InputError(
            f"{where}.method: 'levenberg' needs residuals, which misfit '{table.misfit}' has none "
            "of; take 'surrogate'"
        )
    blasts = blasts_of(project)
    for blast in blasts:
        check_parameters(blast, parameters)
    steps = tuple(held_step(blast, parameters) for blast in blasts)
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
        If its table could not be searched, with records or without.
    """
    if project.recorded:
        make_target(project)
        return True
    parameters = parameters_of(project)
    for blast in foreseen_blasts(project):
        check_parameters(blast, parameters)
    return False


def confirm(target: Target, method, seed, trace: Trace, progress=None) -> BackAnalysis:
    """Run the best point in full, with its own time step, and see whether strength mattered.

    Raises
    ------
    SolverError
        If no point could be run, or this one can't.
    """
    best, confirmed = trace.points[trace.best], {}
    for project in target.projects:
        varied = with_values(project, target.parameters, best)
        weak = weakest(project, target.parameters, best)
        run, strength = watched_run(
            varied.model, varied.duration, input_band(varied), weak, progress
        )
        simulated = {name: s.shifted(-varied.lead) for name, s in run.seismograms.items()}
        recorded = target.recorded(project)
        comparisons = {
            name: compare(record, simulated[name], band_of(project))
            for name, record in recorded.items()
        }
        confirmed[project.path.name] = Confirmed(simulated, recorded, comparisons, strength)
    misfit, _ = misfit_of(target, [one.simulated for one in confirmed.values()])
    strengths = [one.strength for one in confirmed.values()]
    told = {
        parameter.name: text
        for parameter in target.parameters
        if (text := insensitive(parameter, target.projects, strengths))
    }
    plan = _plan_at(target, best, confirmed, progress)
    return BackAnalysis(target, method, seed, trace, confirmed, misfit, told, plan)


def _plan_at(target, best, confirmed, progress):
    """Return what the records can tell around the best point."""
    waves = target.waveforms
    slip = {
        name: Slip(one.strength, {n: s.ppv for n, s in one.simulated.items()})
        for name, one in confirmed.items()
    }
    return make_plan(
        target.projects, target.parameters, problem_of(target.parameters).unit(best),
        records=[target.recorded(project) for project in target.projects],
        candidates=candidates_of(target.projects[0]), slip=slip, progress=progress,
        levels=None if waves is None else waves.likelihood.covariance.levels,
    )  # fmt: skip
