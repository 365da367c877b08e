"""Whole models of quadratic zones: waves, joints, faces, energy, restart, static stage."""

from dataclasses import replace

import numpy as np
import pytest
from layered_box import COULOMB, SIDES, SOIL, TIMES, shaking, site
from scipy.spatial.transform import Rotation

from pyblast import core
from pyblast.errors import InputError, SolverError
from pyblast.mesh.builder import structured_box
from pyblast.model.anisotropy import jointed
from pyblast.model.boundary import Fixed, Roller, StressInput, VelocityInput, Viscous
from pyblast.model.joint import Joint
from pyblast.model.material import ConstantQ, Damping
from pyblast.model.model import InSitu, Model, Receiver
from pyblast.model.source import Hole, PointForce, TimeFunction
from pyblast.solver import assembly
from pyblast.solver.preparation import prepare
from pyblast.solver.run import run_many, simulate
from verification.columns import AXIS, ROCK, SPEED, column, column_model, pulse, ricker, started


def travelled(wave, edges, quadratic):
    """Return the error of a pulse after five wavelengths of a column, edges to a wavelength."""
    edge = SPEED[wave] / 20.0 / edges
    ends = [Viscous("west"), Viscous("east"), StressInput("west", pulse(20.0, wave))]
    place = round(5 * edges) * edge
    model = column_model(column(round(6 * edges), edge), wave, ends, receivers_at=[place])
    (record,) = simulate(replace(model, quadratic=quadratic), 0.45).seismograms.values()
    sent = pulse(20.0, wave)
    wanted = np.interp(record.times - place / SPEED[wave], sent.times, sent.velocity[:, AXIS[wave]])
    found = record.velocity[:, AXIS[wave]]
    return np.linalg.norm(found - wanted) / np.linalg.norm(wanted)


@pytest.mark.parametrize("wave", ["P", "S"])
def test_three_edges_to_a_wavelength_carry_what_ten_of_constant_strain_do(wave):
    assert travelled(wave, 3.0, True) < travelled(wave, 10.0, False)


@pytest.mark.parametrize("parts", [{}, {"damping": Damping(0.03, 30.0)},
                                   {"damping": Damping(0.03, 30.0, corner=120.0)}])  # fmt: skip
def test_the_ledger_closes(parts):
    linear = Joint("J", "elastic", {"kn": 4e9, "ks": 2e9})
    rate = TimeFunction(1e8 * ricker(TIMES, 50.0), TIMES[1])
    hole = Hole(np.array([8.0, 11.0, 6.0]), 20.0, 0.004, rate)
    push = PointForce(np.array([11.0, 7.0, 13.0]), np.array([1.0, 2.0, 0.5]), rate)

    result = simulate(site(joints=[linear], sources=[hole, push], **parts), 0.1)

    assert result.energy["input"][-1] > 0.0
    assert result.balance_error < 1e-10


def test_slip_takes_energy_and_none_is_lost():
    boundaries = [*map(Viscous, SIDES), StressInput("west", shaking(None, 5.0))]

    result = simulate(site(boundaries=boundaries), 0.1)

    assert result.energy["joint_dissipated"][-1] > 0.001 * result.energy["input"][-1]
    assert result.balance_error < 0.01


def test_a_turned_model_gives_turned_seismograms():
    turn = Rotation.random(rng=np.random.default_rng(1))

    straight, other = (simulate(site(t), 0.08).seismograms["A"] for t in (None, turn))

    wanted = turn.apply(straight.velocity.copy())
    assert other.velocity == pytest.approx(wanted, abs=1e-9 * straight.pvs)


def test_an_interrupted_run_goes_on_with_the_same_bits(tmp_path, monkeypatch):
    monkeypatch.setattr("pyblast.solver.preparation.CHUNK_SECONDS", 0.0)
    path = tmp_path / "checkpoint.h5"

    def stop(stage, done, total):
        if stage == "dynamic" and 0.3 * total < done < total:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        simulate(site(), 0.05, progress=stop, checkpoint=path)

    whole, resumed = simulate(site(), 0.05), simulate(site(), 0.05, resume=path)
    for name in core.STATE:
        assert np.array_equal(whole.state[name], resumed.state[name]), name


