"""Report of a delay optimisation: peaks at houses, evaluated delays, firing times."""

import numpy as np

from ..blasts.blast import CHARGE_WINDOW
from ..files import plain, write_text
from ..units import plain_number
from .pages import page
from .plots import INK, SIMULATED, axis_of, dots, line, page_plot, panel, segments


def delay_lines(table) -> list[str]:
    """Return sentences on the best delays, their gain and the peaks at the houses.

    Parameters
    ----------
    table : dict
        Of `summarise_delays`.
    """
    best, gained = table["delays_s"], table["severity"]
    band = "all frequencies" if table["band_hz"] is None else "{:g} to {:g} Hz".format(
        *table["band_hz"]
    )  # fmt: skip
    low, high = gained["reduction_90"]
    lines = [
        limits_kept(table["houses"]),
        f"best of {len(table['tried'])} plans at {band}: {1e3 * best['between_holes']:.3g} ms "
        f"between holes, {1e3 * best['between_rows']:.3g} ms between rows",
        f"{100 * table['share']:.3g} % quantile of the largest PPV over its limit: "
        f"{gained['after']:.3g}, as planned {gained['before']:.3g}; reduction "
        f"{100 * gained['reduction']:.3g} %, 90 % interval {100 * low:.3g} to {100 * high:.3g} % "
        "for holes of one waveform; of sums of real hits 20 to 33 % that were predicted were 23 % "
        "in the median and 8 % at the 90 % level",
    ]
    if table["burden_m"]:
        lines.append(
            f"rows: {1e3 * best['between_rows'] / table['burden_m']:.3g} ms per m of burden; a "
            "shorter delay gives the rock in front less time to move (relief), which is not judged"
        )
    charge = table["charge_per_8ms_kg"]
    if charge["after"] is not None:
        allowed = charge["allowed"]
        lines.append(
            f"largest charge in any 8 ms: {plain_number(charge['after'])} kg, as planned "
            f"{plain_number(charge['before'])} kg"
            + ("" if allowed is None else f"; allowed {plain_number(allowed)} kg")
        )
    for house in table["houses"]:
        lines.append(f"{house['name']}: limit {1e3 * house['limit']:.3g} mm/s{_curve(house)}")
        for name, words in (("before", "as planned"), ("after", "best delays")):
            peaks = house[name]
            levels = " ".join(f"{1e3 * level:.3g}" for level in peaks["levels"].values())
            bands = ", ".join(
                f"{1e3 * least:.3g} to {1e3 * most:.3g}" for least, most in peaks["bands"].values()
            )
            lines.append(
                f"  {words}: 50, 90, 95 % quantiles of PPV {levels} mm/s; central 50, 90, 95 % of "
                f"blasts {bands} mm/s; {100 * peaks['within_limit']:.3g} % within the limit"
                f"{_level(house, peaks)}"
            )
    return lines


def limits_kept(houses) -> str:
    """Return whether the best plan keeps all limits at 95 %, with the house that decides.

    Parameters
    ----------
    houses : sequence of dict
        Of `summarise_delays`.
    """
    worst = max(houses, key=lambda house: house["after"]["high"] / house["limit"])
    reached = f"{1e3 * worst['after']['high']:.3g} of {1e3 * worst['limit']:.3g} mm/s"
    at = f"{worst['name']}, where 95 % of blasts stay below {reached}{_by(worst)}"
    if worst["after"]["high"] <= worst["limit"]:
        return f"the best plan keeps the limits, nearest at {at}"
    return f"no plan keeps the limit at {at}"


def _by(house):
    """Return which law sets the level of a house, in words."""
    return f" by {house['level_by']}" if house["level_by"] else ""


def _level(house, peaks):
    """Return that shares within a limit hold the error of the level, in words."""
    if not house["level_by"]:
        return ""
    return f" with the error of the level{_by(house)}, 95 % below {1e3 * peaks['high']:.3g} mm/s"


def _curve(house):
    """Return the curve of a limit, and whether it was verified against the standard."""
    if house["curve"] is None:
        return ""
    verified = "" if house["curve_verified"] else ", not verified"
    return f" ({house['curve']}{verified}, its lowest value in the band)"


LIMIT = "#b91c1c"
KINDS = ("before", "as planned", "#5b6570"), ("after", "best delays", SIMULATED)
WIDTHS = {"0.95": 3.0, "0.9": 7.0, "0.5": 12.0}  # of the bars of these shares of blasts


