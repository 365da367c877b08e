"""The site from blast to blast: one page and one JSON, again in no time, and refusals."""

import csv
import hashlib
import json
import subprocess
import sys
from pathlib import Path
from shutil import copytree

import numpy as np
import pytest
from command_line import call

from pyblast import InputError
from pyblast.blasts.published_laws import HARD_ROCK
from pyblast.line_records import monitoring
from pyblast.workflows import site as workflow
from pyblast.workflows.site import learn_site

QUARRY = Path(__file__).parents[2] / "examples" / "site" / "quarry"


@pytest.fixture
def quarry(tmp_path):
    return copytree(QUARRY, tmp_path / "quarry")


def test_the_shipped_quarry_is_learned(quarry):
    done = call("site", quarry)

    assert done.exit_code == 0, done.output
    summary = json.loads((quarry / "site" / "site.json").read_text())
    assert len(summary["records"]) == 71
    assert (summary["unjoined"], summary["skipped"]) == ([], [])
    assert len(summary["silent"]) == 1
    low, high = summary["law"]["beta_90"]
    assert low < 1.5 < high
    far = {row["blast"]: row["factor"] for row in summary["law"]["outliers"]}
    assert far.keys() == {"B17"}
    assert far["B17"] == pytest.approx(3.5, rel=0.6)
    (change,) = summary["changes"]
    assert (change["blast"], change["station"]) == ("B13", "school")
    assert change["kinds"][0] == "vertical channel"
    vertical = change["features"].index("vertical")
    step, error = change["step"][vertical], change["error"][vertical]
    assert abs(step - np.log10(0.4)) < 2.0 * error
    assert {row["blast"] for row in summary["forecasts"]} == {"B25"}
    for row in summary["forecasts"]:
        low, high = row["band"]
        usual = 0.6 * (row["distance"] / row["charge"] ** 0.5) ** -1.5
        assert low < usual < row["level_95"] < high * 1.001
    over = [row for row in summary["records"] if row["share"] > 1.0]
    assert f"{len(over)} of 71 records exceed DIN 4150-3" in done.output
    with (quarry / "site" / "compliance.csv").open() as file:
        table = list(csv.DictReader(file))
    assert [float(row["share_of_limit"]) > 1.0 for row in table].count(True) == len(over)
    page = (quarry / "site" / "report.html").read_text()
    assert "B17" in page
    assert "http" not in page.replace("http://www.w3.org/2000/svg", "")


def test_what_was_parsed_is_kept_and_a_new_file_alone_is_parsed(quarry, monkeypatch):
    first, _ = learn_site(quarry)
    parsed = []

    def read(path, name):
        parsed.append(name)
        return monitoring.read_peaks(path, name)

    monkeypatch.setattr(workflow, "read_peaks", read)
    assert learn_site(quarry)[0] == first
    assert parsed == []

    (quarry / "records" / "copy.csv").write_text(
        (quarry / "records" / "farm_03.csv").read_text() + "\n"
    )
    again, _ = learn_site(quarry)
    assert parsed == ["records/copy.csv"]
    assert again["law"] == first["law"]
    assert "repeats" in again["unjoined"][0]["reason"]

    (quarry / "site" / "parsed.json").write_text('{"code": 1, "files": [')
    assert learn_site(quarry)[0]["records"] == again["records"]
    assert len(parsed) == 73


def test_a_site_loads_nothing_of_the_solver_nor_the_slow_parts_of_scipy(quarry):
    code = (
        "import sys; from pyblast.workflows.site import learn_site; learn_site(sys.argv[1]); "
        "print(*sys.modules)"
    )

    done = subprocess.run([sys.executable, "-c", code, quarry], check=True, capture_output=True)

    loaded = set(done.stdout.decode().split())
    assert "pyblast.line_records.changes" in loaded
    heavy = ("mesh", "model", "solver", "runs", "config", "project", "inference", "diagnosis")
    assert not loaded & {f"pyblast.{name}" for name in heavy}
    assert not loaded & {"scipy.stats", "scipy.optimize", "scipy.signal", "pydantic", "h5py"}


def test_what_is_no_record_is_listed_with_its_reason(quarry):
    (quarry / "records" / "holiday.csv").write_text("a,b\n1,2\n")
    (quarry / "notes.md").write_text("nothing")
    (quarry / "records" / "farm.txt").write_text("a text that no reader knows\n")
    (quarry / "<b>.csv").write_text("x\n")

    done = call("site", quarry)

    assert done.exit_code == 0, done.output
    skipped = {row["file"]: row["reason"] for row in
               json.loads((quarry / "site" / "site.json").read_text())["skipped"]}  # fmt: skip
    assert skipped["notes.md"] == "is no record"
    assert "is none of" in skipped["records/holiday.csv"]
    assert "is none of" in skipped["records/farm.txt"]
    assert "records/farm.txt: is none of" in " ".join(done.output.split())
    assert "records/holiday.csv" in done.output
    assert "<b>.csv" not in (quarry / "site" / "report.html").read_text()


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda folder: (folder / "blasts.csv").unlink(), "holds none of blasts.csv, blasts.txt"),
        (lambda folder: (folder / "blasts.txt").write_text("x"), "more than one of blasts.csv"),
        (lambda folder: (folder / "blasts.csv").write_text("blast,day\nS1,2\n"), "date"),
        (lambda folder: (folder / "blasts.csv").write_text(
            "blast,date,x,y\nS1,2026-03-02,4e6,9e6\n"), "km from the nearest station"),
        (lambda folder: [p.unlink() for p in (folder / "records").iterdir()],
         "no record belongs to a blast (it holds no record)"),
    ],
)  # fmt: skip
def test_a_folder_that_is_no_site_ends_with_one_sentence_and_2(quarry, damage, message):
    damage(quarry)

    done = call("site", quarry)

    assert done.exit_code == 2
    assert message in " ".join(done.output.split())
    assert not (quarry / "site" / "site.json").exists()


