"""A key that says what a file means is used or refused, beside every kind of file.

The kinds are those of the table, so that a new one needs a writer here.
"""

import warnings
from itertools import product
from pathlib import Path

import ezdxf
import numpy as np
import pytest
import recorder_files as files
import tifffile

from pyblast.config.ground import BenchConfig, FractureConfig, MeshConfig
from pyblast.errors import InputError, PyblastWarning, ReadError
from pyblast.model.fractures import polygon_area, read_fractures
from pyblast.readers.geometry import LENGTHS, read_lines, read_surface
from pyblast.readers.kinds import KINDS
from pyblast.recordings.recording import FORMATS, read_recording

BOX = np.array([(0.0, 50.0), (0.0, 40.0), (0.0, 60.0)])
X, Y = np.arange(-5.0, 60.0, 10.0), np.arange(-5.0, 50.0, 10.0)
PLACES = np.array([(x, y, 45.0 + 0.1 * x - 0.05 * y) for y in Y for x in X])
LINE = np.array([[5.0, 5.0, 30.0], [25.0, 15.0, 30.0], [45.0, 30.0, 32.0]])
FACE = np.array([[10.0, 10.0, 5.0], [10.0, 30.0, 5.0], [10.0, 30.0, 25.0], [10.0, 10.0, 25.0]])
CELLS = np.arange(len(PLACES)).reshape(len(Y), len(X))
A, B, C, D = (CELLS[j : len(Y) - 1 + j, i : len(X) - 1 + i].ravel() for j, i in
              ((0, 0), (0, 1), (1, 1), (1, 0)))  # fmt: skip
FACES = np.concatenate([np.column_stack([A, B, C]), np.column_stack([A, C, D])])


def text(rows, mark=","):
    return "\n".join(mark.join(f"{x:.9g}" for x in row) for row in rows)


def heights(factor):
    return factor * PLACES[:, 2].reshape(len(Y), len(X))


def drawing(factor, unit):
    made = ezdxf.new()
    made.header["$INSUNITS"] = unit
    for face in PLACES[FACES]:
        made.modelspace().add_3dface(factor * face, {"layer": "ground"})
    return made


def drawn(path, factor, unit=0):
    drawing(factor, unit).saveas(path)


def geotiff(path, factor):
    tags = [(33550, "d", 3, (10 * factor, 10 * factor, 0.0), True),
            (33922, "d", 6, (0, 0, 0, -5 * factor, 45 * factor, 0), True),
            (34735, "H", 8, (1, 1, 0, 1, 1025, 0, 1, 2), True)]  # fmt: skip
    tifffile.imwrite(path, heights(factor)[::-1], extratags=tags, photometric="minisblack")


def landxml(path, factor):
    rows = enumerate(factor * PLACES)
    points = "".join(f'<P id="{n}">{y} {x} {z}</P>' for n, (x, y, z) in rows)
    faces = "".join(f"<F>{a} {b} {c}</F>" for a, b, c in FACES)
    parts = f"<Definition><Pnts>{points}</Pnts><Faces>{faces}</Faces></Definition>"
    surface = f'<Surfaces><Surface name="ground">{parts}</Surface></Surfaces>'
    path.write_text(f"<LandXML>{surface}</LandXML>")


def stl(path, factor):
    rows = "".join(
        "facet normal 0 0 1\nouter loop\n"
        + "".join(f"vertex {x} {y} {z}\n" for x, y, z in factor * face) + "endloop\nendfacet\n"
        for face in PLACES[FACES]
    )  # fmt: skip
    path.write_text(f"solid ground\n{rows}endsolid\n")


def workbook(path, rows):
    import openpyxl

    book = openpyxl.Workbook()
    for row in rows:
        book.active.append(list(row))
    book.save(path)


def fab(path, factor):
    rows = text(np.column_stack([np.arange(1, 5), factor * FACE]), " ")
    path.write_text(f"BEGIN FRACTURE\n1 4 1\n{rows}\n0 1 0 0\nEND FRACTURE\n")


def fracture_table(factor):
    return [("fracture", "x", "y", "z"), *(("a", *map(float, row)) for row in factor * FACE)]


def faces(path, factor):
    made = ezdxf.new()
    made.modelspace().add_3dface(factor * FACE, {"layer": "ground"})
    made.saveas(path)


def lines(path, factor):
    made = ezdxf.new()
    made.modelspace().add_polyline3d(factor * LINE, dxfattribs={"layer": "ground"})
    made.saveas(path)


def table(path, rows):
    path.write_text("\n".join(",".join(map(str, row)) for row in rows))


