"""What the commands show on a terminal or in a log: tables, sentences, progress."""

import sys
import time

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, TextColumn, TimeRemainingColumn
from rich.progress import Progress as Bar
from rich.table import Table

from ..report.back_analysis import posterior_lines, summarise_posterior
from ..report.survey_design import best_extras, summarise_plan, told_lines

STAGES = {
    "input": "input motion",
    "mesh": "mesh",
    "check": "checks",
    "static": "static stage",
    "dynamic": "dynamic stage",
    "trials": "runs of the search",
    "plan": "runs of the plan",
    "calibration": "calibration",
    "holes": "runs of the holes",
    "delays": "search of delays",
    "writing": "results and report",
}
WIDE = None if sys.stdout.isatty() else 120  # columns of a log
_out = Console(highlight=False, soft_wrap=True, width=WIDE)
_err = Console(highlight=False, soft_wrap=True, stderr=True)


def say(text):
    """Print a line."""
    _out.print(text, markup=False)


def complain(text):
    """Print a line to standard error."""
    _err.print(f"pyblast: {text}", markup=False)


class Progress:
    """Show how far a run is: a bar on a terminal, plain lines elsewhere."""

    def __init__(self):
        """Find out whether a person is watching."""
        self._bar = None
        if sys.stdout.isatty():
            columns = TextColumn("{task.description:<20}"), BarColumn(), TimeRemainingColumn()
            self._bar = Bar(*columns, console=_out, transient=True)
        self._task, self._stage, self._began, self._shown = None, None, 0.0, 0.0
        self._first = 0

    def __enter__(self):
        if self._bar is not None:
            self._bar.start()
        return self

    def __exit__(self, *_):
        if self._bar is not None:
            self._bar.stop()

    def __call__(self, stage, done, total):
        """Take note of ``done`` of ``total`` in a stage."""
        name = STAGES.get(stage, stage)
        if stage != self._stage:
            self._stage, self._began, self._shown = stage, time.perf_counter(), 0.0
            self._first = done
            if self._bar is None:
                say(f"pyblast: {name}")
            else:
                self._task = self._bar.add_task(name, total=total)
        if self._bar is not None:
            self._bar.update(self._task, completed=done, total=total)
        elif total > 1 and done / total >= self._shown + 0.1:
            self._shown = done / total
            spent = time.perf_counter() - self._began
            left = spent * (total - done) / (done - self._first) if done > self._first else None
            guess = "" if left is None else f", about {left:.0f} s left"
            say(f"pyblast: {name} {100 * done / total:.0f} %{guess}")


def _table(*heads):
    """Return an empty table with numbers to the right."""
    table = Table(box=None, pad_edge=False)
    for number, head in enumerate(heads):
        justify = "left" if number == 0 else "right"
        table.add_column(head, justify=justify, overflow="fold")
    return table


def show_census(census):
    """Print counts, sizes, frequencies, time step and cost."""
    table = _table(
        "material", "zones", "volume m3", "mass t", "edge m", "quality", "carries Hz", "added %"
    )
    for g in census.groups:
        table.add_row(
            g.name, f"{g.zones}", f"{g.volume:.4g}", f"{1e-3 * g.mass:.4g}", f"{g.mean_edge:.3g}",
            f"{g.smallest_quality:.2f}", f"{g.highest_frequency:.3g}", f"{100 * g.added_share:.2g}",
        )  # fmt: skip
    _out.print(table)
    say(
        f"{census.zones} zones, {census.nodes} nodes, {census.contacts} contacts, "
        f"{census.blocks} blocks; memory about {census.memory / 2**20:.0f} MB"
    )
    say(
        f"time step {1e3 * census.dt:.3g} ms, limited by {census.limited_by}; added mass "
        f"{100 * census.added_mass:.2g} %; {census.steps} steps"
    )
    if census.seconds is not None:
        say(f"estimated time {census.seconds:.0f} s, beside the static stage")


def show_check(found):
    """Print the census, the notes on the holes, and every finding."""
    show_census(found.census)
    for note in found.notes:
        say(f"- {note}")
    show_findings(found.findings)


def show_findings(findings):
    """Print what is doubtful, in words and numbers."""
    for finding in findings:
        say(f"{finding.code}{' FAILS' if finding.failed else ''}: {finding.title}")
        say(f"    {finding.text}")


def show_input(stages):
    """Print the peaks of signature, superposed blast and low-passed motion."""
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
            f"the filter (-6 dB at {low.corner:g} Hz, -3 dB at {low.corner_3db:.3g} Hz, no phase "
            f"shift) took {_percent(low.removed_energy)} of the energy of each component"
        )


def show_comparison(comparison, wanted=True):
    """Print the deviations per component, whether or not a search wanted them small."""
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
    beside = "" if wanted else ", which was no target"
    say(f"mean deviation of PPV and dominant frequency: {comparison.misfit:.1f} %{beside}")


