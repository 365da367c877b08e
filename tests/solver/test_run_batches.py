"""Models that march side by side: each as if it were alone."""

from dataclasses import replace

import numpy as np
import pytest

from pyblast import core
from pyblast.errors import InputError, SolverError
from pyblast.mesh.builder import Layer, structured_box
from pyblast.model.anisotropy import jointed
from pyblast.model.boundary import StressInput, VelocityInput, Viscous
from pyblast.model.joint import Joint
from pyblast.model.material import ConstantQ, Damping, Material, MohrCoulomb
from pyblast.model.model import InSitu, Model, Receiver, SpongeLayer
from pyblast.model.source import Hole, TimeFunction
from pyblast.signals.seismogram import Seismogram
from pyblast.solver import assembly
from pyblast.solver.preparation import prepare
from pyblast.solver.run import run_many, simulate, stacked
from verification.columns import ROCK, ricker

SIDES = ("west", "east", "south", "north", "bottom")
TIMES = np.arange(0.0, 0.1, 5e-4)
SOIL = Material.from_speeds(1900.0, 1800.0, 900.0)
COULOMB = {"kn": 4e9, "ks": 2e9, "cohesion": 0.0, "friction": 0.3, "tension": 0.0}


def shaking(size=1.0, dominant=40.0):
    motion = ricker(TIMES, dominant)[:, None] * [0.8 * size, 0.5 * size, -0.3 * size]
    return Seismogram(motion, TIMES[1])


def site(length=30.0, **parts):
    mesh = structured_box((6, 4, 4), (length, 20.0, 20.0), planes={"J": ("x", 0.5 * length)},
                          layers=[Layer("soil", 5.0), Layer("rock")]).split(["J"])  # fmt: skip
    known = {
        "materials": {"rock": ROCK, "soil": SOIL},
        "joints": [Joint("J", "coulomb", COULOMB, insitu_pressure=2e4)],
        "boundaries": [*map(Viscous, SIDES), StressInput("west", shaking())],
        "receivers": [Receiver("A", (22.0, 9.0, 20.0)), Receiver("B", (8.0, 6.0, 15.0), 0.6)],
    }
    return Model(mesh, **{**known, **parts})


def variants():
    """Return models over one mesh that differ in whatever may differ, most of them nonlinear."""
    one = site()
    rate = TimeFunction(1e8 * ricker(TIMES, 50.0), TIMES[1])
    hole = Hole(np.array([8.0, 11.0, 6.0]), 20.0, 0.004, rate)
    return [
        one,
        one.with_joint("J", kn=8e9, ks=1e9),
        replace(one, joints=[Joint("J", "elastic", {"kn": 4e9, "ks": 2e9})]),
        replace(one, damping=Damping(0.02, 20.0)),
        replace(one, damping=Damping(0.05, 20.0, corner=90.0)),
        replace(one, sources=[hole]),
        replace(one, boundaries=[*one.boundaries[:-1], StressInput("west", shaking(3.0, 25.0))]),
        replace(one, sponge=None, damping=Damping(0.01, 30.0, stiffness=False)),
        replace(one, insitu=InSitu()),
    ]


def alone(model, dt):
    """March one model by itself with the time step of a batch."""
    own = simulate(model, 1e-3).dt
    return simulate(replace(model, step_factor=model.step_factor * dt / own), 0.1)


def test_models_side_by_side_move_as_they_do_alone():
    models = variants()

    together = run_many(models, 0.1)

    for model, found in zip(models, together, strict=True):
        wanted = alone(model, found.dt)
        for name, record in wanted.seismograms.items():
            other = found.seismograms[name]
            assert other.dt == pytest.approx(record.dt, rel=1e-12)
            assert other.velocity == pytest.approx(record.velocity, abs=1e-9 * record.pvs)
        for name, column in wanted.energy.items():
            scale = 1e-9 * np.abs(wanted.energy["input"]).max()
            assert found.energy[name] == pytest.approx(column, rel=1e-8, abs=scale)


def test_a_lane_knows_nothing_of_its_neighbours():
    models = variants()[:8]
    slow = min(range(8), key=lambda k: run_many(models[k : k + 1], 0.01)[0].dt)

    full = run_many(models, 0.1)
    pair = run_many([models[slow], models[(slow + 1) % 8]], 0.1)

    for name, record in pair[0].seismograms.items():
        assert np.array_equal(record.velocity, full[slow].seismograms[name].velocity)
    for name in core.STATE:
        assert name == "memory" or np.array_equal(pair[0].state[name], full[slow].state[name])


