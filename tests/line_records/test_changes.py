"""Steps of monitoring records: date, kind, size, none where nothing changed."""

import numpy as np
import pytest

from pyblast.line_records.changes import FEWEST, changes, residuals
from pyblast.line_records.monitoring import FEATURES

N_BLASTS, N_STATIONS = 120, 4
UP = FEATURES.index("vertical")


def monitoring(seed, *, first=None, station=None, step=None):
    """Residuals of records whose blasts share half of their scatter, with one step."""
    draw = np.random.default_rng(seed)
    size = (N_BLASTS, N_STATIONS, len(FEATURES))
    values = draw.normal(0.0, 0.08, size) + draw.normal(0.0, 0.08, (N_BLASTS, 1, len(FEATURES)))
    if first is not None:
        values[first:, slice(None) if station is None else station] += step
    values[draw.uniform(size=size[:2]) < 0.1] = np.nan
    return values


@pytest.mark.parametrize(
    ("kind", "station", "step"),
    [
        ("gain", 2, [-0.3, -0.3, 0, 0, 0, 0]),
        ("vertical channel", 1, [0, -0.4, 0, 0, 0, 0]),
        ("orientation", 3, [0, 0, 0.5, -0.4, 0, 0]),
        ("coupling", 0, [0.15, -0.2, 0, 0, -0.2, 0]),
        ("charge", None, [0.3, 0.3, 0, 0, 0, 0]),
        ("timing", None, [-0.1, -0.1, 0, 0, 0.2, -0.2]),
        ("ground", None, np.outer([1, -1, 0.5, -0.5], [0.25, 0.25, 0, 0, 0.2, 0])),
    ],
)
def test_a_step_is_dated_and_named(kind, station, step):
    for seed in range(4):
        (change,) = changes(monitoring(seed, first=70, station=station, step=np.array(step)))

        assert abs(change.blast - 70) <= 2
        assert change.interval[0] <= 70 <= change.interval[1] + 1
        assert kind in change.kinds
        assert change.station == station or kind == "coupling"
        off = np.abs(change.step - step)[np.abs(step) > 0.0]
        assert off.max() < 0.1


@pytest.mark.long
def test_nothing_is_found_where_nothing_changed():
    alarms = [len(changes(monitoring(seed))) for seed in range(60)]

    assert sum(alarms) <= 3  # of 60 times 120 blasts


@pytest.mark.parametrize(
    ("kind", "pattern"), [("gain", [1, 1, 0]), ("vertical channel", [0, 1, 0])]
)
def test_a_slow_change_is_a_drift(kind, pattern):
    named = []
    for seed in range(6):
        values = np.concatenate([monitoring(10 * seed), monitoring(10 * seed + 1)])
        grown = np.clip((np.arange(len(values)) - 70) / 110.0, 0.0, 1.0)
        values[:, 1, :3] += -0.3 * grown[:, None] * pattern
        named += [change for change in changes(values) if change.length]

    assert len(named) >= 5
    for drift in named:
        assert (drift.kinds[0], drift.station) == (kind, 1)
        assert abs(drift.blast + 0.5 * drift.length - 125) < 25
        assert np.abs(drift.step[:3] + 0.3 * np.array(pattern)).max() < 0.08


def test_a_step_is_no_drift():
    step = np.array([-0.3, -0.3, 0, 0, 0, 0])

    found = [changes(monitoring(seed, first=60, station=1, step=step)) for seed in range(8)]

    assert {change.length for result in found for change in result} == {0}


def test_two_steps_are_told_apart():
    values = monitoring(5, first=40, station=1, step=np.array([-0.3, -0.3, 0, 0, 0, 0]))
    values[75:, :] += [0.2, 0.2, 0, 0, 0, 0]

    first, second = changes(values)

    assert (first.station, second.station) == (1, None)
    assert abs(first.blast - 40) <= 2
    assert abs(second.blast - 75) <= 2


def test_few_records_show_no_change():
    assert changes(monitoring(1)[: 2 * FEWEST - 1]) == []
    assert changes(np.full((30, 2, 6), np.nan)) == []


def test_residuals_lack_distance_charge_and_direction():
    draw = np.random.default_rng(4)
    scaled = np.stack([draw.uniform(2.0, 3.0, (300, 3)), draw.uniform(1.0, 2.0, (300, 3))], axis=-1)
    azimuth = draw.uniform(0.0, 2.0 * np.pi, (300, 3))
    noise = draw.normal(0.0, 0.02, (300, 3, 6))
    features = noise.copy()
    features[..., :2] += scaled[..., :1] * -1.5 + scaled[..., 1:] * 0.7 + [[0.5], [0.1], [-0.2]]
    polar = 0.6 * np.exp(2j * azimuth)
    features[..., 2:4] += np.stack([polar.real, polar.imag], axis=-1)

    values = residuals(features, scaled, azimuth)

    assert values.std(axis=0).max() < 0.023
    assert np.abs(np.median(values, axis=0)).max() < 1e-3
    unturned = residuals(noise, scaled, azimuth)
    assert unturned[..., UP].std() < 0.023


def test_a_single_record_far_off_is_no_change():
    values = monitoring(3)
    values[50, 2, :2] += 0.6
    scaled, azimuth = np.zeros((N_BLASTS, N_STATIONS, 2)), np.zeros((N_BLASTS, N_STATIONS))

    assert changes(residuals(values, scaled, azimuth)) == []
