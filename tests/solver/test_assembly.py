"""Kernel arrays of a model: masses, parts of nodes, loads, dashpots, prescribed motion."""

from dataclasses import replace

import numpy as np
import pytest

from pyblast.mesh.builder import structured_box
from pyblast.mesh.grid import Layer
from pyblast.model.boundary import Fixed, Roller, StressInput, Viscous
from pyblast.model.joint import Joint
from pyblast.model.material import Damping
from pyblast.model.model import Model
from pyblast.model.source import Hole, MomentTensor, PointForce, TimeFunction
from pyblast.signals.seismogram import Seismogram
from pyblast.solver import assembly
from pyblast.solver.loads import (
    Loads,
    dynamic_conditions,
    model_loads,
    static_conditions,
    surface_impedance,
)
from pyblast.solver.preparation import prepare
from verification.columns import ROCK

STEADY = TimeFunction(np.ones(10), 1e-3)
SIZE = np.array([20.0, 15.0, 10.0])


def model(split=False, **parts):
    planes = {"J": ("x", 10.0)} if split else None
    mesh = structured_box((4, 3, 2), SIZE, planes=planes)
    joints = ()
    if split:
        mesh = mesh.split(["J"])
        joints = [Joint("J", "elastic", {"kn": 1e9, "ks": 5e8}, insitu_pressure=3e5)]
    return Model(mesh, {"rock": ROCK}, joints=joints, **parts)


def loads(**parts):
    body = model(**parts)
    found = model_loads(body, lambda name: surface_impedance(body, name))
    arrays = found.arrays(np.array([0.0, 1e-3]))
    return body, arrays


def prescribed(arrays, node):
    """Return the directions that are prescribed at a node."""
    return arrays["fixed_direction"][arrays["fixed_node"] == node]


@pytest.mark.parametrize("split", [False, True])
def test_node_masses_add_up_to_the_mass_of_the_rock(split):
    arrays, _ = assembly.geometry_arrays(model(split))

    assert arrays["node_mass"].sum() == pytest.approx(ROCK.density * np.prod(SIZE), rel=1e-12)
    assert (arrays["node_mass"] > 0.0).all()


def test_mass_damping_of_a_node_is_that_of_its_zones():
    arrays, _ = assembly.geometry_arrays(model(damping=Damping(0.02, 4.0)))

    assert arrays["node_alpha"] == pytest.approx(0.02 * 8.0 * np.pi, rel=1e-12)


@pytest.mark.parametrize("zones_per_domain", [7, 1024])
def test_every_part_of_a_node_is_listed_once(zones_per_domain, monkeypatch):
    monkeypatch.setattr(assembly, "DOMAIN_ZONES", zones_per_domain)
    body = model(split=True)
    arrays, _ = assembly.geometry_arrays(body)

    n_parts = len(arrays["slot_node"]) + 2 * len(arrays["contact_area"])
    assert np.array_equal(np.sort(arrays["node_part"]), np.arange(n_parts))
    owner = np.concatenate([arrays["slot_node"], arrays["contact_node"].ravel()])
    start = arrays["node_start"]
    for node in range(len(body.mesh.points)):
        assert (owner[arrays["node_part"][start[node] : start[node + 1]]] == node).all()


def test_slots_lead_back_to_the_nodes_of_each_zone(monkeypatch):
    monkeypatch.setattr(assembly, "DOMAIN_ZONES", 7)
    body = model()
    arrays, _ = assembly.geometry_arrays(body)

    domain = np.arange(len(body.mesh.zones)) // 7
    slot = arrays["domain_slot_start"][domain][:, None] + arrays["zone_slot"].T
    assert np.array_equal(arrays["slot_node"][slot], body.mesh.zones)


def test_a_pressure_before_the_blast_is_the_traction_of_contacts_at_rest():
    arrays, _ = assembly.geometry_arrays(model(split=True))

    assert arrays["contact_initial"] == pytest.approx(-3e5 * arrays["contact_normal"])
    state = assembly.initial_state(arrays)
    assert state["contact_stored"] == pytest.approx(0.5 * 3e5**2 / 1e9)


def test_a_shear_before_the_blast_acts_in_the_plane_of_its_joint_only():
    body = model(split=True)
    stressed = replace(body.joints[0], insitu_shear=(9e5, 2e5, -1e5))
    arrays, _ = assembly.geometry_arrays(replace(body, joints=[stressed]))

    normal = arrays["contact_normal"]
    assert arrays["contact_initial"] == pytest.approx(-3e5 * normal + np.array([0.0, 2e5, -1e5]))
    state = assembly.initial_state(arrays)
    at_rest = 0.5 * 3e5**2 / 1e9 + 0.5 * (2e5**2 + 1e5**2) / 5e8
    assert state["contact_stored"] == pytest.approx(at_rest)


