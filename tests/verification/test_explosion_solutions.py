"""Closed forms of explosions and running loads, against other ways to the same numbers."""

import numpy as np
import pytest

from pyblast.model.material import Material
from pyblast.model.source import Column, TimeFunction
from verification.columns import ricker
from verification.solutions.column import far_field, radiation
from verification.solutions.full_space import Bell, force_spectrum
from verification.solutions.half_space import surface_motion
from verification.solutions.running_load import coupling, load_that_sets_out
from verification.solutions.slipping_plane import slip
from verification.solutions.spherical_cavity import cavity_motion
from verification.solutions.yielding_cavity import (
    Rise,
    corner_frequency,
    source_spectrum,
    still_radius,
    yielding_cavity,
)

ROCK = Material.from_speeds(2500.0, 3464.1, 2000.0)
TIMES = np.arange(0.0, 0.3, 1e-3)


@pytest.mark.parametrize("distance", [50.0, 200.0])
def test_a_plane_without_friction_slips_as_a_free_surface_moves(distance):
    pulse = Bell(20.0)

    def spectrum(omega):
        return np.exp(1j * np.outer(omega, TIMES)) @ pulse(TIMES) * TIMES[1]

    by_wave_numbers = surface_motion(spectrum, TIMES, distance, ROCK, 50.0)[:, 0]
    rate = slip(TIMES, distance, 50.0, pulse, ROCK, slope=1)

    assert rate == pytest.approx(by_wave_numbers, abs=1e-6 * np.abs(rate).max())


def test_ground_follows_a_slow_load_as_under_a_weight_at_rest():
    first, shear = ROCK.first_lame, ROCK.shear
    limit = (first + 2.0 * shear) / (2.0 * shear * (first + shear))

    assert coupling(20.0, ROCK) == pytest.approx(-20j * limit, rel=2e-4)


@pytest.mark.parametrize("speeds", [(600.0, 170.0), (1100.0, 600.0)])
def test_a_load_that_set_out_long_ago_moves_the_ground_as_one_that_always_ran(speeds):
    ground, place, air = Material.from_speeds(2000.0, *speeds), 204.0, 340.0
    times = np.arange(0.0, 0.76, 2e-3)
    late = times - place / air
    near = np.abs(late - 0.075) < 0.08
    motion = load_that_sets_out(lambda t: ricker(t, 20.0), times, place, air, ground)
    waves = np.exp(2j * np.pi * np.outer([16.0, 20.0, 24.0], times[near]))

    ratio = (waves @ motion[near]) / (waves @ ricker(late[near], 20.0))

    wanted = coupling(air, ground)
    assert ratio == pytest.approx(np.full(3, wanted), abs=0.012 * abs(wanted))


def test_soil_slower_than_air_answers_less_than_the_slow_limit():
    soil = Material.from_speeds(2000.0, 317.8, 169.9)

    assert coupling(340.0, soil) == pytest.approx(1.35e-6, rel=5e-3)


def test_the_far_field_of_forces_is_that_of_the_full_space_far_away():
    omega, distance = 2.0 * np.pi * 300.0, 3e4
    places = np.array([[0.0, 0.0, 0.0], [1.0, -2.0, 0.5]])
    forces = np.array([[1.0, 2.0, -1.0], [0.5j, 0.0, 1.0]])
    ray, across = np.array([0.6, 0.0, 0.8]), np.array([0.8, 0.0, -0.6])
    motion = sum(
        force_spectrum(np.array([omega]), distance * ray - place, ROCK)[0] @ force
        for place, force in zip(places, forces, strict=True)
    )

    waves = far_field(places, forces, ray[None], across[None], omega, ROCK)
    for wave, axis, speed in zip(waves, (ray, across), (ROCK.cp, ROCK.cs), strict=True):
        sent = -1j * omega / (4.0 * np.pi * ROCK.density * speed**3 * distance) * wave[0]
        wanted = sent * np.exp(1j * omega * distance / speed)
        assert motion @ axis == pytest.approx(wanted, abs=1e-3 * abs(wanted))


def test_points_of_a_column_add_up_to_its_radiation():
    column = Column(np.zeros(3), np.array([0.0, 0.0, 12.0]), 1.0, 0.0, TimeFunction([1.0, 1.0], 1))
    places, delays = column.points(60)
    tensor, omega = column.tensor(ROCK), 2.0 * np.pi * 200.0
    angles = np.radians([10.0, 45.0, 80.0, 130.0])
    rays = np.stack([np.sin(angles), 0.0 * angles, np.cos(angles)], axis=1)
    across = np.stack([np.cos(angles), 0.0 * angles, -np.sin(angles)], axis=1)

    for wanted, axis, speed in zip(
        radiation(angles, omega, 12.0, 4500.0, ROCK), (rays, across), (ROCK.cp, ROCK.cs),
        strict=True,
    ):  # fmt: skip
        phases = np.exp(1j * omega * (delays - rays @ places.T / speed)).mean(axis=1)
        found = np.einsum("ra,ab,rb->r", axis, tensor, rays) * phases
        assert found == pytest.approx(wanted, abs=1e-3)


class Pushed:
    """A rise of pressure and its slope."""

    def __init__(self, rise):
        self.rise = rise

    def __call__(self, times, slope=0):
        step = 1e-3 * self.rise.duration
        if slope == 0:
            return self.rise(times)
        return (self.rise(times + step) - self.rise(times - step)) / (2.0 * step)


def test_a_cavity_in_strong_ground_moves_as_in_elastic_ground():
    strong = Material.from_speeds(2500.0, 4000.0, 2309.4, cohesion=1e12)
    rise = Rise(5e-4)
    times, velocity, yielded = yielding_cavity(1.0, rise, 6.0, 4e-3, strong, cells=20)

    wanted = cavity_motion(times, 6.0, 1.0, Pushed(rise), strong)[1]

    assert yielded == 1.0
    assert velocity == pytest.approx(wanted, abs=5e-3 * np.abs(wanted).max())


def test_ground_yields_as_far_as_at_rest_where_pressure_rises_slowly():
    weak = Material.from_speeds(2500.0, 4000.0, 2309.4, cohesion=10e6)
    slow = Rise(2.5e-2)

    _, _, yielded = yielding_cavity(1.0, lambda t: 35e6 * slow(t), 4.0, 2.8e-2, weak, cells=15)

    assert yielded == pytest.approx(still_radius(1.0, 35e6, 10e6), rel=0.03)


def test_the_corner_of_one_hole_falls_faster_than_similarity():
    weak = Material.from_speeds(2500.0, 4000.0, 2309.4, cohesion=10e6)
    rise, frequencies, found = Rise(5e-4), np.linspace(2.0, 1000.0, 500), []
    for pressure in (40e6, 60e6):
        times, velocity, yielded = yielding_cavity(
            1.0, lambda t, p=pressure: p * rise(t), 6.0, 8e-3, weak, cells=12
        )
        spectrum = source_spectrum(times, velocity, 6.0, frequencies, weak)
        found.append((yielded, corner_frequency(frequencies, spectrum)))
    (first, high), (second, low) = found

    assert np.log(low / high) / np.log(second / first) == pytest.approx(-1.5, abs=0.1)
