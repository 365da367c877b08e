"""The blocky test: magnetite cut by three joint sets and a fault into some 400 blocks."""

import numpy as np

from pyblast.mesh.builder import Fault, JointSet, Layer, build_mesh_report
from pyblast.model.joint import Joint
from pyblast.model.material import Material
from pyblast.model.model import Model

SETS = (("A", 75.0, 90.0, 14.0), ("B", 80.0, 10.0, 11.0), ("C", 20.0, 260.0, 20.0))
FAULT = (60.0, 113.0)
ROCK = Material(4500.0, 32.1e9, 14.8e9)
STIFFNESS = {"rock": (1.5e9, 0.734e9), "F": (0.114e9, 0.025e9)}


def blocky_mesh(size=(100.0, 100.0, 60.0), edge=5.0, **options):
    """Return the mesh, not split, and the report of the builder."""
    box = [(0.0, length) for length in size]
    sets = [
        JointSet(name, np.radians(dip), np.radians(towards), spacing)
        for name, dip, towards, spacing in SETS
    ]
    fault = Fault("F", *np.radians(FAULT), tuple(np.array(size) / 2.0))
    return build_mesh_report(box, [Layer("rock")], sets, [fault], edge=edge, **options)


def blocky_model(mesh, **parts):
    """Return a model of it with elastic joints, as stiff as in the magnetite of the mine."""
    names = [*(name for name, *_ in SETS), "F"]
    joints = []
    for name in names:
        kn, ks = STIFFNESS["F" if name == "F" else "rock"]
        joints.append(Joint(name, "elastic", {"kn": kn, "ks": ks}))
    return Model(mesh.split(names), {"rock": ROCK}, joints=joints, **parts)
