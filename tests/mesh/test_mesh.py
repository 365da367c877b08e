import numpy as np
import pytest

from pyblast.errors import InputError
from pyblast.mesh import mesh as meshes
from pyblast.mesh.builder import Layer, structured_box
from pyblast.mesh.faces import face_keys, pair_faces
from pyblast.mesh.grid import Geometry
from pyblast.mesh.mesh import Mesh
from pyblast.mesh.tetrahedra import altitudes


def cross(planes, pattern="kuhn"):
    return structured_box((4, 4, 4), (4.0, 4.0, 4.0), planes=planes, pattern=pattern)


def joint_areas(mesh):
    return np.bincount(mesh.contacts.joint, weights=mesh.contacts.area)


def copies(mesh, place):
    return np.count_nonzero(np.isclose(mesh.points, place).all(axis=1))


def half_plane(mesh, name, keep):
    """Keep only the facets of a surface whose centre fulfils a condition."""
    faces = mesh.surfaces[name]
    kept = faces[keep(mesh.points[faces].mean(axis=1))]
    return Mesh(mesh.points, mesh.zones, mesh.zone_group, mesh.groups, {name: kept})


@pytest.mark.parametrize("pattern", ["kuhn", "alternating", "centred"])
@pytest.mark.parametrize("names", ["a", "ab", "abc"])
def test_a_node_where_n_planes_cross_becomes_two_to_the_n_nodes(names, pattern):
    planes = {name: (axis, 2.0) for name, axis in zip(names, "xyz", strict=False)}

    mesh = cross(planes, pattern).split(list(names))

    assert copies(mesh, [2.0, 2.0, 2.0]) == 2 ** len(names)
    assert mesh.blocks().max() + 1 == 2 ** len(names)


def test_contact_areas_of_crossing_joints_add_up_to_the_area_of_each_joint():
    mesh = cross({"a": ("x", 2.0), "b": ("y", [1.0, 3.0]), "c": ("z", 3.0)}).split("abc")

    assert joint_areas(mesh) == pytest.approx([16.0, 32.0, 16.0], rel=1e-13)


def test_contact_normals_point_the_same_way_all_over_each_joint():
    mesh = cross({"a": ("x", 2.0), "b": ("y", [1.0, 3.0]), "c": ("z", 3.0)}).split("abc")

    assert mesh.contacts.normal == pytest.approx(np.eye(3)[mesh.contacts.joint], abs=1e-13)


def test_the_plus_node_of_a_contact_moves_with_the_zones_ahead_of_the_normal():
    mesh = cross({"a": ("x", 2.0)}).split("a")
    centre = mesh.points[mesh.zones].mean(axis=1)
    ahead = np.unique(mesh.zones[centre[:, 0] > 2.0])

    assert np.isin(mesh.contacts.plus, ahead).all()
    assert not np.isin(mesh.contacts.minus, ahead).any()


def test_both_nodes_of_a_contact_lie_at_the_same_place():
    mesh = cross({"a": ("x", 2.0), "b": ("y", 2.0)}).split("ab")

    assert np.array_equal(mesh.points[mesh.contacts.minus], mesh.points[mesh.contacts.plus])


def test_a_joint_that_ends_inside_a_block_keeps_its_tip_single():
    whole = cross({"a": ("x", 2.0)})
    mesh = half_plane(whole, "a", lambda centre: centre[:, 2] > 2.0).split("a")

    assert copies(mesh, [2.0, 2.0, 2.0]) == 1
    assert copies(mesh, [2.0, 2.0, 3.0]) == 2
    assert mesh.blocks().max() == 0


def test_a_joint_that_ends_at_another_one_makes_three_nodes_there():
    whole = cross({"a": ("x", 2.0), "b": ("z", 2.0)})
    upper = half_plane(whole, "a", lambda centre: centre[:, 2] > 2.0).surfaces["a"]
    surfaces = {"a": upper, "b": whole.surfaces["b"]}
    mesh = Mesh(whole.points, whole.zones, whole.zone_group, whole.groups, surfaces)

    mesh = mesh.split("ab")

    assert copies(mesh, [2.0, 2.0, 2.0]) == 3
    assert mesh.blocks().max() + 1 == 3
    assert joint_areas(mesh) == pytest.approx([8.0, 16.0], rel=1e-13)


