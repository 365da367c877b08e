"""Report of field records: data quality, odd channels, air wave, dispersion, sensor response."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..files import write_text
from ..line_records.shots import ShotGather
from ..line_records.waves import Picks, rayleigh_speeds
from .figures import _figure, _tidy, _uri
from .pages import page
from .plots import FAULT, INK, RECORDED, SIMULATED

FOUND = {
    "NAMED": "found",
    "CLASS": "found, one of several causes",
    "UNKNOWN": "significant, but no cause is confirmed",
    "NULL": "nothing found",
}
LABELS = {
    "polarity": "reversed polarity",
    "clock_error": "timing error",
    "wrong_coordinates": "geometry error",
    "no_signal": "no signal",
    "air_blast": "air wave",
    "soft_surface_layer": "soft surface layer",
    "instrument_response": "sensor response that is not flat",
}
VALUES = {  # name and unit of a parameter
    "factor": ("factor", ""),
    "shift": ("late by", "ms"),
    "move": ("true position farther along the line by", "m"),
    "speed": ("speed", "m/s"),
    "delay": ("delay of the source time", "ms"),
    "thickness": ("thickness", "m"),
    "vs_layer": ("Vs of the layer", "m/s"),
    "vs_below": ("Vs below", "m/s"),
    "vs_mean": ("mean Vs down to half of the longest wavelength", "m/s"),
    "departure": ("rms of the log response about one gain", ""),
    "corner": ("corner", "Hz"),
    "damping": ("damping of critical", ""),
    "energy": ("share of a record's energy in its window", ""),
}
CLOSED_LISTS = {  # what each analysis chooses from; nothing else can be its answer
    "odd channels": "reversed polarity, timing error, geometry error or no signal of one receiver "
    "at a time; not gain, response, coupling or exchanged channels",
    "air wave": "a wave that leaves the source at its time with the speed of sound in air; other "
    "waves are not named",
    "layering": "one soft layer over a half-space, or one speed; not a stiff layer, a gradient or "
    "further layers",
    "sensor response": "one gain, one corner with its damping, or another curve, the same at both "
    "places; not noise or coupling of one of them",
}
HELD_OUT = {
    "odd channels": "share of energy that the neighbours predict in held-out shots, as recorded "
    "and corrected",
    "air wave": "share of energy predicted at held-out receivers, without and with the air wave",
    "layering": "rms misfit of the phase speeds of held-out shots, in standard deviations, by one "
    "speed and by the layer",
    "sensor response": "rms log ratio at the held-out place, by one gain and by the curve",
}
SHOWN = 12  # records whose peaks are printed
EARLY = 0.6  # largest share of a record that the figure of a shot shows
OFFSET_SPEED = 90.0  # m/s, slowest wave that the figure of a shot shows completely


@dataclass(frozen=True, eq=False)
class LineView:
    """Line of receivers: content of its figures.

    Parameters
    ----------
    name : str
    shot : ShotGather
        The shot to draw.
    file : str
        File of the shot.
    picks : dict of str to Picks
        Phase speeds of the shots that were fitted and of those that were held out.
    outcomes : list of dict
        The analyses of the line.
    """

    name: str
    shot: ShotGather
    file: str
    picks: dict[str, Picks]
    outcomes: list[dict]


def records_lines(summary: dict) -> list[str]:
    """Return the outcome of an analysis of records, one sentence a line.

    Parameters
    ----------
    summary : dict
        Content of ``records.json``.
    """
    files = summary["files"]
    dead = sum(len(row["dead"]) for row in files)
    clipped = [row for row in files if row["clipped"]]
    wrong = [row["file"] for row in files if row["printed_values_wrong"]]
    lines = [
        f"{len(files)} records, {sum(row['channels'] for row in files)} channels: {dead} dead, "
        f"{sum(len(row['clipped']) for row in files)} clipped"
        + (f" ({', '.join(row['file'] for row in clipped)})" if clipped else ""),
        *_peak_lines(files),
    ]
    if any(row["printed_values_checked"] for row in files):
        lines.append(
            f"values that the instrument printed differ from the samples in {', '.join(wrong)}"
            if wrong
            else "the samples give the values that the instruments printed"
        )
    lines += [outcome_text(row) for row in summary["analyses"]]
    if any(row["outcome"] in ("NAMED", "CLASS") for row in summary["analyses"]):
        lines.append("each cause is the best of a closed list (closed_lists in records.json)")
    missing = {}
    for row in summary["not_analysed"]:
        missing.setdefault(row["reason"], []).append(f"{row['analysis']}{_of(row)}")
    lines += [f"{', '.join(names)}: not analysed: {why}" for why, names in missing.items()]
    if summary["skipped"]:
        lines.append(f"{len(summary['skipped'])} files are no records or can't be read")
    lines += [
        f"- {row['file']}: {row['reason']}"
        for row in summary["skipped"]
        if row["reason"] != "is no record"
    ]
    return lines


def _peak_lines(files):
    """Return the peaks of the strongest records of single instruments, one a line."""
    rows = [row for row in files if row["peaks"] and any(map(math.isfinite, row["peaks"]["ppv"]))]
    rows.sort(key=lambda row: -row["peaks"]["vector_sum"])
    lines = []
    for row in rows[:SHOWN]:
        peaks = row["peaks"]
        parts = ", ".join(
            f"{name} {1e3 * ppv:.3g}" + ("" if hz is None else f" at {hz:.3g} Hz")
            for name, ppv, hz in zip(
                peaks["components"], peaks["ppv"], peaks["frequency"], strict=True
            )
        )
        lines.append(
            f"{row['file']}: PPV in mm/s {parts}; vector sum {1e3 * peaks['vector_sum']:.3g}"
        )
    more = f"{len(rows) - SHOWN} weaker records: peaks.csv" if len(rows) > SHOWN else ""
    return [*lines, more] if more else lines


def outcome_text(row: dict) -> str:
    """Return the sentence of one analysis, with its values and 90 % intervals."""
    labels = " or ".join(LABELS.get(str(label), str(label)) for label in row["label"].split(" | "))
    head = f"{row['analysis']}{_of(row)}: {FOUND[row['outcome']]}"
    target = f" at {', '.join(map(str, row['target']))}" if row["target"] else ""
    values = "".join(f"; {text}" for text in values_of(row))
    if row["outcome"] == "NULL":
        return f"{head} ({row['reason']}; p = {row['p_value']:.2g})"
    nearest = "nearest is " if row["outcome"] == "UNKNOWN" else ""
    return f"{head}: {nearest}{labels}{target}{values} ({row['reason']}; p = {row['p_value']:.2g})"


def values_of(row: dict) -> list[str]:
    """Return the parameters of an analysis with units and 90 % intervals."""
    texts = []
    for name, (value, low, high) in row["parameters"].items():
        words, unit = VALUES.get(name, (name, ""))
        scale = 1e3 if unit == "ms" else 1.0
        symbol = f" {unit}" if unit else ""
        spread = "" if low == high else f" ({scale * low:.3g} to {scale * high:.3g})"
        texts.append(f"{words} {scale * value:.3g}{symbol}{spread}")
    return texts


def _of(row: dict) -> str:
    """Return which line an analysis belongs to."""
    return f" of line {row['line']}" if row["line"] else ""


def write_records_report(path: str | Path, summary: dict, views: Sequence[LineView]) -> None:
    """Write the page of an analysis of field records.

    Parameters
    ----------
    path : path
    summary : dict
        Content of ``records.json``.
    views : sequence of LineView
    """
    figures = []
    for view in views:
        name = f"Line {view.name}" if view.name else "Line"
        figures.append((f"{name}: shot {view.file}", _shot_caption(view), shot_figure(view)))
        if any(len(picks.speed) for picks in view.picks.values()):
            caption = "Phase speeds of surface waves with standard deviations, by the shots fitted "
            caption += "and the shots held out"
            caption += "; the line is the fitted layer." if _layer(view) else "."
            figures.append((f"{name}: dispersion", caption, dispersion_figure(view)))
    rows = [
        {**row, "found": FOUND[row["outcome"]], "values": values_of(row),
         "labels": " or ".join(LABELS.get(str(x), str(x)) for x in row["label"].split(" | ")),
         "held_out_is": HELD_OUT[row["analysis"]]}
        for row in summary["analyses"]
    ]  # fmt: skip
    heads = ("title", "caption", "image")
    text = page("records.html").render(
        s=summary,
        lines=records_lines(summary),
        rows=rows,
        figures=[dict(zip(heads, row, strict=True)) for row in figures],
    )
    write_text(path, text)


def _shot_caption(view: LineView) -> str:
    """Return the caption of the figure of a shot."""
    text = "Each usable channel, normalised, at its position along the line."
    if _odd(view):
        text += " Red: odd channels."
    if _speed(view):
        text += f" Dashed: the air wave, {_speed(view):.0f} m/s."
    return text


def _odd(view: LineView) -> set[int]:
    """Return the channels, from 0, that are odd."""
    return {
        number - 1
        for row in view.outcomes
        if row["analysis"] == "odd channels" and row.get("outcome", "NULL") != "NULL"
        for number in row["target"]
    }


def _speed(view: LineView) -> float | None:
    """Return the speed of the air wave in m/s where one was found."""
    for row in view.outcomes:
        if row["analysis"] == "air wave" and row.get("outcome") == "NAMED":
            return row["parameters"]["speed"][0]
    return None


def _layer(view: LineView) -> dict | None:
    """Return the parameters of the layer that was fitted."""
    for row in view.outcomes:
        if row["analysis"] == "layering" and row.get("parameters"):
            return row["parameters"]
    return None


def shot_figure(view: LineView) -> str:
    """Draw the channels of a shot against time, by their position along the line.

    Returns
    -------
    str
        PNG as a data URI.
    """
    shot = view.shot
    figure = _figure(9.6, 5.2)
    axes = figure.subplots()
    last = min(shot.times[-1], max(shot.offsets.max() / OFFSET_SPEED, EARLY * shot.times[-1] / 2))
    shown = (shot.times <= last) & (shot.times >= min(0.0, -0.1 * last))
    gap = float(np.median(np.diff(shot.places)))
    for position, row, channel in zip(shot.places, shot.motion, shot.channels, strict=True):
        row = row - row.mean()
        size = np.abs(row[shown]).max() or 1.0
        odd = int(channel) in _odd(view)
        axes.plot(shot.times[shown], position + 0.9 * gap * row[shown] / size,
                  color=FAULT if odd else INK, lw=0.9 if odd else 0.45)  # fmt: skip
    if _speed(view):
        axes.plot(shot.offsets / _speed(view), shot.places, "--", color=SIMULATED, lw=1.2)
    axes.set_xlim(shot.times[shown][0], last)
    axes.set_xlabel("time [s]")
    axes.set_ylabel("position along the line [m]")
    _tidy(axes)
    return _uri(figure)


def dispersion_figure(view: LineView) -> str:
    """Draw phase speeds against frequency, and those of the fitted layer.

    Returns
    -------
    str
        PNG as a data URI.
    """
    figure = _figure(9.6, 3.4)
    axes = figure.subplots()
    for (name, picks), colour in zip(view.picks.items(), (RECORDED, "#9aa5b1"), strict=True):
        axes.errorbar(picks.frequency, picks.speed, picks.sigma, fmt="o", ms=4, lw=1.0,
                      color=colour, label=f"shots {name}")  # fmt: skip
    layer = _layer(view)
    if layer is not None:
        ends = [p.frequency for p in view.picks.values() if len(p.frequency)]
        frequency = np.geomspace(min(f.min() for f in ends), max(f.max() for f in ends), 40)
        thickness, *speeds = (layer[name][0] for name in ("thickness", "vs_layer", "vs_below"))
        axes.plot(frequency, rayleigh_speeds(frequency, [thickness], speeds), color=SIMULATED,
                  lw=1.4, label="layer over half-space")  # fmt: skip
    axes.set_xlabel("frequency [Hz]")
    axes.set_ylabel("phase speed [m/s]")
    axes.set_ylim(0.0, None)
    axes.legend(fontsize=7, frameon=False, ncol=3)
    _tidy(axes)
    return _uri(figure)
