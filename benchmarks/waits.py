"""What users wait for: a site from file to report, checks; demo, tests and the mine with --long.

Wall seconds of the commands themselves, as a user starts them. The demo and the tests run in a
fresh clone of the last commit, set-up included; the site comes from PYBLAST_SITES (default
``../shared/sites``) and is left out where it is missing.
"""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from verification.sites_forward import SITES, compared

from .timing import stamp

TITLE = "What users wait for"
ROOT = Path(__file__).resolve().parents[1]
PYBLAST = Path(sys.executable).with_name("pyblast")
MINE = ROOT / "examples" / "gol_e_gohar" / "project.toml"
CHECKED = ("bench", "fault_from_records", "fractures", "gol_e_gohar", "holes_inside", "rock_mass")


def measure(effort):
    """Return by name the seconds of what is waited for, each with machine, load and date."""
    jobs = {"check": checks, "site": site}
    if effort == "quick":
        jobs = {"check": lambda: checks(("holes_inside", "rock_mass"))}
    if effort == "long":
        jobs |= {"mine": mine, "demo": lambda: fresh("demo"), "tests": lambda: fresh("test")}
    found = {name: job() for name, job in jobs.items()}
    return {name: {**one, **stamp()} for name, one in found.items() if one}


def waited(*command, folder=ROOT, **environment):
    """Return the wall seconds of a command; 3 says that a finding failed, which is no fault."""
    began = time.perf_counter()
    done = subprocess.run(
        command, cwd=folder, capture_output=True, text=True, check=False,
        env={**os.environ, **environment},
    )  # fmt: skip
    if done.returncode not in (0, 3):
        raise RuntimeError(f"{command[0]} ended with {done.returncode}: {done.stderr[-400:]}")
    return time.perf_counter() - began


def checks(names=CHECKED):
    """Return the longest check of the examples."""
    seconds = {
        name: waited(PYBLAST, "check", ROOT / "examples" / name / "project.toml") for name in names
    }
    slowest = max(seconds, key=seconds.get)
    return {"slowest_s": seconds[slowest], "slowest": slowest}


def site():
    """Return seconds from file to report of a site of a quarry, of its run, and its errors.

    Those of the processor, too, which other work on the machine changes less.
    """
    folder = SITES / "case-04"
    if not folder.is_dir():
        return None
    with tempfile.TemporaryDirectory() as out:
        command = PYBLAST, "run", folder / "S1.toml", "--out", out
        before = sum(os.times()[2:4])
        seconds = waited(*command, OMP_NUM_THREADS="2")
        processor = sum(os.times()[2:4]) - before
    row = compared(folder / "S1.toml", SITES / "truth" / "case-04" / "believed_S1.mseed")
    return {
        "file_to_report_s": seconds, "file_to_report_processor_s": processor,
        "march_s": row["run_s"], "error": row["error_median"], "worst": row["error_worst"],
    }  # fmt: skip


def mine():
    """Return seconds from file to report of the mine of the paper at 5 m."""
    with tempfile.TemporaryDirectory() as out:
        command = PYBLAST, "run", MINE, "--full", "--accept-findings", "--out", out
        return {"file_to_report_s": waited(*command)}


def fresh(job):
    """Return the seconds of a job of ``dev`` in a fresh clone, with all set-up."""
    with tempfile.TemporaryDirectory() as folder:
        clone = Path(folder) / "pyblast"
        subprocess.run(["git", "clone", "--quiet", ROOT, clone], check=True)
        return {"seconds": waited("./dev", job, folder=clone)}


def lines(found):
    """Return the table of this part."""
    told = ["Wall seconds of commands, on two threads.", "", "| what | s | on |", "|---|---|---|"]
    labels = {
        "check": ("longest check of the examples", "slowest_s"),
        "site": ("site case-04, blast S1, file to report", "file_to_report_s"),
        "mine": ("mine at 5 m, file to report", "file_to_report_s"),
        "demo": ("`./dev demo` in a fresh clone, with set-up", "seconds"),
        "tests": ("`./dev test` in a fresh clone, with set-up", "seconds"),
    }
    for name, (label, key) in labels.items():
        if name in found:
            one = found[name]
            where = f"{one['machine']['processor']}, {one['date']}, load {one['load']:.1f}"
            told.append(f"| {label} | {one[key]:.1f} | {where} |")
            if "file_to_report_processor_s" in one:
                seconds = one["file_to_report_processor_s"]
                told.append(f"| the same, of the processor | {seconds:.1f} | {where} |")
    return told
