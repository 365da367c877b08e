"""Best delays from a project file: closed answers, the run they stand for, and mistakes."""

import csv
import json
import re

import numpy as np
import pytest
from command_line import call
from small_project import INSIDE, written

from pyblast import Seismogram, load_project
from pyblast.errors import InputError
from pyblast.project.result import write_csv
from pyblast.report.delays import limits_kept
from pyblast.signals.seismogram import BLAST_AXES
from pyblast.simulation.simulation import in_batches
from pyblast.workflows.delays import house_limits, optimise_delays

ROWS = ("rows = 4\nholes_per_row = 15", "rows = 2\nholes_per_row = 1")
TABLE = """
[delays]
between_holes_ms = [0, 0]
between_rows_ms = [20, 80]
draws = 400
charge_percent = 0
"""
VARIED = TABLE.replace("charge_percent = 0", "charge_percent = 10")
HOUSE = """
[[delays.houses]]
name = "farm"
limit_mm_per_s = 2
recorded = { file = "hole.csv" }
"""


def burst(hz):
    """Return a long burst of one frequency, all components together."""
    t = 2e-3 * np.arange(1000)
    line = 1e-3 * np.sin(np.pi * t / t[-1]) ** 2 * np.sin(2.0 * np.pi * hz * t)
    return Seismogram(np.outer(line, [0.5, 0.3, 1.0]), 2e-3, components=BLAST_AXES)


def planned(folder, table=TABLE, houses=HOUSE, hz=10.0):
    """Write a project of two holes, one a row, with a hole recorded at a house."""
    path = written(folder, ROWS)
    write_csv(folder / "hole.csv", burst(hz))
    path.write_text(path.read_text() + table + houses)
    return path


def test_two_holes_of_one_frequency_are_fired_half_a_period_apart(tmp_path):
    told, folder = optimise_delays(planned(tmp_path))

    assert told["delays_s"]["between_rows"] == pytest.approx(0.05)  # of 10 Hz
    assert [hole["best_s"] for hole in told["firing"]] == pytest.approx([0.0, 0.05])
    # 40 ms as planned: |1 + exp(2 pi i 0.4)| of one hole
    level = told["houses"][0]["before"]["levels"]["0.5"]
    assert level == pytest.approx(1e-3 * abs(1.0 + np.exp(0.8j * np.pi)), rel=0.01)
    # what is left: the slope of the burst, pi / 2 s, over half a period
    left = 0.5 * np.pi * 0.05 / abs(1.0 + np.exp(0.8j * np.pi))
    assert told["severity"]["reduction"] == pytest.approx(1.0 - left, abs=0.005)
    assert json.loads((folder / "delays.json").read_text())["houses"][0]["limit"] == 0.002


def test_waves_that_travel_count_as_delays(tmp_path):
    table = TABLE + "wave_speed_m_per_s = 325\n"  # 20 ms over the burden of 6.5 m
    houses = HOUSE + "position_m = [1e5, 10, 30]\n"

    told, _ = optimise_delays(planned(tmp_path, table, houses))

    moved = told["delays_s"]["between_rows"]
    shift = 1e3 * (moved - 0.05)
    assert abs(shift) == pytest.approx(20.0, abs=1.0)


def test_a_charge_in_8_ms_rules_out_delays(tmp_path):
    table = TABLE.replace("[20, 80]", "[0, 30]") + "max_charge_per_8ms_kg = 500\n"

    told, _ = optimise_delays(planned(tmp_path, table, hz=100.0))  # 5 ms would be half a period

    assert told["delays_s"]["between_rows"] >= 0.008
    assert min(row[1] for row in told["tried"].tolist()) >= 0.008


