"""Figures of a back-analysis: how the misfit fell and where the search has been."""

import numpy as np
from matplotlib.ticker import MaxNLocator

from .figures import INK, SIMULATED, _figure, _tidy, _uri

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
