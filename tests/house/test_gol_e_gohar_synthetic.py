"""The twin of the example: what its records are made of, without the search."""

from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import numpy as np
import pytest

from pyblast.back_analysis.parameters import check_parameters
from pyblast.inference.parameter import Parameter

SCRIPT = Path(__file__).parents[2] / "examples" / "gol_e_gohar" / "twin.py"


@pytest.fixture(scope="module")
def twin():
    spec = spec_from_file_location("twin", SCRIPT)
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


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
