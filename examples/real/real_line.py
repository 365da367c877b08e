"""Real recordings beside the repository: where they are, hits by place, channels as seismograms."""

import json
import os
import sys
from pathlib import Path

import numpy as np

from pyblast import Seismogram, read_gather

REPOSITORY = Path(__file__).resolve().parents[2]
FIGURES = REPOSITORY / "docs" / "figures"
RESULTS = Path(__file__).with_name("results.json")
WINDOW = (-0.1, 0.9)
EDGE = 0.05


def recordings_folder(arguments=()):
    """Return the folder of recordings, or end with one sentence where it is absent."""
    beside = REPOSITORY.parent / "shared" / "recordings"
    folder = Path(arguments[0] if arguments else os.environ.get("PYBLAST_RECORDINGS", beside))
    if not folder.is_dir():
        sys.exit(f"{folder}: no recordings; examples/real/README.md says where to fetch them")
    return folder


def hits_by_place(folder):
    """Read all gathers of a folder; lists by the source's place along the line [m]."""
    places = {}
    for path in sorted(Path(folder).glob("*.dat"), key=lambda path: int(path.stem)):
        gather = read_gather(path)
        places.setdefault(float(gather.source_position[0]), []).append(gather)
    return dict(sorted(places.items()))


def seismograms(gather, window=WINDOW):
    """Return a vertical seismogram per channel, mean removed, ends tapered by cosines.

    The samples are volts, not m/s: the sensitivity is not in the files, and nothing here
    depends on it.
    """
    motion = gather.data - gather.data[:, gather.times < 0.0].mean(axis=1, keepdims=True)
    kept = (gather.times > window[0] - 1e-9) & (gather.times < window[1] + 1e-9)
    times = gather.times[kept]
    ends = np.minimum(times - times[0], times[-1] - times) / EDGE
    taper = 0.5 - 0.5 * np.cos(np.pi * np.clip(ends, 0.0, 1.0))
    return [vertical(column, gather.dt, times[0]) for column in motion[:, kept] * taper]


def vertical(samples, dt, start=0.0):
    """Make a seismogram of a vertical geophone; the other components were not recorded."""
    unknown = np.full(len(samples), np.nan)
    return Seismogram(np.column_stack([unknown, unknown, samples]), dt, start)


def keep_results(section, values):
    """Write one section of results.json, rounded to 5 digits."""
    results = json.loads(RESULTS.read_text(encoding="utf-8")) if RESULTS.is_file() else {}
    results[section] = json.loads(
        json.dumps(values), parse_float=lambda text: float(f"{float(text):.5g}")
    )
    RESULTS.write_text(json.dumps(results, indent=1, sort_keys=True) + "\n", encoding="utf-8")
