"""Report of a back-analysis: fit, intervals, posterior, figures."""

from typing import Any

import numpy as np
from matplotlib.ticker import MaxNLocator
from scipy import ndimage

from ..project.result import plain, write_text
from . import figures
from .figures import INK, SIMULATED, _figure, _tidy, _uri
from .run import page, with_waveforms
from .survey_design import best_candidates, result_figures, slip_lines, summary_lines, survey_figure

SHOWN = 0.5  # least correlation that is listed


def summarise_posterior(posterior, parameters):
    """Return the plain numbers of a posterior, None without one.

    Parameters
    ----------
    posterior : Posterior or None
    parameters : sequence of Parameter
    """
    if posterior is None:
        return None
    intervals = [None] * len(parameters) if posterior.failure else posterior.intervals.tolist()
    return {
        "failure": posterior.failure,
        "mesh_error_missing": posterior.mesh_error_missing,
        "seed": posterior.seed,
        "runs": posterior.runs,
        "checks": len(posterior.log_weights),
        "effective_checks": posterior.effective,
        "effective_checks_corrected": posterior.corrected,
        "autocorrelation_steps": posterior.chains.autocorrelation,
        "steps": posterior.chains.x.shape[1],
        "split_r_hat": posterior.chains.r_hat,
        "accepted": posterior.chains.accepted,
        "independent_draws": posterior.chains.independent,
        "parameters": [
            {"path": row.name, "low": row.low, "high": row.high, "log": row.log,
             "median": None if posterior.failure else float(np.median(samples)),
             "interval_90": interval}
            for row, samples, interval
            in zip(parameters, posterior.samples.T, intervals, strict=True)
        ],
        "correlation": posterior.correlation,
        "samples": posterior.samples,
    }  # fmt: skip


def posterior_lines(table) -> list[str]:
    """Return sentences on a summarised posterior and its checks; none without one."""
    if table is None:
        return []
    worst, slowest = (float(np.max(table[key])) for key in ("split_r_hat", "autocorrelation_steps"))
    checks = (
        f"{table['runs']} runs; the last {table['checks']} check the emulator of the chains: "
        f"effective sample size {table['effective_checks']:.1f}, after the correction "
        f"{table['effective_checks_corrected']:.1f}; split R-hat "
        f"{worst:.4f}, autocorrelation {slowest:.0f} of {table['steps']} steps, seed "
        f"{table['seed']}"
    )
    missing = table["mesh_error_missing"]
    missing = [f"{missing}; the intervals do not include it"] if missing else []
    if table["failure"]:
        return [f"no intervals: {table['failure']}", checks]
    rows = table["parameters"]
    lines = [
        f"{row['path']}: {row['median']:.4g}, 90 % interval {row['interval_90'][0]:.4g} to "
        f"{row['interval_90'][1]:.4g}"
        for row in rows
    ]
    correlation = np.asarray(table["correlation"])
    for i, j in zip(*np.triu_indices(len(rows), 1), strict=True):
        if abs(correlation[i, j]) >= SHOWN:
            lines.append(
                f"{rows[i]['path']} and {rows[j]['path']} trade off: correlation "
                f"{correlation[i, j]:+.2f}"
            )
    return [*lines, *missing, checks]


BINS, FINE = 30, 60
BLUR = 2.0  # cells of the fine grid
HELD = (0.9, 0.5)
DRAWN = 600


def corner_figure(parameters, samples):
    """Draw the marginal posterior of each parameter and of each pair: a corner plot.

    Parameters
    ----------
    parameters : list of dict
        ``path``, ``low``, ``high``, ``log``, ``interval_90``.
    samples : (m, n) float64
    """
    n = len(parameters)
    figure = _figure(min(9.6, 2.0 + 1.9 * n), min(9.6, 1.4 + 1.7 * n))
    axes = figure.subplots(n, n, squeeze=False)
    limits = [_limits(row, column) for row, column in zip(parameters, samples.T, strict=True)]
    for i, j in np.ndindex(n, n):
        axis: Any = axes[i, j]
        if j > i:
            axis.set_visible(False)
            continue
        if i == j:
            _marginal(axis, parameters[i], samples[:, i], limits[i])
        else:
            _pair(axis, samples[:, j], samples[:, i], (limits[j], limits[i]),
                  (parameters[j]["log"], parameters[i]["log"]))  # fmt: skip
        _ends(axis, parameters, limits, i, j)
    return _uri(figure)


def _limits(row, column):
    """Return the part of a range that the samples cover, with a margin."""
    low, high = np.quantile(column, [0.002, 0.998])
    if row["log"]:
        margin = (high / low) ** 0.15
        return max(row["low"], low / margin), min(row["high"], high * margin)
    margin = 0.15 * (high - low)
    return max(row["low"], low - margin), min(row["high"], high + margin)


