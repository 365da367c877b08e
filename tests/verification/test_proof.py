"""The proof: first answers stay, truths are sealed, counts add up, pieces go on."""

import json
import sys
import time

import numpy as np
import pytest
from scipy import stats
from small_site import recorded, small_site

from pyblast.diagnosis.thresholds import threshold_rows
from pyblast.errors import InputError
from verification.proof import answers, cases, page, registered
from verification.proof.answers import answer, answer_all, first_answers, next_key, versions
from verification.proof.cases import digest_of
from verification.proof.drawn import row_of, second_best
from verification.proof.predictions import predictions
from verification.proof.scores import (
    ENERGIES,
    TARGETS,
    alarm,
    clopper_pearson,
    confusion,
    gains,
    met,
    power,
    right,
    shares,
    wrong,
)
from verification.rows import program, read_rows

STUDY = """
import sys, time
from pathlib import Path
from verification.rows import each_row, program

path, seconds, name = sys.argv[1:]

def job(key):
    time.sleep(float(seconds) if name == "trial-001" else 0.0)
    return {"outcome": "NULL", "letter": name[-1]}

each_row(Path(path), [f"{name} {program()}"], job)
"""
NAMES = [f"trial-{number:03d}" for number in range(3)]
LATER = {"load", "date", "machine"}


def row(block="single", truth=("joint_slip",), outcome="NAMED", named=("joint_slip",), **more):
    return {"block": block, "truth": list(truth), "outcome": outcome, "named": list(named),
            "date": "2026-11-27"} | more  # fmt: skip


def null(outcome="NULL", named=()):
    return row("null", (), outcome, named)


def truth(label="missing_joint", target="x=60.0", **parameters):
    effects = [{"label": label, "family": "path", "target": target, "parameters": parameters}]
    return {"case": "case-000", "block": "single", "level": 1, "effects": effects}


def said(outcome="NAMED", label="missing_joint", target="x=50.0", **parameters):
    effects = [{"label": label, "target": target, "parameters": parameters}] if label else []
    return {"outcome": outcome, "effects": effects, "class": [], "model": {"effects": []}}


def interval(value, low, high):
    return {"value": value, "low": low, "high": high, "unit": ""}


def stub(path, seconds=0.0):
    return [sys.executable, "-c", STUDY, str(path), str(seconds)]


def test_the_first_answer_of_a_version_is_never_replaced(tmp_path):
    path, outcomes = tmp_path / "proof.json", iter(("NULL", "NAMED", "UNKNOWN"))

    def job(*_):
        return {"outcome": next(outcomes)}

    for again in (False, False, True, True):
        answer(path, "trial-000", again, job)

    rows = read_rows(path)
    assert first_answers(rows, program())["trial-000"]["outcome"] == "NULL"
    assert [rows[f"trial-000 {program()}{n}"]["outcome"] for n in ("", " 2", " 3")] == [
        "NULL", "NAMED", "UNKNOWN",
    ]  # fmt: skip


def test_answers_of_another_version_stand_beside(tmp_path):
    path = tmp_path / "proof.json"
    path.write_text(json.dumps({"trial-000 0123456789ab": {"outcome": "NAMED"}}))

    answer(path, "trial-000", job=lambda *_: {"outcome": "NULL"})

    rows = read_rows(path)
    assert first_answers(rows, "0123456789ab")["trial-000"]["outcome"] == "NAMED"
    assert first_answers(rows, program())["trial-000"]["outcome"] == "NULL"
    assert versions(rows | {f"trial-001 {program()}": {}}) == {program(): 2, "0123456789ab": 1}
    assert next_key(rows, "trial-001", program()) == f"trial-001 {program()}"


def test_a_crash_is_an_answer_and_a_refusal_is_none(tmp_path):
    def crash(*_):
        raise ZeroDivisionError("in the fit")

    def refuse(*_):
        raise InputError("noise: no recordings")

    answer(tmp_path / "proof.json", "trial-000", job=crash)
    with pytest.raises(SystemExit):
        answer(tmp_path / "proof.json", "trial-001", job=refuse)

    (only,) = read_rows(tmp_path / "proof.json").values()
    assert (only["outcome"], wrong(only), alarm(only)) == ("CRASH", True, True)
    assert "in the fit" in only["error"]


