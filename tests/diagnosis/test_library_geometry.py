"""Hypotheses on geometry change what they say, on ground with and without dipping planes."""

import math
from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from library_scene import applied, scene, sent, shared
from small_site import TABLES, small_site

from pyblast.config.config import check_config
from pyblast.config.ground import FaultConfig
from pyblast.diagnosis import search as module
from pyblast.diagnosis.effects import Effect
from pyblast.diagnosis.hypotheses import LIBRARY
from pyblast.diagnosis.library.geometry import _fault, _on_top
from pyblast.errors import InputError
from pyblast.project.places import on_ground, survey_positions

STIFF, WEAK = {"kn": 3e10, "ks": 3e10}, {"kn": 1e8, "ks": 1e8}


@cache
def site(*dips, direction=100.0):
    """Return the small site with parallel faults of some dips in place of its upright one."""
    project = small_site()
    faults = [
        FaultConfig(name=f"F{n}", dip_deg=dip, dip_direction_deg=direction,
                    through_m=[60.0 + 25.0 * n, 45.0, 0.0])
        for n, dip in enumerate(dips)
    ]  # fmt: skip
    joints = [replace(project.joints[0], surface=fault.name) for fault in faults]
    mesh = project.config.mesh.model_copy(update={"faults": faults})
    return project.changed(mesh=mesh, joints=joints)


def listed(name, project):
    """Return the targets of a hypothesis in a project."""
    return LIBRARY[name].targets(replace(scene().case, project=project))


def untestable(name, project):
    """Return why a hypothesis cannot be tested in a project."""
    return LIBRARY[name].untestable(replace(scene().case, project=project))


def test_missing_joints_are_parallel_to_listed_planes_or_of_any_dip_without_them():
    parallel, free = (
        listed("missing_joint/parallel", site(60.0)),
        listed("missing_joint/dipping", site()),
    )

    assert {name.rpartition(" at ")[0] for name in parallel} == {
        "dip 60 to 100", "dip 90 to 10",
    }  # fmt: skip
    assert {name.split()[3] for name in free if "dip 60" in name} == {
        f"{45 * k}" for k in range(8)
    }  # fmt: skip
    assert "oblique" in untestable("missing_joint/parallel", site())


def test_a_missing_joint_of_any_strike_is_sought_beside_listed_planes():
    beside = listed("missing_joint/dipping", site(60.0))
    upright = listed("missing_joint/dipping", small_site())

    assert {name.rpartition(" at ")[0] for name in beside} == {
        "dip 60 to 280", "dip 60 to 190", "dip 60 to 10",
    }  # fmt: skip
    assert {name.split()[3] for name in upright} == {"0", "180", "270"}
    assert len(beside) == len(upright) == 3  # one of each orientation


def test_zones_across_listed_planes_are_tetrahedra_with_a_control_of_their_own():
    believed = site(60.0)
    target = listed("missing_joint/dipping", believed)[0]
    free = {"offset": 0.0, "turn": 0.0, "steeper": 0.0}
    welded = LIBRARY["missing_joint/dipping"].mesh_control(believed, target, **free, **WEAK)
    joined, bare = (
        sent(each)
        for each in (applied("missing_joint/dipping", target, believed, **free, **STIFF), welded)
    )

    assert believed.meshed.mesh.hexahedral
    assert not welded.meshed.mesh.hexahedral
    assert welded.joints == believed.joints
    assert shared(joined, bare) < 0.05


def test_candidate_planes_pass_between_holes_and_receivers():
    project = site()
    blasts, receivers = project.blasts.values(), project.receivers
    places = np.array([*(c for b in blasts for c in b.centres), *(r.position for r in receivers)])
    for target in listed("missing_joint/dipping", project):
        _, dip, _, direction, _, place = target.split()
        at = _on_top(places, float(dip), float(direction), project)
        assert at.min() < float(place) < at.max()


def test_a_plane_through_a_place_meets_the_top_up_the_dip():
    project = site()
    (deep,) = _on_top(np.array([[60.0, 45.0, -20.0]]), 60.0, 90.0, project)

    assert deep == pytest.approx(-20.0 / math.tan(math.radians(60.0)))


