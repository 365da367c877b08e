"""Kinds of files: each is known by its bytes, named at the doors that do not read it, and no other.

Every kind of the table has an example here, so that a new one comes with its own.
"""

import io
import zipfile
from pathlib import Path

import numpy as np
import pytest
import recorder_files as files

from pyblast.blasts.hole_tables import read_blast
from pyblast.errors import InputError, PyblastWarning, ReadError
from pyblast.line_records.field_records import read_folder
from pyblast.mesh.importer import read_mesh
from pyblast.model.fractures import read_fractures
from pyblast.readers.cells import wanted_by
from pyblast.readers.geometry import read_lines, read_surface
from pyblast.readers.kinds import BINARY, EXPORTS, KINDS, TEXT, expect, is_text, kind_of
from pyblast.readers.tables import read_table
from pyblast.recordings.recording import read_gather, read_recording
from pyblast.recordings.seismic import read_inventory

REPORTED = Path(__file__).parents[1] / "reported"
RANDOM = np.random.default_rng(5).integers(0, 256, 5000, dtype=np.uint8).tobytes()
MOTION = np.random.default_rng(3).normal(size=(60, 3))
TABLE = "Hole,Easting,Northing,RL,Charge (kg),Delay (ms)\nA1,5,8,21,50,0\nA2,9,8,21,50,25\n"


def archive(*names, stored=b""):
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as packed:
        for name in names:
            packed.writestr(name, stored)
    return buffer.getvalue()


def segy(order=">", code=5):
    content = bytearray(b"C 1 CLIENT".ljust(3200, b" ") + bytes(400) + bytes(240 + 80))
    content[3216:3218] = (500).to_bytes(2, "big" if order == ">" else "little")
    content[3220:3222] = (20).to_bytes(2, "big" if order == ">" else "little")
    content[3224:3226] = code.to_bytes(2, "big" if order == ">" else "little")
    return bytes(content)


def xml(root, rest=""):
    return f'<?xml version="1.0"?>\n<!-- a -->\n<a:{root} xmlns:a="b" {rest}/>'.encode()


