"""Evaluations of a search: logged, resumed to the same trace, the same over every executor."""

import json
import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from inversion_project import PARAMETERS, target, twin_file

from pyblast.back_analysis import trials
from pyblast.back_analysis.parameters import common_time_step
from pyblast.back_analysis.trials import TrialLog, Trials, identity
from pyblast.errors import InputError, ReadError, SolverError
from pyblast.inference.gauss_newton import levenberg_search
from pyblast.inference.global_search import paper
from pyblast.inference.parameter import Parameter
from pyblast.project.project import load_project
from pyblast.runs.parallel import workers
from pyblast.simulation import simulation

TRUTH = np.array([[0.114, 0.025, 0.0112]])


@pytest.fixture(scope="module")
def twin(tmp_path_factory):
    return target(load_project(twin_file(tmp_path_factory.mktemp("twin"))))


def searched(target_, path, *, resume=False, budget=6, **options):
    """Anneal a twin with a log; return its trace."""
    log = TrialLog(path, identity(target_, "paper", 1), resume)
    return paper(Trials(target_, log, budget, **options).problem(), budget, 1)


def misfits_of(target_, points, path, **options):
    log = TrialLog(path, identity(target_, "paper", 1))
    return Trials(target_, log, len(points), **options)(points)


def points_of(target_, count):
    unit = np.random.default_rng(2).random((count, len(target_.parameters)))
    return Trials(target_, None, count).problem().points(unit)


def test_the_misfit_is_zero_where_the_records_were_made(twin):
    found, other = (trials.evaluate(twin, scale * TRUTH)[0]["misfit"] for scale in (1.0, 1.5))

    assert found < 0.1  # %: the step held for the ranges is not that of the record
    assert other > 1.0


def test_a_point_has_one_misfit_whatever_marches_beside_it(twin):
    points = points_of(twin, 8)

    full = [row["misfit"] for row in trials.evaluate(twin, points)]
    pair = [row["misfit"] for row in trials.evaluate(twin, points[[3, 6]])]

    assert pair == [full[3], full[6]]
    assert trials.evaluate(twin, points[3:4])[0]["misfit"] == pytest.approx(full[3], rel=1e-6)


def test_a_search_that_was_killed_and_resumed_has_the_same_trace_and_log(twin, tmp_path):
    whole = searched(twin, tmp_path / "whole.jsonl")
    lines = (tmp_path / "whole.jsonl").read_text().splitlines(keepends=True)
    cut = tmp_path / "cut.jsonl"
    cut.write_text("".join(lines[:4]) + lines[4][:25])

    again = searched(twin, cut, resume=True)

    assert np.array_equal(again.misfits, whole.misfits)
    assert np.array_equal(again.points, whole.points)
    kept = [json.loads(line) for line in cut.read_text().splitlines()]
    wanted = [json.loads(line) for line in lines]
    for row in [*kept, *wanted]:
        row.pop("wall_seconds", None)
    assert kept == wanted


def by_least_squares(target_, path, resume=False):
    log = TrialLog(path, identity(target_, "levenberg", 1), resume)
    return levenberg_search(Trials(target_, log, 13).problem(), 13, 1)


def test_least_squares_goes_down_in_13_runs_and_is_resumed_to_the_same_trace(twin, tmp_path):
    whole = by_least_squares(twin, tmp_path / "whole.jsonl")
    lines = (tmp_path / "whole.jsonl").read_text().splitlines(keepends=True)
    (tmp_path / "cut.jsonl").write_text("".join(lines[:7]))

    again = by_least_squares(twin, tmp_path / "cut.jsonl", resume=True)

    assert whole.misfits.min() < 0.4 * whole.misfits[0]
    assert np.array_equal(again.points, whole.points)
    assert np.array_equal(again.misfits, whole.misfits)


def test_residuals_of_a_model_that_can_not_be_run_are_infinite(twin, tmp_path, monkeypatch):
    run_many = simulation.run_many

    def fails(models, duration, *, step=None):
        if models[0].damping.ratio > 0.03:
            raise SolverError("the motion grew")
        return run_many(models, duration, step=step)

    monkeypatch.setattr(simulation, "run_many", fails)
    log = TrialLog(tmp_path / "log.jsonl", identity(twin, "paper", 1))

    _, residuals = Trials(twin, log, 2).vectors([[0.1, 0.02, 0.04], [0.1, 0.02, 0.01]])

    assert residuals.shape == (2, 6)
    assert np.all(np.isinf(residuals[0]))
    assert np.all(np.isfinite(residuals[1]))


def test_a_misfit_without_residuals_has_no_least_squares(twin):
    assert Trials(replace(twin, misfit="envelope"), None, 1).problem().vectors is None