def test_charges_best_plans_and_firing_times_are_said_before_and_after(tmp_path):
    table = TABLE + "max_charge_per_8ms_kg = 500\n"
    told, folder = optimise_delays(planned(tmp_path, table))

    assert told["charge_per_8ms_kg"] == {"before": 450.0, "after": 450.0, "allowed": 500.0}
    plans = told["best_plans"]
    assert len(plans) == 10
    assert [p["severity"] for p in plans] == sorted(p["severity"] for p in plans)
    assert plans[0]["between_rows_s"] == told["delays_s"]["between_rows"]
    assert {p["charge_per_8ms_kg"] for p in plans} == {450.0}
    for name, last in (("before", 0.04), ("after", 0.05)):
        rows = told["charge_histogram"][name]
        assert sum(charge for _, charge in rows) == 900.0  # every hole once
        assert rows[-1][0] == pytest.approx(last - last % 0.008, abs=1e-9)
    with (folder / "firing_times.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [(r["hole"], r["planned_ms"], r["best_ms"]) for r in rows] == [
        ("1-1", "0", "0"), ("2-1", "40", "50"),
    ]  # fmt: skip
    assert "Charge in 8 ms" in (folder / "report.html").read_text()
    book = pytest.importorskip("openpyxl").load_workbook(folder / "tables.xlsx")
    assert book.sheetnames == ["firing_times", "best_plans", "charge_in_8_ms"]


@pytest.mark.parametrize("command", ["delays", "superpose"])
def test_superposition_needs_no_mesh(tmp_path, command):
    write_csv(tmp_path / "hole.csv", burst(10.0))
    text = planned(tmp_path).read_text()
    blast = text[text.index("[blast]") : text.index("[signature.cavity]")]
    signature = '[signature]\nrecorded = { file = "hole.csv", bearing_deg = 90 }\n'
    parts = {"delays": TABLE + HOUSE, "superpose": signature}
    path = tmp_path / "no_mesh.toml"
    path.write_text('title = "No mesh"\n' + blast + parts[command])

    done = call(command, path)

    assert done.exit_code == 0, done.output
    assert "holes" in done.output
    refused = call("run", path)
    assert refused.exit_code == 2
    assert "mesh, materials, run: missing; add them" in refused.output


def test_holes_inside_shake_a_receiver_as_the_run_of_the_project_does(tmp_path):
    path = tmp_path / "project.toml"
    table = TABLE.replace("[0, 0]", "[5, 15]").replace("[20, 80]", "[0, 0]")
    slow = INSIDE.replace("peak_time_ms = 40", "frequency_hz = 12")
    path.write_text(slow + table + '[[delays.houses]]\nname = "house"\nlimit_mm_per_s = 1\n')

    told, _ = optimise_delays(path)
    run = in_batches([load_project(path)])[0]["house"]

    # rows fire together as planned; half a step between samples of the two
    level = told["houses"][0]["before"]["levels"]["0.9"]
    assert level == pytest.approx(run.ppv.max(), rel=5e-3)
    assert told["houses"][0]["after"]["levels"]["0.9"] < level


def test_a_limit_curve_counts_with_its_lowest_value_in_the_band(tmp_path):
    house = HOUSE.replace("limit_mm_per_s = 2", 'limit_curve = "din_4150_dwelling"')
    path = planned(tmp_path, TABLE + "band_hz = [5, 40]\n", house)

    assert house_limits(load_project(path)) == pytest.approx([5e-3])
    assert "din_4150_dwelling, not verified" in call("delays", path).output


def test_the_command_says_bands_before_and_after(tmp_path):
    done = call("delays", planned(tmp_path, VARIED + "scatter_ms = 2\n"))

    assert done.exit_code == 0, done.output
    assert "0 ms between holes, 50 ms between rows" in done.output
    assert "as planned: 50, 90, 95 % quantiles of PPV" in done.output


def test_the_page_shows_houses_limits_and_the_time_of_each_hole(tmp_path):
    table = TABLE + "scatter_ms = 2\n"

    _, folder = optimise_delays(planned(tmp_path, table, HOUSE.replace("farm", "<farm>")))

    page = (folder / "report.html").read_text()
    firing = page[page.index("<h2>Firing times</h2>") :].partition("</table>")[0]
    rows = re.findall(r"<tr><td>(.*?)</td><td>(.*?)</td><td>(.*?)</td></tr>", firing)
    assert rows == [("1-1", "0", "0"), ("2-1", "40", "50")]
    assert page.count('class="plot"') == 3
    assert "&lt;farm&gt;" in page
    assert "<farm>" not in page


