"""Files as engineers keep them: what each was read as before and now.

`python -m verification.field_files` writes docs/quality/field_files.md; with ``--before FILE`` it
writes the outcomes of an earlier version of pyblast, which it imports, into FILE instead.
"""

import json
import re
import sys
import tempfile
import textwrap
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
REPORTED = ROOT / "tests" / "reported"
BEFORE = ROOT / "verification" / "field_files.json"
PAGE = ROOT / "docs" / "quality" / "field_files.md"
HEAD = """Written by `python -m verification.field_files`. Each row is one habit of people who write
files in the field: the file, where the habit is described, what pyblast read from it before this
page was started, and what it reads now. A refusal is right where a file can be read in two ways or
cannot be read; its message says what to do. {counts}"""
TABLE = """| file | habit, and where it is described | right | before | now |
|---|---|---|---|---|
"""
HOLES = "Hole,Easting,Northing,RL,Charge (kg),Delay (ms)\nA1,5,8,21,50,0\nA2,9,8,21,60,25\n"
EXCEL = "spreadsheet programs: list separator and number format of the region (Microsoft support)"


class FieldFile(NamedTuple):
    """Field file: its name, habit with source, writer into a folder, reader, and what is right."""

    name: str
    habit: str
    write: Callable[[Path], Path]
    read: Callable[[Path], Any]
    right: Sequence[float] | str  # numbers, or "refused"


def blast(path: Path) -> list[float]:
    """Return charges in kg, times in ms, and the first collar of a hole table."""
    from pyblast.blasts.hole_tables import read_blast

    holes = read_blast(path)
    return [*holes.charge, *(1e3 * holes.times), *holes.collar[0]]


def peaks(path: Path) -> list[float]:
    """Return peak velocities of a record in mm/s and its samples a second."""
    from pyblast.recordings.recording import read_recording

    motion = read_recording(path)[0].seismogram
    return [*(1e3 * motion.ppv[motion.present]), 1.0 / motion.dt]


def site(path: Path) -> list[float]:
    """Return distances in m, charges in kg and peaks in mm/s of a table of peaks."""
    from pyblast.blasts.site_law import read_site_records

    records = read_site_records(path)
    return [*records.distance, *records.charge, *(1e3 * records.ppv)]


def ground(unit: str | None = None) -> Callable:
    """Return a reader of the lowest and highest height in m of a surface over a bench."""

    def read(path):
        from pyblast.readers.geometry import read_surface

        box = np.array([(0.0, 100.0), (0.0, 60.0), (0.0, 70.0)])
        heights = read_surface(path, box=box, unit=unit).values.reshape(-1, 3)[:, 2]
        return [heights.min(), heights.max()]

    return read


def areas(path: Path) -> list[float]:
    """Return the areas of fractures in m2."""
    from pyblast.model.fractures import polygon_area, read_fractures

    return [polygon_area(fracture.polygon) for fracture in read_fractures(path, "F")]


def extent(path: Path) -> list[float]:
    """Return the lowest and highest coordinates of a mesh in m, and its number of zones."""
    from pyblast.mesh.importer import read_mesh

    mesh = read_mesh(path)
    return [*mesh.points.min(axis=0), *mesh.points.max(axis=0), len(mesh.zones)]


def clipped(path: Path) -> list[float]:
    """Return the number of clipped samples of each component."""
    from pyblast.recordings.recording import read_recording

    return [*read_recording(path)[0].clipped.sum(axis=0)]


def response(name: str) -> Callable:
    """Return a reader of the peaks in mm/s of a record of counts, with a response of a name."""

    def read(path):
        from pyblast.recordings.recording import read_recording, remove_response

        (counts,) = read_recording(path, unit="counts")
        return [*(1e3 * remove_response(counts, path.parent / name).seismogram.ppv)]

    return read


def text(content: str, name: str = "table.csv", encoding: str = "utf-8") -> Callable:
    """Return a writer of text."""

    def write(folder):
        path = folder / name
        path.write_bytes(content.encode(encoding))
        return path

    return write


