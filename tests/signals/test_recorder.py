"""Operators of the recorder: known responses, nothing gained, refused nonsense."""

import numpy as np
import pytest

from pyblast.errors import InputError
from pyblast.signals import recorder
from pyblast.signals.seismogram import Seismogram

DT = 1e-3
TIMES = DT * np.arange(4000)


def wave(frequency, amplitude=1.0):
    envelope = np.exp(-(((TIMES - 2.0) / 0.5) ** 2))
    motion = amplitude * envelope * np.sin(2.0 * np.pi * frequency * (TIMES - 2.0))
    return Seismogram(np.stack([motion, 0.5 * motion, -motion], axis=1), DT)


def ratio(seismogram, other, frequency):
    turn = np.exp(-2j * np.pi * frequency * TIMES)
    return (turn @ seismogram.velocity[:, 0]) / (turn @ other.velocity[:, 0])


@pytest.mark.parametrize("damping", [0.5, 0.7])
def test_at_its_corner_a_geophone_leads_by_a_quarter_and_divides_by_twice_its_damping(damping):
    motion = wave(4.5)

    heard = recorder.geophone_response(4.5, damping)(motion)

    assert ratio(heard, motion, 4.5) == pytest.approx(0.5j / damping, rel=1e-3)


def test_far_above_its_corner_a_geophone_writes_the_velocity():
    motion = wave(60.0)

    assert recorder.geophone_response(1.0)(motion).velocity == pytest.approx(
        motion.velocity, abs=0.03
    )


def test_at_its_resonance_a_sensor_rocks():
    motion = wave(30.0)

    assert abs(ratio(recorder.coupling(30.0, 0.1)(motion), motion, 30.0)) == pytest.approx(
        np.hypot(1.0, 0.2) / 0.2, rel=2e-2
    )


def test_an_orientation_keeps_energy_and_is_undone_by_its_opposite():
    motion = wave(10.0)
    askew = recorder.orientation(0.4)(motion)

    assert np.sum(askew.velocity**2) == pytest.approx(np.sum(motion.velocity**2))
    assert recorder.orientation(-0.4)(askew).velocity == pytest.approx(motion.velocity)


def test_a_sensor_turned_clockwise_by_a_quarter_writes_south_as_its_east():
    motion = Seismogram(np.tile([1.0, 0.0, 0.0], (10, 1)), DT)
    north = Seismogram(np.tile([0.0, 1.0, 0.0], (10, 1)), DT)

    turn = recorder.orientation(0.5 * np.pi)

    assert turn(north).velocity[0] == pytest.approx([-1.0, 0.0, 0.0], abs=1e-12)
    assert turn(motion).velocity[0] == pytest.approx([0.0, 1.0, 0.0], abs=1e-12)


@pytest.mark.parametrize("shift", [0.0037, 0.05])
def test_a_late_clock_delays_by_fractions_of_a_sample(shift):
    late = recorder.clock(shift)(wave(10.0))

    wanted = np.interp(TIMES - shift, TIMES, wave(10.0).velocity[:, 0])
    assert late.velocity[:, 0] == pytest.approx(wanted, abs=2e-3)  # of linear interpolation


def test_a_drifting_clock_stretches_time():
    slow = recorder.clock(0.0, 1e-2)(wave(10.0))

    peak = TIMES[np.argmax(slow.velocity[:, 0])]
    before = TIMES[np.argmax(wave(10.0).velocity[:, 0])]
    assert peak == pytest.approx(1.01 * before, abs=2e-3)


def test_clipping_ends_at_full_scale():
    clipped = recorder.clipping(0.3)(wave(10.0))

    assert np.abs(clipped.velocity).max() == 0.3


