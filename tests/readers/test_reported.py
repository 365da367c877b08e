"""Tables as engineers keep them: read to the right numbers, or refused in one true sentence.

The folders under ``tests/reported`` have the numbers of field reports; each test is of the whole
kind: every reader and every delimiter.
"""

import warnings
from pathlib import Path

import numpy as np
import pytest

from pyblast.blasts.hole_tables import read_blast
from pyblast.blasts.site_law import read_site_records
from pyblast.config.section import read_time_function
from pyblast.errors import InputError, PyblastWarning, ReadError
from pyblast.line_records.field_records import read_geometry
from pyblast.readers.geometry import read_lines
from pyblast.readers.provenance import ReadLog
from pyblast.recordings.recording import read_recording

openpyxl = pytest.importorskip("openpyxl")
REPORTED = Path(__file__).parents[1] / "reported"
HOLES = "Hole,Easting,Northing,RL,Charge (kg),Delay (ms)\nA1,5,8,21,50,0\nA2,9,8,21,50,25\n"
TIMES = np.arange(400) / 1024.0
PULSE = np.where(TIMES < 0.2, np.sin(2.0 * np.pi * 20.0 * TIMES), 0.0)
PEAKS = np.array([7.97, 2.99, 4.98])  # mm/s


def written(folder, text, name="table.csv", encoding="utf-8"):
    path = folder / name
    path.write_bytes(text.encode(encoding))
    return path


def workbook(folder, rows, name="table.xlsx", change=None):
    book = openpyxl.Workbook()
    for row in rows:
        book.active.append(row)
    if change is not None:
        change(book.active)
    book.save(folder / name)
    return folder / name


def holes(name):
    return read_blast(REPORTED / name)


def quiet(read, path, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PyblastWarning)
        return read(path, **options)


def record(folder, titles, times=None, columns=PEAKS, digits=6):
    values = np.column_stack([TIMES if times is None else times, PULSE[:, None] * columns])
    rows = [",".join(titles), *(",".join(f"{x:.{digits}f}" for x in row) for row in values)]
    return written(folder, "\n".join(rows))


# 01 two columns of time, 02 design and actual charge


@pytest.mark.parametrize(
    ("name", "times", "words"),
    [
        ("01-two-time-columns/delay_and_time.csv", [0, 25, 50, 75], "'Firing time (ms)'"),
        ("01-two-time-columns/downhole_and_surface.csv", [500, 525, 550], "'Initiation time (ms)'"),
    ],
)
def test_the_firing_time_goes_before_delays(name, times, words):
    blast = holes(name)

    assert 1e3 * blast.times == pytest.approx(times)
    assert blast.charge_per_window() == pytest.approx(50.0)
    assert any(words in note and "its title says so" in note for note in blast.notes)


def test_the_actual_charge_goes_before_the_designed():
    blast = holes("02-design-and-actual-charge/design_and_actual.csv")

    assert blast.charge.tolist() == [82.0, 0.0, 74.0]
    assert blast.charge_per_window() == 82.0


PAIRS = {
    "Charge (kg)": ["Explosive mass (kg)", "Booster (kg)", "Design charge (kg)", "Ladung (kg)"],
    "Delay (ms)": ["Time (ms)", "Surface delay (ms)", "Verzögerung (ms)", "Retard (ms)"],
    "RL": ["Elevation", "Höhe [m]", "Cota (m)"],
    "Easting": ["X (m)", "Rechtswert"],
}


@pytest.mark.parametrize(("title", "other"), [(t, o) for t, each in PAIRS.items() for o in each])
@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
def test_two_columns_that_may_be_one_quantity_are_a_question(tmp_path, title, other, delimiter):
    head, *rows = HOLES.strip().split("\n")
    text = "\n".join([f"{head},{other}", *(f"{row},{7 + n}.5" for n, row in enumerate(rows))])
    path = written(tmp_path, text.replace(",", delimiter))

    with pytest.raises(ReadError, match=r"may both be the .*mapping, \[columns\]") as caught:
        read_blast(path)

    assert title in str(caught.value)
    assert other in str(caught.value)


