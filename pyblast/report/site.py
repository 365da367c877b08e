"""Report of a site from blast to blast: compliance over time, site law, what was not joined."""

from datetime import datetime
from pathlib import Path

import numpy as np

from ..files import write_text
from ..line_records.changes import WORDS
from ..signals.comparison import load_limits
from ..units import plain_number
from .pages import page
from .plots import (
    FAULT,
    INK,
    RECORDED,
    SIMULATED,
    axis_of,
    dots,
    line,
    page_plot,
    panel,
    segments,
)

SHOWN = 40  # records of the table on the page, the latest
FILES = 6  # of which the page says what was read: log, stations, hole tables
NAMED = 6  # refused files whose reasons the terminal shows
METHODS = {
    "law": "by the law", "superposition": "by superposed holes",
    "model": "by the model",
}  # fmt: skip
COLOURS = RECORDED, SIMULATED, "#0f766e", "#7c3aed", "#b45309", "#475569"


def site_lines(summary: dict) -> list[str]:
    """Return what a site shows so far, one sentence a line.

    Parameters
    ----------
    summary : dict
        Content of ``site.json``.
    """
    return [line for lines in _sections(summary).values() for line in lines]


def _sections(summary):
    """Return the sentences on a site by the section that they belong to."""
    rows, unjoined = summary["records"], summary["unjoined"]
    silent = len(summary["silent"])
    limits = [_over(rows, "share", load_limits()[summary["limit_curve"]].name)]
    if summary["air_limit"] is not None:
        words = f"{plain_number(summary['air_limit'])} Pa of air overpressure"
        limits.append(_over(rows, "air_share", words))
    laws = [_law_words("peak velocity", summary["law"])]
    if any(row["overpressure"] for row in rows):
        laws.append(_law_words("air overpressure", summary["air_law"]))
    clocks = [
        f"{station}: its clock is off, "
        + ", ".join(f"{count} records by {int(h):+d} h" for h, count in hours.items())
        for station, hours in summary["clocks"].items()
    ]
    refused = [row for row in [*unjoined, *summary["skipped"]] if row["reason"] != "is no record"]
    return {
        "Limits": limits,
        "Records": [
            f"{len(rows)} records of {len({row['blast'] for row in rows})} of "
            f"{len(summary['blasts'])} blasts at {len({row['station'] for row in rows})} stations; "
            f"{silent} time{'s' * (silent != 1)} one did not trigger; {len(unjoined)} records "
            f"belong to no blast, {len(summary['skipped'])} files are no records or can't be read",
            *clocks,
            *(f"- {row['file']}: {row['reason']}" for row in refused[:NAMED]),
            *([f"- {len(refused) - NAMED} more in site.json"] if len(refused) > NAMED else []),
        ],
        "Site law": laws,
        "Changes": [_change_words(row) for row in summary["changes"]],
        "Model": _model_lines(summary),
        "Forecasts": _forecast_lines(summary),
        "Limit of a share of blasts": _statistical_lines(summary["statistical"]),
    }  # fmt: skip


def _over(rows, key, words):
    """Return how many records exceed a limit, and the largest share of it."""
    known = [row for row in rows if row.get(key) is not None]
    if not known:
        return f"{words}: no record to compare"
    worst = max(known, key=lambda row: row[key])
    over = [row for row in known if row[key] > 1.0]
    head = f"{len(over)} of {len(known)} records exceed" if over else f"all {len(known)} keep"
    return (
        f"{head} {words}; the largest, {plain_number(100 * worst[key])} %, is blast "
        f"{worst['blast']} at {worst['station']}, {worst['time'][:10]}"
    )


def _law_words(what, law):
    """Return the law of a quantity as a sentence, or why there is none."""
    if "refused" in law:
        return f"no law of {what}: {law['refused'].removeprefix('site law: ')}"
    low, high = law["beta_90"]
    text = (
        f"{what} falls as (R/W^{law['charge_exponent']:.3g})^-{law['beta']:.3g}, "
        + (
            "an exponent that is taken, not fitted"
            if law["fixed"]
            else f"90 % interval {low:.3g} to {high:.3g}"
        )
        + f", {law['n']} records"
        + (f" and {law['below']} below their trigger" if law["below"] else "")
        + f"; 95 % of blasts stay below {10 ** (1.645 * law['s']):.2g} times the median"
    )
    far = [f"{row['blast']} at {row['station']} ({row['factor']:.2g} times)"
           for row in law["outliers"]]  # fmt: skip
    text += f" ({law['fixed'].removeprefix('site law: ')})" if law["fixed"] else ""
    return text + (f"; far off the others: {', '.join(far[:4])}" if far else "")


