"""Report of a run: one HTML page that says the answer first, then figures, findings and tables."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..blasts.compliance import ORIENTATION, explain, share_at_level, unsigned
from ..files import plain, write_text
from ..project.result import Result
from ..signals.comparison import load_limits
from ..units import plain_number
from . import figures, maps
from .figures import limits_figure
from .pages import page
from .view import scene

SPECTRUM_TOP = 40.0
MOST_JOINTS = 6  # whose slip is drawn
FIGURE = "title", "caption", "tables", "image"
NOTHING_LIMITED = {"rows": [], "chosen": False}
SOURCES = {"forces": "point forces", "tensors": "moment tensors", "pressures": "pressed surfaces"}


def write_report(path, result: Result):
    """Write the report of a result, and the A4 page beside it (``report_one_page.html``).

    Parameters
    ----------
    path : path
    result : Result
    """
    path = Path(path)
    write_text(path, render(result))
    write_text(path.with_name(f"{path.stem}_one_page.html"), render_one_page(result))


def render(result: Result) -> str:
    """Return the page as text; every name that users give is escaped."""
    result = replace(result, summary=plain(result.summary))
    summary = result.summary
    rows, waves = _figures(result)
    return page("report.html").render(
        s=summary,
        answer=answer(summary),
        tone=_tone(summary),
        compliance=summary.get("compliance") or NOTHING_LIMITED,
        curves=load_limits(),
        explain=explain,
        scene=scene(result),
        figures=rows,
        severities=_by_severity(summary["findings"]),
        waves=waves,
        assumed=_assumed_under(summary["assumed"]),
    )


def render_one_page(result: Result) -> str:
    """Return one A4 page for each receiver with a record, or for the one nearest to its limit."""
    result = replace(result, summary=plain(result.summary))
    summary, motions = result.summary, result.seismograms("simulated")
    rows = (summary.get("compliance") or NOTHING_LIMITED)["rows"]
    recorded = result.seismograms("recorded")
    worst = max(rows, key=lambda row: row["share"] or 0.0, default=None)
    names = list(recorded) or ([worst["receiver"]] if worst else list(motions)[:1])
    sheets = [_sheet(result, name, recorded.get(name), motions.get(name)) for name in names]
    return page("one_page.html").render(
        s=summary,
        sheets=sheets,
        waves=[sheet["waves"] for sheet in sheets],
        curves=load_limits(),
        explain=explain,
        answer=answer(summary),
        instruments=summary.get("instruments", {}),
        compliance=summary.get("compliance") or NOTHING_LIMITED,
    )


def _sheet(result, name, recorded, simulated):
    """Return what the A4 page of a receiver shows."""
    kind, motion = ("simulated", simulated) if recorded is None else ("recorded", recorded)
    colour = figures.SIMULATED if recorded is None else figures.RECORDED
    summary = result.summary
    names = _curves(summary)
    rows = (summary.get("compliance") or NOTHING_LIMITED)["rows"]
    chosen, curves = [key for key in names if key in load_limits()], load_limits()
    own = [row for row in rows if (row["receiver"], row["kind"]) == (name, kind)]
    return {
        "receiver": name,
        "kind": kind,
        "rows": own,
        "worst": max(own, key=lambda row: row["share"] or 0.0, default=None),
        "table": summary["receivers"][name][kind],
        "position": summary["receivers"][name]["position"],
        "waves": figures.waveform_figure({kind: motion}, [colour], _spectrum_top(summary)),
        "limits": limits_figure({kind: {name: motion}}, [curves[key] for key in chosen])[0],
    }


def _curves(summary):
    """Return the keys of the limit curves of a result: chosen, or for orientation."""
    return (summary.get("compliance") or NOTHING_LIMITED).get("curves", ORIENTATION)


def answer(summary) -> list[tuple[str, str]]:
    """Return what was fired and where, what came out, and whether it is allowed.

    Parameters
    ----------
    summary : dict
        Of a result, as JSON holds it.

    Returns
    -------
    list of tuple of 2 str
        Head and sentence.
    """
    rows = (summary.get("compliance") or NOTHING_LIMITED)["rows"]
    known = [row for row in rows if row["distance"] is not None]
    where = ""
    if known:
        near = min(known, key=lambda row: row["distance"])
        far = max(known, key=lambda row: row["distance"])
        where = f"; {near['receiver']} stands {plain_number(near['distance'])} m away"
        if far["receiver"] != near["receiver"]:
            where += f", {far['receiver']} {plain_number(far['distance'])} m"
    lines = [("Fired", f"{_fired(summary)}{where}."), ("Came out", _came_out(summary))]
    stability = summary.get("stability")
    if stability and stability["sentence"]:
        lines.append(("Does it slip?", stability["sentence"]))
    conclusion = (summary.get("compliance") or {}).get("conclusion")
    return [*lines, ("Allowed?", conclusion)] if conclusion else lines


def _tone(summary):
    """Return the colour of the answer: bad where a check or limit fails, good where all hold."""
    compliance = summary.get("compliance") or NOTHING_LIMITED
    shares = [share_at_level(row) for row in compliance["rows"] if row["share"] is not None]
    over = compliance["chosen"] and max(shares, default=0.0) > 1.0
    if over or any(finding["failed"] for finding in summary["findings"]):
        return "bad"
    signed = compliance["chosen"] and not unsigned(compliance["rows"])
    return "good" if signed and shares else ""


def _fired(summary):
    """Return what moved the ground."""
    blast, sources = summary.get("blast"), summary["sources"]
    if blast is None:
        parts = [f"{len(sources[n])} {SOURCES[n]}" for n in SOURCES if sources[n]]
        if summary["input"] is not None:
            parts.insert(0, f"a single hole ({summary['input']['signature']})")
        return " and ".join(parts) or "an air blast"
    count = len(blast["holes"])
    text = f"{count} {'hole' if count == 1 else 'holes'}"
    if blast["charge"] is not None:
        text += (
            f" with {plain_number(blast['charge'])} kg, at most "
            f"{plain_number(blast['charge_per_8ms'])} kg in 8 ms"
        )
    return text + (f", over {plain_number(1e3 * blast['last'])} ms" if blast["last"] > 0.0 else "")


def _came_out(summary):
    """Return the largest peak, recorded and simulated, whether it is plausible, what fails."""
    words = []
    for kind in ("recorded", "simulated"):
        peaks = [
            (value, name, table[kind]["components"][k], table[kind]["zero_crossing_frequency"][k])
            for name, table in summary["receivers"].items() if table[kind]
            for k, value in enumerate(table[kind]["ppv"]) if value is not None
        ]  # fmt: skip
        if peaks:
            value, name, component, hz = max(peaks)
            at = "" if hz is None else f", {plain_number(hz)} Hz"
            words.append(
                f"{kind} PPV of {plain_number(1e3 * value)} mm/s at {name} ({component}{at})"
            )
    text = (words[0][0].upper() + "; ".join(words)[1:] if words else "No receiver") + "."
    outside = [n for n, table in summary["receivers"].items() if table.get("implausible")]
    if outside:
        text += f" Outside of what published laws find plausible: {', '.join(outside)}."
    failing = sorted({finding["code"] for finding in summary["findings"] if finding["failed"]})
    if failing:
        text += f" Do not use it yet: {', '.join(failing)} failed."
    return text


def _by_severity(findings):
    """Return findings by severity, alike ones together: title, open, list of (code, title, all)."""
    groups = []
    for title, failed in (("Checks that fail", True), ("To know", False)):
        alike = {}
        for finding in findings:
            if finding["failed"] == failed:
                alike.setdefault(finding["code"], []).append(finding)
        if alike:
            rows = [(code, same[0]["title"], same) for code, same in alike.items()]
            groups.append((title, failed, rows))
    return groups


def _figures(result):
    """Return the figures (title, caption, names of assumed tables, image), and all waveforms."""
    summary = result.summary
    wide = _spectrum_top(summary)
    rows = [
        *_plan_figures(result),
        *_limit_figures(result),
        *_slip_figures(result),
        *_receiver_figures(result, wide),
        *_input_figures(result, wide),
        *_source_figures(result, wide),
        *_section_figures(result),
        *_stereonet_figures(summary),
        (
            "Energy",
            "Energy since the start of the run; the balance closes within "
            f"{100.0 * summary['run']['balance_error']:.2g} %.{_energy_words(summary)}",
            (),
            figures.energy_figure(
                result.arrays["energy"], summary["run"]["lead"],
                bool(summary["sources"]["absorbing_layer"]),
            ),
        ),
    ]  # fmt: skip
    return with_waveforms([dict(zip(FIGURE, row, strict=True)) for row in rows])


def with_waveforms(rows):
    """Return figures with the number of their waveform, if they are one, and these waveforms."""
    waves = [row["image"] for row in rows if _is_wave(row["image"])]
    for row in rows:
        is_wave = _is_wave(row["image"])
        row["waveform"] = waves.index(row["image"]) if is_wave else None
    return rows, waves


def _is_wave(image):
    """Tell whether a figure is a motion with its spectrum."""
    return isinstance(image, dict) and "traces" in image


def _spectrum_top(summary):
    """Return where frequency axes end [Hz]: twice the low-pass, or twice the band of sources."""
    if summary["input"] is None:
        return 2.0 * summary["band"]["input_hz"]
    top = summary["input"]["low_pass"]
    return SPECTRUM_TOP if top is None else 2.0 * top


def _input_figures(result, top):
    """Yield the figures of the single hole and of the input through a face."""
    table, stages = result.summary["input"], result.seismograms("input")
    if table is None:
        return
    yield (
        "Single hole",
        f"Signature, {table['signature']}: particle velocity and smoothed amplitude "
        "spectrum of the three components.",
        ("signature",),
        figures.waveform_figure(
            {"single hole": stages["signature"]}, [figures.INK], top, _end(stages["signature"])
        ),
    )
    yield (
        "Input motion",
        _filter_words(table),
        ("signature", "blast", "input"),
        figures.waveform_figure(
            {"whole blast": stages["superposed"], "input": stages["motion"]},
            ["#9aa5b1", figures.SIMULATED], top, _end(stages["superposed"]),
        ),
    )  # fmt: skip


def radius_words(radii):
    """Return the words for the least and the greatest radius in m."""
    low, high = radii
    return f"{low:.3g} m" if high < 1.01 * low else f"{low:.3g} to {high:.3g} m"


def _source_figures(result, top):
    """Yield the figure of moment rates and force histories inside the model."""
    table, histories = result.summary["sources"], result.arrays.get("sources", {})
    if not histories:
        return
    words = []
    if table["holes"]:
        extent = (
            f"columns that detonate at {table['detonation']:g} m/s"
            if table["detonation"]
            else "each as its own field in the elements around it (injection)"
            if table["injected"]
            else f"each over a sphere of radius {radius_words(table['radius'])}"
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


def _plan_figures(result):
    """Yield the plan of holes, receivers and faults over contours of peak velocity."""
    image = maps.plan_figure(result)
    if image is None:
        return
    words = "Plan of the model"
    if maps.shown_surface(result)[2] is not None:
        words += (
            f" with contours of the peak vector sum over its surface, up to "
            f"{result.summary['band']['input_hz']:.3g} Hz (surface_peaks.csv and .asc)"
        )
    yield "Plan", f"{words}; numbers are the order of firing.", ("mesh", "blast"), image


def _slip_figures(result):
    """Yield the figure of each joint that slips, those that slip most first."""
    joints = (result.summary.get("stability") or {"joints": {}})["joints"]
    moved = sorted(
        (name for name in joints if joints[name]["slips"]),
        key=lambda name: -joints[name]["largest_slip"],
    )
    contacts, names = result.arrays.get("contacts", {}), list(joints)
    for name in moved[:MOST_JOINTS]:
        low, high = np.array(result.summary["extent"]).T
        position, slip = contacts["place"], contacts["largest_slip"]
        inside = ((position >= low) & (position <= high)).all(axis=1)
        here = inside & (contacts["joint"] == names.index(name))
        yield (
            f"Slip of {name}",
            "Left the largest slip of each contact on the plane, then the largest slip and opening "
            "of all and the factor of safety of the whole against sliding.",
            ("joints", "insitu"),
            figures.slip_figure(position[here], slip[here], result.arrays["joint_histories"][name]),
        )


def _stereonet_figures(summary):
    """Yield the stereonet of joint sets and faults."""
    image = maps.stereonet_figure(summary["joints"], summary["mesh_names"]["faults"])
    if image is not None:
        yield (
            "Stereonet",
            "Great circles and poles of joint sets and faults, dip/dip direction in degrees; lower "
            "hemisphere, equal area.",
            ("joints", "mesh"),
            image,
        )


def _section_figures(result):
    """Yield the section with joints and faults."""
    north = _section_place(result)
    entry = "stars mark holes and forces inside, projected"
    if result.summary["input"] is not None:
        face = result.summary["input"]["face"]
        arrows = " at the arrows" if face == "west" else ""
        entry = f"the blast enters through '{face}'{arrows}"
    yield (
        "Section",
        f"Section at north {north:g} m with joints and faults; {entry}.",
        ("mesh", "joints"),
        figures.section_figure(result, north),
    )


def _section_place(result):
    """Return the north coordinate of the section: through a receiver within, else the middle."""
    across = result.arrays["mesh"]["points"][:, 1]
    margin = figures.NUDGE * float(np.ptp(across))
    for table in result.summary["receivers"].values():
        north = float(table["position"][1])
        if across.min() + margin < north < across.max() - 2.0 * margin:
            return north
    return float(across.mean())


def _receiver_figures(result, top):
    """Yield recorded and simulated motion at each receiver."""
    recorded = result.seismograms("recorded")
    for name, simulated in result.seismograms("simulated").items():
        both, colours = {"simulated": simulated}, [figures.SIMULATED]
        words = "simulated; no record is given"
        if name in recorded:
            both = {
                "recorded": recorded[name].filtered_like(simulated.low_passed),
                "simulated": simulated,
            }
            colours, words = [figures.RECORDED, figures.SIMULATED], "recorded against simulated"
            if simulated.low_passed:
                words += f", both low-passed at {simulated.low_passed:.3g} Hz like the sources"
        yield (
            f"Receiver {name}",
            f"{name}: {words}; particle velocity and smoothed amplitude spectrum."
            f"{_towards(result.summary['receivers'][name])}",
            ("receivers", "signature", "mesh", "joints", "damping"),
            figures.waveform_figure(both, colours, top, float(simulated.times[-1])),
        )


def _limit_figures(result):
    """Yield the figure of peaks and limit curves, for orientation if the project names none."""
    names, curves = _curves(result.summary), load_limits()
    chosen = [curves[name] for name in names if name in curves]
    motions = {kind: result.seismograms(kind) for kind in ("simulated", "recorded")}
    if not chosen or not any(motions.values()):
        return
    image, left_out = limits_figure(motions, chosen)
    without = f" Without crossings on both sides, and left out: {', '.join(left_out)}."
    yield (
        "Limit curves",
        "Peaks of each component against their frequency by zero crossing. The simulation holds "
        f"little above {result.summary['band']['input_hz']:.3g} Hz.{without if left_out else ''}",
        ("receivers", "signature"),
        image,
    )


def _towards(table):
    """Return the direction of the longitudinal component."""
    if table["azimuth"] is None:
        return ""
    bearing = math.degrees(table["azimuth"]) % 360.0
    return f" L is positive towards {bearing:g}° from north, T 90° clockwise of it."


def _energy_words(summary):
    """Return notes on the energy of input and initial stress."""
    words = ""
    if summary["input"] is not None:
        words = (
            " At a viscous input face about half of the input goes directly into the dashpots of "
            "that face."
        )
    if summary["run"]["static"]:
        words += " The initial energy of joints is that of the in-situ stress, not of the blast."
    if summary["sources"]["absorbing_layer"] and "absorbing_layer" not in summary["energy"]:
        words += (
            " What the absorbing layer takes cannot be separated from damping of the ground, since "
            "both act through the forces of the same zones: one curve is their sum."
        )
    return words


def _filter_words(table):
    """Return the caption of superposition and filter."""
    text = f"{table['holes']} holes at {len(table['instants'])} instants"
    if table["low_pass"] is None:
        return f"{text}, not filtered."
    taken = ", ".join(f"{100 * v:.3g} %" for v in table["removed_energy"] if v is not None)
    phase = "it is of zero phase"
    if not table["zero_phase"]:
        phase = f"its delay of {336.0 / table['low_pass']:.2g} ms is taken back"
    return (
        f"{text}, before and after the low-pass at {table['low_pass']:g} Hz, which took "
        f"{taken} of the energy of the components that move; {phase}."
    )


def _assumed_under(assumed):
    """Return a function that lists which assumed keys lie under some tables."""
    return lambda *tables: [key for key in assumed if key.split(".")[0] in tables]
