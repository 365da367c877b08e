"""Columns, moment tensors, pressures and air blasts in a project file, on the small column."""

import numpy as np
import pytest
from small_project import TEXT, written

from pyblast.errors import InputError, PyblastError
from pyblast.model.source import AirBlast, Column, MomentTensor, Pressure
from pyblast.project.checks import check
from pyblast.project.project import load_project
from pyblast.workflows import run

FACE = TEXT[TEXT.index("[signature.cavity]") : TEXT.index("[[receivers]]")]
BLAST = TEXT[TEXT.index("[blast]") : TEXT.index("[signature.cavity]")]
COLUMNS = """
[holes_inside]
detonation_m_per_s = 4500
[holes_inside.charged_hole]
material = "rock"
charge_kg = 16
radius_m = 0.5
pressure_mpa = 100
peak_time_ms = 40
"""
TENSOR = """
[[moment_tensors]]
position_m = [20, 10, 12]
tensor = [1, 2, 3, 4, 5, 6]
file = "history.csv"
"""
PRESSURE = """
[[pressures]]
surface = "west"
file = "history.csv"
start_m = [0, 10, 30]
speed_m_per_s = 500
"""
AIR = """
[air_blast]
pressure_kpa = 20
duration_ms = 30
reference_charge_kg = 50
charge_exponent = 0.5
exponent = 1.2
"""


def loaded(folder, text, head="time_s,pressure_kpa", *changes):
    """Load the small project with a text in place of its signature."""
    rows = [f"{0.001 * k - 0.01:.4f},{k * (40 - k)}" for k in range(41)]
    (folder / "history.csv").write_text("\n".join([head, *rows]))
    few = ("rows = 4", "rows = 2"), ("holes_per_row = 15", "holes_per_row = 2")
    first = (FACE, text), ('"signature.cavity", ', "")
    if text in (COLUMNS, AIR):
        return load_project(
            written(folder, *first, *few, ("[-39, 10, 30]", "[20, 10, 30]"), *changes)
        )
    return load_project(written(folder, *first, (BLAST, ""), *changes))


@pytest.mark.parametrize(("primed", "first"), [("", 1), ('primed_at = "collar"\n', 0)])
def test_a_column_detonates_from_its_primed_end(tmp_path, primed, first):
    text = COLUMNS.replace("= 4500\n", f"= 4500\n{primed}")
    project = loaded(tmp_path, COLUMNS, "", (COLUMNS, text))

    column = project.sources[0]

    assert isinstance(column, Column)
    assert column.detonation_speed == 4500.0
    assert column.primed == pytest.approx(project.blast.columns[0, first])
    assert column.end == pytest.approx(project.blast.columns[0, 1 - first])


def test_a_column_fills_the_length_of_its_charge_above_the_toe(tmp_path):
    blast = loaded(tmp_path, COLUMNS).blast

    lower, upper = blast.columns[:, 1], blast.columns[:, 0]

    assert lower == pytest.approx(blast.toe)
    assert upper[:, 2] - lower[:, 2] == pytest.approx(np.minimum(blast.charge_length, 17.0))
    assert blast.columns.mean(axis=1) == pytest.approx(blast.centres)


def test_a_column_of_dense_explosive_is_shorter(tmp_path):
    depth = "depth_m = 17"
    dense = loaded(tmp_path, COLUMNS, "", (depth, depth + "\nexplosive_kg_per_m3 = 1275")).blast

    assert dense.charge_length == pytest.approx(10.785 / 1.5, rel=1e-3)


def test_a_moment_tensor_is_symmetric_in_the_order_of_stresses(tmp_path):
    project = loaded(tmp_path, TENSOR, "time_s,moment_rate_Nm_per_s")

    (source,) = project.sources

    assert isinstance(source, MomentTensor)
    assert source.tensor.tolist() == [[1.0, 6.0, 5.0], [6.0, 2.0, 4.0], [5.0, 4.0, 3.0]]
    assert source.time + source.moment_rate.start == pytest.approx(0.0)
    assert project.lead == pytest.approx(0.01)


