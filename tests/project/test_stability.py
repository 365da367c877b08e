"""Safety of blocks and joints, Newmark's sliding block: closed forms."""

import math
from dataclasses import replace

import numpy as np
import pytest
from slipping_box import sheared

from pyblast.mesh.builder import structured_box
from pyblast.model.boundary import Viscous
from pyblast.model.joint import Joint
from pyblast.model.model import Model
from pyblast.project.stability import (
    JointFace,
    loose_blocks,
    newmark,
    sentence,
    sliding_mode,
)
from pyblast.solver.preparation import prepare
from pyblast.solver.run import simulate
from pyblast.solver.slip import JointObserver
from verification.columns import ROCK

DOWN = np.array([0.0, 0.0, -1.0])


def upward(dip_deg, direction_deg):
    """Return the upward normal of a plane."""
    dip, way = np.radians([dip_deg, direction_deg])
    return np.array([np.sin(dip) * np.sin(way), np.sin(dip) * np.cos(way), np.cos(dip)])


@pytest.mark.parametrize("cohesion", [0.0, 2e4])
@pytest.mark.parametrize("dip", [20.0, 35.0, 70.0])
def test_a_block_on_a_slope_has_the_safety_of_the_text_book(dip, cohesion):
    weight, area, friction, slope = 3e6, 40.0, math.tan(math.radians(30.0)), math.radians(dip)

    found = sliding_mode(
        [JointFace("F1", upward(dip, 90.0), area, cohesion, friction)], weight * DOWN
    )

    held = cohesion * area + weight * math.cos(slope) * friction
    assert found.factor == pytest.approx(held / (weight * math.sin(slope)), rel=1e-12)
    assert found.direction == pytest.approx([math.cos(slope), 0.0, -math.sin(slope)])


@pytest.mark.parametrize(("dip", "apart"), [(50.0, 60.0), (65.0, 40.0), (45.0, 75.0)])
def test_a_symmetric_wedge_has_the_safety_of_hoek_and_bray(dip, apart):
    friction = math.tan(math.radians(35.0))
    planes = [JointFace(name, upward(dip, 90.0 + turn), 10.0, 0.0, friction)
              for name, turn in (("A", apart), ("B", -apart))]  # fmt: skip

    found = sliding_mode(planes, 1e6 * DOWN)

    # sin(beta)/sin(xi/2) tan(phi)/tan(psi): of a symmetric wedge beta is 90 degrees, xi the angle
    # between its planes, psi the plunge of its edge
    xi = math.pi - math.acos(planes[0].normal @ planes[1].normal)
    plunge = math.asin(-found.direction[2])
    assert found.mode == "slides on A and B"
    assert found.factor == pytest.approx(
        friction / (math.sin(0.5 * xi) * math.tan(plunge)), rel=1e-12
    )


def test_cohesion_on_both_faces_of_a_wedge_adds_to_its_resistance():
    bare, held = (
        sliding_mode([JointFace("A", upward(55.0, 130.0), 10.0, cohesion, 0.7),
                      JointFace("B", upward(55.0, 50.0), 4.0, cohesion, 0.7)], 1e6 * DOWN)
        for cohesion in (0.0, 2e4)
    )  # fmt: skip

    assert held.mode == "slides on A and B"
    assert held.resisting == pytest.approx(bare.resisting + 2e4 * 14.0, rel=1e-12)
    assert held.driving == pytest.approx(bare.driving, rel=1e-12)


def test_a_block_under_a_roof_falls_and_one_in_a_pit_is_held():
    roof = [JointFace("A", upward(dip, way) * [1, 1, -1], 1.0, 0.0, 1.0)
            for dip, way in ((50.0, 0.0), (50.0, 120.0), (50.0, 240.0))]  # fmt: skip
    pit = [JointFace("A", upward(50.0, way), 1.0, 0.0, 0.0) for way in (0.0, 120.0, 240.0)]

    assert sliding_mode(roof, DOWN).mode == "falls"
    assert sliding_mode(roof, DOWN).factor == 0.0
    assert sliding_mode(pit, DOWN).mode == "is held"
    assert sliding_mode(pit, DOWN).factor == math.inf
    assert sliding_mode([JointFace("A", -DOWN, 1.0, 0.0, 0.5)], DOWN).factor == math.inf


@pytest.mark.parametrize("ratio", [0.1, 0.5, 0.9])
def test_a_pulse_moves_a_block_by_newmarks_closed_form(ratio):
    strong, lasts, dt = 5.0, 0.2, 1e-3
    ground = -strong * np.minimum(dt * np.arange(4000), lasts)

    way = newmark(ground, dt, ratio * strong)

    end = (strong * lasts) ** 2 / (2.0 * ratio * strong) * (1.0 - ratio)
    assert way[-1] == pytest.approx(end, rel=1e-9)
    assert (np.diff(way) >= 0.0).all()


def test_a_pulse_below_the_resistance_and_one_the_other_way_move_nothing():
    ground = 5.0 * np.minimum(1e-3 * np.arange(400), 0.2)

    assert not newmark(-ground, 1e-3, 5.001).any()
    assert not newmark(ground, 1e-3, 0.1)[:200].any()


