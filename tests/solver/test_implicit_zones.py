"""Implicit zones: exact frequencies, energy, bits, and what they leave of an explicit run."""

from dataclasses import replace

import numpy as np
import pytest
import scipy

from pyblast import core
from pyblast.mesh.builder import Layer, structured_box
from pyblast.model.boundary import Fixed, Roller, StressInput, VelocityInput, Viscous
from pyblast.model.joint import Joint
from pyblast.model.material import ConstantQ, Damping, Material, MohrCoulomb
from pyblast.model.model import InSitu, Model, Receiver
from pyblast.signals.seismogram import Seismogram
from pyblast.solver import assembly
from pyblast.solver.implicit_zones import clusters_of, contact_pairs, zone_stiffness
from pyblast.solver.preparation import prepare
from pyblast.solver.run import run_many, simulate
from verification.columns import ROCK, ricker
from verification.step_limits import explicit

SOFT = Material.from_speeds(1800.0, 1500.0, 500.0)
STIFF = replace(ROCK, bulk=900.0 * ROCK.bulk, shear=900.0 * ROCK.shear)
TIMES = np.arange(0.0, 0.02, 2e-5)
SHAKING = Seismogram(ricker(TIMES, 150.0)[:, None] * [0.6, 0.4, -0.3], TIMES[1])
SHEAR = Seismogram(ricker(TIMES, 150.0)[:, None] * [0.05, 0.4, -0.3], TIMES[1])
JOINT = {"kn": 2e11, "ks": 1e11, "cohesion": 0.0, "friction": 0.3, "tension": 0.0}
WEAK = Material(
    1800.0, SOFT.bulk, SOFT.shear, cohesion=2e4, friction=0.4, tension=1e4, law=MohrCoulomb(0.1)
)


