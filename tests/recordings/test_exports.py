"""Exports of seismographs: flat tops at any level, lines that do not matter, words that do."""

import warnings
from pathlib import Path

import numpy as np
import pytest
import recorder_files as files

from pyblast.errors import PyblastWarning, ReadError
from pyblast.readers.provenance import ReadLog
from pyblast.recordings.raw import clipped_samples
from pyblast.recordings.recording import read_recording

REPORTED = Path(__file__).parents[1] / "reported"
TIMES = np.arange(2000) / 1000.0
DIGIT = 0.51e-7  # m/s, of the last printed one


def read(path, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PyblastWarning)
        return read_recording(path, **options)[0]


def ppv(folder, text, name="record.txt", **options):
    return 1e3 * read(files.write(folder, text, name), **options).seismogram.ppv


AS_MADE = pytest.approx([8.0, 12.5, 20.0], abs=1e-4)


# flat tops


@pytest.mark.parametrize("geo_range", ["8.0", "16.0", "254.0", None])
def test_flat_tops_are_clipped_whatever_range_the_header_states(tmp_path, geo_range):
    text = (REPORTED / "141-flat-tops-below-the-range" / "geo8.txt").read_text()
    line = "" if geo_range is None else f'"Geo Range : {geo_range} mm/s"\n'
    path = files.write(tmp_path, text.replace('"Geo Range : 8.0 mm/s"\n', line))

    assert read(path).clipped.sum(axis=0).tolist() == [174, 0, 108]


@pytest.mark.parametrize("offset", [0.0, 0.3])
@pytest.mark.parametrize("level", [0.5, 2.0, 7.9])
@pytest.mark.parametrize("full_scale", [None, 12.0])
def test_each_side_is_cut_at_its_own_level(level, offset, full_scale):
    whole = 9.0 * np.sin(2.0 * np.pi * 7.0 * TIMES) * np.exp(-TIMES)
    cut = np.round(np.clip(whole, -level, level) + offset * level, 4)

    marks, found = clipped_samples(cut[None], full_scale)

    assert np.array_equal(marks[0], np.abs(whole) >= level)
    assert found == (full_scale or pytest.approx((1.0 + offset) * level, abs=1e-4))


def test_rest_on_one_side_of_a_pulse_is_no_flat_top():
    pulse = np.where(TIMES < 0.1, np.sin(10.0 * np.pi * TIMES), 0.0) - 0.05

    assert not clipped_samples(pulse[None])[0].any()


# lines of a header


LINES = {
    "Record Time": "0.375 sec at 1024 sps", "Tran PPV": "high", "Vert ZC Freq": "see report",
    "Long Time of Peak": "13:04:05", "Peak Vector Sum": "*", "Geo Range": "auto",
    "Trigger": "Geo: 0.510 mm/s", "Battery Level": "?", "File Name": "C:\\a\\b.IDFW",
    "Calibration": "", "Sensor Check": "Tran Vert Long passed", "Notes": "10:30 wind, 3 m/s; dry",
}  # fmt: skip


@pytest.mark.parametrize("key", LINES)
@pytest.mark.parametrize("layout", [files.instantel_ascii, files.instantel_csv])
def test_a_line_that_is_not_needed_never_refuses_a_file(tmp_path, layout, key):
    key, value = key.replace(" ", "") if layout is files.instantel_csv else key, LINES[key]

    assert ppv(tmp_path, layout(changes={key: value})) == AS_MADE


def changed(old, new):
    return lambda text: text.replace(old, new)


