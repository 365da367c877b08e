"""Oscillators and their spectra: closed forms, and nonsense that is refused."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from pyblast.errors import InputError
from pyblast.signals.response_spectra import oscillator, response_spectra
from pyblast.signals.seismogram import Seismogram

DT = 1e-3
TIMES = DT * np.arange(4000)


def wave(frequency, amplitude=1.0):
    envelope = np.exp(-(((TIMES - 2.0) / 0.5) ** 2))
    motion = amplitude * envelope * np.sin(2.0 * np.pi * frequency * (TIMES - 2.0))
    return Seismogram(np.stack([motion, 0.5 * motion, -motion], axis=1), DT)


@pytest.mark.parametrize("damping", [0.0, 0.05, 0.7])
def test_an_oscillator_follows_a_step_of_acceleration_exactly(damping):
    natural, steps = 2.0 * np.pi * 7.0, 900
    after = DT * np.arange(steps + 1)
    turn, drag = natural * np.sqrt(1.0 - damping**2), damping * natural
    wave = np.exp(-drag * after) * (np.cos(turn * after) + drag / turn * np.sin(turn * after))

    moved, speed = oscillator(np.full(steps, 3.0), DT, 7.0, damping)

    np.testing.assert_allclose(moved, -3.0 / natural**2 * (1.0 - wave), atol=1e-14)
    np.testing.assert_allclose(
        speed, -3.0 / turn * np.exp(-drag * after) * np.sin(turn * after), atol=1e-13
    )


def test_absolute_acceleration_is_that_of_an_integrated_equation_of_motion():
    motion, damping, natural = wave(6.0), 0.4, 2.0 * np.pi * 9.0
    slope = np.diff(motion.velocity[:, 0]) / DT

    def moves(time, state):
        ground = slope[min(int(time / DT), len(slope) - 1)] if time < TIMES[-1] else 0.0
        return state[1], -ground - 2.0 * damping * natural * state[1] - natural**2 * state[0]

    found = solve_ivp(moves, (1.0, 3.0), (0.0, 0.0), max_step=DT, rtol=1e-8, atol=1e-12)

    absolute = np.abs(2.0 * damping * natural * found.y[1] + natural**2 * found.y[0]).max()
    assert response_spectra(motion, [9.0], damping).sa[0, 0] == pytest.approx(absolute, rel=5e-3)


def test_few_samples_a_period_lose_no_peak():
    coarse = Seismogram(wave(6.0).velocity[::40], 40.0 * DT)
    at = np.arange(40 * (len(coarse.velocity) - 1) + 1) * DT
    fine = np.transpose([np.interp(at, coarse.times, each) for each in coarse.velocity.T])

    few, many = (response_spectra(each, [11.0], 0.02) for each in (coarse, Seismogram(fine, DT)))

    assert few.sd == pytest.approx(many.sd, rel=0.012)


def test_an_oscillator_swings_on_after_the_record():
    velocity = np.zeros((100, 3))
    velocity[-1] = 1.0

    spectra = response_spectra(Seismogram(velocity, DT), [5.0], damping=0.0)

    assert spectra.psv[0] == pytest.approx([1.0, 1.0, 1.0], rel=0.01)


def test_stiff_oscillators_feel_the_acceleration_and_soft_ones_the_displacement_of_the_ground():
    motion = wave(10.0)
    ground = np.abs(np.cumsum(motion.velocity, axis=0) * DT).max(axis=0)
    largest = np.abs(np.diff(motion.velocity, axis=0) / DT).max(axis=0)

    spectra = response_spectra(motion, [0.02, 400.0], damping=0.05)

    np.testing.assert_allclose(spectra.sd[0], ground, rtol=0.02)
    np.testing.assert_allclose(spectra.sa[1], largest, rtol=0.02)


@pytest.mark.parametrize("damping", [0.05, 0.1])
def test_at_resonance_a_long_wave_is_amplified_by_half_over_the_damping(damping):
    motion = np.sin(2.0 * np.pi * 10.0 * TIMES)
    steady = Seismogram(np.stack([motion] * 3, axis=1), DT)

    spectra = response_spectra(steady, [10.0], damping)

    assert spectra.psv[0, 0] == pytest.approx(1.0 / (2.0 * damping), rel=0.01)


def test_missing_components_have_no_spectra_and_nonsense_is_refused():
    motion = wave(10.0)
    alone = Seismogram(motion.velocity * [1.0, np.nan, 1.0], DT)

    assert np.isnan(response_spectra(alone, [5.0]).sd[0]).tolist() == [False, True, False]
    with pytest.raises(InputError, match="frequency: must be positive"):
        response_spectra(motion, [0.0])
    with pytest.raises(InputError, match="damping: must lie from 0 to below 1, got 1"):
        response_spectra(motion, [5.0], 1.0)