def _edges(limits, log, count):
    """Return the edges of bins."""
    return (np.geomspace if log else np.linspace)(limits[0], limits[1], count + 1)


def _marginal(axis, row, column, limits):
    """Draw the histogram of a parameter; the interval is dark."""
    edges = _edges(limits, row["log"], BINS)
    count, _ = np.histogram(column, edges)
    low, high = row["interval_90"]
    middle = np.sqrt(edges[1:] * edges[:-1]) if row["log"] else 0.5 * (edges[1:] + edges[:-1])
    shade = np.where((middle >= low) & (middle <= high), SIMULATED, "#d8dde3")
    axis.bar(edges[:-1], count, np.diff(edges), align="edge", color=shade)
    axis.set_title(f"{low:.3g} to {high:.3g}", fontsize=8, color=INK)
    axis.set_yticks([])


def _pair(axis, across, up, limits, logs):
    """Draw two parameters against each other, with their 50 and 90 % regions."""
    axis.plot(across[:DRAWN], up[:DRAWN], ".", color="#9aa5b1", ms=1.5, alpha=0.6)
    edges = [_edges(limit, log, FINE) for limit, log in zip(limits, logs, strict=True)]
    density = ndimage.gaussian_filter(np.histogram2d(across, up, edges)[0], BLUR)
    ordered = np.sort(density.ravel())[::-1]
    held = np.cumsum(ordered) / ordered.sum()
    levels = [float(ordered[np.searchsorted(held, share)]) for share in HELD]
    middles = [0.5 * (edge[1:] + edge[:-1]) for edge in edges]
    if levels[0] < levels[1]:
        axis.contour(*middles, density.T, levels, colors=SIMULATED, linewidths=[0.8, 1.4])


def _ends(axis, parameters, limits, i, j):
    """Scale an axis, and label it at the edge of the figure."""
    n = len(parameters)
    for k, part, log in ((j, "x", parameters[j]["log"]), (i, "y", parameters[i]["log"])):
        if part == "y" and i == j:
            continue
        wide = limits[k][1] > 5.0 * limits[k][0] > 0.0
        getattr(axis, f"set_{part}scale")("log" if log and wide else "linear")
        getattr(axis, f"set_{part}lim")(*limits[k])
        if not (log and wide):
            getattr(axis, f"{part}axis").set_major_locator(MaxNLocator(3))
    _tidy(axis)
    axis.grid(False)
    axis.tick_params(labelsize=7, labelbottom=i == n - 1, labelleft=j == 0 and i > 0)
    if i == n - 1:
        axis.set_xlabel(_name(parameters[j]["path"]), fontsize=8)
    if j == 0 and i > 0:
        axis.set_ylabel(_name(parameters[i]["path"]), fontsize=8)


def _name(path):
    """Return a path in two lines."""
    table, _, rest = path.partition(".")
    return f"{table}\n{rest}"


REJECTED = "#9aa5b1"


def misfit_figure(misfits, accepted, unit):
    """Draw the misfit of every run, accepted or rejected, and the best so far.

    Parameters
    ----------
    misfits : (n,) float64
        Not finite where a run failed; not drawn.
    accepted : (n,) bool
    unit : str
    """
    figure = _figure(9.6, 3.0)
    axes, run = figure.subplots(), np.arange(1, len(misfits) + 1)
    best = np.minimum.accumulate(np.where(np.isfinite(misfits), misfits, np.inf))
    axes.step(run, best, where="post", color=SIMULATED, lw=1.4, label="best so far")
    for shown, colour, label in ((accepted, INK, "accepted"), (~accepted, REJECTED, "rejected")):
        axes.plot(run[shown], misfits[shown], "o", color=colour, ms=4, label=label)
    axes.set_xlabel("run")
    axes.set_ylabel(f"misfit  {unit}")
    axes.set_ylim(0.0, 1.1 * np.max(misfits, where=np.isfinite(misfits), initial=0.0))
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.legend(fontsize=7, frameon=False, ncol=3)
    _tidy(axes)
    return _uri(figure)


