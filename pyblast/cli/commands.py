"""Commands of the program: arguments, errors as one sentence, exit codes."""

import logging
import math
import os
import sys
import warnings
from importlib import metadata, resources
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from typer.core import TyperCommand

from ..errors import (
    EXIT_CODES,
    NOT_TRUSTED,
    WRONG_INPUT,
    InputError,
)
from ..readers.provenance import ReadLog
from . import console
from .console import exit_codes

if TYPE_CHECKING:
    from ..project.project import Project

log = logging.getLogger(__name__)
ProjectFile = Annotated[Path, typer.Argument(help="Project file, such as project.toml.")]
Full = Annotated[
    bool, typer.Option("--full", help="Take the larger run of table [full] of the project file.")
]
Fresh = Annotated[
    bool,
    typer.Option("--fresh", help="Start anew instead of going on with an unfinished result."),
]

Dask = Annotated[
    str, typer.Option(help="Address of a dask scheduler whose workers run the models.")
]
Verbose = Annotated[
    bool,
    typer.Option("--verbose", help="Show what was read: file, column, unit, factor, losses."),
]

app = typer.Typer(
    help="Blast vibration in jointed rock: from the seismogram of one hole to that of the whole "
    "blast, through joints and faults, to what a seismograph records.",
    epilog="Exit codes: "
    + "; ".join(f"{code} {meaning}" for code, meaning in EXIT_CODES.items())
    + ".",
    no_args_is_help=True,
    rich_markup_mode=None,
    add_completion=False,
    pretty_exceptions_enable=False,
)


class Finite(TyperCommand):
    """A command whose numbers must be finite."""

    def parse_args(self, context, arguments):
        """Read the arguments; refuse numbers such as nan."""
        rest = super().parse_args(context, arguments)
        for name, given in context.params.items():
            for value in given if isinstance(given, tuple) else (given,):
                if isinstance(value, float) and not math.isfinite(value):
                    option = f"--{name.replace('_', '-')}"
                    raise typer.BadParameter(f"{option}: must be a finite number, got {value}")
        return rest


def _loaded(path: Path, full: bool = False, ground: bool = True, table: str = "") -> "Project":
    """Load a project; what its file lacks is refused before the slow imports."""
    from ..config.config import read_config, required_table

    config = read_config(path, full, ground)
    if table:
        required_table(config, table, path)
    from ..project.project import make_project

    return make_project(config, path)


def _show_version(wanted: bool) -> None:
    """Print the version and end."""
    if wanted:
        console.say(f"pyblast {metadata.version('pyblast')}")
        raise typer.Exit


@app.callback()
def program(
    version: Annotated[
        bool,
        typer.Option(
            "--version", is_eager=True, callback=_show_version, help="Show the version and exit."
        ),
    ] = False,
):
    """Take the options that stand before a command."""
    del version


@app.command("run", cls=Finite)
def run_command(
    project: ProjectFile,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for the numbered results [results beside the project file]."),
    ] = None,
    full: Full = False,
    fresh: Fresh = False,
    accept_findings: Annotated[
        bool, typer.Option("--accept-findings", help="End with 0 although a check fails.")
    ] = False,
    write_model: Annotated[
        Path | None,
        typer.Option(help="Write the model for the program pyblast-run, and simulate nothing."),
    ] = None,
    error: Annotated[
        bool, typer.Option("--error", help="Measure the error at receivers by a coarser run.")
    ] = False,
    verbose: Verbose = False,
):
    """Run the whole chain of a project file to a report.

    Writes result.h5, summary.json, files for ParaView and report.html. The signature of one
    hole is superposed over the firing times, low-passed, and sent through the jointed rock to
    the receivers; where records are given, they are compared. Earlier results are kept. Ctrl-C
    or SIGTERM writes a checkpoint, and the same command goes on from it. Ends with 3 if a check
    fails.
    """
    with exit_codes():
        loaded = _loaded(project, full)
        console.show_level(loaded)
        with console.Progress() as progress:
            if write_model is not None:
                from ..solver import preparation

                prepared = preparation.prepare(loaded.model, loaded.duration, progress)
                preparation.export(prepared, write_model)
                console.say(f"model: {write_model}")
                return
            from ..workflows import run as workflow

            outcome = workflow.run(
                loaded, out, fresh=fresh, error=error, progress=progress, say=console.say
            )
        console.show_inputs(loaded.log.table(), verbose)
        console.show_outcome(outcome)
        if outcome.check.failed and not accept_findings:
            console.say("a check fails, see above: exit code 3; --accept-findings accepts it")
            raise typer.Exit(NOT_TRUSTED)


