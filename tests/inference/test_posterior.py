"""Posteriors: against a Gaussian that is known, against its own doubts, and from a project."""

import json
import os
import signal
import time

import numpy as np
import pytest
from command_line import spawn
from inversion_project import TRUTH, noisy

from pyblast import back_analyse, load_project
from pyblast.errors import InputError, SolverError
from pyblast.inference.parameter import Problem
from pyblast.inference.posterior import Chains, emulate, posterior, r_hat, walk

TRUE = np.array([0.4, 0.6])
DESIGN = np.random.default_rng(1).standard_normal((40, 2)) * [40.0, 10.0]


def problem(residuals, n=2):
    """Return a problem of residuals (m, n) -> (m, k) over the unit cube."""

    def vectors(points):
        found = residuals(np.atleast_2d(points))
        return np.sum(found**2, axis=1), found

    return Problem(np.zeros(n), np.ones(n), np.zeros(n, bool), lambda p: vectors(p)[0], vectors)


def linear(points):
    return (points - TRUE) @ DESIGN.T


def bent(points):
    return np.hstack([linear(points), 200.0 * (points[:, :1] - 0.45) ** 2 * (points[:, 1:] - 0.3)])


@pytest.fixture(scope="module")
def drawn():
    return posterior(problem(linear), TRUE, 5)


def test_the_posterior_of_a_linear_problem_is_its_gaussian(drawn):
    covariance = np.linalg.inv(DESIGN.T @ DESIGN)
    deviation = np.sqrt(np.diag(covariance))

    ends = TRUE[:, None] + 1.6449 * deviation[:, None] * [-1.0, 1.0]
    # 2000 draws: quantiles are right to a twentieth of a deviation
    assert np.max(np.abs(drawn.intervals - ends) / deviation[:, None]) < 0.2
    rho = covariance[0, 1] / deviation.prod()
    assert drawn.correlation[0, 1] == pytest.approx(rho, abs=0.08)
    assert drawn.effective > 0.99 * len(drawn.log_weights)


def test_the_same_seed_walks_the_same_way():
    start = np.random.default_rng(0).random((2, 16, 2))

    walks = [walk(lambda u: -np.sum(u**2, axis=1), start, seed, 50) for seed in (4, 4, 5)]

    assert np.array_equal(walks[0].x, walks[1].x)
    assert not np.array_equal(walks[0].x, walks[2].x)


def test_an_emulator_of_a_bent_problem_is_good_to_its_checks():
    found = posterior(problem(bent), TRUE, 1)

    assert found.failure == ""
    assert found.effective > 0.9 * len(found.log_weights)


def test_checks_correct_a_quick_problem_that_is_shifted():
    shift = np.array([0.004, 0.0])  # 1 standard deviation
    shifted = problem(lambda points: linear(points + shift))

    found = posterior(shifted, TRUE, 2, checking=problem(linear))
    deviation = 1.0 / np.sqrt(DESIGN.T @ DESIGN)[0, 0]

    assert found.effective < 0.8 * len(found.log_weights) < found.corrected
    assert found.samples.mean(axis=0)[0] == pytest.approx(TRUE[0], abs=0.15 * deviation)


def test_a_quick_problem_that_is_wrong_gets_no_intervals():
    wrong = problem(lambda points: linear(points + np.array([0.08, 0.0])))

    found = posterior(wrong, TRUE, 2, checking=problem(bent))

    assert "not good enough" in found.failure
    with pytest.raises(
        SolverError,
        match="no intervals, the emulator is not good enough",
    ):
        found.intervals  # noqa: B018


def test_checks_that_can_not_be_run_count_as_lost():
    def failing(points):
        return np.where(points[:, :1] > 0.395, np.nan, linear(points))

    found = posterior(problem(linear), TRUE, 5, checking=problem(failing))

    lost = np.count_nonzero(np.isneginf(found.log_weights))
    assert lost > 0.5 * len(found.log_weights)
    assert found.corrected <= len(found.log_weights) - lost + 1e-9
    assert "the emulator is not good enough" in found.failure


def test_what_records_do_not_feel_keeps_its_range():
    found = posterior(problem(lambda points: linear(points * [1.0, 0.0] + [0.0, 0.6])), TRUE, 3)

    # even over the range: 0.05 to 0.95
    assert found.intervals[1] == pytest.approx([0.05, 0.95], abs=0.03)


