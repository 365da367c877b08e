"""A box of soil on rock with one joint, shaken from the west, of linear or quadratic elements."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from pyblast.mesh.builder import Layer, structured_box
from pyblast.mesh.mesh import Mesh
from pyblast.model.boundary import StressInput, Viscous
from pyblast.model.joint import Joint
from pyblast.model.material import ConstantQ, Material
from pyblast.model.model import Model, Receiver
from pyblast.signals.seismogram import Seismogram
from verification.columns import ROCK, ricker

SIDES = ("west", "east", "south", "north", "bottom")
TIMES = np.arange(0.0, 0.1, 5e-4)
COULOMB = {"kn": 4e9, "ks": 2e9, "cohesion": 0.0, "friction": 0.3, "tension": 0.0}
SOIL = Material.from_speeds(1900.0, 1800.0, 900.0)
CONSTANT_Q = ConstantQ(60.0, 30.0, (5.0, 80.0))
FADING = {
    "materials": {"rock": replace(ROCK, law=CONSTANT_Q), "soil": replace(SOIL, law=CONSTANT_Q)}
}


def shaking(turn=None, size=1.0):
    motion = ricker(TIMES, 40.0)[:, None] * [0.8 * size, 0.5 * size, -0.3 * size]
    return Seismogram(motion if turn is None else turn.apply(motion), TIMES[1])


def site(turn=None, **parts):
    turn = turn or Rotation.identity()
    mesh = structured_box((3, 2, 2), (30.0, 20.0, 20.0), planes={"J": ("x", 20.0)},
                          layers=[Layer("soil", 10.0), Layer("rock")])  # fmt: skip
    mesh = Mesh(turn.apply(mesh.points), mesh.zones, mesh.zone_group, mesh.groups, mesh.surfaces)
    known = {
        "materials": {"rock": ROCK, "soil": SOIL},
        "joints": [Joint("J", "coulomb", COULOMB, insitu_pressure=2e4)],
        "boundaries": [*map(Viscous, SIDES), StressInput("west", shaking(turn))],
        "receivers": [Receiver("A", tuple(turn.apply([24.0, 9.0, 17.0])))],
        "quadratic": True,
    }
    return Model(mesh.split(["J"]), **{**known, **parts})