def test_a_linear_joint_passes_what_theory_says():
    kn, omega = 0.3 * ROCK.density * SPEED["P"] * 2.0 * np.pi * 20.0, 2.0 * np.pi * 20.0
    edge = SPEED["P"] / 20.0 / 4.0
    mesh = column(24, edge)
    at = float(np.sort(np.unique(mesh.points[:, 0]))[12])
    mesh = structured_box((24, 1, 1), (24 * edge, edge, edge), planes={"J": ("x", at)}).split(["J"])
    ends = [Viscous("west"), Viscous("east"), StressInput("west", pulse(20.0, "P"))]
    sides = [Roller(side) for side in ("south", "north", "bottom", "top")]
    joint = Joint("J", "elastic", {"kn": kn, "ks": kn})
    receiver = [Receiver("A", (18 * edge, 0.4 * edge, 0.6 * edge))]

    def spectrum(model):
        record = simulate(model, 0.45).seismograms["A"]
        return record.velocity[:, 0] @ np.exp(-1j * omega * record.times) * record.dt

    with_it = spectrum(Model(mesh, {"rock": ROCK}, joints=[joint], boundaries=[*ends, *sides],
                             receivers=receiver, quadratic=True))  # fmt: skip
    bonded = spectrum(Model(mesh, {"rock": ROCK}, boundaries=[*ends, *sides], receivers=receiver,
                            joints=[Joint("J", "elastic", {"kn": 1e4 * kn, "ks": 1e4 * kn})],
                            quadratic=True))  # fmt: skip

    z = ROCK.density * SPEED["P"]
    theory = 1.0 / abs(1.0 - 1j * omega * z / (2.0 * kn))
    assert abs(with_it / bonded) == pytest.approx(theory, rel=0.01)


def test_ground_at_rest_under_its_weight_stays_at_rest():
    model = site(insitu=InSitu(), boundaries=[*map(Viscous, SIDES)],
                 joints=[Joint("J", "coulomb", {**COULOMB, "friction": 0.7})])  # fmt: skip

    prepared = prepare(model, 0.02)
    still = simulate(model, 0.02, prepared=prepared)

    assert prepared.static["unbalanced"] <= 1e-5
    assert not still.energy["kinetic"].any()


@pytest.mark.parametrize("pattern", ["kuhn", "centred"])
def test_the_weight_above_presses_a_level_joint_evenly(pattern):
    mesh = structured_box((2, 2, 4), (20.0, 20.0, 40.0), planes={"J": ("z", 20.0)},
                          pattern=pattern)  # fmt: skip
    model = Model(
        mesh.split(["J"]), {"rock": ROCK}, joints=[Joint("J", "coulomb", COULOMB)],
        insitu=InSitu(horizontal_ratio=0.5), quadratic=True, boundaries=[*map(Viscous, SIDES)],
    )  # fmt: skip

    traction = prepare(model, 0.01).state["contact_traction"]

    pressure = ROCK.density * 9.81 * 20.0
    assert np.abs(traction[:, 2]) == pytest.approx(pressure, rel=1e-6)
    assert np.abs(traction[:, :2]).max() < 1e-6 * pressure


def test_a_free_body_keeps_its_energy_at_the_longest_step():
    model = Model(structured_box((3, 2, 2), (30.0, 20.0, 20.0)), {"rock": ROCK}, quadratic=True,
                  step_factor=1.0)  # fmt: skip
    velocity = np.random.default_rng(3).normal(size=model.nodes.points.shape)
    dt = prepare(model, 1.0).constants["dt"]

    energy = started(model, 2000 * dt, 0.0 * velocity, velocity).energy

    held = energy["kinetic"] + energy["strain"]
    assert held == pytest.approx(held[0], rel=1e-9)


@pytest.mark.parametrize("stiffness", [1e9, 5e10])
def test_the_step_is_that_of_the_largest_frequency_of_zones_and_joints(stiffness):
    mesh = structured_box((2, 1, 1), (20.0, 10.0, 10.0), planes={"J": ("x", 10.0)}).split(["J"])
    joint = Joint("J", "elastic", {"kn": stiffness, "ks": 0.4 * stiffness})
    model = Model(mesh, {"rock": ROCK}, joints=[joint], quadratic=True)
    prepared = prepare(model, 1e-3)
    views, dt = core.to_fortran(prepared.constants), prepared.constants["dt"]

    columns = []
    for row in np.eye(prepared.state["displacement"].size):
        state = {name: value.copy() for name, value in prepared.state.items()}
        state["displacement"].flat[:] = row
        core.advance(views, state, 0, 1, 1)
        columns.append(-state["velocity"].ravel() / dt)

    exact = 2.0 / np.sqrt(np.abs(np.linalg.eigvals(np.array(columns))).max())
    assert 0.98 * exact < prepared.limit.dt <= exact


