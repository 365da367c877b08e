"""Rules of a decision by closed forms, without any simulation."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from pyblast.diagnosis import decision
from pyblast.diagnosis.cross_validation import CrossValidation, Subset
from pyblast.diagnosis.decision import (
    HALF_WIDTH,
    Decision,
    _probabilities,
    _rivals,
    _stands_out,
    beside_held_out,
    contradicted,
    more_remains,
    open_set_ratio,
    undecided,
    wide_covariance,
)
from pyblast.diagnosis.scores import SiteScores, _Limit, _limit_row, _scaled, main_blasts
from pyblast.diagnosis.thresholds import LEAD, MOST_EXPLAINED, REMAINS


def test_the_ends_of_an_interval_leave_a_twentieth_on_each_side():
    assert stats.norm.cdf(HALF_WIDTH) == pytest.approx(0.95, abs=1e-4)


@pytest.mark.parametrize(("share", "stands"), [(0.99, False), (1.01, True)])
def test_the_worst_of_four_receivers_stands_out_by_student_of_the_three_others(share, stands):
    least = (2.0 * 0.9875 - 1.0) / np.sqrt(2.0 * 0.9875 * 0.0125)  # 95 % of four, closed for three
    others = np.array([1.0, 1.5, 2.0])  # mean 1.5, deviation 0.5
    size = np.append(others, 1.5 + share * least * 0.5 * np.sqrt(1.0 + 1.0 / 3.0))
    effect = SimpleNamespace(
        label="clock", target="R3", hypothesis=SimpleNamespace(axis="blasts")
    )  # fmt: skip
    base = SimpleNamespace(chi_square=np.expm1(size)[None])
    names = ("R0", "R1", "R2", "R3")

    assert _stands_out(names, base, SimpleNamespace(effects=(effect,)), "clock") == stands


def test_records_of_many_blasts_count_as_one():
    covariance = np.array([[0.02, 0.01], [0.01, 0.05]])

    def wide(blasts):
        posterior = SimpleNamespace(covariance=covariance / blasts)
        return wide_covariance(
            SimpleNamespace(posterior=posterior, chi_square=np.ones((blasts, 4)))
        )  # fmt: skip

    np.testing.assert_allclose(wide(3), wide(1))
    np.testing.assert_allclose(wide(1), covariance)
    assert np.all(np.diag(wide(90)) <= 1.0)


def search_of(blasts, *evidences):
    """Return a search of fits with one label each, by their evidence over none."""
    levels = np.array([[0.01, 0.0], [0.02, -1.0], [0.2, -40.0]]) * np.array([1.0, blasts])
    none = SimpleNamespace(posterior=SimpleNamespace(evidences=levels), log_evidence=0.0)
    fits = [SimpleNamespace(labels=(f"L{n}",), gain=gain) for n, gain in enumerate(evidences)]
    case = SimpleNamespace(blasts=blasts * ("B",))
    return SimpleNamespace(
        without_effects=none, fits=fits, scene=SimpleNamespace(case=case),
        delta_ln_evidence=lambda fitted: fitted.gain,
    )  # fmt: skip


@pytest.mark.parametrize(("scores", "outcome"), [(None, "UNKNOWN"), ("some", "NULL")])
def test_records_that_can_test_no_effect_do_not_show_that_none_is_there(scores, outcome):
    search = search_of(1)
    search.scores, search.scored_beside = scores, lambda _: False
    search.scene.baseline = SimpleNamespace(sigma=np.ones(2))
    search.without_effects.values = np.zeros(2)
    search.without_effects.chi_square = np.ones((1, 1))

    assert undecided(search).outcome == outcome


def test_a_blast_that_is_fired_again_makes_no_answer_more_probable():
    once, thrice = search_of(1, 2.0, 1.5), search_of(3, 6.0, 4.5)

    first, second = _probabilities(once), _probabilities(thrice)

    assert sum(first.values()) == pytest.approx(1.0, abs=1e-3)
    assert first["L0"] / first["L1"] == pytest.approx(np.exp(0.5), rel=1e-3)
    assert second["L0"] / second["L1"] == pytest.approx(np.exp(0.5), rel=1e-3)


def test_a_rival_is_less_than_the_lead_behind():
    search = search_of(1, 50.0, 50.0 - 0.9 * LEAD, 50.0 - 1.1 * LEAD)

    assert _rivals(search, search.fits[0]) == ("L0", "L1")


@pytest.mark.parametrize(("free", "ratio"), [(40.0, 0.5), (5.0, None)])
def test_the_open_set_is_the_evidence_of_the_answer_over_that_of_sources_anywhere(
    monkeypatch, free, ratio
):
    monkeypatch.setattr(decision, "unrestricted", lambda *_: free)
    monkeypatch.setattr(decision, "sources_anywhere", lambda _: [])
    search = search_of(1, 20.0)
    search.required, search.without_effects.motion = 10.0, 0.0
    search.without_effects.values = 0.0
    search.scores = SimpleNamespace(
        residual=lambda *_: 0.0, at_fit=lambda _: SimpleNamespace(error=None)
    )

    assert open_set_ratio(search, search.fits[0]) == ratio


@pytest.mark.parametrize(("gains", "less", "against"), [
    ((), (), False), ((), ("blast B1",), True), ((9.0, 8.0), ("blast B1",), False),
    ((-9.0, 1.0), (), True),
])  # fmt: skip
def test_what_no_record_is_held_out_for_is_contradicted_by_a_large_blast(gains, less, against):
    subsets = tuple(Subset(f"R{n}", gain, 0.0, 0.0) for n, gain in enumerate(gains))

    assert contradicted(CrossValidation(subsets), less) == against


def held_out(before, after):
    found = Decision("NAMED", None, ("L0",), {}, 0.9, None)
    table = {"blasts": ["B9"], "explained_before": before, "explained_after": after}
    return beside_held_out(found, table)


def test_a_name_that_predicts_held_out_blasts_worse_is_partial():
    assert held_out(0.5, 0.8).outcome == "NAMED"
    assert held_out(0.8, 0.5).outcome == "PARTIAL"
    assert "50.0 % of the energy" in held_out(0.8, 0.5).fails[0]


def test_more_is_missing_where_much_remains_of_which_little_is_explained():
    much, little = np.full((2, 3), 1.1 * REMAINS), np.full((2, 3), 0.9 * REMAINS)

    assert more_remains(much, 0.9 * MOST_EXPLAINED)
    assert not more_remains(much, 1.1 * MOST_EXPLAINED)
    assert not more_remains(little, 0.9 * MOST_EXPLAINED)


def scores_of(labels, **scene):
    """Return scores of members with these labels."""
    members = tuple(SimpleNamespace(label=label) for label in labels)
    return SiteScores(SimpleNamespace(**scene), members, 1)


def test_a_class_of_equal_members_scores_as_each_and_one_of_two_half_as_probable():
    scores = scores_of(("a", "a", "b", "b"))

    by_class = scores.by_class(np.array([[7.0], [7.0], [7.0], [-1e6]]))

    assert by_class["a"][0] == pytest.approx(7.0)
    assert by_class["b"][0] == pytest.approx(7.0 - np.log(2.0))


def test_the_residual_at_the_prior_does_not_depend_on_what_is_calibrated():
    rng = np.random.default_rng(3)
    slopes, recorded = rng.normal(size=(2, 2, 4, 3, 5)), rng.normal(size=(2, 4, 3, 5))
    case = SimpleNamespace(
        band=SimpleNamespace(project=lambda x: x), residual=lambda motion: recorded - motion
    )
    scores = scores_of((), case=case, baseline=SimpleNamespace(slopes=slopes))

    moved = np.tensordot([0.3, -0.2], slopes, 1)

    np.testing.assert_allclose(scores.residual(moved, [0.3, -0.2]), recorded)


def test_the_smallest_and_the_largest_charge_score_what_acts_everywhere():
    assert main_blasts(SimpleNamespace(blasts=("S1", "B1", "B2"))) == (0, 2)
    assert main_blasts(SimpleNamespace(blasts=("S1",))) == (0,)


def test_a_limit_is_that_of_the_target_where_least_is_detected():
    far, near = _Limit(0.5, 1.5, ()), _Limit(0.1, 1.1, ())
    unseen = _Limit(np.inf, np.nan, ())

    row = _limit_row(
        "instrument_response/gain", "gain", {"R0": near, "R1": far, "R2": unseen}
    )  # fmt: skip

    assert (row["value"], row["not_detected_at"]) == (1.5, ["R2"])


@pytest.mark.parametrize("null", [0.0, 1.0, np.inf])
def test_a_strength_of_nothing_is_no_effect_and_one_of_one_what_was_simulated(null):
    parameter = SimpleNamespace(null=null)

    assert _scaled(parameter, 3.0, 1.0) == 3.0
    assert abs(_scaled(parameter, 3.0, 1e-9) - min(null, 3e9)) <= 1e-8 * max(1.0, min(null, 3e9))
