"""Figures of a diagnosis: evidence, maps, held-out records, time and frequency."""

from collections.abc import Callable, Iterator
from functools import partial
from typing import NamedTuple, Protocol

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Polygon, Rectangle

from ..diagnosis.cross_validation import held_out_prediction
from ..diagnosis.decision import Decision
from ..diagnosis.fitting import Fit
from ..diagnosis.search import Search, means
from ..project.places import extent_of
from ..signals.spectra import wavelet_transform
from .figures import GROUND, _figure, _tidy, _uri
from .plots import FAULT, INK, RECORDED, SIMULATED, axis_of, dots, line, page_plot, panel, segments

CALIBRATED, WITH_EFFECT = "#9aa5b1", SIMULATED
BELOW, ABOVE = "#c9d1d9", "#7a8fb0"
COMPONENTS = ("east", "north", "up")
SHOWN = 12  # bars
BEFORE, AFTER = "calibrated", "with the effect"
COLUMNS = 3  # records side by side
MISFIT, POINT = "YlOrRd", "#2563eb"
WIDTH, TALLEST = 9.6, 9.0
Figure = tuple[str, str, Callable[[], str | dict]]  # title, caption, data URI or `page_plot`
NAMES = "east", "north", "height"
CIRCLE = 72  # corners of a disc
FAR = 2.0  # box diagonals from its middle that an unbounded plane reaches before it is clipped
EDGE_ON = 1e-3  # of the area of a plane, seen from its edge
MARGIN = 0.04  # of the box, around it


class Diagnosed(Protocol):
    """What a report needs of a diagnosis."""

    @property
    def search(self) -> Search:
        """The search, with its scene."""
        ...

    @property
    def decision(self) -> Decision:
        """The decision."""
        ...


def fits_shown(diagnosis: Diagnosed) -> dict[str, Fit]:
    """Return the fits that figures compare, by title: without effects, and with them if any."""
    fits = {BEFORE: diagnosis.search.without_effects}
    decided = diagnosis.decision.fit
    return fits | {AFTER: decided} if decided.effects else fits


def ranking_figure(rows, threshold, chosen=()):
    """Return the plot of the evidence of each effect beside the threshold.

    Parameters
    ----------
    rows : list of (str, float)
        Name and Δ ln evidence, best first.
    threshold : float
        Required Δ ln evidence.
    chosen : collection of int
        Rows on which the decision is based.

    Returns
    -------
    dict
        Of `page_plot`.
    """
    rows = rows[:SHOWN]
    height = np.arange(len(rows))[::-1]
    evidence = np.array([value for _, value in rows])
    top = max(evidence.max(), 1.5 * threshold)
    lowest = min(0.0, max(evidence.min(), -0.3 * top))
    picked = np.isin(np.arange(len(rows)), list(chosen))
    above = ~picked & (evidence >= threshold)
    groups = (
        (picked, "in the answer", SIMULATED),
        (above, "above what is required", ABOVE),
        (~picked & ~above, "below", BELOW),
    )
    marks = [
        segments(0.0 * evidence[part], height[part], np.maximum(evidence[part], lowest),
                 height[part], name, colour, width=16, text=[f"{v:.0f}" for v in evidence[part]])
        for part, name, colour in groups if part.any()
    ]  # fmt: skip
    ends = [-0.6, len(rows) - 0.4]
    marks.append(line([threshold] * 2, ends, f"required: {threshold:.0f}", FAULT))
    named = dict(zip(height.tolist(), (name for name, _ in rows), strict=True))
    across = axis_of("Δ ln evidence over the calibrated site", 1.05 * lowest, 1.1 * top)
    shown = panel(across, axis_of("", *ends, ticks=named), marks, 70 + 28 * len(rows))
    return page_plot("Evidence of each effect.", shown)


