"""Scores of the library on the small site: what is missing scores most, and nothing else does."""

import json
from functools import cache
from itertools import product

import numpy as np
import pytest
from library_scene import library_of
from small_fits import LOUD, fits, late_and_loud, with_holes
from small_site import DT, recorded, scene_of, small_site

from pyblast.diagnosis import search as module
from pyblast.diagnosis.decision import decide
from pyblast.diagnosis.effects import Effect
from pyblast.diagnosis.fitting import fit
from pyblast.diagnosis.hypotheses import LIBRARY
from pyblast.diagnosis.scores import (
    SiteScores,
    _cheapest_first,
    detection_limits,
    main_blasts,
    members_of,
    of_speeds,
    trials,
)
from pyblast.diagnosis.search import Search
from pyblast.diagnosis.thresholds import IDEALISED

FEW = (
    "joint_viscous_fill", "joint_nonlinear_closure", "rock_speed", "clock_error",
    "clock_error/blast", "instrument_response/gain", "misfire_or_charge_error/blast",
    "sensor_orientation_or_polarity/turned",
)  # fmt: skip


@cache
def scores(kind):
    """Return the scores of a few hypotheses, of records with nothing or with an effect."""
    site = small_site()
    filled = LIBRARY["joint_viscous_fill"].apply(site, "J1", relaxation=6e-3)
    case = {
        "nothing": lambda: recorded(site),
        "filled": lambda: recorded(site, filled),
        "late and loud": lambda: recorded(site, change=late_and_loud),
    }[kind]()
    scene = with_holes(scene_of(case))
    with library_of(FEW):
        members = tuple(members_of(scene))
    return SiteScores(scene, members, seed=1)


def classes(kind):
    site = scores(kind)
    by_class = site.by_class(site.log_bayes(site.prior[None]))
    return {label: float(value[0]) for label, value in by_class.items()}


@pytest.mark.long
def test_every_hypothesis_is_a_member_at_every_target_and_strength():
    members = scores("nothing").members

    closing = [m for m in members if m.label == "joint_nonlinear_closure"]
    assert [m.trial.effects[0].values for m in closing] == [((0.4,),), ((0.65,),)]
    assert {m.label for m in members} == {LIBRARY[name].label for name in FEW}
    late = [m.trial.effects[0].target for m in members if m.label == "clock_error"]
    assert set(late) == {"R0", "R1", "R2", "R3", "S1", "B1"}


def test_what_may_have_either_sign_is_one_trial_with_a_strength_of_its_own():
    scene = scores("nothing").scene

    moved = trials(LIBRARY["wrong_coordinates/blast"], "B1", scene)
    loads = trials(LIBRARY["misfire_or_charge_error/holes"], "B1", scene)
    clock = trials(LIBRARY["clock_error"], "R1", scene)

    assert [[e.values for e in t.effects] for t in moved] == [[((6.0,), (0.0,)), ((0.0,), (6.0,))]]
    assert [len(trial.effects) for trial in loads] == [3]
    assert [[e.values for e in t.effects] for t in clock] == [
        [((pytest.approx(5e-4),),)], [((8e-3,),)], [((-8e-3,),)]
    ]  # fmt: skip


def test_nothing_scores_where_nothing_is_missing():
    assert max(classes("nothing").values()) < 3.0


@pytest.mark.long
@pytest.mark.parametrize(
    ("kind", "label"),
    [("filled", "joint_viscous_fill"), ("late and loud", "misfire_or_charge_error")],
)
def test_what_is_missing_scores_most(kind, label):
    scored = classes(kind)

    assert max(scored, key=scored.get) == label
    assert scored[label] > scores(kind).threshold


def test_the_threshold_is_the_largest_of_three():
    site = scores("nothing")

    assert site.threshold == max(site.thresholds.values())
    assert site.thresholds["least"] == 10.0
    assert site.thresholds["draws"] < 10.0
    # This scene has no better mesh: its column is zero, and no class scores above none.
    assert site.thresholds["numerical"] <= 3.0


def test_draws_depend_on_the_seed_alone():
    first = scores("nothing")
    again = SiteScores(first.scene, first.members, seed=1)
    other = SiteScores(first.scene, first.members, seed=2)

    assert again.thresholds == first.thresholds
    assert other.thresholds["draws"] != first.thresholds["draws"]


