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
