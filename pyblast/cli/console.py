"""Terminal output of the commands: tables, sentences, progress.

Modules that take long to load are imported where they are used.
"""

import codecs
import errno
import io
import math
import os
import signal
import sys
import time
import unicodedata
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from threading import Event, Thread
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import BarColumn, TextColumn, TimeRemainingColumn
from rich.progress import Progress as Bar
from rich.table import Table
from typer import Exit

from ..errors import INTERRUPTED, SOLVER_FAILED, WRONG_INPUT, PyblastError, SolverError
from ..readers.provenance import input_lines
from ..units import in_minutes

if TYPE_CHECKING:
    from ..back_analysis.search import BackAnalysis
    from ..back_analysis.survey_design import SurveyDesign
    from ..back_analysis.waveforms import MomentRateFit
    from ..blasts.site_law import SiteLaw
    from ..errors import Finding
    from ..mesh.as_built import Row
    from ..project.checks import Check
    from ..project.checks_ground import ModelSummary
    from ..project.project import Project
    from ..signals.comparison import Comparison
    from ..workflows.prediction import Prediction
    from ..workflows.run import Outcome

STAGES = {
    "input": "input motion",
    "mesh": "mesh",
    "check": "checks",
    "step": "search for the time step",
    "static": "initial stress",
    "dynamic": "time steps",
    "trials": "runs of the search",
    "plan": "runs of the survey design",
    "calibration": "calibration",
    "holes": "runs of the holes",
    "delays": "search of delays",
    "records": "reading of records",
    "analyses": "analyses of lines",
    "writing": "results and report",
}
ASCII = {
    "°": " deg", "×": "x", "√": "sqrt ", "–": "-", "−": "-", "…": "...", "µ": "u", "²": "2",
    "³": "3", "ä": "ae", "ö": "oe", "ü": "ue", "Ä": "Ae", "Ö": "Oe", "Ü": "Ue", "ß": "ss", "—": "-",
    "ł": "l", "Ł": "L", "ø": "o", "Ø": "O", "ı": "i",
}  # fmt: skip
WIDE = None if sys.stdout.isatty() else 120  # columns of a log
PATIENCE = 1.5  # seconds that a signal may wait for code that is not Python


class _Patient(Console):
    """Console whose reader may leave, or whose disk may be full: the command goes on without it."""

    lost = False  # what it could not write, though somebody wanted it

    def print(self, *objects, **options) -> None:
        """Print, or say once that this is no longer possible."""
        try:
            super().print(*objects, **options)
        except OSError as error:
            self.quiet, self.lost = True, error.errno != errno.EPIPE
            os.dup2(os.open(os.devnull, os.O_WRONLY), self.file.fileno())
            if self is _out:
                complain(f"the output can't be written ({error.strerror}); goes on without it")

    def on_broken_pipe(self) -> None:
        """Do not end, as consoles of rich do."""
        raise


_out = _Patient(highlight=False, soft_wrap=True, width=WIDE)
_err = _Patient(highlight=False, soft_wrap=True, stderr=True)


def _spelt(error: UnicodeError) -> tuple[str, int]:
    """Spell what the encoding of a terminal lacks."""
    assert isinstance(error, UnicodeEncodeError)
    lacking = error.object[error.start : error.end]
    return "".join(ASCII.get(letter) or _plain(letter) for letter in lacking), error.end


def _plain(letter: str) -> str:
    """Return a letter without its accents, "?" where that is none of ASCII."""
    return unicodedata.normalize("NFKD", letter).encode("ascii", "ignore").decode() or "?"


codecs.register_error("spelt", _spelt)
for _stream in (sys.stdout, sys.stderr):
    if isinstance(_stream, io.TextIOWrapper):
        _stream.reconfigure(errors="spelt")


def say(text: object) -> None:
    """Print a line."""
    _out.print(str(text), markup=False)


