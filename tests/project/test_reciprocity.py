"""Reciprocity along an axis: one run gives all pairs of sensor and shot, at any speed."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from pyblast.errors import InputError
from pyblast.model.model import Receiver
from pyblast.model.source import PointForce, TimeFunction
from pyblast.project.project import Project
from pyblast.project.reciprocity import mirrored_across, responses, same_along
from pyblast.solver.run import simulate

DT, DURATION = 5e-7, 4e-5
BAND = signal.butter(4, (50e3, 100e3), "bandpass", fs=1.0 / DT, output="sos")
TIMES = 1e-7 * np.arange(160)
FORCE = TimeFunction(np.sin(np.pi * np.minimum(TIMES / 1.6e-5, 1.0)) ** 2, 1e-7)
SHOTS = np.array([[0.5, 0.005, 0.0], [0.55, -0.01, 0.0], [0.62, 0.0, 0.0]])
SENSORS = (
    Receiver("N", (0.54, 0.05, -0.03), normal=(0.0, 1.0, 0.0)),
    Receiver("S", (0.58, -0.05, -0.03), normal=(0.0, -1.0, 0.0)),
    Receiver("N", (0.54, 0.05, -0.03), normal=(0.0, 1.0, 0.0)),
)


def block(factor=1.0, **boundaries):
    """Return a piece of a block of 0.1 x 0.06 m between viscous ends."""
    rock = {"density_kg_per_m3": 2980.0, "cp_m_per_s": factor * 6200.0,
            "cs_m_per_s": factor * 3600.0}  # fmt: skip
    sides = {"viscous": ["west", "east"], "free": ["top", "south", "north", "bottom"]}
    return Project.from_dict({
        "title": "block",
        "mesh": {"size_m": [0.4, 0.1, 0.06], "origin_m": [0.4, -0.05, -0.06],
                 "layers": [{"material": "rock"}], "frequency_hz": 110e3, "accuracy": 0.01},
        "materials": {"rock": rock}, "boundaries": {**sides, **boundaries},
        "point_forces": [{"position_m": [0.5, 0.0, 0.0], "direction": [0, 0, -1],
                          "file": "force.csv"}],
        "receivers": [{"name": "A", "position_m": [0.5, 0.05, -0.03]}],
        "run": {"duration_s": DURATION, "compare_band_hz": [50e3, 100e3]},
    })  # fmt: skip


@pytest.fixture(autouse=True)
def force_file(tmp_path, monkeypatch):
    """Write the force beside the project."""
    monkeypatch.chdir(tmp_path)
    rows = "\n".join(f"{t:.8f},{f:.8f}" for t, f in zip(TIMES, FORCE.values, strict=True))
    (tmp_path / "force.csv").write_text(f"time_s,force_n\n{rows}\n")


def direct(project, sensor, shot):
    """Return the motion along the normal of a sensor by a run of its shot."""
    source = PointForce(shot, np.array([0.0, 0.0, -1.0]), FORCE)
    model = replace(project.model, sources=[source], receivers=(sensor,))
    record = simulate(model, DURATION).seismograms[sensor.name]
    return record.sampled(0.0, DT, 70).velocity @ sensor.normal


def test_one_run_gives_the_motion_of_every_pair():
    project = block()

    found = responses(project, SENSORS, SHOTS, (0, 0, -1), duration=DURATION, dt=DT)

    assert found.runs == 1
    motion = found.driven(FORCE)[:, :70]
    for sensor, shot, each in zip(SENSORS, SHOTS, motion, strict=True):
        run = direct(project, sensor, shot)
        run, each = signal.sosfiltfilt(BAND, np.pad([run, each], ((0, 0), (200, 200))))
        assert np.sum((each - run) ** 2) < 2e-3 * np.sum(run**2)


def test_walls_that_differ_take_a_run_for_each():
    project = block(viscous=["west", "east", "south"], free=["top", "north", "bottom"])

    found = responses(project, SENSORS[:2], SHOTS[:2], (0, 0, -1), duration=2e-5, dt=DT)

    assert not mirrored_across(project, "x")
    assert found.runs == 2


def test_other_speeds_are_another_clock():
    slow, fast = (
        responses(block(f), SENSORS[:1], SHOTS[:1], (0, 0, -1), duration=DURATION, dt=DT)
        for f in (1.0, 1.04)
    )

    scaled, run = slow.faster(1.04).driven(FORCE)[0, :70], fast.driven(FORCE)[0, :70]

    assert np.sum((scaled - run) ** 2) < 2e-3 * np.sum(run**2)
    assert np.sum((slow.driven(FORCE)[0, :70] - run) ** 2) > 2e-2 * np.sum(run**2)


def test_the_axis_is_that_between_viscous_ends():
    assert same_along(block()) == "x"
    assert same_along(block(viscous=["south", "north"], free=["top", "west", "east"])) == "y"
    assert same_along(block(viscous=["south", "west"], free=["top", "north", "east"])) == ""
    with pytest.raises(InputError, match="run each shot by itself"):
        responses(
            block(viscous=["west"], free=["top", "south", "north", "east"]), SENSORS, SHOTS,
            (0, 0, -1), duration=DURATION, dt=DT,
        )  # fmt: skip
