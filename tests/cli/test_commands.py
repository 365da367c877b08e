import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import pytest
from command_line import call, spawn
from small_project import CARRIED, written

import pyblast
from pyblast.cli.commands import say_warning
from pyblast.errors import EXIT_CODES
from pyblast.project.result import read_result, write_csv, write_result
from pyblast.workflows import result_folder, run

LONG = "grid_cells = [6, 2, 3]", "grid_cells = [30, 10, 15]"


@pytest.fixture(scope="module")
def outcome(tmp_path_factory):
    return run.run(written(tmp_path_factory.mktemp("project")), report=False)


def test_a_run_writes_everything(tmp_path):
    done = call("run", written(tmp_path))

    assert done.exit_code == 3, done.output
    names = {path.name for path in (tmp_path / "results" / "001").iterdir()}
    assert names == {
        "result.h5", "summary.json", "report.html", "report_one_page.html", "compliance.csv",
        "receivers.csv", "findings.csv", "holes.csv", "joints.csv", "tables.xlsx", "curves",
        "zones.vtu", "joint_01.vtu", "model.vtm", "features.geojson",
        "surface_peaks.csv", "surface_peaks.asc",
        "motion_000.vtu", "motion.pvd",
    }  # fmt: skip
    assert "R1: PPV in mm/s longitudinal" in done.output
    assert "D40 FAILS" in done.output


def test_earlier_results_stay(tmp_path):
    path = written(tmp_path)

    folders = [run.run(path, report=False).folder.name for _ in range(2)]

    assert folders == ["001", "002"]


def test_the_same_project_gives_the_same_bits(tmp_path, outcome):
    again = run.run(written(tmp_path), report=False)

    assert np.array_equal(again.seismograms["R1"].velocity, outcome.seismograms["R1"].velocity)
    hashes = [o.result.summary["provenance"]["input_sha256"] for o in (again, outcome)]
    assert hashes[0] == hashes[1]


def test_the_summary_holds_peaks_ledger_seeds_and_hashes(outcome):
    summary = json.loads((outcome.folder / "summary.json").read_text())

    simulated = summary["receivers"]["R1"]["simulated"]
    assert simulated["ppv"] == pytest.approx(outcome.seismograms["R1"].ppv)
    assert summary["run"]["balance_error"] < 0.01
    assert summary["energy"]["input"] > 0.0
    assert summary["seeds"] == {"mesh": 0, "blast": 0}
    assert len(summary["files_sha256"]["project.toml"]) == 64


def test_the_result_file_holds_the_seismograms(outcome):
    found = read_result(outcome.folder / "result.h5").seismogram("simulated", "R1")

    assert np.array_equal(found.velocity, outcome.seismograms["R1"].velocity)
    # Velocities stand between steps; the run begins early by the delay of the low-pass at 20 Hz.
    assert 0.0 < found.start + outcome.result.summary["run"]["lead"] < found.dt


@pytest.mark.parametrize("command", ["run", "check", "mesh", "superpose", "compare", "report"])
def test_every_command_explains_itself(command):
    shown = call(command, "--help")

    assert shown.exit_code == 0
    assert len(shown.output.splitlines()) > 5


@pytest.mark.long
def test_wrong_input_ends_with_one_sentence_and_code_two(tmp_path):
    process = spawn("run", written(tmp_path, ("kn_gpa_per_m = 0.114", "kn_gpa_per_m = -1")))
    _, told = process.communicate(timeout=60)

    assert process.returncode == 2
    assert told == ("pyblast: project.toml: joints.F1.kn_gpa_per_m: must be positive, got -1\n")


def test_a_missing_file_ends_with_code_two(tmp_path):
    assert call("run", tmp_path / "absent.toml").exit_code == 2
    assert call("report", tmp_path / "result.h5").exit_code == 2


def test_wrong_usage_ends_with_code_two():
    assert call("run").exit_code == 2
    assert call("fly").exit_code == 2


def test_a_check_that_fails_ends_with_code_three(tmp_path):
    found = call("check", written(tmp_path), "--page", tmp_path / "check.html")

    assert found.exit_code == 3
    page = (tmp_path / "check.html").read_text(encoding="utf-8")
    assert "does not carry the input" in page[: page.index('class="view"')]
    assert "carries Hz" in found.output
    assert "D1: The mesh of 'soil' does not carry the input" in found.output
    assert "D40 FAILS: The run does not hold the motion of the blast" in found.output
    assert "estimated time" in found.output