DAMPED = {
    "equal": {"damping": Damping(0.1, 30.0)},
    "soil alone": {"damping": {"rock": Damping(0.0, 30.0), "soil": Damping(0.2, 30.0)}},
    "fill": {"joints": [Joint("J", "kelvin", {"kn": 4e9, "ks": 2e9, "eta_n": 4e6, "eta_s": 2e6})]},
}


@pytest.mark.parametrize("kind", DAMPED)
def test_damped_models_are_stable_at_their_step(kind):
    elastic = [Joint("J", "elastic", {"kn": 4e9, "ks": 2e9})]
    model = site(boundaries=[], step_factor=1.0, **{"joints": elastic, **DAMPED[kind]})
    velocity = np.random.default_rng(0).normal(size=model.nodes.points.shape)

    energy = started(model, 0.1, 0.0 * velocity, velocity).energy

    assert energy["kinetic"][-1] < 0.5 * energy["kinetic"][0]


def test_damping_of_soft_ground_does_not_shorten_the_step_as_if_all_ground_had_it():
    part, whole = (
        prepare(site(**DAMPED["soil alone"] | {"damping": damping}), 0.01).limit
        for damping in (DAMPED["soil alone"]["damping"], Damping(0.2, 30.0))
    )

    assert part.dt > 1.3 * whole.dt
    assert part.dt <= part.undamped == pytest.approx(whole.undamped)


def test_a_step_that_is_too_long_is_blamed_at_a_node_of_any_kind():
    model = site(joints=[Joint("J", "elastic", {"kn": 4e9, "ks": 2e9})])
    prepared = prepare(model, 0.05)
    constants = {**prepared.constants, "dt": 1.6 * prepared.limit.dt}

    with pytest.raises(SolverError, match=r"largest velocity at .* in '(rock|soil)'; likely cause"):
        simulate(model, 0.05, prepared=replace(prepared, constants=constants))


def test_prescribed_motion_and_fixed_faces_hold_every_node():
    model = site(boundaries=[VelocityInput("west", shaking()), Fixed("bottom")])

    result = simulate(model, 0.1)

    low = model.nodes.points[:, 2] < 1e-9
    off = np.setdiff1d(np.flatnonzero(low), np.unique(model.nodes.surfaces["west"]))
    assert len(off) > len(model.mesh.points) // 10
    assert not result.state["displacement"][off].any()


def test_fading_ground_and_batches_take_them():
    fading = replace(ROCK, law=ConstantQ(20.0, 10.0, (5.0, 100.0)))
    one = site(materials={"rock": fading, "soil": SOIL})
    models = [one, one.with_joint("J", ks=1e9)]

    for model, found in zip(models, run_many(models, 0.06), strict=True):
        own = simulate(model, 1e-3).dt
        alone = simulate(replace(model, step_factor=model.step_factor * found.dt / own), 0.06)
        record = alone.seismograms["A"]
        assert found.seismograms["A"].velocity == pytest.approx(
            record.velocity, abs=1e-9 * record.pvs
        )


def test_neither_threads_nor_their_number_change_a_bit(monkeypatch):
    monkeypatch.setattr(assembly, "QUADRATIC_ZONES", 7)
    alone = simulate(site(), 0.05).seismograms["A"].velocity

    monkeypatch.setattr(core._core.pyblast_kinds, "least_shared", 1)

    assert np.array_equal(simulate(site(), 0.05).seismograms["A"].velocity, alone)


def test_the_size_of_domains_changes_rounding_alone(monkeypatch):
    whole = simulate(site(), 0.05).seismograms["A"]

    monkeypatch.setattr(assembly, "QUADRATIC_ZONES", 7)

    record = simulate(site(), 0.05).seismograms["A"]
    assert record.velocity == pytest.approx(whole.velocity, abs=1e-9 * whole.pvs)


def test_ground_of_another_law_is_refused():
    rock = jointed(ROCK, (1.0, 0.0, 0.0), 2.0, 2e10, 1e10)

    with pytest.raises(InputError, match=r"model\.quadratic: zones of 'rock' follow the law"):
        site(materials={"rock": rock, "soil": SOIL})
