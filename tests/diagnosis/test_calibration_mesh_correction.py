"""A mesh's error fades with the motion that it belongs to."""

import numpy as np
from scipy import fft

from pyblast.diagnosis.calibration import attenuated

DT, BAND, N = 0.004, (4.0, 30.0), 250


def motion():
    """Return bursts of noise in the band at two receivers."""
    rng, times = np.random.default_rng(4), DT * np.arange(N)
    noise = fft.rfft(rng.normal(size=(2, 3, N)))
    frequency = fft.rfftfreq(N, DT)
    noise[..., (frequency < BAND[0]) | (frequency > BAND[1])] = 0.0
    return fft.irfft(noise, N) * np.exp(-0.5 * ((times - 0.4) / 0.08) ** 2)


def damped(field, fades=0.02, late=0.003):
    """Return motion after exp(-pi f t*) and a delay."""
    size = 2 * N
    turn = 2.0 * np.pi * fft.rfftfreq(size, DT)
    faded = fft.rfft(field, size) * np.exp(-0.5 * turn * fades - 1j * turn * late)
    return fft.irfft(faded, size)[..., :N]


def test_the_error_of_a_mesh_is_damped_as_the_motion_is():
    field = motion()
    error = 1e-3 * np.gradient(field, DT, axis=-1)

    found = attenuated(error, field, damped(field), DT, BAND)
    wanted = damped(error)

    assert np.sum((found - wanted) ** 2) < 0.05 * np.sum(wanted**2)
    assert np.sum((error - wanted) ** 2) > 2.0 * np.sum(wanted**2)  # what was added before


def test_motion_that_does_not_change_keeps_its_correction():
    field = motion()
    error = 1e-3 * np.gradient(field, DT, axis=-1)

    assert np.allclose(attenuated(error, field, field, DT, BAND), error, atol=1e-12)


def test_where_motion_grows_a_correction_does_not():
    field = motion()
    error = 1e-3 * np.gradient(field, DT, axis=-1)

    assert np.allclose(attenuated(error, field, 3.0 * field, DT, BAND), error, atol=1e-12)


def test_silence_has_no_correction():
    field = motion()

    assert np.all(attenuated(field, 0.0 * field, field, DT, BAND) == 0.0)