TITLES = " Tran \t Vert \t Long "
HABITS = {
    "titles in quotes": changed(TITLES, '"Tran"\t"Vert"\t"Long"'),
    "titles with units": changed(TITLES, "Tran (mm/s)\tVert (mm/s)\tLong (mm/s)"),
    "titles by commas": lambda text: "\n".join(
        ",".join(line.split("\t")) if "\t" in line else line for line in text.split("\n")
    ),
    "titles by semicolons, decimal commas": lambda text: "\n".join(
        ";".join(line.replace(".", ",").split("\t")) if "\t" in line else line
        for line in text.split("\n")
    ),
    "units below the titles": changed(TITLES, f"{TITLES}\n mm/s \t mm/s \t mm/s"),
    "line below the titles": changed(TITLES, f"{TITLES}\n---\t---\t---"),
    "blanks in keys": changed('"Sample Rate :', '" Sample  Rate   :'),
    "no blank before the colon": lambda text: text.replace(" : ", ": "),
    "no quotes": lambda text: text.replace('"', ""),
    "keys in capitals": lambda text: "\n".join(
        line.upper() if line.startswith('"') and "Serial" not in line else line
        for line in text.split("\n")
    ),
    "footer": lambda text: f'{text}\n"End of data"\n"Printed : 2 pages"\n',
    "rate in the record time": lambda text: text.replace(
        '"Sample Rate : 1024 sps"\n', "").replace("0.25 sec", "0.25 sec at 1024 sps"),
    "unit of the peaks alone": changed('"Units : mm/s and "\n', ""),
    "range below the level": changed("Geo Range : 254.0 mm/s", "Geo Range : 31.7 mm/s"),
}  # fmt: skip


@pytest.mark.parametrize("habit", HABITS)
def test_habits_of_exports_are_read(tmp_path, habit):
    text = HABITS[habit](files.instantel_ascii())

    assert text != files.instantel_ascii()
    assert ppv(tmp_path, text) == AS_MADE


def test_the_reported_export_is_read():
    motion = read(REPORTED / "142-instantel-header-lines" / "quoted280.txt").seismogram

    assert 1e3 * motion.ppv == pytest.approx([3.836, 1.926, 3.113], abs=1e-3)
    assert (motion.start, motion.dt) == pytest.approx((-0.25, 1 / 1024))


def test_what_is_not_read_stands_in_the_log(tmp_path):
    log = ReadLog()
    text = files.instantel_ascii(changes={"Tran PPV": "high"}) + "End of data\n"

    read(files.write(tmp_path, text), log=log)

    assert "'Tran PPV' is not read: 'high'" in "\n".join(log.lines())
    assert "'End of data'" in "\n".join(log.lines())


@pytest.mark.parametrize(
    ("changes", "reason"),
    [({"Units": None} | {f"{n} PPV": None for n in files.AMPLITUDE}, "'Units': expected a unit"),
     ({"Sample Rate": None}, "'Sample Rate'"), ({"Pre-trigger Length": "short"}, "'Pre-trigger")],
)  # fmt: skip
def test_what_is_needed_and_nowhere_stated_is_never_assumed(tmp_path, changes, reason):
    with pytest.raises(ReadError, match=reason):
        ppv(tmp_path, files.instantel_ascii(changes=changes))


@pytest.mark.parametrize("layout", [files.texcel, files.vibracord, files.instantel_csv])
def test_footers_of_other_exports_are_no_samples(tmp_path, layout):
    assert ppv(tmp_path, layout() + '\n"Printed by","X. Y."\n') == AS_MADE


# tables


def table(head, titles, factor=1.0, time=True):
    record = files.motion()
    rows = [
        [*([f"{n / files.RATE:.7f}"] if time else []),
         *(f"{factor * record[name][n]:.9g}" for name in ("Long", "Tran", "Vert"))]
        for n in range(len(record["Tran"]))
    ]  # fmt: skip
    return "\n".join([*head, ";".join(titles), *(";".join(row) for row in rows)])


NAMES = ["Long", "Tran", "Vert"]


