"""Surveyed geometry: every format gives the same ground; units, blocks and missing cells."""

from pathlib import Path

import ezdxf
import numpy as np
import pytest
import tifffile

from pyblast.config.ground import LengthUnit, MeshConfig
from pyblast.errors import InputError, ReadError
from pyblast.ground.surface import benches_of, survey_of
from pyblast.model.fractures import read_fractures
from pyblast.readers.geometry import LENGTHS, read_faces, read_lines, read_surface
from pyblast.readers.provenance import ReadLog

REPORTED = Path(__file__).parents[1] / "reported"
BOX = np.array([(0.0, 50.0), (0.0, 40.0), (0.0, 60.0)])
PIT = np.array([(0.0, 100.0), (0.0, 100.0), (-30.0, 30.0)])


def volume(triangles, floor=0.0):
    """Volume between triangles and a floor, by the areas in plan and the mean heights."""
    a, b, c = (triangles[:, k] for k in range(3))
    area = 0.5 * np.abs(np.cross(b - a, c - a)[:, 2])
    return float(area @ (triangles[:, :, 2].mean(axis=1) - floor))


def surface(folder, name, **options):
    return read_surface(REPORTED / folder / name, **{"box": BOX, **options}).values


# 18: blocks


@pytest.mark.parametrize(("name", "expected"), [("leftover", 61_000.0), ("lowered", 70_000.0)])
def test_18_blocks_stand_where_they_are_inserted_and_nowhere_else(name, expected):
    assert volume(surface("18-dxf-blocks", f"{name}.dxf")) == pytest.approx(expected)


def test_18_blocks_within_blocks_are_turned_scaled_and_moved(tmp_path):
    drawing = ezdxf.new()
    inner, outer = drawing.blocks.new("IN", base_point=(1, 0, 0)), drawing.blocks.new("OUT")
    inner.add_3dface([(1, 0, 0), (5, 0, 0), (5, 3, 1), (1, 3, 1)])
    outer.add_blockref("IN", (10, 0, 5), {"rotation": 90.0})
    drawing.modelspace().add_blockref("OUT", (100, 0, 0), {"xscale": 2, "yscale": 2, "zscale": 3})
    drawing.saveas(tmp_path / "a.dxf")

    triangles = read_surface(tmp_path / "a.dxf", unit="m").values

    corners = np.unique(triangles.reshape(-1, 3).round(9), axis=0)
    assert corners.tolist() == [[114, 0, 18], [114, 8, 18], [120, 0, 15], [120, 8, 15]]


def test_18_a_block_of_another_drawing_is_refused(tmp_path):
    drawing = ezdxf.new()
    drawing.add_xref_def("pit.dwg", "PIT")
    drawing.modelspace().add_blockref("PIT", (0, 0))
    drawing.saveas(tmp_path / "a.dxf")

    with pytest.raises(ReadError, match="'PIT', which lies in another drawing"):
        read_surface(tmp_path / "a.dxf")


def test_18_hidden_layers_are_left_out_and_logged(tmp_path):
    drawing = layered({"TOPO": 10.0, "OLD": 20.0})
    drawing.layers.get("OLD").off()
    drawing.saveas(tmp_path / "a.dxf")
    log = ReadLog()

    triangles = read_surface(tmp_path / "a.dxf", unit="m", log=log).values

    assert np.unique(triangles[:, :, 2]) == pytest.approx([10.0])
    assert "hidden layers (OLD)" in "".join(log.lines())


def layered(heights):
    drawing = ezdxf.new()
    for name, z in heights.items():
        drawing.layers.add(name)
        corners = [(x, y, z) for x, y in [(-5, -5), (55, -5), (55, 45), (-5, 45)]]
        drawing.modelspace().add_3dface(corners, dxfattribs={"layer": name})
    return drawing


