"""Signals at random moments of commands on a small project: the same answer after going on.

    python -m verification.faults [COUNT] [--seed N] [--again] [--minutes N]

Makes a project of one box with a fault, three holes and three records, and runs ``run``,
``backanalyse``, ``diagnose`` and ``delays`` on it to the end: their answers are the reference. Then
each is ended by SIGTERM or SIGKILL at random moments and started again with the same words. The
second command must end well, its answer must hold the bits of the reference, and two seconds after
the signal no process of the first may run. Writes the rows that ``verification/faults.json``
lacks; COUNT 5 of each command, seed 2026, 25 minutes unless given otherwise.
"""

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from shutil import copytree

import numpy as np

from pyblast.project.project import load_project
from pyblast.project.result import read_result, write_csv

from .rows import draws, each_row

OUT = Path(__file__).with_suffix(".json")
SEED, COUNT, MINUTES = 2026, 5, 25.0
SIGNALS = ("SIGTERM", "SIGKILL")
PATIENCE = 2.0  # seconds after which no process of an ended command may run
NOISE = 2e-5  # m/s of a sample of the records
RATE, BEFORE, LENGTH = 256, 0.3, 0.7  # samples a second; seconds
GROUND = """
title = "Three holes"
[mesh]
size_m = [60, 20, 30]
grid_cells = [12, 4, 6]
[[mesh.layers]]
material = "rock"
[[mesh.faults]]
name = "F1"
dip_deg = 90
dip_direction_deg = 90
through_m = [30, 0, 0]
[materials.rock]
density_kg_per_m3 = 2600
cp_m_per_s = 3000
cs_m_per_s = 1700
[joints.F1]
law = "elastic"
kn_gpa_per_m = 0.5
ks_gpa_per_m = 0.2
[boundaries]
viscous = ["west", "east", "south", "north", "bottom"]
free = ["top"]
[damping]
ratio = 0.02
frequency_hz = 20
[blast]
rows = 1
holes_per_row = 3
delay_ms = 10
charge_kg = 50
diameter_mm = 115
depth_m = 12
burden_m = 3
spacing_m = 4
position_m = [14, 10, 30]
[holes_inside.charged_hole]
material = "rock"
charge_kg = 50
radius_m = 0.5
pressure_mpa = 100
peak_time_ms = 40
"""
KNOWN = "peak_mm_per_s = 40\ndistance_m = 30"  # the level, as measured
RUN = """
[run]
duration_s = 0.4
compare_band_hz = [3, 20]
"""
RECEIVER = """
[[receivers]]
name = "{name}"
position_m = {at}
azimuth_deg = 90
"""
RECORDED = """
[receivers.recorded]
file = "{name}.csv"
bearing_deg = 90
"""
RECEIVERS = {"R0": [34, 4], "R1": [42, 15], "R2": [52, 10]}
SEARCH = """
[back_analysis]
runs = 12
[[back_analysis.parameters]]
path = "joints.F1.kn_gpa_per_m"
low = 0.1
high = 3
log = true
[[back_analysis.parameters]]
path = "joints.F1.ks_gpa_per_m"
low = 0.05
high = 1
log = true
"""
DELAYS = """
[delays]
between_holes_ms = [5, 40]
between_rows_ms = [0, 0]
draws = 400
band_hz = [3, 20]
[[delays.houses]]
name = "R2"
limit_mm_per_s = 5
"""
# Words of each command, folder and file of its answer, what its project has beside the ground.
COMMANDS = {
    "run": (["--accept-findings"], "results", "result.h5", ""),
    "backanalyse": (["--workers", "2"], "back_analysis", "back_analysis.json", SEARCH),
    "diagnose": (["--budget", "1", "--workers", "2"], "diagnosis", "diagnosis.json", "[diagnosis]"),
    "delays": ([], "delays", "delays.json", DELAYS),
}
# What depends on when and how often a command was run.
PASSING = {"wall_s", "wall_seconds", "seconds", "kept_s", "kept_runs", "runs", "finished", "load"}


def text_of(further: str, recorded: str = RECORDED) -> str:
    """Return a project file: ground, receivers with their records, and further tables."""
    parts = (RECEIVER + recorded).format
    ground = GROUND.replace("pressure_mpa = 100", KNOWN) + RUN
    return "".join([ground, *(parts(name=name, at=at) for name, at in RECEIVERS.items()), further])