@app.command("check", cls=Finite)
def check_command(
    project: ProjectFile,
    page: Annotated[
        Path | None, typer.Option(help="Page of the findings and the model, which one can turn.")
    ] = None,
    full: Full = False,
    verbose: Verbose = False,
):
    """Check a project: size and cost of its run, and findings about its model and data.

    Shows volumes, zones, the highest frequency that the mesh carries in each material, time step,
    memory and cost, and findings about model, input and records. Exits with 3 if a check fails.
    """
    with exit_codes():
        loaded = _loaded(project, full)
        from ..back_analysis.findings import findings_of_table
        from ..back_analysis.search import is_recorded
        from ..project.checks import check as check_project

        with console.Progress() as progress:
            result = check_project(loaded, priced=True, progress=progress)
        console.show_inputs(loaded.log.table(), verbose)
        console.show_check(result)
        if page is not None:
            from ..files import write_text
            from ..report.view import ModelView

            write_text(page, ModelView(loaded).page(result))
            console.say(f"view: {page}")
        if loaded.config.back_analysis is not None and not is_recorded(loaded):
            console.say("[back_analysis]: no record yet; use backanalyse --design-survey")
        else:
            console.show_findings(findings_of_table(loaded))
        if result.failed:
            raise typer.Exit(NOT_TRUSTED)


@app.command(cls=Finite)
def mesh(
    project: ProjectFile,
    out: Annotated[Path, typer.Option(help="Folder for the files.")] = Path(),
    full: Full = False,
):
    """Build the mesh, count it and write it for ParaView and as a page that one can turn.

    The files hold material, block and the highest frequency carried for every zone.
    """
    with exit_codes():
        loaded = _loaded(project, full)
        from ..workflows.run import write_mesh_files

        console.show_model_summary(write_mesh_files(loaded, out))
        console.say(f"written: {out / 'model.vtm'}, {out / 'zones.vtu'}")
        console.say(f"view:    {out / 'view.html'}")


@app.command("superpose", cls=Finite)
def superpose_command(
    project: ProjectFile,
    out: Annotated[Path | None, typer.Option(help="CSV file for the input motion.")] = None,
):
    """Superpose the signature of one hole over the firing times of the blast.

    The model is not run. Shows the peaks of the single hole, of the whole blast, and after the
    low-pass, with the share of energy that the filter removed.
    """
    with exit_codes():
        loaded = _loaded(project, ground=False)
        from ..project.result import write_csv

        if loaded.input is None:
            raise InputError(f"{project.name}: signature: missing; there is nothing to superpose")
        console.show_input(loaded)
        if out is not None:
            write_csv(out, loaded.input.motion)
            console.say(f"written: {out}")


