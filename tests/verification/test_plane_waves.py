"""Plane waves into and out of a column, beside cases 1, 3 and 4."""

import numpy as np
import pytest

from pyblast.model.boundary import StressInput, Viscous
from pyblast.solver.run import simulate
from verification.columns import AXIS, SPEED, column, column_model, driven, pulse, ricker, spectrum

FREQUENCY = 20.0
WAVES = pytest.mark.parametrize("wave", ["P", "S"])


def wavelength(wave):
    return SPEED[wave] / FREQUENCY


def interior_gain(wave, edges_per_wavelength, *, ends, amplitude_at=FREQUENCY):
    """Return the spectral velocity four wavelengths inside over the velocity asked for."""
    edge = wavelength(wave) / edges_per_wavelength
    place = 4 * edges_per_wavelength * edge
    model = column_model(column(8 * edges_per_wavelength, edge), wave, ends, receivers_at=[place])
    record = simulate(model, 0.45).seismograms[f"{place:g}"]
    found = spectrum(record.times, record.velocity[:, AXIS[wave]], [amplitude_at])
    asked = spectrum(record.times, ricker(record.times, FREQUENCY), [amplitude_at])
    return float(np.abs(found / asked)[0])


@WAVES
def test_the_error_of_a_viscous_face_is_that_of_its_discrete_impedance(wave):
    ends = [Viscous("west"), Viscous("east"), StressInput("west", pulse(FREQUENCY, wave))]

    wanted = 2.0 / (1.0 + np.cos(np.pi / 10.0))
    assert interior_gain(wave, 10, ends=ends) == pytest.approx(wanted, rel=2e-3)


@WAVES
def test_a_lost_factor_two_shows_as_half_the_motion(wave):
    asked = StressInput("west", pulse(FREQUENCY, wave), doubled=False)
    ends = [Viscous("west"), Viscous("east"), asked]

    assert interior_gain(wave, 20, ends=ends) == pytest.approx(0.5, abs=0.005)


@WAVES
def test_stress_on_a_face_without_dashpots_is_not_doubled(wave):
    ends = [Viscous("east"), StressInput("west", pulse(FREQUENCY, wave))]

    assert interior_gain(wave, 20, ends=ends) == pytest.approx(1.0, abs=0.015)


@WAVES
def test_a_viscous_end_reflects_less_than_one_percent(wave):
    edge = wavelength(wave) / 20
    place = 40 * edge
    short, _ = driven(column(60, edge), wave, FREQUENCY, 0.4, [place], far=[Viscous("east")])
    long, _ = driven(column(200, edge), wave, FREQUENCY, 0.4, [place])

    sent_back = np.abs(short[place][1] - long[place][1]).max()
    assert sent_back < 0.01 * np.abs(long[place][1]).max()
