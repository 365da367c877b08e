from dataclasses import replace

import numpy as np
import pytest
from obspy.signal import tf_misfit

from pyblast.errors import InputError
from pyblast.signals.comparison import compare
from pyblast.signals.seismogram import Seismogram

DT = 1.0 / 512.0


def burst(times, hz=12.0):
    return np.exp(-(((times - 1.5) / 0.3) ** 2)) * np.cos(2 * np.pi * hz * times)


def record(scales=(1.0, 2.0, 0.5), hz=12.0, delay=0.0, n_samples=2048, dt=DT):
    times = np.arange(n_samples) * dt - delay
    return Seismogram(np.outer(burst(times, hz), scales), dt)


def without(seismogram, component):
    velocity = seismogram.velocity.copy()
    velocity[:, component] = np.nan
    return replace(seismogram, velocity=velocity)


def test_a_record_does_not_differ_from_itself():
    comparison = compare(record(), record())

    assert comparison.misfit == 0.0
    assert comparison.total_waveform_misfit == 0.0
    assert comparison.envelope_misfit == pytest.approx([0, 0, 0], abs=1e-12)
    assert comparison.phase_misfit == pytest.approx([0, 0, 0], abs=1e-12)


def test_the_misfit_is_the_mean_percent_deviation_of_ppv_and_frequency():
    scaled = record(scales=(1.1, 1.8, 0.5))

    assert compare(record(), scaled).misfit == pytest.approx(100.0 * (0.1 + 0.1) / 6.0, rel=1e-9)


def test_a_higher_frequency_shows_in_the_frequency_deviation():
    deviation = compare(record(hz=10.0), record(hz=12.0)).frequency_deviation

    assert deviation == pytest.approx([0.2, 0.2, 0.2], abs=0.01)


def test_a_scale_factor_costs_its_square_in_the_waveform():
    misfit = compare(record(), record(scales=(1.2, 2.4, 0.6))).waveform_misfit

    assert misfit == pytest.approx([0.04, 0.04, 0.04], rel=1e-9)


def test_a_late_simulation_has_a_positive_lag():
    comparison = compare(record(), record(delay=0.0123))

    assert comparison.lag == pytest.approx([0.0123] * 3, abs=1e-4)
    assert np.all(comparison.correlation > 0.995)


def test_envelope_misfit_of_a_scaled_signal_is_the_scale_error():
    comparison = compare(record(), record(scales=(1.1, 2.2, 0.55)), time_frequency=True)

    assert comparison.envelope_misfit == pytest.approx([0.1] * 3, rel=1e-6)
    assert comparison.phase_misfit == pytest.approx([0.0] * 3, abs=1e-9)


def test_time_frequency_misfits_are_those_of_obspy():
    generator = np.random.default_rng(3)
    data, model = generator.normal(size=(2, 400))
    options = {"dt": DT, "fmin": 3.0 / (400 * DT), "fmax": 0.4 / DT, "nf": 40}

    found = compare(*(Seismogram(np.outer(s, [1, 1, 1]), DT) for s in (data, model)))

    assert found.envelope_misfit[0] == pytest.approx(tf_misfit.em(model, data, **options))
    assert found.phase_misfit[0] == pytest.approx(tf_misfit.pm(model, data, **options))


def test_spectral_ratio_of_a_scaled_signal_is_the_scale():
    ratio = compare(record(), record(scales=(1.1, 2.2, 0.55))).spectral_ratio

    assert ratio[~np.isnan(ratio)] == pytest.approx(1.1, rel=1e-9)


def test_duration_deviation_follows_the_length_of_the_motion():
    times = np.arange(2048) * DT
    short, long = (
        Seismogram(np.outer(np.exp(-(((times - 1.5) / w) ** 2)) * np.sin(600 * times), [1] * 3), DT)
        for w in (0.2, 0.3)
    )

    assert compare(short, long).duration_deviation == pytest.approx([0.5] * 3, rel=0.02)


def test_sampling_and_length_of_the_simulation_do_not_matter():
    finer = record(n_samples=9000, dt=DT / 3.3)

    assert compare(record(), finer).total_waveform_misfit < 1e-10


def test_the_simulation_is_at_rest_before_its_start():
    whole = record(n_samples=2048)
    cut = whole.windowed(0.5, 4.0)

    assert compare(whole, cut).total_waveform_misfit < 1e-3


def test_the_band_decides_what_is_compared():
    times = np.arange(2048) * DT
    high = 0.5 * burst(times, hz=150.0)
    noisy = replace(record(), velocity=record().velocity + high[:, None])

    assert compare(record(), noisy, band=(3.0, 30.0)).total_waveform_misfit < 1e-4


@pytest.mark.parametrize("side", ["recorded", "simulated"])
def test_a_missing_component_is_left_out(side):
    recorded, simulated = record(), record(scales=(1.1, 2.0, 9.0))
    if side == "recorded":
        recorded = without(recorded, 2)
    else:
        simulated = without(simulated, 2)

    comparison = compare(recorded, simulated)

    assert comparison.misfit == pytest.approx(100.0 * 0.1 / 4.0, rel=1e-9)
    assert np.isnan(comparison.waveform_misfit[2])


@pytest.mark.parametrize(
    ("simulated", "message"),
    [
        (record().rotated(0.3), "components differ"),
        (record().shifted(99.0), "no common time"),
    ],
)
def test_seismograms_that_cannot_be_compared_are_refused(simulated, message):
    with pytest.raises(InputError, match=message):
        compare(record(), simulated)


def test_a_silent_record_is_refused():
    with pytest.raises(InputError, match="no component with motion"):
        compare(record(scales=(0, 0, 0)), record())