def slivered(n=6, at=(3, 3, 3), toward=0, split=False, mesh=None, **parts):
    """Return n x n x n cells of soil over rock, a node of which nearly lies in a face."""
    mesh = mesh or structured_box(
        (n, n, n), (n, n, n), layers=[Layer("soil", 3.0), Layer("rock")],
        planes={"J": ("x", float(n // 2))} if split else None,
    )  # fmt: skip
    points = mesh.points.copy()
    points[np.argmax((points == at).all(axis=1)), toward] += 0.97
    mesh = replace(mesh, points=points)
    known = {
        "materials": {"rock": ROCK, "soil": SOFT},
        "receivers": [Receiver("A", (4.5, 2.5, 3.5)), Receiver("B", (1.5, 4.5, 5.0))],
    }
    if split:
        mesh = mesh.split(["J"])
        known["joints"] = [Joint("J", "coulomb", JOINT, insitu_pressure=1e6)]
    return Model(mesh, **{**known, **parts})


def open_sides(shaking=SHAKING, **parts):
    """Return the parts of a model that is shaken from the west, the other sides viscous."""
    sides = ("west", "east", "south", "north", "bottom")
    return {"boundaries": [*map(Viscous, sides), StressInput("west", shaking)], **parts}


def difference(model, duration):
    """Return the L2 difference of an implicit run to the explicit one, by component of energy."""
    one = simulate(model, duration)
    other = simulate(model, duration, prepared=explicit(model, duration))
    assert one.prepared.limit.implicit.zones.any()
    assert one.dt > 5.0 * other.dt
    apart = whole = 0.0
    for name, record in other.seismograms.items():
        mine = one.seismograms[name]
        at = np.transpose([np.interp(mine.times, record.times, v) for v in record.velocity.T])
        apart += np.sum((mine.velocity - at) ** 2)
        whole += np.sum(at**2)
    return float(np.sqrt(apart / whole)), one, other


def bar():
    """Return a bar on rollers with one cell 30 times as fast as the others."""
    mesh = structured_box((12, 1, 1), (12.0, 1.0, 1.0))
    stiff = (mesh.points[mesh.zones].mean(axis=1)[:, 0] // 1.0).astype(int) == 5
    order = np.argsort(stiff, kind="stable")
    mesh = replace(mesh, zones=mesh.zones[order], zone_group=stiff[order].astype(np.int32),
                   groups=("rock", "stiff"))  # fmt: skip
    held = [Roller(side) for side in ("south", "north", "bottom", "top")]
    return Model(mesh, {"rock": ROCK, "stiff": STIFF}, boundaries=held, step_factor=1.0)


def test_a_stiff_zone_in_a_bar_swings_at_its_exact_frequency():
    model = bar()
    dt, limit = assembly.time_step(model)
    prepared = prepare(model, 400 * dt)
    constants, inside = prepared.constants, limit.implicit.zones
    n = 3 * len(model.nodes.points)
    product = assembly.zone_product(model, np.ones(n // 3))
    whole = np.array([product(one.reshape(-1, 3)).ravel() for one in np.eye(n)])
    inertia, zones = np.diag(np.repeat(constants["node_mass"], 3)), np.flatnonzero(inside)
    parts = zone_stiffness(model, zones, assembly.zone_product)
    for part, nodes in zip(parts, model.nodes.zone_nodes[zones], strict=True):
        of = (3 * nodes[:, None] + np.arange(3)).ravel()
        inertia[np.ix_(of, of)] += 0.25 * dt**2 * part.reshape(12, 12)
    free = np.setdiff1d(np.arange(n), 3 * constants["fixed_node"] + axis_of(constants))
    squared, shapes = scipy.linalg.eigh(whole[np.ix_(free, free)], inertia[np.ix_(free, free)])

    assert inside.sum() == 6
    assert limit.dt > 20.0 * limit.explicit
    assert squared[-1] <= 4.0 / dt**2 * (1.0 + 1e-9)
    for mode in (3, len(squared) // 2, len(squared) - 1):
        omega = 2.0 / dt * np.arcsin(0.5 * dt * np.sqrt(squared[mode]))
        state = {name: value.copy() for name, value in prepared.state.items()}
        state["velocity"].flat[free] = shapes[:, mode] * np.cos(0.5 * omega * dt)
        views = core.to_fortran(constants)
        core.advance(views, state, 0, 400, 10**6)
        wanted = shapes[:, mode] * np.cos(399.5 * omega * dt)
        assert state["velocity"].flat[free] == pytest.approx(
            wanted, abs=1e-7 * np.abs(shapes[:, mode]).max()
        )


def axis_of(constants):
    """Return the axis along which each held node is held."""
    return np.abs(constants["fixed_direction"]).argmax(axis=1)


def test_slow_waves_keep_the_frequency_of_the_explicit_ground():
    apart, one, other = difference(
        slivered(boundaries=[Roller("bottom"), Roller("west"), StressInput("east", SHAKING)]), 0.03
    )

    assert apart < 0.01
    assert max(one.balance_error, other.balance_error) < 1e-11


@pytest.mark.parametrize("quadratic", [False, True])
def test_the_energy_of_noise_stays_the_same_at_the_full_bound(quadratic):
    mesh = structured_box((4, 3, 3), (4.0, 3.0, 3.0), layers=[Layer("soil", 1.0), Layer("rock")])
    model = slivered(mesh=mesh, at=(2.0, 1.0, 1.0), step_factor=1.0, receivers=(),
                     quadratic=quadratic)  # fmt: skip
    dt, limit = assembly.time_step(model)
    n_steps = 5_000 if quadratic else 100_000
    prepared = prepare(model, n_steps * dt)
    noise = np.random.default_rng(0).normal(size=prepared.state["velocity"].shape)
    noise[prepared.constants["implicit_node"]] = 0.0
    state = {**prepared.state, "velocity": noise}

    found = simulate(model, n_steps * dt, prepared=replace(prepared, state=state))

    total = found.energy["kinetic"] + found.energy["strain"]
    assert limit.dt > 5.0 * limit.explicit
    assert np.ptp(total) < 1e-9 * total[0]


CASES = {
    "open sides": open_sides(),
    "a node of an open side": open_sides(at=(6, 3, 3), toward=1),
    "Q": open_sides(
        materials={"rock": replace(ROCK, law=ConstantQ(50.0, 30.0, (50.0, 500.0))), "soil": SOFT}
    ),
    "lagged damping": open_sides(damping=Damping(0.02, 300.0)),
    "low-passed damping": open_sides(damping=Damping(0.05, 100.0, corner=600.0)),
    "a slipping joint": open_sides(SHEAR, split=True, at=(3, 3, 3), toward=1),
    "yielding zones": open_sides(at=(3, 3, 5), materials={"rock": ROCK, "soil": WEAK}),
    "rollers": {
        "at": (3, 3, 0),
        "boundaries": [Roller("bottom"), Fixed("east"), StressInput("west", SHAKING)],
    },
    "a moved side": {"boundaries": [VelocityInput("west", SHAKING), Viscous("east")]},
    "quadratic zones": open_sides(quadratic=True, n=4, at=(2, 1, 1), receivers=[
        Receiver("A", (3.2, 2.5, 3.5)), Receiver("B", (1.5, 1.5, 4.0))]),
}  # fmt: skip


def test_the_difference_to_the_explicit_run_falls_with_the_square_of_the_step():
    whole, half = (slivered(**open_sides(step_factor=factor)) for factor in (0.8, 0.4))

    ratio = difference(whole, 0.018)[0] / difference(half, 0.018)[0]

    assert 3.5 < ratio < 5.0


@pytest.mark.parametrize("case", CASES)
def test_an_implicit_run_is_near_the_explicit_one(case):
    apart, one, other = difference(slivered(**CASES[case]), 0.018)

    assert apart < 0.01
    if "joint" in case:
        assert one.state["contact_state"][:, 3].max() > 0.0
        lost = [run.energy["joint_dissipated"][-1] for run in (one, other)]
        assert lost[0] == pytest.approx(lost[1], rel=0.02)
    if "yielding" in case:
        rows = one.prepared.constants["zone_row"][one.prepared.limit.implicit.zones]
        assert np.abs(one.state["row_state"][rows, 6:12]).max() > 0.0
        work = [run.energy["zone_dissipated"][-1] for run in (one, other)]
        assert work[0] == pytest.approx(work[1], rel=0.03)


def symmetric(values):
    """Return symmetric matrices (n, 3, 3) of components (n, 6): xx yy zz yz zx xy."""
    return values[:, [0, 5, 4, 5, 1, 3, 4, 3, 2]].reshape(-1, 3, 3)


def factored(constants):
    """Return the matrix ``L B L^T`` of implicit nodes from its factors in kernel arrays."""
    n, start = len(constants["implicit_node"]), constants["column_start"]
    lower = np.eye(3 * n).reshape(n, 3, n, 3)
    for column in range(n):
        for k in range(start[column], start[column + 1]):
            block = constants["block_factor"][k].reshape(3, 3).T
            lower[constants["block_row"][k], :, column] = block
    lower = lower.reshape(3 * n, 3 * n)
    inverse = symmetric(constants["implicit_inverse"])
    return lower @ scipy.linalg.block_diag(*np.linalg.inv(inverse)) @ lower.T


@pytest.mark.parametrize("case", ["lagged damping", "a node of an open side", "rollers"])
def test_the_factors_are_those_of_inertia_drag_and_stiffness(case):
    """Theory.md (2.53): D + (dt^2/4 + beta dt/2) K, without directions that are held."""
    model = slivered(**CASES[case] | {"damping": Damping(0.05, 200.0)})
    prepared = prepare(model, 0.002)
    constants, dt = prepared.constants, prepared.constants["dt"]
    zones, nodes = np.flatnonzero(prepared.limit.implicit.zones), constants["implicit_node"]
    where = {node: number for number, node in enumerate(nodes)}
    wanted = np.zeros((len(nodes), 3, len(nodes), 3))
    for node, at in where.items():
        own = constants["node_mass"][node] * (1.0 + 0.5 * dt * constants["node_alpha"][node])
        wanted[at, :, at] = own * np.eye(3)
    for node, own in zip(constants["dashpot_node"], constants["dashpot_impedance"], strict=True):
        if node in where:
            wanted[where[node], :, where[node]] += 0.5 * dt * own
    share = 0.25 * dt**2 + 0.5 * dt * model.zone_damping("beta")[zones]
    parts = zone_stiffness(model, zones, assembly.zone_product) * share[:, None, None, None, None]
    for part, of in zip(parts, model.nodes.zone_nodes[zones], strict=True):
        at = [where[node] for node in of]
        for i, row in enumerate(at):
            for k, column in enumerate(at):
                wanted[row, :, column] += part[i, :, k]
    free = np.tile(np.eye(3), (len(nodes), 1, 1))
    for node, axis in zip(constants["fixed_node"], constants["fixed_direction"], strict=True):
        if node in where:
            free[where[node]] -= np.outer(axis, axis)
    held = scipy.linalg.block_diag(*free)
    wanted = held @ wanted.reshape(held.shape) @ held
    mass = np.repeat(constants["node_mass"][nodes], 3)
    wanted += mass[:, None] * (np.eye(len(held)) - held)

    assert len(zones)
    assert factored(constants) == pytest.approx(wanted, abs=1e-9 * np.abs(wanted).max())
    has = {
        "rollers": np.isin(constants["fixed_node"], nodes).any(),
        "a node of an open side": np.isin(constants["dashpot_node"], nodes).any(),
        "lagged damping": model.zone_damping("beta")[zones].all(),
    }
    assert has[case]


def test_implicit_contacts_of_a_slipping_joint_change_little():
    model = slivered(**CASES["a slipping joint"])
    dt, limit = assembly.time_step(model)
    pairs = contact_pairs(model.nodes.contacts)
    beside = np.isin(pairs, model.nodes.zone_nodes[limit.implicit.zones]).any(axis=1)
    both = replace(limit, implicit=replace(limit.implicit, contacts=beside))

    one = simulate(model, 0.018, prepared=prepare(model, 0.018, step=(dt, both)))

    plain = simulate(model, 0.018)
    assert 0 < beside.sum() < len(pairs)
    assert one.state["contact_state"][beside, 3].max() > 0.0
    assert np.all(np.diff(one.energy["joint_dissipated"]) > -1e-9 * one.energy["input"].max())
    for name, record in plain.seismograms.items():
        other = one.seismograms[name].velocity
        assert 0.0 < np.abs(other - record.velocity).max() < 0.05 * record.pvs


def test_a_moved_side_keeps_its_zones_explicit():
    model = slivered(at=(1, 3, 3), toward=1, boundaries=[VelocityInput("west", SHAKING)])

    assert not assembly.time_step(model)[1].implicit.zones.any()


def test_ground_with_even_zones_stays_explicit():
    for mesh in (structured_box((6, 6, 6), (6.0, 6.0, 6.0)), structured_box((2, 2, 2), (1, 1, 1))):
        limit = assembly.time_step(Model(mesh, {"rock": ROCK}))[1]

        assert not limit.implicit.zones.any()
        assert limit.dt == limit.explicit


def test_the_bits_depend_neither_on_threads_nor_on_an_interruption(tmp_path, monkeypatch):
    monkeypatch.setattr(core._core.pyblast_kinds, "least_shared", 1)
    monkeypatch.setattr("pyblast.solver.preparation.CHUNK_SECONDS", 0.001)
    model, path = slivered(**CASES["a slipping joint"]), tmp_path / "checkpoint.h5"
    one = simulate(model, 0.01)

    def stop(stage, done, total):
        if stage == "dynamic" and 0.3 * total < done < total:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        simulate(model, 0.01, progress=stop, checkpoint=path)
    resumed = simulate(model, 0.01, resume=path)

    for name in core.STATE:
        assert np.array_equal(one.state[name], resumed.state[name]), name
    for name in one.energy:
        assert np.array_equal(one.energy[name], resumed.energy[name]), name


def test_members_of_a_batch_with_other_damping_and_joints_move_as_alone():
    one = slivered(**CASES["a slipping joint"])
    models = [
        one,
        replace(one, damping=Damping(0.05, 100.0, corner=600.0)),
        replace(one, damping=Damping(0.02, 300.0, stiffness=False)),
        one.with_joint("J", kn=1e11),
    ]
    steps = [assembly.time_step(model) for model in models]
    shortest = min(dt for dt, _ in steps)

    together = run_many(models, 0.01)

    union = together[0].prepared.limit.implicit
    for model, (_, limit), found in zip(models, steps, together, strict=True):
        step = (shortest, replace(limit, implicit=union))
        wanted = simulate(model, 0.01, prepared=prepare(model, 0.01, step=step))
        for name, record in wanted.seismograms.items():
            other = found.seismograms[name].velocity
            assert other == pytest.approx(record.velocity, abs=1e-9 * record.pvs)


def test_zones_and_contacts_that_share_a_node_make_one_cluster():
    node, local, cluster = clusters_of(
        np.array([[0, 1, 2, 3], [7, 8, 9, 10], [3, 11, 12, 13]]), np.array([[20, 21], [8, 30]])
    )

    assert node.tolist() == [0, 1, 2, 3, 7, 8, 9, 10, 11, 12, 13, 20, 21, 30]
    assert cluster[local[0]].tolist() == [[0] * 4, [1] * 4, [0] * 4]
    assert cluster[local[1]].tolist() == [[2, 2], [1, 1]]


def test_the_static_stage_does_not_depend_on_implicit_zones():
    sides = [Roller("bottom"), *map(Viscous, ("west", "east"))]
    materials = {"rock": ROCK, "soil": WEAK}
    model = slivered(insitu=InSitu(), boundaries=sides, materials=materials)

    settled = prepare(model, 1e-3)

    assert settled.static["unbalanced"] < 1e-6
    assert settled.static["steps"] < 2000


def test_a_joint_that_limits_the_step_stays_explicit_and_slips_freely():
    stiff = {**JOINT, "kn": 1e13, "ks": 1e13, "friction": 0.0}
    mesh = structured_box((6, 6, 6), (6.0, 6.0, 6.0), planes={"J": ("x", 3.0)}).split(["J"])
    model = Model(mesh, {"rock": ROCK}, joints=[Joint("J", "coulomb", stiff)])

    limit = assembly.time_step(model)[1]

    assert "joint 'J'" in limit.limited_by
    assert not limit.implicit.contacts.any()
