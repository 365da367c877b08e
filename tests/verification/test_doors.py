"""Cases of the suite through project files, and how their table is marked; all: ./dev doors."""

import re
from dataclasses import replace
from datetime import date, timedelta

import numpy as np
import pytest

from pyblast.signals.seismogram import Seismogram
from verification import doors
from verification.page import FAILS, OLD, old
from verification.rows import program, read_rows

ROWS = read_rows(doors.OUT)
WHOLE = {"low_pass_hz": 800.0}  # far above the pulse
MOTION = Seismogram(np.outer(np.hanning(201), [0.01, 0.0, 0.0]), 5e-4)


@pytest.mark.parametrize("name", ["column, P, auto", "linear joint, P, hexahedra"])
def test_a_case_through_a_project_file_is_within_the_error_it_states(name):
    row = doors.measured(name)

    assert row["within_stated"]
    assert row["error"] < 0.02


def accuracy(case, element, folder, **more):
    """Return errors and rows of accuracy of a case with other tables, by receiver."""
    door = doors.DOORS[case]
    door = replace(door, tables={key: door.tables[key] | more.get(key, {})
                                 if isinstance(door.tables[key], dict) else door.tables[key]
                                 for key in door.tables})  # fmt: skip
    project = doors.project_of(door, element, folder)
    return doors.compared(door, project), {row.name: row for row in project.accuracy.rows}


def of_tables(tables, exact, element, folder, **mesh):
    """Return errors and rows of accuracy of a column that its input enters without a low-pass."""
    tables = tables | {"input": tables["input"] | WHOLE, "mesh": tables["mesh"] | mesh}
    door = replace(doors.DOORS["column, P"], tables=tables, exact=exact)
    project = doors.project_of(door, element, folder)
    return doors.compared(door, project), {row.name: row for row in project.accuracy.rows}


@pytest.mark.parametrize("share", [0.2, 0.4, 0.8, 5.0])
def test_what_a_plane_clips_is_stated_and_a_strong_one_clips_nothing(share, tmp_path, monkeypatch):
    strength = share * doors.ZS * doors.AMPLITUDE
    monkeypatch.setattr(doors, "SLIPS", strength)
    joint = doors.SLIDING["joints"]["joint"] | {"cohesion_pa": strength}

    errors, rows = accuracy("Coulomb plane that slips, S", "hexahedra", tmp_path,
                            joints={"joint": joint})  # fmt: skip

    assert errors["0"] <= rows["0"].waveform
    assert (rows["0"].parts["slip"] > 0.0) is (share < 1.0)
    assert share > 1.0 or rows["0"].waveform < 3.0 * errors["0"]


@pytest.mark.parametrize("carried", [50.0, 100.0])
def test_the_overshoot_behind_a_plane_that_slips_is_in_the_stated_peak(
    carried, tmp_path, monkeypatch
):
    """Strength over impedance bounds the motion behind the plane, which a mesh rounds over."""
    monkeypatch.setattr(doors, "CARRIED", carried)
    door = doors.DOORS["Coulomb plane that slips, S"]
    door = replace(door, tables=door.tables | {"input": WHOLE | {"face": "bottom"}})
    project = doors.project_of(door, "hexahedra", tmp_path)

    peak = np.linalg.norm(project.simulate().seismograms["0"].velocity, axis=1).max()
    (row,) = project.accuracy.rows
    above = peak / (doors.SLIPS / doors.ZS) - 1.0

    assert 0.01 < above <= row.peak < 4.0 * above


@pytest.mark.parametrize(
    ("east", "joint", "exact"),
    [("viscous", None, doors.end(0.0)), ("free", None, doors.end(1.0)),
     ("fixed", None, doors.end(-1.0)),
     ("viscous", doors.springs("elastic"), doors.behind(
         lambda omega: doors.joints.through_spring(omega, doors.Z, doors.STIFF)))],
)  # fmt: skip
def test_what_comes_back_is_stated_by_its_own_way(east, joint, exact, tmp_path):
    joined = {} if joint is None else {"joint": joint}
    tables = doors.column(600.0, (11.0, 290.0, 597.0), 0.45, east=east, **joined)

    errors, rows = of_tables(tables, exact, "hexahedra", tmp_path)

    assert all(errors[name] <= row.waveform < 3.0 * errors[name] for name, row in rows.items())