@pytest.mark.long
def test_a_piece_stops_at_its_minutes_and_goes_on(tmp_path):
    path, began = tmp_path / "proof.json", time.monotonic()
    left = answer_all(NAMES, 1, 8.0 / 60.0, stub(path, seconds=300.0))

    assert time.monotonic() - began < 60.0
    assert "trial-001" in left
    assert "trial-001" not in first_answers(read_rows(path), program())
    assert answer_all(left, 2, 5.0, stub(path)) == []
    assert list(first_answers(read_rows(path), program())) == NAMES


def test_two_jobs_give_the_rows_of_one(tmp_path):
    tables = []
    for jobs in (1, 2):
        path = tmp_path / f"{jobs}.json"
        assert answer_all(NAMES, jobs, 5.0, stub(path)) == []
        tables.append({key: {name: value for name, value in each.items() if name not in LATER}
                       for key, each in read_rows(path).items()})  # fmt: skip

    assert tables[0] == tables[1]
    assert len(tables[0]) == len(NAMES)


def test_the_counts_of_the_confusion_matrix_add_up():
    outcomes = ("NULL", "CLASS", "UNKNOWN", "MISTAKE", "PARTIAL", "CRASH")
    rows = [null(outcome) for outcome in outcomes]
    rows += [row(), row(named=("clock_error",)), row(outcome="UNKNOWN", named=())]
    rows += [row("two", ("joint_slip", "clock_error"), "COMPOSITE", ("clock_error", "joint_slip"))]
    truths, answered, counts = confusion(rows)

    assert counts.sum() == len(rows)
    assert counts[truths.index("nothing")].sum() == len(outcomes)
    assert set(outcomes) < set(answered)
    assert counts[truths.index("joint_slip"), answered.index("clock_error")] == 1
    both = "clock_error + joint_slip"
    assert counts[truths.index(both), answered.index(both)] == 1


@pytest.mark.parametrize(("hits", "count"), [(0, 60), (1, 60), (7, 12), (12, 12)])
def test_intervals_are_those_of_clopper_and_pearson(hits, count):
    exact = stats.binomtest(hits, count).proportion_ci(0.95, method="exact")
    assert clopper_pearson(hits, count) == pytest.approx((exact.low, exact.high), abs=1e-12)


@pytest.mark.parametrize("outcome", ["NAMED", "CLASS", "PARTIAL", "MISTAKE", "CRASH", "COMPOSITE"])
def test_whatever_is_claimed_on_a_null_is_an_alarm(outcome):
    assert alarm(null(outcome))
    assert not alarm(null("NULL"))
    assert not alarm(null("UNKNOWN"))


def test_a_body_is_no_wrong_name_of_a_void_and_is_one_of_noise():
    assert not wrong(row("outside", ("void",), named=("body",)))
    assert wrong(row("outside", ("hum",), named=("body",)))
    assert wrong(row("outside", ("void",), named=("body", "joint_slip")))


def test_a_crash_is_a_clear_effect_that_was_missed():
    crash = row(outcome="CRASH", named=())
    assert shares({"drawn-000": crash, "drawn-001": row(length=9.0)})["named"] == [False, True]


def test_the_present_version_is_shown_unless_another_has_twice_the_answers():
    assert page.shown({"old": 55, "now": 50}, "now") == "now"
    assert page.shown({"old": 55, "now": 20}, "now") == "old"
    assert page.shown({"old": 55}, "now") == "old"
    assert page.shown({}, "now") is None


def test_unseen_cases_are_those_that_no_other_version_answered():
    rows = {name: row() for name in (
        "drawn-000 aa", "drawn-001 aa", "site-01 aa", "drawn-001 bb")}  # fmt: skip
    assert list(page._unseen(rows, "aa", first_answers(rows, "aa"))) == ["drawn-000"]