def test_a_mapping_answers_the_question_and_the_rest_is_recognised(tmp_path):
    path = written(tmp_path, HOLES.replace("Delay (ms)", "Delay (ms),Time (ms)").replace(
        ",0\n", ",0,1\n").replace(",25\n", ",25,40\n"))  # fmt: skip

    blast = read_blast(path, {"columns": {"delay_ms": "Time (ms)"}})

    assert 1e3 * blast.times == pytest.approx([1.0, 40.0])
    assert blast.charge.tolist() == [50.0, 50.0]
    assert blast.hole_ids == ("A1", "A2")


def test_two_columns_with_the_same_values_are_no_question(tmp_path):
    path = written(tmp_path, HOLES.replace("RL", "RL,Elevation (m)").replace(",21,", ",21,21.00,"))

    assert read_blast(path).collar[:, 2].tolist() == [21.0, 21.0]


# 03 thousands and decimal marks


@pytest.mark.parametrize(
    ("cells", "delimiter", "charges"),
    [
        (['"1,250"', '"980"'], ",", [1250.0, 980.0]),
        (['"1,250.5"', '"980"'], ",", [1250.5, 980.0]),
        (["1.250,5", "980"], ";", [1250.5, 980.0]),
        (["1250,5", "980"], "\t", [1250.5, 980.0]),
        (["1 250,5", "980"], ";", [1250.5, 980.0]),
        (["1'250.5", "980"], ";", [1250.5, 980.0]),
        (["1 250", "980"], ";", [1250.0, 980.0]),
        (["1.250", "980,5"], ";", [1250.0, 980.5]),
        (["50 kg", "60,5 kg"], ";", [50.0, 60.5]),
    ],
)
def test_marks_in_numbers_are_judged_over_the_whole_table(tmp_path, cells, delimiter, charges):
    text = HOLES.replace(" (kg)", "") if "kg" in cells[0] else HOLES
    rows = [line.split(",") for line in text.strip().split("\n")]
    for row, cell in zip(rows[1:], cells, strict=True):
        row[4] = cell
    path = written(tmp_path, "\n".join(delimiter.join(row) for row in rows))

    assert read_blast(path).charge.tolist() == charges


@pytest.mark.parametrize("cells", [["1,250", "980"], ["1.250", "980"]])
def test_marks_that_may_be_either_are_a_question_that_a_mapping_answers(tmp_path, cells):
    rows = [line.split(",") for line in HOLES.strip().split("\n")]
    for row, cell in zip(rows[1:], cells, strict=True):
        row[4] = cell
    path = written(tmp_path, "\n".join(";".join(row) for row in rows))
    mark = cells[0][1]

    with pytest.raises(ReadError, match=r"may have a decimal .* give decimal = "):
        read_blast(path)
    assert read_blast(path, {"table": {"decimal": mark}}).charge[0] == 1.25
    other = {",": ".", ".": ","}[mark]
    assert read_blast(path, {"table": {"decimal": other}}).charge[0] == 1250.0


def test_reported_thousands_are_read_or_asked_for():
    assert holes("03-thousands-comma/charges.csv").charge.tolist() == [1250.0, 1250.0, 980.0]
    with pytest.raises(ReadError, match="'5,000' may have a decimal comma"):
        holes("03-thousands-comma/semicolons.csv")


DOORS = {
    "peaks": (read_site_records, "distance_m{0}charge_kg{0}ppv_mm_per_s", [1050, 120, "1{1}9"]),
    "surface": (lambda path: read_lines(path)[0], "x_m{0}y_m{0}z_m", [0, 10, "44{1}5"]),
    "curve": (lambda path: read_time_function(path, "force"), "time_s{0}force_kn", ["0{1}1", 7]),
    "places": (read_geometry, "kind{0}name{0}x_m{0}y_m", ["receiver", 1, "2{1}5", 3]),
    "holes": (read_blast, "id{0}x{0}y{0}z{0}charge_kg{0}delay_s", [1, 2, 3, "4{1}5", 6, "0{1}5"]),
}