def show_outcome(outcome):
    """Print peaks at the receivers, comparisons, defects and where everything lies."""
    for name, seismogram in outcome.seismograms.items():
        listed = ", ".join(
            f"{component} {_short(1e3 * v)}"
            for component, v in zip(seismogram.components, seismogram.ppv, strict=True)
        )
        say(f"{name}: PPV in mm/s {listed}; vector sum {_short(1e3 * seismogram.pvs)}")
    for name, comparison in outcome.comparisons.items():
        say(f"{name}, recorded and simulated:")
        show_comparison(comparison)
    for finding in outcome.check.findings:
        say(f"{finding.code}{' FAILS' if finding.failed else ''}: {finding.title}")
    run = outcome.run
    say(
        f"{run.prepared.n_steps} steps of {1e3 * run.dt:.3g} ms in {run.wall_seconds:.0f} s; "
        f"energy balance within {100 * run.balance_error:.2g} %"
    )
    say(f"results: {outcome.folder}")
    say(f"report:  {outcome.folder / 'report.html'}")


def show_site_law(law, limit=None):
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
    for scaled in np.geomspace(*law.reach, 7):
        lines = (f"{1e3 * law.line(scaled, 1.0, share):.3g}" for share in (0.5, 0.95))
        table.add_row(f"{scaled:.3g}", *lines)
    _out.print(table)
    if limit is not None:
        scaled = law.largest_charge(1.0, limit) ** -law.charge_exponent
        table = _table("distance m", f"charge kg in 8 ms for {1e3 * limit:g} mm/s, 95 %")
        for distance in (50.0, 100.0, 200.0, 500.0, 1000.0):
            charge = (distance / scaled) ** (1.0 / law.charge_exponent)
            table.add_row(f"{distance:g}", _short(charge))
        _out.print(table)


def show_search(found, folder, lines, findings):
    """Print what a back-analysis found, how it fits, what it can't tell, and what is doubtful."""
    table = _table("unknown", "from", "to", "found")
    for one in found.target.parameters:
        value = f"{found.best[one.name]:.4g}"
        table.add_row(
            one.name, f"{one.low:g}", f"{one.high:g}",
            "-" if one.name in found.insensitive else value,
        )  # fmt: skip
    _out.print(table)
    show_told(summarise_plan(found.plan))
    drawn = summarise_posterior(found.posterior, found.target.parameters)
    for line in [*posterior_lines(drawn), *lines]:
        say(line)
    for blast, one in found.confirmed.items():
        for name, comparison in one.comparisons.items():
            say(f"{blast}, {name}, recorded and simulated:")
            show_comparison(comparison, found.target.misfit == "paper")
    show_findings(findings)
    trace = found.trace
    say(
        f"misfit '{found.target.misfit}' {trace.misfits[trace.best]:.3g} in run {trace.best + 1} "
        f"of {len(trace.misfits)} of the search, {found.misfit:.3g} in the full run that confirmed "
        "it"
    )
    if drawn is not None and not drawn["doubt"]:
        say("the medians and intervals of the posterior take the place of what the search found")
    say(f"results: {folder}")
    say(f"report:  {folder / 'report.html'}")


def _short(value):
    """Show three digits without powers of ten."""
    return f"{value:.0f}" if abs(value) >= 1000.0 else f"{value:.3g}"


def show_plan(plan, folder):
    """Print what receivers and blasts can tell, what would help, and why."""
    summary = summarise_plan(plan)
    say("what could be told in the middle of the ranges; no record was looked at for the values:")
    show_told(summary)
    for line in summary["slip"]:
        say(line)
    say(f"noise: {summary['noise']}")
    say(f"results: {folder}")
    say(f"report:  {folder / 'report.html'}")


def show_told(summary):
    """Print what is told of unknowns, from a `summarise_plan`."""
    table = _table("unknown", "at", "90 % within", "after/before", "", "other")
    for one in summary["parameters"]:
        within = "-" if one["why"] else "{:.3g} to {:.3g}".format(*one["within"])
        share = "-" if one["why"] else f"{one['share']:.2f}"
        other = f"{one['share_other']:.2f}"
        table.add_row(one["path"], _short(one["value"]), within, share, one["verdict"], other)
    _out.print(table)
    say(f"by {summary['by']}; other: by {summary['by_other']}")
    table = _table("one more, or one less", "ln det falls by", "worst then", "which is")
    for one in best_extras(summary):
        name = one["name"] if one["kind"] == "receiver" else f"{one['kind']} {one['name']}"
        table.add_row(name, f"{one['gain']:.2g}", f"{one['worst']:.2f}", one["worst_path"])
    _out.print(table)
    for line in told_lines(summary):
        say(line)


def _percent(values):
    """Show fractions as percent, leaving out those that are none."""
    return ", ".join("-" if np.isnan(v) else f"{100 * v:.3g} %" for v in values)


def _number(value, digits):
    """Show a number, a dash where there is none."""
    return "-" if np.isnan(value) else f"{value:.{digits}f}"


def _one_percent(value):
    """Show one fraction as percent."""
    return "-" if np.isnan(value) else f"{100 * value:+.1f} %"
