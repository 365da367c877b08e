"""What does not fit into memory is refused before it is made, with both numbers."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from pyblast.errors import InputError
from pyblast.mesh import quality
from pyblast.mesh.builder import Layer, build_mesh, structured_box
from pyblast.model.boundary import FreeField, Roller, StressInput, Viscous
from pyblast.model.joint import Joint
from pyblast.model.material import ConstantQ, Damping, MohrCoulomb
from pyblast.model.model import InSitu, Model, Receiver
from pyblast.signals.seismogram import Seismogram
from pyblast.solver.assembly import time_step
from pyblast.solver.edge_springs import run_bytes
from pyblast.solver.preparation import prepare
from pyblast.solver.run import simulate
from verification.columns import ROCK


def jointed(n=16):
    mesh = structured_box((n, n, n), (n, n, n), planes={"J": ("x", np.arange(2.0, n, 2.0))})
    joints = [Joint("J", "elastic", {"kn": 1e9, "ks": 1e9})]
    receivers = [Receiver("R", (1.0, 1.0, 1.0))]
    return Model(mesh.split("J"), {"rock": ROCK}, joints=joints, receivers=receivers)


def beside_slopes():
    """Return uneven ground with free-field sides, each column of which stands alone."""
    mesh = structured_box((4, 4, 4), (60.0, 60.0, 60.0))
    points = mesh.points.copy()
    points[:, 2] *= 1.0 + 2e-3 * points[:, 0] + 1e-3 * points[:, 1]
    pulse = Seismogram(np.ones((10, 1)) * [1.0, 0.0, 0.0], 1e-3)
    sides = ("west", "east", "south", "north")
    return Model(
        replace(mesh, points=points), {"rock": ROCK}, receivers=[Receiver("R", (9.0, 9.0, 9.0))],
        boundaries=[*map(Viscous, (*sides, "bottom")), *map(FreeField, sides),
                    StressInput("bottom", pulse)],
    )  # fmt: skip


@pytest.fixture
def machine(monkeypatch):
    def left(megabytes):
        monkeypatch.setattr(quality, "available", lambda: 1e6 * megabytes)

    return left


def test_the_machine_has_some_memory_left():
    assert quality.available() > 1e7


def test_a_container_leaves_what_its_limit_leaves(tmp_path):
    (tmp_path / "max").write_text("3000000\n")
    (tmp_path / "current").write_text("1000000\n")

    assert quality._left(tmp_path / "max", tmp_path / "current") == 2e6
    (tmp_path / "max").write_text("max\n")
    assert quality._left(tmp_path / "max", tmp_path / "current") == np.inf


def taken_by(model, n_steps=1):
    """Return the most bytes of arrays that a run holds at any time."""
    tracemalloc.start()
    found = simulate(model, n_steps * time_step(model)[0])
    taken = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return taken, found.prepared.constants


def core_bytes(model, constants):
    """Return the bytes of the arrays that ``advance`` of solver.f90 keeps while it marches."""
    slots, contacts = len(constants["slot_node"]), len(constants["contact_area"])
    return 24 * (2 * len(model.nodes.points) + 2 * slots + 2 * contacts) + 48 * contacts


YIELDING = replace(ROCK, cohesion=1e9, friction=0.5, tension=1e9, law=MohrCoulomb())
SLOW = replace(ROCK, law=ConstantQ(50.0, 30.0, (1.0, 30.0)))
HELD = [Roller(side) for side in ("west", "east", "south", "north", "bottom")]
KINDS = {
    "springs": (20, None, {}),
    "springs and joints": (18, 3, {}),
    "damped springs": (18, None, {"damping": Damping(0.02, 20.0, corner=60.0)}),
    "zones": (20, None, {"materials": {"rock": SLOW}}),
    "springs and joints at rest under weight": (18, 4, {"insitu": InSitu(), "boundaries": HELD}),
    "yielding": (18, None, {"materials": {"rock": YIELDING}}),
    "yielding and joints": (16, 4, {"materials": {"rock": YIELDING}}),
    "quadratic": (9, None, {"quadratic": True}),
    "quadratic and joints": (8, 2, {"quadratic": True}),
    "quadratic, relaxing": (8, None, {"quadratic": True, "materials": {"rock": SLOW}}),
}


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_foreseen_covers_what_a_run_holds_and_little_more(kind):
    n, every, parts = KINDS[kind]
    planes = {} if every is None else {"J": ("x", np.arange(float(every), n, every))}
    # A size of its own: what other tests have kept of an equal mesh would not be counted here.
    mesh = structured_box((n, n, n), (n, n, 1.003 * n), planes=planes)
    joints = [Joint(name, "elastic", {"kn": 1e9, "ks": 1e9}) for name in planes]
    sides = [Viscous(side) for side in ("west", "east", "south", "north", "bottom")]
    known = {"materials": {"rock": ROCK}, "boundaries": sides, **parts}
    model = Model(mesh.split(list(planes)), joints=joints, **known)

    taken, constants = taken_by(model)
    foreseen = run_bytes(model)

    # Springs are made when the core holds nothing; whatever else there is stands beside it.
    least = taken + (core_bytes(model, constants) if model.quadratic else 0)
    assert least < foreseen < 1.2 * least


def test_histories_of_free_field_sides_count(machine):
    model = beside_slopes()
    tracemalloc.start()
    prepared = prepare(model, 0.6)
    taken = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()

    own = run_bytes(model, 2 * prepared.n_steps)
    found = run_bytes(model, 2 * prepared.n_steps, prepared.constants["history"].size)

    assert found > 3.0 * own
    assert 0.7 * taken < found < 1.5 * taken
    machine(0.9e-6 * found)
    with pytest.raises(InputError, match=r"\d+ histories of free-field sides needs about"):
        prepare(model, 0.6)


def test_a_model_that_does_not_fit_is_refused_with_both_numbers(machine):
    model = jointed()
    machine(5.0)

    with pytest.raises(InputError, match=r"24576 zones needs about 0\.0\d+ GB .* 0\.005 GB left"):
        prepare(model, 1e-3)


def test_a_run_too_long_for_its_receivers_is_refused(machine):
    model = jointed()
    machine(50.0)

    prepare(model, 1e-3)
    with pytest.raises(InputError, match=r"with 1 receivers over \d+ steps needs about"):
        prepare(model, 100.0)


def test_a_grid_that_does_not_fit_is_refused_before_it_is_made(machine):
    machine(1e3)

    with pytest.raises(InputError, match="structured_box: a grid of 6000000000 zones needs about"):
        structured_box((1000, 1000, 1000), (1.0, 1.0, 1.0))


def test_a_mesh_that_does_not_fit_is_refused_before_gmsh_begins(machine):
    machine(1e3)

    with pytest.raises(InputError, match=r"build_mesh: a mesh of about 11000000 zones needs"):
        build_mesh(((0, 100), (0, 100), (0, 100)), [Layer("rock")], edge=1.0)
