"""The critical step: safe against the eigenvalues of small models, and not far below them."""

from dataclasses import replace

import numpy as np
import pytest
import reference

from pyblast import core
from pyblast.errors import SolverError
from pyblast.mesh.builder import Layer, structured_box
from pyblast.mesh.mesh import Mesh
from pyblast.model.boundary import Viscous
from pyblast.model.joint import Joint
from pyblast.model.material import ConstantQ, Damping, Material
from pyblast.model.model import Model
from pyblast.solver import assembly, time_step
from pyblast.solver.preparation import prepare
from pyblast.solver.run import simulate
from verification.cases.full_space import cavity_radii
from verification.columns import ROCK, started
from verification.meshes import ball_octant

SOFT = Material.from_speeds(1800.0, 1500.0, 500.0)
CROSS = {"J1": ("x", 1.0), "J2": ("y", 1.0)}


def box(crook, planes=None, pattern="kuhn"):
    layers = [Layer("soil", 1.0), Layer("rock")]
    mesh = structured_box((2, 2, 2), (2.0, 2.0, 2.0), planes=planes, layers=layers, pattern=pattern)
    points = mesh.points + crook * np.random.default_rng(0).uniform(-1.0, 1.0, mesh.points.shape)
    return Mesh(points, mesh.zones, mesh.zone_group, mesh.groups, mesh.surfaces)


def small(crook=0.0, stiffness=None, damping=None, pattern="kuhn", **parts):
    planes = None if stiffness is None else CROSS
    mesh = box(crook, planes, pattern)
    joints = ()
    if planes:
        mesh = mesh.split(list(planes))
        law = {"kn": stiffness, "ks": 0.4 * stiffness}
        joints = [Joint(name, "elastic", law) for name in planes]
    materials = {"rock": ROCK, "soil": SOFT}
    return Model(mesh, materials, joints=joints, damping=damping, **parts)


def probed(model):
    """Return M^-1 K and M^-1 C (n, n) of a model, one unit motion at a time, from the kernels."""
    prepared = prepare(model, 1e-3)
    views, dt = core.to_fortran(prepared.constants), prepared.constants["dt"]
    n = prepared.state["displacement"].size
    stiffness, drag = np.zeros((2, n, n))
    for column in range(n):
        for name, matrix in (("displacement", stiffness), ("velocity", drag)):
            state = {key: value.copy() for key, value in prepared.state.items()}
            state[name].flat[column] = 1.0
            before = state["velocity"].ravel().copy()
            core.advance(views, state, 0, 1, 1)
            matrix[:, column] = (before - state["velocity"].ravel()) / dt
    return stiffness, drag


def true_limit(stiffness, drag):
    """Return the longest stable step: where the march from step to step begins to grow."""
    n = len(stiffness)
    short, long = 0.0, 2.2 / np.sqrt(np.abs(np.linalg.eigvals(stiffness)).max())
    for _ in range(22):
        dt = 0.5 * (short + long)
        slower = np.eye(n) - dt * drag
        march = np.block([[np.eye(n) - dt**2 * stiffness, dt * slower], [-dt * stiffness, slower]])
        stable = np.abs(np.linalg.eigvals(march)).max() < 1.0 + 1e-5
        short, long = (dt, long) if stable else (short, dt)
    return short


CASES = {
    "zones": {},
    "crooked zones": {"crook": 0.1},
    "zones of five": {"pattern": "alternating"},
    "soft joints": {"stiffness": 1e9},
    "joints as stiff as rock": {"stiffness": 5e10},
    "joints far stiffer than rock": {"stiffness": 1e13},
    "stiffness damping": {"damping": {"rock": Damping(0.05, 60.0), "soil": Damping(0.01, 60.0)}},
    "joints and damping": {"stiffness": 3e10, "damping": Damping(0.03, 60.0)},
    "crooked joints and damping": {
        "crook": 0.15,
        "stiffness": 3e10,
        "damping": Damping(0.03, 60.0),
    },
}


