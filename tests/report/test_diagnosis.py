"""The page of a diagnosis, for each kind of outcome, on records of a small site."""

import re
from dataclasses import dataclass, replace
from functools import cache
from html import unescape
from types import SimpleNamespace

import numpy as np
import pytest
from small_site import recorded, scene_of, small_site

import pyblast.diagnosis.library  # noqa: F401  fills the library
from pyblast.diagnosis.cross_validation import held_out_prediction
from pyblast.diagnosis.decision import Decision, decide
from pyblast.diagnosis.effects import Effect
from pyblast.diagnosis.fitting import fit
from pyblast.diagnosis.search import Search
from pyblast.diagnosis.summary import diagnosis_lines, summarise_diagnosis, suspected_misfires
from pyblast.diagnosis.thresholds import DECISIVE, REMAINS
from pyblast.inference.variation import FilteredMotion
from pyblast.report.diagnosis import (
    claims,
    detection_limit_rows,
    lead,
    render_diagnosis,
    score_rows,
    usual,
)
from pyblast.report.diagnosis import scene_of as view_of
from pyblast.report.diagnosis_figures import rock_map

SLOW = Effect("clock_error", "R2", ((0.0,),))
DELAYS = Effect("delay_scatter", "B1", ((0.0, 0.0, 0.0),))
NOTES = {
    "case": "pit <3>", "runs": 11, "wall_s": 2.5, "kept_runs": 0, "kept_s": 0.0, "seed": 1,
    "minutes_allowed": 4.0, "minutes_spent": 1.0, "finished": True, "provenance": {"pyblast": "0"},
}  # fmt: skip


@dataclass
class Made:
    """What the report needs of a diagnosis."""

    scene: object
    search: Search
    decision: Decision


def late(motion):
    """Let the clock of one receiver be 16 ms, four samples, slow."""
    motion = motion.copy()
    motion[:, 2] = np.roll(motion[:, 2], 4, axis=-1)
    return motion


@cache
def scene():
    """Return the small site with one slow clock, as if it were calibrated: two runs for all."""
    return scene_of(recorded(small_site(), change=late))


@cache
def made(outcome):
    """Return a diagnosis with an outcome, and its summary."""
    here = scene()
    none = fit(here, ())
    fits = [fit(here, (one,)) for one in (SLOW, DELAYS)]
    found = Search(here, lambda *_: None, none, fits, fits[0])
    decision = decide(found)
    if outcome == "CLASS":
        rivals = ("delay_scatter", "clock_error")
        decision = replace(decision, outcome=outcome, fit=fits[1], rivals=rivals)
    if outcome == "UNKNOWN":
        decision = replace(decision, outcome=outcome, fit=none, rivals=())
    if outcome == "NULL":
        found = Search(here, lambda *_: None, none, [], none)
        decision = Decision(outcome, none, (), {"none": 1.0}, 0.0, None)
    return Made(here, found, decision), summarise_diagnosis(found, decision) | NOTES


@cache
def page(outcome):
    """Return the page of an outcome."""
    return render_diagnosis(*made(outcome))


def text(outcome):
    """Return the words of the page, without its style and tags."""
    html = re.sub(r"(?s)<style>.*?</style>", "", page(outcome))
    return " ".join(unescape(re.sub(r"(?s)<[^>]*>", " ", html)).split())


def figures(outcome):
    """Return the titles of the figures of the page."""
    return re.findall(r"<figcaption><b>([^<]*)[.]</b>", page(outcome))


@pytest.mark.long
def test_a_slow_clock_is_named_with_its_place_and_time():
    found, summary = made("NAMED")

    assert found.decision.outcome == "NAMED"
    assert lead(found, summary).startswith("The clock of receiver R2 was wrong")
    assert re.search(r"clock_error receiver R2 shift 1[5-7]", text("NAMED"))


@pytest.mark.parametrize(("size", "begins"), [
    (1.0, "These records cannot tell whether something is missing"), (30.0, "Something is missing"),
])  # fmt: skip
def test_records_that_can_test_nothing_say_that_something_is_missing_by_their_misfit_alone(
    size, begins
):
    found, summary = made("NULL")
    chi_square = np.full_like(found.search.without_effects.chi_square, size)
    without = replace(found.search.without_effects, chi_square=chi_square)
    silent = replace(found, search=replace(found.search, without_effects=without))

    told = lead(silent, summary | {"outcome": "UNKNOWN"})

    assert begins in told
    assert "these records can test no effect of the library" in told


