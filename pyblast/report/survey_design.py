"""Report of a survey design: information of receivers and blasts, trade-offs, figures."""

import math
from dataclasses import asdict

import numpy as np
from matplotlib.patches import Rectangle

from ..back_analysis.parameters import range_of
from ..project.result import plain, write_text
from .figures import INK, SIMULATED, _figure, _short, _tidy, _uri
from .html import page

RANGE, LABORATORY, HELPS = "#d8dde3", "#2563eb", "viridis"
INSIDE_90 = 2.1459660262893472  # of a normal density in the plane, in standard deviations
UNIFORM = 1.0 / np.sqrt(12.0)
BEYOND = 0.35  # of a range: how far the laboratory's values are drawn outside of it


def shares_figure(plan):
    """Draw what is left of each range, and what receivers elsewhere would add.

    Parameters
    ----------
    plan : dict
        Of `summarise_plan`.
    """
    rows = plan["parameters"]
    places = [one for one in plan["extras"] if one["kind"] == "receiver"]
    figure = _figure(9.6, max(2.6, 0.8 + 0.4 * len(rows)) if not places else 3.6)
    axes = figure.subplots(1, 2 if places else 1, squeeze=False)[0]
    left, place = axes[0], np.arange(len(rows))[::-1]
    left.barh(place, [1.0] * len(rows), color=RANGE, height=0.6)
    told = [0.0 if one["why"] else one["share"] for one in rows]
    left.barh(place, told, color=SIMULATED, height=0.6)
    for y, one in zip(place, rows, strict=True):
        text = one["verdict"] if one["why"] else f"{one['share']:.2f}  {one['verdict']}"
        left.text(0.98, y, text, ha="right", va="center", fontsize=8, color=INK)
    left.set_yticks(place, [one["path"] for one in rows])
    left.set_xlim(0.0, 1.0)
    left.set_xlabel("standard deviation after over before")
    _tidy(left)
    left.grid(False)
    if places:
        _map(figure, axes[1], plan, places)
    return _uri(figure)


def _map(figure, axis, plan, places):
    """Draw candidates from above, coloured by what they would bring."""
    x, y, gain = np.array([[*one["position"][:2], one["gain"]] for one in places]).T
    drawn = axis.scatter(x, y, c=gain, s=60, cmap=HELPS, vmin=0.0, edgecolors="white", lw=0.5)
    best = int(np.argmax(gain))
    axis.scatter(x[best], y[best], s=170, facecolors="none", edgecolors=SIMULATED, lw=1.6)
    for one in plan["receivers"]:
        axis.plot(*one["position"][:2], "^", color=INK, ms=8)
        axis.annotate(
            one["name"], one["position"][:2], xytext=(0, 7), textcoords="offset points",
            ha="center", fontsize=7, color=INK,
        )  # fmt: skip
    axis.margins(0.12)
    axis.set_aspect("equal", adjustable="datalim")
    axis.set_xlabel("east  m")
    axis.set_ylabel("north  m")
    figure.colorbar(drawn, ax=axis, label="ln det falls by", shrink=0.85)
    _tidy(axis)


def trade_off_figure(plan, pair, points, misfits):
    """Draw how two unknowns make up for one another within their ranges.

    Parameters
    ----------
    plan : dict
        Of `summarise_plan`.
    pair : tuple of 2 int
        Numbers of the parameters: across, upwards.
    points : (n, n_parameters) float64
        That were run.
    misfits : (n,) float64
        In which these are shaded.
    """
    figure = _figure(6.4, 4.2)
    axis = figure.subplots()
    rows = [plan["parameters"][k] for k in pair]
    low, high = (np.array([one[end] for one in rows]) for end in ("low", "high"))
    axis.add_patch(
        Rectangle((low[0], low[1]), *(high - low), color=RANGE, alpha=0.5, lw=0, zorder=0)
    )
    edge = ellipse(plan, pair)
    axis.plot(*edge, color=SIMULATED, lw=1.4, label="90 % of what is left")
    shown = np.isfinite(misfits) & (misfits > 0.0)
    drawn = axis.scatter(
        *points[shown][:, list(pair)].T, c=np.log10(misfits[shown]), cmap="Greys_r", s=18,
        edgecolors=INK, lw=0.3, zorder=3, label="runs",
    )  # fmt: skip
    axis.plot(*(one["value"] for one in rows), "o", color=SIMULATED, ms=7, zorder=4, label="found")
    for one, name in zip(rows, ("x", "y"), strict=True):
        getattr(axis, f"set_{name}scale")("log" if one["log"] else "linear")
        getattr(axis, f"set_{name}label")(one["path"], fontsize=8)
    axis.legend(fontsize=7, frameon=False, loc="upper left", bbox_to_anchor=(0.0, 1.1), ncol=3)
    figure.colorbar(drawn, ax=axis, label="log10 misfit", shrink=0.85)
    _tidy(axis)
    return _uri(figure)


