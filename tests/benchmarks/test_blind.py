"""The blind benchmark: its plan, its seals and its scores, on answers made by hand."""

import json
from argparse import Namespace

import numpy as np
import pytest
from small_site import recorded, small_site

from benchmarks.blind import __main__ as job
from benchmarks.blind.case_files import write_case
from benchmarks.blind.drawing import with_effects
from benchmarks.blind.noise import SEAM, joined
from benchmarks.blind.nuisances import shaken
from benchmarks.blind.plan import DEVELOPMENT_SEED, FAMILY, OUTSIDE, SHARES, TEST_SEED, plan
from benchmarks.blind.rows import row_of
from benchmarks.blind.running import predictions, project_in
from benchmarks.blind.scores import (
    by_program,
    calibration_error,
    medians,
    risk_curve,
    scores,
    shares,
)
from benchmarks.blind.sealing import freeze, opened, publish, published, seal
from benchmarks.blind.sites import AFTER, BEFORE, DT, FURTHER, HIDDEN, draw_site
from benchmarks.blind.worlds import World
from pyblast.errors import InputError


def truth(block="single", label="missing_joint", target="x=60.0", **parameters):
    effects = [] if block == "null" else [
        {"label": label, "family": "path", "target": target, "parameters": parameters}
    ]  # fmt: skip
    return {"case": "case-000", "block": block, "level": 1, "effects": effects, "share": 0.3}


def answer(outcome="NAMED", label="missing_joint", target="x=50.0", probability=None, **parameters):
    effects = [{"label": label, "target": target, "parameters": parameters}] if label else []
    ranking = [{"labels": [label]}] if label else []
    return {
        "outcome": outcome, "effects": effects, "class": [], "runs": 100, "cpu_s": 10.0,
        "model": {"effects": []},
        "evidence": {"delta_ln_evidence": 30.0, "null_threshold": 12.0,
                     "best_labels": [label] if label else [],
                     "ranking": ranking,
                     "probability": probability or {label or "none": 1.0}},
    }  # fmt: skip


def interval(value, low, high):
    return {"value": value, "low": low, "high": high, "unit": ""}


def rows(*pairs, length=20.0):
    return [row_of(true, said, {"length": length}) for true, said in pairs]


def test_the_whole_plan_has_sixty_nulls_and_every_block():
    blocks = [case.block for case in plan(160, TEST_SEED)]
    assert {block: blocks.count(block) for block in SHARES} == SHARES


def test_a_short_plan_begins_a_long_one():
    assert plan(160, DEVELOPMENT_SEED)[:16] == plan(16, DEVELOPMENT_SEED)


def test_short_plans_mix_the_blocks():
    assert {"null", "single", "two", "out of library"} <= {c.block for c in plan(16, TEST_SEED)}


def test_portions_are_scored_together(tmp_path, monkeypatch):
    monkeypatch.setattr(job, "RESULT", tmp_path / "blind.json")
    found = []
    for name in ("case-000", "case-001", "case-001"):
        store = tmp_path / name
        store.mkdir(exist_ok=True)
        publish(store, {name: "seal of " + name}, {"cases": 1, "seed": TEST_SEED})
        row = row_of({**truth("null"), "case": name}, answer("NULL", None)) | {"code": "same"}
        monkeypatch.setattr(job, "scored", lambda *_, row=row, **__: row)
        job._score(Namespace(workers=1), store)
        found.append(json.loads(job.RESULT.read_text()))
    assert [one["scores"]["cases"] for one in found] == [1, 2, 2]
    assert list(found[-1]["seals"]) == ["case-000", "case-001"]
    assert len(found[-1]["roots"]) == 2


def test_each_program_is_counted_on_its_own():
    some = rows(
        (truth("null"), answer("NULL", None)), (truth(), answer()),
        ({**truth("null"), "block": "hard null"}, answer()), (truth(), answer("UNKNOWN", None)),
    )  # fmt: skip
    old, new = by_program([row | {"code": code} for row, code in zip(some, "aabb", strict=True)])

    assert [old[key] for key in ("nulls", "alarms", "named", "right")] == [1, 0, 1, 1]
    assert [new[key] for key in ("nulls", "alarms", "named", "right")] == [1, 1, 1, 0]
    assert [(one["clear"], one["found"]) for one in (old, new)] == [(1, 1), (1, 0)]


def test_a_sealed_truth_opens_beside_its_frozen_answer(tmp_path):
    seals = stored(tmp_path)
    freeze(tmp_path, "case-000", answer(), seals)
    true, said = opened(tmp_path, "case-000", seals)
    assert true["effects"][0]["label"] == said["effects"][0]["label"] == "missing_joint"


