"""Cross-validation by closed forms: what is held out has no part, gains are summed."""

from types import SimpleNamespace

import numpy as np
import pytest
from residual_case import residual_case

from pyblast.diagnosis.cross_validation import CrossValidation, Subset, _Linear
from pyblast.inference.covariance import RecordBlocks, noise_blocks
from pyblast.inference.error_model import ErrorModel, Levels
from pyblast.inference.nuisances import Nuisances


def gains(*each):
    """Return a cross-validation with these gains of its subsets."""
    return CrossValidation(tuple(Subset(f"R{n}", gain, 0.0, 0.0) for n, gain in enumerate(each)))


def test_the_error_of_the_sum_of_gains_grows_with_the_root_of_their_number():
    assert gains(3.0, 7.0).standard_error == pytest.approx(4.0)  # of two: their difference
    twice = gains(*4 * (3.0, 7.0)).standard_error / gains(*16 * (3.0, 7.0)).standard_error
    assert twice == pytest.approx(0.5, rel=0.1)
    assert gains(3.0).standard_error == np.inf


def linear(recorded):
    """Return a fit of one slope to records in the band, linear around nothing."""
    noise, band, motion = residual_case()
    held, blocks = band.project(motion), noise_blocks(noise, band, len(motion))
    none = np.zeros((*blocks.shape[:2], 3, band.n_functions, band.n_functions))
    zero = np.zeros(blocks.shape[:2])
    error = ErrorModel(
        RecordBlocks(blocks, none, none, zero, zero),
        Nuisances(np.zeros((0, *held.shape)), ()), Levels((1e-9,)),
    )  # fmt: skip
    case = SimpleNamespace(band=SimpleNamespace(project=lambda x: x), residual=lambda _: recorded)
    whole = error.posterior(recorded, held[None], np.ones(1)).log_evidence
    return _Linear(SimpleNamespace(case=case), None, error, held[None], recorded, whole)


def test_records_that_are_held_out_have_no_part_in_their_prediction():
    _, band, motion = residual_case()
    held = band.project(motion)
    out = np.zeros(held.shape[:2], dtype=bool)
    out[1] = True
    other = held.copy()
    other[1] *= -3.0

    right, wrong = (linear(0.2 * records).without(out) for records in (held, other))

    np.testing.assert_allclose(wrong.motion, right.motion, rtol=1e-9)
    assert right.variance_reduction == pytest.approx(1.0, abs=1e-3)
    # Of what is three times as large and reversed, a prediction leaves (4/3)^2.
    assert wrong.variance_reduction == pytest.approx(1.0 - (4.0 / 3.0) ** 2, abs=0.01)
    assert wrong.log_likelihood < right.log_likelihood