def complain(text: object) -> None:
    """Print a line to standard error."""
    _err.print(f"pyblast: {text}", markup=False)


class _Stop(KeyboardInterrupt):
    """What a signal raises: after KeyboardInterrupt itself Python may end by SIGINT, not by 130."""


@contextmanager
def exit_codes() -> Iterator[None]:
    """Turn every error into one sentence and its exit code; SIGTERM counts as Ctrl-C."""
    try:
        with _signals():
            yield
    except (PyblastError, MemoryError, OSError, UnicodeEncodeError) as error:
        complain(_sentence(error))
        raise Exit(SOLVER_FAILED if isinstance(error, SolverError) else WRONG_INPUT) from None
    except KeyboardInterrupt as stop:
        complain(f"interrupted; {stop}" if stop.args else "interrupted")
        raise Exit(INTERRUPTED) from None
    if _out.lost:
        raise Exit(WRONG_INPUT)


def _sentence(error: Exception) -> object:
    """Return what to say of an error."""
    if isinstance(error, MemoryError):
        return "the memory does not suffice; a coarser mesh or fewer workers need less"
    if isinstance(error, OSError) and not isinstance(error, PyblastError):
        return f"{error.filename or 'a file'}: {error.strerror or error}"
    return error


@contextmanager
def _signals() -> Iterator[None]:
    """Let SIGINT and SIGTERM interrupt, also where a shell ignores them, in at most two seconds.

    Python obeys them when code in C or Fortran returns to it; where that takes long, the process
    ends at once: only time steps have more to store than what is stored already, and they return.
    """
    obeyed = Event()

    def interrupt(_number: int, _frame: object) -> None:
        obeyed.set()
        raise _Stop

    def end_if_deaf() -> None:
        with os.fdopen(reader, "rb", buffering=0) as numbers:
            while number := numbers.read(1):
                if number[0] in before and not obeyed.wait(PATIENCE):
                    complain("interrupted")
                    os._exit(INTERRUPTED)

    try:
        before = {n: signal.signal(n, interrupt) for n in (signal.SIGINT, signal.SIGTERM)}
    except ValueError:  # outside of the main thread, which alone receives signals
        yield
        return
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    woken = signal.set_wakeup_fd(writer)
    Thread(target=end_if_deaf, daemon=True).start()
    try:
        yield
    finally:
        signal.set_wakeup_fd(woken)
        os.close(writer)
        for number, handler in before.items():
            signal.signal(number, handler)


class Progress:
    """Show how far a run is: a bar on a terminal, plain lines elsewhere."""

    def __init__(self) -> None:
        self._bar = None
        if sys.stdout.isatty():
            columns = TextColumn("{task.description:<20}"), BarColumn(), TimeRemainingColumn()
            self._bar = Bar(*columns, console=_out, transient=True)
        self._task, self._stage, self._began, self._shown = None, None, 0.0, 0.0
        self._first = 0

    def __enter__(self) -> "Progress":
        if self._bar is not None:
            self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.stop()

    def __call__(self, stage: str, done: float, total: float) -> None:
        """Show that ``done`` of ``total`` in a stage is reached."""
        name = STAGES.get(stage, stage)
        if stage != self._stage:
            self._stage, self._began, self._shown = stage, time.perf_counter(), 0.0
            self._first = done
            if self._bar is None:
                say(f"pyblast: {name}")
            else:
                self._task = self._bar.add_task(name, total=total)
        if self._bar is not None and self._task is not None:
            self._bar.update(self._task, completed=done, total=total)
        elif (total > 1 or 0.0 < done < total) and done / total >= self._shown + 0.1:
            self._shown = done / total
            spent = time.perf_counter() - self._began
            rest = spent * (total - done) / (done - self._first) if done > self._first else None
            estimate = "" if rest is None else f", about {rest:.0f} s left"
            say(f"pyblast: {name} {100 * done / total:.0f} %{estimate}")


