"""Simulation of a project: check, run, compare with records, write result and report."""

import logging
import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..blasts.compliance import compliance_csv
from ..errors import Finding, InputError, ReadError
from ..files import plain, write_summary, write_text
from ..inference.variation import COHERENT, ENDS, Charges, Scatter, Span, peaks_with_and_without
from ..model.model import Model
from ..project.checks import Check, check, error_finding
from ..project.checks_ground import ModelSummary, summarise_model
from ..project.elastic_ground import soil_strain
from ..project.level import CODE as LEVEL
from ..project.level import (
    Peak,
    energy_finding,
    implausible_level,
    level_findings,
    peak_of,
    plausible_of_table,
    simulated_peaks,
    source_energy,
)
from ..project.places import source_tables
from ..project.project import Project, load_project
from ..project.result import (
    Result,
    read_result,
    record_findings,
    seismogram_heads,
    summarise_run,
    write_csv,
    write_result,
)
from ..project.stability import Stability
from ..recordings.recording import first_recording, read_recording
from ..report.exports import write_features
from ..report.maps import (
    surface_of,
    write_joints,
    write_motion,
    write_surface,
    write_zones,
    yield_fields,
    zone_fields,
)
from ..report.run import write_report
from ..report.view import ModelView
from ..signals.comparison import Comparison, compare
from ..signals.response_spectra import response_spectra
from ..signals.seismogram import GEOGRAPHIC, Seismogram, ZeroPhase
from ..signals.spectra import smoothed_spectrum
from ..solver import preparation
from ..solver import run as solver
from ..solver.model_file import read_arrays
from ..solver.run import Run
from ..units import plain_number
from . import Interrupted, Progress, Say, csv_table, result_folder, silent, write_tables

CHECKPOINT = "checkpoint.h5"
ENERGY, ERROR = "D21", "D46"
RESULT = "result.h5"
COARSER = 5.0  # error of the mesh by which that of a run is measured, over it
JOINT_HEADS = {
    "largest_slip_mm": ("largest_slip", 1e3), "slip_time_ms": ("slip_time", 1e3),
    "remaining_slip_mm": ("remaining_slip", 1e3), "largest_opening_mm": ("largest_opening", 1e3),
    "remaining_opening_mm": ("remaining_opening", 1e3), "area_m2": ("area", 1.0),
    "yielded_area_m2": ("yielded_area", 1.0), "safety_before": ("safety_before", 1.0),
    "safety_least": ("safety_least", 1.0), "safety_least_time_ms": ("safety_least_time", 1e3),
    "safety_after": ("safety_after", 1.0), "first_slips_at_times_this_blast": ("margin", 1.0),
}  # fmt: skip
OF_DIFFERENCE = 0.5  # error of a run over its difference to that: 0.6 to 1.7 times the exact one
log = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class Outcome:
    """Result of a run of a project.

    Parameters
    ----------
    folder : Path
    seismograms : dict of str to Seismogram
        Simulated, by receiver; zero time is the first firing.
    comparisons : dict of str to Comparison
        Of receivers with a record.
    check : Check
    run : Run
    result : Result
    """

    folder: Path
    seismograms: dict[str, Seismogram]
    comparisons: dict[str, Comparison]
    check: Check
    run: solver.Run
    result: Result


class SuperposedBands(NamedTuple):
    """Central 90 % of the peaks of a superposed blast whose holes vary, (2, 3) m/s.

    ``alike`` if all holes radiated as their charge says; lower and upper ends, by component.
    """

    varied: np.ndarray
    alike: np.ndarray


def superposed_bands(project: Project) -> SuperposedBands:
    """Return the bands of the peaks of the blast that enters, by [priors] of a project.

    Parameters
    ----------
    project : Project
        With a motion that enters through a face.

    Notes
    -----
    theory.md (12.9); filters of holes vary over the middle 90 % of the energy of the signature.
    """
    stages, priors = project.input, project.config.priors
    assert stages is not None
    hole, firing = stages.signature, stages.firing
    last = int(np.ptp(firing.times) / hole.dt) + 1
    motion = np.pad(np.nan_to_num(hole.velocity.T), ((0, 0), (0, last)))
    power = np.cumsum(np.sum(np.abs(np.fft.rfft(motion)) ** 2, axis=0))
    hz = np.fft.rfftfreq(motion.shape[-1], hole.dt)
    low, high = np.interp([0.05, 0.95], power / power[-1], hz)
    blast, n = project.blast, len(firing.times)
    places = np.outer(COHERENT * np.arange(n), [1.0, 0.0, 0.0]) if blast is None else blast.centres
    charges = Charges(
        firing.scales[:, None, None, None] * motion, firing.times - firing.times.min(),
        places,
    )  # fmt: skip
    scatter = Scatter(1e-2 * priors.holes_percent, 1e-3 * priors.firing_ms)
    drawn = peaks_with_and_without(charges, Span(low, high, hole.dt), scatter)
    return SuperposedBands(*np.quantile(drawn[:, :, 0], ENDS, axis=1).swapaxes(0, 1))


