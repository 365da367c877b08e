"""Whole models of every law of zones and joints: axes, restart, ledger."""

from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pyblast import core
from pyblast.mesh.builder import structured_box
from pyblast.mesh.mesh import Mesh
from pyblast.model.boundary import StressInput, Viscous
from pyblast.model.joint import Joint
from pyblast.model.model import Model, Receiver
from pyblast.signals.seismogram import Seismogram
from pyblast.solver.run import simulate
from verification.columns import ricker
from verification.contact import properties
from verification.zone import MATERIALS, turned_material

SIDES = ("west", "east", "south", "north", "bottom")
TIMES = np.arange(0.0, 0.1, 5e-4)
TURNS = {"straight": Rotation.identity(), "turned": Rotation.random(rng=np.random.default_rng(1))}
LAWS = [*(("zones", law) for law in core.ZONE_LAWS), *(("J", law) for law in core.JOINT_LAWS)]
EACH = pytest.mark.parametrize(("where", "law"), LAWS, ids=["-".join(one) for one in LAWS])
LINEAR_KEEPS = 1e-9  # of the energy put in, that a law gives back by the rounding of a run
KEEPS = 1e-4  # that a law without a memory gives back by the steps of a run, whose motion it bends


def crooked(planes, turn):
    """Return a turned box with nodes moved at random, but not out of its faces and its plane."""
    mesh = structured_box((6, 4, 4), (30.0, 20.0, 20.0), planes=planes)
    moves = np.random.default_rng(2).uniform(-0.7, 0.7, size=mesh.points.shape)
    held = (mesh.points == 0.0) | (mesh.points == mesh.points.max(axis=0)) | (mesh.points == 15.0)
    points = turn.apply(mesh.points + np.where(held, 0.0, moves))
    mesh = Mesh(points, mesh.zones, mesh.zone_group, mesh.groups, mesh.surfaces)
    return mesh.split(list(planes)) if planes else mesh


def model(where, law, turn):
    """Return a box of ground of a law, or of elastic ground with a joint of a law, shaken."""
    jointed = where == "J"
    motion = (0.3 if jointed else 1.0) * ricker(TIMES, 40.0)[:, None] * [0.8, 0.5, -0.3]
    shaking = StressInput("west", Seismogram(turn.apply(motion), TIMES[1]))
    ground = MATERIALS["elastic"] if jointed else turned_material(law, turn.as_matrix())
    return Model(
        crooked({"J": ("x", 15.0)} if jointed else None, turn),
        {"rock": ground},
        joints=[Joint("J", law, properties(law), insitu_pressure=2e4)] if jointed else [],
        boundaries=[*map(Viscous, SIDES), shaking],
        receivers=[Receiver("A", tuple(turn.apply([17.0, 9.0, 12.0])))],
    )


@cache
def shaken(where, law, turn="straight"):
    return simulate(model(where, law, TURNS[turn]), 0.1)


@EACH
def test_a_turned_model_moves_alike(where, law):
    straight, turned = shaken(where, law), shaken(where, law, "turned")

    record = straight.seismograms["A"]
    wanted = TURNS["turned"].apply(record.velocity.copy())
    assert turned.seismograms["A"].velocity == pytest.approx(wanted, abs=1e-9 * record.pvs)


@EACH
def test_an_interrupted_run_goes_on_with_the_same_bits(where, law, tmp_path, monkeypatch):
    monkeypatch.setattr("pyblast.solver.preparation.CHUNK_SECONDS", 0.001)
    path, one = tmp_path / "checkpoint.h5", model(where, law, TURNS["straight"])

    def stop(stage, done, total):
        if stage == "dynamic" and 0.3 * total < done < total:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        simulate(one, 0.1, progress=stop, checkpoint=path)
    resumed = simulate(one, 0.1, resume=path)

    for name, kept in shaken(where, law).state.items():
        assert np.array_equal(kept, resumed.state[name]), name


@EACH
def test_a_law_only_takes_energy_and_none_is_lost(where, law):
    result = shaken(where, law)
    row = core.JOINT_LAWS[law] if where == "J" else core.ZONE_LAWS[law]

    lost = result.energy["joint_dissipated" if where == "J" else "zone_dissipated"]
    taken = lost / result.energy["input"].max()
    assert result.balance_error < 1e-10
    assert taken.min() > -(LINEAR_KEEPS if row.linear or row.state else KEEPS)
    assert (taken[-1] > KEEPS) == bool(row.state)
