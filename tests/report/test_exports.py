import json
from xml.etree import ElementTree

import meshio
import numpy as np
import pytest
from PIL import Image
from small_project import written

from pyblast.errors import InputError
from pyblast.project.result import Result, read_result
from pyblast.report.exports import write_features, write_movie
from pyblast.report.maps import shown_surface
from pyblast.workflows import run

SHIFT = [1000.0, -500.0, 20.0]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("exports")
    path = written(folder, ("snapshots_s = [0.05]", "snapshots_s = [0.02, 0.05, 0.09]"))
    return run.run(path, report=False).folder


@pytest.fixture(scope="module")
def result(folder):
    return read_result(folder)


@pytest.fixture(scope="module")
def features(result, tmp_path_factory):
    path = tmp_path_factory.mktemp("features") / "features.geojson"
    write_features(path, Result(result.arrays, result.summary | {"shift_m": SHIFT}))
    return path


def kind(path, name):
    rows = json.loads(path.read_text("utf-8"))["features"]
    return [row for row in rows if row["properties"]["kind"] == name]


def test_features_stand_in_the_coordinates_of_the_site(result, features):
    (receiver,) = kind(features, "receiver")
    holes = kind(features, "hole")

    there = np.array(result.summary["receivers"]["R1"]["position"]) - SHIFT
    np.testing.assert_allclose(receiver["geometry"]["coordinates"], there, atol=1e-3)
    for hole, feature in zip(result.summary["blast"]["holes"], holes, strict=True):
        line = np.array([hole["collar"], hole["toe"]]) - SHIFT
        np.testing.assert_allclose(feature["geometry"]["coordinates"], line, atol=1e-3)
    largest = 1e3 * max(result.summary["receivers"]["R1"]["simulated"]["ppv"])
    assert receiver["properties"]["simulated_ppv_mm_per_s"] == pytest.approx(largest, abs=1e-4)


def test_the_trace_of_a_fault_lies_on_it(features):
    (fault,) = kind(features, "fault")

    trace = np.array(fault["geometry"]["coordinates"]) + SHIFT
    np.testing.assert_allclose(trace[..., 0], 30.0, atol=2e-3)  # upright, through east 30 m
    np.testing.assert_allclose(trace[..., 2], 30.0, atol=2e-3)  # the top
    length = np.linalg.norm(np.diff(trace, axis=1), axis=-1).sum()
    assert length == pytest.approx(20.0, rel=1e-3) or length == pytest.approx(40.0, rel=1e-3)


def test_a_contour_passes_between_smaller_and_larger_peaks(result, features):
    points, triangles, peak = shown_surface(result)
    corners, peaks = points[triangles][..., :2], 1e3 * peak[triangles]

    contours = kind(features, "contour")

    assert contours
    for contour in contours:
        level = contour["properties"]["peak_vector_sum_mm_per_s"]
        for line in contour["geometry"]["coordinates"]:
            at = np.array(line[0]) + SHIFT[:2]
            box = (corners.min(axis=1) - 2e-3 <= at) & (at <= corners.max(axis=1) + 2e-3)
            near = peaks[box.all(axis=1)]
            assert near.min() <= level <= near.max()


def test_gdal_reads_the_features(features):
    ogr = pytest.importorskip("pyogrio")

    about = ogr.read_info(features)

    assert about["features"] == len(json.loads(features.read_text("utf-8"))["features"])


def test_one_file_opens_the_ground_and_each_joint(result, folder):
    blocks = ElementTree.parse(folder / "model.vtm").getroot().iter("DataSet")
    files = {block.get("name"): block.get("file") for block in blocks}

    assert list(files) == ["ground", "F1"]
    fault = meshio.read(folder / files["F1"])
    own = np.unique(fault.cells_dict["triangle"])
    np.testing.assert_allclose(fault.points[own, 0], 30.0)
    slip = fault.point_data["shear offset [m]"][own]
    contacts, moved = result.arrays["contacts"], result.arrays["state"]["displacement"]
    jump = moved[contacts["plus"]] - moved[contacts["minus"]]
    jump -= np.sum(jump * contacts["normal"], axis=1)[:, None] * contacts["normal"]
    assert slip.max() == pytest.approx(np.linalg.norm(jump, axis=1).max())


def test_vtk_reads_the_parts(folder):
    pyvista = pytest.importorskip("pyvista")

    blocks = pyvista.read(folder / "model.vtm")

    assert blocks.keys() == ["ground", "F1"]
    assert blocks["ground"].n_cells == len(read_result(folder).arrays["mesh"]["zones"])


def test_a_result_is_a_grid_of_pyvista(result):
    pytest.importorskip("pyvista")

    grid = result.to_pyvista()

    assert grid.n_cells == len(result.arrays["mesh"]["zones"])
    assert grid.bounds == pytest.approx((0.0, 60.0, 0.0, 20.0, 0.0, 30.0))
    for time, velocity in result.arrays["snapshots"].items():
        np.testing.assert_array_equal(
            grid.point_data[f"velocity at {float(time):g} s [m/s]"], velocity
        )


@pytest.mark.figures
def test_a_movie_has_a_frame_for_each_snapshot(result, tmp_path):
    seen = []

    write_movie(tmp_path / "motion.webp", result, lambda *now: seen.append(now))

    with Image.open(tmp_path / "motion.webp") as movie:
        assert movie.n_frames == 3
        assert movie.width > 600
        frames = [np.asarray(movie.convert("RGB")) for n in range(3) if not movie.seek(n)]
    assert np.any(frames[0] != frames[2])
    assert seen == [("movie", 0, 3), ("movie", 1, 3), ("movie", 2, 3)]


def test_a_movie_of_one_snapshot_is_refused_with_what_to_add(result, tmp_path):
    one = dict(list(result.arrays["snapshots"].items())[:1])
    still = Result({**result.arrays, "snapshots": one}, result.summary)

    with pytest.raises(InputError, match=r"snapshots_s.*two snapshots"):
        write_movie(tmp_path / "motion.webp", still)
