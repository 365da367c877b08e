"""Figures of what records can tell: shares, places that would help, trade-offs, ranges."""

import numpy as np
from matplotlib.patches import Rectangle

from .figures import INK, SIMULATED, _figure, _short, _tidy, _uri

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
    axis.add_patch(Rectangle(low, *(high - low), color=RANGE, alpha=0.5, lw=0, zorder=0))
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