@pytest.mark.parametrize("door", DOORS)
@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "latin-1"])
@pytest.mark.parametrize(("delimiter", "mark"), [(",", "."), (";", ","), ("\t", ","), ("\t", ".")])
def test_every_door_reads_every_delimiter_and_encoding(tmp_path, door, encoding, delimiter, mark):
    read, head, row = DOORS[door]

    def table(delimiter, mark):
        cells = [[str(cell).format(delimiter, mark) for cell in row] for _ in range(4)]
        for n, line in enumerate(cells):
            line[0] = f"0{mark}{n}" if door == "curve" else line[0]
        lines = [head.format(delimiter), *map(delimiter.join, cells), "# Prüfung"]
        return "\n".join(lines)

    path = written(tmp_path, table(delimiter, mark), "other.csv", encoding)
    reference = written(tmp_path, table(",", "."), "plain.csv")

    assert numbers(read(path)) == pytest.approx(numbers(read(reference)))


def numbers(result):
    """Flatten what a door returns."""
    if isinstance(result, list):
        return [row[key] for row in result for key in ("x_m", "y_m", "z_m")]
    if hasattr(result, "collar"):
        return [*result.collar.ravel(), *result.charge, *result.times]
    if hasattr(result, "dt"):
        return [result.dt, *result.values]
    return np.ravel(result).tolist()


# 04 to 08: bench height, feet, angles, masses, spreadsheets


def test_a_bench_height_is_not_the_height_of_the_collar():
    blast = holes("04-bench-height/bench_height.csv")

    assert blast.collar[:, 2].tolist() == [210.0, 210.0]
    assert any("not read: Bench height (m)" in note for note in blast.notes)


@pytest.mark.parametrize(
    "words", ["Scaled", "Bench", "Grade", "Stemming", "Subdrill", "Toe burden"]
)
@pytest.mark.parametrize("title", ["Height (m)", "Length (m)", "Charge (kg)", "Time (ms)", "RL"])
def test_a_word_counts_only_if_the_rest_of_the_title_is_known(tmp_path, words, title):
    text = HOLES.replace("Delay (ms)", f"Delay (ms),{words} {title}")
    path = written(tmp_path, text.replace(",0\n", ",0,999\n").replace(",25\n", ",25,999\n"))

    blast = read_blast(path)

    assert 999.0 not in [*blast.collar.ravel(), *blast.charge, *(1e3 * blast.times)]
    assert np.array_equal(blast.collar, blast.toe)


def test_places_without_unit_beside_feet_are_a_question():
    with pytest.raises(ReadError, match=r"'Depth \(ft\)' is in ft, and the unit of Easting"):
        holes("05-feet-beside-pounds/imperial.csv")


def test_feet_and_pounds_with_their_units_are_read(tmp_path):
    text = "Hole,Easting (ft),Northing (ft),Elev (ft),Depth (ft),Charge (lb),Delay (ms)\n"

    blast = read_blast(written(tmp_path, f"{text}1,1500000,620000,700,40,120,0\n"))

    assert blast.collar[0] == pytest.approx([457200.0, 188976.0, 213.36])
    assert (blast.charge[0], blast.length[0]) == pytest.approx((54.4310844, 12.192))


@pytest.mark.parametrize("angle", ["Angle", "Hole angle (deg)", "Hole inclination (°)", "Hole dip"])
def test_an_angle_without_its_datum_is_a_question(tmp_path, angle):
    text = f"Hole,Easting,Northing,RL,Length (m),{angle},Azimuth,Charge (kg),Delay (ms)\n"
    path = written(tmp_path, f"{text}1,5,8,210,12,30,180,70,0\n")

    with pytest.raises(ReadError, match="angle_from"):
        read_blast(path)
    blast = read_blast(path, {"table": {"angle_from": "vertical"}})
    assert blast.toe[0] == pytest.approx([5.0, 2.0, 210.0 - 12.0 * np.cos(np.pi / 6)])