@app.command("compare", cls=Finite)
def compare_command(
    recorded: Annotated[Path, typer.Argument(help="Record of a blast seismograph.")],
    simulated: Annotated[Path, typer.Argument(help="result.h5 of a run, or another record.")],
    receiver: Annotated[str, typer.Option(help="Receiver of the run.")] = "",
    low: Annotated[float | None, typer.Option(help="Compare above this frequency in Hz.")] = None,
    high: Annotated[float | None, typer.Option(help="Compare below; goes with --low.")] = None,
    bearing: Annotated[
        float | None,
        typer.Option(help="From the instrument to the blast, degrees clockwise from north."),
    ] = None,
    sheet: Annotated[str | None, typer.Option(help="Sheet of the record, of a workbook.")] = None,
    unit: Annotated[
        str | None,
        typer.Option(help="Of miniSEED, SAC or GSE2: mm_per_s, m_per_s2 of accelerometers, ..."),
    ] = None,
    low_passed: Annotated[
        float | None,
        typer.Option(help="Low-pass in Hz of the sources of a prediction in miniSEED."),
    ] = None,
    zero_phase: Annotated[
        bool, typer.Option("--zero-phase", help="Say that this low-pass is of zero phase.")
    ] = False,
):
    """Compare a record with a simulation.

    Shows deviations of peaks, dominant frequencies, durations and waveforms of the components,
    and recorded air overpressure. Where the sources of the simulation were low-passed, the record
    goes through the same filter first.
    """
    with exit_codes():
        if (low is None) != (high is None):
            raise InputError("--low and --high: go together; give both or neither")
        from ..workflows.run import compare_files

        band = None if low is None or high is None else (low, high)
        files = recorded, simulated, receiver, band, bearing, sheet, unit, low_passed, zero_phase
        console.show_compared(*compare_files(*files))


@app.command(cls=Finite)
def report(
    result: Annotated[
        Path,
        typer.Argument(help="Result folder of a run, its result.h5, or a result of pyblast-run."),
    ],
    project: Annotated[
        Path | None,
        typer.Option(help="Project file of a result of pyblast-run, which holds no project."),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Page to write [report.html beside the result]; with --project, the folder for "
            "the numbered results [results beside the project file]."
        ),
    ] = None,
    movie: Annotated[
        bool, typer.Option(help="Write the snapshots as slow motion, motion.webp, beside the page.")
    ] = False,
):
    """Draw the report of a run again, or compare and report what pyblast-run computed.

    One page with all figures and tables that opens without network.
    """
    with exit_codes():
        if project is not None:
            loaded = _loaded(project)
            from ..workflows.run import conclude_program_run

            console.say(f"results: {conclude_program_run(loaded, result, out).folder}")
            return
        from ..project.result import read_result

        path = result / "result.h5" if result.is_dir() else result
        stored = read_result(path)
        from ..report.run import write_report

        write_report(page := out or path.with_name("report.html"), stored)
        console.say(f"written: {page}")
        if movie:
            from ..report.exports import write_movie

            with console.Progress() as progress:
                write_movie(moved := page.with_name("motion.webp"), stored, progress)
            console.say(f"written: {moved}")


@app.command(cls=Finite)
def sitelaw(
    records: Annotated[
        Path, typer.Argument(help="CSV with columns such as distance_m, charge_kg, ppv_mm_per_s.")
    ],
    charge_exponent: Annotated[
        float, typer.Option(help="Scaled distance is distance / charge^this.")
    ] = 0.5,
    limit: Annotated[
        float | None, typer.Option(help="Peak velocity in mm/s; show the charges that keep it.")
    ] = None,
    mapping: Annotated[
        Path | None, typer.Option(help="TOML file that explains the columns of any other table.")
    ] = None,
    sheet: Annotated[str | None, typer.Option(help="Sheet of the records, of a workbook.")] = None,
    verbose: Verbose = False,
):
    """Fit peak velocity against scaled distance.

    The charge is the largest within 8 ms. Shows the law with its 50 and 95 % lines, and refuses
    records that do not support one.
    """
    with exit_codes():
        from ..blasts.site_law import fit_site_law, read_site_records

        log = ReadLog()
        law = fit_site_law(*read_site_records(records, mapping, sheet, log), charge_exponent)
        console.show_inputs(log.table(), verbose)
        console.show_site_law(law, None if limit is None else 1e-3 * limit)


