"""Project files whose ground can't be built as asked are refused, others are built as asked."""

from copy import deepcopy

import numpy as np
import pytest
from small_site import TABLES

from pyblast.config.config import check_config
from pyblast.errors import InputError
from pyblast.mesh.gmsh import MeshingError
from pyblast.project import checks
from pyblast.project.project import make_project

PULSE = "time_s,force_n\n" + "\n".join(
    f"{t:.4f},{1e6 * np.sin(np.pi * t / 0.2) ** 2:.6g}" for t in np.arange(0.0, 0.2, 1e-3)
)
BOX = {"size_m": [120.0, 90.0, 60.0], "origin_m": [0.0, 0.0, -60.0], "frequency_hz": 20.0,
       "layers": [{"material": "rock"}]}  # fmt: skip


@pytest.fixture
def project(tmp_path):
    """Return a function that makes a project with a force, and other tables."""
    (tmp_path / "hammer.csv").write_text(PULSE)

    def made(mesh=None, force=(30.0, 40.0, -10.0), receiver=(90.0, 50.0), **tables):
        table = deepcopy(TABLES)
        for name in ("blast", "holes_inside", "diagnosis"):
            del table[name]
        table["mesh"] = {**BOX, **(mesh or {})}
        faults = table["mesh"].get("faults", [])
        table["joints"] = {part["name"]: TABLES["joints"]["J1"] for part in faults}
        table["point_forces"] = [
            {"position_m": list(force), "direction": [0.0, 0.0, 1.0], "file": "hammer.csv"}
        ]
        table["receivers"] = [{"name": "R1", "position_m": list(receiver)}]
        return make_project(check_config(table | tables), tmp_path / "project.toml")

    return made


def fault(dip, towards, through, **more):
    return {"name": "F", "dip_deg": dip, "dip_direction_deg": towards, "through_m": through, **more}


@pytest.mark.parametrize(("towards", "side", "at"), [(90.0, "east", 120.0), (270.0, "west", 0.0)])
def test_a_free_face_stands_where_the_file_puts_it(project, towards, side, at):
    through = [100.0 if side == "east" else 20.0, 45.0, 0.0]
    viscous = [s for s in TABLES["boundaries"]["viscous"] if s != side]
    ground = project(
        {"faults": [fault(45.0, towards, through)]},
        boundaries={"viscous": viscous, "free": ["top", side]},
    ).meshed

    x = ground.mesh.points[np.unique(ground.mesh.surfaces[side]), 0]
    assert np.abs(x - at).max() < 1e-6
    assert all(row.good for row in ground.rows)


@pytest.mark.parametrize("length", [30.0, 34.0, 60.0])
def test_a_limited_fault_has_its_size_whatever_its_strike(project, length):
    asked = fault(90.0, 0.0, [62.0, 48.0, -15.0], extent_m=[length, 30.0])
    rows = {
        row.quantity: row for row in project({"faults": [asked]}).meshed.rows if row.name == "F"
    }

    assert rows["area, m2"].built == pytest.approx(length * 30.0, rel=1e-6)
    assert rows["from x, m"].built == pytest.approx(62.0 - 0.5 * length, abs=1e-6)


def test_ground_that_no_builder_gives_is_refused_with_both_figures(project, monkeypatch):
    closed = {"viscous": ["west", "east", "south", "north"], "free": ["top", "bottom"]}
    one = project({"kind": "tetrahedra", "edge_m": 15.0}, boundaries=closed)
    other = project({"kind": "tetrahedra", "edge_m": 15.0}).meshed.mesh
    other.points[:, 2] *= 1.2
    monkeypatch.setattr("pyblast.simulation.recipe.make_mesh", lambda *_, **__: other)

    with pytest.raises(
        InputError, match=r"bottom, position .*: asked -60, built -72 \(tolerance 3"
    ):
        _ = one.meshed


def test_a_set_that_nearly_meets_a_fault_keeps_its_area(project):
    box = {"size_m": [162.0, 162.0, 54.0], "origin_m": [0.0, 0.0, -54.0], "quadratic": True}
    joints = {"name": "S", "dip_deg": 73.0, "dip_direction_deg": 90.0, "spacing_m": 28.3}
    planes = {"faults": [fault(90.0, 90.0, [56.0, 77.6, -27.0])], "joint_sets": [joints]}
    one = project(
        {"kind": "tetrahedra", **box, **planes},
        joints={name: TABLES["joints"]["J1"] for name in ("F", "S")},
        materials={"rock": {"density_kg_per_m3": 2600, "cp_m_per_s": 3400, "cs_m_per_s": 1900}},
    )

    area = {row.name: row for row in one.meshed.rows if row.quantity == "area, m2"}

    assert area["S"].built == pytest.approx(area["S"].asked, rel=1e-3)


