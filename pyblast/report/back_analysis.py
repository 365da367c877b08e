"""Report of a back-analysis: values, what is held, figures."""

import numpy as np

from ..files import plain, write_text
from . import figures
from .pages import page
from .plots import INK, SIMULATED, axis_of, dots, line, page_plot, panel
from .run import with_waveforms
from .survey_design import best_candidates, result_figures, slip_lines, survey_figure, survey_lines

MOST_HELD = 4  # held properties listed for a parameter
LEAST_SHARE = 0.05  # of the variance of a parameter: smaller is not listed


def fit_lines(fit) -> list[str]:
    """Return sentences on a summarised fit: what is held, and what would help; none without one.

    Parameters
    ----------
    fit : dict or None
        Of a summary.
    """
    if fit is None:
        return []
    lines = []
    for row in fit["influences"]:
        strong = [each for each in row["held"][:MOST_HELD] if each["share"] >= LEAST_SHARE]
        if strong:
            best = strong[0]
            listed = ", ".join(f"{each['name']} {100 * each['share']:.0f} %" for each in strong)
            lines.append(
                f"{row['parameter']}: if {best['name']} were measured, its variance would fall by "
                f"{100 * best['share']:.0f} %"
                + (f" (of others: {listed.partition(', ')[2]})" if len(strong) > 1 else "")
                + _wrong_if_known(row["held"])
            )
    lines += [
        f"{first} and {second} trade off: their posterior correlation is {rho:+.2f}"
        for first, second, rho in fit["trade_offs"]
    ]
    strained = [row for row in fit["held"] if abs(row["pull"]) > 2.0]
    lines += [
        f"{row['name']} lies {abs(row['pull']):.1f} prior deviations "
        f"{'above' if row['pull'] > 0 else 'below'} the project file: measure it, or correct it"
        for row in strained
    ]
    lines += [
        f"{name} is taken as known, and intervals do not hold its error: {why}"
        for name, why in fit["taken_as_known"].items()
    ]
    lines.append(
        f"{100 * fit['remaining']:.2g} % of the energy of the records is not explained; error "
        f"learned from the residual: {100 * fit['error_level']:.2g} % of the energy. Intervals "
        "hold errors of the numerical method up to what two programs differ by: 0.6 % in cp, 0.3 % "
        "in cs, 5 % in joint stiffness"
    )
    return lines


def _wrong_if_known(held):
    """Return which held property would move a value most if it were wrong and taken as known."""
    worst = max(held, key=lambda each: abs(each["shift"]))
    return (
        f"; taking what is held for known would move the value most by {worst['name']}: "
        f"{100 * worst['shift']:+.1f} % for one prior deviation"
    )


REJECTED = "#9aa5b1"


def misfit_figure(misfits, accepted, unit) -> dict:
    """Return the plot of the misfit of every run, accepted or rejected, and the best so far.

    Parameters
    ----------
    misfits : (n,) float64
        Not finite where a run failed; not drawn.
    accepted : (n,) bool
    unit : str
    """
    run = np.arange(1, len(misfits) + 1)
    best = np.minimum.accumulate(np.where(np.isfinite(misfits), misfits, np.inf))
    marks = [line(np.repeat(run, 2)[1:], np.repeat(best, 2)[:-1], "best so far", SIMULATED)]
    for shown, colour, name in ((accepted, INK, "accepted"), (~accepted, REJECTED, "rejected")):
        marks.append(dots(run[shown], misfits[shown], name, colour))
    upright = axis_of(f"misfit [{unit}]", 0.0, 1.1 * _largest(misfits))
    return page_plot("Misfit of every run.", panel(axis_of("run"), upright, marks, 280))


def _largest(misfits):
    """Return the largest misfit of the runs that did not fail."""
    return float(np.max(misfits, where=np.isfinite(misfits), initial=0.0))


