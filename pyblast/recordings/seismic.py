"""Seismological formats (miniSEED, SAC, GSE2, SEG-2) through obspy, checked beforehand."""

import io
import struct
import warnings
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import InputError, ReadError
from ..readers.cells import read_bytes
from ..readers.kinds import expect, kind_of
from ..readers.provenance import FileRead
from ..units import FACTORS
from .pieces import common_step, common_windows, leave_out, stretches_of
from .raw import RawRecord, integrated_to_velocity
from .segy import layout

if TYPE_CHECKING:
    import obspy

_SEG2_SAMPLE_BYTES = {1: 2, 2: 4, 3: 2.5, 4: 4, 5: 8}
_CM6_LETTERS = b"+-0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz"


def check_bytes(path: Path, content: bytes, name: str) -> None:
    """Raise ReadError for content of another format, cut short, or harmful to its decoder."""
    if name not in FORMATS:
        raise InputError(f"format: must be one of {', '.join(FORMATS)}, got '{name}'")
    if kind_of(content).name != name:
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
    """Recognise a miniSEED 2 data record: number, quality letter, a time, and a place of data."""
    if len(content) < 48 or content[6:7] not in (b"D", b"R", b"Q", b"M"):
        return False
    if content[7:8] not in (b" ", b"\0") or content[:6].strip(b"0123456789 \0"):
        return False
    year, day, hour, minute, second = struct.unpack_from(
        _mseed_order(content) + "HHBBB", content, 20
    )
    return 1900 <= year <= 2500 and 0 < day <= 366 and hour < 24 and minute < 60 and second <= 60


def _mseed_order(content, offset=0):
    """Return the byte order of a miniSEED record, by its year."""
    (year,) = struct.unpack_from(">H", content, offset + 20)
    return ">" if 1900 <= year <= 2500 else "<"


def _mseed_records(content):
    """Yield the start of each miniSEED record, and its end; None where that is not said."""
    offset = 0
    while offset + 48 <= len(content) and _is_mseed(content[offset : offset + 48]):
        order = _mseed_order(content, offset)
        at = offset + struct.unpack_from(order + "H", content, offset + 46)[0]
        if at + 8 > len(content):
            yield offset, at + 8
            return
        if struct.unpack_from(order + "H", content, at)[0] != 1000:
            yield offset, None
            return
        end = offset + (1 << min(max(content[at + 6], 6), 62))
        yield offset, end
        offset = end


def _mseed_bytes(content):
    """Return where the last miniSEED record should end, from the record lengths."""
    return max((end or 0 for _, end in _mseed_records(content)), default=0)


def _blank_codes(content):
    """Return miniSEED whose codes hold blanks for NUL, 0xFF and other bytes that are no letters."""
    mended = bytearray(content)
    for offset, _ in _mseed_records(content):
        codes = content[offset + 8 : offset + 20]
        mended[offset + 8 : offset + 20] = bytes(c if 32 <= c < 127 else 32 for c in codes)
    return bytes(mended)


def _sac_bytes(content):
    """Return the number of bytes by the SAC header."""
    order = "<" if struct.unpack("<i", content[304:308])[0] in (6, 7) else ">"
    return 632 + 4 * max(0, struct.unpack(order + "i", content[316:320])[0])


def _refuse_odd_sac(path, content):
    """Raise ReadError for SAC that is no evenly sampled time series, or of impossible places."""
    order = "<" if struct.unpack("<i", content[304:308])[0] in (6, 7) else ">"
    kind, even = (struct.unpack_from(order + "i", content, 4 * n)[0] for n in (85, 105))
    if kind not in (1, -12345) or even == 0:
        what = "unevenly sampled" if even == 0 else f"of type {kind} (IFTYPE)"
        raise ReadError(f"{path}: is SAC {what}; write an evenly sampled time series")
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


