"""A box of hexahedra open to all sides but the top, with an absorbing layer or without."""

from dataclasses import replace

import numpy as np

from pyblast.mesh.builder import structured_box
from pyblast.mesh.hexahedra import AbsorbingLayer
from pyblast.model.boundary import Viscous
from pyblast.model.joint import Joint
from pyblast.model.material import ConstantQ, Material
from pyblast.model.model import Model, Receiver
from pyblast.model.source import PointForce, TimeFunction

ROCK = Material.from_speeds(2600.0, 3000.0, 1700.0)
SIDES = ("west", "east", "south", "north", "bottom")
H = 40.0  # edge of its zones, m


def ricker(frequency=15.0, peak=0.09):
    t = np.arange(0.0, 0.4, 1e-4)
    a = (np.pi * frequency * (t - peak)) ** 2
    return TimeFunction((1.0 - 2.0 * a) * np.exp(-a), 1e-4)


def open_box(beyond, layered, order=4, **parts):
    """Return a box of 3 x 2 x 2 zones with zones beyond its sides and bottom."""
    lines = [H * np.arange(-beyond, n + beyond + 1) for n in (3, 2)]
    lines.append(H * np.arange(-2 - beyond, 1))
    layer = None
    if layered:
        inner = ((0.0, 3 * H), (0.0, 2 * H), (-2 * H, np.inf))
        layer = AbsorbingLayer(inner, ((2 * H, 2 * H),) * 3)
    planes = parts.pop("planes", {})
    mesh = replace(structured_box(*lines, order=order, planes=planes), layer=layer)
    parts = {
        "sources": [PointForce((0.6 * H, 0.7 * H, -0.4 * H), (1e8, 2e8, -3e8), ricker(12.0, 0.11))],
        "receivers": [
            Receiver("A", (2.8 * H, 1.7 * H, 0.0)),
            Receiver("B", (2.0 * H, 0.2 * H, -60.0)),
        ],
        "boundaries": [Viscous(side) for side in SIDES],
        **parts,
    }  # fmt: skip
    materials = parts.pop("materials", {"rock": ROCK})
    return Model(mesh.split(list(planes)), materials, **parts)


GROUNDS = {
    "even": {},
    "attenuating": {
        "materials": {
            "rock": Material.from_speeds(2600.0, 3000.0, 1700.0, law=ConstantQ(60.0, 30.0))
        }
    },
    "jointed": {
        "planes": {"J": ("x", 2 * H)},
        "joints": [Joint("J", "elastic", {"kn": 2e9, "ks": 1e9})],
    },
}
