"""The command for records without a model: reading, places, analyses, page, refusals."""

import csv
import json
from dataclasses import replace

import numpy as np
import obspy
import pytest
import recorder_files as files
from command_line import call
from line_shots import DT, PLACES, ground, shot, tampered

from pyblast import InputError, analyse_records
from pyblast.line_records.field_records import read_folder, read_geometry
from pyblast.workflows.records import lines_of

HEAD = "kind,name,x_m,y_m\n"
EAST, NORTH = 0.8, 0.6  # direction of the line


def table(path, shots, line=True):
    """Write shots as tables of channels, and the geometry beside them."""
    rows = [f"receiver,{n + 1},{EAST * x + 100},{NORTH * x - 50}" for n, x in enumerate(PLACES)]
    path.mkdir(exist_ok=True)
    for number, one in enumerate(shots):
        names = ",".join(["time_s", *(f"G{n + 1:02d}_V" for n in range(len(PLACES)))])
        values = np.column_stack([one.times, one.motion.T])
        np.savetxt(path / f"shot{number}.csv", values, "%.6e", ",", header=names, comments="")
        x = one.source
        rows.append(f"source,shot{number},{EAST * x + 100},{NORTH * x - 50}")
    places = path.parent / "geometry.csv"
    places.write_text(HEAD + "\n".join(rows if line else rows[len(PLACES) :]) + "\n")
    return places


def test_odd_channels_and_missing_layers_of_a_line_at_an_angle(tmp_path):
    places = table(tmp_path / "records", tampered(ground(), late=6e-3))

    done = call("records", tmp_path / "records", "--geometry", places, "--air-band", 20, 60)

    assert done.exit_code == 0, done.output
    folder = tmp_path / "records_analysis" / "001"
    summary = json.loads((folder / "records.json").read_text())
    odd = summary["analyses"][0]
    assert (odd["analysis"], odd["outcome"], odd["label"]) == (
        "odd channels",
        "NAMED",
        "clock_error",
    )
    assert odd["target"] == [10]
    assert odd["parameters"]["shift"][0] == pytest.approx(6e-3, rel=0.1)
    assert {one["analysis"] for one in summary["not_analysed"]} == {"sensor response"}
    assert "timing error at 10" in done.output
    page = (folder / "report.html").read_text()
    assert page.count("data:image/png") == 2
    assert "timing error" in page


def test_dead_and_clipped_channels_are_listed_and_left_out(tmp_path):
    shots = ground()
    for number, one in enumerate(shots):
        motion = one.motion.copy()
        motion[4] = 0.0
        motion[7] = np.clip(motion[7], *(0.4 * np.abs(motion[7]).max() * np.array([-1, 1])))
        shots[number] = replace(one, motion=motion)
    places = table(tmp_path / "records", shots)

    records, _ = read_folder(tmp_path / "records", places)
    lines, refused = lines_of(records)

    assert refused == []
    assert sorted(set(range(24)) - set(lines[0].shots[0].channels.tolist())) == [4, 7]
    assert records[0].channels[4] == "G05"
    assert records[0].gather.unit == "V"


def test_records_whose_places_are_not_known_are_judged_by_quality_alone(tmp_path):
    table(tmp_path / "records", ground(1))

    summary, _ = analyse_records(tmp_path / "records", tmp_path / "out")

    assert [one["channels"] for one in summary["files"]] == [24, 24]
    reasons = {one["analysis"]: one["reason"] for one in summary["not_analysed"]}
    assert set(reasons) == {"odd channels", "air wave", "layering", "sensor response"}
    assert "places of its receivers are not known; give --geometry" in reasons["air wave"]


def test_a_seismograph_file_shows_whether_its_printed_peaks_agree(tmp_path):
    files.write(tmp_path, files.instantel_ascii(), "right.txt")
    files.write(tmp_path, files.instantel_ascii(changes={"Tran PPV": "19.5 mm/s"}), "wrong.txt")
    files.write(tmp_path, "not a record", "notes.md")
    files.write(tmp_path, b"\x55\x3a" + bytes(40), "broken.sg2")

    summary, _ = analyse_records(tmp_path, tmp_path / "out")

    right, wrong = summary["files"]
    assert right["printed_values_checked"] > 3
    assert right["printed_values_wrong"] == []
    assert [one["name"] for one in wrong["printed_values_wrong"]] == ["transverse PPV"]
    skipped = {row["file"]: row["reason"] for row in summary["skipped"]}
    assert skipped["notes.md"] == "is no record"
    assert "broken.sg2" in skipped


