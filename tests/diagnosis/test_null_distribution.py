"""The smallest visible effect: a little more is seen, a little less is not."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy import fft
from small_site import DT, recorded, scene_of, small_site

import pyblast.diagnosis.library  # noqa: F401  fills the library
from pyblast.diagnosis.effects import Effect
from pyblast.diagnosis.fitting import fit
from pyblast.diagnosis.null_distribution import detection_limits
from pyblast.diagnosis.search import Search, material
from pyblast.diagnosis.thresholds import DECISIVE
from pyblast.report.diagnosis import detection_limit_rows


@cache
def told():
    """Return what a site without effects would have shown, by label, form and knob."""
    here = scene_of(recorded(small_site()))
    return {
        (v["label"], v["form"], v["parameter"]): v for v in detection_limits(here, fit(here, ()))
    }


def late(shift):
    """Return a change of records that makes the clock of R2 late."""

    def change(motion):
        spectrum = fft.rfft(motion[:, 2], 256)
        turned = np.exp(-2j * np.pi * fft.rfftfreq(256, DT) * shift)
        motion = motion.copy()
        motion[:, 2] = fft.irfft(spectrum * turned, 256)[..., : motion.shape[-1]]
        return motion

    return change


@pytest.mark.parametrize(("share", "seen"), [(1.4, True), (0.6, False)])
def test_a_clock_error_is_seen_above_the_amount_and_not_below(share, seen):
    shift = share * told()["clock_error", "", "shift"]["amount"]
    here = scene_of(recorded(small_site(), change=late(shift)))
    none, slow = fit(here, ()), fit(here, (Effect("clock_error", "R2", ((0.0,),)),))
    found = Search(here, 400, lambda *_: None, none)

    assert (material(none.chi_square) and found.delta_ln_evidence(slow) >= DECISIVE) == seen


def test_amounts_are_small_and_of_knobs_that_need_no_runs():
    amounts = {key: one["amount"] for key, one in told().items()}

    assert 1e-3 < amounts["clock_error", "", "shift"] < 10e-3
    assert 0.05 < amounts["instrument_response", "gain", "gain"] < 0.5
    assert ("wrong_coordinates", "receiver", "east") not in amounts
    assert not any(label.startswith("joint") for label, _, _ in amounts)


def test_a_logged_dud_does_not_hide_the_delays_of_other_holes():
    site, charge = small_site(), np.array([60.0, 0.0, 60.0])
    dud = replace(site.blasts["B1"], charge=charge)
    here = scene_of(recorded(site.changed(blasts={**site.blasts, "B1": dud}), noise=3e-4))
    here.holes["B1"] *= 3.0 * (charge > 0.0)[:, None, None, None]  # loud enough to be seen
    (delays,) = (
        v for v in detection_limits(here, fit(here, ()), -20.0) if v["parameter"] == "delays"
    )

    assert 0.0 < delays["amount"] < 0.02
    assert delays["not_detected_at"] == []


def test_nothing_is_said_beside_what_is_not_explained():
    here = scene_of(recorded(small_site(), change=late(0.05)))

    assert detection_limits(here, fit(here, ())) == []


def test_words_name_the_amount_with_its_unit():
    one = {
        "label": "clock_error", "form": "", "target": "receiver", "parameter": "shift", "unit": "s",
        "per_hole": False, "null_value": 0.0, "amount": 4e-3, "not_detected_at": ["R3"],
    }  # fmt: skip
    gain = one | {
        "parameter": "gain",
        "unit": "",
        "null_value": 1.0,
        "amount": 0.2,
        "not_detected_at": [],
    }

    assert detection_limit_rows({"detection_limits": [one, gain]}) == [
        "clock_error: an error of shift of any receiver by 4 ms or more would have been detected, "
        "but not at R3.",
        "clock_error: an error of gain of any receiver by 20 % or more would have been detected.",
    ]