def compared_figure(columns, dt):
    """Draw recorded and simulated motion: a row for each component, a column for each record.

    Parameters
    ----------
    columns : list of (str, dict of str to (3, n_samples) float64 m/s)
        Title, and motion by legend: recorded, calibrated, with effect.
    dt : float, s

    Returns
    -------
    str
        A data URI.
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
        column[-1].set_xlabel("time after the first hole [s]", fontsize=8)
    for axis, name in zip(axes[:, 0], COMPONENTS, strict=True):
        axis.set_ylabel(f"{name} [mm/s]", fontsize=8)
    for axis in axes.flat:
        axis.set_xlim(0.0, times[-1])
        _tidy(axis)
    figure.legend(
        handles=list(lines.values()), loc="outside upper right", ncol=3, fontsize=8, frameon=False
    )
    return _uri(figure)


def time_frequency_figure(recorded, differences, dt, band, window=None):
    """Draw a record and its residuals over time and frequency.

    Parameters
    ----------
    recorded : (n_samples,) float64, m/s
    differences : dict of str to (n_samples,) float64, m/s
        Recorded less simulated, by title.
    dt : float, s
    band : tuple of 2 float, Hz
    window : tuple of (2 float s, 2 float Hz), optional
        Drawn as a frame.

    Returns
    -------
    str
        A data URI.
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
        axis.set_xlabel("time after the first hole [s]", fontsize=8)
        axis.tick_params(labelsize=8)
        axis.set_yticks(round_marks(*band))
        axis.minorticks_off()
        axis.yaxis.set_major_formatter("{x:g}")
        if window is not None and axis is not axes[0]:
            (t0, t1), (f0, f1) = window
            axis.add_patch(Rectangle((t0, f0), t1 - t0, f1 - f0, fill=False, ec="#2563eb", lw=1.2))
    axes[0].set_ylabel("frequency [Hz]", fontsize=8)
    bar = figure.colorbar(drawn, ax=axes, shrink=0.9)
    bar.set_label("wavelet amplitude [mm/s]", fontsize=8)
    bar.ax.tick_params(labelsize=7)
    return _uri(figure)


def round_marks(low, high):
    """Return the round numbers of a logarithmic axis."""
    decades = 10.0 ** np.arange(np.floor(np.log10(low)), np.ceil(np.log10(high)) + 1)
    marks = np.multiply.outer(decades, [1.0, 2.0, 3.0, 5.0]).ravel()
    return marks[(marks >= 0.999 * low) & (marks <= 1.001 * high)]


def holes_figure(values, prior, label):
    """Return the plot of a value of each hole with its 90 % interval, beside the prior mean.

    Parameters
    ----------
    values : list of dict
        ``value``, ``low``, ``high`` of each hole, in the unit that is shown.
    prior : float
        Prior mean.
    label : str
        Of the vertical axis.

    Returns
    -------
    dict
        Of `page_plot`.
    """
    number = np.arange(1, len(values) + 1)
    value, low, high = (np.array([v[k] for v in values]) for k in ("value", "low", "high"))
    marks = [line([0.5, len(values) + 0.5], [prior] * 2, "prior mean", INK, dash=True)]
    sure = (low > prior) | (high < prior)
    for shown, colour, name in (
        (sure, SIMULATED, "interval without the prior mean"),
        (~sure, CALIBRATED, "interval with the prior mean"),
    ):
        if shown.any():
            ends = number[shown], low[shown], number[shown], high[shown]
            marks.append(segments(*ends, None, colour, width=2))
            marks.append(dots(number[shown], value[shown], name, colour, radius=5))
    across = axis_of("hole, in the order of the hole table", 0.5, len(values) + 0.5)
    return page_plot("A value of each hole.", panel(across, axis_of(label), marks, 250))


def held_out_figures(diagnosis: Diagnosed) -> Iterator[Figure]:
    """Draw held-out records and their prediction; without effects, the receiver explained worst."""
    scene, without = diagnosis.search.scene, diagnosis.search.without_effects
    case = scene.case
    if not diagnosis.decision.fit.effects:
        r = int(np.argmax(means(without.chi_square, 0)))
        yield (
            f"Receiver {case.receivers[r]}",
            "The receiver with the largest misfit: recorded and calibrated, in the band that is "
            "compared.",
            partial(_compared, case, _last_blasts(case, r), {BEFORE: case.in_band(without.motion)}),
        )
        return
    for name, records, out in _subsets_shown(diagnosis):
        yield (
            f"{name[0].upper()}{name[1:]} held out",
            f"Recorded, and predicted by fits without {name}: of the calibrated site, and of the "
            "site with the effect. In the band that is compared.",
            partial(_predicted, scene, fits_shown(diagnosis), records, out),
        )


