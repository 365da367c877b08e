"""Terrain: benches and surveys cut the blocks, joints stay planes, volumes are exact."""

import numpy as np
import pytest

from pyblast.errors import InputError
from pyblast.mesh import tetrahedra
from pyblast.mesh.builder import Fault, Layer, build_mesh, build_mesh_report
from pyblast.mesh.faces import face_vectors
from pyblast.model.terrain import (
    Bench,
    bench_triangles,
    burdens,
    toe_of,
    walked,
)

BOX = np.array([(0.0, 60.0), (0.0, 30.0), (-30.0, 0.0)])
CREST = np.array([[30.0, 0.0, 0.0], [30.0, 30.0, 0.0]])
BENT = np.array([[25.0, 0.0, 0.0], [32.0, 15.0, 0.0], [27.0, 30.0, 0.0]])
FAULT = Fault("F", np.radians(60.0), np.radians(70.0), (25.0, 15.0, -5.0))


def leaning(mesh, normal):
    """Return the angles in degrees between the facets of F and a plane."""
    areas = face_vectors(mesh.points, mesh.surfaces["F"])
    across = np.linalg.norm(np.cross(areas, normal), axis=1)
    return np.degrees(np.arctan2(across, np.abs(areas @ normal)))


def volume(mesh):
    return tetrahedra.volumes(mesh.points, mesh.zones).sum()


def benches(dip):
    upper = Bench(CREST, toe_of(CREST, 8.0, np.radians(dip)))
    second = np.add(CREST, [12.0, 0.0, -8.0])
    return [upper, Bench(second, toe_of(second, 6.0, np.radians(dip)))]


@pytest.mark.parametrize("sense", [(1, 1), (1, -1), (-1, 1), (-1, -1)])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_lines_are_walked_with_the_lower_ground_on_the_right(sense, side):
    lines = BENT, np.add(BENT, [side * 6.0, 0.0, -10.0])

    crest, toe = walked(*(line[::step] for line, step in zip(lines, sense, strict=True)))

    run = np.diff(crest[:, :2], axis=0)
    right = np.column_stack([run[:, 1], -run[:, 0]])
    assert (np.einsum("ni,ni->n", (toe - crest)[:-1, :2], right) > 0.0).all()
    Bench(crest, toe)


@pytest.mark.parametrize("dip", [90.0, 70.0])
def test_two_benches_leave_exactly_the_ground_below_them(dip):
    surface = bench_triangles(benches(dip), BOX)

    mesh = build_mesh(BOX, [Layer("rock")], [], [FAULT], edge=7.0, surface=surface)

    cot = 0.0 if dip == 90.0 else 1.0 / np.tan(np.radians(dip))
    air = 30.0 * (8.0 * (30.0 - 4.0 * cot) + 6.0 * (18.0 - 3.0 * cot))
    assert volume(mesh) == pytest.approx(60.0 * 30.0 * 30.0 - air, rel=1e-5)
    assert leaning(mesh, FAULT.unit_normal).max() < 1e-4


def test_an_upright_face_is_part_of_the_free_top():
    surface = bench_triangles([Bench(CREST, CREST - [0.0, 0.0, 8.0])], BOX)

    mesh = build_mesh(BOX, [Layer("rock")], edge=7.0, surface=surface)

    areas = tetrahedra.triangle_vectors(mesh.points, mesh.surfaces["top"])
    assert np.abs(areas).sum(axis=0) == pytest.approx([30.0 * 8.0, 0.0, 60.0 * 30.0], abs=1e-6)
    assert np.linalg.norm(areas, axis=1).sum() == pytest.approx(30.0 * 8.0 + 60.0 * 30.0)


def test_a_bent_crest_has_the_volume_between_its_two_faces():
    toe = toe_of(BENT, 8.0, np.radians(60.0))
    surface = bench_triangles([Bench(BENT, toe)], BOX)
    mesh = build_mesh(BOX, [Layer("rock")], edge=7.0, surface=surface)

    # Between toe and crest the face is a plane through two parallel lines on each side.
    y = np.linspace(0.0, 30.0, 3001)

    def section(depth):
        line = BENT + depth / 8.0 * (toe - BENT)
        right = line[-1] + (line[-1] - line[-2]) * 10.0
        left = line[0] + (line[0] - line[1]) * 10.0
        line = np.vstack([left, line, right])
        return np.trapezoid(60.0 - np.interp(y, line[:, 1], line[:, 0]), y)

    depths = np.linspace(0.0, 8.0, 33)
    air = np.trapezoid([section(depth) for depth in depths], depths)
    assert volume(mesh) == pytest.approx(54000.0 - air, rel=2e-4)


def test_a_hill_keeps_a_dipping_fault_plane_where_stretching_would_bend_it():
    x, y = np.meshgrid(np.linspace(-5.0, 65.0, 15), np.linspace(-5.0, 35.0, 9))
    places = np.column_stack([x.ravel(), y.ravel(), -6.0 + 5.0 * np.sin(x.ravel() / 12.0)])

    mesh, report = build_mesh_report(
        BOX, [Layer("rock")], [], [FAULT], edge=8.0, surface=places, tolerance=1.0
    )

    assert leaning(mesh, FAULT.unit_normal).max() < 1e-3
    assert report.terrain < 0.06 * 8.0
    assert report.refused == 0


def test_the_toe_of_a_bent_crest_lies_at_the_same_distance_from_both_faces():
    toe = toe_of(BENT, 6.0, np.radians(45.0))
    middles = 0.5 * (toe[1:] + toe[:-1]) + [0.0, 0.0, 1.0]

    found = burdens([Bench(BENT, BENT - [0.0, 0.0, 6.0])], middles)

    assert found == pytest.approx([-6.0, -6.0])
    assert toe[:, 2] == pytest.approx(-6.0)


def test_burden_is_measured_at_the_height_of_the_charge():
    bench = Bench(CREST, toe_of(CREST, 8.0, np.radians(45.0)))

    found = burdens([bench], [[27.0, 10.0, 0.0], [27.0, 10.0, -4.0], [27.0, 10.0, -20.0]])

    assert found == pytest.approx([3.0, 7.0, np.inf])


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Bench(CREST, CREST), "the toe must lie below the crest"),
        (lambda: Bench(CREST[:1], CREST), "crest needs two points"),
        (lambda: Bench(CREST[[0, 0, 1]], CREST), "the same place twice"),
        (lambda: bench_triangles([Bench(CREST, CREST - [5, 0, 8])], BOX), "on its right"),
        (lambda: bench_triangles([Bench(CREST, np.add(CREST[0], [[-3, 0, -8], [3, 30, -8]]))], BOX),
         "two lines cross"),
        (lambda: build_mesh(BOX, [Layer("rock")], edge=9.0,
                            surface=bench_triangles(benches(90.0), BOX[:, :])[:3]), "must cover"),
    ],
)  # fmt: skip
def test_a_bench_that_can_not_be_cut_is_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()
