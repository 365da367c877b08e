"""What misfits are worth, and what chance finds."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from small_site import recorded, small_site

from pyblast.diagnosis import library  # noqa: F401  fills the library
from pyblast.diagnosis.calibration import likelihood_of
from pyblast.diagnosis.cross_validation import CrossValidation, Subset
from pyblast.diagnosis.effects import Effect
from pyblast.diagnosis.null_distribution import NullDistribution, _derangement, _LinearFits
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


def test_errors_of_the_theory_twice_as_large_have_size_one_once_they_are_doubled():
    likelihood = made()
    case, size = likelihood.records, np.zeros(likelihood.n_data.shape)
    for b, r in np.ndindex(size.shape):
        noise, root = case.noise.covariance(case.band, b, r), likelihood.covariance.roots[b, r]
        errors = np.linalg.pinv(root @ root) - noise
        size[b, r] = np.trace(root @ (noise + 4.0 * errors) @ root) / likelihood.n_data[b, r]
    assert np.all(size > 1.5)
    np.testing.assert_allclose(likelihood.at_double_error(size), 1.0, rtol=1e-6)


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


def test_what_is_shuffled_does_not_hold_an_effect_at_one_receiver():
    likelihood, rng = made(), np.random.default_rng(5)
    left = rng.normal(size=likelihood.covariance.roots.shape[:-1])
    own = rng.normal(size=(1, *left.shape))
    effect = np.zeros((1, *left.shape))
    effect[0, :, 1] = 8.0 * rng.normal(size=left[:, 1].shape)
    left[:, 1] += effect[0, :, 1]
    n = left.shape[1]

    fits = _LinearFits(likelihood, own, [effect])

    def worth(order):
        return fits.best(*fits.permuted(left, order[None], np.ones((1, n))), 0.0)[0, 0]

    found = worth(np.arange(n))
    assert found > 20.0
    for _ in range(20):
        assert worth(_derangement(rng, n)) < 0.2 * found


def test_chance_finds_an_effect_at_all_places_together_as_the_search_does():
    likelihood, rng = made(), np.random.default_rng(6)
    left = rng.normal(size=likelihood.covariance.roots.shape[:-1])
    order = _derangement(rng, left.shape[1])
    places = []
    for r, s in enumerate(order):  # what is shuffled to each receiver is what its effect can do
        left[:, s] *= 3.0
        places.append(np.zeros((1, *left.shape)))
        places[-1][0, :, r] = left[:, s]
    none = np.zeros((0, *left.shape))

    def worth(some):
        fits = _LinearFits(likelihood, none, some)
        return fits.best(*fits.permuted(left, order[None], np.ones((1, len(order)))), 1.0)[:, 0]

    one, all_of_them = worth(places)

    assert all_of_them > 3.0 * one > 3.0
    assert worth(places[:1])[1] == worth(places[:1])[0]


def test_what_is_shuffled_to_a_receiver_with_a_dead_channel_has_no_part_there():
    whole, rng = made(), np.random.default_rng(7)
    roots, kept = whole.covariance.roots.copy(), whole.n_data.copy()
    m = roots.shape[-1]
    roots[:, 0, : m // 3] = roots[:, 0, :, : m // 3] = 0.0
    kept[:, 0] -= m // 3
    likelihood = replace(whole, covariance=SimpleNamespace(roots=roots, n_data_each=kept))
    left = rng.normal(size=roots.shape[:-1])
    left[:, 1, : m // 3] = 1e3  # where receiver 0 has nothing
    none = np.zeros((0, *left.shape))
    order = np.array([1, 0, 3, 2])

    fits = _LinearFits(likelihood, none, [np.zeros((1, *left.shape))])
    size, _ = fits.permuted(left, order[None], np.ones((1, 4)))

    assert np.all(size[0, :, 0] < 2.0)


def test_few_folds_must_all_gain_and_many_need_not_gain_alike():
    def proof(*gains):
        return CrossValidation(tuple(Subset("", gain, 0.0, 0.0) for gain in gains)).improves

    assert proof(10.0, 40.0)
    assert not proof(10.0, -1.0, 40.0)
    assert not proof(1.0, 2.0)
    assert not proof(20.0)
    assert proof(5.0, 7.0, 6.0, -0.2, 9.0)
    assert not proof(30.0, -3.0, -2.0, 1.0, 0.0)


def test_a_threshold_is_never_below_nothing():
    assert NullDistribution(np.full((2, 200), -3.0), {}).threshold(()) == 0.0


def test_a_label_needs_what_harmless_errors_give_it_and_no_other_does():
    rising = np.linspace(0.0, 1.0, 200)
    clocks = {"clock_error": np.array([20.0 * rising, 40.0 * rising])}
    chance = NullDistribution(np.array([5.0 * rising, 6.0 * rising]), clocks)
    slip, *clock = (
        Effect(name, place, ()) for name, place in
        (("joint_slip", "J1"), ("clock_error", "R1"), ("clock_error", "R2"))
    )  # fmt: skip

    assert chance.threshold([slip]) == pytest.approx(4.75)
    assert chance.threshold([slip, clock[0]]) == pytest.approx(19.0)
    assert chance.threshold(clock) == pytest.approx(38.0)  # of however many places
    assert chance.threshold_interval(clock)[0] < 38.0 < chance.threshold_interval(clock)[1]


def test_errors_of_all_records_that_are_larger_than_supposed_are_told_from_none():
    likelihood = made()
    as_supposed, larger = (np.full(likelihood.n_data.shape, size) for size in (1.0, 20.0))
    assert likelihood.log_gain_of_larger_errors(as_supposed) < 0.0
    assert likelihood.log_gain_of_larger_errors(larger) > 20.0
    for some in np.s_[0], np.s_[:, 1]:  # one blast, one receiver
        alone = as_supposed.copy()
        alone[some] = 40.0
        assert likelihood.log_gain_of_larger_errors(alone) > 5.0
