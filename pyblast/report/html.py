"""The report of a run: one HTML page with figures and tables that opens without network."""

import math
from dataclasses import replace
from importlib import resources

import numpy as np
from jinja2 import Environment, FunctionLoader, StrictUndefined

from ..project.result import Result, plain, write_text
from ..signals.comparison import load_limits
from . import figures
from .figures import limits_figure

SPECTRUM_TOP = 40.0
SOURCES = {"forces": "point forces", "tensors": "moment tensors", "pressures": "pressed surfaces"}


def write_report(path, result: Result):
    """Write the report of a result.

    Parameters
    ----------
    path : path
    result : Result
    """
    write_text(path, render(result))


def render(result: Result) -> str:
    """Return the page as text; every name that users give is escaped."""
    result = replace(result, summary=plain(result.summary))
    return page("report.html").render(
        s=result.summary,
        figures=_figures(result),
        assumed=_assumed_under(result.summary["assumed"]),
    )


def page(name):
    """Return the template of a page, which escapes every name that users give."""
    here = resources.files("pyblast.report") / "templates"
    loader = FunctionLoader(lambda part: here.joinpath(part).read_text(encoding="utf-8"))
    environment = Environment(
        loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True
    )
    environment.filters |= {"number": number, "scaled": scaled, "angle": angle}
    return environment.get_template(name)


def _figures(result):
    """Make the figures: list of title, caption, names of assumed tables, image."""
    summary = result.summary
    wide = _spectrum_top(summary)
    made = [
        *_input_figures(result, wide),
        *_source_figures(result, wide),
        (
            "Blocks",
            f"{summary['model']['blocks']} blocks, each in a shade of its material, seen from the "
            "south-west (as figure 3 of the paper).",
            ("mesh",),
            figures.blocks_figure(result),
        ),
        *_section_figures(result),
        *_receiver_figures(result, wide),
        *_limit_figures(result),
        (
            "Energy",
            "Where the energy that was put in went; the ledger closes within "
            f"{100.0 * summary['run']['balance_error']:.2g} %.{_energy_words(summary)}",
            (),
            figures.energy_figure(result.arrays["energy"], summary["run"]["lead"]),
        ),
    ]  # fmt: skip
    return [dict(zip(("title", "caption", "tables", "image"), row, strict=True)) for row in made]


def _spectrum_top(summary):
    """Return where frequency axes end [Hz]: twice the low-pass, or twice the band of sources."""
    if summary["input"] is None:
        return 2.0 * summary["band"]
    top = summary["input"]["low_pass"]
    return SPECTRUM_TOP if top is None else 2.0 * top


def _input_figures(result, top):
    """Draw the single hole and what enters through the face."""
    table, stages = result.summary["input"], result.seismograms("input")
    if table is None:
        return
    yield (
        "Single hole",
        f"Signature, {table['signature']}: particle velocity and smoothed amplitude "
        "spectrum of the three components (as figure 5 of the paper).",
        ("signature",),
        figures.motion_figure(
            {"single hole": stages["signature"]}, [figures.INK], top, _end(stages["signature"])
        ),
    )
    yield (
        "Input motion",
        _filter_words(table),
        ("signature", "blast", "input"),
        figures.motion_figure(
            {"whole blast": stages["superposed"], "into the model": stages["motion"]},
            ["#9aa5b1", figures.SIMULATED], top, _end(stages["superposed"]),
        ),
    )  # fmt: skip


def _source_figures(result, top):
    """Draw the moment rate of holes inside and the histories of forces."""
    table, histories = result.summary["sources"], result.arrays.get("sources", {})
    if not histories:
        return
    words = []
    if table["holes"]:
        extent = (
            f"columns that detonate at {table['detonation']:g} m/s"
            if table["detonation"]
            else f"each spread over {table['spread']:.3g} m"
        )
        words.append(
            f"{len(table['holes'])} holes inside the model, M = M(1 kg) W^{table['exponent']:g}, "
            f"{table['moment_rate']}, {extent}"
        )
    for name in ("forces", "tensors", "pressures"):
        if table[name]:
            words.append(f"{SOURCES[name]}: {len(table[name])}")
    if table["air_blast"]:
        air = table["air_blast"]
        words.append(f"air blast over '{air['surface']}' at {air['speed']:g} m/s")
    yield (
        "Sources",
        f"{'; '.join(words)}. Left the history, right the spectrum of its slope, which has the "
        "shape of the far motion.",
        ("blast", "holes_inside", "point_forces", "moment_tensors", "pressures", "air_blast"),
        figures.source_figure(histories, top),
    )


def _end(seismogram):
    """Return the time in s after which a seismogram stays below a hundredth of its peak."""
    size = np.nanmax(np.abs(seismogram.velocity), axis=1)
    return 1.2 * float(seismogram.times[np.flatnonzero(size > 0.01 * size.max())[-1]])