def test_a_plane_steeper_than_upright_dips_the_other_way():
    fault = _fault(site(), "dip 60 to 90 at 5.0", 0.0, 0.0, math.radians(40.0))

    assert (fault.dip_deg, fault.dip_direction_deg) == pytest.approx((80.0, 270.0))


def test_a_missing_joint_too_stiff_to_move_changes_less_than_the_model_error():
    target = "dip 80 to 100 at -22.0"
    there = applied("missing_joint/parallel", target, site(80.0), offset=2.0, **STIFF)

    assert there.meshed.mesh.hexahedral
    joined, bare = (scene().case.in_band(sent(each)) for each in (there, site(80.0)))
    assert shared(joined, bare) < 0.1  # 1 % of the energy


def test_a_weak_dipping_joint_weakens_what_crosses_it():
    there = applied(
        "missing_joint/dipping", "dip 60 to 90 at 20.0", site(), offset=0.0, turn=0.0,
        steeper=0.0, **WEAK,
    )  # fmt: skip
    changed, bare = sent(there), sent(site())
    energy = np.sum(changed**2, axis=(0, 2, 3)) / np.sum(bare**2, axis=(0, 2, 3))

    assert np.all(energy[2:] < 0.7)  # R2 and R3 are behind it


@pytest.mark.parametrize("offset", [500.0, -16.0])
def test_no_joint_is_missing_outside_of_the_box_or_beside_a_listed_one(offset):
    target = "dip 60 to 100 at 16.0"

    assert applied("missing_joint/parallel", target, site(60.0), offset=offset, **STIFF) is None


def test_faults_of_one_family_turn_together_and_back():
    names = listed("wrong_geometry", site(60.0, 60.0))
    turned = applied("wrong_geometry", names[0], site(60.0, 60.0), dip=0.1, turn=-0.2, shift=5.0)
    back = applied("wrong_geometry", names[0], turned, dip=-0.1, turn=0.2, shift=0.0)
    first, second = turned.config.mesh.faults

    assert names == ("F0, F1",)
    assert first.dip_deg == second.dip_deg == pytest.approx(60.0 + math.degrees(0.1))
    assert [f.dip_deg for f in back.config.mesh.faults] == pytest.approx([60.0, 60.0])
    assert [f.dip_direction_deg for f in back.config.mesh.faults] == pytest.approx([100.0] * 2)
    moved = np.subtract(first.through_m, site(60.0, 60.0).config.mesh.faults[0].through_m)
    assert moved == pytest.approx([5.0 * math.sin(math.radians(100.0)),
                                   5.0 * math.cos(math.radians(100.0)), 0.0])  # fmt: skip


@pytest.mark.parametrize("dips", [(90.0,), (60.0,)])
def test_a_fault_that_ends_at_a_depth_opens_above_it_alone(dips):
    believed = site(*dips)
    ended = applied("partial_joint", "F0", believed, depth=15.0)
    surface = ended.mesh.points[np.unique(ended.mesh.surfaces["F0"])]

    assert surface[:, 2].min() == pytest.approx(-15.0, abs=0.5)
    assert surface[:, 2].max() == pytest.approx(0.0, abs=0.1)
    assert LIBRARY["partial_joint"].targets(replace(scene().case, project=ended)) == ()
    assert applied("partial_joint", "F0", believed, depth=100.0) is believed


def test_one_of_parallel_faults_moves_alone_and_no_fault_overturns():
    moved = applied("wrong_geometry/place", "F1", site(60.0, 60.0), shift=4.0)
    before = site(60.0, 60.0).config.mesh.faults

    assert listed("wrong_geometry/place", site(60.0)) == ()
    assert moved.config.mesh.faults[0] == before[0]
    assert moved.config.mesh.faults[1] != before[1]
    assert applied("wrong_geometry", "F0", site(60.0), dip=0.6, turn=0.0, shift=0.0) is None


