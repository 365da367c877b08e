"""The closed forms of joints against each other, energy and tables."""

import numpy as np
import pytest

from verification.columns import ROCK
from verification.solutions.joints import (
    oblique,
    past_closure,
    past_friction,
    through_heavy_spring,
    through_layer,
    through_spring,
)
from verification.solutions.rough_joints import (
    RoughWalls,
    Yielding,
    led_by,
    past_rough_walls,
    past_yielding,
)

OMEGA, KN, KS = 120.0, 8e8, 3e8
MILLER = {0.9: (0.964, 0.055, 0.262), 0.5: (0.625, 0.416, 0.660), 0.1: (0.138, 0.875, 0.465)}


@pytest.mark.parametrize("share", MILLER)
def test_a_clipped_wave_has_the_energies_of_its_samples(share):
    wave = np.sin(np.linspace(0.0, 2.0 * np.pi, 4000, endpoint=False))
    clipped = np.clip(wave, -share, share)

    passes, back, lost = past_friction(share)

    assert passes**2 == pytest.approx(np.mean(clipped**2) / 0.5, rel=1e-4)
    assert back**2 == pytest.approx(np.mean((wave - clipped) ** 2) / 0.5, rel=1e-4)
    assert (passes, back, lost) == pytest.approx(MILLER[share], abs=6e-4)


@pytest.mark.parametrize(("gamma", "peak"), [(0.1, 0.680), (1.0, 0.872), (5.0, 0.999)])
def test_the_peak_behind_a_closing_joint_rises_with_amplitude(gamma, peak):
    z, omega = 1e7, 2.0 * np.pi * 20.0
    k = 0.35 * z * omega
    times = np.linspace(0.0, 0.05, 2000)

    found = past_closure(times, lambda t: max(0.0, np.sin(omega * t)) * (t < np.pi / omega),
                         z, k, z / (k * gamma))  # fmt: skip

    assert found.max() == pytest.approx(peak, abs=2e-3)


def test_a_thin_layer_is_a_heavy_spring():
    density, speed, width, z = 1900.0, 500.0, 0.05, 1e7
    spring = through_heavy_spring(OMEGA, z, density * speed**2 / width, density * width)
    layer = through_layer(OMEGA, z, density * speed, width / speed)

    assert spring == pytest.approx(layer, rel=2e-4)


@pytest.mark.parametrize(("wave", "speed", "k"), [("P", ROCK.cp, KN), ("S", ROCK.cs, KS)])
def test_straight_through_a_joint_only_its_own_spring_counts(wave, speed, k):
    waves = oblique(OMEGA, 0.0, wave, ROCK, KN, KS)

    assert waves[wave][0] == pytest.approx(through_spring(OMEGA, ROCK.density * speed, k))
    assert abs(waves["S" if wave == "P" else "P"][0]) < 1e-12


@pytest.mark.parametrize("angle", [0.2, 0.5, 0.9])
def test_a_stiff_joint_lets_an_oblique_wave_through_unchanged(angle):
    waves = oblique(OMEGA, angle, "P", ROCK, 1e18, 1e18)

    assert waves["P"][0] == pytest.approx(1.0, abs=1e-6)
    assert abs(waves["S"][0]) < 1e-6


@pytest.mark.parametrize("angle", [0.2, 0.5, 0.9])
def test_energy_reaches_and_leaves_an_oblique_joint_alike(angle):
    waves = oblique(OMEGA, angle, "P", ROCK, KN, KS)
    speed = {"P": ROCK.cp, "S": ROCK.cs}

    flux = sum(abs(a) ** 2 * speed[kind[0]] ** 2 * abs(s[0]) for kind, (a, s, _) in waves.items())

    assert flux == pytest.approx(ROCK.cp * np.cos(angle), rel=1e-12)


def test_a_small_wave_meets_the_tangent_of_a_pressed_joint():
    z, omega, k, vm, pressure = 1e7, 120.0, 1e8, 1e-3, 3e5
    times = np.linspace(0.0, 0.4, 4001)

    found = past_closure(times, lambda t: 1e-5 * np.sin(omega * t), z, k, vm, pressure)

    tangent = k * (1.0 + pressure / (k * vm)) ** 2
    size = np.abs(through_spring(omega, z, tangent))
    assert np.abs(found[2000:]).max() == pytest.approx(1e-5 * size, rel=2e-3)


def test_walls_that_do_not_dilate_clip_the_wave_at_their_strength():
    walls = RoughWalls(1e8, 1e-3, jrc=10.0, jcs=5e5, friction=0.6, peak_slip=1.0)
    times = np.linspace(0.0, 0.1, 501)

    found = past_rough_walls(times, lambda t: np.sin(2.0 * np.pi * 20.0 * t), 1e6, walls, 5e5)

    assert walls.strength(5e5) == pytest.approx(3e5)
    assert found == pytest.approx(np.clip(np.sin(40.0 * np.pi * times), -0.3, 0.3), abs=1e-9)


def test_walls_that_dilate_let_more_of_each_cycle_through():
    walls = RoughWalls(1e9, 1e-3, jrc=10.0, jcs=5e7, friction=0.6, peak_slip=1.0)
    times = np.linspace(0.0, 0.15, 751)

    found = past_rough_walls(times, lambda t: 0.1 * np.sin(40.0 * np.pi * t), 5e6, walls, 2e5)

    peaks = [found[250 * n : 250 * (n + 1)].max() for n in range(3)]
    assert peaks == sorted(peaks)
    assert peaks[2] > 1.05 * peaks[0]


def test_a_yielding_joint_that_does_not_wear_follows_an_exponential():
    law = Yielding(1e9, 1e6, np.arctan(0.6), np.arctan(0.6), 5e-3)

    places, shears = led_by(law, [1e-3, -1e-3], 20)

    assert shears[:21] == pytest.approx(6e5 * (1.0 - np.exp(-1e9 * places[:21] / 6e5)), rel=1e-6)
    turned = 6e5 + shears[20]  # how far the shear then is from the strength on the other side
    way = 1e-3 - places[21:]
    assert shears[21:] + 6e5 == pytest.approx(turned * np.exp(-1e9 * way / turned), rel=1e-6)


def test_a_small_wave_meets_the_stiffness_of_a_yielding_joint():
    law = Yielding(1e8, 1e6, np.arctan(0.6), np.arctan(0.9), 5e-3)
    times = np.linspace(0.0, 0.3, 1501)

    found = past_yielding(times, lambda t: 1e-6 * np.sin(OMEGA * t), 1e6, law)

    size = np.abs(through_spring(OMEGA, 1e6, 1e8))
    assert np.abs(found[750:]).max() == pytest.approx(1e-6 * size, rel=1e-3)
