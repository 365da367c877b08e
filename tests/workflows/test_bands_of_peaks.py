"""Bands of the peaks of blasts that are superposed or predicted: what is drawn, what is said."""

from types import SimpleNamespace

import numpy as np
import pytest
from command_line import call
from small_project import written

from pyblast.inference.variation import Charges, Scatter, Span, peaks_of_drawn_blasts
from pyblast.project.project import load_project
from pyblast.workflows.prediction import FurtherHoles, bands_of_peaks
from pyblast.workflows.run import superposed_bands

CERTAIN = "[priors]\nholes_percent = {}\nfiring_ms = 0\n"


def test_holes_that_neither_vary_nor_miss_their_time_have_the_peak_of_their_sum(tmp_path):
    path = written(tmp_path)
    path.write_text(path.read_text() + CERTAIN.format(0))
    project = load_project(path)

    bands = superposed_bands(project)

    for ends in (*bands.varied, *bands.alike):
        np.testing.assert_allclose(ends, project.input.superposed.ppv, rtol=0.01)


@pytest.mark.long
def test_superpose_says_how_wide_the_band_is_with_holes_that_vary_and_without(tmp_path):
    path = written(tmp_path)
    bands = superposed_bands(load_project(path))
    shown = " ".join(call("superpose", path).output.split())

    assert np.all(bands.varied[1] / bands.varied[0] > bands.alike[1] / bands.alike[0])
    assert "whole blast, 90 % of such blasts" in shown
    assert "holes vary by 20 % (priors.holes_percent)" in shown


def test_a_band_of_a_prediction_is_relative_to_its_own_peak():
    rng = np.random.default_rng(1)
    own = rng.standard_normal((6, 2, 3, 200)) * np.exp(-np.arange(200) / 20.0)
    charges = Charges(own, 0.01 * np.arange(6), np.eye(3)[rng.integers(0, 3, 6)] * 9.0)
    span = Span(5.0, 60.0, 2e-3)
    (planned,) = peaks_of_drawn_blasts(charges, span, Scatter(0.0, 0.0), 1)
    total = np.zeros((2, 3, 200))
    for late, motion in zip(5 * np.arange(6), own, strict=True):
        total[..., late:] += motion[..., : 200 - late]
    priors = SimpleNamespace(firing_ms=0.1, amplitude_percent=3.0)
    project = SimpleNamespace(config=SimpleNamespace(priors=priors))
    case = SimpleNamespace(band=span, receivers=("R1", "R2"), project=project)

    np.testing.assert_allclose(planned, np.abs(total).max(axis=-1), rtol=1e-9)
    own = FurtherHoles(charges)
    once, twice = (bands_of_peaks(case, k * total, own, 0.2, 0.01) for k in (1.0, 2.0))
    for name, band in once.items():
        np.testing.assert_allclose(twice[name], 2.0 * np.array(band))
        assert band.low < band.low_alike < band.high_alike < band.high
        assert band.peak == pytest.approx(np.abs(total[case.receivers.index(name)]).max())