def test_18_faces_of_two_layers_over_each_other_need_a_choice(tmp_path):
    layered({"TOPO": 50.0, "DESIGN": 30.0}).saveas(tmp_path / "a.dxf")

    with pytest.raises(InputError, match="'DESIGN' lie over each other; name those of the ground"):
        read_surface(tmp_path / "a.dxf", box=BOX, unit="m")

    chosen = read_surface(tmp_path / "a.dxf", box=BOX, unit="m", layers=["design"]).values
    assert np.unique(chosen[:, :, 2]) == pytest.approx([30.0])
    with pytest.raises(InputError, match="nothing lies on the layer 'X'; layers are DESIGN, TOPO"):
        read_surface(tmp_path / "a.dxf", layers=["X"])


# 19, 50: units of drawings


@pytest.mark.parametrize("name", ["metres", "feet", "millimetres"])
def test_19_a_drawing_is_converted_where_it_fits_the_box_in_its_unit_alone(name):
    found = surface("19-dxf-units", f"{name}.dxf")

    assert volume(found) == pytest.approx(94_000.0, rel=1e-5)
    assert found[:, :, 2].max() == pytest.approx(50.0, rel=1e-6)


def test_50_inches_of_a_template_over_metres_are_metres():
    log = ReadLog()

    found = surface("50-inches-in-the-header-of-metres", "ground.dxf", box=PIT, log=log)

    assert np.ptp(found.reshape(-1, 3)[:, 0]) == pytest.approx(120.0)
    assert "header says in, it fits the box of the mesh in m alone" in "".join(log.lines())


@pytest.mark.parametrize("unit", [unit for unit in LENGTHS if unit != "m"])
def test_19_a_unit_is_never_taken_from_a_template_without_a_box(unit, tmp_path):
    write_drawing(tmp_path / "a.dxf", 60.0, INSUNITS[unit])

    for read in (read_surface, read_faces):
        with pytest.raises(InputError, match=f"header says {unit}.*{unit!r} or 'm'"):
            read(tmp_path / "a.dxf")


INSUNITS = {"in": 1, "ft": 2, "mm": 4, "cm": 5, "m": 6, "km": 7, "us_ft": 21}


def write_drawing(path, size, code, height=0.0):
    drawing = ezdxf.new()
    drawing.header["$INSUNITS"] = code
    low, high = -0.1 * size, 1.1 * size
    corners = [(low, low, height), (high, low, height), (high, high, height), (low, high, height)]
    drawing.modelspace().add_3dface(corners)
    drawing.modelspace().add_line(corners[0], corners[1])
    drawing.saveas(path)


@pytest.mark.parametrize("said", INSUNITS)
@pytest.mark.parametrize("true", ["m", "ft", "mm", "in"])
def test_19_whatever_the_header_says_a_wrong_size_never_passes(said, true, tmp_path):
    box = np.array([(0.0, 100.0), (0.0, 100.0), (0.0, 40.0)])
    write_drawing(tmp_path / "a.dxf", 100.0 / LENGTHS[true], INSUNITS[said], 30.0 / LENGTHS[true])

    found, reason = outcome(tmp_path / "a.dxf", box)

    if found is None:
        assert true != said or "say which unit holds" in reason
    else:
        assert np.ptp(found[:, :, 0]) == pytest.approx(120.0, rel=1e-5)


def outcome(path, box):
    """Return the values of a surface, or None and the reason why it is refused."""
    try:
        return read_surface(path, box=box).values, ""
    except (ReadError, InputError) as error:
        return None, str(error)


def test_19_both_units_that_fit_are_asked_for_and_the_answer_is_taken(tmp_path):
    write_drawing(tmp_path / "a.dxf", 500.0, INSUNITS["ft"], 30.0)
    box = np.array([(0.0, 100.0), (0.0, 100.0), (0.0, 40.0)])

    with pytest.raises(InputError, match="in ft and in m; say which unit holds"):
        read_surface(tmp_path / "a.dxf", box=box)

    found = read_surface(tmp_path / "a.dxf", box=box, unit="ft").values
    assert found[:, :, 2].max() == pytest.approx(9.144)


def test_19_a_drawing_without_unit_that_lies_far_above_its_box_is_refused(tmp_path):
    write_drawing(tmp_path / "a.dxf", 50_000.0, 0, 45_000.0)

    with pytest.raises(InputError, match="would fit in mm: surface_unit = 'mm'"):
        read_surface(tmp_path / "a.dxf", box=BOX)


