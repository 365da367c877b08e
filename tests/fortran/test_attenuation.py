"""The law that fades: its modulus, its energy, its time step."""

from dataclasses import replace

import numpy as np
import pytest

from pyblast import core
from pyblast.mesh.builder import structured_box
from pyblast.model.material import ConstantQ, Damping, Material, relative_modulus
from pyblast.model.model import Model
from pyblast.solver.time_step import critical_step
from verification.columns import started

ROCK = Material.from_speeds(2700.0, 3000.0, 1700.0)


class Node:
    """A node that is led along one way, with the memories of a law; its spring has stiffness 1."""

    def __init__(self, law, dt):
        self.branches, self.dt = law.branches, dt
        self.rate = np.array([one.rate for one in law.branches])
        self.memory, self.at = np.zeros((1, len(self.rate), 3)), np.zeros((1, 3))

    def force(self, place):
        """Return the force of springs and branches, in shear, at the next place."""
        before, self.at = self.at, np.array([[place, 0.0, 0.0]])
        velocity = (self.at - before) / self.dt
        core._core.pyblast_border.update_memory(
            dt=self.dt, memory_rate=self.rate, displacement=self.at[..., None].T,
            velocity=velocity[..., None].T, memory=self.memory[..., None].T,
        )  # fmt: skip
        lag = place - self.memory[0, :, 0]
        return place + sum(one.shear * x for one, x in zip(self.branches, lag, strict=True))


@pytest.mark.parametrize("quality", [5.0, 10.0, 30.0, 100.0])
@pytest.mark.parametrize(("high", "least", "below_ten"), [(100.0, 0.04, 0.05), (10.0, 0.01, 0.01)])
def test_q_holds_over_two_decades_and_better_over_one(quality, high, least, below_ten):
    frequency = np.geomspace(1.0, high, 100)

    _, found = ConstantQ(1.4 * quality, quality, (1.0, high)).wave(quality, 1700.0, frequency)

    within = least if quality >= 10.0 else below_ten
    assert 1.0 / found == pytest.approx(np.full(100, 1.0 / quality), rel=within)


def test_speed_is_that_of_the_material_at_the_reference():
    law = ConstantQ(60.0, 20.0, reference=8.0)

    assert law.wave(20.0, 1700.0, 8.0)[0] == pytest.approx(1700.0, rel=1e-12)


def test_speed_grows_with_frequency_as_kramers_and_kronig_ask():
    speed = ConstantQ(60.0, 20.0).wave(20.0, 1700.0, np.array([5.0, 20.0]))[0]

    assert speed[1] / speed[0] == pytest.approx(1.0 + np.log(4.0) / (np.pi * 20.0), rel=0.005)


def answer(law, frequency, dt, steps, late):
    """Return the complex modulus over the relaxed one of a driven node, and its steady part."""
    node = Node(law, dt)
    turn = np.exp(-2j * np.pi * frequency * dt * np.arange(1, steps + 1))
    force = np.array([node.force(place) for place in turn.real])
    return 2.0 * np.mean(force[-late:] * turn[-late:].conj())


def test_a_driven_node_answers_with_its_complex_modulus():
    law, frequency, dt = ConstantQ(30.0, 15.0, reference=10.0), 12.5, 1e-4

    modulus = answer(law, frequency, dt, 24000, 8000)  # ten whole periods

    assert modulus == pytest.approx(relative_modulus(law.branches, frequency), rel=1e-4)


def test_the_march_is_the_body_at_a_frequency_bent_by_the_step():
    law, frequency, dt = ConstantQ(30.0, 15.0), 40.0, 2e-3

    modulus = answer(law, frequency, dt, 4000, 2000)  # 160 whole periods

    bent = np.tan(np.pi * frequency * dt) / (np.pi * dt)
    assert modulus == pytest.approx(relative_modulus(law.branches, bent), rel=1e-9)


def test_the_memory_converges_with_the_square_of_the_step():
    law, errors = ConstantQ(30.0, 15.0), []
    for dt in (2e-3, 1e-3):
        bent = np.tan(np.pi * 12.0 * dt) / (np.pi * dt)
        errors.append(np.abs(np.subtract(*relative_modulus(law.branches, np.array([bent, 12.0])))))

    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.02)


