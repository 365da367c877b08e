"""What headers say: instrument, unit, interval, counts, and times of pieces."""

import struct
import warnings
from pathlib import Path

import numpy as np
import obspy
import pytest
import recorder_files as files
from recorder_files import sac

from pyblast.errors import InputError, PyblastWarning, ReadError
from pyblast.line_records.field_records import read_folder
from pyblast.readers.provenance import ReadLog
from pyblast.recordings.recording import (
    first_recording,
    read_gather,
    read_recording,
    remove_response,
)

REPORTED = Path(__file__).parents[1] / "reported"
START = obspy.UTCDateTime("2026-03-01T10:00:00")
DT = 0.002
TIMES = DT * np.arange(1000)
PULSE = np.exp(-(((TIMES - 0.9) / 0.08) ** 2)) * np.sin(2.0 * np.pi * 12.0 * (TIMES - 0.9))


def read(path, **options):
    """Return the recordings of a file, the warnings, and the lines of the log."""
    log = ReadLog()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        records = read_recording(path, log=log, **options)
    return records, " | ".join(str(w.message) for w in caught), log.lines()


def trace(samples, channel, start=0.0, station="R01", dt=DT, location=""):
    header = {"delta": dt, "starttime": START + start, "station": station, "network": "XX",
              "channel": channel, "location": location}  # fmt: skip
    return obspy.Trace(np.asarray(samples, dtype=np.float32), header)


def mseed(path, *traces):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        path.write_bytes(b"".join(_bytes(each) for each in traces))
    return path


def _bytes(each):
    import io

    buffer = io.BytesIO()
    obspy.Stream([each]).write(buffer, format="MSEED", reclen=512)
    return buffer.getvalue()


# 14: accelerometers


@pytest.mark.parametrize(
    "name", ["14-accelerometer-channels/accelerometer", "14-accelerometer-channels/geophone_and"]
)
def test_14_accelerations_are_integrated_by_their_unit(name):
    (path,) = REPORTED.glob(f"{name}*.mseed")

    (record,), said, _ = read(path, unit="m_per_s2")

    assert 1e3 * record.seismogram.ppv == pytest.approx([26.54, 13.27, 6.64], abs=0.01)
    assert "HNE was integrated" in said or "ENE was integrated" in said


def test_14_accelerations_without_a_unit_are_refused():
    path = REPORTED / "14-accelerometer-channels" / "accelerometer.mseed"

    with pytest.raises(InputError, match="HNE, HNN, HNZ are accelerometers by the instrument le"):
        read_recording(path)
    with pytest.raises(InputError, match=r"measure acceleration by .* not in 'm_per_s'"):
        read_recording(path, unit="m_per_s")


def test_14_the_geophone_beside_accelerometers_is_read_and_they_are_said():
    path = REPORTED / "14-accelerometer-channels" / "geophone_and_accelerometer.mseed"

    (record,), said, lines = read(path)

    assert 1e3 * record.seismogram.ppv[2] == pytest.approx(10.0, abs=0.01)
    assert "ENE, XX.R01..ENN, XX.R01..ENZ is left out, it is acceleration" in said
    assert any("dropped channel XX.R01..ENE" in line for line in lines)


@pytest.mark.parametrize(
    ("unit", "size"), [("m_per_s2", 1.0), ("mm_per_s2", 1e3), ("g", 1 / 9.80665)]
)
@pytest.mark.parametrize("band", ["H", "E", "G", "D", "B"])
def test_14_the_integral_is_the_velocity_that_was_differentiated(unit, size, band, tmp_path):
    acceleration = size * np.gradient(PULSE, DT, edge_order=2)
    path = mseed(tmp_path / "a", *(trace(acceleration, f"{band}N{c}") for c in "ENZ"))

    (record,), _, _ = read(path, unit=unit)

    for n in range(3):
        assert record.seismogram.velocity[:, n] == pytest.approx(PULSE, abs=0.005)


def test_14_a_response_of_velocity_is_not_taken_off_an_accelerometer(tmp_path):
    counts = [trace(np.round(1e4 * PULSE), f"HN{c}") for c in "ENZ"]
    (record,), _, _ = read(mseed(tmp_path / "a", *counts), unit="counts")
    response = {"poles": [-1 + 0j], "zeros": [0j], "gain": 1.0, "sensitivity": 1.0}

    with pytest.raises(InputError, match="HNE is an accelerometer"):
        remove_response(record, response)