@pytest.mark.parametrize("code", [2, 4])
def test_19_fractures_are_compared_with_the_box_too(code, tmp_path):
    factor = LENGTHS["ft" if code == 2 else "mm"]
    drawing = ezdxf.new()
    drawing.header["$INSUNITS"] = code
    corners = np.array([(10, 10, 10), (40, 10, 10), (40, 30, 40), (10, 30, 40)]) / factor
    drawing.modelspace().add_3dface(corners)
    drawing.saveas(tmp_path / "f.dxf")

    if code == 2:  # in metres they would meet the box, too
        with pytest.raises(InputError, match="in ft and in m; say which"):
            read_fractures(tmp_path / "f.dxf", "F", box=BOX)
    given = "ft" if code == 2 else None
    (found,) = read_fractures(tmp_path / "f.dxf", "F", box=BOX, unit=given)

    assert np.min(found.polygon, axis=0) == pytest.approx([10.0, 10.0, 10.0])


def test_units_of_project_files_are_those_of_the_reader():
    assert set(LengthUnit.__args__) == set(LENGTHS)


# 20, 47: what a drawing holds


@pytest.mark.parametrize("name", ["mesh_only", "mesh_and_points"])
def test_20_a_polyface_mesh_is_the_ground_and_points_beside_it_are_not(name):
    log = ReadLog()

    found = surface("20-dxf-points-beside-a-mesh", f"{name}.dxf", log=log)

    assert volume(found) == pytest.approx(94_000.0)
    assert ("dropped 4 POINT" in "".join(log.lines())) == (name == "mesh_and_points")


@pytest.mark.parametrize("kind", ["3DFACE", "MESH", "polyface", "polygon mesh"])
def test_20_faces_of_every_kind_are_the_same_ground(kind, tmp_path):
    drawing = ezdxf.new()
    drawing.header["$INSUNITS"] = 6
    space, corners = drawing.modelspace(), [(-5, -5, 44), (55, -5, 44), (55, 45, 50), (-5, 45, 50)]
    if kind == "3DFACE":
        space.add_3dface(corners)
    elif kind == "MESH":
        with space.add_mesh().edit_data() as mesh:
            mesh.vertices, mesh.faces = corners, [[0, 1, 2, 3]]
    elif kind == "polyface":
        space.add_polyface().append_faces([corners])
    else:
        grid = space.add_polymesh((2, 2))
        for at, corner in zip([(0, 0), (0, 1), (1, 1), (1, 0)], corners, strict=True):
            grid.set_mesh_vertex(at, corner)
    drawing.saveas(tmp_path / "a.dxf")

    assert volume(read_surface(tmp_path / "a.dxf", box=BOX).values) == pytest.approx(141_000.0)


@pytest.mark.parametrize("name", ["ground", "ground_with_text", "ground_without"])
def test_47_reading_stops_at_the_end_of_the_drawing(name):
    found = surface("47-lines-after-the-end-of-a-dxf", f"{name}.dxf", box=PIT)

    assert found.shape == (288, 3, 3)
    assert volume(found) == pytest.approx(15.0 * 120.0**2, rel=1e-3)


# 21, 22: grids


@pytest.mark.parametrize("name", ["float32", "nan"])
def test_21_missing_cells_are_said_and_are_no_heights(name):
    grid = read_surface(REPORTED / "21-grid-without-data" / f"{name}.asc", box=BOX)

    assert grid.missing.tolist() == [[5.0, 35.0]]
    assert grid.cell == (10.0, 10.0)
    assert len(grid.values) == 19
    assert grid.values[:, 2].min() == 44.0


def test_21_a_height_that_no_ground_has_is_refused_by_row_and_column():
    with pytest.raises(ReadError, match=r"row 1, column 1: -32768 is no height.*NODATA_value"):
        surface("21-grid-without-data", "other.asc")


