"""Free-field sides: they follow columns of the ground beside them; what columns can't follow."""

from dataclasses import replace

import numpy as np
import pytest

from pyblast import (
    ConstantQ,
    Fixed,
    FreeField,
    InputError,
    Joint,
    Material,
    Model,
    MohrCoulomb,
    Receiver,
    Seismogram,
    SpongeLayer,
    StressInput,
    VelocityInput,
    Viscous,
    structured_box,
)
from pyblast.mesh.grid import Layer
from pyblast.model.anisotropy import jointed
from pyblast.model.ground_fields import Gradient
from pyblast.solver.free_field import GroundColumn, _Side, shake
from pyblast.solver.preparation import _run_column, prepare
from pyblast.solver.run import simulate
from verification.columns import misfit, ricker

SOIL = Material.from_speeds(1900.0, 600.0, 300.0)
ROCK = Material.from_speeds(2400.0, 2200.0, 1200.0)
MATERIALS = {"soil": SOIL, "rock": ROCK}
LAYERS = [Layer("soil", 20.0), Layer("rock")]
FREQUENCY = 5.0
SLAB = [Fixed(side, ("north",)) for side in ("south", "north")]
AROUND = ("west", "east", "south", "north")
DURATION = 0.5


def pulse(axes):
    times = np.arange(0.0, 3.0 / FREQUENCY, 0.01 / FREQUENCY)
    velocity = np.zeros((len(times), 3))
    velocity[:, axes] = ricker(times, FREQUENCY)[:, None]
    return Seismogram(velocity, times[1])


def from_below(axes=(0,)):
    return [Viscous("bottom"), StressInput("bottom", pulse(list(axes)))]


def free(*sides):
    return [kind(side) for side in sides for kind in (Viscous, FreeField)]


def ground_mesh(length=40.0, width=2.5, rise=0.0, edge=2.5):
    """Mesh 20 m of soil on 20 m of rock; the east half may be higher, with a ramp."""
    axes = [edge * np.arange(round(size / edge) + 1) for size in (length, width, 40.0)]
    mesh = structured_box(*axes, layers=LAYERS, pattern="alternating")
    points = mesh.points.copy()
    lift = rise * np.clip(4.0 * points[:, 0] / length - 1.5, 0.0, 1.0)
    points[:, 2] += lift * points[:, 2] / 40.0
    return replace(mesh, points=points)


def slab(boundaries, materials=MATERIALS, receivers=(), mesh=None, **parts):
    return Model(
        mesh or ground_mesh(),
        materials,
        boundaries=[*SLAB, *from_below(), *boundaries],
        receivers=receivers,
        **parts,
    )


def guided(axis, height=40.0, inputs=None, materials=MATERIALS):
    """Run a column between guides that let one axis move; return the motion of its top."""
    still = [n for k, n in enumerate(("east", "north", "vertical")) if k != axis]
    levels = np.linspace(0.0, height, 17)
    mesh = structured_box(
        [0.0, 2.5], [0.0, 2.5], levels, layers=[Layer("soil", height / 2), LAYERS[1]]
    )
    sides = [Fixed(side, still) for side in AROUND]
    model = Model(
        mesh,
        materials,
        boundaries=[*sides, *(inputs or from_below([axis]))],
        receivers=[Receiver("top", (1.0, 1.0, height))],
    )
    return simulate(model, DURATION).seismograms["top"]


def apart(found, columns):
    """Return the misfit of all components to columns by axis."""
    wanted = np.zeros_like(found.velocity)
    for axis, column in columns.items():
        wanted[:, axis] = np.interp(found.times, column.times, column.velocity[:, axis])
    return misfit(found.velocity, wanted)


def test_free_field_sides_move_as_columns_where_viscous_ones_drain_the_wave():
    top = [Receiver("top", (0.0, 1.0, 40.0))]
    column = {0: guided(0)}

    follows = simulate(slab(free("west", "east"), receivers=top), DURATION)
    drains = simulate(slab([Viscous("west"), Viscous("east")], receivers=top), DURATION)

    assert apart(follows.seismograms["top"], column) < 0.006  # 0.004 at 8 edges to the layer
    assert apart(drains.seismograms["top"], column) > 0.9
    assert follows.balance_error < 1e-12


def test_a_block_with_four_free_field_sides_carries_p_and_both_s_waves():
    mesh = ground_mesh(20.0, 15.0)
    model = Model(
        mesh,
        MATERIALS,
        boundaries=[*from_below([0, 1, 2]), *free(*AROUND)],
        receivers=[Receiver("corner", (20.0, 15.0, 40.0)), Receiver("mid", (10.0, 7.5, 40.0))],
    )

    result = simulate(model, DURATION)

    columns = {axis: guided(axis) for axis in range(3)}
    assert apart(result.seismograms["mid"], columns) < 0.008  # measured 0.005
    assert apart(result.seismograms["corner"], columns) < 0.012  # measured 0.008


def test_p_waves_pass_sides_of_ground_that_fades_as_in_a_column():
    law = ConstantQ(12.0, 8.0, (1.0, 20.0))
    fading = {name: replace(rock, law=law) for name, rock in MATERIALS.items()}
    top = [Receiver("top", (0.0, 1.0, 40.0))]
    model = slab(free("west", "east"), fading, top)

    result = simulate(
        replace(model, boundaries=[*SLAB, *from_below([2]), *free("west", "east")]), 0.5
    )

    column = guided(2, materials=fading)
    assert apart(result.seismograms["top"], {2: column}) < 0.012  # 0.006 without fading
    assert apart(result.seismograms["top"], {2: guided(2)}) > 0.05