def test_a_given_step_makes_a_model_move_alike_in_every_batch():
    models = variants()[:4]
    step = min((assembly.time_step(model) for model in models), key=lambda one: one[0])

    together, alone_ = run_many(models, 0.05, step=step), run_many(models[1:2], 0.05, step=step)

    assert {found.dt for found in [*together, *alone_]} == {step[0]}
    for name, record in alone_[0].seismograms.items():
        wanted = together[1].seismograms[name].velocity
        assert record.velocity == pytest.approx(wanted, abs=1e-9 * record.pvs)


def test_every_model_of_a_batch_keeps_its_ledger():
    for found in run_many(variants(), 0.1):
        assert found.balance_error < 0.01


@pytest.mark.parametrize(
    "rock",
    [
        replace(ROCK, law=ConstantQ(20.0, 10.0, (5.0, 100.0))),
        jointed(ROCK, (1.0, 0.0, 0.0), 2.0, 2e10, 1e10),
        replace(ROCK, cohesion=2e4, friction=0.5, tension=1e4, law=MohrCoulomb(0.1)),
    ],
)
def test_ground_of_every_law_can_be_in_a_batch(rock):
    one = site(materials={"rock": rock, "soil": SOIL})
    models = [one, one.with_joint("J", ks=1e9)]

    for model, found in zip(models, run_many(models, 0.05), strict=True):
        wanted = alone(model, found.dt)
        for name, record in wanted.seismograms.items():
            there = record.velocity[: len(found.seismograms[name].velocity)]
            assert found.seismograms[name].velocity == pytest.approx(there, abs=1e-7 * record.pvs)


def test_a_batch_may_prescribe_different_motion():
    one = site(boundaries=[*map(Viscous, SIDES[1:]), VelocityInput("west", shaking())])
    other = replace(one, boundaries=[*one.boundaries[:-1], VelocityInput("west", shaking(-2.0))])

    first, second = run_many([replace(m, joints=variants()[2].joints) for m in (one, other)], 0.1)

    for name, record in first.seismograms.items():
        assert second.seismograms[name].velocity == pytest.approx(
            -2.0 * record.velocity, abs=1e-9 * record.pvs
        )


def test_models_of_other_meshes_march_by_themselves_and_order_is_kept():
    models = [site(), site(length=33.0), site()]

    found = run_many(models, 0.02)

    for model, one in zip(models, found, strict=True):
        assert one.prepared.fingerprint == simulate(model, 0.02).prepared.fingerprint


def test_ground_that_differs_is_refused_with_its_name():
    one = site()
    harder = replace(one, materials={"rock": replace(ROCK, bulk=2.0 * ROCK.bulk), "soil": SOIL})

    with pytest.raises(InputError, match=r"run_many: models over one mesh differ in 'zone_lambda'"):
        run_many([one, harder], 0.01)


def test_a_model_that_fails_is_told_by_its_number(monkeypatch):
    def too_long(model):
        dt, limit = step(model)
        return 4.0 * dt, limit

    step = assembly.time_step
    monkeypatch.setattr(assembly, "time_step", too_long)
    moved = site()
    still = replace(moved, boundaries=moved.boundaries[:-1])

    with pytest.raises(SolverError, match=r"model 2 of the batch: .* time step of .* above"):
        run_many([still, moved], 0.2)


def test_a_rim_differs_by_its_mass_damping_only():
    box = ((5.0, 25.0), (5.0, 15.0), (5.0, 20.0))
    models = [site(), replace(site(), sponge=None)]
    models[1] = replace(models[0], sponge=SpongeLayer(box, 5.0))

    still, damped = run_many(models, 0.05)

    assert not np.allclose(still.seismograms["A"].velocity, damped.seismograms["A"].velocity)


def test_lanes_that_are_left_over_move_as_the_first():
    models = variants()[:2]
    step = assembly.time_step(models[1])
    prepared = [prepare(model, 0.05, step=step) for model in models]
    together, state = stacked([p.constants for p in prepared], [p.state for p in prepared])

    core.advance_batch(core.to_fortran_batch(together), state, 0, 50, 10)

    moved = np.moveaxis(state["velocity"], core.BATCH_AXIS["velocity"], 0)
    assert np.any(moved[0])
    for lane in range(2, core.BATCH_SIZE):
        assert np.array_equal(moved[lane], moved[0])