def _predicted(scene, fits, records, out):
    """Draw held-out records and their prediction by fits to the others."""
    motions = {title: held_out_prediction(scene, fit, out) for title, fit in fits.items()}
    return _compared(scene.case, records, motions)


def _subsets_shown(diagnosis):
    """Yield held-out subsets: (name, records to draw, mask of what is held out)."""
    case = diagnosis.search.scene.case
    chi_square = diagnosis.search.without_effects.chi_square
    tested = diagnosis.decision.cross_validation
    names = set() if tested is None else {subset.name for subset in tested.subsets}
    blasts = [b for b, name in enumerate(case.blasts) if name in names]
    receivers = [r for r, name in enumerate(case.receivers) if name in names]
    if blasts:
        b, out = blasts[-1], np.zeros(chi_square.shape, dtype=bool)
        out[b] = True
        worst = np.argsort(-chi_square[b])[:COLUMNS]
        yield f"blast {case.blasts[b]}", [(b, int(r)) for r in sorted(worst)], out
    if receivers:
        r = max(receivers, key=lambda r: chi_square[:, r].mean())
        out = np.zeros(chi_square.shape, dtype=bool)
        out[:, r] = True
        yield f"receiver {case.receivers[r]}", _last_blasts(case, r), out


def _last_blasts(case, r):
    """Return the records of the largest blasts at one receiver."""
    return [(b, r) for b in range(len(case.blasts))][-COLUMNS:]


def _compared(case, records, motions):
    """Draw recorded and other motion of some records."""
    parts = {"recorded": case.in_band(case.motion), **motions}
    columns = [
        (f"{case.blasts[b]} at {case.receivers[r]}", {k: v[b, r] for k, v in parts.items()})
        for b, r in records
    ]
    return compared_figure(columns, case.dt)


def maps_figure(project, receivers, misfits, material, *, targets=(), points=(), diagnosed=None):
    """Draw a project in plan and section, its receivers coloured by their misfit.

    Parameters
    ----------
    project : Project
    receivers : sequence of n str
        Names of receivers with records.
    misfits : dict of str to (n,) float64
        Mean chi-square of each receiver, by title: one column of maps each.
    material : float
        Misfit from which a receiver is ringed.
    targets : collection of str
        Joints, receivers and blasts with effects.
    points : list of dict
        ``x``, ``y``, ``z`` and ``within_m`` of located residuals.
    diagnosed : Project, optional
        With the effects on its site: faults that are not in the project are drawn as targets.

    Returns
    -------
    str
        A data URI.
    """
    planes = drawn_planes(project, diagnosed, targets)
    across = _across(planes, extent_of(project))
    box = _box(project, planes, receivers)
    figure, axes = _panels(box, across, len(misfits))
    top = max(10.0, *(float(np.max(misfit)) for misfit in misfits.values()))
    norm = LogNorm(1.0, top)
    positions = np.array([_positions(project)[name] for name in receivers])
    for column, (title, misfit) in enumerate(misfits.items()):
        plan, section = axes[:, column]
        plan.set_title(title, fontsize=9, loc="left")
        for axis, (h, v) in ((plan, (0, 1)), (section, (across, 2))):
            _receivers(axis, positions[:, (h, v)], misfit, norm, material)
            for plane in planes:
                _draw_plane(axis, plane, (h, v))
            _holes(axis, project, (h, v), targets)
            axis.set(xlim=box[h], ylim=box[v], aspect="equal")
            axis.set_xlabel(f"{NAMES[h]} [m]", fontsize=8)
            axis.set_ylabel(f"{NAMES[v]} [m]" if column == 0 else "", fontsize=8)
            _tidy(axis)
            axis.grid(False)
        _named(plan, receivers, positions, targets)
        _layers(section, project, box)
        _points((plan, section), ((0, 1), (across, 2)), points)
    bar = figure.colorbar(ScalarMappable(norm, MISFIT), ax=axes, shrink=0.6)
    bar.set_label("misfit over noise and model error (1: explained)", fontsize=8)
    bar.set_ticks(round_marks(norm.vmin, norm.vmax).tolist())
    bar.minorticks_off()
    bar.ax.yaxis.set_major_formatter("{x:g}")
    bar.ax.tick_params(labelsize=7)
    _legend(figure, planes, targets, points, material)
    return _uri(figure)