def test_toes_are_read_under_titles_of_two_words():
    blast = holes("06-titles-of-angles-and-toes/collar_toe.csv")

    assert blast.collar[0].tolist() == [5000.0, 8000.0, 210.0]
    assert blast.toe[0].tolist() == [5000.0, 8003.0, 198.0]


def test_masses_never_measured_are_missing_and_not_misfires():
    partly, pattern = (holes(f"07-masses-never-measured/{n}.csv") for n in ("partly", "pattern"))

    assert partly.charge[0] == 62.0
    assert np.isnan([*partly.charge[1:], *pattern.charge]).all()
    assert "charge is missing for 2 holes: 2, 3" in " ".join(partly.checks())


@pytest.mark.parametrize("name", ["total.csv", "total.xlsx"])
def test_a_total_is_no_hole(name):
    blast = holes(f"08-spreadsheet-habits/{name}")

    assert len(set(blast.charge)) == 1
    assert any("a total" in note for note in blast.notes)


@pytest.mark.parametrize("label", ["Total", "Summe", "Somme", "Razem", "Итого", "Grand total", ""])
def test_a_total_is_no_hole_in_any_language(tmp_path, label):
    blast = read_blast(written(tmp_path, f"{HOLES}{label},,,,100,\n"))

    assert blast.charge.tolist() == [50.0, 50.0]


def test_a_row_without_place_that_is_no_total_is_refused(tmp_path):
    with pytest.raises(ReadError, match="line 4: x is missing"):
        read_blast(written(tmp_path, f"{HOLES}A3,,,,70,50\n"))


def test_words_are_no_charge_and_inches_are_read():
    assert holes("08-spreadsheet-habits/explosive.csv").charge.tolist() == [50.0, 50.0]
    assert holes("08-spreadsheet-habits/inches.csv").diameter == pytest.approx([0.1143, 0.1143])


def test_a_formula_without_value_and_numbers_as_text():
    with pytest.raises(ReadError, match=r"cell F2, .* is a formula without a stored value"):
        holes("08-spreadsheet-habits/formula.xlsx")
    blast = holes("08-spreadsheet-habits/text.xlsx")
    assert blast.collar[:, 0].tolist() == [5000.5, 5005.5, 5010.5]
    assert blast.charge.tolist() == [1250.0] * 3


def test_merged_titles_and_cells_are_read_as_they_are_seen(tmp_path):
    rows = [
        ["Hole", "Collar", None, None, "Toe", None, None, "Charge", "Delay"],
        [None, "E", "N", "RL", "E", "N", "RL", "(kg)", "(ms)"],
        [1, 5, 8, 210, 5, 11, 198, 70, 0],
        [2, 9, 8, 210, 9, 11, 198, 75, None],
    ]

    def merge(sheet):
        sheet.merge_cells("B1:D1")
        sheet.merge_cells("E1:G1")
        sheet.merge_cells("I3:I4")

    blast = read_blast(workbook(tmp_path, rows, change=merge))

    assert blast.toe.tolist() == [[5.0, 11.0, 198.0], [9.0, 11.0, 198.0]]
    assert blast.charge.tolist() == [70.0, 75.0]
    assert blast.times.tolist() == [0.0, 0.0]


def test_a_charge_over_merged_cells_is_a_question(tmp_path):
    rows = [line.split(",") for line in HOLES.strip().split("\n")]

    with pytest.raises(ReadError, match="50 stands in merged cells; write the value of each row"):
        read_blast(workbook(tmp_path, rows, change=lambda sheet: sheet.merge_cells("E2:E3")))


# 09 to 13: records


