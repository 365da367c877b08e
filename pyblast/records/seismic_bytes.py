"""What the bytes of seismological formats say before any decoder sees them."""

import struct
from pathlib import Path

from ..errors import InputError, ReadError

_SEG2_SAMPLE_BYTES = {1: 2, 2: 4, 3: 2.5, 4: 4, 5: 8}
_SEGY_SAMPLE_BYTES = {1: 4, 2: 4, 3: 2, 5: 4}
_CM6_LETTERS = b"+-0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz"


def sniff_seismic(content: bytes) -> str | None:
    """Return MSEED, SAC, SEG2, SEGY or GSE2 by content; None for everything else."""
    return next((name for name, looks in _MAGIC.items() if looks(content)), None)


def check_bytes(path: Path, content: bytes, name: str) -> None:
    """Refuse content that is not of the format, is cut short, or would harm its decoder."""
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
    """Walk along the record lengths of miniSEED to where the last record should end."""
    place = 0
    while place + 48 <= len(content) and _is_mseed(content[place : place + 48]):
        (year,) = struct.unpack_from(">H", content, place + 20)
        order = ">" if 1900 <= year <= 2500 else "<"
        at = place + struct.unpack_from(order + "H", content, place + 46)[0]
        if at + 8 > len(content):
            return at + 8
        if struct.unpack_from(order + "H", content, at)[0] != 1000:
            return 0
        place += 1 << min(content[at + 6], 62)
    return place


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
    """Return the bytes of the text headers and of whole traces, at least one."""
    n_samples, code = struct.unpack(">H2xh", content[3220:3226])
    n_texts = max(0, struct.unpack(">h", content[3504:3506])[0])
    size = 240 + n_samples * _SEGY_SAMPLE_BYTES[code]
    n_traces = max(1, -(-(len(content) - 3600 - 3200 * n_texts) // size))
    return 3600 + 3200 * n_texts + n_traces * size


def _sac_bytes(content):
    """Return the bytes that a SAC header promises."""
    order = "<" if struct.unpack("<i", content[304:308])[0] in (6, 7) else ">"
    return 632 + 4 * max(0, struct.unpack(order + "i", content[316:320])[0])


def _refuse_wild_places(path, content):
    """Refuse SAC places that are no degrees; obspy would turn around the globe without end."""
    order = "<" if struct.unpack("<i", content[304:308])[0] in (6, 7) else ">"
    values = struct.unpack_from(order + "6f", content, 4 * 31)
    for name, value in zip(("stla", "stlo", "", "", "evla", "evlo"), values, strict=True):
        if name and value != -12345.0 and not abs(value) <= 360.0:
            raise ReadError(f"{path}, {name}: must be degrees, got {value:g}")


def _seg2_bytes(content):
    """Return the bytes that the trace pointers and sample counts of SEG-2 promise."""
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
    """Refuse GSE2 whose lines or sample counts would lead obspy's decoder out of its buffers."""
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
        found = len(payload.translate(None, _CM6_LETTERS[32:]))
        if not count.isdigit() or int(count) != found:
            raise ReadError(
                f"{path}, window {n}: header promises {count.decode('latin-1')} "
                f"samples, found {found}"
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