CURVE = HOUSE.replace("limit_mm_per_s = 2", 'limit_curve = "NAME"')
LOW = "band_hz = [0.5, 9]\n"
SILENT = '[[delays.houses]]\nname = "R1"\nlimit_mm_per_s = 1\n'


@pytest.mark.parametrize(
    ("table", "houses", "said"),
    [
        ("", "", "delays: missing; give the bounds of the delays"),
        (TABLE, SILENT, "the motion of each hole there is unknown; record a single hole"),
        (TABLE, SILENT.replace("R1", "farm"), "delays.houses.farm: must be a receiver, which are"),
        (TABLE, HOUSE + SILENT, "houses: 'R1' has no recorded hole"),
        (TABLE, HOUSE + HOUSE, "houses: 'farm' is named twice"),
        (TABLE.replace("[20, 80]", "[80, 20]"), HOUSE, "must be lowest and highest delay"),
        (TABLE + "holes_per_row = 3\n", HOUSE, "2 holes do not make rows of 3"),
        (TABLE + "max_charge_per_8ms_kg = 1\n", HOUSE, "refuses every plan of the first grid"),
        (TABLE + "band_hz = [900, 1000]\n", HOUSE, "low below"),
        (TABLE + "wave_speed_m_per_s = 3000\n", HOUSE, "each house needs position_m"),
        (TABLE, HOUSE.replace("limit_mm_per_s = 2\n", ""), "give one of limit_mm_per_s"),
        (TABLE, HOUSE.replace("hole.csv", "none.csv"), "none.csv"),
        (TABLE, CURVE.replace("NAME", "none"), "limit_curve: must be one of usbm_plaster"),
        (TABLE, CURVE.replace("NAME", "din_4150_dwelling"), "give delays.band_hz"),
        (TABLE + LOW, CURVE.replace("NAME", "din_4150_dwelling"), "has no value below 1 Hz"),
        (TABLE, CURVE.replace("NAME", "sn_640312a_frequent"), "limits the vector sum"),
    ],
)
def test_a_mistake_is_one_sentence_and_exit_code_2(tmp_path, table, houses, said):
    done = call("delays", planned(tmp_path, table, houses))

    assert done.exit_code == 2
    assert said in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1


def test_delays_by_motion_that_the_mesh_does_not_carry_are_refused(tmp_path):
    path, house = (
        tmp_path / "project.toml",
        '[[delays.houses]]\nname = "house"\nlimit_mm_per_s = 1\n',
    )
    fast = INSIDE.replace("peak_time_ms = 40", "frequency_hz = 60")

    for band, words in (("", "the run holds"), ("band_hz = [5, 90]\n", "the mesh carries 2")):
        path.write_text(fast + TABLE + band + house)
        with pytest.raises(InputError, match=words):
            optimise_delays(path)


def test_a_plan_says_first_whether_it_keeps_all_limits_at_95_percent():
    def house(name, high, law=""):
        return {"name": name, "limit": 5e-3, "level_by": law, "after": {"high": high}}

    kept = limits_kept([house("near", 4e-3), house("far", 1e-3)])
    broken = limits_kept([house("near", 9e-3, "AS 2187.2-1993"), house("far", 1e-3)])

    assert kept.startswith("the best plan keeps the limits, nearest at near")
    assert "stay below 4 of 5 mm/s" in kept
    assert broken.startswith("no plan keeps the limit at near")
    assert broken.endswith("9 of 5 mm/s by AS 2187.2-1993")


def test_the_page_says_how_wide_the_band_would_be_if_holes_did_not_vary(tmp_path):
    usual = TABLE.replace("charge_percent = 0\n", "")
    told, folder = optimise_delays(planned(tmp_path, usual + "scatter_ms = 2\n"))
    vary, page = told["variation"], (folder / "report.html").read_text(encoding="utf-8")

    assert vary["charge_percent"] == 20.0
    assert vary["band_90"] > 1.2 * vary["band_90_without"]
    assert "Holes vary by 20 %" in page
    assert "if all holes radiated as their charge says" in page
