import math

import numpy as np
import pytest

from pyblast.errors import InputError
from pyblast.signals.seismogram import Seismogram
from pyblast.signals.spectra import (
    amplitude_spectrum,
    dominant_frequency,
    late_energy,
    lowpass,
    multitaper_spectrum,
    significant_duration,
    smoothed_spectrum,
    zero_crossing_frequency,
)

DT = 1.0 / 1024.0
TIMES = np.arange(4096) * DT


def record(column):
    return Seismogram(np.column_stack([column, np.zeros_like(column), np.nan * column]), DT)


def damped_sine(hz, decay):
    return np.exp(-decay * TIMES) * np.sin(2 * np.pi * hz * TIMES)


def test_amplitude_spectrum_keeps_the_energy():
    noise = record(np.random.default_rng(1).normal(size=4096))
    spectrum = amplitude_spectrum(noise)

    weight = np.full(len(spectrum.frequency), 2.0)
    weight[[0, -1]] = 1.0
    energy = np.sum(weight * spectrum.amplitude[:, 0] ** 2) * spectrum.frequency[1]
    assert energy == pytest.approx(np.sum(noise.velocity[:, 0] ** 2) * DT, rel=1e-12)


def test_amplitude_spectrum_of_a_damped_sine_is_its_closed_form():
    spectrum = amplitude_spectrum(record(damped_sine(14.0, 6.0)))

    omega, own = 2 * np.pi * spectrum.frequency, 2 * np.pi * 14.0
    exact = own / np.abs((6.0 + 1j * omega) ** 2 + own**2)
    low = spectrum.frequency < 60.0
    assert spectrum.amplitude[low, 0] == pytest.approx(exact[low], rel=2e-3, abs=1e-5)


def test_smoothing_leaves_a_flat_spectrum_flat():
    impulse = np.zeros(4096)
    impulse[2048] = 1.0
    spectrum = smoothed_spectrum(record(impulse))

    above = spectrum.frequency > 5.0
    assert spectrum.amplitude[above, 0] == pytest.approx(DT, rel=0.01)


def test_smoothed_spectrum_has_no_stairs_at_a_few_cycles_per_record():
    times = np.arange(1500) * 0.001
    column = np.exp(-(((times - 0.7) / 0.15) ** 2)) * np.sin(2 * np.pi * 2.0 * (times - 0.7))
    spectrum = smoothed_spectrum(Seismogram(np.column_stack(3 * [column]), 0.001))

    low = spectrum.frequency < 1.8
    slope = np.diff(np.log(spectrum.amplitude[low, 0])) / np.diff(np.log(spectrum.frequency[low]))
    assert np.abs(np.diff(slope)).max() < 0.05  # 9.9 when padded to twice the length


def test_multitaper_level_is_that_of_the_amplitude_spectrum_for_noise():
    noise = record(np.random.default_rng(2).normal(size=4096))
    plain, tapered = amplitude_spectrum(noise), multitaper_spectrum(noise)

    power = [np.mean(s.amplitude[50:-50, 0] ** 2) for s in (plain, tapered)]
    assert power[1] == pytest.approx(power[0], rel=0.05)


@pytest.mark.parametrize(
    ("method", "tolerance"), [("smoothed", 0.01), ("multitaper", 0.01), ("raw", 0.005)]
)
def test_dominant_frequency_of_a_damped_sine(method, tolerance):
    found = dominant_frequency(record(damped_sine(14.1, 3.0)), method)

    assert found.hz[0] == pytest.approx(14.1, rel=tolerance)


def test_dominant_frequency_names_its_definition():
    found = dominant_frequency(record(damped_sine(14.1, 3.0)))

    smoothed = "peak of the Konno-Ohmachi smoothed spectrum, b = 40"
    assert found.definition == f"{smoothed}, zero-padded 16 times"


def test_dominant_frequency_looks_only_into_the_band():
    both = record(damped_sine(8.0, 3.0) + 0.5 * damped_sine(40.0, 3.0))

    assert dominant_frequency(both, band=(25.0, 100.0)).hz[0] == pytest.approx(40.0, rel=0.02)


