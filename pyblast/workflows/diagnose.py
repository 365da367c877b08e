"""Diagnosis of a case or project, and prediction of a further blast: files in, folder out."""

import hashlib
import json
import shutil
import time
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from obspy import UTCDateTime

from ..blasts.hole_tables import read_blast
from ..diagnosis import library  # noqa: F401  fills the library
from ..diagnosis.calibration import calibrate
from ..diagnosis.case import Case, case_of
from ..diagnosis.decision import Verdict, judge
from ..diagnosis.effects import Scene
from ..diagnosis.forward import Forward
from ..diagnosis.null_distribution import Chance, chance
from ..diagnosis.prediction import effects_of, predict
from ..diagnosis.search import Search, search
from ..diagnosis.summary import summarise
from ..errors import InputError, ReadError
from ..project.case_folder import case_files, read_case_folder
from ..project.flat_box import Discretization, band_of, check_holes, extent_of, flat_box, not_flat
from ..project.plausibility import expected_peaks, level_findings
from ..project.project import Project, load_project, with_further
from ..project.result import plain, write_bytes, write_summary
from ..recordings.seismic import channel_names, mseed_bytes
from ..report.diagnosis import write_diagnosis_report
from ..runs.parallel import WHOLE, code_hash
from ..signals.seismogram import Seismogram
from ..solver.preparation import versions
from . import Interrupted, Progress, Say, numbered_folders, result_folder, silent

RESULT = "diagnosis.json"
REPORT = "report.html"
RUNS = "runs"
STARTED = "unfinished.json"
BUDGET = 400
EDGE, FINE_EDGE = 0.6, 0.38  # edges of quadratic zones, in wavelengths of S at the top of the band
PADDING, FINE_PADDING = 0.2, 0.4  # in wavelengths of S at the bottom of the band
GROWTH, FINE_GROWTH = 1.15, 1.1


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """What was found, and all it was found with.

    Parameters
    ----------
    scene : Scene
    search : Search
    chance : Chance or None
        None where there was nothing to search for.
    verdict : Verdict
    summary : dict
        As in ``diagnosis.json``.
    """

    scene: Scene
    search: Search
    chance: Chance | None
    verdict: Verdict
    summary: dict


def diagnose(
    project: Project,
    folder=None,
    *,
    budget: int = BUDGET,
    seed: int = 1,
    executor: Executor | None = None,
    cuts: tuple[Discretization, Discretization | None] | None = None,
    progress: Callable | None = None,
) -> Diagnosis:
    """Diagnose which physics a project lacks, as far as its records can tell.

    Parameters
    ----------
    project : Project
        With records of at least one blast, and the further blasts of `with_further`.
    folder : path, optional
        Where runs are kept and found: after an interruption the same call goes on.
    budget : int
        Runs of one blast after which no further effect is tried.
    seed : int
        Of the shuffled residuals.
    executor : Executor, optional
        As for `run_all`.
    cuts : tuple of Discretization and Discretization or None, optional
        Discretization of a flat box for the many runs, and for the few that correct them; by
        wavelengths if not given. Any other project is run on its own mesh, without correction.
    progress : callable, optional
        Called with (stage, done, total).

    Returns
    -------
    Diagnosis

    Raises
    ------
    InputError
        If the records can't be compared.
    SolverError
        If a run fails.
    """
    tell, began = progress or (lambda *_: None), time.perf_counter()
    case = case_of(project)
    rough, fine = cuts or (cut_of(case.project), cut_of(case.project, fine=True))
    forward = Forward(case, rough, folder, executor)
    finer = None if fine is None else Forward(case, fine, folder, executor)
    tell("calibration", 0, 1)
    baseline = calibrate(forward, finer)
    tell("holes", 0, 1)
    scene = Scene(forward, baseline, forward.hole_motion(baseline.project))
    found = search(scene, budget, tell)
    shuffled = chance(scene, found.none, found.guesses, found.fits, seed) if found.fits else None
    verdict = judge(found, shuffled, finer)
    summary = summarise(scene, found, shuffled, verdict)
    used = [forward] if finer is None else [forward, finer]
    summary |= {
        "runs": sum(one.runs for one in used),
        "wall_s": round(time.perf_counter() - began, 1),
        "kept_runs": sum(one.kept for one in used),
        "kept_s": round(sum(one.kept_s for one in used), 1),
        "seed": seed,
        "budget": budget,
        "finished": found.finished,
    }
    return Diagnosis(scene, found, shuffled, verdict, plain(summary))


