"""Field records: all record files of a folder, with geometry from headers or a table."""

import math
import warnings
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError, PyblastError, PyblastWarning, ReadError
from ..readers.cells import decode_lines, read_bytes, read_columns, split_line, wanted_by
from ..readers.kinds import is_text, kind_of
from ..readers.provenance import ReadLog
from ..readers.tables import read_table
from ..recordings.pieces import Stretch, common_step, common_windows, stretches_of
from ..recordings.raw import MAX_FILE_BYTES, clipped_samples, is_dead, uniform_step
from ..recordings.recording import Gather, Recording, first_recording, read_gather, read_recording
from ..recordings.seismic import FORMATS, quantity_of, read_traces
from ..units import FACTORS, split_key

METRES_PER_DEGREE = 111_195.0
NOT_RECORDS = {".md", ".pdf", ".toml", ".json", ".html", ".sgt", ".py", ".h5", ""}
TEXTS = ("kind", "name", "file", "line", "sensor")


@dataclass(frozen=True, eq=False)
class FieldRecord:
    """Field record: channels of one file, or of several one-channel files of one event.

    Parameters
    ----------
    file : str
        Path within the folder.
    format : str
    gather : Gather
        Samples, times, positions, and marks of dead channels and clipped samples.
    channels : tuple of str
        Channel names of the file; numbers from 1 where it has none.
    line, sensor : tuple of str
        Line and sensor of each channel from the geometry table; empty where not given.
    checks : tuple of (name, printed value, recomputed value, within), SI
        Values that the instrument printed beside the samples.
    notes : tuple of str
        Warnings of the reader.
    """

    file: str
    format: str
    gather: Gather
    channels: tuple[str, ...]
    line: tuple[str, ...]
    sensor: tuple[str, ...]
    checks: tuple[tuple[str, float, float, bool], ...] = ()
    notes: tuple[str, ...] = ()
    recording: Recording | None = None

    @property
    def stem(self) -> str:
        """Name of the file without folder and extension, as used in a geometry table."""
        return Path(self.file).stem


def read_folder(
    folder: str | Path, geometry: str | Path | None = None, log: ReadLog | None = None
) -> tuple[list[FieldRecord], list[tuple[str, str]]]:
    """Read all records of a folder.

    Parameters
    ----------
    folder : path
        Its files in SEG-2, SEG-Y, miniSEED, SAC, GSE2, formats of blast seismographs, or CSV
        (``time_s`` and one column a channel, with its unit); subfolders are not read.
    geometry : path, optional
        Geometry table, see `read_geometry`; positions come from the headers otherwise.
    log : ReadLog, optional
        Takes what was read.

    Returns
    -------
    records : list of FieldRecord
    skipped : list of (file, reason)

    Raises
    ------
    ReadError, InputError
        If the folder is absent or holds no record, or the geometry table is wrong.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise ReadError(f"{folder}: is no folder; give the folder that holds the records")
    log = ReadLog() if log is None else log
    table = [] if geometry is None else read_geometry(geometry, log)
    skip = set() if geometry is None else {Path(geometry).resolve()}
    records, single, skipped = [], [], []
    for path in sorted(folder.iterdir(), key=_natural):
        if not path.is_file() or path.name.startswith(".") or path.resolve() in skip:
            continue
        try:
            own = ReadLog()
            read = _read_file(path, own)
            log.extend(own)
        except PyblastError as error:
            reason = str(error).removeprefix(f"{path}").lstrip(":, ")
            other = path.suffix in NOT_RECORDS and reason.startswith("is ")
            skipped.append((path.name, "is no record" if other else reason))
            continue
        (single if len(read.channels) == 1 and read.format in ("SAC", "MSEED", "GSE2") else
         records).append(read)  # fmt: skip
    records += _joined(single, log)
    if not records:
        reasons = "; ".join(f"{name}: {reason}" for name, reason in skipped[:3]) or "it is empty"
        raise InputError(f"{folder}: holds no record that can be read ({reasons})")
    return [_placed(_in_metres(record), table) for record in records], skipped


def _natural(path: Path) -> tuple:
    """Sort by the numbers in a name: 2.dat before 10.dat."""
    stem = path.stem
    return (0, int(stem), path.name) if stem.isdigit() else (1, 0, path.name)


def _read_file(path: Path, log: ReadLog) -> FieldRecord:
    """Read a file by its content."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        recording, content = None, read_bytes(path, MAX_FILE_BYTES)
        format = kind_of(content).name
        if format in ("SEG2", "SEGY"):
            gather, checks = read_gather(path, log=log), ()
            names = [str(n + 1) for n in range(len(gather.data))]
        elif format in FORMATS:
            gather, names = _from_traces(path, content, format, log)
            checks = ()
        elif _is_channel_table(path, content):
            format = "CSV"
            gather, names = _from_table(path, decode_lines(path, content), log)
            checks = ()
        else:
            recording, gather, names, checks, format = _from_recording(path, log)
    notes = tuple(str(warning.message).removeprefix(f"{path}").lstrip(":, ") for warning in caught)
    blank = ("",) * len(names)
    return FieldRecord(
        path.name, format, gather, tuple(names), blank, blank, checks, notes, recording
    )