def test_a_silent_and_a_missing_component_have_no_frequency():
    assert np.isnan(dominant_frequency(record(damped_sine(8.0, 3.0))).hz[1:]).all()


def test_dominant_frequency_refuses_an_unknown_definition():
    with pytest.raises(InputError, match="one of smoothed, multitaper, raw"):
        dominant_frequency(record(damped_sine(8.0, 3.0)), "fft")


def test_dominant_frequency_does_not_see_a_constant_offset():
    shifted = record(damped_sine(14.1, 3.0) + 0.5)

    assert dominant_frequency(shifted).hz[0] == pytest.approx(14.1, rel=0.02)


@pytest.mark.parametrize("hz", [5.0, 14.1, 54.6])
def test_zero_crossing_frequency_of_a_damped_sine(hz):
    column = np.concatenate([np.zeros(10), damped_sine(hz, 3.0)[:-10]])

    found = zero_crossing_frequency(record(column))

    assert found.hz[0] == pytest.approx(hz, rel=0.01)


def test_zero_crossing_frequency_belongs_to_the_peak_not_to_the_record():
    burst = 2.0 * np.exp(-(((TIMES - 2.0) / 0.02) ** 2)) * np.cos(2 * np.pi * 50.0 * (TIMES - 2.0))
    column = damped_sine(5.0, 0.1) + burst

    assert zero_crossing_frequency(record(column)).hz[0] > 25.0


def test_motion_that_never_returns_has_no_zero_crossing_frequency():
    assert np.isnan(zero_crossing_frequency(record(TIMES + 1.0)).hz[0])


def test_significant_duration_of_constant_power_is_nine_tenths():
    duration = significant_duration(record(np.ones(4096)))

    assert duration[0] == pytest.approx(0.9 * 4096 * DT, rel=1e-12)


def test_significant_duration_of_an_exponential_is_its_closed_form():
    duration = significant_duration(record(np.exp(-3.0 * TIMES)))

    assert duration[0] == pytest.approx(np.log(0.95 / 0.05) / 6.0, rel=2e-3)


def test_late_energy_of_an_exponential_is_its_closed_form():
    share = late_energy(record(np.exp(-1.5 * TIMES)))

    wanted = (np.exp(-3.0) - np.exp(-12.0)) / (1.0 - np.exp(-12.0))
    assert share[0] == pytest.approx(wanted, rel=5e-3)
    assert np.isnan(share[1:]).all()  # silent, and missing
    assert np.isnan(late_energy(record(np.ones(4096)), after=5.0)).all()  # beyond the record


def test_low_pass_says_what_it_removed():
    low = np.exp(-(((TIMES - 2.0) / 0.3) ** 2)) * np.cos(2 * np.pi * 2.0 * TIMES)
    high = 0.5 * np.exp(-(((TIMES - 2.0) / 0.3) ** 2)) * np.cos(2 * np.pi * 100.0 * TIMES)
    passed = lowpass(record(low + high))

    assert passed.removed_energy[0] == pytest.approx(0.2, rel=0.03)
    assert passed.ppv_change[0] == pytest.approx(-1.0 / 3.0, rel=0.02)


@pytest.mark.parametrize("corner", [5.0, 30.0])
def test_a_causal_low_pass_begins_a_third_of_a_cycle_before_and_delays_nothing(corner):
    impulse = np.zeros_like(TIMES)
    impulse[200] = 1.0

    moved = record(impulse).lowpassed(corner, of_source=True)
    passed = moved.velocity[:, 0]

    spectrum = np.abs(np.fft.rfft(passed))
    frequency = np.fft.rfftfreq(len(passed), DT)
    centroid = float((moved.times - TIMES[200]) @ passed / passed.sum())
    assert not passed[:200].any()
    assert moved.start - TIMES[0] == pytest.approx(-2.114 / (2.0 * math.pi * corner), rel=0.05)
    assert np.interp(corner, frequency, spectrum) == pytest.approx(math.sqrt(0.5), rel=1e-3)
    assert abs(centroid * corner) < 1e-6
    assert np.cumsum(passed).max() < 1.01  # a step overshoots by less than 1 %
