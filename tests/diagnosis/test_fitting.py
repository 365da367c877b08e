"""Derivatives of a fit beside places where an effect can't be."""

from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pytest

import pyblast.diagnosis.library  # noqa: F401  fills the library
from pyblast.diagnosis.effects import Effect
from pyblast.diagnosis.fitting import DIFFERENCE, Fitter, not_fitted
from pyblast.inference.variation import FilteredMotion

SLOPE = -0.8  # of the motion by the logarithm of a thickness


def fitter(thickest, thinnest=0.0):
    """Return a fitter of a soft layer that has room between two thicknesses in m."""

    def simulate(states):
        rooms = [effects[0].parameters["thickness"] for _, effects in states]
        return [
            np.full((1, 1, 3, 4), SLOPE * np.log(thick)) if thinnest <= thick <= thickest else None
            for thick in rooms
        ]

    baseline = SimpleNamespace(sigma=np.zeros(0), slopes=np.zeros((0,)))
    scene = SimpleNamespace(
        filters={}, filtered=lambda _: FilteredMotion(0.0, {}), case=None, baseline=baseline,
        error=None, simulate=simulate, received=lambda motion, *_: motion,
        contained=lambda _: nullcontext(),
    )  # fmt: skip
    return Fitter(scene, (Effect("soft_surface_layer", "", ((7.0,), (0.4,))),), np.zeros(0))


def column(one):
    """Return the derivative by the thickness at 7 m."""
    return one.begun(one.start()).slopes[0]


@pytest.mark.parametrize(("thinnest", "thickest"), [(0.0, 20.0), (0.0, 7.2), (6.9, 20.0)])
def test_a_derivative_is_told_by_the_step_that_can_be(thinnest, thickest):
    one = fitter(thickest, thinnest)
    sigma = one.effects[0].hypothesis.parameters[0].sigma

    assert sigma * DIFFERENCE > np.log(7.2 / 7.0)
    np.testing.assert_allclose(column(one), SLOPE * sigma)


def test_what_can_move_neither_way_has_no_derivative():
    assert not column(fitter(7.2, 6.9)).any()


@pytest.mark.parametrize(("thinnest", "thickest", "words"), [
    (0.0, 20.0, ()), (6.99, 7.01, ("soft_surface_layer was not fitted",)),
])  # fmt: skip
def test_an_effect_of_which_no_other_value_could_be_run_is_said_not_to_be_fitted(
    thinnest, thickest, words
):
    one = fitter(thickest, thinnest)
    state = one.begun(one.start())

    said = not_fitted(SimpleNamespace(state=state, values=np.zeros(0), effects=one.effects))

    assert len(said) == len(words)
    assert all(text.startswith(word) for text, word in zip(said, words, strict=True))
