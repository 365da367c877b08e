import numpy as np
import pytest

from pyblast.blasts.hole_tables import absolute_times, read_blast
from pyblast.errors import ReadError

MINIMUM = "id,x_m,y_m,z_m,x_toe_m,y_toe_m,z_toe_m,charge_kg,delay_ms"
CENTRES = "id,x,y,z,charge_kg,delay_s"
MAPPED = {
    "columns": {
        "id": "Loch",
        "y_m": "Hochwert",
        "x_m": "Rechtswert",
        "z_m": "Höhe",
        "charge_kg": "Ladung",
        "delay_ms": "Zeit",
    },
    "table": {"delimiter": ";", "decimal": ","},
}


@pytest.fixture
def table(tmp_path):
    def write(text, name="holes.csv", encoding="utf-8"):
        path = tmp_path / name
        path.write_bytes(text.encode(encoding))
        return path

    return write


def test_the_minimum_table_is_read_in_si(table):
    rows = "A1,1,2,3,1,2,-8,450,25,250\nA2,4,2,3,4,2,-8,400,50,250\n"
    path = table(f"{MINIMUM},diameter_mm\n{rows}")

    blast = read_blast(path)

    assert blast.hole_ids == ("A1", "A2")
    assert blast.times == pytest.approx([0.025, 0.050])
    assert blast.diameter == pytest.approx([0.25, 0.25])
    assert blast.length == pytest.approx([11.0, 11.0])


def test_two_decks_of_a_hole_are_two_charges(table):
    rows = "A1,0,0,0,0,0,-10,50,0,2,5\nA1,0,0,0,0,0,-10,60,25,6,10\n"
    path = table(f"{MINIMUM},deck_top_m,deck_base_m\n{rows}")

    assert read_blast(path).centres[:, 2] == pytest.approx([-3.5, -8.0])


def test_charge_centres_are_read_with_delays_in_seconds(table):
    rows = "1,49.1,80.1,-11.5,6.4,0.0\n2,49.1,85.5,-12.1,6.3,0.017\n"
    blast = read_blast(table(f"{CENTRES}\n{rows}"))

    assert blast.times == pytest.approx([0.0, 0.017])
    assert np.all(blast.centres == blast.collar)


def test_a_byte_order_mark_blank_lines_and_crlf_do_not_matter(table):
    blast = read_blast(table(f"\ufeff{CENTRES}\r\n\r\n1,1,2,3,4,0.5\r\n"))

    assert blast.times == pytest.approx([0.5])


def test_a_kirra_table_without_header_adds_up_its_ties(table):
    rows = [
        "P,hole,1,0,0,10,0,0,0,165,prod,P:::1,0,red",
        "P,hole,3,8,0,10,8,0,0,165,prod,P:::2,42,red",
        "P,hole,2,4,0,10,4,0,0,165,prod,P:::1,17,red",
    ]

    blast = read_blast(table("\n".join(rows)))

    assert blast.times == pytest.approx([0.0, 0.059, 0.017])
    assert "The charge is missing for 3 holes: 1, 3, 2" in " ".join(blast.checks())


@pytest.mark.parametrize(
    ("row", "n_columns"),
    [
        ("1,5,6,7", 4),
        ("1,5,6,7,5,6,0", 7),
        ("1,5,6,7,5,6,0,165,prod", 9),
        ("1,5,6,7,5,6,0,165,prod,1,9,red", 12),
        ("P,hole,1,5,6,7,5,6,0,165,prod,P:::1,9,red", 14),
        ("P,hole,1,5,6,7,5,6,0,0,0,0,1,1,7,165,prod,P:::1,9,red,0,0,7,0,7,t,88,t,no,t", 30),
    ],
)
def test_kirra_tables_are_known_by_their_number_of_columns(table, row, n_columns):
    blast = read_blast(table(row + "\n"))

    assert f"{n_columns} columns" in blast.notes[0]
    assert blast.collar[0] == pytest.approx([5.0, 6.0, 7.0])
    assert blast.times[0] == pytest.approx(0.009 if n_columns >= 12 else 0.0)


def test_a_table_without_times_says_so(table):
    blast = read_blast(table("1,5,6,7\n2,6,6,7\n"))

    assert "no firing times" in " ".join(blast.checks())


def test_ties_in_a_circle_are_named():
    with pytest.raises(ReadError, match="circle: a <- b"):
        absolute_times(["a", "b"], ["b", "a"], np.array([0.01, 0.01]))


