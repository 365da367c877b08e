"""Mistakes put into the records of a small site are named with the act that mends them."""

from dataclasses import make_dataclass, replace
from functools import cache, partial
from types import SimpleNamespace

import numpy as np
import pytest
from small_site import DT, recorded, small_site, with_records

from pyblast.diagnosis.case import case_of
from pyblast.diagnosis.forward import simulation_of
from pyblast.diagnosis.mistakes import (
    COMPONENTS,
    Compared,
    Mistake,
    _copy,
    _of_blasts,
    _of_receivers,
    changed_records,
    mistakes_of,
    plainest_act,
)
from verification.mistakes import AT_A_RECEIVER, is_right, rewritten


@cache
def site():
    """Return the small site with records of its own run, and the motion of its reference."""
    case = recorded(small_site(), noise=0.003)
    return case.project, simulation_of(case).motion(case.project)


def found_in(project):
    """Return the mistakes that are named, and the project without them."""
    motion = site()[1]

    def simulate(case):
        simulation = simulation_of(case)
        run = simulation.motion

        def known(project, shots=None):  # of the reference
            sent = motion[: len(case.blasts), ..., : case.n_samples]
            return sent if shots is None else run(project, shots)

        simulation.motion = known
        return simulation

    return mistakes_of(project, simulate)


def same_records(one, other, but=1e-20):
    """Tell whether two projects have the same motion, but for a share of its energy."""
    here, there = case_of(one), case_of(other)
    wrong = here.in_band(here.motion) - there.in_band(there.motion)
    return np.sum(wrong**2) <= but * np.sum(there.motion**2)


def test_no_mistake_is_named_in_right_records():
    assert found_in(site()[0])[0] == []


@pytest.mark.parametrize("kind", [k for k in AT_A_RECEIVER if k not in ("acceleration",)])
def test_a_mistake_at_one_receiver_is_named_and_mended(kind):
    right, (named, act, change) = site()[0], AT_A_RECEIVER[kind]
    wrong = changed_records(right, partial(rewritten, change), "R2")

    mistakes, mended = found_in(wrong)

    assert [(m.kind, m.target) for m in mistakes] == [(named, "R2")]
    assert is_right({"kind": named, "target": "R2", "act": mistakes[0].act}, (named, "R2", act))
    assert same_records(mended, right, 0.02)


def test_exchanged_receivers_are_named_and_put_back():
    right = site()[0]
    tables = right.survey.recordings
    for table in tables.values():
        table["R0"], table["R3"] = table["R3"], table["R0"]

    (mistake,), mended = found_in(with_records(right, tables))

    assert (mistake.kind, mistake.target) == ("receivers", "R0 and R3")
    assert same_records(mended, right)


def test_a_wrong_time_zero_of_a_blast_is_named_and_corrected():
    right = site()[0]

    def moved(one):
        return replace(one, seismogram=one.seismogram.shifted(8 * DT))

    (mistake,), mended = found_in(changed_records(right, moved, blast="B1"))

    assert (mistake.kind, mistake.target) == ("time zero", "B1")
    assert mistake.act.endswith("32 ms late")
    assert same_records(mended, right, 1e-6)


def test_the_records_of_another_blast_are_known_for_a_copy():
    right = site()[0]
    tables = right.survey.recordings

    mistakes, mended = found_in(with_records(right, tables | {"B1": tables["S1"]}))

    assert (mistakes[0].kind, mistakes[0].target) == ("copy", "B1")
    assert mended.blasts.keys() == {"S1"}


def test_two_mistakes_are_both_named():
    right = site()[0]
    wrong = changed_records(right, partial(rewritten, lambda v, _: -v), "R1")
    wrong = changed_records(wrong, partial(rewritten, lambda v, _: 1e3 * v), "R3")

    mistakes, mended = found_in(wrong)

    assert sorted((m.kind, m.target) for m in mistakes) == [("components", "R1"), ("unit", "R3")]
    assert same_records(mended, right)


@pytest.mark.parametrize(("plan", "kind"), [("delays", "delays"), ("place", "place")])
def test_a_wrong_plan_of_a_blast_is_named_by_runs_of_others(plan, kind):
    right = site()[0]
    own = right.blasts["B1"]
    by = np.array([0.0, 20.0, 0.0])
    wrong = {
        "delays": replace(own, times=own.times.max() - own.times),
        "place": replace(own, collar=own.collar + by, toe=own.toe + by),
    }[plan]

    mistakes, mended = mistakes_of(
        right.changed(blasts=right.blasts | {"B1": wrong}), simulation_of
    )

    assert [(m.kind, m.target) for m in mistakes] == [(kind, "B1")]
    there = mended.blasts["B1"]
    np.testing.assert_allclose(there.times, own.times)
    np.testing.assert_allclose(there.collar, own.collar, atol=1.0)


