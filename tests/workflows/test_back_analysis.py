"""Back-analysis from the project file to its page: what is found, told, kept and resumed."""

import json
import math
import signal
import time

import numpy as np
import pytest
from command_line import call, spawn
from inversion_project import twin_file

from pyblast import back_analyse, load_project
from pyblast.back_analysis.findings import annealing_against_random, findings_of_table
from pyblast.back_analysis.search import make_target
from pyblast.back_analysis.trials import evaluate
from pyblast.errors import InputError
from pyblast.workflows.back_analysis import RESULT, TRIALS, findings_before

RANGES = {
    "joints.F1.kn_gpa_per_m": (0.01, 0.5),
    "joints.F1.cohesion_kpa": (90, 1000),
    "damping.ratio": (0.005, 0.05),
}
PAPER = {"method": "paper", "misfit": "paper", "runs": 5}
STRONG = ("cohesion_kpa = 20", "cohesion_kpa = 100"), ("tension_kpa = 0", "tension_kpa = 1e6")


def section(ranges=RANGES, **keys):
    """Return the text of a table ``[back_analysis]``."""
    lines = ["", "[back_analysis]"]
    lines += [f"{key} = {json.dumps(value)}" for key, value in {**PAPER, **keys}.items()]
    for path, (low, high) in ranges.items():
        lines += ["[[back_analysis.parameters]]", f'path = "{path}"']
        lines += [f"low = {low}", f"high = {high}"]
    return "\n".join(lines) + "\n"


def strong(folder, **keys):
    """Write a twin whose joint does not slip."""
    return twin_file(folder, section(**keys), STRONG)


@pytest.mark.long
def test_a_search_is_written_told_and_confirmed_by_a_full_run(tmp_path):
    done = call("backanalyse", strong(tmp_path))

    assert done.exit_code == 0, done.output
    folder = tmp_path / "back_analysis" / "001"
    assert {path.name for path in folder.iterdir()} == {TRIALS, RESULT, "report.html"}
    found = json.loads((folder / RESULT).read_text())
    assert found["runs"] == 5
    assert found["best_misfit"] == min(found["trace"]["misfits"])
    assert found["confirmed_misfit"] == pytest.approx(found["best_misfit"], abs=0.2)
    assert "D10" in done.output
    assert "D14" in done.output
    assert "D15" in done.output


def test_cohesion_is_found_not_identifiable_because_nothing_slipped(tmp_path):
    found, folder = back_analyse(strong(tmp_path, runs=2))

    one = found.confirmed["project.toml"]
    assert found.unidentifiable["joints.F1.cohesion_kpa"].startswith("no contact of 'F1' slipped")
    assert set(found.unidentifiable) == {"joints.F1.cohesion_kpa"}
    assert one.strength["F1"].failed == 0
    assert 1.0 < one.strength["F1"].weakest_factor < one.factor < math.inf
    assert "not identifiable: no contact" in (folder / "report.html").read_text()


def test_cohesion_counts_where_the_joint_slips(tmp_path):
    weak = {**RANGES, "joints.F1.cohesion_kpa": (0, 50)}

    found, _ = back_analyse(twin_file(tmp_path, section(weak, runs=2)))

    assert found.unidentifiable == {}
    assert found.confirmed["project.toml"].strength["F1"].failed > 0


@pytest.mark.long
def test_a_finished_search_is_resumed_for_more_runs(tmp_path):
    path = strong(tmp_path, runs=3)
    short, _ = back_analyse(path)
    path.write_text(path.read_text().replace("runs = 3", "runs = 5"))

    long, folder = back_analyse(path)

    assert folder.name == "001"
    assert np.array_equal(long.trace.points[:3], short.trace.points)
    assert len((folder / TRIALS).read_text().splitlines()) == 6


@pytest.mark.long
def test_least_squares_search_unless_another_method_is_named(tmp_path):
    path = strong(tmp_path)
    path.write_text(path.read_text().replace('method = "paper"\n', ""))

    found, _ = back_analyse(path)

    assert found.method == "levenberg"
    assert found.trace.misfits.min() < found.trace.misfits[0]


@pytest.mark.parametrize("name", ["envelope", "phase", "lag", "onset"])
def test_every_misfit_is_small_where_the_records_were_made(tmp_path, name):
    target = make_target(load_project(strong(tmp_path, misfit=name)))

    truth, other = evaluate(target, np.array([[0.114, 100.0, 0.0112], [0.03, 100.0, 0.05]]))

    assert truth["misfit"] < 0.01
    assert other["misfit"] > 3.0 * truth["misfit"]


