"""The product by which a time step is found: linear, symmetric, and that of the stiffness."""

from dataclasses import replace

import numpy as np
import pytest

from pyblast.mesh.builder import structured_box
from pyblast.model.joint import Joint
from pyblast.model.material import Material, MohrCoulomb
from pyblast.model.model import InSitu, Model
from pyblast.solver.assembly import time_step, zone_product
from pyblast.solver.preparation import prepare
from verification.step_limits import elastic, true_limit

SIZE = (30.0, 20.0, 20.0)
SEEDS = range(10)
EXACT = 1e-11  # of the largest value


def one(kind, seed, planes=None):
    """Return a crooked box of weak rock; linear tetrahedra yield."""
    rng = np.random.default_rng(seed)
    order = {"hexahedra": 3}.get(kind, 1)
    mesh = structured_box((3, 2, 2), SIZE, order=order, planes=planes)
    if kind != "hexahedra":
        inside = ((mesh.points > 0.0) & (mesh.points < SIZE)).all(axis=1)
        moved = mesh.points + rng.uniform(-1.5, 1.5, mesh.points.shape) * inside[:, None]
        mesh = replace(mesh, points=mesh.points if planes else moved)
    rock = Material.from_speeds(
        rng.uniform(1500.0, 3000.0), rng.uniform(2500.0, 6000.0), rng.uniform(800.0, 1700.0)
    )
    if kind == "yielding":
        rock = replace(rock, cohesion=1e3, friction=0.5, tension=0.0, law=MohrCoulomb())
    parts = {"quadratic": kind == "quadratic", "insitu": InSitu() if kind == "yielding" else None}
    joints = [
        Joint(name, "coulomb", {"kn": 1e10, "ks": 4e9, "cohesion": 0.0, "friction": 0.5,
                                "tension": 0.0})
        for name in planes or ()
    ]  # fmt: skip
    return Model(mesh.split(list(planes or ())), {"rock": rock}, joints=joints, **parts)


def product(model):
    """Return the nodal masses of a model and its product."""
    if model.mesh.hexahedral:
        mass = model.nodes.sums(model.zone_values("density") * model.nodes.volumes.sum(axis=1))
    else:
        mass = prepare(elastic(model), 1e-3).constants["node_mass"]
    return mass, zone_product(model, mass)


@pytest.mark.parametrize("kind", ["yielding", "quadratic", "hexahedra"])
@pytest.mark.parametrize("seed", SEEDS)
def test_the_product_is_linear_and_symmetric(kind, seed):
    model = one(kind, seed)
    mass, times = product(model)
    x, y = np.random.default_rng(seed).normal(size=(2, len(mass), 3))

    first, second = times(x), times(y)

    size = np.abs(first).max()
    assert np.abs(1e6 * times(1e-6 * x) - first).max() < EXACT * size
    assert np.abs(times(x - 2.0 * y) - first + 2.0 * second).max() < EXACT * size
    work = np.sum(mass[:, None] * y * first)
    assert np.sum(mass[:, None] * x * second) == pytest.approx(work, abs=EXACT * abs(
        np.sum(mass[:, None] * x * first)))  # fmt: skip


@pytest.mark.parametrize("seed", SEEDS)
def test_the_product_of_linear_zones_is_that_of_their_stiffness(seed):
    model = one("yielding", seed)
    mass, times = product(model)
    mesh, rock = model.mesh, model.materials["rock"]
    force = np.zeros((len(mass), 3))
    x = np.random.default_rng(seed).normal(size=force.shape)

    for zone in mesh.zones:
        sides = mesh.points[zone[1:]] - mesh.points[zone[0]]
        slopes = np.linalg.inv(sides)  # of the last three corners, by columns
        slopes = np.column_stack([-slopes.sum(axis=1), slopes])
        strain = slopes @ x[zone]
        strain = 0.5 * (strain + strain.T)
        stress = 2.0 * rock.shear * strain
        stress += (rock.bulk - 2.0 / 3.0 * rock.shear) * np.trace(strain) * np.eye(3)
        force[zone] += abs(np.linalg.det(sides)) / 6.0 * slopes.T @ stress

    assert times(x) == pytest.approx(force / mass[:, None], abs=EXACT * np.abs(times(x)).max())


@pytest.mark.parametrize("kind", ["yielding", "quadratic", "hexahedra"])
@pytest.mark.parametrize("seed", SEEDS)
def test_the_step_is_below_the_limit_of_the_whole_model(kind, seed):
    model = one(kind, seed, {"J": ("x", 10.0)} if seed % 2 else None)

    step, _ = time_step(model)

    assert step < true_limit(prepare(elastic(model), 1e-3))
