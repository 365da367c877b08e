"""Figures of a run: seismograms, spectra, limit curves, sections of the mesh."""

import base64
import io
import warnings
from html import escape
from math import ceil

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.text import Text

from ..mesh import tetrahedra
from ..signals.comparison import Comparison
from ..signals.seismogram import Seismogram
from ..signals.spectra import dominant_frequency, smoothed_spectrum, zero_crossing_frequency
from .plots import FAULT, INK, RECORDED, SIMULATED, axis_of, dots, line, page_plot, panel

_TRIANGLE_EDGES = np.array([[0, 1], [1, 2], [2, 0]])
NUDGE = 1.2345e-5
ENERGY_UNITS = (1e-9, "GJ"), (1e-6, "MJ"), (1e-3, "kJ"), (1.0, "J")
FLAT = 1e-3  # slope of a plane without a strike
LEAST_SHOWN = 1e-4  # of the largest energy, below which terms are not drawn


def section_of_zones(points, zones, north):
    """Cut zones with the plane ``y = north``.

    Parameters
    ----------
    points : (n_nodes, 3) float64, m
    zones : (n_zones, 4) int32
    north : float, m

    Returns
    -------
    polygons : list of (3 or 4, 2) float64, m
        East and up, in turn around the polygon.
    zone : (n_polygons,) int64
    """
    height = _heights(points, north)
    below = height[zones] < 0.0
    cut = np.flatnonzero(below.any(axis=1) & ~below.all(axis=1))
    corners, crossed = _crossings(points, height, zones[cut], tetrahedra.EDGES)
    polygons = []
    for row in range(len(cut)):
        corner = corners[row][crossed[row]]
        around = corner - corner.mean(axis=0)
        polygons.append(corner[np.argsort(np.arctan2(around[:, 1], around[:, 0]))])
    return polygons, cut


def section_of_surface(points, triangles, north):
    """Cut triangles with the plane ``y = north``; return segments (n, 2, 2) m, east and up."""
    height = _heights(points, north)
    below = height[triangles] < 0.0
    cut = np.flatnonzero(below.any(axis=1) & ~below.all(axis=1))
    corners, crossed = _crossings(points, height, triangles[cut], _TRIANGLE_EDGES)
    return corners[crossed].reshape(-1, 2, 2)


def _heights(points, north):
    """Return the distance of nodes from the plane, which is moved a little off grid planes."""
    return points[:, 1] - north - NUDGE * float(np.ptp(points[:, 1]))


def _crossings(points, height, cells, edges):
    """Return where the edges of cells cross the plane, (n, n_edges, 2), and which do."""
    first, second = cells[:, edges[:, 0]], cells[:, edges[:, 1]]
    crossed = (height[first] < 0.0) != (height[second] < 0.0)
    span = np.where(crossed, height[first] - height[second], 1.0)
    share = (height[first] / span)[..., None]
    places = points[first] + share * (points[second] - points[first])
    return places[..., [0, 2]], crossed


GROUND = ("#cdb58c", "#8fa3ad", "#5b6570", "#a7b08a", "#b48a78", "#7a8fb0")
COLOURS = INK, "#1d4ed8", "#0f766e", "#a16207", "#7e22ce", "#64748b", "#be185d", "#166534"
LETTERS = {"longitudinal": "L", "transverse": "T", "vertical": "V", "east": "E", "north": "N"}
PAPER_ORDER = ("transverse", "north", "vertical", "longitudinal", "east")
SOURCE_UNITS = {
    "moment": "N m/s, 1 kg", "force": "N", "tensor": "N m/s", "pressure": "Pa", "air": "Pa",
}  # fmt: skip
DPI = 110
MOST_SAMPLES = 4000  # of a seismogram in a page
_ABOVE = {
    "loc": "lower right", "bbox_to_anchor": (1.0, 0.97), "ncol": 2, "fontsize": 7, "frameon": False,
    "borderaxespad": 0.0,
}  # fmt: skip


def plot(what: Seismogram | Comparison) -> Figure:
    """Draw a seismogram in time and frequency, or the spectral ratios of a comparison.

    Parameters
    ----------
    what : Seismogram or Comparison

    Returns
    -------
    matplotlib.figure.Figure
    """
    if isinstance(what, Comparison):
        return draw_comparison(what)
    return draw_motion({what.label or "motion": what}, (SIMULATED,))