TITLED = [("x", "y", "z")]
WRITERS = {  # by door and kind: writes the same ground with its numbers times a factor
    "surface": {
        "ESRI ASCII grid": lambda path, f: path.write_text(
            f"ncols {len(X)}\nnrows {len(Y)}\nxllcenter {-5 * f}\nyllcenter {-5 * f}\n"
            f"cellsize {10 * f}\n" + text(heights(f)[::-1], " ")
        ),
        "Surfer grid": lambda path, f: path.write_text(
            f"DSAA\n{len(X)} {len(Y)}\n{-5 * f} {55 * f}\n{-5 * f} {45 * f}\n0 99\n"
            + text(heights(f), " ")
        ),
        "GeoTIFF": geotiff, "DXF": drawn, "LandXML": landxml, "STL": stl,
        "text": lambda path, f: table(path, TITLED + (f * PLACES).tolist()),
        "an Excel workbook": lambda path, f: workbook(path, TITLED + (f * PLACES).tolist()),
    },
    "lines": {
        "DXF": lines, "text": lambda path, f: table(path, TITLED + (f * LINE).tolist()),
        "an Excel workbook": lambda path, f: workbook(path, TITLED + (f * LINE).tolist()),
    },
    "fractures": {
        "DXF": faces, "FracMan text": fab,
        "text": lambda path, f: table(path, fracture_table(f)),
        "an Excel workbook": lambda path, f: workbook(path, fracture_table(f)),
    },
}  # fmt: skip
READERS = {
    "surface": lambda path, layers=(), **keys: read_surface(
        path, layers=layers, **keys).values.reshape(-1, 3),
    "lines": lambda path, layers=(None,), **keys: read_lines(path, layers[0], **keys)[0],
    "fractures": lambda path, **keys: read_fractures(path, "F", **keys)[0].polygon,
}  # fmt: skip
CASES = [(door, kind) for door, kinds in WRITERS.items() for kind in kinds]


def test_every_kind_of_the_table_has_a_writer_here():
    for door, kinds in WRITERS.items():
        assert set(kinds) == {kind.name for kind in KINDS if door in kind.doors}


@pytest.mark.parametrize(("door", "kind"), CASES)
@pytest.mark.parametrize("unit", LENGTHS)
def test_a_unit_is_used_or_refused_beside_every_kind(tmp_path, door, kind, unit):
    WRITERS[door][kind](tmp_path / "a.dat", 1.0)
    WRITERS[door][kind](tmp_path / "b.dat", 1.0 / LENGTHS[unit])

    plain = READERS[door](tmp_path / "a.dat", box=BOX)
    if unit == "mm" and ("grid" in kind or kind == "GeoTIFF"):
        with pytest.raises(ReadError, match="is no height of any ground"):
            READERS[door](tmp_path / "b.dat", box=BOX, unit=unit)
        return
    read = READERS[door](tmp_path / "b.dat", box=BOX, unit=unit)

    assert read == pytest.approx(plain, rel=1e-6, abs=1e-5)


@pytest.mark.parametrize(("door", "kind"), CASES)
@pytest.mark.parametrize("unit", ["ft", "mm", "km"])
def test_a_unit_is_held_against_the_box_beside_every_kind(tmp_path, door, kind, unit):
    WRITERS[door][kind](tmp_path / "a.dat", 1.0 if unit == "km" else 1.0 / LENGTHS[unit])
    given = unit if unit == "km" else None

    if unit == "ft" and door != "surface":  # such numbers may be metres
        return
    with pytest.raises((InputError, ReadError), match=r"does not fit the box|m wide|no height of"):
        READERS[door](tmp_path / "a.dat", box=BOX, unit=given)


@pytest.mark.parametrize(("door", "kind"), [case for case in CASES if case[0] != "fractures"])
def test_layers_are_those_of_the_file_or_refused(tmp_path, door, kind):
    WRITERS[door][kind](tmp_path / "a.dat", 1.0)
    plain = READERS[door](tmp_path / "a.dat", box=BOX)

    with pytest.raises((InputError, ReadError), match=r"has no layers|no surface|layer"):
        READERS[door](tmp_path / "a.dat", box=BOX, layers=("other",))
    if kind in ("DXF", "LandXML"):
        assert np.array_equal(READERS[door](tmp_path / "a.dat", box=BOX, layers=("ground",)), plain)


@pytest.mark.parametrize("door", ["surface", "lines", "fractures"])
@pytest.mark.parametrize("title", ["ft", "us_ft", "cm"])
def test_titles_say_a_unit_that_a_key_may_repeat_and_not_deny(tmp_path, door, title):
    WRITERS[door]["text"](tmp_path / "a.csv", 1.0 / LENGTHS[title])
    head, rest = (tmp_path / "a.csv").read_text().split("\n", 1)
    for axis in "xyz":
        head = head.replace(axis, f"{axis}_{title}")
    (tmp_path / "a.csv").write_text(f"{head}\n{rest}")

    read = READERS[door](tmp_path / "a.csv", box=BOX)

    assert np.array_equal(READERS[door](tmp_path / "a.csv", box=BOX, unit=title), read)
    with pytest.raises(InputError, match=rf"its titles say {title}, the project m"):
        READERS[door](tmp_path / "a.csv", box=BOX, unit="m")


@pytest.mark.parametrize("door", ["surface", "lines", "fractures"])
def test_degrees_in_a_table_are_refused(tmp_path, door):
    rows = "".join(f"a,{7.1 + 1e-3 * n},{50.2 + 1e-3 * n**2},30\n" for n in range(4))
    (tmp_path / "a.csv").write_text(f"fracture,x,y,z\n{rows}")

    with pytest.raises(InputError, match="are degrees of longitude and latitude"):
        READERS[door](tmp_path / "a.csv", box=BOX)


