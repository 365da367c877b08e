"""Signals, full disks, lost folders, little memory, poor consoles: one sentence, nothing lost."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from command_line import call, python, spawn
from small_project import INSIDE, TEXT, written

from pyblast import core
from pyblast.files import write_text
from pyblast.mesh.builder import Layer, build_mesh
from pyblast.solver import assembly
from pyblast.solver.preparation import prepare
from verification import fuzz

SIGNALS = pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
FULL = Path("/dev/full")
SOON = 4.0  # s; two on a machine that does nothing else
LONG = "duration_s = 0.1", "duration_s = 60"
POOL = """
import os, time
from pyblast.runs.parallel import workers

def runs():
    print(os.getpid(), flush=True)
    while True:
        pass

if __name__ == "__main__":
    with workers(2) as pool:
        for future in [pool.submit(runs) for _ in range(3)]:
            future.result()
"""
HELD = """
import numpy as np
from typer import Exit
from pyblast.cli.console import exit_codes, say
try:
    with exit_codes():
        say("holds")
        while True:
            np.linalg.svd(np.ones((4000, 4000)))
except Exit as end:
    raise SystemExit(end.exit_code)
"""
FORKED = """
import json, os, sys
from multiprocessing import get_context
from pyblast import load_project

def motion(_=None):
    project = load_project(sys.argv[1])
    return project.simulate().seismograms["house"].velocity.tobytes()

here = motion()
with get_context("fork").Pool(1) as pool:
    print(json.dumps(pool.map(motion, [0]) == [here]))
"""


def running(pid):
    """Return whether a process runs; one whose parent did not wait for it is dead, too."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def wait_until(happened, longest):
    """Wait until something happened; return whether it did in time."""
    ends = time.monotonic() + longest
    while not happened() and time.monotonic() < ends:
        time.sleep(0.02)
    return happened()


def ignoring(number, command, **options):
    """Start a process that inherits a signal as ignored, as a job in the background does."""
    before = signal.signal(number, signal.SIG_IGN)
    try:
        return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                                **options)  # fmt: skip
    finally:
        signal.signal(number, before)


@pytest.mark.long
@pytest.mark.skipif(sys.platform != "linux", reason="asks /proc which processes run")
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT])
def test_workers_end_with_the_process_that_started_them(number, tmp_path):
    script = tmp_path / "pool.py"
    script.write_text(POOL)
    process = subprocess.Popen(
        [sys.executable, script], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
        preexec_fn=partial(signal.signal, signal.SIGINT, signal.SIG_DFL),  # tests may ignore it
    )  # fmt: skip
    pids = [int(process.stdout.readline()) for _ in range(2)]
    assert all(map(running, pids))

    process.send_signal(number)

    assert process.wait(SOON) == -number
    assert wait_until(lambda: not any(map(running, pids)), SOON)


@SIGNALS
def test_code_that_is_not_python_is_ended_within_two_seconds(number):
    process = ignoring(number, [sys.executable, "-c", HELD], env=os.environ | {
        "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"})  # fmt: skip
    assert process.stdout.readline() == "holds\n"
    time.sleep(0.5)

    process.send_signal(number)

    assert process.wait(SOON) == 130
    assert process.stderr.read() == "pyblast: interrupted\n"


@pytest.mark.long
@SIGNALS
@pytest.mark.parametrize("stage", ["mesh", "time steps"])
def test_every_stage_of_a_job_in_the_background_is_ended_within_two_seconds(
    number, stage, tmp_path
):
    fine = ("grid_cells = [12, 4, 6]", "edge_m = 0.3"), ("[run]", "[run]\nsnapshots_s = []")
    path = written(tmp_path, LONG, *(fine if stage == "mesh" else ()), text=INSIDE)
    command = [sys.executable, "-m", "pyblast", "run", str(path)]
    process = ignoring(number, command, env=os.environ | {"OMP_NUM_THREADS": "1"})
    assert any(line == f"pyblast: {stage}\n" for line in process.stdout)
    time.sleep(1.0)

    process.send_signal(number)

    assert process.wait(SOON) == 130
    assert process.stderr.read().startswith("pyblast: interrupted")


@pytest.mark.long
def test_meshing_goes_on_as_before_after_an_interruption():
    box, layers = ((0, 60), (0, 60), (0, 40)), [Layer("rock")]
    before = build_mesh(box, layers, edge=10.0)
    timer = subprocess.Popen([
        sys.executable, "-c", f"import os, time; time.sleep(1.5); os.kill({os.getpid()}, 2)"
    ])  # fmt: skip
    handler = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            build_mesh(box, layers, edge=1.0)
    finally:
        signal.signal(signal.SIGINT, handler)
        timer.wait()

    after = build_mesh(box, layers, edge=10.0)

    assert np.array_equal(after.points, before.points)
    assert np.array_equal(after.zones, before.zones)


