"""The commands that go from records to the ground: ``backanalyse``, ``diagnose``."""

from pathlib import Path
from typing import Annotated

import typer

from . import console
from .command_words import Full, ProjectFile, told
from .errors import InputError


def backanalyse(
    project: ProjectFile,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for the numbered searches [back_analysis beside it]."),
    ] = None,
    workers: Annotated[
        int, typer.Option(min=1, help="Processes, for methods that ask for many runs at once.")
    ] = 1,
    dask: Annotated[
        str, typer.Option(help="Address of a dask scheduler whose workers run the models.")
    ] = "",
    full: Full = False,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on where the last search was interrupted.")
    ] = False,
    plan: Annotated[
        bool, typer.Option("--plan", help="Only say what records could tell; needs none.")
    ] = False,
):
    """Find unknowns of the ground from recorded blasts.

    Searches the ranges of table [back_analysis], runs the best values in full, and says which
    unknowns the records can't tell. Writes trials.jsonl, one line a run, back_analysis.json and
    report.html. Ctrl-C keeps what was run. With --plan it needs no records, and writes plan.json
    and report.html into numbered folders in plan.
    """
    with told():
        from .back_analysis import back_analyse, doubts_before, plan_back_analysis, slip_told
        from .ensembles.many_runs import executor_of
        from .inversion.fit_doubts import fit_doubts
        from .projects.project import load_project

        loaded = load_project(project, full)
        if plan:
            if resume or dask or workers > 1:
                raise InputError("--plan: takes neither --resume nor --workers nor --dask")
            with console.Progress() as progress:
                made, folder = plan_back_analysis(loaded, out, progress=progress)
            console.show_plan(made, folder)
            return
        before = doubts_before(loaded)
        console.show_findings(before)
        with console.Progress() as progress, executor_of(workers, dask) as executor:
            found, folder = back_analyse(
                loaded, out, resume=resume, executor=executor, progress=progress, before=before
            )
        console.show_search(found, folder, slip_told(found), fit_doubts(found))


def diagnose(
    case: Annotated[
        Path, typer.Argument(help="Folder with site.toml, hole tables, records; or project file.")
    ],
    out: Annotated[Path, typer.Option(help="Folder for diagnosis.json, report.html and runs.")],
    budget: Annotated[
        int, typer.Option(min=1, help="Runs of one blast after which no effect is tried any more.")
    ] = 400,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Processes side by side [one for each core].")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of the shuffled residuals.")] = 1,
    predict: Annotated[
        Path | None, typer.Option(help="Hole table of a further blast to foretell.")
    ] = None,
    predict_out: Annotated[Path | None, typer.Option(help="miniSEED file for it.")] = None,
    predict_baseline: Annotated[
        Path | None, typer.Option(help="The same by the calibrated site without effects.")
    ] = None,
):
    """Say which physics a model lacks, where, and whether the records prove it.

    Calibrates the site, searches a library of effects, and tests the best on records that it was
    not fitted to. Writes diagnosis.json and report.html. The same command goes on after Ctrl-C.
    """
    with told():
        from .diagnose import diagnose_folder
        from .diagnosis.words import UNSURE, told_lines
        from .ensembles.many_runs import workers as pool
        from .foretell import check_further, predict_file

        wanted = [(predict_out, False), (predict_baseline, True)]
        if (predict is None) != (predict_out is None and predict_baseline is None):
            raise InputError(
                "--predict: needs --predict-out, --predict-baseline or both, and they need it"
            )
        if predict is not None:
            check_further(case, predict, [path for path, _ in wanted if path is not None], out)
        with console.Progress() as progress, pool(workers) as executor:
            found = diagnose_folder(
                case, out, budget=budget, seed=seed, executor=executor, progress=progress
            )
        for line in told_lines(found):
            console.say(line)
        console.say(f"{found['runs']} runs, {found['wall_s']:.0f} s; written: {out}")
        for path, baseline in wanted:
            if path is not None:
                predict_file(case, out, found, predict, path, baseline)
                unsure = found["outcome"] in UNSURE and not baseline
                console.say(f"written: {path}{', by an answer that is unsure' * unsure}")
