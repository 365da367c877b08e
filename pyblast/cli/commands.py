"""Commands of the program: arguments, errors as one sentence, exit codes."""

import os
import sys
import warnings
from contextlib import contextmanager
from importlib import resources
from pathlib import Path
from typing import Annotated

import typer

from ..errors import InputError, PyblastError, SolverError
from . import (
    blas,  # noqa: F401  blas: before numpy
    console,
)

ProjectFile = Annotated[Path, typer.Argument(help="The project file, such as project.toml.")]
Full = Annotated[
    bool, typer.Option("--full", help="Take the larger run of table [full] of the file.")
]


@contextmanager
def told():
    """Turn every error into one sentence and an exit code: 1 solver, 2 input, 130 interrupted."""
    try:
        yield
    except SolverError as error:
        console.complain(error)
        raise typer.Exit(1) from None
    except PyblastError as error:
        console.complain(error)
        raise typer.Exit(2) from None
    except KeyboardInterrupt as stop:
        console.complain(f"interrupted; {stop}" if stop.args else "interrupted")
        raise typer.Exit(130) from None


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
        from ..back_analysis.findings import fit_doubts
        from ..project.project import load_project
        from ..runs.parallel import executor_of
        from ..workflows.back_analysis import (
            back_analyse,
            doubts_before,
            plan_back_analysis,
            slip_told,
        )

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
        from ..diagnosis.summary import UNSURE, told_lines
        from ..runs.parallel import workers as pool
        from ..workflows.diagnose import check_further, diagnose_folder, predict_file

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


app = typer.Typer(
    help="Blast vibration in jointed rock: from one hole to the whole blast, through joints and "
    "faults, to what a seismograph records.",
    no_args_is_help=True,
    rich_markup_mode=None,
    add_completion=False,
    pretty_exceptions_enable=False,
)


@app.command()
def run(
    project: ProjectFile,
    output: Annotated[
        Path | None,
        typer.Option(help="Folder for the numbered result folders [results beside it]."),
    ] = None,
    full: Full = False,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on where the last run was interrupted.")
    ] = False,
    write_model: Annotated[
        Path | None,
        typer.Option(help="Write the model for the program pyblast-run, and march nothing."),
    ] = None,
):
    """Run the whole chain to a report.

    Writes result.h5, summary.json, files for ParaView and report.html. The signature of one
    hole is superposed over the firing times, low-passed, and sent through the jointed rock to
    the receivers; where records are given, they are compared. Earlier results are kept. Ctrl-C
    writes a checkpoint.
    """
    with told():
        from ..project.project import load_project
        from ..solver import preparation
        from ..workflows import run as pipeline

        loaded = load_project(project, full)
        with console.Progress() as progress:
            if write_model is not None:
                prepared = preparation.prepare(loaded.model, loaded.duration, progress)
                preparation.export(prepared, write_model)
                console.say(f"model: {write_model}")
                return
            outcome = pipeline.run(loaded, output, resume=resume, progress=progress)
        console.show_outcome(outcome)


@app.command()
def check(project: ProjectFile, full: Full = False):
    """Say what a run will do and what is doubtful.

    Volumes and masses, zones, the highest frequency that the mesh carries in each material, time
    step, memory, estimated time, and every defect that the numbers of the project show. Exit
    code 3 where a result could not be trusted.
    """
    with told():
        from ..back_analysis.findings import doubts
        from ..back_analysis.search import is_recorded
        from ..project.checks import check as look
        from ..project.project import load_project

        loaded = load_project(project, full)
        found = look(loaded)
        console.show_check(found)
        if loaded.config.back_analysis is not None and not is_recorded(loaded):
            console.say("[back_analysis]: no record yet; ask with backanalyse --plan")
        else:
            console.show_findings(doubts(loaded))
        if found.failed:
            raise typer.Exit(3)


@app.command()
def mesh(
    project: ProjectFile,
    output: Annotated[Path, typer.Option(help="Folder for zones.vtu and joints.vtu.")] = Path(),
    full: Full = False,
):
    """Build, count and write the mesh only.

    The files for ParaView hold material, block and the highest frequency carried of every zone.
    """
    with told():
        from ..project.project import load_project
        from ..workflows.run import write_mesh_files

        loaded = load_project(project, full)
        console.show_census(write_mesh_files(loaded, output))
        console.say(f"written: {output / 'zones.vtu'}, {output / 'joints.vtu'}")