HDF5 = b"\x89HDF\r\n\x1a\n"
EXAMPLES = {  # by kind; those known by their suffix alone are made below
    "MSEED": files.miniseed({"R01": MOTION}, reclen=512),
    "miniSEED 3": b"MS\x03\0" + RANDOM,
    "dataless SEED": b"000001A 010009502.3121970",
    "SEG2": files.seg2(MOTION.T),
    "GSE2": b"WID2 2025/01/02 03:04:05.000 R01",
    "SAC": files.sac(),
    "SAC alphanumeric": b"   0.01  -12345.00  -12345.00  -12345.00  -12345.00\n  1 2 3 4 5\n",
    "SEGY": segy(),
    "GSE or IMS": b"BEGIN IMS2.0\nMSG_TYPE DATA\n",
    "PEER AT2": b"PEER NGA STRONG MOTION DATABASE RECORD\nSan Fernando\n",
    "K-NET or KiK-net": b"Origin Time       2011/03/11 14:46:00\nLat.              38.103\n",
    "COSMOS or V1, V2, V3": b"Uncorrected Accelerogram Data Processed: (Format v01.20 with 13)\n",
    "CWB or ITACA": b"EVENT_NAME: NORCIA\nEVENT_ID: EMSC\n",
    "ASCII_of_SEED": b"TIMESERIES XX_R01__HHZ_D, 600 samples, 100 sps\n1\n2\n",
    "RESP": b"#\n#\tComment\nB050F03     Station:     R01\n",
    "SAC poles and zeros": b"* NETWORK XX\nZEROS 3\nPOLES 4\n",
    "SEISAN": b"\0\0\0P         JMI".ljust(90),
    "Nanometrics Y": b"\x1f\0\0\0\0\0\0\0" + RANDOM,
    "Kinemetrics EVT": b"\0\0KMI\0" + RANDOM,
    "REF TEK 130": b"EH\0\x19\x20\x11" + RANDOM,
    "Seismic Handler Q": b"43981 1\n",
    "SEG-D": b"\x12\x34\x80\x58" + RANDOM,
    "TDMS": b"TDSm" + RANDOM,
    "LabVIEW LVM": b"LabVIEW Measurement\t\nWriter_Version\t2\n",
    "UFF58": b"    -1\n    58\nnone\n",
    "WAV": b"RIFF\x10\0\0\0WAVEfmt ",
    "FLAC": b"fLaC" + RANDOM,
    "MP3": b"ID3\x03" + RANDOM,
    "MATLAB data": b"MATLAB 5.0 MAT-file, Platform: GLNXA64".ljust(128),
    "QuakeML": xml("quakeml"),
    "a NumPy array": b"\x93NUMPY\x01\0v\0" + RANDOM,
    "StationXML": xml("FDSNStationXML"),
    "GeoTIFF": b"II*\0\x08\0\0\0",
    "Surfer grid": b"DSAA\n2 2\n0 1\n0 1\n0 1\n1 2\n3 4\n",
    "ESRI ASCII grid": b"ncols 2\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 1\n1 2\n3 4\n",
    "LandXML": xml("LandXML"),
    "DXF": b"  0\r\nSECTION\r\n  2\r\nENTITIES\r\n",
    "STL": b"solid a\n facet normal 0 0 1\n  outer loop\n",
    "DWG": b"AC1032\0\0\0\0" + RANDOM,
    "DGN": b"\x08\x09\xfe\x02" + RANDOM,
    "LAS": b"LASF\0\0\0\0" + bytes(300),
    "E57": b"ASTM-E57" + RANDOM,
    "PCD": b"# .PCD v0.7 - Point Cloud Data\nVERSION 0.7\n",
    "OFF": b"OFF\n3 1 0\n0 0 0\n",
    "PTS": b"2\n1.0 2.0 3.0 -1200 10 20 30\n1.5 2.0 3.0 -1200 10 20 30\n",
    "PLY": b"ply\nformat ascii 1.0\nelement vertex 3\n",
    "glTF": b"glTF\x02\0\0\0" + RANDOM,
    "OBJ": b"# made by a program\nmtllib a.mtl\no ground\nv 1.0 2.0 3.0\nv 1.0 2.5 3.0\n",
    "FBX": b"Kaydara FBX Binary  \0\x1a\0" + RANDOM,
    "3DS": b"MM\x10\0\0\0\x02\0\x0a\0" + RANDOM,
    "Blender": b"BLENDER-v300" + RANDOM,
    "Collada": xml("COLLADA"),
    "X3D": xml("X3D"),
    "VRML": b"#VRML V2.0 utf8\n",
    "3DM": b"3D Geometry File Format " + RANDOM,
    "SketchUp": b"\xff\xfe\xff\x0eS\0k\0e\0t\0c\0h\0" + RANDOM,
    "STEP": b"ISO-10303-21;\nHEADER;\n",
    "IGES": b"a part".ljust(72) + b"S      1\n",
    "BREP": b"DBRep_DrawableShape\n\nCASCADE Topology V1",
    "a shapefile": b"\0\0\x27\x0a" + bytes(96),
    "dBase": b"\x03\x7c\x05\x11" + bytes(60),
    "GeoJSON": b'{\n "type": "FeatureCollection",\n "features": []}',
    "GeoPackage": b"SQLite format 3\0" + RANDOM,
    "KML": b'<?xml version="1.0"?>\n<kml xmlns="a"/>',
    "GPX": xml("gpx"),
    "GML": xml("FeatureCollection"),
    "MapInfo": b'VERSION 300\nCharset "WindowsLatin1"\n',
    "GOCAD": b"GOCAD TSurf 1\nHEADER {\nname:a\n}\n",
    "OMF": b"\x84\x83\x82\x81" + RANDOM,
    "a Leapfrog mesh": b"%ARANZ-1.0\n\n[index]\n" + RANDOM,
    "12d": b'// a\nmodel "survey" {\n',
    "a binary grid of Surfer": b"DSBB" + RANDOM,
    "ZMAP grid": b"! made\n@a HEADER, GRID, 5\n",
    "DTED": b"UHL1" + b" " * 80,
    "ERDAS Imagine": b"EHFA_HEADER_TAG\0" + RANDOM,
    "netCDF": b"CDF\x01" + RANDOM,
    "GRIB": b"GRIB" + RANDOM,
    "FracMan text": b"BEGIN FORMAT\n Format = Ascii\nEND FORMAT\n",
    "gmsh": b"$MeshFormat\n4.1 0 8\n",
    "a geometry of gmsh": b'SetFactory("OpenCASCADE");\nBox(1) = {0, 0, 0, 1, 1, 1};\n',
    "vtu": xml("VTKFile", 'type="UnstructuredGrid"'),
    "VTK XML": xml("VTKFile", 'type="PolyData"'),
    "VTK legacy": b"# vtk DataFile Version 3.0\n",
    "xdmf": xml("Xdmf"),
    "FLAC3D or 3DEC grid": b"* FLAC3D grid produced by a\n* GRIDPOINTS\nG 1 0 0 0\n",
    "LS-DYNA": b"$ a deck\n*KEYWORD\n*NODE\n",
    "abaqus": b"*Heading\n*NODE\n1, 0, 0, 0\n",
    "Nastran": b"$ a\nBEGIN BULK\nGRID,1,,0.,0.,0.\n",
    "ANSYS": b"/COM,ANSYS RELEASE\n/PREP7\n",
    "Fluent": b'(0 "GAMBIT to Fluent File")\n',
    "UNV": b"    -1\n  2411\n",
    "COMSOL": b"# Created by COMSOL\n",
    "medit": b"MeshVersionFormatted 2\nDimension 3\n",
    "Netgen": b"mesh3d\ndimension\n3\n",
    "Tecplot": b'TITLE = "a"\nVARIABLES = "X" "Y"\n',
    "SU2": b"NDIME= 3\nNELEM= 1\n",
    "UCD": b"4 1 0 0 0\n1 0. 0. 0.\n",
    "MED": HDF5 + b"..ENS_MAA..",
    "an Excel workbook": archive("xl/workbook.xml"),
    "a binary Excel workbook": archive("xl/workbook.bin"),
    "a document of Apple": archive("Index/Document.iwa"),
    "OpenDocument": archive("mimetype", stored=b"application/vnd.oasis.opendocument.spreadsheet"),
    "a Word document": archive("word/document.xml"),
    "a presentation": archive("ppt/slides/slide1.xml"),
    "KMZ": archive("doc.kml"),
    "a NumPy archive": archive("a.npy"),
    "a zip archive or a damaged Excel workbook": archive("holes.csv"),
    "a packed file": b"\x1f\x8b\x08" + RANDOM,
    "an Excel workbook or document of the old kind": b"\xd0\xcf\x11\xe0\xa1\xb1" + RANDOM,
    "Excel XML": b'<?xml version="1.0"?>\n<?mso-application progid="Excel.Sheet"?>\n<Workbook/>',
    "an Access database": b"\0\x01\0\0Standard Jet DB\0" + RANDOM,
    "SYLK": b"ID;PWXL;N;E\n",
    "DIF": b'TABLE\n0,1\n"a"\n',
    "a web page": b"<!DOCTYPE html>\n<html><table>",
    "IREDES": xml("DRPPlan"),
    "BlastXML": xml("DrillPlan"),
    "XML": xml("whatever"),
    "JSON": b'{"holes": [1, 2]}',
    "a PDF document": b"%PDF-1.7\n" + RANDOM,
    "RTF": b"{\\rtf1\\ansi a}",
    "PostScript": b"%!PS-Adobe-3.0\n",
    "a picture": b"\x89PNG\r\n\x1a\n" + RANDOM,
    "a video": b"\0\0\0\x18ftypmp42" + RANDOM,
    "Parquet": b"PAR1" + RANDOM,
    "Feather or Arrow": b"ARROW1\0\0" + RANDOM,
    "HDF5": HDF5 + RANDOM,
    "HDF4": b"\x0e\x03\x13\x01" + RANDOM,
    "a pickle": b"\x80\x04\x95\x10\0\0" + RANDOM,
    "a program": b"\x7fELF\x02\x01" + RANDOM,
    "zeros": bytes(5000),
    "text": TABLE.encode(),
    "a Git LFS pointer": b"version https://git-lfs.github.com/spec/v1\noid sha256:0\n",
    "UTF-16 without its mark": TABLE.encode("utf-16-le"),
    "binary": RANDOM,
}
SUFFIXES = [(kind.name, suffix) for kind in KINDS for suffix in sorted(kind.suffix | kind.binary)]


