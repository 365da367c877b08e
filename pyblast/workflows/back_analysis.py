"""The job from recorded motion to the values of unknowns: search, confirm, write, report."""

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np

from ..back_analysis.findings import doubts, fit_doubts
from ..back_analysis.search import (
    BackAnalysis,
    confirm,
    make_target,
    refuse_unready,
    search,
    uncertain,
)
from ..back_analysis.survey_design import Plan, foreseen_plan
from ..back_analysis.trials import TrialLog, Trials, identity
from ..errors import Finding, InputError, PyblastError
from ..inference.misfits import MISFITS
from ..project.checks import check
from ..project.project import Project, load_project
from ..project.result import comparison_table, motion_table, write_summary
from ..report.back_analysis import summarise_posterior, write_search_report
from ..report.survey_design import beside_laboratory, slip_lines, summarise_plan, write_plan_report
from ..runs.cache import input_hash
from ..signals.comparison import in_common
from ..solver.preparation import versions
from .run import Interrupted, new_folder

TRIALS = "trials.jsonl"
RESULT = "back_analysis.json"
PLAN = "plan.json"


def back_analyse(
    project: Project | str | Path,
    output=None,
    *,
    resume: bool = False,
    full: bool = False,
    executor: Executor | None = None,
    progress: Callable | None = None,
    before: Sequence[Finding] | None = None,
) -> tuple[BackAnalysis, Path]:
    """Find the unknowns that table ``[back_analysis]`` of a project names.

    Parameters
    ----------
    project : Project or path of a project file
    output : path, optional
        Folder that takes numbered folders, one per search; ``back_analysis`` beside the project
        file by default. Earlier results stay.
    resume : bool
        Go on with the last search that was interrupted: its trace is the same.
    full : bool
        Take the table ``[full]`` of the project file.
    executor : concurrent.futures.Executor, optional
        Such as `workers`, or what ``dask.distributed.Client.get_executor`` returns. The answer
        does not depend on it.
    progress : callable, optional
        Called with (stage, done, total).
    before : sequence of Finding, optional
        What `doubts_before` says of the project, where that was asked already.

    Returns
    -------
    BackAnalysis
    Path
        Folder with ``trials.jsonl``, ``back_analysis.json`` and ``report.html``.

    Raises
    ------
    InputError, ReadError
        If the project or a file of it is wrong, or there is nothing to resume.
    SolverError
        If no point could be run, or a worker was lost.
    """
    if not isinstance(project, Project):
        project = load_project(project, full)
    tell = progress or (lambda *_: None)
    tell("mesh", 0, 1)
    target, table = make_target(project), project.config.back_analysis
    refuse_unready(table, f"{project.path.name}: back_analysis")
    before = doubts_before(project) if before is None else before
    output = project.folder / "back_analysis" if output is None else Path(output)
    folder = _interrupted(output) if resume else new_folder(output)
    kept = TrialLog(folder / TRIALS, identity(target, table.method, table.seed), resume)
    trials = Trials(target, kept, table.runs, executor=executor, progress=progress)
    try:
        trace = search(trials, table.method, table.runs, table.seed)
        found = confirm(trials.target, table.method, table.seed, trace, progress)
        if table.posterior:
            drawn = uncertain(trials, trace.points[trace.best], table.seed)
            found = replace(found, posterior=drawn)
    except KeyboardInterrupt:
        raise Interrupted(
            f"{len(kept.rows)} evaluations are kept in {kept.path}, go on with --resume"
        ) from None
    except PyblastError:
        if not kept.rows and not resume:
            kept.path.unlink()
            folder.rmdir()
        raise
    tell("writing", 0, 1)
    summary = summarise_search(found, [*before, *fit_doubts(found)], kept.rows)
    write_summary(folder / RESULT, summary)
    write_search_report(folder / "report.html", summary, found.confirmed)
    return found, folder


def doubts_before(project: Project) -> list[Finding]:
    """Return what is doubtful before a search: defects of the model that fail, then the table's."""
    own = doubts(project)  # first: it refuses what is missing before the census is taken
    failed = [one for one in check(project, measure=False).findings if one.failed]
    return [*failed, *own]


