"""Misfits behind one interface."""

import numpy as np
import pytest

from pyblast.errors import InputError
from pyblast.inference.misfits import misfit
from pyblast.signals.comparison import compare
from pyblast.signals.seismogram import Seismogram

DT, N = 2e-3, 400
TIMES = DT * np.arange(N)
NAMES = ("paper", "envelope", "phase", "lag", "onset")


def pulses(late=0.0):
    """Pulses of 10 to 16 Hz at 2 receivers in 2 blasts."""
    motion = np.empty((2, 2, 3, N))
    for b, r, c in np.ndindex(2, 2, 3):
        t = TIMES - 0.3 - 0.05 * r - late
        turn = 2.0 * np.pi * (10.0 + 2.0 * r + c) * t
        motion[b, r, c] = (1.0 + b + c) * np.exp(-0.5 * (t / 0.05) ** 2) * np.cos(turn)
    return 1e-3 * motion


def made(name, recorded=None, **given):
    recorded = pulses() if recorded is None else recorded
    return misfit(name, recorded, DT, **given)


@pytest.mark.parametrize("name", NAMES)
def test_a_simulation_that_equals_the_record_has_no_misfit(name):
    assert made(name).value(pulses()) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("name", NAMES)
def test_clipped_samples_have_no_part_in_a_misfit(name):
    valid = np.ones((2, 2, 3, N), bool)
    valid[0, 1, 2, 170:180] = False
    clipped = pulses()
    clipped[~valid] = 5e-3

    assert made(name, clipped, valid=valid).value(pulses()) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("name", NAMES)
def test_a_missing_channel_has_no_part_in_a_misfit(name):
    valid = np.ones((2, 2, 3, N), bool)
    valid[1, 0, 1] = False
    missing = pulses()
    missing[1, 0, 1] = np.nan

    assert made(name, missing, valid=valid).value(pulses()) == pytest.approx(0.0, abs=1e-12)


def test_a_tenth_more_motion_costs_five_percent_by_the_paper():
    assert made("paper").value(1.1 * pulses()) == pytest.approx(5.0)


def test_misfit_of_the_paper_is_that_of_compared_seismograms():
    simulated = 1.2 * pulses(0.004) ** 3 / 1e-6

    wanted = [
        compare(Seismogram(d.T, DT), Seismogram(s.T, DT), (3.0, 60.0), time_frequency=False).misfit
        for d, s in zip(pulses().reshape(4, 3, N), simulated.reshape(4, 3, N), strict=True)
    ]
    assert made("paper", band=(3.0, 60.0)).value(simulated) == pytest.approx(np.mean(wanted))


def test_envelope_misfit_of_a_gain_is_the_gain_and_its_phase_misfit_none():
    assert made("envelope", band=(5.0, 30.0)).value(1.3 * pulses()) == pytest.approx(0.3)
    assert made("phase", band=(5.0, 30.0)).value(1.3 * pulses()) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("name", ["lag", "onset"])
def test_lag_and_onset_tell_how_late_a_simulation_is(name):
    found = made(name).residuals(pulses(0.013))

    # onsets are read between samples 2 ms apart
    assert found == pytest.approx(4 * [0.013], abs=1e-4)


def test_misfit_of_a_silent_simulation_is_finite():
    for name in NAMES:
        assert 0.0 < made(name).value(0.0 * pulses()) < np.inf


def test_an_unknown_misfit_is_refused():
    with pytest.raises(InputError, match=r"must be one of paper, .*got 'area'"):
        made("area")


def test_a_simulation_of_another_shape_is_refused():
    with pytest.raises(InputError, match="simulated must have shape"):
        made("lag").value(pulses()[:1])
