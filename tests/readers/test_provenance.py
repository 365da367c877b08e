"""Log of what was read."""

import json

from pyblast.readers.provenance import ReadLog


def test_a_log_holds_sources_losses_and_reasons_and_goes_into_json():
    log = ReadLog()
    table = log.file("a/holes.csv", "table with titles")
    table.column("x", "column 2 'East'", "ft", 0.3048, rows=3, why="other lengths are in feet")
    table.dropped("column 4 'Remarks'", "its title is no quantity")
    table.cut("samples 1 to 8", "before the other channels begin")
    table.remark("decimal comma")

    (entry,) = json.loads(json.dumps(log.table()))

    assert entry["file"] == "holes.csv"
    assert entry["columns"][0] == {
        "quantity": "x", "source": "column 2 'East'", "unit": "ft", "factor": 0.3048, "rows": 3,
        "why": "other lengths are in feet",
    }  # fmt: skip
    assert [loss["kind"] for loss in entry["losses"]] == ["dropped", "cut"]
    assert log.lines() == [
        "holes.csv: table with titles",
        "  x: column 2 'East', ft, factor 0.3048, 3 values (other lengths are in feet)",
        "  dropped column 4 'Remarks': its title is no quantity",
        "  cut samples 1 to 8: before the other channels begin",
        "  decimal comma",
    ]


def test_a_file_read_twice_alike_stands_once_and_otherwise_twice():
    log = ReadLog()
    for quantity in ("x", "x", "y"):
        log.file("line.csv").column(quantity, "column 1")

    assert [file["columns"][0]["quantity"] for file in log.table()] == ["x", "y"]
