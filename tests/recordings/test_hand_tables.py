"""Tables made by hand, workbooks, microphones, histograms, offsets: read, or refused by name."""

import io

import numpy as np
import pytest
import recorder_files as files
from recorder_files import write

from pyblast.blasts.hole_tables import read_blast
from pyblast.errors import InputError, PyblastWarning, ReadError
from pyblast.recordings.raw import decibels
from pyblast.recordings.recording import read_recording
from pyblast.workflows import workbook_of

openpyxl = pytest.importorskip("openpyxl")
TIMES = np.arange(200) / 1000.0
PULSE = np.where(TIMES < 0.1, np.sin(2.0 * np.pi * 40.0 * TIMES), 0.0)
COMPONENTS = np.column_stack([8.0 * PULSE, 5.0 * PULSE, 2.0 * PULSE])  # mm/s


def table(titles, columns, delimiter=",", decimal="."):
    rows = [delimiter.join(titles)]
    for row in np.column_stack(columns):
        rows.append(delimiter.join(f"{value:.6f}".replace(".", decimal) for value in row))
    return "\n".join(rows) + "\n"


HEADS = [
    (["Time (s)", "Long (mm/s)", "Tran (mm/s)", "Vert (mm/s)"], ",", "."),
    (["Zeit [ms]", "Radial [mm/s]", "Tangential [mm/s]", "Vertikal [mm/s]"], ";", ","),
    (["Temps (s)", "Longitudinale mm/s", "Transversale mm/s", "Verticale mm/s"], "\t", ","),
    (["Tiempo (s)", "Longitudinal (mm/s)", "Transversal (mm/s)", "Vertical (mm/s)"], ";", "."),
    (["Tempo (s)", "Radiale (mm/s)", "Trasversale (mm/s)", "Verticale (mm/s)"], ",", "."),
    (["Время (s)", "Продольная (mm/s)", "Поперечная (mm/s)", "Вертикальная (mm/s)"], ";", ","),
]


@pytest.mark.parametrize(("titles", "delimiter", "decimal"), HEADS, ids=lambda x: str(x)[:12])
def test_usual_titles_of_any_language_are_read_in_si(tmp_path, titles, delimiter, decimal):
    scale = 1e3 if "ms]" in titles[0] else 1.0
    text = table(titles, [scale * TIMES, *COMPONENTS.T], delimiter, decimal)

    record = read_recording(write(tmp_path, text))[0].seismogram

    assert record.components == ("longitudinal", "transverse", "vertical")
    np.testing.assert_allclose(record.velocity, 1e-3 * COMPONENTS, atol=1e-9)
    assert record.dt == pytest.approx(1e-3)


def test_units_may_stand_in_the_row_below(tmp_path):
    text = table(["Time", "Vert"], [TIMES, COMPONENTS[:, 0]]).split("\n")
    path = write(tmp_path, "\n".join([text[0], "[s],[in/s]", *text[1:]]))

    with pytest.warns(PyblastWarning, match="east and north missing"):
        record = read_recording(path)[0].seismogram

    assert record.ppv[2] == pytest.approx(0.0254 * 8.0, rel=0.02)


@pytest.mark.parametrize(
    ("titles", "message"),
    [
        (["Long (mm/s)", "Tran (mm/s)"], "the column of time is missing"),
        (["Time (s)", "Temperature"], "a column of motion is missing"),
        (["Time (s)", "Long"], "column 2 'Long' needs its unit, mm/s"),
        (["Time", "Long (mm/s)"], "column 1 'Time' needs its unit, s or ms"),
        (
            ["Time (s)", "Vert (mm/s)", "V (mm/s)"],
            r"column 2 'Vert .mm/s.' and column 3 'V .mm/s.' may both be",
        ),
    ],
)
def test_what_is_missing_or_doubled_is_named(tmp_path, titles, message):
    path = write(tmp_path, table(titles, [TIMES, *COMPONENTS.T][: len(titles)]))

    with pytest.raises((ReadError, InputError), match=message):
        read_recording(path)


def test_a_record_without_a_component_says_so(tmp_path):
    path = write(tmp_path, table(["Time (s)", "Long (mm/s)"], [TIMES, COMPONENTS[:, 0]]))

    with pytest.warns(PyblastWarning, match="columns for transverse and vertical missing"):
        record = read_recording(path)[0].seismogram
    assert record.present.tolist() == [True, False, False]


# air overpressure


@pytest.mark.parametrize(("unit", "factor"), [("Pa", 1.0), ("kPa", 1e-3), ("mbar", 1e-2)])
def test_a_microphone_is_read_in_pascal_and_decibels(tmp_path, unit, factor):
    loud = 20.0 * PULSE
    titles = ["Time (s)", "Long (mm/s)", "Tran (mm/s)", "Vert (mm/s)", f"MicL ({unit})"]
    path = write(tmp_path, table(titles, [TIMES, *COMPONENTS.T, factor * loud]))

    record = read_recording(path)[0]

    assert record.peak_overpressure == pytest.approx(np.abs(loud).max(), rel=1e-3)
    assert record.peak_overpressure_db == pytest.approx(decibels(np.abs(loud).max()), abs=0.01)


def test_decibels_follow_their_definition():
    assert decibels(20e-6) == pytest.approx(0.0)
    assert decibels(200.0) - decibels(20.0) == pytest.approx(20.0)


def test_the_microphone_of_an_instantel_export_is_kept(tmp_path):
    record = read_recording(write(tmp_path, files.instantel_ascii(microphone=True)))[0]

    assert record.overpressure is not None
    assert len(record.overpressure) == len(record.seismogram.velocity)


