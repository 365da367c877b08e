"""Gathers of seismic surveys, made here and recorded; a case of the independent program."""

import numpy as np
import obspy
import pytest
import recorder_files as files
from recorder_files import write

from pyblast.errors import InputError, ReadError
from pyblast.recordings.recording import read_gather, read_recording, read_stations

RNG = np.random.default_rng(7)


def shot(n_channels=4, n_samples=300):
    return RNG.normal(size=(n_channels, n_samples)).astype(np.float32).astype(np.float64)


@pytest.mark.parametrize("order", ["<", ">"])
def test_gather_keeps_samples_places_and_delay(tmp_path, order):
    data = shot()

    gather = read_gather(write(tmp_path, files.seg2(data, order=order)))

    assert np.array_equal(gather.data, data)
    assert gather.unit == "counts"
    assert (gather.dt, gather.start) == (0.001, -0.010)
    assert gather.offsets == pytest.approx([5.0, 7.0, 9.0, 11.0])
    assert gather.header["CHANNEL_NUMBER"] == ("1", "2", "3", "4")


def test_descaling_factor_turns_counts_into_volts(tmp_path):
    data = shot()

    gather = read_gather(write(tmp_path, files.seg2(data, descaling="2.5E-003")))

    assert gather.unit == "V"
    assert gather.data == pytest.approx(2.5e-6 * data)


def test_places_that_are_all_the_same_are_unknown(tmp_path):
    gather = read_gather(write(tmp_path, files.seg2(shot(), spacing=0.0)))

    assert np.all(np.isnan(gather.receiver_positions))


def test_gather_marks_dead_channels_and_clipped_samples_exactly(tmp_path):
    data = shot()
    data[1] = 0.0
    wave = 5.0 * np.sin(np.arange(300) / 9.0)
    data[3] = np.clip(wave, -2.5, 2.5)

    gather = read_gather(write(tmp_path, files.seg2(data)))

    assert gather.dead.tolist() == [False, True, False, False]
    assert gather.full_scale == 2.5
    assert np.array_equal(gather.clipped[3], np.abs(wave) >= 2.5)
    assert not gather.clipped[:3].any()


@pytest.mark.filterwarnings("ignore:CREATING TRACE HEADER")
def test_segy_gather_keeps_samples(tmp_path):
    data = shot()
    stream = obspy.Stream(obspy.Trace(x.astype(np.float32), {"delta": 0.001}) for x in data)
    stream.write(tmp_path / "shot.sgy", format="SEGY", data_encoding=5)

    gather = read_gather(tmp_path / "shot.sgy")

    assert np.array_equal(gather.data, data)


def test_gather_is_sent_to_its_own_reader(tmp_path):
    with pytest.raises(InputError, match="read it with read_gather"):
        read_recording(write(tmp_path, files.seg2(shot())))


def test_record_is_not_a_gather(tmp_path):
    with pytest.raises(ReadError, match=r"is text .* export the gather as SEG-2 or SEG-Y"):
        read_gather(write(tmp_path, files.instantel_ascii()))


# real files, outside the repository


@pytest.mark.parametrize(
    ("name", "clipped"),
    [("01005", {4: 11}), ("01025", {24: 56}), ("01060", {}), ("01090", {89: 19})],
)
def test_real_crossed_lines_have_three_dead_channels_and_clip_at_one_level(
    recordings, name, clipped
):
    gather = read_gather(recordings / "soda_lakes" / f"Shot_{name}.sg2")
    found = np.count_nonzero(gather.clipped, axis=1)

    assert gather.data.shape == (96, 2048)
    assert np.flatnonzero(gather.dead).tolist() == [47, 58, 59]
    assert {int(n): int(found[n]) for n in np.flatnonzero(found)} == clipped
    assert gather.full_scale == (pytest.approx(2.82, abs=1e-6) if clipped else None)


@pytest.mark.parametrize(
    ("name", "dt", "start", "source", "spacing"),
    [("wghs/7.dat", 1e-3, -0.5, -5.0, 2.0), ("refrapy_ex02/4.dat", 2.5e-4, 0.0, 57.5, 5.0)],
)
def test_real_line_has_its_places_in_the_header(recordings, name, dt, start, source, spacing):
    gather = read_gather(recordings / name)

    assert (len(gather.data), gather.dt, gather.start, gather.unit) == (24, dt, start, "V")
    assert gather.source_position.tolist() == [source, 0.0, 0.0]
    assert gather.receiver_positions[:, 0] == pytest.approx(spacing * np.arange(24))
    assert not gather.dead.any()
    assert not gather.clipped.any()


def test_real_hammer_arrives_after_the_trigger(recordings):
    gather = read_gather(recordings / "wghs" / "7.dat")
    size = np.abs(gather.data[0])
    first = gather.times[np.argmax(size > 10.0 * np.std(gather.data[0][:400]))]

    assert 0.0 < first < 0.05


def test_case_of_the_independent_program_starts_before_its_blast(cases):
    stations = read_stations(cases / "case-10" / "S1.mseed", time_zero="2024-05-01T10:00:00Z")

    assert list(stations) == [f"R{n:02d}" for n in range(1, 14)]
    for station in stations.values():
        assert station.seismogram.start == -0.25
        assert station.seismogram.velocity.shape == (600, 3)
        assert not station.clipped.any()
