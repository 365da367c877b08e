"""Effects of the library on holes, places and records do what their claims say."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from grounds import case_on
from library_scene import applied, received, scene, sent, shared
from scipy import fft
from small_site import DT, SAMPLES, small_site

from pyblast.config.ground import LayerConfig
from pyblast.diagnosis.effects import Effect, Scene
from pyblast.diagnosis.forward import simulation_of
from pyblast.diagnosis.hypotheses import LIBRARY
from pyblast.diagnosis.library import air
from pyblast.diagnosis.library.air import ground_response, layers_under
from pyblast.model.material import Material
from pyblast.project.places import on_ground


def test_a_misfire_takes_away_what_its_hole_sends():
    effect = Effect("misfire_or_charge_error/misfire", "3 of blast B1", ((0.0,),))
    motion = scene().baseline.motion
    n_late = round(0.06 / DT)
    lost = motion - scene().received(motion, (effect,))

    assert not lost[0].any()
    assert np.abs(lost[1, ..., :n_late]).max() < 1e-3 * np.abs(lost[1]).max()  # fired at 60 ms
    without = sent_by(small_site().changed(blasts=silenced(2)))
    np.testing.assert_allclose(lost[1], motion[1] - without, atol=1e-3 * np.abs(lost[1]).max())


def test_a_wrong_pace_fires_all_holes_but_the_first_at_other_times():
    effect = Effect("delay_scatter/pace", "B1", ((1.2,),))
    motion = scene().baseline.motion
    heard = scene().received(motion, (effect,))
    blasts = small_site().blasts
    times = blasts["B1"].times
    later = replace(blasts["B1"], times=times[0] + 1.2 * (times - times[0]))

    np.testing.assert_array_equal(heard[0], motion[0])
    late = sent_by(small_site().changed(blasts=blasts | {"B1": later}))
    band = scene().case.band
    assert shared(band.project(heard[1]), band.project(late)) < 1e-3
    assert shared(motion[1], late) > 0.1


def silenced(n):
    """Return the blasts of the small site, a hole of the last without a charge."""
    blasts = small_site().blasts
    charge = blasts["B1"].charge.copy()
    charge[n] = 1e-9
    return blasts | {"B1": replace(blasts["B1"], charge=charge)}


def sent_by(site):
    """Return what the last blast of a site sends, (n_receivers, 3, n_samples) m/s."""
    return simulation_of(scene().case).motion(site, ["B1"])[0]


def test_a_slow_clock_delays_one_receiver():
    motion = scene().baseline.motion
    changed = received("clock_error", "R1", shift=3 * DT)

    assert shared(changed[:, 1, :, 3:], motion[:, 1, :, :-3]) < 0.05
    np.testing.assert_array_equal(np.delete(changed, 1, 1), np.delete(motion, 1, 1))


def test_a_moved_receiver_records_what_a_run_has_there():
    moved = received("wrong_coordinates/receiver", "R2", east=7.0, north=-5.0)
    there = tuple(
        replace(r, position=(107.0, 55.0, 0.0)) if r.name == "R2" else r
        for r in small_site().receivers
    )
    run = sent(small_site().changed(receivers=there))

    assert shared(moved[:1, 2], run[:, 2]) < 0.02
    assert shared(scene().baseline.motion[:1, 2], run[:, 2]) > 0.1
    np.testing.assert_array_equal(moved[:, :2], scene().baseline.motion[:, :2])


def test_a_receiver_that_did_not_move_records_the_same():
    moved = received("wrong_coordinates/receiver", "R1", east=0.0, north=0.0)

    np.testing.assert_allclose(moved, scene().baseline.motion, atol=1e-12)


def test_a_moved_blast_moves_all_its_holes_and_no_others():
    site = applied("wrong_coordinates/blast", "B1", east=4.0, north=-3.0)
    before = small_site().blasts["B1"]

    np.testing.assert_allclose(site.blasts["B1"].centres - before.centres, [[4.0, -3.0, 0.0]] * 3)
    assert list(site.blasts) == ["S1", "B1"]
    np.testing.assert_array_equal(site.blasts["S1"].centres, small_site().blasts["S1"].centres)


def test_charges_of_a_blast_change_what_it_sends_by_their_factor():
    effect = Effect("misfire_or_charge_error/blast", "B1", ((1.5,),))
    motion = scene().baseline.motion
    changed = scene().received(motion, (effect,))

    assert effect.label == "misfire_or_charge_error"
    np.testing.assert_array_equal(changed[0], motion[0])
    assert shared(changed[1], 1.5 * motion[1]) < 0.01  # in the band of the records


def test_a_wrong_zero_of_time_delays_all_receivers_of_a_blast():
    effect = Effect("clock_error/blast", "S1", ((2 * DT,),))
    motion = scene().baseline.motion
    changed = scene().received(motion, (effect,))

    assert shared(changed[0, ..., 2:], motion[0, ..., :-2]) < 0.02


def test_ground_under_running_pressure_moves_as_the_closed_form_says(monkeypatch):
    monkeypatch.setattr(air, "QUALITY", 1e9)
    for cp, cs in ((2800.0, 1600.0), (600.0, 170.0)):
        rock, frequency, speed = Material.from_speeds(2000.0, cp, cs), np.array([5.0, 20.0]), 340.0
        omega = 2 * np.pi * frequency
        k = omega / speed
        p, s = (np.sqrt(k**2 - (omega / c) ** 2 + 0j) for c in (cp, cs))
        rayleigh = (2 * k**2 - (omega / cs) ** 2) ** 2 - 4 * k**2 * p * s
        exact = omega * abs(p) * (omega / cs) ** 2 / (rock.shear * abs(rayleigh))
        layers = (4.0, rock), (None, rock)
        up = ground_response(layers, speed, [0.0], frequency)[0, 1]

        np.testing.assert_allclose(abs(up), exact, rtol=1e-6)


def test_running_pressure_is_felt_less_at_depth():
    layers = layers_under(small_site(), 60.0, 45.0)
    up = abs(ground_response(layers, 340.0, [0.0, 5.0, 20.0], np.array([10.0, 20.0]))[:, 1])

    assert np.all(np.diff(up, axis=0) < 0.0)
    assert np.all(up[2] < 0.2 * up[0])


def test_layers_under_a_receiver_are_those_of_the_ground_there():
    rock = small_site().materials["rock"]
    clay = Material.from_speeds(1900.0, 900.0, 250.0)
    mesh = small_site().config.mesh
    layers = [LayerConfig(material="clay", thickness_m=7.5), LayerConfig(material="rock")]
    site = small_site().changed(
        mesh=mesh.model_copy(update={"layers": layers}), materials={"rock": rock, "clay": clay}
    )
    (thickness, top), (rest, below) = layers_under(site, 20.0, 80.0)

    assert (thickness, rest) == (pytest.approx(7.5, abs=1e-6), None)
    assert (top, below) == (clay, rock)


@pytest.mark.parametrize("ground", ["bench", "survey"])
def test_air_runs_over_benches_and_hills_as_over_level_ground(ground):
    case = case_on(ground)
    knobs = {"pressure": 1e3, "period": 0.04, "speed": 340.0, "decay": 1.0, "radial": 1.0}
    still = np.zeros(case.motion.shape)
    change = LIBRARY["air_blast"].apply(SimpleNamespace(case=case), still, "", **knobs)
    stations = {r.name: r.position for r in case.project.receivers}
    level = LIBRARY["air_blast"].apply(
        SimpleNamespace(case=lifted(case, stations)), still, "", **knobs
    )

    assert not LIBRARY["air_blast"].untestable(case)
    assert np.abs(change).max() > 0.0
    assert shared(change, level) < 1e-6  # the same rock under every receiver


def lifted(case, stations):
    """Return a case of level ground with its receivers as deep below it."""
    tops = {name: on_ground(case.project.mesh, place[:2])[2] for name, place in stations.items()}
    moved = tuple(
        replace(r, position=(*r.position[:2], r.position[2] - tops[r.name]))
        for r in case.project.receivers
    )
    return replace(case, project=small_site().changed(receivers=moved))


def test_air_waves_arrive_after_their_way_and_die_with_it():
    knobs = {"pressure": 1e3, "period": 0.04, "speed": 340.0, "decay": 1.0, "radial": 1.0}
    change = received("air_blast", "", **knobs) - scene().baseline.motion
    places = np.array([r.position for r in small_site().receivers])
    far = np.linalg.norm(places[:3, :2] - [30.0, 30.0], axis=1)
    up = change[0, :3, 2]
    s = 0.04 / (2 * np.pi)
    middle = far / 340.0 + 3 * s  # pressure turns into suction; velocity is its slope
    steepest = np.abs(up).argmax(axis=-1) * DT

    np.testing.assert_allclose(steepest, middle, atol=2 * DT)
    np.testing.assert_allclose(
        np.abs(up).max(axis=-1) * far, np.abs(up[0]).max() * far[0], rtol=0.1
    )
    assert np.abs(change[0, 3]).max() < 0.3 * np.abs(up).max()  # R3 is 20 m deep


@pytest.mark.parametrize("late", [SAMPLES * DT, 2 * SAMPLES * DT])
def test_air_waves_that_come_after_the_record_are_not_in_it(late):
    blasts = small_site().blasts
    holes = replace(blasts["S1"], times=np.array([late]))
    case = replace(scene().case, project=small_site().changed(blasts={**blasts, "S1": holes}))
    still = np.zeros_like(scene().baseline.motion)
    knobs = {"pressure": 1e3, "period": 0.04, "speed": 340.0, "decay": 1.0, "radial": 1.0}
    change = LIBRARY["air_blast"].apply(SimpleNamespace(case=case), still, "", **knobs)

    assert not change[0].any()
    assert change[1].any()


@pytest.mark.parametrize("form", ["east", "north", "up", "all"])
def test_reversed_components_keep_their_size(form):
    motion = scene().baseline.motion
    changed = received(f"sensor_orientation_or_polarity/{form}", "R1", factor=-1.0)
    chosen = {"east": [0], "north": [1], "up": [2], "all": [0, 1, 2]}[form]

    np.testing.assert_array_equal(np.abs(changed), np.abs(motion))
    np.testing.assert_array_equal(changed[:, 1, chosen], -motion[:, 1, chosen])
    np.testing.assert_array_equal(np.delete(changed, 1, 1), np.delete(motion, 1, 1))


def test_a_turned_sensor_keeps_the_energy_of_its_horizontals():
    motion = scene().baseline.motion
    changed = received("sensor_orientation_or_polarity/turned", "R1", turn=0.5)

    np.testing.assert_allclose(
        np.sum(changed[:, 1, :2] ** 2, axis=1), np.sum(motion[:, 1, :2] ** 2, axis=1), rtol=1e-9
    )


def test_a_geophone_halves_its_corner_and_passes_what_is_far_above():
    spike = np.zeros_like(scene().baseline.motion)
    spike[..., 10] = 1.0
    knobs = {"corner": 4.0, "damping": 0.7, "gain": 1.1}
    heard = LIBRARY["instrument_response/geophone"].apply(scene(), spike, "R0", **knobs)
    spectrum = np.abs(fft.rfft(heard[0, 0, 0], 1000))
    at = {f: spectrum[round(f * 1000 * DT)] for f in (4.0, 60.0)}

    assert at[4.0] == pytest.approx(1.1 / 1.4, rel=0.02)  # 1/(2 damping) at the corner
    assert at[60.0] == pytest.approx(1.1, rel=0.02)
    np.testing.assert_array_equal(heard[:, 1:], spike[:, 1:])


def test_a_wrong_gain_scales_one_receiver():
    motion = scene().baseline.motion
    changed = received("instrument_response/gain", "R3", gain=2.0)

    np.testing.assert_array_equal(changed[:, 3], 2.0 * motion[:, 3])


@pytest.mark.parametrize("turn", [1, -1])
def test_an_instrument_acts_on_all_that_arrives_whichever_effect_was_found_first(turn):
    flipped = Effect("sensor_orientation_or_polarity/all", "R2", ((-1.0,),))
    moved = Effect("wrong_coordinates/receiver", "R2", ((8.0,), (0.0,)))
    motion = scene().baseline.motion

    both = scene().received(motion, (flipped, moved)[::turn])

    np.testing.assert_array_equal(both[:, 2], -scene().received(motion, (moved,))[:, 2])


def test_the_damage_around_holes_moves_with_them():
    damaged = Effect("damaged_zone", "B1", ((0.4,), (10.0,)))
    moved = Effect("wrong_coordinates/blast", "B1", ((6.0,), (-4.0,)))
    fields = SimpleNamespace(
        case=SimpleNamespace(project=small_site()), baseline=SimpleNamespace(parameters=()),
        simulation=SimpleNamespace(shots=()),
    )  # fmt: skip

    here, there = (
        Scene.project(fields, (), some).fields for some in ((damaged, moved), (moved, damaged))
    )

    assert repr(here) == repr(there)


def test_a_hole_that_fires_after_the_record_changes_nothing():
    last = SAMPLES * DT  # holes fire at whole samples: motion that is cut off rings in between
    blast = small_site().blasts["B1"]
    late = replace(blast, times=np.array([0.0, 0.03, 2.0 * last - 0.052]))
    site = small_site().changed(blasts=small_site().blasts | {"B1": late})
    there = replace_case(site)
    scatter = Effect("delay_scatter", "B1", ((0.0, 0.0, 0.02),))

    motion = scene().baseline.motion
    change = np.abs(there.received(motion, (scatter,)) - motion)

    assert change.max() < 1e-9 * np.abs(motion).max()


def replace_case(site):
    """Return the scene with other blasts, whose holes send the same."""
    there = object.__new__(Scene)
    case = replace(scene().case, project=site)
    there.baseline = SimpleNamespace(**vars(scene().baseline) | {"case": case})
    there.holes, there.failures = scene().holes, {}
    return there
