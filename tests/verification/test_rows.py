"""A study keeps every row as it comes, and goes on where it was stopped."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from pyblast.errors import InputError
from verification import rows
from verification.rows import each_row, options

ROOT = Path(__file__).parents[2]
STUDY = """
import sys, time
from pathlib import Path
from verification.rows import each_row

def job(name):
    if name == sys.argv[2]:
        print("waits", flush=True)
        time.sleep(60)
    return {"letter": name}

each_row(Path(sys.argv[1]), sys.argv[3], job)
"""


def study(path, waits="-", names="abc"):
    return subprocess.Popen(
        [sys.executable, "-c", STUDY, path, waits, names], cwd=ROOT, stdout=subprocess.PIPE,
        text=True, env={**os.environ, "PYTHONPATH": str(ROOT)},
    )  # fmt: skip


def test_a_row_says_on_what_when_and_by_which_program_it_was_computed(tmp_path):
    found = each_row(tmp_path / "study.json", ["a"], lambda name: {"letter": name})

    assert found["a"]["letter"] == "a"
    assert {"machine", "load", "date", "program"} < set(found["a"])
    assert json.loads((tmp_path / "study.json").read_text()) == found


def test_rows_that_are_stored_are_not_computed_again_unless_asked_for(tmp_path):
    path, computed = tmp_path / "study.json", []
    for again in (False, False, True):
        each_row(path, ["a", "b"], lambda name: computed.append(name) or {}, again=again)

    assert computed == ["a", "b", "a", "b"]


def test_a_stopped_study_keeps_its_rows_and_goes_on(tmp_path):
    path = tmp_path / "study.json"
    stopped = study(path, waits="b")
    assert any(line == "waits\n" for line in stopped.stdout)
    stopped.send_signal(signal.SIGTERM)

    assert stopped.wait(timeout=20) == 143
    assert list(json.loads(path.read_text())) == ["a"]
    assert study(path).wait(timeout=20) == 0
    assert list(json.loads(path.read_text())) == ["a", "b", "c"]


def test_two_processes_share_a_file(tmp_path):
    path = tmp_path / "study.json"
    both = [study(path, names=names) for names in ("abcdefgh", "stuvwxyz")]

    assert [one.wait(timeout=30) for one in both] == [0, 0]
    assert "".join(json.loads(path.read_text())) == "abcdefghstuvwxyz"


def test_no_row_is_begun_after_the_time_is_over(tmp_path):
    found = each_row(
        tmp_path / "study.json", "abc", lambda _: time.sleep(0.03) or {}, minutes=0.02 / 60.0
    )

    assert list(found) == ["a"]


def test_a_row_that_fails_is_named_after_the_others(tmp_path, capsys):
    def job(name):
        if name == "a":
            raise InputError("materials.rock: is missing")
        return {}

    with pytest.raises(SystemExit, match="no row for a, see above"):
        each_row(tmp_path / "study.json", "ab", job)

    assert "no row for a: materials.rock: is missing" in capsys.readouterr().err
    assert list(rows.read_rows(tmp_path / "study.json")) == ["b"]


@pytest.mark.parametrize("file", ["pyblast/module.py", "pyblast/limits.toml", "fortran/core.f90"])
def test_the_program_of_a_row_is_the_source_with_its_tables(tmp_path, monkeypatch, file):
    for folder in ("pyblast", "fortran"):
        (tmp_path / folder).mkdir()
    monkeypatch.setattr(rows, "ROOT", tmp_path)
    digests = set()
    for text in ("", "a = 1\n", "a = 2\n"):
        (tmp_path / file).write_text(text)
        digests.add(rows.program.__wrapped__())

    assert len(digests) == 3


def test_options_are_taken_from_the_arguments():
    assert options(["a", "--minutes", "2.5", "--again", "b"]) == (
        ["a", "b"], {"again": True, "minutes": 2.5},
    )  # fmt: skip
    with pytest.raises(SystemExit, match="--minutes: needs a positive number"):
        options(["--minutes"])