def points_figure(parameters, points, misfits, unit) -> dict:
    """Return the plot of misfit against each parameter over its range; the best is marked.

    Parameters
    ----------
    parameters : list of dict
        ``path``, ``low``, ``high``, ``log``.
    points : (n, n_parameters) float64
    misfits : (n,) float64
    unit : str
    """
    best, number = int(np.argmin(misfits)), np.arange(1, len(misfits) + 1)
    scale = {"label": "run", "low": 1, "high": len(number), "colours": "darker"}
    upright = axis_of(f"misfit [{unit}]", 0.0, 1.1 * _largest(misfits))
    panels = []
    for row, values in zip(parameters, points.T, strict=True):
        margin = 0.0 if row["log"] else 0.03 * (row["high"] - row["low"])
        across = axis_of(row["path"], row["low"] - margin, row["high"] + margin, log=row["log"])
        marks = [dots(values, misfits, values=number),
                 dots(values[best], misfits[best], "best", SIMULATED, radius=6)]  # fmt: skip
        panels.append(panel(across, upright, marks, 240, scale=scale))
    return page_plot("Misfit against the parameters.", *panels, columns=min(2, len(panels)))


SPECTRUM_TOP = 40.0


def write_search_report(path, summary, confirmed, scene):
    """Write the page of a back-analysis.

    Parameters
    ----------
    path : path
    summary : dict
        Of `summarise_search`.
    confirmed : dict of str to Confirmed
        Full runs of the best point, by blast; none where they could not be run.
    scene : dict
        Of `view.scene`, of the project.
    """
    plan, trace = summary["plan"], summary["trace"]
    points, misfits = (np.array(trace[name]) for name in ("points", "misfits"))
    drawn = [] if plan is None else [*result_figures(plan, points, misfits), survey_figure(plan)]
    drawn += [*(_search_figures(summary) if len(misfits) else ()), *_motion_figures(confirmed)]
    heads = "title", "caption", "image"
    rows, waves = with_waveforms([dict(zip(heads, row, strict=True)) for row in drawn])
    text = page("back_analysis.html").render(
        s=plain(summary),
        laboratory=any(row["laboratory"] is not None for row in summary["parameters"]),
        candidates=[] if plan is None else plain(best_candidates(plan)),
        lines=[] if plan is None else survey_lines(plan),
        fit=fit_lines(summary["fit"]),
        slip=[
            line for name, blast in summary["blasts"].items() for line in slip_lines(name, blast)
        ],
        figures=rows,
        scene=scene,
        waves=waves,
    )
    write_text(path, text)


def _search_figures(summary):
    """Yield the figures of the search."""
    trace = {name: np.array(value) for name, value in summary["trace"].items()}
    unit = summary["misfit_unit"]
    yield (
        "Misfit",
        "Share of the energy of the records that each step of the search leaves."
        if summary["fit"] is not None
        else f"Misfit of each run; method '{summary['method']}', seed {summary['seed']}. The "
        f"search accepted {summary['accepted']} of {summary['runs']}, further starts included.",
        misfit_figure(trace["misfits"], trace["accepted"], unit),
    )
    yield (
        "Search",
        "Misfit against each parameter over its range; later runs darker, the best coloured.",
        points_figure(summary["parameters"], trace["points"], trace["misfits"], unit),
    )


def _filtered(corner):
    """Return the low-pass of sources and records in words, empty without one."""
    return f", both low-passed at {corner:.3g} Hz like the sources" if corner else ""


def _motion_figures(confirmed):
    """Yield recorded and simulated motion at the best point (figures 7 to 9 of the paper)."""
    for blast, run in confirmed.items():
        for name, record in run.recorded.items():
            both = {"recorded": record, "simulated": run.simulated[name]}
            yield (
                f"Receiver {name}",
                f"{blast}, {name}: recorded against simulated at the best point"
                f"{_filtered(record.low_passed)}; particle velocity and smoothed amplitude "
                "spectrum.",
                figures.waveform_figure(
                    both, [figures.RECORDED, figures.SIMULATED], SPECTRUM_TOP,
                    float(run.simulated[name].times[-1]),
                ),
            )  # fmt: skip