def test_a_step_of_acceleration_dies_with_the_geophone():
    quiet = Seismogram(np.zeros((4000, 3)), DT)

    heard = recorder.step(1.0, 0.01, 1.0)(quiet).velocity[:, 2]

    ramp = np.zeros((4000, 3))
    ramp[:, 2] = 0.01 * np.maximum(TIMES - 1.0, 0.0) * (TIMES < 3.9)
    wanted = recorder.geophone_response(1.0)(Seismogram(ramp, DT)).velocity[:, 2]
    early = TIMES < 3.5
    assert heard[early] == pytest.approx(wanted[early], abs=0.01 * np.abs(heard).max())


def test_a_chain_is_applied_from_the_ground_up():
    motion = wave(10.0)

    heard = recorder.recorded(motion, [recorder.gain(10.0), recorder.clipping(0.2)])

    assert np.abs(heard.velocity).max() == 0.2


def test_polarity_is_a_gain_of_its_own():
    heard = recorder.gain([1.0, -1.0, 1.0])(wave(10.0))

    assert (heard.velocity * [1, -1, 1]).tolist() == wave(10.0).velocity.tolist()


def test_an_anti_alias_filter_above_half_the_sampling_does_nothing():
    assert recorder.anti_alias(600.0)(wave(10.0)).velocity.tolist() == wave(10.0).velocity.tolist()


@pytest.mark.parametrize(
    "make", [recorder.geophone_response, recorder.clipping, recorder.anti_alias]
)
def test_nonsense_is_refused(make):
    with pytest.raises(InputError, match=r"recorder\..* must be positive"):
        make(-1.0)


@pytest.mark.parametrize("damping", [0.0, 0.05, 0.7])
def test_an_oscillator_follows_a_step_of_acceleration_exactly(damping):
    natural, steps = 2.0 * np.pi * 7.0, 900
    after = DT * np.arange(steps + 1)
    turn, drag = natural * np.sqrt(1.0 - damping**2), damping * natural
    wave = np.exp(-drag * after) * (np.cos(turn * after) + drag / turn * np.sin(turn * after))

    moved, speed = recorder.oscillator(np.full(steps, 3.0), DT, 7.0, damping)

    np.testing.assert_allclose(moved, -3.0 / natural**2 * (1.0 - wave), atol=1e-14)
    np.testing.assert_allclose(
        speed, -3.0 / turn * np.exp(-drag * after) * np.sin(turn * after), atol=1e-13
    )


def test_stiff_oscillators_feel_the_acceleration_and_soft_ones_the_displacement_of_the_ground():
    motion = wave(10.0)
    ground = np.abs(np.cumsum(motion.velocity, axis=0) * DT).max(axis=0)
    largest = np.abs(np.diff(motion.velocity, axis=0) / DT).max(axis=0)

    spectra = recorder.response_spectra(motion, [0.02, 400.0], damping=0.05)

    np.testing.assert_allclose(spectra.sd[0], ground, rtol=0.02)
    np.testing.assert_allclose(spectra.sa[1], largest, rtol=0.02)


@pytest.mark.parametrize("damping", [0.05, 0.1])
def test_at_resonance_a_long_wave_is_amplified_by_half_over_the_damping(damping):
    motion = np.sin(2.0 * np.pi * 10.0 * TIMES)
    steady = Seismogram(np.stack([motion] * 3, axis=1), DT)

    spectra = recorder.response_spectra(steady, [10.0], damping)

    assert spectra.psv[0, 0] == pytest.approx(1.0 / (2.0 * damping), rel=0.01)


def test_missing_components_have_no_spectra_and_nonsense_is_refused():
    motion = wave(10.0)
    alone = Seismogram(motion.velocity * [1.0, np.nan, 1.0], DT)

    assert np.isnan(recorder.response_spectra(alone, [5.0]).sd[0]).tolist() == [False, True, False]
    with pytest.raises(InputError, match="frequency: must be positive"):
        recorder.response_spectra(motion, [0.0])
    with pytest.raises(InputError, match="damping: must lie from 0 to below 1, got 1"):
        recorder.response_spectra(motion, [5.0], 1.0)
