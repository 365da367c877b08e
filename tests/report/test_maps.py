from dataclasses import replace

import numpy as np
import pytest
from small_project import written

from pyblast.mesh.builder import structured_box
from pyblast.mesh.faces import faces_of_skin, zone_faces
from pyblast.project.result import read_result
from pyblast.report.maps import (
    ascii_grid,
    equal_area,
    great_circle,
    pole,
    shown_surface,
    stereonet_figure,
    surface_of,
    write_surface,
)
from pyblast.workflows import run


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("maps")
    return run.run(written(folder), report=False).folder


def read_grid(text):
    lines = text.splitlines()
    head = {name: float(value) for name, value in (line.split() for line in lines[:6])}
    return head, np.array([[float(v) for v in line.split()] for line in lines[6:]])


def test_a_grid_holds_a_plane_exactly_with_rows_from_the_north():
    mesh = structured_box((4, 3, 1), (40.0, 30.0, 10.0))
    values = 2.0 * mesh.points[:, 0] - mesh.points[:, 1] + 100.0

    head, grid = read_grid(ascii_grid(mesh.points, mesh.surfaces["top"], values))

    assert grid.shape == (head["nrows"], head["ncols"])
    east = head["xllcorner"] + head["cellsize"] * (0.5 + np.arange(grid.shape[1]))
    north = head["yllcorner"] + head["cellsize"] * (0.5 + np.arange(grid.shape[0]))[::-1]
    expected = 2.0 * east[None, :] - north[:, None] + 100.0
    known = grid != -9999.0
    assert known.mean() > 0.8
    np.testing.assert_allclose(grid[known], expected[known], rtol=1e-5)


def test_the_skin_is_closed_and_leaves_joints_out(folder):
    result = read_result(folder / "result.h5")
    points, zones = (result.arrays["mesh"][name] for name in ("points", "zones"))

    welded = np.unique(points, axis=0, return_inverse=True)[1].reshape(-1)[zones]
    face = faces_of_skin(welded, np.arange(len(zones)), np.arange(len(zones)))
    triangles = zone_faces(zones)[face]

    corners = points[triangles]
    area = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    np.testing.assert_allclose(area.sum(axis=0), 0.0, atol=1e-9)
    assert np.linalg.norm(area, axis=1).sum() == pytest.approx(2.0 * (1200 + 1800 + 600))
    assert np.linalg.norm(area[:, 2:], axis=1).sum() == pytest.approx(2.0 * 1200)
    assert face.max() < 4 * len(zones)


def test_peaks_of_the_surface_hold_those_of_the_receiver(folder):
    result = read_result(folder / "result.h5")
    table = np.genfromtxt(folder / "surface_peaks.csv", delimiter=",", names=True)
    (name, receiver), *_ = result.summary["receivers"].items()
    away = np.hypot(
        table["east_m"] - receiver["position"][0], table["north_m"] - receiver["position"][1]
    )

    near = table["peak_vector_sum_mm_per_s"][away <= 15.0]

    assert len(table) == len(np.unique(shown_surface(result)[1]))
    assert near.min() <= 1e3 * receiver["simulated"]["pvs"] <= 1.02 * near.max(), name


def test_peaks_of_the_surface_are_in_coordinates_of_the_site(folder, tmp_path):
    result = read_result(folder / "result.h5")
    shifted = replace(result, summary=result.summary | {"shift_m": [100.0, -20.0, 5.0]})

    write_surface(tmp_path, shifted)

    here, site = (
        np.genfromtxt(each / "surface_peaks.csv", delimiter=",", skip_header=1)
        for each in (folder, tmp_path)
    )
    assert here - site == pytest.approx(np.tile([100.0, -20.0, 5.0, 0.0], (len(here), 1)))


@pytest.mark.parametrize("order", [None, 3])
def test_a_surface_holds_all_nodes_on_the_top_and_its_whole_area(order):
    from pyblast.model.material import Material
    from pyblast.model.model import Model

    mesh = structured_box(
        (4, 3, 1), (40.0, 30.0, 10.0), **({} if order is None else {"order": order})
    )
    model = Model(mesh, {"rock": Material.from_speeds(2700.0, 5000.0, 3000.0)})

    points, triangles, node = surface_of(model)

    corners = points[triangles][:, :, :2]
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = 0.5 * (first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])
    assert (area > 0.0).all()
    assert area.sum() == pytest.approx(1200.0)
    assert (points[:, 2] == points[:, 2].max()).all()
    np.testing.assert_array_equal(points, model.nodes.points[node])
    assert len(points) == (20 if order is None else 13 * 10)


def test_a_stereonet_is_equal_area_and_poles_stand_normal_to_their_planes():
    np.testing.assert_allclose(pole(0.0, 77.0), 0.0, atol=1e-12)
    np.testing.assert_allclose(pole(90.0, 90.0), [-1.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(np.hypot(*pole(60.0, 135.0)) ** 2, 2.0 * np.sin(np.pi / 6.0) ** 2)
    for dip, direction in ((30.0, 45.0), (60.0, 200.0), (90.0, 0.0)):
        circle = great_circle(dip, direction)
        radius = np.hypot(*circle.T)
        assert radius.max() == pytest.approx(1.0)
        nearest = circle[radius.argmin()]  # the line of dip
        np.testing.assert_allclose(
            nearest, equal_area(np.radians(direction), np.radians(dip)), atol=1e-9
        )


def test_a_stereonet_is_drawn_of_joints_with_an_orientation_only():
    rows = {"F1": {"dip": 60.0, "dip_direction": 135.0}, "mine": {"dip": None}}

    assert stereonet_figure(rows, ["F1"]).startswith("data:image/png")
    assert stereonet_figure({"mine": {"dip": None}}, []) is None
