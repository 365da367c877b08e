"""The closed forms of fading that cases are judged by, against checks of their own."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from verification.solutions.attenuation import (
    constant_q_modulus,
    damped_oscillator,
    discrete_wave_number,
    maxwell_modulus,
    quality,
    wave_number,
)

FREQUENCY = np.geomspace(1.0, 100.0, 30)


def test_constant_q_has_its_quality_everywhere_and_its_speed_at_the_reference():
    modulus = constant_q_modulus(20.0, FREQUENCY, 10.0)
    number = wave_number(modulus, 1.0, FREQUENCY)
    (middle,) = wave_number(constant_q_modulus(20.0, np.array([10.0]), 10.0), 1.0, [10.0])

    assert quality(number, FREQUENCY) == pytest.approx(np.full(30, 20.0), rel=1e-12)
    assert (number.imag > 0.0).all()
    assert 20.0 * np.pi / middle.real == pytest.approx(1.0, rel=1e-12)


def test_a_maxwell_body_is_the_transform_of_its_fading_springs():
    rates, shares, omega = np.array([20.0, 300.0]), np.array([0.1, 0.2]), 2.0 * np.pi * 7.0

    (found,) = maxwell_modulus(rates, shares, np.array([7.0]))

    # strain e^(-i w t) from rest: zeta' = rate (strain - zeta), after all transients
    def slope(time, memory):
        return rates * (np.exp(-1j * omega * time) - memory)

    end = solve_ivp(slope, (0.0, 1.0), np.zeros(2, dtype=complex), rtol=1e-9, atol=1e-11).y[:, -1]
    assert found == pytest.approx(1.0 - shares @ end * np.exp(1j * omega), rel=1e-6)


def test_the_discrete_column_converges_to_the_wave_with_second_order():
    def body(frequency):
        return maxwell_modulus(np.array([60.0]), np.array([0.1]), np.atleast_1d(frequency))

    exact = wave_number(body(10.0), 1.0, 10.0)
    errors = [
        abs(discrete_wave_number(body, 1.0, 10.0, h, 0.5 * h) - exact)[0] for h in (0.004, 0.002)
    ]

    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.05)


def test_an_oscillator_behind_a_filter_beyond_all_frequencies_is_damped_as_rayleigh():
    omega, alpha, beta = 2.0 * np.pi * 8.0, 0.6, 4e-4

    ratio, natural = damped_oscillator(omega, alpha, beta, 1e7)

    assert ratio == pytest.approx(0.5 * (alpha / omega + beta * omega), rel=1e-5)
    assert natural == pytest.approx(omega, rel=1e-5)


def test_the_filtered_oscillator_moves_as_its_root():
    omega, alpha, beta, corner = 50.0, 0.6, 2e-3, 30.0
    rate = 2.0 * np.pi * corner
    ratio, natural = damped_oscillator(omega, alpha, beta, corner)

    def slope(_, state):
        place, speed, memory = state
        force = omega**2 * (place + beta * rate * (place - memory))
        return [speed, -alpha * speed - force, rate * (place - memory)]

    times = np.linspace(0.3, 0.9, 4001)
    limits = {"rtol": 1e-10, "atol": 1e-13}
    motion = solve_ivp(slope, (0.0, 0.9), [1.0, 0.0, 1.0], t_eval=times, **limits).y[0]
    turn = natural * np.sqrt(1.0 - ratio**2) * times
    waves = np.exp(-ratio * natural * times) * np.array([np.cos(turn), np.sin(turn)])
    weights = np.linalg.lstsq(waves.T, motion, rcond=None)[0]
    assert weights @ waves == pytest.approx(motion, abs=1e-6 * np.abs(motion).max())