def run(
    project: Project | str | Path,
    out: str | Path | None = None,
    *,
    fresh: bool = False,
    full: bool = False,
    report: bool = True,
    error: bool = False,
    progress: Progress | None = None,
    say: Say | None = None,
) -> Outcome:
    """Run the whole chain of a project file: input, check, simulation, comparison, files, report.

    Parameters
    ----------
    project : Project or path of a project file
    out : path, optional
        Folder that takes numbered folders, one per run; ``results`` beside the project file by
        default. Earlier results stay. An interrupted run of the same input goes on.
    fresh : bool
        Start anew beside an interrupted run.
    full : bool
        Take the table ``[full]`` of the project file.
    report : bool
        Whether to draw the report; `write_report` can do it later.
    error : bool
        Whether to measure the error at each receiver by a coarser run, see `measured_errors`.
    progress : callable, optional
        Called with (stage, done, total).
    say : callable, optional
        Called with a sentence when an interrupted run goes on.

    Returns
    -------
    Outcome

    Raises
    ------
    InputError, ReadError
        If the project or a file of it is wrong.
    SolverError
        If the motion is not finite or the initial stress does not come to rest.

    See Also
    --------
    Project.simulate : the motion alone, without files.
    """
    tell = progress or silent
    if not isinstance(project, Project):
        project = load_project(project, full)
    out = project.folder / "results" if out is None else Path(out)
    tell("input", 0, 1)
    log.info("%d motions enter, %d records", len(project.shot.motions), len(project.recorded))
    tell("mesh", 0, 1)
    model = project.model
    tell("check", 0, 1)
    checked = check(project)
    prepared = preparation.prepare(model, project.duration, progress)
    stability = None
    if model.joints:
        stability = Stability(project, prepared, checked.summary.removable > 0)

    def unfinished(folder: Path) -> bool:
        return _is_checkpoint_of(folder, prepared.fingerprint)

    with result_folder(out, unfinished, fresh=fresh, say=say) as (folder, goes_on):
        checkpoint = folder / CHECKPOINT
        try:
            run_ = solver.simulate(
                model,
                project.duration,
                progress=progress,
                checkpoint=checkpoint,
                resume=checkpoint if goes_on else None,
                snapshot_times=[t + project.lead for t in project.config.run.snapshots_s],
                prepared=prepared,
                peaks_to=project.shot.highest_frequency,
                observer=stability and stability.observer,
            )
        except KeyboardInterrupt:
            raise Interrupted(
                f"checkpoint written to {checkpoint}; the same command goes on from there"
            ) from None
        tell("writing", 0, 1)
        outcome = _conclude(project, checked, run_, folder, stability)
        if error:
            for name, value in measured_errors(project, outcome.seismograms, progress).items():
                outcome.result.summary["receivers"][name]["expected_error"]["measured"] = value
        write_outcome(outcome, model)
        if report:
            write_report(outcome.folder / "report.html", outcome.result)
        checkpoint.unlink(missing_ok=True)
    return outcome


def measured_errors(
    project: Project, simulated: dict[str, Seismogram], progress: Progress | None = None
) -> dict[str, float]:
    """Return the error of a run over its motion by receiver, by a run on a coarser mesh.

    The coarser mesh has five times the error by its rule, at about 0.4 of the work on hexahedra
    and 0.16 on tetrahedra; half of the difference is taken for the error, since that of coarse
    meshes grows more slowly. What both runs share, such as sides and the fit of Q, is not seen.

    Raises
    ------
    InputError
        If the mesh has no coarser one: it is read from a file or is a grid of tetrahedra.
    """
    table = project.refined(COARSER)
    if table is None:
        raise InputError(
            f"{project.path.name}: --error: needs a coarser mesh, and this one is read from a file "
            "or a grid of tetrahedra; give mesh.edge_m or mesh.frequency_hz in its place"
        )
    coarser = project.changed(mesh=table).simulate(progress=progress).seismograms
    errors = {}
    for name, motion in simulated.items():
        other = coarser[name]
        moved = np.column_stack(
            [np.interp(motion.times, other.times, each) for each in other.velocity.T]
        )
        size = max(float(np.linalg.norm(motion.velocity)), 1e-300)
        errors[name] = OF_DIFFERENCE * float(np.linalg.norm(moved - motion.velocity)) / size
    return errors


