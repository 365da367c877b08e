"""Report of a survey design: identifiability, trade-offs, gains of candidates, figures."""

import math
from dataclasses import asdict

import numpy as np

from ..back_analysis.parameters import range_of
from ..files import plain, write_text
from .figures import _figure, _short, _tidy, _uri
from .pages import page
from .plots import INK, SIMULATED, axis_of, dots, line, page_plot, panel, segments

RANGE, LABORATORY, GAIN = "#d8dde3", "#2563eb", "viridis"
INSIDE_90 = 2.1459660262893472  # standard deviations of a bivariate normal density
UNIFORM = 1.0 / np.sqrt(12.0)
BEYOND = 0.35  # of a range: how far laboratory values are drawn outside of it
KINDS = {"paper": "PPV and dominant frequency", "waveform": "waveforms"}
SHOWN = 5  # receivers in tables
DAMPING = "damping.ratio"


def summarise_survey(design) -> dict:
    """Return the plain numbers and words of a `SurveyDesign` for pages and tables."""
    ratios, others = design.information.ratios, design.other.ratios
    return {
        "by": KINDS[design.misfit],
        "by_other": KINDS["paper" if design.misfit == "waveform" else "waveform"],
        "band_hz": design.window.band,
        "noise": design.noise,
        "levels": design.levels,
        "mesh_error_missing": design.mesh_error_missing,
        "uncertain": list(design.uncertain),
        "parameters": [
            {
                **range_of(parameter),
                "value": design.values[k],
                "ratio": ratios[k],
                "ratio_other": others[k],
                "constraint": design.constraint(k),
                "why": design.why.get(parameter.name, ""),
                "within": design.within[k],
            }
            for k, parameter in enumerate(design.parameters)
        ],
        "covariance": design.information.covariance,
        "log_determinant": design.information.log_determinant,
        "worst": design.worst.worst,
        "worst_path": design.worst.worst_path,
        "trade_offs": [
            {"first": first, "second": second, "correlation": rho}
            for first, second, rho in design.trade_offs
        ],
        "receivers": [asdict(row) for row in design.receivers if row.in_survey],
        "apart": design.apart,
        "gridded": sum(row.gridded for row in design.receivers),
        "candidates": [asdict(row) for row in design.gains],
        "slip": [
            line
            for name, slip in design.slip.items()
            for line in slip_lines(name, _slip_table(slip))
        ],
        "holes": list(design.holes),
    }


def _slip_table(slip):
    """Return the table of a `Slip` for `slip_lines`."""
    strength = {name: asdict(row) for name, row in slip.strength.items()}
    factor = min((row.factor for row in slip.strength.values()), default=np.inf)
    receivers = {name: {"simulated": {"ppv": ppv.tolist()}} for name, ppv in slip.ppv.items()}
    return {"strength": strength, "factor": factor, "receivers": receivers}


def slip_lines(name, blast):
    """Yield a sentence on the slip of each joint surface of a blast.

    Parameters
    ----------
    name : str
    blast : dict
        ``strength`` and ``receivers`` of a summary.
    """
    for surface, row in blast["strength"].items():
        yield f"{name}, {surface}: {_slipped(row)}{_first(row, blast['receivers'])}"


def _slipped(row):
    """Return how many contacts slipped or opened."""
    before = f" ({row['before']} had failed before the blast)" if row["before"] else ""
    if row["failed"]:
        return f"{row['failed']} of {row['contacts']} contacts slipped or opened{before}"
    return f"no contact slipped or opened{before}"


def _first(row, receivers):
    """Return the peak velocity at which the first remaining contact would slip."""
    factor = row["factor"]
    if row["failed"] or not factor > 0.0:
        return "."
    if not math.isfinite(factor):
        return "; no blast of this form would make one slip."
    at = ", ".join(
        f"{1e3 * factor * max(v for v in r['simulated']['ppv'] if math.isfinite(v)):.3g} mm/s at "
        f"{name}"
        for name, r in receivers.items()
    )
    return f"; the first remaining one would at {factor:.3g} times this blast, {at}."


