"""Whole models that fade: ledger, axes, restart, static stage, longest stable step."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pyblast import core
from pyblast.mesh.builder import Layer, structured_box
from pyblast.mesh.mesh import Mesh
from pyblast.model.anisotropy import jointed
from pyblast.model.boundary import Fixed, StressInput, Viscous
from pyblast.model.joint import Joint
from pyblast.model.material import ConstantQ, Damping
from pyblast.model.model import InSitu, Model, Receiver
from pyblast.signals.seismogram import Seismogram
from pyblast.solver.run import prepare, simulate
from verification.columns import ROCK, ricker, started
from verification.step_limits import largest_root

SIDES = ("west", "east", "south", "north", "bottom")
TIMES = np.arange(0.0, 0.1, 5e-4)
Q = replace(ROCK, law=ConstantQ(20.0, 10.0, (5.0, 100.0)))
KINDS = {
    "constant Q": {"material": Q},
    "low-passed damping": {"damping": Damping(0.05, 20.0, corner=100.0)},
    "low-passed damping alone": {"damping": Damping(0.05, 20.0, mass=False, corner=100.0)},
    "both": {"material": Q, "damping": Damping(0.05, 20.0, corner=100.0)},
    "low-passed damping of jointed rock": {
        "material": jointed(ROCK, (1.0, 0.0, 0.0), 2.0, 2e10, 1e10),
        "damping": Damping(0.05, 20.0, corner=100.0),
    },
}
EACH = pytest.mark.parametrize("kind", KINDS)


def crooked(seed=2):
    mesh = structured_box((6, 4, 4), (30.0, 20.0, 20.0))
    inside = ((mesh.points > 0.0) & (mesh.points < mesh.points.max(axis=0))).all(axis=1)
    moves = np.random.default_rng(seed).uniform(-0.7, 0.7, size=mesh.points.shape)
    return Mesh(
        mesh.points + inside[:, None] * moves, mesh.zones, mesh.zone_group, mesh.groups,
        mesh.surfaces,
    )  # fmt: skip


def body(mesh, material=ROCK, **parts):
    return Model(mesh, {"rock": material}, **parts)


def shaken(kind, turn=None, **how):
    turn = turn or Rotation.identity()
    mesh = crooked()
    mesh = Mesh(turn.apply(mesh.points), mesh.zones, mesh.zone_group, mesh.groups, mesh.surfaces)
    motion = ricker(TIMES, 40.0)[:, None] * [0.8, 0.5, -0.3]
    shaking = Seismogram(turn.apply(motion), TIMES[1])
    place = Receiver("A", tuple(turn.apply([17.0, 9.0, 12.0])))
    model = body(
        mesh,
        boundaries=[*map(Viscous, SIDES), StressInput("west", shaking)],
        receivers=[place],
        **KINDS[kind],
    )
    return simulate(model, 0.1, **how)


@EACH
def test_the_ledger_closes_to_rounding(kind):
    result = shaken(kind)

    assert result.energy["damping"][-1] > 0.01 * result.energy["input"][-1]
    assert result.balance_error < 1e-10


@EACH
def test_energy_left_alone_only_falls(kind):
    model = body(crooked(), **KINDS[kind], step_factor=1.0)
    velocity = np.random.default_rng(3).normal(size=model.mesh.points.shape)
    dt = prepare(model, 1.0).constants["dt"]

    energy = started(model, 3000 * dt, 0.0 * velocity, velocity).energy

    held = energy["kinetic"] + energy["strain"]
    assert (np.diff(held) <= 1e-12 * held[0]).all()
    assert (np.diff(energy["damping"]) >= -1e-13 * held[0]).all()
    assert held[-1] < 0.7 * held[0]


@pytest.mark.parametrize("kind", list(KINDS)[:-1])  # the last one has axes of its own
def test_a_turned_model_gives_turned_seismograms(kind):
    turn = Rotation.random(rng=np.random.default_rng(1))

    straight, other = (shaken(kind, t).seismograms["A"] for t in (Rotation.identity(), turn))

    wanted = turn.apply(straight.velocity.copy())
    assert other.velocity == pytest.approx(wanted, abs=1e-9 * straight.pvs)


@EACH
def test_an_interrupted_run_goes_on_with_the_same_bits(kind, tmp_path, monkeypatch):
    monkeypatch.setattr("pyblast.solver.preparation.CHUNK_SECONDS", 0.0)
    path = tmp_path / "checkpoint.h5"

    def stop(stage, done, total):
        if stage == "dynamic" and 0.3 * total < done < total:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        shaken(kind, progress=stop, checkpoint=path)

    whole, resumed = shaken(kind), shaken(kind, resume=path)
    for name in core.STATE:
        assert np.array_equal(whole.state[name], resumed.state[name]), name


@cache
def longest():
    """Bisect for the longest stable step of a small elastic model."""
    short, long = 0.0, 4.0 * prepare(small(), 1e-3).limit.dt
    for _ in range(14):
        dt = 0.5 * (short + long)
        short, long = (dt, long) if largest_root(small(), dt) < 1.0 + 1e-6 else (short, dt)
    return short


def small(material=ROCK, **parts):
    mesh = structured_box((1, 1, 1), (2.0, 1.0, 1.0))
    return body(mesh, material, boundaries=[Fixed("west")], **parts)


@pytest.mark.parametrize(
    "parts",
    [{"material": replace(ROCK, law=ConstantQ(10.0, 10.0))}, *list(KINDS.values())[1:3]],
)
def test_the_longest_stable_step_is_that_of_the_unrelaxed_springs(parts):
    fading = small(**parts)
    before, after = (model.stiffest_moduli()[1][0] for model in (small(), fading))

    limit = longest() * np.sqrt(before / after)

    assert largest_root(fading, 0.999 * limit) < 1.0 + 1e-6
    assert largest_root(fading, 1.001 * limit) > 1.0 + 1e-6


@pytest.mark.parametrize("law", ["elastic", "fading"])
def test_the_static_stage_knows_no_time(law):
    mesh = structured_box((2, 2, 4), (20.0, 20.0, 40.0), planes={"J": ("z", 20.0)},
                          layers=[Layer("soil", 10.0), Layer("rock")])  # fmt: skip
    soft = replace(ROCK, bulk=0.1 * ROCK.bulk, shear=0.1 * ROCK.shear)
    materials = {"rock": ROCK, "soil": soft}
    if law == "fading":
        materials = {n: replace(m, law=Q.law) for n, m in materials.items()}
    joint = {"kn": 1e9, "ks": 5e8, "cohesion": 1e7, "friction": 0.7, "tension": 1e6}
    model = Model(mesh.split(["J"]), materials, joints=[Joint("J", "coulomb", joint)],
                  boundaries=[*map(Viscous, SIDES)], insitu=InSitu())  # fmt: skip

    prepared = prepare(model, 0.01)

    traction, contacts = prepared.constants["contact_initial"], model.mesh.contacts
    weight = 20.0**2 * 9.81 * 20.0 * ROCK.density
    assert traction[:, 2] @ contacts.area == pytest.approx(-weight, rel=1e-3)
    assert not prepared.state["memory"].any()
    assert not simulate(model, 0.01, prepared=prepared).energy["kinetic"].any()