@pytest.mark.parametrize("kind", ["Histogram", "Histogram Combo"])
def test_a_histogram_is_refused_as_such(tmp_path, kind):
    path = write(tmp_path, files.instantel_ascii(changes={"Event Type": kind}))

    with pytest.raises(ReadError, match=r"is a histogram .*no waveform; export the full waveform"):
        read_recording(path)


# offsets


def test_a_constant_offset_is_taken_off_and_said(tmp_path):
    moved = COMPONENTS + np.array([1.0, 0.0, 0.0])
    shifted = np.vstack([np.tile(moved[-1], (50, 1)), moved])
    times = np.arange(len(shifted)) / 1000.0
    path = write(tmp_path, table(HEADS[0][0], [times, *shifted.T]))

    with pytest.warns(PyblastWarning, match=r"offset of 1 mm/s \(longitudinal\) was taken off"):
        record = read_recording(path)[0]

    np.testing.assert_allclose(record.seismogram.velocity[50:], 1e-3 * COMPONENTS, atol=1e-8)
    assert record.offset == pytest.approx((1e-3, 0.0, 0.0))


# workbooks

HOLES = "Hole,Easting,Northing,RL,Charge (kg),Delay (ms)\nA1,10,20,5,50,0\nA2,14,20,5,60.5,25\n"


def workbook(tmp_path, **sheets):
    path = tmp_path / "book.xlsx"
    path.write_bytes(workbook_of(sheets))
    return path


def test_a_record_and_a_hole_table_are_read_from_the_sheet_named(tmp_path):
    motion = table(HEADS[0][0], [TIMES, *COMPONENTS.T])
    path = workbook(tmp_path, Shot=motion, Holes=HOLES)

    record = read_recording(path, sheet="Shot")[0].seismogram
    blast = read_blast(path, sheet="Holes")

    np.testing.assert_allclose(record.velocity, 1e-3 * COMPONENTS, atol=1e-9)
    assert blast.charge.tolist() == [50.0, 60.5]
    assert blast.times.tolist() == [0.0, 0.025]


def test_a_sheet_must_be_named_where_several_have_cells_and_must_exist(tmp_path):
    path = workbook(tmp_path, First=HOLES, Second=HOLES)

    with pytest.raises(InputError, match=r"several sheets .First, Second.; name one by sheet"):
        read_blast(path)
    with pytest.raises(InputError, match="no sheet 'Third'; its sheets are First, Second"):
        read_blast(path, sheet="Third")


def test_a_sheet_beside_a_csv_file_is_refused(tmp_path):
    path = write(tmp_path, HOLES, "holes.csv")

    with pytest.raises(InputError, match="is no Excel workbook"):
        read_blast(path, sheet="Holes")


@pytest.mark.parametrize("cut", [100, 2000])
def test_a_damaged_workbook_is_refused_in_one_sentence(tmp_path, cut):
    path = write(tmp_path, workbook_of({"Holes": HOLES})[:cut], "holes.xlsx")

    for reader in (read_blast, read_recording):
        with pytest.raises(ReadError, match="damaged Excel workbook"):
            reader(path)


def test_a_written_workbook_holds_numbers_and_no_formulas():
    content = workbook_of({"a/b": 'name,value\n"=1+1",2.5\n', "A_B": "x\n1\n"})

    book = openpyxl.load_workbook(io.BytesIO(content))
    assert book.sheetnames == ["a_b", "A_B 2"]
    assert book["a_b"]["B2"].value == 2.5
    assert book["a_b"]["A2"].data_type == "s"


# hole tables


@pytest.mark.parametrize(
    "text",
    [
        HOLES,
        "Bohrloch;Rechtswert [m];Hochwert [m];Höhe [m];Ladung [kg];Zündzeit [ms]\n"
        "A1;10,0;20,0;5,0;50,0;0\nA2;14,0;20,0;5,0;60,5;25\n",
        "Barreno\tEste\tNorte\tCota\tCarga (kg)\tRetardo (s)\nA1\t10\t20\t5\t50\t0\n"
        "A2\t14\t20\t5\t60.5\t0.025\n",
        "Tir 12 du 3 mars,,,,,\nTrou,X (m),Y (m),Z (m),Charge (kg),Retard (ms)\n"
        "A1,10,20,5,50,0\nA2,14,20,5,60.5,25\n",
    ],
    ids=["English", "German", "Spanish", "French"],
)
def test_hole_tables_with_usual_titles_agree(tmp_path, text):
    blast = read_blast(write(tmp_path, text, "holes.csv"))

    assert blast.collar.tolist() == [[10.0, 20.0, 5.0], [14.0, 20.0, 5.0]]
    assert blast.charge.tolist() == [50.0, 60.5]
    np.testing.assert_allclose(blast.times, [0.0, 0.025])
    assert blast.hole_ids == ("A1", "A2")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (HOLES.replace(",RL", ",Remark"), r"missing columns: z \(m\)"),
        (HOLES.replace("Charge (kg)", "Charge"), r"'Charge' needs its unit, kg or lb"),
        (HOLES.replace("Delay (ms)", "Pattern"), r"missing columns: delay \(ms\)"),
    ],
)
def test_a_missing_column_or_unit_of_a_hole_table_is_named(tmp_path, text, message):
    with pytest.raises(ReadError, match=message):
        read_blast(write(tmp_path, text, "holes.csv"))
