"""Stored responses give the blasts that runs give, from either side; the rest is refused."""

from dataclasses import replace

import numpy as np
import pytest

from pyblast.errors import InputError
from pyblast.mesh.builder import structured_box
from pyblast.mesh.mesh import Mesh
from pyblast.model.anisotropy import jointed as medium
from pyblast.model.boundary import StressInput, Viscous
from pyblast.model.joint import Joint
from pyblast.model.material import ConstantQ, Damping, MohrCoulomb
from pyblast.model.model import InSitu, Model, Receiver
from pyblast.model.source import Column, Hole, MomentTensor, PointForce, TimeFunction
from pyblast.runs.greens import greens_functions
from pyblast.runs.parallel import executor_of, run_all, workers
from pyblast.signals.seismogram import Seismogram
from pyblast.solver.run import simulate
from verification.columns import ROCK, ricker

TIMES = np.arange(0.0, 0.06, 5e-4)
RATE = TimeFunction(1e8 * ricker(TIMES, 50.0), 5e-4)
SHORT = TimeFunction(3e8 * np.hanning(60), 2.5e-4)
STIFFNESS = {"kn": 2e9, "ks": 1e9}
STRONG = {**STIFFNESS, "cohesion": 5e6, "friction": 0.6, "tension": 5e6}
WEAK = {**STIFFNESS, "cohesion": 0.0, "friction": 0.2, "tension": 0.0}
SIDES = ("west", "east", "south", "north", "bottom")
DURATION = 0.07
HOLES = (
    Hole(np.array([8.0, 11.0, 6.0]), 20.0, 0.0041, RATE, 0.7),
    Hole(np.array([8.0, 11.0, 6.0]), 35.0, 0.0133, SHORT, 0.8),
    Hole(np.array([6.0, 5.0, 9.0]), 15.0, 0.0, SHORT),
    MomentTensor(np.array([9.0, 8.0, 12.0]), np.diag([1.0, 0.2, 0.2]), 0.01, RATE),
    PointForce(np.array([5.0, 12.0, 16.0]), np.array([0.0, 0.0, -1.0]), RATE),
)


def jointed(law="elastic", properties=STIFFNESS, **parts):
    mesh = structured_box((6, 4, 4), (30.0, 20.0, 20.0), planes={"J": ("x", 15.0)})
    moves = np.random.default_rng(2).uniform(-1.0, 1.0, size=mesh.points.shape)
    edges = (mesh.points == 0.0) | (mesh.points == mesh.points.max(axis=0))
    moves[edges | (mesh.points == 15.0)] = 0.0
    mesh = Mesh(mesh.points + moves, mesh.zones, mesh.zone_group, mesh.groups, mesh.surfaces)
    known = {
        "materials": {"rock": ROCK},
        "boundaries": [*map(Viscous, SIDES)],
        "damping": Damping(0.02, 50.0),
        "sources": HOLES,
        "receivers": [Receiver("A", (8.0, 11.0, 17.0)), Receiver("B", (24.0, 6.0, 15.0), 0.6)],
    }
    return Model(mesh.split(["J"]), joints=[Joint("J", law, properties)], **{**known, **parts})


LINEAR = {
    "elastic": {},
    "constant Q, Maxwell fill": {
        "law": "maxwell",
        "properties": {**STIFFNESS, "eta_n": 2e6, "eta_s": 1e6},
        "damping": None,
        "materials": {"rock": replace(ROCK, law=ConstantQ(30.0, 20.0, (5.0, 100.0)))},
    },
    "zones of 15 nodes": {"quadratic": True},
    "stuck by friction, under stress": {
        "law": "coulomb",
        "properties": STRONG,
        "insitu": InSitu(),
    },
}


def gap(found, wanted):
    """Largest difference of seismograms over the largest velocity."""
    top = max(np.abs(one.velocity).max() for one in wanted.values())
    return max(np.abs(found[n].velocity - wanted[n].velocity).max() for n in wanted) / top


@pytest.mark.parametrize("parts", LINEAR.values(), ids=LINEAR.keys())
@pytest.mark.parametrize("side", ["source", "receiver"])
def test_a_blast_is_that_of_its_run(parts, side):
    model = jointed(**parts)
    direct = simulate(model, DURATION).seismograms

    bank = greens_functions(model, DURATION, side=side)

    assert bank.runs == {"source": 5, "receiver": 6}[side]
    found = bank.blast(model.sources)
    assert gap(found, direct) < 1e-10
    assert found["B"].components == direct["B"].components
    assert found["A"].times == pytest.approx(direct["A"].times, abs=1e-15)


def test_a_column_detonates_in_its_stored_response():
    column = Column(np.array([8.0, 11.0, 4.0]), np.array([8.0, 12.0, 11.0]), 20.0, 0.02, SHORT)
    model = jointed(sources=[column])

    bank = greens_functions(model, DURATION)

    assert bank.side == "source"
    assert gap(bank.blast([column]), simulate(model, DURATION).seismograms) < 1e-10
    with pytest.raises(InputError, match="columns are stored from their own side"):
        greens_functions(model, DURATION, side="receiver")


def test_the_side_with_fewer_runs_is_taken_and_said():
    one_receiver = jointed().receivers[:1]
    few, many = jointed(sources=HOLES[1:3]), jointed(receivers=one_receiver)

    banks = [greens_functions(model, 0.01) for model in (few, many)]

    assert [bank.side for bank in banks] == ["source", "receiver"]
    assert [bank.runs for bank in banks] == [2, 3]
    assert "fewer): 5 runs for 4 places, or 3 for 1 receivers" in banks[1].said


