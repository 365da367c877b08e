"""Figures of a diagnosis: evidence, maps, motion before and after, time and frequency."""

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Rectangle
from matplotlib.ticker import MaxNLocator

from ..project.flat_box import FlatBox, extent_of, flat_box, not_flat
from ..signals.spectra import wavelet_transform
from .figures import FAULT, GROUND, INK, RECORDED, SIMULATED, _figure, _tidy, _uri

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
        frequency = np.geomspace(band[0], band[1], len(level))
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
    axis.xaxis.set_major_locator(MaxNLocator("auto", steps=[1, 2, 2.5, 5, 10], integer=True))
    axis.legend(fontsize=7, frameon=False, ncol=3, loc="lower right", bbox_to_anchor=(1.0, 1.0))
    _tidy(axis)
    return _uri(figure)


MISFIT, POINT = "YlOrRd", "#2563eb"
WIDTH, TALLEST = 9.6, 9.0
AXES, NAMES = "xyz", ("east", "north", "height")
MARGIN = 0.04  # of the box, around it


def maps_figure(project, receivers, sizes, material, *, found=(), points=()):
    """Draw a project from above and from the side, its receivers coloured by their misfit.

    Parameters
    ----------
    project : Project
    receivers : sequence of n str
        That have records.
    sizes : dict of str to (n,) float64
        Mean square misfit over what noise and errors of the theory leave, by title: one column
        of pictures each.
    material : float
        Misfit from which a receiver is ringed.
    found : collection of str
        Joints, receivers and blasts to which effects belong.
    points : list of dict
        ``x``, ``y`` and ``resolution_m`` of places that residuals come from.

    Returns
    -------
    str
        A data URI.
    """
    ground = _ground(project)
    across = _across(ground)
    box = _box(project, ground, receivers)
    figure, axes = _panels(box, across, len(sizes))
    top = max(10.0, *(float(np.max(size)) for size in sizes.values()))
    norm = LogNorm(1.0, top)
    places = np.array([_positions(project)[name] for name in receivers])
    for column, (title, size) in enumerate(sizes.items()):
        plan, section = axes[:, column]
        plan.set_title(title, fontsize=9, loc="left")
        for axis, (h, v) in ((plan, (0, 1)), (section, (across, 2))):
            drawn = _receivers(axis, places[:, (h, v)], size, norm, material)
            _joints(axis, ground, box, (h, v), found)
            _holes(axis, project, (h, v), found)
            axis.set(xlim=box[h], ylim=box[v], aspect="equal")
            axis.set_xlabel(f"{NAMES[h]}  m", fontsize=8)
            axis.set_ylabel(f"{NAMES[v]}  m" if column == 0 else "", fontsize=8)
            _tidy(axis)
            axis.grid(False)
        _named(plan, receivers, places, found)
        _layers(section, ground, box)
        _points(plan, section, points, across)
    bar = figure.colorbar(drawn, ax=axes, shrink=0.6)
    bar.set_label("misfit over that of small errors (1: explained)", fontsize=8)
    bar.set_ticks(round_marks(norm.vmin, norm.vmax).tolist())
    bar.minorticks_off()
    bar.ax.yaxis.set_major_formatter("{x:g}")
    bar.ax.tick_params(labelsize=7)
    _legend(figure, ground, found, points, material)
    return _uri(figure)


def _ground(project):
    """Return box, layers and upright planes that can be drawn: no planes but of a flat box."""
    if not not_flat(project):
        return flat_box(project)
    mesh = project.config.mesh
    layers = () if mesh.surface_file is not None else mesh.layers
    thicknesses = [*(layer.thickness_m for layer in layers[:-1]), None]
    names = [layer.material for layer in layers]
    return FlatBox(extent_of(project), tuple(zip(names, thicknesses, strict=False)))


def _across(ground):
    """Return the horizontal axis of the section: across most joints, else along the box."""
    count = [sum(one.axis == axis for one in ground.planes) for axis in "xy"]
    if count[0] != count[1]:
        return int(np.argmax(count))
    return int(np.argmax(np.ptp(ground.box[:2], axis=1)))


def _box(project, ground, receivers):
    """Return what is drawn, (3, 2) m: the box with all receivers and holes, and a margin."""
    inside = [_positions(project)[name] for name in receivers]
    for blast in project.blasts.values():
        inside += [*blast.collar, *blast.toe]
    inside = np.array(inside)
    low = np.minimum(ground.box[:, 0], inside.min(axis=0))
    high = np.maximum(ground.box[:, 1], inside.max(axis=0))
    margin = MARGIN * (high - low)
    return np.column_stack([low - margin, high + margin])


def _positions(project):
    """Return the places of receivers by name."""
    return {one.name: one.position for one in project.receivers}


