"""Models that march a few steps again and again, to be timed; the mesh of the timings."""

from dataclasses import replace

import numpy as np

from pyblast import core
from pyblast.mesh.grid import structured_box
from pyblast.model.boundary import Viscous
from pyblast.model.joint import Joint
from pyblast.model.material import Material
from pyblast.model.model import Model, Receiver
from pyblast.solver.assembly import time_step
from pyblast.solver.edge_springs import without_edges
from pyblast.solver.preparation import LEDGER_EVERY, prepare
from pyblast.solver.run import stacked

ROCK = Material.from_speeds(2700.0, 3000.0, 1700.0)
EDGE = 5.0  # m
QUIET = ("west", "east", "south", "north", "bottom")
RECEIVERS = 10


def cube(cells, every=None):
    """Return a cube of six zones to a cell, cut by joints each so many cells along all axes."""
    size = (cells * EDGE,) * 3
    if every is None:
        return structured_box((cells,) * 3, size)
    places = EDGE * np.arange(every, cells, every)
    planes = {f"J{axis}": (axis, places) for axis in "xyz"}
    return structured_box((cells,) * 3, size, planes=planes).split(list(planes))


def rock_model(mesh, law="elastic", material=ROCK, **parts):
    """Return a model of a `cube` with quiet sides, a free top and receivers on it."""
    high = mesh.points.max(axis=0)
    places = np.linspace(0.2, 0.8, RECEIVERS)[:, None] * high + [0.0, 0.3, 0.0]
    places[:, 2] = high[2] - 0.1 * EDGE
    names = () if mesh.contacts is None else mesh.contacts.names
    properties = {"kn": 2e9, "ks": 1e9}
    if law == "coulomb":
        properties |= {"cohesion": 1e9, "friction": 0.5, "tension": 1e9}
    parts.setdefault("boundaries", [Viscous(side) for side in QUIET])
    return Model(
        mesh, {group: material for group in mesh.groups},
        joints=[Joint(name, law, dict(properties)) for name in names],
        receivers=[Receiver(f"R{k}", tuple(place)) for k, place in enumerate(places)], **parts,
    )  # fmt: skip


def rounds_of_ledger(n_zones, zone_steps):
    """Return a number of steps near so many zone-steps, whole rounds of the ledger of energies."""
    return LEDGER_EVERY * max(1, round(zone_steps / n_zones / LEDGER_EVERY))


class March:
    """A model that marches ``n_steps`` whenever it is called, alone or as eight of its kind.

    Parameters
    ----------
    prepared : Prepared
        Of ``n_steps`` or more.
    n_steps : int
    lanes : bool
        Whether eight of them march side by side.
    """

    def __init__(self, prepared, n_steps, lanes=False):
        self.n_steps, self.constants = n_steps, prepared.constants
        self.advance = core.advance_batch if lanes else core.advance
        if lanes:
            every = ([one] * core.BATCH_SIZE for one in (prepared.constants, prepared.state))
            constants, self.state = stacked(*every)
            self.views = core.to_fortran_batch(constants)
        else:
            self.views, self.state = prepared.begun()
        moving = np.random.default_rng(0).normal(size=self.state["velocity"].shape)
        self.state["velocity"][:] = 1e-6 * moving

    def __call__(self):
        """March on from where the last call ended; loads begin anew."""
        _, _, failed = self.advance(self.views, self.state, 0, self.n_steps, LEDGER_EVERY)
        if failed is not None:
            raise ArithmeticError(f"a timed march failed at node {failed}")


def prepared(model, n_steps, share=0.5):
    """Return a model prepared for some steps of a share of the longest stable one."""
    step = time_step(replace(model, step_factor=share))
    return prepare(model, n_steps * step[0], step=step)


def by_zones(prepared):
    """Return what was prepared, marching zone by zone where it would by springs along edges."""
    return replace(prepared, constants=without_edges(prepared.constants))


class Steps:
    """A prepared model that marches the next ``n_steps`` whenever it is called.

    Parameters
    ----------
    prepared : Prepared
        Of a duration that all calls fit into.
    n_steps : int
    """

    def __init__(self, prepared, n_steps):
        self.views, self.state = prepared.begun()
        self.n_steps, self.step = n_steps, 0

    def __call__(self):
        """March on."""
        _, _, failed = core.advance(self.views, self.state, self.step, self.n_steps, LEDGER_EVERY)
        self.step += self.n_steps
        if failed is not None:
            raise ArithmeticError(f"a timed march failed at node {failed}")
