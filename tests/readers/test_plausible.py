"""What can't be is said where it is read."""

import numpy as np
import pytest
from recorder_files import instantel_ascii, miniseed, write

from pyblast.blasts.blast import Blast
from pyblast.errors import ReadError
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
