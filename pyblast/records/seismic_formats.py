"""Seismological formats through obspy, each chosen by its magic bytes and never guessed."""

import io
import warnings
from itertools import pairwise
from pathlib import Path

import numpy as np
import obspy

from ..errors import InputError, ReadError
from ..units import FACTORS
from .raw_record import RawRecord, read_bytes
from .seismic_bytes import check_bytes

SEED_COMPONENTS = {"E": "east", "N": "north", "Z": "vertical"}
_MAX_METADATA_BYTES = 50_000_000
_PAZ_KEYS = {"poles", "zeros", "gain", "sensitivity"}


def read_traces(path: Path, content: bytes, name: str) -> list[obspy.Trace]:
    """Read traces by an allow-listed format and refuse what is not finite numbers.

    The bytes go to obspy, never the path: a path may be a pattern, an address or an archive.
    """
    check_bytes(path, content, name)
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", module="obspy.io.(seg2|sac)")
            warnings.filterwarnings("error", module="obspy.io.mseed")
            traces = list(obspy.read(io.BytesIO(content), format=name))
    except Exception as error:
        reason = _first_sentence(error)
        raise ReadError(f"{path}: is not a readable {name} file ({reason})") from error
    for n, trace in enumerate(traces, 1):
        place = f"{path}, trace {n} ({trace.id})"
        if trace.data.dtype.kind not in "if":
            raise ReadError(f"{place}: expected numbers, found {trace.data.dtype} samples")
        wrong = np.flatnonzero(~np.isfinite(trace.data))
        if len(wrong):
            raise ReadError(
                f"{place}, sample {wrong[0]}: expected a finite number, "
                f"got {trace.data[wrong[0]]:g}"
            )
        if trace.stats.npts < 2 or not 0.0 < trace.stats.delta < 1e4:
            raise ReadError(
                f"{place}: expected at least 2 samples at a positive step, "
                f"got {trace.stats.npts} at {trace.stats.delta:g} s"
            )
    return traces


def station_records(
    path: Path,
    traces: list[obspy.Trace],
    *,
    unit: str | None = None,
    time_zero=None,
    orientations: dict[str, tuple[float, float]] | None = None,
) -> list[RawRecord]:
    """Gather the channels of each station into one record.

    Parameters
    ----------
    unit : str, optional
        ``m_per_s``, ``mm_per_s``, ... or ``counts``. None takes floating samples as m/s.
    time_zero : str or obspy.UTCDateTime, optional
        Instant that becomes time 0; otherwise the first sample is.
    orientations : dict of channel code to (azimuth, dip), rad, optional
        SEED sense: azimuth clockwise from north, dip positive down. Needed for channels that
        are not named E, N, Z.
    """
    stations = {}
    for trace in _joined(path, traces):
        key = trace.id.rpartition(".")[0], trace.stats.channel[:-1]
        stations.setdefault(key, []).append(trace)
    try:
        zero = None if time_zero is None else obspy.UTCDateTime(time_zero)
    except (TypeError, ValueError):
        raise InputError(f"time_zero: must be an ISO time, got '{time_zero}'") from None
    return [_station(path, group, unit, zero, orientations) for group in stations.values()]


def deconvolve(record: RawRecord, response: str | Path | dict, place: str) -> dict:
    """Remove an instrument response from each channel; returns component to m/s."""
    inventory = None if isinstance(response, dict) else read_inventory(Path(response))
    if inventory is None and set(response) != _PAZ_KEYS:
        raise InputError(
            f"{place}: response must have {', '.join(sorted(_PAZ_KEYS))}, "
            f"got {', '.join(map(str, response))}"
        )
    cleaned = {}
    for name, samples in record.channels.items():
        header = {"delta": record.dt}
        if record.time:
            header["starttime"] = obspy.UTCDateTime(record.time)
        trace = obspy.Trace(np.array(samples), header)
        trace.id = record.header["channels"][name]
        try:
            if inventory is None:
                trace.simulate(paz_remove=response, taper_fraction=0.02, water_level=60.0)
            else:
                trace.remove_response(inventory, output="VEL", taper_fraction=0.02)
        except Exception as error:
            reason = _first_sentence(error)
            raise InputError(f"{place}: no response for {trace.id} ({reason})") from error
        cleaned[name] = np.asarray(trace.data, dtype=np.float64)
    return cleaned


