"""The corner plot of a posterior: every unknown alone, and every pair."""

import numpy as np
from matplotlib.ticker import MaxNLocator
from scipy import ndimage

from .figures import INK, SIMULATED, _figure, _tidy, _uri

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
