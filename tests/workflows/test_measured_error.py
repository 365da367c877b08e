"""`pyblast run --error`: a coarser run measures the error of the mesh at each receiver."""

import pytest
from small_project import INSIDE, written

from pyblast.errors import InputError
from pyblast.project.project import load_project
from pyblast.workflows import run

SIZED = ("grid_cells = [12, 4, 6]", "frequency_hz = {}")
SLOW = ("peak_time_ms = 40", "frequency_hz = 12")


def test_a_finer_mesh_has_a_smaller_measured_error(tmp_path):
    errors = []
    for hz in (25, 60):
        path = written(tmp_path, (SIZED[0], SIZED[1].format(hz)), SLOW, text=INSIDE)
        outcome = run.run(path, tmp_path / "out", error=True, report=False)
        errors.append(outcome.result.summary["receivers"]["house"]["expected_error"]["measured"])

    assert 0.0 < errors[1] < errors[0]


def test_a_grid_of_tetrahedra_has_no_coarser_mesh(tmp_path):
    project = load_project(written(tmp_path, text=INSIDE))

    with pytest.raises(InputError, match="coarser mesh"):
        run.measured_errors(project, {})
