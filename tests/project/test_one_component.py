"""Sensors of one component: along any direction, in the unit of their instrument."""

from dataclasses import replace

import numpy as np
import pytest
from small_project import INSIDE, written

from pyblast.errors import InputError, ReadError
from pyblast.model.model import Receiver
from pyblast.project.project import load_project
from pyblast.recordings.seismic import mseed_bytes
from pyblast.signals.seismogram import Seismogram
from pyblast.sources import recorded

COUNTS = np.round(1e3 * np.sin(np.arange(400) / 7.0))
RECEIVER = 'name = "house"'
RECORDED = """name = "house"
normal = {}
recorded = {{ file = "counts.mseed", {} }}"""


def record(folder, normal, *keys, components=1):
    """Return the record of a receiver of the small project from a file of counts."""
    names = [f"PB.A..HH{code}" for code in "NEZ"[:components]]
    samples = np.tile(COUNTS, (1, components, 1))
    (folder / "counts.mseed").write_bytes(mseed_bytes(samples, [names], 1e-3, "2000-01-01"))
    text = RECORDED.format(normal, ", ".join(keys))
    return load_project(written(folder, (RECEIVER, text), text=INSIDE)).recorded["house"].velocity


def test_a_record_of_one_component_lies_along_its_normal(tmp_path):
    velocity = record(tmp_path, [0, -2, 0], "sensitivity = 250.0")

    assert velocity[:, 1] == pytest.approx(-COUNTS / 250.0)
    assert np.isnan(velocity[:, [0, 2]]).all()


def test_a_normal_between_axes_keeps_the_energy_of_the_record(tmp_path):
    velocity = record(tmp_path, [0, 3, 4], "sensitivity = 1.0")

    assert np.nansum(velocity**2) == pytest.approx(np.sum(COUNTS**2))
    assert velocity[:, 1] == pytest.approx(0.6 * COUNTS)


@pytest.mark.parametrize(
    ("normal", "keys", "components", "sentence"),
    [
        ([0, 0, 0], ["sensitivity = 1.0"], 1, "normal: must not be zero"),
        ([0, 1, 0], ["sensitivity = 1.0"], 3, "needs a record of one component"),
        ([0, 1, 0], ["sensitivity = 1.0", 'unit = "mm_per_s"'], 1, "must be 'counts'"),
        ([0, 1, 0], ["sensitivity = 1.0", 'response_file = "a.xml"'], 1, "keep one"),
        ([0, 1, 0], ['response_file = "absent.xml"'], 1, "absent.xml"),
    ],
)
def test_what_is_no_such_record_is_refused(tmp_path, normal, keys, components, sentence):
    with pytest.raises((InputError, ReadError)) as refused:
        record(tmp_path, normal, *keys, components=components)

    assert sentence in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_receiver_measures_what_lies_along_its_normal():
    motion = np.random.default_rng(5).normal(size=(50, 3))
    seismogram = Seismogram(motion, 1e-3)

    along = Receiver("A", (0.0, 0.0, 0.0), normal=(0.0, 3.0, 4.0)).measured(seismogram).velocity

    assert along @ [0.0, 0.6, 0.8] == pytest.approx(motion @ [0.0, 0.6, 0.8])
    assert along @ [0.0, 0.8, -0.6] == pytest.approx(np.zeros(50))
    lost = replace(seismogram, velocity=motion * [np.nan, 1.0, 1.0]).along((0.0, 0.0, 1.0))
    assert lost.velocity[:, 2] == pytest.approx(motion[:, 2])


def test_a_receiver_has_one_way_of_measuring():
    with pytest.raises(InputError, match="without azimuth"):
        Receiver("A", (0.0, 0.0, 0.0), azimuth=0.5, normal=(0.0, 1.0, 0.0))


def test_a_file_of_many_receivers_is_read_once(tmp_path, monkeypatch):
    read, whole = [], recorded.read_recording
    tables = [
        RECORDED.replace("house", f"r{k}").format(
            [0, 0, 1], f"record = {k + 1}, sensitivity = 2.0, start_s = {k / 10}"
        )
        for k in range(4)
    ]
    names = [[f"PB.R{k}..HHZ"] for k in range(4)]
    text = "\nposition_m = [50, 9]\n[[receivers]]\n".join(tables)
    samples = np.arange(1.0, 5.0)[:, None, None] * COUNTS
    (tmp_path / "counts.mseed").write_bytes(mseed_bytes(samples, names, 1e-3, "2000-01-01"))
    path = written(tmp_path, (RECEIVER, text), text=INSIDE)

    def counted(*given, **keys):
        read.append(given)
        return whole(*given, **keys)

    monkeypatch.setattr(recorded, "read_recording", counted)

    records = list(load_project(path).recorded.values())

    assert len(read) == 1
    assert [record.start for record in records] == [0.0, 0.1, 0.2, 0.3]
    assert np.nanmax(records[3].velocity) == pytest.approx(4.0 * np.nanmax(records[0].velocity))