def draw_motion(seismograms, colours, top=None, t_max=None) -> Figure:
    """Draw the seismograms of a receiver: rows T, V, L; columns time and frequency.

    Parameters
    ----------
    seismograms : dict of str to Seismogram
        By legend; all with the same components.
    colours : sequence of str
    top : float, Hz, optional
        Right end of the frequency axes.
    t_max : float, s, optional
        Right end of the time axes.
    """
    first = next(iter(seismograms.values()))
    rows = sorted(range(3), key=lambda k: PAPER_ORDER.index(first.components[k]))
    figure = _figure(9.6, 6.4)
    axes = figure.subplots(3, 2, sharex="col", gridspec_kw={"width_ratios": [1.5, 1.0]})
    for (name, record), colour in zip(seismograms.items(), colours, strict=False):
        spectrum = smoothed_spectrum(record)
        dominant = dominant_frequency(record).hz
        for component, row in zip(rows, axes, strict=True):
            if not record.present[component]:
                continue
            motion = 1e3 * record.velocity[:, component]
            peak = f"{name}, PPV {_short(np.abs(motion).max())}"
            hz = dominant[component]
            row[0].plot(record.times, motion, color=colour, lw=0.9, label=peak)
            label = "silent" if np.isnan(hz) else f"peak at {_short(hz)} Hz"
            amplitude = 1e3 * spectrum.amplitude[:, component]
            row[1].plot(spectrum.frequency, amplitude, color=colour, lw=1.1, label=label)
    for component, row in zip(rows, axes, strict=True):
        row[0].set_ylabel(f"{LETTERS[first.components[component]]} [mm/s]")
        row[1].set_ylabel("amplitude [mm/s/Hz]")
        for axis in row:
            axis.legend(**_ABOVE)
            _tidy(axis)
    axes[2, 0].set_xlabel("time after the first firing [s]")
    axes[2, 1].set_xlabel("frequency [Hz]")
    axes[2, 0].set_xlim(min(0.0, first.start), t_max or first.times[-1])
    axes[2, 1].set_xlim(0.0, top or 0.5 / first.dt)
    return figure


def source_figure(histories, top) -> dict:
    """Return the plot of source histories, and the spectrum of their slope up to ``top`` Hz.

    Parameters
    ----------
    histories : dict of str to (n, 2) float64
        Time in s, and moment rate in N m/s, force in N or pressure in Pa.
    top : float, Hz
    """
    panels = []
    for name, table in histories.items():
        time = np.arange(table[0, 0], table[-1, 0], min(np.diff(table[:, 0]).min(), 0.1 / top))
        slope = np.gradient(np.interp(time, *table.T), time)
        spectrum = np.abs(np.fft.rfft(slope, 8 * len(slope)))
        frequency = np.fft.rfftfreq(8 * len(slope), time[1] - time[0])
        shown = frequency <= 1.01 * top
        share = spectrum[shown] / spectrum.max()
        label = f"{name.replace('_', ' ')} [{SOURCE_UNITS[name.rpartition('_')[0]]}]"
        panels += [
            panel(axis_of("time [s]"), axis_of(label),
                  [line(table[:, 0], table[:, 1], name, FAULT)], 230, share=1.5),
            panel(axis_of("frequency [Hz]", 0.0, top), axis_of("share of the peak", 0.0),
                  [line(frequency[shown], share, None, FAULT)], 230),
        ]  # fmt: skip
    return page_plot("Source histories and spectra of their slope.", *panels, columns=2)


def section_figure(result, north):
    """Draw a vertical section of the model: materials, joints, faults, receivers.

    Without the ground beyond it, in which waves are absorbed and faults stand upright.

    Parameters
    ----------
    result : Result
    north : float, m
        North coordinate of the section.
    """
    mesh, summary = result.arrays["mesh"], result.summary
    polygons, zone = section_of_zones(mesh["points"], mesh["zones"], north)
    (west, east), _, (low, high) = summary["extent"]
    width, height = east - west, high - low
    figure = _figure(9.6, float(np.clip(8.4 * height / width + 1.0, 2.6, 7.0)))
    axes = figure.subplots()
    patches = PolyCollection(polygons, linewidths=0.15, edgecolors=(1.0, 1.0, 1.0, 0.35))
    names = summary["mesh_names"]["groups"]
    number = result.arrays["zones"]["group"][zone]
    patches.set_facecolor([GROUND[n % len(GROUND)] for n in number])
    for n in np.unique(number):
        axes.plot([], [], "s", color=GROUND[n % len(GROUND)], label=names[n])
    axes.add_collection(patches)
    _draw_joints(axes, result, north)
    _draw_receivers(axes, summary, mesh["points"])
    axes.set_aspect("equal")
    axes.set_xlim(west - 0.03 * width, east + 0.03 * width)
    axes.set_ylim(low, high + 0.1 * height)
    axes.spines[["top", "right"]].set_visible(False)
    axes.set_xlabel("east [m]")
    axes.set_ylabel("height [m]")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, 1.14), ncol=6, fontsize=7, frameon=False)
    return _uri(figure)


