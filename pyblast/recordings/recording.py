"""Recordings and shot gathers: all formats read by content, in SI, checked and rotated."""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import InputError, PyblastWarning, ReadError
from ..readers.cells import Cells, cells_of, read_bytes
from ..readers.kinds import expect, kind_of
from ..readers.provenance import ReadLog
from ..signals.seismogram import BLAST_AXES, GEOGRAPHIC, Seismogram
from .raw import (
    LONE,
    MAX_FILE_BYTES,
    RawRecord,
    check_printed,
    clipped_samples,
    constant_offset,
    decibels,
    is_dead,
    lone_spike,
)
from .segy import read_segy
from .seismic import check_bytes, deconvolve, read_seg2, read_traces, station_records
from .tables import TEXT_FORMATS, read_motion, recognises_motion, refuse_histogram

if TYPE_CHECKING:
    from obspy import UTCDateTime

__all__ = [
    "FORMATS", "Gather", "Recording", "read_gather", "read_recording", "read_stations",
    "remove_response",
]  # fmt: skip
FASTEST_GROUND = 1e3
_STATION_FORMATS = ("MSEED", "SAC", "GSE2")
FORMATS = (*TEXT_FORMATS, "CSV", "MAPPED", *_STATION_FORMATS)


@dataclass(frozen=True, eq=False)
class Recording:
    """Recording: a seismogram with the header and self-checks of its instrument.

    Parameters
    ----------
    seismogram : Seismogram
        In m/s, or in counts if ``header["unit"]`` is "counts".
    instrument, serial : str
    full_scale : float or None, m/s
    clipped : (n_samples, 3) bool
        Samples at full scale, in the components of the seismogram.
    header : dict
    checks : tuple of (name, printed value, recomputed value, within), SI
    dead : tuple of str
        Components with constant samples.
    time : str
        ISO time stamp of the file.
    overpressure : (n_samples,) float64, Pa, or None
        Of the microphone.
    offset : tuple of 3 float, m/s
        Constant offset that was taken off each component of the file, before any rotation.
    """

    seismogram: Seismogram
    instrument: str
    serial: str
    full_scale: float | None
    clipped: np.ndarray
    header: dict[str, Any] = field(default_factory=dict)
    checks: tuple[tuple[str, float, float, bool], ...] = ()
    dead: tuple[str, ...] = ()
    time: str = ""
    overpressure: np.ndarray | None = None
    offset: tuple[float, ...] = (0.0, 0.0, 0.0)

    @property
    def peak_overpressure(self) -> float:
        """Peak of the air overpressure [Pa]; NaN without a microphone."""
        return np.nan if self.overpressure is None else float(np.max(np.abs(self.overpressure)))

    @property
    def peak_overpressure_db(self) -> float:
        """The same in dB(L), linear decibels above 20 µPa."""
        return np.nan if self.overpressure is None else decibels(self.peak_overpressure)

    def filtered_like(self, corner: float | None) -> "Recording":
        """Return the recording beside motion whose sources were low-passed at a corner in Hz.

        See `Seismogram.filtered_like`. What follows a clipped sample within a period of the corner
        counts as clipped.
        """
        passed = self.seismogram.filtered_like(corner)
        if passed is self.seismogram or not self.clipped.any():
            return replace(self, seismogram=passed)
        assert corner is not None  # else it stays
        reach = int(np.ceil(1.0 / (corner * passed.dt)))
        since = np.arange(len(self.clipped))[:, None]
        last = np.maximum.accumulate(np.where(self.clipped, since, -reach - 1), axis=0)
        return replace(self, seismogram=passed, clipped=since - last <= reach)

    def rotated(self, azimuth: float) -> "Recording":
        """Return the recording with rotated horizontals, see `Seismogram.rotated`.

        Each takes from both, so both are clipped where one was.
        """
        either = self.clipped[:, :1] | self.clipped[:, 1:2]
        marks = np.hstack([either, either, self.clipped[:, 2:]])
        return replace(self, seismogram=self.seismogram.rotated(azimuth), clipped=marks)

    def __post_init__(self) -> None:
        """Check the shape of the clipping marks."""
        shape = self.seismogram.velocity.shape
        if np.shape(self.clipped) != shape:
            raise InputError(
                f"recording.clipped: must have shape {shape}, got {np.shape(self.clipped)}"
            )


