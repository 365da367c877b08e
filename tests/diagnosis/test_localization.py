"""Where residuals come from: what runs have changed is located, noise is not."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from small_site import recorded, scene_of, small_site

from pyblast.diagnosis import summary as module
from pyblast.diagnosis.error import with_calibrated
from pyblast.diagnosis.forward import quarter_wave
from pyblast.diagnosis.summary import PROPERTIES, _in_pattern, _nature
from pyblast.inference.location import Located, Places, located, unrestricted
from pyblast.model.ground_fields import DamagedZone


@cache
def scene():
    """Return the small site, explained."""
    return scene_of(recorded(small_site()))


@cache
def error():
    baseline = scene().baseline
    held = scene().case.band.project(baseline.slopes)
    return with_calibrated(scene().error, baseline.sigma[:, None, None, None, None] * held)


@cache
def bodies():
    rock, _ = scene().secondary_places
    return rock.spread(quarter_wave(scene().case.project, scene().case))


def run_with(changed):
    """Return the change of motion, in the band, by another ground, by runs."""
    own, case = scene().simulation, scene().case
    states = [own.of(case.project, blast) for blast in case.blasts]
    done = own.run([changed(own.model(each)) for each in states])
    motion = [own.sampled(r.seismograms, each.lead) for r, each in zip(done, states, strict=True)]
    return scene().seen(np.array(motion) - scene().baseline.motion)


@pytest.mark.long
@pytest.mark.parametrize("place", [(90.0, 45.0, -15.0), (75.0, 70.0, -40.0)])
def test_a_soft_body_is_located_where_it_is(place):
    zone = DamagedZone(np.array([[place, place]]), 0.5, 15.0)
    change = run_with(lambda model: replace(model, ground=(zone,)))

    found = located(error(), bodies(), change, 0.3)

    off = np.linalg.norm(found.places.centres - place, axis=1)
    assert off[found.best] < 30.0  # a cell is 45 m long
    assert found.strength[found.best, 1] < -0.1
    assert found.score > 50.0
    assert found.volume < 0.1 * found.places.sizes.sum()


def test_springs_of_a_joint_are_located_on_it_and_are_no_body():
    def softer(model):
        (joint,) = model.joints
        soft = {name: 0.7 * joint.properties[name] for name in ("kn", "ks")}
        return replace(model, joints=[replace(joint, properties=joint.properties | soft)])

    change, patches = run_with(softer), scene().secondary_places[1]
    assert set(patches.names) == {"J1"}

    on_joint = located(error(), patches, change, 1.0)

    assert on_joint.log_bayes.max() > located(error(), bodies(), change, 0.3).log_bayes.max()
    assert on_joint.strength[on_joint.best].min() < 0.0


def test_noise_scores_nowhere_and_unrestricted_sources_pay_for_their_freedom():
    noise = error().draws(np.random.default_rng(2), 3, error().scores(0.0 * few()).at)
    for each in noise:
        assert located(error(), bodies(), each, 0.3).score < 10.0
        assert unrestricted(error(), [(scene().secondary_places[0], 1.0)], each) < 10.0


def test_a_place_among_holes_is_in_their_pattern_and_one_beside_them_is_not():
    case = scene().case
    holes = np.concatenate([case.project.blasts[name].centres for name in case.blasts])
    far = holes.max(axis=0) + 1e3

    assert all(_in_pattern(case, hole) for hole in case.project.blasts["B1"].centres)
    assert _in_pattern(case, case.project.blasts["B1"].centres.mean(axis=0) - [0.0, 0.0, 20.0])
    assert not _in_pattern(case, far)


@pytest.mark.parametrize(
    ("change", "nature"), [((-0.1, -0.2, 0.0), "soft"), ((0.1, 0.2, -0.1), "stiff"),
                           ((0.1, -0.2, 0.0), None), ((-0.1, -0.1, 0.4), "stiff")],
)  # fmt: skip
def test_ground_is_soft_or_stiff_where_both_moduli_agree(change, nature):
    assert _nature(dict(zip(PROPERTIES, change, strict=True))) == nature


def few():
    return np.ones((1, *scene().case.motion.shape[:3], scene().case.band.n_functions))


def test_unrestricted_sources_explain_what_a_body_does():
    place = np.array([90.0, 45.0, -15.0])
    zone = DamagedZone(np.array([[place, place]]), 0.5, 15.0)
    change = run_with(lambda model: replace(model, ground=(zone,)))

    free = unrestricted(error(), [(scene().secondary_places[0], 1.0)], change)

    assert free > 0.5 * located(error(), bodies(), change, 0.3).log_bayes.max()


def found_at(log_bayes):
    """Return a location among cubes in a row, 10 m apart."""
    n = len(log_bayes)
    centres = np.outer(10.0 * np.arange(n), [1.0, 0.0, 0.0])
    places = Places(centres, np.full(n, 1e3), np.zeros((n, 1, 1, 1, 3, 2), np.float32))
    return Located(places, np.array(log_bayes, float), np.zeros((n, 1)), 1)


def test_the_volume_that_holds_a_change_grows_where_places_are_alike():
    sharp, flat = found_at([0.0, 20.0, 0.0, 0.0]), found_at([5.0, 5.0, 5.0, 5.0])
    assert (sharp.volume, sharp.within(0.0)) == (1e3, pytest.approx(26.0))
    assert sharp.within(31.0) == 31.0
    assert (flat.volume, flat.within(0.0)) == (4e3, 30.0)
    assert flat.score == pytest.approx(5.0)


@pytest.mark.parametrize(
    ("span", "value", "told"), [(10.0, 3.14159265, 3.142), (3e-4, 5.4321e-5, 5.432e-5)]
)
def test_windows_are_rounded_to_a_share_of_what_was_recorded(span, value, told):
    axis = np.array([0.0, value, span])

    assert module._window(axis, np.array([0.0, 1.0, 0.0])) == [told, told]
