"""Whole models that yield: patches, ledger, axes, restart, static stage, slow loading."""

from dataclasses import replace

import meshio
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pyblast import core
from pyblast.errors import InputError
from pyblast.mesh.builder import Layer, structured_box
from pyblast.mesh.mesh import Mesh
from pyblast.mesh.nodes import MOST
from pyblast.model.boundary import Fixed, Roller, StressInput, VelocityInput, Viscous
from pyblast.model.joint import Joint
from pyblast.model.material import Material, MohrCoulomb
from pyblast.model.model import InSitu, Model, Receiver
from pyblast.report.maps import write_zones, yield_fields
from pyblast.signals.seismogram import Seismogram
from pyblast.solver import assembly
from pyblast.solver.initial_stress import yield_states
from pyblast.solver.preparation import prepare
from pyblast.solver.run import simulate
from verification.cases.anisotropy import DIRECTIONS, mesh_speeds
from verification.columns import ROCK, ricker, started
from verification.solutions.plasticity import triaxial_strength

SIDES = ("west", "east", "south", "north", "bottom")
TIMES = np.arange(0.0, 0.1, 5e-4)
SOFT = MohrCoulomb(0.1, cohesion_residual=5e5, tension_residual=0.0, shear_strain=1e-3)
WEAK = replace(ROCK, cohesion=1e6, friction=0.5, tension=5e5, law=SOFT)


def crooked(seed=2, shape=(6, 4, 4), **how):
    mesh = structured_box(shape, tuple(5.0 * n for n in shape), **how)
    inside = ((mesh.points > 0.0) & (mesh.points < mesh.points.max(axis=0))).all(axis=1)
    moves = np.random.default_rng(seed).uniform(-0.7, 0.7, size=mesh.points.shape)
    return Mesh(
        mesh.points + inside[:, None] * moves, mesh.zones, mesh.zone_group, mesh.groups,
        mesh.surfaces,
    )  # fmt: skip


def shaken(turn=None, rock=WEAK, **how):
    turn = turn or Rotation.identity()
    mesh = crooked()
    mesh = Mesh(turn.apply(mesh.points), mesh.zones, mesh.zone_group, mesh.groups, mesh.surfaces)
    motion = ricker(TIMES, 40.0)[:, None] * [0.8, 0.5, -0.3]
    shaking = Seismogram(turn.apply(motion), TIMES[1])
    model = Model(
        mesh,
        {"rock": rock},
        boundaries=[*map(Viscous, SIDES), StressInput("west", shaking)],
        receivers=[Receiver("A", tuple(turn.apply([17.0, 9.0, 12.0])))],
    )
    return simulate(model, 0.1, **how)


def test_the_ledger_of_yielding_ground_closes_to_rounding():
    result = shaken()

    assert result.energy["zone_dissipated"][-1] > 0.01 * result.energy["input"][-1]
    assert result.balance_error < 1e-10


def test_energy_left_alone_only_falls_while_ground_yields():
    model = Model(crooked(), {"rock": WEAK})
    velocity = 0.3 * np.random.default_rng(3).normal(size=model.mesh.points.shape)
    dt = prepare(model, 1.0).constants["dt"]

    result = started(model, 2000 * dt, 0.0 * velocity, velocity)

    energy = result.energy
    held = energy["kinetic"] + energy["strain"]
    assert (np.diff(held) <= 1e-3 * held[0]).all()
    assert held[-1] < 0.9 * held[0]
    assert result.balance_error < 1e-10


def test_a_turned_model_yields_alike():
    turn = Rotation.random(rng=np.random.default_rng(1))

    lasting = replace(WEAK, law=MohrCoulomb(0.1))  # softening would let rounding choose a band

    straight, other = (shaken(t, lasting) for t in (None, turn))

    wanted = turn.apply(straight.seismograms["A"].velocity.copy())
    found = other.seismograms["A"].velocity
    assert found == pytest.approx(wanted, abs=1e-9 * np.abs(wanted).max())
    assert straight.energy["zone_dissipated"][-1] > 0.0


def test_an_interrupted_run_of_yielding_ground_goes_on_with_the_same_bits(tmp_path, monkeypatch):
    monkeypatch.setattr("pyblast.solver.preparation.CHUNK_SECONDS", 0.005)
    path = tmp_path / "checkpoint.h5"

    def stop(stage, done, total):
        if stage == "dynamic" and 0.3 * total < done < total:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        shaken(progress=stop, checkpoint=path)

    whole, resumed = shaken(), shaken(resume=path)
    for name in core.STATE:
        assert np.array_equal(whole.state[name], resumed.state[name]), name


def accelerations(model, displacement):
    """Return what the zones of a model do to its nodes (n_nodes, 3) at some displacement."""
    prepared = prepare(model, 1e-3)
    state = {name: value.copy() for name, value in prepared.state.items()}
    state["displacement"] = displacement
    core.advance(core.to_fortran(prepared.constants), state, 0, 1, 1)
    return state["velocity"] * prepared.constants["node_mass"][:, None], state, prepared


