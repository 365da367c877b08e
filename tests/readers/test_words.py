"""A word of a file that changes places or amounts is obeyed or refused, never passed over.

Each reader lists such words; each of them has a file here, which must give another answer than the
same file without it, or a refusal.
"""

import re
import struct
import warnings
from pathlib import Path

import ezdxf
import h5py
import meshio
import numpy as np
import obspy
import pytest
import recorder_files as files
import tifffile
from obspy.io.sac import SACTrace

from pyblast.errors import InputError, PyblastWarning, ReadError
from pyblast.mesh import importer
from pyblast.mesh.builder import structured_box
from pyblast.mesh.importer import read_mesh
from pyblast.model.fractures import FAB_WORDS, read_fractures
from pyblast.readers import geometry
from pyblast.readers.geometry import read_faces, read_lines, read_surface
from pyblast.recordings import segy, seismic
from pyblast.recordings.recording import read_gather, read_recording, remove_response

REPORTED = Path(__file__).parents[1] / "reported"
HEIGHTS = 40.0 + np.arange(12.0).reshape(3, 4)


def answer(read, *args, **options):
    """Return what a reader gives as bytes, None where it refuses in one sentence."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PyblastWarning)
        try:
            return read(*args, **options)
        except (InputError, ReadError):
            return None


def assert_obeyed_or_refused(read, plain, changed):
    """Hold that a file is read, and that the same with a word gives something else or nothing."""
    before, after = answer(read, plain), answer(read, changed)

    assert before is not None
    assert after is None or after != before


# surfaces


def tif(path, data=HEIGHTS, scale=(10.0, 10.0, 0.0), tie=(0, 0, 0, 0, 30, 0), keys=(), meta="",
        nodata="", **options):  # fmt: skip
    keys = {1024: 1, 1025: 2} | dict(keys)
    geo = [1, 1, 0, len(keys), *(v for key, value in keys.items() for v in (key, 0, 1, value))]
    tags = [
        (33550, "d", 3, scale, True),
        (33922, "d", 6, tie, True),
        (34735, "H", len(geo), geo, True),
    ]
    tags += [(42112, "s", len(meta) + 1, meta, True)] if meta else []
    tags += [(42113, "s", len(nodata) + 1, nodata, True)] if nodata else []
    tags += options.pop("tags", [])
    options = {"photometric": "minisblack", "metadata": None} | options
    tifffile.imwrite(path, data, extratags=tags, **options)
    return path


def item(role, value):
    name = f'<Item name="{role.upper()}" sample="0" role="{role}">{value}</Item>'
    return f"<GDALMetadata>{name}</GDALMetadata>"


def pages(path):
    tif(path)
    tifffile.imwrite(path, HEIGHTS + 5.0, append=True, photometric="minisblack", metadata=None)
    return path


def beside(write, name, text):
    def written(path):
        write(path)
        (path.with_name(path.name + name) if "aux" in name else path.with_suffix(name)).write_text(
            text
        )
        return path

    return written


PALETTE = {"photometric": "palette", "colormap": np.zeros((3, 256), np.uint16)}
GEOTIFF = {
    "scale": lambda p: tif(p, meta=item("scale", 0.5)),
    "offset": lambda p: tif(p, meta=item("offset", 12)),
    "unittype": lambda p: tif(p, meta=item("unittype", "US survey foot")),
    "nodata": lambda p: tif(p, nodata="41"),
    "Orientation": lambda p: tif(p, tags=[(274, "H", 1, 4, True)]),
    "PhotometricInterpretation": lambda p: tif(p, HEIGHTS.astype(np.uint8), **PALETTE),
    "pages": pages, "RasterType": lambda p: tif(p, keys={1025: 1}),
    "ModelType": lambda p: tif(p, keys={1024: 3}),
    "LinearUnits": lambda p: tif(p, keys={3076: 9002}),
    "VerticalUnits": lambda p: tif(p, keys={4099: 9002}),
    "VerticalSystem": lambda p: tif(p, keys={4096: 6360}),
    "scale_z": lambda p: tif(p, scale=(10.0, 10.0, 0.1)),
    "origin_z": lambda p: tif(p, tie=(0, 0, 0, 0, 30, 7)),
    ".aux.xml": beside(tif, ".aux.xml", "<PAMDataset><Offset>5</Offset></PAMDataset>"),
}  # fmt: skip


def esri(path, **changes):
    head = {"ncols": 4, "nrows": 3, "xllcenter": 0, "yllcenter": 0, "cellsize": 10} | changes
    if "dx" in head:
        head.pop("cellsize")
    rows = "\n".join(" ".join(map(str, row)) for row in HEIGHTS)
    path.write_text("".join(f"{k} {v}\n" for k, v in head.items() if v is not None) + rows)
    return path


PLANE = 'PROJCS["a",GEOGCS["b",UNIT["Degree",0.0174532925199433]],UNIT["{}",{}]]'
FOOT = PLANE.format("Foot_US", 0.3048006096012192)
UP = ',VERTCS["c",PARAMETER["Direction",{}],UNIT["{}",{}]]'
GRID = {
    "NODATA_value": lambda p: esri(p, NODATA_value=41.0),
    "xllcorner": lambda p: esri(p, xllcenter=None, yllcenter=None, xllcorner=0, yllcorner=0),
    "dx": lambda p: esri(p, dx=10, dy=20), "UNIT": beside(esri, ".prj", FOOT),
    "VERTCS": beside(esri, ".prj", PLANE.format("Meter", 1.0) + UP.format(1.0, "Foot", 0.3048)),
    "Direction": beside(esri, ".prj", PLANE.format("Meter", 1.0) + UP.format(-1.0, "Meter", 1.0)),
    "units": beside(esri, ".prj", "Projection UTM\nUnits FEET\n"),
    "zunits": beside(esri, ".prj", "Projection UTM\nUnits METERS\nZunits FEET\n"),
    "xshift": beside(esri, ".prj", "Projection UTM\nUnits METERS\nXshift 500\n"),
    ".aux.xml": beside(esri, ".aux.xml", "<PAMDataset><Scale>2</Scale></PAMDataset>"),
}  # fmt: skip


def surfer(path, first=40.0, east=30):
    rows = HEIGHTS.copy()
    rows[0, 0] = first
    body = "\n".join(" ".join(map(str, row)) for row in rows)
    path.write_text(f"DSAA\n4 3\n0 {east}\n0 20\n40 51\n{body}\n")
    return path


def landxml(path, units="", face="", system=""):
    points = "".join(f'<P id="{n}">{y} {x} {40 + n}</P>' for n, (x, y) in
                     enumerate([(0, 0), (30, 0), (30, 20), (0, 20)]))  # fmt: skip
    faces = f"<Faces><F>0 1 2</F><F{face}>0 2 3</F></Faces>"
    surface = f'<Surface name="a"><Definition><Pnts>{points}</Pnts>{faces}</Definition></Surface>'
    path.write_text(f"<LandXML>{units}{system}<Surfaces>{surface}</Surfaces></LandXML>")
    return path


LANDXML = {
    "linearUnit": lambda p: landxml(p, '<Units><Imperial linearUnit="foot"/></Units>'),
    "elevationUnit": lambda p: landxml(
        p, '<Units><Metric linearUnit="meter" elevationUnit="feet"/></Units>'),
    "rotationAngle": lambda p: landxml(p, system='<CoordinateSystem rotationAngle="5"/>'),
    "i": lambda p: landxml(p, face=' i="1"'),
}  # fmt: skip


def stl(path, name="ground"):
    path.write_text(f"solid {name}\nfacet normal 0 0 1\nouter loop\nvertex 0 0 40\nvertex 30 0 41\n"
                    "vertex 0 20 42\nendloop\nendfacet\nendsolid\n")  # fmt: skip
    return path


def dxf(path, word=""):
    made = ezdxf.new()
    face = [(0, 0, 40), (30, 0, 41), (30, 20, 42), (0, 20, 43)]
    block = made.blocks.new("B")
    block.add_3dface(face)
    if word == "$INSUNITS":
        made.header["$INSUNITS"] = 2
    elif word:
        made.layers.add("off").off()
    away = {"layer": "off"} if word == "layer" else {"invisible": 1} if word == "invisible" else {}
    made.modelspace().add_3dface(face)
    made.modelspace().add_3dface([(x, y + 20, z) for x, y, z in face], away)
    made.modelspace().add_line((0, 0, 40), (30, 0, 41))
    made.modelspace().add_line((30, 0, 41), (30, 20, 41), away)
    made.modelspace().add_blockref("B", (0, 40, 5 if word == "INSERT" else 0))
    made.saveas(path)
    return path


SURFACES = {
    "GeoTIFF": (tif, GEOTIFF), "ESRI ASCII grid": (esri, GRID),
    "Surfer grid": (surfer, {"blank": lambda p: surfer(p, 1.70141e38),
                             "limits": lambda p: surfer(p, east=60)}),
    "LandXML": (landxml, LANDXML), "STL": (stl, {"units": lambda p: stl(p, "a units=mm")}),
    "DXF": (dxf, {word: lambda p, word=word: dxf(p, word)
                  for word in ("$INSUNITS", "INSERT", "layer", "invisible")}),
}  # fmt: skip


def surface_of(path):
    return read_surface(path).values.tobytes()


@pytest.mark.parametrize(
    ("kind", "word"),
    [(kind, word) for kind, words in geometry.WORDS.items() for word in words.split()],
)
def test_words_of_surfaces(tmp_path, kind, word):
    plain, words = SURFACES[kind]

    assert set(words) == set(geometry.WORDS[kind].split())
    assert_obeyed_or_refused(surface_of, plain(tmp_path / "a.dat"), words[word](tmp_path / "b.dat"))


@pytest.mark.parametrize("word", ["$INSUNITS", "layer", "invisible"])
def test_words_of_drawings_hold_for_lines_and_faces(tmp_path, word):
    plain, changed = dxf(tmp_path / "a.dxf"), dxf(tmp_path / "b.dxf", word)

    for read in (read_lines, read_faces):
        assert_obeyed_or_refused(lambda path, read=read: str(read(path)), plain, changed)


def test_132_heights_are_the_stored_values_times_scale_plus_offset(tmp_path):
    found = read_surface(REPORTED / "132-geotiff-scale-and-offset" / "offset_only.tif").values
    assert (found[:, 2].min(), found[:, 2].max()) == pytest.approx((48.5, 61.5))

    metadata = item("scale", 0.5).replace("</GDALMetadata>", item("offset", 3)[14:])
    stored = tif(tmp_path / "a.tif", HEIGHTS.astype(np.int16), meta=metadata, nodata="41")
    values = read_surface(stored)

    assert len(values.missing) == 1
    assert sorted(values.values[:, 2]) == pytest.approx(sorted(3.0 + 0.5 * np.delete(HEIGHTS, 1)))


@pytest.mark.parametrize(
    ("text", "factor"),
    [("Foot", 0.3048), ("US survey foot", 1200 / 3937), ("metre", 1.0), ("ft", 0.3048)],
)
def test_the_unit_of_heights_in_a_geotiff_is_obeyed(tmp_path, text, factor):
    values = read_surface(tif(tmp_path / "a.tif", meta=item("unittype", text))).values

    assert values[:, 2].max() == pytest.approx(factor * HEIGHTS.max())


# fractures


FAB = """BEGIN FORMAT
 Format = Ascii
 XAxis = East
 Length_Unit = Meter
 Scale = 100.0
 No_Fractures = 1
 No_TessFractures = 0