def sheet(rows: Sequence[Sequence], change: Callable | None = None) -> Callable:
    """Return a writer of a workbook."""

    def write(folder):
        import openpyxl

        book = openpyxl.Workbook()
        for row in rows:
            book.active.append(list(row))
        if change is not None:
            change(book.active)
        book.save(folder / "table.xlsx")
        return folder / "table.xlsx"

    return write


def copied(name: str) -> Callable:
    """Return a writer that gives a reported file."""
    return lambda _: REPORTED / name


def record(
    titles: str, times: Callable = "{:.6f}".format, scale: float = 1.0, extra: str = ""
) -> str:
    """Return a record of 300 samples at 1024 a second, with peaks of 8, 4 and 2 mm/s."""
    t = np.arange(300) / 1024.0
    pulse = np.where(t < 0.2, np.sin(2.0 * np.pi * 16.0 * t), 0.0)
    count = titles.split("\n")[-1].count(",")
    rows = [
        ",".join(
            [
                times(x),
                *(f"{scale * size * y:.6f}" for size in (8.0, 4.0, 2.0, 1.0, 0.5, 0.25)[:count]),
            ]
        )
        for x, y in zip(t, pulse, strict=True)
    ]
    return "\n".join([titles, *rows]) + extra


def cells(content: str) -> list[list]:
    """Return rows of cells with numbers."""
    rows = [line.split(",") for line in content.strip().split("\n")]
    return [[float(c) if re.fullmatch(r"-?[\d.]+", c) else c or None for c in row] for row in rows]


def holes(**changes: str) -> str:
    """Return the hole table with replaced texts: ``charge`` for "Charge (kg)", and so on."""
    content = HOLES
    for old, new in changes.items():
        content = content.replace(old, new)
    return content