FORMATS = ("MSEED", "SEG2", "GSE2", "SEGY", "SAC")
_PROMISED = {
    "MSEED": _mseed_bytes, "SAC": _sac_bytes, "SEG2": _seg2_bytes,
}  # fmt: skip
_REFUSALS = {"SAC": _refuse_odd_sac, "GSE2": _refuse_broken_gse2, "SEGY": layout}
# Words of a header that change amounts, directions or times: each is obeyed or refused.
WORDS = {
    "SAC": "SCALE CMPAZ CMPINC IDEP DELTA LEVEN IFTYPE", "GSE2": "CALIB", "MSEED": "rate",
    "SEG2": "DESCALING_FACTOR SKEW DELAY UNITS", "StationXML": "epochs stages azimuth dip units",
}  # fmt: skip
AS_NAMED = 5.0  # degrees, by which E, N and Z may point elsewhere: SEED manual 2.4, appendix A
SEED_COMPONENTS = {"E": "east", "N": "north", "Z": "vertical"}
_MAX_METADATA_BYTES = 50_000_000
_PAZ_KEYS = {"poles", "zeros", "gain", "sensitivity"}


# SEED manual 2.4, appendix A: the second letter of a channel says what its instrument measures.
_BAND_LETTERS = frozenset("FGDCESHBMLVURPTQAO")
_INSTRUMENTS = {
    **dict.fromkeys("HLP", "velocity"), **dict.fromkeys("NG", "acceleration"), "D": "pressure",
}  # fmt: skip
_SAC_QUANTITIES = {6: "displacement", 7: "velocity", 8: "acceleration", 50: "volts"}
_NANOMETRES = 1e-9


def quantity_of(trace: "obspy.Trace") -> str:
    """Return what a channel measures: velocity, acceleration, displacement, volts, pressure, other.

    SAC says it by IDEP, else the instrument letter of a SEED channel code says it; other names
    are taken as velocity.
    """
    said = _SAC_QUANTITIES.get(getattr(trace.stats, "sac", {}).get("idep", 0))
    code = trace.stats.channel.upper()
    if said is not None or len(code) != 3 or code[0] not in _BAND_LETTERS or code[1].isdigit():
        return said or "velocity"
    return _INSTRUMENTS.get(code[1], "other")


def read_traces(path: Path, content: bytes, name: str, entry: FileRead) -> "list[obspy.Trace]":
    """Read the channels of motion and pressure of a known format.

    Records without samples are passed over; channels of text and of other quantities, such as
    the voltage of a recorder, are left out with a warning. Both are logged.

    Raises
    ------
    ReadError
        If the file is broken, holds no such channel, or samples that are not finite.
    """
    # obspy gets the bytes, never the path: it could take that for a pattern or an address
    import obspy

    check_bytes(path, content, name)
    content = _blank_codes(content) if name == "MSEED" else content
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", module="obspy.io.(seg2|sac)")
            warnings.filterwarnings("error", module="obspy.io.mseed")
            traces = list(obspy.read(io.BytesIO(content), format=name))
    except Exception as error:
        reason = _first_sentence(error)
        raise ReadError(f"{path}: is not a readable {name} file ({reason})") from error
    return _usable(path, traces, entry)


def _usable(path, traces, entry):
    """Return the traces of numbers that measure motion or pressure."""
    usable, others = [], {}
    for n, trace in enumerate(traces, 1):
        where = f"{path}, trace {n} ({trace.id})"
        if trace.stats.npts == 0:
            entry.dropped(f"record of {trace.id} at {trace.stats.starttime}", "has no samples")
        elif trace.data.dtype.kind not in "if":
            others[trace.id] = "it holds text"
        elif quantity_of(trace) == "other":
            others[trace.id] = f"its instrument letter {trace.stats.channel[1]} is no motion"
        elif not np.all(np.isfinite(trace.data)):
            sample = np.flatnonzero(~np.isfinite(trace.data))[0]
            raise ReadError(
                f"{where}, sample {sample}: expected a finite number, got {trace.data[sample]:g}"
            )
        elif not 0.0 < trace.stats.delta < 1e4:
            raise ReadError(f"{where}: expected a positive step, got {trace.stats.delta:g} s")
        else:
            usable.append(trace)
    if not usable:
        why = "; ".join(f"{name}: {reason}" for name, reason in others.items()) or "no samples"
        raise ReadError(f"{path}: holds no channel of ground motion ({why})")
    for name, reason in others.items():
        leave_out(path, entry, f"channel {name}", reason)
    return usable


