"""A diagnosis of a small site with effects that need no runs: named, or not, and on what."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from library_scene import library_of
from small_site import DT, recorded, small_site

from pyblast.diagnosis import decision
from pyblast.diagnosis.hypotheses import LIBRARY
from pyblast.inference.parameter import set_all
from pyblast.project.uncertain_ground import factors_of
from pyblast.workflows.diagnose import diagnose

TRUE = np.array([0.02, -0.02, 0.2, -0.15])
MOVED = LIBRARY["wrong_coordinates/blast"]


@pytest.fixture(autouse=True)
def no_runs():
    """Leave only effects that need no runs in the library."""
    moved = "wrong_coordinates"
    with library_of([k for k, one in LIBRARY.items() if one.on != "site" and one.label != moved]):
        yield


@cache
def found(change=None, correct=False):
    """Diagnose the small site with other values and one change of its records."""
    true = set_all(small_site(), factors_of(small_site()), np.exp(TRUE))
    case = recorded(small_site(), true, change=change, fine=True)
    return diagnose(case.project, seed=3, correct=correct).summary


def late(motion):
    """Let the clock of R2 be five samples slow."""
    motion = motion.copy()
    motion[:, 2] = np.roll(motion[:, 2], 5, axis=-1)
    return motion


def flipped(motion):
    """Turn the north component of R1 round."""
    motion = motion.copy()
    motion[:, 1, 1] *= -1.0
    return motion


def humming(motion):
    """Let a machine start in the middle of each record, in another phase at each receiver."""
    motion, times = motion.copy(), np.arange(motion.shape[-1]) * DT
    for r in range(motion.shape[1]):
        hum = np.sin(2.0 * np.pi * 11.0 * times + r) * (times > 0.12)
        motion[:, r] += np.abs(motion[:, r]).max() * hum
    return motion


def test_nothing_is_named_where_nothing_is_hidden():
    assert found()["outcome"] == "NULL"
    assert not found()["effects"]


@pytest.mark.long
def test_a_slow_clock_is_named_at_its_receiver_with_its_shift():
    one = found(late)
    assert one["outcome"] == "NAMED"
    effect = one["effects"][0]
    assert (effect["label"], effect["target"]) == ("clock_error", "R2")
    shift = effect["parameters"]["shift"]
    assert shift["value"] == pytest.approx(5 * DT, abs=1e-3)
    assert shift["low"] < shift["value"] < shift["high"]


def test_a_component_the_wrong_way_round_is_said_before_any_ground_is_judged():
    one = found(flipped)
    assert one["outcome"] == "MISTAKE"
    assert not one["effects"]
    assert [row["act"] for row in one["mistakes"]] == ["reverse north at R1"]
    assert one["runs"] == 8  # of two blasts: as it is, mended, around receivers, for the page


@pytest.mark.long
def test_a_mistake_is_mended_when_asked_and_the_site_judged():
    one = found(flipped, correct=True)
    assert one["outcome"] == "NULL"
    assert [row["target"] for row in one["mistakes"]] == ["R1"]


@pytest.mark.long
def test_what_no_hypothesis_explains_is_unknown_and_located():
    one = found(humming)
    assert one["outcome"] in ("UNKNOWN", "PARTIAL")
    assert not any(effect["named"] for effect in one["effects"])
    low, high = one["located"]["frequency_hz"]
    assert low < 11.0 < high
    assert one["located"]["time_s"][0] > 0.1


def test_what_is_named_foretells_records_that_were_left_out():
    proof = found(late)["held_out"]
    assert proof["improves"]
    assert proof["variance_reduction_after"] > proof["variance_reduction_before"]
    assert {fold["name"] for fold in proof["subsets"]} == {"S1", "B1"}


@pytest.mark.long
def test_one_silent_hole_is_a_misfire_of_that_hole_and_not_of_all_charges():
    site = small_site()
    silent = replace(site.blasts["B1"], charge=np.array([60.0, 1e-6, 60.0]))
    true = set_all(site, factors_of(site), np.exp(TRUE))
    case = recorded(site, true.changed(blasts={**site.blasts, "B1": silent}), fine=True)
    made = diagnose(case.project, seed=3)

    assert made.summary["outcome"] == "NAMED"
    (effect,) = made.summary["effects"]
    assert (effect["label"], effect["target"]) == ("misfire_or_charge_error", "B1")
    assert effect["parameters"]["hole"] == "2"
    assert effect["parameters"]["radiated"]["value"] < 0.2
    (free,) = (f for f in made.search.fits if f.effects[0].name.endswith("/holes"))
    (one,) = (f for f in made.search.fits if f.effects[0].name.endswith("/misfire"))
    assert made.search.delta_ln_evidence(one) > made.search.delta_ln_evidence(free)


@pytest.mark.long
def test_a_diagnosis_is_the_same_each_time():
    first = {k: v for k, v in found(late).items() if k != "wall_s"}
    found.cache_clear()
    assert {k: v for k, v in found(late).items() if k != "wall_s"} == first


@pytest.mark.long
def test_a_finer_mesh_corrects_all_runs_and_the_answer(monkeypatch):
    monkeypatch.setitem(LIBRARY, MOVED.name, MOVED)
    monkeypatch.setattr(decision, "MESH_CHANGE", 0.25)  # receivers near sources stay out since D38
    site = small_site()
    layers = [
        one.model_copy(update={"edge_m": 1.5 * one.edge_m}) for one in site.config.mesh.layers
    ]
    coarse = {"kind": "hexahedra", "order": 3, "accuracy": 0.1, "layers": layers}  # as files may
    site = site.changed(mesh=site.config.mesh.model_copy(update=coarse))
    true = set_all(site, factors_of(site), np.exp(TRUE))
    moved = MOVED.apply(true, "B1", east=8.0, north=-8.0)
    case = recorded(site, moved, fine=True)

    told = diagnose(case.project, seed=3).summary

    assert told["outcome"] == "NAMED"
    assert told["mesh_error"]["energy_share"] > 0.005
    assert told["mesh_error"]["chi_square_of_answer"] > 0.25
    (effect,) = told["effects"]
    assert effect["label"] == "wrong_coordinates"
    assert effect["parameters"]["east"]["value"] == pytest.approx(8.0, abs=1.5)
    assert effect["parameters"]["north"]["value"] == pytest.approx(-8.0, abs=1.5)