def test_the_view_colours_receivers_by_the_misfit_of_the_site_without_effects():
    found, summary = made("NAMED")

    shown = view_of(found, summary)

    misfits = np.mean(found.search.without_effects.chi_square, axis=0)
    for name, misfit in zip(found.search.scene.case.receivers, misfits, strict=True):
        assert shown["receivers"][name]["values"]["misfit"] == pytest.approx(misfit)
    assert ("misfit" in shown["fields"], shown["located"]) == (True, [])
    assert '"misfit"' in page("NAMED")


def test_the_page_draws_maps_ranking_and_records_that_were_left_out():
    titles = figures("NAMED")

    assert titles == [
        "In plan and section",
        "In time and frequency",
        "Evidence",
        "Blast B1 held out",
    ]


def test_effects_with_a_value_for_each_hole_are_drawn_hole_by_hole():
    assert "delay_scatter: delays of blast B1" in figures("CLASS")


def with_scales(parts):
    """Return a diagnosis and its decision, of scales of three holes."""
    found, _ = made("NAMED")
    before = found.decision.fit
    holes = Effect("misfire_or_charge_error/holes", "B1", (tuple(parts),))
    (scales,) = holes.hypothesis.parameters
    uncertain = np.diag([0.0] * len(before.values) + [(0.05 / scales.sigma) ** 2] * 3)
    state = replace(before.state, x=np.append(before.values, scales.standardised(parts)))
    posterior = replace(before.posterior, covariance=uncertain)
    silent = replace(
        before, effects=(holes,), state=state, posterior=posterior, alternatives=()
    )  # fmt: skip
    return found, replace(found.decision, fit=silent, best=silent)


def test_what_a_hole_radiates_is_its_scale_times_its_learned_variation():
    found, decision = with_scales(np.array([0.7, 0.9, 1.2]))
    scene, factors = replace(found.scene), np.array([0.6, 0.9, 1.1])
    motion = np.random.default_rng(1).normal(size=(3, *scene.holes["B1"].shape[1:]))
    scene.holes = scene.holes | {"B1": motion}
    at = scene.case.blasts.index("B1")
    own = FilteredMotion(0.0, {at: factors[:, None, None, None] * motion})
    assert suspected_misfires(decision, scene) == []

    vars(scene)["varied"] = SimpleNamespace(filtered=own)

    assert scene.radiated("B1") == pytest.approx(factors)
    (row,) = suspected_misfires(decision, scene)
    assert row["hole"] == scene.case.project.blasts["B1"].hole_ids[0]
    assert row["radiated"] == pytest.approx(0.7 * 0.6, abs=0.01)


def test_a_suspected_misfire_is_named_by_its_hole_first_and_the_step_is_to_keep_off():
    found, decision = with_scales(np.array([0.1, 0.9, 1.2]))
    first, second, _ = found.scene.case.project.blasts["B1"].hole_ids

    summary = summarise_diagnosis(found.search, decision) | NOTES | {"corrected": False}

    (row,) = summary["suspected_misfires"]
    assert (row["blast"], row["hole"], row["radiated"]) == ("B1", first, 0.1)
    assert row["low"] == 0.0 < row["radiated"] < row["high"] < 0.25
    (effect,) = summary["effects"]
    assert [scale["hole"] for scale in effect["parameters"]["scales"]][:2] == [first, second]
    named = f"hole {first} (0.10, 0.00 to {row['high']:.2f}) of blast B1"
    assert lead(replace(found, decision=decision), summary).startswith(
        f"Suspected misfires: {named}"
    )
    assert summary["next_measurement"].startswith(f"keep people and machines off {named}")
    assert f"  suspected misfires: {named}" in diagnosis_lines(summary)


def test_a_null_of_an_unfinished_search_does_not_say_that_nothing_is_missing():
    found, summary = made("NULL")
    summary = summary | {"evidence": summary["evidence"] | {"scores": [{}]}}
    assert lead(found, summary).startswith("Nothing is missing")

    words = lead(found, summary | {"finished": False})

    assert "Nothing is missing" not in words
    assert "the effects that the budget sufficed for" in words