def test_sides_of_uneven_ground_follow_columns_of_their_own_heights():
    ends = [Receiver("west", (0.0, 1.0, 40.0)), Receiver("east", (120.0, 1.0, 52.0 - 1e-9))]
    model = slab(free("west", "east"), mesh=ground_mesh(120.0, rise=12.0), receivers=ends)

    motion = simulate(model, 0.35).seismograms  # before the waves of the ramp arrive

    low, high = {0: guided(0)}, {0: guided(0, 52.0)}
    assert apart(motion["west"], low) < 0.02  # measured 0.014 and 0.011
    assert apart(motion["east"], high) < 0.02
    assert apart(motion["west"], high) > 0.8


def test_columns_read_groups_heights_and_speeds_of_the_ground():
    soft_on_top = [Gradient(0.4, 5.0, 40.0)]
    model = slab(free("west", "east"), mesh=ground_mesh(rise=12.0), ground=soft_on_top)

    west, east = (_Side(model, side).columns[0] for side in ("west", "east"))

    assert west.levels == pytest.approx(2.5 * np.arange(17))
    assert east.levels[-1] == pytest.approx(52.0)
    assert [group for group, _ in west.cells] == ["rock"] * 8 + ["soil"] * 8
    factors = [factor for _, factor in west.cells]
    assert factors[-1] < 0.8 < 0.99 < factors[0]


def test_level_ground_needs_one_column_for_all_sides():
    model = Model(ground_mesh(20.0, 15.0), MATERIALS, boundaries=[*from_below(), *free(*AROUND)])

    assert len({column for side in AROUND for column in _Side(model, side).columns}) == 1


def test_stress_from_the_mass_above_is_that_of_the_springs():
    column = GroundColumn(tuple(2.5 * np.arange(17.0)), (("rock", 1.0),) * 8 + (("soil", 1.0),) * 8)
    model = slab([])

    shaking = shake(model, column, [model.boundaries[3]], 5e-4, DURATION, _run_column)

    velocity = shaking.velocity[0]
    jump = velocity[10].integral().values - velocity[9].integral().values
    wanted = SOIL.shear * jump / 2.5
    assert misfit(shaking.stress[0][9].values, wanted) < 2e-3  # integrals at whole steps


def test_a_prescribed_motion_of_the_base_moves_the_columns_too():
    top = [Receiver("top", (0.0, 1.0, 40.0))]
    base = VelocityInput("bottom", pulse([0]))
    model = Model(
        ground_mesh(), MATERIALS, boundaries=[*SLAB, base, *free("west", "east")], receivers=top
    )

    found = simulate(model, DURATION).seismograms["top"]

    assert apart(found, {0: guided(0, inputs=[base])}) < 0.008  # measured 0.005


def refused(boundaries=(), **parts):
    prepare(slab([*boundaries, *free("west", "east")], **parts), 0.01)


def test_a_free_field_side_must_be_viscous():
    with pytest.raises(InputError, match=r"boundaries.west: FreeField needs the dashpots"):
        slab([FreeField("west")])


def test_free_field_sides_without_input_from_below_are_refused():
    model = Model(ground_mesh(), MATERIALS, boundaries=[*SLAB, *free("west")])

    with pytest.raises(InputError, match="nothing enters from below"):
        prepare(model, 0.01)


def test_input_through_a_side_is_refused():
    with pytest.raises(InputError, match=r"from below only, got input through 'east'"):
        refused([StressInput("east", pulse([0]))])


def test_a_sponge_layer_is_refused():
    with pytest.raises(InputError, match="a sponge layer or local damping would damp"):
        refused(sponge=SpongeLayer(((10.0, 30.0), (0.0, 5.0), (10.0, 40.0)), 10.0))


@pytest.mark.parametrize(
    ("rock", "law"),
    [
        (replace(ROCK, cohesion=1e6, law=MohrCoulomb()), "mohr-coulomb"),
        (jointed(ROCK, [0.0, 0.0, 1.0], 2.0, 1e10, 1e9), "anisotropic"),
    ],
)
def test_laws_that_columns_can_not_follow_are_refused(rock, law):
    with pytest.raises(InputError, match=f"can't follow the law '{law}' of 'rock' at 'west'"):
        refused(materials={"soil": SOIL, "rock": rock})


def test_a_joint_that_reaches_a_side_is_refused():
    axes = [2.5 * np.arange(n) for n in (17, 2, 17)]
    mesh = structured_box(*axes, layers=LAYERS, planes={"J1": ("z", 10.0)}).split(["J1"])

    with pytest.raises(InputError, match="the joint 'J1' reaches the side 'west'"):
        refused(mesh=mesh, joints=[Joint("J1", "elastic", {"kn": 1e9, "ks": 1e9})])


def test_a_side_that_leans_is_refused():
    mesh = ground_mesh()
    points = mesh.points.copy()
    points[:, 0] += 0.1 * points[:, 2]

    with pytest.raises(InputError, match="'west' must be a vertical plane"):
        refused(mesh=replace(mesh, points=points))


def test_a_side_above_the_base_is_refused():
    mesh = ground_mesh()
    high = mesh.points[mesh.surfaces["west"]][..., 2].min(axis=1) > 9.0
    surfaces = {**mesh.surfaces, "west": mesh.surfaces["west"][high]}

    with pytest.raises(InputError, match="must reach down to the level of the input"):
        refused(mesh=replace(mesh, surfaces=surfaces))
