"""What is timed is the same physics; things are timed in turn; the page says what is missing."""

import json

import numpy as np
import pytest

from benchmarks import goals, page, waits
from benchmarks.__main__ import PARTS, RESULTS, keep_waits
from benchmarks.bare import bare, library
from benchmarks.compiled import called
from benchmarks.kernels import Naive, bytes_per_zone, shuffled
from benchmarks.marching import ROCK, March, cube, prepared, rock_model
from benchmarks.timing import interleaved, ratio
from pyblast import core
from pyblast.mesh.nodes import renumbered


def test_the_naive_loop_marches_as_the_model_does():
    mesh = renumbered(cube(3))
    naive, still = Naive(mesh, 20), prepared(rock_model(mesh, boundaries=[]), 20)
    velocity = 1e-6 * np.random.default_rng(0).normal(size=mesh.points.shape)
    state = {name: value.copy() for name, value in still.state.items()}
    state["velocity"][:] = velocity
    naive.tables[5][:] = 0.0
    called(naive.library().naive_march, naive.counts, (still.constants["dt"],), naive.tables)
    core.advance(core.to_fortran(still.constants), state, 0, 20, 20)

    assert np.allclose(naive.tables[7], state["velocity"], atol=1e-12 * np.abs(velocity).max())


def test_zones_alone_march_as_the_model_does():
    mesh = renumbered(cube(3))
    box, still = bare(mesh, ROCK), prepared(rock_model(mesh, boundaries=[]), 20)
    velocity = 1e-6 * np.random.default_rng(0).normal(size=mesh.points.shape)
    state = {name: value.copy() for name, value in still.state.items()}
    state["velocity"][:] = velocity
    (counts, tables), _, _, moving = box.arguments(20, (np.zeros_like(velocity), velocity))
    tables[8][:] = 1.0 / box.mass[:, None]
    called(library().march, counts, (still.constants["dt"],), tables)
    core.advance(core.to_fortran(still.constants), state, 0, 20, 20)

    assert np.allclose(moving, state["velocity"], atol=1e-12 * np.abs(velocity).max())


def test_a_shuffled_mesh_is_the_same_mesh():
    mesh = cube(3)
    other = shuffled(mesh)
    centres = [
        np.sort(one.points[one.zones].mean(axis=1).round(9), axis=0) for one in (mesh, other)
    ]

    assert not np.array_equal(mesh.zones, other.zones)
    assert np.array_equal(*centres)


def test_eight_copies_march_like_one():
    still = prepared(rock_model(cube(3, 2), "coulomb"), 20)
    one, eight = March(still, 20), March(still, 20, lanes=True)
    eight.state["velocity"][:] = one.state["velocity"][..., None]
    one()
    eight()

    assert np.allclose(
        eight.state["velocity"], one.state["velocity"][..., None],
        atol=1e-12 * np.abs(one.state["velocity"]).max(),
    )  # fmt: skip


def test_things_are_timed_in_turn_forth_and_back():
    told = []
    took = interleaved({"a": lambda: told.append("a"), "b": lambda: told.append("b")}, 3)

    assert "".join(told) == "ab" + "ab" + "ba" + "ab"
    assert [len(times) for times in took.values()] == [3, 3]


def test_a_ratio_is_the_median_of_those_of_each_round():
    assert ratio(np.array([2.0, 90.0, 6.0]), np.array([1.0, 30.0, 2.0])) == 3.0


def test_a_step_moves_more_than_its_zones_and_damping_more_again():
    counted = bytes_per_zone(prepared(rock_model(cube(6)), 2).constants)

    assert counted["least"] < counted["zones"] < counted["step"] < counted["damped"]


def test_every_goal_that_was_not_measured_says_so():
    judged = {page.judged(need, judge, {}) for _, need, judge in goals.GOALS}

    assert judged == {("not measured", "–", "–")}