def _section_figures(result):
    """Section with joints and faults, and the highest frequency that each zone carries."""
    place = _section_place(result)
    edges = result.summary["run"].get("edges_per_wavelength", 10.0)
    entry = "stars mark holes and forces inside, projected"
    if result.summary["input"] is not None:
        face = result.summary["input"]["face"]
        arrows = " at the arrows" if face == "west" else ""
        entry = f"the blast enters through '{face}'{arrows}"
    yield (
        "Section",
        f"Section at north {place:g} m with joints and faults; {entry} (as figure 4 of the paper).",
        ("mesh", "joints"),
        figures.section_figure(result, place),
    )
    yield (
        "Highest frequency",
        f"Highest frequency that each zone carries: Cs over {edges:g} of its mean edges; the input "
        f"has {result.summary['band']:.3g} Hz. The same section.",
        ("mesh",),
        figures.section_figure(result, place, "f_max"),
    )


def _section_place(result):
    """Return the north coordinate of the section: through the first receiver, else the middle."""
    for table in result.summary["receivers"].values():
        return float(table["position"][1])
    return float(result.arrays["mesh"]["points"][:, 1].mean())


def _receiver_figures(result, top):
    """Draw recorded and simulated motion at each receiver (figures 7 to 9)."""
    recorded = result.seismograms("recorded")
    for name, simulated in result.seismograms("simulated").items():
        both, colours = {"simulated": simulated}, [figures.SIMULATED]
        words = "simulated; no record is given"
        if name in recorded:
            both = {"recorded": recorded[name], "simulated": simulated}
            colours, words = [figures.RECORDED, figures.SIMULATED], "recorded against simulated"
        yield (
            f"Receiver {name}",
            f"{name}: {words}; particle velocity and smoothed amplitude spectrum (as figures 7 to "
            f"9 of the paper).{_towards(result.summary['receivers'][name])}",
            ("receivers", "signature", "mesh", "joints", "damping"),
            figures.motion_figure(both, colours, top, float(simulated.times[-1])),
        )


def _limit_figures(result):
    """Draw all peaks under the limit curves that were asked for."""
    names, curves = result.summary.get("limit_curves", []), load_limits()
    some = [curves[name] for name in names if name in curves]
    if not some:
        return
    motions = {kind: result.seismograms(kind) for kind in ("simulated", "recorded")}
    image, left_out = limits_figure(motions, some)
    without = f" Without crossings on both sides, and left out: {', '.join(left_out)}."
    yield (
        "Limit curves",
        "Peaks of each component against their frequency by zero crossing. Curves are drawn, and "
        "nothing is judged: who uses one has to compare it with the standard "
        f"({'; '.join(curve.source for curve in some)}). What is simulated holds little above "
        f"{result.summary['band']:.3g} Hz.{without if left_out else ''}",
        ("receivers", "signature"),
        image,
    )


def _towards(table):
    """Say where the longitudinal component points."""
    if table["azimuth"] is None:
        return ""
    bearing = math.degrees(table["azimuth"]) % 360.0
    return f" L is positive towards {bearing:g}° from north, T 90° clockwise of it."


def _energy_words(summary):
    """Say what of the energy is not what it seems."""
    words = ""
    if summary["input"] is not None:
        words = (
            " On a quiet input face about half of what is put in goes straight into the dashpots "
            "of that face."
        )
    if summary["run"]["static"]:
        words += " What joints hold at the beginning is in-situ stress, no energy of the blast."
    return words


def _filter_words(table):
    """Say what superposition and filter did."""
    text = f"{table['holes']} holes at {len(table['instants'])} instants"
    if table["low_pass"] is None:
        return f"{text}, not filtered."
    taken = ", ".join(f"{100 * v:.3g} %" for v in table["removed_energy"] if v is not None)
    return (
        f"{text}, before and after the low-pass at {table['low_pass']:g} Hz (-6 dB; -3 dB at "
        f"{table['low_pass_3db']:.3g} Hz), which took {taken} of the energy of the "
        "components that move. It shifts no phase, so that motion begins before the first firing."
    )


def _assumed_under(assumed):
    """Return a function that lists which assumed keys lie under some tables."""
    return lambda *tables: [key for key in assumed if key.split(".")[0] in tables]


def number(value, digits=3):
    """Show a number with some digits, a dash where there is none."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "–"
    if not isinstance(value, float):
        return str(value)
    text = f"{value:.{digits}g}"
    return f"{float(text):.0f}" if 1e3 <= abs(value) < 1e9 else text


def scaled(value, factor, digits=3):
    """Show an SI value in another unit, ``factor`` of them per SI unit."""
    return number(None if value is None else float(value) * factor, digits)


def angle(tangent):
    """Show the angle in degrees of a tangent."""
    return number(None if tangent is None else math.degrees(math.atan(tangent)))
