"""Location by closed forms: places count by their size, blasts as one, strengths in their unit."""

import numpy as np
import pytest
from residual_case import residual_case

from pyblast.inference.covariance import RecordBlocks, noise_blocks
from pyblast.inference.error_model import ErrorModel, Levels
from pyblast.inference.location import Located, Places, located, unrestricted
from pyblast.inference.nuisances import Nuisances


def places_of(sizes, shapes=None, apart=10.0):
    """Return places of some sizes in a row."""
    centres = np.outer(apart * np.arange(len(sizes)), [1.0, 0.0, 0.0])
    none = np.zeros((len(sizes), 1, 1, 1, 3, 2), np.float32)
    return Places(centres, np.array(sizes, float), none if shapes is None else shapes)


def found(log_bayes, sizes, blasts=1):
    """Return a location with these log Bayes factors."""
    return Located(places_of(sizes), np.array(log_bayes), np.zeros((len(sizes), 1)), blasts)


def test_a_place_that_is_cut_in_two_is_as_probable_as_the_whole():
    whole = found([1.0, 4.0, 2.0], [1e3, 8e3, 1e3])
    cut = found([1.0, 4.0, 4.0, 2.0], [1e3, 2e3, 6e3, 1e3])

    assert cut.score == pytest.approx(whole.score)
    assert cut.probability[1:3].sum() == pytest.approx(whole.probability[1])
    assert cut.volume == whole.volume


def test_a_small_place_that_explains_more_is_held_before_a_large_one():
    near = found([6.0, 5.0], [1e3, 1e4])

    assert near.probability[1] > near.probability[0]
    assert near.held[0] == near.best == 0


def test_a_blast_that_is_fired_again_makes_no_place_surer():
    once = found([1.0, 4.0, 2.0], [1e3, 8e3, 1e3])
    again = found([2.0, 8.0, 4.0], [1e3, 8e3, 1e3], blasts=2)

    np.testing.assert_allclose(again.probability, once.probability)


def test_a_body_falls_to_the_root_of_one_over_e_at_its_reach():
    shapes = np.zeros((2, 1, 1, 1, 3, 2), np.float32)
    shapes[0] = 1.0

    spread = places_of([1e3, 1e3], shapes).spread(10.0)

    np.testing.assert_allclose(spread.shapes[1] / spread.shapes[0], np.exp(-0.5), rtol=1e-6)


def error_of(noise, band, motion):
    """Return the error of noise alone."""
    blocks = noise_blocks(noise, band, len(motion))
    none = np.zeros((*blocks.shape[:2], 3, band.n_functions, band.n_functions))
    zero = np.zeros(blocks.shape[:2])
    columns = Nuisances(np.zeros((0, *band.project(motion).shape)), ())
    return ErrorModel(RecordBlocks(blocks, none, none, zero, zero), columns, Levels((0.0,)))


def test_a_change_far_above_the_noise_is_located_with_its_own_strength():
    noise, band, motion = residual_case()
    error, held = error_of(noise, band, motion), band.project(motion)
    shapes = np.stack([held, np.roll(held, 1, axis=1)])[:, None].astype(np.float32)

    at = located(error, places_of([1e3, 1e3], shapes), -0.2 * held, 0.3)

    assert at.best == 0
    assert at.strength[0, 0] == pytest.approx(-0.2, rel=0.01)


def test_sources_that_change_nothing_explain_nothing():
    noise, band, motion = residual_case()
    held = band.project(motion)
    shapes = 1e-9 * held[None, None].astype(np.float32)

    free = unrestricted(error_of(noise, band, motion), [(places_of([1e3], shapes), 1.0)], held)

    assert free == pytest.approx(0.0, abs=1e-6)
