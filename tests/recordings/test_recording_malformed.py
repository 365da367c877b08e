"""Every malformed recording is refused in one sentence that names the file and the place."""

import contextlib
import pickle
import struct
import time

import numpy as np
import pytest
import recorder_files as files
from recorder_files import sac

from pyblast.errors import InputError, ReadError
from pyblast.recordings.recording import read_gather, read_recording, read_stations

MOTION = np.random.default_rng(3).normal(size=(400, 3))
MSEED = files.miniseed({"R01": MOTION}, reclen=512)
SEG2 = files.seg2(MOTION.T)
ASCII, CSV = files.instantel_ascii(), files.instantel_csv()
TABLE = files.generic()
MAPPING = 'unit = "mm/s"\nsampling_rate_hz = 1000\n[columns]\nvertical = 1\n'
SAMPLE = "\n 0.0000 \t 0.0000 \t 0.0000 \n"


def gse2(payload="+" * 10, n_samples=10, total=0):
    """A GSE2 window of ten zeros, or with something wrong."""
    head = f"WID2 2025/01/02 03:04:05.000 R01   HHZ      CM6 {n_samples:8d}  500.000000"
    tail = "   1.00e+00   1.000         -1.0 -1.0"
    return f"{head}{tail}\nSTA2\nDAT2\n{payload}\nCHK2 {total:8d}\n".encode()


def replaced(text, old, new):
    """Replace once, so that a case can't silently stop being malformed."""
    assert old in text
    return text.replace(old, new, 1)


TEXTS = {
    "empty file": (b"", "is empty"),
    "blank lines only": ("\n\n\n", "is none of"),
    "prose": ("It shook a lot.\n" * 5, "is none of"),
    "zeros": (bytes(5000), "is zeros .as at the beginning of a broken copy"),
    "random bytes": (np.random.default_rng(1).bytes(5000), "is binary .of no kind that is known"),
    "UTF-16 without a mark": (ASCII.encode("utf-16-le"), "is UTF-16 without its mark"),
    "line of a million characters": (ASCII + "7" * 1_000_000, r"line 4\d\d: has 1000000 char"),
    "samples without separators": (replaced(CSV, '"0.0000","0.0000"', '"0.0000"'), "found 2"),
    "NUL in the samples": (replaced(ASCII, SAMPLE, "\n0\0\n"), r"line 3\d: expected text"),
    "ASCII without samples": (ASCII[: ASCII.index(" Tran ")], "at least two rows"),
    "ASCII channels only": (ASCII[: ASCII.index(" 0.0000")], "at least two rows|promises"),
    "ASCII cut in a line": (ASCII[:-40], "expected 3 columns, found|promises 384 samples"),
    "ASCII cut after a line": (ASCII[: ASCII.rindex("\n 0.0000", 0, -2000)], "promises 384"),
    "ASCII nan": (replaced(ASCII, SAMPLE, "\n nan \t 0.0 \t 0.0 \n"), "'transverse'.*finite"),
    "ASCII inf": (replaced(ASCII, SAMPLE, "\n 0.0 \t -inf \t 0.0 \n"), "'vertical'.*finite"),
    "ASCII letters": (replaced(ASCII, SAMPLE, "\n 0.0 \t OVER \t 0 \n"), "number, got 'OVER'"),
    "ASCII underscore": (replaced(ASCII, SAMPLE, "\n 1_0 \t 0 \t 0 \n"), "number, got '1_0'"),
    "ASCII 1e308": (replaced(ASCII, SAMPLE, "\n 1e308 \t 0 \t 0 \n"), "faster than any ground"),
    "ASCII two columns": (replaced(ASCII, SAMPLE, "\n 0.0 \t 0.0 \n"), "3 columns, found 2"),
    "ASCII comma and point": (
        replaced(ASCII, SAMPLE, "\n 0,0 \t 0.0 \t 0.0 \n").replace("12.5000", "1.2,5"),
        "mixes decimal points and decimal commas",
    ),
    "ASCII no rate": (files.instantel_ascii(changes={"Sample Rate": None}), "'Sample Rate'"),
    "ASCII rate of zero": (
        files.instantel_ascii(changes={"Sample Rate": "0 sps"}), "rate must lie between 10"
    ),
    "ASCII rate of words": (
        files.instantel_ascii(changes={"Sample Rate": "fast"}), "'Sample Rate': expected a number"
    ),
    "ASCII rate with thousands": (
        files.instantel_ascii(changes={"Sample Rate": "1,024 sps"}), "between 10 .*got 1.024"
    ),
    "ASCII unit unknown": (files.instantel_ascii(changes={"Units": "furlong/s"}), "'furlong/s'"),
    "ASCII unit of length": (files.instantel_ascii(changes={"Units": "mm"}), "unit of velocity"),
    "ASCII range of zero": (files.instantel_ascii(changes={"Geo Range": "0 mm/s"}), "full scale"),
    "ASCII channel twice": (replaced(ASCII, " Vert \t", " Tran \t"), "are both transverse"),
    "CSV without channels": (CSV[: CSV.index('"Tran",')], "row of channels|columns|rows"),
    "CSV nan": (replaced(CSV, '"0.0000"', '"NaN"'), "finite"),
    "CSV mixed marks": (
        replaced(files.instantel_csv(decimal=","), '"0,0000"', '"0.0000"'), "mixes decimal"
    ),
    "Texcel without units": (files.texcel().split("\n")[0] + "\n", "line 2: expected one unit"),
    "Texcel two units": (replaced(files.texcel(), "[mm/s]", "[in/s]"), "must share one unit"),
    "Texcel other frequency": (files.texcel(frequency=2048), "stated as 2048 Hz"),
    "Vibracord without rate": (files.vibracord(rate=""), "'Sampling rate'"),
    "Vibracord other rate": (files.vibracord(rate="500 sps"), "stated as 500 Hz"),
    "table decimal comma": (TABLE.replace(".", ","), "line 3: has 7 cells under 4 titles"),
    "table other velocity": (replaced(TABLE, "east_m_per_s", "up_m_per_s"), "up_m_per_s are vel"),
    "table unit of length": (replaced(TABLE, "east_m_per_s", "east_mm"), "is in 'mm', not read"),
    "table without unit": (replaced(TABLE, "east_m_per_s", "east"), "needs its unit, mm/s"),
    "table column twice": (replaced(TABLE, "east_m_per_s", "north_m_per_s"), "both be the north"),
    "table time only": ("time_s,\n0,\n1,\n", "a column of motion is missing"),
    "table time stands": (
        files.generic(rows=[[0.0, 1.0, 1.0, 1.0]] * 5), "time must grow, got 0 s"
    ),
    "table time jumps": (replaced(TABLE, "\n0.004,", "\n0.0048,"), "line 6: time must grow by equ"),
    "table time back": (replaced(TABLE, "\n0.007,", "\n-0.007,"), "time must grow"),
    "table mixed axes": (replaced(TABLE, "east_", "longitudinal_"), "mix two sets of axes"),
}  # fmt: skip

