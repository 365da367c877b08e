"""What records can't test is said before any search, and is never named."""

import inspect
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from small_fits import LOUD, fits
from small_site import BAND, BEFORE, DT, SAMPLES, recorded, small_site, with_records

import pyblast.diagnosis.library  # noqa: F401  fills the library
from pyblast.diagnosis.case import case_of
from pyblast.diagnosis.decision import decide
from pyblast.diagnosis.effects import Effect
from pyblast.diagnosis.hypotheses import (
    LIBRARY,
    PRIORS,
    hypothesis,
    read_priors,
    untestable_labels,
)
from pyblast.diagnosis.search import Search
from pyblast.errors import InputError
from pyblast.model.material import ConstantQ
from pyblast.recordings.recording import Recording
from pyblast.signals.seismogram import Seismogram
from pyblast.workflows.diagnose import diagnose

DELAYS = Effect("delay_scatter", "B1", ((0.0, 0.0, 0.0),))
AMPLITUDE = {"joint_nonlinear_closure", "joint_slip"}
WITHOUT_TABLES = {
    "candidate", "side", "source_function",  # no suspects, body or point forces
    "damage_by_earlier_holes", "screening", "stemming", "second_deck",  # three holes in a row
}  # fmt: skip
HERE = "a hypothesis that the small site can't test stands in WITHOUT_TABLES or AMPLITUDE"


def heard(site):
    """Return a site with noise for records, no run, as a case."""
    rng, shape = np.random.default_rng(3), (BEFORE + SAMPLES, 3)
    records = {
        blast: {
            r.name: Recording(
                Seismogram(rng.normal(size=shape), DT, -BEFORE * DT),
                "", "", None, np.zeros(shape, dtype=bool),
            )
            for r in site.receivers
        }
        for blast in site.blasts
    }  # fmt: skip
    return case_of(with_records(site, records))


def with_blasts(*names):
    """Return the small site with some of its blasts."""
    site = small_site()
    return site.changed(blasts={name: site.blasts[name] for name in names})


def fading(project):
    """Return a project whose ground has quality factors."""
    law = ConstantQ.around(60.0, 40.0, BAND)
    return project.changed(
        materials={name: replace(one, law=law) for name, one in project.materials.items()}
    )


def test_each_table_of_priors_holds_the_arguments_of_its_hypothesis():
    for name, priors in PRIORS.items():
        arguments = inspect.signature(LIBRARY[name].apply).parameters

        assert LIBRARY[name].parameters == priors
        assert {one.name for one in priors} <= set(arguments), name
        assert all(one.low <= start <= one.high for one in priors for start in one.starts), name


@pytest.mark.parametrize(
    ("row", "told"),
    [
        ("mean = 1.0, sigma = 0.2, starts = [1.0], top = 3.0", "p: a.q: unknown key 'top'; known"),
        ("mean = 1.0, sigma = -0.2, starts = [1.0]", "p: a: q: sigma must be positive"),
        ("mean = 1.0, sigma = 0.2, starts = [1.0], low = 2.0, high = 1.0", "low must be below"),
        ("mean = 1.0, sigma = 0.2", "p: a.q: starts: missing"),
    ],
)
def test_a_prior_that_is_none_is_refused_with_its_place(tmp_path, row, told):
    (tmp_path / "p").write_text(f"[a]\nq = {{ {row} }}\n")

    with pytest.raises(InputError) as refused:
        read_priors(tmp_path / "p")
    assert told in str(refused.value)


def test_a_hypothesis_without_priors_is_refused():
    how = {"family": "path", "on": "site", "target": "site", "axis": "both"}

    with pytest.raises(InputError, match="hypothesis gust: give its parameters, or a table in"):
        hypothesis("gust", **how)


def test_charges_of_six_to_one_and_receivers_around_test_every_effect():
    assert untestable_labels(heard(small_site())).keys() == WITHOUT_TABLES, HERE


def test_known_quality_factors_are_not_asked_for():
    told = untestable_labels(heard(fading(small_site())))

    assert set(told) == {"attenuation_Q", "anisotropy", *WITHOUT_TABLES}
    assert "Qp 60 and Qs 40" in told["attenuation_Q"]


