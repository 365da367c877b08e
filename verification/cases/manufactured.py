"""A motion made up beforehand, with the body force that it needs. Case 36."""

from dataclasses import replace

import numpy as np

from pyblast.mesh.builder import structured_box
from pyblast.mesh.tetrahedra import shape_gradients
from pyblast.model.boundary import Fixed
from pyblast.model.model import Model
from pyblast.solver.preparation import prepare
from pyblast.solver.run import simulate
from verification.columns import ROCK
from verification.suite import Curve, Reading, case

SIZE = 100.0
SHAPE = np.array([1.0, 0.7, -0.5])
OMEGA = 2.0 * np.pi * 30.0
SIDES = ("west", "east", "south", "north", "bottom", "top")


def made_up(points):
    """Return displacement (n, 3), gradient (n, 3, 3) and body force (n, 3) of unit amplitude."""
    k = np.pi / SIZE
    s, c = np.sin(k * points), np.cos(k * points)
    product = s.prod(axis=1)
    first = k * np.stack([c[:, j] * np.delete(s, j, axis=1).prod(axis=1) for j in range(3)], axis=1)
    second = np.zeros((len(points), 3, 3))
    for i in range(3):
        for j in range(3):
            rest = s[:, 3 - i - j] if i != j else None
            second[:, i, j] = -(k**2) * product if i == j else k**2 * c[:, i] * c[:, j] * rest
    lame, shear = ROCK.first_lame, ROCK.shear
    inner = (lame + shear) * second @ SHAPE - 3.0 * shear * k**2 * product[:, None] * SHAPE
    force = -ROCK.density * OMEGA**2 * product[:, None] * SHAPE - inner
    return product[:, None] * SHAPE, SHAPE[:, None] * first[:, None, :], force


@case(
    "36",
    "Manufactured solution",
    source="u = a sin sin sin sin(wt) with the body force of (1.1)",
    gate="C",
    tolerance={"displacement": 0.02, "strain": 0.1},
    meshes=(8.0, 12.0, 18.0),
    unit="cells a side",
    order=1.8,
    ordered={"displacement": 1.8, "strain": 0.9},
    quick=True,
    note="L2 norms after one and a quarter periods. The strain is that of zones at their centres, "
    "of order one.",
)
def manufactured(n):
    """March a made-up motion and compare displacement and strain."""
    n = round(n)
    mesh = structured_box((n, n, n), (SIZE, SIZE, SIZE), pattern="alternating")
    model = Model(mesh, {"rock": ROCK}, boundaries=[Fixed(side) for side in SIDES])
    duration = 1.25 * 2.0 * np.pi / OMEGA
    prepared = prepare(model, duration)
    constants, points = prepared.constants, model.mesh.points
    dt, n_steps = constants["dt"], prepared.n_steps
    shape, _, force = made_up(points)
    loads = {
        "load_node": np.arange(len(points), dtype=np.int32),
        "load_vector": force * (constants["node_mass"] / ROCK.density)[:, None],
        "load_history": np.zeros(len(points), dtype=np.int32),
        "load_delay": np.zeros(len(points)),
        "load_member": np.full(len(points), -1, dtype=np.int32),
        "history": np.sin(OMEGA * dt * np.arange(n_steps))[:, None],
    }
    start = OMEGA * np.cos(0.5 * OMEGA * dt) * shape
    state = {**prepared.state, "velocity": start}
    done = simulate(model, duration, prepared=replace(prepared, constants={**constants, **loads},
                                                 state=state))  # fmt: skip
    found, amplitude = done.state["displacement"], np.sin(OMEGA * dt * n_steps)
    zones = model.mesh.zones
    gradient = shape_gradients(points, zones)
    sides = found[zones[:, 1:]] - found[zones[:, :1]]
    strain = np.einsum("zai,zaj->zij", sides, gradient)
    _, wanted, _ = made_up(points[zones].mean(axis=1))
    strains = [0.5 * (g + np.swapaxes(g, 1, 2)) for g in (amplitude * wanted, strain)]
    line = np.flatnonzero(np.abs(points[:, 1:] - 0.5 * SIZE).max(axis=1) < 0.51 * SIZE / n)
    line = line[np.argsort(points[line, 0])]
    curve = Curve("along the middle", points[line, 0], amplitude * shape[line, 0], found[line, 0],
                  "x [m]", "displacement [m]")  # fmt: skip
    return [
        Reading.norm("displacement", amplitude * shape.ravel(), found.ravel()),
        Reading.norm("strain", strains[0].ravel(), strains[1].ravel()),
    ], [curve]
