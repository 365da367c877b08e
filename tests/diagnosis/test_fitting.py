"""Derivatives of a fit beside places where an effect can't be."""

from contextlib import nullcontext
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from small_fits import LOUD, fits

import pyblast.diagnosis.library  # noqa: F401  fills the library
from pyblast.diagnosis.effects import Effect
from pyblast.diagnosis.fitting import CLEARLY, DIFFERENCE, Fitter, fit

SLOPE = -0.8  # of the motion by the logarithm of a thickness


def fitter(thickest, thinnest=0.0):
    """Return a fitter of a soft layer that has room between two thicknesses in m."""

    def simulate(states, _):
        rooms = [effects[0].parameters["thickness"] for _, effects in states]
        return [
            np.full((1, 1, 3, 4), SLOPE * np.log(thick)) if thinnest <= thick <= thickest else None
            for thick in rooms
        ]

    likelihood = SimpleNamespace(residual=lambda motion: -motion.reshape(1, 1, -1))
    baseline = SimpleNamespace(likelihood=likelihood, sigma=np.zeros(0), slopes=np.zeros((0,)))
    scene = SimpleNamespace(
        case=SimpleNamespace(blasts=("S1",)), baseline=baseline, simulate=simulate,
        received=lambda motion, _: motion, contained=lambda _: nullcontext(),
    )  # fmt: skip
    return Fitter(scene, (Effect("soft_surface_layer", "", ((7.0,), (0.4,))),), np.zeros(0))


def column(one):
    """Return the derivative by the thickness at 7 m."""
    place = one.start()
    motion = one.motions([place])[0]
    return one.jacobian(place, motion, np.array([True, False]))[0]


@pytest.mark.parametrize(("thinnest", "thickest"), [(0.0, 20.0), (0.0, 7.2), (6.9, 20.0)])
def test_a_derivative_is_told_by_the_step_that_can_be(thinnest, thickest):
    one = fitter(thickest, thinnest)
    sigma = one.effects[0].hypothesis.parameters[0].sigma

    assert sigma * DIFFERENCE > np.log(7.2 / 7.0)
    np.testing.assert_allclose(column(one), SLOPE * sigma)


def test_what_can_move_neither_way_has_no_derivative():
    assert not column(fitter(7.2, 6.9)).any()


@pytest.mark.parametrize(("behind", "given_up"), [(0.0, False), (2.0, True)])
def test_a_fit_ends_after_its_first_blast_if_a_rival_stays_better(behind, given_up):
    scene, _, _, loud, _ = fits()
    explained = np.minimum(loud.chi_square, 1.0)
    ahead = 2.0 * behind * CLEARLY
    rival = replace(loud, chi_square=explained, misfit=misfit_of(scene, explained) - ahead)

    fitted = fit(scene, (LOUD,), first=[1], rival=rival)

    assert (fitted is None) == given_up


def misfit_of(scene, chi_square):
    """Return -2 ln L of chi-squares in blasts that are explained, and as fitted in the second."""
    likelihood, loud = scene.baseline.likelihood, fits()[3]
    return likelihood.misfit_of(chi_square, [0]) + likelihood.misfit_of(loud.chi_square, [1])
