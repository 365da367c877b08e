"""What misfits are worth, and what chance finds."""

import numpy as np
import pytest
from small_site import recorded, small_site

from pyblast.diagnosis import library  # noqa: F401  fills the library
from pyblast.diagnosis.calibration import likelihood_of
from pyblast.diagnosis.cross_validation import CrossValidation, Subset
from pyblast.inference.likelihood import DOUBT, ENERGY_SHARE


def made():
    """Return the likelihood of the small site."""
    return likelihood_of(recorded(small_site()))


def test_the_slope_of_the_misfit_is_the_weight_of_squares():
    likelihood = made()
    rng = np.random.default_rng(3)
    white = rng.normal(size=likelihood.covariance.roots.shape[:-1])
    move = 1e-6 * rng.normal(size=white.shape)
    weights = likelihood.weights(likelihood.chi_square(white))[..., None]
    slope = likelihood.misfit(white + move) - likelihood.misfit(white - move)
    foreseen = 4.0 * np.sum(weights * white * move)
    np.testing.assert_allclose(slope, foreseen, rtol=1e-5)


def test_errors_of_the_theory_alone_have_size_one():
    likelihood = made()
    case, rng = likelihood.records, np.random.default_rng(1)
    held = case.band.project(case.motion)
    energy = np.sum(held**2, axis=(2, 3), keepdims=True)
    scale = np.sqrt(ENERGY_SHARE * energy / np.prod(held.shape[2:]))
    draws = [case.band.restore(rng.normal(size=held.shape) * scale) for _ in range(40)]
    size = np.mean([likelihood.chi_square(likelihood.whiten(one)) for one in draws], axis=0)
    assert np.all((size > 0.5) & (size < 1.1))  # the noise of the records has its part beside


def test_a_broken_record_counts_by_its_logarithm():
    likelihood = made()
    size = np.ones(likelihood.n_data.shape)
    size[0, 0] = 1e4
    worse = size.copy()
    worse[0, 0] *= 10.0
    grows = likelihood.misfit_of(worse) - likelihood.misfit_of(size)
    expected = (likelihood.n_effective[0, 0] + DOUBT) * np.log(10.0)
    np.testing.assert_allclose(grows, expected, rtol=0.01)


def test_records_below_one_do_not_compensate_for_others():
    likelihood = made()
    before, after = np.ones(likelihood.n_data.shape), np.ones(likelihood.n_data.shape)
    before[0, :2] = 0.2, 3.0
    after[0, :2] = 0.1, 2.0

    assert likelihood.excess(before) == pytest.approx(2.0)
    assert likelihood.explained_share(before, after) == pytest.approx(0.5)


def test_a_record_holds_no_more_numbers_than_its_samples_and_no_less_than_one():
    likelihood = made()
    assert np.all(likelihood.n_effective > 1.0)
    assert np.all(likelihood.n_effective < likelihood.n_data)


def test_few_folds_must_all_gain_and_many_need_not_gain_alike():
    def proof(*gains):
        return CrossValidation(tuple(Subset("", gain, 0.0, 0.0) for gain in gains)).improves

    assert proof(10.0, 40.0)
    assert not proof(10.0, -1.0, 40.0)
    assert not proof(1.0, 2.0)
    assert not proof(20.0)
    assert proof(5.0, 7.0, 6.0, -0.2, 9.0)
    assert not proof(30.0, -3.0, -2.0, 1.0, 0.0)


def test_errors_of_all_records_that_are_larger_than_supposed_are_told_from_none():
    likelihood = made()
    as_supposed, larger = (np.full(likelihood.n_data.shape, size) for size in (1.0, 20.0))
    assert likelihood.log_gain_of_larger_errors(as_supposed) < 0.0
    assert likelihood.log_gain_of_larger_errors(larger) > 20.0
    for some in np.s_[0], np.s_[:, 1]:  # one blast, one receiver
        alone = as_supposed.copy()
        alone[some] = 40.0
        assert likelihood.log_gain_of_larger_errors(alone) > 5.0