def cut_of(project: Project, fine: bool = False) -> Discretization | None:
    """Return the discretization of a flat box into quadratic zones for its band, else None.

    The slowest layer that is no thinner than half its shortest wavelength counts: thinner ones
    have cells of their own height.
    """
    if not_flat(project):
        return None
    low, high = band_of(project.config)
    layers = [(project.materials[name].cs, t) for name, t in flat_box(project).layers]
    speeds = [cs for cs, thickness in layers if thickness is None or thickness > 0.5 * cs / high]
    edge, padding, growth = (
        (FINE_EDGE, FINE_PADDING, FINE_GROWTH) if fine else (EDGE, PADDING, GROWTH)
    )
    slowest = min(speeds)
    return Discretization(
        edge * slowest / high, padding * slowest / low, growth, quadratic=True, single=True
    )


def read_case(path) -> Project:
    """Read a case folder, or a project file with its further blasts."""
    path = Path(path)
    return read_case_folder(path) if path.is_dir() else with_further(load_project(path))


def diagnose_folder(
    folder, output, *, budget=BUDGET, seed=1, executor=None, progress=None, runs=None, say=silent
) -> dict:
    """Diagnose a case folder or a project and write ``diagnosis.json`` and ``report.html``.

    Parameters
    ----------
    folder : path
        With ``site.toml``, hole tables and records; or a project file.
    output : path
        Folder for the result; runs are kept in its folder ``runs``, so that the same call goes on
        after an interruption, and a finished diagnosis of the same files is only read.
    budget, seed, executor, progress
        As of `diagnose`.
    runs : path, optional
        Another folder for the runs.
    say : callable
        Called with a sentence on implausible peaks.

    Returns
    -------
    dict
        As in ``diagnosis.json``.
    """
    output = Path(output)
    provenance = versions(_hash_of(folder)) | {"code_sha256": code_hash(WHOLE)}
    known = _finished(output, provenance, budget, seed)
    if known is not None:
        return known
    project = read_case(folder)
    _say_level(project, say)
    try:
        output.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"--out {output}: can't be made ({error.strerror})") from None
    made = diagnose(
        project,
        runs or output / RUNS,
        budget=budget,
        seed=seed,
        executor=executor,
        progress=progress,
    )
    summary = {"case": project.title, **made.summary, "provenance": provenance}
    write_diagnosis_report(output / REPORT, made, summary)
    write_summary(output / RESULT, summary)
    return plain(summary)


def _hash_of(folder):
    """Return the hash of all files of a case, or of all that a project names."""
    digest = hashlib.sha256()
    try:
        if not Path(folder).is_dir():
            for one in _blasts(folder):
                digest.update(json.dumps(one.input_files, sort_keys=True).encode())
            return digest.hexdigest()
        for path in case_files(folder):
            digest.update(path.name.encode() + path.read_bytes())
    except ReadError:
        raise
    except OSError as error:
        raise ReadError(f"{error.filename}: can't be read ({error.strerror})") from None
    return digest.hexdigest()


def _decisive(provenance):
    """Return what a result depends on: all of its provenance but the number of threads."""
    return {key: value for key, value in provenance.items() if key != "threads"}


