"""Swept meshes: sections conform to their traces, planes that share a direction are served."""

import numpy as np
import pytest

from pyblast.mesh.faces import face_vectors
from pyblast.mesh.grid import SIDES, Fault, Geometry, JointSet, Layer
from pyblast.mesh.hexahedral.mapped import Fine
from pyblast.mesh.hexahedral.planes import NotMapped
from pyblast.mesh.hexahedral.swept import (
    arrangement,
    build_swept,
    sliding,
    smoothed_quadrilaterals,
    upright,
)
from pyblast.mesh.mesh import outer_faces, quality, zone_volumes
from pyblast.mesh.quality import explicit_work

BOX = np.array([[0.0, 120.0], [0.0, 90.0], [0.0, 60.0]])
OPEN = ("west", "east", "south", "north", "bottom")
ROCK = (Layer("rock"),)


def fault(dip, towards, through, name="F", **extent):
    return Fault(name, np.radians(dip), np.radians(towards), through, **extent)


def built(faults=(), sets=(), open_sides=OPEN, box=BOX, layers=ROCK, edge=25.0, **options):
    standing = frozenset(SIDES) - set(open_sides)
    surface = options.pop("surface", None)
    geometry = Geometry(box, layers, tuple(sets), tuple(faults), surface, standing)
    return build_swept(geometry, [edge] * len(layers), 3, **options)


def area(mesh, name):
    return np.linalg.norm(face_vectors(mesh.points, mesh.surfaces[name]), axis=1).sum()


def off_plane(mesh, plane):
    """Return the distances from a plane of its facets inside the box."""
    at = mesh.points[mesh.surfaces[plane.name]]
    inside = ((at >= BOX[:, 0] - 1e-6) & (at <= BOX[:, 1] + 1e-6)).all(axis=(1, 2))
    return (at[inside] - plane.point) @ plane.unit_normal


@pytest.mark.parametrize(("dip", "x"), [(60, 90.0), (45, 100.0), (25, 60.0)])
def test_a_free_face_stands_beside_a_fault_that_leaves_through_it(dip, x):
    plane = fault(dip, 90, (x, 45.0, 60.0))
    mesh = built([plane], open_sides=("west", "south", "north", "bottom"))

    assert np.unique(mesh.points[mesh.surfaces["east"]][..., 0]).tolist() == [120.0]
    assert np.abs(off_plane(mesh, plane)).max() < 1e-9
    along = mesh.points[mesh.surfaces["F"]][..., 1]
    inside = ((along > -1e-6) & (along < 90.0 + 1e-6)).all(axis=1)
    corners = mesh.points[mesh.surfaces["F"][inside]]
    assert corners[..., 0].max() == pytest.approx(120.0)
    assert zone_volumes(mesh).min() > 0.0


QUARTER = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # clockwise
MIRROR = np.diag([-1.0, 1.0, 1.0])


def moved(image, planes):
    """Return box and planes of the image (3, 3) of a ground about the middle of `BOX`."""
    middle = BOX.mean(axis=1)
    box = np.sort(((BOX.T - middle) @ image.T).T + middle[:, None], axis=1)
    images = [
        Fault(p.name, normal=tuple(image @ p.unit_normal), extent=p.extent,
              point=tuple(image @ (p.point - middle) + middle))
        for p in planes
    ]  # fmt: skip
    return box, images


LEANING = [fault(54, 250, (40.0, 45.0, 60.0)), fault(54, 70, (95.0, 45.0, 60.0), "G")]
UPRIGHT = [fault(90, 65, (40.0, 45.0, 60.0)), fault(90, 20, (80.0, 50.0, 60.0), "G")]
ACROSS = [
    fault(60, 270, (45.0, 45.0, 60.0)),
    fault(90, 0, (50.0, 45.0, 30.0), "G", extent=(40.0, 20.0)),
]


@pytest.mark.parametrize("image", [QUARTER, QUARTER @ QUARTER, MIRROR, QUARTER @ MIRROR])
@pytest.mark.parametrize(
    ("sides", "planes"), [(OPEN, LEANING), (("bottom",), UPRIGHT), (OPEN, ACROSS)]
)
def test_turned_and_mirrored_grounds_have_the_nodes_of_the_original(image, sides, planes):
    box, images = moved(image, planes)
    one, other = built(planes, open_sides=sides), built(images, box=box, open_sides=sides)

    middle = BOX.mean(axis=1)
    expected = (one.points - middle) @ image.T + middle
    assert sorted(map(tuple, expected.round(6))) == sorted(map(tuple, other.points.round(6)))