def ellipse(plan, pair):
    """Return the edge of what is left of two unknowns, (2, n), cut at their ranges."""
    rows = [plan["parameters"][k] for k in pair]
    part = UNIFORM**2 * np.array(plan["covariance"])[np.ix_(pair, pair)]
    turn = np.linspace(0.0, 2.0 * np.pi, 181)
    circle = INSIDE_90 * np.stack([np.cos(turn), np.sin(turn)])
    covariance = np.array(plan["covariance"])
    found = np.array([_unit(one, one["value"]) for one in plan["parameters"]])
    unit = (0.5 + (np.eye(len(found)) - covariance) @ (found - 0.5))[list(pair)]
    edge = unit[:, None] + np.linalg.cholesky(part) @ circle
    edge = np.clip(edge, 0.0, 1.0)
    return np.array([_value(one, line) for one, line in zip(rows, edge, strict=True)])


def ranges_figure(plan):
    """Draw each result within its range, beside what the laboratory gave.

    Parameters
    ----------
    plan : dict
        Of `summarise_plan`.
    """
    rows = plan["parameters"]
    figure = _figure(9.6, 1.1 + 0.5 * len(rows))
    axis = figure.subplots()
    for y, one in zip(np.arange(len(rows))[::-1], rows, strict=True):
        axis.barh(y, 1.0, color=RANGE, height=0.6, label="searched" if one is rows[0] else None)
        for end, side, place in (("low", "left", 0.0), ("high", "right", 1.0)):
            axis.text(place, y + 0.31, _short(one[end]), fontsize=7, va="bottom", ha=side)
        if one["laboratory"] is not None:
            ends = np.clip([_unit(one, value) for value in one["laboratory"]],
                           -BEYOND, 1.0 + BEYOND)  # fmt: skip
            axis.plot(ends, [y - 0.15] * 2, color=LABORATORY, lw=5, solid_capstyle="butt")
        if not one["why"]:
            ends = [_unit(one, value) for value in one["within"]]
            axis.plot(ends, [y + 0.1] * 2, color=SIMULATED, lw=2)
            axis.plot(_unit(one, one["value"]), y + 0.1, "o", color=SIMULATED, ms=6)
    axis.plot([], [], color=SIMULATED, marker="o", lw=2, label="found, with 90 %")
    if any(one["laboratory"] is not None for one in rows):
        axis.plot([], [], color=LABORATORY, lw=5, label="laboratory")
    axis.set_yticks(np.arange(len(rows))[::-1], [one["path"] for one in rows])
    axis.set_xlim(-BEYOND, 1.0 + BEYOND)
    axis.set_ylim(-0.6, len(rows) - 0.2)
    axis.set_xticks([0.0, 1.0], ["low", "high"])
    axis.legend(fontsize=7, frameon=False, ncol=3, loc="lower right", bbox_to_anchor=(1.0, 1.0))
    _tidy(axis)
    axis.grid(False)
    return _uri(figure)


def _unit(one, value):
    """Return where a value lies in its range, 0 to 1; far below where a logarithm has none."""
    if not one["log"]:
        return (value - one["low"]) / (one["high"] - one["low"])
    return np.log(max(value, 1e-12) / one["low"]) / np.log(one["high"] / one["low"])


def _value(one, unit):
    """Return the values of places in the range."""
    if not one["log"]:
        return one["low"] + unit * (one["high"] - one["low"])
    return one["low"] * (one["high"] / one["low"]) ** unit


