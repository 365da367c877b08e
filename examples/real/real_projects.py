"""Loader: turns a set of recordings into project files and records for `pyblast diagnose`."""

import json
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from pyblast import read_gather
from pyblast.recordings.seismic import mseed_bytes

ANY_START = "2000-01-01T00:00:00"


@dataclass(frozen=True)
class ShotRecords:
    """Records of one shot, one component.

    ``data`` (n_receivers, n_samples) along the axis ``code`` (Z up, N north), from ``start`` s
    after the shot; ``position`` of the shot, ``force`` its direction.
    """

    name: str
    position: tuple
    data: np.ndarray
    dt: float
    start: float
    receivers: dict = field(default_factory=dict)
    code: str = "Z"
    force: tuple = (0.0, 0.0, -1.0)


def wghs_shots(folder):
    """Return the 30 hits of the Wellington line, named by place and number."""
    shots, count = [], {}
    for path in sorted(Path(folder, "wghs").glob("*.dat"), key=lambda p: int(p.stem)):
        gather = read_gather(path)
        place = float(gather.source_position[0])
        count[place] = count.get(place, 0) + 1
        receivers = {f"G{n + 1:02d}": (2.0 * n, 0.0) for n in range(len(gather.data))}
        name = f"hit_{'m' if place < 0 else ''}{abs(place):.0f}_{count[place]}"
        shots.append(ShotRecords(name, (place, 0.0), gather.data, gather.dt,
                                 float(gather.times[0]), receivers))  # fmt: skip
    return shots


def write_project(out, ground, shots, force, diagnosis):
    """Write one project file to each shot into a folder; return the first.

    ``ground`` is the text of the tables of the ground, ``force`` (times, values), ``diagnosis``
    the further keys of the table [diagnosis].
    """
    out = Path(out)
    out.mkdir(parents=True, exist_ok=True)
    rows = "".join(f"{t:.9g},{f:.6g}\n" for t, f in zip(*force, strict=True))
    (out / "force.csv").write_text("time_s,force_n\n" + rows, encoding="utf-8")
    names = [f"{shot.name}.toml" for shot in shots]
    places = {name: place for shot in shots for name, place in shot.receivers.items()}
    places = dict(sorted(places.items()))  # the same in all files, so that they share runs
    for shot in shots:
        first = shot is shots[0]
        keys = {"blasts": names[1:], **diagnosis} if first else diagnosis
        (out / f"{shot.name}.toml").write_text(
            _project(ground, shot, keys, places), encoding="utf-8"
        )
        (out / f"{shot.name}.mseed").write_bytes(_records(shot))
    return out / names[0]


def _project(ground, shot, diagnosis, places):
    """Return the text of a project file of one shot."""
    table = "".join(f"{key} = {json.dumps(value)}\n" for key, value in diagnosis.items())
    there, receivers = recorded(shot), ""
    for name, place in places.items():
        receivers += f"\n[[receivers]]\nname = {json.dumps(name)}\n"
        receivers += f"position_m = {json.dumps(list(place))}\n"
        if name in there:
            receivers += (
                f'recorded = {{ file = "{shot.name}.mseed", record = {there.index(name) + 1}, '
                f'unit = "m_per_s", start_s = {shot.start!r} }}\n'
            )
    return (
        f'title = "{shot.name}"\n\n{ground}\n[[point_forces]]\n'
        f"position_m = {json.dumps(list(shot.position))}\n"
        f'direction = {json.dumps(list(shot.force))}\nfile = "force.csv"\n\n'
        f"[diagnosis]\n{table}{receivers}"
    )


def _records(shot):
    """Return the records of a shot as miniSEED, one station a receiver."""
    there = recorded(shot)
    rows = [list(shot.receivers).index(name) for name in there]
    names = [[f"PB.{name}..HH{shot.code}"] for name in there]
    return mseed_bytes(shot.data[rows][:, None], names, shot.dt, ANY_START)


def recorded(shot):
    """Return the names of the receivers that have a record."""
    names = zip(shot.receivers, shot.data, strict=True)
    return [name for name, samples in names if np.isfinite(samples).all()]


WGHS_GROUND = """
[mesh]
size_m = [98.0, 10.0, 12.0]
origin_m = [-26.0, 0.0, -12.0]
frequency_hz = 35.0
accuracy = 0.05

[[mesh.layers]]
material = "dry"
thickness_m = 2.4

[[mesh.layers]]
material = "wet"

[materials.dry]
density_kg_per_m3 = 1900.0
cp_m_per_s = 380.0
cs_m_per_s = 178.0

[materials.dry.damping]
ratio = 0.05
frequency_hz = 20.0
mass = false

[materials.wet]
density_kg_per_m3 = 1900.0
cp_m_per_s = 1400.0
cs_m_per_s = 231.0

[materials.wet.damping]
ratio = 0.03
frequency_hz = 15.0
stiffness = false

[boundaries]
viscous = ["west", "east", "north", "bottom"]
roller = ["south"]

[run]
duration_s = 0.4
"""


def ricker(peak=18.0, dt=1e-3):
    """Return times s and force N of a zero-phase pulse, late by 80 ms: a hammer is unknown."""
    times = dt * np.arange(200)
    x = (np.pi * peak * (times - 0.08)) ** 2
    return times, 1e3 * (1.0 - 2.0 * x) * np.exp(-x)
