import json

import h5py
import numpy as np
import pytest

from pyblast.errors import ReadError
from pyblast.files import plain, write_summary
from pyblast.project.result import (
    Result,
    read_result,
    seismogram_heads,
    too_symmetric,
    write_csv,
    write_result,
)
from pyblast.recordings.recording import read_recording
from pyblast.signals.seismogram import Seismogram


@pytest.fixture
def record():
    velocity = np.random.default_rng(1).normal(size=(32, 3))
    return Seismogram(velocity, 1.0 / 512.0, -0.1, "R1", ("longitudinal", "transverse", "vertical"))


@pytest.fixture
def result(record):
    groups = {"simulated": {"R1": record}}
    summary = {"title": "A <script> & more", "seismograms": seismogram_heads(groups)}
    return Result({"simulated": {"R1": record.velocity}, "mesh": {"points": np.eye(3)}}, summary)


def test_a_result_is_read_back_whole(tmp_path, result, record):
    write_result(tmp_path / "result.h5", result)

    found = read_result(tmp_path / "result.h5")

    assert found.summary == result.summary
    assert np.array_equal(found.seismogram("simulated", "R1").velocity, record.velocity)
    assert found.seismogram("simulated", "R1").components == record.components
    assert found.seismogram("simulated", "R1").start == record.start


def test_a_result_is_read_without_pyblast(tmp_path, result):
    write_result(tmp_path / "result.h5", result)

    with h5py.File(tmp_path / "result.h5") as file:
        assert file["simulated/R1"].shape == (32, 3)
        told = file["simulated/R1"].attrs
        assert list(told["components"]) == ["longitudinal", "transverse", "vertical"]
        assert (told["unit"], told["dt_s"], told["start_s"]) == ("m/s", 1.0 / 512.0, -0.1)
        assert json.loads(file["summary/json"][()].tobytes())["title"] == "A <script> & more"
        assert file.attrs["kind"] == "result"


def test_nothing_else_is_left_beside_the_result(tmp_path, result):
    write_result(tmp_path / "result.h5", result)
    write_summary(tmp_path / "summary.json", result.summary)

    assert sorted(p.name for p in tmp_path.iterdir()) == ["result.h5", "summary.json"]


def test_another_file_is_no_result(tmp_path):
    (tmp_path / "result.h5").write_bytes(b"no HDF5 at all")

    with pytest.raises(ReadError, match="not a whole HDF5 file"):
        read_result(tmp_path / "result.h5")


def test_a_result_cut_short_is_refused(tmp_path, result):
    path = tmp_path / "result.h5"
    write_result(path, result)
    path.write_bytes(path.read_bytes()[:-500])

    with pytest.raises(ReadError):
        read_result(path)


def test_a_place_that_can_hold_no_file_is_named(tmp_path, result):
    (tmp_path / "taken").write_text("a file")

    with pytest.raises(ReadError, match="can't be written"):
        write_result(tmp_path / "taken" / "result.h5", result)


def test_numbers_that_are_none_become_null():
    assert plain({"a": np.array([1.0, np.nan]), "b": np.int64(3), "c": True, "d": np.inf}) == {
        "a": [1.0, None], "b": 3, "c": True, "d": None,
    }  # fmt: skip


def test_a_table_of_motion_is_read_again_as_a_recording(tmp_path, record):
    write_csv(tmp_path / "motion.csv", record)

    found = read_recording(tmp_path / "motion.csv")[0].seismogram

    assert found.velocity == pytest.approx(record.velocity, rel=1e-8)
    assert found.start == pytest.approx(record.start)


def test_motion_without_a_transverse_part_is_named_with_its_vector_sum():
    def record(across):
        wave = 0.01 * np.sin(np.linspace(0.0, 20.0, 400))[:, None] * [1.0, across, 0.0]
        names = ("longitudinal", "transverse", "vertical")
        return Seismogram(wave, 1e-3, components=names)

    found = too_symmetric({"house": record(0.04), "mill": record(0.5)})

    assert found.code == "D50"
    assert found.numbers == {"house": pytest.approx(0.04)}
    assert "house 4 % (vector sum 10, " in found.text
    assert "11.2 to 14.1 mm/s" in found.text
    assert too_symmetric({"mill": record(0.3)}) is None
    assert too_symmetric({"mill": record(0.0).rotated(0.3)}) is None