@pytest.mark.parametrize(
    ("line", "factor"),
    [("Units: mm/s", 1.0), ("# unit = in/s", 1 / 25.4), ('"Velocity units";"cm/s"', 0.1),
     ("Einheit;mm/s", 1.0), ("Units : mm/s and Pa(L)", 1.0)],
)  # fmt: skip
def test_a_unit_above_the_titles_is_that_of_columns_without_one(tmp_path, line, factor):
    text = table(["Site: quarry", line], ["Time (s)", *NAMES], factor)

    assert ppv(tmp_path, text) == AS_MADE


def test_a_unit_in_the_title_goes_before_that_above(tmp_path):
    titles = ["Time (s)", *(f"{name} (mm/s)" for name in NAMES)]

    assert ppv(tmp_path, table(["Units: in/s"], titles)) == AS_MADE


@pytest.mark.parametrize(
    "line", ["Sample rate: 1024 Hz", "Sampling frequency (Hz);1024", "dt;0.9765625 ms",
             "Sampling interval = 976.5625 us"],
)  # fmt: skip
def test_a_rate_above_the_titles_stands_for_the_column_of_time(tmp_path, line):
    text = table([line, "Pre-trigger: 0.125 s", "Units: mm/s"], NAMES, time=False)

    motion = read(files.write(tmp_path, text)).seismogram

    assert (1.0 / motion.dt, motion.start) == pytest.approx((1024.0, -0.125))
    assert 1e3 * motion.ppv == AS_MADE


@pytest.mark.parametrize(
    ("unit", "size"),
    [("g", 9.80665), ("m/s2", 1.0), ("m/s^2", 1.0), ("m/s²", 1.0), ("cm/s2", 0.01), ("Gal", 0.01),
     ("mm/s²", 0.001)],
)  # fmt: skip
def test_accelerations_are_integrated(tmp_path, unit, size):
    turns = 2.0 * np.pi * 20.0
    velocity = 0.01 * np.sin(turns * TIMES)
    rows = (f"{t:.4f},{turns * 0.01 * np.cos(turns * t) / size:.9g}" for t in TIMES)
    path = files.write(tmp_path, f"Time (s),Vert ({unit})\n" + "\n".join(rows))

    with pytest.warns(PyblastWarning, match="vertical was integrated from acceleration"):
        (recording,) = read_recording(path)

    assert recording.seismogram.velocity[:, 2] == pytest.approx(velocity, abs=2e-4)


@pytest.mark.parametrize(
    ("unit", "size"), [("us", 1e-6), ("µs", 1e-6), ("min", 60.0), ("ms", 1e-3)]
)
def test_times_are_read_in_their_unit(tmp_path, unit, size):
    rows = (f"{n * 0.001 / size:.9g},{np.sin(0.1 * n):.6f}" for n in range(300))
    path = files.write(tmp_path, f"Time ({unit}),Vert (mm/s)\n" + "\n".join(rows))

    assert read(path).seismogram.dt == pytest.approx(0.001)


# rates


@pytest.mark.parametrize("steps", [(1 / 500, 1 / 500.00003), (0.000977, 1 / 1024)])
@pytest.mark.parametrize("format", ["MSEED", "SAC"])
def test_rates_that_differ_by_rounding_are_one(tmp_path, format, steps):
    paths = [
        files.write_trace(tmp_path / f"{code}.x", np.sin(0.1 * np.arange(500)) * 1e-3, format,
                          delta=step, channel=f"HH{code}", station="R01")
        for code, step in zip("EN", steps, strict=True)
    ]  # fmt: skip

    assert read(paths, unit="m_per_s").seismogram.present.tolist() == [True, True, False]


def test_other_rates_are_refused(tmp_path):
    paths = [
        files.write_trace(tmp_path / f"{code}.x", np.sin(0.1 * np.arange(500)) * 1e-3, "MSEED",
                          delta=step, channel=f"HH{code}", station="R01")
        for code, step in zip("EN", (1 / 500, 1 / 501), strict=True)
    ]  # fmt: skip

    with pytest.raises(ReadError, match="differ in sampling rate"):
        read(paths, unit="m_per_s")