TRACES = {
    "pickle": (pickle.dumps([1, 2, 3]), "is a pickle .objects of Python"),
    "MSEED cut in a record": (MSEED[:-100], "cut short"),
    "MSEED cut in the header": (MSEED[:60], "cut short|is not a readable MSEED file"),
    "MSEED blank body": (MSEED[:8] + bytes(len(MSEED) - 8), "is binary .of no kind"),
    "MSEED nan": (files.miniseed({"R01": MOTION * np.nan}), "XX.R01.*finite number, got nan"),
    "MSEED in swapped bytes": (
        files.miniseed({"R01": MOTION.astype(">f8").view("<f8")}), "sample 0: expected a finite|"
        "faster than any ground",
    ),
    "SAC cut short": (sac(given=5), "cut short, SAC header promises 672 bytes"),
    "SAC of negative length": (sac(n_samples=-5), "is not a readable SAC file|at least 2 samples"),
    "SAC wild longitude": (sac(longitude=1e30), "stlo: must be degrees, got 1e"),
    "SAC inf": (sac(value=np.inf), "finite number, got inf"),
    "GSE2 cut short": (b"WID2 2025/01/02 03:04:05.000 R01   HHZ      CM6   999999   500.000000",
                       "window 1: expected DAT2"),
    "GSE2 of other letters": (gse2(payload="+" * 9 + "!"), "window 1: expected letters of CM6"),
    "GSE2 of too few samples": (gse2(n_samples=11), "promises 11 samples, found 10"),
    "GSE2 of a long line": (gse2(payload="+" * 200, n_samples=200), "lines of 80 letters"),
    "GSE2 of a wrong sum": (gse2(total=7), "is not a readable GSE2 file .*7"),
    "GSE2 of rubbish": (b"WID2 " + b"x" * 500, "is not a readable GSE2 file"),
}  # fmt: skip

GATHERS = {
    "SEG2 cut in the samples": (SEG2[:-10], "cut short"),
    "SEG2 cut in the pointers": (SEG2[:36], "cut short"),
    "SEG2 promising too much": (files.seg2(MOTION.T, n_promised=4_000_000_000), "cut short"),
    "SEG2 in swapped bytes": (SEG2[1::-1] + SEG2[2:], "cut short|is not a readable SEG2"),
    "SEG2 wild pointer": (SEG2[:32] + b"\xff" * 4 + SEG2[36:], "cut short"),
    "SEG2 nan": (files.seg2(MOTION.T * np.nan), "sample 0: expected a finite number"),
    "SEG2 delay of words": (files.seg2(MOTION.T, start="late"), "is not a readable SEG2|DELAY"),
    "SEG2 factor of words": (files.seg2(MOTION.T, descaling="x"), "is not a readable SEG2|DESCAL"),
    "text": (ASCII.encode(), "is text .* export the gather as SEG-2 or SEG-Y"),
    "SEGY cut short": (b"C" * 3216 + struct.pack(">4H", 1000, 0, 100, 0) + struct.pack(">H", 5)
                       + bytes(600), "cut short"),
}  # fmt: skip