def test_a_class_names_its_members_as_not_told_apart():
    words = text("CLASS")

    assert "These records cannot distinguish this from clock_error." in words
    assert "These records cannot distinguish" in words


def test_an_unknown_is_located_and_no_effect_is_listed():
    words = text("UNKNOWN")

    assert re.search(r"Something is missing, seen at R2 at [\d.]+ to [\d.]+ Hz", words)
    assert "No effect was found." in words
    assert "Receiver R2" in figures("UNKNOWN")


def test_where_no_effect_pays_the_next_receivers_belong_where_most_is_missing():
    found, _ = made("UNKNOWN")
    poor = replace(found.search, fits=found.search.fits[1:])
    decision = replace(found.decision, rivals=())

    assert poor.delta_ln_evidence(poor.fits[0]) < DECISIVE
    words = summarise_diagnosis(poor, decision)["next_measurement"]
    assert words == "more receivers around R2, and a shot from another side"


def test_a_null_says_that_nothing_is_missing_and_ranks_nothing():
    words = text("NULL")

    assert "Nothing is missing that these records could show" in words
    assert "No effect was tried" in words
    assert "Evidence" not in figures("NULL")


def test_two_effects_are_told_one_after_the_other():
    found, summary = made("NAMED")
    both = replace(found.decision.fit, effects=(SLOW, DELAYS))
    found = replace(found, decision=replace(found.decision, fit=both))

    told = lead(found, summary | {"outcome": "COMPOSITE"})

    assert told.startswith("Two effects act together. The clock of receiver R2")
    assert "The holes of blast B1 did not fire at their planned times" in told


def test_a_joint_that_was_moved_is_told_where_it_is():
    moved = Effect("missing_joint", "x=50.0", ((-2.5,), (1e9,), (4e8,)))

    ((label, claim),) = claims(SimpleNamespace(effects=(moved,)))

    assert label == "missing_joint"
    assert claim.endswith("crosses it at plane x=47.5")


def test_what_is_left_beside_an_effect_is_said_with_its_place():
    found, summary = made("NAMED")
    left = replace(
        found.decision.fit, chi_square=np.full_like(found.decision.fit.chi_square, REMAINS)
    )
    found = replace(found, decision=replace(found.decision, fit=left, explained_share=0.5))
    point = {
        "x": 71.2,
        "y": 40.0,
        "z": -9.6,
        "within_m": 12.0,
        "joint": None,
        "nature": "soft",
        "in_pattern": True,
    }
    partial = summary | {
        "outcome": "PARTIAL",
        "remainder": summary["located"] | {"points": [point]},
    }

    said = lead(found, partial)
    place = "east 71 m, north 40 m, height -10 m (within 12 m, soft ground; uncertain: "
    place += "inside the blasted pattern)"
    assert f"But something else is missing near {place}, seen at" in said


@pytest.mark.parametrize(("outcome", "shown"), [("NAMED", 0), ("UNKNOWN", 1), ("NULL", 0)])
def test_the_terminal_says_of_what_the_evidence_is_where_no_effect_is_told(outcome, shown):
    told = "\n".join(diagnosis_lines({"finished": True, **made(outcome)[1]}))

    assert told.startswith(f"outcome: {outcome}")
    assert told.count("best candidate, not accepted: clock_error") == shown


def test_what_no_record_was_left_out_for_is_not_said_to_foretell():
    found, summary = made("NAMED")
    untested = {**summary["held_out"], "subsets": []}

    told = lead(found, summary | {"outcome": "PARTIAL", "held_out": untested})

    assert "no record can be held out" in told
    assert "predicts" not in told


def test_names_that_users_give_are_escaped():
    assert "pit &lt;3&gt;" in page("NULL")
    assert "pit <3>" not in page("NULL")