def test_a_truth_changed_after_the_run_is_refused(tmp_path):
    seals = stored(tmp_path)
    freeze(tmp_path, "case-000", answer(), seals)
    path = tmp_path / "truth" / "case-000" / "truth.json"
    path.write_text(path.read_text().replace("missing_joint", "joint_slip"))
    with pytest.raises(InputError, match="not the one that was sealed"):
        opened(tmp_path, "case-000", seals)


def test_an_answer_changed_after_it_was_frozen_is_refused(tmp_path):
    seals = stored(tmp_path)
    freeze(tmp_path, "case-000", answer(), seals)
    path = tmp_path / "answers" / "case-000.json"
    path.write_text(path.read_text().replace("NAMED", "NULL"))
    with pytest.raises(InputError, match="not the one that was frozen"):
        opened(tmp_path, "case-000", seals)


def test_a_truth_does_not_open_without_an_answer(tmp_path):
    seals = stored(tmp_path)
    with pytest.raises(InputError, match="no frozen answer"):
        opened(tmp_path, "case-000", seals)


def test_a_case_is_answered_once(tmp_path):
    seals = stored(tmp_path)
    freeze(tmp_path, "case-000", answer(), seals)
    with pytest.raises(InputError, match="answered already"):
        freeze(tmp_path, "case-000", answer("NULL", None), seals)


def test_changed_seals_are_refused(tmp_path):
    stored(tmp_path)
    path = tmp_path / "seals.json"
    table = json.loads(path.read_text())
    table["seals"]["case-000"] = "0" * 64
    path.write_text(json.dumps(table))
    with pytest.raises(InputError, match="changed after"):
        published(tmp_path)


def test_the_same_truth_has_another_seal_each_time():
    assert seal(truth())[1] != seal(truth())[1]  # by salt, so that no guess can be tried on it


def test_a_wrong_name_and_a_silent_null_are_scored_as_such():
    found = scores(rows(
        (truth(), answer()), (truth(), answer(label="attenuation_Q", target="")),
        (truth("null"), answer("NULL", None)), (truth("null"), answer(label="joint_slip")),
    ))  # fmt: skip
    assert found["precision when named"]["share"] == pytest.approx(1 / 3)
    assert found["top-1"]["share"] == 0.5
    assert found["family"]["share"] == 1.0  # both are of the path
    assert found["false alarm"]["share"] == found["null said NULL"]["share"] == 0.5


def test_a_class_with_the_truth_counts_for_the_second_score_alone():
    said = {**answer("CLASS", "attenuation_Q"), "class": ["attenuation_Q", "missing_joint"]}
    found = scores(rows((truth(), said)))
    assert (found["top-1"]["share"], found["top-2"]["share"]) == (0.0, 1.0)


def test_a_crash_is_a_wrong_answer():
    found = scores(rows((truth(), {"outcome": "CRASH"})))
    assert (found["crashes"], found["top-1"]["share"]) == (1, 0.0)


def test_invisible_effects_are_left_out_of_what_must_be_found():
    assert scores(rows((truth(), answer()), length=5.0))["top-1"]["n"] == 0


@pytest.mark.parametrize(("offset", "right"), [(12.0, True), (31.0, False)])
def test_a_plane_is_located_within_twenty_metres(offset, right):
    said = answer(offset=interval(offset, 0.0, 40.0))
    assert row_of(truth(), said)["located"] is right


def test_intervals_are_held_against_the_truth():
    said = answer(target="x=60.0", kn=interval(1e9, 5e8, 2e9), ks=interval(1e9, 8e8, 2e9))
    assert sorted(row_of(truth(kn=1.2e9, ks=3e8), said)["covered"]) == [False, True]


def test_values_of_a_joint_are_held_against_the_truth_at_the_plane_that_is_nearest():
    said = answer(target="x=50.0", offset=interval(7.0, 0.0, 9.0), kn=interval(1e9, 5e8, 2e9))
    assert row_of(truth(kn=1.2e9), said)["covered"] == [True]  # 3 m off
    far = answer(target="x=10.0", offset=interval(7.0, 0.0, 9.0), kn=interval(1e9, 5e8, 2e9))
    assert row_of(truth(kn=1.2e9), far)["covered"] == []


def test_a_crash_on_a_null_is_an_alarm_and_a_claim_on_what_is_invisible_too():
    crash = rows((truth("null"), {"outcome": "CRASH"}))
    assert scores(crash)["false alarm"]["share"] == 1.0
    assert scores(rows((truth(), answer()), length=3.0))["false alarm, invisible"]["share"] == 1.0


def test_gain_is_relative_to_the_right_model_on_the_records_that_the_effect_reaches():
    measured = {
        "length": 20.0,
        "before": {"blasts": 0.4, "receivers": 0.6},
        "after": {"blasts": 0.5, "receivers": 0.8},
        "right": {"blasts": 0.6, "receivers": 0.8},
    }
    assert row_of(truth(), answer(), measured)["gain"] == pytest.approx(0.75)
    one = truth(label="clock_error", target="R01")
    assert row_of(one, answer(), measured)["gain"] == pytest.approx(0.5)  # other blasts alone


