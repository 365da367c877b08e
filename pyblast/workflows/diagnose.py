"""Diagnosis of a project, and prediction of a further blast: files in, folder out."""

import hashlib
import json
import shutil
import time
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from obspy import UTCDateTime

from ..blasts.hole_tables import read_blast
from ..diagnosis.calibration import calibrate, taught
from ..diagnosis.case import Case, case_of
from ..diagnosis.decision import FINER_MESH, Decision, beside_held_out, decide, undecided
from ..diagnosis.effects import HOLES, Scene, effects_of
from ..diagnosis.fitting import fit_calibrated
from ..diagnosis.forward import hole_motion, simulation_of, stored_fields
from ..diagnosis.hypotheses import LIBRARY
from ..diagnosis.mistakes import mistakes_of
from ..diagnosis.search import Search, search
from ..diagnosis.summary import held_out_blasts, known_so_far, not_computed, summarise_diagnosis
from ..errors import InputError, ReadError, contained
from ..files import WHOLE, code_hash, plain, versions, write_bytes, write_summary
from ..project.level import expected_peaks, level_findings
from ..project.places import extent_of
from ..project.project import Project, load_project, with_further
from ..recordings.seismic import channel_names, mseed_bytes
from ..report.diagnosis import write_diagnosis_report
from ..signals.seismogram import Seismogram
from ..simulation.recipe import BETTER
from ..simulation.simulation import Simulation
from . import Interrupted, Progress, Say, numbered_folders, result_folder, silent
from .prediction import Prediction, at_further, bands_of_peaks, predict, predicted_holes

RESULT = "diagnosis.json"
REPORT = "report.html"
RUNS = "runs"
STARTED = "unfinished.json"
RUNS_PAID = 600  # runs of a blast on the calibrated site, whose price is the budget unless given
NEAR = 1e-6  # m, tolerance for positions outside of the box


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """Diagnosis: the search for effects and the decision on them.

    Parameters
    ----------
    scene : Scene
    search : Search
    decision : Decision
    summary : dict
        As in ``diagnosis.json``.
    """

    scene: Scene
    search: Search
    decision: Decision
    summary: dict


MISTAKES, FIELDS = "mistakes in the records", "fields of shots and receivers"


