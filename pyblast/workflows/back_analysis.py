"""Back-analysis, survey design, moment rate of a project: search, confirmation, files, report."""

import json
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np

from ..back_analysis.findings import findings_of_fit, findings_of_table
from ..back_analysis.fit import (
    WORK_OF_BETTER,
    Fit,
    Fitter,
    on_mesh_of_band,
)
from ..back_analysis.parameters import range_of, table_of
from ..back_analysis.search import METHODS, BackAnalysis, confirm, make_target, with_plan
from ..back_analysis.survey_design import SurveyDesign, survey_design_of
from ..back_analysis.trials import TrialLog, Trials, identity
from ..back_analysis.waveforms import (
    FINE,
    KNOTS_PER_PERIOD,
    PER_KNOT,
    MomentRateFit,
    fit_moment_rate,
    spline,
)
from ..blasts.hole_effects import Pattern, what_would_tell
from ..config.config import BackAnalysisConfig
from ..errors import Finding, InputError, PyblastError
from ..files import versions, write_summary, write_text
from ..inference.misfits import MISFITS
from ..inference.parameter import Trace
from ..inference.variation import FEWEST
from ..model.source import TimeFunction
from ..project.checks import check
from ..project.level import CODE as LEVEL
from ..project.project import Project, load_project
from ..project.result import comparison_table, motion_table
from ..report.back_analysis import write_search_report
from ..report.survey_design import (
    beside_laboratory,
    slip_lines,
    summarise_survey,
    write_survey_report,
)
from ..report.view import scene
from ..runs.greens import refuse_what_does_not_superpose
from ..runs.parallel import input_hash
from ..signals.comparison import in_common
from ..solver.run import simulate as simulate_model
from . import Interrupted, Progress, Say, new_folder, result_folder, silent

TRIALS = "trials.jsonl"
RUNS = "runs"  # folder of stored runs
RESULT = "back_analysis.json"
SURVEY = "survey.json"


def back_analyse(
    project: Project | str | Path,
    out: str | Path | None = None,
    *,
    fresh: bool = False,
    full: bool = False,
    runs: str | Path | None = None,
    executor: Executor | None = None,
    progress: Progress | None = None,
    say: Say | None = None,
    before: Sequence[Finding] | None = None,
) -> tuple[BackAnalysis, Path]:
    """Back-analyse the parameters that table ``[back_analysis]`` of a project names.

    Parameters
    ----------
    project : Project or path of a project file
    out : path, optional
        Folder that takes numbered folders, one per search; ``back_analysis`` beside the project
        file by default. Earlier results stay. A search of the same input continues if it was
        interrupted, or if more runs or a posterior are requested; its trace is the same.
    fresh : bool
        Start a new search beside an unfinished one.
    full : bool
        Take the table ``[full]`` of the project file.
    runs : path, optional
        Folder of stored runs of a fit of waveforms, which several searches may share; ``runs`` in
        the folder of the result by default.
    executor : concurrent.futures.Executor, optional
        Such as `workers`, or what ``dask.distributed.Client.get_executor`` returns. The result
        does not depend on it.
    progress : callable, optional
        Called with (stage, done, total).
    say : callable, optional
        Called with a sentence when an unfinished search continues.
    before : sequence of Finding, optional
        The result of `findings_before` for the project, if already computed.

    Returns
    -------
    BackAnalysis
    Path
        Folder with ``trials.jsonl``, ``back_analysis.json`` and ``report.html``.

    Raises
    ------
    InputError, ReadError
        If the project or a file of it is wrong.
    SolverError
        If no point could be run, or a worker was lost.
    """
    if not isinstance(project, Project):
        project = load_project(project, full)
    tell = progress or silent
    tell("mesh", 0, 1)
    target, table = make_target(project), project.config.back_analysis
    assert table is not None  # refused above
    before = findings_before(project) if before is None else before
    out = project.folder / "back_analysis" if out is None else Path(out)
    searched = identity(target, table.method, table.seed)

    def unfinished(folder: Path) -> bool:
        return _goes_on(folder, searched["hash"], table)

    with result_folder(out, unfinished, fresh=fresh, say=say) as (folder, goes_on):
        if target.records is None:
            result = _searched(target, table, folder, searched, goes_on, executor, progress)
        else:
            stored = folder / RUNS if runs is None else Path(runs)
            result = _fitted(
                target, table, folder, searched, before, stored, executor, progress, say
            )
        _write(folder, result, before, table, finished=False)
        result = _completed(result, progress)
        tell("writing", 0, 1)
        summary = _write(folder, result, before, table, finished=True)
        try:
            write_search_report(folder / "report.html", summary, result.confirmed, scene(project))
        except Exception as error:  # a page costs itself alone: values and intervals are written
            result = replace(result, missing=(*result.missing, f"report.html: {error}"))
            _write(folder, result, before, table, finished=True)
    return result, folder