def conclude_program_run(
    project: Project, stored: str | Path, out: str | Path | None = None
) -> Outcome:
    """Compare, tabulate and report what the program ``pyblast-run`` computed for a project.

    Parameters
    ----------
    project : Project
        Whose model ``pyblast run --write-model`` wrote.
    stored : path
        Result of ``pyblast-run``.
    out : path, optional
        Folder that takes numbered folders; ``results`` beside the project file by default.

    Raises
    ------
    InputError, ReadError
        If the file is damaged or belongs to another model.
    """
    checked = check(project)
    prepared = preparation.prepare(project.model, project.duration)
    run_ = solver.integrated(project.model, prepared, stored)
    out = project.folder / "results" if out is None else Path(out)
    with result_folder(out, lambda _: False) as (folder, _):
        outcome = _conclude(project, checked, run_, folder)
        write_outcome(outcome, project.model)
        write_report(outcome.folder / "report.html", outcome.result)
    return outcome


def _is_checkpoint_of(folder: Path, fingerprint: str) -> bool:
    """Tell whether a folder holds the checkpoint of a model and no result."""
    path = folder / CHECKPOINT
    if (folder / RESULT).exists() or not path.exists():
        return False
    try:
        attributes = read_arrays(path)[1]
    except ReadError as error:
        log.warning("checkpoint left aside: %s", error)
        return False
    return attributes.get("input_sha256") == fingerprint


def _conclude(
    project: Project,
    checked: Check,
    run_: Run,
    folder: Path,
    stability: Stability | None = None,
) -> Outcome:
    """Compare with records and gather everything in a `Result`."""
    simulated = project.simulated(run_.seismograms)
    comparisons = compare_all(project, simulated)
    complete = "D40" not in {finding.code for finding in checked.findings}
    judged = (ENERGY, ERROR, *((LEVEL,) if complete else ()))  # again, by the run
    before = (finding for finding in checked.findings if finding.code not in judged)
    level = level_findings(project, simulated_peaks(project, simulated, complete))
    energy = energy_finding(source_energy(project, run_.energy["input"]))
    error = error_finding(project, project.accuracy.of_run(simulated))
    of_run = energy, error, soil_strain(project.model, simulated)
    after = (*(each for each in of_run if each is not None), *record_findings(simulated))
    checked = replace(checked, findings=(*level, *before, *after))
    stages, names = project.input, ("signature", "superposed", "motion")
    groups = {
        "input": {} if stages is None else {name: getattr(stages, name) for name in names},
        "simulated": simulated,
        "recorded": project.recorded,
    }
    shown, contacts = project.model.shown, project.model.nodes.contacts
    fields = {**zone_fields(project.model), **yield_fields(run_)}
    mesh, (points, triangles, node) = shown.mesh, surface_of(project.model)
    surface = points, triangles, run_.peak_velocity[node]
    arrays = {group: {n: s.velocity for n, s in g.items()} for group, g in groups.items()}
    arrays |= {
        "sources": source_tables(project),
        "mesh": {"points": mesh.points, "zones": mesh.zones},
        "surfaces": dict(mesh.surfaces),
        "zones": {n: v[shown.zone] for n, v in fields.items()},
        "energy": run_.energy,
        "state": run_.state,
        "surface_peaks": dict(zip(("points", "triangles", "velocity"), surface, strict=True)),
        "snapshots": {
            f"{t - project.lead:.6f}": v[shown.node] for t, v in run_.snapshots.items()
        },
        "contacts": {} if contacts is None else {
            n: getattr(contacts, n) for n in ("joint", "minus", "plus", "normal", "area")
        } | {"place": project.model.nodes.points[contacts.minus]},
    }  # fmt: skip
    summary = summarise_run(project, checked, run_, simulated, comparisons)
    summary["seismograms"] = seismogram_heads(groups)
    summary["stability"] = stability and stability.table(run_)
    if stability is not None:
        observed = stability.arrays()
        arrays["contacts"] |= observed["contacts"]
        arrays["joint_histories"] = observed["joint_histories"]
    result = Result(arrays, summary)
    return Outcome(folder, simulated, comparisons, checked, run_, result)


def compare_all(project: Project, simulated: dict[str, Seismogram]) -> dict[str, Comparison]:
    """Compare recorded with simulated motion at every receiver that has a record."""
    asked = project.config.run.compare_band_hz
    band = None if asked is None else (asked[0], asked[1])
    return {
        name: compare(record.seismogram, simulated[name], band)
        for name, record in project.comparable.items()
    }