def sac_of(quantity, samples=PULSE):
    """A SAC file with a quantity by IDEP."""
    content = bytearray(sac(n_samples=len(samples), given=len(samples)))
    content[4 * 86 : 4 * 87] = struct.pack("<i", quantity)
    content[632:] = np.asarray(samples, dtype="<f4").tobytes()
    content[440 + 8 * 20 : 440 + 8 * 21] = b"BHZ     "
    return bytes(content)


def test_14_sac_says_by_idep_what_it_holds(tmp_path):
    path = tmp_path / "a.sac"
    path.write_bytes(sac_of(7, 5e6 * PULSE))
    (record,), said, _ = read(path)
    assert record.seismogram.ppv[2] == pytest.approx(5e-3 * np.abs(PULSE).max(), rel=1e-4)
    assert "in nm/s, as SAC defines velocity" in said

    path.write_bytes(sac_of(7))
    with pytest.raises(InputError, match="IDEP says velocity, in nm/s by its manual; a peak of 0"):
        read_recording(path)
    assert read(path, unit="m_per_s")[0][0].seismogram.ppv[2] == pytest.approx(
        np.abs(PULSE).max(), rel=1e-4
    )

    path.write_bytes(sac_of(8))
    with pytest.raises(InputError, match="BHZ are accelerometers by SAC's IDEP"):
        read_recording(path)
    for code, word in ((6, "displacement"), (50, "volts")):
        path.write_bytes(sac_of(code))
        with pytest.raises(InputError, match=f"BHZ measure {word} by SAC's IDEP"):
            read_recording(path)


def test_14_sac_that_is_no_time_series_is_refused(tmp_path):
    content = bytearray(sac())
    for word, value, reason in ((85, 2, "of type 2"), (105, 0, "unevenly sampled")):
        changed = bytearray(content)
        changed[4 * word : 4 * word + 4] = struct.pack("<i", value)
        (tmp_path / "a").write_bytes(changed)

        with pytest.raises(ReadError, match=reason):
            read_recording(tmp_path / "a")


# 15: common time


def test_15_a_short_channel_that_would_cut_the_peak_is_missing():
    (record,), said, _ = read(REPORTED / "15-a-short-channel-cuts-all" / "short.mseed")

    assert 1e3 * record.seismogram.ppv[[0, 2]] == pytest.approx([10.0, 10.0], abs=0.01)
    assert np.isnan(record.seismogram.ppv[1])
    assert "XX.R01..GPN is left out, its 0.6 s would cut the peak" in said


def test_15_a_late_channel_is_named_with_what_it_cuts():
    (record,), said, _ = read(REPORTED / "15-a-short-channel-cuts-all" / "late.mseed")

    assert len(record.seismogram.velocity) == 750
    assert 1e3 * record.seismogram.ppv == pytest.approx([10.0, 10.0, 10.0], abs=0.01)
    assert "cut are up to 0.5 s of the other channels: XX.R01..GPZ begins late" in said


def test_15_few_samples_at_an_end_go_without_a_word(tmp_path):
    path = mseed(tmp_path / "a", trace(PULSE, "GPE"), trace(PULSE[:-3], "GPN"),
                 trace(PULSE, "GPZ"))  # fmt: skip

    (record,), said, _ = read(path, unit="m_per_s")

    assert len(record.seismogram.velocity) == 997
    assert "cut" not in said


@pytest.mark.parametrize("keeps", [300, 460, 700])
@pytest.mark.parametrize("end", ["first", "last"])
def test_15_no_peak_is_lost_in_silence(keeps, end, tmp_path):
    part = PULSE[:keeps] if end == "first" else PULSE[-keeps:]
    start = 0.0 if end == "first" else DT * (len(PULSE) - keeps)
    path = mseed(tmp_path / "a", trace(PULSE, "GPE"), trace(part, "GPN", start),
                 trace(PULSE, "GPZ"))  # fmt: skip

    (record,), said, _ = read(path, unit="m_per_s")

    assert record.seismogram.ppv[[0, 2]] == pytest.approx(np.abs(PULSE).max(), rel=0.1)
    assert "GPN" in said


