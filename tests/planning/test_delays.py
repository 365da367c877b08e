"""Plans before they are fired: bands of peaks, and the best delays, where the answer is known."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from pyblast import InputError, Seismogram, superpose
from pyblast.blasts.blast import Firing
from pyblast.planning import (
    FiringScatter,
    best_delays,
    drawn_peaks,
    gain_of_plan,
    peak_bands,
    rows_pattern,
    severity,
)
from pyblast.runs.blast_ensemble import signature_spectra

DT = 1e-3
TIMES = np.array([0.0, 0.0173, 0.0341, 0.0625])
SHARES = (0.5, 0.9, 0.95)


def wave(seed, hz=20.0, start=0.01):
    """Return motion around a frequency that begins and ends at rest."""
    generator, t = np.random.default_rng(seed), DT * np.arange(300)
    turns = 2.0 * np.pi * (hz * t[:, None] + generator.uniform(size=3))
    shape = np.sin(np.pi * t / t[-1]) ** 2
    return Seismogram(1e-3 * shape[:, None] * np.sin(turns), DT, start)


def harmonic(hz):
    """Return a long burst of one frequency, one component only."""
    t = DT * np.arange(2000)
    line = 1e-3 * np.sin(np.pi * t / t[-1]) ** 2 * np.sin(2.0 * np.pi * hz * t)
    return Seismogram(np.outer(line, [0.0, 0.0, 1.0]), DT)


@pytest.fixture(scope="module")
def spectra():
    return signature_spectra({"A": wave(1), "B": wave(2, 35.0)}, 4, earliest=-0.15, latest=0.25)


def test_recorded_holes_add_up_as_superposition_does():
    own, shifts = (
        [wave(n, 15.0 + 5.0 * n, 0.002 * n) for n in range(4)],
        [[0.0, 0.01, -0.02, 0.005]],
    )
    scales = np.array([1.0, 0.8, 1.3, 0.6])
    found = signature_spectra({"A": own}, 4, latest=0.1, travel_shifts=shifts).seismograms(
        TIMES, scales
    )["A"]

    wanted = superpose(own[0], Firing(TIMES, scales), signatures=own, travel_shifts=shifts[0])
    again = found.sampled(wanted.start, DT, len(wanted.velocity))
    assert again.velocity == pytest.approx(wanted.velocity, abs=1e-4 * wanted.pvs)


def test_band_is_that_of_a_filtered_seismogram(spectra):
    found = spectra.banded(10.0, 25.0).peaks(TIMES[None])

    whole = spectra.seismograms(TIMES)["B"]
    padded = whole.sampled(whole.start - 1.0, DT / 5, 15_000)
    assert found.ppv[0, 1] == pytest.approx(padded.bandpassed(10.0, 25.0).ppv, rel=2e-3)


def test_level_of_one_hole_is_that_of_its_charge():
    one = signature_spectra({"A": wave(1)}, 1, latest=0.0)
    peak = drawn_peaks(one, [0.0], FiringScatter(), 1.0, 1, 0)[0, 0]

    bands = peak_bands(one, [0.0], FiringScatter(charge=0.3), n_blasts=20_000)

    for share in SHARES:
        wanted = peak * np.exp(0.3 * stats.norm.ppf(share))
        assert bands.level(share) == pytest.approx(wanted, rel=0.02)


def test_scatter_has_the_deviations_it_says():
    scatter = FiringScatter(delay=0.001, delay_share=0.02, charge=0.2, blast=0.1)
    times, scales = scatter.drawn([0.0, 0.5], 20_000, seed=4)

    assert times.std(axis=0) == pytest.approx([0.001, np.hypot(0.001, 0.01)], rel=0.02)
    assert np.log(scales).std() == pytest.approx(np.hypot(0.2, 0.1), rel=0.02)
    assert np.corrcoef(np.log(scales).T)[0, 1] == pytest.approx(0.2, abs=0.03)
    earliest, latest = scatter.reach([0.0, 0.5])
    assert earliest <= times.min() < times.max() <= latest


@pytest.mark.parametrize("share", SHARES)
def test_bands_hold_their_share_of_fresh_blasts(spectra, share):
    scatter = FiringScatter(delay=0.003, charge=0.3)
    bands = peak_bands(spectra, TIMES, scatter, n_blasts=4000, seed=1)

    fresh = drawn_peaks(spectra, TIMES, scatter, 1.0, 4000, 2)

    assert bands.coverage(fresh, share) == pytest.approx(share, abs=0.03)
    assert np.mean(fresh <= bands.level(share), axis=0) == pytest.approx(share, abs=0.03)


def test_unknown_scatter_needs_doubt(spectra):
    truth = FiringScatter(delay=0.003, charge=0.2, doubt=0.7)
    fresh = drawn_peaks(spectra, TIMES, truth, 1.0, 6000, 2)
    sure, unsure = (
        peak_bands(spectra, TIMES, FiringScatter(delay=0.003, charge=0.2, doubt=doubt),
                   n_blasts=6000, seed=1).coverage(fresh, 0.9) for doubt in (0.0, 0.7)
    )  # fmt: skip

    assert sure < 0.85
    assert unsure == pytest.approx(0.9, abs=0.02)


def test_two_holes_of_one_frequency_cancel_half_a_period_apart():
    spectra = signature_spectra({"A": harmonic(10.0)}, 2, latest=0.1, earliest=-0.01)
    scatter = FiringScatter(delay=1e-4)

    found = best_delays(spectra, [[0], [1]], 0.005, 0.09, scatter, n_blasts=20)

    assert found.delays[0] == pytest.approx(0.05)
    assert found.times == pytest.approx([0.0, 0.05])
    # Left over: how much the burst grows in half a period, 1e-3 pi/2 of 0.05/2 s.
    assert found.tried[:, 1].min() < 0.1 * found.tried[:, 1].max()


def test_two_delays_are_found_together():
    pattern = rows_pattern(2, 3)  # three holes cancel a third of a period apart, in any row
    spectra = signature_spectra({"A": harmonic(12.5)}, 6, latest=0.2, earliest=-0.01)

    found = best_delays(spectra, pattern, [0.003, 0.003], [0.037, 0.037], FiringScatter(1e-4),
                        n_blasts=10)  # fmt: skip

    comb = abs(np.exp(2j * np.pi * 12.5 * found.times).sum()) / 6.0
    assert comb < 0.02


def test_a_rule_that_plans_must_keep_is_kept():
    spectra = signature_spectra({"A": harmonic(10.0)}, 2, latest=0.1, earliest=-0.01)

    found = best_delays(spectra, [[0], [1]], 0.005, 0.09, FiringScatter(), n_blasts=1,
                        allowed=lambda times: times[1] < 0.0405)  # fmt: skip

    assert found.delays[0] == pytest.approx(0.040)
    assert found.tried[:, 0].max() < 0.0405


def test_gain_of_a_plan_over_itself_is_nothing(spectra):
    same = gain_of_plan(
        spectra, TIMES, TIMES, FiringScatter(0.002), limits=[1e-3, 2e-3], n_blasts=200
    )

    assert (same.reduction, *same.interval) == (0.0, 0.0, 0.0)


def test_interval_of_a_gain_holds_what_many_blasts_say(spectra):
    scatter, other = FiringScatter(delay=0.002, charge=0.2), 0.7 * TIMES
    levels = [severity(spectra, times, scatter, 1.0, 0.9, n_blasts=5000, seed=99)
              for times in (TIMES, other)]  # fmt: skip
    truth = 1.0 - levels[1] / levels[0]

    found = [
        gain_of_plan(spectra, TIMES, other, scatter, n_blasts=200, seed=n).interval
        for n in range(20)
    ]

    inside = sum(low < truth < high for low, high in found)
    assert 14 <= inside <= 20  # 18 of 20, three standard errors


def test_rows_fire_one_after_another():
    assert (rows_pattern(2, 3) @ [0.01, 0.1]).tolist() == pytest.approx(
        [0.0, 0.01, 0.02, 0.1, 0.11, 0.12]
    )


def test_what_makes_no_plan_is_refused(spectra):
    scatter = FiringScatter()
    with pytest.raises(InputError, match=r"firing scatter: charge must not be negative, got -1"):
        FiringScatter(charge=-1.0)
    with pytest.raises(InputError, match=r"pattern: need \(4, 1\) for 4 holes and 1 delays"):
        best_delays(spectra, [[0], [1]], 0.0, 0.02, scatter)
    with pytest.raises(InputError, match=r"allowed: refuses every plan"):
        best_delays(spectra, np.arange(4.0)[:, None], 0.0, 0.02, scatter, allowed=lambda _: False)
    with pytest.raises(InputError, match=r"limits: need one positive limit, or one for each of 2"):
        gain_of_plan(spectra, TIMES, TIMES, scatter, limits=[1.0, 1.0, 1.0])
    with pytest.raises(InputError, match=r'quantity: must be "ppv" or "pvs"'):
        peak_bands(spectra, TIMES, scatter, n_blasts=2, quantity="peak")
    with pytest.raises(InputError, match=r"share must lie between 0 and 1, got 95"):
        peak_bands(spectra, TIMES, scatter, n_blasts=2).level(95)
    with pytest.raises(InputError, match=r"need 0 < low < high"):
        spectra.banded(30.0, 20.0)
    with pytest.raises(InputError, match=r"signatures\['A'\]: 2 seismograms for 3 holes"):
        signature_spectra({"A": [wave(1)] * 2}, 3, latest=0.1)
    with pytest.raises(InputError, match=r"need dt = 0.001 s and one set of axes"):
        signature_spectra({"A": wave(1), "B": wave(2).resampled(0.002)}, 3, latest=0.1)
    with pytest.raises(InputError, match=r"travel_shifts: need \(1, 3\) finite values"):
        signature_spectra({"A": wave(1)}, 3, latest=0.1, travel_shifts=[0.0])


@pytest.mark.long
def test_example_ends_with_a_gain_and_a_figure(tmp_path):
    script = Path(__file__).parents[2] / "examples" / "03_best_delays.py"
    environment = os.environ | {"PYTHONPATH": str(script.parents[1]), "MPLBACKEND": "agg"}

    done = subprocess.run([sys.executable, script, tmp_path / "best.png"], env=environment,
                          text=True, capture_output=True, timeout=120, check=True)  # fmt: skip

    assert (tmp_path / "best.png").read_bytes().startswith(b"\x89PNG")
    assert "quantile of PPV falls by" in done.stdout