@app.command(cls=Finite)
def source(
    project: ProjectFile,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for the numbered results [source beside the project file]."),
    ] = None,
    length_ms: Annotated[float, typer.Option(help="Length of the moment rate.")] = 150.0,
):
    """Find the moment rate of 1 kg from the records of a signature shot.

    Deconvolves the records at the receivers by the response of the model to the holes inside.
    Writes moment_rate.csv for holes_inside.moment_rate_file, its uncertainty, and source.json with
    the misfit.
    """
    with exit_codes():
        from ..workflows.back_analysis import find_moment_rate

        with console.Progress() as progress:
            fit, folder = find_moment_rate(project, out, length=1e-3 * length_ms, progress=progress)
        console.show_moment_rate(fit, folder)


@app.command(cls=Finite)
def delays(
    project: ProjectFile,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for the numbered plans [delays beside the project file]."),
    ] = None,
    workers: Annotated[
        int, typer.Option(min=1, help="Processes, for the responses of holes inside.")
    ] = 1,
    dask: Dask = "",
    full: Full = False,
    fresh: Fresh = False,
):
    """Optimise the delays for the least vibration at some houses.

    Searches between the delays of table [delays], and compares the present and the best plan in a
    Monte Carlo simulation with firing-time scatter. Writes delays.json, report.html and tables.
    Recorded holes need no mesh; stored responses of holes inside are reused.
    """
    with exit_codes():
        loaded = _loaded(project, full, ground=False)
        from ..report.delays import delay_lines
        from ..runs.parallel import executor_of
        from ..workflows.delays import optimise_delays

        with console.Progress() as progress, executor_of(workers, dask) as executor:
            table, folder = optimise_delays(
                loaded, out, fresh=fresh, executor=executor, progress=progress, say=console.say
            )
        console.say("\n".join([*delay_lines(table), f"results: {folder}"]))


@app.command(cls=Finite)
def backanalyse(
    project: ProjectFile,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Folder for the numbered searches [back_analysis beside the project file; survey "
            "with --design-survey]."
        ),
    ] = None,
    workers: Annotated[
        int, typer.Option(min=1, help="Processes, for methods that run many models at once.")
    ] = 1,
    dask: Dask = "",
    full: Full = False,
    fresh: Fresh = False,
    design_survey: Annotated[
        bool,
        typer.Option(
            "--design-survey",
            help="Show which receivers and blasts would constrain the parameters; needs no record.",
        ),
    ] = False,
):
    """Back-analyse parameters of the ground from recorded blasts.

    Searches the ranges of table [back_analysis], confirms the best values by a full run, and shows
    which parameters the records do not constrain. Writes trials.jsonl, one line a run,
    back_analysis.json and report.html. After Ctrl-C or SIGTERM the same command goes on. With
    --design-survey it needs no records, and writes survey.json and report.html.
    """
    with exit_codes():
        loaded = _loaded(project, full, table="" if design_survey else "back_analysis")
        from ..workflows import back_analysis as workflow

        if design_survey:
            if fresh or dask or workers > 1:
                raise InputError("--design-survey: takes neither --fresh nor --workers nor --dask")
            with console.Progress() as progress:
                plan, folder = workflow.design_survey(loaded, out, progress=progress)
            console.show_survey(plan, folder)
            return
        from ..back_analysis.findings import findings_of_fit
        from ..runs.parallel import executor_of

        before = workflow.findings_before(loaded)
        console.show_findings(before)
        with console.Progress() as progress, executor_of(workers, dask) as executor:
            result, folder = workflow.back_analyse(
                loaded, out, fresh=fresh, executor=executor, progress=progress, before=before,
                say=console.say,
            )  # fmt: skip
        console.show_search(result, folder, workflow.slip_summary(result), findings_of_fit(result))