def test_one_blast_tests_nothing_that_grows_with_charge():
    told = untestable_labels(heard(with_blasts("B1")))

    assert {label for label, why in told.items() if "grows with charge" in why} == AMPLITUDE


def test_one_blast_tests_no_effect_of_a_receiver_alone():
    told = untestable_labels(heard(with_blasts("B1")))

    other = {one.label for one in LIBRARY.values() if one.axis != "blasts"}
    of_receivers = {one.label for one in LIBRARY.values()} - other
    assert {"instrument_response", "weak_coupling"} <= of_receivers
    alike = {"charge_exponent", "pulse_length"}  # all holes of that blast have one charge
    assert set(told) - AMPLITUDE == of_receivers | WITHOUT_TABLES | alike, HERE
    assert "one blast" in told["instrument_response"]
    assert LIBRARY["clock_error"].untestable(heard(with_blasts("B1")))
    assert not LIBRARY["clock_error/blast"].untestable(heard(with_blasts("B1")))


def test_charges_of_two_to_one_test_nothing_that_grows_with_charge():
    site = small_site()
    twice = replace(site.blasts["S1"], charge=np.array([30.0]))
    told = untestable_labels(heard(site.changed(blasts={**site.blasts, "S1": twice})))

    assert set(told) == AMPLITUDE | WITHOUT_TABLES
    assert "2 to one" in told["joint_slip"]


def test_receivers_in_one_line_with_the_holes_do_not_test_anisotropy():
    site = with_blasts("S1")
    line = [replace(r, position=(40.0 + 20.0 * n, 30.0, 0.0)) for n, r in enumerate(site.receivers)]
    told = untestable_labels(heard(site.changed(receivers=tuple(line))))

    assert told["anisotropy"].startswith("paths lie in 1 of 6 directions")


def test_a_site_without_joints_says_so():
    told = untestable_labels(heard(small_site().changed(joints=())))

    assert told["joint_viscous_fill"] == "this site has no joint to which it could apply"


def test_one_receiver_tests_nothing():
    site = small_site()
    told = untestable_labels(heard(site.changed(receivers=site.receivers[:1])))

    assert set(told) == {one.label for one in LIBRARY.values()}


@cache
def one_record():
    """Diagnose one record of one blast whose clock was ten samples slow."""
    site = with_blasts("S1")
    site = site.changed(receivers=site.receivers[2:3])
    case = recorded(site, change=lambda motion: np.roll(3.0 * motion, 10, axis=-1), fine=True)
    return diagnose(case.project).summary


@pytest.mark.long
def test_one_receiver_and_one_blast_name_nothing():
    found = one_record()

    assert found["outcome"] == "UNKNOWN"
    assert not found["effects"]
    assert {one.label for one in LIBRARY.values()} <= {o["label"] for o in found["not_testable"]}


def test_nothing_is_run_for_effects_where_none_can_be_tested():
    # plain run and nine around the receiver; calibration of four unknowns: 4 rounds at most
    mistakes, unknowns, holes = 1 + 9, 4, 1

    assert one_record()["evidence"]["ranking"] == []
    assert one_record()["runs"] <= mistakes + 1 + unknowns + 4 + holes


@pytest.mark.parametrize(("tried", "outcome"), [(2, "CLASS"), (1, "PARTIAL")])
def test_what_can_not_be_tested_is_never_named(monkeypatch, tried, outcome):
    untested = replace(LIBRARY[LOUD.name], needs=(lambda _: "charges are alike",))
    here, none, _, _, both = fits()
    behind = both.log_evidence - 20.0  # of what can be tested it would be no rival
    posterior = replace(both.posterior, log_evidence=behind)
    other = replace(both, effects=(both.effects[0], DELAYS), posterior=posterior)
    found = Search(here, lambda *_: None, none, [both, other][:tried], both)
    assert decide(found).outcome == "COMPOSITE"
    monkeypatch.setitem(LIBRARY, LOUD.name, untested)
    decision = decide(found)

    assert decision.outcome == outcome
    assert decision.rivals[2:] == (("delay_scatter",) if tried == 2 else ())
