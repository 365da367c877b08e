"""Effects of the library on the ground do what their claims say, on the small site."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from grounds import case_on
from library_scene import applied, scene, sent, shared
from scipy import fft
from small_site import DT, SAMPLES, small_site

from pyblast.config.ground import LayerConfig
from pyblast.diagnosis.effects import starting_effects
from pyblast.diagnosis.forward import simulation_of
from pyblast.diagnosis.hypotheses import LIBRARY
from pyblast.diagnosis.library.ground import Fabric
from pyblast.ground.tables import quality_of
from pyblast.model.anisotropy import christoffel, stiffness_of


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
        # In a gap of half a spacing a plane lies in the middle.
        assert min(abs(place - hole) for hole in (30.0, 34.0, 38.0)) > 0.25 * apart
    assert [p for p in x if p > 60.0] == pytest.approx([78.0, 92.0], abs=15.0)
    assert max(np.diff([p for p in x if p > 60.0])) <= apart
    assert min(y) > 42.0  # all holes stand in the south of the receivers' span


def test_a_gap_of_half_a_spacing_has_a_plane_in_its_middle():
    case = scene().case
    mesh = case.project.config.mesh
    listed = mesh.faults[0].model_copy(update={"through_m": [52.0, 45.0, 0.0]})
    moved = case.project.changed(mesh=mesh.model_copy(update={"faults": [listed]}))
    near = replace(case, project=moved)

    assert "x=45.0" in LIBRARY["missing_joint"].targets(near)  # last hole at 38 m, spacing 21 m


def test_a_joint_too_stiff_to_move_changes_nothing_but_the_mesh():
    effect = LIBRARY["missing_joint"]
    knobs = {"offset": 3.0, "kn": 3e10, "ks": 3e10}
    bare = sent(effect.mesh_control(small_site(), "x=85.0", **knobs))

    assert shared(sent(applied("missing_joint", "x=85.0", **knobs)), bare) < 0.02


def test_a_missing_joint_weakens_what_crosses_it():
    effect = LIBRARY["missing_joint"]
    knobs = {"offset": 0.0, "kn": 1e8, "ks": 1e8}
    bare = sent(effect.mesh_control(small_site(), "x=90.0", **knobs))
    changed = sent(applied("missing_joint", "x=90.0", **knobs))
    energy = np.sum(changed**2, axis=(0, 2, 3)) / np.sum(bare**2, axis=(0, 2, 3))

    assert np.all(energy[2:] < 0.7)  # R2 and R3 are behind it
    assert energy[0] == pytest.approx(1.0, abs=0.1)


def test_no_joint_is_missing_where_one_is_listed():
    assert applied("missing_joint", "x=65.0", offset=-4.0, kn=1e9, ks=1e9) is None


def test_a_soft_layer_leaves_the_ground_below_as_it_is_whatever_its_name():
    rock = small_site().materials["rock"]
    layered = layers_of_rock(clay=20.0, soft=None)
    knobs = {"thickness": 5.0, "slower": 0.4}
    project = applied("soft_surface_layer", "", layered, **knobs)
    (own, top), *below = layers_in(project)

    assert own not in ("clay", "soft")
    assert (top, project.materials[own].cs) == pytest.approx((5.0, 0.4 * rock.cs))
    assert below == [("clay", 15.0), ("soft", None)]
    assert project.materials["clay"] == project.materials["soft"] == rock


def layers_in(project):
    """Return the names and thicknesses of the layers of a project."""
    return [(layer.material, layer.thickness_m) for layer in project.config.mesh.layers]


def layers_of_rock(**thicknesses):
    """Return the small site with layers of its rock by name."""
    project = small_site()
    layers = [LayerConfig(material=name, thickness_m=one) for name, one in thicknesses.items()]
    mesh = project.config.mesh.model_copy(update={"layers": layers})
    rock = project.materials["rock"]
    return project.changed(mesh=mesh, materials=dict.fromkeys(thicknesses, rock))


@pytest.mark.parametrize(("target", "offset"), [("x=105.0", 15.0), ("y=15.0", -15.0)])
def test_no_joint_is_missing_outside_of_the_box(target, offset):
    stiff = {"kn": 1e9, "ks": 1e9}
    inside = applied("missing_joint", target, offset=0.99 * offset, **stiff)
    outside = applied("missing_joint", target, offset=offset, **stiff)

    assert f"missing {target}" in inside.mesh.surfaces
    assert outside is None


@pytest.mark.parametrize(
    "name", ["anisotropy", "missing_joint", "missing_joint/dipping", "soft_surface_layer"]
)
def test_bare_sites_are_cut_into_the_zones_of_the_effect(name):
    one = LIBRARY[name]
    target = one.targets(scene().case)[-1]
    knobs = {knob.name: knob.starts[0] for knob in one.parameters}
    there, bare = (
        mesh_of(make(small_site(), target, **knobs)) for make in (one.apply, one.mesh_control)
    )

    near = 1.5 if name == "soft_surface_layer" else 0.0  # m: cut as a layer nearly as thick
    inside = [mesh.points[mesh.points[:, 2] >= -60.0] for mesh in (bare, there)]
    cut, wanted = (np.unique(points, axis=0) for points in inside)  # without the layer below
    np.testing.assert_allclose(cut, wanted, rtol=0.0, atol=near)


def mesh_of(project):
    """Return the mesh on which a project is run."""
    return simulation_of(scene().case).of(project, "S1").mesh


def test_a_closing_joint_is_as_stiff_at_rest_as_it_is_listed():
    (joint,) = applied("joint_nonlinear_closure", "J1", closed=0.6).joints
    kn, closure = joint.properties["kn"], joint.properties["closure"]

    assert kn * (1.0 + joint.insitu_pressure / (kn * closure)) ** 2 == pytest.approx(8e8)


@pytest.mark.parametrize("name", ["joint_slip", "joint_slip/frictional"])
@pytest.mark.parametrize("strength", [2e5, 3e4])  # friction of 30 degrees bears 5.8e4 alone
def test_a_slipping_joint_bears_its_strength_at_rest(name, strength):
    slips = applied(name, "J1", strength=strength, residual=0.5)
    (joint,) = slips.joints
    values, pressure = joint.properties, joint.insitu_pressure

    assert values["cohesion"] + values["friction"] * pressure == pytest.approx(strength)
    left = values["cohesion_residual"] + values["friction_residual"] * pressure
    assert left == pytest.approx(0.5 * strength)


def test_slip_is_tried_with_and_without_loss_of_strength():
    tried = starting_effects(LIBRARY["joint_slip"], "J1", scene())
    shares = set()
    for effect in tried:
        (joint,) = applied(effect.name, "J1", **effect.parameters).joints
        values = joint.properties
        shares.add(round(values["friction_residual"] / values["friction"], 6))

    assert shares == {0.5, 1.0}


def test_a_joint_that_slips_with_depth_bears_its_strength_at_mid_height_and_more_below():
    site = small_site()
    (joint,) = applied("joint_slip/with depth", "J1", strength=2e5, residual=0.5, growth=4e3).joints
    mesh = site.config.mesh
    middle = mesh.origin_m[2] + 0.5 * mesh.size_m[2]

    strength = joint.properties["friction"] * joint.pressure_at(middle - np.array([0.0, 10.0, -60]))

    np.testing.assert_allclose(strength, [2e5, 2.4e5, 0.0], rtol=1e-12)


def test_what_slips_by_friction_alone_has_no_cohesion_and_needs_a_pressure():
    slips = applied("joint_slip/frictional", "J1", strength=2e5, residual=0.5)
    (listed,) = small_site().joints
    free = small_site().changed(joints=(unpressed(listed),))

    assert slips.joints[0].properties["cohesion"] == 0.0
    assert applied("joint_slip/frictional", "J1", free, strength=2e5, residual=0.5) is None


def unpressed(joint):
    """Return a joint that nothing presses on at rest."""
    return replace(joint, insitu_pressure=0.0)


@pytest.mark.long
def test_a_slipping_joint_may_have_any_strength_of_its_range():
    for strength in np.geomspace(1e3, 1e7, 300):  # rounding must not leave a cohesion below zero
        slips = applied("joint_slip", "J1", strength=float(strength), residual=0.5)
        assert slips.joints[0].properties["cohesion"] >= 0.0


def test_a_viscous_fill_relaxes_both_ways_in_one_time():
    (joint,) = applied("joint_viscous_fill", "J1", relaxation=2e-3).joints
    values = joint.properties

    assert values["eta_n"] / values["kn"] == values["eta_s"] / values["ks"] == pytest.approx(2e-3)


def test_low_q_takes_more_of_high_frequencies():
    plain = np.abs(fft.rfft(scene().baseline.motion[0, 2], axis=-1)).sum(axis=0)
    faded = np.abs(fft.rfft(sent(applied("attenuation_Q", "", q=5.0))[0, 2], axis=-1)).sum(axis=0)
    left = faded / plain
    frequency = fft.rfftfreq(SAMPLES, DT)
    low, high = (left[np.abs(frequency - f) < 2.0].mean() for f in (5.0, 13.0))

    assert high < low - 0.15  # low ones gain: such ground is softer below the middle of its band


def test_fissures_slow_waves_across_them_and_none_change_nothing():
    rock = small_site().materials["rock"]
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
    coarse = simulation_of(replace(scene().case, blasts=("S1",)))
    bare = coarse.motion(
        LIBRARY["anisotropy"].mesh_control(small_site(), "", azimuth=0.0, **knobs)
    )[0]
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

    motion = scene().baseline.motion[:1]
    np.testing.assert_allclose(same, motion, rtol=0.0, atol=5e-4 * np.abs(motion).max())  # single


@pytest.mark.parametrize(("thickness", "slower"), [(6.0, 0.15), (4.0, 0.15), (8.0, 0.2)])
def test_the_search_of_slow_soil_begins_at_a_layer_that_rings_as_the_records_do(thickness, slower):
    here, rock = scene(), small_site().materials["rock"]
    ringing = sent(applied("soft_surface_layer", "", thickness=thickness, slower=slower))
    both = np.concatenate([ringing, here.baseline.motion[1:]])
    heard = SimpleNamespace(case=replace(here.case, motion=both), baseline=here.baseline)

    depth, factor = LIBRARY["soft_surface_layer"].begins(heard)

    # The peak of the spectrum of 0.4 s, 2.5 Hz wide, lies within 2 Hz of the resonance.
    assert factor * rock.cs / (4.0 * depth) == pytest.approx(
        slower * rock.cs / (4.0 * thickness), rel=0.2
    )


@pytest.mark.parametrize("ground", ["dipping", "crossing", "joint set", "bench"])
def test_elastic_ground_may_lose_energy_on_its_own_zones(ground):
    case = case_on(ground)
    (target,) = LIBRARY["attenuation_Q"].targets(case)
    changed = LIBRARY["attenuation_Q"].apply(case.project, target, q=10.0)

    assert quality_of(changed.materials) == (13.0, 10.0)
    np.testing.assert_array_equal(changed.mesh.points, case.project.mesh.points)
    np.testing.assert_array_equal(changed.mesh.zones, case.project.mesh.zones)


def test_loss_along_paths_is_as_large_as_that_by_runs():
    case = case_on("dipping")
    case = replace(case, blasts=("S1",))
    one = simulation_of(case)
    before = one.motion(case.project)
    after = one.motion(applied("attenuation_Q", "", case.project, q=25.0))
    formula = LIBRARY["attenuation_Q/along all paths"].apply(
        SimpleNamespace(case=case), before, "", loss=1.0 / 25.0
    )
    lost, expected = (case.band.project(each - before) for each in (after, formula))

    size = np.linalg.norm(expected) / np.linalg.norm(lost)
    assert size == pytest.approx(1.0, abs=0.15)  # 1.75 if counted from the firing, not the pulse
    assert np.sum(lost * expected) > 0.55 * size * np.sum(lost**2)


def test_ground_that_yields_has_no_other_law():
    assert "mohr-coulomb" in LIBRARY["attenuation_Q"].untestable(case_on("yielding"))


def test_loss_of_one_material_leaves_the_others_as_they_are():
    layered = layers_of_rock(clay=20.0, soft=None)
    changed = applied("attenuation_Q/one material", "clay", layered, q=10.0).materials

    assert (changed["clay"].law.qs, changed["soft"]) == (10.0, layered.materials["soft"])
    case = replace(scene().case, project=layered)
    assert LIBRARY["attenuation_Q/one material"].targets(case) == ("clay", "soft")


def test_water_speeds_p_waves_alone_below_its_table():
    layered = layers_of_rock(clay=20.0, soft=None)
    wet = applied("water_table", "", layered, depth=8.0, faster=1.3)
    layers = layers_in(wet)
    rocks = [wet.materials[name] for name, _ in layers]
    dry = layered.materials["clay"]

    assert [thickness for _, thickness in layers] == [8.0, 12.0, None]
    assert [rock.cp / dry.cp for rock in rocks] == pytest.approx([1.0, 1.3, 1.3])
    assert [rock.cs / dry.cs for rock in rocks] == pytest.approx([1.0, 1.0, 1.0])
    assert applied("water_table", "", layered, depth=60.0, faster=1.3) is None


def test_water_that_changes_no_speed_changes_nothing_but_the_mesh():
    dry = applied("water_table", "", depth=10.0, faster=1.0)

    assert shared(sent(dry), sent(small_site())) < 0.1  # 1 % of the energy
