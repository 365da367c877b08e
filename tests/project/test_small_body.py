"""A body of millimetres and kilohertz: rules made for blasts neither refuse it nor mislead."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from pyblast.errors import InputError
from pyblast.model.material import ConstantQ, Material
from pyblast.project.checks import check
from pyblast.project.project import load_project
from pyblast.report.figures import section_of_zones
from pyblast.report.run import _section_place

BLOCK = """
title = "A block on a plate"

[mesh]
size_m = [0.3, 0.1, 0.22]
origin_m = [-0.15, -0.05, -0.22]
frequency_hz = 110000.0
accuracy = 0.02

[[mesh.layers]]
material = "rock"
thickness_m = 0.2

[[mesh.layers]]
material = "steel"

[materials.rock]
density_kg_per_m3 = 2980.0
cp_m_per_s = 6200.0
cs_m_per_s = 3600.0

[materials.steel]
density_kg_per_m3 = 7850.0
cp_m_per_s = 5900.0
cs_m_per_s = 3230.0

[boundaries]
viscous = ["west", "east"]
free = ["top", "south", "north", "bottom"]

[[point_forces]]
position_m = [0.0, 0.0, 0.0]
direction = [0, 0, -1]
file = "force.csv"

[[receivers]]
name = "A"
position_m = [0.05, 0.05, -0.07]

[run]
duration_s = 2.0e-4
compare_band_hz = [50000.0, 100000.0]
"""


@pytest.fixture(scope="module")
def findings(tmp_path_factory):
    """Return the findings of a block that a ball strikes for 7 microseconds, by code."""
    folder = tmp_path_factory.mktemp("block")
    times = np.arange(67) * 1e-7
    force = 56.0 * np.sin(np.pi * np.minimum(times / 6.66e-6, 1.0)) ** 1.5
    rows = (f"{t:.7f},{f:.6f}" for t, f in zip(times, force, strict=True))
    (folder / "force.csv").write_text("time_s,force_n\n" + "\n".join(rows) + "\n")
    (folder / "block.toml").write_text(BLOCK)
    return {each.code: each for each in check(load_project(folder / "block.toml")).findings}


def test_no_rule_fails_a_block_whose_mesh_carries_its_band(findings):
    assert not [code for code, each in findings.items() if each.failed]


def test_a_plate_below_is_no_half_space_on_which_a_layer_resonates(findings):
    assert "D12" not in findings


def test_a_pulse_shorter_than_a_period_keeps_what_the_mesh_carries_of_it(findings):
    shares = findings["D40"].numbers

    # Of the spectrum of the rate of sin^1.5 over 6.66 us, squared, up to what is carried.
    times = np.arange(67) * 1e-7
    rate = np.gradient(np.sin(np.pi * np.minimum(times / 6.66e-6, 1.0)) ** 1.5, times)
    power = np.abs(np.fft.rfft(rate, 1 << 16)) ** 2
    below = np.fft.rfftfreq(1 << 16, 1e-7) <= shares["carried"]
    assert shares["energy"] == pytest.approx(power[below].sum() / power.sum(), rel=0.06)


@pytest.mark.parametrize(("north", "place"), [(0.05, 0.0), (-0.05, 0.0), (0.02, 0.02)])
def test_a_section_through_a_receiver_on_an_outer_side_goes_through_the_middle(north, place):
    corners = [[x, y, z] for x in (0.0, 2.0) for y in (-0.05, 0.05) for z in (0.0, 3.0)]
    zones = np.array([[0, 4, 2, 1], [6, 2, 4, 7], [3, 1, 2, 7], [5, 1, 7, 4], [1, 2, 4, 7]])
    mesh = {"points": np.array(corners)}
    receivers = {"A": {"position": [1.0, north, 1.0]}}
    result = SimpleNamespace(arrays={"mesh": mesh}, summary={"receivers": receivers})

    found = _section_place(result)

    assert found == pytest.approx(place)
    assert section_of_zones(mesh["points"], zones, found)[0]


def test_a_refused_pair_of_qualities_names_the_nearest_pairs_that_are_possible():
    rock, law = Material.from_speeds(2980.0, 6200.0, 3600.0), ConstantQ(200.0, 80.0, (3e4, 2e5))

    with pytest.raises(InputError, match=r"give qp 177 with qs 80 or qp 200 with qs 90$"):
        law.properties(rock)

    assert replace(law, qp=177.0).properties(rock) == {}
    assert replace(law, qs=90.0).properties(rock) == {}
    with pytest.raises(InputError, match="gain energy"):
        replace(law, qp=178.2).properties(rock)
