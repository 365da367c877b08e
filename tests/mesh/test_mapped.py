"""Mapped grids: planes stay planes, sides stand, layers stay level, other ground is refused."""

import numpy as np
import pytest

from pyblast.errors import InputError
from pyblast.mesh.grid import SIDES, Fault, Geometry, JointSet, Layer
from pyblast.mesh.hexahedral.mapped import Fine, build_mapped, divided
from pyblast.mesh.hexahedral.planes import NotMapped
from pyblast.mesh.mesh import quality, zone_volumes
from pyblast.mesh.spectral_nodes import spectral_nodes

BOX = np.array([[0.0, 200.0], [0.0, 150.0], [-60.0, 0.0]])
OPEN = ("west", "east", "south", "north", "bottom")
ROCK = [Layer("rock")]


def built(layers=ROCK, sets=(), faults=(), open_sides=OPEN, sizes=None, surface=None, lines=None):
    standing = frozenset(SIDES) - set(open_sides)
    geometry = Geometry(BOX, tuple(layers), tuple(sets), tuple(faults), surface, standing)
    return build_mapped(geometry, sizes or [40.0] * len(layers), 4, lines)


def fault(dip, towards, through=(100.0, 75.0, 0.0), name="F", **extent):
    return Fault(name, np.radians(dip), np.radians(towards), through, **extent)


def off_plane(mesh, plane):
    """Return the distances of the facets of a plane from it, inside the box."""
    at = mesh.points[mesh.surfaces[plane.name]]
    return (at[at[..., 2] > BOX[2, 0] - 1e-6] - plane.point) @ plane.unit_normal


@pytest.mark.parametrize(("dip", "towards"), [(60.0, 252.0), (35.0, 10.0), (80.0, 135.0)])
def test_a_dipping_fault_is_a_plane_inside_the_model(dip, towards):
    plane = fault(dip, towards)
    nodes = spectral_nodes(built(faults=[plane]).split(["F"]))

    contacts = nodes.contacts
    at = nodes.points[contacts.minus]
    inside = at[:, 2] > BOX[2, 0] - 1e-6
    off = (at - plane.point) @ plane.unit_normal
    assert np.abs(off[inside]).max() < 1e-9
    above = at[:, 2] > BOX[2, 0] + 1e-6
    assert np.abs(np.abs(contacts.normal[above] @ plane.unit_normal) - 1.0).max() < 1e-9
    assert zone_volumes(nodes.mesh).min() > 0.0


def test_a_dipping_fault_stays_a_plane_under_a_surveyed_surface():
    x, y = np.meshgrid(np.linspace(-400.0, 600.0, 41), np.linspace(-400.0, 600.0, 41))
    surface = np.column_stack([x.ravel(), y.ravel(), 8.0 * np.tanh((x.ravel() - 100.0) / 40.0)])
    plane = fault(70.0, 90.0)
    mesh = built(faults=[plane], surface=surface)
    nodes = spectral_nodes(mesh.split(["F"]))

    assert np.abs(off_plane(mesh, plane)).max() < 1e-6
    top = nodes.points[nodes.surfaces["top"]]
    middle = (np.abs(top[..., 0] - 100.0) < 90.0) & (np.abs(top[..., 1] - 75.0) < 70.0)
    assert top[..., 2][middle] == pytest.approx(
        8.0 * np.tanh((top[..., 0][middle] - 100.0) / 40.0), abs=0.4
    )


def test_joints_of_a_set_stand_at_their_spacing():
    mesh = built(sets=[JointSet("S", np.pi / 2, np.pi / 2, 50.0, origin=(25.0, 0.0, 0.0))])

    x = np.unique(mesh.points[mesh.surfaces["S"]][..., 0].round(6))
    assert x.tolist() == [25.0, 75.0, 125.0, 175.0]


def test_a_set_is_cut_to_the_layers_that_it_names():
    layers = [Layer("soil", 20.0), Layer("rock")]
    vertical = JointSet("S", np.pi / 2, np.pi / 2, 50.0, regions=("rock",))
    mesh = built(layers, [vertical])

    height = mesh.points[mesh.surfaces["S"]][..., 2]
    assert (height.min(), height.max()) == (-60.0, -20.0)  # not in soil nor beyond the box


def slope(rise=0.2):
    """Return a survey (n, 3) of ground that rises to the east and a little to the north."""
    x, y = np.meshgrid(np.linspace(-400.0, 600.0, 11), np.linspace(-400.0, 600.0, 11))
    return np.column_stack([x.ravel(), y.ravel(), (rise * (x + 0.3 * y)).ravel()])


FOLLOWING = [Layer("fill", 1.5, follows_surface=True), Layer("soil", 3.0, follows_surface=True),
             Layer("weathered", 10.0), Layer("rock")]  # fmt: skip