def test_faults_of_different_dip_cross():
    planes = [fault(60, 90, (50.0, 45.0, 60.0), "F"), fault(50, 270, (90.0, 45.0, 60.0), "G")]
    mesh = built(planes, open_sides=())

    for plane in planes:
        assert np.abs(off_plane(mesh, plane)).max() < 1e-9
        assert area(mesh, plane.name) == pytest.approx(90.0 * 60.0 / np.sin(plane.dip))
    assert len(mesh.split(["F", "G"]).contacts.names) == 2


def test_an_upright_rectangle_across_a_dipping_fault_has_its_area():
    upright_part = fault(90, 0, (60.0, 45.0, 30.0), "G", extent=(60.0, 30.0))
    mesh = built([fault(60, 90, (60.0, 45.0, 60.0)), upright_part])

    assert area(mesh, "G") == pytest.approx(1800.0, rel=0.01)
    at = mesh.points[mesh.surfaces["G"]]
    assert at.min(axis=(0, 1)) == pytest.approx([30.0, 45.0, 15.0], abs=0.4)
    assert at.max(axis=(0, 1)) == pytest.approx([90.0, 45.0, 45.0], abs=0.4)


def test_an_oblique_upright_set_stands_between_sides_that_stand():
    joints = JointSet("S", np.pi / 2, np.radians(30.0), 30.0)
    mesh = built(sets=[joints], open_sides=("bottom",))

    for side, axis, limit in (("west", 0, 0.0), ("east", 0, 120.0), ("north", 1, 90.0)):
        assert np.unique(mesh.points[mesh.surfaces[side]][..., axis]).tolist() == [limit]
    at = mesh.points[mesh.surfaces["S"]]
    offset = (at - BOX.mean(axis=1)) @ joints.normal / 30.0
    assert np.abs(offset - offset.round()).max() < 0.02
    assert np.ptp(offset.round()) == 4.0


def test_layers_and_sets_beside_a_fault_keep_their_heights():
    layers = (Layer("soil", 25.0), Layer("rock"))
    joints = JointSet("S", np.radians(30.0), np.pi / 2, 25.0, regions=("rock",))
    mesh = built([fault(60, 90, (40.0, 45.0, 60.0))], [joints], layers=layers)

    soil = mesh.points[mesh.zones[mesh.zone_group == 0]]
    assert soil[..., 2].min() == pytest.approx(35.0, abs=1e-6)
    assert mesh.points[mesh.surfaces["S"]][..., 2].max() <= 35.0 + 1e-6
    assert mesh.points[mesh.surfaces["S"]][..., 1].max() <= 90.0  # ends at the layer


def test_an_upright_plane_stays_upright_below_a_hill():
    x, y = np.meshgrid(np.linspace(0.0, 120.0, 13), np.linspace(0.0, 90.0, 10))
    surface = np.column_stack([x.ravel(), y.ravel(), 60.0 + 0.1 * x.ravel()])
    plane = fault(90, 60, (60.0, 45.0, 60.0))
    mesh = built([plane], open_sides=("bottom",), surface=surface)

    at = mesh.points[mesh.surfaces["F"]]
    assert np.abs((at - plane.point) @ plane.unit_normal).max() < 1e-9
    top = mesh.points[mesh.surfaces["top"]]
    assert top[..., 2] == pytest.approx(60.0 + 0.1 * top[..., 0])
    with pytest.raises(NotMapped, match="'F' dips and comes out of the ground surface"):
        built([fault(60, 90, (60.0, 45.0, 60.0))], surface=surface)


@pytest.mark.parametrize("dip", [60, 90], ids=["swept level", "swept upright"])
def test_a_layer_that_follows_a_hill_is_as_thick_everywhere(dip):
    x, y = np.meshgrid(np.linspace(0.0, 120.0, 13), np.linspace(0.0, 90.0, 10))
    surface = np.column_stack([x.ravel(), y.ravel(), 60.0 + 0.1 * x.ravel()])
    plane = fault(dip, 60 if dip == 90 else 90, (60.0, 45.0, 10.0), extent=(200.0, 10.0))
    layers = (Layer("soil", 2.0, follows_surface=True), Layer("rock"))
    mesh = built([plane], open_sides=("bottom",), layers=layers, surface=surface)

    places = mesh.node_places[mesh.zone_group == 0]
    depth = 60.0 + 0.1 * places[..., 0] - places[..., 2]
    assert (depth.min(), depth.max()) == pytest.approx((0.0, 2.0), abs=1e-9)


