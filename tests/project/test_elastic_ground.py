"""Elastic ground around sources: the level of a law is not a load without bounds."""

import math

import numpy as np
import pytest

from pyblast import Project
from pyblast.errors import InputError
from pyblast.model.ground_fields import elastic_radius
from pyblast.project.elastic_ground import SUFFIX, elastic_finding

SIDE = 80.0
STRENGTH = {"cohesion": 0.8e6, "friction": math.tan(math.radians(38.0)), "tension": 0.2e6}


def box(edge, yields, core=None, holes=1, strong=1.0, **tables):
    """Return a project of a box of schist with holes of 150 kg in its middle, 6 m apart."""
    rock = {
        "density_kg_per_m3": 2700, "young_mpa": 30000, "poisson": 0.25,
        "cohesion_kpa": 800 * strong, "friction_angle_deg": 38, "tension_kpa": 200 * strong,
    } | ({"yielding": {}} if yields else {})  # fmt: skip
    hole = {
        "material": "schist", "charge_kg": 150, "radius_m": 0.5, "peak_time_ms": 23,
        "distance_m": 70, "law": "AS 2187.2-1993",
    }  # fmt: skip
    inside = {"charged_hole": hole, "low_pass_hz": "none"} | ({} if core is None else core)
    middle = SIDE / 2
    return Project.from_dict({
        "title": "holes in a box",
        "mesh": {"size_m": [SIDE] * 3, "edge_m": edge, "kind": "tetrahedra",
                 "layers": [{"material": "schist"}]} | tables.pop("mesh", {}),
        "materials": {"schist": rock},
        "boundaries": {"viscous": ["west", "east", "south", "north", "bottom", "top"]},
        "blast": {"rows": 1, "holes_per_row": holes, "delay_ms": 0, "charge_kg": 150,
                  "diameter_mm": 165, "depth_m": 16, "burden_m": 5, "spacing_m": 6,
                  "position_m": [middle, middle, middle + 12.15]},
        "holes_inside": inside,
        "receivers": [{"name": "R", "position_m": [middle + 35, middle + 1, middle]}],
        "insitu": {"horizontal_ratio": 1.0},
        "run": {"duration_s": 0.14},
    } | tables)  # fmt: skip


def ended(project):
    """Return the work of the sources at the end in J, and the peak at the receiver in m/s."""
    run = project.simulate()
    return run.energy["input"][-1], float(
        np.linalg.norm(run.seismograms["R"].velocity, axis=1).max()
    )


@pytest.mark.parametrize(("pressure", "by"), [(0.27e6, "tension"), (5e6, "shear")])
def test_the_elastic_radius_is_where_the_closed_form_reaches_the_strength(pressure, by):
    ratio, moment = 1.0 / math.sqrt(3.0), 1.2330e11

    r = elastic_radius(moment, ratio, STRENGTH, pressure)

    x = ratio**2 * moment / (2.0 * math.pi * r**3)  # Sharpe (1942): stresses -p0 - 2x and -p0 + x
    most, least = -pressure + x, -pressure - 2.0 * x
    sine = math.sin(math.atan(STRENGTH["friction"]))
    slope = (1.0 + sine) / (1.0 - sine)
    crushed = 2.0 * STRENGTH["cohesion"] * math.sqrt(slope)
    margins = {"tension": STRENGTH["tension"] - most, "shear": crushed - slope * most + least}
    assert margins[by] == pytest.approx(0.0, abs=1.0)
    assert min(margins.values()) > -1.0


def test_the_radius_of_the_study_is_24_metres():
    assert elastic_radius(1.2330e11, 1.0 / math.sqrt(3.0), STRENGTH, 0.27e6) == pytest.approx(
        24.0, abs=0.2
    )


def test_a_hole_puts_into_yielding_ground_what_its_level_has_on_each_mesh():
    work = {}
    for edge in (14.0, 9.0):
        work[edge], peak = ended(box(edge, yields=True))
        elastic, elastic_peak = ended(box(edge, yields=False))
        assert work[edge] == pytest.approx(elastic, rel=0.05)
        assert peak == pytest.approx(elastic_peak, rel=0.05)  # patches of zones move alike

    assert work[9.0] == pytest.approx(work[14.0], rel=0.1)


def test_stronger_ground_outside_changes_little():
    work, strong = (ended(box(9.0, True, strong=factor))[0] for factor in (1.0, 2.0))

    assert strong == pytest.approx(work, rel=0.03)


def test_elastic_ground_keeps_its_group():
    project = box(14.0, yields=False)

    assert project.elastic_ground is None
    assert project.model.mesh.groups == ("schist",)


def test_moments_of_holes_whose_radii_touch_add_up():
    one, five = (box(9.0, True, holes=n).elastic_ground.radius for n in (1, 5))

    edge = 8.5  # mean of the zones at the holes, which is added
    assert len(five) == 5
    assert (five - edge) == pytest.approx((one[0] - edge) * 5.0 ** (1.0 / 3.0), rel=0.1)


def test_a_core_that_reaches_half_of_the_way_to_a_receiver_makes_the_run_incomplete():
    project = box(9.0, yields=True)

    found = elastic_finding(project.elastic_ground, project.receivers)

    assert found.code == "D42"
    assert found.failed
    assert "more than half of the way to R" in found.text
    assert elastic_finding(None, project.receivers) is None


def test_a_stated_core_that_does_not_hold_the_holes_is_refused():
    with pytest.raises(InputError, match=r"core_m: must hold the zones of all holes"):
        _ = box(14.0, yields=True, core={"core_m": 0.1}).model


def test_joints_near_the_holes_are_elastic_and_undamped():
    fault = {"name": "F", "dip_deg": 90, "dip_direction_deg": 90, "through_m": [48, 40, 40]}
    joint = {"kn_gpa_per_m": 5, "ks_gpa_per_m": 2, "cohesion_kpa": 200, "friction_angle_deg": 33,
             "tension_kpa": 0}  # fmt: skip
    project = box(14.0, False, mesh={"faults": [fault]}, joints={"F": joint},
                  damping={"ratio": 0.01, "frequency_hz": 15})  # fmt: skip

    model = project.model

    laws = {each.surface: each.law for each in model.joints}
    contacts = model.mesh.contacts
    near = project.elastic_ground.beyond(model.mesh.points[contacts.minus]) <= 0.0
    assert laws == {"F": "coulomb", "F" + SUFFIX: "elastic"}
    assert np.array_equal(contacts.joint == 1, near)
    assert model.damping["schist"].low_passed
    assert model.damping["schist" + SUFFIX].ratio == 0.0
    assert ended(project)[0] > 0.0
