"""A cached run equals the run; broken or foreign files are ignored; many runs resume."""

import logging
import os
import subprocess
import sys
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pyblast.errors import InputError
from pyblast.files import PACKAGE, RUN_CODE, WHOLE, code_hash
from pyblast.mesh.builder import structured_box
from pyblast.model.boundary import Viscous
from pyblast.model.model import Model, Receiver
from pyblast.model.source import Hole, TimeFunction
from pyblast.runs.parallel import Cache, cached_run, input_hash, run_all, workers
from pyblast.solver.run import simulate
from verification.columns import ROCK, ricker

RATE = TimeFunction(1e8 * ricker(np.arange(0.0, 0.06, 5e-4), 50.0), 5e-4)
DURATION = 0.02


def small(charge=5.0):
    mesh = structured_box((3, 3, 3), (15.0, 15.0, 15.0))
    return Model(
        mesh,
        {"rock": ROCK},
        boundaries=[Viscous("bottom"), Viscous("west")],
        sources=[Hole(np.array([6.0, 7.0, 6.0]), charge, 0.0, RATE)],
        receivers=[Receiver("house / east", (12.0, 8.0, 13.0), 0.4)],
    )


def same(one, other):
    return np.array_equal(
        one.seismograms["house / east"].velocity, other.seismograms["house / east"].velocity
    )


def test_a_kept_run_has_the_bits_of_the_run(tmp_path):
    direct = simulate(small(), DURATION)
    first, second = (cached_run(small(), DURATION, tmp_path) for _ in range(2))

    assert (first.from_cache, second.from_cache) == (False, True)
    assert same(first, direct)
    assert same(second, direct)
    assert second.energy.keys() == direct.energy.keys()
    assert all(np.array_equal(second.energy[n], direct.energy[n]) for n in direct.energy)
    head = second.seismograms["house / east"]
    assert (head.components, head.dt, head.start) == (
        direct.seismograms["house / east"].components, direct.dt, 0.5 * direct.dt,
    )  # fmt: skip


def test_another_input_is_another_run(tmp_path):
    cached_run(small(), DURATION, tmp_path)
    others = [
        (small(5.0 + 1e-12), DURATION),
        (small(), 0.021),
        (replace(small(), step_factor=0.7), DURATION),
    ]

    assert not any(cached_run(*other, tmp_path).from_cache for other in others)
    cache = Cache(tmp_path)
    assert len(cache) == 4
    assert cache.size == sum(path.stat().st_size for path in tmp_path.iterdir())


@pytest.mark.parametrize("path", RUN_CODE)
def test_the_code_of_a_run_is_part_of_its_hash(path):
    assert (PACKAGE / path).exists()
    assert code_hash(tuple(other for other in RUN_CODE if other != path)) != code_hash()


def test_a_table_of_the_program_is_part_of_its_code(tmp_path, monkeypatch):
    monkeypatch.setattr("pyblast.files.PACKAGE", tmp_path)
    hashes = set()
    for text in ("a = 1", "a = 2"):
        (tmp_path / "priors.toml").write_text(text)
        hashes.add(code_hash.__wrapped__(WHOLE))

    assert len(hashes) == 2


def test_broken_and_foreign_entries_are_left_aside_with_a_word(tmp_path, caplog):
    wanted = cached_run(small(), DURATION, tmp_path)
    (path,) = tmp_path.iterdir()
    whole = path.read_bytes()
    cached_run(small(6.0), DURATION, tmp_path)
    (foreign,) = set(tmp_path.iterdir()) - {path}
    turned = bytearray(whole)
    turned[whole.index(wanted.seismograms["house / east"].velocity[50:].tobytes())] ^= 1
    wrong = (whole[: len(whole) // 2], b"no file of ours", bytes(turned), foreign.read_bytes())

    for content in wrong:
        path.write_bytes(content)
        caplog.clear()
        with caplog.at_level(logging.WARNING):
            again = cached_run(small(), DURATION, tmp_path)
        assert not again.from_cache
        assert same(again, wanted)
        assert "ignored" in caplog.text


def test_what_has_no_content_to_compare_is_refused():
    with pytest.raises(InputError, match=r"input\[0\]\.sources\[0\]\.moment_rate: a function"):
        input_hash(replace(small(), sources=[replace(small().sources[0], moment_rate=lambda t: t)]))


def test_a_pool_gives_the_bits_of_runs_one_by_one_and_resumes(tmp_path):
    models = [small(charge) for charge in (1.0, 2.0, 3.0)]
    cached_run(models[1], DURATION, tmp_path)
    alone = run_all(models, DURATION)

    with workers(2) as pool:
        together = run_all(models, DURATION, folder=tmp_path, executor=pool)

    assert [one.from_cache for one in together] == [False, True, False]
    assert all(same(*pair) for pair in zip(together, alone, strict=True))
    assert all(one.from_cache for one in run_all(models, DURATION, folder=tmp_path))


UNGUARDED = """
from test_cache import DURATION, small
from pyblast.errors import LostProcessError
from pyblast.runs.parallel import run_all, workers
try:
    with workers(2) as pool:
        {work}
except LostProcessError as error:
    print(error)
"""
WORK = {
    "runs": "run_all([small(1.0), small(2.0)], DURATION, executor=pool)",
    "its own functions": "list(pool.map(abs, [-1.0, -2.0]))",
}


@pytest.mark.long
@pytest.mark.parametrize("work", WORK)
def test_a_script_without_its_guard_is_told_so(tmp_path, work):
    script = tmp_path / "script.py"
    script.write_text(UNGUARDED.format(work=WORK[work]))
    path = os.pathsep.join([str(Path(__file__).parent), str(Path(__file__).parents[2])])

    done = subprocess.run(
        [sys.executable, script], env=os.environ | {"PYTHONPATH": path}, capture_output=True,
        text=True, check=False,
    )  # fmt: skip

    assert 'put its work under if __name__ == "__main__":' in done.stdout


class Counted(ThreadPoolExecutor):
    """A pool of two that remembers what it was given."""

    def __init__(self):
        super().__init__(2)
        self.count, self.given = 2, []

    def submit(self, function, model, *rest):
        self.given.append(model)
        return super().submit(function, model, *rest)


@pytest.mark.parametrize(("least", "pooled"), [(1, 2), (10**6, 3)])
def test_a_large_run_that_a_pool_would_make_alone_takes_all_threads(monkeypatch, least, pooled):
    models = [small(charge) for charge in (1.0, 2.0, 3.0)]
    alone = run_all(models, DURATION)
    monkeypatch.setattr("pyblast.runs.parallel.LEAST_SHARED", least)

    with Counted() as pool:
        together = run_all(models, DURATION, executor=pool)

    assert pool.given == models[:pooled]
    assert all(same(*pair) for pair in zip(together, alone, strict=True))


class Interrupted(Executor):
    """Runs nothing; the first result is a Ctrl-C."""

    def __init__(self):
        self.futures = []

    def submit(self, *given):
        del given
        future = Future()
        if not self.futures:
            future.set_exception(KeyboardInterrupt())
        self.futures.append(future)
        return future


def test_what_has_not_begun_does_not_begin_after_ctrl_c():
    executor = Interrupted()

    with pytest.raises(KeyboardInterrupt):
        run_all([small(charge) for charge in (1.0, 2.0, 3.0)], DURATION, executor=executor)

    assert [future.cancelled() for future in executor.futures] == [False, True, True]