def _table(*heads: str) -> Table:
    """Return an empty table with numbers to the right."""
    table = Table(box=None, pad_edge=False)
    for number, head in enumerate(heads):
        justify = "left" if number == 0 else "right"
        table.add_column(head, justify=justify, overflow="fold")
    return table


def show_model_summary(summary: "ModelSummary") -> None:
    """Print counts, sizes, frequencies, time step and cost of a model."""
    table = _table(
        "material", "zones", "volume m3", "mass t", "edge m", "quality", "carries Hz", "implicit"
    )
    for g in summary.groups:
        table.add_row(
            g.name, f"{g.zones}", f"{g.volume:.4g}", f"{1e-3 * g.mass:.4g}", f"{g.mean_edge:.3g}",
            f"{g.smallest_quality:.2f}", f"{g.highest_frequency:.3g}", f"{g.implicit}",
        )  # fmt: skip
    _out.print(table)
    say(
        f"{summary.elements}; "
        f"{summary.zones} zones, {summary.nodes} nodes, {summary.contacts} contacts, "
        f"{summary.blocks} blocks; memory about {summary.memory / 2**20:.0f} MB"
    )
    say(
        f"time step {1e3 * summary.dt:.3g} ms, limited by {summary.limited_by}; "
        f"{summary.steps} steps"
    )
    say(f"estimated time {in_minutes(summary.seconds / 60.0)}, without the initial stress")


def show_check(check: "Check") -> None:
    """Print the size of the model, the notes on the holes, and every finding."""
    if check.summary is None:
        say(f"{check.cost}: no mesh was built")
    else:
        show_model_summary(check.summary)
    show_ground(check.ground_as_built)
    for note in check.notes:
        say(f"- {note}")
    show_findings(check.findings)


def show_ground(rows: "Iterable[Row]") -> None:
    """Print the ground as it was asked for and as it was built."""
    table = _table("ground as built", "quantity", "asked", "built", "tolerance")
    for row in rows:
        values = ("" if v is None else v if isinstance(v, str) else f"{round(v, 6):.6g}" for v in
                  (row.asked, row.built, row.tolerance))  # fmt: skip
        table.add_row(row.name, row.quantity, *values)
    _out.print(table)


def show_findings(findings: "Iterable[Finding]") -> None:
    """Print findings, in words and numbers."""
    for finding in findings:
        say(f"{finding.code}{' FAILS' if finding.failed else ''}: {finding.title}")
        say(f"    {finding.text}")


def show_inputs(files: "list[dict]", wanted: bool) -> None:
    """Print what was read, see `ReadLog.table`, if it is wanted."""
    for line in input_lines(files) if wanted else ():
        say(line)


def show_level(project: "Project") -> None:
    """Print whether the level that is known before a run is plausible; nothing where it is."""
    from ..project.level import expected_peaks, level_findings

    show_findings(level_findings(project, expected_peaks(project)))


def show_input(project: "Project") -> None:
    """Print the peaks of signature, superposed blast and low-passed motion, and what is plausible.

    Parameters
    ----------
    project : Project
        With a motion that enters through a face.
    """
    from ..project.level import input_peaks, level_findings

    stages = project.input
    assert stages is not None
    table = _table("", *stages.signature.components, "vector sum")
    rows = {"single hole": stages.signature, "whole blast": stages.superposed}
    if stages.low_passed is not None:
        rows[f"below {stages.low_passed.corner:g} Hz"] = stages.motion
    for name, s in rows.items():
        table.add_row(name, *(_short(1e3 * v) for v in s.ppv), _short(1e3 * s.pvs))
    say(f"{len(stages.firing.times)} holes; peak particle velocity in mm/s")
    _out.print(table)
    if stages.low_passed is not None:
        low = stages.low_passed
        say(
            f"the filter (-3 dB at {low.corner:g} Hz) removed {_percent(low.removed_energy)} of "
            "the energy of each component"
        )
    if len(stages.firing.times) > 1:
        _show_superposed_bands(project)
    peaks = input_peaks(project)
    for peak in peaks:
        if peak.plausible is not None:
            say(f"{peak.name}: published laws give {peak.plausible} mm/s (5-95 %)")
    show_findings(level_findings(project, peaks))