def _write(folder, result, before, table, finished) -> dict:
    """Write what is known of a search into its folder, and return it."""
    summary = summarise_search(result, [*before, *findings_of_fit(result)])
    summary |= {"runs_allowed": table.runs, "finished": finished}
    write_summary(folder / RESULT, summary)
    return summary


def _searched(target, table, folder, searched, goes_on, executor, progress) -> BackAnalysis:
    """Search by a method whose misfit has no covariance, every run logged."""
    trial_log = TrialLog(folder / TRIALS, searched, goes_on)
    trials = Trials(target, trial_log, table.runs, executor=executor, progress=progress)
    try:
        trace = METHODS[table.method](trials.problem(), table.runs, table.seed)
    except KeyboardInterrupt:
        raise Interrupted(_kept(trial_log)) from None
    except PyblastError:
        if not trial_log.rows and not goes_on:
            trial_log.path.unlink()
        raise
    misfit = float(trace.misfits[trace.best])
    seconds = sum(row["wall_seconds"] for row in trial_log.rows)
    return BackAnalysis(target, table.method, table.seed, trace, {}, misfit, {}, None,
                        seconds=seconds)  # fmt: skip


def _fitted(
    target, table, folder, searched, before, stored, executor, progress, say
) -> BackAnalysis:
    """Fit waveforms; runs are stored, so that a search goes on whatever its number of runs."""
    records = target.records
    assert records is not None  # else searched
    trial_log = TrialLog(folder / TRIALS, searched)

    def report(row):
        trial_log.add([row])

    blasts = on_mesh_of_band(target.projects, records.band.high)
    fitter = Fitter(
        blasts, records, target.parameters, table.runs, stored, executor, progress, report
    )
    (say or silent)(_estimate(fitter))

    def written(fit):
        _write(folder, result_of_fit(target, table, fit), before, table, finished=False)

    fitter.written = written
    try:
        return result_of_fit(target, table, fitter.fit())
    except KeyboardInterrupt:
        raise Interrupted(_kept(trial_log)) from None


def result_of_fit(target, table, fit) -> BackAnalysis:
    """Return the result of a fit, not confirmed: its steps are the trace."""
    places = [fit.names.index(parameter.name) for parameter in target.parameters]
    points = np.array([
        [float(fit.properties[n].at(row["coordinates"][n])) for n in places]
        for row in fit.trace
    ])  # fmt: skip
    misfits = np.array([row["remaining"] for row in fit.trace])
    trace = Trace(points, misfits, np.ones(len(points), dtype=bool))
    return BackAnalysis(
        target, table.method, table.seed, trace, {}, fit.remaining, {}, None, fit,
        seconds=fit.seconds,
    )  # fmt: skip


def _estimate(fitter) -> str:
    """Return a sentence on how long a fit will take, from the first steps of its model."""
    each, count = fitter.seconds_of_run(), fitter.expected
    working, better = fitter.expected_by_mesh
    seconds = each * (working + WORK_OF_BETTER * better)
    return (
        f"about {count} runs, {seconds:.0f} s of computing one after the other ({each:.2g} s a "
        "run), and more where the start lies far away"
    )


def _kept(trial_log):
    """Return the sentence of a search that was interrupted."""
    return (
        f"{len(trial_log.rows)} evaluations are kept in {trial_log.path}; the same command "
        "continues them"
    )


def _completed(result, progress) -> BackAnalysis:
    """Confirm a result by a full run, and plan further receivers; what fails costs itself."""
    fit, target = result.fit, result.target
    projects = target.projects if fit is None else fit.blasts
    try:
        result = confirm(result, projects, progress)
    except PyblastError as error:
        if fit is None and not np.isfinite(result.misfit):  # no point could be run
            raise
        return replace(result, missing=(f"full run of the best values: {error}",))
    return result if fit is not None else with_plan(result, progress)


def _goes_on(folder: Path, searched: str, table: BackAnalysisConfig) -> bool:
    """Tell whether a folder holds an unfinished search of the same identity."""
    try:
        with (folder / TRIALS).open(encoding="utf-8") as file:
            same = json.loads(file.readline())["hash"] == searched
        if not same or not (folder / RESULT).exists():
            return same
        known = json.loads((folder / RESULT).read_text(encoding="utf-8"))
        return table.runs > known["runs_allowed"] or not known.get("finished")
    except (OSError, ValueError, KeyError, TypeError):
        return False


def findings_before(project: Project) -> list[Finding]:
    """Return the findings before a search: failed checks, the level, then those of the table."""
    table_of(project)  # refused before anything is meshed, if it is missing
    own = findings_of_table(project)
    checked = check(project).findings
    return [*(each for each in checked if each.failed or each.code == LEVEL), *own]


