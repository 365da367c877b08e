"""What is foretold of a further blast, with effects that were fitted at the believed site."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from small_site import holes, recorded, small_site

import pyblast.diagnosis.library  # noqa: F401  fills the library
from pyblast.diagnosis.effects import Effect
from pyblast.diagnosis.hypotheses import LIBRARY, patterns_of
from pyblast.project.places import NEAR
from pyblast.simulation.simulation import Simulation
from pyblast.workflows import prediction
from pyblast.workflows.prediction import at_further, predict, predicted_holes

AIR = Effect("air_blast", "", ((800.0,), (0.05,), (340.0,), (1.1,), (1.0,)))
SOFT = Effect("soft_surface_layer", "", ((5.0,), (0.4,)))


@pytest.mark.parametrize("acting", [(AIR,), (SOFT, AIR)])
def test_an_air_blast_moves_the_ground_that_it_was_fitted_on(monkeypatch, acting):
    case = recorded(small_site())
    still = np.zeros((1, *case.motion.shape[1:]))
    fitted, none = SimpleNamespace(case=case), np.zeros_like(case.motion)
    moved = LIBRARY["air_blast"].apply(fitted, none, "", **AIR.parameters)
    monkeypatch.setattr(Simulation, "motion", lambda *_: still)

    values = [0.1, -0.1, 0.2, 0.0]
    foretold = predict(case, case.project.blasts["B1"], values, acting)

    np.testing.assert_array_equal(foretold, moved[case.blasts.index("B1")])


def test_a_site_of_which_nothing_was_calibrated_is_predicted_as_it_is(monkeypatch):
    case = recorded(small_site())
    monkeypatch.setattr(Simulation, "motion", lambda _, project: [project.materials["rock"].cp])

    assert predict(case, case.project.blasts["B1"], [], ()) == pytest.approx(2800.0)


@pytest.mark.parametrize(("east", "north", "there"), [(30.0, 30.0, True), (101.0, 61.0, False)])
def test_a_receiver_left_out_near_a_hole_is_predicted_where_the_next_blast_is_far(
    east, north, there
):
    case = recorded(small_site())
    fitted = replace(case, receivers=("R0", "R1", "R3"), unused={"R2": NEAR})

    names = at_further(fitted, holes([[east, north]], [10.0], [0.0])).receivers

    assert names == (("R0", "R1", "R2", "R3") if there else ("R0", "R1", "R3"))


def test_what_was_learned_of_holes_scales_each_hole_of_a_further_blast(monkeypatch):
    case = recorded(small_site())
    blast = holes([[30.0, 30.0], [34.0, 36.0]], [20.0, 80.0], [0.0, 0.04])
    still = np.zeros((1, *case.motion.shape[1:]))
    own = np.random.default_rng(1).standard_normal((2, *case.motion.shape[1:]))
    monkeypatch.setattr(Simulation, "motion", lambda *_: still)
    monkeypatch.setattr(prediction, "hole_motion", lambda *_: {prediction.FURTHER: own})
    steeper = Effect("charge_exponent", "", ((0.5,),))

    foretold = predict(case, blast, np.zeros(4), (steeper,))

    reference = patterns_of(case)[0].reference
    factor = (np.array([20.0, 80.0]) / reference) ** 0.5 - 1.0
    late = np.roll(own[1], round(0.04 / case.dt), axis=-1)
    late[..., : round(0.04 / case.dt)] = 0.0
    np.testing.assert_allclose(foretold, factor[0] * own[0] + factor[1] * late, atol=1e-9)


@pytest.mark.parametrize("name", [name for name, each in LIBRARY.items() if not each.linear])
def test_holes_of_a_further_blast_move_as_across_elastic_joints_where_one_is_not(name):
    case = recorded(small_site())
    hypothesis = LIBRARY[name]
    target = next(iter(hypothesis.targets(case)))
    effect = Effect(
        name,
        target,
        tuple((p.mean if p.mean is not None else p.low,) for p in hypothesis.parameters),
    )
    blast = case.project.blasts["B1"]

    bent = predicted_holes(case, blast, [], (effect,))
    elastic = predicted_holes(case, blast, [], ())

    np.testing.assert_array_equal(bent.charges.motion, elastic.charges.motion)
