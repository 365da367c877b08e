"""Each seismograph layout gives back the motion and the values that its device printed."""

import math
import warnings

import numpy as np
import pytest
import recorder_files as files

from pyblast.errors import PyblastWarning
from pyblast.recordings.recording import read_recording

PRINTED_DIGIT = 0.5e-4 * 1e-3 * 1.01
LAYOUTS = {
    "INSTANTEL_ASCII": files.instantel_ascii,
    "INSTANTEL_CSV": files.instantel_csv,
    "TEXCEL": files.texcel,
    "VIBRACORD": files.vibracord,
}


def read(tmp_path, text, encoding="utf-8", **options):
    path = tmp_path / "record.txt"
    path.write_bytes(text.encode(encoding))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        (recording,) = read_recording(path, **options)
    return recording


def velocity():
    record = files.motion()
    return 1e-3 * np.column_stack([record["Long"], record["Tran"], record["Vert"]])


@pytest.mark.parametrize("layout", LAYOUTS)
def test_layout_gives_back_the_motion_in_metres_per_second(tmp_path, layout):
    recording = read(tmp_path, LAYOUTS[layout]())

    assert recording.seismogram.components == ("longitudinal", "transverse", "vertical")
    assert recording.seismogram.velocity == pytest.approx(velocity(), abs=PRINTED_DIGIT)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_layout_gives_back_sampling_and_pre_trigger(tmp_path, layout):
    seismogram = read(tmp_path, LAYOUTS[layout]()).seismogram

    assert seismogram.dt == pytest.approx(1.0 / files.RATE)
    assert seismogram.start == pytest.approx(-files.BEFORE, abs=1e-3)


@pytest.mark.parametrize("layout", ["INSTANTEL_ASCII", "INSTANTEL_CSV", "VIBRACORD"])
def test_samples_give_every_value_that_the_device_printed(tmp_path, layout):
    checks = read(tmp_path, LAYOUTS[layout]()).checks

    assert len(checks) == {"INSTANTEL_ASCII": 14, "INSTANTEL_CSV": 10, "VIBRACORD": 1}[layout]
    assert all(within for *_, within in checks)


def test_checks_of_a_sine_agree_with_its_closed_form(tmp_path):
    checks = {c[0]: c[2] for c in read(tmp_path, files.instantel_ascii()).checks}

    assert checks["vertical PPV"] == pytest.approx(0.020, rel=1e-6)
    assert checks["vertical zero-crossing frequency"] == pytest.approx(32.0, rel=2e-3)
    assert checks["vertical time of peak"] == pytest.approx(files.peak_time("Vert"), abs=1e-9)
    assert checks["vertical peak acceleration"] == pytest.approx(
        9.80665 * files.peak_acceleration("Vert"), rel=1e-4
    )


def test_vector_sum_is_taken_at_one_instant(tmp_path):
    checks = {c[0]: c[2] for c in read(tmp_path, files.instantel_ascii()).checks}
    separate_peaks = 1e-3 * math.hypot(*files.AMPLITUDE.values())

    assert checks["vector sum"] < 0.99 * separate_peaks


@pytest.mark.parametrize(
    ("key", "value", "name"),
    [
        ("Tran PPV", "12.800 mm/s", "transverse PPV"),
        ("Vert ZC Freq", "35 Hz", "vertical zero-crossing frequency"),
        ("Peak Vector Sum", "24.800 mm/s", "vector sum"),
        ("Long Time of Peak", "0.070 sec", "longitudinal time of peak"),
        ("Vert Peak Acceleration", "0.500 g", "vertical peak acceleration"),
        ("Vert ZC Freq", ">100 Hz", "vertical zero-crossing frequency"),
    ],
)
def test_header_value_that_the_samples_do_not_give_is_warned_of(tmp_path, key, value, name):
    path = tmp_path / "record.txt"
    path.write_text(files.instantel_ascii(changes={key: value}))

    with pytest.warns(PyblastWarning, match=f"device's own values.*{name} printed"):
        (recording,) = read_recording(path)

    assert [c[0] for c in recording.checks if not c[3]] == [name]