@pytest.mark.parametrize("kind", KINDS, ids=[kind.name for kind in KINDS])
def test_every_kind_is_known_by_its_bytes_whatever_its_name(kind):
    if kind.name not in EXAMPLES:
        assert kind.suffix | kind.binary, "a kind needs an example here"
        return
    content = EXAMPLES[kind.name]

    for suffix in ("", ".csv", ".txt", ".dat", ".dxf", ".asc"):
        if kind not in (TEXT, BINARY) or suffix in ("", ".csv"):
            assert kind_of(content, suffix).name == kind.name
    if kind not in (BINARY,):
        assert kind_of(content + b"\n" + TABLE.encode()).name == kind.name


@pytest.mark.parametrize(("name", "suffix"), SUFFIXES)
def test_a_suffix_names_binary_files_that_nothing_else_names(name, suffix):
    assert kind_of(RANDOM, f".{suffix.upper()}").name == name


def named(error):
    """Return the message, if it is one sentence that calls nothing binary a damaged text."""
    text = str(error)
    assert "\n" not in text
    assert "NUL" not in text
    assert len(text) < 400
    return text


DOORS = {
    "table": lambda path: read_table(path, wanted_by("holes")), "surface": read_surface,
    "lines": read_lines, "fractures": lambda path: read_fractures(path, "F"), "mesh": read_mesh,
    "record": lambda path: read_recording(path, unit="counts"), "gather": read_gather,
    "response": read_inventory,
}  # fmt: skip


