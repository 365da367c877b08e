"""What a residual shows by itself: its speed and azimuth, its polarisation, its growth."""

import numpy as np
import pytest

from pyblast.inference.moveout import growth, moveout, polarised_shares

DT = 0.002
TIMES = DT * np.arange(400)
PLACES = np.array(
    [[60.0, 10.0, 0.0], [20.0, 90.0, 0.0], [-70.0, 40.0, 0.0], [10.0, -120.0, 0.0], [130, 60, 0]]
)
ORIGIN = np.array([5.0, -3.0, -10.0])


def pulses(late):
    """Return a pulse (n, 3, n_samples) at times (n,) s, of any size."""
    since = TIMES - np.reshape(late, (-1, 1))
    wave = np.exp(-((since / 0.02) ** 2)) * np.cos(2.0 * np.pi * 20.0 * since)
    size = np.outer(np.arange(1, 1 + len(wave)), [1.0, 0.5, 2.0])
    return size[..., None] * wave[:, None]


@pytest.mark.parametrize("speed", [340.0, 1500.0])
def test_what_runs_from_the_blast_shows_its_speed(speed):
    late = 0.1 + np.linalg.norm(PLACES - ORIGIN, axis=1) / speed
    said = moveout(pulses(late), DT, PLACES, ORIGIN)
    assert said["azimuth_deg"] is None
    assert said["low"] <= speed <= said["high"]
    assert said["speed_m_per_s"] == pytest.approx(speed, rel=0.15)


def test_a_plane_wave_shows_where_it_runs():
    towards = np.array([np.sin(np.radians(60.0)), np.cos(np.radians(60.0))])
    late = 0.3 + PLACES[:, :2] @ towards / 600.0
    said = moveout(pulses(late), DT, PLACES, ORIGIN)
    assert said["azimuth_deg"] == pytest.approx(60.0, abs=10.0)
    assert said["speed_m_per_s"] == pytest.approx(600.0, rel=0.15)


def test_few_receivers_and_no_common_time_show_nothing():
    assert moveout(pulses([0.1, 0.2, 0.3]), DT, PLACES[:3], ORIGIN) is None
    assert moveout(pulses([0.3] * 5) * 0.0, DT, PLACES, ORIGIN) is None


def test_polarisation_is_that_of_the_way_from_the_blast():
    residual = np.zeros((1, 3, 10))
    residual[0, 0] = 1.0
    across = polarised_shares(residual, np.array([0.0]))
    along = polarised_shares(residual, np.array([0.5 * np.pi]))
    assert (across["transverse"], along["radial"]) == (1.0, 1.0)
    assert sum(along.values()) == pytest.approx(1.0)


def test_growth_is_the_exponent_of_the_charge_over_what_is_linear():
    charge = np.array([1.0, 10.0, 100.0])
    assert growth(0.01 * charge**0.5, charge) == pytest.approx(0.5)
    assert growth(np.array([0.1, 0.1]), np.array([10.0, 11.0])) is None
