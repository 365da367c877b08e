"""Hexahedra cut from tetrahedra: volumes, planes, sides and layer are those that were asked for."""

import numpy as np
import pytest

from pyblast.mesh.builder import build_mesh
from pyblast.mesh.faces import face_vectors
from pyblast.mesh.grid import SIDES, Fault, Geometry, JointSet, Layer
from pyblast.mesh.hexahedra import corner_neighbours
from pyblast.mesh.hexahedral import subdivided
from pyblast.mesh.hexahedral.mapped import Fine, Surface
from pyblast.mesh.hexahedral.planes import NotMapped
from pyblast.mesh.hexahedral.subdivided import build_subdivided, subdivide
from pyblast.mesh.mesh import outer_faces, zone_volumes
from pyblast.mesh.quality import explicit_work

BOX = np.array([[0.0, 100.0], [0.0, 80.0], [-60.0, 0.0]])
OPEN = ("west", "east", "south", "north", "bottom")
ROCK = (Layer("rock"),)


def fault(dip, towards, through, name="F", **extent):
    return Fault(name, np.radians(dip), np.radians(towards), through, **extent)


MEETING = (fault(60, 90, (30.0, 40.0, 0.0)), fault(70, 40, (60.0, 40.0, 0.0), "G"))


def built(faults=MEETING, sets=(), open_sides=OPEN, layers=ROCK, edge=20.0, **options):
    standing = frozenset(SIDES) - set(open_sides)
    surface = options.pop("surface", None)
    geometry = Geometry(BOX, layers, tuple(sets), tuple(faults), surface, standing)
    return build_subdivided(geometry, [edge] * len(layers), options.pop("order", 3), **options)


def area(mesh, name):
    return np.linalg.norm(face_vectors(mesh.points, mesh.surfaces[name]), axis=1).sum()


def test_each_tetrahedron_becomes_four_hexahedra_of_its_volume():
    cut = build_mesh(BOX, [Layer("rock", edge=50.0)], faults=MEETING)
    points, zones, surfaces = subdivide(cut)

    assert zones.shape == (4 * len(cut.zones), 8)
    columns = points[corner_neighbours(zones)]
    assert np.linalg.det(columns[:, 1:] - columns[:, :1]).min() > 0.0
    for name, triangles in cut.surfaces.items():
        whole = np.linalg.norm(face_vectors(cut.points, triangles), axis=1).sum()
        parts = np.linalg.norm(face_vectors(points, surfaces[name]), axis=1).sum()
        assert len(surfaces[name]) == 3 * len(triangles)
        assert parts == pytest.approx(whole)


