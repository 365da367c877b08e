"""Known shots: first arrivals give gains and clocks, and nothing of what comes later."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "examples" / "ball_drops"))

from known_shots import (
    ShotRecords,
    gains,
    held_out,
    in_band,
    lead,
    loss,
    matched,
    scores,
    shares,
)

DT, BAND = 1e-6, (50e3, 100e3)
SHOTS, SENSORS = tuple("abcdefgh"), tuple("PQRSTU")
RNG = np.random.default_rng(7)
TIMES = DT * np.arange(320) - 6e-5


def pulse(arrival):
    """Return a pulse of 75 kHz, (n_samples,)."""
    late = TIMES - arrival
    return np.exp(-((late / 7e-6) ** 2)) * np.sin(2.0 * np.pi * 75e3 * late)


def survey(echo=1.0):
    """Return arrivals, motion (3, n, n_samples), shots and sensors of all pairs."""
    shots = tuple(s for s in SHOTS for _ in SENSORS)
    sensors = SENSORS * len(SHOTS)
    rng = np.random.default_rng(3)
    arrivals = 2e-5 + 3e-5 * rng.random(len(shots))
    late = (4e-5, 7e-5, 1.2e-4, 1.5e-4)
    motion = np.array([
        pulse(t + 5e-6) + 0.7 * echo * sum(pulse(t + 5e-6 + d) for d in late) for t in arrivals
    ])  # fmt: skip
    return arrivals, np.array([motion, 0.0 * motion, 0.0 * motion]), shots, sensors


def records(samples, arrivals, shots, sensors):
    """Return records that last to the end."""
    n = len(shots)
    return ShotRecords(samples, DT, 6e-5, BAND, shots, sensors, arrivals, np.ones(n),
                       np.zeros((n, 2)))  # fmt: skip


GAINS = dict(zip(SENSORS, (0.3, -0.4, 0.0, 0.1, -0.1, 0.2), strict=True))


@pytest.fixture(scope="module")
def sent():
    """Return records with gains and clocks, and the motion that they are of."""
    arrivals, motion, shots, sensors = survey()
    late = dict(zip(SHOTS, 1e-6 * np.arange(-4, 4), strict=True))
    moved = [np.interp(TIMES - late[s], TIMES, m) for s, m in zip(shots, motion[0], strict=True)]
    amplitude = np.exp([GAINS[name] for name in sensors])
    return records(amplitude[:, None] * np.array(moved), arrivals, shots, sensors), motion, late


def test_clocks_and_gains_come_back(sent):
    data, motion, late = sent

    match = matched(data, motion)
    known, amplitudes = gains(data, match, np.ones(len(data.shots), dtype=bool))

    assert match.clocks == pytest.approx(late, abs=2e-7)
    usual = np.median(list(known.values())) - np.median(list(GAINS.values()))
    assert {k: v - usual for k, v in known.items()} == pytest.approx(GAINS, abs=0.05)
    assert np.nanmax(shares(match, amplitudes)) < 0.05


def test_what_comes_later_changes_no_gain_and_no_clock(sent):
    data, motion, _ = sent
    other = survey(echo=-2.0)[1]

    first, second = (matched(data, each) for each in (motion, other))

    assert second.clocks == pytest.approx(first.clocks, abs=3e-7)
    assert second.levels == pytest.approx(first.levels, abs=0.1)
    assert scores(data, second, second.levels).sum() < scores(data, first, first.levels).sum() - 50


def test_halves_are_predicted_by_what_the_other_half_says(sent):
    data, motion, _ = sent

    result = held_out(data, [matched(data, survey(echo=-1.0)[1]), matched(data, motion)])

    assert result.chosen == (1, 1)
    assert np.nanmedian(result.shares) < 0.05
    assert data.halves[0].sum() + data.halves[1].sum() == len(data.shots)
    assert not np.any(data.halves[0] & data.halves[1])


def test_a_record_counts_in_no_window_that_it_does_not_cover(sent):
    data, motion, _ = sent
    short = data.taken(np.ones(len(data.shots), dtype=bool))
    short.ends[:] = data.arrivals + 6e-5

    share = shares(matched(short, motion), np.zeros(len(data.shots)))

    assert np.isfinite(share[:, 0]).all()
    assert np.isnan(share[:, 1:]).all()


def test_a_lead_has_the_error_of_its_shots(sent):
    data = sent[0]
    gain = np.zeros((len(data.shots), 3))
    gain[:, 0] = [4.0 if shot in "abcdefg" else -1.0 for shot in data.shots]

    value = lead(data, gain, 0.0 * gain)

    assert value.value == pytest.approx(6 * (7 * 4.0 - 1.0))
    # Of 8 draws from 7 shots of 24 and one of -6: standard deviation 30 sqrt(7/8 x 1/8 x 8).
    assert value.error == pytest.approx(30.0 * np.sqrt(7.0 / 8.0), rel=0.1)
    assert value.decisive
    assert value.general
    assert not lead(data, 0.0 * gain, gain).decisive


@pytest.mark.parametrize("inverse", [0.0, 0.02])
def test_a_loss_is_measured_by_energies_although_phases_are_wrong(inverse):
    arrivals, motion, shots, sensors = survey()
    coda = in_band(np.random.default_rng(5).normal(size=motion[0].shape), DT, BAND)
    late = np.maximum(TIMES - arrivals[:, None], 0.0)
    decay = np.exp(-np.pi * np.sqrt(BAND[0] * BAND[1]) * inverse * late)
    data = records(decay * coda, arrivals, shots, sensors)

    value, error = loss(data, -coda)

    assert value == pytest.approx(inverse, abs=1e-3)
    assert error < 1e-3
