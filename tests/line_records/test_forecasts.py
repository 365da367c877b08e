"""Forecasts before each blast: coverage, no look ahead; limits of a share of blasts."""

import numpy as np
import pytest

from pyblast.errors import InputError
from pyblast.line_records.forecasts import StatisticalLimit, forecasts, share_interval


def series(seed, count=200, spread=0.15):
    draw = np.random.default_rng(seed)
    scaled = np.stack([draw.uniform(2.0, 2.8, (count, 3)), draw.uniform(1.3, 2.0, (count, 3))], -1)
    values = -1.4 * scaled[..., 0] + 0.8 * scaled[..., 1] + [0.3, 0.0, -0.2]
    return values + draw.normal(0.0, spread, (count, 3)), scaled


def test_bands_hold_the_share_of_blasts_that_they_say():
    inside = []
    for seed in range(8):
        values, scaled = series(seed)
        inside.append(forecasts(values, scaled).inside(values)[5:])

    assert np.isfinite(inside).all()
    assert np.mean(inside) == pytest.approx(0.90, abs=0.015)


def test_a_forecast_knows_the_blasts_before_it_alone():
    values, scaled = series(1)
    whole = forecasts(values, scaled)
    changed = values.copy()
    changed[120:] += 1.0

    early = forecasts(changed, scaled)

    assert np.array_equal(whole.mean[:121], early.mean[:121], equal_nan=True)
    assert np.array_equal(whole.spread[:121], early.spread[:121], equal_nan=True)
    assert np.all(early.mean[141:] > whole.mean[141:] + 0.5)
    assert whole.exponent[-1] == pytest.approx(0.8, abs=0.1)


def test_what_did_not_trigger_counts():
    bias = {"left out": [], "as bounds": []}
    for seed in range(12):
        values, scaled = series(seed, spread=0.2)
        scaled = np.broadcast_to(scaled[:1], scaled.shape)
        values = values - values.mean(axis=0)
        level = np.where(values < -0.1, -0.1, np.nan)
        seen = np.where(values < -0.1, np.nan, values)
        bias["left out"].append(np.nanmean(forecasts(seen, scaled).mean[60:]))
        bias["as bounds"].append(np.nanmean(forecasts(seen, scaled, level).mean[60:]))

    assert np.mean(bias["left out"]) > 0.05
    assert abs(np.mean(bias["as bounds"])) < 0.03


def test_interval_of_a_share_holds_it():
    draw = np.random.default_rng(2)
    counts = draw.binomial(60, 0.93, 400)

    held = [low <= 0.93 <= high for low, high in (share_interval(int(c), 60) for c in counts)]

    assert np.mean(held) >= 0.90
    assert share_interval(0, 5)[0] == 0.0
    assert share_interval(5, 5)[1] == 1.0


def test_a_limit_counts_records_and_blasts_below_the_trigger():
    days = [f"2026-{month:02d}-10" for month in range(1, 11)]
    peaks = np.array([2, 3, np.nan, 6, 2, 1, np.nan, np.nan, 12, 2]) * 1e-3
    bounds = np.full(10, np.nan)
    bounds[[2, 6]] = 5e-4, 8e-3  # the second trigger level lies above the limit
    limit = StatisticalLimit(5e-3, 0.8, 1e-2, "2026-01-01", "2026-12-31")

    row = limit.judged(days, peaks, bounds)

    assert (row["blasts"], row["unknown"], row["below_trigger"]) == (8, 2, 1)
    assert (row["over"], row["over_ceiling"]) == (2, 1)
    assert row["share"] == 0.75
    assert row["expected_blasts"] == pytest.approx(8 * 365 / 283)
    assert row["may_exceed"] == 0  # a fifth of 10.3 blasts, less two
    open_ended = StatisticalLimit(5e-3, 0.8).judged(days, peaks, bounds)
    assert (open_ended["over"], open_ended["may_exceed"]) == (2, -1)
    later = StatisticalLimit(5e-3, 0.8, since="2027-01-01").judged(days, peaks, bounds)
    assert later["blasts"] == 0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"level": 0.0}, "level must be positive"),
        ({"level": 2.0, "ceiling": 1.0}, "not above the ceiling"),
        ({"level": 1.0, "share": 1.0}, "share must lie between 0 and 1"),
        ({"level": 1.0, "since": "soon"}, "expected a day such as"),
        ({"level": 1.0, "since": "2027-01-01", "until": "2026-01-01"}, "is after"),
    ],
)
def test_a_limit_that_makes_no_sense_is_refused(arguments, message):
    with pytest.raises(InputError, match=message):
        StatisticalLimit(**arguments)