@pytest.mark.parametrize("goal", goals.GOALS, ids=lambda goal: goal[0])
def test_a_goal_with_numbers_is_judged(goal):
    _, need, judge = goal
    kept = json.loads(RESULTS.read_text())
    part, _, key = need.partition(".")
    measured, outcome, on = page.judged(need, judge, kept)

    if (key or "found") in kept.get(part, {}):
        assert measured != "not measured"
        assert outcome == "yes" or outcome.startswith("**no**")
        assert kept[part]["date"] in on
    else:
        assert measured == "not measured"


def test_numbers_that_lack_what_a_goal_needs_are_a_fault_not_a_silence():
    part = {"machine": {"processor": "A"}, "load": 0.0, "date": "2026-01-01", "found": {}}
    need, judge = next((need, judge) for _, need, judge in goals.GOALS if need == "kernels")

    with pytest.raises(KeyError):
        page.judged(need, judge, {"kernels": part})


def test_a_number_is_judged_by_its_limit():
    need, judge = goals.at_most("demo.seconds", 180.0, "s")
    on = {"machine": {"processor": "A"}, "load": 0.1, "date": "2026-01-02"}
    judged = [page.judged(need, judge, {"demo": {**on, "seconds": s}}) for s in (170.0, 190.0)]

    assert judged == [("170 s", "yes", "A, 2026-01-02, load 0.1"),
                      ("190 s", "**no**", "A, 2026-01-02, load 0.1")]  # fmt: skip
    assert page.judged(need, judge, {"demo": on})[0] == "not measured"


def test_what_users_wait_for_is_judged_with_the_machine_that_it_was_measured_on():
    kept = json.loads(RESULTS.read_text())
    on = {"machine": {"processor": "B", "threads": 2}, "load": 0.5, "date": "2026-01-03"}
    found = {"demo": {"seconds": 100.0, **on}, "mine": {"file_to_report_s": 200.0, **on}}
    keep_waits(kept, found)
    judged = {
        need: page.judged(need, judge, kept)
        for _, need, judge in goals.GOALS
        if need in ("demo.seconds", "mine.file_to_report_s", "mine")
    }

    where = "B, 2026-01-03, load 0.5"
    assert judged["demo.seconds"] == ("100 s", "yes", where)
    assert judged["mine.file_to_report_s"] == ("200 s", "**no**", where)
    assert where not in judged["mine"][2]
    assert sum(where in line for line in waits.lines(found)) == 2


def test_a_wait_for_a_command_that_fails_is_no_number():
    with pytest.raises(RuntimeError, match="ended with 2: no such"):
        waits.waited("sh", "-c", "echo no such project >&2; exit 2")


def test_a_part_without_found_takes_no_judgement_from_the_others():
    kept = json.loads(RESULTS.read_text())
    aside = {"machine": {"processor": "A"}, "load": 0.0, "date": "2026-01-01", "a_number": 1.0}

    for _, need, judge in goals.GOALS:
        assert page.judged(need, judge, {**kept, "aside": aside}) == page.judged(need, judge, kept)


def test_every_kept_result_says_on_what_and_when_it_was_measured():
    for name, one in json.loads(RESULTS.read_text()).items():
        assert {"machine", "load", "date"} <= set(one), name


def test_every_kept_result_has_its_tables():
    kept = json.loads(RESULTS.read_text())

    assert kept
    for name, one in ((name, kept[name]) for name in PARTS if name in kept):
        assert len(PARTS[name].lines(one["found"])) > 2, name


@pytest.mark.figures
def test_the_page_is_that_of_the_kept_results(tmp_path, monkeypatch):
    written = page.PAGE.read_text(encoding="utf-8")
    monkeypatch.setattr(page, "PAGE", tmp_path / "performance.md")
    monkeypatch.setattr(page, "FIGURES", tmp_path)
    page.write(PARTS, json.loads(RESULTS.read_text()))

    assert page.PAGE.read_text(encoding="utf-8") == written