# 16: other channels


def test_16_a_pressure_channel_is_the_air_overpressure():
    path = REPORTED / "16-pressure-and-health-channels" / "with_microphone.mseed"

    (record,), _, lines = read(path)

    assert record.peak_overpressure == pytest.approx(3.0, abs=0.01)
    assert 1e3 * record.seismogram.ppv == pytest.approx([10.0] * 3, abs=0.01)
    assert any("XX.R01..HDF, Pa" in line for line in lines)


def test_16_a_health_channel_is_left_out_with_a_note():
    (record,), said, _ = read(REPORTED / "16-pressure-and-health-channels" / "with_health.mseed")

    assert 1e3 * record.seismogram.ppv == pytest.approx([10.0] * 3, abs=0.01)
    assert "XX.R01..VEC is left out" in said


@pytest.mark.parametrize(
    ("other", "reason"),
    [
        (trace(PULSE[:500], "HDF"), "does not cover"),
        (trace(PULSE, "HDF", dt=0.004), "another samp"),
    ],
)
def test_16_a_pressure_channel_that_does_not_go_with_the_record_is_said(other, reason, tmp_path):
    path = mseed(tmp_path / "a", *(trace(PULSE, f"GP{c}") for c in "ENZ"), other)

    (record,), said, _ = read(path, unit="m_per_s")

    assert record.overpressure is None
    assert reason in said


def test_16_a_file_of_health_channels_alone_is_refused_with_them(tmp_path):
    path = mseed(tmp_path / "a", trace(PULSE, "VEC"), trace(PULSE, "VKI"))

    with pytest.raises(ReadError, match=r"no channel of ground motion.*VEC: its instrument letter"):
        read_recording(path)


# 42: pieces by their times


@pytest.mark.parametrize("folder", [".", "same_start"])
def test_42_one_channel_files_are_joined_by_their_starts(folder):
    (record,), skipped = read_folder(REPORTED / "42-one-channel-files-of-different-starts" / folder)

    peaks = record.gather.times[np.abs(record.gather.data).argmax(axis=1)]
    begin = obspy.UTCDateTime(record.gather.time) - START
    assert begin + peaks == pytest.approx(1.188 + 0.01 * np.arange(8))
    assert not skipped
    assert bool(record.notes) == (folder == ".")


def test_42_one_channel_files_of_a_station_are_one_record_by_their_starts(tmp_path):
    shift = (0.0, 0.1, 0.25)
    paths = [
        mseed(tmp_path / f"{c}.mseed", trace(PULSE[round(s / DT) :], f"GP{c}", s))
        for c, s in zip("ENZ", shift, strict=True)
    ]

    (record,), said, _ = read(paths, unit="m_per_s")

    peaks = np.abs(record.seismogram.velocity).argmax(axis=0)
    assert record.time.startswith("2026-03-01T10:00:00.25")
    assert peaks.tolist() == [peaks[0]] * 3
    assert "XX.R01..GPZ begins late" in said


def test_42_a_file_that_has_no_time_in_common_stays_a_record_of_its_own(tmp_path):
    for name, start in (("a", 0.0), ("b", 0.01), ("c", 0.7)):
        part = PULSE if name != "c" else PULSE[:20]
        mseed(tmp_path / f"{name}.mseed", trace(part, "GPZ", start, station=f"R{name}"))

    records, skipped = read_folder(tmp_path)

    assert [record.channels for record in records] == [("Ra", "Rb"), ("Rc",)]
    assert not skipped


def test_16_a_pressure_channel_in_counts_is_no_overpressure(tmp_path):
    path = mseed(tmp_path / "a", *(trace(PULSE, c) for c in ("GPE", "GPN", "GPZ", "HDF")))

    (record,), said, _ = read(path, unit="counts")

    assert record.overpressure is None
    assert "its samples are counts" in said


