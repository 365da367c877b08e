"""Sides of a body: what is claimed of them is what waves meet there."""

from pathlib import Path

import numpy as np
import pytest
from library_scene import scene

from pyblast.diagnosis.hypotheses import LIBRARY
from pyblast.diagnosis.library.sides import sides_of, with_kind
from pyblast.project.project import Project
from pyblast.solver.run import simulate

DEPTH, RATE = 0.2, 1e-7  # m, s
BAND = [50e3, 100e3]
MIDDLE = np.sqrt(BAND[0] * BAND[1])
ROCK = {"density_kg_per_m3": 2980.0, "cp_m_per_s": 6200.0, "cs_m_per_s": 3600.0}
STEEL = {"density_kg_per_m3": 7850.0, "cp_m_per_s": 5900.0, "cs_m_per_s": 3230.0}


def column(folder, *further, height=DEPTH):
    """Return a column of rock under an even pressure on its top, sides on rollers: waves of one
    dimension."""
    times = RATE * np.arange(200)
    pulse = np.sin(np.pi * np.minimum(times / 8e-6, 1.0)) ** 2
    rows = "\n".join(f"{t:.7f},{p:.6f}" for t, p in zip(times, pulse, strict=True))
    (Path(folder) / "pressure.csv").write_text(f"time_s,pressure_pa\n{rows}\n")
    layers = [{"material": "rock"}] if not further else [
        {"material": "rock", "thickness_m": DEPTH}, *further]  # fmt: skip
    return Project.from_dict(
        {
            "title": "column",
            "mesh": {"size_m": [0.04, 0.04, height], "origin_m": [0.0, 0.0, -height],
                     "layers": layers, "frequency_hz": 110e3, "accuracy": 0.003},
            "materials": {"rock": ROCK, "steel": STEEL},
            "boundaries": {"roller": ["west", "east", "south", "north"],
                           "free": ["top", "bottom"]},
            "pressures": [{"surface": "top", "file": "pressure.csv"}],
            "receivers": [{"name": "A", "position_m": [0.02, 0.02, 0.0]}],
            "run": {"duration_s": 1.2e-4, "compare_band_hz": BAND},
        },
        folder,
    )  # fmt: skip


def echo(project):
    """Return the echo of the bottom over the motion under the load, in the middle of the band."""
    run = simulate(project.model, project.duration)
    record = run.seismograms["A"]
    way = 2.0 * DEPTH / ROCK["cp_m_per_s"]
    early = record.times < 0.75 * way
    turns = np.exp(-2j * np.pi * MIDDLE * record.times)
    direct, back = (record.velocity[part, 2] @ turns[part] for part in (early, ~early))
    return back / direct * np.exp(2j * np.pi * MIDDLE * way)


@pytest.mark.parametrize(("kind", "reflected"), [("free", 1), ("fixed", -1), ("viscous", 0)])
def test_a_side_reflects_as_it_is_said_to(tmp_path, kind, reflected):
    other = "fixed" if kind == "free" else "free"
    project = with_kind(column(tmp_path), "bottom", other) or column(tmp_path)

    found = echo(LIBRARY[f"side/{kind}"].apply(project, "bottom"))

    assert found == pytest.approx(2.0 * reflected, abs=0.06)


@pytest.mark.parametrize("stiffness", [0.2, 1.0, 5.0])
def test_a_joint_at_a_side_reflects_what_it_does_not_pass(tmp_path, stiffness):
    project = LIBRARY["side/joint"].apply(column(tmp_path), "bottom", stiffness, 2.0)

    # A joint of k in rock of impedance Z reflects 1/(1 + 2 k/(i w Z)) (Schoenberg 1980).
    assert echo(project) == pytest.approx(2.0 / (1.0 - 1j * stiffness), abs=0.08)


def test_what_lies_under_a_layer_can_be_taken_away(tmp_path):
    plate = column(tmp_path, {"material": "steel"}, height=DEPTH + 0.02)

    assert sides_of(plate) == ("west", "east", "south", "north", "bottom", "under rock")
    bare = LIBRARY["side/free"].apply(plate, "under rock")
    assert bare.config.mesh.size_m[2] == pytest.approx(DEPTH)
    assert [layer.material for layer in bare.config.mesh.layers] == ["rock"]
    assert echo(bare) == pytest.approx(2.0, abs=0.06)
    held = LIBRARY["side/joint"].apply(plate, "under rock", 1.0, 2.0)
    assert [joint.surface for joint in held.joints] == ["joint under rock"]
    assert held.config.mesh.size_m == plate.config.mesh.size_m


@pytest.mark.parametrize("side", ["west", "south", "north", "east"])
def test_ground_goes_on_beyond_a_joint_at_an_upright_side(tmp_path, side):
    project = LIBRARY["side/joint"].apply(column(tmp_path), side, 1.0, 2.0)

    wider = np.subtract(project.config.mesh.size_m, column(tmp_path).config.mesh.size_m)
    assert np.count_nonzero(wider) == 1
    assert side in project.config.boundaries.viscous
    assert project.model.joints[0].properties["kn"] == pytest.approx(
        np.pi * MIDDLE * 2980.0 * 6200.0
    )


def test_a_side_that_is_so_already_is_no_hypothesis(tmp_path):
    assert LIBRARY["side/free"].apply(column(tmp_path), "bottom") is None


def test_cuts_through_wider_ground_are_no_sides():
    case = scene().case

    assert LIBRARY["side/free"].targets(case) == ()
    assert "is a cut through wider ground" in LIBRARY["side/joint"].untestable(case)