def _draw_joints(axes, result, north):
    """Draw the traces of joints, faults stronger."""
    names = result.summary["mesh_names"]
    points = result.arrays["mesh"]["points"]
    labelled = set()
    for name in names["joints"]:
        segments = section_of_surface(points, result.arrays["surfaces"][name], north)
        fault = name in names["faults"]
        colour, kind = (FAULT, "fault") if fault else (INK, "joint")
        lines = LineCollection(segments, colors=colour, linewidths=1.6 if fault else 0.5)
        lines.set_capstyle("round")
        axes.add_collection(lines)
        if len(segments) and kind not in labelled:
            axes.plot([], [], color=colour, lw=1.6 if fault else 0.5, label=kind)
            labelled.add(kind)


def _draw_receivers(axes, summary, points):
    """Mark the receivers and the input face."""
    for number, (name, table) in enumerate(summary["receivers"].items()):
        x, _, z = table["position"]
        axes.plot(x, z, "v", color=SIMULATED, ms=7, label="receiver" if number == 0 else None)
        axes.annotate(
            name, (x, z), xytext=(0, 7), textcoords="offset points", fontsize=8, ha="center"
        )
    sources = summary["sources"]
    inside = (*sources["holes"], *sources["forces"], *sources["tensors"])
    for number, table in enumerate(inside):
        x, _, z = table["position"]
        label = "source" if number == 0 else None
        axes.plot(x, z, "*", color=FAULT, mec="white", mew=0.5, ms=9, label=label)
    if summary["input"] is not None and summary["input"]["face"] == "west":
        low, high = points.min(axis=0), points.max(axis=0)
        for height in np.linspace(low[2], high[2], 9)[1:-1]:
            axes.annotate(
                "", (low[0], height), (low[0] - 0.06 * (high[0] - low[0]), height),
                arrowprops={"arrowstyle": "->", "color": SIMULATED},
            )  # fmt: skip


def energy_figure(energy, lead, layered=False) -> dict:
    """Return the plot of energy since the start, of ground in an absorbing layer or not."""
    names = {
        "input": "put in", "kinetic": "kinetic", "strain": "strain",
        "dashpots": "absorbed by dashpots", "absorbing_layer": "absorbing layer",
        "damping": "material damping", "joint_stored": "stored in joints",
        "joint_dissipated": "slip in joints",
    }  # fmt: skip
    if layered and "absorbing_layer" not in energy:  # both are damping
        names["damping"] += " and absorbing layer"
    gained = {name: energy[name] - energy[name][0] for name in names if name in energy}
    top = max(float(np.abs(gain).max()) for gain in gained.values())
    factor, unit = next((each for each in ENERGY_UNITS if each[0] * top > 1.0), ENERGY_UNITS[-1])
    lines = [
        line(energy["time"] - lead, factor * gained[name], label, COLOURS[number],
             **({"width": 4, "opacity": 0.4} if name == "input" else {}))
        for number, (name, label) in enumerate(names.items())
        if name in gained and np.abs(gained[name]).max() > LEAST_SHOWN * top
    ]  # fmt: skip
    least = min(float(gain.min()) for gain in gained.values())
    ends = None, None
    if top > 0.0 and least > -LEAST_SHOWN * top:  # joints under initial stress give energy, too
        ends = LEAST_SHOWN * factor * top, 2.0 * factor * top
    upright = axis_of(f"energy [{unit}]", *ends, log=ends[0] is not None)
    across = axis_of("time after the first firing [s]")
    return page_plot("Energy since the start of the run.", panel(across, upright, lines, 340))


MOST_CONTACTS = 1500  # of a joint in a page


