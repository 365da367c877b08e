"""Coherence, variance between blasts and receivers, repeatability, influence: answers known."""

import numpy as np
import pytest
from scipy import fft

from pyblast.errors import InputError
from pyblast.residuals.coherence import delay_and_fading, transfer
from pyblast.residuals.influence import influence
from pyblast.residuals.repeatability import aligned, repeatability, without_firing
from pyblast.residuals.variance import analyse_variance

DT, N, BAND = 2e-3, 500, (3.0, 30.0)
FREQUENCY = fft.rfftfreq(4 * N, DT)


def motions(rng, *shape):
    """Random motion that fills the window, between 2 and 60 Hz."""
    spectrum = rng.normal(size=(*shape, len(FREQUENCY), 2)) @ [1.0, 1.0j]
    spectrum *= (FREQUENCY > 2.0) & (FREQUENCY < 60.0)
    return spectrum


def in_time(spectrum):
    return fft.irfft(spectrum, 4 * N, axis=-1)[..., N : 2 * N]


def test_a_filtered_simulation_is_wholly_coherent():
    motion = in_time(motions(np.random.default_rng(1)))

    found = transfer(-1.7 * motion, motion, DT, BAND)

    assert found.coherence == pytest.approx(np.ones_like(found.coherence))
    assert found.transfer == pytest.approx(np.full(found.transfer.shape, -1.7), rel=1e-4)


def test_unrelated_motions_pass_the_chance_level_one_time_in_twenty():
    rng = np.random.default_rng(2)

    found = transfer(in_time(motions(rng, 400)), in_time(motions(rng, 400)), DT, (10.0, 25.0))

    assert found.chance == pytest.approx(0.39, abs=0.005)
    assert np.mean(found.coherence > found.chance) == pytest.approx(0.05, abs=0.015)


def test_coherence_of_a_noisy_record_keeps_to_its_ceiling():
    rng = np.random.default_rng(3)
    motion = in_time(motions(rng, 300))
    noise = 0.5 * in_time(motions(rng, 300))
    density = np.var(noise) / (2.0 * 58.0)

    found = transfer(
        motion + noise, motion, DT, (8.0, 25.0), noise_density=lambda f: np.full(f.shape, density)
    )

    # with 7 tapers coherence is on average (1 - c^2)/7 too high: 0.03 at c^2 of 0.8
    assert np.mean(found.ceiling) == pytest.approx(0.8, abs=0.03)
    assert np.mean(found.coherence) == pytest.approx(0.8, abs=0.04)


def test_delay_and_fading_are_those_of_the_filter():
    late, faded = 0.012, 0.02
    spectrum = motions(np.random.default_rng(4), 20)
    reply = np.exp(-2j * np.pi * FREQUENCY * late - np.pi * FREQUENCY * faded)
    found = transfer(in_time(spectrum * reply), in_time(spectrum), DT, BAND)

    delay, fading = delay_and_fading(found)

    # 2.5 % too little in a window of 1 s, 0.3 % in one of 2 s
    assert np.median(delay) == pytest.approx(late, rel=0.035)
    assert np.median(fading) == pytest.approx(faded, rel=0.04)


def test_a_delay_of_more_than_a_period_is_not_a_cycle_off():
    spectrum = motions(np.random.default_rng(5), 20)
    shifted = spectrum * np.exp(-2j * np.pi * FREQUENCY * 0.05)

    delay, _ = delay_and_fading(transfer(in_time(shifted), in_time(spectrum), DT, BAND))

    assert np.median(delay) == pytest.approx(0.05, rel=0.035)


def test_tapers_wider_than_the_band_are_refused():
    with pytest.raises(InputError, match=r"transfer\.time_bandwidth: must lie between 1\.5 and 1 "):
        transfer(np.ones(N), np.ones(N), DT, (3.0, 5.0))


def drawn(rng, deviation, shape=(3, 12, 3)):
    blast, receiver, path, rest = deviation
    values = blast * rng.normal(size=(shape[0], 1, 1)) + rest * rng.normal(size=shape)
    values += receiver * rng.normal(size=(1, *shape[1:]))
    return values + path * rng.normal(size=(*shape[:2], 1))


def test_deviations_of_a_large_set_are_those_it_was_drawn_with():
    truth = {"blast": 0.5, "receiver": 0.4, "path": 0.3, "rest": 0.2}
    values = drawn(np.random.default_rng(6), tuple(truth.values()), (12, 12, 3))

    found = analyse_variance(values).deviation

    # 12 blasts know their deviation to a fifth, 36 channels to an eighth, 144 paths to a 17th
    for (name, deviation), error in zip(truth.items(), (0.45, 0.25, 0.13, 0.1), strict=True):
        assert found[name] == pytest.approx(deviation, rel=error)


def test_variances_of_blasts_are_those_of_the_table_of_mean_squares():
    values = drawn(np.random.default_rng(6), (0.5, 0.0, 0.0, 0.2), (6, 8, 3))
    values -= values.mean(axis=0) - values.mean()
    rest = values - values.mean(axis=(1, 2), keepdims=True)

    found = analyse_variance(values).deviation

    # without effects of receivers and paths what is left of them is rest
    square = np.var(values.mean(axis=(1, 2)), ddof=1) - np.sum(rest**2) / (6 * 23) / 24
    assert found["blast"] == pytest.approx(np.sqrt(square), rel=0.01)


