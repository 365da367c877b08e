import numpy as np
import pytest

from pyblast.errors import InputError
from pyblast.mesh.builder import JointSet, Layer, build_mesh, structured_box
from pyblast.mesh.mesh import Mesh
from pyblast.mesh.quality import count_blocks, joint_spacing, least_stretch, validate


def test_a_split_mesh_is_valid_although_its_nodes_coincide():
    mesh = structured_box((3, 3, 3), (3.0, 3.0, 3.0), planes={"a": ("x", 1.0), "b": ("z", 1.0)})

    assert validate(mesh.split("ab")) is None


def test_a_defect_is_placed():
    mesh = structured_box((1, 1, 1), (1.0, 1.0, 1.0))
    zones = mesh.zones.copy()
    zones[3] = zones[3][[1, 0, 2, 3]]

    with pytest.raises(InputError, match=r"1 zones are inverted .* the first is zone 3 of 'rock'"):
        validate(Mesh(mesh.points, zones, mesh.zone_group, mesh.groups, {}))


def test_spacing_on_scan_lines_is_that_of_the_grid():
    mesh = structured_box((24, 2, 2), (12.0, 2.0, 2.0), planes={"a": ("x", [1.5, 4.5, 7.5, 10.5])})

    assert joint_spacing(mesh, "a", [1.0, 0.0, 0.0]) == pytest.approx(3.0, rel=1e-12)


def test_scan_lines_oblique_to_a_set_see_a_larger_spacing():
    mesh = structured_box((24, 8, 2), (12.0, 4.0, 2.0), planes={"a": ("x", [1.5, 4.5, 7.5, 10.5])})
    angle = np.radians(20.0)

    spacing = joint_spacing(mesh, "a", [np.cos(angle), np.sin(angle), 0.0])

    assert spacing == pytest.approx(3.0 / np.cos(angle), rel=1e-6)


def test_spacing_of_a_built_set_on_scan_lines_is_as_asked_within_2_percent():
    pytest.importorskip("gmsh", exc_type=ImportError)
    sets = [JointSet("a", np.radians(70.0), 0.4, 6.0), JointSet("b", 0.3, 2.0, 7.0)]
    mesh = build_mesh(((0, 40), (0, 40), (0, 30)), [Layer("rock")], sets, edge=6.0)

    for joints in sets:
        assert joint_spacing(mesh, joints.name, joints.normal) == pytest.approx(
            joints.spacing, rel=0.02
        )


def test_a_line_that_meets_no_second_joint_has_no_spacing():
    mesh = structured_box((2, 2, 2), (2.0, 2.0, 2.0), planes={"a": ("x", 1.0)})

    with pytest.raises(InputError, match="no scan-line meets 'a' twice"):
        joint_spacing(mesh, "a", [1.0, 0.0, 0.0])


def quarry(low, high):
    """A grid of three boxes a side, cut on the planes that frame the middle box from above."""
    planes = {"a": ("x", [1.0, 2.0]), "b": ("y", [1.0, 2.0]), "c": ("z", [2.0])}
    mesh = structured_box((3, 3, 3), (3.0, 3.0, 3.0), planes=planes)
    points = mesh.points.copy()
    middle = np.abs(points[:, :2] - 1.5).max(axis=1) < 0.6
    width = low + (high - low) * (points[:, 2] - 2.0)
    points[middle, :2] = 1.5 + (points[middle, :2] - 1.5) * width[middle, None]
    return Mesh(points, mesh.zones, mesh.zone_group, mesh.groups, mesh.surfaces).split("abc")


def middle_block(mesh):
    centre = mesh.points[mesh.zones].mean(axis=1)
    return mesh.blocks()[np.argmin(np.linalg.norm(centre - [1.5, 1.5, 2.5], axis=1))]


def test_a_block_that_widens_upward_is_removable():
    mesh = quarry(0.9, 1.3)

    assert count_blocks(mesh).removable[middle_block(mesh)]


def test_a_block_that_widens_downward_is_held():
    mesh = quarry(1.3, 0.9)
    census = count_blocks(mesh)

    assert census.free[middle_block(mesh)]
    assert not census.removable[middle_block(mesh)]


def test_blocks_at_the_sides_are_held():
    census = count_blocks(quarry(0.9, 1.3))

    assert census.removable.sum() == 1
    assert census.volumes.sum() == pytest.approx(27.0)


def test_least_stretch_is_the_smallest_singular_value():
    draws = np.random.default_rng(4).normal(size=(500, 3, 3))
    turned = np.linalg.qr(draws[0])[0]
    matrices = np.concatenate([draws, [turned, 3.0 * np.eye(3), np.diag([5.0, 5.0, 1e-3])]])

    wanted = np.linalg.svd(matrices, compute_uv=False)[:, -1]
    np.testing.assert_allclose(least_stretch(matrices), wanted, rtol=1e-6, atol=1e-7)