def diagnose(
    project: Project,
    folder=None,
    *,
    minutes: float | None = None,
    seed: int = 1,
    correct: bool = False,
    executor: Executor | None = None,
    progress: Callable | None = None,
    known: Callable[[dict], object] = silent,
) -> Diagnosis:
    """Diagnose which physics a project lacks, from its records.

    Parameters
    ----------
    project : Project
        With records of at least one blast, and the further blasts of `with_further`.
    folder : path, optional
        Folder of stored runs; after an interruption the same call resumes.
    minutes : float, optional
        Of one processor, as `estimate` prices runs, after which no further effect is tried; by
        default what `RUNS_PAID` runs of one blast on the calibrated site cost.
    seed : int
        Of the draws without an effect.
    correct : bool
        Whether to mend mistakes in records and hole tables and go on. Otherwise a diagnosis with
        mistakes ends with them, as outcome ``MISTAKE``: the ground would be blamed for them.
    executor : Executor, optional
        As for `run_all`.
    progress : callable, optional
        Called with (stage, done, total).
    known : callable, optional
        Called with what is known so far, a dict, before each step of the search.

    Returns
    -------
    Diagnosis

    Raises
    ------
    InputError
        If the records cannot be compared, or the minutes are negative.
    SolverError
        If a run of the reference fails.

    Notes
    -----
    What fails of the library costs itself: such effects are not testable. A part of the answer
    that fails is listed in ``not_computed``.
    """
    if minutes is not None and minutes < 0.0:
        raise InputError(f"--minutes: must not be negative, got {minutes:g}; give a time or none")
    report, began = progress or (lambda *_: None), time.perf_counter()
    report("mistakes in the records", 0, 1)
    failures, mistakes, checks = {}, [], []
    with contained(failures, MISTAKES):
        mistakes, mended = mistakes_of(project, partial(_checking, checks, folder, executor))
        project = mended if correct else project
    wrong = bool(mistakes) and not correct
    everything = case_of(project)
    report("calibration", 0, 1)
    case = taught(everything, lambda part: simulation_of(part, folder, executor))
    scene, finer = prepared(case, folder, executor, failures, wrong, report)
    counted = [each for each in (*checks, scene.simulation, finer) if each is not None]
    scene.others = tuple(each for each in counted if each is not scene.simulation)
    scene.budget = RUNS_PAID * scene.simulation.priced / max(scene.simulation.runs, 1)
    if minutes is not None:
        scene.budget = 60.0 * minutes
    if wrong:
        chosen = fit_calibrated(scene)
        done = Search(scene, report, chosen, chosen=chosen)
    else:
        done = search(scene, report, lambda state: known(known_so_far(state)), seed)
    decision = undecided(done)
    with contained(failures, "decision"):
        decision = replace(decision, outcome="MISTAKE") if wrong else decide(done, finer)
    held_out = None
    with contained(failures, "held-out blasts"):
        held_out = held_out_blasts(everything, scene, decision)
        decision = beside_held_out(decision, held_out)
    summary = summarise_diagnosis(done, decision, mistakes)
    summary |= {
        "held_out_blasts": held_out,
        "not_computed": not_computed(failures),
        "runs": sum(each.runs for each in counted),
        "wall_s": round(time.perf_counter() - began, 1),
        "kept_runs": sum(each.cached for each in counted),
        "kept_s": round(sum(each.cached_s for each in counted), 1),
        "seed": seed,
        "minutes": minutes,
        "minutes_allowed": round(scene.budget / 60.0, 2),
        "minutes_spent": round(scene.spent / 60.0, 2),
        "corrected": correct,
        "finished": done.finished,
    }
    return Diagnosis(scene, done, decision, plain(summary))


def prepared(
    case: Case,
    folder=None,
    executor: Executor | None = None,
    failures: dict | None = None,
    wrong: bool = False,
    progress: Callable = lambda *_: None,
) -> tuple[Scene, Simulation | None]:
    """Calibrate a case and simulate its holes.

    Parameters
    ----------
    case : Case
    folder, executor
        As of `diagnose`.
    failures : dict, optional
        Gets the parts that fail.
    wrong : bool
        Whether the records hold mistakes; then nothing is calibrated.
    progress : callable, optional
        Called with (stage, done, total).

    Returns
    -------
    Scene
    Simulation or None
        On the better mesh, None where there is none.

    Raises
    ------
    InputError
        If the records cannot be compared.
    SolverError
        If a run of the reference fails.
    """
    failures = {} if failures is None else failures
    simulation, finer = simulation_of(case, folder, executor), None
    if not wrong and case.share is None and case.project.refined(BETTER) is not None:
        # trusted shots show the error of the mesh
        finer = simulation_of(case, folder, executor, finer=True)
    table = case.project.config.diagnosis
    fixed = wrong or case.share is not None or (table is not None and not table.calibrate)
    calibrated = () if fixed else None
    baseline = None
    if finer is not None:
        with contained(failures, FINER_MESH):
            baseline = calibrate(case, simulation, finer, calibrated)
    if baseline is None:
        finer, baseline = None, calibrate(case, simulation, None, calibrated)
    progress("holes", 0, 1)
    holes, fields = {}, None
    if not wrong and any(h.stored and not h.untestable(case) for h in LIBRARY.values()):
        with contained(failures, FIELDS):
            fields = stored_fields(simulation, case, baseline.project, progress)
            holes = fields.holes
    if not wrong and fields is None:
        with contained(failures, HOLES):
            holes = hole_motion(simulation, case, baseline.project)
    return Scene(simulation, baseline, holes, failures, fields=fields), finer


