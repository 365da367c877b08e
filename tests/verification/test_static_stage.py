"""Stress before the blast: overburden on joints, horizontal ratio, rest before the march."""

from dataclasses import replace

import numpy as np
import pytest

from pyblast import core
from pyblast.errors import InputError, SolverError
from pyblast.mesh.builder import Layer, structured_box
from pyblast.model.boundary import Fixed, Roller, Viscous
from pyblast.model.joint import Joint
from pyblast.model.material import Material, MohrCoulomb
from pyblast.model.model import InSitu, Model, Receiver
from pyblast.model.source import PointForce, TimeFunction
from pyblast.solver.initial_stress import after_static, yield_states
from pyblast.solver.run import prepare, simulate
from verification.cases import water
from verification.columns import ROCK, ricker
from verification.contact import properties

GRAVITY = 9.81
SIDES = ("west", "east", "south", "north")
STRONG = {"kn": 1e9, "ks": 5e8, "cohesion": 1e7, "friction": 0.7, "tension": 1e6}
WEAK = {**STRONG, "cohesion": 0.0, "tension": 0.0}


def hill(planes, *, law=STRONG, sides=Roller, base=Fixed, insitu=None, bumpy=False, layers=None):
    mesh = structured_box((3, 3, 10), (30.0, 30.0, 100.0), planes=planes, layers=layers)
    if bumpy:
        x, _, z = mesh.points.T
        mesh.points[:, 2] += 0.1 * z * np.sin(0.1 * x)
    return Model(
        mesh.split(list(planes)),
        {"rock": ROCK, "soil": Material.from_speeds(1500.0, 1000.0, 500.0)},
        joints=[Joint(name, "coulomb", law) for name in planes],
        boundaries=[*map(sides, SIDES), base("bottom")],
        receivers=[Receiver("top", (15.0, 15.0, 99.0))],
        insitu=insitu or InSitu(GRAVITY, 0.5),
    )


def joint_traction(model):
    """Return the normal traction and largest shear of the contacts, with area as weight."""
    prepared = prepare(model, 0.01)
    traction, contacts = prepared.constants["contact_initial"], model.mesh.contacts
    normal = np.einsum("ij,ij->i", traction, contacts.normal)
    shear = np.linalg.norm(traction - normal[:, None] * contacts.normal, axis=1)
    return np.average(normal, weights=contacts.area), shear.max(), prepared


@pytest.mark.parametrize("depth", [20.0, 50.0, 80.0])
@pytest.mark.parametrize("sides", [Roller, Viscous])
def test_a_horizontal_joint_carries_the_weight_above(depth, sides):
    model = hill({"J": ("z", 100.0 - depth)}, sides=sides)

    pressure, shear, _ = joint_traction(model)

    overburden = ROCK.density * GRAVITY * depth
    assert pressure == pytest.approx(-overburden, rel=1e-3)
    assert shear < 0.01 * overburden


def test_layers_weigh_what_they_are():
    layers = [Layer("soil", 30.0), Layer("rock")]

    pressure, _, _ = joint_traction(hill({"J": ("z", 40.0)}, layers=layers))

    overburden = GRAVITY * (1500.0 * 30.0 + ROCK.density * 30.0)
    assert pressure == pytest.approx(-overburden, rel=1e-3)


def test_a_bumpy_surface_still_rests_on_its_joint_with_its_weight():
    model = hill({"J": ("z", 50.0)}, bumpy=True)

    contacts = model.mesh.contacts
    vertical = prepare(model, 0.01).constants["contact_initial"][:, 2] @ contacts.area

    density, zones = ROCK.density, model.mesh.zones
    corners = model.mesh.points[zones]
    volume = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1])) / 6.0
    above = model.mesh.blocks() == model.mesh.blocks()[corners.mean(axis=1)[:, 2].argmax()]
    assert vertical == pytest.approx(-density * GRAVITY * volume[above].sum(), rel=1e-3)