MOTION = "Time (s),Long (mm/s),Tran (mm/s),Vert (mm/s)"
PEAKS = [8.0, 4.0, 2.0, 1024.0]
TWO = [50.0, 60.0, 0.0, 25.0, 5.0, 8.0, 21.0]
GERMAN = (
    "Bohrloch;Rechtswert;Hochwert;Höhe;Ladung [kg];Zündzeit [ms]\n"
    "A1;5;8;21;50,0;0\nA2;9;8;21;60,0;25\n"
)
FILES = (
    FieldFile(
        "01 delay and firing time",
        "blast plans list the delay after the previous hole next to the firing time (design "
        "programs)",
        copied("01-two-time-columns/delay_and_time.csv"),
        blast,
        [50, 50, 50, 50, 0, 25, 50, 75, 5000, 8000, 210],
    ),
    FieldFile(
        "01 downhole and surface delay",
        "non-electric plans: detonator, connector, initiation time",
        copied("01-two-time-columns/downhole_and_surface.csv"),
        blast,
        [50, 50, 50, 500, 525, 550, 5000, 8000, 210],
    ),
    FieldFile(
        "02 designed and loaded charge",
        "blast reports: planned next to actual",
        copied("02-design-and-actual-charge/design_and_actual.csv"),
        blast,
        [82, 0, 74, 0, 25, 50, 5000, 8000, 210],
    ),
    FieldFile(
        "03 thousands in quotes",
        EXCEL,
        copied("03-thousands-comma/charges.csv"),
        blast,
        [1250, 1250, 980, 0, 25, 50, 5000, 8000, 210],
    ),
    FieldFile(
        "03 three digits after every comma",
        EXCEL,
        copied("03-thousands-comma/semicolons.csv"),
        blast,
        "refused",
    ),
    FieldFile(
        "04 bench height before the level",
        "drill plans",
        copied("04-bench-height/bench_height.csv"),
        blast,
        [50, 50, 0, 25, 5000, 8000, 210],
    ),
    FieldFile(
        "05 state-plane feet without unit",
        "plans in the United States",
        copied("05-feet-beside-pounds/imperial.csv"),
        blast,
        "refused",
    ),
    FieldFile(
        "06 hole angle",
        "drill plans: from the vertical or the horizontal",
        copied("06-titles-of-angles-and-toes/hole_angle.csv"),
        blast,
        "refused",
    ),
    FieldFile(
        "06 collar and toe",
        "survey of holes",
        copied("06-titles-of-angles-and-toes/collar_toe.csv"),
        blast,
        [70, 70, 0, 25, 5000, 8000, 210],
    ),
    FieldFile(
        "07 masses partly measured",
        "Kirra: 0 with the time stamp of 1975",
        copied("07-masses-never-measured/partly.csv"),
        blast,
        [62, np.nan, np.nan, 0, 25, 50, 5000, 8000, 210],
    ),
    FieldFile(
        "08 total",
        "spreadsheets of blasts",
        copied("08-spreadsheet-habits/total.csv"),
        blast,
        [50, 50, 50, 0, 25, 50, 5000, 8000, 210],
    ),
    FieldFile(
        "08 name of the explosive",
        "spreadsheets of blasts",
        copied("08-spreadsheet-habits/explosive.csv"),
        blast,
        [50, 50, 0, 25, 5000, 8000, 210],
    ),
    FieldFile(
        "08 formula without value",
        "workbooks written by scripts (openpyxl manual: no values are computed)",
        copied("08-spreadsheet-habits/formula.xlsx"),
        blast,
        "refused",
    ),
    FieldFile(
        "08 numbers as text",
        "spreadsheets: green triangle",
        copied("08-spreadsheet-habits/text.xlsx"),
        blast,
        [1250, 1250, 1250, 0, 25, 50, 5000.5, 8000, 210],
    ),
    FieldFile(
        "08 diameter in inches",
        "bits are sold in inches",
        copied("08-spreadsheet-habits/inches.csv"),
        blast,
        [70, 70, 0, 25, 5000, 8000, 210],
    ),
    FieldFile(
        "09 two geophones",
        "recorders with two sensors",
        text(record("Time (s),L1 (mm/s),T1 (mm/s),V1 (mm/s),L2 (mm/s),T2 (mm/s),V2 (mm/s)")),
        peaks,
        "refused",
    ),
    FieldFile(
        "10 X, Y, Z",
        "scripts and general recorders",
        text(record("Time (s),X (mm/s),Y (mm/s),Z (mm/s)")),
        peaks,
        PEAKS,
    ),
    FieldFile(
        "10 v_x, v_y, v_z",
        "scripts and general recorders",
        text(record("t [s],v_x [mm/s],v_y [mm/s],v_z [mm/s]")),
        peaks,
        PEAKS,
    ),
    FieldFile(
        "12 times rounded to milliseconds",
        "spreadsheets show three decimals and save what they show",
        text(record(MOTION, "{:.3f}".format)),
        peaks,
        PEAKS,
    ),
    FieldFile(
        "13 times of day",
        "recorders of monitoring systems",
        text(
            record("Time,Long (mm/s),Tran (mm/s),Vert (mm/s)", lambda x: f"13:05:{7.0 + x:09.6f}")
        ),
        peaks,
        PEAKS,
    ),
    FieldFile(
        "26 usual titles of peaks",
        "tables of peaks in spreadsheets",
        copied("26-titles-at-every-door/peaks_titles.csv"),
        site,
        [
            1050,
            850,
            640,
            420,
            310,
            1240,
            980,
            710,
            520,
            260,
            180,
            150,
            120,
            120,
            110,
            130,
            120,
            125,
            118,
            122,
            121,
            119,
            120,
            121,
            1.9,
            2.7,
            4.1,
            8.4,
            12.9,
            1.5,
            2.1,
            3.4,
            5.9,
            17.2,
            31.0,
            41.5,
        ],
    ),
    FieldFile(
        "26 peaks below the trigger",
        "monitoring reports: <0.5",
        copied("26-titles-at-every-door/peaks_below_trigger.csv"),
        site,
        [
            850,
            640,
            420,
            310,
            1240,
            980,
            710,
            520,
            260,
            180,
            150,
            120,
            110,
            130,
            120,
            125,
            118,
            122,
            121,
            119,
            120,
            121,
            2.7,
            4.1,
            8.4,
            12.9,
            1.5,
            2.1,
            3.4,
            5.9,
            17.2,
            31.0,
            41.5,
        ],
    ),
    FieldFile(
        "CSV UTF-8",
        "Excel, Save as CSV UTF-8: begins with a byte-order mark",
        text(holes(), encoding="utf-8-sig"),
        blast,
        TWO,
    ),
    FieldFile(
        "Unicode text",
        "Excel, Save as Unicode Text: UTF-16 and tabs",
        text(holes().replace(",", "\t"), encoding="utf-16"),
        blast,
        TWO,
    ),
    FieldFile(
        "German CSV",
        "Excel in Germany: semicolons, decimal commas, Windows-1252",
        text(GERMAN, encoding="latin-1"),
        blast,
        TWO,
    ),
    FieldFile(
        "sep=;",
        "first line that gives Excel the separator",
        text("sep=;\n" + holes().replace(",", ";")),
        blast,
        TWO,
    ),
    FieldFile(
        "Swiss thousands",
        "number format of de-CH: 1'250.5",
        text(holes().replace(",", ";").replace(";50;", ";1'250.5;")),
        blast,
        [1250.5, *TWO[1:]],
    ),
    FieldFile(
        "French thousands",
        "number format of fr-FR: narrow no-break space",
        text(holes().replace(",", ";").replace(";50;", ";1\u202f250,5;")),
        blast,
        [1250.5, *TWO[1:]],
    ),
    FieldFile(
        "Indian grouping",
        "number format of en-IN: 1,25,000",
        text(holes().replace(",50,0", ',"1,25,000",0')),
        blast,
        "refused",
    ),
    FieldFile(
        "points between thousands",
        "number format of de-DE: 1.250 next to 60,5",
        text(GERMAN.replace("50,0", "1.250").replace("60,0", "60,5")),
        blast,
        [1250, 60.5, *TWO[2:]],
    ),
    FieldFile(
        "1.250 beside 980",
        "the same without any decimal comma: ambiguous",
        text(GERMAN.replace("50,0", "1.250").replace("60,0", "980")),
        blast,
        "refused",
    ),
    FieldFile(
        "units in cells",
        "hand-written tables: 50 kg",
        text(holes().replace(" (kg)", "").replace(",50,", ",50 kg,").replace(",60,", ",60 kg,")),
        blast,
        TWO,
    ),
    FieldFile(
        "units below the titles",
        "exports with a row of units",
        text(
            holes()
            .replace(" (kg)", "")
            .replace(" (ms)", "")
            .replace("Delay\n", "Delay\n,[m],[m],[m],[kg],[ms]\n")
        ),
        blast,
        TWO,
    ),
    FieldFile(
        "titles over merged cells",
        "workbooks: Collar and Toe over E, N, RL",
        sheet(
            [
                ["Hole", "Collar", None, None, "Toe", None, None, "Charge", "Delay"],
                [None, "E", "N", "RL", "E", "N", "RL", "(kg)", "(ms)"],
                [1, 5, 8, 21, 5, 8, 11, 50, 0],
                [2, 9, 8, 21, 9, 8, 11, 60, 25],
            ],
            lambda s: (s.merge_cells("B1:D1"), s.merge_cells("E1:G1")),
        ),
        blast,
        TWO,
    ),
    FieldFile(
        "a delay over merged cells",
        "workbooks: one delay for the holes of a row",
        sheet(cells(holes()), lambda s: s.merge_cells("F2:F3")),
        blast,
        [50, 60, 0, 0, 5, 8, 21],
    ),
    FieldFile(
        "a charge over merged cells",
        "workbooks: one charge for two holes, each or together?",
        sheet(cells(holes()), lambda s: s.merge_cells("E2:E3")),
        blast,
        "refused",
    ),
    FieldFile(
        "subtotals",
        "spreadsheets: function Subtotal",
        text(holes().replace("A2", "Subtotal,,,,50,\nA2") + "Grand total,,,,110,\n"),
        blast,
        TWO,
    ),
    FieldFile(
        "Summe without a word",
        "spreadsheets: AutoSum below the column",
        text(holes() + ",,,,110,\n"),
        blast,
        TWO,
    ),
    FieldFile(
        "titles on every page",
        "tables from printed reports",
        text(holes().replace("A2", "Hole,Easting,Northing,RL,Charge (kg),Delay (ms)\nA2")),
        blast,
        TWO,
    ),
    FieldFile(
        "a note below the table",
        "printed reports: name and date",
        text(holes() + "Printed by J. D. on Tuesday,,,,,\n"),
        blast,
        TWO,
    ),
    FieldFile(
        "lines above the titles",
        "site, date and shot above the table",
        text("Shot 12\nBench,B3\n\n" + holes()),
        blast,
        TWO,
    ),
    FieldFile(
        "a comma inside a number",
        "typed by hand, not quoted",
        text(holes().replace(",60,", ",1,060,")),
        blast,
        "refused",
    ),
    FieldFile(
        "#N/A",
        "spreadsheets: look-up without result",
        sheet(cells(holes().replace(",60,", ",#N/A,"))),
        blast,
        [50, np.nan, *TWO[2:]],
    ),
    FieldFile(
        "anfo and emulsion",
        "charging sheets: products and their sum",
        text(
            "Hole,Easting,Northing,RL,ANFO (kg),Emulsion (kg),Total charge (kg),Delay (ms)\n"
            "A1,5,8,21,30,20,50,0\nA2,9,8,21,40,20,60,25\n"
        ),
        blast,
        TWO,
    ),
    FieldFile(
        "booster and main charge",
        "charging sheets",
        text(
            "Hole,Easting,Northing,RL,Main charge (kg),Booster (kg),Delay (ms)\n"
            "A1,5,8,21,50,0.4,0\nA2,9,8,21,60,0.4,25\n"
        ),
        blast,
        "refused",
    ),
    FieldFile(
        "level twice",
        "the same height as RL and Elevation",
        text(holes().replace("RL", "RL,Elevation (m)").replace(",21,", ",21,21.0,")),
        blast,
        TWO,
    ),
    FieldFile(
        "depth in metres and feet",
        "bilingual drill logs",
        text(
            holes()
            .replace("RL", "RL,Depth (m),Depth (ft),X")
            .replace(",21,", ",21,12,39.4,,")
            .replace(",X", ",Remarks")
        ),
        blast,
        TWO,
    ),
    FieldFile(
        "charge per delay",
        "monitoring reports: MIC next to the total charge",
        text(
            "Distance (m),Total charge (kg),Max charge per delay (kg),PPV (mm/s)\n"
            "100,900,50,8\n200,800,60,3\n"
        ),
        site,
        [100, 200, 50, 60, 8, 3],
    ),
    FieldFile(
        "peaks in cm/s",
        "China, GB 6722: cm/s",
        text("distance_m,charge_kg,PPV (cm/s)\n100,50,0.8\n200,60,0.3\n"),
        site,
        [100, 200, 50, 60, 8, 3],
    ),
    FieldFile(
        "averages below the peaks",
        "spreadsheets",
        text("Distance (m),Charge (kg),PPV (mm/s)\n100,50,8\n200,60,3\nAverage,55,5.5\n"),
        site,
        [100, 200, 50, 60, 8, 3],
    ),
    FieldFile(
        "T for transverse",
        "seismographs: L, T, V",
        text(record("T (s),L (mm/s),T (mm/s),V (mm/s)")),
        peaks,
        PEAKS,
    ),
    FieldFile(
        "inches a second",
        "seismographs in the United States: ips",
        text(record("Time (s),Long (ips),Tran (ips),Vert (ips)", scale=1.0 / 25.4)),
        peaks,
        PEAKS,
    ),
    FieldFile(
        "largest values below the samples",
        "recorder software: Max row",
        text(record(MOTION, extra="\nMax,8,4,2")),
        peaks,
        PEAKS,
    ),
    FieldFile(
        "9999 for a missing sample",
        "loggers: code for missing data",
        text(re.sub(r"\n0.100586,.*", "\n0.100586,9999,0,0", record(MOTION))),
        peaks,
        "refused",
    ),
    FieldFile(
        "velocity and acceleration",
        "recorder software: both in one table",
        text(record("Time (s),Long (mm/s),Tran (mm/s),Vert (mm/s),Long (g),Tran (g)")),
        peaks,
        PEAKS,
    ),
    FieldFile(
        "logger with units and processing rows",
        "Campbell Scientific, table TOA5: two rows below the titles",
        text(
            record(
                '"TOA5","CR6"\nTIMESTAMP,Vert,Long,Tran\nTS,mm/s,mm/s,mm/s\n,Smp,Smp,Smp',
                lambda x: f"2024-03-05 13:05:{7.0 + x:09.6f}",
            )
        ),
        peaks,
        "refused",
    ),
)

