"""Report of a back-analysis: fit, intervals, posterior, figures."""

import numpy as np
from matplotlib.ticker import MaxNLocator
from scipy import ndimage

from ..project.result import plain, write_text
from . import figures
from .figures import INK, SIMULATED, _figure, _tidy, _uri
from .html import page
from .survey_design import best_extras, found_figures, plan_figure, slip_lines, told_lines

SHOWN = 0.5  # correlations below are not told


def summarise_posterior(found, parameters):
    """Return a posterior as plain numbers, None where none was asked for.

    Parameters
    ----------
    found : Posterior or None
    parameters : sequence of Parameter
    """
    if found is None:
        return None
    intervals = [None] * len(parameters) if found.doubt else found.intervals.tolist()
    return {
        "doubt": found.doubt,
        "mesh_doubt": found.mesh_doubt,
        "seed": found.seed,
        "runs": found.runs,
        "checks": len(found.log_weights),
        "effective_checks": found.effective,
        "effective_checks_corrected": found.corrected,
        "autocorrelation_steps": found.chains.autocorrelation,
        "steps": found.chains.places.shape[1],
        "split_r_hat": found.chains.r_hat,
        "accepted": found.chains.accepted,
        "independent_draws": found.chains.independent,
        "parameters": [
            {"path": one.name, "low": one.low, "high": one.high, "log": one.log,
             "median": None if found.doubt else float(np.median(column)), "interval_90": interval}
            for one, column, interval in zip(parameters, found.samples.T, intervals, strict=True)
        ],
        "correlation": found.correlation,
        "samples": found.samples,
    }  # fmt: skip


def posterior_lines(table) -> list[str]:
    """Say what a summarised posterior tells and what it rests on; nothing without one."""
    if table is None:
        return []
    worst, slowest = (float(np.max(table[key])) for key in ("split_r_hat", "autocorrelation_steps"))
    checks = (
        f"{table['runs']} runs; the last {table['checks']} check the emulator on which the walks "
        f"went, and agree with it as well as {table['effective_checks']:.1f} that agree wholly, "
        f"after their correction {table['effective_checks_corrected']:.1f}; split R-hat "
        f"{worst:.4f}, autocorrelation {slowest:.0f} of {table['steps']} steps, seed "
        f"{table['seed']}"
    )
    doubt = [f"{table['mesh_doubt']}; it is not in the intervals"] * bool(table["mesh_doubt"])
    if table["doubt"]:
        return [f"no intervals: {table['doubt']}", checks]
    rows = table["parameters"]
    told = [
        f"{one['path']}: {one['median']:.4g}, 90 % between {one['interval_90'][0]:.4g} and "
        f"{one['interval_90'][1]:.4g}"
        for one in rows
    ]
    correlation = np.asarray(table["correlation"])
    for i, j in zip(*np.triu_indices(len(rows), 1), strict=True):
        if abs(correlation[i, j]) >= SHOWN:
            told.append(
                f"{rows[i]['path']} and {rows[j]['path']}: correlation {correlation[i, j]:+.2f}, "
                "one makes up for the other"
            )
    return [*told, *doubt, checks]


BINS, FINE = 30, 60
BLUR = 2.0  # cells of the fine grid
HELD = (0.9, 0.5)
DRAWN = 600


def corner_figure(parameters, samples):
    """Draw samples of all unknowns, each alone and in pairs.

    Parameters
    ----------
    parameters : list of dict
        ``path``, ``low``, ``high``, ``log``, ``interval_90``.
    samples : (m, n) float64
    """
    n = len(parameters)
    figure = _figure(min(9.6, 2.0 + 1.9 * n), min(9.6, 1.4 + 1.7 * n))
    axes = figure.subplots(n, n, squeeze=False)
    limits = [_limits(one, column) for one, column in zip(parameters, samples.T, strict=True)]
    for i, j in np.ndindex(n, n):
        axis = axes[i, j]
        if j > i:
            axis.set_visible(False)
            continue
        if i == j:
            _alone(axis, parameters[i], samples[:, i], limits[i])
        else:
            _pair(axis, samples[:, j], samples[:, i], (limits[j], limits[i]),
                  (parameters[j]["log"], parameters[i]["log"]))  # fmt: skip
        _ends(axis, parameters, limits, i, j)
    return _uri(figure)


def _limits(one, column):
    """Return the part of a range that samples fill, with a margin."""
    low, high = np.quantile(column, [0.002, 0.998])
    if one["log"]:
        margin = (high / low) ** 0.15
        return max(one["low"], low / margin), min(one["high"], high * margin)
    margin = 0.15 * (high - low)
    return max(one["low"], low - margin), min(one["high"], high + margin)


def _edges(limits, log, count):
    """Return the edges of bins."""
    return (np.geomspace if log else np.linspace)(*limits, count + 1)


def _alone(axis, one, column, limits):
    """Draw how often an unknown has which value; the interval is dark."""
    edges = _edges(limits, one["log"], BINS)
    count, _ = np.histogram(column, edges)
    low, high = one["interval_90"]
    middle = np.sqrt(edges[1:] * edges[:-1]) if one["log"] else 0.5 * (edges[1:] + edges[:-1])
    shade = np.where((middle >= low) & (middle <= high), SIMULATED, "#d8dde3")
    axis.bar(edges[:-1], count, np.diff(edges), align="edge", color=shade)
    axis.set_title(f"{low:.3g} to {high:.3g}", fontsize=8, color=INK)
    axis.set_yticks([])


