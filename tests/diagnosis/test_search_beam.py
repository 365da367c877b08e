"""Sets of effects that the records can't tell apart grow side by side."""

from types import SimpleNamespace

import numpy as np
import pytest

import pyblast.diagnosis.library  # noqa: F401  fills the library
from pyblast.diagnosis import search as module
from pyblast.diagnosis.search import BEAM, Search

OPEN = np.full((2, 3), 9.0)  # sizes of residuals with much left


def made(worth, *labels):
    """Return a fit of effects, of some evidence, that leaves much."""
    return SimpleNamespace(labels=labels, effects=(), log_evidence=worth, chi_square=OPEN)


def searched(monkeypatch, first, further):
    """Return what is chosen where single fits are as given, and further ones by their first."""
    none, asked = made(0.0), []
    found = Search(None, lambda *_: None, none, chosen=none)

    def quick(found, base):
        asked.append(base.labels)
        found.fits += further.get(base.labels[-1], []) if base.labels else first

    monkeypatch.setattr(module, "_refit", quick)
    return module.grown(found).chosen.labels, asked


@pytest.mark.parametrize(("second", "chosen"), [(17.0, ("b", "d")), (13.0, ("a", "c"))])
def test_the_second_of_two_that_can_not_be_told_apart_goes_on_too(monkeypatch, second, chosen):
    first = [made(20.0, "a"), made(second, "b")]
    further = {"a": [made(30.0, "a", "c")], "b": [made(45.0, "b", "d")]}

    assert searched(monkeypatch, first, further)[0] == chosen


def test_what_is_below_the_threshold_alone_goes_nowhere(monkeypatch):
    first = [made(8.0, "a"), made(5.0, "b")]

    assert searched(monkeypatch, first, {})[1] == [()]


def test_leaders_are_few_and_of_other_labels_each():
    fits = [made(19.0, "b"), made(20.0, "a"), made(18.0, "a"), made(17.0, "c"), made(9.0, "d")]
    found = Search(None, None, made(0.0), fits)

    assert [one.labels for one in found.leaders()] == [("a",), ("b",)][:BEAM]


@pytest.mark.parametrize("worse", [(), ("a large blast",)])
def test_other_forms_are_fitted_while_a_large_blast_is_explained_less(monkeypatch, worse):
    slips = [SimpleNamespace(name=name, label="slip") for name in ("slip", "deep", "deep", "rough")]
    scores = SimpleNamespace(other_forms=lambda *_: [(form, 9.0) for form in slips[1:]])
    found, fitted = Search(None, None, made(0.0), scores=scores), []
    found.runs_left = lambda: True

    def fit(search, _base, effect, _score):
        fitted.append(effect.name)
        search.fits.append(made(float(len(fitted)), "slip"))

    monkeypatch.setattr(module, "_fit_by_runs", fit)
    monkeypatch.setattr(module, "not_improved", lambda *_: worse if len(fitted) < 3 else ())

    module._fit_forms(found, found.without_effects, slips[0], 10.0)

    assert fitted == (["slip", "deep", "rough"] if worse else ["slip"])
