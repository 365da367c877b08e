import numpy as np
import pytest

from pyblast.errors import InputError
from pyblast.mesh.builder import structured_box
from pyblast.mesh.mesh import Mesh
from pyblast.mesh.quality import count_blocks, least_stretch, validate


def test_a_split_mesh_is_valid_although_its_nodes_coincide():
    mesh = structured_box((3, 3, 3), (3.0, 3.0, 3.0), planes={"a": ("x", 1.0), "b": ("z", 1.0)})

    assert validate(mesh.split("ab")) is None


def test_a_defect_is_placed():
    mesh = structured_box((1, 1, 1), (1.0, 1.0, 1.0))
    zones = mesh.zones.copy()
    zones[3] = zones[3][[1, 0, 2, 3]]

    with pytest.raises(InputError, match=r"1 zones are inverted .* the first is zone 3 of 'rock'"):
        validate(Mesh(mesh.points, zones, mesh.zone_group, mesh.groups, {}))


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


SIDES = ("west", "east", "south", "north", "bottom", "top")


def test_a_body_without_joints_is_no_removable_block():
    mesh = structured_box((2, 2, 2), (1.0, 1.0, 1.0)).split(())

    census = count_blocks(mesh, SIDES)

    assert census.free.all()
    assert not census.removable.any()


def test_a_slab_between_joints_leaves_through_any_of_its_free_sides():
    planes = {"a": ("x", [1.0, 2.0])}
    mesh = structured_box((3, 2, 2), (3.0, 2.0, 2.0), planes=planes).split("a")

    census = count_blocks(mesh, SIDES[2:])

    assert sorted(census.removable) == [False, False, True]


def test_least_stretch_is_the_smallest_singular_value():
    draws = np.random.default_rng(4).normal(size=(500, 3, 3))
    turned = np.linalg.qr(draws[0])[0]
    matrices = np.concatenate([draws, [turned, 3.0 * np.eye(3), np.diag([5.0, 5.0, 1e-3])]])

    wanted = np.linalg.svd(matrices, compute_uv=False)[:, -1]
    np.testing.assert_allclose(least_stretch(matrices), wanted, rtol=1e-6, atol=1e-7)
