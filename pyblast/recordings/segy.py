"""SEG-Y: samples and headers of gathers in any revision, byte order and sample format."""

import struct
from collections.abc import Sequence
from datetime import datetime, timedelta
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..errors import ReadError
from ..readers.provenance import FileRead
from ..units import FACTORS

_FORMATS = {
    1: "u4", 2: "i4", 3: "i2", 5: "f4", 6: "f8", 8: "i1", 10: "u4", 11: "u2", 12: "u8", 16: "u1",
}  # fmt: skip
_IBM = 1
_TEXT, _HEAD, _TRACE = 3200, 400, 240
_MEASURES = {1: "m", 2: "ft"}
_ORDER_MARK = 0x01020304
# Words of the headers that change places, amounts or times: each is obeyed or refused.
WORDS = "scalar scalar_z scalar_time units measure delay weight step extended"


class Layout(NamedTuple):
    """Layout of a SEG-Y file: order ">" or "<", code of samples, starts and counts of traces.

    ``fixed``: the file says that all traces are alike, so that trace headers need not agree.
    """

    order: str
    code: int
    starts: np.ndarray
    n_samples: np.ndarray
    fixed: bool


def _order(content):
    """Return the byte order in which the binary header makes sense, "" for none."""
    if len(content) < _TEXT + _HEAD:
        return ""
    beyond = content[_TEXT + _HEAD + 114 : _TEXT + _HEAD + 118].ljust(4, b"\0")
    for order in "><":
        if struct.unpack(f"{order}I", content[3296:3300])[0] == _ORDER_MARK:
            return order
    for order in "><":
        step, n_samples, code = struct.unpack(f"{order}H2xH2xh", content[3216:3226])
        own = struct.unpack(f"{order}HH", beyond)
        if code in _FORMATS and (n_samples or own[0]) and (step or own[1]):
            return order
    return ""