class DrawnPlane(NamedTuple):
    """Drawn plane: the polygons (n, 3) m of a joint, and whether an effect is on it."""

    name: str
    polygons: list[np.ndarray]
    strong: bool


def rock_map(cells, project, points) -> dict:
    """Return the plot of where in the rock a change would explain a residual, plan and section.

    Parameters
    ----------
    cells : dict of str to (n,) float
        ``x``, ``y``, ``z`` in m and ``score``, as of `points_of`; of those behind one another the
        best is shown.
    project : Project
    points : list of dict
        Located residuals.

    Returns
    -------
    dict
        Of `page_plot`.
    """
    places = np.array([cells[axis] for axis in "xyz"])
    score = np.maximum(np.array(cells["score"]), 0.0)
    high = max(float(score.max()), 1.0)
    scale = {"label": "score", "low": 0.0, "high": high, "colours": "darker"}
    box, across = extent_of(project), int(np.ptp(places[1]) > np.ptp(places[0]))
    stations = np.array(list(_positions(project).values())).T
    holes = np.concatenate([blast.centres for blast in project.blasts.values()]).T
    panels = []
    for h, v in ((0, 1), (across, 2)):
        order = np.argsort(score, kind="stable")
        best = {(places[h, n], places[v, n]): score[n] for n in order}
        x, y = np.array(list(best)).T
        marks = [
            dots(x, y, "cell", values=np.array(list(best.values())), radius=9, quiet=True),
            dots(stations[h], stations[v], "receiver", INK, radius=4),
            dots(holes[h], holes[v], "hole", FAULT, radius=2),
        ]
        if points:
            at = [[point["xyz"[n]] for point in points] for n in (h, v)]
            marks.append(dots(*at, "located residual", POINT, radius=7, ring=True))
        ends = [(float(min(box[n, 0], places[n].min())), float(max(box[n, 1], places[n].max())))
                for n in (h, v)]  # fmt: skip
        axes = [axis_of(f"{NAMES[n]} [m]", *end) for n, end in zip((h, v), ends, strict=True)]
        panels.append(panel(*axes, marks, 320, equal=True, scale=scale))
    words = "Cells of the ground by how well a change there explains the residual."
    return page_plot(words, *panels, columns=2)


def drawn_planes(project, diagnosed=None, targets=()) -> list[DrawnPlane]:
    """Return what is drawn of the joints of a project: faults of any dip, and joints with effects.

    Parameters
    ----------
    project : Project
    diagnosed : Project, optional
        Its faults that the project lacks, or has elsewhere, are drawn as with an effect.
    targets : collection of str
        Joints with effects; several of one effect are joined by commas.

    Returns
    -------
    list of DrawnPlane
        Faults clipped by the box; of other joints, such as sets, the facets of the mesh if they
        are targets.
    """
    box, faults = extent_of(project), project.config.mesh.faults
    named = {name for target in targets for name in target.split(", ")}
    changed = (
        [] if diagnosed is None else [f for f in diagnosed.config.mesh.faults if f not in faults]
    )
    moved = {fault.name for fault in changed}
    planes = [
        DrawnPlane(fault.name, [fault_outline(fault, box)], fault.name in named - moved)
        for fault in faults
    ]
    planes += [DrawnPlane(fault.name, [fault_outline(fault, box)], True) for fault in changed]
    others = named & {joint.surface for joint in project.joints} - {fault.name for fault in faults}
    for name in sorted(others):
        facets = project.mesh.surfaces[name]
        planes.append(DrawnPlane(name, list(project.mesh.points[facets]), True))
    return [plane for plane in planes if any(map(len, plane.polygons))]


