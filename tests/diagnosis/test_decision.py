"""What a decision rests on: folds of the effect in question, records that exist, all rivals."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from small_fits import LOUD, SLOW, fits, with_holes
from small_site import recorded, scene_of, small_site

import pyblast.diagnosis.library  # noqa: F401  fills the library
from pyblast.diagnosis import decision
from pyblast.diagnosis.cross_validation import (
    HARDLY,
    UNCONSTRAINED,
    CrossValidation,
    cross_validate,
)
from pyblast.diagnosis.decision import (
    RESOLUTION,
    _stands_out,
    _without,
    decide,
    intervals,
    on_finer_mesh,
    open_set_ratio,
)
from pyblast.diagnosis.effects import Effect
from pyblast.diagnosis.fitting import fit
from pyblast.diagnosis.forward import simulation_of
from pyblast.diagnosis.hypotheses import LIBRARY
from pyblast.diagnosis.scores import SiteScores
from pyblast.diagnosis.search import Search, material
from pyblast.diagnosis.thresholds import MATERIAL, MESH_CHANGE, OPEN_SET
from pyblast.model.ground_fields import Body


def test_an_effect_beside_another_is_tested_on_its_own_folds():
    here, _, slow, loud, both = fits()

    assert [f.name for f in cross_validate(here, loud, both).subsets] == ["S1", "B1"]
    assert [f.name for f in cross_validate(here, slow, both).subsets] == ["R0", "R1", "R2", "R3"]


def test_records_without_which_nothing_is_told_of_an_effect_are_no_fold():
    here, _, _, loud, both = fits()
    state = both.state.copy()
    n = len(both.values)
    moved = state.x[:n] - loud.state.x[:n]
    state.motion[1] -= np.tensordot(moved, state.slopes[:n, 1], 1)
    state.x[:n] = loud.state.x[:n]
    state.slopes[:, 0] = 0.0  # as if the clock could not be heard in S1
    state.slopes[:n, 0], state.motion[0] = loud.state.slopes[:n, 0], loud.motion[0]

    found = cross_validate(here, loud, replace(both, state=state))

    assert not found.subsets
    assert found.not_held_out == {"S1": HARDLY, "B1": UNCONSTRAINED}


def test_records_of_which_an_effect_says_nothing_are_no_fold():
    here, _, slow, _, both = fits()
    state = both.state.copy()
    state.motion[:, 3] = slow.motion[:, 3]  # as if R3 had not recorded B1

    found = cross_validate(here, slow, replace(both, state=state))

    assert [fold.name for fold in found.subsets] == ["R0", "R1", "R2"]
    assert found.not_held_out == {"R3": HARDLY}


def test_the_worst_of_receivers_that_are_all_explained_poorly_does_not_stand_out():
    here, _, _, loud, both = fits()

    def alike(*chi_square):
        return replace(loud, chi_square=np.array([chi_square, chi_square]))

    assert both.effects[0].target == "R2"
    assert not _stands_out(here.case.receivers, alike(2.1, 2.9, 3.1, 2.4), both, "clock_error")
    assert _stands_out(here.case.receivers, alike(2.1, 2.4, 9.0, 2.3), both, "clock_error")


def test_an_effect_of_a_receiver_beside_others_is_at_the_one_that_is_worst_explained():
    here, _, slow, loud, both = fits()
    names, (clock, charge) = here.case.receivers, both.effects
    elsewhere = replace(both, effects=(replace(clock, target="R0"), charge))

    assert _stands_out(names, loud, both, "clock_error")
    assert not _stands_out(names, loud, elsewhere, "clock_error")
    assert _stands_out(names, slow, elsewhere, charge.label)  # one of a blast needs not


def test_the_base_of_a_set_is_the_fit_of_the_same_effects_at_the_same_places():
    here, none, slow, loud, both = fits()
    elsewhere = replace(slow, effects=(replace(slow.effects[0], target="R0"),))
    found = Search(here, lambda *_: None, none, [both, elsewhere, loud, slow], both)

    assert _without(found, both, "misfire_or_charge_error") is slow


def test_two_effects_are_no_composite_if_the_budget_ended_before_others_were_tried_beside_one():
    here, none, slow, loud, both = fits()
    found = Search(here, lambda *_: None, none, [both, loud, slow], both, finished=False)

    assert decide(found).outcome == "PARTIAL"


def test_a_clock_and_a_charge_that_are_both_wrong_make_a_composite():
    here, none, slow, loud, both = fits()
    found = Search(here, lambda *_: None, none, [both, loud, slow], both)

    assert decide(found).outcome == "COMPOSITE"


def test_a_set_of_which_one_effect_can_not_be_tested_is_partial(monkeypatch):
    here, none, slow, loud, both = fits()

    def untested(scene, before, after):
        return CrossValidation(()) if before is loud else cross_validate(scene, before, after)

    monkeypatch.setattr("pyblast.diagnosis.decision.cross_validate", untested)
    found = Search(here, lambda *_: None, none, [both, loud, slow], both)

    said = decide(found)

    assert said.outcome == "PARTIAL"
    assert set(said.fit.labels) == set(both.labels)


@cache
def damped_fits(quality=8.0):
    """Return a scene whose ground damps unknown to it, and the fits of none and of that."""
    here = with_holes(scene_of(recorded(small_site(), damping(quality))))
    return here, fit(here, ()), fit(here, (Effect("attenuation_Q", "", ((12.0,),)),))


@pytest.mark.long
def test_an_effect_on_top_of_another_is_fitted_by_fewer_runs_as_well():
    """What was fitted before keeps its columns while the clock settles, then both move."""

    def late(motion):
        moved = motion.copy()
        moved[:, 1] = np.roll(motion[:, 1], 2, axis=-1)  # 8 ms
        return moved

    truth = recorded(small_site(), damping(8.0), change=late)
    clock = Effect("clock_error", "R1", ((0.0,),))
    found, runs = [], []
    for known in (False, True):
        here = with_holes(scene_of(truth))
        damped = fit(here, (Effect("attenuation_Q", "", ((12.0,),)),))
        before = here.simulation.runs
        held = damped if known else None
        found.append(fit(here, (*damped.effects, clock), damped.values, base=held))
        runs.append(here.simulation.runs - before)
    anew, held = found

    assert runs[1] <= 0.5 * runs[0]
    assert held.log_evidence == pytest.approx(anew.log_evidence, abs=1.0)
    assert held.effects[1].values[0][0] == pytest.approx(8e-3, abs=1e-3)
    assert held.effects[0].values[0][0] == pytest.approx(anew.effects[0].values[0][0], rel=0.1)


def damping(quality):
    """Return the small site with this quality."""
    return LIBRARY["attenuation_Q"].apply(small_site(), "", q=quality)


def finer(scene, fitted, change):
    """Return what stands for a finer mesh: it adds a change (n_blasts, ...) to what is sent."""
    (sent,) = scene.simulate([(fitted.values, fitted.effects)])
    motion, blasts = sent + change, scene.case.blasts
    return SimpleNamespace(motion=lambda _, names: motion[[blasts.index(n) for n in names]])


@pytest.mark.long
def test_an_answer_that_a_finer_mesh_changes_is_corrected():
    here, none, damped = damped_fits()
    found = Search(here, lambda *_: None, none, [damped], damped)
    ((quality,),) = damped.effects[0].values
    less = here.simulation.motion(damping(3.0 * quality)) - here.simulation.motion(damping(quality))

    decision = decide(found, finer(here, damped, less))

    assert quality == pytest.approx(8.0, rel=0.1)
    assert decision.outcome == "NAMED"
    assert decision.mesh_change > MESH_CHANGE
    assert decision.fit.effects[0].values[0][0] == pytest.approx(4.8, rel=0.1)  # 1/8 + 1/8 - 1/24


@pytest.mark.long
def test_an_answer_that_a_finer_mesh_leaves_without_evidence_may_be_the_mesh(monkeypatch):
    here, none, damped = damped_fits(5.0)
    found = Search(here, lambda *_: None, none, [damped], damped)
    monkeypatch.setattr(Search, "required", found.delta_ln_evidence(damped) - 0.5)
    beside = np.zeros_like(damped.motion)
    beside[0, 3] = 0.11 * np.roll(damped.motion[0, 3], 20, axis=-1)

    assert decide(found).outcome == "NAMED"
    decision = decide(found, finer(here, damped, beside))
    assert decision.mesh_change > MESH_CHANGE
    assert (decision.outcome, decision.rivals[-1]) == ("CLASS", RESOLUTION)


def test_what_a_finer_mesh_is_held_against_is_what_was_fitted():
    here, *_ = fits()
    damped = fit(here, (Effect("attenuation_Q", "", ((25.0,),)),))
    fine, runs = simulation_of(here.case), here.simulation.runs

    same, change = on_finer_mesh(here, fine, damped)

    assert here.simulation.runs == runs  # the answer was run already, and corrected
    assert same is damped
    assert change < 1e-12  # the same zones


def test_nothing_is_named_where_the_budget_ended_before_the_others_were_tried():
    here, none, slow, loud, both = fits()
    found = Search(here, lambda *_: None, none, [both, loud, slow], both)
    found.compared = False

    assert decide(found).outcome == "PARTIAL"


def test_a_receiver_without_records_is_no_fold_that_must_gain():
    here, _, slow, _, both = fits()
    usual = here.baseline.usual.copy()
    usual[:, 3] = 0.0
    baseline = replace(here.baseline, usual=usual)

    proof = cross_validate(replace(here, baseline=baseline), slow, both)

    assert [fold.name for fold in proof.subsets] == ["R0", "R1", "R2"]
    assert np.all(np.isfinite([fold.variance_reduction_after for fold in proof.subsets]))


def test_a_residual_counts_as_much_where_a_receiver_missed_other_blasts():
    size = np.ones((3, 4))
    size[:, 1] = 0.0, 0.0, MATERIAL + 0.1

    assert material(size)


def test_a_blast_that_is_fired_again_makes_no_interval_narrower():
    _, _, slow, *_ = fits()
    narrow = replace(slow.posterior, covariance=slow.posterior.covariance / 3.0)
    again = replace(slow, chi_square=np.repeat(slow.chi_square, 3, axis=0), posterior=narrow)

    (once,), (thrice,) = intervals(slow), intervals(again)

    assert once["shift"]["low"] < once["shift"]["value"] < once["shift"]["high"]
    for end in ("low", "value", "high"):
        assert thrice["shift"][end] == pytest.approx(once["shift"][end], rel=1e-9)


def test_an_interval_is_never_wider_than_what_was_known_before():
    _, _, slow, _, _ = fits()
    known = np.eye(len(slow.state.x))
    blind = replace(slow, posterior=replace(slow.posterior, covariance=known))
    many = replace(blind, chi_square=np.repeat(blind.chi_square, 9, axis=0))
    one = replace(blind, chi_square=blind.chi_square[:1])

    (wide,), (alone,) = intervals(many), intervals(one)

    assert wide["shift"] == alone["shift"]


@pytest.mark.parametrize("turn", [1, -1])
def test_a_set_of_effects_counts_once_whichever_was_found_first(turn):
    here, none, _, _, both = fits()
    found = Search(here, lambda *_: None, none)
    less = replace(both.posterior, log_evidence=both.log_evidence - 1.0)
    other = replace(both, effects=both.effects[::-1], posterior=less)

    for one in (both, other)[::turn]:
        found.add(one)

    assert [one.effects for one in found.fits] == [both.effects]
    assert found.fits[0].alternatives == ()


def searched(here, none, *found):
    """Return a search with scores of no class, of fits with the last one chosen."""
    return Search(
        here, lambda *_: None, none, list(found[::-1]), found[-1], scores=SiteScores(here, (), 1)
    )


def test_a_clock_and_a_charge_explain_more_than_sources_anywhere_in_the_ground():
    here, none, slow, loud, both = fits()
    for chosen in (slow, loud, both):
        assert open_set_ratio(searched(here, none, chosen), chosen) > 1.0


@pytest.mark.long
def test_a_body_that_no_clock_explains_is_outside_of_what_is_known():
    body = Body((85.0, 45.0, -20.0), -0.5, 15.0)
    here = with_holes(scene_of(recorded(small_site(), small_site().changed(fields=(body,)))))
    none, slow, loud = (fit(here, some) for some in ((), (SLOW,), (LOUD,)))
    for chosen in (slow, loud):
        assert open_set_ratio(searched(here, none, chosen), chosen) < OPEN_SET


@pytest.mark.parametrize(("ratio", "outcome"), [(0.2, "UNKNOWN"), (0.4, "COMPOSITE")])
def test_a_cause_outside_of_the_library_is_unknown(monkeypatch, ratio, outcome):
    monkeypatch.setattr(decision, "open_set_ratio", lambda *_: ratio)
    here, none, slow, loud, both = fits()

    answer = decide(Search(here, lambda *_: None, none, [both, loud, slow], both))

    assert (answer.outcome, answer.open_set) == (outcome, ratio)
    assert answer.best.where == both.where
