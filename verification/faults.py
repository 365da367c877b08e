"""Machines that fail at random moments of commands: one sentence, and the same answer afterwards.

    python -m verification.faults [COUNT] [--seed N] [--again] [--minutes N]

Makes a project of one box with a fault, three holes and three records, and runs ``run``,
``backanalyse``, ``diagnose`` and ``delays`` on it to the end: their answers are the reference. Then
each is disturbed at random moments and started again with the same words: ended by SIGTERM, SIGINT
or SIGKILL; its folder of results removed; files limited in size, as on a full disk; names and a
terminal that know ASCII alone. The second command must end well, its answer must hold the bits of
the reference, and two seconds after a signal no process of the first may run; what no signal ends
goes on, or ends by one sentence. Writes the rows that ``verification/faults.json`` lacks; COUNT 6
of each command, seed 2026, 25 minutes unless given otherwise.
"""

import json
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from shutil import copytree, rmtree

import numpy as np

from pyblast.project.project import load_project
from pyblast.project.result import read_result, write_csv

from .rows import draws, each_row

OUT = Path(__file__).with_suffix(".json")
SEED, COUNT, MINUTES = 2026, 6, 25.0
SIGNALS = ("SIGTERM", "SIGKILL", "SIGINT")
FAULTS = (*SIGNALS, "removed", "full", "ascii")
PATIENCE = 2.0  # seconds after which no process of an ended command may run
POOR = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
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
    "diagnose": (
        ["--minutes", "0", "--workers", "2"],
        "diagnosis",
        "diagnosis.json",
        "[diagnosis]",
    ),
    "delays": ([], "delays", "delays.json", DELAYS),
}
# What depends on when and how often a command was run.
PASSING = {"wall_s", "wall_seconds", "seconds", "kept_s", "kept_runs", "runs", "finished", "load"}


def text_of(further: str, recorded: str = RECORDED) -> str:
    """Return a project file: ground, receivers with their records, and further tables."""
    parts = (RECEIVER + recorded).format
    ground = GROUND.replace("pressure_mpa = 100", KNOWN).replace("Three", "Größe ↑, drei") + RUN
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


def begin(folder: Path, command: str, fault: str = "", share: float = 1.0) -> subprocess.Popen:
    """Start a command in a session of its own; what it says goes into ``said.txt``."""
    words = [sys.executable, "-m", "pyblast", command, "project.toml", *COMMANDS[command][0]]
    room = int(10.0 ** (3.0 + 3.0 * share))  # bytes of a file, where the disk is full

    def start() -> None:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # as a shell starts jobs in the background
        if fault == "full":
            resource.setrlimit(resource.RLIMIT_FSIZE, (room, room))

    with (folder / "said.txt").open("w") as said:
        return subprocess.Popen(words, cwd=folder, stdout=said, stderr=said, text=True,
                                start_new_session=True, preexec_fn=start,
                                env=os.environ | (POOR if fault == "ascii" else {}))  # fmt: skip


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


def disturb(command: str, fault: str, share: float, whole: float) -> dict:
    """Disturb a command at a moment, start it again, and compare its answer."""
    expected, out = reference(command)[0], COMMANDS[command][1]
    with tempfile.TemporaryDirectory() as made:
        folder = project_in(Path(made), command)
        first, left = begin(folder, command, fault, share), []
        if fault in SIGNALS:
            time.sleep(share * whole)
            first.send_signal(getattr(signal, fault))
            sent = time.monotonic()
            while (left := list(running(first.pid))) and time.monotonic() < sent + PATIENCE:
                time.sleep(0.05)
        elif fault == "removed":
            time.sleep(share * whole)
            rmtree(folder / out, ignore_errors=True)
        code = first.wait()
        told = (folder / "said.txt").read_text().splitlines()
        then = begin(folder, command).wait()
        said = (folder / "said.txt").read_text()
        same = "the same" if then == 0 and answer(folder, command) == expected else "another"
    for process in left:
        os.kill(process, signal.SIGKILL)
    told = [line for line in told if line.startswith(("pyblast: ", "Traceback"))]
    return {
        "code": code, "told": (told or [""])[-1], "still_running": len(left),
        "goes_on": "goes on with" in said, "then": then, "result": same,
    }  # fmt: skip


def row(name: str) -> dict:
    """Return the row of a name: command, fault, number of the moment, and seed."""
    command, fault, number, seed = name.split()
    share, whole = share_of(command, int(number), int(seed)), reference(command)[1]
    found = disturb(command, fault, share, whole)
    return {"command": f"pyblast {command}", "fault": fault, "moment": round(share, 3),
            "of_s": round(whole, 1), **found}  # fmt: skip


def is_bad(row: dict) -> bool:
    """Tell whether a command left processes or another answer, or ended without a sentence."""
    ends = {"removed": (0, 2), "full": (0, 2), "ascii": (0,)}.get(row["fault"], (row["code"],))
    silent = row["code"] == 2 and not row["told"].startswith("pyblast: ")
    broken = row["code"] not in ends or "Traceback" in row["told"]
    return row["result"] != "the same" or row["still_running"] > 0 or silent or broken


def main(arguments: list[str]) -> int:
    """Compute the rows that the file lacks; return 1 if one of them all is no good."""
    seed, count, limits = draws(arguments, SEED, COUNT, MINUTES)
    names = [f"{c} {FAULTS[n % len(FAULTS)]} {n} {seed}" for c in COMMANDS for n in range(count)]
    rows = each_row(OUT, names, row, **limits)
    bad = [name for name, found in rows.items() if is_bad(found)]
    print(f"faults: {len(rows)} moments, no good: {', '.join(bad) or 'none'}")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