def test_calibrated_values_are_taken_back_to_the_prior():
    site = scores("nothing")
    scene, slopes = site.scene, site.scene.baseline.slopes
    values = np.array([0.02, -0.01, 0.1, 0.0])
    moved = scene.baseline.motion + np.tensordot(values, slopes, 1)

    at_prior = site.residual(moved, values)

    assert at_prior == pytest.approx(site.prior, abs=1e-12)


def test_effects_of_the_ground_are_scored_in_the_smallest_and_the_largest_blast():
    assert main_blasts(scores("nothing").scene.case) == (0, 1)


@cache
def limits():
    return {(v["label"], v["form"], v["parameter"]): v for v in detection_limits(scores("nothing"))}


@pytest.mark.parametrize(("share", "detected"), [(1.3, True), (0.5, False)])
def test_a_clock_error_is_detected_above_its_limit_and_not_below(share, detected):
    site, limit = scores("nothing"), limits()["clock_error", "", "shift"]
    late = -share * limit["value"] * np.gradient(site.scene.baseline.motion, 0.004, axis=-1)
    late[:, [0, 1, 3]] = 0.0

    moved = site.prior + site.scene.case.band.project(late)

    scored = site.by_class(site.log_bayes(moved[None]))["clock_error"][0]
    assert (scored > site.threshold) == detected


def test_every_departure_has_its_limit_in_its_own_unit():
    rows = limits()

    closing = rows["joint_nonlinear_closure", "", "closed"]
    assert closing["null_value"] == 0.0
    assert 0.0 < closing["value"] <= 0.65
    assert rows["clock_error", "", "shift"]["unit"] == "s"
    assert 1e-4 < rows["clock_error", "", "shift"]["value"] < 6e-3
    assert 0.01 < abs(rows["instrument_response", "gain", "gain"]["value"] - 1.0) < 0.5
    assert {label for label, *_ in rows} == {LIBRARY[name].label for name in FEW}
    json.dumps(list(rows.values()))


def test_a_named_effect_has_no_detection_limit():
    rows = detection_limits(scores("nothing"), ["clock_error"])

    assert "clock_error" not in {row["label"] for row in rows}


def test_evidence_of_a_fit_is_that_of_the_records_beside_its_parameters():
    site = scores("late and loud")
    none, loud = fit(site.scene, ()), fit(site.scene, (LOUD,))

    gain = loud.log_evidence - none.log_evidence

    assert gain > site.threshold
    assert site.beside(loud)["misfire_or_charge_error"] < site.beside(none)[LOUD.label]


def test_scores_that_fail_cost_themselves(monkeypatch):
    monkeypatch.setattr(module, "members_of", lambda *_: 1 / 0)
    scene, none, *_ = fits()
    monkeypatch.setattr(scene, "failures", {})
    search = Search(scene, lambda *_: None, none, chosen=none)

    done = module._scored(search, 1)

    assert done.scores is None
    assert done.fits == []
    assert list(scene.failures) == [module.SCORES]


@pytest.mark.long
def test_a_small_effect_is_fitted_and_named():
    """A clock that is late by less than two samples."""

    def late(motion):
        moved, spectrum = motion.copy(), np.fft.rfft(motion[:, 2], 256)
        turns = np.exp(-2j * np.pi * 6e-3 * np.fft.rfftfreq(256, DT))
        moved[:, 2] = np.fft.irfft(turns * spectrum)[..., : motion.shape[-1]]
        return moved

    scene = with_holes(scene_of(recorded(small_site(), noise=3e-4, change=late)))
    with library_of(["clock_error", "clock_error/blast", "instrument_response/gain"]):
        done = module.search(scene)
        decision = decide(done)

    assert decision.outcome == "NAMED"
    assert [effect.where for effect in decision.fit.effects] == [("clock_error", "R2")]
    assert decision.fit.effects[0].values[0][0] == pytest.approx(6e-3, abs=0.6e-3)