def _change_words(row):
    """Return a change as a sentence: when, where, what, by how much."""
    kinds = " or ".join(WORDS[kind] for kind in row["kinds"])
    where = f"at {row['station']}" if row["station"] else "at all stations"
    first, last = row["between"]
    says = f"; the log: {', '.join(row['log_says'])}" if row["log_says"] else ""
    how = f"changed slowly until about {row['until']}" if row["until"] else "changed"
    return (
        f"since {row['blast']}, {row['time'][:10]} (after {first}, at the latest from {last}), "
        f"{where}: {kinds} {how}{_step_words(row)}{says}"
    )


def _step_words(row):
    """Return the steps of a change that its records show."""
    step, error = (np.atleast_2d(np.array(row[key], dtype=float)) for key in ("step", "error"))
    if len(step) > 1:
        k = int(np.argmax(np.abs(step[:, 0])))
        step, error = step[k : k + 1], error[k : k + 1]
    words = []
    for name, size, spread in zip(row["features"], step[0], error[0], strict=True):
        if size and abs(size) > 1.645 * spread:
            ends = 10.0 ** (size - 1.645 * spread), 10.0 ** (size + 1.645 * spread)
            words.append(
                f"{name} {size:+.2g}" if name in ("along", "across")
                else f"{name} {10.0**size:.2f} times ({ends[0]:.2f} to {ends[1]:.2f})"
            )  # fmt: skip
    return f": {', '.join(words)}" if words else ""


def _forecast_lines(summary):
    """Return the forecasts of planned blasts, and how the earlier ones came out."""
    lines, planned = [], {}
    for row in summary["forecasts"]:
        planned.setdefault((row["blast"], row["station"]), []).append(row)
    for (blast, station), rows in planned.items():
        each = "; ".join(f"{METHODS[row['method']]} {_band_words(row)}" for row in rows)
        lines.append(f"forecast of {blast} at {station}: {each}")
    for method, coverage in summary["coverage"].items():
        if coverage["forecasts"]:
            low, high = coverage["interval"]
            lines.append(
                f"of {coverage['forecasts']} forecasts {METHODS[method]} from earlier blasts, "
                f"{100 * coverage['inside'] / coverage['forecasts']:.3g} % ({100 * low:.3g} to "
                f"{100 * high:.3g}) of the peaks came inside the 90 % band, a factor of "
                f"{coverage['factor']:.2g} up and down"
            )
    return lines


def _band_words(row):
    """Return a forecast in words: peak, frequency and limit with their bands."""
    low, high = row["band"]
    text = f"{1e3 * row['median']:.3g} mm/s (90 % between {1e3 * low:.3g} and {1e3 * high:.3g})"
    if row.get("limit") is not None:
        low, high = row["frequency_band"]
        text += (
            f" at {row['frequency']:.3g} Hz ({low:.3g} to {high:.3g}), "
            f"{100 * row['share_below_limit']:.3g} % of such blasts below the "
            f"{1e3 * row['limit']:.3g} mm/s of the limit"
        )
    return text


def _model_lines(summary):
    """Return how records compare with the model, and which command looks for the cause."""
    lines = [
        f"{row['station']}: {row['median']:.2g} times the model, median of {row['records']} records"
        + ("" if row["per_year"] is None else
           f"; it changes by a factor of {row['per_year']:.2f} a year ({row['per_year_90'][0]:.2f} "
           f"to {row['per_year_90'][1]:.2f})")
        for row in summary["model"]
    ]  # fmt: skip
    if summary["projects"] and summary["changes"]:
        first = summary["changes"][-1]["blast"]
        lines.append(
            f"something changed; which physics the model lacks since then says pyblast diagnose "
            f"{summary['projects'][0]}, with records of blasts from {first} on"
        )
    return lines