def write_outcome(outcome: Outcome, model: Model) -> None:
    """Write result file, summary and files for ParaView."""
    folder, run_ = outcome.folder, outcome.run
    write_result(folder / RESULT, outcome.result)
    summary = plain(outcome.result.summary)
    write_summary(folder / "summary.json", summary)
    write_tables(folder, result_tables(summary))
    write_curves(folder / "curves", outcome.result)
    write_surface(folder, outcome.result)
    write_features(folder / "features.geojson", outcome.result)
    shown = model.shown
    mesh, displacement = shown.mesh, run_.state["displacement"][shown.node]
    peak = run_.peak_velocity[shown.node]
    moved = {"displacement": displacement, "peak_velocity": peak}
    fields = outcome.result.arrays["zones"]
    write_zones(folder / "zones.vtu", mesh.points, mesh.zones, fields, moved)
    write_joints(folder, mesh, displacement)
    snapshots = {t: v[shown.node] for t, v in run_.snapshots.items()}
    write_motion(folder, mesh.points, mesh.zones, snapshots)


def result_tables(summary: dict) -> dict[str, str]:
    """Return the tables of a result as CSV, by name.

    Parameters
    ----------
    summary : dict
        Content of ``summary.json``.
    """
    heads = (
        "receiver", "motion", "component", "x_m", "y_m", "z_m", "ppv_mm_per_s",
        "dominant_frequency_hz", "zero_crossing_frequency_hz", "duration_s",
        "energy_after_1_s_percent", "vector_sum_mm_per_s", "expected_error", "expected_peak_error",
        "cause_of_error",
    )  # fmt: skip
    receivers = [
        [
            name, kind, component, *table["position"], _times(1e3, motion["ppv"][n]),
            motion["dominant_frequency"][n], motion["zero_crossing_frequency"][n],
            motion["duration"][n], _times(100.0, motion["late_energy"][n]),
            _times(1e3, motion["pvs"]),
            *(table["expected_error"][key] if kind == "simulated" else None
              for key in ("waveform", "peak", "cause")),
        ]
        for name, table in summary["receivers"].items()
        for kind in ("simulated", "recorded") if (motion := table[kind]) is not None
        for n, component in enumerate(motion["components"])
    ]  # fmt: skip
    deviations = ("ppv_deviation", "frequency_deviation", "duration_deviation", "waveform_misfit",
                  "lag", "correlation")  # fmt: skip
    comparisons = [
        [name, component, *(table[key][n] for key in deviations), air.get("overpressure"),
         air.get("db")]
        for name, table in summary["comparisons"].items()
        for air in [summary["instruments"].get(name, {})]
        for n, component in enumerate(table["components"])
    ]  # fmt: skip
    tables = {
        "receivers": csv_table(heads, receivers),
        "compliance": compliance_csv(summary["compliance"]["rows"]),
        "findings": csv_table(
            ("code", "failed", "title", "text"),
            [[f["code"], "yes" if f["failed"] else "no", f["title"], f["text"]]
             for f in summary["findings"]],
        ),
    }  # fmt: skip
    stability = summary.get("stability") or {"joints": {}}
    if stability["joints"]:
        tables["joints"] = csv_table(("joint", *JOINT_HEADS), [
            [name, *(_times(factor, row[key]) for key, factor in JOINT_HEADS.values())]
            for name, row in stability["joints"].items()
        ])  # fmt: skip
    if comparisons:
        tables["comparisons"] = csv_table(
            ("receiver", "component", *deviations[:4], "lag_s", "correlation",
             "recorded_air_overpressure_pa", "recorded_air_overpressure_db"), comparisons
        )  # fmt: skip
    if summary["blast"] is not None:
        tables["holes"] = csv_table(
            ("hole", "x_m", "y_m", "z_m", "x_toe_m", "y_toe_m", "z_toe_m", "charge_kg", "time_ms"),
            [[h["id"], *h["collar"], *h["toe"], h["charge"], _times(1e3, h["time"])]
             for h in summary["blast"]["holes"]],
        )  # fmt: skip
    return tables


def _times(factor, value):
    """Multiply a value that may be missing."""
    return None if value is None else factor * value


