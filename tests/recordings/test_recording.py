"""Recordings: formats by content, axes, generic tables, clipping."""

import math
import pickle

import numpy as np
import obspy
import pytest
import recorder_files as files
from recorder_files import write, write_trace

from pyblast.errors import InputError, PyblastWarning, ReadError
from pyblast.recordings.raw import lone_spike
from pyblast.recordings.recording import read_recording, read_stations

RNG = np.random.default_rng(7)
ZERO = "2025-01-02T03:04:05.100"


class Malicious:
    """Writes a file when it is unpickled."""

    def __init__(self, target):
        self.target = target

    def __reduce__(self):
        return open, (str(self.target), "w")


# formats by content


@pytest.mark.parametrize("name", ["record.mseed", "record.txt", "record"])
def test_pickle_under_any_name_is_refused_and_never_run(tmp_path, name):
    path = write(tmp_path, pickle.dumps(Malicious(tmp_path / "ran")), name)

    for format in (None, "MSEED", "SAC", "CSV"):
        with pytest.raises(ReadError):
            read_recording(path, format)
    assert not (tmp_path / "ran").exists()


@pytest.mark.parametrize("format", ["PICKLE", "NUMPY", "mseed"])
def test_format_outside_the_list_is_refused_by_name(tmp_path, format):
    with pytest.raises(InputError, match=f"must be one of .*MSEED.*got '{format}'"):
        read_recording(write(tmp_path, b"x"), format)


def test_format_is_found_by_content_and_not_by_extension(tmp_path):
    path = write(tmp_path, files.instantel_ascii(), "record.mseed")

    assert read_recording(path)[0].serial == "XX00000"


def test_format_given_against_the_content_is_refused(tmp_path):
    with pytest.raises(ReadError, match="its content is INSTANTEL_ASCII, not TEXCEL"):
        read_recording(write(tmp_path, files.instantel_ascii()), "TEXCEL")


def test_file_above_the_cap_is_refused_before_it_is_read(tmp_path):
    with pytest.raises(ReadError, match=r"holds \d+ bytes, the cap \(max_bytes\) is 100"):
        read_recording(write(tmp_path, files.generic()), max_bytes=100)


def test_name_with_a_pattern_is_taken_as_a_name(tmp_path):
    write(tmp_path, files.miniseed({"R01": RNG.normal(size=(50, 3))}), "a.mseed")

    with pytest.raises(ReadError, match="expected a file"):
        read_stations(tmp_path / "*.mseed")


# seismological formats


@pytest.mark.parametrize("byteorder", ["<", ">"])
def test_stations_keep_samples_and_start_from_time_zero(tmp_path, byteorder):
    motion = {name: 1e-3 * RNG.normal(size=(200, 3)) for name in ("R01", "R02")}
    path = write(tmp_path, files.miniseed(motion, byteorder=byteorder))

    stations = read_stations(path, time_zero=ZERO)

    assert list(stations) == ["R01", "R02"]
    assert np.array_equal(stations["R02"].seismogram.velocity, motion["R02"])
    assert stations["R01"].seismogram.start == pytest.approx(-0.1, abs=1e-9)
    assert stations["R01"].time == "2025-01-02T03:04:05.000000Z"


def test_unit_of_seismological_samples_becomes_si(tmp_path):
    path = write(tmp_path, files.miniseed({"R01": np.ones((50, 3)) * [1.0, 2.0, 3.0]}))

    with pytest.warns(PyblastWarning, match="never moves"):
        station = read_stations(path, unit="mm_per_s")["R01"]

    assert station.seismogram.ppv == pytest.approx([1e-3, 2e-3, 3e-3])


def test_unit_assumed_for_floating_samples_is_said(tmp_path):
    path = write(tmp_path, files.miniseed({"R01": RNG.normal(size=(50, 3))}))

    with pytest.warns(PyblastWarning, match="m/s is assumed"):
        read_recording(path)


def test_counts_without_a_unit_are_refused(tmp_path):
    path = write(tmp_path, files.miniseed({"R01": np.arange(150).reshape(50, 3)}, dtype="i4"))

    with pytest.raises(InputError, match="integer counts, pass unit='counts'"):
        read_recording(path)


