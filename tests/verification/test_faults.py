"""Signals at random moments: what a row tells of a command that goes on well, or does not."""

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from verification import faults

# A command that counts to ten in a file and goes on from there; "tells" answers where it began.
COUNTING = """
import json, sys, time
from pathlib import Path
kept = Path("kept")
first = int(kept.read_text()) if kept.exists() else 0
for n in range(first, 10):
    time.sleep(0.05)
    Path("new").write_text(str(n + 1))
    Path("new").replace(kept)
Path("out/001").mkdir(parents=True, exist_ok=True)
answer = {"first": first} if sys.argv[1] == "tells" else {"last": n + 1}
Path("out/001/answer.json").write_text(json.dumps(answer))
"""


@pytest.fixture
def counting(monkeypatch):
    """Let commands count, in place of those of pyblast."""

    def begin(folder, command, *_):
        words = [sys.executable, "-c", COUNTING, command]
        with (folder / "said.txt").open("w") as said:
            return subprocess.Popen(words, cwd=folder, stdout=said, start_new_session=True)

    monkeypatch.setattr(faults, "begin", begin)
    monkeypatch.setattr(faults, "project_in", lambda folder, _: folder)
    for command in ("counts", "tells"):
        monkeypatch.setitem(faults.COMMANDS, command, ([], "out", "answer.json", ""))
    faults.reference.cache_clear()
    yield
    faults.reference.cache_clear()


@pytest.mark.usefixtures("counting")
@pytest.mark.parametrize("fault", faults.SIGNALS)
def test_a_command_that_goes_on_has_the_same_answer(fault):
    row = faults.row(f"counts {fault} 3 1")

    assert row["result"] == "the same"
    assert row["still_running"] == 0
    assert row["code"] in (-getattr(signal, fault), 0)
    assert not faults.is_bad(row)


@pytest.mark.usefixtures("counting")
def test_a_command_whose_answer_depends_on_the_interruption_is_found(monkeypatch):
    faults.reference("tells")
    monkeypatch.setattr(faults, "share_of", lambda *_: 0.6)

    row = faults.row("tells SIGKILL 3 1")

    assert row["result"] == "another"
    assert faults.is_bad(row)


@pytest.mark.parametrize(
    ("changes", "bad"),
    [
        ({}, False),
        ({"code": 2, "told": "pyblast: a disk is full"}, False),
        ({"code": 2, "told": ""}, True),
        ({"code": 1, "told": "Traceback (most recent call last):"}, True),
        ({"still_running": 1}, True),
        ({"fault": "ascii", "code": 2, "told": "pyblast: no"}, True),
    ],
)
def test_a_command_is_no_good_that_ends_without_a_sentence(changes, bad):
    row = {"fault": "full", "code": 0, "told": "", "still_running": 0, "result": "the same"}

    assert faults.is_bad(row | changes) == bad


def test_what_depends_on_when_a_command_ran_is_left_out():
    table = {"best": 1.0, "wall_s": 3.0, "rows": [{"misfit": 2.0, "wall_seconds": 0.1}]}

    assert faults.lasting(table) == {"best": 1.0, "rows": [{"misfit": 2.0}]}


def test_the_processes_of_a_session_are_seen():
    if not Path("/proc").is_dir():
        pytest.skip("no list of processes here")
    process = subprocess.Popen(["sleep", "30"], start_new_session=True)

    assert list(faults.running(process.pid)) == [process.pid]
    process.kill()
    process.wait()
    assert not list(faults.running(process.pid))