def test_resuming_a_finished_search_runs_nothing(twin, tmp_path, monkeypatch):
    whole = searched(twin, tmp_path / "log.jsonl")
    monkeypatch.setattr("pyblast.back_analysis.trials.evaluate", None)

    assert np.array_equal(
        searched(twin, tmp_path / "log.jsonl", resume=True).misfits, whole.misfits
    )


def test_a_log_line_holds_values_peaks_frequencies_misfit_and_time(twin, tmp_path):
    searched(twin, tmp_path / "log.jsonl", budget=1)

    head, row = map(json.loads, (tmp_path / "log.jsonl").read_text().splitlines())
    assert head["parameters"][2] == ["damping.ratio", 0.005, 0.05, False]
    assert row["number"] == 1
    assert row["values"] == pytest.approx([0.255, 0.0525, 0.0275])
    assert set(row["simulated"]["project.toml"]["R1"]) == {"ppv", "frequency"}
    assert row["wall_seconds"] > 0.0
    assert row["misfit"] > 1.0


@pytest.mark.long
def test_processes_and_threads_give_the_misfits_of_one_worker(twin, tmp_path):
    points = points_of(twin, 11)

    alone = misfits_of(twin, points, tmp_path / "one.jsonl")
    with workers(2) as pool:
        many = misfits_of(twin, points, tmp_path / "two.jsonl", executor=pool)
    with ThreadPoolExecutor(2) as pool:
        threads = misfits_of(twin, points, tmp_path / "three.jsonl", executor=pool)

    assert np.array_equal(alone, many)
    assert np.array_equal(alone, threads)


def test_a_log_of_another_search_is_refused(twin, tmp_path):
    searched(twin, tmp_path / "log.jsonl", budget=1)
    other = replace(twin, parameters=(*PARAMETERS[:2], Parameter("damping.ratio", 0.005, 0.06)))

    with pytest.raises(InputError, match="belongs to another project, record, parameter"):
        searched(other, tmp_path / "log.jsonl", resume=True)


@pytest.mark.parametrize("text", ["", "not json\n", '{"kind": "pyblast trials"}\n', "[1]\n"])
def test_a_file_that_is_no_log_is_refused(twin, tmp_path, text):
    (tmp_path / "log.jsonl").write_text(text)

    with pytest.raises(ReadError, match="is no log of trials"):
        searched(twin, tmp_path / "log.jsonl", resume=True)


def test_a_log_that_lacks_a_line_is_refused(twin, tmp_path):
    searched(twin, tmp_path / "log.jsonl", budget=3)
    lines = (tmp_path / "log.jsonl").read_text().splitlines(keepends=True)
    (tmp_path / "log.jsonl").write_text("".join([lines[0], *lines[2:]]))

    with pytest.raises(ReadError, match="not numbered from 1"):
        searched(twin, tmp_path / "log.jsonl", resume=True)


def test_a_model_that_can_not_be_run_has_an_infinite_misfit_and_its_reason(
    twin, tmp_path, monkeypatch
):
    def fails(models, duration, *, step=None):
        if len(models) > 1 or models[0].damping.ratio > 0.03:
            raise SolverError("the motion grew")
        return run_many(models, duration, step=step)

    run_many = simulation.run_many
    monkeypatch.setattr(simulation, "run_many", fails)

    misfits = misfits_of(twin, [[0.1, 0.02, 0.01], [0.1, 0.02, 0.04]], tmp_path / "log.jsonl")

    assert math.isfinite(misfits[0])
    assert misfits[1] == math.inf
    rows = [json.loads(line) for line in (tmp_path / "log.jsonl").read_text().splitlines()]
    assert rows[2]["misfit"] is None
    assert rows[2]["error"] == "the motion grew"
    log = TrialLog(tmp_path / "log.jsonl", identity(twin, "paper", 1), resume=True)
    assert log.rows[1]["misfit"] == math.inf


def test_lagged_damping_that_would_halve_the_step_is_not_marched_in_one_step(tmp_path):
    path = twin_file(tmp_path)
    text = path.read_text().replace("frequency_hz = 4", "frequency_hz = 1\nlagged = true")
    path.write_text(text)

    assert common_time_step(load_project(path), PARAMETERS) is None


@pytest.mark.long
def test_a_worker_of_dask_that_is_killed_costs_nothing(twin, tmp_path):
    distributed = pytest.importorskip("distributed", reason="needs pip install pyblast[dask]")
    points = points_of(twin, 24)
    alone = misfits_of(twin, points, tmp_path / "one.jsonl")
    killed = []

    def kill(_stage, done, _total):
        if done >= 8 and not killed:
            killed.append(next(iter(cluster.workers.values())).process.pid)
            next(iter(cluster.workers.values())).process.process._process.kill()

    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        many = misfits_of(
            twin, points, tmp_path / "two.jsonl", executor=client.get_executor(), progress=kill
        )

    assert killed
    assert np.array_equal(alone, many)
    assert len((tmp_path / "two.jsonl").read_text().splitlines()) == 25