def plan_back_analysis(
    project: Project | str | Path, output=None, *, full: bool = False,
    progress: Callable | None = None,
) -> tuple[Plan, Path]:  # fmt: skip
    """Say before any record what receivers and blasts can tell of the unknowns of a project.

    Parameters
    ----------
    project : Project or path of a project file
    output : path, optional
        Folder that takes numbered folders, one per plan; ``plan`` beside the project file by
        default.
    full : bool
        Take the table ``[full]`` of the project file.
    progress : callable, optional
        Called with (stage, done, total).

    Returns
    -------
    Plan
    Path
        Folder with ``plan.json`` and ``report.html``.

    Raises
    ------
    InputError, ReadError
        If the project or a file of it is wrong.
    SolverError
        If a model can't be run.
    """
    if not isinstance(project, Project):
        project = load_project(project, full)
    plan = foreseen_plan(project, progress)
    folder = new_folder(project.folder / "plan" if output is None else Path(output))
    parts = [[one.name, one.low, one.high, one.log] for one in plan.parameters]
    files = {"project": project.input_files, "parameters": parts}
    summary = {
        "title": project.title,
        "assumed": list(project.config.assumed),
        "blasts": [project.path.name, *project.config.back_analysis.blasts],
        "plan": summarise_plan(plan),
        "files_sha256": project.input_files,
        "provenance": versions(input_hash("plan", files)),
    }
    write_summary(folder / PLAN, summary)
    write_plan_report(folder / "report.html", summary)
    return plan, folder


def _interrupted(output):
    """Return the last folder with trials."""
    found = sorted(output.glob(f"[0-9]*/{TRIALS}"))
    if not found:
        raise InputError(f"{output}: nothing to resume; no folder there holds {TRIALS}")
    return found[-1].parent


def summarise_search(found: BackAnalysis, findings, rows) -> dict:
    """Return everything that the page of a back-analysis shows, as plain numbers and words."""
    target, project, trace = found.target, found.target.projects[0], found.trace
    plan = summarise_plan(found.plan)
    beside = {one["path"]: beside_laboratory(one) for one in plan["parameters"]}
    return {
        "title": project.title,
        "assumed": list(project.config.assumed),
        "method": found.method,
        "misfit_name": target.misfit,
        "misfit_unit": MISFITS[target.misfit],
        "seed": found.seed,
        "runs": len(trace.misfits),
        "evaluations": len(rows),
        "best_run": trace.best + 1,
        "best_misfit": float(trace.misfits[trace.best]),
        "confirmed_misfit": found.misfit,
        "accepted": int(trace.accepted.sum()),
        "wall_seconds": sum(row["wall_seconds"] for row in rows),
        "parameters": [
            {
                **asdict(one),
                "best": found.best[one.name],
                "bound": found.at_bound(one),
                "insensitive": found.insensitive.get(one.name, ""),
                "beside": beside[one.name],
            }
            for one in target.parameters
        ],
        "trace": {
            "points": trace.points,
            "misfits": trace.misfits,
            "accepted": trace.accepted,
        },
        "blasts": {name: _blast_table(one) for name, one in found.confirmed.items()},
        "plan": plan,
        "posterior": summarise_posterior(found.posterior, target.parameters),
        "findings": [asdict(finding) for finding in findings],
        "files_sha256": project.input_files,
        "provenance": versions(identity(target, found.method, found.seed)["hash"]),
    }


def slip_told(found: BackAnalysis) -> list[str]:
    """Say of every blast and joint surface what slipped, and what it would take."""
    tables = {name: _blast_table(one) for name, one in found.confirmed.items()}
    return [line for name, table in tables.items() for line in slip_lines(name, table)]


def _compared(confirmed, name, band):
    """Return motion at a receiver as its comparison sees it: in common time, within the band."""
    both = in_common(confirmed.recorded[name], confirmed.simulated[name], band)
    recorded, simulated = (motion_table(one, band) for one in both)
    return {"band_hz": band, "recorded": recorded, "simulated": simulated}


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
        "strength": {name: asdict(one) for name, one in confirmed.strength.items()},
        "factor": confirmed.factor,
    }
