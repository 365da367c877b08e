"""What does not fit into memory is refused before it is made, with both numbers."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from pyblast.errors import InputError
from pyblast.meshing import memory
from pyblast.meshing.mesh_builder import Layer, build_mesh, structured_box
from pyblast.motion.seismogram import Seismogram
from pyblast.solving.boundaries import FreeField, StressInput, Viscous
from pyblast.solving.joints import Joint
from pyblast.solving.model import Model, Receiver
from pyblast.solving.preparation import prepare
from pyblast.solving.solver import run
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
        monkeypatch.setattr(memory, "available", lambda: 1e6 * megabytes)

    return left


def test_the_machine_has_some_memory_left():
    assert memory.available() > 1e7


def test_a_container_leaves_what_its_limit_leaves(tmp_path):
    (tmp_path / "max").write_text("3000000\n")
    (tmp_path / "current").write_text("1000000\n")

    assert memory._left(tmp_path / "max", tmp_path / "current") == 2e6
    (tmp_path / "max").write_text("max\n")
    assert memory._left(tmp_path / "max", tmp_path / "current") == np.inf


def test_the_estimate_covers_what_a_run_takes():
    model = jointed()
    dt = prepare(model, 1e-3).constants["dt"]

    tracemalloc.start()
    run(model, 500 * dt)
    taken = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()

    assert 0.8 * taken < memory.marching_bytes(model.nodes, 1000) < 2.0 * taken


def test_histories_of_free_field_sides_count(machine):
    model = beside_slopes()
    tracemalloc.start()
    prepared = prepare(model, 0.6)
    taken = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()

    own = memory.marching_bytes(model.nodes, 2 * prepared.n_steps)
    found = memory.marching_bytes(
        model.nodes, 2 * prepared.n_steps, prepared.constants["history"].size
    )

    assert found > 3.0 * own
    assert 0.7 * taken < found < 1.5 * taken
    machine(0.9e-6 * found)
    with pytest.raises(InputError, match=r"\d+ histories of free-field sides needs about"):
        prepare(model, 0.6)


def test_a_model_that_does_not_fit_is_refused_with_both_numbers(machine):
    model = jointed()
    machine(5.0)

    with pytest.raises(InputError, match=r"24576 zones needs about 0\.02\d* GB .* 0\.005 GB left"):
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

    with pytest.raises(InputError, match=r"build_mesh: a mesh of about 1\.1e\+07 zones needs"):
        build_mesh(((0, 100), (0, 100), (0, 100)), [Layer("rock")], edge=1.0)