def test_records_beside_a_summary_of_another_program_are_read(quarry):
    (quarry / "records" / "summary.json").write_text('{"receivers": {}}')

    summary, _ = learn_site(quarry)

    assert len(summary["records"]) == 71
    assert [row["file"] for row in summary["skipped"]] == ["records/summary.json"]


def test_limits_that_do_not_exist_are_refused(quarry):
    with pytest.raises(InputError, match=r"limit curve: one of .*got 'none'"):
        learn_site(quarry, limit_curve="none")
    with pytest.raises(InputError, match="air limit: must be positive, got -1"):
        learn_site(quarry, air_limit=-1.0)


def test_a_limit_of_a_share_of_blasts_is_judged(quarry):
    rule = ("--most", 3, "--ceiling", 10, "--since", "2025-01-01", "--until", "2025-12-31")

    done = call("site", quarry, *rule)

    assert done.exit_code == 0, done.output
    summary = json.loads((quarry / "site" / "site.json").read_text())
    for row in summary["statistical"]["stations"]:
        peaks = [each["peak"] for each in summary["records"]
                 if each["station"] == row["station"] and each["time"] >= "2025"]  # fmt: skip
        silent = [each for each in summary["silent"] if each["station"] == row["station"]]
        assert row["blasts"] == len(peaks) + len(silent)
        assert row["over"] == sum(peak > 3e-3 for peak in peaks)
        assert f"{row['station']}: {100 * row['share']:.3g} %" in done.output
    for wrong in (("--ceiling", 3), ("--most", 3, "--since", "soon"), ("--most", 3, "--share", 2)):
        assert call("site", quarry, *wrong).exit_code == 2


def test_one_vertical_channel_at_one_station_without_charges_is_still_compared(quarry):
    for path in (quarry / "records").iterdir():
        if path.name.startswith("farm"):
            head, rows = path.read_text().split('"Tran","Vert","Long"\n')
            body = "\n".join(line.split(",")[1] for line in rows.splitlines())
            path.write_text(f'{head}"Vert"\n{body}\n')
        else:
            path.unlink()
    lines = (quarry / "blasts.csv").read_text().splitlines()
    (quarry / "blasts.csv").write_text("\n".join(line.rsplit(",", 2)[0] for line in lines) + "\n")

    done = call("site", quarry)

    assert done.exit_code == 0, done.output
    summary = json.loads((quarry / "site" / "site.json").read_text())
    assert len(summary["records"]) == 24
    assert all(row["quantity"] == "vertical" for row in summary["records"])
    assert summary["law"]["refused"] == "the log lacks charges"
    assert summary["changes"] == summary["forecasts"] == []


def test_where_distances_are_few_the_exponent_of_a_published_law_is_taken(quarry):
    for path in (quarry / "records").iterdir():
        if not path.name.startswith("farm"):
            path.unlink()

    done = call("site", quarry)

    law = json.loads((quarry / "site" / "site.json").read_text())["law"]
    assert "span a factor of" in law["fixed"]
    assert law["beta"] == HARD_ROCK.beta
    assert "an exponent that is taken, not fitted" in done.output
    at = int(np.argmin(np.abs(np.array(law["scaled_distance"]) - 45.0)))
    assert law["levels"]["0.5"][at] == pytest.approx(0.6 * 45.0**-1.5, rel=0.35)


def test_air_overpressure_has_its_law_and_limit(quarry):
    for path in (quarry / "records").iterdir():
        head, rows = path.read_text().split('"Tran","Vert","Long"\n')
        lines = rows.splitlines()
        peak = max(abs(float(value)) for value in lines[60].split(","))
        mic = [0.0] * len(lines)
        mic[70] = 20.0 * peak
        body = "\n".join(f"{line},{value:.3f}" for line, value in zip(lines, mic, strict=True))
        head = head.replace('"Units","mm/s"', '"Units","mm/s and pa"')
        path.write_text(f'{head}"Tran","Vert","Long","MicL"\n{body}\n')

    summary, _ = learn_site(quarry, air_limit=10.0)

    pressures = [row["overpressure"] for row in summary["records"]]
    assert all(np.isfinite(pressures))
    assert [row["air_share"] for row in summary["records"]] == pytest.approx(
        [pressure / 10.0 for pressure in pressures]
    )