def read_recording(
    path: str | Path | Sequence[str | Path],
    format: str | None = None,
    *,
    bearing: float | None = None,
    full_scale: float | None = None,
    mapping: str | Path | None = None,
    unit: str | None = None,
    time_zero: "str | UTCDateTime | None" = None,
    orientations: dict[str, tuple[float, float]] | None = None,
    max_bytes: int = MAX_FILE_BYTES,
    sheet: str | None = None,
    log: ReadLog | None = None,
) -> list[Recording]:
    """Read all recordings of a file.

    Parameters
    ----------
    path : str or Path, or several for one-channel files (SAC, GSE2)
    format : str, optional
        One of ``FORMATS``; detected from the content if not given, checked against it otherwise.
    bearing : float, rad, optional
        Direction from receiver to blast, clockwise from north; rotates longitudinal (towards the
        blast) and transverse (90 degrees clockwise of it) to east and north.
    full_scale : float, m/s, optional
        Overrides the one in the header.
    mapping : str or Path, optional
        TOML file that describes a table of any layout.
    unit : str, optional
        Of seismological samples: ``m_per_s`` and the like, ``m_per_s2`` and the like or ``g`` of
        accelerometers, which are integrated, or ``counts``; of columns of a table without one.
    time_zero : str or obspy.UTCDateTime, optional
        Time 0 of seismological formats.
    orientations : dict of channel code to (azimuth, dip), rad, optional
        For seismological channels that are not named E, N, Z.
    max_bytes : int
        Largest size of a file.
    sheet : str, optional
        Sheet of an Excel workbook; may be left out where only one has cells.
    log : ReadLog, optional
        Takes what was read.

    Returns
    -------
    list of Recording
        In m/s, one for each instrument in the file.

    Raises
    ------
    ReadError
        If a file is no recording, is cut short or holds samples that are not finite numbers.
    InputError
        If an argument, a unit or a component is invalid.

    Notes
    -----
    Warns (PyblastWarning) of dead channels, of clipping, of a constant offset, which is taken off,
    and of differences between the samples (before that) and the values printed by the instrument.

    Examples
    --------
    >>> recording, = read_recording("R1.csv")  # doctest: +SKIP
    >>> recording.seismogram.ppv  # doctest: +SKIP
    """
    paths = [Path(path)] if isinstance(path, (str, Path)) else [Path(item) for item in path]
    data = [read_bytes(item, max_bytes) for item in paths]
    log = ReadLog() if log is None else log
    cells = _cells(paths[0], data[0], sheet)
    format = _choose_format(paths[0], data[0], cells, format, mapping)
    if format in _STATION_FORMATS:
        entries = [log.file(item, format) for item in paths]
        traces = [
            trace
            for item, content, entry in zip(paths, data, entries, strict=True)
            for trace in read_traces(item, content, format, entry)
        ]
        raws = station_records(
            paths[0], traces, entries[0], unit=unit, time_zero=time_zero, orientations=orientations
        )
        if unit is None and not any("IDEP" in note for raw in raws for note in raw.notes):
            _warn(f"{paths[0]}: {format} names no unit, m/s is assumed; pass unit='m_per_s'")
    elif len(paths) > 1:
        raise InputError(f"{paths[1]}: only one-channel files can be read together")
    else:
        if time_zero is not None or orientations is not None:
            raise InputError(f"{paths[0]}: time_zero and orientations go with {_STATION_FORMATS}")
        if unit not in (None, "counts") and format not in ("CSV", "MAPPED"):
            raise InputError(f"{paths[0]}: its header says its unit; leave out unit = {unit!r}")
        cells = cells_of(paths[0], data[0], door="record") if cells is None else cells
        refuse_histogram(paths[0], cells.lines)
        reader = TEXT_FORMATS.get(format)
        if reader is not None:
            raws = [reader.read(paths[0], cells.lines, log)]
        else:
            raws = [read_motion(paths[0], cells, mapping, log, None if unit == "counts" else unit)]
    return [_recording(paths[0], raw, bearing, full_scale) for raw in raws]


def first_recording(path: str | Path, recordings: Sequence[Recording]) -> Recording:
    """Return the first recording of a file; warn which one that is, where there are several."""
    if len(recordings) > 1:
        listed = ", ".join(f"{r.seismogram.label} {r.time}".strip() for r in recordings[:6])
        _warn(f"{path}: holds {len(recordings)} records ({listed}); the first one is taken")
    return recordings[0]


