"""One linear joint at normal incidence: physics rung 5, and energy split between its two sides."""

from functools import cache

import numpy as np
import pytest

from pyblast.solving.joints import Joint
from verification.columns import IMPEDANCE, SPEED, column, driven, order, spectrum

FREQUENCY = 20.0
BAND = np.array([8.0, 13.0, 20.0])
OMEGA = 2.0 * np.pi * BAND
SOFTNESS = (0.1, 0.3, 1.0)  # k / (z omega) at 20 Hz
WAVES = pytest.mark.parametrize("wave", ["P", "S"])


def grid(wave, n):
    edge = SPEED[wave] / FREQUENCY / n
    return edge, 8 * n, 3 * n * edge, 4 * n * edge


def stiffness(wave, softness):
    return softness * IMPEDANCE[wave] * 2.0 * np.pi * FREQUENCY


@cache
def intact(wave, n):
    edge, length, _, behind = grid(wave, n)
    motion, _ = driven(column(length, edge), wave, FREQUENCY, 0.45, [behind])
    return spectrum(*motion[behind], BAND)


@cache
def transmission(wave, n, softness, normal_over_shear=1.0):
    """Return the transmission at `BAND`, complex, with the sign convention of the FFT."""
    edge, length, joint, behind = grid(wave, n)
    k = stiffness(wave, softness)
    kn, ks = (k, k / normal_over_shear) if wave == "P" else (k * normal_over_shear, k)
    law = Joint("J", "elastic", {"kn": kn, "ks": ks})
    mesh = column(length, edge, {"J": ("x", joint)})
    motion, _ = driven(mesh, wave, FREQUENCY, 0.45, [behind], joints=[law])
    return spectrum(*motion[behind], BAND) / intact(wave, n)


def closed_form(wave, softness):
    return 1.0 / (1.0 + 0.5j * OMEGA * IMPEDANCE[wave] / stiffness(wave, softness))


@WAVES
@pytest.mark.parametrize("softness", SOFTNESS)
@pytest.mark.parametrize(("n", "tolerance"), [(10, 0.055), (20, 0.0125)])
def test_the_amplitude_behind_a_joint_is_the_closed_form(wave, softness, n, tolerance):
    found = np.abs(transmission(wave, n, softness))

    assert found == pytest.approx(np.abs(closed_form(wave, softness)), rel=tolerance)


@WAVES
@pytest.mark.parametrize("softness", SOFTNESS)
def test_the_amplitude_error_is_that_of_the_discrete_impedance(wave, softness):
    half = np.pi * BAND / FREQUENCY / 10.0
    ratio = OMEGA * IMPEDANCE[wave] * np.cos(half) / stiffness(wave, softness)

    found = np.abs(transmission(wave, 10, softness))

    assert found == pytest.approx(1.0 / np.sqrt(1.0 + 0.25 * ratio**2), rel=4e-3)


@WAVES
def test_the_amplitude_converges_with_second_order(wave):
    meshes, wanted = [10, 15, 22], np.abs(closed_form(wave, 0.3))
    errors = [np.abs(np.abs(transmission(wave, n, 0.3)) - wanted).max() for n in meshes]

    assert order(errors, 1.0 / np.array(meshes)) >= 1.8


@WAVES
def test_the_delay_behind_a_joint_is_the_closed_form(wave):
    found = -np.angle(transmission(wave, 20, 1.0))

    assert found == pytest.approx(-np.angle(closed_form(wave, 1.0)), rel=0.02)


@WAVES
def test_each_wave_feels_only_its_own_spring(wave):
    one = transmission(wave, 10, 0.3)
    other = transmission(wave, 10, 0.3, normal_over_shear=4.0)

    assert other == pytest.approx(one, rel=1e-3)
