"""The twin of the example: what its records are made of, without the search."""

from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import numpy as np
import pytest

from pyblast.back_analysis.parameters import check_parameters
from pyblast.inference.parameter import Parameter

FOLDER = Path(__file__).parents[2] / "examples" / "gol_e_gohar"


def loaded(name):
    spec = spec_from_file_location(name, FOLDER / f"{name}.py")
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def twin():
    return loaded("twin")


@pytest.mark.parametrize("real", [False, True])
def test_the_records_are_made_with_the_values_of_the_paper(twin, real):
    fault = twin.project(25, 1.0, real).config.joints["fault"].model_extra

    assert (fault["kn_gpa_per_m"], fault["ks_gpa_per_m"]) == (0.114, 0.025)
    assert twin.project(25, 1.0, real).config.damping.ratio == 0.0112


def test_the_truth_lies_within_the_ranges_which_the_project_knows(twin):
    parameters = [Parameter(path, low, high) for path, (low, high, _) in twin.RANGES.items()]

    check_parameters(twin.project(25, 1.0, False), parameters)
    assert all(low < true < high for low, high, true in twin.RANGES.values())


def test_noise_has_unit_level_and_repeats_with_its_seed(twin):
    first, origin = twin.noise(256, 1.0 / 256.0, np.random.default_rng(4))
    second, _ = twin.noise(256, 1.0 / 256.0, np.random.default_rng(4))

    assert first.std(axis=0) == pytest.approx([1.0] * 3, rel=1e-12)
    assert np.array_equal(first, second)
    assert origin


def test_the_table_beside_the_paper_takes_the_place_of_the_last_one():
    paper = loaded("paper")
    row = {"quantity": "PPV", "unit": "mm/s", "measured": "a", "3DEC": "b",
           "pyblast": {"vertical": 2.5}, "reason": "c"}  # fmt: skip
    run = {"zones": 9, "duration": 2.0, "steps": 7, "wall_seconds": 1.0, "failed_checks": ["D4"]}
    text = paper.page(paper.PAGE.read_text(encoding="utf-8"), {"rows": [row], "run": run})

    assert "| PPV, mm/s | a | b | vertical 2.5 | c |" in text
    assert paper.page(text, {"rows": [row], "run": run}) == text