@pytest.mark.parametrize("first", [0, 7, 20])
def test_the_pieces_of_a_long_call_change_no_bit(first, monkeypatch):
    prepared, results = prepare(fuzz.tetrahedra(), 0.05), []
    for seconds in (1e-9, 1e9):
        monkeypatch.setattr(core, "PIECE_SECONDS", seconds)
        views, state = prepared.begun()
        core.advance(views, state, 0, first, 20)
        results.append([*core.advance(views, state, first, 250, 20)[:2], *state.values()])

    assert all(np.array_equal(one, other) for one, other in zip(*results, strict=True))
    assert len(results[0][0]) == 250
    assert state["row_lost"].max() > 0.0


@pytest.mark.long
@pytest.mark.skipif(not hasattr(os, "fork"), reason="no processes are forked here")
def test_a_process_that_was_forked_after_a_run_gives_the_same_bits(tmp_path):
    assert python(FORKED, written(tmp_path, text=INSIDE), threads=2)


def test_far_too_many_threads_are_limited():
    many = "import json; from pyblast import core; print(json.dumps(core.n_threads()))"

    assert python(many, threads=100_000) == os.cpu_count()


@pytest.mark.long
@pytest.mark.skipif(not FULL.exists(), reason="no device that is full")
def test_an_output_that_cannot_be_written_is_told(tmp_path):
    with FULL.open("w") as full:
        done = subprocess.run([sys.executable, "-m", "pyblast", "superpose",
                               written(tmp_path)], stdout=full, stderr=subprocess.PIPE,
                              text=True, check=False)  # fmt: skip

    assert done.returncode == 2
    assert done.stderr.startswith("pyblast: the output can't be written (No space left")
    assert len(done.stderr.splitlines()) == 1


@pytest.mark.long
def test_a_run_goes_on_without_a_reader_of_its_output(tmp_path):
    process = spawn("run", written(tmp_path, text=INSIDE), "--accept-findings")
    process.stdout.close()

    assert process.wait(60) == 0
    assert "goes on without it" in process.stderr.read()
    assert (tmp_path / "results" / "001" / "report.html").is_file()


@pytest.mark.long
def test_names_that_a_file_system_lacks_cost_no_run(tmp_path):
    names = ('"R1"', '"Köln"'), ('title = "Small column"', 'title = "Größe ↑"')
    path = written(tmp_path, *names, text=TEXT)
    poor = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0", "OMP_NUM_THREADS": "1"}

    done = subprocess.run(
        [sys.executable, "-m", "pyblast", "run", str(path), "--accept-findings"],
        env=os.environ | poor, capture_output=True, check=False,
    )  # fmt: skip

    assert done.returncode == 0, done.stderr
    assert b"Koeln" in done.stdout
    assert (tmp_path / "results" / "001" / "curves" / "simulated_K_ln.csv").is_file()


@pytest.mark.long
@pytest.mark.parametrize("stage", ["time steps", "results and report"])
def test_a_results_folder_that_is_removed_during_a_run_is_made_again(stage, tmp_path):
    path = written(tmp_path, ("duration_s = 0.1", "duration_s = 2"), text=INSIDE)
    process = spawn("run", path, "--accept-findings")
    assert any(line == f"pyblast: {stage}\n" for line in process.stdout)

    shutil.rmtree(tmp_path / "results", ignore_errors=True)

    process.communicate(timeout=60)
    assert process.returncode == 0
    summary = json.loads((tmp_path / "results" / "001" / "summary.json").read_text())
    assert summary["receivers"]["house"]


def test_a_lack_of_memory_is_told_in_one_sentence(tmp_path, monkeypatch):
    def lacking(*_, **__):
        raise MemoryError("Unable to allocate 9.00 EiB")

    monkeypatch.setattr(assembly, "geometry_arrays", lacking)

    done = call("run", written(tmp_path, text=INSIDE))

    assert done.exit_code == 2
    assert "pyblast: the memory does not suffice" in done.output


def test_an_error_of_the_system_is_told_with_its_file(tmp_path, monkeypatch):
    def failing(*_, **__):
        raise OSError(5, "Input/output error", "disk/file.h5")

    monkeypatch.setattr(assembly, "geometry_arrays", failing)

    done = call("run", written(tmp_path, text=INSIDE))

    assert done.exit_code == 2
    assert done.output.splitlines()[-1] == "pyblast: disk/file.h5: Input/output error"


def test_text_is_written_into_a_folder_that_is_gone(tmp_path):
    write_text(tmp_path / "gone" / "a.txt", "kept")

    assert (tmp_path / "gone" / "a.txt").read_text() == "kept"
