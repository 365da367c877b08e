"""Edges: the forces of linear zones taken together, whatever the ground."""

from dataclasses import replace

import numpy as np
import pytest

from pyblast import core
from pyblast.mesh.builder import Layer, structured_box
from pyblast.model.anisotropy import jointed
from pyblast.model.boundary import Viscous
from pyblast.model.ground_fields import Gradient
from pyblast.model.joint import Joint
from pyblast.model.material import ConstantQ, Damping, Material, MohrCoulomb
from pyblast.model.model import InSitu, Model, Receiver
from pyblast.solver.edge_springs import ALWAYS_USED, BATCH_ONLY, EDGE_ARRAYS, without_edges
from pyblast.solver.preparation import prepare
from pyblast.solver.run import run_many, simulate, stacked
from verification.columns import ROCK

SOFT = Material.from_speeds(1800.0, 1500.0, 600.0)
SLATE = jointed(ROCK, (0.6, 0.0, 0.8), 2.0, 2e10, 1e10)
STRONG = replace(ROCK, cohesion=1e15, friction=0.5, tension=1e15, law=MohrCoulomb())
WEAK = replace(ROCK, cohesion=2e9, friction=0.5, tension=1e9, law=MohrCoulomb(0.1))
UNEVEN = Gradient(0.5, 4.0, top=8.0)
SIDES = ("west", "east", "south", "north", "bottom")
ELASTIC = {"kn": 4e9, "ks": 2e9}


def crooked(**parts):
    """Return soil on rock, cut by a joint, its inner nodes moved at random: several domains."""
    layers = [Layer("soil", 3.0), Layer("rock")]
    mesh = structured_box((8, 8, 8), (8.0, 8.0, 8.0), layers=layers)
    inside = ((mesh.points > 0.0) & (mesh.points < 8.0)).all(axis=1)
    rng = np.random.default_rng(3)
    mesh.points[inside] += rng.uniform(-0.2, 0.2, size=(np.count_nonzero(inside), 3))
    known = {"materials": {"rock": ROCK, "soil": SOFT}, "receivers": [Receiver("A", (5, 5, 8))]}
    return Model(mesh, **{**known, **parts})


def shaken(model, edges=True, n_steps=1):
    """Return the state and the ledger of a model after a random start."""
    prepared = prepare(model, 1e-9)
    constants = {**prepared.constants, "history": np.zeros((n_steps, 1))}
    constants = constants if edges else without_edges(constants)
    state = {name: value.copy() for name, value in prepared.state.items()}
    rng = np.random.default_rng(0)
    for name in ("displacement", "velocity", "memory"):
        state[name] += rng.normal(size=state[name].shape)
    _, energy, _ = core.advance(core.to_fortran(constants), state, 0, n_steps, 1)
    return state, dict(zip(core.ENERGIES, energy.T, strict=True)), constants


GROUNDS = {
    "two layers": {},
    "lagged damping": {"damping": Damping(0.05, 30.0)},
    "low-passed damping": {
        "damping": {"rock": Damping(0.05, 30.0, corner=90.0), "soil": Damping(0.02, 10.0)}
    },
    "ground that can yield": {
        "materials": {"rock": STRONG, "soil": SOFT},
        "damping": Damping(0.05, 30.0),
    },
    "ground that yields": {"materials": {"rock": WEAK, "soil": SOFT}},
    "anisotropic": {"materials": {"rock": SLATE, "soil": SOFT}, "damping": Damping(0.05, 30.0)},
}


@pytest.mark.parametrize("name", GROUNDS)
def test_edges_do_what_zones_do(name):
    model = crooked(**GROUNDS[name])

    found, energy, constants = shaken(model)
    wanted, ledger, _ = shaken(model, edges=False)

    assert (constants["set_form"] == ALWAYS_USED).all()
    assert len(constants["domain_set"]) > 2
    largest = np.abs(wanted["velocity"]).max()
    assert np.abs(found["velocity"] - wanted["velocity"]).max() < 1e-12 * largest
    for column, value in ledger.items():
        assert energy[column] == pytest.approx(value, rel=1e-11, abs=1e-11 * ledger["strain"][0])


def test_every_pair_of_nodes_of_a_group_has_one_edge():
    model = crooked()
    constants = prepare(model, 1e-9).constants

    pairs = 0
    for group in range(2):
        zones = model.mesh.zones[model.mesh.zone_group == group]
        every = np.concatenate([zones[:, [a, b]] for a in range(4) for b in range(a)])
        pairs += len(np.unique(np.sort(every, axis=1), axis=0))
    assert len(constants["edge_slot"]) == constants["edge_start"][-1] == pairs