def _finished(output, provenance, budget, seed):
    """Return the diagnosis that is there already for the same input, or None."""
    try:
        known = json.loads((output / RESULT).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    if not isinstance(known, dict):
        return None
    before = known.get("provenance")
    same = isinstance(before, dict) and _decisive(before) == _decisive(provenance)
    return known if same and (known.get("budget"), known.get("seed")) == (budget, seed) else None


def predict_file(folder, output, summary, holes, path, baseline=False, runs=None):
    """Write the predicted motion of a further blast at the receivers, as miniSEED.

    Parameters
    ----------
    folder, output : path
        As of `diagnose_folder`.
    summary : dict
        What it returned.
    holes : path
        Table of the holes of the further blast.
    path : path
        Of the file; it has the channels, the sampling and the start of the last recorded blast. A
        project file gives no instants: the first hole then fires as 1970 begins.
    baseline : bool
        Without the effects: calibrated alone.
    runs : path, optional
        Another folder for the runs.
    """
    case, model = case_of(read_case(folder)), summary["model"]
    blast = _further(case, holes)
    values = model["baseline_values"] if baseline else model["values"]
    effects = () if baseline else effects_of(model)
    folder_of_runs = runs or Path(output) / RUNS
    motion = predict(case, cut_of(case.project, fine=True), blast, values, effects, folder_of_runs)
    write_bytes(path, _as_recorded(case, motion))


def check_further(folder, holes, outputs=(), out=None):
    """Check, before a diagnosis into ``out``, that it could predict a further blast into files.

    Raises
    ------
    InputError, ReadError
        If the table of its holes is no good, a hole lies outside of the box or fires after the
        records end, a file can't hold the names of the receivers, or it can't be written.
    """
    case = case_of(read_case(folder))
    _further(case, holes)
    _channels(case)
    made = None if out is None else Path(out).resolve()
    taken = {path.resolve() for path in (Path(holes), *_inputs(Path(folder)))}
    taken |= set() if made is None else {made / RESULT, made / REPORT}
    for one in outputs:
        path = Path(one).resolve()
        if path in taken:
            raise InputError(f"{one}: is read or written by the diagnosis; give another file name")
        if path.is_dir() or not (path.parent.is_dir() or path.parent == made):
            raise InputError(f"{one}: must be a file in a folder that is there, or in --out")
        taken.add(path)


def _inputs(folder):
    """Return the files of a case, or all that a project and its further blasts name."""
    if folder.is_dir():
        return case_files(folder)
    return [one.folder / name for one in _blasts(folder) for name in one.input_files]


def _blasts(path):
    """Return the projects of a project file and of its further blasts."""
    project = with_further(load_project(path))
    return project, *project.further


def _further(case, holes):
    """Read the table of the holes of a further blast, in the coordinates of the project."""
    blast = read_blast(holes)
    if case.project.config.holes_inside is not None:
        check_holes(extent_of(case.project), holes, blast)
    elif case.project.config.blast is None:
        raise InputError(f"{holes}: the project has no [blast] in whose place it could fire")
    late = int(np.argmax(blast.times))
    if blast.times[late] >= case.duration:
        raise InputError(
            f"{holes}: hole {blast.hole_ids[late]}: fires at {blast.times[late]:g} s, but what is "
            f"predicted ends as the records do, at {case.duration:.3g} s; split the blast"
        )
    return blast


def _as_recorded(case: Case, motion):
    """Return motion as a file with the sampling and the start of the records of the last blast."""
    last = _as_fired(case)[-1]
    first = next(iter(last.records.values())).seismogram
    sampling = first.start, case.dt, len(first.velocity)
    whole = np.stack(
        [Seismogram(one.T, case.dt, 0.0).sampled(*sampling).velocity.T for one in motion]
    )
    start = UTCDateTime(last.time_zero or 0) + first.start
    return mseed_bytes(whole, _channels(case), case.dt, str(start))


def _channels(case: Case):
    """Return the names of the channels of each receiver, as they were recorded last."""
    every = [one.records for one in reversed(_as_fired(case))]
    records = {name: next(some[name] for some in every if name in some) for name in case.receivers}
    return [
        channel_names(name, record.header.get("channels", {}), case.dt)
        for name, record in records.items()
    ]


def _as_fired(case: Case):
    """Return the blasts, the last one last, as listed where no instants are given."""
    every = case.project, *case.project.further
    return sorted(every, key=lambda one: UTCDateTime(one.time_zero or 0))


def _say_level(project: Project, say: Say) -> None:
    """Say of which blasts the recorded peaks, or those that are expected, are implausible."""
    for each in (project, *project.further):
        for finding in level_findings(each, expected_peaks(each)):
            say(f"{finding.code}: {each.name}: {finding.title}. {finding.text}")


def diagnose_case(
    case: str | Path,
    out: str | Path | None = None,
    *,
    fresh: bool = False,
    budget: int = BUDGET,
    seed: int = 1,
    executor: Executor | None = None,
    progress: Progress | None = None,
    say: Say | None = None,
) -> tuple[dict, Path]:
    """Diagnose which physics a model lacks, where, and whether the records support it.

    Parameters
    ----------
    case : path
        Folder with ``site.toml``, hole tables and records; or a project file.
    out : path, optional
        Folder that takes numbered folders, one per diagnosis, and the runs in ``runs``, from which
        the same call goes on; ``diagnosis`` beside the project file or in the case folder by
        default. A finished diagnosis of the same input is only read.
    fresh : bool
        Start anew, and run all models again.
    budget : int
        Runs of one blast after which no further effect is tried.
    seed : int
        Of the permuted residuals.
    executor : concurrent.futures.Executor, optional
        Such as `workers`; the result does not depend on it.
    progress : callable, optional
        Called with (stage, done, total).
    say : callable, optional
        Called with a sentence when a diagnosis is read or goes on, and of implausible peaks.

    Returns
    -------
    dict
        Content of ``diagnosis.json``.
    Path
        Folder with ``diagnosis.json`` and ``report.html``.

    Raises
    ------
    InputError, ReadError
        If the case or a file of it is wrong.
    SolverError
        If a run fails.
    """
    case, say = Path(case), say or silent
    folder = case if case.is_dir() else case.parent
    out = folder / "diagnosis" if out is None else Path(out)
    provenance = versions(_hash_of(case)) | {"code_sha256": code_hash(WHOLE)}
    if fresh:
        shutil.rmtree(out / RUNS, ignore_errors=True)
    for one in [] if fresh else numbered_folders(out):
        known = _finished(one, provenance, budget, seed)
        if known is not None:
            say(f"this diagnosis is finished: {one}; --fresh would make it anew")
            return known, one
    started = {"input_sha256": provenance["input_sha256"], "budget": budget, "seed": seed}
    with result_folder(out, lambda one: _started(one) == started, fresh=fresh, say=say) as place:
        write_summary(place[0] / STARTED, started)
        try:
            summary = diagnose_folder(
                case, place[0], budget=budget, seed=seed, executor=executor, progress=progress,
                runs=out / RUNS, say=say,
            )  # fmt: skip
        except (InputError, ReadError):
            (place[0] / STARTED).unlink()
            raise
        except KeyboardInterrupt:
            raise Interrupted(
                f"the runs made are kept in {out / RUNS}; the same command goes on from there"
            ) from None
        (place[0] / STARTED).unlink()
    return summary, place[0]


def _started(folder):
    """Return what an unfinished diagnosis in a folder was started with, or None."""
    try:
        return json.loads((folder / STARTED).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None


def predict_case(
    case: str | Path,
    folder: str | Path,
    holes: str | Path,
    path: str | Path,
    *,
    baseline: bool = False,
) -> None:
    """Predict the motion of a further blast with a diagnosed model, as a miniSEED file.

    Parameters
    ----------
    case : path
        As of `diagnose_case`.
    folder : path
        Of the diagnosis: one with ``diagnosis.json``.
    holes : path
        Table of the holes of the further blast.
    path : path
        Of the file to write, with the channels, sampling and start of the last recorded blast.
    baseline : bool
        Predict with the calibrated model alone, without the effects that were found.

    Raises
    ------
    InputError, ReadError
        If the holes lie outside of the model, or a file can't be read or written.
    """
    folder = Path(folder)
    try:
        summary = json.loads((folder / RESULT).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ReadError(f"{folder / RESULT}: can't be read ({error}); diagnose first") from None
    check_further(case, holes, [Path(path)], folder)
    predict_file(case, folder, summary, holes, path, baseline, folder.parent / RUNS)