def test_a_check_without_failure_ends_with_code_zero(tmp_path):
    assert call("check", written(tmp_path, *CARRIED)).exit_code == 0


def test_the_superposed_motion_is_written_as_a_table(tmp_path):
    shown = call("superpose", written(tmp_path), "--out", tmp_path / "in.csv")

    assert shown.exit_code == 0
    assert "60 holes" in shown.output
    assert (tmp_path / "in.csv").read_text().startswith("time_s,east_m_per_s")


def test_a_record_is_compared_with_a_receiver(tmp_path, outcome):
    result = outcome.folder / "result.h5"
    write_csv(tmp_path / "R1.csv", read_result(result).seismogram("simulated", "R1"))

    found, *_ = run.compare_files(tmp_path / "R1.csv", result)

    assert found.misfit == pytest.approx(0.0, abs=1e-4)
    assert call("compare", tmp_path / "R1.csv", result).exit_code == 0


def test_a_record_in_east_and_north_is_turned_to_the_receiver(tmp_path, outcome):
    result = outcome.folder / "result.h5"
    simulated = read_result(result).seismogram("simulated", "R1")
    write_csv(tmp_path / "R1.csv", simulated.rotated(np.pi / 2.0))

    found, *_ = run.compare_files(tmp_path / "R1.csv", result, "R1", (1.0, 20.0))

    assert found.misfit == pytest.approx(0.0, abs=1e-3)


def test_the_mesh_alone_is_written_for_paraview(tmp_path):
    import meshio

    done = call("mesh", written(tmp_path), "--out", tmp_path / "mesh")

    assert done.exit_code == 0
    found = meshio.read(tmp_path / "mesh" / "zones.vtu")
    assert set(found.cell_data) == {"group", "block", "removable", "f_max"}
    assert len(found.cells_dict["tetra"]) == 216


@pytest.mark.figures
def test_the_report_is_made_from_the_result_file(tmp_path, outcome):
    page = tmp_path / "page.html"

    assert call("report", outcome.folder, "--out", page).exit_code == 0
    assert page.stat().st_size > 50_000


def test_a_model_file_is_written_for_the_program(tmp_path):
    done = call("run", written(tmp_path), "--write-model", tmp_path / "model.h5")

    assert done.exit_code == 0, done.output
    assert (tmp_path / "model.h5").stat().st_size > 10_000
    assert not (tmp_path / "results").exists()


def test_a_check_that_fails_is_accepted_when_asked(tmp_path):
    assert call("run", written(tmp_path), "--accept-findings").exit_code == 0


def test_the_version_is_shown():
    shown = call("--version")

    assert shown.exit_code == 0
    assert shown.output == f"pyblast {pyblast.__version__}\n"


def test_the_help_lists_the_exit_codes():
    shown = " ".join(call("--help").output.split())

    for code, meaning in EXIT_CODES.items():
        assert f"{code} {meaning}" in shown


def test_an_interrupted_run_goes_on_with_the_same_bits(tmp_path, outcome):
    def stop(stage, done, total):
        if stage == "dynamic" and done > 0.4 * total:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt, match="checkpoint written"):
        run.run(written(tmp_path), progress=stop)
    said = []
    resumed = run.run(tmp_path / "project.toml", report=False, say=said.append)

    assert resumed.folder.name == "001"
    assert len(said) == 1
    assert "goes on with the unfinished result" in said[0]
    assert np.array_equal(resumed.seismograms["R1"].velocity, outcome.seismograms["R1"].velocity)
    assert not (resumed.folder / "checkpoint.h5").exists()


def test_an_interrupted_run_of_other_input_and_a_fresh_one_get_new_folders(tmp_path):
    def stop(stage, *_):
        if stage == "dynamic":
            raise KeyboardInterrupt

    path = written(tmp_path)
    with pytest.raises(KeyboardInterrupt, match="checkpoint written"):
        run.run(path, progress=stop)

    assert run.run(path, fresh=True, report=False).folder.name == "002"
    softer = written(tmp_path, ("kn_gpa_per_m = 0.114", "kn_gpa_per_m = 0.1"))
    assert run.run(softer, report=False).folder.name == "003"
    assert run.run(written(tmp_path), report=False).folder.name == "001"