def test_42_pieces_in_any_order_and_equal_overlaps_are_joined(tmp_path):
    cuts = [(0, 400), (390, 800), (800, 1000)]
    parts = [trace(PULSE[a:b], f"GP{c}", DT * a + 0.3 * DT * (a > 0)) for c in "ENZ"
             for a, b in cuts[::-1]]  # fmt: skip

    (record,), _, _ = read(mseed(tmp_path / "a", *parts), unit="m_per_s")

    assert record.seismogram.velocity == pytest.approx(np.tile(PULSE, (3, 1)).T, abs=1e-6)


def test_42_an_overlap_with_other_samples_is_refused(tmp_path):
    parts = [trace(PULSE[:600], "GPZ"), trace(PULSE[:600], "GPZ", 400 * DT)]

    with pytest.raises(ReadError, match=r"GPZ: overlap of 0.4 s at 2026-03-01T10:00:00.8"):
        read_recording(mseed(tmp_path / "a", *parts), unit="m_per_s")


def test_42_stretches_between_gaps_are_records_of_their_own(tmp_path):
    parts = [trace(PULSE[a:b], f"GP{c}", DT * a) for c in "ENZ" for a, b in [(0, 300), (350, 1000)]]

    records, said, _ = read(mseed(tmp_path / "a", *parts), unit="m_per_s")

    assert [len(record.seismogram.velocity) for record in records] == [300, 650]
    assert records[1].time.startswith("2026-03-01T10:00:00.7")
    assert "read as 2 records: gaps lie between" in said
    with pytest.warns(PyblastWarning, match="holds 2 records .*; the first one is taken"):
        first_recording("a", records)


# 45, 46: recorders


@pytest.mark.parametrize(
    "name",
    ["45-miniseed-of-a-monitoring-recorder/R01", "46-empty-and-log-records/R01",
     "46-empty-and-log-records/R01_log"],
)  # fmt: skip
def test_45_46_records_of_a_monitoring_recorder(name, tmp_path):
    (record,), said, _ = read(REPORTED / f"{name}.mseed")

    assert record.seismogram.velocity.shape == (1000, 3)
    assert 1e3 * record.seismogram.ppv == pytest.approx([3.769, 5.653, 9.422], abs=1e-3)
    assert "m/s is assumed" in said
    assert ("LOG is left out, it holds text" in said) == name.endswith("log")

    (tmp_path / "R01.mseed").write_bytes((REPORTED / f"{name}.mseed").read_bytes())
    (line,), _ = read_folder(tmp_path)
    assert 1e3 * np.abs(line.gather.data).max(axis=1) == pytest.approx(
        [3.769, 5.653, 9.422], abs=1e-3
    )


@pytest.mark.parametrize("blank", [b"\xff", b"\0"])
@pytest.mark.parametrize("order", ["<", ">"])
def test_45_unset_codes_of_any_kind_are_blank(blank, order, tmp_path):
    content = bytearray(files.miniseed({"R01": np.tile(PULSE, (3, 1)).T}, byteorder=order))
    for record in range(0, len(content), 4096):
        content[record + 13 : record + 15] = 2 * blank
    (tmp_path / "a").write_bytes(content)

    (record,), _, _ = read(tmp_path / "a", unit="m_per_s")

    assert record.seismogram.velocity[:, 0] == pytest.approx(PULSE, abs=1e-6)


# 17, 41, 44: SEG-Y


@pytest.mark.parametrize(
    "name",
    ["41-segy-interval-in-the-binary-header/line",
     "41-segy-interval-in-the-binary-header/line_with_interval",
     "44-segy-number-of-samples/line", "44-segy-number-of-samples/line_other_count"],
)  # fmt: skip
def test_41_44_interval_and_count_of_the_file_hold_where_traces_lack_them(name):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        gather = read_gather(REPORTED / f"{name}.sgy")

    assert gather.data.shape == (12, 400)
    assert gather.dt == 0.0005
    assert gather.offsets[[0, -1]].tolist() == [5.0, 27.0]
    assert bool(caught) == name.endswith("other_count")


def test_17_lengths_in_feet_are_converted():
    gather = read_gather(REPORTED / "17-segy-in-feet" / "feet.sgy")

    assert gather.offsets[[0, -1]] == pytest.approx([3.048, 9.7536])


