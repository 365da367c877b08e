"""What misfits are worth, and what chance finds."""

import numpy as np
from small_site import recorded, small_site

from pyblast.diagnosis.likelihood import DOUBT, THEORY, likelihood_of


def made():
    """Return the likelihood of the small site."""
    return likelihood_of(recorded(small_site()))


def test_the_slope_of_the_misfit_is_the_weight_of_squares():
    likelihood = made()
    rng = np.random.default_rng(3)
    white = rng.normal(size=likelihood.roots.shape[:-1])
    move = 1e-6 * rng.normal(size=white.shape)
    weights = likelihood.weights(likelihood.size(white))[..., None]
    slope = likelihood.misfit(white + move) - likelihood.misfit(white - move)
    foreseen = 4.0 * np.sum(weights * white * move)
    np.testing.assert_allclose(slope, foreseen, rtol=1e-5)


def test_errors_of_the_theory_alone_have_size_one():
    likelihood = made()
    case, rng = likelihood.case, np.random.default_rng(1)
    held = case.band.project(case.motion)
    energy = np.sum(held**2, axis=(2, 3), keepdims=True)
    scale = np.sqrt(THEORY * energy / np.prod(held.shape[2:]))
    draws = [case.band.restore(rng.normal(size=held.shape) * scale) for _ in range(40)]
    size = np.mean([likelihood.size(likelihood.white(one)) for one in draws], axis=0)
    assert np.all((size > 0.5) & (size < 1.1))  # the noise of the records has its part beside


def test_a_broken_record_counts_by_its_logarithm():
    likelihood = made()
    size = np.ones(likelihood.kept.shape)
    size[0, 0] = 1e4
    worse = size.copy()
    worse[0, 0] *= 10.0
    grows = likelihood.misfit_of(worse) - likelihood.misfit_of(size)
    expected = (likelihood.freedom[0, 0] + DOUBT) * np.log(10.0)
    np.testing.assert_allclose(grows, expected, rtol=0.01)


def test_a_record_holds_no_more_numbers_than_its_samples_and_no_less_than_one():
    likelihood = made()
    assert np.all(likelihood.freedom > 1.0)
    assert np.all(likelihood.freedom < likelihood.kept)