def test_a_closed_joint_surface_is_oriented_by_its_facets():
    whole = structured_box((3, 3, 3), (3.0, 3.0, 3.0))
    centre = whole.points[whole.zones].mean(axis=1)
    core = np.abs(centre - 1.5).max(axis=1) < 0.5
    shell = Mesh(whole.points, whole.zones[core], np.zeros(core.sum()), ("core",), {})
    mesh = Mesh(
        whole.points,
        whole.zones,
        whole.zone_group,
        whole.groups,
        {"skin": meshes.outer_faces(shell)},
    ).split(["skin"])

    outward = mesh.points[mesh.contacts.minus] - 1.5
    side = np.sign(np.einsum("ij,ij->i", outward, mesh.contacts.normal))

    assert len(np.unique(side)) == 1
    assert joint_areas(mesh) == pytest.approx([6.0], rel=1e-13)


def test_contacts_at_the_edge_of_a_kinked_joint_keep_both_normals():
    whole = cross({"a": ("x", 2.0), "b": ("z", 2.0)})
    upper = half_plane(whole, "a", lambda centre: centre[:, 2] > 2.0).surfaces["a"]
    left = half_plane(whole, "b", lambda centre: centre[:, 0] < 2.0).surfaces["b"]
    surfaces = {"kink": np.concatenate([upper, left])}

    mesh = Mesh(whole.points, whole.zones, whole.zone_group, whole.groups, surfaces).split(["kink"])

    assert np.abs(mesh.contacts.normal).max(axis=1) == pytest.approx(1.0, abs=1e-13)
    assert joint_areas(mesh) == pytest.approx([16.0], rel=1e-13)


def test_outer_surfaces_follow_the_doubled_nodes_of_their_zones():
    mesh = cross({"a": ("x", 2.0), "b": ("y", 2.0)}).split("ab")
    zone = meshes.surface_zones(mesh, "top")

    assert (mesh.zones[zone][:, None, :] == mesh.surfaces["top"][:, :, None]).any(axis=2).all()


def test_splitting_twice_gives_the_same_mesh():
    one, other = (cross({"a": ("x", 2.0), "b": ("y", 2.0)}).split("ab") for _ in range(2))

    assert np.array_equal(one.zones, other.zones)
    assert np.array_equal(one.contacts.plus, other.contacts.plus)


def test_outer_faces_of_a_split_mesh_leave_the_joints_out():
    mesh = cross({"a": ("x", 2.0), "b": ("y", 2.0)})

    assert len(meshes.outer_faces(mesh.split("ab"))) == len(meshes.outer_faces(mesh)) == 192


def test_surface_areas_point_outward_and_add_up():
    _, area, normal = meshes.surface_areas(cross({}), "west")

    assert area.sum() == pytest.approx(16.0, rel=1e-13)
    assert normal == pytest.approx(np.tile([-1.0, 0.0, 0.0], (96, 1)), abs=1e-13)


def test_located_points_are_given_back_by_their_weights():
    mesh = cross({"a": ("x", 2.0)}).split("a")
    places = np.random.default_rng(1).uniform(0.0, 4.0, (50, 3))
    zone, weights = meshes.locate_in_zones(mesh, places)

    assert weights.min() >= 0.0
    assert np.einsum("ij,ijk->ik", weights, mesh.points[mesh.zones[zone]]) == pytest.approx(places)


def test_a_receiver_on_the_free_surface_is_located_there():
    mesh = cross({})
    zone, weights = meshes.locate_in_zones(mesh, [[1.3, 2.2, 4.0]])

    assert weights[0] @ mesh.points[mesh.zones[zone[0]]] == pytest.approx([1.3, 2.2, 4.0])


def test_a_place_far_outside_is_refused_by_name():
    with pytest.raises(InputError, match=r"point \(1, 2, 9\): must lie in the mesh"):
        meshes.locate_in_zones(cross({}), [[1.0, 2.0, 9.0]])


@pytest.mark.parametrize(("pattern", "per_box"), [("kuhn", 6), ("alternating", 5), ("centred", 12)])
def test_a_grid_fills_its_box_with_positive_zones(pattern, per_box):
    mesh = structured_box((3, 2, 4), (3.0, 5.0, 2.0), pattern=pattern)

    assert len(mesh.zones) == 24 * per_box
    assert meshes.zone_volumes(mesh).min() > 0.0
    assert meshes.zone_volumes(mesh).sum() == pytest.approx(30.0, rel=1e-13)