REPORTED = Path(__file__).parents[1] / "reported"
BENCH = np.array([(0.0, 100.0), (0.0, 60.0), (0.0, 70.0)])


def test_131_a_surface_in_feet_is_read_in_feet_or_refused():
    path = REPORTED / "131-unit-key-beside-a-table" / "surface_plain.csv"

    assert read_surface(path, box=BENCH, unit="ft").values[:, 2].mean() == pytest.approx(
        55.0, abs=1e-3
    )
    with pytest.raises(InputError, match="it would fit in ft: surface_unit = 'ft'"):
        read_surface(path, box=BENCH)


@pytest.mark.parametrize(
    ("name", "area"), [("feet.fab", 400.0), ("feet_small.fab", 36.0), ("from0.fab", 400.0)]
)
def test_133_words_of_a_fracman_text_are_obeyed(name, area):
    path = REPORTED / "133-fab-units-and-numbers" / name

    (fracture,) = read_fractures(path, "F", box=BENCH)

    assert polygon_area(fracture.polygon) == pytest.approx(area, rel=1e-4)


# keys without their file


ROCK = {"layers": [{"material": "rock"}], "size_m": [1, 1, 1], "edge_m": 1}
ALONE = {
    "surface_unit": (MeshConfig, ROCK | {"surface_unit": "ft"}),
    "surface_layers": (MeshConfig, ROCK | {"surface_layers": ["a"]}),
    "surface_unit beside a mesh": (MeshConfig, {"file": "m.msh", "surface_unit": "ft"}),
    "surface_file beside a mesh": (MeshConfig, {"file": "m.msh", "surface_file": "a.csv"}),
    "file_groups": (MeshConfig, ROCK | {"file_groups": {"1": "rock"}}),
    "file_joints": (MeshConfig, ROCK | {"file_joints": {"1": "J"}}),
    "file_welded": (MeshConfig, ROCK | {"file_welded": ["a"]}),
    "file_unit": (
        FractureConfig,
        {"name": "F", "dip_deg": 1, "dip_direction_deg": 1, "fisher_kappa": 1, "p32": 1,
         "radius_m": 1, "file_unit": "ft"},
    ),
    "file_unit of a bench": (
        BenchConfig, {"crest_m": [[0, 0, 0], [1, 0, 0]], "height_m": 1, "file_unit": "ft"}
    ),
    "crest_layer": (
        BenchConfig, {"crest_m": [[0, 0, 0], [1, 0, 0]], "height_m": 1, "crest_layer": "a"}
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", ALONE)
def test_a_key_without_its_file_is_refused(name):
    section, keys = ALONE[name]

    with pytest.raises(ValueError, match=r"go with|goes with"):
        section(**keys)


# records


KEYS = {
    "unit": ("mm_per_s", "g"), "time_zero": ("2025-01-02T03:04:00",), "sheet": ("A",),
    "orientations": ({"HHZ": (0.0, -1.5), "HHN": (0.1, 0.0), "HHE": (1.6, 0.0)},),
    "bearing": (0.5,), "mapping": (None,),
}  # fmt: skip


def outcome(paths, **keys):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PyblastWarning)
        try:
            motion = read_recording(paths, **keys)[0].seismogram
        except (InputError, ReadError):
            return None
    return np.nan_to_num(motion.velocity).tobytes(), motion.start, motion.components


@pytest.mark.parametrize(("format", "key"), product(files.RECORDS, KEYS))
def test_keys_beside_records_change_them_or_are_refused(tmp_path, format, key):
    paths = tmp_path / "r.dat"
    if format in ("SAC", "GSE2"):
        wave = (1000 * np.sin(0.1 * np.arange(400))).astype("i4" if format == "GSE2" else "f4")
        paths = [files.write_trace(tmp_path / code, wave, format, channel=f"HH{code}", station="R")
                 for code in "ENZ"]  # fmt: skip
    else:
        files.write(tmp_path, files.RECORDS[format], "r.dat")
    beside = {"unit": "um_per_s"} if format == "GSE2" else {}
    plain = outcome(paths, **beside)

    assert plain is not None
    for value in KEYS[key]:
        if key == "mapping":
            value = files.write(tmp_path, 'time_column = 2\nunit = "cm/s"\n', "m.toml")
        read = outcome(paths, **beside | {key: value})
        assert read is None or read != plain


def test_every_format_of_records_has_a_file_here():
    assert {*files.RECORDS, "MAPPED"} == set(FORMATS), "RECORDS of tests/cases/recorder_files.py"


def test_a_unit_serves_columns_without_one(tmp_path):
    path = files.write(tmp_path, files.generic("time_s,east,north,vertical"), "r.csv")

    (recording,) = read_recording(path, unit="mm_per_s")

    assert recording.seismogram.ppv == pytest.approx([7e-6, 7e-6, 0.0])
