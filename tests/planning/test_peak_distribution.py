"""Peaks of many blasts are those of each blast by itself."""

from dataclasses import replace

import numpy as np
import pytest

from pyblast.errors import InputError
from pyblast.mesh.builder import structured_box
from pyblast.model.boundary import Viscous
from pyblast.model.model import Model, Receiver
from pyblast.model.source import Hole, MomentTensor, TimeFunction
from pyblast.planning import FiringScatter, drawn_peaks, peak_bands
from pyblast.runs import blast_ensemble
from pyblast.runs.blast_ensemble import blast_spectra
from pyblast.runs.greens import greens_functions
from verification.columns import ROCK, ricker

SIDES = ("west", "east", "south", "north", "bottom")
RATE = TimeFunction(1e8 * ricker(np.arange(0.0, 0.06, 5e-4), 50.0), 5e-4)
EARLY = replace(RATE, start=-0.01)
HOLES = (
    Hole(np.array([8.0, 11.0, 6.0]), 20.0, 0.5, RATE, 0.7),
    Hole(np.array([6.0, 5.0, 9.0]), 15.0, 0.0, EARLY),
    MomentTensor(np.array([9.0, 8.0, 12.0]), np.diag([10.0, 2.0, 2.0]), 0.01, RATE),
)
GENERATOR = np.random.default_rng(4)
TIMES = GENERATOR.uniform(0.012, 0.05, size=(40, 3))
SCALES = GENERATOR.lognormal(sigma=0.3, size=(40, 3))


@pytest.fixture(scope="module")
def bank():
    model = Model(
        structured_box((5, 5, 5), (20.0, 20.0, 20.0)),
        {"rock": ROCK},
        boundaries=[*map(Viscous, SIDES)],
        sources=HOLES,
        receivers=[Receiver("A", (8.0, 11.0, 17.0)), Receiver("B", (15.0, 6.0, 15.0), 0.6)],
    )
    return greens_functions(model, 0.12, side="source")


@pytest.fixture(scope="module")
def spectra(bank):
    return blast_spectra(bank, HOLES, earliest=0.01, latest=0.05)


def fired(times, scales):
    """Return the holes with other times and strengths."""
    plain = [
        replace(hole, time=t, charge=hole.charge * s ** (1.0 / hole.exponent))
        for hole, t, s in zip(HOLES[:2], times, scales, strict=False)
    ]
    return [*plain, replace(HOLES[2], time=times[2], tensor=scales[2] * HOLES[2].tensor)]


def test_peaks_are_those_of_each_blast(bank, spectra):
    found = spectra.peaks(TIMES, SCALES)

    for number in range(0, len(TIMES), 4):
        wanted = bank.blast(fired(TIMES[number], SCALES[number]), 0.24)
        for r, record in enumerate(wanted.values()):
            fine = record.resampled(record.dt / 10.0)  # a peak may lie between two steps
            # A parabola through three steps stands for the peak between them.
            assert found.ppv[number, r] == pytest.approx(fine.ppv, abs=4e-3 * fine.pvs)
            assert found.pvs[number, r] == pytest.approx(fine.pvs, rel=1e-3)


def test_seismograms_are_those_of_the_blast(bank, spectra):
    times, scales = TIMES[0], SCALES[0]
    wanted = bank.blast(fired(times, scales), 0.2)
    found = spectra.seismograms(times, scales)

    for name, record in wanted.items():
        assert found[name].components == record.components
        again = found[name].sampled(0.02, 1e-3, 150).velocity
        known = record.sampled(0.02, 1e-3, 150).velocity
        assert again == pytest.approx(known, abs=1e-3 * record.pvs)


def test_peaks_do_not_depend_on_how_many_blasts_go_together(spectra, monkeypatch):
    at_once = spectra.peaks(TIMES, SCALES)
    monkeypatch.setattr(blast_ensemble, "AT_ONCE", 7 * 6 * spectra.n_samples)

    in_batches = spectra.peaks(TIMES, SCALES)

    assert in_batches.ppv == pytest.approx(at_once.ppv, rel=1e-11)
    assert in_batches.pvs == pytest.approx(at_once.pvs, rel=1e-11)


def test_bands_of_a_model_hold_their_share_of_fresh_blasts(spectra):
    plan, unsure = np.array([0.02, 0.03, 0.04]), FiringScatter(delay=0.001, charge=0.3, doubt=0.2)
    bands = peak_bands(spectra, plan, unsure, n_blasts=4000, seed=1, quantity="pvs")

    fresh = drawn_peaks(spectra, plan, unsure, 1.0, 4000, 2, "pvs")

    for share in (0.5, 0.9, 0.95):
        assert bands.coverage(fresh, share) == pytest.approx(share, abs=0.03)


def test_times_that_were_not_allowed_for_are_refused(spectra):
    with pytest.raises(InputError, match=r"times: must lie in 0\.01 to 0\.05 s, got .* to 0\.06 s"):
        spectra.peaks(np.full((1, 3), 0.06))
    with pytest.raises(InputError, match=r"times: need \(n_blasts, 3\), got \(2, 2\)"):
        spectra.peaks(np.zeros((2, 2)))
    with pytest.raises(InputError, match="latest: must not be below earliest"):
        blast_spectra(None, HOLES, latest=-1.0)
