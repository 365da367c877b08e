"""Folders of a diagnosis: numbered, gone on with, read when finished, made anew when asked."""

import json

import pytest
from small_project import INSIDE, written

from pyblast import diagnose
from pyblast.errors import InputError
from pyblast.files import versions

MODULE = "pyblast.workflows.diagnose"


@pytest.fixture
def calls(monkeypatch):
    """Replace the diagnosis itself; the list takes the folder and the runs of each call."""
    made = []

    def instead(_case, folder, *, minutes, seed, runs, **_):
        made.append((folder.name, runs.name))
        if len(made) == 1:
            raise KeyboardInterrupt
        provenance = versions("input") | {"code_sha256": "code"}
        summary = {"minutes": minutes, "seed": seed, "provenance": provenance}
        (folder / "diagnosis.json").write_text(json.dumps(summary))
        (folder / "report.html").write_text("page")
        return summary

    monkeypatch.setattr(f"{MODULE}.diagnose_file", instead)
    monkeypatch.setattr(f"{MODULE}.read_case", lambda _: None)
    monkeypatch.setattr(f"{MODULE}._hash_of", lambda _: "input")
    monkeypatch.setattr(f"{MODULE}.code_hash", lambda _: "code")
    return made


def test_the_same_call_goes_on_then_reads_and_a_fresh_one_makes_anew(tmp_path, calls):
    said = []
    with pytest.raises(KeyboardInterrupt, match="the same command goes on"):
        diagnose(tmp_path / "S1.toml")

    for fresh in (False, False, True):
        diagnose(tmp_path / "S1.toml", fresh=fresh, say=said.append)
    diagnose(tmp_path / "S1.toml", seed=2, say=said.append)

    assert calls == [("001", "runs"), ("001", "runs"), ("002", "runs"), ("003", "runs")]
    assert [text.split(":")[0].split(" in ")[0] for text in said] == [
        "goes on with the unfinished result",
        "this diagnosis is finished",
    ]
    assert not list((tmp_path / "diagnosis").glob("*/unfinished.json"))


def test_an_answer_whose_page_is_missing_is_not_finished(tmp_path, calls):
    with pytest.raises(KeyboardInterrupt):
        diagnose(tmp_path / "S1.toml")
    diagnose(tmp_path / "S1.toml")
    (tmp_path / "diagnosis" / "001" / "report.html").unlink()

    diagnose(tmp_path / "S1.toml")

    assert len(calls) == 3


def test_records_in_another_unit_are_named_before_the_diagnosis(tmp_path, monkeypatch):
    rows = [f"{0.01 * n:.2f},{4e-6 * (n % 2)},0,0" for n in range(20)]
    head = "time_s,longitudinal_m_per_s,transverse_m_per_s,vertical_m_per_s"
    (tmp_path / "house.csv").write_text("\n".join([head, *rows]))
    record = "position_m = [52, 10]\nazimuth_deg = 90", 'recorded = { file = "house.csv" }'
    path = written(tmp_path, ("position_m = [52, 10]", "\n".join(record)), text=INSIDE)
    monkeypatch.setattr(f"{MODULE}.diagnose", stop)
    said = []

    with pytest.raises(InputError, match="no further"):
        diagnose(path, tmp_path / "out", say=said.append)

    assert len(said) == 1
    assert said[0].startswith("D36: project: The level is too low")
    assert "house, recorded: 0.004 mm/s" in said[0]


def stop(*_, **__):
    raise InputError("no further")