def test_centred_boxes_leave_layers_and_joints_on_their_planes():
    layers, planes = [Layer("soil", 1.0), Layer("rock")], {"a": ("x", [1.0, 3.0])}
    shape, size = (4, 3, 4), (4.0, 3.0, 4.0)

    mesh = structured_box(shape, size, layers=layers, planes=planes, pattern="centred").split("a")

    volume = np.bincount(mesh.zone_group, meshes.zone_volumes(mesh))
    assert volume == pytest.approx([12.0, 36.0], rel=1e-13)
    assert joint_areas(mesh) == pytest.approx([24.0], rel=1e-13)
    assert meshes.quality(mesh).min() > 0.75


def test_grid_layers_are_listed_from_the_top_down():
    mesh = structured_box((2, 2, 4), (2.0, 2.0, 4.0), layers=[Layer("soil", 1.0), Layer("rock")])
    height = mesh.points[mesh.zones].mean(axis=1)[:, 2]

    assert mesh.groups == ("soil", "rock")
    assert height[mesh.zone_group == 0].min() > 3.0
    assert height[mesh.zone_group == 1].max() < 3.0


def test_quality_of_a_regular_tetrahedron_is_one_and_its_altitude_known():
    points = np.array([[1, 1, 1], [-1, 1, -1], [1, -1, -1], [-1, -1, 1.0]])
    mesh = Mesh(points, [[0, 1, 2, 3]], [0], ("rock",), {})

    assert meshes.quality(mesh) == pytest.approx([1.0], rel=1e-12)
    assert altitudes(mesh.points, mesh.zones) == pytest.approx([4.0 / np.sqrt(3.0)], rel=1e-12)


def refused(change, message):
    mesh = cross({"a": ("x", 2.0)})
    with pytest.raises(InputError, match=message):
        change(mesh)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda m: m.split(["b"]), "no surface named 'b'"),
        (lambda m: m.split(["a"]).split(["a"]), "split already"),
        (lambda m: m.split(["top"]), "32 facets of 'top' are not faces between two zones"),
        (lambda m: m.split(["a", "a"]), "stands in 'a' too"),
        (lambda m: Mesh(m.points[:9], m.zones, m.zone_group, m.groups, {}), "mesh.zones: must lie"),
        (lambda m: Mesh(m.points, m.zones, [0], m.groups, {}), "one entry for each"),
        (lambda m: Mesh(m.points, m.zones[:, :3], m.zone_group, m.groups, {}), "4 columns"),
        (lambda m: meshes.surface_areas(m, "roof"), "no surface named 'roof'"),
        (lambda _: cross({"a": ("x", 2.1)}), "'a' at 2.1 m must be on the grid"),
        (lambda _: structured_box([0, 1], [0, 1], [1, 0]), "zs: must ascend"),
        (lambda _: structured_box((1, 1, 1), (1.0, 0.0, 1.0)), "must be positive"),
        (lambda _: cross({}, "delaunay"), "pattern: must be"),
        (lambda _: Layer("soil", -2.0), "thickness: must be positive, got -2 m"),
    ],
)
def test_wrong_input_is_refused_in_one_sentence(change, message):
    refused(change, message)


@pytest.mark.parametrize("n_nodes", [9, 100_000])
def test_faces_that_share_three_of_four_corners_have_different_keys(n_nodes):
    faces = np.array([[0, 1, 3, 2], [0, 1, 3, 7], [2, 3, 1, 0]])

    first, other, again = face_keys(faces, n_nodes)

    assert first == again
    assert first != other


def test_two_hexahedra_with_three_corners_in_common_share_no_face():
    zones = np.array([[0, 1, 2, 3, 4, 5, 6, 7], [0, 1, 2, 8, 9, 10, 11, 12]])

    first, _, single, excess = pair_faces(zones, 13)

    assert (len(first), len(single), len(excess)) == (0, 12, 0)


def test_sides_without_a_demand_to_stand_are_open():
    box = np.array([[0.0, 9.0], [0.0, 9.0], [-4.0, 0.0]])
    layers = (Layer("soil", 1.0), Layer("rock"))

    geometry = Geometry(box, layers, standing=frozenset(["top", "east"]))

    assert geometry.open_sides == ("west", "south", "north", "bottom")
    assert geometry.limits.tolist() == [0.0, -1.0, -4.0]
    with pytest.raises(InputError, match="standing: must be of west"):
        Geometry(box, layers, standing=frozenset(["up"]))
