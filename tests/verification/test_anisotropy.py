"""Ground whose stiffness depends on direction: symmetry, waves, faces, time step, energy."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pyblast.errors import InputError
from pyblast.mesh.builder import structured_box
from pyblast.mesh.mesh import Mesh
from pyblast.model import anisotropy
from pyblast.model.anisotropy import Anisotropic, anisotropic, jointed, transverse
from pyblast.model.boundary import StressInput, Viscous
from pyblast.model.material import Damping
from pyblast.model.model import Model, Receiver
from pyblast.signals.seismogram import Seismogram
from pyblast.solver.assembly import time_step
from pyblast.solver.edge_springs import EDGE_ARRAYS, without_edges
from pyblast.solver.loads import surface_impedance
from pyblast.solver.preparation import prepare
from pyblast.solver.run import simulate
from pyblast.solver.time_step import critical_step, model_frequencies
from verification.columns import ROCK, ricker, started

SIDES = ("west", "east", "south", "north", "bottom")
MODULI = {
    "young": 60e9, "young_normal": 30e9, "poisson": 0.2, "poisson_normal": 0.15,
    "shear_normal": 12e9,
}  # fmt: skip


def schist(normal=(0.0, 0.0, 1.0), turn=None):
    turn = turn or Rotation.identity()
    return transverse(2700.0, turn.apply(normal), **MODULI)


def crooked(turn=None, seed=2):
    mesh = structured_box((6, 4, 4), (30.0, 20.0, 20.0))
    inside = ((mesh.points > 0.0) & (mesh.points < mesh.points.max(axis=0))).all(axis=1)
    moves = np.random.default_rng(seed).uniform(-0.7, 0.7, size=mesh.points.shape)
    points = mesh.points + inside[:, None] * moves
    points = points if turn is None else turn.apply(points)
    return Mesh(points, mesh.zones, mesh.zone_group, mesh.groups, mesh.surfaces)


def shaken(turn=None):
    turn = turn or Rotation.identity()
    times = np.arange(0.0, 0.1, 5e-4)
    motion = ricker(times, 40.0)[:, None] * [0.8, 0.5, -0.3]
    model = Model(
        crooked(turn),
        {"rock": schist((0.3, 0.2, 1.0), turn)},
        boundaries=[
            *map(Viscous, SIDES),
            StressInput("west", Seismogram(turn.apply(motion), times[1])),
        ],
        receivers=[Receiver("A", tuple(turn.apply([17.0, 9.0, 12.0])))],
    )
    return simulate(model, 0.1)


@pytest.mark.parametrize("by_edges", [True, False])
def test_a_medium_of_isotropic_stiffness_is_damped_as_isotropic_ground(by_edges, monkeypatch):
    if not by_edges:

        def by_zones(_, arrays):
            return {name: without_edges(arrays)[name] for name in EDGE_ARRAYS}

        monkeypatch.setattr("pyblast.solver.assembly.edge_arrays", by_zones)
    stiff = jointed(ROCK, (0.3, 0.2, 1.0), 1.0, 1e25, 1e25)
    times = np.arange(0.0, 0.1, 5e-4)
    push = Seismogram(ricker(times, 40.0)[:, None] * [0.8, 0.5, -0.3], times[1])
    models = [
        Model(
            crooked(), {"rock": rock}, damping=Damping(0.05, 30.0),
            boundaries=[*map(Viscous, SIDES), StressInput("west", push)],
            receivers=[Receiver("A", (17.0, 9.0, 12.0))],
        )
        for rock in (ROCK, stiff)
    ]  # fmt: skip
    step = time_step(models[0])
    plain, other = (
        simulate(one, 0.05, prepared=prepare(one, 0.05, step=step)).seismograms["A"].velocity
        for one in models
    )

    assert other == pytest.approx(plain, abs=1e-6 * np.abs(plain).max())


def test_moduli_of_a_transverse_medium_are_those_of_its_tests():
    compliance = np.linalg.inv(schist().law.stiffness)

    assert 1.0 / np.diag(compliance)[[0, 2, 3]] == pytest.approx([60e9, 30e9, 12e9])
    assert -compliance[1, 0] / compliance[0, 0] == pytest.approx(0.2)
    assert -compliance[0, 2] / compliance[2, 2] == pytest.approx(0.15)


def test_joints_give_the_stiffness_of_schoenberg():
    kn, ks, spacing = 2e9, 1e9, 10.0
    lame, shear = ROCK.first_lame, ROCK.shear
    stiff = lame + 2.0 * shear
    normal, along = stiff / (kn * spacing), shear / (ks * spacing)
    normal, along, ratio = normal / (1.0 + normal), along / (1.0 + along), lame / stiff

    c = jointed(ROCK, (0.0, 0.0, 2.0), spacing, kn, ks).law.stiffness

    assert c[2, 2] == pytest.approx(stiff * (1.0 - normal))
    assert c[0, 0] == pytest.approx(stiff * (1.0 - ratio**2 * normal))
    assert c[0, 1] == pytest.approx(lame * (1.0 - ratio * normal))
    assert c[0, 2] == pytest.approx(lame * (1.0 - normal))
    assert c[3, 3] == pytest.approx(shear * (1.0 - along))
    assert c[5, 5] == pytest.approx(shear)


def test_sets_of_joints_may_come_in_any_order():
    first, second = ((1.0, 0.0, 0.5), 5.0, 3e9, 1e9), ((0.0, 1.0, 0.0), 8.0, 2e9, 1e9)

    one, other = (jointed(jointed(ROCK, *a), *b) for a, b in ((first, second), (second, first)))

    assert one.law.stiffness == pytest.approx(other.law.stiffness, rel=1e-9, abs=1.0)


@pytest.mark.parametrize("seed", range(3))
def test_a_turned_law_answers_turned_strains_with_turned_stresses(seed):
    rng = np.random.default_rng(seed)
    turn = Rotation.random(rng=rng).as_matrix()
    law, strain = jointed(schist(), rng.normal(size=3), 5.0, 1e10, 5e9).law, rng.normal(size=(3, 3))
    strain = strain + strain.T

    def answer(stiffness, tensor):
        column = [tensor[a, b] * (1.0 if a == b else 2.0) for a, b in anisotropy.VOIGT]
        found = np.empty((3, 3))
        for (a, b), value in zip(anisotropy.VOIGT, stiffness @ column, strict=True):
            found[a, b] = found[b, a] = value
        return found

    stress = answer(law.turned(turn).stiffness, turn @ strain @ turn.T)
    wanted = turn @ answer(law.stiffness, strain) @ turn.T
    assert stress == pytest.approx(wanted, abs=1e-10 * np.abs(wanted).max())


def test_isotropic_constants_give_the_motion_of_the_isotropic_law():
    same = anisotropic(ROCK.density, anisotropy.stiffness_of(ROCK))
    mesh, velocity = crooked(), np.random.default_rng(1).normal(size=(175, 3))
    states = [
        started(Model(mesh, {"rock": m}), 0.02, 0.0 * velocity, velocity).state["displacement"]
        for m in (ROCK, same)
    ]

    assert states[1] == pytest.approx(states[0], abs=1e-9 * np.abs(states[0]).max())


def test_a_zone_alone_vibrates_no_faster_than_it_can():
    mesh = crooked()
    same = anisotropic(ROCK.density, anisotropy.stiffness_of(ROCK))

    exact, general = (model_frequencies(Model(mesh, {"rock": m})) for m in (ROCK, same))

    assert general == pytest.approx(exact, rel=1e-9)


def test_joints_never_shorten_the_step_of_their_rock():
    mesh = crooked()
    soft = jointed(ROCK, (1.0, 0.4, 0.2), 5.0, 1e9, 5e8)

    steps = [critical_step(Model(mesh, {"rock": m})).dt for m in (ROCK, soft)]

    assert steps[1] >= steps[0]


def test_energy_left_alone_stays_at_the_critical_step():
    model = Model(crooked(), {"rock": schist((0.3, 0.2, 1.0))}, step_factor=1.0)
    velocity = np.random.default_rng(3).normal(size=model.mesh.points.shape)
    dt = prepare(model, 1.0).constants["dt"]

    result = started(model, 2000 * dt, 0.0 * velocity, velocity)

    assert result.balance_error < 1e-10


def test_a_turned_model_gives_turned_seismograms():
    turn = Rotation.random(rng=np.random.default_rng(1))

    straight, other = (shaken(t).seismograms["A"] for t in (None, turn))

    wanted = turn.apply(straight.velocity.copy())
    assert other.velocity == pytest.approx(wanted, abs=1e-9 * straight.pvs)


@pytest.mark.parametrize("normal", [(1.0, 0.0, 0.0), (0.6, 0.0, 0.8)])
def test_waves_along_a_normal_meet_their_own_impedances(normal):
    stiffness = schist((0.3, 0.2, 1.0)).law.stiffness

    wave = anisotropy.impedance(2700.0, stiffness, np.array(normal))

    squared, way = np.linalg.eigh(anisotropy.christoffel(stiffness, np.array(normal)))
    for c2, d in zip(squared / 2700.0, way.T, strict=True):
        assert wave @ d == pytest.approx(2700.0 * np.sqrt(c2) * d, rel=1e-9, abs=1e-3)


def test_impedance_of_isotropic_ground_is_that_of_its_two_waves():
    n = np.array([0.48, 0.6, 0.64])

    found = anisotropy.impedance(ROCK.density, anisotropy.stiffness_of(ROCK), n)

    outer = np.outer(n, n)
    wanted = ROCK.density * (ROCK.cp * outer + ROCK.cs * (np.eye(3) - outer))
    assert found == pytest.approx(wanted, rel=1e-9, abs=1e-3)


class Slow:
    """A field of the ground that slows all waves alike."""

    def factor(self, places, edges):
        del edges
        return np.full(len(places), 0.8)


def test_fields_of_the_ground_scale_the_whole_stiffness():
    parts = {"materials": {"rock": schist((0.3, 0.2, 1.0))}, "boundaries": [Viscous("west")]}

    whole, slow = (Model(crooked(), **parts, ground=ground) for ground in ((), (Slow(),)))

    for model, factor in ((whole, 1.0), (slow, 0.8)):
        assert model_frequencies(model) == pytest.approx(factor**2 * model_frequencies(whole))
        found = next(iter(surface_impedance(model, "west").values()))
        wanted = next(iter(surface_impedance(whole, "west").values()))
        assert found == pytest.approx(factor * wanted)


def test_stiffness_that_stores_no_energy_is_refused():
    with pytest.raises(InputError, match="every strain must store energy"):
        Anisotropic(np.diag([1.0, 1.0, 1.0, 1.0, 1.0, -1.0]))
    with pytest.raises(InputError, match="poisson_normal"):
        transverse(2700.0, (0, 0, 1), **{**MODULI, "poisson_normal": 0.7})
    with pytest.raises(InputError, match=r"jointed\.kn: must be positive, got 0"):
        jointed(ROCK, (0, 0, 1), 5.0, 0.0, 1e9)