def test_ground_beyond_a_slope_is_higher_or_lower():
    knobs = {"position": 0.0, "width": 30.0, "turn": 0.0}
    lower = applied("topography", "E", site(), height=-6.0, **knobs)
    diagonal = applied("topography", "N", site(), height=-6.0, **knobs | {"turn": math.pi / 4})
    middle = survey_positions(site()).mean(axis=0)

    assert lower.meshed.mesh.hexahedral
    assert on_ground(lower.mesh, np.add(middle, (30.0, 5.0)))[2] == pytest.approx(-6.0, abs=0.5)
    assert on_ground(lower.mesh, np.subtract(middle, (30.0, 5.0)))[2] == pytest.approx(0.0, abs=0.5)
    beyond = applied("topography", "E", site(), height=-6.0, **knobs | {"position": 20.0}).terrain
    away = beyond[:, 0] - (middle[0] + 20.0)
    assert beyond[np.abs(away) < 15.5, 2].mean() == pytest.approx(-3.0)
    assert beyond[away < -14.5, 2] == pytest.approx(0.0)
    north_east = applied("topography", "NE", site(), height=-6.0, **knobs)
    np.testing.assert_allclose(diagonal.terrain, north_east.terrain, atol=1e-9)


def test_a_slope_without_height_changes_nothing():
    flat = applied("topography", "S", site(), height=0.0, position=5.0, width=9.0, turn=0.1)

    assert shared(sent(flat), sent(site())) < 1e-3


def test_a_hill_falls_to_half_its_height_at_its_half_width_on_all_sides():
    knobs = {"height": 6.0, "east": 4.0, "north": -3.0, "width": 16.0, "longer": 1.5}
    upright = applied("topography/hill", "middle", site(), turn=0.0, **knobs)
    turned = applied("topography/hill", "middle", site(), turn=math.pi / 2, **knobs)
    crest = np.add(survey_positions(site()).mean(axis=0), (4.0, -3.0))

    assert upright.meshed.mesh.hexahedral
    assert on_ground(upright.mesh, crest)[2] == pytest.approx(6.0, abs=0.3)
    for project, sides in ((upright, (16.0, 24.0)), (turned, (24.0, 16.0))):
        for step in np.vstack([np.diag(sides), -np.diag(sides)]):
            assert on_ground(project.mesh, crest + step)[2] == pytest.approx(3.0, abs=0.3)


def test_a_crest_lies_towards_its_target():
    middle = survey_positions(site()).mean(axis=0)
    reach = 0.25 * np.ptp(survey_positions(site()), axis=0)
    targets = listed("topography/hill", site())

    assert len(targets) == 9
    knobs = {"height": 6.0, "east": 0.0, "north": 0.0, "width": 16.0, "longer": 1.5, "turn": 0.0}
    north_west = applied("topography/hill", "NW", site(), **knobs).terrain
    highest = north_west[np.argmax(north_west[:, 2])]
    np.testing.assert_allclose(highest[:2], middle + reach * [-1.0, 1.0])
    assert highest[2] == 6.0


def test_a_hill_without_height_changes_nothing():
    knobs = {"east": 4.0, "north": -3.0, "width": 16.0, "longer": 1.5, "turn": 0.3}
    flat = applied("topography/hill", "E", site(), height=0.0, **knobs)

    assert shared(sent(flat), sent(site())) < 1e-3


def test_a_slope_is_added_to_a_surveyed_surface():
    survey = np.array(
        [[x, y, 0.02 * x] for x in (-50.0, 60.0, 170.0) for y in (-50.0, 45.0, 140.0)]
    )
    knobs = {"height": 6.0, "position": 10.0, "width": 20.0, "turn": 0.0}

    surface = applied("topography", "E", site().changed(surface=survey), **knobs).terrain

    east = surface[:, 0] - survey_positions(site()).mean(axis=0)[0]
    inside = np.all((surface[:, :2] >= -50.0) & (surface[:, :2] <= [170.0, 140.0]), axis=1)
    step = 6.0 * np.clip((east - 10.0) / 20.0 + 0.5, 0.0, 1.0)
    np.testing.assert_allclose((surface[:, 2] - step)[inside], 0.02 * surface[inside, 0], atol=1e-9)
    assert np.count_nonzero(inside) > len(survey)


def test_a_slope_is_not_sought_where_triangles_give_the_ground():
    triangles = np.array([[[-50.0, -50.0, 0.0], [170.0, -50.0, 0.0], [60.0, 900.0, 0.0]]])
    project = site()
    project = replace(project, terrain=triangles)

    assert "[[diagnosis.candidates]]" in untestable("topography", project)