@pytest.mark.parametrize("door", DOORS)
@pytest.mark.parametrize("name", EXAMPLES)
def test_foreign_kinds_are_named_at_every_door_with_what_to_export(tmp_path, name, door):
    kind = next(kind for kind in KINDS if kind.name == name)
    if door in kind.doors or (door == "record" and "gather" in kind.doors):
        return
    path = tmp_path / "a.csv"
    path.write_bytes(EXAMPLES[name])

    with pytest.raises(ReadError) as caught:
        DOORS[door](path)

    text = named(caught.value)
    where = path.name if door in ("table", "surface", "lines", "fractures") else path
    assert text.startswith(f"{where}: is {name}")
    assert text.endswith(EXPORTS.get(kind.export, kind.export) or EXPORTS[door])


@pytest.mark.parametrize(("name", "kind"), [("mesh.ply", "PLY"), ("cloud.las", "LAS")])
def test_137_reported_surfaces_are_named(name, kind):
    with pytest.raises(ReadError, match=rf"{name}: is {kind} \(.*\); .*table of x, y, z"):
        read_surface(REPORTED / "137-foreign-kinds" / name)


def test_137_units_in_titles_are_read():
    holes = read_blast(REPORTED / "137-foreign-kinds" / "times_us.csv")
    assert holes.times[:2] == pytest.approx([0.0, 0.025])
    with pytest.warns(PyblastWarning, match="integrated from acceleration"):
        (recording,) = read_recording(REPORTED / "137-foreign-kinds" / "acc_g.csv")
    assert recording.seismogram.present.all()


@pytest.mark.parametrize("title", ["Charge (g)", "Charge (t)", "Charge (oz)", "Charge (ton)"])
def test_a_unit_of_a_title_is_read_or_named(tmp_path, title):
    path = files.write(tmp_path, TABLE.replace("Charge (kg)", title), "a.csv")

    if title == "Charge (t)":
        assert read_blast(path).charge.tolist() == [50e3, 50e3]
        return
    with pytest.raises(ReadError, match=r"'Charge \(\w+\)' is in '\w+', not read here; write kg"):
        read_blast(path)


def test_doors_and_exports_are_those_of_the_table():
    assert {door for kind in KINDS for door in kind.doors} <= set(EXPORTS)
    assert {*DOORS, "mapping"} <= set(EXPORTS)