def ibm(values):
    """Samples as IBM floating-point numbers of four bytes."""
    words = []
    for value in values:
        exponent = 64
        size = abs(value)
        while size >= 1.0:
            size, exponent = size / 16.0, exponent + 1
        while 0.0 < size < 1.0 / 16.0:
            size, exponent = size * 16.0, exponent - 1
        word = (exponent << 24) + round(size * 2**24)
        words.append(word | (1 << 31) if value < 0.0 else word)
    return np.array(words, dtype=">u4")


SAMPLES = np.random.default_rng(5).integers(-100, 100, size=(4, 50)).astype(float)


def segy(order=">", code=5, samples=SAMPLES, *, step=500, own_step=0, count=None, own_count=0,
         texts=0, flag=1, measure=1, scalar=0, coordinates=None, tail=b"", **fields):  # fmt: skip
    """A SEG-Y gather; ``coordinates`` (n, 4) source x, y and group x, y."""
    head = bytearray(3600)
    head[:3200] = "C 1 TEST".ljust(3200).encode("cp037")
    struct.pack_into(f"{order}H2xH2xh", head, 3216, step,
                     samples.shape[1] if count is None else count, code)  # fmt: skip
    struct.pack_into(f"{order}h", head, 3254, measure)
    struct.pack_into(f"{order}2h", head, 3502, flag, texts)
    blocks = [bytes(head)]
    if texts == -1:
        blocks += [b"((SEG: Note))".ljust(3200), b"((SEG: EndText))".ljust(3200)]
    blocks += [b" " * 3200] * max(texts, 0)
    for n, values in enumerate(samples):
        trace = bytearray(240)
        struct.pack_into(f"{order}HH", trace, 114, own_count, own_step)
        struct.pack_into(f"{order}h", trace, 70, scalar)
        if coordinates is not None:
            struct.pack_into(f"{order}4i", trace, 72, *coordinates[n])
        for byte, (form, value) in fields.items():
            struct.pack_into(order + form, trace, int(byte[1:]) - 1,
                             value[n] if isinstance(value, list) else value)  # fmt: skip
        kind = {2: "i4", 3: "i2", 5: "f4", 6: "f8", 8: "i1"}.get(code)
        body = ibm(values).astype(f"{order}u4") if code == 1 else values.astype(order + kind)
        blocks += [bytes(trace), body.tobytes()]
    return b"".join([*blocks, tail])


@pytest.mark.parametrize("order", "<>")
@pytest.mark.parametrize("code", [1, 2, 3, 5, 6, 8])
@pytest.mark.parametrize("texts", [0, 2, -1])
def test_segy_of_every_order_format_and_number_of_texts_has_the_same_samples(
    order, code, texts, tmp_path
):
    (tmp_path / "a.sgy").write_bytes(segy(order, code, texts=texts))

    gather = read_gather(tmp_path / "a.sgy")

    assert np.array_equal(gather.data, SAMPLES)
    assert gather.dt == 0.0005


@pytest.mark.parametrize(
    ("options", "dt"),
    [({"own_step": 250}, 0.0005), ({"own_step": 250, "flag": 0}, 0.00025),
     ({"step": 0, "own_step": 250}, 0.00025), ({"own_count": 50, "flag": 0}, 0.0005),
     ({"count": 0, "own_count": 50, "flag": 0}, 0.0005)],
)  # fmt: skip
def test_segy_takes_file_or_trace_headers_by_the_flag_of_fixed_lengths(options, dt, tmp_path):
    (tmp_path / "a.sgy").write_bytes(segy(**options))

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        gather = read_gather(tmp_path / "a.sgy")

    assert gather.dt == dt
    assert np.array_equal(gather.data, SAMPLES)
    differ = options.get("own_step") and options.get("step") != 0
    assert ("headers differ in the interval" in "".join(str(w.message) for w in caught)) == bool(
        differ
    )


def test_segy_without_an_interval_is_refused(tmp_path):
    (tmp_path / "a.sgy").write_bytes(segy(step=0, own_step=1))
    content = bytearray((tmp_path / "a.sgy").read_bytes())
    for n in range(4):
        struct.pack_into(">H", content, 3600 + n * 440 + 116, 0 if n else 1)
    struct.pack_into(">H", content, 3600 + 116, 0)
    (tmp_path / "a.sgy").write_bytes(content)

    with pytest.raises(ReadError):
        read_gather(tmp_path / "a.sgy")


