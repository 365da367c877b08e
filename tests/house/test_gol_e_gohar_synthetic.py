"""The synthetic site of the example: what its records are made of, without the search."""

from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import numpy as np
import pytest

from pyblast.back_analysis.parameters import check_parameters
from pyblast.inference.parameter import Parameter
from pyblast.signals.seismogram import Seismogram

FOLDER = Path(__file__).parents[2] / "examples" / "gol_e_gohar"


def loaded(name):
    spec = spec_from_file_location(name, FOLDER / f"{name}.py")
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def reproduce():
    return loaded("reproduce")


@pytest.mark.parametrize("edges", ["FINE", "COARSE"])
def test_the_records_are_made_with_the_values_of_the_paper(reproduce, edges):
    config = reproduce.project(getattr(reproduce, edges)).config
    fault = config.joints["fault"].model_extra

    assert (fault["kn_gpa_per_m"], fault["ks_gpa_per_m"]) == (0.114, 0.025)
    assert config.damping.ratio == 0.0112


def test_the_truth_lies_within_the_ranges_which_the_project_knows(reproduce):
    parameters = [Parameter(path, low, high) for path, (low, high, *_) in reproduce.RANGES.items()]

    check_parameters(reproduce.project(reproduce.COARSE), parameters)
    for low, high, start, true, _ in reproduce.RANGES.values():
        assert low < true < high
        assert low < start < high
        assert 2.0 < max(start / true, true / start) < 4.0
    assert reproduce.FINE > 1.4 * reproduce.COARSE  # not the mesh of the search


@pytest.mark.parametrize("converged", [True, False])
def test_an_interval_is_given_only_where_the_search_has_converged(reproduce, converged):
    rows = [{"path": path, "best": 0.1, "within": [0.09, 0.12]} for path in reproduce.RANGES]

    lines = list(reproduce.rows_of({"parameters": rows, "fit": {"converged": converged}}))

    assert len(lines) == 3
    assert all(("0.09 to 0.12" in line) == converged for line in lines)
    assert all(("not converged" in line) != converged for line in lines)


def test_the_energy_after_one_second_is_a_share(reproduce):
    late = np.where(np.arange(200) * 0.01 < 1.005, 1.0, 0.5)
    motion = Seismogram(np.outer(late, [1.0, 2.0, 3.0]), 0.01)

    ppv, _, share = reproduce.measures(motion)

    assert ppv == pytest.approx([1e3, 2e3, 3e3])
    assert share == pytest.approx([100.0 * 99 * 0.25 / (101 + 99 * 0.25)] * 3)


def test_the_table_beside_the_paper_takes_the_place_of_the_last_one():
    paper = loaded("paper")
    row = {"quantity": "PPV", "unit": "mm/s", "measured": "a", "3DEC": "b",
           "pyblast": {"vertical": 2.5}, "reason": "c"}  # fmt: skip
    run = {"zones": 9, "duration": 2.0, "steps": 7, "wall_seconds": 1.0, "failed_checks": ["D4"]}
    text = paper.page(paper.PAGE.read_text(encoding="utf-8"), {"rows": [row], "run": run})

    assert "| PPV, mm/s | a | b | vertical 2.5 | c |" in text
    assert paper.page(text, {"rows": [row], "run": run}) == text