def write_curves(folder: Path, result: Result) -> None:
    """Write every motion of a result as a CSV table that `read_recording` reads, and its spectra.

    The files are ``GROUP_RECEIVER.csv``, with ``_spectrum`` the smoothed spectrum, with
    ``_response`` PSV, SD and SA at 5 % damping, for the groups input, simulated and recorded.
    """
    for group in ("input", "simulated", "recorded"):
        for name, motion in result.seismograms(group).items():
            stem = "".join(c if c.isalnum() or c in "-_." else "_" for c in f"{group}_{name}")
            write_csv(folder / f"{stem}.csv", motion)
            spectrum = smoothed_spectrum(motion)
            write_text(folder / f"{stem}_spectrum.csv", csv_table(
                ("frequency_hz", *(f"{c}_m" for c in motion.components)),
                np.column_stack([spectrum.frequency, spectrum.amplitude]),
            ))  # fmt: skip
            response = response_spectra(motion)
            kinds = {"psv_{}_m_per_s": response.psv, "sd_{}_m": response.sd,
                     "sa_{}_m_per_s2": response.sa}  # fmt: skip
            heads = [kind.format(c) for kind in kinds for c in motion.components]
            write_text(folder / f"{stem}_response.csv", csv_table(
                ("frequency_hz", *heads),
                np.column_stack([response.frequency, *kinds.values()]),
            ))  # fmt: skip


def write_mesh_files(project: Project, out: str | Path) -> ModelSummary:
    """Write ``zones.vtu``, ``model.vtm`` with its joints, and the page ``view.html``.

    Returns
    -------
    ModelSummary
    """
    out = Path(out)
    shown = project.model.shown
    mesh = shown.mesh
    fields = {name: values[shown.zone] for name, values in zone_fields(project.model).items()}
    write_zones(out / "zones.vtu", mesh.points, mesh.zones, fields)
    write_joints(out, mesh)
    write_text(out / "view.html", ModelView(project).page())
    return summarise_model(project)


def compare_files(
    recorded: str | Path,
    simulated: str | Path,
    receiver: str = "",
    band: tuple[float, float] | None = None,
    bearing_deg: float | None = None,
    sheet: str | None = None,
    unit: str | None = None,
    low_passed_hz: float | None = None,
    zero_phase: bool = False,
) -> tuple[Comparison, Finding | None, list[str]]:
    """Compare a record with a receiver of a result file, or with another record.

    Returns the finding about the level, too, where a result says what is plausible there, and
    sentences on the air overpressure of records with a microphone.

    Parameters
    ----------
    recorded, simulated : path
    receiver : str
        Of the result file; may be left out where there is only one.
    band : tuple of 2 float, Hz, optional
    bearing_deg : float, optional
        From the instrument to the blast, clockwise from north, for records with a longitudinal
        component.
    sheet : str, optional
        Of the record, where it is a workbook.
    unit : str, optional
        Of both, where they are in a seismological format; see `read_recording`.
    low_passed_hz : float, Hz, optional
        Corner of the low-pass of the sources of a prediction, which seismological formats don't
        say.
    zero_phase : bool
        Whether that is of zero phase.
    """
    bearing = None if bearing_deg is None else math.radians(bearing_deg)
    read = first_recording(
        recorded, read_recording(recorded, bearing=bearing, sheet=sheet, unit=unit)
    )
    record, air = read.seismogram, _air_lines(recorded, read)
    if Path(simulated).suffix != ".h5":
        other = first_recording(simulated, read_recording(simulated, bearing=bearing, unit=unit))
        lines, predicted = air + _air_lines(simulated, other), other.seismogram
        if low_passed_hz is not None:
            kind = ZeroPhase if zero_phase else float
            predicted = replace(predicted, low_passed=kind(low_passed_hz))
        return compare(record, predicted, band), None, lines
    result = read_result(simulated)
    motions = result.seismograms("simulated")
    if not receiver and len(motions) == 1:
        receiver = next(iter(motions))
    if receiver not in motions:
        raise InputError(f"receiver: must be one of {', '.join(motions)}, got {receiver!r}")
    table = result.summary["receivers"][receiver]
    azimuth = table["azimuth"]
    if azimuth is not None and tuple(record.components) == GEOGRAPHIC:
        record = record.rotated(azimuth)
    plausible = plausible_of_table(table)
    peaks = (
        Peak(f"{receiver}, recorded", peak_of(record), plausible, recorded=True),
        Peak(f"{receiver}, simulated", peak_of(motions[receiver]), plausible),
    )
    return compare(record, motions[receiver], band), implausible_level(peaks), air


def _air_lines(path, recording):
    """Return the sentence on the air overpressure of a record, none without a microphone."""
    if recording.overpressure is None:
        return []
    return [
        f"{Path(path).name}: air overpressure {plain_number(recording.peak_overpressure)} Pa, "
        f"{recording.peak_overpressure_db:.1f} dB(L)"
    ]