@cache
def records() -> Path:
    """Write the records, which the ground itself made, with noise; return their folder."""
    folder, rng = Path(tempfile.mkdtemp(prefix="faults-")), np.random.default_rng(SEED)
    path = folder / "made.toml"
    path.write_text(text_of("", ""), encoding="utf-8")
    for name, motion in load_project(path).simulate().seismograms.items():
        motion = motion.sampled(-BEFORE, 1.0 / RATE, int(RATE * LENGTH))
        noise = NOISE * rng.normal(size=motion.velocity.shape)
        write_csv(folder / f"{name}.csv", replace(motion, velocity=motion.velocity + noise))
    return folder


@cache
def reference(command: str) -> tuple[object, float]:
    """Return the answer of a command that nothing disturbs, and the seconds that it took."""
    with tempfile.TemporaryDirectory() as made:
        folder = project_in(Path(made), command)
        began = time.perf_counter()
        done = begin(folder, command)
        if done.wait() != 0:
            raise SystemExit(f"faults: {command} undisturbed ends with {done.returncode}")
        return answer(folder, command), time.perf_counter() - began


def project_in(folder: Path, command: str) -> Path:
    """Write the project of a command and its records into a folder."""
    copytree(records(), folder, dirs_exist_ok=True)
    (folder / "project.toml").write_text(text_of(COMMANDS[command][3]), encoding="utf-8")
    return folder


def begin(folder: Path, command: str) -> subprocess.Popen:
    """Start a command in a session of its own; what it says goes into ``said.txt``."""
    words = [sys.executable, "-m", "pyblast", command, "project.toml", *COMMANDS[command][0]]
    with (folder / "said.txt").open("w") as said:
        return subprocess.Popen(words, cwd=folder, stdout=said, stderr=said, text=True,
                                start_new_session=True)  # fmt: skip


def answer(folder: Path, command: str) -> object:
    """Return what a command found, without what depends on when and how often it was run."""
    _, out, name, _ = COMMANDS[command]
    path = sorted((folder / out).glob(f"[0-9]*/{name}"))[-1]
    if path.suffix == ".json":
        return lasting(json.loads(path.read_text(encoding="utf-8")))
    result = read_result(path)
    arrays = {f"{g}/{n}": v.tobytes() for g, some in result.arrays.items() for n, v in some.items()}
    return lasting(result.summary), arrays


def lasting(table: object) -> object:
    """Return a table without the keys `PASSING`, at every depth."""
    if isinstance(table, dict):
        return {key: lasting(value) for key, value in table.items() if key not in PASSING}
    return [lasting(value) for value in table] if isinstance(table, list) else table


def running(session: int) -> Iterator[int]:
    """Yield the processes of a session that run."""
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, _, _, its_session = stat.read_text().rpartition(")")[2].split()[:4]
        except OSError:
            continue
        if int(its_session) == session and state != "Z":
            yield int(stat.parent.name)


def share_of(command: str, number: int, seed: int) -> float:
    """Return the moment of a signal, over the seconds of a command."""
    return float(np.random.default_rng([seed, number, *command.encode()]).random())


def row(name: str) -> dict:
    """End a command by a signal at a moment, start it again, and compare its answer."""
    command, fault, number, seed = name.split()
    expected, whole = reference(command)
    share = share_of(command, int(number), int(seed))
    with tempfile.TemporaryDirectory() as made:
        folder = project_in(Path(made), command)
        first = begin(folder, command)
        time.sleep(share * whole)
        first.send_signal(getattr(signal, fault))
        first.wait()
        ends = time.monotonic() + PATIENCE
        while (left := list(running(first.pid))) and time.monotonic() < ends:
            time.sleep(0.05)
        told = (folder / "said.txt").read_text().splitlines()
        code = begin(folder, command).wait()
        said = (folder / "said.txt").read_text()
        same = code == 0 and answer(folder, command) == expected
    for process in left:
        os.kill(process, signal.SIGKILL)
    return {
        "command": f"pyblast {command}", "fault": fault, "moment": round(share, 3),
        "of_s": round(whole, 1), "code": first.returncode, "told": (told or [""])[-1],
        "still_running": len(left), "goes_on": "goes on with" in said, "then": code,
        "result": "the same" if same else "another",
    }  # fmt: skip


def main(arguments: list[str]) -> int:
    """Compute the rows that the file lacks; return 1 if one of them all is no good."""
    seed, count, limits = draws(arguments, SEED, COUNT, MINUTES)
    names = [f"{c} {SIGNALS[n % 2]} {n} {seed}" for n in range(count) for c in COMMANDS]
    rows = each_row(OUT, names, row, **limits)
    bad = [n for n, r in rows.items() if r["result"] != "the same" or r["still_running"]]
    print(f"faults: {len(rows)} moments, {len(bad)} of them with another answer or processes left")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