def slip_lines(name, blast):
    """Say of each joint surface of a blast what slipped, and how much stronger it would take.

    Parameters
    ----------
    name : str
    blast : dict
        ``strength`` and ``receivers`` of a summary.
    """
    for surface, one in blast["strength"].items():
        yield f"{name}, {surface}: {_slipped(one)}{_first(one, blast['receivers'])}"


def _slipped(one):
    """Say how many contacts slipped or opened."""
    before = f" ({one['before']} had failed before the blast)" if one["before"] else ""
    if one["failed"]:
        return f"{one['failed']} of {one['contacts']} contacts slipped or opened{before}"
    return f"no contact slipped or opened{before}"


def _first(one, receivers):
    """Say at which peak velocity the first of the contacts that held would give way."""
    factor = one["factor"]
    if one["failed"] or not factor > 0.0:
        return "."
    if not math.isfinite(factor):
        return "; no blast of this form would bring one there."
    at = ", ".join(
        f"{1e3 * factor * max(v for v in r['simulated']['ppv'] if math.isfinite(v)):.3g} mm/s at "
        f"{name}"
        for name, r in receivers.items()
    )
    return f"; the first of those that held would at {factor:.3g} times this blast, {at}."


KINDS = {"paper": "PPV and dominant frequency", "waveform": "waveforms"}
SHOWN = 5  # receivers in tables


def summarise_plan(plan) -> dict:
    """Return everything that pages and tables show of a `Plan`, as plain numbers and words."""
    shares, others = plan.knowledge.shares, plan.other.shares
    return {
        "by": KINDS[plan.misfit],
        "by_other": KINDS["paper" if plan.misfit == "waveform" else "waveform"],
        "band_hz": plan.window.band,
        "noise": plan.noise,
        "levels": plan.levels,
        "mesh_doubt": plan.mesh_doubt,
        "parameters": [
            {
                **range_of(one),
                "value": plan.values[k],
                "share": shares[k],
                "share_other": others[k],
                "verdict": plan.verdict(k),
                "why": plan.why.get(one.name, ""),
                "within": plan.within[k],
            }
            for k, one in enumerate(plan.parameters)
        ],
        "covariance": plan.knowledge.covariance,
        "log_determinant": plan.knowledge.log_determinant,
        "worst": plan.worst.worst,
        "worst_path": plan.worst.worst_path,
        "trade_offs": [
            {"first": first, "second": second, "correlation": rho}
            for first, second, rho in plan.trade_offs
        ],
        "receivers": [asdict(one) for one in plan.places if one.counts],
        "apart": plan.apart,
        "gridded": sum(one.gridded for one in plan.places),
        "extras": [asdict(one) for one in plan.extras],
        "slip": [
            line for name, one in plan.slip.items() for line in slip_lines(name, _slip_table(one))
        ],
    }


def _slip_table(slip):
    """Return what `slip_lines` takes of a blast."""
    strength = {name: asdict(one) for name, one in slip.strength.items()}
    factor = min((one.factor for one in slip.strength.values()), default=np.inf)
    receivers = {name: {"simulated": {"ppv": ppv.tolist()}} for name, ppv in slip.ppv.items()}
    return {"strength": strength, "factor": factor, "receivers": receivers}


def best_extras(plan):
    """Return rows of the table of extras: best receivers, all blasts, all that may be spared."""
    kinds = {
        kind: [one for one in plan["extras"] if one["kind"] == kind]
        for kind in ("receiver", "blast", "without")
    }
    more = sorted(kinds["receiver"][:SHOWN] + kinds["blast"], key=lambda one: -one["gain"])
    return more + kinds["without"]