def station_records(
    path: Path,
    traces: "list[obspy.Trace]",
    entry: FileRead,
    *,
    unit: str | None = None,
    time_zero: "str | obspy.UTCDateTime | None" = None,
    orientations: dict[str, tuple[float, float]] | None = None,
) -> list[RawRecord]:
    """Return one raw record per station and instrument from its channels, more where it has gaps.

    Parameters
    ----------
    unit : str, optional
        ``m_per_s``, ``mm_per_s``, ... of velocity, ``m_per_s2``, ... of acceleration, which is
        integrated, or ``counts``. None: floating-point samples of velocity are m/s.
    time_zero : str or obspy.UTCDateTime, optional
        Time 0; the first sample by default.
    orientations : dict of channel code to (azimuth, dip), rad, optional
        SEED sense: azimuth clockwise from north, dip positive down. Needed for channels that
        are not named E, N, Z.

    Raises
    ------
    InputError
        If the unit is not that of what the channels measure, or channels have no orientation.
    ReadError
        If channels differ in sampling or have no time in common.
    """
    import obspy

    stations: dict[tuple, list] = {}
    for trace in traces:
        key = trace.id.rpartition(".")[0], trace.stats.channel[:-1], quantity_of(trace)
        stations.setdefault(key, []).append(trace)
    try:
        zero = None if time_zero is None else obspy.UTCDateTime(time_zero)
    except (TypeError, ValueError):
        raise InputError(f"time_zero: must be an ISO time, got '{time_zero}'") from None
    air = {key: group for key, group in stations.items() if key[2] == "pressure"}
    reasons = {
        key: _unit_against(path, group, key[2], unit)
        for key, group in stations.items() if key not in air
    }  # fmt: skip
    chosen = [key for key, reason in reasons.items() if not reason]
    if not chosen:
        raise InputError(next(iter(reasons.values()), f"{path}: holds pressure alone"))
    for key in set(reasons) - set(chosen):
        names = ", ".join(trace.id for trace in stations[key])
        leave_out(path, entry, f"channel {names}", f"it is {key[2]}; give its unit to read it")
    records = []
    for key in chosen:
        microphones = [t for k, group in air.items() if _station_of(k) == _station_of(key)
                       for t in group]  # fmt: skip
        group = stations[key]
        where = f"{path}, station {group[0].stats.station or '(unnamed)'}"
        axes = partial(_oriented, where, group, orientations=orientations)
        records += _station(where, group, microphones, entry, axes, zero=zero, unit=unit)
    return records


def _station_of(key):
    """Return network and station of a group."""
    return key[0].split(".")[:2]


def _unit_against(path, group, quantity, unit):
    """Return why the samples of a group can't be read in a unit, empty if they can."""
    names = ", ".join(trace.stats.channel or trace.id for trace in group)
    said = "SAC's IDEP" if getattr(group[0].stats, "sac", {}).get("idep") in _SAC_QUANTITIES else (
        "the instrument letter"
    )  # fmt: skip
    if unit is not None and unit != "counts" and unit not in FACTORS:
        return f"unit: must be 'counts' or one such as 'mm_per_s' or 'm_per_s2', got '{unit}'"
    if unit == "counts":
        return ""
    if quantity in ("displacement", "volts"):
        return (
            f"{path}: {names} measure {quantity} by {said}; write velocity, or pass unit='counts' "
            "and remove the response"
        )
    scaled = {trace.stats.calib for trace in group} - {0.0, 1.0}
    if unit is None and scaled:
        return (
            f"{path}: the header of {names} scales samples by {scaled.pop():g} (SCALE, CALIB), and "
            "no program agrees how; pass the unit of the samples, or unit='counts' and the response"
        )
    wanted = "_per_s2" if quantity == "acceleration" else "_per_s"
    if unit is not None and not (unit.endswith(wanted) or (wanted[-1] == "2" and unit == "g")):
        return f"{path}: {names} measure {quantity} by {said}, which is not in '{unit}'"
    if unit is None and quantity == "acceleration":
        return (
            f"{path}: {names} are accelerometers by {said}; pass their unit, such as "
            "unit='m_per_s2', and they are integrated to velocity"
        )
    if unit is None and any(trace.data.dtype.kind == "i" for trace in group):
        return (
            f"{path}, station {group[0].stats.station or '(unnamed)'}: samples are integer counts, "
            "pass unit='counts' and remove the response, or the unit of one count such as "
            "'um_per_s'"
        )
    return ""