@pytest.mark.parametrize(
    "mark", ["-9999", "1.70141e+38", "-3.4028234663852886e+38", "-1e30", "NaN", "-1.#IND", "*"]
)
def test_21_marks_of_missing_cells_of_many_programs(mark, tmp_path):
    text = f"ncols 2\nnrows 2\nxllcenter 0\nyllcenter 0\ncellsize 9\nNODATA_value {mark}\n"
    (tmp_path / "a.asc").write_text(f"{text}1 {mark}\n3 4\n")

    grid = read_surface(tmp_path / "a.asc")

    assert grid.values.tolist() == [[0, 9, 1], [0, 0, 3], [9, 0, 4]]
    assert grid.missing.tolist() == [[9, 9]]


def test_22_oblong_cells_and_decimal_commas():
    oblong = read_surface(REPORTED / "22-headers-of-grids" / "dx_dy.asc")
    commas = read_surface(REPORTED / "22-headers-of-grids" / "commas.asc")

    assert oblong.cell == (10.0, 20.0)
    assert oblong.values[0].tolist() == [5.0, 70.0, 50.0]
    assert oblong.values[-1].tolist() == [45.0, 10.0, 44.0]
    assert commas.values[0].tolist() == [5.5, 35.5, 50.5]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("ncols 2\nnrows 2\nxllcorner 0\nyllcorner 0\n1 2\n3 4\n", "lacks dx, dy"),
        ("ncols 2\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 1\n1 2\n3\n", "2 rows of 2 heights"),
        ("ncols 2\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 1\n1 2\n3 q\n", "row 2, column 2"),
        ("ncols 2\nnrows 1\nxllcorner 0\nyllcorner 0\ncellsize 1\n1,5 2.5\n", "mixes decimal"),
        ("ncols 2.5\nnrows 1\nxllcorner 0\nyllcorner 0\ncellsize 1\n1 2\n", "whole and positive"),
        ("ncols 1e9\nnrows 1e9\nxllcorner 0\nyllcorner 0\ncellsize 1\n1 2\n", "at most 25000000"),
        ("ncols 2\nnrows 1\nxllcorner 0\nyllcorner 0\ncellsize -1\n1 2\n", "positive size"),
        ("ncols 2\nnrows 1\nxllcorner 0\nyllcorner 0\ncellsize 1\n-9999 nan\n", "every cell"),
    ],
)
def test_22_a_grid_that_can_not_be_read_is_refused_with_its_reason(text, message, tmp_path):
    (tmp_path / "a.asc").write_text(text)

    with pytest.raises(ReadError, match=message):
        read_surface(tmp_path / "a.asc")


def test_22_a_grid_in_degrees_is_refused_under_a_box_in_metres(tmp_path):
    head = "ncols 2\nnrows 2\nxllcorner 9.1\nyllcorner 48.7\ncellsize 0.0003\n"
    (tmp_path / "a.asc").write_text(f"{head}450 451\n452 453\n")

    with pytest.raises(InputError, match="degrees of longitude and latitude"):
        read_surface(tmp_path / "a.asc", box=BOX + np.array([[0], [0], [400]]))


def test_22_the_projection_beside_a_grid_counts(tmp_path):
    head = "ncols 2\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 100\n"
    (tmp_path / "a.asc").write_text(f"{head}30 31\n32 33\n")
    (tmp_path / "a.prj").write_text('GEOGCS["GCS_WGS_1984",UNIT["Degree",0.0174532925199433]]')
    with pytest.raises(InputError, match="degrees"):
        read_surface(tmp_path / "a.asc")

    (tmp_path / "a.prj").write_text(
        'PROJCS["x",GEOGCS["y",UNIT["Degree",0.0174532925199433]],UNIT["Foot_US",0.3048006096]]'
    )
    with pytest.raises(InputError, match="unit of its heights is not said"):
        read_surface(tmp_path / "a.asc")
    found = read_surface(tmp_path / "a.asc", unit="us_ft")
    assert found.cell[0] == pytest.approx(30.48006096)


# every format: the same ground


