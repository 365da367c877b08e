"""Survey of what a mesh became: it sees each way in which a ground can differ from its file."""

from dataclasses import replace

import numpy as np
import pytest

from pyblast.mesh.as_built import as_built, positions_as_built
from pyblast.mesh.builder import build_mesh
from pyblast.mesh.grid import Fault, Geometry, JointSet, Layer, structured_box
from pyblast.mesh.hexahedral import mapped

BOX = np.array([[0.0, 120.0], [0.0, 90.0], [-60.0, 0.0]])
OPEN = ("west", "east", "south", "north", "bottom")
STANDING = frozenset({"top"})
WAVE = 50.0
ROCK = (Layer("rock"),)


def fault(dip, towards, through=(60.0, 45.0, 0.0), **more):
    return Fault("F", np.radians(dip), np.radians(towards), through, **more)


def asked(faults=(), sets=(), layers=ROCK, standing=STANDING, surface=None):
    return Geometry(BOX, tuple(layers), tuple(sets), tuple(faults), surface, frozenset(standing))


def hexahedra(ground):
    return mapped.build_mapped(ground, [30.0] * len(ground.layers), 3)


def wrong(mesh, ground):
    return {(row.name, row.quantity) for row in as_built(mesh, ground, WAVE) if not row.good}


@pytest.mark.parametrize(
    "faults", [(), [fault(60, 90)], [fault(90, 0, (60.0, 45.0, -30.0))], [fault(30, 200)]]
)
def test_a_ground_as_asked_has_no_row_beyond_its_tolerance(faults):
    ground = asked(faults, [JointSet("S", 0.0, 0.0, 20.0)] if not faults else ())

    for mesh in (
        hexahedra(ground),
        build_mesh(BOX, ground.layers, ground.joint_sets, faults, edge=15.0),
    ):
        assert wrong(mesh, ground) == set()


@pytest.mark.parametrize(
    ("other", "rows"),
    [
        (fault(61, 90), {"dip, degrees"}),
        (fault(60, 92), {"dip direction, degrees"}),
        (fault(60, 90, (64.0, 45.0, 0.0)), {"distance of its worst node, m"}),
        (fault(60, 90, (60.0, 45.0, -30.0), extent=(50.0, 40.0)), {"area, m2"}),
    ],
)
def test_a_fault_elsewhere_is_seen(other, rows):
    mesh = hexahedra(asked([fault(60, 90)]))

    assert rows <= {quantity for _, quantity in wrong(mesh, asked([other]))}


def test_a_side_elsewhere_is_seen_with_both_places():
    ground = asked(standing={"top", "east"})
    mesh = hexahedra(ground)
    ground = replace(ground, box=BOX + np.array([[0.0, 3.0], [0.0, 0.0], [0.0, 0.0]]))

    (row,) = (row for row in as_built(mesh, ground, WAVE) if row.name == "east")

    assert not row.good
    assert "asked 123, built 120" in str(row)


def test_planes_and_spacing_of_a_set_are_counted():
    ground = asked(sets=[JointSet("S", np.pi / 2, np.pi / 2, 30.0)])
    mesh = hexahedra(ground)
    other = asked(sets=[JointSet("S", np.pi / 2, np.pi / 2, 15.0)])

    rows = {row.quantity: row for row in as_built(mesh, ground, WAVE) if row.name == "S"}

    assert (rows["planes"].built, rows["spacing, m"].built) == pytest.approx((3.0, 30.0))
    assert ("S", "planes") in wrong(mesh, other)


def test_a_layer_that_is_bent_is_seen():
    ground = asked(layers=[Layer("soil", 20.0), Layer("rock")])
    mesh = hexahedra(ground)
    bent = mesh.points + np.outer(np.sin(mesh.points[:, 0] / 20.0), [0.0, 0.0, 3.0])

    found = wrong(replace(mesh, points=bent), ground)

    assert ("soil on rock", "height of its worst node, m") in found


def test_the_area_of_a_plane_under_a_hill_is_that_of_a_closed_form():
    ramp = np.array([[x, y, 40.0 - 0.5 * x] for x in (0.0, 120.0) for y in (0.0, 90.0)])
    ground = asked([fault(90, 0)], surface=ramp)
    flat = hexahedra(asked([fault(90, 0)]))

    (row,) = (r for r in as_built(flat, ground, WAVE) if (r.name, r.quantity) == ("F", "area, m2"))

    assert row.asked == pytest.approx(120.0 * 100.0 - 0.5 * 120.0 * 60.0, rel=1e-3)
    assert row.built == pytest.approx(120.0 * 60.0, rel=1e-9)


