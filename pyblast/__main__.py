"""The commands ``pyblast run``, ``check`` and others; with `console` the only place that prints."""

import os
import sys
import warnings
from importlib import resources
from pathlib import Path
from typing import Annotated

import typer

from . import blas, commands_inverse, console  # noqa: F401  blas: before numpy
from .command_words import Full, ProjectFile, told
from .errors import InputError

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
        from . import pipeline
        from .projects.project import load_project
        from .solving import preparation

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
        from .inversion.back_analysis import is_recorded
        from .inversion.doubts import doubts
        from .projects.checks import check as look
        from .projects.project import load_project

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
        from .pipeline import write_mesh_files
        from .projects.project import load_project

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
        from .projects.project import load_project
        from .projects.result import write_csv

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
        from .pipeline import compare_files

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
        from .projects.result import read_result
        from .reporting.report import write_report

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
        from .blasting.site_law import fit_site_law
        from .blasting.site_records import read_site_records

        law = fit_site_law(*read_site_records(records), charge_exponent)
        console.show_site_law(law, None if limit is None else 1e-3 * limit)


for command in (commands_inverse.backanalyse, commands_inverse.diagnose):
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
        from .delays import find_delays
        from .reporting.delay_words import delay_lines

        with console.Progress() as progress:
            table, folder = find_delays(project, out, full=full, progress=progress)
        for line in [*delay_lines(table), f"results: {folder}"]:
            console.say(line)


def standalone():
    """Become the program ``pyblast-run``."""
    program = resources.files(__package__) / "bin" / "pyblast-run"
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


if __name__ == "__main__":
    main()