def _from_traces(path: Path, content: bytes, format: str, log: ReadLog) -> tuple[Gather, list[str]]:
    """Return the traces of a file over their common time, one channel each."""
    entry = log.file(path, format)
    traces = read_traces(path, content, format, entry)
    kinds = [quantity_of(trace) for trace in traces]
    motion = "velocity" if "velocity" in kinds else next((k for k in kinds if k != "pressure"), "")
    for trace, kind in zip(traces, kinds, strict=True):
        if kind != motion:
            _warn(f"{path}: channel {trace.id} of {kind} is left out beside {motion or 'motion'}")
    traces = [trace for trace, kind in zip(traces, kinds, strict=True) if kind == motion]
    if not traces:
        raise ReadError(f"{path}: holds no channel of ground motion, pressure alone")
    channels, dt = stretches_of(path, traces)
    window = max(common_windows(path, channels, dt, entry), key=lambda each: each.length)
    begin = min(trace.stats.starttime for trace in traces) + window.start
    data = np.array([window.samples(n, dt).astype(float) for n in range(len(window.stretches))])
    by_name = {trace.id: trace for trace in traces}
    members = [by_name[part.name] for part in window.stretches]
    places = np.array([_degrees(trace, "stla", "stlo") for trace in members])
    source = np.array(_degrees(traces[0], "evla", "evlo"))
    gather = _gather(
        path, data, float(dt), 0.0, "units of the file", str(begin), places, source
    )  # fmt: skip
    names = [trace.stats.station or trace.id for trace in members]
    doubled = len(set(names)) < len(names)
    return gather, [trace.id for trace in members] if doubled else names


def _warn(message):
    """Warn; the reader of the folder turns warnings into notes of the record."""
    warnings.warn(message, PyblastWarning, stacklevel=3)


def _degrees(trace, north: str, east: str) -> tuple[float, float, float]:
    """Return longitude, latitude and 0 of a SAC header; NaN where there are none."""
    header = getattr(trace.stats, "sac", {})
    values = header.get(east, -12345.0), header.get(north, -12345.0)
    east_west, north_south = values
    return (math.nan, math.nan, math.nan) if -12345.0 in values else (east_west, north_south, 0.0)


def _in_metres(record: FieldRecord) -> FieldRecord:
    """Return a record whose places, if in degrees, are metres east and north of its first."""
    if record.format not in ("SAC", "MSEED", "GSE2"):
        return record
    degrees = record.gather.receiver_positions
    origin = degrees[0]
    scale = METRES_PER_DEGREE * np.array([np.cos(np.radians(origin[1])), 1.0, 0.0])
    gather = replace(
        record.gather,
        receiver_positions=(degrees - origin) * scale,
        source_position=(record.gather.source_position - origin) * scale,
    )
    return replace(record, gather=gather)