def test_a_gather_at_the_door_of_records_is_named(tmp_path):
    with pytest.raises(InputError, match=r"is a gather \(SEG2\), read it with read_gather"):
        read_recording(files.write(tmp_path, EXAMPLES["SEG2"]))


TEXTS = [
    TABLE,
    TABLE.replace(",", ";"),
    TABLE.replace(",", "\t"),
    "x y z\n1 2 3\n",
    "1 2 3\n4 5 6\n7 8 9\n",
    "# a comment\nx_m,y_m,z_m\n1,2,3\n",
    '"Event Type : Full Waveform"\n"Serial Number : U"\n',
    "SH01,100,200,50\nSH02,100,200,50\n",
    "AD12;5;6\nDS01;7;8\n",
    "time_s,vertical_m_per_s\n0,1\n1,2\n",
    "Offset (m);PPV (mm/s)\n10;2\n",
    "raw data of logger\nTime (s);Vert (mm/s)\n0;1\n",
    "Version 3\nTime;V\n",
    "OFF-01,5,6,7\n",
    "v,t,l\n1,2,3\n",
    "123456D,5,6\n",
    "[table]\nheader = true\n",
    "[[mesh.layers]]\na = 1\n",
    "title;;\nTable;1;2\n",
    "Station Code: R01\nUnits: mm/s\nTime,Vert\n0,1\n",
    "EH1,HN1\n1,2\n",
    "2025-01-01 10:00:00,1,2\n",
    "U:1,V:2\n",
    "ID;Easting;Northing\nP1;2;3\n",
    "solid rock\nx,y,z\n",
    "Model: X\nTime (s),Vert (mm/s)\n0,1\n",
    "GRID REF,X,Y\n1,2,3\n",
    "\n\n  Hole ; X ; Y\n",
    "",
    "Titel: Sprengung\nGrößen in mm/s\n",
    "<0.5,10\n",
    "* note\nx,y,z\n",
    "{a}\n",
    "$ 5,6\n",
    "/ 7\n",
]


@pytest.mark.parametrize("text", TEXTS)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "latin-1"])
def test_text_of_tables_and_records_is_never_taken_for_another_kind(text, encoding):
    content = text.encode(encoding)

    assert is_text(content)
    for suffix in (".csv", ".txt", ".asc", ".dat", ".xyz", ".grd", ""):
        assert kind_of(content, suffix, "table").name == "text"
        assert kind_of(content, suffix, "record").name == "text"


def test_reported_tables_are_text_or_workbooks():
    names = {
        kind_of(path.read_bytes(), path.suffix, "table").name
        for path in REPORTED.rglob("*") if path.suffix in (".csv", ".xlsx", ".txt")
    }  # fmt: skip

    assert names <= {"text", "an Excel workbook"}


@pytest.mark.parametrize("seed", range(40))
def test_a_damaged_file_of_any_kind_is_named_in_one_sentence_or_read(tmp_path, seed):
    rng = np.random.default_rng(seed)
    for name in rng.choice([*EXAMPLES], 6, replace=False):
        content = bytearray(EXAMPLES[name])
        for at in rng.integers(0, max(len(content), 1), 3):
            content[at : at + 1] = bytes([rng.integers(0, 256)])
        path = files.write(tmp_path, bytes(content[: rng.integers(1, len(content) + 1)]), "a.csv")
        for read in DOORS.values():
            try:
                read(path)
            except (ReadError, InputError) as error:
                text = str(error)
                assert "\n" not in text
                assert path.name in text


def test_files_of_other_kinds_beside_records_are_passed_over(tmp_path):
    files.write(tmp_path, files.instantel_ascii(), "r.txt")
    for name in ("a PDF document", "HDF5", "a web page", "JSON", "text"):
        files.write(tmp_path, EXAMPLES[name], f"{name}.pdf")

    records, skipped = read_folder(tmp_path)

    assert len(records) == 1
    assert {reason for _, reason in skipped} == {"is no record"}


def test_the_suffix_of_a_kind_that_is_read_counts_only_at_its_door():
    assert expect("a.dxf", b"junk", "surface").name == "DXF"
    assert expect("a.dxf", b"Hole,X\n", "table") is TEXT
    with pytest.raises(ReadError, match="is DXF"):
        expect("a.dxf", b"junk", "mesh")
