"""What a user gets told about mistakes that are easily made."""

from dataclasses import replace

import numpy as np
import pytest
from small_project import TEXT, written
from typer.testing import CliRunner

from pyblast.blasts.blast import Blast
from pyblast.cli.commands import app
from pyblast.cli.console import Progress
from pyblast.errors import InputError, ReadError
from pyblast.project.checks import check
from pyblast.project.project import load_project
from pyblast.project.result import cut_short, low_frequencies, read_result
from pyblast.recordings.recording import read_recording
from pyblast.report.maps import write_zones
from pyblast.signals.seismogram import Seismogram
from pyblast.workflows import run

CAVITY = TEXT[TEXT.index("[signature.cavity]") : TEXT.index("[input]")]
RECORDED = (
    (CAVITY, '[signature.recorded]\nfile = "hole.csv"\n'),
    ('"signature.cavity", ', ""),
)
UP = "time_s,east_mm_per_s,north_mm_per_s,vertical_mm_per_s\n"


def rows(*values):
    return "".join(f"{0.001 * n},{text}\n" for n, text in enumerate(values))


def codes(path):
    return {finding.code: finding for finding in check(load_project(path)).findings}


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("snapshots_s = [0.05]", "snapshots_s = [0.5]", "snapshots_s: must lie within duration_s"),
        ("duration_s = 0.1", "duration_s = 0.1\ncompare_band_hz = [30, 3]",
         "run.compare_band_hz: must rise from the lowest to the highest frequency"),
        ("low_pass_hz = 20", 'low_pass_hz = 20\nface = "West"',
         "input.face: must be one of west, east, south, north, bottom, top, got 'West'"),
    ],
)  # fmt: skip
def test_a_refusal_names_the_key_that_is_wrong(tmp_path, old, new, said):
    with pytest.raises(InputError, match=said.replace("[", r"\[")):
        _ = load_project(written(tmp_path, (old, new))).model


def test_a_signature_that_is_not_there_is_refused_with_its_key(tmp_path):
    with pytest.raises(ReadError, match=r"project.toml: signature: .*hole.csv: expected a file"):
        _ = load_project(written(tmp_path, *RECORDED)).input


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ("time_s,east_mm_per_s,north_mm_per_s\n" + rows("1,2", "2,1", "3,0", "0,5"),
         "has no component vertical"),
        (UP + rows(*["2,2,2"] * 5), "never moves"),
    ],
)  # fmt: skip
@pytest.mark.filterwarnings("ignore")
def test_a_signature_that_can_not_enter_is_refused(tmp_path, table, said):
    (tmp_path / "hole.csv").write_text(table)

    with pytest.raises(InputError, match=f"project.toml: signature: .*{said}"):
        _ = load_project(written(tmp_path, *RECORDED)).input


def test_a_step_of_time_is_refused_where_it_is(tmp_path):
    path = tmp_path / "hole.csv"
    path.write_text(UP + rows(*["1,2,3"] * 9) + "0.5,1,2,3\n")

    with pytest.raises(ReadError, match=r"line 11: .*steps of 0.001 s, here it grows by 0.492 s"):
        read_recording(path)


def test_a_record_that_is_not_there_is_missed_by_the_check(tmp_path):
    path = written(tmp_path, ('name = "R1"', 'name = "R1"\nrecorded = { file = "absent.csv" }'))

    with pytest.raises(ReadError, match=r"receivers.R1.recorded: .*absent.csv"):
        check(load_project(path))


def test_a_project_without_receivers_runs(tmp_path):
    first, last = TEXT.index("[[receivers]]"), TEXT.index("[run]")
    path = written(tmp_path, (TEXT[first:last], ""), ("duration_s = 0.1", "duration_s = 0.06"))

    assert (run.run(path).folder / "report.html").exists()


def test_d1_counts_zones_in_the_sponge_only_where_there_are_no_others(tmp_path):
    plain = load_project(written(tmp_path)).model.mean_edges()
    sponge = "[absorbing_layer]\nbox_m = [[-1, 30], [-1, 21], [-1, 31]]\nwidth_m = 30\n[run]"
    model = load_project(
        written(tmp_path, ("[run]", sponge), ("position_m = [55, 10]", "position_m = [25, 10]"))
    ).model
    points = model.mesh.points.copy()
    points[points[:, 0] > 40.0] *= [3.0, 1.0, 1.0]
    model = replace(model, mesh=replace(model.mesh, points=points))

    assert model.mean_edges() == pytest.approx(plain)