# The part zone by zone is far from what neighbours hold together where the mesh is crooked.
LEAST = {
    "crooked zones": 0.5,
    "stiffness damping": 0.5,
    "joints and damping": 0.55,
    "crooked joints and damping": 0.4,
}


@pytest.mark.parametrize("case", CASES)
def test_the_bound_is_safe_and_near_the_true_limit(case):
    model = small(**CASES[case])

    ratio = time_step.critical_step(model).dt / true_limit(*probed(model))

    assert LEAST.get(case, 0.6) < ratio <= 1.0 + 1e-4


def test_the_undamped_limit_is_two_over_the_largest_frequency():
    stiffness, drag = probed(small(0.1))

    largest = np.abs(np.linalg.eigvals(stiffness)).max()
    assert not drag.any()
    assert true_limit(stiffness, drag) == pytest.approx(2.0 / np.sqrt(largest), rel=1e-3)


@pytest.mark.parametrize("seed", range(10))
def test_the_frequency_of_a_zone_is_exact(seed):
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(4, 3))
    if np.linalg.det(points[1:] - points[0]) < 0.0:
        points = points[[0, 2, 1, 3]]
    poisson = rng.uniform(-0.5, 0.49)
    material = Material.from_young_poisson(2000.0, 1e9, poisson)

    found = time_step.zone_frequencies(
        points,
        np.array([[0, 1, 2, 3]]),
        *(np.array([value]) for value in (material.first_lame, material.shear, 2000.0)),
    )

    volume, matrix = reference.zone_matrix(points, material.first_lame, material.shear)
    wanted = np.linalg.eigvalsh(matrix).max() / (2000.0 * volume / 4.0)
    assert found[0] == pytest.approx(wanted, rel=1e-9)


def shaken(model, n_steps, dt=None):
    """Run from random velocities, with a step of one's own if given."""
    prepared = prepare(model, 1e-3)
    if dt is not None:
        model = replace(model)
        constants = {**prepared.constants, "dt": dt}
        loads = {"history": np.zeros((n_steps, 1))}
        prepared = replace(prepared, constants={**constants, **loads}, n_steps=n_steps)
    else:
        dt = prepared.constants["dt"]
        prepared = prepare(model, n_steps * dt)
    velocity = np.random.default_rng(0).normal(size=prepared.state["velocity"].shape)
    state = {**prepared.state, "velocity": velocity}
    return simulate(model, n_steps * dt, prepared=replace(prepared, state=state))


@pytest.mark.parametrize("case", CASES)
def test_a_run_at_the_full_bound_is_stable(case):
    result = shaken(small(**CASES[case], step_factor=1.0), 3000)

    kinetic = result.energy["kinetic"]
    assert np.isfinite(kinetic).all()
    assert kinetic[-20:].max() <= kinetic.max() * 1.01
    assert result.balance_error < (1e-8 if "damping" not in case else 1.0)


@pytest.mark.parametrize("case", ["zones", "joints far stiffer than rock", "stiffness damping"])
@pytest.mark.parametrize("factor", [1.02, 1.1])
def test_a_step_above_the_true_limit_is_caught_with_time_place_and_cause(case, factor):
    model = small(**CASES[case])
    dt = factor * true_limit(*probed(model))

    with pytest.raises(
        SolverError, match=r"step \d+ \(t = .* s\).* at \(.*\) m.*time step"
    ) as error:
        shaken(model, 2000, dt)

    step = int(str(error.value).split("step ")[1].split()[0])
    assert step <= first_growth(model, dt) + 50