def _panels(box, across, columns):
    """Return a figure with plans over sections, (2, columns), at one scale."""
    span = np.ptp(box, axis=1)
    wide = max(span[0], span[across])
    scale = 0.82 * WIDTH / columns / wide
    heights = np.array([span[1], span[2]])
    scale = min(scale, (TALLEST - 2.0) / heights.sum())
    figure = _figure(WIDTH, float(scale * heights.sum() + 1.9))
    axes = figure.subplots(
        2, columns, squeeze=False, gridspec_kw={"height_ratios": heights.tolist()}
    )
    return figure, axes


def _receivers(axis, places, size, norm, material):
    """Draw receivers by misfit; those that are not explained have a strong ring."""
    strong = np.asarray(size) >= material
    return axis.scatter(
        *places.T, c=np.maximum(size, norm.vmin), norm=norm, cmap=MISFIT, s=70, zorder=5,
        edgecolors=np.where(strong, FAULT, INK), linewidths=np.where(strong, 2.0, 0.6),
    )  # fmt: skip


def _named(axis, receivers, places, found):
    """Write the names of the receivers, those with an effect of their own bold."""
    for name, place in zip(receivers, places, strict=True):
        axis.annotate(
            name, place[:2], xytext=(0, 7), textcoords="offset points", ha="center", fontsize=7,
            weight="bold" if name in found else "normal", zorder=6, parse_math=False,
        )  # fmt: skip


def _joints(axis, ground, box, view, found):
    """Draw joints: lines where they are seen from their edge, dashed faces where they are not."""
    for joint in ground.planes:
        normal, name = AXES.index(joint.axis), joint.name
        ranges = {1 - normal: joint.extent, 2: tuple(ground.top - np.array(joint.depth[::-1]))}
        ends = {k: np.clip(ends, *box[k]) for k, ends in ranges.items()}
        ends[2] = np.minimum(ends[2], ground.top)
        strong = name in found
        style = {"color": FAULT if strong else INK, "lw": 2.4 if strong else 1.0, "zorder": 3}
        if normal not in view:
            corner = ends[view[0]][0], ends[view[1]][0]
            axis.add_patch(
                Rectangle(corner, *(np.ptp(ends[k]) for k in view), fill=False, ls=":", **style)
            )
            continue
        along = ends[next(k for k in view if k != normal)]
        line = np.array([[joint.position] * 2, along])
        axis.plot(*(line if view[0] == normal else line[::-1]), **style)
        at = line[:, 1] if view[0] == normal else line[::-1, 1]
        axis.annotate(
            name, at, xytext=(3, -9), textcoords="offset points", fontsize=7, color=style["color"],
            weight="bold" if strong else "normal", parse_math=False,
        )  # fmt: skip


def _holes(axis, project, view, found):
    """Draw the charges of all blasts."""
    for name, blast in project.blasts.items():
        colour = FAULT if name in found else INK
        for collar, toe in zip(blast.collar, blast.toe, strict=True):
            axis.plot(*np.array([collar, toe]).T[list(view)], color=colour, lw=1.2, zorder=4)
        axis.plot(*blast.collar.T[list(view)], "+", color=colour, ms=5, zorder=4)


def _layers(axis, ground, box):
    """Shade the layers of a section and write their names."""
    top = ground.top
    for number, (name, thickness) in enumerate(ground.layers):
        bottom = box[2, 0] if thickness is None else top - thickness
        colour = GROUND[number % len(GROUND)]
        axis.axhspan(bottom, top, color=colour, alpha=0.35, lw=0, zorder=0)
        axis.annotate(
            name, (0.99, max(bottom, box[2, 0])), xycoords=("axes fraction", "data"), ha="right",
            xytext=(0, 2), textcoords="offset points", fontsize=7, parse_math=False,
        )  # fmt: skip
        top = bottom


def _points(plan, section, points, across):
    """Draw where residuals come from; how deep is not known."""
    for point in points:
        place, reach = (point["x"], point["y"]), 0.5 * point["resolution_m"]
        plan.add_patch(Circle(place, reach, fill=False, ec=POINT, lw=1.6, ls="--", zorder=6))
        plan.plot(*place, "x", color=POINT, ms=8, mew=2.0, zorder=6)
        section.axvspan(
            place[across] - reach, place[across] + reach, color=POINT, alpha=0.15, lw=0, zorder=1
        )


def _legend(figure, ground, found, points, material):
    """Say what the signs mean, above the pictures."""
    ring = {"marker": "o", "ls": "", "mfc": "white"}
    marks = {
        "receiver": {**ring, "mec": INK},
        f"receiver, misfit over {material:g}": {**ring, "mec": FAULT, "mew": 2.0},
        "hole": {"marker": "+", "ls": "", "color": INK},
    }
    if ground.planes:
        marks["joint"] = {"color": INK, "lw": 1.0}
    if found:
        marks["what was found (receivers: bold)"] = {"color": FAULT, "lw": 2.4}
    if points:
        marks["residuals seem to come from within the circle"] = {
            "marker": "x", "ls": "", "color": POINT, "mew": 2.0,
        }  # fmt: skip
    handles = [Line2D([], [], label=label, **style) for label, style in marks.items()]
    figure.legend(handles=handles, loc="outside upper left", ncol=3, fontsize=7, frameon=False)