def test_a_tie_to_an_unknown_hole_is_named():
    with pytest.raises(ReadError, match="hole b is tied from z"):
        absolute_times(["a", "b"], ["a", "z"], np.array([0.0, 0.01]))


def test_a_long_chain_of_ties_adds_up():
    names = [str(n) for n in range(5000)]

    times = absolute_times(names, [*names[1:], ""], np.full(5000, 0.001))

    assert times[0] == pytest.approx(5.0)


def test_any_other_table_is_read_through_a_mapping(table):
    path = table("Loch;Rechtswert;Hochwert;Höhe;Ladung;Zeit\n7;1,5;2,5;3;40,5;17\n")

    blast = read_blast(path, MAPPED)

    assert blast.collar[0] == pytest.approx([1.5, 2.5, 3.0])
    assert (blast.charge[0], blast.times[0]) == pytest.approx((40.5, 0.017))


def test_a_mapping_may_come_from_a_toml_file(table):
    mapping = table('[columns]\nx_ft = "X"\ny_ft = "Y"\nz_ft = "Z"\ncharge_lb = "W"\n', "map.toml")

    blast = read_blast(table("X,Y,Z,W\n10,20,30,100\n"), mapping)

    assert blast.collar[0] == pytest.approx([3.048, 6.096, 9.144])
    assert blast.charge[0] == pytest.approx(45.359237)


def test_a_mapping_may_count_columns_and_swap_axes(table):
    mapping = {
        "columns": {"x_m": 1, "y_m": 2, "z_m": 3},
        "table": {"header": False, "axes": "north_east"},
    }

    assert read_blast(table("10,20,30\n"), mapping).collar[0] == pytest.approx([20, 10, 30])


@pytest.mark.parametrize(("datum", "angle"), [("vertical", 30.0), ("horizontal", 60.0)])
@pytest.mark.parametrize("axes", ["east_north", "north_east"])
def test_toes_follow_from_length_bearing_and_the_datum_of_the_angle(table, datum, angle, axes):
    columns = {
        "x_m": "X",
        "y_m": "Y",
        "z_m": "Z",
        "length_m": "L",
        "inclination_deg": "A",
        "bearing_deg": "B",
    }
    mapping = {"columns": columns, "table": {"angle_from": datum, "axes": axes}}

    blast = read_blast(table(f"X,Y,Z,L,A,B\n0,0,0,10,{angle},90\n"), mapping)

    assert blast.toe[0] == pytest.approx([5.0, 0.0, -10 * np.cos(np.pi / 6)], abs=1e-12)


def test_an_angle_without_datum_is_refused(table):
    mapping = {
        "columns": {"x_m": "X", "y_m": "Y", "z_m": "Z", "length_m": "L", "inclination_deg": "A"}
    }

    with pytest.raises(ReadError, match="angle_from"):
        read_blast(table("X,Y,Z,L,A\n0,0,0,10,15\n"), mapping)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("\n", "empty"),
        ("a,b\n1,2\n", "no known hole table; give a mapping"),
        (f"{CENTRES}\n", "a header but no rows"),
        (f"{CENTRES}\n1,2,3,4,5\n", r"line 2, column 6 \(delay\): the line has only 5 columns"),
        (f"{CENTRES}\n1,2,x,4,5,6\n", r"line 2, column 3 \(y_m\): expected a number, got 'x'"),
        (f"{CENTRES}\n1,2,1e999,4,5,6\n", "expected a finite number, got '1e999'"),
        (f"{CENTRES}\n1,2,1_0,4,5,6\n", "expected a number, got '1_0'"),
        (f"{CENTRES}\n1,2,,4,5,6\n", "line 2: y is missing"),
        (f"{CENTRES}\n1,2,3,4,5,-6\n", "must not be negative"),
        (f"{CENTRES}\n1,2,3,4,-5,6\n", "charge: must be >= 0 kg"),
        (f"{CENTRES}\n1,2,3,4,5,6\n2,2,3,4,5,na\n", "no firing time for 1 holes: 2"),
        (f"{CENTRES}\n1,2\x00,3,4,5,6\n", "line 2: expected text, found a NUL byte"),
        ("Hole ID,StartX,StartY,StartZ,EndX,Time\n1,2,3,4,5,6\n", "a toe needs x, y and z"),
        ("P,hole,1,0,0,1,0,0,0,165,prod,P:::9,0,red\n", "tied from P:::9"),
        (f"{CENTRES}\n" + "1" * 200_000 + ",2,3,4,5,6\n", "line 2: has 200010 characters"),
    ],
)
def test_a_broken_table_is_refused_with_file_and_place(table, text, message):
    with pytest.raises(ReadError, match=rf"^holes.csv.*{message}"):
        read_blast(table(text))


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "latin-1"])
def test_a_table_is_read_in_the_encodings_of_spreadsheets(table, encoding):
    blast = read_blast(table(f"{CENTRES}\nGänge 1,2,3,4,5,6\n", encoding=encoding))

    assert blast.hole_ids == ("Gänge 1",)