@pytest.mark.parametrize("size", [1e-6, 3e-3])
def test_linear_displacement_leaves_no_force_inside_whether_or_not_it_yields(size):
    model = Model(crooked(), {"rock": WEAK})
    points = model.mesh.points
    displacement = points @ np.random.default_rng(1).normal(scale=size, size=(3, 3))

    force, state, prepared = accelerations(model, displacement)

    inside = ((points > 1e-9) & (points < points.max(axis=0) - 1e-9)).all(axis=1)
    assert np.abs(force[inside]).max() < 1e-11 * np.abs(force).max()
    assert (yield_states(prepared.constants, state)[2].max() > 0.0) == (size > 1e-4)


def test_a_rigid_motion_of_yielding_ground_meets_no_force():
    model = Model(crooked(), {"rock": WEAK})
    points = model.mesh.points

    force, *_ = accelerations(model, 0.1 + np.cross([3e-3, -2e-3, 5e-3], points))

    stretched, *_ = accelerations(model, 1e-5 * points)
    assert np.abs(force).max() < 1e-8 * np.abs(stretched).max()


def test_patches_are_the_cells_of_a_grid():
    mesh = structured_box((12, 11, 10), (12.0, 13.0, 9.0))
    model = Model(mesh, {"rock": WEAK})

    arrays, _ = assembly.geometry_arrays(model)

    domains = np.searchsorted(
        arrays["domain_zone_start"], np.arange(len(model.mesh.zones)), "right"
    )
    patch = 10000 * domains + arrays["zone_patch"]
    cell = np.floor(model.mesh.points[model.mesh.zones].mean(axis=1) / [1.0, 13.0 / 11.0, 0.9])
    pairs = np.unique(np.column_stack([patch, cell]), axis=0)
    assert len(np.unique(patch)) == len(pairs) == 12 * 11 * 10


@pytest.mark.parametrize("pattern", ["kuhn", "alternating"])
def test_patches_keep_to_their_block_and_material(pattern):
    mesh = crooked(
        shape=(6, 5, 4), layers=[Layer("rock", 10.0), Layer("soil", 5.0), Layer("base")],
        planes={"J": ("x", 15.0)}, pattern=pattern,
    ).split(["J"])  # fmt: skip
    joint = Joint("J", "elastic", {"kn": 1e9, "ks": 1e9})
    model = Model(mesh, {"rock": WEAK, "soil": WEAK, "base": ROCK}, joints=[joint])

    patch = model.patches()

    assert ((patch < 0) == (model.mesh.zone_group == 2)).all()
    together = patch[patch >= 0]
    assert np.bincount(together).max() <= MOST
    assert np.bincount(together).mean() > 4.0
    for label in (model.mesh.blocks(), model.mesh.zone_group):
        alike = np.unique(np.column_stack([together, label[patch >= 0]]), axis=0)
        assert len(alike) == together.max() + 1


@pytest.mark.parametrize("poisson", [0.25, 0.33, 0.45])
def test_patches_let_waves_run_no_faster_whatever_the_poisson_ratio(poisson):
    strong = Material.from_young_poisson(2500.0, 2e10, poisson, cohesion=1e15, law=MohrCoulomb())
    ways = DIRECTIONS / np.linalg.norm(DIRECTIONS, axis=1)[:, None]

    found = np.array([mesh_speeds(strong, 10, way) for way in ways])

    shear = found[:, :2] / strong.cs - 1.0  # single zones: up to +4, +6, +21 %
    assert shear.min() > -0.017
    assert shear.max() < 0.002
    compression = found[:, 2] / strong.cp - 1.0
    assert compression.min() > -0.046
    assert compression.max() < -0.016


def test_ground_where_nothing_yields_has_no_patches():
    arrays, _ = assembly.geometry_arrays(Model(crooked(), {"rock": ROCK}))

    assert (arrays["zone_patch"] == -1).all()


def pillar(**parts):
    mesh = structured_box((2, 2, 8), (10.0, 10.0, 40.0))
    return Model(
        mesh, {"rock": parts.pop("rock", WEAK)},
        boundaries=[Fixed("bottom"), *parts.pop("boundaries", ())],
        receivers=[Receiver("top", (5.0, 5.0, 39.0))], **parts,
    )  # fmt: skip


def test_strong_ground_settles_to_its_overburden_and_stays_at_rest():
    model = pillar(boundaries=map(Roller, SIDES[:4]), insitu=InSitu(9.81, 0.5))
    prepared = prepare(model, 0.05)

    zone, stress, plastic = yield_states(prepared.constants, prepared.state)
    result = simulate(model, 0.05, prepared=prepared)

    depth = 40.0 - model.mesh.points[model.mesh.zones].mean(axis=1)[zone, 2]
    assert not plastic.any()
    assert stress[:, 2] == pytest.approx(-ROCK.density * 9.81 * depth, rel=0.02, abs=5e4)
    assert np.abs(result.state["velocity"]).max() < 1e-12