def _statistical_lines(limit):
    """Return how each station keeps a statistical limit."""
    lines = []
    for row in [] if limit is None else limit["stations"]:
        if not row["blasts"]:
            lines.append(f"{row['station']}: no blast of the period counts")
            continue
        low, high = row["interval"]
        ceiling = (
            f", {row['over_ceiling']} above {1e3 * limit['ceiling']:.3g} mm/s"
            if limit["ceiling"] is not None
            else ""
        )
        lines.append(
            f"{row['station']}: {100 * row['share']:.3g} % ({100 * low:.3g} to {100 * high:.3g}) "
            f"of {row['blasts']} blasts of the period below {1e3 * limit['level']:.3g} mm/s, "
            f"{100 * limit['share']:.3g} % are asked for; {row['over']} above{ceiling}; "
            + (f"{row['may_exceed']} more may be" if row["may_exceed"] >= 0 else
               f"{-row['may_exceed']} too many")
            + f" until it ends; counted are records and {row['below_trigger']} blasts below the "
            f"trigger, not counted {row['unknown']} without either"
        )  # fmt: skip
    return lines


def write_site_report(path: str | Path, summary: dict) -> None:
    """Write the page of a site.

    Parameters
    ----------
    path : path
    summary : dict
        Content of ``site.json``.
    """
    over = any((row.get("share") or 0.0) > 1.0 or (row["air_share"] or 0.0) > 1.0
               for row in summary["records"])  # fmt: skip
    text = page("site.html").render(
        s=summary | {"inputs": summary["inputs"][:FILES]}, sections=_sections(summary), over=over,
        figures=_figures(summary), shown=SHOWN, methods=METHODS, n_inputs=len(summary["inputs"]),
        curve=load_limits()[summary["limit_curve"]],
    )  # fmt: skip
    write_text(path, text)


def _figures(summary):
    """Return title, caption and plot of each figure."""
    figures = [{
        "title": "Peaks and their limit over time", "image": _over_time(summary),
        "caption": "Largest peak of each record as a share of the limit curve at its frequency; "
        "above 100 % the limit is exceeded.",
    }]  # fmt: skip
    figures.append({
        "title": "Control charts", "image": _charts(summary),
        "caption": "Each record over what distance, charge and the usual level of its station let "
        "expect: level of all channels, and vertical over horizontal. Upright lines: changes.",
    })  # fmt: skip
    if summary["model"]:
        figures.append({
            "title": "Records over the model", "image": _over_model(summary),
            "caption": "Largest peak of each record over that of the model for its hole table. "
            "Upright lines: changes.",
        })  # fmt: skip
    for key, label, words in (
        ("law", "peak velocity [mm/s]", "peak velocity"),
        ("air_law", "overpressure [Pa]", "air overpressure"),
    ):
        if "refused" not in summary[key]:
            figures.append({
                "title": f"Site law of {words}", "image": _law_plot(summary, key, label),
                "caption": "Lines: half and 95 % of blasts of the site stay below. Rings: trigger "
                "level of stations that did not trigger.",
            })  # fmt: skip
    return figures


def days(times, since) -> list[float]:
    """Return ISO times as days since a year began."""
    start = datetime(since, 1, 1)
    return [(datetime.fromisoformat(t) - start).total_seconds() / 86400.0 for t in times]