def _is_channel_table(path: Path, content: bytes) -> bool:
    """Return whether a CSV file has channels other than components of motion."""
    if not is_text(content):
        return False
    head = content[:4000].decode("latin-1").splitlines()
    first = next((line for line in head if not line.startswith("#")), "")
    names = [split_key(title.strip()) for title in first.split(",")]
    known = ("east", "north", "vertical", "longitudinal", "transverse")
    return (
        path.suffix == ".csv"
        and names[0] == ("time", "s")
        and len(names) > 1
        and not any(stem.lower() in known for stem, _ in names)
    )


def _from_table(path: Path, lines: list[str], log: ReadLog) -> tuple[Gather, list[str]]:
    """Read ``time_s`` and one column a channel, such as ``OL01_V``."""
    first = next(n for n, line in enumerate(lines) if not line.startswith("#"))
    titles = split_line(path, first + 1, lines[first])
    rows = [(n + 1, split_line(path, n + 1, lines[n])) for n in range(first + 1, len(lines))]
    columns = read_columns(path, rows, {title: k for k, title in enumerate(titles)}, len(titles))
    times = columns.pop(titles[0])
    dt = uniform_step(path, times, [line for line, _ in rows])
    keys = [(title.rpartition("_")[0], title.rpartition("_")[2].lower()) for title in columns]
    units = {unit for stem, unit in keys if stem and unit in FACTORS}
    known = len(units) == 1 and all(stem and unit in units for stem, unit in keys)
    names = [stem for stem, _ in keys] if known else list(columns)
    factor = FACTORS[next(iter(units))] if known else 1.0
    data = factor * np.array(list(columns.values()))
    entry = log.file(path, "table of channels")
    for title, name in zip(columns, names, strict=True):
        unit = next(iter(units)) if known else ""
        entry.column(
            name, f"column {titles.index(title) + 1} {title!r}", unit, factor, rows=len(rows)
        )
    positions = np.full((len(data), 3), np.nan)
    unit = "V" if known and next(iter(units)) in ("v", "mv") else "units of the file"
    return _gather(path, data, dt, float(times[0]), unit, "", positions, positions[0]), names


def _from_recording(path: Path, log: ReadLog) -> tuple[Recording, Gather, list[str], tuple, str]:
    """Read the export of a blast seismograph: the components that are there."""
    recording = first_recording(path, read_recording(path, log=log))
    motion = recording.seismogram
    present = np.flatnonzero(motion.present)
    positions = np.full((len(present), 3), np.nan)
    gather = Gather(
        data=motion.velocity.T[present], dt=motion.dt, start=motion.start,
        source_position=positions[0], receiver_positions=positions, unit="m/s",
        dead=np.array([motion.components[n] in recording.dead for n in present]),
        clipped=recording.clipped.T[present], full_scale=recording.full_scale, label=path.stem,
        time=recording.time,
    )  # fmt: skip
    names = [motion.components[n] for n in present]
    return recording, gather, names, recording.checks, recording.instrument or "text"


def _gather(path, data, dt, start, unit, time, places, source) -> Gather:
    """Return a gather whose dead channels and clipped samples are marked."""
    clipped, full_scale = clipped_samples(data)
    return Gather(
        data=data, dt=dt, start=start, source_position=source, receiver_positions=places,
        unit=unit, dead=np.array([is_dead(row) for row in data]), clipped=clipped,
        full_scale=full_scale, label=path.stem, time=time,
    )  # fmt: skip


def _joined(single: list[FieldRecord], log: ReadLog) -> list[FieldRecord]:
    """Join one-channel files that began within a second of each other into one record."""
    from obspy import UTCDateTime

    groups: list[list[FieldRecord]] = []
    for record in single:
        begin = UTCDateTime(record.gather.time)
        for group in groups:
            other = group[0].gather
            if (
                abs(UTCDateTime(other.time) - begin) < 1.0
                and common_step([other.dt, record.gather.dt], other.data.shape[1]) is not None
                and record.channels[0] not in [member.channels[0] for member in group]
            ):
                group.append(record)
                break
        else:
            groups.append([record])
    return [record for group in groups for record in _merged(group, log)]