@pytest.mark.parametrize(("content", "message"), [
    (b"PK\x03\x04\x14\0", "is a zip archive or a damaged Excel workbook; unpack it .*save the"),
    (b"\xd0\xcf\x11\xe0\xa1", "is an Excel workbook or document of the old kind; save it as .xlsx"),
    (b"\x55\x3a\x01\0", "is SEG2 .a gather of SEG-2.; export the table as CSV"),
])  # fmt: skip
def test_another_kind_of_file_is_named_with_the_remedy(tmp_path, content, message):
    (tmp_path / "holes.csv").write_bytes(content + bytes(40))

    with pytest.raises(ReadError, match=message):
        read_blast(tmp_path / "holes.csv")


def test_an_absent_file_is_refused(tmp_path):
    with pytest.raises(ReadError, match="expected a file, found none"):
        read_blast(tmp_path / "nothing.csv")


@pytest.mark.parametrize(
    ("mapping", "message"),
    [
        ({}, r"needs a table \[columns\]"),
        ({"columns": {"x_m": "X"}, "colums": {}}, "unknown colums"),
        ({"columns": {"x": "X", "y_m": "Y", "z_m": "Z"}}, "columns.x is no quantity"),
        ({"columns": {"x_kg": "X", "y_m": "Y", "z_m": "Z"}}, "columns.x_kg is no quantity"),
        ({"columns": {"x_m": "X", "y_m": "Y", "id": "Z"}}, r"missing columns: z \(m\)"),
        ({"columns": {"x_m": "X", "y_m": "Y", "z_m": "Q"}}, "asks for column 'Q'"),
        ({"columns": {"x_m": 1, "y_m": 2, "z_m": 9}}, "asks for column 9"),
        ({"columns": {"x_m": "X"}, "table": {"decimal": "x"}}, "table.decimal can't be 'x'"),
        ("absent.toml", "absent.toml: expected a file, found none"),
    ],
)
def test_a_wrong_mapping_is_refused(table, mapping, message):
    with pytest.raises(ReadError, match=message):
        read_blast(table("X,Y,Z\n1,2,3\n"), mapping)


def test_a_real_kirra_export_times_its_holes_as_kirra_does(recordings):
    path = recordings / "blast_plans" / "KAB_BLAST_ALLCOL.csv"

    blast = read_blast(path)

    printed = [float(line.split(",")[-1]) for line in path.read_text("utf-8-sig").splitlines()[1:]]
    assert blast.times == pytest.approx(np.array(printed) / 1e3, abs=1e-9)


@pytest.mark.parametrize(
    ("name", "n_holes", "charge", "last", "window"),
    [
        ("KAB_BLAST_ALLCOL.csv", 410, 41321.0, 1.641, 542.0),
        ("blastlogic_kirra_S4_226_401.csv", 404, 135590.0, 2.546, 4263.0),
        ("blastlogic_kirra_S4_226_414P.csv", 54, 567.0, 0.0, 567.0),
    ],
)
def test_real_plans_are_recognised(recordings, name, n_holes, charge, last, window):
    blast = read_blast(recordings / "blast_plans" / name)

    assert len(blast.times) == n_holes
    assert np.sum(blast.charge) == pytest.approx(charge, abs=0.5)
    assert blast.times.max() == pytest.approx(last)
    assert blast.charge_per_window() == pytest.approx(window, abs=0.5)


def test_real_plans_state_their_angles_from_the_vertical(recordings):
    blast = read_blast(recordings / "blast_plans" / "blastlogic_kirra_S4_226_414P.csv")

    assert not any("angle" in sentence for sentence in blast.checks())


def test_hole_tables_of_the_simulated_cases_are_read(cases):
    blast = read_blast(cases / "case-10" / "B2_holes.csv")

    assert len(blast.times) == 9
    assert blast.times.max() == pytest.approx(0.2)
