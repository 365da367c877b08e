"""What grows with charge is fitted anew from the best place around its first fit."""

from contextlib import nullcontext
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import pyblast.diagnosis.library  # noqa: F401  fills the library
from pyblast.diagnosis import search as module
from pyblast.diagnosis.decision import intervals
from pyblast.diagnosis.effects import Effect
from pyblast.diagnosis.fitting import Fit
from pyblast.diagnosis.search import Search

SLIP = Effect("joint_slip", "J1", ((5e4,), (1.0,)))
TRUE = ("joint_slip/frictional", 8e4, 0.88)  # form, strength, residual


def fitted(effect, worth):
    knobs = effect.hypothesis.parameters
    place = [knob.standardised(value) for knob, (value,) in zip(knobs, effect.values, strict=True)]
    return Fit(
        (effect,), np.zeros(0), 0.01 * np.eye(len(place)), None, np.array(place), None,
        np.ones((1, 1)), 0.0, worth,
    )  # fmt: skip


def far(effect):
    """Return how far a form of slip is from the true one, as a misfit."""
    (strength,), (residual,) = effect.values
    other = effect.name != TRUE[0]
    return abs(np.log(strength / TRUE[1])) + abs(residual - TRUE[2]) + other


def looked(monkeypatch, effect, refit, explains=False):
    """Return the search after it looked around one fit of worth 20, and where it fitted anew."""
    monkeypatch.setattr(module, "_explains", lambda *_: explains)
    asked = []
    scene = SimpleNamespace(
        case=SimpleNamespace(project=SimpleNamespace(joints=[])), simulate=lambda *_: None,
        forward=SimpleNamespace(runs=0), contained=lambda _: nullcontext(),
    )  # fmt: skip
    none = SimpleNamespace(log_evidence=0.0, values=np.zeros(2))
    found = Search(scene, 100, lambda *_: None, none, [fitted(effect, 20.0)])
    found.screening = [SimpleNamespace(effect=effect, blasts=(0, 2))]
    monkeypatch.setattr(Search, "delta_ln_evidence", lambda _, one: one.log_evidence)
    monkeypatch.setattr(module, "fit_partly", lambda _, effects, *__: (far(effects[0]), None))

    def fit(_, effects, home, blasts, held):
        asked.append((effects[0], blasts))
        assert (tuple(home), held) == ((0.0, 0.0), none)
        return None if refit is None else fitted(effects[0], refit)

    monkeypatch.setattr(module, "fit", fit)
    module._refit_around_leaders(found)
    return found, asked


def test_slip_is_fitted_anew_from_the_best_place_of_any_form(monkeypatch):
    found, ((best, blasts),) = looked(monkeypatch, SLIP, 30.0)

    assert best.name == "joint_slip/frictional"
    assert best.values[0][0] == pytest.approx(5e4 * np.exp(0.6))  # the nearest that was looked at
    assert best.values[1][0] == pytest.approx(0.88)
    assert blasts == (0, 2)
    assert [one.effects[0] for one in found.leaders()] == [best]


def test_places_where_an_effect_can_not_be_are_not_looked_at(monkeypatch):
    strong = Effect("joint_slip", "J1", ((9e6,), (1.0,)))

    _, ((best, _),) = looked(monkeypatch, strong, 30.0)

    assert best.values[0][0] < 1e7
    assert best.values[1][0] <= 1.0


def test_a_leader_alone_that_explains_all_is_not_fitted_again(monkeypatch):
    assert looked(monkeypatch, SLIP, 30.0, explains=True)[1] == []


def test_what_is_linear_is_fitted_once(monkeypatch):
    fill = Effect("joint_viscous_fill", "J1", ((2e-3,),))

    assert looked(monkeypatch, fill, 30.0)[1] == []


@pytest.mark.parametrize("refit", [10.0, None])
def test_the_better_of_two_fits_of_the_same_effects_is_kept(monkeypatch, refit):
    monkeypatch.setitem(globals(), "TRUE", ("joint_slip", 5e4, 1.0))

    found, _ = looked(monkeypatch, SLIP, refit)

    assert [one.log_evidence for one in found.fits] == [20.0]


@pytest.mark.parametrize(
    ("form", "refit", "reaches"),
    [("joint_slip", 22.0, True), ("joint_slip", 30.0, False), (TRUE[0], 22.0, False)],
)
def test_an_interval_reaches_over_fits_of_one_form_that_records_can_not_tell_apart(
    monkeypatch, form, refit, reaches
):
    monkeypatch.setitem(globals(), "TRUE", (form, *TRUE[1:]))
    found, _ = looked(monkeypatch, SLIP, refit)
    (best,) = found.leaders()
    (own,) = intervals(replace(best, alternatives=()))
    (first,) = intervals(fitted(SLIP, 20.0))

    (said,) = intervals(best)

    assert best.log_evidence == refit
    assert own["strength"]["low"] > first["strength"]["low"]
    assert own["residual"]["high"] < first["residual"]["high"]
    assert said["strength"]["low"] == (first if reaches else own)["strength"]["low"]
    assert said["strength"]["high"] == own["strength"]["high"]
    assert said["residual"]["high"] == (first if reaches else own)["residual"]["high"]


def test_what_has_one_value_for_each_hole_is_fitted_once(monkeypatch):
    scatter = Effect("delay_scatter", "B1", ((0.001, -0.002, 0.0),))
    monkeypatch.setitem(globals(), "fitted", lambda effect, worth: SimpleNamespace(
        effects=(effect,), labels=(effect.label,), log_evidence=worth,
    ))  # fmt: skip

    found, asked = looked(monkeypatch, scatter, 30.0)

    assert asked == []
    assert [one.effects for one in found.fits] == [(scatter,)]
