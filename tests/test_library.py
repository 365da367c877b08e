"""Each effect of the library does what its claim says, on the small site."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import fft
from small_site import CUT, DT, SAMPLES, recorded, small_site

import pyblast.diagnosis.library  # noqa: F401  fills the library
from pyblast.diagnosis import air_waves
from pyblast.diagnosis.air_waves import ground_response
from pyblast.diagnosis.forward import Forward
from pyblast.diagnosis.hypotheses import LIBRARY
from pyblast.diagnosis.scene import Effect, Scene
from pyblast.projects.site_fabric import Fabric
from pyblast.projects.site_model import site_mesh
from pyblast.solving.anisotropy import christoffel, stiffness_of
from pyblast.solving.materials import Material


@cache
def scene():
    """Return the small site, believed and true alike, and what its holes send."""
    forward = Forward(recorded(small_site()), CUT)
    motion = forward.motion(small_site())
    baseline = SimpleNamespace(site=small_site(), motion=motion)
    there = object.__new__(Scene)  # without the memory of a calibration
    there.forward, there.baseline = forward, baseline
    there.holes = forward.hole_motion(small_site())
    return there


def applied(name, target, site=None, **knobs):
    """Return the small site with an effect."""
    return LIBRARY[name].apply(site or small_site(), target, **knobs)


@cache
def first():
    """Return the solver for the first blast alone."""
    return Forward(replace(scene().case, blasts=("S1",)), CUT)


def sent(site):
    """Return what the first blast of a site sends, (1, n_receivers, 3, n_samples) m/s."""
    return first().motion(site)


def received(name, target, **knobs):
    """Return what is received of the small site with an effect that needs no runs."""
    return LIBRARY[name].apply(scene(), scene().baseline.motion, target, **knobs)


def shared(one, other):
    """Return the rms of a difference over that of the other."""
    return np.sqrt(np.mean((one - other) ** 2) / np.mean(other**2))


def test_every_effect_lists_where_it_may_be():
    case = scene().case
    listed = {name: one.targets(case) for name, one in LIBRARY.items()}

    assert listed["attenuation_Q"] == ("",)
    assert listed["joint_slip"] == ("J1",)
    assert listed["delay_scatter"] == ("B1",)
    assert listed["misfire_or_charge_error/blast"] == ("S1", "B1")
    assert listed["clock_error"] == ("R0", "R1", "R2", "R3")
    assert listed["damaged_zone"] == ("", "B1")


def test_a_misfire_may_be_of_each_hole_of_a_blast_of_many():
    listed = LIBRARY["misfire_or_charge_error/misfire"].targets(scene().case)

    assert listed == tuple(f"{n} of blast B1" for n in (1, 2, 3))


def test_a_misfire_takes_away_what_its_hole_sends():
    effect = Effect("misfire_or_charge_error/misfire", "3 of blast B1", ((0.0,),))
    motion = scene().baseline.motion
    n_late = round(0.06 / DT)
    lost = motion - scene().received(motion, (effect,))

    assert not lost[0].any()
    assert np.abs(lost[1, ..., :n_late]).max() < 1e-3 * np.abs(lost[1]).max()  # fired at 60 ms
    without = sent_by(replace(small_site(), blasts=silenced(2)))
    np.testing.assert_allclose(lost[1], motion[1] - without, atol=1e-3 * np.abs(lost[1]).max())


def test_a_wrong_pace_fires_all_holes_but_the_first_at_other_times():
    effect = Effect("delay_scatter/pace", "B1", ((1.2,),))
    motion = scene().baseline.motion
    heard = scene().received(motion, (effect,))
    blasts = small_site().blasts
    times = blasts["B1"].times
    later = replace(blasts["B1"], times=times[0] + 1.2 * (times - times[0]))

    np.testing.assert_array_equal(heard[0], motion[0])
    late = sent_by(replace(small_site(), blasts=blasts | {"B1": later}))
    assert shared(heard[1], late) < 1e-3
    assert shared(motion[1], late) > 0.1


def silenced(n):
    """Return the blasts of the small site, a hole of the last without a charge."""
    blasts = small_site().blasts
    charge = blasts["B1"].charge.copy()
    charge[n] = 1e-9
    return blasts | {"B1": replace(blasts["B1"], charge=charge)}


def sent_by(site):
    """Return what the last blast of a site sends, (n_receivers, 3, n_samples) m/s."""
    return Forward(scene().case, CUT).heard([(site, "B1")])[0]


def test_a_fill_that_creeps_passes_less_than_its_spring_and_all_of_it_if_stiff():
    spring = sent(small_site())[0, 1:3]  # receivers behind the joint
    slow, fast = (
        sent(applied("joint_viscous_fill/creeping", "J1", relaxation=one))[0, 1:3]
        for one in (1.0, 5e-3)
    )
    plane = 1.0 / (1.0 + 1.0 / (2.0 * 8e8 / (2600.0 * 2800.0) * 5e-3))  # 0.52, of a slow P wave

    assert shared(slow, spring) < 0.03
    assert np.linalg.norm(fast) / np.linalg.norm(spring) == pytest.approx(plane, abs=0.15)


def test_planes_keep_away_from_joints_and_holes_and_cover_the_rest():
    listed = LIBRARY["missing_joint"].targets(scene().case)
    apart = 1600.0 / 3.0 / 25.0
    x, y = ([float(p[2:]) for p in listed if p[0] == axis] for axis in "xy")

    for place in x:
        assert abs(place - 60.0) > 0.5 * apart - 0.1
        assert min(abs(place - hole) for hole in (30.0, 34.0, 38.0)) > 0.5 * apart - 0.1
    assert [p for p in x if p > 60.0] == pytest.approx([78.0, 92.0], abs=15.0)
    assert max(np.diff([p for p in x if p > 60.0])) <= apart
    assert min(y) > 42.0  # all holes stand in the south of the receivers' span


def test_a_gap_of_half_a_spacing_has_a_plane_in_its_middle():
    case = scene().case
    listed = replace(case.site.joints[0], position=52.0)
    near = replace(case, site=replace(case.site, joints=(listed,)))

    assert "x=45.0" in LIBRARY["missing_joint"].targets(near)  # last hole at 38 m, spacing 21 m


def test_a_joint_too_stiff_to_move_changes_nothing_but_the_mesh():
    effect = LIBRARY["missing_joint"]
    knobs = {"offset": 3.0, "kn": 3e10, "ks": 3e10}
    bare = sent(effect.bare(small_site(), "x=85.0", **knobs))

    assert shared(sent(applied("missing_joint", "x=85.0", **knobs)), bare) < 0.02


def test_a_missing_joint_weakens_what_crosses_it():
    effect = LIBRARY["missing_joint"]
    knobs = {"offset": 0.0, "kn": 1e8, "ks": 1e8}
    bare = sent(effect.bare(small_site(), "x=90.0", **knobs))
    changed = sent(applied("missing_joint", "x=90.0", **knobs))
    energy = np.sum(changed**2, axis=(0, 2, 3)) / np.sum(bare**2, axis=(0, 2, 3))

    assert np.all(energy[2:] < 0.7)  # R2 and R3 are behind it
    assert energy[0] == pytest.approx(1.0, abs=0.1)


def test_no_joint_is_missing_where_one_is_listed():
    assert applied("missing_joint", "x=65.0", offset=-4.0, kn=1e9, ks=1e9) is None


def test_a_soft_layer_leaves_the_ground_below_as_it_is_whatever_its_name():
    rock = small_site().layers[0][2]
    layered = replace(small_site(), layers=(("clay", 20.0, rock), ("soft", None, rock)))
    knobs = {"thickness": 5.0, "slower": 0.4}
    (own, top, slow), *below = applied("soft_surface_layer", "", layered, **knobs).layers

    assert own not in ("clay", "soft")
    assert (top, slow.cs) == pytest.approx((5.0, 0.4 * rock.cs))
    assert below == [("clay", 15.0, rock), ("soft", None, rock)]


@pytest.mark.parametrize(("target", "offset"), [("x=105.0", 15.0), ("y=15.0", -15.0)])
def test_no_joint_is_missing_outside_of_the_box(target, offset):
    stiff = {"kn": 1e9, "ks": 1e9}
    inside = applied("missing_joint", target, offset=0.99 * offset, **stiff)
    outside = applied("missing_joint", target, offset=offset, **stiff)

    assert f"missing {target}" in site_mesh(inside, CUT).surfaces
    assert outside is None


@pytest.mark.parametrize("name", [name for name, one in LIBRARY.items() if one.bare])
def test_bare_sites_are_cut_into_the_zones_of_the_effect(name):
    one = LIBRARY[name]
    target = one.targets(scene().case)[-1]
    knobs = {knob.name: knob.starts[0] for knob in one.knobs}
    there, bare = (
        site_mesh(make(small_site(), target, **knobs), CUT) for make in (one.apply, one.bare)
    )

    near = 1.5 if name == "soft_surface_layer" else 0.0  # m: cut as a layer nearly as thick
    cut, wanted = (np.unique(mesh.points, axis=0) for mesh in (bare, there))
    np.testing.assert_allclose(cut, wanted, rtol=0.0, atol=near)


def test_a_closing_joint_is_as_stiff_at_rest_as_it_is_listed():
    (joint,) = (j.joint for j in applied("joint_nonlinear_closure", "J1", closed=0.6).joints)
    kn, closure = joint.properties["kn"], joint.properties["closure"]

    assert kn * (1.0 + joint.insitu_pressure / (kn * closure)) ** 2 == pytest.approx(8e8)


@pytest.mark.parametrize("name", ["joint_slip", "joint_slip/frictional"])
@pytest.mark.parametrize("strength", [2e5, 3e4])  # friction of 30 degrees bears 5.8e4 alone
def test_a_slipping_joint_bears_its_strength_at_rest(name, strength):
    slips = applied(name, "J1", strength=strength, residual=0.5)
    (joint,) = (j.joint for j in slips.joints)
    values, pressure = joint.properties, joint.insitu_pressure

    assert values["cohesion"] + values["friction"] * pressure == pytest.approx(strength)
    left = values["cohesion_residual"] + values["friction_residual"] * pressure
    assert left == pytest.approx(0.5 * strength)


def test_what_slips_by_friction_alone_has_no_cohesion_and_needs_a_pressure():
    slips = applied("joint_slip/frictional", "J1", strength=2e5, residual=0.5)
    (listed,) = small_site().joints
    free = replace(small_site(), joints=(replace(listed, joint=unpressed(listed.joint)),))

    assert slips.joints[0].joint.properties["cohesion"] == 0.0
    assert applied("joint_slip/frictional", "J1", free, strength=2e5, residual=0.5) is None


def unpressed(joint):
    """Return a joint that nothing presses on at rest."""
    return replace(joint, insitu_pressure=0.0)


def test_a_slipping_joint_may_have_any_strength_of_its_range():
    for strength in np.geomspace(1e3, 1e7, 300):  # rounding must not leave a cohesion below zero
        slips = applied("joint_slip", "J1", strength=float(strength), residual=0.5)
        assert slips.joints[0].joint.properties["cohesion"] >= 0.0


def test_a_viscous_fill_relaxes_both_ways_in_one_time():
    (joint,) = (j.joint for j in applied("joint_viscous_fill", "J1", relaxation=2e-3).joints)
    values = joint.properties

    assert values["eta_n"] / values["kn"] == values["eta_s"] / values["ks"] == pytest.approx(2e-3)


def test_a_slow_clock_delays_one_receiver():
    motion = scene().baseline.motion
    changed = received("clock_error", "R1", shift=3 * DT)

    assert shared(changed[:, 1, :, 3:], motion[:, 1, :, :-3]) < 0.05
    np.testing.assert_array_equal(np.delete(changed, 1, 1), np.delete(motion, 1, 1))


def test_low_q_takes_more_of_high_frequencies():
    plain = np.abs(fft.rfft(scene().baseline.motion[0, 2], axis=-1)).sum(axis=0)
    faded = np.abs(fft.rfft(sent(applied("attenuation_Q", "", q=5.0))[0, 2], axis=-1)).sum(axis=0)
    left = faded / plain
    frequency = fft.rfftfreq(SAMPLES, DT)
    low, high = (left[np.abs(frequency - f) < 2.0].mean() for f in (5.0, 13.0))

    assert high < low - 0.15  # low ones gain: such ground is softer below the middle of its band


def test_fissures_slow_waves_across_them_and_none_change_nothing():
    rock = small_site().layers[0][2]
    across, along = np.eye(3)[:2]
    weak = Fabric(0.0, 0.3, 0.2).of(rock)
    none = stiffness_of(Fabric(0.7, 0.0, 0.0).of(rock))

    def fastest(way):
        return np.sqrt(np.linalg.eigvalsh(christoffel(stiffness_of(weak), way))[-1] / rock.density)

    # c11 falls by the weakness, the law of fissures; the other by (lambda/M)^2 of it
    modulus = rock.first_lame + 2.0 * rock.shear
    ratio = 0.7 / (1.0 - 0.3 * (rock.first_lame / modulus) ** 2)
    assert (fastest(across) / fastest(along)) ** 2 == pytest.approx(ratio, rel=1e-9)
    assert weak.shear == pytest.approx(rock.shear, rel=1e-9)
    np.testing.assert_allclose(none, stiffness_of(rock), rtol=1e-6, atol=1e-6 * modulus)


def test_fissures_delay_the_receivers_across_them():
    knobs = {"normal": 0.4, "shear": 0.3}
    coarse = Forward(first().case, replace(CUT, edge=45.0))
    bare = coarse.motion(LIBRARY["anisotropy"].bare(small_site(), "", azimuth=0.0, **knobs))[0]
    lags = []
    for azimuth in (0.5 * np.pi, 0.0):  # from north
        changed = coarse.motion(applied("anisotropy", "", azimuth=azimuth, **knobs))[0]
        both = fft.irfft(fft.rfft(changed[:, 0], 400) * fft.rfft(bare[:, 0], 400).conj(), 400)
        lags.append((both.argmax(axis=-1) + 200) % 400 - 200)

    east, north = lags  # R2 lies to the east of the hole, R0 to the north
    assert east[2] > max(0, north[2])


def test_damaged_rock_delays_all_that_leaves_it():
    changed = sent(applied("damaged_zone", "", reduction=0.5, length=15.0))
    late = np.cumsum(changed[0] ** 2, axis=-1), np.cumsum(scene().baseline.motion[0] ** 2, axis=-1)
    middle = [np.argmax(one[:, 0] > 0.5 * one[:, 0, -1:], axis=-1) for one in late]

    assert np.all(middle[0] >= middle[1])
    assert np.any(middle[0] > middle[1])


def test_undamaged_rock_is_as_it_was():
    same = sent(applied("damaged_zone", "B1", reduction=0.0, length=5.0))

    np.testing.assert_array_equal(same, scene().baseline.motion[:1])


def test_a_moved_receiver_records_what_a_run_has_there():
    moved = received("wrong_coordinates/receiver", "R2", east=7.0, north=-5.0)
    there = tuple(
        replace(r, position=(107.0, 55.0, 0.0)) if r.name == "R2" else r
        for r in small_site().receivers
    )
    run = sent(replace(small_site(), receivers=there))

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
    monkeypatch.setattr(air_waves, "QUALITY", 1e9)
    for cp, cs in ((2800.0, 1600.0), (600.0, 170.0)):
        rock, frequency, speed = Material.from_speeds(2000.0, cp, cs), np.array([5.0, 20.0]), 340.0
        omega = 2 * np.pi * frequency
        k = omega / speed
        p, s = (np.sqrt(k**2 - (omega / c) ** 2 + 0j) for c in (cp, cs))
        rayleigh = (2 * k**2 - (omega / cs) ** 2) ** 2 - 4 * k**2 * p * s
        exact = omega * abs(p) * (omega / cs) ** 2 / (rock.shear * abs(rayleigh))
        layers = (("a", 4.0, rock), ("b", None, rock))
        up = ground_response(SimpleNamespace(layers=layers), speed, [0.0], frequency)[0, 1]

        np.testing.assert_allclose(abs(up), exact, rtol=1e-6)


def test_running_pressure_is_felt_less_at_depth():
    up = abs(ground_response(small_site(), 340.0, [0.0, 5.0, 20.0], np.array([10.0, 20.0]))[:, 1])

    assert np.all(np.diff(up, axis=0) < 0.0)
    assert np.all(up[2] < 0.2 * up[0])


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
    case = replace(scene().case, site=replace(small_site(), blasts={**blasts, "S1": holes}))
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
