"""What can't be is said where it is read."""

import numpy as np
import pytest
from recorder_files import instantel_ascii, miniseed, write
from small_project import written

from pyblast.blasts.blast import Blast
from pyblast.errors import ReadError
from pyblast.project.level import unlikely_values
from pyblast.project.project import load_project
from pyblast.recordings.recording import read_recording

TIMES = np.arange(300) / 1000.0
PULSE = 8.0 * np.sin(2.0 * np.pi * 20.0 * TIMES) * (TIMES < 0.2)


@pytest.mark.parametrize("mark", [9999.0, -999.9, -9999.0, 32767.0])
@pytest.mark.parametrize("count", [1, 40])
def test_marks_of_missing_samples_are_no_motion(tmp_path, mark, count):
    samples = PULSE.copy()
    samples[150 : 150 + count] = mark
    rows = [f"{t:.3f},{v:.4f}" for t, v in zip(TIMES, samples, strict=True)]

    with pytest.raises(ReadError, match=r"sample 150: .* stands alone"):
        read_recording(write(tmp_path, "\n".join(["Time (s),Vert (mm/s)", *rows])))


def test_marks_are_found_in_every_format(tmp_path):
    text = instantel_ascii().replace("\n 0.0000 \t 0.0000 \t 0.0000 \n", "\n 9999 \t 0 \t 0 \n", 1)
    motion = np.column_stack([1e-3 * PULSE] * 3)
    motion[150] = -999.9

    for content in (text, miniseed({"R01": motion})):
        with pytest.raises(ReadError, match="stands alone"):
            read_recording(write(tmp_path, content))


def test_a_sharp_pulse_is_motion(tmp_path):
    sharp = np.where(np.arange(300) == 100, 8.0, 0.0) + 0.5 * np.sin(100.0 * TIMES)
    rows = [f"{t:.3f},{v:.4f}" for t, v in zip(TIMES, sharp, strict=True)]

    (record,) = read_recording(write(tmp_path, "\n".join(["Time (s),Vert (mm/s)", *rows])))

    assert record.seismogram.ppv[2] > 7e-3


@pytest.mark.parametrize(
    ("changed", "sentence"),
    [
        ({"charge": [0.0, 0.0]}, "All charges are 0"),
        ({"times": [0.0, 0.0]}, "All holes fire at 0 ms"),
        ({"toe": [[0, 0, 5], [5, 0, -10]]}, "The toe lies above the collar: hole 1"),
        ({"toe": [[0, 0, 0], [5, 0, -10]]}, "has no length: hole 1"),
    ],
)
def test_tables_that_nobody_filled_in_are_said(changed, sentence):
    given = {"collar": [[0, 0, 0], [5, 0, 0]], "toe": [[0, 0, -10], [5, 0, -10]],
             "charge": [50.0, 60.0], "times": [0.0, 0.025]}  # fmt: skip

    assert sentence not in " ".join(Blast("B", **given).checks())
    assert sentence in " ".join(Blast("B", **{**given, **changed}).checks())


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("duration_s = 0.1", "duration_s = 200", "run duration_s is 200 s"),
        (
            "[run]",
            "[insitu]\nstress_mpa = [-5e6, -5e6, -5e6, 0, 0, 0]\n[run]",
            "stress is 5000000 MPa",
        ),
        ("[run]", "[insitu]\nhorizontal_ratio = 1e6\n[run]", "horizontal_ratio is 1000000"),
    ],
)
def test_values_that_no_project_has_are_a_finding(tmp_path, old, new, sentence):
    def finding(*changes):
        project = load_project(written(tmp_path, *changes))
        return unlikely_values(project.materials, project.joints, project.config)

    assert finding() is None
    assert sentence in finding((old, new)).text


@pytest.mark.parametrize(
    ("radius", "peak", "sentence"),
    [(57.0, 1.0, "radius_m is 57 m"), (0.06, 5000.0, "peak_time_ms is 5000 ms")],
)
def test_a_charged_hole_of_another_size_is_a_finding(radius, peak, sentence):
    from pyblast.config.sources import ChargedHoleConfig, HolesInsideConfig

    hole = ChargedHoleConfig(material="rock", charge_kg=40.0, radius_m=radius, peak_time_ms=peak)
    config = type("Config", (), {"holes_inside": HolesInsideConfig(charged_hole=hole)})

    assert sentence in unlikely_values({}, (), config).text


@pytest.mark.parametrize(
    ("cp", "cs", "density", "sentence"),
    [
        (3000.0, 2200.0, 2600.0, "cp/cs is 1.36"),
        (3000.0, 150.0, 1900.0, "cp/cs is 20"),
        (166.0, 96.0, 2600.0, "as if its moduli were given in GPa"),
        (1500.0, 60.0, 1700.0, ""),
        (3800.0, 2200.0, 2600.0, ""),
    ],
)
def test_speeds_that_no_ground_has_are_a_finding(cp, cs, density, sentence):
    from pyblast.model.material import Material

    found = unlikely_values({"rock": Material.from_speeds(density, cp, cs)}, ())

    assert (found is None) if not sentence else (sentence in found.text)