def test_peaks_of_several_records_come_as_tables_with_the_air_overpressure(tmp_path):
    folder = tmp_path / "records"
    folder.mkdir()
    for name, loud in (("one", True), ("two", False)):
        (folder / f"{name}.txt").write_text(files.instantel_ascii(microphone=loud))

    done = call("records", folder)

    assert done.exit_code == 0
    assert "one.txt: PPV in mm/s longitudinal 8 at" in done.output
    assert done.output.count("not analysed: one.txt") == 1  # one line for all that need a line
    results = tmp_path / "records_analysis" / "001"
    with (results / "peaks.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["file"] for row in rows] == ["one.txt"] * 3 + ["two.txt"] * 3
    assert {row["component"]: float(row["ppv_mm_per_s"]) for row in rows} == pytest.approx(
        {"longitudinal": 8.0, "transverse": 12.5, "vertical": 20.0}, rel=1e-3
    )
    pressure = [row["air_overpressure_pa"] for row in rows]
    assert pressure[0] != ""
    assert pressure[3:] == [""] * 3
    book = pytest.importorskip("openpyxl").load_workbook(results / "tables.xlsx")
    assert book["peaks"].max_row == 7


def test_sac_files_of_one_shot_are_joined_and_placed_by_their_headers(tmp_path):
    one = shot(-5.0, 200.0, (10.0, 60.0), 1)
    for n, row in enumerate(one.motion):
        trace = obspy.Trace(row.astype(np.float32), {"delta": DT, "station": f"S{n:02d}"})
        degree = 111_195.0 * np.sqrt(0.5)
        trace.stats.sac = {
            "stla": 45.0, "stlo": 7.0 + 2.0 * n / degree, "evla": 45.0, "evlo": 7.0 - 5.0 / degree
        }  # fmt: skip
        trace.write(str(tmp_path / f"{n:02d}.sac"), format="SAC")

    records, skipped = read_folder(tmp_path)
    lines, _ = lines_of(records)

    assert (len(records), skipped) == (1, [])
    assert lines[0].shots[0].places == pytest.approx(PLACES, abs=0.1)  # degrees in single precision
    assert lines[0].shots[0].source == pytest.approx(-5.0, abs=0.1)


def test_sensors_side_by_side_are_compared(tmp_path):
    rng = np.random.default_rng(2)
    flat = rng.normal(size=(2, 8000))
    f = np.fft.rfftfreq(8000, 1e-4)
    reply = 1.0 / np.abs(1.0 - (f / 800.0) ** 2 + 0.3j * f / 800.0)
    bent = np.fft.irfft(np.fft.rfft(flat) * reply, 8000)
    folder = tmp_path / "records"
    folder.mkdir()
    columns = np.column_stack([1e-4 * np.arange(8000), *flat, *bent])
    np.savetxt(folder / "a.csv", columns, "%.7e", ",", header="time_s,f1,f2,b1,b2", comments="")
    (tmp_path / "places.csv").write_text(
        "kind,name,x_m,y_m,sensor\nreceiver,f1,0,0,laser\nreceiver,f2,5,0,laser\n"
        "receiver,b1,0,0,piezo\nreceiver,b2,5,0,piezo\n"
    )

    summary, _ = analyse_records(
        folder, geometry=tmp_path / "places.csv", sensor_band=(200.0, 3000.0), reference="laser"
    )

    (found,) = summary["analyses"]
    assert (found["outcome"], found["target"]) == ("NAMED", ["piezo"])


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("kind,name,x\n", "line 1: missing columns: y .m."),
        (HEAD + "geophone,1,0,0\n", "line 2, kind: must be receiver or source, got 'geophone'"),
        (HEAD + "receiver,1,0,north\n", "line 2, column 4 .y_m.: expected a number"),
    ],
)
def test_a_wrong_table_of_places_is_refused(tmp_path, text, match):
    (tmp_path / "places.csv").write_text(text)

    with pytest.raises((InputError, OSError), match=match):
        read_geometry(tmp_path / "places.csv")


def test_a_folder_without_records_is_refused_in_one_sentence(tmp_path):
    done = call("records", tmp_path)

    assert done.exit_code == 2
    assert "holds no record that can be read (it is empty)" in done.output


def test_a_real_line_gives_its_air_wave(recordings, tmp_path):
    summary, _ = analyse_records(recordings / "refrapy_ex02", tmp_path)

    (air,) = (one for one in summary["analyses"] if one["analysis"] == "air wave")
    assert air["outcome"] == "NAMED"
    assert air["parameters"]["speed"][0] == pytest.approx(345.0, rel=0.03)
