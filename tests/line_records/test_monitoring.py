"""Records joined to the blasts of a log: by place, time and names, and why some are not."""

import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import openpyxl
import pytest

from pyblast.errors import InputError, ReadError
from pyblast.line_records.monitoring import (
    LoggedBlast,
    RecordPeaks,
    Station,
    features_of,
    joined,
    read_log,
    read_peaks,
    read_stations_of,
)

ROOT = Path(__file__).parents[2]
STATIONS = [
    Station("farm", "BE1", (0.0, 0.0, 0.0), 5e-4),
    Station("mill", "", (9.0, 0.0, 0.0), np.nan),
]


def blast(name, time):
    return LoggedBlast(name, time, (100.0, 0.0, 0.0), 50.0, {})


def record(file, time, serial="BE1", pvs=0.001):
    return RecordPeaks(file, serial, time, "text", ("vertical",), (pvs,), (10.0,), pvs,
                       np.nan, (np.nan,) * 6)  # fmt: skip


LOG = [blast("B1", "2026-03-02T11:00:00"), blast("B2", "2026-03-09T11:00:00"),
       blast("B3", "2026-03-16T11:00:00"), blast("B4", "2026-03-23T11:00:00")]  # fmt: skip


def test_records_join_by_serial_number_or_name_and_the_nearest_time():
    records = [record("a.csv", "2026-03-09T11:03:00"),
               record("mill_7.csv", "2026-03-02T10:52:00", ""),
               record("mill/x.csv", "2026-03-23T11:00:01", "other")]  # fmt: skip

    found = joined(LOG, STATIONS, records)

    assert {key: row.file for key, row in found.records.items()} == {
        (1, 0): "a.csv", (0, 1): "mill_7.csv", (3, 1): "mill/x.csv"
    }  # fmt: skip
    assert not found.unjoined
    assert found.distance[0].tolist() == [100.0, 91.0]


def test_a_record_joins_by_the_coordinates_of_its_header(tmp_path):
    text = (ROOT / "examples" / "site" / "quarry" / "records" / "farm_01.csv").read_text()
    head, rest = text.split('"Event Time"')
    records = []
    for name, latitude in (("near", "51.50031"), ("far", "51.512"), ("none", "0.0")):
        lines = (
            f'"Latitude","{latitude}"\n"Longitude","{"-0.1200" if latitude[0] == "5" else "0.0"}"\n'
        )
        path = tmp_path / f"{name}.csv"
        path.write_text(head.replace("BE4711", "X1") + lines + '"Event Time"' + rest)
        records += read_peaks(path, path.name)
    table = tmp_path / "stations.csv"
    table.write_text(
        "name,x (m),y (m),latitude,longitude\nfarm,0,0,51.5,-0.12\nmill,9,9,51.49,-0.12\n"
    )
    log = [blast("B1", records[0].time)]

    result = joined(log, read_stations_of(table), records)

    assert {key: row.file for key, row in result.records.items()} == {(0, 0): "near.csv"}
    assert [file for file, _ in result.unjoined] == ["far.csv", "none.csv"]


def test_a_record_that_belongs_to_no_blast_says_why():
    log = [*LOG, blast("B5", "2026-03-23T11:00:30")]
    records = [record("night.csv", "2026-03-09T23:10:00"), record("who.csv", LOG[0].time, "BE9"),
               record("both.csv", "2026-03-23T11:00:10"), record("blank.csv", "")]  # fmt: skip

    reasons = dict(joined(log, STATIONS, records).unjoined)

    assert "within 15 min; the nearest is B2, 2026-03-09T11:00:00" in reasons["night.csv"]
    assert "'BE9', and its path names none of the stations farm, mill" in reasons["who.csv"]
    assert "B4 and B5 fit alike; log their times" in reasons["both.csv"]
    assert reasons["blank.csv"] == "has no time, and its path does not name one blast of the log"


def test_a_record_without_a_time_joins_by_the_blast_that_its_path_names():
    found = joined(LOG, STATIONS, [record("B3/farm.csv", ""), record("b2_mill.csv", "", "")])

    assert sorted(found.records) == [(1, 1), (2, 0)]