X, Y = np.arange(-5.0, 60.0, 10.0), np.arange(-5.0, 50.0, 10.0)
HEIGHTS = 45.0 + 0.1 * X[None] - 0.05 * Y[:, None]


def esri(path):
    head = f"ncols {len(X)}\nnrows {len(Y)}\nxllcenter -5\nyllcenter -5\ncellsize 10\n"
    path.write_text(head + "\n".join(" ".join(map(str, row)) for row in HEIGHTS[::-1]))


def surfer(path):
    rows = "\n".join(" ".join(map(str, row)) for row in HEIGHTS)
    path.write_text(f"DSAA\n{len(X)} {len(Y)}\n-5 55\n-5 45\n0 99\n{rows}\n")


def geotiff(path, data=HEIGHTS[::-1], scale=(10.0, 10.0, 0.0), keys=(), nodata="", raster=2):
    x, y = (-5.0, 45.0) if raster == 2 else (-10.0, 50.0)
    geo = [1, 1, 0, 1 + len(keys), 1025, 0, 1, raster, *(v for k, n in keys for v in (k, 0, 1, n))]
    tags = [
        (33550, "d", 3, scale, True), (33922, "d", 6, (0, 0, 0, x, y, 0), True),
        (34735, "H", len(geo), geo, True),
    ]  # fmt: skip
    if nodata:
        tags.append((42113, "s", len(nodata) + 1, nodata, True))
    tifffile.imwrite(path, data, extratags=tags, photometric="minisblack", metadata=None)


def corners():
    points = np.array([(x, y, HEIGHTS[j, i]) for j, y in enumerate(Y) for i, x in enumerate(X)])
    n, faces = len(X), []
    for j in range(len(Y) - 1):
        for i in range(n - 1):
            a = j * n + i
            faces += [(a, a + 1, a + n + 1), (a, a + n + 1, a + n)]
    return points, np.array(faces)


def landxml(path, unit='<Metric linearUnit="meter"/>', factor=1.0):
    points, faces = corners()
    rows = "".join(f'<P id="{k + 1}">{y / factor} {x / factor} {z / factor}</P>'
                   for k, (x, y, z) in enumerate(points))  # fmt: skip
    cells = "".join(f"<F>{a + 1} {b + 1} {c + 1}</F>" for a, b, c in faces)
    path.write_text(
        f'<LandXML xmlns="http://www.landxml.org/schema/LandXML-1.2"><Units>{unit}</Units>'
        f'<Surfaces><Surface name="g"><Definition surfType="TIN"><Pnts>{rows}</Pnts>'
        f'<Faces>{cells}<F i="1">1 2 30</F></Faces></Definition></Surface></Surfaces></LandXML>'
    )


def stl(path):
    points, faces = corners()
    rows = "".join(
        "outer loop\n" + "".join(f"vertex {x} {y} {z}\n" for x, y, z in points[face]) + "endloop\n"
        for face in faces
    )
    path.write_text(f"solid g\n{rows}endsolid g\n")


def binary_stl(path):
    points, faces = corners()
    records = np.zeros(len(faces), dtype=[("n", "<f4", 3), ("c", "<f4", (3, 3)), ("a", "<u2")])
    records["c"] = points[faces]
    path.write_bytes(b"\0" * 80 + np.uint32(len(faces)).tobytes() + records.tobytes())


def dxf_points(path):
    drawing = ezdxf.new()
    drawing.header["$INSUNITS"] = 6
    for point in corners()[0]:
        drawing.modelspace().add_point(point)
    drawing.saveas(path)


def dxf_faces(path):
    drawing = ezdxf.new()
    drawing.header["$INSUNITS"] = 6
    points, faces = corners()
    for face in faces:
        drawing.modelspace().add_3dface(points[face])
    drawing.saveas(path)


