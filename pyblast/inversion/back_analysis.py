"""Back-analysis: from recorded motion to the values of unknowns, confirmed by a full run."""

import math
from dataclasses import dataclass

from ..errors import InputError
from ..motion.comparison import Comparison, compare
from ..motion.seismogram import Seismogram
from ..projects.census import input_band
from ..projects.project import Project
from ..residuals.misfits import MISFITS, SIGNED
from .blasts import blasts_of, candidates_of, chosen_records, foreseen_blasts
from .forward import Target, band_of, held_step, misfit_of
from .insensitive import insensitive, weakest
from .methods import METHODS
from .parameters import Parameter, check_parameters, parameters_of, with_values
from .plan import Plan, Slip, make_plan, problem_of
from .posterior import Posterior
from .searching import Trace
from .strength import Strength, watched_run
from .waveforms import make_waveforms

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
        return {p.path: value for p, value in zip(self.target.parameters, row, strict=True)}

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
        parameter.path: text
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
        levels=None if waves is None else waves.whitener.levels,
    )  # fmt: skip