def fault_outline(fault, box) -> np.ndarray:
    """Return the outline of a `FaultConfig` in a box (3, 2) m, (n, 3) m; empty outside of it."""
    dip, bearing = np.radians([fault.dip_deg, fault.dip_direction_deg])
    strike = np.array([np.cos(bearing), -np.sin(bearing), 0.0])
    down = np.array([np.sin(bearing) * np.cos(dip), np.cos(bearing) * np.cos(dip), -np.sin(dip)])
    if fault.radius_m is not None:
        turn = np.linspace(0.0, 2.0 * np.pi, CIRCLE, endpoint=False)
        along = fault.radius_m * np.column_stack([np.cos(turn), np.sin(turn)])
    else:
        half = np.full(2, FAR * np.linalg.norm(np.ptp(box, axis=1)))
        if fault.extent_m is not None:
            half = 0.5 * np.array(fault.extent_m)
        along = half * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    outline = np.array(fault.through_m) + along @ np.stack([strike, down])
    for axis, (low, high) in enumerate(box):
        for side, limit in ((1.0, low), (-1.0, high)):
            outline = _half(outline, side * (outline[:, axis] - limit))
    return outline


def _half(outline, above):
    """Return the part of a polygon (n, 3) where a linear function (n,) of it is positive."""
    points = []
    for n in range(len(outline)):
        if above[n - 1] * above[n] < 0.0:
            share = above[n - 1] / (above[n - 1] - above[n])
            points.append(outline[n - 1] + share * (outline[n] - outline[n - 1]))
        if above[n] >= 0.0:
            points.append(outline[n])
    return np.array(points).reshape(-1, 3)


def _across(planes, box):
    """Return the horizontal axis of the section: across most planes, else along the box."""
    chosen = [plane for plane in planes if plane.strong] or planes
    normals = [np.abs(_normal(polygon)[:2]) for p in chosen for polygon in p.polygons]
    size = np.sum(normals, axis=0) if normals else np.zeros(2)
    if abs(size[0] - size[1]) > 1e-6 * size.sum():
        return int(np.argmax(size))
    return int(np.argmax(np.ptp(box[:2], axis=1)))


def _normal(polygon):
    """Return twice the area vector (3,) of a polygon (n, 3)."""
    return np.cross(polygon, np.roll(polygon, -1, axis=0)).sum(axis=0)


def _draw_plane(axis, plane, view):
    """Draw a plane as a shaded face, as a line if it is seen edge-on, and its name."""
    style = {"color": FAULT if plane.strong else INK, "lw": 2.4 if plane.strong else 1.0}
    hidden = 3 - sum(view)
    for polygon in plane.polygons:
        seen = polygon[:, view]
        edge_on = abs(_normal(polygon)[hidden]) < EDGE_ON * np.linalg.norm(_normal(polygon))
        if edge_on:
            axis.plot(*seen[_ends(seen)].T, **style, zorder=3)
            continue
        face = {"fc": style["color"], "alpha": 0.12, "lw": 0.0, "zorder": 2}
        axis.add_patch(Polygon(seen, **face))
        axis.plot(*np.vstack([seen, seen[:1]]).T, color=style["color"], lw=0.6, ls=":", zorder=2)
        if hidden == 2:  # the trace on the ground
            high = polygon[polygon[:, 2] > polygon[:, 2].max() - 1e-6 * np.ptp(polygon[:, 2])]
            axis.plot(*high[:, :2][_ends(high[:, :2])].T, **style, zorder=3)
    polygon = plane.polygons[0]
    at = polygon[np.argmax(polygon[:, 2] + 1e-6 * polygon[:, view[0]])][list(view)]
    axis.annotate(
        plane.name, at, xytext=(3, -9), textcoords="offset points", fontsize=7,
        color=style["color"], weight="bold" if plane.strong else "normal", parse_math=False,
    )  # fmt: skip


def _ends(places):
    """Return the indices of the two places (n, 2) that are farthest apart along their line."""
    along = places @ (places[np.argmax(np.linalg.norm(places - places[0], axis=1))] - places[0])
    return [int(np.argmin(along)), int(np.argmax(along))]


