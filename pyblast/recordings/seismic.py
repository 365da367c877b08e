"""Seismological formats (miniSEED, SAC, GSE2, SEG-2, SEG-Y) through obspy, checked beforehand."""

import io
import struct
import warnings
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import InputError, ReadError
from ..readers.cells import read_bytes
from ..units import FACTORS
from .raw import RawRecord

if TYPE_CHECKING:
    import obspy

_SEG2_SAMPLE_BYTES = {1: 2, 2: 4, 3: 2.5, 4: 4, 5: 8}
_SEGY_SAMPLE_BYTES = {1: 4, 2: 4, 3: 2, 5: 4}
_CM6_LETTERS = b"+-0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz"


def sniff_seismic(content: bytes) -> str | None:
    """Return MSEED, SAC, SEG2, SEGY or GSE2 by content; None for everything else."""
    return next((name for name, looks in _MAGIC.items() if looks(content)), None)


def check_bytes(path: Path, content: bytes, name: str) -> None:
    """Raise ReadError for content of another format, cut short, or harmful to its decoder."""
    if name not in _MAGIC:
        raise InputError(f"format: must be one of {', '.join(_MAGIC)}, got '{name}'")
    if not _MAGIC[name](content):
        raise ReadError(f"{path}: its content is not {name}")
    promised = _PROMISED[name](content) if name in _PROMISED else 0
    if promised > len(content):
        raise ReadError(
            f"{path}: is cut short, {name} header promises {promised} bytes or more, "
            f"found {len(content)}"
        )
    if name in _REFUSALS:
        _REFUSALS[name](path, content)


def _is_mseed(content):
    """Recognise a miniSEED 2 data record: sequence number, quality letter, blank."""
    return (
        len(content) >= 48
        and content[:20].isascii()
        and content[6:7] in (b"D", b"R", b"Q", b"M")
        and content[7:8] in (b" ", b"\0")
        and not content[:6].strip(b"0123456789 \0")
    )


def _mseed_bytes(content):
    """Return where the last miniSEED record should end, from the record lengths."""
    offset = 0
    while offset + 48 <= len(content) and _is_mseed(content[offset : offset + 48]):
        (year,) = struct.unpack_from(">H", content, offset + 20)
        order = ">" if 1900 <= year <= 2500 else "<"
        at = offset + struct.unpack_from(order + "H", content, offset + 46)[0]
        if at + 8 > len(content):
            return at + 8
        if struct.unpack_from(order + "H", content, at)[0] != 1000:
            return 0
        offset += 1 << min(content[at + 6], 62)
    return offset


def _is_sac(content):
    """Recognise SAC by its header version in either byte order."""
    return len(content) >= 632 and any(
        struct.unpack(order + "i", content[304:308])[0] in (6, 7) for order in "<>"
    )


def _is_segy(content):
    """Recognise big-endian SEG-Y by the first letter of its text and its binary header."""
    if len(content) < 3600 or content[:1] not in (b"C", b"\xc3", b" ", b"\x40", b"\0"):
        return False
    step, n_samples, code = struct.unpack(">H2xH2xh", content[3216:3226])
    return step > 0 and n_samples > 0 and code in _SEGY_SAMPLE_BYTES