def _show_superposed_bands(project):
    """Print the bands of the peaks of the whole blast, with holes that vary and without."""
    from ..workflows.run import superposed_bands

    bands, components = superposed_bands(project), project.input.signature.components
    table = _table("whole blast, 90 % of such blasts", *components)
    for name, (low, high) in zip(("holes vary", "holes alike"), bands, strict=True):
        ends = zip(low, high, strict=True)
        table.add_row(name, *(f"{_short(1e3 * a)} to {_short(1e3 * b)}" for a, b in ends))
    _out.print(table)
    percent = project.config.priors.holes_percent
    say(f"holes vary by {percent:.2g} % (priors.holes_percent); alike they radiate as planned")


def show_bands(predicted: "Prediction") -> None:
    """Print the peaks of a further blast and their bands, with holes that vary and without."""
    if not predicted.bands:
        return
    table = _table("PPV in mm/s", "as planned", "90 % of such blasts", "if holes were alike")
    for name, band in predicted.bands.items():
        peak, *ends = (_short(1e3 * value) for value in band)
        table.add_row(name, peak, f"{ends[0]} to {ends[1]}", f"{ends[2]} to {ends[3]}")
    _out.print(table)
    say(f"holes vary by {predicted.holes_percent:.2g} % ({predicted.source})")


def show_comparison(comparison: "Comparison", minimised: bool = True) -> None:
    """Print the deviations per component, and whether a search minimised them."""
    table = _table("simulated against recorded", *comparison.components)
    for name, values in (
        ("PPV", comparison.ppv_deviation),
        ("dominant frequency", comparison.frequency_deviation),
        ("duration", comparison.duration_deviation),
        ("waveform misfit", comparison.waveform_misfit),
    ):
        table.add_row(name, *(_one_percent(v) for v in values))
    table.add_row("lag in ms", *(_number(1e3 * v, 1) for v in comparison.lag))
    table.add_row("correlation then", *(_number(v, 2) for v in comparison.correlation))
    _out.print(table)
    note = "" if minimised else ", which the search did not minimise"
    say(f"mean deviation of PPV and dominant frequency: {comparison.misfit:.1f} %{note}")


def show_compared(comparison: "Comparison", level: "Finding | None", air: list[str]) -> None:
    """Print a comparison of files, the recorded air overpressure, and a level that is far off."""
    show_comparison(comparison)
    for line in air:
        say(line)
    show_findings([level] if level else [])


def _band_words(comparison):
    """Return the band of a comparison, to follow words."""
    if comparison.band is None:
        return ""
    low, high = comparison.band
    return f", {low:.3g} to {high:.3g} Hz"


def show_outcome(outcome: "Outcome") -> None:
    """Print what is implausible, peaks, comparisons, findings and the folder of a run."""
    from ..project.level import CODE, plausible_of_table

    level = [finding for finding in outcome.check.findings if finding.code == CODE]
    show_findings(level)
    tables = outcome.result.summary["receivers"]
    for name, seismogram in outcome.seismograms.items():
        listed = ", ".join(
            f"{component} {_short(1e3 * v)}"
            for component, v in zip(seismogram.components, seismogram.ppv, strict=True)
        )
        plausible = plausible_of_table(tables[name])
        range_ = "" if plausible is None else f"; plausible {plausible}"
        say(f"{name}: PPV in mm/s {listed}; vector sum {_short(1e3 * seismogram.pvs)}{range_}")
    summary = outcome.result.summary
    if summary["stability"]:
        say(f"joints: {summary['stability']['sentence']}")
    say(f"limits: {summary['compliance']['conclusion']}")
    for name, comparison in outcome.comparisons.items():
        say(f"{name}, recorded and simulated{_band_words(comparison)}:")
        show_comparison(comparison)
    for finding in outcome.check.findings:
        if finding in level:
            continue
        say(f"{finding.code}{' FAILS' if finding.failed else ''}: {finding.title}")
    run = outcome.run
    say(
        f"{run.prepared.n_steps} steps of {1e3 * run.dt:.3g} ms in {run.wall_seconds:.0f} s; "
        f"energy balance within {100 * run.balance_error:.2g} %"
    )
    say(f"results: {outcome.folder}")
    say(f"report:  {outcome.folder / 'report.html'}")


