"""Field reports of waves: whole project files, with defaults, beside exact records."""

from pathlib import Path

import numpy as np
import pytest

from pyblast.project.project import load_project
from pyblast.solver.run import simulate

FOLDER = Path(__file__).parents[1] / "reported" / "144-oblique-fault-bends-in-the-layer"


@pytest.mark.long
def test_an_explosion_above_a_fault_that_dips_obliquely_moves_as_it_should():
    exact = np.genfromtxt(FOLDER / "exact.csv", delimiter=",", names=True)
    project = load_project(FOLDER / "project.toml")

    records = simulate(project.model, project.duration).seismograms

    for name, record in records.items():
        columns = [exact[f"{name}_v{axis}_m_per_s"] for axis in "xyz"]
        times = record.times - project.lead
        wanted = np.array([np.interp(times, exact["time_s"], column) for column in columns]).T
        away = np.linalg.norm(record.velocity - wanted) / np.linalg.norm(wanted)
        assert away < 0.02, name
