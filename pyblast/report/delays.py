"""Report of a delay optimisation: peaks at houses, evaluated delays, firing times."""

import numpy as np

from ..blasts.blast import CHARGE_WINDOW
from ..project.result import plain, write_text
from ..units import plain_number
from .figures import INK, SIMULATED, _figure, _tidy, _uri
from .run import page


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
        f"best of {len(table['tried'])} plans at {band}: {1e3 * best['between_holes']:.3g} ms "
        f"between holes, {1e3 * best['between_rows']:.3g} ms between rows",
        f"{100 * table['share']:.3g} % quantile of the largest PPV over its limit: "
        f"{gained['after']:.3g}, as planned {gained['before']:.3g}; reduction "
        f"{100 * gained['reduction']:.3g} %, 90 % interval {100 * low:.3g} to {100 * high:.3g} %",
    ]
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
            )
    return lines


def _curve(house):
    """Return the curve of a limit, and whether it was verified against the standard."""
    if house["curve"] is None:
        return ""
    verified = "" if house["curve_verified"] else ", not verified"
    return f" ({house['curve']}{verified}, its lowest value in the band)"


PLANNED, LIMIT, SEVERITY = "#5b6570", "#b91c1c", "viridis"
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


def charges_figure(summary):
    """Draw the charge in each 8 ms after the first firing, as planned and with the best delays."""
    figure = _figure(8.6, 3.2)
    axis = figure.subplots()
    for name, words, colour in (("before", "as planned", PLANNED),
                                ("after", "best delays", SIMULATED)):  # fmt: skip
        starts, charges = np.array(summary["charge_histogram"][name]).T
        axis.stairs(charges, 1e3 * np.append(starts, starts[-1] + CHARGE_WINDOW), color=colour,
                    fill=name == "before", alpha=0.45 if name == "before" else 1.0,
                    lw=1.4, label=words)  # fmt: skip
    allowed = summary["charge_per_8ms_kg"]["allowed"]
    if allowed is not None:
        axis.axhline(allowed, color=LIMIT, lw=1.4, label="largest allowed")
    axis.set_xlabel("time after the first firing [ms]")
    axis.set_ylabel("charge in 8 ms [kg]")
    axis.set_ylim(bottom=0.0)
    axis.legend(fontsize=7, frameon=False, ncol=3, loc="lower right", bbox_to_anchor=(1.0, 1.0))
    _tidy(axis)
    return _uri(figure)


def houses_figure(summary):
    """Draw the bands of peaks at each house, as planned and with the best delays."""
    houses = summary["houses"]
    figure = _figure(8.6, 0.9 + 0.8 * len(houses))
    axis = figure.subplots()
    for row, house in zip(np.arange(len(houses))[::-1], houses, strict=True):
        for name, words, colour, up in (("before", "as planned", PLANNED, 0.17),
                                        ("after", "best delays", SIMULATED, -0.17)):  # fmt: skip
            for share, width in WIDTHS.items():
                ends = 1e3 * np.array(house[name]["bands"][share])
                axis.plot(ends, [row + up] * 2, color=colour, lw=width, alpha=0.45,
                          solid_capstyle="butt")  # fmt: skip
            axis.plot(1e3 * house[name]["levels"]["0.5"], row + up, "o", color=colour, ms=5,
                      label=words if row == 0 else None)  # fmt: skip
        axis.plot([1e3 * house["limit"]] * 2, [row - 0.4, row + 0.4], color=LIMIT, lw=1.6,
                  label="limit" if row == 0 else None)  # fmt: skip
    axis.set_yticks(np.arange(len(houses))[::-1], [house["name"] for house in houses])
    axis.set_ylim(-0.6, len(houses) - 0.3)
    axis.set_xlim(left=0.0)
    axis.set_xlabel("PPV [mm/s]")
    axis.legend(fontsize=7, frameon=False, ncol=3, loc="lower right", bbox_to_anchor=(1.0, 1.0))
    _tidy(axis)
    return _uri(figure)


def tried_figure(summary):
    """Draw all evaluated plans over their delays."""
    holes, rows, severity = np.array(summary["tried"]).T
    figure = _figure(7.4, 4.2)
    axis = figure.subplots()
    drawn = axis.scatter(1e3 * holes, 1e3 * rows, c=severity, s=26, cmap=SEVERITY)
    best = summary["delays_s"]
    axis.scatter(1e3 * best["between_holes"], 1e3 * best["between_rows"], s=150, facecolors="none",
                 edgecolors=INK, lw=1.6, label="best")  # fmt: skip
    axis.legend(fontsize=7, frameon=False, loc="lower right", bbox_to_anchor=(1.0, 1.0))
    axis.set_xlabel("delay between holes [ms]")
    axis.set_ylabel("delay between rows [ms]")
    axis.margins(0.06)
    figure.colorbar(drawn, ax=axis, label="largest PPV over its limit", shrink=0.9)
    _tidy(axis)
    return _uri(figure)
