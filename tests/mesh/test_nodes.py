"""Quadratic meshes: shares of volume and area, shape functions, two sides of joints."""

import numpy as np
import pytest

from pyblast.mesh import tetrahedra
from pyblast.mesh.faces import zone_faces
from pyblast.mesh.grid import structured_box
from pyblast.mesh.mesh import locate_in_zones
from pyblast.mesh.nodes import nodes_of


def halves(planes, shape=(4, 4, 4)):
    """Return the quadratic mesh of a box of 4 m with joints on planes."""
    return nodes_of(structured_box(shape, (4.0, 4.0, 4.0), planes=planes).split(list(planes)), True)


def slit(corners):
    """Return the quadratic mesh of a box that a joint of a few facets on x = 2 cuts in part."""
    mesh = structured_box((4, 4, 4), (4.0, 4.0, 4.0), planes={"J": ("x", 2.0)})
    faces = mesh.surfaces["J"]
    inside = ((mesh.points[faces][:, :, 1:] >= 1.0) & (mesh.points[faces][:, :, 1:] <= 3.0)).all(
        axis=(1, 2)
    )
    mesh.surfaces["J"] = faces[inside][:corners]
    return nodes_of(mesh.split(["J"]), True)


@pytest.mark.parametrize("linear", range(4))
def test_lumped_mass_integrates_motion_times_linear_functions(linear):
    powers = tetrahedra.POWERS + np.eye(4, dtype=int)[linear]
    at_nodes = np.prod(tetrahedra.NODES[:, None, :] ** powers, axis=2)

    assert tetrahedra.VOLUME_SHARE @ at_nodes == pytest.approx(
        tetrahedra.integral(powers), rel=1e-13
    )


def test_lumped_areas_integrate_cubics():
    corners = tetrahedra.NODES[tetrahedra.FACE_NODES[3]][:, :3]
    powers = np.array([[3, 0, 0], [2, 1, 0], [1, 1, 1], [0, 2, 0], [0, 0, 0]])

    found = tetrahedra.AREA_SHARE @ np.prod(corners[:, None, :] ** powers, axis=2)

    assert found == pytest.approx([1 / 10, 1 / 30, 1 / 60, 1 / 6, 1.0], rel=1e-13)


def test_each_shape_function_is_one_at_its_node_and_nothing_at_others():
    assert tetrahedra.shape_values(tetrahedra.NODES) == pytest.approx(np.eye(15), abs=1e-13)


def test_face_nodes_lie_on_their_face_with_edges_between_their_corners():
    places = tetrahedra.NODES[tetrahedra.FACE_NODES]

    for face in range(4):
        corners = places[face, :3]
        assert not places[face, :, face].any()
        assert places[face, 3:6] == pytest.approx(0.5 * (corners + np.roll(corners, -1, axis=0)))
        assert places[face, 6] == pytest.approx(corners.mean(axis=0))


def test_zones_share_the_nodes_of_edges_and_faces():
    mesh = structured_box((2, 2, 2), (2.0, 2.0, 2.0))

    quadratic = nodes_of(mesh, True)

    edges = np.unique(np.sort(mesh.zones[:, tetrahedra.EDGES].reshape(-1, 2), axis=1), axis=0)
    faces = np.unique(np.sort(zone_faces(mesh.zones), axis=1), axis=0)
    parts = len(mesh.points) + len(edges) + len(faces) + len(mesh.zones)
    assert len(quadratic.points) == len(np.unique(quadratic.points.round(9), axis=0)) == parts
    corners = quadratic.points[quadratic.zone_nodes[:, :4]]
    every = np.einsum("ni,zij->znj", tetrahedra.NODES, corners)
    assert quadratic.points[quadratic.zone_nodes] == pytest.approx(every, abs=1e-12)


def test_mass_and_areas_are_shared_out_whole():
    quadratic = halves({"J": ("x", 2.0)})
    volume = tetrahedra.volumes(quadratic.mesh.points, quadratic.mesh.zones)

    _, area, normal = quadratic.surface_areas("east")

    assert quadratic.sums(volume).sum() == pytest.approx(64.0)
    assert area.sum() == pytest.approx(16.0)
    assert normal == pytest.approx(np.tile([1.0, 0.0, 0.0], (len(area), 1)))


def test_both_sides_of_a_joint_have_nodes_of_their_own():
    quadratic = halves({"J": ("x", 2.0)})
    contacts = quadratic.contacts

    left = quadratic.points[quadratic.zone_nodes].mean(axis=1)[:, 0] < 2.0
    shared = np.intersect1d(quadratic.zone_nodes[left], quadratic.zone_nodes[~left])
    assert len(shared) == 0
    assert np.isin(contacts.minus, quadratic.zone_nodes[left]).all()
    assert quadratic.points[contacts.minus] == pytest.approx(quadratic.points[contacts.plus])
    assert len(np.unique(contacts.minus)) == len(contacts.minus) == 9 * 9 + 32
    assert contacts.area.sum() == pytest.approx(16.0)
    assert contacts.normal == pytest.approx(np.tile([1.0, 0.0, 0.0], (len(contacts.area), 1)))
    assert np.array_equal(np.unique(quadratic.surfaces["J"]), np.unique(contacts.minus))


def test_crossing_joints_keep_their_areas_apart():
    quadratic = halves({"A": ("x", 2.0), "B": ("y", 2.0), "C": ("z", 2.0)})
    contacts = quadratic.contacts

    area = np.bincount(contacts.joint, contacts.area)

    assert area == pytest.approx([16.0, 16.0, 16.0])
    axes = np.eye(3)[[{"A": 0, "B": 1, "C": 2}[contacts.names[j]] for j in contacts.joint]]
    assert np.abs(contacts.normal) == pytest.approx(axes)
    assert quadratic.points[contacts.minus] == pytest.approx(quadratic.points[contacts.plus])


def test_a_joint_that_ends_in_rock_is_welded_at_its_rim_alone():
    quadratic = slit(None)
    contacts = quadratic.contacts

    # A square of two by two cells: five by five nodes at corners and on edges, eight centroids.
    places = quadratic.points[contacts.minus]
    assert (np.abs(places[:, 1:] - 2.0) < 1.0).all()
    on_rim = 5 * 5 - 3 * 3
    assert len(contacts.area) == 5 * 5 + 8 - on_rim


def test_a_facet_with_three_corners_on_the_rim_opens_at_its_centroid():
    single = slit(1)

    contacts = single.contacts
    assert len(contacts.area) == 1
    assert contacts.area == pytest.approx(0.5 * 9 / 20)
    assert contacts.minus[0] != contacts.plus[0]


def test_shapes_reproduce_quadratic_fields_and_their_gradients():
    quadratic = halves({"J": ("x", 2.0)})
    places = np.random.default_rng(0).uniform(0.1, 3.9, size=(20, 3))
    zone, weights = locate_in_zones(quadratic.mesh, places)

    nodes = quadratic.zone_nodes[zone]
    value, gradient = quadratic.shapes(weights), quadratic.slopes(zone, weights)

    x, y, z = quadratic.points[nodes].transpose(2, 0, 1)
    field = x * y - z**2 + 3.0 * x
    px, py, pz = places.T
    slope = np.stack([py + 3.0, px, -2.0 * pz], axis=1)
    assert np.sum(value * field, axis=1) == pytest.approx(px * py - pz**2 + 3.0 * px)
    assert np.einsum("na,nai->ni", field, gradient) == pytest.approx(slope)