@pytest.mark.parametrize(
    ("shift", "word"),
    [(0.5, "in pieces between gaps"),
     (-0.02, r"XX\.R01\.\.HHE: overlap of 0.02 s at 2025-01-02T03:04:05")],
)  # fmt: skip
@pytest.mark.filterwarnings("ignore:.*gaps lie between")
def test_gap_and_overlap_are_named_with_station_and_time(tmp_path, shift, word):
    end = obspy.UTCDateTime("2025-01-02T03:04:05") + 0.1
    pieces = [
        files.miniseed({"R01": RNG.normal(size=(50, 3))}),
        files.miniseed({"R01": RNG.normal(size=(50, 3))}, start=str(end + shift)),
    ]

    with pytest.raises(ReadError, match=word):
        read_stations(write(tmp_path, b"".join(pieces)))


def test_pieces_that_touch_are_joined(tmp_path):
    motion = RNG.normal(size=(100, 3))
    end = str(obspy.UTCDateTime("2025-01-02T03:04:05") + 0.1)
    pieces = [files.miniseed({"R01": motion[:50]}), files.miniseed({"R01": motion[50:]}, start=end)]

    stations = read_stations(write(tmp_path, b"".join(pieces)))

    assert np.array_equal(stations["R01"].seismogram.velocity, motion)


def test_orientations_turn_skewed_channels_into_east_north_up(tmp_path):
    motion = RNG.normal(size=(50, 3))
    azimuth = math.radians(30.0)
    first = motion[:, 0] * math.sin(azimuth) + motion[:, 1] * math.cos(azimuth)
    second = motion[:, 0] * math.cos(azimuth) - motion[:, 1] * math.sin(azimuth)
    skewed = np.column_stack([first, second, -motion[:, 2]])
    path = write(tmp_path, files.miniseed({"R01": skewed}, codes="123"))
    given = {"HH1": (azimuth, 0.0), "HH2": (azimuth + math.pi / 2, 0.0), "HH3": (0.0, math.pi / 2)}

    (recording,) = read_recording(path, unit="m_per_s", orientations=given)

    assert recording.seismogram.velocity == pytest.approx(motion, abs=1e-12)


def test_numbered_channels_without_orientations_are_refused(tmp_path):
    path = write(tmp_path, files.miniseed({"R01": RNG.normal(size=(50, 3))}, codes="12Z"))

    with pytest.raises(InputError, match=r"HH1.*pass orientations"):
        read_stations(path)


@pytest.mark.parametrize("format", ["SAC", "GSE2"])
def test_one_channel_files_are_read_together(tmp_path, format):
    motion = RNG.integers(-1000, 1000, size=(50, 3)).astype(np.int32)
    kind = np.float32 if format == "SAC" else np.int32
    paths = [
        write_trace(tmp_path / code, motion[:, n].astype(kind), format, channel=code)
        for n, code in enumerate(("HHE", "HHN", "HHZ"))
    ]

    (recording,) = read_recording(paths, unit="um_per_s")

    assert recording.seismogram.velocity == pytest.approx(1e-6 * motion)


def test_single_channel_leaves_the_others_missing(tmp_path):
    path = write_trace(tmp_path / "z", RNG.normal(size=50).astype("f4"), "SAC")

    (recording,) = read_recording(path, unit="mm_per_s")

    assert recording.seismogram.present.tolist() == [False, False, True]


# axes


def test_bearing_turns_the_component_towards_the_blast_into_north(tmp_path):
    path = write(tmp_path, files.instantel_ascii())

    to_north, to_east = (read_recording(path, bearing=b)[0].seismogram for b in (0.0, math.pi / 2))

    assert to_north.components == ("east", "north", "vertical")
    assert to_north.ppv == pytest.approx([0.0125, 0.008, 0.020])
    assert to_east.ppv == pytest.approx([0.008, 0.0125, 0.020])


def test_bearing_keeps_the_vector_sum(tmp_path):
    path = write(tmp_path, files.instantel_ascii())

    turned = read_recording(path, bearing=1.234)[0].seismogram

    assert turned.pvs == pytest.approx(read_recording(path)[0].seismogram.pvs)


