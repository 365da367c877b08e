"""A box with two joints that slip and open, the bits of its run, a column with one joint."""

import hashlib

import numpy as np

from pyblast.mesh.builder import structured_box
from pyblast.model.boundary import StressInput, Viscous
from pyblast.model.joint import Joint
from pyblast.model.material import Damping
from pyblast.model.model import InSitu, Model, Receiver
from pyblast.model.source import Hole, TimeFunction
from pyblast.signals.seismogram import Seismogram
from verification.columns import ROCK, ricker

DT = 1e-3
TIMES = np.arange(0.0, 0.1, DT)
SIDES = ("west", "east", "south", "north", "bottom")
ALL_SIDES = *SIDES, "top"
PULSE = np.arange(0.0, 0.06, 5e-4)
WEAK = {"kn": 2e9, "ks": 1e9, "cohesion": 0.0, "friction": 0.4, "tension": 0.0}


def shaking(amplitude=0.3):
    motion = amplitude * ricker(TIMES, 25.0)[:, None] * [0.8, 0.5, -0.3]
    return Seismogram(motion, DT)


def slipping_model(**parts):
    """Return a model of over 1024 nodes and zones in which joints slip and open."""
    mesh = structured_box(
        (11, 9, 9), (44.0, 36.0, 36.0), planes={"J1": ("x", 20.0), "J2": ("z", 16.0)}
    ).split(["J1", "J2"])
    parts = {
        "boundaries": [*map(Viscous, SIDES), StressInput("west", shaking())],
        "sources": [Hole(np.array([10.0, 10.0, 20.0]), 9.0, 0.01, TimeFunction(1e10 * TIMES, DT))],
        **parts,
    }
    return Model(
        mesh,
        {"rock": ROCK},
        joints=[Joint(name, "coulomb", WEAK) for name in ("J1", "J2")],
        damping=Damping(0.01, 20.0),
        receivers=[Receiver("A", (40.0, 30.0, 30.0)), Receiver("B", (5.0, 5.0, 36.0), 0.7)],
        insitu=InSitu(),
        **parts,
    )


def sheared(size, **strength):
    """Return a column with one joint that a shear wave crosses."""
    mesh = structured_box((12, 2, 2), (60.0, 10.0, 10.0), planes={"J": ("x", 30.0)}).split(["J"])
    motion = size * ricker(PULSE, 40.0)[:, None] * [0.0, 1.0, 0.0]
    properties = {"kn": 4e9, "ks": 2e9, "cohesion": 2e5, "friction": 0.3, "tension": 1e5}
    return Model(
        mesh, {"rock": ROCK}, [Joint("J", "coulomb", properties | strength, insitu_pressure=1e5)],
        [*map(Viscous, ALL_SIDES), StressInput("west", Seismogram(motion, PULSE[1]))],
        receivers=[Receiver("A", (45.0, 5.0, 5.0))],
    )  # fmt: skip


def digest(result):
    """Return the SHA-256 of all bits of a run."""
    found = hashlib.sha256()
    for table in (result.state, result.energy):
        for name in sorted(table):
            found.update(table[name].tobytes())
    for name in sorted(result.seismograms):
        found.update(result.seismograms[name].velocity.tobytes())
    return found.hexdigest()