def test_blocks_that_no_mesher_fills_say_which_surfaces_nearly_meet(project, monkeypatch):
    def failing(*_):
        raise MeshingError("build_mesh: gmsh could not fill the blocks (PLC Error)")

    monkeypatch.setattr("pyblast.mesh.builder.mesh_cells", failing)
    near = {"kind": "tetrahedra", "edge_m": 15.0, "tolerance_m": 0.01,
            "faults": [fault(90.0, 0.0, [60.0, 89.8, -30.0])]}  # fmt: skip

    message = r"0\.2 m near \(.*, 89\.9, .*\) m, is where F, bottom, .*north.* meet"
    with pytest.raises(InputError, match=message):
        _ = project(near).meshed


def test_tetrahedra_get_their_edges_from_the_frequency(project):
    one = project({"fractures": [], "grid_cells": None, "refinements": [
        {"name": "fine", "box_m": [[0, 40], [0, 40], [-20, 0]], "edge_m": 8.0}]})  # fmt: skip

    assert not one.mesh.hexahedral
    assert one.model.mean_edges()["rock"] == pytest.approx(1600.0 / (10.0 * 20.0), rel=0.3)


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        ({"receiver": (90.0, 50.0, 16.0)}, r"receivers\.R1: lies 16 m above the ground: z is 16 m"),
        ({"force": (30.0, 40.0, 12.0)}, r"point_forces\[1\]: lies 12 m above the ground"),
        (
            {"boundaries": {**TABLES["boundaries"], "free": ["nowhere"]}},
            r"boundaries\.free: no surface 'nowhere'; there are west, east",
        ),
    ],
)
def test_what_is_not_in_the_ground_is_refused(project, parts, message):
    with pytest.raises(InputError, match=message):
        _ = project(**parts).model


def test_a_place_above_a_full_space_is_told_the_top_of_the_box_without_its_layer(project):
    sides = {"viscous": [*TABLES["boundaries"]["viscous"], "top"]}

    with pytest.raises(InputError, match=r"lies 40 m above the box: .* the box ends at 0 m below"):
        _ = project(boundaries=sides, force=(30.0, 40.0, 40.0), receiver=(90.0, 50.0, -9.0)).model
    with pytest.raises(InputError, match=r"receivers\.R1: lies \d+ m above the box"):
        _ = project(boundaries=sides).model  # without a height


def grid(low, high, cell=10.0, hole=None):
    """Return the lines of a table of heights on a grid."""
    x, y = np.meshgrid(*(np.arange(a, b + 0.1, cell) for a, b in zip(low, high, strict=True)))
    rows = np.column_stack([x.ravel(), y.ravel(), 0.02 * x.ravel()])
    if hole is not None:
        rows = rows[np.linalg.norm(rows[:, :2] - hole, axis=1) > 15.0]
    return "x_m,y_m,z_m\n" + "\n".join(",".join(f"{v:.3f}" for v in row) for row in rows) + "\n"


@pytest.mark.parametrize(
    ("table", "covered"),
    [
        (grid((3e5, 5e6), (3e5 + 120, 5e6 + 90)), "covers 0 %"),
        (grid((0, 0), (60, 90)), r"covers 5\d\.?\d* %"),
        (grid((-10, -10), (130, 100), hole=(60, 40)), r"covers 9\d\.\d %"),
        ("x_m,y_m,z_m\n0,0,0\n60,45,0\n120,90,0\n", "lie on a line"),
    ],
)
def test_a_survey_that_does_not_cover_the_box_is_refused(project, tmp_path, table, covered):
    (tmp_path / "survey.csv").write_text(table)

    with pytest.raises(InputError, match=covered):
        _ = project({"surface_file": "survey.csv"}).ground.surface


def test_a_survey_may_end_half_a_cell_before_the_box(project, tmp_path):
    (tmp_path / "survey.csv").write_text(grid((5, 5), (115, 85)))

    assert project({"surface_file": "survey.csv"}).ground.surface.shape == (108, 3)


def test_a_receiver_on_a_joint_gets_the_side_whose_motion_it_takes(project):
    one = project({"faults": [fault(90.0, 90.0, [60.0, 45.0, 0.0])]}, receiver=(60.0, 50.0, -30.0))

    check = checks.check(one)

    (row,) = (row for row in check.ground_as_built if row.quantity.startswith("side of F"))
    assert row.name == "receivers.R1"
    assert row.built in ("west", "east")
    (found,) = (finding for finding in check.findings if finding.code == "D39")
    assert f"receivers.R1 the {row.built} side of F" in found.text
    assert not found.failed
