"""The one result file of a run: arrays by name, tables and provenance, readable with plain h5py."""

import json
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..errors import ReadError
from ..motion.seismogram import Seismogram
from ..solving.model_file import read_arrays, write_arrays

KIND = "result"


@dataclass(frozen=True, eq=False)
class Result:
    """What a run leaves: arrays by group and name, and a summary of plain numbers and words.

    Parameters
    ----------
    arrays : dict of str to dict of str to numpy array
        Groups ``mesh``, ``contacts``, ``zones``, ``energy``, ``state``, ``input``, ``simulated``,
        ``recorded``, ``snapshots``; seismograms (n_samples, 3) in m/s. ``sources`` (n, 2): time in
        s, and moment rate of 1 kg in N m/s or force in N.
    summary : dict
        Holds only what JSON knows.
    """

    arrays: dict[str, dict[str, np.ndarray]]
    summary: dict

    def seismogram(self, group, name) -> Seismogram:
        """Return a seismogram of ``input``, ``simulated`` or ``recorded``."""
        head = self.summary["seismograms"][group][name]
        return Seismogram(
            self.arrays[group][name], head["dt"], head["start"], name, tuple(head["components"])
        )

    def seismograms(self, group) -> dict[str, Seismogram]:
        """Return all seismograms of a group."""
        return {name: self.seismogram(group, name) for name in self.summary["seismograms"][group]}


def seismogram_heads(groups):
    """Return sampling and components of seismograms by group and name, for the summary."""
    return {
        group: {
            name: {"dt": s.dt, "start": s.start, "components": list(s.components)}
            for name, s in members.items()
        }
        for group, members in groups.items()
    }


def write_result(path, result):
    """Write a result file, whole or not at all.

    Parameters
    ----------
    path : path
    result : Result

    Raises
    ------
    ReadError
        If the place can't be written.
    """
    text = np.frombuffer(json.dumps(plain(result.summary)).encode(), dtype=np.uint8)
    provenance = result.summary.get("provenance", {})
    attributes = {"kind": KIND, "title": result.summary["title"], **provenance}
    told = {
        f"{group}/{name}": {
            "unit": "m/s", "dt_s": head["dt"], "start_s": head["start"],
            "components": head["components"],
        }
        for group, heads in result.summary.get("seismograms", {}).items()
        for name, head in heads.items()
    }  # fmt: skip
    write_arrays(path, {**result.arrays, "summary": {"json": text}}, attributes, told)


def read_result(path) -> Result:
    """Read a result file.

    Raises
    ------
    ReadError
        If it is no result file or incomplete.
    """
    if not Path(path).is_file():
        raise ReadError(f"{path}: no such file; give the folder of a run or its result.h5")
    arrays, attributes = read_arrays(path)
    if attributes.get("kind") != KIND or "json" not in arrays.get("summary", {}):
        raise ReadError(f"{path}: not a result file of pyblast; give result.h5 of a run")
    try:
        summary = json.loads(arrays.pop("summary")["json"].tobytes())
    except (ValueError, RecursionError):
        raise ReadError(f"{path}: its summary is damaged; run the project again") from None
    return Result(arrays, summary)


def write_text(path, text):
    """Write a text file beside its place, flush it and rename it."""
    write_bytes(path, text.encode("utf-8"))


def write_bytes(path, content):
    """Write a file beside its place, flush it and rename it."""
    path = Path(path)
    beside = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        with beside.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        beside.replace(path)
    except OSError as error:
        raise ReadError(f"{path}: can't be written ({error.strerror or error})") from None
    finally:
        beside.unlink(missing_ok=True)


def write_summary(path, summary):
    """Write the summary as JSON that a person can read."""
    write_text(path, json.dumps(plain(summary), indent=1) + "\n")


def write_csv(path, seismogram):
    """Write a seismogram as a table in m/s that `read_recording` reads again."""
    heads = ["time_s", *(f"{name}_m_per_s" for name in seismogram.components)]
    rows = np.column_stack([seismogram.times, seismogram.velocity])
    lines = [",".join(f"{value:.9g}" for value in row) for row in rows]
    write_text(path, "\n".join([",".join(heads), *lines]) + "\n")


def plain(value):
    """Turn numpy numbers and arrays into what JSON knows; numbers that are none become null."""
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [plain(item) for item in value]
    if isinstance(value, (bool, np.bool_)):
        return bool(value)
    if isinstance(value, (int, np.integer)):
        return int(value)
    if isinstance(value, (float, np.floating)):
        return float(value) if np.isfinite(value) else None
    return value
