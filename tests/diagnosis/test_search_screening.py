"""Screening: of two mirrored starts of an odd effect, the one that explains more."""

from dataclasses import replace

import numpy as np
from library_scene import library_of
from small_fits import fits
from small_site import recorded, scene_of, small_site

import pyblast.diagnosis.library  # noqa: F401  fills the library
from pyblast.diagnosis import search as module
from pyblast.diagnosis.fitting import fit
from pyblast.diagnosis.hypotheses import LIBRARY, Hypothesis
from pyblast.diagnosis.search import Search, screen

MOVED = "wrong_coordinates/blast"


def test_a_blast_that_was_elsewhere_is_screened_on_that_side_by_fewer_runs():
    moved = LIBRARY[MOVED].apply(small_site(), "B1", east=8.0, north=-8.0)
    scene = scene_of(recorded(small_site(), moved))
    search = Search(scene, 400, lambda *_: None, fit(scene, ()))
    before = scene.forward.runs

    with library_of([MOVED]):
        results = {result.effect.target: result for result in screen(search)}

    assert results["B1"].effect.values == ((6.0,), (-6.0,))
    assert results["B1"].share > 0.5
    assert set(results) == {"S1", "B1"}
    assert scene.forward.runs - before <= 6  # of eight starts
    assert np.isfinite([result.share for result in results.values()]).all()


def test_rivals_are_dropped_beside_a_testable_fit_that_leaves_nothing(monkeypatch):
    scene, none, slow, _, both = fits()
    search = Search(scene, 400, lambda *_: None, none, [both, slow])

    assert module._explains(search, both)
    assert not module._explains(search, none)
    monkeypatch.setattr(Hypothesis, "untestable", lambda *_: "there is one blast")
    assert not module._explains(search, both)


def test_rivals_are_kept_beside_a_fit_that_leaves_much():
    scene, none, _, _, both = fits()
    much = replace(both, chi_square=0.9 * none.chi_square)

    assert not module._explains(Search(scene, 400, lambda *_: None, none, [much]), much)
