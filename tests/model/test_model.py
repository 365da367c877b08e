"""Models: parts that do not fit are refused by name; what a model tells about itself."""

from dataclasses import replace

import numpy as np
import pytest

from pyblast.errors import InputError
from pyblast.mesh.builder import Layer, structured_box
from pyblast.model.boundary import Fixed, StressInput, VelocityInput, Viscous
from pyblast.model.joint import Joint
from pyblast.model.material import Damping, Material
from pyblast.model.model import InSitu, Model, Receiver, SpongeLayer
from pyblast.model.source import Hole, TimeFunction
from pyblast.signals.seismogram import Seismogram
from pyblast.solver.preparation import prepare
from verification.columns import ROCK

SOFT = Material.from_speeds(1800.0, 800.0, 170.0)
ELASTIC = Joint("J", "elastic", {"kn": 1e9, "ks": 5e8})
SHAKING = Seismogram(np.zeros((10, 3)), 1e-3)


def box(split=False, layers=None):
    mesh = structured_box((4, 4, 4), (20.0, 20.0, 20.0), planes={"J": ("x", 10.0)}, layers=layers)
    return mesh.split(["J"]) if split else mesh


def layered(**parts):
    layers = [Layer("soil", 5.0), Layer("rock")]
    return Model(box(layers=layers), {"rock": ROCK, "soil": SOFT}, **parts)


def test_a_group_without_material_is_refused():
    with pytest.raises(InputError, match=r"materials\.rock: missing"):
        Model(box(), {"granite": ROCK})


def test_a_group_without_damping_is_refused_where_damping_is_by_group():
    with pytest.raises(InputError, match=r"damping\.soil: missing"):
        layered(damping={"rock": Damping(0.01, 4.0)})


def test_a_joint_whose_surface_is_not_split_is_refused():
    with pytest.raises(InputError, match=r"joints\.J: must be one split surface.*split are none"):
        Model(box(), {"rock": ROCK}, joints=[ELASTIC])


def test_a_split_surface_without_joint_is_refused():
    with pytest.raises(InputError, match=r"joints\.J: the mesh is split there, but no joint"):
        Model(box(split=True), {"rock": ROCK})


def test_two_joints_on_one_surface_are_refused():
    with pytest.raises(InputError, match=r"joints\.J: must be one split surface"):
        Model(box(split=True), {"rock": ROCK}, joints=[ELASTIC, ELASTIC])


def test_a_boundary_on_an_unknown_surface_is_refused():
    with pytest.raises(InputError, match=r"boundaries\.wset: no such surface; there are west"):
        Model(box(), {"rock": ROCK}, boundaries=[Viscous("wset")])


def test_fixed_and_viscous_exclude_one_another():
    with pytest.raises(InputError, match=r"boundaries\.west: Fixed and Viscous exclude"):
        Model(box(), {"rock": ROCK}, boundaries=[Viscous("west"), Fixed("west")])


@pytest.mark.parametrize("components", [(), ("up",), ("east", "z")])
def test_a_fixed_component_that_is_none_is_refused(components):
    with pytest.raises(InputError, match=r"boundaries\.west\.components: must be some of east"):
        Fixed("west", components)


def test_two_receivers_of_one_name_are_refused():
    twice = [Receiver("A", (1.0, 1.0, 1.0)), Receiver("A", (2.0, 1.0, 1.0))]

    with pytest.raises(InputError, match="receivers: two receivers have the same name"):
        Model(box(), {"rock": ROCK}, receivers=twice)


def test_a_receiver_outside_the_mesh_is_refused():
    model = Model(box(), {"rock": ROCK}, receivers=[Receiver("A", (100.0, 1.0, 1.0))])

    with pytest.raises(InputError, match="must lie in the mesh"):
        prepare(model, 0.01)


@pytest.mark.parametrize("factor", [0.0, 1.01, -1.0, np.nan])
def test_a_step_factor_out_of_range_is_refused(factor):
    with pytest.raises(InputError, match="step_factor: must lie in 0 to 1"):
        Model(box(), {"rock": ROCK}, step_factor=factor)


@pytest.mark.parametrize(
    ("changed", "message"), [({"charge": 0.0}, "hole.charge"), ({"time": -1.0}, "hole.time")]
)
def test_a_hole_that_is_none_is_refused(changed, message):
    rate = TimeFunction(np.ones(3), 1e-3)

    with pytest.raises(InputError, match=message):
        Hole(
            **{"position": np.zeros(3), "charge": 1.0, "time": 0.0, "moment_rate": rate, **changed}
        )


@pytest.mark.parametrize("values", [[], [0.0, np.nan], [[0.0, 1.0]]])
def test_samples_that_are_no_function_of_time_are_refused(values):
    with pytest.raises(InputError, match="time function: values must be one row of finite"):
        TimeFunction(values, 1e-3)


def test_stress_is_doubled_where_the_surface_is_viscous_unless_said_otherwise():
    own = StressInput("west", SHAKING)
    model = Model(box(), {"rock": ROCK}, boundaries=[Viscous("west"), own])
    bare = Model(box(), {"rock": ROCK}, boundaries=[own])

    assert model.doubles(own)
    assert not bare.doubles(own)
    assert not model.doubles(StressInput("west", SHAKING, doubled=False))


