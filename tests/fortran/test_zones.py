"""Zones: exact stress of linear motion, no force from rigid motion, and the slow twin."""

import numpy as np
import pytest
import reference
from crooked_box import crooked
from scipy.spatial.transform import Rotation

from pyblast import core
from pyblast.mesh.builder import Layer
from pyblast.model.material import Damping, Material
from pyblast.model.model import Model
from pyblast.solver import assembly
from verification.columns import ROCK

SOFT = Material.from_speeds(1800.0, 1500.0, 600.0)
NEEDED = (
    "domain_zone_start",
    "domain_slot_start",
    "domain_set",
    "slot_node",
    "slot_place",
    "zone_slot",
    "zone_lambda",
    "zone_shear",
    "zone_row",
    "zone_patch",
    "set_form",
    "edge_start",
    "edge_slot",
    "edge_spring",
    "skew_start",
    "skew_slot",
    "skew_spring",
    "domain_patch_start",
    "patch_start",
    "patch_slot",
    "patch_gradient",
    "patch_bulk",
    "set_law",
    "set_property",
    "set_beta",
    "set_branch",
    "row_initial",
)
DAMPING = {"rock": Damping(0.05, 30.0), "soil": Damping(0.1, 10.0)}


def layered_model(damping=None):
    layers = [Layer("soil", 1.0), Layer("rock")]
    return Model(crooked(1, layers), {"rock": ROCK, "soil": SOFT}, damping=damping)


def forces(model, displacement, velocity):
    """Return nodal forces (n_nodes, 3), strain energy and the power of what damps."""
    arrays, _ = assembly.geometry_arrays(model)
    views = core.to_fortran({name: arrays[name] for name in NEEDED})
    slots = np.zeros((len(arrays["slot_node"]), 3, 1))
    n_rows = len(arrays["row_initial"])

    def taken(motion):
        energy = core._core.pyblast_border.zone_forces(
            **views,
            **core.to_fortran(
                {
                    "displacement": motion,
                    "velocity": velocity,
                    "memory": np.zeros((len(displacement), 1, 3)),
                    "row_state": np.zeros((n_rows, core.N_ZONE_STATE)),
                    "row_lost": np.zeros(n_rows),
                }
            ),
            dt=0.0,
            slot_force=slots.T,
        )
        return energy, -(slots[..., 0] * velocity[arrays["slot_node"]]).sum()

    _, damping = taken(0.0 * displacement)
    energy, _ = taken(displacement)
    force = np.zeros_like(displacement)
    np.add.at(force, arrays["slot_node"], slots[..., 0])
    return force, energy.sum(), damping


def inner_nodes(mesh):
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    return ((mesh.points > low + 1e-9) & (mesh.points < high - 1e-9)).all(axis=1)


@pytest.mark.parametrize("seed", range(4))
def test_linear_displacement_leaves_no_force_at_inner_nodes(seed):
    model = Model(crooked(seed), {"rock": ROCK})
    gradient = np.random.default_rng(seed).normal(scale=1e-3, size=(3, 3))
    displacement = model.mesh.points @ gradient.T

    force, _, _ = forces(model, displacement, np.zeros_like(displacement))

    largest = np.abs(force).max()
    assert np.abs(force[inner_nodes(model.mesh)]).max() < 1e-12 * largest