def design_survey(
    project: Project | str | Path,
    out: str | Path | None = None,
    *,
    full: bool = False,
    progress: Progress | None = None,
) -> tuple[SurveyDesign, Path]:
    """Design a survey: which receivers and blasts constrain the parameters, before any record.

    Parameters
    ----------
    project : Project or path of a project file
    out : path, optional
        Folder that takes numbered folders, one per survey; ``survey`` beside the project file by
        default.
    full : bool
        Take the table ``[full]`` of the project file.
    progress : callable, optional
        Called with (stage, done, total).

    Returns
    -------
    SurveyDesign
    Path
        Folder with ``survey.json`` and ``report.html``.

    Raises
    ------
    InputError, ReadError
        If the project or a file of it is wrong.
    SolverError
        If a model can't be run.
    """
    if not isinstance(project, Project):
        project = load_project(project, full)
    plan, table = survey_design_of(project, progress), project.config.back_analysis
    if project.blast is not None and len(project.blast.times) >= FEWEST:
        receivers = np.array([receiver.position for receiver in project.receivers])
        plan = replace(plan, holes=tuple(what_would_tell([Pattern(project.blast, receivers)])))
    folder = new_folder(project.folder / "survey" if out is None else Path(out))
    parts = [[row.name, row.low, row.high, row.log] for row in plan.parameters]
    files = {"project": project.input_files, "parameters": parts}
    summary = {
        "title": project.title,
        "assumed": list(project.config.assumed),
        "blasts": [project.path.name, *(table.blasts if table is not None else ())],
        "plan": summarise_survey(plan),
        "files_sha256": project.input_files,
        "provenance": versions(input_hash("plan", files)),
    }
    write_summary(folder / SURVEY, summary)
    write_survey_report(folder / "report.html", summary)
    return plan, folder


def summarise_search(result: BackAnalysis, findings: Sequence[Finding]) -> dict:
    """Return the plain numbers and words of a back-analysis for its report."""
    target, project, trace = result.target, result.target.projects[0], result.trace
    return {
        "title": project.title,
        "assumed": list(project.config.assumed),
        "method": result.method,
        "misfit_name": target.misfit,
        "misfit_unit": MISFITS[target.misfit],
        "seed": result.seed,
        "runs": result.runs,
        "best_run": trace.best + 1 if len(trace.misfits) else None,
        "best_misfit": float(np.min(trace.misfits, initial=np.inf)),
        "confirmed_misfit": result.misfit if result.confirmed else None,
        "accepted": int(trace.accepted.sum()),
        "wall_seconds": result.seconds,
        "parameters": [_parameter_row(result, n) for n in range(len(target.parameters))],
        "trace": {
            "points": trace.points,
            "misfits": trace.misfits,
            "accepted": trace.accepted,
        },
        "fit": None if result.fit is None else summarise_fit(result.fit),
        "blasts": {name: _blast_table(blast) for name, blast in result.confirmed.items()},
        "plan": None if result.plan is None else summarise_survey(result.plan),
        "missing": list(result.missing),
        "unused_records": target.unused,
        "findings": [asdict(finding) for finding in findings],
        "files_sha256": project.input_files,
        "provenance": versions(identity(target, result.method, result.seed)["hash"]),
    }


def _parameter_row(result, number):
    """Return the row of a parameter in tables: range, best value, interval, constraint."""
    parameter = result.target.parameters[number]
    row = {
        **range_of(parameter),
        "best": result.best[parameter.name],
        "within": result.within(number),
        "constraint": result.constraint(number),
        "bound": result.at_bound(parameter),
        "unidentifiable": result.unidentifiable.get(parameter.name, ""),
    }
    return {**row, "beside": beside_laboratory(row)}


def summarise_fit(fit: Fit) -> dict:
    """Return the plain numbers of a fit: what is held, errors, convergence."""
    n = len(fit.properties)
    held = [k for k in range(len(fit.names)) if k not in fit.sought]
    return {
        "converged": fit.converged,
        "last_step": fit.last_step,
        "remaining": fit.remaining,
        "starts": fit.starts,
        "error_level": fit.posterior.level,
        "lacking": fit.lacking,
        "ratios": fit.ratios(),
        "held": [
            {"name": fit.names[k], "prior": fit.posterior.prior[k],
             "pull": fit.posterior.pulls[k], "column": k >= n or not fit.properties[k].moves}
            for k in held
        ],
        "taken_as_known": fit.left_out,
        "influences": fit.influences(),
        "trade_offs": fit.trade_offs(),
        "nuisances": fit.posterior.nuisances,
        "remaining_above_noise": fit.posterior.remaining,
    }  # fmt: skip


def slip_summary(result: BackAnalysis) -> list[str]:
    """Return sentences on the slip of each joint surface in each blast."""
    tables = {name: _blast_table(blast) for name, blast in result.confirmed.items()}
    return [line for name, table in tables.items() for line in slip_lines(name, table)]


