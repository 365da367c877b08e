import numpy as np
import pytest

from pyblast.errors import InputError
from pyblast.signals.seismogram import Seismogram

DT = 1.0 / 1024.0


def wavelet(times, hz=17.0, centre=2.0, width=0.2):
    return np.exp(-(((times - centre) / width) ** 2)) * np.cos(2 * np.pi * hz * (times - centre))


def record(*columns, dt=DT, start=0.0):
    return Seismogram(np.column_stack(columns), dt, start)


@pytest.fixture
def shot():
    times = np.arange(4096) * DT
    return record(wavelet(times), -2.0 * wavelet(times), np.full(4096, np.nan))


def test_ppv_is_the_largest_absolute_sample_and_keeps_the_mean():
    seismogram = record([0.1, -0.9, 0.3], [1.0, 1.0, 1.0], [0.0, 0.2, 0.0])

    assert seismogram.ppv == pytest.approx([0.9, 1.0, 0.2], rel=1e-15)


def test_pvs_is_taken_at_one_instant():
    seismogram = record([3.0, 0.0], [0.0, 4.0], [0.0, 0.0])

    assert seismogram.pvs == 4.0


def test_a_missing_component_is_ignored_by_the_vector_sum(shot):
    assert np.isnan(shot.ppv[2])
    assert shot.pvs == pytest.approx(np.sqrt(5.0), rel=1e-3)


def test_samples_cannot_be_changed(shot):
    with pytest.raises(ValueError, match="read-only"):
        shot.velocity[0, 0] = 1.0


@pytest.mark.parametrize(
    ("velocity", "dt", "message"),
    [
        (np.zeros((5, 2)), DT, r"shape \(n_samples, 3\)"),
        (np.zeros((1, 3)), DT, "at least 2 samples"),
        (np.zeros((5, 3)), 0.0, "dt: must be positive"),
        (np.zeros((5, 3)), np.nan, "dt: must be positive"),
        (np.full((5, 3), np.nan), DT, "every component is missing"),
        ([[0, 0, 0], [0, np.inf, 0]], DT, "component north must be finite.*sample 1"),
        ([[0, 0, 0], [0, 0, np.nan]], DT, "component vertical must be finite"),
    ],
)
def test_bad_samples_are_refused_with_the_rule(velocity, dt, message):
    with pytest.raises(InputError, match=message):
        Seismogram(velocity, dt)


@pytest.mark.parametrize("dt", [1 / 4096, 1 / 1000, 1 / 150, 0.00313])
def test_resampling_is_exact_below_the_lower_nyquist_frequency(shot, dt):
    resampled = shot.resampled(dt)

    assert np.abs(resampled.velocity[:, 0] - wavelet(resampled.times)).max() < 1e-8


def test_resampling_lets_no_alias_through():
    times = np.arange(4096) * DT
    high = record(*[wavelet(times, hz=180.0)] * 3)

    assert high.resampled(1 / 200).ppv.max() < 1e-6


def test_resampling_keeps_a_constant_offset():
    flat = record(*[np.full(300, 0.25)] * 3)

    assert flat.resampled(1 / 333).velocity == pytest.approx(0.25, abs=1e-12)


def test_motion_sampled_outside_the_record_is_zero(shot):
    longer = shot.sampled(-1.0, DT, 7000)

    outside = (longer.times < 0.0) | (longer.times > shot.duration)
    assert np.all(longer.velocity[outside, :2] == 0.0)


def test_low_pass_shifts_no_phase_and_halves_the_amplitude_at_its_corner():
    times = np.arange(8192) * DT
    tone = np.sin(2 * np.pi * 20.0 * times)
    passed = record(tone, tone, tone).lowpassed(20.0)

    middle = slice(3000, 5000)
    assert passed.velocity[middle, 0] == pytest.approx(0.5 * tone[middle], abs=2e-3)


def test_band_pass_removes_offset_and_tone_outside():
    times = np.arange(8192) * DT
    signal = 1.0 + np.sin(2 * np.pi * 10.0 * times) + np.sin(2 * np.pi * 120.0 * times)
    passed = record(signal, signal, signal).bandpassed(3.0, 30.0)

    middle = slice(3000, 5000)
    expected = np.sin(2 * np.pi * 10.0 * times)[middle]
    assert passed.velocity[middle, 0] == pytest.approx(expected, abs=0.01)


@pytest.mark.parametrize("hz", [0.0, -1.0, 512.0, np.nan])
def test_a_corner_outside_the_band_is_refused(shot, hz):
    with pytest.raises(InputError, match="Nyquist"):
        shot.lowpassed(hz)


def test_rotation_turns_motion_towards_the_azimuth_into_the_longitudinal():
    azimuth = np.radians(30.0)
    seismogram = record([0.0, np.sin(azimuth)], [0.0, np.cos(azimuth)], [0.0, 0.5])

    assert seismogram.rotated(azimuth).ppv == pytest.approx([1.0, 0.0, 0.5], abs=1e-15)


def test_rotation_is_its_own_inverse(shot):
    back = shot.rotated(0.7).rotated(0.7)

    assert back.components == shot.components
    assert back.velocity == pytest.approx(shot.velocity, abs=1e-14, nan_ok=True)


def test_a_window_keeps_both_ends(shot):
    window = shot.windowed(1.0, 2.0)

    assert window.start == 1.0
    assert len(window.velocity) == 1025


def test_a_window_beside_the_record_is_refused(shot):
    with pytest.raises(InputError, match="fewer than 2 samples"):
        shot.windowed(9.0, 10.0)


def test_a_shift_moves_the_times_only(shot):
    assert shot.shifted(0.3).times == pytest.approx(shot.times + 0.3)