def test_constant_q_costs_next_to_no_time_step():
    mesh = structured_box((2, 2, 2), (10.0, 10.0, 10.0))
    with_q = Material.from_speeds(2700.0, 3000.0, 1700.0, law=ConstantQ(60.0, 30.0))

    steps = [critical_step(Model(mesh, {"rock": m})).dt for m in (ROCK, with_q)]

    assert 0.95 < steps[1] / steps[0] <= 1.0


def test_low_passed_damping_costs_far_less_than_rayleigh():
    mesh = structured_box((2, 2, 2), (10.0, 10.0, 10.0))
    dampings = (None, Damping(0.05, 4.0), Damping(0.05, 4.0, corner=60.0))

    free, plain, cheap = (
        critical_step(Model(mesh, {"rock": ROCK}, damping=damping)).dt for damping in dampings
    )

    assert plain < 0.35 * free
    assert cheap == pytest.approx(free / np.sqrt(1.0 + 0.05 * 60.0 / 4.0), rel=1e-6)


def test_low_passed_damping_is_rayleigh_far_below_its_corner():
    low = Damping(0.02, 4.0, corner=400.0)

    assert low.ratio_at(4.0) == pytest.approx(Damping(0.02, 4.0).ratio_at(4.0), rel=1e-3)


def test_a_compression_that_would_gain_energy_is_refused():
    with pytest.raises(Exception, match="makes compression gain energy"):
        ConstantQ(1000.0, 10.0).properties(ROCK)


LOH3 = (2600.0, 4000.0, 2000.0, 120.0, 40.0), (2700.0, 6000.0, 3464.0, 155.9, 69.3)


@pytest.mark.parametrize("reference", [0.25, 2.5, 25.0])
@pytest.mark.parametrize(("density", "cp", "cs", "qp", "qs"), LOH3)
def test_ground_of_infinite_bulk_quality_loses_by_shear_alone(density, cp, cs, qp, qs, reference):
    law = ConstantQ(qp, qs, (0.25, 25.0), reference)
    rock = Material.from_speeds(density, cp, cs, law=law)
    branches, (lame, shear) = rock.law.branches, rock.law.moduli(rock)

    frequency = np.geomspace(0.25, 25.0, 30)
    p, s = (relative_modulus(branches, frequency, wave) for wave in ("compression", "shear"))

    gains = [(lame + 2 * shear) * b.compression - 4 / 3 * shear * b.shear for b in branches]
    assert rock.law.properties(rock) == {}
    assert min(gains) >= -1e-8 * shear * max(b.shear for b in branches)
    np.testing.assert_allclose(-p.real / p.imag, qp, rtol=0.05)
    np.testing.assert_allclose(-s.real / s.imag, qs, rtol=0.05)


def test_a_quality_below_that_of_infinite_bulk_quality_is_fitted_by_itself():
    law = ConstantQ(110.0, 40.0, (0.25, 25.0))

    assert Material.from_speeds(2600.0, 4000.0, 2000.0, law=law).law == law


@pytest.mark.parametrize("wave", ["compression", "shear"])
def test_ground_strained_at_once_holds_the_energy_of_its_unrelaxed_modulus(wave):
    law = ConstantQ(30.0, 15.0, (5.0, 50.0))
    one = Model(structured_box((2, 2, 2), (4.0, 4.0, 4.0)), {"rock": replace(ROCK, law=law)})
    displacement = np.zeros_like(one.mesh.points)
    displacement[:, 0 if wave == "compression" else 1] = 1e-4 * one.mesh.points[:, 0]

    run = started(one, 1e-3, displacement, np.zeros_like(displacement))

    lame, shear = law.moduli(ROCK)
    modulus = lame + 2.0 * shear if wave == "compression" else shear
    at_once = modulus * relative_modulus(law.branches, np.array([1e9]), wave)[0].real
    assert run.energy["strain"][0] == pytest.approx(0.5 * at_once * 1e-8 * 64.0, rel=1e-9)