def _station(where, group, microphones, entry, axes, *, zero, unit):
    """Return the records of one station: channels in their common times, turned to its axes."""
    first, notes = group[0].stats, ()
    channels, dt = stretches_of(where, group)
    factor = 1.0 if unit == "counts" else FACTORS[unit or "m_per_s"]
    if unit is None and "sac" in first and first.sac.get("idep") == 7:
        factor, note = _sac_velocity(where, group)
        notes = (note,)
    integrate = unit != "counts" and quantity_of(group[0]) == "acceleration"
    origin, records = min(trace.stats.starttime for trace in group), []
    for window in common_windows(where, channels, dt, entry):
        begin, names = origin + window.start, [part.name for part in window.stretches]
        samples, taken = {}, notes
        for n, name in enumerate(names):
            values = factor * window.samples(n, dt).astype(np.float64)
            if integrate:
                values, note = integrated_to_velocity(values, dt)
                taken = (*taken, f"{name} was {note}")
            samples[name.rpartition(".")[2]] = values
        oriented = axes(samples)
        ids = {} if axes.keywords["orientations"] else dict(zip(oriented, names, strict=True))
        for component, name in zip(oriented, names, strict=True):
            entry.column(component, name, unit or "m_per_s", factor, rows=window.length)
        records.append(RawRecord(
            {str(name): values for name, values in oriented.items()}, dt,
            0.0 if zero is None else begin - zero, first.station, first._format,
            time=str(begin), header={"channels": ids}, notes=taken,
            unit="counts" if unit == "counts" else "m_per_s",
            microphone=_microphone(where, microphones, begin, window.length, dt, entry, unit),
        ))  # fmt: skip
    return records


def _sac_velocity(where, group):
    """Return the factor to m/s of velocity by SAC's IDEP, in nm/s by its manual, and a note."""
    peak = max(float(np.max(np.abs(trace.data))) for trace in group)
    if 0.0 < peak < _LEAST_NANOMETRES:
        raise InputError(
            f"{where}: SAC's IDEP says velocity, in nm/s by its manual; a peak of {peak:.3g} would "
            "be below any noise, pass its unit, such as unit='m_per_s'"
        )
    return _NANOMETRES, "taken in nm/s, as SAC defines velocity (IDEP)"


_LEAST_NANOMETRES = 100.0  # a peak below is no velocity of a blast in nm/s


