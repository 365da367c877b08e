"""Real records without a model: what is there is named, untouched records are not accused."""

import numpy as np
import pytest
from closure_law import closure_law

from pyblast.line_records.quality import odd_channels
from pyblast.line_records.shots import shot_of
from pyblast.line_records.waves import air_wave, soft_layer
from pyblast.recordings.recording import read_gather


def shots(recordings, line, numbers):
    return [shot_of(read_gather(recordings / line / f"{n}.dat")) for n in numbers]


def test_untouched_hits_have_no_odd_receiver(recordings):
    hits = shots(recordings, "wghs", (6, 11, 16, 26, 31, 36))

    assert odd_channels(hits, (10.0, 60.0))[0].outcome == "NULL"


@pytest.mark.parametrize(("band", "outcome"), [((120.0, 500.0), "NAMED"), ((5.0, 80.0), "NULL")])
def test_the_air_wave_is_named_in_its_band_only(recordings, band, outcome):
    said = air_wave(shots(recordings, "refrapy_ex02", (1, 5, 7)), band)

    assert said.outcome == outcome
    if outcome == "NAMED":
        assert said.parameters["speed"][0] == pytest.approx(345.0, rel=0.03)


def test_the_ground_of_the_line_is_softer_above(recordings):
    left, right = (shots(recordings, "wghs", n) for n in (range(6, 16), range(26, 36)))

    assert soft_layer(left, right, (10.0, 50.0)).outcome == "NAMED"


def test_fractures_close_along_a_hyperbola(recordings):
    table = np.genfromtxt(recordings / "joint_closure" / "granodiorite_closure.csv",
                          delimiter=",", names=True, dtype=None, encoding="utf-8")  # fmt: skip
    loading = table[table["step"] <= 13]
    parts = [loading[loading["specimen"] == name] for name in np.unique(loading["specimen"])]

    said = closure_law([1e-3 * p["closure_mm"] for p in parts],
                       [1e6 * p["normal_stress_mpa"] for p in parts])  # fmt: skip

    assert said.outcome == "NAMED"


def test_a_raw_file_shows_its_clipped_samples_and_dead_channels(recordings):
    gather = read_gather(recordings / "soda_lakes" / "Shot_01005.sg2")

    assert np.flatnonzero(gather.dead).tolist() == [47, 58, 59]
    assert np.array_equal(gather.clipped, np.isclose(np.abs(gather.data), 2.82, rtol=1e-6))