@pytest.mark.parametrize("hours", [2, -5])
def test_a_clock_in_another_time_zone_is_found_and_one_stray_hour_is_not(hours):
    late = [record(f"{n}.csv", f"2026-03-{day:02d}T{11 + hours:02d}:01:00")
            for n, day in enumerate((2, 9, 16))]  # fmt: skip

    found = joined(LOG, STATIONS, [*late, record("x.csv", "2026-03-23T14:00:00")])

    assert sorted(found.records) == [(0, 0), (1, 0), (2, 0)]
    assert found.clocks == {"farm": {hours: 3}}
    assert [file for file, _ in found.unjoined] == ["x.csv"]


def test_a_clock_without_summer_time_joins_in_both_seasons():
    log = [blast(f"B{n}", f"2026-{month:02d}-11T11:00:00") for n, month in enumerate(range(1, 11))]
    records = [record(f"{n}.csv", f"2026-{month:02d}-11T{11 - (month in range(4, 10))}:02:00")
               for n, month in enumerate(range(1, 11))]  # fmt: skip

    found = joined(log, STATIONS, records)

    assert len(found.records) == 10
    assert found.clocks == {"farm": {-1: 6}}


def test_times_are_those_of_the_clock_in_any_time_zone(monkeypatch):
    log = [blast("B1", "2026-03-29T01:50:00"), blast("B2", "2026-03-29T02:40:00")]
    for zone in ("UTC", "Europe/Berlin"):  # there 02:40 did not exist
        monkeypatch.setenv("TZ", zone)
        time.tzset()
        found = joined(log, STATIONS, [record("a.csv", "2026-03-29T02:41:00")])
        assert sorted(found.records) == [(1, 0)]
    monkeypatch.undo()
    time.tzset()


def test_of_two_records_of_one_blast_the_stronger_counts():
    weak, strong = record("w.csv", LOG[0].time), record("s.csv", LOG[0].time, pvs=0.004)

    for pair in ([weak, strong], [strong, weak]):
        found = joined(LOG, STATIONS, pair)
        assert found.records[0, 0].file == "s.csv"
        assert found.unjoined == [("w.csv", "is weaker than s.csv of the same blast")]
    again = joined(LOG, STATIONS, [strong, replace(strong, file="copy.csv")])
    assert again.unjoined == [("s.csv", "repeats copy.csv of the same blast")]


def test_a_station_is_silent_between_its_records_alone():
    found = joined(LOG, STATIONS, [record("1.csv", LOG[1].time), record("3.csv", LOG[3].time)])

    assert np.argwhere(found.silent).tolist() == [[2, 0]]


def test_a_turned_sensor_turns_the_polarization_twice_as_far_and_a_gain_shifts_the_levels():
    wave = np.random.default_rng(3).normal(size=(400, 3)) * [2.0, 0.5, 1.0]
    plain = features_of(wave, 1e-3)
    turn = np.radians(20.0)
    turned = wave.copy()
    turned[:, 0] = np.cos(turn) * wave[:, 0] - np.sin(turn) * wave[:, 1]
    turned[:, 1] = np.sin(turn) * wave[:, 0] + np.cos(turn) * wave[:, 1]

    along, across = features_of(turned, 1e-3)[2:4]
    assert along + 1j * across == pytest.approx((plain[2] + 1j * plain[3]) * np.exp(2j * turn))
    assert features_of(0.1 * wave, 1e-3) - plain == pytest.approx([-1, -1, 0, 0, 0, 0], abs=1e-9)
    assert np.isnan(features_of(0.0 * wave, 1e-3)).all()


def test_a_log_is_read_from_text_and_workbook_alike(tmp_path):
    text, book = tmp_path / "blasts.csv", openpyxl.Workbook()
    text.write_text("Blast;Datum;Uhrzeit;x (m);y (m);Charge per delay (lb);Bench\n"
                    "S2;09.03.2026;11:00;10;20;100;north\nS1;02.03.2026;;1;2;;\n")  # fmt: skip
    from datetime import datetime

    for row in (["blast", "date", "x (m)", "y (m)", "charge (kg)", "bench"],
                ["S1", datetime(2026, 3, 2), 1, 2, None, None],
                ["S2", datetime(2026, 3, 9, 11, 0), 10, 20, 45.359237, "north"]):  # fmt: skip
        book.active.append(row)
    book.save(tmp_path / "blasts.xlsx")

    for path in (text, tmp_path / "blasts.xlsx"):
        first, second = read_log(path)
        assert (first.name, first.time[:10], second.time) == (
            "S1",
            "2026-03-02",
            "2026-03-09T11:00:00",
        )
        assert np.isnan(first.charge)
        assert second.charge == pytest.approx(45.359237)
        assert second.position == (10.0, 20.0, 0.0)
        assert second.practice["bench"] == "north"