def test_ground_that_its_weight_breaks_keeps_its_damage_but_not_its_strain():
    loose = replace(WEAK, cohesion=1e4, friction=0.8, tension=0.0, law=MohrCoulomb())
    model = pillar(rock=loose, boundaries=map(Roller, SIDES[:4]), insitu=InSitu(9.81, 0.15))

    prepared = prepare(model, 0.05)
    _, stress, plastic = yield_states(prepared.constants, prepared.state)
    result = simulate(model, 0.05, prepared=prepared)

    assert (plastic[:, 0] > 0.0).mean() > 0.5
    assert not prepared.state["row_state"][:, 6:12].any()
    limit = triaxial_strength(-stress[:, :2].max(axis=1), 1e4, 0.8)
    assert (-stress[:, 2] <= limit + 1e-3 * np.abs(stress[:, 2])).all()
    assert np.abs(result.state["velocity"]).max() < 1e-4


def test_zones_for_paraview_show_where_ground_yielded(tmp_path):
    result = shaken()
    mesh = crooked()

    fields = yield_fields(result)
    write_zones(tmp_path / "zones.vtu", mesh.points, mesh.zones, fields)

    found = meshio.read(tmp_path / "zones.vtu").cell_data
    assert found["plastic_shear"][0].max() > 0.0
    assert found["stress"][0].shape == (len(mesh.zones), 6)


def test_yielding_blocks_on_a_joint_settle_and_stay_at_rest():
    loose = replace(WEAK, cohesion=1e4, friction=0.8, tension=0.0, law=MohrCoulomb())
    mesh = structured_box((2, 2, 8), (10.0, 10.0, 40.0), planes={"J": ("z", 20.0)}).split(["J"])
    strong = {"kn": 1e9, "ks": 5e8, "cohesion": 1e7, "friction": 0.7, "tension": 1e6}
    model = Model(
        mesh, {"rock": loose}, joints=[Joint("J", "coulomb", strong)],
        boundaries=[Fixed("bottom"), *map(Roller, SIDES[:4])], insitu=InSitu(9.81, 0.15),
    )  # fmt: skip

    prepared = prepare(model, 0.05)
    result = simulate(model, 0.05, prepared=prepared)

    _, _, plastic = yield_states(prepared.constants, prepared.state)
    pressure = -prepared.constants["contact_initial"][:, 2]
    assert plastic[:, 0].max() > 0.0
    mean = np.average(pressure, weights=model.mesh.contacts.area)
    assert mean == pytest.approx(ROCK.density * 9.81 * 20.0, rel=1e-3)
    assert np.abs(result.state["velocity"]).max() < 1e-4


def test_uniform_stress_is_what_held_ground_starts_from():
    stress = (-3e6, -2e6, -1e6, 0.0, 0.2e6, 0.0)
    every = [Fixed(side) for side in (*SIDES, "top")]
    model = Model(
        structured_box((3, 3, 3), (9.0, 9.0, 9.0)), {"rock": WEAK}, boundaries=every,
        insitu=InSitu(gravity=0.0, stress=stress),
    )  # fmt: skip

    prepared = prepare(model, 0.01)

    _, found, _ = yield_states(prepared.constants, prepared.state)
    assert found == pytest.approx(np.tile(stress, (len(found), 1)), rel=1e-9, abs=1.0)


def test_a_pillar_crushed_slowly_bears_its_uniaxial_strength():
    hard = replace(WEAK, law=MohrCoulomb(), tension=np.inf)
    duration = 0.4
    times = np.linspace(0.0, duration, 101)
    speed = 0.08 / duration * np.minimum(1.0, times / (0.1 * duration))
    down = Seismogram(np.outer(-speed, [0.0, 0.0, 1.0]), times[1])
    model = pillar(rock=hard, boundaries=[VelocityInput("top", down)], local_damping=0.8)

    energy = simulate(model, duration).energy

    work, moved = energy["input"], np.interp(energy["time"], times, np.cumsum(speed) * times[1])
    late = moved > 0.06
    pressure = np.polyfit(moved[late], work[late], 1)[0] / 100.0
    assert pressure == pytest.approx(triaxial_strength(0.0, 1e6, 0.5), rel=0.1)


def test_local_damping_outside_its_range_is_refused():
    with pytest.raises(InputError, match="local_damping: must lie in 0 to 1, got 1"):
        pillar(local_damping=1.0)


def test_in_situ_stress_of_five_numbers_is_refused():
    with pytest.raises(InputError, match=r"insitu\.stress: must be six finite numbers"):
        InSitu(stress=(1.0,) * 5)
