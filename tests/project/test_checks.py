"""Regression values: section 7 of the project's notes on Babanouri et al. (2013)."""

import math

import numpy as np
import pytest
from small_project import written

from pyblast.blasts.blast import Firing
from pyblast.errors import Finding
from pyblast.model.joint import Joint
from pyblast.model.material import Damping, Material
from pyblast.project import checks as checks_loads
from pyblast.project import checks_ground
from pyblast.project.checks import check
from pyblast.project.checks_ground import frequency_of_edge
from pyblast.project.places import face_distance
from pyblast.project.project import load_project

SOIL = Material(2000.0, 125e6, 57.7e6, cohesion=15e3)
SCHIST = Material(2660.0, 15.6e9, 7.2e9, cohesion=11e6)
MAGNETITE = Material(4500.0, 32.1e9, 14.8e9, cohesion=20.5e6)
FIRING = Firing.rows(4, 15, 0.04)
FAULT = Joint("F1", "elastic", {"kn": 0.114e9, "ks": 0.025e9})


def joint(kn, ks):
    return Joint("J", "elastic", {"kn": kn * 1e9, "ks": ks * 1e9})


@pytest.mark.parametrize(
    ("material", "hz"),
    [(SOIL, 3.4), (SCHIST, 32.9), (MAGNETITE, 36.3)],
    ids=["soil", "schist", "ore"],
)
def test_d1_frequency_carried_by_five_metre_zones(material, hz):
    assert frequency_of_edge(material.cs, 5.0) == pytest.approx(hz, abs=0.05)


def test_d1_says_what_the_soil_carries_and_what_more_would_cost():
    finding = checks_loads.coarse_zones("soil", SOIL, 5.0, 1e5, 20.0)

    assert not finding.failed  # whether a receiver suffers by it says D40
    assert finding.numbers["carried_8"] == pytest.approx(4.25, abs=0.01)
    assert finding.numbers["needed_edge"] == pytest.approx(0.85, abs=0.005)
    assert finding.numbers["zones_now"] == pytest.approx(6.8e3, rel=0.01)
    assert finding.numbers["zones_needed"] == pytest.approx(1.4e6, rel=0.02)


def test_d1_asks_three_edges_of_zones_with_15_nodes(tmp_path):
    project = load_project(written(tmp_path, ("[[mesh.layers]]\nmaterial = \"soil\"",
                           "quadratic = true\n[[mesh.layers]]\nmaterial = \"soil\"")))  # fmt: skip
    summary = check(project).summary
    carried = {group.name: group.highest_frequency for group in summary.groups}

    found = [f for f in check(project).findings if f.code == "D1"]

    assert [f.numbers["carried"] for f in found] == [pytest.approx(carried["soil"])]
    assert checks_loads.coarse_zones("soil", SOIL, 2.7, 1e5, 20.0, 3.0) is None


def test_d1_the_rocks_pass():
    assert checks_loads.coarse_zones("schist", SCHIST, 5.0, 1e5, 20.0) is None
    assert checks_loads.coarse_zones("magnetite", MAGNETITE, 5.0, 1e5, 20.0) is None


def test_d2_wavelengths_at_four_hertz():
    finding = checks_ground.short_model(300.0, {"schist": SCHIST, "ore": MAGNETITE}, 4.0)

    assert [
        finding.numbers[k] for k in ("p_schist", "s_schist", "p_ore", "s_ore")
    ] == pytest.approx([769.0, 411.0, 848.0, 453.0], abs=0.6)


def test_d2_a_long_model_passes():
    assert checks_ground.short_model(900.0, {"schist": SCHIST, "ore": MAGNETITE}, 4.0) is None


def test_d3_the_comb_of_four_rows():
    finding = checks_loads.firing_comb(FIRING, 4.0, 20.0)

    zeros = [finding.numbers[f"zero_{n}"] for n in (1, 2, 3)]
    assert zeros == pytest.approx([6.25, 12.5, 18.75], abs=0.006)
    assert finding.numbers["corner"] == pytest.approx(2.85, abs=0.01)
    assert finding.numbers["level"] == pytest.approx(0.47, abs=0.005)
    assert finding.numbers["lobe_1"] == pytest.approx(0.27, abs=0.005)
    assert "9.15 Hz" in finding.text
    assert "15.85 Hz" in finding.text


def test_d3_the_level_is_the_closed_form():
    f = np.array([1.0, 4.0, 11.0])

    closed = np.abs(np.sin(4.0 * np.pi * 0.04 * f) / (4.0 * np.sin(np.pi * 0.04 * f)))

    assert FIRING.comb_spectrum(f) == pytest.approx(closed, abs=1e-6)


def test_d3_a_single_hole_has_no_comb():
    assert checks_loads.firing_comb(Firing(np.zeros(1), 1.0), 4.0, 20.0) is None