def _merged(group: list[FieldRecord], log: ReadLog) -> list[FieldRecord]:
    """Return one record of one-channel files, over their common time by their starts.

    Files that have no such time, or would cut the peak of another one, stay records of their own.
    """
    from obspy import UTCDateTime

    first = group[0]
    if len(group) == 1:
        return group
    dt, times = first.gather.dt, [UTCDateTime(record.gather.time) for record in group]
    channels = [
        [Stretch(record.file, begin - min(times), record.gather.data[0])]
        for record, begin in zip(group, times, strict=True)
    ]
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            (window,) = common_windows(
                Path(first.file), channels, dt, log.file(first.file, first.format)
            )
        except ReadError:  # no time in common
            return group
    used = {part.name for part in window.stretches}
    members = [record for record in group if record.file in used]
    skips = [window.skip(n, dt) for n in range(len(members))]
    parts = [record.gather for record in members]
    gather = replace(
        first.gather,
        data=np.array([window.samples(n, dt) for n in range(len(members))]),
        receiver_positions=np.concatenate([part.receiver_positions for part in parts]),
        dead=np.concatenate([part.dead for part in parts]),
        clipped=np.array([
            part.clipped[0, skip : skip + window.length]
            for part, skip in zip(parts, skips, strict=True)
        ]),
        time=str(min(times) + window.start),
    )  # fmt: skip
    blank = ("",) * len(members)
    names = tuple(record.channels[0] for record in members)
    said = [str(warning.message) for warning in caught]
    notes = tuple(dict.fromkeys([*said, *(note for record in members for note in record.notes)]))
    merged = FieldRecord(first.file, first.format, gather, names, blank, blank, notes=notes)
    return [merged, *(record for record in group if record.file not in used)]


def read_geometry(path: str | Path, log: ReadLog | None = None) -> list[dict[str, Any]]:
    """Read a geometry table: positions of receivers and sources.

    Parameters
    ----------
    path : path
        CSV with a line of heads. ``kind``: receiver or source; ``name``: of a receiver its channel
        (number from 1, or name), of a source its file without ending, or * for all files;
        ``x_m``, ``y_m`` and, if not 0, ``z_m``. Optional: ``file`` of a receiver that stands there
        in one file only, ``line`` to analyse receivers by lines, ``sensor`` to compare sensors
        that stand at one place.

    Returns
    -------
    list of dict
        One a row, checked.

    Raises
    ------
    ReadError, InputError
        Naming the line and the column.
    """
    table = read_table(path, wanted_by("geometry"), None, log, kind="table of places")
    rows = []
    for k, line in enumerate(table.lines):
        row = {name: table.values[name][k] for name in TEXTS if name in table.values}
        if row["kind"] not in ("receiver", "source"):
            raise InputError(
                f"{path}, line {line}, kind: must be receiver or source, got {row['kind']!r}"
            )
        for name in ("x", "y", "z"):
            value = float(table.values[name][k]) if name in table.values else 0.0
            if math.isnan(value) and name != "z":
                raise ReadError(f"{path}, line {line}, {name}: is missing, expected a number")
            row[f"{name}_m"] = 0.0 if math.isnan(value) else value
        rows.append(row)
    return rows


def _placed(record: FieldRecord, table: list[dict[str, Any]]) -> FieldRecord:
    """Return a record with the positions, lines and sensors of a geometry table."""
    if not table:
        return record
    places = record.gather.receiver_positions.copy()
    line, sensor = list(record.line), list(record.sensor)
    source = record.gather.source_position
    for row in table:
        position = [row[key] for key in ("x_m", "y_m", "z_m")]
        if row["kind"] == "source":
            if row["name"] in ("*", record.stem, record.file):
                source = np.array(position)
            continue
        if row.get("file") and row["file"] not in (record.stem, record.file):
            continue
        for n in _named(record, row["name"]):
            places[n], line[n], sensor[n] = position, row.get("line", ""), row.get("sensor", "")
    gather = replace(record.gather, receiver_positions=places, source_position=source)
    return replace(record, gather=gather, line=tuple(line), sensor=tuple(sensor))


def _named(record: FieldRecord, name: str) -> Iterable[int]:
    """Return the channels of a record with a name, or with a number from 1."""
    by_name = [n for n, channel in enumerate(record.channels) if channel == name]
    if by_name or not name.isdigit():
        return by_name
    number = int(name) - 1
    return [number] if 0 <= number < len(record.channels) else []
