"""The report of a back-analysis: what was found, how well it fits, what it can't tell."""

import numpy as np

from ..projects.result import plain, write_text
from . import figures
from .plan_report import found_figures, plan_figure
from .plan_words import best_extras, told_lines
from .posterior_figures import corner_figure
from .posterior_words import posterior_lines
from .report import page
from .search_figures import misfit_figure, places_figure
from .slip_words import slip_lines

SPECTRUM_TOP = 40.0
JUDGED_ANEW = (
    " All runs are judged by the errors of the theory that stood at the end; trials.jsonl has what "
    "each was worth when it was run."
)


def write_search_report(path, summary, confirmed):
    """Write the page of a back-analysis.

    Parameters
    ----------
    path : path
    summary : dict
        Of `summarise_search`.
    confirmed : dict of str to Confirmed
        Full runs of the best point, by blast.
    """
    plan, trace = summary["plan"], summary["trace"]
    points, misfits = (np.array(trace[name]) for name in ("points", "misfits"))
    drawn = [
        *found_figures(plan, points, misfits),
        *_posterior_figures(summary["posterior"]),
        plan_figure(plan),
        *_search_figures(summary),
        *_motion_figures(confirmed),
    ]
    text = page("search.html").render(
        s=plain(summary),
        laboratory=any(one["laboratory"] is not None for one in summary["parameters"]),
        extras=plain(best_extras(plan)),
        lines=told_lines(plan),
        sure=posterior_lines(summary["posterior"]),
        slip=[line for name, one in summary["blasts"].items() for line in slip_lines(name, one)],
        figures=[dict(zip(("title", "caption", "image"), row, strict=True)) for row in drawn],
    )
    write_text(path, text)


def _posterior_figures(table):
    """Draw the posterior of the unknowns, where there is one that can be told."""
    if table is not None and not table["doubt"]:
        yield (
            "What records and ranges leave",
            f"{len(table['samples'])} draws from the posterior: of each unknown over its range, "
            "with the interval that holds 90 %, and of each pair with the regions that hold 50 "
            "and 90 %.",
            corner_figure(table["parameters"], np.asarray(table["samples"])),
        )


def _search_figures(summary):
    """Draw how the search went."""
    trace = {name: np.array(value) for name, value in summary["trace"].items()}
    unit = summary["misfit_unit"]
    yield (
        "Misfit",
        f"Misfit of each run; method '{summary['method']}', seed {summary['seed']}. The search "
        f"went on from {summary['accepted']} of {summary['runs']}, starts elsewhere included."
        f"{JUDGED_ANEW if summary['misfit_name'] == 'waveform' else ''}",
        misfit_figure(trace["misfits"], trace["accepted"], unit),
    )
    yield (
        "Where the search has been",
        "Misfit against each unknown over its range, later runs darker, the best in colour.",
        places_figure(summary["parameters"], trace["points"], trace["misfits"], unit),
    )


def _motion_figures(confirmed):
    """Draw recorded and simulated motion at the best point (figures 7 to 9)."""
    for blast, one in confirmed.items():
        for name, record in one.recorded.items():
            both = {"recorded": record, "simulated": one.simulated[name]}
            yield (
                f"Receiver {name}",
                f"{blast}, {name}: recorded against simulated at the best point; particle velocity "
                "and smoothed amplitude spectrum.",
                figures.motion_figure(
                    both, [figures.RECORDED, figures.SIMULATED], SPECTRUM_TOP,
                    float(one.simulated[name].times[-1]),
                ),
            )  # fmt: skip
