"""Oscillators and their spectra: closed forms, and nonsense that is refused."""

import numpy as np
import pytest

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
