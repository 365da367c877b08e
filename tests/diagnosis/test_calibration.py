"""Calibration of a small site, and effects that are found or not, on records of its own solver."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from small_site import recorded, small_site

import pyblast.diagnosis.library  # noqa: F401  fills the library
from pyblast import InputError
from pyblast.diagnosis.calibration import calibrate
from pyblast.diagnosis.effects import Effect, Scene
from pyblast.diagnosis.fitting import fit
from pyblast.diagnosis.forward import hole_motion, simulation_of
from pyblast.diagnosis.hypotheses import LIBRARY, hypothesis
from pyblast.inference.parameter import Parameter, set_all
from pyblast.project.uncertain_ground import factors_of

TRUE = np.array([0.02, -0.02, 0.2, -0.15])


@cache
def site():
    """Return the small site with other speeds and stiffness than are believed."""
    return set_all(small_site(), factors_of(small_site()), np.exp(TRUE))


@cache
def scene(change=None):
    """Return the calibrated small site, and what each of its holes sends."""
    case = recorded(small_site(), site(), change=change)
    simulation = simulation_of(case)
    baseline = calibrate(case, simulation)
    return Scene(simulation, baseline, hole_motion(simulation, case, baseline.project))


def late(motion):
    """Let the clock of one receiver be 8 ms, two samples, slow."""
    motion = motion.copy()
    motion[:, 2] = np.roll(motion[:, 2], 2, axis=-1)
    return motion


def flipped(motion):
    """Turn the north component of one receiver round."""
    motion = motion.copy()
    motion[:, 1, 1] *= -1.0
    return motion


def gain(scene, label, target, *values):
    """Return the evidence of an effect over that of none, and its fit."""
    found = fit(scene, (Effect(label, target, tuple((value,) for value in values)),))
    return found.log_evidence - fit(scene, ()).log_evidence, found


@pytest.mark.long
def test_calibration_finds_speeds_and_stiffness_within_its_own_errors():
    baseline = scene().baseline

    error = np.sqrt(np.diag(baseline.covariance))
    assert np.all(np.abs(baseline.values - TRUE) < 3.0 * error)
    assert np.all(error < 0.5 * np.array([one.sigma for one in baseline.parameters]))


@pytest.mark.parametrize("unit", [1000.0, 0.001])
def test_records_in_another_unit_are_refused_before_anything_is_called_missing(unit):
    case = recorded(small_site(), site(), change=lambda motion: unit * motion)

    with pytest.raises(InputError, match="the median ratio of recorded to simulated motion"):
        calibrate(case, simulation_of(case))


def test_nothing_is_found_where_nothing_is_hidden():
    sensor = "sensor_orientation_or_polarity"
    for label, start in (("clock_error", 8e-3), (f"{sensor}/turned", 0.3), (f"{sensor}/up", -1.0)):
        for receiver in scene().case.receivers:
            assert gain(scene(), label, receiver, start)[0] < 2.0, (label, receiver)


@pytest.mark.long
def test_a_slow_clock_is_found_at_its_receiver_with_its_shift():
    scores = {r: gain(scene(late), "clock_error", r, 4e-3) for r in scene(late).case.receivers}

    best = max(scores, key=lambda name: scores[name][0])
    assert best == "R2"
    assert scores[best][0] > 5.0
    assert scores[best][1].effects[0].parameters["shift"] == pytest.approx(8e-3, abs=1e-3)


@pytest.mark.long
def test_a_component_the_wrong_way_round_is_found():
    worth, found = gain(scene(flipped), "sensor_orientation_or_polarity/north", "R1", -1.0)

    assert worth > 10.0
    assert found.effects[0].parameters["factor"] == pytest.approx(-1.0, abs=0.3)


def test_stored_holes_send_together_what_a_run_of_the_blast_sends():
    blasts = small_site().blasts
    at = replace(blasts["B1"], times=blasts["B1"].times + 0.01)
    simulation, baseline = scene().simulation, scene().baseline
    run = simulation.motion(baseline.project.changed(blasts={**blasts, "B1": at}))

    effect = Effect("delay_scatter", "B1", ((0.01,) * 3,))
    moved = scene().received(simulation.motion(baseline.project), (effect,))

    assert np.abs(moved - run).max() < 0.01 * np.abs(run).max()  # moved in the band of the records


def test_words_that_no_hypothesis_knows_are_refused():
    with pytest.raises(InputError, match="need one of source"):
        hypothesis("x", family="magic", on="site", target="site", axis="both", parameters=[])
    old = LIBRARY["clock_error"]
    words = {"family": old.family, "on": old.on, "target": old.target, "axis": old.axis}
    again = hypothesis("clock_error", parameters=[Parameter("shift", mean=0.0, sigma=1.0)], **words)
    with pytest.raises(InputError, match="in the library already"):
        again(old.apply)


def test_factors_act_on_what_they_name_whatever_their_order():
    site = small_site()
    factors, values = factors_of(site), np.exp(TRUE)
    one, other = (set_all(site, factors[::turn], values[::turn]) for turn in (1, -1))

    rocks = [project.materials["rock"] for project in (site, one, other)]
    before, after, again = (np.array([rock.cp, rock.cs]) for rock in rocks)
    assert after / before == pytest.approx(values[:2], rel=1e-12)
    assert again == pytest.approx(after, rel=1e-12)
    assert set_all(site, factors, np.ones(4)) is site
