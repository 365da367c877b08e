"""Screening: of two mirrored starts of an odd effect, the one that explains more."""

import numpy as np
from small_site import recorded, scene_of, small_site

import pyblast.diagnosis.library  # noqa: F401  fills the library
from pyblast.diagnosis.fitting import fit
from pyblast.diagnosis.hypotheses import LIBRARY
from pyblast.diagnosis.search import Search, screen

MOVED = "wrong_coordinates/blast"


def test_a_blast_that_was_elsewhere_is_screened_on_that_side_by_fewer_runs(monkeypatch):
    for name in [name for name in LIBRARY if name != MOVED]:
        monkeypatch.delitem(LIBRARY, name)
    moved = LIBRARY[MOVED].apply(small_site(), "B1", east=8.0, north=-8.0)
    scene = scene_of(recorded(small_site(), moved))
    search = Search(scene, 400, lambda *_: None, fit(scene, ()))
    before = scene.forward.runs

    results = {result.effect.target: result for result in screen(search)}

    assert results["B1"].effect.values == ((6.0,), (-6.0,))
    assert results["B1"].share > 0.5
    assert set(results) == {"S1", "B1"}
    assert scene.forward.runs - before <= 6  # of eight starts
    assert np.isfinite([result.share for result in results.values()]).all()
