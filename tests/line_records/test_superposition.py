"""Forecasts by single holes superposed: no look ahead, coverage, narrower than by a law."""

import numpy as np
import pytest

from pyblast import Blast, Seismogram
from pyblast.blasts.published_laws import HARD_ROCK
from pyblast.line_records.forecasts import forecasts
from pyblast.line_records.monitoring import Joined, LoggedBlast, Station
from pyblast.line_records.superposition import HoleMotion, calibrated, sum_of_holes

RATE = 500
TIME = np.arange(RATE) / RATE
AT = np.array([400.0, 0.0, 0.0])


def pulse(hz=16.0):
    return 1e-3 * np.sin(2.0 * np.pi * hz * TIME) * np.exp(-TIME / 0.06)


def plan(draw, count, delay):
    collar = np.stack([4.0 * np.arange(count), np.zeros(count), np.full(count, 12.0)], axis=1)
    names = tuple(map(str, range(count)))
    return Blast(names, collar, collar - [0.0, 0.0, 12.0], charge=draw.uniform(30.0, 60.0, count),
                 times=delay * np.arange(count))  # fmt: skip


def site(plans):
    blasts = [
        LoggedBlast(f"B{n}", f"2026-01-{n % 28 + 1:02d}", (0.0, 0.0, 0.0), 50.0, {}, "x", each)
        for n, each in enumerate(plans)
    ]
    return Joined(blasts, [Station("farm", "", tuple(AT), np.nan)], {}, [], {})


def summed(each, draw, variation):
    """Largest peak of holes that vary, by sums in time."""
    motion, fine = np.zeros(4 * RATE), np.arange(4 * RATE) / RATE
    away = np.linalg.norm(each.centres - AT, axis=1)
    for late, charge, far in zip(each.times, each.charge, away, strict=True):
        scale = (np.sqrt(charge / 40.0) * 400.0 / far) ** HARD_ROCK.beta * draw.lognormal(
            0.0, variation
        )
        motion += scale * np.interp(fine - late - (far - away.min()) / 2500.0, TIME, pulse(), 0, 0)
    return np.abs(motion).max()


def test_a_superposition_is_the_sum_of_its_holes():
    draw = np.random.default_rng(1)
    plans = [plan(draw, 12, 1.0 / 16.0), plan(draw, 1, 0.0), None]
    motion = Seismogram(pulse()[:, None] * [0.4, 1.0, 0.2], 1.0 / RATE)
    hole = HoleMotion(motion, 40.0, 400.0, 0)

    values = sum_of_holes(site(plans), {0: [hole]})

    assert 10.0 ** values[0, 0, 0] == pytest.approx(summed(plans[0], draw, 0.0), rel=0.03)
    assert 10.0 ** values[1, 0, 0] == pytest.approx(summed(plans[1], draw, 0.0), rel=0.01)
    assert 10.0 ** values[0, 0, 1] == pytest.approx(16.0, rel=0.15)
    assert np.isnan(values[2]).all()


def test_a_hole_forecasts_no_blast_before_it():
    draw = np.random.default_rng(2)
    plans = [plan(draw, 5, 0.02) for _ in range(4)]
    weak, strong = (
        HoleMotion(Seismogram(size * pulse()[:, None] * np.ones(3), 1.0 / RATE), 40.0, 400.0, since)
        for size, since in ((1.0, 1), (10.0, 3))
    )

    peak = sum_of_holes(site(plans), {0: [weak, strong]})[:, 0, 0]
    alone = sum_of_holes(site(plans), {0: [weak]})[:, 0, 0]

    assert np.isnan(peak[0])
    assert np.array_equal(peak[1:3], alone[1:3])
    assert peak[3] == pytest.approx(alone[3] + 1.0)


def test_bands_by_superposition_hold_and_are_narrower_where_delays_vary():
    hole = HoleMotion(Seismogram(pulse()[:, None] * np.ones(3), 1.0 / RATE), 40.0, 400.0, 0)
    inside, narrower = [], []
    for seed in range(6):
        draw = np.random.default_rng(seed)
        plans = [plan(draw, int(draw.integers(6, 30)), draw.choice([0.009, 0.017, 0.031, 0.062]))
                 for _ in range(60)]  # fmt: skip
        values = np.array([[np.log10(2.0 * summed(each, draw, 0.2))] for each in plans])
        charge = np.log10([[each.charge_per_window()] for each in plans])
        law = forecasts(values, np.stack([np.full_like(values, 2.6), charge], axis=-1))

        own = calibrated(values, sum_of_holes(site(plans), {0: [hole]})[..., 0])

        inside.append(own.inside(values)[5:])
        narrower.append(np.nanmedian(own.half()) / np.nanmedian(law.half()))

    assert np.mean(inside) == pytest.approx(0.90, abs=0.04)
    assert np.median(narrower) < 0.6