def layout(path: Path, content: bytes) -> Layout:
    """Return the layout of a SEG-Y file, by its headers as far as its length agrees with them.

    Raises
    ------
    ReadError
        If the file is cut short, or no count of samples agrees with its length.

    Notes
    -----
    SEG technical standards: revision 1 (2002), bytes 3213-3226, 3501-3506 and 115-118; revision 2
    (2017), bytes 3297-3300. Where the fixed-length flag is 0, traces have their own counts.
    """
    order = _order(content)
    if not order:
        raise ReadError(f"{path}: its binary header says neither samples nor interval of SEG-Y")
    (n_file,) = struct.unpack_from(f"{order}H", content, 3220)
    (code,) = struct.unpack_from(f"{order}h", content, 3224)
    (step,), (count, exact) = (struct.unpack_from(order + form, content, at)
                               for form, at in (("H", 3216), ("Id", 3268)))  # fmt: skip
    other = count not in (0, n_file) or exact not in (0.0, float(step)) or any(content[3506:3510])
    if 2 in content[3500:3502] and other:
        raise ReadError(f"{path}: is SEG-Y of revision 2 with extended counts; write revision 1")
    flag, n_texts = struct.unpack_from(f"{order}2h", content, 3502)
    first = _TEXT + _HEAD + _TEXT * _extended(path, content, n_texts)
    width = np.dtype(_FORMATS[code]).itemsize
    walked = _walk(content, order, first, width, n_file)
    whole = _TRACE + n_file * width
    alike = n_file > 0 and len(content) > first and (len(content) - first) % whole == 0
    if alike and (flag == 1 or walked is None):
        starts = np.arange(first, len(content), whole)
        return Layout(order, code, starts, np.full(len(starts), n_file), True)
    if walked is None:
        size = _TRACE + width * (n_file or 1)
        n_traces = max(1, -(-(len(content) - first) // size))
        raise ReadError(
            f"{path}: is cut short, SEGY header promises {first + n_traces * size} bytes or more, "
            f"found {len(content)}"
        )
    return Layout(order, code, *walked, flag == 1)


def _extended(path, content, n_texts):
    """Return the number of extended text headers; -1 says: up to the one that ends them."""
    if n_texts >= 0:
        return n_texts
    for n in range((len(content) - _TEXT - _HEAD) // _TEXT):
        begin = _TEXT + _HEAD + _TEXT * n
        head = content[begin : begin + 40]
        if any("((SEG:ENDTEXT))" in head.decode(c, "replace").upper().replace(" ", "")
               for c in ("ascii", "cp037")):  # fmt: skip
            return n + 1
    raise ReadError(f"{path}: no extended text header is ((SEG: EndText)), as byte 3505 promises")


def _walk(content, order, first, width, n_file):
    """Return where traces start and their counts by their own headers, None if that misses."""
    starts, counts, at = [], [], first
    while at + _TRACE <= len(content):
        n_samples = struct.unpack_from(f"{order}H", content, at + 114)[0] or n_file
        if n_samples == 0:
            return None
        starts.append(at)
        counts.append(n_samples)
        at += _TRACE + n_samples * width
    return (np.array(starts), np.array(counts)) if starts and at == len(content) else None


def read_segy(path: Path, content: bytes, entry: FileRead) -> dict:
    """Return the samples (n_channels, n_samples) of a gather, and the values of its headers.

    Parameters
    ----------
    path : Path
        For messages.
    content : bytes
    entry : FileRead
        Gets the unit of lengths, what headers contradict, and what was taken.

    Returns
    -------
    dict
        ``data``, ``dt`` (s), ``start`` (s), ``receiver_positions`` (n_channels, 3) and
        ``source_position`` (3,) in m, ``time``, ``unit``, ``header``.

    Raises
    ------
    ReadError
        If the file is cut short, channels differ in sampling or start, samples are not finite,
        or the interval is nowhere given.
    """
    plan = layout(path, content)
    heads = [_trace_header(content, plan.order, start) for start in plan.starts]
    if len(set(plan.n_samples)) > 1:
        raise ReadError(f"{path}: channels differ in number of samples or sampling rate")
    n_samples = int(plan.n_samples[0])
    others = {head["n_samples"] for head in heads} - {0, n_samples}
    if others:
        entry.remark(f"trace headers say {min(others)} samples, file and length {n_samples}")
    data = np.array([_samples(content, plan, n) for n in range(len(heads))])
    if not np.isfinite(data).all():
        n, k = np.argwhere(~np.isfinite(data))[0]
        raise ReadError(
            f"{path}, trace {n + 1}, sample {k}: expected a finite number, got {data[n, k]:g}"
        )
    delays = {float(_scaled([head["delay"]], [head["scalar_time"]])[0]) for head in heads}
    if len({head["weight"] for head in heads}) > 1:
        raise ReadError(f"{path}: weighting factors of traces differ (byte 169); write them alike")
    if len(delays) > 1:
        raise ReadError(f"{path}: channels start at different times: {sorted(delays)} ms")
    receivers, source = _positions(content, plan, heads, entry)
    year, day, *clock = heads[0]["time"]
    sensible = 0 < year < 2500 and 0 < day <= 366 and all(0 <= part < 60 for part in clock)
    year += 0 if year >= 100 else 1900 if year > 30 else 2000
    span = timedelta(days=day - 1, hours=clock[0], minutes=clock[1], seconds=clock[2])
    time = f"{(datetime(year, 1, 1) + span).isoformat()}Z" if sensible else ""
    return {
        "data": data, "dt": _interval(path, content, plan, heads, entry), "time": time,
        "start": FACTORS["ms"] * delays.pop(), "receiver_positions": receivers,
        "source_position": source, "unit": "counts",
        "header": {"textual": "SEGY"},
    }  # fmt: skip


def _trace_header(content, order, at):
    """Return the fields of a trace header that are used."""

    def read(form, byte):
        return struct.unpack_from(order + form, content, at + byte - 1)

    (offset, receiver_z, source_z, depth), scalars = read("4i", 37), read("2h", 69)
    return {
        "offset": offset, "receiver_z": receiver_z, "source_z": source_z - depth,
        "scalar_z": scalars[0], "scalar": scalars[1], "xy": read("4i", 73),
        "units": read("h", 89)[0], "delay": read("h", 109)[0], "n_samples": read("H", 115)[0],
        "step": read("H", 117)[0], "time": read("5h", 157), "weight": read("h", 169)[0],
        "scalar_time": read("h", 215)[0],
    }  # fmt: skip


def _samples(content, plan, n):
    """Return the samples (n_samples,) of a trace."""
    kind = np.dtype(_FORMATS[plan.code]).newbyteorder(plan.order)
    raw = np.frombuffer(content, kind, int(plan.n_samples[n]), int(plan.starts[n]) + _TRACE)
    if plan.code != _IBM:
        return raw.astype(np.float64)
    raw = raw.astype(np.uint32)  # sign, exponent of 16 above 64, fraction of 24 bits
    fraction = (raw & 0x00FFFFFF).astype(np.float64)
    exponent = ((raw >> 24) & 0x7F).astype(np.int64)
    sign = np.where(raw >> 31, -1.0, 1.0)
    return sign * np.ldexp(fraction, 4 * (exponent - 64) - 24)


def _interval(path, content, plan, heads, entry):
    """Return the sampling interval in s, of the binary header where traces have none."""
    (step,) = struct.unpack_from(f"{plan.order}H", content, 3216)
    own = {head["step"] for head in heads} - {0}
    if len(own) > 1 and not (plan.fixed and step):
        raise ReadError(f"{path}: channels differ in number of samples or sampling rate")
    chosen, where = (step, "binary header") if plan.fixed and step else (0, "")
    if not chosen:
        chosen, where = (own.pop(), "trace headers") if own else (step, "binary header")
    if not chosen:
        raise ReadError(f"{path}: neither the binary header nor the traces say the interval")
    if other := ({step, *own} - {0, chosen}):
        entry.remark(f"headers differ in the interval: {min(other)} µs elsewhere")
    entry.column("interval", where, "µs", 1e-6, rows=1)
    return 1e-6 * chosen


def _scaled(values: Sequence, scalars: Sequence[int]) -> np.ndarray:
    """Apply the scalars of SEG-Y: a positive one multiplies, a negative one divides."""
    factor = np.array([float(s or 1) for s in scalars])
    factor = np.where(factor > 0.0, factor, -1.0 / factor)
    return np.asarray(values, dtype=float) * np.reshape(factor, (-1, *[1] * (np.ndim(values) - 1)))


def _positions(content, plan, heads, entry):
    """Return positions of receivers (n, 3) and of the source (3,) in m, NaN where not said."""
    (measure,) = struct.unpack_from(f"{plan.order}h", content, 3254)
    symbol = _MEASURES.get(measure, "m")
    why = "" if measure in _MEASURES else f"measurement system {measure}, metres are assumed"
    xy = _scaled([head["xy"] for head in heads], [head["scalar"] for head in heads])
    z = _scaled(
        [[head["receiver_z"], head["source_z"]] for head in heads],
        [head["scalar_z"] for head in heads],
    )
    if not (z[:, 0].any() and z[:, 1].any()):  # heights of one side alone say nothing
        z[:] = 0.0
    receivers = np.column_stack([xy[:, 2:], z[:, 0]])
    source = np.append(xy[0, :2], z[0, 1])
    offsets = np.array([head["offset"] for head in heads], dtype=float)
    if len(np.unique(xy[:, :2], axis=0)) > 1:
        n_sources = len(np.unique(xy[:, :2], axis=0))
        entry.dropped("source position", f"the traces name {n_sources} sources, not one shot")
        source = np.full(3, np.nan)
    degrees = {head["units"] for head in heads} & {2, 3, 4}
    said = not degrees and (len(heads) == 1 or not np.all(receivers == receivers[0]))
    if degrees:
        entry.dropped("coordinates", "they are in degrees or seconds of arc, not in lengths")
    if not said and np.ptp(offsets) > 0.0:
        receivers = np.column_stack([offsets, np.zeros((len(heads), 2))])
        source, why = np.zeros(3), f"distances of bytes 37-40 along a line; {why}".rstrip("; ")
    elif not said:
        receivers = np.full((len(heads), 3), np.nan)
    entry.column("positions", "trace headers", symbol, FACTORS[symbol], rows=len(heads), why=why)
    return FACTORS[symbol] * receivers, FACTORS[symbol] * source