@app.command("diagnose", cls=Finite)
def diagnose_command(
    case: Annotated[
        Path, typer.Argument(help="Project file with records; [diagnosis] names further blasts.")
    ],
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for the numbered diagnoses and their runs [diagnosis beside]."),
    ] = None,
    minutes: Annotated[
        float | None,
        typer.Option(help="Of a processor, after which no further effect is tried."),
    ] = None,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Processes side by side [one for each core].")
    ] = None,
    dask: Dask = "",
    seed: Annotated[int, typer.Option(min=0, help="Seed of the permuted residuals.")] = 1,
    correct: Annotated[
        bool, typer.Option("--correct", help="Mend mistakes in the records, and go on.")
    ] = False,
    fresh: Fresh = False,
    predict: Annotated[
        Path | None, typer.Option(help="Hole table of a further blast to predict.")
    ] = None,
    predict_out: Annotated[
        Path | None, typer.Option(help="miniSEED file for its motion by the diagnosed model.")
    ] = None,
    predict_baseline: Annotated[
        Path | None, typer.Option(help="miniSEED file for its motion without the effects found.")
    ] = None,
):
    """Diagnose which physics a model lacks, where, and whether the records support it.

    Calibrates the site, searches a library of effects, and tests the best on records that it was
    not fitted to. Writes diagnosis.json and report.html. After Ctrl-C or SIGTERM the same command
    goes on; a finished diagnosis of the same input is only read. Exits with 3, and predicts
    nothing, if records or hole tables hold a mistake.
    """
    with exit_codes():
        outputs = [(path, base) for path, base in ((predict_out, False), (predict_baseline, True))
                   if path is not None]  # fmt: skip
        if (predict is None) == bool(outputs):
            raise InputError(
                "--predict: needs --predict-out, --predict-baseline or both, and they need it"
            )
        from ..diagnosis.summary import UNSURE, diagnosis_lines
        from ..runs.parallel import executor_of
        from ..signals.seismogram import ZeroPhase
        from ..workflows import diagnose as workflow

        if predict is not None:
            workflow.check_further(case, predict, [path for path, _ in outputs], out)
        with console.Progress() as progress, executor_of(workers, dask) as executor:
            result, folder = workflow.diagnose_case(
                case, out, fresh=fresh, minutes=minutes, seed=seed, correct=correct,
                executor=executor, progress=progress, say=console.say,
            )  # fmt: skip
        for line in diagnosis_lines(result):
            console.say(line)
        console.say(f"{result['runs']} runs, {result['wall_s']:.0f} s; results: {folder}")
        if result["outcome"] == "MISTAKE":
            raise typer.Exit(NOT_TRUSTED)
        for path, baseline in outputs:
            assert predict is not None  # goes with the outputs
            predicted = workflow.predict_case(case, folder, predict, path, baseline=baseline)
            corner = predicted.low_pass
            unsure = result["outcome"] in UNSURE and not baseline
            phase = " without phase" * isinstance(corner, ZeroPhase)
            passed = f", low-passed at {corner:.3g} Hz{phase} like what enters" if corner else ""
            console.say(f"written: {path}{passed}{', from a diagnosis that is unsure' * unsure}")
            console.show_bands(predicted)


@app.command(cls=Finite)
def records(
    folder: Annotated[Path, typer.Argument(help="Folder of records.")],
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for the numbered results [FOLDER_analysis beside it]."),
    ] = None,
    geometry: Annotated[
        Path | None,
        typer.Option(
            help="CSV of places, for what headers do not say: kind (receiver or source), name "
            "(channel, or file of the source), x_m, y_m; optional z_m, file, line, sensor."
        ),
    ] = None,
    surface_band: Annotated[
        tuple[float, float],
        typer.Option(metavar="LOW HIGH", help="Hz; surface waves: odd channels, layering."),
    ] = (10.0, 60.0),
    air_band: Annotated[
        tuple[float, float], typer.Option(metavar="LOW HIGH", help="Hz; search of the air wave.")
    ] = (120.0, 500.0),
    sensor_band: Annotated[
        tuple[float, float] | None,
        typer.Option(metavar="LOW HIGH", help="Hz; comparison of sensors [all of the record]."),
    ] = None,
    reference: Annotated[
        str | None, typer.Option(help="Sensor whose response is known to be flat.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the permutation tests.")] = 0,
    verbose: Verbose = False,
):
    """Analyse field records without a model.

    Reports the quality of raw records (dead, clipped, printed peaks that differ from the samples),
    odd channels (polarity, clock, place), the air wave, dispersion and layers, and the response of
    sensors. Reads SEG-2, SEG-Y, miniSEED, SAC, GSE2, exports of blast seismographs and CSV. Writes
    records.json and report.html. What can't be analysed is listed with its reason.
    """
    with exit_codes():
        from ..report.records import records_lines
        from ..workflows.records import analyse_records

        with console.Progress() as progress:
            summary, results = analyse_records(
                folder, out, geometry=geometry, surface_band=surface_band, air_band=air_band,
                sensor_band=sensor_band, reference=reference, seed=seed, progress=progress,
            )  # fmt: skip
        console.show_inputs(summary["inputs"], verbose)
        console.say("\n".join([*records_lines(summary), f"results: {results}"]))
        console.say(f"report:  {results / 'report.html'}")