@pytest.mark.parametrize("quality", [20.0, 40.0])
def test_dashpots_of_a_real_impedance_are_stated_beside_ground_of_constant_q(
    quality, tmp_path, monkeypatch
):
    """At entering 1/4Q is wrong, and as much comes back from the viscous end."""
    monkeypatch.setattr(doors, "QUALITY", quality)
    lossy = {"qp": quality, "qs": 0.6 * quality, "quality_band_hz": doors.BAND}
    tables = doors.column(600.0, (10.0, 590.0), quality=lossy)

    errors, rows = of_tables(tables, doors.fading, "hexahedra", tmp_path)

    assert all(errors[name] <= row.waveform < 3.0 * errors[name] for name, row in rows.items())
    assert rows["0"].parts["quality"] == pytest.approx(0.25 / quality, rel=0.3)
    assert rows["1"].parts["sides"] == pytest.approx(0.25 / quality, rel=0.3)


def test_linear_tetrahedra_are_judged_by_the_p_waves_that_enter(tmp_path):
    tables = doors.column(300.0, (150.0,), 0.25)

    errors, rows = of_tables(tables, doors.end(0.0), "tetrahedra", tmp_path, quadratic=False)

    assert errors["0"] <= rows["0"].waveform < 3.0 * errors["0"]


def test_the_lead_of_the_step_is_stated_and_falls_with_its_square(tmp_path):
    case = "column, P, Qp 40 over ten wavelengths"

    errors, rows = accuracy(case, "hexahedra", tmp_path, input=WHOLE)
    _, halved = accuracy(case, "hexahedra", tmp_path, input=WHOLE, run={"step_factor": 0.475})

    assert all(errors[name] <= row.waveform < 3.0 * errors[name] for name, row in rows.items())
    for name, row in rows.items():
        assert row.parts["step"] == pytest.approx(4.0 * halved[name].parts["step"], rel=0.02)


@pytest.mark.parametrize("carried", [25.0, 30.0])
def test_a_soft_layer_repeats_the_delay_of_its_mesh(carried, tmp_path, monkeypatch):
    monkeypatch.setattr(doors, "CARRIED", carried)

    errors, rows = accuracy("layered column, S straight up", "tetrahedra", tmp_path)

    assert errors["0"] <= rows["0"].waveform < 2.0 * errors["0"]


def test_a_pulse_is_delayed_and_turned_by_its_spectrum():
    pulse = doors.Pulse(MOTION, (1.0, 0.0, 0.0))

    late = pulse.passed(-1.0, 0.05)

    assert late == pytest.approx(
        -np.interp(pulse.times - 0.05, pulse.times, pulse.values), abs=1e-9
    )


def test_a_plane_stronger_than_its_wave_lets_it_through_and_a_weaker_one_clips_it(monkeypatch):
    pulse, place = doors.Pulse(MOTION, (1.0, 0.0, 0.0)), (0.0, 0.0, 0.0)
    clipped = doors.slid(pulse, place)
    monkeypatch.setattr(doors, "SLIPS", 1e9)

    assert clipped.max() == pytest.approx(0.4 * doors.AMPLITUDE)
    assert doors.slid(pulse, place)[:, 0] == pytest.approx(pulse.values, abs=1e-2 * doors.AMPLITUDE)


def test_each_mark_of_the_table_follows_from_the_numbers_before_it():
    lines = [line for line in doors.table(ROWS) if line.startswith("| ")][1:]
    cells = re.findall(r"([\d.e+-]+) \(([\d.e+-]+); [\d.]+\) (\S+|<.*?>✗</span>)", "".join(lines))

    assert len(cells) == len(ROWS)
    for error, stated, mark in cells:
        assert mark.startswith("✓") == (float(error) <= float(stated)), (error, stated)
    beyond = sum(not row["within_stated"] for row in ROWS.values())
    assert "".join(lines).count(FAILS) == beyond


def test_every_row_names_what_it_is():
    for name, row in ROWS.items():
        assert f"{row['case']}, {row['element']}" == name
        assert row["within_stated"] == (row["error"] <= row["stated"])
        assert row["within_asked"] == (row["error"] <= row["asked"])
        assert row["element"] in ("auto", row["built"].split()[0])
        assert row["date"]
        assert row["program"]


def test_rows_of_another_program_or_older_than_a_week_are_marked():
    today = date(2026, 3, 9)
    row = {"program": program(), "date": "2026-03-02"}

    assert old(row, today) == ""
    assert old(row, today + timedelta(days=1)) == OLD
    assert old(row | {"program": "other"}, today) == OLD
    assert old({}, today) == OLD