@pytest.mark.parametrize(
    ("wanted", "target", "hit"),
    [("R05", "R05", True), ("R05", "R03", False), ("B2", "3 of blast B2", True), ("", "top", True),
     ("x=60.0", "x=47.0", True), ("x=60.0", "x=30.0", False), ("x=60.0", "y=60.0", False),
     ("R05", ["R05", "R03"], False)],
)  # fmt: skip
def test_a_right_name_is_placed_where_its_effect_is_and_nowhere_else(wanted, target, hit):
    answer = said(target=target)
    if not isinstance(target, str):
        answer["effects"][0]["parameters"] = {each: {} for each in target}
    assert row_of(truth(target=wanted), answer, {})["placed"] == [hit]


def test_mistakes_without_a_label_have_a_name():
    kinds = (("time zero", None), ("copy", None), ("delays", "delay_scatter"))
    mistakes = [{"kind": kind, "label": label, "target": "B2"} for kind, label in kinds]
    answer = said("MISTAKE", "") | {"mistakes": mistakes}
    named = row_of(truth("clock_error", "B2"), answer, {})["named"]
    assert named == ["clock_error", "copy", "delay_scatter"]


def test_a_target_is_not_answered_while_too_few_cases_are():
    target = TARGETS[0]
    assert met(target, [False] * (target.least - 1)) is None
    assert met(target, [False] * target.least) is True
    assert met(target, [True] * 2 + [False] * target.least) is False


def test_an_answer_is_right_if_it_names_all_and_nothing_else():
    two = {"block": "two", "truth": ("joint_slip", "clock_error")}
    assert right(row())
    assert not right(row(**two))
    assert not right(row(named=("joint_slip", "clock_error")))
    told = shares(
        {"site-01": row(**two), "drawn-000": row(length=9.0), "drawn-001": row(length=5.0)}
    )
    assert (told["both"], told["named"]) == ([False], [True])


def test_power_counts_each_single_effect_once():
    energies = (0.0, 0.02, 0.1, 0.2, 0.9)
    rows = [row(energy=energy) for energy in energies] + [row(energy=None), null()]
    table = power(rows)

    assert len(table["joint_slip"]) == len(ENERGIES) - 1
    assert sum(count for _, count in table["joint_slip"]) == len(energies)


def test_gains_are_those_of_cases_that_have_them():
    rows = [row(held_out={"before": 0.5, "after": 0.9, "second": 0.6}), row(held_out={}), null(),
            row(outcome="UNKNOWN", named=(), held_out={"before": 0.5, "after": 0.4}),
            row(outcome="MISTAKE", held_out={"before": 0.5, "after": 0.5})]  # fmt: skip
    assert gains(rows) == pytest.approx([0.4])
    assert gains(rows, "second") == pytest.approx([0.1])
    assert gains(rows, "right") == []


def test_what_has_no_row_is_not_answered(monkeypatch):
    monkeypatch.setattr(page, "registered", lambda: {"cases": {"site-01": "a", "drop-00": "b"}})
    monkeypatch.setattr(page, "changed_thresholds", list)
    text = page.page({}, None, {})

    assert "None of 2 registered cases is answered" in text
    for target in TARGETS:
        line = next(line for line in text.splitlines() if line.startswith(f"| {target.words} |"))
        assert line.endswith("| not answered | | 0 | too few cases | 0 of 0 |")


def test_the_page_has_a_row_for_each_version_and_a_last_row_for_all_effects(monkeypatch):
    monkeypatch.setattr(page, "registered", lambda: {"cases": {"drawn-01": "a", "drawn-02": "b"}})
    monkeypatch.setattr(page, "changed_thresholds", list)
    rows = {"drawn-01 aa": row(energy=0.3), "drawn-02 aa": row("two", named=("clock_error",)),
            "drawn-02 bb": null("NAMED", ("clock_error",))}  # fmt: skip
    text = page.page(rows, "aa", first_answers(rows, "aa"))

    assert "| `aa` | 2026-11-27 | 2 | 0 of 0 | 1 of 2 | 1 of 1 |" in text
    assert "| `bb` | 2026-11-27 | 1 | 1 of 1 | 1 of 1 | 0 of 0 |" in text
    assert "| all |  |  |  | 1 of 1 |  |" in text