@pytest.mark.parametrize(
    ("term", "deviation"),
    [
        ("blast", (1.0, 0.05, 0.05, 0.1)),
        ("receiver", (0.05, 1.0, 0.05, 0.1)),
        ("path", (0.05, 0.05, 1.0, 0.1)),
    ],
)
def test_the_term_that_differs_is_found(term, deviation):
    found = analyse_variance(drawn(np.random.default_rng(7), deviation))

    assert max(found.deviation, key=found.deviation.get) == term


def test_intervals_of_deviations_hold_the_truth_nine_times_in_ten():
    rng = np.random.default_rng(8)
    truth = dict(zip(("blast", "receiver", "path", "rest"), (0.5, 0.4, 0.3, 0.2), strict=True))
    hits = []
    for _ in range(60):
        found = analyse_variance(drawn(rng, tuple(truth.values()), (3, 8, 3))).intervals
        hits.append([low <= truth[n] <= high for n, (low, high) in found.items()])

    # 60 draws: 90 % within 0.8 and 1 with a chance of 0.99
    assert np.all(np.mean(hits, axis=0) > 0.8)


def test_three_blasts_leave_the_term_of_blasts_wide_open():
    found = analyse_variance(drawn(np.random.default_rng(9), (0.5, 0.1, 0.1, 0.1)))
    low, high = found.intervals["blast"]

    assert high > 5.0 * low


def test_a_slope_on_charge_is_told_with_its_error():
    rng = np.random.default_rng(10)
    charge = np.log([10.0, 40.0, 350.0, 800.0])[:, None, None]
    values = 0.2 * charge + drawn(rng, (0.05, 0.3, 0.1, 0.05), (4, 10, 3))

    found = analyse_variance(values, [charge])

    assert abs(found.slopes[1] - 0.2) < 2.5 * found.slope_errors[1] < 0.15


def test_effects_of_receivers_are_told_where_values_are_missing():
    rng = np.random.default_rng(11)
    values = drawn(rng, (0.02, 0.0, 0.02, 0.02))
    values[:, 4, 1] += 1.0
    values[0, 2] = np.nan

    found = analyse_variance(values).receiver

    assert np.unravel_index(np.argmax(np.abs(found)), found.shape) == (4, 1)
    assert found[4, 1] == pytest.approx(1.0, abs=0.1)


def test_one_blast_can_not_be_divided():
    with pytest.raises(InputError, match="at least 2 blasts"):
        analyse_variance(np.zeros((1, 4, 3)))


def test_what_repeats_at_a_receiver_is_told_from_what_repeats_in_a_blast():
    rng = np.random.default_rng(12)
    white = rng.normal(size=(3, 4, 3, 200))
    white[:, 2] += 1.5 * rng.normal(size=(3, 200))
    white[1] += 1.5 * rng.normal(size=(3, 200))

    found = repeatability(white, n_slides=99)

    assert np.argmax(found.between_blasts) == 2
    assert found.blasts_chance[2] == 0.01
    assert np.argmax(found.between_receivers) == 1
    assert found.receivers_chance[1] == 0.01


def test_noise_repeats_as_often_as_chance_says():
    rng = np.random.default_rng(13)
    chances = [
        repeatability(rng.normal(size=(2, 5, 3, 100)), n_slides=39, seed=n).blasts_chance
        for n in range(40)
    ]

    # 200 values: a tenth of them within 0.04
    assert np.mean(np.array(chances) <= 0.1) == pytest.approx(0.1, abs=0.05)


def test_residuals_of_two_firings_are_alike_once_their_firing_is_divided_out():
    rng = np.random.default_rng(14)
    pulse = np.zeros((2, 3, 3, 600))
    pulse[..., :60] = rng.normal(size=(1, 3, 3, 60))
    times = [np.array([0.0, 0.024, 0.05]), np.array([0.0, 0.042, 0.084])]
    scales = [np.array([3.0, 0.5, 0.4]), np.array([3.0, 0.6, 0.3])]
    fired = np.zeros_like(pulse)
    for b in range(2):
        for time, scale in zip(times[b], scales[b], strict=True):
            fired[b] += scale * np.roll(pulse[b], round(time / DT), axis=-1)

    parted = without_firing(fired, DT, times, scales)

    assert parted == pytest.approx(pulse, abs=1e-9)


def test_motion_is_aligned_by_its_delays():
    motion = np.zeros((1, 2, 3, 50))
    motion[0, 0, :, 10], motion[0, 1, :, 30] = 1.0, 1.0

    found = aligned(motion, DT, np.array([[0.0, 20 * DT]]))

    assert np.array_equal(found[0, 0], found[0, 1])
    assert found[0, 1, 0, 10] == 1.0


def test_a_gain_that_hangs_on_one_channel_is_shown_to():
    rng = np.random.default_rng(15)
    columns = rng.normal(size=(2, 2, 4, 3, 80))
    white = 0.1 * rng.normal(size=columns.shape[1:])
    white[:, 3, 0] += 2.0 * columns[0, :, 3, 0]

    _, shares = influence(white, columns, 1e-3 * np.eye(2))

    assert np.unravel_index(np.argmax(shares["channel"]), (4, 3)) == (3, 0)
    assert shares["channel"][3, 0] > 0.9


def test_influence_is_that_of_a_fit_without_the_part():
    rng = np.random.default_rng(16)
    columns = rng.normal(size=(3, 3, 4, 3, 80))
    white = rng.normal(size=columns.shape[1:]) + columns[1]

    gain, shares = influence(white, columns, np.eye(3))

    kept = [0, 1, 3]
    part = influence(white[:, kept], columns[:, :, kept], np.eye(3))[0]
    assert shares["receiver"][2] == pytest.approx(1.0 - part / gain)
    assert np.all(shares["window"] < 0.3)
