"""Page and figure of the searches."""

from pathlib import Path

from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from verification.markdown import reflow

DOCS = Path(__file__).resolve().parents[1] / "docs"
PAGE, FIGURE = DOCS / "quality" / "searches.md", DOCS / "figures" / "searches.png"
LABELS = {
    "random": ("random, the baseline", "black"),
    "paper": ("paper's annealing", "tab:red"),
    "paper_eq15": ("the same by its eq. (15)", "tab:orange"),
    "levenberg": ("Gauss-Newton (Levenberg)", "tab:purple"),
}
TITLES = {"paper": "The paper's misfit", "waveform": "Waveform least squares"}
WORDS = """# Searches

Written by `python -m benchmarks.searches`. Which method finds the parameters of two faults in the
fewest runs? {twins} synthetic tests, each with its own truth, noise and seed; two dipping faults in
180 × 120 × 80 m of rock, three receivers, four pulses 40 ms apart. The parameters are
{unknowns},
in ranges over factors of 10 to 25, searched in logarithm, with truths in their inner 80 %. Records
are full runs on a finer mesh of another pattern, with noise of {noise:.0f} % of their rms that
falls as 1/f. Evaluations go through a reduced model of {trained} runs: its waveforms differ from
{confirmed_count} full runs at truths by at most {confirmed:.2f} %.

![Best misfit and error of parameters against runs](../figures/searches.png)

Medians over the tests. *Error*: mean distance of the parameters of the best run from the truth, in
per cent of the (log) ranges; the middle of the ranges has {middle:.0f} on average, and a best fit
cannot reach zero, since mesh and noise are not those of the records. *Better*: share of tests in
which the best misfit is below that of random search after as many runs. *Rounds*: batches of up to
eight models run together for 20 and 200 runs.

{tables}
## The paper's settings

T0 = 1000, multiplied by 0.9 at each move. In the 20 runs of a search, {uphill}.
Moves are hardly ever refused while the temperature exceeds the differences of misfits: the search
is a random walk whose steps shrink around its present point, and after 20 runs they are below 1 %
of the ranges.

## Methods

| name | what it does |
|---|---|
| `paper`, `paper_eq15` | the paper's annealing, T0 = 1000 or F_max − F_min |
| `random` | does not use earlier runs |
| `levenberg` | damped Gauss–Newton on residuals, differences in one batch, Broyden updates |
"""
MIDDLE = 20.0  # mean distance of even truths in the inner 80 % from the middle, % of the ranges


def write_page(found):
    """Write the figure and docs/quality/searches.md."""
    _figure(found)
    tables = "\n".join(_table(found, name) for name in found["misfits"])
    page = WORDS.format(
        twins=found["twins"], noise=100.0 * found["noise"], trained=found["trained"],
        unknowns=", ".join(found["unknowns"]), confirmed=100.0 * max(found["confirmed"]),
        confirmed_count=len(found["confirmed"]), middle=MIDDLE, tables=tables,
        uphill=_uphill(found),
    )  # fmt: skip
    PAGE.write_text(reflow(page), encoding="utf-8")


def _table(found, name):
    """Return the table of one misfit."""
    part, budgets = found["misfits"][name], found["budgets"]
    low, middle, high = part["random misfits"]
    runs = " | ".join(f"{budget}" for budget in budgets)
    lines = [
        f"## {TITLES[name]}\n",
        f"At the truth {part['at truth']:.1f} %; at random places {middle:.0f} % "
        f"({low:.0f} to {high:.0f} in nine of ten).\n",
        f"| misfit % after runs | {runs} | error % after {runs.replace(' |', ',')} "
        "| better at 20, 200 | rounds |",
        "|---" * (len(budgets) + 4) + "|",
    ]
    for method, row in part["methods"].items():
        misfits = " | ".join(f"{value:.2f}" for value in row["misfit"][1])
        errors = ", ".join(f"{value:.0f}" for value in row["error"][1])
        better = (
            ""
            if method == "random"
            else ", ".join(f"{row['misfit better'][k]:.0%}" for k in (0, -1))
        )
        rounds = f"{row['rounds'][0]:.0f}, {row['rounds'][-1]:.0f}"
        lines.append(f"| {LABELS[method][0]} | {misfits} | {errors} | {better} | {rounds} |")
    return "\n".join(lines) + "\n"


def _uphill(found):
    """Say how many moves up were accepted."""
    words = []
    for name, part in found["misfits"].items():
        (up, taken), (other, kept) = part["uphill"]["paper"], part["uphill"]["paper_eq15"]
        words.append(
            f"{taken} of {up} moves to a higher misfit were accepted with {TITLES[name].lower()} "
            f"({kept} of {other} with T0 from eq. (15))"
        )
    return "; ".join(words)


def _figure(found):
    """Draw medians against runs: misfits above, errors below."""
    names, runs = list(found["misfits"]), found["budgets"]
    figure = Figure(figsize=(9.0, 7.0))
    axes = figure.subplots(2, len(names), sharex=True, squeeze=False)
    for name, (above, below) in zip(names, axes.T, strict=True):
        for method, row in found["misfits"][name]["methods"].items():
            label, colour = LABELS[method]
            style = {"color": colour, "marker": "o", "markersize": 3.5, "label": label}
            above.plot(runs, row["misfit"][1], **style)
            below.plot(runs, row["error"][1], **style)
        truth = found["misfits"][name]["at truth"]
        above.axhline(truth, color="black", linewidth=0.8, linestyle=":")
        above.text(runs[-1], truth, "at the truth", ha="right", va="bottom", fontsize=8)
        above.set(yscale="log", title=TITLES[name])
        above.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        above.yaxis.set_major_formatter("{x:g}")
        above.yaxis.set_minor_formatter("")
        below.set(xscale="log", xlabel="runs", ylim=(0.0, None))
        below.set_xticks(runs, [str(run) for run in runs])
        below.minorticks_off()
    axes[0, 0].set_ylabel("best misfit, %")
    axes[1, 0].set_ylabel("error of parameters, % of ranges")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, ncols=4, loc="lower center", fontsize=8, frameon=False)
    figure.tight_layout(rect=(0.0, 0.07, 1.0, 1.0))
    figure.savefig(FIGURE, dpi=100)
