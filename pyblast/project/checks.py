"""Checks before a run: the summary of the model and the findings that its numbers show."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..blasts.blast import ANFO_DENSITY, Firing
from ..blasts.compliance import free_field
from ..config.keys import unusual
from ..errors import Finding, InputError, by_wave
from ..ground.tables import joint_of_surface, set_stiffness
from ..mesh import quality
from ..mesh.as_built import Row
from ..mesh.mesh import surface_zones, zone_edge_lengths
from ..model.boundary import Roller, Viscous
from ..signals.spectra import highest_frequency
from ..simulation.accuracy import FOUND, HARMONICS, Band, ReceiverError
from ..simulation.estimate import Cost, at_frequency
from ..solver.initial_stress import joint_pressures
from ..solver.injection import near_receivers, refusal
from ..sources.inside import NEARLY, shape
from ..units import in_minutes, plain_number
from . import checks_ground
from .checks_ground import MOST_NAMED, ModelSummary, boundary_defects, ground_notes, summarise_model
from .elastic_ground import elastic_finding
from .level import (
    energy_finding,
    expected_peaks,
    level_findings,
    source_energy,
)
from .places import (
    face_distance,
    face_materials,
    source_material,
    source_names,
)


@dataclass(frozen=True)
class Check:
    """Check of a project before its run: summary of the model, and findings.

    Parameters
    ----------
    cost : Cost or None
        Estimated before the mesh; None where that is read from a file.
    summary : ModelSummary or None
        None where the run is beyond its budget, and no mesh was built.
    findings : tuple of Finding
    notes : tuple of str
        Plausibility of the hole table, records to compare with.
    ground_as_built : tuple of Row
        Sides, planes, layers and positions, as asked for and as built.
    """

    cost: Cost | None
    summary: ModelSummary | None
    findings: tuple[Finding, ...]
    notes: tuple[str, ...]
    ground_as_built: tuple[Row, ...] = ()

    @property
    def failed(self) -> bool:
        """Whether a finding forbids trust in the result."""
        return any(finding.failed for finding in self.findings)


def check(project, priced=False, progress=None) -> Check:
    """Check a project before a run: summarise its model and report findings.

    Parameters
    ----------
    project : Project
    priced : bool
        Whether to stop before the mesh of a run that is beyond its budget, with that finding.
    progress : callable, optional
        Called with (stage, done, total).

    Returns
    -------
    Check
    """
    tell = progress or (lambda *_: None)
    tell("input", 0, 1)
    notes = () if project.blast is None else tuple(project.blast.checks())
    recorded = project.recorded  # a file that can't be read is refused before the mesh
    if priced and project.dear is not None:
        return Check(project.cost, None, (project.dear,), notes)
    tell("mesh", 0, 1)
    if recorded and project.comparable:  # refuses records that can't be set beside the motion
        low = project.shot.low_pass
        passed = f", low-passed at {low:.3g} Hz like the sources" if low else ""
        notes += (f"Records to compare with: {', '.join(project.comparable)}{passed}.",)
    rows = project.as_built
    tell("check", 0, 1)
    notes += ground_notes(project)
    summary = summarise_model(project, progress)
    candidates = [
        *_mesh_defects(project, summary),
        *_load_defects(project),
        *_joint_defects(project, summary),
        ground_as_built(rows),
        *_record_defects(project, summary),
        *boundary_defects(project),
        *level_findings(project, expected_peaks(project)),
        band_finding(project, project.accuracy.band),
        error_finding(project, project.accuracy.rows),
        energy_finding(source_energy(project)),
        elastic_finding(project.elastic_ground, project.receivers),
        free_field(
            project.config.run.limit_curves,
            [part.name for part in project.config.receivers if part.transfer is None],
        ),
    ]
    findings = [finding for finding in candidates if finding is not None]
    findings = sorted(one_a_kind(findings), key=lambda f: int(f.code[1:]))
    return Check(project.cost, summary, tuple(findings), notes, rows)


def one_a_kind(findings) -> list[Finding]:
    """Return findings of which those of one code and title are one; sentences are said once."""
    kinds: dict[tuple, list[Finding]] = {}
    for finding in findings:
        kinds.setdefault((finding.code, finding.title, finding.failed), []).append(finding)
    joined = []
    for first, *others in kinds.values():
        said = re.split(r"(?<=\.)\s+(?=[A-Z])", first.text)
        for other in others:
            said += [s for s in re.split(r"(?<=\.)\s+(?=[A-Z])", other.text) if s not in said]
        joined.append(replace(first, text=" ".join(said)) if others else first)
    return joined


def ground_as_built(rows):
    """D39: the ground differs from what was asked for, or a position lies on a joint.

    Parameters
    ----------
    rows : sequence of Row
    """
    wrong = [row for row in rows if not row.good]
    on_joint = [row for row in rows if row.quantity.startswith("side of ")]
    if not wrong and not on_joint:
        return None
    sides = [f"{row.name} the {row.built} {row.quantity}" for row in on_joint]
    text = [str(row) for row in wrong]
    if sides:
        text.append(
            f"Positions on the plane of a joint take the motion of one side: {', '.join(sides)}; "
            "the motion of the other side may be another one, so move them a centimetre to the "
            "side that is meant"
        )
    return Finding(
        "D39",
        "The ground differs from what was asked for" if wrong else "A position lies on a joint",
        "; ".join(text) + ".",
        failed=bool(wrong),
        numbers={"wrong": float(len(wrong)), "on_joint": float(len(on_joint))},
    )


def _mesh_defects(project, summary):
    """Yield findings of zones, sides, layers, memory, sources, blocks."""
    yield checks_ground.beyond_memory(summary.memory, quality.available())
    times = () if project.blast is None else project.blast.times
    yield unusual(project.config, project.materials, times)
    band, centre = project.shot.highest_frequency, project.shot.central_frequency
    for group in summary.groups:
        if group.highest_frequency < band:
            yield coarse_zones(
                group.name, project.model.materials[group.name], group.mean_edge, group.volume,
                band, project.model.edges_per_wavelength,
            )  # fmt: skip
    names = source_names(project.model.sources, project.blast)
    rows = near_receivers(project.model)
    obstacle = refusal(project.model, project.duration) if rows else ""
    yield checks_ground.near_source(rows, names, obstacle)
    points = project.mesh.points
    rocks = _stiff(project, summary)
    if summary.joint:
        joint = next(each for each in project.joints if each.surface == summary.joint)
        impedance = max(rock.density * rock.cp for rock in rocks.values())
        yield checks_ground.stiff_joint(
            joint.surface, joint.bound()[0], summary.price, impedance, band
        )
    yield checks_ground.removable_blocks(
        summary.removable, summary.blocks, summary.removable_volume
    )
    yield checks_ground.short_model(float(np.ptp(points[:, 0])), rocks, centre)
    boundaries = project.model.boundaries
    viscous = {b.surface for b in boundaries if isinstance(b, Viscous)}
    both = [b.surface for b in boundaries if isinstance(b, Roller) and b.surface in viscous]
    yield checks_ground.fixed_and_viscous(both)
    layers = project.config.mesh.layers
    if len(layers) > 1 and _rests_on_more(layers, points):
        top, below = (project.materials[layer.material] for layer in layers[:2])
        yield checks_ground.soil_resonance(
            layers[0].material, top, layers[0].thickness_m, below, centre, band
        )


def _rests_on_more(layers, points):
    """Tell whether the ground below the first layer is thicker than it: no plate beneath it."""
    first = layers[0].thickness_m
    return first is not None and 2.0 * first < float(np.ptp(points[:, 2]))


def _stiff(project, summary):
    """Return the stiff materials: P-wave speed at least half the largest."""
    present = {group.name: project.model.materials[group.name] for group in summary.groups}
    fastest = max(material.cp for material in present.values())
    return {name: m for name, m in present.items() if m.cp >= 0.5 * fastest}


def _load_defects(project):
    """Yield findings of firing, load, charge, absorbing layer, air."""
    blast, band = project.config.blast, project.shot.highest_frequency
    if blast is not None:
        yield firing_comb(project.firing, project.shot.central_frequency, band)
    if blast is not None and blast.charge_kg is not None:
        yield charge_fits(
            blast.charge_kg, 1e-3 * blast.diameter_mm, blast.depth_m, blast.explosive_kg_per_m3
        )
    if project.input is not None:
        yield from _face_defects(project, band)
    config = project.config
    if project.inside.moment_rate is not None or config.point_forces or config.moment_tensors:
        yield no_absorbing_layer(project)
    air, pulse = project.config.air_blast, project.inside.air_pulse
    if air is not None:
        mesh = project.mesh
        edge = zone_edge_lengths(mesh)[surface_zones(mesh, air.surface)].mean()
        top = highest_frequency(shape(pulse, pulse.values))
        yield short_air_waves(
            air.surface, float(edge), air.speed_m_per_s, top, project.model.edges_per_wavelength
        )


def _face_defects(project, band):
    """Yield findings of filter, face, strength, holes inside."""
    config, firing, motion = project.config, project.firing, project.input
    yield comb_return(firing, project.shot.central_frequency, motion.low_passed)
    name, material = source_material(project)
    yield layered_face(config.input.face, face_materials(project))
    peak = project.signature.pvs
    if config.input.decay_exponent is not None:  # no two holes are equally near
        peak, firing = motion.superposed.pvs, Firing(np.zeros(1), np.ones(1))
    yield yielding_rock(peak, firing, name, material)
    distance, reach = face_distance(project)
    if distance is not None and config.input.decay_exponent is None:
        yield plane_load(distance, reach, material, band)
    if project.blast is not None:
        points = project.mesh.points
        ends = points.min(axis=0), points.max(axis=0)
        yield holes_within(project.blast.centres, config.input.face, *ends)


def _joint_defects(project, summary):
    """Yield findings of faults and joint sets."""
    centre, band = project.shot.central_frequency, project.shot.highest_frequency
    by_surface = {joint.surface: joint for joint in project.joints}
    pressures = joint_pressures(project.model)
    stiffness = {name: joint.tangents(pressures[name]) for name, joint in by_surface.items()}
    stiffness |= set_stiffness(project.config.mesh, project.joints, pressures)
    rocks, entries, alike = _stiff(project, summary), joint_of_surface(project.config.mesh), {}
    for name in project.faults:
        alike.setdefault(entries[name], []).append(name)
    for entry, faults in alike.items():
        names, joint = ", ".join(faults), by_surface[faults[0]]
        for group, material in rocks.items():
            yield checks_ground.fault_low_pass(
                names, stiffness[faults[0]], group, material, centre, band
            )
        infill = project.config.joints[entry].infill_mm
        if infill is not None:
            thickness = [1e-3 * value for value in infill]
            yield checks_ground.infill_as_layer(names, joint, thickness)
    for part in project.config.mesh.joint_sets:
        for group in part.regions or rocks:
            yield checks_ground.jointed_speeds(
                part.name, stiffness[part.name], part.spacing_m, group,
                project.model.materials[group], centre,
            )  # fmt: skip


def _record_defects(project, summary):
    """Yield findings of late arrivals and damping."""
    if project.blast is not None:
        source = project.blast.centres.mean(axis=0)
        distances = {
            row.name: float(np.linalg.norm(source - row.position)) for row in project.receivers
        }
        last, duration = float(project.blast.times.max()), project.config.run.duration_s
        yield air_blast_arrival(distances, last, duration)
    damping = project.model.damping
    by_group = damping if isinstance(damping, dict) else {"": damping}
    for name, part in by_group.items():
        yield checks_ground.rayleigh_price(part, summary.undamped_dt, name)


LEAST_SPAN = 1.5  # highest over lowest frequency of a band in which records can be compared


def carried_band(
    projects, band: tuple[float, float] | None, names: Sequence[str]
) -> tuple[tuple[float, float] | None, Finding | None]:
    """Return the part of a band in Hz that the meshes of blasts carry to receivers, and D40.

    Parameters
    ----------
    projects : sequence of Project
        One for each blast.
    band : tuple of 2 float, Hz, or None
        None: all that enters; it stays None where the meshes carry that.
    names : sequence of str
        Of receivers; those of them that a project has.

    Raises
    ------
    InputError
        If they carry nothing of the band.
    """
    low = 1.0 / min(project.config.run.duration_s for project in projects)
    top = max(project.shot.highest_frequency for project in projects)
    low, top = (low, top) if band is None else band
    rows = [(row, each) for each in projects for row in each.accuracy.rows if row.name in names]
    row, project = min(rows, key=lambda pair: pair[0].carried)
    if row.carried >= NEARLY * top:
        return band, None
    ground, hz = project.model, plain_number(row.carried)
    edge = plain_number(float(ground.mean_edges()[row.limited_by]) * row.carried / top, 2)
    carried = f"carries motion up to {hz} Hz on the way to {row.name}: {row.limited_by!r} sets that"
    remedy = f"edges of {edge} m there carry {plain_number(top)} Hz"
    if row.carried < LEAST_SPAN * low:
        raise InputError(
            f"{project.path.name}: mesh {carried}, and records are compared from "
            f"{plain_number(low)} Hz on; {remedy}"
        )
    return (low, row.carried), Finding(
        "D40",
        "Records are compared in the band that the mesh carries",
        f"{project.path.name}: the mesh {carried}, so records are compared from "
        f"{plain_number(low)} to {hz} Hz and not to {plain_number(top)}; {remedy}. A receiver that "
        "is left out no longer sets it.",
        numbers={"carried": row.carried, "asked": top},
    )


REMEDIES = {
    "mesh": "edges for a higher mesh.frequency_hz carry more",
    "step": "a smaller run.step_factor leads less",
    "slip": "edges for a higher mesh.frequency_hz carry corners of motion that slip makes",
    "low-pass": "a higher low_pass_hz keeps more of it",
    "quality": "a narrower quality_band_hz is fitted better",
    "sphere": "edges for a higher mesh.frequency_hz shrink the sphere of its source",
    "joint in the layer": "its plane bends there; a larger mesh.size_m moves the layer away",
    "near source": "see finding D38",
    HARMONICS: "what joints or ground that open, slip or yield put into its record above the "
    "{carried} Hz that its mesh carries, up to {energy} % of its energy, comes late or rings on as "
    "no ground does: a higher mesh.frequency_hz leaves less; a low-pass of the record at {carried} "
    "Hz takes it away, or damping = {{ratio = {ratio}, frequency_hz = {carried}, mass = false, "
    "lagged = true}} of the material",
}
STILLING = 0.004  # of critical at the highest carried frequency


def _wider(project):
    """Return what makes sides send back less than the error that D46 finds."""
    share = FOUND * project.config.mesh.accuracy
    if project.mesh.layer is not None:
        return "a larger mesh.size_m moves the layer away from the way of the waves"
    sides = (row.parts["sides"] for row in project.accuracy.rows)
    if max(sides, default=0.0) <= share:
        return ""
    padding = project.accuracy.padding_for(share)
    if padding is None:
        return "hexahedra (mesh.kind) have a layer that sends less back; mesh.padding_m does not"
    return (
        f"mesh.padding_m = {padding:.0f} and the layer of hexahedra (mesh.kind) send back less "
        f"than {100 * share:.2g} %"
    )


def error_finding(project, rows: Sequence[ReceiverError]) -> Finding | None:
    """Return `expected_error` of a project by its rows before a run or after it."""
    return expected_error(rows, project.config.mesh.accuracy, _wider(project))


def expected_error(rows, accuracy: float, wider: str = "") -> Finding | None:
    """D46: receivers whose expected error is above three times the accuracy asked for.

    Parameters
    ----------
    rows : sequence of ReceiverError
    accuracy : float
    wider : str
        What makes the sides send back less.
    """
    wrong = sorted((r for r in rows if r.waveform > FOUND * accuracy), key=lambda r: -r.waveform)
    if not wrong:
        return None
    texts = []
    for cause in dict.fromkeys(row.cause for row in wrong):
        own = [row for row in wrong if row.cause == cause]
        said = [f"{100 * r.waveform:.2g} % at {r.name}" for r in own[:MOST_NAMED]]
        more = f" and {len(own) - MOST_NAMED} more" if len(own) > MOST_NAMED else ""
        remedy = REMEDIES.get(cause, wider).format(
            energy=plain_number(100 * own[0].parts[cause] ** 2, 2),
            carried=plain_number(own[0].carried), ratio=STILLING,
        )  # fmt: skip
        texts.append(f"by {cause} {', '.join(said)}{more} ({remedy})")
    worst = wrong[0]
    return Finding(
        "D46",
        "The error to expect is above the accuracy asked for",
        f"Of the waveform, where {100 * accuracy:.2g} % are asked: {'; '.join(texts)}. The peak at "
        f"{worst.name} may be off by {100 * worst.peak:.2g} %; the table of errors has all "
        "receivers.",
        numbers={"waveform": worst.waveform, "peak": worst.peak, "receivers": float(len(wrong))},
    )


def band_finding(project, band: Band) -> Finding | None:
    """D40: a run that holds less than the band of its blast; None where it holds it.

    It fails no project that states the
    band of its comparison, whose mesh carries that, and whose run holds a third of the peak and a
    ninth of the energy of its blast.
    """
    if band.complete:
        return None
    corner = project.inside.low_pass
    if project.input is not None:
        corner = project.config.input.low_pass_hz
    compared = project.config.run.compare_band_hz
    filtered = "" if corner is None else f" (low-passed at {plain_number(corner)} Hz)"
    return Finding(
        "D40",
        "The run does not hold the motion of the blast",
        f"It holds motion up to {plain_number(band.carried)} Hz{filtered}, the blast has motion up "
        f"to {plain_number(band.needed)} Hz: {100 * band.energy_share:.2g} % of the energy and "
        f"{100 * band.peak_share:.2g} % of the peak of what enters are in the run. '"
        f"{band.limited_by}' decides that.{_steep_front(project)}"
        f"{_price(project, band)} Peaks are those of "
        f"motion below {plain_number(band.carried)} Hz; frequencies and limits are not compared.",
        failed=compared is None or NEARLY * compared[1] > band.carried or not band.of_its_blast,
        numbers={"carried": band.carried, "needed": band.needed, "energy": band.energy_share,
         "peak": band.peak_share},
    )  # fmt: skip


def _steep_front(project):
    """Return a sentence on a pulse by the time of its peak, whose front holds high frequencies."""
    inside = project.config.holes_inside
    hole = None if inside is None else inside.charged_hole
    if hole is None or hole.peak_time_ms is None:
        return ""
    return (
        f" A pulse by peak_time_ms = {plain_number(hole.peak_time_ms)} has the front of a cavity: "
        "frequency_hz in its place gives one of the frequency of records."
    )


def _price(project, band):
    """Return what a mesh for the band of the blast would cost, a sentence."""
    model = project.model
    ratio = {name: band.needed / hz for name, hz in model.highest_frequency().items()}
    ratio[band.limited_by] = max(ratio[band.limited_by], band.needed / band.carried)
    if max(ratio.values()) <= 1.0:
        return " Its mesh carries more; raise low_pass_hz."
    edge = float(model.mean_edges()[band.limited_by]) / ratio[band.limited_by]
    finer = f" Edges of {plain_number(edge, 2)} m there"
    if project.cost is None:
        return f"{finer} carry it."
    other = project.price(at_frequency(project.sized, max(ratio.values())))
    return (
        f"{finer}, in all about {plain_number(other.zones, 2)} zones, carry it in about "
        f"{in_minutes(other.minutes)} in place of {in_minutes(project.cost.minutes)}."
    )


TET_VOLUME = 1.0 / (6.0 * math.sqrt(2.0))


def coarse_zones(name, material, edge, volume, band, per_wave=10.0):
    """D1: a material whose zones do not carry the band of the input; None where they do.

    Whether a receiver suffers by it says finding D40.

    Parameters
    ----------
    per_wave : float
        Edges that a wavelength needs: 3 where zones have 15 nodes.
    """
    carried = material.cs / (per_wave * edge)
    needed = material.cs / (per_wave * band)
    if carried >= band:
        return None
    zones = [volume / (TET_VOLUME * size**3) for size in (edge, needed)]
    digits = 5 if f"{carried:.3g}" == f"{band:.3g}" else 3
    return Finding(
        "D1",
        f"The mesh of '{name}' does not carry the input",
        f"{edge:.{digits}g} m edges carry {carried:.{digits}g} Hz in '{name}' "
        f"({1.25 * carried:.3g} Hz with {0.8 * per_wave:.2g} edges per wavelength), the input has "
        f"{band:.{digits}g} Hz: farther waves above {carried:.{digits}g} Hz are not to be trusted "
        f"there. Edges of at most {needed:.{digits}g} m make "
        f"{plain_number(zones[1] / zones[0], 2)} times as many zones.",
        numbers={"carried": carried, "carried_8": 1.25 * carried, "needed_edge": needed,
                 "zones_now": zones[0], "zones_needed": zones[1]},
    )  # fmt: skip


SOUND_SPEED = 340.0
SAME_INSTANT = 1e-3


def comb_numbers(firing, frequency, band):
    """Return the comb spectrum of the firing times in numbers.

    Returns
    -------
    dict
        ``zeros``, ``lobes`` (list of frequency, height) below the band, ``corner`` (-3 dB),
        ``level`` at ``frequency``, ``band_level`` at the band, ``returns`` (first frequency above
        the band where all holes add up again, None where there is none below ten times the band).
    """
    step = min(0.001 * band, 0.005)
    axis = np.arange(0.0, 10.0 * band, step)
    level = firing.comb_spectrum(axis)
    inner = np.flatnonzero((level[1:-1] < level[:-2]) & (level[1:-1] <= level[2:])) + 1
    outer = np.flatnonzero((level[1:-1] > level[:-2]) & (level[1:-1] >= level[2:])) + 1
    below = np.flatnonzero(level < math.sqrt(0.5))
    whole = [k for k in outer if axis[k] > band and level[k] > 0.99]
    return {
        "zeros": [float(axis[k]) for k in inner if axis[k] <= band and level[k] < 0.01],
        "lobes": [(float(axis[k]), float(level[k])) for k in outer if axis[k] <= band],
        "corner": float(axis[below[0]]) if len(below) else None,
        "level": float(firing.comb_spectrum(frequency)[0]),
        "band_level": float(firing.comb_spectrum(band)[0]),
        "returns": float(axis[whole[0]]) if whole else None,
    }


def firing_comb(firing, frequency, band):
    """D3: the firing times fix the spectrum; None where they hardly change it."""
    comb = comb_numbers(firing, frequency, band)
    if comb["corner"] is None or comb["corner"] > band:
        return None
    zeros = ", ".join(f"{f:.4g}" for f in comb["zeros"][:6])
    zeros = f"zeros at {zeros} Hz" if zeros else "no zeros"
    lobes = ", ".join(f"{h:.2f} at {f:.2f} Hz" for f, h in comb["lobes"][:4])
    lobes = f"side lobes {lobes}" if lobes else "no side lobes"
    return Finding(
        "D3",
        "The firing times fix the spectrum",
        f"They multiply it by a comb with {zeros}, -3 dB at {comb['corner']:.2f} Hz, "
        f"{comb['level']:.2f} at {frequency:.3g} Hz and {lobes}: a dominant frequency "
        "that fits says little about the ground.",
        numbers={"corner": comb["corner"], "level": comb["level"]}
        | {f"zero_{n + 1}": f for n, f in enumerate(comb["zeros"])}
        | {f"lobe_{n + 1}": h for n, (_, h) in enumerate(comb["lobes"])},
    )


def comb_return(firing, frequency, low_passed):
    """D4: the comb returns above the low-pass; None where nothing is filtered or returns."""
    if low_passed is None:
        return None
    band = low_passed.corner
    comb = comb_numbers(firing, frequency, band)
    if comb["returns"] is None:
        return None
    removed = float(np.nanmax(low_passed.removed_energy))
    change = float(np.nanmin(low_passed.ppv_change))
    return Finding(
        "D4",
        "The low-pass cuts where the holes add up again",
        f"The comb is {comb['band_level']:.2f} at the {band:.3g} Hz filter and 1 again at "
        f"{comb['returns']:.3g} Hz; the filter takes up to {100 * removed:.3g} % of a component's "
        f"energy and changes its PPV by up to {100 * change:.3g} %.",
        failed=removed > 0.5,
        numbers={
            "returns": comb["returns"], "band_level": comb["band_level"],
            "removed_energy": removed, "ppv_change": change,
        },
    )  # fmt: skip


def plane_load(distance, reach, material, band):
    """D6: a plane load from a source so near that its front is curved over the face."""
    edge = math.hypot(distance, reach)
    lag = (edge - distance) * band / material.cp
    if edge / distance < 1.2 and lag < 0.1:
        return None
    return Finding(
        "D6",
        "A plane load stands for a near source",
        f"The source is {distance:g} m from the input face, {edge:.0f} m from its edge: over the "
        f"face the amplitude falls {edge / distance:.1f} times (1/r) and lags {lag:.2f} P "
        f"wavelengths at {band:.3g} Hz, but the load is the same everywhere.",
        numbers={"edge": edge, "ratio": edge / distance, "lag": lag},
    )


def layered_face(face, materials):
    """D7: one velocity on a face of several materials."""
    if len(materials) < 2:
        return None
    factors = {n: (2.0 * m.density * m.cp, 2.0 * m.density * m.cs) for n, m in materials.items()}
    listed = ", ".join(f"{n} {p / 1e6:.2f}/{s / 1e6:.2f}" for n, (p, s) in factors.items())
    return Finding(
        "D7",
        "One velocity enters through a layered face",
        f"On '{face}' the same velocity becomes different stresses, in MPa per m/s (normal/shear): "
        f"{listed}; the record was made in one material only.",
        numbers=by_wave(factors),
    )  # fmt: skip


def air_blast_arrival(distances, last_firing, duration):
    """D13: the air blast arrives within records; distances in m by receiver."""
    first = {name: away / SOUND_SPEED for name, away in distances.items()}
    first = {name: time for name, time in first.items() if time <= duration}
    if not first:
        return None
    listed = ", ".join(
        f"{name} from {time:.2f} to {time + last_firing:.2f} s" for name, time in first.items()
    )
    earliest = min(first.values())
    return Finding(
        "D13",
        "The air blast arrives within the record",
        f"At {SOUND_SPEED:g} m/s (assumed) it reaches {listed}: late waves in a record need not be "
        "reflections.",
        numbers={"first": earliest, "last": earliest + last_firing},
    )


def yielding_rock(peak, firing, name, material):
    """D17: the superposed motion may exceed the strength of the rock it comes through."""
    order = np.sort(firing.times)
    together = int(max(np.searchsorted(order, order + SAME_INSTANT) - np.arange(len(order))))
    single = material.density * material.cp * peak
    if not together * single > material.cohesion:
        return None
    return Finding(
        "D17",
        "Superposition may pass through yielding rock",
        f"{1e3 * peak:.0f} mm/s of one hole are {single / 1e6:.1f} MPa in '{name}', {together} "
        f"holes in phase {together * peak:.1f} m/s or {together * single / 1e6:.0f} MPa against a "
        f"cohesion of {material.cohesion / 1e6:.1f} MPa: linear superposition then over-estimates.",
        numbers={"single": single, "together": together * single, "velocity": together * peak},
    )


def no_absorbing_layer(project):
    """D22: sources inside between viscous sides alone; None with a layer, or without such sides."""
    viscous = project.config.boundaries.viscous
    if not viscous or project.absorbing_layer is not None or project.mesh.layer is not None:
        return None
    return Finding(
        "D22",
        "Only dashpots absorb the waves of sources inside",
        f"{', '.join(viscous)}: dashpots absorb well only what comes above about 30 degrees of "
        "incidence, and waves from a source inside graze the sides. The zones are "
        f"{project.meshed.reason}. Hexahedra (mesh.kind) have an absorbing layer of their own; for "
        "tetrahedra give mesh.padding_m, or [absorbing_layer] with a box and a width.",
    )


def short_air_waves(surface, edge, speed, band, per_wave=10.0):
    """D25: zones under an air blast that are too long for its waves; None where they are not.

    With ten edges per wavelength, three where zones have 15 nodes, the motion under it is about
    6 % too small where S waves are faster than sound, half that elsewhere: verification case L2.
    """
    carried = speed / (per_wave * edge)
    if carried >= band:
        return None
    return Finding(
        "D25",
        "The mesh does not carry the air blast",
        f"Edges of {edge:.3g} m at '{surface}' carry {carried:.3g} Hz at {speed:g} m/s, the pulse "
        f"has {band:.3g} Hz: the motion of the ground below is too small or scattered. Edges there "
        f"must be at most {speed / (per_wave * band):.2g} m.",
        failed=True,
        numbers={"carried": carried, "needed_edge": speed / (per_wave * band)},
    )


def charge_fits(charge, diameter, depth, density=ANFO_DENSITY):
    """D20: whether the charge fits into its hole."""
    length = charge / (density * math.pi / 4.0 * diameter**2)
    fits = length < depth
    return Finding(
        "D20",
        "The charge fits its hole" if fits else "The charge does not fit its hole",
        f"{charge:g} kg at {density:g} kg/m3 (assumed) in {1e3 * diameter:g} mm fill "
        f"{length:.1f} m of {depth:g} m.",
        failed=not fits,
        numbers={"length": length},
    )


def holes_within(centres, face, low, high):
    """D27: holes inside the model while their motion enters through a face; None where beyond.

    Parameters
    ----------
    centres : (n_holes, 3) float64, m
    face : str
    low, high : (3,) float64, m
        Corners of the box around the mesh.
    """
    within = int(((centres > low) & (centres < high)).all(axis=1).sum())
    if not within:
        return None
    return Finding(
        "D27",
        "Holes lie inside the model, their motion enters from outside",
        f"{within} of {len(centres)} holes of [blast] lie inside the model, yet the motion enters "
        f"through '{face}' as if they lay beyond it: move blast.position_m, or give "
        "[holes_inside] in place of [signature].",
        numbers={"within": float(within)},
    )