END FORMAT
BEGIN FRACTURE
 1 4 1
 1 10 10 5
 2 10 30 5
 3 10 30 25
 4 10 10 25
 0 1 0 0
END FRACTURE
"""
FAB_CHANGES = {
    "format": ("Ascii", "Binary"), "xaxis": ("East", "North"),
    "no_tessfractures": ("No_TessFractures = 0", "No_TessFractures = 2"),
    "length_unit": ("Meter", "Feet"), "no_fractures": ("No_Fractures = 1", "No_Fractures = 2"),
}  # fmt: skip


@pytest.mark.parametrize("word", [*FAB_WORDS, "length_unit", "no_fractures"])
def test_words_of_fracman(tmp_path, word):
    plain = files.write(tmp_path, FAB, "a.fab")
    changed = files.write(tmp_path, FAB.replace(*FAB_CHANGES[word]), "b.fab")

    assert changed.read_text() != FAB
    assert_obeyed_or_refused(lambda p: read_fractures(p, "F")[0].polygon.tobytes(), plain, changed)


# meshes


BOX = structured_box((1, 1, 1), (1.0, 1.0, 1.0))
NODES = [f"{n}, {x}, {y}, {z}" for n, (x, y, z) in enumerate(BOX.points, 1)]
CELLS = [f"{n}, {', '.join(str(1 + k) for k in zone)}" for n, zone in enumerate(BOX.zones, 1)]
FLAT = ["*HEADING", "*NODE", *NODES, "*ELEMENT, TYPE=C3D4, ELSET=ROCK", *CELLS]
PART = ["*PART, NAME=P", *FLAT[1:], "*END PART"]
PLACED = [*PART, "*ASSEMBLY, NAME=A", "*INSTANCE, NAME=I, PART=P", "*END INSTANCE", "*END ASSEMBLY"]
ABAQUS = {
    "INSTANCE": [*PLACED[:-2], "100., 0., 50.", *PLACED[-2:]],
    "PART": ["*PART, NAME=Q", "*NODE", "1, 5, 5, 5", "*END PART", *PLACED],
    "INPUT": [*FLAT[:1], "*NODE, INPUT=nodes.txt", *FLAT[1:]],
    "NODE, SYSTEM": [line.replace("*NODE", "*NODE, SYSTEM=C") for line in FLAT],
    "SYSTEM": [*FLAT[:1], "*SYSTEM", "10., 0., 0., 11., 0., 0.", *FLAT[1:]],
}


@pytest.mark.parametrize("word", importer.WORDS["abaqus"])
def test_words_of_abaqus(tmp_path, word):
    changed = ABAQUS.get(word) or [*FLAT, f"*{word}, X=Y", "1, 2, 3"]
    path = files.write(tmp_path, "\n".join(changed), "b.inp")

    with pytest.raises(ReadError, match=rf"\*{word.split(',')[0] if word != 'INPUT' else 'NODE'}"):
        read_mesh(path)


@pytest.mark.parametrize("lines", [FLAT, PLACED, [*FLAT[:6], "*NODE, NSET=MORE", *FLAT[6:]]])
def test_nodes_in_blocks_and_a_part_that_stays_are_read(tmp_path, lines):
    mesh = read_mesh(
        files.write(tmp_path, "\n".join(lines).lower().replace("rock", "ROCK"), "a.inp")
    )

    assert mesh.groups == ("ROCK",)
    assert np.array_equal(mesh.points, BOX.points)


def test_134_reported_files():
    folder = REPORTED / "134-abaqus-instances"

    with pytest.raises(ReadError, match=r"\*INSTANCE moves its part by 100., 0., 50.; write nodes"):
        read_mesh(folder / "instance_moved.inp")
    assert np.ptp(read_mesh(folder / "two_node_blocks.inp").points, axis=0).tolist() == [40, 20, 20]


@pytest.mark.parametrize("name", ["vtu", "xdmf"])
def test_words_of_xml_meshes(tmp_path, name):
    path = tmp_path / f"a.{name}"
    meshio.Mesh(BOX.points, [("tetra", BOX.zones)]).write(path)
    text = path.read_text(encoding="latin-1")

    assert len(read_mesh(path).zones) == len(BOX.zones)
    for word in importer.WORDS[name]:
        added = (
            re.search(r"<Piece.*</Piece>", text, re.S)[0]
            if word == "</Piece>"
            else f"<!--{word}-->"
        )
        at = text.index("<Piece") if word == "</Piece>" else text.index(">", text.index("<" + {
            "vtu": "VTKFile", "xdmf": "Xdmf"}[name])) + 1  # fmt: skip
        path.write_text(text[:at] + added + text[at:], encoding="latin-1")
        with pytest.raises(ReadError, match="not accepted"):
            read_mesh(path)


@pytest.mark.parametrize(
    ("attribute", "value", "read"),
    [("REP", 1, False), ("TYP", 1, False), ("NOM", b"Z       Y       X", False),
     ("UNI", b"m m m", True), ("UNI", b"mm mm mm", False), ("NOM", b"x y z", True)],
)  # fmt: skip
def test_words_of_med(tmp_path, attribute, value, read):
    path = tmp_path / "a.med"
    meshio.Mesh(BOX.points, [("tetra", BOX.zones)]).write(path)
    with h5py.File(path, "a") as file:
        (mesh,) = file["ENS_MAA"].values()
        mesh.attrs[attribute] = value

    if read:
        assert np.array_equal(read_mesh(path).points, BOX.points)
        return
    with pytest.raises(ReadError, match="write an unstructured mesh of x, y, z in metres"):
        read_mesh(path)


# records


WAVE = 1e3 * np.sin(0.2 * np.arange(400)) * np.hanning(400)
SAC = {
    "SCALE": {"scale": 6e8}, "CMPAZ": {"cmpaz": 30.0, "cmpinc": 90.0},
    "CMPINC": {"cmpaz": 90.0, "cmpinc": 40.0}, "IDEP": {"idep": 7}, "DELTA": {"delta": 0.004},
    "LEVEN": {"leven": 0}, "IFTYPE": {"iftype": 2},
}  # fmt: skip


def motion_of(path, **options):
    motion = read_recording(path, **options)[0].seismogram
    return np.nan_to_num(motion.velocity).tobytes(), motion.dt


def sac(path, **header):
    trace = obspy.Trace(WAVE.astype(np.float32), {"delta": 0.002, "channel": "HHE", "station": "R"})
    made = SACTrace.from_obspy_trace(trace)
    for key, value in header.items():
        if key not in ("leven", "iftype", "idep"):
            setattr(made, key, value)
    made.write(str(path))
    content = bytearray(path.read_bytes())
    for key, at in (("iftype", 85), ("idep", 86), ("leven", 105)):
        if key in header:
            content[4 * at : 4 * at + 4] = struct.pack("<i", header[key])
    path.write_bytes(bytes(content))
    return path


@pytest.mark.parametrize("word", seismic.WORDS["SAC"].split())
def test_words_of_sac(tmp_path, word):
    assert_obeyed_or_refused(motion_of, sac(tmp_path / "a"), sac(tmp_path / "b", **SAC[word]))


@pytest.mark.parametrize(("azimuth", "incidence"), [(90.0, 90.0), (93.0, 88.0), (450.0, 90.0)])
def test_a_channel_that_points_as_it_is_named_is_read(tmp_path, azimuth, incidence):
    assert answer(motion_of, sac(tmp_path / "a", cmpaz=azimuth, cmpinc=incidence)) is not None


def test_calib_of_gse2_is_never_passed_over(tmp_path):
    wave = (1000 * np.sin(0.1 * np.arange(400))).astype("i4")
    paths = [
        files.write_trace(tmp_path / f"{c}", wave, "GSE2", channel="HHZ", calib=c)
        for c in (1.0, 0.5)
    ]

    assert answer(motion_of, paths[0], unit="um_per_s") is not None
    with pytest.raises(InputError, match=r"integer counts|scales samples by 0.5"):
        read_recording(paths[1])


def test_the_rate_of_miniseed_is_obeyed(tmp_path):
    paths = [
        files.write_trace(tmp_path / f"{n}", WAVE, "MSEED", delta=step)
        for n, step in enumerate((0.002, 0.004))
    ]

    assert_obeyed_or_refused(motion_of, *paths)


def gather_of(path):
    gather = read_gather(path)
    return gather.data.tobytes(), gather.dt, gather.start, gather.receiver_positions.tobytes()


DATA = np.random.default_rng(3).integers(-900, 900, (3, 60)).astype(float)
SEG2 = {
    "DESCALING_FACTOR": lambda c: c.replace(b"DESCALING_FACTOR 2.0", b"DESCALING_FACTOR 4.0"),
    "SKEW": lambda c: c.replace(b"SKEW 0.0", b"SKEW 0.5", 1),
    "DELAY": lambda c: c.replace(b"DELAY -0.010", b"DELAY -0.020"),
    "UNITS": lambda c: c.replace(b"UNITS METERS", b"UNITS   FEET"),
}  # fmt: skip
TRACE_WORDS = {  # of SEG-Y, by byte: value
    "scalar": (71, "h", -100), "scalar_z": (69, "h", 10), "scalar_time": (215, "h", -10),
    "units": (89, "h", 2), "delay": (109, "h", 50), "weight": (169, "h", 3),
    "step": (117, "H", 4000),
}  # fmt: skip


def segy_bytes(word=""):
    binary = bytearray(400)
    struct.pack_into(">H", binary, 16, 2000 if word != "step" else 0)
    struct.pack_into(">H", binary, 20, 60)
    struct.pack_into(">h", binary, 24, 5)
    struct.pack_into(">h", binary, 54, 2 if word == "measure" else 1)
    if word == "extended":
        struct.pack_into(">B", binary, 300, 2)
        struct.pack_into(">I", binary, 68, 120)
    content = b"C 1".ljust(3200) + bytes(binary)
    for n, row in enumerate(DATA):
        head = bytearray(240)
        for at, form, value in ((41, "i", 20), (45, "i", 30), (81, "i", 100 * (n + 1)),
                                (115, "H", 60), (117, "H", 2000), (109, "h", 5)):  # fmt: skip
            struct.pack_into(f">{form}", head, at - 1, value)
        if word in TRACE_WORDS and (word != "weight" or n == 1):
            at, form, value = TRACE_WORDS[word]
            struct.pack_into(f">{form}", head, at - 1, value)
        content += bytes(head) + row.astype(">f4").tobytes()
    return content


@pytest.mark.parametrize("word", segy.WORDS.split())
def test_words_of_segy(tmp_path, word):
    plain = files.write(tmp_path, segy_bytes(), "a.sgy")
    changed = files.write(tmp_path, segy_bytes(word), "b.sgy")

    assert_obeyed_or_refused(gather_of, plain, changed)


@pytest.mark.parametrize("word", seismic.WORDS["SEG2"].split())
def test_words_of_seg2(tmp_path, word):
    content = files.seg2(DATA, descaling=2.0, more=("SKEW 0.0", "UNITS METERS"))
    plain = files.write(tmp_path, content, "a.sg2")
    changed = files.write(tmp_path, SEG2[word](content), "b.sg2")

    assert changed.read_bytes() != content
    assert_obeyed_or_refused(gather_of, plain, changed)


# responses


STATION = REPORTED / "135-stationxml-two-epochs"
STATION_XML = {
    "epochs": (STATION / "overlap.xml").read_text,
    "stages": lambda: re.sub(r"<Stage .*?</Stage>\s*", "", one_epoch(), flags=re.S),
    "azimuth": lambda: one_epoch().replace('"DEGREES">90.0</Az', '"DEGREES">120.0</Az'),
    "dip": lambda: one_epoch().replace('"DEGREES">-90.0</Dip', '"DEGREES">90.0</Dip'),
    "units": lambda: one_epoch().replace("<Name>M/S</Name>", "<Name>M/S**2</Name>"),
}  # fmt: skip


def one_epoch():
    second = r'<Channel code="HH." startDate="2024.*?</Channel>\s*'
    return re.sub(second, "", (STATION / "overlap.xml").read_text(), flags=re.S)


@pytest.mark.parametrize("word", seismic.WORDS["StationXML"].split())
def test_words_of_stationxml(tmp_path, word):
    (record,) = read_recording(STATION / "rec.mseed", unit="counts")
    plain = files.write(tmp_path, one_epoch(), "a.xml")
    changed = files.write(tmp_path, STATION_XML[word](), "b.xml")

    assert changed.read_text() != plain.read_text()
    assert_obeyed_or_refused(
        lambda path: remove_response(record, path).seismogram.velocity.tobytes(), plain, changed
    )


def test_135_two_epochs_and_a_total_sensitivity_alone_are_named():
    (record,) = read_recording(STATION / "rec.mseed", unit="counts")

    with pytest.raises(
        InputError, match=r"several epochs \(2020.* with 2800000, 2024.* 11200000\)"
    ):
        remove_response(record, STATION / "overlap.xml")
    with pytest.raises(InputError, match=r"has no stages; give sensitivity = 11200000 in place"):
        remove_response(record, STATION / "sens_only.xml")
