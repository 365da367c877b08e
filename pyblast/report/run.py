"""Report of a run: one HTML page with figures and tables, and files for ParaView."""

import math
from dataclasses import replace
from importlib import resources
from pathlib import Path

import meshio
import numpy as np
from jinja2 import Environment, FunctionLoader, StrictUndefined

from ..errors import ReadError
from ..mesh.mesh import edge_lengths
from ..project.checks_ground import carried_frequency
from ..project.result import Result, plain, write_text
from ..signals.comparison import load_limits
from ..solver.initial_stress import yield_states
from ..units import plain_number
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
    environment.filters |= {
        "number": number,
        "scaled": scaled,
        "angle": angle,
        "plain": plain_number,
    }
    return environment.get_template(name)


def _figures(result):
    """Return the figures: list of title, caption, names of assumed tables, image."""
    summary = result.summary
    wide = _spectrum_top(summary)
    rows = [
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
            "Energy balance of the input; it closes within "
            f"{100.0 * summary['run']['balance_error']:.2g} %.{_energy_words(summary)}",
            (),
            figures.energy_figure(result.arrays["energy"], summary["run"]["lead"]),
        ),
    ]  # fmt: skip
    return [dict(zip(("title", "caption", "tables", "image"), row, strict=True)) for row in rows]


def _spectrum_top(summary):
    """Return where frequency axes end [Hz]: twice the low-pass, or twice the band of sources."""
    if summary["input"] is None:
        return 2.0 * summary["band"]
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
            {"whole blast": stages["superposed"], "input": stages["motion"]},
            ["#9aa5b1", figures.SIMULATED], top, _end(stages["superposed"]),
        ),
    )  # fmt: skip


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
    """Yield the section with joints and faults, and with the highest frequency of zones."""
    north = _section_place(result)
    edges = result.summary["run"].get("edges_per_wavelength", 10.0)
    entry = "stars mark holes and forces inside, projected"
    if result.summary["input"] is not None:
        face = result.summary["input"]["face"]
        arrows = " at the arrows" if face == "west" else ""
        entry = f"the blast enters through '{face}'{arrows}"
    yield (
        "Section",
        f"Section at north {north:g} m with joints and faults; {entry} (as figure 4 of the paper).",
        ("mesh", "joints"),
        figures.section_figure(result, north),
    )
    yield (
        "Highest frequency",
        f"Highest frequency that each zone carries: Cs over {edges:g} of its mean edges; the input "
        f"has {result.summary['band']:.3g} Hz. The same section.",
        ("mesh",),
        figures.section_figure(result, north, "f_max"),
    )


def _section_place(result):
    """Return the north coordinate of the section: through the first receiver, else the middle."""
    for table in result.summary["receivers"].values():
        return float(table["position"][1])
    return float(result.arrays["mesh"]["points"][:, 1].mean())


def _receiver_figures(result, top):
    """Yield recorded and simulated motion at each receiver (figures 7 to 9 of the paper)."""
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
    """Yield the figure of peaks and limit curves, if the project names any."""
    names, curves = result.summary.get("limit_curves", []), load_limits()
    chosen = [curves[name] for name in names if name in curves]
    if not chosen:
        return
    motions = {kind: result.seismograms(kind) for kind in ("simulated", "recorded")}
    image, left_out = limits_figure(motions, chosen)
    without = f" Without crossings on both sides, and left out: {', '.join(left_out)}."
    yield (
        "Limit curves",
        "Peaks of each component against their frequency by zero crossing. The curves are no "
        "assessment: compare a curve with its standard before you use it "
        f"({'; '.join(curve.source for curve in chosen)}). The simulation holds little above "
        f"{result.summary['band']:.3g} Hz.{without if left_out else ''}",
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
    return words


def _filter_words(table):
    """Return the caption of superposition and filter."""
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


def zone_fields(model):
    """Return the fields of zones: group, block, highest frequency carried; dict of (n_zones,)."""
    mesh = model.mesh
    edge = edge_lengths(mesh).mean(axis=1)
    return {
        "group": mesh.zone_group.astype(np.int32),
        "block": mesh.blocks().astype(np.int32),
        "f_max": carried_frequency(model.zone_values("cs"), edge, model.edges_per_wavelength),
    }


def yield_fields(run):
    """Return stress (Pa) and plastic strains of plastic zones, nan elsewhere; empty without any.

    The stress has ParaView's order xx yy zz xy yz zx.
    """
    constants = run.prepared.constants
    if constants["hex_order"]:
        return {}
    zone, stress, plastic = yield_states(constants, run.state)
    if not len(zone):
        return {}
    values = np.full((len(constants["zone_row"]), 8), np.nan)
    values[zone] = np.hstack([stress, plastic])
    return {
        "stress": values[:, [0, 1, 2, 5, 3, 4]],
        "plastic_shear": values[:, 6],
        "plastic_tension": values[:, 7],
    }


def write_zones(path, points, zones, fields, node_fields=None):
    """Write tetrahedra with values per zone and per node.

    Parameters
    ----------
    path : path
    points : (n_nodes, 3) float64, m
    zones : (n_zones, 4) int32
    fields, node_fields : dict of str to array
    """
    cells = [("tetra", zones)]
    mesh = meshio.Mesh(points, cells, node_fields or {}, {n: [v] for n, v in fields.items()})
    _write(path, mesh)


def write_joints(path, mesh, displacement=None):
    """Write joint surfaces with their number and the displacement jump of each node.

    Parameters
    ----------
    path : path
    mesh : Mesh
        Split.
    displacement : (n_nodes, 3) float64, m, optional
    """
    names = mesh.contacts.names if mesh.contacts is not None else ()
    triangles = np.concatenate([np.empty((0, 3), np.int32), *(mesh.surfaces[n] for n in names)])
    number = np.repeat(np.arange(len(names)), [len(mesh.surfaces[n]) for n in names])
    fields = {}
    contacts = mesh.contacts
    if displacement is not None and contacts is not None and len(names):
        jump = np.zeros_like(mesh.points)
        jump[contacts.minus] = displacement[contacts.plus] - displacement[contacts.minus]
        fields["jump"] = jump
    joints = {"joint": [number.astype(np.int32)]}
    _write(path, meshio.Mesh(mesh.points, [("triangle", triangles)], fields, joints))


def write_motion(folder, points, zones, snapshots):
    """Write node velocities at some instants, and a ParaView collection of them.

    Parameters
    ----------
    folder : Path
    points, zones : arrays of the mesh
    snapshots : dict of float (s) to (n_nodes, 3) float32, m/s
    """
    lines = []
    for number, (time, velocity) in enumerate(sorted(snapshots.items())):
        name = f"motion_{number:03d}.vtu"
        write_zones(Path(folder) / name, points, zones, {}, {"velocity": velocity})
        lines.append(f'<DataSet timestep="{time:.9g}" file="{name}"/>')
    if lines:
        body = "\n".join(lines)
        write_text(
            Path(folder) / "motion.pvd",
            '<VTKFile type="Collection" version="0.1"><Collection>\n'
            f"{body}\n</Collection></VTKFile>\n",
        )


def _write(path, mesh):
    """Write to a temporary file and rename it; `ReadError` if the path can't be written."""
    path = Path(path)
    beside = path.with_name(f".{path.stem}.part.vtu")
    try:
        mesh.write(beside, file_format="vtu")
        beside.replace(path)
    except OSError as error:
        raise ReadError(f"{path}: can't be written ({error.strerror or error})") from None
    finally:
        beside.unlink(missing_ok=True)