def test_d4_the_comb_returns_just_above_the_filter(tmp_path):
    low_passed = load_project(written(tmp_path)).input.low_passed

    finding = checks_loads.comb_return(FIRING, 4.0, low_passed)

    assert finding.numbers["returns"] == pytest.approx(25.0, abs=0.01)
    assert finding.numbers["band_level"] == pytest.approx(0.25, abs=0.001)
    assert 0.0 < finding.numbers["removed_energy"] < 1.0


def test_d6_the_edge_of_the_face_is_far():
    finding = checks_loads.plane_load(39.0, 150.0, MAGNETITE, 20.0)

    assert finding.numbers["edge"] == pytest.approx(155.0, abs=0.5)
    assert finding.numbers["ratio"] == pytest.approx(4.0, abs=0.05)
    assert finding.numbers["lag"] == pytest.approx(0.68, abs=0.01)


def test_d7_stress_per_velocity_of_three_materials():
    finding = checks_loads.layered_face("west", {"soil": SOIL, "schist": SCHIST, "ore": MAGNETITE})

    found = [finding.numbers[f"{w}_{n}"] / 1e6 for n in ("soil", "schist", "ore") for w in "ps"]
    assert found == pytest.approx([1.27, 0.68, 16.37, 8.75, 30.55, 16.32], abs=0.01)


def test_d8_the_fault_is_a_low_pass():
    finding = checks_ground.fault_low_pass("F1", FAULT.tangents(0.0), "schist", SCHIST, 4.0, 20.0)

    assert finding.numbers["corner_p"] == pytest.approx(4.4, abs=0.05)
    assert finding.numbers["corner_s"] == pytest.approx(1.8, abs=0.05)
    passed = [finding.numbers[f"t_{w}_{f}"] for f in (2, 4, 6, 10) for w in "ps"]
    expected = [0.91, 0.67, 0.74, 0.41, 0.59, 0.29, 0.41, 0.18]
    assert passed == pytest.approx(expected, abs=0.006)


def test_d9_sensitivity_of_amplitude_to_stiffness():
    finding = checks_ground.fault_low_pass("F1", FAULT.tangents(0.0), "schist", SCHIST, 4.0, 20.0)

    assert finding.numbers["gain_s"] == pytest.approx(0.08, abs=0.005)
    assert finding.numbers["gain_p"] == pytest.approx(0.04, abs=0.005)


def test_d8_a_closing_fault_passes_what_its_tangent_under_the_pressure_passes(tmp_path):
    closing = 'law = "closure"\nclosure_mm = 1\ninsitu_pressure_kpa = 400'
    changes = [
        ('law = "coulomb"', closing), ("cohesion_kpa = 20\nfric", "fric"),
        ("tension_kpa = 0", ""), (', "joints.F1.cohesion_kpa"', ""),
    ]  # fmt: skip
    found = [
        next(f for f in check(load_project(written(tmp_path, *some))).findings if f.code == "D8")
        for some in ([], changes)
    ]

    stiffer = (1.0 + 400e3 / (0.114e9 * 1e-3)) ** 2
    corners = [f.numbers["corner_p"] for f in found]
    assert corners[1] == pytest.approx(stiffer * corners[0])
    assert found[0].numbers["corner_s"] == pytest.approx(found[1].numbers["corner_s"])


@pytest.mark.parametrize(
    ("rock", "stiff", "spacing", "speeds", "least"),
    [
        (SCHIST, joint(1.3, 0.635), 28.0, (-0.23, -0.16), 0.996),
        (SCHIST, joint(1.3, 0.635), 22.0, (-0.27, -0.19), 0.996),
        (MAGNETITE, joint(1.5, 0.734), 20.0, (-0.40, -0.29), 0.990),
        (MAGNETITE, joint(1.5, 0.734), 11.0, (-0.51, -0.41), 0.990),
    ],
)
def test_d11_joints_delay_but_do_not_weaken(rock, stiff, spacing, speeds, least):
    finding = checks_ground.jointed_speeds("J", stiff.tangents(0.0), spacing, "rock", rock, 4.0)

    assert min(finding.numbers["t_p"], finding.numbers["t_s"]) >= least - 5e-4
    found = finding.numbers["speed_p"], finding.numbers["speed_s"]
    assert found == pytest.approx(speeds, abs=0.0061)


def test_d12_the_thickness_that_resonates_at_four_hertz():
    finding = checks_ground.soil_resonance("soil", SOIL, 20.0, SCHIST, 4.0, 20.0)

    assert finding.numbers["thickness_at_centre"] == pytest.approx(10.6, abs=0.05)
    assert finding.numbers["own"] == pytest.approx(169.9 / 80.0, rel=1e-3)


def test_d13_the_air_blast_arrives_before_one_second():
    finding = checks_loads.air_blast_arrival({"R1": 300.0, "far": 900.0}, 0.12, 2.0)

    assert finding.numbers["first"] == pytest.approx(0.88, abs=0.005)
    assert finding.numbers["last"] == pytest.approx(1.0, abs=0.005)