def time_axis(summary) -> tuple[int, dict]:
    """Return the first year of the records, and the axis of days since it began."""
    times = [row["time"] for row in summary["records"]]
    first, last = int(times[0][:4]), int(times[-1][:4])
    low, high = days([times[0], times[-1]], first)
    marks = (
        {f"{y}": f"{y}-01-01" for y in range(first, last + 2, 1 + (last - first) // 8)}
        if last - first > 1
        else {f"{y}-{m:02d}": f"{y}-{m:02d}-01" for y in (first, last) for m in (1, 7)}
    )
    at = dict(zip(days(marks.values(), first), marks, strict=True))
    ticks = {x: name for x, name in at.items() if low <= x <= high}
    pad = 0.02 * max(high - low, 1.0)
    label = f"days since {first}-01-01"
    return first, axis_of(label, low - pad, high + pad, ticks=ticks or None)


def by_station(summary):
    """Yield name, colour and records of each station that has any."""
    for n, station in enumerate(summary["stations"]):
        rows = [row for row in summary["records"] if row["station"] == station["name"]]
        if rows:
            yield station["name"], COLOURS[n % len(COLOURS)], rows


def _named(blast, time):
    """Return a blast with its day."""
    return f"{blast}, {time[:10]}"


def _over_time(summary):
    """Plot the share of the limit of each record over time."""
    first, axis = time_axis(summary)
    marks = [
        dots(days((row["time"] for row in rows), first),
             [np.nan if row.get("share") is None else 100.0 * row["share"] for row in rows],
             name, colour, radius=3, text=[_named(row["blast"], row["time"]) for row in rows],
             quiet=True)
        for name, colour, rows in by_station(summary)
    ]  # fmt: skip
    limit = line([axis["low"], axis["high"]], [100.0, 100.0], "limit", FAULT, dash=True)
    return page_plot("share of the limit", panel(
        axis, axis_of("peak over limit [%]", log=True), [limit, *marks], 320))  # fmt: skip


def _charts(summary):
    """Plot the control charts of all stations, with the dates of changes."""
    series = ("level", "level", RECORDED), ("channel_ratio", "vertical over horizontal", SIMULATED)
    return page_plot("control charts", *_panels(summary, summary["charts"], series))


def _over_model(summary):
    """Plot the records of all stations over the model, with the dates of changes."""
    series = (("factor", "record over model", RECORDED),)
    return page_plot("records over the model", *_panels(summary, summary["model"], series))


def _panels(summary, charts, series):
    """Return a panel for each chart of a station over time, with the dates of changes."""
    (first, axis), panels = time_axis(summary), []
    times = days((blast["time"] for blast in summary["blasts"]), first)
    names = [_named(blast["name"], blast["time"]) for blast in summary["blasts"]]
    for chart in charts:
        marks = [
            dots(times, [np.nan if v is None else v for v in chart[key]], words, colour, radius=2.5,
                 text=names, quiet=True)
            for key, words, colour in series
        ]  # fmt: skip
        for change in summary["changes"]:
            if change["station"] in (None, chart["station"]):
                at = days([change["time"]], first)
                text = [f"since {change['blast']}"]
                marks.append(segments(at, [0.4], at, [2.5], None, FAULT, text=text))
        panels.append(panel(axis, axis_of(f"{chart['station']}: factor", log=True), marks, 220))
    return panels


def _law_plot(summary, key, label):
    """Plot records and law over scaled distance."""
    law, exponent = summary[key], summary[key]["charge_exponent"]
    name, factor = ("peak", 1e3) if key == "law" else ("overpressure", 1.0)
    by_name = {blast["name"]: blast for blast in summary["blasts"]}
    marks = [
        dots([row["distance"] / row["charge"] ** exponent if row["charge"] and row["distance"]
              else np.nan for row in rows],
             [np.nan if row.get(name) is None else factor * row[name] for row in rows],
             station, colour, radius=3, text=[row["blast"] for row in rows], quiet=True)
        for station, colour, rows in by_station(summary)
    ]  # fmt: skip
    if key == "law" and summary["silent"]:
        at = {station["name"]: station["position"] for station in summary["stations"]}
        rings = [
            (np.linalg.norm(np.subtract(by_name[row["blast"]]["position"], at[row["station"]]))
             / by_name[row["blast"]]["charge"] ** exponent, factor * row["below"])
            for row in summary["silent"]
            if by_name[row["blast"]]["charge"] and None not in by_name[row["blast"]]["position"]
        ]  # fmt: skip
        marks += [dots(*np.transpose(rings), "did not trigger", INK, ring=True)] if rings else []
    marks += [
        line(law["scaled_distance"], factor * np.array(law["levels"][share]), words, INK, dash=dash)
        for share, words, dash in (("0.5", "median", False), ("0.95", "95 % stay below", True))
    ]
    unit = "m/kg^0.5" if exponent == 0.5 else "m/kg^(1/3)"
    return page_plot(f"site law of {label}", panel(
        axis_of(f"scaled distance [{unit}]", log=True), axis_of(label, log=True), marks, 340,
    ))  # fmt: skip
