"""Responses of sensors are taken off once, and only where there is one."""

import numpy as np
import obspy
import pytest
import recorder_files as files
from recorder_files import write, write_trace

from pyblast.errors import InputError, ReadError
from pyblast.recordings.recording import read_recording, remove_response

GEOPHONE = {
    "poles": [-19.8 + 20.2j, -19.8 - 20.2j], "zeros": [0j, 0j], "gain": 1.0, "sensitivity": 4e5,
}  # fmt: skip


def counts_of_a_geophone(n_samples=2000, dt=0.002):
    times = dt * np.arange(n_samples) - 2.0
    motion = 1e-3 * np.exp(-((times / 0.05) ** 2)) * np.sin(2.0 * np.pi * 15.0 * times)
    angular = 2j * np.pi * np.fft.rfftfreq(2 * n_samples, dt)
    poles = GEOPHONE["poles"]
    gain = GEOPHONE["sensitivity"] * angular**2 / ((angular - poles[0]) * (angular - poles[1]))
    return motion, np.fft.irfft(np.fft.rfft(motion, 2 * n_samples) * gain)[:n_samples]


def test_response_of_a_geophone_is_removed(tmp_path):
    motion, counts = counts_of_a_geophone()
    path = write_trace(tmp_path / "z", counts, "MSEED")
    (recording,) = read_recording(path, unit="counts")

    cleaned = remove_response(recording, GEOPHONE).seismogram.velocity[:, 2]

    assert cleaned == pytest.approx(motion, abs=0.02 * np.max(motion))


def test_response_of_an_inventory_is_removed(tmp_path):
    motion, counts = counts_of_a_geophone()
    path = write_trace(tmp_path / "z", counts, "MSEED", network="XX", station="R01")
    (recording,) = read_recording(path, unit="counts")
    response = obspy.core.inventory.Response.from_paz(
        GEOPHONE["zeros"], GEOPHONE["poles"], GEOPHONE["sensitivity"], stage_gain_frequency=30.0
    )
    channel = obspy.core.inventory.Channel("HHZ", "", 0.0, 0.0, 0.0, 0.0, response=response)
    station = obspy.core.inventory.Station("R01", 0.0, 0.0, 0.0, channels=[channel])
    network = obspy.core.inventory.Network("XX", [station])
    obspy.Inventory([network]).write(tmp_path / "stations.xml", format="STATIONXML")

    cleaned = remove_response(recording, tmp_path / "stations.xml").seismogram.velocity[:, 2]

    assert cleaned == pytest.approx(motion, abs=0.05 * np.max(motion))


def test_response_is_not_removed_twice(tmp_path):
    path = write_trace(tmp_path / "z", counts_of_a_geophone()[1], "MSEED")
    cleaned = remove_response(read_recording(path, unit="counts")[0], GEOPHONE)

    with pytest.raises(InputError, match="must not be removed twice"):
        remove_response(cleaned, GEOPHONE)


def test_response_of_a_flat_blast_seismograph_is_not_removed(tmp_path):
    (recording,) = read_recording(write(tmp_path, files.instantel_ascii()))

    with pytest.raises(InputError, match="in m/s already"):
        remove_response(recording, GEOPHONE)


def test_station_metadata_with_a_document_type_are_refused(tmp_path):
    path = write_trace(tmp_path / "z", counts_of_a_geophone()[1], "MSEED")
    (recording,) = read_recording(path, unit="counts")
    metadata = '<!DOCTYPE a [<!ENTITY b SYSTEM "file:///x">]><FDSNStationXML>&b;</FDSNStationXML>'

    with pytest.raises(ReadError, match="document types and entities are not accepted"):
        remove_response(recording, write(tmp_path, metadata, "stations.xml"))
