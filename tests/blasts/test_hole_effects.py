"""Covariates of hole effects on patterns where they are known by hand."""

import numpy as np
import pytest

from pyblast.blasts.blast import Blast
from pyblast.blasts.hole_effects import ROWS, HoleChange, Pattern, over_holes

ROW = {row.name: row for row in ROWS}


def pattern(receivers=((0.0, -200.0, 0.0), (0.0, 200.0, 0.0)), **columns):
    """Return three rows of four holes, 4 m apart, that fire row by row away from the south."""
    row, number = np.divmod(np.arange(12), 4)
    collar = np.column_stack([5.0 * number, 4.0 * row, 0.0 * row])
    blast = Blast(
        "B", collar, collar - [0.0, 0.0, 10.0], np.full(12, 80.0),
        0.017 * number + 0.1 * row, 0.115, **columns,
    )  # fmt: skip
    return Pattern(blast, np.array(receivers), 80.0)


def test_rows_are_counted_from_the_side_that_fires_first():
    np.testing.assert_array_equal(
        pattern(row=np.repeat([0, 1, 2], 4)).rows, np.repeat([0, 1, 2], 4)
    )
    np.testing.assert_array_equal(pattern(burden=4.0, face=np.pi).rows, np.repeat([0, 1, 2], 4))


def test_the_front_row_is_free_and_later_rows_wait_for_the_one_before():
    confined = ROW["confinement"].covariate(pattern(burden=4.0, face=np.pi))[:, 0]
    choked = ROW["confinement"].covariate(pattern(burden=4.0, face=np.pi, choked=True))[:, 0]

    assert not confined[:4].any()
    np.testing.assert_allclose(choked[:4], 1.0)
    np.testing.assert_allclose(confined[4], np.exp(-0.1 / (8e-3 * 4.0)))  # 100 ms later
    np.testing.assert_array_equal(confined[4:], choked[4:])


def test_waves_cross_broken_ground_on_one_side_alone():
    metres = ROW["screening"].covariate(pattern(burden=4.0, face=np.pi))

    assert not metres[0].any()  # nothing has fired before the first hole
    assert metres[8:, 0].min() > 4.0  # to the face, through two rows
    assert metres[4:, 1].max() < 3.0  # away from it, beside holes of the same row at most


def test_rock_is_damaged_by_earlier_holes_nearby():
    harm = ROW["damage_by_earlier_holes"].covariate(pattern())[:, 0]

    assert harm[0] == 0.0
    assert harm[1] == pytest.approx(0.5 * np.exp(-((5.0 / 7.0) ** 2)))
    assert harm[5] > harm[1]


def test_stemming_comes_from_the_table_or_from_what_the_charge_leaves():
    known = np.r_[3.0, np.full(11, 4.0)]
    given = ROW["stemming"].covariate(pattern(stemming=known))[:, 0]
    left = pattern().stemming

    np.testing.assert_allclose(given, np.log(known / 4.0))
    np.testing.assert_allclose(left, 10.0 - 80.0 / (850.0 * np.pi / 4.0 * 0.115**2))


def test_the_second_of_two_decks_is_the_later_one():
    collar = np.repeat([[0.0, 0.0, 0.0], [5.0, 0.0, 0.0]], 2, axis=0)
    blast = Blast("B", collar, collar - [0.0, 0.0, 10.0], np.full(4, 40.0),
                  [0.0, 0.009, 0.026, 0.017])  # fmt: skip
    later = ROW["second_deck"].covariate(Pattern(blast, np.zeros((1, 3))))[:, 0]

    np.testing.assert_allclose(later, [-0.5, 0.5, 0.5, -0.5])


def test_a_covariate_that_hardly_varies_says_what_would_let_it():
    sentence = ROW["charge_exponent"].hardly_varies([pattern()])

    assert sentence.startswith("ln of the charge hardly varies (standard deviation 0")
    assert not ROW["row_number"].hardly_varies([pattern(row=np.repeat([0, 1, 2], 4))])


def test_factors_of_rows_multiply():
    own, frequency = pattern(burden=4.0, face=np.pi), np.array([5.0, 20.0, 60.0])
    rows, strengths = (ROW["screening"], ROW["screening/delay"]), (0.02, 1e-4)
    both = over_holes(rows, own, frequency, strengths)
    single = [over_holes([r], own, frequency, [x]) for r, x in zip(rows, strengths, strict=True)]

    np.testing.assert_allclose(both, single[0] * single[1])
    metres = rows[0].covariate(own)
    np.testing.assert_allclose(np.abs(both), np.exp(0.02 * metres)[..., None].repeat(3, 2))
    late = -np.angle(both[..., 0]) / (2.0 * np.pi * 5.0)
    np.testing.assert_allclose(late, 1e-4 * metres, atol=1e-12)


def test_a_hole_of_scale_zero_sends_nothing():
    factor = HoleChange(np.array([0.0, 1.0])).factor(np.array([30.0]), 30.0)

    np.testing.assert_array_equal(factor.ravel(), [0.0, 1.0])


def test_a_lossy_way_takes_amplitude_and_lets_high_frequencies_arrive_first():
    middle = 2.0 * np.pi * 20.0
    omega = middle * np.array([0.5, 1.0, 2.0])

    (factor,) = HoleChange(loss=np.array([2e-3])).factor(omega, middle)[:, 0]

    np.testing.assert_allclose(np.abs(factor), np.exp(-0.5 * omega * 2e-3))
    late = -np.angle(factor) / omega
    # Constant Q: a way of t* delays each octave by t* ln 2 / pi less than the one below.
    np.testing.assert_allclose(late, 2e-3 / np.pi * np.log(2.0) * np.array([1.0, 0.0, -1.0]))


def test_no_way_crosses_more_broken_ground_than_it_is_long():
    near = np.array([[7.5, 8.0 + 1.0 * n, 0.0] for n in range(-12, 12)])
    own = pattern(near, burden=4.0, face=np.pi)

    metres = ROW["screening"].covariate(own)

    away = np.linalg.norm(near[:, :2] - own.places[:, None], axis=-1)
    assert metres.max() > 3.0
    assert np.all(metres <= away + 0.5)