@pytest.mark.long
def test_two_blasts_are_met_by_the_same_ground(tmp_path):
    other = tmp_path / "second"
    other.mkdir()
    twin_file(other, "", (*STRONG, ("delay_ms = 40", "delay_ms = 25")))
    path = strong(tmp_path, runs=2, blasts=["second/other.toml"])
    (other / "project.toml").rename(other / "other.toml")

    found, _ = back_analyse(path)

    assert list(found.confirmed) == ["project.toml", "other.toml"]
    rows = [json.loads(line) for line in (path.parent / "back_analysis/001" / TRIALS).open()][1:]
    assert set(rows[0]["simulated"]) == {"project.toml", "other.toml"}


@pytest.mark.long
def test_ctrl_c_keeps_what_was_run_and_the_same_search_goes_on(tmp_path):
    path = strong(tmp_path, runs=60)
    process = spawn("backanalyse", path)
    log = tmp_path / "back_analysis" / "001" / TRIALS
    until = time.monotonic() + 60.0
    while time.monotonic() < until and (not log.exists() or log.read_text().count("\n") < 4):
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=30)
    kept = log.read_text().count("\n") - 1

    assert process.returncode == 130, errors
    assert "evaluations are kept" in errors
    assert 3 <= kept < 60
    path.write_text(path.read_text().replace("runs = 60", f"runs = {kept + 1}"))
    assert call("backanalyse", path).exit_code == 0
    assert log.read_text().count("\n") == kept + 2


@pytest.mark.parametrize(
    ("old", "new", "match"),
    [
        ('method = "paper"', 'method = "guess"', "method: must be one of paper"),
        (
            'method = "paper"\nmisfit = "paper"',
            'misfit = "phase"',
            "'levenberg' needs residuals, and misfit 'phase' has none; take 'random'",
        ),
        ('misfit = "paper"', "misfit = 'eye'", "misfit: must be one of paper"),
        ("[back_analysis]\n", "[back_analysis]\nreceivers = ['R2']\n", "'R2' has no record in"),
        ('path = "damping.ratio"', 'path = "damping.ration"', "did you mean 'damping.ratio'"),
        ("low = 0.005", "low = 0.5", "low must be below high"),
    ],
)
def test_a_wrong_table_is_refused_in_one_sentence(tmp_path, old, new, match):
    path = strong(tmp_path)
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))

    with pytest.raises(InputError, match=match):
        back_analyse(path)


def test_a_project_without_the_table_is_refused_before_its_mesh_is_built(tmp_path):
    project = load_project(twin_file(tmp_path))

    with pytest.raises(InputError, match="back_analysis: missing; add the table"):
        findings_before(project)

    assert not {"ground", "mesh", "model"} & set(vars(project))
    with pytest.raises(InputError, match="back_analysis: missing; add the table"):
        back_analyse(project)


@pytest.mark.long
def test_a_finished_search_is_not_changed_by_the_same_command(tmp_path):
    path = strong(tmp_path, runs=2)

    assert [back_analyse(path)[1].name for _ in range(2)] == ["001", "002"]


def test_a_scheduler_that_does_not_answer_is_refused(tmp_path, monkeypatch):
    pytest.importorskip("distributed", reason="needs pip install pyblast[dask]")
    monkeypatch.setattr("pyblast.runs.parallel.DASK_SECONDS", 0.3)

    done = call("backanalyse", strong(tmp_path), "--dask", "tcp://127.0.0.1:9")

    assert done.exit_code == 2
    assert "no scheduler answers" in done.output


def test_findings_on_the_method_of_the_paper_have_its_numbers(tmp_path):
    found = {one.code: one for one in findings_of_table(load_project(strong(tmp_path, runs=21)))}

    assert list(found) == ["D10", "D40", "D14", "D15"]
    assert found["D10"].numbers == {"numbers": 6.0, "parameters": 3.0}
    wanted = {"10_first": 0.99, "10_last": 0.92, "50_first": 0.95, "50_last": 0.66}
    for name, probability in wanted.items():
        assert found["D14"].numbers[f"accept_{name}"] == pytest.approx(probability, abs=0.005)


def test_random_search_beats_the_annealing_of_the_paper_on_three_parameters():
    found = annealing_against_random(3, 20, repeats=400)

    assert "worse than random" in found.title
    assert found.numbers["random"] == pytest.approx(11.0, abs=1.0)
    assert found.numbers["temperature_of_1000"] == pytest.approx(20.1, abs=1.0)


def test_a_level_far_off_is_named_before_the_search(tmp_path):
    weak = ("[signature.cavity]", "[signature]\nscale = 0.05\n[signature.cavity]")
    plain, off = (
        findings_before(load_project(twin_file(tmp_path, section(), (*STRONG, *change))))
        for change in ((), (weak,))
    )

    assert "D36" not in {finding.code for finding in plain}
    (level,) = (finding for finding in off if finding.code == "D36")
    assert not level.failed
    assert "single hole times 0.05" in level.text