@pytest.mark.parametrize("seed", range(4))
def test_linear_displacement_stores_the_energy_of_its_constant_stress(seed):
    model = Model(crooked(seed), {"rock": ROCK})
    gradient = np.random.default_rng(seed).normal(scale=1e-3, size=(3, 3))
    displacement = model.mesh.points @ gradient.T

    _, energy, _ = forces(model, displacement, np.zeros_like(displacement))

    stress = reference.stress_of(gradient, ROCK.first_lame, ROCK.shear)
    volume = np.prod(model.mesh.points.max(axis=0))
    assert energy == pytest.approx(0.5 * volume * np.sum(stress * gradient), rel=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_linear_displacement_loads_a_face_with_its_traction(seed):
    model = Model(crooked(seed), {"rock": ROCK})
    gradient = np.random.default_rng(seed).normal(scale=1e-3, size=(3, 3))
    displacement = model.mesh.points @ gradient.T

    force, _, _ = forces(model, displacement, np.zeros_like(displacement))

    stress = reference.stress_of(gradient, ROCK.first_lame, ROCK.shear)
    low, high = model.mesh.points.min(axis=0), model.mesh.points.max(axis=0)
    cut = force[model.mesh.points[:, 0] < 0.5 * (low + high)[0]].sum(axis=0)
    area = high[1] * high[2]
    assert cut == pytest.approx(stress[:, 0] * area, rel=1e-11)


def test_a_shift_leaves_no_force():
    model = layered_model(DAMPING)
    shift = np.tile([0.3, -0.2, 0.1], (len(model.mesh.points), 1))

    force, energy, power = forces(model, shift, shift)

    stretched, _, _ = forces(model, 1e-3 * model.mesh.points, 0.0 * shift)
    assert np.abs(force).max() < 1e-12 * 1e3 * np.abs(stretched).max()
    assert energy < 1e-20
    assert power < 1e-20


def test_a_small_turn_leaves_no_force():
    model = layered_model(DAMPING)
    turn = np.cross([0.3, -0.2, 0.5], model.mesh.points)

    force, _, _ = forces(model, turn, turn)

    stretched, _, _ = forces(model, model.mesh.points.copy(), 0.0 * turn)
    assert np.abs(force).max() < 1e-12 * np.abs(stretched).max()


@pytest.mark.parametrize("seed", range(3))
def test_forces_balance_and_turn_nothing(seed):
    model = layered_model(DAMPING)
    rng = np.random.default_rng(seed)
    displacement, velocity = rng.normal(size=(2, *model.mesh.points.shape))

    force, _, _ = forces(model, displacement, velocity)

    largest = np.abs(force).max()
    assert force.sum(axis=0) == pytest.approx(np.zeros(3), abs=1e-12 * largest)
    moment = np.cross(model.mesh.points, force).sum(axis=0)
    assert moment == pytest.approx(np.zeros(3), abs=1e-11 * largest)


@pytest.mark.parametrize("seed", range(3))
def test_forces_turn_with_the_body(seed):
    rng = np.random.default_rng(seed)
    turn = Rotation.random(rng=rng)
    mesh = crooked(seed)
    model = Model(mesh, {"rock": ROCK}, damping=DAMPING["rock"], _ordered=True)
    points = turn.apply(mesh.points)
    turned = Model(
        type(mesh)(points, mesh.zones, mesh.zone_group, mesh.groups, {}),
        {"rock": ROCK},
        damping=DAMPING["rock"],
        _ordered=True,
    )
    displacement, velocity = rng.normal(size=(2, *points.shape))

    force, energy, power = forces(model, displacement, velocity)
    other = forces(turned, turn.apply(displacement), turn.apply(velocity))

    assert other[0] == pytest.approx(turn.apply(force), abs=1e-11 * np.abs(force).max())
    assert other[1:] == pytest.approx((energy, power), rel=1e-11)


@pytest.mark.parametrize("seed", range(3))
def test_forces_are_those_of_the_slow_twin(seed):
    model = layered_model(DAMPING)
    mesh = model.mesh
    displacement, velocity = np.random.default_rng(seed).normal(size=(2, *mesh.points.shape))

    found = forces(model, displacement, velocity)

    lame, shear = model.zone_values("first_lame"), model.zone_values("shear")
    beta = model.zone_damping("beta")
    wanted = reference.zone_forces(
        mesh.points, mesh.zones, lame, shear, beta, displacement, velocity
    )
    assert found[0] == pytest.approx(wanted[0], abs=1e-11 * np.abs(wanted[0]).max())
    assert found[1:] == pytest.approx(wanted[1:], rel=1e-11)


def test_force_is_the_slope_of_the_energy():
    model = layered_model()
    rng = np.random.default_rng(5)
    displacement, direction = rng.normal(size=(2, *model.mesh.points.shape))
    still = np.zeros_like(displacement)

    force, _, _ = forces(model, displacement, still)
    (_, more, _), (_, less, _) = (
        forces(model, displacement + side * direction, still) for side in (1.0, -1.0)
    )

    assert -np.sum(force * direction) == pytest.approx(0.5 * (more - less), rel=1e-10)


def test_domains_do_not_change_the_forces(monkeypatch):
    model = layered_model(DAMPING)
    displacement, velocity = np.random.default_rng(7).normal(size=(2, *model.mesh.points.shape))

    whole = forces(model, displacement, velocity)
    monkeypatch.setattr(assembly, "DOMAIN_ZONES", 13)
    cut = forces(model, displacement, velocity)

    assert cut[0] == pytest.approx(whole[0], abs=1e-12 * np.abs(whole[0]).max())
    assert cut[1:] == pytest.approx(whole[1:], rel=1e-12)