def with_hole_tables(folder):
    """Give each blast of the log a hole table; make the second one a single hole."""
    (folder / "holes").mkdir()
    head, *lines = (folder / "blasts.csv").read_text().splitlines()
    rows = []
    for n, line in enumerate(lines):
        cells = line.split(",")
        count = 1 if n == 1 else 6 + n % 5
        table = ["hole,x_m,y_m,z_m,charge_kg,delay_ms"] + [
            f"{k},{float(cells[3]) + 3 * k:g},{cells[4]},0,{cells[5]},{25 * k}"
            for k in range(count)
        ]
        (folder / "holes" / f"{n}.csv").write_text("\n".join(table) + "\n")
        rows.append(f"{line},holes/{n}.csv")
    (folder / "blasts.csv").write_text("\n".join([f"{head},holes", *rows]) + "\n")


def test_a_recorded_hole_forecasts_by_superposition_beside_the_law(quarry):
    with_hole_tables(quarry)

    done = call("site", quarry)

    assert done.exit_code == 0, done.output
    summary = json.loads((quarry / "site" / "site.json").read_text())
    assert {row["method"] for row in summary["forecasts"]} == {"law", "superposition"}
    counts = summary["coverage"]["superposition"]["forecasts"], len(summary["records"])
    assert 40 < counts[0] <= counts[1] - 3 * 7
    for row in summary["forecasts"]:
        assert row["band"][0] < row["median"] < row["band"][1]
        assert row["frequency_band"][0] < row["frequency"] < row["frequency_band"][1]
    assert "by superposed holes" in done.output
    assert summary["model"] == summary["projects"] == []


def run_of(folder, number, sent, factor):
    """Write the run of a project that reads a hole table, with peaks of the records by a factor."""
    digest = hashlib.sha256((folder / "holes" / f"{number}.csv").read_bytes()).hexdigest()
    receivers = {
        name: {"position": [0, 0, 0],
               "simulated": {"ppv": [peak / factor, 1e-5, None],
                             "zero_crossing_frequency": [18.0, None, None]}}
        for name, peak in sent.items()
    }  # fmt: skip
    place = folder / "results" / f"{number + 1:03d}"
    (place / "curves").mkdir(parents=True)
    (place / "summary.json").write_text(json.dumps({
        "receivers": receivers, "files_sha256": {"holes.csv": digest},
        "sources": {"holes": [{"position": [0, 0, 0], "charge": 50.0}] * 6},
    }))  # fmt: skip
    (place / "receivers.csv").write_text("receiver,ppv\nfarm,2\n")


def test_runs_of_a_project_forecast_and_are_compared_blast_by_blast(quarry):
    with_hole_tables(quarry)
    before, _ = learn_site(quarry)
    (quarry / "quarry.toml").write_text("[mesh]\n")
    number = {row["name"]: n for n, row in enumerate(before["blasts"])}
    for name, n in number.items():
        sent = {row["station"]: row["peak"] for row in before["records"] if row["blast"] == name}
        run_of(quarry, n, sent or {"farm": 2e-3}, 2.0)

    summary, _ = learn_site(quarry)

    assert [row["file"] for row in summary["skipped"]] == ["quarry.toml"]
    assert {row["station"] for row in summary["model"]} == {"farm", "school", "mill"}
    for row in summary["model"]:
        assert row["median"] == pytest.approx(2.0)
        assert row["per_year"] == pytest.approx(1.0, abs=0.01)
    (row,) = [row for row in summary["forecasts"] if row["method"] == "model"]
    assert (row["station"], row["median"]) == ("farm", pytest.approx(2e-3))
    page = (quarry / "site" / "report.html").read_text()
    assert "pyblast diagnose quarry.toml, with records of blasts from B13 on" in page
    assert "Records over the model" in page
    (quarry / "results" / "003" / "summary.json").write_text('{"receivers": {"farm": 1}')
    assert learn_site(quarry)[0]["model"][0]["records"] < 24


def test_one_modelled_hole_is_superposed_over_the_hole_tables(quarry):
    with_hole_tables(quarry)
    run_of(quarry, 1, {"farm": 1e-3}, 1.0)
    place = quarry / "results" / "002"
    run = json.loads((place / "summary.json").read_text())
    run["sources"]["holes"] = [{"position": [300.0, 0, 0], "charge": 50.0}]
    (place / "summary.json").write_text(json.dumps(run))
    times = np.arange(200) / 500.0
    wave = 1e-3 * np.sin(2.0 * np.pi * 18.0 * times) * np.exp(-times / 0.08)
    rows = [f"{t:.6f},{v:.9g},{0.5 * v:.9g},0" for t, v in zip(times, wave, strict=True)]
    head = "time_s,longitudinal_m_per_s,transverse_m_per_s,vertical_m_per_s"
    (place / "curves" / "simulated_farm.csv").write_text("\n".join([head, *rows]) + "\n")

    summary, _ = learn_site(quarry)

    (farm,) = summary["model"]
    assert farm["records"] == 24
    assert 0.1 < farm["median"] < 10.0