def test_charge_and_place_come_from_a_hole_table_that_the_log_names(tmp_path):
    (tmp_path / "holes.csv").write_text(
        "hole,x_m,y_m,z_m,charge_kg,delay_ms\n1,0,0,0,40,0\n2,4,0,0,30,5\n3,8,0,0,20,30\n"
    )
    (tmp_path / "blasts.csv").write_text("blast,date,time,holes\nS1,2026-03-02,11:00,holes.csv\n")

    (blast,) = read_log(tmp_path / "blasts.csv")

    assert blast.charge == 70.0
    assert blast.position[0] == pytest.approx(4.0)


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("2026-03-09 11:02", "2026-03-09T11:02:00"),
        ("2026-03-09T11:02:07.5+01:00", "2026-03-09T11:02:07.500000"),
        ("9.3.2026 11.02", "2026-03-09T11:02:00"),
        ("09-Mar-2026 1:02 PM", "2026-03-09T13:02:00"),
        ("9 March 2026 12:02am", "2026-03-09T00:02:00"),
        ("2026/3/9", "2026-03-09"),
    ],
)
def test_dates_are_read_as_logs_write_them(tmp_path, text, wanted):
    path = tmp_path / "blasts.csv"
    path.write_text(f"blast,date,x (m),y (m),charge (kg)\nS1,{text},1,2,10\n")

    assert read_log(path)[0].time == wanted


def test_dates_with_slashes_are_read_where_one_of_them_tells_their_order(tmp_path):
    path = tmp_path / "blasts.csv"
    head = "blast,date,x (m),y (m),charge (kg)\n"
    path.write_text(f"{head}S1,03/04/2026 11:00,1,2,10\nS2,25/04/2026 11:00,1,2,10\n")
    assert [blast.time[:10] for blast in read_log(path)] == ["2026-04-03", "2026-04-25"]
    path.write_text(f"{head}S1,03/04/2026 11:00,1,2,10\nS2,04/25/2026 11:00,1,2,10\n")
    assert [blast.time[:10] for blast in read_log(path)] == ["2026-03-04", "2026-04-25"]
    path.write_text(f"{head}S1,03/04/2026 11:00,1,2,10\nS2,05/04/2026 11:00,1,2,10\n")
    with pytest.raises(ReadError, match=r"line 2, date: .*whether day or month comes first"):
        read_log(path)
    path.write_text(f"{head}S1,13/04/2026,1,2,10\nS2,05/14/2026,1,2,10\nS3,03/04/2026,1,2,3\n")
    with pytest.raises(ReadError, match=r"line 2, date: .*dates of the log stand in both orders"):
        read_log(path)


def test_a_hole_table_that_is_missing_is_named_with_its_line(tmp_path):
    path = tmp_path / "blasts.csv"
    path.write_text("blast,date,holes\nS1,2026-03-02,none.csv\n")

    with pytest.raises(ReadError, match=r"line 2, holes: .*none\.csv: expected a file"):
        read_log(path)


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ("S1,2026-03-02 25:00,1,2,10", "line 2, date: expected one such as"),
        ("S1,2026-03-02,1,2,10\nS1,2026-03-03,1,2,10", "blast 'S1' stands in two lines"),
        ("S1,soon,1,2,10", "line 2, date: expected one such as 2026-03-14 11:02, got 'soon'"),
        ("S1,2026-03-02,1,2,-10", "line 2, charge: must be positive, got -10"),
    ],
)
def test_a_log_that_can_not_be_used_is_refused(tmp_path, rows, message):
    path = tmp_path / "blasts.csv"
    path.write_text(f"blast,date,x (m),y (m),charge (kg)\n{rows}\n")

    with pytest.raises((ReadError, InputError), match=message):
        read_log(path)


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ("farm,BE1,0,0\nfarm,BE2,1,1", "station 'farm' stands in two lines"),
        ("farm,BE1,0,0\nmill,BE1,1,1", "serial 'BE1' stands in two lines"),
        ("farm,BE1,,0\nmill,BE2,1,1", "line 2: a station needs its name, x and y"),
    ],
)
def test_stations_that_can_not_be_used_are_refused(tmp_path, rows, message):
    path = tmp_path / "stations.csv"
    path.write_text(f"name,serial,x (m),y (m)\n{rows}\n")

    with pytest.raises((ReadError, InputError), match=message):
        read_stations_of(path)
