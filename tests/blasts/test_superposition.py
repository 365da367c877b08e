import numpy as np
import pytest

from pyblast.blasts.blast import Blast, Firing
from pyblast.blasts.signature import superpose, travel_shifts
from pyblast.errors import InputError
from pyblast.signals.seismogram import Seismogram

DT = 1.0 / 1024.0


@pytest.fixture
def generator():
    return np.random.default_rng(7)


@pytest.fixture
def noise(generator):
    return Seismogram(generator.normal(size=(300, 3)), DT, start=-0.05)


def wavelet(times, centre=1.0):
    return np.exp(-(((times - centre) / 0.1) ** 2)) * np.cos(2 * np.pi * 20.0 * (times - centre))


def smooth(scale=1.0):
    times = np.arange(2048) * DT
    return Seismogram(scale * np.column_stack([wavelet(times)] * 3), DT)


def difference(first, second):
    assert first.start == pytest.approx(second.start, abs=1e-12)
    return np.abs(first.velocity - second.velocity).max() / first.ppv.max()


def test_one_hole_at_zero_gives_the_signature_back(noise):
    assert difference(superpose(noise, Firing([0.0], [1.0])), noise) < 1e-14


@pytest.mark.parametrize("seed", range(3))
def test_both_methods_agree_for_any_fraction_of_a_sample(noise, seed):
    generator = np.random.default_rng(seed)
    firing = Firing(generator.uniform(-0.05, 0.3, 9), generator.normal(size=9))

    fast, slow = superpose(noise, firing), superpose(noise, firing, method="direct")

    assert difference(fast, slow) < 1e-12


def test_whole_delays_are_plain_shift_and_add(noise):
    expected = np.zeros((300 + 77, 3))
    for shift, scale in ((0, 1.0), (40, -0.5), (77, 2.0)):
        expected[shift : shift + 300] += scale * noise.velocity

    summed = superpose(noise, Firing(np.array([0, 40, 77]) * DT, [1.0, -0.5, 2.0]))

    assert np.abs(summed.velocity - expected).max() < 1e-12 * np.abs(expected).max()


def test_a_fractional_delay_moves_a_smooth_wave_exactly():
    moved = superpose(smooth(), Firing([0.0317], [1.0]))

    assert moved.velocity[:, 0] == pytest.approx(wavelet(moved.times - 0.0317), abs=1e-12)


def test_superposition_is_linear_in_the_scales(noise):
    times = [0.0, 0.0313, 0.0871]
    parts = [superpose(noise, Firing(times, s)).velocity for s in ([1, 2, 0], [0, 1, 3])]

    assert superpose(noise, Firing(times, [1, 3, 3])).velocity == pytest.approx(sum(parts))


def test_delaying_every_hole_delays_the_sum(noise):
    early = superpose(noise, Firing([0.0, 0.0313], [1.0, 1.0]))
    late = superpose(noise, Firing([25 * DT, 25 * DT + 0.0313], [1.0, 1.0]))

    assert difference(early.shifted(25 * DT), late) < 1e-12


def test_own_signatures_replace_the_common_one():
    firing = Firing([0.0, 0.0313], [1.0, 1.0])
    own = superpose(smooth(), firing, signatures=[None, smooth(3.0)])

    assert own.velocity == pytest.approx(superpose(smooth(), Firing(firing.times, [1, 3])).velocity)


def test_own_signatures_agree_between_methods(generator):
    own = [Seismogram(generator.normal(size=(n, 3)), DT, start=n * 1e-4) for n in (50, 80, 30)]
    firing = Firing([0.0, 0.0123, 0.02], [1.0, 0.3, 2.0])

    sums = [superpose(own[0], firing, signatures=own, method=m) for m in ("fft", "direct")]

    assert difference(*sums) < 1e-12


def test_negative_total_delays_start_the_sum_earlier(noise):
    early = superpose(noise, Firing([0.0], [1.0]), travel_shifts=[-10 * DT])

    assert difference(early, noise.shifted(-10 * DT)) < 1e-12


def test_a_missing_component_stays_missing():
    signature = Seismogram(np.column_stack([np.ones(9), np.zeros(9), np.full(9, np.nan)]), DT)

    assert np.isnan(superpose(signature, Firing.rows(2, 2, 0.01)).ppv[2])


def test_the_spectrum_of_a_blast_is_signature_times_comb(noise):
    firing = Firing.rows(4, 15, 0.040)
    summed = superpose(noise, firing)

    n_padded = 4096
    frequency = np.fft.rfftfreq(n_padded, DT)
    single, blast = (np.abs(np.fft.rfft(s.velocity[:, 0], n_padded)) for s in (noise, summed))
    low = frequency < 200.0
    expected = 60.0 * firing.comb_spectrum(frequency) * single
    assert blast[low] == pytest.approx(expected[low], abs=0.01 * blast.max())


def test_travel_shifts_are_path_differences_over_speed():
    blast = Blast("b", [[0, 0, 0], [0, 10, 0]], [[0, 0, 0], [0, 10, 0]], 1.0, 0.0)

    shifts = travel_shifts(blast, (0, 100, 0), 2000.0, reference=(0, 0, 0))

    assert shifts == pytest.approx([0.0, -0.005], abs=1e-15)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"method": "magic"}, "method"),
        ({"signatures": []}, "0 given for 1 holes"),
        ({"signatures": [Seismogram(np.ones((5, 3)), 0.5)]}, "resample or rotate"),
        ({"travel_shifts": [0.0, 1.0]}, "need 1 finite values"),
        ({"travel_shifts": [np.nan]}, "need 1 finite values"),
    ],
)
def test_bad_options_are_refused(noise, options, message):
    with pytest.raises(InputError, match=message):
        superpose(noise, Firing([0.0], [1.0]), **options)