@pytest.mark.parametrize("ratio", [0.3, 0.5, 1.2])
def test_a_vertical_joint_carries_the_horizontal_ratio(ratio):
    model = hill({"J": ("x", 10.0)}, insitu=InSitu(GRAVITY, ratio))

    pressure, _, _ = joint_traction(model)

    mean = 0.5 * ROCK.density * GRAVITY * 100.0
    assert pressure == pytest.approx(-ratio * mean, rel=2e-3)


def test_displacement_is_reset_and_nothing_moves_without_a_blast():
    model = hill({"J": ("z", 50.0)}, bumpy=True)
    prepared = prepare(model, 0.1)

    result = simulate(model, 0.1, prepared=prepared)

    assert prepared.static["unbalanced"] < 1e-5
    assert not prepared.state["displacement"].any()
    assert not prepared.state["velocity"].any()
    assert np.abs(result.state["velocity"]).max() < 1e-12


def test_two_preparations_give_the_same_bits():
    model = hill({"J": ("z", 50.0)}, bumpy=True)

    assert len({prepare(model, 0.01).fingerprint for _ in range(3)}) == 1


def test_there_is_no_static_stage_without_in_situ_stress_or_joints():
    alone = Model(structured_box((2, 2, 2), (2.0, 2.0, 2.0)), {"rock": ROCK}, insitu=InSitu())

    assert not prepare(alone, 0.01).static


def test_pressure_raises_the_strength_of_a_joint():
    times = np.arange(0.0, 0.1, 1e-3)
    push = TimeFunction(1e9 * ricker(times, 30.0), 1e-3)
    slips = []
    for depth in (10.0, 80.0):
        force = PointForce(np.array([15.0, 15.0, 105.0 - depth]), np.array([1.0, 0.0, 0.0]), push)
        model = replace(hill({"J": ("z", 100.0 - depth)}, law=WEAK), sources=(force,))
        slips.append(np.abs(simulate(model, 0.1).state["contact_state"][:, :3]).max())

    assert slips[0] > 0.0
    assert slips[1] < 0.5 * slips[0]


def test_a_block_that_nothing_holds_is_named_as_the_likely_cause(monkeypatch):
    monkeypatch.setattr("pyblast.solver.preparation.STATIC_STEPS", 2000)
    mesh = structured_box((2, 2, 4), (20.0, 20.0, 40.0), planes={"J": ("z", 20.0)}).split(["J"])
    model = Model(
        mesh,
        {"rock": ROCK},
        joints=[Joint("J", "coulomb", WEAK)],
        boundaries=[Fixed("top")],
        insitu=InSitu(),
    )

    with pytest.raises(SolverError, match="static stage"):
        prepare(model, 0.01)


def test_a_gap_that_the_static_stage_leaves_must_close_before_the_joint_presses():
    hanging = hill({"J": ("z", 50.0)}, law=WEAK, insitu=InSitu(GRAVITY, 0.5))
    prepared = prepare(hanging, 0.01)
    geometry = prepared.constants
    settled = {name: value.copy() for name, value in prepared.state.items()}
    gap = 1e-3
    upper = geometry["contact_node"][:, 1]
    settled["displacement"][upper, 2] += gap
    settled["contact_state"][:, 4:6] = 2.0, gap
    settled["contact_traction"][:] = 0.0
    static = {**geometry, "contact_initial": np.zeros_like(geometry["contact_initial"])}

    constants, state = after_static(geometry, static, settled)

    for share, presses in ((0.9, False), (1.1, True)):
        trial = {name: value.copy() for name, value in state.items()}
        trial["displacement"][upper, 2] -= share * gap
        core.advance(core.to_fortran(constants), trial, 0, 1, 1)
        assert np.all((trial["contact_traction"][:, 2] < 0.0) == presses)


LAWS = list(core.JOINT_LAWS)