@pytest.mark.parametrize(
    ("old", "new", "place"),
    [
        (
            "density_kg_per_m3 = 2660",
            "density_kg_per_m3 = 266",
            "materials.rock.density_kg_per_m3 is 266, usual are 300 to 9000",
        ),
        (
            "kn_gpa_per_m = 0.114",
            "kn_gpa_per_m = 114000000",
            "joints.F1.kn_gpa_per_m is 114000000, usual are 0.0001 to 100000",
        ),
        ("delay_ms = 40", "delay_ms = 0.04", "delays are 0.04 ms and more, as if in seconds"),
        ("delay_ms = 40", "delay_ms = 40000", "as if in microseconds"),
        (
            "diameter_mm = 250",
            "diameter_mm = 250\nexplosive_kg_per_m3 = 0.85",
            "blast.explosive_kg_per_m3 is 0.85, usual are 200 to 2500",
        ),
        (
            "position_m = [-39, 10, 30]",
            "position_m = [-39, 10, 30]\nwave_speed_m_per_s = 3.1",
            "blast.wave_speed_m_per_s is 3.1, usual are 50 to 12000",
        ),
    ],
)
def test_d26_values_in_another_unit(tmp_path, old, new, place):
    assert "D26" not in codes(written(tmp_path))

    finding = codes(written(tmp_path, (old, new)))["D26"]

    assert finding.failed
    assert place in finding.text


def test_a_density_in_tonnes_is_refused_with_its_place_in_the_file(tmp_path):
    path = written(tmp_path, ("density_kg_per_m3 = 2660", "density_kg_per_m3 = 2.66"))

    with pytest.raises(InputError, match=r"materials\.rock: .*2\.66, which looks like t/m3"):
        load_project(path)


def test_d27_holes_in_the_model_that_enter_through_a_face(tmp_path):
    assert "D27" not in codes(written(tmp_path))

    moved = written(tmp_path, ("position_m = [-39, 10, 30]", "position_m = [39, 10, 30]"))

    assert "of 60 holes" in codes(moved)["D27"].text


def test_d30_a_run_that_would_be_refused_for_its_memory(tmp_path, monkeypatch):
    monkeypatch.setattr("pyblast.mesh.quality.available", lambda: 1e8)
    long = written(tmp_path, ("duration_s = 0.1", "duration_s = 1e5"))

    assert codes(long)["D30"].failed


def record(frequency, seconds, fade=0.0):
    times = np.arange(0.0, seconds, 0.001)
    wave = np.sin(2.0 * np.pi * frequency * times) * np.exp(-fade * times)
    return Seismogram(np.outer(wave, [1.0, 0.5, 0.2]), 0.001)


def test_d28_a_record_that_ends_too_early():
    assert cut_short({"quiet": record(20.0, 1.0, 10.0)}) is None
    assert "100 % at loud of its peak" in cut_short({"loud": record(20.0, 1.0)}).text


def test_d29_fewer_cycles_than_two():
    assert low_frequencies({"long": record(20.0, 1.0, 3.0)}) is None
    assert "Hz at short longitudinal" not in low_frequencies({"short": record(2.0, 0.5)}).text
    assert "Hz at short east" in low_frequencies({"short": record(2.0, 0.5)}).text


def test_a_hole_that_misfires_moves_nothing():
    blast = Blast("b", np.zeros((3, 3)), np.zeros((3, 3)), [50.0, 0.0, 50.0], [0.0, 0.02, 0.04])

    assert list(blast.firing().scales) == [1.0, 0.0, 1.0]
    assert list(blast.firing(50.0, 0.0).scales) == [1.0, 0.0, 1.0]
    assert any("charge is 0 for hole 2" in sentence for sentence in blast.checks())


def test_a_result_that_is_not_there_is_named(tmp_path):
    with pytest.raises(ReadError, match="no such file; give the folder of a run"):
        read_result(tmp_path / "result.h5")


def test_progress_after_a_checkpoint_counts_from_there(capsys):
    progress = Progress()
    progress("dynamic", 80, 100)
    progress("dynamic", 95, 100)

    assert "80 %\n" in capsys.readouterr().out


def test_one_end_of_a_band_is_refused():
    shown = CliRunner().invoke(app, ["compare", "a.csv", "b.csv", "--low", "3"])

    assert shown.exit_code == 2
    assert "--low and --high: go together" in shown.output


def test_a_picture_file_that_can_not_be_written_is_named(tmp_path):
    (tmp_path / "zones.vtu").mkdir()

    with pytest.raises(ReadError, match=r"zones.vtu: can't be written"):
        write_zones(tmp_path / "zones.vtu", np.eye(4, 3), np.array([[0, 1, 2, 3]]), {})
    assert [path.name for path in tmp_path.iterdir()] == ["zones.vtu"]