def test_a_pressure_runs_from_its_start_in_pascal(tmp_path):
    (source,) = loaded(tmp_path, PRESSURE).sources

    assert isinstance(source, Pressure)
    assert source.history.values.max() == pytest.approx(400e3)
    assert source.at(np.array([[0.0, 10.0, 5.0]]))[1] == pytest.approx(25.0 / 500.0)


def test_every_hole_sends_its_air_blast_from_its_collar(tmp_path):
    project = loaded(tmp_path, AIR)

    sources = project.sources

    assert [type(s) for s in sources] == 4 * [AirBlast]
    assert np.array([s.position for s in sources]) == pytest.approx(project.blast.collar)
    assert [s.time for s in sources] == pytest.approx([0.0, 0.0, 0.04, 0.04])
    # 20 kPa of 50 kg by the root of the charge
    assert sources[0].history.values[0] == pytest.approx(20e3 * 3.0)
    assert sources[0].history.values[100] == pytest.approx(0.0, abs=1e-9)
    away = sources[0].position + np.array([10.0, 0.0, 0.0])
    assert sources[0].at(away[None])[0] == pytest.approx(10.0**-1.2)


def test_an_air_blast_acts_beside_a_motion_on_a_face(tmp_path):
    project = load_project(written(tmp_path, ("[[receivers]]", f"{AIR}[[receivers]]")))

    assert len(project.model.sources) == 60
    assert project.sources[0].time == pytest.approx(project.lead)


def test_the_report_tells_of_pressures_and_air(tmp_path):
    project = loaded(tmp_path, AIR)

    page = (run.run(project, tmp_path / "out").folder / "report.html").read_text("utf-8")

    assert "air blast over &#39;top&#39; at 340 m/s" in page
    assert "D25" in {finding.code for finding in check(project, False).findings}


REFUSED = [
    ("unknown surface", PRESSURE.replace('"west"', '"roof"'), "",
     "pressures[1].surface: must be one of"),
    ("pressure on a joint", PRESSURE.replace('"west"', '"F1"'), "", "got 'F1'"),
    ("start without speed", PRESSURE.replace("speed_m_per_s = 500\n", ""), "",
     "pressures[1]: start_m and speed_m_per_s go together"),
    ("tensor outside", TENSOR.replace("[20, 10, 12]", "[99, 10, 12]"),
     "time_s,moment_rate_Nm_per_s", "moment_tensors[1].position_m: "),
    ("no tensor", TENSOR.replace("[1, 2, 3, 4, 5, 6]", "[0, 0, 0, 0, 0, 0]"), "",
     "moment_tensors[1]: tensor must not be zero"),
    ("wrong head", PRESSURE, "time_s,force_n", "line 1: missing columns: pressure (pa)"),
    ("air without holes", AIR.replace("50", "51"), "", "air_blast: needs [blast]"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "head", "told"), [row[1:] for row in REFUSED],
                         ids=[row[0] for row in REFUSED])  # fmt: skip
def test_a_source_that_can_not_be_is_refused(tmp_path, text, head, told):
    with pytest.raises(PyblastError) as found:
        _ = loaded(tmp_path, text, head or "time_s,pressure_kpa").model

    assert told in str(found.value)
    assert "\n" not in str(found.value)


HALVES = [
    ("pulse by half", AIR, ("duration_ms = 30\n", ""), "duration_ms is missing beside pressure"),
    ("charge by half", AIR, ("charge_exponent = 0.5\n", ""),
     "air_blast: reference_charge_kg and charge_exponent go together"),
    ("primed nothing", COLUMNS, ("detonation_m_per_s = 4500", 'primed_at = "toe"'),
     "holes_inside: detonation_m_per_s is missing beside primed_at"),
    ("spread column", COLUMNS, ("= 4500", "= 4500\nspread_m = 3"),
     "holes_inside: spread_m and detonation_m_per_s exclude one another"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "change", "told"), [row[1:] for row in HALVES],
                         ids=[row[0] for row in HALVES])  # fmt: skip
def test_half_of_a_source_is_refused(tmp_path, text, change, told):
    with pytest.raises(InputError) as found:
        loaded(tmp_path, text, "time_s,pressure_kpa", change)

    assert told in str(found.value)
