"""Where residuals come from, on residuals that were sent from a known place."""

from functools import cache

import numpy as np
import pytest
from small_site import recorded, scene_of, small_site

from pyblast.diagnosis import summary as module
from pyblast.diagnosis.summary import locate_residual

PLACE = np.array([75.0, 55.0, 0.0])
SENT = 0.13  # s after the first hole


@cache
def scene():
    """Return the small site, explained."""
    return scene_of(recorded(small_site()))


def sent_from(place, blast=1, size=1.0):
    """Return the motion of the site without a pulse that a place sends in one blast."""
    case = scene().case
    motion = case.motion.copy()
    times = case.dt * np.arange(case.n_samples)
    peak = size * np.abs(case.motion[blast]).max()
    for r, receiver in enumerate(case.project.receivers):
        way = np.linalg.norm(np.array(receiver.position) - place)
        late = times - SENT - way / 1600.0
        pulse = np.exp(-((late / 0.03) ** 2)) * np.sin(2.0 * np.pi * 15.0 * late)
        motion[blast, r] -= peak * 20.0 / (way + 20.0) * pulse * np.ones((3, 1))
    return motion


def found(motion):
    """Return what is located of it."""
    baseline = scene().baseline
    return locate_residual(baseline, motion, baseline.chi_square(motion))


def off(point):
    """Return how far a point is off, m."""
    return np.hypot(point["x"] - PLACE[0], point["y"] - PLACE[1])


def test_what_a_place_sends_is_found_there_whenever_it_sent_it():
    (point,) = found(sent_from(PLACE))["points"]

    assert off(point) < max(10.0, 0.5 * point["resolution_m"])
    assert point["coherence"] > 0.95


def test_it_is_looked_for_in_the_blast_that_is_explained_worst():
    for blast in (0, 1):
        said = found(sent_from(PLACE, blast))

        assert max(said["blasts"], key=said["blasts"].get) == ("S1", "B1")[blast]
        assert off(said["points"][0]) < 15.0


def test_receivers_that_are_explained_do_not_count():
    motion = sent_from(PLACE)
    motion[1, 0] = scene().case.motion[1, 0]

    assert set(found(motion)["receivers"]) == {"R1", "R2", "R3"}


def test_nothing_comes_from_anywhere_where_all_is_explained():
    assert found(scene().case.motion)["points"] == []
    assert found(scene().case.motion)["receivers"] == {}


def test_a_place_without_resolution_is_not_reported(monkeypatch):
    (point,) = found(sent_from(PLACE))["points"]
    monkeypatch.setattr(module, "RESOLVED", 0.9 * point["resolution_m"] / 120.0)

    assert found(sent_from(PLACE))["points"] == []


@pytest.mark.parametrize(
    ("span", "value", "told"), [(10.0, 3.14159265, 3.142), (3e-4, 5.4321e-5, 5.432e-5)]
)
def test_windows_are_rounded_to_a_share_of_what_was_recorded(span, value, told):
    axis = np.array([0.0, value, span])

    assert module._window(axis, np.array([0.0, 1.0, 0.0])) == [told, told]