def test_no_alarm_in_sixty_bounds_the_rate_at_five_per_cent():
    assert shares([False] * 60)["bound"] == pytest.approx(0.0487, abs=1e-4)  # 1 - 0.05^(1/60)


def test_probabilities_that_are_right_as_often_as_they_say_are_calibrated():
    said = [answer(probability={"missing_joint": 0.75, "none": 0.25})] * 4
    true = [truth(), truth(), truth(), truth("null")]
    assert calibration_error(rows(*zip(true, said, strict=True))) == pytest.approx(0.0)


def test_risk_grows_as_weaker_answers_are_let_in():
    some = [{"lead": 20.0, "leader_right": True}, {"lead": 5.0, "leader_right": False}]
    assert [one["risk"] for one in risk_curve(some)] == [0.0, 0.5]


def test_medians_leave_out_what_is_not_there():
    assert medians([1.0, None, 3.0, 2.0])["median"] == 2.0


def test_probability_on_a_label_is_wrong_where_the_truth_is_in_no_library():
    outside = {**truth("out of library", "void", ""), "block": "out of library"}
    row = row_of(outside, answer(probability={"missing_joint": 1.0}))
    assert (row["brier"], row["sure_right"]) == (1.0, False)


def test_a_plane_on_the_other_axis_has_no_distance():
    assert row_of(truth(), answer(target="y=60.0"))["metres"] is None


def test_project_files_hold_neither_the_further_blast_nor_the_hidden_receiver(tmp_path):
    rng = np.random.default_rng(3)
    site = draw_site(rng)
    shape = len(site.receivers), 3, BEFORE + AFTER
    drawn = {blast: rng.normal(size=shape) * np.hanning(shape[-1]) for blast in site.blasts}
    write_case(tmp_path / "cases" / "case-000", "case-000", site, drawn)
    read = project_in(tmp_path, "case-000")
    assert list(read.blasts) == [blast for blast in site.blasts if blast != FURTHER]
    assert [r.name for r in read.config.receivers] == [
        r.name for r in site.receivers if r.name != HIDDEN
    ]
    assert read.joints[0].properties == pytest.approx(site.joints[0].joint.properties)
    rate = read.inside.moment_rate
    np.testing.assert_allclose(rate.values, site.moment_rate.values, rtol=1e-8, atol=1.0)
    for one in map(read.of, read.blasts):
        np.testing.assert_allclose(one.blast.times, site.blasts[one.name].times)
        for n, record in enumerate(one.records.values()):
            np.testing.assert_allclose(
                record.seismogram.velocity.T, drawn[one.name][n], rtol=1e-6, atol=1e-6
            )
            assert record.seismogram.start == -BEFORE * DT


@pytest.mark.parametrize("label", sorted({*FAMILY, *OUTSIDE}))
def test_every_effect_that_is_planned_can_be_drawn(label):
    rng = np.random.default_rng(5)
    bare = World(*shaken(draw_site(rng), 1, rng))
    world, hidden = with_effects(bare, [label], rng)
    assert world is not bare
    assert hidden[0]["family"] == FAMILY.get(label)


def test_joined_noise_keeps_its_power_in_the_seams():
    windows = np.random.default_rng(1).normal(size=(400, 3, 200))
    whole = np.array([joined(some) for some in windows])
    assert whole.shape[1] == 600 - 2 * SEAM
    power = np.mean(whole**2, axis=0)
    assert np.abs(power.mean() - 1.0) < 0.02  # 192 000 numbers: 0.3 % is one sigma
    assert np.abs(power[200 - SEAM : 200].mean() - 1.0) < 0.03  # 24 000: 0.9 %


def stored(folder):
    """Return the seals of one case whose truth lies in a store."""
    text, sealed = seal(truth())
    path = folder / "truth" / "case-000" / "truth.json"
    path.parent.mkdir(parents=True)
    path.write_text(text)
    publish(folder, {"case-000": sealed}, {"cases": 1, "seed": 1})
    return published(folder)["seals"]


def test_a_further_receiver_beside_a_known_one_is_predicted_the_same():
    case = recorded(small_site())
    asked = case.project.blasts["B1"], case.project.receivers[1].position

    told = predictions(case, asked, np.zeros(4), (), None)

    known = np.array(told["blast"][1])
    there = np.array(told["receiver"][told["blasts"].index("B1")])
    assert told["receivers"][1] == "R1"
    assert np.abs(known).max() > 1e-4
    assert np.abs(there - known).max() < 0.02 * np.abs(known).max()