def test_the_impedance_of_a_surface_is_its_area_times_that_of_each_wave():
    body = model()

    total = sum(surface_impedance(body, "top").values())

    area = SIZE[0] * SIZE[1]
    z_p, z_s = ROCK.density * ROCK.cp * area, ROCK.density * ROCK.cs * area
    assert total == pytest.approx(np.diag([z_s, z_s, z_p]), rel=1e-12)


def test_a_stress_input_pushes_with_its_impedance_and_doubles_on_dashpots():
    motion = Seismogram(np.tile([0.1, 0.2, -0.3], (10, 1)), 1e-3)
    asked = StressInput("west", motion)

    for boundaries, factor in (([asked], 1.0), ([Viscous("west"), asked], 2.0)):
        _, arrays = loads(boundaries=boundaries)
        force = arrays["load_vector"] * arrays["history"][0][arrays["load_history"]][:, None]
        z_p, z_s = (ROCK.density * c * SIZE[1] * SIZE[2] for c in (ROCK.cp, ROCK.cs))
        wanted = factor * np.array([0.1 * z_p, 0.2 * z_s, -0.3 * z_s])
        assert force.sum(axis=0) == pytest.approx(wanted, rel=1e-10)


def test_a_point_force_keeps_its_sum_and_its_place():
    place, direction = np.array([7.3, 6.1, 4.4]), np.array([1.0, -2.0, 0.5])

    body, arrays = loads(sources=[PointForce(place, direction, STEADY)])

    assert arrays["load_vector"].sum(axis=0) == pytest.approx(direction, rel=1e-12)
    lever = body.mesh.points[arrays["load_node"]].T @ arrays["load_vector"]
    assert lever == pytest.approx(np.outer(place, direction), rel=1e-12)


@pytest.mark.parametrize("spread", [None, 6.0])
def test_a_hole_is_an_isotropic_moment_without_net_force(spread):
    place = np.array([9.0, 7.0, 5.0])
    hole = Hole(place, 16.0, 0.0, STEADY, exponent=0.5, spread=spread)

    body, arrays = loads(sources=[hole])

    assert arrays["load_vector"].sum(axis=0) == pytest.approx(np.zeros(3), abs=1e-12)
    moment = body.mesh.points[arrays["load_node"]].T @ arrays["load_vector"]
    assert moment == pytest.approx(4.0 * np.eye(3), abs=1e-10)


def test_a_spread_hole_keeps_its_centre():
    place = np.array([9.0, 7.0, 5.0])
    body, arrays = loads(sources=[Hole(place, 1.0, 0.0, STEADY, spread=6.0)])

    # Sum of f_i x_i x_j is twice the centre of the moment for f = M grad N of linear functions.
    points = body.mesh.points[arrays["load_node"]]
    second = np.einsum("ni,ni,nj->j", arrays["load_vector"], points, points)
    assert second == pytest.approx(4.0 * place, rel=1e-9)


def test_a_spread_hole_moves_its_own_layer_only():
    place = np.array([9.0, 7.0, -4.5])  # half a metre below the layer on top
    mesh = structured_box(
        np.linspace(0.0, 20.0, 5), np.linspace(0.0, 15.0, 4), np.linspace(-12.0, 0.0, 7),
        layers=[Layer("soil", 4.0), Layer("rock", None)],
    )  # fmt: skip
    hole = Hole(place, 1.0, 0.0, STEADY, spread=6.0)
    body = Model(mesh, {"soil": ROCK, "rock": ROCK}, sources=[hole])

    arrays = model_loads(body, None).arrays(np.array([0.0, 1e-3]))

    points = body.mesh.points[arrays["load_node"]]
    moved = np.abs(arrays["load_vector"]).max(axis=1) > 0.0
    assert points[moved, 2].max() == pytest.approx(-4.0)
    second = np.einsum("ni,ni,nj->j", arrays["load_vector"], points, points)
    assert second == pytest.approx(4.0 * place, rel=1e-9)


def test_a_spread_hole_moves_its_own_side_of_a_joint_only():
    place = np.array([9.0, 7.0, 5.0])  # one metre from the joint
    body, arrays = loads(split=True, sources=[Hole(place, 1.0, 0.0, STEADY, spread=6.0)])

    points = body.mesh.points[arrays["load_node"]]
    other = np.isin(arrays["load_node"], body.mesh.zones[beyond(body.mesh, 10.0)])
    assert np.abs(arrays["load_vector"][~other]).max() > 0.0
    assert not arrays["load_vector"][other].any()
    second = np.einsum("ni,ni,nj->j", arrays["load_vector"], points, points)
    assert second == pytest.approx(4.0 * place, rel=1e-9)