INSTANTEL = """"Event Type : Full Waveform"
"Serial Number : UM1"
"Units : mm/s and Pa"
"Record Time : 0.29297 sec at 1024 sps"
"Tran PPV : high"
"""


def export(titles: str, head: str = INSTANTEL, foot: str = "") -> str:
    """Return an export of a seismograph without times."""
    rows = record(MOTION).split("\n")[1:]
    samples = (row.split(",", 1)[1].replace(",", "\t") for row in rows)
    return "\n".join([head, titles, *samples, foot])


FEET = "131-unit-key-beside-a-table/surface_plain.csv"
TABLE_IN_FEET = "X (ft),Y (ft),Z (ft)\n0,0,164\n330,0,170\n0,200,160\n330,200,180\n"
FLAT_TOPS = REPORTED / "141-flat-tops-below-the-range" / "geo8.txt"
EPOCHS = "135-stationxml-two-epochs"
FILES += (
    FieldFile("131 surface in feet, key", "surveys in the United States: surface_unit = \"ft\"",
              copied(FEET), ground("ft"), [49.0, 61.0]),
    FieldFile("131 surface in feet, no key", "the same without the key: 100 m above its box",
              copied(FEET), ground(), "refused"),
    FieldFile("surface with titles in feet", "exports of points with units in the titles",
              text(TABLE_IN_FEET), ground(), [48.768, 54.864]),
    FieldFile("132 offset of a GeoTIFF", "GDAL: heights are stored value x scale + offset",
              copied("132-geotiff-scale-and-offset/offset_only.tif"), ground(), [48.5, 61.5]),
    FieldFile("grid without header, as .asc", "state surveys: x y z of a grid, named .asc or .xyz",
              text("0 0 50\n100 0 51\n0 60 52\n100 60 53\n", "dgm1.asc"), ground(), [50, 53]),
    FieldFile("133 FracMan in feet", "FORMAT: Length_Unit = Feet",
              copied("133-fab-units-and-numbers/feet_small.fab"), areas, [36.0]),
    FieldFile("133 corners from 0", "PorePy writes corners from 0",
              copied("133-fab-units-and-numbers/from0.fab"), areas, [400.0]),
    FieldFile("134 nodes in two blocks", "Abaqus: *NODE may be repeated",
              copied("134-abaqus-instances/two_node_blocks.inp"), extent,
              [0, 0, 0, 40, 20, 20, 266]),
    FieldFile("134 a part that is moved", "Abaqus: *INSTANCE with a translation",
              copied("134-abaqus-instances/instance_moved.inp"), extent, "refused"),
    FieldFile("135 epochs that overlap", "station metadata: epoch not ended at a change of gain",
              copied(f"{EPOCHS}/rec.mseed"), response("overlap.xml"), "refused"),
    FieldFile("135 total sensitivity alone", "station metadata without stages",
              copied(f"{EPOCHS}/rec.mseed"), response("sens_only.xml"), "refused"),
    FieldFile("137 point cloud", "scanners and drones: LAS",
              copied("137-foreign-kinds/cloud.las"), ground(), "refused"),
    FieldFile("137 triangles of a scanner", "photogrammetry: PLY",
              copied("137-foreign-kinds/mesh.ply"), ground(), "refused"),
    FieldFile("triangles of GOCAD", "geological models: TSurf", text("GOCAD TSurf 1\n", "a.ts"),
              ground(), "refused"),
    FieldFile("accelerogram of PEER", "strong-motion databases: AT2",
              text("PEER NGA STRONG MOTION DATABASE RECORD\n", "a.at2"), peaks, "refused"),
    FieldFile("drill plan in XML", "IREDES of drill rigs",
              text('<?xml version="1.0"?>\n<DRPPlan xmlns="a"/>', "plan.xml"), blast, "refused"),
    FieldFile("137 delays in microseconds", "electronic detonators",
              text(holes(**{"Delay (ms)": "Delay (us)", ",25\n": ",25000\n"})), blast, TWO),
    FieldFile("charges in tonnes", "reports of a whole blast",
              text(holes(**{"(kg)": "(t)", ",50,": ",0.05,", ",60,": ",0.06,"})), blast, TWO),
    FieldFile("141 flat tops below the range", "settings and amplifiers clip below the range",
              text(FLAT_TOPS.read_text().replace("8.0 mm/s", "254.0 mm/s")), clipped,
              [174, 0, 108]),
    FieldFile("142 titles in quotes", "Instantel: ASCII export",
              copied("142-instantel-header-lines/quoted280.txt"), peaks,
              [3.8356, 1.926, 3.1132, 1024]),
    FieldFile("rate in the record time, words for peaks", "Instantel: ASCII export",
              text(export("Long\tTran\tVert")), peaks, PEAKS),
    FieldFile("footer of an export", "Instantel: ASCII export",
              text(export("Long\tTran\tVert", foot="End of data")), peaks, PEAKS),
    FieldFile("unit and rate above the titles", "loggers: lines of metadata",
              text(export("Long\tTran\tVert", "Units: mm/s\nSample rate: 1024 Hz")), peaks, PEAKS),
    FieldFile("acceleration in g", "accelerometers: Vert (g)",
              copied("137-foreign-kinds/acc_g.csv"), lambda path: peaks(path)[3:], [200.0]),
)  # fmt: skip