def best_candidates(survey):
    """Return rows of the table of candidates: best receivers, all blasts, receivers left out."""
    kinds = {
        kind: [row for row in survey["candidates"] if row["kind"] == kind]
        for kind in ("receiver", "blast", "without")
    }
    more = sorted(kinds["receiver"][:SHOWN] + kinds["blast"], key=lambda row: -row["gain"])
    return more + kinds["without"]


def survey_lines(survey) -> list[str]:
    """Return sentences on trade-offs, parameters that are not identifiable, and candidates."""
    lines = [
        f"{row['first']} and {row['second']} trade off: their posterior correlation is "
        f"{row['correlation']:+.2f}"
        for row in survey["trade_offs"]
    ]
    lines += [
        f"{row['path']}: not identifiable: {row['why']}"
        for row in survey["parameters"]
        if row["why"]
    ]
    more = [row for row in survey["candidates"] if row["kind"] != "without"]
    if more:
        best = more[0]
        kind = "a receiver at " if best["position"] is not None else "the blast "
        worst = (
            f" and the largest ratio, that of {best['worst_path']}, from {survey['worst']:.2f} to "
            f"{best['worst']:.2f}"
            if best["worst_path"] == survey["worst_path"]
            else f"; the largest ratio is then {best['worst']:.2f}, that of {best['worst_path']}"
        )
        lines.append(
            f"{kind}{best['name']} would add most information: it lowers ln det of the covariance "
            f"by {best['gain']:.2g}{worst}"
        )
    if survey["candidates"]:
        lines.append(
            "ln det is that of the posterior covariance of all parameters: a decrease by 1.4 "
            "halves the volume of their joint confidence region"
        )
    if not survey["gridded"]:
        lines.append(
            "only receivers of the project are candidates: no point of "
            "back_analysis.candidate_grid counts: on the surface, outside of the absorbing layer, "
            "far from the sources, where the mesh carries the band, and "
            f"at least {survey['apart']:.0f} m (half a wavelength of S) from every receiver"
        )
    if survey["mesh_error_missing"]:
        lines.append(survey["mesh_error_missing"])
    return lines + survey["uncertain"]


def beside_laboratory(row) -> str:
    """Return how the 90 % interval of a parameter compares with its laboratory range."""
    if row["laboratory"] is None or row["unidentifiable"] or row["within"] is None:
        return ""
    low, high = row["laboratory"]
    if row["within"][1] < low:
        return "below the laboratory range"
    if row["within"][0] > high:
        return "above the laboratory range"
    return (
        "within the laboratory range"
        if low <= row["best"] <= high
        else "not distinguishable from the laboratory range"
    )


def write_survey_report(path, summary):
    """Write the page of a survey design.

    Parameters
    ----------
    path : path
    summary : dict
        ``plan`` of `summarise_survey`, title, blasts, provenance.
    """
    title, caption, image = survey_figure(summary["plan"])
    text = page("survey_design.html").render(
        s=plain(summary), candidates=plain(best_candidates(summary["plan"])),
        lines=survey_lines(summary["plan"]),
        figures=[{"title": title, "caption": caption, "image": image}],
    )  # fmt: skip
    write_text(path, text)


def survey_figure(survey):
    """Return title, caption and image: posterior/prior ratios and gains of candidates."""
    caption = "Ratio of posterior to prior standard deviation of each parameter."
    if any(row["kind"] == "receiver" for row in survey["candidates"]):
        caption = (
            f"Left: {caption[0].lower()}{caption[1:]} Right: gain of information by one more "
            "receiver; the circle marks the best candidate, black dots the present receivers."
        )
    return "Identifiability of the parameters", caption, ratios_figure(survey)