def show_site_law(law: "SiteLaw", limit: float | None = None) -> None:
    """Print the law of a site, its lines, and the charges that keep a limit in m/s."""
    low, high = law.beta_interval(0.9)
    unit = f"kg^{law.charge_exponent:.3g}"
    say(
        f"PPV = {1e3 * law.k:.4g} SD^-{law.beta:.3f} mm/s with SD = R / W^{law.charge_exponent:.3g}"
        f" in m/{unit}; 90 % interval of the exponent {low:.2f} to {high:.2f}"
    )
    say(
        f"{law.n} records with SD of {law.reach[0]:.3g} to {law.reach[1]:.3g}; scatter s "
        f"{law.s:.3f} in log10, r2 {law.r2:.2f}; parallel 95 % line of other programs "
        f"{1e3 * law.k95:.4g} mm/s"
    )
    for note in law.notes:
        say(f"- {note}")
    table = _table(f"SD m/{unit}", "50 % mm/s", "95 % mm/s")
    low, high = law.reach
    for scaled in (low * (high / low) ** (step / 6) for step in range(7)):
        lines = (f"{1e3 * law.peak(scaled, 1.0).level(share):.3g}" for share in (0.5, 0.95))
        table.add_row(f"{scaled:.3g}", *lines)
    _out.print(table)
    if limit is not None:
        scaled = law.largest_charge(1.0, limit) ** -law.charge_exponent
        table = _table("distance m", f"charge kg in 8 ms for {1e3 * limit:g} mm/s, 95 %")
        for distance in (50.0, 100.0, 200.0, 500.0, 1000.0):
            charge = (distance / scaled) ** (1.0 / law.charge_exponent)
            table.add_row(f"{distance:g}", _short(charge))
        _out.print(table)


def show_search(
    result: "BackAnalysis", folder: Path, slip: Sequence[str], findings: "Iterable[Finding]"
) -> None:
    """Print the values of a back-analysis, their fit and uncertainty, and its findings."""
    from ..report.back_analysis import fit_lines
    from ..report.survey_design import summarise_survey
    from ..workflows.back_analysis import summarise_fit

    table = _table("parameter", "from", "to", "best", "90 % interval", "constrained")
    for n, parameter in enumerate(result.target.parameters):
        within, value = result.within(n), f"{result.best[parameter.name]:.4g}"
        table.add_row(
            parameter.name, f"{parameter.low:g}", f"{parameter.high:g}",
            "-" if parameter.name in result.unidentifiable else value,
            "-" if within is None else "{:.4g} to {:.4g}".format(*within), result.constraint(n),
        )  # fmt: skip
    _out.print(table)
    if result.plan is not None:
        show_identifiability(summarise_survey(result.plan))
    for line in [*fit_lines(result.fit and summarise_fit(result.fit)), *slip]:
        say(line)
    for blast, confirmed in result.confirmed.items():
        for name, comparison in confirmed.comparisons.items():
            say(f"{blast}, {name}, recorded and simulated{_band_words(comparison)}:")
            show_comparison(comparison, result.target.misfit == "paper")
    show_findings(findings)
    for line in result.missing:
        say(f"not computed: {line}")
    for record, reason in result.target.unused.items():
        say(f"not used: the record {record}: {reason}")
    trace = result.trace
    if result.fit is None:
        say(
            f"misfit '{result.target.misfit}' {trace.misfits[trace.best]:.3g} in run "
            f"{trace.best + 1} of {result.runs} of the search, {result.misfit:.3g} in the full run "
            "that confirmed it"
        )
    say(f"results: {folder}")
    say(f"report:  {folder / 'report.html'}")


