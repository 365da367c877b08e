"""What errors records usually show, and what is larger than these."""

import numpy as np
import pytest
from small_site import recorded, scene_of, small_site

from pyblast.diagnosis import library  # noqa: F401  fills the library
from pyblast.diagnosis.cross_validation import CrossValidation, Subset
from pyblast.diagnosis.decision import explained_share
from pyblast.diagnosis.thresholds import ENERGY_SHARE


def test_errors_of_the_theory_alone_have_size_one():
    scene, rng = scene_of(recorded(small_site())), np.random.default_rng(1)
    case, baseline = scene.case, scene.baseline
    held = case.band.project(case.motion)
    energy = np.sum(held**2, axis=(2, 3), keepdims=True)
    scale = np.sqrt(ENERGY_SHARE * energy / np.prod(held.shape[2:]))
    draws = [case.band.restore(rng.normal(size=held.shape) * scale) for _ in range(40)]
    size = np.mean([baseline.over_usual(one) for one in draws], axis=0)
    assert np.all((size > 0.5) & (size < 1.1))  # the noise of the records has its part beside


def test_a_receiver_without_records_leaves_nothing():
    baseline = scene_of(recorded(small_site())).baseline
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