def ratios_figure(survey) -> dict:
    """Return the plot of posterior/prior ratios, and of the gains of candidate receivers.

    Parameters
    ----------
    survey : dict
        Of `summarise_survey`.
    """
    rows = survey["parameters"]
    height = np.arange(len(rows))[::-1]
    none, whole = np.zeros(len(rows)), np.ones(len(rows))
    ratios = [0.0 if row["why"] else row["ratio"] for row in rows]
    words = [row["constraint"] if row["why"] else f"{row['ratio']:.2f} {row['constraint']}"
             for row in rows]  # fmt: skip
    named = dict(zip(height.tolist(), (row["path"] for row in rows), strict=True))
    bars = panel(
        axis_of("posterior / prior standard deviation", 0.0, 1.0),
        axis_of("", -0.6, len(rows) - 0.4, ticks=named),
        [segments(none, height, whole, height, "prior", RANGE, width=18),
         segments(none, height, ratios, height, "posterior", SIMULATED, width=18, text=words)],
        80 + 38 * len(rows),
    )  # fmt: skip
    candidates = [row for row in survey["candidates"] if row["kind"] == "receiver"]
    panels = [bars, _map(survey, candidates)] if candidates else [bars]
    return page_plot("Identifiability of the parameters.", *panels, columns=len(panels))


def _map(survey, candidates):
    """Return the map of candidate receivers, coloured by their gain."""
    x, y, gain = np.array([[*row["position"][:2], row["gain"]] for row in candidates]).T
    best, present = int(np.argmax(gain)), survey["receivers"]
    east, north = np.array([row["position"][:2] for row in present]).reshape(-1, 2).T
    marks = [
        dots(x, y, values=gain, radius=6, text=[row["name"] for row in candidates], quiet=True),
        dots(x[best], y[best], "best candidate", SIMULATED, ring=True, radius=10),
        dots(east, north, "receiver", INK, text=[row["name"] for row in present]),
    ]
    scale = {"label": "decrease of ln det", "low": 0.0, "high": gain.max(), "colours": GAIN}
    return panel(axis_of("east [m]"), axis_of("north [m]"), marks, equal=True, scale=scale)


def result_figures(survey, points, misfits):
    """Yield title, caption and image: result within the ranges, and the main trade-off."""
    yield (
        "The result within its ranges",
        "Best values with their 90 % intervals in the searched ranges, beside the laboratory "
        "ranges. Where the records constrain a parameter little, its interval lies towards the "
        "middle of the range and extends to the best value.",
        ranges_figure(survey),
    )
    pair = trade_pair(survey)
    if pair is not None:
        yield (
            "Trade-off between parameters",
            _trade_caption(survey, pair),
            trade_off_figure(survey, pair, points, misfits),
        )


def trade_pair(survey):
    """Return which two parameters the figure of trade-offs shows, or None.

    Shear stiffness and damping where both are parameters, else the strongest trade-off.
    """
    rows = survey["parameters"]
    path = [row["path"] for row in rows]
    stiff = [k for k, name in enumerate(path) if ".ks_" in name and not rows[k]["why"]]
    if stiff and DAMPING in path and not rows[path.index(DAMPING)]["why"]:
        return stiff[0], path.index(DAMPING)
    for row in survey["trade_offs"]:
        return path.index(row["first"]), path.index(row["second"])
    return None


def _trade_caption(survey, pair):
    """Return the caption of a trade-off."""
    first, second = (survey["parameters"][k] for k in pair)
    rho = np.array(survey["covariance"])[pair] / (first["ratio"] * second["ratio"])
    ends = "{0[within][0]:.3g} to {0[within][1]:.3g}"
    text = (
        f"90 % intervals: {first['path']} {ends.format(first)}, {second['path']} "
        f"{ends.format(second)}; posterior correlation {rho:+.2f}. Dark runs fit better."
    )
    if DAMPING in (first["path"], second["path"]):
        text += (
            " Stiffness and damping both weaken high frequencies: a low damping ratio does not "
            "prove a realistic model while another pair within the ellipse fits as well."
        )
    return text


def trade_off_figure(survey, pair, points, misfits):
    """Return the plot of the trade-off of two parameters within their ranges.

    Parameters
    ----------
    survey : dict
        Of `summarise_survey`.
    pair : tuple of 2 int
        Numbers of the parameters: horizontal, vertical axis.
    points : (n, n_parameters) float64
        Of the runs.
    misfits : (n,) float64
    """
    rows = [survey["parameters"][k] for k in pair]
    shown = np.isfinite(misfits) & (misfits > 0.0)
    size = np.log10(misfits[shown])
    edge, (x, y) = ellipse(survey, pair), points[shown][:, list(pair)].T
    marks = [
        line(edge[0], edge[1], "90 % region", SIMULATED),
        dots(x, y, "runs", values=size, radius=5),
        dots(rows[0]["value"], rows[1]["value"], "best", SIMULATED, radius=6),
    ]
    low, high = (size.min(), size.max()) if len(size) else (0.0, 1.0)
    scale = {"label": "log10 misfit", "low": low, "high": high, "colours": "greys"}
    across, upright = (
        axis_of(row["path"], row["low"], row["high"], log=row["log"]) for row in rows
    )
    drawn = panel(across, upright, marks, 400, scale=scale)
    return page_plot("Trade-off of two parameters.", drawn)