def test_ensembles_that_disagree_are_not_believed():
    apart = np.random.default_rng(0).standard_normal((2, 500, 8, 1))
    apart[1] += 0.5

    assert r_hat(apart)[0] > 1.01
    assert "R-hat" in Chains(apart, np.ones(1), r_hat(apart), 0.5).failure


def test_a_walk_that_is_too_short_says_so():
    start = np.random.default_rng(0).random((2, 16, 2))

    found = walk(lambda places: np.zeros(len(places)), start, 0, longest=100)

    assert "autocorrelation times, not 50" in found.failure


def test_an_emulator_doubts_itself_away_from_what_it_learnt():
    places = 0.4 + 0.1 * np.random.default_rng(0).random((30, 2))
    process = emulate(places, bent(places)).process

    far = process.at(np.array([[3.0, 3.0]]))[1]
    assert np.sum(far**2) < 0.9
    assert np.sum(process.at(process.x[:1])[1] ** 2) > 0.999


def test_a_posterior_needs_whitened_residuals():
    with pytest.raises(InputError, match="needs a misfit of whitened residuals"):
        posterior(Problem(np.zeros(1), np.ones(1), np.zeros(1, bool), np.sum), np.zeros(1), 0)


def test_a_posterior_of_another_misfit_is_refused_before_anything_is_run(tmp_path):
    with pytest.raises(
        InputError, match=r"back_analysis.posterior: needs misfit 'waveform', whose"
    ):
        back_analyse(noisy(tmp_path, misfit="'paper'", posterior="true"))


@pytest.fixture(scope="module")
def told(tmp_path_factory):
    return back_analyse(noisy(tmp_path_factory.mktemp("told"), posterior="true"))


def test_a_project_tells_intervals_that_hold_the_truth(told):
    found, folder = told
    table = json.loads((folder / "back_analysis.json").read_text())["posterior"]

    assert found.posterior.failure == ""
    for one, truth in zip(table["parameters"], TRUTH, strict=True):
        assert one["interval_90"][0] < truth < one["interval_90"][1]
    assert len(table["samples"]) == 2000
    assert "histogram of each parameter" in (folder / "report.html").read_text()


def test_a_posterior_without_the_error_of_its_mesh_says_so(told):
    found, folder = told

    assert (
        "mesh.grid_cells: such a mesh can't be made coarser" in found.posterior.mesh_error_missing
    )
    assert "; the intervals do not include it" in (folder / "report.html").read_text()


def test_a_posterior_whose_log_was_cut_is_resumed_to_the_same_answer(told, tmp_path):
    whole, folder = told
    lines = (folder / "trials.jsonl").read_bytes().splitlines(keepends=True)
    path = noisy(tmp_path, posterior="true")
    cut = tmp_path / "back_analysis" / "001" / "trials.jsonl"
    cut.parent.mkdir(parents=True)
    cut.write_bytes(b"".join(lines[:61]) + lines[61][:30])

    again, _ = back_analyse(load_project(path))

    assert 61 < len(lines) == cut.read_bytes().count(b"\n")
    assert np.array_equal(again.posterior.samples, whole.posterior.samples)
    assert np.array_equal(again.posterior.log_weights, whole.posterior.log_weights)


@pytest.mark.long
def test_a_posterior_that_was_killed_is_resumed_to_the_same_answer(told, tmp_path):
    whole, folder = told
    path = noisy(tmp_path, posterior="true")
    log = tmp_path / "back_analysis" / "001" / "trials.jsonl"
    process = spawn("backanalyse", path)
    while process.poll() is None and not (log.is_file() and log.read_bytes().count(b"\n") > 60):
        time.sleep(0.02)
    os.kill(process.pid, signal.SIGKILL)
    process.communicate()
    made = log.read_bytes().count(b"\n")

    again, _ = back_analyse(load_project(path))

    lines = (folder / "trials.jsonl").read_bytes().count(b"\n")
    assert 15 + 1 < made < lines == log.read_bytes().count(b"\n")
    assert np.array_equal(again.posterior.samples, whole.posterior.samples)
    assert np.array_equal(again.posterior.log_weights, whole.posterior.log_weights)
