"""The main job from a project to its output folder: check, run, compare, write."""

import logging
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from ..errors import InputError, PyblastError, ReadError
from ..project.census import Census, take_census
from ..project.checks import Check, check
from ..project.checks_loads import record_findings
from ..project.project import Project, load_project
from ..project.result import (
    Result,
    read_result,
    seismogram_heads,
    source_tables,
    summarise,
    write_result,
    write_summary,
)
from ..recordings.recording import read_recording
from ..report.html import write_report
from ..report.vtk import write_joints, write_motion, write_zones, yield_fields, zone_fields
from ..signals.comparison import Comparison, compare
from ..signals.seismogram import GEOGRAPHIC, Seismogram
from ..solver import preparation
from ..solver import run as solver

CHECKPOINT = "checkpoint.h5"
RESULT = "result.h5"
LARGEST_FOLDER = 9999
log = logging.getLogger(__name__)


class Interrupted(KeyboardInterrupt):
    """A run was stopped; the message says where its checkpoint lies."""


@dataclass(frozen=True, eq=False)
class Outcome:
    """What a run of a project gives.

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


def run(
    project: Project | str | Path,
    output=None,
    *,
    resume: bool = False,
    full: bool = False,
    report: bool = True,
    progress: Callable | None = None,
) -> Outcome:
    """Run a project and write its result, pictures and report.

    Parameters
    ----------
    project : Project or path of a project file
    output : path, optional
        Folder that takes numbered folders, one per run; ``results`` beside the project file by
        default. Earlier results stay.
    resume : bool
        Go on from the checkpoint of the last run that was interrupted.
    full : bool
        Take the table ``[full]`` of the project file.
    report : bool
        Whether to draw the report; `pyblast.report.write_report` can do it later.
    progress : callable, optional
        Called with (stage, done, total).

    Returns
    -------
    Outcome

    Raises
    ------
    InputError, ReadError
        If the project or a file of it is wrong, or there is nothing to resume.
    SolverError
        If the motion is not finite or the static stage does not come to rest.
    """
    tell = progress or (lambda *_: None)
    if not isinstance(project, Project):
        project = load_project(project, full)
    output = project.folder / "results" if output is None else Path(output)
    tell("input", 0, 1)
    log.info("%d motions enter, %d records", len(project.motions), len(project.recorded))
    tell("mesh", 0, 1)
    model = project.model
    tell("check", 0, 1)
    checked = check(project, measure=False)
    prepared = preparation.prepare(model, project.duration, progress)
    folder = interrupted_folder(output) if resume else new_folder(output)
    checkpoint = folder / CHECKPOINT
    try:
        run_ = solver.simulate(
            model,
            project.duration,
            progress=progress,
            checkpoint=checkpoint,
            resume=checkpoint if resume else None,
            snapshot_times=[t + project.lead for t in project.config.run.snapshots_s],
            prepared=prepared,
        )
    except KeyboardInterrupt:
        raise Interrupted(f"checkpoint written to {checkpoint}, go on with --resume") from None
    except PyblastError:
        if not any(folder.iterdir()):
            folder.rmdir()
        raise
    tell("writing", 0, 1)
    outcome = _conclude(project, checked, run_, folder)
    write_outcome(outcome, model)
    if report:
        write_report(outcome.folder / "report.html", outcome.result)
    checkpoint.unlink(missing_ok=True)
    return outcome


def _conclude(project, checked, run_, folder):
    """Compare with records and gather everything in a `Result`."""
    simulated = {n: s.shifted(-project.lead) for n, s in run_.seismograms.items()}
    comparisons = compare_all(project, simulated)
    checked = replace(checked, findings=(*checked.findings, *record_findings(simulated)))
    stages, names = project.input, ("signature", "superposed", "motion")
    groups = {
        "input": {} if stages is None else {name: getattr(stages, name) for name in names},
        "simulated": simulated,
        "recorded": project.recorded,
    }
    mesh, contacts = project.model.mesh, project.model.nodes.contacts
    corners = len(mesh.points)
    arrays = {group: {n: s.velocity for n, s in g.items()} for group, g in groups.items()}
    arrays |= {
        "sources": source_tables(project),
        "mesh": {"points": mesh.points, "zones": mesh.zones},
        "surfaces": dict(mesh.surfaces),
        "zones": zone_fields(project.model),
        "energy": run_.energy,
        "state": run_.state,
        "snapshots": {
            f"{t - project.lead:.6f}": v[:corners] for t, v in run_.snapshots.items()
        },
        "contacts": {} if contacts is None else {
            n: getattr(contacts, n) for n in ("joint", "minus", "plus", "normal", "area")
        },
    }  # fmt: skip
    summary = summarise(project, checked, run_, simulated, comparisons)
    summary["seismograms"] = seismogram_heads(groups)
    result = Result(arrays, summary)
    return Outcome(folder, simulated, comparisons, checked, run_, result)


def compare_all(project, simulated):
    """Compare recorded with simulated motion at every receiver that has a record."""
    band = project.config.run.compare_band_hz
    return {
        name: compare(record, simulated[name], None if band is None else tuple(band))
        for name, record in project.recorded.items()
    }


def write_outcome(outcome, model):
    """Write result file, summary and files for ParaView."""
    folder, run_ = outcome.folder, outcome.run
    write_result(folder / RESULT, outcome.result)
    write_summary(folder / "summary.json", outcome.result.summary)
    mesh, displacement = model.mesh, run_.state["displacement"][: len(model.mesh.points)]
    moved = {"displacement": displacement}
    fields = {**zone_fields(model), **yield_fields(run_)}
    write_zones(folder / "zones.vtu", mesh.points, mesh.zones, fields, moved)
    if mesh.contacts is not None:
        write_joints(folder / "joints.vtu", mesh, displacement)
    snapshots = {t: v[: len(mesh.points)] for t, v in run_.snapshots.items()}
    write_motion(folder, mesh.points, mesh.zones, snapshots)


def new_folder(output):
    """Make the next numbered folder; two runs at once get two folders.

    Raises
    ------
    ReadError
        If the place can't be written.
    """
    for number in range(1, LARGEST_FOLDER):
        folder = Path(output) / f"{number:03d}"
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            continue
        except OSError as error:
            raise ReadError(f"{folder}: can't be made ({error.strerror or error})") from None
        return folder
    raise InputError(f"{output}: holds {LARGEST_FOLDER} results already; give another folder")


def interrupted_folder(output):
    """Return the last folder with a checkpoint and no result."""
    found = [
        path.parent
        for path in sorted(Path(output).glob(f"[0-9]*/{CHECKPOINT}"))
        if not (path.parent / RESULT).exists()
    ]
    if not found:
        raise InputError(f"{output}: nothing to resume; no folder there holds a {CHECKPOINT}")
    return found[-1]


def write_mesh_files(project, output) -> Census:
    """Write ``zones.vtu`` and ``joints.vtu`` of a project into a folder and return its census."""
    output = Path(output)
    try:
        output.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ReadError(f"{output}: can't be made ({error.strerror or error})") from None
    mesh = project.model.mesh
    write_zones(output / "zones.vtu", mesh.points, mesh.zones, zone_fields(project.model))
    write_joints(output / "joints.vtu", mesh)
    return take_census(project)


def compare_files(recorded, simulated, receiver="", band=None, bearing_deg=None) -> Comparison:
    """Compare a record with a receiver of a result file, or with another record.

    Parameters
    ----------
    recorded, simulated : path
    receiver : str
        Of the result file; may be left out where there is only one.
    band : tuple of 2 float, Hz, optional
    bearing_deg : float, optional
        From the instrument to the blast, clockwise from north, for records with a longitudinal
        component.
    """
    bearing = None if bearing_deg is None else math.radians(bearing_deg)
    record = read_recording(recorded, bearing=bearing)[0].seismogram
    if Path(simulated).suffix != ".h5":
        return compare(record, read_recording(simulated, bearing=bearing)[0].seismogram, band)
    result = read_result(simulated)
    found = result.seismograms("simulated")
    if not receiver and len(found) == 1:
        receiver = next(iter(found))
    if receiver not in found:
        raise InputError(f"receiver: must be one of {', '.join(found)}, got {receiver!r}")
    azimuth = result.summary["receivers"][receiver]["azimuth"]
    if azimuth is not None and tuple(record.components) == GEOGRAPHIC:
        record = record.rotated(azimuth)
    return compare(record, found[receiver], band)