def test_the_page_shows_each_first_answer_beside_the_others(monkeypatch):
    monkeypatch.setattr(page, "registered", lambda: {"cases": {"site-01": "a", "site-02": "b"}})
    monkeypatch.setattr(page, "changed_thresholds", list)
    rows = {"site-01 aa": null("CLASS"), "site-02 aa": row(energy=0.3), "site-01 aa 2": null(),
            "site-01 bb": null()}  # fmt: skip
    text = page.page(rows, "aa", first_answers(rows, "aa"))

    assert "| site-01 | nothing | CLASS | not answered | NULL (2×) |" in text
    alarms = "| false alarms on nulls | ≤ 2 % | 100 % | 2.5 % to 100.0 % | 1 of 60 needed |"
    assert f"{alarms} too few cases | 0 of 0 |" in text  # the authors knew these truths


def test_a_registered_truth_is_never_changed(tmp_path, monkeypatch):
    monkeypatch.setattr(registered, "FILE", tmp_path / "registered.json")
    monkeypatch.setattr(registered, "PAGE", tmp_path / "registration.md")
    registered.register([("drawn-000", {"effects": []})], False, 1)
    before = registered.registered()
    with pytest.raises(InputError, match="truths of drawn-000 are not those registered"):
        registered.register([("drawn-000", {"effects": ["joint_slip"]})], False, 1)
    monkeypatch.setattr(registered, "threshold_rows", tuple)
    registered.register([("drawn-001", {})], True, 2)

    after = registered.registered()
    assert after["cases"] == before["cases"] | {"drawn-001": digest_of({})}
    assert after["thresholds"] == before["thresholds"]  # a case was answered
    assert after["seed"] == 1


def test_a_case_whose_truth_has_changed_is_not_answered(tmp_path, monkeypatch):
    sealed = {"site-01": digest_of(b"null"), "site-02": digest_of(b"slip")}
    monkeypatch.setattr(registered, "registered", lambda: {"cases": sealed})
    monkeypatch.setattr(registered, "truth_of", lambda _: b"null")
    monkeypatch.setattr(answers, "checked", registered.checked)

    answer(tmp_path / "proof.json", "site-01", job=lambda *_: {})
    with pytest.raises(InputError, match="truth of site-02 is not the one that was registered"):
        answer(tmp_path / "proof.json", "site-02", job=lambda *_: {})
    with pytest.raises(InputError, match="site-03 is not registered"):
        answer(tmp_path / "proof.json", "site-03", job=lambda *_: {})
    assert list(read_rows(tmp_path / "proof.json")) == [f"site-01 {program()}"]


def test_the_registration_has_enough_cases_and_the_page_all_thresholds():
    table = registered.registered()
    count = {kind: sum(name.startswith(f"{kind}-") for name in table["cases"])
             for kind in registered.KINDS}  # fmt: skip
    assert count["site"] == 22
    assert count["flat"] == 12
    assert sum(count.values()) >= 120
    text = registered.PAGE.read_text(encoding="utf-8")
    assert text == registered.page(table)
    assert {each.name for each in threshold_rows()} <= {*table["thresholds"]} | set(
        line.split("`")[1] for line in registered.changed_thresholds()
    )


def test_thresholds_that_came_or_went_are_told(monkeypatch):
    kept = threshold_rows()[0]
    known = {"thresholds": {kept.name: kept.value, "GONE": 2.0}}
    monkeypatch.setattr(registered, "registered", lambda: known)
    told = registered.changed_thresholds()

    assert told[0] == "`GONE` 2 → none"
    assert len(told) == len(threshold_rows())
    assert all(" none → " in one for one in told[1:])


def test_digests_do_not_depend_on_the_last_digits_of_a_machine():
    assert digest_of({"kn": 1.0 / 3.0}) == digest_of({"kn": 1.0 / 3.0 + 1e-16})
    assert digest_of({"kn": 1.0}) != digest_of({"kn": 1.0 + 1e-6})


def test_intervals_are_held_against_the_truth():
    told = said(target="x=60.0", kn=interval(1e9, 5e8, 2e9), ks=interval(1e9, 8e8, 2e9))
    assert sorted(row_of(truth(kn=1.2e9, ks=3e8), told, {})["covered"]) == [False, True]