def test_only_edges_on_the_outside_of_even_ground_are_skew():
    mesh = structured_box((8, 8, 8), (8.0, 8.0, 8.0))
    constants = prepare(Model(mesh, {"rock": ROCK}), 1e-9).constants
    domain = np.repeat(
        np.arange(len(constants["skew_start"]) - 1), np.diff(constants["skew_start"])
    )
    slot = constants["skew_slot"] + constants["domain_slot_start"][domain][:, None]
    points = Model(mesh, {"rock": ROCK}).mesh.points[constants["slot_node"][slot]]

    assert (((points == 0.0) | (points == 8.0)).all(axis=1).any(axis=1)).all()


def test_a_shift_leaves_no_force_and_a_rotation_rounding_only():
    prepared = prepare(crooked(), 1e-9)
    views = core.to_fortran(prepared.constants)

    def speed(displacement):
        state = {name: value.copy() for name, value in prepared.state.items()}
        state["displacement"] += displacement
        core.advance(views, state, 0, 1, 1)
        return np.abs(state["velocity"]).max()

    points = crooked().mesh.points
    turned = 1e-3 * np.cross([1.0, -2.0, 0.5], points)
    stretched = speed(1e-3 * points)
    assert speed(np.ones_like(points) * [0.25, -0.5, 1.0]) == 0.0
    assert speed(turned) < 1e-12 * stretched


def test_springs_of_edges_close_the_ledger():
    model = crooked(damping=None)

    _, energy, _ = shaken(model, n_steps=60)

    total = energy["kinetic"] + energy["strain"]
    assert total == pytest.approx(total[0], rel=1e-12)


def test_ground_of_uneven_stiffness_takes_edges_in_batches_only():
    model = crooked(ground=[UNEVEN])
    prepared = prepare(model, 0.01)
    constants, state = stacked([prepared.constants] * 2, [prepared.state] * 2)

    assert (prepared.constants["set_form"] == BATCH_ONLY).all()
    rng = np.random.default_rng(1)
    motion = rng.normal(size=prepared.state["velocity"].shape)
    single = {name: value.copy() for name, value in prepared.state.items()}
    single["displacement"] += motion
    state["displacement"] += motion[..., None]
    core.advance(core.to_fortran(prepared.constants), single, 0, 1, 1)
    core.advance_batch(core.to_fortran_batch(constants), state, 0, 1, 1)
    largest = np.abs(single["velocity"]).max()
    assert np.abs(state["velocity"][..., 1] - single["velocity"]).max() < 1e-12 * largest


def test_ground_that_is_not_linear_in_one_field_stays_with_its_zones():
    rock = replace(ROCK, law=ConstantQ(40.0, 20.0, (5.0, 100.0)))
    model = crooked(materials={"rock": rock, "soil": SOFT})
    form = dict(zip(model.mesh.groups, prepare(model, 1e-9).constants["set_form"], strict=True))

    assert form == {"rock": 0, "soil": ALWAYS_USED}


def test_models_whose_edges_differ_march_side_by_side_by_zones():
    stiff = jointed(ROCK, (0.6, 0.0, 0.8), 2.0, 4e10, 1e10)
    parts = [{"materials": {"rock": rock, "soil": SOFT}} for rock in (SLATE, stiff)]
    models = [crooked(**part) for part in parts]
    prepared = [prepare(model, 1e-9, step=None) for model in models]

    arrays = [{**prepared[0].constants, **{n: p.constants[n] for n in EDGE_ARRAYS}}
              for p in prepared]  # fmt: skip
    together, _ = stacked(arrays, [p.state for p in prepared])

    assert not together["set_form"].any()


def test_a_static_stage_settles_on_edges_as_on_zones(monkeypatch):
    mesh = structured_box((4, 4, 4), (8.0, 8.0, 8.0), planes={"J": ("x", 4.0)}).split(["J"])
    rock = replace(ROCK, law=ConstantQ(10.0, 5.0, (5.0, 100.0)))  # stiffer at rest than in motion
    model = Model(mesh, {"rock": rock}, joints=[Joint("J", "elastic", ELASTIC)], insitu=InSitu(),
                  boundaries=[*map(Viscous, SIDES)])  # fmt: skip
    found = prepare(model, 1e-9).state["contact_traction"]

    def by_zones(_, arrays):
        return {name: without_edges(arrays)[name] for name in EDGE_ARRAYS}

    monkeypatch.setattr("pyblast.solver.assembly.edge_arrays", by_zones)
    wanted = prepare(model, 1e-9).state["contact_traction"]

    assert found == pytest.approx(wanted, rel=1e-9, abs=1e-9 * np.abs(wanted).max())


def test_lanes_of_edges_are_alike():
    models = [crooked(damping=Damping(0.02, 20.0, corner=90.0))] * 3

    first, *others = run_many(models, 0.005)

    for other in others:
        assert np.array_equal(first.state["velocity"], other.state["velocity"])
    assert simulate(models[0], 0.005).balance_error < 1e-10