def test_columns_of_two_sensors_are_a_question(tmp_path):
    titles = ["Time (s)", *(f"{c}{n} (mm/s)" for n in (1, 2) for c in "LTV")]
    path = record(tmp_path, titles, columns=np.array([*PEAKS, *(0.5 * PEAKS)]))

    with pytest.raises(ReadError, match=r"'L1 .*'L2 .* may both be the longitudinal"):
        read_recording(path)


@pytest.mark.parametrize("other", ["Geophone 2 (mm/s)", "Up_m_per_s", "Sensor B vert (in/s)"])
def test_a_velocity_that_nothing_names_is_a_question(tmp_path, other):
    titles = ["Time (s)", "Long (mm/s)", "Tran (mm/s)", other]

    with pytest.raises(ReadError, match="are velocities, too"):
        read_recording(record(tmp_path, titles))


@pytest.mark.parametrize("titles", [
    ["Time (s)", "X (mm/s)", "Y (mm/s)", "Z (mm/s)"],
    ["t [s]", "v_x [mm/s]", "v_y [mm/s]", "v_z [mm/s]"],
    ["Time (s)", "Vx (mm/s)", "Vy (mm/s)", "Vz (mm/s)"],
])  # fmt: skip
def test_x_y_and_z_are_read_together_and_said(tmp_path, titles):
    with pytest.warns(PyblastWarning, match="x, y and z are taken as east, north and up"):
        seismogram = read_recording(record(tmp_path, titles))[0].seismogram

    assert seismogram.components == ("east", "north", "vertical")
    assert 1e3 * seismogram.ppv == pytest.approx(PEAKS, rel=0.01)


def test_t_in_millimetres_a_second_is_transverse(tmp_path):
    path = record(tmp_path, ["T (s)", "L (mm/s)", "T (mm/s)", "V (mm/s)"])

    assert 1e3 * quiet(read_recording, path)[0].seismogram.ppv == pytest.approx(PEAKS, rel=0.01)


@pytest.mark.parametrize("rate", [512, 1024, 2048, 4096])
def test_times_rounded_to_milliseconds_are_a_regular_grid(tmp_path, rate):
    times = np.arange(len(TIMES)) / rate
    rows = [f"{t:.3f},{v:.5f}" for t, v in zip(times, PULSE, strict=True)]
    path = written(tmp_path, "\n".join(["Time (s),Vert (mm/s)", *rows]))

    seismogram = quiet(read_recording, path)[0].seismogram

    assert seismogram.dt == pytest.approx(1.0 / rate, rel=2e-4 * rate / 512)


@pytest.mark.parametrize("gap", [2, 5])
def test_a_gap_among_rounded_times_is_named(tmp_path, gap):
    times = np.arange(len(TIMES)) / 1024.0
    times[200:] += gap / 1024.0
    rows = [f"{t:.3f},{v:.5f}" for t, v in zip(times, PULSE, strict=True)]

    with pytest.raises(ReadError, match="line 202: time must grow by equal steps"):
        read_recording(written(tmp_path, "\n".join(["Time (s),Vert (mm/s)", *rows])))


@pytest.mark.parametrize(
    ("day", "noon"), [("", "13:05:"), ("2024-03-05T", "13:05:"), ("", "23:59:")]
)
def test_times_of_day_count_from_the_first_sample(tmp_path, day, noon):
    first = 59.9
    rows = []
    for t, v in zip(TIMES, PULSE, strict=True):
        after = "00:00:" if noon == "23:59:" else "13:06:"
        clock = (noon, first + t) if first + t < 60.0 else (after, first + t - 60.0)
        rows.append(f"{day}{clock[0]}{clock[1]:09.6f},{v:.6f}")
    path = written(tmp_path, "\n".join(["Time,Vert (mm/s)", *rows]))

    read = quiet(read_recording, path)[0]

    assert read.seismogram.start == 0.0
    assert read.seismogram.dt == pytest.approx(1.0 / 1024.0, rel=1e-5)
    assert read.time.startswith(f"{day}{noon}")