def test_values_of_a_joint_are_held_against_the_truth_at_the_plane_that_is_nearest():
    told = said(target="x=50.0", offset=interval(7.0, 0.0, 9.0), kn=interval(1e9, 5e8, 2e9))
    assert row_of(truth(kn=1.2e9), told, {})["covered"] == [True]  # 3 m off
    far = said(target="x=10.0", offset=interval(7.0, 0.0, 9.0), kn=interval(1e9, 5e8, 2e9))
    assert row_of(truth(kn=1.2e9), far, {})["covered"] == []


def test_a_plane_on_the_other_axis_has_no_distance():
    assert row_of(truth(), said(target="y=60.0"), {})["metres"] is None
    assert row_of(truth(), said(target="x=47.0"), {})["metres"] == 13.0


def test_shares_are_of_the_unseen_records_that_an_effect_reaches():
    before, after = {"blasts": 0.4, "receivers": 0.6}, {"blasts": 0.5, "receivers": 0.8}
    explained = {"before": before, "after": after}
    assert row_of(truth(), said(), explained)["held_out"] == {"before": 0.5, "after": 0.65}
    other = row_of(truth("clock_error", "R01"), said(), explained)
    assert other["held_out"] == {"before": 0.4, "after": 0.5}  # other blasts alone


def test_the_second_best_effect_has_other_labels_and_as_many():
    class Fit:
        def __init__(self, *labels):
            self.labels = labels

    slip, both, clock = Fit("slip"), Fit("slip", "clock"), Fit("clock")
    assert second_best([both, slip, clock], ("slip",)) is clock
    assert second_best([slip, clock], ()) is clock  # nothing was named: behind the best
    assert second_best([slip], ("slip",)) is None


def test_a_further_receiver_beside_a_known_one_is_predicted_the_same():
    case = recorded(small_site())
    asked = case.project.blasts["B1"], case.project.receivers[1].position

    told = predictions(case, asked, np.zeros(4), (), None)

    known = np.array(told["blast"][1])
    there = np.array(told["receiver"][told["blasts"].index("B1")])
    assert told["receivers"][1] == "R1"
    assert np.abs(known).max() > 1e-4
    assert np.abs(there - known).max() < 0.02 * np.abs(known).max()


def hits():
    """Return three hits at each of six places, with samples that tell receivers apart."""
    names = {f"G{n + 1:02d}": (2.0 * n, 0.0) for n in range(24)}
    samples = np.arange(1.0, 25.0)[:, None] * np.sin(np.arange(200) / 9.0)
    line = cases.example("real", "real_projects")
    return [
        line.ShotRecords(f"hit_{place}_{k + 1}", (place, 0.0), samples, 1e-3, -0.02, names)
        for place in range(6)
        for k in range(5)
    ]


def test_hits_of_a_trial_are_of_each_place_and_none_serves_twice():
    line = cases.example("real", "hammer_line")

    for trial in line.drawn():
        groups = [[hit.name for hit in group] for group in line.shots_of(trial["draw"], hits())]

        assert [len(group) for group in groups] == [6, 6, 6]
        assert len({name for group in groups for name in group}) == 18


def test_what_is_concealed_in_hits_is_at_the_receivers_said_and_nowhere_else():
    line = cases.example("real", "hammer_line")
    kinds = [trial["concealed"] for trial in line.drawn()]
    shots = hits()[:2]

    for trial in line.drawn():
        changed, targets = line.conceal(shots, trial)
        differ = {
            name
            for before, after in zip(shots, changed, strict=True)
            for name, own, other in zip(before.receivers, before.data, after.data, strict=True)
            if not np.array_equal(own, other, equal_nan=True) and np.isfinite(other).all()
        }

        assert differ == set(targets) or (trial["concealed"] == "loss" and len(differ) == 24)
        assert bool(differ) == bool(trial["label"])
    assert kinds.count(None) == 24
    assert len(kinds) == 64


def test_a_right_label_at_a_wrong_receiver_is_a_wrong_name():
    answer = said(label="clock_error", target="G05")

    assert cases.named_at(answer, ["G05"]) == ["clock_error"]
    assert cases.named_at(answer, ["G06"]) == ["clock_error at G05"]
    assert cases.named_at(answer | {"outcome": "UNKNOWN"}, ["G05"]) == []