def test_a_plate_on_a_joint_is_a_removable_block_with_its_mass_and_seat():
    mesh = structured_box((4, 3, 4), (8.0, 6.0, 8.0), planes={"J": ("z", 6.0)}).split(["J"])
    own = {"kn": 2e9, "ks": 1e9, "cohesion": 1e4, "friction": 0.5, "tension": 0.0}
    model = Model(mesh, {"rock": ROCK}, [Joint("J", "coulomb", own)], [Viscous("bottom")])

    (block,) = loose_blocks(model, ("top", "west", "east", "south", "north"))

    assert block.volume == pytest.approx(8.0 * 6.0 * 2.0)
    assert block.mass == pytest.approx(ROCK.density * block.volume)
    (plane,) = block.planes
    assert plane.normal == pytest.approx([0.0, 0.0, 1.0])
    assert (plane.joint, plane.area) == ("J", pytest.approx(48.0))
    assert (plane.cohesion, plane.friction) == (1e4, 0.5)
    assert model.nodes.points[block.base, 2] == pytest.approx(6.0)
    assert loose_blocks(model, ("top",)) == []


def watched(model, duration=0.1):
    prepared = prepare(model, duration)
    observer = JointObserver(model, prepared, 100.0)
    return observer, simulate(model, duration, prepared=prepared, observer=observer)


def test_safety_at_rest_is_strength_over_shear_and_falls_to_one_where_all_slips():
    calm, moved = (
        replace(model, joints=[replace(model.joints[0], insitu_shear=(0.0, 1e5, 0.0))])
        for model in (sheared(0.01), sheared(4.0))
    )

    (still, _), (slid, run) = watched(calm), watched(moved)

    before = still.records["history"][0, 0, 3]
    assert before == pytest.approx((2e5 + 0.3 * 1e5) / 1e5, rel=1e-6)
    assert still.records["history"][:, 0, :3].max() == 0.0
    slip, _, area, safety = slid.records["history"][:, 0].T
    assert 1.0 <= safety.min() < 1.01  # not all contacts slip in quite the same direction
    assert area[-1] == pytest.approx(100.0)
    assert slip.max() == slid.records["largest_slip"].max() > 1e-4
    assert (np.diff(area) >= 0.0).all()
    assert slid.by_surface(run.state)["J"].failed == len(slid.area)


def test_an_interrupted_run_goes_on_with_what_its_joints_did(tmp_path):
    model, path = sheared(0.4), tmp_path / "checkpoint.h5"
    whole, _ = watched(model)

    def stop(_, done, total):
        if done > total // 2:
            raise KeyboardInterrupt

    prepared = prepare(model, 0.1)
    first = JointObserver(model, prepared, 100.0)
    with pytest.raises(KeyboardInterrupt):
        simulate(model, 0.1, prepared=prepared, observer=first, progress=stop, checkpoint=path)
    later = JointObserver(model, prepared, 100.0)
    simulate(model, 0.1, prepared=prepared, observer=later, resume=path)

    for name, values in whole.records.items():
        assert np.array_equal(values, later.records[name]), name


ROW = {
    "has_strength": True, "slips": False, "largest_slip": 0.0, "margin": 2.0, "high": 3.2,
    "level_by": "AS 2187.2-1993", "share_below_margin": 0.84, "safety_before": 1.5,
    "safety_least": 1.2, "safety_after": 1.5,
}  # fmt: skip


def test_a_joint_that_holds_is_sure_only_if_95_percent_of_blasts_stay_below_its_slip():
    unsure, sure = (sentence({"F7": ROW | {"high": high}}, []) for high in (3.2, 1.9))

    assert "F7 does not slip" in unsure
    assert "not sure at 95 %" in unsure
    assert "so it is sure at 95 %" in sure


def test_a_joint_that_slips_says_how_far_where_and_when():
    row = ROW | {
        "slips": True, "largest_slip": 2.1e-3, "slip_at": (66.0, 45.0, -45.0), "slip_time": 0.12,
        "yielded_area": 30.0, "area": 120.0, "remaining_slip": 1.5e-3, "largest_opening": 0.0,
    }  # fmt: skip

    said = sentence({"F7": row, "F1": row | {"has_strength": False}}, [])

    for part in ("2.1 mm at (66, 45, -45) m", "120 ms", "25 % of its 120 m2", "1.5 mm remain",
                 "1.5 before, 1.2 at least", "By their law never slip: F1"):  # fmt: skip
        assert part in said


def test_a_block_that_does_not_stand_under_its_weight_is_said_not_to_slide_by_nothing():
    row = {
        "volume": 2.0, "mass": 5e3, "centre": [1.0, 2.0, 3.0], "mode": "slides on F1",
        "safety_before": 0.8, "safety_least": 0.7, "slides": math.inf,
    }  # fmt: skip

    said = sentence({}, [row])

    assert "safety 0.8 under its weight alone, so it does not stand" in said
    assert "Newmark" not in said