# 26: usual titles, bounds, lists without titles at every door


def test_peaks_are_read_under_usual_titles_and_without_those_below_the_trigger():
    titles, semicolons = (
        quiet(read_site_records, REPORTED / f"26-titles-at-every-door/peaks_{name}.csv")
        for name in ("titles", "semicolons")
    )
    assert np.array_equal(titles, semicolons)
    assert titles.ppv[0] == pytest.approx(1.9e-3)
    with pytest.warns(PyblastWarning, match="row 2, only a bound is given"):
        below = read_site_records(REPORTED / "26-titles-at-every-door/peaks_below_trigger.csv")
    assert below.distance.tolist() == titles.distance[1:].tolist()


def test_surfaces_are_read_under_usual_titles_and_without_any(tmp_path):
    folder = REPORTED / "26-titles-at-every-door"
    plain = written(tmp_path, "0 0 44\n0 40 50\n50 0 44\n50 40 50\n", "ground.xyz")

    assert read_lines(folder / "surface_titles.csv")[0].tolist() == read_lines(plain)[0].tolist()
    assert read_lines(folder / "surface_semicolons.csv")[0][2].tolist() == [50.0, 0.0, 44.5]


def test_a_comma_inside_a_number_never_shifts_the_columns(tmp_path):
    path = written(tmp_path, HOLES.replace(",50,25", ",1,250,25"))

    with pytest.raises(ReadError, match="line 3: has 7 cells under 6 titles"):
        read_blast(path)


# what was read


def test_the_log_names_the_column_unit_and_losses_of_every_quantity():
    log = ReadLog()

    read_blast(REPORTED / "02-design-and-actual-charge/design_and_actual.csv", log=log)
    read_blast(REPORTED / "08-spreadsheet-habits/total.csv", log=log)

    actual, total = log.table()
    charge = next(c for c in actual["columns"] if c["quantity"] == "charge")
    assert (charge["source"], charge["unit"], charge["rows"]) == (
        "column 6 'Actual charge (kg)'",
        "kg",
        3,
    )
    assert {"kind": "dropped", "part": "column 5 'Design charge (kg)'",
            "why": "column 6 'Actual charge (kg)' is charge"} in actual["losses"]  # fmt: skip
    assert [loss["part"] for loss in total["losses"]] == ["row 5"]


def test_every_column_of_a_record_is_in_the_log_or_among_its_losses(tmp_path):
    log = ReadLog()
    titles = ["Time (s)", "Long (mm/s)", "Temperature", "Vert (mm/s)"]

    quiet(read_recording, record(tmp_path, titles), log=log)

    (entry,) = log.table()
    named = [c["source"] for c in entry["columns"]] + [loss["part"] for loss in entry["losses"]]
    assert sorted(named) == sorted(f"column {n + 1} {t!r}" for n, t in enumerate(titles))
    assert all(column["rows"] == len(TIMES) for column in entry["columns"])


def test_a_workbook_says_which_rows_are_hidden(tmp_path):
    rows = [line.split(",") for line in HOLES.strip().split("\n")]

    def hide(sheet):
        sheet.row_dimensions[3].hidden = True

    blast = read_blast(workbook(tmp_path, rows, change=hide))

    assert len(blast.charge) == 2
    assert any("1 hidden rows are read, too, the first is row 3" in note for note in blast.notes)


@pytest.mark.parametrize("kind", ["pipe", "device", "large"])
def test_what_is_no_file_to_its_end_is_refused(tmp_path, kind):
    import os

    path = tmp_path / "table.csv"
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "device":
        path.symlink_to("/dev/zero")
    else:
        with path.open("wb") as file:
            file.truncate(200_000_000)

    with pytest.raises((ReadError, InputError), match=r"a pipe or device|holds 200000000 bytes"):
        read_blast(path)
