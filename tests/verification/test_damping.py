"""Rayleigh damping of standing waves against its closed form: physics rung 24."""

import numpy as np
import pytest
from scipy.optimize import curve_fit

from pyblast.meshing.mesh_builder import structured_box
from pyblast.solving.boundaries import Fixed
from pyblast.solving.materials import Damping
from verification.columns import AXIS, HELD, ROCK, SPEED, column_model, started

EDGE, N_EDGES = 5.0, 24
CENTRAL = 25.0


def decay(wave, halves, damping):
    """Return frequency in Hz and damping ratio of a free standing wave of some half wavelengths."""
    mesh = structured_box((N_EDGES, 1, 1), (N_EDGES * EDGE, 0.5 * EDGE, 0.5 * EDGE))
    place = EDGE * round(0.5 * N_EDGES / halves)
    ends = [Fixed("west"), Fixed("east")]
    model = column_model(mesh, wave, ends, receivers_at=[place], damping=damping)
    velocity = np.zeros_like(model.mesh.points)
    wavenumber = halves * np.pi / (N_EDGES * EDGE)
    velocity[:, AXIS[wave]] = np.sin(wavenumber * model.mesh.points[:, 0])
    omega = wavenumber * SPEED[wave]

    record = started(model, 8.0 * np.pi / omega, 0.0 * velocity, velocity)

    seismogram = record.seismograms[f"{place:g}"]

    def free(time, amplitude, rate, turn, phase):
        return amplitude * np.exp(-rate * time) * np.cos(turn * time + phase)

    guess = (1.0, damping.ratio_at(omega / 2.0 / np.pi) * omega, omega, 0.0)
    values, _ = curve_fit(free, seismogram.times, seismogram.velocity[:, AXIS[wave]], guess)
    natural = np.hypot(values[1], values[2])
    return natural / (2.0 * np.pi), values[1] / natural


@pytest.mark.parametrize("wave", list(HELD))
@pytest.mark.parametrize("halves", [1, 2, 4])
@pytest.mark.parametrize("parts", [(True, True), (True, False), (False, True)])
def test_a_standing_wave_decays_with_the_ratio_at_its_frequency(wave, halves, parts):
    damping = Damping(0.03, CENTRAL, mass=parts[0], stiffness=parts[1])

    frequency, ratio = decay(wave, halves, damping)

    assert ratio == pytest.approx(damping.ratio_at(frequency), rel=1e-3)


def test_both_parts_give_the_named_ratio_at_the_central_frequency():
    halves, wave = 2, "P"
    central = halves * ROCK.cp / (2.0 * N_EDGES * EDGE)

    _, ratio = decay(wave, halves, Damping(0.03, central))

    assert ratio == pytest.approx(0.03, rel=1e-3)