def read_stations(
    path: str | Path,
    *,
    time_zero: "str | UTCDateTime | None" = None,
    unit: str = "m_per_s",
    max_bytes: int = MAX_FILE_BYTES,
) -> dict[str, Recording]:
    """Read a file of many stations into a dict by station name; see ``read_recording``."""
    recordings = read_recording(path, time_zero=time_zero, unit=unit, max_bytes=max_bytes)
    stations = {recording.seismogram.label: recording for recording in recordings}
    if len(stations) < len(recordings):
        raise ReadError(f"{path}: a station appears with more than one instrument, or in pieces "
                        "between gaps")  # fmt: skip
    return stations


def in_motion(recording: Recording, sensitivity: float) -> Recording:
    """Turn the counts of an instrument of flat response to m/s.

    Parameters
    ----------
    recording : Recording
        Read with ``unit="counts"``.
    sensitivity : float
        Counts, or volts, of the file for 1 m/s.

    Raises
    ------
    InputError
        If the samples are in m/s already.
    """
    seismogram = recording.seismogram
    if recording.header.get("unit") != "counts":
        raise InputError(
            f"sensitivity: {seismogram.label or 'the record'} is in m/s already, leave it out"
        )
    moving = replace(seismogram, velocity=seismogram.velocity / sensitivity)
    return replace(recording, seismogram=moving, header={**recording.header, "unit": "m_per_s"})


def remove_response(recording: Recording, response: str | Path | dict) -> Recording:
    """Remove the instrument response: counts to m/s.

    Parameters
    ----------
    recording : Recording
        Read with ``unit="counts"``.
    response : str or Path of a StationXML file, or dict
        A dict has ``poles`` and ``zeros`` (rad/s) of velocity to volts, ``gain`` and
        ``sensitivity`` (counts per m/s).

    Raises
    ------
    InputError
        If the samples are in m/s already (blast seismographs are flat from 2 to 250 Hz, a
        second removal would distort them), or if the response lacks a channel.
    """
    seismogram = recording.seismogram
    if recording.header.get("unit") != "counts":
        raise InputError(
            f"remove_response: {seismogram.label} is in m/s already, its response "
            "must not be removed twice"
        )
    if not recording.header.get("channels"):
        raise InputError(
            f"remove_response: {seismogram.label} was turned from other channels, "
            "read it without orientations"
        )
    raw = RawRecord(
        {name: seismogram.velocity[:, n] for n, name in enumerate(seismogram.components)
         if name in recording.header["channels"]},
        seismogram.dt, header=recording.header, time=recording.time,
    )  # fmt: skip
    cleaned = deconvolve(raw, response, f"remove_response of {seismogram.label}")
    velocity = _columns(cleaned, seismogram.components, len(seismogram.velocity))
    return replace(
        recording,
        seismogram=replace(seismogram, velocity=velocity),
        full_scale=None,
        header={**recording.header, "unit": "m_per_s", "response": "removed"},
    )


def _cells(path, content, sheet) -> Cells | None:
    """Return the cells of a workbook or of text, None for seismological formats."""
    if kind_of(content).name in (*_STATION_FORMATS, *_GATHERS) and sheet is None:
        return None
    return cells_of(path, content, sheet, "record")


def _choose_format(path, content, cells, format, mapping):
    """Return the format of a file by its content, checked against the requested one."""
    if format is not None and format not in FORMATS:
        raise InputError(f"format: must be one of {', '.join(FORMATS)}, got '{format}'")
    if mapping is not None or format == "MAPPED":
        if mapping is None or format not in (None, "MAPPED"):
            raise InputError(f"{path}: a mapping belongs to format MAPPED, and the reverse")
        return "MAPPED"
    detected = kind_of(content).name
    if detected in _GATHERS:
        raise InputError(f"{path}: is a gather ({detected}), read it with read_gather")
    if detected not in _STATION_FORMATS:
        head = [] if cells is None else cells.lines[:60]
        detected = next(
            (name for name, row in TEXT_FORMATS.items() if head and row.recognises(head)), None
        )
        detected = detected or ("CSV" if recognises_motion(head) else None)
    if detected is None:
        raise ReadError(f"{path}: is none of {', '.join(FORMATS)}; describe a table by a mapping")
    if format not in (None, detected):
        raise ReadError(f"{path}: its content is {detected}, not {format}")
    return detected


