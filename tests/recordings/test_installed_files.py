"""Files that packages ship: each is read as its package reads it, or refused in one sentence."""

import sys
import warnings
from collections import Counter
from pathlib import Path

import numpy as np
import obspy
import pytest

from pyblast.errors import InputError, ReadError
from pyblast.readers.kinds import kind_of
from pyblast.recordings.recording import read_gather, read_recording

FOLDER = Path(obspy.__file__).parent / "io"
KINDS = ("mseed", "sac", "gse2", "seg2", "segy", "gcf", "y", "ah", "kinemetrics", "reftek",
         "nied", "stationtxt", "css", "ascii", "wav", "seisan", "sh", "win", "rg16")  # fmt: skip
ALWAYS = 120  # files of the first kinds in the short test, to keep it short


def shipped():
    """Return the data files that obspy installs with its tests, by kind."""
    return [
        path for kind in KINDS for path in sorted((FOLDER / kind / "tests" / "data").rglob("*"))
        if path.is_file() and path.stat().st_size < 2_000_000
    ]  # fmt: skip


def outcome(path):
    """Read a file; return what came of it: the records or the gather, and the refusal."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            if kind_of(path.read_bytes()).name in ("SEG2", "SEGY"):
                return read_gather(path), ""
            return read_recording(path, unit="counts"), ""
        except (ReadError, InputError) as error:
            return None, str(error)


def by_obspy(path, format):
    """Return the traces of a file as obspy reads it."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return obspy.read(str(path), format=format)


def assert_same_records(records, stream):
    """Hold the samples of records against those of obspy at the same times."""
    for record in records:
        motion, begin = record.seismogram, obspy.UTCDateTime(record.time)
        for component, name in record.header["channels"].items():
            values = motion.velocity[:, motion.components.index(component)]
            same = [
                trace for trace in stream.select(id=name)
                if trace.stats.starttime <= begin + 0.5 * motion.dt
                and begin <= trace.stats.endtime + motion.dt
            ]  # fmt: skip
            (skip,) = [round((begin - trace.stats.starttime) / motion.dt) for trace in same[:1]]
            part = np.asarray(same[0].data[skip : skip + len(values)], dtype=float)
            assert same[0].stats.delta == pytest.approx(motion.dt, rel=1e-9)
            assert np.array_equal(values[: len(part)], part)


def assert_same_gather(gather, stream):
    """Hold the samples of a gather against those of obspy; intervals where traces name one."""
    for row, trace in zip(gather.data, stream, strict=True):
        scale = np.max(np.abs(trace.data)) or 1.0
        factor = row[np.argmax(np.abs(trace.data))] / trace.data[np.argmax(np.abs(trace.data))]
        assert np.allclose(row, factor * trace.data, rtol=1e-6, atol=1e-6 * abs(factor) * scale)
        own = getattr(trace.stats, "segy", None)
        if own is None or own.trace_header.sample_interval_in_ms_for_this_trace:
            assert gather.dt == pytest.approx(trace.stats.delta, rel=1e-9)


def compare(path):
    """Read one file both ways; return its class."""
    content = path.read_bytes()
    format = kind_of(content).name
    read, reason = outcome(path)
    assert "\n" not in reason
    if read is None:
        assert str(path) in reason
        return f"{format or 'no recording'}, refused"
    if format is None:
        return "text, read"
    stream = by_obspy(path, format)
    (assert_same_gather if format in ("SEG2", "SEGY") else assert_same_records)(read, stream)
    return f"{format}, read"


def show(capsys, text):
    """Print counts by class beside the dots of pytest."""
    with capsys.disabled():
        sys.stdout.write(f"\n{text}\n")


@pytest.mark.skipif(not shipped(), reason="obspy is installed without its test data")
def test_recordings_that_obspy_ships_are_read_like_obspy_reads_them_or_refused(capsys):
    files = [path for path in shipped() if path.parts[path.parts.index("io") + 1] in KINDS[:5]]

    counts = Counter(compare(path) for path in files[:ALWAYS])

    show(capsys, f"{len(files)} files of obspy: {dict(sorted(counts.items()))}")
    assert sum(count for name, count in counts.items() if name.endswith(" read")) >= 60


@pytest.mark.long
@pytest.mark.skipif(not shipped(), reason="obspy is installed without its test data")
def test_all_files_that_obspy_ships_are_read_or_refused(capsys):
    counts = Counter(compare(path) for path in shipped())

    show(capsys, f"all files of obspy: {dict(sorted(counts.items()))}")
    assert sum(counts.values()) == len(shipped())