@pytest.mark.parametrize("faults", [(), (fault(70.0, 90.0),)], ids=["upright", "dipping"])
def test_layers_that_follow_a_surface_are_as_thick_everywhere(faults):
    mesh = built(FOLLOWING, faults=faults, surface=slope())

    places = mesh.node_places
    inside = np.abs(places[..., :2] - [100.0, 75.0]).max(axis=-1) < 60.0
    depth = 0.2 * (places[..., 0] + 0.3 * places[..., 1]) - places[..., 2]
    for number, (least, most) in enumerate([(0.0, 1.5), (1.5, 4.5)]):
        own = depth[inside & (mesh.zone_group == number)[:, None]]
        assert (own.min(), own.max()) == pytest.approx((least, most), abs=1e-9)
    level = mesh.node_places[mesh.zone_group == 3][..., 2]
    assert level.max() == pytest.approx(-14.5)
    assert zone_volumes(mesh).min() > 0.0


def test_layers_that_follow_a_surface_stand_above_all_others_and_not_last():
    for layers, words in [
        ([Layer("soil", 3.0), Layer("fill", 1.5, follows_surface=True), Layer("rock")], "above"),
        ([Layer("rock", follows_surface=True)], "last"),
    ]:
        with pytest.raises(InputError, match=words):
            Geometry(BOX, tuple(layers), surface=slope())


def test_joints_cut_all_layers_that_follow_a_surface_or_none():
    both, rock = ("soil", "fill", "weathered", "rock"), ("weathered", "rock")
    for regions in (None, both, rock):
        Geometry(BOX, tuple(FOLLOWING), (JointSet("S", 1.0, 0.0, 50.0, regions=regions),))
    with pytest.raises(InputError, match="regions: must leave out"):
        Geometry(BOX, tuple(FOLLOWING), (JointSet("S", 1.0, 0.0, 50.0, regions=("soil",)),))


def test_a_plane_that_reaches_into_layers_that_follow_a_surface_is_refused():
    flat = fault(0, 0, (0.0, 0.0, -14.4), "J")

    with pytest.raises(NotMapped, match=r"4\.5 m of layers that follow it"):
        built(FOLLOWING, faults=[flat], surface=slope() - [0.0, 0.0, 10.0])


@pytest.mark.parametrize(
    ("dip", "towards"), [(90.0, 90.0), (90.0, 0.0), (70.0, 270.0), (60.0, 0.0)]
)
def test_a_fault_of_limited_extent_has_its_area(dip, towards):
    plane = fault(dip, towards, (100.0, 75.0, -30.0), extent=(60.0, 40.0))
    mesh = built(faults=[plane])

    corners = mesh.points[mesh.surfaces["F"]]
    area = np.linalg.norm(
        np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]), axis=1
    )
    assert 0.5 * area.sum() == pytest.approx(2400.0)
    assert np.abs(off_plane(mesh, plane)).max() < 1e-9
    nodes = spectral_nodes(mesh.split(["F"]))
    at = np.abs(nodes.points[nodes.contacts.minus] - plane.point)
    assert (at.max(axis=0) < np.abs(corners - plane.point).max(axis=(0, 1)) + 1e-9).all()


def test_layers_lie_at_their_depths():
    mesh = built([Layer("soil", 12.5), Layer("rock")], sizes=[10.0, 40.0])

    top = mesh.zones[mesh.zone_group == 0]
    assert mesh.points[top][..., 2].min() == pytest.approx(-12.5)
    assert mesh.points[:, 2].min() < BOX[2, 0]  # the absorbing layer


def test_a_side_that_is_closed_has_no_layer():
    mesh = built(open_sides=("bottom",))

    assert np.ptp(mesh.points[:, 0]) == pytest.approx(200.0)
    assert np.isinf(np.array(mesh.layer.inner)[:2]).all()


def test_planes_of_different_dip_and_strike_stand_between_sides_that_stand():
    planes = [fault(80, 90, (60.0, 75.0, 0.0), "A"), fault(75, 250, (150.0, 75.0, 0.0), "B")]
    mesh = built(faults=planes, open_sides=("bottom",))

    for plane in planes:
        assert np.abs(off_plane(mesh, plane)).max() < 1e-9
    assert np.unique(mesh.points[mesh.surfaces["west"]][..., 0]).tolist() == [0.0]
    assert np.unique(mesh.points[mesh.surfaces["east"]][..., 0]).tolist() == [200.0]
    assert zone_volumes(mesh).min() > 0.0


def test_only_open_sides_make_room_for_a_plane():
    plane = fault(60, 90, (190.0, 75.0, 0.0))

    mesh = built(faults=[plane])

    assert np.array(mesh.layer.inner)[0, 0] == 0.0
    assert np.array(mesh.layer.inner)[0, 1] > 190.0 + 60.0 / np.tan(np.radians(60.0))
    with pytest.raises(NotMapped, match="'F' and 'east' meet in the box"):
        built(faults=[plane], open_sides=("bottom",))


