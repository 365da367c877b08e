"""What was read is shown on the screen, in the summary and in the report."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from command_line import call

REPORTED = Path(__file__).parents[1] / "reported"


def test_the_screen_shows_columns_units_and_losses_only_if_asked():
    path = REPORTED / "26-titles-at-every-door" / "peaks_below_trigger.csv"

    plain, asked = call("sitelaw", path), call("sitelaw", path, "--verbose")

    assert "ppv: column 3 'ppv_mm_per_s', mm_per_s, factor 0.001, 11 values" in asked.output
    assert "dropped row 2: only a bound is given" in asked.output
    assert "factor 0.001" not in plain.output


def test_a_mapping_answers_a_question_of_the_site_law(tmp_path):
    text = "R (m),W (kg),Peak (mm/s)\n" + "\n".join(
        f"{r},{w},{2500.0 * (r / w**0.5) ** -1.6:.4g}"
        for r, w in zip(range(50, 1050, 100), [90, 100] * 5, strict=True)
    )
    (tmp_path / "peaks.csv").write_text(text)
    (tmp_path / "map.toml").write_text('[columns]\nppv_mm_per_s = "Peak (mm/s)"\n')

    refused = call("sitelaw", tmp_path / "peaks.csv")
    done = call("sitelaw", tmp_path / "peaks.csv", "--mapping", tmp_path / "map.toml")

    assert refused.exit_code == 2
    assert "missing columns: ppv (mm/s)" in refused.output
    assert "SD^-1.6" in done.output


def test_the_reason_why_a_text_file_is_no_record_is_given(tmp_path):
    folder = shutil.copytree(REPORTED / "49-reason-of-a-text-file", tmp_path / "records")
    (folder / "notes.txt").write_text("It shook a lot.\n")

    done = call("records", folder, "--verbose")

    assert "- shed.txt: line 309, column 'vertical': expected a number, got 'OVR'" in done.output
    assert "- notes.txt: is none of INSTANTEL_ASCII" in done.output
    assert "vertical: column 2, mm/s, factor 0.001" in done.output
    result = tmp_path / "records_analysis" / "001"
    (mill,) = json.loads((result / "records.json").read_text())["inputs"]
    assert (mill["file"], mill["columns"][0]["unit"]) == ("mill.txt", "mm/s")
    assert "What was read" in (result / "report.html").read_text()


@pytest.mark.parametrize("encoding", ["ascii", "utf-8"])
def test_consoles_without_umlauts_spell_them(tmp_path, encoding):
    path = tmp_path / "Prüfung Łódź.csv"
    shutil.copy(REPORTED / "26-titles-at-every-door" / "peaks_titles.csv", path)
    environment = os.environ | {"PYTHONIOENCODING": encoding}

    done = subprocess.run(
        [sys.executable, "-m", "pyblast", "sitelaw", path, "--verbose"],
        env=environment, capture_output=True, timeout=120,
    )  # fmt: skip

    name = "Pruefung Lodz.csv" if encoding == "ascii" else "Prüfung Łódź.csv"
    assert done.returncode == 0, done.stderr
    assert name in done.stdout.decode(encoding)
