"""The page of a plan, and what the page of a back-analysis shows of one."""

import numpy as np

from ..projects.result import plain, write_text
from .plan_figures import ranges_figure, shares_figure, trade_off_figure
from .plan_words import best_extras, told_lines
from .report import page

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


def write_plan_report(path, summary):
    """Write the page of a plan, as `summarise_plan` and its title say it."""
    title, caption, image = plan_figure(summary["plan"])
    text = page("plan.html").render(
        s=plain(summary), extras=plain(best_extras(summary["plan"])),
        lines=told_lines(summary["plan"]),
        figures=[{"title": title, "caption": caption, "image": image}],
    )  # fmt: skip
    write_text(path, text)