def write_delay_report(path, summary):
    """Write the page of a delay optimisation, from `summarise_delays`."""
    summary = plain(summary)
    text = page("delays.html").render(
        s=summary, lines=delay_lines(summary),
        figures=[
            {"title": title, "caption": caption, "image": image}
            for title, caption, image in _figures(summary)
        ],
    )  # fmt: skip
    write_text(path, text)


def _figures(summary):
    """Yield title, caption and image of each figure."""
    yield (
        "Peaks at the houses",
        "Central 50, 90 and 95 % of the simulated blasts, thick to thin; the dot is the median, "
        "the red line the limit. The search did not use these draws.",
        houses_figure(summary),
    )
    yield (
        "Evaluated delays",
        f"Each dot is a plan, coloured by the {100 * summary['share']:.3g} % quantile of the "
        "largest PPV over its limit, from few draws; the circle marks the best. In a broad dark "
        "region the result is robust to firing-time scatter, in a narrow one it is not.",
        tried_figure(summary),
    )
    if summary["charge_per_8ms_kg"]["after"] is not None:
        yield (
            "Charge in 8 ms",
            "Charge of each 8 ms after the first firing. These bins stand still; the largest "
            "charge in any 8 ms, which the constraint limits, is at or above the highest.",
            charges_figure(summary),
        )


def charges_figure(summary) -> dict:
    """Return the plot of charges in each 8 ms after the first firing."""
    marks = []
    for name, words, colour in KINDS:
        starts, charges = np.array(summary["charge_histogram"][name]).T
        edges = np.repeat(np.append(starts, starts[-1] + CHARGE_WINDOW), 2)[1:-1]
        marks.append(line(1e3 * edges, np.repeat(charges, 2), words, colour,
                          fill=name == "before"))  # fmt: skip
    allowed, across = summary["charge_per_8ms_kg"]["allowed"], axis_of("time after firing [ms]")
    if allowed is not None:
        ends = [min(mark["x"][0] for mark in marks), max(mark["x"][-1] for mark in marks)]
        marks.append(line(ends, [allowed] * 2, "largest allowed", LIMIT))
    upright = axis_of("charge in 8 ms [kg]", 0.0)
    return page_plot("Charge in each 8 ms.", panel(across, upright, marks, 280))


def houses_figure(summary) -> dict:
    """Return the plot of the bands of peaks at each house, as planned and with the best delays."""
    houses, marks = summary["houses"], []
    row = np.arange(len(houses))[::-1]
    for (name, words, colour), up in zip(KINDS, (0.17, -0.17), strict=True):
        for share, width in WIDTHS.items():
            low, high = 1e3 * np.array([house[name]["bands"][share] for house in houses]).T
            marks.append(segments(low, row + up, high, row + up, None, colour, width=width,
                                  opacity=0.45))  # fmt: skip
        median = [1e3 * house[name]["levels"]["0.5"] for house in houses]
        marks.append(dots(median, row + up, words, colour))
    limit = [1e3 * house["limit"] for house in houses]
    marks.append(segments(limit, row - 0.4, limit, row + 0.4, "limit", LIMIT))
    named = dict(zip(row.tolist(), (house["name"] for house in houses), strict=True))
    upright = axis_of("", -0.6, len(houses) - 0.3, ticks=named)
    height = 90 + 80 * len(houses)
    return page_plot(
        "Peaks at the houses.", panel(axis_of("PPV [mm/s]", 0.0), upright, marks, height)
    )


def tried_figure(summary) -> dict:
    """Return the plot of all evaluated plans over their delays."""
    holes, rows, severity = np.array(summary["tried"]).T
    best, words = summary["delays_s"], "largest PPV over its limit"
    marks = [
        dots(1e3 * holes, 1e3 * rows, values=severity, radius=5),
        dots(1e3 * best["between_holes"], 1e3 * best["between_rows"], "best", INK, ring=True,
             radius=9),
    ]  # fmt: skip
    scale = {"label": words, "low": severity.min(), "high": severity.max(), "colours": "viridis"}
    across, upright = axis_of("delay between holes [ms]"), axis_of("delay between rows [ms]")
    return page_plot("Evaluated plans.", panel(across, upright, marks, 380, scale=scale))