def slip_figure(position, slip, history) -> dict:
    """Return the plot of a joint in a blast: map of its slip on its plane, slip and safety by time.

    Parameters
    ----------
    position : (n, 3) float64, m
        Of its contacts.
    slip : (n,) float64, m
        Largest of each.
    history : (n_samples, 5) float64
        As `Stability.arrays`.
    """
    middle = position.mean(axis=0)
    normal = np.linalg.svd(position - middle, full_matrices=False)[2][-1]
    level = np.hypot(*normal[:2])
    strike = np.array([normal[1], -normal[0], 0.0]) / level if level > FLAT else np.eye(3)[0]
    up = np.cross(strike, normal)
    up *= 1.0 if up[2] >= 0.0 else -1.0
    shown = np.argsort(slip, kind="stable")[::-1][:MOST_CONTACTS][::-1]
    along, rise = (position[shown] - middle) @ strike, (position[shown] - middle) @ up
    top = 1e3 * float(slip.max())
    scale = {"label": "largest slip [mm]", "low": 0.0, "high": top or 1.0, "colours": "viridis"}
    contacts = dots(along, rise, None, INK, radius=3, values=1e3 * slip[shown])
    times = axis_of("time after the first firing [s]")
    return page_plot(
        "Largest slip over the plane of the joint, its slip and its factor of safety over time.",
        panel(axis_of("along strike [m]"), axis_of("up dip [m]"), [contacts], equal=True,
              scale=scale),
        panel(times, axis_of("largest slip [mm]", 0.0),
              [line(history[:, 0], 1e3 * history[:, 1], "slip", SIMULATED),
               line(history[:, 0], 1e3 * history[:, 2], "opening", RECORDED)]),
        panel(times, axis_of("factor of safety"), [line(history[:, 0], history[:, 4])]),
        columns=3,
    )  # fmt: skip


def _figure(width, height):
    """Return an empty figure in the style of the report."""
    figure = Figure(figsize=(width, height), dpi=DPI, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def _short(value):
    """Show three digits without powers of ten."""
    return f"{value:.0f}" if abs(value) >= 1000.0 else f"{value:.3g}"


def _tidy(axis):
    """Light grid below all else, small labels, no frame above and right."""
    axis.grid(color="#e5e5e5", lw=0.6)
    axis.set_axisbelow(True)
    axis.tick_params(labelsize=8)
    axis.spines[["top", "right"]].set_visible(False)


def _uri(figure):
    """Return a figure as data URI; one that can't be drawn as a sentence that says so.

    Texts, which may hold names of users, are drawn as they are: no sign of them is a formula.
    """
    for text in figure.findobj(Text):
        text.set_parse_math("$" not in text.get_text())
    stream = io.BytesIO()
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "Glyph .* missing from")
            figure.savefig(stream, format="png", bbox_inches="tight", pad_inches=0.1)
    except (ValueError, RuntimeError, ArithmeticError, LookupError, TypeError) as error:
        return _sentence_image(f"This figure can't be drawn ({error})".split("\n")[0][:90])
    return "data:image/png;base64," + base64.b64encode(stream.getvalue()).decode()


def _sentence_image(text):
    """Return a sentence as a data URI of an image."""
    image = f"""<svg xmlns="http://www.w3.org/2000/svg" width="700" height="40">
<text x="8" y="24" font-family="sans-serif" font-size="14">{escape(text)}</text></svg>"""
    return "data:image/svg+xml;base64," + base64.b64encode(image.encode()).decode()


SUM = "vector sum"
LEAST_SPAN = 1.0, 100.0  # Hz


def limits_figure(motions, curves):
    """Return the plot of peaks of components, and of the vector sum if a curve limits that.

    Parameters
    ----------
    motions : dict of str to dict of str to Seismogram
        By "simulated" and "recorded", then by receiver.
    curves : sequence of LimitCurve

    Returns
    -------
    drawn : dict
        Of `page_plot`.
    left_out : list of str
        Peaks that have no frequency; see `peaks_of`.
    """
    summed = any(curve.quantity == SUM for curve in curves)
    peaks = [
        (kind, f"{name} {what}", size, hz)
        for kind, at_receivers in motions.items()
        for name, motion in at_receivers.items()
        for what, size, hz in peaks_of(motion, summed)
    ]
    drawn = [row for row in peaks if np.isfinite(row[-1])]
    span = [*LEAST_SPAN, *(1.2 * hz for *_, hz in drawn)]
    frequency = np.geomspace(min(span), max(span), 2000)
    marks = [
        line(frequency, 1e3 * curve.limit(frequency), f"{curve.name} ({curve.quantity})",
             COLOURS[1 + k % (len(COLOURS) - 1)])
        for k, curve in enumerate(curves)
    ]  # fmt: skip
    for kind, colour in zip(motions, (SIMULATED, RECORDED), strict=False):
        of_kind = [(text, 1e3 * size, hz) for k, text, size, hz in drawn if k == kind]
        if of_kind:
            text, size, hz = zip(*of_kind, strict=True)
            marks.append(dots(hz, size, kind, colour, text=text))
    across = axis_of("frequency by zero crossing [Hz]", frequency[0], frequency[-1], log=True)
    upright = axis_of("peak particle velocity [mm/s]", log=True)
    left_out = [f"{text} ({kind})" for kind, text, _, hz in peaks if not np.isfinite(hz)]
    words = "Peaks of components against limit curves."
    return page_plot(words, panel(across, upright, marks, 420)), left_out