@pytest.mark.parametrize(
    ("suffix", "write"),
    [("asc", esri), ("txt", esri), ("grd", surfer), ("tif", geotiff),
     ("tif", lambda path: geotiff(path, raster=1)), ("xml", landxml), ("stl", stl),
     ("stl", binary_stl), ("dxf", dxf_points), ("dxf", dxf_faces)],
)  # fmt: skip
@pytest.mark.parametrize("boxed", [False, True])
def test_every_format_gives_the_same_ground(suffix, write, boxed, tmp_path):
    path = tmp_path / f"a.{suffix}"
    write(path)

    found = read_surface(path, box=BOX if boxed else None).values.reshape(-1, 3)

    assert found.min(axis=0) == pytest.approx([-5.0, -5.0, HEIGHTS.min()])
    assert found.max(axis=0) == pytest.approx([55.0, 45.0, HEIGHTS.max()])
    assert found[:, 2] == pytest.approx(45.0 + 0.1 * found[:, 0] - 0.05 * found[:, 1], rel=1e-6)


def test_geotiff_says_missing_cells_feet_and_degrees(tmp_path):
    data = HEIGHTS[::-1].astype(np.float32)
    data[0, 0] = -3.4028234663852886e38
    geotiff(tmp_path / "a.tif", data, nodata="-3.40282346638529e+38")
    assert read_surface(tmp_path / "a.tif", box=BOX).missing.tolist() == [[-5.0, 45.0]]

    geotiff(tmp_path / "b.tif", keys=[(3076, 9003), (4099, 9001)])
    found = read_surface(tmp_path / "b.tif")
    assert found.cell[0] == pytest.approx(10.0 * 1200.0 / 3937.0)
    assert found.values[:, 2].max() == pytest.approx(HEIGHTS.max())

    geotiff(tmp_path / "c.tif", keys=[(3076, 9003)])
    with pytest.raises(InputError, match="unit of its heights is not said"):
        read_surface(tmp_path / "c.tif")

    geotiff(tmp_path / "d.tif", keys=[(1024, 2)])
    with pytest.raises(InputError, match="degrees"):
        read_surface(tmp_path / "d.tif")


def test_landxml_in_feet_is_converted_and_one_of_several_surfaces_is_asked_for(tmp_path):
    landxml(tmp_path / "a.xml", '<Imperial linearUnit="USSurveyFoot"/>', 1200.0 / 3937.0)
    assert read_surface(tmp_path / "a.xml", box=BOX).values[:, :, 0].max() == pytest.approx(55.0)

    text = (tmp_path / "a.xml").read_text()
    start, end = text.index("<Surface name"), text.index("</Surfaces>")
    (tmp_path / "b.xml").write_text(
        text[:end] + text[start:end].replace('"g"', '"design"') + text[end:]
    )
    with pytest.raises(InputError, match="surfaces g, design with faces; name that"):
        read_surface(tmp_path / "b.xml", box=BOX)
    assert len(read_surface(tmp_path / "b.xml", box=BOX, layers=["design"]).values)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.tif", b"II*\0\x08\0\0\0", "no GeoTIFF that can be read"),
        ("a.xml", b"<!DOCTYPE a []><LandXML/>", "document types"),
        ("a.xml", b"<LandXML><b></LandXML>", "broken XML"),
        ("a.xml", b"<LandXML></LandXML>", "holds the surfaces none"),
        ("a.stl", b"solid\n", "holds no triangles"),
        ("a.stl", b"vertex 1 2 3\n", "broken STL"),
        ("a.dxf", b"PK\x03\x04", "is a zip archive"),
        ("a.dxf", b"0\nSECTION\n2\nENTITIES\n0\nLINE\n8\n0\n10\n0\n0\nENDSEC\n0\nEOF\n", "1 LINE"),
        ("a.grd", b"\x04\0\0\0\1\1", "is no text"),
        ("a.bin", b"what", "needs titles such as x .m., y .m., z .m."),
    ],
)
def test_a_file_without_a_surface_is_refused_with_its_reason(name, content, message, tmp_path):
    (tmp_path / name).write_bytes(content)

    with pytest.raises(ReadError, match=message):
        read_surface(tmp_path / name)


