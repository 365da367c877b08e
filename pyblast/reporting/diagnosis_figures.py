"""Figures of a diagnosis: ranking of effects, motion before and after, times and frequencies."""

import numpy as np
from matplotlib.patches import Rectangle

from ..motion.time_frequency import wavelet_transform
from .figures import FAULT, INK, RECORDED, SIMULATED, _figure, _tidy, _uri

CALIBRATED, WITH_EFFECT = "#9aa5b1", SIMULATED
BELOW, ABOVE = "#c9d1d9", "#7a8fb0"
COMPONENTS = ("east", "north", "up")
SHOWN = 12  # bars


def ranking_figure(rows, threshold, interval, chosen=()):
    """Draw the evidence of each effect, and what chance alone finds.

    Parameters
    ----------
    rows : list of (str, float)
        Name and evidence in nats, best first.
    threshold : float
        That evidence must exceed.
    interval : tuple of 2 float or None
        In which the threshold of chance lies.
    chosen : collection of int
        Rows that the verdict rests on.
    """
    rows = rows[:SHOWN]
    figure = _figure(9.6, 1.1 + 0.3 * len(rows))
    axis, place = figure.subplots(), np.arange(len(rows))[::-1]
    worth = np.array([value for _, value in rows])
    top = max(worth.max(), 1.5 * threshold)
    lowest = min(0.0, max(worth.min(), -0.3 * top))
    colours = [
        SIMULATED if n in chosen else ABOVE if value >= threshold else BELOW
        for n, value in enumerate(worth)
    ]
    axis.barh(place, np.maximum(worth, lowest), color=colours, height=0.65)
    for y, value in zip(place, worth, strict=True):
        axis.text(
            max(value, 0.0) + 0.012 * top, y, f"{value:.0f}", va="center", fontsize=8, color=INK,
            bbox={"fc": "white", "ec": "none", "pad": 0.6, "alpha": 0.85},
        )  # fmt: skip
    if interval is not None:
        axis.axvspan(*interval, color=FAULT, alpha=0.15, lw=0)
    axis.axvline(threshold, color=FAULT, lw=1.4, label=f"needed: {threshold:.0f}")
    axis.set_yticks(place, [name for name, _ in rows], parse_math=False)
    axis.set_xlim(1.05 * lowest, 1.1 * top)
    axis.set_xlabel("evidence over the calibrated site  nats")
    axis.legend(fontsize=8, frameon=False, loc="lower right")
    _tidy(axis)
    axis.grid(False)
    return _uri(figure)


def compared_figure(columns, dt):
    """Draw recorded and simulated motion: a row for each component, a column for each record.

    Parameters
    ----------
    columns : list of (str, dict of str to (3, n_samples) float64 m/s)
        Title, and motion by legend: recorded, calibrated, with effect.
    dt : float, s
    """
    figure = _figure(9.6, 5.4)
    axes = figure.subplots(3, len(columns), squeeze=False, sharex=True, sharey="col")
    styles = ((RECORDED, 2.2), (CALIBRATED, 1.3), (WITH_EFFECT, 0.9))
    lines = {}
    for (title, motions), column in zip(columns, axes.T, strict=True):
        column[0].set_title(title, fontsize=9, loc="left", parse_math=False)
        for (name, motion), (colour, width) in zip(motions.items(), styles, strict=False):
            times = dt * np.arange(motion.shape[-1])
            for axis, part in zip(column, motion, strict=True):
                lines[name] = axis.plot(times, 1e3 * part, color=colour, lw=width, label=name)[0]
        column[-1].set_xlabel("time after the first hole  s", fontsize=8)
    for axis, name in zip(axes[:, 0], COMPONENTS, strict=True):
        axis.set_ylabel(f"{name}  mm/s", fontsize=8)
    for axis in axes.flat:
        axis.set_xlim(0.0, times[-1])
        _tidy(axis)
    figure.legend(
        handles=list(lines.values()), loc="outside upper right", ncol=3, fontsize=8, frameon=False
    )
    return _uri(figure)