def show_survey(plan: "SurveyDesign", folder: Path) -> None:
    """Print how well receivers and blasts would constrain the parameters, and what would help."""
    from ..report.survey_design import summarise_survey

    summary = summarise_survey(plan)
    say("sensitivity at the middle of the ranges; the values are not estimates:")
    show_identifiability(summary)
    for line in (*summary["slip"], *summary["holes"]):
        say(line)
    say(f"noise: {summary['noise']}")
    say(f"results: {folder}")
    say(f"report:  {folder / 'report.html'}")


def show_identifiability(summary: dict) -> None:
    """Print how well each parameter is constrained, from a `summarise_survey`."""
    from ..report.survey_design import best_candidates, survey_lines

    table = _table("parameter", "at", "90 % interval", "posterior/prior", "constrained", "other")
    for row in summary["parameters"]:
        within = "-" if row["why"] else "{:.3g} to {:.3g}".format(*row["within"])
        ratio = "-" if row["why"] else f"{row['ratio']:.2f}"
        other = f"{row['ratio_other']:.2f}"
        table.add_row(row["path"], _short(row["value"]), within, ratio, row["constraint"], other)
    _out.print(table)
    say(
        "posterior/prior: ratio of standard deviations; below 0.3 well constrained, 0.3 to 0.8 "
        f"partly, above hardly. By {summary['by']}; other: by {summary['by_other']}"
    )
    table = _table("one more, or one less", "decrease of ln det", "largest ratio", "parameter")
    for row in best_candidates(summary):
        name = row["name"] if row["kind"] == "receiver" else f"{row['kind']} {row['name']}"
        table.add_row(name, f"{row['gain']:.2g}", f"{row['worst']:.2f}", row["worst_path"])
    _out.print(table)
    for line in survey_lines(summary):
        say(line)


def _short(value: float) -> str:
    """Show three digits without powers of ten."""
    return f"{value:.0f}" if abs(value) >= 1000.0 else f"{value:.3g}"


def _percent(values: Iterable[float]) -> str:
    """Show fractions as percent, leaving out those that are none."""
    return ", ".join("-" if math.isnan(v) else f"{100 * v:.3g} %" for v in values)


def _number(value: float, digits: int) -> str:
    """Show a number, a dash where there is none."""
    return "-" if math.isnan(value) else f"{value:.{digits}f}"


def _one_percent(value: float) -> str:
    """Show one fraction as percent."""
    return "-" if math.isnan(value) else f"{100 * value:+.1f} %"


def show_moment_rate(fit: "MomentRateFit", folder: Path) -> None:
    """Show a moment rate found from records: peak, misfit, uncertainty, file."""
    figures = fit.summary
    peak, deviation = figures["peak_moment_rate_per_kg"], figures["peak_deviation"]
    say(
        f"moment rate of 1 kg, up to {fit.band:.3g} Hz: peak {peak:.3g} N m/s +- "
        f"{abs(100.0 * deviation / peak):.2g} % at {1e3 * figures['peak_at_s']:.3g} ms"
    )
    for name, misfit in fit.misfit.items():
        held_out = fit.held_out.get(name)
        words = "" if held_out is None else f", {100 * held_out:.2g} % by the other receivers alone"
        say(f"{name}: {100 * misfit:.2g} % of the energy unexplained{words}")
    say(f"results: {folder}; set holes_inside.moment_rate_file to its moment_rate.csv")