def _microphone(where, traces, begin, length, dt, entry, unit):
    """Return the air overpressure (length,) in Pa of the pressure channel of a station, or None."""
    if not traces:
        return None
    trace = traces[0]
    skip = round((begin - trace.stats.starttime) / dt)
    reason = (
        "there is another one" if len(traces) > 1
        else "its samples are counts" if unit == "counts" or trace.data.dtype.kind == "i"
        else "it has another sampling rate" if common_step([trace.stats.delta, dt], length) is None
        else "it does not cover the record" if skip < 0 or skip + length > trace.stats.npts
        else ""
    )  # fmt: skip
    if reason:
        leave_out(where, entry, f"channel {trace.id} of pressure", reason)
        return None
    entry.column("overpressure", trace.id, "Pa", rows=length, why="no unit, Pa assumed")
    return trace.data[skip : skip + length].astype(np.float64)


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
        if inventory is None and quantity_of(trace) == "acceleration":
            raise InputError(
                f"{where}: {trace.id} is an accelerometer, poles and zeros are of velocity; give "
                "StationXML"
            )
        if inventory is not None:
            _check_epoch(where, trace, record.time, inventory)
        try:
            with warnings.catch_warnings():
                warnings.filterwarnings("error", category=UserWarning, module="obspy")
                if inventory is None:
                    trace.simulate(paz_remove=response, taper_fraction=0.02, water_level=60.0)
                else:
                    trace.remove_response(inventory, output="VEL", taper_fraction=0.02)
        except Exception as error:
            reason = _first_sentence(error)
            raise InputError(f"{where}: no response for {trace.id} ({reason})") from error
        cleaned[name] = np.asarray(trace.data, dtype=np.float64)
    return cleaned


def _check_epoch(where, trace, time, inventory):
    """Refuse a channel with no response or several at the time of a record, or that is turned."""
    import obspy

    name = dict(
        zip(("network", "station", "location", "channel"), trace.id.split("."), strict=True)
    )
    chosen = inventory.select(**name, time=obspy.UTCDateTime(time) if time else None)
    epochs = [each for net in chosen for station in net for each in station if each.response]
    gains = [getattr(epoch.response.instrument_sensitivity, "value", np.nan) for epoch in epochs]
    if len(epochs) != 1:
        shown = (f"{epoch.start_date} to {epoch.end_date or 'now'} with {gain:g}"
                 for epoch, gain in zip(epochs, gains, strict=True))  # fmt: skip
        which = (
            f"several epochs ({', '.join(shown)}); keep that of the record" if epochs else "none"
        )
        raise InputError(f"{where}: no response for {trace.id}: {which}")
    (epoch,) = epochs
    if not epoch.response.response_stages:
        raise InputError(f"{where}: no response for {trace.id}: it has no stages; give sensitivity "
                         f"= {gains[0]:.10g} in place of it if that holds in the band")  # fmt: skip
    incidence = None if epoch.dip is None else 90.0 + epoch.dip
    _refuse_turned(where, trace.id, trace.stats.channel[-1:], epoch.azimuth, incidence)


def read_inventory(path: Path) -> "obspy.Inventory":
    """Read StationXML; document types and entities are refused before parsing."""
    import obspy

    content = read_bytes(path, _MAX_METADATA_BYTES)
    expect(path, content, "response")
    if b"<!" in content.replace(b"<!--", b""):
        raise ReadError(f"{path}: document types and entities are not accepted; remove them")
    try:
        return obspy.read_inventory(io.BytesIO(content), format="STATIONXML")
    except Exception as error:
        reason = _first_sentence(error)
        raise ReadError(f"{path}: is not readable StationXML ({reason})") from error


def _first_sentence(error):
    """Return the first sentence of an error message."""
    return " ".join(str(error).split()).split(". ")[0][:160]


def _refuse_turned(where, name, letter, azimuth, incidence):
    """Raise InputError where a channel E, N or Z points elsewhere by azimuth and incidence, deg."""
    means = {"E": (90.0, 90.0), "N": (0.0, 90.0), "Z": (azimuth or 0.0, 0.0)}.get(letter.upper())
    if means is None or azimuth is None or incidence is None or -12345.0 in (azimuth, incidence):
        return
    turned = (azimuth - means[0] + 180.0) % 360.0 - 180.0, incidence - means[1]
    if max(map(abs, turned)) > AS_NAMED:
        raise InputError(
            f"{where}: {name} points {azimuth:g} degrees from north and {incidence:g} from up, not "
            f"as {letter}; pass orientations (azimuth, dip), or name its channel 1, 2 or 3"
        )