def peaks_of(motion, summed):
    """Return name, size in m/s and frequency in Hz of the peaks of a place.

    Frequencies are by zero crossing at the peak, that of the largest component for the vector
    sum; NaN without crossings on both sides. Components that are silent or missing have no peak.
    """
    frequency = zero_crossing_frequency(motion).hz
    rows = [
        (LETTERS[name], float(size), float(hz))
        for name, size, hz in zip(motion.components, motion.ppv, frequency, strict=True)
    ]
    if summed:
        rows.append((SUM, motion.pvs, float(frequency[np.nanargmax(motion.ppv)])))
    return [row for row in rows if row[1] > 0.0]


def waveform_figure(seismograms, colours, top=None, t_max=None) -> dict:
    """Return seismograms and amplitude spectra of a receiver as plots.js draws them.

    A record of more than `MOST_SAMPLES` keeps the smallest and the largest of each interval. Values
    are little-endian 16-bit integers in base64, times ``scale``.

    Parameters
    ----------
    seismograms : dict of str to Seismogram
        By legend; all with the same components.
    colours : sequence of str
    top : float, Hz, optional
        Right end of the frequency axes. Default: the Nyquist frequency.
    t_max : float, s, optional
        Right end of the time axes. Default: the end of the longest record.
    """
    first = next(iter(seismograms.values()))
    top = top or 0.5 / first.dt
    traces = []
    for kind, motion in seismograms.items():
        spectrum, dominant = smoothed_spectrum(motion), dominant_frequency(motion).hz
        growth = spectrum.frequency[1] / spectrum.frequency[0]
        below = spectrum.frequency <= growth * top
        for k in sorted(range(3), key=lambda k: PAPER_ORDER.index(motion.components[k])):
            if motion.present[k]:
                values, dt = _sampled(1e3 * motion.velocity[:, k], motion.dt)
                traces.append(
                    {"kind": kind, "name": motion.components[k], "start": motion.start, "dt": dt,
                     "ppv": 1e3 * motion.ppv[k],
                     "hz": None if np.isnan(dominant[k]) else float(dominant[k]),
                     "spectrum": {"low": spectrum.frequency[0], "growth": growth}
                     | _packed(1e3 * spectrum.amplitude[below, k])}
                    | _packed(values)
                )  # fmt: skip
    named = dict(zip(seismograms, colours, strict=False))
    return {"traces": traces, "colours": named, "top": float(top), "end": t_max}


def _sampled(values, dt):
    """Return at most `MOST_SAMPLES` values and their interval in s."""
    step = max(1, ceil(2 * len(values) / MOST_SAMPLES))
    return (_thinned(values, step), 0.5 * step * dt) if step > 2 else (values, dt)


def _packed(values):
    """Return values as base64 of 16-bit integers, and the scale that gives them back."""
    scale = float(np.abs(values).max(initial=0.0)) / 32000.0 or 1.0
    packed = np.round(values / scale).astype("<i2").tobytes()
    return {"scale": scale, "values": base64.b64encode(packed).decode()}


def _thinned(values, step):
    """Return smallest and largest of every ``step`` values, in the order of their times."""
    whole = values[: len(values) // step * step].reshape(-1, step)
    first, last = whole.argmin(axis=1), whole.argmax(axis=1)
    picked = np.sort(np.stack([first, last], axis=1), axis=1)
    return np.take_along_axis(whole, picked, axis=1).ravel()


def draw_comparison(comparison) -> Figure:
    """Draw the spectral ratio of a `Comparison`, simulated over recorded, of each component."""
    figure = _figure(7.4, 3.6)
    axis = figure.subplots()
    for name, ratio in zip(comparison.components, comparison.spectral_ratio.T, strict=True):
        axis.loglog(comparison.frequency, ratio, lw=1.2, label=name)
    axis.axhline(1.0, color=INK, lw=0.8)
    axis.set_xlabel("frequency [Hz]")
    axis.set_ylabel("simulated over recorded")
    axis.legend(**_ABOVE)
    _tidy(axis)
    return figure