def offered(target, act, after):
    return Mistake("components", target, act, 0.5, after, lambda project: project)


def test_the_act_that_mends_most_is_named_unless_another_mends_nearly_as_well():
    swap, turn = offered("R1", "swap", 0.98), offered("R1", "turn", 0.9)
    nearly, other = offered("R1", "reverse", 0.975), offered("R2", "swap", 0.976)

    assert plainest_act([turn, swap]) is swap
    assert plainest_act([turn, swap, other]) is swap
    assert plainest_act([nearly, swap]) is None
    assert plainest_act([nearly, swap, other]) is other
    assert plainest_act([]) is None


N, BLASTS, RECEIVERS = 240, ("S1", "B1", "B2"), ("R0", "R1", "R2", "R3", "R4")
Motion = make_dataclass("Motion", ["velocity", "dt", "start"])
Record = make_dataclass("Record", ["seismogram", "clipped"])
Ground = make_dataclass("Ground", ["survey"])


def pulses():
    """Return pulses of other frequencies and shapes in each channel, (3, 5, 3, N)."""
    late = DT * np.arange(N) - 0.4
    turns = np.random.default_rng(2).uniform(0.0, 2.0 * np.pi, (3, 5, 3, 1))
    rate = 8.0 + np.arange(15.0).reshape(1, 5, 3, 1) % 7
    return np.exp(-0.5 * (late / 0.08) ** 2) * np.cos(2.0 * np.pi * rate * late + turns)


def compared(recorded, simulated=None):
    """Return the comparison of records, with their own motion by default."""
    band = SimpleNamespace(low=4.0, high=25.0, dt=DT, basis=np.eye(N))
    case = SimpleNamespace(
        blasts=BLASTS, receivers=RECEIVERS, band=band, dt=DT, n_samples=N, motion=recorded,
        valid=np.ones(recorded.shape, dtype=bool),
    )  # fmt: skip
    axes = dict.fromkeys(RECEIVERS, (None, COMPONENTS))
    return Compared(case, recorded, pulses() if simulated is None else simulated, axes)


def mended(mistake, motion, blast, receiver):
    """Return velocity (3, N) and start of a record after the act of a mistake."""
    record = Record(Motion(motion.T, DT, 0.0), np.zeros((N, 3), bool))
    survey = SimpleNamespace(edited=lambda act: act(blast, {receiver: record})[receiver])
    after = mistake.mended(Ground(survey)).survey.seismogram
    return after.velocity.T, after.start


@pytest.mark.parametrize("factor", [1e3, 1e-3, 25.4])
def test_records_in_another_unit_are_divided_by_its_factor(factor):
    recorded = pulses()
    recorded[:, 2] *= factor

    (mistake,) = _of_receivers(compared(recorded))

    assert (mistake.kind, mistake.target) == ("unit", "R2")
    velocity, _ = mended(mistake, recorded[1, 2], "B1", "R2")
    np.testing.assert_allclose(velocity, pulses()[1, 2])


@pytest.mark.parametrize("factor", [5e4, 3e-6])
def test_a_factor_far_from_that_of_any_unit_is_none(factor):
    recorded = pulses()
    recorded[:, 2] *= factor

    assert list(_of_receivers(compared(recorded))) == []


def test_horizontals_that_are_turned_are_turned_back():
    recorded = pulses()
    east, north = recorded[:, 2, 0].copy(), recorded[:, 2, 1].copy()
    recorded[:, 2, 0], recorded[:, 2, 1] = 0.8 * east - 0.6 * north, 0.8 * north + 0.6 * east

    turned = [m for m in _of_receivers(compared(recorded)) if m.kind == "turned"]

    velocity, _ = mended(turned[0], recorded[1, 2], "B1", "R2")
    assert turned[0].after == pytest.approx(1.0, abs=1e-3)
    np.testing.assert_allclose(velocity, pulses()[1, 2], atol=0.03)


def test_a_late_blast_is_moved_by_what_others_are_not_late():
    recorded = np.roll(pulses(), 1, axis=-1)  # as faster ground in the reference does
    recorded[1] = np.roll(recorded[1], 8, axis=-1)

    (mistake,) = _of_blasts(compared(recorded))

    assert (mistake.target, mended(mistake, recorded[1, 0], "B1", "R0")[1]) == ("B1", -8 * DT)


def test_of_two_equal_records_those_are_the_copy_that_do_not_fit():
    recorded = pulses()
    recorded[2] = recorded[0]

    assert _copy(compared(recorded)).target == "B2"
    assert _copy(compared(pulses())) is None


def test_an_act_that_makes_one_blast_worse_mends_nothing():
    pair = compared(pulses())

    assert pair.accepts([0.2, 0.9], [0.999, 0.95])
    assert not pair.accepts([0.2, 0.96], [0.999, 0.95])