def first_growth(model, dt):
    """Return the step at which kinetic energy first exceeds twice that of the start."""
    prepared = prepare(model, 1e-3)
    constants = {**prepared.constants, "dt": dt, "history": np.zeros((2000, 1))}
    views = core.to_fortran(constants)
    state = {name: value.copy() for name, value in prepared.state.items()}
    state["velocity"] = np.random.default_rng(0).normal(size=state["velocity"].shape)
    mass = constants["node_mass"][:, None]
    start = np.sum(mass * state["velocity"] ** 2)
    for step in range(2000):
        core.advance(views, state, step, 1, 10**6)
        if np.sum(mass * state["velocity"] ** 2) > 2.0 * start:
            return step
    return None


def test_the_limit_names_the_zone_or_the_joint_that_sets_it():
    assert "a zone of 'rock'" in time_step.critical_step(small()).limited_by
    assert "joint 'J" in time_step.critical_step(small(stiffness=1e13)).limited_by


def test_mass_damping_costs_no_step():
    damping = Damping(0.1, 60.0, stiffness=False)

    assert time_step.critical_step(small(damping=damping)).dt == time_step.critical_step(small()).dt


def test_stiffness_damping_shortens_the_step_by_the_formula():
    damping = Damping(0.05, 60.0)
    plain = time_step.critical_step(small())
    damped = time_step.critical_step(small(damping=damping))

    share = damping.beta / plain.dt  # xi = beta omega / 2 at the largest frequency
    assert damped.dt / plain.dt == pytest.approx(np.sqrt(1.0 + share**2) - share, rel=1e-9)
    assert damped.undamped == pytest.approx(plain.dt)


def test_ground_that_is_fine_on_purpose_stays_explicit():
    mesh = structured_box((16, 4, 4), (1.0, 1.0, 1.0))
    points = mesh.points.copy()
    points[:, 0] = 0.25 * (1.08 ** (16.0 * points[:, 0]) - 1.0)
    graded = Model(replace(mesh, points=points), {"rock": ROCK})

    limit = time_step.critical_step(graded)

    assert not limit.implicit.zones.any()
    assert limit.dt == limit.explicit


@pytest.mark.parametrize("n_edges", [3, 4, 5])
@pytest.mark.parametrize("quadratic", [False, True])
def test_the_wall_of_a_cavity_stays_explicit(n_edges, quadratic):
    mesh = ball_octant(n_edges, cavity_radii(n_edges))

    limit = time_step.critical_step(Model(mesh, {"rock": ROCK}, quadratic=quadratic))

    assert not limit.implicit.zones.any()


def test_dashpots_cost_no_step():
    sides = [Viscous(side) for side in ("west", "east", "south", "north", "bottom")]
    model = small(boundaries=sides, step_factor=1.0)
    velocity = np.random.default_rng(0).normal(size=model.mesh.points.shape)

    result = started(model, 1500 * prepare(model, 1e-3).constants["dt"], 0.0 * velocity, velocity)

    assert result.balance_error < 1e-10
    assert result.energy["dashpots"][-1] > 0.5 * result.energy["kinetic"][0]


@pytest.mark.parametrize("damping", [None, Damping(0.02, 10.0, corner=150.0)])
def test_moduli_at_once_act_as_the_springs_that_relax_do(monkeypatch, damping):
    box = structured_box((2, 2, 2), (40.0, 40.0, 40.0), order=3)
    law = ConstantQ(50.0, 30.0, (1.0, 60.0))
    model = Model(
        box, {"rock": Material.from_speeds(2500.0, 3000.0, 1500.0, law=law)}, damping=damping
    )
    mass = np.ones(len(model.nodes.points))
    motion = np.random.default_rng(1).standard_normal((len(mass), 3))
    quick = assembly.zone_product(model, mass)(motion, 7.0)

    by_set, branches = [model.branches("rock")], assembly._branches
    monkeypatch.setattr(assembly, "_unrelaxed", lambda model, _: model.materials)
    monkeypatch.setattr(assembly, "_branches", lambda _: branches(by_set))
    springs = assembly.zone_product(model, mass)(motion, 7.0)

    assert np.abs(quick - springs).max() < 1e-12 * np.abs(springs).max()