def test_layers_that_follow_a_surface_are_judged_by_their_depth_under_it():
    ramp = np.array([[x, y, 0.1 * x] for x in (0.0, 120.0) for y in (0.0, 90.0)])
    thick, thin = (
        asked([], [JointSet("S", np.pi / 2, 0.0, 30.0, regions=("rock",))], surface=ramp,
              layers=[Layer("soil", height, follows_surface=True), Layer("rock")])
        for height in (6.0, 3.0)
    )  # fmt: skip
    mesh = hexahedra(thick)

    assert wrong(mesh, thick) == set()
    found = {row for row in as_built(mesh, thin, WAVE) if not row.good}
    assert {row.quantity.split(",")[0] for row in found if row.name == "soil on rock"} == {
        "root mean square distance from its depth",
        "largest mean distance from its depth over a tenth of a wavelength",
    }
    away = next(row for row in found if row.quantity.startswith("root mean square"))
    assert away.built == pytest.approx(3.0, rel=1e-6)
    assert ("S", "area, m2") in {(row.name, row.quantity) for row in found}
    (depth,) = (row for row in positions_as_built(mesh, thick, {"R": np.array([60.0, 45.0, 6.0])})
                if row.quantity == "depth of rock below the ground, m")  # fmt: skip
    assert (depth.asked, depth.built) == pytest.approx((6.0, 6.0), abs=1e-6)


def test_the_ground_under_positions_that_stand_on_it_is_judged():
    ramp = np.array([[x, y, 0.1 * x] for x in (0.0, 120.0) for y in (0.0, 90.0)])
    ground = asked(surface=ramp)
    mesh = hexahedra(ground)
    lower = replace(
        mesh, points=mesh.points - [0.0, 0.0, 3.0], places=mesh.places - [0.0, 0.0, 3.0]
    )
    positions = {"on": (60.0, 40.0), "surveyed": (30.0, 40.0, 3.5), "deep": (30.0, 40.0, -20.0),
                 "below": (90.0, 50.0, 7.5), "beside": (200.0, 40.0)}  # fmt: skip

    def judged(mesh):
        rows = as_built(mesh, ground, WAVE, positions)
        return {row.name: row for row in rows if row.name in positions}

    assert {name: row.good for name, row in judged(mesh).items()} == {"on": True, "surveyed": True}
    wrong = {name: (row.quantity, row.asked, row.built) for name, row in judged(lower).items()}
    assert wrong == {
        "on": ("height of the ground there, m", pytest.approx(6.0), pytest.approx(3.0)),
        "surveyed": (
            "height of the ground there, m",
            pytest.approx(3.0),
            pytest.approx(0.0, abs=1e-6),
        ),
        "below": ("outside of the ground, m", 0.0, pytest.approx(1.5, abs=0.02)),
    }


def step_at(x):
    """Return the triangles of ground that steps down by 9 m."""
    upper = [[[0, 0, 0], [x, 0, 0], [x, 90, 0]], [[0, 0, 0], [x, 90, 0], [0, 90, 0]]]
    lower = [[[x, 0, -9], [120, 0, -9], [120, 90, -9]], [[x, 0, -9], [120, 90, -9], [x, 90, -9]]]
    return np.array(upper + lower, dtype=float)


def test_a_crest_elsewhere_is_seen():
    mesh = build_mesh(BOX, ROCK, edge=15.0, surface=step_at(60))

    assert wrong(mesh, asked(surface=step_at(60))) == set()
    assert ("top", "share of its plan at another height") in wrong(mesh, asked(surface=step_at(62)))


def test_a_point_of_a_fault_above_the_ground_is_said():
    ground = asked([fault(60, 90, (60.0, 45.0, 7.0))])

    rows = {row.quantity: row for row in as_built(hexahedra(ground), ground, WAVE)}

    assert rows["its point above the ground, m"].built == pytest.approx(7.0)
    assert rows["its point above the ground, m"].good


def test_ground_of_benches_has_the_height_of_its_crest():
    ground = asked(surface=step_at(60))
    mesh = build_mesh(BOX, ROCK, edge=15.0, surface=ground.surface)
    positions = {"upper": (30.0, 40.0), "crest": (60.0, 40.0), "toe": (60.1, 40.0)}

    rows = [row for row in as_built(mesh, ground, WAVE, positions) if row.name in positions]

    assert [row.asked for row in rows] == pytest.approx([0.0, 0.0, -9.0])
    assert all(row.good for row in rows)


def test_a_position_on_a_joint_has_a_side_and_its_layer_a_depth():
    ground = asked([fault(90, 90)], layers=[Layer("soil", 20.0), Layer("rock")])
    mesh = hexahedra(ground).split(["F"])

    rows = positions_as_built(
        mesh,
        ground,
        {"on": (60.0, 40.0, -30.0), "off": (60.01, 40.0, -30.0), "up": (9.0, 9.0, 7.0)},
    )

    on = [(row.name, row.built) for row in rows if row.quantity.startswith("side of F")]
    assert on == [("on", "west")] or on == [("on", "east")]
    depth = [row.built for row in rows if row.quantity == "depth of rock below the ground, m"]
    assert depth == pytest.approx([20.0] * 3)
    assert [(row.name, row.built) for row in rows if not row.good] == [("up", pytest.approx(7.0))]


def test_joints_of_a_mesh_that_was_read_are_described():
    mesh = structured_box((4, 3, 2), (40.0, 30.0, 20.0), planes={"J": ("x", 20.0)})

    rows = {row.quantity: row.built for row in as_built(mesh, None)}

    assert rows["area, m2"] == pytest.approx(600.0)
    assert rows["dip, degrees"] == pytest.approx(90.0)