def test_d13_names_the_receivers_in_one_line_without_those_whose_records_end_before():
    text = checks_loads.air_blast_arrival({"a": 34.0, "b": 68.0, "far": 900.0}, 0.02, 2.0).text

    assert "it reaches a from 0.10 to 0.12 s, b from 0.20 to 0.22 s: late" in text
    assert "far" not in text


def test_findings_of_one_kind_are_one_and_say_each_sentence_once():
    first, second, other = (
        Finding("D8", title, text)
        for title, text in (("A", "F1 passes 0.9. Look there."),
                            ("A", "F2 passes 0.8. Look there."), ("B", "F3 passes 0.7."))
    )  # fmt: skip

    kinds = checks_loads.one_a_kind([first, other, second])

    assert [one.text for one in kinds] == ["F1 passes 0.9. Look there. F2 passes 0.8.", other.text]


def test_d13_is_silent_where_the_record_ends_before():
    assert checks_loads.air_blast_arrival({"R1": 300.0}, 0.12, 0.8) is None


def test_d16_rayleigh_damping_off_centre():
    finding = checks_ground.rayleigh_price(Damping(0.0112, 4.0), 0.6e-3)

    ratios = [100 * finding.numbers[f"ratio_{f}"] for f in (1, 2, 4, 8, 20)]
    assert ratios == pytest.approx([2.38, 1.40, 1.12, 1.40, 2.91], abs=0.006)
    assert finding.numbers["factor"] == pytest.approx(0.50, abs=0.005)


def test_d16_five_percent_cost_more():
    finding = checks_ground.rayleigh_price(Damping(0.05, 4.0), 0.6e-3)

    assert finding.numbers["factor"] == pytest.approx(0.15, abs=0.005)


def test_d17_fifteen_holes_in_phase_exceed_the_cohesion():
    finding = checks_loads.yielding_rock(0.254, FIRING, "magnetite", MAGNETITE)

    assert finding.numbers["single"] == pytest.approx(3.9e6, abs=0.05e6)
    assert finding.numbers["velocity"] == pytest.approx(3.8, abs=0.02)
    assert finding.numbers["together"] == pytest.approx(58e6, abs=0.5e6)


def test_d17_a_weak_blast_passes():
    assert checks_loads.yielding_rock(0.05, FIRING, "magnetite", MAGNETITE) is None


def test_d18_infill_of_ten_to_fifty_centimetres():
    finding = checks_ground.infill_as_layer("F1", FAULT, [0.1, 0.5])

    moduli = [finding.numbers[k] / 1e6 for k in ("m_1", "m_2", "g_1", "g_2")]
    assert moduli == pytest.approx([11.4, 57.0, 2.5, 12.5], rel=1e-6)
    assert finding.numbers["poisson"] == pytest.approx(0.36, abs=0.005)
    assert "kn up to 0.5 and ks up to 0.1 GPa/m, as here" in finding.text


def test_d18_says_where_a_stiffness_is_not_that_of_clay_so_thick():
    finding = checks_ground.infill_as_layer("F1", FAULT, [0.015])

    assert finding.numbers["published"] == 0.0
    assert "kn 0.5 to 2 and ks 0.1 to 0.6 GPa/m, not as here" in finding.text


def test_d20_the_charge_fits():
    finding = checks_loads.charge_fits(450.0, 0.25, 17.0)

    assert finding.numbers["length"] == pytest.approx(10.8, abs=0.05)
    assert not finding.failed


def test_d20_too_large_a_charge_fails():
    assert checks_loads.charge_fits(900.0, 0.25, 17.0).failed


def test_a_check_names_the_coarse_material(tmp_path):
    found = check(load_project(written(tmp_path)))

    first = found.findings[0]

    assert found.failed  # by D40: the run holds a part of the band of the blast
    assert first.code == "D1"
    assert "'soil'" in first.title


def test_a_check_finds_both_readings_of_the_boundaries(tmp_path):
    literal = written(tmp_path, ('free = ["top"]', "viscous_and_fixed = true"))

    found = check(load_project(literal))

    assert "east, south, north, bottom" in next(f.text for f in found.findings if f.code == "D5")


def test_volumes_and_masses_of_the_materials_add_up(tmp_path):
    summary = check(load_project(written(tmp_path))).summary

    volume = {g.name: g.volume for g in summary.groups}

    assert volume == pytest.approx({"soil": 60 * 20 * 10.0, "rock": 60 * 20 * 20.0})
    assert sum(g.mass for g in summary.groups) == pytest.approx(12000 * 2000.0 + 24000 * 2660.0)
    assert (summary.zones, summary.blocks) == (6 * 2 * 3 * 6, 2)


def test_the_time_is_estimated_by_marching_a_few_steps(tmp_path):
    summary = check(load_project(written(tmp_path))).summary

    assert 0.0 < summary.seconds < 60.0


def test_the_distance_from_the_blast_to_the_face_comes_from_the_holes(tmp_path):
    distance, reach = face_distance(load_project(written(tmp_path)))

    assert distance == pytest.approx(39.0)
    assert math.isclose(reach, 10.0, abs_tol=2.0)