@pytest.mark.filterwarnings("ignore:.*never moves")
def test_bearing_on_east_and_north_is_refused(tmp_path):
    with pytest.raises(InputError, match="bearing needs longitudinal and transverse"):
        read_recording(write(tmp_path, files.generic()), bearing=0.0)


# generic CSV


@pytest.mark.parametrize(
    ("header", "ppv"),
    [
        ("time_s,east_m_per_s,north_m_per_s,vertical_m_per_s", [7e-3, 7e-3, 0.0]),
        ("time_s,vertical_mm_per_s,transverse_mm_per_s,longitudinal_mm_per_s", [0.0, 7e-6, 7e-6]),
        ("time_s,north_in_per_s,vertical_um_per_s,east_m_per_s", [0.0, 0.0254 * 7e-3, 7e-9]),
    ],
)
@pytest.mark.filterwarnings("ignore::pyblast.errors.PyblastWarning")
def test_generic_table_names_components_and_units_in_its_header(tmp_path, header, ppv):
    (recording,) = read_recording(write(tmp_path, files.generic(header)))

    assert recording.seismogram.ppv == pytest.approx(ppv)
    assert recording.seismogram.dt == pytest.approx(1e-3)


def test_generic_table_keeps_negative_start(tmp_path):
    rows = [[0.002 * n - 0.1, 1e-3 * math.sin(n)] for n in range(100)]

    (recording,) = read_recording(write(tmp_path, files.generic("time_s,vertical_m_per_s", rows)))

    assert recording.seismogram.start == pytest.approx(-0.1)


# clipping and dead channels


@pytest.mark.filterwarnings("ignore:.*device's own values")
def test_samples_at_the_range_of_the_header_are_clipped(tmp_path):
    record = files.motion()
    record["Vert"] = np.clip(40.0 * record["Vert"], -254.0, 254.0)
    path = write(tmp_path, files.instantel_ascii(record))

    with pytest.warns(PyblastWarning, match="samples are clipped"):
        (recording,) = read_recording(path)

    assert np.array_equal(recording.clipped[:, 2], np.abs(record["Vert"]) == 254.0)
    assert not recording.clipped[:, :2].any()


def test_clipping_is_found_sample_by_sample_where_full_scale_is_unknown(tmp_path):
    record = files.motion()
    record["Tran"] = np.clip(record["Tran"], -9.0, 9.0)
    path = write(tmp_path, files.instantel_ascii(record, changes={"Geo Range": None}))

    with pytest.warns(PyblastWarning):
        (recording,) = read_recording(path)

    assert np.array_equal(recording.clipped[:, 1], np.abs(record["Tran"]) == 9.0)


def test_given_full_scale_goes_before_the_header(tmp_path):
    path = write(tmp_path, files.instantel_ascii())

    with pytest.warns(PyblastWarning, match="clipped"):
        (recording,) = read_recording(path, full_scale=0.0199)

    assert set(np.flatnonzero(recording.clipped.any(axis=0))) == {2}


@pytest.mark.parametrize("step", [1.0, 0.0078, 1e-6])
def test_rounding_of_a_smooth_peak_is_no_clipping(tmp_path, step):
    times = np.arange(4096) / 4096
    slow = np.round(np.sin(2 * np.pi * 3.0 * times) * np.exp(-times) / step * 2.0) * step
    rows = np.column_stack([times, slow])

    (recording,) = read_recording(write(tmp_path, files.generic("time_s,east_mm_per_s", rows)))

    assert not recording.clipped.any()


def test_channel_that_never_moves_is_called_dead(tmp_path):
    record = files.motion()
    record["Long"] = np.full_like(record["Long"], 0.06)
    path = write(tmp_path, files.texcel(record))

    with pytest.warns(PyblastWarning, match="longitudinal never moves"):
        (recording,) = read_recording(path)

    assert recording.dead == ("longitudinal",)


@pytest.mark.parametrize("level", [30.0, -30.0])
def test_a_level_thirty_times_all_others_is_no_motion_and_one_of_ten_times_is(level):
    motion = RNG.uniform(-1.0, 1.0, 200)
    motion[10] = 1.0

    assert lone_spike(motion) is None
    assert lone_spike(np.where(np.arange(200) == 77, level, motion)) == 77
    assert lone_spike(np.where(np.arange(200) == 77, level / 3.0, motion)) is None