def test_sides_have_the_names_of_the_directions_in_which_they_look():
    for towards in range(0, 360, 45):
        mesh = built(faults=[fault(60, towards)])
        middle = mesh.points.mean(axis=0)
        for side, axis, sign in (
            ("west", 0, -1),
            ("east", 0, 1),
            ("south", 1, -1),
            ("north", 1, 1),
        ):
            away = mesh.points[mesh.surfaces[side]].mean(axis=(0, 1)) - middle
            assert sign * away[axis] > 0.7 * np.linalg.norm(away)


def test_planes_and_layers_below_a_hill_stay_level():
    x, y = np.meshgrid(np.linspace(0.0, 200.0, 41), np.linspace(0.0, 150.0, 31))
    hill = 25.0 * np.exp(-(((x - 100.0) / 40.0) ** 2))
    surface = np.column_stack([x.ravel(), y.ravel(), hill.ravel()])
    layers = [Layer("soil", 20.0), Layer("rock")]
    mesh = built(layers, faults=[fault(0, 0, (0.0, 0.0, -35.0), "J")], surface=surface)

    assert np.unique(mesh.points[mesh.surfaces["J"]][..., 2]).tolist() == [-35.0]
    soil = mesh.node_places[mesh.zone_group == 0][..., 2]
    assert soil.min() == -20.0
    assert soil.max() == pytest.approx(25.0, abs=0.5)


def test_the_grid_turns_where_all_sides_are_open():
    turned, between = (
        built(faults=[fault(90, 20)], open_sides=sides) for sides in (OPEN, OPEN[1:])
    )

    assert quality(turned).min() == pytest.approx(1.0)
    assert quality(between).min() < 0.95  # 'west' stands


@pytest.mark.parametrize(("dip", "towards"), [(30, 60), (30, 0), (60, 135), (85, 310), (10, 20)])
def test_in_ground_that_is_open_all_around_a_plane_goes_on_straight_through_the_layer(dip, towards):
    plane = fault(dip, towards, through=(100.0, 75.0, -30.0))
    mesh = built(faults=[plane], open_sides=SIDES)
    at = mesh.points[mesh.surfaces["F"]]

    assert np.abs((at - plane.point) @ plane.unit_normal).max() < 1e-9
    assert mesh.layer.depths(at.mean(axis=1)).max() > 0.5
    centre = mesh.points.mean(axis=0)
    for number, side in enumerate(SIDES):  # those of the box that they face most alike
        outward = mesh.points[mesh.surfaces[side]].mean(axis=(0, 1)) - centre
        assert outward[number // 2] * (2 * (number % 2) - 1) > 0.0, side


def test_lines_run_closer_together_through_fine_parts():
    part = Fine(np.array([[90.0, 110.0], [70.0, 80.0], [-10.0, 0.0]]), 4.0)
    mesh = built(lines=[part])

    x = np.unique(mesh.points[:, 0])
    near = (x > 89.0) & (x < 111.0)
    assert np.diff(x[near]).max() < 4.5
    assert np.diff(x)[2:-2].max() <= 40.0 * 1.05
    growth = np.diff(x[x >= 110.0])
    assert (growth[1:] / growth[:-1]).max() < 2.6
    assert divided(0.0, 100.0, 30.0).tolist() == [0.0, 25.0, 50.0, 75.0]


@pytest.mark.parametrize("growth", [1.3, 1.5, 2.0])
def test_elements_beside_a_fine_part_grow_as_it_says(growth):
    part = Fine(np.zeros((3, 2)), 2.0, growth)

    edges = np.diff(divided(0.0, 400.0, 60.0, [(part, (0.0, 20.0))]))

    assert (edges[1:] / edges[:-1]).max() < 1.1 * growth
    assert edges.max() < 61.0
    assert (edges > 2.2).any()


@pytest.mark.parametrize(
    ("sets", "faults", "open_sides", "why"),
    [
        ((), [(60, 90), (60, 140)], OPEN, "'F0' and 'F1' meet in the box"),
        ((), [(20, 90)], ("bottom",), "'F0' and 'east' meet in the box"),
        ((), [(5, 90)], OPEN, "'F0' runs along the lines of the grid"),
        ([0.5], [], OPEN, "intact parts"),
    ],
)
def test_planes_that_fit_no_grid_are_refused(sets, faults, open_sides, why):
    planes = [fault(*angles, name=f"F{k}") for k, angles in enumerate(faults)]
    joints = [JointSet("S", np.pi / 2, 0.0, 50.0, persistence=share) for share in sets]

    with pytest.raises(NotMapped, match=why):
        built(sets=joints, faults=planes, open_sides=open_sides)


def test_a_grid_of_more_nodes_than_numbers_count_is_refused_before_it_is_made():
    with pytest.raises(InputError, match=r"of hexahedra needs about .* GB of memory"):
        built(sizes=[1e-4])