def read_inventory(path: Path) -> obspy.Inventory:
    """Read StationXML, refusing document types and entities before any parser sees them."""
    content = read_bytes(path, _MAX_METADATA_BYTES)
    if b"<FDSNStationXML" not in content[:2000] or b"<!" in content.replace(b"<!--", b""):
        raise ReadError(f"{path}: expected StationXML without a document type, found other text")
    try:
        return obspy.read_inventory(io.BytesIO(content), format="STATIONXML")
    except Exception as error:
        reason = _first_sentence(error)
        raise ReadError(f"{path}: is not readable StationXML ({reason})") from error


def _first_sentence(error):
    """Shorten another library's message to one line."""
    return " ".join(str(error).split()).split(". ")[0][:160]


def _joined(path, traces):
    """Join the pieces of each channel where they touch; name gaps and overlaps."""
    stream = obspy.Stream(traces)
    try:
        stream.merge(method=-1)
    except Exception as error:
        raise ReadError(
            f"{path}: pieces of a channel differ in sampling or type ({_first_sentence(error)})"
        ) from error
    stream.sort(["network", "station", "location", "channel", "starttime"])
    for first, second in pairwise(stream):
        if first.id == second.id:
            seconds = second.stats.starttime - first.stats.endtime - first.stats.delta
            raise ReadError(
                f"{path}, {first.id}: {'gap' if seconds > 0 else 'overlap'} of "
                f"{abs(seconds):g} s at {first.stats.endtime}, cut the file there"
            )
    return list(stream)


def _station(path, group, unit, zero, orientations):
    """Cut the channels of one station to their common window and name them."""
    first = group[0].stats
    place = f"{path}, station {first.station or '(unnamed)'}"
    if any(abs(trace.stats.delta - first.delta) > 1e-9 * first.delta for trace in group):
        raise ReadError(f"{place}: channels differ in sampling rate")
    begin = max(trace.stats.starttime for trace in group)
    skip = [round((begin - trace.stats.starttime) / first.delta) for trace in group]
    length = min(trace.stats.npts - n for trace, n in zip(group, skip, strict=True))
    if length < 2:
        raise ReadError(f"{place}: channels have no time in common")
    if unit is None and any(trace.data.dtype.kind == "i" for trace in group):
        raise InputError(
            f"{place}: samples are integer counts, pass unit='counts' and remove "
            "the response, or the unit of one count such as 'um_per_s'"
        )
    if unit is None:
        unit = "m_per_s"
    if unit != "counts" and not (unit in FACTORS and unit.endswith("_per_s")):
        raise InputError(f"unit: must be 'counts' or a velocity such as 'mm_per_s', got '{unit}'")
    factor = 1.0 if unit == "counts" else FACTORS[unit]
    samples = {
        trace.stats.channel: factor * trace.data[n : n + length].astype(np.float64)
        for trace, n in zip(group, skip, strict=True)
    }
    channels = _oriented(place, samples, orientations)
    names = {} if orientations else dict(zip(channels, (t.id for t in group), strict=True))
    return RawRecord(
        channels, first.delta, 0.0 if zero is None else begin - zero, first.station,
        group[0].stats._format, time=str(begin), header={"channels": names},
        unit="counts" if unit == "counts" else "m_per_s",
    )  # fmt: skip


def _oriented(place, samples, orientations):
    """Turn channels into east, north, vertical by their codes or by given orientations."""
    if orientations is None:
        names = {code: SEED_COMPONENTS.get(code[-1:].upper()) for code in samples}
        unknown = [code for code, name in names.items() if name is None]
        if unknown or len(set(names.values())) < len(names):
            raise InputError(
                f"{place}: channels {', '.join(samples)} must end in E, N, Z once "
                "each, otherwise pass orientations (azimuth, dip)"
            )
        return {names[code]: values for code, values in samples.items()}
    if len(samples) != 3 or not set(samples) <= set(orientations):
        raise InputError(f"{place}: orientations need the three channels {', '.join(samples)}")
    azimuth, dip = np.array([orientations[code] for code in samples], dtype=np.float64).T
    axes = np.column_stack(
        [np.cos(dip) * np.sin(azimuth), np.cos(dip) * np.cos(azimuth), -np.sin(dip)]
    )
    if abs(np.linalg.det(axes)) < 0.1:
        raise InputError(f"{place}: orientations must span three directions")
    return dict(
        zip(
            ("east", "north", "vertical"),
            np.linalg.solve(axes, np.array(list(samples.values()))),
            strict=True,
        )
    )