@pytest.mark.parametrize(
    ("value", "low", "high", "unit", "shown"),
    [
        (3e-3, 1e-3, 5e-3, "s", (3.0, 1.0, 5.0, "ms")),
        (3e5, 2e5, 4e5, "Pa", (0.3, 0.2, 0.4, "MPa")),
        (3e4, 2e4, 4e4, "Pa", (30.0, 20.0, 40.0, "kPa")),
        (np.pi / 2, 0.0, np.pi, "rad", (90.0, 0.0, 180.0, "°")),
        (-2.0, -3.0, -1.0, "m", (-2.0, -3.0, -1.0, "m")),
        (0.5, 0.4, 0.6, "", (0.5, 0.4, 0.6, "")),
    ],
)
def test_values_are_told_in_the_units_that_people_use(value, low, high, unit, shown):
    told = usual({"value": value, "low": low, "high": high, "unit": unit})

    assert [told[key] for key in ("value", "low", "high")] == pytest.approx(shown[:3])
    assert told["unit"] == shown[3]


def test_what_is_foretold_without_leaving_out_is_the_fit_itself():
    here, found = scene(), made("NAMED")[0].decision.fit
    nothing = np.zeros(found.chi_square.shape, dtype=bool)
    band = here.case.band

    motion = held_out_prediction(here, found, nothing)

    whole = band.restore(band.project(found.motion))
    assert np.max(np.abs(motion - whole)) < 0.02 * np.max(np.abs(whole))  # its last step


def test_what_is_left_out_is_foretold_as_well_as_its_fold_says():
    here, decision = scene(), made("NAMED")[0].decision
    case = here.case
    fold = next(one for one in decision.cross_validation.subsets if one.name == "B1")
    out = np.zeros(decision.fit.chi_square.shape, dtype=bool)
    out[case.blasts.index("B1")] = True

    held = held_out_prediction(here, decision.fit, out)
    left, heard = (case.band.project(case.residual(each))[out] for each in (held, 0.0))

    assert 1.0 - np.sum(left**2) / np.sum(heard**2) == pytest.approx(
        fold.variance_reduction_after, abs=1e-6
    )


def test_scores_are_listed_of_what_was_not_fitted():
    ranking = [{"labels": ["clock_error"]}]
    scores = {"clock_error": 40.0, "soft_surface_layer": 3.4, "topography": -1.8}

    rows = score_rows({"evidence": {"ranking": ranking, "scores": scores}})

    assert rows == ["soft_surface_layer (3)", "topography (-2)"]


LIMIT = {
    "label": "clock_error", "form": "", "target": "receiver", "parameter": "shift", "unit": "s",
    "per_hole": False, "null_value": 0.0, "value": 4e-3, "beside": {}, "not_detected_at": ["R3"],
}  # fmt: skip


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({}, "clock_error at any receiver: shift of 4 ms or more would have been detected, but not "
             "at R3."),
        ({"label": "missing_joint", "form": "parallel", "target": "plane", "parameter": "kn",
          "unit": "Pa/m", "null_value": None, "value": 3e9, "beside": {"ks": 1.2e9},
          "not_detected_at": []},
         "missing_joint (parallel) at any plane: kn of 3 GPa/m or less (with ks 1.2 GPa/m) would "
         "have been detected."),
        ({"label": "soft_surface_layer", "target": "site", "parameter": "slower", "unit": "",
          "null_value": 1.0, "value": 0.8, "not_detected_at": []},
         "soft_surface_layer: slower of 0.8 or less would have been detected."),
        ({"label": "sensor_orientation_or_polarity", "form": "turned", "parameter": "turn",
          "unit": "rad", "value": -0.26, "not_detected_at": []},
         "sensor_orientation_or_polarity (turned) at any receiver: turn of 15 ° or more would have "
         "been detected."),
        ({"value": None, "not_detected_at": []},
         "clock_error at any receiver: would not have been detected at any strength that was "
         "simulated."),
    ],
)  # fmt: skip
def test_a_detection_limit_is_a_sentence_in_the_unit_of_its_parameter(change, sentence):
    assert detection_limit_rows({"detection_limits": [LIMIT | change]}) == [sentence]


def test_forms_of_an_effect_are_one_statement_of_what_would_have_been_detected():
    alone, missed = (LIMIT | {"form": form, "value": value} for form, value in (
        (LIMIT["form"], LIMIT["value"]), ("holes", None)
    ))  # fmt: skip

    both = detection_limit_rows({"detection_limits": [missed, alone]})
    none = detection_limit_rows({"detection_limits": [missed, missed]})

    (seen,) = detection_limit_rows({"detection_limits": [alone]})
    assert both == [f"{seen[:-1]}, as holes at no strength that was simulated."]
    assert len(none) == 2