def _component(where, trace):
    """Return the component of a channel by its code, else by azimuth and incidence of SAC."""
    header = getattr(trace.stats, "sac", {})
    azimuth, incidence = (header.get(key, np.nan) for key in ("cmpaz", "cmpinc"))
    by_angles = {(0.0, 0.0): "vertical", (0.0, 90.0): "north", (90.0, 90.0): "east"}
    code = SEED_COMPONENTS.get(trace.stats.channel[-1:].upper())
    _refuse_turned(
        where, trace.id, trace.stats.channel[-1:], header.get("cmpaz"), header.get("cmpinc")
    )
    return code or by_angles.get((float(azimuth), float(incidence)))


def _oriented(where, group, samples, *, orientations):
    """Return east, north, vertical by the headers of the channels or by given orientations."""
    if orientations is None:
        components = {trace.stats.channel: _component(where, trace) for trace in group}
        names = {code: components[code] for code in samples}
        if None in names.values() or len(set(names.values())) < len(names):
            raise InputError(
                f"{where}: channels {', '.join(code or '(unnamed)' for code in samples)} must end "
                "in E, N, Z once each, otherwise pass orientations (azimuth, dip)"
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


_LENGTH_UNITS = {
    "METERS": "m", "METRES": "m", "CENTIMETERS": "cm", "FEET": "ft", "MILLIMETERS": "mm",
    "NONE": "m",
}  # fmt: skip


def read_seg2(path: Path, content: bytes, entry: FileRead) -> dict:
    """Return the samples (n_channels, n_samples) of a SEG-2 gather, and the values of its headers.

    Keys and errors are those of `segy.read_segy`.
    """
    traces = read_traces(path, content, "SEG2", entry)
    n_samples = traces[0].stats.npts
    dt = common_step([trace.stats.delta for trace in traces], n_samples)
    if dt is None or any(trace.stats.npts != n_samples for trace in traces):
        raise ReadError(f"{path}: channels differ in number of samples or sampling rate")
    if n_samples < 2:
        raise ReadError(f"{path}: expected at least 2 samples, got {n_samples}")
    headers = [dict(trace.stats.seg2) for trace in traces]
    scaled = [header.get("DESCALING_FACTOR") for header in headers]
    factor = 1.0
    if any(scaled) != all(scaled) or len({header.get("SKEW", 0) for header in headers}) > 1:
        raise ReadError(
            f"{path}: DESCALING_FACTOR or SKEW differ between channels; write all alike"
        )
    if all(scaled):
        factor = FACTORS["mv"] * np.array(
            [_number(path, n, "DESCALING_FACTOR", text) for n, text in enumerate(scaled)]
        )
    delays = {_number(path, n, "DELAY", h.get("DELAY", "0")) for n, h in enumerate(headers)}
    if len(delays) > 1:
        raise ReadError(f"{path}: channels start at different times: {sorted(delays)} s")
    named = str(headers[0].get("UNITS", "METERS")).upper().strip()
    if named not in _LENGTH_UNITS:
        raise ReadError(f"{path}, UNITS: must be one of {', '.join(_LENGTH_UNITS)}, got {named!r}")
    symbol = _LENGTH_UNITS[named]
    receivers = FACTORS[symbol] * np.array(
        [_place(path, n, "RECEIVER_LOCATION", header) for n, header in enumerate(headers)]
    )
    if len(traces) > 1 and np.all(receivers == receivers[0]):
        receivers = np.full((len(traces), 3), np.nan)
    entry.column("positions", "channel headers", symbol, FACTORS[symbol], rows=len(traces))
    entry.column("samples", "channels", "mV" if all(scaled) else "counts", rows=len(traces))
    data = np.reshape(factor, (-1, 1)) * np.array([trace.data for trace in traces], dtype=float)
    return {
        "data": data, "dt": dt, "time": str(traces[0].stats.starttime),
        "unit": "V" if all(scaled) else "counts", "start": delays.pop(),
        "receiver_positions": receivers, "header": _summary(headers),
        "source_position": FACTORS[symbol] * _place(path, 0, "SOURCE_LOCATION", headers[0]),
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