def test_a_mesh_that_was_read_says_what_would_make_it_testable():
    read = site().config.mesh.model_copy(update={"file": "ground.msh"})
    config = site().config.model_copy(update={"mesh": read})
    project = replace(site(), config=config)

    for name in ("missing_joint/parallel", "wrong_geometry", "topography", "soft_surface_layer"):
        assert "mesh.layers" in untestable(name, project)


def test_speeds_of_rock_change_by_their_factors():
    before = site().materials["rock"]
    after = applied("rock_speed", "rock", site(), p=1.1, s=0.9).materials["rock"]

    assert (after.cp, after.cs) == pytest.approx((1.1 * before.cp, 0.9 * before.cs))
    assert applied("rock_speed", "rock", site(), p=0.6, s=1.4) is None


SECOND = {
    "name": "second",
    "mesh": {"faults": [{"name": "J2", "dip_deg": 90.0, "dip_direction_deg": 90.0,
                         "through_m": [90.0, 45.0, 0.0]}]},
    "joints": {"J2": {"law": "elastic", "kn_gpa_per_m": 0.1, "ks_gpa_per_m": 0.1}},
}  # fmt: skip


def with_candidates(*candidates):
    """Return the configuration of the small site with candidates."""
    return check_config(
        {**TABLES, "diagnosis": {**TABLES["diagnosis"], "candidates": list(candidates)}}
    )


def test_a_candidate_adds_its_fault_to_the_ground():
    project = replace(small_site(), config=with_candidates(SECOND))
    there = applied("candidate", "second", project)

    assert listed("candidate", project) == ("second",)
    assert [joint.surface for joint in there.joints] == ["J1", "J2"]
    assert there.joints[0] is project.joints[0]
    assert there.joints[1].properties["kn"] == pytest.approx(1e8)
    assert set(there.mesh.contacts.names) == {"J1", "J2"}


def test_a_candidate_changes_a_listed_fault_and_a_material():
    changed = {"name": "softer", "materials": {"rock": {"cs_m_per_s": 1500.0}},
               "mesh": {"faults": [{"name": "J1", "dip_deg": 80.0}]}}  # fmt: skip
    there = applied("candidate", "softer", replace(small_site(), config=with_candidates(changed)))

    assert there.materials["rock"].cs == pytest.approx(1500.0)
    assert there.materials["rock"].cp == pytest.approx(2800.0)
    assert there.config.mesh.faults[0].dip_deg == 80.0
    assert there.config.mesh.faults[0].through_m == [60.0, 45.0, 0.0]


@pytest.mark.parametrize(
    ("candidate", "message"),
    [
        ({"name": "nothing"}, "changes nothing"),
        ({"name": "box", "mesh": {"file": "a.msh"}}, "the ground is described by layers"),
        ({"name": "bad", "mesh": {"edge": 3.0}}, "candidates.bad: mesh.edge: unknown key"),
        ({"name": "rock", "materials": {"rock": {"cs_m_per_s": -1.0}}}, "must be positive"),
        ({"name": "flat", "mesh": {"layers": [{"material": "clay"}]}}, "must be one of rock"),
        ({"name": "x", "blast": {}}, "unknown key"),
    ],
)
def test_a_candidate_that_breaks_a_rule_is_refused_in_one_sentence(candidate, message):
    with pytest.raises(InputError, match=message.replace("[", r"\[")):
        with_candidates(candidate)


def test_two_candidates_need_two_names():
    with pytest.raises(InputError, match="same name"):
        with_candidates(SECOND, SECOND)


def test_further_starts_are_tried_where_the_best_target_is():
    best = Effect("topography", "N", ((8.0,), (0.0,), (20.0,), (0.0,)))
    tried = []

    def best_of(effects, _):
        tried.extend(effect.values[1][0] for effect in effects)
        return effects[3], 30.0

    member = SimpleNamespace()
    scores = SimpleNamespace(best_of=best_of, best_on_site=lambda *_: member, start=lambda *_: best)
    effect, score = module._start(SimpleNamespace(scores=scores), None, "topography", 9.0)

    assert effect.values == ((8.0,), (20.0,), (20.0,), (0.0,))
    assert score == 30.0
    assert tried == [0.0, -40.0, -20.0, 20.0, 40.0]