@pytest.mark.parametrize(
    ("deviation", "said"),
    [(3.4, "rock.cs lies more than 3 prior deviations off"), (0.4, "could not be fitted")],
)
def test_what_is_unknown_though_the_misfit_is_small_says_why(deviation, said):
    found, summary = made("UNKNOWN")
    evidence = summary["evidence"] | {"ranking": [], "scores": {"joint_slip": 4.0}}
    calibration = [{"parameter": "rock.cs", "factor": 1.07, "prior_deviation": deviation}]

    text = lead(found, summary | {"evidence": evidence, "calibration": calibration})

    assert said in text


def test_an_unknown_that_a_body_beats_says_by_how_much():
    found, summary = made("UNKNOWN")
    tested = {"improves": True, "subsets": [{}]}
    evidence = summary["evidence"] | {"ranking": [{}], "best_labels": ["clock_error"]}
    evidence |= {"open_set": 0.7}
    fails = ["a change of the rock at one place alone has the Δ ln evidence 90, clock_error 40"]

    said = lead(found, summary | {"held_out": tested, "evidence": evidence, "fails": fails})

    assert f"the cause is outside of the library: {fails[0]}" in said


def test_an_unknown_says_first_what_was_not_asked_and_how_its_residual_runs():
    found, summary = made("UNKNOWN")
    why = "the project has [air_blast], and every run has it"
    rows = [
        {"label": "air_blast", "targets": [], "reason": why},
        {"label": "side", "targets": [], "reason": "every side is a cut"},
        {"label": "missing_joint", "targets": ["x=50.0"], "reason": "too near"},
    ]
    shown = {
        "moveout": {"speed_m_per_s": 340.0, "low": 330.0, "high": 360.0, "azimuth_deg": None,
                    "coherence": 0.9},
        "polarisation": {"radial": 0.2, "transverse": 0.1, "vertical": 0.7}, "growth": 0.45,
    }  # fmt: skip
    summary = summary | {"not_testable": rows, "located": summary["located"] | shown}

    said = lead(found, summary)

    assert said.startswith(f"Not asked: air_blast ({why}). Something is missing")
    assert "from the blast over the receivers at 330 to 360 m/s, as a wave in air does" in said
    assert "70 % of its energy is vertical; its share grows with the charge to" in said
    lines = diagnosis_lines({"finished": True, **summary})
    assert lines[1] == f"  not asked: air_blast: {why}"


def test_the_best_of_cells_behind_one_another_is_shown_in_plan_and_in_section():
    cells = {"x": [10.0, 10.0, 50.0], "y": [20.0, 20.0, 20.0], "z": [-5.0, -25.0, -5.0],
             "score": [4.0, 60.0, -3.0]}  # fmt: skip
    point = {"x": 10.0, "y": 20.0, "z": -25.0, "within_m": 9.0}

    plan, section = rock_map(cells, small_site(), [point])["panels"]

    assert sorted(plan["marks"][0]["values"]) == [0.0, 60.0]
    assert sorted(section["marks"][0]["values"]) == [0.0, 4.0, 60.0]
    ends = [(each["x"]["label"], each["y"]["label"]) for each in (plan, section)]
    assert ends == [("east [m]", "north [m]"), ("east [m]", "height [m]")]
    assert (section["marks"][-1]["x"], section["marks"][-1]["y"]) == ([10.0], [-25.0])


@pytest.mark.parametrize("points", [0, 1])
def test_a_map_of_the_rock_says_where_or_that_no_place_is_given(points):
    found, summary = made("UNKNOWN")
    point = {
        "x": 71.2,
        "y": 40.0,
        "z": -9.6,
        "within_m": 12.0,
        "joint": "J1",
        "nature": None,
        "in_pattern": False,
    }
    cells = {"x": [10.0, 50.0], "y": [20.0, 20.0], "z": [-5.0, -5.0], "score": [4.0, 60.0]}
    look = summary["located"] | {"points": [point][:points], "cells": cells}

    shown = render_diagnosis(found, summary | {"located": look, "fails": ["a body says more"]})

    assert "A body says more." in shown
    assert "Where in the rock" in shown
    assert ("on joint J1 (within 12 m)" in shown) == bool(points)
    assert ("No place is given" in shown) != bool(points)