def _compared(confirmed, name, band):
    """Return the compared motion at a receiver: in common time, within the band."""
    both = in_common(confirmed.recorded[name], confirmed.simulated[name], band)
    recorded, simulated = (motion_table(motion, band) for motion in both)
    corner = confirmed.recorded[name].low_passed
    table = {"band_hz": band, "low_pass_hz": corner}
    return table | {"recorded": recorded, "simulated": simulated}


def _blast_table(confirmed):
    """Return the comparisons and the slip of one blast."""
    return {
        "receivers": {
            name: {
                "recorded": motion_table(confirmed.recorded[name]),
                "simulated": motion_table(confirmed.simulated[name]),
                "compared": _compared(confirmed, name, comparison.band),
                "comparison": comparison_table(comparison),
                "first_slip_ppv": float(np.nanmax(confirmed.simulated[name].ppv))
                * confirmed.factor,
            }
            for name, comparison in confirmed.comparisons.items()
        },
        "strength": {name: asdict(strength) for name, strength in confirmed.strength.items()},
        "factor": confirmed.factor,
    }


RATE, UNCERTAINTY, SOURCE = "moment_rate.csv", "moment_rate_uncertainty.csv", "source.json"
PULSE = 0.15  # s, default length of the moment rate


def find_moment_rate(
    project: Project | str | Path,
    out: str | Path | None = None,
    *,
    length: float = PULSE,
    progress: Progress | None = None,
) -> tuple[MomentRateFit, Path]:
    """Find the moment rate of 1 kg from the records of a signature shot in a project.

    Parameters
    ----------
    project : Project or path
        With holes inside, of one or more holes, and records; its moment rate is not used.
    out : path, optional
        Folder of numbered folders; default ``source`` beside the project file.
    length : float, s
        Of the moment rate, from when a hole fires.
    progress : callable, optional

    Returns
    -------
    MomentRateFit
    Path
        Folder with ``moment_rate.csv``, ``moment_rate_uncertainty.csv`` and ``source.json``.

    Raises
    ------
    InputError
        If there are no holes inside or no records, or the ground is not linear.

    Notes
    -----
    One run with a cubic B-spline as moment rate gives the response to each of its shifts, and the
    records are a sum of these: theory.md (9.7), (9.8).
    """
    project = project if isinstance(project, Project) else load_project(project)
    if project.inside.moment_rate is None or not project.recorded:
        raise InputError(
            f"{project.path.name}: a moment rate is found from holes_inside and from records of "
            "receivers; add receivers.recorded and the table [holes_inside.charged_hole]"
        )
    band = min(row.carried for row in project.accuracy.rows)
    wanted = project.config.run.compare_band_hz
    band = band if wanted is None else min(band, wanted[1])
    dt = 1.0 / (KNOTS_PER_PERIOD * PER_KNOT * band)
    knot = PER_KNOT * dt
    count = int(np.ceil(length / knot)) - 3
    if count < 4:
        shortest = f"{7.0 * knot:.3g} s for motion up to {band:.3g} Hz"
        raise InputError(f"length: must be at least {shortest}, got {length:g} s")
    pulse = spline(np.arange(0.0, 4.0 + 1e-9, 1.0 / (FINE * PER_KNOT)))
    unit = TimeFunction(pulse, dt / FINE)
    inside = replace(project.inside, moment_rate=unit, low_pass=None, unfiltered=None)
    survey = replace(project.survey, shots=(replace(project.shot, held=inside),))
    probe = replace(project, survey=survey)
    refuse_what_does_not_superpose(probe.model)
    run = simulate_model(probe.model, probe.duration, progress=progress)
    motion = probe.simulated(run.seismograms)
    recorded = {name: each.seismogram for name, each in probe.comparable.items()}
    fit = fit_moment_rate(motion, recorded, band, dt, count)
    folder = new_folder(out or project.folder / "source")
    _write_rate(folder, fit, project)
    return fit, folder


def _write_rate(folder, fit, project):
    """Write the moment rate, its uncertainty and the figures."""
    head = "time_s,moment_rate_per_kg_Nm_per_s"
    rows = [f"{t:.9g},{m:.9g}" for t, m in zip(fit.times, fit.rate, strict=True)]
    write_text(folder / RATE, "\n".join([head, *rows]) + "\n")
    lines = [f"{row},{s:.9g}" for row, s in zip(rows, fit.deviation, strict=True)]
    head += ",standard_deviation_Nm_per_s"
    write_text(folder / UNCERTAINTY, "\n".join([head, *lines]) + "\n")
    summary = {"project": project.path.name, "exponent": project.config.blast.charge_exponent}
    stamp = versions(input_hash(project.model, project.duration))
    write_summary(folder / SOURCE, {**fit.summary, **summary, "versions": stamp})