def summary_lines(plan) -> list[str]:
    """Say what trades off, what can't be told, and what would help most."""
    lines = [
        f"{one['first']} and {one['second']} trade off: the errors of both go together with a "
        f"correlation of {one['correlation']:+.2f}"
        for one in plan["trade_offs"]
    ]
    lines += [
        f"{one['path']}: not identifiable: {one['why']}" for one in plan["parameters"] if one["why"]
    ]
    more = [one for one in plan["extras"] if one["kind"] != "without"]
    if more:
        best = more[0]
        place = "a receiver at " if best["position"] is not None else "the blast "
        worst = (
            f" and leaves {best['worst']:.2f} of the worst known, {best['worst_path']}, instead of "
            f"{plan['worst']:.2f}"
            if best["worst_path"] == plan["worst_path"]
            else f"; the worst known is then {best['worst_path']} with {best['worst']:.2f}"
        )
        lines.append(
            f"most would be learnt from {place}{best['name']}: it lowers ln det of the covariance "
            f"by {best['gain']:.2g}{worst}"
        )
    if plan["extras"]:
        lines.append(
            "ln det is that of the covariance of all unknowns: where it falls by 1.4, the region "
            "in which they lie together has half its size"
        )
    if not plan["gridded"]:
        lines.append(
            "no receiver was tried but those of the project: no place of "
            "back_analysis.candidate_grid lies on the surface, outside of the absorbing layer and "
            "at least "
            f"{plan['apart']:.0f} m (half a wavelength of S) from every receiver"
        )
    if plan["mesh_doubt"]:
        lines.append(plan["mesh_doubt"])
    return lines


def beside_laboratory(one) -> str:
    """Say where a value lies against those of the laboratory."""
    if one["laboratory"] is None or one["why"]:
        return ""
    low, high = one["laboratory"]
    if one["within"][1] < low:
        return "below the laboratory"
    if one["within"][0] > high:
        return "above the laboratory"
    return "as in the laboratory" if low <= one["value"] <= high else "not told apart from it"


DAMPING = "damping.ratio"


def trade_pair(plan):
    """Return which two parameters a picture of trade-offs shows, or None.

    Shear stiffness and damping where both are asked for, else the pair that trades off most.
    """
    rows = plan["parameters"]
    path = [one["path"] for one in rows]
    stiff = [k for k, one in enumerate(path) if ".ks_" in one and not rows[k]["why"]]
    if stiff and DAMPING in path and not rows[path.index(DAMPING)]["why"]:
        return stiff[0], path.index(DAMPING)
    for one in plan["trade_offs"]:
        return path.index(one["first"]), path.index(one["second"])
    return None


def found_figures(plan, points, misfits):
    """Draw the result within its ranges, and the trade-off that matters most."""
    yield (
        "The result within its ranges",
        "Found values with the interval that holds 90 % of what the records leave, in the ranges "
        "that were searched, beside what the laboratory gave. Where records tell little, intervals "
        "lie towards the middle of the range, and reach to what was found.",
        ranges_figure(plan),
    )
    pair = trade_pair(plan)
    if pair is not None:
        yield (
            "What makes up for what",
            _trade_caption(plan, pair),
            trade_off_figure(plan, pair, points, misfits),
        )


def _trade_caption(plan, pair):
    """Say what a trade-off means for the reader."""
    first, second = (plan["parameters"][k] for k in pair)
    rho = np.array(plan["covariance"])[pair] / (first["share"] * second["share"])
    ends = "{0[within][0]:.3g} and {0[within][1]:.3g}"
    text = (
        f"The records leave {first['path']} between {ends.format(first)} and {second['path']} "
        f"between {ends.format(second)}; their errors have a correlation of {rho:+.2f}. Runs are "
        "darker where they fit better."
    )
    if DAMPING in (first["path"], second["path"]):
        text += (
            " Stiffness and damping both weaken high frequencies: a low damping ratio is no proof "
            "of a realistic model while another pair within the line fits as well."
        )
    return text


def plan_figure(plan):
    """Draw what is left of the ranges and where another receiver would help."""
    caption = "Standard deviation of each unknown after the records over that of its range."
    if any(one["kind"] == "receiver" for one in plan["extras"]):
        caption = (
            f"Left: {caption[0].lower()}{caption[1:]} Right: what one more receiver would add; the "
            "best place is ringed, triangles are receivers that there are."
        )
    return "What the records can tell", caption, shares_figure(plan)


def write_survey_report(path, summary):
    """Write the page of a plan, as `summarise_plan` and its title say it."""
    title, caption, image = plan_figure(summary["plan"])
    text = page("survey_design.html").render(
        s=plain(summary), extras=plain(best_extras(summary["plan"])),
        lines=summary_lines(summary["plan"]),
        figures=[{"title": title, "caption": caption, "image": image}],
    )  # fmt: skip
    write_text(path, text)