def beyond(mesh, x):
    """Return which zones lie east of a plane."""
    return mesh.points[mesh.zones].mean(axis=1)[:, 0] > x


def test_the_moment_is_the_running_integral_of_its_rate_from_the_firing_time():
    shear = MomentTensor(np.array([9.0, 7.0, 5.0]), np.diag([1.0, -1.0, 0.0]), 0.02, STEADY)
    body = model(sources=[shear])
    found = model_loads(body, lambda name: surface_impedance(body, name))

    history = found.arrays(np.array([0.0, 0.02, 0.0245, 0.029, 0.1]))["history"][:, 0]

    assert history == pytest.approx([0.0, 0.0, 0.0045, 0.009, 0.009], abs=1e-12)


def test_no_load_gives_one_history_of_zeros():
    arrays = Loads().arrays(np.zeros(5))

    assert arrays["history"].shape == (5, 1)
    assert not arrays["history"].any()


@pytest.mark.parametrize("turned", [False, True])
def test_fixed_and_roller_share_an_edge_in_any_order(turned):
    boundaries = [Roller("west"), Fixed("bottom")]
    body = model(boundaries=boundaries[::-1] if turned else boundaries)
    geometry, _ = assembly.geometry_arrays(body)
    corner = int(np.flatnonzero((body.mesh.points[:, [0, 2]] == 0.0).all(axis=1))[0])

    for arrays in (dynamic_conditions(body, geometry, Loads()), static_conditions(body, geometry)):
        directions = prescribed(arrays, corner)
        assert directions.T @ directions == pytest.approx(np.eye(3), abs=1e-12)


def test_a_roller_holds_the_normal_only():
    body = model(boundaries=[Roller("top")])
    geometry, _ = assembly.geometry_arrays(body)

    arrays = dynamic_conditions(body, geometry, Loads())

    top = np.unique(body.mesh.surfaces["top"])
    assert np.array_equal(arrays["fixed_node"], top)
    assert np.abs(arrays["fixed_direction"]) == pytest.approx(
        np.tile([0.0, 0.0, 1.0], (len(top), 1))
    )


def test_rollers_that_meet_at_a_corner_hold_orthonormal_directions():
    body = model(boundaries=[Roller(side) for side in ("west", "south", "bottom")])
    geometry, _ = assembly.geometry_arrays(body)
    corner = int(np.flatnonzero((body.mesh.points == 0.0).all(axis=1))[0])

    directions = prescribed(dynamic_conditions(body, geometry, Loads()), corner)

    assert directions.T @ directions == pytest.approx(np.eye(3), abs=1e-12)


def test_named_components_are_held_alone():
    body = model(boundaries=[Fixed("top", ("north",))])
    geometry, _ = assembly.geometry_arrays(body)

    directions = dynamic_conditions(body, geometry, Loads())["fixed_direction"]

    assert directions == pytest.approx(np.tile([0.0, 1.0, 0.0], (len(directions), 1)))


def test_viscous_surfaces_stand_on_rollers_in_the_static_stage_only():
    body = model(boundaries=[Viscous("bottom")])
    geometry, _ = assembly.geometry_arrays(body)

    still, moving = (
        static_conditions(body, geometry),
        dynamic_conditions(body, geometry, Loads()),
    )

    assert not len(still["dashpot_node"])
    assert len(still["fixed_node"]) == len(np.unique(body.mesh.surfaces["bottom"]))
    assert len(moving["dashpot_node"]) == len(still["fixed_node"])
    assert not moving["fixed_direction"].any()


def test_dashpots_leave_prescribed_directions_alone():
    body = model(boundaries=[Viscous("bottom"), Roller("bottom")])
    geometry, _ = assembly.geometry_arrays(body)

    impedance = dynamic_conditions(body, geometry, Loads())["dashpot_impedance"]

    assert not impedance[:, 2, :].any()
    assert not impedance[:, :, 2].any()
    assert (impedance[:, 0, 0] > 0.0).all()


def test_preparing_twice_gives_the_same_fingerprint_and_a_change_another():
    one, two = prepare(model(True), 0.01), prepare(model(True), 0.01)
    other = prepare(model(True).with_joint("J", kn=1.1e9), 0.01)

    assert one.fingerprint == two.fingerprint
    assert one.fingerprint != other.fingerprint