def _checking(checks, folder, executor, case):
    """Return the simulation that looks for mistakes in a case, and enter it in a list."""
    checks.append(simulation_of(case, folder, executor))
    return checks[-1]


def read_case(path) -> Project:
    """Read a project file with its further blasts."""
    return with_further(load_project(path))


def diagnose_file(
    file,
    output,
    *,
    minutes=None,
    seed=1,
    correct=False,
    executor=None,
    progress=None,
    known=silent,
    runs=None,
    say=silent,
) -> dict:
    """Diagnose a project and write ``diagnosis.json`` and ``report.html``.

    Parameters
    ----------
    file : path
        Project file with records; its table ``[diagnosis]`` names those of further blasts.
    output : path
        Folder for the result. Runs are stored in its folder ``runs``, so that the same call
        resumes after an interruption; a finished diagnosis of the same files is read.
    minutes, seed, correct, executor, progress, known
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
    project = read_case(file)
    provenance = versions(_hash_of(project)) | {"code_sha256": code_hash(WHOLE)}
    finished = _finished(output, provenance, minutes, seed, correct)
    if finished is not None:
        return finished
    implausible = _say_level(project, say)
    try:
        output.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"--out {output}: can't be made ({error.strerror})") from None
    diagnosis = diagnose(
        project,
        runs or output / RUNS,
        minutes=minutes,
        seed=seed,
        correct=correct,
        executor=executor,
        progress=progress,
        known=known,
    )
    own = {"implausible_peaks": implausible, "provenance": provenance}
    summary = {"case": project.title, **diagnosis.summary, **own}
    write_summary(output / RESULT, summary)
    write_diagnosis_report(output / REPORT, diagnosis, summary)
    return plain(summary)


def _hash_of(project):
    """Return the hash of all files that a project and its further blasts name."""
    digest = hashlib.sha256()
    try:
        for shot in project.shots:
            digest.update(json.dumps(shot.input_files, sort_keys=True).encode())
    except ReadError:
        raise
    except OSError as error:
        raise ReadError(f"{error.filename}: can't be read ({error.strerror})") from None
    return digest.hexdigest()


def _decisive(provenance):
    """Return the provenance on which a result depends: all but the number of threads."""
    return {key: value for key, value in provenance.items() if key != "threads"}


def _finished(output, provenance, *asked):
    """Return the finished diagnosis of the same input, or None; its page is written last."""
    if not (output / REPORT).is_file():
        return None
    try:
        known = json.loads((output / RESULT).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    if not isinstance(known, dict):
        return None
    before = known.get("provenance")
    same = isinstance(before, dict) and _decisive(before) == _decisive(provenance)
    answered = known.get("minutes"), known.get("seed"), known.get("corrected", False)
    return known if same and answered == asked else None


def predict_file(file, output, summary, holes, path, baseline=False, runs=None):
    """Write the predicted motion of a further blast at the receivers, as miniSEED.

    Parameters
    ----------
    file, output : path
        As of `diagnose_file`.
    summary : dict
        Its result.
    holes : path
        Table of the holes of the further blast.
    path : path
        File to write, with the channels, the sampling and the start of the last recorded blast. A
        project file gives no date; the first hole then fires at the start of 1970.
    baseline : bool
        Whether to predict with the calibrated model alone, without effects.
    runs : path, optional
        Another folder for the runs.

    Returns
    -------
    Prediction
    """
    case, model = case_of(read_case(file)), summary["model"]
    blast = _further(case, holes)
    case = at_further(case, blast)
    values = model["baseline_values"] if baseline else model["values"]
    effects = () if baseline else effects_of(model)
    motion = predict(case, blast, values, effects, runs or Path(output) / RUNS)
    write_bytes(path, _as_recorded(case, motion))
    varied = summary.get("holes_vary")
    level = case.project.config.priors.holes_percent if varied is None else varied["value"]
    source = "priors.holes_percent" if varied is None else "as the records show"
    spread = () if baseline else model.get("rows_covariance", ())
    own = predicted_holes(case, blast, values, effects, spread, runs or Path(output) / RUNS)
    share = model.get("error_share", 0.0)
    bands = {} if own is None else bands_of_peaks(case, motion, own, 1e-2 * level, share)
    return Prediction(case.project.shot.low_pass, level, source, bands)


def check_further(file, holes, outputs=(), out=None):
    """Check, before a diagnosis into ``out``, that a further blast can be predicted.

    Raises
    ------
    InputError, ReadError
        If its hole table is wrong, a hole lies outside of the box or fires after the end of the
        records, a file cannot hold the names of the receivers, or it cannot be written.
    """
    case = case_of(read_case(file))
    _further(case, holes)
    _channels(case)
    target = None if out is None else Path(out).resolve()
    taken = {path.resolve() for path in (Path(holes), *_inputs(case.project))}
    taken |= set() if target is None else {target / RESULT, target / REPORT}
    for output in outputs:
        path = Path(output).resolve()
        if path in taken:
            raise InputError(
                f"{output}: is read or written by the diagnosis; give another file name"
            )
        if path.is_dir() or not (path.parent.is_dir() or path.parent == target):
            raise InputError(f"{output}: must be a file in an existing folder, or in --out")
        taken.add(path)


def _inputs(project):
    """Return all files of a project and its further blasts."""
    return [shot.folder / name for shot in project.shots for name in shot.input_files]


def _further(case, holes):
    """Read the table of the holes of a further blast, in the coordinates of the project."""
    blast = read_blast(holes)
    if case.project.config.holes_inside is not None:
        _check_holes(extent_of(case.project), holes, blast)
    elif case.project.config.blast is None:
        raise InputError(f"{holes}: the project has no [blast] in whose place it could fire")
    late = int(np.argmax(blast.times))
    if blast.times[late] >= case.duration:
        raise InputError(
            f"{holes}: hole {blast.hole_ids[late]}: fires at {blast.times[late]:g} s, but the "
            f"prediction ends with the records, at {case.duration:.3g} s; split the blast"
        )
    return blast


def _check_holes(box, name, blast):
    """Refuse a blast with a hole outside of a box (3, 2) m or of unknown charge."""
    low, high = box.T
    for hole, centre, charge in zip(blast.hole_ids, blast.centres, blast.charge, strict=True):
        if np.any(centre < low - NEAR) or np.any(centre > high + NEAR):
            raise InputError(
                f"{name}: hole {hole}: lies outside of the box of the ground; move it into it"
            )
        if np.isnan(charge):
            raise InputError(f"{name}: hole {hole}: its charge is missing; give kg, 0 for a dud")
    if not np.any(blast.charge > 0.0):
        raise InputError(f"{name}: no hole has a charge")


def _as_recorded(case: Case, motion):
    """Return motion as a file with the sampling and the start of the records of the last blast."""
    last = case.project.shots[-1]
    first = next(iter(case.project.survey.recordings[last.name].values())).seismogram
    sampling = first.start, case.dt, len(first.velocity)
    whole = np.stack(
        [Seismogram(part.T, case.dt, 0.0).sampled(*sampling).velocity.T for part in motion]
    )
    return mseed_bytes(whole, _channels(case), case.dt, str(UTCDateTime(first.start)))


def _channels(case: Case):
    """Return the names of the channels of each receiver in its last record."""
    tables = [*case.project.survey.recordings.values()][::-1]
    records = {name: next(t[name] for t in tables if name in t) for name in case.receivers}
    return [
        channel_names(name, record.header.get("channels", {}), case.dt)
        for name, record in records.items()
    ]


def _say_level(project: Project, say: Say) -> list[str]:
    """Say and return of which blasts recorded peaks, or those expected, are implausible."""
    blasts = [project.of(shot.name) for shot in project.shots]
    sentences = [
        f"{finding.code}: {each.name}: {finding.title}. {finding.text}"
        for each in blasts for finding in level_findings(each, expected_peaks(each))
    ]  # fmt: skip
    for sentence in sentences:
        say(sentence)
    return sentences


def diagnose_case(
    case: str | Path,
    out: str | Path | None = None,
    *,
    fresh: bool = False,
    minutes: float | None = None,
    seed: int = 1,
    correct: bool = False,
    executor: Executor | None = None,
    progress: Progress | None = None,
    say: Say | None = None,
) -> tuple[dict, Path]:
    """Diagnose which physics a model lacks, where, and whether the records support it.

    Parameters
    ----------
    case : path
        Project file with records; its table ``[diagnosis]`` names those of further blasts.
    out : path, optional
        Folder of numbered folders, one per diagnosis, and of the stored runs, from which the same
        call resumes; ``diagnosis`` beside the project file by default. A finished diagnosis of the
        same input is read.
    fresh : bool
        Whether to run all models again.
    minutes
        As of `diagnose`.
    seed : int
        Of the draws without an effect.
    correct : bool
        Whether to mend mistakes in the records and go on.
    executor : concurrent.futures.Executor, optional
        Such as `workers`; the result does not depend on it.
    progress : callable, optional
        Called with (stage, done, total).
    say : callable, optional
        Called with a sentence when a diagnosis is read or resumed, and of implausible peaks.

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
    out = case.parent / "diagnosis" if out is None else Path(out)
    provenance = versions(_hash_of(read_case(case))) | {"code_sha256": code_hash(WHOLE)}
    if fresh:
        shutil.rmtree(out / RUNS, ignore_errors=True)
    for finished in [] if fresh else numbered_folders(out):
        known = _finished(finished, provenance, minutes, seed, correct)
        if known is not None:
            say(f"this diagnosis is finished: {finished}; --fresh repeats it")
            return known, finished
    started = {"input_sha256": provenance["input_sha256"], "minutes": minutes,
               "seed": seed, "corrected": correct}  # fmt: skip

    def unfinished(path: Path) -> bool:
        return _started(path) == started

    with result_folder(out, unfinished, fresh=fresh, say=say) as opened:
        result = opened[0]
        write_summary(result / STARTED, started)
        try:
            summary = diagnose_file(
                case, result, minutes=minutes, seed=seed, correct=correct,
                executor=executor, progress=progress,
                known=lambda so_far: write_summary(
                    result / STARTED, started | {"known_so_far": so_far}
                ),
                runs=out / RUNS, say=say,
            )  # fmt: skip
        except (InputError, ReadError):
            (result / STARTED).unlink()
            raise
        except KeyboardInterrupt:
            raise Interrupted(
                f"finished runs are stored in {out / RUNS}, and {result / STARTED} holds what is "
                "known so far; the same command goes on from there"
            ) from None
        (result / STARTED).unlink()
    return summary, result


def _started(folder):
    """Return the arguments of an unfinished diagnosis in a folder, or None."""
    try:
        table = json.loads((folder / STARTED).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    arguments = "input_sha256", "minutes", "seed", "corrected"
    return {k: table.get(k) for k in arguments} if isinstance(table, dict) else None


def predict_case(
    case: str | Path,
    folder: str | Path,
    holes: str | Path,
    path: str | Path,
    *,
    baseline: bool = False,
) -> Prediction:
    """Predict the motion of a further blast with a diagnosed model, as a miniSEED file.

    Parameters
    ----------
    case : path
        As of `diagnose_case`.
    folder : path
        Folder of the diagnosis, with ``diagnosis.json``.
    holes : path
        Table of the holes of the further blast.
    path : path
        Of the file to write, with the channels, sampling and start of the last recorded blast.
    baseline : bool
        Whether to predict with the calibrated model alone, without effects.

    Returns
    -------
    Prediction

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
    return predict_file(case, folder, summary, holes, path, baseline, folder.parent / RUNS)