@app.command()
def superpose(
    project: ProjectFile,
    output: Annotated[Path | None, typer.Option(help="CSV file for the input motion.")] = None,
):
    """Add up the blast from its single hole.

    The model is not run. Prints peaks of the single hole, of the whole blast, and after the
    low-pass, with the energy that the filter took.
    """
    with told():
        from ..project.project import load_project
        from ..project.result import write_csv

        stages = load_project(project).input
        if stages is None:
            raise InputError(f"{project.name}: signature: missing; there is nothing to add up")
        console.show_input(stages)
        if output is not None:
            write_csv(output, stages.motion)
            console.say(f"written: {output}")


@app.command()
def compare(
    recorded: Annotated[Path, typer.Argument(help="Record of a blast seismograph.")],
    simulated: Annotated[Path, typer.Argument(help="result.h5 of a run, or another record.")],
    receiver: Annotated[str, typer.Option(help="Receiver of the run.")] = "",
    low: Annotated[float | None, typer.Option(help="Compare above this frequency in Hz.")] = None,
    high: Annotated[float | None, typer.Option(help="Compare below; goes with --low.")] = None,
    bearing: Annotated[
        float | None, typer.Option(help="Degrees from the instrument to the blast, from north.")
    ] = None,
):
    """Compare a record with a simulation.

    Peaks, dominant frequencies, durations and waveforms of the three components.
    """
    with told():
        from ..workflows.run import compare_files

        if (low is None) != (high is None):
            raise InputError("--low and --high: go together; give both or neither")
        band = None if low is None else (low, high)
        console.show_comparison(compare_files(recorded, simulated, receiver, band, bearing))


@app.command()
def report(
    result: Annotated[Path, typer.Argument(help="Result folder of a run, or its result.h5.")],
    output: Annotated[Path | None, typer.Option(help="The page to write [report.html].")] = None,
):
    """Make the report of a run again.

    One page with all figures and tables that opens without network.
    """
    with told():
        from ..project.result import read_result
        from ..report.html import write_report

        path = result / "result.h5" if result.is_dir() else result
        page = output or path.with_name("report.html")
        write_report(page, read_result(path))
        console.say(f"written: {page}")


@app.command()
def sitelaw(
    records: Annotated[
        Path, typer.Argument(help="CSV with columns such as distance_m, charge_kg, ppv_mm_per_s.")
    ],
    charge_exponent: Annotated[
        float, typer.Option(help="Scaled distance is distance / charge^this.")
    ] = 0.5,
    limit: Annotated[
        float | None, typer.Option(help="Peak velocity in mm/s; print the charges that keep it.")
    ] = None,
):
    """Fit peak velocity against scaled distance.

    The charge is the largest within 8 ms. Prints the law with its 50 and 95 % lines, and refuses
    records that do not support one.
    """
    with told():
        from ..blasts.site_law import fit_site_law, read_site_records

        law = fit_site_law(*read_site_records(records), charge_exponent)
        console.show_site_law(law, None if limit is None else 1e-3 * limit)


for command in (backanalyse, diagnose):
    app.command()(command)


@app.command()
def delays(
    project: ProjectFile,
    out: Annotated[
        Path | None, typer.Option(help="Folder for the numbered plans [delays beside it].")
    ] = None,
    full: Full = False,
):
    """Find the delays that shake houses least.

    Searches between the delays of table [delays] and fires the plan that is there and the best
    one thousands of times on paper, as holes scatter. Writes delays.json and report.html.
    """
    with told():
        from ..report.delays import delay_lines
        from ..workflows.delays import find_delays

        with console.Progress() as progress:
            table, folder = find_delays(project, out, full=full, progress=progress)
        for line in [*delay_lines(table), f"results: {folder}"]:
            console.say(line)


def standalone():
    """Become the program ``pyblast-run``."""
    program = resources.files("pyblast") / "bin" / "pyblast-run"
    if not program.is_file():
        console.complain(
            "the program pyblast-run is not built; install libhdf5-dev and build again"
        )
        sys.exit(2)
    os.execv(str(program), ["pyblast-run", *sys.argv[1:]])


def main():
    """Run the command line."""
    warnings.showwarning = lambda message, *_args, **_options: console.complain(f"note: {message}")
    app(prog_name="pyblast")