def _segy_bytes(content):
    """Return the number of bytes of the text headers and of whole traces, at least one."""
    n_samples, code = struct.unpack(">H2xh", content[3220:3226])
    n_texts = max(0, struct.unpack(">h", content[3504:3506])[0])
    size = 240 + n_samples * _SEGY_SAMPLE_BYTES[code]
    n_traces = max(1, -(-(len(content) - 3600 - 3200 * n_texts) // size))
    return 3600 + 3200 * n_texts + n_traces * size


def _sac_bytes(content):
    """Return the number of bytes by the SAC header."""
    order = "<" if struct.unpack("<i", content[304:308])[0] in (6, 7) else ">"
    return 632 + 4 * max(0, struct.unpack(order + "i", content[316:320])[0])


def _refuse_wild_places(path, content):
    """Raise ReadError for SAC coordinates beyond 360 degrees, on which obspy never returns."""
    order = "<" if struct.unpack("<i", content[304:308])[0] in (6, 7) else ">"
    values = struct.unpack_from(order + "6f", content, 4 * 31)
    for name, value in zip(("stla", "stlo", "", "", "evla", "evlo"), values, strict=True):
        if name and value != -12345.0 and not abs(value) <= 360.0:
            raise ReadError(f"{path}, {name}: must be degrees, got {value:g}")


def _seg2_bytes(content):
    """Return the number of bytes by the trace pointers and sample counts of SEG-2."""
    order = "<" if content[:2] == b"\x55\x3a" else ">"
    (n_traces,) = struct.unpack_from(order + "H", content, 6)
    if 32 + 4 * n_traces > len(content):
        return 32 + 4 * n_traces
    total = 32
    for pointer in struct.unpack_from(f"{order}{n_traces}I", content, 32):
        if pointer + 32 > len(content):
            return pointer + 32
        block, n_samples, code = struct.unpack_from(order + "2xH4xIB", content, pointer)
        n_bytes = int(n_samples * _SEG2_SAMPLE_BYTES.get(code, 1))
        total += n_bytes
        if pointer + block + n_bytes > len(content):
            return pointer + block + n_bytes
    return total


def _refuse_broken_gse2(path, content):
    """Raise ReadError for GSE2 that would overflow the buffers of obspy's decoder."""
    for n, window in enumerate(content.split(b"WID2 ")[1:], 1):
        lines = [line.rstrip() for line in window.split(b"\n")]
        kind, count = lines[0][39:42], lines[0][43:51].strip()
        if kind != b"CM6":
            continue
        ends = [k for k, line in enumerate(lines) if line[:4] in (b"DAT2", b"CHK2")]
        if len(ends) != 2 or max(map(len, lines[1:])) > 80:
            raise ReadError(f"{path}, window {n}: expected DAT2, lines of 80 letters, CHK2")
        payload = b"".join(lines[ends[0] + 1 : ends[1]])
        if payload.translate(None, _CM6_LETTERS):
            raise ReadError(f"{path}, window {n}: expected letters of CM6 only")
        length = len(payload.translate(None, _CM6_LETTERS[32:]))
        if not count.isdigit() or int(count) != length:
            raise ReadError(
                f"{path}, window {n}: header promises {count.decode('latin-1')} "
                f"samples, found {length}"
            )


_MAGIC = {
    "MSEED": _is_mseed,
    "SEG2": lambda content: content[:2] in (b"\x55\x3a", b"\x3a\x55") and len(content) >= 32,
    "GSE2": lambda content: content[:5] == b"WID2 ",
    "SEGY": _is_segy,
    "SAC": _is_sac,
}
_PROMISED = {
    "MSEED": _mseed_bytes, "SAC": _sac_bytes, "SEG2": _seg2_bytes, "SEGY": _segy_bytes,
}  # fmt: skip
_REFUSALS = {"SAC": _refuse_wild_places, "GSE2": _refuse_broken_gse2}
SEED_COMPONENTS = {"E": "east", "N": "north", "Z": "vertical"}
_MAX_METADATA_BYTES = 50_000_000
_PAZ_KEYS = {"poles", "zeros", "gain", "sensitivity"}


def read_traces(path: Path, content: bytes, name: str) -> "list[obspy.Trace]":
    """Read traces of a known format; raise ReadError for samples that are not finite."""
    # obspy gets the bytes, never the path: it could take that for a pattern or an address
    import obspy

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
        where = f"{path}, trace {n} ({trace.id})"
        if trace.data.dtype.kind not in "if":
            raise ReadError(f"{where}: expected numbers, found {trace.data.dtype} samples")
        wrong = np.flatnonzero(~np.isfinite(trace.data))
        if len(wrong):
            raise ReadError(
                f"{where}, sample {wrong[0]}: expected a finite number, "
                f"got {trace.data[wrong[0]]:g}"
            )
        if trace.stats.npts < 2 or not 0.0 < trace.stats.delta < 1e4:
            raise ReadError(
                f"{where}: expected at least 2 samples at a positive step, "
                f"got {trace.stats.npts} at {trace.stats.delta:g} s"
            )
    return traces


def station_records(
    path: Path,
    traces: "list[obspy.Trace]",
    *,
    unit: str | None = None,
    time_zero: "str | obspy.UTCDateTime | None" = None,
    orientations: dict[str, tuple[float, float]] | None = None,
) -> list[RawRecord]:
    """Return one raw record per station from its channels.

    Parameters
    ----------
    unit : str, optional
        ``m_per_s``, ``mm_per_s``, ... or ``counts``. None: floating-point samples are m/s.
    time_zero : str or obspy.UTCDateTime, optional
        Time 0; the first sample by default.
    orientations : dict of channel code to (azimuth, dip), rad, optional
        SEED sense: azimuth clockwise from north, dip positive down. Needed for channels that
        are not named E, N, Z.
    """
    import obspy

    stations = {}
    for trace in _joined(path, traces):
        key = trace.id.rpartition(".")[0], trace.stats.channel[:-1]
        stations.setdefault(key, []).append(trace)
    try:
        zero = None if time_zero is None else obspy.UTCDateTime(time_zero)
    except (TypeError, ValueError):
        raise InputError(f"time_zero: must be an ISO time, got '{time_zero}'") from None
    return [_station(path, group, unit, zero, orientations) for group in stations.values()]


def deconvolve(record: RawRecord, response: str | Path | dict, where: str) -> dict:
    """Return each component in m/s after removal of the instrument response."""
    import obspy

    inventory = None if isinstance(response, dict) else read_inventory(Path(response))
    if isinstance(response, dict) and set(response) != _PAZ_KEYS:
        raise InputError(
            f"{where}: response must have {', '.join(sorted(_PAZ_KEYS))}, "
            f"got {', '.join(map(str, response))}"
        )
    cleaned = {}
    for name, samples in record.channels.items():
        header: dict[str, Any] = {"delta": record.dt}
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
            raise InputError(f"{where}: no response for {trace.id} ({reason})") from error
        cleaned[name] = np.asarray(trace.data, dtype=np.float64)
    return cleaned


def read_inventory(path: Path) -> "obspy.Inventory":
    """Read StationXML; document types and entities are refused before parsing."""
    import obspy

    content = read_bytes(path, _MAX_METADATA_BYTES)
    if b"<FDSNStationXML" not in content[:2000] or b"<!" in content.replace(b"<!--", b""):
        raise ReadError(f"{path}: expected StationXML without a document type, found other text")
    try:
        return obspy.read_inventory(io.BytesIO(content), format="STATIONXML")
    except Exception as error:
        reason = _first_sentence(error)
        raise ReadError(f"{path}: is not readable StationXML ({reason})") from error


def _first_sentence(error):
    """Return the first sentence of an error message."""
    return " ".join(str(error).split()).split(". ")[0][:160]


def _joined(path, traces):
    """Join the pieces of each channel; raise ReadError for gaps and overlaps."""
    import obspy

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
    """Return the record of one station: channels in their common time window."""
    first = group[0].stats
    where = f"{path}, station {first.station or '(unnamed)'}"
    if any(abs(trace.stats.delta - first.delta) > 1e-9 * first.delta for trace in group):
        raise ReadError(f"{where}: channels differ in sampling rate")
    begin = max(trace.stats.starttime for trace in group)
    skip = [round((begin - trace.stats.starttime) / first.delta) for trace in group]
    length = min(trace.stats.npts - n for trace, n in zip(group, skip, strict=True))
    if length < 2:
        raise ReadError(f"{where}: channels have no time in common")
    if unit is None and any(trace.data.dtype.kind == "i" for trace in group):
        raise InputError(
            f"{where}: samples are integer counts, pass unit='counts' and remove "
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
    channels = {str(name): x for name, x in _oriented(where, samples, orientations).items()}
    names = {} if orientations else dict(zip(channels, (t.id for t in group), strict=True))
    return RawRecord(
        channels, first.delta, 0.0 if zero is None else begin - zero, first.station,
        group[0].stats._format, time=str(begin), header={"channels": names},
        unit="counts" if unit == "counts" else "m_per_s",
    )  # fmt: skip


def _oriented(where, samples, orientations):
    """Return east, north, vertical by the channel codes or by given orientations."""
    if orientations is None:
        names = {code: SEED_COMPONENTS.get(code[-1:].upper()) for code in samples}
        if None in names.values() or len(set(names.values())) < len(names):
            raise InputError(
                f"{where}: channels {', '.join(samples)} must end in E, N, Z once "
                "each, otherwise pass orientations (azimuth, dip)"
            )
        return {str(names[code]): values for code, values in samples.items()}
    if len(samples) != 3 or not set(samples) <= set(orientations):
        raise InputError(f"{where}: orientations need the three channels {', '.join(samples)}")
    azimuth, dip = np.array([orientations[code] for code in samples], dtype=np.float64).T
    axes = np.column_stack(
        [np.cos(dip) * np.sin(azimuth), np.cos(dip) * np.cos(azimuth), -np.sin(dip)]
    )
    if abs(np.linalg.det(axes)) < 0.1:
        raise InputError(f"{where}: orientations must span three directions")
    return dict(
        zip(
            ("east", "north", "vertical"),
            np.linalg.solve(axes, np.array(list(samples.values()))),
            strict=True,
        )
    )


LONGEST = 5  # characters of a station name in miniSEED
BANDS = (1000.0, "G"), (250.0, "D"), (80.0, "E"), (0.0, "S")  # of channels, by samples a second


def mseed_bytes(
    motion: np.ndarray, channels: Sequence[Sequence[str]], dt: float, start: str
) -> bytes:
    """Return a miniSEED file with the components of many receivers, as bytes.

    Parameters
    ----------
    motion : (n_receivers, 3, n_samples) float, m/s
    channels : sequence of sequence of str
        Identifier of each, such as ``PB.R01..HHE``.
    dt : float, s
    start : str
        ISO instant of the first sample.
    """
    import obspy

    traces = []
    for three, names in zip(motion, channels, strict=True):
        for samples, name in zip(three, names, strict=True):
            header = {"delta": dt, "starttime": obspy.UTCDateTime(start)}
            trace = obspy.Trace(np.asarray(samples, dtype=np.float32), header)
            trace.id = name
            traces.append(trace)
    buffer = io.BytesIO()
    obspy.Stream(traces).write(buffer, format="MSEED")
    return buffer.getvalue()


def channel_names(station: str, known: dict[str, str], dt: float) -> list[str]:
    """Return the channel identifiers of east, north and vertical of a record.

    Parameters
    ----------
    station : str
    known : dict of str to str
        Identifiers by component from the file that was read; the others are derived from them.
    dt : float, s

    Raises
    ------
    InputError
        If no identifier is known and the name of the station is too long for the format.

    Notes
    -----
    Unknown channels are those of geophones, ``.R01..GPE``: SEED manual 2.4, appendix A.
    """
    if not known and len(station) > LONGEST:
        raise InputError(
            f"receiver {station!r}: miniSEED holds {LONGEST} characters of a name, shorten it"
        )
    band = next(letter for least, letter in BANDS if round(1.0 / dt, 6) >= least)
    stem = next(iter(known.values()), f".{station}..{band}P?")[:-1]
    return [known.get(name, stem + letter) for letter, name in SEED_COMPONENTS.items()]


_LENGTH_UNITS = {"METERS": "m", "CENTIMETERS": "cm", "FEET": "ft", "MILLIMETERS": "mm"}


def _seg2_header(path, traces):
    """Read scale, delay and positions from SEG-2 headers."""
    headers = [dict(trace.stats.seg2) for trace in traces]
    scaled = [header.get("DESCALING_FACTOR") for header in headers]
    factor = 1.0
    if all(scaled):
        factor = FACTORS["mv"] * np.array(
            [_number(path, n, "DESCALING_FACTOR", text) for n, text in enumerate(scaled)]
        )
    delays = {_number(path, n, "DELAY", h.get("DELAY", "0")) for n, h in enumerate(headers)}
    if len(delays) > 1:
        raise ReadError(f"{path}: channels start at different times: {sorted(delays)} s")
    symbol = _LENGTH_UNITS.get(str(headers[0].get("UNITS", "METERS")).upper(), "m")
    receivers = FACTORS[symbol] * np.array(
        [_place(path, n, "RECEIVER_LOCATION", header) for n, header in enumerate(headers)]
    )
    if len(traces) > 1 and np.all(receivers == receivers[0]):
        receivers = np.full((len(traces), 3), np.nan)
    return {
        "factor": factor, "unit": "V" if all(scaled) else "counts", "start": delays.pop(),
        "receiver_positions": receivers, "header": _summary(headers),
        "source_position": FACTORS[symbol] * _place(path, 0, "SOURCE_LOCATION", headers[0]),
    }  # fmt: skip


def _segy_header(path, traces):
    """Read delay and positions from SEG-Y trace headers."""
    headers = [trace.stats.segy.trace_header for trace in traces]
    delays = {header.delay_recording_time for header in headers}
    if len(delays) > 1:
        raise ReadError(f"{path}: channels start at different times: {sorted(delays)} ms")
    places = {}
    for side in ("source_coordinate", "group_coordinate"):
        scale = [float(h.scalar_to_be_applied_to_all_coordinates or 1) for h in headers]
        scale = np.array([s if s > 0 else -1.0 / s for s in scale])
        xy = np.array([[getattr(h, f"{side}_x"), getattr(h, f"{side}_y")] for h in headers])
        places[side] = np.column_stack([scale[:, None] * xy, np.zeros(len(headers))])
    receivers = places["group_coordinate"]
    if len(traces) > 1 and np.all(receivers == receivers[0]):
        receivers = np.full((len(traces), 3), np.nan)
    return {
        "factor": 1.0, "unit": "counts", "start": FACTORS["ms"] * delays.pop(),
        "receiver_positions": receivers, "source_position": places["source_coordinate"][0],
        "header": {"textual": "SEGY"},
    }  # fmt: skip


def _place(path, channel, key, header):
    """Read one to three coordinates; NaN if absent."""
    texts = str(header.get(key, "")).split()[:3]
    values = [_number(path, channel, key, text) for text in texts]
    return np.array(values + [0.0] * (3 - len(values))) if values else np.full(3, np.nan)


def _number(path, channel, key, text):
    """Read a number of a channel's header."""
    try:
        value = float(str(text).split()[0])
    except (ValueError, IndexError):
        value = np.nan
    if not np.isfinite(value):
        raise ReadError(f"{path}, channel {channel + 1}, {key}: expected a number, got '{text}'")
    return value


def _summary(headers):
    """Return one value per key where all channels agree, a tuple where they differ."""
    keys = dict.fromkeys(key for header in headers for key in header)
    columns = {key: [header.get(key, "") for header in headers] for key in keys}
    return {
        key: column[0] if all(value == column[0] for value in column) else tuple(column)
        for key, column in columns.items()
    }


GATHER_HEADERS = {"SEG2": _seg2_header, "SEGY": _segy_header}