@pytest.mark.parametrize("written", ["55,0", "5S.0", "1O1"])
def test_a_number_that_the_library_would_guess_is_refused(tmp_path, written):
    dxf_faces(tmp_path / "a.dxf")
    text = (tmp_path / "a.dxf").read_text()
    (tmp_path / "b.dxf").write_text(text.replace("\n55.0\n", f"\n{written}\n", 1))

    with pytest.raises(ReadError, match=f"near line .*: expected a number, got '{written}'"):
        read_surface(tmp_path / "b.dxf", box=BOX)


@pytest.mark.parametrize("seed", range(24))
def test_a_damaged_file_is_read_or_refused(seed, tmp_path):
    write, suffix = [(esri, "asc"), (surfer, "grd"), (geotiff, "tif"), (landxml, "xml"),
                     (binary_stl, "stl"), (dxf_faces, "dxf")][seed % 6]  # fmt: skip
    path, random = tmp_path / f"a.{suffix}", np.random.default_rng(seed)
    write(path)
    content = bytearray(path.read_bytes())
    for position in random.integers(len(content), size=1 + seed // 2):
        content[position] = random.integers(256)
    path.write_bytes(content[: random.integers(1, len(content) + 1)] if seed % 2 else content)

    found, reason = outcome(path, BOX)

    assert "\n" not in reason
    assert found is None or np.isfinite(found).all()


# benches of a drawing


def pit(path, unit=6, factor=1.0, turned=()):
    drawing = ezdxf.new()
    drawing.header["$INSUNITS"] = unit
    lines = {"CREST": [(20.0, 40.0), (30.0, 32.0)], "TOE": [(23.0, 33.0), (33.0, 25.0)]}
    for name, levels in lines.items():
        drawing.layers.add(name)
        for x, z in levels:
            points = np.array([(x, 0, z), (x + 2, 20, z), (x, 40, z)]) / factor
            points = points[::-1] if name in turned else points
            drawing.modelspace().add_polyline3d(points[:2], dxfattribs={"layer": name})
            drawing.modelspace().add_polyline3d(points[1:], dxfattribs={"layer": name})
    drawing.saveas(path)


def benches(folder, **keys):
    given = {"crest_file": "pit.dxf", "crest_layer": "CREST", "toe_file": "pit.dxf",
             "toe_layer": "TOE"}  # fmt: skip
    config = MeshConfig(
        size_m=[50, 40, 60], edge_m=5, layers=[{"material": "a"}], benches=[{**given, **keys}]
    )
    return benches_of(config, folder)


@pytest.mark.parametrize("turned", [(), ("CREST",), ("TOE",), ("CREST", "TOE")])
@pytest.mark.parametrize(("unit", "factor"), [(6, 1.0), (1, 1.0), (2, 0.3048)])
def test_crests_and_toes_of_a_drawing_are_benches(unit, factor, turned, tmp_path):
    pit(tmp_path / "pit.dxf", unit, factor, turned)

    upper, lower = benches(tmp_path)

    assert upper.crest == pytest.approx(np.array([(20, 0, 40), (22, 20, 40), (20, 40, 40)]))
    assert lower.toe == pytest.approx(np.array([(33, 0, 25), (35, 20, 25), (33, 40, 25)]))


def test_layers_of_lines_are_chosen_by_the_user(tmp_path):
    pit(tmp_path / "pit.dxf")

    with pytest.raises(InputError, match="lines lie on the layers CREST, TOE; name one"):
        read_lines(tmp_path / "pit.dxf")
    with pytest.raises(ReadError, match="the layer 'BERM' holds no lines; layers with lines are"):
        read_lines(tmp_path / "pit.dxf", "BERM")
    with pytest.raises(ReadError, match="holds no lines"):
        benches(tmp_path, toe_layer="0")


def test_a_survey_of_a_project_is_compared_with_its_box(tmp_path):
    write_drawing(tmp_path / "a.dxf", 50.0 / 0.3048, 2, 45.0 / 0.3048)
    config = MeshConfig(
        size_m=[50, 50, 60], edge_m=5, layers=[{"material": "a"}], surface_file="a.dxf"
    )

    assert survey_of(config, tmp_path).values[:, :, 2].max() == pytest.approx(45.0)