def time_frequency_figure(recorded, differences, dt, band, window=None):
    """Draw what was recorded, and what simulations miss of it, over time and frequency.

    Parameters
    ----------
    recorded : (n_samples,) float64, m/s
    differences : dict of str to (n_samples,) float64, m/s
        Recorded less simulated, by title.
    dt : float, s
    band : tuple of 2 float, Hz
    window : tuple of (2 float s, 2 float Hz), optional
        Of what is located; a frame is drawn around it.
    """
    parts = {"recorded": recorded, **differences}
    figure = _figure(9.6, 3.4)
    axes = figure.subplots(1, len(parts), squeeze=False, sharey=True)[0]
    times = dt * np.arange(len(recorded))
    top = None
    for axis, (title, motion) in zip(axes, parts.items(), strict=True):
        level = 1e3 * np.abs(wavelet_transform(motion, dt, band))
        top = top or float(level.max())
        frequency = np.geomspace(*band, len(level))
        drawn = axis.pcolormesh(
            times, frequency, level, vmin=0.0, vmax=top, cmap="magma_r", shading="nearest",
            rasterized=True,
        )  # fmt: skip
        axis.set_title(title, fontsize=9, loc="left", parse_math=False)
        axis.set_yscale("log")
        axis.set_xlabel("time after the first hole  s", fontsize=8)
        axis.tick_params(labelsize=8)
        axis.set_yticks(round_marks(*band))
        axis.minorticks_off()
        axis.yaxis.set_major_formatter("{x:g}")
        if window is not None and axis is not axes[0]:
            (t0, t1), (f0, f1) = window
            axis.add_patch(Rectangle((t0, f0), t1 - t0, f1 - f0, fill=False, ec="#2563eb", lw=1.2))
    axes[0].set_ylabel("frequency  Hz", fontsize=8)
    bar = figure.colorbar(drawn, ax=axes, shrink=0.9)
    bar.set_label("mm/s (wavelet)", fontsize=8)
    bar.ax.tick_params(labelsize=7)
    return _uri(figure)


def round_marks(low, high):
    """Return the round numbers of a logarithmic axis."""
    decades = 10.0 ** np.arange(np.floor(np.log10(low)), np.ceil(np.log10(high)) + 1)
    marks = np.multiply.outer(decades, [1.0, 2.0, 3.0, 5.0]).ravel()
    return marks[(marks >= 0.999 * low) & (marks <= 1.001 * high)]


def holes_figure(values, usual, label):
    """Draw one value for each hole with its 90 % interval, over what was believed.

    Parameters
    ----------
    values : list of dict
        ``value``, ``low``, ``high`` of each hole, in the unit that is shown.
    usual : float
        What was believed.
    label : str
        Of the upward axis.
    """
    figure = _figure(9.6, 2.6)
    axis, number = figure.subplots(), np.arange(1, len(values) + 1)
    value, low, high = (np.array([one[k] for one in values]) for k in ("value", "low", "high"))
    axis.axhline(usual, color=INK, lw=0.8, ls="--", label="believed")
    sure = (low > usual) | (high < usual)
    for shown, colour, name in (
        (sure, SIMULATED, "differs"),
        (~sure, CALIBRATED, "may be as believed"),
    ):
        if shown.any():
            reach = np.maximum(np.array([value - low, high - value])[:, shown], 0.0)
            axis.errorbar(
                number[shown], value[shown], reach, fmt="o", color=colour, ms=5, lw=1.4,
                capsize=2, label=name,
            )  # fmt: skip
    axis.set_xlabel("hole, in the order of the hole table")
    axis.set_ylabel(label, parse_math=False)
    axis.xaxis.get_major_locator().set_params(integer=True)
    axis.legend(fontsize=7, frameon=False, ncol=3, loc="lower right", bbox_to_anchor=(1.0, 1.0))
    _tidy(axis)
    return _uri(figure)