def _box(project, planes, receivers):
    """Return the limits of the maps, (3, 2) m: box, receivers, holes and planes with a margin."""
    inside = [_positions(project)[name] for name in receivers]
    for blast in project.blasts.values():
        inside += [*blast.collar, *blast.toe]
    inside = np.array([*inside, *(at for p in planes for polygon in p.polygons for at in polygon)])
    low, high = extent_of(project).T
    low, high = np.minimum(low, inside.min(axis=0)), np.maximum(high, inside.max(axis=0))
    margin = MARGIN * (high - low)
    return np.column_stack([low - margin, high + margin])


def _positions(project):
    """Return the positions of receivers by name."""
    return {receiver.name: receiver.position for receiver in project.receivers}


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


def _receivers(axis, positions, misfit, norm, material):
    """Draw receivers by misfit; those that are not explained have a strong ring."""
    strong = np.asarray(misfit) >= material
    axis.scatter(
        *positions.T, c=np.maximum(misfit, norm.vmin), norm=norm, cmap=MISFIT, s=70, zorder=5,
        edgecolors=np.where(strong, FAULT, INK), linewidths=np.where(strong, 2.0, 0.6),
    )  # fmt: skip


def _named(axis, receivers, positions, targets):
    """Write the names of the receivers, in bold if they are targets of an effect."""
    for name, position in zip(receivers, positions, strict=True):
        axis.annotate(
            name, position[:2], xytext=(0, 7), textcoords="offset points", ha="center", fontsize=7,
            weight="bold" if name in targets else "normal", zorder=6, parse_math=False,
        )  # fmt: skip


def _holes(axis, project, view, targets):
    """Draw the charges of all blasts."""
    for name, blast in project.blasts.items():
        colour = FAULT if name in targets else INK
        for collar, toe in zip(blast.collar, blast.toe, strict=True):
            axis.plot(*np.array([collar, toe]).T[list(view)], color=colour, lw=1.2, zorder=4)
        axis.plot(*blast.collar.T[list(view)], "+", color=colour, ms=5, zorder=4)


def _layers(axis, project, box):
    """Shade the flat layers of a section and write their names; none below other ground."""
    mesh, top = project.config.mesh, float(extent_of(project)[2, 1])
    flat = project.terrain is None and not (mesh.surface_file or mesh.benches)
    layers = mesh.layers if flat else ()
    thicknesses = [*(layer.thickness_m for layer in layers[:-1]), None]
    for number, (layer, thickness) in enumerate(zip(layers, thicknesses, strict=False)):
        name = layer.material
        bottom = box[2, 0] if thickness is None else top - thickness
        colour = GROUND[number % len(GROUND)]
        axis.axhspan(bottom, top, color=colour, alpha=0.35, lw=0, zorder=0)
        axis.annotate(
            name, (0.99, max(bottom, box[2, 0])), xycoords=("axes fraction", "data"), ha="right",
            xytext=(0, 2), textcoords="offset points", fontsize=7, parse_math=False,
        )  # fmt: skip
        top = bottom


def _points(axes, views, points):
    """Draw located residuals."""
    for axis, (h, v) in zip(axes, views, strict=True):
        for point in points:
            at = [(point["x"], point["y"], point["z"])[n] for n in (h, v)]
            axis.add_patch(
                Circle(at, point["within_m"], fill=False, ec=POINT, lw=1.6, ls="--", zorder=6)
            )
            axis.plot(*at, "x", color=POINT, ms=8, mew=2.0, zorder=6)


def _legend(figure, planes, targets, points, material):
    """Draw the legend above the maps."""
    ring = {"marker": "o", "ls": "", "mfc": "white"}
    marks = {
        "receiver": {**ring, "mec": INK},
        f"receiver, misfit over {material:g}": {**ring, "mec": FAULT, "mew": 2.0},
        "hole": {"marker": "+", "ls": "", "color": INK},
    }
    if planes:
        marks["joint"] = {"color": INK, "lw": 1.0}
    if targets or any(plane.strong for plane in planes):
        marks["with an effect (receivers: bold)"] = {"color": FAULT, "lw": 2.4}
    if points:
        marks["located residual, within the circle"] = {
            "marker": "x", "ls": "", "color": POINT, "mew": 2.0,
        }  # fmt: skip
    handles = [Line2D([], [], label=label, **style) for label, style in marks.items()]
    figure.legend(handles=handles, loc="outside upper left", ncol=3, fontsize=7, frameon=False)