def points_figure(parameters, points, misfits, unit):
    """Draw misfit against each parameter over its range; the best point is marked.

    Parameters
    ----------
    parameters : list of dict
        ``path``, ``low``, ``high``, ``log``.
    points : (n, n_parameters) float64
    misfits : (n,) float64
    unit : str
    """
    columns = min(3, len(parameters))
    rows = -(-len(parameters) // columns)
    figure = _figure(9.6, 0.4 + 2.5 * rows)
    axes = figure.subplots(rows, columns, squeeze=False, sharey=True)
    best = int(np.argmin(misfits))
    top = 1.1 * np.max(misfits, where=np.isfinite(misfits), initial=0.0)
    for number, (row, axis) in enumerate(zip(parameters, axes.flat, strict=False)):
        values = points[:, number]
        shades = np.linspace(0.25, 1.0, len(values))
        axis.scatter(values, misfits, c=shades, cmap="Greys", vmin=0.0, s=14, zorder=3)
        axis.plot(values[best], misfits[best], "o", color=SIMULATED, ms=6, zorder=4)
        if row["log"]:
            axis.set_xscale("log")
            ticks = np.geomspace(row["low"], row["high"], 3)
            axis.set_xticks(ticks, [f"{tick:.2g}" for tick in ticks])
            axis.set_xticks([], minor=True)
        margin = 0.0 if row["log"] else 0.03 * (row["high"] - row["low"])
        axis.set_xlim(row["low"] - margin, row["high"] + margin)
        axis.set_ylim(0.0, top)
        axis.set_xlabel(row["path"], fontsize=8)
        _tidy(axis)
    for axis in axes[:, 0]:
        axis.set_ylabel(f"misfit  {unit}")
    for axis in axes.flat[len(parameters) :]:
        axis.set_visible(False)
    return _uri(figure)


SPECTRUM_TOP = 40.0
FINAL_COVARIANCE = (
    " The misfits of all runs use the final covariance; trials.jsonl holds those at the time of "
    "each run."
)


def write_search_report(path, summary, confirmed):
    """Write the page of a back-analysis.

    Parameters
    ----------
    path : path
    summary : dict
        Of `summarise_search`.
    confirmed : dict of str to Confirmed
        Full runs of the best point, by blast.
    """
    plan, trace = summary["plan"], summary["trace"]
    points, misfits = (np.array(trace[name]) for name in ("points", "misfits"))
    drawn = [
        *result_figures(plan, points, misfits),
        *_posterior_figures(summary["posterior"]),
        survey_figure(plan),
        *_search_figures(summary),
        *_motion_figures(confirmed),
    ]
    heads = "title", "caption", "image"
    rows, waves = with_waveforms([dict(zip(heads, row, strict=True)) for row in drawn])
    text = page("back_analysis.html").render(
        s=plain(summary),
        laboratory=any(row["laboratory"] is not None for row in summary["parameters"]),
        candidates=plain(best_candidates(plan)),
        lines=summary_lines(plan),
        posterior=posterior_lines(summary["posterior"]),
        slip=[
            line for name, blast in summary["blasts"].items() for line in slip_lines(name, blast)
        ],
        figures=rows,
        waves=waves,
    )
    write_text(path, text)


def _posterior_figures(table):
    """Yield the figure of the posterior, if it has intervals."""
    if table is not None and not table["failure"]:
        yield (
            "Posterior",
            f"{len(table['samples'])} samples of the posterior: histogram of each parameter with "
            "its 90 % interval, and each pair with its 50 and 90 % regions.",
            corner_figure(table["parameters"], np.asarray(table["samples"])),
        )


def _search_figures(summary):
    """Yield the figures of the search."""
    trace = {name: np.array(value) for name, value in summary["trace"].items()}
    unit = summary["misfit_unit"]
    yield (
        "Misfit",
        f"Misfit of each run; method '{summary['method']}', seed {summary['seed']}. The search "
        f"accepted {summary['accepted']} of {summary['runs']}, further starts included."
        f"{FINAL_COVARIANCE if summary['misfit_name'] == 'waveform' else ''}",
        misfit_figure(trace["misfits"], trace["accepted"], unit),
    )
    yield (
        "Search",
        "Misfit against each parameter over its range; later runs darker, the best coloured.",
        points_figure(summary["parameters"], trace["points"], trace["misfits"], unit),
    )


def _filtered(corner):
    """Return the low-pass of sources and records in words, empty without one."""
    return f", both low-passed at {corner:.3g} Hz like the sources" if corner else ""


def _motion_figures(confirmed):
    """Yield recorded and simulated motion at the best point (figures 7 to 9 of the paper)."""
    for blast, run in confirmed.items():
        for name, record in run.recorded.items():
            both = {"recorded": record, "simulated": run.simulated[name]}
            yield (
                f"Receiver {name}",
                f"{blast}, {name}: recorded against simulated at the best point"
                f"{_filtered(record.low_passed)}; particle velocity and smoothed amplitude "
                "spectrum.",
                figures.waveform_figure(
                    both, [figures.RECORDED, figures.SIMULATED], SPECTRUM_TOP,
                    float(run.simulated[name].times[-1]),
                ),
            )  # fmt: skip
