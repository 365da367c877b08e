"""The page of a plan of delays: what was tried, what houses feel, and when each hole fires."""

import numpy as np

from ..projects.result import plain, write_text
from .delay_words import delay_lines
from .figures import INK, SIMULATED, _figure, _tidy, _uri
from .report import page

PLANNED, LIMIT, SEVERITY = "#5b6570", "#b91c1c", "viridis"
WIDTHS = {"0.95": 3.0, "0.9": 7.0, "0.5": 12.0}  # of the bars that hold so many blasts


def write_delay_report(path, summary):
    """Write the page of a plan of delays, of `summarise_delays`."""
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
        "What 50, 90 and 95 % of drawn blasts lie within, the thinner the more; the dot is the "
        "median, the red line the limit. These draws were not used by the search.",
        houses_figure(summary),
    )
    yield (
        "What was tried",
        f"Each dot is a plan, coloured by the largest PPV over its limit that "
        f"{100 * summary['share']:.3g} % of a few drawn blasts stay below; the best one is ringed. "
        "A broad dark valley forgives detonators that scatter, a narrow one does not.",
        tried_figure(summary),
    )


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
        axis.plot([1e3 * house["limit"]] * 2, [row - 0.4, row + 0.4], color=LIMIT, lw=1.6)
    axis.set_yticks(np.arange(len(houses))[::-1], [house["name"] for house in houses])
    axis.set_ylim(-0.6, len(houses) - 0.3)
    axis.set_xlim(left=0.0)
    axis.set_xlabel("PPV  mm/s")
    axis.legend(fontsize=7, frameon=False, ncol=2, loc="lower right", bbox_to_anchor=(1.0, 1.0))
    _tidy(axis)
    return _uri(figure)


def tried_figure(summary):
    """Draw all plans that were tried, over their delays."""
    holes, rows, severity = np.array(summary["tried"]).T
    figure = _figure(7.4, 4.2)
    axis = figure.subplots()
    drawn = axis.scatter(1e3 * holes, 1e3 * rows, c=severity, s=26, cmap=SEVERITY)
    best = summary["delays_s"]
    axis.scatter(1e3 * best["between_holes"], 1e3 * best["between_rows"], s=150, facecolors="none",
                 edgecolors=INK, lw=1.6)  # fmt: skip
    axis.set_xlabel("between holes  ms")
    axis.set_ylabel("between rows  ms")
    axis.margins(0.06)
    figure.colorbar(drawn, ax=axis, label="largest PPV over its limit", shrink=0.9)
    _tidy(axis)
    return _uri(figure)