def test_faults_of_different_dip_and_strike_meet_between_sides_that_stand():
    mesh = built(open_sides=("bottom",))

    assert zone_volumes(mesh).min() > 0.0
    assert zone_volumes(mesh).sum() == pytest.approx(100.0 * 80.0 * (60.0 + 60.0))
    for plane in MEETING:
        at = mesh.points[mesh.surfaces[plane.name]]
        inside = (at[..., 2] > -60.0 - 1e-6).all(axis=1)
        assert np.abs((at[inside] - plane.point) @ plane.unit_normal).max() < 1e-6
    for number, side in enumerate(SIDES[:4]):
        limit = BOX[number // 2, number % 2]
        assert np.abs(mesh.points[mesh.surfaces[side]][..., number // 2] - limit).max() < 1e-9


def test_the_layer_is_drawn_from_open_sides_and_closes_the_mesh():
    mesh = built()

    assert mesh.points.min(axis=0) == pytest.approx([-60.0, -60.0, -120.0])
    assert mesh.points.max(axis=0) == pytest.approx([160.0, 140.0, 0.0])
    faces = {tuple(sorted(face)) for face in outer_faces(mesh).tolist()}
    assert {tuple(sorted(f)) for side in SIDES for f in mesh.surfaces[side].tolist()} == faces
    assert mesh.layer.depths(BOX.T).max() == 0.0
    split = mesh.split(["F", "G"])
    assert split.contacts.names == ("F", "G")
    beyond = mesh.points[mesh.surfaces["F"]][..., 1].max()
    assert beyond == pytest.approx(140.0)  # faults go on through the layer


def test_sets_end_at_the_layer_and_layers_keep_their_heights():
    layers = (Layer("soil", 25.0), Layer("rock"))
    joints = JointSet("S", np.radians(50.0), 0.4, 40.0, regions=("rock",))
    mesh = built(sets=[joints], layers=layers)

    at = mesh.points[mesh.surfaces["S"]]
    assert at.max(axis=(0, 1))[2] <= -25.0 + 1e-6
    assert (at.min(axis=(0, 1)) >= BOX[:, 0] - 1e-6).all()
    soil = mesh.points[mesh.zones[mesh.zone_group == 0]]
    assert soil[..., 2].min() == pytest.approx(-25.0)


def test_smoothing_lengthens_the_step_and_moves_nodes_within_their_faces(monkeypatch):
    monkeypatch.setattr(subdivided, "TRIALS", (1.0,))
    smooth = built()
    monkeypatch.setattr(subdivided, "POOR", 0.0)
    rough = built()

    assert explicit_work(smooth) < 0.9 * explicit_work(rough)
    assert area(smooth, "F") == pytest.approx(area(rough, "F"), rel=1e-9)


def test_triangles_of_a_terrain_are_served():
    corners = [(-10.0, -10.0, 0.0), (110.0, -10.0, 12.0), (110.0, 90.0, 12.0), (-10.0, 90.0, 0.0)]
    surface = np.array([[corners[0], corners[1], corners[2]], [corners[0], corners[2], corners[3]]])
    mesh = built(faults=(), surface=surface, open_sides=("bottom", "west"))

    top = mesh.points[mesh.surfaces["top"]]
    inside = (top[..., 0] >= 0.0).all(axis=1)
    assert top[inside][..., 2] == pytest.approx(1.0 + 0.1 * top[inside][..., 0])
    assert zone_volumes(mesh).min() > 0.0


def test_fine_parts_have_smaller_hexahedra_and_high_orders_are_refused():
    part = Fine(np.array([[20.0, 30.0], [30.0, 40.0], [-20.0, -10.0]]), 10.0)

    assert len(built((), edge=30.0, lines=[part]).zones) > 1.2 * len(built((), edge=30.0).zones)
    with pytest.raises(NotMapped, match="order 2 to 4, not 5"):
        built(order=5)


def test_another_trial_is_made_while_it_may_shorten_a_run(monkeypatch):
    works = {1.0: 400.0, 0.93: 120.0, 0.86: 130.0, 0.8: 50.0}
    tried, mesh = [], built(faults=(), edge=30.0)
    cubes = len(mesh.zones) * 3**3 / 30.0

    def cut(_, sizes, *__):
        tried.append(sizes[0] / 30.0)
        return mesh

    monkeypatch.setattr(subdivided, "_cut", cut)
    monkeypatch.setattr(subdivided, "explicit_work", lambda _: works[tried[-1]] * cubes / tried[-1])
    built(faults=(), edge=30.0)

    assert tried == pytest.approx([1.0, 0.93, 0.86])


def test_the_top_is_raised_to_its_survey_within_its_planes(monkeypatch):
    x, y = np.meshgrid(np.arange(-20.0, 101.0, 5.0), np.arange(-20.0, 81.0, 5.0))
    height = 8.0 * np.exp(-(((x - 45.0) / 22.0) ** 2) - ((y - 30.0) / 20.0) ** 2)
    survey = np.column_stack([x.ravel(), y.ravel(), height.ravel()])
    plane = fault(60, 90, (40.0, 30.0, -15.0))
    box = np.array([[0.0, 80.0], [0.0, 60.0], [-30.0, 0.0]])

    ground = Geometry(box, (Layer("rock"),), (), (plane,), survey, standing=frozenset(SIDES))

    def away(mesh):
        top = mesh.points[np.unique(mesh.surfaces["top"])]
        return np.sqrt(np.mean((top[:, 2] - Surface(ground).height(top[:, :2])) ** 2))

    mesh = build_subdivided(ground, [15.0], 3)
    monkeypatch.setattr(subdivided, "RAISES", 0)

    assert away(mesh) < 0.3 * away(build_subdivided(ground, [15.0], 3))
    on_plane = mesh.points[np.unique(mesh.surfaces["F"])] - plane.point
    np.testing.assert_allclose(on_plane @ plane.unit_normal, 0.0, atol=1e-6)