@app.command(cls=Finite)
def site(
    folder: Annotated[
        Path,
        typer.Argument(help="Folder with blasts.csv, stations.csv and records in subfolders."),
    ],
    out: Annotated[
        Path | None, typer.Option(help="Folder for the result [site in that folder].")
    ] = None,
    limit_curve: Annotated[
        str, typer.Option(help="Limit curve of the peaks.")
    ] = "din_4150_dwelling",
    air_limit: Annotated[
        float | None, typer.Option(help="Limit of the air overpressure in Pa.")
    ] = None,
    most: Annotated[
        float | None, typer.Option(help="Peak in mm/s that a share of all blasts stays below.")
    ] = None,
    share: Annotated[float, typer.Option(help="That share of blasts.")] = 0.95,
    ceiling: Annotated[
        float | None, typer.Option(help="Peak in mm/s that no blast exceeds.")
    ] = None,
    since: Annotated[str, typer.Option(help="First day of the period.")] = "0001-01-01",
    until: Annotated[str, typer.Option(help="Last day of the period.")] = "9999-12-31",
    verbose: Verbose = False,
):
    """Join the records of many blasts to a log, and learn from blast to blast.

    Reads the log (date, time, x, y, charge or hole table), the stations (name, serial number, x, y,
    trigger level) and all records of the folder. Dates changes and says what changed, forecasts
    blasts that the log plans, and judges limits. Writes site.json, report.html and a table of
    compliance, anew by each call; files that were parsed before are not parsed again.
    """
    with exit_codes():
        from ..line_records.forecasts import StatisticalLimit
        from ..report.site import site_lines
        from ..workflows.site import learn_site

        if most is None and ceiling is not None:
            raise InputError("--ceiling: goes with --most")
        high = math.inf if ceiling is None else 1e-3 * ceiling
        limit = None if most is None else StatisticalLimit(1e-3 * most, share, high, since, until)
        with console.Progress() as progress:
            summary, results = learn_site(
                folder, out, limit_curve=limit_curve, air_limit=air_limit, statistical=limit,
                progress=progress,
            )  # fmt: skip
        console.show_inputs(summary["inputs"], verbose)
        console.say("\n".join([*site_lines(summary), f"results: {results}"]))
        console.say(f"report:  {results / 'report.html'}")


def standalone() -> None:
    """Replace this process by the program ``pyblast-run``."""
    binary = resources.files("pyblast") / "bin" / "pyblast-run"
    if not binary.is_file():
        console.complain(
            "the program pyblast-run is not built; install libhdf5-dev and build again"
        )
        sys.exit(WRONG_INPUT)
    os.execv(str(binary), ["pyblast-run", *sys.argv[1:]])


def say_warning(message: Warning | str, category: type[Warning], *_args, **_options) -> None:
    """Say a warning to the user, but log one of arithmetic: that is said by what comes of it."""
    if issubclass(category, RuntimeWarning):
        log.info("%s", message)
    else:
        console.complain(f"note: {message}")


def main() -> None:
    """Run the command line."""
    warnings.showwarning = say_warning
    app(prog_name="pyblast")