@pytest.mark.parametrize("value", ["N/A", "", "<100 Hz", ">10 Hz"])
def test_frequency_that_is_a_bound_or_absent_is_no_disagreement(tmp_path, value):
    read(tmp_path, files.instantel_ascii(changes={"Vert ZC Freq": value}))


def test_instantel_header_keeps_serial_location_range_and_time(tmp_path):
    recording = read(tmp_path, files.instantel_ascii())

    assert recording.serial == "XX00000"
    assert recording.instrument == "Instantel V 10-89 Micromate ISEE"
    assert recording.seismogram.label == "Bench  7 : north"
    assert recording.full_scale == pytest.approx(0.254)
    assert recording.time == "2025-01-02T13:04:05"


@pytest.mark.parametrize(
    "options", [{"end": "\r\n"}, {"microphone": True}, {"changes": {"Geo Range": None}}]
)
def test_instantel_ascii_varieties_give_the_same_motion(tmp_path, options):
    recording = read(tmp_path, files.instantel_ascii(**options))

    assert recording.seismogram.velocity == pytest.approx(velocity(), abs=PRINTED_DIGIT)


def test_inches_per_second_become_metres_per_second(tmp_path):
    recording = read(tmp_path, files.instantel_ascii(unit="in/s"))

    assert recording.seismogram.velocity == pytest.approx(25.4 * velocity(), abs=25.4e-7)


@pytest.mark.parametrize("delimiter", [",", ";"])
def test_decimal_comma_of_a_localised_export_is_read(tmp_path, delimiter):
    text = files.instantel_csv(decimal=",", delimiter=delimiter)

    recording = read(tmp_path, text)

    assert recording.seismogram.velocity == pytest.approx(velocity(), abs=PRINTED_DIGIT)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_utf8_mark_is_dropped(tmp_path, layout):
    recording = read(tmp_path, LAYOUTS[layout](), encoding="utf-8-sig")

    assert recording.seismogram.ppv[2] == pytest.approx(0.020)


def test_csv_without_pre_trigger_is_placed_by_its_time_of_peak(tmp_path):
    recording = read(tmp_path, files.instantel_csv())

    assert "Pre" not in "".join(recording.header)
    assert recording.seismogram.start == pytest.approx(-files.BEFORE, abs=0.5 / files.RATE)


@pytest.mark.parametrize(
    ("name", "format", "components", "ppv"),
    [
        ("instantel_odd_header.txt", "INSTANTEL_ASCII", "ltv", [8.0, 12.5, 20.0]),
        ("instantel_comma_bom.csv", "INSTANTEL_CSV", "ltv", [8.0, 12.5, 20.0]),
        ("texcel_beside.csv", "TEXCEL", "ltv", [8.0, 12.5, 20.0]),
        ("vibracord_latin1.csv", "VIBRACORD", "ltv", [8.0, 12.5, 20.0]),
        ("vertical_only.csv", "CSV", "env", [math.nan, math.nan, 20.0]),
    ],
)
def test_corpus_file_is_recognised_and_read(corpus, name, format, components, ppv):
    (recording,) = read_recording(corpus / name, format)

    assert "".join(c[0] for c in recording.seismogram.components) == components
    assert recording.seismogram.ppv == pytest.approx(1e-3 * np.array(ppv), abs=1e-6, nan_ok=True)


def test_corpus_table_is_read_by_its_mapping(corpus):
    (recording,) = read_recording(corpus / "mapped.csv", mapping=corpus / "mapped.toml")

    assert recording.seismogram.ppv == pytest.approx([0.008, 0.0125, 0.020], abs=1e-6)
    assert recording.seismogram.start == pytest.approx(-0.125)
    assert recording.full_scale == pytest.approx(0.1)
    assert recording.serial == "77"