def test_a_result_under_way_is_left_to_its_process(tmp_path):
    with (
        result_folder(tmp_path, lambda _: True) as (first, goes_on),
        result_folder(tmp_path, lambda _: True) as (second, also),
    ):
        assert (first.name, goes_on) == ("001", False)
        assert (second.name, also) == ("002", False)

    with result_folder(tmp_path, lambda _: True) as (latest, goes_on):
        assert (latest.name, goes_on) == ("002", True)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_and_sigterm_leave_a_checkpoint_and_code_130(tmp_path, number):
    path = written(tmp_path, LONG, ("duration_s = 0.1", "duration_s = 60"))
    process = spawn("run", path)
    for line in process.stdout:
        if "time steps" in line:
            break
    time.sleep(0.5)
    process.send_signal(number)
    _, told = process.communicate(timeout=30)

    assert process.returncode == 130
    assert told.startswith("pyblast: interrupted; checkpoint written to")
    assert (tmp_path / "results" / "001" / "checkpoint.h5").exists()


def test_the_summary_says_of_each_receiver_what_is_plausible(outcome):
    summary = json.loads((outcome.folder / "summary.json").read_text())["receivers"]["R1"]

    low, high = summary["plausible_ppv_mm_per_s"]
    assert 0.0 < low < high
    assert len(summary["laws"]) >= 5
    within = low <= 1e3 * max(summary["simulated"]["ppv"]) <= high
    assert summary["implausible"] is not within
    assert summary["charge_distance"]["charge"] == 6750.0


OFF = "[signature.cavity]", "[signature]\nscale = 0.001\n[signature.cavity]"


def test_a_run_whose_level_is_far_off_says_so_in_its_first_lines(tmp_path):
    done = call("run", written(tmp_path, OFF))

    first = done.output.splitlines()[:3]
    assert first[0] == "D36 FAILS: The level is too low for charge and distance"
    assert "mm/s of published laws for 450 kg in 8 ms" in first[1]
    assert done.exit_code == 3
    summary = json.loads((tmp_path / "results" / "001" / "summary.json").read_text())
    assert summary["receivers"]["R1"]["implausible"] is True
    (found,) = (finding for finding in summary["findings"] if finding["code"] == "D36")
    assert "single hole times 0.001" in found["numbers"]
    page = (tmp_path / "results" / "001" / "report.html").read_text(encoding="utf-8")
    assert '<span class="fails">outside</span>' in page
    assert "Oriard 1972" in page


@pytest.mark.long
@pytest.mark.parametrize("command", ["check", "superpose"])
def test_commands_that_run_nothing_name_a_level_far_off(tmp_path, command):
    assert "D36" not in call(command, written(tmp_path)).output
    assert "D36 FAILS: The level is too low" in call(command, written(tmp_path, OFF)).output


def test_superpose_shows_what_published_laws_give(tmp_path):
    shown = call("superpose", written(tmp_path)).output

    assert "single hole: published laws give" in shown
    assert "whole blast at the input: published laws give" in shown


def test_a_record_in_metres_read_as_millimetres_is_named_by_compare(tmp_path, outcome):
    result = outcome.folder / "result.h5"
    record = read_result(result).seismogram("simulated", "R1")
    write_csv(tmp_path / "R1.csv", replace(record, velocity=1e-3 * record.velocity))

    shown = call("compare", tmp_path / "R1.csv", result).output

    assert "D36" in shown
    assert "R1, recorded" in shown


def test_a_result_without_a_plausible_range_is_drawn_and_compared(tmp_path, outcome):
    table = outcome.result.summary["receivers"]["R1"]
    old = {key: table[key] for key in ("position", "azimuth", "simulated", "recorded")}
    summary = outcome.result.summary | {"receivers": {"R1": old}}
    write_result(tmp_path / "result.h5", replace(outcome.result, summary=summary))
    record = read_result(tmp_path / "result.h5").seismogram("simulated", "R1")
    write_csv(tmp_path / "R1.csv", replace(record, velocity=1e-3 * record.velocity))

    assert call("report", tmp_path).exit_code == 0
    assert "D36" not in call("compare", tmp_path / "R1.csv", tmp_path / "result.h5").output


def test_a_console_without_unicode_gets_the_words_spelt_out():
    code = "from pyblast.cli import console; console.say('60° √2 × 3 – 漢')"
    environment = {**os.environ, "PYTHONIOENCODING": "ascii", "PYTHONUTF8": "0"}

    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True
    )

    assert done.stdout == "60 deg sqrt 2 x 3 - ?\n"


@pytest.mark.parametrize(("category", "said"), [(RuntimeWarning, ""), (UserWarning, "note: odd")])
def test_a_warning_of_arithmetic_reaches_no_user(capsys, category, said):
    say_warning(category("odd"), category)

    told = capsys.readouterr().err.strip()
    assert told.endswith(said)
    assert bool(told) == bool(said)