def outcome(file: FieldFile, folder: Path) -> tuple[str, bool]:
    """Return in words what a file is read as, and whether that is right."""
    path = file.write(folder)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            numbers = np.array(file.read(path), dtype=float)
    except Exception as error:
        said = str(error).replace(f"{folder}/", "").replace(f"{path.parent}/", "").split("\n")[0]
        known = type(error).__name__ in ("ReadError", "InputError")
        kind = "refused" if known else f"fails ({type(error).__name__})"
        return f"{kind}: {said}"[:150], known and file.right == "refused"
    if file.right == "refused":
        return f"read as {_shown(numbers)}", False
    right = np.array(file.right, dtype=float)
    same = len(numbers) == len(right) and np.allclose(numbers, right, rtol=2e-3, equal_nan=True)
    return ("right", True) if same else (f"read as {_shown(numbers)}", False)


def _shown(numbers):
    """Write a few numbers."""
    return ", ".join(f"{x:.6g}" for x in numbers[:6]) + (", ..." if len(numbers) > 6 else "")


def outcomes() -> dict[str, tuple[str, bool]]:
    """Return the outcome of every file by its name."""
    with tempfile.TemporaryDirectory() as folder:
        return {file.name: outcome(file, Path(folder)) for file in FILES}


def page(now: dict[str, tuple[str, bool]], before: dict[str, list]) -> str:
    """Return the page."""
    was, right = sum(before[n][1] for n in now if n in before), sum(ok for _, ok in now.values())
    wrong = sum(not ok and said.startswith("read") for said, ok in before.values())
    counts = (
        f"Of {len(FILES)} files {right} are right now. Before, {was} were right, {wrong} were "
        "misread silently, and the others refused."
    )
    rows = []
    for file in FILES:
        right_is = "refused" if file.right == "refused" else _shown(np.array(file.right))
        was_now = _cell(before.get(file.name, ["-", False])), _cell(now[file.name])
        rows.append(f"| {file.name} | {file.habit} | {right_is} | {' | '.join(was_now)} |")
    intro = textwrap.fill(" ".join(HEAD.format(counts=counts).split()), 110)
    return "\n".join(["# Field files", "", intro, "", TABLE + "\n".join(rows), ""])


def _cell(row):
    """Write an outcome for a table; what is not right in bold."""
    said = row[0].replace("|", "/").replace("\t", " ").replace("*", r"\*")
    return said if row[1] else f"**{said}**"


if __name__ == "__main__":
    if sys.argv[1:2] == ["--before"]:
        Path(sys.argv[2]).write_text(json.dumps(outcomes(), indent=1, ensure_ascii=False) + "\n")
    else:
        PAGE.write_text(page(outcomes(), json.loads(BEFORE.read_text())), encoding="utf-8")