def test_holes_share_a_run_within_a_stated_part_of_the_wavelength():
    near = replace(HOLES[0], position=HOLES[0].position + np.array([0.3, -0.4, 0.0]))
    model = jointed(sources=[near])
    bank = greens_functions(jointed(sources=[HOLES[0], near]), DURATION, within=0.5)

    error = gap(bank.blast([near]), simulate(model, DURATION).seismograms)

    assert bank.runs == 1
    assert 1e-3 < error < 2.0 * np.pi * 125.0 * 0.5 / 2000.0
    with pytest.raises(InputError, match=r"sources\[0\]: .* nearest stored place .* add its place"):
        bank.blast([replace(near, position=near.position + 0.4)])
    with pytest.raises(InputError, match=r"sources\[1\]: no Hole of this shape is stored"):
        bank.blast([near, replace(near, spread=3.0)])


def test_a_bank_is_resumed_from_what_is_kept(tmp_path):
    model = jointed()
    kept = greens_functions(jointed(sources=HOLES[:3]), DURATION, side="source", folder=tmp_path)
    assert len(list(tmp_path.iterdir())) == 2

    with workers(1) as pool:
        bank = greens_functions(model, DURATION, side="source", folder=tmp_path, executor=pool)

    assert len(list(tmp_path.iterdir())) == 5
    assert np.array_equal(bank.response[:2], kept.response)
    before = [path.stat().st_mtime_ns for path in sorted(tmp_path.iterdir())]
    again = greens_functions(model, DURATION, side="source", folder=tmp_path)
    assert [path.stat().st_mtime_ns for path in sorted(tmp_path.iterdir())] == before
    assert np.array_equal(again.response, bank.response)


class Killing:
    """An executor of a dask cluster, one of whose workers is killed after the second task."""

    def __init__(self, executor, cluster):
        self.executor, self.cluster, self.given = executor, cluster, 0

    def submit(self, *task):
        future = self.executor.submit(*task)
        self.given += 1
        if self.given == 2:
            next(iter(self.cluster.workers.values())).process.process._process.kill()
        return future


@pytest.mark.long
def test_workers_of_dask_give_the_same_bits_though_one_is_killed(tmp_path, monkeypatch):
    distributed = pytest.importorskip("distributed", reason="needs pip install pyblast[dask]")
    monkeypatch.chdir(tmp_path)
    models = [jointed(sources=HOLES[:n]) for n in (1, 2, 3)]
    alone = greens_functions(jointed(), DURATION, side="source")
    one_by_one = run_all(models, DURATION)

    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
        ) as cluster,
        executor_of(dask=cluster.scheduler_address) as executor,
    ):
        killing = Killing(executor, cluster)
        bank = greens_functions(jointed(), DURATION, side="source", folder="runs", executor=killing)
        together = run_all(models, DURATION, folder="runs", executor=killing)

    assert killing.given >= 4
    assert np.array_equal(bank.response, alone.response)
    for found, wanted in zip(together, one_by_one, strict=True):
        for name, motion in wanted.seismograms.items():
            assert np.array_equal(found.seismograms[name].velocity, motion.velocity)
    assert len(list((tmp_path / "runs").iterdir())) == 5 + 3


SHAKEN = Seismogram(0.01 * ricker(TIMES, 50.0)[:, None] * [0.8, 0.5, -0.3], TIMES[1])
REFUSED = {
    r"joints\.J: \d+ of \d+ contacts slip or open in this run": {
        "law": "coulomb", "properties": WEAK,
    },
    r"joints\.J\.law: holes do not superpose across 'closure'": {
        "law": "closure", "properties": {**STIFFNESS, "closure": 1e-3},
    },
    r"materials\.rock: holes do not superpose in ground of the law 'mohr-coulomb'": {
        "materials": {"rock": replace(ROCK, cohesion=1e6, friction=0.7, law=MohrCoulomb())}
    },
    r"boundaries\.west: stored responses are those of holes alone": {
        "boundaries": [*map(Viscous, SIDES), StressInput("west", SHAKEN)]
    },
    r"local_damping: holes do not superpose": {"local_damping": 0.5},
    r"receivers: none": {"receivers": ()},
    r"sources: none": {"sources": ()},
}  # fmt: skip


@pytest.mark.parametrize("words", REFUSED)
def test_what_does_not_superpose_is_refused(words):
    with pytest.raises(InputError, match=words):
        greens_functions(jointed(**REFUSED[words]), DURATION)


def test_anisotropic_ground_superposes_from_both_sides():
    ground = medium(ROCK, (0.0, 0.6, 0.8), 5.0, 4e9, 2e9)
    model = jointed(materials={"rock": ground}, sources=HOLES[:2])
    direct = simulate(model, DURATION).seismograms

    for side in ("source", "receiver"):
        assert gap(greens_functions(model, DURATION, side=side).blast(HOLES[:2]), direct) < 1e-10


def test_a_receiver_of_one_component_takes_one_run():
    normal = Receiver("N", (8.0, 11.0, 17.0), normal=(0.0, -3.0, 4.0))
    model = jointed(receivers=[normal])

    bank = greens_functions(model, DURATION, side="receiver")

    run = simulate(model, bank.duration).seismograms["N"].velocity
    found = bank.blast(model.sources)["N"].velocity[: len(run)]
    assert bank.runs == 1
    assert found == pytest.approx(run, abs=1e-9 * np.abs(run).max())
