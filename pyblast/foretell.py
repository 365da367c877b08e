"""The job from a diagnosis to what receivers would record of a further blast, as a file."""

from pathlib import Path

import numpy as np
from obspy import UTCDateTime

from .blasting.hole_tables import read_blast
from .diagnose import REPORT, RESULT, RUNS, cut_of, read_case
from .diagnosis.case import Case, case_of
from .diagnosis.prediction import effects_of, predict
from .errors import InputError
from .motion.seismogram import Seismogram
from .projects.project import load_project
from .projects.project_site import diagnosed_blasts, ground_height, lowered
from .projects.result import write_bytes
from .projects.site import case_files
from .projects.site_checks import check_holes
from .records.mseed_file import channel_names, mseed_bytes


def predict_file(folder, output, summary, holes, path, baseline=False):
    """Write what a diagnosed site sends to its receivers in a further blast, as miniSEED.

    Parameters
    ----------
    folder, output : path
        As of `diagnose_folder`.
    summary : dict
        What it returned.
    holes : path
        Table of the holes of the further blast.
    path : path
        Of the file; it has the channels, the sampling and the start of the last recorded blast. Of
        a project, which tells no instants, the first hole fires as 1970 begins.
    baseline : bool
        Without the effects: the site as it was calibrated alone.
    """
    case, model = case_of(read_case(folder)), summary["model"]
    blast = _further(folder, case, holes)
    values = model["baseline_values"] if baseline else model["values"]
    effects = () if baseline else effects_of(model)
    motion = predict(
        case, cut_of(case.site, fine=True), blast, values, effects, Path(output) / RUNS
    )
    write_bytes(path, _as_recorded(case, motion))


def check_further(folder, holes, outputs=(), out=None):
    """Check, before a diagnosis into ``out``, that it could foretell a further blast into files.

    Raises
    ------
    InputError, ReadError
        If the table of its holes is no good, a hole lies outside of the box or fires after the
        records end, a file can't hold the names of the receivers, or it can't be written.
    """
    case = case_of(read_case(folder))
    _further(folder, case, holes)
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
    every = diagnosed_blasts(load_project(folder))
    return [one.folder / name for one in every for name in one.input_files]


def _further(folder, case, holes):
    """Read the table of the holes of a further blast, with the ground at height 0."""
    blast = read_blast(holes)
    if not Path(folder).is_dir():
        blast = lowered(blast, ground_height(load_project(folder)))
    check_holes(case.site.box, holes, blast)
    late = int(np.argmax(blast.times))
    if blast.times[late] >= case.duration:
        raise InputError(
            f"{holes}: hole {blast.hole_ids[late]}: fires at {blast.times[late]:g} s, but what is "
            f"foretold ends as the records do, at {case.duration:.3g} s; split the blast"
        )
    return blast


def _as_recorded(case: Case, motion):
    """Return motion as a file with the sampling and the start of the records of the last blast."""
    records, last = case.site.records, _as_fired(case)[-1]
    first = next(iter(records[last].values())).seismogram
    sampling = first.start, case.dt, len(first.velocity)
    whole = np.stack(
        [Seismogram(one.T, case.dt, 0.0).sampled(*sampling).velocity.T for one in motion]
    )
    start = UTCDateTime(case.site.time_zeros.get(last, 0)) + first.start
    return mseed_bytes(whole, _channels(case), case.dt, str(start))


def _channels(case: Case):
    """Return the names of the channels of each receiver, as they were recorded last."""
    every = [case.site.records[blast] for blast in reversed(_as_fired(case))]
    records = {name: next(some[name] for some in every if name in some) for name in case.receivers}
    return [
        channel_names(name, record.header.get("channels", {}), case.dt)
        for name, record in records.items()
    ]


def _as_fired(case: Case):
    """Return the names of the blasts, the last one last, as listed where no instants are told."""
    zeros = case.site.time_zeros
    return sorted(case.site.records, key=lambda blast: UTCDateTime(zeros.get(blast, 0)))