def _recording(path, raw, bearing, full_scale):
    """Return the recording of one raw record: named, checked and rotated."""
    axes = BLAST_AXES if {"longitudinal", "transverse"} & set(raw.channels) else GEOGRAPHIC
    if not set(raw.channels) <= set(axes):
        raise InputError(f"{path}: components {', '.join(raw.channels)} mix two sets of axes")
    full_scale = raw.full_scale if full_scale is None else full_scale
    _refuse_nonsense(path, raw, full_scale)
    n_samples = len(next(iter(raw.channels.values())))
    velocity = _columns(raw.channels, axes, n_samples)
    marks = {name: clipped_samples(x[None], full_scale)[0][0] for name, x in raw.channels.items()}
    clipped = np.nan_to_num(_columns(marks, axes, n_samples)).astype(bool)
    dead = tuple(name for name, samples in raw.channels.items() if is_dead(samples))
    seismogram = Seismogram(velocity, raw.dt, raw.start, raw.label, axes, raw.low_passed)
    checks = check_printed(raw.printed, seismogram)
    offset = np.array([0.0 if raw.unit == "counts" else constant_offset(x) for x in velocity.T])
    if np.any(offset):
        seismogram = replace(seismogram, velocity=velocity - offset)
    _report(path, raw, dead, clipped, checks, dict(zip(axes, offset, strict=True)))
    if bearing is not None:
        seismogram, clipped = _rotated(path, seismogram, clipped, bearing)
    header = {**raw.header, "unit": raw.unit}
    return Recording(
        seismogram, raw.instrument, raw.serial, full_scale, clipped, header, checks, dead, raw.time,
        raw.microphone, tuple(offset.tolist()),
    )  # fmt: skip


def _rotated(path, seismogram, clipped, bearing):
    """Rotate longitudinal and transverse to east and north, with their clipping marks."""
    if seismogram.components != BLAST_AXES or not np.all(seismogram.present[:2]):
        raise InputError(
            f"{path}: a bearing needs longitudinal and transverse components, "
            f"found {', '.join(seismogram.components)}"
        )
    either = clipped[:, 0] | clipped[:, 1]
    return seismogram.rotated(bearing), np.column_stack([either, either, clipped[:, 2]])


def _refuse_nonsense(path, raw, full_scale):
    """Raise ReadError for impossible velocities, caused by a wrong unit or byte order."""
    if full_scale is not None and not 0.0 < full_scale < np.inf:
        raise InputError(f"{path}: full scale must be positive, got {full_scale:g} m/s")
    for name, samples in raw.channels.items() if raw.unit != "counts" else ():
        peak = int(np.argmax(np.abs(samples)))
        if abs(samples[peak]) > FASTEST_GROUND:
            raise ReadError(
                f"{path}, {name}, sample {peak}: {samples[peak]:g} m/s is faster than "
                "any ground, check unit and byte order"
            )
    for name, samples in raw.channels.items():
        if (lone := lone_spike(samples)) is not None:
            raise ReadError(
                f"{path}, {name}, sample {lone}: {samples[lone]:g} stands alone, more than "
                f"{LONE:g} times the largest of the others: a mark of a missing sample, such as "
                "9999; cut the file there"
            )


def _report(path, raw, dead, clipped, checks, offsets):
    """Warn of notes, dead channels, clipping, offsets and differences from printed values."""
    where = f"{path}, {raw.label}"
    for note in raw.notes:
        _warn(f"{where}: {note}")
    if taken := [f"{1e3 * level:.3g} mm/s ({n})" for n, level in offsets.items() if level]:
        _warn(f"{where}: a constant offset of {', '.join(taken)} was taken off")
    if dead:
        _warn(f"{where}: {', '.join(dead)} never moves, the channel is dead")
    if np.any(clipped):
        _warn(f"{where}: {np.count_nonzero(clipped)} samples are clipped at full scale")
    wrong = [
        f"{name} printed {printed:.4g}, computed {value:.4g}"
        for name, printed, value, within in checks
        if not within
    ]
    if wrong:
        _warn(f"{where}: samples differ from the device's own values (SI): {'; '.join(wrong)}")