def ellipse(survey, pair):
    """Return the edge of the 90 % region of two parameters, (2, n), clipped to their ranges."""
    rows = [survey["parameters"][k] for k in pair]
    part = UNIFORM**2 * np.array(survey["covariance"])[np.ix_(pair, pair)]
    turn = np.linspace(0.0, 2.0 * np.pi, 181)
    circle = INSIDE_90 * np.stack([np.cos(turn), np.sin(turn)])
    covariance = np.array(survey["covariance"])
    best = np.array([_unit(row, row["value"]) for row in survey["parameters"]])
    unit = (0.5 + (np.eye(len(best)) - covariance) @ (best - 0.5))[list(pair)]
    edge = unit[:, None] + np.linalg.cholesky(part) @ circle
    edge = np.clip(edge, 0.0, 1.0)
    return np.array([_value(row, line) for row, line in zip(rows, edge, strict=True)])


def ranges_figure(survey):
    """Draw each result within its range, beside the laboratory range.

    Parameters
    ----------
    survey : dict
        Of `summarise_survey`.
    """
    rows = survey["parameters"]
    figure = _figure(9.6, 1.1 + 0.5 * len(rows))
    axis = figure.subplots()
    for y, row in zip(np.arange(len(rows))[::-1], rows, strict=True):
        axis.barh(y, 1.0, color=RANGE, height=0.6, label="searched" if row is rows[0] else None)
        for end, side, x in (("low", "left", 0.0), ("high", "right", 1.0)):
            axis.text(x, y + 0.31, _short(row[end]), fontsize=7, va="bottom", ha=side)
        if row["laboratory"] is not None:
            ends = np.clip([_unit(row, value) for value in row["laboratory"]],
                           -BEYOND, 1.0 + BEYOND)  # fmt: skip
            axis.plot(ends, [y - 0.15] * 2, color=LABORATORY, lw=5, solid_capstyle="butt")
        if not row["why"]:
            ends = [_unit(row, value) for value in row["within"]]
            axis.plot(ends, [y + 0.1] * 2, color=SIMULATED, lw=2)
            best = _unit(row, row["value"])
            axis.plot(best, y + 0.1, "o", color=SIMULATED, ms=6)
            axis.text(best, y - 0.08, _short(row["value"]), fontsize=7, va="top", ha="center")
    axis.plot([], [], color=SIMULATED, marker="o", lw=2, label="best, with 90 % interval")
    if any(row["laboratory"] is not None for row in rows):
        axis.plot([], [], color=LABORATORY, lw=5, label="laboratory")
    axis.set_yticks(np.arange(len(rows))[::-1], [row["path"] for row in rows])
    axis.set_xlim(-BEYOND, 1.0 + BEYOND)
    axis.set_ylim(-0.6, len(rows) - 0.2)
    axis.set_xticks([0.0, 1.0], ["lowest", "highest value searched"])
    axis.legend(fontsize=7, frameon=False, ncol=3, loc="lower right", bbox_to_anchor=(1.0, 1.0))
    _tidy(axis)
    axis.grid(False)
    return _uri(figure)


def _unit(row, value):
    """Return a value in shares of its range; far below 0 where it has no logarithm."""
    if not row["log"]:
        return (value - row["low"]) / (row["high"] - row["low"])
    return np.log(max(value, 1e-12) / row["low"]) / np.log(row["high"] / row["low"])


def _value(row, unit):
    """Return the values at shares of a range."""
    if not row["log"]:
        return row["low"] + unit * (row["high"] - row["low"])
    return row["low"] * (row["high"] / row["low"]) ** unit