def test_the_mesh_has_no_hole_and_its_sides_are_its_boundary():
    mesh = built([fault(60, 90, (90.0, 45.0, 60.0))], open_sides=("west", "bottom"))

    faces = {tuple(sorted(face)) for face in outer_faces(mesh).tolist()}
    sides = {tuple(sorted(f)) for side in SIDES for f in mesh.surfaces[side].tolist()}
    assert sides == faces
    total = sum(face_vectors(mesh.points, outer_faces(mesh)))
    assert np.abs(total).max() < 1e-6


def test_elements_are_smaller_in_fine_parts():
    part = Fine(np.array([[40.0, 60.0], [30.0, 50.0], [40.0, 60.0]]), 5.0)
    plane = fault(60, 90, (90.0, 45.0, 60.0))
    coarse, fine = built([plane]), built([plane], lines=[part])

    centres = fine.points[fine.zones].mean(axis=1)
    near = ((centres > part.box[:, 0]) & (centres < part.box[:, 1])).all(axis=1)
    assert zone_volumes(fine)[near].max() < 6.5**3
    assert len(fine.zones) > len(coarse.zones)
    assert explicit_work(fine) > explicit_work(coarse)


def test_planes_without_a_common_direction_are_refused():
    planes = [fault(60, 90, (50.0, 45.0, 60.0), "F"), fault(70, 40, (90.0, 45.0, 60.0), "G")]

    with pytest.raises(NotMapped, match="no direction lies in all of its planes"):
        built(planes)


def test_an_arrangement_merges_vertices_and_cuts_segments_at_each_other():
    limits = np.array([[0.0, 10.0], [0.0, 10.0]])
    segments = np.array(
        [[[0.0, 5.0], [10.0, 5.0]], [[5.0, 0.0], [5.0, 10.0]], [[5.01, 5.0], [8.0, 10.0]]]
    )
    vertices, chains = arrangement(limits, segments, 0.1)

    assert [len(chain) for chain in chains] == [3, 3, 2]
    assert chains[0][1] == chains[1][1] == chains[2][0]
    assert vertices[chains[0][1]].tolist() == [5.0, 5.0]
    assert vertices[:4].tolist() == [[0, 0], [10, 0], [10, 10], [0, 10]]


def test_a_line_that_ends_just_before_another_one_cuts_it():
    limits = np.array([[0.0, 10.0], [0.0, 10.0]])
    segments = np.array([[[0.0, 5.0], [10.0, 5.0]], [[3.0, 9.0], [3.0, 5.05]]])

    _, (level, upright_one) = arrangement(limits, segments, 0.1)

    assert len(level) == 3
    assert level[1] == upright_one[-1]


def test_smoothing_lengthens_the_worst_corner_and_keeps_lines():
    points = np.array([[x, y] for y in (0.0, 1.0, 2.0) for x in (0.0, 1.0, 2.0)])
    points[[1, 4]] = [1.3, 0.0], [1.4, 1.2]
    quads = np.array([[0, 1, 4, 3], [1, 2, 5, 4], [3, 4, 7, 6], [4, 5, 8, 7]])
    corners = np.concatenate([quads[:, [k, (k + 1) % 4, k - 1]] for k in range(4)])
    sides = np.array([[0, 1], [1, 2], [6, 7], [7, 8], [0, 3], [3, 6], [2, 5], [5, 8]])
    normals = np.repeat([[0.0, 1.0], [1.0, 0.0]], 4, axis=0)

    better = smoothed_quadrilaterals(points, corners, sliding(9, sides, normals), 1.0)

    assert better[4] == pytest.approx([1.0, 1.0], abs=1e-3)
    assert better[[0, 2, 6, 8]].tolist() == points[[0, 2, 6, 8]].tolist()
    assert better[1] == pytest.approx([1.0, 0.0], abs=1e-3)
    assert better[1, 1] == 0.0


def test_zones_are_turned_so_that_their_third_axis_looks_up():
    mesh = built([fault(60, 90, (90.0, 45.0, 60.0))])

    for axis in range(3):
        upper = (np.arange(8) >> axis & 1).astype(bool)
        ends = (mesh.points[mesh.zones[:, part]].mean(axis=1) for part in (upper, ~upper))
        high, low = ends
        assert ((high - low) @ np.array(mesh.layer.frame)[axis] > 0.0).all()
    assert (quality(mesh) > 0.0).all()
    again = upright(
        mesh.points, mesh.zones[:, [1, 3, 0, 2, 5, 7, 4, 6]], np.array(mesh.layer.frame)
    )
    assert (again == mesh.zones).all()
