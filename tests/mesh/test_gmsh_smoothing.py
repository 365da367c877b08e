"""Repair of thin zones: they get thicker, and nothing that was mapped moves."""

import numpy as np
import pytest

from pyblast import core
from pyblast.mesh import gmsh, tetrahedra
from pyblast.mesh.builder import Layer, build_mesh, structured_box
from pyblast.mesh.gmsh import smoothed, split_flat, tangent_projectors, thinness

SIDES = ("west", "east", "south", "north", "bottom", "top")


def crooked():
    """Return a grid with inner nodes, and nodes of its top within the top, pushed aside."""
    mesh = structured_box((4, 4, 4), (4.0, 4.0, 4.0))
    points = mesh.points.copy()
    inner = ((points > 0.0) & (points < 4.0)).all(axis=1)
    rng = np.random.default_rng(0)
    points[inner] += rng.uniform(-0.25, 0.25, (inner.sum(), 3))
    lid = (points[:, 2] == 4.0) & ((points[:, :2] > 0.0) & (points[:, :2] < 4.0)).all(axis=1)
    points[lid, :2] += rng.uniform(-0.25, 0.25, (lid.sum(), 2))
    assert tetrahedra.volumes(points, mesh.zones).min() > 0.0
    return points, mesh.zones, [mesh.surfaces[name] for name in SIDES]


def test_the_thinnest_zones_get_thicker():
    points, zones, patches = crooked()

    before, after = thinness(points, zones), thinness(smoothed(points, zones, patches), zones)

    assert after.min() > 2.0 * before.min()
    assert np.percentile(after, 5) > 1.5 * np.percentile(before, 5)


def test_no_zone_is_turned_inside_out():
    points, zones, patches = crooked()

    assert tetrahedra.volumes(smoothed(points, zones, patches), zones).min() > 0.0


def test_nodes_stay_on_their_faces_lines_and_corners():
    points, zones, patches = crooked()

    moved = smoothed(points, zones, patches)

    for axis in range(3):
        for level in (0.0, 4.0):
            there = points[:, axis] == level
            assert moved[there, axis] == pytest.approx(level, abs=1e-12)
    corner = ((points == 0.0) | (points == 4.0)).all(axis=1)
    assert (moved[corner] == points[corner]).all()
    assert (moved != points).any()


def test_a_node_is_free_in_the_ways_that_all_its_patches_share():
    points, _, patches = crooked()

    freedom = np.trace(tangent_projectors(points, patches), axis1=1, axis2=2)

    faces = ((points == 0.0) | (points == 4.0)).sum(axis=1)
    assert freedom == pytest.approx(3.0 - faces, abs=1e-12)


def test_a_good_mesh_is_left_alone():
    mesh = structured_box((3, 3, 3), (3.0, 3.0, 3.0))
    patches = [mesh.surfaces[name] for name in SIDES]

    assert (smoothed(mesh.points, mesh.zones, patches) == mesh.points).all()


def test_meshing_by_hxt_leaves_a_run_its_threads(monkeypatch):
    monkeypatch.setattr(gmsh, "_MANY", 0)
    before = core.n_threads()

    build_mesh([[0.0, 40.0]] * 3, [Layer("rock")], edge=15.0)

    assert core.n_threads() == before


def test_a_flat_mesh_of_hxt_is_made_again_by_delaunay(monkeypatch):
    def zones(made_by_hxt, allowed):
        monkeypatch.setattr(gmsh, "_MANY", 0 if made_by_hxt else 10**9)
        monkeypatch.setattr(gmsh, "_THINNEST", allowed)
        return build_mesh([[0.0, 40.0]] * 3, [Layer("rock")], edge=8.0).zones

    delaunay = zones(False, 0.0)

    assert not np.array_equal(zones(True, 0.0), delaunay)
    np.testing.assert_array_equal(zones(True, 1.0), delaunay)


def test_a_flat_zone_in_a_face_is_split_without_change_of_the_face():
    points = np.array([[0, 0, 0], [1, 1, 0], [1, 0, 0], [0, 1, 0], [0.5, 0.5, 1.0]])
    zones = np.array([[4, 0, 3, 2], [0, 1, 2, 3], [4, 1, 2, 3]])
    base = np.array([[0, 1, 2], [0, 1, 3]])
    assert thinness(points, zones)[1] == 0.0

    new_points, parts, parent = split_flat(points, zones, base)

    assert tetrahedra.volumes(new_points, parts).sum() == pytest.approx(1.0 / 3.0)
    assert tetrahedra.volumes(new_points, parts).min() > 0.0
    assert thinness(new_points, parts).min() > 0.1
    assert (new_points[:5] == points).all()
    assert parent.tolist() == [0, 0, 1, 1, 2, 2]
    for triangle in base:
        assert (np.isin(parts, triangle).sum(axis=1) == 3).sum() == 1


def test_zones_with_a_volume_are_not_split():
    points, zones, patches = crooked()

    same = split_flat(points, zones, np.concatenate(patches))

    assert (same[0] == points).all()
    assert (same[1] == zones).all()