def _pair(axis, across, up, limits, logs):
    """Draw two unknowns against each other, with the regions that hold 50 and 90 %."""
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
    """Scale an axis and name it where it stands at the edge."""
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


REFUSED = "#9aa5b1"


def misfit_figure(misfits, accepted, unit):
    """Draw the misfit of every run, whether the search went on from it, and the best so far.

    Parameters
    ----------
    misfits : (n,) float64
        Not finite where a run failed; these are left out.
    accepted : (n,) bool
    unit : str
    """
    figure = _figure(9.6, 3.0)
    axes, run = figure.subplots(), np.arange(1, len(misfits) + 1)
    best = np.minimum.accumulate(np.where(np.isfinite(misfits), misfits, np.inf))
    axes.step(run, best, where="post", color=SIMULATED, lw=1.4, label="best so far")
    for shown, colour, label in ((accepted, INK, "accepted"), (~accepted, REFUSED, "refused")):
        axes.plot(run[shown], misfits[shown], "o", color=colour, ms=4, label=label)
    axes.set_xlabel("run")
    axes.set_ylabel(f"misfit  {unit}")
    axes.set_ylim(0.0, 1.1 * np.max(misfits, where=np.isfinite(misfits), initial=0.0))
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.legend(fontsize=7, frameon=False, ncol=3)
    _tidy(axes)
    return _uri(figure)


def places_figure(parameters, points, misfits, unit):
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
    for number, (one, axis) in enumerate(zip(parameters, axes.flat, strict=False)):
        place = points[:, number]
        shades = np.linspace(0.25, 1.0, len(place))
        axis.scatter(place, misfits, c=shades, cmap="Greys", vmin=0.0, s=14, zorder=3)
        axis.plot(place[best], misfits[best], "o", color=SIMULATED, ms=6, zorder=4)
        if one["log"]:
            axis.set_xscale("log")
            ticks = np.geomspace(one["low"], one["high"], 3)
            axis.set_xticks(ticks, [f"{tick:.2g}" for tick in ticks])
            axis.set_xticks([], minor=True)
        margin = 0.0 if one["log"] else 0.03 * (one["high"] - one["low"])
        axis.set_xlim(one["low"] - margin, one["high"] + margin)
        axis.set_ylim(0.0, top)
        axis.set_xlabel(one["path"], fontsize=8)
        _tidy(axis)
    for axis in axes[:, 0]:
        axis.set_ylabel(f"misfit  {unit}")
    for axis in axes.flat[len(parameters) :]:
        axis.set_visible(False)
    return _uri(figure)


SPECTRUM_TOP = 40.0
JUDGED_ANEW = (
    " All runs are judged by the errors of the theory that stood at the end; trials.jsonl has what "
    "each was worth when it was run."
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
        *found_figures(plan, points, misfits),
        *_posterior_figures(summary["posterior"]),
        plan_figure(plan),
        *_search_figures(summary),
        *_motion_figures(confirmed),
    ]
    text = page("search.html").render(
        s=plain(summary),
        laboratory=any(one["laboratory"] is not None for one in summary["parameters"]),
        extras=plain(best_extras(plan)),
        lines=told_lines(plan),
        sure=posterior_lines(summary["posterior"]),
        slip=[line for name, one in summary["blasts"].items() for line in slip_lines(name, one)],
        figures=[dict(zip(("title", "caption", "image"), row, strict=True)) for row in drawn],
    )
    write_text(path, text)


def _posterior_figures(table):
    """Draw the posterior of the unknowns, where there is one that can be told."""
    if table is not None and not table["doubt"]:
        yield (
            "What records and ranges leave",
            f"{len(table['samples'])} draws from the posterior: of each unknown over its range, "
            "with the interval that holds 90 %, and of each pair with the regions that hold 50 "
            "and 90 %.",
            corner_figure(table["parameters"], np.asarray(table["samples"])),
        )


def _search_figures(summary):
    """Draw how the search went."""
    trace = {name: np.array(value) for name, value in summary["trace"].items()}
    unit = summary["misfit_unit"]
    yield (
        "Misfit",
        f"Misfit of each run; method '{summary['method']}', seed {summary['seed']}. The search "
        f"went on from {summary['accepted']} of {summary['runs']}, starts elsewhere included."
        f"{JUDGED_ANEW if summary['misfit_name'] == 'waveform' else ''}",
        misfit_figure(trace["misfits"], trace["accepted"], unit),
    )
    yield (
        "Where the search has been",
        "Misfit against each unknown over its range, later runs darker, the best in colour.",
        places_figure(summary["parameters"], trace["points"], trace["misfits"], unit),
    )


def _motion_figures(confirmed):
    """Draw recorded and simulated motion at the best point (figures 7 to 9)."""
    for blast, one in confirmed.items():
        for name, record in one.recorded.items():
            both = {"recorded": record, "simulated": one.simulated[name]}
            yield (
                f"Receiver {name}",
                f"{blast}, {name}: recorded against simulated at the best point; particle velocity "
                "and smoothed amplitude spectrum.",
                figures.motion_figure(
                    both, [figures.RECORDED, figures.SIMULATED], SPECTRUM_TOP,
                    float(one.simulated[name].times[-1]),
                ),
            )  # fmt: skip