MAPPINGS = {
    "broken TOML": ("unit = ", "expected TOML"),
    "deep nesting": ("a = " + "[" * 90_000, "expected TOML"),
    "unknown key": (MAPPING.replace("unit", "units", 1), "unknown key 'units', did you mean unit"),
    "rate without a unit": (MAPPING.replace("_hz", ""), "did you mean sampling_rate_hz"),
    "no unit": (MAPPING.replace('unit = "mm/s"', ""), "column 1 'A' needs its unit, mm/s"),
    "no columns": (MAPPING.split("[")[0], "expected titles such as"),
    "no sampling": (
        MAPPING.replace("sampling_rate_hz = 1000", ""),
        "time is missing",
    ),
    "infinite rate": (MAPPING.replace("1000", "inf"), "rate must lie between"),
    "boolean rate": (MAPPING.replace("1000", "true"), "has the wrong type"),
    "column zero": (MAPPING.replace("vertical = 1", "vertical = 0"), "column from 1, got 0"),
    "absent title": (MAPPING.replace("vertical = 1", 'vertical = "V"'), "asks for column 'V'"),
    "unknown component": (MAPPING.replace("vertical =", "up ="), "columns.up must be a component"),
    "odd delimiter": ('delimiter = "ab"\n' + MAPPING, "delimiter can't be 'ab'"),
    "negative header": ("header_rows = -1\n" + MAPPING, "must not be negative"),
    "binary": ("\0", "NUL byte"),
}


def refuse(path, read):
    """Read, and return the one sentence of the refusal."""
    began = time.monotonic()
    with pytest.raises((ReadError, InputError)) as caught:
        read()
    message = str(caught.value)

    assert time.monotonic() - began < 5.0
    assert str(path) in message
    assert "\n" not in message
    assert len(message) < 400 + len(str(path))
    return message


def written(tmp_path, content, name="record.dat"):
    path = tmp_path / name
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


@pytest.mark.parametrize("name", TEXTS)
def test_malformed_text_is_refused(tmp_path, name):
    content, reason = TEXTS[name]
    path = written(tmp_path, content)

    message = refuse(path, lambda: read_recording(path))

    assert_reason(message, reason)


@pytest.mark.parametrize("name", TRACES)
def test_malformed_trace_is_refused(tmp_path, name):
    content, reason = TRACES[name]
    path = written(tmp_path, content)

    message = refuse(path, lambda: read_stations(path))

    assert_reason(message, reason)


@pytest.mark.parametrize("name", GATHERS)
def test_malformed_gather_is_refused(tmp_path, name):
    content, reason = GATHERS[name]
    path = written(tmp_path, content)

    message = refuse(path, lambda: read_gather(path))

    assert_reason(message, reason)


@pytest.mark.parametrize("name", MAPPINGS)
def test_malformed_mapping_is_refused(tmp_path, name):
    content, reason = MAPPINGS[name]
    mapping = written(tmp_path, content, "mapping.toml")
    path = written(tmp_path, "A\n1.0\n2.0\n3.0\n")

    message = refuse(tmp_path, lambda: read_recording(path, mapping=mapping))

    assert_reason(message, reason)


@pytest.mark.parametrize("kind", ["folder", "absent"])
def test_what_is_no_file_is_refused(tmp_path, kind):
    path = tmp_path if kind == "folder" else tmp_path / "absent.txt"

    assert_reason(refuse(path, lambda: read_recording(path)), "expected a file")


def test_decimal_comma_against_the_mapping_is_refused(tmp_path):
    mapping = written(tmp_path, 'delimiter = ";"\n' + MAPPING, "mapping.toml")
    path = written(tmp_path, "A\n1.0\n2,0\n3.0\n")

    message = refuse(path, lambda: read_recording(path, mapping=mapping))

    assert_reason(message, "mixes decimal points and decimal commas, '2,0' and '1.0'")


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("seed", range(60))
def test_flipped_bytes_are_read_or_refused_but_never_fall_through(tmp_path, seed):
    rng = np.random.default_rng(seed)
    valid = [ASCII, CSV, files.texcel(), files.vibracord(), TABLE, MSEED, SEG2, sac()][seed % 8]
    content = bytearray(valid.encode() if isinstance(valid, str) else valid)
    for place in rng.integers(0, min(len(content), 1500), size=5):
        content[place] = rng.integers(256)
    path = written(tmp_path, bytes(content))
    with contextlib.suppress(ReadError, InputError):
        (read_gather if seed % 8 == 6 else read_recording)(path)


def assert_reason(message, reason):
    """Hold the sentence against the reason."""
    with pytest.raises(ReadError, match=reason):
        raise ReadError(message)