def test_an_error_of_firing_times_moves_the_motion_of_each_hole():
    scene = scores("nothing").scene
    error, motion, band = scene.error, scene.baseline.motion, scene.case.band
    own = [n for n, group in enumerate(error.nuisances.groups) if group == "firing"]

    (column,) = error.nuisances.columns[own]  # of the one hole of B1 that sends all

    seconds = 1e-3 * scene.case.project.config.priors.firing_ms
    late = -seconds * np.gradient(motion[1], scene.case.dt, axis=-1)
    assert not column[0].any()
    expected = band.project(np.stack([0.0 * late, late]))[1]
    np.testing.assert_allclose(column[1], expected, atol=0.05 * np.abs(expected).max())


@pytest.mark.long
def test_the_law_of_an_effect_on_the_ground_has_an_error_and_that_of_a_clock_has_none():
    site, band = scores("filled"), scores("filled").scene.case.band
    filled = fit(site.scene, (Effect("joint_viscous_fill", "J1", ((2e-3,),)),))
    clock = fit(site.scene, (Effect("clock_error", "R2", ((1e-3,),)),))

    def energy(blocks):
        return np.trace(blocks.noise, axis1=-2, axis2=-1).sum()

    baseline = site.scene.baseline
    calibrated = np.tensordot(filled.values - baseline.values, baseline.slopes, 1)
    change = band.project(filled.motion - baseline.motion - calibrated)
    more = energy(site.at_fit(filled).error.blocks) - energy(site.error.blocks)
    assert more == pytest.approx(IDEALISED * np.sum(change**2), rel=1e-6)
    assert site.at_fit(clock) is site


@pytest.mark.parametrize(("seconds_left", "tried"), [(1e-2, False), (1e4, True)])
def test_ground_whose_price_is_much_of_what_the_budget_leaves_is_not_meshed(seconds_left, tried):
    scene = scene_of(recorded(small_site()))
    soft = Effect("soft_surface_layer", "", ((5.0,), (0.4,)))
    scene.budget = scene.spent + seconds_left
    meshes = len(scene.case.project.meshes)

    (motion,) = scene.simulate([(np.zeros(4), (soft,))], [0])

    assert (motion is not None) == tried
    assert tried or "not computed" in scene.failures[frozenset([soft.where])]
    assert (len(scene.case.project.meshes) > meshes) == tried


def test_an_effect_of_which_a_run_was_paid_is_fitted_when_the_budget_is_spent():
    scene = scene_of(recorded(small_site()))
    soft = [Effect("soft_surface_layer", "", ((5.0,), (slower,))) for slower in (0.4, 0.5)]

    scene.simulate([(np.zeros(4), soft[:1])], [0])
    scene.budget = 0.0
    (motion,) = scene.simulate([(np.zeros(4), soft[1:])], [0])

    assert motion is not None
    assert not scene.failures


def test_no_member_waits_for_a_dearer_one_that_is_a_later_value_of_its_hypothesis():
    scene = scores("nothing").scene
    hypotheses = [LIBRARY[name] for name in ("soft_surface_layer", "joint_viscous_fill")]
    rows = [(trial, (0, 1), ()) for each in hypotheses
            for target in each.targets(scene.case)
            for trial in trials(each, target, scene)]  # fmt: skip

    order = [rows.index(row) for row in _cheapest_first(scene, rows)]

    price = [scene.price(np.zeros(4), row[0].effects) for row in rows]
    turn = [[r[0].effects[0].name for r in rows[: n + 1]].count(row[0].effects[0].name)
            for n, row in enumerate(rows)]  # fmt: skip
    for n, later in product(range(len(rows)), repeat=2):
        if turn[n] <= turn[later] and price[n] < price[later]:
            assert order.index(n) < order.index(later)
    assert order != sorted(order)


def test_a_speed_within_its_prior_is_no_effect():
    site = scores("nothing")

    columns = of_speeds(site.scene, site.members)

    speeds = [member for member in site.members if member.label == "rock_speed"]
    assert len(columns) == 2 * len(speeds) > 0
    within = 0.01 * site.scene.case.project.config.priors.speed_percent
    sigma = speeds[0].hypothesis.parameters[0].sigma
    np.testing.assert_allclose(columns[0], within / sigma * speeds[0].change.shapes[0])