LINE = [[0, 0, 100 * n, 0] for n in range(1, 5)]


@pytest.mark.parametrize(
    ("scalar", "measure", "first"),
    [(0, 1, 100.0), (1, 0, 100.0), (-100, 1, 1.0), (10, 1, 1000.0), (-100, 2, 0.3048)],
)
def test_segy_scalars_and_measurement_system_hold_for_coordinates(scalar, measure, first, tmp_path):
    content = segy(scalar=scalar, measure=measure, coordinates=LINE)
    (tmp_path / "a.sgy").write_bytes(content)
    log = ReadLog()

    gather = read_gather(tmp_path / "a.sgy", log=log)

    assert gather.offsets[0] == pytest.approx(first)
    assert ("measurement system 0" in " ".join(log.lines())) == (measure == 0)


def test_segy_coordinates_in_degrees_or_of_many_sources_are_no_distances(tmp_path):
    (tmp_path / "a.sgy").write_bytes(segy(coordinates=LINE, b89=("h", 2)))
    with pytest.warns(PyblastWarning, match="in degrees or seconds of arc"):
        assert np.isnan(read_gather(tmp_path / "a.sgy").offsets).all()

    shots = [[50 * n, 0, 100 * n, 0] for n in range(4)]
    (tmp_path / "a.sgy").write_bytes(segy(coordinates=shots))
    with pytest.warns(PyblastWarning, match="name 4 sources, not one shot"):
        assert np.isnan(read_gather(tmp_path / "a.sgy").source_position).all()


def test_segy_distances_stand_in_for_coordinates(tmp_path):
    (tmp_path / "a.sgy").write_bytes(segy(b37=("i", [-20, -10, 10, 20])))

    assert read_gather(tmp_path / "a.sgy").offsets.tolist() == [20.0, 10.0, 10.0, 20.0]


@pytest.mark.parametrize(
    ("fields", "time"),
    [((2024, 60, 10, 11, 12), "2024-02-29T10:11:12Z"), ((99, 1, 0, 0, 0), "1999-01-01T00:00:00Z"),
     ((0, 0, 0, 0, 0), ""), ((2024, 500, 0, 0, 0), "")],
)  # fmt: skip
def test_segy_says_when_it_was_recorded(fields, time, tmp_path):
    named = {f"b{157 + 2 * n}": ("h", value) for n, value in enumerate(fields)}
    (tmp_path / "a.sgy").write_bytes(segy(**named))

    assert read_gather(tmp_path / "a.sgy").time == time


@pytest.mark.parametrize("cut", [1, 100, 241])
def test_segy_cut_short_is_refused(cut, tmp_path):
    (tmp_path / "a.sgy").write_bytes(segy(samples=SAMPLES[:, :45])[:-cut])

    with pytest.raises(ReadError, match="cut short"):
        read_gather(tmp_path / "a.sgy")


@pytest.mark.parametrize("seed", range(20))
def test_segy_damaged_is_read_or_refused(seed, tmp_path):
    random = np.random.default_rng(seed)
    content = bytearray(segy(">" if seed % 2 else "<", coordinates=LINE))
    for position in random.integers(3200, len(content), size=6):
        content[position] = random.integers(256)
    (tmp_path / "a.sgy").write_bytes(content)

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            gather = read_gather(tmp_path / "a.sgy")
        except (ReadError, InputError) as error:
            gather, reason = None, str(error)

    assert np.isfinite(gather.data).all() if gather is not None else "\n" not in reason


@pytest.mark.filterwarnings("error")
def test_pieces_of_a_record_at_ten_megahertz_touch_although_headers_say_microseconds(tmp_path):
    samples, dt = np.random.default_rng(3).normal(size=5000).astype(np.float32), 1e-7
    path = mseed(tmp_path / "a", trace(samples, "HHN", dt=dt))

    (record,), _, _ = read(path, unit="m_per_s")

    assert record.seismogram.velocity[:, 1] == pytest.approx(samples)