def test_an_input_that_lacks_a_component_is_refused():
    motion = np.zeros((10, 3))
    motion[:, 1] = np.nan
    inputs = [VelocityInput("west", Seismogram(motion, 1e-3))]

    with pytest.raises(InputError, match="component north was not recorded"):
        prepare(Model(box(), {"rock": ROCK}, boundaries=inputs), 0.01)


def test_an_input_that_is_not_geographic_is_refused():
    turned = Seismogram(np.zeros((10, 3)), 1e-3).rotated(0.3)

    with pytest.raises(InputError, match="needs components east, north, vertical"):
        prepare(Model(box(), {"rock": ROCK}, boundaries=[StressInput("west", turned)]), 0.01)


def test_a_joint_can_be_changed_without_touching_the_model():
    model = Model(box(split=True), {"rock": ROCK}, joints=[ELASTIC])

    stiffer = model.with_joint("J", kn=7e9)

    assert stiffer.joints[0].properties == {"kn": 7e9, "ks": 5e8}
    assert model.joints[0].properties["kn"] == 1e9


def test_zone_values_follow_the_groups():
    model = layered()

    soil = model.mesh.points[model.mesh.zones].mean(axis=1)[:, 2] > 15.0
    assert (model.zone_values("cs")[soil] == SOFT.cs).all()
    assert (model.zone_values("cs")[~soil] == ROCK.cs).all()


def test_damping_by_group_reaches_its_zones():
    model = layered(damping={"rock": Damping(0.01, 4.0), "soil": Damping(0.05, 4.0, mass=False)})

    soil = model.zone_values("cs") == SOFT.cs
    assert not model.zone_damping("alpha")[soil].any()
    assert model.zone_damping("beta")[soil] == pytest.approx(0.05 / (8.0 * np.pi))
    assert model.zone_damping("alpha")[~soil] == pytest.approx(0.01 * 8.0 * np.pi)


def test_the_highest_frequency_is_ten_edges_per_s_wave():
    frequencies = layered().highest_frequency()

    edge = np.array([5.0, 5.0, 5.0, 5.0 * 2**0.5, 5.0 * 2**0.5, 5.0 * 3**0.5]).mean()
    assert frequencies["soil"] == pytest.approx(SOFT.cs / (10.0 * edge), rel=0.01)
    assert frequencies["rock"] == pytest.approx(ROCK.cs / (10.0 * edge), rel=0.01)


@pytest.mark.parametrize("gravity", [-1.0, np.nan, np.inf])
def test_an_impossible_gravity_is_refused(gravity):
    with pytest.raises(InputError, match=r"insitu\.gravity: must not be negative, got"):
        InSitu(gravity)


def test_a_negative_ratio_of_stresses_is_refused():
    with pytest.raises(InputError, match=r"insitu\.horizontal_ratio: must not be negative, got -1"):
        InSitu(horizontal_ratio=-1.0)


@pytest.mark.parametrize("width", [0.0, -5.0, np.nan, np.inf])
def test_a_rim_without_width_is_refused(width):
    with pytest.raises(InputError, match=r"sponge\.width: must be positive, got"):
        SpongeLayer(((0.0, 1.0), (0.0, 1.0), (0.0, 1.0)), width)


def test_a_rim_around_nothing_is_refused():
    with pytest.raises(InputError, match=r"sponge\.box: must be three ascending pairs"):
        SpongeLayer(((0.0, 1.0), (2.0, 1.0), (0.0, 1.0)), 5.0)


def test_surfaces_that_meet_are_moved_alike_or_refused():
    other = Seismogram(np.ones((10, 3)), 1e-3)
    west = VelocityInput("west", SHAKING)

    with pytest.raises(InputError, match=r"boundaries\.south: meets 'west' at 5 nodes"):
        Model(box(), {"rock": ROCK}, boundaries=[west, VelocityInput("south", other)])

    for moved in (VelocityInput("south", SHAKING), VelocityInput("east", other)):
        assert Model(box(), {"rock": ROCK}, boundaries=[west, moved])


def test_a_rim_damps_outside_its_box_only():
    sponge = SpongeLayer(((5.0, 15.0), (5.0, 15.0), (5.0, 20.0)), 5.0)
    model = Model(box(), {"rock": ROCK}, sponge=sponge)

    alpha, centres = model.zone_damping("alpha"), model.mesh.points[model.mesh.zones].mean(axis=1)
    inside = ((centres > 5.0) & (centres < [15.0, 15.0, 21.0])).all(axis=1)
    assert not alpha[inside].any()
    assert (alpha[~inside] > 0.0).all()


def test_renumbering_changes_the_order_and_nothing_else():
    mesh = box(split=True)
    model = Model(mesh, {"rock": ROCK}, joints=[ELASTIC])

    def described(one):
        zones = np.sort(one.points[one.zones].reshape(len(one.zones), -1).sum(axis=1))
        at = one.points[one.contacts.minus]
        west = np.sort(one.points[one.surfaces["west"]].sum(axis=(1, 2)))
        return zones, np.sort(at @ [1.0, 10.0, 100.0] + one.contacts.area), west

    for one, other in zip(described(mesh), described(model.mesh), strict=True):
        assert one == pytest.approx(other, rel=1e-12)
    assert model.mesh.points[model.mesh.contacts.minus] == pytest.approx(
        model.mesh.points[model.mesh.contacts.plus]
    )


def test_a_changed_model_keeps_its_order():
    model = Model(box(), {"rock": ROCK})

    assert replace(model, step_factor=0.5).mesh is model.mesh
