"""What errors records usually show, and what is larger than these."""

from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from small_site import recorded, scene_of, small_site

from pyblast.diagnosis import library  # noqa: F401  fills the library
from pyblast.diagnosis.cross_validation import CrossValidation, Subset
from pyblast.diagnosis.decision import explained_share
from pyblast.diagnosis.error import gained, learned_error, usual_energy
from pyblast.diagnosis.thresholds import ENERGY_SHARE, MESH_SHARE
from pyblast.inference.parameter import STIFFNESS, kind_of_key
from pyblast.project.uncertain_ground import factors_of


@cache
def small_case():
    """Return the records of the small site."""
    return recorded(small_site())


def test_errors_of_the_theory_alone_have_size_one():
    scene, rng = scene_of(small_case()), np.random.default_rng(1)
    case, baseline = scene.case, scene.baseline
    held = case.band.project(case.motion)
    energy = np.sum(held**2, axis=(2, 3), keepdims=True)
    scale = np.sqrt(ENERGY_SHARE * energy / np.prod(held.shape[2:]))
    draws = [case.band.restore(rng.normal(size=held.shape) * scale) for _ in range(40)]
    size = np.mean([baseline.over_usual(one) for one in draws], axis=0)
    assert np.all((size > 0.5) & (size < 1.1))  # the noise of the records has its part beside


def test_a_receiver_without_records_leaves_nothing():
    baseline = scene_of(small_case()).baseline
    baseline.usual[:, 1] = 0.0

    assert not baseline.chi_square(2.0 * baseline.motion)[:, 1].any()


def test_records_below_one_do_not_compensate_for_others():
    before, after = np.ones((2, 3)), np.ones((2, 3))
    before[0, :2] = 0.2, 3.0
    after[0, :2] = 0.1, 2.0

    assert explained_share(before, after) == pytest.approx(0.5)


def test_few_folds_must_all_gain_and_many_need_not_gain_alike():
    def proof(*gains):
        return CrossValidation(tuple(Subset("", gain, 0.0, 0.0) for gain in gains)).improves

    assert proof(10.0, 40.0)
    assert not proof(10.0, -1.0, 40.0)
    assert not proof(1.0, 2.0)
    assert not proof(20.0)
    assert proof(5.0, 7.0, 6.0, -0.2, 9.0)
    assert not proof(30.0, -3.0, -2.0, 1.0, 0.0)


def test_what_folds_lose_counts_by_its_size_and_not_by_their_number():
    def proof(*gains):
        return CrossValidation(tuple(Subset("", gain, 0.0, 0.0) for gain in gains)).improves

    gaining = (60.0, 70.0, 50.0, 65.0, 55.0, 60.0)
    assert proof(*gaining, -1.0, -2.0, -1.0, -3.0)
    assert not proof(*gaining, -40.0, -45.0, -35.0)


def test_motion_that_joints_alone_set_does_not_depend_on_density():
    """By dimensions motion is f(k / density) / density: without density where f is its inverse."""
    case = small_case()
    unknowns = factors_of(case.project)
    stiff = np.array([kind_of_key(each.name) == STIFFNESS for each in unknowns])
    shares = np.where(stiff, -1.0 / max(stiff.sum(), 1), 0.3)
    slopes = np.multiply.outer(shares, case.motion)
    aside = np.zeros((2, *case.motion.shape))

    error = learned_error(case, unknowns, (case.motion, slopes, aside, 0.0 * case.motion))

    columns = error.nuisances.columns[np.array(error.nuisances.groups) == "density"]
    assert stiff.any()
    assert np.abs(columns).max(initial=0.0) < 1e-9 * np.abs(case.motion).max()


def noisy(motion, noise):
    """Return a case of records (n_blasts, n_receivers, 3, n) with white noise of a variance."""
    shape = 3 * motion.shape[-1]
    return SimpleNamespace(
        motion=motion, valid=np.ones(motion.shape, dtype=bool), share=None,
        residual=lambda simulated: motion - simulated, band=SimpleNamespace(project=lambda x: x),
        noise=SimpleNamespace(covariance=lambda *_: noise * np.eye(shape)),
    )  # fmt: skip


def test_the_usual_error_of_a_record_is_never_less_than_its_noise():
    motion = np.ones((2, 4, 3, 5))

    quiet, loud = usual_energy(noisy(motion, 0.0)), usual_energy(noisy(motion, 2.0))
    finer = usual_energy(noisy(motion, 0.0), 0.1 * motion)

    np.testing.assert_allclose(quiet, ENERGY_SHARE * 15.0)
    np.testing.assert_allclose(loud, 2.0 * 15.0)  # no motion above the noise
    np.testing.assert_allclose(finer - quiet, MESH_SHARE * 0.01 * 15.0)


def test_of_two_states_that_explain_the_same_that_nearer_the_prior_is_more_probable():
    alike = SimpleNamespace(scores=lambda both: SimpleNamespace(log_evidence=np.zeros(len(both))))
    near, far = (
        SimpleNamespace(x=np.array(x), motion=np.ones((1, 1, 3, 2)))
        for x in ([1.0, 0.0], [1.0, 2.0])
    )

    assert gained(alike, noisy(near.motion, 1.0), far, near) == pytest.approx(2.0)
