"""The report of a back-analysis: what was found, how well it fits, what it can't tell."""

import math

import numpy as np

from ..projects.result import plain, write_text
from . import figures
from .report import page
from .search_figures import misfit_figure, places_figure

SPECTRUM_TOP = 40.0


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
    table = plain(summary)
    drawn = [*_search_figures(summary), *_motion_figures(confirmed)]
    text = page("search.html").render(
        s=table,
        slip=[line for name, one in summary["blasts"].items() for line in slip_lines(name, one)],
        figures=[dict(zip(("title", "caption", "image"), row, strict=True)) for row in drawn],
    )
    write_text(path, text)


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


def _search_figures(summary):
    """Draw how the search went."""
    trace = {name: np.array(value) for name, value in summary["trace"].items()}
    unit = summary["misfit_unit"]
    yield (
        "Misfit",
        f"Misfit of each run; method '{summary['method']}', seed {summary['seed']}. The search "
        f"went on from {summary['accepted']} of {summary['runs']}.",
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
                "and smoothed amplitude spectrum (figures 7 to 9).",
                figures.motion_figure(
                    both, [figures.RECORDED, figures.SIMULATED], SPECTRUM_TOP,
                    float(one.simulated[name].times[-1]),
                ),
            )  # fmt: skip