def _columns(channels, axes, n_samples):
    """Return components (n_samples, 3) in the order of the axes; NaN where missing."""
    missing = np.full(n_samples, np.nan)
    return np.column_stack([channels.get(name, missing) for name in axes])


def _warn(message):
    """Warn with the stack level of the caller of the reader."""
    warnings.warn(message, PyblastWarning, stacklevel=4)


@dataclass(frozen=True, eq=False)
class Gather:
    """Shot gather: the channels of a geophone line for one shot.

    Parameters
    ----------
    data : (n_channels, n_samples) float64, ``unit``
    dt : float, s
    start : float, s
        Time of the first sample from the trigger; negative with a pre-trigger.
    source_position : (3,) float64, m
        NaN where the header has none.
    receiver_positions : (n_channels, 3) float64, m
        NaN where the headers have none, or the same for every channel.
    unit : str
        "V" where the header scales the samples, otherwise "counts".
    dead : (n_channels,) bool
        Channels with constant samples.
    clipped : (n_channels, n_samples) bool
        Samples at the converter's full scale.
    full_scale : float or None, ``unit``
        As given, or detected as a plateau in one of the channels; None where nothing clips.
    header : dict
        Header values; a tuple where they differ between channels.
    """

    data: np.ndarray
    dt: float
    start: float
    source_position: np.ndarray
    receiver_positions: np.ndarray
    unit: str
    dead: np.ndarray
    clipped: np.ndarray
    full_scale: float | None = None
    label: str = ""
    time: str = ""
    header: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check the shapes."""
        n_channels, n_samples = np.shape(self.data)
        expected = {
            "receiver_positions": (n_channels, 3), "source_position": (3,),
            "dead": (n_channels,), "clipped": (n_channels, n_samples),
        }  # fmt: skip
        for name, shape in expected.items():
            if np.shape(getattr(self, name)) != shape:
                raise InputError(
                    f"gather.{name}: must have shape {shape}, got {np.shape(getattr(self, name))}"
                )

    @property
    def times(self) -> np.ndarray:
        """Time of each sample, (n_samples,) s."""
        return self.start + self.dt * np.arange(self.data.shape[1])

    @property
    def offsets(self) -> np.ndarray:
        """Distance of each receiver from the source, (n_channels,) m."""
        return np.linalg.norm(self.receiver_positions - self.source_position, axis=1)


def read_gather(
    path: str | Path,
    format: str | None = None,
    *,
    full_scale: float | None = None,
    max_bytes: int = MAX_FILE_BYTES,
    log: ReadLog | None = None,
) -> Gather:
    """Read a shot gather from SEG-2 or SEG-Y.

    Parameters
    ----------
    path : str or Path
    format : str, optional
        "SEG2" or "SEGY"; detected from the content if not given.
    full_scale : float, optional
        Level of clipping in the unit of the file; detected as a plateau if not given.
    max_bytes : int
        Largest size of the file.
    log : ReadLog, optional
        Takes what was read.

    Raises
    ------
    InputError
        If ``format`` is unknown.
    ReadError
        If the file has another format, is cut short, or its channels differ in sampling.

    Notes
    -----
    The SEG-2 header DESCALING_FACTOR turns counts into millivolts; positions are in the unit of
    the header. Where traces of SEG-Y have no interval or count, those of the file hold. A full
    scale detected in one channel holds for all: they share a converter.

    Examples
    --------
    >>> gather = read_gather("shot_012.sg2")  # doctest: +SKIP
    >>> gather.offsets.max()  # doctest: +SKIP
    """
    path = Path(path)
    content = read_bytes(path, max_bytes)
    format = format or expect(path, content, "gather").name
    if format not in _GATHERS:
        raise InputError(f"{path}: expected a gather in SEG2 or SEGY, got {format}")
    check_bytes(path, content, format)
    entry = (ReadLog() if log is None else log).file(path, format)
    values = _GATHERS[format](path, content, entry)
    for text in [*entry.remarks, *(f"{loss.part}: {loss.why}" for loss in entry.losses)]:
        _warn(f"{path}: {text}")
    dead = np.array([is_dead(samples) for samples in values["data"]])
    clipped, full_scale = clipped_samples(values["data"], full_scale)
    return Gather(dead=dead, clipped=clipped, full_scale=full_scale, label=path.stem, **values)


_GATHERS = {"SEG2": read_seg2, "SEGY": read_segy}