@pytest.mark.parametrize("law", LAWS)
def test_a_joint_of_any_law_starts_its_stage_at_rest_under_the_weight_above(law):
    model = replace(hill({"J": ("z", 50.0)}), joints=[Joint("J", law, properties(law))])

    pressure, _, prepared = joint_traction(model)
    result = simulate(model, 0.1, prepared=prepared)

    assert pressure == pytest.approx(-ROCK.density * GRAVITY * 50.0, rel=1e-3)
    assert np.abs(result.state["velocity"]).max() < 1e-11


@pytest.mark.parametrize("law", [law for law in LAWS if core.JOINT_LAWS[law].opens])
def test_a_gap_outlives_the_static_stage_under_any_law(law):
    joint = Joint("J", law, properties(law), insitu_pressure=1e6)
    model = replace(hill({"J": ("z", 50.0)}), joints=[joint], insitu=None)
    prepared = prepare(model, 0.01)
    upper = prepared.constants["contact_node"][:, 1]

    def moved(constants, state, rise):
        trial = {name: value.copy() for name, value in state.items()}
        trial["displacement"][upper, 2] += rise
        core.advance(core.to_fortran(constants), trial, 0, 1, 1)
        return trial

    lifted = moved(prepared.constants, prepared.state, 5e-3)
    settled = {**lifted, "displacement": np.zeros_like(lifted["displacement"])}
    constants, state = after_static(prepared.constants, prepared.constants, settled)
    gap = lifted["contact_state"][0, 5]

    assert gap > 1e-3
    for share, presses in ((0.99, False), (1.01, True)):
        closed = moved(constants, state, -share * gap)
        assert np.all((closed["contact_traction"][:, 2] < 0.0) == presses)


def test_water_takes_its_pressure_off_the_stress_by_which_ground_yields():
    rock = Material.from_speeds(
        2500.0, 4000.0, 2000.0, cohesion=1e6, friction=0.6, tension=1e5, law=MohrCoulomb(0.1)
    )
    mesh = structured_box((2, 2, 8), (20.0, 20.0, 80.0))
    model = Model(
        mesh, {"rock": rock}, boundaries=[*map(Roller, SIDES), Fixed("bottom")],
        insitu=InSitu(GRAVITY, 0.5, water_table=50.0),
    )  # fmt: skip
    prepared = prepare(model, 0.01)

    zone, stress, _ = yield_states(prepared.constants, prepared.state)

    heights = model.mesh.points[model.mesh.zones[zone], 2].mean(axis=1)
    pressure = 1000.0 * GRAVITY * np.maximum(50.0 - heights, 0.0)
    vertical = -2500.0 * GRAVITY * (80.0 - heights)
    assert stress[:, 2] == pytest.approx(vertical + pressure, rel=0.02, abs=3e4)
    assert stress[:, 0] == pytest.approx(0.5 * vertical + pressure, rel=0.02, abs=3e4)


@pytest.mark.parametrize("head", [0.0, 20.0])
def test_a_joint_keeps_the_shear_of_its_effective_stress(head):
    strength = water.COHESION + water.FRICTION * GRAVITY * (40.0 * 2500.0 - 1000.0 * head)

    assert water.resistance(60.0 + head) == pytest.approx(strength, rel=1e-4)


def test_water_above_the_ground_presses_below_its_level_only():
    assert InSitu(10.0, water_table=5.0).pore_pressure([7.0, 5.0, 2.0]).tolist() == [0.0, 0.0, 3e4]


def test_water_without_a_level_or_with_a_negative_weight_is_refused():
    with pytest.raises(InputError, match=r"insitu.water_table: must be finite"):
        InSitu(water_table=np.inf)
    with pytest.raises(InputError, match=r"insitu.water_density: must not be negative"):
        InSitu(water_density=-1.0)


def test_a_mesh_split_along_no_joint_rests_under_its_weight():
    mesh = structured_box((2, 2, 4), (20.0, 20.0, 40.0)).split([])
    model = Model(mesh, {"rock": ROCK}, boundaries=[*map(Roller, SIDES), Fixed("bottom")],
                  insitu=InSitu(GRAVITY, 0.5))  # fmt: skip

    assert not np.abs(prepare(model, 0.01).state["velocity"]).any()
